"""seatrial: from sea-trial logs to an identified model of an underwater vehicle.

The names below are the public interface; everything a command of the command line does is one of
these functions first. SI and radians throughout; frames: n = north-east-down, b = forward-starboard-
down with origin O. Everything is loaded when it is first used: `seatrial.__main__` stands ready for
Ctrl-C before any library is.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType

TYPE_CHECKING = False  # without `typing`, which takes longer than all else here
if TYPE_CHECKING:
    from typing import Any

    from seatrial._core import Autopilot as Autopilot
    from seatrial._core import Flights as Flights
    from seatrial._core import Run as Run
    from seatrial._core import State as State
    from seatrial._core import Vehicle as Vehicle
    from seatrial._core import simulate_batch as simulate_batch
    from seatrial.autopilot_start import start_autopilot as start_autopilot
    from seatrial.bench_test import BenchTest as BenchTest
    from seatrial.bench_test import bench as bench
    from seatrial.campaign import Campaign as Campaign
    from seatrial.comparison import Comparison as Comparison
    from seatrial.comparison import compare as compare
    from seatrial.errors import CampaignError as CampaignError
    from seatrial.errors import SeatrialError as SeatrialError
    from seatrial.errors import SimulationError as SimulationError
    from seatrial.errors import TrialError as TrialError
    from seatrial.errors import VehicleError as VehicleError
    from seatrial.flight import Fault as Fault
    from seatrial.flight import Flight as Flight
    from seatrial.flight import Outage as Outage
    from seatrial.flight.fly import fly as fly
    from seatrial.flight.fly_batch import fly_batch as fly_batch
    from seatrial.identification import Identification as Identification
    from seatrial.identify import identify as identify
    from seatrial.mission import Mission as Mission
    from seatrial.random_starts import restarts as restarts
    from seatrial.recorded import LogVerdict as LogVerdict
    from seatrial.recorded import MissionLog as MissionLog
    from seatrial.recorded import verify_log as verify_log
    from seatrial.restart_result import Restarts as Restarts
    from seatrial.score import Score as Score
    from seatrial.score import score as score
    from seatrial.trial import Trial as Trial
    from seatrial.tune import tune as tune
    from seatrial.tuning.tuning_result import Tuning as Tuning
    from seatrial.verification.verification_result import Verification as Verification
    from seatrial.verify import verify as verify

_HOME = {
    "Autopilot": "seatrial._core",
    "BenchTest": "seatrial.bench_test",
    "Campaign": "seatrial.campaign",
    "CampaignError": "seatrial.errors",
    "Comparison": "seatrial.comparison",
    "Fault": "seatrial.flight",
    "Flight": "seatrial.flight",
    "Flights": "seatrial._core",
    "Identification": "seatrial.identification",
    "LogVerdict": "seatrial.recorded",
    "Mission": "seatrial.mission",
    "MissionLog": "seatrial.recorded",
    "Outage": "seatrial.flight",
    "Restarts": "seatrial.restart_result",
    "Run": "seatrial._core",
    "Score": "seatrial.score",
    "SeatrialError": "seatrial.errors",
    "SimulationError": "seatrial.errors",
    "State": "seatrial._core",
    "Trial": "seatrial.trial",
    "TrialError": "seatrial.errors",
    "Tuning": "seatrial.tuning.tuning_result",
    "Vehicle": "seatrial._core",
    "VehicleError": "seatrial.errors",
    "Verification": "seatrial.verification.verification_result",
    "bench": "seatrial.bench_test",
    "compare": "seatrial.comparison",
    "fly": "seatrial.flight",
    "fly_batch": "seatrial.flight",
    "identify": "seatrial.identify",
    "restarts": "seatrial.random_starts",
    "score": "seatrial.score",
    "simulate_batch": "seatrial._core",
    "start_autopilot": "seatrial.autopilot_start",
    "tune": "seatrial.tune",
    "verify": "seatrial.verify",
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


class _Package(ModuleType):
    """The package, in which a public function keeps its name when the module of that name is imported."""

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _HOME and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'seatrial' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
