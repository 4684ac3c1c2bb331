"""Gains per sample, as a digital PID without a period writes them, turned into physical ones.

Equation (54) of Taubert et al. (2014) sums errors and takes differences from sample to sample, so that K_I
and K_D absorb the control period. Physical gains do not: another period does not retune the loop.
Held by tests/test_per_sample.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from seatrial.errors import VehicleError

__all__ = ["physical_gains"]

_POINTS = 6


def physical_gains(
    loops: Mapping[str, Mapping[str, Sequence[float]]], *, period_s: float
) -> dict[str, dict[str, list[float]]]:
    """Gains of an autopilot file, per loop ``K_P``, ``K_I_per_s`` and ``K_D_s`` at six supporting points.

    ``K_I_per_s = KI / T_s`` and ``K_D_s = KD T_s`` for ``tau = KP e + KI sum(e) - KD (y(k) - y(k-1))``.

    Parameters
    ----------
    loops : mapping
        Per loop the gains per sample ``KP``, ``KI`` and ``KD``, six numbers each, N or N m per unit of error.
    period_s : float
        Control period T_s for which they were found, s.

    Raises
    ------
    VehicleError
        A period that is not positive, a missing gain, or not six numbers.

    Examples
    --------
    >>> gains = {"heading": {"KP": [32.8] * 6, "KI": [0.041] * 6, "KD": [812.0] * 6}}
    >>> {name: values[0] for name, values in physical_gains(gains, period_s=0.1)["heading"].items()}
    {'K_P': 32.8, 'K_I_per_s': 0.41, 'K_D_s': 81.2}
    """
    if not period_s > 0.0:
        raise VehicleError(f"period_s: expected a positive time in s, found {period_s}")
    factors = {"K_P": ("KP", 1.0), "K_I_per_s": ("KI", 1.0 / period_s), "K_D_s": ("KD", period_s)}
    physical: dict[str, dict[str, list[float]]] = {}
    for loop, gains in loops.items():
        physical[loop] = {}
        for key, (name, factor) in factors.items():
            values = list(gains.get(name, ()))
            if len(values) != _POINTS:
                raise VehicleError(
                    f"{loop}.{name}: expected {_POINTS} gains per sample, one per supporting point, found"
                    f" {len(values)}"
                )
            # Ten digits: a period of 0.1 s leaves 0.41 as 0.41.
            physical[loop][key] = [float(f"{value * factor:.10g}") for value in values]
    return physical
