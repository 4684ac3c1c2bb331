"""Drawn cases of a verification: repeatable by number, distributed as the table says, independent."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
import pytest
from numpy.typing import NDArray

import seatrial as st
from seatrial.base.errors import CampaignError, SimulationError
from seatrial.cli.new import EXAMPLES
from seatrial.identification.fitted import Fitted
from seatrial.verification.draws import Draws, draw_missions
from seatrial.verification.requirement import obstacles
from seatrial.verification.table import Obstacle, VerificationTable, parse_verification
from tests.flight.flying import OUT, mission

Array = NDArray[np.float64]

K = 4000
FOUR = 4.0 / math.sqrt(K)
"""Four standard deviations of the mean of K numbers of variance one; none of some 50 comparisons misses it
by chance more often than once in 300 choices of the seed."""

FULL = """
coefficients = { X_uu = 10.0, "stern.gain" = 5.0 }
[verification.current]
speed_m_s = { rayleigh = 0.1 }
vertical_m_s = 0.02
turbulence_m_s = [0.0, 0.1]
[[verification.faults]]
actuator = "stern"
probability = 0.2
[[verification.faults]]
actuator = "any"
kind = "stuck"
command = 600.0
probability = 0.1
between_s = [100.0, 200.0]
[[verification.outages]]
sensor = "dvl"
probability = 0.3
duration_s = { normal = [20.0, 5.0] }
between_s = [0.0, 400.0]
[verification.start]
position_m = 2.0
depth_m = 0.3
heading_deg = "any"
speed_m_s = [0.5, 1.5]
"""


def parsed(text: str, *, missions: str = '"farm.toml"') -> VerificationTable:
    return parse_verification(f"[verification]\nmissions = [{missions}]\n{text}", "campaign.toml")


@pytest.fixture(scope="module")
def farm() -> st.Mission:
    return st.Mission.load(EXAMPLES / "missions" / "farm.toml")


@pytest.fixture(scope="module")
def deep() -> st.Mission:
    text = 'format = 1\nname = "deep"\nspeed_m_s = 1.0\nacceptance_radius_m = 3.0\n'
    text += "start = { north_m = 5.0, east_m = -7.0, depth_m = 10.0 }\n"
    return st.Mission.from_toml(text + "[[legs]]\nnorth_m = 100.0\neast_m = 40.0\ndepth_m = 10.0\n")


@pytest.fixture(scope="module")
def cases(deep: st.Mission) -> Draws:
    return draw_missions(parsed(FULL), Fitted.of("cwolf"), [deep], seed=5, numbers=K)


def test_law_a_case_depends_on_seed_and_number_alone(cases: Draws, deep: st.Mission) -> None:
    failing = [case for case, *_ in cases.faults[:2]] + [case for case, *_ in cases.outages[:2]]
    for number in (0, K - 1, *failing):
        alone = draw_missions(parsed(FULL), Fitted.of("cwolf"), [deep], seed=5, numbers=[number])
        same = cases.take([number])
        for name in ("numbers", "mission", "current", "turbulence", "position", "attitude", "nu", "seeds"):
            np.testing.assert_array_equal(getattr(alone, name), getattr(same, name), err_msg=name)
        assert (alone.faults, alone.outages) == (same.faults, same.outages)
        for name, column in same.coefficients.items():
            assert alone.coefficients[name].tolist() == column.tolist()
        for name, column in same.causes.items():
            assert alone.causes[name].tolist() == column.tolist()


def test_golden_a_case_of_a_seed_stays_the_same(cases: Draws) -> None:
    """Missions that a report names by number fly again: no later version draws them in another order."""
    four = cases.take([4])
    assert four.seeds.tolist() == [5111146439479918]
    found = {
        "current": four.current[0],
        "turbulence": four.turbulence[0, :1],
        "position": four.position[0],
        "heading": four.attitude[0, 2:],
        "ahead": four.nu[0, :1],
        "X_uu": four.coefficients["X_uu"],
        "stern.gain": four.coefficients["PL.gain"],
        "fault": np.array(four.faults[0][2:]),
        "outage": np.array(four.outages[0][2:]),
    }
    frozen = {
        "current": [-0.22238505, 0.06389249, 0.01209684],
        "turbulence": [0.00579928],
        "position": [4.55437584, -9.32940289, 9.8572447],
        "heading": [0.326407],
        "ahead": [0.46947621],
        "X_uu": [-11.0312783],
        "stern.gain": [1.04459994],
        "fault": [40.69190292, 0.0],
        "outage": [30.79841790, 42.72954648],
    }
    for name, values in frozen.items():
        # The digits that stand here; special functions of other libraries differ in the last of sixteen.
        np.testing.assert_allclose(found[name], values, rtol=2e-6, atol=1e-12, err_msg=name)
    assert (four.faults[0][1], four.outages[0][1]) == ("SbU", 3)


def test_a_further_cause_changes_none_of_the_others(cases: Draws, deep: st.Mission) -> None:
    first_only = FULL[: FULL.index('[[verification.faults]]\nactuator = "any"')]
    fewer = draw_missions(parsed(first_only), Fitted.of("cwolf"), [deep], seed=5, numbers=200)
    both = cases.take(range(200))
    assert fewer.current.tolist() == both.current.tolist()
    assert fewer.seeds.tolist() == both.seeds.tolist()
    assert fewer.coefficients["X_uu"].tolist() == both.coefficients["X_uu"].tolist()
    assert fewer.faults == [row for row in both.faults if row[3] == 0.0]  # the second entry's stick at 600


def test_current_is_distributed_as_asked(cases: Draws) -> None:
    speed = np.hypot(cases.current[:, 0], cases.current[:, 1])
    # Rayleigh: mean s sqrt(pi/2), standard deviation 0.655 s.
    assert speed.mean() == pytest.approx(0.1 * math.sqrt(math.pi / 2.0), abs=0.0655 * FOUR)
    towards = np.arctan2(cases.current[:, 1], cases.current[:, 0])
    for k in (1, 2):  # first and second harmonic of a uniform direction: variance 1/2
        assert abs(np.exp(1j * k * towards).mean()) < FOUR
    down = cases.current[:, 2] / 0.02
    assert abs(down.mean()) < FOUR
    assert down.std() == pytest.approx(1.0, abs=FOUR)  # of a deviation: 1/sqrt(2 K)
    strength = cases.turbulence[:, 0]
    assert strength.mean() == pytest.approx(0.05, abs=0.0289 * FOUR)  # uniform: width / sqrt(12)
    np.testing.assert_allclose(cases.turbulence, np.outer(strength, [1.0, 1.0, 0.55]), rtol=1e-12)


def test_waves_are_drawn_and_change_none_of_the_others(cases: Draws, deep: st.Mission) -> None:
    sea = "[verification.waves]\nheight_m = { rayleigh = 0.3 }\nspreading_deg = 20.0\n"
    rough = draw_missions(parsed(FULL + sea), Fitted.of("cwolf"), [deep], seed=5, numbers=K)
    height, period, toward, spreading, peakedness = rough.waves.T
    assert height.mean() == pytest.approx(0.3 * math.sqrt(math.pi / 2.0), abs=0.3 * 0.655 * FOUR)
    np.testing.assert_allclose(period, np.maximum(4.3 * np.sqrt(height), 1.0), rtol=1e-12)
    assert abs(np.exp(1j * toward).mean()) < FOUR
    assert set(spreading) == {math.radians(20.0)}
    assert set(peakedness) == {3.3}
    assert not cases.waves[:, 0].any()
    for name in ("current", "turbulence", "position", "attitude", "nu", "seeds"):
        np.testing.assert_array_equal(getattr(rough, name), getattr(cases, name), err_msg=name)
    assert {"wave height, m", "waves from ahead at the start, share"} <= set(rough.causes)
    # A period that would let the sea break is made longer.
    short = parsed("[verification.waves]\nheight_m = 1.0\nperiod_s = [1.0, 2.0]\ntoward_deg = 90.0\n")
    steep = draw_missions(short, Fitted.of("cwolf"), [deep], seed=5, numbers=3)
    np.testing.assert_allclose(steep.waves[:, 1], math.sqrt(2.0 * math.pi * 15.0 / 9.81), rtol=1e-12)
    assert not any("wave" in name and "period" not in name for name in steep.causes)


def test_start_is_scattered_about_that_of_the_mission(cases: Draws, deep: st.Mission) -> None:
    off = cases.position - [5.0, -7.0, 10.0]
    for axis, sd in enumerate((2.0, 2.0, 0.3)):
        assert abs(off[:, axis].mean()) < sd * FOUR
        assert off[:, axis].std() == pytest.approx(sd, rel=FOUR)
    assert abs(np.exp(1j * cases.attitude[:, 2]).mean()) < FOUR
    assert not cases.attitude[:, :2].any()


def test_vehicle_starts_with_the_water_and_its_speed_through_it(cases: Draws) -> None:
    yaw = cases.attitude[:, 2]
    cosine, sine = np.cos(yaw), np.sin(yaw)
    north = cosine * cases.nu[:, 0] - sine * cases.nu[:, 1] - cases.current[:, 0]
    east = sine * cases.nu[:, 0] + cosine * cases.nu[:, 1] - cases.current[:, 1]
    through = cosine * north + sine * east
    np.testing.assert_allclose(-sine * north + cosine * east, 0.0, atol=1e-12)
    assert cases.nu[:, 2].tolist() == cases.current[:, 2].tolist()
    assert through.min() >= 0.5 - 1e-12
    assert through.max() <= 1.5 + 1e-12
    assert through.mean() == pytest.approx(1.0, abs=0.289 * FOUR)
    np.testing.assert_allclose(cases.causes["start speed through the water, m/s"], through, atol=1e-12)


def test_start_points_about_where_the_mission_does(deep: st.Mission) -> None:
    found = draw_missions(
        parsed("start = { heading_deg = 3.0 }"), Fitted.of("cwolf"), [deep], seed=5, numbers=400
    )
    off = np.degrees(found.attitude[:, 2]) - math.degrees(math.atan2(47.0, 95.0))
    assert abs(off.mean()) < 3.0 * 4.0 / math.sqrt(400.0)  # four deviations
    assert off.std() == pytest.approx(3.0, rel=4.0 / math.sqrt(800.0))
    np.testing.assert_allclose(found.causes["start heading off to starboard, deg"], off, atol=1e-9)


@pytest.mark.parametrize(
    ("towards_deg", "ahead", "port"),
    [(0.0, -1.0, 0.0), (90.0, 0.0, 1.0), (180.0, 1.0, 0.0), (270.0, 0.0, -1.0)],
)
def test_current_is_told_as_a_bow_to_the_north_meets_it(
    towards_deg: float, ahead: float, port: float
) -> None:
    table = parsed(f"current = {{ speed_m_s = [0.1, 0.2], direction_deg = {towards_deg} }}")
    found = draw_missions(table, Fitted.of("cwolf"), [mission(OUT)], seed=5, numbers=20).causes
    speed = found["current speed, m/s"]
    np.testing.assert_allclose(found["current from ahead at the start, m/s"], ahead * speed, atol=1e-12)
    np.testing.assert_allclose(found["current from port at the start, m/s"], port * speed, atol=1e-12)


def test_outages_of_one_group_add_up(farm: st.Mission) -> None:
    entry = 'outages = [{ sensor = "dvl", probability = 1.0, duration_s = 3.0 },'
    table = parsed(entry + '{ sensor = "dvl", probability = 1.0, duration_s = 4.0 }]')
    found = draw_missions(table, Fitted.of("cwolf"), [farm], seed=5, numbers=5)
    np.testing.assert_allclose(found.causes["outage of velocity, s"], 7.0, rtol=1e-12)


def test_start_above_the_surface_is_at_the_surface(farm: st.Mission) -> None:
    table = parsed("start = { depth_m = 1.0 }")
    depth = draw_missions(table, Fitted.of("cwolf"), [farm], seed=1, numbers=400).position[:, 2]
    assert depth.min() == 0.0
    assert (depth == 0.0).mean() == pytest.approx(0.5, abs=4.0 * 0.5 / 20.0)  # four deviations of a share


def test_faults_come_as_often_and_when_asked(cases: Draws, deep: st.Mission) -> None:
    stuck = [row for row in cases.faults if row[3] == 600.0]
    dead = [row for row in cases.faults if row[3] == 0.0]
    # A stuck one of six is lost where the same one died before: of 0.1 at most 0.2 / 6.
    assert len(stuck) / K == pytest.approx(0.1, abs=0.3 * FOUR + 0.004)
    assert len(dead) / K == pytest.approx(0.2, abs=0.4 * FOUR + 0.004)
    assert {name for _, name, _, _ in dead} == {"SbU", "SbL", "PU", "PL"}
    assert {name for _, name, _, _ in stuck} == set(st.Vehicle.load("cwolf").actuators)
    assert all(100.0 <= at <= 200.0 for _, _, at, _ in stuck)
    times = np.array([at for _, _, at, _ in dead])
    assert times.max() <= deep.planned_time
    assert times.mean() == pytest.approx(0.5 * deep.planned_time, rel=4.0 * 0.577 / math.sqrt(len(dead)))
    happened = np.zeros(K)
    happened[[case for case, *_ in cases.faults]] = 1.0
    assert cases.causes["fault"].tolist() == happened.tolist()


def test_an_actuator_fails_once_and_first(deep: st.Mission) -> None:
    twice = """
    [[verification.faults]]
    actuator = "SbU"
    probability = 1.0
    between_s = [50.0, 60.0]
    [[verification.faults]]
    actuator = "SbU"
    kind = "stuck"
    probability = 1.0
    between_s = [0.0, 100.0]
    """
    rows = draw_missions(parsed(twice), Fitted.of("cwolf"), [deep], seed=5, numbers=200).faults
    assert [case for case, *_ in rows] == list(range(200))
    for _, _, at, command in rows:
        assert at < 60.0 if math.isnan(command) else 50.0 <= at <= 60.0
    assert any(math.isnan(command) for *_, command in rows)
    assert any(command == 0.0 for *_, command in rows)


def test_outages_come_as_often_and_as_long_as_asked(cases: Draws) -> None:
    assert len(cases.outages) / K == pytest.approx(0.3, abs=0.458 * FOUR)
    duration = np.array([stop - start for _, _, start, stop in cases.outages])
    count = math.sqrt(len(duration))
    assert duration.mean() == pytest.approx(20.0, abs=4.0 * 5.0 / count)
    assert duration.std() == pytest.approx(5.0, rel=4.0 / math.sqrt(2.0) / count)
    assert {group for _, group, _, _ in cases.outages} == {
        st._core.autopilot_names()["groups"].index("velocity")
    }
    assert all(0.0 <= start <= 400.0 for _, _, start, _ in cases.outages)


def test_law_causes_are_independent(cases: Draws) -> None:
    apart = [
        "current speed, m/s",
        "current from ahead at the start, m/s",
        "current down, m/s",
        "turbulence, m/s",
        "start off to the north, m",
        "start off to the east, m",
        "start below the mission's, m",
        "start heading off to starboard, deg",
        "start speed through the water, m/s",
        "fault",
        "outage of velocity, s",
        "coefficient X_uu, sigmas",
        "coefficient SbU.gain, sigmas",
    ]
    assert set(apart) <= set(cases.causes)
    columns = np.array([cases.causes[name] for name in apart] + [cases.seeds.astype(float)])
    correlation = np.corrcoef(columns)
    # 91 pairs: 4.5 deviations of 1/sqrt(K) leave one seed in 1600 that misses by chance.
    for a, b in combinations(range(len(columns)), 2):
        assert abs(correlation[a, b]) < 4.5 / math.sqrt(K), (a, b)


def test_tied_coefficients_have_one_column(cases: Draws) -> None:
    named = [name for name in cases.causes if name.startswith("coefficient")]
    assert named == ["coefficient X_uu, sigmas", "coefficient SbU.gain, sigmas"]
    assert cases.causes[named[1]].std() == pytest.approx(1.0, abs=FOUR)


def test_missions_are_flown_by_weight(farm: st.Mission, deep: st.Mission) -> None:
    table = parsed("", missions='"farm.toml", { file = "deep.toml", weight = 3.0 }')
    found = draw_missions(table, Fitted.of("cwolf"), [farm, deep], seed=3, numbers=1000)
    share = float(np.mean(found.mission == 1))
    assert share == pytest.approx(0.75, abs=4.0 * math.sqrt(0.75 * 0.25 / 1000.0))
    in_order = [found.take(np.flatnonzero(found.mission == index)) for index in (0, 1)]
    assert found.causes["mission deep"].sum() == len(in_order[1])
    assert "mission farm" not in found.causes  # it would say the same
    np.testing.assert_array_equal(in_order[0].numbers, np.flatnonzero(found.mission == 0))
    assert in_order[1].position[:, 2].min() > 5.0


def test_rows_follow_the_cases_that_are_taken(cases: Draws) -> None:
    number = cases.faults[3][0]
    taken = cases.take([0, number])
    assert {case for case, *_ in taken.faults} <= {0, 1}
    assert [row[1:] for row in taken.faults if row[0] == 1] == [
        row[1:] for row in cases.faults if row[0] == number
    ]


def test_defaults_suit_the_missions(farm: st.Mission) -> None:
    found = draw_missions(parsed(""), Fitted.of("cwolf"), [farm], seed=1, numbers=500)
    speed = found.causes["current speed, m/s"]
    assert speed.min() > 0.0
    assert speed.max() <= 0.15  # a quarter of the round's 0.6 m/s
    np.testing.assert_allclose(found.turbulence[:, 0], 0.1 * speed, rtol=1e-12)
    assert (found.faults, found.outages, found.coefficients, found.notes) == ([], [], {}, ())


def test_nominal_coefficients_are_asked_for_by_name(farm: st.Mission) -> None:
    fitted = Fitted.of("cwolf", percent={"X_uu": 10.0})
    table = parsed('coefficients = "nominal"')
    assert draw_missions(table, fitted, [farm], seed=1, numbers=3).coefficients == {}
    assert list(draw_missions(parsed(""), fitted, [farm], seed=1, numbers=3).coefficients) == ["X_uu"]


def test_what_is_fixed_is_no_cause(farm: st.Mission) -> None:
    table = parsed(
        "current = { speed_m_s = 0.2, direction_deg = 90, turbulence_m_s = 0.0 }\n"
        "start = { position_m = 0.0, depth_m = 0.0, heading_deg = 0.0 }"
    )
    found = draw_missions(table, Fitted.of("cwolf"), [farm], seed=1, numbers=4)
    assert found.causes == {}
    np.testing.assert_allclose(found.current, np.tile([0.0, 0.2, 0.0], (4, 1)), atol=1e-16)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('faults = { actuator = "sterm", probability = 0.1 }', 'no actuator or group "sterm"; did you mean'),
        (
            'faults = { actuator = "stern", kind = "stuck", command = 9000.0, probability = 0.0 }',
            "PL: command: expected -2000 to 2000 rpm, found 9000",
        ),
        ('outages = { sensor = "sonar", probability = 0.0, duration_s = 1.0 }', 'kind of sensor "sonar"'),
    ],
)
def test_failures_that_the_vehicle_cannot_have_are_refused(farm: st.Mission, text: str, message: str) -> None:
    with pytest.raises(SimulationError, match=message):
        draw_missions(parsed(text), Fitted.of("cwolf"), [farm], seed=1, numbers=3)


def test_missions_must_be_those_of_the_table(farm: st.Mission) -> None:
    with pytest.raises(CampaignError, match="expected the 1 of the table"):
        draw_missions(parsed(""), Fitted.of("cwolf"), [farm, farm], seed=1)


def test_the_clearance_of_a_polygon_of_cages_is_that_of_its_edges() -> None:
    text = 'format = 1\nname = "cages"\nspeed_m_s = 1.0\nacceptance_radius_m = 3.0\n[[legs]]\n'
    text = text.replace("[[legs]]", "start = { north_m = 0.0, east_m = -20.0 }\n[[legs]]")
    text += 'kind = "perimeter"\ncorners_m = [[20.0, 0.0], [60.0, 0.0], [60.0, 30.0], [20.0, 30.0]]\n'
    text += "distance_m = 5.0\ndepths_m = [4.0]\nstart_bearing_deg = 225.0\n"
    north, east = (
        grid.ravel() for grid in np.meshgrid(np.linspace(10.0, 70.0, 61), np.linspace(-10.0, 40.0, 51))
    )
    a, b = np.abs(north - 40.0) - 20.0, np.abs(east - 15.0) - 15.0
    true = np.hypot(np.maximum(a, 0.0), np.maximum(b, 0.0)) + np.minimum(np.maximum(a, b), 0.0)
    places = np.stack([north, east, 0.0 * north], axis=1)
    found = st.Mission.from_toml(text).core.clearance(None, places, 0.0 * places)
    np.testing.assert_allclose(found[:, 0], true, atol=1e-12)
    np.testing.assert_allclose(found[:, 1], true - 5.0, atol=1e-12)


def test_circles_of_the_campaign_stand_beside_what_the_mission_states() -> None:
    entries = [Obstacle(from_mission=True), Obstacle(north_m=1.0, east_m=2.0, radius_m=0.5)]
    assert obstacles(entries) == [(1.0, 2.0, 0.5)]
    assert obstacles([]) == []
