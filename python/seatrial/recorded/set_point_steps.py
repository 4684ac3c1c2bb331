"""Steps of the set points in a log, held against the corridors of tuning.

A step is a change of a logged set point that stood before and stands after it until the corridor ends. The
response is the channel as a share of the step (`seatrial.tuning.corridor_criterion`), so that one corridor
judges a step at sea as it judged the simulated one.

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
        wanted, done = log.beside[key], log.trial.channel(channel)
        stand, length = round(_STOOD_S / dt), round(corridor.until_s / dt)
        for row in np.flatnonzero(np.abs(_change(wanted, key)) > least) + 1:
            after = slice(row, row + length + 1)
            if row < stand or row + length >= len(t):
                continue
            before, value = wanted[row - 1], wanted[row]
            quiet = np.abs(_apart(wanted[row - stand : row], before, key)).max()
            stays = np.abs(_apart(wanted[after], value, key)).max()
            if max(quiet, stays) > 0.1 * least or not np.isfinite(done[after]).all():
                continue
            size = float(_apart(np.array([value]), before, key)[0])
            y = normalised(_apart(done[after], before, key), 0.0, size)
            q = float(criterion(dt * np.arange(length + 1), y, corridor))
            found.append(LoggedStep(loop, float(t[row]), float(before), float(before) + size, q))
    return tuple(sorted(found, key=lambda step: step.at_s))


def _change(values: Array, key: str) -> Array:
    return _apart(values[1:], values[:-1], key)


def _apart(values: Array, others: Any, key: str) -> Array:
    away = np.asarray(values - others)
    return shorter(away) if key == "heading" else away
