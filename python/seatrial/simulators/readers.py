"""Models of gz-sim (SDF), uuv_simulator (URDF, xacro) and Stonefish (XML) as bodies.

Conventions, read in their sources (facts only):

- gz-sim, plugin Hydrodynamics (gazebosim/gz-sim at 775ba7df): ``xU``, ``xUabsU`` and ``xDotU`` are
derivatives
  in forward-left-up, so negative; up to version 6 ``xDotU`` was the added mass itself, so positive.
  ``fluid_added_mass`` in ``<inertial>`` (SDF) is the added mass itself. Buoyancy follows the collisions.
- uuv_simulator, model "fossen" (uuvsimulator/uuv_simulator at 0db06494 and its later interface with ToNED):
  ``added_mass`` is the added mass itself, ``linear_damping`` and ``quadratic_damping`` are derivatives, so
  negative, all in forward-right-down; ``center_of_buoyancy`` and the link are forward-left-up.
- Stonefish (patrykcieslak/stonefish, docs at 05dcd21a): forward-right-down; drag and added mass are computed
  from the shape and not told by the file.

Held by ``tests/simulators/test_convert.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import VehicleError
from seatrial.base.rotation import from_euler, matrix
from seatrial.simulators.body import FLIP, Body
from seatrial.simulators.markup import Element, children, expanded, local, numbers

KINDS = {"sdf": "gz-sim", "uuv": "uuv_simulator", "stonefish": "Stonefish"}

_FORCES, _VELOCITIES = "xyzkmn", "UVWPQR"

_ADDED = "xyzpqr"

_FLIP3 = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True, eq=False)
class Read:
    """A body of a file, in what form it was, and sentences on what was not taken."""

    body: Body
    kind: str
    left: tuple[str, ...] = ()
    old_added_mass: bool = False


def kind_of(root: Element, source: str) -> str:
    """Form of a model: "sdf", "uuv" or "stonefish".

    Raises
    ------
    VehicleError
        It is none of them.
    """
    name = local(root)
    if name == "sdf" or any(_is_hydrodynamics(one) for one in root.iter("plugin")):
        return "sdf"
    if name == "robot" and any(local(one) == "hydrodynamic_model" for one in root.iter()):
        return "uuv"
    if name == "scenario" or any(one.get("physics") for one in root.iter()):
        return "stonefish"
    raise VehicleError(
        f"{source}: expected a model with the hydrodynamics plugin of gz-sim (SDF), a hydrodynamic_model of"
        f" uuv_simulator (URDF) or a scenario of Stonefish, found <{name}>"
    )


def read(root: Element, source: str, *, rho: float | None = None) -> Read:
    """Body of a model in any of the forms.

    Raises
    ------
    VehicleError
        The model has no body with hydrodynamics, or a number is none.
    """
    readers: dict[str, Callable[[Element, str, float | None], Read]] = {
        "sdf": _sdf,
        "uuv": _uuv,
        "stonefish": _stonefish,
    }
    return readers[kind_of(root, source)](root, source, rho)


def _number(element: Element | None, name: str, where: str, default: float = 0.0) -> float:
    if element is None:
        return default
    found = next(children(element, name), None)
    return default if found is None else numbers(found.text, f"{where}: <{name}>")[0]


def _is_hydrodynamics(element: Element) -> bool:
    return "hydrodynamics" in f"{element.get('name', '')} {element.get('filename', '')}".lower()


def _child(element: Element | None, name: str) -> Element | None:
    return None if element is None else next(children(element, name), None)


def _about_origin(inertia: Array, mass: float, c: Array) -> Array:
    return np.asarray(inertia + mass * (float(c @ c) * np.eye(3) - np.outer(c, c)))


def _symmetric(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> Array:
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _pose(text: str | None, where: str) -> tuple[Array, Array]:
    """Position (3,) and rotation (3, 3) of a pose ``x y z roll pitch yaw``."""
    if text is None or not text.strip():
        return np.zeros(3), np.eye(3)
    six = numbers(text, where, count=(6,))
    return np.array(six[:3]), matrix(from_euler(np.array(six[3:])))


def _sdf(root: Element, source: str, rho: float | None) -> Read:
    plugins = [one for one in root.iter("plugin") if _is_hydrodynamics(one)]
    if not plugins:
        raise VehicleError(f"{source}: expected a plugin Hydrodynamics of gz-sim, found none in this model")
    plugin = plugins[0]
    name = (plugin.findtext("link_name") or "").strip()
    links = [one for one in root.iter("link") if one.get("name") == name]
    if not links:
        raise VehicleError(
            f"{source}: expected a link {name!r}, which <link_name> of the plugin names, found none"
        )
    link = links[0]
    left = []
    if len(plugins) > 1:
        left.append(f"{len(plugins)} links have hydrodynamics; {name} alone was read.")
    inertial = _child(link, "inertial")
    where = f"{source}: link {name}"
    mass = _number(inertial, "mass", where)
    centre, turn = _pose(None if inertial is None else inertial.findtext("pose"), f"{where}: <pose>")
    tensor = _child(inertial, "inertia")
    six = [
        _number(tensor, key, where, 1.0 if key[1] == key[2] else 0.0)
        for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    ]
    inertia = _about_origin(turn @ _symmetric(*six) @ turn.T, mass, centre)
    density = _number(plugin, "water_density", where, _number(plugin, "waterDensity", where, 998.0))
    added, linear, quadratic = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 6))
    known = {"link_name", "water_density", "waterDensity"}
    for i, force in enumerate(_FORCES):
        for j, velocity in enumerate(_VELOCITIES):
            for target, key in (
                (added, f"{force}Dot{velocity}"),
                (linear, f"{force}{velocity}"),
                (quadratic, f"{force}{velocity}abs{velocity}"),
            ):
                known.add(key)
                target[i, j] = _number(plugin, key, where)
    derivatives = added.copy()
    old = bool(added.any()) and bool((np.diag(added) >= 0.0).all()) and bool(np.diag(added).any())
    added = derivatives if old else -derivatives
    if old:
        left.append(
            "xDotU ... nDotR are positive, as gz-sim took them up to version 6; from version 7 on they are"
            " derivatives and these would be negative added masses. Taken as added masses."
        )
    if plugin.findtext("disable_added_mass", "").strip().lower() in ("true", "1"):
        added = np.zeros((6, 6))
    fluid = _child(inertial, "fluid_added_mass")
    if fluid is not None:
        for i, first in enumerate(_ADDED):
            for j, second in enumerate(_ADDED[i:], i):
                value = _number(fluid, first + second, where)
                added[i, j] += value
                added[j, i] += value if i != j else 0.0
    others = sorted({local(one) for one in plugin} - known - {"disable_added_mass", "disable_coriolis"})
    products = [one for one in others if len(one) in (3, 6) and one[0] in _FORCES]
    if products:
        left.append(
            f"{', '.join(products)}: products of two velocities without a name in vehicle files were not"
            " taken;"
            " a quadratic damping is named like xUabsU."
        )
        others = [one for one in others if one not in products]
    if others:
        left.append(f"Of the plugin not taken: {', '.join(others)}.")
    volume, middle, size, is_round = _collisions(link, where, left)
    more = sorted({one.get("name", "?") for one in root.iter("plugin") if not _is_hydrodynamics(one)})
    if more:
        left.append(f"Other plugins (thrusters, fins, sensors) were not read: {', '.join(more[:8])}.")
    if len(list(root.iter("link"))) > 1:
        weight = sum(_number(_child(one, "inertial"), "mass", where) for one in root.iter("link")) - mass
        left.append(f"Other links, {weight:.3g} kg together, were not added to the mass of {name}.")
    flip = FLIP[:, None] * FLIP[None, :]
    water = density if rho is None else rho
    return Read(
        Body(
            name=next((one.get("name", "model") for one in root.iter("model")), "model"),
            mass=mass,
            gravity_centre=_FLIP3 @ centre,
            inertia=_FLIP3 @ inertia @ _FLIP3,
            buoyancy=None if volume is None else water * 9.81 * volume,
            buoyancy_centre=_FLIP3 @ middle,
            added_mass=flip * added,
            linear=flip * linear,
            quadratic=flip * quadratic,
            rho=water,
            size=size,
            round=is_round,
        ),
        "sdf",
        tuple(left),
        old,
    )


def _shape(geometry: Element | None, where: str) -> tuple[float, tuple[float, float, float], bool] | None:
    """Volume, size and whether it is round, of a box, a sphere, a cylinder or an ellipsoid along z."""
    if geometry is None:
        return None
    for one in geometry:
        kind = local(one)
        if kind == "box":
            a, b, c = numbers(one.findtext("size"), f"{where}: <size>", count=(3,))
            return a * b * c, (a, b, c), False
        if kind == "sphere":
            r = _number(one, "radius", where)
            return 4.0 / 3.0 * math.pi * r**3, (2 * r, 2 * r, 2 * r), True
        if kind in ("cylinder", "capsule"):
            r, length = _number(one, "radius", where), _number(one, "length", where)
            cap = 4.0 / 3.0 * math.pi * r**3 if kind == "capsule" else 0.0
            return math.pi * r * r * length + cap, (2 * r, 2 * r, length), False
        if kind == "ellipsoid":
            a, b, c = numbers(one.findtext("radii"), f"{where}: <radii>", count=(3,))
            return 4.0 / 3.0 * math.pi * a * b * c, (2 * a, 2 * b, 2 * c), b == c
    return None


def _collisions(
    link: Element, where: str, left: list[str]
) -> tuple[float | None, Array, tuple[float, float, float] | None, bool]:
    """Volume of the collisions and its centre, forward-left-up; size of the hull where it is one shape."""
    volume, moment = 0.0, np.zeros(3)
    sizes: list[tuple[tuple[float, float, float], bool]] = []
    for one in children(link, "collision"):
        shape = _shape(_child(one, "geometry"), where)
        if shape is None:
            left.append(f"The volume of collision {one.get('name', '?')} is not known (a mesh or plane).")
            return None, np.zeros(3), None, False
        place, turn = _pose(one.findtext("pose"), f"{where}: <pose> of a collision")
        volume += shape[0]
        moment += shape[0] * place
        extent = np.abs(turn) @ np.array(shape[1])
        sizes.append(((float(extent[0]), float(extent[1]), float(extent[2])), shape[2]))
    if not volume > 0.0:
        return None, np.zeros(3), None, False
    hull, is_round = sizes[0] if len(sizes) == 1 else (None, False)
    return volume, moment / volume, hull, is_round and hull is not None and hull[0] > hull[1]


def _uuv(root: Element, source: str, rho: float | None) -> Read:
    root = expanded(root, source)
    model = next(
        (
            one
            for one in root.iter()
            if local(one) == "link" and _child(one, "hydrodynamic_model") is not None
        ),
        None,
    )
    if model is None:
        raise VehicleError(f"{source}: expected a <link> with a <hydrodynamic_model>, found none")
    name = model.get("name", "base_link")
    where = f"{source}: link {name}"
    hydro = _child(model, "hydrodynamic_model")
    left: list[str] = []
    kind = "" if hydro is None else (hydro.findtext("type") or "").strip()
    if kind not in ("fossen", ""):
        left.append(
            f'Model "{kind}" computes drag and added mass from its shape: only what the file gives was read.'
        )
    water = 1028.0 if rho is None else rho
    density = next((one for one in root.iter() if local(one) == "fluid_density"), None)
    if rho is None and density is not None:
        water = numbers(density.text, f"{where}: <fluid_density>")[0]
    added = _square(hydro, "added_mass", where, (36,))
    linear = _square(hydro, "linear_damping", where, (6, 36))
    quadratic = _square(hydro, "quadratic_damping", where, (6, 36))
    forward = _square(hydro, "linear_damping_forward_speed", where, (6, 36))
    if forward.any():
        left.append("linear_damping_forward_speed was not taken: give Y_uv, Z_uw, M_uw, N_uv ... by hand.")
    if (added - np.diag(np.diag(added))).any():
        left.append(
            "Off-diagonal added mass was read as forward-right-down; versions of the plugin without ToNED use"
            " forward-left-up, which turns the signs of some of them."
        )
    for key in ("scaling_added_mass", "offset_added_mass", "scaling_damping", "offset_linear_damping"):
        if _child(hydro, key) is not None:
            left.append(f"{key} was not applied.")
    inertial = _inertial(root, name)
    mass, centre, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
    volume = _number(model, "volume", where)
    if inertial is not None:
        mass, centre, inertia = _urdf_inertial(inertial, where)
    neutral = (model.findtext("neutrally_buoyant") or "0").strip().lower() in ("1", "true")
    if not mass > 0.0:
        if not volume > 0.0:
            raise VehicleError(
                f"{where}: expected a mass or a volume, found neither; give the URDF of the whole robot"
            )
        mass = water * volume
        left.append(
            f"The file has no mass: {mass:.4g} kg, that of the displaced water, was taken; correct m."
        )
        inertia = _ellipsoid_inertia(model, mass, where, left)
    cob = numbers(
        (model.findtext("center_of_buoyancy") or "0 0 0"), f"{where}: <center_of_buoyancy>", count=(3,)
    )
    size = _box(model, where)
    body = Body(
        name=root.get("name") or name.rpartition("/")[0] or name,
        mass=mass,
        gravity_centre=_FLIP3 @ centre,
        inertia=_FLIP3 @ inertia @ _FLIP3,
        buoyancy=mass * 9.81 if neutral else (water * 9.81 * volume if volume > 0.0 else None),
        buoyancy_centre=_FLIP3 @ np.array(cob),
        added_mass=added,
        linear=linear,
        quadratic=quadratic,
        rho=water,
        size=size,
    )
    left.append("Thrusters and fins of the model were not read.")
    return Read(body, "uuv", tuple(left))


def _square(element: Element | None, name: str, where: str, count: tuple[int, ...]) -> Array:
    found = _child(element, name)
    if found is None:
        return np.zeros((6, 6))
    values = np.array(numbers(found.text, f"{where}: <{name}>", count=count))
    return np.diag(values) if len(values) == 6 else values.reshape(6, 6)


def _inertial(root: Element, name: str) -> Element | None:
    """Inertial of a URDF link: that of the same name, else of the only one that has one."""
    with_one: list[tuple[str, Element]] = []
    for one in root.iter():
        if local(one) == "link":
            inertial = _child(one, "inertial")
            if inertial is not None:
                with_one.append((one.get("name", ""), inertial))
    same = [inertial for other, inertial in with_one if other == name]
    return same[0] if same else (with_one[0][1] if len(with_one) == 1 else None)


def _attribute(element: Element | None, key: str, where: str, default: float = 0.0) -> float:
    value = None if element is None else element.get(key)
    return default if value is None else numbers(value, f"{where}: {key}")[0]


def _urdf_inertial(inertial: Element, where: str) -> tuple[float, Array, Array]:
    mass = _attribute(_child(inertial, "mass"), "value", where)
    origin = _child(inertial, "origin")
    place = "0 0 0" if origin is None else origin.get("xyz", "0 0 0")
    angles = "0 0 0" if origin is None else origin.get("rpy", "0 0 0")
    centre = np.array(numbers(place, f"{where}: origin", count=(3,)))
    turn = matrix(from_euler(np.array(numbers(angles, f"{where}: origin", count=(3,)))))
    tensor = _child(inertial, "inertia")
    six = [_attribute(tensor, key, where) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")]
    return mass, centre, _about_origin(turn @ _symmetric(*six) @ turn.T, mass, centre)


def _box(model: Element, where: str) -> tuple[float, float, float] | None:
    box = _child(model, "box")
    if box is None:
        return None
    size = tuple(_number(box, key, where) for key in ("length", "width", "height"))
    return (size[0], size[1], size[2]) if min(size) > 0.0 else None


def _ellipsoid_inertia(model: Element, mass: float, where: str, left: list[str]) -> Array:
    size = _box(model, where)
    if size is None:
        raise VehicleError(
            f"{where}: expected inertia or a box, found neither; give the URDF of the whole robot"
        )
    a, b, c = (0.5 * value for value in size)
    left.append(
        "The file has no inertia: that of an even ellipsoid in its box was taken; correct I_x, I_y, I_z."
    )
    return np.diag([b * b + c * c, a * a + c * c, a * a + b * b]) * mass / 5.0


def _stonefish(root: Element, source: str, rho: float | None) -> Read:
    bodies = [
        one
        for one in root.iter()
        if one.get("physics") in ("submerged", "floating") and _child(one, "mass") is not None
    ]
    if not bodies:
        raise VehicleError(
            f'{source}: expected a body with physics="submerged" and a <mass>, found none: what'
            " Stonefish computes"
            " from meshes is not in the file"
        )
    one = bodies[0]
    name = one.get("name", "model")
    where = f"{source}: body {name}"
    left = []
    if len(bodies) > 1:
        left.append(f"{len(bodies)} bodies have a mass; {name} alone was read.")
    mass = _attribute(_child(one, "mass"), "value", where)
    inertia = _child(one, "inertia")
    three = [1.0, 1.0, 1.0]
    if inertia is None:
        left.append(
            "The file has no inertia: Stonefish computes it; 1 kg m2 was taken, correct I_x, I_y, I_z."
        )
    else:
        three = numbers(inertia.get("xyz"), f"{where}: inertia", count=(3,))
    cg = _child(one, "cg")
    place = "0 0 0" if cg is None else cg.get("xyz", "0 0 0")
    angles = "0 0 0" if cg is None else cg.get("rpy", "0 0 0")
    centre = np.array(numbers(place, f"{where}: cg", count=(3,)))
    turn = matrix(from_euler(np.array(numbers(angles, f"{where}: cg", count=(3,)))))
    fluid = next((w for w in root.iter("water") if w.get("density")), None)
    water = rho or (1031.0 if fluid is None else numbers(fluid.get("density"), f"{source}: water")[0])
    volume, middle, size = _stonefish_volume(one, where)
    if one.get("buoyant", "true").strip().lower() == "false":
        volume = 0.0
    if volume is None:
        left.append(
            "Volume, added mass and drag come from a mesh, which is not read: fill in B and the coefficients."
        )
    drag = _child(one, "hydrodynamics")
    if drag is not None:
        left.append(
            f"Dimensionless drag (viscous {drag.get('viscous_drag', 'none')}, quadratic"
            f" {drag.get('quadratic_drag', 'none')}) acts on faces of the mesh and has no counterpart."
        )
    left.append("Added mass and damping are not in a Stonefish file: identify them, or give a geometry.")
    body = Body(
        name=name,
        mass=mass,
        gravity_centre=centre,
        inertia=_about_origin(turn @ np.diag(three) @ turn.T, mass, centre),
        buoyancy=None if volume is None else water * 9.81 * volume,
        buoyancy_centre=middle,
        rho=water,
        size=size,
    )
    return Read(body, "stonefish", tuple(left))


def _stonefish_volume(
    one: Element, where: str
) -> tuple[float | None, Array, tuple[float, float, float] | None]:
    """Volume of a parametric body, its centre and size."""
    dimensions, kind = _child(one, "dimensions"), one.get("type", "")
    origin = _child(one, "origin")
    middle = np.zeros(3)
    if origin is not None:
        middle = np.array(numbers(origin.get("xyz", "0 0 0"), f"{where}: origin", count=(3,)))
    if dimensions is None:
        return None, np.zeros(3), None
    if kind == "box":
        a, b, c = numbers(dimensions.get("xyz"), f"{where}: dimensions", count=(3,))
        return a * b * c, middle, (a, b, c)
    r = _attribute(dimensions, "radius", where)
    if kind == "sphere":
        return 4.0 / 3.0 * math.pi * r**3, middle, (2 * r, 2 * r, 2 * r)
    if kind == "cylinder":
        return math.pi * r * r * _attribute(dimensions, "height", where), middle, None
    return None, np.zeros(3), None
