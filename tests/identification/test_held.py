"""What feedback hides in a field log keeps the vehicle file's value, unless another trial tells it."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from seatrial.base.errors import CampaignError
from seatrial.campaign.campaign import Campaign
from seatrial.identification.identification import Identification
from seatrial.identification.identify import conditional
from seatrial.identification.preparation import HELD_SETTINGS, Held, hold_untold
from seatrial.trial.trial import Trial
from tests.inspect.test_verdict import sailed

TEXT = """
format = 1
name = "made"
vehicle = "remus100"
[trials.log]
file = "log.csv"
hold_out_s = [[0.0, 480.0]]
[trials.other]
file = "other.csv"
[[stages]]
name = "sway"
trials = ["log"]
axes = { free = "Y", measured = "N" }
channels = { v = 1.0 }
budget = { generations = 2, simplex_rounds = 1 }
coefficients = { Y_vv = [-3000.0, -100.0] }
[[stages]]
name = "yaw"
trials = [TRIALS]
axes = { free = "N" }
channels = { r = 1.0 }
after = ["sway"]
budget = { generations = 2, simplex_rounds = 1 }
[stages.coefficients]
N_rr = [-900.0, -1.0]
"rudder.gain" = [0.1, 3.0]
[[stages]]
name = "again"
trials = ["log"]
axes = { free = "Y" }
after = ["yaw"]
coefficients = { Y_v = [-200.0, 0.0] }
budget = { generations = 2, simplex_rounds = 1 }
"""


def campaign(*, other: Trial | None = None, text: str = TEXT) -> Campaign:
    names = '"log"' if other is None else '"log", "other"'
    trials = {"log": sailed(1), "other": sailed(3) if other is None else other}
    return Campaign.from_toml(text.replace("TRIALS", names), source="made.toml", trials=trials)


@cache
def fitted() -> Identification:
    return campaign(text=TEXT.rpartition("[[stages]]")[0]).identify()


def test_what_feedback_hides_is_not_estimated_and_said_to_be_so() -> None:
    fit = fitted()
    own, before = fit.vehicle.coefficients(), fit.problem.vehicle.coefficients()
    held = ("N_rr", "rudder_upper.gain", "rudder_lower.gain")
    assert {one.name: one.value for one in fit.held} == {name: before[name] for name in held}
    assert {name: own[name] for name in held} == {name: before[name] for name in held}
    assert {row.name for row in fit.coefficients} == {"Y_vv"}
    assert [stage.name for stage in fit.stages] == ["sway"]
    report = fit.report()
    assert report.worst.startswith("yaw (N) is dominated by feedback")
    assert "Not identified, kept at the vehicle file's values: N_rr, rudder.gain" in report.worst
    assert report.next_step.startswith("run seatrial plan")
    assert "N dominated by feedback" in report.text()
    files = fit.files()
    assert "# rudder_upper.gain = 1 1: not identified" in str(files["vehicle.toml"])
    assert '"held": [' in str(files["identification.json"])


def test_an_estimate_moves_with_a_held_value_as_least_squares_say(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows y = A theta + B psi: theta moves by minus the regression of B d psi on A; not at a bound."""
    rows = np.random.default_rng(0).normal(size=(50, 5))  # three unknowns, the last at its bound; two held
    sigma = np.full(3, 1e-3)
    unknown = [
        SimpleNamespace(name=name, unit="1", scale=scale)
        for name, scale in zip("abc", (1.0, 40.0, 2.0), strict=True)
    ]
    joint, known, polished = (
        SimpleNamespace(unknowns=unknown, hidden=frozenset()),
        SimpleNamespace(at_bound=(None, None, "upper"), sigma=sigma),
        SimpleNamespace(values=np.zeros(3), initial=None, noise=None),
    )
    lin = SimpleNamespace(information=lambda: rows.T @ rows)
    monkeypatch.setattr("seatrial.identification.identify.linearise", lambda *given, **options: lin)
    held = [Held(f"{side}.gain", 2.0, "1", "fins.gain", "M", "", "") for side in ("port", "starboard")]
    given: Any = (joint, polished, held, known)
    found = {one.name: one for one in conditional(*given)}
    moved = np.linalg.lstsq(
        rows[:, :2], -rows[:, 3:] @ np.full(2, HELD_SETTINGS.error_share * 2.0), rcond=None
    )[0]
    assert found.keys() == {"a", "b"}
    assert [found["a"].change, found["b"].change] == pytest.approx(moved.tolist(), rel=1e-9)
    assert found["a"].deviations == pytest.approx(moved[0] / sigma[0], rel=1e-9)
    assert {one.on for one in found.values()} == {"fins.gain"}


def test_draws_say_that_they_keep_what_is_held() -> None:
    covariance = fitted().covariance
    assert covariance is not None
    assert any("rudder.gain" in note and "draws keep" in note for note in covariance.notes)


def test_a_stage_after_one_that_is_gone_follows_those_before_it() -> None:
    rest, _ = hold_untold(campaign().problem())
    assert {stage.name: stage.after for stage in rest.stages} == {"sway": (), "again": ("sway",)}


def test_a_trial_that_tells_the_axis_frees_its_coefficients() -> None:
    given = campaign(other=sailed(2, closed=False)).problem()
    assert hold_untold(given) == (given, ())


def test_a_gain_that_is_tied_to_one_that_is_told_follows_it() -> None:
    tied = TEXT.replace(
        '"rudder.gain" = [0.1, 3.0]', 'Y_vdot = { bounds = [-90.0, -5.0], tie = [{ name = "N_rdot" }] }'
    )
    rest, held = hold_untold(campaign(text=tied).problem())
    assert [one.name for one in held] == ["N_rr"]
    assert "Y_vdot" in rest.stages[1].coefficients


def test_nothing_left_is_refused_with_the_trial_that_tells() -> None:
    head, sway, yaw, _ = TEXT.split("[[stages]]")
    alone = "[[stages]]".join([head, yaw.replace('after = ["sway"]\n', "")])
    with pytest.raises(CampaignError, match=r"made\.toml: nothing is left to identify\. yaw .*seatrial plan"):
        campaign(text=alone).identify()
    assert sway
