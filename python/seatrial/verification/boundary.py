"""`Boundary`: up to which payload, current or latency a requirement still holds.

One or two variables get values from given ranges, everything else is drawn as ``[verification]`` says. Few
missions are flown at a place, more where the failure probability crosses what the requirement allows
(`seatrial.statistics.failure_boundary`). All requirements are judged on all missions; each chooses places in
its turn. The autopilot does not know of the value: it believes in the identified vehicle.

Tests: ``tests/verification/test_boundary.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError
from seatrial.base.fleet import fleet_of, threads_of
from seatrial.base.run import RunDirectory, RunResult, to_json
from seatrial.base.work import HERE, Clock, Work
from seatrial.statistics.failure_boundary import BoundarySurface
from seatrial.verification.boundary_survey import BoundarySurvey, coefficients_at, flights_at, variables_of
from seatrial.verification.requirement import named
from seatrial.verification.scenario import check_table

if TYPE_CHECKING:
    from seatrial.verification.requirement import Requirement
    from seatrial.verification.scenario import Scenario

Side = Literal["boundary", "safe", "fails", "probably safe", "probably fails"]


@dataclass(frozen=True, eq=False)
class RequirementBoundary:
    """Where a requirement fails more often than it allows.

    Attributes
    ----------
    requirement
    surface
        Failure probability over the ranges; None before anything was flown.
    failures
        Missions that failed, of all that were flown.
    """

    requirement: Requirement
    surface: BoundarySurface
    failures: int

    @property
    def side(self) -> Side:
        """Whether there is a boundary, or which side everything is on."""
        sides = self.surface.sides
        if (sides == 1).all():
            return "safe"
        if (sides == -1).all():
            return "fails"
        mean = self.surface.mean - self.surface.level
        if (mean < 0.0).all() or (mean > 0.0).all():
            return "probably safe" if (mean < 0.0).all() else "probably fails"
        return "boundary"


@dataclass(frozen=True, eq=False, repr=False)
class FailureBoundary(RunResult):
    """Failure boundaries in one or two variables; made by `seatrial.verify` with the strategy `Boundary`.

    Attributes
    ----------
    scenario
        What was flown.
    variables
        Name and range (from, to) of each.
    requirements
        A `RequirementBoundary` each.
    places
        Values (n, d) at which missions were flown, and how many at each.
    runs_per_place
        Missions at a place.
    interrupted
        Whether Ctrl-C ended it early.
    facts
        What the result rests on.
    """

    scenario: Scenario
    variables: Mapping[str, tuple[float, float]]
    requirements: tuple[RequirementBoundary, ...]
    places: Array
    runs_per_place: int
    interrupted: bool
    facts: Mapping[str, Any] = field(default_factory=dict)

    def requirement(self, name: str) -> RequirementBoundary:
        """The boundary of the requirement with a name.

        Parameters
        ----------
        name : str

        Raises
        ------
        CampaignError
            There is none.
        """
        return named([name], {one.requirement.name: one for one in self.requirements})[0]

    def value(self, axis: int, x: float) -> float:
        """Value of a variable at a share of its range.

        Parameters
        ----------
        axis : int
            0 for the first variable, 1 for the second.
        x : float
            From 0 to 1.
        """
        low, high = list(self.variables.values())[axis]
        return low + (high - low) * x

    def crossings(self, name: str, second: float | None = None) -> list[tuple[float, float, float, bool]]:
        """Boundaries of a requirement along the first variable: value, from, to, and whether below is safe.

        Parameters
        ----------
        name : str
            Of the requirement.
        second : float, optional
            Value of the second variable, where there are two.
        """
        at = None
        if second is not None:
            low, high = list(self.variables.values())[1]
            at = (second - low) / (high - low)
        return [
            (
                self.value(0, one.at),
                self.value(0, one.interval[0]),
                self.value(0, one.interval[1]),
                one.rising,
            )
            for one in self.requirement(name).surface.crossings(at)
        ]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        seconds: list[float | None] = [None] if len(self.variables) == 1 else list(self.seconds())
        return {
            "campaign": self.scenario.name,
            "variables": {name: list(ends) for name, ends in self.variables.items()},
            "missions": len(self.places) * self.runs_per_place,
            "interrupted": self.interrupted,
            "warnings": self.scenario.flights.warnings,
            "confidence": self.scenario.flights.table.confidence,
            "requirements": [
                {
                    "name": one.requirement.name,
                    "holds": one.requirement.holds,
                    "allowed": one.requirement.allowed,
                    "side": one.side,
                    "boundaries": [
                        {"second": second, "value": value, "interval": [low, high], "safe_below": rising}
                        for second in seconds
                        for value, low, high, rising in self.crossings(one.requirement.name, second)
                    ],
                    "failure_probability": one.surface.probability.tolist(),
                    "sides": one.surface.sides.tolist(),
                }
                for one in self.requirements
            ],
            "places": self.places.tolist(),
            "runs_per_place": self.runs_per_place,
        }

    def seconds(self) -> list[float]:
        """Values of the second variable at which boundaries in the first are told."""
        return [self.value(1, x) for x in (0.0, 0.25, 0.5, 0.75, 1.0)]  # of the second variable, in the table

    def files(self) -> dict[str, str | bytes]:
        """Files of the run directory by name, see `save`."""
        return {**self.scenario.files(), "boundary.json": to_json(self.to_dict()), **self.report().files()}


@dataclass(frozen=True)
class Boundary:
    """Strategy of `seatrial.verify`: where in one or two variables requirements fail more than they allow.

    The missions of the scenario are shared out over the places, at least 16 at each of the first ones. A run
    directory keeps places that were flown; an executor flies as many at a time as it has workers.

    Attributes
    ----------
    variables : mapping of str to (float, float)
        One or two, each with its range: a name of `VARIABLES`, or a coefficient, pattern or group of the
        vehicle (``"stern.T_t"``), which gets the value.
    requirements : sequence of str
        Names of the scenario's requirements; all when empty.

    Examples
    --------
    >>> import seatrial as st
    >>> st.Boundary({"payload_kg": (-5.0, 40.0)}).requirements
    ()
    """

    variables: Mapping[str, tuple[float, float]]
    requirements: Sequence[str] = ()

    def survey(self, scenario: Scenario, work: Work = HERE) -> FailureBoundary:
        """Failure boundaries of a scenario; see `seatrial.verify` for errors.

        Parameters
        ----------
        scenario : Scenario
            What is flown.
        work : Work
            Threads, folder of the results and progress.
        """
        chosen = scenario.chosen(self.requirements)
        asked = variables_of(self.variables, scenario.flights)
        # Both ends of the range are tried before anything flies.
        for end in (0.0, 1.0):
            corner = np.full(len(asked), end)
            at_end, payload = flights_at(scenario.flights, asked, corner)
            check_table(scenario.source, at_end)
            at_end.check()
            vehicle = scenario.flights.fitted.vehicle
            own = vehicle.coefficients()["m"]
            if own + payload <= 0.0:
                raise CampaignError(
                    f"boundary: payload_kg: expected more than {-own:g}, the mass of {vehicle.name} in kg,"
                    f" found {payload:g}"
                )
            vehicle.with_coefficients(coefficients_at(asked, corner))
        clock, interrupted = Clock(), False
        threads = threads_of(work.threads, work.executor)
        with (
            RunDirectory(work.run_dir, "failure boundary", resume=work.resume) as run,
            fleet_of(work.executor) as fleet,
        ):
            survey = BoundarySurvey(scenario, asked, chosen, run, threads, fleet)
            try:
                survey.fly(work.progress, clock)
            except KeyboardInterrupt:
                interrupted = True
                if len(survey.x) < 2:
                    raise
            result = FailureBoundary(
                scenario=scenario,
                variables={variable.name: (variable.low, variable.high) for variable in asked},
                requirements=tuple(
                    RequirementBoundary(requirement, survey.surface(k), survey.failed(k))
                    for k, requirement in enumerate(chosen)
                ),
                places=np.array([
                    [v.value(x) for v, x in zip(asked, place, strict=True)] for place in survey.x
                ]),
                runs_per_place=survey.runs,
                interrupted=interrupted,
                facts=scenario.facts(
                    "failure boundary",
                    clock=clock,
                    options={
                        "variables": {variable.name: [variable.low, variable.high] for variable in asked},
                        "runs": scenario.runs,
                    },
                    interrupted=interrupted,
                ),
            )
            if work.run_dir is not None and not interrupted:
                run.publish(result.facts, result.files())
        return result
