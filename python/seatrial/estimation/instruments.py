"""What of the slopes of a prediction was known when it was made: instruments under feedback.

A prediction over a horizon takes the commands within it from the log. Where an autopilot gave them they
answer what the vehicle met within the horizon, which is just what the prediction misses: error and slope are
then correlated even at the right values, and a least-squares estimate is bent. It is not where the slope is
replaced by the part of it that the log told up to the start of the horizon (two-stage least squares; Ljung
1999, section 7.6; Gilson & Van den Hof 2005, for closed loops).

That part is a linear regression of each slope on what was known at the start: the slopes one sample ahead,
the commands of this sample, the velocities that the filter knew, and the last two some samples before. The
coefficients of a part of the log come from the rest of it (jackknife instruments; Angrist, Imbens & Krueger
1999): those of the same part would know its errors.

Held by ``tests/estimation/test_instruments.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES
from seatrial.estimation.prediction_errors import Errors
from seatrial.scoring.record import Record

_LAGS = 4
"""Samples back that instruments are made of."""

_OF_A_WAVE, _LAG_S = 0.125, 0.7
"""Time between the lags: that part of the waves' period, or so many seconds where there are none."""

_WRENCH = tuple(f"tau {axis}" for axis in AXES)

_PARTS = 10
"""Parts of the log whose regressions come from the others."""

_SINGULAR = 1e-9  # of the largest eigenvalue: a combination of what was known that is none


def lag_s(wave_hz: float | None) -> float:
    """Time between the lags of what was known, s: that of an eighth of the waves' period."""
    return _LAG_S if wave_hz is None else _OF_A_WAVE / wave_hz


def drivers(records: Sequence[Record]) -> list[str]:
    """What drives the vehicles, in the order of `driven`: its kind, then an actuator or axis."""
    return sorted({name for record in records for name in _signals(record)})


def driven(records: Sequence[Record]) -> list[Array]:
    """What drives each record's vehicle, (n, k): commands, actuator signals, wrench; zero if it has none."""
    signals, names = [_signals(record) for record in records], drivers(records)
    tables = [np.zeros((len(record.trial), len(names))) for record in records]
    for rows, trial_signals in zip(tables, signals, strict=True):
        for name, values in trial_signals.items():
            rows[:, names.index(name)] = np.nan_to_num(values)
    return tables


def _signals(record: Record) -> dict[str, Array]:
    """By name what drives a record's vehicle."""
    trial = record.trial
    if record.input == "tau":
        return {} if trial.tau is None else dict(zip(_WRENCH, trial.tau.T, strict=True))
    own = trial.commands if record.input == "commands" else trial.measured
    return {f"{record.input} {name}": values for name, values in own.items()}


def instrumented(
    errors: Sequence[Errors], first: Sequence[Errors], known: Sequence[Array], lag: int
) -> list[Errors]:
    """Errors over a horizon with instruments in the place of what their slopes are correlated with.

    Parameters
    ----------
    errors : sequence of Errors
        Over the horizon, by spans.
    first : sequence of Errors
        Of the same spans, one sample ahead.
    known : sequence of ndarray, shape (n, k)
        Per span, what was known at each of its samples.
    lag : int
        Samples between the lags.
    """
    instruments = np.vstack([
        _before(table, own, len(late.error), lag)
        for late, table, own in zip(errors, first, known, strict=True)
    ])
    spread = instruments.std(axis=0)
    instruments = np.hstack([
        np.ones((len(instruments), 1)),
        instruments[:, spread > 0.0] / spread[spread > 0.0],
    ])
    slopes = np.vstack([late.slope.reshape(len(late.error), -1) for late in errors])
    counted = np.concatenate([late.counted.any(axis=1) for late in errors])
    part = np.zeros(len(instruments), dtype=np.intp)
    part[counted] = np.arange(counted.sum()) * _PARTS // max(int(counted.sum()), 1)
    sums = []
    for k in range(_PARTS):
        here = counted & (part == k)
        sums.append((instruments[here].T @ instruments[here], instruments[here].T @ slopes[here]))
    squares, products = (np.sum(both, axis=0) for both in zip(*sums, strict=True))
    fitted = np.zeros_like(slopes)
    for k, (own_squares, own_products) in enumerate(sums):
        here = counted & (part == k)
        fitted[here] = instruments[here] @ _solved(squares - own_squares, products - own_products)
    made, place = [], 0
    for prediction in errors:
        rows = fitted[place : place + len(prediction.error)].reshape(prediction.slope.shape)
        made.append(replace(prediction, instrument=np.where(prediction.counted[..., None], rows, 0.0)))
        place += len(prediction.error)
    return made


def _before(first: Errors, known: Array, length: int, lag: int) -> Array:
    """What was known at the start of each of so many predictions of a span, (length, k).

    Of the slopes one sample ahead by an unknown, that of the channel which it moves most.
    """
    moved = np.abs(first.slope).mean(axis=0) / np.maximum(np.abs(first.error).mean(axis=0), 1e-300)[:, None]
    most = np.take_along_axis(first.slope, moved.argmax(axis=0)[None, None], axis=1)[:length, 0]
    columns = [most]
    for k in range(_LAGS):
        shifted = np.zeros((length, known.shape[1]))
        shifted[k * lag :] = known[: max(length - k * lag, 0)]
        columns.append(shifted)
    return np.hstack(columns)


def _solved(squares: Array, products: Array) -> Array:
    """Least-squares coefficients without combinations that the data do not have."""
    values, vectors = np.linalg.eigh(squares)
    kept = values > _SINGULAR * values[-1]
    return np.asarray((vectors[:, kept] / values[kept]) @ (vectors[:, kept].T @ products))
