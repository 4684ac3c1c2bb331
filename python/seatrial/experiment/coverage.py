"""Coverage: how often intervals hold the truth, over many repetitions of generated trials.

A 95 % interval is a promise about repetitions: sail the same trials again, with other noise and other
biases of the sensors, and 95 of 100 intervals hold the right value. For recordings nobody can check it;
for generated trials (`seatrial.trial.generated`) the right value is known. The start values and the bounds
are
the campaign's: nothing of the truth enters the estimate.

A coefficient that is called identifiable passes when 44 of 50 intervals hold its truth: fewer would be
bad luck in one case of eighty (binomial distribution, other numbers of repetitions alike). A coefficient
that is called not identifiable is held at a value a quarter of its bounds' width away while all others
are estimated again: the data must not contradict it. Where the truth lies outside the model class there
is no right value to hold; such a campaign is judged by its hold-out, and by whether the residual analysis
warns.

Tested by ``tests/experiment/test_coverage.py``.

What a coverage run found: a row per unknown, what was held at wrong values, who passes.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.errors import CampaignError
from seatrial.base.progress import Clock, Progress
from seatrial.base.run import RunDirectory, run_facts, sha256, to_json, version
from seatrial.campaign.campaign import input_hashes
from seatrial.estimation.joint import Joint
from seatrial.experiment.repetition import Draw, Held, Resailing, draw, hold

if TYPE_CHECKING:
    from seatrial.campaign.campaign import Campaign
    from seatrial.trial.truth import Truth

__all__ = ["Coverage", "CoverageRow", "coverage", "rows"]

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
    facts
        What the result rests on, see `seatrial.base.run.run_facts`.
    """

    campaign: str
    truth: str
    rows: tuple[CoverageRow, ...]
    held: tuple[Held, ...]
    outside: dict[str, tuple[float, float]]
    draws: tuple[Draw, ...]
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
        return sum(one.residual_analysis is not None for one in self.draws)

    @property
    def warned(self) -> int:
        """Repetitions in which it warns."""
        return sum(bool(one.residual_analysis) for one in self.draws)

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
            "analysed": self.analysed,
            "warned": self.warned,
            "rows": [
                asdict(row) | {"required": row.required, "identifiable": row.identifiable}
                for row in self.rows
            ],
            "held": [one.to_dict() | {"contradicted": one.contradicted} for one in self.held],
            "hold_out": self.hold_out(),
            "draws": [one.to_dict() for one in self.draws],
        }

    def save(self, run_dir: str | Path) -> Path:
        """Path of a run directory with the result; an earlier run's is replaced.

        Parameters
        ----------
        run_dir : str or Path
            Made when it does not exist.

        Raises
        ------
        SeatrialError
            The directory cannot be written; nothing is left half-written.
        """
        with RunDirectory(run_dir) as run:
            return run.publish(self.facts, self.files())

    def files(self) -> dict[str, str | bytes]:
        """Files of the run directory by name, see `save`."""
        return {"coverage.json": to_json(self.to_dict())}


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


def coverage(
    campaign: Campaign,
    *,
    seeds: int = 50,
    first: int = 1,
    truth: Truth | None = None,
    analysed: int = 5,
    run_dir: str | Path | None = None,
    progress: Callable[[Progress], None] | None = None,
    resume: bool = True,
    threads: int | None = None,
) -> Coverage:
    """Coverage of a campaign of generated trials.

    Parameters
    ----------
    campaign : Campaign
        Its ``[polish]`` says what is estimated jointly.
    seeds : int
        Repetitions.
    first : int
        Seed of the first one; the others count on.
    truth : Truth, optional
        Sails the trials instead of the recipes' own.
    analysed : int
        Repetitions in which the residual analysis is asked as well.
    run_dir : str or Path, optional
        Folder for the results. Finished repetitions are kept beside it while the run goes on.
    progress : callable, optional
        Called after every repetition and every round of a polish.
    resume : bool
        Reuse the repetitions that an earlier run in this folder finished from the same inputs.
    threads : int, optional
        Threads of the core; by default all. The result does not depend on it.

    Returns
    -------
    Coverage
        After Ctrl-C: that of the repetitions that are done, marked as interrupted.

    Raises
    ------
    CampaignError, TrialError, VehicleError
        A trial is a recording, or the campaign asks for what cannot be done.
    SeatrialError
        The run directory cannot be written.
    """
    if seeds < 1:
        raise CampaignError(f"coverage: expected at least one repetition, found seeds = {seeds}")
    resailing = Resailing(campaign, truth=truth)
    clock = Clock()
    draws: list[Draw] = []
    held: tuple[Held, ...] = ()
    outside: dict[str, tuple[float, float]] = {}
    interrupted = False
    with RunDirectory(run_dir, resume=resume) as run:
        work = _Repetitions(resailing, seeds, run, clock, progress, threads)
        try:
            outside = resailing.outside(Joint(resailing.sail(first), threads=threads))
            for seed in range(first, first + seeds):
                draws.append(work.draw(seed, analysed=seed < first + analysed))
            if not outside:
                held = work.held(first, [row.name for row in rows(draws) if _doubted(row)])
        except KeyboardInterrupt:
            interrupted = True
        found = Coverage(
            campaign=campaign.name,
            truth=resailing.truth.description,
            rows=rows(draws),
            held=held,
            outside=outside,
            draws=tuple(draws),
            asked=seeds,
            interrupted=interrupted,
            facts=run_facts(
                "coverage",
                campaign.name,
                clock=clock,
                inputs=input_hashes(campaign) | {"truth": sha256(resailing.truth.vehicle.to_toml())},
                seed=first,
                options={"repetitions": seeds, "analysed": analysed},
                interrupted=interrupted,
            ),
        )
        if run_dir is not None and not interrupted:
            run.publish(found.facts, found.files())
    return found


def _doubted(row: CoverageRow) -> bool:
    return row.verdict == "not identifiable"


class _Repetitions:
    """Repetitions of a coverage run: run once, kept, and what time is left."""

    def __init__(
        self,
        resailing: Resailing,
        asked: int,
        run: RunDirectory,
        clock: Clock,
        progress: Callable[[Progress], None] | None,
        threads: int | None,
    ) -> None:
        self.resailing, self.asked, self.run, self.clock = resailing, asked, run, clock
        self.progress, self.threads = progress, threads
        self.inputs = _inputs(resailing)
        self.done, self.fresh = 0, 0

    def draw(self, seed: int, *, analysed: bool) -> Draw:
        """A repetition, or what an earlier run kept of it."""
        name = f"seed-{seed}"
        kept = self.run.finished(name, self.inputs)
        if kept is not None and not (analysed and kept["residual_analysis"] is None):
            found = Draw.from_dict(kept)
        else:
            found = draw(
                self.resailing,
                seed,
                analysed=analysed,
                threads=self.threads,
                watch=lambda _: self._show(name),
            )
            self.fresh += 1
            self.run.keep(name, self.inputs, found.to_dict())
        self.done += 1
        self._show(name)
        return found

    def held(self, seed: int, names: Sequence[str]) -> tuple[Held, ...]:
        """Coefficients at wrong values."""
        if not names:
            return ()
        self._show(f"holding {', '.join(names)}")
        name = f"held-{'-'.join(names)}-seed-{seed}"
        kept = self.run.finished(name, self.inputs)
        if kept is not None:
            return tuple(Held.from_dict(entry) for entry in kept["held"])
        found = hold(self.resailing, seed, names, threads=self.threads)
        self.run.keep(name, self.inputs, {"held": [one.to_dict() for one in found]})
        return found

    def _show(self, what: str) -> None:
        if self.progress is None:
            return
        self.progress(
            Progress(
                what=what,
                done=self.done,
                total=self.asked,
                fraction=self.done / self.asked,
                elapsed_s=self.clock.elapsed_s,
                left_s=self.clock.left_s(self.fresh, self.asked - self.done),
            )
        )


def _inputs(resailing: Resailing) -> str:
    """SHA-256 of everything that a repetition depends on besides its seed."""
    campaign = resailing.campaign
    described = {
        "version": version("seatrial"),
        "campaign": campaign.text,
        "vehicle": campaign.vehicle.to_toml(),
        "truth": resailing.truth.vehicle.to_toml(),
        "sensors": {kind: asdict(sensor) for kind, sensor in resailing.truth.sensors.items()},
        "recipes": {name: campaign.file_hash(name) for name in resailing.recipes},
    }
    return sha256(to_json(described))
