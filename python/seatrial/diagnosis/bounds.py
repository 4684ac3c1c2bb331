"""Bounds that the data contradict, and what the estimate would be without them.

An estimate that ends at a bound is not known, and what shares its influence on the data is bent as long as
the data pull it further: of a rudder under a yaw damping that may not become weaker, the gain grows instead.
Each coefficient at a bound is released alone; where the step of Gauss and Newton then leads more than three
standard deviations beyond the bound, the data contradict it. All these are released together, and another
coefficient that moves by more than two of its standard deviations, and by more than a twentieth, is not
identified: model or bound is wrong, and its value makes up for that.

Standard deviations are those of the released system, as much larger than with independent samples as the
sandwich covariance finds them (`seatrial.statistics.uncertainty`). Source of the step: Nocedal and Wright,
*Numerical Optimization* (2006), section 16.4 (multipliers of active bounds). Held by
``tests/diagnosis/test_bounds.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.plain import Plain
from seatrial.estimation.specification import matters
from seatrial.statistics.linearisation import Linearisation
from seatrial.statistics.uncertainty import Uncertainty

_CONTRADICTED, _MOVED = 3.0, 2.0
"""Deviations beyond a bound, and deviations that another coefficient moves."""


@dataclass(frozen=True)
class ContradictedBounds(Plain):
    """What the estimate would be without the bounds that the data contradict.

    Attributes
    ----------
    pulls
        By how many standard deviations the data lead beyond the bound, by coefficient at a bound.
    values
        Of all unknowns without these bounds, to first order.
    away
        By how much of its standard deviation each unknown is away from the fit then.
    refused
        Coefficients within their bounds that are not identified because of it, the worst first.
    """

    pulls: Mapping[str, float]
    values: Mapping[str, float]
    away: Mapping[str, float]
    refused: tuple[str, ...]


def contradicted_bounds(lin: Linearisation, known: Uncertainty) -> ContradictedBounds | None:
    """Bounds that the data contradict; None where there are none.

    Parameters
    ----------
    lin : Linearisation
        At the estimate.
    known : Uncertainty
        Of the same unknowns, says which ended at a bound.
    """
    ended = [place for place, bound in enumerate(known.at_bound) if bound is not None]
    inner = [place for place, bound in enumerate(known.at_bound) if bound is None]
    information, gradient = lin.information(), lin.gradient()
    with np.errstate(divide="ignore", invalid="ignore"):
        wider = np.where(np.isfinite(known.sigma) & (known.naive > 0.0), known.sigma / known.naive, 1.0)
    pulls = {}
    for place in ended:
        step, sd = _released(information, gradient, [*inner, place])
        outward = 1.0 if known.at_bound[place] == "upper" else -1.0
        pull = outward * step[place] / (sd[place] * wider[place])
        if pull > _CONTRADICTED:
            pulls[place] = float(pull)
    if not pulls:
        return None
    step, sd = _released(information, gradient, [*inner, *pulls])
    away = np.divide(step, sd * wider, out=np.zeros_like(step), where=sd > 0.0)
    coefficients = [place for place in inner if lin.unknowns[place].kind == "coefficient"]
    refused = [
        place
        for place in coefficients
        if abs(away[place]) > _MOVED
        and matters(lin.values[place], lin.values[place] + step[place], lin.unknowns[place].scale)
    ]
    return ContradictedBounds(
        {known.names[place]: pull for place, pull in pulls.items()},
        dict(zip(known.names, (lin.values + step).tolist(), strict=True)),
        dict(zip(known.names, away.tolist(), strict=True)),
        tuple(known.names[place] for place in sorted(refused, key=lambda place: -abs(away[place]))),
    )


def _released(information: Array, gradient: Array, free: Sequence[int]) -> tuple[Array, Array]:
    """Step (m,) of the unknowns that are free, and their standard deviations (m,) of independent samples."""
    size = np.sqrt(np.maximum(np.diag(information)[free], np.finfo(float).tiny))
    inverse = np.linalg.pinv(
        information[np.ix_(free, free)] / np.outer(size, size), rcond=1e-10, hermitian=True
    )
    step, sd = np.zeros(len(gradient)), np.zeros(len(gradient))
    step[free] = inverse @ (gradient[free] / size) / size
    sd[free] = np.sqrt(np.diag(inverse)) / size
    return step, sd
