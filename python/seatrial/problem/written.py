"""The campaign file that states a problem made by hand: kept with its results, to read and to change.

Only what differs from the defaults is written. Trials that were given as tables stand under the name of what
they were read from.

Tests: ``tests/problem/test_by_hand.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from seatrial.base.toml_file import Section
    from seatrial.problem.stage import TrialUse


def as_campaign_file(
    head: Mapping[str, Any],
    *,
    trials: Mapping[str, tuple[str, TrialUse]],
    stages: Sequence[Section],
    joint: Section | None,
    anchor: Section,
) -> str:
    """Text (TOML) of a campaign file.

    Parameters
    ----------
    head : mapping
        Keys at its beginning: format, name, vehicle, seed.
    trials : mapping
        By name the file of a trial, or what it was read from, and how it is used.
    stages, joint, anchor
        Sections; None for no joint estimate.
    """
    import tomlkit

    table: dict[str, Any] = {
        **head,
        "trials": {name: _trial(*trial) for name, trial in trials.items()},
        "stages": [_given(stage) for stage in stages],
    }
    if joint is not None:
        table["polish"] = _given(joint)
    if known := _given(anchor):
        table["anchor"] = known
    return tomlkit.dumps(table)


def _given(section: Section) -> dict[str, Any]:
    """What of a section is not its default, as TOML holds it."""
    return section.model_dump(mode="json", exclude_defaults=True)


def _trial(file: str, use: TrialUse) -> dict[str, Any]:
    table: dict[str, Any] = {"file": file, "input": use.input}
    if use.hold_out:
        table["hold_out"] = True
    if use.hold_out_s:
        table["hold_out_s"] = [list(interval) for interval in use.hold_out_s]
    return table
