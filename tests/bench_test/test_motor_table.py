"""What is written of a motor follows its own records; what they only bound is not written as known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from seatrial.bench_test.motor_estimate import MotorEstimate, MotorParameter, written_motor
from seatrial.bench_test.motor_identification import identify_motor
from seatrial.bench_test.motor_model import MotorModel, StepRecord
from tests.bench_test.motor_steps import TABLE, TRUTH, designed, measured, rng, steps_of, with_signal

FREE = replace(TRUTH, n_min=(0.0, 0.0), n_max=(math.inf, math.inf))


def written_r2(motor: MotorEstimate, record: StepRecord, start: dict[str, float]) -> float:
    """R² of the motor that the vehicle file holds after merging."""
    at, shown = record.sampled
    error = shown - MotorModel.from_table(start | motor.motor_table()).response(record, at)
    return 1.0 - float(np.sum(error**2) / np.sum((shown - shown.mean()) ** 2))


def test_a_rate_that_is_only_bounded_is_not_written_as_the_motor_s() -> None:
    # Growth at 2000 rpm/s is known; of shrinking the records say "at least 475 rpm/s", far below the truth.
    truth = MotorModel(1.0, 0.1, 0.1, n_acc=(2000.0, 2000.0), n_dec=(2000.0, 2000.0))
    record = measured(truth, steps_of(*(0.0, 1500.0, 600.0, 1800.0) * 4), rng())
    motor = identify_motor(record)
    bounded = {
        name: replace(one, value=None, sigma=None, lower=None, upper=None, reason="", at_least=475.0)
        for name, one in motor.parameters.items()
        if name.startswith("n_dec")
    }
    written = written_motor(dict(motor.parameters) | bounded, (), None, (record,), {})
    assert "n_dec_per_s" not in written.table
    assert written.r2 > 0.999
    assert written.least is None


@pytest.mark.parametrize("start", [{}, TABLE])
def test_the_written_motor_follows_its_records_as_the_fit_does(start: dict[str, float]) -> None:
    for truth in (FREE, replace(FREE, n_dec=(math.inf, math.inf)), replace(FREE, n_acc=(math.inf, math.inf))):
        record = measured(truth, designed(), rng())
        motor = identify_motor(record, start=start or None)
        found = written_r2(motor, record, start)
        assert found == pytest.approx(motor.written.r2, abs=1e-3)
        if not start:
            assert motor.fitness.r2 - found < 1e-3


def test_a_file_s_limit_that_does_not_suit_is_named_with_both_scores() -> None:
    start = TABLE | {"maximum_ahead": 1000.0}
    motor = identify_motor(measured(FREE, steps_of(*(0.0, 900.0, 1500.0, 300.0) * 4), rng()), start=start)
    assert motor.fitness.r2 > 0.999
    assert motor.written.r2 < 0.95
    assert any("The motor as written to the vehicle file" in text for text in motor.sentences())


@pytest.mark.parametrize("sizes", [(1500.0,), (1000.0, 1500.0)])
def test_a_gain_that_differs_by_three_per_cent_is_no_limit(sizes: tuple[float, ...]) -> None:
    commands = [c for size in sizes for c in (0.0, size, 0.0, -size)] * 3
    record = measured(replace(FREE, K_V=1.0), steps_of(*commands), rng())
    shown = np.asarray(record.measured)
    motor = identify_motor(with_signal(record, np.where(shown < 0.0, 0.97 * shown, shown)), start=TABLE)
    assert not {"maximum_ahead", "maximum_astern"} & set(motor.motor_table())
    assert not motor["n_max_astern"].determined
    assert motor["K_V"].value == pytest.approx(0.985, abs=0.01)


def test_no_interval_is_given_where_the_chain_misses_the_motor() -> None:
    record = measured(FREE, steps_of(*(0.0, 1000.0, -1000.0, 500.0) * 5), rng(), noise=0.5, quantum=0.0)
    at, shown = record.sampled
    # Every other round of commands the motor follows 12 % further.
    wobbling = with_signal(record, shown * (1.0 + 0.12 * (np.floor(at / 12.0) % 2.0)))
    motor = identify_motor(wobbling, start=TABLE)
    assert motor.fitness.misfit is not None
    assert motor.fitness.misfit > 20.0
    for one in motor.parameters.values():
        assert one.sigma is None
        assert one.lower is None
        assert "±" not in one.sentence()
    assert "no interval: the errors are" in motor["K_V"].sentence()
    assert motor.motor_table()["K_V"] == pytest.approx(0.98, rel=0.15)


def test_a_time_below_what_a_logger_shows_is_said_to_be_zero() -> None:
    one = MotorParameter("T_1", "s", 0.0, 1.3e-7, 0.0, 2.6e-7, math.inf)
    assert one.sentence() == "T_1 is zero to 0.001 s."
