"""What the trials of a campaign propose, and that a proposal that is accepted is not made again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

import seatrial
from seatrial.base.arrays import Array
from seatrial.base.channels import DEGREE
from seatrial.base.rotation import from_euler, matrix, product
from seatrial.campaign.campaign import Campaign
from seatrial.check.campaign import check_campaign
from seatrial.intake.consistency_trials import consistency_of_trial, proposals
from tests.trial import motion

CWOLF = Path(seatrial.__file__).parent / "examples" / "cwolf"

CAMPAIGN = """
format = 1
name = "sea"
vehicle = "cwolf"
{head}
[trials.turn]
file = "trials/turn.toml"
reader = "generated"
[[stages]]
name = "sway and yaw"
trials = ["turn"]
axes = {{ free = "YN" }}
[stages.coefficients]
N_rr = [-1000.0, -50.0]
"""


def campaign(head: str = "", **trials: Any) -> Campaign:
    return Campaign.from_toml(CAMPAIGN.format(head=head), folder=CWOLF, trials=trials)


PLACES = "places = { velocity_m = [0.35, 0.0, 0.12] }\n"


def wrong() -> dict[str, Array]:
    """A recording with a turned heading, a reversed gyro, a late velocity in mm/s and a tilted sensor."""
    t = np.arange(0.0, 200.0, 0.1)
    table = motion.columns(t, velocity_late=0.3, noise=2e-3)
    q = product(from_euler([0.0, 0.0, -30.0 * DEGREE]), np.stack([table[f"q_{c}"] for c in "wxyz"], axis=1))
    names = ("u_m_s", "v_m_s", "w_m_s")
    v = 1e3 * np.stack([table[n] for n in names], axis=1) @ matrix(from_euler([0.0, 3.0 * DEGREE, 0.0]))
    table |= dict(zip(("q_w", "q_x", "q_y", "q_z"), q.T, strict=True)) | dict(zip(names, v.T, strict=True))
    return table | {"q_deg_s": -table["q_deg_s"]}


def test_law_accepted_proposals_leave_nothing_to_propose() -> None:
    frame = pl.DataFrame(wrong())
    made = campaign(turn=frame)
    found = consistency_of_trial(made, "turn")
    assert found is not None
    keys = {"heading_deg", "signs.q", "delay_s.velocity", "scale.velocity", "tilt_deg.velocity"}
    assert {one.key for one in found.corrections} == keys
    head = "[corrections]\n" + "\n".join(one.line for one in found.corrections)
    again = consistency_of_trial(campaign(head, turn=frame), "turn")
    assert again is not None
    assert again.corrections == ()


def test_what_reading_does_by_itself_comes_last_and_says_so() -> None:
    made = campaign(turn=pl.DataFrame(wrong()))
    found = consistency_of_trial(made, "turn")
    assert found is not None
    told = proposals({"turn": found}, {"turn": made.trials["turn"].report})
    assert [one.done for one in told] == sorted(one.done for one in told)
    assert "signs.q = -1 (reading does so by itself)" in next(
        one.text for one in told if "signs.q" in one.text
    )


def test_a_trial_that_was_given_as_one_is_not_compared() -> None:
    made = campaign()
    assert consistency_of_trial(campaign(turn=made.trials["turn"]), "turn") is None


def test_a_check_proposes_nothing_where_all_is_well() -> None:
    assert "Corrections proposed" not in check_campaign(campaign(PLACES)).summary()


def test_a_check_shows_the_line_to_paste_on_top_of_what_is_given() -> None:
    head = PLACES + "corrections.signs.q = -1\ncorrections.delay_s.rates = 0.5"
    made = check_campaign(campaign(head))
    lines = [one.text.partition("[corrections] ")[2] for one in made.proposals]
    assert "signs.q = 1" in lines
    delay = next(float(line.partition(" = ")[2]) for line in lines if line.startswith("delay_s.rates"))
    assert abs(delay) < 0.01
    assert made.report().worst == made.proposals[0].text
