"""Wrong input to flights and to the check of missions and autopilots: one sentence, exit code 2."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

import seatrial as st
from seatrial.base import files as whole_file
from seatrial.base import run as run_directory
from seatrial.base.errors import SeatrialError
from seatrial.base.toml_file import file_kind
from seatrial.cli import app
from tests.flight.flying import OUT, grouped

CAMPAIGN = 'format = 1\nname = "a"\nvehicle = "cwolf"\n[[stages]]\nname = "s"\n'
SENSORS = "format = 1\n[sensors.position]\nnoise_m = 0.1\n"
RECIPE = 'format = 1\ntruth = "truth.toml"\n'
GEOGRAPHIC = """
format = 1
name = "north"
speed_m_s = 1.5
acceptance_radius_m = 5.0
origin = { latitude_deg = 63.44, longitude_deg = 10.4 }
[[legs]]
latitude_deg = 63.4406
longitude_deg = 10.4
depth_m = 5.0
"""


FLOWN = ("out.toml", "--vehicle", "cwolf", "--autopilot", "cwolf")


def call(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with a file of every kind."""
    monkeypatch.chdir(tmp_path)
    for name, text in {
        "out.toml": OUT,
        "vehicle.toml": st.Vehicle.load("cwolf").to_toml(),
        "autopilot.toml": st.Autopilot.load("cwolf").to_toml(),
        "campaign.toml": CAMPAIGN,
        "sensors.toml": SENSORS,
        "recipe.toml": RECIPE,
        "geographic.toml": GEOGRAPHIC,
        "empty.toml": " \n",
        "log.csv": "t_s,cmd.SbU\n0,1\n",
    }.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "wide.toml").write_bytes(OUT.encode("utf-16"))
    (tmp_path / "binary.toml").write_bytes(bytes(range(256)))
    (tmp_path / "folder").mkdir()
    return tmp_path


def refused(here: Path, arguments: list[str], words: str) -> None:
    """The verb ends with exit code 2 and one message, and the folder is as before."""
    before = sorted(here.rglob("*"))
    result = call(*arguments)
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.output
    assert words in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert sorted(here.rglob("*")) == before


@pytest.mark.parametrize(
    ("vehicle", "autopilot", "mission", "words"),
    [
        ("out.toml", "cwolf", "out.toml", "out.toml: expected a vehicle file, found a mission; check which"),
        ("autopilot.toml", "cwolf", "out.toml", "expected a vehicle file, found an autopilot"),
        ("cwolf", "vehicle.toml", "out.toml", "expected an autopilot file, found a vehicle"),
        ("cwolf", "out.toml", "out.toml", "expected an autopilot file, found a mission"),
        ("cwolf", "cwolf", "vehicle.toml", "expected a mission file, found a vehicle"),
        ("cwolf", "cwolf", "autopilot.toml", "expected a mission file, found an autopilot"),
        ("cwolf", "cwolf", "campaign.toml", "expected a mission file, found a campaign"),
        ("cwolf", "cwolf", "sensors.toml", "expected a mission file, found a set of sensors"),
        ("cwolf", "cwolf", "empty.toml", "expected a mission file, found an empty file"),
        ("cwolf", "cwolf", "", "mission: expected a name or a path, found an empty text"),
        ("cwolf", "", "out.toml", "autopilot: expected a name or a path, found an empty text"),
        ("cwolf", "cwolf", "folder", "folder: not readable as a mission file"),
        ("cwolf", "cwolf", "wide.toml", "wide.toml: not readable as a mission file (not a text"),
        ("cwolf", "cwolf", "log.csv", "log.csv: line 1"),
        ("folder", "cwolf", "out.toml", "folder: expected a vehicle file"),
        ("cwolf", "binary.toml", "out.toml", "binary.toml: expected an autopilot file"),
        ("bluerov2-heavy", "cwolf", "out.toml", "depends on the supply voltage; give it in V, --voltage"),
        ("remus100", "cwolf", "out.toml", "the loop heave needs the row Z"),
    ],
)
def test_a_file_in_the_wrong_place_is_called_by_its_kind(
    here: Path, vehicle: str, autopilot: str, mission: str, words: str
) -> None:
    refused(here, ["fly", vehicle, autopilot, mission, "--figures", "none"], words)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--current", "50", "0", "0"], "current: expected at most 15 m/s"),
        (["--current", "0", "1e300", "0"], "current: expected at most 15 m/s"),
        (["--voltage", "14800000"], "voltage_v: expected at most 1000 V"),
        (["--max-time", "1e9"], "max_time_s: expected at most 250000 s"),
        (["--model", "bluerov2-heavy"], "model: expected the actuators of cwolf, PL, PU"),
        (["--model", "autopilot.toml"], "expected a vehicle file, found an autopilot"),
        (["--outage", "position@1e9"], "outages: position: expected a beginning within the flight"),
        (["--outage", "position@9-5"], "expected a beginning from 0 on and a later end"),
        (["--fault", "SbU@5", "--fault", "SbU@9"], "SbU fails twice"),
        (["--sensors", "out.toml"], "expected a set of sensors, found a mission"),
        (["--sensors", "late.toml"], "key latency_s: expected at most 1000 s"),
        (["--out", "out.toml"], "expected a folder, found a file"),
        (["--out", "out.toml/run"], "cannot be written"),
        (["--out", "x" * 300], "expected a name of at most 240 bytes, found 300"),
        (["--out", "."], "it holds files but no run.json"),
    ],
)
def test_an_option_is_answered_in_a_sentence(here: Path, options: list[str], words: str) -> None:
    (here / "late.toml").write_text(SENSORS + "latency_s = 1e9\n")
    refused(here, ["fly", "cwolf", "cwolf", "out.toml", "--figures", "none", *options], words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere.toml"], "expected a vehicle, campaign, mission or autopilot file or one of the built-in"),
        (["folder"], "folder is a folder, not a file"),
        ([""], "an empty name: expected"),
        (["empty.toml"], "found an empty file; seatrial new"),
        (["sensors.toml"], "found a set of sensors; fly with it"),
        (["recipe.toml"], "found the recipe of a generated trial"),
        (["out.toml", "--vehicle", "out.toml"], "expected a vehicle file, found a mission"),
        ([*FLOWN, "--current", "nan", "0", "0"], "--current: expected a finite"),
        ([*FLOWN, "--current", "90", "0", "0"], "--current: expected at most 15 m/s"),
        ([*FLOWN, "--seabed", "nan"], "--seabed: expected a finite number"),
        (["out.toml", "--vehicle", ""], "--vehicle: expected a name or a path"),
        (["out.toml", "--vehicle", "remus100", "--autopilot", "cwolf"], "the loop heave needs the row Z"),
        (["autopilot.toml", "--vehicle", "autopilot.toml"], "expected a vehicle file, found an autopilot"),
    ],
)
def test_check_is_answered_in_a_sentence(here: Path, arguments: list[str], words: str) -> None:
    refused(here, ["check", *arguments, "--figures", "none"], words)


FLY: list[tuple[dict[str, Any], str]] = [
    ({"faults": st.Fault("SbU", at_s=5)}, r"faults: expected a list such as \[st.Fault"),
    ({"faults": None}, "faults: expected a list"),
    ({"faults": "SbU@5"}, "faults: expected a list"),
    ({"faults": [st.Fault("SbU", at_s="5")]}, "faults: SbU: expected a time within the flight.*found '5'"),  # type: ignore[arg-type]
    ({"faults": [st.Fault("SbU", at_s=5, stuck_at=math.nan)]}, "stuck_at: expected -2000 to 2000 rpm"),
    ({"outages": st.Outage("position", 5)}, "outages: expected a list"),
    ({"outages": [st.Outage("position", "5")]}, "outages: position: expected times in s"),  # type: ignore[arg-type]
    ({"outages": [st.Outage(None, 5)]}, 'no group or kind of sensor "None"'),  # type: ignore[arg-type]
    ({"seabed": "a"}, "seabed: expected its depth in m"),
    ({"seabed": [20.0, -0.5, 0.0]}, "seabed: expected leg 1"),
    ({"feedback": "no"}, "feedback: expected True or False"),
    ({"max_step_s": 1e-9}, "max_step_s: expected at least 1e-05 s"),
    ({"rho": 1.025}, "rho: expected 500 to 2000 kg/m3, found 1.025"),
    ({"g": -9.81}, "g: expected 0.1 to 100 m/s2"),
    ({"sensors": [1]}, "sensors: expected {kind: sensor}"),
    ({"current": [[0.0, 0.0, 0.0]]}, "current: expected three finite numbers"),
]


@pytest.mark.parametrize(("options", "words"), FLY)
def test_fly_is_answered_in_a_sentence(options: dict[str, Any], words: str) -> None:
    with pytest.raises(SeatrialError, match=words):
        st.fly("cwolf", "cwolf", st.Mission.from_toml(OUT), **grouped(**options))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"coefficients": {"X_uu": [math.nan]}}, "coefficients: X_uu: expected finite numbers"),
        ({"coefficients": {"X_uu": -70.0}}, "coefficients: X_uu: expected finite numbers"),
        ({"coefficients": ["X_uu"]}, "coefficients: expected {name: values}"),
        ({"gains": {"heading.K_P.1": [math.inf]}}, "gains: heading.K_P.1: expected finite numbers"),
        ({"seeds": None}, "seeds: expected a list"),
        ({"seeds": "12"}, "seeds: expected a list"),
        ({"threads": -1}, "threads: expected a whole number from 1 to 1024"),
        ({"threads": 10**6}, "threads: expected a whole number from 1 to 1024"),
        ({"faults": [st.Fault("SbU", 5), []]}, "faults: expected either faults for all cases or a list"),
        ({"current": [[0.0, 0.0], [0.0]]}, "current: expected three finite numbers"),
        ({"current": [[0.0, 0.0, 0.0], [99.0, 0.0, 0.0]]}, "current: expected at most 15 m/s, .* found 99"),
    ],
)
def test_a_batch_is_answered_in_a_sentence(options: dict[str, Any], words: str) -> None:
    with pytest.raises(SeatrialError, match=words):
        st.fly_batch("cwolf", "cwolf", st.Mission.from_toml(OUT), **grouped(**options))


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda: st.Mission.load(OUT), "expected the path of a mission file, found its text"),
        (lambda: st.Mission.load(None), "expected the path of a mission file, found NoneType"),  # type: ignore[arg-type]
        (lambda: st.Mission.from_toml(b"x"), "expected the text of a mission file, found bytes"),  # type: ignore[arg-type]
        (lambda: st.Mission("out.toml"), "use Mission.load"),  # type: ignore[arg-type]
        (lambda: st.fly("cwolf", "cwolf", None), "mission: expected an st.Mission, a name or a path"),  # type: ignore[arg-type]
        (
            lambda: st.fly(st.Mission.from_toml(OUT), "cwolf", "cwolf"),  # type: ignore[arg-type]
            "vehicle: expected an st.Vehicle, a name or a path, found seatrial.flight.mission.Mission",
        ),
    ],
)
def test_an_object_of_another_kind_is_answered_in_a_sentence(made: Any, words: str) -> None:
    with pytest.raises(SeatrialError, match=words):
        made()


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("name", ["out.toml", "geographic.toml"])
def test_a_byte_order_mark_changes_nothing(here: Path, name: str) -> None:
    text = (here / name).read_text()
    (here / "marked.toml").write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert st.Mission.load("marked.toml").to_toml() == st.Mission.from_toml(text).to_toml()
    assert file_kind("marked.toml") == "a mission"
    assert call("check", "marked.toml", "--figures", "none").exit_code == 0


@pytest.mark.usefixtures("here")
def test_a_vehicle_without_actuators_is_checked_for_a_mission(here: Path) -> None:
    text = (here / "vehicle.toml").read_text()
    (here / "hull.toml").write_text(text[: text.index("[motors")])
    result = call("check", "out.toml", "--vehicle", "hull.toml", "--figures", "none")
    assert result.exit_code == 0, result.output
    assert "no actuator of cwolf drives ahead" in result.stdout


@pytest.mark.usefixtures("here")
def test_a_long_name_of_a_mission_becomes_a_short_folder(here: Path) -> None:
    (here / "long.toml").write_text(OUT.replace('"out"', f'"{"x" * 200}"'))
    assert call("fly", "cwolf", "cwolf", "long.toml", "--figures", "none").exit_code == 0
    assert [len(path.name) for path in (here / "runs").iterdir()] == [80]


def test_speeds_that_guidance_does_not_give_are_said() -> None:
    text = OUT.replace("speed_m_s = 1.5", "speed_m_s = 90.0")
    flight = st.fly("cwolf", "cwolf", st.Mission.from_toml(text), conditions=st.Conditions(max_time_s=30.0))
    assert any("Legs ask for up to 90 m/s, and guidance keeps to" in line for line in flight.sentences())


def test_a_flight_of_a_second_says_nothing_of_starts_per_minute() -> None:
    flight = st.fly("cwolf", "cwolf", st.Mission.from_toml(OUT), conditions=st.Conditions(max_time_s=1.0))
    assert not any("starts and stops" in line for line in flight.sentences())


@pytest.mark.parametrize("written", [0, 1, 4])
def test_ctrl_c_while_a_flight_is_written_leaves_nothing(
    here: Path, monkeypatch: pytest.MonkeyPatch, written: int
) -> None:
    """Interrupted after so many files of the run directory."""
    write, count = whole_file.write_atomic, 0

    def interrupted(path: Path, content: bytes) -> None:
        nonlocal count
        count += path.name != ".probe"
        if count > written:
            raise KeyboardInterrupt
        write(path, content)

    monkeypatch.setattr(run_directory, "write_atomic", interrupted)
    result = call("fly", "cwolf", "cwolf", "out.toml", "--figures", "none")
    assert result.exit_code == 130
    assert "interrupted" in result.stderr
    assert not list((here / "runs").rglob("*"))


def test_ctrl_c_while_the_log_is_packed_leaves_nothing(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(self: st.Flight) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(st.Flight, "table", interrupted)
    assert call("fly", "cwolf", "cwolf", "out.toml", "--figures", "none", "--out", "run").exit_code == 130
    assert not (here / "run.partial").exists()
    assert not (here / "run").exists()
