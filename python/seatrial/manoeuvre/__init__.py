"""Manoeuvres: what is sailed to identify a vehicle, and what it takes in depth, area and care.

One concept, one file: `drive` (which actuators push which axis), `shapes` (levels over time), `repertoire`
(staircase, coast-down, zigzag, spiral, dives, multisine), `decay` (free decays), `forecast` (simulated before
it is sailed), `proposals` (those that fit into given limits), `fisher` (what one tells), `known` (what is
known before).
"""

from seatrial.manoeuvre.decay import free_decay
from seatrial.manoeuvre.definition import Manoeuvre, Start
from seatrial.manoeuvre.drive import AHEAD, Drive, Thrusters
from seatrial.manoeuvre.forecast import Forecast, Limits, forecast, simulated, uneven
from seatrial.manoeuvre.repertoire import coast_down, dive, multisine, spiral, staircase, zigzag

__all__ = [
    "AHEAD",
    "Drive",
    "Forecast",
    "Limits",
    "Manoeuvre",
    "Start",
    "Thrusters",
    "coast_down",
    "dive",
    "forecast",
    "free_decay",
    "multisine",
    "simulated",
    "spiral",
    "staircase",
    "uneven",
    "zigzag",
]
