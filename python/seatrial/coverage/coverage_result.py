"""What a coverage run found: a row per unknown, what was held at wrong values, who passes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from seatrial.coverage.repetition import Draw, Held

__all__ = ["Coverage", "CoverageRow", "rows"]

LEVEL = 0.95
"""Probability with which an interval promises to hold the truth."""

RISK = 0.0125
"""Largest probability with which honest intervals may fail: 44 of 50 must hold the truth."""

IDENTIFIABLE = "identifiable"


@dataclass(frozen=True)
class CoverageRow:
    """One unknown over all repetitions, in its unit.

    Attributes
    ----------
    name, unit, kind
        The unknown; the biases of a channel, drawn anew for every trial and seed, share a row.
    truth
        Right value; NaN where it is drawn anew or there is none.
    mean
        Mean estimate.
    bias
        Mean of estimate minus truth.
    bias_t
        ``bias`` over its standard error: about two and more is no chance.
    sigma
        Root mean square of the standard deviations that the estimates state.
    scatter
        Standard deviation of estimate minus truth.
    inside, n
        Intervals that hold the truth, of how many.
    verdicts
        How often each verdict was given.
    """

    name: str
    unit: str
    kind: str
    truth: float
    mean: float
    bias: float
    bias_t: float
    sigma: float
    scatter: float
    inside: int
    n: int
    verdicts: dict[str, int]

    @property
    def identifiable(self) -> bool:
        """Whether that is the most frequent verdict."""
        return self.verdict == IDENTIFIABLE

    @property
    def required(self) -> int:
        """Intervals that must hold the truth."""
        return required(self.n)

    @property
    def verdict(self) -> str:
        """The most frequent verdict."""
        return max(self.verdicts, key=lambda word: self.verdicts[word])


@dataclass(frozen=True)
class Coverage:
    """What a coverage run found; made by `coverage`.

    Attributes
    ----------
    campaign, truth
        Names of the campaign and of the truth vehicle's description.
    rows
        A `CoverageRow` per unknown.
    held
        Coefficients called not identifiable, held at wrong values.
    outside
        Coefficients that the truth has otherwise than the estimate can: assumed and true value.
    draws
        The repetitions.
    asked
        How many were asked for.
    interrupted
        Whether Ctrl-C ended the run early.
    """

    campaign: str
    truth: str
    rows: tuple[CoverageRow, ...]
    held: tuple[Held, ...]
    outside: dict[str, tuple[float, float]]
    draws: tuple[Draw, ...]
    asked: int
    interrupted: bool

    @property
    def failures(self) -> tuple[str, ...]:
        """Sentences about what breaks a promise; none if the truth is outside the model class."""
        if self.outside:
            return ()
        said = [
            f"{row.name}: {row.inside} of {row.n} intervals hold the truth, at least {row.required} must"
            for row in self.rows
            if row.identifiable and row.inside < row.required
        ]
        said += [
            f"{one.name}: called not identifiable, but the data contradict {one.value:.4g} {one.unit}"
            f" (log-likelihood ratio {2.0 * one.rise:.1f})"
            for one in self.held
            if one.contradicted
        ]
        return tuple(said)

    @property
    def criticised(self) -> int:
        """Repetitions in which the model criticism was asked."""
        return sum(one.criticism is not None for one in self.draws)

    @property
    def warned(self) -> int:
        """Repetitions in which it warns."""
        return sum(bool(one.criticism) for one in self.draws)

    def hold_out(self) -> dict[str, dict[str, float]]:
        """Mean R2 on the held-out trials by vehicle ("start", "estimate", "truth") and channel."""
        if not self.draws:
            return {}
        return {
            vehicle: {
                channel: float(np.mean([one.hold_out[vehicle][channel] for one in self.draws]))
                for channel in of
            }
            for vehicle, of in self.draws[0].hold_out.items()
        }

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain numbers, texts, lists and dicts."""
        return {
            "campaign": self.campaign,
            "truth": self.truth,
            "asked": self.asked,
            "interrupted": self.interrupted,
            "outside": {name: list(pair) for name, pair in self.outside.items()},
            "failures": list(self.failures),
            "criticised": self.criticised,
            "warned": self.warned,
            "rows": [
                asdict(row) | {"required": row.required, "identifiable": row.identifiable}
                for row in self.rows
            ],
            "held": [one.to_dict() | {"contradicted": one.contradicted} for one in self.held],
            "hold_out": self.hold_out(),
            "draws": [one.to_dict() for one in self.draws],
        }


def required(n: int) -> int:
    """Intervals of n that must hold the truth: fewer would be bad luck in at most one case of eighty.

    Examples
    --------
    >>> required(50), required(8)
    (44, 6)
    """
    below = 0.0
    for k in range(n + 1):
        below += math.comb(n, k) * LEVEL**k * (1.0 - LEVEL) ** (n - k)
        if below > RISK:
            return k
    return n


def rows(draws: Sequence[Draw]) -> tuple[CoverageRow, ...]:
    """A row per unknown of the repetitions; biases of one channel are pooled over trials.

    Unknowns without a right value keep their row, with no interval that holds it.
    """
    if not draws:
        return ()
    one = draws[0]
    table = {name: np.array([getattr(d, name) for d in draws]) for name in ("truth", "estimate", "sigma")}
    inside = np.array([
        [a <= x <= b for a, x, b in zip(d.lower, d.truth, d.upper, strict=True)] for d in draws
    ])
    groups: dict[str, list[int]] = {}
    for index, (name, kind) in enumerate(zip(one.names, one.kinds, strict=True)):
        drawn = kind == "nuisance" and np.ptp(table["truth"][:, index]) > 0
        label = name.rpartition(": ")[2] if drawn else name
        groups.setdefault(label, []).append(index)
    found = []
    for label, places in groups.items():
        truth, estimate, sigma = (table[name][:, places].ravel() for name in ("truth", "estimate", "sigma"))
        error = estimate - truth
        scatter = float(error.std(ddof=1)) if len(error) > 1 else math.nan
        bias = float(error.mean())
        with np.errstate(divide="ignore", invalid="ignore"):
            t = float(np.divide(bias, scatter / np.sqrt(len(error))))
        found.append(
            CoverageRow(
                name=label,
                unit=one.units[places[0]],
                kind=one.kinds[places[0]],
                truth=float(truth[0]) if np.ptp(truth) == 0 else math.nan,
                mean=float(estimate.mean()),
                bias=bias,
                bias_t=t,
                sigma=float(np.sqrt(np.mean(sigma**2))),
                scatter=scatter,
                inside=int(inside[:, places].sum()),
                n=len(error),
                verdicts=dict(Counter(d.verdict[place] for d in draws for place in places)),
            )
        )
    return tuple(found)
