"""Sensors: what a vehicle's instruments would have logged of a simulated run.

`KINDS` says what each kind logs, `Sensor` how well, `measure` makes the log. The true values are in
`seatrial.sensors.ideal`, the time stamps in `seatrial.sensors.stamps`, the silences in
`seatrial.sensors.drop_outs`, the wrench of a tied vehicle in `seatrial.sensors.load_cell`.
"""

from seatrial.sensors.conditions import Conditions
from seatrial.sensors.kinds import KINDS, Kind
from seatrial.sensors.measurement import biases, measure
from seatrial.sensors.sensor import Sensor, parse_sensors

__all__ = ["KINDS", "Conditions", "Kind", "Sensor", "biases", "measure", "parse_sensors"]
