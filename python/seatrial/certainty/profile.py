"""Profile of the criterion: its smallest value with some unknowns held along a line and the rest refitted.

Where the curve leaves the parabola of the linearisation, standard deviations mislead and the profile's own
interval holds (Bates and Watts 1988, section 6.1). Correlated errors raise the threshold by the ratio of the
sandwich variance to the naive one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from seatrial.certainty.uncertainty import Uncertainty
from seatrial.certainty.whitened import determined
from seatrial.linearisation import Linearisation
from seatrial.search import Array

Refit = Callable[[Mapping[str, float]], float]


@dataclass(frozen=True)
class Profile:
    """Criterion along a line through the estimate.

    Attributes
    ----------
    names
        Unknowns that are held.
    step
        Places (k,) on the line in standard deviations, zero at the estimate.
    values
        Values (k, n) of the held unknowns.
    cost
        Half the sum of squares (k,), priors included, above that of the refit at the estimate.
    quadratic
        The same as the linearisation predicts it (k,).
    threshold
        Cost at the ends of the 95 % interval.
    lower, upper
        Those ends in ``step``, interpolated; infinite where the curve does not reach the threshold.
    """

    names: tuple[str, ...]
    step: Array
    values: Array
    cost: Array
    quadratic: Array
    threshold: float
    lower: float
    upper: float

    def to_dict(self) -> dict[str, Any]:
        """All of it as plain numbers, texts and lists."""
        return {
            "names": list(self.names),
            "threshold": self.threshold,
            "lower": self.lower,
            "upper": self.upper,
        } | {key: getattr(self, key).tolist() for key in ("step", "values", "cost", "quadratic")}


def profile(
    lin: Linearisation,
    refit: Refit,
    *,
    found: Uncertainty,
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
    found : Uncertainty
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
    held = [known[name] for name in names]
    transform, undetermined = determined(lin.information())
    if undetermined[held].any():
        raise ValueError(
            f"direction: the estimate does not determine {', '.join(names)} separately, so there is no"
            " standard deviation to step by; hold what it determines, or give a prior"
        )
    part = transform[held]
    stiffness = np.linalg.inv(part @ part.T)
    dual = stiffness @ along
    curvature = float(along @ dual)
    variance = float(dual @ found.covariance[np.ix_(held, held)] @ dual) / curvature**2
    unit = along * np.sqrt(variance)
    step = np.linspace(-1.0, 1.0, points) * reach
    lower = np.array([lin.unknowns[index].lower for index in held])
    upper = np.array([lin.unknowns[index].upper for index in held])
    values = lin.values[held] + step[:, None] * unit
    inside = ((values >= lower) & (values <= upper)).all(axis=1)
    inside[points // 2] = True
    step, values = step[inside], values[inside]
    cost = np.full(len(step), np.inf)
    for index in np.argsort(np.abs(step), kind="stable"):
        cost[index] = refit(dict(zip(names, map(float, values[index]), strict=True)))
    cost -= cost[int(np.argmin(np.abs(step)))]
    factor = float(np.max((found.upper - found.estimate)[held] / found.sigma[held]))
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
    """First place where a cost that starts at zero reaches the threshold.

    The cost's root is interpolated: it is straight where the cost is a parabola.
    """
    over = np.flatnonzero(cost >= threshold)
    if not len(over) or over[0] == 0:
        return np.inf
    before, after = over[0] - 1, over[0]
    root = np.sqrt(np.maximum(cost[[before, after]], 0.0))
    part = (np.sqrt(threshold) - root[0]) / (root[1] - root[0])
    return float(step[before] + part * (step[after] - step[before]))
