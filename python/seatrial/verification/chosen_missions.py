"""Missions that no number of a campaign draws: points among the draws, and regression cases.

A search walks among missions as points: current, waves, start, which actuator fails and when, outages,
offsets of sensors and the coefficients are standard normal numbers behind their distributions; the seed of
noise and gusts stays a seed.

A regression case is a mission that failed once, written into the campaign and flown in every verification. It
is told by what it met and not by the random numbers behind it: other distributions in the table leave it as
it is.

Tests: ``tests/verification/test_rare.py``, ``tests/verification/test_falsify.py``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from seatrial._core import autopilot_names
from seatrial.base.arrays import Array
from seatrial.base.work import Clock, Progress
from seatrial.verification.draws import (
    COMMON_WIDTH,
    FAULT_WIDTH,
    OUTAGE_WIDTH,
    SEED_COLUMN,
    Draws,
    FaultRow,
    OutageRow,
    composed,
    scattered,
)
from seatrial.verification.judgement import robustness

if TYPE_CHECKING:
    from seatrial.identification.fitted import Fitted
    from seatrial.verification.missions import CampaignFlights
    from seatrial.verification.requirement import Requirement
import math
from collections.abc import Mapping, Sequence

from seatrial.base.errors import CampaignError, SimulationError, nearest
from seatrial.base.plain import Plain
from seatrial.flight.disturbances import CALM, Fault, Outage, fault_rows, outage_rows
from seatrial.verification.table import CaseTable

if TYPE_CHECKING:
    from seatrial.verification.missions import CampaignFlights
    from seatrial.verification.requirement import Requirement


_BATCH = 512  # missions in memory at once


@dataclass(frozen=True, eq=False)
class MissionSpace:
    """Missions of a campaign by standard normal numbers (d) and the seed of their noise.

    `flights`: what the campaign flies.
    """

    flights: CampaignFlights

    @cached_property
    def fitted(self) -> Fitted:
        """The vehicle with the uncertainty of its coefficients."""
        return scattered(self.flights.table, self.flights.fitted)

    @cached_property
    def offset(self) -> NDArray[np.intp]:
        """Channels of the sensors that have an offset."""
        return np.flatnonzero(self.flights.sensor_offsets)

    @cached_property
    def widths(self) -> tuple[int, int, int, int, int]:
        """Numbers of what every case has, of faults, outages, offsets of sensors and coefficients."""
        table = self.flights.table
        return (
            COMMON_WIDTH - 1,
            FAULT_WIDTH * len(table.faults),
            OUTAGE_WIDTH * len(table.outages),
            len(self.offset),
            len(self.fitted.names),
        )

    @property
    def dimensions(self) -> int:
        """Numbers of a mission, besides its seed."""
        return sum(self.widths)

    def possible(self, x: Array) -> NDArray[np.bool_]:
        """Which samples (k, d) have a vehicle that can be."""
        return self.fitted.at(x[:, self.dimensions - self.widths[-1] :])[1]

    def draws(self, x: Array, seeds: Array) -> Draws:
        """Missions of samples (k, d) and seeds (k,) from 0 to 1."""
        from scipy.special import ndtr

        common, faults, outages, offset, normals = np.split(x, np.cumsum(self.widths[:-1]), axis=1)
        tiny = 2.0**-54
        every, failing, silent = (np.clip(ndtr(part), tiny, 1.0 - tiny) for part in (common, faults, outages))
        seeds = np.clip(seeds, tiny, 1.0 - tiny)
        offsets = np.zeros((len(x), len(self.flights.sensor_offsets)))
        offsets[:, self.offset] = offset
        drawn = composed(
            self.flights.table,
            self.fitted,
            self.flights.missions,
            numbers=range(len(x)),
            coefficients=self.fitted.at(normals)[0],
            uniform=(np.insert(every, SEED_COLUMN, seeds, axis=1), failing, silent),
        )
        names = autopilot_names()["channels"]
        causes = {f"offset of the measured {names[c]}, sigmas": offsets[:, c] for c in self.offset}
        return replace(drawn, offsets=offsets, causes={**drawn.causes, **causes})

    def robustness(
        self, requirement: Requirement, x: Array, seeds: Array, *, threads: int | None = None
    ) -> Array:
        """Robustness (k,) of a requirement on the missions of samples."""
        found = []
        for start in range(0, len(x), _BATCH):
            rows = slice(start, start + _BATCH)
            flown = self.flights.fly_drawn(self.draws(x[rows], seeds[rows]), threads=threads)
            found.append(robustness(requirement, flown, self.flights))
        return np.concatenate(found) if found else np.zeros(0)


_T = TypeVar("_T")


def searched(
    requirements: Sequence[Requirement],
    search: Callable[[Requirement, Callable[[float, str], None]], _T],
    progress: Callable[[Progress], None] | None,
) -> tuple[tuple[_T, ...], bool]:
    """What a search finds for requirements, one after the other, and whether Ctrl-C ended it early.

    `search` gets a requirement, and what to call with the share that is done and a detail.
    """
    clock, results, count = Clock(), list[_T](), len(requirements)
    for place, requirement in enumerate(requirements):

        def watch(share: float, detail: str, place: int = place, what: str = requirement.name) -> None:
            if progress is None:
                return
            fraction = (place + share) / count
            left = clock.elapsed_s * (1.0 - fraction) / max(fraction, 1e-6)
            progress(Progress(what, place, count, fraction, clock.elapsed_s, left, detail=detail))

        try:
            results.append(search(requirement, watch))
        except KeyboardInterrupt:
            return tuple(results), True
    return tuple(results), False


@dataclass(frozen=True)
class FlownCase(Plain, also="held"):
    """A regression case that was flown.

    `name`, `mission`: of the case and of its mission. `robustness`: by requirement; positive where it was
    held.
    """

    name: str
    mission: str
    robustness: Mapping[str, float]

    @property
    def held(self) -> bool:
        """Whether all its requirements were held."""
        return all(value > 0.0 for value in self.robustness.values())


def check_cases(
    cases: Sequence[CaseTable], flights: CampaignFlights, requirements: Sequence[Requirement], where: str
) -> None:
    """Refuse cases that cannot be flown or judged.

    Raises CampaignError where an unknown mission, requirement, coefficient, channel, actuator or sensor.
    """
    channels, known = autopilot_names()["channels"], flights.fitted.vehicle.coefficients()
    for case in cases:
        place = f"{where}: verification, case {case.name!r}"
        for key, names, of in (
            ("mission", () if case.mission is None else (case.mission,), flights.titles),
            ("requirements", case.requirements, [each.name for each in requirements]),
            ("coefficients", tuple(case.coefficients), known),
            ("sensor_offsets", tuple(case.sensor_offsets), channels),
        ):
            for name in names:
                if name not in of:
                    raise CampaignError(f"{place}, key {key}: unknown {name!r}{nearest(name, of)}")
        try:
            draws_of([case], flights)
        except SimulationError as error:
            raise CampaignError(f"{place}: {error}") from None


def draws_of(cases: Sequence[CaseTable], flights: CampaignFlights) -> Draws:
    """What the cases (k) meet, as draws.

    Raises SimulationError where an actuator or sensor is unknown, or a command is beyond its range.
    """
    missions, titles = flights.missions, flights.titles
    index = [0 if case.mission is None else titles.index(case.mission) for case in cases]
    channels, vehicle = autopilot_names()["channels"], flights.fitted.vehicle
    own = vehicle.coefficients()
    varied = dict.fromkeys(name for case in cases for name in case.coefficients)
    current = np.array([case.current_m_s for case in cases])
    position, attitude = np.zeros((2, len(cases), 3))
    nu, offsets = np.zeros((len(cases), 6)), np.zeros((len(cases), len(channels)))
    faults: list[FaultRow] = []
    outages: list[OutageRow] = []
    for k, case in enumerate(cases):
        # What a case does not say is as the mission has it: its start, level, at rest in the water.
        start, longest = missions[index[k]].start, float(flights.longest_s[index[k]])
        position[k] = case.position_m or (start["north_m"], start["east_m"], start["depth_m"])
        attitude[k] = np.radians(case.attitude_deg) if case.attitude_deg else (0.0, 0.0, start["heading"])
        cosine, sine = math.cos(attitude[k, 2]), math.sin(attitude[k, 2])
        north, east, down = current[k]
        nu[k, :3] = cosine * north + sine * east, -sine * north + cosine * east, down
        if case.velocity is not None:
            nu[k] = case.velocity
        for name, value in case.sensor_offsets.items():
            offsets[k, channels.index(name)] = value
        failing = [Fault(f.actuator, f.at_s, f.command is None, f.command) for f in case.faults]
        faults += fault_rows(failing, vehicle, longest, case=k)
        silent = [Outage(o.sensor, o.from_s, o.until_s) for o in case.outages]
        outages += [(k, *row) for row in outage_rows(silent, longest)]
    return Draws(
        numbers=np.arange(len(cases)),
        mission=np.array(index, dtype=np.int_),
        coefficients={
            name: np.array([case.coefficients.get(name, own.get(name, 0.0)) for case in cases])
            for name in varied
        },
        current=current,
        turbulence=np.array([case.turbulence_m_s for case in cases]),
        waves=np.array([_sea(case) for case in cases]),
        position=position,
        attitude=attitude,
        nu=nu,
        faults=faults,
        outages=outages,
        seeds=np.array([case.seed for case in cases], dtype=np.int_),
        causes={},
        offsets=offsets,
    )


def _sea(case: CaseTable) -> Sequence[float]:
    if case.waves is None:
        return CALM
    height, period, toward, spreading, peakedness = case.waves
    return height, period, math.radians(toward), math.radians(spreading), peakedness


def fly_cases(
    cases: Sequence[CaseTable],
    flights: CampaignFlights,
    requirements: Sequence[Requirement],
    *,
    threads: int | None = None,
) -> tuple[FlownCase, ...]:
    """The cases, flown and judged."""
    if not cases:
        return ()
    flown = flights.fly_drawn(draws_of(cases, flights), threads=threads)
    values = {asked.name: robustness(asked, flown, flights) for asked in requirements}
    passed = {asked.name: asked.judge(flown.metrics).held for asked in requirements}
    results = []
    for k, case in enumerate(cases):
        names = case.requirements or tuple(values)
        # Held with nothing to spare is held.
        judged = {name: float(values[name][k]) or (1e-12 if passed[name][k] else -1e-12) for name in names}
        results.append(FlownCase(case.name, flights.titles[int(flown.mission[k])], judged))
    return tuple(results)


def case_text(name: str, requirement: str, drawn: Draws, flights: CampaignFlights) -> str:
    """TOML of a single drawn case as an entry ``[[verification.cases]]``."""
    import tomlkit

    groups, channels = autopilot_names()["groups"], autopilot_names()["channels"]
    table = tomlkit.table()
    table["name"], table["requirements"] = name, [requirement]
    if len(flights.titles) > 1:
        table["mission"] = flights.titles[int(drawn.mission[0])]
    table["seed"] = int(drawn.seeds[0])
    table["current_m_s"] = drawn.current[0].tolist()
    table["turbulence_m_s"] = drawn.turbulence[0].tolist()
    height, period, toward, spreading, peakedness = drawn.waves[0].tolist()
    if height > 0.0:
        table["waves"] = [height, period, math.degrees(toward), math.degrees(spreading), peakedness]
    table["position_m"] = drawn.position[0].tolist()
    table["attitude_deg"] = np.degrees(drawn.attitude[0]).tolist()
    table["velocity"] = drawn.nu[0].tolist()
    # Coefficients and offsets stand there only where they are not those of the identified vehicle.
    own = flights.fitted.vehicle.coefficients()
    changed = {name: float(x[0]) for name, x in drawn.coefficients.items() if x[0] != own.get(name, 0.0)}
    if changed:
        table["coefficients"] = changed
    if drawn.offsets is not None and drawn.offsets[0].any():
        offsets = zip(channels, drawn.offsets[0].tolist(), strict=True)
        table["sensor_offsets"] = {channel: value for channel, value in offsets if value}
    failures = {
        "faults": [
            {"actuator": actuator, "at_s": at} | ({} if math.isnan(command) else {"command": command})
            for _, actuator, at, command in drawn.faults
        ],
        "outages": [
            {"sensor": groups[g], "from_s": begin, "until_s": end} for _, g, begin, end in drawn.outages
        ],
    }
    table.update({key: rows for key, rows in failures.items() if rows})
    whole = tomlkit.document()
    cases = tomlkit.aot()
    cases.append(table)
    whole["verification"] = tomlkit.table(is_super_table=True)
    whole["verification"]["cases"] = cases
    return tomlkit.dumps(whole)
