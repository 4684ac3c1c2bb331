"""Exact sensitivities against the forward sensitivities that CasADi derives from its own expressions.

CasADi differentiates one RK4 step of ``benchmarks.casadi_model`` symbolically; the steps are chained here:
``S' = F_x S + F_m S_m + F_u du/dp + F_p``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import seatrial as st
from benchmarks.textbook_kinematics import quaternion_rate
from benchmarks.textbook_thrusters import static_limits
from benchmarks.textbook_vehicle import from_vehicle
from seatrial import _core

casadi_model = pytest.importorskip("benchmarks.casadi_model", reason="CasADi is not installed")
ca = casadi_model.ca

Array = NDArray[np.float64]

DT, SUBSTEPS, SAMPLES = 0.1, 2, 61
H = DT / SUBSTEPS
NUISANCES = ("current_north", "current_east", "current_down")
COUPLED = {
    "x_g": 0.02, "y_g": -0.01, "I_xz": 0.3, "Y_rdot": 4.0, "Z_qdot": -3.0, "Y_r": 1.0, "N_v": -2.0,
    "N_vv": 3.0, "M_ww": -2.0, "X_0": 0.5, "N_0": -0.2, "C_Dy": 0.6, "C_Dz": 0.5,
}  # fmt: skip
CURRENT = np.array([0.3, -0.2, 0.05])
POSITION = np.array([1.0, -2.0, 5.0])
ATTITUDE = np.array([0.9, 0.2, -0.3, 0.25]) / np.linalg.norm([0.9, 0.2, -0.3, 0.25])
NU = np.array([0.7, 0.1, -0.1, 0.1, 0.2, -0.2])


def commands(v: st.Vehicle) -> dict[str, Any]:
    """Revolutions that stand still at first and change every half a second, within the limits and beyond."""
    rng = np.random.default_rng(3)
    levels = {name: np.append(0.0, rng.uniform(-2100.0, 2100.0, size=SAMPLES // 5)) for name in v.actuators}
    return {name: np.repeat(level, 5)[:SAMPLES] for name, level in levels.items()}


def differentiated(e: Any) -> Any:
    """Next state and motors of one step, and their Jacobian by (x, motors, u, v_c, p)."""
    sizes = [casadi_model.STATES, 2 * len(e.thrusters), len(e.thrusters), 3, len(e.names)]
    x, motor, u, v_c, p = (ca.SX.sym(name, n) for name, n in zip("xmucp", sizes, strict=True))
    after = ca.vertcat(*e.step(x, motor, u, ca.SX.zeros(6), v_c, p, e.constants(p)))
    jacobian = ca.jacobian(after, ca.vertcat(x, motor, u, v_c, p))
    return ca.Function("step", [x, motor, u, v_c, p], ca.cse([after, jacobian]))


def forward(e: Any, given: dict[str, Any]) -> tuple[Array, Array]:
    """Channels (n, 12) and their derivatives (n, 12, m) by coefficients, current and initial conditions."""
    step, a, m = differentiated(e), len(e.thrusters), len(e.names) + 15
    state = ca.SX.sym("x", casadi_model.STATES)
    shown = e.channels(state)
    show = ca.Function("show", [state], [shown, ca.jacobian(shown, state)])
    held = np.column_stack([static_limits(t, given[t.name]) for t in e.thrusters])
    late = [e.names.index(f"{t.name}.T_t") for t in e.thrusters]
    n_x, n_m, n_p = casadi_model.STATES, 2 * a, len(e.names)
    x, motor = np.concatenate([POSITION, ATTITUDE, NU]), np.zeros(n_m)
    S, S_m = np.zeros((n_x, m)), np.zeros((n_m, m))
    S[:3, n_p + 3 : n_p + 6] = np.eye(3)
    # A small turn about the body axes moves the quaternion like a body rate.
    S[3:7, n_p + 6 : n_p + 9] = np.column_stack([quaternion_rate(ATTITUDE, axis) for axis in np.eye(3)])
    S[7:, n_p + 9 :] = np.eye(6)
    rows, derivatives = [], []
    for k in range(SAMPLES):
        y, Y_x = (np.asarray(result) for result in show(x))
        rows.append(y[:, 0])
        derivatives.append(Y_x @ S)
        if k == SAMPLES - 1:
            break
        for j in range(k * SUBSTEPS, (k + 1) * SUBSTEPS):
            u, U = np.zeros(a), np.zeros((a, m))
            for i in range(a):
                dead = e.values[late[i]] / H
                whole = int(dead)
                newer, older = (held[max(0, j - back) // SUBSTEPS, i] for back in (whole, whole + 1))
                u[i] = newer + (dead - whole) * (older - newer)
                U[i, late[i]] = (older - newer) / H
            after, J = (np.asarray(result) for result in step(x, motor, u, CURRENT, e.values))
            ends = np.cumsum([n_x, n_m, a, 3])
            by_x, by_motor, by_u, by_current, by_p = np.split(J, ends, axis=1)
            moved = by_x @ S + by_motor @ S_m + by_u @ U
            moved[:, :n_p] += by_p
            moved[:, n_p : n_p + 3] += by_current
            x, motor, S, S_m = after[:n_x, 0], after[n_x:, 0], moved[:n_x], moved[n_x:]
    return np.array(rows), np.array(derivatives)


@pytest.mark.parametrize("changed", [{}, COUPLED], ids=["diagonal", "coupled"])
def test_scalar_sensitivities_equal_those_of_casadi(changed: dict[str, float]) -> None:
    own = st.Vehicle.load("cwolf")
    # Each motor its own dead time, of whole steps: CasADi gets commands that are delayed already.
    late = {f"{name}.T_t": H * (1.0 + i) for i, name in enumerate(own.actuators)}
    v = own.with_coefficients(changed | late)
    given = commands(v)
    e = casadi_model.expressions(from_vehicle(v), H, current=True, hoisted=False)
    rows, expected = forward(e, given)
    record = _core.Record(np.arange(SAMPLES) * DT, given, current=CURRENT)
    start = (0, 0, SAMPLES, POSITION, ATTITUDE, NU)
    loop = _core.OpenLoop(v, [record], [start], names=list(e.names), substeps=SUBSTEPS)
    initials = _core.initial_names()
    ((shown, found),) = loop.sensitivities(e.values, nuisances=list(NUISANCES), initials=initials)
    assert found.shape == expected.shape
    # Two orders of the same sums over 120 steps, relative to the largest derivative of channel and unknown.
    np.testing.assert_allclose(shown, rows, atol=1e-10)
    unknowns = [*e.names, *NUISANCES, *initials]
    # A delayed ramp is not a ramp to a delayed command: quotients hold its derivative in test_sensitivities.
    same = [i for i, name in enumerate(unknowns) if name not in late]
    size = np.maximum(1e-6, np.abs(expected).max(axis=0))[:, same]
    np.testing.assert_allclose(found[:, :, same] / size, expected[:, :, same] / size, rtol=0.0, atol=1e-9)
    # All but the initial place is at work in the surge velocity.
    idle = {
        name
        for name, largest in zip(unknowns, np.abs(found[:, 0]).max(axis=0), strict=True)
        if largest == 0.0
    }
    assert idle == {"initial_x", "initial_y", "initial_z"}
