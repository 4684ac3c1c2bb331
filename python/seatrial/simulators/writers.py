"""Bodies as models of gz-sim, uuv_simulator and Stonefish, and what each cannot hold.

Conventions as in `seatrial.simulators.readers`. For gz-sim the added mass goes into ``fluid_added_mass``,
which the physics engine solves with the mass, and not into the plugin, which takes the acceleration of the
step before. Held by ``tests/simulators/test_convert.py``.
"""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from seatrial.base.arrays import Array
from seatrial.simulators.body import FLIP, Body

_FORCES, _VELOCITIES, _ADDED = "xyzkmn", "UVWPQR", "xyzpqr"

_FLIP3 = np.diag([1.0, -1.0, -1.0])

_DIAGONAL = np.eye(6, dtype=bool)


def _text(*values: float) -> str:
    return " ".join(f"{value + 0.0:.9g}" for value in values)


def _add(parent: ElementTree.Element, tag: str, text: str = "", /, **attributes: str) -> ElementTree.Element:
    child = ElementTree.SubElement(parent, tag, attributes)
    child.text = text or None
    return child


def _string(root: ElementTree.Element, comment: str) -> str:
    ElementTree.indent(root)
    body = ElementTree.tostring(root, encoding="unicode")
    safe = comment.replace("--", "- -")
    return f'<?xml version="1.0" encoding="utf-8"?>\n<!-- {safe} -->\n{body}\n'


def _centred(body: Body) -> Array:
    """Inertia about the centre of gravity, forward-right-down."""
    c = body.gravity_centre
    return np.asarray(body.inertia - body.mass * (float(c @ c) * np.eye(3) - np.outer(c, c)))


def _hull(body: Body) -> tuple[float, float, float]:
    """Size of a box with the displaced volume, in the proportions of the hull; a cube without one."""
    volume = (body.mass * body.g if body.buoyancy is None else body.buoyancy) / (body.rho * body.g)
    length, width, height = body.size or (1.0, 1.0, 1.0)
    scale = (volume / (length * width * height)) ** (1.0 / 3.0)
    return length * scale, width * scale, height * scale


def write_sdf(body: Body, comment: str) -> tuple[str, list[str]]:
    """SDF model with the hydrodynamics plugin of gz-sim, and what it cannot hold."""
    root = ElementTree.Element("sdf", version="1.10")
    model = _add(root, "model", name=body.name)
    link = _add(model, "link", name="base_link")
    inertial = _add(link, "inertial")
    _add(inertial, "pose", _text(*(_FLIP3 @ body.gravity_centre), 0, 0, 0))
    _add(inertial, "mass", _text(body.mass))
    centred = _FLIP3 @ _centred(body) @ _FLIP3
    tensor = _add(inertial, "inertia")
    for name, (i, j) in (
        ("xx", (0, 0)),
        ("xy", (0, 1)),
        ("xz", (0, 2)),
        ("yy", (1, 1)),
        ("yz", (1, 2)),
        ("zz", (2, 2)),
    ):
        _add(tensor, f"i{name}", _text(centred[i, j]))
    flip = FLIP[:, None] * FLIP[None, :]
    added = flip * body.added_mass
    fluid = _add(inertial, "fluid_added_mass")
    for i, first in enumerate(_ADDED):
        for j, second in enumerate(_ADDED[i:], i):
            _add(fluid, first + second, _text(added[i, j]))
    collision = _add(link, "collision", name="displaced_volume")
    _add(collision, "pose", _text(*(_FLIP3 @ body.buoyancy_centre), 0, 0, 0))
    _add(_add(_add(collision, "geometry"), "box"), "size", _text(*_hull(body)))
    plugin = _add(
        model, "plugin", filename="gz-sim-hydrodynamics-system", name="gz::sim::systems::Hydrodynamics"
    )
    _add(plugin, "link_name", "base_link")
    _add(plugin, "water_density", _text(body.rho))
    for i, force in enumerate(_FORCES):
        for j, velocity in enumerate(_VELOCITIES):
            for matrix, key in (
                (flip * body.linear, f"{force}{velocity}"),
                (flip * body.quadratic, f"{force}{velocity}abs{velocity}"),
            ):
                if matrix[i, j]:
                    _add(plugin, key, _text(matrix[i, j]))
    # The engine has the added mass already; the plugin would count it twice.
    _add(plugin, "disable_added_mass", "true")
    _add(plugin, "disable_coriolis", "true")
    lost = [
        "Buoyancy needs the plugin Buoyancy in the world; the collision is a box with the displaced volume"
        " at the"
        " centre of buoyancy, and so no shape for contacts.",
        f"The world's gravity must be {body.g:g} m/s2 and the density of Buoyancy {body.rho:g} kg/m3.",
        "fluid_added_mass needs SDF 1.10 and a physics engine that knows it (DART).",
    ]
    return _string(root, comment), lost


def write_uuv(body: Body, comment: str) -> tuple[str, list[str]]:
    """URDF of a robot with the hydrodynamic model of uuv_simulator, and what it cannot hold."""
    root = ElementTree.Element("robot", name=body.name)
    link = _add(root, "link", name="base_link")
    inertial = _add(link, "inertial")
    _add(inertial, "origin", xyz=_text(*(_FLIP3 @ body.gravity_centre)), rpy="0 0 0")
    _add(inertial, "mass", value=_text(body.mass))
    centred = _FLIP3 @ _centred(body) @ _FLIP3
    names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    _add(inertial, "inertia", **{name: _text(centred[i, j]) for name, (i, j) in names.items()})
    gazebo = _add(root, "gazebo")
    plugin = _add(gazebo, "plugin", filename="libuuv_underwater_object_ros_plugin.so", name="uuv_plugin")
    _add(plugin, "fluid_density", _text(body.rho))
    _add(plugin, "flow_velocity_topic", "hydrodynamics/current_velocity")
    inner = _add(plugin, "link", name="base_link")
    _add(inner, "neutrally_buoyant", "0")
    buoyancy = body.mass * body.g if body.buoyancy is None else body.buoyancy
    _add(inner, "volume", _text(buoyancy / (body.rho * body.g)))
    length, width, height = _hull(body) if body.size is None else body.size
    box = _add(inner, "box")
    for name, value in (("width", width), ("length", length), ("height", height)):
        _add(box, name, _text(value))
    _add(inner, "center_of_buoyancy", _text(*(_FLIP3 @ body.buoyancy_centre)))
    hydro = _add(inner, "hydrodynamic_model")
    _add(hydro, "type", "fossen")
    _add(hydro, "added_mass", "\n".join(_text(*row) for row in body.added_mass))
    lost = [
        "The plugin takes the added mass from the acceleration of the step before: small steps are needed."
    ]
    for name, matrix in (("linear_damping", body.linear), ("quadratic_damping", body.quadratic)):
        off = matrix[~_DIAGONAL]
        if off.any():
            _add(hydro, name, "\n".join(_text(*row) for row in matrix))
            lost.append(
                f"Off-diagonal {name} needs a version of the plugin that takes 36 numbers; older ones take 6."
            )
        else:
            _add(hydro, name, _text(*np.diag(matrix)))
    return _string(root, comment), lost


def write_stonefish(body: Body, comment: str) -> tuple[str, list[str]]:
    """Robot of a Stonefish scenario, and what it cannot hold."""
    root = ElementTree.Element("scenario")
    robot = _add(root, "robot", name=body.name, fixed="false", self_collisions="false")
    base = _add(robot, "base_link", name="Vehicle", type="box", physics="submerged", buoyant="true")
    _add(base, "dimensions", xyz=_text(*_hull(body)))
    _add(base, "origin", xyz=_text(*body.buoyancy_centre), rpy="0.0 0.0 0.0")
    _add(base, "mass", value=_text(body.mass))
    centred = _centred(body)
    _add(base, "inertia", xyz=_text(*np.diag(centred)))
    _add(base, "cg", xyz=_text(*body.gravity_centre), rpy="0.0 0.0 0.0")
    _add(base, "material", name="Neutral")
    _add(base, "look", name="Vehicle")
    _add(robot, "world_transform", xyz="0.0 0.0 1.0", rpy="0.0 0.0 0.0")
    lost = [
        "Damping and added mass are lost: Stonefish computes both from the shape, here a box with the"
        " displaced"
        " volume. The motion will differ from that of the vehicle file.",
        "Material Neutral and look Vehicle must be defined in the scenario.",
    ]
    if (centred - np.diag(np.diag(centred))).any():
        lost.append("Products of inertia are lost: the principal axes are taken along the body's.")
    return _string(root, comment), lost


WRITERS = {"sdf": write_sdf, "uuv": write_uuv, "stonefish": write_stonefish}
"""Writer by form."""
