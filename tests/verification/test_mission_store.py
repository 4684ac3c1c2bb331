"""Missions in files say the same as missions in memory."""

from __future__ import annotations

import gc
import tempfile
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import seatrial as st
from seatrial import SeatrialError
from seatrial.verification import flown_missions, missions
from seatrial.verification.flown_missions import FlownMissions, MissionStore, StoreSettings
from seatrial.verification.missions import MissionSettings

OUT = """
format = 1
name = "out"
speed_m_s = 1.5
acceptance_radius_m = 5.0
[[legs]]
north_m = 40.0
east_m = 0.0
depth_m = 5.0
"""

ASKED = [
    st.Requirement("keeps its path", "true_cross_track_p95_m <= 0.4", probability=0.6),
    st.Requirement("is complete", 'ending == "complete" and not abort', probability=0.6),
]

WATER = {"current": {"speed_m_s": [0.0, 0.5]}}
CONDITIONS = {"faults": [{"actuator": "stern", "probability": 0.3}]}


def verified(folder: Path) -> st.Verification:
    return st.verify(
        "cwolf",
        "cwolf",
        [st.Mission.from_toml(OUT)],
        requirements=ASKED,
        water=WATER,
        conditions=CONDITIONS,
        runs=60,
        work=st.Work(run_dir=folder),
    )


def test_a_verdict_from_files_is_that_from_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(missions, "MISSION_SETTINGS", MissionSettings(chunk=8))
    near = verified(tmp_path / "near")
    assert near.flown.stored is None
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(flown_missions, "STORE_SETTINGS", StoreSettings(in_memory=20, counted=12))
    far = verified(tmp_path / "far")
    assert far.flown.stored is not None
    (folder,) = (tmp_path / "temporary").iterdir()
    assert [path.name for path in sorted(folder.iterdir())] == [
        "000000.parquet",
        "000001.parquet",
        "000002.parquet",
    ]

    for name in ("verification.json", "worst_runs.json"):
        texts = [(tmp_path / run / name).read_text().partition('"time"')[0] for run in ("near", "far")]
        assert texts[0] == texts[1]
    tables = [pl.read_parquet(tmp_path / run / "missions.parquet") for run in ("near", "far")]
    assert tables[0].equals(tables[1], null_equal=True)
    assert tables[0].height == 60
    assert near.table().equals(far.table(), null_equal=True)
    assert far.flown.metrics["ending"].tolist() == near.flown.metrics["ending"].tolist()
    np.testing.assert_array_equal(far.flown.true_counts, near.flown.true_counts[:12])
    with pytest.raises(KeyError):
        far.flown.metrics["speed of light"]

    first, same = far.flown.first(25), near.flown.first(25)  # what other autopilots are compared on
    assert ASKED[0].judge(first.metrics).failures == ASKED[0].judge(same.metrics).failures

    del far, first
    gc.collect()
    assert not any((tmp_path / "temporary").iterdir())


def test_a_store_that_is_given_up_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(flown_missions, "STORE_SETTINGS", StoreSettings(in_memory=4))
    part = FlownMissions(
        np.arange(4), np.zeros(4, int), np.arange(4), {"duration_s": np.ones(4)}, {}, np.zeros((4, 2)),
        np.zeros((4, 2)), 1.0,
    )  # fmt: skip
    store = MissionStore()
    assert store.flown() is None
    store.append(part)
    assert len(list(tmp_path.iterdir())) == 1
    del store
    gc.collect()
    assert not any(tmp_path.iterdir())

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "gone"))
    with pytest.raises(SeatrialError, match=r"gone: the missions cannot be written there.*set TMPDIR"):
        MissionStore().append(part)
