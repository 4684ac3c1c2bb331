"""Two runs of a kind beside one another: what came out, what went in, what moved."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import seatrial as st
from seatrial.base.report import Report
from seatrial.cli import app
from seatrial.report.page.run_folder import RunFolder, compared, numbers

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


def run(name: str, kind: str, results: Mapping[str, Any], **facts: Any) -> RunFolder:
    return RunFolder(name, {"kind": kind, **facts}, Report(name, "done", "", "", ""), results)


def estimate(name: str, value: float, sigma: float | None) -> dict[str, Any]:
    return {"name": name, "unit": "kg", "estimate": value, "sigma": sigma}


def rows(report: Report, title: str) -> list[tuple[str, ...]]:
    return [row for table in report.sections[0].tables if table.title == title for row in table.rows]


def test_an_estimate_moved_where_both_deviations_do_not_explain_it() -> None:
    before = run("a", "identification", {"coefficients": [
        estimate("X_udot", -10.0, 1.0), estimate("Y_vdot", -10.0, 1.0), estimate("Z_w", -4.0, None),
    ]})  # fmt: skip
    after = run("b", "identification", {"coefficients": [
        estimate("X_udot", -13.0, 1.0), estimate("Y_vdot", -12.5, 1.0), estimate("Z_w", -9.0, 0.1),
        estimate("N_r", -1.0, 0.1),
    ]})  # fmt: skip
    report = compared([before, after])
    assert report is not None
    # 3 is beyond 2 sqrt(2), 2.5 is not; what has no deviation moved nobody knows how far.
    assert [row[-1] for row in rows(report, "Estimates")] == ["moved", "", "", "new"]
    assert rows(report, "Estimates")[0] == ("X_udot", "kg", "-10 ± 1", "-13 ± 1", "-30.0%", "moved")
    assert report.good.startswith("1 estimates moved")
    assert report.worst == "X_udot: -10 ± 1 before, -13 ± 1 kg after"
    assert "same" in report.next_step


def test_gains_and_inputs_that_differ_are_listed_and_no_others() -> None:
    one = run("a", "tuning", {"gains": {"tuned": {"heading.K_P.1": 2.0, "surge.K_I.1": 3.0}}}, seed=1,
              sha256={"campaign": "1" * 64, "vehicle": "2" * 64}, options={"runs": 5})  # fmt: skip
    two = run("b", "tuning", {"gains": {"tuned": {"heading.K_P.1": 2.5, "surge.K_I.1": 3.0}}}, seed=2,
              sha256={"campaign": "3" * 64, "vehicle": "2" * 64}, options={"runs": 5})  # fmt: skip
    report = compared([one, run("c", "flight", {}), two])
    assert report is not None
    assert rows(report, "Gains that differ") == [("heading.K_P.1", "N m/rad", "2", "2.5")]
    assert [row[0] for row in rows(report, "Inputs and settings that differ")] == [
        "SHA-256 of campaign", "seed",
    ]  # fmt: skip
    assert compared([one]) is None
    assert compared([one, run("c", "flight", {})]) is None


@pytest.mark.parametrize("results", [{}, {"metrics": {}, "legs": None}, {"requirements": []}])
def test_results_of_another_version_have_no_numbers(results: dict[str, Any]) -> None:
    for kind in ("flight", "identification", "tuning", "verification", "plan"):
        assert numbers([run("a", kind, results)]) == []


def test_two_flights_are_compared_on_the_terminal_and_in_a_page(tmp_path: Path) -> None:
    for seed, current in ((1, 0.0), (2, 0.4)):
        water = st.Water(current=[0.0, current, 0.0])
        flight = st.fly("cwolf", "cwolf", st.Mission.from_toml(MISSION), water=water, seed=seed)
        flight.save(tmp_path / f"run{seed}")
    runs = [str(tmp_path / "run1"), str(tmp_path / "run2")]
    assert len(numbers([RunFolder.read(run) for run in runs])) == 4
    said = CliRunner().invoke(app, ["report", *runs])
    assert said.exit_code == 0, said.output
    assert said.stdout.startswith("run1 and run2: flight before and after.")
    for words in ("waypoints reached", "true cross-track error, rms", "current_m_s", "seed"):
        assert words in said.stdout
    assert CliRunner().invoke(app, ["report", *runs, "-o", str(tmp_path / "both.html")]).exit_code == 0
    page = (tmp_path / "both.html").read_text(encoding="utf-8")
    assert 'id="compared"' in page
    assert str(tmp_path) not in page
    alone = CliRunner().invoke(app, ["report", runs[0]])
    assert alone.exit_code == 2
    assert "--out FILE.html, or two runs of a kind" in " ".join(alone.stderr.split())
