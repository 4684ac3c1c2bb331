"""Errata of the paper's actuators, control and guidance, (35) to (57), as plain formulas in numbers.

The printed form and the corrected one act on CWolf as the core simulates it, or on an example that the test
describes; docs/errata.md quotes the numbers.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.textbook_thrusters import wrench_per_newton
from seatrial._core import State, Vehicle
from seatrial.report.plot.performance import thrust

Array = NDArray[np.float64]

CWOLF = Vehicle.load("cwolf")
DRIVEN = [0, 2, 4, 5]  # surge, heave, pitch, yaw: what CWolf's actuators can command


def test_errata_35_the_advance_speed_is_no_part_of_p_2() -> None:
    facts, direction = CWOLF.actuator_info()["SbU"], np.asarray(CWOLF.allocation_matrix())[0, 0]
    # [A] in the vehicle file: alpha_2 = -0.34, d = 0.12 m, w = 0.1.
    alpha_2 = -0.34 * 1025.0 * 0.12**3
    assert facts["characteristic"] == "quadratic"
    n = np.array([600.0, 1000.0, 1600.0])
    at_rest = thrust(CWOLF, "SbU", n)
    for speed in (0.5, 1.0, 2.0):
        V_a = 0.9 * direction * speed
        p_2 = (thrust(CWOLF, "SbU", n, speed_m_s=speed) - at_rest) / (n / 60.0 * V_a)
        # One constant at every speed and revolution; the brace of (35) would make it alpha_2 rho d^3
        # V_a, zero at rest and four times as large at 2 m/s as at 0.5. Tolerance: the lag of the motor.
        np.testing.assert_allclose(p_2, alpha_2, rtol=1e-6)


def test_errata_36_an_intercept_is_thrust_at_standstill() -> None:
    """A load cell that reads 4 N too much: all of it becomes a_0, and CWolf swims with its motors stopped."""
    n = np.linspace(200.0, 2000.0, 40) / 2000.0
    pulled = 330.0 * n**2 + 4.0
    a_0 = np.linalg.lstsq(np.vander(n, 3, increasing=True), pulled, rcond=None)[0][0]
    assert a_0 == pytest.approx(4.0, abs=1e-9)
    t = np.arange(0.0, 400.0, 0.1)
    run = CWOLF.simulate(t, {}, free="X", tau=np.tile([a_0, 0.0, 0.0, 0.0, 0.0, 0.0], (len(t), 1)))
    assert run.nu[-1, 0] == pytest.approx(0.50, abs=5e-3)


def test_errata_49_the_inverse_of_the_allocation_does_not_exist() -> None:
    rng = np.random.default_rng(0)
    for _ in range(2000):
        a, b = np.deg2rad(rng.uniform(5.0, 40.0, 2))
        x, y, z, bow, stern = rng.uniform([-1.25, 0.05, 0.05, 0.3, -1.0], [-0.8, 0.2, 0.2, 1.0, -0.3])
        columns = [
            wrench_per_newton(
                [x, side * y, deep * z],
                np.array([np.cos(b) * np.cos(a), side * np.cos(b) * np.sin(a), deep * np.sin(b)]),
            )
            for side, deep in ((1, -1), (1, 1), (-1, -1), (-1, 1))
        ]
        columns += [wrench_per_newton([at, 0.0, 0.0], np.array([0.0, 0.0, 1.0])) for at in (bow, stern)]
        # Sway and yaw of the stern propellers are proportional, and nothing else gives either.
        assert np.linalg.matrix_rank(np.stack(columns, axis=1), tol=1e-10) == 5
    B = np.asarray(CWOLF.allocation_matrix())
    sizes = np.linalg.svd(B, compute_uv=False)
    assert sizes[5] < 1e-12 * sizes[0]
    assert sizes[4] == pytest.approx(0.00236, abs=1e-5)
    assert sizes[0] / sizes[4] == pytest.approx(790.0, rel=1e-3)
    assert np.linalg.cond(B[DRIVEN]) == pytest.approx(2.36, abs=5e-3)
    # A demand of the controlled rows is met by forces of its own size; 1 N m of roll is not.
    demand = np.array([40.0, 10.0, 5.0, 8.0])
    forces = np.linalg.pinv(B[DRIVEN]) @ demand
    np.testing.assert_allclose(B[DRIVEN] @ forces, demand, rtol=1e-12)
    assert np.abs(forces).max() < 20.0
    assert np.abs(np.linalg.pinv(B, rcond=1e-5) @ [0, 0, 0, 1.0, 0, 0]).max() > 200.0


@pytest.mark.parametrize(
    ("ahead", "miss_deg"),
    [
        ([20.0, 0.0, 10.0], 53.1),
        ([10.0, 0.0, 10.0], 90.0),
        ([0.0, 20.0, 10.0], 116.6),
        ([-20.0, 0.0, 0.0], 180.0),
    ],
)
def test_errata_51_pitch_towards_a_waypoint(ahead: list[float], miss_deg: float) -> None:
    dx, dy, dz = ahead
    psi = np.arctan2(dy, dx)

    def flown(theta: float) -> Array:
        """Where the core's vehicle is after as many seconds at 1 m/s as the waypoint is metres away."""
        distance = float(np.linalg.norm(ahead))
        start = State(attitude=[0.0, theta, psi], nu=[1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        position: Array = CWOLF.simulate([0.0, distance], {}, start, free="").position[-1]
        return position

    np.testing.assert_allclose(flown(np.arctan2(-dz, np.hypot(dx, dy))), ahead, atol=1e-9)
    printed = flown(np.arctan2(dz, dx))
    cosine = float(printed @ ahead) / float(np.dot(ahead, ahead))
    # Printed digits; the arc cosine near -1 leaves the root of the rounding.
    assert np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))) == pytest.approx(miss_deg, abs=0.05)


def test_errata_51_pursuit_increases_the_cross_track_error() -> None:
    """The bow on the waypoint 100 m ahead, 1 m/s through the water, 0.4 m/s of it across."""
    length, across, dt = 100.0, 0.4, 0.05
    place, track = np.zeros(2), []
    while length - place[0] > 1.0:
        psi = np.arctan2(-place[1], length - place[0])
        place = place + dt * np.array([np.cos(psi), np.sin(psi) + across])
        track.append(place)
    x, xte = np.array(track).T
    # The pursuit curve in a stream: with s the share of the way that is left, (s^(1-k) - s^(1+k)) L/2.
    s = np.linspace(0.01, 1.0, 1000)
    curve = 0.5 * length * (s ** (1.0 - across) - s ** (1.0 + across))
    np.testing.assert_allclose(
        np.interp(length * (1.0 - s[::-1]), x, xte), curve[::-1], atol=0.1
    )  # of the step
    assert xte.max() == pytest.approx(15.1, abs=0.1)
    assert np.all(np.diff(xte)[x[1:] < 60.0] > 0.0)


def test_errata_54_a_scheduled_gain_on_a_raw_sum_jumps() -> None:
    # CWolf's surge speed at 10 Hz, K_P = 77 N s/m; K_I per sample 1.7 N s/m at 2.5 m/s, 1.2 at 2.0 m/s.
    def K_I(u_d: float) -> float:
        return float(np.interp(u_d, [1.0, 3.0], [0.2, 2.2]))

    u, raw, stored, e = 0.0, 0.0, 0.0, 0.0
    parts = []
    for k in range(1500):
        u_d = 2.5 if k < 1200 else 2.0
        raw, stored = raw + e, stored + K_I(u_d) * e
        parts.append((K_I(u_d) * raw, stored))
        e = u_d - u
        tau = np.tile([77.0 * e + stored, 0.0, 0.0, 0.0, 0.0, 0.0], (2, 1))
        run = CWOLF.simulate([0.0, 0.1], {}, State(nu=[u, 0, 0, 0, 0, 0]), free="X", tau=tau)
        u = float(run.nu[-1, 0])
    printed, corrected = np.array(parts).T
    np.testing.assert_allclose(printed[:1200], corrected[:1200], rtol=1e-9)
    # The sum carries the drag at 2.5 m/s.
    drag = -np.asarray(CWOLF.forces([2.5, 0, 0, 0, 0, 0], np.zeros(3))["damping"])[0]
    assert corrected[1199] == pytest.approx(drag, rel=1e-3)
    assert printed[1200] - printed[1199] == pytest.approx(-20.2, abs=0.05)  # N, at once
    assert abs(corrected[1200] - corrected[1199]) < 0.01


def test_errata_57_the_upper_violation_counts_from_the_upper_bound() -> None:
    t = np.linspace(0.0, 20.0, 20001)
    lower, upper = np.where(t < 3.0, 0.0, 0.9), np.full(len(t), 1.1)

    def Q(y: Array, above: Array) -> float:
        under, over = lower >= y, upper <= y
        return float(np.trapezoid(under * (lower - y) + over * (y - above), t))

    # Second-order set-point response, damping ratio 0.5, 1 rad/s: overshoot 16 %.
    omega = np.sqrt(0.75)
    y = 1.0 - np.exp(-0.5 * t) * (np.cos(omega * t) + 0.5 / omega * np.sin(omega * t))
    assert y.max() == pytest.approx(1.163, abs=5e-4)
    # Quoted digits; the grid of 1 ms leaves 1e-4.
    assert Q(y, lower) == pytest.approx(0.593, abs=1e-3)
    assert Q(y, upper) == pytest.approx(0.077, abs=1e-3)
    # Where a response comes to rest at the bound, the printed criterion jumps by width times time.
    rising = np.minimum(t / 3.0, 1.0)
    inside, touching = (1.1 - 1e-9) * rising, 1.1 * rising
    assert Q(touching, upper) - Q(inside, upper) == pytest.approx(0.0, abs=1e-6)
    assert Q(touching, lower) - Q(inside, lower) == pytest.approx(0.2 * 17.0, rel=1e-3)


def restoring(theta: float, *, printed: bool) -> float:
    """Pitch row of g: the core's own, or with the sign of (33) as printed."""
    g = -float(CWOLF.forces(np.zeros(6), [0.0, theta, 0.0])["restoring"][4])
    return -g if printed else g


def pitch(plant: bool, feed_forward: bool | None, demand: float, *, theta: float = 0.0) -> Array:
    """Pitch (n,) over 60 s by RK4 at 0.02 s under a PD controller, with the printed signs or without.

    (6) subtracts g of the plant, (49) adds g of the feed-forward; None: no controller at all.
    """
    inertia = float(np.asarray(CWOLF.mass_matrix())[4, 4])

    def rate(x: Array) -> Array:
        damping = float(CWOLF.forces([0, 0, 0, 0, x[1], 0], np.zeros(3))["damping"][4])
        moment = damping - restoring(x[0], printed=plant)
        if feed_forward is not None:
            moment += 47.3 * (demand - x[0]) - 110.0 * x[1] + restoring(x[0], printed=feed_forward)
        return np.array([x[1], moment / inertia])

    return _runge_kutta(rate, np.array([theta, 0.0]), h=0.02, steps=3000)[:, 0]


def _runge_kutta(rate: Callable[[Array], Array], x: Array, *, h: float, steps: int) -> Array:
    found = [x]
    for _ in range(steps):
        a = rate(x)
        b = rate(x + 0.5 * h * a)
        c = rate(x + 0.5 * h * b)
        d = rate(x + h * c)
        x = x + h / 6.0 * (a + 2.0 * (b + c) + d)
        found.append(x)
    return np.array(found)


def test_errata_33_the_wrong_sign_cancels_in_closed_loop_and_shows_in_open_loop() -> None:
    demand = np.deg2rad(20.0)
    right = pitch(False, False, demand)
    # Wrong in the model and in the controller alike: nothing is seen. Rounding.
    np.testing.assert_allclose(pitch(True, True, demand), right, atol=1e-9)
    assert np.rad2deg(right[-1]) == pytest.approx(20.0, abs=0.01)
    # Open loop, one degree of pitch to begin with: the right plant swings, the printed one turns over.
    start = np.deg2rad(1.0)
    assert np.abs(pitch(False, None, 0.0, theta=start)).max() <= start * (1.0 + 1e-9)
    assert np.rad2deg(pitch(True, None, 0.0, theta=start).max()) > 90.0
    # The controller tuned on the wrong model meets the real vehicle: it stops short of the demand.
    assert np.rad2deg(pitch(False, True, demand)[-1]) == pytest.approx(9.5, abs=0.1)
