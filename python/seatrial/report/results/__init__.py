"""The words of all results: which module writes those of which class.

Results lie in rooms below and know no words; `seatrial.base.report.report_of` comes here. Each module has a
function ``report``, and ``junit`` where a result is a verdict. Held by ``tests/report/test_report.py``.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable
from html import escape
from types import ModuleType

from seatrial.base.report import Report, Table

WRITERS = {
    "AutopilotCheck": "checks",
    "BenchTest": "bench_test",
    "CampaignCheck": "checks",
    "CExport": "links",
    "Comparison": "score",
    "Consistency": "trial_findings",
    "ExportedModel": "links",
    "FailureBoundary": "surveys",
    "Falsification": "surveys",
    "Flight": "flight",
    "FmuExport": "links",
    "Identification": "identification",
    "Imported": "imported",
    "ImportedModel": "links",
    "LeaveOneOut": "score",
    "LogTuning": "ardusub",
    "LogVerdict": "mission_log",
    "MissionCheck": "checks",
    "Plan": "plan",
    "RareFailures": "surveys",
    "RealtimeFlight": "links",
    "Replay": "ardusub",
    "Score": "score",
    "SimulatedTrial": "plan",
    "SitlSession": "links",
    "Survey": "imported",
    "Tuning": "tuning",
    "VehicleCheck": "checks",
    "Verification": "verification",
}
"""Module of this folder by the name of the result's class."""


def html(report: Report, *, most: int = 15) -> str:
    """The three lines and the first table of a report with at most so many rows, for a notebook."""
    lines = "<br>".join(map(escape, report.lines()))
    first = next((table for section in report.shown(verbose=False) for table in section.tables), None)
    return f"<p>{lines}</p>" + ("" if first is None else _table(first.filled(), most))


def _table(table: Table, most: int) -> str:
    def row(tag: str, cells: Iterable[str]) -> str:
        styled = zip(cells, table.columns, strict=True)
        made = (f'<{tag} style="text-align:{side.align}">{escape(cell)}</{tag}>' for cell, side in styled)
        return f"<tr>{''.join(made)}</tr>"

    more = len(table.rows) - most
    notes = (f"{more} more rows: print the summary()" if more > 0 else "", table.note)
    return (
        f"<table><caption>{escape(table.title)}</caption>"
        f"<thead>{row('th', (column.head for column in table.columns))}</thead>"
        f"<tbody>{''.join(row('td', cells) for cells in table.rows[:most])}</tbody></table>"
    ) + "".join(f"<p>{escape(note)}</p>" for note in notes if note)


def writer_of(result: object) -> ModuleType:
    """Module that writes the words of a result; TypeError where no report is written of such an object."""
    for kind in type(result).__mro__:
        if name := WRITERS.get(kind.__name__):
            return importlib.import_module(f"{__name__}.{name}")
    raise TypeError(f"expected a result that has a report, found {type(result).__name__}")
