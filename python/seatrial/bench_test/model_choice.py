"""Which order the points ask for: square, through the origin, free, cubic; by AICc and F tests.

    AICc = n ln(SSE/n) + 2k + 2k(k + 1)/(n - k - 1),  k = p + 1

(Hurvich and Tsai 1989, Biometrika 76:297). Two models less than 2 apart are as good as each other; then the
one with fewer coefficients is recommended. The F test asks whether a larger model of the same chain tells
more than the chosen one.

Tests: ``tests/test_bench_regression.py``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seatrial.bench_test.least_squares import Term, least_squares, terms_of

__all__ = ["Candidate", "candidates", "lack_of_fit"]

Array = NDArray[np.float64]

_AS_GOOD = 2.0

MODELS: dict[str, tuple[tuple[Term, ...], str]] = {
    "square": (terms_of(2, 1, square=True), 'order = "square"'),
    "second order through the origin": (
        terms_of(2, 1, through_origin=True),
        "order = 2, through_origin = true",
    ),
    "second order, free": (terms_of(2, 1), "order = 2, through_origin = false"),
    "third order, free": (terms_of(3, 1), "order = 3, through_origin = false"),
}
"""Models that are compared: terms and the keys that ask for them, each contained in the next."""


@dataclass(frozen=True)
class Candidate:
    """One model on the same points.

    Attributes
    ----------
    name, keys
        In words, and what to write in the bench file.
    terms
        Its coefficients.
    sse, scatter, aicc
        Sum of squares in N², standard deviation of the residuals in N, and the criterion; lower is better.
    """

    name: str
    keys: str
    terms: tuple[Term, ...]
    sse: float
    scatter: float
    aicc: float


def candidates(signal: Array, thrust: Array) -> tuple[Candidate, ...]:
    """Candidates that the points (n,) can tell, by AICc, the best one first."""
    found = []
    n = len(thrust)
    for name, (terms, keys) in MODELS.items():
        k = len(terms) + 1
        if n - k - 1 < 1:
            continue
        try:
            fit = least_squares(signal[:, None], thrust, terms)
        except ValueError:
            continue
        # Exact data have no scatter: rounding of the load is then the floor.
        sse = max(float(fit.residual @ fit.residual), n * (1e-9 * float(np.abs(thrust).max())) ** 2)
        aicc = n * math.log(sse / n) + 2 * k + 2 * k * (k + 1) / (n - k - 1)
        found.append(Candidate(name, keys, terms, sse, fit.sigma, aicc))
    return tuple(sorted(found, key=lambda one: one.aicc))


def recommended(found: tuple[Candidate, ...]) -> Candidate:
    """Candidate with the fewest coefficients among those as good as the best."""
    good = [one for one in found if one.aicc - found[0].aicc < _AS_GOOD]
    return min(good, key=lambda one: len(one.terms))


def lack_of_fit(found: tuple[Candidate, ...], chosen: tuple[Term, ...], n: int) -> str:
    """Sentence on whether the chosen terms fit the n points, and what would fit better."""
    if not found:
        return "too few points to compare orders"
    best = recommended(found)
    own = next((one for one in found if one.terms == chosen), None)
    if own is None:
        return f"of the usual models {best.name} describes the points best ({best.keys})"
    if own.aicc - best.aicc < _AS_GOOD:
        fewer = len(best.terms) < len(own.terms)
        name = "thrust per n|n|" if own.name == "square" else own.name
        return f"{name} fits" + (f"; {best.name} as well, with fewer coefficients" if fewer else "")
    if set(best.terms) < set(own.terms):
        return (
            f"{best.name} fits as well, with fewer coefficients ({best.keys}): the intervals would be"
            " narrower"
        )
    return (
        f"{best.name} describes the points better ({best.keys}): they scatter by {best.scatter:.2g} N instead"
        f" of {own.scatter:.2g} N, AICc lower by {own.aicc - best.aicc:.1f}{_f_words(own, best, n)}; the"
        " intervals stand for a curve of the order asked for"
    )


def _f_words(small: Candidate, large: Candidate, n: int) -> str:
    if not set(small.terms) < set(large.terms):
        return ""
    from scipy.stats import f

    more, dof = len(large.terms) - len(small.terms), n - len(large.terms)
    ratio = (small.sse - large.sse) / more / (large.sse / dof)
    p = float(f.sf(ratio, more, dof))
    return f", F test p {'below 0.001' if p < 0.001 else f'= {p:.2g}'}"
