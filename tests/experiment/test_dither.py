"""A dither that is sized on a dominated mission lets the same mission tell the axis; its table is checked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

import seatrial as st
from seatrial._core import Vehicle
from seatrial.base.errors import CampaignError, TrialError
from seatrial.experiment.dither import Dither, dithers
from seatrial.inspect.verdict import Verdict, judge_trial
from seatrial.trial.generated import Recipe, files_of
from seatrial.trial.trial import Trial
from seatrial.trial.truth import DITHER, read_dither

VEHICLE = st.Vehicle.load("remus100")

TRUTH = """format = 1
vehicle = "remus100"
description = "a torpedo"
[sensors.dvl]
noise_m_s = 0.01
[sensors.gyro]
noise_deg_s = 0.05
[sensors.attitude]
noise_deg = 0.1
[sensors.depth]
noise_m = 0.01
"""

MISSION = """format = 1
name = "straight"
speed_m_s = 1.5
acceptance_radius_m = 5.0
[start]
depth_m = 8.0
[[legs]]
north_m = 9000.0
east_m = 0.0
depth_m = 8.0
"""

RECIPE = """format = 1
description = "straight ahead through waves"
truth = "truth.toml"
seed = 1
duration_s = 300.0
[sailed]
autopilot = "remus100"
mission = "mission.toml"
[waves]
height_m = 0.5
period_s = 6.0
toward_deg = 60.0
"""


def mission(folder: Path, dither: str = "") -> Path:
    (folder / "truth.toml").write_text(TRUTH)
    (folder / "mission.toml").write_text(MISSION)
    path = folder / "field.toml"
    text = RECIPE
    if dither:  # with the time that the plan asks for
        text = text.replace("[waves]", f'dither = "{dither}"\n[waves]').replace("300.0", "600.0")
    path.write_text(text)
    return path


def of_lauv(folder: Path) -> tuple[Vehicle, Trial, dict[str, Verdict]]:
    """The same mission of another vehicle, its trial and what it tells."""
    path = mission(folder)
    for file in (path, folder / "truth.toml"):
        file.write_text(file.read_text().replace("remus100", "lauv"))
    vehicle = st.Vehicle.load("lauv")
    plain = Trial.read(Recipe.load(path).table(), align=False, name="plain")
    return vehicle, plain, judge_trial(plain, vehicle)


def some(**changes: float) -> Dither:
    given = {
        "hold_s": 6.0,
        "begin_s": 60.0,
        "duration_s": 1200.0,
        "wave_period_s": 6.0,
        "deviation": 0.02,
        "share_before": 0.0,
        "share": 0.5,
        "wanted": 0.05,
    }
    return Dither(
        axis="N", amplitude={"rudder_upper": -0.1}, units={"rudder_upper": "rad"}, **(given | changes)
    )


def test_the_mission_with_the_planned_dither_tells_the_axis_in_another_sea(tmp_path: Path) -> None:
    plain = Trial.read(Recipe.load(mission(tmp_path)).table(), align=False, name="plain")
    verdicts = judge_trial(plain, VEHICLE)
    assert verdicts["N"].dominated
    planned = {dither.axis: dither for dither in dithers([plain], VEHICLE, verdicts)}
    assert "K" not in planned  # every actuator that heels it serves another axis
    yaw = planned["N"]
    assert yaw.tells
    assert max(map(abs, yaw.amplitude.values())) < 0.2374
    (tmp_path / yaw.file_name).write_text(yaw.csv())
    recipe = mission(tmp_path, yaw.file_name)
    assert yaw.file_name in {path.name for path in files_of(recipe)}
    made = Recipe.load(recipe).with_seed(5)
    log = made.table()
    told = judge_trial(Trial.read(log, align=False, name="told"), VEHICLE)["N"]
    assert told.kind == "closed and informative"
    assert verdicts["N"].told + 0.2 < told.told < yaw.share + 0.1
    added = log[f"{DITHER}rudder_upper"].to_numpy()
    assert not added[:600].any()
    assert set(np.round(np.abs(added[700:]), 6)) == {round(abs(yaw.amplitude["rudder_upper"]), 6)}


def test_a_sequence_adds_nothing_at_the_waves() -> None:
    table = some().table()
    t = np.arange(60.0, 1260.0, 0.5)
    row = np.searchsorted(table["t_s"].to_numpy(), t, side="right") - 1
    y = table[f"{DITHER}rudder_upper"].to_numpy()[row]
    power = np.abs(np.fft.rfft(y - y.mean())) ** 2
    f = np.fft.rfftfreq(len(y), 0.5)
    near = (f > 0.95 / 6.0) & (f < 1.05 / 6.0)
    assert power[near].sum() < 0.005 * power.sum()
    assert power[f < 1.0 / 6.0].sum() > 0.85 * power.sum()
    assert abs(y.mean()) < 0.02  # of 0.1 rad: the depth and heading loops are not pushed aside
    assert table["t_s"][-1] == 1260.0
    assert y[-1] != 0.0
    assert table[f"{DITHER}rudder_upper"][-1] == 0.0


def test_what_cannot_be_reached_is_said() -> None:
    assert "go faster, deeper or into a calmer sea" in some(share=0.1).sentence
    assert "rudder_upper ±5.7 deg" in some().sentence
    assert "calmer" not in some().sentence


def test_a_deviation_that_is_none_is_refused() -> None:
    with pytest.raises(CampaignError, match="deviation: expected a share between 0 and 1, found 0"):
        dithers([], VEHICLE, {}, deviation=0.0)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"t_s": [0.0], "dither.ruder_upper": [0.1]}, 'unknown column "dither.ruder_upper".*rudder_upper'),
        ({"t_s": [0.0, 0.0], "dither.rudder_upper": [0.1, 0.0]}, "row 2: expected a t_s above"),
        ({"t_s": [0.0], "dither.rudder_upper": [0.5]}, "expected at most 0.2374 rad.*found 0.5"),
        ({"t_s": [0.0, 1.0], "dither.rudder_upper": [0.1, None]}, "expected finite numbers; fill the gaps"),
        ({"t_s": [0.0]}, "expected columns t_s and dither.ACTUATOR"),
    ],
)
def test_a_table_that_cannot_be_added_is_refused(
    tmp_path: Path, columns: dict[str, list[float | None]], message: str
) -> None:
    path = tmp_path / "dither.csv"
    pl.DataFrame(columns).write_csv(path)
    with pytest.raises(TrialError, match=message):
        read_dither(path, VEHICLE, "field.toml: sailed, key dither")
    with pytest.raises(TrialError, match=r"field.toml: sailed, key dither: .*none.csv cannot be read"):
        read_dither(tmp_path / "none.csv", VEHICLE, "field.toml: sailed, key dither")


def test_an_axis_that_feedback_dominates_without_waves_gets_a_dither_by_its_own_motion(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("seatrial.inspect.verdict.waves", lambda trial: None)
    plain = Trial.read(Recipe.load(mission(tmp_path)).table(), align=False, name="plain")
    verdicts = judge_trial(plain, VEHICLE)
    assert verdicts["N"].dominated
    planned = {dither.axis: dither for dither in dithers([plain], VEHICLE, verdicts)}["N"]
    assert 2.0 < planned.hold_s < 60.0
    assert np.isnan(planned.wave_period_s)
    assert "waves'" not in planned.sentence
    assert "waves'" in some().sentence


def test_a_propeller_that_only_runs_ahead_has_what_lies_between_its_speed_and_the_ends(
    tmp_path: Path,
) -> None:
    """Its limit astern is zero: the dither was one of nothing, and not a number."""
    vehicle, plain, verdicts = of_lauv(tmp_path)
    limits = vehicle.actuator_info()["propeller"]
    assert limits["maximum_astern"] == 0.0
    assert verdicts["X"].dominated
    planned = {dither.axis: dither for dither in dithers([plain], vehicle, verdicts)}["X"]
    middle = float(np.median(plain.commands["propeller"]))
    room = min(middle, limits["maximum_ahead"] - middle)
    assert 0.5 * room < planned.amplitude["propeller"] <= room
    assert np.isfinite([planned.deviation, planned.share, planned.hold_s]).all()


def test_a_vehicle_that_waves_hardly_move_gets_less_than_its_actuators_have(tmp_path: Path) -> None:
    """All that its planes have would throw it out of the water."""
    vehicle, plain, verdicts = of_lauv(tmp_path)
    pitch = {dither.axis: dither for dither in dithers([plain], vehicle, verdicts)}["M"]
    most = vehicle.actuator_info()["stern_plane_port"]["maximum_ahead"]
    assert max(map(abs, pitch.amplitude.values())) < 0.2 * most
    assert pitch.share > 0.99  # a tenth of what they have, or odds of a thousand
    assert pitch.tells
