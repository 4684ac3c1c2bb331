"""Following a suggestion: one more line in the campaign file, bounds, the verdict of the hold-out score."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial._core import State, Vehicle
from seatrial.base.errors import CampaignError
from seatrial.base.work import Work
from seatrial.campaign.campaign import Campaign
from seatrial.campaign.suggestion import follow, followed_text, hold_out_change, try_suggestion
from seatrial.diagnosis.missing_terms import Suggestion
from seatrial.diagnosis.residual_analysis import suggested_bounds
from seatrial.identification.identification import Identification
from seatrial.scoring.score import Score
from seatrial.scoring.windows import ChannelScore

HEAD = """# The campaign of a summer.
format = 1
name = "made"
vehicle = "cwolf"
[trials.run]
file = "run.parquet" # 80 s
hold_out_s = [[60.0, 80.0]]
"""
SURGE = """
[[stages]]
name = "surge" # first
trials = ["run"]
axes = { free = "X" }
[stages.coefficients]
X_uu = [-30.0, -4.0] # drag

# What follows is for the other axes.
"""
SWAY = """
[[stages]]
name = "sway"
trials = ["run"]
axes = { free = "YN" }
coefficients = { Y_vv = [-900.0, -100.0] }
"""
POLISH = """
[polish]
segment_s = 20.0
"""


def suggestion(name: str, present: float = 0.0, value: float = -3.0, sigma: float = 0.5) -> Suggestion:
    return Suggestion(name, "N s/m", (), "u", "u", present, value, sigma, 5.0, 0.01)


def campaign(text: str) -> Campaign:
    return Campaign.from_toml(text, source="made.toml")


@pytest.mark.parametrize(
    ("text", "name", "line", "after"),
    [
        (HEAD + SURGE + SWAY, "X_vv", "X_vv = [-6.0, 3.0] # suggested: u residual follows u", "X_uu"),
        (HEAD + SURGE + POLISH, "X_vv", "X_vv = [-6.0, 3.0] # suggested: u residual follows u", "["),
        (HEAD + SWAY + SURGE, "stern.p2", '"stern.p2" = [-6.0, 3.0] # suggested', "X_uu"),
        (HEAD + SURGE + "[polish.coefficients]\nX_u = [-9.0, 0.0]", "X_vv", "X_vv = [-6.0, 3.0]", "X_u "),
    ],
)
def test_one_line_is_added_and_every_comment_stays(text: str, name: str, line: str, after: str) -> None:
    found = followed_text(campaign(text), suggestion(name))
    rows = found.splitlines()
    added = next(row for row in rows if row.startswith(line))
    assert rows[rows.index(added) - 1].startswith(after)
    kept = [row for row in rows if row not in (added, "[polish.coefficients]") and row]
    assert kept == [row for row in text.splitlines() if row and row != "[polish.coefficients]"]


def test_inline_coefficients_are_extended_in_their_line() -> None:
    found = followed_text(campaign(HEAD + SURGE + SWAY), suggestion("N_v"))
    assert "coefficients = { N_v = [-6.0, 3.0], Y_vv = [-900.0, -100.0] }" in found
    assert [p.name for p in campaign(found).problem().parameters["sway"]] == ["N_v", "Y_vv"]


def test_a_layout_that_cannot_be_edited_is_refused_with_the_line() -> None:
    text = HEAD + SURGE.replace("[stages.coefficients]\nX_uu", "coefficients.X_uu")
    with pytest.raises(CampaignError, match=r"stage 'surge'.*by hand: X_vv = \[-6.0, 3.0\]"):
        followed_text(campaign(text), suggestion("X_vv"))
    freed = campaign(HEAD + SURGE)
    with pytest.raises(CampaignError, match="cannot be added"):
        followed_text(freed, suggestion("X_uu", present=-9.0, value=-12.0))


def test_following_keeps_the_trials_that_were_given() -> None:
    frame = pl.DataFrame({"t_s": np.arange(0.0, 80.0, 0.1), "u_m_s": np.arange(0.0, 80.0, 0.1)})
    given_ = Campaign.from_toml(HEAD + SURGE, source="made.toml", trials={"run": frame})
    followed = follow(given_, suggestion("X_u"))
    assert [p.name for p in followed.problem().parameters["surge"]] == ["X_uu", "X_u"]
    assert len(followed.trials["run"]) == 800
    assert tomllib.loads(followed.text)["stages"][0]["coefficients"]["X_u"] == [-6.0, 0.0]


@given(
    st.floats(-1e3, 1e3),
    st.floats(-1e3, 1e3).filter(lambda x: abs(x) > 1e-3),
    st.floats(1e-3, 1e2),
    st.sampled_from(["X_vv", "X_u", "B"]),
)
def test_law_bounds_hold_present_and_estimate_with_room(
    present: float, step: float, sigma: float, name: str
) -> None:
    info = Vehicle.load("cwolf").coefficient_info()
    lower, upper = suggested_bounds(suggestion(name, present, present + step, sigma), info)
    assert lower <= min(present, present + step)
    assert upper >= max(present, present + step)
    least, most = info[name]["lower"], info[name]["upper"]
    if least is None or not least <= min(present, present + step) <= max(present, present + step) <= most:
        # Sums of decimals round: 0.1 is above 0.5 - 4 x 0.1.
        assert lower <= present + min(step, 0.0) - 4.0 * sigma + 1e-9
        assert upper >= present + max(step, 0.0) + 4.0 * sigma - 1e-9
    else:
        assert least <= lower < upper <= most


def judged(**r2: float) -> Identification:
    channels = {name: ChannelScore(value, 0.0, 0.0, 100) for name, value in r2.items()}
    score = Score(channels, ("run",), 10.0, 0, 0, ())
    scores = {"hold_out": {"ahead": {"run": score}}} if r2 else {}
    fit = SimpleNamespace(scores=scores, problem=SimpleNamespace(source="made.toml"))
    return cast(Identification, fit)


@pytest.mark.parametrize(
    ("after", "verdict"),
    [
        ({"u": 0.95, "v": 0.51}, "keep"),
        ({"u": 0.91, "v": 0.49}, "no difference"),
        ({"u": 0.90, "v": 0.30}, "drop"),
        ({"u": 0.95, "v": 0.30}, "mixed"),
    ],
)
def test_hold_out_alone_decides(after: dict[str, float], verdict: str) -> None:
    change = hold_out_change(judged(u=0.9, v=0.5), judged(**after))
    assert change.verdict == verdict
    assert change.to_dict()["r2"]["v"] == [0.5, after["v"]]


def test_without_hold_out_no_one_can_say() -> None:
    with pytest.raises(CampaignError, match=r"set hold_out or hold_out_s"):
        hold_out_change(judged(), judged(u=0.9))


def test_a_suggestion_that_is_true_is_kept(tmp_path: Path) -> None:
    truth = Vehicle.load("cwolf").with_coefficients({"X_u": -40.0, "X_uu": -5.0})
    (tmp_path / "model.toml").write_text(truth.with_coefficients({"X_u": 0.0}).to_toml())
    generator = np.random.default_rng(5)
    t = np.arange(0.0, 120.0, 0.1)
    steps = np.repeat(generator.uniform(-800.0, 800.0, 24), 50) * (t > 3.0)
    stern = ("SbU", "SbL", "PU", "PL")
    commands = {name: steps if name in stern else np.zeros(len(t)) for name in truth.actuators}
    run = truth.simulate(t, dict(commands), State(), free="X", max_step_s=0.02)
    speed = np.asarray(run.nu)[:, 0] + generator.normal(0.0, 0.004, len(t))
    frame = pl.DataFrame({"t_s": t, "u_m_s": speed, **{f"cmd.{name}": c for name, c in commands.items()}})
    budget = "[budget]\npopulation = 8\ngenerations = 10\nsimplex_rounds = 1\n"
    head = HEAD.replace('"cwolf"', '"model.toml"').replace("[[60.0, 80.0]]", "[[80.0, 120.0]]")
    made = Campaign.from_toml(head + budget + SURGE + POLISH, folder=tmp_path, trials={"run": frame})
    first = made.identify(work=Work(threads=1))
    assert first.assessment is not None
    best = first.assessment.residual_analysis.suggestions[0]
    assert "X_u" in (best.name, *best.alternatives)
    second, change = try_suggestion(made, best, before=first, work=Work(threads=1))
    assert change.verdict == "keep"
    # Noise of 0.004 m/s on speeds of 0.3 m/s leaves 2e-4; the suggestion is of first order, so it leads by an
    # alternative that looks alike.
    assert change.r2["u"][1] > 0.998
    assert second.assessment is not None
    assert not second.assessment.residual_analysis.suggestions


def test_a_delay_of_a_part_of_a_group_is_tied_and_not_negative() -> None:
    one = replace(suggestion("SbU.T_t", 0.02, 0.1, 0.05), members=("SbU.T_t", "PL.T_t"))
    freed = follow(campaign(HEAD + SURGE), one).problem().stages[0].coefficients["SbU.T_t"]
    assert freed.bounds == (0.0, 0.3)
    assert [tie.name for tie in freed.tie] == ["PL.T_t"]
