"""`seatrial plan`: the next trials, and their command files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seatrial.base.errors import SeatrialError
from seatrial.base.files import check_place, file_name
from seatrial.cli.options import Shown, Threads, shared
from seatrial.vehicle.actuators import NOMINAL_V

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.campaign.campaign import Campaign
    from seatrial.experiment.fisher import Instruments
    from seatrial.experiment.forecast import Limits
    from seatrial.experiment.plan import Plan
    from seatrial.report.page.run_folder import RunFolder


@dataclass(frozen=True)
class Trials:
    """How many trials are planned, how long, and for what."""

    coefficients: Annotated[
        str | None, typer.Option(help="Coefficients to plan for, as K_p,K_pp; all by default.")
    ] = None
    duration: Annotated[float, typer.Option(min=10.0, max=86_400.0, help="Time for one trial, s.")] = 180.0
    count: Annotated[int, typer.Option(min=1, max=20, help="Trials to plan.")] = 3
    recorded: Annotated[bool, typer.Option(help="Count what a campaign's trials already determine.")] = True
    voltage: Annotated[float, typer.Option(min=0.1, help="Supply voltage for tables of thrust, V.")] = (
        NOMINAL_V
    )

    def paths(self, first: Path) -> list[Path]:
        """Command files of all trials, by that of the first."""
        later = [first.with_name(f"{first.stem}-{number}.csv") for number in range(2, self.count + 1)]
        return [first, *later]


@dataclass(frozen=True)
class Room:
    """Where the vehicle may go, and how far it may lean."""

    max_depth: Annotated[
        float | None, typer.Option(min=0.1, help="Depth of the water that may be used, m.")
    ] = None
    area: Annotated[str | None, typer.Option(help="Area that may be used, m: 80x40, or 50 for a square.")] = (
        None
    )
    max_tilt: Annotated[float, typer.Option(min=1.0, max=85.0, help="Largest heel and trim, deg.")] = 60.0

    def limits(self) -> Limits:
        """The limits that were asked for."""
        from seatrial.experiment.forecast import Limits

        return Limits(depth_m=self.max_depth, area_m=_area(self.area), tilt_deg=self.max_tilt)


@dataclass(frozen=True)
class Measured:
    """What is on board and how well it measures; the defaults are those of `Instruments.on_board`."""

    sensors: Annotated[
        str,
        typer.Option(
            help="What is on board, with its noise where known, m/s, deg/s, deg, m: dvl=0.02,gyro,depth."
        ),
    ] = "dvl,gyro,attitude,depth"
    current: Annotated[
        float, typer.Option(min=0.0, help="Standard deviation of an unknown current, m/s.")
    ] = 0.1

    def instruments(self) -> Instruments | None:
        """Instruments from ``dvl=0.02,gyro``; None for the usual ones."""
        from seatrial.experiment.fisher import Instruments

        if self == Measured():
            return None
        kinds: dict[str, float | None] = {}
        for part in _list(self.sensors) or []:
            kind, equals, value = part.partition("=")
            try:
                kinds[kind.strip()] = float(value) if equals else None
            except ValueError:
                raise SeatrialError(f"--sensors {part!r}: expected KIND or KIND=NOISE, as dvl=0.02") from None
        return Instruments.on_board(kinds, current_m_s=self.current)


@shared
def plan(
    target: Annotated[
        str,
        typer.Argument(help="Vehicle file, built-in vehicle, or campaign file.", metavar="VEHICLE|CAMPAIGN"),
    ],
    run: Annotated[
        Path | None,
        typer.Option(
            help="Run directory of `seatrial identify`, or a vehicle, at whose coefficients a campaign is"
            " planned; runs/NAME where that is one, else the campaign's start values."
        ),
    ] = None,
    trials: Trials = Trials(),
    room: Room = Room(),
    measured: Measured = Measured(),
    threads: Threads = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="Command file of the first trial, .csv; runs/plan-NAME/trial.csv by default."
        ),
    ] = None,
    output: Shown = Shown(),
) -> None:
    """Rank manoeuvres for the next trials, and write the best ones as command files, each with a sheet.

    Everything is simulated: open loop, on the model as it is, a campaign at what it identified. Plan again
    after each trial. Where waves and
    the autopilot hide a gain in a campaign's trials, a dither for the autopilot's output is written too.

    Example: seatrial plan vehicle.toml --duration 60 --count 3 --out next.csv
    """
    from seatrial.base.files import only_user
    from seatrial.cli.console import reported, say, search_progress
    from seatrial.experiment.plan import plan as planned

    # What was asked for is refused before anything is loaded.
    if out is not None:
        check_place(out, "--out", endings=(".csv",), folder_made=True)
    limits, instruments = room.limits(), measured.instruments()
    loaded, vehicle = _load(target)
    fit = _fit(loaded, run)
    first = out or Path("runs") / file_name(f"plan-{vehicle.name}") / "trial.csv"
    paths = trials.paths(first)
    for path in paths:
        check_place(path, "--out", inputs=_recordings(loaded), folder_made=True)
        check_place(path.with_suffix(".toml"), "--out", inputs={"the target": target}, folder_made=True)
    with only_user(first):  # another plan would write the same command files
        with search_progress("reading", quiet=output.json) as progress:
            result = planned(
                loaded,
                fit=fit,
                coefficients=_list(trials.coefficients),
                budget_s=trials.duration,
                count=trials.count,
                limits=limits,
                instruments=instruments,
                use_recorded=trials.recorded,
                voltage_v=trials.voltage,
                threads=threads,
                progress=progress,
            )
        written = [file for number, path in enumerate(paths, 1) for file in result.write(path, trial=number)]
        written += result.write_dithers(first.parent)
        output.show(
            result,
            {"files": [str(path) for path in written]},
            results=f"Commands and sheets in {first.parent}: {', '.join(path.name for path in written)}",
            draw=lambda: _drawn(result, vehicle, paths, trials.voltage, output.endings),
        )
        # A plan has no run directory: the page takes it as it is.
        if output.page is not None:
            reported(output.page, [_as_run(result, vehicle, first)], quiet=output.json)
        if not output.json and loaded is vehicle and result.sequence[0].manoeuvre.kind != "free decay":
            say(f"Try it:  seatrial simulate {target} {first}")


def _drawn(
    result: Plan, vehicle: Vehicle, paths: list[Path], voltage: float, endings: tuple[str, ...]
) -> list[Path]:
    """Paths of the figures of all trials, each beside its command file."""
    from seatrial.report.plot.recording import planned_trial
    from seatrial.report.plot.style import save

    return [
        figure
        for number, path in enumerate(paths, 1)
        if endings
        for figure in save(
            planned_trial(vehicle, result, trial=number, voltage_v=voltage),
            path.with_suffix(""),
            formats=endings,
        )
    ]


def _as_run(plan: Plan, vehicle: Vehicle, first: Path) -> RunFolder:
    """The plan as a page shows it: command files and figures need no run directory."""
    from seatrial.report.page.run_folder import RunFolder, figures_of

    return RunFolder(
        name=first.parent.name,
        facts=plan.facts,
        report=plan.report(),
        results=plan.to_dict(),
        files={"vehicle.toml": vehicle.to_toml()},
        figures=tuple(figure for figure in figures_of(first.parent) if figure.name.startswith(first.stem)),
    )


def _load(target: str) -> tuple[Vehicle | Campaign, Vehicle]:
    """What the target names, and its vehicle."""
    from seatrial._core import Vehicle
    from seatrial.cli.check import is_campaign

    if not is_campaign(target):
        vehicle = Vehicle.load(target)
        return vehicle, vehicle
    from seatrial.campaign.campaign import Campaign
    from seatrial.cli.console import reading_progress

    campaign = Campaign.load(target, progress=reading_progress())
    return campaign, campaign.vehicle


def _fit(loaded: Vehicle | Campaign, run: Path | None) -> Path | str | None:
    """Where a campaign's identified coefficients are, said on standard error where nobody named it."""
    from seatrial.campaign.campaign import Campaign
    from seatrial.cli.console import note
    from seatrial.cli.tune import fitted_source

    if not isinstance(loaded, Campaign):
        return run
    source = fitted_source(loaded, run)
    note(f"Coefficients: {source or 'start values of the campaign (no run directory of identify)'}")
    return source


def _recordings(loaded: Vehicle | Campaign) -> dict[str, str | Path | None]:
    """Files of a campaign's trials, by what they are."""
    from seatrial.campaign.campaign import Campaign

    if not isinstance(loaded, Campaign):
        return {}
    return {f"trial {name}": loaded.path_of(name) for name in loaded.trials}


def _list(text: str | None) -> list[str] | None:
    return None if text is None else [part.strip() for part in text.split(",") if part.strip()]


def _area(text: str | None) -> tuple[float, float] | None:
    """Two lengths from ``80x40`` or ``50``."""
    if text is None:
        return None
    try:
        sides = [float(part) for part in text.lower().replace("m", "").split("x")]
    except ValueError:
        sides = []
    if len(sides) not in (1, 2) or min(sides) <= 0.0:
        raise SeatrialError(f"--area {text!r}: expected two lengths in m, as 80x40, or one, as 50")
    return sides[0], sides[-1]
