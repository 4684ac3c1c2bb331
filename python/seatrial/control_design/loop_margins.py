"""Margins of open loops from their frequency responses: phase, gain both ways, delay, sensitivity.

A loop L crosses |L| = 1 at a phase margin, which over its frequency is a delay margin, and the negative real
axis at a gain margin: upwards where |L| < 1, downwards where |L| > 1 (a conditionally stable loop). Crossings
are placed between two frequencies by the logarithm of L.

Any number of loops at once, 0.2 ms for one and 0.01 ms each in a batch. python-control, which makes the
report (`seatrial.tuning.margin_report`) and against which these are held, needs 12 ms per loop for a spline
and its roots: start gains ask for a hundred, a tuning for a hundred thousand. Source: Åström and Hägglund,
*Advanced PID Control* (2006), section 4.4. Held by tests/test_margin_constraint.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["LoopMargins", "loop_margins"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class LoopMargins:
    """Margins of loops, each array of the loops' shape; inf (phase: 180 deg) where nothing is crossed.

    They are distances from the edge of stability and tell nothing about the side: an unstable loop has
    margins, too.

    Attributes
    ----------
    phase_deg
        Phase margin, deg: the least angle between -1 and a crossing of the unit circle.
    gain
        Gain margin upwards, a factor above one.
    reduction
        Gain margin downwards: the factor above one by which the gain may be divided.
    delay_s
        Delay margin, s.
    sensitivity
        Largest size of 1/(1 + L) over the frequencies.
    """

    phase_deg: Array
    gain: Array
    reduction: Array
    delay_s: Array
    sensitivity: Array


_REAL = 1e-9  # imaginary part, as a share, that is rounding
_TINY = 1e-300


def loop_margins(loops: Complex, omega: Array) -> LoopMargins:
    """Margins of loops (..., F) from their responses at rising frequencies omega (F,) in rad/s.

    Of sampled loops the last frequency is half the sampling rate, where a real response below zero counts
    as a crossing of the negative real axis.

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
    phase, delay = np.full(len(flat), 180.0), np.full(len(flat), np.inf)
    gain, reduction = np.full(len(flat), np.inf), np.full(len(flat), np.inf)

    loud = flat.real**2 + flat.imag**2 >= 1.0
    case, at = np.nonzero(loud[:, 1:] != loud[:, :-1])
    size, angle, change = _steps(flat, case, at)
    share = size / np.where(change.real == 0.0, 1.0, -change.real)
    over = angle + share * change.imag  # above -180 deg
    over = (over + np.pi) % (2.0 * np.pi) - np.pi
    np.minimum.at(phase, case, np.abs(np.rad2deg(over)))
    np.minimum.at(delay, case, (over % (2.0 * np.pi)) / (omega[at] * (omega[at + 1] / omega[at]) ** share))

    above = flat.imag >= 0.0
    case, at = np.nonzero(above[:, 1:] != above[:, :-1])
    size, angle, change = _steps(flat, case, at)
    met = (angle < 0.0) != (angle + change.imag < 0.0)
    case, size, angle, change = case[met], size[met], angle[met], change[met]
    crossed = size - angle / np.where(change.imag == 0.0, 1.0, change.imag) * change.real
    np.minimum.at(gain, case[crossed < 0.0], np.exp(-crossed[crossed < 0.0]))
    np.minimum.at(reduction, case[crossed >= 0.0], np.exp(crossed[crossed >= 0.0]))
    # A sampled loop is real at half the sampling rate: a pole may leave through z = -1.
    end = flat[:, -1]
    at_edge = (np.abs(end.imag) <= _REAL * np.abs(end)) & (end.real < 0.0)
    size = np.where(at_edge, np.abs(end), 1.0)
    gain = np.where(at_edge & (size < 1.0), np.minimum(gain, 1.0 / np.maximum(size, _TINY)), gain)
    reduction = np.where(at_edge & (size >= 1.0), np.minimum(reduction, size), reduction)
    return LoopMargins(
        phase_deg=phase.reshape(shape),
        gain=gain.reshape(shape),
        reduction=reduction.reshape(shape),
        delay_s=delay.reshape(shape),
        sensitivity=np.maximum(sensitivity, 1.0).reshape(shape),
    )


def _steps(loops: Complex, case: NDArray[np.intp], at: NDArray[np.intp]) -> tuple[Array, Array, Complex]:
    """Logarithm of |L|, angle from the negative real axis, and the change of both to the next frequency."""
    with np.errstate(divide="ignore"):
        here, there = np.log(-loops[case, at]), np.log(-loops[case, at + 1])
    change = there - here
    change.imag = (change.imag + np.pi) % (2.0 * np.pi) - np.pi
    return here.real, here.imag, change
