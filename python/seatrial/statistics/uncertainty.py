"""Uncertainty of a joint estimate whose residuals are correlated in time and across channels.

The covariance is the sandwich ``H^-1 (M + sum_g H_g T H_g) H^-1``: H the information, M the covariance of the
sum of the scores from blocks of them (`covariance`), T the scatter of coefficients between parts of the
recordings (`random_effects`). Held by ``tests/statistics/test_uncertainty.py`` and
``test_random_effects.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.statistics.blocks import BlockLength, Whitened, block_length, divided, parts, viewed
from seatrial.statistics.linearisation import Linearisation


@dataclass(frozen=True)
class RandomEffectsSettings:
    """How the scatter of coefficients between parts of the recordings is searched."""

    #: Least length of a part, s: four and more memories of the residuals, and some manoeuvres.
    part_s: float = 60.0
    #: Parts between which a scatter shows at all.
    least_parts: int = 3
    #: Rounds of the search for the variances: those beyond move deviations by less than their own scatter.
    rounds: int = 60
    #: Variance of the scatter at the start, over that of the estimate: what no part tells stays there.
    first_ratio: float = 0.3


EFFECTS = RandomEffectsSettings()


@dataclass(frozen=True)
class RandomEffects:
    """Scatter of coefficients between parts.

    `sd`: standard deviation (m,) between parts; zero for nuisance parameters. `telling`: how many parts tell
    of it (m,), between none and all. `information`: of each part (G, m, m).
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

    `lin` is at the estimate, `length` the memory of the residuals. A model that lacks something has other
    best coefficients in every manoeuvre, which blocks of seconds see only in part. Part g, of a minute or
    more, has its own ``theta + delta_g`` with ``delta_g ~ N(0, T)``, T diagonal, and tells of them by its
    score and its information at the common estimate, ``s_g ~ N(H_g delta_g, V_g)``, V_g the covariance of its
    errors with the memory of their channels. T is that of restricted likelihood (REML; Patterson & Thompson
    1971, Biometrika 58:545; Laird & Ware 1982, Biometrics 38:963): with few parts the common coefficients do
    not pass for scatter. It counts where the likelihood says that there is any, at a level of about 2 %.
    """
    trial, scores, informations, errors = parts(lin, length, EFFECTS.part_s)
    own = [i for i, unknown in enumerate(lin.unknowns) if unknown.kind == "coefficient"]
    if len(scores) < EFFECTS.least_parts or not own:
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
        if group.max() + 1 >= EFFECTS.least_parts:
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

    start = np.log(EFFECTS.first_ratio * np.diag(common)[own])
    bounds = np.column_stack([start - 14.0, start + 14.0])  # a millionth and a million times
    options = {"maxiter": EFFECTS.rounds}
    ended = minimize(worse, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
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


@dataclass(frozen=True)
class UncertaintySettings:
    """What counts as a bound that was reached and as a lone block, and how the tempering is found."""

    #: Share of the box from which a value counts as having come to its bound.
    bound_share: float = 0.005
    #: Share of one block in the information on a combination above which the other blocks cannot judge it.
    lone_share: float = 0.7
    #: Rounds in which variances and tempering settle (four do), and of doublings until the law holds (three
    #: do).
    tempering_rounds: int = 8
    #: Samples at most that count as one: of an hour at 10 Hz nine independent ones are left.
    most_tempering: float = 4096.0
    #: Degrees of freedom in place of infinity: SciPy's quantile needs a finite number.
    many: float = 1e9


SETTINGS = UncertaintySettings()


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainty of a joint estimate; arrays over its m unknowns, in their units.

    Attributes
    ----------
    names, units
        Of the unknowns.
    estimate
        Their values.
    sigma
        Standard deviations; infinite for what neither data nor priors determine.
    naive
        Standard deviations if all samples were independent (``H^-1``), for comparison only.
    lower, upper
        95 % interval, not cut at the bounds.
    at_bound
        "lower" or "upper" where the estimate lies within 0.5 % of the box at a bound, else None.
    alone
        Whether more than half of the variance rests on a single block: repeat that manoeuvre.
    dof
        Degrees of freedom of the intervals; infinite where only a prior or a lone block speaks, zero for
        the undetermined.
    covariance
        Matrix (m, m) on the determined combinations.
    between
        Standard deviation of each coefficient between parts of the recordings
        (`seatrial.statistics.uncertainty`); zero where they show none.
    correlation
        Matrix (m, m), not a number for undetermined unknowns.
    block_samples, block_s, blocks
        Length of a block, and how many there are.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    estimate: Array
    sigma: Array
    naive: Array
    lower: Array
    upper: Array
    at_bound: tuple[str | None, ...]
    alone: NDArray[np.bool_]
    dof: Array
    covariance: Array
    between: Array
    correlation: Array
    block_samples: int
    block_s: float
    blocks: int

    def to_dict(self) -> dict[str, Any]:
        """All of it as plain numbers, texts and lists, one dict per unknown."""
        columns = ("estimate", "sigma", "naive", "lower", "upper", "alone", "dof", "between")
        values = zip(*(getattr(self, column).tolist() for column in columns), strict=True)
        labels = zip(self.names, self.units, self.at_bound, strict=True)
        return {
            "block_samples": self.block_samples,
            "block_s": self.block_s,
            "blocks": self.blocks,
            "unknowns": [
                {"name": name, "unit": unit, "at_bound": bound} | dict(zip(columns, row, strict=True))
                for (name, unit, bound), row in zip(labels, values, strict=True)
            ],
            "correlation": self.correlation.tolist(),
        }


def covariance(lin: Linearisation, *, length: BlockLength | None = None) -> Uncertainty:
    """Sandwich covariance, standard deviations and 95 % intervals of an estimate.

    A prior is independent information and enters M with its own. Each block's score is multiplied by ``(I -
    H_b H^-1)^-1``, which undoes that the fit followed the very block that should test it: the jackknife over
    blocks (Künsch 1989, Ann. Stat. 17:1217; MacKinnon, Nielsen and Webb 2023, J. Appl. Econometrics 38:671,
    there CV3), the mean over several divisions. The 95 % interval has a Student factor with Satterthwaite's
    degrees of freedom for each unknown: the number of equally informative blocks, ``(sum a_b)^2 / sum
    a_b^2``, less one; ``a_b`` is the share of block b in the variance (Carter, Schnepel and Steigerwald 2017,
    Rev. Econ. Stat. 99:698, for alike errors). Where a single block holds most of the information on a
    combination, its variance is that of errors with the memory and the mean square of the whole channel
    (``alone``).

    How often the intervals hold the truth stands in ``docs/theory/uncertainty.md``. Not in it: a wrong model
    structure, and how the model bends across the interval (`seatrial.diagnosis.assessment`). An unknown at a
    bound is treated as free, which widens the intervals of the others.

    Parameters
    ----------
    lin : Linearisation
        At the estimate; coefficients that are only differentiated there count as unknowns too.
    length : BlockLength, optional
        By default the automatic `seatrial.statistics.blocks.block_length`.

    Raises
    ------
    CampaignError
        No sample counts.

    Examples
    --------
    The mean of 400 independent errors of standard deviation one is known to 0.05:

    >>> import numpy as np
    >>> from seatrial.statistics.linearisation import Linearisation, Piece, Unknown
    >>> error = np.random.default_rng(1).normal(size=(400, 1))
    >>> one = np.ones((400, 1))
    >>> piece = Piece("tank", 0.1 * np.arange(400), error - error.mean(), one > 0, one, one[:, :, None],
    ...               np.zeros((400, 6)))
    >>> bias = Unknown("bias", "coefficient", "m/s", -9.0, 9.0, 18.0, 0.0, np.inf)
    >>> lin = Linearisation((bias,), np.array([error.mean()]), ("u",), np.ones(1), 0.1, (piece,))
    >>> print(covariance(lin).naive[0])
    0.05
    """
    from scipy.special import stdtrit

    # A variance from few blocks depends on where they end: the mean over several divisions does less.
    length = block_length(lin) if length is None else length
    divisions = viewed(lin, length, divided(lin, length))
    view = divisions[0]
    scatters, alone, dofs = zip(*(_scatter(division) for division in divisions), strict=True)
    matrix = view.transform @ (np.mean(scatters, axis=0) + view.pull) @ view.transform.T
    variance, dof = np.diag(matrix).copy(), np.mean(dofs, axis=0)
    # Coefficients that differ between parts of the recordings by more than errors explain.
    effects = random_effects(lin, view.length)
    if effects is not None:
        more, its_dof = effects.spread(view.transform @ view.transform.T)
        matrix = matrix + more
        added = np.diag(more)
        with np.errstate(divide="ignore", invalid="ignore"):
            both = (variance + added) ** 2 / (variance**2 / dof + added**2 / its_dof)
        dof = np.where(added > 0.0, both, dof)
    naive = np.einsum("ij,ij->i", view.transform, view.transform)
    with np.errstate(divide="ignore", invalid="ignore"):
        sigma = np.where(view.undetermined, np.inf, np.sqrt(np.diag(matrix)))
        correlation = matrix / np.outer(sigma, sigma)
    correlation[view.undetermined] = correlation[:, view.undetermined] = np.nan
    half = stdtrit(np.where(view.undetermined, 1.0, np.minimum(dof, SETTINGS.many)), 0.975) * sigma
    return Uncertainty(
        names=tuple(unknown.name for unknown in lin.unknowns),
        units=tuple(unknown.unit for unknown in lin.unknowns),
        estimate=lin.values.copy(),
        sigma=sigma,
        naive=np.where(view.undetermined, np.inf, np.sqrt(naive)),
        lower=lin.values - half,
        upper=lin.values + half,
        at_bound=tuple(
            bound_reached(x, u.lower, u.upper) for u, x in zip(lin.unknowns, lin.values, strict=True)
        ),
        alone=np.mean(alone, axis=0) > 0.5 * variance,
        dof=np.where(view.undetermined, 0.0, dof),
        covariance=matrix,
        between=np.zeros(len(dof)) if effects is None else effects.sd,
        correlation=correlation,
        block_samples=view.length.samples,
        block_s=view.length.seconds,
        blocks=len(view.score),
    )


def tempering(lin: Linearisation) -> Array:
    """Samples (m,) that count as one independent one where data meet the prior of each unknown; one without.

    The likelihood of correlated residuals as if they were independent is too sharp beside a prior; its power
    ``1/T`` is right (Pauli, Racugno & Ventura 2011, Statistica Sinica 21:149), which without priors changes
    nothing. T is the variance that the data give an unknown over that of independent samples: more for one
    whose derivatives are slow. The sandwich holds for any T; here all grow until no posterior is wider than
    its prior. The scatter between parts is not in it: with it, what is known beforehand outweighed Beluga's
    data, a thruster of 2.1 times its table came out at 1.3, and roll was predicted worse (R2 0.81 to 0.71).

    Raises CampaignError where no sample counts.
    """
    known = replace(lin, tempering=1.0).precision
    own = np.ones(len(known))
    if not known.any():
        return own
    length = block_length(lin)
    divisions = divided(lin, length)

    def spread() -> tuple[Array, Array, Array]:
        """Variances (m,) by the data's errors, were these independent, and by the priors' errors."""
        seen = viewed(replace(lin, tempering=own), length, divisions)
        scatter = np.mean([_scatter(view)[0] for view in seen], axis=0)
        inside = scatter, np.eye(len(scatter)) - seen[0].prior, seen[0].pull
        transform = seen[0].transform
        first, second, third = (np.einsum("ij,jk,ik->i", transform, part, transform) for part in inside)
        return first, second, third

    for _ in range(SETTINGS.tempering_rounds):
        by_data, independent, _ = spread()
        ratio = np.divide(by_data, independent, out=np.ones_like(own), where=independent > 0.0)
        own = np.where(known > 0.0, ratio.clip(1.0, SETTINGS.most_tempering), 1.0)
    for _ in range(SETTINGS.tempering_rounds):
        by_data, _, by_priors = spread()
        if np.max(known * (by_data + by_priors)) <= 1.0:
            break
        own = np.where(known > 0.0, (2.0 * own).clip(1.0, SETTINGS.most_tempering), 1.0)
    return own


def _scatter(view: Whitened) -> tuple[Array, Array, Array]:
    """Covariance (r, r) of the sum of the scores, the variances (m,) that lone blocks make of it, and the
    degrees of freedom (m,).
    """
    transform, (share, vectors) = view.transform, np.linalg.eigh(view.information)
    # Directions that one block nearly determines alone cannot be judged by the others.
    judged = share < SETTINGS.lone_share
    gain = np.where(judged, 1.0 / (1.0 - np.minimum(share, SETTINGS.lone_share)), 0.0)
    # Each block's score, corrected for the fit having followed it: the jackknife of CV3.
    moved = (vectors @ (gain * (view.score[:, None] @ vectors)[:, 0])[:, :, None])[:, :, 0]
    number = len(moved)
    from_data = (number - 1) / number * moved.T @ moved
    # The scatter of a lone block is that of errors with the memory of their channel.
    lonely = np.zeros_like(from_data)
    for block in np.flatnonzero(~judged.all(axis=1)):
        span = vectors[block][:, ~judged[block]]
        lonely += span @ (span.T @ view.coloured @ span) @ span.T
    # Share of every block in every variance, for Satterthwaite's degrees of freedom.
    part = ((transform @ vectors) ** 2 @ (share * judged)[:, :, None])[:, :, 0]
    naive = np.einsum("ij,ij->i", transform, transform)
    with np.errstate(divide="ignore", invalid="ignore"):
        dof = np.maximum(naive**2 / (part**2).sum(axis=0) - 1.0, 1.0)
    return from_data + lonely, np.einsum("ij,jk,ik->i", transform, lonely, transform), dof


def bound_reached(value: float, lower: float, upper: float) -> str | None:
    """Which bound a value has come to, "lower" or "upper": within 0.5 % of the box; else None."""
    near = SETTINGS.bound_share * (upper - lower)
    if not np.isfinite(near):
        return None
    if value <= lower + near:
        return "lower"
    return "upper" if value >= upper - near else None
