"""`seatrial fly`: a vehicle with its autopilot on a mission, under one seed or many."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seatrial.base.file_names import file_name
from seatrial.cli.console import Figures, Json, Pdf, Verbose
from seatrial.cli.realtime import Hardware, LivePort, Realtime, Record, Speed, Watchdog, fly_by_the_clock
from seatrial.cli.report import Page, reported

if TYPE_CHECKING:
    from seatrial.base.run import RunDirectory
    from seatrial.flight.flight import Flight
    from seatrial.flight.seeds import Seeds

_WATCHDOG_S = 0.5


def fly(
    vehicle: Annotated[str, typer.Argument(help="Vehicle file or built-in vehicle that flies.")],
    autopilot: Annotated[str, typer.Argument(help="Autopilot file or built-in autopilot.")],
    mission: Annotated[str, typer.Argument(help="Mission file.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Run directory; runs/fly-VEHICLE-MISSION by default.")
    ] = None,
    current: Annotated[
        tuple[float, float, float],
        typer.Option(metavar="NORTH EAST DOWN", help="Velocity of the water, m/s."),
    ] = (0.0, 0.0, 0.0),
    turbulence: Annotated[
        float,
        typer.Option(
            metavar="M_S", min=0.0, help="Standard deviation of the water's north and east velocity, m/s."
        ),
    ] = 0.0,
    current_trend: Annotated[
        tuple[float, float, float],
        typer.Option(metavar="NORTH EAST DOWN", help="Steady change of the current in an hour, m/s."),
    ] = (0.0, 0.0, 0.0),
    current_walk: Annotated[
        float,
        typer.Option(
            metavar="M_S",
            min=0.0,
            help="Standard deviation, after an hour, of a random walk of the water's north and east velocity,"
            " m/s.",
        ),
    ] = 0.0,
    waves: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="HEIGHT PERIOD TOWARD",
            help="Significant height in m, peak period in s, and where the waves go, degrees from north over"
            " east.",
        ),
    ] = None,
    sensors: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="Sensors of the vehicle, or: typical. Perfect ones when missing."),
    ] = None,
    seed: Annotated[
        int,
        typer.Option(
            min=0, help="Of sensors' errors and the water's motion; the same seed, the same flight."
        ),
    ] = 0,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ACTUATOR@TIME[=stuck|=VALUE]",
            help="An actuator is dead from a time in s on, or stuck there, or stuck at a value; repeatable.",
        ),
    ] = None,
    outage: Annotated[
        list[str] | None,
        typer.Option(
            metavar="GROUP@FROM[-UNTIL]",
            help="No samples of position, depth, attitude, velocity, rates, altitude or water between two"
            " times in s; repeatable.",
        ),
    ] = None,
    seabed: Annotated[float | None, typer.Option(metavar="DEPTH", help="Depth of the bottom, m.")] = None,
    model: Annotated[
        str | None, typer.Option(help="Vehicle that the autopilot believes in, if it is another.")
    ] = None,
    voltage: Annotated[float | None, typer.Option(help="Supply, V, where thrust depends on it.")] = None,
    feedback: Annotated[bool, typer.Option(help="The autopilot sees what its actuators do.")] = True,
    navigation: Annotated[
        str,
        typer.Option(
            metavar="sensors|filter",
            help="What the autopilot goes by: what the sensors show, or the estimate of a navigation filter.",
        ),
    ] = "sensors",
    max_time: Annotated[
        float | None,
        typer.Option(help="Longest duration, s; three times the planned one and five minutes by default."),
    ] = None,
    seeds: Annotated[
        int | None,
        typer.Option(min=2, max=100_000, help="Number of seeds to fly, from --seed on; reports the spread."),
    ] = None,
    payload: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Water, plumes and the sensors that sample it: a payload file."),
    ] = None,
    realtime: Realtime = False,
    speed: Speed = 1.0,
    live: LivePort = None,
    record: Record = None,
    hardware: Hardware = None,
    watchdog: Watchdog = _WATCHDOG_S,
    figures: Figures = True,
    pdf: Pdf = False,
    page: Page = None,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Fly a mission in closed loop: vehicle, sensors, autopilot and current together.

    The exit code is 0 when the mission was complete and every waypoint reached, 1 when not, 2 for bad input.
    """
    from seatrial.base.errors import SimulationError
    from seatrial.base.run import RunDirectory
    from seatrial.flight.conditions import Conditions, Water
    from seatrial.flight.failures import Fault, Outage
    from seatrial.flight.fly import fly as flown
    from seatrial.flight.sea import SeaState
    from seatrial.flight.seeds import fly_seeds

    sources = (vehicle, autopilot, mission)
    by_the_clock = {
        "--speed": speed != 1.0,
        "--live": live is not None,
        "--record": record,
        "--hardware": hardware,
        "--watchdog": watchdog != _WATCHDOG_S,
    }
    if realtime:
        fly_by_the_clock(
            sources,
            hardware=hardware,
            out=out,
            verbose=verbose,
            json=json,
            refused={
                "--turbulence": turbulence,
                "--current-trend": any(current_trend),
                "--current-walk": current_walk,
                "--waves": waves,
                "--fault": fault,
                "--outage": outage,
                "--seabed": seabed is not None,
                "--seeds": seeds,
                "--payload": payload,
                "--navigation": navigation != "sensors",
                "--report": page,
            },
            model=model,
            speed=speed,
            max_time_s=max_time,
            sensors=sensors,
            seed=seed,
            current=current,
            voltage_v=voltage,
            feedback=feedback,
            live_port=live,
            record=record,
            watchdog_s=watchdog,
        )
        return
    if given := [name for name, value in by_the_clock.items() if value]:
        raise SimulationError(f"{', '.join(given)}: needs --realtime; add it")
    water = Water(
        current=current,
        turbulence=turbulence,
        current_trend=current_trend,
        current_walk=current_walk,
        waves=None if waves is None else SeaState(*waves),
        seabed=seabed,
    )
    conditions = Conditions(
        model=model,
        sensors=sensors,
        faults=[Fault.parse(text) for text in fault or []],
        outages=[Outage.parse(text) for text in outage or []],
        voltage_v=voltage,
        feedback=feedback,
        navigation=navigation,
        max_time_s=max_time,
    )
    folder = out or Path("runs") / _folder(vehicle, mission)
    with RunDirectory(folder, "flight") as held:  # from before the flight on: a second one is refused at once
        flight = flown(*sources, water=water, conditions=conditions, seed=seed, payload=payload)
        many = (
            None
            if seeds is None
            else fly_seeds(*sources, count=seeds, first=seed, water=water, conditions=conditions)
        )
        _tell(flight, many, held, folder, verbose=verbose, json=json, figures=figures, pdf=pdf, page=page)
    reported(page, [folder], quiet=json)
    if not flight.complete or (many is not None and not many.all_complete):
        raise typer.Exit(1)


def _tell(
    flight: Flight,
    many: Seeds | None,
    held: RunDirectory,
    folder: Path,
    *,
    verbose: bool,
    json: bool,
    figures: bool,
    pdf: bool,
    page: Path | None,
) -> None:
    """Show a flight, publish its run directory that is held, and draw its figures."""
    from seatrial.base.folder_lock import only_user
    from seatrial.cli.console import answer, formats, print_json

    beside = {} if many is None else {"seeds.parquet": many.parquet()}

    def saved() -> str:
        flight.publish(held, beside=beside)
        sampled = "" if flight.samples is None else "samples.parquet, samples.csv, "
        return f"Results in {folder}: flight.json, flight.parquet, {sampled}summary.txt and the inputs"

    def drawn() -> list[Path]:
        if not figures:
            return []
        with only_user(folder):  # another flight would replace the folder under the figures
            return draw_flight(flight, folder, formats(pdf, page))

    if json:
        saved()
        result = flight.to_dict() | {"run_directory": str(folder), "figures": [str(p) for p in drawn()]}
        print_json(result if many is None else result | {"seeds": many.to_dict()})
    else:
        report = flight.report(sections=() if many is None else (many.section(),))
        if many is not None and many.excesses:
            report = replace(report, worst="; ".join((*many.excesses, report.worst)))
        answer(report, verbose=verbose, results=saved, draw=drawn)


def draw_flight(flight: Flight, folder: Path, endings: tuple[str, ...] = ("png",)) -> list[Path]:
    """Paths of the figures of a flight in its run directory."""
    from seatrial.report.plot.flight_errors import flight_gallery

    return sorted(flight_gallery(flight, folder / "figures", formats=endings))


def _folder(vehicle: str, mission: str) -> str:
    """Name of the run directory, no longer than file systems take."""
    from seatrial._core import Vehicle
    from seatrial.base.toml_file import loaded
    from seatrial.flight.mission import Mission

    return file_name(f"fly-{loaded(Vehicle, vehicle).name}-{loaded(Mission, mission).name}")
