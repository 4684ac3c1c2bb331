"""Metrics of a recorded mission by the names of simulated flights, and its set-point steps in corridors.

Errors of guidance count on the second half of straight legs (`seatrial.flight.metrics`). Positions are those
that were measured: the truth of a sea trial is not known. Held by
``tests/verification/test_recorded_mission.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.errors import CampaignError, nearest
from seatrial.base.frames import shorter
from seatrial.base.plain import Plain
from seatrial.flight.metrics import reserve, switches
from seatrial.flight.mission import Route
from seatrial.verification.mission_log.log import MissionLog, Progress, errors_of_guidance

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.control_design.corridor import Corridor
    from seatrial.flight.mission import Mission
    from seatrial.verification.table import Obstacle

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

    `mission`: without it there are no metrics of guidance, but those that the log itself tells. `vehicle`:
    gives the neutral command of the actuators. `obstacles`: what stands in the water besides the mission's
    own.
    """
    trial = log.trial
    here = set(trial.channels)
    found: dict[str, Any] = {"duration_s": float(trial.t[-1] - trial.t[0])}
    if {"x", "y", "z"} <= here:
        found["distance_m"] = float(np.linalg.norm(np.diff(_smooth(log), axis=0), axis=1).sum())
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
    strongest = int(reaction.max())
    if strongest in _REACTIONS:
        found["ending"] = _REACTIONS[strongest]
    else:
        found["ending"] = "complete" if reached == len(path.stops) else "out of time"
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
    start, end = (
        np.array([path.before(k) for k in range(count)]),
        np.array([stop.position for stop in path.stops]),
    )
    band = np.sort(np.stack([start[:, 2], end[:, 2]], axis=1), axis=1)
    band[[path.follows_bottom(k) for k in range(count)]] = -np.inf, np.inf
    last = band[np.maximum(np.arange(count) - 1, 0)]
    entry = np.stack([np.minimum(band, last)[:, 0], np.maximum(band, last)[:, 1]], axis=1)
    leg, position = progress.leg, log.trial.position
    along = np.sum((position - start[leg])[:, :2] * (end - start)[leg, :2], axis=1)
    allowed = np.where((along < 0.0)[:, None], entry[leg], band[leg])
    out = np.maximum(position[:, 2] - allowed[:, 1], allowed[:, 0] - position[:, 2])[under_way]
    return float(max(np.nanmax(out, initial=0.0), 0.0))


def _smooth(log: MissionLog) -> Array:
    """Positions once a second: the noise of a fast sensor is no way that was gone."""
    every = max(1, round(1.0 / log.trial.dt))
    return np.asarray(log.trial.position[::every])


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

    #: Share of a corridor: a set point that moves for longer is no step.
    ramp_share: float = 0.25
    #: Largest change of a set point that stands still.
    rounding: float = 1e-6


SETTINGS = LogMetricsSettings()


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
        for stood, last in _ramps(wanted, key, round(SETTINGS.ramp_share * corridor.until_s / dt)):
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
    change = _change(wanted, key)
    direction = np.where(np.isfinite(change) & (np.abs(change) > SETTINGS.rounding), np.sign(change), 0.0)
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


def _change(values: Array, key: str) -> Array:
    return _apart(values[1:], values[:-1], key)


def _apart(values: Array, others: Any, key: str) -> Array:
    away = np.asarray(values - others)
    return shorter(away) if key == "heading" else away
