"""`seatrial new --like`: from a tape measure to a verdict, each step the one that the step before advises."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

import seatrial as st
from seatrial.cli import app
from seatrial.cli.new import LIKE


def run(line: str) -> str:
    """Output of a command that ends well."""
    result = CliRunner().invoke(app, line.split())
    assert result.exit_code == 0, f"{line}\n{result.output}"
    return result.output


def advice(output: str) -> str:
    """The line of the output that says what to do next."""
    found = re.search(r"^Next: (.*)$", output, re.MULTILINE)
    assert found, output
    return found[1]


@pytest.mark.parametrize("kind", LIKE)
def test_a_journey_ends_in_a_held_verdict_by_the_advice_of_each_step(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    made = run(f"new mine --like {kind}")
    step = advice(made)
    assert step == "seatrial check mine/vehicle.toml."
    step = advice(run(f"{step.removeprefix('seatrial ').rstrip('.')} --figures none"))
    assert "seatrial autopilot" in step
    step = advice(run("autopilot mine/vehicle.toml --out mine/autopilot.toml --force"))
    check, fly = (re.sub(r" --voltage VOLTS|\.$", "", part) for part in step.split("; then "))
    assert check == "seatrial check mine/autopilot.toml --vehicle mine/vehicle.toml"
    run(check.removeprefix("seatrial "))
    checked = run(
        "check mine/mission.toml --vehicle mine/vehicle.toml --autopilot mine/autopilot.toml --figures none"
    )
    assert "seatrial fly" in advice(checked)
    flown = run(f"{fly.removeprefix('seatrial ').replace('MISSION', 'mine/mission.toml')} --figures none")
    assert "complete" in flown.splitlines()[0]
    verdict = run("verify mine/campaign.toml --figures none")
    assert re.search(r"^my-campaign: held", verdict, re.MULTILINE), verdict


def test_the_frame_of_a_log_gives_thrusters_that_push_as_it_says(tmp_path: Path) -> None:
    log = Path(os.environ.get("SEATRIAL_DATA", "/nonexistent")) / "bluerov2_heavy" / "00000029_filtered.BIN"
    if not log.exists():
        pytest.skip(f"{log.name} is not in SEATRIAL_DATA")
    pytest.importorskip("pymavlink")
    run(f"new {tmp_path / 'mine'} --like {log}")
    vehicle = st.Vehicle.load(tmp_path / "mine" / "vehicle.toml")
    backwards = [name for name, facts in vehicle.actuator_info().items() if facts["reversed"]]
    # An import of the same log finds four reversed ones, too.
    assert (len(vehicle.actuators), len(backwards)) == (8, 4)


def test_a_kind_that_is_unknown_names_those_that_are_known(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["new", str(tmp_path / "mine"), "--like", "rov7"])
    assert result.exit_code == 2
    assert 'did you mean "rov' in result.output
    assert not (tmp_path / "mine").exists()


def test_completion_of_a_shell_is_offered() -> None:
    assert "--install-completion" in CliRunner().invoke(app, ["--help"]).output
