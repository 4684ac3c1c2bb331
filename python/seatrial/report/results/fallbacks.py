"""The words of steps of an identification that failed: name, what the result has instead, and what to do.

Held by ``tests/identification/test_fallbacks.py``.
"""

from __future__ import annotations

_STAGES = "the result of the stages"

_CHECK = (
    "check the bounds, the damping of the free axes, and the signs and units of the commands; the rest of the"
    " result does not depend on this step"
)

_BEFORE = "the values from before the stage"

_WORDS = {
    "stage": (
        "stage {of!r}",
        _BEFORE,
        "check its bounds, and the signs and units of the commands of its trials",
    ),
    "stage impossible": (
        "stage {of!r}",
        _BEFORE,
        "let the stages that share masses and inertias follow one another (after)",
    ),
    "events": ("events", "the estimate on the whole log", "check bounds and damping of their axes"),
    "joint estimate": ("joint estimate", _STAGES, _CHECK),
    "round": ("round {of} of the joint estimate", "the estimate of the round before", _CHECK),
    "presumed": (
        "comparison without coefficients that have a prior (sd)",
        "the joint estimate with them",
        "leave them out of [polish] if their values are implausible",
    ),
    "strips": (
        "comparison with cross-flow drag by strips",
        "the joint estimate with quadratic damping",
        _CHECK,
    ),
    "proposals": (
        "rounds of proposals",
        "the joint estimate without what its residuals ask for",
        "free what the residual analysis names by hand",
    ),
    "choice": (
        "choice between stages and joint estimate",
        f"{_STAGES}, because nothing judged the joint estimate",
        "hold out data on which the model does not diverge (hold_out_s)",
    ),
    "stages anew": ("standard deviations of the stages", _STAGES, _CHECK),
    "deviations of the stages": (
        "standard deviations of the stages",
        f"{_STAGES}, without deviations",
        _CHECK,
    ),
    "deviations": ("standard deviations of the joint estimate", _STAGES, _CHECK),
    "dependence": ("dependence on held coefficients", "the estimates, without what they rest on", _CHECK),
    "restarts": ("states of the filter for the scores", "scores that restart from the smoothed log", _CHECK),
    "filter noise": (
        "noise of a navigation filter",
        "the default noise of a filter (the vehicle file has no [model_error])",
        "give NavigationFilter its force and acceleration, or check the vehicle: one sample of the log takes"
        " the model far from what was measured",
    ),
    "scores": ("scores", "the result without scores", _CHECK),
    "scale": (
        "scale of the forces",
        "the anchors, without what they say of the identified vehicle",
        "check the anchors of the campaign against the identified masses",
    ),
    "draws": (
        "vehicles drawn from the covariance",
        "the coefficients and their deviations, without a covariance to draw vehicles from",
        "give verify and tune percentages under [verification] coefficients",
    ),
}


def words(step: str, of: str = "") -> tuple[str, str, str]:
    """Name of a step, what the result has instead, and what to do."""
    name, kept, remedy = _WORDS[step]
    return name.format(of=of), kept, remedy
