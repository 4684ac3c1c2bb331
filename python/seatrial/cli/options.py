"""Options that several verbs share, how a verb shows what came out, and where an option went that moved.

A parameter of a verb that is annotated with a class of options, such as `Output`, stands for all of them:
`shared` gives them to the verb one by one, and the verb takes the object. Held by ``tests/cli/test_cli.py``.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from enum import StrEnum
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

if TYPE_CHECKING:
    from seatrial.base.report import Report
    from seatrial.base.work import Work
    from seatrial.flight.conditions import Conditions, Water


def page_place(given: Path | None) -> Path | None:
    """The page to be, refused at once where it cannot be written."""
    if given is not None:
        from seatrial.report.page.page import check_place

        check_place(given)
    return given


class FigureFormat(StrEnum):
    """Figures of a run directory."""

    PNG = "png"
    PDF = "pdf"
    NONE = "none"


Triple = tuple[float, float, float]

STILL: Triple = (0.0, 0.0, 0.0)
"""Water that does not move, m/s."""

Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]

Out = Annotated[Path | None, typer.Option("--out", "-o", help="Run directory; one in runs by default.")]

Run = Annotated[
    Path | None,
    typer.Option(
        "--run",
        help="Run directory of `seatrial identify`, or a vehicle; runs/NAME where that is one, else the"
        " campaign's own vehicle.",
    ),
]

Resume = Annotated[bool, typer.Option(help="Reuse what an earlier run finished from the same inputs.")]

Threads = Annotated[
    int | None,
    typer.Option(min=1, max=1024, help="Threads; all processors by default, with --dask one per worker."),
]

Voltage = Annotated[float | None, typer.Option(help="Supply, V, where thrust depends on it.")]

Sensors = Annotated[
    str | None,
    typer.Option(metavar="FILE", help="Sensors of the vehicle, or: typical. Perfect ones when missing."),
]

Navigation = Annotated[
    str,
    typer.Option(
        metavar="sensors|filter",
        help="What the autopilot uses: what the sensors show, or the estimate of a navigation filter.",
    ),
]


@dataclass(frozen=True)
class Printed:
    """What a verb prints."""

    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Print all tables and remarks.")] = False
    json: Json = False

    def show(
        self,
        result: Any,
        facts: dict[str, Any] | None = None,
        *,
        report: Report | None = None,
        results: str | Callable[[], str] = "",
        draw: Callable[[], Sequence[Path]] | None = None,
    ) -> None:
        """Print a result, as its report or as JSON with further facts and the figures' paths.

        `results` says where files are, or writes them and says so; `draw` writes the figures.
        """
        from seatrial.cli.console import answer, print_json

        if not self.json:
            answer(report or result.report(), verbose=self.verbose, results=results, draw=draw)
            return
        if callable(results):
            results()
        figures = {} if draw is None else {"figures": [str(path) for path in draw()]}
        print_json(result.to_dict() | (facts or {}) | figures)


@dataclass(frozen=True)
class Drawn(Printed):
    """What a verb prints and draws."""

    figures: Annotated[FigureFormat, typer.Option(help="Figures: PNG, PDF beside it, or none.")] = (
        FigureFormat.PNG
    )

    @property
    def endings(self) -> tuple[str, ...]:
        """Endings of the figures: PNG, with PDF beside it, or none."""
        return {"png": ("png",), "pdf": ("png", "pdf"), "none": ()}[self.figures]

    def draw(self, result: object, folder: Path) -> list[Path]:
        """Paths of a result's figures, drawn into a folder; of none that was interrupted."""
        from seatrial.report.plot import gallery

        interrupted = getattr(result, "interrupted", False)
        return [] if interrupted else gallery(result, folder, formats=self.endings)


@dataclass(frozen=True)
class Shown(Drawn):
    """What a verb prints, draws and writes as a page."""

    page: Annotated[
        Path | None,
        typer.Option(
            "--report",
            metavar="FILE.html",
            callback=page_place,
            help="Write the run as one HTML file too, with its figures as SVG.",
        ),
    ] = None

    @property
    def endings(self) -> tuple[str, ...]:
        """Endings of the figures; SVG too where a page is written."""
        drawn = super().endings
        return (*drawn, "svg") if drawn and self.page is not None else drawn


@dataclass(frozen=True)
class Output(Shown):
    """What a verb prints, draws and writes, and where."""

    out: Out = None

    def show_run(
        self, result: Any, folder: Path, files: str, *, drawn: bool = True, page: bool = True, **shown: Any
    ) -> None:
        """Show a result as `show` does, with the files of its run directory, its figures and its page."""
        from seatrial.cli.console import reported

        if drawn:
            shown.setdefault("draw", partial(self.draw, result, folder / "figures"))
        results = f"Results in {folder}: {files}" if files else ""
        self.show(result, {"run_directory": str(folder)}, results=results, **shown)
        if page:
            reported(self.page, [folder], quiet=self.json)


def end(*, interrupted: bool = False, held: bool = True) -> None:
    """Leave the verb with 130 after Ctrl-C, with 1 where a verdict is not held."""
    from seatrial.cli.console import Code

    if interrupted or not held:
        raise typer.Exit(Code.INTERRUPTED if interrupted else Code.NOT_HELD)


@dataclass(frozen=True)
class Computing:
    """On what a verb computes, and whether it goes on where an earlier run ended."""

    resume: Resume = True
    threads: Threads = None
    dask: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Work on the Dask cluster with this scheduler (tcp://HOST:8786); local or local:N starts N"
            " worker processes on this machine. Connections run code: use loopback or TLS.",
        ),
    ] = None

    @contextmanager
    def work(self, folder: Path | None, first: str, *, quiet: bool) -> Iterator[Work]:
        """Work of a run into a folder, with progress on standard error; `first` stands before that."""
        from seatrial.base.work import Work
        from seatrial.cli.console import search_progress, workers

        with workers(self.dask) as fleet, search_progress(first, quiet=quiet) as progress:
            yield Work(
                threads=self.threads, executor=fleet, run_dir=folder, resume=self.resume, progress=progress
            )


@dataclass(frozen=True)
class Sea:
    """Water of a flight."""

    current: Annotated[Triple, typer.Option(metavar="NORTH EAST DOWN", help="Velocity, m/s.")] = STILL
    turbulence: Annotated[
        float, typer.Option(metavar="M_S", min=0.0, help="Standard deviation, north and east, m/s.")
    ] = 0.0
    current_trend: Annotated[
        Triple, typer.Option(metavar="NORTH EAST DOWN", help="Steady change of the current in an hour, m/s.")
    ] = STILL
    current_walk: Annotated[
        float,
        typer.Option(
            metavar="M_S", min=0.0, help="Standard deviation of its random walk after an hour, m/s."
        ),
    ] = 0.0
    waves: Annotated[
        Triple | None,
        typer.Option(
            metavar="HEIGHT PERIOD TOWARD",
            help="Significant height, m, peak period, s, direction, degrees from north over east.",
        ),
    ] = None
    seabed: Annotated[float | None, typer.Option(metavar="DEPTH", help="Depth of the bottom, m.")] = None

    def water(self) -> Water:
        """The water that was asked for."""
        from seatrial.flight.conditions import Water
        from seatrial.flight.disturbances import SeaState

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

    sensors: Sensors = None
    model: Annotated[
        str | None, typer.Option(help="Vehicle that the autopilot believes in, if it is another.")
    ] = None
    voltage: Voltage = None
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


def shared(verb: Callable[..., None]) -> Callable[..., None]:
    """The verb with the options of every parameter that stands for several."""
    hints = get_type_hints(verb, include_extras=True)
    groups: dict[str, Any] = {name: kind for name, kind in hints.items() if is_dataclass(kind)}
    parameters: list[inspect.Parameter] = []
    for name, parameter in inspect.signature(verb).parameters.items():
        kind = groups.get(name)
        # A plain option stays as it is; a class of options gives each of its fields.
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
    **{
        ("fly", option): f"`seatrial realtime VEHICLE AUTOPILOT MISSION {option}`"
        for option in ("--speed", "--live", "--record", "--hardware", "--watchdog")
    },
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
