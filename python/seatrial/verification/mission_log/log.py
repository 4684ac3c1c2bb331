"""The log of a mission as a trial with what guidance wanted, its metrics, and its steps of set points.

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
from numpy.typing import NDArray

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import CHANNELS
from seatrial.base.errors import TrialError
from seatrial.base.frames import shorter
from seatrial.flight.mission import Route
from seatrial.flight.sensor_channels import sensor_channels, sensors_of
from seatrial.trial.columns import columns_of, parse
from seatrial.trial.recording import read_table
from seatrial.trial.trial import Trial

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.flight.mission import Mission
from collections.abc import Sequence

from seatrial.base.errors import CampaignError, nearest
from seatrial.base.plain import Plain
from seatrial.flight.metrics import reserve, switches

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.control_design.corridor import Corridor
    from seatrial.flight.mission import Mission
    from seatrial.verification.table import Obstacle


@dataclass(frozen=True)
class MissionLogSettings:
    """How a log is read, thinned and set against the flights of its envelope."""

    flown_surface_m: float = 0.0  #: Depth of the sea's surface in flights, m (docs/theory/surface.md).
    #: Ratio of two intervals below which they are the same up to rounding to whole samples.
    thinning_ratio: float = 1.5
    fewest_flights: int = 39  #: Of fewer flights, no rank leaves 2.5 % on either side.


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

    `trial`: the log as a trial. `beside`: speed, lateral, heading, pitch, depth (desired); cross_track,
    vertical; leg, distance, reaction, power, energy_wh, altitude: those that were logged, (n,) on the trial's
    times, SI and rad.
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
        ... legs = [{ north_m = 60.0, east_m = 0.0, depth_m = 5.0 }]
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
    """
    fitted = sensors_of(sensors, vehicle)
    offset_column = 1  # of the core's table of sensor errors
    errors = sensor_channels(fitted, 0.1).errors[: len(_IN_CORE), offset_column]
    found = dict(zip(_IN_CORE, (float(x) for x in errors), strict=True))
    # An offset of the position moves start and path alike.
    return {name: found[name] for name in CHANNELS if found[name] > 0.0 and name not in ("x", "y", "z")}


_REACTIONS = {2: "surfaced", 3: "aborted"}
_SHARES = {"p50": 0.50, "p95": 0.95, "p99": 0.99}


def log_metrics(
    log: MissionLog,
    mission: Mission | None = None,
    vehicle: Vehicle | None = None,
    *,
    obstacles: Sequence[Obstacle] | None = None,
) -> dict[str, Any]:
    """Metrics of a recorded mission by the names of `Flight.metrics`, units in the names.

    Errors of guidance count on the second half of straight legs (`seatrial.flight.metrics`). Positions are
    those that were measured: the truth of a sea trial is not known.

    `mission`: without it there are no metrics of guidance, but those that the log itself tells. `vehicle`:
    gives the neutral command of the actuators. `obstacles`: what stands in the water besides the mission's
    own.
    """
    trial = log.trial
    here = set(trial.channels)
    found: dict[str, Any] = {"duration_s": float(trial.t[-1] - trial.t[0])}
    if {"x", "y", "z"} <= here:
        # Positions once a second: the noise of a fast sensor is no way that was gone.
        positions = trial.position[:: max(1, round(1.0 / trial.dt))]
        found["distance_m"] = float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
    if "energy_wh" in log.beside:
        found["energy_wh"] = float(np.nanmax(log.beside["energy_wh"]) - log.beside["energy_wh"][0])
    elif "power" in log.beside:
        found["energy_wh"] = float(np.nansum(log.beside["power"][:-1]) * trial.dt / 3600.0)
    if "z" in here:
        found["depth_largest_m"] = float(np.nanmax(trial.channel("z")))
        found["depth_smallest_m"] = float(np.nanmin(trial.channel("z")))
    altitude = log.beside.get("altitude")
    if altitude is not None and np.isfinite(altitude).any():
        found["altitude_smallest_m"] = float(np.nanmin(altitude))
    for name in ("roll", "pitch"):
        if name in here:
            found[f"{name}_largest_deg"] = math.degrees(float(np.nanmax(np.abs(trial.channel(name)))))
    if trial.commands:
        facts = {} if vehicle is None else vehicle.actuator_info()
        turns = [
            switches(signal - float(facts.get(name, {}).get("neutral", 0.0)))
            for name, signal in trial.commands.items()
        ]
        found["switches_per_minute"] = 60.0 * float(np.mean(turns)) / max(found["duration_s"], 1e-9)
    if mission is not None and {"x", "y"} <= here:
        found |= _of_guidance(log, mission) | _clearance(log, mission, vehicle, obstacles)
    return found


def quantiles(error: Array, name: str) -> dict[str, float]:
    """Largest, rms and quantiles of the magnitude of an error (n,), m, by the names of a flight."""
    size = np.abs(error[np.isfinite(error)])
    if not len(size):
        return {}
    found = {f"{name}_largest_m": float(size.max()), f"{name}_rms_m": float(np.sqrt(np.mean(size**2)))}
    return found | {f"{name}_{key}_m": float(np.quantile(size, share)) for key, share in _SHARES.items()}


def _of_guidance(log: MissionLog, mission: Mission) -> dict[str, Any]:
    path, progress = Route.of(mission), Progress(log, mission)
    errors = errors_of_guidance(log, mission)
    reaction = np.nan_to_num(log.beside.get("reaction", np.zeros(len(log.trial))))
    half = np.array([
        0.0 if stop.task == "circle" else 0.5 * path.length(k) for k, stop in enumerate(path.stops)
    ])
    holds = np.array([stop.task == "hold" for stop in path.stops])
    accepted = np.array([stop.acceptance for stop in path.stops])
    keeping = holds[progress.leg] & (progress.distance <= accepted[progress.leg])
    under_way = (reaction == 0) & ~progress.done
    settled = under_way & ~keeping & (progress.distance < half[progress.leg])
    found: dict[str, Any] = {}
    for name in ("cross_track", "vertical"):
        if name in errors:
            found |= quantiles(errors[name][settled], name)
    if "z" in log.trial.channels:
        found["depth_excursion_m"] = _excursion(log, path, progress, under_way)
    reached = int(progress.leg[-1]) + int(bool(progress.done.any()))
    found["waypoints_behind"] = float(reached)
    arrived = "complete" if reached == len(path.stops) else "out of time"
    found["ending"] = _REACTIONS.get(int(reaction.max()), arrived)
    found["abort"] = found["ending"] == "aborted"
    return found


def _clearance(
    log: MissionLog, mission: Mission, vehicle: Vehicle | None, given: Sequence[Obstacle] | None
) -> dict[str, float]:
    """Smallest distance of the hull at the measured positions from what stands in the water, m."""
    from seatrial.verification.requirement import obstacles

    trial = log.trial
    columns = [
        trial.channel(name) if name in trial.channels else np.zeros(len(trial.t))
        for name in ("x", "y", "z", "roll", "pitch", "yaw")
    ]
    pose = np.stack(columns, axis=1)
    told = np.isfinite(pose).all(axis=1)
    if not told.any():
        return {"clearance_m": float("inf")}
    hull = vehicle if "yaw" in trial.channels else None  # else nobody knows how it lies
    away = mission.core.clearance(hull, pose[told, :3], pose[told, 3:], obstacles=obstacles(given or ()))
    nearest = int(np.argmin(away[:, 0]))
    return {
        "clearance_m": float(away[nearest, 0]),
        "clearance_time_s": float(trial.t[told][nearest]),
        "clearance_reserve_m": float(np.min(reserve(away[:, 0], away[:, 1]))),
    }


def _excursion(log: MissionLog, path: Route, progress: Progress, under_way: Mask) -> float:
    """How far the vehicle left the band between the depths of a leg's two ends, m.

    Behind the start of a leg, where the vehicle still turns onto it, the depths of the leg before count too.
    """
    count = len(path.stops)
    start = np.array([path.before(k) for k in range(count)])
    end = np.array([stop.position for stop in path.stops])
    band = np.sort(np.stack([start[:, 2], end[:, 2]], axis=1), axis=1)
    band[[path.follows_bottom(k) for k in range(count)]] = -np.inf, np.inf
    last = band[np.maximum(np.arange(count) - 1, 0)]
    entry = np.stack([np.minimum(band, last)[:, 0], np.maximum(band, last)[:, 1]], axis=1)
    leg, position = progress.leg, log.trial.position
    along = np.sum((position - start[leg])[:, :2] * (end - start)[leg, :2], axis=1)
    allowed = np.where((along < 0.0)[:, None], entry[leg], band[leg])
    out = np.maximum(position[:, 2] - allowed[:, 1], allowed[:, 0] - position[:, 2])[under_way]
    return float(max(np.nanmax(out, initial=0.0), 0.0))


_LOOPS = {
    "surge": ("speed", "u", 0.1),
    "sway": ("lateral", "v", 0.1),
    "heave": ("depth", "z", 0.3),
    "depth": ("depth", "z", 0.3),
    "pitch": ("pitch", "pitch", math.radians(3.0)),
    "heading": ("heading", "yaw", math.radians(5.0)),
}


@dataclass(frozen=True)
class LogMetricsSettings:
    """Which set points of a log count as steps."""

    ramp_share: float = 0.25  #: Share of a corridor: a set point that moves for longer is no step.
    rounding: float = 1e-6  #: Largest change of a set point that stands still.


STEP_SETTINGS = LogMetricsSettings()


@dataclass(frozen=True)
class LoggedStep(Plain):
    """A step of a set point in a log: loop, time in s, set points in SI, the corridor's criterion.

    ``criterion`` is the weighted area outside the corridor in s, zero where the response stayed inside.
    """

    loop: str
    at_s: float
    before: float
    after: float
    criterion: float


def logged_steps(log: MissionLog, corridors: Mapping[str, Corridor]) -> tuple[LoggedStep, ...]:
    """Steps of the logged set points whose response the log holds until the corridor ends.

    A step is a change of a set point that stood before and stands after it. An autopilot ramps its set
    points: a change in one direction that is over within a quarter of the corridor is a step from where it
    begins, so that the corridor counts the ramp as well. The response is the smoothed channel as a share of
    the step: one corridor judges a step at sea as it judged the simulated one, whose truth has no noise.

    `corridors`: by loop: surge, sway, heave, depth, pitch, heading. Raises CampaignError where there is no
    such loop.
    """
    from seatrial.tuning.criterion import criterion, normalised

    found = []
    for loop, corridor in corridors.items():
        if loop not in _LOOPS:
            raise CampaignError(f'corridors: there is no loop "{loop}"{nearest(loop, _LOOPS)}')
        key, channel, least = _LOOPS[loop]
        if key not in log.beside or channel not in log.trial.channels:
            continue
        t, dt = log.trial.t, log.trial.dt
        wanted, done = log.beside[key], _smoothed_set_point(log, channel)
        # A set point that stands for 5 s before it moves begins a step.
        stand, length = round(5.0 / dt), round(corridor.until_s / dt)
        for stood, last in _ramps(wanted, key, round(STEP_SETTINGS.ramp_share * corridor.until_s / dt)):
            first = stood + 1
            after = slice(first, first + length + 1)
            if first < stand or first + length >= len(t):
                continue
            before, value = wanted[stood], wanted[last]
            size = float(_apart(np.array([value]), before, key)[0])
            quiet = np.abs(_apart(wanted[first - stand : first], before, key)).max()
            stays = np.abs(_apart(wanted[last : first + length + 1], value, key)).max()
            if abs(size) <= least or max(quiet, stays) > 0.1 * least or not np.isfinite(done[after]).all():
                continue
            y = normalised(_apart(done[after], before, key), 0.0, size)
            q = float(criterion(dt * np.arange(length + 1), y, corridor))
            found.append(LoggedStep(loop, float(t[first]), float(before), float(before) + size, q))
    return tuple(sorted(found, key=lambda step: step.at_s))


def _ramps(wanted: Array, key: str, longest: int) -> list[tuple[int, int]]:
    """First and last sample of every change in one direction that is no longer than so many samples."""
    change = _apart(wanted[1:], wanted[:-1], key)
    direction = np.where(
        np.isfinite(change) & (np.abs(change) > STEP_SETTINGS.rounding), np.sign(change), 0.0
    )
    edges = np.flatnonzero(np.diff(direction)) + 1
    first = np.concatenate([[0], edges])
    last = np.concatenate([edges, [len(direction)]])
    return [(int(a), int(b)) for a, b in zip(first, last, strict=True) if direction[a] and b - a <= longest]


def _smoothed_set_point(log: MissionLog, channel: str) -> Array:
    """A channel without the noise of its sensor: a moving mean over a second, ends as they are."""
    values = log.trial.channel(channel)
    if channel == "yaw":
        values = np.unwrap(values)
    # Mean of a logged set point over 1 s: shorter wobble is the log's.
    width = 2 * round(0.5 / log.trial.dt) + 1
    known = np.isfinite(values)
    if width < 3 or len(values) < width:
        return np.asarray(values)
    box = np.ones(width)
    weight = np.convolve(known.astype(float), box, mode="same")
    with np.errstate(invalid="ignore"):
        mean = np.convolve(np.where(known, values, 0.0), box, mode="same") / weight
    return np.where(known, mean, np.nan)


def _apart(values: Array, others: Any, key: str) -> Array:
    away = np.asarray(values - others)
    return shorter(away) if key == "heading" else away
