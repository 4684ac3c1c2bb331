"""Instruments under feedback: what was known at a prediction, and which commands know more.

A command within the horizon answers what the prediction misses, so error and slope are correlated even at
the right values. The slope is replaced by the part of it that the log told before (two-stage least squares;
Ljung 1999, section 7.6; Gilson & Van den Hof 2005), regressed on other parts of the log (jackknife; Angrist,
Imbens & Krueger 1999).

An autopilot that reads what was not logged knows more of the state than the filter (Ljung 1999, chapter 13):
the innovation of its command, what the past does not foretell, then explains later errors (`Answers.sure`).
The estimate is made again with instruments free of it; a coefficient that this moves is not identified. Of
four generated logs whose yaw rate was not logged the rudder's gain came out at 0.140 to 0.144 (truth 0.160),
and three of them then say 0.163, 0.153 and 0.155. That value is no estimate: in waves of another shape the
rounds run away (0.37 and 0.42).

Tests: ``tests/estimation/test_instruments.py``, ``tests/estimation/test_answers.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES
from seatrial.estimation.one_step import Errors
from seatrial.scoring.record import Record


@dataclass(frozen=True)
class InstrumentSettings:
    """What of the past is an instrument, and when a command knows more than the log."""

    #: Lags back that instruments are made of.
    lags: int = 4
    #: Time between the lags, a share of the waves' period.
    wave_share: float = 0.125
    #: Time between the lags where there are no waves, s.
    lag_s: float = 0.7
    #: Parts of the log, each of whose regressions comes from the others.
    parts: int = 10
    #: Eigenvalue, over the largest, below which a combination of what was known is none.
    singular_share: float = 1e-9
    #: Deviations beyond which a command's innovation is a jump of the set point and no answer to the state.
    outlier_sd: float = 4.0
    #: Samples back that a command is foretold from.
    command_lags: tuple[int, ...] = (1, 2, 3, 5)
    #: Share of the samples at which a command must change: an autopilot answers all the time.
    moving_share: float = 0.2
    #: Samples that a regression needs for each of its columns.
    samples_per_column: float = 20.0
    #: Ranges of lags, in samples, whose innovations of a command share a gain: wider, the further back.
    command_bins: tuple[tuple[int, int], ...] = (
        (0, 1),
        (1, 2),
        (2, 3),
        (3, 4),
        (4, 6),
        (6, 8),
        (8, 12),
        (12, 16),
        (16, 24),
        (24, 32),
    )
    #: The same of the measurements, which reach further back.
    measured_bins: tuple[tuple[int, int], ...] = (*command_bins, (32, 40), (40, 50), (50, 60))
    #: Deviations of chi squared from which commands together, or one alone, know more than the log.
    sure_sd: float = 10.0
    #: Deviations from which each counts where all together are sure: an allocator spreads one loop over many
    #: thrusters.
    each_sd: float = 3.0
    #: Share of the mean square that is added to it, for combinations that the data do not have.
    ridge: float = 1e-9


SETTINGS = InstrumentSettings()


_WRENCH = tuple(f"tau {axis}" for axis in AXES)


def lag_s(wave_hz: float | None) -> float:
    """Time between the lags of what was known, s: that of an eighth of the waves' period."""
    return SETTINGS.lag_s if wave_hz is None else SETTINGS.wave_share / wave_hz


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

    ``errors``: over the horizon, by spans. ``first``: of the same spans, one sample ahead. ``known`` (n, k):
    per span, what was known at each of its samples. ``lag``: samples between the lags.
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
    part[counted] = np.arange(counted.sum()) * SETTINGS.parts // max(int(counted.sum()), 1)
    sums = []
    for k in range(SETTINGS.parts):
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
    for k in range(SETTINGS.lags):
        shifted = np.zeros((length, known.shape[1]))
        shifted[k * lag :] = known[: max(length - k * lag, 0)]
        columns.append(shifted)
    return np.hstack(columns)


def _solved(squares: Array, products: Array) -> Array:
    """Least-squares coefficients without combinations that the data do not have."""
    values, vectors = np.linalg.eigh(squares)
    kept = values > SETTINGS.singular_share * values[-1]
    return np.asarray((vectors[:, kept] / values[kept]) @ (vectors[:, kept].T @ products))


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
            np.hstack([_lagged(own, SETTINGS.command_bins), _lagged(seen, SETTINGS.measured_bins)])[
                : len(late.error)
            ]
            for late, own, seen in zip(errors, self.innovations, last, strict=True)
        ]
        table = np.vstack(tables)
        table = table[:, table.any(axis=0)]
        counted = np.concatenate([late.counted for late in errors])
        slopes = np.concatenate([late.slope for late in errors])
        kept = np.zeros_like(slopes)
        for channel, valid in enumerate(counted.T):
            own = slopes[valid, channel]
            if valid.sum() >= SETTINGS.samples_per_column * table.shape[1]:
                own = own - _fitted(table[valid], own)
            kept[valid, channel] = own
        parts = np.split(kept, np.cumsum([len(late.error) for late in errors])[:-1])
        return [replace(late, instrument=part) for late, part in zip(errors, parts, strict=True)]


def answers(
    driving: Sequence[Array], names: Sequence[str], errors: Sequence[Errors], velocities: Sequence[Array]
) -> Answers:
    """Which commands answer more than the log holds; `Answers.names` is empty where none does.

    ``driving`` (n, k): what drives the vehicle, per span. ``names``: of its columns (k). ``errors``: of
    predictions one sample ahead. ``velocities`` (n, V): what the filter knew of them at each sample.
    """
    columns, shown = _distinct(driving), _shown(errors)
    unforeseen = _unforeseen([signals[:, columns] for signals in driving], shown, velocities)
    excess, free = np.array([
        _excess([signals[:, g] for signals in unforeseen], errors) for g in range(len(columns))
    ]).reshape(-1, 2).T  # fmt: skip
    sure = excess / np.sqrt(np.maximum(2.0 * free, 1.0))
    together = float(excess.sum() / np.sqrt(max(2.0 * free.sum(), 1.0)))
    kept = np.flatnonzero(
        sure > (SETTINGS.each_sd if together > SETTINGS.sure_sd else SETTINGS.sure_sd)
    ).tolist()
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
        bounds.append(SETTINGS.outlier_sd * 1.4826 * float(np.median(there)) if there.size else 0.0)
    return [np.clip(series, np.negative(bounds), bounds) for series in shown]


def _distinct(driving: Sequence[Array]) -> list[int]:
    """Columns of what drives the vehicle that change all the time, one of those that move alike."""
    moves = np.vstack([np.diff(signals, axis=0) for signals in driving])
    kept: list[int] = []
    for column, own in enumerate(moves.T):
        if np.mean(own != 0.0) >= SETTINGS.moving_share and all(
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
        columns += [_earlier(table, lag) for lag in SETTINGS.command_lags for table in (seen, nu, u)]
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
            if counted.sum() < SETTINGS.samples_per_column * own.shape[1]:
                break
            weights = np.linalg.lstsq(own[counted], change[counted, g], rcond=1e-9)[0]
            left = change[:, g] - own @ weights
            counted = moved & (np.abs(left) <= SETTINGS.outlier_sd * 1.4826 * np.median(np.abs(left[moved])))
        else:
            residuals[counted, g] = left[counted]
    return np.split(residuals, np.cumsum([len(signals) for signals in driving])[:-1])


def _excess(series: Sequence[Array], errors: Sequence[Errors]) -> tuple[float, int]:
    """By how much chi squared of the errors on a command's last innovations exceeds its degrees of freedom.

    And how many these are; its deviation is the root of twice as many.
    """
    table = np.vstack([
        _lagged(values[:, None], SETTINGS.command_bins)[: len(late.error)]
        for values, late in zip(series, errors, strict=True)
    ])
    chi, free = 0.0, 0
    for channel in np.vstack(_clipped([late.error for late in errors])).T:
        counted = channel != 0.0
        if counted.sum() < SETTINGS.samples_per_column * table.shape[1] or not table[counted].any():
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
    squares = table.T @ table + SETTINGS.ridge * len(table) * np.eye(table.shape[1])
    return np.asarray(table @ np.linalg.solve(squares, table.T @ target))


def _earlier(values: Array, samples: int) -> Array:
    """Values (n, k) so many samples before; zero before the first."""
    return np.vstack([np.zeros_like(values[:samples]), values[: max(len(values) - samples, 0)]])


def _lagged(values: Array, bins: Sequence[tuple[int, int]]) -> Array:
    """Sums (n, k times bins) of values (n, k) from one number of samples before to another, own sample 0."""
    total = np.cumsum(np.vstack([np.zeros((1, values.shape[1])), values]), axis=0)
    after = np.arange(1, len(values) + 1)
    return np.hstack([total[np.maximum(after - a, 0)] - total[np.maximum(after - b, 0)] for a, b in bins])
