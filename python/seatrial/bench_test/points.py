"""Operating points of one group, of all its pulls together. Tests: ``tests/test_bench_coverage.py``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from seatrial.bench_test.pull_points import PullPoints

__all__ = ["Points"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Points:
    """Points (n,) of a group: signal in the command's unit, thrust of one actuator in N, voltage in V.

    ``pull`` names the pull of each, ``place`` file and row or time, ``running`` the actuators. ``zero``
    (n, m) is the thrust per newton of zero error of each cell, ``zero_error`` (m,) the tares' standard errors
    in N from their samples, ``rests`` (m,) the steady parts behind each tare.
    """

    signal: Array
    thrust: Array
    voltage: Array
    error: Array
    zero: Array
    zero_error: Array
    rests: Array
    pull: tuple[str, ...]
    place: tuple[str, ...]
    running: tuple[tuple[str, ...], ...]

    @classmethod
    def pooled(cls, pulls: Sequence[PullPoints]) -> Points:
        """Points of several pulls together; each has a cell of its own."""
        from scipy.linalg import block_diag

        return cls(
            signal=np.concatenate([p.signal for p in pulls]),
            thrust=np.concatenate([p.thrust for p in pulls]),
            voltage=np.concatenate([p.voltage for p in pulls]),
            error=np.concatenate([p.error for p in pulls]),
            zero=np.asarray(block_diag(*[p.zero_effect for p in pulls])),
            zero_error=np.concatenate([p.zero_error for p in pulls]),
            rests=np.concatenate([np.full(len(p.zero_error), float(p.rests)) for p in pulls]),
            pull=tuple(p.name for p in pulls for _ in p.places),
            place=tuple(f"{Path(p.file).name}, {place}" for p in pulls for place in p.places),
            running=tuple(names for p in pulls for names in p.running),
        )

    def zero_columns(self, sigma: float) -> Array:
        """Columns (n, m) of one standard deviation each of the tares' errors.

        A plateau at rest repeats no better than the others, so that the scatter ``sigma`` in N of the points
        about the curve, over the root of the number of rests, is the least that a tare may err by.
        """
        per_newton = np.abs(self.zero).max(axis=0, initial=0.0)
        repeated = sigma / np.maximum(per_newton, 1e-12) / np.sqrt(np.maximum(self.rests, 1.0))
        own = np.maximum(self.zero_error, repeated)
        return np.asarray(self.zero * np.where(self.rests > 0.0, own, 0.0))
