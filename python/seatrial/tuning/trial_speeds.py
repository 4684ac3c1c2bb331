"""Speeds at which a loop is tried where the file gives none, and the least at which a vehicle flies level.

At most three: that nearest to rest, the fastest and one between. Six that the vehicle reaches cost twice as
much and tell little more, and no mission goes astern faster than a brake does; where there are no more than
three, all are tried. A trial keeps away from a switching speed, so that a current does not change the mode
under way, and one of the speed stays within reach against the current. A vehicle that cannot hover falls
below its path when it is slower than level flight needs, whatever its gains.

Held by tests/test_trial_speeds.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle

__all__ = ["apart", "slowest_level_m_s", "thinned", "tried_speeds"]

MOST = 3
"""Speeds per loop, at most."""

_APART = 0.5  # of the mean spacing of the supporting points: speeds that are nearer tell the same
_ROUNDING = 0.005  # supporting points have four digits


def tried_speeds(
    wanted_m_s: Sequence[float],
    modes_m_s: Sequence[tuple[float, float]],
    *,
    away_m_s: float,
    within_m_s: tuple[float, float],
    apart_m_s: float,
) -> tuple[float, ...]:
    """Speeds of a loop's trials, m/s, rising.

    Parameters
    ----------
    wanted_m_s : sequence of float
        Supporting points that count for the loop.
    modes_m_s : sequence of (float, float)
        Speeds from and to which a mode uses the loop.
    away_m_s : float
        How far a trial keeps from a switching speed.
    within_m_s : (float, float)
        Least and largest speed of a trial.
    apart_m_s : float
        Of speeds that are nearer to each other the first is tried.

    Examples
    --------
    >>> every = (-float("inf"), float("inf"))
    >>> points = [-2.0, -1.0, 0.0, 1.0, 2.0, 3.0]
    >>> tried_speeds(points, [every], away_m_s=0.1, within_m_s=every, apart_m_s=0.5)
    (0.0, 2.0, 3.0)
    >>> tried_speeds(points, [(1.2, every[1])], away_m_s=0.1, within_m_s=every, apart_m_s=0.5)
    (1.3, 2.0, 3.0)
    """
    found: list[float] = []
    for wanted in wanted_m_s:
        near = [float(np.clip(wanted, *_inside(mode, away_m_s))) for mode in modes_m_s]
        at = near[int(np.argmin(np.abs(np.array(near) - wanted)))]
        at = round(float(np.clip(at, *within_m_s)), 6)
        used = any(begin <= at < end for begin, end in modes_m_s)
        if used and not any(abs(at - other) < apart_m_s for other in found):
            found.append(at)
    return tuple(thinned(sorted(found)))


def _inside(mode_m_s: tuple[float, float], away_m_s: float) -> tuple[float, float]:
    """Speeds of a mode away from its ends; the middle of one that is narrower."""
    begin, end = mode_m_s[0] + away_m_s, mode_m_s[1] - away_m_s
    return (begin, end) if begin <= end else (0.5 * (begin + end),) * 2


def apart(points_m_s: Sequence[float]) -> float:
    """How near two speeds may be for both to be tried, m/s, from the supporting points."""
    return _APART * float(np.mean(np.diff(points_m_s)))


def thinned(speeds_m_s: Sequence[float]) -> list[float]:
    """Of some speeds at most three: that nearest to rest, the fastest, the one nearest to their middle.

    Examples
    --------
    >>> thinned([-0.8, -0.5, -0.2, 0.2, 0.5, 0.8])
    [0.2, 0.5, 0.8]
    >>> thinned([-1.0, 1.0, 3.0])
    [-1.0, 1.0, 3.0]
    >>> thinned([-0.8, -0.5, -0.2, 0.1])
    [-0.2, 0.1]
    """
    if len(speeds_m_s) <= MOST:
        return list(speeds_m_s)
    slow = min(speeds_m_s, key=lambda speed: (round(abs(speed), 6), -speed))
    fast = max(speeds_m_s)
    if fast == slow:  # all others are astern
        return sorted([fast, min((speed for speed in speeds_m_s if speed != fast), key=abs)])
    middle = 0.5 * (slow + fast)
    between = [speed for speed in speeds_m_s if slow < speed < fast]
    chosen = [min(between, key=lambda speed: (round(abs(speed - middle), 6), -speed))] if between else []
    return [slow, *chosen, fast]


def slowest_level_m_s(vehicle: Vehicle, autopilot: Autopilot) -> float | None:
    """Least speed ahead at which the vehicle holds its depth, m/s; None where a mode of it hovers.

    Examples
    --------
    >>> import seatrial as st
    >>> round(slowest_level_m_s(st.Vehicle.load("remus100"), st.Autopilot.load("remus100")), 2)
    1.54
    >>> slowest_level_m_s(st.Vehicle.load("cwolf"), st.Autopilot.load("cwolf")) is None
    True
    """
    from seatrial.control_design.authority import ROWS
    from seatrial.control_design.mode_table import supporting_speeds, top_speeds

    modes = autopilot.modes
    if any(mode["depth_by"] != "pitch" for mode in modes):
        return None
    used = np.max([mode["loops"] for mode in modes], axis=0) > 0.5
    rows = "".join(row for row, at_work in zip(ROWS, used, strict=True) if at_work)
    slowest = supporting_speeds(vehicle, rows, top_speeds(vehicle))[0]
    return slowest * (1.0 - _ROUNDING)
