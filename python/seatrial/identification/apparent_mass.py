"""Apparent masses and drags that a vehicle cannot have: a wrong thrust, lever or delay is fitted as them.

`identify` remarks them and `seatrial ardusub` changes no gain from them. Held by
``tests/identification/test_apparent_mass.py`` and ``tests/ardusub/test_tuning.py``.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.channels import AXES, CHANNELS

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.identification.estimate import Estimate

AGREE = 0.3
"""Relative deviation up to which apparent masses agree: of drawn vehicles, and of the vehicle file."""

LARGEST_DRAG = 4.0
"""Largest plausible drag coefficient on the area of the outline. A plate across the flow has up to 2 (Hoerner
1965, chapter 3); parts of an open frame behind one another add up: of the published identified vehicles a
BlueROV2 Heavy has the largest, 3.7 in sway (von Benzon et al. 2022)."""

_CHANNEL = dict(zip(AXES, CHANNELS, strict=False))  # the first six are the velocities along the axes


def masses_of(vehicle: Vehicle) -> dict[str, float]:
    """Apparent mass (inertia) of a vehicle by axis: the diagonal of its mass matrix, kg or kg m2."""
    return dict(zip(AXES, np.diag(np.asarray(vehicle.mass_matrix())).tolist(), strict=True))


def implausible_masses(
    start: Vehicle, coefficients: Sequence[Estimate], masses: Mapping[str, float]
) -> dict[str, str]:
    """Why an apparent mass is implausible, by axis; those that the vehicle of the file can have are left out.

    A small added mass may be several times that of the file and change nothing: what agrees is plausible.

    Parameters
    ----------
    start : Vehicle
        The one that the identification began with.
    coefficients : sequence of Estimate
        What it found.
    masses : mapping
        Apparent masses that it found, by axis, kg or kg m2.
    """
    plausible = plausible_masses(start, {coefficient.name for coefficient in coefficients})
    of_file, implausible = masses_of(start), {}
    for axis, mass in masses.items():
        low, high = plausible[axis]
        # A search that ended at a bound is on it up to rounding, and is told as such.
        if 0.999 * low <= mass <= 1.001 * high or abs(mass - of_file[axis]) <= AGREE * of_file[axis]:
            continue
        added = [
            coefficient
            for coefficient in coefficients
            if coefficient.name == f"{axis}_{_CHANNEL[axis]}dot" and coefficient.start
        ]
        by = "".join(
            f" ({coefficient.name} {coefficient.estimate / coefficient.start:.3g} times its start)"
            for coefficient in added
        )
        implausible[axis] = (
            f"{axis}: implausible, apparent {mass_in_words(axis, mass)} is {mass / of_file[axis]:.2g} times"
            f" the {of_file[axis]:.2g} of the vehicle file{by}, whose bounds allow {low:.2g} to {high:.2g}; a"
            " wrong thrust or lever arm, or an unmodelled delay, may appear as inertia"
        )
    return implausible


def implausible_drags(vehicle: Vehicle, coefficients: Sequence[Estimate]) -> dict[str, float]:
    """Drag coefficients above `LARGEST_DRAG` of the identified quadratic damping, by its name.

    ``C_D = -X_uu / (rho A / 2)``, A the box of the hull's measures seen along the axis. What the data do not
    determine, or reaches below the limit within its 95 % interval, is left out.
    Of a vehicle without measures nothing is implausible.
    """
    box = vehicle.geometry()
    if not box:
        return {}
    length, width, height = (box[side] for side in ("length", "diameter", "height"))
    areas = {"X_uu": width * height, "Y_vv": length * height, "Z_ww": length * width}
    drags = {}
    for coefficient in coefficients:
        if coefficient.name in areas and coefficient.verdict in ("identifiable", "weak"):
            dynamic = -0.5 * vehicle.environment()["rho"] * areas[coefficient.name]
            _, least = coefficient.interval or (coefficient.estimate, coefficient.estimate)
            if least / dynamic > LARGEST_DRAG:
                drags[coefficient.name] = coefficient.estimate / dynamic
    return drags


def plausible_masses(vehicle: Vehicle, freed: Collection[str] = ()) -> dict[str, tuple[float, float]]:
    """Least and largest apparent mass (inertia) of every axis that a vehicle file allows, kg or kg m2.

    The mass matrix of the file with its diagonal added mass at either of its default bounds, 0.2 and 5 times
    the start value, and with mass and inertia at theirs where they are `freed`
    (docs/theory/geometry.md#default-bounds). The drafted campaign searches beyond them where thrust and
    levers are held, because what turns takes their error over: such a value describes the log, and is not
    the vehicle's inertia. An added mass without start value has no bounds: 0 to infinity.

    Parameters
    ----------
    vehicle : Vehicle
        The one that an identification begins with.
    freed : collection of str
        Coefficients that it searches.
    """
    known, values = vehicle.coefficient_info(), vehicle.coefficients()
    rigid = {"X": "m", "Y": "m", "Z": "m", "K": "I_x", "M": "I_y", "N": "I_z"}
    bounds = {}
    for axis, mass in masses_of(vehicle).items():
        added = known[f"{axis}_{_CHANNEL[axis]}dot"]
        bounded = added["lower"] is not None
        least, most = (-float(added["upper"]), -float(added["lower"])) if bounded else (0.0, np.inf)
        rest = mass + values.get(f"{axis}_{_CHANNEL[axis]}dot", 0.0)
        low, high = 0.0, 0.0
        if rigid[axis] in freed:
            body = known[rigid[axis]]
            low, high = (float(body[end]) - values[rigid[axis]] for end in ("lower", "upper"))
        bounds[axis] = (rest + low + least, rest + high + most)
    return bounds


def mass_in_words(axis: str, mass: float, sd: float | None = None) -> str:
    """A mass or an inertia with its unit."""
    what, unit = ("inertia", "kg m2") if axis in "KMN" else ("mass", "kg")
    return f"{what} {mass:.3g}{'' if sd is None else f' ± {sd:.2g}'} {unit}"
