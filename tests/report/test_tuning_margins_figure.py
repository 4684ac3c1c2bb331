"""The figure of margins before and after a tuning: what it shows, held against the numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

import seatrial as st
from seatrial.control_design.margin_constraint import MarginConstraint
from seatrial.control_design.tuning_table import Margins
from seatrial.report.plot.style import MEASURED, SIMULATED, save
from seatrial.report.plot.tuning import tuning_margins

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from numpy.typing import NDArray

CWOLF = st.Vehicle.load("cwolf")
AFTER = st.Autopilot.load("cwolf")
SPEEDS = (0.881, 1.951, 3.021)
LIMITS = Margins(phase_deg=50.0)


def slower() -> st.Autopilot:
    return AFTER.with_gains({
        name: 0.5 * value for name, value in AFTER.gains().items() if name.startswith("heading.K_")
    })


def xy(line: Line2D) -> NDArray[np.float64]:
    """Points of a line, (n, 2)."""
    return np.asarray(line.get_xydata(), dtype=float)


@pytest.fixture(scope="module")
def figure() -> Figure:
    return tuning_margins(CWOLF, (slower(), AFTER), speeds_m_s=SPEEDS, limits=LIMITS)


def test_a_row_per_loop_with_units_and_a_shared_range_of_speeds(figure: Figure) -> None:
    rows = [figure.axes[4 * k : 4 * k + 4] for k in range(4)]
    assert [row[0].get_ylabel() for row in rows] == ["surge", "heave", "pitch", "heading"]
    assert [axes.get_title(loc="left") for axes in rows[0]] == [
        "phase margin, deg", "gain margin, dB", "delay margin, s", "open loop",
    ]  # fmt: skip
    assert len({axes.get_xlim() for row in rows for axes in row[:3]}) == 1


@pytest.mark.parametrize(("colour", "before"), [(MEASURED, True), (SIMULATED, False)])
def test_phase_margins_are_drawn_where_they_are(figure: Figure, colour: str, before: bool) -> None:
    drawn = {
        (float(x), float(y))
        for line in figure.axes[12].lines
        if line.get_color() == colour and line.get_marker() != "x"
        for x, y in xy(line)
    }
    points = MarginConstraint(CWOLF, slower() if before else AFTER, SPEEDS).margins({})
    assert drawn == {
        (point.speed_m_s, float(point.of.phase_deg[0, point.loops.index("heading")])) for point in points
    }


def test_the_legend_has_the_words_of_the_other_figures_of_a_tuning(figure: Figure) -> None:
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert words[:2] == ["start gains", "tuned"]


def test_a_legend_of_many_modes_stays_on_the_page_and_off_the_panels() -> None:
    text = (
        AFTER
        .to_toml()
        .replace('"cruise"', '"cruise with a long name"')
        .replace('"hover"', '"hover by all four"')
    )
    loud = st.Autopilot.from_toml(text, "cwolf").with_gains({
        name: 40.0 * value for name, value in AFTER.gains().items() if name.startswith("pitch.K_")
    })
    drawn = tuning_margins(CWOLF, (loud, loud), speeds_m_s=SPEEDS, limits=LIMITS)
    drawn.canvas.draw()
    box = drawn.legends[0].get_window_extent()
    assert box.x1 <= drawn.bbox.x1
    titles = [axes._left_title.get_window_extent().y1 for axes in drawn.axes[:4]]  # type: ignore[attr-defined]
    assert box.y0 >= max(titles)


def test_limits_are_drawn(figure: Figure) -> None:
    drawn = (LIMITS.phase_deg, LIMITS.gain_db, LIMITS.delay_s)
    for axes, limit in zip(figure.axes[:3], drawn, strict=True):
        assert [limit, limit] in [xy(line)[:, 1].tolist() for line in axes.lines]


@pytest.mark.long
def test_unstable_points_are_crosses_at_the_foot_and_named_in_the_legend(
    figure: Figure, tmp_path: Path
) -> None:
    assert not any("unstable" in text.get_text() for text in figure.legends[0].get_texts())
    loud = AFTER.with_gains({
        name: 40.0 * value for name, value in AFTER.gains().items() if name.startswith("pitch.K_")
    })
    other = tuning_margins(CWOLF, (AFTER, loud), speeds_m_s=SPEEDS[:1])
    crosses = [line for line in other.axes[0].lines if line.get_marker() == "x" and len(xy(line))]
    assert [line.get_color() for line in crosses] == [SIMULATED]
    assert xy(crosses[0])[:, 0].tolist() == [SPEEDS[0]]
    assert any("unstable" in text.get_text() for text in other.legends[0].get_texts())
    (written,) = save(other, tmp_path / "margins", formats=("png",))
    assert written.stat().st_size > 10_000
