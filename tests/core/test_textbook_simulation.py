"""Timing and order of the textbook simulation: what acts when, and how the error falls with the step."""

from __future__ import annotations

import dataclasses

import numpy as np

from benchmarks import textbook as tb
from benchmarks.textbook_thrusters import Newton, Quadratic, Table, Thruster, wrench_per_newton
from benchmarks.textbook_vehicle import Parameters, build

HULL = {
    "m": 40.0, "I_x": 1.0, "I_y": 5.0, "I_z": 5.0, "B": 40.0 * 9.81, "z_b": -0.02,
    "X_udot": -4.0, "Y_vdot": -30.0, "Z_wdot": -30.0, "K_pdot": -0.3, "M_qdot": -4.0, "N_rdot": -4.0,
    "X_u": -2.0, "Y_v": -10.0, "Z_w": -10.0, "K_p": -1.0, "M_q": -5.0, "N_r": -5.0,
}  # fmt: skip
AHEAD = wrench_per_newton([-0.5, 0.05, 0.0], [1.0, 0.0, 0.0])
PUSHER = Thruster(name="pusher", wrench=AHEAD, characteristic=Newton(), unit="N")
PROPELLER = Thruster(
    name="screw", wrench=AHEAD, characteristic=Quadratic(p1_ahead=0.05, p1_astern=0.04, p2=-0.1), T_1=0.3
)
T = np.arange(0.0, 2.01, 0.1)


def test_command_acts_from_its_own_sample_on() -> None:
    model = build(Parameters(HULL, [PUSHER]))
    command = np.where(np.arange(len(T)) >= 5, 10.0, 0.0)
    run = tb.simulate(model, T, {"pusher": command})
    assert run.nu[5, 0] == 0.0
    assert run.nu[6, 0] > 0.0
    # Without rate limit and lag the force jumps with the command: the interval that begins here feels it.
    assert run.tau[4, 0] == 0.0
    assert run.tau[5, 0] == 10.0


def test_law_an_ideal_thruster_gives_the_impulse_of_its_command() -> None:
    centred = wrench_per_newton([0.0, 0.0, 0.0], [1.0, 0.0, 0.0])
    pusher = Thruster(name="pusher", wrench=centred, characteristic=Newton(), unit="N")
    model = build(Parameters({**HULL, "X_u": 0.0}, [pusher]))
    command = np.where(np.arange(len(T)) == 5, 10.0, 0.0)
    run = tb.simulate(model, T, {"pusher": command})
    # 10 N over one sample of 0.1 s on m - X_udot = 44 kg; rounding.
    np.testing.assert_allclose(run.nu[-1, 0], 1.0 / 44.0, rtol=1e-12)


def test_direct_wrench_is_held_and_added() -> None:
    model = build(Parameters(HULL, [PUSHER]))
    wrench = np.zeros((len(T), 6))
    wrench[5:, 0] = 10.0
    run = tb.simulate(model, T, {"pusher": np.full(len(T), 2.0)}, tau=wrench, actuators={"pusher": 2.0})
    np.testing.assert_allclose(run.tau[[4, 5], 0], [2.0, 12.0])


def test_actual_value_does_not_depend_on_the_hull() -> None:
    light, heavy = build(Parameters(HULL, [PROPELLER])), build(Parameters(HULL | {"m": 80.0}, [PROPELLER]))
    command = {"screw": 600.0 * np.sin(T)}
    np.testing.assert_array_equal(
        tb.simulate(light, T, command).actuators["screw"], tb.simulate(heavy, T, command).actuators["screw"]
    )


def test_measured_actuator_replaces_the_chain() -> None:
    model = build(Parameters(HULL, [PROPELLER]))
    revolutions = 600.0 * np.sin(T)
    run = tb.simulate(model, T, {}, measured_actuators={"screw": revolutions})
    np.testing.assert_array_equal(run.actuators["screw"], revolutions)


def test_reversed_thruster_mirrors_its_command() -> None:
    mirrored = dataclasses.replace(PROPELLER, reversed=True)
    command = 600.0 * np.sin(T)
    one = tb.simulate(build(Parameters(HULL, [PROPELLER])), T, {"screw": command})
    other = tb.simulate(build(Parameters(HULL, [mirrored])), T, {"screw": -command})
    np.testing.assert_array_equal(one.nu, other.nu)
    np.testing.assert_array_equal(one.actuators["screw"], -other.actuators["screw"])


def test_supply_voltage_is_held_from_sample_to_sample() -> None:
    table = Table(
        signal=np.array([-400.0, 0.0, 400.0]),
        voltage=np.array([12.0, 16.0]),
        force=np.array([[-20.0, 0.0, 24.0], [-30.0, 0.0, 40.0]]),
    )
    thruster = Thruster(name="t", wrench=AHEAD, characteristic=table, unit="us", neutral=1500.0)
    model = build(Parameters(HULL, [thruster]))
    command = np.full(len(T), 1900.0)
    voltage = np.where(np.arange(len(T)) >= 5, 12.0, 16.0)
    run = tb.simulate(model, T, {"t": command}, voltage=voltage, actuators={"t": 1900.0})
    np.testing.assert_allclose(run.tau[[4, 5], 0], [40.0, 24.0])


def test_law_fourth_order_under_a_lagging_propeller() -> None:
    model = build(Parameters(HULL, [PROPELLER]))
    command = {"screw": np.full(len(T), 900.0)}

    def end(substeps: int) -> np.ndarray:
        run = tb.simulate(
            model, T, command, substeps=substeps, actuators={"screw": 300.0}, nu=[1, 0.2, 0, 0.1, 0, 0.2]
        )
        return np.hstack([run.position[-1], run.nu[-1]])

    exact = end(16)
    coarse, fine = np.abs(end(1) - exact).max(), np.abs(end(2) - exact).max()
    # Fourth order: sixteen-fold per halving; the next order leaves a little.
    assert coarse > 13.0 * fine
