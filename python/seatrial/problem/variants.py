"""Variants of what an identification is asked: without a trial, without coefficients, with strips.

Tests: ``tests/campaign/test_variant.py``, ``tests/identification/test_leave_one_out.py``.
"""

from __future__ import annotations

from collections.abc import Collection

from seatrial.base.channels import AXES
from seatrial.problem.parameter import STRIPS
from seatrial.problem.settings import Axes, Coefficient, JointSettings, Nuisance, Stage

Stages = tuple[Stage, ...]


def without_trial(
    stages: Stages, joint: JointSettings | None, name: str
) -> tuple[Stages, JointSettings | None, tuple[str, ...]]:
    """Stages and joint estimate without a trial, and the stages that no other trial is left for.

    What such a stage frees is estimated with everything else, where a joint estimate is asked for.
    """
    kept: list[Stage] = []
    lost: list[Stage] = []
    for stage in stages:
        others = tuple(trial for trial in stage.trials if trial != name)
        (kept if others else lost).append(stage.model_copy(update={"trials": others}))
    gone = {stage.name for stage in lost}
    left = tuple(
        stage.model_copy(update={"after": tuple(before for before in stage.after if before not in gone)})
        for stage in kept
    )
    if joint is not None:
        # Without axes of its own the joint estimate takes those of all stages, the lost ones among them.
        free = {axis for stage in stages for axis in stage.axes.free}
        replayed = {axis for stage in stages for axis in stage.axes.measured} - free
        axes = Axes(
            free="".join(axis for axis in AXES if axis in free),
            measured="".join(axis for axis in AXES if axis in replayed),
        )
        staged = {key for stage in left for key in stage.coefficients}
        unstaged = {
            key: entry
            for stage in lost
            for key, entry in stage.coefficients.items()
            if key not in staged and key not in joint.fixed
        }
        joint = joint.model_copy(
            update={
                "trials": tuple(trial for trial in joint.trials if trial != name),
                "axes": joint.axes or axes,
                "coefficients": unstaged | joint.coefficients,
                "fixed": tuple(key for key in joint.fixed if key in staged),
                "nuisances": _nuisances(joint, name),
            }
        )
    return left, joint, tuple(stage.name for stage in lost)


def without_free(
    stages: Stages, joint: JointSettings | None, names: Collection[str]
) -> tuple[Stages, JointSettings | None]:
    """Stages and joint estimate that free none of these coefficients; stages that have no other are gone."""
    left = {
        stage.name: {name: entry for name, entry in stage.coefficients.items() if name not in names}
        for stage in stages
    }
    after = {stage.name: stage.after for stage in stages}

    def kept(before: tuple[str, ...]) -> tuple[str, ...]:
        # What followed a stage that is gone follows those before it.
        earlier = [e for name in before for e in ([name] if left.get(name, True) else kept(after[name]))]
        return tuple(dict.fromkeys(earlier))

    others = tuple(
        stage.model_copy(update={"coefficients": left[stage.name], "after": kept(stage.after)})
        for stage in stages
        if left[stage.name]
    )
    if joint is not None:
        freed = {name: entry for name, entry in joint.coefficients.items() if name not in names}
        fixed = tuple(name for name in joint.fixed if name not in names)
        joint = joint.model_copy(update={"coefficients": freed, "fixed": fixed})
    return others, joint


def strips_freed(
    stages: Stages, joint: JointSettings | None, name: str, entry: tuple[tuple[float, float], float]
) -> tuple[Stages, JointSettings | None]:
    """Stages that free the strips ``C_Dy`` or ``C_Dz`` in place of the quadratic damping that they make.

    They stand in the stage that frees the first of what they replace, in these bounds and from this start.
    """
    replaced = set(STRIPS[name])
    bounds, start = entry
    first = next((stage for stage in stages if replaced & stage.coefficients.keys()), None)
    others, joint = without_free(stages, joint, replaced)
    if first is None:
        return others, joint
    coefficients: dict[str, Coefficient] = {}
    for key, given in first.coefficients.items():
        if key not in replaced:
            coefficients[key] = given
        else:
            coefficients.setdefault(name, Coefficient(bounds=bounds, start=start))
    kept = {stage.name: stage for stage in others}
    kept[first.name] = first.model_copy(update={"coefficients": coefficients})
    return tuple(kept[stage.name] for stage in stages if stage.name in kept), joint


def _nuisances(joint: JointSettings, name: str) -> dict[str, Nuisance]:
    """Nuisance parameters without those that belong to one trial alone."""
    kept = {}
    for key, entry in joint.nuisances.items():
        others = tuple(trial for trial in entry.trials if trial != name)
        if others or not entry.trials:
            kept[key] = entry.model_copy(update={"trials": others})
    return kept
