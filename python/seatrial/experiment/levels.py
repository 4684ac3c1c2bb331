"""Excitation signals: levels from -1 to 1 over time, which an actuator combination turns into thrusts.

All are pure functions of times (n,) in s from zero on and of the duration; they end at zero. Zigzag and
spiral are those of ships' trials, but switched by time, because nothing steers.

Sources: ITTC 7.5-04-02-01, *Full scale manoeuvring trials*, 2.2.2 and 2.2.5; Schroeder, *Synthesis of
low-peak-factor signals and binary sequences with low autocorrelation*, IEEE Trans. Inf. Theory 16:85 (1970);
Van der Ouderaa, Schoukens, Renneboog, *Peak factor minimization using a time-frequency domain swapping
algorithm*, IEEE Trans. Instrum. Meas. 37:145 (1988). Held by ``tests/experiment/test_manoeuvre.py``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import VehicleError

RATE_HZ = 10.0
"""Samples of commands per second."""


def times(duration_s: float) -> Array:
    """Uniform times (n,) in s from zero to the duration, both included; at least a second."""
    if not (np.isfinite(duration_s) and duration_s >= 1.0):
        raise VehicleError(f"duration: expected at least one second, found {duration_s:g} s")
    return np.arange(round(duration_s * RATE_HZ) + 1) / RATE_HZ


def held_levels(t: Array, levels: Sequence[float], ends: Sequence[float]) -> Array:
    """Levels (n,), each held until its end in s; zero after the last.

    Examples
    --------
    >>> held_levels(np.arange(5.0), [1.0, -1.0], [2.0, 4.0])
    array([ 1.,  1., -1., -1.,  0.])
    """
    index = np.searchsorted(np.asarray(ends) - 1e-9, t, side="right")
    return np.append(np.asarray(levels, dtype=float), 0.0)[index]


def staircase_levels(t: Array, duration_s: float, *, steps: int = 4, both: bool = True) -> Array:
    """Levels (n,) that rise in equal steps and drop to zero, then the same with the other sign if `both`."""
    rise = [*np.arange(1, steps + 1) / steps, 0.0]
    levels = [0.0, *rise, *(-level for level in rise)] if both else [0.0, *rise]
    return _even(t, levels, duration_s)


def coast_down_levels(
    t: Array, duration_s: float, *, both: bool = True, levels: Sequence[float] = (1.0, 0.5)
) -> Array:
    """Levels (n,): driven, then nothing for as long, at each level; if `both` with either sign."""
    cycles: list[float] = []
    for level in levels:
        cycles += [level, 0.0, -level, 0.0] if both else [level, 0.0]
    return _even(t, [0.0, *cycles], duration_s, weights=[0.25, *[1.0] * len(cycles)])


def zigzag_levels(t: Array, duration_s: float, *, switch_s: float) -> Array:
    """Levels (n,) +1 and -1 in turn: first for half the switching time, then for all of it, half at the end.

    What it turns is turned back: the sum of the levels is zero.
    """
    whole = max(int(duration_s / max(switch_s, 4.0)), 2)  # levels are held no shorter than 4 s
    signs = [(-1.0) ** k for k in range(whole + 1)]
    weights = [0.5, *[1.0] * (whole - 1), 0.5]
    if whole % 2:  # an even number of halves, so that the signs cancel
        signs, weights = signs[:-1], [0.5, *[1.0] * (whole - 2), 0.5]
    return _even(t, signs, duration_s, weights=weights)


def spiral_levels(t: Array, duration_s: float, *, steps: int = 3) -> Array:
    """Levels (n,) from zero through +1/steps ... +1 and, the other way round, -1/steps ... -1."""
    rise = np.arange(1, steps + 1) / steps
    return _even(t, [0.0, *rise, *-rise], duration_s)


def multisine_levels(
    t: Array, duration_s: float, *, band_hz: tuple[float, float] = (0.02, 0.25), of: int = 1, index: int = 0
) -> Array:
    """Levels (n,) of a sum of sines between two frequencies, largest level one, amplitude as 1/sqrt(f).

    Schroeder's phases, then a few rounds of clipping, keep the crest low. The signal repeats after
    `duration_s`. Of several signals at once (`of`) each has its own harmonics of the duration (`index`), so
    that no two are correlated.
    """
    lowest = max(int(np.ceil(band_hz[0] * duration_s)), 1)
    highest = max(int(band_hz[1] * duration_s), lowest + 2 * of)
    lines = np.arange(lowest + index, highest + 1, of)
    power = 1.0 / lines
    power = power / power.sum()
    phases = -2.0 * np.pi * (np.cumsum(np.cumsum(power)) - np.cumsum(power))
    fine = np.arange(16 * highest) / (16 * highest)
    turns = np.exp(2j * np.pi * np.outer(lines, fine))
    size = np.sqrt(power)
    for _ in range(40):  # rounds of clipping
        signal = (size[:, None] * np.real(np.exp(1j * phases)[:, None] * turns)).sum(axis=0)
        # Clip what stands out and keep the phases of what is left (Van der Ouderaa).
        clipped = np.clip(signal, -0.85 * np.abs(signal).max(), 0.85 * np.abs(signal).max())
        phases = np.angle((turns.conj() * clipped).sum(axis=1))
    at = 2.0 * np.pi * np.outer(t / duration_s, lines)
    levels = np.cos(at + phases) @ size
    return np.asarray(
        np.where(t < duration_s - 1e-9, levels / max(np.abs(signal).max(), np.abs(levels).max()), 0.0)
    )


def _even(
    t: Array, levels: Sequence[float], duration_s: float, *, weights: Sequence[float] | None = None
) -> Array:
    """Levels held for equal times, or times in the ratio of the weights, that fill the duration."""
    shares = np.ones(len(levels)) if weights is None else np.asarray(weights, dtype=float)
    return held_levels(t, levels, np.cumsum(shares) / shares.sum() * duration_s)
