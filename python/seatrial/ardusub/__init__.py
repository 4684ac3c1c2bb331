"""ArduSub: its controllers replayed from a log, its parameters tuned from it, and its parameter files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.ardusub.comparison import Replay as Replay
    from seatrial.ardusub.from_log import LogTuning as LogTuning
    from seatrial.ardusub.from_log import tune_log as tune_log
    from seatrial.ardusub.log_replay import replay as replay
    from seatrial.ardusub.parameters import Change as Change
    from seatrial.ardusub.parameters import ChannelMap as ChannelMap
    from seatrial.ardusub.parameters import ParameterFile as ParameterFile
    from seatrial.ardusub.parameters import changes as changes
    from seatrial.ardusub.parameters import map_channels as map_channels
    from seatrial.ardusub.parameters import map_parameters as map_parameters
    from seatrial.ardusub.parameters import write_changes as write_changes

_HOMES = {
    "Change": "parameters",
    "ChannelMap": "parameters",
    "LogTuning": "from_log",
    "ParameterFile": "parameters",
    "Replay": "comparison",
    "changes": "parameters",
    "map_channels": "parameters",
    "map_parameters": "parameters",
    "replay": "log_replay",
    "tune_log": "from_log",
    "write_changes": "parameters",
}

__all__ = sorted(_HOMES)

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(__name__, _HOMES)
