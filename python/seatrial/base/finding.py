"""A finding: what is wrong with a result, as data. Its words are written in `seatrial.report`.

A finding may name another as its cause: the remedy that helps is that of the root. Held by
``tests/flight/test_findings.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any


class Severity(IntEnum):
    """How much a finding matters; the worst problem of a result is that of the largest severity."""

    NOTE = 0
    """Worth knowing."""
    WEAKNESS = 1
    """The result is good; this limits how good."""
    PROBLEM = 2
    """What was asked for was not done."""
    DANGER = 3
    """The vehicle was at risk, or the result means nothing."""


@dataclass(frozen=True)
class Finding:
    """What was found, with its numbers.

    Attributes
    ----------
    kind
        Which of the kinds that `seatrial.report` has words for, such as "waypoint missed".
    severity
    subject
        What it is about: a leg, a loop, a channel, a coefficient.
    values
        Numbers by name with their unit in it, and names, that words and remedy need.
    cause
        The finding that explains this one.
    at_s
        When it began, s; nan where that says nothing.
    """

    kind: str
    severity: Severity
    subject: str = ""
    values: Mapping[str, Any] = field(default_factory=dict)
    cause: Finding | None = None
    at_s: float = math.nan

    @property
    def root(self) -> Finding:
        """The last cause, this finding where it has none."""
        return self if self.cause is None else self.cause.root

    def __getitem__(self, name: str) -> Any:
        """A value by its name."""
        return self.values[name]

    def because(self, cause: Finding | None) -> Finding:
        """The finding with a cause behind its last one; itself for None."""
        if cause is None:
            return self
        return replace(self, cause=cause if self.cause is None else self.cause.because(cause))

    def to_dict(self) -> dict[str, Any]:
        """Kind, severity, subject, values and cause as plain data for JSON."""
        return {
            "kind": self.kind,
            "severity": self.severity.name.lower(),
            "subject": self.subject,
            "values": dict(self.values),
            "at_s": self.at_s,
            "cause": None if self.cause is None else self.cause.to_dict(),
        }


def by_severity(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Findings, the gravest first; those of one severity in their order.

    Examples
    --------
    >>> late, deep = Finding("late", Severity.WEAKNESS), Finding("too deep", Severity.DANGER)
    >>> [finding.kind for finding in by_severity([late, deep])]
    ['too deep', 'late']
    """
    return tuple(sorted(findings, key=lambda finding: -finding.severity))
