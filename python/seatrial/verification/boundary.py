"""`Boundary`: up to which payload, current or latency a requirement still holds.

One or two variables get values from given ranges, everything else is drawn as ``[verification]`` says. Few
missions are flown at a place, more where the failure probability crosses what the requirement allows
(`seatrial.statistics.failure_probability`). All requirements are judged on all missions; each chooses places
in its turn. The autopilot believes in the identified vehicle. Held by
``tests/verification/test_boundary.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.chunks import Chunk, Format, Shared, run_chunks
from seatrial.base.errors import CampaignError, nearest
from seatrial.base.fleet import fleet_of, threads_of
from seatrial.base.run import RunDirectory, RunResult, sha256, to_json
from seatrial.base.work import HERE, Clock, Progress, Work
from seatrial.flight.sensor_channels import sensors_of
from seatrial.statistics.failure_probability import (
    BoundarySurface,
    Place,
    places_to_fly,
    start_places,
    surface_of,
)
from seatrial.vehicle.actuators import actuator_groups
from seatrial.verification.requirement import named
from seatrial.verification.scenario import check_table
from seatrial.verification.table import DistributionTable, Waves

if TYPE_CHECKING:
    from seatrial.base.fleet import Fleet
    from seatrial.verification.missions import CampaignFlights
    from seatrial.verification.requirement import Requirement
    from seatrial.verification.scenario import Scenario

_KIND: Final = "failure boundary"  # of the run

VARIABLES: Mapping[str, str] = {
    "current_speed_m_s": "speed of the mean current",
    "current_direction_deg": "where the current goes, degrees from north over east",
    "turbulence_m_s": "standard deviation of the current about its mean",
    "wave_height_m": "significant height of the waves",
    "sensor_latency_s": "further latency of every sensor",
    "payload_kg": "further mass at the centre of gravity, in a hull of the same volume",
    "voltage_v": "supply",
}
"""Variables besides the coefficients of the vehicle."""

_OF_CURRENT = {
    "current_speed_m_s": "speed_m_s",
    "current_direction_deg": "direction_deg",
    "turbulence_m_s": "turbulence_m_s",
}
"""Variables that are keys of the table's current."""


@dataclass(frozen=True)
class BoundarySettings:
    """How the missions of a failure boundary are shared out over the places."""

    least_runs: int = 16  #: Missions at a place at least: fewer tell no failure probability.
    most_places: int = 125  #: Places beyond which more missions are flown at each instead.
    #: Places that are chosen, and flown side by side, before the surface is fitted anew.
    places_per_round: int = 8


SETTINGS = BoundarySettings()


@dataclass(frozen=True)
class BoundaryVariable:
    """A variable, its range, and the coefficients that it sets."""

    name: str
    low: float
    high: float
    coefficients: tuple[str, ...] = ()

    def value(self, x: float) -> float:
        """Value at a share of the range."""
        return self.low + (self.high - self.low) * x


def variables_of(
    given: Mapping[str, tuple[float, float]], flights: CampaignFlights
) -> tuple[BoundaryVariable, ...]:
    """Variables with the coefficients that they set, checked."""
    if not 1 <= len(given) <= 2:
        raise CampaignError(f"boundary: expected one or two variables, found {len(given)}")
    boundaries = []
    for name, ends in given.items():
        low, high = map(float, ends)
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise CampaignError(
                f"boundary: {name}: expected a range FROM:TO with FROM below TO, found {low:g}:{high:g}"
            )
        boundaries.append(
            BoundaryVariable(name, low, high, () if name in VARIABLES else _meant(name, flights))
        )
    if set(boundaries[0].coefficients) & set(boundaries[-1].coefficients) and len(boundaries) > 1:
        raise CampaignError(
            f"boundary: {boundaries[0].name} and {boundaries[1].name} set the same coefficient"
        )
    return tuple(boundaries)


def _meant(name: str, flights: CampaignFlights) -> tuple[str, ...]:
    """Coefficients behind a name, a pattern or a group."""
    vehicle = flights.fitted.vehicle
    own = list(vehicle.coefficients())
    group, _, suffix = name.partition(".")
    groups = actuator_groups(vehicle)
    if name not in own and group in groups:
        meant = [coefficient for actuator in groups[group] if (coefficient := f"{actuator}.{suffix}") in own]
    else:
        meant = [coefficient for coefficient in own if fnmatchcase(coefficient, name)]
    if not meant:
        raise CampaignError(
            f"boundary: {name!r} is no variable and no coefficient of {vehicle.name}"
            f"{nearest(name, [*VARIABLES, *own])}"
        )
    return tuple(meant)


def coefficients_at(variables: tuple[BoundaryVariable, ...], x: Array) -> dict[str, float]:
    """Coefficients that get a value at a place of the unit cube."""
    return {
        name: variable.value(share_)
        for variable, share_ in zip(variables, x.tolist(), strict=True)
        for name in variable.coefficients
    }


def flights_at(
    flights: CampaignFlights, variables: tuple[BoundaryVariable, ...], x: Array
) -> tuple[CampaignFlights, float]:
    """What flies at a place of the unit cube, and the payload, kg."""
    table, payload = flights.table, 0.0
    for variable, share_ in zip(variables, x.tolist(), strict=True):
        value = variable.value(share_)
        fixed = DistributionTable(fixed=value)
        if variable.name in _OF_CURRENT:
            current = table.current.model_copy(update={_OF_CURRENT[variable.name]: fixed})
            table = table.model_copy(update={"current": current})
        elif variable.name == "wave_height_m":
            waves = Waves(height_m=fixed) if table.waves is None else table.waves
            table = table.model_copy(update={"waves": waves.model_copy(update={"height_m": fixed})})
        elif variable.name == "voltage_v":
            table = table.model_copy(update={"voltage_v": value})
        elif variable.name == "payload_kg":
            payload = value
        elif variable.name == "sensor_latency_s":
            flights = _later(flights, value)
    return replace(flights, table=table), payload


def _later(flights: CampaignFlights, latency_s: float) -> CampaignFlights:
    """The same with sensors that are later."""
    sensors = sensors_of(flights.sensors, flights.fitted.vehicle)
    if sensors is None:
        raise CampaignError(
            "boundary: sensor_latency_s: the sensors of this campaign are perfect; name a set under"
            ' [verification], sensors = "typical"'
        )
    late = {kind: replace(sensor, latency_s=sensor.latency_s + latency_s) for kind, sensor in sensors.items()}
    return replace(flights, sensors=late)


class BoundarySurvey:
    """Missions at places, and what they say of each requirement."""

    def __init__(
        self,
        scenario: Scenario,
        variables: tuple[BoundaryVariable, ...],
        requirements: Sequence[Requirement],
        run: RunDirectory,
        threads: int | None,
        fleet: Fleet | None,
    ) -> None:
        self.scenario, self.variables, self.requirements = scenario, variables, requirements
        self.run, self.threads, self.fleet = run, threads, fleet
        first = len(start_places(len(variables)))
        self.runs = max(SETTINGS.least_runs, -(-scenario.runs // SETTINGS.most_places))
        self.places = max(scenario.runs // self.runs, first)
        self.x: list[Array] = []
        self.failures: list[list[int]] = []

    def fly(self, progress: Callable[[Progress], None] | None, clock: Clock) -> None:
        """Fly the first places, then those that the requirements choose in turn."""
        waiting = list(start_places(len(self.variables)))
        while len(self.x) < self.places:
            if self.x:
                waiting = []
                each = max(SETTINGS.places_per_round // len(self.requirements), 1)
                for k, requirement in enumerate(self.requirements):
                    waiting += list(
                        places_to_fly(
                            self.seen(k),
                            allowed=requirement.allowed,
                            confidence=self.scenario.flights.table.confidence,
                            count=each,
                            runs=self.runs,
                        )
                    )
            for place, failures in self._flown(waiting[: self.places - len(self.x)]):
                self.failures.append(failures)
                self.x.append(place)
                if progress is not None:
                    done, total = len(self.x), self.places
                    detail = f"{done * self.runs} of {total * self.runs} missions flown"
                    left_s = clock.left_s(done, total - done)
                    progress(
                        Progress(
                            "boundary", done, total, done / total, clock.elapsed_s, left_s, detail=detail
                        )
                    )

    def _flown(self, places: Sequence[Array]) -> Iterator[tuple[Array, list[int]]]:
        """Places and the failures of each requirement there, wherever they are flown."""
        flights = self.scenario.flights
        values = ", ".join(f"{v.name} {v.low:g} {v.high:g}" for v in self.variables)
        holds = ", ".join(requirement.holds for requirement in self.requirements)
        shared = Shared((flights, self.variables, tuple(self.requirements), self.runs))
        chunks = []
        for number, place in enumerate(places, len(self.x)):
            what = f"boundary, place {number}"
            digest = sha256(f"{flights.digest} {values} {holds} {place.tolist()} {self.runs}")
            chunks.append(Chunk(what, digest, boundary_failures, shared, (number, place, self.threads)))
        for done in run_chunks(chunks, self.run, _FORMAT, fleet=self.fleet):
            yield done.chunk.arguments[1], done.value

    def seen(self, k: int) -> list[Place]:
        """What was flown, as a requirement sees it."""
        return [
            Place(tuple(x.tolist()), self.runs, failures[k])
            for x, failures in zip(self.x, self.failures, strict=True)
        ]

    def surface(self, k: int) -> BoundarySurface:
        """Failure probability of a requirement over the ranges."""
        asked, confidence = self.requirements[k], self.scenario.flights.table.confidence
        return surface_of(self.seen(k), allowed=asked.allowed, confidence=confidence)

    def failed(self, k: int) -> int:
        """Missions that failed a requirement, of all that were flown."""
        return sum(counts[k] for counts in self.failures)


def boundary_failures(
    shared: tuple[CampaignFlights, tuple[BoundaryVariable, ...], tuple[Requirement, ...], int],
    number: int,
    place: Array,
    threads: int | None,
) -> list[int]:
    """Failures of each requirement among the missions at a place of the unit cube: a chunk of a boundary.

    `shared`: what is flown, the variables, the requirements, and the missions of a place.
    """
    flights, variables, requirements, runs = shared
    there, payload = flights_at(flights, variables, place)
    drawn = there.draws(np.arange(number * runs, (number + 1) * runs))
    given = dict(drawn.coefficients)
    given |= {name: np.full(len(drawn), value) for name, value in coefficients_at(variables, place).items()}
    if payload:
        own = flights.fitted.vehicle.coefficients()
        given["m"] = given.get("m", np.full(len(drawn), own["m"])) + payload
    flown = there.fly_drawn(replace(drawn, coefficients=given), threads=threads)
    return [requirement.judge(flown.metrics).failures for requirement in requirements]


_FORMAT: Format[list[int]] = Format(
    pack=lambda failures: {"failures": failures},
    unpack=lambda kept: [int(count) for count in kept["failures"]],
)


Side = Literal["boundary", "safe", "fails", "probably safe", "probably fails"]


@dataclass(frozen=True, eq=False)
class RequirementBoundary:
    """Where a requirement fails more often than it allows.

    `surface`: failure probability over the ranges; None before anything was flown. `failures`: missions that
    failed, of all that were flown.
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

    `scenario`: what was flown. `variables`: name and range (from, to) of each. `requirements`: a
    `RequirementBoundary` each. `places`: values (n, d) at which missions were flown, and how many at each.
    `runs_per_place`: missions at a place. `interrupted`: whether Ctrl-C ended it early. `facts`: what the
    result rests on.
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

        Raises CampaignError: there is none.
        """
        return named([name], {one.requirement.name: one for one in self.requirements})[0]

    def value(self, axis: int, x: float) -> float:
        """Value of a variable at a share of its range.

        `axis`: 0 for the first variable, 1 for the second. `x`: from 0 to 1.
        """
        low, high = list(self.variables.values())[axis]
        return low + (high - low) * x

    def crossings(self, name: str, second: float | None = None) -> list[tuple[float, float, float, bool]]:
        """Boundaries of a requirement along the first variable: value, from, to, and whether below is safe.

        `name`: of the requirement. `second`: value of the second variable, where there are two.
        """
        at = None
        if second is not None:
            low, high = list(self.variables.values())[1]
            at = (second - low) / (high - low)
        crossings = self.requirement(name).surface.crossings(at)
        ends = [(self.value(0, c.interval[0]), self.value(0, c.interval[1])) for c in crossings]
        return [(self.value(0, c.at), *span, c.rising) for c, span in zip(crossings, ends, strict=True)]

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

        `scenario`: what is flown. `work`: threads, folder of the results and progress.
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
        with RunDirectory(work.run_dir, _KIND, resume=work.resume) as run, fleet_of(work.executor) as fleet:
            survey = BoundarySurvey(scenario, asked, chosen, run, threads, fleet)
            try:
                survey.fly(work.progress, clock)
            except KeyboardInterrupt:
                interrupted = True
                if len(survey.x) < 2:
                    raise
            ranges = {variable.name: (variable.low, variable.high) for variable in asked}
            options = {
                "variables": {name: list(ends) for name, ends in ranges.items()},
                "runs": scenario.runs,
            }
            result = FailureBoundary(
                scenario=scenario,
                variables=ranges,
                requirements=tuple(
                    RequirementBoundary(requirement, survey.surface(k), survey.failed(k))
                    for k, requirement in enumerate(chosen)
                ),
                places=np.array([
                    [v.value(x) for v, x in zip(asked, place, strict=True)] for place in survey.x
                ]),
                runs_per_place=survey.runs,
                interrupted=interrupted,
                facts=scenario.facts(_KIND, clock=clock, options=options, interrupted=interrupted),
            )
            if work.run_dir is not None and not interrupted:
                run.publish(result.facts, result.files())
        return result
