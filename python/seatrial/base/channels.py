"""Channels of a trial, axes of the vehicle and units: order, what people read, differences, factors (pint).

The mean of an angle is that of its direction, ``arg mean(exp(i phi))``, and its differences are taken the
shorter way round (Mardia and Jupp, *Directional Statistics*, 2000, section 2.2). Held by
``tests/scoring/test_score.py`` and ``tests/estimation/test_segment_scale.py``.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError
from seatrial.base.frames import shorter

CHANNELS = ("u", "v", "w", "p", "q", "r", "x", "y", "z", "roll", "pitch", "yaw")
"""Order of the channels wherever an array has twelve columns: m/s, rad/s, m, rad."""

AXES = "XYZKMN"
"""Letters of the axes in the core's order."""

MOTIONS = dict(zip(AXES, ("surge", "sway", "heave", "roll", "pitch", "yaw"), strict=True))
"""Name of the motion along or about each axis, by its letter."""

VELOCITIES = "uvwpqr"
"""Velocity of each axis: m/s, rad/s."""

DEGREE = float(np.pi / 180.0)
"""One degree in rad."""

ANGLES = ("roll", "pitch", "yaw")
"""Channels that are angles, rad."""


def difference(values: Array, others: Array, channel: str) -> Array:
    """Values minus others (n,), SI; of an angle the shorter way round."""
    apart = values - others
    return shorter(apart) if channel in ANGLES else apart


def deviations(values: Array, channel: str) -> Array:
    """Values (n,), at least one, minus their mean, SI; of an angle minus the mean of its direction.

    Examples
    --------
    >>> deviations(np.deg2rad([179.0, -179.0]), "yaw").round(6).tolist()
    [-0.017453, 0.017453]
    """
    mean = np.angle(np.mean(np.exp(1j * values))) if channel in ANGLES else values.mean()
    return difference(values, mean, channel)


def readable(channel: str) -> tuple[float, str]:
    """Factor from SI to the unit that people read, and that unit.

    Examples
    --------
    >>> readable("u"), readable("yaw")[1]
    ((1.0, 'm/s'), 'deg')
    """
    degrees = channel in (*VELOCITIES[3:], *ANGLES)
    return 1.0 / DEGREE if degrees else 1.0, ("deg" if degrees else "m") + (
        "/s" if channel in VELOCITIES else ""
    )


ACTUATOR_UNITS = ("rpm", "us", "N", "rad")
"""What a command may be: revolutions, pulse width, force or angle, told apart by dimension."""


@lru_cache(maxsize=1)
def _registry() -> Any:
    import pint

    registry: Any = pint.UnitRegistry()
    registry.define("newton_meter = newton * meter = Nm")
    registry.define("rev = 2 * pi * radian")
    return registry


@lru_cache(maxsize=256)
def unit_factor(unit: str, wanted: tuple[str, ...], where: str) -> float:
    """Factor that turns a number in `unit` into one in that of the `wanted` units which has its dimension.

    Raises `TrialError`: if the unit is unknown or has another dimension; the message begins with `where`.

    Examples
    --------
    >>> unit_factor("km/h", ("m/s",), "u_m_s")
    0.2777777777777778
    """
    registry = _registry()
    example = f'for example "{wanted[0]}"'
    try:
        quantity = registry.Quantity(1.0, unit)
    except Exception:  # pint raises errors of its parser as well as its own
        raise TrialError(f'{where}: unknown unit "{unit}"; write it as a formula, {example}') from None
    for target in wanted:
        if quantity.check(registry.Quantity(1.0, target).dimensionality):
            return float(quantity.to(target).magnitude)
    expected = " or ".join(f'"{target}"' for target in wanted)
    raise TrialError(
        f'{where}: unit "{unit}" has the dimension {quantity.dimensionality}; '
        f"expected one that converts to {expected}"
    )


@lru_cache(maxsize=256)
def is_unit(unit: str) -> bool:
    """Whether a text is a unit.

    Examples
    --------
    >>> is_unit("mm/s"), is_unit("filtered"), is_unit("")
    (True, False, False)
    """
    if not unit:
        return False
    try:
        _registry().Quantity(1.0, unit)
    except Exception:  # pint raises errors of its parser as well as its own
        return False
    return True
