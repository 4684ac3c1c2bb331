"""The T200's public bollard data: thrust over revolutions, table over pulse width and voltage."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from seatrial._core import Vehicle
from seatrial.bench_test.characteristic import SIDES
from seatrial.bench_test.evaluate import BenchTest, bench
from seatrial.vehicle.actuators import bollard

EXAMPLE = Path(__file__).parents[2] / "python" / "seatrial" / "examples" / "t200" / "bench.toml"
DATA = Path(os.environ.get("SEATRIAL_DATA", "/nonexistent")) / "t200" / "t200_bollard_10_20V.csv"

pytestmark = pytest.mark.skipif(
    not DATA.is_file(), reason="the T200's bollard data are not here; set SEATRIAL_DATA to their folder"
)


@cache
def found() -> BenchTest:
    return bench(EXAMPLE)


def test_lit_blue_robotics_thrust_is_proportional_to_n_squared_ahead_and_astern() -> None:
    fit = found().pulls["revolutions"]
    for side, one in fit.directions.items():
        assert one.fit.r2 > 0.995, side
        # The blades' Reynolds number grows with n: the sheet's exponents are 2.08 ahead and 2.11 astern.
        assert abs(one.exponent[0] - 2.0) < 0.13, side
        # Small as the difference is, 1206 rows tell it from 2.
        low, high = one.exponent_interval
        assert 2.0 < low < one.exponent[0] < high
        assert len(one.outliers) < 0.02 * len(one.points)
    p1 = {side: 3600.0 * float(one.fit.coefficients[0]) for side, one in fit.directions.items()}
    # The same by hand: mean of F/n² over the rows above half the largest thrust.
    table = pl.read_csv(DATA).filter(pl.col("rpm") > 0.0)
    for side, sign in SIDES.items():
        own = table.filter(sign * pl.col("force_N") > 0.5 * (sign * pl.col("force_N")).max())
        by_hand = float((sign * own["force_N"] / (own["rpm"] / 60.0) ** 2).mean())  # type: ignore[arg-type]
        assert p1[side] == pytest.approx(by_hand, rel=0.04)
    assert p1["ahead"] == pytest.approx(0.0147, abs=2e-4)
    assert p1["astern"] == pytest.approx(0.0117, abs=2e-4)


def test_lit_blue_robotics_table_over_pulse_width_and_voltage_is_within_a_newton_of_the_sheet() -> None:
    table = found().pulls["pulse_width"].table
    assert table is not None
    np.testing.assert_allclose(table.voltage_v, [10.0, 12.0, 14.0, 16.0, 18.0, 20.0])
    errors = table.errors()
    assert all(row["rms_n"] < 0.2 for row in errors)
    assert all(row["largest_n"] < 0.9 for row in errors)
    # The controller's dead band about 1500 us, as the sheet's rows without thrust at every voltage.
    assert -32.0 <= table.dead_band[0] <= -20.0
    assert 20.0 <= table.dead_band[1] <= 32.0


def test_a_table_from_every_second_row_foretells_the_others(tmp_path: Path) -> None:
    rows = pl.read_csv(DATA)
    folder = tmp_path / "t200"
    folder.mkdir()
    text = EXAMPLE.read_text().replace("${SEATRIAL_DATA}/", "")
    (tmp_path / "bench.toml").write_text(text)
    (tmp_path / "thruster.toml").write_text((EXAMPLE.parent / "thruster.toml").read_text())
    rows.gather_every(2).write_csv(folder / DATA.name)
    table = bench(tmp_path / "bench.toml").pulls["pulse_width"].table
    assert table is not None
    others = rows.gather_every(2, 1)
    told = table.at(others["pwm_us"].to_numpy() - 1500.0, others["supply_V"].to_numpy().astype(float))
    error = others["force_N"].to_numpy() - told
    # Neighbouring rows scatter by 0.1 to 0.2 N (rms); rows that were not seen are foretold hardly worse.
    assert np.sqrt(np.mean(error**2)) < 0.3


def test_the_written_vehicle_pulls_as_the_sheet(tmp_path: Path) -> None:
    vehicle = Vehicle.load(found().save_vehicle(tmp_path / "t200.toml"))
    rows = pl.read_csv(DATA).filter(pl.col("supply_V") == 16, pl.col("pwm_us") % 40 == 20)
    for row in rows.iter_rows(named=True):
        force = bollard(vehicle, {"by_pulse_width": float(row["pwm_us"])}, voltage_v=16.0)[0]
        assert force == pytest.approx(row["force_N"], abs=0.9)
    ahead = bollard(vehicle, {"by_revolutions": 3000.0}, voltage_v=16.0)[0]
    assert ahead == pytest.approx(0.0147 * 50.0**2, rel=0.02)
