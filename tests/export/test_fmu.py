"""Units of FMI 2.0 and 3.0: valid, run by FMPy, and coupled they fly as the product does."""

from __future__ import annotations

import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial.base.errors import SimulationError
from seatrial.export.fmu import base_units, ran

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
needs_compiler = pytest.mark.skipif(
    not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="there is no C compiler"
)

MISSION = """format = 1
name = "dive"
speed_m_s = 1.5
acceptance_radius_m = 5.0
[[legs]]
north_m = 40.0
east_m = 0.0
depth_m = 5.0
[[legs]]
north_m = 40.0
east_m = 30.0
depth_m = 5.0
"""

CURRENT = (0.1, -0.15, 0.0)


@pytest.fixture(scope="module")
def units(tmp_path_factory: pytest.TempPathFactory) -> st.FmuExport:
    folder = tmp_path_factory.mktemp("fmu")
    (folder / "dive.toml").write_text(MISSION)
    known = st.Fitted.of("cwolf", percent={"X_uu": 10.0})
    return st.export_fmu(known, "cwolf", mission=folder / "dive.toml", out=folder, samples=3, seed=4)


class Unit:
    """A unit at work, by the names of its variables, whatever its version."""

    def __init__(self, path: Path, folder: Path) -> None:
        from fmpy.fmi2 import FMU2Slave
        from fmpy.fmi3 import FMU3Slave

        self.description: Any = fmpy.read_model_description(str(path))
        self.reference = {one.name: one.valueReference for one in self.description.modelVariables}
        self.names = {
            kind: [one.name for one in self.description.modelVariables if one.causality == kind]
            for kind in ("input", "output", "parameter")
        }
        self.two = self.description.fmiVersion.startswith("2")
        token = self.description.guid if self.two else self.description.instantiationToken
        facts = {
            "unzipDirectory": fmpy.extract(str(path), unzipdir=str(folder)),
            "modelIdentifier": self.description.coSimulation.modelIdentifier,
            "instanceName": "one",
        }
        kind = FMU2Slave if self.two else FMU3Slave
        self.slave = kind(guid=token, **facts)
        self.slave.instantiate()
        if self.two:
            self.slave.setupExperiment(startTime=0.0)
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()

    def set(self, values: dict[str, float]) -> None:
        write = self.slave.setReal if self.two else self.slave.setFloat64
        write([self.reference[name] for name in values], list(values.values()))

    def choose(self, number: int) -> None:
        write = self.slave.setInteger if self.two else self.slave.setInt32
        write([self.reference["parameter_set"]], [number])

    def get(self, names: list[str]) -> dict[str, float]:
        read = self.slave.getReal if self.two else self.slave.getFloat64
        return dict(zip(names, read([self.reference[name] for name in names]), strict=True))

    def step(self, now: float, size: float) -> None:
        self.slave.doStep(now, size)

    def state(self) -> Any:
        return self.slave.getFMUstate() if self.two else self.slave.getFMUState()

    def restore(self, state: Any) -> None:
        (self.slave.setFMUstate if self.two else self.slave.setFMUState)(state)


@contextmanager
def running(export: st.FmuExport, name: str, tmp_path: Path) -> Iterator[Unit]:
    path = next(one for one in export.files if one.name == name)
    unit = Unit(path, tmp_path / name)
    yield unit
    unit.slave.terminate()
    unit.slave.freeInstance()


@pytest.mark.long
@needs_compiler
@pytest.mark.parametrize("version", ["fmi2", "fmi3"])
def test_coupled_units_fly_as_the_product_does(units: st.FmuExport, version: str, tmp_path: Path) -> None:
    period, periods = 0.1, 400
    flight = st.fly(
        "cwolf",
        "cwolf",
        units.files[0].parent / "dive.toml",
        water=st.Water(current=CURRENT),
        conditions=st.Conditions(max_time_s=60.0),
    )
    with (
        running(units, f"cwolf_vehicle.{version}.fmu", tmp_path) as vehicle,
        running(units, f"cwolf_autopilot.{version}.fmu", tmp_path) as autopilot,
    ):
        vehicle.set(dict(zip(("current_north", "current_east", "current_down"), CURRENT, strict=True)))
        autopilot.set({name: 0.0 for name in autopilot.names["input"] if name.startswith("age_")})
        told = [name for name in autopilot.names["input"] if name in vehicle.names["output"]]
        commands = vehicle.names["input"][:-4]
        rows = []
        for k in range(periods):
            seen = vehicle.get(told)
            rows.append(seen)
            autopilot.set(seen)
            autopilot.step(k * period, period)
            vehicle.set(autopilot.get(commands))
            vehicle.step(k * period, period)
    assert len(told) == 16 + 6
    flown = np.column_stack([flight.position, flight.euler, flight.nu])[:periods]
    for column, name in enumerate(("x", "y", "z", "roll", "pitch", "yaw", "u", "v", "w", "p", "q", "r")):
        ours, theirs = np.array([row[name] for row in rows]), flown[:, column]
        # Rounding of 400 periods in closed loop; libm is the same.
        assert np.abs(ours - theirs).max() < 1e-9, name
    assert np.ptp([row["z"] for row in rows]) > 2.0


@pytest.mark.long
@needs_compiler
@pytest.mark.parametrize("version", ["fmi2", "fmi3"])
def test_state_of_a_unit_is_kept_and_restored(units: st.FmuExport, version: str, tmp_path: Path) -> None:
    with running(units, f"cwolf_vehicle.{version}.fmu", tmp_path) as vehicle:
        vehicle.set(dict.fromkeys(vehicle.names["input"][:4], 1200.0))
        for k in range(50):
            vehicle.step(0.02 * k, 0.02)
        kept = vehicle.state()
        ways = []
        for _ in range(2):
            vehicle.restore(kept)
            for k in range(50, 100):
                vehicle.step(0.02 * k, 0.02)
            ways.append(vehicle.get(vehicle.names["output"]))
        assert ways[0] == ways[1]
        assert ways[0]["u"] > 0.1
        serialise = vehicle.slave.serializeFMUstate if vehicle.two else vehicle.slave.serializeFMUState
        restore = vehicle.slave.deSerializeFMUstate if vehicle.two else vehicle.slave.deserializeFMUState
        vehicle.restore(restore(serialise(kept)))
        vehicle.step(1.0, 1.0)
        assert vehicle.get(["u"]) == {"u": ways[0]["u"]}


@pytest.mark.long
@needs_compiler
def test_parameters_are_tunable_and_samples_are_sets(units: st.FmuExport, tmp_path: Path) -> None:
    drawn = st.Fitted.of("cwolf", percent={"X_uu": 10.0}).draws(3, 4)["X_uu"]

    def after(change: Any) -> float:
        with running(units, "cwolf_vehicle.fmi3.fmu", tmp_path) as vehicle:
            change(vehicle)
            vehicle.set(dict.fromkeys(vehicle.names["input"][:4], 1500.0))
            for k in range(30):
                vehicle.step(1.0 * k, 1.0)
            return vehicle.get(["u"])["u"]

    assert units.samples == 3
    by_set = [after(lambda vehicle, k=k: vehicle.choose(k)) for k in range(4)]
    by_value = [after(lambda vehicle, x=x: vehicle.set({"parameters.X_uu": float(x)})) for x in drawn]
    assert by_set[1:] == by_value
    assert len({*by_set}) == 4


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> st.FmuExport:
    """Units of an ROV without thrusters: small sources, quick to compile."""
    text = (
        'format = 1\nname = "bare"\n[geometry]\nlength_m = 1.0\ndiameter_m = 0.3\n[coefficients]\nm = 10.0\n'
        "B = 97.0\nX_u = -2.0\nY_v = -2.0\nZ_w = -2.0\nK_p = -0.2\nM_q = -0.2\nN_r = -0.2\n"
    )
    return st.export_fmu(st.Vehicle.from_toml(text), out=tmp_path_factory.mktemp("bare"))


def refuses(call: Any) -> bool:
    """Whether a call of FMPy ends with another status than OK."""
    try:
        call()
    except Exception as error:  # FMPy's own, whose class differs between versions
        return "failed with status" in str(error)
    return False


@needs_compiler
@pytest.mark.parametrize("version", ["fmi2", "fmi3"])
def test_a_unit_refuses_what_is_no_number_or_no_vehicle(
    bare: st.FmuExport, version: str, tmp_path: Path
) -> None:
    with running(bare, f"bare_vehicle.{version}.fmu", tmp_path) as vehicle:
        before = vehicle.get(["u", "z"])
        for mass in (float("nan"), 0.0, -5.0, float("inf"), 1e12):
            assert refuses(lambda m=mass: vehicle.set({"parameters.m": m})), mass
        for value in (float("nan"), float("inf"), float("-inf")):
            assert refuses(lambda x=value: vehicle.set({"current_north": x})), value
        assert refuses(lambda: vehicle.set({"bottom": float("nan")}))
        vehicle.set({"bottom": 30.0})
        vehicle.set({"bottom": float("inf")})  # none, as it began
        # A sum that is no inertia, of a number that is in its range: told when it is used.
        vehicle.set({"parameters.X_udot": 20.0})
        assert refuses(lambda: vehicle.step(0.0, 0.02))
        vehicle.set({"parameters.X_udot": -0.5})
        assert vehicle.get(["u", "z"]) == before
        vehicle.step(0.0, 0.02)


@needs_compiler
@pytest.mark.parametrize("version", ["fmi2", "fmi3"])
def test_the_time_of_a_unit_goes_on_from_where_it_is(
    bare: st.FmuExport, version: str, tmp_path: Path
) -> None:
    with running(bare, f"bare_vehicle.{version}.fmu", tmp_path) as vehicle:
        for k in range(100):
            vehicle.step(0.02 * k, 0.02)
        for now, size in (
            (1.0, 0.02),
            (3.0, 0.02),
            (float("nan"), 0.02),
            (2.0, -0.02),
            (2.0, 0.0),
            (2.0, float("nan")),
        ):
            assert refuses(lambda now=now, size=size: vehicle.step(now, size)), (now, size)
        vehicle.step(2.0, 0.02)


@needs_compiler
@pytest.mark.parametrize("version", ["fmi2", "fmi3"])
def test_a_damaged_state_is_refused(bare: st.FmuExport, version: str, tmp_path: Path) -> None:
    with running(bare, f"bare_vehicle.{version}.fmu", tmp_path) as vehicle:
        vehicle.step(0.0, 0.2)
        serialise = vehicle.slave.serializeFMUstate if vehicle.two else vehicle.slave.serializeFMUState
        restore = vehicle.slave.deSerializeFMUstate if vehicle.two else vehicle.slave.deserializeFMUState
        whole = bytes(serialise(vehicle.state()))
        for place in (0, len(whole) // 2, len(whole) - 1):
            damaged = bytearray(whole)
            damaged[place] ^= 0x10
            assert refuses(lambda data=bytes(damaged): restore(data)), place
        assert refuses(lambda: restore(whole[:-8]))
        vehicle.restore(restore(whole))


@pytest.mark.long
def test_units_are_valid_and_hold_their_sources(units: st.FmuExport) -> None:
    from fmpy.validation import validate_fmu

    assert len(units.files) == 4
    for path in units.files:
        assert not validate_fmu(str(path)), path
        description = fmpy.read_model_description(str(path))
        by_name = {one.name: one for one in description.modelVariables}
        if "vehicle" in path.name:
            assert by_name["parameters.m"].unit == "kg"
            assert by_name["parameters.m"].variability == "tunable"
        assert {one.causality for one in description.modelVariables} >= {"input", "output", "parameter"}


def test_a_unit_without_a_compiler_holds_sources_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("seatrial.export.fmu.c_compiler", lambda: "")
    assert "sources only: no C compiler is there" in st.export_fmu("remus100", out=tmp_path).report().text()
    export = st.export_fmu("remus100", out=tmp_path, compiler="")
    assert "sources only, as asked for" in export.report().text()
    import zipfile

    names = zipfile.ZipFile(export.files[1]).namelist()
    assert "sources/remus_100_vehicle.c" in names or "sources/remus100_vehicle.c" in names
    assert not [name for name in names if name.startswith("binaries/")]


def test_every_unit_of_the_built_in_vehicles_is_made_of_base_units(tmp_path: Path) -> None:
    for name in st.Vehicle.names():
        vehicle = st.Vehicle.load(name)
        for facts in vehicle.coefficient_info().values():
            assert facts["unit"] in ("", "1") or base_units(facts["unit"]) is not None, facts


def test_impossible_arguments_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SimulationError, match="count as exact"):
        st.export_fmu("cwolf", out=tmp_path, samples=5, compiler="")
    with pytest.raises(SimulationError, match="from 0 to 1000"):
        st.export_fmu("cwolf", out=tmp_path, samples=-1)
    with pytest.raises(SimulationError, match="cannot build"):
        st.export_fmu("cwolf", out=tmp_path, compiler="false")


def test_a_program_that_takes_too_long_ends_with_all_that_it_started() -> None:
    # The shell's child holds the pipes: without an end of the whole session they would be read for a minute.
    began = time.monotonic()
    with pytest.raises(subprocess.TimeoutExpired):
        ran(["sh", "-c", "sleep 60 & wait"], limit_s=0.2)
    assert time.monotonic() - began < 30.0
    assert ran(["cat"]).stdout == ""  # nothing to read, so nothing to wait for
