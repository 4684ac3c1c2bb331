"""Steps of a loop in the closed loop: sums of the core against those of the log, candidates, paths."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from seatrial.control_design.tuning_table import LOOPS
from seatrial.tuning.criterion import criterion, time_weighted_error, violations
from seatrial.tuning.objective import violated
from seatrial.tuning.step_trial import CHANNELS, PATHS, LoopTrials, Samples
from tests.tuning.tuning_campaigns import rig, start, still, trials

Array = NDArray[np.float64]

PERIOD_S = 0.1
SUMMED = 1e-9
"""Relative: the same hundreds of terms, added up in another order."""


def from_responses(of: LoopTrials, t: Array, y: Array) -> Array:
    """Area outside, s, and time-weighted error, s^2, of an answer (p,): to the step, and back in a mirror."""
    total = np.zeros(2)
    for begin, back in ((of.settle_s, False), (of.settle_s + of.until_s, True)):
        rows = (t > begin - 1e-6) & (t < begin + of.until_s - 1e-6)
        answer = 1.0 - y[rows] if back else y[rows]
        below, above = violations(t[rows] - begin, answer, of.corridor)
        late = time_weighted_error(t[rows] - begin, answer, of.corridor)
        total += np.array([below + above, late])
    return total


@pytest.mark.parametrize(
    ("loop", "speed", "size"),
    [
        ("surge", 1.0, -0.4),
        ("heave", 0.5, 0.5),
        ("pitch", 1.5, 0.15),
        ("heading", 1.5, -0.3),
        ("depth", 1.5, 1.0),
        ("cross_track", 1.5, -1.0),
    ],
)
def test_the_core_adds_up_what_the_criterion_says_of_the_log(loop: str, speed: float, size: float) -> None:
    one = trials(loop, (speed,), (size,))
    samples = Samples({"X_uu": np.array([-20.0, -30.0])}, np.array([[0.0] * 3, [0.0, 0.1, 0.0]]), (1, 2))
    here = rig("typical")
    sums, *_ = here.violations(one, samples, {})
    t, answers = here.responses(one, samples, {})
    assert sums.shape == (1, 1, 2, 1, 3)
    assert t[1] - t[0] == pytest.approx(PERIOD_S)
    for sample in range(2):
        y = (answers[one.names[0]][0, sample] - one.base(0)) / size
        below, above, late = sums[0, 0, sample, 0]
        np.testing.assert_allclose([below + above, late], from_responses(one, t, y), rtol=SUMMED)
        # Two per cent are left to the answer and five seconds: it is far outside, so the sums say something.
        assert below + above > 0.1


@pytest.mark.parametrize("until_s", [12.24, 12.26, 12.3])
def test_a_corridor_need_not_end_with_a_control_period(until_s: float) -> None:
    one, steps = rig(), trials(until_s=until_s)
    t, answers = one.responses(steps, still(), {})
    assert len(t) == answers["yaw"].shape[-1]
    # The flight goes on to the end of the period in which its time is up, and no further.
    assert steps.duration_s <= t[-1] + 1e-9 < steps.duration_s + one.autopilot.period_s
    assert np.isfinite(answers["yaw"]).all()


def test_law_a_candidate_does_not_know_its_neighbours() -> None:
    one = trials("heading", (1.0, 3.0), (0.3, -0.3))
    samples = Samples({}, np.array([[0.0] * 3, [0.1, 0.0, 0.0]]), (1, 2))
    names = ("heading.K_P.4", "heading.K_P.5", "heading.K_D.5")
    values = start().gains()
    gains = {name: values[name] * np.array([0.5, 1.0, 2.0, 4.0]) for name in names}
    together, travel, _ = rig("typical").violations(one, samples, gains)
    for k in (1, 3):
        # Two abreast and not one: a single flight rounds the last digits otherwise.
        pair = {name: each[[k, 0]] for name, each in gains.items()}
        alone, moved, _ = rig("typical").violations(one, samples, pair)
        np.testing.assert_array_equal(alone[0], together[k])
        np.testing.assert_array_equal(moved[0], travel[k])
    # The gains do reach the flights.
    assert len(np.unique(together[:, 0, 0, 0, 0])) == 4


def test_law_bounds_of_the_way_back_are_a_mirror_of_those_there() -> None:
    one = trials()
    lower, upper, target, clock = one.bounds(PERIOD_S)
    settle, until = round(one.settle_s / PERIOD_S), round(one.until_s / PERIOD_S)
    there, back = slice(settle, settle + until), slice(settle + until, settle + 2 * until)
    np.testing.assert_allclose(lower[back], 1.0 - upper[there], atol=1e-12)
    np.testing.assert_allclose(upper[back], 1.0 - lower[there], atol=1e-12)
    np.testing.assert_allclose(clock[back], clock[there], atol=1e-9)
    assert (target[there] == 1.0).all()
    assert (target[back] == 0.0).all()
    # Before the first step and in the period of the end nothing is assessed.
    for rows in (slice(0, settle), slice(settle + 2 * until, None)):
        assert (lower[rows] == -np.inf).all()
        assert (upper[rows] == np.inf).all()
        assert (clock[rows] == 0.0).all()
    assert len(lower) == len(one.grid(PERIOD_S)) == settle + 2 * until + 1


def test_a_headroom_moves_both_bounds_inwards_and_never_past_each_other() -> None:
    one = trials()
    wide, tight = one.bounds(PERIOD_S), one.bounds(PERIOD_S, headroom=0.01)
    bounded = np.isfinite(wide[0])
    np.testing.assert_allclose(tight[0][bounded] - wide[0][bounded], 0.01, atol=1e-12)
    np.testing.assert_allclose(wide[1][bounded] - tight[1][bounded], 0.01, atol=1e-12)
    most = one.bounds(PERIOD_S, headroom=5.0)
    assert (most[1][bounded] > most[0][bounded]).all()


def test_the_answer_to_the_step_back_is_that_of_the_step_in_a_mirror() -> None:
    one = trials("heading", rise_s=2.0, until_s=25.0)
    _, answers = rig().responses(one, still(), {})
    y = answers["yaw"][0, 0] / one.sizes[0]
    settle, until = round(one.settle_s / PERIOD_S), round(one.until_s / PERIOD_S)
    there, back = y[settle : settle + until], 1.0 - y[settle + until : settle + 2 * until]
    # Port and starboard alike, but for a step that has not settled to the last per cent when it turns back.
    np.testing.assert_allclose(back, there, atol=0.05)


def test_channels_beside_are_held_about_their_set_points() -> None:
    one = trials("heading", (1.5,), (0.5,), beside={"z": 0.02, "u": 0.05, "roll": 0.01})
    sums, *_ = rig("typical").violations(one, still(), {})
    t, answers = rig("typical").responses(one, still(), {})
    assert sums.shape == (1, 1, 1, 4, 3)
    after = (t > one.settle_s - 1e-6) & (t < one.settle_s + 2.0 * one.until_s - 1e-6)
    for place, (name, half) in enumerate(one.beside.items(), start=1):
        level = {"z": 100.0, "u": 1.5, "roll": 0.0}[name]
        y = (answers[name][0, 0, after] - level) / half
        expected = [np.maximum(-1.0 - y, 0.0).sum(), np.maximum(y - 1.0, 0.0).sum()]
        np.testing.assert_allclose(
            sums[0, 0, 0, place, :2], PERIOD_S * np.array(expected), rtol=SUMMED, atol=1e-12
        )
    assert sums[0, 0, 0, 1:, :2].sum() > 0.01


@pytest.mark.parametrize("loop", PATHS)
def test_a_path_is_stepped_by_moving_the_plan(loop: str) -> None:
    one = trials(loop, (1.5, 2.5), (2.0, -2.0), until_s=45.0)
    t, answers = rig().responses(one, still(), {})
    place = answers[CHANNELS[loop][1]]
    moved = place - one.base(0)
    assert np.abs(moved[:, 0, t < one.settle_s]).max() < 0.2
    end = t > one.settle_s + one.until_s - 1.0
    for trial, size in enumerate(one.sizes):
        # The start gains overshoot by a quarter and have not settled to more than that when it ends.
        there = moved[trial, 0, end & (t < one.settle_s + one.until_s)]
        assert there.mean() == pytest.approx(size, abs=0.25 * abs(size)), (loop, trial)
        assert moved[trial, 0, -1] == pytest.approx(0.0, abs=0.25 * abs(size)), (loop, trial)


def test_a_diverged_answer_violates_without_end() -> None:
    sums, *_ = rig().violations(trials(), still(2, X_uu=[-20.0, 400.0]), {})
    assert np.isfinite(sums[0, 0, 0]).all()
    assert np.isinf(sums[0, 0, 1, 0]).all()


def test_every_loop_with_a_set_point_has_a_channel_and_a_unit() -> None:
    assert set(LOOPS) - set(CHANNELS) == {"roll"}
    for loop in CHANNELS:
        assert trials(loop).names[0] == {"cross_track": "y"}.get(loop, LOOPS[loop].channel)


def test_samples_are_taken_from_the_front() -> None:
    samples = still(3, X_uu=[-1.0, -2.0, -3.0])
    first = samples.of(range(2))
    assert len(first) == 2
    assert first.seeds == (1, 2)
    assert first.coefficients["X_uu"].tolist() == [-1.0, -2.0]
    assert first.current.shape == (2, 3)


def test_the_band_of_settling_is_that_of_the_corridor_s_end() -> None:
    assert trials().settled == pytest.approx(0.02)


def test_weights_of_the_sides_make_the_criterion() -> None:
    one = trials("heading", rise_s=2.0, weight_upper=3.0)
    sums, *_ = rig().violations(one, still(), {})
    t, answers = rig().responses(one, still(), {})
    y = answers["yaw"][0, 0] / one.sizes[0]
    total = 0.0
    for begin, back in ((one.settle_s, False), (one.settle_s + one.until_s, True)):
        rows = (t > begin - 1e-6) & (t < begin + one.until_s - 1e-6)
        total += float(criterion(t[rows] - begin, 1.0 - y[rows] if back else y[rows], one.corridor))
    assert violated(one, sums)[0, 0, 0] == pytest.approx(total, rel=SUMMED)


@pytest.mark.parametrize(("loop", "size"), [("surge", 0.4), ("heading", -0.3), ("cross_track", 2.0)])
def test_the_offset_is_the_mean_of_the_log_at_rest(loop: str, size: float) -> None:
    one = trials(loop, (1.5,), (size,))
    *_, offset = rig("typical").violations(one, still(), {})
    t, answers = rig("typical").responses(one, still(), {})
    y = (answers[one.names[0]][0, 0] - one.base(0)) / size
    since = t - one.settle_s
    ends = [
        (since > at + 0.75 * one.until_s - 1e-9) & (since < at + one.until_s - 1e-9)
        for at in (0.0, one.until_s)
    ]
    expected = max(abs(float(np.mean(y[ends[0]])) - 1.0), abs(float(np.mean(y[ends[1]]))))
    assert offset.shape == (1, 1, 1)
    assert offset[0, 0, 0] == pytest.approx(expected, rel=1e-9)
