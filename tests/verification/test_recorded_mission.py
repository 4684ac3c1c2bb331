"""Logs of missions: reading, metrics under the names of flights, envelope, set-point steps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import seatrial as st
from seatrial.base.errors import CampaignError, SimulationError, TrialError
from seatrial.control_design.corridor import Corridor
from seatrial.verification.mission_log.log import (
    SETTINGS,
    MissionLog,
    errors_of_guidance,
    log_metrics,
    logged_steps,
)
from seatrial.verification.mission_log.verdict import mission_envelope, prediction_band
from tests.verification.recorded_logs import MISSION, fitted, flight, log


def test_a_run_directory_of_fly_is_read_by_what_was_measured(tmp_path: Path) -> None:
    folder = flight(2).save(tmp_path / "run")
    read = MissionLog.read(folder)
    assert read.trial.name == "run"
    told = flight(2).measured["u"]
    assert np.allclose(read.trial.channel("u")[50:60], told[50:60], atol=0.02)  # latency is removed
    assert {"cross_track", "leg", "speed", "energy_wh"} <= set(read.beside)
    with pytest.raises(TrialError, match=r"expected flight\.parquet"):
        MissionLog.read(tmp_path)


def test_figures_of_a_log_are_those_of_its_flight() -> None:
    # At a corner a row more or less counts as settled: some tenths of a percent of the rms.
    metrics, flown = log_metrics(log(2), MISSION, fitted().vehicle), flight(2).metrics
    for name in (
        "duration_s",
        "energy_wh",
        "cross_track_rms_m",
        "cross_track_largest_m",
        "switches_per_minute",
    ):
        assert metrics[name] == pytest.approx(flown[name], rel=0.01), name
    # The log has 10 samples a second and measured positions, the core's bins are some percent wide.
    for name in ("cross_track_p50_m", "cross_track_p95_m", "vertical_p95_m"):
        assert metrics[name] == pytest.approx(flown[name], rel=0.1, abs=0.02), name
    assert metrics["distance_m"] == pytest.approx(flown["distance_m"], rel=0.02)
    assert metrics["ending"] == "complete"
    assert metrics["waypoints_behind"] == 3


def test_errors_of_guidance_follow_from_positions_where_they_were_not_logged() -> None:
    bare = MissionLog.of(log(2).trial)
    derived, told = errors_of_guidance(bare, MISSION), log(2).beside
    rows = slice(100, 1300, 10)
    # Guidance steers onto the next leg on an arc of its own; away from the corners both are the same line.
    apart = np.abs(derived["cross_track"] - told["cross_track"])[rows]
    assert np.median(apart) < 0.1
    assert log_metrics(bare, MISSION)["waypoints_behind"] == 3


def test_the_envelope_holds_the_log_of_the_same_vehicle_and_not_that_of_a_heavier_one() -> None:
    pilot = st.Autopilot.load("cwolf")
    same = mission_envelope(fitted(), log(2), pilot, MISSION, flights=40, sensors="typical")
    assert set(same.bands) == {"depth", "speed", "pitch", "cross_track", "heading"}
    # 5 % on average; of one flight in five quantities up to a quarter, since all its samples hang together.
    assert all(band.outside < 0.25 for band in same.bands.values())
    heavy = log(2, (("B", fitted().vehicle.coefficients()["B"] - 40.0),))
    other = mission_envelope(fitted(), heavy, pilot, MISSION, flights=40, sensors="typical")
    assert other.bands["pitch"].outside > 0.5
    with pytest.raises(SimulationError, match="at least 39"):
        mission_envelope(fitted(), log(2), pilot, MISSION, flights=38)


def test_steps_of_logged_set_points_are_held_against_corridors() -> None:
    t = np.arange(0.0, 80.0, 0.1)
    wanted = np.where(t < 20.0, 0.5, 1.5)
    since = np.maximum(t - 20.0, 0.0)
    done = 0.5 + (1.0 - np.exp(-since / 2.0))
    read = MissionLog.read({"t_s": t, "u_m_s": done, "desired.speed_m_s": wanted}, name="steps")
    wide = Corridor.from_figures(rise_s=6.0, overshoot=0.1, settling_s=10.0, until_s=20.0)
    tight = Corridor.from_figures(rise_s=2.0, overshoot=0.1, settling_s=10.0, until_s=20.0)
    (step,) = logged_steps(read, {"surge": wide})
    assert step.at_s == pytest.approx(20.0)
    assert (step.before, step.after) == (0.5, 1.5)
    assert step.criterion == 0.0
    assert logged_steps(read, {"surge": tight})[0].criterion > 0.1
    assert logged_steps(read, {"heading": wide}) == ()
    with pytest.raises(CampaignError, match='no loop "surg"; did you mean'):
        logged_steps(read, {"surg": wide})


def test_a_set_point_that_is_ramped_is_a_step_from_where_the_ramp_begins() -> None:
    t = np.arange(0.0, 80.0, 0.1)
    wanted = np.clip(0.5 + 0.4 * (t - 20.0), 0.5, 1.5)
    noise = 0.02 * np.random.default_rng(3).standard_normal(len(t))
    done = 0.5 + 0.1 * np.convolve(wanted - 0.5, np.exp(-t / 2.0) / 2.0)[: len(t)] + noise
    read = MissionLog.read({"t_s": t, "u_m_s": done, "desired.speed_m_s": wanted}, name="ramp", align=False)
    wide = Corridor.from_figures(rise_s=8.0, overshoot=0.1, settling_s=14.0, settled=0.1, until_s=20.0)
    (step,) = logged_steps(read, {"surge": wide})
    assert step.at_s == pytest.approx(20.1, abs=0.11)
    assert (step.before, step.after) == pytest.approx((0.5, 1.5))
    assert step.criterion == 0.0
    # A set point that wanders is no step.
    wandering = {"t_s": t, "u_m_s": done, "desired.speed_m_s": 1.0 + 0.5 * np.sin(0.2 * t)}
    assert logged_steps(MissionLog.read(wandering, align=False), {"surge": wide}) == ()


@pytest.mark.long
def test_law_a_further_flight_falls_into_the_band_as_often_as_it_says() -> None:
    rng = np.random.default_rng(4)
    for flights in (SETTINGS.fewest_flights, 64):
        lower, _, upper = prediction_band(rng.standard_normal((flights, 20_000)))
        further = rng.standard_normal(20_000)
        # Four standard deviations of a share of 20,000 at 95 %.
        assert np.mean((lower <= further) & (further <= upper)) == pytest.approx(0.95, abs=0.0062)
