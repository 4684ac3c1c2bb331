"""Estimates of the same coefficients under other assumptions: whether the model is right enough for them.

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

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.plain import Plain
from seatrial.estimation.innovations import Innovations
from seatrial.estimation.joint import Joint
from seatrial.estimation.one_step import Errors, Span


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


@dataclass(frozen=True)
class Horizon:
    """Estimates (m,) from predictions ``ahead_s`` ahead, and how far from those of the fit.

    ``away`` (m,) is the difference in its own standard deviations; ``refused`` names the coefficients that
    are not identified because of it.
    """

    ahead_s: float
    values: Array
    away: Array
    refused: tuple[str, ...]

    def to_dict(self, names: Sequence[str]) -> dict[str, Any]:
        """The same by the unknowns' names."""
        return {
            "ahead_s": self.ahead_s,
            "values": dict(zip(names, self.values.tolist(), strict=True)),
            "away": dict(zip(names, self.away.tolist(), strict=True)),
            "refused": list(self.refused),
        }


@dataclass(frozen=True)
class OtherDamping(Plain, only="strips damping own values away refused"):
    """Estimates with another model of the damping, which the log cannot tell from that of the fit.

    ``strips`` names the drag coefficient that stands against quadratic damping, which ``replaced`` names;
    ``by_strips`` says whether this model, and not that of the fit, is the one with strips. ``values`` and
    ``away`` are those of the coefficients that both have; ``refused`` names those that are not identified
    because of it.
    """

    strips: str
    replaced: tuple[str, ...]
    by_strips: bool
    values: Mapping[str, float]
    away: Mapping[str, float]
    refused: tuple[str, ...]

    @property
    def damping(self) -> str:
        """Name of the other model."""
        return damping_model(self.strips, self.replaced, by_strips=self.by_strips)

    @property
    def own(self) -> str:
        """Name of that of the fit."""
        return damping_model(self.strips, self.replaced, by_strips=not self.by_strips)

    @property
    def short(self) -> str:
        """Coefficients of the other model."""
        return self.strips if self.by_strips else " and ".join(self.replaced)


def damping_model(strips: str, replaced: Sequence[str], *, by_strips: bool) -> str:
    """Name of a model of the damping, with its coefficients."""
    return (
        f"cross-flow drag by strips ({strips})"
        if by_strips
        else f"quadratic damping ({' and '.join(replaced)})"
    )


@dataclass(frozen=True)
class LogAlone:
    """Estimates (m,) free of what commands answer beyond the log, and how far from those of the fit.

    ``commands`` names the actuators whose commands do, ``sure`` by how many of its deviations chi squared of
    the prediction errors on the innovations of each says so. ``away`` and ``refused`` as of a `Horizon`.
    """

    commands: tuple[str, ...]
    sure: tuple[float, ...]
    values: Array
    away: Array
    refused: tuple[str, ...]

    def to_dict(self, names: Sequence[str]) -> dict[str, Any]:
        """The same by the names of actuators and unknowns."""
        return {
            "commands": dict(zip(self.commands, self.sure, strict=True)),
            "values": dict(zip(names, self.values.tolist(), strict=True)),
            "away": dict(zip(names, self.away.tolist(), strict=True)),
            "refused": list(self.refused),
        }


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
