"""Following a suggestion: the campaign with one coefficient freed, and what the hold-out score says of it.

The campaign's text keeps its comments; one line is added. The residuals of the data that a model was fitted
to fall with every coefficient; only data held out of the fit tell whether the prediction is better.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

from seatrial.base.errors import CampaignError
from seatrial.base.plain import Plain
from seatrial.base.work import HERE, Work, callers_errors_pass, takes
from seatrial.campaign.campaign import Campaign
from seatrial.campaign.file import parse
from seatrial.diagnosis.missing_terms import Suggestion
from seatrial.diagnosis.residual_analysis import campaign_line
from seatrial.identification.hold_out import POOLED
from seatrial.problem.parameter import axes_of

if TYPE_CHECKING:
    from seatrial.identification.identification import Identification


LEAST_CHANGE = 0.02
"""Differences of R2 below this mean nothing."""

_HEADER = re.compile(r"\s*\[{1,2}([^\[\],]+)\]{1,2}\s*(#.*)?")


@dataclass(frozen=True)
class HoldOutChange(Plain):
    """Scores of two identifications of one campaign on what both held out, ten seconds ahead.

    `r2`: R2 per channel, (before, after). `verdict`: "keep" (better in a channel, worse in none), "drop"
    (worse in a channel, better in none), "mixed", or "no difference". Changes below 0.02 do not count.
    `sentence`: the same in words.
    """

    r2: Mapping[str, tuple[float, float]]
    verdict: Literal["keep", "drop", "mixed", "no difference"]
    sentence: str


def followed_text(campaign: Campaign, suggestion: Suggestion) -> str:
    """The campaign file's text with the suggested coefficient freed, comments kept.

    The coefficient goes to ``[polish.coefficients]`` where the file has a ``[polish]``, otherwise to the last
    stage that frees the axis of its force (the last stage, if it is of no axis), within `suggested_bounds`.

    Raises CampaignError where the file is laid out such that the line cannot be added safely; the message
    gives it.
    """
    entry = campaign_line(suggestion, campaign.vehicle.coefficient_info())
    ((name, setting),) = tomllib.loads(entry).items()
    part = "coefficients" if suggestion.nuisance is None else "nuisances"
    line = f"{entry} # suggested: {suggestion.channel} residual follows {suggestion.follows}"
    table, number = (
        ("stages", _stage(campaign, name))
        if campaign.file.polish is None and part == "coefficients"
        else ("polish", None)
    )
    before = tomllib.loads(campaign.text)
    owner = before.get(table, {}) if number is None else before[table][number]
    wanted: dict[str, Any] = {**owner.get(part, {}), name: setting}
    if table in before and name not in owner.get(part, {}):
        for text in _attempts(campaign.text, (table, number, part), line=line, entry=entry):
            try:
                after = tomllib.loads(text)
            except tomllib.TOMLDecodeError:
                continue
            changed = after[table] if number is None else after[table][number]
            same = [_without(data, table, number, part) for data in (before, after)]
            if changed.get(part) == wanted and same[0] == same[1]:
                return text
    where = f"[polish.{part}]" if number is None else f"stage {before[table][number]['name']!r}"
    raise CampaignError(
        f"{campaign.source}: {where}: {name!r} cannot be added to the text without changing more of it; add"
        f" this line to its {part} by hand: {entry}"
    )


def follow(campaign: Campaign, suggestion: Suggestion) -> Campaign:
    """The campaign with the suggested coefficient freed; its ``text`` is that of `followed_text`.

    Raises
    ------
    CampaignError
        As `followed_text`, or the coefficient cannot be freed there.
    """
    text = followed_text(campaign, suggestion)
    return campaign.with_file(parse(text, campaign.source), text=text)


def hold_out_change(before: Identification, after: Identification) -> HoldOutChange:
    """Change of the hold-out score between two identifications, and what to make of it.

    Raises CampaignError where nothing is held out that both could be judged by.
    """
    old, new = _held_out(before), _held_out(after)
    pairs = {channel: (old[channel], new[channel]) for channel in old if channel in new}
    gained = {channel: after_ - before_ for channel, (before_, after_) in pairs.items()}
    better = [channel for channel, change in gained.items() if change >= LEAST_CHANGE]
    worse = [channel for channel, change in gained.items() if change <= -LEAST_CHANGE]
    verdict: Literal["keep", "drop", "mixed", "no difference"]
    if better and worse:
        verdict, advice = "mixed", "keep it if the channels that gain are those that matter"
    elif better:
        verdict, advice = "keep", "keep it"
    elif worse:
        verdict, advice = "drop", "drop it"
    else:
        verdict, advice = "no difference", "no channel changes by 0.02; drop it, the smaller model is as good"
    changes = [f"{c} {pairs[c][0]:.3f} to {pairs[c][1]:.3f}" for c in (*better, *worse)]
    sentence = f"Hold-out R2 {', '.join(changes)}: {advice}" if changes else f"Hold-out R2: {advice}"
    return HoldOutChange(pairs, verdict, sentence)


@takes(work=Work)
@callers_errors_pass
def try_suggestion(
    campaign: Campaign, suggestion: Suggestion, *, before: Identification | None = None, work: Work = HERE
) -> tuple[Identification, HoldOutChange]:
    """Identification with the suggestion followed, and the change of the hold-out score.

    Parameters
    ----------
    campaign : Campaign
    suggestion : Suggestion
    before : Identification, optional
        The identification of the campaign as it is; made when not given.
    work : Work, optional
        As of `seatrial.identify`; the run directory is that of the followed campaign.

    Raises
    ------
    CampaignError
        The suggestion cannot be followed, or nothing is held out.
    """
    followed = follow(campaign, suggestion)
    first = campaign.identify(work=replace(work, run_dir=None)) if before is None else before
    _held_out(first)  # refuses before the second search
    second = followed.identify(work=work)
    return second, hold_out_change(first, second)


def _held_out(fit: Identification) -> dict[str, float]:
    """R2 per channel ten seconds ahead over all that is held out."""
    trials = fit.scores.get("hold_out", {}).get("ahead", {})
    score = trials.get(POOLED) or (next(iter(trials.values())) if len(trials) == 1 else None)
    if score is None:
        raise CampaignError(
            f"{fit.problem.source}: nothing is held out or it has no common score, so a further coefficient"
            " cannot be judged; set hold_out or hold_out_s of a trial"
        )
    return {channel: value for channel, value in score.r2.items() if math.isfinite(value)}


def _stage(campaign: Campaign, name: str) -> int:
    """Place in the file of the last stage that frees the axis of a coefficient's force."""
    axes = axes_of(name)
    free = [[letter for letter in axes if letter in stage.axes.free] for stage in campaign.problem().stages]
    most = max(map(len, free))
    fitting = [stage for stage, own in zip(campaign.problem().stages, free, strict=True) if len(own) == most]
    return [stage.name for stage in campaign.file.stages].index(fitting[-1].name)


def _attempts(text: str, place: tuple[str, int | None, str], *, line: str, entry: str) -> list[str]:
    """Texts with the line added where it may belong, the likeliest first; not all need be valid."""
    table, number, part = place
    lines = text.splitlines()
    headers = [(i, match[1].strip()) for i, row in enumerate(lines) if (match := _HEADER.fullmatch(row))]
    starts = [i for i, header in headers if header == table]
    if number is not None:
        starts = starts[number : number + 1]
    later = [i for i, header in headers if starts and i > starts[0] and header.split(".")[0] != table]
    end = later[0] if later else len(lines)
    if number is not None:
        following = [i for i, header in headers if starts and i > starts[0] and header == table]
        end = min([end, *following])
    attempts = []
    for i, header in headers:
        inside = number is None or (starts and starts[0] < i < end)
        if header == f"{table}.{part}" and inside:
            stop = next((j for j, _ in headers if j > i), len(lines))
            while stop > i + 1 and (not lines[stop - 1].strip() or lines[stop - 1].lstrip().startswith("#")):
                stop -= 1
            attempts += [[*lines[:stop], line, *lines[stop:]], [*lines[: i + 1], line, *lines[i + 1 :]]]
    if starts:
        for i in range(starts[0], end):
            opened = re.match(rf"\s*{part}\s*=\s*\{{", lines[i])
            if opened:
                rest = lines[i][opened.end() :]
                comma = "" if rest.lstrip().startswith("}") else ","
                attempts.append([*lines[:i], f"{opened[0]} {entry}{comma}{rest}", *lines[i + 1 :]])
        stop = next((j for j, _ in headers if j > starts[0]), len(lines))
        while stop > starts[0] + 1 and not lines[stop - 1].strip():
            stop -= 1
        attempts.append([*lines[:stop], "", f"[{table}.{part}]", line, *lines[stop:]])
    return ["\n".join(attempt) + "\n" for attempt in attempts]


def _without(data: Mapping[str, Any], table: str, number: int | None, part: str) -> Any:
    """The file's data without the coefficients or nuisances of one table."""
    if number is None:
        return dict(data) | {table: {k: v for k, v in data[table].items() if k != part}}
    rows = list(data[table])
    rows[number] = {k: v for k, v in rows[number].items() if k != part}
    return dict(data) | {table: rows}
