"""The estimate by prediction errors, and under other assumptions: whether its model is right enough.

A noise model may be wrong, and the estimate then depends on how far ahead is predicted. The unknowns are
therefore estimated again from predictions over other horizons, with what was known at the start of each as
instruments (`seatrial.estimation.instruments`), so that an autopilot's answer within a horizon does not bend
them. A model of the damping may be wrong, and the log may not tell it from another one
(`seatrial.identification.choice`). An autopilot may answer what its sensors show and the log does not hold
(`seatrial.estimation.instruments`). Where the difference is larger than three of its standard deviations,
and larger than a twentieth of the estimate, the coefficient is not identified.

Standard deviations of differences are those of the sums over blocks of time longer than the correlation.

Source: Hausman, *Specification tests in econometrics*, Econometrica 46 (1978) 1251.
Held by ``tests/estimation/test_innovations.py``.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.work import Step
from seatrial.estimation.estimator import Horizon, LogAlone, OtherDamping, Polished
from seatrial.estimation.innovations import Innovations
from seatrial.estimation.joint import Joint
from seatrial.estimation.one_step import Errors, Span
from seatrial.statistics.linearisation import Linearisation


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


SETTINGS = SpecificationSettings()


def log_alone(innovations: Innovations, values: Array) -> LogAlone | None:
    """Estimates free of what commands answer beyond the log, beside the values (m,); None where none does."""
    joint = innovations.joint
    answers = innovations.answers(innovations.settled(values))
    if not answers.names:
        return None
    own = _influence(innovations, values)

    def free(spans: Sequence[Span], steps: int) -> list[Errors]:
        return answers.freed(innovations.errors(spans, steps))

    at, influence = _estimated(innovations, free, values, values, 1)
    away = _away(values, own, at, influence)
    refused = [
        unknown.name
        for unknown, far, before, after in zip(joint.unknowns, away, values, at, strict=True)
        if unknown.kind == "coefficient" and _apart(far, before, after, unknown.scale, SETTINGS.knowing_share)
    ]
    commands = tuple(name.partition(" ")[2] for name in answers.names)
    return LogAlone(commands, answers.sure, at, away, tuple(refused))


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
        refused = tuple(
            unknown.name
            for unknown, apart in zip(
                joint.unknowns, map(_apart, away, values, shown, criterion.scale), strict=True
            )
            if unknown.kind == "coefficient" and apart
        )
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
    for _ in range(SETTINGS.rounds):
        errors = errors_of(innovations.steps.linearised(at), steps)
        centre = innovations.joint.centres(around)
        taken = criterion.step(errors, criterion.noise(errors), at, centre, overlap=steps)
        before, at = at, np.clip(at + taken.step, criterion.lower, criterion.upper)
        if np.all(np.abs(at - before) < SETTINGS.close_sd * np.sqrt((taken.influence**2).sum(axis=0))):
            break
    return innovations.joint.on_bounds(at), taken.influence


def other_damping(
    strips: str, replaced: tuple[str, ...], first: tuple[Joint, Array], other: tuple[Joint, Array]
) -> OtherDamping:
    """What another model of the damping says of the coefficients that it shares with the fit.

    ``strips``: the drag coefficient that stands against quadratic damping. ``replaced``: the quadratic
    damping of the fit that they replace. ``first``, ``other``: the fit and the estimate with the other model,
    each with its values.
    """
    (joint, values), (rival, theirs) = first, other
    influences = [_influence(Innovations(who), at) for who, at in (first, other)]
    names = [[unknown.name for unknown in who.unknowns] for who in (joint, rival)]
    shared = [name for name in names[0] if name in names[1]]
    mine, its = ([own.index(name) for name in shared] for own in names)
    away = _away(values[mine], influences[0][:, mine], theirs[its], influences[1][:, its])
    unknowns = [joint.unknowns[k] for k in mine]
    return OtherDamping(
        strips,
        replaced,
        True,
        dict(zip(shared, theirs[its].tolist(), strict=True)),
        dict(zip(shared, away.tolist(), strict=True)),
        tuple(
            unknown.name
            for unknown, far, before, after in zip(unknowns, away, values[mine], theirs[its], strict=True)
            if unknown.kind == "coefficient" and _apart(far, before, after, unknown.scale)
        ),
    )


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


def _apart(away: float, value: float, other: float, scale: float, part: float = 1.0) -> bool:
    """Whether two estimates differ by more than chance, and by a part of what matters."""
    return abs(away) > SETTINGS.apart_sd and matters(value, other, scale, part)


def matters(value: float, other: float, scale: float, part: float = 1.0) -> bool:
    """Whether two estimates differ by a twentieth or part of it; `scale` is the width of the bounds."""
    return bool(
        abs(other - value) > part * SETTINGS.matters_share * max(abs(value), SETTINGS.nothing_share * scale)
    )


class PredictionError:
    """Joint estimate by the prediction errors of a filter (`seatrial.estimation.innovations`)."""

    def __init__(self, joint: Joint) -> None:
        self.joint = joint

    def estimate(
        self,
        start: Array | None,
        *,
        rounds: int,
        fixed: Sequence[int],
        also: Sequence[Array],
        near: bool,
        watch: Callable[[Step], None] | None,
    ) -> Polished:
        """The estimate from the likelier of a start and the campaign's own; it seeks no others."""
        began, joint = time.monotonic(), self.joint
        first = joint.start if start is None else np.asarray(start, dtype=float)
        innovations = Innovations(joint)
        own = first.copy()
        open_ = [i for i in range(len(joint.estimated)) if i not in set(fixed)]
        own[open_] = [joint.parameters[i].start for i in open_]
        if rounds and joint.noise_model is None and not np.array_equal(own, first):
            first = innovations.likelier([first, own])
        ended = innovations.estimate(first, rounds, fixed, watch)
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
