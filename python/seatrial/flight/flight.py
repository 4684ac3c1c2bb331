"""`Flight`: one closed-loop flight, what came of it, and the files and words that tell it.

Metrics carry units in their names. Held by ``tests/flight/test_flight.py``, ``tests/cli/test_cli_fly.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from seatrial._core import Autopilot, Flights, State, Vehicle, autopilot_names, checked_threads
from seatrial.base.arrays import Array, Mask
from seatrial.base.errors import SimulationError
from seatrial.base.files import parquet
from seatrial.base.finding import Finding
from seatrial.base.plain import Plain
from seatrial.base.report import Report, Reported, Section, clause_of, report_of, writer_of
from seatrial.base.run import RunDirectory, run_facts, sha256, to_json
from seatrial.base.toml_file import loaded
from seatrial.base.work import Clock, takes
from seatrial.flight.cases import Cases
from seatrial.flight.checks import (
    Corridor,
    checked_failures,
    checked_seed,
    checked_turbulence,
    checked_vector,
    mismatch,
)
from seatrial.flight.conditions import CALM, PLAIN, Conditions, Water
from seatrial.flight.disturbances import Fault, Outage
from seatrial.flight.excesses import Excess, excesses, unkept
from seatrial.flight.findings import Alert, Result, findings
from seatrial.flight.log import FlightLog, log_fields
from seatrial.flight.metrics import (
    CODED,
    DIVERGED,
    ActuatorUse,
    Leg,
    Loop,
    actuators_of,
    ending_of,
    legs_of,
    loops_of,
    metrics_of,
)
from seatrial.flight.mission import Mission
from seatrial.flight.payload import Payload, sampled

if TYPE_CHECKING:
    import polars as pl

    from seatrial.flight.payload import Samples


@dataclass(frozen=True, eq=False, repr=False)
class Flight(Reported, FlightLog):
    """A flight of a vehicle with its autopilot on a mission: its log, and what came of it.

    Attributes
    ----------
    vehicle, autopilot, mission, route, circumstances, period_s, t, position, euler, nu, altitude, water
        Log of the flight, see `seatrial.flight.log.FlightLog`, and what it rests on.
    measured, desired, errors, distance, leg, holding, done, mode, modes, alert, cause
        What the autopilot was told, and what guidance and safety made of it.
    commands, actuators, demanded, achieved, power, battery
        What was asked of the actuators, and what became of it.
    outcome
        "complete", "surfaced", "aborted", "out of time" or "diverged".
    metrics
        Metrics of the whole flight, units in the names.
    clock
        When it was computed, and how long that took.
    samples
        What the payload logged; None without one.
    """

    outcome: str
    metrics: Mapping[str, float]
    clock: Clock = field(default_factory=Clock)
    samples: Samples | None = None

    @classmethod
    def of_case(cls, flights: Flights, cases: Cases, *, case: int = 0) -> Flight:
        """Flight of a `case` of `flights` that kept its log; the circumstances are those of all `cases`."""
        metrics = metrics_of(flights)
        return cls(
            vehicle=cases.vehicle,
            autopilot=cases.autopilot,
            mission=cases.mission,
            route=cases.route,
            circumstances=cases.circumstances,
            period_s=cases.autopilot.period_s,
            t=np.asarray(flights.t(case)),
            outcome=ending_of(metrics, case),
            metrics={name: float(values[case]) for name, values in metrics.items() if name not in CODED},
            **log_fields(flights, cases.vehicle, cases.autopilot, case),
        )

    def table(self) -> pl.DataFrame:
        """Log with the canonical columns of a trial, beside them what was measured, desired and sampled."""
        table = super().table()
        if self.samples is None:
            return table
        return table.with_columns(**self.samples.log_columns(len(self.t))).fill_nan(None)

    @property
    def diverged(self) -> bool:
        """Whether the motion ended in numbers that are none."""
        return self.outcome == DIVERGED

    @property
    def complete(self) -> bool:
        """Whether the mission was flown to its end, all waypoints reached, its distances and limits kept.

        Limits are those of depth and altitude, by the true motion.
        """
        return self.outcome == "complete" and all(leg.reached for leg in self.legs) and not self.unkept

    @property
    def unkept(self) -> tuple[str, ...]:
        """Distances and limits of the mission that the vehicle truly did not keep, by kind of excess."""
        kinds = unkept(self.metrics, self.mission.promised_m, self.mission.limits)
        return tuple(kind for kind, broken in kinds.items() if broken)

    @property
    def outcome_in_words(self) -> str:
        """How it ended; one that missed waypoints or kept no distance or limit is not called complete."""
        return str(writer_of(self).outcome(self))

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What makes the flight doubtful before anything flew: an autopilot of another vehicle."""
        mismatched = mismatch(self.autopilot, self.circumstances.model)
        return () if mismatched is None else (f"{clause_of(mismatched, 'flight_findings')}.",)

    @cached_property
    def alerts(self) -> tuple[Alert, ...]:
        """Reactions in the order in which they were called for."""
        names = autopilot_names()
        rows = np.flatnonzero(np.diff(self.alert, prepend=0) > 0)
        return tuple(
            Alert(
                float(self.t[row]), names["reactions"][self.alert[row]], names["watches"][self.cause[row] - 1]
            )
            for row in rows
        )

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """What went wrong with its causes, the gravest first; of a good flight what limits how good it is."""
        result = Result(self.outcome, self.outcome_in_words, self.metrics, self.legs, self.loops, self.alerts)
        return findings(self, result)

    @cached_property
    def legs(self) -> tuple[Leg, ...]:
        """What became of every leg, one per waypoint."""
        return legs_of(self)

    @cached_property
    def loops(self) -> dict[str, Loop]:
        """How the control loops did that were at work, by name."""
        return loops_of(self)

    @cached_property
    def actuator_use(self) -> dict[str, ActuatorUse]:
        """What was asked of every actuator, by name."""
        return actuators_of(self)

    def report(self, *, sections: Sequence[Section] = ()) -> Report:
        """How good the flight was, the worst problem, what to do next; then tables, sentences and further
        `sections`.
        """
        return report_of(self, sections=sections)

    def sentences(self) -> list[str]:
        """What happened, in sentences for a reader of a report."""
        return list(self.report().section("What happened").sentences)

    def to_dict(self) -> dict[str, Any]:
        """Metrics, legs, loops, actuators, reactions and circumstances as plain data, without the log."""
        return {
            "vehicle": self.vehicle.name,
            "autopilot": self.autopilot.name,
            "mission": self.route.name,
            "outcome": self.outcome,
            "complete": self.complete,
            "warnings": list(self.warnings),
            "metrics": dict(self.metrics),
            "legs": [leg.to_dict() for leg in self.legs],
            "loops": {name: loop.to_dict() for name, loop in self.loops.items()},
            "actuators": {name: use.to_dict() for name, use in self.actuator_use.items()},
            "alerts": [asdict(alert) for alert in self.alerts],
            "circumstances": self.circumstances.to_dict(),
            "findings": [finding.to_dict() for finding in self.findings],
            "sentences": self.sentences(),
        } | ({} if self.samples is None else {"payload": self.samples.to_dict()})

    def save(self, folder: str | Path, *, beside: Mapping[str, bytes] | None = None) -> Path:
        """Path of a run directory `folder` with the flight: JSON, Parquet, summary and inputs, and files
        `beside` it by name.

        The directory is made when it does not exist; an earlier run's is replaced. `plot` draws the figures.
        Raises SeatrialError where it cannot be written; nothing is left half-written.
        """
        with RunDirectory(folder) as run:
            return self.publish(run, beside=beside)

    def publish(self, run: RunDirectory, *, beside: Mapping[str, bytes] | None = None) -> Path:
        """As `save`, with files `beside` it by name, into a directory `run` that is held already."""
        files: dict[str, str | bytes] = {
            **{f"{name}.toml": text for name, text in _inputs(self).items()},
            "flight.json": to_json(self.to_dict()),
            **self.report().files(),
            "flight.parquet": parquet(self.table()),
            **_sampled(self),
            **(beside or {}),
        }
        return run.publish(_facts(self), files)


def _facts(flight: Flight) -> dict[str, Any]:
    """What a flight rests on: versions, machine, seed, hashes of the inputs."""
    return run_facts(
        "flight",
        flight.route.name,
        clock=flight.clock,
        inputs={name: sha256(text) for name, text in _inputs(flight).items()},
        seed=flight.circumstances.seed,
        options=flight.circumstances.to_dict(),
    )


def _inputs(flight: Flight) -> dict[str, str]:
    """Files of the inputs by name, as they were used."""
    texts = {
        "vehicle": flight.vehicle.to_toml(),
        "autopilot": flight.autopilot.to_toml(),
        "mission": flight.mission.to_toml(),
    }
    if flight.samples is not None:
        texts["payload"] = flight.samples.payload.text
    around = flight.circumstances
    models = {"model": around.model.to_toml()}
    if around.aboard is not None and (text := around.aboard.vehicle.to_toml()) != models["model"]:
        models["filter_model"] = text
    return texts | {name: text for name, text in models.items() if text != texts["vehicle"]}


def _sampled(flight: Flight) -> dict[str, bytes]:
    """Files of the samples by name."""
    if flight.samples is None:
        return {}
    table = flight.samples.table()
    return {"samples.parquet": parquet(table), "samples.csv": table.write_csv().encode()}


@takes(water=Water, conditions=Conditions)
def fly(
    vehicle: Vehicle | str | Path,
    autopilot: Autopilot | str | Path,
    mission: Mission | str | Path,
    *,
    water: Water = CALM,
    conditions: Conditions = PLAIN,
    seed: int = 0,
    payload: Payload | str | Path | None = None,
) -> Flight:
    """Flight of a vehicle with its autopilot on a mission: track, errors, commands, modes, energy, metrics.

    Once per control period the sensors are read and the autopilot steps; its commands hold until the next. A
    flight that diverges or is not complete is a result, never an error: see `Flight.outcome`.

    Parameters
    ----------
    vehicle : Vehicle, str or Path
        That flies: an object, a built-in name or a file.
    autopilot : Autopilot, str or Path
        The same of the autopilot.
    mission : Mission, str or Path
        The mission or its file.
    water : Water, optional
        Current, turbulence, waves, seabed, obstacles; still, deep and empty by default.
    conditions : Conditions, optional
        Sensors, navigation, failures, start and end; perfect sensors and no failure by default.
    seed : int, optional
        Of the sensors' errors and the water's motion; the same seed, the same flight.
    payload : Payload, str or Path, optional
        Water, plumes and the sensors that sample it, an object or a file; see `Flight.samples`.

    Raises
    ------
    VehicleError
        A file is not usable, or the autopilot does not fit the vehicle.
    SimulationError, TrialError
        A number, a failure or a sensor is not usable.

    Examples
    --------
    >>> import seatrial as st
    >>> mission = st.Mission.from_toml('''
    ... format = 1
    ... name = "out"
    ... speed_m_s = 1.5
    ... acceptance_radius_m = 5.0
    ... [[legs]]
    ... north_m = 100.0
    ... east_m = 0.0
    ... depth_m = 5.0
    ... ''')
    >>> flight = st.fly("cwolf", "cwolf", mission, water=st.Water(current=[0.0, 0.3, 0.0]))
    >>> flight.outcome, flight.legs[0].reached
    ('complete', True)
    """
    if conditions.initial is not None and not isinstance(conditions.initial, State):
        raise SimulationError(f"initial: expected an st.State, found {conditions.initial!r}")
    clock = Clock()
    if payload is not None and not isinstance(payload, Payload):
        payload = Payload.load(payload)
    # Of a batch of one: what a batch may have per case is refused here, in the words of a single flight.
    cases = Cases.of(
        vehicle,
        autopilot,
        mission,
        water=replace(
            water,
            current=checked_vector("current", water.current),
            turbulence=checked_turbulence(water.turbulence),
            current_trend=checked_vector("current_trend", water.current_trend),
            current_walk=checked_turbulence(water.current_walk, "current_walk"),
        ),
        conditions=replace(
            conditions,
            faults=checked_failures("faults", conditions.faults, Fault, per_case=False),
            outages=checked_failures("outages", conditions.outages, Outage, per_case=False),
        ),
        seeds=[checked_seed(seed)],
        logs=True,
    )
    if payload is not None:
        payload.check_current(cases.circumstances.current)
    flight = Flight.of_case(cases.fly(), cases)
    # The payload samples the water along the track afterwards: it has no effect on the flight.
    if payload is not None:
        flight = replace(flight, samples=sampled(payload, flight, cases.channels.errors))
    return replace(flight, clock=clock.stop())


@takes(water=Water, conditions=Conditions)
def fly_batch(
    vehicle: Vehicle | str | Path,
    autopilot: Autopilot | str | Path,
    mission: Mission | str | Path,
    *,
    water: Water = CALM,
    conditions: Conditions = PLAIN,
    coefficients: Mapping[str, ArrayLike] | None = None,
    gains: Mapping[str, ArrayLike] | None = None,
    seeds: int | Sequence[int] = 0,
    set_points: Mapping[str, ArrayLike] | None = None,
    corridors: Sequence[Corridor] = (),
    logs: bool = False,
    threads: int | None = None,
) -> Flights:
    """Flights of k cases of one mission, their metrics in SI and rad; on all threads, eight to a vector.

    What is given once holds for all cases; k is the length of whatever is given per case. A case flies as it
    would alone.

    Parameters
    ----------
    vehicle, autopilot, mission
        As for `seatrial.fly`.
    water : Water, optional
        As for `seatrial.fly`; its current, turbulence, trend, walk and waves for all cases or per case.
    conditions : Conditions, optional
        As for `seatrial.fly`; its faults, outages and start for all cases or per case.
    coefficients : mapping of str to (k,) array_like, optional
        Of the vehicle that flies, by name; the autopilot's model keeps its own.
    gains : mapping of str to (k,) array_like, optional
        Of the autopilot, by the names of `Autopilot.gains`.
    seeds : int or sequence of int, optional
        Of the sensors' errors and the water's motion; one for all cases lets them meet the same noise.
    set_points : mapping of str to array_like, optional
        A trial of the loops: ``times`` (s,), and from each of them on ``speed`` and ``lateral`` (m/s),
        ``heading`` and ``pitch`` (rad) or ``depth`` (m), (s,) or (k, s), in place of what guidance asks
        for; ``north``, ``east`` and ``down`` (m) move its plan instead.
    corridors : sequence of tuple, optional
        What the responses are held against, see `seatrial.tuning.step_trial`; sums in ``Flights.violations``.
    logs : bool, optional
        Whether to keep the logs, some megabytes an hour of flight and case.
    threads : int, optional
        All when omitted.

    Raises
    ------
    VehicleError
        A file or name is not usable.
    SimulationError, TrialError
        Lengths do not fit together, or a number, a failure or a sensor is not usable.

    Examples
    --------
    >>> import seatrial as st
    >>> text = '''
    ... format = 1
    ... name = "out"
    ... speed_m_s = 1.5
    ... acceptance_radius_m = 5.0
    ... [[legs]]
    ... north_m = 100.0
    ... east_m = 0.0
    ... depth_m = 5.0
    ... '''
    >>> lookahead = {"guidance.lookahead_m": [5.0, 10.0, 20.0]}
    >>> flights = st.fly_batch("cwolf", "cwolf", st.Mission.from_toml(text), gains=lookahead)
    >>> flights.figures["ending"]
    array([1., 1., 1.])
    """
    checked_threads(threads)
    cases = Cases.of(
        vehicle,
        autopilot,
        mission,
        water=water,
        conditions=conditions,
        coefficients=coefficients,
        gains=gains,
        seeds=seeds,
        set_points=set_points,
        corridors=corridors,
        logs=logs,
    )
    return cases.fly(threads=threads)


@dataclass(frozen=True, eq=False)
class Seeds(Plain, only="seeds endings metrics"):
    """Flights of one mission under many seeds: metrics by name and endings, a value per seed; the seeds of
    flights that came `too_near` to something, `touched` the bottom or went `off_limits`, deeper or nearer
    to the bottom than the mission allows; and what they did that every user calls a failure.
    """

    seeds: tuple[int, ...]
    metrics: Mapping[str, Array]
    endings: tuple[str, ...]
    too_near: tuple[int, ...] = ()
    touched: tuple[int, ...] = ()
    off_limits: tuple[int, ...] = ()
    excesses: tuple[Excess, ...] = ()

    @property
    def all_complete(self) -> bool:
        """Whether every flight came to the end of the mission and kept its distances and limits."""
        complete = all(ending == "complete" for ending in self.endings)
        return complete and not (self.too_near or self.touched or self.off_limits)

    def parquet(self) -> bytes:
        """Metrics and endings, a row per seed."""
        import polars as pl

        from seatrial.base.files import parquet

        columns: dict[str, Any] = {"seed": list(self.seeds), "ending": list(self.endings)}
        columns |= {name: values for name, values in self.metrics.items() if name not in CODED}
        return parquet(pl.DataFrame(columns))


def fly_seeds(
    vehicle: Vehicle | str | Path,
    autopilot: Autopilot | str | Path,
    mission: Mission | str | Path,
    *,
    count: int,
    first: int,
    water: Water,
    conditions: Conditions,
) -> Seeds:
    """Flights of `count` seeds from `first` on in the same water and conditions."""
    seeds = tuple(range(first, first + count))
    metrics = metrics_of(
        fly_batch(vehicle, autopilot, mission, seeds=list(seeds), water=water, conditions=conditions)
    )
    flown = loaded(Mission, mission)
    promised, limits = flown.promised_m, flown.limits
    near, down, low, deep = unkept(metrics, promised, limits).values()

    def which(mask: Mask) -> tuple[int, ...]:
        return tuple(seed for seed, one in zip(seeds, mask, strict=True) if one)

    return Seeds(
        seeds,
        metrics,
        tuple(ending_of(metrics, case) for case in range(count)),
        too_near=which(near),
        touched=which(down),
        off_limits=which(low | deep),
        excesses=tuple(
            excesses(
                metrics, promised, max_depth_m=limits["max_depth_m"], min_altitude_m=limits["min_altitude_m"]
            )
        ),
    )
