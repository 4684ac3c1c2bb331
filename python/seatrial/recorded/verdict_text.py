"""A verdict on a log in words: outcome, channels, suspects, the mission's own figures.

Tests: ``tests/test_recorded_verdict.py``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from seatrial.channel import readable

if TYPE_CHECKING:
    from seatrial.recorded.log_verdict import LogVerdict

__all__ = ["summary"]

_SHOWN = 6


def summary(verdict: LogVerdict) -> str:
    """Text of a verdict, the most important first."""
    lines = [f"{verdict.log.trial.name}: {verdict.outcome}", verdict.reason]
    lines += _channels(verdict)
    if verdict.validity is not None:
        lines.append(f"The band is that of {verdict.validity.spread.source}.")
    if verdict.suspects:
        lines += ["", "What may have changed, the best explanation first:"]
        lines += [f"{k}. {one.sentence()}" for k, one in enumerate(verdict.suspects[:_SHOWN], 1)]
        lines += _inseparable(verdict)
        if verdict.suspects[0].kind == "sensor":
            lines.append(
                "No change of the vehicle explains it as well: check the sensor before you identify anew."
            )
        if verdict.suspects[0].kind == "actuator":
            name = verdict.suspects[0].name
            lines.append(
                f"No coefficient explains it as well: look at {name} and at its logged commands before you"
                " identify anew."
            )
    if verdict.detectable:
        words = [f"{one.change} {100.0 * one.power:.0f} %" for one in verdict.detectable]
        lines += ["", f"Chance that this log would have shown: {', '.join(words)}."]
    lines += _mission(verdict)
    if verdict.notes:
        lines += ["", *verdict.notes]
    return "\n".join(lines)


def _channels(verdict: LogVerdict) -> list[str]:
    if verdict.validity is None:
        return []
    lines = [
        "",
        f"{'channel':<9}{'outside 95 % band':>17}{'(95 %)':>10}{'error rms':>11}{'band +-':>9}"
        f"  {'unit':<6}{'p':>9}",
    ]
    for name, one in verdict.validity.channels.items():
        scale, unit = readable(name)
        p = f"{one.p:.2g}" if one.p >= 1e-4 else "<0.0001"
        mark = "  fails" if one.fails else "  doubt" if one.doubtful else ""
        low, high = one.interval
        known = f"({100.0 * low:.0f}-{100.0 * high:.0f})"
        lines.append(
            f"{name:<9}{100.0 * one.outside:>15.1f} %{known:>10}{scale * one.rms:>11.3g}"
            f"{scale * one.spread:>9.3g}  {unit:<6}{p:>9}{mark}"
        )
    return lines


def _inseparable(verdict: LogVerdict) -> list[str]:
    """A word on weight and buoyancy, of which logs tell the difference alone."""
    first = verdict.suspects[0]
    named = {first.name, *first.alike}
    if {"m", "B"} <= named or (first.name.startswith("payload") and {"m", "B"} & named):
        return [
            "B and m g are seen as their difference, the weight in water, unless the log tells the inertia;"
            " weigh what was changed."
        ]
    return []


def _mission(verdict: LogVerdict) -> list[str]:
    lines = []
    figures = verdict.figures
    said = [
        (name, text)
        for name, text in (
            ("cross_track_p95_m", "cross-track error {:.2f} m in 95 % of the settled time"),
            ("vertical_p95_m", "vertical error {:.2f} m"),
            ("duration_s", "{:.0f} s"),
            ("energy_wh", "{:.1f} Wh"),
        )
        if name in figures
    ]
    if len(said) > 1:  # how long a log lasts is no news by itself
        lines += ["", f"The mission: {', '.join(text.format(figures[name]) for name, text in said)}."]
    for one in verdict.requirements:
        if one.held is None:
            who = "no log tells" if one.beyond_logs else "the log does not tell"
            lines.append(f"  ?     {one.name}: {one.holds}; {who} {', '.join(one.missing)}")
        else:
            # Words and truth values are infinitely far from their threshold.
            reserve = f", reserve {one.reserve:.3g} {one.unit}" if math.isfinite(one.reserve) else ""
            lines.append(f"  {'held ' if one.held else 'FAILS'} {one.name}: {one.holds}{reserve}")
    for step in verdict.steps:
        inside = "inside its corridor" if step.criterion <= 0.0 else f"outside by {step.criterion:.3g} s"
        lines.append(f"  step of the {step.loop} set point at {step.at_s:.1f} s: {inside}")
    if verdict.envelope is not None:
        shares = ", ".join(
            f"{name.replace('_', '-')} {100.0 * band.outside:.0f} %"
            for name, band in verdict.envelope.bands.items()
        )
        lines.append(
            f"Outside the closed-loop envelope of {verdict.envelope.flights} flights: {shares} of the log."
        )
    return lines
