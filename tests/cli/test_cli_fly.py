"""`seatrial fly`: run directory, tables, exit codes, refusals."""

from __future__ import annotations

import hashlib
import json
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from typer.testing import CliRunner, Result

import seatrial as st
from seatrial.cli import app
from seatrial.cli.console import ConsoleSettings
from tests.flight.flying import BOX, OUT, flown


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with two missions."""
    monkeypatch.chdir(tmp_path)
    Path("out.toml").write_text(OUT)
    Path("box.toml").write_text(BOX)
    return tmp_path


def call(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["fly", *map(str, arguments)])


def quick(*arguments: object) -> Result:
    return call("cwolf", "cwolf", "out.toml", "--figures", "none", *arguments)


@pytest.mark.usefixtures("here")
def test_a_flight_leaves_a_run_directory_that_tells_all() -> None:
    result = call("cwolf", "cwolf", "out.toml", "--current", "0", "0.3", "0", "--seed", "7")
    assert result.exit_code == 0, result.output
    run = Path("runs/fly-cwolf-out")
    names = {"run.json", "vehicle.toml", "autopilot.toml", "mission.toml", "flight.json", "flight.parquet"}
    assert {path.name for path in run.iterdir()} == names | {"summary.txt", "report.json", "figures"}
    drawn = {"track", "loops", "actuators", "errors"}
    assert {path.name for path in (run / "figures").iterdir()} == {f"{name}.png" for name in drawn}
    facts = json.loads((run / "run.json").read_text())
    assert facts["seed"] == 7
    assert facts["versions"]["seatrial"]
    for name in ("vehicle", "autopilot", "mission"):
        text = (run / f"{name}.toml").read_bytes()
        assert facts["sha256"][name] == hashlib.sha256(text).hexdigest()
    found = json.loads((run / "flight.json").read_text())
    flight = st.fly("cwolf", "cwolf", "out.toml", water=st.Water(current=(0.0, 0.3, 0.0)), seed=7)
    assert found["metrics"]["distance_m"] == flight.metrics["distance_m"]
    assert (run / "summary.txt").read_text() == flight.summary() + "\n"
    assert all(sentence in flight.summary() for sentence in flight.sentences())
    assert result.stdout.startswith("cwolf on out: complete. 1 of 1 waypoints reached in ")


@pytest.mark.usefixtures("here")
def test_the_inputs_of_a_run_directory_fly_the_same_flight_again() -> None:
    assert quick("--out", "first", "--current", 0, 0.3, 0).exit_code == 0
    again = call(
        "first/vehicle.toml", "first/autopilot.toml", "first/mission.toml", "--current", 0, 0.3, 0,
        "--figures", "none", "--out", "second",
    )  # fmt: skip
    assert again.exit_code == 0, again.output
    one, two = (pl.read_parquet(f"{name}/flight.parquet") for name in ("first", "second"))
    assert one.equals(two)


@pytest.mark.usefixtures("here")
def test_the_log_is_a_trial_of_the_vehicle() -> None:
    assert quick("--current", 0, 0.3, 0, "--out", "run").exit_code == 0
    trial = st.Trial.read("run/flight.parquet")
    assert set(trial.commands) == set(st.Vehicle.load("cwolf").actuators)
    assert st.score(st.Vehicle.load("cwolf"), trial)["u"].r2 > 0.999


@pytest.mark.usefixtures("here")
def test_tables_fit_eighty_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("seatrial.cli.console.SETTINGS", ConsoleSettings(piped_width=80))
    Path("long.toml").write_text(BOX.replace("north_m = 0.0", 'label = "the last one of all"\nnorth_m = 0.0'))
    result = call("cwolf", "cwolf", "long.toml", "--figures", "none")
    tables = [line for line in result.stdout.splitlines() if line.startswith(" ") and line.strip()]
    assert len(tables) > 20
    assert max(len(line.rstrip()) for line in tables) <= 80
    assert "3 the l…of all" in result.stdout
    assert "saturated" in result.stdout


@pytest.mark.usefixtures("here")
def test_json_is_all_that_is_printed_when_asked_for() -> None:
    result = quick("--json", "--out", "run")
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["complete"] is True
    assert found["run_directory"].endswith("run")
    assert found["legs"][0]["reached"] is True


@pytest.mark.usefixtures("here")
def test_the_exit_code_is_the_verdict() -> None:
    assert quick().exit_code == 0
    late = quick("--max-time", 10)
    assert late.exit_code == 1
    assert late.stdout.startswith("cwolf on out: out of time. 0 of 1 waypoints reached in 10 s")
    blind = quick("--outage", "attitude@5")
    assert blind.exit_code == 1
    assert "Reaction at" in blind.stdout
    Path("sharp.toml").write_text(BOX.replace("acceptance_radius_m = 5.0", "acceptance_radius_m = 0.05"))
    missed = call("cwolf", "cwolf", "sharp.toml", "--figures", "none")
    assert missed.exit_code == 1
    assert "not reached: the autopilot perceived it at" in missed.stdout


@pytest.mark.usefixtures("here")
def test_faults_and_outages_are_read_from_their_options() -> None:
    result = quick(
        "--fault", "SbU@10", "--fault", "PL@12=stuck", "--fault", "VTB@15=-200", "--outage", "position@20-30",
        "--out", "run", "--json",
    )  # fmt: skip
    around = json.loads(result.stdout)["circumstances"]
    assert [fault["actuator"] for fault in around["faults"]] == ["SbU", "PL", "VTB"]
    assert [fault["stuck"] for fault in around["faults"]] == [False, True, False]
    assert around["faults"][2]["stuck_at"] == -200.0
    assert around["outages"] == [{"of": "position", "from_s": 20.0, "until_s": 30.0}]
    table = pl.read_parquet("run/flight.parquet")
    assert table.filter(pl.col("t_s") > 10.1)["meas.SbU"].abs().max() == 0.0
    assert table.filter(pl.col("t_s") > 15.1)["meas.VTB"].unique().to_list() == [-200.0]


@pytest.mark.usefixtures("here")
def test_turbulence_goes_by_the_seed() -> None:
    found = {}
    for seed in (1, 2):
        result = quick("--turbulence", 0.1, "--seed", seed, "--json")
        assert result.exit_code == 0, result.output
        found[seed] = json.loads(result.stdout)
    # North and east alike, nothing down; without sensors nothing else depends on the seed.
    assert found[1]["circumstances"]["turbulence_m_s"] == [0.1, 0.1, 0.0]
    same = st.fly("cwolf", "cwolf", "out.toml", water=st.Water(turbulence=0.1), seed=1)
    assert found[1]["metrics"]["distance_m"] == same.metrics["distance_m"]
    assert found[1]["metrics"]["distance_m"] != found[2]["metrics"]["distance_m"]


@pytest.mark.usefixtures("here")
def test_many_seeds_tell_how_the_figures_spread() -> None:
    Path("sensors.toml").write_text(
        "format = 1\n[sensors.position]\nnoise_m = 0.3\n[sensors.depth]\n[sensors.attitude]\n"
        "noise_deg = 0.3\n[sensors.gyro]\n[sensors.dvl]\n"
    )
    result = quick("--sensors", "sensors.toml", "--seed", 3, "--seeds", 10, "--out", "run")
    assert result.exit_code == 0, result.output
    assert "10 seeds from 3 on: 10 complete." in result.stdout
    table = pl.read_parquet("run/seeds.parquet")
    assert table["seed"].to_list() == list(range(3, 13))
    assert table["distance_m"].n_unique() == 10
    single = json.loads(Path("run/flight.json").read_text())
    # The first of them is the flight that is told in full; lanes differ by rounding.
    assert table["distance_m"][0] == pytest.approx(single["metrics"]["distance_m"], rel=1e-6)
    late = json.loads(quick("--seeds", 2, "--max-time", 10, "--json").stdout)
    assert late["seeds"]["endings"] == ["out of time", "out of time"]


@pytest.mark.usefixtures("here")
def test_another_model_is_kept_with_the_inputs() -> None:
    heavy = st.Vehicle.load("cwolf").with_coefficients({"X_uu": -60.0})
    Path("heavy.toml").write_text(heavy.to_toml())
    result = call("heavy.toml", "cwolf", "out.toml", "--model", "cwolf", "--figures", "none", "--out", "run")
    assert result.exit_code == 0, result.output
    assert st.Vehicle.load("run/model.toml").coefficients() == st.Vehicle.load("cwolf").coefficients()
    assert st.Vehicle.load("run/vehicle.toml").coefficients()["X_uu"] == -60.0


@pytest.mark.usefixtures("here")
def test_the_flight_of_the_verb_is_that_of_the_function() -> None:
    result = call("cwolf", "cwolf", "box.toml", "--current", 0, 0.3, 0, "--figures", "none", "--json")
    found = json.loads(result.stdout)["metrics"]
    for name, value in flown().metrics.items():
        if math.isfinite(value):  # JSON has no infinity: no bottom, no obstacle
            assert found[name] == pytest.approx(value), name


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["cwoolf", "cwolf", "out.toml"], "cwoolf"),
        (["cwolf", "cwoolf", "out.toml"], "cwoolf"),
        (["cwolf", "cwolf", "nowhere.toml"], "nowhere.toml: not readable as a mission file"),
        (["cwolf", "cwolf", "out.toml", "--fault", "SbU"], "expected ACTUATOR@SECONDS"),
        (
            ["cwolf", "cwolf", "out.toml", "--fault", "SbU@soon"],
            "expected a time in s behind @, found 'soon'",
        ),
        (["cwolf", "cwolf", "out.toml", "--fault", "SbU@5=jammed"], "expected stuck, dead or a value"),
        (["cwolf", "cwolf", "out.toml", "--fault", "SbX@5"], 'did you mean "SbU"'),
        (["cwolf", "cwolf", "out.toml", "--outage", "position"], "expected GROUP@FROM-UNTIL"),
        (["cwolf", "cwolf", "out.toml", "--outage", "position@a-b"], "times in s as FROM-UNTIL"),
        (["cwolf", "cwolf", "out.toml", "--outage", "velocty@5"], 'did you mean "velocity"'),
        (["cwolf", "cwolf", "out.toml", "--current", "nan", "0", "0"], "--current: expected a finite number"),
        (["cwolf", "cwolf", "out.toml", "--turbulence", "7"], "turbulence: expected a standard deviation"),
        (["cwolf", "cwolf", "out.toml", "--seabed", "1"], "seabed: expected the start"),
        (["cwolf", "cwolf", "out.toml", "--sensors", "none.toml"], "none.toml"),
        (
            ["cwolf", "cwolf", "out.toml", "--speed", "0"],
            "use `seatrial realtime VEHICLE AUTOPILOT MISSION --speed`",
        ),
        (["cwolf", "cwolf", "out.toml", "--out", "out.toml"], "expected a folder, found a file"),
    ],
)
@pytest.mark.usefixtures("here")
def test_bad_input_is_one_sentence_and_leaves_nothing(arguments: list[str], message: str) -> None:
    result = call(*arguments, "--figures", "none")
    assert result.exit_code == 2, result.output
    assert message in result.output
    assert not Path("runs").exists()
    assert {path.name for path in Path().iterdir()} == {"out.toml", "box.toml"}


@pytest.mark.usefixtures("here")
def test_no_other_flight_replaces_the_folder_while_figures_are_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    beside: list[Result] = []

    def draw(flight: st.Flight, folder: Path, **_: Any) -> list[Path]:
        beside.append(quick("--out", folder.parent))
        return []

    monkeypatch.setattr("seatrial.report.plot.gallery", draw)
    assert call("cwolf", "cwolf", "out.toml", "--out", "run").exit_code == 0
    assert beside[0].exit_code == 2
    assert "only user" in beside[0].stderr


@pytest.mark.usefixtures("here")
def test_a_second_flight_into_a_folder_is_refused_before_it_flies(monkeypatch: pytest.MonkeyPatch) -> None:
    module = sys.modules["seatrial.flight.flight"]
    original: Callable[..., st.Flight] = module.fly
    beside: list[Result] = []
    flights: list[tuple[Any, ...]] = []

    def fly(*sources: Any, **options: Any) -> st.Flight:
        flights.append(sources)
        if len(flights) == 1:
            beside.append(quick("--out", "run"))
        return original(*sources, **options)

    monkeypatch.setattr(module, "fly", fly)
    assert quick("--out", "run").exit_code == 0
    assert beside[0].exit_code == 2
    assert "only user" in beside[0].stderr
    assert "complete" not in beside[0].stdout
    assert len(flights) == 1
    assert Path("run/flight.json").is_file()
