"""A requirement after the missions: failures, interval, verdict, worst missions, causes, and notes on it.

The notes name what a verdict does not show. A metric that is infinite in all missions (altitude without a
bottom, clearance without obstacles) holds any limit, and one that no mission has fails it. Energy that the
vehicle file does not tell would be 0 Wh; a requirement on it is refused beforehand. Cross-track errors
without ``true_`` are those that guidance perceived: where dead reckoning drifts, they stay small while the
vehicle leaves its path. Missions may also be beyond any autopilot: cut short, or faster than the top speed of
the identified vehicle straight ahead (`seatrial.control_design.operating_points`) at the table's supply.

The robustness of a requirement says by how much a mission held it, so that near misses are told from safe
ones. A requirement is a formula of signal temporal logic over one flight. Its metrics are what the operators
leave of a signal: ``cross_track_largest_m <= 2`` is "always |e| <= 2 m", whose robustness is the smallest of
2 - |e| over the flight, as ``clearance_m`` is the smallest distance; ``and`` is the smaller, ``or`` the
larger, ``not`` the negative robustness (Fainekos & Pappas 2009; Donze & Maler 2010). That is the reserve of
`seatrial.verification.requirement`; where it stands in words it is graded here:

- ``ending == "complete"`` ("eventually the last waypoint") has the time that was left over the time allowed,
  and where the mission did not get there minus the share of waypoints that it did not reach;
- every other word and truth has none: held or not, infinitely far.

A requirement is usable where at least nine of ten held missions have a finite robustness. Theory:
``docs/theory/robustness.md``.

Tests: ``test_verify.py``, ``test_verification_messages.py``, ``test_perceived_and_true.py``,
``test_rare.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError, VehicleError
from seatrial.base.finding import Finding, Severity
from seatrial.base.plain import Plain
from seatrial.base.report import clause_of
from seatrial.statistics import failure_probability
from seatrial.statistics.failure_probability import FailureProbability
from seatrial.vehicle.actuators import NOMINAL_V
from seatrial.verification.causes import Cause, Influence, find_causes_of_all
from seatrial.verification.expression import KNOWN, PERCEIVED
from seatrial.verification.flown_missions import FlownMissions
from seatrial.verification.requirement import COMPLETION, Judgement, Requirement

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.verification.draws import Draws
    from seatrial.verification.missions import CampaignFlights


@dataclass(frozen=True)
class WorstMission(Plain):
    """A mission that held a requirement least: how to find it again, and what it met.

    `number`: with which it is flown again. `mission`, `seed`: its name, and the seed of its noise. `held`,
    `reserve`: whether the requirement was held, and by how much. `metrics`, `drawn`: all its metrics, and
    everything that was drawn, by name.
    """

    number: int
    mission: str
    seed: int
    held: bool
    reserve: float
    metrics: dict[str, Any]
    drawn: dict[str, float]


@dataclass(frozen=True, eq=False)
class JudgedRequirement(
    Plain,
    only="name=requirement.name holds=requirement.holds probability=requirement.probability verdict sentence"
    " failures=found.failures runs=found.runs failure_probability=found.estimate interval=found.interval"
    " at_least=found.at_least at_most=found.at_most confidence=found.confidence further_runs smallest_reserve"
    " unit=judgement.unit by_mission causes worst=worst_numbers",
):
    """What the missions say of a requirement.

    `requirement`, `judgement`: what was asked, and which mission held it with which reserve. `found`:
    failures, runs, interval. `by_mission`: the same of each mission, by name. `causes`: influences of what
    was drawn, those that are shown to matter first; with regard to all requirements of the verification.
    `worst`: missions with the least reserve, the worst first.
    """

    requirement: Requirement
    judgement: Judgement
    found: FailureProbability
    by_mission: dict[str, FailureProbability]
    causes: tuple[Influence, ...]
    worst: tuple[WorstMission, ...]

    @property
    def verdict(self) -> failure_probability.Verdict:
        """Held, failed or undecided."""
        return self.found.verdict(self.requirement.allowed)

    @property
    def sentence(self) -> str:
        """The verdict in words, with what it rests on."""
        return clause_of(self, "verification")

    @property
    def further_runs(self) -> int | None:
        """Missions that will probably decide it, 0 where it is decided, None where a billion do not."""
        return failure_probability.further_runs(self.found, self.requirement.allowed)

    @property
    def named_causes(self) -> tuple[Influence, ...]:
        """Causes that are shown to matter."""
        return tuple(one for one in self.causes if one.named)

    @property
    def smallest_reserve(self) -> float:
        """By how much the worst mission held it, in the unit of its reserve."""
        return float(np.min(self.judgement.reserve))

    @property
    def worst_numbers(self) -> list[int]:
        """With which the worst missions are flown again."""
        return [one.number for one in self.worst]


def judged(
    requirements: Sequence[Requirement],
    flown: FlownMissions,
    *,
    missions: Sequence[str],
    confidence: float,
    keep_worst: int,
) -> tuple[JudgedRequirement, ...]:
    """What at least one flown mission says of requirements, whose causes are found as one family.

    `missions` are names; `keep_worst`: how many of the worst missions to tell of.
    """
    judgements = [one.judge(flown.metrics) for one in requirements]
    causes = find_causes_of_all(
        [(one.held, one.reserve) for one in judgements],
        causes=(Cause.of_column(name, values) for name, values in flown.causes.items()),
    )
    return tuple(
        JudgedRequirement(
            requirement=requirement,
            judgement=judgement,
            found=FailureProbability(judgement.failures, len(flown), confidence),
            by_mission=_by_mission(judgement, flown, missions, confidence),
            causes=found,
            worst=_worst(judgement, flown, missions, keep_worst),
        )
        for requirement, judgement, found in zip(requirements, judgements, causes, strict=True)
    )


def _by_mission(
    judgement: Judgement, flown: FlownMissions, missions: Sequence[str], confidence: float
) -> dict[str, FailureProbability]:
    apart: dict[str, FailureProbability] = {}
    for index, name in enumerate(missions):
        rows = flown.mission == index
        if rows.any():
            failures = int(np.count_nonzero(~judgement.held[rows]))
            apart[name] = FailureProbability(failures, int(rows.sum()), confidence)
    return apart


def _worst(
    judgement: Judgement, flown: FlownMissions, missions: Sequence[str], count: int
) -> tuple[WorstMission, ...]:
    places = [
        int(row)
        for row in judgement.worst(count)
        if not judgement.held[row] or np.isfinite(judgement.reserve[row])  # held by words: none is worst
    ]
    return tuple(
        WorstMission(
            number=int(flown.numbers[row]),
            mission=missions[int(flown.mission[row])],
            seed=int(flown.seeds[row]),
            held=bool(judgement.held[row]),
            reserve=float(judgement.reserve[row]),
            metrics=metrics,
            drawn=drawn,
        )
        for row, (metrics, drawn) in zip(places, flown.rows(places), strict=True)
    )


def check_energy(requirement: Requirement, vehicle: Vehicle) -> None:
    """Refuse a requirement on the energy of a vehicle that tells no power.

    Raises CampaignError where it is one.
    """
    if "energy_wh" not in requirement.metrics:
        return
    told = [facts["power_w_s3"] or 0.0 for facts in vehicle.actuator_info().values()]
    if max([*told, vehicle.power().get("hotel_w", 0.0)]) <= 0.0:
        raise CampaignError(
            f"energy_wh is not known, {vehicle.name} tells neither power_w_s3 nor [power]; add them to the"
            " vehicle file, or ask for something else"
        )


def metrics_without_value(requirements: Sequence[Requirement], flown: FlownMissions) -> list[Finding]:
    """Requirements that every mission had to hold, or none could."""
    remarks = []
    for requirement in requirements:
        none_held = not requirement.judge(flown.metrics).held.any()
        for name in requirement.metrics:
            if KNOWN[name].kind != "number":
                continue
            values = np.asarray(flown.metrics[name], dtype=float)
            known = values[~np.isnan(values)]
            if not len(known) and none_held:
                remarks.append(Finding("metric unknown", Severity.NOTE, requirement.name, {"metric": name}))
            if name in _NEEDING_SURROUNDINGS and len(known) and np.isposinf(known).all():
                remarks.append(Finding("metric infinite", Severity.NOTE, requirement.name, {"metric": name}))
    return remarks


_NEEDING_SURROUNDINGS = ("altitude_smallest_m", "clearance_m", "clearance_reserve_m")
"""Metrics that are infinite without a bottom, or without obstacles."""


def perceived_and_true(requirements: Sequence[Requirement], flown: FlownMissions) -> list[Finding]:
    """Which errors are perceived and which are true; none where they are the same."""
    perceived, true = (
        np.asarray(flown.metrics[name], float) for name in ("cross_track_p95_m", "true_cross_track_p95_m")
    )
    known = np.isfinite(perceived) & np.isfinite(true)
    # Perceived and true errors that differ by less than 1 mm are of a flight without sensors.
    if not known.any() or np.allclose(perceived[known], true[known], rtol=0.0, atol=1e-3):
        return []
    values = {
        "requirements": [asked.name for asked in requirements if set(asked.metrics) & set(PERCEIVED)],
        "perceived_m": float(np.median(perceived[known])),
        "true_m": float(np.median(true[known])),
    }
    return [Finding("errors perceived", Severity.NOTE, values=values)]


_MANY = 0.5
"""Share of the missions without an end from which their time is spoken of."""


def beyond_the_vehicle(flights: CampaignFlights, draws: Draws, flown: FlownMissions) -> tuple[Finding, ...]:
    """Missions that time, speed or current keep from being flown, whatever the autopilot does.

    `draws` are of the first of the missions, `flown` is what came of them all.
    """
    return (*_time(flights, flown), *_speed(flights, draws))


def _time(flights: CampaignFlights, flown: FlownMissions) -> list[Finding]:
    late = flown.metrics["ending"] == "out of time"
    count = int(np.count_nonzero(late))
    if count < _MANY * len(flown):
        return []
    planned = max(flights.missions[k].planned_time for k in np.unique(flown.mission[late]).tolist())
    values = {"count": count, "of": len(flown), "max_time_s": flights.table.max_time_s, "planned_s": planned}
    return [Finding("out of time", Severity.NOTE, values=values)]


def _speed(flights: CampaignFlights, draws: Draws) -> list[Finding]:
    from seatrial.control_design.operating_points import top_speeds

    vehicle = flights.fitted.vehicle
    try:
        top = top_speeds(vehicle, voltage_v=flights.table.voltage_v or NOMINAL_V)[1]
    except VehicleError as error:
        return [Finding("told", Severity.NOTE, values={"sentence": f"{error}."})]
    if top <= 0.0:
        return []
    remarks = []
    for title, mission in zip(flights.titles, flights.missions, strict=True):
        asked = float(np.max(mission.waypoints["speed_m_s"]))
        if asked > top:
            values = {"vehicle": vehicle.name, "asked_m_s": asked, "top_m_s": top}
            remarks.append(Finding("mission too fast", Severity.NOTE, title, values))
    fast = int(np.count_nonzero(np.hypot(draws.current[:, 0], draws.current[:, 1]) > top))
    if fast:
        values = {"vehicle": vehicle.name, "count": fast, "of": len(draws), "top_m_s": top}
        remarks.append(Finding("current too fast", Severity.NOTE, values=values))
    return remarks


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
