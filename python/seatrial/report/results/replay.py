"""The words of a replay of ArduSub's controllers: which checks are met, and why the others are not.

Held by ``tests/ardusub/test_replay.py``.
"""

from __future__ import annotations

import math
from pathlib import Path

from seatrial.ardusub.comparison import Found, Replay
from seatrial.base.report import Column, Report, Section, Table, listed


def report(replay: Replay) -> Report:
    """How many checks are met, the worst, what to do; tables."""
    problem = worst(replay)
    against = replay.against()
    # A file that the vehicle does not fly with outweighs any check.
    apart = [(each, own) for each, own, agrees in against if not agrees]
    if apart:
        differ = ", ".join(f"{_value(each)} for {own:g}" for each, own in apart[:4])
        file = replay.given.source if replay.given else ""
        problem = f"{len(apart)} parameters found differ from {file}: {differ}"
    if replay.missing:
        next_step = (
            f"log {listed(list(replay.missing))} as well (LOG_BITMASK: attitude, PID, control tuning, RC"
            " input and output), and replay the next dive"
        )
    elif not replay.held:
        next_step = "look at the check that is not met in the figure: where does it begin?"
    elif apart:
        next_step = "find out which is right: was the file written by this vehicle before this dive?"
    elif against:
        next_step = "identify the vehicle from the same log: seatrial import LOG --out PROJECT"
    else:
        next_step = "compare the parameters found with the vehicle's own: --parameters FILE"
    return Report(
        title=Path(replay.source).name,
        outcome="replayed" if replay.held else "replayed in part" if replay.checks[0] else "not replayed",
        good=good(replay),
        worst=problem,
        next_step=next_step,
        sections=(
            Section(tables=(_checks(replay), _parameters(replay))),
            Section("What is left, and why", _reasons(replay), details=True),
            Section("Notes", replay.notes, details=True),
        ),
    )


def good(replay: Replay) -> str:
    """How many checks are met; first what is missing from the log."""
    met, owed = replay.checks
    count = f"{met} of {owed} checks are what ArduSub's law makes of the logged inputs"
    if replay.missing:
        whole = [name for name in replay.missing if name not in replay.partly]
        parts = [(whole, "missing from the log"), (list(replay.partly), "missing for part of the log")]
        lacks = " and ".join(
            f"{listed(names)} {'is' if len(names) == 1 else 'are'} {what}" for names, what in parts if names
        )
        lost = sum(bool(gap.topic) for gap in replay.impossible)
        return f"{lacks}, so that {lost} check{'s' if lost > 1 else ''} cannot be made; {count}"
    return f"{count}; {len(replay.found)} parameters found"


def worst(replay: Replay) -> str:
    """The first check that is not met, else one that could not be made, else the first note."""
    wrong = [quantity for quantity in replay.quantities if not quantity.holds]
    if wrong:
        # The first in the order of the signal: what comes after it may follow from it.
        first, more = wrong[0], len(wrong) - 1
        others = f"; {more} more {'is' if more == 1 else 'are'} not met" if more else ""
        return (
            (
                f"{first.controller}, {first.name}: replayed within {_short(first.p95)} {first.unit} in"
                f" 95 % of the rows, expected {_short(first.limit)} {first.unit}"
            )
            + (f" ({first.why})" if first.why else "")
            + others
        )
    if replay.impossible:
        gap = next((each for each in replay.impossible if not each.topic), replay.impossible[0])
        return f"{gap.controller}, {gap.name}: {gap.why}"
    return replay.notes[0] if replay.notes else "nothing stands out"


def _checks(replay: Replay) -> Table:
    """Table of all checks; those that could not be made last."""
    rows = [
        (
            each.controller, each.name, each.unit, str(len(each.error)), _short(each.rms),
            _short(each.p95), _short(each.limit), "yes" if each.holds else "no",
        )
        for each in replay.quantities
    ]  # fmt: skip
    rows += [(gap.controller, gap.name, "", "0", "", "", "", "cannot tell") for gap in replay.impossible]
    head = ("controller", "quantity", "unit", "rows", "rms", "p95 error", "limit", "right")
    return Table.of("Logged and replayed", head, rows, left=3)


def _parameters(replay: Replay) -> Table:
    """Table of the parameters found."""
    own = {each.name: (f"{value:g}", "yes" if agrees else "no") for each, value, agrees in replay.against()}
    rows = [
        (
            each.name, f"{each.bound} {each.value:.4g}".strip(), "" if math.isnan(each.sd) else
            f"{each.sd:.1g}", *own.get(each.name, ("", "")), each.how,
        )
        for each in replay.found
    ]  # fmt: skip
    columns = ("parameter", "value", "sd", "given", "agrees", Column("found from", align="left"))
    return Table.of("Parameters found", columns, rows, left=1)


def _reasons(replay: Replay) -> tuple[str, ...]:
    """Why checks are not met, or cannot be made."""
    reasons = [f"{each.controller}, {each.name}: {each.why}." for each in replay.quantities if each.why]
    reasons += [f"{gap.controller}, {gap.name}: {gap.why}." for gap in replay.impossible]
    return tuple(dict.fromkeys(reasons))


def _short(value: float) -> str:
    return f"{value:.3g}"


def _value(parameter: Found) -> str:
    """Name and value of a parameter, or its bound."""
    return " ".join(part for part in (parameter.name, parameter.bound, _short(parameter.value)) if part)
