"""Coefficients as an identification found them: start, bounds, deviation, verdict, and what they mean.

Tests: ``tests/identification/test_identify.py``, ``tests/diagnosis/test_manoeuvre_advice.py``.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.channels import AXES, CHANNELS, MOTIONS
from seatrial.base.finding import Finding, Severity
from seatrial.base.report import wording
from seatrial.estimation.stage import StageResult
from seatrial.problem.parameter import Parameter
from seatrial.statistics.uncertainty import bound_reached
from seatrial.vehicle.actuators import actuator_groups, fins_and_groups

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.diagnosis.assessment import Assessment
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
