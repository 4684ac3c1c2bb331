"""C of vehicle and autopilot: gcc and clang take it without a warning, and its missions are the core's."""

from __future__ import annotations

import json
import math
import re
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError
from seatrial.control_design import lqr_autopilot
from seatrial.export.c_code import identifier, recorded, refused_names
from seatrial.export.fmu import ran
from tests.flight.flying import grouped

HERE = Path(__file__).parent
STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror")
CURRENT = (0.1, -0.15, 0.0)
MISSION = """format = 1
name = "tour"
speed_m_s = 1.5
acceptance_radius_m = 5.0
[limits]
max_depth_m = 30.0
fence_m = [[-100.0, -100.0], [200.0, -100.0], [200.0, 200.0], [-100.0, 200.0]]
[[legs]]
north_m = 50.0
east_m = 0.0
depth_m = 6.0
[[legs]]
north_m = 50.0
east_m = 30.0
depth_m = 6.0
hold_s = 10.0
[[legs]]
north_m = 10.0
east_m = 40.0
depth_m = 4.0
"""


def needs(program: str) -> None:
    if shutil.which(program) is None:
        pytest.skip(f"{program} is not installed")


GROUPS = {"velocity": ("u", "v", "w"), "depth": ("z",)}


def loop(
    export: st.CExport, *, current: Sequence[float], bottom: float, silent: str, silent_from: int, dead: str
) -> str:
    """What the harness tells the programs of each other; sensors that fall silent, actuators that fail."""
    vehicle, autopilot = export.programs.vehicle, export.programs.autopilot
    assert autopilot is not None
    outputs = [one["name"] for one in vehicle.outputs]
    inputs = [one["name"] for one in autopilot.inputs]
    told = [name for name in outputs if name in inputs]
    lost = GROUPS.get(silent, ())
    period = autopilot.step_s

    def telling(name: str) -> str:
        if name not in lost:
            return f"    in->{name} = out->{name};"
        fresh = f"in->{name} = out->{name}; in->age_{name} = 0;"
        return f"    if (k < {silent_from}) {{ {fresh} }} else {{ in->age_{name} += {period!r}; }}"

    altitude = ["altitude"] if math.isfinite(bottom) else []
    known = [f"    in->age_{name} = 0;" for name in (*altitude, "u_water", "v_water", "w_water")]
    axes = zip(("north", "east", "down"), current, strict=True)
    water = [f"    to->current_{axis} = (VEHICLE(real)){x!r};" for axis, x in axes]
    depth = [f"    to->bottom = (VEHICLE(real)){bottom!r};"] if altitude else []
    commands = [
        f"    to->{one['name']} = {one['start']!r};"
        if one["known_as"] == f"cmd_{dead}"
        else f"    to->{one['name']} = from->{one['name']};"
        for one in vehicle.inputs
        if one["name"].startswith("cmd_")
    ]
    lines = [
        *(f'#include "{program.prefix}.h"' for program in (vehicle, autopilot)),
        f"#define VEHICLE(name) {vehicle.prefix}_##name",
        f"#define AUTOPILOT(name) {autopilot.prefix}_##name",
        f"#define SUBSTEPS {export.programs.substeps}",
        "static void launch(VEHICLE(input) *to, AUTOPILOT(input) *in)\n{",
        *water,
        *depth,
        *known,
        "}\nstatic void tell(int k, const VEHICLE(output) *out, AUTOPILOT(input) *in)\n{",
        "    (void)k;",
        *map(telling, told),
        "}\nstatic void obey(const AUTOPILOT(output) *from, VEHICLE(input) *to)\n{",
        *commands,
        "}",
    ]
    return "\n".join(lines) + "\n"


def ready(
    export: st.CExport,
    *,
    current: Sequence[float] = CURRENT,
    bottom: float = math.inf,
    silent: str = "",
    silent_from: int = 0,
    dead: str = "",
) -> st.CExport:
    shutil.copy(HERE / "harness.c", export.folder)
    text = loop(export, current=current, bottom=bottom, silent=silent, silent_from=silent_from, dead=dead)
    (export.folder / "loop.h").write_text(text)
    return export


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> st.CExport:
    folder = tmp_path_factory.mktemp("c")
    (folder / "tour.toml").write_text(MISSION)
    return ready(st.export_c("cwolf", "cwolf", mission=folder / "tour.toml", out=folder))


def sources(exported: st.CExport) -> list[str]:
    return [*(path.name for path in exported.files if path.suffix == ".c"), "harness.c"]


def built(exported: st.CExport, compiler: str, *options: str, name: str = "flight") -> Path:
    needs(compiler)
    program = exported.folder / name
    command = [compiler, *STRICT, *options, *sources(exported), "-o", str(program), "-lm"]
    ran(command, limit_s=300.0, folder=exported.folder)
    return program


def rows(command: Sequence[str | Path]) -> Array:
    # The sanitiser's search for lost memory asks for more rights than a container has; there is no heap here.
    said = ran(command, limit_s=300.0, environment={"ASAN_OPTIONS": "detect_leaks=0"})
    assert not said.stderr or "ERROR SUMMARY: 0 errors" in said.stderr, said.stderr
    return np.array([[float(x) for x in line.split()] for line in said.stdout.splitlines()])


def on_a_cortex_m7(exported: st.CExport, *options: str) -> Array:
    """What the harness prints on an emulated processor, 200 periods."""
    needs("arm-none-eabi-gcc")
    needs("qemu-system-arm")
    for name in ("cortex_m7.c", "cortex_m7.ld"):
        shutil.copy(HERE / name, exported.folder)
    cpu = ("-mcpu=cortex-m7", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv5-d16", "--specs=rdimon.specs")
    linked = ("-T", "cortex_m7.ld", "-nostartfiles", *options, "-DPERIODS=200", "-o", "m7.elf", "-lm")
    command = ["arm-none-eabi-gcc", *STRICT, "-O2", *cpu, *sources(exported), "cortex_m7.c", *linked]
    ran(command, limit_s=300.0, folder=exported.folder)
    machine = ("-M", "mps2-an500", "-nographic", "-monitor", "none", "-serial", "none")
    run = ("-semihosting-config", "enable=on,target=native", "-kernel", str(exported.folder / "m7.elf"))
    return rows(["qemu-system-arm", *machine, *run])


@pytest.fixture(scope="module")
def flown(exported: st.CExport) -> Array:
    flight = st.fly(
        "cwolf",
        "cwolf",
        exported.folder / "tour.toml",
        water=st.Water(current=CURRENT),
        conditions=st.Conditions(max_time_s=150.0),
    )
    return np.column_stack([flight.position, flight.euler, flight.nu[:, 0]])


def test_a_mission_in_c_is_the_products_own(exported: st.CExport, flown: Array) -> None:
    ours = rows([built(exported, "gcc", "-O0")])
    n = min(len(ours), len(flown))
    assert n > 700
    assert np.ptp(flown[:n, 2]) > 4.0
    apart = np.abs(ours[:n, :7] - flown[:n]) / np.maximum(np.abs(flown[:n]), 1.0)
    print(f"{n} periods, largest relative difference {apart.max():.2g}")
    # Each step rounds as the core does; that holds a whole mission in closed loop, not a step alone.
    assert apart.max() < 1e-12


@pytest.mark.long
def test_clang_and_single_precision_fly_the_mission(exported: st.CExport, flown: Array) -> None:
    double = rows([built(exported, "clang", "-O2", name="clang")])
    n = min(len(double), len(flown))
    assert np.abs(double[:n, :7] - flown[:n]).max() < 1e-9
    single = rows([built(exported, "gcc", "-O2", "-DSEATRIAL_FLOAT", name="single")])
    apart = np.abs(single[:n, :7] - flown[:n])
    print(f"single precision: position {apart[:, :3].max():.3g} m, angles {apart[:, 3:6].max():.3g} rad")
    # A start of a motor or the end of a leg may move by a period.
    assert np.isfinite(single).all()
    assert apart[:, :3].max() < 0.5


@pytest.mark.long
def test_nothing_undefined_happens_on_a_mission(exported: st.CExport) -> None:
    # clang traps, which needs no library of its own; gcc says what and where.
    checks = {
        "clang": ("-fsanitize=undefined", "-fsanitize-trap=undefined"),
        "gcc": ("-fsanitize=undefined,address", "-fno-sanitize-recover=all"),
    }
    for compiler, options in checks.items():
        assert len(rows([built(exported, compiler, "-O1", *options, name=f"ubsan-{compiler}")])) == 1000
    needs("valgrind")
    program = built(exported, "gcc", "-O1", "-DPERIODS=300", name="short")
    assert len(rows(["valgrind", "--error-exitcode=9", program])) == 300


@pytest.mark.long
def test_a_cortex_m7_flies_the_mission_in_qemu(exported: st.CExport, flown: Array) -> None:
    ours = on_a_cortex_m7(exported)
    assert len(ours) == 200
    # Another libm: its sine is not that of this machine to the last bit.
    assert np.abs(ours[:, :7] - flown[:200]).max() < 1e-6


@pytest.mark.long
def test_an_autopilot_fits_into_the_flash_of_a_small_processor(exported: st.CExport) -> None:
    needs("arm-none-eabi-gcc")
    cpu = ("-mcpu=cortex-m7", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv5-d16", "-DSEATRIAL_FLOAT")
    command = ["arm-none-eabi-gcc", "-std=c99", "-Os", *cpu, "-c", "cwolf_autopilot.c", "-o", "size.o"]
    ran(command, limit_s=300.0, folder=exported.folder)
    flash = int(
        ran(["arm-none-eabi-size", "size.o"], folder=exported.folder).stdout.splitlines()[1].split()[0]
    )
    print(f"autopilot of cwolf, single precision: {flash} bytes")
    # gcc 12.2 takes 71,000, half of it to screen samples, compare sensors and judge actuators; another may
    # take a tenth more.
    assert flash < 78_000


@pytest.mark.long
def test_the_example_of_the_guide_compiles(exported: st.CExport) -> None:
    needs("gcc")
    guide = HERE.parents[1] / "docs" / "how-to" / "export_c.md"
    block = re.search(r"```c\n(.*?)```", guide.read_text(), re.DOTALL)
    assert block is not None
    (exported.folder / "guide.c").write_text(block[1])
    ran(["gcc", *STRICT, "-DSEATRIAL_FLOAT", "-c", "guide.c", "-o", "guide.o"], folder=exported.folder)


@pytest.mark.long
@pytest.mark.parametrize(("program", "known"), [("vehicle", set()), ("autopilot", {"8.9", "10.8"})])
def test_cppcheck_and_its_addon_for_misra_find_what_the_guide_says(
    exported: st.CExport, program: str, known: set[str]
) -> None:
    needs("cppcheck")
    options = ("-q", "--std=c99", "--enable=warning,style,portability", "--addon=misra", "--template={id}")
    command = ["cppcheck", *options, "--max-ctu-depth=0", "-USEATRIAL_FLOAT", f"cwolf_{program}.c"]
    said = ran(command, limit_s=1200.0, folder=exported.folder)
    found = set((said.stdout + said.stderr).split())
    assert found == {f"misra-c2012-{rule}" for rule in known}


SHALLOW = MISSION.replace("max_depth_m = 30.0", "min_altitude_m = 3.0")
LOW = """format = 1
name = "low"
speed_m_s = 1.2
acceptance_radius_m = 5.0
[[legs]]
north_m = 50.0
east_m = 0.0
altitude_m = 12.0
[[legs]]
north_m = 50.0
east_m = 40.0
altitude_m = 8.0
"""
DEPTHS = """format = 1
name = "depths"
speed_m_s = 1.5
acceptance_radius_m = 8.0
[[legs]]
north_m = 120.0
east_m = 0.0
depth_m = 4.0
[[legs]]
north_m = 120.0
east_m = 80.0
depth_m = 8.0
"""


def regulator(text: str) -> str:
    return lqr_autopilot(st.Vehicle.load("cwolf"), text)


def same(text: str) -> str:
    return text


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "change", "mission", "flight", "loops"),
    [
        ("cwolf", regulator, MISSION, {}, {}),
        ("cwolf", same, LOW, {"seabed": 20.0}, {"bottom": 20.0}),
        ("cwolf", same, SHALLOW, {"seabed": 8.0}, {"bottom": 8.0}),
        (
            "cwolf",
            same,
            MISSION,
            {"outages": [st.Outage("velocity", from_s=20.0)]},
            {"silent": "velocity", "silent_from": 200},
        ),
        ("cwolf", same, MISSION, {"faults": [st.Fault("SbU", at_s=0.0)]}, {"dead": "SbU"}),
        ("remus100", same, DEPTHS, {}, {}),
        ("bluerov2-heavy", same, DEPTHS.replace("1.5", "0.5"), {"voltage_v": 16.0}, {}),
    ],
    ids=["lqr", "altitude", "limit", "stale", "failed", "remus100", "bluerov2-heavy"],
)
def test_what_an_autopilot_can_do_it_does_in_c(
    name: str,
    change: Callable[[str], str],
    mission: str,
    flight: dict[str, Any],
    loops: dict[str, Any],
    tmp_path: Path,
) -> None:
    autopilot = st.Autopilot.from_toml(change(st.Autopilot.load(name).to_toml()))
    (tmp_path / "plan.toml").write_text(mission)
    plan = st.Mission.load(tmp_path / "plan.toml")
    flown = st.fly(name, autopilot, plan, **grouped(current=CURRENT, max_time_s=90.0, **flight))
    voltage = flight.get("voltage_v")
    export = ready(st.export_c(name, autopilot, mission=plan, out=tmp_path, voltage_v=voltage), **loops)
    ours = rows([built(export, "gcc", "-O0")])
    theirs = np.column_stack([flown.position, flown.euler, flown.nu[:, 0]])
    n = min(len(ours), len(theirs))
    apart = np.abs(ours[:n, :7] - theirs[:n]) / np.maximum(np.abs(theirs[:n]), 1.0)
    print(f"{name}: {n} periods, largest relative difference {apart.max():.2g}, alert {ours[:n, 7].max():g}")
    assert n > 300
    assert np.ptp(theirs[:n, :3], axis=0).max() > 5.0
    assert apart.max() < (1e-12 if name == "cwolf" else 1e-9)
    # A limit and a silent sensor are answered.
    assert (ours[:n, 7].max() > 0.0) == (mission == SHALLOW or "outages" in flight)


def test_what_cannot_be_exported_is_refused_with_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(SimulationError, match="found no mission"):
        st.export_c("cwolf", "cwolf", out=tmp_path)
    with pytest.raises(SimulationError, match="found no autopilot"):
        st.export_c("cwolf", mission="dive.toml", out=tmp_path)
    with pytest.raises(SimulationError, match="depends on the supply voltage"):
        st.export_c("bluerov2-heavy", out=tmp_path)
    with pytest.raises(SimulationError, match="a letter first"):
        identifier("2fast", given=True)
    (tmp_path / "dive.toml").write_text(MISSION)
    text = st.Autopilot.load("cwolf").to_toml().replace('method = "pseudo-inverse"', 'method = "quadratic"')
    with pytest.raises(st.VehicleError, match="pseudo-inverse"):
        st.export_c("cwolf", st.Autopilot.from_toml(text), mission=tmp_path / "dive.toml", out=tmp_path)
    assert not list(tmp_path.glob("*.c"))


def _renamed(*names: str) -> st.Vehicle:
    """The built-in vehicle whose first actuators have other names, and which has a hostile name itself."""
    vehicle = st.Vehicle.load("cwolf")
    text = vehicle.to_toml().replace(f"name = {json.dumps(vehicle.name)}", 'name = "*/ int x; /*"', 1)
    for old, new in zip(vehicle.actuators, names, strict=False):
        text = text.replace(json.dumps(old), json.dumps(new, ensure_ascii=False))
    return st.Vehicle.from_toml(text)


def test_names_that_c_can_hold_give_files_that_compile(tmp_path: Path) -> None:
    needs("gcc")
    program = recorded(_renamed("é", "a-b", "two words", "2", "none", "u", "A" * 300), name="odd").vehicle
    (tmp_path / "odd_vehicle.h").write_text(program.header)
    (tmp_path / "odd_vehicle.c").write_text(program.source)
    done = ran(["gcc", *STRICT, "-fsyntax-only", "odd_vehicle.c"], folder=tmp_path)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("a-b", "a_b"), '"a-b.*" and "a_b.*" are both a_b'),
        (("é", "ü"), "are both n_"),
        (("/*",), "no comment of C may hold"),
        (("a*/b",), "no comment of C may hold"),
        (("a\u202eb",), "no comment of C may hold"),
    ],
)
def test_names_that_collide_or_are_none_in_c_are_refused_by_name(names: tuple[str, ...], words: str) -> None:
    with pytest.raises(SimulationError, match=words):
        recorded(_renamed(*names), name="odd")
    assert refused_names([{"name": "int", "known_as": "int", "about": ""}]) == 'the name "int" is a word of C'


def test_files_name_numbers_with_their_units(exported: st.CExport) -> None:
    header = (exported.folder / "cwolf_vehicle.h").read_text()
    assert re.search(r"cwolf_vehicle_real m; /\* kg: ", header)
    source = "".join(path.read_text() for path in exported.files if path.suffix == ".c")
    # Neither heap nor globals nor other headers: all that is static is constant or a function.
    assert set(re.findall(r"#include <(.*)>", source)) == {"math.h"}
    assert all("const" in line or "(" in line for line in source.splitlines() if line.startswith("static"))
    assert "malloc" not in source
