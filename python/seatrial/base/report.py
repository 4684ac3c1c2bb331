"""A result described once, as plain data: three lines, then sections of tables and sentences.

A result holds numbers and findings. Its words are written in `seatrial.report.results`, above all results:
``report()`` of a result asks for them by `report_of`, ``summary()`` is `Report.text` of it, and the command
line shows the same report with rich (`seatrial.cli.console`). Held by tests/report/test_report.py.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

from seatrial.base.finding import Finding

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REPORT_FILE = "report.json"
"""Name of the report as plain data in a run directory; a page is rendered from it."""


@dataclass(frozen=True)
class Column:
    """Head of a column: name, unit (in the head, after a comma) and alignment of its cells."""

    name: str
    unit: str = ""
    align: Literal["left", "right"] = "right"

    @property
    def head(self) -> str:
        """Name and unit."""
        return f"{self.name}, {self.unit}" if self.unit else self.name


@dataclass(frozen=True)
class Table:
    """Cells as text under named columns; `note` explains them below."""

    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""

    @classmethod
    def of(
        cls,
        title: str,
        head: Sequence[str | Column],
        rows: Iterable[Sequence[str]],
        *,
        left: int = 1,
        note: str = "",
    ) -> Table:
        """Table whose first `left` columns are aligned to the left, the others to the right."""
        columns = (
            column if isinstance(column, Column) else Column(column, align="left" if k < left else "right")
            for k, column in enumerate(head)
        )
        return cls(title, tuple(columns), tuple(tuple(row) for row in rows), note)

    def filled(self) -> Table:
        """The table without columns that are empty in every row."""
        kept = [k for k in range(len(self.columns)) if any(row[k] for row in self.rows)]
        return replace(
            self,
            columns=tuple(self.columns[k] for k in kept),
            rows=tuple(tuple(row[k] for k in kept) for row in self.rows),
        )

    def text(self) -> str:
        """Aligned plain text with title and note; empty without rows."""
        shown = self.filled()
        if not shown.rows:
            return ""
        cells = [tuple(column.head for column in shown.columns), *shown.rows]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        lines = [
            "  ".join(
                cell.rjust(width) if column.align == "right" else cell.ljust(width)
                for cell, width, column in zip(row, widths, shown.columns, strict=True)
            ).rstrip()
            for row in cells
        ]
        return "\n".join(part for part in (self.title, "\n".join(lines), self.note) if part)


@dataclass(frozen=True)
class Section:
    """Tables, then sentences, under a title; `details` are shown only on request and in files."""

    title: str = ""
    sentences: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    details: bool = False


@dataclass(frozen=True)
class Report:
    """What a result says, the most important first."""

    title: str  #: Name of what was judged: a campaign, a vehicle, a flight.
    outcome: str  #: The result in a word or two: "identified", "failed", "interrupted".
    #: How good it is: a sentence with a number and a unit, against a limit or a baseline where there is
    #: one.
    good: str
    worst: str  #: The worst problem, a sentence.
    next_step: str  #: What to do next, a sentence.
    sections: tuple[Section, ...] = ()  #: Tables and sentences in the order of reading.

    def lines(self) -> tuple[str, str, str]:
        """How good, the worst problem, what to do next: a line each."""
        return (
            f"{self.title}: {self.outcome}. {as_sentence(self.good)}",
            f"Worst: {as_sentence(self.worst)}",
            f"Next: {as_sentence(self.next_step)}",
        )

    def shown(self, *, verbose: bool = True) -> Iterator[Section]:
        """Sections that have something to show, without details unless `verbose`; each sentence once."""
        shown_before = {_key(text) for text in (self.good, self.worst, self.next_step)}
        for section in self.sections:
            if section.details and not verbose:
                continue
            fresh = []
            for sentence in section.sentences:
                if _key(sentence) not in shown_before:
                    shown_before.add(_key(sentence))
                    fresh.append(sentence)
            tables = tuple(table for table in section.tables if table.rows)
            if fresh or tables:
                yield replace(section, sentences=tuple(fresh), tables=tables)

    @property
    def hidden(self) -> int:
        """Number of tables and sentences that only `verbose` shows."""
        count = [
            sum(len(s.sentences) + len(s.tables) for s in self.shown(verbose=wide)) for wide in (True, False)
        ]
        return count[0] - count[1]

    def section(self, title: str) -> Section:
        """The section of a title; an empty one where there is none."""
        return next((part for part in self.sections if part.title == title), Section(title))

    def text(self, *, verbose: bool = True) -> str:
        """The report as plain text: the three lines, then the sections."""
        parts = ["\n".join(self.lines())]
        for section in self.shown(verbose=verbose):
            body = [table.text() for table in section.tables]
            if section.sentences:
                body.append("\n".join(f"- {sentence}" for sentence in section.sentences))
            if section.title:
                body[0] = f"{section.title}\n{body[0]}"
            parts += body
        return "\n\n".join(parts)

    def _repr_html_(self) -> str:
        """The three lines and the first table, for a notebook."""
        return str(importlib.import_module("seatrial.report.results").html(self))

    def to_dict(self) -> dict[str, Any]:
        """The report as plain data, for `of_dict`."""
        return asdict(self)

    @classmethod
    def of_dict(cls, data: Mapping[str, Any]) -> Report:
        """Report of plain data.

        Raises
        ------
        ValueError
            The data are not those of a report.

        Examples
        --------
        >>> report = Report("cwolf", "flown", "complete", "nothing", "fly on")
        >>> Report.of_dict(report.to_dict()) == report
        True
        """
        from pydantic import TypeAdapter, ValidationError

        try:
            report = TypeAdapter(cls).validate_python(data)
        except ValidationError as error:
            wrong = error.errors()[0]
            raise ValueError(f"{'.'.join(map(str, wrong['loc']))}: {wrong['msg']}") from None
        for table in (table for section in report.sections for table in section.tables):
            if any(len(row) != len(table.columns) for row in table.rows):
                raise ValueError(f"table {table.title!r}: expected {len(table.columns)} cells in every row")
        return report

    def files(self) -> dict[str, str | bytes]:
        """Files of a run directory by name: the report as text, and as plain data."""
        data = json.dumps(self.to_dict(), ensure_ascii=False, indent=1)
        return {"summary.txt": self.text() + "\n", REPORT_FILE: data + "\n"}


class Reported:
    """What every result with a report has: its text, a line, its look in a notebook, its figures."""

    def report(self) -> Report:
        """How good, the worst problem, what to do next; then tables and sentences."""
        return report_of(self)

    def summary(self) -> str:
        """The report as text."""
        return self.report().text()

    def __str__(self) -> str:
        return self.summary()

    def __repr__(self) -> str:
        report = self.report()
        return f"{type(self).__name__}({report.title}: {report.outcome})"

    def _repr_html_(self) -> str:
        return self.report()._repr_html_()

    def plot(self, name: str = "") -> Figure:
        """Figure of the result, one of those that ``--figures`` writes.

        Parameters
        ----------
        name : str, optional
            Its name there; by default that which says most.

        Raises
        ------
        SeatrialError
            There is no such figure; the sentence names those that there are.
        """
        figure: Figure = importlib.import_module("seatrial.report.plot").plotted(self, name)
        return figure


def writer_of(result: object) -> Any:
    """Module that writes the words of a result; it lies above all results and is loaded when first needed."""
    return importlib.import_module("seatrial.report.results").writer_of(result)


def report_of(result: object, **options: Any) -> Report:
    """Report of a result, in the words of `seatrial.report.results`.

    `result`: a result of one of the classes that are named there; `options`: what the report of that class
    takes, such as ``truth`` of an identification.
    """
    report: Report = writer_of(result).report(result, **options)
    return report


def wording(writer: str) -> Any:
    """Module of `seatrial.report.results` by name; it lies above all results, and is loaded when needed."""
    return importlib.import_module(f"seatrial.report.results.{writer}")


def words_of(finding: Finding) -> str:
    """Problem and remedy of a finding about a recording."""
    words = wording("trial_findings")
    return f"{words.problem(finding)}; {words.remedy(finding)}"


def clause_of(what: object, writer: str) -> str:
    """A finding, or the like, as a clause in the words of a module."""
    return str(wording(writer).problem(what))


def sentence_of(finding: Finding, writer: str) -> str:
    """A finding as a sentence in the words of a module."""
    return str(wording(writer).sentence(finding))


def words_about(result: object, writer: str) -> list[str]:
    """Sentences about a part of a result in the words of a module."""
    return list(wording(writer).sentences(result))


_SHORT_WORDS = (
    "an", "as", "at", "by", "do", "if", "in", "is", "it", "no", "of", "on", "or", "so", "to", "up",
)  # fmt: skip
"""Words of two letters that begin a sentence: no symbol of a quantity is called so."""


def as_sentence(text: str) -> str:
    """The text with a capital first letter of its first word and a full stop."""
    text = text.strip()
    first = text.partition(" ")[0]
    # A symbol such as K_p or u and a command keep their case; an ordinary word begins with a capital.
    word = len(first) > 2 or first in _SHORT_WORDS
    ordinary = first.isalpha() and word and first.islower() and first != "seatrial"
    capital = text[:1].upper() + text[1:] if ordinary else text
    return capital if capital.endswith((".", "!", "?")) else f"{capital}."


def _key(text: str) -> str:
    """What two sentences that say the same have in common."""
    return text.strip().removesuffix(".").lower()


def appended(line: str, doubt: str) -> str:
    """A first line with a doubt about it behind it, without what to do about the doubt (after "; ").

    Examples
    --------
    >>> appended("2 of 2 requirements held", "a tenth of the vehicles are impossible; identify again")
    '2 of 2 requirements held. A tenth of the vehicles are impossible'
    """
    if not doubt:
        return line
    problem, _, _ = doubt.partition("; ")
    return f"{line.rstrip('.')}. {problem[0].upper()}{problem[1:]}"


def listed(names: Sequence[str]) -> str:
    """Names as in a sentence.

    Examples
    --------
    >>> listed(["surge", "pitch", "yaw"]), listed(["surge"]), listed([])
    ('surge, pitch and yaw', 'surge', '')
    """
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))
