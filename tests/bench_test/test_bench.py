"""The bench test as a whole: what it says, warns of, draws, writes; the verb."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner, Result

from seatrial._core import Vehicle
from seatrial.bench_test.evaluate import bench
from seatrial.cli import app
from seatrial.report.plot.bench import bollard_test
from tests.bench_test.bench_records import STEPS, both_ways, pull, record, staircase, write_bench

COMMENTED = Path(__file__).parents[2] / "crates" / "seatrial" / "vehicles" / "cwolf.toml"


def call(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def said(found: object) -> str:
    return "\n".join(found.sentences())  # type: ignore[attr-defined]


def test_the_paper_s_four_pulls_give_both_groups_in_both_directions(tmp_path: Path) -> None:
    path = both_ways(tmp_path)
    text = path.read_text()
    for k, (name, sign) in enumerate((("down", 1.0), ("up", -1.0))):
        made = record(
            staircase([sign * s for s in STEPS]), group="vertical", axis="Z", seed=9 + k, noise_n=1.0
        )
        made.write_csv(tmp_path / f"{name}.csv")
        text += pull(name, group="vertical", keys='axis = "Z"')
    path.write_text(text)
    found = bench(path)
    assert {name: set(fit.directions) for name, fit in found.pulls.items()} == {
        "stern": {"ahead", "astern"},
        "vertical": {"ahead", "astern"},
    }
    assert "4 actuators (SbU, SbL, PU, PL) pull 3.732 N along the load cell per newton of one" in said(found)
    assert "2 actuators (VTB, VTS) pull 2 N along the load cell per newton of one" in said(found)
    # The scatter of a repeated plateau is 1 N of 50 N on the vertical cell.
    assert all(one.fit.r2 > 0.99 for fit in found.pulls.values() for one in fit.directions.values())


def test_an_outlier_is_named_with_file_and_time_and_left_out_or_kept(tmp_path: Path) -> None:
    path = both_ways(tmp_path)
    # The eighth plateau, -1300 rpm, begins after six others of 8 s at 56 s; 2 s are left out.
    record(staircase([-s for s in STEPS]), seed=1, wrong={7: 25.0}).write_csv(tmp_path / "astern.csv")
    found = bench(path)
    assert "outliers, left out of the fit: pull astern, astern.csv, 58.0 to 63.9 s (-1300 rpm" in said(found)
    one = found.pulls["stern"].directions["astern"]
    assert (len(one.points), len(one.outliers)) == (9, 1)
    path.write_text(path.read_text() + '[regression]\noutliers = "keep"\n')
    kept = bench(path)
    assert "outliers, kept: pull astern" in said(kept)
    assert len(kept.pulls["stern"].directions["astern"].points) == 10
    assert kept.pulls["stern"].directions["astern"].fit.sigma > 3.0 * one.fit.sigma


def test_a_curve_that_falls_is_warned_of_with_its_place(tmp_path: Path) -> None:
    path = both_ways(tmp_path)
    # A constant pull of 25 N that no tare takes away, at the three lowest commands.
    made = record(staircase(), seed=3, noise_n=0.5, repeat_n=0.2, wrong={2: 90.0, 3: 60.0, 4: 30.0})
    made.write_csv(tmp_path / "ahead.csv")
    path.write_text(path.read_text() + '[regression]\noutliers = "keep"\n')
    warning = next(text for text in bench(path).warnings if "falls" in text)
    # From n_min to the bottom of the parabola.
    fit = bench(path).pulls["stern"].directions["ahead"].fit
    bottom = -0.5 * float(fit.coefficients[1] / fit.coefficients[2])
    assert warning.startswith("stern ahead: the curve falls between 150 and ")
    assert float(warning.split(" and ")[1].split()[0]) == pytest.approx(bottom, abs=20.0)


def test_a_record_that_is_pulled_twice_or_the_other_way_is_warned_of(tmp_path: Path) -> None:
    path = both_ways(tmp_path)
    made = pl.read_csv(tmp_path / "astern.csv")
    made.select(sorted(made.columns)).write_csv(tmp_path / "copy.csv")
    path.write_text(path.read_text() + pull("again", keys='axis = "X"').replace("again.csv", "copy.csv"))
    (warning,) = [text for text in bench(path).warnings if "once more" in text]
    assert warning.startswith("pull again holds the points of pull astern once more")
    (tmp_path / "ahead.csv").write_bytes((tmp_path / "copy.csv").read_bytes())
    found = bench(path)
    assert any("ahead.csv lies ahead; is it the right record?" in text for text in found.warnings)
    assert "stern: ahead was not tested; the thrust ahead that the vehicle file had is kept" in said(found)


def test_honest_curves_are_not_warned_of(tmp_path: Path) -> None:
    for order in ("2\nthrough_origin = true", '"square"', '"points"'):
        assert bench(both_ways(tmp_path, more=f"[regression]\norder = {order}\n")).warnings == ()


def test_commands_beyond_those_tested_are_called_a_guess(tmp_path: Path) -> None:
    record(staircase(STEPS[:7])).write_csv(tmp_path / "ahead.csv")
    warnings = bench(write_bench(tmp_path, pull("ahead"))).warnings
    assert any("tested up to 1500 of 2000 rpm; beyond, the curve is a guess" in text for text in warnings)


def test_a_bias_without_tare_pushes_the_wrong_way_and_is_warned_of(tmp_path: Path) -> None:
    record(staircase(), bias_n=-30.0).write_csv(tmp_path / "ahead.csv")
    found = bench(write_bench(tmp_path, pull("ahead", keys='axis = "X"\ntare = false')))
    assert any("pushes the wrong way up to" in text and "tare the cell" in text for text in found.warnings)


def test_a_supply_that_sags_is_warned_of_where_thrust_follows_it(tmp_path: Path) -> None:
    beluga = ("thruster_0", "thruster_3", "thruster_4", "thruster_7")
    rows = [
        {"pwm": 1580.0 + s, "load.X_n": 2.0e-3 * s * abs(s), "voltage_v": 16.0 - 0.005 * abs(s)}
        for s in (-400.0, -300.0, -200.0, -100.0, 0.0, 100.0, 200.0, 300.0, 400.0)
    ]
    # Thrusters 4 and 7 run the other way, so their pulse width is mirrored about neutral.
    table = pl.DataFrame(rows).with_columns((3160.0 - pl.col("pwm")).alias("mirrored"))
    table.write_csv(tmp_path / "pull.csv")
    columns = ", ".join(f'"cmd.{name}" = "{"mirrored" if name in beluga[2:] else "pwm"}"' for name in beluga)
    keys = f'axis = "X"\ncolumns = {{ {columns} }}'
    path = write_bench(tmp_path, pull("pull", group="horizontal", keys=keys), vehicle="beluga")
    found = bench(path)
    assert any("the supply ran from 14 to 15.5 V and thrust follows it" in text for text in found.warnings)
    assert found.records["pull"].factors[beluga] == pytest.approx(4.0 * 0.70711, rel=1e-4)


def test_a_dead_band_under_a_polynomial_is_warned_of(tmp_path: Path) -> None:
    signals = (0.0, 160.0, 200.0, 240.0, 500.0, 900.0, 1300.0, 1500.0, 1700.0, 2000.0)
    rows = [{"cmd.stern": s, "load.X_n": 0.1 * max(s - 240.0, 0.0)} for s in signals]
    path = write_bench(tmp_path, pull("ahead"))
    pl.DataFrame(rows).write_csv(tmp_path / "ahead.csv")
    assert any("no thrust from +0 to +240 rpm, a dead band" in text for text in bench(path).warnings)
    # A single weak point is none.
    pl.DataFrame([rows[0], *rows[3:]]).write_csv(tmp_path / "ahead.csv")
    assert not any("dead band" in text for text in bench(path).warnings)


def test_an_order_that_does_not_fit_is_said(tmp_path: Path) -> None:
    found = bench(both_ways(tmp_path, more='[regression]\norder = "square"\n'))
    assert "second order through the origin describes the points better" in said(found)


@pytest.mark.parametrize("order", ["2", "3", '"points"'])
def test_everything_is_plain_data_and_a_run_directory_holds_it(tmp_path: Path, order: str) -> None:
    found = bench(both_ways(tmp_path, more=f"[regression]\norder = {order}\n"))
    folder = found.save(tmp_path / "run")
    data = json.loads((folder / "bench.json").read_text())
    assert set(data["pulls"]) == {"stern"}
    assert len(data["facts"]["sha256"]["bench ahead.csv"]) == 64
    assert (folder / "points.csv").read_text().count("\n") == 21
    assert Vehicle.load(folder / "vehicle.toml").name == "cwolf"
    again = bench(tmp_path / "bench.toml").save(tmp_path / "again")
    repeated = json.loads((again / "bench.json").read_text())
    for key in ("started_utc", "finished_utc", "wall_s"):
        del data["facts"][key], repeated["facts"][key]
    assert repeated == data


@pytest.mark.parametrize("order", ["2", "3", '"points"'])
def test_the_figure_shows_points_curve_and_outliers(tmp_path: Path, order: str) -> None:
    path = both_ways(tmp_path, more=f"[regression]\norder = {order}\n")
    record(staircase([-s for s in STEPS]), seed=1, wrong={7: 25.0}).write_csv(tmp_path / "astern.csv")
    figure = bollard_test(bench(path))
    upper, lower = figure.axes[0], figure.axes[1]
    assert (upper.get_ylabel(), lower.get_xlabel()) == ("thrust of one actuator, N", "revolutions, rpm")
    drawn = [np.asarray(x.get_offsets()) for x in upper.collections if len(np.asarray(x.get_offsets())) > 1]
    assert sum(len(x) for x in drawn) >= 19
    texts = [text.get_text() for text in upper.texts]
    assert any("astern, 58.0 to 63.9 s" in text for text in texts) == (order != '"points"')


def test_the_verb_prints_tables_and_writes_only_what_it_is_told_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = both_ways(tmp_path)
    monkeypatch.chdir(tmp_path)
    result = call("bench", path)
    assert result.exit_code == 0, result.output
    for words in (
        "Regression per direction",
        "95 % interval",
        "squared correlation",
        "Nothing was written",
        "bollard_test",
    ):
        assert words in result.output
    assert (tmp_path / "runs" / "bench-basin" / "bollard_test.png").is_file()
    result = call("bench", path, "--write", "new.toml", "--figures", "none", "--json")
    assert result.exit_code == 0, result.output
    data = json.loads(result.stdout)
    assert data["vehicle_file"] == "new.toml"
    assert data["figures"] == []
    assert Vehicle.load("new.toml").actuator_info()["SbU"]["characteristic"] == "polynomial"


def test_what_was_written_is_not_asked_for_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = both_ways(tmp_path)
    monkeypatch.chdir(tmp_path)
    before = call("bench", path, "--figures", "none").output
    after = call("bench", path, "--write", "new.toml", "--figures", "none").output
    assert "the results into the vehicle file" in " ".join(before.split()).lower()
    assert "the results into the vehicle file" not in " ".join(after.split()).lower()
    assert "seatrial check new.toml" in after


def test_in_place_replaces_the_vehicle_s_file(tmp_path: Path) -> None:
    path = both_ways(tmp_path)
    mine = tmp_path / "mine.toml"
    mine.write_text(COMMENTED.read_text())
    path.write_text(path.read_text().replace('"cwolf"', '"mine.toml"'))
    result = call("bench", path, "--in-place", "--figures", "none", "--out", tmp_path / "run")
    assert result.exit_code == 0, result.output
    assert 'kind = "polynomial" # bench test basin' in mine.read_text()
    assert "# [P] Taubert" in mine.read_text()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--in-place",), "cwolf is a built-in vehicle without a file; give --write FILE"),
        (("--in-place", "--write", "x.toml"), "give one of them"),
        (("--write", "bench.toml"), "this file exists and is not overwritten"),
    ],
)
def test_the_verb_refuses_in_words_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], words: str
) -> None:
    path = both_ways(tmp_path)
    monkeypatch.chdir(tmp_path)
    before = sorted(p.name for p in tmp_path.iterdir())
    result = call("bench", path, *options)
    assert result.exit_code == 2
    assert words in result.stderr
    assert "Traceback" not in result.output
    assert sorted(p.name for p in tmp_path.iterdir()) == before
