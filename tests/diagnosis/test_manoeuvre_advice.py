"""What is said of coefficients by their names: each has a manoeuvre, and the sums said are the core's."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest

from seatrial._core import Vehicle
from seatrial.diagnosis.roles import manoeuvre, role
from seatrial.identification.estimate import derived
from seatrial.report.results.coefficient_advice import imperative, inseparable, scaled
from seatrial.vehicle.actuators import fins_and_groups, pushed_axes

NAMES = Vehicle.load("cwolf").coefficient_info()


@pytest.mark.parametrize("name", sorted(NAMES))
def test_every_coefficient_has_a_role_and_a_manoeuvre(name: str) -> None:
    assert role(name).kind != "other"
    assert manoeuvre(role(name)) != manoeuvre(role("unheard of"))


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["m", "Z_wdot"], "m - Z_wdot acts on this data; weigh"),
        (["I_xz", "K_rdot"], "I_xz + K_rdot acts on this data; swing"),
        (
            ["N_uv", "Y_vdot"],
            "N_uv + Y_vdot - X_udot, acts on this data; run steps or a multisine of side force",
        ),
        (["m", "B"], "only the net weight m g - B"),
        (["m", "B", "Z_wdot"], "only m - Z_wdot and the net weight m g - B act"),
        (
            ["z_g", "z_b"],
            "only their common moment of weight and buoyancy acts on this data; do an inclining test",
        ),
        (["x_b", "M_0"], "act alike at the attitudes"),
        (["X_u", "X_uu"], "surge speed varies too little to tell them apart; run a staircase"),
        (["K_p", "K_pp"], "roll speed varies too little to tell them apart; record a free decay in roll"),
        (
            ["X_uu", "stern.gain"],
            "only the ratio of thrust to the hull's force acts on this data; do a bench",
        ),
        (["N_uv", "N_v"], "forward speed varies too little to tell them apart; run turning circles"),
        (["Y_uv", "Y_ur"], "r and v move in one proportion in these trials; run turning circles and zigzags"),
        (["Y_vdot", "Y_v"], "too little acceleration to tell inertia from drag; run steps or a multisine"),
        (["X_0", "X_u"], "opposite directions"),
        (["stern.T_1", "stern.T_t"], "with its revolutions logged"),
        (["stern.gain", "stern.p1_ahead"], "only their product acts on this data; free one of them"),
        (["stern.p1_ahead", "stern.p2"], "revolutions and speed through the water keep one proportion"),
        (["stern.gain", "stern.lever_N"], "measure the lever of stern with a tape"),
        (["K_p", "Z_ww"], "only a combination of them acts on this data; record a free decay in roll"),
    ],
)
def test_combinations_are_said_by_their_physics(names: list[str], said: str) -> None:
    told = "; ".join(inseparable(names))
    assert said in told
    assert all(name in told.partition(":")[0] for name in names)


def test_sum_of_inertias_stays_the_same_in_the_core() -> None:
    """The rules' sums are those of the core: moving along one of them leaves the acceleration as it is."""
    vehicle = Vehicle.load("cwolf")
    start = vehicle.coefficients()
    nu, tau = np.array([1.2, 0.3, -0.2, 0.1, 0.2, -0.3]), np.arange(1.0, 7.0)
    pairs: list[tuple[str, str, Callable[[float], float]]] = [
        ("I_y", "M_qdot", lambda x: x),
        ("I_z", "N_rdot", lambda x: x),
        ("I_xz", "K_rdot", lambda x: -x),
    ]
    for rigid, added, follow in pairs:
        moved = vehicle.with_coefficients({
            rigid: start.get(rigid, 0.0) + 0.1,
            added: start.get(added, 0.0) + follow(0.1),
        })
        expected = vehicle.acceleration(nu, np.zeros(3), tau)
        # Rounding of a 6 by 6 solve.
        assert moved.acceleration(nu, np.zeros(3), tau) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("lift", "mass", "follow"), [("N_uv", "Y_vdot", -1.0), ("M_uw", "Z_wdot", 1.0)])
def test_lift_and_munk_moment_are_one_in_the_core(lift: str, mass: str, follow: float) -> None:
    vehicle = Vehicle.load("cwolf")
    start = vehicle.coefficients()
    moved = vehicle.with_coefficients({lift: start[lift] + 1.0, mass: start[mass] + follow})
    nu, level = np.array([1.2, 0.3, -0.2, 0.0, 0.0, 0.0]), np.zeros(3)
    axis = "XYZKMN".index(lift[0])
    for one in (vehicle, moved):
        assert one.forces(nu, level)["lift"].any()
    total = [sum(float(part[axis]) for part in one.forces(nu, level).values()) for one in (vehicle, moved)]
    # Sums of moments of some 100 N m.
    assert total[1] == pytest.approx(total[0], abs=1e-11)


def test_sentences_are_those_of_the_actuators_that_the_vehicle_has() -> None:
    """A torpedo has no thruster for heave, sway or yaw, and its fins have no thrust."""
    torpedo = Vehicle.load("remus100")
    pushed, fins = pushed_axes(torpedo), fins_and_groups(torpedo)
    assert pushed == "X"
    assert set(fins) == {*torpedo.actuators} - {"propeller"} | {"rudder", "stern planes"}
    assert pushed_axes(Vehicle.load("beluga")) == "XYZKMN"
    hull = ["Y_v", "Z_w", "K_p", "M_q", "N_r", "Y_ur", "Y_uv", "Z_uw", "Z_uq", "M_uw"]
    own = [name for name in torpedo.coefficient_info() if name.partition(".")[0] in fins]
    for name in [*hull, *(f"{one}dot" for one in hull[:5]), *own]:
        said = imperative(manoeuvre(role(name, pushed=pushed, fins=fins)))
        assert not re.search("thrust|bollard|push|revolutions|on the spot|side force", said), (name, said)

    def told(names: list[str]) -> str:
        return "; ".join(inseparable(names, pushed=pushed, fins=fins))

    pair = told(["rudder.C_La", "N_r"])
    assert "thrust" not in pair
    assert "bollard" not in pair
    assert "thrust" not in told(["rudder_upper.C_La", "rudder_lower.C_La"])
    assert "bench" not in "; ".join(scaled(["rudder.C_La", "N_r"], 0.1, fins=fins))
    assert "without way" not in told(["Z_w", "Z_uw"])
    assert not [
        name for name in derived(torpedo) if name.startswith(("rudder thrust", "stern planes thrust"))
    ]
    assert "vertical thrusters" in imperative(
        manoeuvre(role("Z_ww", pushed=pushed_axes(Vehicle.load("cwolf"))))
    )
