"""Motor dynamics: gain, lag, dead time and limits of a motor from its logged commands and revolutions."""

from seatrial.motor_dynamics.identify_motor import identify_motor
from seatrial.motor_dynamics.motor_estimate import MotorEstimate
from seatrial.motor_dynamics.recommended_steps import recommended_steps
from seatrial.motor_dynamics.step_record import StepRecord

__all__ = ["MotorEstimate", "StepRecord", "identify_motor", "recommended_steps"]
