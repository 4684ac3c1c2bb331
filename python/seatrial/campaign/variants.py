"""Variants of a campaign: the axes that a stage locks in another mode, the search from other start values.

The paper (Taubert et al. 2014, equation 6) freezes the axes that a stage does not free, V_const = 0: in every
segment they keep their initial velocity. Replayed from the recording they enter the forces as they were. The
joint polish stays as it is, whatever the stages did.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

from seatrial.base.channels import AXES
from seatrial.base.errors import CampaignError, nearest
from seatrial.campaign.file import Coefficient, parse

if TYPE_CHECKING:
    from seatrial.campaign.campaign import Campaign

__all__ = ["LockedAxes", "locked", "started"]

LockedAxes = Literal["frozen", "measured"]

_MODES = ("frozen", "measured")


def locked(campaign: Campaign, mode: LockedAxes) -> Campaign:
    """The campaign with every axis that a stage does not free in one mode; comments of its text are kept.

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
    document: Any = tomlkit.parse(campaign.text)
    polish = campaign.file.polish
    if polish is not None and polish.axes is None:
        free = {axis for stage in campaign.stages for axis in stage.axes.free}
        replayed = {axis for stage in campaign.stages for axis in stage.axes.measured} - free
        after = set(AXES) - free if mode == "measured" else set()
        if replayed != after:
            document["polish"]["axes"] = _axes(free, measured=replayed)
    for table in document["stages"]:
        free = set(table["axes"]["free"])
        table["axes"] = _axes(free, **{mode: set(AXES) - free})
    text = tomlkit.dumps(document)
    return _rebuilt(campaign, parse(text, campaign.source), text)


def started(campaign: Campaign, starts: Mapping[str, Mapping[str, float]], *, seed: int) -> Campaign:
    """The campaign with other start values, SI, by stage and parameter, and with another seed."""
    stages = []
    for stage in campaign.file.stages:
        entries: dict[str, Coefficient] = dict(stage.coefficients)
        for parameter in campaign.parameters[stage.name]:
            if parameter.name in starts.get(stage.name, {}):
                entry, value = entries[parameter.name], starts[stage.name][parameter.name]
                scale = campaign.vehicle.coefficients()[parameter.members[0][0]] if entry.relative else 1.0
                entries[parameter.name] = entry.model_copy(update={"start": value / scale})
        stages.append(stage.model_copy(update={"coefficients": entries}))
    file = campaign.file.model_copy(update={"stages": tuple(stages), "seed": seed})
    return _rebuilt(campaign, file, campaign.text)


def _rebuilt(campaign: Campaign, file: Any, text: str) -> Campaign:
    """A campaign of another file, checked as at its first reading; its trials are read only once."""
    made = type(campaign)(
        file, text=text, source=campaign.source, folder=campaign.folder, trials=campaign._data
    )
    made.trials = campaign.trials
    return made


def _axes(free: set[str], **modes: set[str]) -> Any:
    """Inline table of modes in the order of the axes."""
    import tomlkit

    table = tomlkit.inline_table()
    for name, axes in {"free": free, **modes}.items():
        if axes:
            table[name] = "".join(axis for axis in AXES if axis in axes)
    return table
