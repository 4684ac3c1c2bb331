"""The command line: every verb once, exit codes, one clear message for what cannot be done."""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl
import pytest
import typer
from typer.testing import CliRunner, Result

from seatrial._core import Vehicle
from seatrial.base.errors import CampaignError
from seatrial.base.work import Progress, Step
from seatrial.bench_test.evaluate import bench
from seatrial.cli import app
from seatrial.cli import demo as demo_verb
from seatrial.cli.console import ConsoleSettings, search_progress
from seatrial.trial.generated import Recipe

EXAMPLES = Path(__file__).parents[2] / "examples"
MAIN = "from seatrial.cli import main; main()"
BUDGET = "[budget]\ngenerations = 4\nsimplex_rounds = 2\n\n"


def call(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def refused(result: Result, *words: str) -> None:
    """The verb ended with exit code 2 and one message, no traceback."""
    assert result.exit_code == 2, result.output
    assert result.exception is None or isinstance(result.exception, SystemExit)
    assert "Traceback" not in result.output
    for word in words:
        assert word in result.stderr


@pytest.fixture(scope="module")
def starter(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A starter project whose campaign searches only for a moment."""
    folder = tmp_path_factory.mktemp("project") / "mine"
    assert call("new", folder).exit_code == 0
    campaign = folder / "campaign.toml"
    campaign.write_text(campaign.read_text().replace("[trials]", f"{BUDGET}[trials]", 1))
    return folder


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_no_option_takes_a_number_that_is_not_finite() -> None:
    refused(call("plan", "cwolf", "--current", "inf"), "--current: expected a finite number, found inf")


def test_help_and_version_load_nothing_heavy() -> None:
    heavy = ["scipy", "polars", "matplotlib", "plotly", "cma", "pint", "pandas", "pydantic"]
    code = (
        "import sys\nfrom seatrial.cli import app\nsys.argv = ['seatrial', '--help']\n"
        "try: app()\nexcept SystemExit: pass\n"
        f"print([name for name in {heavy} if name in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "[]"
    for verb in ("demo", "new", "check", "simulate", "identify", "score"):
        assert verb in done.stdout


def test_version_is_that_of_the_package() -> None:
    from importlib.metadata import version

    assert call("--version").stdout.strip() == f"seatrial {version('seatrial')}"


def test_every_verb_explains_itself_on_one_screen_with_an_example() -> None:
    for verb, command in getattr(typer.main.get_command(app), "commands").items():  # noqa: B009
        result = call(verb, "--help")
        assert result.exit_code == 0
        assert f"Example: seatrial {verb}" in result.output, verb
        assert len(result.output.splitlines()) <= 40, verb
        whole = call(verb, "--help-all").output
        for option in (known for known in command.params if known.param_type_name == "option"):
            # What the screen does not explain it names.
            assert option.opts[0] in result.output, (verb, option)
            assert f" {option.opts[0]}" in whole, (verb, option)


@pytest.mark.long
def test_check_says_what_actuators_do_and_draws_three_views(here: Path) -> None:
    result = call("check", "cwolf")
    assert result.exit_code == 0, result.output
    assert "+1000 rpm on SbU: 19 N ahead, bow to port" in result.stdout
    assert "Top speed" in result.stdout
    assert {path.name for path in (here / "runs" / "check-cwolf").iterdir()} == {
        f"{name}.png" for name in ("three_views", "characteristic", "performance")
    }


def test_check_as_json(here: Path) -> None:
    found = json.loads(call("check", "beluga", "--json", "--figures", "none", "--voltage", "12").stdout)
    assert found["name"] == "beluga"
    assert len(found["pushes"]) == 16
    assert found["figures"] == []
    assert not (here / "runs").exists()


@pytest.mark.long
def test_check_of_a_campaign_reports_recordings_and_stages(starter: Path) -> None:
    result = call("check", starter / "campaign.toml")
    assert result.exit_code == 0, result.output
    assert "Trial straight" in result.stdout
    assert "Ready to identify" in result.stdout
    data = json.loads(call("check", starter / "campaign.toml", "--json").stdout)
    assert [stage["name"] for stage in data["stages"]] == ["surge", "yaw", "heave"]


def test_check_of_a_campaign_names_every_trial_that_is_missing(starter: Path, tmp_path: Path) -> None:
    shutil.copytree(starter, tmp_path / "mine")
    for log in (tmp_path / "mine" / "logs").iterdir():
        log.unlink()
    refused(
        call("check", tmp_path / "mine" / "campaign.toml"),
        "straight.csv",
        "zigzag.csv",
        "dive.csv",
        "mixed.csv",
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["check", "cwlf"], 'did you mean "cwolf"?'),
        (["check", "nowhere/vehicle.toml"], "nowhere/vehicle.toml"),
        (["identify", "nowhere.toml"], "nowhere.toml"),
        (["score", "cwolf", "nowhere.csv"], "nowhere.csv"),
        (["simulate", "cwolf", "nowhere.csv"], "nowhere.csv"),
        (["identify", "nowhere.toml", "--trial", "surge"], "expected NAME=FILE"),
        (["frobnicate"], "frobnicate"),
        (["check"], "Missing argument"),
        (["identify", "x.toml", "--threads", "0"], "--threads"),
        (["score", "cwolf", "x.csv", "--ahead", "-1"], "--ahead"),
    ],
)
def test_bad_input_is_one_message_and_exit_code_2(here: Path, arguments: list[str], words: str) -> None:
    refused(call(*arguments), words)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("m = 48.0", "m = -48.0", "expected a positive number, found -48"),
        ("z_b = -0.01", "z_bb = -0.01", "z_bb"),
        ("length_m = 1.6", "lenght_m = 1.6", "length_m"),
        ("m = 48.0 ", 'm = "48 kg"', "vehicle.toml"),
    ],
)
def test_a_broken_vehicle_file_is_named_with_its_key(
    starter: Path, here: Path, old: str, new: str, words: str
) -> None:
    text = (starter / "vehicle.toml").read_text()
    assert old in text
    (here / "vehicle.toml").write_text(text.replace(old, new))
    refused(call("check", "vehicle.toml"), "vehicle.toml", words)


def test_new_refuses_a_folder_that_holds_files(starter: Path) -> None:
    before = sorted(path.name for path in starter.iterdir())
    refused(call("new", starter), "expected an empty or a new folder")
    assert sorted(path.name for path in starter.iterdir()) == before


def test_the_bench_test_of_a_new_project_finds_the_truth_behind_its_records(starter: Path) -> None:
    found = json.loads(call("bench", starter / "bench.toml", "--figures", "none", "--json").stdout)
    truth = Recipe.load(EXAMPLES / "starter" / "logs" / "straight.toml").truth.vehicle.coefficients()
    written = bench(starter / "bench.toml").vehicle.coefficients()
    # Stated standard deviations: 0.2 to 1.4 % of the thrust, below 0.3 % of the motor; twice the largest.
    for name in ("port.p1_ahead", "starboard.p1_astern", "vertical.p1_ahead", "vertical.p1_astern"):
        assert written[name] == pytest.approx(truth[name], rel=0.028)
    for name in ("port.T_1", "starboard.T_t", "vertical.n_acc"):
        assert written[name] == pytest.approx(truth[name], rel=0.006)
    assert set(found["pulls"]) == {"stern", "vertical"}


@pytest.mark.long
def test_new_then_identify_then_score(starter: Path, here: Path) -> None:
    result = call("identify", starter / "campaign.toml", "--out", "run", "--figures", "none")
    assert result.exit_code == 0, result.output
    for words in (
        "X_uu",
        "factor",
        "R2 10 s ahead",
        "R2 free run",
        "apparent mass in surge",
        "Results in run",
    ):
        assert words in result.stdout
    known = json.loads((here / "run" / "identification.json").read_text())
    sought = ["X_u", "X_uu", "N_rdot", "N_r", "N_rr", "N_ur", "Z_wdot", "Z_w", "Z_ww", "B"]
    assert [row["name"] for row in known["coefficients"]] == sought
    Vehicle.load(here / "run" / "vehicle.toml")

    score: list[str | Path] = ["score", "run/vehicle.toml", "zigzag", "--json"]
    score.append(starter / "logs" / "straight.csv")
    scored = json.loads(call(*score, "--columns-from", starter / "campaign.toml").stdout)
    assert scored["trials"] == ["zigzag", "straight"]
    assert scored["channels"]["u"]["r2"] > 0.9
    # No stage frees roll and pitch: their channels follow the recording.
    replayed = {name for name, one in scored["channels"].items() if one["replayed"]}
    assert replayed == {"p", "q", "roll", "pitch"}
    zigzag = starter / "logs" / "zigzag.csv"
    trained = call("score", "run/vehicle.toml", zigzag, "--train", starter / "logs" / "straight.csv")
    assert "beside baselines" in trained.stdout
    refused(call("score", "run/vehicle.toml", zigzag, "--train", zigzag), "it is scored, too")
    assert (
        "R2" in call("score", starter / "vehicle.toml", starter / "logs" / "zigzag.csv", "--free-run").stdout
    )


def test_a_score_says_how_much_of_the_trial_the_campaign_fits(starter: Path) -> None:
    columns = ("--columns-from", starter / "campaign.toml")
    told = call("score", starter / "vehicle.toml", "zigzag", *columns).stdout
    assert "fits 75 % of zigzag" in " ".join(told.split())
    for judging in ("mixed", starter / "logs" / "zigzag.csv"):  # only judges; a file that no stage knows
        assert (
            "% of" not in call("score", starter / "vehicle.toml", judging, *columns).stdout.split("10 s")[0]
        )


@pytest.mark.long
def test_identify_reuses_finished_stages_and_prints_json(starter: Path, here: Path) -> None:
    arguments: list[str | Path] = ["identify", starter / "campaign.toml", "--out", "run", "--json"]
    first = json.loads(call(*arguments, "--figures", "none").stdout)
    again = json.loads(call(*arguments).stdout)
    assert [stage["reused"] for stage in again["stages"]] == [True, True, True]
    assert again["coefficients"] == first["coefficients"]
    names = {Path(path).stem for path in again["figures"]}
    expected = {"vehicle", "characteristic", "convergence", "intervals", "residual_analysis"}
    assert names == expected | {f"trial_{name}" for name in ("straight", "zigzag", "dive", "mixed")}
    assert all(Path(path).is_file() for path in again["figures"])


@pytest.mark.long
def test_identify_with_another_recording(starter: Path, here: Path) -> None:
    shutil.copy(starter / "logs" / "straight.csv", here / "other.csv")
    arguments = ["--trial", "straight=other.csv", "--out", "run", "--figures", "none", "--json"]
    result = call("identify", starter / "campaign.toml", *arguments)
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["stages"]


def test_a_score_of_nothing_is_bad_input(here: Path) -> None:
    """The reason, what is wrong with the recording, and JSON all the same."""
    table = {"t_s": [0.1 * k for k in range(100)], "u_m_s": [0.0] * 100}
    table |= {f"cmd.{name}": [0.0] * 100 for name in Vehicle.load("cwolf").actuators}
    pl.DataFrame(table).write_csv(here / "still.csv")
    told = call("score", "cwolf", "still.csv", "--ahead", "2000")
    refused(told, "cwolf: no channel of still.csv could be scored: ")
    result = call("score", "cwolf", "still.csv", "--ahead", "2000", "--json")
    assert result.exit_code == 2
    assert json.loads(result.stdout)["trials"] == ["still"]
    # Stamps in ms under the name of s: the rows would be 100 s apart.
    pl.DataFrame(table | {"t_s": [1.7e12 + 100.0 * k for k in range(100)]}).write_csv(here / "still.csv")
    refused(call("score", "cwolf", "still.csv"), "Unix time in ms); put the unit into the column's name")


def test_a_given_trial_that_the_campaign_has_not_is_said(
    starter: Path, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*given: Any, **options: Any) -> None:
        raise CampaignError("stopped")

    monkeypatch.setattr("seatrial.cli.identify.run_identification", stopped)
    shutil.copy(starter / "logs" / "straight.csv", here / "other.csv")
    wrong = call("identify", starter / "campaign.toml", "--trial", "straigt=other.csv")
    refused(wrong, "has no trial 'straigt'; did you mean \"straight\"?")
    added = call("identify", starter / "campaign.toml", "--trial", "harbour=other.csv")
    refused(added, "Trial harbour is not in", "it is added, held out, and only judges", "stopped")
    same = call("identify", starter / "campaign.toml", "--trial", "straight=other.csv")
    assert "only judges" not in same.stderr


def test_a_run_directory_that_cannot_be_written_is_refused(starter: Path, here: Path) -> None:
    (here / "file").write_text("")
    refused(call("identify", starter / "campaign.toml", "--out", "file/run"), "file/run", "choose a folder")
    refused(call("identify", starter / "campaign.toml", "--out", "file"), "expected a folder, found a file")
    refused(call("check", "cwolf", "--out", "file/check"), "cannot be written")
    refused(call("new", "file/mine"), "file/mine")


def test_a_full_disk_is_named(starter: Path, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    refused(call("identify", starter / "campaign.toml", "--out", "run"), "the disk is full")


def test_simulate_writes_a_table_that_reads_back_as_a_trial(starter: Path, here: Path) -> None:
    t = [0.1 * k for k in range(200)]
    ahead = [0.0 if x < 1.0 else 1000.0 for x in t]
    commands = {"t_s": t, "cmd.port": ahead, "cmd.starboard": ahead, "cmd.vertical": [0.0] * len(t)}
    pl.DataFrame(commands).write_csv(here / "commands.csv")
    result = call("simulate", starter / "vehicle.toml", "commands.csv")
    assert result.exit_code == 0, result.output
    assert "largest speed" in result.stdout
    run = pl.read_csv(here / "commands-run.csv")
    assert run["u_m_s"][-1] > 1.0
    assert run["meas.port"][-1] == pytest.approx(1000.0, abs=1.0)
    # The vehicle that made the run predicts it.
    scored = json.loads(call("score", starter / "vehicle.toml", "commands-run.csv", "--json").stdout)
    assert scored["channels"]["u"]["r2"] > 0.999


@pytest.mark.parametrize(
    ("columns", "options", "words"),
    [
        ({"cmd.prot": 1.0}, [], 'did you mean "port"?'),
        ({"u_m_s": 1.0}, [], "nothing drives the vehicle"),
        ({"cmd.port": 1.0}, ["--out", "run.xlsx"], "expected the ending .csv or .parquet"),
        ({"cmd.port": 1.0}, ["--out", "nowhere/run.csv"], "there is no folder nowhere"),
        ({"cmd.port": 1.0}, ["--free", "Q"], "XYZKMN"),
    ],
)
def test_simulate_refuses_what_it_cannot_do(
    starter: Path, here: Path, columns: dict[str, float], options: list[str], words: str
) -> None:
    t = [0.1 * k for k in range(20)]
    table: dict[str, Any] = {"t_s": t} | {name: [value] * len(t) for name, value in columns.items()}
    pl.DataFrame(table).write_csv(here / "commands.csv")
    refused(call("simulate", starter / "vehicle.toml", "commands.csv", *options), words)


def test_simulate_needs_the_voltage_where_thrust_depends_on_it(here: Path) -> None:
    t = [0.1 * k for k in range(20)]
    pl.DataFrame({"t_s": t, "cmd.thruster_0": [1700.0] * len(t)}).write_csv(here / "commands.csv")
    refused(call("simulate", "beluga", "commands.csv"), "voltage_v")


@pytest.mark.long
def test_demo_shows_truth_beside_estimate_and_says_where_figures_are(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The shipped CWolf example, first stage only, with a search of a moment."""
    shutil.copytree(EXAMPLES / "cwolf", here / "examples" / "cwolf")
    path = here / "examples" / "cwolf" / "campaign.toml"
    text = path.read_text().replace("[trials]", f"{BUDGET}[trials]", 1)
    path.write_text(text[: text.index('[[stages]]\nname = "diving by vertical')])
    monkeypatch.setattr(demo_verb, "EXAMPLES", here / "examples")
    monkeypatch.delenv("SEATRIAL_DATA", raising=False)
    result = call("demo", "--out", "demo")
    assert result.exit_code == 0, result.output
    for words in ("GENERATED", "truth", "X_uu", "-12.72", "R2 10 s ahead", "apparent mass", "Figures"):
        assert words in result.stdout
    assert (here / "demo" / "cwolf" / "figures" / "trial_validation.png").is_file()
    generated = sorted((here / "demo" / "cwolf" / "trials").iterdir())
    assert len(generated) == 7
    assert all(path.read_text().startswith("# GENERATED") for path in generated)


@pytest.mark.long
def test_interrupted_identification_keeps_the_best_so_far(tmp_path: Path) -> None:
    """Ctrl-C once the first stage is finished: exit code 130, the best so far, and then it goes on."""
    assert call("new", tmp_path / "mine").exit_code == 0
    command = [sys.executable, "-c", MAIN, "identify", str(tmp_path / "mine" / "campaign.toml")]
    command += ["--out", str(tmp_path / "run"), "--figures", "none"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    first = tmp_path / "run.partial" / "stages"
    deadline = time.monotonic() + 120.0
    while process.poll() is None and not list(first.glob("*.json")) and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    output, complaint = process.communicate(timeout=120.0)
    assert process.returncode == 130, complaint
    assert "Ctrl-C ended the search early" in output
    known = json.loads((tmp_path / "run" / "identification.json").read_text())
    assert known["interrupted"]
    assert known["coefficients"]
    assert list((tmp_path / "run" / "stages").glob("*.json"))


def test_progress_tells_stage_generation_best_and_time_left(capsys: pytest.CaptureFixture[str]) -> None:
    state = Progress(
        what="surge", done=1, total=4, fraction=0.31, elapsed_s=3.0, left_s=42.0,
        step=Step("evolution", 7, 90, 56, 0.1234, 3.0),
    )  # fmt: skip
    with search_progress("first", quiet=True) as silent:
        silent(state)
    assert capsys.readouterr().err == ""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("seatrial.cli.console.SETTINGS", ConsoleSettings(line_every_s=0.0))
        with search_progress("first") as spoken:
            spoken(state)
            line = capsys.readouterr().err
            spoken(replace(state, step=Step("evolution", 1, 90, 8, 0.2, 0.1)))  # too early to tell
            spoken(replace(state, left_s=float("nan")))
            assert "left" not in capsys.readouterr().err
            spoken(replace(state, step=None))
            assert "surge [2/4]: about 42 s left" in capsys.readouterr().err
            spoken(replace(state, what="joint estimate", step=Step("polish", 7, 20, 8, 0.2, 0.1)))
            assert "joint estimate [2/4]: round 7 of at most 20, best 0.2" in capsys.readouterr().err
            spoken(replace(state, notes=("Stages found.",)))
            assert capsys.readouterr().err.startswith("Stages found.")
            spoken(replace(state, done=0, notes=("Nothing tells K_p.",)))
            assert capsys.readouterr().err.startswith("before the search: Nothing tells K_p.")
            spoken(replace(state, step=None, detail="9 of 24 missions flown"))
            assert "surge: 9 of 24 missions flown, about 42 s left" in capsys.readouterr().err
    for words in ("31 %", "surge [2/4]", "generation 7 of at most 90", "best 0.1234", "at most 42 s left"):
        assert words in line
