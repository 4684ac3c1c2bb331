"""Information criteria for the choice between models of the same data whose residuals are correlated.

``-2 ln L = sum n_c ln s_c^2`` for Gaussian errors, with the mean square s_c^2 of each channel's residual.
Samples that repeat what their neighbours say must not count in full, or every term that is freed looks
significant: n_c is the number of independent samples, those that count over the integrated autocorrelation
time (`seatrial.certainty.residual_blocks`). AIC adds 2 k (Akaike 1974), BIC ``k ln sum n_c`` (Schwarz
1978); k is the number of determined combinations less the part that priors hold, ``tr H^-1 sum H_b`` (Moody
1992).

Correlation between channels is not counted. Initial conditions of segments are left out of k: models of the
same segments have the same number of them.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from seatrial.certainty.residual_blocks import block_length
from seatrial.certainty.whitened import whitened
from seatrial.linearisation import Linearisation


@dataclass(frozen=True)
class InformationCriteria:
    """Smaller is better; only differences between models of the same data mean something.

    ``parameters`` is the effective number of parameters, ``effective`` (C,) that of independent samples.
    """

    aic: float
    bic: float
    parameters: float
    effective: tuple[float, ...]

    def to_dict(self) -> dict[str, Any]:
        """All of it as plain numbers and lists."""
        return asdict(self) | {"effective": list(self.effective)}


def information_criteria(lin: Linearisation, *, effective: ArrayLike | None = None) -> InformationCriteria:
    """AIC and BIC of the model that was linearised at its estimate.

    Parameters
    ----------
    lin : Linearisation
    effective : array_like, shape (C,), optional
        Independent samples per channel. Models are compared with the same numbers: those of the largest one.
        By default this model's own.

    Raises
    ------
    CampaignError
        No sample counts.
    """
    length = block_length(lin)
    samples = length.effective if effective is None else np.asarray(effective, dtype=float)
    counts = np.maximum(np.sum([piece.counted.sum(axis=0) for piece in lin.pieces], axis=0), 1)
    squares = np.sum(
        [(piece.counted * piece.weight * piece.residual**2).sum(axis=0) for piece in lin.pieces], axis=0
    )
    size = np.where(samples > 0, squares / counts, 1.0) * lin.noise**2
    twice = float(samples @ np.log(np.where(samples > 0, np.maximum(size, 1e-300), 1.0)))
    parameters = float(np.trace(whitened(lin, length).information.sum(axis=0)))
    return InformationCriteria(
        aic=twice + 2.0 * parameters,
        bic=twice + float(np.log(samples.sum())) * parameters,
        parameters=parameters,
        effective=tuple(samples.tolist()),
    )
