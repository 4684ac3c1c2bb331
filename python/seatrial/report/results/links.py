"""The words of what goes elsewhere: exported code and units, models of simulators, flights by the clock.

Held by ``tests/export/test_c.py``, ``tests/export/test_fmu.py``, ``tests/simulators/test_convert.py``,
``tests/realtime/test_realtime_flight.py``, ``tests/realtime/test_hardware.py`` and
``tests/realtime/test_sitl.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import singledispatch

import numpy as np

from seatrial.base.report import Report, Section, Table
from seatrial.export.c_code import CExport
from seatrial.export.fmu import FmuExport, platform
from seatrial.realtime.ardupilot_link import SitlSession
from seatrial.realtime.flight import RealtimeFlight, Timing
from seatrial.realtime.hardware import HardwareFacts
from seatrial.simulators.convert import ExportedModel, ImportedModel


@singledispatch
def report(result: object) -> Report:
    """Report of an export, of an exchange with a simulator, or of a flight in real time."""
    raise TypeError(f"expected an export or a flight in real time, found {type(result).__name__}")


_CALLS = {"motors": "_predict: motors", "model": "_predict: model"}


@report.register
def _of_c(made: CExport) -> Report:
    """The files, their operations and their numbers."""
    programs = made.programs.all()
    kinds = ("simple", "quotients", "functions", "decisions", "tables", "all")
    rows = [
        (f"{program.prefix}{_CALLS.get(function, f'_{function}')}", *(str(counts[kind]) for kind in kinds))
        for program in programs
        for function, counts in program.operations.items()
    ]
    head = ["function", "+ - *", "/ sqrt", "sin exp …", "compare, select", "tables", "all"]
    parts = ("parameters", "state", "inputs", "outputs")
    sizes = [(program.prefix, *(str(len(getattr(program, part))) for part in parts)) for program in programs]
    last = made.programs.autopilot or made.programs.vehicle
    steps = last.operations["step"]["all"]
    return Report(
        title=str(made.folder),
        outcome="exported as C99",
        good=f"{len(made.files)} files that need math.h alone; {steps} operations in a step of {last.prefix}",
        worst=_left_out(made),
        next_step=f"compile with gcc -std=c99 -O2 -c {made.files[-1].name}; -DSEATRIAL_FLOAT for float",
        sections=(
            Section(
                tables=(
                    Table.of("Operations of a call", head, rows),
                    Table.of("Numbers of the interface", ("program", *parts), sizes),
                )
            ),
        ),
    )


def _left_out(made: CExport) -> str:
    """What is fixed in the files."""
    fixed = "dead times, limits, tables and zero coefficients"
    if made.programs.autopilot is not None:
        fixed += ", the mission and the autopilot's model of the vehicle"
    if made.programs.filter is not None:
        fixed += ", the filter's period and kinds of sensors"
    return f"{fixed} are part of the program; to change them, export again"


@report.register
def _of_units(made: FmuExport) -> Report:
    """The units, what they hold and what runs them."""
    none = "sources only: no C compiler is there" if made.binary else "sources only, as asked for"
    binary = f"binary for {platform()} by {made.compiler}" if made.compiler else none
    rows = [
        (
            program.prefix,
            f"{program.step_s:g}",
            *(str(len(part)) for part in (program.parameters, program.inputs, program.outputs)),
        )
        for program in made.programs.all()
    ]
    head = ["unit", "step, s", "parameters", "inputs", "outputs"]
    sets = f", {made.samples} parameter sets of the covariance" if made.samples else ""
    return Report(
        title=", ".join(path.name for path in made.files),
        outcome="exported",
        good=f"{len(made.files)} units of FMI 2.0 and 3.0 with sources, {binary}{sets}",
        worst="a communication step is a whole number of steps of the unit; others are refused",
        next_step=f"check with fmpy validate {made.files[0]}; step the autopilot first, then the vehicle",
        sections=(Section(tables=(Table.of("Units", head, rows),)),),
    )


@report.register
def _of_import(read: ImportedModel) -> Report:
    """Report on the import."""
    values = read.vehicle.coefficients()
    count = sum(1 for name, value in values.items() if value)
    doubts = len(read.contradictions)
    worst = read.contradictions[0] if doubts else "no contradiction was found in signs, symmetry and buoyancy"
    rows = [[name, f"{value:.6g}"] for name, value in sorted(values.items()) if value]
    return Report(
        title=read.source,
        outcome="read as a model of gz-sim",
        good=f"{count} coefficients, forward-right-down about the link's origin; {doubts} contradictions",
        worst=worst,
        next_step="add thrusters to the vehicle file, then seatrial check",
        sections=(
            Section("Contradictions", read.contradictions),
            Section("Not taken", read.left),
            Section("Coefficients", (), (Table.of("", ["name", "value"], rows),)),
        ),
    )


@report.register
def _of_model(made: ExportedModel, out: str = "") -> Report:
    """Report on the export."""
    return Report(
        title=made.vehicle.name,
        outcome="written for gz-sim",
        good=f"mass, inertia, buoyancy, added mass and damping in {out or 'the model'}, frames turned"
        " where gz-sim has others",
        worst=made.lost[0] if made.lost else "nothing is lost",
        next_step="add thrusters and sensors in the words of gz-sim",
        sections=(Section("Lost", made.lost),),
    )


@report.register
def _of_flight(flight: RealtimeFlight) -> Report:
    """Report on the flight and on how it kept time."""
    flown = len(flight.rows) * flight.timing.period_s * flight.speed
    late = flight.timing.quantile(0.99)
    worst = f"99 % of the ticks were at most {1e3 * late:.3f} ms late"
    if flight.timing.overruns:
        worst = f"{flight.timing.overruns} of {len(flight.timing.lateness)} ticks overran; {worst}"
    if flight.hardware is not None:
        worst = f"{link_sentence(flight.hardware)}; {worst}"
    if flight.cause:
        worst = f"{flight.reaction} because of {flight.cause}; {worst}"
    if flight.doubt:
        worst = f"{flight.doubt}; {worst}"
    if flight.went_too_deep:
        deep = (
            f"it went {flight.deepest_m:.2f} m deep; the mission's largest depth is {flight.max_depth_m:g} m"
        )
        worst = f"{deep}; {worst}"
    tables: tuple[Table, ...] = (_ticks(flight.timing),)
    if flight.hardware is not None:
        tables += (_passed_over(flight.hardware.ignored),)
    return Report(
        title=flight.vehicle.name,
        outcome=f"{flight.outcome}, beyond the mission's largest depth"
        if flight.went_too_deep
        else flight.outcome,
        good=f"{flown:.1f} s of motion at {flight.speed:g} times real time; {kept_time(flight.timing)}",
        worst=worst,
        next_step="open the recording in Foxglove, or score the log as a trial",
        sections=(Section("", flight.notes, tables),),
    )


def kept_time(timing: Timing) -> str:
    """Ticks, jitter and overruns in a sentence."""
    return (
        f"{len(timing.lateness)} ticks of {1e3 * timing.period_s:g} ms: half began at most"
        f" {1e3 * timing.quantile(0.5):.3f} ms late, 99 % at most {1e3 * timing.quantile(0.99):.3f} ms,"
        f" the latest {1e3 * timing.quantile(1.0):.2f} ms; {timing.overruns} overruns"
    )


def _ticks(timing: Timing) -> Table:
    """Lateness and work at some quantiles."""
    shares = (0.5, 0.9, 0.99, 1.0)
    rows = [
        [
            f"{100 * share:g} %",
            f"{1e3 * timing.quantile(share):.3f}",
            f"{1e3 * timing.work_quantile(share):.3f}",
        ]
        for share in shares
    ]
    return Table.of("Ticks", ["of the ticks at most", "late, ms", "work, ms"], rows)


def link_sentence(link: HardwareFacts) -> str:
    """What went over the link, in a sentence."""
    lost = "".join(f"; {count} were not sent: {why}" for why, count in sorted(link.unsent.items()))
    if not link.taken:
        strangers = link.ignored.get("stranger", 0)
        others = f"; {strangers} came from another address than the hardware's" if strangers else ""
        return (
            f"{link.sent} packets were sent, no good one came back: the actuators rested at"
            f" neutral{lost}{others}"
        )
    trips = np.array(link.round_trip_s) if link.round_trip_s else np.zeros(1)
    return (
        f"{link.sent} packets sent, {link.taken} taken, {link.lost} lost; round trip"
        f" {1e3 * float(np.median(trips)):.2f} ms in the middle, {1e3 * float(trips.max()):.2f} ms at"
        f" most; the watchdog expired {link.expired} times{lost}"
    )


def _passed_over(ignored: Mapping[str, int]) -> Table:
    """Packets that were passed over, by why."""
    rows = [[why, str(count)] for why, count in sorted(ignored.items())]
    return Table.of("Packets passed over", ["why", "packets"], rows)


@report.register
def _of_link(session: SitlSession) -> Report:
    """Report on the link."""
    if not session.frames:
        good = f"no packet of ArduPilot came in {session.wall_s:.1f} s"
    else:
        good = (
            f"{session.frames} frames, {session.simulated_s:.1f} s of motion in {session.wall_s:.1f} s;"
            f" {session.steps_per_s:.0f} steps per second of work, ArduPilot asked for {session.rate_hz}"
        )
    passed = ", ".join(f"{count} {word}" for word, count in sorted(session.ignored.items()))
    worst = f"packets passed over: {passed}" if passed else "no packet was passed over"
    if not session.frames and not passed:
        worst = "nothing spoke to this port"
    if session.lost:
        worst = f"{session.lost} frames were lost on the way; {worst}"
    if session.frames and session.steps_per_s < session.rate_hz:
        worst = (
            f"slower than real time: {session.steps_per_s:.0f} steps per second of work for {session.rate_hz}"
            f" Hz; lower SIM_RATE_HZ; {worst}"
        )
    following = "use the log as a trial, or fly on"
    if session.ended == "diverged":
        following = "the motion grew beyond all bounds: check the signs of the channels"
    elif not session.frames:
        following = "start ArduPilot with --model JSON:127.0.0.1"
    return Report(
        title=f"sitl {session.mapping.vehicle.name}",
        outcome={"idle": "ended in silence", "frames": "done"}.get(session.ended, session.ended),
        good=good,
        worst=worst,
        next_step=following,
        sections=(
            Section("Channels", tuple(session.notes), (session.mapping.table(),)),
            Section("", (), (_passed_over(session.ignored),)),
        ),
    )
