"""Closed-loop flights: a vehicle with its sensors and its autopilot on a mission.

`fly` makes one flight, `fly_batch` many; `Flight` holds what happened. Sensors become the core's channels in
`seatrial.flight.sensor_channels`, failures its rows in `seatrial.flight.failures`; legs, loops and
actuators are judged in `leg_figures` and `loop_figures`, in words in `flight_text`.
"""

from seatrial.flight.failures import Fault, Outage
from seatrial.flight.flight import Alert, Flight
from seatrial.flight.fly import fly
from seatrial.flight.fly_batch import fly_batch
from seatrial.flight.leg_figures import Leg
from seatrial.flight.loop_figures import ActuatorUse, Loop

__all__ = ["ActuatorUse", "Alert", "Fault", "Flight", "Leg", "Loop", "Outage", "fly", "fly_batch"]
