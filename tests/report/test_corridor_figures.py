"""Figures of corridors and step responses: they show what is outside, and can be printed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from seatrial.base.errors import SimulationError
from seatrial.control_design.corridor import Corridor
from seatrial.report.plot.corridors import (
    Course,
    InCorridor,
    SetPointStep,
    corridor_figure,
    step_responses,
    worst_response,
)
from seatrial.tuning.criterion import violations
from tests.control_design.test_corridor import SURGE, Array, T, second_order
from tests.report.figures import assert_legends_beside, assert_on_page, line, panel, texts

BUNDLE = np.array([second_order(T, damping, 0.25) for damping in (0.7, 0.3, 0.5)])


def outside(axes: Axes, word: str) -> PolyCollection:
    """The filled area of a side."""
    found = [one for one in axes.collections if str(one.get_label()).startswith(word)]
    assert len(found) == 1
    assert isinstance(found[0], PolyCollection)
    return found[0]


def size(area: PolyCollection) -> float:
    """Area of the polygons, by the shoelace formula."""
    total = 0.0
    for path in area.get_paths():
        x, y = path.vertices.T  # type: ignore[union-attr]
        total += 0.5 * abs(float(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1))))
    return total


def test_what_is_filled_is_what_the_criterion_adds_up() -> None:
    figure = corridor_figure([InCorridor("surge", SURGE, T, BUNDLE[1], remark="start gains")])
    assert_on_page(figure)
    axes = panel(figure, "surge")
    for word, area in zip(("below", "above"), violations(T, BUNDLE[1], SURGE), strict=True):
        # The sum over periods of 0.1 s against the polygon: first order in the period.
        assert size(outside(axes, word)) == pytest.approx(area, rel=0.02)
        assert f"{word}: {area:.3g} s" in texts(figure)


def test_of_a_bundle_the_worst_is_drawn_strongly_and_filled() -> None:
    shown = InCorridor("surge", SURGE, T, BUNDLE)
    assert worst_response(shown) == 1
    axes = panel(corridor_figure([shown]), "surge")
    drawn = line(axes, "worst of 3 responses")
    np.testing.assert_array_equal(drawn[:, 1], BUNDLE[1])
    assert len(axes.get_lines()) == 2 + 2 + 1 + 1  # bounds, the others, target, worst


def test_among_responses_inside_the_latest_is_the_worst() -> None:
    inside = np.array([second_order(T, 0.8, 0.6), second_order(T, 0.8, 0.35), second_order(T, 0.8, 0.5)])
    assert worst_response(InCorridor("surge", SURGE, T, inside)) == 1
    figure = corridor_figure([InCorridor("surge", SURGE, T, inside)])
    assert {"below: none", "above: none"} <= set(texts(figure))


def test_bounds_are_drawn_upright_where_they_jump_and_to_their_end() -> None:
    axes = panel(corridor_figure([InCorridor("surge", SURGE, T, BUNDLE[0])]), "surge")
    lower = line(axes, "corridor")
    jump = np.flatnonzero(np.diff(lower[:, 1]) > 0.5)
    assert lower[jump[0], 0] == pytest.approx(10.0, abs=1e-5)
    assert lower[jump[0] + 1, 0] == 10.0
    assert axes.get_xlim() == pytest.approx((0.0, 40.0))


def test_weights_and_divergence_are_said() -> None:
    weighted = Corridor(SURGE.lower, SURGE.upper, weight_upper=3.0)
    wild = np.where(T > 30.0, math.nan, np.exp(0.1 * T))
    many = corridor_figure([
        InCorridor("weighted", weighted, T, BUNDLE[1]),
        InCorridor("wild", SURGE, T, wild),
        InCorridor("depth beside", Corridor.beside(until_s=40.0), T, 1.3 * np.sin(T), label="half-widths"),
    ])
    assert_on_page(many)
    over = violations(T, BUNDLE[1], weighted)[1]
    assert f"above: 3 × {over:.3g} s" in texts(many)
    assert "above: no end (diverged)" in texts(many)
    low, high = panel(many, "wild").get_ylim()
    assert high < 2.0  # exp(3) is cut: the corridor stays readable
    assert low < -0.1


def test_a_corridor_without_responses_is_refused() -> None:
    with pytest.raises(SimulationError, match="no response to draw"):
        corridor_figure([])
    with pytest.raises(SimulationError, match="no step responses to draw"):
        step_responses([])


def test_panels_side_by_side_have_the_same_scale_and_the_same_ticks() -> None:
    before = InCorridor("start gains", SURGE, T, second_order(T, 0.2, 0.4))
    after = InCorridor("tuned", SURGE, T, second_order(T, 0.9, 0.4))
    figure = corridor_figure([before, after])
    left, right = panel(figure, "start gains"), panel(figure, "tuned")
    assert left.get_ylim() == right.get_ylim()
    assert list(left.get_yticks()) == list(right.get_yticks())


STEPS = (SetPointStep(0.0, 0.0, 1.0, SURGE), SetPointStep(60.0, 1.0, 0.4, SURGE))


def course(*, samples: int = 1, down: bool = False, name: str = "surge") -> Course:
    t: Array = 0.1 * np.arange(1000.0)
    set_point, before, after = np.zeros_like(t), np.zeros((samples, 1000)), np.zeros((samples, 1000))
    for step in STEPS:
        since, change = np.maximum(t - step.at_s, 0.0), step.after - step.before
        set_point += np.where(t >= step.at_s, change, 0.0)
        for k in range(samples):
            before[k] += change * second_order(since, 0.3 + 0.05 * k, 0.25)
            after[k] += change * second_order(since, 0.75 + 0.05 * k, 0.35)
    if samples == 1:
        before, after = before[0], after[0]
    return Course(name, "u, m/s", t, set_point, before, after, STEPS, down=down)


def test_step_responses_before_and_after_tuning_share_their_set_points() -> None:
    figure = step_responses([course(), course(samples=4, down=True, name="depth")])
    assert_on_page(figure)
    assert_legends_beside(figure)
    assert {"set point", "start gains", "tuned", "span of the samples", "corridor"} <= set(texts(figure))
    low, high = panel(figure, "surge").get_ylim()
    assert low < high
    low, high = panel(figure, "depth").get_ylim()
    assert low > high
    assert "span of the samples" not in texts(step_responses([course()]))


@pytest.mark.long
@pytest.mark.parametrize("count", [3, 5, 6, 11])
def test_many_courses_fit_on_a_page_and_keep_their_room(count: int) -> None:
    wild = course()
    away = replace(
        wild, name="heave at −1 m/s, +1 m", before=wild.before + 50.0, remark="start gains: outside by 2700 s"
    )
    figure = step_responses([
        *(replace(wild, name=f"surge at {k} m/s, +0.4 m/s") for k in range(count - 1)),
        away,
    ])
    assert figure.get_figheight() <= 10.0
    assert_on_page(figure)
    assert_legends_beside(figure)
    panels = [axes for axes in figure.axes if axes.axison]
    assert len(panels) == count
    # Tall enough to be read, and the lowest of each column says what its horizontal axis is.
    assert min(axes.get_window_extent().height for axes in panels) > 0.9 * figure.dpi
    assert all(axes.get_xlabel() == "time, s" for axes in panels[-2:]) or count == 3
    assert "start gains: outside by 2700 s, out of view" in texts(figure)


def test_corridors_follow_the_size_and_direction_of_their_step() -> None:
    axes = panel(step_responses([course()]), "surge")
    shaded = [one for one in axes.collections if isinstance(one, PolyCollection)]
    first, second = (np.concatenate([np.asarray(p.vertices) for p in one.get_paths()]) for one in shaded)
    assert (first[:, 0].min(), first[:, 0].max()) == pytest.approx((0.0, 40.0))
    assert (first[:, 1].min(), first[:, 1].max()) == pytest.approx((-0.1, 1.1))
    # A step of -0.6 from 1: overshoot to 0.34, the wrong way to 1.06; the course ends before the corridor.
    assert (second[:, 0].min(), second[:, 0].max()) == pytest.approx((60.0, 99.9))
    assert (second[:, 1].min(), second[:, 1].max()) == pytest.approx((0.34, 1.06))


def test_a_wild_response_does_not_hide_the_others() -> None:
    quiet = course()
    wild = np.exp(0.1 * quiet.t)
    wild[-10:] = math.nan
    figure = step_responses([Course("surge", "u, m/s", quiet.t, quiet.set_point, wild, quiet.after, STEPS)])
    assert panel(figure, "surge").get_ylim()[1] < 2.0
