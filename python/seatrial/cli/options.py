"""Options that several verbs share, and where an option went that moved.

A parameter of a verb that is annotated with `Output` or `Computing` stands for all options of that class:
`shared` gives them to the verb one by one, and the verb takes the object. Held by ``tests/cli/test_cli.py``.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from enum import StrEnum
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from seatrial.cli.report import Page

if TYPE_CHECKING:
    from seatrial.base.work import Work
    from seatrial.flight.conditions import Conditions, Water


class FigureFormat(StrEnum):
    """Figures of a run directory."""

    PNG = "png"
    PDF = "pdf"
    NONE = "none"

    def endings(self, page: Path | None = None) -> tuple[str, ...]:
        """Endings of the files: PNG, with PDF beside it, or none; SVG too where a page is written."""
        if self is FigureFormat.NONE:
            return ()
        return ("png", *(("pdf",) if self is FigureFormat.PDF else ()), *(() if page is None else ("svg",)))


Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]

Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Print all tables and remarks.")]

Figures = Annotated[FigureFormat, typer.Option(help="Figures: PNG, PDF beside it, or none.")]

Threads = Annotated[
    int | None,
    typer.Option(min=1, max=1024, help="Threads; all processors by default, with --dask one per worker."),
]

Dask = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Work on the Dask cluster with this scheduler (tcp://HOST:8786); local or local:N starts N"
        " worker processes on this machine. Connections run code: use loopback or TLS.",
    ),
]


@dataclass(frozen=True)
class Printed:
    """What a verb prints."""

    verbose: Verbose = False
    json: Json = False


@dataclass(frozen=True)
class Shown(Printed):
    """What a verb prints and draws."""

    figures: Figures = FigureFormat.PNG
    page: Page = None

    @property
    def endings(self) -> tuple[str, ...]:
        """Endings of the figures; none without figures."""
        return self.figures.endings(self.page)


@dataclass(frozen=True)
class Output(Shown):
    """What a verb prints, draws and writes."""

    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Run directory; one in runs by default.")
    ] = None


@dataclass(frozen=True)
class Computing:
    """On what a verb computes, and whether it goes on where an earlier run ended."""

    resume: Annotated[bool, typer.Option(help="Reuse what an earlier run finished from the same inputs.")] = (
        True
    )
    threads: Threads = None
    dask: Dask = None

    @contextmanager
    def work(self, folder: Path | None, first: str, *, quiet: bool) -> Iterator[Work]:
        """Work of a run into a folder, with progress on standard error; `first` stands before that."""
        from seatrial.base.work import Work
        from seatrial.cli.console import search_progress, workers

        with workers(self.dask) as fleet, search_progress(first, quiet=quiet) as progress:
            yield Work(
                threads=self.threads, executor=fleet, run_dir=folder, resume=self.resume, progress=progress
            )


_Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Sea:
    """Water of a flight."""

    current: Annotated[_Triple, typer.Option(metavar="NORTH EAST DOWN", help="Velocity, m/s.")] = (
        0.0,
        0.0,
        0.0,
    )
    turbulence: Annotated[
        float, typer.Option(metavar="M_S", min=0.0, help="Standard deviation, north and east, m/s.")
    ] = 0.0
    current_trend: Annotated[
        _Triple, typer.Option(metavar="NORTH EAST DOWN", help="Steady change of the current in an hour, m/s.")
    ] = (0.0, 0.0, 0.0)
    current_walk: Annotated[
        float,
        typer.Option(
            metavar="M_S", min=0.0, help="Standard deviation of its random walk after an hour, m/s."
        ),
    ] = 0.0
    waves: Annotated[
        _Triple | None,
        typer.Option(
            metavar="HEIGHT PERIOD TOWARD",
            help="Significant height, m, peak period, s, direction, degrees from north over east.",
        ),
    ] = None
    seabed: Annotated[float | None, typer.Option(metavar="DEPTH", help="Depth of the bottom, m.")] = None

    def water(self) -> Water:
        """The water that was asked for."""
        from seatrial.flight.conditions import Water
        from seatrial.flight.sea import SeaState

        return Water(
            current=self.current,
            turbulence=self.turbulence,
            current_trend=self.current_trend,
            current_walk=self.current_walk,
            waves=None if self.waves is None else SeaState(*self.waves),
            seabed=self.seabed,
        )


@dataclass(frozen=True)
class Aboard:
    """Sensors and supply of a flight, and how long it may take."""

    sensors: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="Sensors of the vehicle, or: typical. Perfect ones when missing."),
    ] = None
    model: Annotated[
        str | None, typer.Option(help="Vehicle that the autopilot believes in, if it is another.")
    ] = None
    voltage: Annotated[float | None, typer.Option(help="Supply, V, where thrust depends on it.")] = None
    feedback: Annotated[bool, typer.Option(help="The autopilot sees what its actuators do.")] = True
    max_time: Annotated[
        float | None,
        typer.Option(help="Longest duration, s; three times the planned one and five minutes by default."),
    ] = None

    def conditions(self, **more: Any) -> Conditions:
        """The conditions that were asked for, and more of them."""
        from seatrial.flight.conditions import Conditions

        return Conditions(
            sensors=self.sensors,
            model=self.model,
            voltage_v=self.voltage,
            feedback=self.feedback,
            max_time_s=self.max_time,
            **more,
        )


_SHARED = (Printed, Shown, Output, Computing, Sea, Aboard)


def shared(verb: Callable[..., None]) -> Callable[..., None]:
    """The verb with the options of every parameter that stands for several."""
    hints = get_type_hints(verb, include_extras=True)
    groups = {name: kind for name, kind in hints.items() if kind in _SHARED}
    parameters: list[inspect.Parameter] = []
    for name, parameter in inspect.signature(verb).parameters.items():
        kind = groups.get(name)
        if kind is None:
            parameters.append(parameter.replace(annotation=hints[name]))
            continue
        annotations = get_type_hints(kind, include_extras=True)
        parameters += [
            inspect.Parameter(
                field.name,
                inspect.Parameter.KEYWORD_ONLY,
                default=field.default,
                annotation=annotations[field.name],
            )
            for field in fields(kind)
        ]

    @wraps(verb)
    def expanded(**options: Any) -> None:
        objects = {
            name: kind(**{field.name: options.pop(field.name) for field in fields(kind)})
            for name, kind in groups.items()
        }
        verb(**options, **objects)

    # Keyword-only, so that an option without a default may follow one that has it.
    own = [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in parameters]
    expanded.__dict__["__signature__"] = inspect.Signature(own)
    expanded.__annotations__ = {parameter.name: parameter.annotation for parameter in own} | {"return": None}
    return expanded


_MOVED = {
    ("", "--no-figures"): "--figures none",
    ("", "--pdf"): "--figures pdf",
    ("fly", "--realtime"): "`seatrial realtime VEHICLE AUTOPILOT MISSION`",
    ("fly", "--speed"): "`seatrial realtime VEHICLE AUTOPILOT MISSION --speed`",
    ("fly", "--live"): "`seatrial realtime VEHICLE AUTOPILOT MISSION --live`",
    ("fly", "--record"): "`seatrial realtime VEHICLE AUTOPILOT MISSION --record`",
    ("fly", "--hardware"): "`seatrial realtime VEHICLE AUTOPILOT MISSION --hardware`",
    ("fly", "--watchdog"): "`seatrial realtime VEHICLE AUTOPILOT MISSION --watchdog`",
    ("verify", "--log"): "`seatrial verify-log CAMPAIGN LOG`",
    ("verify", "--reference"): "`seatrial verify-log CAMPAIGN LOG --reference`",
    ("verify", "--rare"): "`seatrial rare CAMPAIGN`",
    ("verify", "--population"): "`seatrial rare CAMPAIGN --population`",
    ("verify", "--falsify"): "`seatrial falsify CAMPAIGN`",
    ("verify", "--within"): "`seatrial falsify CAMPAIGN --within`",
    ("verify", "--boundary"): "`seatrial boundary CAMPAIGN NAME=FROM:TO`",
    ("verify", "--requirement"): "`seatrial rare`, `falsify` or `boundary` with --requirement",
}
"""Verb (all where it is empty) and option, and what to call in its place."""


def moved(verb: str, option: str) -> str:
    """A sentence on an option that moved; empty where it did not."""
    there = _MOVED.get((verb, option)) or _MOVED.get(("", option))
    return "" if there is None else f"{option}: no option of {verb}; use {there}"
