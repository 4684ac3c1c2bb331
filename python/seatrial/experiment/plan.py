"""Plan of the next trials, so that the weakest standard deviations shrink most.

Every manoeuvre that fits into the given room is simulated with the model at its present coefficients; its
Fisher information is added to what is known (bounds, recorded trials), and the sum of the relative standard
deviations that remain ranks it. Trials after the first are chosen greedily. A standard deviation is taken
relative to the coefficient's value, which counts as no less than a tenth and no more than the whole of its
bounds' width.

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
from seatrial.base.blas_threads import one_blas_thread
from seatrial.base.errors import CampaignError, SeatrialError, nearest
from seatrial.base.run import run_facts, sha256
from seatrial.base.work import Clock, Progress, callers_errors_pass
from seatrial.campaign.campaign import Campaign
from seatrial.experiment import fisher
from seatrial.experiment.dither import Dither, dithers
from seatrial.experiment.fisher import Instruments, information
from seatrial.experiment.forecast import Limits, Proposal, forecast, proposals, uneven
from seatrial.experiment.manoeuvre import Manoeuvre
from seatrial.experiment.plan_result import IDENTIFIED, START, VEHICLE, Change, Plan, Ranked
from seatrial.inspect.verdict import judge
from seatrial.problem.parameter import Parameter
from seatrial.problem.problem import Problem
from seatrial.statistics.information import covariance
from seatrial.vehicle.actuators import NOMINAL_V

if TYPE_CHECKING:
    from seatrial.identification.identification import Identification
    from seatrial.statistics.linearisation import Linearisation


@dataclass(frozen=True)
class PlanSettings:
    """How much a trial must tell."""

    least_width: float = 0.1  #: Least share of the width of its bounds that a value is taken relative to.
    largest_width: float = 1.0  #: Largest share of that width.
    #: Of trials that are as good within a per cent, the one that needs the least area is taken.
    alike: float = 1.01


SETTINGS = PlanSettings()


@callers_errors_pass
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
    with one_blas_thread():
        return _planned(
            _split(what, fit),
            list(coefficients or ()),
            budget_s=budget_s,
            count=count,
            limits=limits,
            instruments=instruments,
            candidates=candidates,
            recorded=recorded,
            use_recorded=use_recorded,
            voltage_v=voltage_v,
            threads=threads,
            progress=progress,
        )


def _planned(
    where: tuple[Vehicle, Problem | None, str],
    names: list[str],
    *,
    budget_s: float,
    count: int,
    limits: Limits | None,
    instruments: Instruments | None,
    candidates: Iterable[Manoeuvre] | None,
    recorded: Linearisation | None,
    use_recorded: bool,
    voltage_v: float,
    threads: int | None,
    progress: Callable[[Progress], None] | None,
) -> Plan:
    """The plan at the coefficients of a vehicle, which come `_split` from what was given."""
    vehicle, problem, at = where
    clock = Clock()

    def tell(fraction: float, what: str, done: int = 0, total: int = 0) -> None:
        if progress is not None:
            left_s = clock.left_s(fraction, 1.0 - fraction)
            progress(Progress(what, done, total, fraction, clock.elapsed_s, left_s))

    sought = fisher.of_vehicle(vehicle, names) if problem is None else fisher.of_campaign(problem, names)
    counting = _counting(sought, names)

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

    values = np.array([_value(vehicle, parameter) for parameter in sought])
    size = np.array([_size(parameter, value) for parameter, value in zip(sought, values, strict=True)])
    judge = _Judge(sought, values, size, counting, budget_s)
    sequence, after = judge.greedy(prior, fitting, informations, count)
    stairs = [k for k, proposal in enumerate(fitting) if proposal.manoeuvre.kind == "staircase"]
    climbed, _ = judge.greedy(prior, [fitting[k] for k in stairs], [informations[k] for k in stairs], count)
    ranking = sorted(
        (judge.ranked(prior, proposal, own) for proposal, own in zip(fitting, informations, strict=True)),
        key=lambda r: r.score,
    )
    return Plan(
        vehicle=vehicle.name,
        budget_s=float(budget_s),
        coefficients=tuple(judge.change(i, prior, after) for i in range(len(sought)) if counting[i]),
        score_before=judge.score(prior),
        ranking=tuple(ranking),
        sequence=sequence,
        staircases_score=climbed[-1].score if climbed else None,
        refused=refused,
        instruments=given,
        recorded=recorded is not None and use_recorded,
        at=at,
        dithers=_dithers(problem, vehicle, voltage_v) if use_recorded else (),
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
            alike = np.flatnonzero(scores <= SETTINGS.alike * scores.min())
            best = min(map(int, alike), key=lambda k: _area(fitting[k]))
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


def _dithers(problem: Problem | None, vehicle: Vehicle, voltage_v: float) -> tuple[Dither, ...]:
    """Dither for each axis that feedback dominates in the campaign's trials."""
    if problem is None:
        return ()
    trials = list(problem.trials.values())
    return dithers(trials, vehicle, judge(trials, vehicle), voltage_v=voltage_v)


def _counting(sought: Sequence[Parameter], names: Sequence[str]) -> Array:
    """Mask (m,) of the coefficients whose standard deviations count."""
    known_names = [parameter.name for parameter in sought]
    for name in names:
        if name not in known_names:
            raise CampaignError(f"coefficients: unknown name {name!r}{nearest(name, known_names)}")
    return np.array([not names or parameter.name in names for parameter in sought])


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


def _area(proposal: Proposal) -> float:
    return proposal.forecast.along_m * proposal.forecast.across_m


def _value(vehicle: Vehicle, parameter: Parameter) -> float:
    """The vehicle's value of a parameter."""
    name, factor = parameter.members[0]
    return float(vehicle.coefficients().get(name, 0.0)) / factor


def _size(parameter: Parameter, value: float) -> float:
    """What a standard deviation is relative to: the value, from a tenth of the bounds' width to all of it."""
    width = parameter.upper - parameter.lower
    return float(np.clip(abs(value), SETTINGS.least_width * width, SETTINGS.largest_width * width))
