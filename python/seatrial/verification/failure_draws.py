"""Draws of failures: which actuators fail in a case and when, and which sensors are silent from when to when.

Held by ``tests/verification/test_draws.py``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError, nearest
from seatrial.flight.failures import Fault, Outage, fault_rows, outage_rows
from seatrial.vehicle.actuators import actuator_groups
from seatrial.verification.table import FaultTable, OutageTable

if TYPE_CHECKING:
    from seatrial._core import Vehicle

FaultRow = tuple[int, str, float, float]

OutageRow = tuple[int, int, float, float]

FAULT_WIDTH = OUTAGE_WIDTH = 4
"""Random numbers of an entry and case: whether, which or how long, when, and one to spare."""


def targets(entry: FaultTable, vehicle: Vehicle) -> dict[str, float]:
    """Actuators that an entry means, each with the command that it keeps (nan: where it is).

    Raises SimulationError where there is no such actuator or group, or the command is beyond an actuator's
    range.

    Examples
    --------
    >>> import seatrial as st
    >>> targets(FaultTable(actuator="stern", probability=0.1), st.Vehicle.load("cwolf"))
    {'PL': 0.0, 'PU': 0.0, 'SbL': 0.0, 'SbU': 0.0}
    """
    groups, actuators = actuator_groups(vehicle), list(vehicle.actuators)
    if entry.actuator == "any":
        meant = actuators
    elif entry.actuator in actuators:
        meant = [entry.actuator]
    elif entry.actuator in groups:
        meant = groups[entry.actuator]
    else:
        raise SimulationError(
            f"faults: the vehicle {vehicle.name} has no actuator or group"
            f' "{entry.actuator}"{nearest(entry.actuator, ["any", *groups, *actuators])}'
        )
    if not meant:
        raise SimulationError(f"faults: the vehicle {vehicle.name} has no actuator that could fail")
    stuck = entry.kind == "stuck" and entry.command is None
    faults = [Fault(name, 0.0, stuck, entry.command) for name in sorted(meant)]
    try:
        rows = fault_rows(faults, vehicle, math.inf)
    except SimulationError as error:
        # An entry's key for what a flight calls stuck_at.
        raise SimulationError(str(error).replace("stuck_at", "command")) from None
    return {name: command for _, name, _, command in rows}


def fault_draws(
    entries: tuple[FaultTable, ...], vehicle: Vehicle, u: Array, longest: Array
) -> list[FaultRow]:
    """Rows (case, actuator, time in s, command or nan); an actuator that fails twice fails the first time.

    `u` (k, entries * FAULT_WIDTH) are uniform numbers; `longest` (k,), s: until when a fault begins where the
    entry does not say.
    """
    first: dict[tuple[int, str], tuple[float, float]] = {}
    for number, entry in enumerate(entries):
        commands = targets(entry, vehicle)
        names = list(commands)
        happens, which, when, _ = u[:, number * FAULT_WIDTH : (number + 1) * FAULT_WIDTH].T
        for case in np.flatnonzero(happens < entry.probability).tolist():
            name = names[int(which[case] * len(names))]
            at = _between(entry.between_s, float(longest[case]), float(when[case]))
            if (case, name) not in first or at < first[case, name][0]:
                first[case, name] = (at, commands[name])
    return sorted((case, name, at, command) for (case, name), (at, command) in first.items())


def outage_draws(entries: tuple[OutageTable, ...], u: Array, longest: Array) -> list[OutageRow]:
    """Rows (case, group, from, until in s).

    `u` (k, entries * OUTAGE_WIDTH) are uniform numbers; `longest` (k,), s: until when an outage begins where
    the entry does not say. Raises SimulationError where there is no such group or kind of sensor.
    """
    found: list[OutageRow] = []
    for number, entry in enumerate(entries):
        ((group, _, _),) = outage_rows([Outage(entry.sensor, 0.0)], math.inf)
        happens, long, when, _ = u[:, number * OUTAGE_WIDTH : (number + 1) * OUTAGE_WIDTH].T
        duration = entry.duration_s.quantiles(long, above_zero=True)
        for case in np.flatnonzero((happens < entry.probability) & (duration > 0.0)):
            at = _between(entry.between_s, float(longest[case]), float(when[case]))
            found.append((int(case), group, at, at + float(duration[case])))
    return sorted(found)


def _between(between: tuple[float, float] | None, longest: float, share: float) -> float:
    start, stop = (0.0, longest) if between is None else between
    return start + share * (stop - start)
