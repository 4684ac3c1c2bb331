"""`seatrial check`: what a vehicle, autopilot or mission file says, in sentences; what a campaign will do."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from seatrial.base.errors import SeatrialError, nearest
from seatrial.base.files import file_name, no_file
from seatrial.cli.options import Drawn, Triple, shared
from seatrial.vehicle.actuators import NOMINAL_V

if TYPE_CHECKING:
    from seatrial._core import Vehicle

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
    "a mission": ("--vehicle", "--autopilot", "--out", "--current", "--sensors", "--seabed"),
    "an autopilot": ("--vehicle",),
}
"""Options that only some files have."""


@dataclass(frozen=True)
class Flying:
    """What flies a mission in which water, and at what supply."""

    vehicle: Annotated[
        str | None,
        typer.Option(help="Vehicle that a mission or an autopilot is for: file or name.", metavar="VEHICLE"),
    ] = None
    autopilot: Annotated[
        str | None, typer.Option(help="Autopilot that flies a mission: file or name.", metavar="AUTOPILOT")
    ] = None
    current: Annotated[
        Triple | None,
        typer.Option(
            metavar="NORTH EAST DOWN",
            help="Velocity of the water in which vehicle and autopilot fly a mission, m/s; 0.3 m/s from four"
            " sides when missing.",
        ),
    ] = None
    sensors: Annotated[
        str | None,
        typer.Option(
            metavar="FILE", help="Sensors with which they fly it, or: typical. Perfect when missing."
        ),
    ] = None
    seabed: Annotated[
        float | None, typer.Option(metavar="DEPTH", help="Depth of the bottom over which they fly it, m.")
    ] = None


@shared
def check(
    target: Annotated[
        str,
        typer.Argument(
            help="Vehicle file, built-in vehicle, campaign, mission or autopilot file.",
            metavar="VEHICLE|CAMPAIGN|MISSION|AUTOPILOT",
        ),
    ],
    flying: Flying = Flying(),
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
            help="Speed for which to print revolutions, power, endurance and range, kn; repeatable; round"
            " ones up to the top speed when missing.",
        ),
    ] = None,
    output: Drawn = Drawn(),
) -> None:
    """Check a vehicle (signs, speeds, turns, stability), an autopilot, a mission or a campaign beforehand.

    Example: seatrial check vehicle.toml
    """
    # What cannot be is refused before a file is read, what does not fit the file after its kind is known.
    _check_numbers(voltage, speed_kn or [], flying)
    kind = _kind(target)
    _check_options(target, kind, flying, {"--speed-kn": speed_kn or None, "--out": out})
    if kind == "a campaign":
        _check_campaign(target, output)
    elif kind == "a mission":
        _check_mission(target, flying, voltage, out, output)
    elif kind == "an autopilot":
        _check_autopilot(target, flying.vehicle, voltage, output)
    else:
        _check_vehicle(target, voltage, speed_kn, out, output)


def _check_numbers(voltage: float, speed_kn: list[float], flying: Flying) -> None:
    """Refuse numbers beyond any voltage, speed, depth or current."""
    bottom = [] if flying.seabed is None else [flying.seabed]
    for option, values, most in (
        ("--voltage", [voltage], 10_000.0),
        ("--speed-kn", speed_kn, 100.0),
        ("--seabed", bottom, 12_000.0),
    ):
        for value in values:
            if value > most:
                raise SeatrialError(f"{option}: expected at most {most:g}, found {value:g}; check the unit")
    if flying.current is not None:
        from seatrial.flight.checks import checked_rows

        checked_rows("--current", flying.current)


def _check_options(target: str, kind: str, flying: Flying, others: dict[str, Any]) -> None:
    """Refuse options that this kind of file has not."""
    given = {f"--{field.name}": getattr(flying, field.name) for field in fields(flying)} | others
    for option, value in given.items():
        if value is not None and option not in _OPTIONS[kind]:
            fitting = " or ".join(name for name, options in _OPTIONS.items() if option in options)
            raise SeatrialError(f"{option} is for {fitting}, and {target} is {kind}; leave it out")
    for option in ("--current", "--sensors", "--seabed"):
        if given[option] is not None and None in (flying.vehicle, flying.autopilot):
            raise SeatrialError(f"{option}: a mission is flown with --vehicle and --autopilot; give both")


def _check_vehicle(
    target: str, voltage: float, speed_kn: list[float] | None, out: Path | None, output: Drawn
) -> None:
    from seatrial._core import Vehicle
    from seatrial.base.files import only_user
    from seatrial.check.vehicle import check_vehicle

    vehicle = Vehicle.load(target)
    folder = out or Path("runs") / file_name(f"check-{vehicle.name}")
    with only_user(folder) if output.endings else nullcontext():
        checked = check_vehicle(vehicle, voltage_v=voltage, speeds_kn=speed_kn or None)
        output.show(checked, draw=lambda: _draw_vehicle(vehicle, voltage, folder, output.endings))


def _draw_vehicle(vehicle: Vehicle, voltage: float, folder: Path, endings: tuple[str, ...]) -> list[Path]:
    if not endings:
        return []
    from seatrial.report.plot.performance import characteristic, performance
    from seatrial.report.plot.style import save
    from seatrial.report.plot.vehicle import three_views

    written = save(three_views(vehicle), folder / "three_views", formats=endings)
    if vehicle.actuators:
        written += save(characteristic(vehicle), folder / "characteristic", formats=endings)
    if (sailing := performance(vehicle, voltage_v=voltage)) is not None:
        written += save(sailing, folder / "performance", formats=endings)
    return written


def _kind(target: str) -> str:
    """What the file is; a vehicle where nothing tells."""
    from seatrial._core import Vehicle
    from seatrial.base.toml_file import VEHICLE, file_kind, tables, text_of

    kind = file_kind(target)
    if kind is None and Path(target).suffix == ".toml" and Path(target).is_file():
        text = text_of(target, "a vehicle, campaign, mission or autopilot file", error=SeatrialError)
        tables(text, target, error=SeatrialError)  # a mistake in the text is said as it is
    if kind is not None and kind in _ADVICE:
        raise SeatrialError(
            f"{target}: expected a vehicle, campaign, mission or autopilot file, found {kind};"
            f" {_ADVICE[kind].format(target)}"
        )
    if kind is None and target not in Vehicle.names() and (wrong := no_file(Path(target))):
        near = nearest(target, Vehicle.names())
        raise SeatrialError(
            f"{target or 'an empty name'}: expected a vehicle, campaign, mission or autopilot file or one of"
            f" the built-in vehicles {', '.join(Vehicle.names())}, but {wrong}"
            f"{near if near.endswith('?') else '; check the path'}"
        )
    return kind or VEHICLE


def is_campaign(target: str) -> bool:
    """Whether the file is a campaign."""
    from seatrial.base.toml_file import CAMPAIGN, file_kind

    return file_kind(target) == CAMPAIGN


def _check_campaign(target: str, output: Drawn) -> None:
    from seatrial.campaign.campaign import Campaign
    from seatrial.check.campaign import check_campaign
    from seatrial.cli.console import Code, complain, reading_progress

    checked = check_campaign(Campaign.load(target, progress=reading_progress(quiet=output.json)))
    output.show(checked)
    for problem in checked.problems:
        complain(problem)
    if checked.problems:
        raise typer.Exit(Code.BAD_INPUT)


def _check_mission(target: str, flying: Flying, voltage: float, out: Path | None, output: Drawn) -> None:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.base.files import only_user, write_atomic
    from seatrial.base.toml_file import loaded
    from seatrial.check.mission import check_mission
    from seatrial.flight.mission import Mission

    mission = Mission.load(target)
    checked = check_mission(
        mission,
        vehicle=None if flying.vehicle is None else loaded(Vehicle, flying.vehicle, "--vehicle"),
        autopilot=None if flying.autopilot is None else loaded(Autopilot, flying.autopilot, "--autopilot"),
        current=flying.current,
        sensors=flying.sensors,
        seabed=flying.seabed,
        voltage_v=voltage,
    )
    folder = out or Path("runs") / file_name(f"check-{Path(target).stem}")

    def drawn() -> list[Path]:
        if not output.endings:
            return []
        from seatrial.report.plot.style import save
        from seatrial.report.plot.track import mission_plan

        return save(mission_plan(mission), folder / "mission_plan", formats=output.endings)

    results = ""
    writes = bool(output.endings) or out is not None
    with only_user(folder) if writes else nullcontext():
        # A mission in geographic coordinates is written as the autopilot reads it.
        if mission.origin is not None and writes:
            metres = folder / "mission_metres.toml"
            folder.mkdir(parents=True, exist_ok=True)
            write_atomic(metres, mission.to_toml().encode())
            results = f"In metres, as the autopilot reads it: {metres}"
        output.show(checked, results=results, draw=drawn)


def _check_autopilot(target: str, vehicle: str | None, voltage: float, output: Drawn) -> None:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.base.toml_file import loaded
    from seatrial.check.autopilot import check_autopilot

    on: Vehicle | None = None if vehicle is None else loaded(Vehicle, vehicle, "--vehicle")
    output.show(check_autopilot(Autopilot.load(target), vehicle=on, voltage_v=voltage))
