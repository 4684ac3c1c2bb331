"""`rare` and `falsify`: what is printed, written and refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from seatrial.cli import app
from tests.verification.test_rare import OUT

CAMPAIGN = """
format = 1
name = "short"
vehicle = "cwolf"
seed = 3
[verification]
missions = ["out.toml"]
coefficients = { X_uu = 10.0 }
current = { speed_m_s = { normal = [0.2, 0.08] } }
[[verification.requirements]]
name = "keeps its path"
holds = "true_cross_track_largest_m <= 4.5"
probability = 0.9
"""


@pytest.fixture
def campaign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out.toml").write_text(OUT)
    path = tmp_path / "short.toml"
    path.write_text(CAMPAIGN)
    return path


def run(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, list(arguments))
    return result.exit_code, result.output


def test_a_failure_is_found_flown_and_kept_as_a_case(campaign: Path) -> None:
    page = campaign.with_name("search.html")
    code, text = run("falsify", str(campaign), "--figures", "none", "--report", str(page))
    assert code == 1, text
    assert "keeps its path" in page.read_text()
    assert "short: falsified." in text
    assert (campaign.parent / "runs" / "short-falsified-keeps-its-path" / "flight.json").is_file()
    case = (campaign.parent / "runs" / "short-falsified" / "cases.toml").read_text()
    campaign.write_text(CAMPAIGN + case)
    code, text = run("verify", str(campaign), "--runs", "64", "--figures", "none")
    assert code == 1, text
    assert "regression case falsified: keeps its path" in text.lower()


def test_rare_failures_say_probability_and_interval(campaign: Path) -> None:
    page = campaign.with_name("rare.html")
    code, text = run("rare", str(campaign), "--population", "100", "--json", "--report", str(page))
    assert page.is_file()
    found = json.loads(text)
    event = found["requirements"][0]["event"]
    assert event["interval"][0] < event["estimate"] < event["interval"][1]
    assert code == (0 if found["held"] else 1)
    assert (Path(found["run_directory"]) / "rare.json").is_file()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("verify", "--rare"), "use `seatrial rare CAMPAIGN`"),
        (("verify", "--population", "200"), "use `seatrial rare CAMPAIGN --population`"),
        (("verify", "--falsify"), "use `seatrial falsify CAMPAIGN`"),
        (("verify", "--boundary", "payload_kg=0:1"), "use `seatrial boundary CAMPAIGN NAME=FROM:TO`"),
        (("verify", "--log", "box"), "use `seatrial verify-log CAMPAIGN LOG`"),
        (("verify", "--no-figures"), "use --figures none"),
        (("verify", "--pdf"), "use --figures pdf"),
        (("rare", "--requirement", "keeps its pat"), "unknown"),
        (("rare", "--population", "205"), "multiple of ten"),
        (("falsify", "--within", "20"), "0.1 to 8"),
    ],
)
def test_what_moved_or_cannot_be_is_refused(campaign: Path, arguments: tuple[str, ...], words: str) -> None:
    result = CliRunner().invoke(app, [arguments[0], str(campaign), *arguments[1:]])
    assert result.exit_code == 2
    assert words in " ".join(result.output.split())
    assert not (campaign.parent / "runs").exists()
