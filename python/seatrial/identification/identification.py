"""Result of an identification: coefficients with uncertainty, stages, scores; as report, data and files."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from seatrial.base.errors import VehicleError
from seatrial.base.files import parquet
from seatrial.base.finding import Fallback, Finding, is_numerical
from seatrial.base.report import Report, report_of
from seatrial.base.run import RunResult, part_file, to_json
from seatrial.estimation.stage import StageResult
from seatrial.identification.choice import Choice
from seatrial.identification.estimate import (
    CoefficientCovariance,
    Estimate,
    Tally,
    coefficient_covariance,
    derived,
    tally,
)
from seatrial.identification.hold_out import POOLED, Restarts, likelihood_gain
from seatrial.identification.preparation import Held

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.diagnosis.assessment import Assessment
    from seatrial.diagnosis.identifiability import Identifiability
    from seatrial.estimation.scale import ScaleReport
    from seatrial.identification.events import EventEstimate
    from seatrial.identification.rounds import Proposal
    from seatrial.problem.problem import Problem
    from seatrial.scoring.score import Score


@dataclass(frozen=True)
class Conditional:
    """An estimate that rests on a held value: how it would change were that value a fifth larger."""

    #: Of the estimated coefficient.
    name: str
    unit: str
    #: The held one, by its name in the campaign.
    on: str
    #: In SI, and in standard deviations of the estimate.
    change: float
    deviations: float


@dataclass(frozen=True, repr=False)
class Identification(RunResult):
    """The identified vehicle, its coefficients, stages and scores; made by `seatrial.identify`.

    Attributes
    ----------
    problem
        What was asked for, without what is ``held``.
    vehicle
        The problem's vehicle with the estimates.
    coefficients
        An `Estimate` per coefficient: start value, estimate, bounds, bound hit or not.
    stages
        A `StageResult` per stage that ran: costs, history, segments, step.
    assessment
        An `Assessment`: joint estimate, standard deviations, what the data tell, what the model lacks; None
        where the stages were interrupted or the trials cannot be judged jointly.
    before
        Sentences on what the data cannot tell, known before the search.
    findings
        What of it spoils every estimate, the gravest first: a late velocity, actuators that contradict the
        vehicle file.
    held
        A `Held` per coefficient that was to be identified and that feedback hides: it keeps the value of the
        vehicle file.
    scale
        A `ScaleReport`: what the absolute scale of all forces rests on, and what the anchors say of it.
    scores
        "fit" (the training part of every trial in a stage) and, where something is held out, "hold_out";
        each holds a `Score` per trial and one pooled under "all", for ``restarts.ahead_s`` ahead ("ahead")
        and for a free run ("free").
    notes
        Sentences about what could not be scored.
    facts
        Versions, machine, seed, hashes of the inputs, times.
    interrupted, not_run
        Whether Ctrl-C ended the run early, and the stages that it left out.
    choice
        A `Choice`: stages and joint estimate judged on data outside the fit, and which is the result; None
        without a joint estimate.
    conditional
        A `Conditional` per estimate that rests on a held value: how far it would move were that 20 % larger.
    restarts
        Where the simulations of the scores restart and how far they run (`Restarts`): the state that the
        filter of a joint estimate knew, less than ten seconds where the vehicle runs away.
    proposals
        A `Proposal` per change of the model that was tried in rounds, and whether it was kept.
    events
        An `EventEstimate` per stage whose commands answer the motion: what its open-loop stretches tell.
    doubt
        Heading where many vehicles drawn from the covariance are physically impossible; empty otherwise.
    fallbacks
        A `Fallback` per step that failed: which, why, what the result has instead, what to do.
    """

    problem: Problem
    vehicle: Vehicle
    coefficients: tuple[Estimate, ...]
    stages: tuple[StageResult, ...]
    assessment: Assessment | None
    before: tuple[str, ...]
    findings: tuple[Finding, ...]
    held: tuple[Held, ...]
    scale: ScaleReport
    scores: Mapping[str, Mapping[str, Mapping[str, Score]]]
    notes: tuple[str, ...]
    facts: Mapping[str, Any]
    interrupted: bool
    not_run: tuple[str, ...]
    choice: Choice | None = None
    doubt: str = ""
    conditional: tuple[Conditional, ...] = ()
    restarts: Restarts = field(default_factory=Restarts)
    fallbacks: tuple[Fallback, ...] = ()
    proposals: tuple[Proposal, ...] = ()
    events: tuple[EventEstimate, ...] = ()

    def report(self, *, truth: Mapping[str, float] | None = None) -> Report:
        """How good, the worst problem, what to do next; then tables and remarks.

        Parameters
        ----------
        truth : mapping of str to float, optional
            True coefficients of generated trials, shown beside the estimates.
        """
        return report_of(self, truth=truth)

    @property
    def stages_vehicle(self) -> Vehicle:
        """The campaign's vehicle with the estimates of the stages, before the joint estimate.

        Without a stage whose estimates make it impossible beside those of the stages before.
        """
        vehicle = self.problem.vehicle
        for stage in self.stages:
            with contextlib.suppress(VehicleError):
                vehicle = vehicle.with_coefficients(stage.coefficients)
        return vehicle.without_model_error()

    @property
    def identifiability(self) -> Identifiability | None:
        """What the data tell and what they cannot; None without a joint estimate."""
        return None if self.assessment is None else self.assessment.identifiability

    @cached_property
    def covariance(self) -> CoefficientCovariance | None:
        """Covariance of the coefficients, SI, to draw vehicles with; None without a joint estimate."""
        if self.assessment is None and not any(estimate.enough for estimate in self.events):
            return None
        try:
            return coefficient_covariance(
                self.assessment,
                self.vehicle,
                scale=self.scale,
                staged=[row.name for row in self.coefficients],
                bench=self.problem.bench,
                held=list(dict.fromkeys(row.parameter for row in self.held)),
                events=[estimate for estimate in self.events if estimate.enough],
            )
        except ValueError as error:
            if not is_numerical(error):
                raise
            return None

    @property
    def tally(self) -> Tally:
        """How many of the coefficients that were asked for the trials determine.

        Those that are only presumed (`seatrial.Problem.presumed`) are not asked for.
        """
        known = set(self.problem.presumed)
        sought = [row for row in self.coefficients if row.parameter not in known]
        return tally(sought, [row.parameter for row in self.held if row.parameter not in known])

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviations of the jointly estimated coefficients, SI; infinite if undetermined."""
        return {row.name: row.sigma for row in self.coefficients if row.sigma is not None}

    @property
    def baselines(self) -> dict[str, dict[str, float]]:
        """R2 by baseline and velocity channel, ``restarts.ahead_s`` ahead on what is held out.

        On the windows of the model's own score, after a fit of the baselines to the same training part
        (`seatrial.scoring.baselines`); on the training part itself where nothing is held out.
        """
        score = judged_score(self)
        return {} if score is None else {name: dict(row) for name, row in score.baselines.items()}

    @property
    def likelihood(self) -> dict[str, tuple[str, float]]:
        """Per velocity channel the best baseline on what is held out, and the model's gain over it.

        Log-likelihood per sample (natural logarithm), each with the error variance of its training part;
        empty where nothing is held out.
        """
        return likelihood_gain(self.scores)

    def score_rows(self) -> Iterator[dict[str, Any]]:
        """A row per part, kind, trial and channel of the scores."""
        for part, kinds in self.scores.items():
            for kind, row in kinds.items():
                for trial, score in row.items():
                    for channel, entry in score.items():
                        yield {"part": part, "kind": kind, "trial": trial, "channel": channel} | asdict(entry)

    def to_dict(self) -> dict[str, Any]:
        """Everything but the trials as plain numbers, texts, lists and dicts."""
        return {
            "campaign": self.problem.name,
            "vehicle": self.vehicle.name,
            "interrupted": self.interrupted,
            "not_run": list(self.not_run),
            "coefficients": [asdict(row) | {"factor": row.factor} for row in self.coefficients],
            "derived": derived(self.vehicle),
            "stages": [stage.to_dict() for stage in self.stages],
            "before": list(self.before),
            "findings": [finding.to_dict() for finding in self.findings],
            "held": [asdict(row) for row in self.held],
            "outcome": "interrupted" if self.interrupted else self.tally.outcome,
            "tally": asdict(self.tally),
            "conditional": [asdict(row) for row in self.conditional],
            "scale": self.scale.to_dict(),
            "assessment": None if self.assessment is None else self.assessment.to_dict(),
            "covariance": None if self.covariance is None else self.covariance.to_dict(),
            "scores": {
                part: {
                    kind: {name: score.to_dict() for name, score in row.items()} for kind, row in of.items()
                }
                for part, of in self.scores.items()
            },
            "baselines": self.baselines,
            "likelihood": {
                c: {"best_baseline": name, "nats_per_sample": nats}
                for c, (name, nats) in self.likelihood.items()
            },
            "replayed": list(self.problem.replayed),
            "choice": None if self.choice is None else self.choice.to_dict(),
            "events": [estimate.to_dict() for estimate in self.events],
            "proposals": [proposal.to_dict() for proposal in self.proposals],
            "notes": list(self.notes),
            "fallbacks": [fallback.to_dict() for fallback in self.fallbacks],
            "doubt": self.doubt,
            "facts": dict(self.facts),
        }

    def files(self) -> dict[str, str | bytes]:
        """Files of the run directory by name, see `save`."""
        import polars as pl

        coefficients = pl.DataFrame(
            [asdict(row) | {"factor": row.factor} for row in self.coefficients], infer_schema_length=None
        )
        history = pl.DataFrame(
            [{"stage": stage.name} | asdict(step) for stage in self.stages for step in stage.history],
            infer_schema_length=None,
        )
        scores = pl.DataFrame(list(self.score_rows()), infer_schema_length=None)
        files: dict[str, str | bytes] = {
            "campaign.toml": self.problem.text,
            "vehicle.toml": _comment(self.held) + self.vehicle.to_toml(),
            "vehicle_stages.toml": _comment(self.held) + self.stages_vehicle.to_toml(),
            "identification.json": to_json(self.to_dict()),
            **self.report().files(),
            "coefficients.parquet": parquet(coefficients),
            "history.parquet": parquet(history),
            "scores.parquet": parquet(scores),
        }
        for stage in self.stages:
            if not stage.interrupted:
                files[part_file(stage.name)] = to_json(stage.to_dict())
        return files


def judged_score(fit: Identification) -> Score | None:
    """The score that heads the summary: some seconds ahead on what is held out, else on the training part."""
    return pooled_score(fit.scores.get("hold_out", {}).get("ahead", {})) or pooled_score(
        fit.scores.get("fit", {}).get("ahead", {})
    )


def pooled_score(scores: Mapping[str, Score]) -> Score | None:
    """Score over all trials together, or the only one there is."""
    return scores.get(POOLED) or next(iter(scores.values()), None)


def _comment(held: Sequence[Held]) -> str:
    """Comment for the head of the vehicle file; empty where nothing was held."""
    lines = [
        f"# {row.name} = {row.value:.6g} {row.unit}: not identified, dominated by feedback ({row.axis})"
        for row in held
    ]
    return "\n".join([*lines, f"# {held[0].trial}", "", ""]) if held else ""
