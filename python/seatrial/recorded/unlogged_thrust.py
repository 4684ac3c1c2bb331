"""Actuators that did not do what their commands say: a thrust of one of them that no command told.

A jam, a lost propeller or a command that was not logged is no change of a coefficient: where the command
says nothing, no gain explains a thrust. So each actuator in turn is given a steady thrust of its own in each
window. With c_w the whitened derivative of window w by that thrust (a constant wrench along the actuator's,
`X_0` ... `N_0`) and r_w its residual,

    f_w = c_w'r_w / c_w'c_w,   gain = sum_w (c_w'r_w)^2 / c_w'c_w

(structured residuals with one unknown input, Isermann, *Fault-Diagnosis Systems* (2006), chapter 10). It has
as many unknowns as windows and pays for them (`seatrial.recorded.suspects`).

Tests: ``tests/test_recorded_suspects.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seatrial.recorded.restarts import Restarts
from seatrial.recorded.whitening import Whitening

__all__ = ["UnloggedThrust", "unlogged_thrusts"]

Array = NDArray[np.float64]

_WRENCH = ("X_0", "Y_0", "Z_0", "K_0", "M_0", "N_0")
_ALIKE = 0.9


@dataclass(frozen=True, eq=False)
class UnloggedThrust:
    """What a thrust of one actuator beyond its commands explains.

    Attributes
    ----------
    actuator
        Its name.
    thrust
        Steady thrust of each window beyond the modelled one, (w,), N; at full lift of a fin likewise.
    gain
        Fall of the sum of squares.
    p
        Of no such thrust: F-test with an observation per channel and window, times the actuators tried.
    alike
        Actuators that explain nearly as much.
    """

    actuator: str
    thrust: Array
    gain: float
    p: float
    alike: tuple[str, ...]

    @property
    def words(self) -> str:
        """The thrust in words."""
        mean, size = float(self.thrust.mean()), float(np.sqrt(np.mean(self.thrust**2)))
        return (
            f"{self.actuator} pushes otherwise than its commands say ({size:.2g} N rms beyond them,"
            f" {mean:+.2g} N on average)"
        )


def unlogged_thrusts(log: Restarts, white: Whitening) -> tuple[UnloggedThrust, ...]:
    """Every actuator with the thrust that its commands do not tell, the best explanation first.

    Parameters
    ----------
    log : Restarts
        None where a recorded wrench drives the vehicle.
    white : Whitening
        Of the same log.
    """
    from scipy.stats import f as fisher

    if log.input == "tau":
        return ()
    facts = log.vehicle.actuator_info()
    directions: list[Mapping[str, float]] = [
        dict(zip(_WRENCH, (float(x) for x in facts[name]["wrench"]), strict=True))
        for name in log.vehicle.actuators
    ]
    columns = white.columns(log.slopes(directions))
    pull = np.array([np.einsum("ncd,nc->d", one, r) for one, r in zip(columns, white.residual, strict=True)])
    square = np.array([np.einsum("ncd,ncd->d", one, one) for one in columns])  # (w, a)
    known = square > 1e-12 * np.maximum(square.max(axis=0), 1e-300)
    thrust = np.where(known, pull / np.where(known, square, 1.0), 0.0)
    gains = (thrust * pull).sum(axis=0)
    windows = len(columns)
    free = max(windows * (len(white.places) - 1), 1)
    found = []
    for k, name in enumerate(log.vehicle.actuators):
        left = max(white.cost - float(gains[k]), 1e-300)
        chance = float(fisher.sf(float(gains[k]) / windows / (left / free), windows, free))
        near = [
            (float(gains[j]), other)
            for j, other in enumerate(log.vehicle.actuators)
            if j != k and gains[j] > _ALIKE * gains[k]
        ]
        alike = tuple(other for _, other in sorted(near, reverse=True))
        found.append(
            UnloggedThrust(name, thrust[:, k], float(gains[k]), min(1.0, len(facts) * chance), alike)
        )
    return tuple(sorted(found, key=lambda one: -one.gain))
