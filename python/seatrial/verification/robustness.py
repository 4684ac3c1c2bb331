"""Robustness of a requirement: by how much a mission held it, so that near misses are told from safe ones.

A requirement is a formula of signal temporal logic over one flight. Its metrics are what the operators leave
of a signal: ``cross_track_largest_m <= 2`` is "always |e| <= 2 m", whose robustness is the smallest of
2 - |e| over the flight, as ``clearance_m`` is the smallest distance; ``and`` is the smaller, ``or`` the
larger, ``not`` the negative robustness (Fainekos & Pappas 2009; Donze & Maler 2010). That is the reserve of
`seatrial.verification.requirement`; where it stands in words it is graded here:

- ``ending == "complete"`` ("eventually the last waypoint") has the time that was left over the time allowed,
  and where the mission did not get there minus the share of waypoints that it did not reach;
- every other word and truth has none: held or not, infinitely far.

A requirement is usable where at least nine of ten held missions have a finite robustness.

Theory: ``docs/theory/robustness.md``. Tests: ``tests/verification/test_rare.py``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.finding import Finding, Severity
from seatrial.verification.requirement import COMPLETION

if TYPE_CHECKING:
    from seatrial.verification.flown_missions import FlownMissions
    from seatrial.verification.missions import CampaignFlights
    from seatrial.verification.requirement import Requirement


def robustness(requirement: Requirement, flown: FlownMissions, flights: CampaignFlights) -> Array:
    """Robustness (k,) of flown missions, in the unit of the requirement's reserve; negative where it failed.

    Minus infinity where a flight diverged or what has no grade failed, infinity where such held.
    """
    judged = requirement.judge({**flown.metrics, COMPLETION: completion(flown, flights)})
    graded = np.where(judged.held, np.maximum(judged.reserve, 0.0), np.minimum(judged.reserve, 0.0))
    return np.asarray(graded)


def completion(flown: FlownMissions, flights: CampaignFlights) -> Array:
    """Graded ``ending == "complete"`` (k,): share of the time that was left, or minus that of waypoints."""
    allowed = np.array(flights.longest_s)[flown.mission]
    count = np.array([len(one.waypoints["speed_m_s"]) for one in flights.missions])[flown.mission]
    complete = flown.metrics["ending"] == "complete"
    with np.errstate(invalid="ignore"):
        left = (allowed - flown.metrics["duration_s"]) / allowed
        missed = (count - flown.metrics["waypoints_behind"]) / count
    behind = np.clip(np.nan_to_num(missed, nan=1.0), 1e-9, 1.0)
    return np.asarray(np.where(complete, np.maximum(left, 1e-9), -behind))


def unusable(requirement: Requirement, values: Array) -> Finding | None:
    """Why a requirement's robustness (k,) ranks no missions; None where it does."""
    held = values > 0.0
    # Fewer finite distances among the missions that held rank nothing.
    if not held.any() or np.isfinite(values[held]).mean() >= 0.9:
        return None
    return Finding("no distance", Severity.PROBLEM, requirement.name, {"holds": requirement.holds})
