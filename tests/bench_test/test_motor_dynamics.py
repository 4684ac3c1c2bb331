"""Identification of a motor: what is told, what is not and is said so, both readings, actuators, errors."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import seatrial as st
from seatrial.bench_test.motor_estimate import MotorEstimate
from seatrial.bench_test.motor_identification import identify_motor
from seatrial.bench_test.motor_model import NAMES, MotorModel, StepRecord, recommended_steps
from seatrial.bench_test.motor_plateaus import noise_of, plateaus, starts, statics, transitions
from tests.bench_test.motor_steps import TABLE, TRUTH, designed, held, measured, rng, with_signal
from tests.report.figures import assert_legends_beside


@pytest.fixture(scope="module")
def record() -> StepRecord:
    return measured(TRUTH, designed(), rng())


@pytest.fixture(scope="module")
def motor(record: StepRecord) -> MotorEstimate:
    return identify_motor(record, start=TABLE)


def test_recommended_steps_determine_every_parameter(motor: MotorEstimate) -> None:
    assert [name for name, one in motor.parameters.items() if not one.determined] == []
    assert all(held(motor, TRUTH).values())
    assert motor.below_minimum == "lift"
    assert motor.converged
    assert motor.agreeing == motor.starts == 4


def test_steps_that_fall_on_samples_determine_every_parameter() -> None:
    t, command = recommended_steps(TABLE, stagger=False)
    assert np.abs(t[:-1] / 0.1 - np.rint(t[:-1] / 0.1)).max() < 1e-9
    motor = identify_motor(measured(TRUTH, (t, command), rng()))
    assert all(motor[name].determined for name in NAMES)
    assert all(held(motor, TRUTH).values())


def test_start_values_are_near_before_any_fit(record: StepRecord) -> None:
    noise = noise_of([record])
    assert noise.quantum == 5.0
    assert noise.sd == pytest.approx(6.0, rel=0.15)
    shown = statics(plateaus([record], noise), noise)
    assert shown.gain == pytest.approx(0.98, rel=0.005)
    assert shown.n_max == pytest.approx(TRUTH.n_max, rel=0.005)
    assert shown.n_min == pytest.approx(TRUTH.n_min, rel=0.05)
    assert {one.rate for one in transitions([record], shown, noise)} == {None, 7, 8, 9, 10}
    truth = TRUTH.coordinates()

    def cost(x: np.ndarray) -> float:
        model = MotorModel.from_coordinates(x)
        return float(np.abs(record.sampled[1] - model.response(record, record.sampled[0])).mean())

    best = starts([record], shown, noise, cost=cost, wanted=1)[0]
    # A quarter of a sample is the grid's step; ramps are known to its factors.
    assert abs(best[2] - truth[2]) <= 0.05
    assert best[1] == pytest.approx(truth[1], rel=0.5)
    assert best[7:] == pytest.approx(truth[7:], rel=0.5)


def test_vehicle_table_has_the_vehicle_files_keys(motor: MotorEstimate) -> None:
    table = motor.motor_table()
    assert set(table) == {
        *("maximum_ahead", "maximum_astern", "minimum_ahead", "minimum_astern", "below_minimum"),
        *("n_acc_per_s", "n_dec_per_s", "K_V", "T_1_s", "T_t_s"),
    }
    again = MotorModel.from_table(table)
    assert pytest.approx(TRUTH.K_V, rel=1e-3) == again.K_V
    # One rate limit for both directions lies between them.
    assert 1900.0 < again.n_acc[0] < 2100.0
    assert 3600.0 < again.n_dec[0] < 4200.0


def test_fitted_response_and_criteria(motor: MotorEstimate, record: StepRecord) -> None:
    error = np.asarray(record.measured) - motor.fitted(record)
    assert motor.fitness.absolute == pytest.approx(np.abs(error).mean())
    assert motor.fitness.absolute_integral == pytest.approx(
        np.trapezoid(np.abs(error), np.asarray(record.t_measured))
    )
    # 6 rpm of noise and the rounding to 5 rpm: a mean absolute error of sqrt(2/pi) of 6.2 rpm.
    assert motor.fitness.absolute == pytest.approx(4.9, rel=0.05)
    assert motor.fitness.r2 > 0.9999


def test_directions_that_differ_are_named_with_the_common_value(motor: MotorEstimate) -> None:
    differ = {pair.name: pair for pair in motor.directions if pair.differ}
    assert {"n_max", "n_acc", "n_dec"} <= set(differ)
    assert differ["n_acc"].sigma >= 0.5 * abs(differ["n_acc"].ahead - differ["n_acc"].astern)
    assert any("n_acc differs between the directions" in one for one in motor.sentences())


def test_like_directions_are_not_said_to_differ() -> None:
    even = replace(TRUTH, n_max=(1950.0, 1950.0), n_acc=(2000.0, 2000.0), n_dec=(4000.0, 4000.0))
    even = replace(even, n_min=(150.0, 150.0))
    tests = [
        pair.p
        for seed in range(6)
        for pair in identify_motor(measured(even, designed(), rng(seed))).directions
    ]
    # 24 tests at 5 %: more than four below 0.05 would happen once in a hundred times.
    assert len(tests) == 24
    assert sum(p < 0.05 for p in tests) <= 4


def test_dead_band_is_recognised_and_its_edge_bracketed() -> None:
    truth = replace(TRUTH, dead_band=True)
    motor = identify_motor(measured(truth, designed(), rng()), start=TABLE)
    assert motor.below_minimum == "zero"
    assert motor.below_minimum_ratio is not None
    assert motor.below_minimum_ratio > 2.0
    one = motor["n_min_ahead"]
    # The steps drop 135 and follow 195: nothing is known inside.
    assert (one.lower, one.upper) == (135.0, 195.0)
    assert one.sigma == pytest.approx(60.0 / math.sqrt(12.0))
    assert all(held(motor, truth).values())


def test_spikes_and_drop_outs_do_not_pull(record: StepRecord) -> None:
    values, generator = np.array(record.measured), rng(3)
    spikes, lost = generator.random(len(values)) < 0.03, generator.random(len(values)) < 0.2
    seen = np.count_nonzero(spikes & ~lost & (np.abs(values) > 100.0))
    values[spikes] = 0.0
    values[lost] = np.nan
    spoilt = with_signal(record, values)
    motor = identify_motor(spoilt)
    assert all(held(motor, TRUTH).values())
    assert len(motor.fitted(spoilt)) == len(values)
    plain = identify_motor(spoilt, robust="none")
    # Of the spikes where the motor turns at more than 100 rpm, all but some in longer runs are left out.
    assert seen - 3 <= motor.left_out <= seen + 1
    assert motor.left_out + motor.fitness.samples == np.isfinite(values).sum()
    assert abs(motor["K_V"].value - 0.98) < 0.2 * abs(plain["K_V"].value - 0.98)  # type: ignore[operator]


def test_data_without_noise_give_the_motor_back() -> None:
    motor = identify_motor(measured(TRUTH, designed(), rng(), noise=0.0, quantum=0.0))
    for name, one in motor.parameters.items():
        # The search ends at a relative cost of 1e-9 of a cost that is itself nearly nothing.
        assert one.value == pytest.approx(TRUTH.parameters()[name], rel=1e-4), name
    assert motor.left_out == 0


def test_commands_and_measurements_may_share_one_table(record: StepRecord) -> None:
    # A log with one row per message: NaN where the other one spoke.
    t, at = np.asarray(record.t), np.asarray(record.t_measured)
    rows = np.union1d(t, at)
    command, shown = np.full(len(rows), np.nan), np.full(len(rows), np.nan)
    command[np.searchsorted(rows, t)] = record.command
    shown[np.searchsorted(rows, at)] = record.measured
    joined = identify_motor(StepRecord(rows, command, shown, "SbU"))
    assert joined["T_t"].value == pytest.approx(identify_motor(record)["T_t"].value, rel=1e-3)


def test_odd_actuator_of_a_group_is_named() -> None:
    records = [measured(TRUTH, designed(), rng(k), name=name) for k, name in enumerate(("SbU", "SbL", "PU"))]
    alike = identify_motor(records)
    assert alike.actuators == ("SbU", "SbL", "PU")
    assert alike.differing == ()
    odd = measured(replace(TRUTH, T_1=0.2), designed(), rng(9), name="PL")
    found = identify_motor([*records, odd])
    assert {one.actuator for one in found.differing} == {"PL"}
    assert "T_1" in {one.name for one in found.differing}
    assert any(one.startswith("PL differs from its group in T_1") for one in found.sentences())


def test_several_records_of_one_actuator_are_one_estimate(motor: MotorEstimate, record: StepRecord) -> None:
    second = measured(TRUTH, designed(), rng(2))
    both = identify_motor([record, second])
    assert both.actuators == ("SbU",)
    assert (both["T_t"].sigma or 1.0) < (motor["T_t"].sigma or 0.0)


def test_record_that_starts_in_motion_loses_its_first_transient(record: StepRecord) -> None:
    # The log begins with the step to 1800 rpm: the command before it was not logged.
    t, at = np.asarray(record.t), np.asarray(record.t_measured)
    first = int(np.flatnonzero(np.asarray(record.command) == 1800.0)[0])
    cut = StepRecord(
        t[first:], np.asarray(record.command)[first:], np.asarray(record.measured), "SbU", t_measured=at
    )
    motor = identify_motor(cut)
    assert motor.trimmed == ("SbU",)
    assert any("starts in motion" in one for one in motor.sentences())
    assert all(held(motor, TRUTH).values())
    assert identify_motor(record).trimmed == ()


def test_what_the_chain_leaves_out_is_noticed(record: StepRecord) -> None:
    at = np.asarray(record.t_measured)
    motor = identify_motor(with_signal(record, np.asarray(record.measured) + 60.0 * np.sin(2.0 * at)))
    assert any("times the measurement's own noise" in one for one in motor.sentences())


def test_results_are_plain_json(motor: MotorEstimate) -> None:
    told = json.loads(json.dumps(motor.to_dict(), allow_nan=False))
    assert told["parameters"]["T_t"]["value"] == motor["T_t"].value
    assert told["sentences"] == list(motor.sentences())
    assert len(told["parameters"]) == 11


@pytest.mark.parametrize("robust", ["soft_l1", "none"])
def test_losses_agree_on_clean_data(record: StepRecord, motor: MotorEstimate, robust: str) -> None:
    other = identify_motor(record, robust=robust)  # type: ignore[arg-type]
    for name, one in motor.parameters.items():
        assert abs((other[name].value or 0.0) - (one.value or 0.0)) < 1.5 * (one.sigma or 0.0)


def test_chain_of_the_simulation_gives_the_vehicle_file_back() -> None:
    # Another path through the core: the motor that advances step by step (`actuator/motor.rs`).
    vehicle = st.Vehicle.load("cwolf")
    t, command = recommended_steps(TABLE, stagger=False)
    at = np.arange(0.0, t[-1], 0.1)
    asked = command[np.searchsorted(t, at + 1e-9, side="right") - 1]
    run = vehicle.simulate(at, {"SbU": asked}, free="")
    shown = np.asarray(run.actuators["SbU"]) + 6.0 * rng().normal(size=len(at))
    motor = identify_motor(StepRecord(at, asked, 5.0 * np.round(shown / 5.0), "SbU"), start=TABLE)
    table = TABLE | {"T_t_s": 0.1, "T_1_s": 0.15}
    assert all(held(motor, MotorModel.from_table(table)).values())
    assert all(one.determined for one in motor.parameters.values())


def test_figure_marks_dead_time_and_lag(motor: MotorEstimate, record: StepRecord) -> None:
    from seatrial.report.plot.bench import motor_step

    figure = motor_step(motor, record)
    assert len(figure.axes) == 4
    assert_legends_beside(figure)
    texts = [text.get_text() for axes in figure.axes[2:] for text in axes.texts]
    assert texts == [f"$T_t$ = {motor.model.T_t:.3f} s", f"$T_1$ = {motor.model.T_1:.3f} s"] * 2
