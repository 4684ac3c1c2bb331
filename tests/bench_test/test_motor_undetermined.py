"""What a step test cannot tell of a motor is said, not guessed; records that tell nothing are refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from seatrial.base.errors import TrialError, VehicleError
from seatrial.bench_test.motor_identification import identify_motor
from seatrial.bench_test.motor_model import NAMES, MotorModel, StepRecord, recommended_steps
from tests.bench_test.motor_steps import TABLE, TRUTH, designed, held, measured, rng, steps_of, with_signal


@pytest.fixture(scope="module")
def record() -> StepRecord:
    return measured(TRUTH, designed(), rng())


def test_direction_that_was_not_driven_keeps_the_vehicles() -> None:
    motor = identify_motor(measured(TRUTH, steps_of(*(0.0, 1000.0) * 10), rng()), start=TABLE)
    for limit in ("n_min", "n_max", "n_acc", "n_dec"):
        one = motor[f"{limit}_astern"]
        assert one.value is None
        assert "no command astern" in one.reason
        assert one.kept == MotorModel.from_table(TABLE).parameters()[one.name]
    assert motor["n_max_ahead"].at_least == 1000.0
    assert motor["n_min_ahead"].at_most == 1000.0
    assert set(motor.motor_table()) == {"K_V", "T_1_s", "T_t_s", "n_acc_per_s", "n_dec_per_s"}
    assert any("commands of one magnitude" in one for one in motor.sentences())
    assert all(held(motor, TRUTH).values())


def test_rate_limit_that_never_binds_is_not_determined() -> None:
    truth = replace(TRUTH, n_acc=(math.inf, math.inf), n_dec=(math.inf, math.inf))
    motor = identify_motor(measured(truth, designed(), rng()), start=TABLE)
    for name in NAMES[7:]:
        assert motor[name].value is None
        assert motor[name].contradicted
    assert "n_acc_per_s" not in motor.motor_table()
    assert motor["T_1"].value == pytest.approx(0.15, rel=0.02)


def test_rate_limit_of_one_kind_is_not_written_for_the_other() -> None:
    # The file lets an absent n_dec_per_s follow n_acc_per_s, but this motor shrinks without a limit.
    truth = replace(TRUTH, n_dec=(math.inf, math.inf))
    motor = identify_motor(measured(truth, designed(), rng()))
    table = motor.motor_table()
    assert float(table["n_acc_per_s"]) < 2200.0
    assert float(table["n_dec_per_s"]) > 50_000.0
    assert any("n_dec_per_s is written as" in one for one in motor.sentences())


def test_steps_too_small_for_the_rate_limit_say_so() -> None:
    motor = identify_motor(measured(TRUTH, steps_of(*(1000.0, 1060.0) * 10), rng()), start=TABLE)
    assert not motor["n_acc_ahead"].determined
    assert "kept" in motor["n_acc_ahead"].sentence()
    assert motor.model.n_acc[0] == 2000.0
    assert all(held(motor, TRUTH).values())


def test_no_lag_has_an_interval_that_ends_at_zero() -> None:
    truth = replace(TRUTH, T_1=0.0)
    motor = identify_motor(measured(truth, designed(), rng()), start=TABLE)
    assert motor["T_1"].lower == 0.0
    assert motor["T_1"].upper is not None
    assert motor["T_1"].upper < 0.05
    assert held(motor, truth)["T_t"]


def test_curved_motor_is_not_taken_for_one_with_limits() -> None:
    # Three per cent less per command at 1500 rpm than at rest: no plateau shares its level with another.
    free = replace(TRUTH, n_min=(0.0, 0.0), n_max=(math.inf, math.inf))
    commands = [sign * size for sign in (1.0, -1.0) for size in (200.0, 500.0, 800.0, 1100.0, 1500.0, 0.0)]
    straight = measured(free, steps_of(0.0, *commands, *commands), rng())
    values = np.asarray(straight.measured)
    motor = identify_motor(with_signal(straight, values * (1.0 - 0.03 * (values / 1500.0) ** 2)))
    assert motor.below_minimum is None
    assert not motor["n_min_ahead"].determined
    assert motor["T_t"].value == pytest.approx(TRUTH.T_t, abs=0.01)


def test_bad_records_are_refused_with_a_sentence(record: StepRecord) -> None:
    t, command = steps_of(0.0, 500.0, 0.0)
    at = np.arange(0.0, 9.0, 0.1)
    shown = np.where((at > 3.2) & (at < 6.2), 500.0, 0.0)
    good = StepRecord(t, command, shown, "SbU", t_measured=at)
    with pytest.raises(TrialError, match="turn against the command"):
        identify_motor(with_signal(record, -np.asarray(record.measured)))
    with pytest.raises(TrialError, match="have no sign"):
        identify_motor(with_signal(record, np.abs(np.asarray(record.measured))))
    with pytest.raises(TrialError, match="500 throughout"):
        identify_motor(replace(good, command=np.full(4, 500.0)))
    with pytest.raises(TrialError, match="do not follow the command"):
        identify_motor(with_signal(good, np.zeros(len(at))))
    with pytest.raises(TrialError, match="long enough"):
        identify_motor(StepRecord(at, np.resize([0.0, 500.0], len(at)), shown))
    with pytest.raises(TrialError, match="too short"):
        StepRecord(t, command, shown[:5], t_measured=at[:5])
    with pytest.raises(TrialError, match="one clock"):
        identify_motor(replace(good, t=t + 8.0))
    with pytest.raises(TrialError, match="t does not rise at row 1"):
        replace(good, t=t[::-1])
    with pytest.raises(TrialError, match="command has 3 samples"):
        replace(good, command=command[:3])
    with pytest.raises(TrialError, match="infinite in row 2"):
        with_signal(good, np.where(at == at[2], math.inf, shown))
    with pytest.raises(TrialError, match="no command is a number"):
        replace(good, command=np.full(4, math.nan))
    with pytest.raises(TrialError, match="is no loss"):
        identify_motor(good, robust="cauchy")  # type: ignore[arg-type]
    with pytest.raises(TrialError, match="at least one step record"):
        identify_motor([])
    with pytest.raises(VehicleError, match="maximum_ahead"):
        recommended_steps({})
    with pytest.raises(VehicleError, match="sample_s"):
        recommended_steps(TABLE, sample_s=0.0)
