"""From the load of the whole vehicle to the thrust of a single actuator, by geometry.

With b_k the force per newton of actuator k (upper rows of the allocation matrix) and e_a the axes of the
load cell, actuators with one characteristic and one signal pull ``F_a = sum_k (b_k . e_a) f``:

    f = F / g,  g = sum_k b_k . e                         one axis
    f = (G . F) / (G . G),  G_a = sum_k b_k . e_a         several axes, least squares

over the actuators that ran. Ahead and astern CWolf's four canted propellers give ``F_x / (4 cos a cos b)``,
its vertical thrusters ``F_z / 2`` (Taubert et al. 2014, equations 39-44). Actuators driven one by one are
points of the same characteristic each. A load across G (several axes) is
reported: it is an error of the geometry.

Held by ``tests/bench_test/test_bench_separation.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.bench_test.columns import Unit
    from seatrial.bench_test.plateaus import Plateau

_ALIKE = 0.1

_LEAST_FACTOR = 0.05


@dataclass(frozen=True)
class Separated:
    """One plateau as a point of a single actuator's characteristic.

    Attributes
    ----------
    signal, thrust, error
        Signal in the command's unit, thrust of one actuator in N, its standard error from the samples.
    weights
        (a,) thrust per newton on each axis of the cell: also how a zero error of the cell enters.
    factor
        Length of G: load of the vehicle per newton of a single actuator.
    across
        Load across G in N; zero for one axis.
    running
        Actuators that ran.
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
    """Point of a plateau, None where no actuator of the unit ran.

    Parameters
    ----------
    plateau : Plateau
        Its load without the cell's zero error.
    unit : Unit
    geometry : dict
        Of `force_per_newton`.
    zero : float
        Signals up to this are no signal.
    where : str
        Beginning of messages.

    Raises
    ------
    TrialError
        Another group pulled too, actuators ran with different signals, or what ran does not act on the cell.
    """
    running = tuple(name for name in unit.actuators if abs(plateau.signal[name]) > zero)
    if not running:
        return None
    where = f"{where}, {plateau.label}"
    _refuse_others(plateau, unit, geometry, zero, where)
    signals = np.array([plateau.signal[name] for name in running])
    total = np.sum([geometry[name] for name in running], axis=0)
    mean = float(np.sqrt(np.mean(signals**2)) * np.sign(signals[0]))
    if (np.abs(signals - mean) > _ALIKE * abs(mean)).any():
        raise TrialError(
            f"{where}: {_spoken(running, signals, unit)} pull with different signals, so that their sum"
            " determines no single thrust; drive them alike, or one by one"
        )
    length = float(np.linalg.norm(total))
    if length < _LEAST_FACTOR:
        raise TrialError(
            f"{where}: {', '.join(running)} together give {length:.2g} N along the load cell per newton of"
            " each: their forces cancel or act across it; check axis and direction of the pull"
        )
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
