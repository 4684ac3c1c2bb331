"""The numbers of a run that say most, and two runs of a kind beside one another: what came out, what went in.

Held by ``tests/report/test_compare.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from seatrial.base.report import Report, Section, Table
from seatrial.report.page.run_folder import RunFolder
from seatrial.report.results.tuning import gain_unit

Numbers = list[tuple[str, str, str]]
"""Name, value and unit."""


def numbers(runs: Sequence[RunFolder]) -> Numbers:
    """At most four numbers of the first screen, of the last run first: name, value, unit."""
    shown: Numbers = []
    for run in reversed(runs):
        shown += _numbers(run)
    return shown[:4]


def _numbers(run: RunFolder) -> Numbers:
    try:
        return _NUMBERS[run.kind](run.results)
    except (KeyError, TypeError, ValueError, AttributeError):  # another kind, or another version
        return []


def _of_flight(results: Mapping[str, Any]) -> Numbers:
    metrics, legs = results["metrics"], results["legs"]
    named = (
        ("true cross-track error, rms", "true_cross_track_rms_m", "m"),
        ("nearest to an obstacle", "clearance_m", "m"),
        ("time of the mission", "duration_s", "s"),
        ("energy", "energy_wh", "Wh"),
        ("way over ground", "distance_m", "m"),
    )
    reached = f"{sum(leg['reached'] for leg in legs)} of {len(legs)}"
    known = [(name, f"{metrics[key]:.3g}", unit) for name, key, unit in named if metrics.get(key)]
    return [("waypoints reached", reached, ""), *known][:4]


def _of_verification(results: Mapping[str, Any]) -> Numbers:
    asked = results["requirements"]
    worst = max(asked, key=lambda own: float(own["at_most"]))
    held = sum(own["verdict"] == "held" for own in asked)
    return [
        ("requirements held", f"{held} of {len(asked)}", ""),
        ("missions flown", str(results["missions"]["flown"]), ""),
        (f'missions that miss "{worst["name"]}"', f"{100 * worst['failure_probability']:.2f}", "%"),
        (f"of these at most, {100 * worst['confidence']:.0f} % sure", f"{100 * worst['at_most']:.2f}", "%"),
    ]


def _of_tuning(results: Mapping[str, Any]) -> Numbers:
    (tuned,) = (own for own in results["performance"] if own["name"] == "tuned")
    margins = [own for own in results["margins"]["tuned"] if own["phase_deg"] is not None]
    least = min(margins, key=lambda own: float(own["phase_deg"]))
    held = sum(trial["held"] == 1.0 for trial in tuned["trials"])
    return [
        ("steps in their corridors", f"{held} of {len(tuned['trials'])}", ""),
        (f"least phase margin, {least['loop']}", f"{least['phase_deg']:.0f}", "deg"),
    ]


def _of_identification(results: Mapping[str, Any]) -> Numbers:
    coefficients = [own for own in results["coefficients"] if own.get("verdict")]
    sure = sum(own["verdict"] == "identifiable" for own in coefficients)
    ahead = results["scores"]["hold_out"]["ahead"]["all"]["channels"]
    known = {name: score["r2"] for name, score in ahead.items() if score.get("r2") is not None}
    best, worst = max(known, key=known.__getitem__), min(known, key=known.__getitem__)
    return [
        ("coefficients determined", f"{sure} of {len(coefficients)}", ""),
        (f"R² 10 s ahead on held-out data, best: {best}", f"{known[best]:.3f}", ""),
        (f"R² 10 s ahead on held-out data, worst: {worst}", f"{known[worst]:.3f}", ""),
    ]


_NUMBERS = {
    "flight": _of_flight,
    "identification": _of_identification,
    "tuning": _of_tuning,
    "verification": _of_verification,
}


def compared(runs: Sequence[RunFolder]) -> Report | None:
    """The first and the last run of a kind beside one another; None where no kind comes twice.

    An estimate moved where its change is beyond two standard deviations of both.
    """
    kinds = [run.kind for run in runs]
    again = [run for run in runs if kinds.count(run.kind) > 1]
    if not again:
        return None
    before, after = again[0], [run for run in again if run.kind == again[0].kind][-1]
    head = ("", before.name, after.name)
    first, last = (
        {name: f"{value} {unit}".strip() for name, value, unit in _numbers(run)} for run in (before, after)
    )
    results = [("outcome", before.report.outcome, after.report.outcome)]
    results += [(name, first.get(name, "none"), value) for name, value in last.items()]
    estimates = list(_estimates(before.results, after.results))
    gains = list(_gains(before.results, after.results))
    around = ({**run.facts, "in the water": run.results.get("circumstances")} for run in (before, after))
    inputs = list(_inputs(*around))
    tables = (
        Table.of("Results", head, results),
        Table.of("Estimates", ("coefficient", "unit", *head[1:], "change", ""), estimates, left=2),
        Table.of("Gains that differ", ("gain", "unit", *head[1:]), gains, left=2),
        Table.of("Inputs and settings that differ", head, inputs),
    )
    # The change that says most: of an estimate, else of a result.
    moved = sorted(
        (row for row in estimates if row[-1] == "moved"), key=lambda row: -abs(float(row[4].rstrip("%")))
    )
    other = [f"{name}: {own} before, {value} after" for name, own, value in results if own != value]
    changes = [f"{row[0]}: {row[2]} before, {row[3]} {row[1]} after" for row in moved] + other
    counts = {
        "estimates moved beyond two standard deviations": (len(moved), len(estimates)),
        "gains differ": (len(gains), len(gains)),
        "inputs and settings differ": (len(inputs), 1),
    }
    return Report(
        title=f"{before.name} and {after.name}",
        outcome=f"{before.kind} before and after",
        good="; ".join(f"{count} {words}" for words, (count, known) in counts.items() if known),
        worst=changes[0] if changes else "no result differs",
        next_step="explain the changes by what differs" if inputs else "nothing: the inputs are the same",
        sections=(Section(tables=tables),),
    )


def _estimates(before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    """Coefficient, unit, both estimates with standard deviations, change in per cent, whether it moved."""
    first = {own["name"]: own for own in before.get("coefficients") or ()}
    for own in after.get("coefficients") or ():
        if (other := first.get(own["name"])) is None:
            yield own["name"], own["unit"], "not estimated", _estimate(own), "", "new"
            continue
        change, spread = own["estimate"] - other["estimate"], (own["sigma"], other["sigma"])
        far = None not in spread and abs(change) > 2.0 * math.hypot(*spread)
        share = f"{change / abs(other['estimate']):+.1%}" if other["estimate"] else "+inf%"
        yield own["name"], own["unit"], _estimate(other), _estimate(own), share, "moved" if far else ""


def _estimate(own: Mapping[str, Any]) -> str:
    sure = own.get("sigma") is not None
    return f"{own['estimate']:.4g} ± {own['sigma']:.2g}" if sure else f"{own['estimate']:.4g}"


def _gains(before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    first, second = ((own.get("gains") or {}).get("tuned") or {} for own in (before, after))
    for name in sorted({*first, *second}):
        if first.get(name) != second.get(name):
            yield (
                name,
                gain_unit(name),
                *(f"{own[name]:.4g}" if name in own else "none" for own in (first, second)),
            )


def _inputs(before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    """Name, and what it was before and after: the beginning of a hash, or a setting."""
    for part, most in (("sha256", 12), ("options", 60), ("versions", 20), ("in the water", 60)):
        first, second = ((own.get(part) or {}) for own in (before, after))
        for name in sorted({*first, *second}):
            if first.get(name) != second.get(name):
                words = (str(own[name])[:most] if name in own else "none" for own in (first, second))
                yield f"{'SHA-256 of ' * (part == 'sha256')}{name}", *words
    if before.get("seed") != after.get("seed"):
        yield "seed", str(before.get("seed")), str(after.get("seed"))
