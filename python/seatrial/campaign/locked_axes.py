"""Variant of a campaign file with other modes of the axes that a stage locks.

The paper (Taubert et al. 2014, equation 6) freezes the axes that a stage does not free, V_const = 0: in every
segment they keep their initial velocity. Replayed from the recording they enter the forces as they were. The
joint estimate stays as it is, whatever the stages did. Held by ``tests/campaign/test_variant.py``.
"""

from __future__ import annotations

from typing import Any, Literal

from seatrial.base.channels import AXES
from seatrial.base.errors import CampaignError, nearest
from seatrial.campaign.file import parse

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


def _axes(free: set[str], **modes: set[str]) -> Any:
    """Inline table of modes in the order of the axes."""
    import tomlkit

    table = tomlkit.inline_table()
    for name, axes in {"free": free, **modes}.items():
        if axes:
            table[name] = "".join(axis for axis in AXES if axis in axes)
    return table
