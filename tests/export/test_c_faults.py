"""The exported autopilot under broken sensors: told the same samples, it does what the helm does."""

from __future__ import annotations

import math
import struct
import subprocess
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import seatrial as st
from seatrial._core import autopilot_names
from seatrial.base.arrays import Array
from seatrial.export.fmu import ran
from tests.export.test_c import STRICT, needs
from tests.flight.actuator_faults import failure
from tests.flight.sensor_faults import CHANNELS, FAULT_AT_S, KINDS, MISSION, Fault, Flown, Told, fault, fly

HARNESS = """
#include "{prefix}.h"
#include <stdio.h>
int main(void)
{{
    static {prefix}_parameters p;
    static {prefix}_constants k;
    static {prefix}_state s;
    static {prefix}_input in;
    static {prefix}_output out;
    double told[{inputs}], done[{outputs}];
    {prefix}_defaults(&p);
    {prefix}_prepare(&p, &k);
    {prefix}_begin(&s, &in);
    while (fread(told, sizeof told, 1, stdin) == 1)
    {{
{tell}
        {prefix}_step(&p, &k, &s, &in, &out);
{do}
        fwrite(done, sizeof done, 1, stdout);
    }}
    return 0;
}}
"""

SINGLE = 1e-4
"""Rounding of single precision, 6e-8, as the loops' derivative of noise and the root from thrust to
revolutions enlarge it."""

SOME = (("lost", "z"), ("1e6", "u"), ("infinite", "yaw"), ("frozen with noise", "z"), ("sign", "pitch"))


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> st.CExport:
    folder = tmp_path_factory.mktemp("faults")
    (folder / "zigzag.toml").write_text(MISSION.format(speed=1.5))
    return st.export_c("cwolf", "cwolf", mission=folder / "zigzag.toml", out=folder)


@pytest.fixture(scope="module")
def program(exported: st.CExport) -> Path:
    """The harness in double precision."""
    return built(exported, "double")


def built(exported: st.CExport, name: str, *options: str) -> Path:
    needs("gcc")
    autopilot = exported.programs.autopilot
    assert autopilot is not None
    ins, outs = ([one["name"] for one in side] for side in (autopilot.inputs, autopilot.outputs))
    real = f"{autopilot.prefix}_real"
    text = HARNESS.format(
        prefix=autopilot.prefix,
        inputs=len(ins),
        outputs=len(outs),
        tell="\n".join(f"        in.{name} = ({real})told[{i}];" for i, name in enumerate(ins)),
        do="\n".join(f"        done[{i}] = (double)out.{name};" for i, name in enumerate(outs)),
    )
    (exported.folder / f"{name}.c").write_text(text)
    sources = [f"{autopilot.prefix}.c", f"{name}.c"]
    command = ["gcc", *STRICT, "-O1", *options, *sources, "-o", name, "-lm"]
    ran(command, limit_s=600.0, folder=exported.folder)
    return exported.folder / name


def stepped(program: Path, exported: st.CExport, told: list[Told]) -> dict[str, Array]:
    """The outputs of the exported autopilot for these samples, each told with age 0."""
    autopilot = exported.programs.autopilot
    assert autopilot is not None
    rows = []
    for sample in told:
        known = {**dict.fromkeys(CHANNELS, math.nan), "reset": 0.0, **sample}
        for one in autopilot.inputs:
            name = one["known_as"]
            if name in known:
                rows.append(known[name])
            elif name.removeprefix("age_") in known:
                rows.append(0.0)
            else:
                # Not measured in the flight: water, bottom, what the actuators do.
                rows.append(1.0 if name == "battery" else math.nan)
    bytes_in = struct.pack(f"={len(rows)}d", *rows)
    shown = subprocess.run([program], input=bytes_in, capture_output=True, check=True, timeout=600.0).stdout
    table = np.frombuffer(shown).reshape(len(told), len(autopilot.outputs))
    return {one["known_as"]: table[:, i] for i, one in enumerate(autopilot.outputs)}


def apart(shown: dict[str, Array], flown: Flown) -> float:
    """Largest difference of a command, relative to the largest one of its actuator."""
    worst = 0.0
    for name in flown.commands[0]:
        ours = np.array([commands[name] for commands in flown.commands])
        difference = np.abs(shown[f"cmd_{name}"] - ours) / max(float(np.abs(ours).max()), 1.0)
        worst = max(worst, float(difference.max()))
    return worst


def told_of(shown: dict[str, Array]) -> tuple[list[str], list[str]]:
    names = autopilot_names()
    causes = ["", *names["watches"]]
    reactions = [names["reactions"][int(level)] for level in shown["alert"]]
    return reactions, [causes[int(cause)] for cause in shown["cause"]]


def test_the_exported_autopilot_screens_its_samples_as_the_helm_does(
    program: Path, exported: st.CExport
) -> None:
    for kind, channel in SOME:
        flown = fly("cwolf", fault(kind, channel), seconds=FAULT_AT_S + 40.0)
        shown = stepped(program, exported, flown.told)
        assert all(np.isfinite(shown[name]).all() for name in shown if name.startswith("cmd_"))
        assert apart(shown, flown) == 0.0, f"{kind} {channel}"
        assert told_of(shown) == (flown.reaction, flown.cause), f"{kind} {channel}"


def test_the_exported_autopilot_names_the_failed_actuator_as_the_helm_does(
    program: Path, exported: st.CExport
) -> None:
    """By the motion alone, and the others are allocated without it from the same period on."""
    flown = fly("cwolf", seconds=FAULT_AT_S + 20.0, failure=failure("cwolf", "ahead", "SbU"))
    shown = stepped(program, exported, flown.told)
    names = ["", *st.Vehicle.load("cwolf").actuators, "all"]
    assert [names[int(number)] for number in shown["suspect"]] == flown.suspect
    assert "SbU" in flown.suspect
    assert told_of(shown) == (flown.reaction, flown.cause)
    assert shown["given_up"][-1] == 2.0 ** names.index("SbU") / 2.0
    assert apart(shown, flown) == 0.0


def test_the_functions_that_the_program_brings_are_the_cores(exported: st.CExport) -> None:
    """Only those that it calls, and in single precision the platform's."""
    needs("gcc")
    for path in exported.files:
        if path.suffix != ".c":
            continue
        source = path.read_text()
        for macro, function in (("SIN", "turned"), ("ATAN2", "angle"), ("EXP", "exponential")):
            called = f" {macro}(" in source.split("typedef", 1)[1].replace(f"#define {macro}(", "")
            assert called == (f"double core_{function}(" in source), (path.name, macro)
        symbols = ran(["gcc", "-std=c99", "-O1", "-DSEATRIAL_FLOAT", "-E", path.name], folder=exported.folder)
        assert "core_" not in symbols.stdout


def events(reaction: list[str], cause: list[str]) -> list[tuple[int, tuple[str, str]]]:
    """What was thought, and the period from which on it was."""
    thought = list(zip(reaction, cause, strict=True))
    return [(k, now) for k, now in enumerate(thought) if k == 0 or now != thought[k - 1]]


@pytest.mark.long
def test_scalar_the_exported_autopilot_agrees_with_the_helm_on_every_fault(
    program: Path, exported: st.CExport
) -> None:
    single = built(exported, "single", "-DSEATRIAL_FLOAT")
    beyond = []
    for kind, channel in product(KINDS, CHANNELS):
        flown = fly("cwolf", fault(kind, channel), seconds=80.0)
        shown = stepped(program, exported, flown.told)
        assert apart(shown, flown) == 0.0, f"{kind} {channel}"
        assert told_of(shown) == (flown.reaction, flown.cause), f"{kind} {channel}"
        shown = stepped(single, exported, flown.told)
        ours, its = events(flown.reaction, flown.cause), events(*told_of(shown))
        # What is only told may pass its threshold in one precision alone; what is done is the same.
        acted, its_acts = (
            [(k, now) for k, now in thought if now[0] != "continue"] for thought in (ours, its)
        )
        assert [now for _, now in its_acts] == [now for _, now in acted], f"{kind} {channel}"
        late = max((abs(a - b) for (a, _), (b, _) in zip(its_acts, acted, strict=True)), default=0)
        assert late <= 2, f"{kind} {channel}: {late} periods"
        if apart(shown, flown) > SINGLE or [now for _, now in its] != [now for _, now in ours]:
            beyond.append(f"{kind} {channel}")
    # A threshold that is passed, or a motor that starts, a period earlier or later.
    print(f"single precision beyond {SINGLE:g} for a time: {', '.join(beyond)}")
    assert len(beyond) <= 0.07 * len(KINDS) * len(CHANNELS)


@pytest.mark.parametrize("value", [math.inf, 1e6])
def test_a_sample_that_cannot_be_true_leaves_no_trace_in_the_exported_state(
    program: Path, exported: st.CExport, value: float
) -> None:
    """Eight samples of each channel; two seconds later the commands are those of the same samples lost."""
    usual = fly("cwolf", seconds=45.0)
    for channel in CHANNELS:

        def wild(told: Told, k: int, shown: float, channel: str = channel) -> Told:
            return told | {channel: shown} if 300 <= k < 308 else told

        garbled = stepped(program, exported, [wild(t, k, value) for k, t in enumerate(usual.told)])
        lost = stepped(program, exported, [wild(t, k, math.nan) for k, t in enumerate(usual.told)])
        for name, shown in garbled.items():
            assert np.isfinite(shown).all(), (channel, name)
            np.testing.assert_array_equal(shown, lost[name], err_msg=f"{channel} {name}")


def test_a_channel_that_stays_lost_is_told_by_the_exported_autopilot(
    program: Path, exported: st.CExport
) -> None:
    flown = fly("cwolf", seconds=17.0)
    for channel in CHANNELS:
        lost: Fault = fault("lost", channel)
        rng = np.random.default_rng(1)
        told = [t if k < 50 else lost(t, 0.1 * k, rng) for k, t in enumerate(flown.told)]
        _, causes = told_of(stepped(program, exported, told))
        assert causes[40] == "", channel
        assert causes[-1].startswith("unread" if channel == "p" else "stale_"), channel


def test_the_exported_autopilot_takes_the_operators_reset_as_the_helm_does(
    program: Path, exported: st.CExport
) -> None:
    """A lost depth aborts; the reset comes after the sensor is back, and the mission goes on."""
    lost = fault("lost", "z")
    at = FAULT_AT_S + 15.0
    flown = fly(
        "cwolf",
        lambda told, since, rng: lost(told, since, rng) if since < 8.0 else told,
        seconds=at + 20.0,
        resets_at_s=(at,),
    )
    assert flown.reaction[round(at / 0.1) - 1] == "abort"
    assert flown.reaction[-1] == "continue"
    told = [t | {"reset": float(k == round(at / 0.1))} for k, t in enumerate(flown.told)]
    shown = stepped(program, exported, told)
    assert told_of(shown) == (flown.reaction, flown.cause)
    assert apart(shown, flown) == 0.0
