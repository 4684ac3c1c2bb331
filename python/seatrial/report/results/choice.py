"""The words of a choice: stages or joint estimate, with what is presumed, and which damping.

Held by ``tests/identification/test_choice.py`` and ``tests/identification/test_damping.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from seatrial.base.finding import Finding
from seatrial.estimation.estimator import damping_model
from seatrial.identification.choice import CHOICE_SETTINGS, Choice, Evidence


def judged_on(evidence: Evidence, ahead_s: float) -> str:
    """Which data judged, or why none did."""
    return {
        "held-out": "held-out data",
        "filter": f"held-out data, {ahead_s:g} s ahead from the state of a filter,",
        "ends": f"the last {100 * CHOICE_SETTINGS.judging_share:g} % of every trial, after a fit without it,",
        "replay": (
            "not compared with the stages, because nothing is held out (set hold_out_s); replaying commands"
            " that react to waves, without the waves, cannot test a model"
        ),
        "interrupted": "the joint estimate was interrupted and not judged",
        "none": "no data outside the fit could judge it; hold out a trial (hold_out, hold_out_s)",
    }[evidence]


def sentence(choice: Choice) -> str:
    """Which of the two is the result, why, and the figures of the other."""
    if not choice.stages:
        return f"The {choice.result} is the result: {choice.judged_on}"
    chosen = choice.fallen if choice.result == "stages" and choice.fallen else tuple(choice.stages)
    figures = _figures({c: (choice.stages[c], choice.joint[c]) for c in chosen})
    figures = f"(R2 {figures}, stages to joint estimate)"
    if choice.result == "stages":
        return (
            f"The stages are the result: the joint estimate predicts {choice.judged_on} worse {figures}. A"
            " missing model term biases the joint estimate: see the residual analysis, free fewer"
            " coefficients or leave a trial out of [polish]"
        )
    how = "better than" if choice.likelihood < -CHOICE_SETTINGS.even else "as well as"
    worse = f"; it is worse in {', '.join(choice.fallen)}" if choice.fallen else ""
    return (
        f"The joint estimate is the result: it predicts {choice.judged_on} {how} the stages {figures}{worse}"
    )


def presumed(
    names: Sequence[str], evidence: Evidence, ahead_s: float, r2: Mapping[str, tuple[float, float]]
) -> str:
    """Coefficients with a prior that are left out; R2 by channel without them and with them."""
    return (
        f"{', '.join(names)} stay at the vehicle's values: with them free the joint estimate predicts"
        f" {judged_on(evidence, ahead_s)} worse (R2 {_figures(r2)} when freed)"
    )


def damping(compared: Finding) -> str:
    """Which damping fits better, by how much, and which is kept."""
    better, by = compared["better"], ", which diverges"
    strips, quadratic = (
        damping_model(compared["strips"], compared["replaced"], by_strips=by_strips)
        for by_strips in (True, False)
    )
    chosen, rejected = (strips, quadratic) if better > 0.0 else (quadratic, strips)
    if math.isfinite(better):
        by = f", by {abs(better):.0f} ± {compared['sd']:.0f} in log-likelihood"
    kept = "" if compared["significant"] else ", which is not significant"
    kept += "; the latter is kept" if better > 0.0 and not compared["taken"] else ""
    data = "held-out data" if compared["held_out"] else "the log"
    return f"{chosen[0].upper()}{chosen[1:]} fits {data} better than {rejected}{by}{kept}"


def _figures(r2: Mapping[str, tuple[float, float]]) -> str:
    return ", ".join(f"{c} {_short(before)} to {_short(after)}" for c, (before, after) in r2.items())


def _short(value: float) -> str:
    return f"{value:.2f}" if value > -10.0 else f"{value:.0f}" if value > -1e5 else "diverged"
