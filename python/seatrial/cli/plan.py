"""`seatrial plan`: which trial to sail next, and its command file.

Tables of a plan for who sails it.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seatrial.base.channels import DEGREE
from seatrial.cli.console import table
from seatrial.vehicle.actuators import NOMINAL_V

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from seatrial._core import Vehicle
    from seatrial.campaign.campaign import Campaign
    from seatrial.experiment.fisher import Instruments
    from seatrial.experiment.plan_result import Plan, Ranked

__all__ = ["plan", "print_plan"]


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
    from seatrial.base.errors import TrialError
    from seatrial.cli.console import list_figures, output, print_json, search_progress
    from seatrial.experiment.forecast import Limits
    from seatrial.experiment.plan import plan as planned

    if out is not None and out.suffix != ".csv":
        raise TrialError(f'--out {out}: expected the ending .csv, found "{out.suffix}"')
    limits = Limits(depth_m=max_depth, area_m=_area(area), tilt_deg=max_tilt)
    instruments = _instruments(sensors, current)
    loaded, vehicle = _load(target)
    with search_progress("reading", quiet=json) as progress:
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
            from seatrial.report.plot.planned_trial import planned_trial
            from seatrial.report.plot.style import save

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
    from seatrial.campaign.campaign import Campaign

    campaign = Campaign.load(target)
    return campaign, campaign.vehicle


def _list(text: str | None) -> list[str] | None:
    return None if text is None else [part.strip() for part in text.split(",") if part.strip()]


def _area(text: str | None) -> tuple[float, float] | None:
    """Two lengths from ``80x40`` or ``50``."""
    from seatrial.base.errors import SeatrialError

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
    from seatrial.base.errors import SeatrialError
    from seatrial.experiment.fisher import Instruments

    kinds: dict[str, float | None] = {}
    for part in _list(text) or []:
        kind, equals, value = part.partition("=")
        try:
            kinds[kind.strip()] = float(value) if equals else None
        except ValueError:
            raise SeatrialError(f"--sensors {part!r}: expected KIND or KIND=NOISE, as dvl=0.02") from None
    return Instruments.on_board(kinds, current_m_s=current)


_HEAD = ("thrust", "sailed", "area, m", "to depth, m", "score", "tells most of")

_OTHERS = 6

_WORTH = 0.99

_MOST_REFUSED = 4

_UNKNOWN, _BETTER = 0.5, 0.9


def print_plan(console: Console, found: Plan) -> None:
    """Print the trials in their order, what each takes and tells, the other candidates, what was assumed."""
    basis = "bounds and recorded trials" if found.recorded else "the bounds only, nothing recorded"
    console.print(
        f"[bold]{found.vehicle}[/bold]: {len(found.coefficients)} coefficients sought; known so far: {basis}",
        soft_wrap=True,
    )
    head = ["trial", "manoeuvre", *_HEAD]
    rows = [["", "so far", "", "", "", "", _number(found.score_before), ""]]
    rows += [[str(number), *_trial(one)] for number, one in enumerate(found.sequence, 1)]
    console.print()
    title = (
        f"Next trials of {found.budget_s:g} s, in this order (score: sum of relative std. deviations left)"
    )
    console.print(table(title, head, rows, left=2))
    if found.staircases_score is not None:
        console.print(
            f"The same time in staircases alone would leave {_number(found.staircases_score)} instead of"
            f" {_number(found.score_after)}.",
            soft_wrap=True,
        )
    for number, one in enumerate(found.sequence, 1):
        console.print(f"\n[bold]Trial {number}[/bold]: {one.manoeuvre.words}.", soft_wrap=True)
        console.print(
            f"  Start {one.manoeuvre.start.words}, O {one.forecast.start_depth_m:.1f} m deep or deeper;"
            f" {_times(one)}; speed to {one.forecast.speed_m_s:.1f} m/s,"
            f" heel to {one.forecast.roll_deg:.0f}, trim to {one.forecast.pitch_deg:.0f} deg.",
            soft_wrap=True,
            markup=False,
        )
        for warning in one.forecast.warnings:
            console.print(f"  WARNING: {warning}", soft_wrap=True, markup=False, style="yellow")
    console.print()
    console.print(_precision(found))
    _print_rest(console, found)
    console.print(_assumed(found), soft_wrap=True, markup=False)


def _print_rest(console: Console, found: Plan) -> None:
    """Other manoeuvres, those that do not fit, what stays unknown."""
    chosen = found.sequence[0].manoeuvre
    others, seen = [], {chosen.name}
    for one in found.ranking:
        if one.manoeuvre.name not in seen and one.score < _WORTH * found.score_before:
            seen.add(one.manoeuvre.name)
            others.append(_trial(one, names=2))
    if others:
        head = ["instead of trial 1", *_HEAD]
        console.print(table(f"The best of {len(others)} others", head, others[:_OTHERS], left=1))
    for line in _still_unknown(found):
        console.print(line, soft_wrap=True, markup=False)
    refused = list(found.refused.items())
    if refused:
        words = "; ".join(f"{name}: {reason}" for name, reason in refused[:_MOST_REFUSED])
        more = f"; and {len(refused) - _MOST_REFUSED} more" if len(refused) > _MOST_REFUSED else ""
        console.print(f"Left out, even at its smallest: {words}{more}", soft_wrap=True, markup=False)


def _still_unknown(found: Plan) -> list[str]:
    """What stays unknown after the trials, and which manoeuvre would show it best."""
    groups: dict[str, list[str]] = {}
    for change in found.coefficients:
        if change.relative_after <= _UNKNOWN:
            continue
        best, left = "", change.relative_after
        for one in found.ranking:
            after = next(gain.relative_after for gain in one.gains if gain.name == change.name)
            if after < _BETTER * left:
                best, left = one.manoeuvre.name, after
        groups.setdefault(best, []).append(f"{change.name} ({_percent(left)} %)" if best else change.name)
    return [
        f"Still unknown to more than {100 * _UNKNOWN:.0f} %, {_shown_by(best)}: {', '.join(names)}"
        for best, names in groups.items()
    ]


def _shown_by(best: str) -> str:
    return f"best shown by {best}" if best else "shown better by no manoeuvre that fits"


def _assumed(found: Plan) -> str:
    """What the standard deviations rest on."""
    groups: dict[str, list[str]] = {}
    for channel, noise in found.instruments.noise.items():
        angle = channel in ("p", "q", "r", "roll", "pitch", "yaw")
        unit = ("deg" if angle else "m") + ("/s" if channel in "uvwpqr" else "")
        groups.setdefault(f"{noise / DEGREE if angle else noise:.3g} {unit}", []).append(channel)
    sizes = ", ".join(f"{' '.join(channels)} {size}" for size, channels in groups.items())
    return (
        f"Assumed: noise of {sizes}; one sample per {found.instruments.correlation_s:.2g} s counts; unknown"
        f" current {found.instruments.current_m_s:g} m/s; the model as it is."
    )


def _trial(one: Ranked, *, names: int = 3) -> list[str]:
    """Cells of a trial: name, thrust, times, area, depth, score, what it tells."""
    seen = one.forecast
    return [
        one.manoeuvre.name,
        f"{100 * one.amplitude:.0f} %" if one.amplitude else "none",
        _times(one),
        f"{seen.along_m:.0f} x {seen.across_m:.0f}",
        f"{seen.deepest_m:.0f}",
        _number(one.score),
        ", ".join(change.name for change in one.gains[:names]),
    ]


def _times(one: Ranked) -> str:
    return (
        f"{one.repeats} x {one.manoeuvre.duration_s:.0f} s"
        if one.repeats > 1
        else f"{one.manoeuvre.duration_s:.0f} s"
    )


def _precision(found: Plan) -> Table:
    """Relative standard deviation of every coefficient, before and after each trial."""
    after = [{change.name: change for change in one.gains} for one in found.sequence]
    rows = [
        [
            change.name,
            change.unit,
            f"{change.value:.4g}",
            _percent(change.relative_before),
            *(_percent(one[change.name].relative_after) for one in after),
        ]
        for change in found.coefficients
    ]
    head = [
        "coefficient",
        "unit",
        "value",
        "so far",
        *(f"after {number}" for number in range(1, len(after) + 1)),
    ]
    return table("Standard deviations, per cent of the value", head, rows, left=2)


def _percent(share: float) -> str:
    """A share in per cent with two digits."""
    return f"{100.0 * share:.0f}" if share >= 0.1 else f"{100.0 * share:.2g}"


def _number(value: float) -> str:
    return f"{value:.3g}"
