"""The drawn cases of a verification: everything that differs from one flight to the next.

Tests: ``tests/test_draws.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Cases"]

Array = NDArray[np.float64]
FaultRow = tuple[int, str, float, float]
OutageRow = tuple[int, int, float, float]


@dataclass(frozen=True, eq=False)
class Cases:
    """Drawn cases (k); SI and rad, NED.

    Attributes
    ----------
    numbers
        Of the cases in the campaign: with them each can be drawn again alone.
    mission
        Index of the mission that each flies, (k,).
    coefficients
        Of the vehicle that flies, by name, (k,) each.
    current, turbulence
        Mean velocity of the water, and standard deviation about it, (k, 3), m/s.
    position, attitude, nu
        Start: place (k, 3), roll, pitch, yaw (k, 3), velocities over ground in the body frame (k, 6).
    faults
        Rows (case, actuator, time in s, command or nan) with the case's place among these.
    outages
        Rows (case, group, from, until in s).
    seeds
        Of the sensors' noise and of the turbulence, (k,).
    causes
        What was drawn, by readable names with units, (k,) each.
    notes
        Sentences: how many vehicles were impossible, what is not in the covariance.
    """

    numbers: NDArray[np.int_]
    mission: NDArray[np.int_]
    coefficients: Mapping[str, Array]
    current: Array
    turbulence: Array
    position: Array
    attitude: Array
    nu: Array
    faults: list[FaultRow]
    outages: list[OutageRow]
    seeds: NDArray[np.int_]
    causes: Mapping[str, Array]
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Number of cases."""
        return len(self.numbers)

    def of_mission(self, index: int) -> Cases:
        """The cases that fly one mission, in order.

        Parameters
        ----------
        index : int
            Its place in the list of missions.
        """
        return self.take(np.flatnonzero(self.mission == index))

    def take(self, places: ArrayLike) -> Cases:
        """Some of the cases, in the order given; rows of faults and outages count within them.

        Parameters
        ----------
        places : (m,) array_like of int
        """
        chosen = np.asarray(places, dtype=np.int_)
        now = {int(old): new for new, old in enumerate(chosen)}
        return Cases(
            numbers=self.numbers[chosen],
            mission=self.mission[chosen],
            coefficients={name: column[chosen] for name, column in self.coefficients.items()},
            current=self.current[chosen],
            turbulence=self.turbulence[chosen],
            position=self.position[chosen],
            attitude=self.attitude[chosen],
            nu=self.nu[chosen],
            faults=[(now[case], name, at, command) for case, name, at, command in self.faults if case in now],
            outages=[
                (now[case], group, start, stop) for case, group, start, stop in self.outages if case in now
            ],
            seeds=self.seeds[chosen],
            causes={name: column[chosen] for name, column in self.causes.items()},
            notes=self.notes,
        )
