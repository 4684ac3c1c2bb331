"""The margin engine: phase, gain both ways, delay, sensitivity and disk margin of linear loops.

Everything that tells or limits a margin asks here: `seatrial autopilot`, start gains, the regulator, the
constraint of a tuning and its report. One candidate or thousands, the steps are the same:

1. What the law sees of the sampled motion, (zI - Phi)^-1 Gamma, at each frequency (`loops.responses`).
2. L = K (zI - Phi)^-1 Gamma, of which each row is opened alone, the others closed:
   L_i = 1/[(I + L)^-1]_ii - 1 (`open_each`).
3. Crossings of |L_i| = 1 and of the negative real axis, placed between two frequencies by the logarithm of
   L_i (`loop_margins`). A loop L crosses |L| = 1 at a phase margin, which over its frequency is a delay
   margin, and the negative real axis at a gain margin: upwards where |L| < 1, downwards where |L| > 1 (a
   conditionally stable loop).

0.2 ms for one loop and 0.01 ms each in a batch. For a report `refined_margins` divides each interval with a
crossing further, until what is printed does not change.

Sources: Åström and Hägglund, *Advanced PID Control* (2006), section 4.4; Seiler, Packard and Gahinet (2020),
*An introduction to disk margins*, IEEE Control Systems 40(5). Held against python-control by
tests/control_design/test_margin_engine.py.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.base.arrays import Array
from seatrial.control_design.loops import Sampled, closed, feedback, responses
from seatrial.control_design.tuning_table import ACCEPTED

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class MarginSettings:
    """How finely responses are looked at, and what counts as neutral."""

    #: Number of frequencies over about four decades: neighbours differ by 2 to 3 %, and minima are refined.
    frequencies: int = 400
    #: Last frequency of a report over half the sampling rate, at which every response is real and is looked
    #: at by itself.
    nyquist_share: float = 0.9999
    #: Divisions of an interval with a crossing: its place is then known to 1e-7 of its frequency.
    crossing_divisions: int = 64
    #: Time, s, in which a motion must double to count as unstable: slower growth is neutral.
    neutral_doubling_s: float = 3600.0
    imaginary_rounding: float = 1e-9  #: Imaginary part, as a share of the size, that is rounding.


SETTINGS = MarginSettings()

_TINY = 1e-300  # keeps a division by zero finite


@dataclass(frozen=True, eq=False)
class LoopMargins:
    """Margins of loops, each array of the loops' shape, and the frequencies where they are met; inf (phase:
    180 deg) and NaN where nothing is crossed.

    The phase margin is the least angle between -1 and a crossing of the unit circle; gain margins are factors
    above one, upwards (`gain`) and downwards (`reduction`); `sensitivity` is the largest size of 1/(1 + L).
    They are distances from the edge of stability and tell nothing about the side: an unstable loop has
    margins, too.
    """

    phase_deg: Array
    phase_rad_s: Array
    gain: Array
    gain_rad_s: Array
    reduction: Array
    reduction_rad_s: Array
    delay_s: Array
    delay_rad_s: Array
    sensitivity: Array

    @classmethod
    def joined(cls, parts: list[LoopMargins]) -> LoopMargins:
        """Margins of batches of loops, one after another along the first axis."""
        return cls(*(np.concatenate([getattr(part, of.name) for part in parts]) for of in fields(cls)))


def loop_margins(loops: Complex, omega: Array) -> LoopMargins:
    """Margins of loops (..., F) from their responses at rising frequencies omega (F,) in rad/s, the last of
    sampled loops half the sampling rate, where a real response below zero crosses the negative real axis.

    Examples
    --------
    >>> omega = np.geomspace(0.1, 10.0, 400)
    >>> found = loop_margins(1.0 / (1j * omega) * np.exp(-0.5j * omega), omega)
    >>> round(float(found.phase_deg), 1), round(float(found.gain), 2), round(float(found.delay_s), 2)
    (61.4, 3.14, 1.07)
    """
    shape = loops.shape[:-1]
    flat = loops.reshape(-1, loops.shape[-1])
    distance = (1.0 + flat.real) ** 2 + flat.imag**2
    with np.errstate(divide="ignore"):
        sensitivity = 1.0 / np.sqrt(distance.min(axis=1))
    phase, delay, gain, reduction = (_Least(len(flat), none) for none in (180.0, np.inf, np.inf, np.inf))

    def between(at: NDArray[np.intp], share: Array) -> Array:
        return np.asarray(omega[at] * (omega[at + 1] / omega[at]) ** share)

    # Crossings of the unit circle.
    loud = flat.real**2 + flat.imag**2 >= 1.0
    case, at = np.nonzero(loud[:, 1:] != loud[:, :-1])
    size, angle, change = _steps(flat, case, at)
    share = size / np.where(change.real == 0.0, 1.0, -change.real)
    over = angle + share * change.imag  # above -180 deg
    over = (over + np.pi) % (2.0 * np.pi) - np.pi
    crossing = between(at, share)
    phase.take(case, np.abs(np.rad2deg(over)), crossing)
    delay.take(case, (over % (2.0 * np.pi)) / crossing, crossing)

    # Crossings of the negative real axis.
    above = flat.imag >= 0.0
    case, at = np.nonzero(above[:, 1:] != above[:, :-1])
    size, angle, change = _steps(flat, case, at)
    met = (angle < 0.0) != (angle + change.imag < 0.0)
    case, at, size, angle, change = case[met], at[met], size[met], angle[met], change[met]
    share = -angle / np.where(change.imag == 0.0, 1.0, change.imag)
    crossed = size - angle / np.where(change.imag == 0.0, 1.0, change.imag) * change.real
    crossing, up = between(at, share), crossed < 0.0
    gain.take(case[up], np.exp(-crossed[up]), crossing[up])
    reduction.take(case[~up], np.exp(crossed[~up]), crossing[~up])

    # A sampled loop is real at half the sampling rate: a pole may leave through z = -1.
    end = flat[:, -1]
    at_edge = np.nonzero((np.abs(end.imag) <= SETTINGS.imaginary_rounding * np.abs(end)) & (end.real < 0.0))[
        0
    ]
    size = np.abs(end[at_edge])
    up, edge = size < 1.0, np.full(len(at_edge), omega[-1])
    gain.take(at_edge[up], 1.0 / np.maximum(size[up], _TINY), edge[up])
    reduction.take(at_edge[~up], size[~up], edge[~up])
    least = [array for of in (phase, gain, reduction, delay) for array in (of.value, of.rad_s)]
    return LoopMargins(*(array.reshape(shape) for array in (*least, np.maximum(sensitivity, 1.0))))


class _Least:
    """Least value per loop and the frequency where it is met."""

    def __init__(self, loops: int, none: float) -> None:
        self.value, self.rad_s = np.full(loops, none), np.full(loops, np.nan)

    def take(self, case: NDArray[np.intp], values: Array, rad_s: Array) -> None:
        """Take over values of some loops (each as often as it likes) where they are less."""
        before = self.value[case]
        np.minimum.at(self.value, case, values)
        met = (values == self.value[case]) & (values < before)
        self.rad_s[case[met]] = rad_s[met]


def _steps(loops: Complex, case: NDArray[np.intp], at: NDArray[np.intp]) -> tuple[Array, Array, Complex]:
    """Logarithm of |L|, angle from the negative real axis, and the change of both to the next frequency."""
    with np.errstate(divide="ignore"):
        here, there = np.log(-loops[case, at]), np.log(-loops[case, at + 1])
    change = there - here
    change.imag = (change.imag + np.pi) % (2.0 * np.pi) - np.pi
    return here.real, here.imag, change


def disk_margin(loops: Complex) -> Array:
    """Balanced disk margin (...) of loops (..., F): 2 min |1 + L|/|1 - L| over the frequencies."""
    return np.asarray(2.0 * (np.abs(1.0 + loops) / np.abs(1.0 - loops)).min(axis=-1))


def open_each(loop: Complex) -> Complex:
    """Each row of loops (n, n, ...) opened alone, the others closed: (n, ...). Overwrites ``loop``: L_i =
    1/[(I + L)^-1]_ii - 1, by Gauss and Jordan in place, all trailing axes together.
    """
    n = len(loop)
    rows = range(n)
    loop[rows, rows] += 1.0
    for pivot in rows:
        inverse = 1.0 / loop[pivot, pivot]
        loop[pivot, pivot] = 1.0
        loop[pivot] *= inverse
        for row in rows:
            if row != pivot:
                factor = loop[row, pivot].copy()
                loop[row, pivot] = 0.0
                loop[row] -= factor * loop[pivot]
    opened: Complex = 1.0 / loop[rows, rows] - 1.0
    return opened


def frequencies(period_s: float, count: int = SETTINGS.frequencies) -> Array:
    """Frequencies (count,) in rad/s, even by their logarithm, from 0.001 rad/s to half the sampling rate."""
    return np.geomspace(1e-3, np.pi / period_s, count)


@dataclass(frozen=True)
class LawMargins:
    """Largest closed-loop |eigenvalue| per step, and margins of one row or the least over the rows: phase in
    deg, gain upwards as a factor, delay in s; ``sensitivity`` is the largest |1/(1 + L)|.
    """

    radius: float
    phase_deg: float
    gain: float
    delay_s: float
    sensitivity: float

    @property
    def stable(self) -> bool:
        """Whether every motion dies away."""
        return self.radius < 1.0


def law_margins(of: Sampled, gain: Array) -> dict[str, LawMargins]:
    """Margins of the law K (6, 15) per row: opened alone at the vehicle's input, the others closed."""
    omega = frequencies(of.period_s)
    margins, radius = loop_margins(_opened(of, gain)(omega), omega), spectral_radius(of, gain)
    return {
        name: LawMargins(
            radius,
            phase_deg=float(margins.phase_deg[row]),
            gain=float(margins.gain[row]),
            delay_s=float(margins.delay_s[row]),
            sensitivity=float(margins.sensitivity[row]),
        )
        for row, name in enumerate(of.rows)
    }


def least_margins(of: Sampled, gain: Array) -> LawMargins:
    """Least margins of the law K (6, 15) over the rows, each opened alone at the vehicle's input."""
    return least_of(law_margins(of, gain).values())


def least_of(rows: Collection[LawMargins]) -> LawMargins:
    """Least margins of some rows."""
    return LawMargins(
        radius=max(row.radius for row in rows),
        phase_deg=min(row.phase_deg for row in rows),
        gain=min(row.gain for row in rows),
        delay_s=min(row.delay_s for row in rows),
        sensitivity=max(row.sensitivity for row in rows),
    )


def refined_margins(of: Sampled, gain: Array) -> tuple[LoopMargins, Array]:
    """Margins (rows,) of the law K (6, 15) to the digits of a report, and the disk margins (rows,): intervals
    of the frequencies with a crossing are divided into 64.
    """
    opened = _opened(of, gain)
    below = np.geomspace(1e-3, SETTINGS.nyquist_share * np.pi / of.period_s, SETTINGS.frequencies)
    omega = np.append(below, np.pi / of.period_s)
    coarse = opened(omega)
    loud, above = np.abs(coarse) >= 1.0, coarse.imag >= 0.0
    crossed = (loud[:, 1:] != loud[:, :-1]) | (above[:, 1:] != above[:, :-1])
    extra = [
        np.geomspace(omega[k], omega[k + 1], SETTINGS.crossing_divisions + 1)[1:-1]
        for k in np.nonzero(crossed.any(axis=0))[0]
    ]
    between = np.concatenate([*extra, []])
    order = np.argsort(np.concatenate([omega, between]))
    fine = np.concatenate([coarse, opened(between)], axis=1)[:, order]
    return loop_margins(fine, np.concatenate([omega, between])[order]), disk_margin(coarse[:, :-1])


def _opened(of: Sampled, gain: Array) -> Callable[[Array], Complex]:
    """Function that gives each row of the law K (6, 15) opened alone, (rows, F), at frequencies (F,)."""
    seen = feedback(of, gain)[:, of.seen]

    def at(omega: Array) -> Complex:
        whole = np.moveaxis(seen @ responses(of, omega), 0, -1)
        return open_each(np.ascontiguousarray(whole))

    return at


def spectral_radius(of: Sampled, gain: Array) -> float:
    """Largest |eigenvalue| per step of the loop closed by the law K (6, 15)."""
    return float(np.abs(np.linalg.eigvals(closed(of, gain))).max())


def neutral_radius(period_s: float) -> float:
    """Largest closed-loop |eigenvalue| per step that counts as neutral: doubling within an hour."""
    return float(2.0 ** (period_s / SETTINGS.neutral_doubling_s))


def decibel(factor: ArrayLike) -> Array:
    """A factor in dB, 20 log10; inf stays inf."""
    return np.asarray(20.0 * np.log10(factor), dtype=float)


def small(phase_deg: float, gain_db: float, sensitivity: float) -> tuple[str, ...]:
    """Which of a stable loop's margins fall short of `seatrial.control_design.tuning_table.ACCEPTED`; a gain
    that may not fall much shows as sensitivity.
    """
    short = {
        "phase": phase_deg < ACCEPTED.phase_deg,
        "gain": gain_db < ACCEPTED.gain_db,
        "sensitivity": sensitivity > ACCEPTED.sensitivity,
    }
    return tuple(name for name, falls in short.items() if falls)
