"""Covariance of the coefficients that an identification set, in a form from which vehicles can be drawn.

The joint estimate's covariance V is that of parameters; a parameter sets its members by factors F, so that
the coefficients have ``F' V F``: what is tied moves together.

Data tell some combinations badly or not at all, and the sandwich has no number for the latter. The campaign's
bounds say how far they may lie. In widths of the bounds no direction is taken as wider than a number anywhere
inside them, a standard deviation of ``1/sqrt(12)`` (that of `seatrial.diagnosis.identifiability`): larger
eigenvalues are cut there, and directions without information, the right singular vectors of zero, get it.
What the data do tell of the same coefficients stays as it is.

The bench test's thrust counts as exact in the joint estimate. Its own standard deviation at the strongest
point comes on top, common to the actuators that were pulled together. It is added without refitting the rest,
although a wrong thrust would move the damping along with it: the vehicles drawn are a little more unlike each
other than they need to be.

It is the covariance of the best model in the class. Where the truth lies outside
(`seatrial.diagnosis.residual_analysis`), it may be many of these standard deviations away; nor does it hold
the common factor of all forces, which trials do not tell (`seatrial.estimation.homogeneity`). The notes say
both.

Further standard deviations in percent, by name, pattern or group, are added by `widened`.

Tests: ``tests/identification/test_coefficient_covariance.py``, ``tests/identification/test_fitted.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError, nearest
from seatrial.base.finding import Finding, Severity
from seatrial.base.plain import Plain
from seatrial.base.report import sentence_of
from seatrial.estimation.homogeneity import STATIC
from seatrial.problem.parameter import coefficient_names, expansion_matrix
from seatrial.statistics.uncertainty import bound_reached
from seatrial.vehicle.actuators import actuator_groups

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.bench_test.evaluate import BenchTest
    from seatrial.diagnosis.assessment import Assessment
    from seatrial.estimation.scale import ScaleReport
    from seatrial.identification.events import EventEstimate


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


def widened(
    vehicle: Vehicle, percent: Mapping[str, float], *, names: Sequence[str], covariance: Array
) -> tuple[tuple[str, ...], Array]:
    """Names (m,) and covariance (m, m), SI, with further relative standard deviations.

    ``vehicle``: of whose values the percentages are. ``percent``: by name, by pattern (``"*_uu"``: each for
    itself) or by group (``"stern.gain"``: all together). ``names``, ``covariance``: what they are added to.
    Raises CampaignError: a name is unknown or its value zero, or a percentage is impossible.

    Examples
    --------
    >>> import seatrial as st
    >>> own = st.Vehicle.load("cwolf")
    >>> names, matrix = widened(own, {"m": 2.0}, names=(), covariance=np.zeros((0, 0)))
    >>> names, matrix.round(2).tolist()
    (('m',), [[7.29]])
    """
    own = vehicle.coefficients()
    known, matrix = list(names), covariance
    for pattern, share in percent.items():
        number = isinstance(share, int | float) and not isinstance(share, bool)
        if not number or not 0.0 < share < 100.0:
            raise CampaignError(
                f"standard deviations: {pattern!r}: expected percent above 0 and below 100, found {share!r}"
            )
        for together in _meant(pattern, vehicle, own):
            new = [name for name in together if name not in known]
            known += new
            matrix = np.pad(matrix, (0, len(new)))
            along = np.zeros(len(known))
            along[[known.index(name) for name in together]] = [0.01 * share * own[name] for name in together]
            matrix = matrix + np.outer(along, along)
    return tuple(known), matrix


def _meant(pattern: str, vehicle: Vehicle, own: Mapping[str, float]) -> list[list[str]]:
    """Coefficients behind a name, a pattern or a group, those that vary together in one list."""
    group, _, suffix = pattern.partition(".")
    groups = actuator_groups(vehicle)
    if pattern not in own and group in groups:
        together = [name for actuator in groups[group] if (name := f"{actuator}.{suffix}") in own]
        if together:
            return [together]
    matches = [[name] for name in own if fnmatchcase(name, pattern) and own[name] != 0.0]
    if not matches:
        zero = [name for name in own if fnmatchcase(name, pattern)]
        raise CampaignError(
            f"standard deviations: {zero[0]} of {vehicle.name} is zero, and so is any percentage of it;"
            " leave it out"
            if zero
            else f"standard deviations: {vehicle.name} has no coefficient {pattern!r}{nearest(pattern, own)}"
        )
    return matches
