"""`seatrial verify`: run directory, tables, exit codes, replay, refusals."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from rich.console import Console
from typer.testing import CliRunner, Result

import seatrial as st
from seatrial.cli import app
from seatrial.cli.console import show
from seatrial.report.plot import plotted
from seatrial.report.plot.style import save
from seatrial.verification.missions import CampaignFlights, MissionSettings
from seatrial.verification.verify import Verification
from tests.flight.flying import OUT
from tests.verification.verifying import SHORT, campaign, text


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with a campaign and its mission."""
    monkeypatch.chdir(tmp_path)
    Path("campaign.toml").write_text(text())
    for name in ("out.toml", "mission.xml"):
        Path(name).write_text(OUT)
    return tmp_path


def call(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["verify", "campaign.toml", *map(str, arguments)])


@pytest.mark.usefixtures("here")
def test_a_held_verdict_is_exit_code_0_and_leaves_a_run_directory(monkeypatch: pytest.MonkeyPatch) -> None:
    def drawn(found: Verification, folder: Path, **options: Any) -> list[Path]:
        return save(plotted(found), folder / "requirements", **options)

    monkeypatch.setattr("seatrial.report.plot.gallery", drawn)
    # A flight that a fault ends before anything settles does not keep its path.
    Path("campaign.toml").write_text(text(SHORT.replace("probability = 0.5", "probability = 0.2")))
    result = call("--junit", "reports/junit.xml")
    assert result.exit_code == 0, result.output
    run = Path("runs/short-verified")
    data = json.loads((run / "verification.json").read_text())
    assert data["outcome"] == "held"
    assert data["missions"] == {"asked": 24, "flown": 24, "of": ["out"]}
    figures = {path.name for path in (run / "figures").iterdir()}
    assert figures == {"requirements.png"}
    assert "Figures (PNG) in runs/short-verified/figures: requirements" in result.stdout
    assert ElementTree.fromstring(Path("reports/junit.xml").read_text()).get("failures") == "0"
    assert "Vehicle: cwolf. Autopilot: cwolf." in result.stderr
    good, worst, after = result.stdout.splitlines()[:3]
    assert good.startswith("short: held. 2 of 2 requirements held by cwolf on cwolf; ")
    assert "of 24 missions (out, seed 7) hold all of them." in good
    assert worst.startswith("Worst: ")
    assert "seatrial verify-log campaign.toml LOG" in after
    for name in ("keeps its path", "is complete", "Worst missions"):
        assert name in result.stdout
    assert "times real time" in (run / "summary.txt").read_text()


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("holds", ["duration_s < 0", "duration_s > 0"])
def test_failed_and_undecided_are_exit_code_1(holds: str) -> None:
    further = f'[[verification.requirements]]\nname = "lasts"\nholds = "{holds}"\nprobability = 0.99\n'
    Path("campaign.toml").write_text(text(SHORT + further))
    result = call("--figures", "none", "--json", "--runs", 8)
    assert result.exit_code == 1, result.output
    found = json.loads(result.stdout)
    assert found["outcome"] == {"<": "failed", ">": "undecided"}[holds.split()[1]]
    assert found["figures"] == []


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--autopilot", "away.toml"], "away.toml"),
        (["--autopilot", "."], "expected a run directory of `seatrial tune`"),
        (["--run", "."], "expected a run directory of `seatrial identify`"),
        (["--mission", "away.toml"], "away.toml"),
        (["--compare"], "expected another autopilot"),
        (["--junit", "campaign.toml"], '--junit campaign.toml: expected the ending .xml, found ".toml"'),
        (["--mission", "mission.xml", "--junit", "mission.xml"], "this is the file of mission mission.xml"),
        (["--junit", "/proc/away/junit.xml"], "--junit /proc/away/junit.xml: cannot be written"),
    ],
)
def test_bad_input_is_exit_code_2_and_leaves_nothing(arguments: list[str], words: str) -> None:
    result = call(*arguments)
    assert result.exit_code == 2, result.output
    assert words in result.stderr
    assert not Path("runs").exists()


@pytest.mark.usefixtures("here")
def test_a_mission_flies_again_by_its_number(here: Path) -> None:
    result = call("--replay", 17, "--figures", "none")
    assert result.exit_code == 0, result.output
    run = Path("runs/short-mission-17")
    flown = json.loads((run / "flight.json").read_text())
    flight = st.Campaign.load("campaign.toml").scenario().flights.replay(17)
    assert flown["metrics"]["distance_m"] == flight.metrics["distance_m"]
    assert {"vehicle.toml", "model.toml", "flight.parquet"} <= {path.name for path in run.iterdir()}
    assert "- keeps its path: cross_track_p95_m <= 1.0: " in result.stdout
    assert not (here / "runs" / "short-verified").exists()


@pytest.mark.usefixtures("here")
def test_the_tuned_autopilot_is_taken_where_there_is_one_and_compared() -> None:
    tuned = Path("runs/short-tuned")
    tuned.mkdir(parents=True)
    lazy = st.Autopilot.load("cwolf").with_gains({"guidance.integral_gain_m_s": 0.0})
    (tuned / "autopilot.toml").write_text(lazy.to_toml())
    result = call("--figures", "none", "--compare", "--runs", 10)
    assert result.exit_code in (0, 1), result.output
    assert "Autopilot: runs/short-tuned/autopilot.toml." in result.stderr
    assert "Against start, on the same 10 draws (McNemar's exact test, Holm)" in result.stdout
    assert (Path("runs/short-verified") / "autopilot.toml").read_text() == lazy.to_toml()


def test_tables_read_at_80_columns(here: Path) -> None:
    lazy = st.Autopilot.load("cwolf").with_gains({"guidance.integral_gain_m_s": 0.0})
    found = campaign(here).verify(gains="cwolf", runs=4, compare={"start": lazy, "tuned by hand": lazy})
    console = Console(width=80, file=io.StringIO())
    show(found.report(), console)
    lines = console.file.getvalue().splitlines()[3:]  # type: ignore[attr-defined]
    tables = lines[: lines.index(next(line for line in lines if line.startswith("- ")))]
    assert max(len(line.rstrip()) for line in tables) <= 80
    words = " ".join(tables).split()
    assert words.count("not") == words.count("shown") == 4
    for title in ("Against start", "Against tuned by hand"):
        place = next(k for k, line in enumerate(tables) if line.startswith(title))
        (row,) = (line for line in tables[place : place + 7] if line.strip().startswith("keeps its path"))
        assert row.split()[-2:] == ["not", "shown"]


@pytest.mark.usefixtures("here")
def test_ctrl_c_is_exit_code_130_and_keeps_what_was_flown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("seatrial.verification.missions.MISSION_SETTINGS", MissionSettings(chunk=8))
    fly = CampaignFlights.fly

    def stop(self: CampaignFlights, numbers: Any, **options: Any) -> Any:
        if numbers[0] == 16:
            raise KeyboardInterrupt
        return fly(self, numbers, **options)

    monkeypatch.setattr(CampaignFlights, "fly", stop)
    result = call()
    assert result.exit_code == 130, result.output
    assert "(interrupted)" in result.stdout
    data = json.loads(Path("runs/short-verified/verification.json").read_text())
    assert data["interrupted"]
    assert data["missions"]["flown"] == 16


@pytest.mark.usefixtures("here")
def test_missions_may_be_given_instead_of_the_campaigns() -> None:
    Path("home.toml").write_text(OUT.replace("60.0", "-60.0"))
    result = call("--mission", "home.toml", "--figures", "none", "--runs", 8, "--json")
    assert result.exit_code in (0, 1), result.output
    assert json.loads(result.stdout)["missions"]["of"] == ["home"]
