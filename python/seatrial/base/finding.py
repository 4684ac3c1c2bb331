"""What is wrong with a result, as data. Its words are written in `seatrial.report`.

A `Finding` may name another as its cause: the remedy that helps is that of the root. A `Fallback` is a step
that failed numerically and what is kept in its place, so that a result of minutes is not lost to a
by-product. Held by ``tests/flight/test_findings.py`` and ``tests/identification/test_fallbacks.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from enum import IntEnum
from importlib import import_module
from typing import Any, Literal

from seatrial.base.errors import CampaignError, SimulationError, TrialError, VehicleError
from seatrial.base.plain import Plain


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
    """What was found, with its numbers."""

    kind: str  #: Which of the kinds that `seatrial.report` has words for, such as "waypoint missed".
    severity: Severity
    subject: str = ""  #: What it is about: a leg, a loop, a channel, a coefficient.
    #: Numbers by name with their unit in it, and names, that words and remedy need.
    values: Mapping[str, Any] = field(default_factory=dict)
    cause: Finding | None = None  #: The finding that explains this one.
    at_s: float = math.nan  #: When it began, s; nan where that says nothing.

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


Kind = Literal["numerical", "refused"]


@dataclass(frozen=True)
class Fallback(Plain, only="step=name kind cause kept remedy"):
    """A step without a result, whose words are in `seatrial.report.results.estimates`.

    ``step`` says which, ``of`` which of several (a stage, a round). ``kind`` is "numerical" where it diverged
    or has no finite result, "refused" where what was found does not suit it; ``cause`` is what failed, as the
    step says it.
    """

    step: str
    kind: Kind
    cause: str
    of: str = ""

    @property
    def name(self) -> str:
        """Name of the step."""
        return self._words[0]

    @property
    def kept(self) -> str:
        """What the result has instead."""
        return self._words[1]

    @property
    def remedy(self) -> str:
        """What to do."""
        return self._words[2]

    @property
    def _words(self) -> tuple[str, str, str]:
        words: tuple[str, str, str] = import_module("seatrial.report.results.estimates").words(
            self.step, self.of
        )
        return words

    @property
    def sentence(self) -> str:
        """All of it in words."""
        cause = self.cause.rstrip(".")
        return f"{self.name} failed: {cause}. Kept instead: {self.kept}; {self.remedy}"


def is_numerical(error: BaseException) -> bool:
    """Whether an error says that numbers failed, and not that a program or its input is wrong.

    Libraries raise a plain ValueError for arrays with infinite values: that counts where SciPy itself, or
    NumPy's check for finite numbers, raised it.

    Examples
    --------
    >>> import numpy as np
    >>> is_numerical(np.linalg.LinAlgError("Singular matrix")), is_numerical(KeyError("u"))
    (True, False)
    """
    from numpy.linalg import LinAlgError

    if isinstance(error, LinAlgError | ArithmeticError):
        return True
    if type(error) is not ValueError or error.__traceback__ is None:
        return False
    last = error.__traceback__
    while last.tb_next is not None:
        last = last.tb_next
    module = str(last.tb_frame.f_globals.get("__name__", ""))
    return module.split(".")[0] == "scipy" or last.tb_frame.f_code.co_name == "asarray_chkfinite"


class Fallbacks:
    """Workspace: the steps that failed so far, in their order."""

    def __init__(self) -> None:
        self.findings: list[Fallback] = []

    @contextmanager
    def step(self, name: str, *, of: str = "") -> Iterator[None]:
        """A step, in a ``with``: where it fails, what was there before stays; names as of a `Fallback`."""
        try:
            yield
        except Exception as error:
            self.add(name, error, of=of)

    def add(self, step: str, error: BaseException, *, of: str = "") -> None:
        """Keep the finding on an error; raise the error where it is no failure of numbers or data.

        Raises `BaseException`: the error itself.
        """
        # Not every SeatrialError: a folder that cannot be written or a lost worker fails no step.
        refused = isinstance(error, CampaignError | SimulationError | TrialError | VehicleError)
        if not refused and not is_numerical(error):
            raise error
        cause = str(error) or type(error).__name__
        self.findings.append(Fallback(step, "refused" if refused else "numerical", cause, of))
