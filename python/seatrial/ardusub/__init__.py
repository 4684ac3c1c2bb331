"""ArduSub: its controllers replayed from a log, and its parameter files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.ardusub.log_replay import Replay as Replay
    from seatrial.ardusub.log_replay import replay as replay
    from seatrial.ardusub.parameters import Change as Change
    from seatrial.ardusub.parameters import ParameterFile as ParameterFile
    from seatrial.ardusub.parameters import changes as changes
    from seatrial.ardusub.parameters import write_changes as write_changes

__all__ = ["Change", "ParameterFile", "Replay", "changes", "replay", "write_changes"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(
        __name__,
        {
            "Change": "parameters",
            "ParameterFile": "parameters",
            "Replay": "log_replay",
            "changes": "parameters",
            "replay": "log_replay",
            "write_changes": "parameters",
        },
    )
