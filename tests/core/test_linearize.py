"""A and B of the core against difference quotients of the textbook model, which knows nothing of the core."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import seatrial as st
from benchmarks import textbook as tb
from benchmarks import textbook_kinematics as kin
from benchmarks.textbook_vehicle import build, from_vehicle
from seatrial.base.errors import SimulationError

Array = NDArray[np.float64]

EVERY_TERM = Path(__file__).with_name("every_term.toml")
STEP = 1e-5
# Of a central difference, relative to the largest entry of the row: rounding 1e-15/STEP, and STEP squared
# times a third derivative (1/cos^2 of the pitch).
QUOTIENT = 1e-8

VEHICLES = pytest.mark.parametrize("name", ["cwolf", "beluga", "every_term"])
CURRENTS = pytest.mark.parametrize("current", [None, (0.4, -0.3, 0.1)], ids=["still", "current"])


def vehicle(name: str) -> st.Vehicle:
    return st.Vehicle.load(EVERY_TERM if name == "every_term" else name)


def turned(q: Array, delta: Array) -> Array:
    """The attitude R(q) exp(S(delta)) as a quaternion (4,)."""
    angle = float(np.linalg.norm(delta))
    half = 0.5 * delta if angle == 0.0 else np.sin(0.5 * angle) * delta / angle
    # q (x) [0, a] is twice the quaternion's rate at omega = a.
    return np.asarray(np.cos(0.5 * angle) * q + 2.0 * kin.quaternion_rate(q, half))


def rotation_rate(model: tb.Model, q_0: Array, v_c: Array) -> Callable[[Array], Array]:
    """[p_n', nu'] (9,) of [p_n, delta, nu, tau] (18,), R = R_0 exp(S(delta))."""

    def rate(x: Array) -> Array:
        q, nu = turned(q_0, x[3:6]), x[6:12]
        nu_rate = tb.acceleration(model, nu, q, x[12:], v_c=v_c)
        return np.concatenate([kin.rotation(q) @ nu[:3], nu_rate])

    return rate


def euler_rate(model: tb.Model, v_c: Array) -> Callable[[Array], Array]:
    """[eta', nu'] (12,) of [eta, nu, tau] (18,)."""

    def rate(x: Array) -> Array:
        roll, pitch, yaw = x[3:6]
        nu_rate = tb.acceleration(model, x[6:12], kin.quaternion(roll, pitch, yaw), x[12:], v_c=v_c)
        return np.concatenate([kin.euler_jacobian(roll, pitch, yaw) @ x[6:12], nu_rate])

    return rate


def quotients(rate: Callable[[Array], Array], x: Array) -> Array:
    """Derivatives (rows, 18) of ``rate`` at ``x`` by central differences."""
    ahead = [rate(x + step) for step in STEP * np.eye(len(x))]
    back = [rate(x - step) for step in STEP * np.eye(len(x))]
    return np.asarray((np.array(ahead) - np.array(back)).T / (2.0 * STEP))


def close(found: Array, expected: Array, tolerance: float = QUOTIENT) -> None:
    size = np.maximum(1.0, np.abs(expected).max(axis=1, keepdims=True))
    np.testing.assert_allclose(found / size, expected / size, rtol=0.0, atol=tolerance)


def points(seed: int) -> list[tuple[Array, Array, Array]]:
    """Velocities (6,), roll, pitch and yaw (3,) and wrenches (6,)."""
    rng = np.random.default_rng(seed)
    angles = rng.uniform([-3.0, -1.2, -3.0], [3.0, 1.2, 3.0], size=(8, 3))
    return list(zip(rng.normal(size=(8, 6)), angles, 20.0 * rng.normal(size=(8, 6)), strict=True))


@VEHICLES
@CURRENTS
def test_scalar_rotation_form_is_the_quotient_of_the_textbook_model(
    name: str, current: tuple[float, float, float] | None
) -> None:
    v = vehicle(name)
    model = build(from_vehicle(v))
    v_c = np.zeros(3) if current is None else np.array(current)
    for nu, angles, tau in points(1):
        q = kin.quaternion(*angles)
        A, B = v.linearize(nu, q, tau, current)
        assert A.shape == (12, 12)
        assert B.shape == (12, 6)
        x = np.concatenate([np.zeros(6), nu, tau])
        rows = [0, 1, 2, 6, 7, 8, 9, 10, 11]
        close(np.hstack([A, B])[rows], quotients(rotation_rate(model, q, v_c), x))
        # delta' = omega + 1/2 delta x omega + ...
        turning = np.hstack([np.zeros((3, 3)), -0.5 * kin.skew(nu[3:]), np.zeros((3, 3)), np.eye(3)])
        np.testing.assert_array_equal(A[3:6], turning)
        np.testing.assert_array_equal(B[:6], np.zeros((6, 6)))


@VEHICLES
@CURRENTS
def test_scalar_euler_form_is_the_quotient_of_the_textbook_model(
    name: str, current: tuple[float, float, float] | None
) -> None:
    v = vehicle(name)
    model = build(from_vehicle(v))
    v_c = np.zeros(3) if current is None else np.array(current)
    for nu, angles, tau in points(2):
        A, B = v.linearize(nu, angles, tau, current, form="euler")
        x = np.concatenate([np.zeros(3), angles, nu, tau])
        close(np.hstack([A, B]), quotients(euler_rate(model, v_c), x))


@VEHICLES
def test_law_the_input_matrix_is_the_inverse_of_the_mass(name: str) -> None:
    v = vehicle(name)
    nu, angles, tau = points(3)[0]
    for form in ("rotation", "euler"):
        _, B = v.linearize(nu, angles, tau, form=form)
        # Rounding of an inverse whose condition number is about 100.
        np.testing.assert_allclose(v.mass_matrix() @ B[6:], np.eye(6), atol=1e-12)


@VEHICLES
def test_law_place_and_heading_matter_for_the_track_alone(name: str) -> None:
    v = vehicle(name)
    nu, angles, tau = points(4)[0]
    A, _ = v.linearize(nu, angles, tau, form="euler")
    np.testing.assert_array_equal(A[:, :3], np.zeros((12, 3)))
    # Still water: no heading is better than another; the sine and cosine of the yaw are rounded.
    np.testing.assert_allclose(A[6:, 5], np.zeros(6), atol=1e-12)


@VEHICLES
def test_law_the_tangent_predicts_the_motion_beside_a_run(name: str) -> None:
    v = vehicle(name)
    # The tangent holds the actuators' wrench; a fin's changes with the motion.
    fins = [actuator for actuator, info in v.actuator_info().items() if info["kind"] == "fin"]
    v = v.with_coefficients({f"{fin}.gain": 0.0 for fin in fins})
    nu, angles, tau = np.array([1.0, 0.2, -0.1, 0.1, 0.2, -0.3]), np.array([0.2, -0.3, 2.0]), np.full(6, 5.0)
    dt, change = 1e-3, 1e-4
    wrench = np.tile(tau, (2, 1))
    idle = {name: np.full(2, info["neutral"]) for name, info in v.actuator_info().items()}

    def state_after(x: Array) -> Array:
        roll, pitch, yaw = x[3:6]
        initial = st.State(x[:3], kin.quaternion(roll, pitch, yaw), x[6:])
        voltage = np.full(2, 15.0)
        run = v.simulate([0.0, dt], idle, initial, tau=wrench, voltage_v=voltage, max_step_s=dt)
        return np.concatenate([run.position[-1], kin.euler(run.attitude[-1]), run.nu[-1]])

    x_0 = np.concatenate([np.zeros(3), angles, nu])
    A, _ = v.linearize(nu, angles, tau, form="euler")
    steps = change * np.eye(12)
    moved = np.array([state_after(x_0 + step) - state_after(x_0 - step) for step in steps]).T / (2.0 * change)
    # What A itself changes along the step: dt^2 |A'|/2 with |A'| up to a few per second; dt A is up to 0.01.
    np.testing.assert_allclose(moved, np.eye(12) + dt * A + 0.5 * dt**2 * A @ A, atol=3e-6)
    assert np.abs(moved - np.eye(12)).max() > 1e-3


def test_an_attitude_is_a_quaternion_or_euler_angles() -> None:
    v = vehicle("cwolf")
    nu, angles, tau = points(5)[0]
    for form in ("rotation", "euler"):
        one = v.linearize(nu, angles, tau, form=form)
        other = v.linearize(nu, kin.quaternion(*angles), tau, form=form)
        # The same rotation by two orders of the same products.
        np.testing.assert_allclose(one[0], other[0], atol=1e-11)
        np.testing.assert_allclose(one[1], other[1], atol=1e-11)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"form": "quaternion"}, 'form: expected rotation or euler, found "quaternion"'),
        ({"nu": np.zeros(5)}, r"nu: expected shape \(n, 6\) or \(6,\), found \[5\]"),
        ({"nu": np.zeros((2, 6))}, "expected one row each"),
        ({"tau": np.zeros((2, 6))}, r"tau: expected shape \(6,\), found \[2, 6\]"),
        ({"attitude": np.zeros(4)}, "attitude: row 0 is no rotation"),
        ({"current": np.zeros((3, 3))}, "expected one row each"),
    ],
)
def test_what_does_not_fit_is_named(changed: dict[str, object], message: str) -> None:
    given: dict[str, object] = {"nu": np.zeros(6), "attitude": np.zeros(3), "tau": np.zeros(6)}
    with pytest.raises(SimulationError, match=message):
        vehicle("cwolf").linearize(**(given | changed))  # type: ignore[arg-type]
