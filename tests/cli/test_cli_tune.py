"""`seatrial tune`: what it prints, where results go, exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

import seatrial as st
from seatrial.cli import app
from tests.tuning.tuning_campaigns import HEAD, HEADING, START

QUICK = HEADING.replace("generations = 6, simplex_rounds = 3", "generations = 1, simplex_rounds = 1")
HARD = QUICK.replace("rise_s = 7.0", "rise_s = 1.2")
# A hull that never goes astern is stable at all that it reaches, so that a tuning can end well.
LAUV = HEAD.replace("cwolf", "lauv", 1).replace(START.as_posix(), "lauv")
NIMBLE = """
[tuning]
samples = 1
current_m_s = 0.05
settle_s = 6.0
margins = { phase_deg = 20.0, gain_db = 3.0, delay_s = 0.05 }
budget = { population = 8, generations = 6, simplex_rounds = 3 }
[tuning.loops.heading]
steps = [20.0]
speeds_m_s = [1.318]
corridor = { rise_s = 5.0, overshoot = 0.08, settling_s = 14.0, settled = 0.08, until_s = 18.0 }
"""


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def call(tuning: str, *arguments: object, head: str = HEAD) -> Result:
    Path("small.toml").write_text(head + tuning)
    return CliRunner().invoke(app, ["tune", "small.toml", *map(str, arguments), "--threads", "1"])


def words(text: str) -> str:
    return " ".join(text.split())


def test_tables_verdict_files_and_figures_of_a_tuning() -> None:
    result = call(NIMBLE, "--verbose", head=LAUV)
    assert result.exit_code == 0, result.output
    assert result.stderr.startswith("Vehicle: lauv")
    good, worst, after = result.stdout.splitlines()[:3]
    assert good.startswith("small: tuned. 1 of 1 responses of the vehicle stay within their corridors, ")
    assert worst.startswith("Worst: ")
    assert after.startswith("Next: Verify the autopilot")
    said = words(result.stdout)
    for expected in (
        "Responses with the tuned gains",
        "Responses with the start gains",
        "Side by side",
        "start, s",
        "Gains at the breakpoints that are reached",
        "N m/rad per s",
        "Margins with the tuned gains",
        "- The response of the vehicle itself stays within its corridor, there and back",
        "sets of gains",
        "Results in runs/small-tuned: autopilot.toml, tuning.json, summary.txt, Parquet tables",
        "Figures (PNG) in runs/small-tuned/figures",
    ):
        assert expected in said, (expected, said)
    # Wide tables go into a file or a terminal of the usual width.
    assert max(len(line) for line in result.stdout.splitlines() if "│" in line or "─" in line) <= 118
    run = Path("runs/small-tuned")
    assert (run / "autopilot.toml").is_file()
    figures = {path.stem for path in (run / "figures").iterdir()}
    assert figures == {"corridor_heading", "responses_heading", "margins"}
    assert st.Autopilot.load(run / "autopilot.toml").name == "small tuned"


def test_margins_that_fall_short_are_exit_code_1_though_the_corridors_are_held() -> None:
    # The loop at 3 m/s is tuned; astern, where nobody asked, the start gains leave the hull unstable.
    result = call(HEADING, "--figures", "none")
    assert result.exit_code == 1, result.output
    said = words(result.stdout)
    assert "1 of 1 responses of the vehicle stay within their corridors" in said
    assert "hover at -1.00 m/s (unstable)" in said


def test_json_is_all_that_is_printed_and_a_violation_is_exit_code_1() -> None:
    result = call(HARD, "--json", "--figures", "none", "--out", "there")
    assert result.exit_code == 1, result.output
    plain = json.loads(result.stdout)
    assert plain["feasible"] is False
    assert plain["run_directory"] == "there"
    assert plain["figures"] == []
    assert plain["plan"]["groups"][0]["trials"][0]["steps"] == [20.0]
    assert plain["performance"][0]["trials"][0]["step"] == 20.0
    assert not Path("there/figures").exists()
    assert not Path("runs").exists()


@pytest.mark.parametrize(
    ("tuning", "arguments", "says"),
    [
        (QUICK.replace("[tuning.loops.heading]", "[tuning.loops.headin]"), [], 'did you mean "heading"'),
        ("[tuning.loops.sway]", [], "no mode of the autopilot cwolf start uses sway"),
        (QUICK, ["--run", "no_such_run"], "no_such_run"),
        (QUICK, ["--run", "lauv"], "expected a fit of cwolf, found one of lauv"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(tuning: str, arguments: list[str], says: str) -> None:
    result = call(tuning, *arguments)
    assert result.exit_code == 2, result.output
    assert says in words(result.stderr)
    assert "Traceback" not in result.output
    assert not Path("runs").exists()


def test_ctrl_c_is_exit_code_130_and_nothing_is_published(monkeypatch: pytest.MonkeyPatch) -> None:
    from seatrial.tuning import objective

    flown: list[int] = []
    fly = objective.Objective.flown

    def interrupted(self, gains, *, headroom=objective.SETTINGS.headroom_share):  # type: ignore[no-untyped-def]
        flown.append(1)
        if len(flown) == 3:
            raise KeyboardInterrupt
        return fly(self, gains, headroom=headroom)

    monkeypatch.setattr(objective.Objective, "flown", interrupted)
    result = call(HEADING)
    assert result.exit_code == 130, result.output
    assert result.stdout.startswith("small: interrupted. ")
    assert "Next: Run the same command again" in result.stdout
    assert not Path("runs/small-tuned").exists()
