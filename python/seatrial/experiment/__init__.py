"""Design of experiments: manoeuvres, the plan of the next trial."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.experiment.combinations import Thrusters as Thrusters
    from seatrial.experiment.forecast import Limits as Limits
    from seatrial.experiment.manoeuvre import coast_down as coast_down
    from seatrial.experiment.manoeuvre import dive as dive
    from seatrial.experiment.manoeuvre import free_decay as free_decay
    from seatrial.experiment.manoeuvre import multisine as multisine
    from seatrial.experiment.manoeuvre import spiral as spiral
    from seatrial.experiment.manoeuvre import staircase as staircase
    from seatrial.experiment.manoeuvre import zigzag as zigzag

_HOMES = {
    "Limits": "forecast",
    "Thrusters": "combinations",
    "coast_down": "manoeuvre",
    "dive": "manoeuvre",
    "free_decay": "manoeuvre",
    "multisine": "manoeuvre",
    "spiral": "manoeuvre",
    "staircase": "manoeuvre",
    "zigzag": "manoeuvre",
}

__all__ = sorted(_HOMES)

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(__name__, _HOMES)
