"""Margins of an autopilot's loops as a table: a row per mode, speed and loop.

Held by tests/control_design/test_margin_constraint.py.
"""

from __future__ import annotations

from collections.abc import Sequence

from seatrial.base.report import Column, Table
from seatrial.control_design.margin_report import ReportedMargins
from seatrial.control_design.tuning_table import ACCEPTED

SENSITIVITY_NOTE = (
    "Sensitivity: how much the loop enlarges a disturbance at worst,"
    f" accepted up to {ACCEPTED.sensitivity:g}."
)
"""Below every table of margins whose verdict may be the sensitivity."""


def margin_table(rows: Sequence[ReportedMargins], *, title: str = "Margins") -> Table:
    """The margins as a table of a report, a row per mode, speed and loop.

    Examples
    --------
    >>> row = ReportedMargins("cruise", 2.0, "heading", True, 29.1, 2.8, None, None, 61.2, 0.35, 3.05, 0.35,
    ...     1.16, 11.5, 60.3, 1.2)
    >>> margin_table([row]).rows
    (('cruise', '2.00', 'heading', '29.1', '-', '61', '3.05', '1.16', ''),)
    """

    def number(value: float | None, digits: int) -> str:
        return "-" if value is None else f"{value:.{digits}f}"

    cells = [
        (
            row.mode,
            f"{row.speed_m_s:.2f}",
            row.loop,
            number(row.gain_up_db, 1),
            number(row.gain_down_db, 1),
            number(row.phase_deg, 0),
            number(row.delay_s, 2),
            number(row.disk, 2),
            row.verdict,
        )
        for row in rows
    ]
    head = (
        "mode",
        "m/s",
        "loop",
        "up, dB",
        "down, dB",
        "phase, deg",
        "delay, s",
        "disk",
        Column("", align="left"),
    )
    note = (
        "Each loop opened alone; disk: gain and phase changed at once (disk margin, at most 2); last column:"
        f" what is less than accepted. {SENSITIVITY_NOTE}"
    )
    return Table.of(title, head, cells, note=note)
