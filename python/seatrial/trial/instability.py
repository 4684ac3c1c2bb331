"""Whether a vehicle runs away from a straight course while its controls are held still.

A directionally unstable hull turns away within seconds; only an autopilot keeps it straight. A simulation
from a recorded state then leaves the log whatever the coefficients are, and comparing both says little of
them. Held by ``tests/trial/test_instability.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.channels import CHANNELS
from seatrial.vehicle.stability import growth

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.trial.trial import Trial

SEGMENT_S = 20.0
"""Length of a simulated segment of the joint estimate, s, unless a campaign says otherwise."""

_SHARE = 0.25
"""A disturbance that grows tenfold within this share of a segment grows by ten thousand in all of it."""

_ROUNDED_S = 0.5

_PLANES = {"course": ("YN", "yaws"), "pitch": ("ZM", "pitches")}


def runs_away(vehicle: Vehicle, trials: Sequence[Trial], free: str, segment_s: float = SEGMENT_S) -> str:
    """Sentence on a vehicle that leaves straight running too fast to be simulated for a segment; else "".

    Parameters
    ----------
    vehicle
    trials
        Recordings; each is looked at about its median speed ahead.
    free
        Letters of the simulated axes: the course needs both sway and yaw, the pitch both heave and pitch.
    segment_s
        How long a segment is simulated, s.
    """
    for trial in trials:
        for verb, speed, tenfold_s in _tenfold(vehicle, trial, free):
            if tenfold_s < _SHARE * segment_s:
                return (
                    f"with fixed controls the start vehicle {verb} off a straight course at {speed:.1f} m/s,"
                    f" and deviations grow tenfold in {tenfold_s:.1f} s"
                )
    return ""


def judged_s(vehicles: Sequence[Vehicle], trials: Sequence[Trial], free: str, longest_s: float) -> float:
    """How far ahead a simulation judges a model of a vehicle that may run away, s.

    Where a disturbance grows by ten thousand within `longest_s`, it is the time in which it grows tenfold:
    beyond it the errors of the first state are all that a simulation shows.

    Parameters
    ----------
    vehicles
        Those that are judged by it, the fastest decides.
    trials, free
        As for `runs_away`.
    longest_s
        For a vehicle that does not run away.
    """
    times = [time for v in vehicles for trial in trials for *_, time in _tenfold(v, trial, free)]
    shortest = min(times, default=math.inf)
    if shortest >= _SHARE * longest_s:
        return longest_s
    return max(_ROUNDED_S * round(shortest / _ROUNDED_S), _ROUNDED_S)


def _tenfold(vehicle: Vehicle, trial: Trial, free: str) -> Iterator[tuple[str, float, float]]:
    """Per plane that diverges: its verb, the median speed ahead, and the time of a tenfold growth, s."""
    k = CHANNELS.index("u")
    known = trial.observed[trial.valid[:, k], k]
    speed = float(np.median(known)) if len(known) else 0.0
    for plane, (axes, verb) in _PLANES.items() if speed > 0.0 else ():
        rate = growth(vehicle, speed, plane) if set(axes) <= set(free) else 0.0
        if rate > 0.0:
            yield verb, speed, math.log(10.0) / rate
