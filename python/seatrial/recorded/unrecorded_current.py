"""A steady current that a log does not tell, fitted to it.

North and east by Gauss-Newton steps on the whitened residuals, with the exact derivatives of the non-linear
model. On one heading a current cannot be told from thrust or drag; what it could hide is taken out of the
chance that the log would have shown it (`seatrial.recorded.power`).

Tests: ``tests/test_recorded_current.py``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from seatrial.recorded.restarts import Restarts
from seatrial.recorded.spread import Spread
from seatrial.recorded.whitening import Whitening

__all__ = ["STRONGEST_M_S", "in_current", "words"]

STRONGEST_M_S = 3.0
"""Tidal streams are weaker, but for a few narrows."""

_STEPS = 4
_STILL_M_S = 1e-3


def in_current(log: Restarts, spread: Spread) -> tuple[Restarts, tuple[float, float]]:
    """Log with the steady current that suits it best, and that current north and east, m/s.

    Parameters
    ----------
    log : Restarts
        Without a recorded current.
    spread : Spread
        Of a valid model's errors.
    """
    current = np.zeros(2)
    found = log.in_water(current)
    for _ in range(_STEPS):
        slopes = found.slopes([], current=True)
        white = Whitening(found, spread, slopes)
        columns = np.concatenate([one.reshape(-1, 2) for one in white.columns(slopes)])
        residual = np.concatenate([one.ravel() for one in white.residual])
        step = np.linalg.lstsq(columns, residual, rcond=1e-9)[0]
        current = np.clip(current + step, -STRONGEST_M_S, STRONGEST_M_S)
        found = log.in_water(current)
        if float(np.abs(step).max()) < _STILL_M_S:
            break
    return found, (float(current[0]), float(current[1]))


def words(current: Sequence[float]) -> str:
    """The current in words.

    Examples
    --------
    >>> words((0.3, 0.3))
    'a steady current of 0.42 m/s towards 45 deg'
    """
    north, east = current
    towards = math.degrees(math.atan2(east, north)) % 360.0
    return f"a steady current of {math.hypot(north, east):.2f} m/s towards {towards:.0f} deg"
