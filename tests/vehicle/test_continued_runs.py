"""A run in pieces, each from the state that the one before left, equals the run in one piece."""

from __future__ import annotations

import itertools
import pickle

import numpy as np
import pytest

import seatrial as st
from seatrial._core import Vehicle
from seatrial.base.errors import SimulationError

HEAD = """
format = 1
name = "every motor"
[coefficients]
m = 30.0
I_x = 1.0
I_y = 3.0
I_z = 3.0
X_udot = -3.0
Y_vdot = -25.0
Z_wdot = -25.0
M_qdot = -1.0
N_rdot = -1.0
X_uu = -8.0
Y_vv = -60.0
Z_ww = -60.0
K_p = -2.0
M_q = -8.0
N_r = -8.0
z_g = 0.02
[characteristics.quadratic]
kind = "quadratic"
p1_ahead = 0.02
p2 = -0.01
q1 = 0.001
[characteristics.polynomial]
kind = "polynomial"
ahead = [0.0, 0.01, 0.00001]
astern = [0.0, 0.01, 0.000005]
[characteristics.table]
kind = "table"
signal = [-400, 0, 400]
voltage_v = [14, 18]
force_n = [[-20, 0, 30], [-30, 0, 45]]
[characteristics.direct]
kind = "direct"
"""
ACTUATORS = {
    "quadratic": ("rpm", 900.0),
    "polynomial": ("rpm", 700.0),
    "table": ("us", 250.0),
    "direct": ("N", 15.0),
}
# Rate limit per command's size and s, lag and dead time in s; neither is a multiple of a step.
MOTORS = {
    "ideal": {},
    "late": {"T_t_s": 0.37},
    "lag": {"T_1_s": 0.21},
    "lag late": {"T_1_s": 0.21, "T_t_s": 0.133},
    "ramp": {"n_acc_per_s": 1.3, "n_dec_per_s": 2.1},
    "ramp late": {"n_acc_per_s": 1.3, "n_dec_per_s": 2.1, "T_t_s": 0.37},
    "all": {"n_acc_per_s": 1.3, "T_1_s": 0.15, "T_t_s": 0.29, "K_V": 0.93},
}
T = np.arange(0.0, 4.001, 0.1)


def vehicle_with(motor: dict[str, float]) -> Vehicle:
    text = HEAD
    for kind, (unit, size) in [*ACTUATORS.items(), ("fin", ("rad", 0.4))]:
        values = {k: v * (size if k.startswith("n_") else 1.0) for k, v in motor.items()}
        text += f"[motors.{kind}]\n" + "".join(f"{k} = {v}\n" for k, v in values.items())
        if kind != "fin":
            text += (
                f'[[thrusters]]\nname = "{kind}"\ncommand = "{unit}"\nposition_m = [-0.5, 0.2, 0.1]\n'
                f'direction = [0.8, 0.6, 0.0]\nmotor = "{kind}"\ncharacteristic = "{kind}"\n'
            )
    text += (
        '[[fins]]\nname = "fin"\nposition_m = [-0.8, 0.0, 0.0]\nnormal = [0.0, 1.0, 0.0]\narea_m2 = 0.02\n'
        'aspect_ratio = 2.0\nmotor = "fin"\n'
    )
    return Vehicle.from_toml(text)


def commands_over(t: np.ndarray) -> dict[str, np.ndarray]:
    sizes = {**ACTUATORS, "fin": ("rad", 0.4)}
    return {name: size * np.sin(3.0 * t + k) for k, (name, (_, size)) in enumerate(sizes.items())}


@pytest.mark.parametrize("motor", MOTORS)
@pytest.mark.parametrize("pickled", [False, True])
def test_a_run_in_pieces_equals_one_run(motor: str, pickled: bool) -> None:
    vehicle, commands = vehicle_with(MOTORS[motor]), commands_over(T)
    volts = np.full(len(T), 16.0)
    whole = vehicle.simulate(T, commands, voltage_v=volts, current=[0.2, -0.1, 0.0])
    state = None
    # Pieces of one, three and more samples, shorter and longer than the dead time.
    edges = [0, 1, 2, 3, 6, 7, 15, 16, 30, 40]
    for start, stop in itertools.pairwise(edges):
        part = slice(start, stop + 1)
        piece = vehicle.simulate(
            T[part],
            {name: x[part] for name, x in commands.items()},
            state,
            voltage_v=volts[part],
            current=[0.2, -0.1, 0.0],
        )
        assert np.allclose(piece.nu, whole.nu[part], rtol=0, atol=1e-12)
        assert np.allclose(piece.position, whole.position[part], rtol=0, atol=1e-12)
        for name, signal in whole.actuators.items():
            size = 0.4 if name == "fin" else ACTUATORS[name][1]
            # A millionth of a step of the dead time is interpolated away.
            assert np.allclose(piece.actuators[name] / size, signal[part] / size, rtol=0, atol=1e-12), name
        run = pickle.loads(pickle.dumps(piece)) if pickled else piece
        state = pickle.loads(pickle.dumps(run.final_state)) if pickled else run.final_state


def test_a_rate_limit_gets_on_in_short_steps() -> None:
    """What a hand-made state loses: with the signal alone, a late motor never starts."""
    vehicle = vehicle_with(MOTORS["all"])
    run = vehicle.simulate([0.0, 0.1], voltage_v=[16.0, 16.0])
    for _ in range(20):
        run = vehicle.simulate([0.0, 0.1], {"direct": 10.0}, run.final_state, voltage_v=[16.0, 16.0])
    assert run.actuators["direct"][-1] == pytest.approx(9.3, rel=1e-3)
    assert run.final_state.actuators["direct"] == run.actuators["direct"][-1]


def test_pieces_of_another_step_go_on_smoothly() -> None:
    vehicle, coarse = vehicle_with(MOTORS["all"]), [0.0, 1.0]
    held = {"direct": 10.0}
    volts = [16.0, 16.0]
    first = vehicle.simulate(coarse, held, voltage_v=volts, max_step_s=0.02).final_state
    fine = vehicle.simulate(coarse, held, first, voltage_v=volts, max_step_s=0.005)
    same = vehicle.simulate(coarse, held, first, voltage_v=volts, max_step_s=0.02)
    assert np.allclose(fine.actuators["direct"], same.actuators["direct"], atol=1e-3)


def test_candidates_start_from_the_same_memory() -> None:
    vehicle = vehicle_with(MOTORS["all"])
    commands, volts = {"direct": 10.0}, [16.0, 16.0]
    state = vehicle.simulate([0.0, 0.3], commands, voltage_v=volts).final_state
    alone = vehicle.simulate([0.0, 0.3], commands, state, voltage_v=volts)
    batch = st.simulate_batch(
        vehicle, {"X_uu": np.array([-8.0, -9.0])}, [0.0, 0.3], commands, state, voltage_v=volts
    )
    assert np.allclose(batch.actuators["direct"][0], alone.actuators["direct"], atol=1e-12)
    with pytest.raises(SimulationError, match="final_state: expected a single run, found a batch of 2"):
        _ = batch.final_state


def test_one_number_commands_the_whole_run() -> None:
    vehicle = Vehicle.load("cwolf")
    t = [0.0, 0.1, 0.2]
    name = vehicle.actuators[0]
    held = vehicle.simulate(t, {name: 800.0})
    assert np.array_equal(held.nu, vehicle.simulate(t, {name: [800.0] * 3}).nu)
    with pytest.raises(SimulationError, match="expected 3 numbers, found 1"):
        vehicle.simulate(t, {name: [800.0]})
