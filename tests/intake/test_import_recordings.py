"""Import of the recordings: what is proposed for each, and that the drafted campaigns are ready."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import seatrial as st
from seatrial.base.frames import from_euler, matrix
from seatrial.campaign.campaign import Campaign
from seatrial.check.campaign import check_campaign
from seatrial.logs import open_log

DATA = Path(os.environ.get("SEATRIAL_DATA", "/nonexistent"))
TORPEDO = [DATA / "field_torpedo" / f"{name}.csv" for name in ("attitude", "depth", "dvl", "fins")]


def _needs(*paths: Path) -> None:
    if not all(path.exists() for path in paths):
        pytest.skip(f"{paths[0].name} is not in SEATRIAL_DATA")


@pytest.fixture(scope="module")
def bluerov(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, st.Imported]:
    path = DATA / "bluerov2_heavy" / "00000029_filtered.BIN"
    _needs(path)
    pytest.importorskip("pymavlink")
    folder = tmp_path_factory.mktemp("bluerov") / "project"
    return folder, st.import_logs(path, out=folder)


def test_bluerov_velocities_agree_with_the_filter_of_the_autopilot(bluerov: tuple[Path, st.Imported]) -> None:
    trial = bluerov[1].trials[0].trial
    log = open_log(DATA / "bluerov2_heavy" / "00000029_filtered.BIN")
    fields = ("VN", "VE", "VD", "Roll", "Pitch", "Yaw")
    ekf = log.read({"XKF1[0]": fields})["XKF1[0]"]
    earth = np.stack([ekf.fields[name] for name in fields[:3]], axis=1)
    angles = np.deg2rad(np.stack([ekf.fields[name] for name in fields[3:]], axis=1))
    body = np.einsum("nji,nj->ni", matrix(from_euler(angles)), earth)
    for k, channel in ((0, "u"), (2, "w")):
        good = trial.valid[:, k]
        filtered = np.interp(trial.t[good], ekf.t, body[:, k])
        assert np.corrcoef(filtered, trial.channel(channel)[good])[0, 1] > 0.9, channel


def test_bluerov_masks_few_samples_of_its_irregular_doppler_log(bluerov: tuple[Path, st.Imported]) -> None:
    trial = bluerov[1].trials[0].trial
    assert trial.valid[:, 0].mean() > 0.95  # 13 % were masked with the median interval


@pytest.mark.long
@pytest.mark.parametrize(
    "names",
    [
        *[(f"beluga/synchronized-{run}-1.csv",) for run in ("heave", "random", "surge", "sway", "yaw")],
        ("bluerov2_heavy/00000029_filtered.BIN",),
        ("ardusub_small/small.BIN",),
        ("ardusub_small/small.tlog",),
        tuple(f"field_torpedo/{name}.csv" for name in ("attitude", "depth", "dvl", "fins")),
        ("samples_ulog/sample_log_small.ulg",),
    ],
)
def test_no_unit_changes_within_a_recording(names: tuple[str, ...]) -> None:
    paths = [DATA / name for name in names]
    _needs(*paths)
    for module in ("pymavlink", "pyulog"):
        pytest.importorskip(module)
    found = [one for trial in st.import_logs(paths).trials for one in trial.trial.report.findings]
    assert not [one for one in found if "the unit changes" in one.message]
    # Only Beluga's positions, and those of aircraft, count upwards.
    upwards = any("above the surface" in one.message for one in found)
    assert upwards == names[0].startswith(("beluga", "samples_ulog"))


def test_bluerov_campaign_is_ready_and_thrusters_turn_as_the_data_say(
    bluerov: tuple[Path, st.Imported],
) -> None:
    folder, made = bluerov
    # As MOT_n_DIRECTION of the same frame in ardusub_small/small.tlog, which this log does not carry.
    assert made.reversed_thrusters == ("thruster_3", "thruster_4", "thruster_6", "thruster_7")
    assert [mode for _, mode in made.trials[0].modes][:3] == ["SURFTRAK", "GUIDED", "ALT_HOLD"]
    held = made.trials[0].hold_out_s
    assert held is not None
    assert held[0] == pytest.approx(732.3)  # the change of mode nearest to the proposed part
    assert made.trials[0].why.startswith(f"hold out {held[0]:g} to {held[1]:g} s")
    check = check_campaign(Campaign.load(folder / "campaign.toml"))
    assert check.problems == ()
    assert {stage.free for stage in check.stages} == {"X", "Y", "Z", "N"}


@pytest.mark.long
def test_torpedo_files_make_one_trial_with_units_clock_and_what_is_missing(tmp_path: Path) -> None:
    _needs(*TORPEDO)
    vehicle = DATA / "field_torpedo" / "vehicle.toml"
    made = st.import_logs(TORPEDO, vehicle=vehicle, out=tmp_path / "p")
    trial = made.trials[0].trial
    assert made.columns["u_m_s"].unit == "mm/s"
    assert 1.0 < float(np.median(trial.channel("u"))) < 3.0
    assert made.unmatched == ()
    assert trial.valid[:, [0, 8, 11]].mean(axis=0).min() > 0.9
    said = " ".join(made.trials[0].consistency.missing)
    assert "no roll" in said
    assert "no p q r" in said
    check = check_campaign(Campaign.load(tmp_path / "p" / "campaign.toml"))
    assert check.problems == ()
    assert "K" not in "".join(stage.free for stage in check.stages)


def test_aerial_log_says_that_it_is_no_underwater_vehicle() -> None:
    path = DATA / "samples_ulog" / "sample_log_small.ulg"
    _needs(path)
    pytest.importorskip("pyulog")
    made = st.import_logs(path)
    assert "no log of an underwater vehicle" in made.report().worst
    assert {"roll", "pitch", "yaw", "p"} <= set(made.trials[0].trial.channels)
