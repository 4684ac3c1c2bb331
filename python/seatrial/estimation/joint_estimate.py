"""Joint estimate: all coefficients and nuisance parameters at once, by output error or by prediction errors.

**Output error.** Rounds of `seatrial.estimation.gauss_newton` follow one another, from one start or several,
until a round promises nothing more. The loss is squared or Huber's, its knee in standard deviations of the
channel's residual, which are estimated on the way. A round lowers the cost at the noise that it began with,
and the noise is estimated anew after it; what must not rise is the negative log-likelihood with every
channel's scale at its best (`GaussNewton.merit`). A round after which it is higher is taken back, shorter
steps along it are tried, and the descent ends where none of them helps. A campaign may free coefficients here
that no stage freed: the larger set may not end above the smaller one, so that it starts from the optimum of
the staged coefficients too. The way from the starts is found on a part of the segments where there are many,
at the step of the global search; the last descent goes on from the lowest end on all of them.

**Prediction errors** of a filter (`seatrial.estimation.innovations`) rest on a noise model, which may be
wrong: the estimate then depends on how far ahead is predicted. The unknowns are estimated again from
predictions over other horizons, with what was known at the start of each as instruments
(`seatrial.estimation.instruments`), so that an autopilot's answer within a horizon does not bend them. A
model of the damping may be wrong, and the log may not tell it from another one
(`seatrial.identification.choice`). An autopilot may answer what its sensors show and the log does not hold.
Where the difference is larger than three of its standard deviations, and larger than a twentieth of the
estimate, the coefficient is not identified. Standard deviations of differences are those of the sums over
blocks of time longer than the correlation (Hausman, *Econometrica* 46 (1978) 1251).

Tests: ``tests/estimation/test_polish.py``, ``tests/estimation/test_innovations.py``.
"""

from __future__ import annotations

import contextlib
import importlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError
from seatrial.base.finding import is_numerical
from seatrial.base.work import Step
from seatrial.estimation.estimator import Estimator, Horizon, LogAlone, OtherDamping, Polished
from seatrial.estimation.gauss_newton import INITIALS, GaussNewton, ran_away
from seatrial.estimation.innovations import Innovations
from seatrial.estimation.joint import Joint
from seatrial.estimation.one_step import Errors, Span
from seatrial.statistics.linearisation import Linearisation, Unknown
from seatrial.statistics.uncertainty import tempering


@dataclass(frozen=True)
class JointEstimateSettings:
    """When a descent of the joint estimate ends, and on how much of the data it looks for its way."""

    #: Gain, in twice the log-likelihood, below which a round is the last: a step of a third of a standard
    #: deviation in all unknowns together.
    close: float = 0.1
    #: Promise, in the same units, up to which an end without any lower neighbour counts as the optimum.
    close_by: float = 10.0
    #: Shares of a round's step that are tried until one lowers the likelihood's cost.
    step_shares: tuple[float, ...] = (1.0, 0.5, 0.2, 0.05)
    #: Rounds in which the initial conditions follow the unknowns.
    settling_rounds: int = 3
    #: Segments, about, on which the way is found; every trial is among them.
    way_segments: int = 40
    #: Times as many segments from which a part of them is worth its own descent.
    many_times: int = 3
    #: Relative change of the noise between two rounds below which it has settled.
    settled_noise: float = 0.1


SETTINGS = JointEstimateSettings()


def _tempered(joint: Joint, values: Array) -> Array:
    """`tempering` (m,) at the values of the unknowns; what it was where the model diverges there."""
    with contextlib.suppress(CampaignError):
        return tempering(linearise(joint, values))
    return joint.tempering


class OutputError:
    """Joint estimate by the errors of free simulations of segments."""

    def __init__(self, joint: Joint) -> None:
        self.joint = joint

    def estimate(
        self,
        start: Array | None,
        *,
        rounds: int,
        near: bool,
        watch: Callable[[Step], None] | None,
        fixed: frozenset[int] = frozenset(),
    ) -> Polished:
        """The lowest end of descents from a start and from others, on all segments.

        Unknowns whose places are fixed keep their start value, for a profile.
        """
        began, joint, limit = time.monotonic(), self.joint, rounds
        first = joint.start if start is None else np.asarray(start, dtype=float)
        # What is known beforehand meets samples that resemble their neighbours: these count as fewer.
        if joint.presumes and np.all(joint.tempering == 1.0):
            joint.tempering = _tempered(joint, first)
        # Many segments: a part of them, with coarser steps, leads to the optimum; all of them end it.
        whole = near or len(joint.data.segments) < SETTINGS.many_times * SETTINGS.way_segments
        searched = joint if whole or not limit else joint.thinned(SETTINGS.way_segments)[0].at_search_step()
        search = _Descent(searched, limit, watch, fixed)
        search.rounds.near = near
        searches = [search.run(first)]
        if near:
            ended = joint.on_bounds(searches[0].values)
            return replace(searches[0], values=ended, wall_s=time.monotonic() - began)
        # What no stage has freed starts far off: a second search begins where all others ended without it.
        if start is None and not fixed and limit and joint.unstaged and not searches[-1].interrupted:
            smaller = _Descent(searched, limit, watch, frozenset(joint.unstaged)).run(first)
            if not smaller.interrupted:
                searches.append(search.run(smaller.values))
        # Further starts that the campaign asks for, scattered about the first.
        generator = np.random.default_rng(joint.problem.seed)
        for _ in range(joint.polish.starts - 1):
            if searches[-1].interrupted:
                break
            searches.append(search.run(search.scattered(first, generator)))
        # The lowest cost wins.
        costs = np.array([float(attempt.costs[0]) for attempt in searches])
        best, interrupted = searches[int(costs.argmin())], searches[-1].interrupted
        start_cost = searches[0].start_cost + float(costs[0] - costs.min())
        evaluations = sum(attempt.evaluations for attempt in searches)
        weighed = joint.presumes and limit > 0 and not interrupted
        if weighed:
            joint.tempering = _tempered(joint, best.values)
        if searched is not joint or weighed:
            last = _Descent(joint, 0 if interrupted else limit, watch, fixed).run(first, best.values)
            # Costs of the other searches are of a part of the segments; they are brought to all of them.
            more = len(joint.data.segments) / len(searched.data.segments)
            costs = float(last.costs[0]) + more * (costs - costs.min())
            start_cost, evaluations = last.start_cost, evaluations + last.evaluations
            interrupted = interrupted or last.interrupted
            best = replace(last, rounds=best.rounds + last.rounds)
        return replace(
            best,
            values=joint.on_bounds(best.values),
            start_cost=start_cost,
            evaluations=evaluations,
            interrupted=interrupted,
            wall_s=time.monotonic() - began,
            spread=np.array([attempt.values for attempt in searches]),
            costs=costs,
        )

    def linearised(
        self, values: Array, *, initial: Array | None, noise: Array | None, extra: Sequence[str]
    ) -> Linearisation:
        """Residuals and derivatives, initial conditions and noise at their best where they are not given."""
        joint = self.joint
        search = GaussNewton(joint)
        if noise is not None:
            search.noise = noise
        if initial is None:
            initial = np.zeros((len(joint.data.segments), 12))
            for _ in range(SETTINGS.settling_rounds if joint.initials else 1):
                if noise is None:
                    search.estimate_noise(search.residuals(values, initial))
                initial = initial + search.settled(values, initial)
        return search.linearisation(values, initial, extra)

    def otherwise(self, polished: Polished) -> Polished:
        """As it is: a simulation assumes nothing of the noise."""
        return polished

    def diverges(self, polished: Polished) -> bool:
        """Whether the simulation leaves the log on every segment."""
        residuals = self.joint.residuals(polished.values, polished.initial)
        return all(ran_away(self.joint, error) for error in residuals)


@dataclass(frozen=True)
class _Place:
    """A point of a descent: its noise, the cost in that noise, the negative log-likelihood."""

    values: Array
    initial: Array
    noise: Array
    cost: float
    merit: float


class _Descent:
    """Workspace of one polish from one start or several."""

    def __init__(
        self,
        joint: Joint,
        limit: int,
        watch: Callable[[Step], None] | None,
        fixed: frozenset[int] = frozenset(),
    ) -> None:
        self.joint, self.limit, self.watch = joint, limit, watch
        self.rounds = GaussNewton(joint, fixed)
        self.began = time.monotonic()

    def run(self, start: Array, through: Array | None = None) -> Polished:
        """The optimum that one start leads to; ``through`` lies on the way, where it is better than that."""
        joint, rounds = self.joint, self.rounds
        centre = joint.centres(start)
        here = first = self._begun(start, centre)
        if through is not None and (other := self._begun(through, centre)).merit < first.merit:
            here = other
        count, evaluations, converged, interrupted, stopped = 0, rounds.evaluations, False, False, ""
        limit = self.limit if np.isfinite(here.merit) else 0  # a start that diverges has no derivatives
        try:
            while count < limit and not converged:
                count += 1
                rounds.noise, judged = here.noise.copy(), rounds.judging
                values, begun, promised = rounds.round(here.values, here.initial, centre)
                before, here = here, self._lower(here, values, begun, centre)
                if here is before and not judged:
                    rounds.judge()
                    continue
                if here is before:
                    # Not even a short step along the round's direction lowers the likelihood's cost: the
                    # noise that follows takes back what is left to gain.
                    converged = promised < SETTINGS.close_by
                    break
                settled = bool(np.all(np.abs(here.noise / before.noise - 1) < SETTINGS.settled_noise))
                whole = np.array_equal(here.values, values)
                gained = 2.0 * (before.merit - here.merit) if whole else np.inf
                converged = judged and settled and min(promised, gained) < SETTINGS.close
                self._show(count, here)
        except KeyboardInterrupt:
            interrupted = True
        except Exception as error:
            # What the rounds before gained stays.
            if count < 2 or not is_numerical(error):
                raise
            stopped = str(error)
        rounds.noise = here.noise.copy()
        return Polished(
            values=here.values,
            initial=here.initial,
            noise=here.noise,
            cost=here.cost,
            start_cost=max(
                rounds.cost(first.values, first.initial, centre), here.cost + first.merit - here.merit
            ),
            samples=sum(int(joint.counted(i).sum()) for i in range(len(joint.data.segments))),
            rounds=count,
            evaluations=rounds.evaluations - evaluations,
            converged=converged,
            interrupted=interrupted,
            wall_s=time.monotonic() - self.began,
            spread=here.values[None],
            costs=np.array([here.merit]),
            method_reason=joint.method_reason,
            stopped=stopped,
        )

    def _begun(self, values: Array, centre: Array) -> _Place:
        """A point with initial conditions at their best for it."""
        joint, rounds = self.joint, self.rounds
        rounds.begin()
        initial = np.zeros((len(joint.data.segments), len(INITIALS)))
        rounds.estimate_noise(rounds.residuals(values, initial))
        if joint.initials:
            initial = initial + rounds.settled(values, initial)
        return self._placed(values, initial, centre)

    def _placed(self, values: Array, initial: Array, centre: Array) -> _Place:
        """A point with the noise of its own residuals."""
        residuals = self.rounds.residuals(values, initial)
        self.rounds.estimate_noise(residuals)
        noise = self.rounds.noise.copy()
        cost = self.rounds.cost(values, initial, centre, residuals)
        return _Place(values, initial, noise, cost, self.rounds.merit(values, initial, centre, residuals))

    def _lower(self, here: _Place, values: Array, initial: Array, centre: Array) -> _Place:
        """The first point on the way to new values that lies lower; the old one where none does."""
        for part in SETTINGS.step_shares:
            place = self._placed(
                values + (1.0 - part) * (here.values - values),
                initial + (1.0 - part) * (here.initial - initial),
                centre,
            )
            if place.merit < here.merit:
                return place
        return here

    def scattered(self, start: Array, generator: np.random.Generator) -> Array:
        """Another start: coefficients anywhere in the middle half of their bounds."""
        count = len(self.joint.parameters)
        other = start.copy()
        inside = generator.uniform(0.25, 0.75, count)
        other[:count] = self.rounds.lower[:count] + inside * (
            self.rounds.upper[:count] - self.rounds.lower[:count]
        )
        return other

    def _show(self, rounds: int, here: _Place) -> None:
        if self.watch is not None:
            elapsed = time.monotonic() - self.began
            step = Step("polish", rounds, self.limit, self.rounds.evaluations, here.cost, elapsed)
            self.watch(step)


@dataclass(frozen=True)
class SpecificationSettings:
    """From where on what another model says makes a coefficient doubtful."""

    #: Standard deviations of a difference from which it is none of chance.
    apart_sd: float = 3.0
    #: Share of an estimate from which a difference matters.
    matters_share: float = 0.05
    #: Share of that which is refused where an autopilot knows more than the log.
    knowing_share: float = 0.5
    #: Share of its scale below which an estimate is as good as zero: a twentieth of it does not matter.
    nothing_share: float = 0.01
    #: Rounds of an estimate over another horizon at most.
    rounds: int = 4
    #: Largest step, in standard deviations, that ends these rounds.
    close_sd: float = 0.2


SPECIFICATION_SETTINGS = SpecificationSettings()


def log_alone(innovations: Innovations, values: Array) -> LogAlone | None:
    """Estimates free of what commands answer beyond the log, beside the values (m,); None where none does."""
    answers = innovations.answers(innovations.settled(values))
    if not answers.names:
        return None
    own = _influence(innovations, values)

    def free(spans: Sequence[Span], steps: int) -> list[Errors]:
        return answers.freed(innovations.errors(spans, steps))

    at, influence = _estimated(innovations, free, values, values, 1)
    away = _away(values, own, at, influence)
    refused = _refused(innovations.joint.unknowns, away, values, at, SPECIFICATION_SETTINGS.knowing_share)
    commands = tuple(name.partition(" ")[2] for name in answers.names)
    return LogAlone(commands, answers.sure, at, away, refused)


def horizons(innovations: Innovations, values: Array) -> tuple[Horizon, ...]:
    """Estimates from other horizons with the noise model held, beside the values (m,) of the fit.

    With instruments; where these contradict the fit, of a coefficient the nearer one of that and of least
    squares, which err for different reasons: waves that the noise model foretells badly, and answers to them.
    """
    joint, criterion = innovations.joint, innovations.criterion
    judged: list[Horizon] = []
    fitted = innovations.samples(joint.polish.horizon_s)
    own, at = _influence(innovations, values), values
    for ahead_s in sorted(joint.polish.horizons_s):
        steps = innovations.samples(ahead_s)
        if steps == fitted:
            continue
        at, influence = _estimated(innovations, innovations.instrumented, values, at, steps)
        away, shown = _away(values, own, at, influence), at
        if any(map(_apart, away, values, at, criterion.scale)):
            plain, influence = _estimated(innovations, innovations.errors, values, values, steps)
            theirs = _away(values, own, plain, influence)
            nearer = np.abs(plain - values) < np.abs(at - values)
            away, shown = np.where(nearer, theirs, away), np.where(nearer, plain, at)
        refused = _refused(joint.unknowns, away, values, shown)
        judged.append(Horizon(steps * innovations.dt, shown, away, refused))
    return tuple(judged)


def _estimated(
    innovations: Innovations,
    errors_of: Callable[[Sequence[Span], int], list[Errors]],
    around: Array,
    start: Array,
    steps: int,
) -> tuple[Array, Array]:
    """Estimate (m,) from predictions so many samples ahead, and the influence (b, m) of blocks of time."""
    criterion, at = innovations.criterion, start
    for _ in range(SPECIFICATION_SETTINGS.rounds):
        errors = errors_of(innovations.steps.linearised(at), steps)
        centre = innovations.joint.centres(around)
        taken = criterion.step(errors, criterion.noise(errors), at, centre, overlap=steps)
        before, at = at, np.clip(at + taken.step, criterion.lower, criterion.upper)
        if np.all(
            np.abs(at - before) < SPECIFICATION_SETTINGS.close_sd * np.sqrt((taken.influence**2).sum(axis=0))
        ):
            break
    return innovations.joint.on_bounds(at), taken.influence


def other_damping(
    strips: str, replaced: tuple[str, ...], first: tuple[Joint, Array], other: tuple[Joint, Array]
) -> OtherDamping:
    """What another model of the damping says of the coefficients that it shares with the fit.

    ``replaced``: the quadratic damping of the fit that the strips replace. ``first``, ``other``: the fit and
    the estimate with the other model, each with its values.
    """
    (joint, values), (rival, theirs) = first, other
    influences = [_influence(Innovations(who), at) for who, at in (first, other)]
    names = [[unknown.name for unknown in who.unknowns] for who in (joint, rival)]
    shared = [name for name in names[0] if name in names[1]]
    mine, its = ([own.index(name) for name in shared] for own in names)
    away = _away(values[mine], influences[0][:, mine], theirs[its], influences[1][:, its])
    refused = _refused([joint.unknowns[k] for k in mine], away, values[mine], theirs[its])
    by_name = [dict(zip(shared, numbers.tolist(), strict=True)) for numbers in (theirs[its], away)]
    return OtherDamping(strips, replaced, True, by_name[0], by_name[1], refused)


def _influence(innovations: Innovations, values: Array) -> Array:
    """What each block of time moves the estimate by, (blocks, m)."""
    joint, criterion = innovations.joint, innovations.criterion
    spans = innovations.settled(values)
    errors = innovations.instrumented(spans, innovations.samples(joint.polish.horizon_s))
    return criterion.step(errors, criterion.noise(errors), values, joint.centres(values)).influence


def _away(values: Array, influence: Array, other: Array, others: Array) -> Array:
    """Difference (m,) of two estimates in its standard deviations, by the influences of the same blocks."""
    count = min(len(influence), len(others))
    spread = np.sqrt(((others[:count] - influence[:count]) ** 2).sum(axis=0))
    return np.asarray((other - values) / np.maximum(spread, 1e-300))


def _refused(
    unknowns: Sequence[Unknown], away: Array, values: Array, other: Array, part: float = 1.0
) -> tuple[str, ...]:
    """Coefficients of which two estimates are `_apart`."""
    rows = zip(unknowns, away, values, other, strict=True)
    return tuple(
        unknown.name
        for unknown, far, before, after in rows
        if unknown.kind == "coefficient" and _apart(far, before, after, unknown.scale, part)
    )


def _apart(away: float, value: float, other: float, scale: float, part: float = 1.0) -> bool:
    """Whether two estimates differ by more than chance, and by a part of what matters."""
    return abs(away) > SPECIFICATION_SETTINGS.apart_sd and matters(value, other, scale, part)


def matters(value: float, other: float, scale: float, part: float = 1.0) -> bool:
    """Whether two estimates differ by a twentieth or part of it; `scale` is the width of the bounds."""
    return bool(
        abs(other - value)
        > part
        * SPECIFICATION_SETTINGS.matters_share
        * max(abs(value), SPECIFICATION_SETTINGS.nothing_share * scale)
    )


class PredictionError:
    """Joint estimate by the prediction errors of a filter (`seatrial.estimation.innovations`)."""

    def __init__(self, joint: Joint) -> None:
        self.joint = joint

    def estimate(
        self, start: Array | None, *, rounds: int, near: bool, watch: Callable[[Step], None] | None
    ) -> Polished:
        """The estimate from the likelier of a start and the campaign's own; it seeks no others."""
        began, joint = time.monotonic(), self.joint
        first = joint.start if start is None else np.asarray(start, dtype=float)
        innovations = Innovations(joint)
        own = first.copy()
        own[: len(joint.estimated)] = [parameter.start for parameter in joint.estimated]
        if rounds and joint.noise_model is None and not np.array_equal(own, first):
            first = innovations.likelier([first, own])
        ended = innovations.estimate(first, rounds, watch)
        return Polished(
            values=joint.on_bounds(ended.values),
            initial=innovations.initial(),
            noise=ended.noise,
            cost=ended.cost,
            start_cost=ended.start_cost,
            samples=ended.samples,
            rounds=ended.rounds,
            evaluations=ended.rounds + 1,
            converged=ended.converged,
            interrupted=ended.interrupted,
            wall_s=time.monotonic() - began,
            spread=ended.values[None],
            costs=np.array([ended.cost]),
            method="innovations",
            method_reason=joint.method_reason,
            waves=None if joint.noise_model is None else joint.noise_model.waves(),
            stopped=ended.stopped,
        )

    def linearised(
        self, values: Array, *, initial: Array | None, noise: Array | None, extra: Sequence[str]
    ) -> Linearisation:
        """Prediction errors and their derivatives; the filter has initial conditions and noise of its own."""
        return Innovations(self.joint).linearisation(values, extra)

    def otherwise(self, polished: Polished) -> Polished:
        """With what predictions over other horizons say, and the log without commands that know more."""
        if not polished.rounds or polished.interrupted:
            return polished
        innovations, values = Innovations(self.joint), polished.values
        judged = horizons(innovations, values)
        return replace(polished, horizons=judged, log_alone=log_alone(innovations, values))

    def diverges(self, polished: Polished) -> bool:
        """Never: a filter follows the log."""
        return False


def estimator(joint: Joint) -> Estimator:
    """The estimator of a joint estimate, by its method."""
    module, name = joint.comparison.estimator.split(":")
    made: Estimator = getattr(importlib.import_module(module), name)(joint)
    return made


def polish(
    joint: Joint,
    *,
    start: Array | None = None,
    rounds: int | None = None,
    near: bool = False,
    watch: Callable[[Step], None] | None = None,
) -> Polished:
    """Joint estimate from a start, and from others around it where the campaign asks for several.

    Parameters
    ----------
    joint : Joint
    start : ndarray, shape (m,), optional
        By default the joint estimate's own start.
    rounds : int, optional
        Rounds at most; by default the campaign's. None is taken with zero: the start is judged.
    near : bool
        Whether the start is near the optimum, such as that of most of the same data: it is searched from
        there alone, on all segments, with the derivatives that hold there.
    watch : callable, optional
        Called after every round; it may raise KeyboardInterrupt.
    """
    limit = joint.polish.rounds if rounds is None else rounds
    return estimator(joint).estimate(start, rounds=limit, near=near, watch=watch)


def linearise(
    joint: Joint,
    values: Array,
    *,
    initial: Array | None = None,
    noise: Array | None = None,
    extra: Sequence[str] = (),
) -> Linearisation:
    """Linearisation at the values of the unknowns, initial conditions at their best.

    Parameters
    ----------
    joint : Joint
    values : ndarray, shape (m,)
    initial : ndarray, shape (segments, 12), optional
        Initial conditions; by default they are found.
    noise : ndarray, shape (C,), optional
        Standard deviations of the channels' residuals; by default they are estimated.
    extra : sequence of str
        Coefficients that are not estimated but differentiated too, appended to the unknowns.
    """
    return estimator(joint).linearised(values, initial=initial, noise=noise, extra=extra)
