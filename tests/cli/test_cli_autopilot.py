"""`seatrial autopilot` and `st.start_autopilot`: the file, what is told of it, refusals."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

import seatrial as st
from seatrial.base.finding import Severity
from seatrial.check.autopilot import weak_points
from seatrial.cli import app
from seatrial.cli.console import ConsoleSettings
from seatrial.cli.tune import authority_in_words
from seatrial.report.results.check_findings import sentence
from tests.flight.flying import OUT

EXAMPLES = Path(__file__).parents[2] / "examples"
STARTER = EXAMPLES / "starter" / "vehicle.toml"


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def call(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["autopilot", *map(str, arguments)])


def refused(result: Result, *words: str) -> None:
    assert result.exit_code == 2, result.output
    said = " ".join(result.stderr.split())
    assert "Traceback" not in said
    for word in words:
        assert word in said, said


def test_the_file_of_the_verb_is_that_of_the_function_and_flies() -> None:
    result = call("cwolf", "--out", "mine.toml")
    assert result.exit_code == 0, result.output
    text = Path("mine.toml").read_text()
    assert text == st.start_autopilot(st.Vehicle.load("cwolf"))
    assert text.startswith("# Start values for cwolf")
    Path("out.toml").write_text(OUT)
    flown = CliRunner().invoke(app, ["fly", "cwolf", "mine.toml", "out.toml", "--figures", "none"])
    assert flown.exit_code == 0, flown.output


def test_the_summary_tells_rows_gains_margins_and_what_next() -> None:
    told = call(STARTER).stdout
    for words in (
        "M cannot be commanded: no actuator acts in pitch.",
        "After the loss of vertical heave cannot be commanded; surge and yaw can.",
        "surge heave heading",
        "heading   K_D_s",
        "Margins",
        "WARNING: keep the speed of missions between 0.00 and",
        "Autopilot in autopilot.toml",
        f"seatrial check autopilot.toml --vehicle {STARTER}",
    ):
        assert words in told, words
    assert Path("autopilot.toml").exists()


@pytest.mark.long
def test_the_loss_of_the_only_propeller_takes_the_fins_along() -> None:
    lauv = st.Vehicle.load("lauv")
    (said,) = (line for line in authority_in_words(lauv, 1.0) if "loss of propeller" in line)
    assert "its fins lose their force, and surge, roll, pitch and yaw are lost" in said
    assert said.endswith("only its buoyancy of +1 N brings it up.")
    neutral = lauv.with_coefficients({"B": lauv.coefficients()["m"] * lauv.environment()["g"]})
    (said,) = (line for line in authority_in_words(neutral, 1.0) if "loss of propeller" in line)
    assert said.endswith('neither reaction of the safety, "surface" or "abort", brings it up.')
    # Several propellers, and no speed at all: as before.
    assert authority_in_words(lauv, 0.0) == lauv.authority_sentences(0.0)
    cwolf = st.Vehicle.load("cwolf")
    assert authority_in_words(cwolf, 1.0) == cwolf.authority_sentences(1.0)


def test_authority_is_told_at_the_speed_that_a_vehicle_with_fins_needs() -> None:
    told = call("lauv").stdout
    assert "- At 1.1 m/s surge, roll, pitch and yaw can be commanded" in told
    assert "No roll loop: the hull rights itself" in told


@pytest.mark.long
def test_json_has_all_that_is_printed() -> None:
    found = json.loads(call("cwolf", "--law", "lqr", "--period-s", "0.2", "--json").stdout)
    assert found["control"] == "lqr"
    assert found["period_s"] == tomllib.loads(Path("autopilot.toml").read_text())["period_s"] == 0.2
    assert len(found["margins"]) == 6
    assert {"mode", "speed_m_s", "phase_deg", "gain", "delay_s", "doubles_s", "verdict"} <= set(
        found["margins"][0]
    )
    low, high = found["sound_m_s"]
    assert low < high
    assert found["authority"]


def test_the_starter_project_flies_its_mission() -> None:
    run = CliRunner().invoke
    assert run(app, ["new", "mine"]).exit_code == 0
    assert call("mine/vehicle.toml", "--out", "mine/autopilot.toml").exit_code == 0
    fly = ["fly", "mine/vehicle.toml", "mine/autopilot.toml", "mine/mission.toml", "--figures", "none"]
    flown = run(app, [*fly, "--current", "0", "0.15", "0"])
    assert flown.exit_code == 0, flown.output
    assert "3 of 3 waypoints reached" in flown.stdout


@pytest.mark.long
def test_a_file_that_exists_is_replaced_only_when_told_to() -> None:
    Path("autopilot.toml").write_text("tuned for weeks")
    refused(call("cwolf"), "autopilot.toml", "is not overwritten", "--force")
    assert Path("autopilot.toml").read_text() == "tuned for weeks"
    assert call("cwolf", "--force").exit_code == 0
    assert st.Autopilot.load("autopilot.toml").name == "cwolf start"


def test_of_two_that_write_one_file_the_second_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    made = st.Autopilot.load("cwolf").to_toml()

    def overtaken(*_: object, **__: object) -> str:
        Path("autopilot.toml").write_text("the other's")
        return made

    monkeypatch.setattr("seatrial.control_design.start_autopilot.start_autopilot", overtaken)
    refused(call("cwolf"), "autopilot.toml: another program wrote this file meanwhile", "--force")
    assert Path("autopilot.toml").read_text() == "the other's"
    assert [path.name for path in Path().iterdir()] == ["autopilot.toml"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--out", "."), ("expected a file, found a folder",)),
        (("--out", "none/a.toml"), ("there is no folder none",)),
        (("--law", "mpc"), ("expected pid or lqr, found 'mpc'",)),
        (("--period-s", "0"), ("from 0.005 to 1 s, found 0",)),
        (("--period-s", "nan"), ("found nan",)),
        (("--period-s", "-1"), ("found -1",)),
    ],
)
def test_bad_options_are_refused(arguments: tuple[str, ...], words: tuple[str, ...]) -> None:
    refused(call("cwolf", *arguments), *words)
    assert not list(Path().iterdir())


def test_a_vehicle_that_cannot_be_steered_is_refused() -> None:
    text = STARTER.read_text().replace('controllable = ["X", "Z", "N"]', 'controllable = ["X", "Z"]')
    Path("lame.toml").write_text(text)
    refused(call("lame.toml"), "my-vehicle", "commands X, N and Z or M", "N:")
    with pytest.raises(st.VehicleError, match="no autopilot can be made"):
        st.start_autopilot(st.Vehicle.load("lame.toml"))


def test_weak_points_ahead_warn_and_those_astern_are_notes() -> None:
    from seatrial.control_design.margin_report import MarginRow

    def row(speed: float, doubles: float | None, phase: float = 60.0) -> MarginRow:
        grows = "pitch" if doubles else ""
        return MarginRow("hover", speed, phase, 3.0, 0.5, 1.5, doubles, grows, True, "heave")

    assert weak_points([row(-1.0, None), row(1.0, None)], (0.0, 1.0)) == []
    (note,) = weak_points([row(-1.0, 2.0), row(1.0, None)], (0.0, 1.0))
    assert note.severity == Severity.NOTE
    assert sentence(note) == (
        "Astern at 1.00 m/s and faster a motion grows (pitch); a mission does not go astern"
    )
    (warning,) = weak_points([row(0.0, None), row(1.0, 2.0)], (0.0, 0.6))
    assert warning.severity == Severity.WEAKNESS
    assert sentence(warning) == (
        "keep the speed of missions between 0.00 and 0.60 m/s, or tune the gains (seatrial tune): at 1.00 m/s"
        " a motion grows (pitch)"
    )
    (more,) = weak_points([row(0.5, 3.0), row(1.0, 2.0), row(1.5, None, 20.0)], (0.0, 0.4))
    assert sentence(more).endswith(
        "at 0.50 and 1.00 m/s a motion grows (pitch); at 1.50 m/s heave has little margin (phase 20 deg of"
        " 30)"
    )
    (small,) = weak_points([row(1.0, None, 20.0)], (0.0, 0.6))
    assert sentence(small).endswith("at 1.00 m/s heave has little margin (phase 20 deg of 30)")
    (none,) = weak_points([row(1.0, 2.0)], None)
    assert "no speed ahead is sound" in sentence(none)


@pytest.mark.long
@pytest.mark.parametrize("vehicle", ["cwolf", "lauv", STARTER])
def test_tables_fit_eighty_columns(vehicle: str | Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("seatrial.cli.console.SETTINGS", ConsoleSettings(piped_width=80))
    result = call(vehicle)
    tables = [line for line in result.stdout.splitlines() if line.startswith(" ") and line[1:2].strip()]
    assert len(tables) > 12
    assert max(len(line.rstrip()) for line in tables) <= 80
    assert not any("…" in line for line in tables)
