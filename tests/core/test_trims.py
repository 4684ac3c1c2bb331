"""An asymmetric hull, or a fin crooked on its shaft: trims that grow with the speed, nothing at rest."""

from __future__ import annotations

import numpy as np
import pytest

import seatrial as st
from seatrial._core import State, Vehicle
from seatrial.base.errors import VehicleError

TRIMS = {"Y_uu": 1.5, "Z_uu": -2.0, "K_uu": 0.4, "M_uu": 0.8, "N_uu": -0.6}
REST = [1.0, 0.0, 0.0, 0.0]


def test_trims_grow_with_the_square_of_the_speed_and_not_at_rest() -> None:
    plain = Vehicle.load("cwolf")
    vehicle = plain.with_coefficients(TRIMS)
    nu = np.zeros((4, 6))
    nu[:, 0] = [0.0, 0.5, 1.0, -2.0]
    more = np.asarray(vehicle.forces(nu, REST)["damping"]) - np.asarray(plain.forces(nu, REST)["damping"])
    expected = np.outer(np.abs(nu[:, 0]) * nu[:, 0], [0.0, *TRIMS.values()])
    assert np.allclose(more, expected, rtol=0, atol=1e-12)
    # A bias turns the boat on the spot; a trim does not.
    t = np.linspace(0.0, 20.0, 21)
    assert np.all(np.abs(vehicle.simulate(t, free="N").nu[:, 5]) == 0.0)
    assert abs(plain.with_coefficients({"N_0": -0.6}).simulate(t, free="N").nu[-1, 5]) > 0.01


@pytest.mark.parametrize("name", ["cwolf", "remus100"])
def test_trims_can_be_sought(name: str) -> None:
    vehicle = Vehicle.load(name)
    info = vehicle.coefficient_info()
    for trim in TRIMS:
        lower, upper = info[trim]["lower"], info[trim]["upper"]
        assert info[trim]["start"] == 0.0 or lower * upper < 0.0, trim
        assert lower < 0.0 < upper
    assert "asymmetric hull, N per |u| u" in info["N_uu"]["description"]
    assert info["N_uu"]["unit"] == "N s2/m"
    assert "asymmetric" not in info["X_uu"]["description"]


def test_a_fin_that_sits_crooked_acts_as_deflected() -> None:
    vehicle = Vehicle.load("remus100")
    fin = next(name for name, facts in vehicle.actuator_info().items() if facts["kind"] == "fin")
    crooked = vehicle.with_coefficients({f"{fin}.offset": 0.05})
    t, start = np.linspace(0.0, 5.0, 51), State(nu=[1.5, 0, 0, 0, 0, 0], actuators={fin: 0.05})
    held = vehicle.simulate(t, {fin: 0.05}, start)
    offset = crooked.simulate(t, {}, State(nu=[1.5, 0, 0, 0, 0, 0]))
    assert np.allclose(held.nu, offset.nu, rtol=0, atol=1e-12)
    assert np.all(offset.actuators[fin] == 0.0)
    assert np.abs(held.nu[-1, 1:]).max() > 1e-3
    # Nothing at rest, where a bias would turn it.
    assert np.abs(crooked.simulate(t, free="YKN").nu).max() < 1e-12
    info = crooked.coefficient_info()[f"{fin}.offset"]
    assert (info["unit"], info["lower"], info["upper"]) == ("rad", -0.2, 0.2)


def test_the_offset_of_a_file_is_in_degrees_and_survives() -> None:
    text = Vehicle.load("remus100").to_toml()
    fin = next(n for n, facts in Vehicle.load("remus100").actuator_info().items() if facts["kind"] == "fin")
    turned = text.replace(f'name = "{fin}"', f'name = "{fin}"\noffset_deg = 2.5', 1).replace(
        "offset_deg = 0.0\n", ""
    )
    vehicle = Vehicle.from_toml(turned)
    assert vehicle.coefficients()[f"{fin}.offset"] == np.radians(2.5)
    again = Vehicle.from_toml(vehicle.with_coefficients({f"{fin}.offset": 0.01}).to_toml())
    assert again.coefficients()[f"{fin}.offset"] == 0.01
    with pytest.raises(VehicleError, match=r"offset_deg: expected a number from -90.0 to 90.0, found 91"):
        Vehicle.from_toml(turned.replace("offset_deg = 2.5", "offset_deg = 91"))


def test_trims_and_offsets_are_identified() -> None:
    """From a straight run and a turn of a vehicle with both, of which the start vehicle knows nothing."""
    plain = Vehicle.load("remus100")
    fins = [name for name, facts in plain.actuator_info().items() if facts["kind"] == "fin"]
    rudder = next(f for f in fins if abs(plain.actuator_info()[f]["direction"][1]) > 0.5)
    true = {"N_uu": 0.15, f"{rudder}.offset": 0.02}
    truth = plain.with_coefficients(true)
    t = np.linspace(0.0, 20.0, 201)
    drive = next(n for n in plain.actuators if n not in fins)
    commands = {drive: np.full(len(t), 1300.0), rudder: 0.12 * np.sign(np.sin(0.9 * t))}
    start = State(nu=[1.3, 0, 0, 0, 0, 0], actuators={drive: 1300.0})
    measured = truth.simulate(t, commands, start).nu[:, [1, 5]]

    def errors(values: dict[str, float]) -> np.ndarray:
        return (plain.with_coefficients(values).simulate(t, commands, start).nu[:, [1, 5]] - measured).ravel()

    # Two Gauss-Newton steps by differences: both are seen, and apart from each other.
    x = np.zeros(2)
    for _ in range(4):
        r = errors(dict(zip(true, x, strict=True)))
        J = np.stack([errors(dict(zip(true, x + d, strict=True))) - r for d in np.eye(2) * 1e-5], 1) / 1e-5
        x = x - np.linalg.lstsq(J, r, rcond=None)[0]
    assert np.allclose(x, list(true.values()), rtol=1e-4)
    assert st.Vehicle is Vehicle
