"""Diagrams of the autopilot: printable, with the names of its parts; the line of sight has true signs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from paper.autopilot import control_structure, guidance_geometry, sight
from tests.report.figures import assert_printable, texts


def test_the_control_structure_can_be_printed_and_names_the_parts() -> None:
    figure = control_structure()
    assert_printable(figure)
    words = " ".join(texts(figure))
    for said in (
        *("guidance", "mode table", "adaptive PID", "allocation", "vehicle", "sensors", "safety"),
        *("feed-forward", "gain schedule", "anti-windup by", "preset where the loop enters (bumpless)"),
        *("$K_P(u_d)$", "$T_s K_I(u_d)$", "$K_D(u_d)$", "switch"),
    ):
        assert said in words


@given(
    plane=st.sampled_from(["horizontal", "vertical"]),
    along=st.floats(-3.0, 3.0),
    error=st.floats(-20.0, 20.0),
    lookahead=st.floats(0.5, 30.0),
)
def test_law_the_line_of_sight_points_at_the_lookahead_point(
    plane: str, along: float, error: float, lookahead: float
) -> None:
    one = sight(plane, along, 3.0, error, lookahead)
    toward = one.ahead - one.vehicle
    # From north clockwise in the horizontal plane, from forward upwards in the vertical one.
    angle = math.atan2(toward[0], toward[1]) if plane == "horizontal" else math.atan2(toward[1], toward[0])
    # Rounding of a few operations on angles of order one.
    assert math.remainder(angle - one.desired, math.tau) == pytest.approx(0.0, abs=1e-9)


def test_positive_errors_lie_to_starboard_and_below() -> None:
    north = sight("horizontal", 0.0, 5.0, 2.0, 4.0)
    assert north.vehicle == pytest.approx([2.0, 5.0])  # east of a path to the north
    assert north.desired < 0.0  # turns to port
    level = sight("vertical", 0.0, 5.0, 2.0, 4.0)
    assert level.vehicle == pytest.approx([5.0, -2.0])
    assert level.desired > 0.0  # raises the bow


def test_the_geometry_names_what_guidance_reckons_with() -> None:
    figure = guidance_geometry()
    figure.canvas.draw()
    words = " ".join(texts(figure))
    for said in (
        "$y_e$",
        "$z_e$",
        r"$\Delta$",
        r"$\pi_p$",
        r"$\gamma_p$",
        r"$\psi_d$",
        r"$\theta_d$",
        "$R_0$",
    ):
        assert said in words
    page = figure.bbox
    for axes in figure.axes:
        for text in axes.texts:
            box = text.get_window_extent()
            assert page.x0 <= box.x0 < box.x1 <= page.x1, text
            assert page.y0 <= box.y0 < box.y1 <= page.y1, text
        assert np.diff(axes.get_xlim()) / axes.bbox.width == pytest.approx(
            np.diff(axes.get_ylim()) / axes.bbox.height, rel=1e-6
        )
