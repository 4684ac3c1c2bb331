"""What a motor makes of a steady command: static limits and gain, by the model's own chain.

The vehicle is held and the command kept until every limit and lag has settled, so that no rule of the motor
(lift to the minimum, dead band, clipping, K_V) is written twice. Tests: ``tests/test_bench_records.py``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.check.actuators import NOMINAL_V, largest, settling_s, voltage_for

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["distance", "settled"]

Array = NDArray[np.float64]

_STEP_S = 0.05


def distance(vehicle: Vehicle, actuator: str, values: ArrayLike) -> Array:
    """Signal (n,): commands or measured values from neutral, positive where they push along the direction."""
    facts = vehicle.actuator_info()[actuator]
    sense = -1.0 if facts["reversed"] else 1.0
    return np.asarray(sense * (np.asarray(values, dtype=float) - facts["neutral"]))


def settled(vehicle: Vehicle, actuator: str, commands: ArrayLike) -> Array:
    """Signal (n,) behind the settled motor for steady commands (n,); NaN stays NaN.

    Examples
    --------
    >>> import seatrial as st
    >>> settled(st.Vehicle.load("cwolf"), "SbU", [0.0, 60.0, -1000.0, 2500.0]).round().tolist()
    [0.0, 150.0, -1000.0, 2000.0]
    """
    wanted = np.asarray(commands, dtype=float)
    distinct = np.unique(wanted[np.isfinite(wanted)])
    facts = vehicle.actuator_info()[actuator]
    steps = int(np.ceil(settling_s(vehicle) / _STEP_S))
    held: dict[str, ArrayLike] = {actuator: np.repeat(distinct, steps)}
    t: Array = _STEP_S * np.arange(steps * len(distinct), dtype=float)
    if len(distinct) == 0:
        return np.full(wanted.shape, np.nan)
    run = vehicle.simulate(t, held, free="", voltage=voltage_for(vehicle, t, NOMINAL_V), max_step=_STEP_S)
    last = distance(vehicle, actuator, np.asarray(run.actuators[actuator])[steps - 1 :: steps])
    last[np.abs(last) < 1e-9 * largest(facts, 1.0)] = 0.0
    result = np.full(wanted.shape, np.nan)
    finite = np.isfinite(wanted)
    result[finite] = last[np.searchsorted(distinct, wanted[finite])]
    return result
