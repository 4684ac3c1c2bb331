"""Blocks of a linearisation in coordinates in which the information of the whole estimate is one.

Only combinations of the unknowns that data or priors determine have a coordinate; `determined` finds them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seatrial.certainty.residual_blocks import BlockLength, block_length, blocks
from seatrial.linearisation import Linearisation
from seatrial.search import Array

_SINGULAR = 1e-11
"""Eigenvalue of the information, scaled to a unit diagonal, that rounding cannot be told from."""

_PART = 1e-6
"""Squared part in the undetermined combinations from which an unknown counts as undetermined."""


@dataclass(frozen=True)
class Whitened:
    """Blocks in coordinates z (r,) with ``values = transform @ z``.

    Scores are those at the optimum of the linearised problem, so that an estimate held by a bound, or a
    coefficient that is only differentiated, does not pass its pull off as scatter.

    Attributes
    ----------
    length
        Length of a block.
    transform
        Matrix (m, r).
    undetermined
        Mask (m,) of unknowns with a part in what has no coordinate.
    score, information
        Of each block: downhill gradient (B, r) and second derivative (B, r, r) of half the cost.
    coloured
        `seatrial.certainty.residual_blocks.Blocks.coloured` (r, r).
    prior
        Information (r, r) of the priors; with the blocks' it adds up to one.
    """

    length: BlockLength
    transform: Array
    undetermined: NDArray[np.bool_]
    score: Array
    information: Array
    coloured: Array
    prior: Array


def whitened(lin: Linearisation, length: BlockLength | None = None) -> Whitened:
    """Blocks of a linearisation, of the automatic length unless one is given.

    Raises
    ------
    CampaignError
        No sample counts.
    """
    length = block_length(lin) if length is None else length
    data = blocks(lin, length)
    precision = np.array([unknown.prior_sd**-2.0 for unknown in lin.unknowns])
    centre = np.array([unknown.prior for unknown in lin.unknowns])
    transform, undetermined = determined(data.information.sum(axis=0) + np.diag(precision))
    score = data.score @ transform
    information = transform.T @ data.information @ transform
    step = score.sum(axis=0) - transform.T @ (precision * (lin.values - centre))
    return Whitened(
        length=length,
        transform=transform,
        undetermined=undetermined,
        score=score - information @ step,
        information=information,
        coloured=transform.T @ data.coloured @ transform,
        prior=transform.T @ (precision[:, None] * transform),
    )


def determined(information: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Basis T (m, r) of the combinations that an information (m, m) determines, ``T T'`` its pseudo-inverse.

    The second result (m,) marks the unknowns that have a part in the rest. The information is scaled to a
    unit diagonal first, so that units do not matter.

    Examples
    --------
    >>> import numpy as np
    >>> transform, undetermined = determined(np.array([[4.0, 0.0, 0.0], [0.0, 1.0, 1.0], [0.0, 1.0, 1.0]]))
    >>> transform.shape, undetermined.tolist()
    ((3, 2), [False, True, True])
    """
    size = np.sqrt(np.diag(information))
    known = size > 0
    scale = np.where(known, size, 1.0)
    value, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    kept = value > _SINGULAR * max(float(value[-1]), 1.0)
    transform = vectors[:, kept] / np.sqrt(value[kept]) / scale[:, None]
    return transform, ~known | ((vectors[:, ~kept] ** 2).sum(axis=1) > _PART)
