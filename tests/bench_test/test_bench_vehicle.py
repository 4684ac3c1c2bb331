"""Results in the vehicle file: every kind gives the fitted thrust, comments stay, others are left alone."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from seatrial._core import Vehicle
from seatrial.base.errors import SeatrialError
from seatrial.bench_test.evaluate import BenchTest, bench
from seatrial.vehicle.actuators import bollard
from tests.bench_test.bench_records import (
    FACTOR,
    STEPS,
    both_ways,
    pull,
    record,
    staircase,
    thrust,
    write_bench,
)

COMMENTED = Path(__file__).parents[2] / "crates" / "seatrial" / "vehicles" / "cwolf.toml"
SIGNALS = (-1900.0, -1000.0, -400.0, 400.0, 1000.0, 1900.0)


def thrusts(vehicle: Vehicle, group: str = "stern") -> list[float]:
    """Thrust of one actuator of the group, from the load that the whole group makes in the model."""
    names = {"stern": ("SbU", "SbL", "PU", "PL"), "vertical": ("VTB", "VTS")}[group]
    row = 0 if group == "stern" else 2
    return [float(bollard(vehicle, dict.fromkeys(names, signal))[row] / FACTOR[group]) for signal in SIGNALS]


def on_file(folder: Path, *, more: str = "", text: str | None = None) -> Path:
    """Path of a bench file whose vehicle is a commented file beside it."""
    path = both_ways(folder, more=more)
    (folder / "cwolf.toml").write_text(text or COMMENTED.read_text(encoding="utf-8"), encoding="utf-8")
    path.write_text(path.read_text().replace('vehicle = "cwolf"', 'vehicle = "cwolf.toml"'))
    return path


def fitted(found: BenchTest) -> list[float]:
    return [float(x) for x in found.pulls["stern"].thrust(np.array(SIGNALS))]


@pytest.mark.parametrize(
    ("keys", "kind"),
    [
        ("order = 2", "polynomial"),
        ("order = 1", "polynomial"),
        ("order = 2\nthrough_origin = true", "polynomial"),
        ('order = "square"', "quadratic"),
        ('order = "square"\nkind = "polynomial"', "polynomial"),
        ('order = 2\nkind = "table"', "table"),
        ("order = 3", "table"),
        ('order = "points"', "table"),
    ],
)
def test_the_written_file_gives_the_fitted_thrust(tmp_path: Path, keys: str, kind: str) -> None:
    found = bench(on_file(tmp_path, more=f"[regression]\n{keys}\n"))
    written = found.save_vehicle(tmp_path / "new.toml")
    vehicle = Vehicle.load(written)
    assert vehicle.actuator_info()["SbU"]["characteristic"] == kind
    # Six written digits; a table of 12 chords per direction is up to 1.9e-5 (2000/12)^2 / 4 N = 0.13 N off.
    tolerance = 0.15 if kind == "table" else 1e-3
    np.testing.assert_allclose(thrusts(vehicle), fitted(found), atol=tolerance)
    np.testing.assert_allclose(thrusts(vehicle), thrusts(found.vehicle), atol=1e-9)
    assert thrusts(vehicle, "vertical") == thrusts(Vehicle.load("cwolf"), "vertical")


def test_what_a_bollard_test_does_not_measure_is_kept(tmp_path: Path) -> None:
    found = bench(on_file(tmp_path))
    entry = tomllib.loads(found.vehicle_text)["characteristics"]["stern"]
    before = tomllib.loads(COMMENTED.read_text())["characteristics"]["stern"]
    for key in ("alpha2", "diameter_m", "wake", "power_w_s3"):
        assert entry[key] == before[key]
    assert "alpha1_ahead" not in entry
    old, new = found.before.coefficients(), found.vehicle.coefficients()
    assert new["SbU.p2"] == pytest.approx(old["SbU.p2"])


def test_comments_and_everything_else_of_the_file_stay(tmp_path: Path) -> None:
    found = bench(on_file(tmp_path, more='[regression]\norder = "square"\n'))
    before, after = COMMENTED.read_text().splitlines(), found.vehicle_text.splitlines()
    changed = [line for line in before if line not in after]
    assert (
        changed
        == [line for line in before if line.startswith("alpha1_a") and ("0.35" in line or "0.25 " in line)][
            :2
        ]
    )
    assert sum("bench test basin, +-" in line for line in after) == 2
    assert len(after) == len(before)


def test_a_characteristic_that_others_share_is_split(tmp_path: Path) -> None:
    text = COMMENTED.read_text().replace('characteristic = "vertical"', 'characteristic = "stern"')
    found = bench(on_file(tmp_path, text=text))
    table = tomllib.loads(found.vehicle_text)
    named = {one["name"]: one["characteristic"] for one in table["thrusters"]}
    assert named == dict.fromkeys(("SbU", "SbL", "PU", "PL"), "stern_stern") | dict.fromkeys(
        ("VTB", "VTS"), "stern"
    )
    assert table["characteristics"]["stern"]["kind"] == "quadratic"
    assert table["characteristics"]["stern_stern"]["wake"] == 0.1
    assert any("characteristic stern_stern, split from stern" in note for note in found.notes)
    np.testing.assert_allclose(thrusts(found.vehicle), fitted(found), atol=1e-3)


def test_actuators_tested_alone_get_their_own_entry(tmp_path: Path) -> None:
    record(staircase(), columns=("SbU",)).write_csv(tmp_path / "one.csv")
    record(staircase([-s for s in STEPS]), columns=("SbU",)).write_csv(tmp_path / "two.csv")
    text = "".join(pull(name).replace('group = "stern"', 'actuators = ["SbU"]') for name in ("one", "two"))
    found = bench(write_bench(tmp_path, text))
    named = {one["name"]: one["characteristic"] for one in tomllib.loads(found.vehicle_text)["thrusters"]}
    assert named["SbU"] == "stern_SbU"
    assert named["SbL"] == "stern"


def test_factors_that_corrected_the_old_characteristic_are_taken_out(tmp_path: Path) -> None:
    text = COMMENTED.read_text().replace(
        "[coefficients]\n", '[coefficients]\n"SbU.gain" = 0.8\n"PL.astern_ratio" = 0.9\n"VTB.gain" = 0.7\n'
    )
    found = bench(on_file(tmp_path, text=text))
    assert '"VTB.gain"' in found.vehicle_text
    assert '"SbU.gain"' not in found.vehicle_text
    assert any(
        "removed from [coefficients]" in note and "SbU.gain, PL.astern_ratio" in note for note in found.notes
    )
    np.testing.assert_allclose(thrusts(found.vehicle), fitted(found), atol=1e-3)


def test_fresh_water_of_the_basin_and_thrust_deduction_are_allowed_for(tmp_path: Path) -> None:
    text = COMMENTED.read_text().replace("wake = 0.1 ", "thrust_deduction = 0.1\nwake = 0.1 ")
    found = bench(on_file(tmp_path, text=text, more="rho_kg_m3 = 998.0\n"))
    # The file holds for 1025 kg/m³: in the basin's water the model pulls what was measured there.
    np.testing.assert_allclose(np.array(thrusts(found.vehicle)) * 998.0 / 1025.0, fitted(found), atol=1e-3)
    assert tomllib.loads(found.vehicle_text)["characteristics"]["stern"]["thrust_deduction"] == 0.1


@pytest.mark.parametrize("order", ["2", '"square"'])
def test_a_direction_that_was_not_tested_keeps_the_old_thrust(tmp_path: Path, order: str) -> None:
    path = on_file(tmp_path, more=f"[regression]\norder = {order}\n")
    text = path.read_text()
    path.write_text(text[: text.index('[[pulls]]\nname = "astern"')])
    found = bench(path)
    old, new = thrusts(found.before), thrusts(found.vehicle)
    np.testing.assert_allclose(new[:3], old[:3], rtol=1e-5)
    assert abs(new[-1] - old[-1]) > 1.0
    assert "not tested, kept" in found.vehicle_text


@pytest.mark.parametrize("order", ["2", '"square"'])
@pytest.mark.parametrize("name", ["gain", "astern_ratio", "p1_astern"])
def test_a_direction_that_was_not_tested_keeps_its_corrections(tmp_path: Path, order: str, name: str) -> None:
    lines = "".join(f'"{actuator}.{name}" = 0.04\n' for actuator in ("SbU", "SbL", "PU", "PL"))
    text = COMMENTED.read_text().replace("[coefficients]\n", f"[coefficients]\n{lines}")
    path = on_file(tmp_path, more=f"[regression]\norder = {order}\n", text=text)
    path.write_text(path.read_text()[: path.read_text().index('[[pulls]]\nname = "astern"')])
    found = bench(path)
    # Six written digits.
    np.testing.assert_allclose(thrusts(found.vehicle)[:3], thrusts(found.before)[:3], rtol=1e-5)
    np.testing.assert_allclose(thrusts(found.vehicle)[3:], fitted(found)[3:], atol=1e-3)


@pytest.mark.parametrize("keys", ["order = 2", 'order = "square"', 'order = "points"', "order = 3"])
def test_a_direction_that_the_motor_does_not_turn_need_not_be_tested(tmp_path: Path, keys: str) -> None:
    rows = "".join(f"{force},{0.9 * force}\n" for force in range(1, 15))
    (tmp_path / "ahead.csv").write_text(f"cmd.propeller,load.X_n\n{rows}")
    text = pull("ahead", group="stern", keys='axis = "X"\ntare = false')
    found = bench(write_bench(tmp_path, text, vehicle="lauv", more=f"[regression]\n{keys}\n"))
    written = Vehicle.from_toml(found.vehicle_text, "lauv")
    assert written.actuator_info()["propeller"]["maximum_astern"] == 0.0
    for force in (0.0, -5.0):
        assert bollard(written, {"propeller": force})[0] == pytest.approx(0.0, abs=1e-9)
    if keys != 'order = "square"':  # which does not fit a straight line
        assert bollard(written, {"propeller": 10.0})[0] == pytest.approx(9.0, rel=1e-3)


def test_an_actuator_that_ran_in_the_dead_band_alone_is_no_trouble(tmp_path: Path) -> None:
    signals = [-2000, -1500, -1000, -700, -500, -300, 300, 500, 700, 1000, 1500, 2000]
    load = [0.05 * np.sign(s) * max(abs(s) - 500, 0) for s in signals]
    rows = [f"{s},0,0,0,{f}\n" for s, f in zip(signals, load, strict=True)]
    rows += [f"0,0,0,{s},0.0\n" for s in (300, 400, 500)]
    (tmp_path / "one.csv").write_text("cmd.SbU,cmd.SbL,cmd.PU,cmd.PL,load.X_n\n" + "".join(rows))
    text = pull("one", keys='axis = "X"\ntare = false')
    found = bench(write_bench(tmp_path, text, more='[regression]\norder = "points"\n'))
    assert any("dead band: no thrust from -500 to +500" in sentence for sentence in found.sentences())


def test_an_untested_direction_with_unlike_corrections_is_not_written(tmp_path: Path) -> None:
    text = COMMENTED.read_text().replace("[coefficients]\n", '[coefficients]\n"SbU.gain" = 0.8\n')
    path = on_file(tmp_path, text=text)
    path.write_text(path.read_text()[: path.read_text().index('[[pulls]]\nname = "astern"')])
    found = bench(path)
    assert thrusts(found.vehicle) == thrusts(found.before)
    assert any("pull astern too" in warning for warning in found.warnings)


def test_what_cannot_be_written_is_said_and_the_rest_is(tmp_path: Path) -> None:
    path = on_file(tmp_path, more='[regression]\norder = "points"\n')
    text = path.read_text()
    path.write_text(text[: text.index('[[pulls]]\nname = "astern"')])
    found = bench(path)
    assert any("stern is not written" in text and "pull astern too" in text for text in found.warnings)
    assert found.vehicle_text == COMMENTED.read_text()


def test_a_table_that_drops_the_inflow_says_so(tmp_path: Path) -> None:
    found = bench(on_file(tmp_path, more='[regression]\norder = "points"\n'))
    assert any("WARNING: kind table knows no inflow: alpha2 of stern dropped" in note for note in found.notes)


def test_a_file_is_never_overwritten_silently_and_never_in_part(tmp_path: Path) -> None:
    found = bench(on_file(tmp_path))
    target = tmp_path / "mine.toml"
    target.write_text("precious")
    with pytest.raises(SeatrialError, match="exists and is not overwritten"):
        found.save_vehicle(target)
    assert target.read_text() == "precious"
    found.save_vehicle(target, replace=True)
    assert target.read_text() == found.vehicle_text
    with pytest.raises(SeatrialError, match="cannot be written"):
        found.save_vehicle(tmp_path / "no" / "such" / "folder.toml")
    assert [p.name for p in tmp_path.glob("*.writing")] == []


def test_a_vehicle_object_may_stand_for_the_file(tmp_path: Path) -> None:
    heavier = Vehicle.load("cwolf").with_coefficients({"m": 140.0})
    found = bench(both_ways(tmp_path), vehicle=heavier)
    assert found.vehicle_path is None
    assert found.vehicle.coefficients()["m"] == 140.0


def test_two_entries_of_one_group_are_both_written(tmp_path: Path) -> None:
    text = COMMENTED.read_text()
    start = text.index("[characteristics.stern]")
    entry = text[start : text.index("[characteristics.vertical]")]
    text = text.replace(entry, entry + entry.replace("characteristics.stern", "characteristics.port"))
    at = text.index('name = "PL"')
    text = text[:at] + text[at:].replace('characteristic = "stern"', 'characteristic = "port"', 1)
    found = bench(on_file(tmp_path, text=text))
    written = tomllib.loads(found.vehicle_text)["characteristics"]
    assert written["stern"] == written["port"]


def test_inline_tables_are_written_and_split_too(tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(
        'format = 1\nname = "small"\ncontrollable = ["X"]\n'
        "coefficients = { m = 10.0, B = 98.1, I_x = 1.0, I_y = 1.0, I_z = 1.0 }\n"
        'characteristics = { screw = { kind = "quadratic", p1_ahead = 0.01 } } # mine\n'
        '[[thrusters]]\nname = "only"\ncommand = "rpm"\nposition_m = [0, 0, 0]\ndirection = [1, 0, 0]\n'
        'characteristic = "screw"\n[[thrusters]]\nname = "other"\ncommand = "rpm"\n'
        'position_m = [0, 0, 0]\ndirection = [0, 1, 0]\ncharacteristic = "screw"\n'
    )
    signal = np.array([-2000.0, -1500.0, -1000.0, -500.0, 0.0, 500.0, 1000.0, 1500.0, 2000.0])
    pl.DataFrame({"cmd.only": signal, "load.X_n": [thrust("stern", s) for s in signal]}).write_csv(
        tmp_path / "pull.csv"
    )
    for order in ('"square"', '"points"'):
        path = write_bench(
            tmp_path,
            pull("pull", group="only"),
            vehicle="small.toml",
            more=f"[regression]\norder = {order}\n",
        )
        found = bench(path)
        assert "# mine" in found.vehicle_text
        load = bollard(found.vehicle, {"only": 1500.0})[0]
        assert load == pytest.approx(found.pulls["only"].thrust(np.array([1500.0]))[0], rel=1e-4)
