"""Result of a tuning: autopilot, margins, how responses keep to their corridors and why not, gains reverted.

Why a response leaves its corridor tells the same step with perfect sensors, in still water: where it stays
inside, noise or latency is what is left; where not, its metrics tell which bound the loop cannot keep to.
Held by tests/tuning/test_tune.py, test_performance_claims.py, test_revert_gains.py and test_tuning_words.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.files import parquet
from seatrial.base.plain import Plain, plain
from seatrial.base.run import RunResult, to_json
from seatrial.control_design.tuning_table import LOOPS
from seatrial.flight.checks import tuned_for
from seatrial.tuning.criterion import step_metrics
from seatrial.tuning.objective import SETTINGS as OBJECTIVE_SETTINGS
from seatrial.tuning.objective import violated
from seatrial.tuning.search import SETTINGS as GROUP_SEARCH_SETTINGS
from seatrial.tuning.search import GroupResult, short_loops
from seatrial.tuning.step_trial import LoopTrials, Rig, Samples

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.control_design.margin_constraint import MarginConstraint
    from seatrial.control_design.margin_report import ReportedMargins
    from seatrial.control_design.tuning_table import Margins
    from seatrial.tuning.control_problem import ControlProblem, Group


_DIGITS = 4  # of gains in a file: no more is read or set by hand

_ANY = ", with any gains within the bounds"


@dataclass(frozen=True, eq=False, repr=False)
class Tuning(RunResult):
    """What a tuning found; made by `seatrial.tune`.

    `plan` is what was asked, with trials and samples; `autopilot` has the tuned gains, `groups` a
    `GroupResult` per search in their order. `performance` holds the responses of the start gains ("start")
    and of the tuned ones ("tuned") on samples that the search never saw; `quiet` those of the tuned ones with
    perfect sensors where a response leaves its corridor. `reverted`: groups that have their start gains
    again, because everything together is better with them. Of an `interrupted` tuning (Ctrl-C) nothing is
    assessed; `kept` is the autopilot file with its best gains. `elapsed_s`: wall time; `facts`: what the
    result rests on, see `seatrial.base.run.run_facts`.
    """

    plan: ControlProblem
    autopilot: Autopilot
    groups: tuple[GroupResult, ...]
    performance: tuple[Performance, ...]
    reverted: tuple[str, ...]
    elapsed_s: float
    interrupted: bool
    kept: Path | None = None
    quiet: Performance | None = None
    facts: Mapping[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        groups = ", ".join(group.name for group in self.groups)
        state = "interrupted" if self.interrupted else f"feasible={self.feasible}"
        return f"Tuning({self.plan.name}: {state}, searched: {groups})"

    @property
    def start(self) -> Autopilot:
        """The autopilot with the start gains."""
        return self.plan.autopilot

    def of(self, name: str) -> Performance | None:
        """The assessment of that name."""
        return next((performance for performance in self.performance if performance.name == name), None)

    @property
    def feasible(self) -> bool:
        """Whether the vehicle itself violates no corridor with the tuned gains."""
        tuned = self.of("tuned")
        return tuned is not None and tuned.feasible

    @property
    def held(self) -> bool:
        """Whether corridors and margins are held: by the vehicle itself, and by its linear loops."""
        return self.feasible and not self.short_margins

    @property
    def outcome(self) -> str:
        """In a word or two: tuned, requirements not met, or interrupted."""
        if self.interrupted:
            return "interrupted"
        return "tuned" if self.held else "tuned, requirements not met"

    @cached_property
    def margins(self) -> Mapping[str, list[ReportedMargins]]:
        """Margins per mode, reachable breakpoint and loop, "start" and "tuned"."""
        from seatrial.control_design.margin_report import report_margins

        pairs = {"start": self.start, "tuned": self.autopilot}
        plan = self.plan
        return {
            name: report_margins(plan.vehicle, autopilot, sensors=plan.sensors)
            for name, autopilot in pairs.items()
        }

    @property
    def short_margins(self) -> tuple[str, ...]:
        """Loops whose margins fall short of the campaign's, with what there is and what was asked."""
        if self.interrupted:
            return ()
        rows = self.margins["tuned"]
        # A motion that grows is no matter of limits: it counts where no margin is asked for, too.
        unstable = dict.fromkeys((row.mode, row.speed_m_s) for row in rows if not row.stable)
        beyond = self.plan.beyond_gains
        shortfalls = [
            f"{mode} at {speed:.2f} m/s (unstable{_ANY if (mode, speed) in beyond else ''})"
            for mode, speed in sorted(
                unstable, key=lambda point: (point in beyond, point[1] < 0.0, abs(point[1]))
            )
        ]
        for row in rows:
            short = _told_short(row, self.plan.table.margins)
            if short and row.stable:  # margins of an unstable loop mean something else
                shortfalls.append(f"{row.loop} in {row.mode} at {row.speed_m_s:.2f} m/s ({', '.join(short)})")
        return tuple(shortfalls)

    def on(self, vehicle: Vehicle | str | Path, *, name: str = "another vehicle") -> Performance:
        """How the tuned responses keep to their corridors on a `vehicle` that the autopilot does not know,
        under a `name`, in still water; the autopilot's own model stays the identified one. Raises
        VehicleError where it cannot be loaded, SimulationError where its actuators are others.
        """
        from seatrial._core import Vehicle
        from seatrial.base.toml_file import loaded
        from seatrial.tuning.result import assess
        from seatrial.tuning.step_trial import Samples

        flown = loaded(Vehicle, vehicle)
        still = Samples({}, np.zeros((1, 3)), (1,))
        return assess(self.plan, name, self.plan.rig(self.autopilot, vehicle=flown), still)

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain data."""
        return {
            "campaign": self.plan.name,
            "vehicle": self.plan.vehicle.name,
            "autopilot": self.autopilot.name,
            "feasible": self.feasible,
            "held": self.held,
            "short_margins": list(self.short_margins),
            "interrupted": self.interrupted,
            "kept": None if self.kept is None else str(self.kept),
            "elapsed_s": self.elapsed_s,
            "plan": self.plan.to_dict(),
            "gains": {"start": self.start.gains(), "tuned": self.autopilot.gains()},
            "reverted": list(self.reverted),
            "groups": [group.to_dict() for group in self.groups],
            "performance": [performance.to_dict() for performance in self.performance],
            "margins": {} if self.interrupted else plain(self.margins),
            "notes": list(self.plan.fitted.notes),
        }

    def files(self) -> dict[str, str | bytes]:
        """Files of the run directory by name, see `save`."""
        from dataclasses import asdict

        import polars as pl
        import tomlkit

        history = [{"search": group.name} | asdict(step) for group in self.groups for step in group.history]
        trials = [
            {"autopilot": performance.name} | asdict(trial)
            for performance in self.performance
            for trial in performance.trials
        ]
        asked = {"tuning": self.plan.table.model_dump(mode="json", exclude_none=True, exclude_defaults=True)}
        return {
            **(
                {"tuning.toml": tomlkit.dumps(asked)}
                if self.plan.given_text is None
                else {"campaign.toml": self.plan.given_text}
            ),
            "autopilot.toml": self.autopilot.to_toml(),
            "start_autopilot.toml": self.start.to_toml(),
            "vehicle.toml": self.plan.vehicle.to_toml(),
            "tuning.json": to_json(self.to_dict()),
            **self.report().files(),
            "history.parquet": parquet(pl.DataFrame(history, infer_schema_length=None)),
            "trials.parquet": parquet(pl.DataFrame(trials, infer_schema_length=None)),
        }


def tuned_autopilot(
    start: Autopilot, gains: Mapping[str, float], name: str, origin: str, vehicle: str
) -> Autopilot:
    """The autopilot with other gains, four digits each, under a name that says where they come from and a
    description that says for which vehicle (`seatrial.flight.checks`).
    """
    rounded = {name: float(f"{value:.{_DIGITS}g}") for name, value in gains.items()}
    tuned = start.with_gains(rounded) if rounded else start
    return tuned.renamed(f"{name} tuned", tuned_for(start.name, vehicle, origin))


def _told_short(row: ReportedMargins, margins: Margins) -> list[str]:
    """Margins of a loop that fall short of a campaign's limits, with what was asked."""
    return [
        f"{shown_below(value, limit)} {unit} of {limit:g}"
        for value, limit, unit in missed_limits(row, margins)
    ]


def missed_limits(row: ReportedMargins, margins: Margins) -> list[tuple[float, float, str]]:
    """Margins of a loop that fall short of a campaign's limits: value, limit, unit."""
    limits = margins.at(row.speed_m_s)
    return [
        (value, limit, unit)
        for value, limit, unit in (
            (row.phase_deg, limits.phase_deg, "deg"),
            (row.gain_up_db, limits.gain_db, "dB"),
            (row.gain_down_db, limits.gain_db, "dB down"),
            (row.delay_s, limits.delay_s, "s"),
        )
        if value is not None and value < (1.0 - GROUP_SEARCH_SETTINGS.margin_rounding) * limit
    ]


def shown_below(value: float, limit: float) -> str:
    """A number below a limit, with as many digits as tell the two apart."""
    for digits in range(2, 6):
        if float(text := f"{value:.{digits}g}") < limit:
            break
    return text


def without_table(problem: ControlProblem) -> tuple[str, ...]:
    """A sentence where a campaign does not say what to tune."""
    if problem.given_text is None or problem.table.model_fields_set:
        return ()
    return (
        "The campaign has no [tuning]: steps, corridors and speeds are the defaults of its vehicle and its"
        " autopilot; a table [tuning] says what the loops shall do.",
    )


@dataclass(frozen=True)
class PerformanceSettings:
    """What of an assessment is kept, and when one set of gains is better than another."""

    shown_samples: int = 9  #: Samples whose responses are kept for figures.
    far_steps: float = 3.0  #: Distance from the set point, in steps, that is no overshoot any more.
    assessment_step_s: float = 0.02  #: Longest step of the vehicle, s: that of the last assessment.
    #: Violation that stands for a response that diverges, s: one fewer of them is better.
    diverged_violation_s: float = 1e6
    rounding_s: float = 1e-6  #: Violations that differ by less are the same, s: rounding.
    #: Scores that differ by less are the same, s outside: as much as a hundredth of a margin.
    same_score_s: float = 0.03


SETTINGS = PerformanceSettings()


@dataclass(frozen=True)
class StepPerformance:
    """A step of a loop at a speed, there and back."""

    #: `loop`, `unit`, `speed_m_s`, `step`: which; the step in the unit.
    loop: str
    unit: str
    speed_m_s: float
    step: float
    #: `nominal_s`, `worst_s`: violation of the corridors, s: the largest of the vehicle itself in still water
    #: over several noises, and of all samples. Infinite where the answer diverges.
    nominal_s: float
    worst_s: float
    held: float  #: Share of the drawn vehicles that violate nothing.
    #: `rise_s`, `overshoot`, `settling_s`, `steady_error`: of the nominal response there; shares of the step,
    #: times in s, inf: never.
    rise_s: float
    overshoot: float
    settling_s: float
    steady_error: float


@dataclass(frozen=True, eq=False)
class Responses:
    """Answers of a loop for figures: times (p,), s, and values (trials, samples, p), SI, of the nominal
    sample, then of those that leave the corridors furthest.
    """

    trials: LoopTrials
    t: Array
    values: Array

    def normalised(self, trial: int) -> Array:
        """Answers (samples, p) of a trial as shares of its step: 0 before, 1 at the new set point."""
        return np.asarray((self.values[trial] - self.base(trial)) / self.trials.sizes[trial])

    def base(self, trial: int) -> float:
        """Set point before the step, SI."""
        return self.trials.base(trial)


@dataclass(frozen=True, eq=False)
class Performance(
    Plain, without="autopilot responses", also="autopilot=autopilot.name nominal_s worst_s feasible"
):
    """How an autopilot's responses keep to their corridors."""

    name: str  #: "start", "tuned".
    autopilot: Autopilot  #: Which.
    trials: tuple[StepPerformance, ...]  #: A `StepPerformance` each.
    samples: int  #: How many drawn vehicles with currents.
    responses: Mapping[str, Responses]  #: Per loop, for figures.

    @property
    def nominal_s(self) -> float:
        """Violation of all trials of the vehicle itself, s."""
        return sum(trial.nominal_s for trial in self.trials)

    @property
    def outside_s(self) -> dict[str, float]:
        """Violation of the vehicle itself per loop, over its trials, s."""
        outside: dict[str, float] = {}
        for trial in self.trials:
            outside[trial.loop] = outside.get(trial.loop, 0.0) + trial.nominal_s
        return outside

    @property
    def worst_s(self) -> float:
        """Largest violation of a trial by a sample, s."""
        return max((trial.worst_s for trial in self.trials), default=0.0)

    @property
    def feasible(self) -> bool:
        """Whether the vehicle itself violates no corridor."""
        return self.nominal_s == 0.0


def assess(
    plan: ControlProblem,
    name: str,
    rig: Rig,
    samples: Samples,
    *,
    only: Sequence[Group] | None = None,
    responses: bool = True,
) -> Performance:
    """How the responses of the rig's autopilot keep to the corridors of a plan, or of some of its groups; the
    first samples are the nominal ones. Without `responses` none are kept, and no figures taken.
    """
    performances: list[StepPerformance] = []
    kept: dict[str, Responses] = {}
    for trials in (trials for group in only or plan.groups for trials in group.trials):
        sums, _, _ = rig.violations(trials, samples, {})
        total = np.where(_diverges(trials, sums)[0], np.inf, violated(trials, sums)[0])
        shown = None
        if responses:
            t, values = rig.responses(trials, _worst(samples, total), {})
            shown = kept[trials.loop] = Responses(trials, t, values[trials.names[0]])
        for k in range(len(trials)):
            performances.append(_step_performance(trials, k, (total[k], samples.nominal), shown))
    return Performance(name, rig.autopilot, tuple(performances), len(samples) - samples.nominal, kept)


def _diverges(trials: LoopTrials, sums: Array) -> Array:
    """Whether an answer is on the average further outside than an actuator at rest would leave it, at most
    the whole step, there and back: (k, trials, samples), of sums (k, trials, samples, corridors, 3).
    """
    outside = sums[..., 0, :2].sum(axis=-1)
    return np.asarray(~(outside <= 2.0 * trials.until_s))


def _worst(samples: Samples, total: Array) -> Samples:
    """The first of some samples and those that violate most, of violations (trials, samples)."""
    worst = total.max(axis=0)
    worst[0] = np.inf
    rows = np.argsort(-worst, kind="stable")[: SETTINGS.shown_samples]
    return Samples(
        {name: np.asarray(values)[rows] for name, values in samples.coefficients.items()},
        samples.current[rows],
        tuple(samples.seeds[row] for row in rows),
    )


def _step_performance(
    trials: LoopTrials, k: int, violations: tuple[Array, int], shown: Responses | None
) -> StepPerformance:
    total, nominal = violations
    drawn = total[nominal:] if len(total) > nominal else total
    entry = LOOPS[trials.loop]
    nan = float("nan")
    figures = dict.fromkeys(("rise_s", "overshoot", "settling_s", "steady_error"), nan)
    if shown is not None:
        since = shown.t - trials.settle_s
        there = since < trials.until_s
        metrics = asdict(step_metrics(since[there], shown.normalised(k)[0][there], band=trials.settled))
        figures = {key: metrics[key] for key in figures}
    return StepPerformance(
        loop=trials.loop,
        unit=entry.unit,
        speed_m_s=trials.speeds[k],
        step=float(f"{trials.sizes[k] / entry.to_si:.9g}"),  # as it stood in the file
        nominal_s=float(total[:nominal].max()),
        worst_s=float(total.max()),
        held=float((drawn == 0.0).mean()),
        **figures,
    )


def assess_without_noise(plan: ControlProblem, rig: Rig) -> Performance:
    """How the vehicle itself keeps to its corridors in still water with perfect sensors, on a rig's gains."""
    return assess(plan, "without noise", replace(rig, sensors=None), Samples({}, np.zeros((1, 3)), (1,)))


_OTHERS = "what no loop of the search owns"


@dataclass(frozen=True)
class Standing:
    """How a set of gains stands."""

    #: Per loop the violation of the vehicle itself, and that of the worst sample, summed over trials, s.
    outside_s: Mapping[str, tuple[float, float]]
    lacking: float  #: Shortfall of the margins.
    #: Loops (mode, speed in m/s, loop) whose margins fall short, beyond rounding, or whose motion grows.
    short: frozenset[tuple[str, float, str]] = frozenset()
    inside: int = 0  #: Responses of the vehicle itself that stay within their corridors.
    growth: float = 0.0  #: Rate of the fastest motion that grows, 1/s; 0 where none does.

    @property
    def own(self) -> float:
        """Seconds outside of the vehicle itself, and margins in the search's weights."""
        return (
            sum(own for own, _ in self.outside_s.values())
            + OBJECTIVE_SETTINGS.margin_weight / OBJECTIVE_SETTINGS.outside_weight * self.lacking
        )

    @property
    def score(self) -> float:
        """Seconds outside, the worst sample of every trial, and margins in the search's weights."""
        return (
            sum(worst for _, worst in self.outside_s.values())
            + OBJECTIVE_SETTINGS.margin_weight / OBJECTIVE_SETTINGS.outside_weight * self.lacking
        )

    def lost(self, start: Standing) -> frozenset[tuple[str, float, str]]:
        """Loops whose margins are short and were not with the start gains."""
        return self.short - start.short

    def worse_than(self, start: Standing, *, margins_asked: bool) -> bool:
        """Whether the start gains have more of what was asked for.

        A motion that grows counts before all, since no vehicle can be flown with it. Then responses inside
        their corridors count, and where they are as many, the seconds outside of the vehicle itself. Where
        the campaign states margins, fewer loops that lack them are worth a response.
        """
        if self.growth != start.growth:
            return self.growth > start.growth
        if margins_asked and self.short < start.short:
            return False
        if self.inside != start.inside:
            return self.inside < start.inside
        outside, begun = (sum(own for own, _ in each.outside_s.values()) for each in (self, start))
        return outside > begun + SETTINGS.same_score_s

    def worse(self, start: Standing) -> tuple[str, ...]:
        """Loops that leave their corridors further than with the start gains: the vehicle itself at all, or
        the worst of the drawn ones by more than chance makes of one sample.
        """
        loops = []
        for loop, (own, worst) in self.outside_s.items():
            own_start, worst_start = start.outside_s[loop]
            # The worst of the samples may be half worse, and 0.1 s of a step, by luck.
            if own > own_start + SETTINGS.rounding_s or worst > 1.5 * worst_start + 0.1:
                loops.append(loop)
        return tuple(loops)


def revert_gains(
    plan: ControlProblem,
    gains: Mapping[str, float],
    samples: Samples,
    *,
    first: Mapping[str, Mapping[str, float]] | None = None,
    threads: int | None = None,
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Gains with which no loop is worse than before, and the groups that have their start gains again.

    A group is searched beside the gains of the others, which may move afterwards, and its margins may have
    cost it more than they are worth. Each time the group that improves most is reverted, until no loop is
    further outside than with the start gains. What no group owns is one more group; all start gains are the
    last resort. No tuning returns less than the start gains had of what was asked for
    (`Standing.worse_than`). `first`: gains of the first turn, by the name of a group that had a second one.
    """
    start, kept = plan.autopilot.gains(), dict(gains)
    asked = "margins" in plan.table.model_fields_set
    now = standing(plan, kept, samples, threads=threads)
    if now.score == 0.0:
        return kept, ()
    begun = standing(plan, {}, samples, threads=threads)
    # A second turn that spoiled another loop gives way to the first one before the start gains do.
    for former in (first or {}).values():
        tried_first = kept | dict(former)
        if _is_better(
            found_first := standing(plan, tried_first, samples, threads=threads), now, begun, asked
        ):
            kept, now = tried_first, found_first
    groups = {
        group.name: {name for parameter in group.parameters.parameters for name in parameter.starts}
        for group in plan.groups
    }
    owned = set().union(*groups.values())
    groups[_OTHERS] = {name for name in kept if name not in owned}
    moved = {
        group: names
        for group, names in groups.items()
        if any(kept.get(name, start[name]) != start[name] for name in names)
    }
    back: list[str] = []
    while moved:
        tried = {
            group: kept | {name: start[name] for name in names if name in kept}
            for group, names in moved.items()
        }
        standings = {group: standing(plan, each, samples, threads=threads) for group, each in tried.items()}
        better = [group for group, candidate in standings.items() if _is_better(candidate, now, begun, asked)]
        if not better:
            break
        best = min(better, key=lambda group: _order(standings[group], begun, asked))
        kept, now = tried[best], standings[best]
        back.append(best)
        del moved[best]
    if moved and _is_better(begun, now, begun, asked):
        return {name: start[name] for name in kept}, (*back, *moved)
    return kept, tuple(back)


def _order(candidate: Standing, start: Standing, margins_asked: bool) -> tuple[bool, int, int, float]:
    return (
        candidate.worse_than(start, margins_asked=margins_asked),
        len(candidate.lost(start)),
        len(candidate.worse(start)),
        candidate.score,
    )


def _is_better(candidate: Standing, now: Standing, start: Standing, margins_asked: bool) -> bool:
    """Whether some gains are to be preferred, and not at the price of the vehicle itself. Margins that the
    start gains have are worth more than any corridor, but not than margins that they lack.
    """
    if _order(candidate, start, margins_asked) >= _order(now, start, margins_asked):
        return False
    if now.worse_than(start, margins_asked=margins_asked) > candidate.worse_than(
        start, margins_asked=margins_asked
    ):
        return True
    regained = len(candidate.lost(start)) < len(now.lost(start)) and candidate.lacking <= now.lacking
    return regained or candidate.own <= now.own + SETTINGS.same_score_s


def standing(
    plan: ControlProblem, gains: Mapping[str, float], samples: Samples, *, threads: int | None = None
) -> Standing:
    """How some gains stand, all others those of the start; the first samples are the vehicle itself."""
    autopilot = plan.autopilot.with_gains(dict(gains))
    rig = plan.rig(autopilot, max_step_s=SETTINGS.assessment_step_s, threads=threads)
    performance = assess(plan, "", rig, samples, responses=False)
    inside = sum(trial.nominal_s == 0.0 for trial in performance.trials)
    if plan.margins is None:
        return Standing(_outside(performance), 0.0, inside=inside)
    lacking, growth = (float(of(gains)[0]) for of in (plan.margins.shortfall, plan.margins.growth))
    return Standing(_outside(performance), lacking, _short(plan.margins, gains), inside, growth)


def _short(limits: MarginConstraint, gains: Mapping[str, float]) -> frozenset[tuple[str, float, str]]:
    """Loops (mode, speed in m/s, loop) whose margins fall short by more than rounding."""
    return frozenset(
        (point.mode, point.speed_m_s, loop)
        for point in limits.margins(gains)
        for loop in short_loops(point, limits, beyond=GROUP_SEARCH_SETTINGS.margin_rounding)
    )


def _outside(performance: Performance) -> dict[str, tuple[float, float]]:
    outside: dict[str, tuple[float, float]] = {}
    for trial in performance.trials:
        nominal, worst = outside.get(trial.loop, (0.0, 0.0))
        outside[trial.loop] = (
            nominal + min(trial.nominal_s, SETTINGS.diverged_violation_s),
            worst + min(trial.worst_s, SETTINGS.diverged_violation_s),
        )
    return outside
