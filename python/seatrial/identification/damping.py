"""Quadratic damping or cross-flow drag by strips: which of the two a joint estimate has.

Where a noise model is estimated along, quadratic damping of single velocities stands against cross-flow drag
by strips: a slender hull that sideslips and turns at once is damped by neither velocity alone, and gains bend
to make up for it. A hull shorter than `_SLENDER` of its diameters has no cross-flow of that kind and keeps
quadratic damping. The noises of a wrong damping may hold strips where they begin, so that these are also
tried with noises found anew. The likelihood of held-out data judges. Where it cannot tell the two apart,
quadratic damping stays, and a coefficient of which the two say different things is not identified
(`seatrial.estimation.specification`).

Tests: ``tests/identification/test_choice.py``, ``tests/estimation/test_innovations.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from seatrial._core import Vehicle
from seatrial.base.arrays import Array
from seatrial.base.progress import Step
from seatrial.estimation.innovations import Innovations
from seatrial.estimation.joint import Joint
from seatrial.estimation.joint_estimate import Polished, polish
from seatrial.estimation.noise_model import NoiseModel
from seatrial.estimation.specification import other_damping
from seatrial.problem.parameter import STRIPS
from seatrial.problem.problem import Problem

_LIKELIER = 10.0
"""Log-likelihood of all held-out data from which the other damping is the result."""

_BY_CHANCE = 3.0  # standard deviations of a difference over blocks of time

_ROUNDS, _FAR = 6, 2.0
"""Rounds after which strips are given up, where they are so many times as unlikely as chance makes them."""

_SLENDER = 3.0
"""Length over the larger of diameter and height from which strips are tried: a shorter hull has hardly a
strip that the flow crosses as it crosses a long cylinder. The limit is a choice."""

_STRIPS = 0.8
"""Cross-flow drag coefficient to begin with: a cylinder of finite length (White 2011, table 7.3)."""


def quadratic_or_strips(
    joint: Joint, polished: Polished, *, watch: Callable[[Step], None] | None = None
) -> tuple[Joint, Polished, Callable[[Problem], Problem], tuple[str, ...]]:
    """The joint estimate with quadratic damping, or with cross-flow drag by strips in place of it.

    Each plane whose quadratic damping is free in both axes (``Y_vv`` and ``N_rr``, ``Z_ww`` and ``M_qq``) is
    estimated again with one drag coefficient for all strips of the hull. It is the result where it makes
    held-out data, or all where nothing is held out, more likely by `_LIKELIER` and by more than chance:
    three standard deviations of the difference over blocks of time. Output error is left as it is: its
    residual analysis names strips that are missing.

    Parameters
    ----------
    joint, polished
        With quadratic damping.
    watch : callable, optional
        As of `seatrial.estimation.joint_estimate.polish`.

    Returns
    -------
    tuple
        The joint estimate that is likelier, how it went, what makes a campaign one of its kind, and a
        sentence for each plane that was compared.
    """
    kind: Callable[[Problem], Problem] = lambda problem: problem  # noqa: E731
    if joint.method != "innovations" or polished.interrupted or not slender(joint.vehicle):
        return joint, polished, kind, ()
    notes: list[str] = []
    for name, made in STRIPS.items():
        free = {unknown.name for unknown in joint.unknowns} - joint.hidden
        info = joint.vehicle.coefficient_info()
        if not {made[0], made[-1]} <= free or info.get(name, {}).get("upper") is None:
            continue
        replaced = made[0], made[-1]
        change = partial(
            Problem.with_strips, name=name, bounds=(0.0, float(info[name]["upper"])), start=_STRIPS
        )
        known = dict(zip([unknown.name for unknown in joint.unknowns], polished.values.tolist(), strict=True))
        vehicle = joint.vehicle.with_coefficients(dict.fromkeys(replaced, 0.0) | {name: _STRIPS})
        other = Joint(
            change(joint.problem), vehicle, threads=joint.threads, method=joint.method, hidden=joint.hidden
        )
        other.method_reason = joint.method_reason
        noises: list[NoiseModel | None] = [None] if joint.noise_model is None else [joint.noise_model, None]
        start = [
            known.get(unknown.name, own) for unknown, own in zip(other.unknowns, other.start, strict=True)
        ]
        held_out, ended = bool(joint.steps(held_out=True)[0]), np.array(start)
        for rounds in (_ROUNDS, other.polish.rounds):
            again = _likeliest(other, noises, ended, min(rounds, other.polish.rounds), watch)
            if again.interrupted:
                return joint, replace(polished, interrupted=True), kind, tuple(notes)
            ended, noises = again.values, [other.noise_model]
            quadratic, strips = (
                Innovations(model, held_out=held_out).likelihoods(end.values)
                for model, end in ((joint, polished), (other, again))
            )
            better, chance = likelier_by(quadratic, strips)
            if again.converged or better < -_FAR * max(_LIKELIER, chance):
                break
        taken = better > max(_LIKELIER, chance)
        words = "held-out data" if held_out else "the log"
        drag = f"cross-flow drag by strips ({name})", f"quadratic damping ({' and '.join(replaced)})"
        chosen, rejected = drag if better > 0.0 else drag[::-1]
        by = ", which diverges"
        if math.isfinite(better):
            by = f", by {abs(better):.0f} ± {chance / _BY_CHANCE:.0f} in log-likelihood"
        kept = ", which is not significant" if abs(better) <= max(_LIKELIER, chance) else ""
        kept += "" if taken or better <= 0.0 else "; the latter is kept"
        notes.append(f"{chosen[0].upper()}{chosen[1:]} fits {words} better than {rejected}{by}{kept}")
        if taken:
            joint, polished, kind = other, again, _after(kind, change)
        elif abs(better) <= max(_LIKELIER, chance):
            rival = other_damping(name, (drag[0], drag[1]), (joint, polished.values), (other, again.values))
            polished = replace(polished, others=(*polished.others, rival))
    return joint, polished, kind, tuple(notes)


def slender(vehicle: Vehicle) -> bool:
    """Whether a hull is so long that strips of it see a cross-flow; a hull without measures may be."""
    measures = vehicle.geometry()
    return not measures or measures["length"] >= _SLENDER * max(measures["diameter"], measures["height"])


def _likeliest(
    joint: Joint,
    noises: Sequence[NoiseModel | None],
    start: Array,
    rounds: int,
    watch: Callable[[Step], None] | None,
) -> Polished:
    """The likeliest of the estimates that noise models lead to, which is left with its own."""
    best: tuple[float, Polished, NoiseModel | None] | None = None
    for noise in noises:
        joint.noise_model = noise
        candidate = polish(joint, start=start, rounds=rounds, watch=watch)
        if candidate.interrupted:
            return candidate
        likely = float(Innovations(joint).likelihoods(candidate.values).sum()) if len(noises) > 1 else 0.0
        likely = likely if math.isfinite(likely) else -math.inf
        if best is None or likely > best[0]:
            best = likely, candidate, joint.noise_model
    assert best is not None
    joint.noise_model = best[2]
    return best[1]


def likelier_by(before: Array, after: Array) -> tuple[float, float]:
    """By how much a log-likelihood (blocks,) by blocks of time grew, and how much chance makes of it.

    The latter is three standard deviations of the difference, nil where one of them is of a model that
    diverged.
    """
    if not np.isfinite(after).all():
        return -math.inf, 0.0
    if not np.isfinite(before).all():
        return math.inf, 0.0
    gain = after - before
    return float(gain.sum()), _BY_CHANCE * float(gain.std() * math.sqrt(len(gain)))


def _after(
    first: Callable[[Problem], Problem], second: Callable[[Problem], Problem]
) -> Callable[[Problem], Problem]:
    return lambda problem: second(first(problem))
