"""Numbers that a page adds: intervals with correlations."""

from __future__ import annotations

from typing import Any

import pytest

from seatrial.base.report import Report
from seatrial.report.page.page import intervals
from seatrial.report.page.run_folder import RunFolder

COEFFICIENTS = [
    {"name": "X_u", "unit": "N s/m", "estimate": -3.5, "interval": [-3.7, -3.3], "verdict": "identifiable"},
    {"name": "X_uu", "unit": "N s2/m2", "estimate": -12.777, "interval": [-13.0, -12.5], "verdict": None},
    {"name": "B", "unit": "N", "estimate": 1331.669, "interval": [1331.0, 1332.0], "verdict": None},
    {"name": "Z_w", "unit": "N s/m", "estimate": -20.0, "interval": None, "verdict": "not identifiable"},
]


def of(**results: Any) -> RunFolder:
    return RunFolder("a", {"kind": "identification"}, Report("a", "b", "c", "d", "e"), results)


def test_intervals_name_the_coefficients_that_depend_on_one_another() -> None:
    matrix = [[0.01, -0.0095, 0.0], [-0.0095, 0.01, 0.001], [0.0, 0.001, 0.04]]
    covariance = {"names": ["X_u", "X_uu", "B"], "at": [0.0] * 3, "matrix": matrix}
    table = intervals(of(coefficients=COEFFICIENTS, covariance=covariance))
    assert table is not None
    rows = {row[0]: row for row in table.rows}
    assert list(rows) == ["X_u", "X_uu", "B"]  # nothing is known of the last
    assert rows["X_uu"][2:5] == ("−12.78", "−13", "−12.5")
    assert rows["X_u"][-1] == "X_uu −0.95"
    assert rows["X_uu"][-1] == "X_u −0.95"
    assert rows["B"][-1] == ""  # 0.05 is none to speak of


def test_intervals_without_a_covariance_or_of_another_run() -> None:
    table = intervals(of(coefficients=COEFFICIENTS))
    assert table is not None
    assert [row[-1] for row in table.rows] == ["", "", ""]
    assert intervals(of(coefficients=[{"name": "X_u"}])) is None
    assert intervals(of(coefficients=[{"interval": [1.0, 2.0]}])) is None  # of another version
    flight = RunFolder(
        "a", {"kind": "flight"}, Report("a", "b", "c", "d", "e"), {"coefficients": COEFFICIENTS}
    )
    assert intervals(flight) is None


@pytest.mark.parametrize(
    ("kind", "outcome", "results", "held"),
    [
        ("falsification", "falsified", {}, False),
        ("falsification", "not falsified", {}, None),
        ("rare failures", "held", {}, True),
        ("verification", "undecided", {"outcome": "undecided"}, False),
        ("verification", "held", {"outcome": "held"}, True),
        ("flight", "complete", {"complete": False}, False),
        ("identification", "identified", {}, None),
    ],
)
def test_a_badge_looks_like_the_outcome(
    kind: str, outcome: str, results: dict[str, object], held: bool | None
) -> None:
    run = RunFolder("a", {"kind": kind}, Report("a", outcome, "c", "d", "e"), results)
    assert run.held is held
