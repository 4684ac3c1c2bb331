"""What is said of a flight: figures against its log, legs, loops, actuators, table, words."""

from __future__ import annotations

import json
import math
import tomllib
from typing import Any

import numpy as np
import pytest
import tomlkit
from hypothesis import given
from hypothesis import strategies as st_
from numpy.typing import NDArray

import seatrial as st
from seatrial._core import error_edges
from seatrial.base.run import to_json
from seatrial.control_design.start_autopilot import start_autopilot
from seatrial.flight.metrics import quantile, true_vertical
from seatrial.sensors.sensor import Sensor
from tests.flight.flying import BOX, OUT, STATION, flown

Array = NDArray[np.float64]


def from_log(flight: st.Flight) -> dict[str, float]:
    """The figures of the core again, from the log and the mission alone."""
    waypoints, start = flight.mission.waypoints, flight.mission.start
    places = np.stack([waypoints[name] for name in ("north_m", "east_m", "depth_m")], axis=1)
    ends = np.vstack([[start["north_m"], start["east_m"], start["depth_m"]], places])
    leg, t, z = flight.leg, flight.t, flight.position[:, 2]
    half = 0.5 * np.hypot(*(np.diff(ends[:, :2], axis=0)).T)[leg]
    going = (flight.alert == 0) & ~flight.done
    settled = going & ~flight.holding & (flight.distance < half)
    upper, lower = np.minimum(ends[:-1, 2], ends[1:, 2])[leg], np.maximum(ends[:-1, 2], ends[1:, 2])[leg]
    courses = np.diff(ends[:, :2], axis=0)
    turning = np.sum((flight.position[:, :2] - ends[leg, :2]) * courses[leg], axis=1) < 0.0
    upper = np.where(turning, np.minimum(upper, ends[np.maximum(leg - 1, 0), 2]), upper)
    lower = np.where(turning, np.maximum(lower, ends[np.maximum(leg - 1, 0), 2]), lower)
    out = np.maximum(np.maximum(z - lower, upper - z), 0.0)
    across, below = flight.errors["cross_track"][settled], flight.errors["vertical"][settled]
    runs = np.stack(list(flight.commands.values()), axis=1) != 0.0
    changes = np.abs(np.diff(runs.astype(int), axis=0)).sum()
    closest = []
    for k in range(len(places)):
        rows = np.flatnonzero((leg == k) & ~flight.done)
        if flight.route.stops[k].task == "pass" and k + 1 < len(places):  # the turn begins before it
            rows = np.append(rows, np.flatnonzero((leg == k + 1) & ~flight.done))
        rows = np.append(rows, min(rows[-1] + 1, len(t) - 1))  # where the waypoint was seen to be reached
        closest.append(np.linalg.norm(flight.position[rows] - places[k], axis=1).min())
    return {
        "duration_s": t[-1],
        "distance_m": np.linalg.norm(np.diff(flight.position, axis=0), axis=1).sum(),
        "energy_wh": flight.power[:-1].sum() * flight.period_s / 3600.0,
        "cross_track_largest_m": np.abs(across).max(),
        "cross_track_rms_m": math.sqrt(np.mean(across**2)),
        "vertical_largest_m": np.abs(below).max(),
        "vertical_rms_m": math.sqrt(np.mean(below**2)),
        "depth_excursion_m": out[going].max(),
        "depth_largest_m": z.max(),
        "waypoints_behind": float(leg[-1] + flight.done[-1]),
        "missed_by_m": max(closest),
        "switches_per_minute": changes / (t[-1] / 60.0 * runs.shape[1]),
        "roll_largest_deg": np.rad2deg(np.abs(flight.euler[:, 0]).max()),
        "pitch_largest_deg": np.rad2deg(np.abs(flight.euler[:, 1]).max()),
    }


def test_figures_of_the_core_are_those_of_the_log() -> None:
    flight = flown()
    for name, value in from_log(flight).items():
        # The same sums in another order.
        assert flight.metrics[name] == pytest.approx(value, rel=1e-9, abs=1e-12), name
    assert flight.energy_wh[-1] == pytest.approx(flight.metrics["energy_wh"], rel=1e-9)


def settled(flight: st.Flight) -> NDArray[np.bool_]:
    """Rows on the second half of their leg, where errors count."""
    start, waypoints = flight.mission.start, flight.mission.waypoints
    north, east = (np.append(start[name], waypoints[name]) for name in ("north_m", "east_m"))
    half = 0.5 * np.hypot(np.diff(north), np.diff(east))[flight.leg]
    rows: NDArray[np.bool_] = ~flight.holding & ~flight.done & (flight.alert == 0) & (flight.distance < half)
    return rows


@pytest.mark.parametrize("current", [(0.0, 0.3, 0.0), (0.2, -0.1, 0.0)])
def test_quantiles_of_the_core_are_those_of_the_log(current: tuple[float, float, float]) -> None:
    flight = flown(BOX.replace("5.0\n[[legs", "5.0\n[start]\ndepth_m = 5.0\n[[legs", 1), current)
    rows = settled(flight)
    for error in ("cross_track", "vertical"):
        size = np.abs(flight.errors[error][rows])
        for share in (50, 95, 99):
            found = flight.metrics[f"{error}_p{share}_m"]
            # Log-linear between thresholds that are 26 % apart: up to three per cent off, beside one sample
            # in two hundred.
            near = np.quantile(size, np.clip(share / 100.0 + np.array([-0.005, 0.0, 0.005]), 0.0, 1.0))
            assert 0.97 * near[0] <= found <= 1.03 * near[2], (error, share)
        assert found <= flight.metrics[f"{error}_largest_m"]


@given(st_.integers(0, 2**32 - 1), st_.floats(0.02, 3.0), st_.floats(0.1, 1.0))
def test_law_a_quantile_of_counts_is_that_of_the_samples(seed: int, scale: float, spread: float) -> None:
    size = scale * np.exp(spread * np.random.default_rng(seed).standard_normal(4000))
    edges = np.asarray(error_edges())
    counts = np.concatenate([[len(size)], (size[:, None] > edges).sum(axis=0)])[None].astype(float)
    for share in (0.5, 0.95, 0.99):
        found = quantile(counts, share, largest=np.array([size.max()]))[0]
        exact = float(np.quantile(size, share))
        if edges[0] < exact < edges[-1]:
            # Never beyond the thresholds about it, which are 26 % apart; five per cent where the samples
            # spread over several of them, but for p99, above which there are only forty.
            assert exact / 1.26 <= found <= 1.26 * exact
            if spread > 0.5:
                assert found == pytest.approx(exact, rel=0.05 if share < 0.99 else 0.12)


def test_quantiles_of_errors_beyond_the_thresholds_are_bounded_by_the_largest() -> None:
    edges = np.asarray(error_edges())
    tiny = np.concatenate([[100.0], np.zeros(len(edges))])[None]
    assert quantile(tiny, 0.95, largest=np.array([1e-9]))[0] == 1e-9
    huge = np.concatenate([[100.0], np.full(len(edges), 100.0)])[None]
    assert edges[0] < quantile(huge, 0.95, largest=np.array([1e3]))[0] <= 1e3


def test_clearance_and_travel_of_the_core_are_those_of_the_log() -> None:
    rows = ((40.0, 12.0, 3.0), (100.0, 60.0, 1.5))
    flight = flown(BOX, obstacles=rows)
    away = flight.mission.core.clearance(flight.vehicle, flight.position, flight.euler, obstacles=list(rows))
    assert flight.metrics["clearance_m"] == pytest.approx(np.min(away[:, 0]), rel=1e-9)
    assert flight.metrics["clearance_time_s"] == flight.t[np.argmin(away[:, 0])]
    assert flight.metrics["depth_smallest_m"] == np.min(flight.position[:, 2])
    steepest = np.argmax(np.abs(flight.euler[:, 1]))
    assert flight.metrics["pitch_time_s"] == flight.t[steepest]
    info = flight.vehicle.actuator_info()
    span = {name: each["maximum_ahead"] + each["maximum_astern"] for name, each in info.items()}
    moved = [np.abs(np.diff(values)).sum() / span[name] for name, values in flight.commands.items()]
    assert flight.metrics["travel_per_s"] == pytest.approx(np.mean(moved) / flight.t[-1], rel=1e-9)


def test_a_flight_says_what_happened_row_by_row() -> None:
    flight = flown()
    n = len(flight.t)
    assert flight.t[1] - flight.t[0] == pytest.approx(flight.period_s)
    assert flight.position.shape == flight.euler.shape == (n, 3)
    assert flight.nu.shape == flight.demanded.shape == flight.achieved.shape == (n, 6)
    assert flight.modes == ("hover", "cruise")
    assert set(flight.commands) == set(flight.actuators) == set(flight.vehicle.actuators)
    assert flight.outcome == "complete"
    assert flight.complete
    # The water drifts east with 0.3 m/s: on the first leg, due north, that is what the hull does not feel.
    row = int(np.flatnonzero(flight.leg == 0)[-1])
    drift = flight.nu[row, :3] - flight.water[row]
    assert np.linalg.norm(drift) == pytest.approx(0.3, abs=1e-9)
    # Without sensor errors the autopilot is told the truth.
    assert np.array_equal(flight.measured["x"], flight.position[:, 0])
    assert np.array_equal(flight.measured["yaw"], flight.euler[:, 2])


def test_legs_are_reached_within_their_radius_and_their_errors_are_those_of_the_log() -> None:
    flight = flown()
    legs = flight.legs
    assert [leg.label for leg in legs] == ["waypoint 1", "waypoint 2", "waypoint 3"]
    assert all(leg.reached and leg.smallest_m <= leg.acceptance_m for leg in legs)
    assert max(leg.smallest_m for leg in legs) == pytest.approx(flight.metrics["missed_by_m"], abs=1e-9)
    largest = max(leg.cross_track_largest_m for leg in legs)
    assert largest == pytest.approx(flight.metrics["cross_track_largest_m"], rel=1e-12)
    assert sum(leg.time_s for leg in legs) == pytest.approx(flight.metrics["duration_s"], abs=1e-6)
    for leg in legs:
        assert sum(leg.modes.values()) == pytest.approx(1.0)


def test_depth_overshoot_counts_beyond_a_change_until_the_next_one() -> None:
    flight = flown()
    first, second, third = flight.legs
    assert first.depth_step_m == 10.0
    rows = (flight.leg <= 1) & ~flight.done
    beyond = max(0.0, flight.position[rows, 2].max() - 10.0)
    assert first.depth_overshoot_m == pytest.approx(beyond, abs=1e-12)
    assert first.depth_overshoot_percent == pytest.approx(10.0 * beyond, abs=1e-9)
    assert math.isnan(second.depth_overshoot_m)
    assert third.depth_step_m == -5.0


def test_station_keeping_is_judged_by_its_distance() -> None:
    flight = flown(STATION, (0.0, 0.1, 0.0))
    assert flight.outcome == "complete"
    (leg,) = flight.legs
    near = np.linalg.norm(flight.position - [40.0, 0.0, 5.0], axis=1) <= 3.0
    held = flight.holding & ~flight.done & (np.cumsum(near) > 0)
    away = np.linalg.norm(flight.position[held] - [40.0, 0.0, 5.0], axis=1)
    assert leg.task == "hold"
    assert leg.hold_largest_m == pytest.approx(away.max(), rel=1e-12)
    assert leg.hold_rms_m == pytest.approx(math.sqrt(np.mean(away**2)), rel=1e-12)
    assert flight.loiter_radius == 0.0
    assert any("Station was kept within" in line for line in flight.sentences())


def test_loops_count_only_while_they_are_at_work() -> None:
    flight = flown()
    assert list(flight.loops) == ["surge", "heave", "pitch", "heading"]
    hover = flight.mode == 0
    heave = flight.loops["heave"]
    assert heave.time_s == pytest.approx(hover.sum() * flight.period_s)
    error = flight.desired["depth"][hover] - flight.position[hover, 2]
    assert heave.error_largest == pytest.approx(np.abs(error).max(), rel=1e-12)
    assert heave.demand_rms == pytest.approx(math.sqrt(np.mean(flight.demanded[hover, 2] ** 2)), rel=1e-12)
    heading = flight.loops["heading"]
    turned = np.angle(np.exp(1j * (flight.desired["heading"] - flight.euler[:, 2])))
    assert heading.error_unit == "deg"
    assert heading.error_rms == pytest.approx(np.rad2deg(math.sqrt(np.mean(turned**2))), rel=1e-9)
    assert all(0.0 <= loop.saturated <= 1.0 for loop in flight.loops.values())


def test_a_loop_at_its_limit_is_saturated() -> None:
    calm = flown(OUT, (0.0, 0.0, 0.0)).loops["surge"].saturated
    file = tomllib.loads(st.Autopilot.load("cwolf").to_toml())
    file["loops"]["surge"]["tau_max"] = 8.0
    weak = st.Autopilot.from_toml(tomlkit.dumps(file))
    flight = st.fly("cwolf", weak, st.Mission.from_toml(OUT))
    # Eight newtons do not bring CWolf to 1.5 m/s.
    assert flight.loops["surge"].saturated > 0.9 > 0.2 > calm
    assert flight.loops["surge"].demand_largest == pytest.approx(8.0)


def test_a_demand_that_the_allocation_gives_up_in_part_is_not_met_and_not_saturated() -> None:
    """A push ahead of a vehicle whose thrusters sit below O pitches it, and no thruster answers in pitch."""
    file = tomllib.loads(st.Vehicle.load("bluerov2-heavy").to_toml())
    file["thrusters"] = [one for one in file["thrusters"] if one["group"] != "vertical"][:4] + [
        one | {"position_m": [0.0, *one["position_m"][1:]]}
        for one in file["thrusters"]
        if one["group"] == "vertical"
    ][:2]
    for one in file["thrusters"][:4]:
        one["position_m"][2] = 0.03
    vehicle = st.Vehicle.from_toml(tomlkit.dumps(file))
    autopilot = st.Autopilot.from_toml(start_autopilot(vehicle))
    mission = st.Mission.from_toml(OUT.replace("speed_m_s = 1.5", "speed_m_s = 0.4"))
    flight = st.fly(vehicle, autopilot, mission, conditions=st.Conditions(max_time_s=60.0, voltage_v=16.0))
    surge = flight.loops["surge"]
    assert surge.unmet > 0.3 > 0.05 > surge.saturated
    assert any("did not meet the demand of the surge loop" in line for line in flight.sentences())
    rows = flight.active[:, 0] & (np.abs(flight.demanded[:, 0]) > 1.0)
    assert (flight.achieved[rows, 0] < 0.97 * flight.demanded[rows, 0]).all()


def test_a_supply_that_no_table_of_thrust_reaches_is_warned_of() -> None:
    vehicle = st.Vehicle.load("bluerov2-heavy")
    flights = [
        st.fly(
            vehicle,
            vehicle.name,
            st.Mission.from_toml(OUT),
            conditions=st.Conditions(max_time_s=2.0, voltage_v=supply),
        )
        for supply in (16.0, 3.0)
    ]
    said = [[line for line in flight.sentences() if "lies outside" in line] for flight in flights]
    assert said[0] == []
    assert said[1][0].startswith("WARNING: Supply: 3 V lies outside the 10 to 20 V of the table")


def test_starts_and_stops_of_the_actuators_are_counted() -> None:
    flight = flown()
    use = flight.actuator_use
    mean = np.mean([one.switches_per_minute for one in use.values()])
    assert mean == pytest.approx(flight.metrics["switches_per_minute"], rel=1e-9)
    assert use["PL"].largest == pytest.approx(np.abs(flight.commands["PL"]).max())
    assert use["VTB"].running < 0.1 < 0.9 < use["PL"].running


def test_a_flight_reads_back_as_a_trial_of_its_vehicle() -> None:
    flight = flown()
    trial = st.Trial.read(flight.table(), name="flight", surface=0.0)
    assert trial.dt == pytest.approx(flight.period_s)
    assert set(trial.commands) == set(flight.commands)
    np.testing.assert_allclose(trial.nu, flight.nu, atol=1e-9)
    assert trial.current is not None
    np.testing.assert_allclose(trial.current, np.tile([0.0, 0.3, 0.0], (len(flight.t), 1)))
    for source, least in (("commands", 0.98), ("measured", 0.999)):
        found = st.score(flight.vehicle, trial, input=source)  # type: ignore[arg-type]
        for channel in ("u", "v", "w", "q", "r", "pitch", "yaw", "x", "y", "z"):
            # A trial is taken to begin with settled motors, a flight begins with motors at rest: for a
            # second the heave, of 7 mm/s rms in all, is 9 mm/s off.
            assert found[channel].r2 > least, (source, channel)


def test_law_the_commands_of_a_flight_replayed_make_the_same_motion() -> None:
    flight = flown()
    start = st.State(flight.position[0], flight.euler[0], flight.nu[0])
    run = flight.vehicle.simulate(
        flight.t, flight.commands, start, flight.circumstances.current, max_step_s=0.02, surface=0.0
    )
    # One chain of actuators and one equation of motion, in the same steps: equal but for rounding.
    np.testing.assert_allclose(run.nu, flight.nu, atol=1e-9)
    np.testing.assert_allclose(run.position, flight.position, atol=1e-9)
    for name, signal in flight.actuators.items():
        np.testing.assert_allclose(run.actuators[name], signal, atol=1e-9)


def test_plain_data_are_complete_and_go_into_json() -> None:
    flight = flown()
    plain: dict[str, Any] = json.loads(to_json(flight.to_dict()))
    assert plain["complete"] is True
    assert plain["metrics"]["distance_m"] == pytest.approx(flight.metrics["distance_m"])
    assert [leg["label"] for leg in plain["legs"]] == [leg.label for leg in flight.legs]
    assert plain["loops"]["heading"]["demand_unit"] == "N m"
    assert plain["circumstances"]["current_m_s"] == [0.0, 0.3, 0.0]
    assert plain["sentences"] == flight.sentences()


def test_sentences_tell_ending_way_errors_and_depth() -> None:
    flight = flown()
    text = str(flight)
    assert text.startswith("cwolf on box: complete. 3 of 3 waypoints reached in ")
    assert f"{flight.metrics['distance_m']:.0f} m over ground in 3 min" in text
    assert f"{flight.metrics['cross_track_rms_m']:.2f} m rms" in text
    assert "cross-track error was" in text
    assert "beyond a change of 10.0 m" in text


def test_a_missed_waypoint_is_no_complete_mission() -> None:
    # 0.05 m is less than the vehicle moves in a period: it passes the plane beside the point.
    flight = flown(BOX.replace("acceptance_radius_m = 5.0", "acceptance_radius_m = 0.05"))
    assert flight.outcome == "complete"
    missed = [leg for leg in flight.legs if not leg.reached]
    assert missed
    assert not flight.complete
    assert f'"{missed[0].label}" not reached: the autopilot perceived it at' in str(flight)


def test_a_waypoint_is_reached_as_the_sensors_show_it_and_truly_nearly_so() -> None:
    near = {"position": Sensor(noise=0.3), "depth": Sensor(), "attitude": Sensor(), "gyro": Sensor()}
    near["dvl"] = Sensor()
    flight = st.fly(
        "cwolf", "cwolf", st.Mission.from_toml(OUT), conditions=st.Conditions(sensors=near), seed=3
    )
    (leg,) = flight.legs
    assert leg.perceived_m <= 5.0
    assert leg.smallest_m == pytest.approx(leg.perceived_m, abs=1.5)  # five deviations
    assert leg.reached
    far = near | {"position": Sensor(bias=40.0)}
    off = st.fly("cwolf", "cwolf", st.Mission.from_toml(OUT), conditions=st.Conditions(sensors=far), seed=3)
    (leg,) = off.legs
    assert leg.smallest_m > 7.5
    assert not leg.reached
    assert any("m from the true one" in line for line in off.sentences())


def test_a_flight_that_ends_early_has_legs_that_were_never_begun() -> None:
    flight = flown(BOX, max_time_s=20.0)
    assert flight.outcome == "out of time"
    assert math.isnan(flight.legs[2].begin_s)
    assert not flight.legs[2].reached
    assert flight.legs[2].depth_step_m == -5.0
    assert "not complete after 20 s" in str(flight)
    json.loads(to_json(flight.to_dict()))


def test_a_diverged_flight_is_a_result() -> None:
    wild = st.Vehicle.load("cwolf").with_coefficients({"X_uu": 400.0})  # drag that pushes
    flight = st.fly(wild, "cwolf", st.Mission.from_toml(OUT), conditions=st.Conditions(model="cwolf"))
    assert flight.outcome == "diverged"
    assert not flight.complete
    assert "diverged" in str(flight)
    json.loads(to_json(flight.to_dict()))


def test_errors_that_truly_are_others_than_perceived_are_told_as_such() -> None:
    near = {"position": Sensor(bias=3.0), "depth": Sensor(bias=1.0), "attitude": Sensor(), "gyro": Sensor()}
    near["dvl"] = Sensor()
    flight = st.fly(
        "cwolf", "cwolf", st.Mission.from_toml(OUT), conditions=st.Conditions(sensors=near), seed=3
    )
    rms, largest = (flight.metrics[f"true_cross_track_{name}_m"] for name in ("rms", "largest"))
    assert f" as perceived; truly {rms:.2f} m rms, at most {largest:.2f} m" in flight.report().good
    off = float(np.max(np.abs(flight.measured["z"] - flight.position[:, 2])))
    truly = true_vertical(flight)
    perceived = flight.metrics["vertical_rms_m"]
    assert truly["true_vertical_rms_m"] == pytest.approx(off, abs=2.0 * perceived)
    table = flight.report().sections[0].tables[0].text()
    assert f"true vertical error, rms                {truly['true_vertical_rms_m']:.3f}" in table
    # As the sensors show it without errors, there is one error only.
    plain = flown(OUT, (0.0, 0.0, 0.0))
    assert "truly" not in plain.report().good
    assert "true " not in plain.report().sections[0].tables[0].text()
    expected = {name: plain.metrics[name.removeprefix("true_")] for name in true_vertical(plain)}
    assert true_vertical(plain) == pytest.approx(expected)
