"""How a verification is shown on the command line: progress while it flies, tables and sentences after."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from seatrial.verification.comparison_of_autopilots import AutopilotComparison
    from seatrial.verification.judged_requirement import JudgedRequirement
    from seatrial.verification.mission_series import MissionsFlown
    from seatrial.verification.verification_result import Verification

__all__ = ["missions_progress", "print_verification"]

_WIDE = 110  # columns that the requirements need beside what must hold
_FIGURES = {
    "cross_track_p95_m": "median cross-track p95, m",
    "vertical_p95_m": "median vertical p95, m",
    "energy_wh": "median energy, Wh",
    "duration_s": "median duration, s",
    "travel_per_s": "median command travel, 1/s",
}


@contextmanager
def missions_progress(*, quiet: bool = False) -> Iterator[Callable[[MissionsFlown], None]]:
    """Callback for `seatrial.verify` that shows the missions flown, real-time factor and time left."""
    from seatrial.cli.console import long_work

    with long_work("first missions", quiet=quiet) as show:
        yield lambda state: show(state.flown / state.runs, _words(state), ())


def print_verification(console: Console, found: Verification) -> None:
    """Print verdict, requirements, causes, worst missions and comparison."""
    from seatrial.verification.verification_text import again, headline, time_sentence

    narrow = console.width < _WIDE
    console.print(_requirements(found, narrow=narrow))
    for one in found.requirements if narrow else ():
        console.print(f"{one.requirement.name}: {one.requirement.holds}", soft_wrap=True, markup=False)
    if narrow:
        console.print()
    if any(len(one.by_mission) > 1 for one in found.requirements):
        console.print(_missions(found))
    if any(one.worst for one in found.requirements):
        console.print(_worst(found))
    if found.comparison is not None:
        for made in _comparisons(found.comparison):
            console.print(made)
        console.print(_medians(found.comparison))
    for one in found.requirements:
        for line in _sentences(one):
            console.print(f"- {line}", soft_wrap=True, markup=False)
    for note in found.notes:
        console.print(f"- {note}", soft_wrap=True, markup=False)
    console.print(f"- {time_sentence(found)}", soft_wrap=True, markup=False)
    console.print(f"- {again(found)}", soft_wrap=True, markup=False)
    console.print(headline(found), soft_wrap=True, markup=False, style="bold")


def _requirements(found: Verification, *, narrow: bool) -> Table:
    """Verdicts; what must hold stands below the table where a terminal is too narrow for it."""
    from seatrial.cli.console import table
    from seatrial.verification.failure_probability import share

    rows = []
    for one in found.requirements:
        lower, upper = one.found.interval
        rows.append([
            one.requirement.name,
            one.requirement.holds,
            share(one.requirement.allowed),
            f"{one.found.failures}",
            f"{share(lower, 'down')} to {share(upper, 'up')}",
            share(one.found.at_most, "up"),
            one.verdict,
        ])
    sure = f"{100.0 * found.flights.table.confidence:g} %"
    flights = found.flights
    title = f"{flights.autopilot.name} on {flights.fitted.vehicle.name}: {len(found.flown)} missions"
    head = ["requirement", "holds", "allowed", "failures", f"{sure} interval", "at most", "verdict"]
    if narrow:
        return _folding(table(title, head[:1] + head[2:], [row[:1] + row[2:] for row in rows]))
    made = table(title, head, rows)
    made.columns[1].justify = "left"
    return made


def _folding(made: Table) -> Table:
    """The same table, with long names on several lines instead of cut off."""
    made.columns[0].no_wrap = False
    for column in made.columns:
        column.overflow = "fold"
    return made


def _missions(found: Verification) -> Table:
    from seatrial.cli.console import table

    titles = found.flights.titles
    rows = [
        [
            one.requirement.name,
            *(
                f"{part.failures} of {part.runs}" if (part := one.by_mission.get(title)) else "-"
                for title in titles
            ),
        ]
        for one in found.requirements
    ]
    return table("Failures by mission", ["requirement", *titles], rows)


def _worst(found: Verification) -> Table:
    from seatrial.cli.console import table
    from seatrial.verification.verification_text import reserve

    rows = []
    for one in found.requirements:
        for run in one.worst[:3]:
            figures = run.figures
            rows.append([
                one.requirement.name,
                str(run.number),
                run.mission,
                reserve(run.reserve, one.judgement.unit),
                str(figures["ending"]),
                _number(figures["cross_track_p95_m"], 2),
                _number(figures["vertical_p95_m"], 2),
                _number(figures["clearance_m"], 1),
                _number(figures["duration_s"], 0),
            ])
    head = ["requirement", "number", "mission", "reserve", "ending", "across", "vertical", "clear", "time"]
    one_mission = len(found.flights.titles) == 1
    dropped = [
        k
        for k, name in enumerate(head)
        if (name == "mission" and one_mission) or (name == "clear" and all(row[k] == "-" for row in rows))
    ]
    kept = [k for k in range(len(head)) if k not in dropped]
    return _folding(
        table(
            "Worst missions (lengths in m, time in s; across and vertical: p95)",
            [head[k] for k in kept],
            [[row[k] for k in kept] for row in rows],
        )
    )


def _comparisons(found: AutopilotComparison) -> Iterator[Table]:
    """The verified autopilot against each other one."""
    from seatrial.cli.console import table
    from seatrial.verification.failure_probability import share

    verified, *others = found.autopilots
    head = ["requirement", "verified\nfails", "other\nfails", "only\nverified", "only\nother", "p", "better"]
    for other in others:
        rows = []
        for name, failures in verified.failures.items():
            pair = found.pair(name, other.name)
            rows.append([
                name,
                share(failures.estimate),
                share(other.failures[name].estimate),
                str(pair.only_verified),
                str(pair.only_other),
                f"{pair.corrected:.2g}",
                {"verified": "verified", None: "not shown"}.get(pair.better, "other"),
            ])
        title = f"Against {other.name}, on the same {found.runs} draws (McNemar's exact test, Holm)"
        made = _folding(table(title, head, rows))
        for column in made.columns[1:]:
            column.no_wrap = True
        yield made


def _medians(found: AutopilotComparison) -> Table:
    from seatrial.cli.console import table

    rows = [
        [label, *(f"{one.figures[name]:.4g}" for one in found.autopilots)]
        for name, label in _FIGURES.items()
        if name in found.autopilots[0].figures
    ]
    return table("Figures on the same draws", ["figure", *(one.name for one in found.autopilots)], rows)


def _sentences(one: JudgedRequirement) -> list[str]:
    """Verdict of a requirement and what its failures go with, where there is something to say."""
    said = [] if one.verdict == "held" else [f"{one.requirement.name} {one.sentence}."]
    if one.found.failures:
        said += [f"{one.requirement.name}: {cause}." for cause in one.named_causes[:3]]
    return said


def _words(state: MissionsFlown) -> str:
    left = f"{state.left_s:.0f} s" if state.left_s < 90 else f"{state.left_s / 60:.0f} min"
    return (
        f"{state.autopilot}: {state.flown} of {state.runs} missions,"
        f" {state.real_time_factor:,.0f} times real time, {left} left"
    )


def _number(value: float, decimals: int) -> str:
    return f"{round(value, decimals) + 0.0:.{decimals}f}" if math.isfinite(value) else "-"
