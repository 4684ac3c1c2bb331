"""Thrust of a single actuator from the load of the whole vehicle."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from seatrial._core import Vehicle
from seatrial.base.errors import TrialError
from seatrial.bench_test.characteristic import actuator_ratios
from seatrial.bench_test.evaluate import bench
from seatrial.bench_test.file import unit_of
from seatrial.bench_test.plateaus import Plateau, Separated, force_per_newton, separate
from tests.bench_test.bench_records import TRUTH, pull, write_bench

CWOLF = Vehicle.load("cwolf")
ANGLE = np.deg2rad(15.0)


def separated(
    axes: str, load: list[float], signal: dict[str, float], *, group: str = "stern", vehicle: Vehicle = CWOLF
) -> Separated:
    signals = dict.fromkeys(vehicle.actuators, 0.0) | signal
    plateau = Plateau("row 1", signals, np.array(load), np.zeros(len(load)), np.nan, 1)
    unit = unit_of(vehicle, group, None, "test")
    found = separate(plateau, unit, force_per_newton(vehicle, axes), zero=1.0, where="test")
    assert found is not None
    return found


def test_stern_is_the_load_over_four_cosines_vertical_half_the_load() -> None:
    all_four = dict.fromkeys(("SbU", "SbL", "PU", "PL"), 1500.0)
    stern = separated("X", [100.0], all_four)
    # (39) to (42) with the assumed 15 degrees; the file's direction is rounded to 1e-6.
    assert stern.factor == pytest.approx(4.0 * np.cos(ANGLE) * np.cos(ANGLE), rel=2e-6)
    assert stern.thrust == pytest.approx(100.0 / (4.0 * np.cos(ANGLE) ** 2), rel=2e-6)
    vertical = separated("Z", [-40.0], {"VTB": -900.0, "VTS": -900.0}, group="vertical")
    assert (vertical.factor, vertical.thrust, vertical.signal) == (2.0, -20.0, -900.0)


def test_an_actuator_alone_needs_its_own_direction_only() -> None:
    one = separated("X", [30.0], {"SbL": 1000.0})
    assert one.running == ("SbL",)
    assert one.thrust == pytest.approx(30.0 / np.cos(ANGLE) ** 2, rel=2e-6)


def test_three_axes_are_one_least_squares_thrust_and_say_what_lies_across() -> None:
    direction = np.asarray(CWOLF.allocation_matrix())[:3, 0]
    exact = separated("XYZ", (25.0 * direction).tolist(), {"SbU": 1000.0})
    assert exact.thrust == pytest.approx(25.0)
    assert exact.across == pytest.approx(0.0, abs=1e-12)
    normal = np.array([-direction[1], direction[0], 0.0]) / np.hypot(*direction[:2])
    bent = separated("XYZ", (25.0 * direction + 3.0 * normal).tolist(), {"SbU": 1000.0})
    assert bent.thrust == pytest.approx(25.0)
    assert bent.across == pytest.approx(3.0)


def test_law_thrust_does_not_depend_on_which_like_actuators_pull() -> None:
    for running in (("SbU",), ("SbU", "PL"), ("SbU", "SbL", "PU"), ("SbU", "SbL", "PU", "PL")):
        load = (
            17.0
            * np.asarray(CWOLF.allocation_matrix())[0, :4][
                [("SbU", "SbL", "PU", "PL").index(name) for name in running]
            ].sum()
        )
        assert separated("X", [load], dict.fromkeys(running, 800.0)).thrust == pytest.approx(17.0)


def test_a_thruster_against_the_axis_has_a_negative_factor_and_the_right_sign() -> None:
    beluga = Vehicle.load("beluga")
    up = ("thruster_1", "thruster_2", "thruster_5", "thruster_6")
    found = separated("Z", [-80.0], dict.fromkeys(up, 100.0), group="vertical", vehicle=beluga)
    assert found.thrust == pytest.approx(20.0)


def test_forces_that_cancel_along_the_cell_are_refused() -> None:
    with pytest.raises(TrialError, match="their forces cancel or act across it"):
        separated("Y", [5.0], dict.fromkeys(("SbU", "SbL", "PU", "PL"), 1000.0))


def test_ahead_beside_astern_is_refused() -> None:
    with pytest.raises(TrialError, match="pull with different signals"):
        separated("X", [5.0], {"SbU": 1000.0, "PU": -1000.0})


def test_actuators_driven_one_by_one_are_one_characteristic(tmp_path: Path) -> None:
    names = ("SbU", "SbL", "PU", "PL")
    matrix = np.asarray(CWOLF.allocation_matrix())[:3, :4]
    rows = []
    for k, name in enumerate(names):
        for signal in (0.0, 600.0, 1000.0, 1400.0 + 50.0 * k, 2000.0):
            _, a1, a11 = TRUTH["stern"][1.0]
            force = matrix[:, k] * (a1 * signal + a11 * signal**2)
            commands = {f"cmd.{other}": signal if other == name else 0.0 for other in names}
            rows.append({f"load.{axis}_n": force[j] for j, axis in enumerate("XYZ")} | commands)
    pl.DataFrame(rows).write_csv(tmp_path / "each.csv")
    found = bench(write_bench(tmp_path, pull("each", keys='axis = "XYZ"'))).pulls["stern"]
    assert len(found.points.signal) == 16
    # Exact data: what is left is the rounding of the file's directions.
    np.testing.assert_allclose(
        found.directions["ahead"].fit.coefficients, [0.0, a1, a11], rtol=1e-6, atol=1e-6
    )


def test_actuators_that_pull_unlike_are_told_apart_when_driven_one_by_one(tmp_path: Path) -> None:
    names, strength = ("SbU", "SbL", "PU", "PL"), (1.1, 0.9, 1.0, 1.0)
    rng = np.random.default_rng(1)
    _, a1, a11 = TRUTH["stern"][1.0]
    rows = [
        {f"cmd.{other}": signal if other == name else 0.0 for other in names}
        | {"load.X_n": matrix * factor * (a1 * signal + a11 * signal**2) + 0.1 * rng.standard_normal()}
        for name, factor, matrix in zip(
            names, strength, np.asarray(CWOLF.allocation_matrix())[0, :4], strict=True
        )
        for signal in (0.0, 800.0, 1200.0, 1600.0, 2000.0)
    ]
    pl.DataFrame(rows).write_csv(tmp_path / "each.csv")
    found = bench(write_bench(tmp_path, pull("each"), more='[regression]\noutliers = "keep"\n'))
    ratios = actuator_ratios(found.pulls["stern"])
    for name, factor in zip(names, strength, strict=True):
        ratio, deviation = ratios[(name,)]
        # The common curve is the mean of the four, whose factors are one on average.
        assert ratio == pytest.approx(factor, abs=0.01)
        assert deviation < 0.01
    assert any("thrust over that of the common curve: SbU 1.1" in text for text in found.sentences())


def test_a_crooked_cell_is_warned_of(tmp_path: Path) -> None:
    rows = [
        {"load.X_n": 40.0 * s, "load.Y_n": 8.0 * s, "rpm": 1000.0 * s} for s in (0.0, 0.5, 1.0, 1.5, 1.8, 2.0)
    ]
    pl.DataFrame(rows).write_csv(tmp_path / "bent.csv")
    keys = 'axis = "XY"\ncolumns = { "cmd.stern" = "rpm" }'
    test = bench(write_bench(tmp_path, pull("bent", keys=keys)))
    assert [doubt.kind for doubt in test.records["bent"].doubts] == ["load across"]
    assert any("20 % of the load acts across the direction" in text for text in test.sentences())
