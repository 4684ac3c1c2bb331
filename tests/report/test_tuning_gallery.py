"""Figures of a tuning: which are drawn, which trial they show, the staircase of speeds."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import seatrial as st
from seatrial.control_design.tuning_table import TuningTable
from seatrial.identification.fitted import Fitted
from seatrial.report.plot.corridors import course_of_set_points, speed_steps
from seatrial.report.plot.tuning import corridors, responses
from seatrial.tuning.control_problem import ControlProblem
from seatrial.tuning.result import Performance, StepPerformance, assess
from tests.tuning.tuning_campaigns import plan, start

SURGE = """
[tuning]
samples = 2
sensors = "perfect"
settle_s = 6.0
[tuning.loops.surge]
steps = [0.3, -0.3]
speeds_m_s = [1.5, 2.5]
corridor = { rise_s = 2.0, overshoot = 0.02, settling_s = 9.0, settled = 0.02, until_s = 12.0 }
"""


@cache
def performance(name: str, factor: float) -> Performance:
    one = plan(SURGE)
    gains = {key: factor * value for key, value in start().gains().items() if key.startswith("surge.K_P")}
    return assess(
        one, name, one.rig(start().with_gains(gains), max_step_s=0.05, threads=1), one.samples(2, 1)
    )


def test_a_loop_s_corridors_show_start_beside_tuned_at_every_speed() -> None:
    before, after = performance("start", 1.0), performance("tuned", 2.0)
    (figure,) = corridors(before, after, "surge")
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert len(titles) == 4
    assert titles[0].startswith("surge at 1.5 m/s, ")
    assert titles[0].endswith(": start gains")
    assert titles[1].endswith(": tuned")
    assert titles[0].partition(":")[0] == titles[1].partition(":")[0]
    # Side by side the heights compare.
    assert figure.axes[0].get_ylim() == figure.axes[1].get_ylim()
    # Three samples, there and back: the worst of six.
    texts = figure.axes[0].get_legend_handles_labels()[1]
    assert any(text.startswith("worst of 6 steps") for text in texts)


def test_corridors_at_many_speeds_take_several_pages() -> None:
    one = plan(SURGE.replace("[1.5, 2.5]", "[0.5, 1.0, 1.5, 2.5]"))
    gains = one.rig(start(), max_step_s=0.05, threads=1)
    found = assess(one, "start", gains, one.samples(1, 1))
    figures = list(corridors(found, found, "surge"))
    assert [len(figure.axes) for figure in figures] == [6, 2]
    assert max(figure.get_figheight() for figure in figures) <= 10.0


def test_titles_of_corridors_have_words_and_true_minus_signs() -> None:
    one = plan(SURGE.replace("loops.surge", "loops.cross_track").replace("[0.3, -0.3]", "[-3.0]"))
    found = assess(one, "start", one.rig(start(), max_step_s=0.05, threads=1), one.samples(1, 1))
    (figure,) = corridors(found, found, "cross_track")
    assert figure.axes[0].get_title(loc="left") == "cross-track at 1.5 m/s, −3 m: start gains"


def test_of_the_steps_at_a_speed_the_one_that_is_held_least_is_shown() -> None:
    before, after = performance("start", 1.0), performance("tuned", 2.0)
    worst: dict[float, StepPerformance] = {}
    for trial in after.trials:
        worst[trial.speed_m_s] = max(worst.get(trial.speed_m_s, trial), trial, key=lambda one: one.worst_s)
    figure = responses(before, after, "surge")
    for axes, speed in zip(figure.axes, sorted(worst), strict=True):
        sign = "+" if worst[speed].step > 0.0 else "\N{MINUS SIGN}"
        assert axes.get_title(loc="left") == f"surge at {speed:g} m/s, {sign}0.3 m/s"
        assert "start gains: outside by" in axes.get_title(loc="right")
        # The first step is at zero, its settling is cut.
        assert -5.0 <= axes.get_xlim()[0] < 0.0


def test_the_speed_climbs_and_falls_through_all_that_is_reached() -> None:
    one = plan(SURGE)
    times, levels = course_of_set_points(one)
    assert len(times) == len(levels) + 1
    assert (np.diff(times) >= 15.0).all()
    assert levels.max() == pytest.approx(0.9 * one.top_m_s)
    assert levels.min() == pytest.approx(-1.0)
    assert len(np.unique(levels)) >= 6
    figure = speed_steps(one, start(), start())
    (axes,) = figure.axes
    assert axes.get_ylabel() == "speed ahead u, m/s"
    assert axes.get_xlim()[1] == pytest.approx(times[-1], abs=0.2)
    # Set point, start gains and tuned; two times the same autopilot, so the same line.
    lines = [np.asarray(line.get_ydata(), float) for line in axes.get_lines()]
    assert len(lines) == 3
    np.testing.assert_array_equal(lines[1], lines[2])
    # At the end of each set point the speed is there.
    t = np.asarray(axes.get_lines()[1].get_xdata(), float)
    settled = np.interp(times[1:] - 0.5, t, lines[1])
    np.testing.assert_allclose(settled, levels, atol=0.2)


def test_a_hull_that_cannot_stop_keeps_to_its_breakpoints() -> None:
    lauv = ControlProblem.of_table(TuningTable(), Fitted.of("lauv"), st.Autopilot.load("lauv"))
    _, levels = course_of_set_points(lauv)
    assert levels.min() == pytest.approx(min(lauv.autopilot.speeds_m_s))


def test_angles_that_jump_round_the_circle_leave_a_gap() -> None:
    one = plan(SURGE.replace("surge", "heading").replace("[0.3, -0.3]", "[20.0]"))
    before = assess(one, "start", one.rig(start(), max_step_s=0.05, threads=1), one.samples(1, 1))
    turned = before.responses["heading"]
    spun = replace(
        before,
        responses={
            "heading": replace(
                turned,
                values=(turned.values + np.linspace(0.0, 20.0, len(turned.t)) + np.pi) % (2.0 * np.pi)
                - np.pi,
            )
        },
    )
    figure = responses(spun, before, "heading")
    for axes in figure.axes:
        for line in axes.get_lines():
            y = np.asarray(line.get_ydata(), float)
            steps = np.abs(np.diff(y))
            assert np.nanmax(steps, initial=0.0) < 180.0
