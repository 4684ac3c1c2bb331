"""The words of identified coefficients: how many the trials determine, and masses that no vehicle has.

Held by ``tests/identification/test_tally.py`` and ``tests/identification/test_apparent_mass.py``.
"""

from __future__ import annotations

from seatrial.base.finding import Finding
from seatrial.estimation.step import STEP_SETTINGS, StageStep, sound_digits
from seatrial.identification.estimate import Tally


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
