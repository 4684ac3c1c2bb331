"""A model of gz-sim as a vehicle file with what contradicts itself, and a vehicle as such a model.

Models are SDF with the plugin Hydrodynamics. Conventions, read in the source of the plugin (gazebosim/gz-sim
at 775ba7df, facts only): ``xU``, ``xUabsU`` and ``xDotU`` are derivatives of the force in forward-left-up, so
negative; up to version 6 ``xDotU`` was the added mass itself, so positive. ``fluid_added_mass`` in
``<inertial>`` (SDF) is the added mass itself. Buoyancy follows the collisions.

A written model has its added mass in ``fluid_added_mass``, which the physics engine solves with the mass, and
not in the plugin, which takes the acceleration of the step before.

Files are read without trust: no document types or entities, limits on size, depth and elements. Held by
``tests/simulators/test_convert.py`` and ``tests/simulators/test_sdf.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np

from seatrial._core import Vehicle
from seatrial.base.arrays import Array
from seatrial.base.budget import Budget, guarded
from seatrial.base.errors import VehicleError, reason
from seatrial.base.files import write_atomic, writing
from seatrial.base.frames import from_euler, matrix
from seatrial.base.plain import Plain
from seatrial.base.report import Report, Reported, report_of
from seatrial.base.toml_file import loaded
from seatrial.simulators.body import FLIP, Body, body_of, contradictions

ENDINGS = (".sdf", ".urdf", ".xacro", ".scn", ".world", ".xml")
"""Endings of files that are models and no logs; what is not gz-sim's is refused with what to do."""

_MODEL = Budget(cpu_s=5.0)  # the largest model that is read takes one

_SIMPLER = "give the model alone"


@dataclass(frozen=True, eq=False, repr=False)
class ImportedModel(Reported):
    """A vehicle file from a model of gz-sim."""

    source: str  #: The file.
    #: `text`, `vehicle`: the vehicle file and the vehicle.
    text: str
    vehicle: Vehicle
    contradictions: tuple[str, ...]  #: What physics does not allow or what is doubtful, a sentence each.
    left: tuple[str, ...]  #: What was not taken.

    def to_dict(self) -> dict[str, Any]:
        """The same as plain data."""
        return {
            "source": self.source,
            "coefficients": {k: v for k, v in self.vehicle.coefficients().items() if v},
            "contradictions": list(self.contradictions),
            "left": list(self.left),
        }


@dataclass(frozen=True, eq=False, repr=False)
class ExportedModel(Reported, Plain, only="vehicle=vehicle.name lost"):
    """A vehicle as a model of gz-sim: its text, and what is lost."""

    vehicle: Vehicle
    text: str
    lost: tuple[str, ...]

    def report(self, out: str = "") -> Report:
        """Report on the export to a file."""
        return report_of(self, out=out)


def import_model(path: str | Path, *, name: str | None = None, rho: float | None = None) -> ImportedModel:
    """Vehicle file from a model of gz-sim: SDF with the plugin Hydrodynamics.

    Parameters
    ----------
    path : str or Path
    name : str, optional
        Of the vehicle; that of the model when omitted.
    rho : float, optional
        Density of the water, kg/m3, instead of that of the model.

    Raises
    ------
    VehicleError
        The file is no such model, is not safe to read, or its numbers are no vehicle.
    """
    source = str(path)
    content = read_bytes(path)
    with guarded(
        source, "reading it as a model", _SIMPLER, size=len(content), budget=_MODEL, refusal=VehicleError
    ):
        body, left = read(parse(content, source), source, rho=rho)
    if not body.mass > 0.0:
        raise VehicleError(f"{source}: expected a positive mass, found {body.mass:g} kg")
    body, doubts = contradictions(body)
    # A template's $name is filled in by a program that is not at hand.
    own = "" if "$" in body.name else body.name
    body = replace(body, name=name or own or Path(source).stem)
    comments = (
        f"From {Path(source).name}, a model of gz-sim; forward-right-down about the link's origin, SI.",
        *(f"Contradiction: {sentence}" for sentence in doubts),
        *(f"Not taken: {sentence}" for sentence in left),
        "No thrusters yet: add [[thrusters]] and list in controllable what they can do.",
    )
    text = body.toml(comments)
    return ImportedModel(source, text, Vehicle.from_toml(text, source), tuple(doubts), left)


def export_model(vehicle: Vehicle | str | Path) -> ExportedModel:
    """Vehicle as a model of gz-sim, with what it cannot hold.

    Parameters
    ----------
    vehicle : Vehicle, str or Path

    Raises
    ------
    VehicleError
        The vehicle is not usable.
    """
    model: Vehicle = loaded(Vehicle, vehicle)
    text, lost = write(body_of(model), f"{model.name}: written by seatrial for gz-sim")
    return ExportedModel(model, text, (*lost, *_not_carried(model)))


def write_text(path: Path, text: str) -> None:
    """Write a text whole or not at all.

    Raises `VehicleError`: it cannot be written.
    """
    with writing(path, VehicleError, advice="choose another folder"):
        write_atomic(path, text.encode())


def _not_carried(vehicle: Vehicle) -> list[str]:
    """Sentences on terms of the vehicle that gz-sim does not take."""
    given: Mapping[str, float] = vehicle.coefficients()

    def some(test: Any) -> list[str]:
        return [name for name, value in sorted(given.items()) if value and test(name)]

    lift = some(lambda name: name in _LIFT)
    bias = some(lambda name: len(name) == 3 and name.endswith("_0"))
    cross = some(lambda name: name.startswith("C_D"))
    tether = some(lambda name: name.endswith("_tether"))
    sentences = []
    for names, what in (
        (lift, "Lift"),
        (bias, "Constant forces"),
        (cross, "Cross-flow drag by strips"),
        (tether, "The tether"),
    ):
        if names:
            sentences.append(f"{what} of the vehicle file ({', '.join(names)}) has no counterpart.")
    if vehicle.actuators:
        sentences.append(
            f"{len(vehicle.actuators)} actuators with their motors (lag, dead time, limits, thrust by"
            " supply and inflow) are not written."
        )
    return sentences


_LIFT = frozenset(("Y_uv", "Y_ur", "Z_uw", "Z_uq", "M_uw", "M_uq", "N_uv", "N_ur"))


Element = ElementTree.Element


@dataclass(frozen=True)
class SdfLimits:
    """How large a model file may be."""

    most_bytes: int = 5_000_000  #: Most bytes of a file: models are some ten thousand.
    most_depth: int = 100  #: Most elements within each other: a robot is some 10 deep.
    most_elements: int = 100_000  #: Most elements: a robot has some hundred.


LIMITS = SdfLimits()


_FORCES, _VELOCITIES, _ADDED = "xyzkmn", "UVWPQR", "xyzpqr"

_TENSOR = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}

_FLIP3 = np.diag([1.0, -1.0, -1.0])  # forward-left-up to forward-right-down, and back

_FLIP6 = FLIP[:, None] * FLIP[None, :]


def read_bytes(path: str | Path) -> bytes:
    """Content of a model file.

    Raises `VehicleError`: it cannot be read, or is larger than any model.
    """
    try:
        with Path(path).open("rb") as file:
            content = file.read(LIMITS.most_bytes + 1)
    except OSError as error:
        raise VehicleError(f"{path}: cannot be read ({reason(error)}); give a model file") from None
    if len(content) > (most := LIMITS.most_bytes):
        raise VehicleError(
            f"{path}: expected a model of at most {most / 1e6:g} MB, found a larger file; is it a mesh?"
        )
    return content


def parse(content: bytes, source: str) -> Element:
    """Root element of an XML text.

    Raises `VehicleError`: it is no XML, declares a document type or entities, or is too deep or too long.

    Examples
    --------
    >>> parse(b"<sdf><model name='rov'/></sdf>", "rov.sdf")[0].get("name")
    'rov'
    """
    builder = ElementTree.TreeBuilder()
    parser = expat.ParserCreate()
    depth = count = 0

    def refuse(*_: object) -> None:
        raise VehicleError(
            f"{source}: row {parser.CurrentLineNumber}: expected XML without a document type and entities,"
            " found a declaration; take it out"
        )

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        if depth > LIMITS.most_depth or count > LIMITS.most_elements:
            raise VehicleError(
                f"{source}: row {parser.CurrentLineNumber}: expected at most {LIMITS.most_elements} elements,"
                f" {LIMITS.most_depth} deep, found more; give the model alone, not a world"
            )
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    # Refused where the declaration stands: entities are never expanded.
    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(content, True)
        return builder.close()
    except (expat.ExpatError, UnicodeError, ValueError) as error:
        if isinstance(error, VehicleError):
            raise
        raise VehicleError(
            f"{source}: expected XML, found another text ({error}); give a model file"
        ) from None


def _local(element: Element) -> str:
    """Name of an element without its prefix."""
    return element.tag.rpartition(":")[2].rpartition("}")[2]


def numbers(text: str | None, where: str, *, count: int = 1) -> list[float]:
    """Numbers of a text, as many as `count`.

    Raises `VehicleError`: there are others, or one is not finite.

    Examples
    --------
    >>> numbers(" 1 2.5e0 -3 ", "size", count=3)
    [1.0, 2.5, -3.0]
    """
    words = (text or "").replace(",", " ").split()
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise VehicleError(f"{where}: expected {count} finite numbers, found {' '.join(words)[:60]!r}")
    return values


def _children(element: Element, name: str) -> Iterator[Element]:
    """Children of an element with a name, whatever their prefix."""
    return (child for child in element if _local(child) == name)


def _child(element: Element | None, name: str) -> Element | None:
    return None if element is None else next(_children(element, name), None)


def _number(element: Element | None, name: str, where: str, default: float = 0.0) -> float:
    child = _child(element, name)
    return default if child is None else numbers(child.text, f"{where}: <{name}>")[0]


def _is_hydrodynamics(element: Element) -> bool:
    return "hydrodynamics" in f"{element.get('name', '')} {element.get('filename', '')}".lower()


def _pose(text: str | None, where: str) -> tuple[Array, Array]:
    """Position (3,) and rotation (3, 3) of a pose ``x y z roll pitch yaw``."""
    if text is None or not text.strip():
        return np.zeros(3), np.eye(3)
    six = numbers(text, where, count=6)
    return np.array(six[:3]), matrix(from_euler(np.array(six[3:])))


def read(root: Element, source: str, *, rho: float | None = None) -> tuple[Body, tuple[str, ...]]:
    """Body of a model, and sentences on what was not taken.

    `source`: of messages; `rho`: density of the water, kg/m3, instead of that of the plugin. Raises
    `VehicleError`: the model has no link with the plugin Hydrodynamics, or a number is none.
    """
    plugins = [plugin for plugin in root.iter("plugin") if _is_hydrodynamics(plugin)]
    if not plugins:
        raise VehicleError(
            f"{source}: expected an SDF model with the plugin Hydrodynamics of gz-sim, found <{_local(root)}>"
            " without it; convert a URDF with gz sdf -p, and write the hydrodynamics of another simulator as"
            " that plugin"
        )
    plugin = plugins[0]
    name = (plugin.findtext("link_name") or "").strip()
    link = next((link for link in root.iter("link") if link.get("name") == name), None)
    if link is None:
        raise VehicleError(
            f"{source}: expected a link {name!r}, which <link_name> of the plugin names, found none"
        )
    left = []
    if len(plugins) > 1:
        left.append(f"{len(plugins)} links have hydrodynamics; {name} alone was read.")
    where = f"{source}: link {name}"
    mass, centre, inertia = _inertial(_child(link, "inertial"), where)
    water = rho or _number(plugin, "water_density", where, _number(plugin, "waterDensity", where, 998.0))
    added, linear, quadratic = _hydrodynamics(plugin, where, left)
    added += _fluid_added_mass(_child(link, "inertial"), where)
    volume, middle, size, is_round = _collisions(link, where, left)
    _other_parts(root, name, mass, where, left)
    body = Body(
        name=next((model.get("name", "model") for model in root.iter("model")), "model"),
        mass=mass,
        gravity_centre=_FLIP3 @ centre,
        inertia=_FLIP3 @ inertia @ _FLIP3,
        buoyancy=None if volume is None else water * 9.81 * volume,
        buoyancy_centre=_FLIP3 @ middle,
        added_mass=_FLIP6 * added,
        linear=_FLIP6 * linear,
        quadratic=_FLIP6 * quadratic,
        rho=water,
        size=size,
        round=is_round,
    )
    return body, tuple(left)


def _inertial(inertial: Element | None, where: str) -> tuple[float, Array, Array]:
    """Mass, centre of gravity (3,) and inertia about the link's origin (3, 3), forward-left-up."""
    mass = _number(inertial, "mass", where)
    centre, turn = _pose(None if inertial is None else inertial.findtext("pose"), f"{where}: <pose>")
    tensor = np.zeros((3, 3))
    for key, (i, j) in _TENSOR.items():
        # SDF: moments that are not given are 1, products 0.
        value = _number(_child(inertial, "inertia"), key, where, 1.0 if i == j else 0.0)
        tensor[i, j] = tensor[j, i] = value
    parallel_axis = float(centre @ centre) * np.eye(3) - np.outer(centre, centre)
    return mass, centre, np.asarray(turn @ tensor @ turn.T + mass * parallel_axis)


def _hydrodynamics(plugin: Element, where: str, left: list[str]) -> tuple[Array, Array, Array]:
    """Added mass, linear and quadratic damping of the plugin, (6, 6) each, forward-left-up."""
    derivatives, linear, quadratic = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 6))
    known = {"link_name", "water_density", "waterDensity", "disable_added_mass", "disable_coriolis"}
    for i, force in enumerate(_FORCES):
        for j, velocity in enumerate(_VELOCITIES):
            for target, key in (
                (derivatives, f"{force}Dot{velocity}"),
                (linear, f"{force}{velocity}"),
                (quadratic, f"{force}{velocity}abs{velocity}"),
            ):
                known.add(key)
                target[i, j] = _number(plugin, key, where)
    # Versions up to 6 and later ones differ in the sign of xDotU; a file does not say its version.
    diagonal = np.diag(derivatives)
    if diagonal.any() and (diagonal >= 0.0).all():
        left.append(
            "xDotU ... nDotR are positive, as gz-sim took them up to version 6; from version 7 on they are"
            " derivatives and these would be negative added masses. Taken as added masses."
        )
        derivatives = -derivatives
    if plugin.findtext("disable_added_mass", "").strip().lower() in ("true", "1"):
        derivatives = np.zeros((6, 6))
    # Whatever else the plugin has is named, so that nothing is lost in silence.
    others = sorted({_local(child) for child in plugin} - known)
    products = [key for key in others if len(key) in (3, 6) and key[0] in _FORCES]
    if products:
        left.append(
            f"{', '.join(products)}: products of two velocities without a name in vehicle files were not"
            " taken; a quadratic damping is named like xUabsU."
        )
    others = [key for key in others if key not in products]
    if others:
        left.append(f"Of the plugin not taken: {', '.join(others)}.")
    return -derivatives, linear, quadratic


def _fluid_added_mass(inertial: Element | None, where: str) -> Array:
    """Added mass that the physics engine solves with the mass, (6, 6), forward-left-up."""
    added = np.zeros((6, 6))
    fluid = _child(inertial, "fluid_added_mass")
    for i, first in enumerate(_ADDED):
        for j, second in enumerate(_ADDED[i:], i):
            added[i, j] = added[j, i] = _number(fluid, first + second, where)
    return added


def _other_parts(root: Element, name: str, mass: float, where: str, left: list[str]) -> None:
    """Name plugins and links that were not read."""
    more = sorted({
        plugin.get("name", "?") for plugin in root.iter("plugin") if not _is_hydrodynamics(plugin)
    })
    if more:
        left.append(f"Other plugins (thrusters, fins, sensors) were not read: {', '.join(more[:8])}.")
    links = list(root.iter("link"))
    if len(links) > 1:
        weight = sum(_number(_child(link, "inertial"), "mass", where) for link in links) - mass
        left.append(f"Other links, {weight:.3g} kg together, were not added to the mass of {name}.")


def _shape(geometry: Element | None, where: str) -> tuple[float, tuple[float, float, float], bool] | None:
    """Volume, size and whether it is round, of a box, a sphere, a cylinder or an ellipsoid along z."""
    if geometry is None:
        return None
    for shape in geometry:
        kind = _local(shape)
        if kind == "box":
            a, b, c = numbers(shape.findtext("size"), f"{where}: <size>", count=3)
            return a * b * c, (a, b, c), False
        if kind == "sphere":
            r = _number(shape, "radius", where)
            return 4.0 / 3.0 * math.pi * r**3, (2 * r, 2 * r, 2 * r), True
        if kind in ("cylinder", "capsule"):
            r, length = _number(shape, "radius", where), _number(shape, "length", where)
            cap = 4.0 / 3.0 * math.pi * r**3 if kind == "capsule" else 0.0
            return math.pi * r * r * length + cap, (2 * r, 2 * r, length), False
        if kind == "ellipsoid":
            a, b, c = numbers(shape.findtext("radii"), f"{where}: <radii>", count=3)
            return 4.0 / 3.0 * math.pi * a * b * c, (2 * a, 2 * b, 2 * c), b == c
    return None


def _collisions(
    link: Element, where: str, left: list[str]
) -> tuple[float | None, Array, tuple[float, float, float] | None, bool]:
    """Volume of the collisions and its centre, forward-left-up; size of the hull where it is one shape."""
    volume, moment = 0.0, np.zeros(3)
    sizes: list[tuple[tuple[float, float, float], bool]] = []
    for collision in _children(link, "collision"):
        shape = _shape(_child(collision, "geometry"), where)
        if shape is None:
            name = collision.get("name", "?")
            left.append(f"The volume of collision {name} is not known (a mesh or plane).")
            return None, np.zeros(3), None, False
        place, turn = _pose(collision.findtext("pose"), f"{where}: <pose> of a collision")
        volume += shape[0]
        moment += shape[0] * place
        # The smallest box along the link's axes that holds the turned shape.
        extent = np.abs(turn) @ np.array(shape[1])
        sizes.append(((float(extent[0]), float(extent[1]), float(extent[2])), shape[2]))
    if not volume > 0.0:
        return None, np.zeros(3), None, False
    hull, is_round = sizes[0] if len(sizes) == 1 else (None, False)
    return volume, moment / volume, hull, is_round and hull is not None and hull[0] > hull[1]


def write(body: Body, comment: str) -> tuple[str, list[str]]:
    """SDF model with the hydrodynamics plugin of gz-sim, and what it cannot hold."""
    root = ElementTree.Element("sdf", version="1.10")
    model = _add(root, "model", name=body.name)
    link = _add(model, "link", name="base_link")
    inertial = _add(link, "inertial")
    _add(inertial, "pose", _text(*(_FLIP3 @ body.gravity_centre), 0, 0, 0))
    _add(inertial, "mass", _text(body.mass))
    # SDF takes the inertia about the centre of gravity; a body has it about O.
    c = body.gravity_centre
    centred = _FLIP3 @ (body.inertia - body.mass * (float(c @ c) * np.eye(3) - np.outer(c, c))) @ _FLIP3
    tensor = _add(inertial, "inertia")
    for key, (i, j) in _TENSOR.items():
        _add(tensor, key, _text(centred[i, j]))
    added = _FLIP6 * body.added_mass
    fluid = _add(inertial, "fluid_added_mass")
    for i, first in enumerate(_ADDED):
        for j, second in enumerate(_ADDED[i:], i):
            _add(fluid, first + second, _text(added[i, j]))
    # The plugin Buoyancy of the world takes volume and centre from the collisions.
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
            for damping, key in (
                (_FLIP6 * body.linear, f"{force}{velocity}"),
                (_FLIP6 * body.quadratic, f"{force}{velocity}abs{velocity}"),
            ):
                if damping[i, j]:
                    _add(plugin, key, _text(damping[i, j]))
    # The engine has the added mass already; the plugin would count it twice.
    _add(plugin, "disable_added_mass", "true")
    _add(plugin, "disable_coriolis", "true")
    lost = [
        "Buoyancy needs the plugin Buoyancy in the world; the collision is a box with the displaced volume"
        " at the centre of buoyancy, and so no shape for contacts.",
        f"The world's gravity must be {body.g:g} m/s2 and the density of Buoyancy {body.rho:g} kg/m3.",
        "fluid_added_mass needs SDF 1.10 and a physics engine that knows it (DART).",
    ]
    ElementTree.indent(root)
    lines = ElementTree.tostring(root, encoding="unicode")
    safe = comment.replace("--", "- -")
    return f'<?xml version="1.0" encoding="utf-8"?>\n<!-- {safe} -->\n{lines}\n', lost


def _text(*values: float) -> str:
    return " ".join(f"{value + 0.0:.9g}" for value in values)


def _add(parent: Element, tag: str, text: str = "", /, **attributes: str) -> Element:
    child = ElementTree.SubElement(parent, tag, attributes)
    child.text = text or None
    return child


def _hull(body: Body) -> tuple[float, float, float]:
    """Size of a box with the displaced volume, in the proportions of the hull; a cube without one."""
    volume = (body.mass * body.g if body.buoyancy is None else body.buoyancy) / (body.rho * body.g)
    length, width, height = body.size or (1.0, 1.0, 1.0)
    scale = (volume / (length * width * height)) ** (1.0 / 3.0)
    return length * scale, width * scale, height * scale
