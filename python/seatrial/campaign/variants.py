"""Variants of a campaign file: other modes of the axes that a stage locks, other start values of the search.

The paper (Taubert et al. 2014, equation 6) freezes the axes that a stage does not free, V_const = 0: in every
segment they keep their initial velocity. Replayed from the recording they enter the forces as they were. The
joint estimate stays as it is, whatever the stages did. Held by ``tests/campaign/test_variant.py``.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from seatrial.base.channels import AXES
from seatrial.base.errors import CampaignError, nearest
from seatrial.campaign.file import Axes, CampaignFile, Coefficient, Nuisance, Polish, Stage, parse
from seatrial.campaign.parameters import STRIPS, Parameter

if TYPE_CHECKING:
    from seatrial._core import Vehicle

LockedAxes = Literal["frozen", "measured"]

_MODES = ("frozen", "measured")


def with_locked_axes(text: str, mode: LockedAxes, source: str) -> str:
    """Text of a campaign file with every axis that a stage does not free in one mode; comments are kept.

    Raises
    ------
    CampaignError
        There is no such mode.
    """
    import tomlkit

    if mode not in _MODES:
        raise CampaignError(
            f"locked axes: expected {' or '.join(map(repr, _MODES))}, found {mode!r}{nearest(mode, _MODES)}"
        )
    document: Any = tomlkit.parse(text)
    file = parse(text, source)
    if file.polish is not None and file.polish.axes is None:
        # Without axes of its own the joint estimate takes those of the stages, which are about to change.
        free = {axis for stage in file.stages for axis in stage.axes.free}
        replayed = {axis for stage in file.stages for axis in stage.axes.measured} - free
        after = set(AXES) - free if mode == "measured" else set()
        if replayed != after:
            document["polish"]["axes"] = _axes(free, measured=replayed)
    for table in document["stages"]:
        free = set(table["axes"]["free"])
        table["axes"] = _axes(free, **{mode: set(AXES) - free})
    return tomlkit.dumps(document)


def with_start_values(
    file: CampaignFile,
    parameters: Mapping[str, Sequence[Parameter]],
    starts: Mapping[str, Mapping[str, float]],
    vehicle: Vehicle,
) -> CampaignFile:
    """Campaign file with other start values, SI, by stage and parameter."""
    stages = []
    for stage in file.stages:
        entries: dict[str, Coefficient] = dict(stage.coefficients)
        for parameter in parameters[stage.name]:
            if parameter.name in starts.get(stage.name, {}):
                entry, value = entries[parameter.name], starts[stage.name][parameter.name]
                scale = vehicle.coefficients()[parameter.members[0][0]] if entry.relative else 1.0
                entries[parameter.name] = entry.model_copy(update={"start": value / scale})
        stages.append(stage.model_copy(update={"coefficients": entries}))
    return file.model_copy(update={"stages": tuple(stages)})


def without_trial(file: CampaignFile, name: str) -> tuple[CampaignFile, tuple[str, ...]]:
    """Campaign file that does not know a trial, and the stages that no other trial is left for.

    What such a stage frees is estimated with everything else, where the file asks for a joint estimate.
    """
    kept: list[Stage] = []
    lost: list[Stage] = []
    for stage in file.stages:
        others = tuple(trial for trial in stage.trials if trial != name)
        (kept if others else lost).append(stage.model_copy(update={"trials": others}))
    gone = {stage.name for stage in lost}
    stages = tuple(
        stage.model_copy(update={"after": tuple(one for one in stage.after if one not in gone)})
        for stage in kept
    )
    polish = file.polish
    if polish is not None:
        free = {axis for stage in file.stages for axis in stage.axes.free}
        replayed = {axis for stage in file.stages for axis in stage.axes.measured} - free
        axes = Axes(
            free="".join(axis for axis in AXES if axis in free),
            measured="".join(axis for axis in AXES if axis in replayed),
        )
        staged = {key for stage in stages for key in stage.coefficients}
        unstaged = {
            key: entry
            for stage in lost
            for key, entry in stage.coefficients.items()
            if key not in staged and key not in polish.fixed
        }
        polish = polish.model_copy(
            update={
                "trials": tuple(trial for trial in polish.trials if trial != name),
                "axes": polish.axes or axes,
                "coefficients": unstaged | polish.coefficients,
                "fixed": tuple(key for key in polish.fixed if key in staged),
                "nuisances": _nuisances(polish, name),
            }
        )
    trials = {trial: source for trial, source in file.trials.items() if trial != name}
    shorter = file.model_copy(update={"trials": trials, "stages": stages, "polish": polish})
    return shorter, tuple(stage.name for stage in lost)


def without_coefficients(file: CampaignFile, names: Collection[str]) -> CampaignFile:
    """Campaign file that frees none of these coefficients; stages that have no other one are gone."""
    left = {
        stage.name: {name: entry for name, entry in stage.coefficients.items() if name not in names}
        for stage in file.stages
    }
    after = {stage.name: stage.after for stage in file.stages}

    def kept(before: tuple[str, ...]) -> tuple[str, ...]:
        # What followed a stage that is gone follows those before it.
        found = [one for name in before for one in ([name] if left.get(name, True) else kept(after[name]))]
        return tuple(dict.fromkeys(found))

    stages = tuple(
        stage.model_copy(update={"coefficients": left[stage.name], "after": kept(stage.after)})
        for stage in file.stages
        if left[stage.name]
    )
    polish = file.polish
    if polish is not None:
        freed = {name: entry for name, entry in polish.coefficients.items() if name not in names}
        fixed = tuple(name for name in polish.fixed if name not in names)
        polish = polish.model_copy(update={"coefficients": freed, "fixed": fixed})
    return file.model_copy(update={"stages": stages, "polish": polish})


def with_strips(file: CampaignFile, name: str, bounds: tuple[float, float], start: float) -> CampaignFile:
    """Campaign file that frees the strips ``C_Dy`` or ``C_Dz`` in place of the quadratic damping they make.

    They stand in the stage that frees the first of what they replace, from this start and in these bounds.
    """
    replaced = set(STRIPS[name])
    free = Coefficient(bounds=bounds, start=start)

    def other(coefficients: Mapping[str, Coefficient]) -> dict[str, Coefficient]:
        first = next((one for one in coefficients if one in replaced), None)
        found: dict[str, Coefficient] = {}
        for one, entry in coefficients.items():
            if one == first:
                found[name] = free
            if one not in replaced:
                found[one] = entry
        return found

    first = next((stage for stage in file.stages if replaced & stage.coefficients.keys()), None)
    rest = without_coefficients(file, replaced)
    kept = {stage.name: stage for stage in rest.stages}
    if first is None:
        return rest
    kept[first.name] = first.model_copy(update={"coefficients": other(first.coefficients)})
    stages = tuple(kept[stage.name] for stage in file.stages if stage.name in kept)
    return rest.model_copy(update={"stages": stages})


def _nuisances(polish: Polish, name: str) -> dict[str, Nuisance]:
    """Nuisance parameters without those that belong to one trial alone."""
    found = {}
    for key, entry in polish.nuisances.items():
        others = tuple(trial for trial in entry.trials if trial != name)
        if others or not entry.trials:
            found[key] = entry.model_copy(update={"trials": others})
    return found


def _axes(free: set[str], **modes: set[str]) -> Any:
    """Inline table of modes in the order of the axes."""
    import tomlkit

    table = tomlkit.inline_table()
    for name, axes in {"free": free, **modes}.items():
        if axes:
            table[name] = "".join(axis for axis in AXES if axis in axes)
    return table
