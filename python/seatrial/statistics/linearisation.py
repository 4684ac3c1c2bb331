"""Linearisation of a joint estimate: residuals and exact derivatives, from which an estimate is judged.

The rows are residuals in standard deviations of their channel; the columns are exact derivatives (dual
numbers) of what the instruments show. Each segment's initial conditions are unknown too; they are projected
out of its rows, so that what is left is the segment's information on the rest (variable projection, Golub &
Pereyra 1973).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array


@dataclass(frozen=True)
class Unknown:
    """One number of the joint estimate.

    ``scale`` is its natural size: the width of a coefficient's bounds, the prior standard deviation of a
    nuisance parameter. A flat prior has ``prior_sd = inf``.
    """

    name: str
    kind: Literal["coefficient", "nuisance"]
    unit: str
    lower: float
    upper: float
    scale: float
    prior: float
    prior_sd: float


@dataclass(frozen=True)
class Piece:
    """One segment at the estimate: times (n,), residuals (n, C) and derivatives (n, C, m).

    Residuals are measured minus shown, derivatives those of what is shown, both in standard deviations of the
    channel and zero where a sample does not count. ``weight`` (n, C) is the robust loss's weight in [0, 1],
    ``nu`` (n, 6) the predicted velocity.
    """

    trial: str
    t: Array
    residual: Array
    counted: NDArray[np.bool_]
    weight: Array
    jacobian: Array
    nu: Array


@dataclass(frozen=True)
class Linearisation:
    """Residuals and their derivatives at one point of the unknowns.

    ``values`` (m,), ``noise`` (C,) standard deviation of each channel's residual in SI, ``dt`` seconds
    between samples, one `Piece` per segment, those of a trial in the order of time. For the words: letters of
    the axes ``XYZKMN`` that thrusters push directly, and the names of fins and of their groups.
    """

    unknowns: tuple[Unknown, ...]
    values: Array
    channels: tuple[str, ...]
    noise: Array
    dt: float
    pieces: tuple[Piece, ...]
    pushed: str = "XYZKMN"
    fins: tuple[str, ...] = ()

    def of_first(self, count: int) -> Linearisation:
        """The same without the unknowns behind the first."""
        pieces = tuple(replace(piece, jacobian=piece.jacobian[:, :, :count]) for piece in self.pieces)
        return replace(self, unknowns=self.unknowns[:count], values=self.values[:count], pieces=pieces)

    def information(self) -> Array:
        """Information (m, m): ``sum J' W J`` and the priors' ``1/sd^2``."""
        total = np.diag([unknown.prior_sd**-2.0 for unknown in self.unknowns])
        for piece in self.pieces:
            rows = piece.jacobian.reshape(-1, len(self.unknowns))
            total = total + rows.T @ (piece.weight.reshape(-1, 1) * rows)
        return np.asarray(total)

    def gradient(self) -> Array:
        """Downhill gradient (m,) of half the cost: ``sum J' W r`` minus the pull of the priors."""
        away = [(x - u.prior) * u.prior_sd**-2.0 for x, u in zip(self.values, self.unknowns, strict=True)]
        total = -np.asarray(away, dtype=float)
        for piece in self.pieces:
            rows = piece.jacobian.reshape(-1, len(self.unknowns))
            total = total + rows.T @ (piece.weight * piece.residual).ravel()
        return np.asarray(total)
