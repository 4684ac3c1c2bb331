"""Checks of a joint estimate's covariance: the profile of the criterion and the block bootstrap.

*Profile*: the criterion's smallest value with some unknowns held along a line and the rest refitted. Where it
leaves the parabola of the linearisation, standard deviations mislead and the profile's own interval holds
(Bates and Watts 1988, section 6.1). Correlated errors raise the threshold by the ratio of the sandwich
variance to the naive one.

*Block bootstrap*: no distribution is assumed. Blocks are weighted with exponential numbers (Bayesian
bootstrap, Rubin 1981, Ann. Stat. 9:130): like drawing them with replacement, but the only block that tells of
an unknown is never lost. Each draw is one Gauss-Newton step from the estimate. The centre of each prior is
drawn from the prior. With few blocks its intervals are too narrow, as those of every bootstrap of blocks (in
the cases of `seatrial.statistics.uncertainty` they cover 78 to 90 %): they check those intervals and do not
replace them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.plain import Plain
from seatrial.statistics.blocks import BlockLength, determined, whitened
from seatrial.statistics.linearisation import Linearisation
from seatrial.statistics.uncertainty import Uncertainty

Refit = Callable[[Mapping[str, float]], float]


@dataclass(frozen=True)
class Profile(Plain):
    """Criterion along a line through the estimate."""

    #: Unknowns that are held.
    names: tuple[str, ...]
    #: Places (k,) on the line in standard deviations, zero at the estimate.
    step: Array
    #: Values (k, n) of the held unknowns.
    values: Array
    #: Half the sum of squares (k,), priors included, above that of the refit at the estimate.
    cost: Array
    #: The same as the linearisation predicts it (k,).
    quadratic: Array
    #: Cost at the ends of the 95 % interval.
    threshold: float
    #: Those ends in ``step``, interpolated; infinite where the curve does not reach the threshold.
    lower: float
    upper: float


def profile(
    lin: Linearisation,
    refit: Refit,
    *,
    uncertainty: Uncertainty,
    direction: Mapping[str, float],
    reach: float = 3.0,
    points: int = 9,
) -> Profile:
    """Profile along a direction of one or several unknowns, evaluated from the estimate outwards.

    Parameters
    ----------
    lin : Linearisation
        At the estimate.
    refit : callable
        Smallest half sum of squares with the named unknowns held at these values.
    uncertainty : Uncertainty
        Of the same estimate; gives the length of a step and the threshold.
    direction : mapping
        Change of each unknown that is held, in its unit, in any length; ``{"X_u": 1.0}`` for one.
    reach : float
        Ends of the line in standard deviations. It is cut at the bounds.
    points : int
        Odd number of points, at least three.

    Raises
    ------
    ValueError
        An unknown name, no direction, or one that the linearisation does not determine.
    """
    names = tuple(direction)
    known = {unknown.name: index for index, unknown in enumerate(lin.unknowns)}
    missing = [name for name in names if name not in known]
    along = np.array([direction[name] for name in names], dtype=float)
    if missing or not np.any(along):
        raise ValueError(
            f"direction: expected changes of unknowns of the estimate that are not all zero, found"
            f" {dict(direction)}; unknowns: {', '.join(known)}"
        )
    if points < 3 or points % 2 == 0:
        raise ValueError(f"points: expected an odd number from 3 on, found {points}")
    # Without a standard deviation along the direction there is no length to step by.
    held = [known[name] for name in names]
    transform, undetermined = determined(lin.information())
    if undetermined[held].any():
        raise ValueError(
            f"direction: the estimate does not determine {', '.join(names)} separately, so there is no"
            " standard deviation to step by; step only unknowns that it determines, or give a prior"
        )
    # Curvature of the cost along the direction with all other unknowns at their best (Schur complement).
    part = transform[held]
    stiffness = np.linalg.inv(part @ part.T)
    dual = stiffness @ along
    curvature = float(along @ dual)
    variance = float(dual @ uncertainty.covariance[np.ix_(held, held)] @ dual) / curvature**2
    # One step is one standard deviation of the estimate along the direction.
    unit = along * np.sqrt(variance)
    step = np.linspace(-1.0, 1.0, points) * reach
    lower = np.array([lin.unknowns[index].lower for index in held])
    upper = np.array([lin.unknowns[index].upper for index in held])
    values = lin.values[held] + step[:, None] * unit
    inside = ((values >= lower) & (values <= upper)).all(axis=1)
    # The estimate itself stays, even where it ended a rounding error beyond a bound.
    inside[points // 2] = True
    step, values = step[inside], values[inside]
    cost = np.full(len(step), np.inf)
    # From the estimate outwards: a refit may start from the one before it.
    for index in np.argsort(np.abs(step), kind="stable"):
        cost[index] = refit(dict(zip(names, map(float, values[index]), strict=True)))
    cost -= cost[int(np.argmin(np.abs(step)))]
    # The threshold has the quantile of the interval of the estimate.
    factor = float(np.max((uncertainty.upper - uncertainty.estimate)[held] / uncertainty.sigma[held]))
    threshold = 0.5 * factor**2 * variance * curvature
    return Profile(
        names=names,
        step=step,
        values=values,
        cost=cost,
        quadratic=0.5 * step**2 * variance * curvature,
        threshold=threshold,
        lower=-_crossing(-step[step <= 0][::-1], cost[step <= 0][::-1], threshold),
        upper=_crossing(step[step >= 0], cost[step >= 0], threshold),
    )


def _crossing(step: Array, cost: Array, threshold: float) -> float:
    """First place where a cost that starts at zero reaches the threshold, by its root, which is straight
    where the cost is a parabola.
    """
    over = np.flatnonzero(cost >= threshold)
    if not len(over) or over[0] == 0:
        return np.inf
    before, after = over[0] - 1, over[0]
    root = np.sqrt(np.maximum(cost[[before, after]], 0.0))
    part = (np.sqrt(threshold) - root[0]) / (root[1] - root[0])
    return float(step[before] + part * (step[after] - step[before]))


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
        By default the automatic `seatrial.statistics.blocks.block_length`.

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
    size, vectors = np.linalg.eigh(view.pull)
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
