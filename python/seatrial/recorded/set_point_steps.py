"""Steps of the set points in a log, held against the corridors of tuning.

A step is a change of a logged set point that stood before and stands after it until the corridor ends. An
autopilot ramps its set points: a change in one direction that is over within a quarter of the corridor is a
step from where it begins, so that the corridor counts the ramp as well. The response is the smoothed channel
as a share of the step (`seatrial.tuning.corridor_criterion`): one corridor judges a step at sea as it judged
the simulated one, whose truth has no noise.

Tests: ``tests/test_recorded_mission.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.errors import CampaignError, nearest
from seatrial.rotation import shorter

if TYPE_CHECKING:
    from seatrial.recorded.mission_log import MissionLog
    from seatrial.tuning.corridor import Corridor

__all__ = ["LoggedStep", "logged_steps"]

Array = NDArray[np.float64]

_LOOPS = {
    "surge": ("speed", "u", 0.1),
    "sway": ("lateral", "v", 0.1),
    "heave": ("depth", "z", 0.3),
    "depth": ("depth", "z", 0.3),
    "pitch": ("pitch", "pitch", math.radians(3.0)),
    "heading": ("heading", "yaw", math.radians(5.0)),
}
_STOOD_S = 5.0
_RAMP = 0.25
_SMOOTH_S = 1.0
_STILL = 1e-6


@dataclass(frozen=True)
class LoggedStep:
    """A step of a set point in a log: loop, time in s, set points in SI, the corridor's criterion.

    ``criterion`` is the weighted area outside the corridor in s, zero where the response stayed inside.
    """

    loop: str
    at_s: float
    before: float
    after: float
    criterion: float

    def to_dict(self) -> dict[str, Any]:
        """The step as plain data."""
        return asdict(self)


def logged_steps(log: MissionLog, corridors: Mapping[str, Corridor]) -> tuple[LoggedStep, ...]:
    """Steps of the logged set points whose response the log holds until the corridor ends.

    Parameters
    ----------
    log : MissionLog
    corridors : mapping of str to Corridor
        By loop: surge, sway, heave, depth, pitch, heading.

    Raises
    ------
    CampaignError
        There is no such loop.
    """
    from seatrial.tuning.corridor_criterion import criterion, normalised

    found = []
    for loop, corridor in corridors.items():
        if loop not in _LOOPS:
            raise CampaignError(f'corridors: there is no loop "{loop}"{nearest(loop, _LOOPS)}')
        key, channel, least = _LOOPS[loop]
        if key not in log.beside or channel not in log.trial.channels:
            continue
        t, dt = log.trial.t, log.trial.dt
        wanted, done = log.beside[key], _smooth(log, channel)
        stand, length = round(_STOOD_S / dt), round(corridor.until_s / dt)
        for stood, last in _ramps(wanted, key, round(_RAMP * corridor.until_s / dt)):
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
    direction = np.where(np.isfinite(change) & (np.abs(change) > _STILL), np.sign(change), 0.0)
    edges = np.flatnonzero(np.diff(direction)) + 1
    first = np.concatenate([[0], edges])
    last = np.concatenate([edges, [len(direction)]])
    return [(int(a), int(b)) for a, b in zip(first, last, strict=True) if direction[a] and b - a <= longest]


def _smooth(log: MissionLog, channel: str) -> Array:
    """A channel without the noise of its sensor: a moving mean over a second, ends as they are."""
    values = log.trial.channel(channel)
    if channel == "yaw":
        values = np.unwrap(values)
    width = 2 * round(0.5 * _SMOOTH_S / log.trial.dt) + 1
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
