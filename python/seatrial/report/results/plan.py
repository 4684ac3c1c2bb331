"""The words of planned and of simulated trials: manoeuvres, what they tell, how far and fast a run went.

Held by ``tests/experiment/test_plan.py`` and ``tests/trial/test_simulation.py``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import singledispatch

from seatrial.base.channels import DEGREE
from seatrial.base.finding import Finding
from seatrial.base.report import Report, Section, Table
from seatrial.experiment.plan import IDENTIFIED, PLAN_SETTINGS, START, VEHICLE, Plan, Ranked
from seatrial.trial.simulation import SETTINGS as SIMULATION_SETTINGS
from seatrial.trial.simulation import SimulatedTrial

_AT = {
    VEHICLE: "",
    IDENTIFIED: "; planned at the identified coefficients",
    START: "; planned at the campaign's start values, not at identified coefficients",
}


_HEAD = ("thrust", "run", "area, m", "to depth, m", "score", "determines best")


@dataclass(frozen=True)
class PlanWordsSettings:
    """How much of a plan is listed, and which gain counts."""

    others: int = 6  #: Rows of a table beside the plan's own.
    worth: float = 0.99  #: Share of the score without a trial; what leaves more gains nothing.
    most_refused: int = 4  #: Names that a sentence lists.


SETTINGS = PlanWordsSettings()


@singledispatch
def report(result: object) -> Report:
    """Report of a plan, or of a simulated trial."""
    raise TypeError(f"expected a plan or a simulated trial, found {type(result).__name__}")


@report.register
def _plan(plan: Plan) -> Report:
    """Three lines, the manoeuvres and what they are expected to tell."""
    first, count = plan.sequence[0].manoeuvre, len(plan.sequence)
    unknown = _still_unknown(plan)
    basis = (
        "bounds and recorded trials, with sensor noise as the only error"
        if plan.recorded
        else "the bounds only, nothing recorded"
    )
    return Report(
        title=plan.vehicle,
        outcome=f"{count} {'trial' if count == 1 else 'trials'} planned",
        good=(
            f"{'it reduces' if count == 1 else 'they reduce'} the sum of the relative standard deviations of"
            f" {len(plan.coefficients)} coefficients from {_number(plan.score_before)} to"
            f" {_number(plan.score_after)}; known so far: {basis}{_AT[plan.at]}"
        ),
        worst=unknown[0]
        if unknown
        else f"no coefficient stays unknown to more than {100 * PLAN_SETTINGS.unknown_sd:.0f} %",
        next_step=(
            "identify first (seatrial identify) and plan again: at the identified coefficients a forecast is"
            f" nearer to what a trial gives; otherwise run trial 1 ({first.name})"
            if plan.at == START and plan.recorded
            else f"run trial 1 ({first.name}), identify again, and plan again"
        ),
        sections=(
            Section(tables=(_trials(plan),), sentences=tuple(_sheets(plan))),
            *([Section(sentences=tuple(_on_top(plan)))] if plan.dithers else []),
            Section(tables=(_precision(plan),), sentences=tuple(unknown)),
            Section(tables=(_others(plan),), sentences=tuple(_rest(plan)), details=True),
        ),
    )


def _trials(plan: Plan) -> Table:
    rows = [["", "so far", "", "", "", "", _number(plan.score_before), ""]]
    rows += [[str(number), *_cells(ranked)] for number, ranked in enumerate(plan.sequence, 1)]
    title = f"Next trials of {plan.budget_s:g} s, in this order (score: sum of relative std. deviations left)"
    return Table.of(title, ["trial", "manoeuvre", *_HEAD], rows, left=2)


def _sheets(plan: Plan) -> Iterator[str]:
    """How each trial is run, and what it may bring about."""
    for number, ranked in enumerate(plan.sequence, 1):
        start = (
            f"start {ranked.manoeuvre.start.words}, O {ranked.forecast.start_depth_m:.1f} m deep or deeper"
        )
        yield (
            f"Trial {number}: {ranked.manoeuvre.words}; {start}; {_times(ranked)}; speed to"
            f" {ranked.forecast.speed_m_s:.1f} m/s, heel to {ranked.forecast.roll_deg:.0f}, trim to"
            f" {ranked.forecast.pitch_deg:.0f} deg."
        )
        yield from (f"WARNING: trial {number}: {warning}" for warning in ranked.forecast.warnings)


def _on_top(plan: Plan) -> Iterator[str]:
    """What to add to the autopilot's output where feedback dominates an axis."""
    for dither in plan.dithers:
        yield f"With the autopilot on, {dither.sentence}. Table: {dither.file_name}."


def _precision(plan: Plan) -> Table:
    """Standard deviation of every coefficient, before and after each trial."""
    after = [{change.name: change for change in ranked.gains} for ranked in plan.sequence]
    rows = [
        [
            change.name,
            change.unit,
            f"{change.value:.4g}",
            change.told(change.before),
            *(change.told(changes[change.name].after) for changes in after),
        ]
        for change in plan.coefficients
    ]
    numbered = (f"after {number}" for number in range(1, len(after) + 1))
    head = ["coefficient", "unit", "value", "so far", *numbered]
    zero = "" if all(change.of_value for change in plan.coefficients) else "; where it is zero, in its unit"
    return Table.of(f"Standard deviations in per cent of the value{zero}", head, rows, left=2)


def _others(plan: Plan) -> Table:
    """The best manoeuvres instead of the first one, those that leave less than what is known already."""
    others, seen = [], {plan.sequence[0].manoeuvre.name}
    for ranked in plan.ranking:
        if ranked.manoeuvre.name not in seen and ranked.score < SETTINGS.worth * plan.score_before:
            seen.add(ranked.manoeuvre.name)
            others.append(_cells(ranked, names=2))
    title = f"The best of {len(others)} others"
    return Table.of(title, ["instead of trial 1", *_HEAD], others[: SETTINGS.others])


def _rest(plan: Plan) -> Iterator[str]:
    """The same time in staircases, manoeuvres that do not fit, what was assumed."""
    if plan.staircases_score is not None:
        yield (
            f"The same time in staircases alone would leave {_number(plan.staircases_score)} instead of"
            f" {_number(plan.score_after)}."
        )
    refused = list(plan.refused.items())
    if refused:
        words = "; ".join(f"{name}: {reason}" for name, reason in refused[: SETTINGS.most_refused])
        more = (
            f"; and {len(refused) - SETTINGS.most_refused} more"
            if len(refused) > SETTINGS.most_refused
            else ""
        )
        yield f"Left out, even at its smallest: {words}{more}"
    groups: dict[str, list[str]] = {}
    for channel, noise in plan.instruments.noise.items():
        angle = channel in ("p", "q", "r", "roll", "pitch", "yaw")
        unit = ("deg" if angle else "m") + ("/s" if channel in "uvwpqr" else "")
        groups.setdefault(f"{noise / DEGREE if angle else noise:.3g} {unit}", []).append(channel)
    sizes = ", ".join(f"{' '.join(channels)} {size}" for size, channels in groups.items())
    yield (
        f"Assumed: noise of {sizes}; one sample per {plan.instruments.correlation_s:.2g} s counts; unknown"
        f" current {plan.instruments.current_m_s:g} m/s; the model as it is."
    )


def _still_unknown(plan: Plan) -> list[str]:
    """What stays unknown after the trials, and which manoeuvre would show it best."""
    groups: dict[str, list[str]] = {}
    for change in plan.coefficients:
        if change.after / change.whole <= PLAN_SETTINGS.unknown_sd:
            continue
        best, left = "", change.after
        for ranked in plan.ranking:
            after = next(gain.after for gain in ranked.gains if gain.name == change.name)
            if after < PLAN_SETTINGS.better_share * left:
                best, left = ranked.manoeuvre.name, after
        precision = change.told(left, change.unit) + (" %" if change.of_value else "")
        groups.setdefault(best, []).append(f"{change.name} ({precision})" if best else change.name)
    return [
        f"Still unknown to more than {100 * PLAN_SETTINGS.unknown_sd:.0f} %, "
        + (f"best shown by {best}" if best else "and no manoeuvre that fits improves it")
        + f": {', '.join(names)}"
        for best, names in groups.items()
    ]


def _cells(ranked: Ranked, *, names: int = 3) -> list[str]:
    """Cells of a trial: name, thrust, times, area, depth, score, what it determines best."""
    seen = ranked.forecast
    return [
        ranked.manoeuvre.name,
        f"{100 * ranked.amplitude:.0f} %" if ranked.amplitude else "none",
        _times(ranked),
        f"{seen.along_m:.0f} x {seen.across_m:.0f}",
        f"{seen.deepest_m:.0f}",
        _number(ranked.score),
        ", ".join(change.name for change in ranked.gains[:names]),
    ]


def _times(ranked: Ranked) -> str:
    duration = f"{ranked.manoeuvre.duration_s:.0f} s"
    return f"{ranked.repeats} x {duration}" if ranked.repeats > 1 else duration


def _number(value: float) -> str:
    return f"{value:.3g}"


_DECIMALS = {"s": 1, "m": 2, "m/s": 3, "deg": 1}


@report.register
def _simulated(made: SimulatedTrial, title: str, next_step: str) -> Report:
    """Three lines and a table of the whole run."""
    summary = made.summary()
    rows = [(name, _quantity(name, value)) for name, value in summary.items()]
    return Report(
        title=title,
        outcome="simulated",
        good=(
            f"{summary['distance, m']:.1f} m in {summary['duration, s']:.1f} s, largest speed"
            f" {summary['largest speed, m/s']:.3f} m/s"
        ),
        worst="; ".join(map(problem, made.findings()))
        or "nothing stands out: the run is finite and stays below the surface",
        next_step=next_step,
        sections=(Section(tables=(Table.of("Whole run", ("quantity", "value"), rows),)),),
    )


def problem(finding: Finding) -> str:
    """A finding of a simulated run, a clause."""
    if finding.kind == "leaves the water":
        return (
            f"the vehicle rises {finding['rise_m']:.2f} m above the surface, of which the run knows nothing;"
            " state it (--surface 0), or start deeper, with a column z_m"
        )
    if finding.kind == "no load cell":
        return "the pull of the tied vehicle is not in the log: these sensors have no load_cell"
    return _clipped(finding)


def _clipped(finding: Finding) -> str:
    unit, neutral = finding["unit"], finding["neutral"]
    at = f" about {neutral:g}" if neutral else ""
    others = finding["others"]
    return (
        f"{100.0 * finding['share']:.0f} % of the commands of {finding.subject} are beyond its limit of"
        f" {finding['limit']:g} {unit}{at} and are held there, the largest is"
        f" {neutral + finding['largest']:g} {unit}{_other_unit(finding)}"
        + (f"; so are commands of {', '.join(others)}" if others else "")
    )


def _other_unit(finding: Finding) -> str:
    """Which unit a command may be in that no actuator of this one takes."""
    largest = abs(finding["largest"])
    if finding["unit"] == "rad" and largest > SIMULATION_SETTINGS.no_angle_rad:
        return ": are these degrees?"
    if finding["unit"] == "N" and largest > SIMULATION_SETTINGS.no_force * finding["limit"]:
        return ": are these revolutions per minute?"
    return ""


def _quantity(name: str, value: float) -> str:
    """A quantity of the summary with the decimals that its unit deserves; no minus before zero."""
    decimals = _DECIMALS[name.rsplit(", ", 1)[1]]
    return f"{round(value, decimals) + 0.0:.{decimals}f}"
