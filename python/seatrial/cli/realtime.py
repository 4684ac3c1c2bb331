"""`seatrial realtime`: a flight by the clock, live in Foxglove, with hardware in the loop."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from seatrial.cli.options import Aboard, Printed, shared


@shared
def realtime(
    vehicle: Annotated[str, typer.Argument(help="Vehicle file or built-in vehicle that flies.")],
    autopilot: Annotated[str, typer.Argument(help="Autopilot file or built-in autopilot.")],
    mission: Annotated[str, typer.Argument(help="Mission file.")],
    current: Annotated[
        tuple[float, float, float], typer.Option(metavar="NORTH EAST DOWN", help="Velocity, m/s.")
    ] = (0.0, 0.0, 0.0),
    aboard: Aboard = Aboard(),
    seed: Annotated[int, typer.Option(min=0, help="Of the sensors' errors.")] = 0,
    speed: Annotated[float, typer.Option(help="Seconds of motion per second of the clock.")] = 1.0,
    live: Annotated[
        int | None,
        typer.Option(
            metavar="PORT",
            min=0,
            max=65535,
            help="WebSocket for Foxglove on this machine (8765 is Foxglove's own default).",
        ),
    ] = None,
    record: Annotated[Path | None, typer.Option(metavar="FILE.mcap", help="Record what is shown.")] = None,
    hardware: Annotated[
        str | None,
        typer.Option(metavar="HOST:PORT", help="UDP address of autopilot hardware that steers instead."),
    ] = None,
    watchdog: Annotated[
        float, typer.Option(metavar="S", help="Silence of the hardware after which the actuators rest, s.")
    ] = 0.5,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Run directory; one in runs by default.")
    ] = None,
    printed: Printed = Printed(),
) -> None:
    """Fly a mission by the clock: paced, with measured jitter and overruns, for viewers and hardware.

    Example: seatrial realtime cwolf cwolf box.toml --live 8765

    The exit code is 0 when the mission was complete, 1 when not, 2 for bad input.
    """
    from seatrial.base.file_names import file_name
    from seatrial.base.run import check_writable
    from seatrial.cli.console import answer, print_json
    from seatrial.cli.streams import INTERRUPTED, note
    from seatrial.flight.conditions import Water
    from seatrial.realtime.flight import fly_realtime

    if out is not None:
        check_writable(out, "flight")

    def ready(port: int | None) -> None:
        if port is not None and not printed.json:
            note(f"Foxglove: open connection ws://127.0.0.1:{port}")

    flight = fly_realtime(
        vehicle,
        autopilot,
        mission,
        water=Water(current=current),
        conditions=aboard.conditions(),
        seed=seed,
        speed=speed,
        live_port=live,
        record=record,
        hardware=None if hardware is None else _address(hardware),
        watchdog_s=watchdog,
        ready=ready,
    )
    folder = out or Path("runs") / file_name(f"realtime-{flight.vehicle.name}")
    flight.save(folder)
    if printed.json:
        print_json(flight.to_dict() | {"run_directory": str(folder)})
    else:
        results = f"Results in {folder}: flight.json, flight.parquet, summary.txt and the inputs"
        answer(flight.report(), verbose=printed.verbose, results=results)
    if flight.outcome == "interrupted":
        raise typer.Exit(INTERRUPTED)
    if not flight.complete:
        raise typer.Exit(1)


def _address(text: str) -> tuple[str, int]:
    from seatrial.base.errors import SimulationError

    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise SimulationError(f"--hardware {text}: expected HOST:PORT, for example 192.168.2.2:14660")
    return host, int(port)
