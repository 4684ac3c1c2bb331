"""What was drawn of each case, in columns that a person can read: the causes from which failures may come.

A cause has a column where the table scatters it, whatever these cases happened to draw. Coefficients count in
standard deviations; of those that move together, as tied ones do, only the first has a column.

Tests: ``tests/test_draws.py``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial._core import autopilot_names
from seatrial.fitted import Fitted
from seatrial.flight.failures import Outage, outage_rows
from seatrial.verification.cases import Cases
from seatrial.verification.failure_draws import targets
from seatrial.verification.verification_file import VerificationTable

if TYPE_CHECKING:
    from seatrial.mission import Mission

__all__ = ["cause_columns"]

Array = NDArray[np.float64]

_TIED = 1.0 - 1e-9  # correlation from which two coefficients are one


def cause_columns(
    table: VerificationTable, fitted: Fitted, missions: Sequence[Mission], *, cases: Cases
) -> dict[str, Array]:
    """What was drawn by readable names with units, (k,) each.

    Parameters
    ----------
    table : VerificationTable
    fitted : Fitted
        As the coefficients were drawn from it.
    missions : sequence of Mission
        Those of the table, in its order.
    cases : Cases
    """
    begins = np.array([[one.start["north_m"], one.start["east_m"], one.start["depth_m"]] for one in missions])
    bow = np.array([one.start["heading"] for one in missions])
    return (
        _of_water(table, cases, bow[cases.mission])
        | _of_start(table, cases, begins[cases.mission], bow[cases.mission])
        | _of_failures(table, fitted, cases)
        | _of_mission(table, cases)
        | _of_vehicle(fitted, cases)
    )


def _of_water(table: VerificationTable, cases: Cases, bow: Array) -> dict[str, Array]:
    asked, (north, east, down) = table.current, cases.current.T
    found: dict[str, Array] = {}
    steady = asked.speed_m_s is not None and asked.speed_m_s.is_fixed
    if not steady:
        found["current speed, m/s"] = np.hypot(north, east)
    if not steady or not asked.direction_deg.is_fixed:
        found["current from ahead at the start, m/s"] = -north * np.cos(bow) - east * np.sin(bow)
        found["current from port at the start, m/s"] = east * np.cos(bow) - north * np.sin(bow)
    if not asked.direction_deg.is_fixed:
        found["current towards, deg from north"] = np.degrees(np.arctan2(east, north)) % 360.0
    if asked.vertical_m_s > 0.0:
        found["current down, m/s"] = down
    if asked.turbulence_m_s is not None and not asked.turbulence_m_s.is_fixed:
        found["turbulence, m/s"] = cases.turbulence[:, 0]
    return found


def _of_start(table: VerificationTable, cases: Cases, begins: Array, bow: Array) -> dict[str, Array]:
    asked, off = table.start, cases.position - begins
    yaw = cases.attitude[:, 2]
    found: dict[str, Array] = {}
    if asked.position_m > 0.0:
        found |= {"start off to the north, m": off[:, 0], "start off to the east, m": off[:, 1]}
    if asked.depth_m > 0.0:
        found["start below the mission's, m"] = off[:, 2]
    if not asked.heading_deg.is_fixed:
        found["start heading off to starboard, deg"] = np.degrees(yaw - bow)
    if asked.speed_m_s is not None and not asked.speed_m_s.is_fixed:
        drift = cases.current[:, 0] * np.cos(yaw) + cases.current[:, 1] * np.sin(yaw)
        found["start speed through the water, m/s"] = cases.nu[:, 0] - drift
    return found


def _of_failures(table: VerificationTable, fitted: Fitted, cases: Cases) -> dict[str, Array]:
    found: dict[str, Array] = {}
    if table.faults:
        names = sorted({name for entry in table.faults for name in targets(entry, fitted.vehicle)})
        found["fault"] = np.zeros(len(cases))
        if len(names) > 1:
            found |= {f"fault of {name}": np.zeros(len(cases)) for name in names}
        for case, name, _, _ in cases.faults:
            for column in ("fault", f"fault of {name}"):
                if column in found:
                    found[column][case] = 1.0
    groups = autopilot_names()["groups"]
    for entry in table.outages:
        ((group, _, _),) = outage_rows([Outage(entry.sensor, 0.0)], math.inf)
        found[f"outage of {groups[group]}, s"] = np.zeros(len(cases))
    for case, group, start, stop in cases.outages:
        found[f"outage of {groups[group]}, s"][case] += stop - start
    return found


def _of_mission(table: VerificationTable, cases: Cases) -> dict[str, Array]:
    titles = list(enumerate(one.title for one in table.missions))
    # Of two missions either one tells the other.
    told = titles[1:] if len(titles) <= 2 else titles
    return {f"mission {title}": np.asarray(cases.mission == k, dtype=float) for k, title in told}


def _of_vehicle(fitted: Fitted, cases: Cases) -> dict[str, Array]:
    sigma, centre = fitted.sigma, fitted.nominal
    found: dict[str, Array] = {}
    kept: list[int] = []
    for k, name in enumerate(fitted.names):
        if sigma[k] == 0.0:
            continue
        if not any(abs(fitted.covariance[j, k]) >= _TIED * sigma[j] * sigma[k] for j in kept):
            kept.append(k)
            found[f"coefficient {name}, sigmas"] = (cases.coefficients[name] - centre[k]) / sigma[k]
    return found
