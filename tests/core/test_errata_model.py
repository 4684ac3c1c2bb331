"""Errata of the paper's model, (6) to (33): what is printed against what the core computes, in numbers.

Every test works out the printed form and the corrected one at CWolf's size and states the evidence that
docs/errata.md quotes. Printed forms are plain formulas or the independent model of benchmarks/textbook.py.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from benchmarks import textbook as tb
from benchmarks.textbook_geometry import lamb_factors, spheroid_added_mass
from benchmarks.textbook_kinematics import euler, quaternion, rotation
from benchmarks.textbook_vehicle import build, from_vehicle
from seatrial._core import State, Vehicle

Array = NDArray[np.float64]

CWOLF = Vehicle.load("cwolf")
VALUES = CWOLF.coefficients()
M, LENGTH, RADIUS, RHO, G = 135.0, 2.5, 0.15, 1025.0, 9.81
WEIGHT = M * G
KNOT = 1852.0 / 3600.0
LIFT = ("Y_uv", "Y_ur", "Z_uw", "Z_uq", "M_uw", "M_uq", "N_uv", "N_ur")
DAMPING = [f"{row}_{v}" for row, v in zip("XYZKMN", "uvwpqr", strict=True)]
DAMPING += [f"{row}_{v}{v}" for row, v in zip("XYZKMN", "uvwpqr", strict=True)]
# The model of the paper, which has no lift; and without damping and net buoyancy too.
PAPER = CWOLF.with_coefficients(dict.fromkeys(LIFT, 0.0))
UNDAMPED = PAPER.with_coefficients(dict.fromkeys(DAMPING, 0.0) | {"B": WEIGHT})
# Double precision leaves a few ulp in sums of about ten terms of size 1e3.
ROUNDING = 1e-12

TORPEDO = """
format = 1
name = "torpedo"
[geometry]
length_m = {length}
diameter_m = {diameter}
appendages = [{{ area_m2 = {area}, arm_m = {arm} }}]
[coefficients]
m = {m}
"""


def start(vehicle: Vehicle, name: str) -> float:
    """Start value from the geometry."""
    return float(vehicle.coefficient_info()[name]["start"])


def size(factor: float) -> Vehicle:
    """CWolf of another size, all lengths times a factor, of the same mean density."""
    return Vehicle.from_toml(
        TORPEDO.format(
            length=LENGTH * factor,
            diameter=2.0 * RADIUS * factor,
            area=0.1 * factor**2,
            arm=0.2 * factor,
            m=M * factor**3,
        )
    )


def pull(rpm: float, u: float = 0.0, stream: float = 0.0, *, after_s: float = 6.0) -> float:
    """Thrust ahead of all four stern propellers, N, some time after the command; the vehicle is held at u."""
    t = np.arange(0.0, after_s + 0.05, 0.1)
    commands: dict[str, ArrayLike] = {name: np.full(len(t), rpm) for name in ("SbU", "SbL", "PU", "PL")}
    start = State(nu=[u, 0.0, 0.0, 0.0, 0.0, 0.0])
    run = CWOLF.simulate(t, commands, start, free="", current=[stream, 0.0, 0.0])
    return float(run.tau[-1, 0])


def test_errata_6_propellers_work_in_the_water_that_passes_them() -> None:
    # 0.5 m/s through still water, and held over ground against 0.5 m/s of current: one inflow, one thrust.
    assert pull(1000.0, u=0.5) == pytest.approx(pull(1000.0, stream=-0.5), rel=ROUNDING)
    assert pull(1000.0, u=0.5, stream=0.5) == pytest.approx(pull(1000.0), rel=ROUNDING)
    each = pull(1000.0) / (4.0 * np.asarray(CWOLF.allocation_matrix())[0, 0])
    lost = 1.0 - pull(1000.0, u=0.5) / pull(1000.0)
    # B(nu), as printed, would give a drifting vehicle the loss and a held one none: N per propeller.
    assert each == pytest.approx(20.7, abs=0.05)
    assert lost * each == pytest.approx(4.2, abs=0.05)


def test_errata_6_and_49_actuators_are_no_matrix() -> None:
    # B u_A is linear in the command: twice the revolutions, twice the thrust, and astern its negative.
    assert pull(2000.0) / pull(1000.0) == pytest.approx(4.0, rel=1e-9)
    assert -pull(-1000.0) / pull(1000.0) == pytest.approx(0.25 / 0.35, rel=1e-9)  # alpha_1 astern and ahead
    # And it has no memory: within the dead time of 0.1 s there is no thrust at all, after 0.4 s a part.
    assert pull(1000.0, after_s=0.1) == 0.0
    assert 0.1 < pull(1000.0, after_s=0.4) / pull(1000.0) < 0.3


def test_errata_23_a_vector_cannot_be_added_to_a_matrix() -> None:
    nu = np.array([1.0, 0.3, 0.0, 0.0, 0.0, 0.2])
    linear, quadratic = (-np.diag([VALUES[name] for name in names]) for names in (DAMPING[:6], DAMPING[6:]))
    damping = -(linear + quadratic @ np.diag(np.abs(nu))) @ nu
    np.testing.assert_allclose(CWOLF.forces(nu, np.zeros(3))["damping"], damping, rtol=ROUNDING)
    assert damping[0] == pytest.approx(-12.8, abs=0.05)
    # diag{...} |nu_r| is a vector; a program that adds it to every row brakes surge by sway and yaw.
    vector = quadratic @ np.abs(nu)
    assert (vector.shape, linear.shape) == ((6,), (6, 6))
    assert (-(linear + vector) @ nu)[0] == pytest.approx(-46.5, abs=0.05)


@pytest.mark.long
def test_errata_6_turning_in_a_current_needs_the_waters_acceleration(monkeypatch: pytest.MonkeyPatch) -> None:
    t = np.arange(0.0, 60.01, 0.1)
    revolutions = {"SbU": 1500.0, "SbL": 1500.0, "PU": 1200.0, "PL": 1200.0}
    commands: dict[str, ArrayLike] = {name: np.full(len(t), n) for name, n in revolutions.items()}
    nu, flow = [1.5, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.5, 0.0]
    core = PAPER.simulate(t, commands, State(nu=nu, actuators=dict(revolutions)), current=flow)
    model = build(from_vehicle(PAPER))

    def textbook() -> tb.Trajectory:
        return tb.simulate(model, t, commands, nu=nu, actuators=revolutions, current=flow, substeps=5)

    whole = textbook()
    # The same scheme and step: rounding, grown by the turn.
    np.testing.assert_allclose(whole.position, core.position, atol=1e-9)
    with_rate = tb.current_in_body

    def as_printed(R: Array, omega: Array, v_c: Array, v_c_rate: Array) -> tuple[Array, Array]:
        return with_rate(R, omega, v_c, v_c_rate)[0], np.zeros(6)

    monkeypatch.setattr(tb, "current_in_body", as_printed)
    part = textbook()
    off = np.rad2deg(core.euler[-1, 2] - euler(part.attitude[-1])[2])
    # Quoted digits of this turn.
    assert (off + 180.0) % 360.0 - 180.0 == pytest.approx(51.1, abs=0.05)
    assert np.linalg.norm(core.position[-1] - part.position[-1]) == pytest.approx(8.03, abs=0.005)


def test_errata_6_a_mask_leaks_forces_of_locked_axes() -> None:
    # Yaw alone is free, both starboard propellers push 1 N ahead, the centre of gravity lies 3 % forward.
    offset = UNDAMPED.with_coefficients({"x_g": 0.03 * LENGTH})
    tau = np.asarray(CWOLF.allocation_matrix())[:, :2].sum(axis=1)
    mass = np.asarray(offset.mass_matrix())
    masked = np.linalg.solve(mass, tau)[5]
    t = np.array([0.0, 0.1, 0.2])
    run = offset.simulate(t, {}, free="N", tau=np.tile(tau, (3, 1)))
    reduced = run.nu[1, 5] / 0.1
    assert reduced == pytest.approx(tau[5] / mass[5, 5], rel=1e-9)
    # The judge: the full system, whose other axes are too heavy to move (1e9 of their mass: error 1e-9).
    heavy = {"X_udot": 1e11, "Y_vdot": 1e11, "Z_wdot": 1e11, "K_pdot": 1e11, "M_qdot": 1e11}
    held = offset.with_coefficients({name: -value for name, value in heavy.items()})
    guided = held.acceleration(np.zeros(6), np.zeros(3), tau)[5]
    assert reduced == pytest.approx(guided, rel=1e-8)
    assert masked / guided - 1.0 == pytest.approx(0.0274, abs=5e-5)


def test_errata_10_the_rigid_body_is_positive() -> None:
    total = np.asarray(CWOLF.mass_matrix())
    without = CWOLF.with_coefficients({f"{r}_{v}dot": 0.0 for r, v in zip("XYZKMN", "uvwpqr", strict=True)})
    rigid = np.asarray(without.mass_matrix())
    added = total - rigid
    np.testing.assert_allclose(np.diag(rigid), [M, M, M, VALUES["I_x"], VALUES["I_y"], VALUES["I_z"]])
    assert (added - rigid)[0, 0] == pytest.approx(-131.29, abs=5e-3)  # kg, -diag as printed
    assert total[0, 0] == pytest.approx(138.71, abs=5e-3)
    # 50 N ahead would push the vehicle astern.
    assert (
        50.0 / (added - rigid)[0, 0]
        < 0.0
        < CWOLF.acceleration(np.zeros(6), np.zeros(3), [50, 0, 0, 0, 0, 0])[0]
    )


def test_errata_15_to_19_a_spheroid_is_not_normalised_by_mass_and_cylinder() -> None:
    added = spheroid_added_mass(0.5 * LENGTH, RADIUS, rho=RHO)
    _, k2, k_rotation = lamb_factors(0.5 * LENGTH, RADIUS)
    # What (15) to (19) print as equal: the spheroid's own mass and inertia, and m and I_y.
    assert added[1] / k2 == pytest.approx(120.75, abs=0.05)
    assert added[4] / k_rotation == pytest.approx(38.28, abs=5e-3)
    assert VALUES["I_y"] == pytest.approx(71.07, abs=5e-3)
    for name, i in (("X_udot", 0), ("Y_vdot", 1), ("Z_wdot", 2), ("M_qdot", 4), ("N_rdot", 5)):
        assert start(CWOLF, name) == pytest.approx(-added[i], rel=1e-9)
    # The built-in vehicle keeps the printed normalisers, to the digits of its factors.
    assert VALUES["Y_vdot"] == pytest.approx(-k2 * M, rel=1e-3)
    assert VALUES["M_qdot"] == pytest.approx(-k_rotation * VALUES["I_y"], rel=1e-3)
    assert VALUES["Y_vdot"] / start(CWOLF, "Y_vdot") == pytest.approx(1.12, abs=5e-3)
    assert VALUES["M_qdot"] / start(CWOLF, "M_qdot") == pytest.approx(1.86, abs=5e-3)


def test_errata_20_added_roll_inertia_grows_with_the_fifth_power_of_length() -> None:
    small, large = size(1.0), size(2.0)
    # density times length^5 is the only inertia of similar bodies: 2^5; C m grows with 2^3.
    assert start(large, "K_pdot") / start(small, "K_pdot") == pytest.approx(32.0, rel=ROUNDING)
    assert large.coefficients()["m"] / small.coefficients()["m"] == pytest.approx(8.0)

    def period(K_pdot: float) -> float:
        vehicle = UNDAMPED.with_coefficients({"K_pdot": K_pdot})
        t = np.arange(0.0, 20.0, 0.01)
        roll = vehicle.simulate(t, {}, State(attitude=[1e-3, 0.0, 0.0]), free="K").euler[:, 0]
        zeros = t[1:][(roll[1:] < 0.0) & (roll[:-1] >= 0.0)]
        return float(zeros[1] - zeros[0])

    # One sample of 0.01 s at either end. The factor 0.30 of (20) is the built-in vehicle's.
    assert period(-0.30 * VALUES["I_x"]) == pytest.approx(1.72, abs=0.02)
    assert period(-0.30 * M) == pytest.approx(7.91, abs=0.02)


def test_errata_24_drag_goes_by_the_density_of_the_water() -> None:
    def drag(m: float, rho: float) -> float:
        text = TORPEDO.format(length=LENGTH, diameter=2.0 * RADIUS, area=0.1, arm=0.2, m=m)
        return start(Vehicle.from_toml(f"{text}\n[environment]\nrho_kg_m3 = {rho}\n"), "X_uu")

    # A hull of aluminium, 2700 kg/m3, has the drag of one that floats.
    assert drag(2700.0 / RHO * M, RHO) == drag(M, RHO)
    assert drag(M, 1000.0) / drag(M, RHO) == pytest.approx(1000.0 / RHO, rel=1e-12)
    assert drag(M, 2700.0 * 0.5) / drag(M, RHO) == pytest.approx(0.5 * 2.63, abs=5e-3)


def test_errata_25_a_laminar_form_with_a_turbulent_friction_line() -> None:
    speed, area, l_d = 3.0 * KNOT, np.pi * RADIUS**2, LENGTH / (2.0 * RADIUS)
    friction = 0.075 / (np.log10(speed * LENGTH / 1.19e-6) - 2.0) ** 2
    pressure = 0.5 * RHO * speed**2 * area
    printed = pressure * (0.44 / l_d + 4.0 * friction * l_d + 4.0 * friction / np.sqrt(l_d))
    # Hoerner's form for a turbulent boundary layer, beside the printed one in his chapter 6.
    turbulent = pressure * friction * (3.0 * l_d + 4.5 / np.sqrt(l_d) + 21.0 / l_d**2)
    core = -start(CWOLF, "X_uu") * speed**2
    # The vehicle file's design speed is 1.543 m/s.
    assert core == pytest.approx(printed, rel=1e-3)
    assert printed == pytest.approx(15.6, abs=0.05)
    assert turbulent == pytest.approx(8.5, abs=0.05)
    # The bounds of the search hold both, and the built-in vehicle.
    info = CWOLF.coefficient_info()["X_uu"]
    assert [info["upper"] / info["start"], info["lower"] / info["start"]] == pytest.approx([0.5, 4.0])
    for drag in (printed, turbulent, -VALUES["X_uu"] * speed**2):
        assert -info["upper"] * speed**2 < drag < -info["lower"] * speed**2


def test_errata_27_the_lateral_area_belongs_to_sway_and_heave() -> None:
    lateral, frontal = 2.0 * RADIUS * LENGTH, np.pi * RADIUS**2
    assert lateral / frontal == pytest.approx(10.6, abs=0.05)
    drag = start(CWOLF, "Y_vv") / (-0.5 * RHO * lateral)
    assert 0.74 < drag < 0.82  # White's finite cylinders of l/d = 5 and 10
    assert start(CWOLF, "Z_ww") == start(CWOLF, "Y_vv")
    t = np.arange(0.0, 120.0, 0.1)
    commands: dict[str, ArrayLike] = {name: np.full(len(t), 2000.0) for name in ("SbU", "SbL", "PU", "PL")}

    def top_kn(X_uu: float) -> float:
        run = CWOLF.with_coefficients({"X_uu": X_uu}).simulate(t, commands, free="X")
        return float(run.nu[-1, 0]) / KNOT

    # Table I: 6 kn. With the lateral area along x the vehicle would not reach 2 kn.
    assert top_kn(VALUES["X_uu"]) == pytest.approx(6.2, abs=0.05)
    assert top_kn(start(CWOLF, "Y_vv")) == pytest.approx(1.76, abs=5e-3)


def test_errata_31_roll_damping_lacks_a_length_cubed() -> None:
    printed = -0.5 * RHO * 1.2 * 0.1  # A_R of four fins and tower, C_Dp of a flat plate
    assert printed / start(CWOLF, "K_pp") == pytest.approx(125.0, rel=1e-9)  # 1/0.2^3
    # density times length^5 is the only moment per squared rate: 2^5; an area grows with 2^2.
    assert start(size(2.0), "K_pp") / start(size(1.0), "K_pp") == pytest.approx(32.0, rel=ROUNDING)


def test_errata_32_buoyancy_points_up() -> None:
    q = quaternion(0.0, 0.0, 0.0)
    printed = 2.0 * rotation(q).T @ [0.0, 0.0, WEIGHT]  # + B with B = W; on the vehicle, -g
    assert printed[2] == pytest.approx(2648.7, abs=0.05)
    np.testing.assert_array_equal(UNDAMPED.forces(np.zeros(6), q)["restoring"], np.zeros(6))


def test_errata_32_the_transposed_rotation_maps_earth_to_body() -> None:
    q = quaternion(0.1, 0.5, 1.0)
    R = rotation(q)
    force = np.asarray(CWOLF.forces(np.zeros(6), q)["restoring"])[:3]
    upward = [0.0, 0.0, -(VALUES["B"] - WEIGHT)]  # 5 N of net buoyancy, NED
    np.testing.assert_allclose(force, R.T @ upward, atol=1e-12 * WEIGHT)
    np.testing.assert_allclose(R @ force, upward, atol=1e-12 * WEIGHT)
    # Read the other way round, the buoyancy of a vehicle with its bow up would push it astern.
    assert (R @ upward)[0] < 0.0 < force[0]
    # R is the map of the kinematics: a vehicle that moves along its x goes along R's first column.
    run = CWOLF.simulate([0.0, 1.0], {}, State(attitude=q, nu=[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]), free="")
    np.testing.assert_allclose(run.position[-1], R[:, 0], atol=1e-12)


def g_33(values: dict[str, float], phi: float, theta: float, *, printed: bool) -> Array:
    """(33): g (6,) with its leading minus and the plus of its last row, or without."""
    W, B = values["m"] * G, values["B"]
    x, y, z = (values[f"{a}_g"] * W - values[f"{a}_b"] * B for a in "xyz")
    (s, c), (sp, cp) = (np.sin(theta), np.cos(theta)), (np.sin(phi), np.cos(phi))
    rows = [(W - B) * s, -(W - B) * c * sp, -(W - B) * c * cp]
    rows += [-y * c * cp + z * c * sp, z * s + x * c * cp, -x * c * sp + (y if printed else -y) * s]
    return np.array(rows) * (-1.0 if printed else 1.0)


def test_errata_33_neither_the_leading_minus_nor_the_last_plus() -> None:
    offset = CWOLF.with_coefficients({"x_g": 0.02, "y_g": 0.01, "z_g": 0.03, "y_b": -0.01})
    values, rng = offset.coefficients(), np.random.default_rng(5)
    for phi, theta in rng.uniform(-1.0, 1.0, (20, 2)):
        on_vehicle = np.asarray(offset.forces(np.zeros(6), [phi, theta, 0.3])["restoring"])
        np.testing.assert_allclose(-on_vehicle, g_33(values, phi, theta, printed=False), atol=1e-12 * WEIGHT)
        # Dropping the leading minus is not enough: the last row is off by twice its last term.
        off = -on_vehicle + g_33(values, phi, theta, printed=True)
        y = values["y_g"] * WEIGHT - values["y_b"] * values["B"]
        np.testing.assert_allclose(off, [0, 0, 0, 0, 0, -2.0 * y * np.sin(theta)], atol=1e-12 * WEIGHT)


def test_errata_33_as_printed_pitch_grows_e_fold_in_two_seconds() -> None:
    values = UNDAMPED.coefficients()

    def slope(wrench: Callable[[float], Array]) -> float:
        accelerations = [
            UNDAMPED.acceleration(np.zeros(6), [0.0, x, 0.0], wrench(x))[4] for x in (1e-5, -1e-5)
        ]
        return float(accelerations[0] - accelerations[1]) / 2e-5

    right = slope(lambda theta: np.zeros(6))
    # (6) subtracts g: as printed the wrench is -g_33, in place of the core's own.
    wrong = slope(lambda theta: -2.0 * g_33(values, 0.0, theta, printed=True))
    assert wrong == pytest.approx(-right, rel=1e-6)  # central difference over 1e-5 rad
    assert 1.0 / np.sqrt(wrong) == pytest.approx(2.23, abs=5e-3)  # s, unstable
    assert 2.0 * np.pi / np.sqrt(-right) == pytest.approx(14.0, abs=0.05)  # s, the period of a pendulum
