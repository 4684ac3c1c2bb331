"""`verify` with a vehicle, an autopilot and missions instead of a campaign file."""

from pathlib import Path
from typing import Any

import pytest

import seatrial as st
from tests.flight.flying import OUT, mission

ENDS = st.Requirement("is complete", 'ending == "complete"', probability=0.9)
WATER: dict[str, Any] = {"current": {"speed_m_s": [0.0, 0.2]}}
CONDITIONS: dict[str, Any] = {"start": {"position_m": 2.0}}

CAMPAIGN = """
format = 1
name = "cwolf"
vehicle = "cwolf"
autopilot = "cwolf"
seed = 3
[verification]
missions = ["out.toml"]
runs = 24
current = { speed_m_s = [0.0, 0.2] }
start = { position_m = 2.0 }
requirements = [{ name = "is complete", holds = 'ending == "complete"', probability = 0.9 }]
"""


def test_it_flies_what_a_file_with_the_same_keys_asks_for(tmp_path: Path) -> None:
    (tmp_path / "out.toml").write_text(mission(OUT).to_toml())
    by_file = st.Campaign.from_toml(CAMPAIGN, folder=tmp_path).verify()
    alone = st.verify(
        "cwolf",
        "cwolf",
        [tmp_path / "out.toml"],
        requirements=[ENDS],
        water=WATER,
        conditions=CONDITIONS,
        runs=24,
        seed=3,
    )
    assert alone.table().equals(by_file.table())
    assert alone.outcome == by_file.outcome
    assert [one.to_dict() for one in alone.requirements] == [one.to_dict() for one in by_file.requirements]
    assert alone.replay(7).outcome == alone.flown.metrics["ending"][7]


def test_it_leaves_a_run_directory(tmp_path: Path) -> None:
    found = st.verify(
        "cwolf", "cwolf", [mission(OUT)], runs=4, name="dock", work=st.Work(run_dir=tmp_path / "run")
    )
    assert (tmp_path / "run" / "verification.json").is_file()
    assert 'name = "dock"' in (tmp_path / "run" / "campaign.toml").read_text()
    assert "verification.replay(NUMBER)" in found.summary()
    assert "seatrial verify" not in found.summary()


def test_an_autopilot_of_another_vehicle_is_said_first() -> None:
    found = st.verify("lauv", "remus100", [mission(OUT)], runs=4)
    _, worst, next_step = found.report().lines()
    assert worst.startswith("Worst: The autopilot was made for remus100, and lauv flies: at the crossover of")
    assert "seatrial autopilot VEHICLE" in next_step
    (said,) = found.to_dict()["warnings"]
    assert said.removesuffix(".").lower() in worst.lower()
    own = st.verify("lauv", "lauv", [mission(OUT)], runs=4)
    assert own.to_dict()["warnings"] == []
    assert "made for" not in own.summary()


@pytest.mark.parametrize(
    ("given", "options", "message"),
    [
        (("cwolf",), {}, "a vehicle alone"),
        (("cwolf", "cwolf"), {}, "no missions"),
        (("cwolf", "cwolf", []), {}, "missions: expected a list"),
        (("cwolf", "cwolf", [mission(OUT)]), {"water": {"curent": {}}}, "curent"),
        (("cwolf", "cwolf", [mission(OUT)]), {"current": {}}, "current: expected in water"),
        (("cwolf", "cwolf", [mission(OUT)]), {"seed": -1}, "seed: expected a whole number"),
    ],
)
def test_what_cannot_be_verified_is_refused(given: Any, options: dict[str, Any], message: str) -> None:
    with pytest.raises(Exception, match=message):
        st.verify(*given, runs=4, **options)


def test_a_campaign_is_asked_itself(tmp_path: Path) -> None:
    campaign: Any = st.Campaign.from_toml(CAMPAIGN, folder=tmp_path)
    with pytest.raises(st.CampaignError, match=r"use campaign\.verify"):
        st.verify(campaign, water=WATER)


def test_a_scenario_says_all_of_it() -> None:
    scenario = st.Scenario("cwolf", "cwolf", [mission(OUT)], runs=4)
    with pytest.raises(st.CampaignError, match="verify: seed: the scenario says that"):
        st.verify(scenario, seed=2)
    with pytest.raises(st.CampaignError, match="a strategy chooses its missions"):
        st.verify(scenario, strategy=st.Rare(), compare={"other": "cwolf"})
