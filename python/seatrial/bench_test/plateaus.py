"""Steady parts of a load-cell record: one operating point per plateau of the command.

The samples of one plateau err alike (mounting, recirculation in the basin, friction of pulleys), so that each
of them is no new evidence: a plateau counts once, with its mean. The residuals of the regression are then
those between plateaus, and their scatter holds whatever makes a repeated plateau differ.

A plateau begins where a command changes and its first ``settle_s`` are left out. Where no command is logged,
it begins where the measured revolutions leave their mean. A table without time is steady already: every row
is one plateau. The standard error of a plateau's mean allows for samples that correlate with the one before
(`seatrial.statistics.blocks`).

From the load of the whole vehicle to the thrust of a single actuator, by geometry: with b_k the force per
newton of actuator k (upper rows of the allocation matrix) and e_a the axes of the load cell, actuators with
one characteristic and one signal pull ``F_a = sum_k (b_k . e_a) f``:

    f = F / g,  g = sum_k b_k . e                         one axis
    f = (G . F) / (G . G),  G_a = sum_k b_k . e_a         several axes, least squares

over the actuators that ran. Ahead and astern CWolf's four canted propellers give ``F_x / (4 cos a cos b)``,
its vertical thrusters ``F_z / 2`` (Taubert et al. 2014, equations 39-44). Actuators driven one by one are
points of the same characteristic each. A load across G (several axes) is an error of the geometry and is
reported.

Held by ``tests/bench_test/test_bench_records.py`` and ``tests/bench_test/test_bench_separation.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError
from seatrial.statistics.blocks import lag_one_correlation, variance_inflation

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.bench_test.file import Unit


@dataclass(frozen=True)
class PlateauSettings:
    """Which parts of a bench record are steady."""

    fewest_samples: int = 5  #: Fewer steady samples of the load are too few for a mean.
    command_share: float = 0.002  #: Of the range: a command that changes less is jitter of its logging.
    measured_share: float = 0.03  #: Of the largest revolutions: a controller lets them vary by less.
    noises: float = 6.0  #: Deviations of the noise: one sample in a billion leaves a plateau by chance.
    drift_share: float = 0.02  #: Of the load by which a plateau drifts, as `Plateau.drifting` says.
    drift_errors: float = 6.0  #: Standard errors of that drift.
    most_memory: float = 0.95  #: Correlation of neighbours that a plateau of some ten samples can show.
    alike_share: float = 0.1  #: Of the mean signal: actuators that run closer pull together.
    least_factor: float = 0.05  #: N on the cell per newton: below, errors of the geometry are as large.


SETTINGS = PlateauSettings()


@dataclass(frozen=True)
class Plateau:
    """One operating point: per actuator the mean signal, mean load (a,) of each axis of the cell and its
    standard error in N (NaN in a table without time), supply in V (NaN where it is not logged), and so
    many steady samples.

    It is `drifting` where the halves of the load differ by more than six errors of the second one and 2 % of
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
    """Plateaus of a record at times t (n,), and how many were too short to be used.

    Per actuator (n,): `command` ends a plateau (empty where none is logged), `signal` is what the
    characteristic is a function of; `load` (n, axes) in N. NaN stands between samples. The first `settle_s`
    of a plateau are left out.
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
            f"{where}: no steady part: {len(bounds) - 1} plateaus of the command, none with"
            f" {SETTINGS.fewest_samples} samples of the load after {settle_s:g} s; hold each command longer"
            " or lower settle_s"
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
    if counts.min() < SETTINGS.fewest_samples:
        return None
    means = {name: _mean(held(x)[steady]) for name, x in signal.items()}
    load_mean, error, drifting = np.zeros(load.shape[1]), np.zeros(load.shape[1]), False
    for axis in range(load.shape[1]):
        samples = cells[np.isfinite(cells[:, axis]), axis]
        load_mean[axis], error[axis] = samples.mean(), standard_error(samples)
        first, second = np.array_split(samples, 2)
        apart = abs(float(first.mean() - second.mean()))
        drifting |= apart > SETTINGS.drift_errors * standard_error(
            second
        ) and apart > SETTINGS.drift_share * abs(load_mean[axis])
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
        np.sqrt(
            power / (n - 1) / n * variance_inflation(lag_one_correlation(centred, most=SETTINGS.most_memory))
        )
    )


def _changes(commands: list[Array]) -> list[int]:
    """Rows at which a command leaves the value that its plateau began with."""
    table = np.column_stack(commands)
    tolerance = SETTINGS.command_share * np.maximum(np.ptp(table, axis=0), 1e-12)
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
    tolerance = np.maximum(SETTINGS.measured_share * np.abs(table).max(axis=0), SETTINGS.noises * noise)
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


@dataclass(frozen=True)
class Separated:
    """One plateau as a point of a single actuator's characteristic: thrust in N with its standard error from
    the samples; `weights` (a,): thrust per newton on each axis of the cell, as a zero error enters too;
    `factor`: length of G, load per newton of an actuator; `across`: load across G in N.
    """

    signal: float
    thrust: float
    error: float
    weights: Array
    factor: float
    across: float
    running: tuple[str, ...]


def force_per_newton(vehicle: Vehicle, axes: str) -> dict[str, Array]:
    """Force (a,) on the vehicle along the axes (letters of XYZ) per newton of each thruster."""
    rows = ["XYZ".index(letter) for letter in axes]
    return {
        name: np.asarray(facts["wrench"], dtype=float)[rows]
        for name, facts in vehicle.actuator_info().items()
        if facts["kind"] == "thruster"
    }


def separate(
    plateau: Plateau, unit: Unit, geometry: dict[str, Array], *, zero: float, where: str
) -> Separated | None:
    """Point of a plateau without the cell's zero error, None where no actuator of the unit ran; `geometry` is
    that of `force_per_newton`, signals up to `zero` are none. A TrialError where the load determines no
    single thrust.
    """
    running = tuple(name for name in unit.actuators if abs(plateau.signal[name]) > zero)
    if not running:
        return None
    where = f"{where}, {plateau.label}"
    _refuse_others(plateau, unit, geometry, zero, where)
    signals = np.array([plateau.signal[name] for name in running])
    total = np.sum([geometry[name] for name in running], axis=0)
    # Thrust goes by the square of the signal: so does the mean.
    mean = float(np.sqrt(np.mean(signals**2)) * np.sign(signals[0]))
    if (np.abs(signals - mean) > SETTINGS.alike_share * abs(mean)).any():
        raise TrialError(
            f"{where}: {_spoken(running, signals, unit)} pull with different signals, so that their sum"
            " determines no single thrust; drive them alike, or one by one"
        )
    length = float(np.linalg.norm(total))
    if length < SETTINGS.least_factor:
        raise TrialError(
            f"{where}: {', '.join(running)} together give {length:.2g} N along the load cell per newton of"
            " each: their forces cancel or act across it; check axis and direction of the pull"
        )
    # Least squares of one thrust over the axes of the cell: G / (G . G).
    weights = total / length**2
    thrust = float(weights @ plateau.load)
    return Separated(
        signal=mean,
        thrust=thrust,
        error=float(np.linalg.norm(weights * plateau.error)),
        weights=weights,
        factor=length,
        across=float(np.linalg.norm(plateau.load - total * thrust)),
        running=running,
    )


def _refuse_others(plateau: Plateau, unit: Unit, geometry: dict[str, Array], zero: float, where: str) -> None:
    others = [
        name
        for name, signal in plateau.signal.items()
        if name not in unit.actuators and abs(signal) > zero and np.abs(geometry[name]).max() > 1e-6
    ]
    if others:
        raise TrialError(
            f"{where}: {', '.join(others)} ran as well and act along the load cell; test {unit.name} alone"
        )


def _spoken(names: Sequence[str], signals: Array, unit: Unit) -> str:
    return ", ".join(f"{name} {x:+.0f} {unit.command}" for name, x in zip(names, signals, strict=True))
