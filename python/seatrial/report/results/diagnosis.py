"""The words of a diagnosis: what data do not tell, what contradicts an estimate, what residuals hold.

A problem and a remedy per kind of finding. Held by ``tests/diagnosis/test_weak_combination.py``,
``tests/diagnosis/test_residual_analysis.py`` and ``tests/estimation/test_innovations.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from seatrial.base.channels import AXES, VELOCITIES
from seatrial.base.finding import Finding
from seatrial.base.report import Table, listed
from seatrial.diagnosis.identifiability import SETTINGS as IDENTIFIABILITY_SETTINGS
from seatrial.diagnosis.missing_terms import SETTINGS, Suggestion
from seatrial.problem.settings import STRIPS
from seatrial.report.results import coefficient_advice as advice
from seatrial.report.results.coefficient_advice import Clauses

if TYPE_CHECKING:
    from seatrial.diagnosis.assessment import Assessment
    from seatrial.diagnosis.residual_analysis import ResidualAnalysis
    from seatrial.diagnosis.residual_signals import FollowedSignal


def problem(finding: Finding) -> str:
    """The problem, a clause."""
    return _CLAUSES[finding.kind](finding)[0]


def remedy(finding: Finding) -> str:
    """What to do about it; empty where nothing is to be done."""
    return _CLAUSES[finding.kind](finding)[1]


def sentence(finding: Finding) -> str:
    """Problem and remedy."""
    return "; ".join(filter(None, _CLAUSES[finding.kind](finding)))


def _small(finding: Finding) -> Clauses:
    judged, name = finding["judgement"], finding["names"][0]
    unit = "" if judged.unit == "1" else f" {judged.unit}"
    share = "far above"
    if judged.sd < 10.0 * abs(judged.value):
        share = f"{100.0 * judged.sd / abs(judged.value):.0f} % of"
    return (
        f"{name}: {judged.value:.3g} ± {judged.sd:.2g}{unit}, so that its standard deviation is {share} its"
        " value",
        f"hold it at zero and compare the held-out scores, or {advice.imperative(finding['manoeuvre'])}",
    )


def _strips_twice(finding: Finding) -> Clauses:
    name, both = finding.subject, finding["both"]
    trouble, way = advice.strips_twice(name, both)
    return f"{listed((name, *both))}: {trouble}", way


def _ill_conditioned(finding: Finding) -> Clauses:
    condition, most = finding["condition"], IDENTIFIABILITY_SETTINGS.ill_conditioned
    size = f"{condition:.1e}" if math.isfinite(condition) else "infinite"
    return (
        f"ill-conditioned: the condition number of the scaled sensitivities is {size}, at most {most:.0e} is"
        " sound",
        f"the search will wander along {', '.join(finding['along'])}",
    )


def _strayed(finding: Finding) -> Clauses:
    unit = finding["unit"]
    prior = f"{finding['prior']:.3g} ± {finding['prior_sd']:.3g} {unit}"
    value = f"{finding['estimate']:.3g} {unit}"
    return advice.strayed(finding.subject, value, away=abs(finding["away"]), prior=prior)


def _damping_undecided(finding: Finding) -> Clauses:
    return (
        f"{finding.subject} is not identified: it is {finding['fit']:.3g} with {finding['own']},"
        f" {finding['other']:.3g} with {finding['damping']}, and the log cannot tell which damping is right",
        f"{advice.imperative(finding['manoeuvre'])}, or hold it at a value that you trust",
    )


def _both(finding: Finding) -> str:
    return (
        f"{finding['other']:.3g} and the fit gives {finding['fit']:.3g}, {finding['away']:.1f} standard"
        " deviations of the difference apart"
    )


_LOG_RATES = "log the rates and angles exactly as the autopilot uses them"


def _commands_know(finding: Finding) -> Clauses:
    return (
        f"{finding.subject} is not identified: the commands of {listed(finding['commands'])} reacted to"
        f" motion that is not in the log; corrected for this, the estimate is {_both(finding)}",
        _LOG_RATES,
    )


def _bound_contradicted(finding: Finding) -> Clauses:
    name, bounded = finding.subject, finding["bounded"]
    widen = f"widen the bounds of {', '.join(finding['pulls'])} if values beyond are plausible, otherwise"
    if finding["tried"]:
        widen = f"wider bounds of {bounded} were tried and predict no better:"
    return (
        f"{name} is not identified: it compensates for the {finding['end']} bound of {bounded}, which the"
        f" data contradict by {finding['pull']:.1f} standard deviations; without such bounds it would be"
        f" {finding['other']:.3g} instead of {finding['fit']:.3g}",
        f"{widen} hold {name} at a value that you trust: the model lacks something there",
    )


def _nothing(finding: Finding) -> Clauses:
    trouble, _, way = finding["why"].rpartition("; ")
    return f"no coefficient is identified: {trouble}", way


_CLAUSES: dict[str, Callable[[Finding], Clauses]] = {
    "unexcited": lambda f: advice.unexcited(f["group"]),
    "nuisance": lambda f: advice.absorbed(f["names"], f["nuisance"]),
    "scale": lambda f: advice.scaled(f["names"], f["factor_sd"], fins=f["fins"]),
    "combination": lambda f: advice.inseparable(f["names"], pushed=f["pushed"], fins=f["fins"]),
    "small": _small,
    "strips twice": _strips_twice,
    "ill-conditioned": _ill_conditioned,
    "start diverges": lambda _: (
        "identifiability is judged after the search: the start vehicle diverges on every segment",
        "",
    ),
    "segments diverge": lambda f: (
        f"the warnings above use {f['used']} of {f['segments']} segments: on the others the start vehicle"
        " diverges",
        "",
    ),
    "nuisance strayed": _strayed,
    "damping undecided": _damping_undecided,
    "horizons disagree": lambda f: (
        f"{f.subject} is not identified: predictions {f['ahead_s']:g} s ahead give {_both(f)}",
        "hold it at a value that you trust, or add steps to the autopilot's output (seatrial plan)",
    ),
    "commands know more": _commands_know,
    "bound contradicted": _bound_contradicted,
    "nothing identified": _nothing,
    "draws impossible": lambda f: (
        f"{f['lost']} of {f['drawn']} drawn vehicles ({100 * f['share']:.2g} %) were physically impossible"
        " (damping that adds energy, negative mass or gain) and drawn again.",
        "",
    ),
    "draws doubtful": lambda f: (
        f"{100 * f['share']:.2g} % of the vehicles drawn from the standard deviations are physically"
        f" impossible, most often by {f.subject}, whose standard deviation is too large for its value",
        f"{advice.imperative(f['manoeuvre'])} and identify again, or hold it at a value that you trust",
    ),
    "missing term": lambda f: (missing_term(f["term"]), ""),
    "signal followed": lambda f: (followed(f["signal"]), ""),
    "residuals": lambda f: (warning(f["analysis"]), ""),
    "residual analysis": lambda f: (residuals(f["analysis"]), ""),
}


def sentences(assessment: Assessment) -> list[str]:
    """What to know before the numbers are used, the gravest first."""
    analysis = assessment.residual_analysis
    lines = [*method(assessment), *map(sentence, assessment.strayed())]
    if len(assessment.polished.costs) > 1:
        lines.append(_starts(assessment))
    lines += [] if analysis.warning is None else [analysis.warning]
    lines += assessment.identifiability.sentences
    lines += [suggestion.sentence for suggestion in analysis.suggestions]
    return [*lines, *(signal.sentence for signal in analysis.signals)]


def method(assessment: Assessment) -> list[str]:
    """The method of a joint estimate with a noise model, and what it refuses."""
    polished = assessment.polished
    if polished.method == "output":
        return [polished.method_reason] if polished.method_reason else []
    waves = polished.waves
    seen = f"waves of {waves['period_s']:.3g} s, " if waves else ""
    lines = [
        f"joint estimate by innovations: prediction errors of a filter with a model of {seen}slow forces and"
        f" current, because {polished.method_reason}",
        *map(sentence, assessment.refused()),
    ]
    alone = polished.log_alone
    if alone is not None and not alone.refused:
        lines.append(
            f"the commands of {listed(assessment.answering)} reacted to motion that is not in the log, which"
            f" biases gains; {_LOG_RATES}"
        )
    return lines


def _starts(assessment: Assessment) -> str:
    """Where the starts of the joint estimate ended."""
    costs = assessment.polished.costs
    same = int((costs < costs.min() + 1.0).sum())
    if same == len(costs):
        return f"all {same} starts of the joint estimate found the same optimum"
    return (
        f"{same} of {len(costs)} starts of the joint estimate found the best optimum, the others ended in"
        " worse ones"
    )


def assumption_table(assessment: Assessment) -> Table:
    """Estimates over other horizons, with other damping, and without bounds that the data contradict."""
    names, columns = [unknown.name for unknown in assessment.unknowns], assessment.assumptions()
    rows = [
        (
            name,
            f"{assessment.uncertainty.estimate[place]:.3g}",
            *(
                f"{other.values[name]:.3g} ({other.away[name]:+.1f})" if name in other.values else ""
                for _, other in columns
            ),
            "not identified" if any(name in other.refused for _, other in columns) else "",
        )
        for place, name in enumerate(names)
    ]
    title = "Estimates under other assumptions (in brackets: standard deviations from the fit)"
    head = ("coefficient", "fit", *(words for words, _ in columns), "")
    return Table.of(title, head, rows if columns else [], left=1)


def warning(analysis: ResidualAnalysis) -> str:
    """That the truth lies outside the model class, with the evidence."""
    evidence = [
        f"{row.channel} residual {row.excess:.2g} times the noise, correlated over {row.correlation_s:.2g} s"
        for row in analysis.coloured
    ]
    if analysis.suggestions:
        evidence.append(f"missing {', '.join(suggestion.name for suggestion in analysis.suggestions)}")
    evidence += [f"{signal.channel} follows {signal.signal}" for signal in analysis.signals[:3]]
    where = "The truth lies outside the model class"
    if not analysis.structural:
        where += " or the sensors' noise is not white"
    return (
        f"{where} ({'; '.join(evidence)}): intervals hold for the best model in the class; only the hold-out"
        " score shows whether a change is an improvement"
    )


def residuals(analysis: ResidualAnalysis) -> str:
    """A residual analysis, a line per suggestion and signal."""
    lines = [] if analysis.warning is None else [analysis.warning]
    for rank, suggestion in enumerate(analysis.suggestions, 1):
        lines.append(f"{rank}. {suggestion.sentence}")
        if suggestion.line:
            table = "the campaign's coefficients" if suggestion.nuisance is None else "[polish.nuisances]"
            lines.append(f"   line for {table}: {suggestion.line}")
    lines += [signal.sentence for signal in analysis.signals]
    if not analysis.suggestions:
        lines.append(f"None of the {analysis.tested} coefficients that were tried is missing")
    return "\n".join(lines)


def remedy_of_term(term: Suggestion) -> str:
    """What to do about a missing term, as an imperative."""
    if term.faster:
        return (
            f"lower {term.name} from {term.present:.3g} {term.unit} (0 at least), and check the time stamps"
            " of commands and sensors"
        )
    instead = f", and hold {' and '.join(STRIPS[term.name][::3])} at 0" if term.name in STRIPS else ""
    return f"free {term.name}{instead}"


def missing_term(term: Suggestion) -> str:
    """A missing term: what asks for it, what to free, what it would be and gain."""
    chance = "p < 1e-6" if term.p < 1e-6 else f"p = {term.p:.1g}"
    what = f"{term.channel} residual follows {term.follows}:"
    if term.faster:
        return f"{what} the actuator responds faster than the file says: {remedy_of_term(term)} ({chance})"
    names = (term.name, *term.alternatives)
    choice = " or ".join(names[: SETTINGS.named])
    if len(names) > SETTINGS.named:
        choice += f" (or one of {len(names) - SETTINGS.named} more that look alike)"
    if term.name in STRIPS:
        own = STRIPS[term.name]
        choice += f" and hold {own[0]} and {own[3]} at 0 (its strips make them)"
    unit = "" if term.unit == "1" else f" {term.unit}"
    return (
        f"{what} free {choice}; {term.name} would be {term.value:.3g} ± {term.sigma:.2g}{unit}, the cost"
        f" would fall by {term.gain:.2g} % ({chance})"
    )


def followed(signal: FollowedSignal) -> str:
    """What it means that a residual follows a signal, and what to do."""
    words = f"{signal.channel} residual follows {signal.signal} (R2 {signal.r2:.2g}),"
    if signal.lag_s == 0.0:
        return f"{words} as it is: {_sensor_advice(signal)}"
    after = "its integral" if math.isinf(signal.lag_s) else f"a lag of {signal.lag_s:g} s"
    return f"{words} with {after}: {_force_advice(signal)}"


def _sensor_advice(followed: FollowedSignal) -> str:
    channel, signal = followed.channel, followed.signal
    if signal == "a constant":
        return f"free the nuisance parameter bias_{channel}"
    if signal == f"d{channel}/dt":
        return f"the channel is late or early, free the nuisance parameter latency_{channel}"
    if followed.lever:
        return f"the sensor sits off the origin, free the nuisance parameter lever_{followed.lever}"
    if signal == "time":
        return "the sensor drifts, or the water does; free its bias per trial or use shorter trials"
    return "check the sensor's scale and alignment; a force that acts without delay looks the same"


def _force_advice(followed: FollowedSignal) -> str:
    axis = AXES[VELOCITIES.index(followed.channel)]
    kind, _, own = followed.signal.partition(" ")
    if kind == "command":
        return f"free {own}'s gain, levers or lag, or measure its characteristic"
    if kind == "wrench":
        if own == axis:
            return f"the recorded {own} is out of scale or late, check its unit and stamps"
        return f"the recorded {own} acts on {axis} too, check its point of action and its axes"
    if kind == "voltage":
        return "the thrust depends on the supply voltage, give a characteristic with the voltage"
    if kind == "time":
        return "something drifts (battery, trim, current), free a bias or a current per trial"
    if followed.status == "estimated":
        return f"{followed.coefficient} is already estimated, so its form or that of a related term is wrong"
    if followed.status == "held":
        return f"free {followed.coefficient}"
    return (
        "no coefficient has this form; free the most similar one or accept the error, and compare hold-out"
        " scores"
    )
