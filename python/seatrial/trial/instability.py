"""Whether a vehicle runs away from a straight course while its controls are held still.

A directionally unstable hull turns away within seconds; only an autopilot keeps it straight. A simulation
from a recorded state then leaves the log whatever the coefficients are, and comparing both says little of
them. Held by ``tests/trial/test_instability.py``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.channels import CHANNELS
from seatrial.vehicle.stability import growth

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.trial.trial import Trial

__all__ = ["SEGMENT_S", "runs_away"]

SEGMENT_S = 20.0
"""Length of a simulated segment of the joint estimate, s, unless a campaign says otherwise."""

_SHARE = 0.25
"""A disturbance that grows tenfold within this share of a segment grows by ten thousand in all of it."""

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
    k = CHANNELS.index("u")
    for trial in trials:
        known = trial.observed[trial.valid[:, k], k]
        speed = float(np.median(known)) if len(known) else 0.0
        if speed <= 0.0:
            continue
        for plane, (axes, verb) in _PLANES.items():
            if not set(axes) <= set(free):
                continue
            rate = growth(vehicle, speed, plane)
            if rate > 0.0 and math.log(10.0) / rate < _SHARE * segment_s:
                return (
                    f"the vehicle that the search starts from {verb} away from a straight course of"
                    f" {speed:.1f} m/s tenfold in {math.log(10.0) / rate:.1f} s while its controls are held"
                )
    return ""
