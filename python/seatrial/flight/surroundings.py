"""What is around a flight besides the bottom: eddies and obstacles, or a sentence on why they are none.

Held by ``tests/test_surroundings.py``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from seatrial.errors import SimulationError
from seatrial.flight.checked_numbers import is_number

__all__ = ["checked_obstacles", "checked_times", "checked_turbulence"]

_MOST_M_S = 5.0
_LONGEST_S = 1e5


def checked_turbulence(given: Any) -> tuple[float, float, float]:
    """Standard deviations north, east, down, m/s; one number is that of both horizontal components.

    Raises
    ------
    SimulationError
        It is none.

    Examples
    --------
    >>> checked_turbulence(0.1)
    (0.1, 0.1, 0.0)
    """
    if is_number(given):
        given = (given, given, 0.0)
    try:
        values = [float(x) for x in np.asarray(given, float).ravel()]
    except (TypeError, ValueError):
        values = []
    if len(values) != 3 or not all(0.0 <= x <= _MOST_M_S for x in values):
        raise SimulationError(
            f"turbulence: expected a standard deviation from 0 to {_MOST_M_S:g} m/s, or three of them north,"
            f" east and down, found {given!r}"
        )
    return values[0], values[1], values[2]


def checked_times(given: Any) -> tuple[float, float]:
    """Two time constants of a turbulent current, s.

    Raises
    ------
    SimulationError
        They are none.
    """
    values = list(given) if isinstance(given, tuple | list) else []
    if len(values) != 2 or not all(is_number(x) and 0.01 <= x <= _LONGEST_S for x in values):
        raise SimulationError(
            f"turbulence_times: expected two times from 0.01 to {_LONGEST_S:g} s, for example (60.0, 2.0),"
            f" found {given!r}"
        )
    return float(values[0]), float(values[1])


def checked_obstacles(given: Any) -> tuple[tuple[float, float, float], ...]:
    """Cylinders: north, east and radius of each, m.

    Raises
    ------
    SimulationError
        One of them is none.
    """
    found = []
    for place, one in enumerate(given):
        row = list(one) if isinstance(one, tuple | list | np.ndarray) else []
        sound = len(row) == 3 and all(is_number(x) and math.isfinite(x) for x in row)
        if not sound or row[2] < 0.0:
            raise SimulationError(
                f"obstacles[{place}]: expected north, east and a radius from 0 on in m, found {one!r}"
            )
        found.append((float(row[0]), float(row[1]), float(row[2])))
    return tuple(found)
