"""The SDF of gz-sim: the equations of its plugin Hydrodynamics, and XML without trust: what a hostile file
can declare, and how deep and long it may be.

The equations are those of gazebosim/gz-sim at 775ba7df, in forward-left-up about the link's origin, written
here once more in NumPy: every term of a written and of a read model is a term of the plugin or of the engine.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import seatrial as st
from seatrial.base.arrays import Array
from seatrial.base.errors import VehicleError
from seatrial.base.frames import from_euler, matrix
from seatrial.simulators import export_model, import_model
from seatrial.simulators.convert import parse, read_bytes
from tests.simulators.test_convert import FULL

FLIP = np.diag([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
AXES = ("xx", "xy", "xz", "yy", "yz", "zz")


class Plugin:
    """What the plugin reads of a model, and its forces on the link."""

    def __init__(self, root: ElementTree.Element) -> None:
        plugin = next(root.iter("plugin"))

        def parameter(key: str) -> float:
            return float(plugin.findtext(key) or 0.0)

        forces, velocities = "xyzkmn", "UVWPQR"
        self.added = np.array([[parameter(f"{f}Dot{v}") for v in velocities] for f in forces])
        self.linear = np.array([[parameter(f"{f}{v}") for v in velocities] for f in forces])
        self.products = np.array([
            [[parameter(f"{f}{v}abs{w}") for w in velocities] for v in velocities] for f in forces
        ])
        self.with_added_mass = plugin.findtext("disable_added_mass") != "true"
        self.with_coriolis = plugin.findtext("disable_coriolis") != "true"

    def damping(self, nu: Array) -> Array:
        """Force of linear and quadratic damping."""
        return np.asarray((self.linear + self.products @ np.abs(nu)) @ nu)

    def coriolis(self, nu: Array) -> Array:
        """Its matrix C_A of the diagonal derivatives, (6, 6), with the two entries that differ."""
        x, y, z, k, m, n = np.diag(self.added)
        u, v, w, p, q, r = nu
        return np.array([
            [0, 0, 0, 0, -z * w, -y * v],  # the last is y v in Fossen
            [0, 0, 0, z * w, 0, -x * u],
            [0, 0, 0, -y * v, x * u, 0],
            [0, -z * w, y * v, 0, -n * r, m * q],
            [z * w, 0, -x * u, n * r, 0, -k * p],
            [z * w, x * u, 0, -m * q, k * p, 0],  # the first is -y v in Fossen
        ])


def _skew(a: Array) -> Array:
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def _kirchhoff(inertia: Array, nu: Array) -> Array:
    """Force -C(nu) nu of a (6, 6) inertia (Fossen 2011, equation 3.46)."""
    linear, angular = np.split(inertia @ nu, 2)
    coriolis = np.block([[np.zeros((3, 3)), -_skew(linear)], [-_skew(linear), -_skew(angular)]])
    return np.asarray(-coriolis @ nu)


def _floats(text: str | None) -> Array:
    return np.array([float(word) for word in (text or "").split()])


def _rigid_body(inertial: ElementTree.Element) -> tuple[Array, Array]:
    """Inertia (6, 6) about the link's origin and weight's centre (3,)."""
    mass, c = float(inertial.findtext("mass") or 0.0), _floats(inertial.findtext("pose"))[:3]
    tensor = inertial.find("inertia")
    assert tensor is not None
    xx, xy, xz, yy, yz, zz = (float(tensor.findtext(f"i{a}") or 0) for a in AXES)
    about_c = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    s = _skew(c)
    return np.block([[mass * np.eye(3), -mass * s], [mass * s, about_c - mass * s @ s]]), c


def _fluid(inertial: ElementTree.Element) -> Array:
    """Added mass of the engine, (6, 6)."""
    added, names = np.zeros((6, 6)), "xyzpqr"
    fluid = inertial.find("fluid_added_mass")
    for i, first in enumerate(names):
        for j, second in enumerate(names[i:], i):
            added[i, j] = added[j, i] = 0.0 if fluid is None else float(fluid.findtext(first + second) or 0)
    return added


def _acceleration(text: str, nu: Array, attitude: Array, tau: Array, *, rho: float, g: float) -> Array:
    """Acceleration that gz-sim gives a model, forward-right-down."""
    root = ElementTree.fromstring(text)
    plugin, inertial = Plugin(root), next(root.iter("inertial"))
    nu, tau = FLIP @ nu, FLIP @ tau
    down = FLIP[:3, :3] @ matrix(from_euler(attitude)).T @ np.array([0.0, 0.0, 1.0])
    rigid, centre = _rigid_body(inertial)
    collision = next(root.iter("collision"))
    buoyancy = rho * g * np.prod(_floats(collision.findtext("geometry/box/size")))
    place = _floats(collision.findtext("pose"))[:3]
    weight = rigid[0, 0] * g * down
    lift = -buoyancy * down
    force = tau + plugin.damping(nu) + np.concatenate([weight + lift, 0 * lift])
    force[3:] += np.cross(centre, weight) + np.cross(place, lift)
    # The engine solves mass and fluid_added_mass together; its Coriolis force is that of both.
    solved = rigid + _fluid(inertial)
    force += _kirchhoff(solved, nu)
    if plugin.with_coriolis:
        # The plugin adds C nu; with its derivatives for masses, Fossen's force is -C nu.
        force -= plugin.coriolis(nu) @ nu
    if plugin.with_added_mass:
        solved = solved - plugin.added
    return np.asarray(FLIP @ np.linalg.solve(solved, force))


def test_golden_gz_sim_moves_a_written_model_as_the_vehicle_file_moves() -> None:
    """All six axes with all cross terms; nine digits are written."""
    vehicle = st.Vehicle.from_toml(FULL)
    text = export_model(vehicle).text
    rng = np.random.default_rng(2)
    for _ in range(5):
        nu, tau, attitude = rng.normal(size=6), 50 * rng.normal(size=6), rng.normal(size=3)
        expected = _acceleration(text, nu, attitude, tau, rho=1020.0, g=9.81)
        np.testing.assert_allclose(vehicle.acceleration(nu, attitude, tau), expected, rtol=0, atol=1e-6)


READ = """
<sdf version="1.9"><model name="rov"><link name="base_link">
  <inertial><mass>12</mass><pose>0.02 0.01 -0.03 0 0 0</pose>
    <inertia><ixx>0.3</ixx><iyy>0.4</iyy><izz>0.5</izz><ixy>0.02</ixy><ixz>-0.03</ixz><iyz>0.01</iyz></inertia>
  </inertial>
  <collision name="hull"><pose>0.01 0 0.02 0 0 0</pose>
    <geometry><box><size>0.4 0.3 0.1</size></box></geometry></collision>
  </link>
  <plugin filename="gz-sim-hydrodynamics-system" name="gz::sim::systems::Hydrodynamics">
    <link_name>base_link</link_name><water_density>1000</water_density>
    <xDotU>-5</xDotU><yDotV>-6</yDotV><zDotW>-7</zDotW><kDotP>-0.1</kDotP><mDotQ>-0.2</mDotQ><nDotR>-0.3</nDotR>
    <xU>-4</xU><yV>-5</yV><zW>-6</zW><kP>-0.3</kP><mQ>-0.4</mQ><nR>-0.5</nR><yR>0.6</yR><nV>0.7</nV><mW>-0.8</mW>
    <xUabsU>-10</xUabsU><yVabsV>-20</yVabsV><zWabsW>-30</zWabsW><nRabsR>-2</nRabsR><yRabsR>0.3</yRabsR>
  </plugin>
</model></sdf>
"""


def test_golden_gz_sim_a_read_model_moves_as_the_plugin_moves_it(tmp_path: Path) -> None:
    """Added mass and Coriolis force of the plugin; without sway and heave, where two entries differ."""
    path = tmp_path / "model.sdf"
    path.write_text(READ, encoding="utf-8")
    vehicle = import_model(path).vehicle
    rng = np.random.default_rng(3)
    for _ in range(5):
        nu, tau, attitude = rng.normal(size=6), 5 * rng.normal(size=6), rng.normal(size=3)
        nu[1] = nu[2] = 0.0
        expected = _acceleration(READ, nu, attitude, tau, rho=1000.0, g=9.81)
        # The numbers of the file have few digits: only rounding is left.
        np.testing.assert_allclose(vehicle.acceleration(nu, attitude, tau), expected, rtol=1e-9, atol=1e-9)


def test_golden_gz_sim_damping_of_a_read_model_in_sway_and_heave(tmp_path: Path) -> None:
    """The odd part of the force in the velocity: Coriolis force and weight are even and drop out."""
    path = tmp_path / "model.sdf"
    path.write_text(READ, encoding="utf-8")
    vehicle, plugin = import_model(path).vehicle, Plugin(ElementTree.fromstring(READ))
    nu, still = np.array([0.3, -0.8, 0.6, 0.4, -0.5, 0.9]), np.zeros(3)
    force = (
        0.5
        * vehicle.mass_matrix()
        @ (vehicle.acceleration(nu, still, np.zeros(6)) - vehicle.acceleration(-nu, still, np.zeros(6)))
    )
    np.testing.assert_allclose(force, FLIP @ plugin.damping(FLIP @ nu), rtol=0, atol=1e-9)


LAUGHS = b"""<?xml version="1.0"?>
<!DOCTYPE lolz [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>
<sdf>&b;</sdf>"""


@pytest.mark.parametrize(
    "content",
    [
        LAUGHS,
        LAUGHS.decode().replace("utf-8", "utf-16").encode("utf-16"),
        b'<!DOCTYPE a SYSTEM "file:///etc/passwd"><a/>',
        b'<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]><a>&x;</a>',
    ],
)
def test_declarations_are_refused_in_every_encoding(content: bytes) -> None:
    with pytest.raises(VehicleError, match=r"without a document type and entities"):
        parse(content, "bad.sdf")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "expected XML"),
        (b"<a>", "expected XML"),
        (b"\x00\x01\x02", "expected XML"),
        (b"<a>&unknown;</a>", "expected XML"),
        (b"<a>" * 200 + b"</a>" * 200, "100 deep"),
        (b"<r>" + b"<a/>" * 100_001 + b"</r>", "at most 100000 elements"),
    ],
)
def test_what_is_no_model_is_refused(content: bytes, words: str) -> None:
    with pytest.raises(VehicleError, match=words):
        parse(content, "bad.sdf")


def test_large_and_missing_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "big.sdf"
    path.write_bytes(b" " * 5_000_001)
    with pytest.raises(VehicleError, match="at most 5 MB"):
        read_bytes(path)
    with pytest.raises(VehicleError, match="cannot be read"):
        read_bytes(path.with_name("none.sdf"))
