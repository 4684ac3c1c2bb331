"""Coefficients that an identification leaves as they are, because feedback hides them in all of its trials.

Where an autopilot answers waves, a fit finds the controller's inverse (`seatrial.inspect.verdict`). What only
such an axis could tell is not estimated: gains of its actuators, its damping, lift and added mass. One trial
that tells the axis frees them again. Coefficients that are tied to one that is told follow it.

What is estimated beside them is conditional on the values that they keep. With the information H of the joint
estimate, its coefficients as theta and the held ones as psi, an error of psi moves theta by

    d theta = -H_tt^-1 H_tp d psi.

Held by ``tests/identification/test_held.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.estimation.estimator import Polished
from seatrial.estimation.joint import Joint, joint_stage
from seatrial.estimation.joint_estimate import linearise
from seatrial.inspect.verdict import Verdict, best, untold
from seatrial.problem.parameter import Parameter, parameters

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.problem.problem import Problem
    from seatrial.statistics.uncertainty import Uncertainty


@dataclass(frozen=True)
class HeldSettings:
    """What is told of estimates that rest on held values."""

    #: Error of a held value whose effect is told, over the value.
    error_share: float = 0.2
    #: Information over the widths of the bounds, over its largest, below which nothing is told.
    rank: float = 1e-10


HELD_SETTINGS = HeldSettings()


@dataclass(frozen=True)
class Held:
    """A coefficient that was to be identified and keeps the value of the vehicle file."""

    #: Of the coefficient, SI.
    name: str
    value: float
    unit: str
    #: Its name in the campaign: the coefficient's own, or that of its group.
    parameter: str
    #: Letter of the axis that alone could tell it.
    axis: str
    #: The verdict on that axis, with its evidence.
    why: str
    #: Which trial tells it.
    trial: str


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


def conditional(
    joint: Joint, polished: Polished, held: Sequence[Held], known: Uncertainty
) -> tuple[Conditional, ...]:
    """Estimates that would move by a standard deviation or more were a held value a fifth larger.

    Those that ended at a bound cannot move. To first order, at the estimate. None where the held values are
    nuisance parameters of the estimate.

    ``joint``, ``polished``: the joint estimate. ``held``: of `hold_untold`. ``known``: uncertainty of the
    joint estimate.
    """
    if not held or joint.hidden:
        return ()
    lin = linearise(
        joint,
        polished.values,
        initial=polished.initial,
        noise=polished.noise,
        extra=[row.name for row in held],
    )
    count = len(joint.unknowns)
    free = [place for place, bound in enumerate(known.at_bound) if bound is None]
    size = np.array([joint.unknowns[place].scale for place in free])
    whole = lin.information()
    inside = np.linalg.pinv(
        size[:, None] * whole[np.ix_(free, free)] * size, rcond=HELD_SETTINGS.rank, hermitian=True
    )
    changes = []
    for name in dict.fromkeys(row.parameter for row in held):
        more = np.array([HELD_SETTINGS.error_share * row.value * (row.parameter == name) for row in held])
        moved = -size * (inside @ (size * (whole[np.ix_(free, range(count, len(whole)))] @ more)))
        for place, change in zip(free, moved.tolist(), strict=True):
            away = change / float(known.sigma[place])
            if abs(away) >= 1.0:
                unknown = joint.unknowns[place]
                changes.append(Conditional(unknown.name, unknown.unit, name, change, away))
    return tuple(sorted(changes, key=lambda change: -abs(change.deviations)))


def joint_estimate_of(
    problem: Problem, whole: Problem, held: Sequence[Held], vehicle: Vehicle, *, threads: int | None = None
) -> Joint:
    """The joint estimate beside held coefficients.

    With a noise model they are nuisance parameters of it: its predictions tell them in part, and held at a
    wrong value they bend what another axis tells. Output error keeps them as they are.

    ``campaign``, ``held``: of `hold_untold`. ``whole``: the campaign before it. ``vehicle``: gives the start
    values.
    """
    joint = Joint(problem, vehicle, threads=threads)
    if not held or not joint.comparison.models_noise:
        return joint
    return Joint(whole, vehicle, threads=threads, hidden={row.parameter for row in held})


def hold_untold(problem: Problem) -> tuple[Problem, tuple[Held, ...]]:
    """The campaign without what feedback hides in all trials that it fits, and what that is.

    ``problem``: trials whose forces are measured have no commands and tell every axis.
    """
    polish = problem.joint
    names = dict.fromkeys(name for stage in problem.stages for name in stage.trials)
    names |= dict.fromkeys(() if polish is None else polish.trials)
    if any(problem.input_of(name) != "commands" for name in names):
        return problem, ()
    verdicts = best(problem.verdicts(name) for name in names)
    if not any(verdict.dominated for verdict in verdicts.values()):
        return problem, ()
    freed = {
        parameter.name: parameter for stage in problem.stages for parameter in problem.parameters[stage.name]
    }
    if polish is not None:
        whole = joint_stage(problem)
        freed |= {
            parameter.name: parameter
            for parameter in parameters(whole, problem.vehicle, f"{problem.source}: polish")
        }
    members = dict.fromkeys(member for parameter in freed.values() for member, _ in parameter.members)
    axis_of = {name: axis for axis, own in untold(members, verdicts, problem.vehicle).items() for name in own}
    chosen = [
        parameter for parameter in freed.values() if all(member in axis_of for member, _ in parameter.members)
    ]
    rows = tuple(row for parameter in chosen for row in _rows(problem, parameter, axis_of, verdicts))
    return problem.without_coefficients({parameter.name for parameter in chosen}), rows


def sentences(held: Sequence[Held]) -> tuple[str, ...]:
    """Per axis: why it is dominated, what keeps its value, what that means for the rest, what would tell."""
    texts = []
    for axis in dict.fromkeys(row.axis for row in held):
        own = [row for row in held if row.axis == axis]
        kept = ", ".join(dict.fromkeys(row.parameter for row in own))
        texts.append(
            f"{own[0].why}. Not identified, kept at the vehicle file's values: {kept}. Other estimates on"
            f" this axis may depend on these; {own[0].trial}"
        )
    return tuple(texts)


def comment(held: Sequence[Held]) -> str:
    """Comment for the head of the vehicle file; empty where nothing was held."""
    lines = [
        f"# {row.name} = {row.value:.6g} {row.unit}: not identified, dominated by feedback ({row.axis})"
        for row in held
    ]
    return "\n".join([*lines, f"# {held[0].trial}", "", ""]) if held else ""


def _rows(
    problem: Problem, parameter: Parameter, axis_of: dict[str, str], verdicts: dict[str, Verdict]
) -> list[Held]:
    """A row per coefficient that a parameter sets."""
    values, info = problem.vehicle.coefficients(), problem.vehicle.coefficient_info()
    rows = []
    for name, _ in parameter.members:
        verdict = verdicts[axis_of[name]]
        value = values.get(name, 0.0)
        rows.append(
            Held(name, value, info[name]["unit"], parameter.name, verdict.axis, verdict.why, verdict.trial)
        )
    return rows
