"""The verdict on a log: words, plain data, requirements, metrics."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from seatrial.report.plot import gallery
from seatrial.report.plot.mission_log import _sensible, suspect_bars
from seatrial.verification.mission_log.judge_log import LogSettings, verify_log
from seatrial.verification.mission_log.verdict import LogVerdict
from seatrial.verification.requirement import Requirement
from tests.verification.recorded_logs import MISSION, fitted, log

HEAVY = (("B", 1329.35 - 15.0),)


@cache
def verdict() -> LogVerdict:
    return verify_log(
        fitted(),
        log(2, HEAVY),
        reference=log(100).trial,
        autopilot="cwolf",
        mission=MISSION,
        sensors="typical",
        settings=LogSettings(flights=40),
        requirements=[
            Requirement("keeps its path", "cross_track_p95_m <= 100"),
            Requirement("saves energy", "energy_wh <= 1"),
            Requirement("comes close", "missed_by_m < 2"),
        ],
    )


def test_a_verdict_reads_from_outcome_to_suspects_to_the_mission() -> None:
    text = verdict().summary()
    parts = ("seed 2: re-identify", "Suspected first", "1. ", "seen as their difference", "keeps its path")
    places = [text.index(part) for part in parts]
    assert places == sorted(places)
    words = text.split()
    assert words[words.index("saves") : words.index("saves") + 6] == [
        "saves",
        "energy",
        "energy_wh",
        "<=",
        "1",
        "FAILS",
    ]
    assert "the log does not tell missed_by_m" in text
    assert "closed-loop envelope of 40 flights" in text


def test_a_verdict_is_plain_data() -> None:
    data = json.loads(json.dumps(verdict().to_dict()))
    assert data["model"] == "re-identify"
    assert data["held"] is False
    assert [one["held"] for one in data["requirements"]] == [True, False, None]
    assert data["validity"]["channels"]["w"]["fails"] is True
    assert 0.0 <= data["envelope"]["outside"]["depth"] <= 1.0


def test_a_verdict_without_reference_says_what_is_missing() -> None:
    found = verify_log(fitted().vehicle, log(2))
    assert any("No reference was given" in note for note in found.notes)
    assert any("covariance is not known" in note for note in found.notes)


@pytest.mark.long
def test_figures_are_written(tmp_path: Path) -> None:
    written = gallery(verdict(), tmp_path, formats=("png",))
    assert {path.name for path in written} >= {"residuals.png", "suspects.png", "envelope.png"}
    assert all(path.stat().st_size > 10_000 for path in written if path.suffix == ".png")


def test_what_lasts_a_moment_does_not_flatten_a_panel() -> None:
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    steady = np.sin(np.linspace(0.0, 60.0, 1000))
    _sensible(axes, np.concatenate([np.full(20, -11.0), steady]))  # a turn on the spot before the mission
    low, high = axes.get_ylim()
    assert low > -3.0
    assert high > 1.0
    _sensible(axes, np.concatenate([np.full(100, -11.0), steady]))
    assert axes.get_ylim()[0] < -11.0


def test_suspects_have_true_minus_signs() -> None:
    shown = suspect_bars(verdict()).axes[0]
    named = [label.get_text() for label in shown.get_yticklabels()]
    assert not any(re.search(r"(^| )-\d", name) for name in named)
    assert any("\N{MINUS SIGN}" in name for name in named)


def test_the_second_best_explanation_leaves_more_than_the_best() -> None:
    listed = verdict().suspects
    assert listed[0].left <= min(one.left for one in listed) * 1.05
    assert 0.0 < listed[0].gain <= 1.0
    assert listed[0].name.startswith("payload") or listed[0].name in ("B", "m")
    assert pytest.approx(-15.0 / 9.81, rel=0.15) == -(
        listed[0].values[0] if listed[0].name.startswith("payload") else 15.0 / 9.81
    )
