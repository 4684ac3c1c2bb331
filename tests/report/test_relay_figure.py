"""The figure of a relay tuning shows the cycles that the gains were made of, and can be printed."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import seatrial as st
from seatrial.report.plot.tuning import relay_cycles, relay_pages
from seatrial.tuning.relay import RelayTuning, relay_autopilot
from tests.report.figures import assert_legends_beside, assert_on_page, panel, texts

START = "examples/cwolf/start_autopilot.toml"


@cache
def tuned(sensors: str | None) -> RelayTuning:
    return relay_autopilot(st.Vehicle.load("cwolf"), st.Autopilot.load(START), shares=[0.15], sensors=sensors)


@pytest.mark.long
@pytest.mark.parametrize("sensors", [None, "typical"])
def test_the_figure_can_be_printed(sensors: str | None) -> None:
    figure = relay_cycles(tuned(sensors))
    assert_on_page(figure)
    assert_legends_beside(figure)


def test_it_shows_the_cycle_in_degrees_and_its_gain() -> None:
    result = tuned(None)
    figure = relay_cycles(result)
    point = next(p for p in result.points if (p.loop, p.speed_m_s) == ("heading", 3.0))
    assert point.taken is not None
    assert point.taken.cycle is not None
    axes = panel(figure, "heading, 3 m/s")
    drawn = np.asarray(axes.lines[0].get_ydata(), dtype=float)
    # The relay's own cycle, 4 deg off the crossover, is larger than the one that is told there.
    assert 0.5 * np.ptp(drawn) == pytest.approx(np.rad2deg(point.taken.cycle.amplitude), rel=0.2)
    words = " ".join(texts(figure))
    assert f"{point.taken.cycle.ultimate_gain:.3g} N m/rad" in words
    assert "surge: no cycle at 3 m/s" in words


def test_many_cycles_take_several_pages() -> None:
    result = tuned(None)
    assert relay_pages(result) == 1
    shown = len(relay_cycles(result).axes)
    many = replace(result, points=result.points * 4)
    figures = [relay_cycles(many, page=page) for page in range(1, relay_pages(many) + 1)]
    assert len(figures) > 1
    assert sum(len([axes for axes in figure.axes if axes.axison]) for figure in figures) == 4 * shown
    assert max(figure.get_figheight() for figure in figures) <= 10.0


def test_an_unusable_cycle_is_grey_and_says_why() -> None:
    result = tuned("typical")
    doubtful = [p for p in result.points if p.gains is None and p.trials[0].trace is not None]
    assert doubtful  # noise of the depth sensor makes a relay of 10 N chatter
    figure = relay_cycles(result)
    words = " ".join(texts(figure))
    for point in doubtful:
        assert point.why in words
    assert "no usable cycle" in words
