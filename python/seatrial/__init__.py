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
    from seatrial.campaign import Campaign as Campaign
    from seatrial.identification import Identification as Identification

_LAZY = {"Campaign": "seatrial.campaign", "Identification": "seatrial.identification"}

__all__ = [
    "Campaign",
    "CampaignError",
    "Identification",
    "Run",
    "Score",
    "SeatrialError",
    "SimulationError",
    "State",
    "Trial",
    "TrialError",
    "Vehicle",
    "VehicleError",
    "identify",
    "score",
    "simulate_batch",
]


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'seatrial' has no attribute {name!r}")
    return getattr(import_module(_LAZY[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
