"""What is estimated jointly: coefficients and nuisance parameters over the segments of all trials.

Nuisance parameters are what a trial adds to its record, estimated lest the coefficients absorb it: a current,
a motion-capture frame that was not levelled, the position of the velocity sensor, a late channel, a biased
one, a constant force. The core applies them (``observation.rs``); here stands how far each may plausibly lie
from zero, which trials it belongs to and whether they share it.

Tests: ``tests/estimation/test_polish.py``.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial._core import Vehicle
from seatrial.base.arrays import Array, Mask, runs
from seatrial.base.channels import AXES, CHANNELS
from seatrial.estimation.descent import velocity_noise
from seatrial.estimation.estimator import COMPARISONS, ByItself, Comparison, NoiseModel, method_of
from seatrial.estimation.segment_model import SegmentModel, cut, stage_step, unfit_trials
from seatrial.problem.parameter import (
    Parameter,
    coefficients,
    nuisance_prior,
    nuisance_rows,
    nuisances,
    parameters,
)
from seatrial.problem.settings import JointSettings, Method, Stage
from seatrial.scoring.record import Segment, restarted
from seatrial.statistics.linearisation import Unknown
from seatrial.trial.trial import Trial

if TYPE_CHECKING:
    from seatrial.problem.problem import Problem


@dataclass(frozen=True)
class JointPriorSettings:
    """What a joint estimate knows of its unknowns beforehand, and when a coarser flight serves."""

    #: Longest gap that the filter of the innovations is taken across, s.
    longest_gap_s: float = 5.0
    #: Prior standard deviation of a hidden coefficient, over the width of its bounds.
    hidden_sd: float = 0.25
    #: Distance from a bound, over the width of the bounds, that cannot be told from it: as near as solvers
    #: come.
    at_bound: float = 1e-6
    #: Difference of two flights, in standard deviations of the channel, up to which the derivatives of the
    #: coarser one serve; at h|lambda| <= 1 they differ by about a hundredth.
    near_sd: float = 0.05
    #: Prior standard deviation of a segment's initial velocities, over that of the sensor's noise.
    velocity_noises: float = 3.0
    #: Prior standard deviation of a segment's initial angles, rad.
    angle_sd: float = 0.02
    #: Prior standard deviation of a segment's initial place, m.
    place_sd: float = 0.5


JOINT_PRIOR_SETTINGS = JointPriorSettings()


def _usable(problem: Problem) -> tuple[Stage, dict[str, str]]:
    """The joint estimate as one stage, and the trials that are left out of it with the reason.

    A campaign without ``[polish]`` asks for no joint estimate, only for standard deviations: a trial that
    does not suit it costs those of the coefficients that no other trial tells, not all.
    """
    whole = problem.joint_stage()
    reasons = unfit_trials(problem, whole) if problem.joint is None else {}
    if not 0 < len(reasons) < len(whole.trials):
        return whole, {}
    kept = [
        stage.model_copy(update={"trials": tuple(name for name in stage.trials if name not in reasons)})
        for stage in problem.stages
    ]
    return problem.joint_stage([stage for stage in kept if stage.trials]), reasons


class Joint:
    """What is estimated jointly: coefficients and nuisance parameters over the segments of all trials.

    Parameters
    ----------
    problem : Problem
    vehicle : Vehicle, optional
        Gives the start values and what is not estimated; by default the campaign's.
    threads : int, optional
        Threads of the core; results do not depend on it.
    method : "output" or "innovations", optional
        What is compared: a free simulation of segments, or the predictions of a filter; by default what the
        campaign says, or what its trials call for (`seatrial.estimation.estimator`).
    hidden : collection of str
        Coefficients that feedback hides, by their names in the campaign. They are nuisance parameters around
        the vehicle's values, estimated lest they bend the rest; the identified vehicle keeps its own.

    Attributes
    ----------
    unknowns
        Coefficients first, in the campaign's order, hidden ones last, then nuisance parameters.
    parameters
        The coefficients among them, hidden ones too; `estimated` are those that are not.
    start
        Their start values (m,).
    left_out
        Trials that a campaign without ``[polish]`` has and that could not be cut, with the reason.
    noise
        Standard deviation (C,) of each channel's residual, SI; the fit refines it.
    method_reason
        Why the method is what it is; "" where nothing speaks against output error.
    noise_model
        Intensities of the noises with the method "innovations"; None before its first round.
    tempering
        Samples (m,) that count as one independent one beside the prior of each unknown
        (`seatrial.statistics.uncertainty.tempering`); ones before a descent has found it.
    settled
        With it, on data that are held out, fitted or either: the noise model and the values that the last
        motion was found for, and that motion (`seatrial.estimation.one_step.Path`).

    Raises
    ------
    CampaignError, TrialError
        The campaign asks for what cannot be done.
    """

    def __init__(
        self,
        problem: Problem,
        vehicle: Vehicle | None = None,
        *,
        threads: int | None = None,
        method: Method | None = None,
        hidden: Collection[str] = (),
    ) -> None:
        self.problem, self.threads, self.hidden = problem, threads, frozenset(hidden)
        self.vehicle = problem.vehicle if vehicle is None else vehicle
        self.polish = problem.joint or JointSettings()
        self.noise_model: NoiseModel | None = None
        self.settled: dict[bool | None, tuple[Any, ...]] = {}
        self.stage, self.left_out = _usable(problem)
        chosen_method = method_of(problem, self.stage.trials) if method is None else ByItself(method, "")
        self.method, self.method_reason = chosen_method.method, chosen_method.why
        where = f"{problem.source}: polish"
        chosen = parameters(self.stage, problem.vehicle, where)
        # Hidden coefficients stand last, behind those that are estimated.
        self.parameters = tuple(sorted(chosen, key=lambda parameter: parameter.name in self.hidden))
        self.estimated = tuple(
            parameter for parameter in self.parameters if parameter.name not in self.hidden
        )
        self.data = cut(problem, self.stage)
        # A filter needs records without long gaps; where there is none, simulations judge.
        if method is None and self.polish.method == "automatic" and not self._filtered():
            longest = JOINT_PRIOR_SETTINGS.longest_gap_s
            needed = f"{self.stage.segment_s:g} s of a trial without a gap of more than {longest:g} s"
            self.method = "output"
            self.method_reason = (
                f"{chosen_method.why}, which biases gains; a filter that knows this"
                f" needs {needed}, and found none"
            )
        self.nuisances = nuisances(self.polish, self.data.names, where)
        self.unknowns = (
            *(
                Unknown(p.name, "coefficient", p.unit, p.lower, p.upper, p.upper - p.lower, p.start, p.sd)
                for p in self.estimated
            ),
            *(self._hidden(p) for p in self.parameters[len(self.estimated) :]),
            *(
                Unknown(n.name, "nuisance", n.unit, -math.inf, math.inf, n.sd, 0.0, n.sd)
                for n in self.nuisances
            ),
        )
        self.tempering = np.ones(len(self.unknowns))
        # Nuisance parameters start at zero, which is also what their priors expect.
        self.start = np.array([*self._start_coefficients(), *np.zeros(len(self.nuisances))])
        self.used = [i for i, weight in enumerate(self.data.weights) if weight > 0]
        self.channels = tuple(CHANNELS[i] for i in self.used)
        # Until residuals are known, a tenth of what the channels do.
        self.noise = 0.1 * self.data.scale[self.used]
        # Steps short enough for the fastest motion of the start vehicle.
        started = self.vehicle.with_coefficients(self.coefficients(self.start))
        step = stage_step(
            started, (), free=self.stage.axes.free, speeds=self.data.largest_speeds(), dt=self.data.dt
        )
        self.substeps = step.substeps
        self.initials, self.initial_sd = self._initial_conditions()
        self.model = SegmentModel(
            self.vehicle,
            self.stage,
            self.data,
            self.parameters,
            self.substeps,
            threads,
            starts_count=bool(self.initials),
        )
        self.coarser = tuple(replace(self.model, substeps=n) for n in (step.search, step.slopes))

    @property
    def comparison(self) -> Comparison:
        """What its way of comparing with the log can do."""
        return COMPARISONS[self.method]

    def of_problem(self, problem: Problem, vehicle: Vehicle | None = None) -> Joint:
        """The same estimate, by the same method, of another problem, from this vehicle or another one."""
        hidden = self.hidden & set(problem.joint_stage().coefficients)
        vehicle = self.vehicle if vehicle is None else vehicle
        other = Joint(problem, vehicle, threads=self.threads, method=self.method, hidden=hidden)
        other.method_reason = self.method_reason
        return other

    def beside(self, values: Array, extra: Sequence[str]) -> tuple[tuple[Unknown, ...], Array]:
        """Unknowns and values with further coefficients, without bounds and priors: they are only tested."""
        info, present = self.vehicle.coefficient_info(), self.vehicle.coefficients()
        free = (-math.inf, math.inf, math.inf, 0.0, math.inf)
        added = (Unknown(name, "coefficient", info[name]["unit"], *free) for name in extra)
        return (*self.unknowns, *added), np.append(values, [present.get(name, 0.0) for name in extra])

    def named(self, values: Array) -> dict[str, float]:
        """Values (m,) of the unknowns by name."""
        return dict(zip([unknown.name for unknown in self.unknowns], values.tolist(), strict=True))

    def started(self, known: Mapping[str, float]) -> Array:
        """Start values (m,), those that are known by name in place of its own."""
        own = zip(self.unknowns, self.start.tolist(), strict=True)
        return np.array([known.get(unknown.name, value) for unknown, value in own])

    def sentences(self) -> list[str]:
        """Which trials are left out and which coefficients have no standard deviation for it."""
        names = {p.name for p in self.parameters}
        lost = [c for stage in self.problem.stages for c in stage.coefficients if c not in names]
        return [
            f"trial {name} is left out of the standard deviations"
            + (f", and there is none for {', '.join(dict.fromkeys(lost))}" if lost else "")
            + f": {reason}"
            for name, reason in self.left_out.items()
        ]

    def thinned(self, most: int) -> tuple[Joint, NDArray[np.intp]]:
        """The same estimate on ``most`` segments or some more, and their places; on all where they are few.

        Each trial gives every so many of its segments, its first among them.
        """
        every = max(len(self.data.segments) // most, 1)
        of = np.array([segment.record for segment in self.data.segments])
        places = np.sort(np.concatenate([np.flatnonzero(of == record)[::every] for record in np.unique(of)]))
        part = copy.copy(self)
        part.data, part.noise = self.data.of_segments(places.tolist()), self.noise.copy()
        part.model = replace(self.model, data=part.data)
        if self.presumes:  # a part of the data meets a part of what is known beforehand
            part.tempering = self.tempering * len(places) / len(self.data.segments)
        part.coarser = tuple(replace(model, data=part.data) for model in self.coarser)
        return part, places

    def at_search_step(self) -> Joint:
        """The same estimate with all flights at the step of the global search, to come near its optimum."""
        rough = copy.copy(self)
        rough.model, rough.noise = self.coarser[0], self.noise.copy()
        rough.coarser = (self.coarser[0], self.coarser[0])
        return rough

    def steps(
        self, *, held_out: bool | None = False
    ) -> tuple[tuple[tuple[int, int, int], ...], tuple[Segment, ...]]:
        """Record, first and last sample of every span to be fitted or held out, and a segment per sample.

        With None whole trials, whatever of them is held out. A span ends where nothing is measured for long:
        a linearisation about a bridge over the gap foretells nothing, and an unstable one leaves all bounds.
        """
        spans, segments = [], []
        for index, trial in enumerate(self.data.trials):
            wanted: Mask = np.asarray(self.problem.held_out(self.data.names[index]) == held_out)
            if held_out is None:
                wanted = np.ones(len(trial), dtype=bool)
            for first, end in runs(wanted & ~self._blind(trial)):
                if (end - 1 - first) * trial.dt >= self.stage.segment_s:
                    spans.append((index, first, end - 1))
                    segments += restarted(trial, [(k, k + 2) for k in range(first, end - 1)], index)
        return tuple(spans), tuple(segments)

    def _filtered(self) -> bool:
        """Whether the method has the measurements that it needs."""
        return not self.comparison.models_noise or bool(self.steps()[0])

    def _blind(self, trial: Trial) -> Mask:
        """Samples (n,) in gaps longer than `longest_gap_s`, in which no simulated axis is measured.

        Where rotations are simulated they decide: it is the attitude that an unstable hull loses.
        """
        axes = [AXES.index(letter) for letter in self.stage.axes.free]
        axes = [axis for axis in axes if axis >= 3] or axes
        unseen = ~np.asarray(trial.valid[:, axes + [6 + axis for axis in axes]].any(axis=1))
        blind = np.zeros(len(trial), dtype=bool)
        for first, end in runs(unseen):
            blind[first:end] = (end - first) * trial.dt > JOINT_PRIOR_SETTINGS.longest_gap_s
        return blind

    def on_bounds(self, values: Array) -> Array:
        """The values (m,) of the unknowns; one that a solver left a hair inside a bound is that bound."""
        ends = np.array([(unknown.lower, unknown.upper) for unknown in self.unknowns]).reshape(-1, 2)
        inside, width = values.copy(), ends[:, 1] - ends[:, 0]
        for end in ends.T:
            reached = np.isfinite(width) & (np.abs(values - end) <= JOINT_PRIOR_SETTINGS.at_bound * width)
            inside[reached] = end[reached]
        return inside

    def centres(self, values: Array) -> Array:
        """Where the priors of the unknowns (m,) lie: these values where nothing is known beforehand."""
        known = np.array([np.isfinite(unknown.prior_sd) for unknown in self.unknowns])
        return np.where(known, [unknown.prior for unknown in self.unknowns], values)

    @property
    def unstaged(self) -> tuple[int, ...]:
        """Places of the coefficients that no stage freed."""
        staged = {name for stage in self.problem.stages for name in stage.coefficients}
        free = tuple(i for i, parameter in enumerate(self.parameters) if parameter.name not in staged)
        return free if len(free) < len(self.parameters) else ()

    @property
    def presumes(self) -> bool:
        """Whether a coefficient is known beforehand, and simulations have to be weighed against that."""
        known = any(u.kind == "coefficient" and math.isfinite(u.prior_sd) for u in self.unknowns)
        return known and self.comparison.simulates

    def coefficients(self, values: Array) -> dict[str, float]:
        """Coefficients that the values (m,) of the unknowns set."""
        return coefficients(self.parameters, values[: len(self.parameters)])

    def identified(self, values: Array) -> Vehicle:
        """The vehicle with the values (m,) of the unknowns, without those of hidden coefficients."""
        return self.vehicle.with_coefficients(coefficients(self.estimated, values[: len(self.estimated)]))

    def records(self, values: Array) -> dict[str, dict[str, float]]:
        """Nuisance parameters by trial and name, SI, that the values (m,) of the unknowns set.

        What all trials of the estimate share (a sensor's place, a latency) holds for every other trial of the
        campaign too.
        """
        by_trial: dict[str, dict[str, float]] = {}
        for nuisance, value in zip(self.nuisances, values[len(self.parameters) :].tolist(), strict=True):
            whole = len(nuisance.trials) == len(self.data.names) and nuisance_prior(nuisance.key)[2]
            names = self.problem.trials if whole else [self.data.names[i] for i in nuisance.trials]
            for name in names:
                by_trial.setdefault(name, {})[nuisance.key] = value
        return by_trial

    def residuals(self, values: Array, initial: Array) -> list[Array]:
        """Measured minus shown (n, C) per segment, SI, zero where not counted.

        Parameters
        ----------
        values : ndarray, shape (m,)
        initial : ndarray, shape (segments, 12)
            Initial conditions, added to the smoothed ones.
        """
        errors = self.model.residuals(
            values[: len(self.parameters)], nuisance=self._nuisance(values), initial=initial
        )
        return [np.take(error, self.used, axis=1) for error in errors]

    def slopes(
        self,
        values: Array,
        initial: Array,
        *,
        extra: Sequence[str] = (),
        starts_only: bool = False,
        judging: bool = False,
        residuals: Sequence[Array] | None = None,
    ) -> list[tuple[Array, Array, NDArray[np.intp]]]:
        """Per segment: residuals (n, C), derivatives (n, C, k + s) by unknowns and initial conditions, SI.

        The third entry holds the places (k,) of those unknowns among all; coefficients that are ``extra``
        come last. With ``starts_only`` there are none (k = 0), which saves most of the work. ``residuals``
        are those of the same point where they are known.

        Residuals are those of the fine step. Derivatives are those of a flight at the step of the global
        search, where it stays near the fine one: an error of some thousandths in them moves an estimate by as
        much of its standard deviation. Those that are ``judging`` an estimate, or terms that are nearly
        collinear with it, take half that step.
        """
        count = len(self.parameters)
        inside = 0 if starts_only else count
        sought = () if starts_only else self.nuisances
        keys = tuple(dict.fromkeys(nuisance.key for nuisance in sought))
        errors = self.residuals(values, initial) if residuals is None else residuals

        def flown(model: SegmentModel) -> list[tuple[Array, Array]]:
            return model.sensitivities(
                values[:count],
                extra=extra,
                held=starts_only,
                nuisances=keys,
                initials=self.initials,
                channels=self.channels,
                nuisance=self._nuisance(values),
                initial=initial,
            )

        pieces = flown(self.coarser[judging])
        if not self._near(errors, [error for error, _ in pieces]):
            pieces = flown(self.model)
        last, before = len(self.unknowns), inside + len(extra)
        starts = range(before + len(keys), before + len(keys) + len(self.initials))
        result = []
        for segment, error, (_, jacobian) in zip(self.data.segments, errors, pieces, strict=True):
            # The core differentiates by every kind of nuisance; of each kind one unknown is this trial's own.
            owner = {n.key: count + at for at, n in enumerate(sought) if segment.record in n.trials}
            columns = [*range(inside), *(before + keys.index(key) for key in owner), *range(inside, before)]
            places = [*range(inside), *owner.values(), *range(last, last + len(extra))]
            order = [*columns, *starts]
            whole = order == [*range(jacobian.shape[2])]
            result.append((
                error,
                jacobian if whole else jacobian[:, :, order],
                np.array(places, dtype=np.intp),
            ))
        return result

    def _near(self, fine: Sequence[Array], coarse: Sequence[Array]) -> bool:
        """Whether residuals (n, 12) of the coarser step are those of the fine one (n, C), or as lost."""
        most = JOINT_PRIOR_SETTINGS.near_sd * self.data.scale[self.used]
        with np.errstate(invalid="ignore", over="ignore"):  # a simulation that diverged
            return all(
                np.all(np.abs(np.take(rough, self.used, axis=1) - error) <= most)
                or not np.isfinite(error).all()
                for rough, error in zip(coarse, fine, strict=True)
            )

    def counted(self, index: int) -> NDArray[np.bool_]:
        """Mask (n, C) of the samples of a segment that count."""
        return np.take(self.model.counted(index), self.used, axis=1)

    def _nuisance(self, values: Array) -> Array:
        """The core's rows (trials, 38) of the nuisance parameters among the unknowns' values."""
        return nuisance_rows(self.nuisances, values[len(self.parameters) :], len(self.data.records))

    def _hidden(self, parameter: Parameter) -> Unknown:
        """A hidden coefficient as a nuisance parameter around the vehicle's value."""
        sd = JOINT_PRIOR_SETTINGS.hidden_sd * (parameter.upper - parameter.lower)
        value = self._own(parameter)
        return Unknown(
            parameter.name, "nuisance", parameter.unit, parameter.lower, parameter.upper, sd, value, sd
        )

    def _own(self, parameter: Parameter) -> float:
        """The vehicle's value of a parameter, inside its bounds."""
        name, factor = parameter.members[0]
        value = self.vehicle.coefficients().get(name, 0.0) / factor
        return float(np.clip(value, parameter.lower, parameter.upper))

    def _start_coefficients(self) -> list[float]:
        """Values of the vehicle for what a stage estimated, the campaign's start for the rest."""
        kept = {name for stage in self.problem.stages for name in stage.coefficients} | self.hidden
        return [
            self._own(parameter)
            if parameter.name in kept
            else float(np.clip(parameter.start, parameter.lower, parameter.upper))
            for parameter in self.parameters
        ]

    def _initial_conditions(self) -> tuple[tuple[str, ...], Array]:
        """Names of the initial conditions that are estimated and their prior standard deviations."""
        if self.polish.start == "smoothed":
            return (), np.zeros(0)
        free, sd = self.stage.axes.free, {}
        noise = velocity_noise(self.data)
        for letter in free:
            axis = AXES.index(letter)
            sd[f"initial_{CHANNELS[axis]}"] = JOINT_PRIOR_SETTINGS.velocity_noises * noise[axis]
        turning = set("KMN") & set(free)
        for channel in ("roll", "pitch", "yaw"):
            if turning and (channel != "yaw" or channel in self.channels):
                sd[f"initial_{channel}"] = JOINT_PRIOR_SETTINGS.angle_sd
        for channel in ("x", "y", "z"):
            if channel in self.channels:
                sd[f"initial_{channel}"] = JOINT_PRIOR_SETTINGS.place_sd
        return tuple(sd), np.array(list(sd.values()))
