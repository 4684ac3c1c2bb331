"""Steady parts of a load-cell record: one operating point per plateau of the command.

The samples of one plateau err alike (mounting, recirculation in the basin, friction of pulleys), so that each
of them is no new evidence: a plateau counts once, with its mean. The residuals of the regression are then
those between plateaus, and their scatter holds whatever makes a repeated plateau differ.

A plateau begins where a command changes and its first ``settle_s`` are left out. Where no command is logged,
it begins where the measured revolutions leave their mean. A table without time is steady already: every row
is one plateau. The standard error of a plateau's mean allows for samples that correlate with the one before
(`seatrial.statistics.autocorrelation`).

Tests: ``tests/bench_test/test_bench_records.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError
from seatrial.statistics.autocorrelation import lag_one_correlation, variance_inflation

_LEAST_SAMPLES = 5
"""Fewer steady samples of the load are too few for a mean."""

_COMMAND_SHARE = 0.002

_MEASURED_SHARE = 0.03

_NOISES = 6.0

_DRIFT_SHARE, _DRIFT_ERRORS = 0.02, 6.0

_MOST_MEMORY = 0.95


@dataclass(frozen=True)
class Plateau:
    """One operating point.

    Attributes
    ----------
    label
        Row, or interval of time, for messages.
    signal
        Per actuator, mean over the steady samples.
    load, error
        Mean load (a,) and its standard error in N, one per axis of the cell; the error is NaN in a table
        without time.
    voltage_v
        Supply voltage in V, NaN where it is not logged.
    samples
        Steady samples of the load.
    drifting
        Whether the load still moved: its halves differ by more than six errors of the second one and 2 % of
        its size.
    """

    label: str
    signal: dict[str, float]
    load: Array
    error: Array
    voltage_v: float
    samples: int
    drifting: bool = False


def held(values: Array) -> Array:
    """Values (n,) with NaN replaced by the last number before, by the first one at the beginning."""
    finite = np.isfinite(values)
    if not finite.any():
        return values
    last = np.maximum.accumulate(np.where(finite, np.arange(len(values)), -1))
    last[last < 0] = int(np.argmax(finite))
    return np.asarray(values[last])


def plateaus(
    t: Array,
    command: Mapping[str, Array],
    signal: Mapping[str, Array],
    load: Array,
    voltage_v: Array | None,
    *,
    settle_s: float,
    where: str,
) -> tuple[list[Plateau], int]:
    """Plateaus of a record, and how many were too short to be used.

    Parameters
    ----------
    t : array, shape (n,)
    command : mapping
        Per actuator (n,) the signal that ends a plateau: logged commands; empty where none is logged.
    signal : mapping
        Per actuator (n,) what the characteristic is a function of; NaN between samples.
    load : array, shape (n, a)
        N; NaN between samples.
    voltage_v : array, shape (n,), optional
    settle_s : float
        Time after the beginning of a plateau that is left out, s.
    where : str
        Beginning of messages.

    Raises
    ------
    TrialError
        No plateau is long enough.
    """
    if command:
        starts = _changes([held(x) for x in command.values()])
    else:
        starts = _departures([held(x) for x in signal.values()])
    bounds = [0, *starts, len(t)]
    steady_parts: list[Plateau] = []
    short = 0
    for begin, end in pairwise(bounds):
        # The first command is taken as held long enough before the recording only after settling, too.
        steady = np.arange(begin, end)[t[begin:end] >= t[begin] + settle_s]
        made = _plateau(t, signal, load, voltage_v, steady)
        if made is None:
            short += 1
        else:
            steady_parts.append(made)
    if not steady_parts:
        raise TrialError(
            f"{where}: no steady part: {len(bounds) - 1} plateaus of the command, none with {_LEAST_SAMPLES}"
            f" samples of the load after {settle_s:g} s; hold each command longer or lower settle_s"
        )
    return steady_parts, short


def rows_as_plateaus(
    signal: Mapping[str, Array], load: Array, voltage_v: Array | None
) -> tuple[list[Plateau], int]:
    """Plateaus of a table without time, one per row, and how many rows had empty cells."""
    values = np.column_stack([*signal.values(), load])
    whole = np.isfinite(values).all(axis=1)
    if voltage_v is not None:
        whole &= np.isfinite(voltage_v)
    nothing = np.full(load.shape[1], np.nan)
    points = [
        Plateau(
            f"row {row + 1}",
            {name: float(x[row]) for name, x in signal.items()},
            load[row],
            nothing,
            np.nan if voltage_v is None else float(voltage_v[row]),
            1,
        )
        for row in np.flatnonzero(whole)
    ]
    return points, int((~whole).sum())


def _plateau(
    t: Array, signal: Mapping[str, Array], load: Array, voltage_v: Array | None, steady: NDArray[np.int_]
) -> Plateau | None:
    if len(steady) == 0:
        return None
    cells = load[steady]
    counts = np.isfinite(cells).sum(axis=0)
    if counts.min() < _LEAST_SAMPLES:
        return None
    means = {name: _mean(held(x)[steady]) for name, x in signal.items()}
    load_mean, error, drifting = np.zeros(load.shape[1]), np.zeros(load.shape[1]), False
    for axis in range(load.shape[1]):
        samples = cells[np.isfinite(cells[:, axis]), axis]
        load_mean[axis], error[axis] = samples.mean(), standard_error(samples)
        first, second = np.array_split(samples, 2)
        apart = abs(float(first.mean() - second.mean()))
        drifting |= apart > _DRIFT_ERRORS * standard_error(second) and apart > _DRIFT_SHARE * abs(
            load_mean[axis]
        )
    volts = np.nan if voltage_v is None else _mean(held(voltage_v)[steady])
    label = f"{t[steady[0]]:.1f} to {t[steady[-1]]:.1f} s"
    return Plateau(label, means, load_mean, error, volts, int(counts.min()), bool(drifting))


def _mean(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else np.nan


def standard_error(samples: Array) -> float:
    """Standard error of the mean of samples (n,) that remember the one before."""
    n = len(samples)
    centred = samples - samples.mean()
    power = float(centred @ centred)
    if n < 2:
        return 0.0
    return float(
        np.sqrt(power / (n - 1) / n * variance_inflation(lag_one_correlation(centred, most=_MOST_MEMORY)))
    )


def _changes(commands: list[Array]) -> list[int]:
    """Rows at which a command leaves the value that its plateau began with."""
    table = np.column_stack(commands)
    tolerance = _COMMAND_SHARE * np.maximum(np.ptp(table, axis=0), 1e-12)
    starts: list[int] = []
    begin = 0
    for row in 1 + np.flatnonzero((np.diff(table, axis=0) != 0.0).any(axis=1)):
        if (np.abs(table[row] - table[begin]) > tolerance).any():
            begin = int(row)
            starts.append(begin)
    return starts


def _departures(signals: list[Array]) -> list[int]:
    """Rows at which a measured signal leaves the mean of its plateau so far."""
    table = np.column_stack(signals)
    noise = 1.4826 * np.median(np.abs(np.diff(table, axis=0)), axis=0) / np.sqrt(2.0)
    tolerance = np.maximum(_MEASURED_SHARE * np.abs(table).max(axis=0), _NOISES * noise)
    starts: list[int] = []
    mean, count = table[0].copy(), 1
    for row in range(1, len(table)):
        if (np.abs(table[row] - mean) > tolerance).any():
            starts.append(row)
            mean, count = table[row].copy(), 1
        else:
            count += 1
            mean += (table[row] - mean) / count
    return starts
