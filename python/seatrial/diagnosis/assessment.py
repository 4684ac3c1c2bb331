"""Assessment of an identification: joint estimate, intervals, what the data tell and what the model lacks.

Of the joint estimate where the campaign asks for one (``[polish]``) and it predicts better than the stages
(`seatrial.identification.choice`), else of the stages' result where it is.

An estimate that ends at a bound is not known, and what shares its influence on the data is bent as long as
the data pull it further: of a rudder under a yaw damping that may not become weaker, the gain grows
instead. Each coefficient at a bound is released alone; where the step of Gauss and Newton then leads more
than three standard deviations beyond the bound, the data contradict it. All these are released together,
and another coefficient that moves by more than two of its standard deviations, and by more than a
twentieth, is not identified: model or bound is wrong, and its value makes up for that. Standard deviations
are those of the released system, as much larger than with independent samples as the sandwich covariance
finds them (`seatrial.statistics.uncertainty`). Source of the step: Nocedal and Wright, *Numerical
Optimization* (2006), section 16.4 (multipliers of active bounds). Tests:
``tests/diagnosis/test_bounds.py``.

The covariance is checked two ways, where it matters. *Profile*: the criterion's smallest value with some
unknowns held along a line and the rest refitted. Where it leaves the parabola of the linearisation, standard
deviations mislead and the profile's own interval holds (Bates and Watts 1988, section 6.1). Correlated errors
raise the threshold by the ratio of the sandwich variance to the naive one. *Block bootstrap*: blocks are
weighted with exponential numbers (Bayesian bootstrap, Rubin 1981, Ann. Stat. 9:130): like drawing them with
replacement, but the only block that tells of an unknown is never lost. Each draw is one Gauss-Newton step
from the estimate; the centre of each prior is drawn from the prior. With few blocks its intervals are too
narrow, as those of every bootstrap of blocks (in the cases of `seatrial.statistics.uncertainty` they cover 78
to 90 %): they check those intervals and do not replace them. Tests: ``tests/statistics/test_uncertainty.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError
from seatrial.base.finding import Finding, Severity
from seatrial.base.plain import Plain
from seatrial.base.report import words_about
from seatrial.diagnosis.identifiability import Identifiability, judge, warnings_before
from seatrial.diagnosis.residual_analysis import ResidualAnalysis, analyse_joint, tried_terms
from seatrial.diagnosis.roles import Manoeuvre, manoeuvre, role
from seatrial.estimation.estimator import Horizon, LogAlone, OtherDamping, Polished
from seatrial.estimation.joint import Joint
from seatrial.estimation.joint_estimate import estimator, linearise, matters
from seatrial.problem.parameter import Parameter
from seatrial.statistics.blocks import (
    BlockLength,
    InformationCriteria,
    determined,
    information_criteria,
    whitened,
)
from seatrial.statistics.linearisation import Linearisation, Unknown
from seatrial.statistics.uncertainty import Uncertainty, covariance
from seatrial.vehicle.actuators import actuator_groups, fins_and_groups, pushed_axes

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.problem.problem import Problem


@dataclass(frozen=True)
class AssessmentSettings:
    """From where on data tell a coefficient, contradict a prior or a bound."""

    #: Segments that tell before a search what all of them will.
    preview_segments: int = 40
    #: Deviation of an estimate over that of what was known beforehand, up to which the data tell it: three
    #: quarters of what is known of it is theirs.
    told_share: float = 0.5
    #: Prior standard deviations from which a nuisance parameter is doubtful.
    far_sd: float = 3.0
    #: Deviations beyond a bound from which the data contradict it.
    contradicted_sd: float = 3.0
    #: Deviations by which another coefficient moves that makes up for the bound.
    moved_sd: float = 2.0


SETTINGS = AssessmentSettings()


@dataclass(frozen=True)
class Assessment:
    """How well an identification knows its coefficients, and what speaks against the model.

    Attributes
    ----------
    vehicle
        With the joint estimate.
    parameters
        Parameters of the campaign that were estimated jointly.
    unknowns
        The same and the nuisance parameters.
    polished
        How the joint estimate went; its ``rounds`` are zero where the campaign asks for none.
    uncertainty
        Standard deviations, 95 % intervals, correlations, block length.
    identifiability
        Verdict per coefficient, singular values, and a sentence per combination that the data cannot tell.
    criteria
        AIC and BIC, for the choice between models.
    residual_analysis
        Autocorrelation of the residuals, missing terms, signals that the residuals follow.
    bounds
        Bounds that the data contradict, and what the estimate would be without them; None without any.
    spoilt
        Why no coefficient is identified from these data, with the remedy behind a semicolon; mostly "".
    """

    vehicle: Vehicle
    parameters: tuple[Parameter, ...]
    unknowns: tuple[Unknown, ...]
    polished: Polished
    uncertainty: Uncertainty
    identifiability: Identifiability
    criteria: InformationCriteria
    residual_analysis: ResidualAnalysis
    bounds: ContradictedBounds | None = None
    spoilt: str = ""

    @property
    def verdicts(self) -> dict[str, str]:
        """Verdict by coefficient; what other assumptions contradict or a bound holds is not identifiable."""
        known = zip(self.uncertainty.names, self.uncertainty.at_bound, strict=True)
        lost = {name for name, bound in known if bound is not None}
        lost |= {name for horizon in self.polished.horizons for name in horizon.refused}
        lost |= {name for other in self.polished.others for name in other.refused}
        lost |= set() if self.polished.log_alone is None else set(self.polished.log_alone.refused)
        lost |= set() if self.bounds is None else set(self.bounds.refused)
        verdicts = self.identifiability.verdicts.items()
        judged = {
            name: "not identifiable" if self.spoilt or name in lost else verdict for name, verdict in verdicts
        }
        # What the data have hardly sharpened is known beforehand, and not identified.
        shares = zip(self.unknowns, self.uncertainty.sigma.tolist(), strict=True)
        presumed = {
            unknown.name for unknown, sigma in shares if sigma > SETTINGS.told_share * unknown.prior_sd
        }
        return {
            name: "weak" if name in presumed and verdict == "identifiable" else verdict
            for name, verdict in judged.items()
        }

    def of(self, name: str) -> Mapping[str, Any] | None:
        """Estimate, sigma, 95 % interval and verdict of a parameter; None if it is not in the estimate."""
        if name not in self.uncertainty.names:
            return None
        place = self.uncertainty.names.index(name)
        return {
            "estimate": float(self.uncertainty.estimate[place]),
            "sigma": float(self.uncertainty.sigma[place]),
            "lower": float(self.uncertainty.lower[place]),
            "upper": float(self.uncertainty.upper[place]),
            "verdict": self.verdicts.get(name),
            "prior": self.unknowns[place].prior,
            "prior_sd": self.unknowns[place].prior_sd,
        }

    def nuisances(self) -> list[dict[str, Any]]:
        """Name, unit, estimate, sigma and prior of every nuisance parameter; ``away`` in deviations of it."""
        return [
            {
                "name": unknown.name,
                "unit": unknown.unit,
                "estimate": float(self.uncertainty.estimate[place]),
                "sigma": float(self.uncertainty.sigma[place]),
                "prior": unknown.prior,
                "prior_sd": unknown.prior_sd,
                "away": (float(self.uncertainty.estimate[place]) - unknown.prior) / unknown.prior_sd,
            }
            for place, unknown in enumerate(self.unknowns)
            if unknown.kind == "nuisance"
        ]

    def strayed(self) -> list[Finding]:
        """Nuisance parameters three or more deviations from their prior, the farthest first."""
        far = [row for row in self.nuisances() if abs(row["away"]) >= SETTINGS.far_sd]
        return [
            Finding("nuisance strayed", Severity.PROBLEM, row["name"], row)
            for row in sorted(far, key=lambda row: -abs(row["away"]))
        ]

    @property
    def answering(self) -> tuple[str, ...]:
        """The groups of actuators whose commands answer more than the log holds."""
        groups = actuator_groups(self.vehicle)
        alone = self.polished.log_alone
        commands = () if alone is None else alone.commands
        return tuple(
            next((group for group, members in groups.items() if name in members), name) for name in commands
        )

    def refused(self, tried: Collection[str] = ()) -> list[Finding]:
        """Coefficients that other horizons, damping or bounds contradict: actuators first, worst first.
        ``tried``: those whose wider bounds predict no better.
        """
        names = [unknown.name for unknown in self.unknowns]
        fit = dict(zip(names, self.uncertainty.estimate.tolist(), strict=True))
        polished, answering = self.polished, {"commands": self.answering}
        refusals: list[Finding] = []

        def refuse(kind: str, other: Assumed, more: Mapping[str, Any]) -> None:
            for name in other.refused:
                values = {
                    "fit": fit[name],
                    "other": other.values[name],
                    "away": abs(other.away[name]),
                    **more,
                }
                refusals.append(Finding(kind, Severity.PROBLEM, name, values))

        for damping in polished.others:
            way = self._manoeuvre(damping.strips)
            words = {"own": damping.own, "damping": damping.damping, "manoeuvre": way}
            refuse("damping undecided", damping, words)
        for horizon in polished.horizons:
            refuse("horizons disagree", _named(names, horizon), {"ahead_s": horizon.ahead_s})
        if polished.log_alone is not None:
            refuse("commands know more", _named(names, polished.log_alone), answering)
        if self.bounds is not None:
            bounded, pull = max(self.bounds.pulls.items(), key=lambda pull: pull[1])
            end = self.uncertainty.at_bound[self.uncertainty.names.index(bounded)]
            bound = {"bounded": bounded, "pull": pull, "end": end, "pulls": tuple(self.bounds.pulls)}
            refuse("bound contradicted", self.bounds, {**bound, "tried": bounded in tried})
        # Gains of actuators first: an autopilot rests on them.
        ranked = sorted(refusals, key=lambda finding: ("." not in finding.subject, -finding["away"]))
        nothing = Finding("nothing identified", Severity.PROBLEM, values={"why": self.spoilt})
        return [nothing, *ranked] if self.spoilt else ranked

    def assumptions(self) -> list[tuple[str, Assumed]]:
        """Estimates over other horizons, with other damping and without bounds that the data contradict."""
        polished, names = self.polished, [unknown.name for unknown in self.unknowns]
        others: list[tuple[str, Assumed]] = [
            (f"{horizon.ahead_s:g} s ahead", _named(names, horizon)) for horizon in polished.horizons
        ]
        if polished.log_alone is not None:
            others.append(("the log alone", _named(names, polished.log_alone)))
        others += [(f"with {other.short}", other) for other in polished.others]
        return others if self.bounds is None else [*others, ("without bounds", self.bounds)]

    def _manoeuvre(self, name: str) -> Manoeuvre:
        """What this vehicle sails to tell a coefficient."""
        vehicle = self.vehicle
        return manoeuvre(role(name, pushed=pushed_axes(vehicle), fins=fins_and_groups(vehicle)))

    def sentences(self) -> list[str]:
        """What to know before the numbers are used, the gravest first."""
        return words_about(self, "diagnosis")

    def to_dict(self) -> dict[str, Any]:
        """All of it as plain numbers, texts and lists."""
        return {
            "polish": self.polished.to_dict([unknown.name for unknown in self.unknowns]),
            "nuisances": self.nuisances(),
            "uncertainty": self.uncertainty.to_dict(),
            "identifiability": self.identifiability.to_dict(),
            "information_criteria": self.criteria.to_dict(),
            "residual_analysis": self.residual_analysis.to_dict(),
            "bounds": None if self.bounds is None else self.bounds.to_dict(),
            "spoilt": self.spoilt,
            "sentences": self.sentences(),
        }


def conditioning(problem: Problem, *, threads: int | None = None) -> list[Finding]:
    """What the campaign's data cannot tell, judged at its start values before any search.

    Raises
    ------
    CampaignError, TrialError
        As for `seatrial.estimation.joint.Joint`.
    """
    joint = Joint(problem, threads=threads, method="output")
    lin = _of_a_part(joint)
    lost = sum(not piece.counted.any() for piece in lin.pieces)
    if lost and len(lin.pieces) < len(joint.data.segments):
        lin = linearise(joint, joint.start)
        lost = sum(not piece.counted.any() for piece in lin.pieces)
    if lost == len(lin.pieces):
        return [Finding("start diverges", Severity.NOTE)]
    warnings = warnings_before(lin)
    if lost and warnings:
        counts = {"used": len(lin.pieces) - lost, "segments": len(lin.pieces)}
        warnings.append(Finding("segments diverge", Severity.NOTE, values=counts))
    return warnings


def _of_a_part(joint: Joint) -> Linearisation:
    """Linearisation at the start; where segments are many, of a part that counts for all of them."""
    part, places = joint.thinned(SETTINGS.preview_segments)
    lin = linearise(part, joint.start)
    more = len(joint.data.segments) / len(places)
    return replace(lin, pieces=tuple(replace(piece, weight=more * piece.weight) for piece in lin.pieces))


@dataclass(frozen=True)
class _Named:
    """Such estimates, by name."""

    values: Mapping[str, float]
    away: Mapping[str, float]
    refused: tuple[str, ...]


Assumed: TypeAlias = "_Named | OtherDamping | ContradictedBounds"
"""Estimates under another assumption: values, SI, deviations from the fit, and which are not identified."""


def _named(names: Sequence[str], other: Horizon | LogAlone) -> _Named:
    """Estimates in the order of the unknowns, by their names."""
    values, away = (dict(zip(names, row.tolist(), strict=True)) for row in (other.values, other.away))
    return _Named(values, away, other.refused)


def assess(joint: Joint, polished: Polished) -> Assessment:
    """Assessment of the coefficients of a joint estimate, or of a start that no round was taken from.

    Parameters
    ----------
    joint : Joint
    polished : Polished
        Its estimate.

    Raises
    ------
    CampaignError
        The model diverges on every segment.
    """
    if estimator(joint).diverges(polished):
        raise CampaignError(
            f"{joint.problem.source}: polish: the model diverges on every segment; check the bounds"
        )
    polished = estimator(joint).otherwise(polished)
    # One linearisation for all: behind the derivatives by the unknowns stand those by what might be missing.
    tried = tried_terms(joint, polished.values, initial=polished.initial, noise=polished.noise)
    lin = tried.lin.of_first(len(joint.unknowns))
    uncertainty = covariance(lin)
    sigma = dict(zip(uncertainty.names, uncertainty.sigma.tolist(), strict=True))
    return Assessment(
        vehicle=joint.identified(polished.values),
        parameters=joint.estimated,
        unknowns=joint.unknowns,
        polished=polished,
        uncertainty=uncertainty,
        identifiability=judge(lin, sigma),
        criteria=information_criteria(lin),
        residual_analysis=analyse_joint(
            joint, polished.values, initial=polished.initial, noise=polished.noise, refits=0, tried=tried
        ),
        bounds=contradicted_bounds(lin, uncertainty),
    )


@dataclass(frozen=True)
class ContradictedBounds(Plain):
    """What the estimate would be without the bounds that the data contradict."""

    #: By how many standard deviations the data lead beyond the bound, by coefficient at a bound.
    pulls: Mapping[str, float]
    #: Of all unknowns without these bounds, to first order.
    values: Mapping[str, float]
    #: By how much of its standard deviation each unknown is away from the fit then.
    away: Mapping[str, float]
    #: Coefficients within their bounds that are not identified because of it, the worst first.
    refused: tuple[str, ...]


def contradicted_bounds(lin: Linearisation, known: Uncertainty) -> ContradictedBounds | None:
    """Bounds at the estimate that the data contradict; None where there are none."""
    ended = [place for place, bound in enumerate(known.at_bound) if bound is not None]
    inner = [place for place, bound in enumerate(known.at_bound) if bound is None]
    information, gradient = lin.information(), lin.gradient()
    with np.errstate(divide="ignore", invalid="ignore"):
        wider = np.where(np.isfinite(known.sigma) & (known.naive > 0.0), known.sigma / known.naive, 1.0)
    # Each bound by itself first: how far would its coefficient go without it?
    pulls = {}
    for place in ended:
        step, sd = _released(information, gradient, [*inner, place])
        outward = 1.0 if known.at_bound[place] == "upper" else -1.0
        pull = outward * step[place] / (sd[place] * wider[place])
        if pull > SETTINGS.contradicted_sd:
            pulls[place] = float(pull)
    if not pulls:
        return None
    # All that pull are released together: what else moves made up for the bounds.
    step, sd = _released(information, gradient, [*inner, *pulls])
    away = np.divide(step, sd * wider, out=np.zeros_like(step), where=sd > 0.0)
    coefficients = [place for place in inner if lin.unknowns[place].kind == "coefficient"]
    refused = [
        place
        for place in coefficients
        if abs(away[place]) > SETTINGS.moved_sd
        and matters(lin.values[place], lin.values[place] + step[place], lin.unknowns[place].scale)
    ]
    return ContradictedBounds(
        {known.names[place]: pull for place, pull in pulls.items()},
        dict(zip(known.names, (lin.values + step).tolist(), strict=True)),
        dict(zip(known.names, away.tolist(), strict=True)),
        tuple(known.names[place] for place in sorted(refused, key=lambda place: -abs(away[place]))),
    )


def _released(information: Array, gradient: Array, free: Sequence[int]) -> tuple[Array, Array]:
    """Step (m,) of the unknowns that are free, and their standard deviations (m,) of independent samples."""
    size = np.sqrt(np.maximum(np.diag(information)[free], np.finfo(float).tiny))
    inverse = np.linalg.pinv(
        information[np.ix_(free, free)] / np.outer(size, size), rcond=1e-10, hermitian=True
    )
    step, sd = np.zeros(len(gradient)), np.zeros(len(gradient))
    step[free] = inverse @ (gradient[free] / size) / size
    sd[free] = np.sqrt(np.diag(inverse)) / size
    return step, sd


Refit = Callable[[Mapping[str, float]], float]


@dataclass(frozen=True)
class Profile(Plain):
    """Criterion along a line through the estimate."""

    #: Unknowns that are held.
    names: tuple[str, ...]
    #: Places (k,) on the line in standard deviations, zero at the estimate.
    step: Array
    #: Values (k, n) of the held unknowns.
    values: Array
    #: Half the sum of squares (k,), priors included, above that of the refit at the estimate.
    cost: Array
    #: The same as the linearisation predicts it (k,).
    quadratic: Array
    #: Cost at the ends of the 95 % interval.
    threshold: float
    #: Those ends in ``step``, interpolated; infinite where the curve does not reach the threshold.
    lower: float
    upper: float


def profile(
    lin: Linearisation,
    refit: Refit,
    *,
    uncertainty: Uncertainty,
    direction: Mapping[str, float],
    reach: float = 3.0,
    points: int = 9,
) -> Profile:
    """Profile along a direction of one or several unknowns, evaluated from the estimate outwards.

    Parameters
    ----------
    lin : Linearisation
        At the estimate.
    refit : callable
        Smallest half sum of squares with the named unknowns held at these values.
    uncertainty : Uncertainty
        Of the same estimate; gives the length of a step and the threshold.
    direction : mapping
        Change of each unknown that is held, in its unit, in any length; ``{"X_u": 1.0}`` for one.
    reach : float
        Ends of the line in standard deviations. It is cut at the bounds.
    points : int
        Odd number of points, at least three.

    Raises
    ------
    ValueError
        An unknown name, no direction, or one that the linearisation does not determine.
    """
    names = tuple(direction)
    known = {unknown.name: index for index, unknown in enumerate(lin.unknowns)}
    missing = [name for name in names if name not in known]
    along = np.array([direction[name] for name in names], dtype=float)
    if missing or not np.any(along):
        raise ValueError(
            f"direction: expected changes of unknowns of the estimate that are not all zero, found"
            f" {dict(direction)}; unknowns: {', '.join(known)}"
        )
    if points < 3 or points % 2 == 0:
        raise ValueError(f"points: expected an odd number from 3 on, found {points}")
    # Without a standard deviation along the direction there is no length to step by.
    held = [known[name] for name in names]
    transform, undetermined = determined(lin.information())
    if undetermined[held].any():
        raise ValueError(
            f"direction: the estimate does not determine {', '.join(names)} separately, so there is no"
            " standard deviation to step by; step only unknowns that it determines, or give a prior"
        )
    # Curvature of the cost along the direction with all other unknowns at their best (Schur complement).
    part = transform[held]
    stiffness = np.linalg.inv(part @ part.T)
    dual = stiffness @ along
    curvature = float(along @ dual)
    variance = float(dual @ uncertainty.covariance[np.ix_(held, held)] @ dual) / curvature**2
    # One step is one standard deviation of the estimate along the direction.
    unit = along * np.sqrt(variance)
    step = np.linspace(-1.0, 1.0, points) * reach
    lower = np.array([lin.unknowns[index].lower for index in held])
    upper = np.array([lin.unknowns[index].upper for index in held])
    values = lin.values[held] + step[:, None] * unit
    inside = ((values >= lower) & (values <= upper)).all(axis=1)
    # The estimate itself stays, even where it ended a rounding error beyond a bound.
    inside[points // 2] = True
    step, values = step[inside], values[inside]
    cost = np.full(len(step), np.inf)
    # From the estimate outwards: a refit may start from the one before it.
    for index in np.argsort(np.abs(step), kind="stable"):
        cost[index] = refit(dict(zip(names, map(float, values[index]), strict=True)))
    cost -= cost[int(np.argmin(np.abs(step)))]
    # The threshold has the quantile of the interval of the estimate.
    factor = float(np.max((uncertainty.upper - uncertainty.estimate)[held] / uncertainty.sigma[held]))
    threshold = 0.5 * factor**2 * variance * curvature
    return Profile(
        names=names,
        step=step,
        values=values,
        cost=cost,
        quadratic=0.5 * step**2 * variance * curvature,
        threshold=threshold,
        lower=-_crossing(-step[step <= 0][::-1], cost[step <= 0][::-1], threshold),
        upper=_crossing(step[step >= 0], cost[step >= 0], threshold),
    )


def _crossing(step: Array, cost: Array, threshold: float) -> float:
    """First place where a cost that starts at zero reaches the threshold, by its root, which is straight
    where the cost is a parabola.
    """
    over = np.flatnonzero(cost >= threshold)
    if not len(over) or over[0] == 0:
        return np.inf
    before, after = over[0] - 1, over[0]
    root = np.sqrt(np.maximum(cost[[before, after]], 0.0))
    part = (np.sqrt(threshold) - root[0]) / (root[1] - root[0])
    return float(step[before] + part * (step[after] - step[before]))


_ABREAST = 256
"""Draws that are solved together: bounds the memory."""


@dataclass(frozen=True)
class Bootstrap:
    """Estimates ``draws`` (d, m) of resampled data, their standard deviation, 95 % percentile interval (m,).

    What neither data nor priors determine has an infinite standard deviation and interval.
    """

    draws: Array
    sigma: Array
    lower: Array
    upper: Array


def bootstrap(lin: Linearisation, *, draws: int, seed: int, length: BlockLength | None = None) -> Bootstrap:
    """Bootstrap over blocks of all channels together.

    Parameters
    ----------
    lin : Linearisation
    draws, seed : int
        Number of resampled data sets, at least two, and seed of the generator.
    length : BlockLength, optional
        By default the automatic `seatrial.statistics.blocks.block_length`.

    Raises
    ------
    CampaignError
        No sample counts.
    ValueError
        Fewer than two draws.
    """
    if draws < 2:
        raise ValueError(
            f"draws: expected at least 2, found {draws}; 1000 give the interval to a few per cent"
        )
    # Each draw weighs the blocks anew and moves the priors; one Gauss-Newton step gives its estimate.
    view = whitened(lin, length)
    generator = np.random.default_rng(seed)
    number, rank = view.score.shape
    size, vectors = np.linalg.eigh(view.pull)
    spread = (vectors * np.sqrt(np.maximum(size, 0.0))).T
    flat = view.information.reshape(number, -1)
    steps = []
    for first in range(0, draws, _ABREAST):
        count = min(_ABREAST, draws - first)
        weight = generator.standard_exponential((count, number))
        pull = weight @ view.score + generator.normal(size=(count, rank)) @ spread
        information = (weight @ flat).reshape(count, rank, rank) + view.prior
        steps.append(np.linalg.solve(information, pull[:, :, None])[:, :, 0])
    values = lin.values + np.concatenate(steps) @ view.transform.T
    lower, upper = np.quantile(values, (0.025, 0.975), axis=0)
    return Bootstrap(
        draws=values,
        sigma=np.where(view.undetermined, np.inf, values.std(axis=0, ddof=1)),
        lower=np.where(view.undetermined, -np.inf, lower),
        upper=np.where(view.undetermined, np.inf, upper),
    )
