"""From load-cell records to operating points: columns, plateaus, tare, what a motor makes of a command."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from seatrial._core import Vehicle
from seatrial.base.errors import SeatrialError, TrialError
from seatrial.bench_test.evaluate import bench
from seatrial.bench_test.plateaus import held, plateaus, standard_error
from seatrial.bench_test.pulls import PullPoints, settled
from tests.bench_test.bench_records import FACTOR, STEPS, pull, quiet, record, staircase, thrust, write_bench

SQUARE = '[regression]\norder = 2\noutliers = "keep"\n'


def points(
    folder: Path, table: pl.DataFrame, keys: str = 'axis = "X"', *, group: str = "stern"
) -> PullPoints:
    """Points of one table as a CSV file."""
    table.write_csv(folder / "one.csv")
    return bench(write_bench(folder, pull("one", group=group, keys=keys), more=SQUARE)).records["one"]


def test_a_plateau_is_one_point_with_its_mean(tmp_path: Path) -> None:
    found = points(tmp_path, quiet(staircase()))
    np.testing.assert_allclose(found.signal, STEPS)
    # The flow decays with 0.2 s, 2 s are left out: exp(-10) of at most 60 N is left at the first sample.
    np.testing.assert_allclose(found.thrust, [thrust("stern", s) for s in STEPS], atol=2e-4)
    assert found.labels[0] == "18.0 to 23.9 s"


def test_samples_before_the_flow_has_settled_are_left_out(tmp_path: Path) -> None:
    table = quiet(staircase())
    hasty = points(tmp_path, table, 'axis = "X"\nsettle_s = 0.0')
    patient = points(tmp_path, table, 'axis = "X"\nsettle_s = 3.0')
    truth = np.array([thrust("stern", s) for s in STEPS])
    # Without settling the mean over 8 s lacks 0.2 s / 8 s of each rise.
    assert np.abs(hasty.thrust - truth).max() > 0.1
    assert np.abs(patient.thrust - truth).max() < 1e-4


def test_the_tare_is_what_the_cell_shows_at_rest(tmp_path: Path) -> None:
    biased = points(tmp_path, record(staircase(), noise_n=0.0, repeat_n=0.0, bias_n=7.5))
    assert biased.tare is not None
    assert biased.tare[0] == pytest.approx(7.5, abs=1e-3)
    untouched = points(
        tmp_path, record(staircase(), noise_n=0.0, repeat_n=0.0, bias_n=7.5), 'axis = "X"\ntare = false'
    )
    assert untouched.tare is None
    np.testing.assert_allclose(untouched.thrust - biased.thrust, 7.5 / FACTOR["stern"], atol=1e-3)


def test_without_a_rest_there_is_no_tare_and_it_is_said(tmp_path: Path) -> None:
    restless = quiet(staircase(rest=0))
    assert "not tared: no steady part at zero command" in points(tmp_path, restless).notes
    with pytest.raises(TrialError, match="key tare: there is no steady part at zero command"):
        points(tmp_path, restless, 'axis = "X"\ntare = true')


def test_a_zero_that_moves_is_said(tmp_path: Path) -> None:
    table = record(staircase(), noise_n=0.5, repeat_n=0.0, wrong={12: 6.0, 13: 6.0})
    assert any("the cell's zero moved by 6" in note for note in points(tmp_path, table).notes)


def test_a_load_that_still_moves_is_said(tmp_path: Path) -> None:
    table = record(staircase(), noise_n=0.2, repeat_n=0.0)
    found = points(tmp_path, table, 'axis = "X"\nsettle_s = 0.0')
    assert any("the load still moved on" in note for note in found.notes)
    assert not any("still moved" in note for note in points(tmp_path, table).notes)


def test_a_single_cell_over_pulleys_takes_its_sign_from_the_direction(tmp_path: Path) -> None:
    table = quiet(staircase([-s for s in STEPS]))
    rope = table.with_columns((-pl.col("load.X_n")).alias("load_n")).drop("load.X_n")
    found = points(tmp_path, rope, 'direction = "astern"')
    np.testing.assert_allclose(found.thrust, [thrust("stern", -s) for s in STEPS], atol=2e-4)


def test_a_column_map_gives_units_signs_frames_and_a_whole_group(tmp_path: Path) -> None:
    table = quiet(staircase())
    strange = table.select(
        Time=pl.col("t_s") * 1000.0, Pull=-pl.col("load.X_n") / 1000.0, speed=pl.col("cmd.SbU") / 60.0
    )
    keys = (
        'axis = "X"\ncolumns = { t_s = { from = "Time", unit = "ms" },'
        ' "load.X_n" = { from = "Pull", unit = "kN", sign = -1 },'
        ' "cmd.stern" = { from = "speed", unit = "Hz * turn" } }'
    )
    np.testing.assert_allclose(
        points(tmp_path, strange, keys).thrust, points(tmp_path, table).thrust, atol=1e-9
    )


def test_a_load_in_another_frame_is_turned(tmp_path: Path) -> None:
    table = quiet(staircase(), group="vertical", axis="Z")
    up = table.with_columns((-pl.col("load.Z_n")).alias("lift")).drop("load.Z_n")
    keys = 'axis = "Z"\ncolumns = { "load.Z_n" = { from = "lift", frame = "FLU" } }'
    found = points(tmp_path, up, keys, group="vertical")
    np.testing.assert_allclose(found.thrust, [thrust("vertical", s) for s in STEPS], atol=2e-4)


def test_a_table_without_time_is_a_point_per_row(tmp_path: Path) -> None:
    rows = pl.DataFrame({
        "rpm": [0.0, 500.0, 1000.0, None, 1500.0, 2000.0],
        "newton": [1.0, 7.0, 22.0, 9.0, 47.0, 83.0],
    })
    keys = 'axis = "X"\ncolumns = { "cmd.stern" = "rpm", "load.X_n" = "newton" }'
    found = points(tmp_path, rows, keys)
    np.testing.assert_allclose(found.thrust * FACTOR["stern"], [6.0, 21.0, 46.0, 82.0], rtol=1e-6)
    assert found.labels == ("row 2", "row 3", "row 5", "row 6")
    assert "1 rows with empty cells left out" in found.notes


def test_a_command_that_never_rests_is_refused_quickly(tmp_path: Path) -> None:
    t = np.arange(0.0, 3600.0, 0.1)
    sweep = pl.DataFrame({"t_s": t, "load.X_n": t, "cmd.stern": 1000.0 * (t / 60.0 % 2.0 - 1.0)})
    with pytest.raises(TrialError, match="no steady part"):
        points(tmp_path, sweep)


def test_a_log_without_its_time_is_suspected(tmp_path: Path) -> None:
    table = quiet(staircase())
    (doubt,) = points(tmp_path, table.drop("t_s")).doubts
    assert doubt.kind == "log without time"
    sheet = pl.DataFrame({
        "cmd.stern": [0.0] * 9 + [500.0, 1000.0, 1500.0, 2000.0],
        "load.X_n": [0.0] * 9 + [20.0, 75.0, 170.0, 300.0],
    })
    assert not points(tmp_path, sheet).doubts


def test_measured_revolutions_without_a_sign_take_it_from_another_column(tmp_path: Path) -> None:
    signal = np.array([-2000.0, -1500.0, -1000.0, -500.0, 0.0, 500.0, 1000.0, 1500.0, 2000.0])
    rows = pl.DataFrame({
        "rpm": np.abs(signal),
        "pwm": 1500.0 + signal / 5.0,
        "load.X_n": [FACTOR["stern"] * thrust("stern", s) for s in signal],
    })
    keys = (
        'axis = "X"\nuse = "measured"\ncolumns = { "meas.stern" = "rpm" }\n'
        'sign_of = { column = "pwm", neutral = 1500.0 }'
    )
    np.testing.assert_allclose(points(tmp_path, rows, keys).signal, signal[signal != 0.0])
    signed = rows.with_columns(pl.Series("rpm", signal))
    with pytest.raises(TrialError, match=r"meas\.SbU has negative values.*remove sign_of"):
        points(tmp_path, signed, keys)


def test_where_no_command_is_logged_plateaus_are_those_of_the_revolutions(tmp_path: Path) -> None:
    table = quiet(staircase())
    rng = np.random.default_rng(1)
    rpm = table["cmd.SbU"].to_numpy() + 4.0 * rng.standard_normal(table.height)
    measured = table.select("t_s", "load.X_n").with_columns(pl.Series("rpm", rpm))
    found = points(tmp_path, measured, 'axis = "X"\nuse = "measured"\ncolumns = { "meas.stern" = "rpm" }')
    # 60 samples of 4 rpm noise: 0.5 rpm on each mean.
    np.testing.assert_allclose(found.signal, STEPS, atol=2.0)


def test_law_a_settled_motor_clips_lifts_and_has_its_gain() -> None:
    cwolf = Vehicle.load("cwolf")
    asked = [0.0, 10.0, -10.0, 150.0, 1234.0, -1999.0, 9999.0, -9999.0, np.nan]
    expected = [0.0, 150.0, -150.0, 150.0, 1234.0, -1999.0, 2000.0, -2000.0, np.nan]
    np.testing.assert_allclose(settled(cwolf, "SbU", asked), expected, atol=1e-6)
    geared = cwolf.with_coefficients({"SbU.K_V": 0.9})
    np.testing.assert_allclose(settled(geared, "SbU", [1000.0]), [900.0], atol=1e-6)


def test_law_a_reversed_actuator_counts_from_neutral_the_other_way() -> None:
    beluga = Vehicle.load("beluga")
    np.testing.assert_allclose(settled(beluga, "thruster_1", [1580.0, 1680.0, 1480.0]), [0.0, -100.0, 100.0])
    np.testing.assert_allclose(settled(beluga, "thruster_0", [1580.0, 1680.0, 1480.0]), [0.0, 100.0, -100.0])


def test_the_standard_error_allows_for_samples_that_remember() -> None:
    rng = np.random.default_rng(2)
    means, errors = [], []
    for _ in range(300):
        x = np.zeros(400)
        noise = rng.standard_normal(400)
        for k in range(1, 400):
            x[k] = 0.8 * x[k - 1] + noise[k]
        means.append(x.mean())
        errors.append(standard_error(x))
    # 300 means know their deviation to 4 %; the autocorrelation's own bias adds a few per cent.
    assert 0.8 < np.mean(errors) / np.std(means) < 1.1
    assert standard_error(np.full(10, 3.0)) == 0.0


def test_empty_cells_between_samples_repeat_the_command() -> None:
    np.testing.assert_array_equal(held(np.array([np.nan, 1.0, np.nan, 2.0])), [1.0, 1.0, 1.0, 2.0])
    t = np.arange(0.0, 40.0, 0.1)
    command = np.where(t < 20.0, 100.0, 200.0)
    sparse = np.where(np.arange(len(t)) % 10 == 0, command, np.nan)
    load = np.where(np.arange(len(t)) % 3 == 0, command / 10.0, np.nan)[:, None]
    found, short = plateaus(t, {"a": sparse}, {"a": sparse}, load, None, settle_s=1.0, where="test")
    assert [p.load[0] for p in found] == [10.0, 20.0]
    assert short == 0


def test_commands_of_an_idle_group_do_not_end_plateaus(tmp_path: Path) -> None:
    table = quiet(staircase())
    measured = table.rename({f"cmd.{name}": f"meas.{name}" for name in ("SbU", "SbL", "PU", "PL")})
    alone = points(tmp_path, measured, 'axis = "X"\nuse = "measured"')
    beside = points(
        tmp_path, measured.with_columns(pl.lit(0.0).alias("cmd.VTB")), 'axis = "X"\nuse = "measured"'
    )
    np.testing.assert_allclose(beside.signal, STEPS)
    np.testing.assert_array_equal(beside.thrust, alone.thrust)


@pytest.mark.parametrize(
    ("change", "keys", "words"),
    [
        ("drop", 'axis = "Y"', "no column load.Y_n"),
        ("drop", 'direction = "ahead"', "expected a column load_n, found loads on axes: X"),
        ("none", 'axis = "X"\nuse = "measured"', "no column meas.SbU"),
        ("lose", 'axis = "X"', "no column cmd.PL, so it is not known whether they ran"),
        (
            "short",
            'axis = "X"\nsettle_s = 9.0',
            "10 plateaus are too short after 9 s; hold each command longer",
        ),
        (
            "short",
            'axis = "X"\nsettle_s = 99.0',
            "no steady part: 12 plateaus of the command, none with 5 samples",
        ),
        ("zero", 'axis = "X"', "every command of stern is zero"),
        (
            "text",
            'axis = "X"',
            'load.X_n (column "load.X_n"): row 4: expected a number, found the text "broken"',
        ),
        ("back", 'axis = "X"', "time running backwards"),
        ("none", 'axis = "X"\ncolumns = { "load.Q_n" = "x" }', 'did you mean "load.Z_n"?'),
        ("none", 'axis = "X"\ncolumns = { "load.X_n" = "lood" }', 'there is no column "lood"'),
        ("none", 'axis = "X"\ncolumns = { "load.X_n" = { from = "load.X_n", unit = "m" } }', "dimension"),
        ("none", 'axis = "X"\ncolumns = { "cmd.SbU" = { from = "cmd.SbU", frame = "FLU" } }', "no frame"),
        ("sign", 'axis = "X"', "positive signals pull against the direction of the vehicle file"),
        ("other", 'axis = "X"', "VTB ran as well"),
        ("unlike", 'axis = "X"', "pull with different signals"),
    ],
)
def test_a_record_that_tells_no_thrust_is_refused_in_words(
    tmp_path: Path, change: str, keys: str, words: str
) -> None:
    table = quiet(staircase())
    if change == "lose":
        table = table.drop("cmd.PL")
    elif change == "zero":
        table = quiet([0.0, 0.0])
    elif change == "text":
        table = table.cast({"load.X_n": pl.String}).with_columns(
            pl
            .when(pl.int_range(pl.len()) == 3)
            .then(pl.lit("broken"))
            .otherwise("load.X_n")
            .alias("load.X_n")
        )
    elif change == "back":
        table = table.reverse()
    elif change == "sign":
        table = table.with_columns(-pl.col("load.X_n"))
    elif change == "other":
        canted = Path(tmp_path / "canted.toml")
        text = (
            Vehicle
            .load("cwolf")
            .to_toml()
            .replace("direction = [0.0, 0.0, 1.0]", "direction = [0.5, 0.0, 1.0]")
        )
        canted.write_text(text)
        table.with_columns(pl.lit(500.0).alias("cmd.VTB")).write_csv(tmp_path / "one.csv")
        with pytest.raises(TrialError, match=words):
            bench(write_bench(tmp_path, pull("one", keys=keys), vehicle="canted.toml"))
        return
    elif change == "unlike":
        table = table.with_columns(pl.col("cmd.PL") * 0.5)
    with pytest.raises(SeatrialError) as refusal:
        points(tmp_path, table, keys)
    assert words in str(refusal.value)


def test_vertical_thrusters_may_run_while_the_cell_looks_ahead(tmp_path: Path) -> None:
    table = quiet(staircase()).with_columns(pl.lit(500.0).alias("cmd.VTB"))
    found = points(tmp_path, table, 'axis = "X"\ntare = false')
    np.testing.assert_allclose(found.thrust, [thrust("stern", s) for s in STEPS], atol=2e-4)
