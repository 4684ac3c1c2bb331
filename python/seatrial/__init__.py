"""seatrial: from sea-trial logs to an identified model of an underwater vehicle.

The names below are the public interface; everything a command of the command line does is one of
these functions first. SI and radians throughout; frames: n = north-east-down, b = forward-starboard-
down with origin O. Heavy libraries are loaded when they are first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from seatrial._core import Autopilot, Flights, Run, State, Vehicle, simulate_batch
from seatrial.errors import CampaignError, SeatrialError, SimulationError, TrialError, VehicleError
from seatrial.identify import identify
from seatrial.score import Score, score
from seatrial.trial import Trial
from seatrial.tune import tune
from seatrial.verify import verify

if TYPE_CHECKING:
    from seatrial.autopilot_start import start_autopilot as start_autopilot
    from seatrial.bench_test import BenchTest as BenchTest
    from seatrial.bench_test import bench as bench
    from seatrial.campaign import Campaign as Campaign
    from seatrial.comparison import Comparison as Comparison
    from seatrial.comparison import compare as compare
    from seatrial.flight import Fault as Fault
    from seatrial.flight import Flight as Flight
    from seatrial.flight import Outage as Outage
    from seatrial.flight.fly import fly as fly
    from seatrial.flight.fly_batch import fly_batch as fly_batch
    from seatrial.identification import Identification as Identification
    from seatrial.mission import Mission as Mission
    from seatrial.random_starts import restarts as restarts
    from seatrial.recorded import LogVerdict as LogVerdict
    from seatrial.recorded import MissionLog as MissionLog
    from seatrial.recorded import verify_log as verify_log
    from seatrial.restart_result import Restarts as Restarts
    from seatrial.tuning.tuning_result import Tuning as Tuning
    from seatrial.verification.verification_result import Verification as Verification

_LAZY = {
    "BenchTest": "seatrial.bench_test",
    "Campaign": "seatrial.campaign",
    "Comparison": "seatrial.comparison",
    "Fault": "seatrial.flight",
    "Flight": "seatrial.flight",
    "Identification": "seatrial.identification",
    "LogVerdict": "seatrial.recorded",
    "Mission": "seatrial.mission",
    "MissionLog": "seatrial.recorded",
    "Outage": "seatrial.flight",
    "Restarts": "seatrial.restart_result",
    "bench": "seatrial.bench_test",
    "compare": "seatrial.comparison",
    "fly": "seatrial.flight",
    "fly_batch": "seatrial.flight",
    "restarts": "seatrial.random_starts",
    "Tuning": "seatrial.tuning.tuning_result",
    "Verification": "seatrial.verification.verification_result",
    "start_autopilot": "seatrial.autopilot_start",
    "verify_log": "seatrial.recorded",
}

__all__ = [
    "Autopilot",
    "BenchTest",
    "Campaign",
    "CampaignError",
    "Comparison",
    "Fault",
    "Flight",
    "Flights",
    "Identification",
    "LogVerdict",
    "Mission",
    "MissionLog",
    "Outage",
    "Restarts",
    "Run",
    "Score",
    "SeatrialError",
    "SimulationError",
    "State",
    "Trial",
    "TrialError",
    "Tuning",
    "Vehicle",
    "VehicleError",
    "Verification",
    "bench",
    "compare",
    "fly",
    "fly_batch",
    "identify",
    "restarts",
    "score",
    "simulate_batch",
    "start_autopilot",
    "tune",
    "verify",
    "verify_log",
]


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'seatrial' has no attribute {name!r}")
    return getattr(import_module(_LAZY[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
