"""The verdict on a log: is the model still valid, what is suspected, and did the mission hold what it had to.

Beside it stands the envelope of flights of the same mission (`mission_envelope`).

A log on which nothing could have been noticed does not speak for the model: where a controlled axis is left
unjudged, or the errors exceed what noise and stated intervals explain, the verdict is "not judged": exit code
1, an outcome of its own in JSON, an error in JUnit. Held by ``test_recorded_verdict.py``,
``test_recorded_campaign.py`` and ``test_recorded_validity.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial._core import State
from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError
from seatrial.base.finding import Finding
from seatrial.base.frames import shorter
from seatrial.base.plain import Plain
from seatrial.base.report import Reported, writer_of
from seatrial.base.run import RunDirectory, run_facts, sha256, to_json
from seatrial.base.work import Clock
from seatrial.flight.conditions import Conditions, Water
from seatrial.flight.flight import fly_batch
from seatrial.flight.metrics import CODED, metrics_of
from seatrial.verification.mission_log.log import SETTINGS, errors_of_guidance
from seatrial.verification.mission_log.power import Power
from seatrial.verification.mission_log.validity import Validity

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Flights, Vehicle
    from seatrial.flight.mission import Mission
    from seatrial.identification.fitted import Fitted
    from seatrial.problem.problem import Problem
    from seatrial.verification.mission_log.log import LoggedStep, MissionLog
    from seatrial.verification.mission_log.suspects import Suspect
    from seatrial.verification.mission_log.validity import Contradiction

ModelState = Literal["model still valid", "re-identify", "log too short or too quiet to tell", "not judged"]
LogOutcome = Literal["held", "failed", "undecided", "not judged"]


@dataclass(frozen=True)
class JudgedRequirement:
    """A requirement on the log's own mission: whether it was held, and its reserve in `unit`.

    ``held`` is None where the log does not tell a metric that it needs; ``missing`` names those.
    """

    name: str
    holds: str
    held: bool | None
    reserve: float
    unit: str
    missing: tuple[str, ...] = ()

    @property
    def beyond_logs(self) -> bool:
        """Whether it needs the truth, which no log tells: it is none of the log's business."""
        return any(name.startswith("true_") for name in self.missing)


@dataclass(frozen=True, eq=False, repr=False)
class LogVerdict(
    Reported,
    Plain,
    only="log=log.trial.name outcome held model reason validity suspects contradictions power metrics"
    " requirements steps envelope current_m_s=current notes",
):
    """What a log says of the model and of the mission.

    `log`: what was judged. `model`: "model still valid", "re-identify", "log too short or too quiet to tell"
    where a doubt is left, or "not judged" where the log could not have refuted the model on every controlled
    axis. `cause`: why; ``reason`` says it in words. `validity`: share outside the 95 % band per channel; None
    where no window could be judged. `suspects`: what may have changed, the one that explains most first;
    empty where nothing fails. `power`: what this log would have shown of each group of coefficients, and what
    it refutes; None where no window could be judged. `metrics`: of the log's own mission, by the names of
    `Flight.metrics`. `requirements`, `steps`: requirements on them, and set-point steps against their
    corridors. `envelope`: of the mission in closed loop; None where it was not asked for. `contradictions`:
    channels of the log that tell of two motions: a sensor is wrong, and the model is not judged. `remarks`:
    what was not known; ``notes`` says it in sentences. `hidden`: channels that do not judge the model, since
    commands answer waves and noise on their axes. `current`: steady current north and east, m/s, that was
    fitted to a log which tells none; else None. `vehicle`, `autopilot`, `mission`: the model, and what was
    flown where that was given. `clock`: when it was judged, and how long that took.
    """

    log: MissionLog
    model: ModelState
    cause: Finding
    validity: Validity | None
    suspects: tuple[Suspect, ...]
    power: Power | None
    metrics: Mapping[str, Any]
    requirements: tuple[JudgedRequirement, ...]
    steps: tuple[LoggedStep, ...]
    envelope: Envelope | None
    remarks: tuple[Finding, ...]
    vehicle: Vehicle
    autopilot: Autopilot | None = None
    mission: Mission | None = None
    current: tuple[float, float] | None = None
    contradictions: tuple[Contradiction, ...] = ()
    hidden: tuple[str, ...] = ()
    clock: Clock = field(default_factory=Clock)

    @property
    def reason(self) -> str:
        """Why the model has its state, in words."""
        return str(writer_of(self).reason(self))

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on what was not known."""
        return tuple(writer_of(self).notes(self))

    @property
    def valid(self) -> bool:
        """Whether the log speaks for the model."""
        return self.model == "model still valid"

    @property
    def outcome(self) -> LogOutcome:
        """Of model and mission together.

        "failed" where the model is refuted or a requirement or corridor broken, "not judged" where the log
        could not have refuted the model, "undecided" where it leaves a doubt or tells no metric that a
        requirement needs, otherwise "held". Requirements on the truth (``true_...``) do not count.
        """
        broken = any(requirement.held is False for requirement in self.requirements)
        if self.model == "re-identify" or broken or any(step.criterion > 0.0 for step in self.steps):
            return "failed"
        if self.model == "not judged":
            return "not judged"
        known = all(asked.held is not None or asked.beyond_logs for asked in self.requirements)
        return "held" if self.valid and known else "undecided"

    @property
    def held(self) -> bool:
        """Whether the outcome is "held": what was not shown does not pass."""
        return self.outcome == "held"

    def junit(self) -> str:
        """JUnit XML with a case for the model, and one per requirement and step of a set point."""
        return str(writer_of(self).junit(self))

    def inputs(self) -> dict[str, str]:
        """Text of the files that were judged with, by name: vehicle, autopilot, mission."""
        found = {"vehicle.toml": self.vehicle.to_toml()}
        if self.autopilot is not None:
            found["autopilot.toml"] = self.autopilot.to_toml()
        if self.mission is not None:
            found["mission.toml"] = self.mission.to_toml()
        return found

    def save(self, folder: str | Path, *, problem: Problem | None = None, source: str | Path = "") -> Path:
        """Path of a run directory with the verdict, a summary, the inputs and their hashes.

        `plot` draws its figures.

        `folder`: made when it does not exist; an earlier run's is replaced. `problem`: that of the campaign,
        where one judged. `source`: the log, as it was named; by default the name of its trial. Raises
        SeatrialError: the directory cannot be written; nothing is left half-written.
        """
        facts = _facts(self, problem, source or self.log.trial.name)
        with RunDirectory(folder) as run:
            return run.publish(facts, _files(self, problem))


def _files(found: LogVerdict, problem: Problem | None) -> dict[str, str | bytes]:
    """Files of a run directory by name."""
    return {
        **_inputs(found, problem),
        "verdict.json": to_json(found.to_dict()),
        "junit.xml": found.junit(),
        **found.report().files(),
    }


def _facts(found: LogVerdict, problem: Problem | None, source: str | Path) -> dict[str, Any]:
    """What the verdict rests on."""
    hashes = {} if problem is None else problem.input_hashes(trials=False)
    hashes |= {name: sha256(text) for name, text in _inputs(found, problem).items()}
    if (log := _file(source)) is not None:
        hashes["log"] = sha256(log.read_bytes())
    kind: Final = "log verdict"
    return run_facts(
        kind,
        found.log.trial.name if problem is None else problem.name,
        clock=found.clock,
        inputs=hashes,
        seed=None if problem is None else problem.seed,
        options={"log": str(source)},
    )


def _inputs(found: LogVerdict, problem: Problem | None) -> dict[str, str]:
    return found.inputs() if problem is None else {"campaign.toml": problem.text, **found.inputs()}


def _file(source: str | Path) -> Path | None:
    path = Path(source)
    path = path / "flight.parquet" if path.is_dir() else path
    return path if path.is_file() else None


QUANTITIES: Mapping[str, tuple[str, str]] = {
    "depth": ("depth", "m"),
    "speed": ("speed", "m/s"),
    "pitch": ("pitch", "rad"),
    "cross_track": ("cross-track error", "m"),
    "heading": ("heading error", "rad"),
}
"""Words and SI unit of every quantity of an envelope."""


@dataclass(frozen=True, eq=False)
class Band:
    """One quantity: 2.5 %, 50 % and 97.5 % over the flights and the log, all (n,), SI.

    ``outside`` is the share of the log's samples outside the band.
    """

    lower: Array
    middle: Array
    upper: Array
    log: Array
    outside: float

    @property
    def is_outside(self) -> NDArray[np.bool_]:
        """Samples of the log outside the band, (n,)."""
        with np.errstate(invalid="ignore"):
            return np.asarray((self.log < self.lower) | (self.log > self.upper))


@dataclass(frozen=True, eq=False)
class Envelope:
    """Envelope of a mission with the log in it.

    `t`: times since the start of the log, (n,), s. `bands`: a `Band` by the name of the quantity, see
    `QUANTITIES`. `flights`: how many flights it rests on. `metrics`: metrics of the flights, (k,) each, by
    the names of `Flight.metrics`.
    """

    t: Array
    bands: Mapping[str, Band]
    flights: int
    metrics: Mapping[str, Array]

    def to_dict(self) -> dict[str, Any]:
        """Share outside by quantity, and quantiles of the metrics, as plain data."""
        return {
            "flights": self.flights,
            "outside": {name: band.outside for name, band in self.bands.items()},
            "metrics": {
                name: [float(x) for x in prediction_band(values)]
                for name, values in self.metrics.items()
                if np.isfinite(values).any()
            },
        }


def prediction_band(values: Array) -> Array:
    """Values (3, ...) between the outer two of which a further one of k falls with 95 %, and their median.

    The ranks 0.025 (k + 1) and 0.975 (k + 1) (Weibull 1939; Hyndman & Fan 1996, The American Statistician
    50:361, definition 6) exist from 39 flights on. `values` (k, ...); nan where a flight has none.
    """
    # Median and ends of the middle 95 %.
    return np.asarray(np.nanquantile(values, (0.025, 0.5, 0.975), axis=0, method="weibull"))


def mission_envelope(
    fitted: Fitted,
    log: MissionLog,
    autopilot: Autopilot,
    mission: Mission,
    *,
    flights: int = 64,
    seed: int = 0,
    sensors: Any = None,
    current: ArrayLike | None = None,
) -> Envelope:
    """Envelope of a mission with the log in it.

    The mission is flown k times in closed loop, each time with coefficients drawn from their covariance,
    other noise of the sensors and, where given, another current; `prediction_band` is taken over the flights
    at the same time since the start.

    `fitted`: the vehicle and how well it is known. `mission`: what was flown. `flights`: how many flights, at
    least 39; of some more, a few may end before the log does. `sensors`: as for `seatrial.fly`. `current`:
    north, east, down, m/s; the mean of the recorded one when omitted, as always of the supply. Raises
    SimulationError: too few flights, or too many of them diverged.
    """
    if flights < SETTINGS.fewest_flights:
        raise SimulationError(
            f"flights: expected at least {SETTINGS.fewest_flights} for a band of 95 %, found {flights};"
            " fly more"
        )
    trial = log.trial
    if current is None:
        current = np.zeros(3) if trial.current is None else np.nanmean(trial.current, axis=0)
    voltage_v = None if trial.voltage_v is None else float(np.nanmean(trial.voltage_v))
    # The flights start where the log can: in its smoothed state, its water and its supply.
    first = int(np.flatnonzero(trial.startable)[0]) if trial.startable.any() else 0
    drawn = fitted.draws(flights, seed) if fitted.names else None
    flown = fly_batch(
        fitted.vehicle,
        autopilot,
        mission,
        coefficients=drawn,
        conditions=Conditions(
            model=fitted.vehicle, sensors=sensors, initial=State(*trial.state(first)), voltage_v=voltage_v
        ),
        water=Water(current=current, rho=trial.rho, g=trial.g),
        seeds=[seed + 1 + k for k in range(flights)],
        logs=True,
    )
    t = trial.t - trial.t[first]
    t = t[t >= 0.0]
    shown = [_quantities(flown, case, t) for case in range(flights)]
    recorded = _recorded(log, mission, first)
    bands = {}
    for name in QUANTITIES:
        if name not in recorded:
            continue
        stack = np.stack([flight[name] for flight in shown])
        # A band stands where enough flights are still under way.
        enough = np.isfinite(stack).sum(axis=0) >= SETTINGS.fewest_flights
        lower, middle, upper = np.full((3, len(t)), np.nan)
        if enough.any():
            lower[enough], middle[enough], upper[enough] = prediction_band(stack[:, enough])
        band = Band(lower, middle, upper, recorded[name], float("nan"))
        seen = np.isfinite(lower) & np.isfinite(band.log)
        if seen.any():
            band = replace(band, outside=float(band.is_outside[seen].mean()))
        bands[name] = band
    if not any(np.isfinite(band.middle).any() for band in bands.values()):
        raise SimulationError(
            f"{fitted.vehicle.name}: fewer than {SETTINGS.fewest_flights} of {flights} flights of"
            f" {mission.name} did not diverge; check the autopilot and the covariance of the coefficients, or"
            " fly more"
        )
    metrics = {name: value for name, value in metrics_of(flown).items() if name not in CODED}
    return Envelope(t, bands, flights, metrics)


def _quantities(flown: Flights, case: int, t: Array) -> dict[str, Array]:
    """Quantities of a flight at times (n,), nan after its end; angles without jumps."""
    columns = dict(zip(flown.columns, np.asarray(flown.log(case)).T, strict=True))
    own = np.asarray(flown.t(case))
    rows = np.searchsorted(own, t + 1e-6, side="right") - 1
    over = t > own[-1] + 1e-6

    def held(values: Array) -> Array:
        return np.where(over, np.nan, values[np.clip(rows, 0, len(own) - 1)])

    return {
        "depth": held(columns["measured_z"]),
        "speed": held(columns["measured_u"]),
        "pitch": held(columns["measured_pitch"]),
        "cross_track": held(columns["cross_track"]),
        "heading": shorter(held(columns["desired_heading"] - columns["measured_yaw"])),
    }


def _recorded(log: MissionLog, mission: Mission, first: int) -> dict[str, Array]:
    columns = {
        name: log.trial.channel(channel)
        for name, channel in (("depth", "z"), ("speed", "u"), ("pitch", "pitch"))
        if channel in log.trial.channels
    }
    errors = errors_of_guidance(log, mission)
    columns |= {name: errors[name] for name in ("cross_track", "heading") if name in errors}
    return {name: values[first:] for name, values in columns.items()}
