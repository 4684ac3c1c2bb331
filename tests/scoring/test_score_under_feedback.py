"""Where feedback dominates an axis, no replay of its commands judges a model."""

from __future__ import annotations

import math
from functools import cache

import pytest

from seatrial.inspect.verdict import Verdict, blind, judge_trial
from seatrial.scoring.comparison import compare
from seatrial.scoring.score import score
from seatrial.trial.trial import Trial
from seatrial.verification.mission_log.judge_log import LogSettings, verify_log
from tests.inspect.test_verdict import VEHICLE, sailed

CHANNELS = ["v", "r", "yaw"]


@cache
def trials() -> tuple[Trial, Trial]:
    return sailed(1), sailed(2, closed=False)


def test_sway_rides_on_yaw() -> None:
    dominated, steps = trials()
    assert blind(judge_trial(dominated, VEHICLE)) == "YN"
    assert blind(judge_trial(steps, VEHICLE)) == ""


def test_an_informative_axis_in_waves_is_replayed_where_they_are_a_small_part() -> None:
    def letters(told: float, period_s: float) -> str:
        return blind({"N": Verdict("N", "closed and informative", ("rudder",), 0.5, told, 0.3, period_s)})

    assert [letters(0.6, 6.0), letters(0.8, 6.0), letters(0.3, math.nan)] == ["YN", "", ""]


def test_a_dominated_axis_has_no_score_and_heads_no_report() -> None:
    found = score(VEHICLE, trials()[0], free="YN")
    assert all(found[c].blind and math.isnan(found[c].r2) and found[c].n == 0 for c in CHANNELS)
    assert not {"v", "r"} & {
        *found.ceiling,
        *found.bands,
        *found.evidence,
        *found.baselines.get("hold last", {}),
    }
    report = found.report()
    assert report.good.startswith("no channel of s1 could be scored")
    assert "commands react to waves" in report.worst
    assert "seatrial plan" in report.next_step
    assert found.to_dict()["blind"]["r"] == ["s1"]
    assert "feedback" in report.text()


def test_pooled_scores_count_only_the_trials_that_judge() -> None:
    dominated, steps = trials()
    both, alone = (score(VEHICLE, given, free="YN") for given in ([dominated, steps], steps))
    assert both.blind == dict.fromkeys(CHANNELS, ("s1",))
    for channel in ("v", "r"):
        assert both[channel].n == alone[channel].n
        assert both.r2[channel] == pytest.approx(alone.r2[channel], rel=1e-12)
        rows = [one.baselines["hold last"][channel] for one in (both, alone)]
        assert rows[0] == pytest.approx(rows[1], rel=1e-12)


def test_vehicles_are_compared_on_the_trials_that_judge() -> None:
    other = VEHICLE.with_coefficients({"N_rr": -200.0})
    both, alone = (
        compare({"a": VEHICLE, "b": other}, given, free="YN").of("b")["r"]
        for given in ([*trials()], trials()[1])
    )
    assert both.windows == alone.windows
    assert both.r2_difference == pytest.approx(alone.r2_difference, rel=1e-12)


def test_a_log_does_not_refute_a_model_by_channels_that_feedback_dominates() -> None:
    found = verify_log(VEHICLE, trials()[0], settings=LogSettings(draws=1200, stop_s=150.0))
    assert found.model != "re-identify"
    assert found.validity is not None
    assert not {"v", "r", "yaw"} & set(found.validity.channels)
    assert "Not judged: v, r, yaw" in found.reason
