"""Flights of a vehicle under ArduSub's cascade: along a course, many cases at once.

Everything that differs between cases is one `Cases`; what the vehicle's set-up gives is one `Rig`. The loop
over time is the core's (`ardusub_fly`), in lanes. Held by ``tests/ardusub/test_reflight.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial._core import ardusub_defaults, ardusub_fly, ardusub_frames
from seatrial.ardusub.course import Course
from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError, nearest

if TYPE_CHECKING:
    from seatrial._core import Vehicle

NOISE = (0.002, 0.005)
"""Standard deviation of gyro (rad/s) and velocity (m/s) that the controllers see."""


@dataclass(frozen=True, eq=False)
class Rig:
    """What a vehicle's set-up gives: frame, directions of the motors, where the tether pulls.

    Attributes
    ----------
    frame
        Name of the frame, as ``FRAME_CONFIG`` has it.
    direction
        ``MOT_n_DIRECTION`` of every motor.
    tether_at
        (3,), body frame, m.
    noise
        Standard deviation of gyro (rad/s) and velocity (m/s).
    wander_s
        Time constant of the wrench that the model does not know, s.
    steady
        Steady wrench (6,) that the model does not know, N and N m.
    coupling
        ``MOT_FV_CPLNG_K``, which counts for the frame Vectored; ArduSub's default where it is None.
    """

    frame: str
    direction: tuple[int, ...]
    tether_at: tuple[float, float, float] = (-0.2, 0.0, -0.1)
    noise: tuple[float, float] = NOISE
    wander_s: float = 1.0
    steady: tuple[float, ...] = (0.0,) * 6
    coupling: float | None = None


@dataclass(frozen=True, eq=False)
class Cases:
    """What differs between k flights; an array of one row counts for all.

    Attributes
    ----------
    seeds
        (k,) whole numbers.
    coefficients
        Of the vehicle, (k,) by name.
    current
        (k, 3), NED, m/s.
    wander
        (k, 6) standard deviation of the wrench that the model does not know, N and N m.
    tether
        (k, 3), NED, N.
    supply
        (k, 3): thrust over that of the voltage at the beginning, its fall per s, its fall at full load.
    """

    seeds: NDArray[np.int_]
    coefficients: Mapping[str, Array]
    current: Array
    wander: Array
    tether: Array
    supply: Array

    @classmethod
    def of(
        cls,
        k: int,
        *,
        seed: int = 0,
        coefficients: Mapping[str, Array] | None = None,
        current: ArrayLike = (0.0, 0.0, 0.0),
        wander: ArrayLike = (0.0,) * 6,
        tether: ArrayLike = (0.0, 0.0, 0.0),
        supply: ArrayLike = (1.0, 0.0, 0.0),
    ) -> Cases:
        """Cases with numbers from a seed on; what is one row counts for all."""

        def rows(values: ArrayLike) -> Array:
            own = np.asarray(values, float)
            return np.asarray(np.broadcast_to(own, (k, own.shape[-1])))

        return cls(
            np.arange(seed, seed + k), dict(coefficients or {}), rows(current), rows(wander), rows(tether),
            rows(supply),
        )  # fmt: skip

    def __len__(self) -> int:
        """Number of cases."""
        return len(self.seeds)

    def take(self, which: ArrayLike) -> Cases:
        """Some of them."""
        own = np.asarray(which)
        return replace(
            self, seeds=self.seeds[own], current=self.current[own], wander=self.wander[own],
            tether=self.tether[own], supply=self.supply[own],
            coefficients={name: values[own] for name, values in self.coefficients.items()},
        )  # fmt: skip


def known_parameters(values: Mapping[str, ArrayLike]) -> dict[str, ArrayLike]:
    """Those of some parameters that the cascade has."""
    own = ardusub_defaults()
    return {name: value for name, value in values.items() if name in own}


def fly_course(
    vehicle: Vehicle,
    rig: Rig,
    course: Course,
    parameters: Mapping[str, ArrayLike],
    *,
    cases: Cases,
    threads: int | None = None,
) -> Array:
    """Rows (k, n, 20) of flights along a course, see `seatrial._core.ardusub_fly`.

    Parameters
    ----------
    vehicle : Vehicle
    rig : Rig
    course : Course
    parameters : mapping
        By ArduSub's names and units (4.7 and later): a number, or (k,); the default where one is missing.
    cases : Cases
    threads : int, optional

    Raises
    ------
    TrialError
        A parameter is none of the cascade's.
    SimulationError
        The frame does not fit the vehicle, or a number is not finite.
    """
    known = ardusub_defaults()
    for name in parameters:
        if name not in known:
            raise TrialError(f"{name}: expected a parameter of ArduSub's controllers{nearest(name, known)}")
    steady = dict(zip(("X_0", "Y_0", "Z_0", "K_0", "M_0", "N_0"), rig.steady, strict=True))
    own = vehicle.coefficients()
    bias = {
        name: np.broadcast_to(cases.coefficients.get(name, own.get(name, 0.0)) + value, len(cases))
        for name, value in steady.items()
        if value
    }
    return np.asarray(
        ardusub_fly(
            vehicle, rig.frame, np.asarray(rig.direction, float), course.targets,
            seeds=[int(seed) for seed in cases.seeds], period_s=course.period_s, every=course.every,
            parameters=dict(parameters), coefficients={**cases.coefficients, **bias},
            position=course.position, attitude=course.attitude, nu=course.nu, integrals=course.integrals,
            current=cases.current, wander=cases.wander, wander_s=rig.wander_s, tether=cases.tether,
            tether_at=np.asarray(rig.tether_at), supply=cases.supply, noise=np.asarray(rig.noise),
            coupling=rig.coupling, threads=threads,
        )
    )  # fmt: skip


def check_rig(vehicle: Vehicle, rig: Rig) -> None:
    """Refuse a vehicle whose thrusters push against what frame and directions of the motors tell them.

    Raises
    ------
    TrialError
        A thruster pushes the wrong way, or their number is not the frame's.
    """
    if wrong := against(vehicle, rig):
        raise TrialError(
            f"{vehicle.name}: {', '.join(wrong)} push against MOT_n_DIRECTION of the log; set reversed of"
            " these thrusters in vehicle.toml the other way, and run again with --vehicle"
        )


def against(vehicle: Vehicle, rig: Rig) -> list[str]:
    """Thrusters that push against what frame and directions of the motors tell them.

    Raises
    ------
    TrialError
        Their number is not the frame's.
    """
    shares = np.asarray(ardusub_frames()[rig.frame])
    columns = np.asarray(vehicle.allocation_matrix())
    if columns.shape[1] != len(shares):
        raise TrialError(
            f"{vehicle.name}: expected the {len(shares)} thrusters of {rig.frame}, found {columns.shape[1]};"
            " give the vehicle with --vehicle"
        )
    signs = [-1.0 if facts["reversed"] else 1.0 for facts in vehicle.actuator_info().values()]
    # Roll, pitch, yaw, throttle (up), forward, lateral.
    pushes = np.stack([columns[3], columns[4], columns[5], -columns[2], columns[0], columns[1]], 1)
    agree = (pushes * shares).sum(axis=1) * np.array(signs) * np.asarray(rig.direction)
    return [
        name for name, agreement in zip(vehicle.actuators, agree.tolist(), strict=True) if agreement < 0.0
    ]
