"""Commands that answer what the log does not hold: a heading steered with a gyro that is not logged."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest

from seatrial.base.arrays import Array
from seatrial.estimation.instruments import answers
from seatrial.estimation.one_step import Errors, Span

DT, SAMPLES = 0.1, 12000
DAMPING, GAIN = 1.0, 0.8  # 1/s and 1/s2
NOISE, GUST = 0.01, 0.1  # rad of the compass, and rad/s2 over a sample


def sailed(own_gyro: bool, seed: int = 1) -> tuple[Array, Array]:
    """Command and measured heading (n,) of zigzags between two courses, steered by compass and rate.

    The rate is that of a gyro which is not logged, or what an observer makes of the logged heading.
    """
    generator = np.random.default_rng(seed)
    compass = NOISE * generator.standard_normal(SAMPLES)
    gusts = GUST * generator.standard_normal(SAMPLES)
    rudder_noise = 0.002 * generator.standard_normal(SAMPLES)
    heading, rate, seen, turning = 0.0, 0.0, 0.0, 0.0
    commands, measured = np.zeros(SAMPLES), np.zeros(SAMPLES)
    for k in range(SAMPLES):
        measured[k] = heading + compass[k]
        missed = measured[k] - seen - turning * DT
        seen, turning = seen + turning * DT + 0.3 * missed, turning + 0.06 * missed / DT
        course = 0.5 if k // 300 % 2 else -0.5
        commands[k] = 1.2 * (course - measured[k]) - 2.0 * (rate if own_gyro else turning) + rudder_noise[k]
        commands[k] = np.clip(commands[k], -0.3, 0.3)
        heading += DT * rate
        rate += DT * (GAIN * commands[k] - DAMPING * rate + gusts[k])
    return commands, measured


def foretold(commands: Array, measured: Array, gain: float) -> tuple[Errors, Array]:
    """Errors of a steady Kalman filter one sample ahead, slopes by the gain, and the rates that it knew."""
    transition = np.array([[1.0, DT], [0.0, 1.0 - DT * DAMPING]])
    spread, drive = np.eye(2), np.diag([1e-14, (GUST * DT) ** 2])
    for _ in range(500):
        moved = transition @ spread @ transition.T + drive
        kalman = moved[:, 0] / (moved[0, 0] + NOISE**2)
        spread = moved - np.outer(kalman, moved[0])
    state, slope = np.array([measured[0], 0.0]), np.zeros(2)
    error, slopes, rates = np.zeros(SAMPLES - 1), np.zeros(SAMPLES - 1), np.zeros(SAMPLES)
    for k in range(SAMPLES - 1):
        state = transition @ state + [0.0, DT * gain * commands[k]]
        slope = transition @ slope + [0.0, DT * commands[k]]
        error[k], slopes[k] = measured[k + 1] - state[0], slope[0]
        state, slope = state + kalman * error[k], slope - kalman * slope[0]
        rates[k + 1] = state[1]
    one = error[:, None], np.ones((SAMPLES - 1, 1), bool), slopes[:, None, None]
    return Errors(cast(Span, None), *one, one[2]), rates[:, None]


def estimated(errors: Errors) -> float:
    """The gain that the instruments give, from errors and slopes at its true value."""
    known, slope = errors.instrument[:, 0, 0], errors.slope[:, 0, 0]
    return GAIN + float(known @ errors.error[:, 0] / (known @ slope))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_controller_with_a_gyro_that_is_not_logged_is_found_and_bends_the_gain(seed: int) -> None:
    commands, measured = sailed(own_gyro=True, seed=seed)
    errors, rates = foretold(commands, measured, GAIN)
    told = answers([commands[:, None]], ["commands rudder"], [errors], [rates])
    assert told.names == ("commands rudder",)
    assert told.sure[0] > 20.0
    assert estimated(errors) < 0.96 * GAIN
    assert estimated(told.freed([errors])[0]) == pytest.approx(GAIN, rel=0.03)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_controller_that_uses_what_is_logged_is_none(seed: int) -> None:
    commands, measured = sailed(own_gyro=False, seed=seed)
    errors, rates = foretold(commands, measured, GAIN)
    told = answers([commands[:, None]], ["commands rudder"], [errors], [rates])
    assert told.names == ()
    assert estimated(errors) == pytest.approx(GAIN, rel=0.02)


def test_steps_that_nobody_steers_and_commands_that_stand_still_are_none() -> None:
    _, measured = sailed(own_gyro=True)
    steps = np.repeat(np.random.default_rng(4).choice([-0.2, 0.2], SAMPLES // 50), 50)
    errors, rates = foretold(steps, measured, GAIN)
    driving = np.stack([steps, np.full(SAMPLES, 1200.0)], axis=1)
    assert answers([driving], ["commands rudder", "commands propeller"], [errors], [rates]).names == ()


def test_both_halves_of_a_rudder_are_named_once() -> None:
    commands, measured = sailed(own_gyro=True)
    errors, rates = foretold(commands, measured, GAIN)
    both = np.stack([commands, commands], axis=1)
    told = answers([both], ["commands lower", "commands upper"], [errors], [rates])
    assert told.names == ("commands lower",)


def test_a_log_that_is_too_short_tells_nothing() -> None:
    commands, measured = sailed(own_gyro=True)
    errors, rates = foretold(commands, measured, GAIN)
    slope = errors.slope[:200]
    short = Errors(errors.span, errors.error[:200], errors.counted[:200], slope, slope)
    assert answers([commands[:201, None]], ["commands rudder"], [short], [rates[:201]]).names == ()


@pytest.mark.parametrize("own_gyro", [True, False])
def test_a_loop_spread_over_many_thrusters_is_found_by_all_of_them_together(own_gyro: bool) -> None:
    """Each of six thrusters has other tasks besides, and tells too little alone."""
    commands, measured = sailed(own_gyro)
    errors, rates = foretold(commands, measured, GAIN)
    spread = commands[:, None] + 0.1 * np.random.default_rng(1).standard_normal((SAMPLES, 6))
    names = [f"commands {k}" for k in range(6)]
    told = answers([spread], names, [errors], [rates])
    assert bool(told.names) == own_gyro
    assert max(told.sure, default=0.0) < 10.0
    assert min(told.sure, default=4.0) > 3.0
