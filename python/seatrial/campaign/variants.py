"""Variants of a campaign file: other modes of the axes that a stage locks, other start values of the search.

The paper (Taubert et al. 2014, equation 6) freezes the axes that a stage does not free, V_const = 0: in every
segment they keep their initial velocity. Replayed from the recording they enter the forces as they were. The
joint estimate stays as it is, whatever the stages did. Held by ``tests/campaign/test_variant.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from seatrial.base.channels import AXES
from seatrial.base.errors import CampaignError, nearest
from seatrial.campaign.file import CampaignFile, Coefficient, parse
from seatrial.campaign.parameters import Parameter

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["LockedAxes", "with_locked_axes", "with_start_values"]

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


def _axes(free: set[str], **modes: set[str]) -> Any:
    """Inline table of modes in the order of the axes."""
    import tomlkit

    table = tomlkit.inline_table()
    for name, axes in {"free": free, **modes}.items():
        if axes:
            table[name] = "".join(axis for axis in AXES if axis in axes)
    return table
