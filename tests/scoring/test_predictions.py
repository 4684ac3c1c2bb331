"""Predictions from elsewhere: units and stamps of their own, scored on the same windows as a vehicle."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

import seatrial as st
from seatrial.base.errors import TrialError
from seatrial.cli import app
from seatrial.scoring.score import score
from seatrial.scoring.windows import Predictions

T = np.arange(0.0, 120.0, 0.1)


@pytest.fixture(scope="module")
def vehicle() -> st.Vehicle:
    return st.Vehicle.load("cwolf")


@pytest.fixture(scope="module")
def run(vehicle: st.Vehicle) -> st.Run:
    return vehicle.simulate(T, commands(vehicle))


def commands(vehicle: st.Vehicle) -> dict[str, np.ndarray]:
    rows = {name: np.zeros(len(T)) for name in vehicle.actuators}
    for name, side in (("SbU", 1.0), ("SbL", 1.0), ("PU", -1.0), ("PL", -1.0)):
        rows[name] = 900.0 + side * 300.0 * np.sign(np.sin(0.25 * T))
    return rows


@pytest.fixture(scope="module")
def trial(vehicle: st.Vehicle, run: st.Run) -> st.Trial:
    rng = np.random.default_rng(1)
    table = {"t_s": T, "u_m_s": run.nu[:, 0] + rng.normal(0.0, 0.005, len(T))}
    table |= {"r_deg_s": np.rad2deg(run.nu[:, 5]), "yaw_deg": np.rad2deg(run.euler[:, 2])}
    table |= {f"cmd.{name}": values for name, values in commands(vehicle).items()}
    return st.Trial.read(table, name="turns", align=False)


def foreign(run: st.Run, folder: Path, *, rate_hz: float = 10.0, stop_s: float = 120.0) -> Path:
    """What a perfect model of someone else predicts, in knots and degrees, at its own stamps."""
    t = np.arange(0.0, stop_s, 1.0 / rate_hz)
    yaw = np.interp(t, T, np.unwrap(run.euler[:, 2]))
    table = {
        "Time": t,
        "u [knot]": np.interp(t, T, run.nu[:, 0]) / 0.514444,
        "yaw [deg]": np.rad2deg((yaw + np.pi) % (2.0 * np.pi) - np.pi),
        "r_deg_s": np.rad2deg(np.interp(t, T, run.nu[:, 5])),
    }
    pl.DataFrame(table).write_csv(folder / "foreign.csv")
    return folder / "foreign.csv"


@pytest.mark.parametrize("rate_hz", [10.0, 7.0, 33.0])
def test_units_of_the_header_and_stamps_of_its_own(
    rate_hz: float, run: st.Run, trial: st.Trial, tmp_path: Path
) -> None:
    read = Predictions.read(foreign(run, tmp_path, rate_hz=rate_hz))
    assert read.channels == ["u", "r", "yaw"]
    found = score(read, trial)
    assert found["u"].rmse == pytest.approx(0.005, rel=0.1)  # the noise of the trial
    assert found["yaw"].r2 > 0.999
    assert found["r"].r2 > 0.97  # straight lines between stamps 0.14 s apart


def test_a_table_and_a_vehicle_are_judged_on_the_same_windows_and_channels(
    vehicle: st.Vehicle, run: st.Run, trial: st.Trial, tmp_path: Path
) -> None:
    table = Predictions.read(foreign(run, tmp_path, stop_s=65.0))
    heavier = vehicle.with_coefficients({"X_udot": -80.0})
    found = st.compare({"heavier": heavier, "foreign": table}, trial)
    assert list(found.scores["heavier"]) == list(found.scores["foreign"]) == ["u", "r", "yaw"]
    assert [w.stop for w in found.scores["heavier"].windows] == [
        w.stop for w in found.scores["foreign"].windows
    ]
    assert len(found.scores["foreign"].windows) == 6
    assert found.scores["foreign"].skipped == 6
    assert "6 left out" in str(found)
    assert found.of("foreign")["u"].verdict == "better"


def test_a_gap_of_the_predictions_leaves_its_window_out(run: st.Run, trial: st.Trial, tmp_path: Path) -> None:
    whole = pl.read_csv(foreign(run, tmp_path))
    holed = whole.filter((pl.col("Time") < 22.0) | (pl.col("Time") > 23.0))
    holed.write_csv(tmp_path / "holed.csv")
    found = score(Predictions.read(tmp_path / "holed.csv"), trial)
    assert found.skipped == 1
    assert not [w for w in found.windows if w.start < 225 < w.stop]


def test_rows_are_told_apart_by_their_trial(run: st.Run, trial: st.Trial, tmp_path: Path) -> None:
    one = pl.read_csv(foreign(run, tmp_path)).with_columns(trial=pl.lit("turns"))
    other = one.with_columns(pl.col("u [knot]") * 0.0, trial=pl.lit("straight"))
    pl.concat([other, one]).write_csv(tmp_path / "both.csv")
    read = Predictions.read(tmp_path / "both.csv")
    assert score(read, trial)["u"].r2 > 0.9
    pl.concat([other]).write_csv(tmp_path / "other.csv")
    with pytest.raises(TrialError, match=r'expected rows of the trial "turns", found those of straight'):
        score(Predictions.read(tmp_path / "other.csv"), trial)


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("t_s,u", r'column "u": expected its unit in the header, "u \[\.\.\.\]", or the name u_m_s'),
        ("t_s,u [kg]", "u_m_s: unit .kg. has the dimension"),
        ("t_s,depth_of_model", "no column but the time has a canonical name"),
        ("when,u_m_s", "no time: expected a column"),
        ("t_s,cmd.SbU", "no channel is predicted"),
    ],
)
def test_a_header_that_does_not_say_enough_is_refused(header: str, message: str, tmp_path: Path) -> None:
    rows = "\n".join(f"{0.1 * k:.1f},{0.01 * k:.2f}" for k in range(30))
    (tmp_path / "p.csv").write_text(f"{header}\n{rows}\n")
    with pytest.raises(TrialError, match=message):
        Predictions.read(tmp_path / "p.csv")


def test_times_beside_the_trial_are_refused(run: st.Run, trial: st.Trial, tmp_path: Path) -> None:
    late = pl.read_csv(foreign(run, tmp_path)).with_columns(pl.col("Time") + 1000.0)
    with pytest.raises(TrialError, match=r"whole windows of the trials \(turns 0 to 119.9 s\)"):
        score(Predictions.read(late), trial)


def test_own_stamps_judge_a_slow_sensor_at_its_samples(vehicle: st.Vehicle, run: st.Run) -> None:
    # A Doppler log at 1 Hz beside a gyro at 10 Hz: between its samples the time base holds straight lines.
    slow = [float(value) if k % 10 == 3 else None for k, value in enumerate(run.nu[:, 0])]
    table = {"t_s": T, "u_m_s": slow, "r_deg_s": np.rad2deg(run.nu[:, 5])}
    table |= {f"cmd.{name}": values for name, values in commands(vehicle).items()}
    trial = st.Trial.read(pl.DataFrame(table), name="slow", align=False)
    assert len(trial.samples["u"][0]) == 120
    perfect = Predictions.read({"t_s": T, "u_m_s": run.nu[:, 0], "r_deg_s": np.rad2deg(run.nu[:, 5])})
    base, own = score(perfect, trial), score(perfect, trial, own_stamps=True)
    assert own["u"].n < 120 < base["u"].n
    assert own["r"].n == base["r"].n
    assert own["u"].rmse < 1e-9 < 1e-3 < base["u"].rmse
    assert score(vehicle, trial, own_stamps=True)["u"].n == own["u"].n


def test_the_command_line_compares_with_a_table(run: st.Run, trial: st.Trial, tmp_path: Path) -> None:
    trial.save(tmp_path / "turns.csv")
    table = foreign(run, tmp_path)
    trial_file = str(tmp_path / "turns.csv")
    answer = CliRunner().invoke(
        app, ["score", "cwolf", trial_file, "--against", str(table), "--json", "--own-stamps"]
    )
    assert answer.exit_code == 0, answer.output
    found = json.loads(answer.output)
    assert list(found["vehicles"]) == ["cwolf", "foreign"]
    assert found["vehicles"]["foreign"]["channels"]["yaw"]["r2"] > 0.999
