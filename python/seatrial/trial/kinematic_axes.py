"""Which recorded channel shows which axis, with which sign, unit and rough delay: by correlation.

Two vectors are compared in the band that both show, lag by lag; the lag at which they share most, whatever
the signs, is the rough delay, and the signed permutation with the largest sum of correlations the assignment.
It is changed only where the recorded one fits badly and the other well. A ratio of sizes that is that of a
known unit is one. Held by ``tests/intake/test_consistency.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import DEGREE
from seatrial.trial.kinematic_fit import Grid

__all__ = ["UNITS", "Assignment", "alone", "assigned", "band", "lagged", "unit_of"]

UNITS: Mapping[str, Mapping[str, float]] = {
    "velocity": {"mm/s": 1e-3, "cm/s": 1e-2, "km/h": 1.0 / 3.6, "knot": 1852.0 / 3600.0, "ft/s": 0.3048},
    "rates": {"deg/s": DEGREE, "mrad/s": 1e-3, "rpm": np.pi / 30.0},
    "depth": {"ft": 0.3048, "cm": 1e-2, "mm": 1e-3, "fathom": 1.8288},
}
"""Units other than SI that recordings have, by their size in SI."""

_SLOWEST_S = 10.0  # slower changes are offsets and drifts

_FITS, _FAILS = 0.6, 0.2  # mean correlation of an assignment that is believed, and of one that is not

_TOLERANCE, _WIDE, _FAR = (
    0.12,
    0.4,
    20.0,
)  # how far a ratio may be off that of a unit, and off that of a far one

_SPIKE = 4.0  # times what three quarters of the samples do not reach

_APART_S, _TOGETHER_S = 2.0, 10.0  # delays that are different ones; blocks of motion that are compared

_CLEARLY = 2.5  # deviations by which a delay must follow better than any other

_OFF = 1.25  # ratios closer to one than this are not for units


@dataclass(frozen=True)
class Assignment:
    """Delay in s, recorded channel and sign by true channel, correlation of each, and the ratio of sizes."""

    delay: float
    axes: dict[str, tuple[str, float]]
    correlation: dict[str, float]
    ratio: float

    @property
    def changed(self) -> dict[str, tuple[str, float]]:
        """The entries that are not as recorded."""
        return {name: entry for name, entry in self.axes.items() if entry != (name, 1.0)}


def band(y: Array, good: Mask, grid: Grid) -> Array:
    """Changes of values (n, k) that are faster than slow offsets, without spikes, zero where not known."""
    from scipy.ndimage import gaussian_filter1d

    filled = np.where(good[:, None], y, np.nan_to_num(np.median(y[good], axis=0)) if good.any() else 0.0)
    slow = gaussian_filter1d(filled, max(_SLOWEST_S, 6.0 * grid.width) / grid.step, axis=0, mode="nearest")
    fast = np.where(good[:, None], filled - slow, 0.0)
    # Spikes of bad samples would make up the whole correlation: beyond some deviations of the usual.
    usual = np.quantile(np.abs(fast[good]), 0.75, axis=0) if good.any() else np.zeros(y.shape[1])
    most = np.where(usual > 0.0, _SPIKE * usual, np.inf)
    return np.asarray(np.clip(fast, -most, most))


def lagged(reference: Array, shown: Array, step: float, most: float) -> tuple[float, Array]:
    """Delay of `shown` (n, j) behind `reference` (n, k) within `most` s, and their correlations (k, j)."""
    from scipy.fft import irfft, next_fast_len, rfft

    n, reach = len(reference), max(1, round(most / step))
    size = next_fast_len(n + reach + 1, real=True)
    a, b = rfft(reference, size, axis=0), rfft(shown, size, axis=0)
    across = irfft(np.conj(a)[:, :, None] * b[:, None, :], size, axis=0)
    energy = np.sqrt(np.outer(np.sum(reference**2, axis=0), np.sum(shown**2, axis=0))) + 1e-300
    lags = np.concatenate([np.arange(reach + 1), np.arange(-reach, 0)])
    found = across[lags] / energy
    best = int(np.argmax(np.sum(found**2, axis=(1, 2))))
    return float(lags[best] * step), found[best]


def alone(reference: Array, shown: Array, step: float, delay: float, most: float) -> float | None:
    """Another delay in s at which `shown` (n, k) may as well follow `reference` (n, k); None without one.

    Both are bands of equal axes and signs. The products at the best delay and at the best other one are
    summed over blocks of time: the first is taken if their difference is clearly above zero.
    """
    from scipy.fft import irfft, next_fast_len, rfft

    n, reach = len(reference), max(1, round(most / step))
    size = next_fast_len(n + reach + 1, real=True)
    a, b = rfft(reference, size, axis=0), rfft(shown, size, axis=0)
    across = irfft(np.sum(np.conj(a) * b, axis=1), size)
    lags = np.concatenate([np.arange(reach + 1), np.arange(-reach, 0)])
    here = round(delay / step)
    far = np.abs(lags - here) * step > _APART_S
    if not far.any():
        return None
    other = int(lags[far][np.argmax(across[lags[far]])])
    t = np.arange(n)
    gain = np.sum(
        reference * (shown[np.clip(t + here, 0, n - 1)] - shown[np.clip(t + other, 0, n - 1)]), axis=1
    )
    inside = (t + min(here, other) >= 0) & (t + max(here, other) < n)
    blocks = (t[inside] * step / max(_TOGETHER_S, n * step / 60.0)).astype(int)
    sums = np.bincount(blocks, gain[inside])
    sums = sums[np.bincount(blocks) > 0]
    certain = len(sums) > 2 and sums.mean() > _CLEARLY * sums.std(ddof=1) / np.sqrt(len(sums))
    return None if certain else float(other * step)


def assigned(
    names: Sequence[str], reference: Array, shown: Array, good: Mask, grid: Grid, most: float
) -> Assignment | None:
    """Assignment of the recorded channels `names` with values `shown` (n, k) to those of `reference` (n, k).

    None where they share too little to tell a delay.
    """
    a, b = band(reference, good, grid), band(shown, good, grid)
    delay, rho = lagged(a, b, grid.step, most)
    excited = np.abs(rho).max(axis=1) > _FITS
    if not excited.any():
        return None
    own = np.where(excited, np.diag(rho), 0.0)
    order: tuple[int, ...] = tuple(range(len(names)))
    signs: tuple[float, ...] = (1.0,) * len(names)
    most_fitting = float(np.sum(own))
    for other in permutations(range(len(names))):
        for senses in product((1.0, -1.0), repeat=len(names)):
            fit = float(np.sum(np.where(excited, np.array(senses) * rho[range(len(names)), other], 0.0)))
            if fit > most_fitting + 1e-9:
                order, signs, most_fitting = other, senses, fit
    axes: dict[str, tuple[str, float]] = {name: (name, 1.0) for name in names}
    changed = [k for k in range(len(names)) if order[k] != k or signs[k] < 0.0]
    fits = [signs[k] * rho[k, order[k]] for k in changed if excited[k]]
    fails = [own[k] for k in changed if excited[k]]
    if fits and min(fits) > _FITS and max(fails) < min(_FAILS, min(fits) - 0.5):
        # What is not excited keeps its place unless another channel took it.
        axes |= {names[k]: (names[order[k]], float(signs[k])) for k in changed if excited[k] or order[k] != k}
    correlation = {
        name: float(axes[name][1] * rho[k, names.index(axes[name][0])]) for k, name in enumerate(names)
    }
    sure = [k for k, name in enumerate(names) if excited[k] and correlation[name] > _FITS]
    taken = [names.index(axes[names[k]][0]) for k in sure]
    size = float(np.sqrt(np.sum(b[:, taken] ** 2) / max(float(np.sum(a[:, sure] ** 2)), 1e-300)))
    return Assignment(delay, axes, correlation, size if sure else 1.0)


def unit_of(ratio: float, kind: str) -> tuple[str, float] | None:
    """Unit and its size in SI that explain a size of `ratio` times the reference; None near one or unknown.

    Examples
    --------
    >>> unit_of(985.0, "velocity"), unit_of(1.1, "velocity")
    (('mm/s', 0.001), None)
    """
    if not ratio > 0.0 or 1.0 / _OFF < ratio < _OFF:
        return None
    for name, x in UNITS[kind].items():
        far = x < 1.0 / _FAR or x > _FAR  # no other unit is near: noise may make up a part of the size
        if abs(ratio * x - 1.0) < (_WIDE if far else _TOLERANCE):
            return name, x
    return None
