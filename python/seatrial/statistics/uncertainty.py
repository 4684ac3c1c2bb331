"""Uncertainty of a joint estimate whose residuals are correlated in time and across channels.

The estimate's covariance is the sandwich ``H^-1 M H^-1``: H the information, M the covariance of the sum of
the scores, from blocks of them (`seatrial.statistics.blocks`). A prior is independent information
and enters M with its own. Each block's score is multiplied by ``(I - H_b H^-1)^-1``, which undoes that the
fit followed the very block that should test it. That is the jackknife over blocks: Künsch 1989, Ann. Stat.
17:1217; MacKinnon, Nielsen and Webb 2023, J. Appl. Econometrics 38:671 (there CV3). It is the mean over
several divisions into blocks, for a variance from few blocks depends on where they end.

The 95 % interval has a Student factor with Satterthwaite's degrees of freedom for each unknown: the number of
equally informative blocks, ``(sum a_b)^2 / sum a_b^2``, less one; ``a_b`` is the share of block b in the
variance (Carter, Schnepel and Steigerwald 2017, Rev. Econ. Stat. 99:698, for alike errors). Where a single
block holds most of the information on a combination, blocks cannot estimate its scatter; its variance is that
of errors with the memory and the mean square of the whole channel (``alone``).

Not in it: a wrong model structure, and how the model bends across the interval
(`seatrial.diagnosis.resampling`). An unknown at a bound is treated as free, which widens the intervals of the
others.

Measured with one division: AR(1) errors, two channels correlated by 0.4, inputs stepped, periodic, drifting
and white, a bias per trial, 500 seeds; cover of the 95 % intervals, mean over the unknowns. CR1: plain block
scores, t(B - 1).
HAC: Bartlett kernel of the same length, normal factor. Width: median over 1.96 true standard deviations.
`tests/statistics/test_uncertainty.py` repeats a part.

=============  ========  ====  ======  =====  ====  ====  ========  ==========  =====
samples        unknowns  rho   blocks  naive  CR1   HAC   **this**  worst of m  width
=============  ========  ====  ======  =====  ====  ====  ========  ==========  =====
2 x 600        6         0     26      0.94   0.93  0.92  0.95      0.94        1.08
2 x 600        6         0.90  20      0.45   0.91  0.88  0.94      0.92        1.04
2 x 600        6         0.98  8       0.33   0.88  0.81  0.95      0.93        1.25
300            5         0.90  9       0.55   0.91  0.85  0.94      0.93        1.09
4500 in three  15        0.90  45      0.50   0.92  0.92  0.95      0.93        1.05
4500 in three  15        0.98  18      0.39   0.90  0.88  0.96      0.94        1.21
5 x 600        25        0.97  20      0.39   0.88  0.86  0.96      0.94        1.20
=============  ========  ====  ======  =====  ====  ====  ========  ==========  =====
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.statistics.blocks import BlockLength, Whitened, block_length, divided, viewed, views
from seatrial.statistics.linearisation import Linearisation
from seatrial.statistics.random_effects import random_effects

_AT_BOUND = 0.005  # of the box, from which a value counts as having come to its bound

_ALONE = 0.7
"""Share of one block in the information on a combination above which the other blocks cannot judge it."""

_ROUNDS = 8  # the variances change the tempering and it them: four settle it, and three doublings the law

_MOST = 4096.0
"""Samples at most that count as one: of an hour at 10 Hz nine independent ones are left."""

_MANY = 1e9
"""Degrees of freedom in place of infinity: SciPy's quantile needs a finite number."""


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
        (`seatrial.statistics.random_effects`); zero where they show none.
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
    divisions = views(lin, length)
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
    half = stdtrit(np.where(view.undetermined, 1.0, np.minimum(dof, _MANY)), 0.975) * sigma
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

    Raises
    ------
    CampaignError
        No sample counts.
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

    for _ in range(_ROUNDS):
        by_data, independent, _ = spread()
        ratio = np.divide(by_data, independent, out=np.ones_like(own), where=independent > 0.0)
        own = np.where(known > 0.0, ratio.clip(1.0, _MOST), 1.0)
    for _ in range(_ROUNDS):
        by_data, _, by_priors = spread()
        if np.max(known * (by_data + by_priors)) <= 1.0:
            break
        own = np.where(known > 0.0, (2.0 * own).clip(1.0, _MOST), 1.0)
    return own


def _scatter(view: Whitened) -> tuple[Array, Array, Array]:
    """Covariance (r, r) of the sum of the scores, the variances (m,) that lone blocks make of it, and the
    degrees of freedom (m,).
    """
    transform, (share, vectors) = view.transform, np.linalg.eigh(view.information)
    # Directions that one block nearly determines alone cannot be judged by the others.
    judged = share < _ALONE
    gain = np.where(judged, 1.0 / (1.0 - np.minimum(share, _ALONE)), 0.0)
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
    near = _AT_BOUND * (upper - lower)
    if not np.isfinite(near):
        return None
    if value <= lower + near:
        return "lower"
    return "upper" if value >= upper - near else None
