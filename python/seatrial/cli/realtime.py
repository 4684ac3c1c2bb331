"""`seatrial fly --realtime`: a flight by the clock, live in Foxglove, with hardware in the loop."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

Realtime = Annotated[
    bool, typer.Option("--realtime", help="Fly by the clock: paced, with measured jitter and overruns.")
]

Speed = Annotated[float, typer.Option(help="With --realtime: seconds of motion per second of the clock.")]

LivePort = Annotated[
    int | None,
    typer.Option(
        "--live",
        metavar="PORT",
        min=0,
        max=65535,
        help="With --realtime: WebSocket for Foxglove on this machine (8765 is Foxglove's own default).",
    ),
]

Record = Annotated[
    Path | None, typer.Option(metavar="FILE.mcap", help="With --realtime: record what is shown.")
]

Hardware = Annotated[
    str | None,
    typer.Option(
        metavar="HOST:PORT", help="With --realtime: UDP address of autopilot hardware that steers instead."
    ),
]

Watchdog = Annotated[
    float, typer.Option(metavar="S", help="With --hardware: silence after which the actuators rest, s.")
]


def fly_by_the_clock(
    sources: tuple[str, str, str],
    *,
    hardware: str | None,
    out: Path | None,
    verbose: bool,
    json: bool,
    refused: dict[str, Any],
    **options: Any,
) -> None:
    """Fly by the clock and say how it kept time; exit code 1 when the mission was not complete.

    Parameters
    ----------
    sources
        Vehicle, autopilot and mission.
    hardware
        Address of hardware.
    out
        Run directory.
    verbose, json
        As for other verbs.
    refused
        Options that a flight by the clock does not have, and whether they were given.
    options
        Of `seatrial.realtime.flight.fly_realtime`.
    """
    from seatrial.base.errors import SimulationError
    from seatrial.base.file_names import file_name
    from seatrial.base.run import check_writable
    from seatrial.cli.console import answer, print_json
    from seatrial.cli.streams import INTERRUPTED, note
    from seatrial.realtime.flight import fly_realtime

    given = [name for name, value in refused.items() if value]
    if given:
        raise SimulationError(
            f"--realtime: {', '.join(given)} cannot be flown by the clock; leave it out, or fly without"
            " --realtime"
        )
    if out is not None:
        check_writable(out, "flight")

    def ready(port: int | None) -> None:
        if port is not None and not json:
            note(f"Foxglove: open connection ws://127.0.0.1:{port}")

    flight = fly_realtime(
        *sources, hardware=None if hardware is None else _address(hardware), ready=ready, **options
    )
    folder = out or Path("runs") / file_name(f"realtime-{flight.vehicle.name}")
    flight.save(folder)
    if json:
        print_json(flight.to_dict() | {"run_directory": str(folder)})
    else:
        results = f"Results in {folder}: flight.json, flight.parquet, summary.txt and the inputs"
        answer(flight.report(), verbose=verbose, results=results)
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
