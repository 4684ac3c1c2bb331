"""Block bootstrap of a joint estimate: a check of its covariance that assumes no distribution.

Blocks are weighted with exponential numbers (Bayesian bootstrap, Rubin 1981, Ann. Stat. 9:130): like drawing
them with replacement, but the only block that tells of an unknown is never lost. Each draw is one
Gauss-Newton step from the estimate. The centre of each prior is drawn from the prior.

With few blocks its intervals are too narrow, as those of every bootstrap of blocks (in the cases of
`seatrial.certainty.uncertainty` they cover 78 to 90 %): they check those intervals and do not replace them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seatrial.certainty.residual_blocks import BlockLength
from seatrial.certainty.whitened import whitened
from seatrial.linearisation import Linearisation
from seatrial.search import Array

_ABREAST = 256
"""Draws that are solved together: bounds the memory."""


@dataclass(frozen=True)
class Bootstrap:
    """Estimates ``draws`` (d, m) of resampled data, their standard deviation, 95 % percentile interval (m,).

    What neither data nor priors determine has an infinite standard deviation and interval.
    """

    draws: Array
    sigma: Array
    lower: Array
    upper: Array


def bootstrap(lin: Linearisation, *, draws: int, seed: int, length: BlockLength | None = None) -> Bootstrap:
    """Bootstrap over blocks of all channels together.

    Parameters
    ----------
    lin : Linearisation
    draws, seed : int
        Number of resampled data sets, at least two, and seed of the generator.
    length : BlockLength, optional
        By default the automatic `seatrial.certainty.residual_blocks.block_length`.

    Raises
    ------
    CampaignError
        No sample counts.
    ValueError
        Fewer than two draws.
    """
    if draws < 2:
        raise ValueError(
            f"draws: expected at least 2, found {draws}; 1000 give the interval to a few per cent"
        )
    view = whitened(lin, length)
    generator = np.random.default_rng(seed)
    number, rank = view.score.shape
    size, vectors = np.linalg.eigh(view.prior)
    spread = (vectors * np.sqrt(np.maximum(size, 0.0))).T
    flat = view.information.reshape(number, -1)
    steps = []
    for first in range(0, draws, _ABREAST):
        count = min(_ABREAST, draws - first)
        weight = generator.standard_exponential((count, number))
        pull = weight @ view.score + generator.normal(size=(count, rank)) @ spread
        information = (weight @ flat).reshape(count, rank, rank) + view.prior
        steps.append(np.linalg.solve(information, pull[:, :, None])[:, :, 0])
    values = lin.values + np.concatenate(steps) @ view.transform.T
    lower, upper = np.quantile(values, (0.025, 0.975), axis=0)
    return Bootstrap(
        draws=values,
        sigma=np.where(view.undetermined, np.inf, values.std(axis=0, ddof=1)),
        lower=np.where(view.undetermined, -np.inf, lower),
        upper=np.where(view.undetermined, np.inf, upper),
    )
