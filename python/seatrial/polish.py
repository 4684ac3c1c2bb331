"""Joint polish: Gauss-Newton on all coefficients, nuisance parameters and initial conditions at once.

Every round differentiates all segments exactly, eliminates the initial conditions of each (Schur complement, as
in bundle adjustment) and hands what is left to SciPy's trust-region solver with the bounds. Between two rounds
the derivatives are held, so that a round costs one differentiated flight and a few plain ones. The loss is
squared or Huber's, its knee in standard deviations of the channel's residual, which are estimated on the way.

Source: Triggs et al., *Bundle Adjustment: A Modern Synthesis* (2000), section 6; Huber (1964).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from seatrial import _core
from seatrial.joint import Joint
from seatrial.linearisation import Linearisation, Piece, Unknown
from seatrial.search import Array, Step

_CLOSE = 0.01
"""A round that promises less than this many units of twice the log-likelihood ends the polish."""

_INITIALS: tuple[str, ...] = tuple(_core.initial_names())
_TRIALS = 6
_NOISE_FLOOR = 1e-3
_SETTLE = 3
_SPREAD = 0.1


@dataclass(frozen=True)
class Polished:
    """What the joint polish found.

    ``values`` (m,) of the unknowns, ``initial`` (segments, 12) initial conditions, ``noise`` (C,) standard
    deviation of each channel's residual, ``cost`` and ``start_cost`` half the sum of squares (robust) and priors
    in these units at the end and at the start. ``spread`` (starts, m): where other starts ended, ``costs`` (starts,).
    """

    values: Array
    initial: Array
    noise: Array
    cost: float
    start_cost: float
    rounds: int
    evaluations: int
    converged: bool
    interrupted: bool
    wall_s: float
    spread: Array
    costs: Array


@dataclass(frozen=True)
class _Local:
    """A segment at the point of a round; ``jacobian`` without what its initial conditions explain."""

    places: NDArray[np.intp]
    weight: Array
    jacobian: Array
    toward: Array
    follow: Array


def polish(
    joint: Joint,
    *,
    start: Array | None = None,
    fixed: Sequence[int] = (),
    watch: Callable[[Step], None] | None = None,
) -> Polished:
    """Joint estimate from a start, and from others around it where the campaign asks for several.

    Parameters
    ----------
    joint : Joint
    start : ndarray, shape (m,), optional
        By default the joint estimate's own start.
    fixed : sequence of int
        Places of unknowns that keep their start value (for a profile).
    watch : callable, optional
        Called after every round; it may raise KeyboardInterrupt.
    """
    began = time.monotonic()
    first = joint.start if start is None else np.asarray(start, dtype=float)
    search = _Search(joint, frozenset(fixed), watch)
    found = [search.run(first)]
    generator = np.random.default_rng(joint.campaign.seed)
    for _ in range(joint.polish.starts - 1):
        if found[-1].interrupted:
            break
        found.append(search.run(search.scattered(first, generator)))
    best = min(found, key=lambda one: search.judge(one))
    return replace(
        best,
        start_cost=found[0].start_cost,
        evaluations=sum(one.evaluations for one in found),
        interrupted=found[-1].interrupted,
        wall_s=time.monotonic() - began,
        spread=np.array([one.values for one in found]),
        costs=np.array([search.judge(one) for one in found]),
    )


def linearise(
    joint: Joint,
    values: Array,
    *,
    initial: Array | None = None,
    noise: Array | None = None,
    extra: Sequence[str] = (),
) -> Linearisation:
    """Linearisation at the values of the unknowns, initial conditions at their best.

    Parameters
    ----------
    joint : Joint
    values : ndarray, shape (m,)
    initial : ndarray, shape (segments, 12), optional
        Initial conditions; by default they are found.
    noise : ndarray, shape (C,), optional
        Standard deviations of the channels' residuals; by default they are estimated.
    extra : sequence of str
        Coefficients that are not estimated but differentiated too, appended to the unknowns.
    """
    search = _Search(joint, frozenset(), None)
    if noise is not None:
        search.noise = noise
    if initial is None:
        initial = np.zeros((len(joint.data.segments), 12))
        for _ in range(_SETTLE if joint.initials else 1):
            if noise is None:
                search.estimate_noise(joint.residuals(values, initial))
            initial = initial + search.settled(values, initial)
    return search.linearisation(values, initial, extra)


class _Search:
    """Workspace of one polish."""

    def __init__(self, joint: Joint, fixed: frozenset[int], watch: Callable[[Step], None] | None) -> None:
        self.joint, self.watch = joint, watch
        self.noise = joint.noise.copy()
        self.unknowns = joint.unknowns
        self.free = np.array([i for i in range(len(self.unknowns)) if i not in fixed], dtype=np.intp)
        self.lower = np.array([u.lower for u in self.unknowns])
        self.upper = np.array([u.upper for u in self.unknowns])
        self.scale = np.array([u.scale for u in self.unknowns])
        # A bound's width is a weak prior: what the data cannot tell stays where it was.
        self.prior_sd = np.minimum([u.prior_sd for u in self.unknowns], self.scale)
        self.initial_places = [_INITIALS.index(name) for name in joint.initials]
        self.evaluations = 0
        self.began = time.monotonic()

    def run(self, start: Array) -> Polished:
        """The optimum that one start leads to."""
        joint = self.joint
        values, centre = start.copy(), start.copy()
        centre[len(joint.parameters) :] = 0.0
        self.noise = joint.noise.copy()
        initial = np.zeros((len(joint.data.segments), len(_INITIALS)))
        self.estimate_noise(joint.residuals(values, initial))
        if joint.initials:
            initial = initial + self.settled(values, initial)
            self.estimate_noise(joint.residuals(values, initial))
        before = initial
        rounds, evaluations, converged, interrupted = 0, self.evaluations, False, False
        try:
            while rounds < joint.polish.rounds and not converged:
                rounds += 1
                values, initial, promised = self.round(values, initial, centre)
                noise = self.noise.copy()
                self.estimate_noise(joint.residuals(values, initial))
                settled = bool(np.all(np.abs(self.noise / noise - 1) < _SPREAD))
                converged = settled and promised < _CLOSE
                self._show(rounds, values, initial, centre)
        except KeyboardInterrupt:
            interrupted = True
        return Polished(
            values=values,
            initial=initial,
            noise=self.noise.copy(),
            cost=self.cost(values, initial, centre),
            start_cost=self.cost(start, before, centre),
            rounds=rounds,
            evaluations=self.evaluations - evaluations,
            converged=converged,
            interrupted=interrupted,
            wall_s=time.monotonic() - self.began,
            spread=values[None],
            costs=np.zeros(1),
        )

    def round(self, values: Array, initial: Array, centre: Array) -> tuple[Array, Array, float]:
        """Better values and initial conditions, and the promised gain in twice the log-likelihood."""
        from scipy.linalg import cholesky, solve_triangular
        from scipy.optimize import least_squares

        locals_, information, gradient = self.differentiated(values, initial)
        precision = self.prior_sd**-2.0
        information = information + np.diag(precision)
        gradient = gradient - precision * (values - centre)
        free = self.free
        scaled = information[np.ix_(free, free)] * np.outer(self.scale[free], self.scale[free])
        size = np.sqrt(np.diag(scaled))
        factor = cholesky(scaled / np.outer(size, size) + 1e-12 * np.eye(len(free)), lower=False) * size
        at = values.copy()

        def moved(z: Array) -> tuple[Array, Array]:
            new = at.copy()
            new[free] = z * self.scale[free]
            return new, self.followed(locals_, initial, new - at)

        def reduced(z: Array) -> Array:
            """A vector of the cost's size whose derivative at the start is the factor, below it zero."""
            new, begun = moved(z)
            residuals = self.joint.residuals(new, begun)
            self.evaluations += 1
            twice = 2.0 * self.cost(new, begun, centre, residuals)
            if not math.isfinite(twice):
                return np.full(len(free) + 1, np.inf)
            pull = self.pull(locals_, residuals) - precision * (new - centre)
            head = -solve_triangular(factor, pull[free] * self.scale[free], trans="T")
            return np.append(head, math.sqrt(max(twice - head @ head, 0.0)))

        held = np.vstack([factor, np.zeros(len(free))])
        z = at[free] / self.scale[free]
        lower, upper = self.lower[free] / self.scale[free], self.upper[free] / self.scale[free]
        found = least_squares(
            reduced,
            np.clip(z, lower, upper),
            jac=lambda _: held,
            bounds=(lower, upper),
            max_nfev=_TRIALS,
            ftol=1e-10,
            xtol=1e-10,
            gtol=1e-12,
        )
        new, begun = moved(found.x)
        step = (new - at)[free]
        promised = float(step @ information[np.ix_(free, free)] @ step)
        return new, begun, promised

    def differentiated(self, values: Array, initial: Array) -> tuple[list[_Local], Array, Array]:
        """Segments at a point, the information (m, m) and the downhill gradient (m,) of what they tell."""
        size = len(self.unknowns)
        information, gradient, locals_ = np.zeros((size, size)), np.zeros(size), []
        for index, (error, by_unknown, by_initial, places) in enumerate(self.joint.slopes(values, initial)):
            local, one, downhill = self._eliminated(error, by_unknown, by_initial, places, initial[index])
            information[np.ix_(places, places)] += one
            gradient[places] += downhill
            locals_.append(local)
        return locals_, information, gradient

    def _eliminated(
        self, error: Array, by_unknown: Array, by_initial: Array, places: NDArray[np.intp], initial: Array
    ) -> tuple[_Local, Array, Array]:
        """A segment without its initial conditions, its information and gradient."""
        residual = error / self.noise
        weight = self.weight(residual).ravel()
        flat = residual.ravel()
        rows = (by_unknown / self.noise[:, None]).reshape(len(flat), -1)
        own = (by_initial / self.noise[:, None]).reshape(len(flat), -1)
        weighted = weight[:, None] * own
        inside = initial[self.initial_places]
        precision = self.joint.initial_sd**-2.0
        normal = own.T @ weighted + np.diag(precision)
        follow: Array = np.asarray(np.linalg.solve(normal, weighted.T @ rows), dtype=float)
        toward: Array = np.asarray(
            np.linalg.solve(normal, weighted.T @ flat - precision * inside), dtype=float
        )
        left = rows - own @ follow
        weighted_rows = weight[:, None] * rows
        downhill = weighted_rows.T @ flat - (weighted_rows.T @ own) @ toward
        return _Local(places, weight, left, toward, follow), left.T @ weighted_rows, downhill

    def pull(self, locals_: Sequence[_Local], residuals: Sequence[Array]) -> Array:
        """Downhill gradient (m,) with derivatives and weights held."""
        total = np.zeros(len(self.unknowns))
        for local, error in zip(locals_, residuals, strict=True):
            total[local.places] += local.jacobian.T @ (local.weight * (error / self.noise).ravel())
        return total

    def followed(self, locals_: Sequence[_Local], initial: Array, step: Array) -> Array:
        """Initial conditions (segments, 12) that go with a step (m,) of the unknowns."""
        moved = initial.copy()
        for index, local in enumerate(locals_):
            moved[index, self.initial_places] += local.toward - local.follow @ step[local.places]
        return moved

    def settled(self, values: Array, initial: Array) -> Array:
        """Change (segments, 12) towards better initial conditions at fixed values."""
        locals_, _, _ = self.differentiated(values, initial)
        return self.followed(locals_, np.zeros_like(initial), np.zeros(len(self.unknowns)))

    def weight(self, residual: Array) -> Array:
        """Weight in (0, 1] of residuals in standard deviations."""
        if self.joint.polish.loss == "squared":
            return np.ones_like(residual)
        return np.asarray(self.joint.polish.knee / np.maximum(np.abs(residual), self.joint.polish.knee))

    def cost(
        self, values: Array, initial: Array, centre: Array, residuals: Sequence[Array] | None = None
    ) -> float:
        """Half the robust sum of squares, priors included."""
        found = self.joint.residuals(values, initial) if residuals is None else residuals
        knee = math.inf if self.joint.polish.loss == "squared" else self.joint.polish.knee
        total = 0.0
        for error in found:
            size = np.abs(error / self.noise)
            inner = np.minimum(size, knee)
            total += float((inner * (size - 0.5 * inner)).sum())
        inside = initial[:, self.initial_places] / self.joint.initial_sd
        return total + 0.5 * float((inside**2).sum() + (((values - centre) / self.prior_sd) ** 2).sum())

    def estimate_noise(self, residuals: Sequence[Array]) -> None:
        """Set the channels' noise to the residuals' standard deviation, by the median of their size."""
        data = self.joint.data
        for column, channel in enumerate(self.joint.used):
            counted = [self.joint.counted(i)[:, column] for i in range(len(residuals))]
            sizes = np.concatenate([np.abs(r[c, column]) for r, c in zip(residuals, counted, strict=True)])
            sizes = sizes[np.isfinite(sizes)]
            noise = 1.4826 * float(np.median(sizes)) if len(sizes) else math.inf
            floor = _NOISE_FLOOR * data.scale[channel]
            self.noise[column] = max(noise, floor) / math.sqrt(data.weights[channel])

    def linearisation(self, values: Array, initial: Array, extra: Sequence[str]) -> Linearisation:
        """Linearisation at a point."""
        joint, pieces = self.joint, []
        info = joint.vehicle.coefficient_info()
        present = joint.vehicle.coefficients()
        size = len(self.unknowns) + len(extra)
        slopes = joint.slopes(values, initial, extra=extra)
        for index, (error, by_unknown, by_initial, places) in enumerate(slopes):
            local, _, _ = self._eliminated(error, by_unknown, by_initial, places, initial[index])
            segment = joint.data.segments[index]
            trial = joint.data.trials[segment.trial]
            full = np.zeros((*error.shape, size))
            full[:, :, places] = local.jacobian.reshape(*error.shape, -1)
            pieces.append(
                Piece(
                    trial=joint.data.names[segment.trial],
                    t=trial.t[segment.start : segment.stop],
                    residual=error / self.noise,
                    counted=joint.counted(index),
                    weight=local.weight.reshape(error.shape),
                    jacobian=full,
                    nu=trial.smooth_nu(trial.t[segment.start : segment.stop])[0],
                )
            )
        added = tuple(
            Unknown(name, "coefficient", info[name]["unit"], -math.inf, math.inf, math.inf, 0.0, math.inf)
            for name in extra
        )
        return Linearisation(
            unknowns=(*joint.unknowns, *added),
            values=np.append(values, [present.get(name, 0.0) for name in extra]),
            channels=joint.channels,
            noise=self.noise.copy(),
            dt=joint.data.dt,
            pieces=tuple(pieces),
        )

    def scattered(self, start: Array, generator: np.random.Generator) -> Array:
        """Another start: coefficients anywhere in the middle half of their bounds."""
        count = len(self.joint.parameters)
        other = start.copy()
        inside = generator.uniform(0.25, 0.75, count)
        other[:count] = self.lower[:count] + inside * (self.upper[:count] - self.lower[:count])
        return other

    def judge(self, one: Polished) -> float:
        """Cost of a result in the noise of the first one's channels, so that results compare."""
        counts = [self.joint.data.counts[c] for c in self.joint.used]
        return one.cost + float(np.asarray(counts) @ np.log(one.noise))

    def _show(self, rounds: int, values: Array, initial: Array, centre: Array) -> None:
        if self.watch is not None:
            self.watch(
                Step(
                    "polish",
                    rounds,
                    self.joint.polish.rounds,
                    self.evaluations,
                    self.cost(values, initial, centre),
                    time.monotonic() - self.began,
                )
            )
