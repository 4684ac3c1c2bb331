"""Tables of a plan for who sails it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.cli.console import table
from seatrial.recording.columns import DEGREE

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from seatrial.planned import Plan, Ranked

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
