"""Channels of a trial and axes of the vehicle: order, the unit that people read, and differences of angles.

The mean of an angle is that of its direction, ``arg mean(exp(i phi))``, and its differences are taken the
shorter way round (Mardia and Jupp, *Directional Statistics*, 2000, section 2.2). Held by
``tests/scoring/test_score.py`` and ``tests/estimation/test_segment_scale.py``.
"""

from __future__ import annotations

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.rotation import shorter

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
