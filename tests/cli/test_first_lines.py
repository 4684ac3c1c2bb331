"""Every verb's answer begins with three lines: how good, the worst problem, what to do next."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from seatrial.cli import app

CALLS = {
    "new": ["new", "other"],
    "check vehicle": ["check", "cwolf", "--figures", "none"],
    "check campaign": ["check", "p/campaign.toml"],
    "check mission": ["check", "p/mission.toml", "--vehicle", "p/vehicle.toml", "--figures", "none"],
    "check autopilot": ["check", "auto.toml", "--vehicle", "p/vehicle.toml"],
    "autopilot": ["autopilot", "p/vehicle.toml", "--out", "made.toml"],
    "bench": ["bench", "p/bench.toml", "--figures", "none"],
    "identify": ["identify", "p/campaign.toml", "--figures", "none"],
    "plan": ["plan", "p/vehicle.toml", "--duration", "20", "--count", "1", "--figures", "none"],
    "score": ["score", "p/vehicle.toml", "zigzag", "--columns-from", "p/campaign.toml"],
    "simulate": ["simulate", "p/vehicle.toml", "p/logs/straight.csv"],
    "fly": ["fly", "p/vehicle.toml", "auto.toml", "p/mission.toml", "--figures", "none"],
}
"""Calls in a starter project; tune and verify have theirs in the tests of these verbs."""


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A starter project `p` with start gains and a campaign that searches for a moment."""
    folder = tmp_path_factory.mktemp("lines")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for call in (["new", "p"], ["autopilot", "p/vehicle.toml", "--out", "auto.toml"]):
            assert CliRunner().invoke(app, call).exit_code == 0
    campaign = folder / "p" / "campaign.toml"
    budget = "[budget]\ngenerations = 4\nsimplex_rounds = 2\n\n[trials]"
    campaign.write_text(campaign.read_text().replace("[trials]", budget, 1))
    return folder


@pytest.mark.parametrize("verb", CALLS)
def test_three_lines_stand_first(verb: str, project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(project)
    result = CliRunner().invoke(app, CALLS[verb])
    assert result.exit_code == 0, result.output
    good, worst, after = result.stdout.splitlines()[:3]
    assert re.search(r"^\S.*: .+\. .*\d", good), good  # title: outcome. A sentence with a number
    assert worst.startswith("Worst: ")
    assert len(worst) > 15
    assert after.startswith("Next: ")
    # A concrete action: a command, or an imperative.
    assert "seatrial " in after or re.match(r"Next: [A-Z][a-z]+ \w+", after), after
    assert len({good, worst, after}) == 3
