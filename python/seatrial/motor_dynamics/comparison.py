"""Do directions or actuators differ: Wald tests of a motor's parameters.

Ahead against astern, from the joint covariance: ``z = (a - b) / sd(a - b)`` with a Student factor. The
vehicle file has one rate limit for both directions: the mean of the two, weighted by their certainty.

One actuator against the others of its group: each is fitted alone, and its parameters are held against the
median of all, which one odd actuator does not move. With m comparisons the level is 5 %/m (Bonferroni).
Held by `tests/test_motor_dynamics.py`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seatrial.motor_dynamics.motor_certainty import MotorCertainty
from seatrial.motor_dynamics.motor_model import NAMES, RECIPROCAL, symbol

__all__ = ["ActuatorDifference", "Directions", "compare_actuators", "compare_directions"]

Array = NDArray[np.float64]

_LEVEL = 0.05
_MANY = 1e9


@dataclass(frozen=True)
class Directions:
    """A parameter ahead against astern.

    ``pooled`` and ``sigma`` belong to one value for both, ``sigma`` no less than half the difference where
    they differ; ``p`` is the probability of a difference as large if there is none.
    """

    name: str
    ahead: float
    astern: float
    p: float
    pooled: float
    sigma: float

    @property
    def differ(self) -> bool:
        """Whether the difference is more than chance, at 5 %."""
        return self.p < _LEVEL

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and texts."""
        return asdict(self) | {"differ": self.differ}


@dataclass(frozen=True)
class ActuatorDifference:
    """A parameter in which one actuator of a group differs from the others' ``median``."""

    actuator: str
    name: str
    value: float
    median: float
    p: float

    def sentence(self) -> str:
        """The difference in one sentence."""
        return (
            f"{self.actuator} differs from its group in {symbol(self.name)}: {self.value:.4g} against"
            f" {self.median:.4g} (p = {self.p:.2g}); give it a motor of its own."
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and texts."""
        return asdict(self)


def compare_directions(
    x: Array, known: MotorCertainty, determined: Mapping[str, bool]
) -> tuple[Directions, ...]:
    """Tests of the parameters that are determined both ahead and astern, at coordinates (11,)."""
    from scipy.special import stdtr

    found = []
    for limit in ("n_min", "n_max", "n_acc", "n_dec"):
        k = NAMES.index(f"{limit}_ahead")
        if not (determined[NAMES[k]] and determined[NAMES[k + 1]]):
            continue
        block = known.covariance[k : k + 2, k : k + 2]
        variance = max(float(block[0, 0] + block[1, 1] - 2.0 * block[0, 1]), 1e-300)
        dof = min(max(float(known.dof[k : k + 2].min()), 1.0), _MANY)
        p = 2.0 * float(stdtr(dof, -abs(x[k] - x[k + 1]) / math.sqrt(variance)))
        weights = 1.0 / np.diag(block)
        weights /= weights.sum()
        pooled, sigma = float(weights @ x[k : k + 2]), math.sqrt(float(weights @ block @ weights))
        ahead, astern = float(x[k]), float(x[k + 1])
        if RECIPROCAL[k]:
            ahead, astern, pooled, sigma = 1.0 / ahead, 1.0 / astern, 1.0 / pooled, sigma / pooled**2
        if p < _LEVEL:
            sigma = max(sigma, 0.5 * abs(ahead - astern))
        found.append(Directions(limit, ahead, astern, p, pooled, sigma))
    return tuple(found)


def compare_actuators(
    alone: Mapping[str, tuple[Array, MotorCertainty]], determined: Mapping[str, bool]
) -> tuple[ActuatorDifference, ...]:
    """Differences of single actuators, each fitted alone: coordinates (11,) and certainty by name."""
    from scipy.special import stdtr

    found = []
    names = list(alone)
    kept = [k for k, name in enumerate(NAMES) if determined[name]]
    level = _LEVEL / max(len(names) * len(kept), 1)
    for k in kept:
        values = np.array([alone[name][0][k] for name in names])
        sigma = np.array([alone[name][1].sigma[k] for name in names])
        told = np.isfinite(sigma) & (sigma > 0)
        if told.sum() < 2:
            continue
        median = float(np.median(values[told]))
        # The median of m values scatters by sqrt(pi/2m) of one.
        shared = math.sqrt(math.pi / (2.0 * told.sum()) * float(np.mean(sigma[told] ** 2)))
        for i in np.flatnonzero(told):
            dof = min(max(float(alone[names[i]][1].dof[k]), 1.0), _MANY)
            z = abs(values[i] - median) / math.hypot(sigma[i], shared)
            p = 2.0 * float(stdtr(dof, -z))
            if p < level:
                value, middle = float(values[i]), median
                if RECIPROCAL[k]:
                    value, middle = (math.inf if one <= 0 else 1.0 / one for one in (value, middle))
                found.append(ActuatorDifference(names[i], NAMES[k], value, middle, p))
    return tuple(found)
