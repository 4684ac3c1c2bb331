"""Results in a notebook: a line, three lines with one table, a figure, and a bar while the work goes on."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from importlib import import_module
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

import seatrial as st
from seatrial.base.report import Report, Reported, Section, Table
from seatrial.base.work import Progress, callers_errors_pass
from seatrial.check.autopilot import check_autopilot
from seatrial.check.vehicle import check_vehicle
from seatrial.report.plot import DRAWN, drawings, gallery
from seatrial.report.results import WRITERS

MISSION = """
format = 1
name = "out"
speed_m_s = 1.5
acceptance_radius_m = 5.0
[[legs]]
north_m = 30.0
east_m = 0.0
depth_m = 3.0
"""


@cache
def flight() -> st.Flight:
    return st.fly("cwolf", "cwolf", st.Mission.from_toml(MISSION))


def checks() -> list[Reported]:
    return [check_vehicle(st.Vehicle.load("cwolf")), check_autopilot(st.Autopilot.load("cwolf"))]


def test_a_result_is_a_line_where_it_is_printed_as_part_of_something() -> None:
    assert repr(flight()) == "Flight(cwolf on out: complete)"
    assert str(flight()) == flight().summary() == flight().report().text()
    for result in checks():
        assert repr(result).startswith(type(result).__name__)
        assert "\n" not in repr(result)


def test_a_cell_shows_the_three_lines_and_one_table() -> None:
    for result in [flight(), *checks()]:
        shown = result._repr_html_()
        assert shown.count("<br>") == 2
        assert shown.count("<table>") == 1
    words = Report("a < b", "c", "d & e", "f", "g", (Section(tables=(_table(16), _table(2))),))
    shown = words._repr_html_()
    assert "a &lt; b: c. d &amp; e.<br>" in shown
    assert shown.count("<tr>") == 1 + 15  # the head, and as many rows as a screen shows
    assert "1 more rows" in shown
    assert "more rows" not in replace(words, sections=(Section(tables=(_table(15),)),))._repr_html_()
    assert "<table" not in replace(words, sections=())._repr_html_()


def _table(rows: int) -> Table:
    return Table.of("Rows", ["name", "value"], [(f"row {k}", str(k)) for k in range(rows)])


def test_a_result_draws_the_figures_that_the_verbs_write(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Any
) -> None:
    assert list(drawings(flight())) == ["track", "loops", "actuators", "errors"]
    errors = flight().plot("errors")
    assert errors._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]
    drawn = [path.name for path in gallery(flight(), tmp_path, wanted=lambda name: name == "errors")]
    assert drawn == ["errors.png"]
    assert gallery(flight(), tmp_path, formats=()) == []
    with pytest.raises(st.SeatrialError, match="found 'eror'; did you mean \"errors\""):
        flight().plot("eror")
    with pytest.raises(st.SeatrialError, match="VehicleCheck: it has no figure"):
        checks()[0].plot()


def test_every_class_with_words_or_figures_shows_itself() -> None:
    for module, _ in DRAWN.values():
        assert callable(import_module(f"seatrial.report.plot.{module}").drawings)
    public = [getattr(st, name) for name in {*WRITERS, *DRAWN} & set(st.__all__)]
    assert len(public) > 10
    assert all(issubclass(kind, Reported) for kind in public)


def _state(fraction: float) -> Progress:
    return Progress("tuning", 1, 3, fraction, 4.0, 8.0)


def test_the_bar_of_a_notebook_is_one_output_that_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[str] = []
    opened = 0

    def display(bar: str, *, display_id: bool) -> SimpleNamespace:
        nonlocal opened
        opened += 1
        shown.append(bar)
        return SimpleNamespace(update=shown.append)

    ipython: Any = ModuleType("IPython")
    ipython.get_ipython = lambda: SimpleNamespace(kernel="is there")
    ipython.display = SimpleNamespace(HTML=str, display=display)
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    bar = st.ProgressBar()

    @callers_errors_pass
    def work(*, progress: Callable[[Progress], None]) -> int:
        progress(_state(0.25))
        progress(_state(0.26))  # too soon after the one before
        return 3

    assert work(progress=bar) == 3
    assert [text.partition("%")[0].split()[-1] for text in shown] == ["25", "100"]
    assert shown[0].startswith("<progress value=0.2500></progress>")
    assert "tuning [2/3]: about 8 s left" in shown[0]
    assert "done" in shown[1]
    assert opened == 1
    work(progress=bar)
    assert opened == 2  # another work has a bar of its own


def test_the_bar_of_a_terminal_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delitem(sys.modules, "IPython", raising=False)
    bar = st.ProgressBar()
    bar(_state(0.5))
    bar.finish()
    written = capsys.readouterr().err
    assert written.count("\r") == 2
    assert written.count("\n") == 1
