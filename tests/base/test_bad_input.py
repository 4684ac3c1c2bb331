"""Wrong input to the verbs: one message that names file, key or option, exit code 2, nothing left behind."""

from __future__ import annotations

import json
import os
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner, Result

from seatrial.base import files as whole_file
from seatrial.base import run as run_directory
from seatrial.base.report import sentence_of
from seatrial.bench_test.characteristic import motor_doubts
from seatrial.bench_test.motor_estimate import MotorParameter
from seatrial.cli import app

EXAMPLES = Path(__file__).parents[2] / "examples"
BENCH = """
format = 1
name = "basin"
vehicle = "cwolf"
regression = { order = "square" }
[[pulls]]
name = "ahead"
file = "pull.csv"
group = "stern"
axis = "X"
"""
STEPS = """
[[steps]]
name = "steps"
file = "steps.csv"
group = "stern"
"""
PULL = "cmd.stern,load.X_n\n0,1.0\n500,19.6\n1000,75.8\n1500,168.4\n2000,299.6\n"
TRUTH = """
format = 1
vehicle = "cwolf"
[factors]
X_uu = 1.2
[sensors.dvl]
noise_m_s = 0.01
[sensors.attitude]
noise_deg = 0.1
"""
RECIPE = """
format = 1
description = "steps ahead"
truth = "truth.toml"
seed = 1
duration_s = 60.0
initial = { depth_m = 10.0 }
commands = [{ t_s = 2.0, stern = 1000.0 }, { t_s = 30.0, stern = 1800.0 }]
"""
CAMPAIGN = """
format = 1
name = "ahead"
vehicle = "cwolf"
trials.there.file = "there.toml"
[budget]
generations = 2
simplex_rounds = 1
[[stages]]
name = "ahead"
trials = ["there"]
axes = { free = "X", measured = "YZKMN" }
coefficients = { X_uu = "default" }
"""


def call(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


def step_rows(command: float | None = None, measured: str | None = None) -> str:
    """A record of 6 s at 10 Hz, from rest to 1000 rpm after 1 s."""
    rows = ["t_s,cmd.stern,meas.stern"]
    for k in range(60):
        value = (0.0 if k < 10 else 1000.0) if command is None else command
        rows.append(f"{0.1 * k:.1f},{value},{value if measured is None else measured}")
    return "\n".join(rows) + "\n"


def commands(rows: int = 60) -> str:
    lines = ["t_s,cmd.SbU,cmd.SbL,cmd.PU,cmd.PL"]
    return "\n".join(lines + [f"{0.1 * k:.1f},900,900,900,900" for k in range(rows)]) + "\n"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name, text in {
        "bench.toml": BENCH,
        "pull.csv": PULL,
        "steps.csv": step_rows(),
        "truth.toml": TRUTH,
        "there.toml": RECIPE,
        "ahead.toml": CAMPAIGN,
        "c.csv": commands(),
    }.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def refused(here: Path, arguments: list[str], words: str) -> None:
    """The verb ends with exit code 2 and one message, and nothing appears in the folder."""
    before = {path: path.read_bytes() for path in here.rglob("*") if path.is_file()}
    result = call(*arguments)
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.output
    assert words in result.stderr
    assert "[Errno" not in result.stderr
    assert {path: path.read_bytes() for path in here.rglob("*") if path.is_file()} == before
    assert not (here / "runs").exists() or not any((here / "runs").iterdir())


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('name = "basin"', 'name = "../basin"', "key name: expected a name for a folder"),
        ('vehicle = "cwolf"', 'vehicle = "cwolf"\nrho_kg_m3 = 1.025', "rho_kg_m3: expected greater than or"),
        ('vehicle = "cwolf"', 'vehicle = "cwulf"', "bench.toml: key vehicle: cwulf: expected a vehicle file"),
        ('group = "stern"', "group = 3", "key group: expected text in quotes, found 3"),
        ('group = "stern"', 'actuators = ["SbU", "SbU"]', "actuators names 'SbU' twice"),
        ('axis = "X"', 'axis = "X"\ntare = "yes"', "key tare: expected true or false"),
        ('axis = "X"', 'axis = "X"\nsign_of = "side"', "key sign_of: expected a table"),
        ("[[pulls]]", "[pulls]", "key pulls: expected a list [...]"),
        ('order = "square"', "order = 2, table_voltage_v = []", "table_voltage_v: expected at least one"),
    ],
)
def test_a_bench_file_is_answered_in_words(here: Path, old: str, new: str, words: str) -> None:
    (here / "bench.toml").write_text(BENCH.replace(old, new))
    refused(here, ["bench", "bench.toml", "--figures", "none"], words)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("steps.csv", step_rows(command=500.0), "bench.toml: steps of stern: step record"),
        ("steps.csv", step_rows(measured="NaN"), "meas.SbU: no cell of"),
    ],
)
def test_a_record_that_tells_nothing_is_refused(here: Path, name: str, text: str, words: str) -> None:
    (here / "bench.toml").write_text(BENCH + STEPS)
    (here / name).write_text(text)
    refused(here, ["bench", "bench.toml", "--figures", "none"], words)


def test_a_load_that_never_changes_is_refused(here: Path) -> None:
    (here / "pull.csv").write_text("cmd.stern,load.X_n\n" + "".join(f"{500 * k},1.0\n" for k in range(5)))
    refused(
        here,
        ["bench", "bench.toml", "--figures", "none"],
        "the load is the same at rest and under every command",
    )


def test_where_to_write_is_known_before_anything_is_written(here: Path) -> None:
    refused(
        here,
        ["bench", "bench.toml", "--write", "no/v.toml", "--figures", "none"],
        "--write no/v.toml: there is",
    )


@pytest.mark.parametrize("what", ["nowhere.toml", "."])
def test_a_file_that_cannot_be_read_is_said_without_its_number(here: Path, what: str) -> None:
    refused(here, ["bench", what], "not readable as a bench file")
    refused(here, ["identify", what], "not readable as a campaign file")


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('bench = "b.toml"', "key bench: there is no file b.toml"),
        ('bench = "."', "key bench: . is a folder, not a file"),
        ("bench = 3", "key bench: expected text in quotes"),
        ('bench = "lauv.toml"', "tests the vehicle lauv, and the campaign identifies cwolf"),
        ('places = { velocity_m = "bow" }', "places, key velocity_m: expected a list"),
        ("places = 3", "key places: expected a table"),
        ("places = { velocity_m = [350.0, 0.0, 0.0] }", "far outside the hull of"),
    ],
)
def test_new_keys_of_a_campaign_are_answered_in_words(here: Path, line: str, words: str) -> None:
    (here / "lauv.toml").write_text(BENCH.replace('"cwolf"', '"lauv"'))
    (here / "ahead.toml").write_text(CAMPAIGN.replace("format = 1\n", f"format = 1\n{line}\n"))
    refused(here, ["identify", "ahead.toml", "--figures", "none"], words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--trial", "nowhere=log.csv"], "--trial nowhere=log.csv: there is no file"),
        (["--leave-one-out", "--out", "o"], "o-leave-one-out: it holds files but no run.json"),
    ],
)
def test_identify_refuses_before_it_searches(here: Path, arguments: list[str], words: str) -> None:
    (here / "o-leave-one-out").mkdir()
    (here / "o-leave-one-out" / "thesis.txt").write_text("mine")
    refused(here, ["identify", "ahead.toml", *arguments], words)
    assert not (here / "o.partial").exists()


@pytest.mark.parametrize(
    ("verb", "files"),
    [
        (["identify", "ahead.toml", "--figures", "none"], "runs/o"),
        (["identify", "ahead.toml", "--leave-one-out", "--figures", "none"], "runs/o-leave-one-out"),
        (["bench", "bench.toml", "--figures", "none"], "runs/o"),
        (["fly", "cwolf", "cwolf", "nowhere.toml"], "runs/o"),
    ],
)
def test_a_run_directory_in_use_is_refused(here: Path, verb: list[str], files: str) -> None:
    with run_directory.RunDirectory(here / files):
        result = call(*verb, "--out", "runs/o")
    assert result.exit_code == 2, result.output
    assert f"{files}: expected to be its only user, found it in use by process {os.getpid()}" in result.stderr
    assert not (here / "runs").exists()


def test_a_refused_stage_leaves_no_folder(here: Path) -> None:
    (here / "ahead.toml").write_text(CAMPAIGN.replace("{ X_uu", '{ I_x = "default", X_uu'))
    refused(here, ["identify", "ahead.toml", "--figures", "none"], "coefficient 'I_x' changes nothing")


@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        ("there.toml", "seed = 1", 'seed = "a"', "there.toml: key seed: expected a whole number, found 'a'"),
        ("there.toml", "stern = 1000.0", "stern = nan", "commands[1], key stern: expected a finite number"),
        ("there.toml", "duration_s = 60.0", "duration_s = 1e7", "expected at most 1e+07 rows"),
        (
            "there.toml",
            "seed = 1",
            "seed = 1\ncurrent = { north_m_s = 1e9 }",
            "expected a number from -100 to 100",
        ),
        ("truth.toml", '"cwolf"', '"cwulf"', "truth.toml: key vehicle: cwulf"),
        (
            "truth.toml",
            "[factors]",
            "[vehicle_file.motors.propeler]\nminimum_ahead = 180.0\n[factors]",
            "has no 'propeler'; did you mean \"propeller\"?",
        ),
    ],
)
def test_a_recipe_is_answered_in_words(here: Path, name: str, old: str, new: str, words: str) -> None:
    (here / name).write_text((here / name).read_text().replace(old, new))
    refused(here, ["check", "ahead.toml"], words)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--free", "xyz"], "--free 'xyz': expected letters of XYZKMN"),
        (["--free", ""], "--free ''"),
        (["--held", "--free", "X"], "--held and --free"),
        (["--current", "1e9", "0", "0"], "the motion diverged"),
        (["--out", "./c.csv"], "this is the file of the commands"),
        (["--out", "no/r.csv"], "there is no folder no"),
        (["--sensors", "typical", "--run", "c.csv"], "this is the file of the commands"),
        (["--sensors", "typical", "--out", "x.csv", "--run", "x.csv"], "the log goes to this file"),
        (["--sensors", "typical", "--run", "no/r.csv"], "--run no/r.csv: there is no folder no"),
        (["--sensors", "gyro.toml", "--bottom", "30"], "--bottom is for a Doppler log"),
    ],
)
def test_simulate_refuses_before_it_writes(here: Path, options: list[str], words: str) -> None:
    (here / "gyro.toml").write_text("format = 1\n[sensors.gyro]\nnoise_deg_s = 0.1\n")
    refused(here, ["simulate", "cwolf", "c.csv", *options], words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["simulate", "v.toml", "c.csv", "--out", "v.toml"], "expected the ending .csv or .parquet"),
        (["simulate", "there.toml", "--out", "there.toml"], "expected the ending .csv"),
        (["export", "sdf", "v.toml", "--out", "v.toml"], "--out v.toml: expected the ending"),
        (["export", "sdf", "v.xml", "--out", "v.xml"], "--out v.xml: this is the file of the vehicle"),
        (["export", "csv", "c.csv", "--out", "./c.csv"], "--out c.csv: this is the file of the recording"),
        (["export", "csv", "there", "--columns-from", "ahead.toml", "--out", "log.csv"],
         "--out log.csv: this is the file of the recording"),
        (["autopilot", "v.toml", "--out", "v.toml", "--force"], "this is the file of the vehicle"),
        (["autopilot", "v.toml", "--out", "linked.toml", "--force"], "this is the file of the vehicle"),
        (["sitl", "cwolf", "--log", "v.toml"], "--log v.toml: expected the ending .csv or .parquet"),
        (["plan", "ahead.toml", "--out", "log.csv"], "--out log.csv: this is the file of trial there"),
        (["plan", "ahead.toml", "--out", "ahead.csv"], "--out ahead.toml: this is the file of the target"),
    ],
)  # fmt: skip
def test_no_verb_writes_over_what_it_reads(here: Path, arguments: list[str], words: str) -> None:
    for name in ("v.toml", "v.xml"):
        (here / name).write_text((EXAMPLES / "starter" / "vehicle.toml").read_text())
    (here / "linked.toml").symlink_to("v.toml")
    (here / "log.csv").write_text(commands())
    (here / "ahead.toml").write_text(CAMPAIGN.replace('"there.toml"', '"log.csv"'))
    refused(here, arguments, words)


def test_a_file_in_another_encoding_is_to_be_saved_as_utf_8(here: Path) -> None:
    (here / "latin.toml").write_bytes('format = 1\nname = "caf\u00e9"\n'.encode("latin-1"))
    for verb in ("check", "identify"):
        refused(here, [verb, "latin.toml"], "(not a text file in UTF-8); save it as UTF-8")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["thre", "--columns-from", "ahead.toml"], 'a trial of ahead.toml; did you mean "there"?'),
        (["there.toml", "there.toml"], "TRIAL there.toml: it is given twice"),
        (["there.toml", "--free", "Q"], "--free 'Q'"),
        (["c.csv"], "expected at least one of the channels"),
    ],
)
def test_score_refuses_in_words(here: Path, arguments: list[str], words: str) -> None:
    refused(here, ["score", "cwolf", *arguments], words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["cwolf", "--speed-kn", "inf"], "--speed-kn: expected a finite number"),
        (["cwolf", "--voltage", "inf"], "--voltage: expected a finite number"),
        (["ahead.toml", "--speed-kn", "2"], "--speed-kn is for a vehicle, and ahead.toml is a campaign"),
        (["bench.toml"], "found a bench file; evaluate it with seatrial bench bench.toml"),
        (["there.toml"], "found the recipe of a generated trial"),
        (["truth.toml"], "found the truth of generated trials"),
    ],
)
def test_check_names_what_it_was_given(here: Path, arguments: list[str], words: str) -> None:
    refused(here, ["check", *arguments], words)


@pytest.mark.parametrize("verb", ["bench", "check", "simulate"])
def test_json_holds_no_number_that_json_does_not_know(here: Path, verb: str) -> None:
    arguments = {
        "bench": ["bench", "bench.toml", "--figures", "none"],
        "check": ["check", "remus100", "--figures", "none"],
        "simulate": ["simulate", "cwolf", "c.csv"],
    }[verb]
    result = call(*arguments, "--json")
    assert result.exit_code == 0, result.output

    def never(constant: str) -> None:
        raise AssertionError(constant)

    assert json.loads(result.stdout, parse_constant=never)


def test_the_summary_of_a_run_has_no_numbers_of_rounding(here: Path) -> None:
    page = call("simulate", "cwolf", "c.csv").stdout
    assert "e-" not in page
    assert "-0.0 " not in page


def test_a_time_in_milliseconds_is_suspected() -> None:
    """The lag of a made-up record of 0.2 s whose times were read as milliseconds."""
    slow = MotorParameter("T_1", "s", 200.0)
    motor = SimpleNamespace(parameters={"T_1": slow, "K_V": MotorParameter("K_V", "", 200.0)})
    doubts = motor_doubts("stern", motor)  # type: ignore[arg-type]
    assert [sentence_of(doubt, "bench_test") for doubt in doubts] == [
        "stern motor: T_1 = 200 s is not that of a motor; is t_s in seconds?"
    ]


def test_a_held_vehicle_without_load_cell_is_said(here: Path) -> None:
    page = call("simulate", "cwolf", "c.csv", "--held", "--sensors", "typical").stdout
    assert "these sensors have no load_cell" in page


@pytest.mark.parametrize("files", [0, 2, 5])
def test_interrupted_bench_leaves_nothing_half_written(
    here: Path, monkeypatch: pytest.MonkeyPatch, files: int
) -> None:
    """Ctrl-C while the run directory is written, after so many of its files."""
    write, count = whole_file.write_atomic, 0

    def interrupted(path: Path, content: bytes) -> None:
        nonlocal count
        count += path.name != ".probe"
        if count > files:
            raise KeyboardInterrupt
        write(path, content)

    monkeypatch.setattr(run_directory, "write_atomic", interrupted)
    result = call("bench", "bench.toml", "--write", "v.toml")
    assert result.exit_code == 130
    assert "interrupted" in result.stderr
    assert not (here / "runs").exists()
    assert not (here / "v.toml").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["check", "cwolf", "--voltage", "1e308"], "--voltage"),
        (["check", "cwolf", "--speed-kn", "1e308"], "--speed-kn"),
        (["plan", "cwolf", "--duration", "1e308"], "--duration"),
    ],
)
def test_a_number_that_no_vehicle_has_is_refused(arguments: list[str], words: str) -> None:
    result = call(*arguments)
    assert result.exit_code == 2
    assert words in result.output
