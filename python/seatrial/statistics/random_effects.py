"""Random effects: by how much coefficients differ between parts of the recordings, more than errors explain.

A model that lacks something has other best coefficients in every manoeuvre. Blocks of seconds see that only
in part, and not at all where one of them tells a coefficient. Part g, of a minute or more, has its own
coefficients ``theta + delta_g`` with ``delta_g ~ N(0, T)``, T diagonal. It tells of them by its score and its
information at the common estimate,

    s_g ~ N(H_g delta_g, V_g),

V_g the covariance of its errors with the memory of their channels. T is that of restricted likelihood (REML;
Patterson & Thompson 1971, Biometrika 58:545; Laird & Ware 1982, Biometrics 38:963): with few parts the common
coefficients do not pass for scatter. It counts where the likelihood says that there is any, at a level of
about 2 %. The covariance of the estimate is then

    H^-1 (M + sum_g H_g T H_g) H^-1.

Tests: ``tests/statistics/test_random_effects.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.statistics.blocks import BlockLength, parts
from seatrial.statistics.linearisation import Linearisation

PART_S = 60.0
"""Least length of a part, s: four and more memories of the residuals, and some manoeuvres."""

_ROUNDS = 60
"""Rounds of the search for the variances: those beyond move deviations by less than their own scatter."""

_BEGIN = 0.3
"""Variance of the scatter at the start, over that of the estimate: what no part tells stays there."""


@dataclass(frozen=True)
class RandomEffects:
    """Scatter of coefficients between parts.

    Attributes
    ----------
    sd
        Standard deviation (m,) between parts; zero for nuisance parameters.
    telling
        How many parts tell of it (m,), between none and all.
    information
        Of each part (G, m, m).
    """

    sd: Array
    telling: Array
    information: Array

    def spread(self, inverse: Array) -> tuple[Array, Array]:
        """What it adds to the covariance (m, m) of an estimate, and the degrees of freedom (m,) of that.

        `inverse` (m, m) is that of the information of all parts and the priors.
        """
        gain = inverse @ self.information * self.sd
        share = (gain**2).sum(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            dof = share.sum(axis=1) ** 2 / (share**2 / np.maximum(self.telling - 1.0, 1.0)).sum(axis=1)
        return np.einsum("gik,gjk->ij", gain, gain, optimize=True), np.fmax(dof, 1.0)


def random_effects(lin: Linearisation, length: BlockLength) -> RandomEffects | None:
    """Scatter of the coefficients between parts of the recordings; None where they do not show any.

    `lin` is at the estimate, `length` the memory of the residuals.
    """
    trial, scores, informations, errors = parts(lin, length, PART_S)
    own = [i for i, unknown in enumerate(lin.unknowns) if unknown.kind == "coefficient"]
    if len(scores) < 3 or not own:  # parts between which a scatter shows
        return None
    # Unknowns in their deviations of independent samples, so that ranks mean something.
    whole = informations.sum(axis=0)
    size = np.sqrt(np.diag(whole))
    size[size == 0.0] = 1.0
    square = np.outer(size, size)
    scores, scaled, errors, whole = scores / size, informations / square, errors / square, whole / square
    # Scores at the optimum of the data: the pull of a prior or a bound is no scatter.
    scores = scores - scaled @ (_pseudo_inverse(whole) @ scores.sum(axis=0))
    # What each part would tell of its own coefficients if it stood alone.
    weighed = np.array([h @ _pseudo_inverse(v) for h, v in zip(scaled, errors, strict=True)])
    precision = weighed @ scaled
    aims = (weighed @ scores[:, :, None])[:, :, 0]
    # How long a part keeps its coefficients the likelihood says too: from a minute to a whole trial.
    levels = []
    for joined in _levels(trial):
        likelihood = _restricted_likelihood(_summed(precision, joined), _summed(aims, joined), own)
        levels.append((*likelihood, joined))
    gained, variance, telling, joined = max(levels, key=lambda level: level[0])
    # Without scatter every variance is at its end with probability one half: half a unit each, variance 5/4.
    # Three deviations above, and as much as the best of so many lengths gains by chance.
    if gained <= 0.5 * len(own) + 3.0 * math.sqrt(1.25 * len(own)) + 2.0 * math.log(len(levels)):
        return None
    sd, parts_that_tell = np.zeros((2, len(size)))
    sd[own], parts_that_tell[own] = np.sqrt(variance) / size[own], telling
    return RandomEffects(sd, parts_that_tell, _summed(informations, joined))


def _levels(trial: NDArray[np.intp]) -> Iterator[NDArray[np.intp]]:
    """Group of each part (G,): itself, then 2, 4, 8 ... parts of its trial that follow one another."""
    place = np.concatenate([np.arange(count) for count in np.bincount(trial) if count])
    size = 1
    while True:
        _, group = np.unique(np.column_stack([trial, place // size]), axis=0, return_inverse=True)
        if group.max() + 1 >= 3:
            yield group.ravel()
        if size > place.max():
            return
        size *= 2


def _summed(array: Array, group: NDArray[np.intp]) -> Array:
    """Sums of the rows of each group."""
    total = np.zeros((int(group.max()) + 1, *array.shape[1:]))
    np.add.at(total, group, array)
    return total


def _restricted_likelihood(precision: Array, aims: Array, own: list[int]) -> tuple[float, Array, Array]:
    """Twice what a scatter gains in the logarithm of the likelihood, its variances (k,), and how many parts
    tell of each, between none and all.

    ``precision`` (G, m, m) and ``aims`` (G, m) are the normal equations of each part for its own unknowns.
    """
    from scipy.optimize import minimize

    beside = precision[:, :, own]
    inner, eye = beside[:, own], np.eye(len(own))
    common = _pseudo_inverse(precision.sum(axis=0))

    def marginal(variance: Array) -> tuple[float, Array, Array]:
        """Twice the logarithm of the likelihood; means and variances (G, k) of the scatter given the data."""
        root = np.sqrt(variance)
        scaled = eye + root[:, None] * inner * root
        given = root[:, None] * np.linalg.inv(scaled) * root
        joined = beside @ given
        left = precision - joined @ beside.swapaxes(1, 2)
        pull = (aims - (joined @ aims[:, own, None])[:, :, 0]).sum(axis=0)
        shared = _pseudo_inverse(left.sum(axis=0))
        values = shared @ pull
        rest = (aims - precision @ values)[:, own]
        means = (given @ rest[:, :, None])[:, :, 0]
        # Up to what does not depend on the scatter.
        twice = float((aims[:, own] * (given @ aims[:, own, None])[:, :, 0]).sum() + pull @ values)
        twice -= float(np.linalg.slogdet(scaled)[1].sum()) - _log_size(shared)
        moved = joined.swapaxes(1, 2)
        spread = np.einsum("gii->gi", given) + np.einsum("gij,gij->gi", moved @ shared, moved)
        return twice, means, spread

    def worse(logarithm: Array) -> tuple[float, Array]:
        """The likelihood's cost of logarithms (k,) of the variances, and its gradient."""
        variance = np.exp(logarithm)
        twice, means, spread = marginal(variance)
        return -0.5 * twice, 0.5 * (len(aims) - (means**2 + spread).sum(axis=0) / variance)

    start = np.log(_BEGIN * np.diag(common)[own])
    bounds = np.column_stack([start - 14.0, start + 14.0])  # a millionth and a million times
    ended = minimize(worse, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": _ROUNDS})
    variance = np.exp(ended.x)
    twice, _, spread = marginal(variance)
    return twice - marginal(np.zeros(len(own)))[0], variance, len(aims) - (spread / variance).sum(axis=0)


def _log_size(matrix: Array) -> float:
    """Logarithm of the product of the eigenvalues that are not rounding."""
    values = np.linalg.eigvalsh(matrix)
    return float(np.log(values[values > 1e-10 * values[-1]]).sum())


def _pseudo_inverse(matrix: Array) -> Array:
    """Inverse of what is not rounding in an information with a diagonal of about one."""
    return np.asarray(np.linalg.pinv(matrix, rcond=1e-10, hermitian=True))
