"""Recorded missions: does the model still hold on a log, what is suspected, what did the mission do."""

from seatrial.recorded.judge_log import verify_log
from seatrial.recorded.log_verdict import LogVerdict
from seatrial.recorded.mission_log import MissionLog

__all__ = ["LogVerdict", "MissionLog", "verify_log"]
