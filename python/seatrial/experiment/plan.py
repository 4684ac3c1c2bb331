"""Plan of the next trials, so that the weakest standard deviations shrink most.

Every manoeuvre that fits into the given room is simulated with the model at its present coefficients; its
Fisher information is added to what is known (bounds, recorded trials), and the sum of the relative standard
deviations that remain ranks it. Trials after the first are chosen greedily. A standard deviation is taken
relative to the coefficient's value, which counts as no less than a tenth and no more than the whole of its
bounds' width. The result names the trials in their order, the room each needs and the deviations it leaves.

Source: Goodwin & Payne, *Dynamic System Identification* (1977), chapter 6; Fedorov, *Theory of Optimal
Experiments* (1972): A-optimal design. With a wrong model the plan is only good, not optimal: plan again after
each trial. Held by ``tests/experiment/test_plan.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from seatrial._core import Vehicle, checked_threads
from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError, SeatrialError, nearest
from seatrial.base.run import run_facts, sha256
from seatrial.base.work import Clock, Progress, callers_errors_pass, one_blas_thread
from seatrial.campaign.campaign import Campaign
from seatrial.experiment import fisher
from seatrial.experiment.dither import Dither, dithers
from seatrial.experiment.fisher import Instruments, information
from seatrial.experiment.forecast import Limits, Proposal, forecast, proposals, uneven
from seatrial.experiment.manoeuvre import Manoeuvre
from seatrial.inspect.verdict import judge as judge_axes
from seatrial.problem.parameter import Parameter
from seatrial.problem.problem import Problem
from seatrial.statistics.linearisation import covariance
from seatrial.vehicle.actuators import NOMINAL_V

if TYPE_CHECKING:
    from seatrial.identification.identification import Identification
    from seatrial.statistics.linearisation import Linearisation
import json
from dataclasses import field
from typing import TYPE_CHECKING, Any, Self

from seatrial.base.errors import TrialError
from seatrial.base.files import write_atomic, writing
from seatrial.base.plain import Plain
from seatrial.base.run import RunResult, to_json

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.experiment.dither import Dither
    from seatrial.experiment.fisher import Instruments
    from seatrial.experiment.forecast import Forecast
    from seatrial.experiment.manoeuvre import Manoeuvre


@dataclass(frozen=True)
class TrialPlanSettings:
    """How much a trial must tell, and which deviations a plan calls unknown or better."""

    least_width: float = 0.1  #: Least share of the width of its bounds that a value is taken relative to.
    largest_width: float = 1.0  #: Largest share of that width.
    #: Of trials that are as good within a per cent, the one that needs the least area is taken.
    alike: float = 1.01
    unknown_sd: float = 0.5  #: Relative deviation from which a coefficient is unknown.
    better_share: float = 0.9  #: Of that deviation: a trial helps below it.


PLAN_SETTINGS = TrialPlanSettings()


@callers_errors_pass
@one_blas_thread()
def plan(
    what: Vehicle | Campaign | Problem | Identification,
    *,
    fit: Identification | Vehicle | str | Path | None = None,
    coefficients: Sequence[str] | None = None,
    budget_s: float = 180.0,
    count: int = 3,
    limits: Limits | None = None,
    instruments: Instruments | None = None,
    candidates: Iterable[Manoeuvre] | None = None,
    recorded: Linearisation | None = None,
    use_recorded: bool = True,
    voltage_v: float = NOMINAL_V,
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Plan:
    """Plan of the next trials for a vehicle, a campaign or what it identified.

    Parameters
    ----------
    what : Vehicle, Campaign or Identification
        Of a campaign, its parameters with their bounds are sought and its recorded trials count; of an
        identification too, at the identified coefficients. Of a vehicle, the coefficients of its hull,
        ``B`` and ``z_b`` are sought, within their default bounds.
    fit : Identification, Vehicle, str or Path, optional
        What a campaign identified: a result of `seatrial.identify`, its run directory, or a vehicle. The plan
        is made at its coefficients; without it at the start values of the campaign, and says so.
    coefficients : sequence of str, optional
        Those whose standard deviations count; the others stay unknown. All by default.
    budget_s : float
        Time for one trial, s. What is shorter is repeated, with its pauses.
    count : int
        Number of trials to plan.
    limits : Limits, optional
        Depth, area and tilt.
    instruments : Instruments, optional
        By default as good as the residuals of an identification's trials: their noise, their memory, and the
        current if it was estimated. Otherwise `Instruments.on_board`, of a campaign with the memory of its
        vehicle's residuals if that is shorter.
    candidates : iterable of Manoeuvre, optional
        By default all of `seatrial.experiment.forecast` that fit into the limits.
    recorded : Linearisation, optional
        Linearisation of the recorded trials; by default that of the campaign's trials.
    use_recorded : bool
        Whether recorded trials count; if not, only the bounds are known.
    voltage_v : float
        Supply voltage at which tables of thrust are read, V.
    threads : int, optional
        Threads of the core; the plan does not depend on it.
    progress : callable, optional
        Called with a `Progress` before each step and each manoeuvre.

    Raises
    ------
    SeatrialError
        Nothing fits into the limits, an unknown coefficient, a trial that cannot be read.

    Examples
    --------
    >>> import seatrial as st
    >>> from seatrial.experiment.plan import plan
    >>> found = plan(st.Vehicle.load("cwolf"), coefficients=["K_p", "K_pp"], budget_s=30.0, count=1)
    >>> found.sequence[0].manoeuvre.kind
    'free decay'
    """
    checked_threads(threads)
    if not (np.isfinite(budget_s) and budget_s >= 10.0):
        raise CampaignError(f"budget: expected at least 10 s for a trial, found {budget_s:g} s")
    if count < 1:
        raise CampaignError(f"count: expected at least one trial to plan, found {count}")
    vehicle, problem, at = _split(what, fit)
    names = list(coefficients or ())
    clock = Clock()

    def tell(fraction: float, what: str, done: int = 0, total: int = 0) -> None:
        if progress is not None:
            left_s = clock.left_s(fraction, 1.0 - fraction)
            progress(Progress(what, done, total, fraction, clock.elapsed_s, left_s))

    sought = fisher.of_vehicle(vehicle, names) if problem is None else fisher.of_campaign(problem, names)
    # What is known before the next trial: bounds, and what was recorded.
    tell(0.0, "information in the recorded trials" if problem else "manoeuvres that fit into the limits")
    given = instruments or Instruments.on_board()
    if recorded is None and problem is not None and use_recorded:
        recorded = _linearised(problem, vehicle, given if at == START else None, threads)
    if recorded is not None and instruments is None:
        seen = fisher.seen_by(recorded)
        # Before a fit the residuals hold the model's errors, so that they only shorten the usual memory.
        memory = min(given.correlation_s, seen.correlation_s)
        given = replace(given, correlation_s=memory) if at == START else seen
    prior = fisher.prior_information(sought)
    if recorded is not None and use_recorded:
        prior = prior + fisher.recorded_information(recorded, sought, given)

    tell(0.1, "manoeuvres that fit into the limits")
    fitting, refused = _fitting(vehicle, candidates, budget_s, limits, voltage_v)
    if not fitting:
        raise CampaignError(f"{vehicle.name}: {_none_fits(vehicle, refused)}")
    informations: list[Array] = []
    for index, proposal in enumerate(fitting):
        tell(0.2 + 0.8 * index / len(fitting), proposal.manoeuvre.name, index, len(fitting))
        run = information(vehicle, proposal.manoeuvre, sought, given, voltage_v=voltage_v, threads=threads)
        informations.append(proposal.manoeuvre.repeats(budget_s) * run)

    judge = _Judge.of(vehicle, sought, names, budget_s)
    sequence, after = judge.greedy(prior, fitting, informations, count)
    stairs = [k for k, proposal in enumerate(fitting) if proposal.manoeuvre.kind == "staircase"]
    # What a plan without any design would come to.
    climbed, _ = judge.greedy(prior, [fitting[k] for k in stairs], [informations[k] for k in stairs], count)
    ranking = sorted(
        (judge.ranked(prior, proposal, own) for proposal, own in zip(fitting, informations, strict=True)),
        key=lambda r: r.score,
    )
    trials = list(problem.trials.values()) if problem is not None and use_recorded else []
    return Plan(
        vehicle=vehicle.name,
        budget_s=float(budget_s),
        coefficients=tuple(judge.change(i, prior, after) for i in range(len(sought)) if judge.counting[i]),
        score_before=judge.score(prior),
        ranking=tuple(ranking),
        sequence=sequence,
        staircases_score=climbed[-1].score if climbed else None,
        refused=refused,
        instruments=given,
        recorded=recorded is not None and use_recorded,
        at=at,
        dithers=dithers(trials, vehicle, judge_axes(trials, vehicle), voltage_v=voltage_v) if trials else (),
        model=vehicle,
        facts=run_facts(
            "plan",
            vehicle.name,
            clock=clock,
            inputs={"vehicle": sha256(vehicle.to_toml())}
            | ({} if problem is None else problem.input_hashes(trials=use_recorded)),
            options={"budget_s": budget_s, "count": count, "coefficients": names, "recorded": use_recorded},
        ),
    )


@dataclass(frozen=True)
class _Judge:
    """Standard deviations and scores from information matrices (m, m) of the sought parameters."""

    sought: tuple[Parameter, ...]
    values: Array
    size: Array
    counting: Array
    budget_s: float

    @classmethod
    def of(
        cls, vehicle: Vehicle, sought: tuple[Parameter, ...], names: Sequence[str], budget_s: float
    ) -> Self:
        """Judge at a vehicle's coefficients, by the deviations of those named, all when none is."""
        known_names = [parameter.name for parameter in sought]
        for name in names:
            if name not in known_names:
                raise CampaignError(f"coefficients: unknown name {name!r}{nearest(name, known_names)}")
        own = vehicle.coefficients()
        members = [parameter.members[0] for parameter in sought]
        values = np.array([float(own.get(name, 0.0)) / factor for name, factor in members])
        width = np.array([parameter.upper - parameter.lower for parameter in sought])
        # A deviation is relative to the value, from a tenth of the bounds' width to all of it.
        size = np.clip(np.abs(values), PLAN_SETTINGS.least_width * width, PLAN_SETTINGS.largest_width * width)
        counting = np.array([not names or name in names for name in known_names])
        return cls(sought, values, size, counting, budget_s)

    def sigma(self, total: Array) -> Array:
        """Standard deviations (m,) in the parameters' units."""
        return np.sqrt(np.diag(covariance(total)))

    def score(self, total: Array) -> float:
        """Sum of the relative standard deviations that count."""
        return float((self.sigma(total) / self.size)[self.counting].sum())

    def change(self, index: int, before: Array, after: Array) -> Change:
        """What becomes of one coefficient's standard deviation."""
        parameter = self.sought[index]
        return Change(
            name=parameter.name,
            unit=parameter.unit,
            value=float(self.values[index]),
            relative_to=float(self.size[index]),
            before=float(self.sigma(before)[index]),
            after=float(self.sigma(after)[index]),
        )

    def ranked(self, before: Array, proposal: Proposal, own: Array) -> Ranked:
        """A trial with what it leaves and the coefficients that gain, the greatest gain first."""
        after = before + own
        gain = (self.sigma(before) - self.sigma(after)) / self.size
        order = [int(i) for i in np.argsort(-gain, kind="stable") if self.counting[i]]
        return Ranked(
            manoeuvre=proposal.manoeuvre,
            forecast=proposal.forecast,
            amplitude=proposal.amplitude,
            repeats=proposal.manoeuvre.repeats(self.budget_s),
            score=self.score(after),
            gains=tuple(self.change(i, before, after) for i in order),
        )

    def greedy(
        self, prior: Array, fitting: Sequence[Proposal], informations: Sequence[Array], count: int
    ) -> tuple[tuple[Ranked, ...], Array]:
        """Trials one after the other, each the best after those before; and the information at the end."""
        chosen: list[Ranked] = []
        total = prior
        for _ in range(count if fitting else 0):
            # Of trials that are about as good, the one that needs the least area.
            scores = np.array([self.score(total + own) for own in informations])
            alike = np.flatnonzero(scores <= PLAN_SETTINGS.alike * scores.min())
            area = [fitting[k].forecast.along_m * fitting[k].forecast.across_m for k in alike.tolist()]
            best = int(alike[np.argmin(area)])
            chosen.append(self.ranked(total, fitting[best], informations[best]))
            total = total + informations[best]
        return tuple(chosen), total


def _split(
    what: Vehicle | Campaign | Problem | Identification, fit: Identification | Vehicle | str | Path | None
) -> tuple[Vehicle, Problem | None, str]:
    """The vehicle at whose coefficients is planned, its problem, and whence these coefficients are."""
    from seatrial.identification.fitted import Fitted

    if fit is not None and not isinstance(what, Campaign | Problem):
        raise CampaignError(
            f"fit: expected only beside a campaign, found it beside {type(what).__name__}; give one of them"
        )
    if isinstance(what, Vehicle):
        return what, None, VEHICLE
    if isinstance(what, Campaign):
        what = what.problem()
    if not isinstance(what, Problem):
        return what.vehicle, what.problem, IDENTIFIED
    if fit is None:
        return what.vehicle, what, START
    return Fitted.of(fit).vehicle, what, IDENTIFIED


def _none_fits(vehicle: Vehicle, refused: Mapping[str, str]) -> str:
    """Why no manoeuvre is left, and what to do; `refused` holds the reason of each that was tried."""
    if refused:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in list(refused.items())[:3])
        return f"no manoeuvre fits into the limits ({reasons}); give more room or time"
    if not vehicle.actuators:
        return (
            "has no actuators and does not right itself, so that no manoeuvre moves it; give its"
            " [[thrusters]] or [[fins]] in the vehicle file"
        )
    return "no manoeuvre fits: there is none to choose from"


def _fitting(
    vehicle: Vehicle,
    candidates: Iterable[Manoeuvre] | None,
    budget_s: float,
    limits: Limits | None,
    voltage_v: float,
) -> tuple[list[Proposal], dict[str, str]]:
    """Candidates within limits and time, and why the others are not."""
    if candidates is None:
        return proposals(vehicle, duration_s=budget_s, limits=limits, voltage_v=voltage_v)
    other, accepted, refused = uneven(vehicle), [], {}
    for manoeuvre in candidates:
        seen = forecast(manoeuvre, vehicle, other, limits=limits, voltage_v=voltage_v)
        if seen.excess is not None:
            refused[manoeuvre.name] = seen.excess
        elif manoeuvre.repeats(budget_s) < 1:
            refused[manoeuvre.name] = f"it takes {manoeuvre.duration_s:.0f} s"
        else:
            accepted.append(Proposal(manoeuvre, seen))
    return accepted, refused


def _linearised(
    problem: Problem, vehicle: Vehicle, instruments: Instruments | None, threads: int | None
) -> Linearisation:
    """Linearisation of the campaign's trials, with the instruments' noise before the model is fitted."""
    from seatrial.estimation.joint import Joint
    from seatrial.estimation.joint_estimate import linearise

    try:
        joint = Joint(problem, vehicle, threads=threads, method="output")
        if instruments is None:
            return linearise(joint, joint.start)
        own = zip(joint.channels, joint.noise, strict=True)
        noise = np.array([instruments.noise.get(channel, float(size)) for channel, size in own])
        return linearise(joint, joint.start, noise=noise)
    except SeatrialError as error:
        raise type(error)(
            f"{error}\nTo plan without recorded trials: use_recorded=False, on the command line --no-recorded"
        ) from None


VEHICLE, IDENTIFIED, START = "vehicle", "identification", "start values"
"""Whence the coefficients are at which a plan is made."""


@dataclass(frozen=True)
class Change(Plain, also="relative_before relative_after"):
    """Standard deviation of one coefficient before and after, in its unit.

    The score takes it relative to ``relative_to``, which is no less than a tenth of the bounds' width; what
    is printed is relative to the value.
    """

    name: str
    unit: str
    value: float
    relative_to: float
    before: float
    after: float

    @property
    def relative_before(self) -> float:
        """Relative standard deviation before, as the score has it; one is 100 %."""
        return self.before / self.relative_to

    @property
    def relative_after(self) -> float:
        """Relative standard deviation after, as the score has it."""
        return self.after / self.relative_to

    @property
    def of_value(self) -> bool:
        """Whether a deviation is told in per cent of the value; one of a value of about zero is not."""
        return abs(self.value) > 0.01 * self.relative_to  # a smaller share is one of zero

    @property
    def whole(self) -> float:
        """What is printed is relative to it: the value, or what the score takes where that is about zero."""
        return abs(self.value) if self.of_value else self.relative_to

    def told(self, deviation: float, unit: str = "") -> str:
        """A deviation in per cent of the value, or as ± in its unit where the value is about zero."""
        if self.of_value:
            return _percent(deviation / self.whole)
        return f"± {deviation:.2g} {unit}".rstrip()


@dataclass(frozen=True)
class Ranked(
    Plain,
    without="manoeuvre",
    also="name=manoeuvre.name kind=manoeuvre.kind words=manoeuvre.words start=manoeuvre.start.words"
    " duration_s=manoeuvre.duration_s pause_s=manoeuvre.pause_s",
):
    """A trial that could be next: a manoeuvre, and the room that it needs.

    `amplitude`: share of the thrust that it uses; 0 where that does not apply. `repeats`: how often it is run
    within the time of one trial, pauses included. `score`: sum of the relative standard deviations that it
    leaves. `gains`: those of every coefficient that counts, the greatest relative gain first.
    """

    manoeuvre: Manoeuvre
    forecast: Forecast
    amplitude: float
    repeats: int
    score: float
    gains: tuple[Change, ...]


@dataclass(frozen=True, repr=False)
class Plan(RunResult, Plain, without="facts model", also="score_after"):
    """The next trials.

    `vehicle`, `budget_s`: name of the vehicle and time of one trial, s. `coefficients`: standard deviations
    before the first trial and after the last one of the sequence. `score_before`: sum of the relative
    standard deviations before. `ranking`: all manoeuvres that fit, as the next trial, the best first.
    `sequence`: the trials to run, each the best after those before. `staircases_score`: what as many trials
    of staircases alone, the best of them, would leave; None if none fits. `refused`: why other manoeuvres do
    not fit, by name. `instruments`: noise, correlation time and current that were assumed. `recorded`:
    whether recorded trials count. `at`: whence the coefficients are at which the plan is made: `VEHICLE`,
    `IDENTIFIED` or `START`, the start values of a campaign. `dithers`: what to add to the autopilot's output
    where feedback dominates an axis of the recorded trials. `facts`: what the plan rests on, see
    `seatrial.base.run.run_facts`. `model`: the vehicle that was planned for; its figures need it.
    """

    vehicle: str
    budget_s: float
    coefficients: tuple[Change, ...]
    score_before: float
    ranking: tuple[Ranked, ...]
    sequence: tuple[Ranked, ...]
    staircases_score: float | None
    refused: Mapping[str, str]
    instruments: Instruments
    recorded: bool
    at: str = VEHICLE
    dithers: tuple[Dither, ...] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)
    model: Vehicle | None = None

    @property
    def score_after(self) -> float:
        """Sum of the relative standard deviations after the sequence."""
        return self.sequence[-1].score

    def files(self) -> dict[str, str | bytes]:
        """Files of the run directory by name, see `save`."""
        files: dict[str, str | bytes] = {"plan.json": to_json(self.to_dict()), **self.report().files()}
        for number, ranked in enumerate(self.sequence, 1):
            name = "trial" if number == 1 else f"trial-{number}"
            files[f"{name}.csv"] = ranked.manoeuvre.table().write_csv()
            files[f"{name}.toml"] = self.sheet(ranked, f"{name}.csv", number)
        files |= {dither.file_name: dither.csv() for dither in self.dithers}
        return files

    def write(self, path: str | Path, *, trial: int = 1) -> list[Path]:
        """Paths of the command file (CSV) and the sheet (TOML) of one trial of the sequence.

        `path`: the command file, ending .csv; the sheet lies beside it. `trial`: its place in the sequence,
        from 1 on. Raises TrialError: the ending is another one, or the files cannot be written.
        """
        target = Path(path)
        if target.suffix != ".csv":
            raise TrialError(f'{target}: expected the ending .csv, found "{target.suffix}"')
        if not 1 <= trial <= len(self.sequence):
            raise TrialError(f"trial {trial}: the plan has trials 1 to {len(self.sequence)}")
        ranked = self.sequence[trial - 1]
        sheet = target.with_suffix(".toml")
        with writing(target, TrialError):
            target.parent.mkdir(parents=True, exist_ok=True)
            ranked.manoeuvre.write_csv(target)
            write_atomic(sheet, self.sheet(ranked, target.name, trial).encode())
        return [target, sheet]

    def write_dithers(self, folder: str | Path) -> list[Path]:
        """Paths of the tables of the dithers, written into a folder."""
        paths = [Path(folder) / dither.file_name for dither in self.dithers]
        for path, dither in zip(paths, self.dithers, strict=True):
            with writing(path, TrialError):
                path.parent.mkdir(parents=True, exist_ok=True)
                write_atomic(path, dither.csv().encode())
        return paths

    def sheet(self, ranked: Ranked, commands: str, trial: int) -> str:
        """TOML text for the operator of `ranked`, a trial of the sequence or ranking: manoeuvre, times, room,
        warnings, deviations.

        `commands` is the name of its command file, `trial` its number in the sequence, from 1.
        """
        manoeuvre, seen = ranked.manoeuvre, ranked.forecast
        depth = f"{seen.start_depth_m:.1f} m deep or deeper"
        entries = {
            "name": _text(manoeuvre.name),
            "vehicle": _text(self.vehicle),
            "commands": _text(commands),
            "what": _text(manoeuvre.words),
            "start": _text(f"{manoeuvre.start.words}, {depth}"),
            "duration_s": f"{manoeuvre.duration_s:.1f}",
            "repeats": ranked.repeats,
            "pause_s": f"{manoeuvre.pause_s:.1f} {_BETWEEN}",
            "area_m": f"[{seen.along_m:.0f}, {seen.across_m:.0f}] {_AREA}",
            "start_depth_m": f"{seen.start_depth_m:.1f}",
            "deepest_m": f"{seen.deepest_m:.1f}",
            "largest_roll_deg": f"{seen.roll_deg:.0f}",
            "largest_pitch_deg": f"{seen.pitch_deg:.0f}",
            "top_speed_m_s": f"{seen.speed_m_s:.2f}",
            "warnings": f"[{', '.join(_text(warning) for warning in seen.warnings)}]",
        }
        head = f"# Trial {trial} of {len(self.sequence)} for {self.vehicle}. Depths are those of O."
        lines = [head, *(f"{key} = {value}" for key, value in entries.items()), "", *_TELLS]
        lines += [_tells(change) for change in ranked.gains[:8]]  # those that it tells most of
        return "\n".join(lines) + "\n"


_BETWEEN, _AREA = "# between repeats", "# along the course at the start, across it"
_TELLS = (
    "# Standard deviations before and after this trial, in per cent of the coefficient's value;",
    "# where that is about zero, in its unit.",
    "[tells]",
)


def _tells(change: Change) -> str:
    """Line of a sheet on what a trial tells about a coefficient."""
    if change.of_value:
        before, after = (f"{100 * x / change.whole:.1f}" for x in (change.before, change.after))
        unit = ""
    else:
        before, after, unit = f"{change.before:.3g}", f"{change.after:.3g}", f", unit = {_text(change.unit)}"
    return f"{_text(change.name)} = {{ before = {before}, after = {after}{unit} }}"


def _text(words: str) -> str:
    """A TOML basic string."""
    return json.dumps(words, ensure_ascii=False)


def _percent(share: float) -> str:
    """A share in per cent with two digits."""
    return f"{100.0 * share:.0f}" if share >= 0.1 else f"{100.0 * share:.2g}"
