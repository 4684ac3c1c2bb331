"""What a verification refuses or remarks on names the campaign file and the key under [verification]."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import seatrial as st
from seatrial.statistics.failure_probability import share
from seatrial.verification.scenario import Scenario
from seatrial.verification.verify import Verification
from tests.flight.flying import OUT
from tests.verification.verifying import campaign

TABLE = '[verification]\nmissions = ["out.toml"]\nruns = 4\n'


def prepared(folder: Path, text: str, *, vehicle: str = "cwolf") -> Scenario:
    return campaign(folder, TABLE + text, vehicle=vehicle).scenario()


def flown(folder: Path, text: str, *, mission: str = OUT) -> Verification:
    return campaign(folder, TABLE + text).verify(missions=[st.Mission.from_toml(mission)])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            'faults = { actuator = "sterm", probability = 0.1 }',
            'key faults: the vehicle cwolf has no actuator or group "sterm"; did you mean "stern"?',
        ),
        (
            'faults = [{ probability = 0.1 }, { actuator = "SbU", kind = "stuck", command = 9e3, probability'
            " = 0.1 }]",
            "key faults[2]: SbU: command: expected -2000 to 2000 rpm, found 9000.0",
        ),
        (
            "faults = { probability = 0.1, between_s = [1e6, 2e6] }",
            "faults, key between_s: expected a beginning within the longest flight, 0 to 420 s, found 1e+06",
        ),
        (
            'outages = { sensor = "dvll", probability = 0.1, duration_s = 3.0 }',
            'key outages: there is no group or kind of sensor "dvll"; did you mean "dvl"?',
        ),
        (
            'outages = { sensor = "dvl", probability = 0.1, duration_s = 3.0, between_s = [1e6, 2e6] }',
            "outages, key between_s: expected a beginning within the longest flight",
        ),
        (
            'requirements = { name = "r", holds = "cross_trak_p95_m < 2" }',
            "requirements 'r', key holds: \"cross_trak_p95_m\" is no metric of a mission; did you mean",
        ),
        ("seabed = 2.0", "key seabed: expected the start of out above the bottom, which is at 2 m there"),
        ('sensors = "tipical"', 'key sensors: expected "typical", "perfect" or a file such as sensors.toml,'),
        ('sensors = "away.toml"', "key sensors: "),
        ('sensors = "out.toml"', "key sensors: "),
        (
            'coefficients = { "*_uuu" = 10.0 }',
            "key coefficients: cwolf has no coefficient '*_uuu'; did you mean",
        ),
        ("coefficients = { x_g = 10.0 }", "key coefficients: x_g of cwolf is zero"),
        ("voltage_v = 4800.0", "key voltage_v: expected at most 1000 V, found 4800"),
        ("max_time_s = 1e9", "key max_time_s: expected a number from 0.001 to 3.15576e+07, found 1e+09"),
        (
            "current = { speed_m_s = [0.0, 30.0] }",
            "current, key speed_m_s: expected at most 15 m/s, faster than any ocean current, found 30;",
        ),
        ("current = { speed_m_s = { rayleigh = 9.0 } }", "current, key speed_m_s: expected at most 15 m/s"),
        ("current = { vertical_m_s = 20.0 }", "current, key vertical_m_s: expected at most 15 m/s"),
        ("waves = { height_m = 30.0 }", "waves, key height_m: expected 0 to 20 m, found 30"),
        ("waves = { height_m = 1.0, period_s = [5.0, 50.0] }", "waves, key period_s: expected 1 to 30 s"),
        ("current = { walk_m_s = 9.0 }", "current, key walk_m_s: expected a standard deviation from 0 to 5"),
        ("current = { turbulence_m_s = 30.0 }", "current, key turbulence_m_s: expected 0 to 5 m/s, found 30"),
        (
            "current = { turbulence_times_s = [1e-4, 1.0] }",
            "current, key turbulence_times_s: expected two times",
        ),
    ],
)
def test_what_vehicle_or_mission_refuse_is_told_by_file_and_key(
    tmp_path: Path, text: str, words: str
) -> None:
    with pytest.raises(st.SeatrialError, match=re.escape(words)) as refused:
        prepared(tmp_path, text)
    assert str(refused.value).startswith("campaign.toml: verification, ")


def test_a_supply_that_is_needed_is_asked_for_by_its_key(tmp_path: Path) -> None:
    with pytest.raises(st.SimulationError) as refused:
        prepared(tmp_path, "", vehicle="bluerov2-heavy")
    assert str(refused.value).startswith("campaign.toml: verification, key voltage_v: the thrust of bluerov2")
    assert "--voltage" not in str(refused.value)
    assert not any(
        "voltage_v" in note for note in prepared(tmp_path, "voltage_v = 16.0", vehicle="bluerov2-heavy").notes
    )


def test_a_supply_that_nothing_needs_is_remarked_on(tmp_path: Path) -> None:
    (note,) = (one for one in prepared(tmp_path, "voltage_v = 48.0").notes if "voltage_v" in one)
    assert note.startswith("voltage_v = 48 under [verification] does nothing: no thrust of cwolf depends")


def test_an_autopilot_of_another_vehicle_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    made = campaign(tmp_path, TABLE)
    before = sorted(tmp_path.iterdir())
    with pytest.raises(st.VehicleError, match="bluerov2-heavy"):
        made.verify(gains="bluerov2-heavy", work=st.Work(run_dir=tmp_path / "runs" / "short"))
    with pytest.raises(st.VehicleError, match="bluerov2-heavy"):
        made.verify(compare={"another": "bluerov2-heavy"}, work=st.Work(run_dir=tmp_path / "runs" / "short"))
    assert sorted(tmp_path.iterdir()) == before


def test_a_fit_of_another_vehicle_is_refused(tmp_path: Path) -> None:
    words = "campaign.toml: expected a fit of cwolf, found one of remus100 with other actuators; give the run"
    with pytest.raises(st.CampaignError, match=words):
        campaign(tmp_path, TABLE).scenario("remus100")


def test_a_campaign_that_states_nothing_asks_for_what_its_mission_and_water_have(tmp_path: Path) -> None:
    found = prepared(tmp_path, "seabed = 30\nobstacles = { north_m = 500.0, east_m = 0.0, radius_m = 1.0 }")
    assert {
        one.name: one.holds for one in found.requirements if one.name.startswith(("stays", "touches"))
    } == {"touches nothing": "clearance_m > 0", "stays off the bottom": "altitude_smallest_m > 0"}


def test_what_no_autopilot_could_fly_is_remarked_on(tmp_path: Path) -> None:
    short = flown(tmp_path, "max_time_s = 1.0")
    (time,) = (note for note in short.notes if "out of time" in note)
    assert time.startswith("4 of 4 missions end out of time, by max_time_s = 1; flying them is planned to")
    assert time in short.summary()
    assert f'value="{time}"' in short.junit()
    fast = flown(tmp_path, "", mission=OUT.replace("1.5", "9.0"))
    (speed,) = (note for note in fast.notes if "top speed" in note)
    assert re.fullmatch(r"out asks for 9 m/s, more than the top speed of cwolf, 3\.\d\d m/s\.", speed)
    carried = flown(tmp_path, "max_time_s = 5.0\ncurrent = { speed_m_s = 14.0 }")
    assert any(
        note.startswith("In 4 of 4 missions the current is faster than the top") for note in carried.notes
    )


def test_a_figure_that_no_mission_has_is_remarked_on(tmp_path: Path) -> None:
    rows = {"bottom": "altitude_smallest_m > 2", "net": "clearance_m > 2", "alert": "alert_time_s > 60",
            "calm": 'alert == "" or alert_time_s > 60'}  # fmt: skip
    asked = ", ".join(f"{{ name = '{name}', holds = '{holds}' }}" for name, holds in rows.items())
    bare = flown(tmp_path, f"requirements = [{asked}]")
    said = [note for note in bare.notes if " asks for " in note and "guidance" not in note]
    assert [note.partition(" asks for")[0] for note in said] == ['"bottom"', '"net"', '"alert"']
    assert said[0].startswith(
        '"bottom" asks for altitude_smallest_m, and there is no bottom; add seabed under'
    )
    assert said[2] == '"alert" asks for alert_time_s, which no mission has, so the requirement always fails.'
    there = "seabed = 30\nobstacles = { north_m = 500.0, east_m = 0.0, radius_m = 1.0 }\n"
    assert not any("infinite" in note for note in flown(tmp_path, f"{there}requirements = [{asked}]").notes)


def test_energy_that_the_vehicle_does_not_tell_is_refused(tmp_path: Path) -> None:
    text = 'requirements = { name = "battery", holds = "energy_wh / distance_m <= 0.1" }'
    prepared(tmp_path, text)
    with pytest.raises(st.CampaignError) as refused:
        prepared(tmp_path, text, vehicle="lauv")
    assert str(refused.value).startswith(
        "campaign.toml: verification, requirements 'battery', key holds: energy_wh is not known, lauv tells"
    )


def test_missions_that_can_be_flown_are_not_remarked_on(tmp_path: Path) -> None:
    notes = flown(tmp_path, "current = { speed_m_s = 0.3 }").notes
    assert not any("out of time" in note or "top speed" in note for note in notes)


def test_the_first_lines_tell_who_came_too_near_or_left_the_water(tmp_path: Path) -> None:
    easy = '[[verification.requirements]]\nname = "ends"\nholds = "duration_s < 1e4"\n'
    pile = "obstacles = { north_m = 30.0, east_m = 1.0, radius_m = 2.0 }\n"
    found = flown(tmp_path, pile + easy)
    hit, count = found.report().worst, int((found.flown.metrics["clearance_m"] <= 0.0).sum())
    assert count > 0
    assert f"{count} of 4 missions came too near to an obstacle" in hit
    assert re.search(r"the worst is mission \d: \d\.\d\d m inside at \d+\.\d s", hit)
    assert "too near" not in flown(tmp_path, easy).report().worst


def test_held_says_its_reservations_in_every_form(tmp_path: Path) -> None:
    """What no requirement decides on stands in the outcome, in JSON and in JUnit; the exit code stays 0."""
    asked = '[[verification.requirements]]\nname = "ends"\nholds = "duration_s < 1e4"\nprobability = 0.05\n'
    pile = "obstacles = { north_m = 30.0, east_m = 1.0, radius_m = 2.0 }\n"
    reserved = flown(tmp_path, pile + asked)
    assert reserved.held
    (one,) = (excess for excess in reserved.reservations if excess.kind == "too_near")
    assert one.count == int((reserved.flown.metrics["clearance_m"] <= 0.0).sum()) > 0
    first = reserved.report().lines()[0]
    assert f": held, but {share(one.count / 4, 'up')} of the missions came too near to an obstacle" in first
    assert reserved.to_dict()["outcome"] == "held"
    assert reserved.to_dict()["reservations"][0]["kind"] == "too_near"
    assert 'name="no requirement: came too near to an obstacle"' in reserved.junit()
    assert 'failures="0"' in reserved.junit()
    # A requirement on the same metric decides instead.
    decided = flown(tmp_path, pile + asked.replace("duration_s < 1e4", "clearance_reserve_m > -9"))
    assert decided.held
    assert not [excess for excess in decided.reservations if excess.kind == "too_near"]
    assert ": held. " in decided.report().lines()[0]
