"""Whether an autopilot was made for the vehicle that it flies: by what its file says, else by its loops.

The file has no key for a vehicle. `seatrial autopilot` and `seatrial tune` write it into ``description``; a
built-in autopilot, or one called "NAME start", has the name of its vehicle. Where the file says another
vehicle, or none, the gains are held against the vehicle that flies. The built-in vehicles with their own
autopilots lose 29 to 88 deg in their quickest loop and ask for 0.78 to 3.2 times what their actuators give.
Held by ``tests/flight/test_mismatch.py``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial._core import Autopilot, Vehicle
from seatrial.base.finding import Finding, Severity
from seatrial.vehicle.actuators import LOOPS, ROWS, delays, thrusts

if TYPE_CHECKING:
    from seatrial.base.arrays import Array

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
