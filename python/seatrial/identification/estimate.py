"""Coefficients as an identification found them: start, bounds, deviation, verdict, meaning, covariance.

The joint estimate's covariance V is that of parameters; a parameter sets its members by factors F, so that
the coefficients have ``F' V F``: what is tied moves together. Data tell some combinations badly or not at
all, and the sandwich has no number for the latter. The campaign's bounds say how far they may lie: in widths
of the bounds no direction is taken as wider than a number anywhere inside them, a standard deviation of
``1/sqrt(12)`` (that of `seatrial.diagnosis.identifiability`). Larger eigenvalues are cut there, and
directions without information, the right singular vectors of zero, get it. What the data do tell stays.

The bench test's thrust counts as exact in the joint estimate. Its own standard deviation at the strongest
point comes on top, common to the actuators that were pulled together, without refitting the rest, although a
wrong thrust would move the damping along with it: the vehicles drawn are a little more unlike than they need
to be. It is the covariance of the best model in the class. Where the truth lies outside
(`seatrial.diagnosis.residual_analysis`), it may be many of these standard deviations away; nor does it hold
the common factor of all forces, which trials do not tell (`seatrial.estimation.scale`). The notes say both.

Tests: ``tests/identification/test_identify.py``, ``tests/diagnosis/test_manoeuvre_advice.py``,
``tests/identification/test_coefficient_covariance.py``.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, CHANNELS, MOTIONS
from seatrial.base.errors import CampaignError
from seatrial.base.finding import Finding, Severity
from seatrial.base.plain import Plain
from seatrial.base.report import sentence_of, wording
from seatrial.estimation.scale import STATIC
from seatrial.estimation.stage import StageResult
from seatrial.problem.parameter import Parameter, coefficient_names, expansion_matrix
from seatrial.statistics.uncertainty import bound_reached
from seatrial.vehicle.actuators import actuator_groups, fins_and_groups

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.bench_test.evaluate import BenchTest
    from seatrial.diagnosis.assessment import Assessment
    from seatrial.estimation.scale import ScaleReport
    from seatrial.identification.events import EventEstimate
    from seatrial.problem.problem import Problem


@dataclass(frozen=True)
class Estimate:
    """One coefficient: from where it started, where it may lie, where it came to lie, how sure that is.

    ``at_bound`` is "lower" or "upper" where the estimate lies within 0.5 % of the box at a bound, else None.
    ``sigma`` is its standard deviation, ``interval`` the 95 % interval, ``verdict`` "identifiable", "weak" or
    "not identifiable"; None where the coefficient is not in the joint estimate. What ended at a bound is not
    identified: the deviation of the fit without bounds says nothing there, ``sigma`` is infinite. ``prior``
    is what was known of it beforehand, value and standard deviation; None without.
    """

    name: str
    unit: str
    start: float
    estimate: float
    lower: float
    upper: float
    at_bound: str | None
    stage: str
    parameter: str
    sigma: float | None = None
    interval: tuple[float, float] | None = None
    verdict: str | None = None
    prior: tuple[float, float] | None = None

    @property
    def told(self) -> float | None:
        """Standard deviation over what it was beforehand; None where nothing was known, or nothing is."""
        known = self.prior is not None and self.sigma is not None and math.isfinite(self.sigma)
        return self.sigma / self.prior[1] if known and self.sigma and self.prior else None

    @property
    def contradiction(self) -> float:
        """By how many standard deviations the data contradict what was known beforehand; zero below three.

        The change has the variance that the data took away from it, a quarter of it at least.
        """
        if self.prior is None or self.told is None:
            return 0.0
        change = math.sqrt(max(1.0 - self.told**2, 0.25)) * self.prior[1]
        away = abs(self.estimate - self.prior[0]) / change
        return away if away > 3.0 else 0.0

    @property
    def factor(self) -> float | None:
        """Estimate over start value, None where that is zero."""
        return self.estimate / self.start + 0.0 if self.start else None  # no minus before a zero


@dataclass(frozen=True)
class Tally:
    """How many of the wanted coefficients the trials determine; the equal ones of a group are one."""

    #: By the verdict of the joint estimate. What ended at a bound is not identifiable.
    identifiable: int
    weak: int
    not_identifiable: int
    #: Hidden by feedback: they keep the values of the vehicle file.
    held: int
    #: Estimated by a stage alone, without a verdict.
    not_judged: int

    @property
    def asked(self) -> int:
        """How many were to be identified."""
        return sum(asdict(self).values())

    @property
    def lost(self) -> int:
        """How many the trials do not tell at all."""
        return self.not_identifiable + self.held

    @property
    def mostly_lost(self) -> bool:
        """Whether the trials do not tell more than half of what was asked for."""
        return 2 * self.lost > self.asked

    @property
    def outcome(self) -> str:
        """The result in two words."""
        if self.mostly_lost:
            return "not identified" if self.lost == self.asked else "mostly not identified"
        if 2 * (self.identifiable + self.not_judged) > self.asked:
            return "identified"
        return "partly identified" if self.identifiable + self.not_judged else "weakly identified"

    @property
    def sentence(self) -> str:
        """How many coefficients the trials determine, and what became of the others."""
        return str(wording("estimates").tally(self))


def tally(coefficients: Sequence[Estimate], held: Sequence[str] = ()) -> Tally:
    """Number of coefficients by verdict.

    ``coefficients``: rows of an identification. ``held``: parameters that were to be identified and that
    feedback hides.
    """
    verdicts = [row.verdict for row in distinct(coefficients)]
    return Tally(
        identifiable=verdicts.count("identifiable"),
        weak=verdicts.count("weak"),
        not_identifiable=verdicts.count("not identifiable"),
        held=len(set(held)),
        not_judged=verdicts.count(None),
    )


def derived(vehicle: Vehicle) -> dict[str, float]:
    """What the coefficients mean: apparent masses and inertias, net buoyancy, gains and lags per group."""
    values = vehicle.coefficients()
    mass = vehicle.mass_matrix()
    figures = {
        f"apparent {'mass' if axis < 3 else 'inertia'} in {name}, {'kg' if axis < 3 else 'kg m2'}": float(
            mass[axis][axis]
        )
        for axis, name in enumerate(MOTIONS.values())
    }
    figures["net buoyancy B - m g, N"] = values.get("B", 0.0) - values["m"] * vehicle.environment()["g"]
    groups = actuator_groups(vehicle)
    fins = set(fins_and_groups(vehicle))
    for suffix, of_thrusters in (("gain", "thrust gain"), ("T_1", "lag T_1, s"), ("T_t", "dead time T_t, s")):
        for group, actuators in groups.items():
            words = of_thrusters.replace("thrust", "lift") if set(actuators) <= fins else of_thrusters
            each = {
                actuator: values[key] for actuator in actuators if (key := f"{actuator}.{suffix}") in values
            }
            if len(set(each.values())) == 1:
                figures[f"{group} {words}"] = next(iter(each.values()))
            else:
                figures |= {f"{actuator} {words}": value for actuator, value in each.items()}
    return figures


def estimates(
    problem: Problem,
    stages: tuple[StageResult, ...],
    assessment: Assessment | None = None,
    *,
    failed: Sequence[str] = (),
    events: Sequence[EventEstimate] = (),
) -> tuple[Estimate, ...]:
    """Rows for every coefficient that was set: by the joint estimate, or by the last stage that freed it.

    What only stages freed that ``failed`` keeps its value and is not identifiable; what ``events`` tell is
    in neither.
    """
    rows: dict[str, Estimate] = {}
    for stage in stages:
        for parameter in problem.parameters.get(stage.name, ()):
            if parameter.name not in stage.estimates:
                continue  # strips that the joint estimate took in place of the stage's quadratic damping
            value, start = stage.estimates[parameter.name], stage.starts[parameter.name]
            rows |= _rows(problem, parameter, value, start=start, stage=stage.name)
    for parameter in () if assessment is None else assessment.parameters:
        known = assessment.of(parameter.name) if assessment is not None else None
        if known is not None:
            moved = assessment is not None and assessment.polished.rounds > 0
            before = rows.get(parameter.members[0][0])
            rows |= _rows(
                problem,
                parameter,
                known["estimate"],
                start=parameter.start,
                stage=before.stage if before is not None and not moved else "joint estimate",
                known=known,
            )
    for estimate in events:
        for place, parameter in enumerate(estimate.parameters):
            rows |= _rows(
                problem,
                parameter,
                estimate.values[place],
                start=parameter.start,
                stage="events",
                known=estimate.known(place),
            )
    own = problem.vehicle.coefficients()
    for name in failed:
        for parameter in problem.parameters.get(name, ()):
            member, factor = parameter.members[0]
            if member not in rows:
                value = own.get(member, 0.0) / factor
                lost = _rows(problem, parameter, value, start=value, stage=name)
                rows |= {key: replace(row, verdict="not identifiable") for key, row in lost.items()}
    return tuple(rows.values())


def _rows(
    problem: Problem,
    parameter: Parameter,
    value: float,
    *,
    start: float,
    stage: str,
    known: Mapping[str, Any] | None = None,
) -> dict[str, Estimate]:
    """A row per coefficient that a parameter sets."""
    initial, info = problem.vehicle.coefficients(), problem.vehicle.coefficient_info()
    reached = bound_reached(value, parameter.lower, parameter.upper)
    rows = {}
    for member, factor in parameter.members:
        lower, upper = sorted((factor * parameter.lower, factor * parameter.upper))
        at_bound = reached
        if reached is not None and factor <= 0:
            at_bound = "upper" if reached == "lower" else "lower"
        interval = None
        if known is not None and at_bound is None:
            ends = sorted((factor * known["lower"], factor * known["upper"]))
            interval = (ends[0], ends[1])
        rows[member] = Estimate(
            name=member,
            unit=info[member]["unit"],
            start=start * factor if parameter.start_given else initial.get(member, 0.0),
            estimate=factor * value,
            lower=lower,
            upper=upper,
            at_bound=at_bound,
            stage=stage,
            parameter=parameter.name,
            sigma=None if known is None else math.inf if at_bound else abs(factor) * known["sigma"],
            interval=interval,
            verdict="not identifiable" if at_bound else None if known is None else known["verdict"],
            prior=None
            if known is None or not math.isfinite(known["prior_sd"])
            else (factor * known["prior"], abs(factor) * known["prior_sd"]),
        )
    return rows


def distinct(coefficients: Sequence[Estimate]) -> tuple[Estimate, ...]:
    """Rows with one for the coefficients of an actuator group that are equal but for their sign."""
    names = {row.name for row in coefficients}
    rows: dict[tuple[str, float], Estimate] = {}
    for row in coefficients:
        name = row.name if row.parameter in names else row.parameter
        rows.setdefault((name, abs(row.estimate)), replace(row, name=name))
    return tuple(rows.values())


def plus_minus(estimate: float, sigma: float | None) -> str:
    """Estimate ± sigma with two digits of sigma; "undetermined" where it is infinite."""
    if sigma is None:
        return f"{estimate:.4g}"
    if not math.isfinite(sigma):
        return f"{estimate:.4g} (undetermined)"
    digits = max(1 - math.floor(math.log10(sigma)), 0) if sigma > 0 else 4
    return f"{estimate:.{digits}f} ± {sigma:.{digits}f}"


@dataclass(frozen=True)
class EstimateSettings:
    """Which apparent masses and drags are plausible."""

    #: Relative deviation up to which apparent masses agree: of drawn vehicles, and of the vehicle file.
    agree: float = 0.3
    #: Largest plausible drag coefficient on the area of the outline. A plate across the flow has up to 2
    #: (Hoerner 1965, chapter 3); parts of an open frame behind one another add up: of the published
    #: identified vehicles a BlueROV2 Heavy has the largest, 3.7 in sway (von Benzon et al. 2022).
    largest_drag: float = 4.0


ESTIMATE_SETTINGS = EstimateSettings()


_CHANNEL = dict(zip(AXES, CHANNELS, strict=False))  # the first six are the velocities along the axes


def masses_of(vehicle: Vehicle) -> dict[str, float]:
    """Apparent mass (inertia) of a vehicle by axis: the diagonal of its mass matrix, kg or kg m2."""
    return dict(zip(AXES, np.diag(np.asarray(vehicle.mass_matrix())).tolist(), strict=True))


def implausible_masses(
    start: Vehicle, coefficients: Sequence[Estimate], masses: Mapping[str, float]
) -> dict[str, Finding]:
    """Why an apparent mass is implausible, by axis; those that the vehicle of the file can have are left out.

    A small added mass may be several times that of the file and change nothing: what agrees is plausible.

    ``start``: the one that the identification began with. ``coefficients``: what it found. ``masses``:
    apparent masses that it found, by axis, kg or kg m2.
    """
    plausible = plausible_masses(start, {coefficient.name for coefficient in coefficients})
    of_file, implausible = masses_of(start), {}
    for axis, mass in masses.items():
        low, high = plausible[axis]
        # A search that ended at a bound is on it up to rounding, and is told as such.
        if (
            0.999 * low <= mass <= 1.001 * high
            or abs(mass - of_file[axis]) <= ESTIMATE_SETTINGS.agree * of_file[axis]
        ):
            continue
        added = [
            coefficient
            for coefficient in coefficients
            if coefficient.name == f"{axis}_{_CHANNEL[axis]}dot" and coefficient.start
        ]
        growth = {row.name: row.estimate / row.start for row in added}
        values = {"mass": mass, "of_file": of_file[axis], "low": low, "high": high, "growth": growth}
        implausible[axis] = Finding("mass implausible", Severity.PROBLEM, axis, values)
    return implausible


def implausible_drags(vehicle: Vehicle, coefficients: Sequence[Estimate]) -> dict[str, float]:
    """Drag coefficients above `largest_drag` of the identified quadratic damping, by its name.

    ``C_D = -X_uu / (rho A / 2)``, A the box of the hull's measures seen along the axis. What the data do not
    determine, or reaches below the limit within its 95 % interval, is left out.
    Of a vehicle without measures nothing is implausible.
    """
    box = vehicle.geometry()
    if not box:
        return {}
    length, width, height = (box[side] for side in ("length", "diameter", "height"))
    areas = {"X_uu": width * height, "Y_vv": length * height, "Z_ww": length * width}
    drags = {}
    for coefficient in coefficients:
        if coefficient.name in areas and coefficient.verdict in ("identifiable", "weak"):
            dynamic = -0.5 * vehicle.environment()["rho"] * areas[coefficient.name]
            _, least = coefficient.interval or (coefficient.estimate, coefficient.estimate)
            if least / dynamic > ESTIMATE_SETTINGS.largest_drag:
                drags[coefficient.name] = coefficient.estimate / dynamic
    return drags


def plausible_masses(vehicle: Vehicle, freed: Collection[str] = ()) -> dict[str, tuple[float, float]]:
    """Least and largest apparent mass (inertia) of every axis that a vehicle file allows, kg or kg m2.

    The mass matrix of the file with its diagonal added mass at either of its default bounds, 0.2 and 5 times
    the start value, and with mass and inertia at theirs where they are `freed`
    (docs/theory/geometry.md#default-bounds). The drafted campaign searches beyond them where thrust and
    levers are held, because what turns takes their error over: such a value describes the log, and is not
    the vehicle's inertia. An added mass without start value has no bounds: 0 to infinity.

    ``vehicle``: the one that an identification begins with. ``freed``: coefficients that it searches.
    """
    known, values = vehicle.coefficient_info(), vehicle.coefficients()
    rigid = {"X": "m", "Y": "m", "Z": "m", "K": "I_x", "M": "I_y", "N": "I_z"}
    bounds = {}
    for axis, mass in masses_of(vehicle).items():
        added = known[f"{axis}_{_CHANNEL[axis]}dot"]
        bounded = added["lower"] is not None
        least, most = (-float(added["upper"]), -float(added["lower"])) if bounded else (0.0, np.inf)
        rest = mass + values.get(f"{axis}_{_CHANNEL[axis]}dot", 0.0)
        low, high = 0.0, 0.0
        if rigid[axis] in freed:
            body = known[rigid[axis]]
            low, high = (float(body[end]) - values[rigid[axis]] for end in ("lower", "upper"))
        bounds[axis] = (rest + low + least, rest + high + most)
    return bounds


@dataclass(frozen=True)
class CovarianceSettings:
    """What of a covariance is rounding."""

    #: Variance of a number somewhere in an interval of length one: what the data do not tell lies in its
    #: bounds.
    uniform_variance: float = 1.0 / 12.0
    #: Singular value over the largest that is rounding: the root of the 1e-11 of the information.
    rounding: float = 1e-5
    #: Component of a unit vector that is no part of it.
    absent_component: float = 1e-4


SETTINGS = CovarianceSettings()


@dataclass(frozen=True, eq=False)
class CoefficientCovariance(Plain):
    """How well coefficients are known."""

    #: Coefficients (n,).
    names: tuple[str, ...]
    #: Their values (n,), SI.
    at: Array
    #: Covariance (n, n), SI; singular where coefficients are tied.
    matrix: Array
    #: Sentences: what is not in it, and what is there by assumption.
    notes: tuple[str, ...] = ()

    @classmethod
    def from_dict(cls, data: Any, source: str) -> CoefficientCovariance:
        """Covariance of plain lists.

        Raises CampaignError: they do not fit together; the message begins with `source`.
        """
        try:
            known = tuple(str(name) for name in data["names"])
            at = np.array(data["at"], float).reshape(len(known))
            matrix = np.array(data["matrix"], float).reshape(len(known), len(known))
            notes = tuple(str(note) for note in data.get("notes", ()))
        except (KeyError, TypeError, ValueError, AttributeError):
            raise CampaignError(
                f"{source}: key covariance: expected names, their values under at and a square matrix; let"
                " `seatrial identify` write the file again"
            ) from None
        if not (np.isfinite(at).all() and np.isfinite(matrix).all()):
            raise CampaignError(
                f"{source}: key covariance: expected finite numbers; let `seatrial identify` write the file"
                " again"
            )
        return cls(known, at, matrix, notes)


def coefficient_covariance(
    assessment: Assessment | None,
    vehicle: Vehicle,
    *,
    scale: ScaleReport,
    staged: Sequence[str] = (),
    bench: BenchTest | None = None,
    held: Sequence[str] = (),
    events: Sequence[EventEstimate] = (),
) -> CoefficientCovariance:
    """Covariance of the coefficients that an identification set.

    ``assessment``: the joint estimate; None where events tell everything. ``vehicle``: with all estimates.
    ``scale``: what the scale of all forces rests on. ``staged``: all coefficients that were set: those that
    only a stage set have no standard deviation. ``bench``: whose thrust the campaign takes. ``held``: what
    was to be identified and is not, because feedback hides it. ``events``: what was estimated from events,
    independent of the joint estimate.
    """
    own, notes = vehicle.coefficients(), list[str]()
    names, among = list[str](), np.zeros((0, 0))
    if assessment is not None:
        matrix, notes = _bounded(assessment)
        factors = expansion_matrix(assessment.parameters)
        names, among = coefficient_names(assessment.parameters), factors.T @ matrix @ factors
    for estimate in events:
        width = np.array([parameter.upper - parameter.lower for parameter in estimate.parameters])
        ended = np.array([
            bound_reached(value, parameter.lower, parameter.upper) is not None
            for value, parameter in zip(estimate.values, estimate.parameters, strict=True)
        ])
        # As in `_bounded`: what ended at a bound stays there, and no direction is wider than the bounds.
        scaled = _with_fixed(estimate.covariance / np.outer(width, width), ended)
        sizes, vectors = np.linalg.eigh(scaled)
        scaled = (
            (vectors * np.clip(sizes, 0.0, SETTINGS.uniform_variance)) @ vectors.T * np.outer(width, width)
        )
        spread = expansion_matrix(estimate.parameters)
        names = [*names, *coefficient_names(estimate.parameters)]
        among = block_diag(among, spread.T @ scaled @ spread)
    notes += [] if assessment is None else _beyond(assessment, scale)
    alone = [name for name in staged if name not in names]
    if alone:
        notes.append(_note("draws of a stage", names=alone))
    if held:
        notes.append(_note("draws of held", names=held))
    if bench is not None:
        names, among = _with_thrust(names, among, bench, own, notes)
    at = np.array([own.get(name, 0.0) for name in names])
    return CoefficientCovariance(tuple(names), at, 0.5 * (among + among.T), tuple(notes))


def _note(kind: str, **values: Any) -> str:
    """What draws do, in the words of `seatrial.report.results.preparation`."""
    return sentence_of(Finding(kind, Severity.NOTE, values=values), "preparation")


def _beyond(assessment: Assessment, scale: ScaleReport) -> list[str]:
    """Sentences on what no draw contains: what the model class lacks, and another scale of all forces."""
    notes = []
    if assessment.residual_analysis.warning:
        notes.append(_note("draws within a class", warning=assessment.residual_analysis.warning))
    if not scale.tested and any(direction.kind != STATIC for direction in scale.homogeneity.held):
        notes.append(_note("draws of one scale", homogeneity=scale.homogeneity))
    return notes


def _bounded(assessment: Assessment) -> tuple[Array, list[str]]:
    """Covariance (p, p) of the parameters with the bounds in place of what the data do not tell."""
    uncertainty, directions = assessment.uncertainty, assessment.identifiability
    known = [parameter.name for parameter in assessment.parameters]
    places = [uncertainty.names.index(name) for name in known]
    width = np.array([parameter.upper - parameter.lower for parameter in assessment.parameters])
    scaled = uncertainty.covariance[np.ix_(places, places)] / np.outer(width, width)
    # An actuator's gain at its bound is not known, however stiff the fit without bounds is there. What else
    # ended there, damping that would add energy, stays there, and the rest is known as well as with it fixed.
    ended = np.array([uncertainty.at_bound[place] is not None for place in places], dtype=bool)
    gains = np.array(["." in name for name in known], dtype=bool)
    absent = ~np.isfinite(uncertainty.sigma[places]) | (ended & gains)
    stays = ended & ~gains & ~absent
    scaled = _with_fixed(scaled, stays)
    kept = [name for name, stay in zip(known, stays, strict=True) if stay]
    notes = [_note("draws at a bound", names=kept)] if kept else []
    silent = _silent(
        directions.singular_values,
        directions.vectors[:, [directions.names.index(name) for name in known]],
        absent,
    )
    rest = np.eye(len(known)) - silent @ silent.T
    values, vectors = np.linalg.eigh(rest @ scaled @ rest)
    cut = values > SETTINGS.uniform_variance
    if not cut.any() and not silent.shape[1]:
        return width[:, None] * scaled * width, notes
    bounded = (
        vectors * np.clip(values, 0.0, SETTINGS.uniform_variance)
    ) @ vectors.T + SETTINGS.uniform_variance * silent @ silent.T
    # What stays has no rounding either: at its bound half of the vehicles would be beyond it.
    bounded[stays] = bounded[:, stays] = 0.0
    along = absent | (np.abs(vectors[:, cut]).max(axis=1, initial=0.0) > 0.5)
    weak = [name for name, lies_along in zip(known, along, strict=True) if lies_along]
    if weak:
        notes.insert(0, _note("draws between bounds", names=weak))
    return width[:, None] * bounded * width, notes


def _with_fixed(covariance: Array, fixed: NDArray[np.bool_]) -> Array:
    """Covariance (p, p) of the rest given that some parameters stay at their estimate, zero for these."""
    if not fixed.any():
        return covariance
    conditioned = np.zeros_like(covariance)
    rest = np.ix_(~fixed, ~fixed)
    across = covariance[np.ix_(~fixed, fixed)]
    inside = np.linalg.pinv(covariance[np.ix_(fixed, fixed)], hermitian=True)
    conditioned[rest] = covariance[rest] - across @ inside @ across.T
    return conditioned


def _silent(singular: Array, vectors: Array, absent: NDArray[np.bool_]) -> Array:
    """Orthonormal directions (p, s), in widths of the bounds, of which the data tell nothing."""
    if not absent.any():
        return np.zeros((len(absent), 0))
    rows = [
        row for value, row in zip(singular, vectors, strict=True) if value <= SETTINGS.rounding * singular[0]
    ]
    for place in np.flatnonzero(absent):
        if not any(abs(row[place]) > SETTINGS.absent_component for row in rows):
            rows.append(np.eye(len(absent))[place])
    return np.asarray(np.linalg.qr(np.array(rows).T)[0])


def _with_thrust(
    known: list[str], matrix: Array, bench: BenchTest, own: Mapping[str, float], notes: list[str]
) -> tuple[list[str], Array]:
    """Coefficients and covariance with the bench test's own uncertainty of the thrust."""
    shares = []
    for name, fit in bench.pulls.items():
        share = _thrust_sd(fit)
        gains = [gain for actuator in fit.unit.actuators if (gain := f"{actuator}.gain") in own]
        if share <= 0.0 or not gains:
            continue
        new = [gain for gain in gains if gain not in known]
        known = [*known, *new]
        matrix = np.pad(matrix, (0, len(new)))
        along = np.zeros(len(known))
        along[[known.index(gain) for gain in gains]] = [share * own[gain] for gain in gains]
        matrix = matrix + np.outer(along, along)
        shares.append(f"{name} {100.0 * share:.2g} %")
    if shares:
        notes.append(f"Thrust varies by the bench test's own standard deviation: {', '.join(shares)}.")
    return known, matrix


def _thrust_sd(fit: Any) -> float:
    """Relative standard deviation of a group's fitted thrust at the strongest point, the worse direction."""
    worst = 0.0
    for direction in fit.directions.values():
        strongest = direction.points[np.argmax(np.abs(fit.points.signal[direction.points]))]
        inputs = [abs(float(fit.points.signal[strongest]))]
        if len(direction.fit.scale) > 1:
            inputs.append(float(fit.points.voltage_v[strongest]))
        curve = float(direction.fit.bands([inputs])[0][0]) / direction.fit.quantile
        worst = max(worst, curve / abs(float(direction.fit.at([inputs])[0])))
    return worst if np.isfinite(worst) else 0.0
