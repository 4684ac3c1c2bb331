"""C of the navigation filter: fed with the same samples it estimates what the core's filter does."""

from __future__ import annotations

import math
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError
from seatrial.export.c_code import Program
from seatrial.export.fmu import ran
from seatrial.flight.disturbances import SeaState
from seatrial.flight.navigation import Beacon, Pen, Wall
from seatrial.sensors.sensor import Sensor
from tests.export.test_c import CURRENT, STRICT, needs, on_a_cortex_m7, ready, rows

HERE = Path(__file__).parent
MISSION = """format = 1
name = "tour"
speed_m_s = 1.5
acceptance_radius_m = 5.0
[limits]
max_depth_m = 30.0
[[legs]]
north_m = 25.0
east_m = 0.0
depth_m = 6.0
[[legs]]
north_m = 25.0
east_m = 20.0
depth_m = 4.0
hold_s = 5.0
"""
SENSORS = {
    "position": ("x", "y"),
    "depth": ("z",),
    "attitude": ("roll", "pitch", "yaw"),
    "dvl": ("u", "v", "w"),
    "gyro": ("p", "q", "r"),
    "altitude": ("altitude",),
    "dvl_water": ("u_water", "v_water", "w_water"),
    "gps": ("gps_x", "gps_y"),
    "usbl": ("usbl_x", "usbl_y", "usbl_z"),
}
"""Channels of the function of each sensor, in the order in which they are told."""


def main_of(program: Program, sensors: Sequence[str], marks: Mapping[str, Any]) -> tuple[str, list[str]]:
    """A program that prints the estimate of each period; the names of the numbers that it reads for it."""
    prefix, reads = program.prefix, [row["name"] for row in program.inputs]
    inputs = len(reads)
    told = [f"in.{name} = ({prefix}_real)x[{i}];" for i, name in enumerate(reads) if name.startswith("act_")]
    kept = [f"in.{name} = ({prefix}_real)x[{i}];" for i, name in enumerate(reads) if name.startswith("cmd_")]
    calls: dict[str, str] = {}
    for kind in sensors:
        for i, name in enumerate(SENSORS[kind]):
            at, value = len(reads), "v[0]" if len(SENSORS[kind]) == 1 else "v"
            calls[name] = (
                f"v[0] = v[1] = v[2] = ({prefix}_real)NAN; v[{i}] = ({prefix}_real)x[{at}];"
                f" {prefix}_{kind}(&p, &k, &s, {value}, ({prefix}_real)x[{at + 1}]);"
            )
            reads += [name, f"age {name}"]
    for name, mark in marks.items():
        at = len(reads)
        index, v = f"{prefix}_MARK_{name}", f"({prefix}_real)x"
        calls[f"range.{name}"] = f"{prefix}_range(&p, &k, &s, {index}, {v}[{at}], 0);"
        bearing = f"{prefix}_bearing(&p, &k, &s, {index}, {v}[{at + 1}], 0);"
        looked = f"{prefix}_look(&s, {index}, {v}[{at + 1}]);"
        calls[f"bearing.{name}"] = bearing if isinstance(mark, Beacon) else looked
        reads += [f"range.{name}", f"bearing.{name}"]
    # The core takes bearings first, and then the channels of a call by their names.
    told_in_order = [calls[name] for name in sorted(calls, key=lambda name: (name[:8] != "bearing.", name))]
    shown = [row["name"] for row in program.outputs]
    prints = "".join(f'printf("%.17g ", (double)out.{name});' for name in shown)
    text = f"""#include <math.h>
#include <stdio.h>
#include "{prefix}.h"
int main(void)
{{
    static {prefix}_parameters p;
    static {prefix}_constants k;
    static {prefix}_state s;
    static {prefix}_input in;
    static {prefix}_output out;
    static double x[{len(reads)}];
    {prefix}_real v[3];
    int i;
    int n;
    {prefix}_defaults(&p);
    {prefix}_prepare(&p, &k);
    {prefix}_begin(&s, &in);
    for (;;)
    {{
        for (i = 0, n = 0; i < {len(reads)}; i++)
        {{
            n += scanf("%lf", &x[i]) == 1;
        }}
        if (n < {len(reads)})
        {{
            break;
        }}
        {" ".join(told + kept)}
        {prefix}_predict(&p, &k, &s, &in);
        {" ".join(told_in_order)}
        {prefix}_settle(&p, &k, &s);
        {prefix}_estimate(&p, &s, &out);
        {prints}
        for (i = 0; i < 24; i++)
        {{
            printf("%.17g ", (double)out.deviation[i]);
        }}
        for (i = 0, n = 0; i < {prefix}_CHANNELS; i++)
        {{
            n += (int)(s.watch[i].refused + (1000u * s.watch[i].recovered));
        }}
        printf("%d\\n", n);
    }}
    return (v[0] > 0) ? 0 : 0;
}}
"""
    assert inputs == len(told) + len(kept)
    return text, reads


def compiled(folder: Path, sources: Sequence[str], compiler: str, *options: str, name: str = "run") -> Path:
    needs(compiler)
    program = folder / name
    command = [compiler, *STRICT, *options, *sources, "-o", str(program), "-lm"]
    ran(command, limit_s=300.0, folder=folder)
    return program


def trial(filter: st.NavigationFilter, seed: int, periods: int) -> list[dict[str, float]]:
    """Samples of every channel on a helix, each at its own rate: noise, gaps, wild points, jump, silence."""
    rng, rows = np.random.default_rng(seed), []
    known = filter.channels
    marks = [name[6:] for name in known if name.startswith("range.")]
    rates = {"x": 5, "y": 5, "u": 2, "v": 2, "w": 2, "gps_x": 9, "gps_y": 9, "usbl_x": 7, "usbl_y": 7}
    for n in range(periods):
        t = 0.1 * n
        yaw, depth = 0.2 * t, 5.0 + 0.1 * t
        at = np.array([6.0 * math.sin(yaw), 6.0 - 6.0 * math.cos(yaw), depth])
        truth = dict(zip("xyz", at, strict=True)) | {
            "roll": 0.02,
            "pitch": -0.05,
            "yaw": math.remainder(yaw, math.tau),
        }
        truth |= {"u": 1.2, "v": 0.02, "w": 0.1, "p": 0.0, "q": 0.0, "r": 0.2, "altitude": 40.0 - depth}
        truth |= {"u_water": 1.1, "v_water": 0.1, "w_water": 0.1, "gps_x": at[0], "gps_y": at[1]}
        truth |= {"usbl_x": at[0], "usbl_y": at[1], "usbl_z": at[2]}
        row = {
            name: value + 0.005 * rng.standard_normal()
            for name, value in truth.items()
            if n % rates.get(name, 1) == 0 and rng.random() < 0.95
        }
        for name in marks:
            if rng.random() < 0.2:
                row |= {
                    f"range.{name}": 30.0 + rng.standard_normal(),
                    f"bearing.{name}": rng.uniform(-1.0, 1.0),
                }
        if n == 40 and "x" in row:
            row["x"] += 100.0
        if 90 <= n < 170 and "z" in row:
            row["z"] += 3.0
        if 120 <= n < 135:
            row.pop("z", None)
        rows.append({name: float(value) for name, value in row.items() if name in known})
    return rows


def compared(
    folder: Path,
    filter: st.NavigationFilter,
    vehicle: str,
    marks: Mapping[str, Any],
    *,
    periods: int,
    options: Sequence[str] = ("-O1",),
    compiler: str = "gcc",
    seed: int = 1,
    late: bool = False,
    voltage_v: float | None = None,
) -> tuple[Array, Array, int]:
    """Estimates of the core's filter and of its C over a trial, and the refusals."""
    needs(compiler)
    made = st.export_c(vehicle, out=folder, navigation=filter, name="it", voltage_v=voltage_v)
    program = made.programs.filter
    assert program is not None
    sensors = [kind for kind in SENSORS if f"void {program.prefix}_{kind}(" in program.header]
    text, reads = main_of(program, sensors, marks)
    (folder / "main.c").write_text(text)
    binary = compiled(folder, ("main.c", f"{program.prefix}.c"), compiler, *options)
    rng = np.random.default_rng(seed)
    lines, ours = [], []
    facts = st.Vehicle.load(vehicle).actuator_info()
    actuators = list(facts)
    neutral = {name: float(facts[name]["neutral"]) for name in actuators}
    held = dict(neutral)
    for n, row in enumerate(trial(filter, seed, periods)):
        ages: dict[str, float] = {}
        if late and n > 20:
            ages = {name: float(rng.choice([0.0, 0.1, 0.17])) for name in ("u", "v", "x") if name in row}
        measured = dict.fromkeys(actuators, math.nan)
        if n % 3 == 0:
            measured = {name: 0.9 * held[name] + 0.1 * neutral[name] + 0.01 for name in actuators}
        commands = dict(held)
        if n % 10 == 0:
            commands = {
                name: float(neutral[name] + rng.uniform(-0.3, 0.3) * facts[name]["maximum_ahead"])
                for name in actuators
            }
        told = filter.step(
            row | ({} if voltage_v is None else {"voltage": voltage_v}),
            commands,
            measured,
            ages=ages,
            dt_s=filter.period_s,
        )
        state = filter.state
        watches = filter.core.watches.values()
        count = sum(int(w[1]) + 1000 * int(w[2]) for w in watches)
        channels = [told.get(name["name"], 0.0) for name in program.outputs if name["name"] in told]
        deviations = np.concatenate([
            state[f"{part}_deviation"]
            for part in ("position", "attitude", "velocity", "force", "current", "gyro_bias")
        ])
        known = np.concatenate([state["force"], state["current"], state["gyro_bias"], deviations])
        ours.append([*channels, *known, count])
        values = {f"cmd_{name}": x for name, x in commands.items()} | {
            f"act_{k}": x for k, x in measured.items()
        }
        values |= row | {f"age {name}": age for name, age in ages.items()}
        lines.append(
            " ".join(repr(float(values.get(name, 0.0 if name[:3] == "age" else math.nan))) for name in reads)
        )
        held = commands
    said = subprocess.run(
        [binary], input="\n".join(lines) + "\n", check=True, capture_output=True, text=True, timeout=300
    )
    assert not said.stderr, said.stderr
    theirs = np.array([[float(x) for x in line.split()] for line in said.stdout.splitlines()])
    names = [row["name"] for row in program.outputs]
    keep = [i for i, name in enumerate(names) if not name.startswith("age_")]
    theirs = np.column_stack([theirs[:, keep], theirs[:, len(names) :]])
    assert len(ours) == len(theirs) == periods
    return np.array(ours), theirs, int(theirs[-1, -1])


def apart(ours: Array, theirs: Array) -> float:
    """Largest difference over the magnitude, one at least."""
    return float((np.abs(ours - theirs) / np.maximum(np.abs(ours), 1.0)).max())


ALL = {
    "depth": Sensor(noise=0.01, bias=0.05, position=(0.3, 0.0, -0.1)),
    "attitude": Sensor(noise=0.1, bias=0.2),
    "dvl": Sensor(noise=0.006, bias=0.002, position=(0.4, 0.0, 0.2)),
    "gyro": Sensor(noise=0.05, bias=0.02),
    "dvl_water": Sensor(noise=0.01, position=(0.4, 0.0, 0.2)),
    "gps": Sensor(noise=1.0, bias=1.5, position=(0.0, 0.0, -0.5)),
    "usbl": Sensor(noise=0.5, bias=0.2),
    "altitude": Sensor(noise=0.1),
    "range": Sensor(noise=0.5, position=(0.1, 0.0, 0.0)),
    "bearing": Sensor(noise=1.0),
}
MARKS: dict[str, Beacon | Wall | Pen] = {
    "buoy": Beacon(20.0, 5.0, 2.0),
    "quay": Wall(36.0, 0.0, 0.1),
    "pen": Pen(0.0, 0.0, 36.0),
}


def everything(vehicle: str = "cwolf", *, late: float = 0.0, gate: float = 5.0) -> st.NavigationFilter:
    """A filter with every kind of sensor and landmark."""
    return st.NavigationFilter(
        vehicle,
        ALL,
        landmarks=MARKS,
        seabed=(40.0, 0.01, -0.02),
        tilt={"dvl": (0.05, -0.02, 0.3), "gyro": (0.0, 0.02, 0.0), "attitude": (0.01, 0.0, 0.05)},
        gate=st.SampleGate(deviations=gate, longest_age_s=late),
    )


def test_every_sensor_in_c_is_the_cores(tmp_path: Path) -> None:
    ours, theirs, refused = compared(tmp_path, everything(), "cwolf", MARKS, periods=250, late=True)
    # The jump of the depth is refused for five seconds and then believed; wild points are refused.
    assert refused > 1000
    assert refused == int(ours[-1, -1])
    print(f"largest relative difference {apart(ours, theirs):.2g}, refusals {refused}")
    # Sums in another order; the covariance forgets what rounding did to it.
    assert apart(ours, theirs) < 1e-9


def test_a_late_sample_in_c_is_the_cores(tmp_path: Path) -> None:
    sensors = {
        "position": Sensor(noise=0.02, latency_s=0.2),
        "depth": Sensor(noise=0.01),
        "attitude": Sensor(noise=0.1, latency_s=0.03),
        "dvl": Sensor(noise=0.006, latency_s=0.14),
        "gyro": Sensor(noise=0.05),
    }
    filter = st.NavigationFilter("remus100", sensors, gate=st.SampleGate(longest_age_s=0.3))
    ours, theirs, _ = compared(tmp_path, filter, "remus100", {}, periods=200, compiler="clang", late=True)
    print(f"largest relative difference {apart(ours, theirs):.2g}")
    assert apart(ours, theirs) < 1e-9


@pytest.fixture(scope="module")
def toured(tmp_path_factory: pytest.TempPathFactory) -> tuple[st.CExport, Array]:
    """Programs of vehicle, autopilot and filter, and the flight of the core."""
    folder = tmp_path_factory.mktemp("tour")
    (folder / "tour.toml").write_text(MISSION)
    shutil.copy(HERE / "navigate.h", folder)
    made = ready(st.export_c("cwolf", "cwolf", mission=folder / "tour.toml", out=folder, navigation="filter"))
    flight = st.fly(
        "cwolf",
        "cwolf",
        folder / "tour.toml",
        water=st.Water(current=CURRENT),
        conditions=st.Conditions(max_time_s=60.0, navigation="filter", model="cwolf"),
    )
    return made, np.column_stack([flight.position, flight.euler, flight.nu[:, 0]])


SOURCES = ("cwolf_vehicle.c", "cwolf_autopilot.c", "cwolf_filter.c", "harness.c")


def test_a_mission_by_the_filter_in_c_is_the_products_own(toured: tuple[st.CExport, Array]) -> None:
    made, flight = toured
    program = compiled(made.folder, SOURCES, "gcc", "-O0", "-DWITH_FILTER", "-DPERIODS=300")
    ours = rows([program])
    assert len(ours) == 300
    assert len(flight) > 300
    assert np.ptp(flight[:300, 0]) > 15.0
    difference = np.abs(ours[:, :7] - flight[:300]) / np.maximum(np.abs(flight[:300]), 1.0)
    print(f"largest relative difference {difference.max():.2g}")
    assert difference.max() < 1e-9


@pytest.mark.long
def test_single_precision_and_clang_estimate_the_same(tmp_path: Path) -> None:
    for vehicle, voltage in (("cwolf", None), ("remus100", None), ("bluerov2-heavy", 16.0)):
        folder = tmp_path / vehicle
        folder.mkdir()
        ours, theirs, _ = compared(
            folder,
            everything(vehicle, late=0.3),
            vehicle,
            MARKS,
            periods=500,
            compiler="clang",
            options=("-O2", "-fsanitize=undefined", "-fsanitize-trap=undefined"),
            late=True,
            voltage_v=voltage,
        )
        print(f"{vehicle}: double {apart(ours, theirs):.2g}")
        assert apart(ours, theirs) < 1e-9
        # A gate on samples that contradict each other decides by the last digit; here all are taken.
        ours, theirs, _ = compared(
            folder,
            everything(vehicle, late=0.3, gate=1000.0),
            vehicle,
            MARKS,
            periods=500,
            options=("-O2", "-DSEATRIAL_FLOAT"),
            late=True,
            voltage_v=voltage,
        )
        error = np.abs(ours - theirs)[:, :12].max(axis=0)
        print(
            f"{vehicle}: single precision {error[:3].max():.2g} m, {error[3:6].max():.2g} rad,"
            f" {error[6:9].max():.2g} m/s"
        )
        assert np.isfinite(theirs).all()
        assert error[:3].max() < 2e-3


@pytest.mark.long
def test_nothing_undefined_happens_in_a_filter(toured: tuple[st.CExport, Array]) -> None:
    made, flight = toured
    options = (
        "-O1",
        "-fsanitize=undefined,address",
        "-fno-sanitize-recover=all",
        "-DWITH_FILTER",
        "-DPERIODS=300",
    )
    ours = rows([compiled(made.folder, SOURCES, "gcc", *options, name="ubsan")])
    assert np.abs(ours[:, :7] - flight[:300]).max() < 1e-6


@pytest.mark.long
def test_a_cortex_m7_flies_by_the_filter_in_qemu(toured: tuple[st.CExport, Array]) -> None:
    made, flight = toured
    ours = on_a_cortex_m7(made, "-DWITH_FILTER")
    assert len(ours) == 200
    # Another libm: its sine is not that of this machine to the last bit.
    assert np.abs(ours[:, :7] - flight[:200]).max() < 1e-6


def test_what_of_a_filter_is_not_exported_is_refused(tmp_path: Path) -> None:
    sea = SeaState(0.5, 4.0)
    with pytest.raises(SimulationError, match="told of waves is not exported"):
        st.export_c(
            "cwolf", out=tmp_path, navigation=st.NavigationFilter("cwolf", noise=st.ProcessNoise(waves=sea))
        )
    blind = st.NavigationFilter("cwolf", {"depth": Sensor(noise=0.01)})
    with pytest.raises(SimulationError, match="expected a sensor of the attitude"):
        st.export_c("cwolf", out=tmp_path, navigation=blind)
    with pytest.raises(SimulationError, match="those of a navigation filter"):
        st.export_c("cwolf", out=tmp_path, sensors="typical")
    with pytest.raises(SimulationError, match='expected "sensors", "filter"'):
        st.export_c("cwolf", out=tmp_path, navigation="eyes")
    assert not list(tmp_path.glob("*.c"))


@pytest.mark.long
def test_a_filter_of_every_vehicle_compiles_without_a_warning(tmp_path: Path) -> None:
    for vehicle in ("cwolf", "bluerov2-heavy", "remus100", "lauv", "beluga"):
        made = st.export_c(
            vehicle,
            out=tmp_path / vehicle,
            navigation=everything(vehicle, late=0.2),
            name="it",
            voltage_v=16.0,
        )
        for compiler in ("gcc", "clang"):
            needs(compiler)
            for options in ((), ("-DSEATRIAL_FLOAT",)):
                command = [compiler, *STRICT, "-O1", *options, "-c", "it_filter.c", "-o", "it.o"]
                subprocess.run(command, cwd=made.folder, check=True, timeout=300)
