"""A report: three lines first, each sentence once, details on request, columns without content left out."""

from __future__ import annotations

from io import StringIO

import pytest
from rich.console import Console

from seatrial.base.report import Column, Report, Section, Table
from seatrial.cli.console import show

TABLE = Table.of(
    "Speeds",
    [Column("loop", align="left"), Column("speed", "m/s"), "note"],
    [("surge", "1.25", ""), ("sway", "-0.5", "")],
    note="On a straight course",
)
REPORT = Report(
    title="cwolf",
    outcome="identified",
    good="predicts held-out motion 10 s ahead with R2 0.93 in u",
    worst="K_p is not identifiable: nothing rolls in these trials",
    next_step="record a free decay in roll",
    sections=(
        Section(
            tables=(TABLE,), sentences=("Scale rests on the bench test", "Scale rests on the bench test.")
        ),
        Section(
            "Remarks",
            ("K_p is not identifiable: nothing rolls in these trials", "A long remark"),
            details=True,
        ),
        Section("Nothing", tables=(Table.of("Empty", ["a"], []),)),
    ),
)


def test_three_lines_stand_first_as_sentences() -> None:
    assert REPORT.text().splitlines()[:3] == [
        "cwolf: identified. Predicts held-out motion 10 s ahead with R2 0.93 in u.",
        "Worst: K_p is not identifiable: nothing rolls in these trials.",
        "Next: Record a free decay in roll.",
    ]


def test_a_sentence_is_said_once_and_details_only_on_request() -> None:
    whole, short = REPORT.text(), REPORT.text(verbose=False)
    assert whole.count("Scale rests") == 1
    assert whole.count("nothing rolls") == 1
    assert "A long remark" in whole
    assert "A long remark" not in short
    assert "Nothing" not in whole
    assert REPORT.hidden == 1


def test_a_table_aligns_numbers_to_the_right_and_drops_empty_columns() -> None:
    assert TABLE.text().splitlines() == [
        "Speeds",
        "loop   speed, m/s",
        "surge        1.25",
        "sway         -0.5",
        "On a straight course",
    ]


def test_the_terminal_shows_the_same_words_and_says_what_it_hides() -> None:
    stream = StringIO()
    show(REPORT, Console(file=stream, width=80))
    said = stream.getvalue()
    assert said.splitlines()[:3] == list(REPORT.lines())
    for words in (
        "speed, m/s",
        "1.25",
        "- Scale rests on the bench test",
        "1 more tables and remarks: --verbose",
    ):
        assert words in said
    stream = StringIO()
    show(REPORT, Console(file=stream, width=80), verbose=True)
    assert "- A long remark" in stream.getvalue()
    assert "--verbose" not in stream.getvalue()


@pytest.mark.parametrize("width", [30, 60, 100, 140])
def test_no_word_and_no_number_is_broken_however_narrow_the_terminal(width: int) -> None:
    head = ["coefficient", "fit", *(f"{ahead} s ahead" for ahead in (0.2, 0.5, 2, 5)), ""]
    row = ["rudder.gain", "0.226", *("-23.2 (-2.4)" for _ in range(4)), "not identified"]
    stream = StringIO()
    show(
        Report("log", "", "", "", "", (Section(tables=(Table.of("Estimates", head, [row]),)),)),
        Console(file=stream, width=width),
    )
    (line,) = (line for line in stream.getvalue().splitlines() if "gain" in line)
    assert line.split() == " ".join(row).split()
