"""Numbers of a flight that are what they should be: refused with a sentence before anything flies.

Held by ``tests/test_bad_input_flights.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.errors import SimulationError
from seatrial.flight.route import Route

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle

__all__ = [
    "checked_list",
    "checked_rows",
    "checked_seabed",
    "checked_seed",
    "checked_step",
    "checked_supply",
    "checked_threads",
    "checked_vector",
    "is_number",
    "longest",
    "positive",
    "within",
]

Array = NDArray[np.float64]

_LARGEST_SEED = 2**53
_MOST_THREADS = 1024
_FASTEST_WATER_M_S = 15.0  # the fastest tidal streams run at 10 m/s
_MOST_STEPS = 10_000  # of the integration in a control period
_TIMES_PLANNED, _MARGIN_S = 3.0, 300.0
_MOST_LOGGED, _MOST_FLOWN = 2_500_000, 100_000_000  # a row of a log and its table take 2.5 kB
_LARGEST_SUPPLY_V = 1000.0


def is_number(value: Any) -> bool:
    """Whether it is a number, finite or not, and no truth value."""
    return isinstance(value, int | float | np.number) and not isinstance(value, bool | np.complexfloating)


def positive(name: str, value: Any, unit: str) -> None:
    """Refuse what is no positive finite number."""
    if not is_number(value) or not math.isfinite(value) or value <= 0.0:
        raise SimulationError(f"{name}: expected a positive number in {unit}, found {value!r}")


def within(name: str, value: Any, ends: tuple[float, float], unit: str) -> None:
    """Refuse what is no number between the ends: a wrong unit, mostly."""
    low, high = ends
    if not is_number(value) or not low <= value <= high:
        raise SimulationError(f"{name}: expected {low:g} to {high:g} {unit}, found {value!r}")


def checked_seed(seed: Any) -> int:
    """A seed that is one.

    Raises
    ------
    SimulationError
        It is none.
    """
    whole = isinstance(seed, int | np.integer) and not isinstance(seed, bool)
    if not whole or not 0 <= seed < _LARGEST_SEED:
        raise SimulationError(f"seed: expected a whole number from 0 to 2^53 - 1, found {seed!r}")
    return int(seed)


def checked_threads(threads: Any) -> None:
    """Refuse a number of threads that is none."""
    whole = isinstance(threads, int | np.integer) and not isinstance(threads, bool)
    if threads is not None and not (whole and 1 <= threads <= _MOST_THREADS):
        raise SimulationError(
            f"threads: expected a whole number from 1 to {_MOST_THREADS}, or None for all, found {threads!r}"
        )


def checked_step(max_step: Any, autopilot: Autopilot) -> None:
    """Refuse a step of the integration that is none, or so small that no flight would end."""
    positive("max_step", max_step, "s")
    if autopilot.period_s / max_step > _MOST_STEPS:
        raise SimulationError(
            f"max_step: expected at least {autopilot.period_s / _MOST_STEPS:.2g} s, a {_MOST_STEPS}th of the"
            f" control period of {autopilot.period_s:g} s, found {max_step:g}; 0.02 s is the usual one"
        )


def checked_supply(voltage: Any, vehicle: Vehicle) -> None:
    """Refuse a supply that is none, and its absence where thrust depends on it."""
    needed = [name for name, facts in vehicle.actuator_info().items() if facts["needs_voltage"]]
    if voltage is None:
        if needed:
            raise SimulationError(
                f"voltage: the thrust of {vehicle.name} ({needed[0]}) depends on the supply voltage; give it"
                " in V, --voltage on the command line"
            )
        return
    positive("voltage", voltage, "V")
    if voltage > _LARGEST_SUPPLY_V:
        raise SimulationError(
            f"voltage: expected at most {_LARGEST_SUPPLY_V:g} V, found {voltage:g}; is it in V?"
        )


def checked_list(name: str, values: Any, kind: type, example: str) -> tuple[Any, ...]:
    """Values as a tuple; one of them alone, a text or nothing at all is answered with an example."""
    if isinstance(values, kind | str | bytes | Mapping) or not isinstance(values, Iterable):
        raise SimulationError(f"{name}: expected a list such as [{example}], found {values!r}")
    return tuple(values)


def checked_vector(name: str, value: Any) -> tuple[float, float, float]:
    """North, east, down of a velocity of water, m/s."""
    rows = checked_rows(name, value)
    if rows.ndim != 1:
        raise SimulationError(
            f"{name}: expected three finite numbers, north, east, down in m/s, found {value!r}"
        )
    return float(rows[0]), float(rows[1]), float(rows[2])


def checked_rows(name: str, value: Any) -> Array:
    """Velocities of water, (3,) or (k, 3), m/s."""
    try:
        rows = np.asarray(value, float)
    except (TypeError, ValueError):
        rows = np.empty(0)
    if rows.ndim not in (1, 2) or rows.shape[-1] != 3 or not np.isfinite(rows).all():
        raise SimulationError(
            f"{name}: expected three finite numbers, north, east, down in m/s, found {value!r}"
        )
    if rows.size and (most := float(np.abs(rows).max())) > _FASTEST_WATER_M_S:
        raise SimulationError(
            f"{name}: expected at most {_FASTEST_WATER_M_S:g} m/s, for no sea runs faster, found {most:g};"
            " give it in m/s (1 kn is 0.514 m/s)"
        )
    return rows


def checked_seabed(value: ArrayLike | None, path: Route) -> tuple[float, float, float] | None:
    """Depth of the bottom and its slopes; a mission along the bottom needs one."""
    if value is None:
        for k, stop in enumerate(path.stops):
            if stop.vertical == "altitude":
                raise SimulationError(
                    f"seabed: leg {k + 1} ({stop.label}) of {path.name} follows the bottom, and there is"
                    " none; give its depth in m"
                )
        return None
    try:
        bottom = np.atleast_1d(np.asarray(value, float))
    except (TypeError, ValueError):
        bottom = np.empty(0)
    if bottom.shape == (1,):
        bottom = np.array([bottom[0], 0.0, 0.0])
    if bottom.shape != (3,) or not np.isfinite(bottom).all():
        raise SimulationError(
            f"seabed: expected its depth in m, or (depth, slope north, slope east), found {value!r}"
        )
    depth, north, east = (float(x) for x in bottom)
    places = [("the start", path.start, path.start[2])]
    places += [
        (f"leg {k + 1} ({stop.label})", stop.position, stop.position[2] if stop.vertical == "depth" else 0.0)
        for k, stop in enumerate(path.stops)
    ]
    for where, position, down in places:
        there = depth + north * position[0] + east * position[1]
        if there <= down:
            raise SimulationError(
                f"seabed: expected below {where} of {path.name} at a depth of {down:g} m, found {there:g} m"
            )
    return depth, north, east


def longest(path: Route, autopilot: Autopilot, max_time: float | None, *, logs: bool) -> float:
    """Duration at which a flight ends at the latest, s: well beyond the plan and the mission's own limit."""
    if max_time is None:
        planned = _TIMES_PLANNED * path.planned_time + _MARGIN_S
        limit = path.longest + _MARGIN_S if math.isfinite(path.longest) else 0.0
        max_time = max(planned, limit)
    positive("max_time", max_time, "s")
    most = (_MOST_LOGGED if logs else _MOST_FLOWN) * autopilot.period_s
    if max_time > most:
        raise SimulationError(
            f"max_time: expected at most {most:g} s, {most / autopilot.period_s:.1e} control periods of"
            f" {autopilot.period_s:g} s, found {max_time:g} s; give a shorter one, or split the mission"
        )
    return float(max_time)
