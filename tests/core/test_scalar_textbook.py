"""The core against the textbook model, which was written from the equations without knowing the core."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seatrial as st
from benchmarks import textbook as tb
from benchmarks import textbook_kinematics as kin
from benchmarks.textbook_thrusters import static_limits, wrench_per_newton
from benchmarks.textbook_vehicle import build, from_vehicle
from seatrial import _core

pytestmark = pytest.mark.long

# Two orders of the same sums in double precision; relative to the largest entry of each kind.
AGREEMENT = 1e-12
# The same over some hundred steps of RK4, in which rounding grows.
TRAJECTORY = 1e-11

EVERY_TERM = Path(__file__).with_name("every_term.toml")


def vehicle(name: str) -> st.Vehicle:
    return st.Vehicle.load(EVERY_TERM if name == "every_term" else name)


def states(n: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    q = rng.normal(size=(n, 4))
    return (
        rng.normal(size=(n, 6)),
        q / np.linalg.norm(q, axis=1, keepdims=True),
        20.0 * rng.normal(size=(n, 6)),
    )


def commands(v: st.Vehicle, n: int, seed: int) -> dict[str, Any]:
    """Steps of half a second within and beyond the limits, through zero and through the dead band."""
    rng = np.random.default_rng(seed)
    found = {}
    for name, info in v.actuator_info().items():
        limit = {"rpm": 2200.0, "us": 420.0, "N": 30.0, "rad": 0.9}[info["unit"]]
        levels = rng.uniform(-limit, limit, size=n // 5 + 1) * rng.choice([0.0, 0.04, 1.0], size=n // 5 + 1)
        found[name] = info["neutral"] + np.repeat(levels, 5)[:n]
    return found


def close(found: Any, expected: Any, tolerance: float) -> None:
    found, expected = np.asarray(found, dtype=float), np.asarray(expected, dtype=float)
    assert found.shape == expected.shape
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=tolerance * max(1.0, np.abs(expected).max()))


def compare(run: st.Run, expected: tb.Trajectory, tolerance: float = TRAJECTORY) -> None:
    close(run.position, expected.position, tolerance)
    close(run.attitude, expected.attitude, tolerance)
    close(run.nu, expected.nu, tolerance)
    for name, values in expected.actuators.items():
        close(run.actuators[name], values, tolerance)
    close(run.tau, expected.tau, tolerance)


VEHICLES = pytest.mark.parametrize("name", ["cwolf", "beluga", "every_term"])


@VEHICLES
@pytest.mark.parametrize("current", [None, (0.4, -0.3, 0.1)], ids=["still", "current"])
def test_scalar_textbook_acceleration(name: str, current: tuple[float, float, float] | None) -> None:
    v, (nu, q, tau) = vehicle(name), states(40, 1)
    model = build(from_vehicle(v))
    found = v.acceleration(nu, q, tau, current=current)
    v_c = (0.0, 0.0, 0.0) if current is None else current
    for row, one, attitude, wrench in zip(found, nu, q, tau, strict=True):
        close(row, tb.acceleration(model, one, attitude, wrench, v_c=v_c), AGREEMENT)


@VEHICLES
@pytest.mark.parametrize("current", [None, (0.4, -0.3, 0.1)], ids=["still", "current"])
def test_scalar_textbook_forces(name: str, current: tuple[float, float, float] | None) -> None:
    v, (nu, q, _) = vehicle(name), states(40, 2)
    model = build(from_vehicle(v))
    found = v.forces(nu, q, current=current)
    v_c = (0.0, 0.0, 0.0) if current is None else current
    for i in range(len(nu)):
        for term, wrench in tb.forces(model, nu[i], kin.rotation(q[i]), v_c=v_c).items():
            if term in found:
                close(found[term][i], wrench, AGREEMENT)


@VEHICLES
def test_scalar_textbook_matrices(name: str) -> None:
    v = vehicle(name)
    model = build(from_vehicle(v))
    close(v.mass_matrix(), model.M, AGREEMENT)
    columns = [thruster.wrench for thruster in model.thrusters]
    columns += [wrench_per_newton(fin.place, fin.normal) for fin in model.fins]
    close(v.allocation_matrix(), np.column_stack(columns), AGREEMENT)


# None of the torpedoes' servos obeys at once: their fins turn within every step.
@pytest.mark.parametrize("name", ["cwolf", "beluga", "every_term", "remus100", "lauv"])
@pytest.mark.parametrize("substeps", [1, 3])
def test_scalar_textbook_simulation_of_the_whole_chain(name: str, substeps: int) -> None:
    v, dt = vehicle(name), 0.06
    t = np.arange(100) * dt
    model, given = build(from_vehicle(v)), commands(v, len(t), 3)
    voltage = 14.0 + np.sin(t)
    expected = tb.simulate(model, t, given, voltage=voltage, substeps=substeps)
    compare(v.simulate(t, given, voltage_v=voltage, max_step_s=dt / substeps), expected)


@VEHICLES
def test_scalar_textbook_simulation_from_a_moving_start_in_a_changing_current(name: str) -> None:
    v, dt = vehicle(name), 0.05
    t = np.arange(80) * dt
    (nu,), (q,), _ = states(1, 4)
    nu *= 0.3
    position = np.array([3.0, -2.0, 5.0])
    current = np.column_stack([0.3 * np.sin(t), 0.2 * np.cos(t), 0.02 * t])
    wrench = np.column_stack([3.0 * np.sin(0.7 * t + i) for i in range(6)])
    model, given = build(from_vehicle(v)), commands(v, len(t), 5)
    actuators: dict[str, Any] = {name: float(values[-1]) for name, values in given.items()}
    voltage = np.full(len(t), 14.8)
    expected = tb.simulate(
        model,
        t,
        given,
        position=position,
        attitude=q,
        nu=nu,
        actuators=actuators,
        current=current,
        tau=wrench,
        voltage=voltage,
        substeps=2,
    )
    initial = st.State(position, q, nu, actuators)
    run = v.simulate(t, given, initial, current, tau=wrench, voltage_v=voltage, max_step_s=dt / 2)
    compare(run, expected)


@VEHICLES
@pytest.mark.parametrize("free", ["XZN", "M", "XYZKMN"])
def test_scalar_textbook_simulation_with_frozen_axes(name: str, free: str) -> None:
    v, dt = vehicle(name), 0.05
    t = np.arange(60) * dt
    nu = np.array([0.8, 0.1, -0.1, 0.05, 0.1, 0.2])
    model, given = build(from_vehicle(v)), commands(v, len(t), 6)
    voltage, current = np.full(len(t), 14.8), (0.2, 0.1, 0.0)
    expected = tb.simulate(model, t, given, nu=nu, free=free, current=current, voltage=voltage, substeps=2)
    initial = st.State(nu=nu)
    run = v.simulate(t, given, initial, current, free, voltage_v=voltage, max_step_s=dt / 2)
    compare(run, expected)
    frozen = [i for i in range(6) if "XYZKMN"[i] not in free]
    np.testing.assert_array_equal(
        np.asarray(run.nu)[:, frozen], np.broadcast_to(nu[frozen], (60, len(frozen)))
    )


@VEHICLES
def test_scalar_textbook_simulation_in_other_water(name: str) -> None:
    v, dt = vehicle(name), 0.05
    t = np.arange(60) * dt
    parameters, given = from_vehicle(v), commands(v, len(t), 7)
    voltage = np.full(len(t), 15.2)
    model = build(parameters, rho=998.0, g=9.79)
    expected = tb.simulate(model, t, given, voltage=voltage)
    compare(v.simulate(t, given, voltage_v=voltage, max_step_s=dt, rho=998.0, g=9.79), expected)


@pytest.mark.parametrize(
    "changed",
    [{"screw.T_1": 0.0}, {"screw.t": 0.2}, {"screw.gain": 0.7}, {"jet.T_t": 0.08}],
    ids=["lag of zero behind a ramp", "deduction spares the torque", "gain", "dead time of newtons"],
)
def test_scalar_textbook_simulation_at_the_edges_of_the_chain(changed: dict[str, Any]) -> None:
    v, dt = vehicle("every_term").with_coefficients(changed), 0.05
    t = np.arange(60) * dt
    given = commands(v, len(t), 13)
    compare(v.simulate(t, given, max_step_s=dt), tb.simulate(build(from_vehicle(v)), t, given))


@VEHICLES
def test_scalar_textbook_batch_of_other_coefficients(name: str) -> None:
    v, dt = vehicle(name), 0.05
    t = np.arange(60) * dt
    own, given = v.coefficients(), commands(v, len(t), 8)
    voltage = np.full(len(t), 14.8)
    rng = np.random.default_rng(9)
    varied = [k for k, value in own.items() if value != 0.0]
    values: dict[str, Any] = {k: own[k] * rng.uniform(0.9, 1.1, size=11) for k in varied}
    run = st.simulate_batch(v, values, t, given, voltage_v=voltage, max_step_s=dt / 2)
    for i in (0, 7, 10):
        other = v.with_coefficients({k: float(x[i]) for k, x in values.items()})
        expected = tb.simulate(build(from_vehicle(other)), t, given, voltage=voltage, substeps=2)
        # Fused multiply-adds round once where the textbook rounds twice.
        close(run.nu[i], expected.nu, TRAJECTORY)
        close(run.position[i], expected.position, TRAJECTORY)
        close(run.tau[i], expected.tau, TRAJECTORY)


def test_scalar_textbook_criterion_of_the_open_loop() -> None:
    v, dt = vehicle("every_term"), 0.05
    t = np.arange(80) * dt
    model, given = build(from_vehicle(v)), commands(v, len(t), 10)
    for values in given.values():
        values[:10] = 0.0
    rng = np.random.default_rng(11)
    observed, weight = 0.1 * rng.normal(size=(len(t), 12)), rng.uniform(0.0, 2.0, size=(len(t), 12))
    weight[30:35] = 0.0
    run = tb.simulate(model, t, given, substeps=2)
    simulated = np.hstack([run.nu, run.position, [kin.euler(q) for q in run.attitude]])
    error = observed - simulated
    error[:, 9:] = (error[:, 9:] + np.pi) % (2.0 * np.pi) - np.pi
    expected = np.abs(weight * error)[1:].sum(axis=0)
    record = _core.Record(t, given, observed=observed, weight=weight)
    start = (0, 0, len(t), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(6))
    loop = _core.OpenLoop(v, [record], [start], substeps=2, names=["m"])
    close(loop.errors(np.array([[v.coefficients()["m"]]]))[0, 0], expected, TRAJECTORY)


@pytest.mark.parametrize("measured", ["X", "YN"])
def test_scalar_textbook_prediction_with_measured_axes_and_actuators(measured: str) -> None:
    v, dt, substeps = vehicle("every_term"), 0.05, 2
    t = np.arange(60) * dt
    halves = np.arange(2 * substeps * (len(t) - 1) + 1) * 0.5 * dt / substeps
    phase = np.arange(6)
    nu, nu_rate = 0.3 * np.sin(halves[:, None] + phase), 0.3 * np.cos(halves[:, None] + phase)
    model, given = build(from_vehicle(v)), commands(v, len(t), 12)
    revolutions: dict[str, Any] = {"screw": 900.0 * np.sin(t), "ducted": 700.0 * np.cos(t)}
    free = "".join(axis for axis in "XYZKMN" if axis not in measured)
    expected = tb.simulate(
        model,
        t,
        {name: values if name not in revolutions else np.zeros(len(t)) for name, values in given.items()},
        nu=nu[0],
        actuators={name: float(steady(v, name, given[name][0])) for name in given if name not in revolutions},
        measured_actuators=revolutions,
        free=free,
        measured={axis: (nu[:, i], nu_rate[:, i]) for i, axis in enumerate("XYZKMN") if axis in measured},
        substeps=substeps,
    )
    record = _core.Record(t, given, actuators=revolutions, nu=nu, nu_rate=nu_rate)
    start = (0, 0, len(t), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), nu[0])
    loop = _core.OpenLoop(v, [record], [start], free=free, measured=measured, substeps=substeps, names=["m"])
    (channels,) = loop.predict(np.array([v.coefficients()["m"]]))
    close(channels[:, :6], expected.nu, TRAJECTORY)
    close(channels[:, 6:9], expected.position, TRAJECTORY)
    close(channels[:, 9:], [kin.euler(q) for q in expected.attitude], TRAJECTORY)


def steady(v: st.Vehicle, name: str, command: float) -> float:
    """The actual value under a command that has lasted."""
    (drive,) = [d for d in build(from_vehicle(v)).drives if d.name == name]
    return float(drive.command(drive.K_V * static_limits(drive, command)))


def test_scalar_a_candidate_does_not_see_a_neighbours_dead_time() -> None:
    v, t = vehicle("cwolf"), np.arange(400) * 0.1
    motion = np.column_stack([np.sin(0.1 * t), *np.zeros((11, 400))])
    record = _core.Record(t, commands(v, 400, 5), observed=motion, weight=np.ones((400, 12)))
    late = (0, 200, 300, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(6))
    loop = _core.OpenLoop(v, [record], [late], substeps=2, names=["SbU.T_t", "SbU.T_1"])
    own, other = [0.13, 0.4], [2.9, 0.05]
    # The segment begins after the motors' warm-up, which must not be longer for the neighbour's sake.
    np.testing.assert_array_equal(loop.errors([own, other])[0], loop.errors([own])[0])
