"""ArduSub: its controllers replayed from a log, and its parameter files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.ardusub.parameters import Change as Change
    from seatrial.ardusub.parameters import ParameterFile as ParameterFile
    from seatrial.ardusub.parameters import changes as changes
    from seatrial.ardusub.parameters import write_changes as write_changes
    from seatrial.ardusub.replay import Replay as Replay
    from seatrial.ardusub.replay import replay as replay

__all__ = ["Change", "ParameterFile", "Replay", "changes", "replay", "write_changes"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(
        __name__,
        {
            "Change": "parameters",
            "ParameterFile": "parameters",
            "Replay": "replay",
            "changes": "parameters",
            "replay": "replay",
            "write_changes": "parameters",
        },
    )
