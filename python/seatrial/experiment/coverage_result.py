"""Result of a coverage run: a row per unknown, coefficients held at wrong values, what fails.

Held by ``tests/experiment/test_coverage_result.py``.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from seatrial.base.report import Report, Section, Table
from seatrial.base.run import RunResult, to_json
from seatrial.experiment.generated_trials import unmodelled
from seatrial.experiment.repetition import Held, Repetition

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
class Coverage(RunResult):
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
        Coefficients whose true value the estimate cannot reach: assumed and true value.
    repetitions
        The repetitions that were run.
    asked
        How many were asked for.
    interrupted
        Whether Ctrl-C ended the run early.
    facts
        What the result rests on, see `seatrial.base.run.run_facts`.
    """

    campaign: str
    truth: str
    rows: tuple[CoverageRow, ...]
    held: tuple[Held, ...]
    outside: dict[str, tuple[float, float]]
    repetitions: tuple[Repetition, ...]
    asked: int
    interrupted: bool
    facts: Mapping[str, Any] = field(default_factory=dict)

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
    def analysed(self) -> int:
        """Repetitions in which the residual analysis was asked."""
        return sum(one.residual_analysis is not None for one in self.repetitions)

    @property
    def warned(self) -> int:
        """Repetitions in which it warns."""
        return sum(bool(one.residual_analysis) for one in self.repetitions)

    def hold_out(self) -> dict[str, dict[str, float]]:
        """Mean R2 on the held-out trials by vehicle ("start", "estimate", "truth") and channel."""
        if not self.repetitions:
            return {}
        return {
            vehicle: {
                channel: float(np.mean([one.hold_out[vehicle][channel] for one in self.repetitions]))
                for channel in of
            }
            for vehicle, of in self.repetitions[0].hold_out.items()
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
            "analysed": self.analysed,
            "warned": self.warned,
            "rows": [
                asdict(row) | {"required": row.required, "identifiable": row.identifiable}
                for row in self.rows
            ],
            "held": [one.to_dict() | {"contradicted": one.contradicted} for one in self.held],
            "hold_out": self.hold_out(),
            "repetitions": [one.to_dict() for one in self.repetitions],
        }

    def files(self) -> dict[str, str | bytes]:
        """Files of the run directory by name, see `save`."""
        return {"coverage.json": to_json(self.to_dict()), **self.report().files()}

    def report(self) -> Report:
        """How many intervals hold the truth, what fails, what to do; then the unknowns and the hold-out."""
        return _report(self)

    def summary(self) -> str:
        """The report as plain text."""
        return self.report().text()

    def __str__(self) -> str:
        return self.summary()


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


def rows(repetitions: Sequence[Repetition]) -> tuple[CoverageRow, ...]:
    """A row per unknown of the repetitions; biases of one channel are pooled over trials.

    Unknowns without a right value keep their row, with no interval that holds it.
    """
    if not repetitions:
        return ()
    one = repetitions[0]
    table = {
        name: np.array([getattr(d, name) for d in repetitions]) for name in ("truth", "estimate", "sigma")
    }
    inside = np.array([
        [a <= x <= b for a, x, b in zip(d.lower, d.truth, d.upper, strict=True)] for d in repetitions
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
                verdicts=dict(Counter(d.verdict[place] for d in repetitions for place in places)),
            )
        )
    return tuple(found)


def _report(found: Coverage) -> Report:
    worst, next_step = _worst(found)
    judged = [row for row in found.rows if row.identifiable]
    inside, n = sum(row.inside for row in judged), sum(row.n for row in judged)
    share = f"{inside} of {n} intervals ({100.0 * inside / n:.1f} %)" if n else "none of the intervals"
    return Report(
        title=found.campaign,
        outcome=_outcome(found),
        good=(
            f"{share} of identifiable unknowns hold the truth over {len(found.repetitions)} repetitions;"
            f" {100.0 * LEVEL:.0f} % should"
        ),
        worst=worst,
        next_step=next_step,
        sections=(Section(tables=tuple(_tables(found)), sentences=tuple(_sentences(found))),),
    )


def _outcome(found: Coverage) -> str:
    if found.interrupted:
        return "interrupted"
    if found.outside:
        return "truth outside the model class"
    return "failed" if found.failures else "held"


def _worst(found: Coverage) -> tuple[str, str]:
    """The worst problem and what to do about it."""
    if found.interrupted:
        return (
            f"interrupted after {len(found.repetitions)} of {found.asked} repetitions",
            "run the same command again; it goes on from there",
        )
    if found.outside:
        return (
            f"the truth is outside the model class: {unmodelled(found.outside)}; its coefficients have no"
            " true value",
            "judge the model by its hold-out, and by whether the residual analysis warns",
        )
    if found.failures:
        return found.failures[
            0
        ], "distrust the intervals of this campaign: look at bias/sd, sigma and scatter"
    judged = [row for row in found.rows if row.identifiable and row.n]
    if not judged:
        return "no unknown is identifiable", "add trials or narrow the bounds"
    least = min(judged, key=lambda row: row.inside / row.n)
    return (
        f"{least.name}: {least.inside} of {least.n} intervals hold the truth, at least {least.required} must",
        "rely on the intervals of recorded trials that are alike",
    )


def _tables(found: Coverage) -> Iterator[Table]:
    head = ("unknown", "unit", "truth", "mean", "bias/sd", "sigma", "scatter", "inside", "verdict")
    title = f"{100.0 * LEVEL:.0f} % intervals over {len(found.repetitions)} repetitions"
    yield Table.of(title, head, [_cells(row) for row in found.rows], left=2)
    scores = found.hold_out()
    if any(scores.values()):
        channels = list(next(iter(scores.values())))
        body = [[name, *(f"{of[channel]:.3f}" for channel in channels)] for name, of in scores.items()]
        yield Table.of("Held-out trials, R2 ten seconds ahead, mean", ["vehicle", *channels], body)


def _cells(row: CoverageRow) -> list[str]:
    """Bias is over its standard error; digits follow sigma."""
    digits = 4
    if math.isfinite(row.sigma) and row.sigma > 0.0 and row.mean:
        digits = max(math.floor(math.log10(abs(row.mean))) - math.floor(math.log10(row.sigma)) + 2, 3)

    def number(value: float, places: int = digits) -> str:
        return "" if math.isnan(value) else f"{value:#.{places}g}".rstrip(".")

    often = row.verdicts[row.verdict]
    return [
        row.name,
        row.unit,
        number(row.truth) or "drawn",
        number(row.mean) if math.isfinite(row.truth) else "",
        number(row.bias_t, 2),
        number(row.sigma, 2),
        number(row.scatter, 2),
        f"{row.inside}/{row.n}",
        row.verdict if often == row.n else f"{row.verdict} {often}/{row.n}",
    ]


def _sentences(found: Coverage) -> Iterator[str]:
    yield from (f"FAILED: {text}" for text in found.failures)
    for one in found.held:
        yield (
            f"{one.name} held at {one.value:.4g} {one.unit} instead of {one.estimate:.4g}: the log-likelihood"
            f" ratio is {2.0 * one.rise:.2f}, {'above' if one.contradicted else 'below'} 3.84 of 95 %"
        )
    if found.analysed:
        yield f"the residual analysis warns in {found.warned} of {found.analysed} repetitions"
        for first in [repetition for repetition in found.repetitions if repetition.residual_analysis][:1]:
            yield from (f"seed {first.seed}: {text}" for text in first.residual_analysis or ())
    slow = [one.seed for one in found.repetitions if not one.converged]
    if slow:
        yield f"not converged within the rounds of the polish: seeds {', '.join(map(str, slow))}"
