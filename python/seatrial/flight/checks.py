"""Inputs of a flight, checked before anything flies: each is refused with what was expected and found.

The core itself refuses set points and corridors whose values do not fit together. Held by
``tests/flight/test_bad_input_flights.py``, ``test_surroundings.py`` and ``test_batch_of_steps.py``.

Whether an autopilot was made for the vehicle that it flies is a finding (`mismatch`): by what its file says,
else by its loops. The file has no key for a vehicle: `seatrial autopilot` and `seatrial tune` write it into
``description``; a built-in autopilot, or one called "NAME start", has the name of its vehicle. Where the file
says another vehicle, or none, the gains are held against the vehicle that flies. The built-in vehicles with
their own autopilots lose 29 to 88 deg in their quickest loop and ask for 0.78 to 3.2 times what their
actuators give. Held by ``tests/flight/test_mismatch.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError
from seatrial.flight.mission import Route

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
import re

from seatrial._core import Autopilot, Vehicle
from seatrial.base.finding import Finding, Severity
from seatrial.vehicle.actuators import LOOPS, ROWS, delays, thrusts

if TYPE_CHECKING:
    from seatrial.base.arrays import Array


@dataclass(frozen=True)
class FlightLimits:
    """What the inputs of a flight may be."""

    #: Correlation time of a turbulent current, and the time in which eddies average out along the hull, s.
    turbulence_times_s: tuple[float, float] = (60.0, 2.0)
    largest_seed: int = 2**53  #: Whole numbers up to here are exact in JSON and in floating point.
    fastest_water_m_s: float = 15.0  #: The fastest tidal streams run at 10 m/s.
    most_substeps: int = 10_000  #: Steps of the integration in a control period.
    planned_ratio: float = 3.0  #: Longest flight over its planned time: room for currents.
    waiting_s: float = 300.0  #: Time beyond that, s: room for waiting.
    most_logged: int = 2_500_000  #: Rows of a log: a row and its table take 2.5 kB.
    most_flown: int = 100_000_000  #: Control periods of a flight.
    largest_supply_v: float = 1000.0  #: A larger supply was given in mV.
    strongest_eddies_m_s: float = 5.0  #: Standard deviation of turbulence, m/s.
    longest_eddies_s: float = 1e5  #: Correlation time of turbulence, s.


FLIGHT_LIMITS = FlightLimits()


def is_number(value: Any) -> bool:
    """Whether it is a number, finite or not, and no truth value."""
    return isinstance(value, int | float | np.number) and not isinstance(value, bool | np.complexfloating)


def _floats(value: Any) -> Array:
    """Its numbers; a lone NaN where it holds anything else."""
    try:
        return np.asarray(value, float)
    except (TypeError, ValueError):
        return np.array(np.nan)


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
    """A seed that is one, else a SimulationError."""
    whole = isinstance(seed, int | np.integer) and not isinstance(seed, bool)
    if not whole or not 0 <= seed < FLIGHT_LIMITS.largest_seed:
        raise SimulationError(f"seed: expected a whole number from 0 to 2^53 - 1, found {seed!r}")
    return int(seed)


def checked_step(max_step_s: Any, autopilot: Autopilot) -> None:
    """Refuse a step of the integration that is none, or so small that no flight would end."""
    positive("max_step_s", max_step_s, "s")
    most = FLIGHT_LIMITS.most_substeps
    if autopilot.period_s / max_step_s > most:
        raise SimulationError(
            f"max_step_s: expected at least {autopilot.period_s / most:.2g} s, a {most}th of the control"
            f" period of {autopilot.period_s:g} s, found {max_step_s:g}; 0.02 s is the usual one"
        )


def checked_supply(voltage_v: Any, vehicle: Vehicle) -> None:
    """Refuse a supply that is none, and its absence where thrust depends on it."""
    needed = [name for name, facts in vehicle.actuator_info().items() if facts["needs_voltage"]]
    if voltage_v is None:
        if needed:
            raise SimulationError(
                f"voltage_v: the thrust of {vehicle.name} ({needed[0]}) depends on the supply voltage; give"
                " it in V, --voltage on the command line"
            )
        return
    positive("voltage_v", voltage_v, "V")
    if voltage_v > (most := FLIGHT_LIMITS.largest_supply_v):
        raise SimulationError(f"voltage_v: expected at most {most:g} V, found {voltage_v:g}; is it in V?")


def checked_list(name: str, values: Any, kind: type, example: str) -> tuple[Any, ...]:
    """Values as a tuple; one of them alone, a text or nothing at all is answered with an example."""
    if isinstance(values, kind | str | bytes | Mapping) or not isinstance(values, Iterable):
        raise SimulationError(f"{name}: expected a list such as [{example}], found {values!r}")
    return tuple(values)


def checked_vector(name: str, value: Any) -> tuple[float, float, float]:
    """North, east, down of a velocity of water, m/s."""
    checked_rows(name, value)
    return checked_triple(name, value, "north, east, down in m/s")


def checked_rows(name: str, value: Any) -> Array:
    """Velocities of water, (3,) or (k, 3), m/s."""
    rows = _floats(value)
    if rows.ndim not in (1, 2) or rows.shape[-1] != 3 or not np.isfinite(rows).all():
        raise SimulationError(
            f"{name}: expected three finite numbers, north, east, down in m/s, found {value!r}"
        )
    if rows.size and (most := float(np.abs(rows).max())) > FLIGHT_LIMITS.fastest_water_m_s:
        raise SimulationError(
            f"{name}: expected at most {FLIGHT_LIMITS.fastest_water_m_s:g} m/s, faster than any ocean"
            f" current, found {most:g}; give it in m/s (1 kn is 0.514 m/s)"
        )
    return rows


def checked_triple(name: str, value: Any, parts: str) -> tuple[float, float, float]:
    """Three finite numbers; `parts` says of what, in which unit."""
    row = _floats(value)
    if row.shape != (3,) or not np.isfinite(row).all():
        raise SimulationError(f"{name}: expected three finite numbers, {parts}, found {value!r}")
    return float(row[0]), float(row[1]), float(row[2])


def checked_bottom(value: Any) -> tuple[float, float, float]:
    """Depth of the bottom in m and its slopes north and east, from a depth alone or all three."""
    bottom = np.atleast_1d(_floats(value))
    if bottom.shape == (1,):
        bottom = np.array([bottom[0], 0.0, 0.0])
    if bottom.shape != (3,) or not np.isfinite(bottom).all():
        raise SimulationError(
            f"seabed: expected its depth in m, or (depth, slope north, slope east), found {value!r}"
        )
    return float(bottom[0]), float(bottom[1]), float(bottom[2])


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
    depth, north, east = checked_bottom(value)
    places = [("the start", path.start, path.start[2])]
    places += [
        (f"leg {k + 1} ({stop.label})", stop.position, stop.position[2] if stop.vertical == "depth" else 0.0)
        for k, stop in enumerate(path.stops)
    ]
    for where, position, down in places:
        there = depth + north * position[0] + east * position[1]
        if there <= down:
            raise SimulationError(
                f"seabed: expected {where} of {path.name} above the bottom, which is at {there:g} m there,"
                f" found it at a depth of {down:g} m"
            )
    return depth, north, east


def longest(path: Route, autopilot: Autopilot, max_time_s: float | None, *, logs: bool) -> float:
    """Duration at which a flight ends at the latest, s: well beyond the plan and the mission's own limit."""
    if max_time_s is None:
        planned = FLIGHT_LIMITS.planned_ratio * path.planned_time + FLIGHT_LIMITS.waiting_s
        limit = path.longest + FLIGHT_LIMITS.waiting_s if math.isfinite(path.longest) else 0.0
        max_time_s = max(planned, limit)
    positive("max_time_s", max_time_s, "s")
    most = (FLIGHT_LIMITS.most_logged if logs else FLIGHT_LIMITS.most_flown) * autopilot.period_s
    if max_time_s > most:
        raise SimulationError(
            f"max_time_s: expected at most {most:g} s, {most / autopilot.period_s:.1e} control periods of"
            f" {autopilot.period_s:g} s, found {max_time_s:g} s; give a shorter one, or split the mission"
        )
    return float(max_time_s)


def checked_turbulence(given: Any, what: str = "turbulence") -> tuple[float, float, float]:
    """Standard deviations north, east, down, m/s; one number is that of both horizontal components. `what`
    they are of is what messages call them.
    """
    if is_number(given):
        given = (given, given, 0.0)
    values = [float(x) for x in _floats(given).ravel()]
    if len(values) != 3 or not all(0.0 <= x <= FLIGHT_LIMITS.strongest_eddies_m_s for x in values):
        raise SimulationError(
            f"{what}: expected a standard deviation from 0 to {FLIGHT_LIMITS.strongest_eddies_m_s:g} m/s, or"
            f" three of them, north, east and down, found {given!r}"
        )
    return values[0], values[1], values[2]


def checked_times(given: Any) -> tuple[float, float]:
    """Two time constants of a turbulent current, s."""
    values = list(given) if isinstance(given, tuple | list) else []
    if len(values) != 2 or not all(
        is_number(x) and 0.01 <= x <= FLIGHT_LIMITS.longest_eddies_s for x in values
    ):
        raise SimulationError(
            f"turbulence_times_s: expected two times from 0.01 to {FLIGHT_LIMITS.longest_eddies_s:g} s, for"
            f" example (60.0, 2.0), found {given!r}"
        )
    return float(values[0]), float(values[1])


def checked_obstacles(given: Any) -> tuple[tuple[float, float, float], ...]:
    """Cylinders: north, east and radius of each, m."""
    cylinders = []
    for place, obstacle in enumerate(given):
        row = list(obstacle) if isinstance(obstacle, tuple | list | np.ndarray) else []
        sound = len(row) == 3 and all(is_number(x) and math.isfinite(x) for x in row)
        if not sound or row[2] < 0.0:
            raise SimulationError(
                f"obstacles[{place}]: expected north, east and a radius from 0 on in m, found {obstacle!r}"
            )
        cylinders.append((float(row[0]), float(row[1]), float(row[2])))
    return tuple(cylinders)


Corridor = tuple[str, ArrayLike, ArrayLike, ArrayLike, ArrayLike, ArrayLike, ArrayLike]
"""Channel, base (k,), scale (k,), and per control period lower, upper, target and clock (p,)."""

_PARTS = ("base", "scale", "lower", "upper", "target", "clock")

_EXAMPLE = '("yaw", base, scale, lower, upper, target, clock)'


def checked_set_points(
    given: Any, what: str = "set_points"
) -> tuple[dict[str, Array] | None, dict[str, int]]:
    """Set points by name, and the number of cases of those that differ from case to case."""
    if given is None:
        return None, {}
    if not isinstance(given, Mapping):
        raise SimulationError(
            f"{what}: expected {{name: values}}, for example {{'times': [0.0], 'speed': [1.0]}}, found"
            f" {given!r}"
        )
    arrays = {str(name): _array(f"{what}: {name}", values) for name, values in given.items()}
    # At a single time a row of values is one for each case.
    single = arrays.get("times", np.empty(0)).size == 1
    return arrays, {
        f"{what}: {name}": len(values)
        for name, values in arrays.items()
        if name != "times" and (values.ndim > 1 or (values.ndim == 1 and single and values.size > 1))
    }


def checked_corridors(given: Any) -> tuple[list[Corridor], dict[str, int]]:
    """Corridors, and the number of cases of bases and scales that differ from case to case."""
    corridors: list[Corridor] = []
    cases = {}
    for place, row in enumerate(checked_list("corridors", given, str, _EXAMPLE)):
        what = f"corridors[{place}]"
        if not (isinstance(row, tuple | list) and len(row) == 1 + len(_PARTS) and isinstance(row[0], str)):
            raise SimulationError(f"{what}: expected (channel, {', '.join(_PARTS)}), found {row!r}")
        arrays = [_array(f"{what}: {part}", values) for part, values in zip(_PARTS, row[1:], strict=True)]
        for part, values in zip(_PARTS[:2], arrays, strict=False):
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


_FAILURES = {
    "Fault": ('st.Fault("NAME", at_s=60)', "st.Fault(actuator, at_s=...)"),
    "Outage": ('st.Outage("position", from_s=100)', "st.Outage(group, from_s, until_s)"),
}


def checked_failures(what: str, given: Any, kind: type, *, per_case: bool = True) -> tuple[Any, ...]:
    """Failures for all cases, or a list of them per case."""
    example, call = _FAILURES[kind.__name__]
    failures = checked_list(what, given, kind, example)
    shared = [isinstance(failure, kind) for failure in failures]
    if per_case and any(shared) and not all(shared):
        raise SimulationError(
            f"{what}: expected either {what} for all cases or a list of them per case, found both"
        )
    nested = per_case and not any(shared)
    for some in [checked_list(what, case, kind, example) for case in failures] if nested else [failures]:
        for failure in some:
            if not isinstance(failure, kind):
                raise SimulationError(f"{what}: expected {call}, found {failure!r}; give a list of them")
    return failures


def checked_columns(what: str, given: Any) -> dict[str, Array]:
    """Finite values by name, (k,) each; none for None."""
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise SimulationError(f"{what}: expected {{name: values}}, found {given!r}")
    columns = {}
    for name, values in given.items():
        column = _floats(values)
        if column.ndim != 1 or not np.isfinite(column).all():
            raise SimulationError(
                f"{what}: {name}: expected finite numbers (k,), one per case, found {values!r}"
            )
        columns[name] = column
    return columns


_SAID = re.compile(
    r"^(?:Start values for (?P<started>.+), from its model"
    r"|Gains of .+ tuned for (?P<tuned>.+), by constraint criteria on .+)$"
)


@dataclass(frozen=True)
class MismatchSettings:
    """How far an autopilot and a vehicle may be apart."""

    delay_periods: float = 1.5  #: Delay of sampling and hold in control periods.
    #: Limit of a loop over what the actuators give together, below which it is too weak.
    weak_share: float = 0.2
    alike: float = 0.3  #: Relative difference of apparent masses up to which two vehicles are one.
    unlimited: float = 1e6  #: Limit of a loop, N or N m, from which it is none.
    #: Phase, rad, that the delay costs at the crossover: twice the 90 deg of an integrator.
    no_phase: float = math.pi


MISMATCH = MismatchSettings()


def started_for(vehicle: str) -> str:
    """Description of an autopilot with start values for a vehicle of a name."""
    return f"Start values for {vehicle}, from its model"


def tuned_for(start: str, vehicle: str, origin: str) -> str:
    """Description of an autopilot whose gains were tuned for a vehicle, from an autopilot `start` on."""
    return f"Gains of {start} tuned for {vehicle}, by constraint criteria on {origin}"


def made_for(autopilot: Autopilot) -> str:
    """Name of the vehicle that an autopilot was made for, by its file; empty where the file does not say."""
    if origin := _SAID.match(autopilot.description):
        return origin["started"] or origin["tuned"]
    name = autopilot.name.removesuffix(" start")
    return name if name in Vehicle.names() else ""


def mismatch(autopilot: Autopilot, vehicle: Vehicle) -> Finding | None:
    """That an autopilot does not belong to a vehicle, because of its loops where they show it; else None."""
    of = made_for(autopilot)
    if of == vehicle.name or (of in Vehicle.names() and _alike(Vehicle.load(of), vehicle)):
        return None
    doubt = _too_strong(autopilot, vehicle) or _too_weak(autopilot, vehicle)
    if not of and doubt is None:
        return None
    values = {"autopilot": autopilot.name, "made_for": of}
    return Finding("another vehicle", Severity.PROBLEM, vehicle.name, values, doubt)


def _alike(vehicle: Vehicle, other: Vehicle) -> bool:
    """Whether two vehicles have the same actuators and about the same apparent masses."""
    masses = [np.diag(np.asarray(each.mass_matrix())) for each in (vehicle, other)]
    return vehicle.actuators == other.actuators and bool(
        np.all(np.abs(masses[0] - masses[1]) <= MISMATCH.alike * np.minimum(*masses))
    )


def _too_strong(autopilot: Autopilot, vehicle: Vehicle) -> Finding | None:
    """The loop whose gains may leave it no phase margin at its crossover; None where none does.

    The crossover is about ``K_P/M`` of speeds and the larger of ``K_D/M`` and ``sqrt(K_P/M)`` of depth and
    angles; lag and dead time of actuators and control period cost phase there (Åström and Murray, 2021,
    section 10.3). It is a guess from gains and mass: `seatrial check AUTOPILOT --vehicle VEHICLE` computes
    the margin.
    """
    tables, late = autopilot.loops(), delays(vehicle, ROWS)
    mass = np.diag(np.asarray(vehicle.mass_matrix()))
    lost = {}
    for loop, row, own in zip(LOOPS, ROWS, mass.tolist(), strict=True):
        table = tables.get(loop)
        if table is None or "K_P" not in table:
            continue
        k_p, k_d = _largest(table, "K_P"), _largest(table, "K_D_s")
        crossover = k_p / own if loop in ("surge", "sway") else max(k_d / own, math.sqrt(max(k_p, 0.0) / own))
        lag = late[row].lag_s + late[row].dead_s
        lost[loop] = crossover * (MISMATCH.delay_periods * autopilot.period_s + lag)
    if not lost or max(lost.values()) < MISMATCH.no_phase:
        return None
    loop = max(lost, key=lambda name: lost[name])
    return Finding("vehicle too slow", Severity.WEAKNESS, loop, {"phase_deg": math.degrees(lost[loop])})


def _too_weak(autopilot: Autopilot, vehicle: Vehicle) -> Finding | None:
    """How little all loops ask for of what the actuators give; None where one asks for enough."""
    speed = 0.5 * max(abs(breakpoint) for breakpoint in autopilot.speeds_m_s)
    strength = np.abs(thrusts(vehicle, speed)).max(axis=1)
    gives: Array = np.abs(np.asarray(vehicle.allocation_matrix())) @ strength
    shares = {
        loop: float(table["tau_max"]) / gives[LOOPS.index(loop)]
        for loop, table in autopilot.loops().items()
        if "tau_max" in table and 0.0 < gives[LOOPS.index(loop)] < MISMATCH.unlimited
    }
    if not shares or max(shares.values()) >= MISMATCH.weak_share:
        return None
    loop = max(shares, key=lambda name: shares[name])
    return Finding("loops too weak", Severity.WEAKNESS, loop, {"share": shares[loop]})


def _largest(table: Mapping[str, Any], key: str) -> float:
    return float(np.max(np.asarray(table.get(key, 0.0), dtype=float)))
