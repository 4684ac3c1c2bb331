"""Steady motion under held commands, from runs of the whole chain that go on until nothing changes.

Held by tests/test_performance.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.check.actuators import voltage_for

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["Steady", "steady"]

Array = NDArray[np.float64]

_ROUND_S, _SAMPLE_S = 240.0, 0.25
_ROUNDS = 10
_CHANGE = 1e-6  # m/s and rad/s over the last tenth of a round


@dataclass(frozen=True)
class Steady:
    """Velocities (6,) in m/s and rad/s, wrench (6,) in N and N m, and actuators in their own unit.

    Where the motion never settles (``settled`` is false) they are means over the last 24 s.
    """

    nu: Array
    tau: Array
    actuators: dict[str, float]
    settled: bool


def steady(
    vehicle: Vehicle,
    commands: Mapping[str, float],
    *,
    free: str,
    voltage_v: float,
    nu: ArrayLike = (0.0,) * 6,
) -> Steady:
    """Motion that the vehicle settles into under steady commands, the other axes held.

    Parameters
    ----------
    vehicle : Vehicle
    commands : {actuator: float}
        In the actuators' own units; neutral where absent.
    free : str
        Axes that move, letters of XYZKMN; the others keep their initial velocity.
    voltage_v : float
        Supply voltage at which tables of thrust are read, V.
    nu : (6,) array_like
        Initial velocities, m/s and rad/s.

    Examples
    --------
    >>> import seatrial as st
    >>> ahead = dict.fromkeys(["SbU", "SbL", "PU", "PL"], 1000.0)
    >>> round(float(steady(st.Vehicle.load("cwolf"), ahead, free="X", voltage_v=14.8).nu[0]), 2)
    1.55
    """
    from seatrial._core import State

    t = np.arange(0.0, _ROUND_S, _SAMPLE_S)
    held: dict[str, ArrayLike] = {name: np.full(len(t), value) for name, value in commands.items()}
    state = State(nu=nu)
    for _ in range(_ROUNDS):
        run = vehicle.simulate(t, held, state, free=free, voltage=voltage_for(vehicle, t, voltage_v))
        last = np.asarray(run.nu)[-len(t) // 10 :]
        signals = {name: float(np.asarray(y)[-1]) for name, y in run.actuators.items()}
        settled = bool(np.isfinite(last).all() and np.ptp(last, axis=0).max() < _CHANGE)
        if settled or not np.isfinite(last).all():
            break
        state = State(attitude=run.attitude[-1], nu=last[-1], actuators=dict(signals))
    wrench = np.asarray(run.tau)[-len(last) :]
    if settled:
        return Steady(last[-1], wrench[-1], signals, settled)
    return Steady(last.mean(axis=0), wrench.mean(axis=0), signals, settled)
