"""What the model leaves on recordings of a campaign: how far a valid model may miss a log.

That is told by the campaign's own recordings: what the fitted vehicle leaves there, restarted as often and
sampled no faster than the log. For a trial of the campaign that is the rest of the same trial, which is
motion of the same kind, or all trials where the rest is short; for another log all trials.

Tests: ``tests/test_recorded_campaign.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.errors import CampaignError, TrialError
from seatrial.fitted import Fitted
from seatrial.recorded.campaign_log import CampaignLog, campaign_log
from seatrial.recorded.restarts import Restarts, restarts
from seatrial.recorded.spread import Spread, spread_of_reference
from seatrial.recorded.thinned import thinned
from seatrial.recorded.validity import FEWEST_WINDOWS

if TYPE_CHECKING:
    from seatrial.campaign import Campaign

__all__ = ["campaign_reference"]

_GIVE = "give --reference LOG: a log on which the model is known to hold (references=[...] in Python)"
_HAS = {
    "commands": "commands of the actuators",
    "measured": "no commands, but measured signals of the actuators",
    "tau": "no signals of the actuators, but a wrench",
}


def campaign_reference(
    campaign: Campaign, fit: Fitted, judged: CampaignLog, *, ahead_s: float, names: Sequence[str | Path] = ()
) -> Spread:
    """Spread of a valid model's errors: what the fitted vehicle leaves on recordings of the campaign.

    Parameters
    ----------
    campaign : Campaign
    fit : Fitted
    judged : CampaignLog
        Its own part is left out.
    ahead_s : float
        Time after which the prediction restarts, s.
    names : sequence of str or Path, optional
        Trials of the campaign, recordings or run directories of `seatrial fly` instead of the usual ones.

    Raises
    ------
    TrialError
        One cannot be read, or all together are too short.
    CampaignError
        A recording of the campaign is missing, or none has the input of the log.
    """

    def parts(one: CampaignLog) -> list[Restarts]:
        trial = thinned(one.log.trial, judged.log.trial.dt)
        spans: list[tuple[float | None, float | None]] = [(None, None)]
        if one.trial and one.trial == judged.trial:
            if judged.span is None:
                return []
            spans = [(None, judged.span[0]), (judged.span[1], None)]
        found = []
        for start, stop in spans:
            first = trial.t[0] if start is None else start
            last = trial.t[-1] if stop is None else stop
            if last - first > 0.5 * ahead_s:
                found.append(
                    restarts(fit.vehicle, trial, ahead_s=ahead_s, start_s=start, stop_s=stop, input=one.input)
                )
        return found

    if names:
        given = [campaign_log(campaign, name) for name in names]
        for name, one in zip(names, given, strict=True):
            if not one.trial and one.place is not None and one.place == judged.place:
                raise TrialError(
                    f"reference {name}: expected a log on which the model is known to hold, found the one"
                    " that is judged; give another one, or leave it out"
                )
        return spread_of_reference([part for one in given for part in parts(one)])
    if judged.trial:
        own = parts(judged)
        if sum(len(one.spans) for one in own) >= 2 * FEWEST_WINDOWS:
            return spread_of_reference(own)
    _refuse_missing(campaign)
    trials = [name for name in campaign.trials if campaign.input_of(name) == judged.input]
    if not trials:
        raise CampaignError(
            f"{judged.log.trial.name}: the log has {_HAS[judged.input]}, and no trial of {campaign.source} is"
            f" driven by such; log what drives the trials, or {_GIVE}"
        )
    return spread_of_reference([part for name in trials for part in parts(campaign_log(campaign, name))])


def _refuse_missing(campaign: Campaign) -> None:
    """Refuse a campaign whose trials do not stand there, with what may stand for them."""
    why = "trials tell what a valid model leaves unexplained"
    if not len(campaign.trials):
        raise CampaignError(f"{campaign.source}: expected trials, found none: {why}; {_GIVE}")
    for name in campaign.trials:
        path = campaign.path_of(name)
        if path is not None and not path.exists():
            raise CampaignError(
                f"{campaign.source}: trial {name!r}, key file: there is no file {path}, and {why}; correct"
                f" the path, or {_GIVE}"
            )
