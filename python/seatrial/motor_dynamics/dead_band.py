"""Lift or drop: what the controller makes of commands below the minimum, decided by fitting both.

A dead band has no slope: the response depends only on which commands it drops. Its edge is sought over the
commands that were given, and lies between the largest that was dropped and the smallest that was not; nothing
inside that bracket is likelier than anything else. Held by `tests/test_motor_dynamics.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from seatrial.motor_dynamics.motor_fit import Problem
from seatrial.motor_dynamics.motor_model import NAMES
from seatrial.motor_dynamics.step_record import StepRecord

__all__ = ["bracket", "edges"]

Array = NDArray[np.float64]

_MOST = 24
_FIRST = NAMES.index("n_min_ahead")


def edges(problem: Problem, x: Array) -> Array:
    """Coordinates (11,) with the edges of the dead band (ahead, astern) that cost least."""
    best = x.copy()
    problem = replace(problem, dead_band=True)
    for side in (0, 1):
        sizes = _sizes(problem.records, side)
        cuts = np.concatenate([[0.0], 0.5 * (sizes[:-1] + sizes[1:])])[:_MOST]
        costs = []
        for cut in cuts:
            best[_FIRST + side] = cut
            costs.append(problem.cost(best))
        best[_FIRST + side] = cuts[int(np.argmin(costs))]
    return best


def bracket(records: Sequence[StepRecord], edge: float, side: int) -> tuple[float, float] | None:
    """Largest command that an edge drops and smallest that it lets pass; None where it drops none."""
    sizes = _sizes(records, side)
    dropped, passed = sizes[sizes < edge], sizes[sizes >= edge]
    if not len(dropped) or not len(passed):
        return None
    return float(dropped.max()), float(passed.min())


def _sizes(records: Sequence[StepRecord], side: int) -> Array:
    """Distinct magnitudes of the commands of one direction, rising."""
    commands = np.concatenate([record.held[1] for record in records])
    sign = 1.0 - 2.0 * side
    return np.unique(sign * commands[sign * commands > 0])
