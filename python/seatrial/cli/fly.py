"""`seatrial fly`: a vehicle with its autopilot on a mission, under one seed or many."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seatrial.base.file_names import file_name
from seatrial.cli.options import Aboard, Output, Sea, shared
from seatrial.cli.report import reported

if TYPE_CHECKING:
    from seatrial.base.run import RunDirectory
    from seatrial.flight.flight import Flight
    from seatrial.flight.fly import Seeds


@shared
def fly(
    vehicle: Annotated[str, typer.Argument(help="Vehicle file or built-in vehicle that flies.")],
    autopilot: Annotated[str, typer.Argument(help="Autopilot file or built-in autopilot.")],
    mission: Annotated[str, typer.Argument(help="Mission file.")],
    sea: Sea = Sea(),
    aboard: Aboard = Aboard(),
    navigation: Annotated[
        str,
        typer.Option(
            metavar="sensors|filter",
            help="What the autopilot uses: what the sensors show, or the estimate of a navigation filter.",
        ),
    ] = "sensors",
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
    seed: Annotated[
        int,
        typer.Option(
            min=0, help="Of sensors' errors and the water's motion; the same seed, the same flight."
        ),
    ] = 0,
    seeds: Annotated[
        int | None,
        typer.Option(min=2, max=100_000, help="Number of seeds to fly, from --seed on; reports the spread."),
    ] = None,
    payload: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Water, plumes and the sensors that sample it: a payload file."),
    ] = None,
    output: Output = Output(),
) -> None:
    """Fly a mission in closed loop: vehicle, sensors, autopilot and current together.

    Example: seatrial fly cwolf cwolf box.toml --current 0 0.2 0 --sensors typical

    The exit code is 0 when the mission was complete and every waypoint reached, 1 when not, 2 for bad input.
    """
    from seatrial.base.run import RunDirectory
    from seatrial.flight.failures import Fault, Outage
    from seatrial.flight.fly import fly as flown
    from seatrial.flight.fly import fly_seeds

    sources = (vehicle, autopilot, mission)
    water = sea.water()
    conditions = aboard.conditions(
        faults=[Fault.parse(text) for text in fault or []],
        outages=[Outage.parse(text) for text in outage or []],
        navigation=navigation,
    )
    folder = output.out or Path("runs") / _folder(vehicle, mission)
    # Held from before the flight on: a second flight into it is refused at once.
    with RunDirectory(folder, "flight") as directory:
        flight = flown(*sources, water=water, conditions=conditions, seed=seed, payload=payload)
        many = None
        if seeds is not None:
            many = fly_seeds(*sources, count=seeds, first=seed, water=water, conditions=conditions)
        _tell(flight, many, directory, folder, output)
    reported(output.page, [folder], quiet=output.json)
    if not flight.complete or (many is not None and not many.all_complete):
        raise typer.Exit(1)


def _tell(flight: Flight, many: Seeds | None, directory: RunDirectory, folder: Path, output: Output) -> None:
    """Show a flight, publish its run directory that is held, and draw its figures."""
    from seatrial.base.atomic_write import only_user
    from seatrial.cli.console import answer, print_json
    from seatrial.report.plot import gallery

    beside = {} if many is None else {"seeds.parquet": many.parquet()}

    def saved() -> str:
        flight.publish(directory, beside=beside)
        sampled = "" if flight.samples is None else "samples.parquet, samples.csv, "
        return f"Results in {folder}: flight.json, flight.parquet, {sampled}summary.txt and the inputs"

    def drawn() -> list[Path]:
        if not output.endings:
            return []
        with only_user(folder):  # another flight would replace the folder under the figures
            return sorted(gallery(flight, folder / "figures", formats=output.endings))

    if output.json:
        saved()
        result = flight.to_dict() | {"run_directory": str(folder), "figures": [str(p) for p in drawn()]}
        print_json(result if many is None else result | {"seeds": many.to_dict()})
    else:
        report = flight.report(sections=() if many is None else (many.section(),))
        if many is not None and many.excesses:
            report = replace(report, worst="; ".join((*many.excesses, report.worst)))
        answer(report, verbose=output.verbose, results=saved, draw=drawn)


def _folder(vehicle: str, mission: str) -> str:
    """Name of the run directory, no longer than file systems take."""
    from seatrial._core import Vehicle
    from seatrial.base.toml_file import loaded
    from seatrial.flight.mission import Mission

    return file_name(f"fly-{loaded(Vehicle, vehicle).name}-{loaded(Mission, mission).name}")
