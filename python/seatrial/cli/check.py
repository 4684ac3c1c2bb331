"""`seatrial check`: what a vehicle, autopilot or mission file says, in sentences; what a campaign will do.

`seatrial check` of a mission or an autopilot file: tables and sentences.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from seatrial.base.errors import SeatrialError, nearest
from seatrial.base.file_names import file_name, no_file
from seatrial.cli.options import FigureFormat, Figures, Json, Verbose
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


class _Drawing(NamedTuple):
    """Whether figures are drawn, and in which formats."""

    wanted: bool
    formats: tuple[str, ...]


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
    current: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="NORTH EAST DOWN",
            help="Velocity of the water in which vehicle and autopilot fly a mission, m/s; 0.3 m/s from four"
            " sides when missing.",
        ),
    ] = None,
    sensors: Annotated[
        str | None,
        typer.Option(
            metavar="FILE", help="Sensors with which they fly it, or: typical. Perfect when missing."
        ),
    ] = None,
    seabed: Annotated[
        float | None, typer.Option(metavar="DEPTH", help="Depth of the bottom over which they fly it, m.")
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
            help="Speed for which to print revolutions, power, endurance and range, kn; repeatable; round"
            " ones up to the top speed when missing.",
        ),
    ] = None,
    figures: Figures = FigureFormat.PNG,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Check a vehicle (signs, speeds, turns, stability), an autopilot, a mission or a campaign beforehand.

    Example: seatrial check vehicle.toml
    """
    _check_options(voltage, speed_kn or [], seabed)
    if current is not None:
        from seatrial.flight.checks import checked_rows

        checked_rows("--current", current)
    kind = _kind(target)
    given = {"--vehicle": vehicle, "--autopilot": autopilot, "--speed-kn": speed_kn or None, "--out": out}
    flying = {"--current": current, "--sensors": sensors, "--seabed": seabed}
    for option, value in (given | flying).items():
        if value is not None and option not in _OPTIONS[kind]:
            fitting = " or ".join(name for name, options in _OPTIONS.items() if option in options)
            raise SeatrialError(f"{option} is for {fitting}, and {target} is {kind}; leave it out")
    for option, value in flying.items():
        if value is not None and (vehicle is None or autopilot is None):
            raise SeatrialError(f"{option}: a mission is flown with --vehicle and --autopilot; give both")
    drawing = _Drawing(bool(figures.endings()), figures.endings())
    if kind == "a campaign":
        _check_campaign(target, verbose=verbose, json=json)
    elif kind == "a mission":
        water = {"current": current, "sensors": sensors, "seabed": seabed, "voltage_v": voltage}
        _check_mission(target, (vehicle, autopilot), water, out, drawing=drawing, verbose=verbose, json=json)
    elif kind == "an autopilot":
        _check_autopilot(target, vehicle, voltage, verbose=verbose, json=json)
    else:
        _check_vehicle(target, voltage, speed_kn, out, drawing=drawing, verbose=verbose, json=json)


def _check_vehicle(
    target: str,
    voltage: float,
    speed_kn: list[float] | None,
    out: Path | None,
    *,
    drawing: _Drawing,
    verbose: bool,
    json: bool,
) -> None:
    from seatrial._core import Vehicle
    from seatrial.base.atomic_write import only_user
    from seatrial.check.vehicle import check_vehicle
    from seatrial.cli.console import answer, print_json

    vehicle = Vehicle.load(target)
    folder = out or Path("runs") / file_name(f"check-{vehicle.name}")

    def drawn() -> list[Path]:
        return _draw_vehicle(vehicle, voltage, folder, drawing.formats) if drawing.wanted else []

    with only_user(folder) if drawing.wanted else nullcontext():
        found = check_vehicle(vehicle, voltage_v=voltage, speeds_kn=speed_kn or None)
        if json:
            print_json(found.to_dict() | {"figures": [str(path) for path in drawn()]})
        else:
            answer(found.report(), verbose=verbose, draw=drawn)


def _draw_vehicle(vehicle: Vehicle, voltage: float, folder: Path, endings: tuple[str, ...]) -> list[Path]:
    from seatrial.report.plot.performance import characteristic, performance
    from seatrial.report.plot.style import save
    from seatrial.report.plot.vehicle import three_views

    written = save(three_views(vehicle), folder / "three_views", formats=endings)
    if vehicle.actuators:
        written += save(characteristic(vehicle), folder / "characteristic", formats=endings)
    if (sailing := performance(vehicle, voltage_v=voltage)) is not None:
        written += save(sailing, folder / "performance", formats=endings)
    return written


def _check_options(voltage: float, speed_kn: list[float], seabed: float | None) -> None:
    """Refuse numbers beyond any voltage, speed or depth."""
    bottom = [] if seabed is None else [seabed]
    for option, values, most in (
        ("--voltage", [voltage], 10_000.0),
        ("--speed-kn", speed_kn, 100.0),
        ("--seabed", bottom, 12_000.0),
    ):
        for value in values:
            if value > most:
                raise SeatrialError(f"{option}: expected at most {most:g}, found {value:g}; check the unit")


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


def _is_campaign(target: str) -> bool:
    """Whether the file is a campaign."""
    from seatrial.base.toml_file import CAMPAIGN, file_kind

    return file_kind(target) == CAMPAIGN


def _check_campaign(target: str, *, verbose: bool, json: bool) -> None:
    from seatrial.campaign.campaign import Campaign
    from seatrial.check.campaign import check_campaign
    from seatrial.cli.console import answer, print_json, reading_progress
    from seatrial.cli.streams import complain

    found = check_campaign(Campaign.load(target, progress=reading_progress(quiet=json)))
    if json:
        print_json(found.to_dict())
    else:
        answer(found.report(), verbose=verbose)
    if found.problems:
        for problem in found.problems:
            complain(problem)
        raise typer.Exit(2)


def _check_mission(
    target: str,
    flown_by: tuple[str | None, str | None],
    water: Mapping[str, Any],
    out: Path | None,
    *,
    drawing: _Drawing,
    verbose: bool,
    json: bool,
) -> None:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.base.atomic_write import only_user, write_atomic
    from seatrial.base.toml_file import loaded
    from seatrial.check.mission import check_mission
    from seatrial.cli.console import answer, print_json
    from seatrial.flight.mission import Mission

    mission = Mission.load(target)
    vehicle, autopilot = flown_by
    found = check_mission(
        mission,
        vehicle=None if vehicle is None else loaded(Vehicle, vehicle, "--vehicle"),
        autopilot=None if autopilot is None else loaded(Autopilot, autopilot, "--autopilot"),
        **water,
    )
    folder = out or Path("runs") / file_name(f"check-{Path(target).stem}")

    def drawn() -> list[Path]:
        if not drawing.wanted:
            return []
        from seatrial.report.plot.mission import mission_plan
        from seatrial.report.plot.style import save

        return save(mission_plan(mission), folder / "mission_plan", formats=drawing.formats)

    results = ""
    with only_user(folder) if drawing.wanted or out is not None else nullcontext():
        if mission.origin is not None and (drawing.wanted or out is not None):
            metres = folder / "mission_metres.toml"
            folder.mkdir(parents=True, exist_ok=True)
            write_atomic(metres, mission.to_toml().encode())
            results = f"In metres, as the autopilot reads it: {metres}"
        if json:
            print_json(found.to_dict() | {"figures": [str(path) for path in drawn()]})
        else:
            answer(found.report(), verbose=verbose, results=results, draw=drawn)


def _check_autopilot(target: str, vehicle: str | None, voltage: float, *, verbose: bool, json: bool) -> None:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.base.toml_file import loaded
    from seatrial.check.autopilot import check_autopilot
    from seatrial.cli.console import answer, print_json

    on: Vehicle | None = None if vehicle is None else loaded(Vehicle, vehicle, "--vehicle")
    found = check_autopilot(Autopilot.load(target), vehicle=on, voltage_v=voltage)
    if json:
        print_json(found.to_dict())
    else:
        answer(found.report(), verbose=verbose)
