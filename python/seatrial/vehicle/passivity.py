"""Which coefficients are physically possible: those with which no part of the vehicle creates energy.

Each condition counts only where the vehicle's own values meet it:

- the core accepts the values: positive masses and inertias, ``M_RB + M_A`` positive definite, motors with
  lags and rate limits that exist;
- damping takes energy at every speed: ``X_u <= 0`` and ``X_uu <= 0`` and so on along the diagonal, and the
  symmetric part of the linear damping matrix is positive semidefinite (Fossen 2011, section 6.4);
- actuators push along their direction: gains and thrust per revolution are positive, thrust deduction and
  wake fraction lie from 0 to below 1, losses from other groups' thrust are not gains.

Lift (``Y_uv`` and the like) turns forward motion into sideways force and quadratic cross terms have no sign
of their own; they are free. Held by ``tests/identification/test_fitted.py``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import AXES, VELOCITIES
from seatrial.base.errors import VehicleError

if TYPE_CHECKING:
    from seatrial._core import Vehicle

_DIAGONAL = [(row, speed) for row, speed in zip(AXES, VELOCITIES, strict=True)]

_POSITIVE = ("gain", "astern_ratio", "p1_ahead", "p1_astern")

_SHARES = ("t", "w")

_ROUNDING = 1e-9

_ANY_NUMBER = re.compile(r"[XYZKMN]_([uvwpqr]{1,2}|0)|.+\.(gain|loss|lever_[KMN])")
"""Names whose values the core takes whatever they are: forces by speed, biases, factors and levers."""


class PossibleCoefficients:
    """The conditions on some coefficients of a vehicle.

    Parameters
    ----------
    vehicle : Vehicle
        Its own values decide which conditions count, and give the other coefficients.
    names : sequence of str
        Coefficients that vary, in the order of the columns.

    Examples
    --------
    >>> import seatrial as st
    >>> possible = PossibleCoefficients(st.Vehicle.load("cwolf"), ["X_uu", "X_udot"])
    >>> possible.mask([[-9.0, -4.0], [1.0, -4.0], [-9.0, 400.0]]).tolist()
    [True, False, False]
    """

    def __init__(self, vehicle: Vehicle, names: Sequence[str]) -> None:
        self.vehicle, self.names = vehicle, tuple(names)
        own = vehicle.coefficients()
        self._own = np.array([own.get(name, 0.0) for name in self.names])
        low, high = np.full(len(self.names), -np.inf), np.full(len(self.names), np.inf)
        damping = {f"{row}_{speed}" for row, speed in _DIAGONAL}
        damping |= {f"{row}_{2 * speed}" for row, speed in _DIAGONAL}
        for k, name in enumerate(self.names):
            suffix = name.partition(".")[2]
            if name in damping:
                high[k] = 0.0
            elif suffix in _POSITIVE or name == "B":
                low[k] = np.finfo(float).tiny
            elif suffix in _SHARES:
                low[k], high[k] = 0.0, np.nextafter(1.0, 0.0)
            elif suffix == "loss":
                low[k] = 0.0
        self.low = np.where(self._own < low, -np.inf, low)
        self.high = np.where(self._own > high, np.inf, high)
        self._linear = [
            (k, AXES.index(name[0]), VELOCITIES.index(name[2]))
            for k, name in enumerate(self.names)
            if len(name) == 3 and name[1] == "_" and name[0] in AXES and name[2] in VELOCITIES
        ]
        self._damping = np.array([[own.get(f"{row}_{speed}", 0.0) for speed in VELOCITIES] for row in AXES])
        self._judged = [k for k, name in enumerate(self.names) if not _ANY_NUMBER.fullmatch(name)]
        self._dissipative = bool(self._takes_energy(self._own[None])[0])

    def mask(self, values: Sequence[Sequence[float]] | Array) -> Mask:
        """Whether each row of values (k, n) is possible, (k,).

        Parameters
        ----------
        values : (k, n) array_like
        """
        rows = np.asarray(values, float).reshape(-1, len(self.names))
        good: Mask = np.logical_not(self.outside(rows).any(axis=1))
        if self._dissipative and self._linear:
            good[good] = self._takes_energy(rows[good])
        for k in np.flatnonzero(good) if self._judged else ():
            good[k] = self._core_takes(rows[k])
        return good

    def outside(self, values: Array) -> Mask:
        """Where values (k, n) have the wrong sign, (k, n)."""
        return (values < self.low) | (values > self.high)

    def _takes_energy(self, rows: Array) -> Mask:
        """Whether the linear damping of rows (k, n) takes energy from every motion, (k,)."""
        matrix = np.repeat(-self._damping[None], len(rows), axis=0)
        for k, row, column in self._linear:
            matrix[:, row, column] = -rows[:, k]
        symmetric = 0.5 * (matrix + matrix.transpose(0, 2, 1))
        size = np.sqrt(np.maximum(np.abs(np.diagonal(symmetric, axis1=1, axis2=2)), _ROUNDING))
        least = np.linalg.eigvalsh(symmetric / size[:, :, None] / size[:, None, :])[:, 0]
        return np.asarray(least >= -_ROUNDING)

    def _core_takes(self, row: Array) -> bool:
        try:
            self.vehicle.with_coefficients({self.names[k]: float(row[k]) for k in self._judged})
        except VehicleError:
            return False
        return True
