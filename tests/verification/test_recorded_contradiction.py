"""A sensor that is stuck, reversed or late contradicts the other channels, and no coefficient is blamed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from seatrial.base.arrays import Array
from seatrial.base.channels import CHANNELS
from seatrial.trial.trial import Trial
from seatrial.verification.mission_log.judge_log import verify_log
from seatrial.verification.mission_log.validity import contradictions
from tests.verification.recorded_logs import compared, fitted, log

Fault = Callable[[Array, Array], Array]


def stuck(y: Array, late: Array) -> Array:
    noise = np.random.default_rng(1).normal(0.0, 0.01, len(y))
    return np.where(late, y[np.argmax(late)] + noise, y)


def reversed_(y: Array, late: Array) -> Array:
    return np.where(late, -y, y)


def spoilt(trial: Trial, channel: str, fault: Fault, from_s: float = 20.0) -> Trial:
    place = CHANNELS.index(channel)
    observed = trial.observed.copy()
    observed[:, place] = fault(observed[:, place], trial.t - trial.t[0] >= from_s)
    return replace(trial, observed=observed)


@pytest.mark.parametrize("seed", range(4))
def test_ordinary_logs_contradict_nothing(seed: int) -> None:
    assert contradictions(log(seed).trial, CHANNELS) == ()


@pytest.mark.parametrize(
    ("channel", "fault", "named"),
    [
        ("z", stuck, "z"), ("z", reversed_, "z"), ("yaw", stuck, "yaw"), ("x", stuck, "x"),
        ("r", reversed_, "yaw"),
        ("r", stuck, "yaw"), ("u", reversed_, "x"),
    ],
)  # fmt: skip
def test_a_sensor_that_fails_is_found_with_those_that_it_contradicts(
    channel: str, fault: Fault, named: str
) -> None:
    found = contradictions(spoilt(log(1).trial, channel, fault), CHANNELS)
    first = next(each for each in found if each.channel == named)
    assert channel in (first.channel, *first.against)
    assert first.slope < 0.5 or channel in first.against


def test_a_bias_a_current_and_a_scale_of_a_tenth_are_no_contradiction() -> None:
    trial = log(2).trial
    observed = trial.observed.copy()
    observed[:, CHANNELS.index("u")] = 1.1 * observed[:, CHANNELS.index("u")] + 0.1
    observed[:, CHANNELS.index("v")] += 0.2
    observed[:, CHANNELS.index("z")] += 3.0
    assert contradictions(replace(trial, observed=observed), CHANNELS) == ()


def test_a_stuck_depth_is_told_and_no_coefficient_is_suspected() -> None:
    honest = log(7)
    verdict = verify_log(
        fitted(), replace(honest, trial=spoilt(honest.trial, "z", stuck)), reference=log(100).trial
    )
    assert verdict.model == "not judged"
    assert not verdict.suspects
    report = verdict.report()
    assert report.worst.startswith("z contradicts u, v, w from ")
    assert report.next_step.startswith("find out which of them is wrong")
    assert compared(7).model == "model still valid"
