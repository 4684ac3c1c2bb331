"""Identifiability: what the data tell, what only in combination, and what would tell it apart.

The information of all samples on the coefficients, with the nuisance parameters unknown (Schur complement),
is judged on two scales. Over the width of the bounds it gives singular values and vectors: a singular value
s says that the data fix its direction to 1/s of the bounds. Over each coefficient's natural size it gives
the verdict:

    natural size = |value|, at least a tenth of the width of the bounds, at most their width / sqrt(12)

A tenth, because a coefficient that is small beside its bounds need not be known to a part of itself;
1/sqrt(12), because that is the standard deviation of a number somewhere inside the bounds: data that tell
less add nothing. With a standard deviation above `WEAK` of it a coefficient is weak, from `ABSENT` on not
identifiable.

What is not identifiable is described by its smallest combinations (`seatrial.certainty.weak_combination`)
in one sentence each (`seatrial.certainty.undetermined`). All of it is local: it holds for the linearised
model at one point, and for a model of the right structure.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from seatrial.certainty.information import correlation, covariance, eliminate, inflation, singular
from seatrial.certainty.undetermined import ROUNDING, Undetermined, undetermined
from seatrial.certainty.weak_combination import ABSENT, WEAK
from seatrial.linearisation import Linearisation, Unknown
from seatrial.search import Array

ILL_CONDITIONED = 1e4
"""Condition number from which a warning is due: the information's is its square, half of double precision."""

_SMALL = 0.1  # of the width of the bounds; default bounds of damping are four to ten times the value wide
_UNIFORM = 12.0**-0.5
_PART = 0.1  # component of a singular vector that is worth a name
_COLOURED = 1e3  # most that the memory of residuals may widen a standard deviation


@dataclass(frozen=True)
class Judgement:
    """Verdict on one coefficient.

    ``sd`` is its standard deviation in ``unit``, ``relative`` that over its natural size (infinite where the
    data tell nothing), ``correlation`` the multiple correlation coefficient with all others, ``inflation``
    the variance inflation factor ``1/(1 - correlation^2)``.
    """

    name: str
    unit: str
    value: float
    sd: float
    relative: float
    verdict: Literal["identifiable", "weak", "not identifiable"]
    correlation: float
    inflation: float


@dataclass(frozen=True)
class Identifiability:
    """What the data tell of the coefficients.

    Attributes
    ----------
    names
        Coefficients (k), in the order of all arrays.
    singular_values
        Of the sensitivities scaled by the width of the bounds (k,), largest first.
    vectors
        Right singular vectors (k, k), a row each, in widths of the bounds.
    condition
        Largest over smallest singular value; infinite where the smallest is rounding.
    correlation
        Matrix (k, k); zero beside coefficients without any information.
    coefficients
        A `Judgement` per coefficient.
    combinations
        An `Undetermined` for everything that is weak or not identifiable.
    """

    names: tuple[str, ...]
    singular_values: Array
    vectors: Array
    condition: float
    correlation: Array
    coefficients: tuple[Judgement, ...]
    combinations: tuple[Undetermined, ...]

    @property
    def sentences(self) -> tuple[str, ...]:
        """One sentence per combination."""
        return tuple(one.sentence for one in self.combinations)

    @property
    def verdicts(self) -> dict[str, str]:
        """Verdict by coefficient."""
        return {one.name: one.verdict for one in self.coefficients}

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain numbers, texts, lists and dicts; an infinite number is None."""
        return {
            "singular_values": self.singular_values.tolist(),
            "vectors": self.vectors.tolist(),
            "condition": _finite(self.condition),
            "correlation": self.correlation.tolist(),
            "coefficients": [_plain(one) for one in self.coefficients],
            "combinations": [_plain(one) for one in self.combinations],
        }


def judge(lin: Linearisation, sigma: Mapping[str, float] | None = None) -> Identifiability:
    """What a linearised estimate tells of its coefficients.

    Parameters
    ----------
    lin : Linearisation
        At the estimate, or at the start values before it. Priors count as information.
    sigma : mapping, optional
        Standard deviations by name that allow for residuals with a memory
        (`seatrial.certainty.uncertainty`). Of these and those of the information alone the larger counts;
        the correlations are those of the information.
    """
    inside = [i for i, one in enumerate(lin.unknowns) if one.kind == "coefficient"]
    outside = [i for i, one in enumerate(lin.unknowns) if one.kind == "nuisance"]
    unknowns = [lin.unknowns[i] for i in inside]
    names = tuple(one.name for one in unknowns)
    values = np.asarray(lin.values, dtype=float)[inside]
    information = eliminate(lin.information(), inside, outside)
    width, size = _sizes(unknowns, values)
    inverse = covariance(information)
    sd = np.sqrt(np.diag(inverse))
    given = np.array([math.nan if sigma is None else sigma.get(name, math.nan) for name in names])
    known = np.isfinite(given) & np.isfinite(sd)
    widening = (np.where(known, given, 1.0) / np.where(known, sd, 1.0)).clip(1.0, _COLOURED)
    relative = np.fmax(sd, given) / size
    relative = np.where(relative > ROUNDING, np.inf, relative)
    factors = inflation(information, inverse)
    judged = tuple(
        Judgement(
            name=one.name,
            unit=one.unit,
            value=float(values[i]),
            sd=float(relative[i] * size[i]),
            relative=float(relative[i]),
            verdict=_verdict(float(relative[i])),
            correlation=math.sqrt(1.0 - 1.0 / float(factors[i])),
            inflation=float(factors[i]),
        )
        for i, one in enumerate(unknowns)
    )
    spectrum, vectors, condition = singular(information * np.outer(width, width))
    return Identifiability(
        names=names,
        singular_values=spectrum,
        vectors=vectors,
        condition=condition,
        correlation=correlation(inverse),
        coefficients=judged,
        combinations=undetermined(
            lin,
            information,
            relative={one.name: one.relative for one in judged},
            size=size,
            widening=widening,
        ),
    )


def warnings_before(lin: Linearisation) -> list[str]:
    """Sentences to print before optimising: ill-conditioning, and what the data will not tell; or none.

    Parameters
    ----------
    lin : Linearisation
        At the start values.
    """
    found = judge(lin)
    if found.condition <= ILL_CONDITIONED:
        return list(found.sentences)
    astray = found.singular_values * ILL_CONDITIONED < found.singular_values[0]
    part = np.abs(found.vectors[astray]).max(axis=0)
    along = ", ".join(name for name, share in zip(found.names, part, strict=True) if share > _PART)
    size = f"{found.condition:.1e}" if math.isfinite(found.condition) else "infinite"
    return [
        f"ill-conditioned: the condition number of the scaled sensitivities is {size}, at most"
        f" {ILL_CONDITIONED:.0e} is sound; the search will wander along {along}",
        *found.sentences,
    ]


def _sizes(unknowns: Sequence[Unknown], values: Array) -> tuple[Array, Array]:
    """Widths of the bounds and natural sizes (k,); without bounds the value is both, or one."""
    bounded = np.array([math.isfinite(one.scale) and one.scale > 0 for one in unknowns], dtype=bool)
    width = np.where(bounded, [one.scale for one in unknowns], np.abs(values))
    width = np.where(width > 0, width, 1.0)
    size = np.minimum(np.maximum(np.abs(values), _SMALL * width), _UNIFORM * width)
    return width, np.where(bounded, size, width)


def _verdict(relative: float) -> Literal["identifiable", "weak", "not identifiable"]:
    if relative <= WEAK:
        return "identifiable"
    return "weak" if relative < ABSENT else "not identifiable"


def _plain(one: Judgement | Undetermined) -> dict[str, Any]:
    return {
        key: list(value) if isinstance(value, tuple) else _finite(value) for key, value in asdict(one).items()
    }


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
