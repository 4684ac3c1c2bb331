"""`seatrial sitl`: the identified vehicle as physics behind ArduPilot's simulator."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from seatrial.cli.options import Json, Verbose


def sitl(
    vehicle: Annotated[str, typer.Argument(help="Vehicle file or built-in vehicle to simulate.")],
    parameters: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.param", help="Parameters of ArduSub: channels, ends and directions of the motors."
        ),
    ] = None,
    channel: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ACTUATOR=NUMBER", help="Override the servo channel of an actuator; repeatable."
        ),
    ] = None,
    host: Annotated[
        str, typer.Option(help="Address to listen on; only this machine by default.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="UDP port; ArduPilot sends to 9002.")] = 9002,
    idle_s: Annotated[float, typer.Option(help="End after this silence, s.")] = 60.0,
    frames: Annotated[int | None, typer.Option(min=1, help="End after so many frames.")] = None,
    sensors: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="Sensors of the vehicle, or: typical. Perfect ones when missing."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the sensors' errors.")] = 0,
    current: Annotated[
        tuple[float, float, float],
        typer.Option(metavar="NORTH EAST DOWN", help="Velocity of the water, m/s."),
    ] = (0.0, 0.0, 0.0),
    depth: Annotated[float, typer.Option(metavar="M", help="Depth at which it begins, m.")] = 0.0,
    heading: Annotated[float, typer.Option(metavar="DEG", help="Heading at which it begins, degrees.")] = 0.0,
    voltage: Annotated[float | None, typer.Option(help="Supply, V, where thrust depends on it.")] = None,
    seabed: Annotated[
        float | None, typer.Option(metavar="DEPTH", help="Depth of the bottom, m: adds a range finder.")
    ] = None,
    log: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the motion as a trial, .csv or .parquet.")
    ] = None,
    log_hz: Annotated[float, typer.Option(help="Rows of the log per second of motion.")] = 10.0,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Be the physics behind ArduPilot's simulator: servo packets in over UDP, the state of the vehicle out.

    Start ArduSub with --model JSON:127.0.0.1. The exit code is 0, 1 when the motion diverged, 2 for bad
    input.

    Example: seatrial sitl vehicle.toml
    """
    import math

    from seatrial._core import State
    from seatrial.base.atomic_write import write_table
    from seatrial.base.errors import SeatrialError
    from seatrial.base.file_names import check_place
    from seatrial.cli.console import answer, print_json
    from seatrial.cli.streams import INTERRUPTED, note
    from seatrial.realtime.ardupilot_link import sitl as serve

    if log is not None:
        check_place(
            log,
            "--log",
            endings=(".csv", ".parquet"),
            inputs={"the vehicle": vehicle, "the parameters": parameters, "the sensors": sensors},
            folder_made=True,
        )
        log.parent.mkdir(parents=True, exist_ok=True)

    def ready(address: tuple[str, int]) -> None:
        if not json:
            note(f"{vehicle} listens on {address[0]}:{address[1]}; ends after {idle_s:g} s of silence")

    session = serve(
        vehicle,
        parameters=parameters,
        channels=_channels(channel or []),
        host=host,
        port=port,
        idle_s=idle_s,
        max_frames=frames,
        sensors=sensors,
        seed=seed,
        initial=State([0.0, 0.0, depth], [0.0, 0.0, math.radians(heading)]),
        current=current,
        voltage_v=voltage,
        seabed_m=seabed,
        log_hz=0.0 if log is None else log_hz,
        ready=ready,
    )
    lost, written = None, ""
    if log is not None and session.rows:
        try:
            write_table(session.table(), log)
            written = f"Motion in {log}: {len(session.rows)} rows"
        except SeatrialError as error:  # what the session was is told all the same
            lost = error
    if json:
        print_json(session.to_dict())
    else:
        answer(session.report(), verbose=verbose, results=written)
    if lost is not None:
        raise lost
    if session.ended == "interrupted":
        raise typer.Exit(INTERRUPTED)
    if session.ended == "diverged":
        raise typer.Exit(1)


def _channels(entries: list[str]) -> dict[str, int]:
    from seatrial.base.errors import SimulationError

    found = {}
    for entry in entries:
        name, _, number = entry.partition("=")
        if not name or not number.isdecimal():
            raise SimulationError(f"--channel {entry}: expected ACTUATOR=NUMBER, for example rudder=5")
        found[name] = int(number)
    return found
