"""Every long work on two Dask worker processes of this machine: its result is the one of this process."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from seatrial.base.fleet import Fleet, fleet_of
from seatrial.base.work import Work
from seatrial.campaign.campaign import Campaign
from seatrial.cli import app
from seatrial.verification.boundary import Boundary
from seatrial.verification.rare import Rare
from tests.cli.test_cli_rare import CAMPAIGN
from tests.identification.test_identify import HEAD, HEAVE, STERN, SURGE, TRIALS, VERTICAL, outcome, record
from tests.tuning.test_tune import quick
from tests.verification.test_boundary import asked
from tests.verification.test_rare import HOLDS, OUT, prepared

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def fleet() -> Iterator[Fleet]:
    with fleet_of("local:2") as two:
        assert two is not None
        yield two


def test_a_search_for_rare_failures(fleet: Fleet, tmp_path: Path) -> None:
    search, scenario = Rare(population=100, populations=2, checked=0), prepared(HOLDS)
    kept = tmp_path / "run"
    here, there = search.survey(scenario), search.survey(scenario, Work(run_dir=kept, executor=fleet))
    assert there.requirements[0].to_dict() == here.requirements[0].to_dict()
    again = search.survey(scenario, Work(run_dir=kept))
    assert again.requirements[0].to_dict() == here.requirements[0].to_dict()


def test_a_boundary(fleet: Fleet) -> None:
    search = Boundary({"current_speed_m_s": (0.0, 1.2)})
    here, there = search.survey(asked()), search.survey(asked(), Work(executor=fleet))
    assert there.to_dict() == here.to_dict()


def test_a_tuning(fleet: Fleet) -> None:
    assert quick().tune(work=Work(executor=fleet)).autopilot.gains() == quick().tune().autopilot.gains()


def test_identification(fleet: Fleet) -> None:
    recordings = {"run": record(STERN, 0, 0.01, 1), "dive": record(VERTICAL, 2, 0.005, 2)}
    campaign = Campaign.from_toml(HEAD + TRIALS + SURGE + HEAVE, source="made.toml", trials=recordings)
    assert outcome(campaign.identify(work=Work(executor=fleet))) == outcome(campaign.identify())


def test_the_verb_starts_its_own_workers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out.toml").write_text(OUT)
    (tmp_path / "short.toml").write_text(CAMPAIGN)
    asked = ["rare", "short.toml", "--population", "100", "--json", "--no-resume"]
    found = [
        json.loads(CliRunner().invoke(app, [*asked, *more]).stdout)["requirements"]
        for more in ([], ["--dask", "local:2"])
    ]
    assert found[0] == found[1]
    refused = CliRunner().invoke(app, ["falsify", "short.toml", "--dask", "local:2"])
    assert refused.exit_code == 2
    assert "No such option: --dask" in refused.output
