"""A page in a real browser: what flies there is what `st.fly` flies, by mouse and by keyboard.

Chromium is the system's; without one these tests are skipped and say so. The long one makes pages of every
kind and looks at each in both themes and at the width of a phone.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from typer.testing import CliRunner

import seatrial as st
from seatrial.cli import app
from seatrial.cli.new import EXAMPLES
from seatrial.control_design.margin_constraint import MarginConstraint
from seatrial.report.page.flying import core
from seatrial.report.page.page import write_page
from tests.flight.flying import grouped
from tests.report.in_browser import CHROMIUM, Opened, assert_accessible, assert_same_bits, chromium, settled

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: apt-get install chromium"),
    pytest.mark.skipif(not core(), reason="no core for the page: make page"),
]

MISSION = """
format = 1
name = "corner"
speed_m_s = 1.5
acceptance_radius_m = 5.0
[[legs]]
north_m = 60.0
east_m = 0.0
depth_m = 4.0
[[legs]]
north_m = 60.0
east_m = 50.0
depth_m = 2.0
"""

SEA: dict[str, Any] = {
    "sensors": "typical",
    "current": [0.1, 0.15, 0.0],
    "turbulence": 0.05,
    "current_walk": 0.1,
    "waves": st.SeaState(0.6, 5.0, toward_deg=70.0),
    "faults": [st.Fault("SbU", at_s=45)],
    "outages": [st.Outage("velocity", 20.0, 30.0)],
    "seed": 11,
}


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    pytest.importorskip("playwright.sync_api")
    with chromium() as found:
        yield found


@pytest.fixture
def opened(browser: Browser) -> Iterator[Opened]:
    made = Opened(browser)
    yield made
    made.close()


def assert_margins(page: Page, gains: dict[str, float]) -> None:
    """Margins of the heading loop, before and after, as the engine has them at 12 frequencies per octave."""
    page.locator("a[href='#both']").click()
    page.locator("select[data-control=loop]").select_option("heading")
    point = page.evaluate("seatrial.margins.data.points[Number(seatrial.margins.point.value)]")
    shown = page.evaluate("seatrial.margins.found")
    constraint = MarginConstraint(st.Vehicle.load("cwolf"), st.Autopilot.load("cwolf"))
    place = constraint.points.index((point["mode"], point["speed"]))
    for which, own in (("original", {}), ("changed", gains)):
        expected = constraint.margins(own)[place]
        loop = expected.loops.index("heading")
        for name, value in (("phase", "phase_deg"), ("gain", "gain"), ("delay", "delay_s")):
            # Series of 16 bits; the page has the frequencies and the interpolation of the engine.
            assert shown[which][name] == pytest.approx(float(getattr(expected.of, value)[0, loop]), rel=0.01)
    assert shown["changed"]["phase"] != pytest.approx(shown["original"]["phase"], rel=0.05)
    assert page.locator("[data-part=margins] svg").count() == 3


def assert_failures_are_marked(page: Page) -> None:
    """The dead propeller and the silent Doppler log stand on the map, and the page says what differs."""
    names = page.locator("[data-part=scene] text").all_text_contents()
    assert {"SbU dead, 45 s", "velocity silent, 20 s"} <= set(names)
    assert page.locator("path.failing").count() == 2
    assert page.text_content("[data-part=differs]") == (
        "Original and changed are one flight until something is changed."
    )


def choose(page: Page, **controls: str | float) -> None:
    """Chooses in lists and fills in numbers, and waits until all of it was flown."""
    for name, value in controls.items():
        control = page.locator(f"[data-control={name}]")
        if isinstance(value, str):
            control.select_option(label=value)
        else:
            control.fill(str(value))
            control.dispatch_event("change")
    settled(page, "seatrial.core.idle && !seatrial.core.waiting.size")


def shown(value: float) -> str:
    return f"{value:.4g}".replace("-", "\N{MINUS SIGN}")


def flown(mission: st.Mission, **changes: Any) -> Any:
    options = {key: value for key, value in SEA.items() if key != "seed"} | {"seeds": SEA["seed"]}
    return st.fly_batch("cwolf", "cwolf", mission, **grouped(logs=True, **(options | changes)))


def test_the_page_flies_what_python_flies(opened: Opened, tmp_path: Path) -> None:
    mission = st.Mission.from_toml(MISSION)
    st.fly("cwolf", "cwolf", mission, **grouped(**SEA)).save(tmp_path / "run")
    page = opened(write_page([tmp_path / "run"], tmp_path / "report.html"))
    settled(page, "window.seatrial && seatrial.changed")
    assert_same_bits(page, "original", flown(mission))
    assert_failures_are_marked(page)
    assert "complete" in (page.text_content("[data-part=status]") or "")

    # A gain and a coefficient by keyboard; every breakpoint of the gain moves with its slider.
    for control, key in (("gain heading.K_P", "Home"), ("coefficient X_uu", "End")):
        page.locator(f'input[data-control="{control}"]').focus()
        page.keyboard.press(key)
    settled(page, "Object.keys(seatrial.state.coefficients).length && seatrial.core.idle")
    settled(page, "!seatrial.core.waiting.size")
    assert (page.text_content("[data-part=status]") or "").startswith("Re-flown")
    gains, coefficients = page.evaluate("[seatrial.state.gains, seatrial.state.coefficients]")
    own = st.Autopilot.load("cwolf").gains()
    assert gains == {name: own[name] / 4.0 for name in own if name.startswith("heading.K_P.")}
    assert page.text_content("[data-part=differs]") == (
        f"Changed: heading K_P × 0.25; X_uu −9.781 → {shown(coefficients['X_uu'])} N s2/m2."
    )
    assert coefficients["X_uu"] == pytest.approx(0.8 * st.Vehicle.load("cwolf").coefficients()["X_uu"])
    changed = {
        "gains": {name: [value] for name, value in gains.items()},
        "coefficients": {name: [value] for name, value in coefficients.items()},
    }
    assert_same_bits(page, "changed", flown(mission, **changed))
    assert_same_bits(page, "original", flown(mission))
    assert_margins(page, gains)

    # A number typed beside a slider is flown as it is, and the slider follows.
    entry = page.locator('[data-entry="gain guidance.lookahead_m"]')
    entry.fill("12.5")
    entry.dispatch_event("change")
    settled(page, "seatrial.state.gains['guidance.lookahead_m'] === 12.5 && seatrial.core.idle")
    at = float(page.locator('[data-control="gain guidance.lookahead_m"]').input_value())
    assert own["guidance.lookahead_m"] * 4.0 ** (2.0 * at - 1.0) == pytest.approx(12.5, rel=0.02)
    gains = page.evaluate("seatrial.state.gains")
    changed["gains"] = {name: [value] for name, value in gains.items()}
    assert_same_bits(page, "changed", flown(mission, **changed))

    # The same autopilot as a file for elsewhere.
    page.locator("button[data-act=autopilot]").click()
    settled(page, "seatrial.exported")
    exported = st.Autopilot.from_toml(page.evaluate("seatrial.exported")).gains()
    assert {name: exported[name] for name in gains} == gains

    # A waypoint by mouse: what is flown is the mission with the waypoint where it was left.
    before = page.evaluate("seatrial.changed.figures.duration")
    spot = page.locator("circle.waypoint.free").nth(1)
    spot.scroll_into_view_if_needed()
    box = spot.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 6, box["y"] + 6)
    page.mouse.down()
    page.mouse.move(box["x"] + 36, box["y"] + 16, steps=3)
    page.mouse.up()
    settled(page, f"seatrial.core.idle && seatrial.changed.figures.duration !== {before}")
    moved = st.Mission.from_toml(page.evaluate("seatrial.file()"))
    assert float(moved.core.waypoints["east_m"][1]) > 50.0
    until = page.evaluate("seatrial.until")
    assert_same_bits(page, "changed", flown(moved, max_time_s=until, **changed))

    page.locator("button[data-act=reset]").click()
    settled(page, "seatrial.core.idle && seatrial.changed && seatrial.untouched()")
    assert_same_bits(page, "changed", flown(mission))


def test_drawn_vehicles_fail_in_a_counted_share(opened: Opened, tmp_path: Path) -> None:
    """With a covariance of a real size some fail; every step of a loop and every mission can be flown."""
    st.fly("lauv", "lauv", st.Mission.from_toml(MISSION)).save(tmp_path / "run")
    page = opened(
        write_page([tmp_path / "run"], tmp_path / "report.html"), viewport={"width": 390, "height": 844}
    )
    settled(page, "window.seatrial && seatrial.changed")
    assert_same_bits(page, "original", st.fly_batch("lauv", "lauv", st.Mission.from_toml(MISSION), logs=True))
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")  # on a phone, too
    assert not page.locator(
        "button[data-act=draws]"
    ).is_visible()  # nothing is known of this vehicle's spread
    thrust = page.evaluate("seatrial.setup.coefficients.map((one) => one.name)")
    assert "X_uu" in thrust
    value = st.Vehicle.load("lauv").coefficients()["X_uu"]
    page.evaluate(
        f"seatrial.setup.covariance = {{names: ['X_uu'], at: [{value}], factor: [[{20.0 * value}]]}}"
    )
    page.evaluate("seatrial.draws(20)")
    told = page.text_content("[data-part=cloud]") or ""
    assert "of 20 drawn vehicles fail" in told
    failed = int(told.split()[0])
    assert 0 < failed < 20  # a third of a hundred times the drag: some never arrive
    assert page.locator("path.cloud").count() == 20
    assert page.locator("path.cloud.bad").count() == failed
    page.evaluate(f"seatrial.setup.covariance.factor = [[{0.1 * value}]]")
    page.evaluate("seatrial.draw()")
    settled(page, "seatrial.core.idle && !seatrial.untouched()")
    drawn = page.evaluate("seatrial.state.coefficients")
    assert drawn["X_uu"] != value
    one = {name: [number] for name, number in drawn.items()}
    mission = st.Mission.from_toml(MISSION)
    assert_same_bits(page, "changed", st.fly_batch("lauv", "lauv", mission, coefficients=one, logs=True))
    page.locator("a[href='#both']").click()
    for number in range(page.locator("[data-part=stepof] option").count()):
        page.locator("[data-part=stepof]").select_option(index=number)
        page.locator("button[data-act=step]").click()
        settled(page, "seatrial.core.idle && document.querySelector('[data-part=steps] path.second')")
    assert page.locator(".model path.fin").count() == 4  # in space, too
    page.locator("button[data-act=space]").click()
    assert page.locator("path.surface").count() == 1


def test_the_page_flies_by_the_filter_with_failures(opened: Opened, tmp_path: Path) -> None:
    """A dead thruster gives its neutral command, which is not zero; a DVL is silent for a while."""
    mission = st.Mission.from_toml(
        MISSION.replace("1.5", "0.5").replace("60.0", "12.0").replace("50.0", "8.0")
    )
    around: dict[str, Any] = {"sensors": "typical", "current": [0.05, 0.0, 0.0], "turbulence": 0.02}
    sea: dict[str, Any] = {"waves": st.SeaState(0.3, 6.0), "voltage_v": 15.5, "navigation": "filter"}
    st.fly("beluga", "beluga", mission, **grouped(seed=5, **around, **sea)).save(tmp_path / "run")
    page = opened(write_page([tmp_path / "run"], tmp_path / "report.html"))
    settled(page, "window.seatrial && seatrial.changed")
    options = around | sea | {"seeds": 5, "logs": True}
    assert_same_bits(page, "original", st.fly_batch("beluga", "beluga", mission, **grouped(**options)))

    choose(page, fault="thruster 0", faultat=20, outage="velocity", outagefrom=15, outageuntil=35)
    failures: dict[str, Any] = {
        "faults": [st.Fault("thruster_0", at_s=20)],
        "outages": [st.Outage("velocity", 15.0, 35.0)],
    }
    assert_same_bits(
        page, "changed", st.fly_batch("beluga", "beluga", mission, **grouped(**options, **failures))
    )

    choose(page, navigation="what the sensors show", sensors="perfect")
    other: dict[str, Any] = options | failures | {"navigation": "sensors", "sensors": None}
    assert_same_bits(page, "changed", st.fly_batch("beluga", "beluga", mission, **grouped(**other)))
    choose(page, navigation="a navigation filter")
    assert_same_bits(
        page,
        "changed",
        st.fly_batch("beluga", "beluga", mission, **grouped(**(other | {"navigation": "filter"}))),
    )


def test_an_accessibility_checker_finds_nothing_serious(opened: Opened, tmp_path: Path) -> None:
    pytest.importorskip("axe_playwright_python", reason="no axe-core: make setup")
    st.fly("cwolf", "cwolf", st.Mission.from_toml(MISSION)).save(tmp_path / "run")
    page = opened(write_page([tmp_path / "run"], tmp_path / "report.html"), color_scheme="light")
    settled(page, "window.seatrial && seatrial.changed")
    assert_accessible(page)
    page.locator("#theme").click()
    assert page.evaluate("document.documentElement.dataset.theme") == "dark"
    assert_accessible(page, "{runOnly: ['color-contrast']}")  # all that a theme changes


def test_the_parts_are_tabs_and_the_first_screen_flies(opened: Opened, tmp_path: Path) -> None:
    st.fly("cwolf", "cwolf", st.Mission.from_toml(MISSION)).save(tmp_path / "run")
    page = opened(
        write_page([tmp_path / "run"], tmp_path / "report.html"), viewport={"width": 1280, "height": 800}
    )
    settled(page, "window.seatrial && seatrial.changed && seatrial.core.idle")
    assert page.locator(".numbers dd").count() == 4
    for part in ("[data-part=scene] svg", '[data-control="gain guidance.lookahead_m"]', "[data-part=time]"):
        box = page.locator(part).bounding_box()
        assert box is not None
        assert box["y"] + box["height"] <= 800, part
    tabs = page.locator("[role=tab]")
    assert tabs.all_text_contents()[:3] == ["flight ✓", "both flights", "vehicle"]
    assert page.locator("[role=tabpanel]:visible").count() == 1
    tabs.first.focus()
    page.keyboard.press("ArrowRight")
    assert page.locator("[role=tabpanel]:visible").get_attribute("id") == "both"
    page.locator("[data-part=panels]").scroll_into_view_if_needed()
    settled(page, "document.querySelector('[data-part=panels] svg')")
    page.locator("[data-part=panels] .drawing").hover(position={"x": 500, "y": 60})
    values = page.locator("[data-part=panels] text.value").all_text_contents()
    assert all(value.split()[-1] in ("m", "m/s", "deg", "rpm") for value in values)
    printed = page.pdf(format="A4")
    assert printed.count(b"/Type /Page\n") <= 8


def test_a_heading_goes_around_the_circle(opened: Opened, tmp_path: Path) -> None:
    st.fly("cwolf", "cwolf", st.Mission.from_toml(MISSION)).save(tmp_path / "run")
    page = opened(write_page([tmp_path / "run"], tmp_path / "report.html"))
    settled(page, "window.seatrial && seatrial.changed")
    around = page.evaluate("aroundCircle([-10, 350, 365, 370, 725])")
    assert around[:2] + around[3:] == [350, 350, 10, 5]
    assert around[2] is None or around[2] != around[2]  # the line breaks where the circle closes
    heading = "seatrial.panels.panels.find((one) => one.name === 'heading')"
    wrapped = page.evaluate(f"Array.from({heading}.lines[1].y)")
    known = [x for x in wrapped if x is not None and x == x]
    assert max(known) - min(known) < 360.0
    assert page.evaluate("[openedAt([350, 355, 5, 10]), openedAt([170, 175, -175, -170])]") == [-180, 0]


def test_without_script_the_results_can_be_read(opened: Opened, tmp_path: Path) -> None:
    st.fly("cwolf", "cwolf", st.Mission.from_toml(MISSION)).save(tmp_path / "run")
    page = opened(write_page([tmp_path / "run"], tmp_path / "report.html"), java_script_enabled=False)
    assert page.locator("h1").inner_text() == "cwolf on corner"
    assert not page.locator("#fly").is_visible()
    assert page.locator("#theme").is_hidden()
    assert page.locator("table").first.is_visible()


TORPEDO = f"""
format = 1
name = "lauv"
vehicle = "lauv"
autopilot = "lauv"
[tuning]
samples = 1
current_m_s = 0.05
settle_s = 6.0
margins = {{ phase_deg = 20.0, gain_db = 3.0, delay_s = 0.05 }}
budget = {{ population = 8, generations = 6, simplex_rounds = 3 }}
[tuning.loops.heading]
steps = [20.0]
speeds_m_s = [1.318]
corridor = {{ rise_s = 5.0, overshoot = 0.08, settling_s = 14.0, settled = 0.08, until_s = 18.0 }}
[verification]
missions = ["{(EXAMPLES / "missions" / "lawnmower.toml").as_posix()}"]
runs = 50
[verification.current]
speed_m_s = {{ uniform = [0.0, 0.3] }}
[[verification.requirements]]
name = "flies the mission to its end"
holds = 'ending == "complete"'
probability = 0.9
"""


def run(*arguments: object) -> None:
    result = CliRunner().invoke(app, list(map(str, arguments)))
    assert result.exit_code in (0, 1), result.output  # a verdict may be one that is not held


def demonstration(folder: Path) -> Path:
    run("demo", "--out", folder)
    return folder / "report.html"


def beluga(folder: Path) -> Path:
    if not (Path(os.environ.get("SEATRIAL_DATA", "/nonexistent")) / "beluga").is_dir():
        pytest.skip("the recordings of Beluga are not here; set SEATRIAL_DATA to their folder")
    page = folder / "beluga.html"
    run("identify", EXAMPLES / "beluga" / "campaign.toml", "--out", folder / "run", "--report", page)
    return page


def torpedo(folder: Path) -> Path:
    campaign = folder / "lauv.toml"
    campaign.write_text(TORPEDO)
    run("tune", campaign, "--run", "lauv", "--out", folder / "tuned")
    run("verify", campaign, "--run", "lauv", "--autopilot", folder / "tuned", "--out", folder / "verified")
    run("report", folder / "tuned", folder / "verified", "--out", folder / "lauv.html")
    return folder / "lauv.html"


def judged_log(folder: Path) -> Path:
    mission, page = EXAMPLES / "missions" / "cage_survey.toml", folder / "log.html"
    flown = ("--sensors", "typical", "--figures", "none", "--out", folder / "flown")
    run("fly", "cwolf", "cwolf", mission, *flown)
    judged = ("--run", "cwolf", "--autopilot", "cwolf", "--out", folder / "judged", "--report", page)
    run("verify-log", EXAMPLES / "cwolf" / "campaign.toml", folder / "flown", *judged)
    return page


@pytest.mark.long
@pytest.mark.parametrize("made", [demonstration, beluga, torpedo, judged_log])
def test_a_page_of_every_kind_is_whole(made: Callable[[Path], Path], tmp_path: Path) -> None:
    pytest.importorskip("playwright.sync_api")
    path = made(tmp_path)
    assert path.stat().st_size < 8_000_000
    told, code = looked(path)
    if code is None:  # a browser that hangs once is not the page's fault; twice is
        told, code = looked(path)
    assert code == 0, told
    assert told.split()[-1] == "accessible"


def looked(path: Path) -> tuple[str, int | None]:
    """What a look at a page told, and its exit code; none where the browser came to no end."""
    command = [sys.executable, "-m", "tests.report.in_browser", str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True) as looking:
        try:
            return looking.communicate(timeout=300)[0], looking.returncode
        except subprocess.TimeoutExpired:
            os.killpg(looking.pid, signal.SIGKILL)  # the driver, and with its pipe the browser
            return looking.communicate()[0], None
