"""Commands that answer what the log does not hold: an autopilot knows the motion by sensors of its own.

The filter of an estimate takes commands for known inputs. That is right where the controller uses what the
log holds. An autopilot that reads a gyro which was not logged, or its compass at other times, knows more of
the state than the filter: its command is then correlated with what the filter is still to see, and gains
come out too small or too large, however well the noise is known (Ljung 1999, chapter 13: the direct
method needs the measurements that the controller uses). Of four generated logs with waves of 5 s, whose yaw
rate was not logged, the rudder's gain came out at 0.140 to 0.144 (truth 0.160); of two such missions that
were steered by the logged measurements at 0.155 and 0.158.

The innovation of a command is what its past does not foretell, and that of the log: a regression on the
innovations of the measurements up to now, on the velocities known before, and on the commands before. No
structure of the controller is assumed. Where the errors of the predictions that follow depend on it, the
command knows more than the log (`Answers.sure`).

The estimate is then made again with instruments that are free of it: from the slopes of the predictions is
taken what follows from the last innovations of the commands and of the measurements. Left are the set points,
and what else nobody on board answers. Three of the four logs then say 0.163, 0.153 and 0.155. A coefficient
that this moves is not identified. The value itself is not reported as the estimate: in waves of another
shape than the noise model's the rounds run away (0.37 and 0.42 where the truth is 0.160).

Held by ``tests/estimation/test_answers.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from seatrial.base.arrays import Array
from seatrial.estimation.prediction_errors import Errors

_OUTLIER = 4.0
"""Deviations beyond which a command's innovation is a jump of the set point and no answer to the state."""

_LAGS = (1, 2, 3, 5)  # samples: of what the past foretells a command from

_MOVES = 0.2
"""Share of the samples at which a command must change: an autopilot answers all the time."""

_PER_COLUMN = 20.0  # samples that a regression needs for each of its columns

_BINS = ((0, 1), (1, 2), (2, 3), (3, 4), (4, 6), (6, 8), (8, 12), (12, 16), (16, 24), (24, 32))
"""Lags in samples that share a gain: wider, the further back."""
_LATE_BINS = (*_BINS, (32, 40), (40, 50), (50, 60))
"""Samples before a prediction over which innovations of commands, and of measurements, are summed."""

_SURE, _EACH = 10.0, 3.0
"""Deviations of chi squared from which commands, together or one alone, are said to know more than the log.

An allocator spreads one loop over many thrusters. Where all together are sure, each counts from `_EACH`.
"""

_RIDGE = 1e-9  # of a sum of squares: combinations that the data do not have


@dataclass(frozen=True)
class Answers:
    """Which commands answer more than the log holds.

    ``names`` (G,) are what drives the vehicle, ``sure`` (G,) by how many of its deviations chi squared of the
    prediction errors on the last innovations of each exceeds its degrees of freedom, and ``innovations``
    (n, G) per span those of the commands, zero where a command tells nothing.
    """

    names: tuple[str, ...]
    sure: tuple[float, ...]
    innovations: tuple[Array, ...]

    def freed(self, errors: Sequence[Errors]) -> list[Errors]:
        """Errors one sample ahead, with instruments free of what commands and measurements last showed."""
        last = _clipped(_shown(errors))
        tables = [
            np.hstack([_lagged(own, _BINS), _lagged(seen, _LATE_BINS)])[: len(late.error)]
            for late, own, seen in zip(errors, self.innovations, last, strict=True)
        ]
        table = np.vstack(tables)
        table = table[:, table.any(axis=0)]
        counted = np.concatenate([late.counted for late in errors])
        slopes = np.concatenate([late.slope for late in errors])
        kept = np.zeros_like(slopes)
        for channel, valid in enumerate(counted.T):
            own = slopes[valid, channel]
            if valid.sum() >= _PER_COLUMN * table.shape[1]:
                own = own - _fitted(table[valid], own)
            kept[valid, channel] = own
        parts = np.split(kept, np.cumsum([len(late.error) for late in errors])[:-1])
        return [replace(late, instrument=part) for late, part in zip(errors, parts, strict=True)]


def answers(
    driving: Sequence[Array], names: Sequence[str], errors: Sequence[Errors], velocities: Sequence[Array]
) -> Answers:
    """Which commands answer more than the log holds; `Answers.names` is empty where none does.

    Parameters
    ----------
    driving : sequence of ndarray, shape (n, k)
        What drives the vehicle, per span.
    names : sequence of str
        Of its columns (k).
    errors : sequence of Errors
        Of predictions one sample ahead.
    velocities : sequence of ndarray, shape (n, V)
        What the filter knew of them at each sample.
    """
    columns, shown = _distinct(driving), _shown(errors)
    unforeseen = _unforeseen([signals[:, columns] for signals in driving], shown, velocities)
    excess, free = np.array([
        _excess([signals[:, g] for signals in unforeseen], errors) for g in range(len(columns))
    ]).reshape(-1, 2).T  # fmt: skip
    sure = excess / np.sqrt(np.maximum(2.0 * free, 1.0))
    together = float(excess.sum() / np.sqrt(max(2.0 * free.sum(), 1.0)))
    kept = np.flatnonzero(sure > (_EACH if together > _SURE else _SURE)).tolist()
    return Answers(
        tuple(names[columns[g]] for g in kept),
        tuple(sure[kept].tolist()),
        tuple(signals[:, kept] for signals in unforeseen),
    )


def _shown(errors: Sequence[Errors]) -> list[Array]:
    """Innovations (n, Y) of the measurements at every sample, zero where none counts."""
    return [np.vstack([np.zeros((1, late.error.shape[1])), late.error]) for late in errors]


def _clipped(shown: Sequence[Array]) -> list[Array]:
    """The same within four of their deviations: errors of a turn are not those of a state."""
    bounds = []
    for channel in np.vstack(shown).T:
        there = np.abs(channel[channel != 0.0])
        bounds.append(_OUTLIER * 1.4826 * float(np.median(there)) if there.size else 0.0)
    return [np.clip(series, np.negative(bounds), bounds) for series in shown]


def _distinct(driving: Sequence[Array]) -> list[int]:
    """Columns of what drives the vehicle that change all the time, one of those that move alike."""
    moves = np.vstack([np.diff(signals, axis=0) for signals in driving])
    kept: list[int] = []
    for column, own in enumerate(moves.T):
        if np.mean(own != 0.0) >= _MOVES and all(
            abs(float(np.corrcoef(own, moves[:, other])[0, 1])) < 0.999 for other in kept
        ):
            kept.append(column)
    return kept


def _unforeseen(driving: Sequence[Array], shown: Sequence[Array], velocities: Sequence[Array]) -> list[Array]:
    """Innovations (n, G) of the commands per span.

    Zero where a command is at its limit, which does not change, or jumps with its set point.
    """
    rows, moves = [], []
    for u, seen, nu in zip(driving, shown, velocities, strict=True):
        columns = [seen, (seen != 0.0).astype(float)]
        columns += [_before(table, lag) for lag in _LAGS for table in (seen, nu, u)]
        rows.append(np.hstack(columns))
        moves.append(np.diff(u, axis=0, prepend=u[:1]))
    table, change = np.vstack(rows), np.vstack(moves)
    spread = table.std(axis=0)
    table = np.hstack([np.ones((len(table), 1)), table[:, spread > 0.0] / spread[spread > 0.0]])
    residuals = np.zeros(change.shape)
    for g in range(change.shape[1]):
        own = np.hstack([table, residuals[:, :g]])
        moved = change[:, g] != 0.0
        counted = moved
        for _ in range(3):
            if counted.sum() < _PER_COLUMN * own.shape[1]:
                break
            weights = np.linalg.lstsq(own[counted], change[counted, g], rcond=1e-9)[0]
            left = change[:, g] - own @ weights
            counted = moved & (np.abs(left) <= _OUTLIER * 1.4826 * np.median(np.abs(left[moved])))
        else:
            residuals[counted, g] = left[counted]
    return np.split(residuals, np.cumsum([len(signals) for signals in driving])[:-1])


def _excess(series: Sequence[Array], errors: Sequence[Errors]) -> tuple[float, int]:
    """By how much chi squared of the errors on a command's last innovations exceeds its degrees of freedom.

    And how many these are; its deviation is the root of twice as many.
    """
    table = np.vstack([
        _lagged(values[:, None], _BINS)[: len(late.error)]
        for values, late in zip(series, errors, strict=True)
    ])
    chi, free = 0.0, 0
    for channel in np.vstack(_clipped([late.error for late in errors])).T:
        counted = channel != 0.0
        if counted.sum() < _PER_COLUMN * table.shape[1] or not table[counted].any():
            continue
        target = channel[counted]
        fit = _fitted(table[counted], target[:, None])[:, 0]
        chi += float((fit**2).sum() / np.mean((target - fit) ** 2))
        free += table.shape[1]
    return chi - free, free


def _fitted(table: Array, target: Array) -> Array:
    """Least-squares fit of targets (n, k) by the columns of a table (n, c)."""
    size = np.sqrt((table**2).mean(axis=0))
    table = table[:, size > 0.0] / size[size > 0.0]
    squares = table.T @ table + _RIDGE * len(table) * np.eye(table.shape[1])
    return np.asarray(table @ np.linalg.solve(squares, table.T @ target))


def _before(values: Array, samples: int) -> Array:
    """Values (n, k) so many samples before; zero before the first."""
    return np.vstack([np.zeros_like(values[:samples]), values[: max(len(values) - samples, 0)]])


def _lagged(values: Array, bins: Sequence[tuple[int, int]]) -> Array:
    """Sums (n, k times bins) of values (n, k) from one number of samples before to another, own sample 0."""
    total = np.cumsum(np.vstack([np.zeros((1, values.shape[1])), values]), axis=0)
    after = np.arange(1, len(values) + 1)
    return np.hstack([total[np.maximum(after - a, 0)] - total[np.maximum(after - b, 0)] for a, b in bins])
