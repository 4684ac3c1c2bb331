"""Figures of missions and flights: they show what was planned and flown, to scale, and can be printed."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import tomlkit
from matplotlib.legend import Legend

import seatrial as st
from paper.autopilot import autopilot_plates, flight_plates
from seatrial.flight.disturbances import Fault, Outage
from seatrial.flight.metrics import saturated
from seatrial.report.plot.flight import _remark, events, flight_track, settled, spans, thinned
from seatrial.report.plot.flight_errors import flight_actuators, flight_errors, flight_loops, shown_loops
from tests.flight.flying import BOX, OUT, STATION, flown
from tests.report.figures import VEHICLES, assert_legends_beside, assert_on_page, line, panel, texts

DEAD = Fault("SbU", at_s=40.0)


def faulty() -> st.Flight:
    return flown(BOX, faults=(DEAD,), outages=(Outage("position", from_s=90.0, until_s=95.0),))


FLIGHTS = {"box": flown, "out": lambda: flown(OUT), "station": lambda: flown(STATION), "faulty": faulty}


@pytest.mark.long
@pytest.mark.parametrize("name", FLIGHTS)
@pytest.mark.parametrize("draw", [flight_track, flight_errors, flight_loops, flight_actuators])
def test_figures_of_a_flight_can_be_printed(name: str, draw: object) -> None:
    figure = draw(FLIGHTS[name]())  # type: ignore[operator]
    assert_on_page(figure)
    assert_legends_beside(figure)


def test_the_plan_has_equal_scale_and_north_up() -> None:
    flight = flown()
    axes = panel(flight_track(flight), "track")
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("east, m", "north, m")
    across, up = np.diff(axes.get_xlim())[0], np.diff(axes.get_ylim())[0]
    assert across / axes.bbox.width == pytest.approx(up / axes.bbox.height, rel=1e-6)
    squares = line(axes, "waypoint with its number")
    assert squares.tolist() == [[0.0, 100.0], [100.0, 100.0], [100.0, 0.0]]
    cruise = line(axes, "flown: cruise")
    rows = cruise[np.isfinite(cruise).all(axis=1)]
    assert np.ptp(rows[:, 0]) > 90.0
    # What is left of the track goes through every place where it went: to a hundredth of an inch on the page.
    scale = across / (axes.bbox.width / axes.figure.dpi)
    fast = flight.position[flight.mode == 1]
    near = np.min(np.hypot(fast[::50, None, 1] - rows[:, 0], fast[::50, None, 0] - rows[:, 1]), axis=1)
    assert near.max() < 0.01 * scale


def test_the_current_points_where_the_water_goes() -> None:
    figure = flight_track(flown(BOX, (0.1, 0.3, 0.0)))
    assert "current 0.32 m/s" in texts(figure)
    arrow = next(one for one in figure.artists if hasattr(one, "get_arrowstyle"))
    (x0, y0), (x1, y1) = arrow._posA_posB  # type: ignore[attr-defined]
    width, height = figure.get_size_inches()
    assert math.atan2((x1 - x0) * width, (y1 - y0) * height) == pytest.approx(math.atan2(0.3, 0.1))
    assert not any("current" in word for word in texts(flight_track(flown(OUT, (0.0, 0.0, 0.0)))))


def test_depth_counts_downwards_beside_what_was_desired() -> None:
    axes = panel(flight_track(flown()), "depth")
    low, high = axes.get_ylim()
    assert low > 10.0 > high
    depth = line(axes, "flown depth")
    assert depth[:, 1].max() == pytest.approx(flown().metrics["depth_largest_m"], abs=0.01)
    figure = flight_track(flown(OUT, seabed=12.0))
    assert any(label.get_text() == "bottom" for legend in figure.legends for label in legend.get_texts())


def test_faults_outages_and_reactions_are_marked_and_said() -> None:
    flight = faulty()
    said = [event.words for event in events(flight)]
    assert said[:2] == ["SbU is dead from 40 s on", "no samples of position from 90 s to 95 s"]
    assert len({event.mark for event in events(flight)}) == len(said)
    for figure in (flight_track(flight), flight_loops(flight), flight_actuators(flight)):
        legend = next(one for one in figure.legends if isinstance(one, Legend))
        assert set(said) <= {text.get_text() for text in legend.get_texts()}
    deep = flown(BOX.replace('name = "box"', 'name = "deep"') + "[limits]\nmax_depth_m = 10.1\n")
    assert [event.words.split(" at ")[0] for event in events(deep)] == [
        alert.reaction for alert in deep.alerts
    ]


def test_settled_errors_are_those_of_the_figures() -> None:
    flight = flown()
    rows = settled(flight)
    error = flight.errors["cross_track"][rows]
    # The core sums the same rows while it flies.
    assert math.sqrt(float(np.mean(error**2))) == pytest.approx(flight.metrics["cross_track_rms_m"], rel=1e-6)
    low, high = np.percentile(error, (2.5, 97.5))
    words = " ".join(texts(flight_errors(flight))).replace("\N{MINUS SIGN}", "-")
    assert f"95 %: {low:+.2f} to {high:+.2f}" in words


def test_the_word_leg_stands_before_the_first_number_clear_of_the_axis() -> None:
    axes = panel(flight_errors(flown()), "cross-track error")
    axes.figure.canvas.draw()
    (first,) = [one for one in axes.texts if one.get_text().startswith("leg")]
    assert first.get_text() == "leg 1"
    ticks = [one.get_window_extent() for one in axes.get_yticklabels()]
    assert not any(first.get_window_extent().overlaps(box) for box in ticks)
    assert [one.get_text() for one in axes.texts if one.get_text().isdigit()] == ["2", "3"]


def test_a_flight_without_settled_legs_says_so() -> None:
    flight = flown(OUT, max_time_s=10.0)
    assert not settled(flight).any()
    assert "no leg settled" in texts(flight_errors(flight))


def test_loops_show_what_is_at_work_without_jumps() -> None:
    flight = flown()
    shown = {one.index: one for one in shown_loops(flight)}
    assert set(shown) == {0, 2, 4, 5}  # CWolf has no sway and no roll loop
    heading = shown[5]
    assert np.abs(np.diff(heading.done)).max() < 5.0
    off = heading.desired - heading.done
    assert np.nanmax(np.abs(off)) <= 180.0
    # The heading is the measured one up to whole turns.
    turns = (heading.done - np.rad2deg(flight.euler[:, 2])) / 360.0
    assert turns == pytest.approx(np.round(turns), abs=1e-9)
    assert not saturated(flight, 1).any()


def test_a_saturated_loop_is_shaded() -> None:
    file = tomllib.loads(st.Autopilot.load("cwolf").to_toml())
    file["loops"]["surge"]["tau_max"] = 8.0
    flight = st.fly("cwolf", st.Autopilot.from_toml(tomlkit.dumps(file)), st.Mission.from_toml(OUT))
    rows = saturated(flight, 0)
    assert rows.any()
    assert flight.loops["surge"].saturated == pytest.approx(rows.sum() / flight.active[:, 0].sum())


def test_actuators_stand_in_groups_with_dead_band_and_energy() -> None:
    flight = flown()
    figure = flight_actuators(flight)
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["stern", "vertical", "power"]
    assert f"{flight.energy_wh[-1]:.3g} Wh" in figure.axes[-1].get_title(loc="right")
    names = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]  # type: ignore[union-attr]
    assert names == ["SbU", "SbL", "PU", "PL"]


def test_long_curves_keep_their_extremes() -> None:
    t = np.linspace(0.0, 9999.9, 100_000)
    y = np.sin(t)
    y[51_234], y[77_777] = 9.0, -7.0
    y[:100] = np.nan
    few, values = thinned(t, y)
    assert len(few) < 5_000
    assert np.all(np.diff(few) > 0.0)
    assert (np.nanmax(values), np.nanmin(values)) == (9.0, -7.0)
    assert thinned(t[:100], y[:100])[0] is not few
    assert len(thinned(t[:100], y[:100])[0]) == 100


def test_spans_are_the_times_of_a_mask() -> None:
    t = np.linspace(0.0, 2.5, 6)
    assert spans(t, np.array([True, False, True, True, False, True])) == [(0.0, 0.5), (1.0, 1.0), (2.5, 0.5)]
    assert spans(t, np.zeros(6, dtype=bool)) == []


@pytest.mark.long
def test_the_gallery_flies_what_has_an_autopilot_and_says_what_has_none() -> None:
    plates = {plate.name: plate for plate in autopilot_plates(VEHICLES["cwolf"])}
    assert list(plates) == [
        "control_structure", "guidance", "mission", "flight_track", "flight_errors", "flight_loops",
        "flight_actuators",
    ]  # fmt: skip
    assert all(plate.draw is not None for plate in plates.values())
    (bare,) = autopilot_plates(VEHICLES["bare"])
    assert bare.draw is None
    *_, other = autopilot_plates(VEHICLES["uneven"])
    assert other.caption == "no flight: uneven has no built-in autopilot"
    for plate in flight_plates(flown(OUT)):
        assert plate.draw is not None
        assert_on_page(plate.draw())


@pytest.mark.parametrize("draw", [flight_track, flight_errors, flight_loops, flight_actuators])
def test_a_flight_that_diverges_is_drawn_as_far_as_it_went(draw: object) -> None:
    flight = flown()
    lost = np.arange(len(flight.t)) >= 800

    def until_lost(values: np.ndarray) -> np.ndarray:
        return np.where(lost.reshape(-1, *[1] * (values.ndim - 1)), np.nan, values)

    arrays = ("position", "euler", "nu", "power", "demanded", "achieved")
    tables = ("desired", "errors", "commands", "actuators")
    changed: dict[str, Any] = {name: until_lost(getattr(flight, name)) for name in arrays}
    for name in tables:
        changed[name] = {key: until_lost(one) for key, one in getattr(flight, name).items()}
    broken = replace(flight, outcome="diverged", **changed)
    assert_on_page(draw(broken))  # type: ignore[operator]


def test_the_track_shows_obstacles_the_promised_distance_and_the_closest_point() -> None:
    pile = "[[obstacles]]\nnorth_m = 30.0\neast_m = 9.0\nradius_m = 1.0\ndistance_m = 5.0\n"
    flight = flown(OUT + pile)
    figure = flight_track(flight)
    axes = panel(figure, "track")
    said = {label.get_text() for legend in figure.legends for label in legend.get_texts()}
    closest = f"closest: hull {flight.metrics['clearance_m']:.1f} m away"
    assert {"net or obstacle", "promised distance", closest} <= said
    row = int(np.argmin(np.abs(flight.t - flight.metrics["clearance_time_s"])))
    assert line(axes, closest)[0] == pytest.approx(flight.position[row, [1, 0]])
    # The promised distance is a circle of 1 m + 5 m about the pile.
    rings = [np.asarray(path.vertices) for one in axes.collections for path in one.get_paths()]
    radii = [np.hypot(ring[:, 0] - 9.0, ring[:, 1] - 30.0) for ring in rings]
    assert any(np.allclose(radius, 6.0, atol=0.1) for radius in radii)


def _near(flight: st.Flight) -> st.Flight:
    """A flight that is taken to have touched something, and to have missed its waypoints."""
    near = replace(flight, metrics={**flight.metrics, "clearance_m": -0.1})
    near.__dict__["legs"] = tuple(replace(leg, reached=False) for leg in flight.legs)
    return near


def test_a_remark_leaves_room_for_the_name_beside_it() -> None:
    """The words are shortened where the panel is narrow, as beside a tall track."""
    flight = _near(flown())
    way = f"{flight.metrics['distance_m']:.0f} m in {flight.t[-1]:.0f} s"
    assert _remark(flight, 80) == f"too near to an obstacle and waypoints missed, {way}"
    assert _remark(flight, 45) == f"too near to an obstacle, {way}"
    assert _remark(flight, 32) == f"not complete, {way}"
    assert _remark(flight, 10) == way
    figure = flight_track(_near(st.fly("cwolf", "cwolf", st.Mission.from_toml(OUT))))
    figure.canvas.draw()
    track = next(axes for axes in figure.axes if axes.get_title(loc="left") == "track")
    name = next(text for text in track.get_children() if getattr(text, "_text", "") == "track")
    remark = track.get_title(loc="right")
    other = next(text for text in track.get_children() if getattr(text, "_text", "") == remark)
    assert name.get_window_extent().x1 < other.get_window_extent().x0
