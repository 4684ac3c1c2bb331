"""The model's part of a verdict on a log: outcome, reason, suspects, and what the log would have shown.

A current that was not recorded is no change of the vehicle: where it explains the log best, it is fitted to
the log (`seatrial.recorded.unrecorded_current`) and the model judged anew in it. What such a fit could hide
counts as not shown.

Tests: ``tests/test_recorded_validity.py``, ``tests/test_recorded_current.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from seatrial.fitted import Fitted
from seatrial.recorded.candidates import candidates
from seatrial.recorded.log_verdict import Detectable, Outcome
from seatrial.recorded.power import detectable_changes
from seatrial.recorded.restarts import Restarts, restarts
from seatrial.recorded.spread import Spread, spread_of_errors, spread_of_noise, spread_of_reference
from seatrial.recorded.suspect import Suspect
from seatrial.recorded.suspects import suspects
from seatrial.recorded.unrecorded_current import in_current, words
from seatrial.recorded.validity import FEWEST_WINDOWS, Validity, validity
from seatrial.trial import Trial

__all__ = ["ModelJudgement", "judge_model"]

_TOLD = 0.5
"""A log that would show none of the usual changes with this chance is too quiet."""

_MUCH, _MOST_OF_IT = 2.0, 0.9
"""More than twice the usual error left, and no nine tenths explained, is no single change of the vehicle."""

_QUIET: Outcome = "log too short or too quiet to tell"


@dataclass(frozen=True, eq=False)
class ModelJudgement:
    """What a log says of the model; attributes as those of `LogVerdict`."""

    outcome: Outcome
    reason: str
    validity: Validity | None = None
    suspects: tuple[Suspect, ...] = ()
    detectable: tuple[Detectable, ...] = ()
    notes: tuple[str, ...] = ()
    current: tuple[float, float] | None = None


def judge_model(
    known: Fitted,
    windows: Restarts,
    reference: Any,
    *,
    draws: int,
    seed: int,
    level: float,
    payload_density: float,
    ahead_s: float,
    offsets: Mapping[str, float],
) -> ModelJudgement:
    """Judgement of a model by a log, as `seatrial.recorded.verify_log` explains its parameters.

    Raises
    ------
    TrialError
        The reference cannot be used.
    """
    count = len(windows.spans)
    if not all(np.isfinite(one).all() for one in windows.predicted):
        reason = "The prediction diverges: the model cannot be this vehicle's, or its step is too long."
        return ModelJudgement("re-identify", reason)
    if count < FEWEST_WINDOWS:
        many = (
            f"{count} windows of {ahead_s:g} s are too few"
            if count > 1
            else f"One window of {ahead_s:g} s is too few"
        )
        reason = f"{many}; fly at least {2 * FEWEST_WINDOWS} of them, {2 * FEWEST_WINDOWS * ahead_s:g} s."
        return ModelJudgement(_QUIET, reason)
    spread, notes = _spread(reference, windows, ahead_s), []
    if reference is None:
        notes.append(
            "No reference was given: the band holds the log's own noise and the coefficients' spread, but not"
            " what every model leaves out; give a log on which the model is known to hold."
        )
    if not known.names:
        notes.append("The coefficients' covariance is not known: they count as exact.")
    notes.extend(known.notes)
    drawn = known.draws(draws, seed) if known.names else None
    judged = validity(windows, spread, draws=drawn, offsets=offsets, level=level)
    if not judged.failing:
        return _not_failing(judged, detectable_changes(judged, level=level), tuple(notes))
    sigma = dict(zip(known.names, np.sqrt(np.diag(known.covariance)), strict=True))
    tried = candidates(known.vehicle, identified=known.names, payload_density=payload_density)
    guilty, current, lead = suspects(windows, spread, tried, sigma=sigma), None, ""
    if windows.trial.current is None:
        calm, fitted = in_current(windows, spread)
        in_it = validity(calm, spread, draws=drawn, offsets=offsets, level=level)
        first = guilty[0] if guilty else None
        if first is not None and first.kind == "surroundings":
            windows, judged, current = calm, in_it, fitted
            lead = f"In {words(current)}, which was not recorded and is fitted to this log: "
            if not judged.failing:
                shown = detectable_changes(judged, level=level, current=True)
                return _not_failing(judged, shown, tuple(notes), current, lead)
            guilty = suspects(windows, spread, tried, sigma=sigma, current=False)
        elif not in_it.failing:
            other = "" if first is None else f" as well as this change: {first.change}"
            reason = (
                f"The log cannot tell a changed vehicle from the water: {words(fitted)}, which was not"
                f" recorded, explains it{other}. Log the current (zero in a tank), or fly more than one"
                " heading."
            )
            shown = detectable_changes(in_it, level=level, current=True)
            return ModelJudgement(_QUIET, reason, judged, guilty, shown, tuple(notes))
    failing = judged.failing
    listed = "; ".join(one.sentence() for one in failing[:3])
    text = f"{lead}{'t' if lead else 'T'}he log leaves the model's band in {_some(len(failing))}: {listed}."
    unexplained = not guilty or (guilty[0].left > _MUCH and guilty[0].gain < _MOST_OF_IT)
    text += f" {_NOTHING_EXPLAINS}" if unexplained else f" Suspected first: {guilty[0].change}."
    shown = detectable_changes(judged, level=level, current=current is not None)
    return ModelJudgement("re-identify", text, judged, guilty, shown, tuple(notes), current)


_NOTHING_EXPLAINS = (
    "No single change of the vehicle explains this log: check units, signs and the column map, the water's"
    " density and the supply, and that this vehicle flew it, before you identify anew."
)


def _not_failing(
    judged: Validity,
    shown: tuple[Detectable, ...],
    notes: tuple[str, ...],
    current: tuple[float, float] | None = None,
    lead: str = "",
) -> ModelJudgement:
    """Valid, or not told where the log would have shown nothing or leaves a doubt."""
    if max((one.power for one in shown), default=0.0) < _TOLD:
        best = max(shown, key=lambda one: one.power)
        reason = (
            f"{lead}{'t' if lead else 'T'}he log stays inside the band, but it would hardly have shown any"
            f" change ({best.change} with a chance of {100.0 * best.power:.0f} %): fly longer and faster, and"
            " change speed and depth."
        )
        return ModelJudgement(_QUIET, reason, judged, (), shown, notes, current)
    if doubtful := [one.sentence() for one in judged.channels.values() if one.doubtful]:
        reason = (
            f"{lead}{'m' if lead else 'M'}ore of the log is outside the band than a valid model should leave,"
            f" and less than would refute it: {'; '.join(doubtful[:3])}. Fly longer, or give longer"
            " references."
        )
        return ModelJudgement(_QUIET, reason, judged, (), shown, notes, current)
    blind = [one.change for one in shown if one.power < _TOLD]
    reason = (
        f"{lead}{100.0 * judged.outside:.1f} % of the log is outside the model's 95 % band,"
        " no channel by more than chance."
    )
    if blind:
        reason += f" It says nothing of {', '.join(blind)}."
    return ModelJudgement("model still valid", reason, judged, (), shown, notes, current)


def _spread(reference: Any, windows: Restarts, ahead_s: float) -> Spread:
    if reference is None:
        return spread_of_noise(windows)
    if isinstance(reference, Spread):
        return reference
    if isinstance(reference, Mapping):
        return spread_of_errors(reference, windows)
    given = [reference] if isinstance(reference, Trial) else list(reference)
    return spread_of_reference([
        restarts(windows.vehicle, one, ahead_s=ahead_s, input=windows.input) for one in given
    ])


def _some(count: int) -> str:
    return "one channel" if count == 1 else f"{count} channels"
