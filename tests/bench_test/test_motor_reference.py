"""The exact response of a motor against an independent integration in small steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seatrial.bench_test.motor_model import NAMES, MotorModel, StepRecord
from tests.bench_test.motor_steps import TRUTH, reference, steps_of

COMMANDS = (0.0, 80.0, 900.0, 950.0, -1700.0, -60.0, 2400.0, -2400.0, 0.0)


def worst(motor: MotorModel, step: float) -> float:
    t, command = steps_of(*COMMANDS, hold_s=0.9)
    at = np.arange(0.0, t[-1], 0.037)
    record = StepRecord(t, command, np.zeros(len(at)), t_measured=at)
    return float(np.abs(motor.response(record, at) - reference(motor, t, command, at, step)).max())


@pytest.mark.parametrize("motor", [TRUTH, replace(TRUTH, dead_band=True), replace(TRUTH, T_t=0.0, T_1=0.4)])
def test_response_agrees_with_small_steps(motor: MotorModel) -> None:
    # The ramp of the reference is late by up to a step, 4200 rpm/s times 1 ms; Euler's lag and the delay line
    # add as much. At half the step everything is half as large: the difference is the reference's.
    coarse, fine = worst(motor, 1e-3), worst(motor, 5e-4)
    assert coarse < 9.0
    assert fine < 0.6 * coarse


def test_coordinates_turn_back_into_the_motor() -> None:
    assert MotorModel.from_coordinates(TRUTH.coordinates()).parameters() == pytest.approx(TRUTH.parameters())
    assert tuple(TRUTH.parameters()) == NAMES


def test_no_rate_limit_is_coordinate_zero() -> None:
    x = MotorModel().coordinates()
    assert x[7:].tolist() == [0.0] * 4
    assert MotorModel.from_coordinates(x) == MotorModel()
