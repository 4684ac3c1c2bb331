"""What a field log cannot tell heads the report."""

from __future__ import annotations

from seatrial.campaign.campaign import Campaign
from seatrial.identification.identify import identify
from tests.trial.test_verdict import sailed

TEXT = """
format = 1
name = "made"
vehicle = "remus100"
[trials.log]
file = "log.csv"
[[stages]]
name = "yaw"
trials = ["log"]
axes = { free = "N" }
channels = { r = 1.0 }
budget = { generations = 3, simplex_rounds = 1 }
[stages.coefficients]
N_rr = [-900.0, -1.0]
"""


def test_an_axis_that_feedback_dominates_is_the_worst_problem() -> None:
    campaign = Campaign.from_toml(TEXT, source="made.toml", trials={"log": sailed(1)})
    report = identify(campaign).report()
    assert report.worst.startswith("yaw (N) is dominated by feedback")
    assert "Not identified, whatever is estimated: N_rr" in report.worst
    assert report.next_step == "take them out of [stages.coefficients] to keep the vehicle file's values"
