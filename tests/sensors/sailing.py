"""A run of CWolf that turns, dives and rolls a little, for the tests of sensors."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from seatrial._core import Run, State, Vehicle
from seatrial.sensors.log import held, times


def turning_dive(duration_s: float = 120.0, *, every: int = 1, depth_m: float = 20.0) -> Run:
    """Ahead in turns to both sides, diving and rising by turns; `every` rows in 0.1 s."""
    t = np.arange(0.0, duration_s - 0.05, 0.1)
    side = 300.0 * np.sign(np.sin(2.0 * np.pi * t / 20.0))
    down = 700.0 * np.sign(np.sin(2.0 * np.pi * t / 31.0))
    commands: dict[str, ArrayLike] = dict.fromkeys(("SbU", "SbL"), held(1100.0 + side, every))
    commands |= dict.fromkeys(("PU", "PL"), held(1100.0 - side, every))
    commands |= {"VTB": held(down, every), "VTS": held(0.8 * down, every)}
    start = State(position=[0.0, 0.0, depth_m], attitude=[0.1, 0.0, 0.5])
    return Vehicle.load("cwolf").simulate(times(t, every), commands, start, max_step_s=0.01)
