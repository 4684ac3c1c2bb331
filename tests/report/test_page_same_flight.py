"""One verdict for run and page: the page of a run flies the run's flight to the bit and shows its record.

In the system's Chromium; without one these tests are skipped and say so.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import seatrial as st
from seatrial.flight.excesses import broken_in, too_deep, too_low, too_near, touched, unkept
from seatrial.report.page.flying import core, setups
from seatrial.report.page.page import write_page
from seatrial.report.page.run_folder import RunFolder
from seatrial.sensors.sensor import load_sensors
from tests.flight.flying import grouped
from tests.report.in_browser import CHROMIUM, Opened, assert_same_bits, chromium, settled

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

without = "no Chromium: apt-get install chromium" if CHROMIUM is None else "no core for the page: make page"

in_browser = pytest.mark.skipif(CHROMIUM is None or not core(), reason=without)

CORNER = """
format = 1
name = "corner"
speed_m_s = 0.6
acceptance_radius_m = 3.0
{limits}
[[legs]]
north_m = 20.0
east_m = 0.0
depth_m = 3.0
[[legs]]
north_m = 20.0
east_m = 15.0
depth_m = 4.0
hold_s = 10.0
"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    pytest.importorskip("playwright.sync_api")
    with chromium() as started:
        yield started


@pytest.fixture
def opened(browser: Browser) -> Iterator[Opened]:
    pages = Opened(browser)
    yield pages
    pages.close()


def mission(limits: str = "") -> st.Mission:
    return st.Mission.from_toml(CORNER.format(limits=limits))


def page_of(opened: Opened, flight: st.Flight, folder: Path) -> Page:
    flight.save(folder / "run")
    page = opened(write_page([folder / "run"], folder / "report.html"))
    settled(page, "window.seatrial && seatrial.changed")
    return page


def assert_is_the_run(page: Page, flight: st.Flight, **options: Any) -> None:
    """The log to the last bit, the ending in the run's words by the page's own judgement, and the record."""
    options = {"seeds" if name == "seed" else name: value for name, value in options.items()}
    flights = st.fly_batch(flight.vehicle, flight.autopilot, flight.mission, **grouped(logs=True, **options))
    assert_same_bits(page, "original", flights)
    assert page.evaluate("seatrial.ending(seatrial.original.figures)") == flight.outcome_in_words
    assert page.evaluate("seatrial.record().off") == []
    assert page.evaluate("seatrial.record().ending") == flight.outcome_in_words
    shown = page.locator("[data-part=figures] tbody tr").first.text_content() or ""
    assert flight.outcome_in_words in shown
    assert "the same numbers" in (page.text_content("[data-part=status]") or "")


def fly(vehicle: str, sensors: str | None, max_time_s: float | None) -> tuple[st.Flight, dict[str, Any]]:
    options: dict[str, Any] = {"sensors": sensors, "current": [0.05, 0.02, 0.0], "max_time_s": max_time_s}
    if any(one["needs_voltage"] for one in st.Vehicle.load(vehicle).actuator_info().values()):
        options["voltage_v"] = 15.5
    return st.fly(vehicle, vehicle, mission(), **grouped(seed=7, **options)), options | {"seed": 7}


@in_browser
@pytest.mark.long
@pytest.mark.parametrize("max_time_s", [None, 30.0])
@pytest.mark.parametrize("sensors", [None, "typical"])
@pytest.mark.parametrize("vehicle", st.Autopilot.names())
def test_every_built_in_vehicle_flies_in_the_page_as_in_the_run(
    opened: Opened, tmp_path: Path, vehicle: str, sensors: str | None, max_time_s: float | None
) -> None:
    flight, options = fly(vehicle, sensors, max_time_s)
    assert_is_the_run(page_of(opened, flight, tmp_path), flight, **options)


@in_browser
@pytest.mark.parametrize(
    ("vehicle", "sensors", "max_time_s", "outcome"),
    [("beluga", "typical", None, "complete"), ("bluerov2-heavy", "typical", 20.0, "out of time")],
)
def test_a_run_and_its_page_fly_to_the_same_bits(
    opened: Opened, tmp_path: Path, vehicle: str, sensors: str, max_time_s: float | None, outcome: str
) -> None:
    flight, options = fly(vehicle, sensors, max_time_s)
    assert flight.outcome == outcome
    assert_is_the_run(page_of(opened, flight, tmp_path), flight, **options)


@in_browser
def test_the_page_takes_every_input_from_the_record(opened: Opened, tmp_path: Path) -> None:
    """A model that is another, a start under way, dithered commands and a filter of its own numbers."""
    vehicle = st.Vehicle.load("cwolf")
    own = vehicle.coefficients()
    heavier = vehicle.with_coefficients({"X_uu": 1.3 * own["X_uu"], "N_rr": 0.8 * own["N_rr"]})
    names = list(vehicle.actuators)
    options: dict[str, Any] = {
        "model": heavier,
        "initial": st.State([1.0, -2.0, 2.0], [0.05, -0.02, 0.3], [0.4, 0.0, 0.0, 0.0, 0.0, 0.01]),
        "sensors": "typical",
        "navigation": st.NavigationFilter(
            vehicle,
            "typical",
            period_s=0.1,
            noise=st.ProcessNoise(waves=st.SeaState(0.4, 5.0)),
            gate=st.SampleGate(deviations=4.0, longest_age_s=0.0),
        ),
        "waves": st.SeaState(0.3, 6.0, toward_deg=40.0, spreading_deg=10.0),
        "current_trend": [0.2, 0.0, 0.0],
        "outages": [st.Outage("depth", 10.0), st.Outage("velocity", 12.0, 20.0)],
        "faults": [st.Fault(names[0], at_s=15.0, stuck=True)],
        "seabed": (30.0, 0.02, 0.0),
        "obstacles": [(40.0, 5.0, 2.0)],
        "rho": 1027.5,
        "feedback": False,
        "max_step_s": 0.01,
        "max_time_s": 45.0,
    }
    dither = {"times": [2.0, 4.0, 6.0], names[0]: [0.5, -0.5, 0.0]}
    flight = st.fly("cwolf", "cwolf", mission(), **grouped(seed=3, dither=dither, **options))
    page = page_of(opened, flight, tmp_path)
    assert page.evaluate("seatrial.record().off") == []
    truth = np.column_stack([flight.position, flight.euler, flight.nu])
    columns = page.evaluate("seatrial.original.columns")
    values = np.array(page.evaluate("Array.from(seatrial.original.values)")).reshape(-1, len(columns))
    assert np.array_equal(values[:, :12], truth)
    shown = [columns.index(f"cmd.{name}") for name in names]
    assert np.array_equal(values[:, shown], np.column_stack([flight.commands[name] for name in names]))


@in_browser
@pytest.mark.parametrize("kind", ["limits", "missed"])
def test_a_flight_to_its_end_that_broke_something_is_not_complete_in_the_page(
    opened: Opened, tmp_path: Path, kind: str
) -> None:
    options: dict[str, Any] = {}
    sensors = load_sensors("typical", st.Vehicle.load("cwolf"))
    if kind == "limits":  # the true depth, not the perceived one
        flown = mission("[limits]\nmax_depth_m = 4.2\n")
        options["sensors"] = sensors | {"depth": replace(sensors["depth"], bias=0.5)}
        expected = "flown to its end, beyond the mission's largest depth"
    else:
        flown = mission()
        options["sensors"] = sensors | {"gps": replace(sensors["gps"], bias=4.0)}
        expected = "flown to its end, waypoints missed"
    flight = next(
        flight
        for seed in range(2, 40)
        if (flight := st.fly("cwolf", "cwolf", flown, **grouped(**options, seed=seed))).outcome_in_words
        == expected
    )
    seed = flight.circumstances.seed
    page = page_of(opened, flight, tmp_path)
    assert_is_the_run(page, flight, **options, seed=seed)
    row = page.locator("[data-part=figures] tbody tr").filter(has_text="true cross track rms, m")
    cells = row.locator("td").all_text_contents()
    # What was asked is empty; then the run's record and this flight, in four digits.
    assert [float(text) for text in cells[-2:]] == pytest.approx(
        [flight.metrics["true_cross_track_rms_m"]] * 2, rel=1e-3
    )


@in_browser
def test_the_record_counts_where_a_browser_flies_otherwise(opened: Opened, tmp_path: Path) -> None:
    flight, _ = fly("lauv", None, 30.0)
    flight.save(tmp_path / "run")
    results = tmp_path / "run" / "flight.json"
    told = json.loads(results.read_text())
    told["metrics"]["distance_m"] *= 1.0 + 2e-16
    results.write_text(json.dumps(told))
    page = opened(write_page([tmp_path / "run"], tmp_path / "report.html"))
    settled(page, "window.seatrial && seatrial.changed")
    assert page.evaluate("seatrial.record().off") == ["distance, m"]
    assert "does not fly the run's flight to the bit" in (page.text_content("[data-part=status]") or "")


def test_a_record_of_another_version_is_not_taken_for_the_run(tmp_path: Path) -> None:
    flight, _ = fly("lauv", None, 30.0)
    flight.save(tmp_path / "run")
    facts = tmp_path / "run" / "run.json"
    told = json.loads(facts.read_text())
    del told["options"]["filter"]
    facts.write_text(json.dumps(told))
    made, refused = setups([RunFolder.read(tmp_path / "run")])
    assert refused == []
    assert made[0]["run"] is None
    assert "another version" in made[0]["note"]


def test_law_ranges_judge_as_the_comparisons_do() -> None:
    """At the ends of the ranges and a bit beside them, and for numbers that are none."""
    limits = {"max_depth_m": 20.0, "min_altitude_m": 1.5}
    ends = np.array([-5.0, -0.3, -0.0, 0.0, 5e-324, 1.45, 1.5, 20.05, 21.0, np.inf, np.nan])
    values = np.concatenate([ends, np.nextafter(ends, -np.inf), np.nextafter(ends, np.inf)])
    names = ("clearance_m", "clearance_reserve_m", "altitude_smallest_m", "depth_largest_m")
    for name in names:
        metrics = {one: np.full(len(values), 5.0) for one in names} | {name: values}
        broken = unkept(metrics, 3.0, limits)
        down = touched(metrics)
        assert list(broken) == list(broken_in(3.0, limits))
        assert np.array_equal(broken["too_near"], too_near(metrics, 3.0))
        assert np.array_equal(broken["bottom_touched"], down)
        low = too_low(metrics, limits["min_altitude_m"]) & ~down
        assert np.array_equal(broken["too_low"], low)
        assert np.array_equal(broken["too_deep"], too_deep(metrics, 20.0))
