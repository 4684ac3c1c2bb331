"""Which criterion a joint estimate takes, and what its recordings say against it.

Output error takes all that a simulation misses for noise of the sensors. That holds for open loops, where
waves only widen the intervals. In a closed loop the commands answer the waves, the error is correlated with
the input, and gains are bent (Ljung 1999, section 13.4): predictions of a filter are compared then, with
``method = "automatic"``, or recommended. So they are where the vehicle runs away while its controls are held:
a simulation then leaves the log whatever the coefficients are.

Tests: ``tests/estimation/test_method.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from seatrial.campaign.campaign import Campaign
from seatrial.campaign.file import Polish
from seatrial.trial.instability import runs_away
from seatrial.trial.waves import waves

__all__ = ["ByItself", "Method", "method_of"]

Method = Literal["output", "innovations"]


@dataclass(frozen=True)
class ByItself:
    """A method and why: ``why`` follows "because"; it is empty where nothing speaks against output error."""

    method: Method
    why: str


def method_of(campaign: Campaign, trials: Sequence[str]) -> ByItself:
    """Method of the joint estimate of some trials: what the campaign asks for, or what they call for.

    Parameters
    ----------
    campaign : Campaign
    trials : sequence of str
        Names of the trials that are estimated jointly.
    """
    asked = campaign.file.polish
    if asked is None:  # standard deviations only
        return ByItself("output", "")
    if asked.method == "innovations":
        return ByItself(asked.method, "the campaign asks for it")
    if fled := _runs_away(campaign, asked, trials):
        if asked.method == "automatic" and not asked.nuisances:
            return ByItself("innovations", fled)
        return ByItself("output", f"{fled}, so that a simulation leaves the log: {_remedy(asked)}")
    for name in trials:
        trial = campaign.trials[name]
        if campaign.input_of(name) != "commands":  # a measured force is no command
            continue
        swell = waves(trial)
        if swell is None:
            continue
        closed = [v for v in campaign.verdicts(name).values() if v.kind != "open"]
        if closed:
            commands = ", ".join(dict.fromkeys(command for one in closed for command in one.commands))
            seen = f"in trial {name} {commands} answer measurements, in waves of {swell.period_s:.1f} s"
            if asked.method == "automatic" and not asked.nuisances:
                return ByItself("innovations", seen)
            return ByItself("output", f"{seen}, which bends gains: {_remedy(asked)}")
    return ByItself("output", "")


def _runs_away(campaign: Campaign, asked: Polish, trials: Sequence[str]) -> str:
    """Why a simulation of the campaign's vehicle leaves these trials; "" where it does not."""
    stages = {letter for stage in campaign.stages for letter in stage.axes.free}
    free = asked.axes.free if asked.axes is not None else "".join(stages)
    return runs_away(campaign.vehicle, [campaign.trials[name] for name in trials], free, asked.segment_s)


def _remedy(asked: Polish) -> str:
    """How to compare with a filter that knows waves."""
    if asked.nuisances:
        return (
            f'to compare with method = "innovations", which cannot estimate {", ".join(asked.nuisances)},'
            " correct the log by [corrections] and [clocks] and delete the nuisances"
        )
    return 'compare with method = "innovations"'
