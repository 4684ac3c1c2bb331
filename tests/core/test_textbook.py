"""The plain NumPy model, reference of other tests, against published numbers and conservation laws."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks import textbook as tb
from benchmarks import textbook_kinematics as kin
from benchmarks.textbook_geometry import lamb_factors, spheroid_added_mass
from benchmarks.textbook_vehicle import Parameters, build

Array = NDArray[np.float64]

# Double precision leaves a few ulp in sums of about ten terms of size 1e3.
ROUNDING = 1e-12

# A vehicle with every term in play: no symmetry, no zero lever.
GENERAL = {
    "m": 120.0,
    "I_x": 9.0,
    "I_y": 50.0,
    "I_z": 52.0,
    "I_xy": 0.7,
    "I_xz": -1.1,
    "I_yz": 0.4,
    "x_g": 0.03,
    "y_g": -0.01,
    "z_g": 0.05,
    "x_b": -0.02,
    "y_b": 0.004,
    "z_b": -0.03,
    "B": 1190.0,
    "X_udot": -6.0,
    "Y_vdot": -90.0,
    "Z_wdot": -95.0,
    "K_pdot": -2.0,
    "M_qdot": -40.0,
    "N_rdot": -38.0,
    "Y_rdot": 3.0,
    "Z_qdot": -2.5,
    "Y_pdot": 0.6,
    "X_qdot": 0.8,
    "X_u": -4.0,
    "Y_v": -20.0,
    "Z_w": -22.0,
    "K_p": -3.0,
    "M_q": -14.0,
    "N_r": -15.0,
    "Y_r": 1.0,
    "N_v": 1.0,
    "X_uu": -12.0,
    "Y_vv": -250.0,
    "Z_ww": -260.0,
    "K_pp": -4.0,
    "M_qq": -120.0,
    "N_rr": -130.0,
    "Y_rr": 2.0,
    "Y_uv": -60.0,
    "Y_ur": 20.0,
    "Z_uw": -60.0,
    "Z_uq": -20.0,
    "M_uw": -30.0,
    "M_uq": -20.0,
    "N_uv": 30.0,
    "N_ur": -20.0,
}
# The starboard mirror image keeps these and changes the sign of the other half of the motion.
MIRROR = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])


def undamped() -> dict[str, float]:
    inertial = {k: v for k, v in GENERAL.items() if k[0] in "mIxyzB" or k.endswith("dot")}
    return {**inertial, "m": 120.0}


def still(model: tb.Model, seconds: float, h: float, **state: Array) -> tb.Trajectory:
    return tb.simulate(model, np.arange(round(seconds / h) + 1) * h, {}, **state)  # type: ignore[arg-type]


def random_attitude(rng: np.random.Generator) -> Array:
    q = rng.normal(size=4)
    return np.asarray(q / np.linalg.norm(q))


def test_golden_mss_rbody() -> None:
    m, r_g = 20.0, np.array([0.05, -0.01, 0.02])
    I_g = m * np.diag([0.3, 0.5, 0.6]) ** 2
    I_O = I_g - m * kin.skew(r_g) @ kin.skew(r_g)
    M = tb.rigid_body_mass(m, r_g, I_O)
    np.testing.assert_allclose(
        M[3:, 3:], [[1.81, 0.01, -0.02], [0.01, 5.058, 0.004], [-0.02, 0.004, 7.252]], atol=ROUNDING
    )
    np.testing.assert_allclose(M[:3, 3:], [[0, 0.4, 0.2], [-0.4, 0, 1], [-0.2, -1, 0]], atol=ROUNDING)
    omega = np.array([0.1, -0.2, 0.3])
    # Several skew-symmetric C_RB give one force: compare the published block and (21) after multiplication.
    published = np.array([[0.0, 2.1548, 0.9974], [-2.1548, 0.0, 0.167], [-0.9974, -0.167, 0.0]])
    nu = np.concatenate([np.zeros(3), omega])
    force = tb.rigid_body_coriolis(nu, m, r_g, I_O) @ nu
    np.testing.assert_allclose(force[3:], published @ omega, atol=ROUNDING)


def test_golden_mss_gvect() -> None:
    W, g = 320.0, 10.0
    model = build(
        Parameters(
            {"m": W / g, "I_x": 1, "I_y": 1, "I_z": 1, "B": 318.0}
            | {"x_g": 0.01, "y_g": 0.02, "z_g": 0.03, "x_b": 0.005, "y_b": -0.01},
            g=g,
        )
    )
    expected = [0.3973386615901224, 0.1956867900145114, -1.950340654403632]
    expected += [-10.28142832666305, 3.477249802427512, -1.745724323055005]
    R = kin.rotation(kin.quaternion(-0.1, 0.2, 0.7))
    np.testing.assert_allclose(tb.restoring(R, model), expected, rtol=1e-12)


def test_golden_mss_imlay61() -> None:
    expected = [0.8389085933377652, 29.43763661573727, 29.43763661573727]
    expected += [0.03360482392879167, 3.426210114723613, 3.426210114723613]
    # 1e-9: the logarithm of (1 + e)/(1 - e) loses digits on a slender body.
    np.testing.assert_allclose(spheroid_added_mass(0.8, 0.095, rho=1026.0, r44=0.3), expected, rtol=1e-9)


def test_golden_lamb_factors_of_cwolf_spheroid() -> None:
    # Published to five decimals.
    np.testing.assert_allclose(lamb_factors(1.25, 0.15), [0.02748, 0.94791, 0.84841], atol=5e-6)


def test_golden_gz_sim_added_mass_coriolis() -> None:
    # Their M_A holds the negative derivatives -1 ... -6 themselves, hence the opposite sign.
    C = -tb.added_mass_coriolis(np.arange(1.0, 7.0), -np.diag(np.arange(1.0, 7.0)))
    np.testing.assert_allclose(
        [C[0, 4], C[0, 5], C[3, 4], C[3, 5], C[4, 5]], [9, -4, 36, -25, 16], atol=ROUNDING
    )


def test_lit_da_silva_2007_lauv_straight_trim() -> None:
    hull = {"m": 18.0, "I_x": 0.04, "I_y": 2.1, "I_z": 2.1, "B": 18.0 * 9.81}
    model = build(Parameters({**hull, "X_u": -2.4, "X_uu": -2.4}))
    nu = np.array([1.43, 0, 0, 0, 0, 0])
    # Published to four decimals.
    drag = tb.forces(model, nu, np.eye(3))["damping"]
    np.testing.assert_allclose(drag, [-8.3398, 0, 0, 0, 0, 0], atol=5e-5)
    at_trim = tb.acceleration(model, nu, [1, 0, 0, 0], [8.3398, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(at_trim, np.zeros(6), atol=1e-5)


def test_lit_fossen_1994_diagonal_added_mass_coriolis() -> None:
    X, Y, Z, K, M, N = -6.0, -90.0, -95.0, -2.0, -40.0, -38.0
    u, v, w, p, q, r = 1.1, -0.3, 0.2, 0.5, -0.4, 0.6
    expected = np.array([
        [0, 0, 0, 0, -Z * w, Y * v],
        [0, 0, 0, Z * w, 0, -X * u],
        [0, 0, 0, -Y * v, X * u, 0],
        [0, -Z * w, Y * v, 0, -N * r, M * q],
        [Z * w, 0, -X * u, N * r, 0, -K * p],
        [-Y * v, X * u, 0, -M * q, K * p, 0],
    ])
    C = tb.added_mass_coriolis(np.array([u, v, w, p, q, r]), -np.diag([X, Y, Z, K, M, N]))
    np.testing.assert_allclose(C, expected, atol=ROUNDING)


def test_law_coriolis_matrices_are_skew_and_do_no_work() -> None:
    model, rng = build(Parameters(GENERAL)), np.random.default_rng(1)
    for nu in rng.normal(size=(20, 6)):
        for C in (
            tb.rigid_body_coriolis(nu, model.m, model.r_g, model.I_O),
            tb.added_mass_coriolis(nu, model.M_A),
        ):
            np.testing.assert_allclose(C, -C.T, atol=ROUNDING)
            assert abs(nu @ C @ nu) < 1e-10  # ulp of terms of size 1e3


def test_law_coriolis_equals_newton_euler() -> None:
    model, rng = build(Parameters(GENERAL)), np.random.default_rng(2)
    m, r_g, I_O = model.m, model.r_g, model.I_O
    for nu in rng.normal(size=(20, 6)):
        v, omega = nu[:3], nu[3:]
        force = m * (np.cross(omega, v) + np.cross(omega, np.cross(omega, r_g)))
        moment = np.cross(omega, I_O @ omega) + m * np.cross(r_g, np.cross(omega, v))
        np.testing.assert_allclose(
            tb.rigid_body_coriolis(nu, m, r_g, I_O) @ nu, np.concatenate([force, moment]), atol=1e-10
        )


def test_law_added_mass_obeys_kirchhoff() -> None:
    model, rng = build(Parameters(GENERAL)), np.random.default_rng(3)
    for nu in rng.normal(size=(20, 6)):
        momentum = model.M_A @ nu
        linear, angular = momentum[:3], momentum[3:]
        expected = np.concatenate([
            np.cross(nu[3:], linear),
            np.cross(nu[3:], angular) + np.cross(nu[:3], linear),
        ])
        np.testing.assert_allclose(tb.added_mass_coriolis(nu, model.M_A) @ nu, expected, atol=1e-10)


def test_law_restoring_is_the_gradient_of_potential_energy() -> None:
    model, rng = build(Parameters(GENERAL)), np.random.default_rng(4)

    def potential(p: Array, q: Array) -> float:
        R = kin.rotation(q)
        return float(-model.W * (p + R @ model.r_g)[2] + model.B * (p + R @ model.r_b)[2])

    step = 1e-5
    for _ in range(5):
        q, nu = random_attitude(rng), rng.normal(size=6)
        R = kin.rotation(q)

        def moved(h: float, q: Array = q, nu: Array = nu, R: Array = R) -> float:
            turned = q + h * kin.quaternion_rate(q, nu[3:])
            return potential(h * R @ nu[:3], turned / np.linalg.norm(turned))

        power = (moved(step) - moved(-step)) / (2 * step)
        # Central difference: error step^2 times third derivatives of size 1e2.
        assert tb.restoring(R, model) @ nu == pytest.approx(power, abs=1e-6)


def test_law_undamped_motion_conserves_energy_to_fourth_order() -> None:
    model = build(Parameters(undamped()))
    nu = np.array([0.5, 0.1, -0.2, 0.8, -0.6, 0.7])

    def drift(h: float) -> float:
        run = still(model, 4.0, h, nu=nu)
        energy = [
            0.5 * v @ model.M @ v
            - model.W * (p + kin.rotation(q) @ model.r_g)[2]
            + model.B * (p + kin.rotation(q) @ model.r_b)[2]
            for p, q, v in zip(run.position, run.attitude, run.nu, strict=True)
        ]
        return abs(float(energy[-1] - energy[0])) / float(0.5 * nu @ model.M @ nu)

    coarse, fine = drift(0.04), drift(0.02)
    assert coarse > 16.0 * fine
    assert fine < 1e-6


@pytest.mark.long
def test_law_galilean_current_equals_still_water() -> None:
    # Neutrally buoyant in a uniform current: only the motion through the water counts.
    model = build(Parameters(GENERAL))
    nu, q = np.array([1.0, 0.1, -0.1, 0.1, 0.05, 0.3]), kin.quaternion(0.1, -0.1, 0.4)
    current = np.array([0.4, -0.3, 0.05])
    drifting = nu + np.concatenate([kin.rotation(q).T @ current, np.zeros(3)])
    t = np.arange(0.0, 60.01, 0.02)
    tau = np.tile([30.0, 2.0, 1.0, 0.5, -1.0, 6.0], (len(t), 1))
    at_rest = tb.simulate(model, t, {}, attitude=q, nu=nu, tau=tau)
    carried = tb.simulate(model, t, {}, attitude=q, nu=drifting, tau=tau, current=current)
    apart = carried.position - at_rest.position - t[:, None] * current
    # Only the truncation of RK4 differs between the two frames.
    assert np.abs(apart).max() < 1e-6


def test_law_galilean_holds_for_an_accelerating_current() -> None:
    # In a uniformly accelerating frame the body feels the fluid's pressure gradient on its added mass only.
    model = build(Parameters({k: v for k, v in GENERAL.items() if k[0] in "mIXYZKMN"}))
    slope = np.array([0.02, -0.01, 0.005])
    nu, R = np.array([0.6, 0.1, 0.0, 0.1, -0.2, 0.3]), kin.rotation(kin.quaternion(0.1, 0.2, 0.3))
    steady = tb.forces(model, nu, R)
    changing = tb.forces(model, nu, R, v_c_rate=slope)
    difference = sum(changing.values()) - sum(steady.values())
    expected = model.M_A @ np.concatenate([R.T @ slope, np.zeros(3)])
    np.testing.assert_allclose(difference, expected, atol=1e-10)


def test_law_port_starboard_mirror_symmetry() -> None:
    symmetric = {k: v for k, v in GENERAL.items() if k not in ("I_xy", "I_yz", "y_g", "y_b")}
    model, rng = build(Parameters(symmetric)), np.random.default_rng(6)
    for _ in range(10):
        q, nu, tau = random_attitude(rng), rng.normal(size=6), 10.0 * rng.normal(size=6)
        v_c = rng.normal(size=3)
        mirrored_q = q * [1.0, -1.0, 1.0, -1.0]
        one = tb.acceleration(model, nu, q, tau, v_c=v_c)
        other = tb.acceleration(model, MIRROR * nu, mirrored_q, MIRROR * tau, v_c=v_c * [1.0, -1.0, 1.0])
        np.testing.assert_allclose(other, MIRROR * one, atol=1e-10)


def test_law_damping_takes_energy() -> None:
    diagonal = {k: v for k, v in GENERAL.items() if k not in ("Y_r", "N_v", "Y_rr")}
    model, rng = build(Parameters(diagonal)), np.random.default_rng(7)
    for nu in rng.normal(size=(50, 6)):
        assert tb.forces(model, nu, np.eye(3))["damping"] @ nu < 0.0


def test_law_reduced_system_equals_constraint_forces() -> None:
    # Holding axes by unknown constraint forces in the full system gives the same motion of the free ones.
    model, rng = build(Parameters(GENERAL)), np.random.default_rng(8)
    q, nu, tau, held = random_attitude(rng), rng.normal(size=6), rng.normal(size=6), rng.normal(size=6)
    reduced = tb.acceleration(model, nu, q, tau, free="XZN", nu_rate=held)
    free_axes = np.array([0, 2, 5])
    constraint = model.M @ reduced - model.M @ tb.acceleration(model, nu, q, tau)
    np.testing.assert_allclose(constraint[free_axes], np.zeros(3), atol=1e-10)
    np.testing.assert_array_equal(reduced[[1, 3, 4]], held[[1, 3, 4]])


def test_law_quaternion_and_euler_kinematics_agree() -> None:
    phi, theta, psi = 0.3, -0.5, 1.2
    nu = np.array([1.0, 0.2, -0.3, 0.2, -0.1, 0.4])
    q, step = kin.quaternion(phi, theta, psi), 1e-6
    ahead = q + step * kin.quaternion_rate(q, nu[3:])
    astern = q - step * kin.quaternion_rate(q, nu[3:])
    ahead, astern = ahead / np.linalg.norm(ahead), astern / np.linalg.norm(astern)
    by_quaternion = (kin.euler(ahead) - kin.euler(astern)) / (2 * step)
    eta_rate = kin.euler_jacobian(phi, theta, psi) @ nu
    np.testing.assert_allclose(by_quaternion, eta_rate[3:], atol=1e-9)  # ulp over the step
    np.testing.assert_allclose(kin.rotation(q) @ nu[:3], eta_rate[:3], atol=ROUNDING)
    np.testing.assert_allclose(kin.euler(q), [phi, theta, psi], atol=ROUNDING)


def test_hydrodynamics_scale_with_the_water() -> None:
    fresh, sea = build(Parameters(GENERAL), rho=1000.0, g=9.80), build(Parameters(GENERAL))
    nu, R = np.array([1.0, 0.2, -0.1, 0.1, 0.2, 0.3]), np.eye(3)
    for term in ("added_mass", "damping", "lift"):
        np.testing.assert_allclose(
            tb.forces(fresh, nu, R)[term], tb.forces(sea, nu, R)[term] * 1000 / 1025, rtol=1e-12
        )
    np.testing.assert_allclose([fresh.W, fresh.B], [120 * 9.80, 1190 * 1000 / 1025 * 9.80 / 9.81], rtol=1e-12)
    np.testing.assert_array_equal(fresh.M_RB, sea.M_RB)


def test_measured_axis_replays_its_record() -> None:
    model = build(Parameters(GENERAL))
    t = np.arange(0.0, 2.01, 0.1)
    halves = np.arange(0.0, 2.001, 0.05)[: 2 * (len(t) - 1) + 1]
    u, u_rate = 0.5 * np.sin(halves), 0.5 * np.cos(halves)
    run = tb.simulate(model, t, {}, free="YZKMN", measured={"X": (u, u_rate)})
    np.testing.assert_array_equal(run.nu[:, 0], u[::2])
    alone = tb.simulate(dataclasses.replace(model), t, {}, free="YZKMN")
    assert np.abs(run.nu[:, 1:] - alone.nu[:, 1:]).max() > 1e-3


def test_unequal_pair_of_added_masses_is_refused() -> None:
    with pytest.raises(ValueError, match=r"Y_rdot = 3\.0 and N_vdot = 2\.0"):
        build(Parameters({**GENERAL, "N_vdot": 2.0}))
