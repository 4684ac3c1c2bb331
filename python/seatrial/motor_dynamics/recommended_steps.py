"""A step test that determines every parameter of a motor.

Staircase of small commands (n_min), steps too small for the rate limit to matter (T_1, T_t), large steps to
both sides (n_acc, n_dec), beyond the limits (n_max), and full reversals, each held until the motor has
settled. Held by `tests/test_motor_dynamics.py`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seatrial.errors import VehicleError
from seatrial.motor_dynamics.motor_model import MotorModel

__all__ = ["recommended_steps"]

Array = NDArray[np.float64]

_UNKNOWN_LAG_S = 0.3
_REST_S, _REST_SAMPLES = 1.5, 8.0  # length of a plateau, the longer of the two
_STAGGER = 0.6180339887  # golden section: steps meet the samples at evenly spread phases


def recommended_steps(
    motor: Mapping[str, Any], *, sample_s: float = 0.1, stagger: bool = True
) -> tuple[Array, Array]:
    """Times (n,) in s and commands (n,) of a step test, each command held until the next time.

    Parameters
    ----------
    motor : mapping
        What is known or guessed of the motor, as in the vehicle file's ``[motors.NAME]``; ``maximum_ahead``
        is needed.
    sample_s : float
        Time between samples of the log, s.
    stagger : bool
        Let the steps fall between the samples at ever other phases. Without it they fall on samples, for a
        logger that can do no other.

    Raises
    ------
    VehicleError
        There is no largest command, or the sample time is not positive.

    Examples
    --------
    >>> t, command = recommended_steps({"maximum_ahead": 2000.0, "minimum_ahead": 150.0})
    >>> print(command.max(), command.min())
    2300.0 -2300.0
    """
    known = MotorModel.from_table(motor)
    if not all(math.isfinite(limit) and limit > 0 for limit in known.n_max):
        raise VehicleError(
            "a step test needs the largest command; found no maximum_ahead in the motor's table; give"
            " maximum_ahead (and maximum_astern where it differs) in the unit of the command"
        )
    if not sample_s > 0:
        raise VehicleError(f"a step test needs a sample time above zero, found sample_s = {sample_s:g} s")
    sides = [_sequence(known, side) for side in (0, 1)]
    ahead, astern = (known.n_max[side] for side in (0, 1))
    reversals = [0.9 * ahead, -0.9 * astern, 0.9 * ahead, -0.9 * astern, 0.0]
    commands = np.array([0.0, *sides[0], *sides[1], *reversals])
    rest = max(_REST_S, _REST_SAMPLES * sample_s)
    holds = [_hold(known, commands[max(k - 1, 0)], commands[k]) + rest for k in range(len(commands))]
    t = np.concatenate([[0.0], np.cumsum(holds)[:-1]])
    t = np.ceil(t / sample_s) * sample_s
    if stagger:
        t[1:] += sample_s * ((_STAGGER * np.arange(1, len(t))) % 1.0)
    return np.append(t, t[-1] + holds[-1]), np.append(commands, 0.0)


def _sequence(known: MotorModel, side: int) -> list[float]:
    """Commands of one direction, beginning and ending beside zero."""
    sign = 1.0 - 2.0 * side
    top = known.n_max[side]
    low = known.n_min[side] or 0.1 * top
    # A change that the rate limit passes in a third of the time constant shows the lag alone.
    rate = min(known.n_acc[side], known.n_dec[side], 10.0 * top)
    small = min(max(rate * (known.T_1 or _UNKNOWN_LAG_S) / 3.0, 0.04 * top), 0.15 * top)
    middle = max(0.5 * top, 2.0 * low)
    staircase = [0.3 * low, 0.0, 0.6 * low, 0.9 * low, 1.3 * low, 2.0 * low, 0.0]
    fine = [middle, middle + small, middle, middle - small, middle, middle + small]
    large = [0.0, 0.9 * top, 1.15 * top, 0.7 * top, 0.0, 0.8 * top, 0.25 * top, 1.15 * top, 0.0]
    return [sign * command for command in (*staircase, *fine, *large)]


def _hold(known: MotorModel, before: float, after: float) -> float:
    """Time in s until the motor has settled."""
    sides = (0, 1)
    slowest = min(min(known.n_acc[side], known.n_dec[side]) for side in sides)
    ramp = abs(after - before) / slowest if math.isfinite(slowest) else 0.0
    return known.T_t + ramp + 5.0 * (known.T_1 or _UNKNOWN_LAG_S)
