"""Linearisation of a joint estimate: residuals and exact derivatives, from which an estimate is judged.

The rows are residuals in standard deviations of their channel; the columns are exact derivatives (dual
numbers) of what the instruments show. Each segment's initial conditions are unknown too; they are projected
out of its rows, so that what is left is the segment's information on the rest (variable projection, Golub &
Pereyra 1973).
"""

from __future__ import annotations

from collections.abc import Sequence
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


CONTRADICTED = 2.0
"""Deviations from which what is known beforehand of a coefficient pulls with a constant force: one wrong
belief (a propeller of another size) may not bend the others. One right belief of 20 is further off."""


def trust(unknowns: Sequence[Unknown], away: Array) -> Array:
    """Huber's weight (m,) of the priors of unknowns ``away`` (m,) from them, of coefficients only."""
    known = np.array([u.prior_sd if u.kind == "coefficient" else np.inf for u in unknowns])
    return np.asarray(CONTRADICTED / np.maximum(np.abs(away) / known, CONTRADICTED))


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
    the axes ``XYZKMN`` that thrusters push directly, and the names of fins and of their groups. ``tempering``
    (m,) is the number of samples that count as one independent one beside the prior of each unknown
    (`seatrial.statistics.uncertainty.tempering`).
    """

    unknowns: tuple[Unknown, ...]
    values: Array
    channels: tuple[str, ...]
    noise: Array
    dt: float
    pieces: tuple[Piece, ...]
    pushed: str = "XYZKMN"
    fins: tuple[str, ...] = ()
    tempering: Array | float = 1.0

    @property
    def precision(self) -> Array:
        """Information (m,) of the priors in units of the samples' information: ``tempering / sd^2``."""
        away = self.values - [unknown.prior for unknown in self.unknowns]
        known = np.array([unknown.prior_sd**-2.0 for unknown in self.unknowns])
        return np.asarray(self.tempering * trust(self.unknowns, away) * known)

    def of_first(self, count: int) -> Linearisation:
        """The same without the unknowns behind the first."""
        pieces = tuple(replace(piece, jacobian=piece.jacobian[:, :, :count]) for piece in self.pieces)
        tempering = np.broadcast_to(self.tempering, len(self.unknowns))[:count]
        return replace(
            self,
            unknowns=self.unknowns[:count],
            values=self.values[:count],
            pieces=pieces,
            tempering=tempering,
        )

    def information(self) -> Array:
        """Information (m, m): ``sum J' W J`` and that of the priors."""
        total = np.diag(self.precision)
        for piece in self.pieces:
            rows = piece.jacobian.reshape(-1, len(self.unknowns))
            total = total + rows.T @ (piece.weight.reshape(-1, 1) * rows)
        return np.asarray(total)

    def gradient(self) -> Array:
        """Downhill gradient (m,) of half the cost: ``sum J' W r`` minus the pull of the priors."""
        centre = np.array([unknown.prior for unknown in self.unknowns])
        total = self.precision * (centre - self.values)
        for piece in self.pieces:
            rows = piece.jacobian.reshape(-1, len(self.unknowns))
            total = total + rows.T @ (piece.weight * piece.residual).ravel()
        return np.asarray(total)
