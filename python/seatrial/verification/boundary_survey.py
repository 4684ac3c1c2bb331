"""The missions of a failure boundary: values of variables, the places that are flown, the failures there.

A place of the unit cube is a value of each variable between the ends of its range. Missions at the places of
a round depend on nothing but their place and number, so that they fly side by side.

Tests: ``tests/verification/test_boundary.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.chunks import Chunk, Format, Shared, run_chunks
from seatrial.base.errors import CampaignError, nearest
from seatrial.base.run import RunDirectory, sha256
from seatrial.base.work import Clock, Progress
from seatrial.flight.sensor_channels import sensors_of
from seatrial.statistics.failure_boundary import (
    BoundarySurface,
    Place,
    places_to_fly,
    start_places,
    surface_of,
)
from seatrial.vehicle.actuators import actuator_groups
from seatrial.verification.table import DistributionTable, Waves

if TYPE_CHECKING:
    from seatrial.base.fleet import Fleet
    from seatrial.verification.missions import CampaignFlights
    from seatrial.verification.requirement import Requirement
    from seatrial.verification.scenario import Scenario

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
_LEAST_RUNS, _MOST_PLACES, _ROUND = 16, 125, 8  # missions of a place, places, and places of a round


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
    found = []
    for name, ends in given.items():
        low, high = map(float, ends)
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise CampaignError(
                f"boundary: {name}: expected a range FROM:TO with FROM below TO, found {low:g}:{high:g}"
            )
        found.append(BoundaryVariable(name, low, high, () if name in VARIABLES else _meant(name, flights)))
    if set(found[0].coefficients) & set(found[-1].coefficients) and len(found) > 1:
        raise CampaignError(f"boundary: {found[0].name} and {found[1].name} set the same coefficient")
    return tuple(found)


def _meant(name: str, flights: CampaignFlights) -> tuple[str, ...]:
    """Coefficients behind a name, a pattern or a group."""
    vehicle = flights.fitted.vehicle
    own = list(vehicle.coefficients())
    group, _, suffix = name.partition(".")
    groups = actuator_groups(vehicle)
    if name not in own and group in groups:
        meant = [one for actuator in groups[group] if (one := f"{actuator}.{suffix}") in own]
    else:
        meant = [one for one in own if fnmatchcase(one, name)]
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
        current: dict[str, Any] = {}
        if variable.name == "current_speed_m_s":
            current = {"speed_m_s": fixed}
        elif variable.name == "current_direction_deg":
            current = {"direction_deg": fixed}
        elif variable.name == "turbulence_m_s":
            current = {"turbulence_m_s": fixed}
        elif variable.name == "wave_height_m":
            waves = Waves(height_m=fixed) if table.waves is None else table.waves
            table = table.model_copy(update={"waves": waves.model_copy(update={"height_m": fixed})})
        elif variable.name == "voltage_v":
            table = table.model_copy(update={"voltage_v": value})
        elif variable.name == "payload_kg":
            payload = value
        elif variable.name == "sensor_latency_s":
            flights = _later(flights, value)
        if current:
            table = table.model_copy(update={"current": table.current.model_copy(update=current)})
    return replace(flights, table=table), payload


def _later(flights: CampaignFlights, latency_s: float) -> CampaignFlights:
    """The same with sensors that are later."""
    sensors = sensors_of(flights.sensors, flights.fitted.vehicle)
    if sensors is None:
        raise CampaignError(
            "boundary: sensor_latency_s: the sensors of this campaign are perfect; name a set under"
            ' [verification], sensors = "typical"'
        )
    late = {kind: replace(one, latency_s=one.latency_s + latency_s) for kind, one in sensors.items()}
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
        self.runs = max(_LEAST_RUNS, -(-scenario.runs // _MOST_PLACES))
        self.places = max(scenario.runs // self.runs, first)
        self.x: list[Array] = []
        self.failures: list[list[int]] = []

    def fly(self, progress: Callable[[Progress], None] | None, clock: Clock) -> None:
        """Fly the first places, then those that the requirements choose in turn."""
        waiting = list(start_places(len(self.variables)))
        while len(self.x) < self.places:
            if self.x:
                waiting = []
                each = max(_ROUND // len(self.requirements), 1)
                for k, one in enumerate(self.requirements):
                    waiting += list(
                        places_to_fly(
                            self.seen(k),
                            allowed=one.allowed,
                            confidence=self.scenario.flights.table.confidence,
                            count=each,
                            runs=self.runs,
                        )
                    )
            for place, failures in self._flown(waiting[: self.places - len(self.x)]):
                self.failures.append(failures)
                self.x.append(place)
                if progress is not None:
                    done, left = len(self.x), self.places - len(self.x)
                    progress(
                        Progress(
                            what="boundary",
                            done=done,
                            total=self.places,
                            fraction=done / self.places,
                            elapsed_s=clock.elapsed_s,
                            left_s=clock.left_s(done, left),
                            detail=f"{done * self.runs} of {self.places * self.runs} missions flown",
                        )
                    )

    def _flown(self, places: Sequence[Array]) -> Iterator[tuple[Array, list[int]]]:
        """Places and the failures of each requirement there, wherever they are flown."""
        flights = self.scenario.flights
        values = ", ".join(f"{v.name} {v.low:g} {v.high:g}" for v in self.variables)
        holds = ", ".join(one.holds for one in self.requirements)
        shared = Shared((flights, self.variables, tuple(self.requirements), self.runs))
        chunks = [
            Chunk(
                f"boundary, place {number}",
                sha256(f"{flights.digest} {values} {holds} {place.tolist()} {self.runs}"),
                boundary_failures,
                shared,
                (number, place, self.threads),
            )
            for number, place in enumerate(places, len(self.x))
        ]
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
        return sum(one[k] for one in self.failures)


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
    return [one.judge(flown.metrics).failures for one in requirements]


_FORMAT: Format[list[int]] = Format(
    pack=lambda failures: {"failures": failures}, unpack=lambda kept: [int(one) for one in kept["failures"]]
)
