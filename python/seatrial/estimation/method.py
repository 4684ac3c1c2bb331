"""Which criterion a joint estimate takes where its campaign leaves the choice to the recordings.

Output error takes all that a simulation misses for noise of the sensors. That holds for open loops, where
waves only widen the intervals. In a closed loop the commands answer the waves, the error is correlated with
the input, and gains are bent (Ljung 1999, section 13.4): predictions of a filter are compared then.

Tests: ``tests/estimation/test_method.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from seatrial.campaign.campaign import Campaign
from seatrial.campaign.file import Polish
from seatrial.trial.verdict import judge_trial
from seatrial.trial.waves import waves

__all__ = ["ByItself", "Method", "method_of"]

Method = Literal["output", "innovations"]


@dataclass(frozen=True)
class ByItself:
    """A method and why: ``why`` follows "because"; it is empty where output error has nothing against it."""

    method: Method
    why: str


def method_of(campaign: Campaign, trials: Sequence[str]) -> ByItself:
    """Method of the joint estimate of some trials: what the campaign asks for, or what the trials call for.

    Parameters
    ----------
    campaign : Campaign
    trials : sequence of str
        Names of the trials that are estimated jointly.
    """
    asked = campaign.file.polish
    if asked is None:  # standard deviations only
        return ByItself("output", "")
    if asked.method != "automatic":
        return ByItself(asked.method, "the campaign asks for it")
    for name in trials:
        trial = campaign.trials[name]
        swell = waves(trial)
        if swell is None:
            continue
        closed = [v for v in judge_trial(trial, campaign.vehicle).values() if v.kind != "open"]
        if closed:
            commands = ", ".join(dict.fromkeys(command for one in closed for command in one.commands))
            seen = f"in trial {name} {commands} answer measurements, in waves of {swell.period_s:.1f} s"
            if hindrance := _hindrance(asked):
                return ByItself("output", f"{seen}, {hindrance}")
            return ByItself("innovations", seen)
    return ByItself("output", "")


def _hindrance(asked: Polish) -> str:
    """What keeps a campaign from the method that its trials call for; "" where nothing does."""
    if asked.nuisances:
        return (
            f"but predictions of a filter cannot estimate {', '.join(asked.nuisances)}: correct the log by"
            " [corrections] and [clocks] and delete [joint.nuisances]"
        )
    return ""
