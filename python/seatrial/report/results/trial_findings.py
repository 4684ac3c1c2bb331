"""Findings about recordings in words: the problem as a clause, and what to do about it.

A wording per kind. Held by ``tests/inspect/test_wiring.py`` and ``tests/inspect/test_consistency_trials.py``.
"""

from __future__ import annotations

from collections.abc import Callable

from seatrial.base.finding import Finding
from seatrial.base.report import listed


def problem(finding: Finding) -> str:
    """The problem, a clause; it names the trial where the finding does."""
    return _PROBLEMS[finding.kind](finding)


def remedy(finding: Finding) -> str:
    """What to do about a finding."""
    return _REMEDIES[finding.kind](finding)


def _trial(finding: Finding) -> str:
    return f"trial {finding.subject}: " if finding.subject else ""


def _wiring(finding: Finding) -> str:
    reversed_, faults = finding["reversed"], []
    if reversed_:
        acts = "act against their signs" if len(reversed_) > 1 else "acts against its sign"
        faults.append(f"{listed(reversed_)} {acts}")
    faults += [f"{a} and {b} act in one another's place" for a, b in finding["exchanged"]]
    shares = ", ".join(
        f"{100.0 * after:.0f} % instead of {100.0 * max(before, 0.0):.0f} % of {axis}"
        for axis, (before, after) in finding["explained"].items()
    )
    return (
        f"{_trial(finding)}wiring: {' and '.join(faults)}: so the commands explain {shares} beyond damping"
        f" (log-likelihood {finding['evidence']:.0f} higher)"
    )


def _wiring_remedy(finding: Finding) -> str:
    reversed_, cures = finding["reversed"], []
    if reversed_:
        these = "these actuators" if len(reversed_) > 1 else "this actuator"
        columns = listed([f"cmd.{name}" for name in reversed_])
        cures.append(
            f"toggle the key reversed of {these} in the vehicle file, or give sign = -1 to {columns} in the"
            " column map"
        )
    cures += [
        f"exchange the columns of cmd.{a} and cmd.{b} in the column map" for a, b in finding["exchanged"]
    ]
    return f"{' and '.join(cures)}; check in the water"


def _beyond(finding: Finding) -> str:
    return (
        f"{_trial(finding)}command of {finding['command']} reaches {finding['reached']:g}, and its limit is"
        f" {finding['limit']:g} (beyond it in {100.0 * finding['share']:.0f} % of the samples)"
    )


def _late(finding: Finding) -> str:
    word = "late" if finding["delay_s"] > 0.0 else "early"
    return (
        f"the velocity of trial {finding.subject} is {abs(finding['delay_s']):.2f} s {word} (it differs from"
        f" the rate of depth by {finding['before']:.3g} m/s rms, without the delay by"
        f" {finding['after']:.3g}), and the log has too few positions to correct this on reading,"
        " so forces are fitted at the wrong times"
    )


def _late_remedy(finding: Finding) -> str:
    return (
        f"run seatrial check {finding['problem']} and paste its proposal ({finding['line']} under"
        " [corrections])"
    )


_PROBLEMS: dict[str, Callable[[Finding], str]] = {
    "wiring": _wiring,
    "command beyond limit": _beyond,
    "late velocity": _late,
}

_REMEDIES: dict[str, Callable[[Finding], str]] = {
    "wiring": _wiring_remedy,
    "command beyond limit": lambda _: "check the unit of the column and the limits in the vehicle file",
    "late velocity": _late_remedy,
}
