"""Residuals of a log in units of a valid model's errors, without what the state at a restart explains.

Per window the residual r, in units of a valid model's spread, is ``r = J_theta theta + J_0 x_0 + e``: J exact
derivatives, x_0 the error of the state at the restart, known to within the noise. With ``J_0 S_0`` = U D V'
the whitening ``I - U (1 - (1 + D^2)^-1/2) U'`` leaves unit noise (variable projection with a prior).

Tests: ``tests/test_recorded_suspects.py``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from seatrial.recorded.candidates import Candidate
from seatrial.recorded.restarts import Restarts, Slopes
from seatrial.recorded.spread import INITIAL_PLACES, Spread
from seatrial.recording.columns import CHANNELS

__all__ = ["Whitening"]

Array = NDArray[np.float64]

_STEPS = 4
_KNEE = 2.0


class Whitening:
    """Residuals and derivatives of a log in units of the spread, without what a start explains.

    Attributes
    ----------
    residual, counted
        Per window (n, C): residuals, and which of them count.
    weight
        Of every window.
    cost
        Sum of squares.
    places
        Channels that count, as places in `CHANNELS`.
    """

    def __init__(self, log: Restarts, spread: Spread, slopes: Sequence[Slopes]) -> None:
        self.log = log
        self.places = [k for k, name in enumerate(CHANNELS) if name in log.channels]
        start = np.where(np.isfinite(spread.noise), spread.noise, 0.0)[list(INITIAL_PLACES)]
        self.counted = [mask[:, self.places] for mask in log.counted]
        self.scale, self.shrink = [], []
        for w, slope in enumerate(slopes):
            scale = 1.0 / spread.at(log.since_restart(w))[:, self.places]
            self.scale.append(scale)
            by_start = slope.by_start[:, self.places] * start * scale[:, :, None]
            u, d, _ = np.linalg.svd(by_start.reshape(-1, 12), full_matrices=False)
            self.shrink.append((u, 1.0 - 1.0 / np.sqrt(1.0 + d**2)))
        self.weight = np.ones(len(slopes))
        sizes = np.array([float(np.sqrt(np.mean(one**2))) for one in self.of(log.residual)])
        # Huber's weights for whole windows: a few wild ones shall not name the suspect.
        self.weight = np.minimum(1.0, _KNEE * np.median(sizes) / np.maximum(sizes, 1e-300))
        self.residual = self.of(log.residual)
        self.cost = sum(float((one**2).sum()) for one in self.residual)

    def of(self, parts: Sequence[Array]) -> list[Array]:
        """Residuals (n, C) of every window, whitened."""
        return [self._white(w, part[:, self.places, None])[:, :, 0] for w, part in enumerate(parts)]

    def columns(self, slopes: Sequence[Slopes]) -> list[Array]:
        """Derivatives (n, C, d) of every window, whitened."""
        return [self._white(w, slope.by_direction[:, self.places]) for w, slope in enumerate(slopes)]

    def followed(
        self, candidate: Candidate, columns: Sequence[Array], own: Sequence[int], theta: Array, linear: float
    ) -> tuple[Array, float]:
        """Best values of a candidate on the non-linear model, and the fall of the sum of squares."""
        own_columns = [part[:, :, own].reshape(-1, len(own)) for part in columns]
        normal = sum(part.T @ part for part in own_columns)
        best, least = np.zeros(len(own)), self.cost
        step = theta
        for _ in range(_STEPS):
            at, reach = best + step, None
            for _ in range(3):  # a step too far is halved
                reach = self._cost(candidate, at)
                if reach is not None and reach[0] < least:
                    break
                at = 0.5 * (at + best)
            if reach is None or reach[0] >= least:
                break
            gained, best, least = least - reach[0], at, reach[0]
            pull = sum(part.T @ r.ravel() for part, r in zip(own_columns, reach[1], strict=True))
            step = np.linalg.solve(np.atleast_2d(normal), np.atleast_1d(pull))
            if gained < 1e-3 * self.cost:
                break
        return best, self.cost - least

    def _cost(self, candidate: Candidate, theta: Array) -> tuple[float, list[Array]] | None:
        from seatrial.errors import SeatrialError

        try:
            parts = self.log.of(candidate.changes(theta))
        except SeatrialError:  # no vehicle has such coefficients
            return None
        if not all(np.isfinite(part).all() for part in parts):
            return None
        white = self.of(parts)
        return sum(float((one**2).sum()) for one in white), white

    def _white(self, w: int, part: Array) -> Array:
        scaled = np.where(self.counted[w][:, :, None], part * self.scale[w][:, :, None], 0.0)
        flat = scaled.reshape(-1, part.shape[2])
        u, shrink = self.shrink[w]
        flat = flat - u @ (shrink[:, None] * (u.T @ flat))
        return np.asarray(self.weight[w] * flat.reshape(scaled.shape))
