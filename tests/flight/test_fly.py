"""`st.fly` and `st.fly_batch`: failures act when asked, seeds make the noise, batches equal singles."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial.base.errors import SeatrialError, SimulationError, VehicleError
from seatrial.flight.metrics import metrics_of
from seatrial.flight.sensor_channels import sensors_of
from seatrial.sensors.sensor import Sensor
from tests.flight.flying import BOX, CROSS, OUT, flown, grouped, mission


def noisy() -> dict[str, Sensor]:
    """The typical sensors of CWolf, in time."""
    found = sensors_of("typical", st.Vehicle.load("cwolf"))
    assert found is not None
    return {kind: replace(sensor, latency_s=0.0) for kind, sensor in found.items()}


def test_names_paths_and_objects_fly_alike(tmp_path: Path) -> None:
    (tmp_path / "box.toml").write_text(BOX)
    (tmp_path / "autopilot.toml").write_text(st.Autopilot.load("cwolf").to_toml())
    named = st.fly(
        "cwolf", tmp_path / "autopilot.toml", str(tmp_path / "box.toml"), water=st.Water(current=CROSS)
    )
    assert np.array_equal(named.position, flown().position)
    assert named.circumstances.sources["mission"] == str(tmp_path / "box.toml")


def test_the_start_is_that_of_the_mission_unless_a_state_is_given() -> None:
    text = OUT.replace("[start]\ndepth_m = 5.0", "[start]\nnorth_m = -10.0\neast_m = 5.0\ndepth_m = 5.0")
    flight = st.fly("cwolf", "cwolf", mission(text))
    assert flight.position[0].tolist() == [-10.0, 5.0, 5.0]
    assert flight.euler[0, 2] == pytest.approx(math.atan2(-5.0, 70.0))
    assert not flight.nu[0].any()
    state = st.State([-20.0, 0.0, 5.0], [0.0, 0.0, 0.5], [1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    moving = st.fly("cwolf", "cwolf", mission(OUT), conditions=st.Conditions(initial=state))
    assert moving.position[0].tolist() == [-20.0, 0.0, 5.0]
    assert moving.nu[0, 0] == 1.0
    assert moving.euler[0, 2] == pytest.approx(0.5)


def test_the_seed_decides_the_noise_and_nothing_else_does() -> None:
    one, again, other = (
        st.fly("cwolf", "cwolf", mission(OUT), conditions=st.Conditions(sensors=noisy()), seed=seed)
        for seed in (3, 3, 4)
    )
    assert np.array_equal(one.position, again.position)
    assert np.array_equal(one.measured["yaw"], again.measured["yaw"])
    assert not np.array_equal(one.measured["yaw"], other.measured["yaw"])
    assert flown(OUT, CROSS, seed=1).metrics == flown(OUT, CROSS, seed=2).metrics  # perfect sensors


def test_sensor_noise_has_the_size_that_the_file_says() -> None:
    sensors = noisy()
    flight = st.fly("cwolf", "cwolf", mission(BOX), conditions=st.Conditions(sensors=sensors), seed=1)
    off = np.rad2deg(flight.measured["q"] - flight.nu[:, 4])
    # 2,000 samples: the deviation is known to 1.6 %; digits of 0.001 deg/s add nothing.
    assert off.std() == pytest.approx(sensors["gyro"].noise, rel=0.08)
    assert flight.outcome == "complete"
    assert any("dead reckoning" in line for line in flight.sentences())


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_typical_sensors_do_not_stop_a_mission(seed: int) -> None:
    flight = st.fly(
        "cwolf",
        "cwolf",
        mission(BOX),
        conditions=st.Conditions(sensors="typical"),
        water=st.Water(current=CROSS),
        seed=seed,
    )
    assert flight.outcome == "complete", str(flight)
    assert flight.alerts == ()


def test_a_dead_actuator_stands_from_its_time_on() -> None:
    flight = st.fly(
        "cwolf", "cwolf", mission(BOX), conditions=st.Conditions(faults=[st.Fault("SbU", at_s=40.0)])
    )
    before, after = flight.t < 39.9, flight.t > 40.1
    assert np.abs(flight.actuators["SbU"][before]).max() > 100.0
    assert not flight.actuators["SbU"][after].any()
    whole = flown(BOX, (0.0, 0.0, 0.0))
    rows = int(np.sum(before))
    np.testing.assert_array_equal(flight.position[:rows], whole.position[:rows])
    assert "SbU is dead from 40 s on" in str(flight)


def test_a_stuck_actuator_stays_where_it_is_or_at_a_value() -> None:
    stuck = st.fly(
        "cwolf",
        "cwolf",
        mission(OUT),
        conditions=st.Conditions(faults=[st.Fault("PU", at_s=20.0, stuck=True)]),
    )
    held = stuck.actuators["PU"][stuck.t > 20.1]
    assert np.ptp(held) == 0.0
    assert held[0] == pytest.approx(stuck.actuators["PU"][stuck.t < 20.0][-1], abs=40.0)  # of one period
    at = st.fly(
        "cwolf",
        "cwolf",
        mission(OUT),
        conditions=st.Conditions(faults=[st.Fault("PU", at_s=20.0, stuck_at=-300.0)]),
    )
    assert np.all(at.actuators["PU"][at.t > 20.1] == -300.0)


@pytest.mark.parametrize("what", ["position", "gps"])
def test_an_outage_keeps_the_last_sample_and_calls_for_its_reaction(what: str) -> None:
    flight = st.fly(
        "cwolf", "cwolf", mission(BOX), conditions=st.Conditions(outages=[st.Outage(what, from_s=20.0)])
    )
    silent = flight.t >= 20.0
    assert np.ptp(flight.measured["x"][silent]) == 0.0
    assert np.ptp(flight.measured["z"][silent]) > 1.0
    assert flight.outcome == "surfaced"
    (alert,) = flight.alerts
    assert (alert.reaction, alert.cause) == ("surface", "stale_position")
    # The safety of the built-in autopilot waits 60 s.
    assert alert.t_s == pytest.approx(80.0, abs=0.2)


def test_an_outage_that_ends_is_survived() -> None:
    flight = st.fly(
        "cwolf", "cwolf", mission(BOX), conditions=st.Conditions(outages=[st.Outage("position", 20.0, 30.0)])
    )
    assert flight.outcome == "complete"
    assert flight.alerts == ()
    assert not np.array_equal(flight.position, flown(BOX, (0.0, 0.0, 0.0)).position)


def test_the_model_of_the_autopilot_may_be_another_vehicle() -> None:
    cwolf = st.Vehicle.load("cwolf")
    heavy = cwolf.with_coefficients({"X_uu": 1.5 * cwolf.coefficients()["X_uu"]})
    flight = st.fly(heavy, "cwolf", mission(OUT), conditions=st.Conditions(model=cwolf))
    own = st.fly(heavy, "cwolf", mission(OUT))
    assert flight.outcome == own.outcome == "complete"
    # On the way up to speed the feed-forward of the lighter model asks for less.
    soon = int(2.0 / flight.period_s)
    assert flight.demanded[soon, 0] < own.demanded[soon, 0] - 0.1
    named = st.fly(heavy, "cwolf", mission(OUT), conditions=st.Conditions(model=heavy))
    assert np.array_equal(named.position, own.position)


def test_a_bottom_is_seen_from_above() -> None:
    flight = st.fly("cwolf", "cwolf", mission(OUT), water=st.Water(seabed=(30.0, 0.1, 0.0)))
    np.testing.assert_allclose(
        flight.altitude, 30.0 + 0.1 * flight.position[:, 0] - flight.position[:, 2], atol=1e-9
    )
    assert flight.metrics["altitude_smallest_m"] == pytest.approx(flight.altitude.min())


def test_law_a_case_of_a_batch_flies_as_it_would_alone() -> None:
    cwolf = st.Vehicle.load("cwolf")
    drag = cwolf.coefficients()["X_uu"] * np.array([0.8, 1.0, 1.3])
    lookahead = np.array([8.0, 10.0, 15.0])
    current = np.array([[0.0, 0.3, 0.0], [0.1, 0.0, 0.0], [0.0, -0.2, 0.0]])
    faults = [[], [st.Fault("SbL", at_s=20.0)], []]
    batch = st.fly_batch(
        cwolf,
        "cwolf",
        mission(OUT),
        coefficients={"X_uu": drag},
        gains={"guidance.lookahead_m": lookahead},
        water=st.Water(current=current),
        seeds=[5, 6, 7],
        conditions=st.Conditions(faults=faults, sensors=noisy()),
        logs=True,
    )
    assert len(batch) == 3
    figures = metrics_of(batch)
    autopilot = st.Autopilot.load("cwolf")
    for k in range(3):
        alone = st.fly(
            cwolf.with_coefficients({"X_uu": drag[k]}),
            autopilot.with_gains({"guidance.lookahead_m": lookahead[k]}),
            mission(OUT),
            conditions=st.Conditions(model=cwolf, faults=faults[k], sensors=noisy()),
            water=st.Water(current=current[k]),
            seed=5 + k,
        )
        # Lanes have elementary functions of their own, equal to 2 units in the last place.
        assert figures["duration_s"][k] == pytest.approx(alone.metrics["duration_s"], abs=1e-6)
        for name in ("distance_m", "energy_wh", "cross_track_rms_m", "depth_excursion_m"):
            assert figures[name][k] == pytest.approx(alone.metrics[name], rel=1e-6, abs=1e-9), (k, name)
        log = batch.log(k)
        np.testing.assert_allclose(log[:, batch.columns.index("y")], alone.position[:, 1], atol=1e-6)


def test_a_batch_without_logs_keeps_figures_only() -> None:
    batch = st.fly_batch(
        "cwolf", "cwolf", mission(OUT), seeds=range(4), conditions=st.Conditions(sensors=noisy())
    )
    assert len(batch) == 4
    assert batch.log(0).shape[0] == 0
    assert len(set(batch.figures["distance"].tolist())) == 4
    same = st.fly_batch("cwolf", "cwolf", mission(OUT), gains={"guidance.lookahead_m": [10.0, 10.0]}, seeds=9)
    assert same.figures["distance"][0] == same.figures["distance"][1]


BAD: list[tuple[dict[str, Any], str]] = [
    ({"current": (0.0, math.nan, 0.0)}, "current: expected three finite numbers"),
    ({"current": (0.0, 0.3)}, "current: expected three finite numbers"),
    ({"faults": [st.Fault("SbX", 10.0)]}, 'has no actuator "SbX"; did you mean "SbU"'),
    ({"faults": [st.Fault("SbU", -1.0)]}, "SbU: expected a time within the flight"),
    ({"faults": [st.Fault("SbU", 1e6)]}, "SbU: expected a time within the flight"),
    ({"faults": [st.Fault("SbU", 1.0, stuck=True, stuck_at=1.0)]}, "give stuck or stuck_at, not both"),
    ({"faults": [st.Fault("SbU", 1.0, stuck_at=9e3)]}, "stuck_at: expected -2000 to 2000 rpm, found 9000"),
    ({"faults": [st.Fault("SbU", 1.0), st.Fault("SbU", 2.0)]}, "SbU fails twice"),
    ({"faults": ["SbU"]}, r"expected st\.Fault"),
    ({"outages": [st.Outage("positions", 1.0)]}, '"positions"; did you mean "position"'),
    ({"outages": [st.Outage("depth", 5.0, 4.0)]}, "depth: expected a beginning from 0 on and a later end"),
    ({"outages": ["depth"]}, r"expected st\.Outage"),
    ({"seed": -1}, "seed: expected a whole number"),
    ({"seed": 0.5}, "seed: expected a whole number"),
    ({"max_step_s": 0.0}, "max_step_s: expected a positive number in s"),
    ({"max_time_s": math.inf}, "max_time_s: expected a positive number in s"),
    ({"max_time_s": 1e9}, "max_time_s: expected at most 250000 s"),
    ({"rho": -1.0}, "rho: expected 500 to 2000 kg/m3"),
    ({"seabed": math.nan}, "seabed: expected its depth in m"),
    ({"seabed": 2.0}, "seabed: expected the start"),
    ({"initial": [0.0, 0.0, 0.0]}, r"initial: expected an st\.State"),
    (
        {"initial": st.State(position=[0.0, 0.0, -50.0])},
        "initial: expected a place in the water, .* 50 m above",
    ),
    ({"sensors": "typicall"}, "typicall"),
    ({"model": "nowhere.toml"}, "nowhere"),
]


@pytest.mark.parametrize(("options", "message"), BAD)
def test_bad_input_is_refused_with_a_sentence(options: dict[str, Any], message: str) -> None:
    with pytest.raises(SeatrialError, match=message):
        st.fly("cwolf", "cwolf", mission(OUT), **grouped(**options))


def test_files_that_do_not_fit_together_are_refused(tmp_path: Path) -> None:
    with pytest.raises(VehicleError, match="cwoolf"):
        st.fly("cwoolf", "cwolf", mission(OUT))
    with pytest.raises(VehicleError, match=r"none\.toml"):
        st.fly("cwolf", "cwolf", tmp_path / "none.toml")
    with pytest.raises(
        SimulationError, match=r"mission: expected an st\.Mission, a name or a path, found int"
    ):
        st.fly("cwolf", "cwolf", 3)  # type: ignore[arg-type]
    with pytest.raises(
        SimulationError, match=r"thrust of beluga \(thruster_0\) depends on the supply voltage"
    ):
        st.fly("beluga", "cwolf", mission(OUT))
    with pytest.raises(
        VehicleError, match="the loop heave needs the row Z, found X M N controllable on remus100"
    ):
        st.fly("remus100", "cwolf", mission(OUT))


def test_a_mission_along_the_bottom_needs_one() -> None:
    text = OUT.replace("east_m = 0.0\ndepth_m = 5.0", "east_m = 0.0\naltitude_m = 5.0")
    with pytest.raises(SimulationError, match=r"leg 1 \(waypoint 1\) of out follows the bottom"):
        st.fly("cwolf", "cwolf", mission(text))
    flight = st.fly("cwolf", "cwolf", mission(text), water=st.Water(seabed=12.0))
    assert flight.legs[0].reached
    assert flight.altitude[-1] == pytest.approx(5.0, abs=5.0)
    assert math.isnan(flight.legs[0].depth_step_m)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"seeds": [1, 2], "gains": {"guidance.lookahead_m": [5.0]}},
            "expected 2 values, one per case, found 1",
        ),
        ({"current": np.zeros((2, 2))}, "current: expected three finite numbers"),
        ({"current": [[math.nan, 0.0, 0.0]]}, "current: expected three finite numbers"),
        ({"seeds": []}, "expected at least one case"),
        ({"seeds": [1, -2]}, "seed: expected a whole number"),
        ({"faults": [[], [st.Fault("SbX", 1.0)]]}, 'no actuator "SbX"'),
        ({"gains": {"guidance.lookahed_m": [5.0, 6.0]}}, "lookahead_m"),
        ({"coefficients": {"X_uuu": [1.0]}}, "X_uu"),
    ],
)
def test_batches_refuse_what_does_not_fit_together(options: dict[str, Any], message: str) -> None:
    with pytest.raises(SeatrialError, match=message):
        st.fly_batch("cwolf", "cwolf", mission(OUT), **grouped(**options))
