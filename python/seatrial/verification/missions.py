"""The missions of a verification: which vehicle flies which one through what, chunk after chunk.

The autopilot's own model is the identified vehicle; those that fly are drawn from its covariance. Mission i
is a function of the campaign's seed and of i alone, whatever else is flown beside it: lanes give the same
bits wherever a case stands in a batch. A batch of one takes another path through the core, whose last bits
differ, so that a mission that is alone is flown in two lanes.

A chunk is 512 missions: enough to fill the lanes of many threads, few enough that Ctrl-C loses seconds. Held
by ``tests/verification/test_verify.py``.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from seatrial._core import autopilot_names, error_edges
from seatrial.base.arrays import Array
from seatrial.base.chunks import Chunk, Format, Shared, run_chunks
from seatrial.base.finding import Finding
from seatrial.base.report import clause_of
from seatrial.base.work import Clock, Progress
from seatrial.flight.cases import Cases
from seatrial.flight.checks import mismatch
from seatrial.flight.conditions import Conditions, Water
from seatrial.flight.disturbances import Fault, Outage, SeaState
from seatrial.flight.flight import Flight
from seatrial.identification.fitted import Fitted
from seatrial.verification.draws import Draws, draw_missions
from seatrial.verification.expression import KNOWN
from seatrial.verification.flown_missions import (
    KEPT,
    WORDS,
    FlownMissions,
    MissionStore,
    metrics_for_requirements,
)
from seatrial.verification.requirement import obstacles
from seatrial.verification.table import VerificationTable

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.base.fleet import Fleet
    from seatrial.base.run import RunDirectory
    from seatrial.flight.mission import Mission
    from seatrial.sensors.sensor import Sensor


@dataclass(frozen=True)
class MissionSettings:
    """How many missions are flown at a time."""

    chunk: int = 512  #: Missions between two reports.
    draws_of_water: int = 64  #: Draws from which a filter is told of the water.


MISSION_SETTINGS = MissionSettings()


@dataclass(frozen=True, eq=False)
class CampaignFlights:
    """What a verification flies.

    `table`: what is asked for. `fitted`: the identified vehicle and how well it is known. `autopilot`: with
    the gains that are verified. `missions`: those of the table, in its order. `seed`: of the campaign.
    `model`: the vehicle that the autopilot believes in; None: the identified one. `sensors`: "typical", a
    file, sensors by kind, or None for perfect ones. `rho`, `g`: density, kg/m3, and gravity, m/s2, where they
    are not the vehicle's.
    """

    table: VerificationTable
    fitted: Fitted
    autopilot: Autopilot
    missions: tuple[Mission, ...]
    seed: int
    model: Vehicle | None = None
    sensors: Mapping[str, Sensor] | str | Path | None = "typical"
    rho: float | None = None
    g: float | None = None

    @property
    def titles(self) -> tuple[str, ...]:
        """Names of the missions."""
        return tuple(one.title for one in self.table.missions)

    def draws(self, numbers: int | ArrayLike) -> Draws:
        """What is drawn for missions of these numbers, or for the first so many."""
        return draw_missions(self.table, self.fitted, self.missions, seed=self.seed, numbers=numbers)

    def with_autopilot(self, autopilot: Autopilot) -> CampaignFlights:
        """The same draws for another autopilot."""
        return replace(self, autopilot=autopilot)

    def check(self) -> None:
        """Refuse what cannot be flown before anything flies.

        Raises SimulationError, TrialError, VehicleError, CampaignError where a number, name, sensor or file
        is not usable.
        """
        self.draws([0])
        for one in self._ready:
            self.autopilot.engage(self.fitted.vehicle if self.model is None else self.model, one.mission.core)

    @property
    def doubt(self) -> Finding | None:
        """That the autopilot does not belong to the vehicle that it believes in."""
        return mismatch(self.autopilot, self.fitted.vehicle if self.model is None else self.model)

    @property
    def warnings(self) -> list[str]:
        """That doubt as a sentence, for the JSON of a result."""
        return [] if self.doubt is None else [f"{clause_of(self.doubt, 'flight_findings')}."]

    @property
    def left_out(self) -> tuple[str, ...]:
        """Sentences on where the sensors of the flights differ from those of the set."""
        return self._ready[0].circumstances.sensor_notes

    @property
    def sensor_offsets(self) -> Array:
        """Standard deviation of the offset of every channel of the sensors, (16,), SI and rad."""
        return np.asarray(self._ready[0].channels.errors[:, 1])

    @property
    def longest_s(self) -> tuple[float, ...]:
        """Time after which each mission ends at the latest, s."""
        return tuple(one.circumstances.max_time_s for one in self._ready)

    @property
    def position_sd_m(self) -> float:
        """Standard deviation of the sensors' position along an axis at the end of the longest mission, m."""
        _, offset, walk, _ = self._ready[0].channels.errors[:2].max(axis=0).tolist()
        longest = max(one.planned_time for one in self.missions)
        return math.sqrt(offset**2 + walk**2 * longest)

    def fly(self, numbers: ArrayLike, *, threads: int | None = None) -> FlownMissions:
        """Missions of these numbers (k,), flown side by side; the result does not depend on the threads."""
        return self.fly_drawn(self.draws(numbers), threads=threads)

    def fly_drawn(self, drawn: Draws, *, threads: int | None = None) -> FlownMissions:
        """Drawn cases, flown side by side; the result does not depend on the threads."""
        began = time.monotonic()
        metrics: dict[str, Any] = {}
        perceived, true = np.zeros((2, len(drawn), len(error_edges()) + 1))
        for index in np.unique(drawn.mission).tolist():
            rows = np.flatnonzero(drawn.mission == index)
            flown = self._cases(drawn.take(rows), index).fly(threads=threads)
            own, samples = metrics_for_requirements(flown)
            perceived[rows], true[rows] = (counts[: len(rows)] for counts in samples)
            for name, values in own.items():
                if name not in metrics:
                    words = values.dtype.kind == "U"
                    metrics[name] = np.empty(len(drawn), dtype=WORDS if words else values.dtype)
                metrics[name][rows] = values[: len(rows)]
        return FlownMissions(
            numbers=drawn.numbers,
            mission=drawn.mission,
            seeds=drawn.seeds,
            metrics=metrics,
            causes=dict(drawn.causes),
            perceived_counts=perceived,
            true_counts=true,
            wall_s=time.monotonic() - began,
        )

    def replay(self, number: int) -> Flight:
        """Flight of the mission with this number, with its log; its metrics are those of the verification.

        The vehicle of the flight is the drawn one, and the autopilot believes in the identified one.
        """
        return self.replay_drawn(self.draws([number]))

    def replay_drawn(self, drawn: Draws) -> Flight:
        """Flight of a single drawn case, with its log."""
        cases = replace(self._cases(drawn, int(drawn.mission[0])), logs=True)
        groups = autopilot_names()["groups"]
        around = replace(
            cases.circumstances,
            current=tuple(drawn.current[0].tolist()),
            turbulence=tuple(drawn.turbulence[0].tolist()),
            waves=SeaState.of_row(drawn.waves[0]),
            faults=tuple(_fault(row, self.fitted.vehicle) for row in drawn.faults),
            outages=tuple(Outage(groups[group], begin, end) for _, group, begin, end in drawn.outages),
            seed=int(drawn.seeds[0]),
        )
        flown = self.fitted.vehicle.with_coefficients({
            name: float(values[0]) for name, values in drawn.coefficients.items()
        })
        return Flight.of_case(cases.fly(), replace(cases, vehicle=flown, circumstances=around))

    @cached_property
    def digest(self) -> str:
        """Hash of everything that a flight depends on."""
        judging = {"runs", "requirements", "confidence", "keep_worst", "cases"}
        asked = self.table.model_dump(mode="json", exclude=judging)
        around, fitted = self._ready[0].circumstances, self.fitted
        what = [
            metadata.version("seatrial"),
            [*KNOWN, *KEPT, *self.draws([0]).causes],
            self.seed,
            asked,
            [self.rho, self.g, around.sensors],
            [fitted.vehicle.to_toml(), fitted.names, fitted.covariance.tolist()],
            self.autopilot.to_toml(),
            None if self.model is None else self.model.to_toml(),
            [one.to_toml() for one in self.missions],
        ]
        return hashlib.sha256(json.dumps(what).encode()).hexdigest()

    @cached_property
    def _ready(self) -> tuple[Cases, ...]:
        """The case of each mission in which everything that is drawn still has its mean."""
        table = self.table
        return tuple(
            Cases.of(
                self.fitted.vehicle,
                self.autopilot,
                mission,
                conditions=Conditions(
                    model=self._believed,
                    sensors=self.sensors,
                    navigation=table.navigation,
                    voltage_v=table.voltage_v,
                    max_step_s=Conditions.max_step_s,
                    max_time_s=table.max_time_s,
                ),
                water=Water(
                    **self._told,
                    turbulence_times_s=table.current.turbulence_times_s,
                    current_walk=table.current.walk_m_s,
                    obstacles=obstacles(table.obstacles),
                    seabed=table.plane,
                    rho=self.rho,
                    g=self.g,
                ),
            )
            for mission in self.missions
        )

    @property
    def _believed(self) -> Vehicle | None:
        """The model of the autopilot; a navigation filter on the identified one knows that others fly."""
        asked = self.table.coefficients
        drawn = bool(asked) if isinstance(asked, dict) else asked == "covariance" and bool(self.fitted.names)
        if self.model is None and self.table.navigation == "filter" and drawn:
            return self.fitted.vehicle
        return self.model

    @property
    def _told(self) -> dict[str, Any]:
        """What a navigation filter is told of the water: the middle of the gusts and seas that are drawn."""
        if self.table.navigation != "filter":
            return {}
        drawn = self.draws(MISSION_SETTINGS.draws_of_water)
        gusts = np.sqrt(np.mean(drawn.turbulence**2, axis=0))
        sea = SeaState.of_row(
            drawn.waves[np.argsort(drawn.waves[:, 0])[MISSION_SETTINGS.draws_of_water // 2]]
        )
        if sea is not None:
            sea = replace(sea, spreading_deg=60.0)  # of a sea whose direction differs from mission to mission
        return {"turbulence": gusts, "waves": sea}

    def _cases(self, drawn: Draws, index: int) -> Cases:
        """Drawn cases of one mission, at least two of them."""
        if len(drawn) == 1:
            drawn = _twice(drawn)
        return replace(
            self._ready[index],
            seeds=drawn.seeds.tolist(),
            position=drawn.position,
            attitude=drawn.attitude,
            nu=drawn.nu,
            current=drawn.current,
            turbulence=drawn.turbulence,
            waves=drawn.waves,
            coefficients=drawn.coefficients,
            faults=drawn.faults,
            case_outages=drawn.outages,
            sensor_offsets=drawn.offsets,
        )


def _twice(drawn: Draws) -> Draws:
    """A case alone beside itself, so that it flies in lanes as it does among others."""
    return replace(
        drawn.take([0, 0]),
        faults=[(lane, *row[1:]) for lane in (0, 1) for row in drawn.faults],
        outages=[(lane, *row[1:]) for lane in (0, 1) for row in drawn.outages],
    )


def _fault(row: tuple[int, str, float, float], vehicle: Vehicle) -> Fault:
    """A drawn fault as a person would give it."""
    _, actuator, at, command = row
    if np.isnan(command):
        return Fault(actuator, at, stuck=True)
    dead = command == float(vehicle.actuator_info()[actuator]["neutral"])
    return Fault(actuator, at, stuck_at=None if dead else command)


@dataclass(frozen=True, eq=False)
class Series:
    """Missions flown, None without a single one, whether Ctrl-C ended them early, and a record per chunk."""

    flown: FlownMissions | None
    interrupted: bool
    records: tuple[Mapping[str, Any], ...] = ()


@dataclass(frozen=True, eq=False)
class Flyer:
    """Where missions are flown and kept.

    `run`: where finished chunks are kept and found again. `progress`: called after each chunk; it may raise
    KeyboardInterrupt. `threads`: per chunk. `fleet`: where chunks are flown; None: in this process.
    """

    run: RunDirectory
    progress: Callable[[Progress], None] | None = None
    threads: int | None = None
    fleet: Fleet | None = None


def fly_series(flights: CampaignFlights, runs: int, flyer: Flyer, *, autopilot: str = "verified") -> Series:
    """The first missions of a verification; after Ctrl-C those that were finished.

    `autopilot`: what to call it in reports and in the run directory.
    """
    clock, store, records = Clock(), MissionStore(), list[Mapping[str, Any]]()
    fresh, flown_s, wall_s = 0, 0.0, 0.0
    shared, interrupted = Shared(flights), False
    starts = range(0, runs, MISSION_SETTINGS.chunk)
    chunks = (
        Chunk(
            f"{autopilot}, missions {start} to {stop - 1}",
            flights.digest,
            fly_missions,
            shared,
            (start, stop, flyer.threads),
        )
        for start, stop in zip(starts, [*starts[1:], runs], strict=True)
    )
    try:
        for done in run_chunks(chunks, flyer.run, _FORMAT, fleet=flyer.fleet):
            # Time flown per time taken counts kept chunks too, what is left those of this run alone.
            took = float(done.record["wall_s"])
            store.append(replace(done.value, wall_s=took))
            records.append(done.record)
            stop = int(done.value.numbers[-1]) + 1
            fresh += 0 if done.kept else len(done.value)
            flown_s, wall_s = flown_s + done.value.flown_s, wall_s + took
            if flyer.progress is not None:
                factor, left_s = flown_s / max(wall_s, 1e-9), clock.left_s(fresh, runs - stop)
                detail = f"{stop} of {runs} missions flown, {factor:,.0f} times real time"
                flyer.progress(
                    Progress(autopilot, stop, runs, stop / runs, clock.elapsed_s, left_s, detail=detail)
                )
    except KeyboardInterrupt:
        interrupted = True
    return Series(store.flown(), interrupted, tuple(records))


def fly_missions(flights: CampaignFlights, start: int, stop: int, threads: int | None) -> FlownMissions:
    """Missions from a number up to another one, which is left out: a chunk of a verification."""
    return flights.fly(np.arange(start, stop), threads=threads)


_FORMAT = Format(pack=FlownMissions.to_parquet, unpack=FlownMissions.from_parquet)
