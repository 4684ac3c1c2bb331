"""Objects of the core through pickle, copy and a pool of processes: the same to the last bit."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, TypeVar

import numpy as np
import pytest

import seatrial as st
from seatrial._core import Flights, Run, State
from seatrial._core import Mission as CoreMission
from seatrial.control_design.lqr import lqr_autopilot

T = TypeVar("T")

THIRD = 1.0 / 3.0
"""No decimal number of few digits is the same."""

PATTERNS = """
format = 1
name = "patterns"
speed_m_s = 1.5
acceptance_radius_m = 5.0
origin = { latitude_deg = 63.44, longitude_deg = 10.4 }
[limits]
max_depth_m = 30.0
fence_m = [[-500.0, -500.0], [500.0, -500.0], [500.0, 500.0], [-500.0, 500.0]]
[[legs]]
north_m = 33.333333333333336
east_m = 0.1
depth_m = 5.0
hold_s = 10.0
heading_deg = 123.4
[[legs]]
kind = "spiral"
north_m = 100.0
east_m = 100.0
start_radius_m = 10.0
end_radius_m = 40.0
spacing_m = 7.0
[[legs]]
kind = "perimeter"
north_m = -200.0
east_m = -200.0
radius_m = 25.0
distance_m = 10.0
"""


def pickled(value: T) -> T:
    back: T = pickle.loads(pickle.dumps(value))
    return back


WAYS: list[Callable[[Any], Any]] = [pickled, copy.copy, copy.deepcopy]

ways = pytest.mark.parametrize("way", WAYS, ids=["pickle", "copy", "deepcopy"])


def changed_vehicle(name: str = "cwolf") -> st.Vehicle:
    """Vehicle whose mass, one zero and one digit of a gain are not those of its file."""
    vehicle = st.Vehicle.load(name)
    actuator = vehicle.actuators[0]
    mass = vehicle.coefficients()["m"]
    return vehicle.with_coefficients({
        "m": mass * (1.0 + THIRD / 100.0),
        "X_u": -0.0,
        f"{actuator}.gain": 1.0 + THIRD,
    })


def simulated(vehicle: st.Vehicle) -> Run:
    t = np.arange(50) * 0.1
    initial = State([1.0, 2.0, 3.0], [0.1, THIRD, -2.0], [0.5, 0.0, 0.0, 0.0, 0.0, THIRD])
    commands = {vehicle.actuators[0]: np.full(50, 600.0)}
    return vehicle.simulate(t, commands, initial, voltage_v=np.full(50, 16.0))


def flown(*, logs: bool = True) -> Flights:
    """Three short flights in different currents."""
    mission = st.Mission.from_toml(PATTERNS)
    vehicle, autopilot = st.Vehicle.load("cwolf"), st.Autopilot.load("cwolf")
    currents = [[0.0, 0.0, 0.0], [0.1, THIRD, 0.0], [-0.2, 0.0, 0.05]]
    return st.fly_batch(
        vehicle,
        autopilot,
        mission,
        water=st.Water(current=currents),
        conditions=st.Conditions(max_time_s=20.0),
        logs=logs,
    )


def same(one: Any, other: Any) -> None:
    """Refuse two values that are not the same to the last bit."""
    assert type(one) is type(other)
    if isinstance(one, dict):
        assert list(one) == list(other)
        for key in one:
            same(one[key], other[key])
    elif isinstance(one, np.ndarray):
        assert one.shape == other.shape
        assert one.tobytes() == other.tobytes()
    elif isinstance(one, list | tuple):
        assert len(one) == len(other)
        for mine, others in zip(one, other, strict=True):
            same(mine, others)
    elif isinstance(one, float):
        assert np.float64(one).tobytes() == np.float64(other).tobytes()
    else:
        assert one == other


def facts_of_vehicle(vehicle: st.Vehicle) -> tuple[Any, ...]:
    nu, attitude, tau = [1.5, 0.1, -0.2, 0.01, 0.02, 0.3], [0.1, 0.2, 0.3], [10.0, 1.0, 2.0, 0.1, 0.2, 0.3]
    run = simulated(vehicle)
    return (
        vehicle.to_toml(),
        vehicle.coefficients(),
        vehicle.coefficient_info(),
        vehicle.actuator_info(),
        vehicle.acceleration(nu, attitude, tau),
        vehicle.allocation_matrix(),
        run.nu,
        run.tau,
    )


def facts_of_autopilot(autopilot: st.Autopilot) -> tuple[Any, ...]:
    return autopilot.to_toml(), autopilot.to_dict(), autopilot.gains(), autopilot.modes, autopilot.speeds_m_s


def facts_of_mission(mission: CoreMission) -> tuple[Any, ...]:
    return (
        mission.to_toml(),
        mission.waypoints,
        mission.legs,
        mission.leg_numbers,
        mission.start,
        mission.limits,
        mission.fence,
        mission.origin,
    )


def facts_of_state(state: State) -> tuple[Any, ...]:
    return state.position, state.attitude, state.nu, state.actuators


def facts_of_run(run: Run) -> tuple[Any, ...]:
    return run.t, run.position, run.attitude, run.euler, run.nu, run.tau, run.actuators


def facts_of_flights(flights: Flights) -> tuple[Any, ...]:
    cases = range(len(flights))
    return (
        flights.columns,
        [flights.log(case) for case in cases],
        [flights.t(case) for case in cases],
        flights.figures,
        flights.cross_track_counts,
        flights.vertical_counts,
        flights.true_cross_track_counts,
        flights.violations,
    )


@ways
@pytest.mark.parametrize("name", st.Vehicle.names())
def test_a_vehicle_comes_back_to_the_last_bit(name: str, way: Callable[[Any], Any]) -> None:
    for vehicle in (st.Vehicle.load(name), changed_vehicle(name)):
        same(facts_of_vehicle(way(vehicle)), facts_of_vehicle(vehicle))


def test_start_values_come_back_though_text_would_move_them() -> None:
    """They follow the mass of the file; the text with every coefficient written out has another mass."""
    vehicle = changed_vehicle("lauv")
    of_text = st.Vehicle.from_toml(vehicle.to_toml())
    assert of_text.coefficient_info() != vehicle.coefficient_info()
    assert pickled(vehicle).coefficient_info() == vehicle.coefficient_info()


@ways
@pytest.mark.parametrize("name", st.Autopilot.names())
def test_an_autopilot_comes_back_to_the_last_bit(name: str, way: Callable[[Any], Any]) -> None:
    autopilot = st.Autopilot.load(name)
    gain = next(iter(autopilot.gains()))
    changed = autopilot.with_gains({gain: THIRD})
    for one in (autopilot, changed):
        same(facts_of_autopilot(way(one)), facts_of_autopilot(one))


def test_a_regulator_comes_back_to_the_last_bit() -> None:
    text = lqr_autopilot(st.Vehicle.load("lauv"), st.Autopilot.load("lauv").to_toml())
    autopilot = st.Autopilot.from_toml(text)
    same(facts_of_autopilot(pickled(autopilot)), facts_of_autopilot(autopilot))


@ways
def test_a_mission_comes_back_to_the_last_bit(way: Callable[[Any], Any]) -> None:
    mission = st.Mission.from_toml(PATTERNS)
    same(facts_of_mission(way(mission.core)), facts_of_mission(mission.core))
    same(facts_of_mission(way(mission).core), facts_of_mission(mission.core))


@ways
def test_a_state_comes_back_to_the_last_bit(way: Callable[[Any], Any]) -> None:
    rng = np.random.default_rng(1)  # of many attitudes some change when they are scaled to length one again
    for _ in range(100):
        state = State(rng.normal(size=3), rng.normal(size=4), rng.normal(size=6), {"SbU": THIRD})
        same(facts_of_state(way(state)), facts_of_state(state))


@ways
def test_a_run_comes_back_to_the_last_bit(way: Callable[[Any], Any]) -> None:
    vehicle = changed_vehicle()
    t = np.arange(20) * 0.1 + THIRD
    batch = st.simulate_batch(
        vehicle, {"X_uu": [-9.0, -10.0, -11.0]}, t, {vehicle.actuators[0]: np.full(20, 600.0)}
    )
    short = st.simulate_batch(vehicle, {"X_uu": [-9.0]}, t[:2])
    for run in (simulated(vehicle), batch, short):
        same(facts_of_run(way(run)), facts_of_run(run))


@ways
@pytest.mark.parametrize("logs", [True, False])
def test_flights_come_back_to_the_last_bit(way: Callable[[Any], Any], logs: bool) -> None:
    flights = flown(logs=logs)
    assert len(way(flights)) == len(flights) == 3
    same(facts_of_flights(way(flights)), facts_of_flights(flights))


def test_a_pickle_of_another_vehicle_is_refused_with_a_message() -> None:
    restore, (text, coefficients) = st.Vehicle.load("cwolf").__reduce__()
    with pytest.raises(st.VehicleError, match=r"expected \d+ coefficients, found"):
        restore(text, coefficients[:-1])


def at_work(
    vehicle: st.Vehicle, autopilot: st.Autopilot, mission: st.Mission, state: State
) -> tuple[Run, Flights, dict[str, float]]:
    """What a process of a pool makes of the objects that it is handed."""
    run = vehicle.simulate(np.arange(20) * 0.1, initial=state)
    helm = autopilot.engage(vehicle, mission)
    step = helm.step(
        {"x": 0.0, "y": 0.0, "z": 1.0, "roll": 0.0, "pitch": 0.0, "yaw": 0.3} | dict.fromkeys("pqr", 0.0)
    )
    flights = st.fly_batch(
        vehicle,
        autopilot,
        mission,
        water=st.Water(current=[[0.0, 0.1, 0.0]] * 2),
        conditions=st.Conditions(max_time_s=5.0),
    )
    return run, flights, step


def test_a_pool_of_processes_finds_what_this_one_finds() -> None:
    given = (
        changed_vehicle(),
        st.Autopilot.load("cwolf"),
        st.Mission.from_toml(PATTERNS),
        State([1.0, 2.0, 3.0], [0.1, THIRD, -2.0]),
    )
    run, flights, step = at_work(*given)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        far_run, far_flights, far_step = pool.submit(at_work, *given).result(timeout=120.0)
    same(facts_of_run(far_run), facts_of_run(run))
    same(facts_of_flights(far_flights), facts_of_flights(flights))
    same(far_step, step)
