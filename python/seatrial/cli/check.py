"""`seatrial check`: what a vehicle, autopilot or mission file says, in sentences; what a campaign will do.

`seatrial check` of a mission or an autopilot file: tables and sentences.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seatrial.base.errors import SeatrialError, nearest
from seatrial.vehicle.actuators import NOMINAL_V

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console
    from rich.table import Table

    from seatrial._core import Vehicle
    from seatrial.check.autopilot import AutopilotCheck
    from seatrial.check.campaign import CampaignCheck
    from seatrial.check.legs import LegRow
    from seatrial.check.mission import MissionCheck
    from seatrial.check.vehicle import VehicleCheck
    from seatrial.estimation.inputs import InputJudgement
    from seatrial.vehicle.steady_state import Speed

__all__ = ["TURN_HEADS", "check", "check_autopilot_file", "check_mission_file", "print_modes_and_gains"]

_ADVICE = {
    "a bench file": "evaluate it with seatrial bench {}",
    "the recipe of a generated trial": "check the campaign that names it",
    "the truth of generated trials": "check the vehicle that it names",
    "an empty file": "seatrial new writes one to begin with",
    "a set of sensors": "fly with it: seatrial fly --sensors {}",
}
"""What to do with files that are taken for a vehicle by mistake."""

_OPTIONS: dict[str, tuple[str, ...]] = {
    "a vehicle": ("--speed-kn", "--out"),
    "a campaign": (),
    "a mission": ("--vehicle", "--autopilot", "--out"),
    "an autopilot": ("--vehicle",),
}
"""Options that only some files have."""

TURN_HEADS = {
    "under way": "inner side at half",
    "inner side stopped": "stopped",
    "inner side half astern": "half astern",
    "on the spot": "opposed",
}


def check(
    target: Annotated[
        str,
        typer.Argument(
            help="Vehicle file, built-in vehicle, campaign, mission or autopilot file.",
            metavar="VEHICLE|CAMPAIGN|MISSION|AUTOPILOT",
        ),
    ],
    vehicle: Annotated[
        str | None,
        typer.Option(help="Vehicle that a mission or an autopilot is for: file or name.", metavar="VEHICLE"),
    ] = None,
    autopilot: Annotated[
        str | None, typer.Option(help="Autopilot that flies a mission: file or name.", metavar="AUTOPILOT")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for figures; runs/check-NAME by default.")
    ] = None,
    voltage: Annotated[
        float, typer.Option(min=0.1, help="Supply voltage at which tables of thrust are read, V.")
    ] = NOMINAL_V,
    speed_kn: Annotated[
        list[float] | None,
        typer.Option(
            min=0.01,
            metavar="KN",
            help="Speed at which revolutions, power, endurance and range are told, kn; repeatable; round ones"
            " up to the top speed when missing.",
        ),
    ] = None,
    figures: Annotated[
        bool,
        typer.Option(help="Draw three views, characteristics and performance, or the mission (PNG and PDF)."),
    ] = True,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Check a vehicle (signs, speeds, turns, stability), an autopilot, a mission or a campaign beforehand."""
    _check_options(voltage, speed_kn or [])
    kind = _kind(target)
    given = {"--vehicle": vehicle, "--autopilot": autopilot, "--speed-kn": speed_kn or None, "--out": out}
    for option, value in given.items():
        if value is not None and option not in _OPTIONS[kind]:
            fitting = " or ".join(name for name, options in _OPTIONS.items() if option in options)
            raise SeatrialError(f"{option} is for {fitting}, and {target} is {kind}; leave it out")
    if kind == "a campaign":
        _check_campaign(target, json=json)
    elif kind == "a mission":
        check_mission_file(target, vehicle, autopilot, voltage_v=voltage, out=out, figures=figures, json=json)
    elif kind == "an autopilot":
        check_autopilot_file(target, vehicle, voltage_v=voltage, json=json)
    else:
        _check_vehicle(target, voltage, speed_kn, out=out, figures=figures, json=json)


def _check_vehicle(
    target: str, voltage: float, speed_kn: list[float] | None, *, out: Path | None, figures: bool, json: bool
) -> None:
    from seatrial._core import Vehicle
    from seatrial.check.vehicle import check_vehicle
    from seatrial.cli.console import list_figures, output, print_json

    vehicle = Vehicle.load(target)
    found = check_vehicle(vehicle, voltage_v=voltage, speeds_kn=speed_kn or None)
    written: list[Path] = []
    if figures:
        from seatrial.report.plot.performance import characteristic, performance
        from seatrial.report.plot.style import save
        from seatrial.report.plot.vehicle import three_views

        folder = out or Path("runs") / f"check-{vehicle.name}"
        written += save(three_views(vehicle), folder / "three_views")
        if vehicle.actuators:
            written += save(characteristic(vehicle), folder / "characteristic")
        if (sailing := performance(vehicle, voltage_v=voltage)) is not None:
            written += save(sailing, folder / "performance")
    if json:
        print_json(found.to_dict() | {"figures": [str(path) for path in written]})
        return
    console = output()
    _print_vehicle(console, found)
    list_figures(console, written)


def _check_options(voltage: float, speed_kn: list[float]) -> None:
    """Refuse numbers that are no voltage or speed."""
    for option, values in (("--voltage", [voltage]), ("--speed-kn", speed_kn)):
        for value in values:
            if not math.isfinite(value):
                raise SeatrialError(f"{option}: expected a finite number, found {value}")


def _kind(target: str) -> str:
    """What the file is; a vehicle where nothing tells."""
    from seatrial._core import Vehicle
    from seatrial.base.toml_file import VEHICLE, file_kind

    kind = file_kind(target)
    if kind is not None and kind in _ADVICE:
        raise SeatrialError(
            f"{target}: expected a vehicle, campaign, mission or autopilot file, found {kind};"
            f" {_ADVICE[kind].format(target)}"
        )
    if kind is None and target not in Vehicle.names() and not Path(target).is_file():
        near = nearest(target, Vehicle.names())
        why = "a folder" if Path(target).is_dir() else "no such file"
        raise SeatrialError(
            f"{target or 'an empty name'}: expected a vehicle, campaign, mission or autopilot file or one of"
            f" the built-in vehicles {', '.join(Vehicle.names())}, found {why}"
            f"{near if near.endswith('?') else '; check the path'}"
        )
    return kind or VEHICLE


def _is_campaign(target: str) -> bool:
    """Whether the file is a campaign."""
    from seatrial.base.toml_file import CAMPAIGN, file_kind

    return file_kind(target) == CAMPAIGN


def _print_vehicle(console: Console, found: VehicleCheck) -> None:
    from seatrial.cli.console import table

    console.print(f"[bold]{found.name}[/bold]: {found.description}\n", soft_wrap=True)
    for first, *others in found.by_actuator():
        console.print(str(first), soft_wrap=True, markup=False)
        for push in others:
            console.print(f"{push.size}: {push.words}", soft_wrap=True, markup=False, style="dim")
    if found.speeds:
        console.print()
        straight = [(_command(row), row) for row in found.speeds]
        console.print(_speed_table("Speed on a straight course", "all ahead", straight))
    if found.cruises:
        asked = [(f"{row.speed_kn:g} kn", row) for row in found.cruises]
        console.print(_speed_table("What a speed takes", "speed", asked))
    if found.turns:
        kinds = list(dict.fromkeys(turn.kind for turn in found.turns))
        head = ["outer side", *(TURN_HEADS[kind] for kind in kinds)]
        console.print(table("Steady turns: radius and rate", head, _turn_rows(found, kinds)))
    for note in found.notes:
        console.print(note, soft_wrap=True, markup=False)
    for warning in found.warnings:
        console.print(f"WARNING: {warning}", soft_wrap=True, markup=False, style="yellow")
    if not found.warnings:
        console.print("Nothing looks wrong.")


def _speed_table(title: str, first: str, rows: list[tuple[str, Speed]]) -> Table:
    """Table of speeds; what no row knows has no column."""
    from seatrial.cli.console import table

    columns: dict[str, list[str]] = {first: [label for label, _ in rows]}
    if first == "speed":
        columns["all ahead"] = [_command(row) for _, row in rows]
    columns["m/s"] = [f"{row.speed_m_s:.2f}" for _, row in rows]
    if first != "speed":
        columns["kn"] = [f"{row.speed_kn:.1f}" for _, row in rows]
    columns["thrust, N"] = [f"{row.thrust_n:.3g}" for _, row in rows]
    columns["power, W"] = ["" if row.power_w is None else _rounded(row.power_w) for _, row in rows]
    columns["endurance, h"] = ["" if row.endurance_h is None else f"{row.endurance_h:.2g}" for _, row in rows]
    columns["range, km"] = ["" if row.range_km is None else _rounded(row.range_km) for _, row in rows]
    known = {head: cells for head, cells in columns.items() if any(cells)}
    return table(title, list(known), zip(*known.values(), strict=True))


def _command(row: Speed) -> str:
    """The command as a person sets it: whole revolutions and microseconds, newtons in three digits."""
    return f"{row.command:.3g} N" if row.unit == "N" else f"{row.command:.0f} {row.unit}"


def _rounded(value: float) -> str:
    """Two digits of what is small, no decimals of what is not."""
    return f"{value:.2g}" if value < 9.95 else f"{value:.0f}"


def _turn_rows(found: VehicleCheck, kinds: list[str]) -> list[list[str]]:
    """One row per command of the outer side, one cell per kind of turn."""
    cells: dict[str, dict[str, str]] = {}
    for turn in found.turns:
        digits = 2 if turn.radius_m < 10.0 else 1
        cells.setdefault(f"{turn.command:.4g} {turn.unit}", {})[turn.kind] = (
            f"{turn.radius_m:.{digits}f} m {abs(turn.rate_deg_s):.1f}°/s"
        )
    return [[command, *(row.get(kind, "") for kind in kinds)] for command, row in cells.items()]


def _check_campaign(target: str, *, json: bool) -> None:
    from seatrial.campaign.campaign import Campaign
    from seatrial.check.campaign import check_campaign
    from seatrial.cli.console import complain, output, print_json

    found = check_campaign(Campaign.load(target))
    if json:
        print_json(found.to_dict())
    else:
        _print_campaign(output(), found)
    if found.problems:
        for problem in found.problems:
            complain(problem)
        raise typer.Exit(2)


def _print_campaign(console: Console, found: CampaignCheck) -> None:
    from seatrial.cli.console import table

    console.print(f"[bold]{found.name}[/bold]: vehicle {found.vehicle}, {len(found.reports)} trials\n")
    for name, report in found.reports.items():
        console.print(f"Trial {name}", style="bold", markup=False)
        console.print(str(report), soft_wrap=True, markup=False)
    if found.stages:
        rows = [
            [
                stage.name,
                ", ".join(stage.trials),
                stage.free,
                str(len(stage.coefficients)),
                str(stage.segments),
                str(stage.samples),
                f"{1e3 * stage.step_s:.3g}",
            ]
            for stage in found.stages
        ]
        head = ["stage", "trials", "free", "coefficients", "segments", "samples", "step, ms"]
        console.print()
        console.print(table("Stages in the order of their run", head, rows, left=3))
        for stage in found.stages:
            console.print(f"{stage.name}: {', '.join(stage.coefficients)}", soft_wrap=True, markup=False)
        console.print()
    if found.inputs is not None:
        _print_inputs(console, found.inputs)
    if found.scale is not None:
        console.print("Scale of all forces", style="bold")
        _print_sentences(console, found.scale.sentences())
    if not found.problems:
        console.print("\nReady to identify.")


def _print_inputs(console: Console, found: InputJudgement) -> None:
    from seatrial.cli.console import table

    if found.drives:
        rows = [
            [one.actuator, one.group, f"{one.rms_n:.3g}", f"{100.0 * one.ahead:.0f}"] for one in found.drives
        ]
        head = ["actuator", "group", "thrust about its mean, N", "impulse ahead, %"]
        console.print(table("Inputs over what is fitted", head, rows, left=2))
    else:
        console.print("Inputs over what is fitted", style="bold")
    _print_sentences(console, found.sentences())
    console.print()


def _print_sentences(console: Console, sentences: list[str]) -> None:
    for sentence in sentences:
        style = "yellow" if sentence.startswith("WARNING") else None
        console.print(f"- {sentence}", soft_wrap=True, markup=False, style=style)


_LABEL = 22  # characters: the table of legs stays within 80 columns

_MOST_LEGS = 60


def check_mission_file(
    target: str,
    vehicle: str | None,
    autopilot: str | None,
    *,
    voltage_v: float,
    out: Path | None,
    figures: bool,
    json: bool,
) -> None:
    """Check a mission file, and draw its plan."""
    from seatrial._core import Autopilot, Vehicle
    from seatrial.base.toml_file import loaded
    from seatrial.check.mission import check_mission
    from seatrial.cli.console import list_figures, output, print_json
    from seatrial.flight.mission import Mission

    mission = Mission.load(target)
    found = check_mission(
        mission,
        vehicle=None if vehicle is None else loaded(Vehicle, vehicle, "--vehicle"),
        autopilot=None if autopilot is None else loaded(Autopilot, autopilot, "--autopilot"),
        voltage_v=voltage_v,
    )
    folder = out or Path("runs") / f"check-{Path(target).stem}"
    written: list[Path] = []
    if figures:
        from seatrial.report.plot.mission import mission_plan
        from seatrial.report.plot.style import save

        written = save(mission_plan(mission), folder / "mission_plan")
    metres = None
    if mission.origin is not None and (figures or out is not None):
        metres = folder / "mission_metres.toml"
        folder.mkdir(parents=True, exist_ok=True)
        metres.write_text(mission.to_toml(), encoding="utf-8")
    if json:
        print_json(found.to_dict() | {"figures": [str(path) for path in written]})
        return
    console = output()
    _print_mission(console, found)
    if metres is not None:
        console.print(f"In metres, as the autopilot reads it: {metres}", soft_wrap=True, markup=False)
    list_figures(console, written)


def check_autopilot_file(target: str, vehicle: str | None, *, voltage_v: float, json: bool) -> None:
    """Check an autopilot file."""
    from seatrial._core import Autopilot, Vehicle
    from seatrial.base.toml_file import loaded
    from seatrial.check.autopilot import check_autopilot
    from seatrial.cli.console import output, print_json

    on: Vehicle | None = None if vehicle is None else loaded(Vehicle, vehicle, "--vehicle")
    found = check_autopilot(Autopilot.load(target), vehicle=on, voltage_v=voltage_v)
    if json:
        print_json(found.to_dict())
        return
    _print_autopilot(output(), found)


def _print_mission(console: Console, found: MissionCheck) -> None:
    from seatrial.check.mission import duration
    from seatrial.cli.console import table

    _title(console, found.name, found.description)
    powered = any(row.power_w is not None for row in found.legs)
    head = ["leg", "what", "points", "m", "deg", "depth, m", "m/s", "time", *(["W"] if powered else [])]
    shown, left_out = found.legs, 0
    if len(found.legs) > _MOST_LEGS:
        shown, left_out = found.legs[:_MOST_LEGS], len(found.legs) - _MOST_LEGS
    rows = [
        [
            str(row.number),
            _shortened(row.label),
            str(row.waypoints),
            f"{row.length_m:.0f}",
            f"{row.slope_deg:+.0f}" if abs(row.slope_deg) >= 0.5 else "0",
            _level(row),
            f"{row.speed_m_s:g}",
            duration(row.time_s),
            *([_power(row)] if powered else []),
        ]
        for row in shown
    ]
    console.print(table("Legs", head, rows, left=2))
    if left_out:
        console.print(f"and {left_out} legs more: --json tells all of them", markup=False)
    if any(row.vertical == "altitude" for row in found.legs):
        console.print("^ above the bottom", markup=False)
    _print_mission_sentences(console, found.notes, found.warnings)


def _print_autopilot(console: Console, found: AutopilotCheck) -> None:
    _title(console, found.name, found.description)
    print_modes_and_gains(console, found)
    _print_mission_sentences(console, [*found.notes, *found.safety], found.warnings)


def print_modes_and_gains(console: Console, found: AutopilotCheck) -> None:
    """Print the mode table and, of a PID, its gains."""
    from seatrial.cli.console import table

    rows = [
        [
            mode.name,
            f"{mode.from_speed_m_s:g}",
            mode.depth_by,
            " ".join(mode.loops),
            " ".join(mode.actuators) or "all",
        ]
        for mode in found.modes
    ]
    console.print(table("Modes", ["mode", "from m/s", "depth by", "loops", "actuators"], rows))
    if found.gains and found.control == "pid":
        gains = [[row.loop, row.gain, *(f"{value:.3g}" for value in row.values)] for row in found.gains]
        head = ["loop", "at m/s", *(f"{speed:.3g}" for speed in found.speeds_m_s)]
        console.print(table("Gains", head, gains, left=2))


def _title(console: Console, name: str, description: str) -> None:
    console.print(
        f"{name}: {description}" if description else name, soft_wrap=True, markup=False, style="bold"
    )
    console.print()


def _print_mission_sentences(console: Console, notes: Sequence[str], warnings: Sequence[str]) -> None:
    for note in notes:
        console.print(note, soft_wrap=True, markup=False)
    for warning in warnings:
        console.print(f"WARNING: {warning}", soft_wrap=True, markup=False, style="yellow")
    if not warnings:
        console.print("Nothing looks wrong.")


def _shortened(text: str) -> str:
    return text if len(text) <= _LABEL else text[: _LABEL - 1] + "…"


def _level(row: LegRow) -> str:
    low, high = row.level_m
    mark = "^" if row.vertical == "altitude" else ""
    return f"{low:.3g}{mark}" if high - low < 0.05 else f"{low:.3g}-{high:.3g}{mark}"


def _power(row: LegRow) -> str:
    return "" if row.power_w is None else f"{row.power_w:.0f}"
