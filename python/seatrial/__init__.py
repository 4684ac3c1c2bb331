"""seatrial: from sea-trial logs to an identified model of an underwater vehicle.

The names below are the public interface; everything a command of the command line does is one of
these functions first. SI and radians throughout; frames: n = north-east-down, b = forward-starboard-
down with origin O. Heavy libraries are loaded when they are first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from seatrial._core import Run, State, Vehicle, simulate_batch
from seatrial.errors import CampaignError, SeatrialError, SimulationError, TrialError, VehicleError
from seatrial.identify import identify
from seatrial.score import Score, score
from seatrial.trial import Trial

if TYPE_CHECKING:
    from seatrial.bench_test import BenchTest as BenchTest
    from seatrial.bench_test import bench as bench
    from seatrial.campaign import Campaign as Campaign
    from seatrial.comparison import Comparison as Comparison
    from seatrial.comparison import compare as compare
    from seatrial.identification import Identification as Identification
    from seatrial.random_starts import restarts as restarts
    from seatrial.restart_result import Restarts as Restarts

_LAZY = {
    "BenchTest": "seatrial.bench_test",
    "Campaign": "seatrial.campaign",
    "Comparison": "seatrial.comparison",
    "Identification": "seatrial.identification",
    "Restarts": "seatrial.restart_result",
    "bench": "seatrial.bench_test",
    "compare": "seatrial.comparison",
    "restarts": "seatrial.random_starts",
}

__all__ = [
    "BenchTest",
    "Campaign",
    "CampaignError",
    "Comparison",
    "Identification",
    "Restarts",
    "Run",
    "Score",
    "SeatrialError",
    "SimulationError",
    "State",
    "Trial",
    "TrialError",
    "Vehicle",
    "VehicleError",
    "bench",
    "compare",
    "identify",
    "restarts",
    "score",
    "simulate_batch",
]


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'seatrial' has no attribute {name!r}")
    return getattr(import_module(_LAZY[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
