"""Bench tests: thrust from load-cell records, motor dynamics from steps of revolutions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.bench_test.motor_identification import identify_motor as identify_motor
    from seatrial.bench_test.motor_model import MotorModel as MotorModel
    from seatrial.bench_test.motor_model import StepRecord as StepRecord
    from seatrial.bench_test.motor_model import recommended_steps as recommended_steps

__all__ = ["MotorModel", "StepRecord", "identify_motor", "recommended_steps"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(
        __name__,
        {
            "MotorModel": "motor_model",
            "StepRecord": "motor_model",
            "identify_motor": "motor_identification",
            "recommended_steps": "motor_model",
        },
    )
