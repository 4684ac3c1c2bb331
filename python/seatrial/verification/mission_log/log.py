"""The log of a mission as a trial with what guidance wanted, and the envelope of flights about it.

No sea trial knows the truth: a log that `seatrial fly` wrote is read by what the autopilot was told
(``measured.…``), at the sea's surface. Held by ``test_recorded_mission.py``, ``test_recorded_campaign.py``
and ``test_recorded_validity.py`` in ``tests/verification/``.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial._core import State
from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import CHANNELS
from seatrial.base.errors import SimulationError, TrialError
from seatrial.base.frames import shorter
from seatrial.flight.mission import Route
from seatrial.flight.sensor_channels import sensor_channels, sensors_of
from seatrial.trial.columns import columns_of, parse
from seatrial.trial.recording import read_table
from seatrial.trial.trial import Trial

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Flights, Vehicle
    from seatrial.flight.mission import Mission
    from seatrial.identification.fitted import Fitted


@dataclass(frozen=True)
class MissionLogSettings:
    """How a log is read, thinned and set against the flights of its envelope."""

    #: Depth of the sea's surface in flights, m (docs/theory/surface.md).
    flown_surface_m: float = 0.0
    #: Ratio of two intervals below which they are the same up to rounding to whole samples.
    thinning_ratio: float = 1.5
    #: Of fewer flights, no rank leaves 2.5 % on either side.
    fewest_flights: int = 39


SETTINGS = MissionLogSettings()


_BESIDE = {
    "desired.speed_m_s": ("speed", 1.0),
    "desired.lateral_m_s": ("lateral", 1.0),
    "desired.heading_deg": ("heading", math.pi / 180.0),
    "desired.pitch_deg": ("pitch", math.pi / 180.0),
    "desired.depth_m": ("depth", 1.0),
    "error.cross_track_m": ("cross_track", 1.0),
    "error.vertical_m": ("vertical", 1.0),
    "leg": ("leg", 1.0),
    "distance_m": ("distance", 1.0),
    "reaction": ("reaction", 1.0),
    "power_w": ("power", 1.0),
    "energy_wh": ("energy_wh", 1.0),
    "altitude_m": ("altitude", 1.0),
}

_MEASURED = "measured."


@dataclass(frozen=True, eq=False)
class MissionLog:
    """A trial, and what guidance wanted meanwhile.

    Attributes
    ----------
    trial
        The log as a trial.
    beside
        speed, lateral, heading, pitch, depth (desired); cross_track, vertical; leg, distance, reaction,
        power, energy_wh, altitude: those that were logged, (n,) on the trial's times, SI and rad.
    """

    trial: Trial
    beside: Mapping[str, Array]

    @classmethod
    def of(cls, trial: Trial) -> MissionLog:
        """Log of a trial that tells nothing of guidance."""
        return cls(trial, {})

    @classmethod
    def read(
        cls, source: Any, *, columns: Mapping[str, Any] | None = None, name: str | None = None, **options: Any
    ) -> MissionLog:
        """Log from a file, a frame, or a run directory of `seatrial fly`.

        Parameters
        ----------
        source
            CSV or Parquet file, frame, or folder with ``flight.parquet``.
        columns
            Map of columns as for `Trial.read`; canonical names need no entry.
        name
            What to call it.
        options
            Further keywords of `Trial.read`.

        Raises
        ------
        TrialError
            The log cannot be read.

        Examples
        --------
        >>> import seatrial as st
        >>> mission = st.Mission.from_toml('''
        ... format = 1
        ... name = "out"
        ... speed_m_s = 1.5
        ... acceptance_radius_m = 5.0
        ... [[legs]]
        ... north_m = 60.0
        ... east_m = 0.0
        ... depth_m = 5.0
        ... ''')
        >>> typical = st.Conditions(sensors="typical")
        >>> log = MissionLog.read(st.fly("cwolf", "cwolf", mission, conditions=typical).table())
        >>> sorted(log.beside)[:3]
        ['cross_track', 'depth', 'distance']
        """
        if isinstance(source, str | Path) and Path(source).is_dir():
            folder = Path(source)
            source = folder / "flight.parquet"
            if not source.exists():
                raise TrialError(
                    f"{folder}: expected flight.parquet, as `seatrial fly --out` writes it, found none;"
                    " give the log's file"
                )
            name = name or folder.name
            options.setdefault("surface", SETTINGS.flown_surface_m)
        read = read_table(source, options.pop("reader", None), columns_of(columns))
        table, file = read.table, read.file
        told = {c.removeprefix(_MEASURED): c for c in table.columns if c.startswith(_MEASURED)}
        told.pop("altitude_m", None)
        if told:  # the table of a flight
            options.setdefault("surface", SETTINGS.flown_surface_m)
        mapped: dict[str, Any] = dict(told) | dict(columns or {})
        if told and any(column in table.columns for column in told):
            table = table.drop([column for column in told if column in table.columns])
        read.refuse_twice(source.column for source in parse(mapped, table.columns, file).values())
        try:
            trial = Trial.read(table, columns=mapped or None, name=name or Path(file).stem, **options)
        except TrialError as error:  # the table was read before, so that the trial knows it as a frame
            what = str(error)
            raise TrialError(f"{file}:{what[6:]}" if what.startswith("frame:") else what) from None
        times = _numbers(table, _time_column(mapped))
        beside = {}
        for column, (key, scale) in _BESIDE.items():
            values = _numbers(table, column) if column in table.columns else np.zeros(0)
            if len(values) and np.isfinite(values).any():
                beside[key] = scale * _held(trial.t, times, values)
        return cls(trial, beside)


def _time_column(columns: Mapping[str, Any]) -> str:
    given = columns.get("t_s", "t_s")
    return str(given["from"] if isinstance(given, Mapping) else given)


def _numbers(table: Any, column: str) -> Array:
    """Column as numbers, nan where it is none."""
    import polars as pl

    if column not in table.columns:
        return np.zeros(0)
    return np.asarray(table[column].cast(pl.Float64, strict=False).fill_null(float("nan")).to_numpy(), float)


def _held(t: Array, times: Array, values: Array) -> Array:
    """Values as they stood at times (n,): zero-order hold."""
    if len(times) != len(values):
        return np.full(len(t), np.nan)
    rows = np.clip(np.searchsorted(times, t + 1e-6, side="right") - 1, 0, len(values) - 1)
    return np.asarray(values[rows])


class Progress:
    """Leg (n,), horizontal distance (n,) to its waypoint in m, and whether all was done (n,)."""

    def __init__(self, log: MissionLog, mission: Mission) -> None:
        path = Route.of(mission)
        n = len(log.trial)
        last = len(path.stops) - 1
        self.done = np.zeros(n, dtype=bool)
        if "leg" in log.beside and np.isfinite(log.beside["leg"]).all():
            self.leg = np.clip(log.beside["leg"].astype(int), 0, last)
        else:
            self.leg = self._followed(log, mission, path)
        stops = np.array([stop.position for stop in path.stops])
        away = log.trial.position - stops[self.leg]
        self.distance = np.asarray(np.hypot(away[:, 0], away[:, 1]))
        if "distance" in log.beside:
            self.distance = log.beside["distance"]
        # The autopilot stops logging the moment it is there, which may lie between two samples.
        step = 3.0 * log.trial.dt * np.linalg.norm(log.trial.nu[:, :3], axis=1).max(initial=0.0)
        final = (self.leg == last) & (self.distance <= path.stops[last].acceptance + step)
        self.done |= np.cumsum(final) > 0

    def _followed(self, log: MissionLog, mission: Mission, path: Route) -> NDArray[np.int64]:
        """Leg of every sample by the waypoints that the vehicle came to."""
        hold = np.asarray(mission.waypoints["hold_s"], dtype=float)
        leg = np.zeros(len(log.trial), dtype=np.int64)
        row = 0
        for k in range(len(path.stops)):
            leg[row:] = k
            # A circle ends where the vehicle comes to the waypoint after it.
            aim = k + 1 if path.stops[k].task == "circle" and k + 1 < len(path.stops) else k
            hits = np.flatnonzero(self._inside(log, path, aim)[row:])
            if not len(hits):
                break
            row += int(hits[0]) + round(float(np.nan_to_num(hold[k])) / log.trial.dt)
            if row >= len(leg) - 1:
                break
        return leg

    @staticmethod
    def _inside(log: MissionLog, path: Route, k: int) -> Mask:
        stop = path.stops[k]
        away = log.trial.position - stop.position
        below = 0.0 if stop.vertical == "altitude" else away[:, 2]
        return np.asarray(np.sqrt(away[:, 0] ** 2 + away[:, 1] ** 2 + below**2) <= stop.acceptance)


def errors_of_guidance(log: MissionLog, mission: Mission | None = None) -> dict[str, Array]:
    """Errors over the log: cross_track, vertical in m, heading in rad; those that can be told, (n,).

    The mission gives cross-track and vertical error where the log does not tell them: a leg lasts until its
    waypoint's radius of acceptance is entered (and its time of keeping station is over), the cross-track
    error is the distance from the straight line of the leg, positive to starboard.
    """
    logged = {name: log.beside[name] for name in ("cross_track", "vertical") if name in log.beside}
    if "heading" in log.beside and "yaw" in log.trial.channels:
        logged["heading"] = shorter(log.beside["heading"] - log.trial.channel("yaw"))
    if mission is not None and "cross_track" not in logged and {"x", "y"} <= set(log.trial.channels):
        path, progress = Route.of(mission), Progress(log, mission)
        begin = np.array([path.before(k) for k in range(len(path.stops))])[progress.leg]
        end = np.array([stop.position for stop in path.stops])[progress.leg]
        along = end - begin
        length = np.hypot(along[:, 0], along[:, 1])
        away = log.trial.position - begin
        safe = np.maximum(length, 1e-9)
        logged["cross_track"] = np.where(
            length > 0.0, (along[:, 0] * away[:, 1] - along[:, 1] * away[:, 0]) / safe, 0.0
        )
        part = np.clip((along[:, 0] * away[:, 0] + along[:, 1] * away[:, 1]) / safe**2, 0.0, 1.0)
        if "z" in log.trial.channels:
            logged["vertical"] = away[:, 2] - part * along[:, 2]
    return logged


def thinned(trial: Trial, dt: float) -> Trial:
    """Trial with every n-th of its samples, as far apart as `dt`, s; itself where it is no faster.

    Commands between two samples are not known and count as held, and smoothed states err more: a model that
    holds misses a slow log further than a fast one, so that a reference is thinned to the rate of the log.
    """
    if dt < SETTINGS.thinning_ratio * trial.dt:
        return trial
    every, count = round(dt / trial.dt), len(trial)

    def of(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: of(one) for name, one in value.items()}
        return value[::every] if isinstance(value, np.ndarray) and len(value) == count else value

    kept = {one.name: of(getattr(trial, one.name)) for one in dataclasses.fields(trial)}
    return type(trial)(**kept)


_IN_CORE = ("x", "y", "z", "roll", "pitch", "yaw", "u", "v", "w", "p", "q", "r")


def offsets_of(sensors: Any, vehicle: Vehicle) -> dict[str, float]:
    """Standard deviation of the offset of each channel, SI, by a set of sensors as for `seatrial.fly`.

    An offset starts every window of a log with the same wrong state; no number of windows averages it out, so
    that it belongs to the band like a coefficient that is not known exactly.

    Examples
    --------
    >>> import seatrial as st
    >>> sorted(offsets_of("typical", st.Vehicle.load("cwolf")))[:3]
    ['p', 'pitch', 'q']
    """
    fitted = sensors_of(sensors, vehicle)
    offset_column = 1  # of the core's table of sensor errors
    errors = sensor_channels(fitted, 0.1).errors[: len(_IN_CORE), offset_column]
    found = dict(zip(_IN_CORE, (float(x) for x in errors), strict=True))
    # An offset of the position moves start and path alike.
    return {name: found[name] for name in CHANNELS if found[name] > 0.0 and name not in ("x", "y", "z")}


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
    voltage_v: float | None = None,
) -> Envelope:
    """Envelope of a mission with the log in it.

    The mission is flown k times in closed loop, each time with coefficients drawn from their covariance,
    other noise of the sensors and, where given, another current; `prediction_band` is taken over the flights
    at the same time since the start.

    `fitted`: the vehicle and how well it is known. `mission`: what was flown. `flights`: how many flights, at
    least 39; of some more, a few may end before the log does. `sensors`: as for `seatrial.fly`. `current`:
    north, east, down, m/s; the mean of the recorded one when omitted. `voltage_v`: supply, V; the mean of the
    recorded one when omitted. Raises SimulationError: too few flights, or too many of them diverged.
    """
    from seatrial.flight.conditions import Conditions, Water
    from seatrial.flight.fly import fly_batch
    from seatrial.flight.metrics import CODED, metrics_of

    if flights < SETTINGS.fewest_flights:
        raise SimulationError(
            f"flights: expected at least {SETTINGS.fewest_flights} for a band of 95 %, found {flights};"
            " fly more"
        )
    trial = log.trial
    if current is None:
        current = np.zeros(3) if trial.current is None else np.nanmean(trial.current, axis=0)
    if voltage_v is None and trial.voltage_v is not None:
        voltage_v = float(np.nanmean(trial.voltage_v))
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
        enough = np.isfinite(stack).sum(axis=0) >= SETTINGS.fewest_flights
        lower, middle, upper = np.full((3, len(t)), np.nan)
        if enough.any():
            lower[enough], middle[enough], upper[enough] = prediction_band(stack[:, enough])
        band = Band(lower, middle, upper, recorded[name], 0.0)
        seen = np.isfinite(lower) & np.isfinite(band.log)
        share = float(band.is_outside[seen].mean()) if seen.any() else float("nan")
        bands[name] = Band(lower, middle, upper, band.log, share)
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
