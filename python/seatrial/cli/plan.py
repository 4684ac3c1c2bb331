"""`seatrial plan`: which trial to sail next, and its command file."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seatrial.check.actuators import NOMINAL_V

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.campaign import Campaign
    from seatrial.manoeuvre.fisher import Instruments

_LINE_EVERY_S = 5.0


def plan(
    target: Annotated[
        str,
        typer.Argument(help="Vehicle file, built-in vehicle, or campaign file.", metavar="VEHICLE|CAMPAIGN"),
    ],
    coefficients: Annotated[
        str | None, typer.Option(help="Those that count, as K_p,K_pp; all that are sought by default.")
    ] = None,
    duration: Annotated[float, typer.Option(min=10.0, help="Time for one trial, s.")] = 180.0,
    count: Annotated[int, typer.Option(min=1, max=20, help="Trials to plan.")] = 3,
    max_depth: Annotated[
        float | None, typer.Option(min=0.1, help="Depth of the water that may be used, m.")
    ] = None,
    area: Annotated[
        str | None, typer.Option(help="Area that may be used, m: 80x40, or 50 for a square.")
    ] = None,
    max_tilt: Annotated[float, typer.Option(min=1.0, max=85.0, help="Largest heel and trim, deg.")] = 60.0,
    sensors: Annotated[
        str,
        typer.Option(
            help="What is on board, with its noise where known, m/s, deg/s, deg, m: dvl=0.02,gyro,depth."
        ),
    ] = "dvl,gyro,attitude,depth",
    current: Annotated[
        float, typer.Option(min=0.0, help="Standard deviation of an unknown current, m/s.")
    ] = 0.1,
    recorded: Annotated[bool, typer.Option(help="Count what a campaign's trials already tell.")] = True,
    voltage: Annotated[
        float, typer.Option(min=0.1, help="Supply voltage for tables of thrust, V.")
    ] = NOMINAL_V,
    threads: Annotated[int | None, typer.Option(min=1, help="Threads; all processors by default.")] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="Command file of the first trial, .csv; runs/plan-NAME/trial.csv by default."
        ),
    ] = None,
    figures: Annotated[bool, typer.Option(help="Draw each trial (PNG and PDF).")] = True,
    json: Annotated[bool, typer.Option("--json", help="Print the plan as JSON.")] = False,
) -> None:
    """Rank which trial to sail next, and write the best ones as command files, each with a sheet.

    Everything is simulated: open loop, on the model as it is. Plan again after each trial.
    """
    from seatrial.cli.console import list_figures, output, print_json
    from seatrial.cli.plan_tables import print_plan
    from seatrial.errors import TrialError
    from seatrial.manoeuvre import Limits
    from seatrial.plan import plan as planned

    if out is not None and out.suffix != ".csv":
        raise TrialError(f'--out {out}: expected the ending .csv, found "{out.suffix}"')
    limits = Limits(depth_m=max_depth, area_m=_area(area), tilt_deg=max_tilt)
    instruments = _instruments(sensors, current)
    loaded, vehicle = _load(target)
    with _progress(quiet=json) as progress:
        found = planned(
            loaded,
            coefficients=_list(coefficients),
            budget_s=duration,
            count=count,
            limits=limits,
            instruments=instruments,
            use_recorded=recorded,
            voltage_v=voltage,
            threads=threads,
            progress=progress,
        )
    first = out or Path("runs") / f"plan-{found.vehicle}" / "trial.csv"
    written: list[Path] = []
    drawn: list[Path] = []
    for number in range(1, count + 1):
        path = first if number == 1 else first.with_name(f"{first.stem}-{number}.csv")
        written += found.write(path, trial=number)
        if figures:
            from seatrial.plot.planned_trial import planned_trial
            from seatrial.plot.style import save

            drawn += save(
                planned_trial(vehicle, found, trial=number, voltage_v=voltage), path.with_suffix("")
            )
    if json:
        print_json(found.to_dict() | {"files": [str(p) for p in written], "figures": [str(p) for p in drawn]})
        return
    console = output()
    print_plan(console, found)
    console.print(
        f"Commands and sheets in {first.parent}: {', '.join(path.name for path in written)}",
        soft_wrap=True,
        markup=False,
    )
    list_figures(console, drawn)
    if loaded is vehicle and found.sequence[0].manoeuvre.kind != "free decay":
        console.print(f"Try it:  seatrial simulate {target} {first}", soft_wrap=True, markup=False)


def _load(target: str) -> tuple[Vehicle | Campaign, Vehicle]:
    """What the target names, and its vehicle."""
    from seatrial._core import Vehicle
    from seatrial.cli.check import _is_campaign

    if not _is_campaign(target):
        vehicle = Vehicle.load(target)
        return vehicle, vehicle
    from seatrial.campaign import Campaign

    campaign = Campaign.load(target)
    return campaign, campaign.vehicle


def _list(text: str | None) -> list[str] | None:
    return None if text is None else [part.strip() for part in text.split(",") if part.strip()]


def _area(text: str | None) -> tuple[float, float] | None:
    """Two lengths from ``80x40`` or ``50``."""
    from seatrial.errors import SeatrialError

    if text is None:
        return None
    try:
        sides = [float(part) for part in text.lower().replace("m", "").split("x")]
    except ValueError:
        sides = []
    if len(sides) not in (1, 2) or min(sides) <= 0.0:
        raise SeatrialError(f"--area {text!r}: expected two lengths in m, as 80x40, or one, as 50")
    return sides[0], sides[-1]


def _instruments(text: str, current: float) -> Instruments:
    """Instruments from ``dvl=0.02,gyro``."""
    from seatrial.errors import SeatrialError
    from seatrial.manoeuvre.fisher import Instruments

    kinds: dict[str, float | None] = {}
    for part in _list(text) or []:
        kind, equals, value = part.partition("=")
        try:
            kinds[kind.strip()] = float(value) if equals else None
        except ValueError:
            raise SeatrialError(f"--sensors {part!r}: expected KIND or KIND=NOISE, as dvl=0.02") from None
    return Instruments.on_board(kinds, current_m_s=current)


@contextmanager
def _progress(*, quiet: bool) -> Iterator[Callable[[float, str], None] | None]:
    """Callback that shows how far the plan is: a bar on a terminal, a line every few seconds elsewhere."""
    if quiet:
        yield None
    elif not sys.stderr.isatty():
        last = time.monotonic()

        def line(fraction: float, words: str) -> None:
            nonlocal last
            if time.monotonic() - last >= _LINE_EVERY_S:
                last = time.monotonic()
                print(f"{100 * fraction:3.0f} %  {words}", file=sys.stderr, flush=True)

        yield line
    else:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

        columns = (TextColumn("{task.description}"), BarColumn(bar_width=24), TaskProgressColumn())
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task("reading", total=1.0)
            yield lambda fraction, words: bar.update(task, completed=fraction, description=words)
