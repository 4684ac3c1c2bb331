"""The CasADi expressions, baseline of the benchmarks, against the textbook model."""

from __future__ import annotations

import dataclasses
import shutil

import numpy as np
import pytest

from benchmarks.textbook import simulate
from benchmarks.textbook_thrusters import Quadratic, Thruster, wrench_per_newton
from benchmarks.textbook_vehicle import Parameters, build

pytestmark = pytest.mark.long

casadi_compiled = pytest.importorskip("benchmarks.casadi_compiled", reason="CasADi is not installed")
casadi_model = pytest.importorskip("benchmarks.casadi_model", reason="CasADi is not installed")
operations = pytest.importorskip("benchmarks.operations", reason="CasADi is not installed")
needs_compiler = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")

HULL = {
    "m": 135.0, "I_x": 1.6, "I_y": 71.0, "I_z": 72.0, "B": 1329.35, "z_b": -0.02,
    "X_udot": -3.7, "Y_vdot": -128.0, "Z_wdot": -127.0, "K_pdot": -0.46, "M_qdot": -60.0, "N_rdot": -61.0,
    "X_u": -3.0, "Y_v": -20.0, "Z_w": -20.0, "K_p": -0.6, "M_q": -15.0, "N_r": -15.0,
    "X_uu": -9.8, "Y_vv": -307.0, "Z_ww": -308.0, "K_pp": -0.5, "M_qq": -150.0, "N_rr": -151.0,
    "Y_uv": -130.0, "Y_ur": 64.0, "Z_uw": -130.0, "Z_uq": -64.0,
    "M_uw": -89.0, "M_uq": -64.0, "N_uv": 89.0, "N_ur": -64.0,
}  # fmt: skip
COUPLED = HULL | {
    "x_g": 0.02, "y_g": -0.01, "z_g": 0.01, "I_xz": 0.3, "I_xy": -0.2, "I_yz": 0.1, "X_0": 0.5, "N_0": -0.2,
    "Y_rdot": 4.0, "Z_qdot": -3.0, "Y_r": 1.0, "N_v": -2.0, "N_vv": 3.0, "M_ww": -2.0,
    "C_Dy": 0.9, "C_Dz": 0.7,
}  # fmt: skip
# Two measures of a hull that is not the same fore and aft.
STRIPS = np.stack([np.linspace(-0.9, 0.7, 5), np.linspace(0.02, 0.08, 5), np.linspace(0.07, 0.03, 5)])
# CasADi gets commands that are delayed already: behind a rate limit by whole steps only.
PROPELLER = Thruster(
    name="starboard",
    wrench=wrench_per_newton([-1.08, 0.134, 0.1], [0.96, 0.28, 0.0]),
    characteristic=Quadratic(p1_ahead=0.0744, p1_astern=0.0531, p2=-0.602),
    maximum_ahead=2000.0,
    maximum_astern=1800.0,
    minimum_ahead=150.0,
    minimum_astern=150.0,
    n_acc=2000.0,
    n_dec=4000.0,
    K_V=0.95,
    T_1=0.15,
    T_t=0.125,
    wake=0.1,
    gain=1.1,
    thrust_deduction=0.05,
)
PORT = dataclasses.replace(
    PROPELLER, name="port", wrench=wrench_per_newton([-1.08, -0.134, -0.1], [0.96, -0.28, 0.0]), T_t=0.0
)
BOW = dataclasses.replace(
    PROPELLER,
    name="bow",
    wrench=wrench_per_newton([0.7, 0.0, 0.0], [0.0, 0.0, 1.0]),
    characteristic=Quadratic(p1_ahead=0.0256, p1_astern=0.0226),
    n_acc=np.inf,
    n_dec=np.inf,
    T_t=0.13,
)
SUBSTEPS = 4
T = np.arange(0.0, 30.01, 0.1)


def record(seed: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    steps = rng.uniform(-2300.0, 2300.0, size=(3, len(T) // 15 + 1))
    held = np.repeat(steps, 15, axis=1)[:, : len(T)]
    return dict(zip(("starboard", "port", "bow"), [held[0], held[1], 0.4 * held[2]], strict=True))


@needs_compiler
@pytest.mark.parametrize("hoisted", [True, False])
@pytest.mark.parametrize("coefficients", [HULL, COUPLED], ids=["diagonal", "coupled"])
def test_scalar_casadi_trajectory_equals_textbook(coefficients: dict[str, float], hoisted: bool) -> None:
    parameters = Parameters(coefficients, [PROPELLER, PORT, BOW], strips=STRIPS)
    state = np.array([0.0, 0.0, 5.0, 1.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.1, 0.0, 0.1, 0.0])
    current = np.array([0.3, -0.2, 0.0])
    commands = record(1)
    expected = simulate(
        build(parameters),
        T,
        commands,
        position=state[:3],
        attitude=state[3:7],
        nu=state[7:],
        current=current,
        substeps=SUBSTEPS,
    )
    e = casadi_model.expressions(parameters, 0.1 / SUBSTEPS, current=True, hoisted=hoisted)
    compiled = casadi_compiled.Compiled(e)
    _, states = compiled.run([e.values], T, commands, state=state, current=current, trajectory=True)
    found = np.hstack([expected.position, expected.attitude, expected.nu])
    # Rounding of two orders of summation, grown over 1200 steps.
    np.testing.assert_allclose(states[0], found, atol=1e-9)


@needs_compiler
def test_candidates_do_not_see_each_other() -> None:
    parameters = Parameters(HULL, [PROPELLER, PORT, BOW])
    e = casadi_model.expressions(parameters, 0.1 / SUBSTEPS)
    compiled = casadi_compiled.Compiled(e)
    values = e.values * np.random.default_rng(2).uniform(0.8, 1.2, size=(3, len(e.values)))
    state = np.array([0.0, 0.0, 0.0, 1.0] + [0.0] * 9)
    weight = np.ones((len(T), 12))
    together, _ = compiled.run(values, T, record(2), state=state, weight=weight)
    alone, _ = compiled.run(values[1:2], T, record(2), state=state, weight=weight)
    np.testing.assert_array_equal(together[1], alone[0])
    assert np.abs(together[0] - together[1]).max() > 1e-3


def test_operations_count_products_and_sums_only() -> None:
    ca = casadi_model.ca
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    # Two products, one sum, one square root; modulus and minimum are free.
    function = ca.Function("f", [x, y], [ca.fabs(x) * y + x * ca.fmin(x, ca.sqrt(y))])
    assert operations.operations(function) == 4


def test_operations_of_the_chain_exceed_those_of_the_hull() -> None:
    parameters = Parameters(HULL, [PROPELLER, PORT, BOW])
    hull = operations.count(parameters, motors=False)
    chain = operations.count(parameters)
    assert hull.step < chain.step
    assert hull.sample == chain.sample
    assert chain.per_step(4) == chain.step + chain.sample / 4
