"""Which parameters a step test can tell at all, and why it cannot tell the others.

A parameter is left out of the fit where the commands never come to it: a direction that was not driven, a
limit that no command reaches, a rate that no step meets. After the fit a rate limit is dropped where the
interval of its reciprocal reaches zero (no limit at all would do as well), and a time where its interval is
wider than itself and than a sample. Held by `tests/test_motor_dynamics.py`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seatrial.motor_dynamics.motor_certainty import MotorCertainty
from seatrial.motor_dynamics.motor_model import NAMES, RECIPROCAL, SIDES
from seatrial.motor_dynamics.plateaus import Plateau, Statics
from seatrial.motor_dynamics.start_values import limited
from seatrial.motor_dynamics.step_record import StepRecord

__all__ = ["Reason", "reachable", "unseen_rates", "wide"]

Array = NDArray[np.float64]

_GAIN_PART = 0.1


@dataclass(frozen=True)
class Reason:
    """Why a parameter is not determined, and what bounds it all the same."""

    text: str
    at_least: float | None = None
    at_most: float | None = None


def reachable(
    records: Sequence[StepRecord], settled: Sequence[Plateau], found: Statics, *, dead_band: bool
) -> dict[str, Reason]:
    """Reasons by name of the parameters that the commands cannot tell.

    With a dead band n_min has no derivative; it is found by search and none of the fit's.
    """
    reasons: dict[str, Reason] = {}
    commands = np.concatenate([record.held[1] for record in records])
    growing, shrinking = _moves(records, found)
    for side, (sign, where) in enumerate(zip((1.0, -1.0), SIDES, strict=True)):
        mine = sign * commands[sign * commands > 0]
        if not len(mine):
            for limit in ("n_min", "n_max", "n_acc", "n_dec"):
                reasons[f"{limit}_{where}"] = Reason(f"the records hold no command {where}")
            continue
        followed = [abs(one.command) for one in settled if sign * one.command > 0]
        if math.isinf(found.n_max[side]):
            reasons[f"n_max_{where}"] = _largest(float(mine.max()), followed, where)
        if not found.n_min[side] > 0 and not (dead_band and found.dropped[side] > 0):
            reasons[f"n_min_{where}"] = _smallest(float(mine.min()), followed, where)
        if not growing[side]:
            reasons[f"n_acc_{where}"] = Reason(f"no step grows {where}")
        if not shrinking[side]:
            reasons[f"n_dec_{where}"] = Reason(f"no step shrinks {where}")
    return reasons


def unseen_rates(x: Array, known: MotorCertainty, free: NDArray[np.bool_]) -> dict[str, Reason]:
    """Reasons by name of the rate limits that a fit without them would not miss, the least seen first."""
    doubtful = []
    for k in np.flatnonzero(free & RECIPROCAL):
        if x[k] > known.half[k]:
            continue
        side = NAMES[k].rpartition("_")[2]
        verb = "grow" if NAMES[k].startswith("n_acc") else "shrink"
        slowest = x[k] + known.half[k]
        text = f"the steps that {verb} {side} look the same without it, beside lag and dead time"
        reason = Reason(text, at_least=1.0 / slowest if math.isfinite(slowest) else None)
        doubtful.append((x[k] / known.half[k] if known.half[k] > 0 else 0.0, NAMES[k], reason))
    doubtful.sort(key=lambda one: one[:2])
    return {name: reason for _, name, reason in doubtful}


def wide(x: Array, known: MotorCertainty, sample: float) -> dict[str, Reason]:
    """Reasons by name of gain and times whose interval is too wide to be of use."""
    reasons = {}
    if not known.half[0] <= _GAIN_PART * x[0]:
        reasons["K_V"] = Reason("its interval is wider than a tenth of it")
    for k in (1, 2):
        if not known.half[k] <= max(x[k], sample):
            upper = x[k] + known.half[k]
            reasons[NAMES[k]] = Reason(
                "its interval is wider than the time itself and than a sample; steps of several sizes, some"
                " too small for the rate limit to matter, would tell it",
                at_most=float(upper) if math.isfinite(upper) else None,
            )
    return reasons


def _largest(asked: float, followed: Sequence[float], where: str) -> Reason:
    """Why n_max is not determined, of the largest command and those that settled without a limit."""
    if not followed:
        return Reason(f"no command {where} is held until the motor settles")
    if asked > max(followed):
        text = f"the commands {where} above {max(followed):g} are not held until the motor settles"
        return Reason(text, at_least=max(followed))
    return Reason(f"no command {where} reaches it: the largest, {asked:g}, is still followed", at_least=asked)


def _smallest(asked: float, followed: Sequence[float], where: str) -> Reason:
    """Why n_min is not determined, likewise."""
    if not followed:
        return Reason(f"no command {where} is held until the motor settles")
    if asked < min(followed):
        text = f"the commands {where} below {min(followed):g} are not held until the motor settles"
        return Reason(text, at_most=min(followed))
    return Reason(
        f"no command {where} lies below it: the smallest, {asked:g}, is still followed", at_most=asked
    )


def _moves(records: Sequence[StepRecord], found: Statics) -> tuple[list[bool], list[bool]]:
    """Whether the limited command grows and shrinks, ahead and astern."""
    growing, shrinking = [False, False], [False, False]
    for record in records:
        levels = np.array([limited(float(c), found.n_min, found.n_max) for c in record.held[1]])
        for side, sign in enumerate((1.0, -1.0)):
            change = np.diff(np.maximum(sign * levels, 0.0))
            growing[side] |= bool((change > 0).any())
            shrinking[side] |= bool((change < 0).any())
    return growing, shrinking
