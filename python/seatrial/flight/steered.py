"""Set points and corridors of a batch: arrays of the right kind, and for how many cases they are.

The core says what is wrong with their values. Held by ``tests/test_batch_of_steps.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.errors import SimulationError
from seatrial.flight.checked_numbers import checked_list

__all__ = ["Corridor", "checked_corridors", "checked_set_points"]

Array = NDArray[np.float64]
Corridor = tuple[str, ArrayLike, ArrayLike, ArrayLike, ArrayLike, ArrayLike, ArrayLike]
"""Channel, base (k,), scale (k,), and per control period lower, upper, target and clock (p,)."""

_PARTS = ("base", "scale", "lower", "upper", "target", "clock")
_EXAMPLE = '("yaw", base, scale, lower, upper, target, clock)'
_EACH = 2  # parts of a corridor that may differ from case to case: base and scale


def checked_set_points(given: Any) -> tuple[dict[str, Array] | None, dict[str, int]]:
    """Set points by name, and the number of cases of those that differ from case to case.

    Raises
    ------
    SimulationError
        They are no arrays by name.

    Examples
    --------
    >>> checked_set_points({"times": [0.0, 5.0], "speed": [1.0, 1.5], "heading": [[0.0, 0.1], [0.0, 0.2]]})[1]
    {'set_points: heading': 2}
    """
    if given is None:
        return None, {}
    if not isinstance(given, Mapping):
        raise SimulationError(
            "set_points: expected {name: values}, for example {'times': [0.0], 'speed': [1.0]}, found"
            f" {given!r}"
        )
    arrays = {str(name): _array(f"set_points: {name}", values) for name, values in given.items()}
    times = arrays.get("times", np.empty(0)).size
    cases = {}
    for name, values in arrays.items():
        # At a single time a row of values is one for each case.
        alone = values.ndim == 1 and times == 1 and values.size > 1
        if name != "times" and (values.ndim > 1 or alone):
            cases[f"set_points: {name}"] = len(values)
    return arrays, cases


def checked_corridors(given: Any) -> tuple[list[Corridor], dict[str, int]]:
    """Corridors, and the number of cases of bases and scales that differ from case to case.

    Raises
    ------
    SimulationError
        One of them is none.
    """
    corridors: list[Corridor] = []
    cases = {}
    for place, row in enumerate(checked_list("corridors", given, str, _EXAMPLE)):
        what = f"corridors[{place}]"
        if not (isinstance(row, tuple | list) and len(row) == 1 + len(_PARTS) and isinstance(row[0], str)):
            raise SimulationError(f"{what}: expected (channel, {', '.join(_PARTS)}), found {row!r}")
        arrays = [_array(f"{what}: {part}", values) for part, values in zip(_PARTS, row[1:], strict=True)]
        for part, values in zip(_PARTS[:_EACH], arrays, strict=False):
            if values.ndim > 0 and len(values) != 1:
                cases[f"{what}: {part}"] = len(values)
        base, scale, lower, upper, target, clock = arrays
        corridors.append((row[0], base, scale, lower, upper, target, clock))
    return corridors, cases


def _array(what: str, values: Any) -> Array:
    try:
        array: Array = np.asarray(values, float)
    except (TypeError, ValueError):
        raise SimulationError(f"{what}: expected numbers, found {values!r}") from None
    return array
