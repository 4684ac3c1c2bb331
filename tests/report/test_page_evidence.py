"""Series of a page: every trial measured and simulated with its commands, in 16 bits a number."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
import pytest

import seatrial as st
from seatrial.base.report import Report
from seatrial.cli.new import EXAMPLES
from seatrial.report.page.evidence import TRIALS_FILE, evidence, packed
from seatrial.report.page.flying import setups
from seatrial.report.page.run_folder import RunFolder


def unpacked(series: dict[str, Any]) -> np.ndarray:
    whole = np.frombuffer(base64.b64decode(series["data"]), "<i2").astype(float)
    return np.where(whole == -32768, np.nan, series["least"] + (whole + 32500) * series["step"])


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e6])
def test_a_packed_series_is_right_to_a_65000th_of_its_range(scale: float) -> None:
    values = scale * np.array([np.nan, -3.0, 0.1, 7.0, np.inf])
    read = unpacked(packed(values))
    assert np.isnan(read[[0, 4]]).all()
    # Half a step of the range, and the rounding of the numbers themselves.
    assert np.abs(read[1:4] - values[1:4]).max() <= 0.5001 * 10.0 * scale / 65000
    assert unpacked(packed(np.full(3, 4.0))).tolist() == [4.0, 4.0, 4.0]
    assert np.isnan(unpacked(packed(np.full(2, np.nan)))).all()


def test_trials_are_drawn_with_their_commands_and_what_was_held_out(tmp_path: Path) -> None:
    n = 4000
    t = 0.1 * np.arange(n)
    yaw = np.remainder(0.05 * t + np.pi, 2.0 * np.pi) - np.pi
    table = pl.DataFrame({
        "trial": ["turn"] * n,
        "t_s": t,
        "held_out": t >= 300.0,
        "restart": np.arange(n) % 100 == 0,
        "measured.u": np.sin(t),
        "simulated.u": np.sin(t) + 0.01,
        "measured.yaw": yaw,
        "simulated.yaw": yaw,
        "cmd.SbU": np.where(t > 10.0, 500.0, 0.0),
        "cmd.SbL": np.where(t > 10.0, 500.0, 0.0),
        "cmd.VTB": np.zeros(n),
        "cmd.other": [None] * n,
    })
    table.write_parquet(tmp_path / TRIALS_FILE)
    zigzag = {"label": "zigzag, 10 to 90 s", "from": 10.0, "to": 90.0}
    (tmp_path / "manoeuvres.json").write_text(json.dumps({"turn": [zigzag], "other": []}))
    run = RunFolder("turn", {"kind": "identification"}, Report("a", "b", "c", "d", "e"), path=tmp_path)
    (group,) = evidence(run)
    assert "turn" in group["title"]
    assert [panel["name"] for panel in group["panels"]] == [
        "surge u", "yaw", "command SbU, SbL", "command VTB",
    ]  # fmt: skip
    assert group["shade"] == [[pytest.approx(300.0), pytest.approx(t[-1])]]
    assert group["windows"] == [zigzag]
    times = unpacked(group["t"])
    assert len(times) <= 1500
    assert times[-1] > 399.0
    heading = unpacked(group["panels"][1]["lines"][0]["y"])
    assert np.abs(np.diff(heading)).max() < 1.0  # degrees a sample: no jump where the circle closes
    error = np.subtract(*(unpacked(line["y"]) for line in group["panels"][0]["lines"]))
    assert np.nanmax(np.abs(error + 0.01)) < 1e-4


def test_steps_have_the_size_and_the_corridor_of_the_campaign(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text('{"kind": "tuning"}')
    (tmp_path / "summary.txt").write_text("cwolf: tuned. Good.\nWorst: nothing\nNext: verify\n")
    for name, text in (
        ("campaign.toml", (EXAMPLES / "cwolf" / "campaign.toml").read_text()),
        ("vehicle.toml", st.Vehicle.load("cwolf").to_toml()),
    ):
        (tmp_path / name).write_text(text)
    found, said = setups([RunFolder.read(tmp_path)])
    assert said == []
    steps = {one["set_point"]: one for one in found[0]["steps"]}
    assert list(steps) == ["heading", "speed", "depth", "pitch"]
    heading = steps["heading"]
    assert heading["step"] == pytest.approx(np.radians(20.0))
    t, lower, upper = (heading["corridor"][key] for key in ("t", "lower", "upper"))
    assert t[-1] == 25.0
    # The figures of the campaign: 90 % after 8 s, at most 25 % beyond, within 8 % from 18 s on.
    assert [lower[t.index(at)] for at in (5.0, 10.0, 20.0)] == pytest.approx([-0.1, 0.9, 0.92])
    assert [upper[t.index(at)] for at in (5.0, 10.0, 20.0)] == pytest.approx([1.25, 1.25, 1.08])


def test_a_run_without_trials_or_folder_has_no_series(tmp_path: Path) -> None:
    told = SimpleNamespace(path=None)
    assert evidence(told) == []  # type: ignore[arg-type]
    run = RunFolder("a", {"kind": "identification"}, Report("a", "b", "c", "d", "e"), path=tmp_path)
    assert evidence(run) == []
