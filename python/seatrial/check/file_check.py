"""What the checks of a vehicle, an autopilot and a mission have in common: findings, notes and warnings.

The words of a finding are written in `seatrial.report.results.check_findings`. Held by
``tests/check/test_check_findings.py``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from seatrial.base.finding import Finding, Severity
from seatrial.base.plain import Plain
from seatrial.base.report import Reported, writer_of


@dataclass(frozen=True, repr=False)
class FileCheck(Reported, Plain):
    """What was found about a file; printed, a page of sentences."""

    #: Of what the file describes.
    name: str
    description: str
    #: Notes, and warnings about what is probably not meant, each in the order of reading.
    findings: tuple[Finding, ...]

    @property
    def warned(self) -> tuple[Finding, ...]:
        """The findings that are more than notes."""
        return tuple(finding for finding in self.findings if finding.severity > Severity.NOTE)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about what is worth knowing."""
        noted = (finding for finding in self.findings if finding.severity == Severity.NOTE)
        return tuple(map(writer_of(self).sentence, noted))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences about what is probably wrong."""
        return tuple(map(writer_of(self).sentence, self.warned))


def note(kind: str, subject: str = "", /, **values: Any) -> Finding:
    """A finding that is worth knowing."""
    return Finding(kind, Severity.NOTE, subject, values)


def warning(kind: str, subject: str = "", /, **values: Any) -> Finding:
    """A finding about what is probably wrong, or will not go as written."""
    return Finding(kind, Severity.WEAKNESS, subject, values)
