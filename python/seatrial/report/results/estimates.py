"""The words of identified coefficients: how many, which of two results and why, what cannot be, what failed.

Held by ``tests/identification/test_tally.py``, ``tests/identification/test_apparent_mass.py``,
``tests/identification/test_choice.py``, ``tests/identification/test_damping.py`` and
``tests/identification/test_fallbacks.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from seatrial.base.finding import Finding
from seatrial.estimation.estimator import damping_model
from seatrial.estimation.segment_model import STEP_SETTINGS, StageStep, sound_digits
from seatrial.identification.choice import CHOICE_SETTINGS, Choice, Evidence
from seatrial.identification.estimate import Tally
from seatrial.report.results.phrases import filled, templates


def tally(counts: Tally) -> str:
    """How many coefficients the trials determine, and what became of the others."""
    if counts.not_judged == counts.asked:
        what = "one coefficient" if counts.asked == 1 else f"{counts.asked} coefficients"
        return f"Whether the trials determine the {what} is not judged."
    others = [
        f"{count} {words}"
        for count, words in (
            (counts.weak, "weak"),
            (counts.not_identifiable, "not identifiable"),
            (counts.held, "hidden by feedback"),
            (counts.not_judged, "not judged"),
        )
        if count
    ]
    if others:
        plural = "" if counts.asked == 1 else "s"
        identified = f"{counts.identifiable} of {counts.asked} coefficient{plural}"
        return f"The trials determine {identified}; {', '.join(others)}."
    if counts.asked == 1:
        return "The trials determine the one coefficient."
    return f"The trials determine all {counts.asked} coefficients."


def mass(axis: str, size: float, sd: float | None = None) -> str:
    """A mass or an inertia with its unit."""
    what, unit = ("inertia", "kg m2") if axis in "KMN" else ("mass", "kg")
    return f"{what} {size:.3g}{'' if sd is None else f' ± {sd:.2g}'} {unit}"


def sentence(finding: Finding) -> str:
    """An apparent mass that the vehicle of the file cannot have."""
    axis, size, of_file = finding.subject, finding["mass"], finding["of_file"]
    by = "".join(f" ({name} {times:.3g} times its start)" for name, times in finding["growth"].items())
    return (
        f"{axis}: implausible, apparent {mass(axis, size)} is {size / of_file:.2g} times the {of_file:.2g} of"
        f" the vehicle file{by}, whose bounds allow {finding['low']:.2g} to {finding['high']:.2g}; a wrong"
        " thrust or lever arm, or an unmodelled delay, may appear as inertia"
    )


def step(stage_step: StageStep, dt: float) -> str:
    """What the search will not follow, and the bounds that mend it; empty where it follows all."""
    if not stage_step.fast:
        return ""
    most, rate = STEP_SETTINGS.most_search, f"{stage_step.rate:.3g} rad/s"
    limit = most * STEP_SETTINGS.search_rate_limit / dt
    consequence = (
        f"the search follows {limit:.3g} rad/s ({most} steps per sample of {dt:g} s) and takes faster ones"
        " for diverged"
    )
    named = [
        f"{name} no further than {sound_digits(good, bound)} (now {bound:.4g})"
        for name, bound, good in stage_step.fast
        if name
    ]
    if not named:
        return (
            f"the start vehicle itself has a rate of {rate}; {consequence}: check its masses, inertias and"
            " damping, or log at a higher rate"
        )
    return (
        f"the bounds admit vehicles with rates up to {rate}; {consequence}. To exclude them bound"
        f" {', '.join(named)}"
    )


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


def chosen(choice: Choice) -> str:
    """Which of the two is the result, why, and the figures of the other."""
    if not choice.stages:
        return f"The {choice.result} is the result: {choice.judged_on}"
    channels = choice.fallen if choice.result == "stages" and choice.fallen else tuple(choice.stages)
    figures = _figures({c: (choice.stages[c], choice.joint[c]) for c in channels})
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


def words(step: str, of: str = "") -> tuple[str, str, str]:
    """Name of a step that failed, what the result has instead, and what to do."""
    tables = templates("estimates")
    return filled(tables["name"][step], {"of": of}), tables["kept"][step], tables["remedy"][step]
