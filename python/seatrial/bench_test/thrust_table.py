"""Measured thrust as a table over signal and voltage: straight lines between knots, by least squares.

The vehicle's table is read linearly between its knots, so the thrust at the knots is the least squares fit
of that very interpolation, ``F(s) = sum_j h_j(s) f_j`` with hat functions h_j, for each voltage apart. A weak
penalty on the second difference carries knots between which a voltage has no points. Knots are chosen from
the tested signals, one grid for all voltages: the two ends, the edges of the dead band, where thrust is
exactly zero, then the middle of the interval where a knot takes away most squared error, until no point lies
further off than the tolerance or there are as many knots as allowed.

A polynomial in signal and voltage becomes a table too (`from_surface`): the vehicle file has no other kind
that knows the voltage.

Tests: ``tests/bench_test/test_bench_table.py``, ``tests/bench_test/test_bench_t200.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError


@dataclass(frozen=True)
class ThrustTableSettings:
    """How a table of thrust over voltage is made of points."""

    level_gap_v: float = 0.1  #: V between two levels of a supply: its ripple is smaller.
    most_levels: int = 25  #: More are a supply that drifts.
    tolerance: float = 0.01  #: Of the largest thrust: what a load cell can tell.
    silent_share: float = 0.002  #: Of the largest thrust: less is none.
    at_rest: float = 0.25  #: Of the tolerance, at zero thrust: weak points are known more exactly.
    stiffness: float = 1e-3  #: Of a point's weight: bridges gaps and moves no point.


SETTINGS = ThrustTableSettings()


@dataclass(frozen=True, eq=False)
class ThrustTable:
    """Thrust over signal and supply voltage.

    Attributes
    ----------
    signal
        Knots (k,) in the command's unit from neutral.
    voltage_v
        Levels (v,) in V; empty when measured at one.
    force
        (v, k) or (1, k) in N.
    level
        (n,) row of ``force`` to which each point belongs; of a surface, the nearest.
    residual
        (n,) measured minus table, N.
    dead_band
        Signals (lower, upper) between which no point pulled; zeros where there is none.
    """

    signal: Array
    voltage_v: Array
    force: Array
    level: NDArray[np.int_]
    residual: Array
    dead_band: tuple[float, float]

    def at(self, signal: Array, voltage_v: Array | None = None) -> Array:
        """Thrust (m,) in N, bilinear, held beyond the edges."""
        rows = np.array([self.force_at(row, signal) for row in range(len(self.force))])
        if len(rows) == 1 or voltage_v is None:
            return np.asarray(rows[0])
        position = np.interp(voltage_v, self.voltage_v, np.arange(len(self.voltage_v)))
        low = np.minimum(position.astype(int), len(rows) - 2)
        share = position - low
        every = np.arange(rows.shape[1])
        return np.asarray((1.0 - share) * rows[low, every] + share * rows[low + 1, every])

    def force_at(self, row: int, signal: Array) -> Array:
        """Thrust (m,) in N at the voltage of a row."""
        return np.asarray(np.interp(signal, self.signal, self.force[row]))

    def errors(self) -> list[dict[str, float]]:
        """Per voltage its points, root mean square and largest residual in N."""
        errors = []
        for row in range(len(self.force)):
            own = self.residual[self.level == row]
            if len(own):
                errors.append({
                    "voltage_v": float(self.voltage_v[row]) if len(self.voltage_v) else np.nan,
                    "points": float(len(own)),
                    "rms_n": float(np.sqrt(np.mean(own**2))),
                    "largest_n": float(np.abs(own).max()),
                })
        return errors


def levels(voltage_v: Array, where: str) -> tuple[Array, NDArray[np.int_]]:
    """Voltages (v,) at which was tested, from those of the points (n,), and the level of each point.

    A `TrialError` where the voltage drifts instead of standing at levels, or is unknown.

    Examples
    --------
    >>> levels(np.array([12.0, 16.0, 12.05, 15.96]), "thruster")[0].tolist()
    [12.025, 15.98]
    """
    if not np.isfinite(voltage_v).all():
        raise TrialError(
            f"{where}: the supply voltage is not known at every point; map a column voltage_v, give"
            ' voltage_v, or leave "voltage" out of the inputs'
        )
    order = np.argsort(voltage_v)
    level = np.empty(len(voltage_v), dtype=int)
    level[order] = np.concatenate([[0], np.cumsum(np.diff(voltage_v[order]) > SETTINGS.level_gap_v)])
    means = np.array([voltage_v[level == k].mean() for k in range(level.max() + 1)])
    widths = np.array([np.ptp(voltage_v[level == k]) for k in range(level.max() + 1)])
    if len(means) > SETTINGS.most_levels or (widths > 5.0 * SETTINGS.level_gap_v).any():
        raise TrialError(
            f"{where}: the supply voltage has no distinct levels (it runs from {voltage_v.min():.2f} to"
            f' {voltage_v.max():.2f} V); use order = 2 with inputs = ["signal", "voltage"], whose surface'
            " needs none"
        )
    return means, level


def from_points(
    signal: Array, thrust: Array, voltage_v: Array | None, *, knots: int, tolerance: float | None, where: str
) -> ThrustTable:
    """Table of the points (n,) themselves, with at most so many knots.

    No further knot is added where the table errs by `tolerance` in N or less at the largest thrust, a quarter
    of it at rest; one per cent of the largest thrust when omitted. Raises TrialError, its message begun with
    `where`, for fewer than four different signals, or no levels of voltage.
    """
    means, level = (
        (np.zeros(1), np.zeros(len(signal), dtype=int)) if voltage_v is None else levels(voltage_v, where)
    )
    distinct = np.unique(signal)
    if len(distinct) < 4:
        raise TrialError(f"{where}: a table needs at least 4 different signals, found {len(distinct)}")
    largest = float(np.abs(thrust).max())
    if largest == 0.0:
        raise TrialError(f"{where}: no point has any thrust; check the load's column")
    goal = SETTINGS.tolerance * largest if tolerance is None else tolerance
    allowed = goal * (SETTINGS.at_rest + (1.0 - SETTINGS.at_rest) * np.abs(thrust) / largest)
    silent = dead_band(signal, thrust)
    # Held beyond its ends, a table of one direction alone would push at rest, too: it begins at zero.
    lowest, highest = min(float(distinct[0]), 0.0), max(float(distinct[-1]), 0.0)
    edges = [x for x in (silent if silent[0] < silent[1] else (0.0,)) if lowest < x < highest]
    chosen = sorted({lowest, *edges, highest})
    while True:
        grid = np.array(chosen)
        force = np.array([
            _hats(signal[level == k], thrust[level == k], grid, silent) for k in range(len(means))
        ])
        fitted = np.empty(len(signal))
        for k in range(len(means)):
            fitted[level == k] = np.interp(signal[level == k], grid, force[k])
        residual = thrust - fitted
        knot = _next_knot(signal, level, residual / allowed, distinct, grid, silent)
        if knot is None or len(chosen) >= knots:
            break
        chosen = sorted({*chosen, knot})
    return ThrustTable(grid, means if voltage_v is not None else np.zeros(0), force, level, residual, silent)


def from_surface(
    thrust_at: Callable[[Array, Array], Array],
    signal: Array,
    thrust: Array,
    voltage_v: Array | None,
    *,
    grid: Sequence[float],
    voltages: Sequence[float],
) -> ThrustTable:
    """Table of a fitted function of signal and voltage on a grid, with its residuals at the points (n,)."""
    knots = np.asarray(grid, dtype=float)
    volts = np.asarray(voltages, dtype=float)
    force = np.array([thrust_at(knots, np.full(len(knots), v)) for v in (volts if len(volts) else [np.nan])])
    made = ThrustTable(knots, volts, force, np.zeros(len(signal), int), np.zeros(len(signal)), (0.0, 0.0))
    level = (
        made.level
        if voltage_v is None or not len(volts)
        else np.abs(voltage_v[:, None] - volts).argmin(axis=1)
    )
    return ThrustTable(knots, volts, force, level, thrust - made.at(signal, voltage_v), (0.0, 0.0))


def dead_band(signal: Array, thrust: Array) -> tuple[float, float]:
    """Widest interval of the signal about zero in which no point pulls; zeros when there is none.

    What is below 0.2 % of the largest thrust is none.

    Examples
    --------
    >>> signal = np.array([-60.0, -40.0, -20.0, 0.0, 20.0, 40.0, 60.0])
    >>> dead_band(signal, np.array([-8.0, -2.0, 0.0, 0.0, 0.0, 0.0, 4.0]))
    (-20.0, 40.0)
    """
    pulling = np.abs(thrust) > SETTINGS.silent_share * np.abs(thrust).max(initial=0.0)
    below, above = signal[pulling & (signal < 0.0)], signal[pulling & (signal > 0.0)]
    quiet = signal[~pulling & (signal != 0.0)]
    lower = quiet[quiet > below.max(initial=-np.inf)].min(initial=0.0)
    upper = quiet[quiet < above.min(initial=np.inf)].max(initial=0.0)
    return float(min(lower, 0.0)), float(max(upper, 0.0))


def _hats(signal: Array, thrust: Array, grid: Array, silent: tuple[float, float]) -> Array:
    """Thrust (k,) at the knots: least squares of the linear interpolation, zero inside the dead band."""
    from scipy.optimize import lsq_linear

    position = np.interp(signal, grid, np.arange(len(grid)))
    low = np.minimum(position.astype(int), len(grid) - 2)
    share = position - low
    matrix = np.zeros((len(signal), len(grid)))
    rows = np.arange(len(signal))
    matrix[rows, low] = 1.0 - share
    matrix[rows, low + 1] += share
    width = np.diff(grid) / np.ptp(grid)
    bend = np.zeros((len(grid) - 2, len(grid)))
    for j in range(len(bend)):
        bend[j, j : j + 3] = 1.0 / width[j], -1.0 / width[j] - 1.0 / width[j + 1], 1.0 / width[j + 1]
        bend[j] *= SETTINGS.stiffness * min(width[j], width[j + 1])
    free = (grid < silent[0]) | (grid > silent[1])
    if silent == (0.0, 0.0):
        free = grid != 0.0  # no signal, no thrust
    solved = np.zeros(len(grid))
    stacked = np.vstack([matrix, bend])[:, free]
    target = np.concatenate([thrust, np.zeros(len(bend))])
    # Noise at the edge of a dead band must not turn the thrust round.
    ahead = grid[free] > 0.0
    bounds = (np.where(ahead, 0.0, -np.inf), np.where(ahead, np.inf, 0.0))
    if (thrust * signal).sum() < 0.0:
        bounds = (-bounds[1], -bounds[0])
    solved[free] = lsq_linear(stacked, target, bounds).x
    solved[np.abs(solved) < 1e-6 * np.abs(thrust).max(initial=0.0)] = 0.0
    return solved


def _next_knot(
    signal: Array,
    level: NDArray[np.int_],
    error: Array,
    distinct: Array,
    grid: Array,
    silent: tuple[float, float],
) -> float | None:
    """Tested signal in the middle of the interval where a knot gains most; None when no error is above one.

    The gain is the squared error that a bump over the interval takes away, at all voltages: chords of a
    curve have much of it, noise has little.
    """
    if np.abs(error).max() <= 1.0:
        return None
    gains = np.zeros(len(grid) - 1)
    for j, (lower, upper) in enumerate(pairwise(grid)):
        bump = np.maximum(1.0 - np.abs(2.0 * signal - lower - upper) / (upper - lower), 0.0)
        for k in range(level.max() + 1):
            own = bump[level == k]
            gains[j] += float(own @ error[level == k]) ** 2 / max(float(own @ own), 1e-12)
    for j in np.argsort(-gains):
        lower, upper = grid[j], grid[j + 1]
        if silent[0] <= lower and upper <= silent[1]:
            continue
        inside = distinct[(distinct > lower) & (distinct < upper)]
        if len(inside) and gains[j] > 0.0:
            return float(inside[np.abs(inside - 0.5 * (lower + upper)).argmin()])
    return None
