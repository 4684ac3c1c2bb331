"""A Gauss-Newton round of the joint estimate: differentiate all segments, eliminate their starts, step.

The initial conditions of a segment touch nothing else, so that they are eliminated segment by segment (Schur
complement, as in bundle adjustment); what is left goes to SciPy's trust-region solver with the bounds. Within
a round the derivatives are held: it costs one differentiated flight and a few plain ones. After a step of few
standard deviations they are held for the next round too; its residuals are its own.

Source: Triggs et al., *Bundle Adjustment: A Modern Synthesis* (2000), section 6; Huber (1964); Yohai & Zamar,
*JASA* 83 (1988) 406, for the robust scale.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from seatrial._core import initial_names
from seatrial.base.arrays import Array
from seatrial.estimation.joint import Joint
from seatrial.statistics.linearisation import Linearisation, Piece, trust
from seatrial.vehicle.actuators import fins_and_groups, pushed_axes

INITIALS: tuple[str, ...] = tuple(initial_names())
"""Initial conditions of a segment in the core's order."""


@dataclass(frozen=True)
class GaussNewtonSettings:
    """How far a round of Gauss and Newton goes with the derivatives that it has."""

    #: Flights of a round at most.
    trials: int = 6
    #: Share of a round's gain below which a step is its last: the derivatives of the next round tell more.
    little_share: float = 0.02
    #: Least noise of a channel, a share of its scale: a record without noise must not weigh infinitely.
    noise_floor: float = 1e-3
    #: Promise of a step, in twice the log-likelihood, up to which the derivatives are held for the next one:
    #: five to six standard deviations in all unknowns together. The residuals are always those of the step.
    held_promise: float = 30.0
    #: Promise, in the same units, up to which derivatives take half the step of the global search: an error
    #: of some thousandths in them is nothing beside the way that is left, and 0.06 standard deviations of a
    #: coefficient of the fastest motion at its end.
    fine_promise: float = 1e3
    #: Error, in standard deviations of the channel, from which a simulation counts as diverged.
    diverged_sd: float = 1e3


SETTINGS = GaussNewtonSettings()


def ran_away(joint: Joint, error: Array) -> bool:
    """Whether the simulation of a segment, with residuals (n, C), tells nothing of its coefficients."""
    return not np.all(np.abs(error) < SETTINGS.diverged_sd * joint.data.scale[joint.used])


_Slopes = list[tuple[Array, Array, NDArray[np.intp]]]


class _Ended(Exception):
    """A round has gained what its derivatives can tell."""


def _at_its_end(twice: Sequence[float], renewed: bool) -> bool:
    """Whether a round ends that tried points of these costs: after a step that gained little, or none.

    Derivatives that were not renewed for the round promise nothing for a shorter step than the first.
    """
    if len(twice) < 3:
        return len(twice) == 2 and not renewed and twice[1] >= twice[0]
    gained, last = twice[0] - min(twice[:-1]), min(twice[:-1]) - twice[-1]
    return gained > 0.0 and last < SETTINGS.little_share * gained


@dataclass(frozen=True)
class _Local:
    """A segment at the point of a round: weights (n, C), derivatives (n, C, k + s) by unknowns and by initial
    conditions, SI. The latter move by ``toward`` (s,), and by ``follow`` (s, k) with a step of the unknowns.
    """

    places: NDArray[np.intp]
    weight: Array
    jacobian: Array
    toward: Array
    follow: Array

    @property
    def alone(self) -> Array:
        """Derivatives (n, C, k) by the unknowns without what the initial conditions imitate, SI."""
        count = len(self.places)
        return self.jacobian[:, :, :count] - self.jacobian[:, :, count:] @ self.follow


class GaussNewton:
    """Workspace of one descent; `fixed` are the places of unknowns that keep their value."""

    def __init__(self, joint: Joint, fixed: frozenset[int] = frozenset()) -> None:
        self.joint = joint
        self.unknowns = joint.unknowns
        self.free = np.array([i for i in range(len(self.unknowns)) if i not in fixed], dtype=np.intp)
        self.lower = np.array([u.lower for u in self.unknowns])
        self.upper = np.array([u.upper for u in self.unknowns])
        self.scale = np.array([u.scale for u in self.unknowns])
        # A bound's width is a weak prior: what the data cannot tell stays where it was.
        known = np.array([u.prior_sd for u in self.unknowns]) / np.sqrt(joint.tempering)
        self.prior_sd = np.minimum(known, self.scale)
        self.initial_places = [INITIALS.index(name) for name in joint.initials]
        self.evaluations = 0
        self.held: _Slopes | None = None
        self._recent: list[tuple[bytes, list[Array]]] = []
        self.near = False  # whether the derivatives of the start hold all the way
        self.begin()

    def begin(self) -> None:
        """A descent begins: nothing is held of the one before."""
        coarse, fine = self.joint.coarser
        self.held, self.judging = None, coarse.substeps == fine.substeps
        self.noise = self.joint.noise.copy()

    def judge(self) -> None:
        """From here on derivatives are those that judge an estimate."""
        if not self.judging:
            self.held, self.judging = None, True

    def round(self, values: Array, initial: Array, centre: Array) -> tuple[Array, Array, float]:
        """Better values and initial conditions, and the promised gain in twice the log-likelihood."""
        from scipy.linalg import cholesky, solve_triangular
        from scipy.optimize import least_squares

        # One differentiated flight per round; the steps within it reuse derivatives and weights.
        renewed = self.held is None
        locals_, information, gradient = self.differentiated(values, initial)
        # A contradicted prior pulls with a constant force: it has no stiffness but that of the bounds.
        loose = trust(self.unknowns, values - centre) < 1.0
        precision = np.where(loose, self.scale, self.prior_sd) ** -2.0
        information = information + np.diag(precision)
        gradient = gradient - self.drawn(values - centre)
        # The solver sees unknowns in widths of their bounds, so that one trust region fits all.
        free = self.free
        scaled = information[np.ix_(free, free)] * np.outer(self.scale[free], self.scale[free])
        # Its Jacobian is a Cholesky factor of the reduced information: m rows for all samples. On a unit
        # diagonal the small ridge keeps a factor where the data leave a direction undetermined.
        size = np.sqrt(np.diag(scaled))
        factor = cholesky(scaled / np.outer(size, size) + 1e-12 * np.eye(len(free)), lower=False) * size
        at = values.copy()

        def moved(z: Array) -> tuple[Array, Array]:
            new = at.copy()
            new[free] = z * self.scale[free]
            return new, self.followed(locals_, initial, new - at)

        tried: list[tuple[float, Array]] = []

        def reduced(z: Array) -> Array:
            """A vector of the cost's size whose derivative at the start is the factor, below it zero."""
            if _at_its_end([cost for cost, _ in tried], renewed):
                raise _Ended
            new, begun = moved(z)
            residuals = self.residuals(new, begun)
            self.evaluations += 1
            twice = 2.0 * self.cost(new, begun, centre, residuals)
            tried.append((twice, z.copy()))
            if not math.isfinite(twice):
                return np.full(len(free) + 1, np.inf)
            # The head has the model's gradient, the last entry fills up to the true cost: the solver accepts
            # a step by what the simulation says and not by the linearisation.
            pull = self.pull(locals_, residuals) - self.drawn(new - centre)
            head = -solve_triangular(factor, pull[free] * self.scale[free], trans="T")
            return np.append(head, math.sqrt(max(twice - head @ head, 0.0)))

        held = np.vstack([factor, np.zeros(len(free))])
        z = at[free] / self.scale[free]
        lower, upper = self.lower[free] / self.scale[free], self.upper[free] / self.scale[free]
        with contextlib.suppress(_Ended):
            least_squares(
                reduced,
                np.clip(z, lower, upper),
                jac=lambda _: held,
                bounds=(lower, upper),
                max_nfev=SETTINGS.trials,
                ftol=1e-10,
                xtol=1e-10,
                gtol=1e-12,
            )
        new, begun = moved(min(tried, key=lambda trial: trial[0])[1])
        step = (new - at)[free]
        promised = float(step @ information[np.ix_(free, free)] @ step)
        if promised > SETTINGS.held_promise and not self.near:
            self.held = None
        if promised <= SETTINGS.fine_promise:
            self.judge()
        return new, begun, promised

    @cached_property
    def _counted(self) -> NDArray[np.bool_]:
        """Mask (samples, C) of what counts, all segments one after the other."""
        return np.concatenate([self.joint.counted(i) for i in range(len(self.joint.data.segments))])

    def residuals(self, values: Array, initial: Array) -> list[Array]:
        """Residuals (n, C) of every segment at a point; those of the last points are kept."""
        key = values.tobytes() + initial.tobytes()
        residuals = next((kept for known, kept in self._recent if known == key), None)
        if residuals is None:
            residuals = self.joint.residuals(values, initial)
            self._recent = [(key, residuals), *self._recent[: SETTINGS.trials]]
        return residuals

    def differentiated(self, values: Array, initial: Array) -> tuple[list[_Local], Array, Array]:
        """Segments at a point, the information (m, m) and the downhill gradient (m,) of what they tell."""
        size = len(self.unknowns)
        information, gradient, locals_ = np.zeros((size, size)), np.zeros(size), []
        for local, reduced, downhill in self.by_segment(values, initial):
            information[np.ix_(local.places, local.places)] += reduced
            gradient[local.places] += downhill
            locals_.append(local)
        return locals_, information, gradient

    def by_segment(self, values: Array, initial: Array) -> Iterator[tuple[_Local, Array, Array]]:
        """Every segment at a point, with information (k, k) and downhill gradient (k,) of its k unknowns."""
        for index, (error, jacobian, places) in enumerate(self._slopes(values, initial)):
            yield self._eliminated(error, jacobian, places, initial[index])

    def _slopes(self, values: Array, initial: Array) -> _Slopes:
        """Residuals and derivatives of every segment, the derivatives perhaps those of the round before."""
        if self.held is None:
            residuals = self.residuals(values, initial)
            self.held = self.joint.slopes(values, initial, judging=self.judging, residuals=residuals)
            return self.held
        residuals = self.residuals(values, initial)
        return [(error, *slopes[1:]) for error, slopes in zip(residuals, self.held, strict=True)]

    def _eliminated(
        self, error: Array, jacobian: Array, places: NDArray[np.intp], initial: Array
    ) -> tuple[_Local, Array, Array]:
        """A segment without its initial conditions, its information and gradient."""
        residual = error / self.noise
        weight = self.weight(residual)
        root = np.sqrt(weight)
        rows = (jacobian * (root / self.noise)[:, :, None]).reshape(root.size, -1)
        square, downhill = rows.T @ rows, rows.T @ (root * residual).ravel()
        # The block of the segment's own initial conditions, with their prior: small, and solved here.
        count, inside = len(places), initial[self.initial_places]
        precision = self.joint.initial_sd**-2.0
        normal, shared = square[count:, count:] + np.diag(precision), square[count:, :count]
        own = downhill[count:] - precision * inside
        # Initial conditions follow a step of the unknowns linearly, about where they move without one.
        solved = np.asarray(np.linalg.solve(normal, np.column_stack([shared, own])), dtype=float)
        follow, toward = solved[:, :count], solved[:, count]
        # Schur complement: what of the unknowns' columns the initial conditions cannot imitate. Information
        # and gradient of all segments then add up in the unknowns alone.
        return (
            _Local(places, weight, jacobian, toward, follow),
            square[:count, :count] - shared.T @ follow,
            downhill[:count] - shared.T @ toward,
        )

    def pull(self, locals_: Sequence[_Local], residuals: Sequence[Array]) -> Array:
        """Downhill gradient (m,) with derivatives and weights held."""
        total = np.zeros(len(self.unknowns))
        for local, error in zip(locals_, residuals, strict=True):
            weighted = (local.weight / self.noise**2 * error).ravel()
            downhill = local.jacobian.reshape(len(weighted), -1).T @ weighted
            count = len(local.places)
            total[local.places] += downhill[:count] - local.follow.T @ downhill[count:]
        return total

    def drawn(self, away: Array) -> Array:
        """Upward gradient (m,) of the priors this far from their centres."""
        return np.asarray(trust(self.unknowns, away) * self.prior_sd**-2.0 * away)

    def followed(self, locals_: Sequence[_Local], initial: Array, step: Array) -> Array:
        """Initial conditions (segments, 12) that go with a step (m,) of the unknowns."""
        moved = initial.copy()
        for index, local in enumerate(locals_):
            moved[index, self.initial_places] += local.toward - local.follow @ step[local.places]
        return moved

    def settled(self, values: Array, initial: Array) -> Array:
        """Change (segments, 12) towards better initial conditions at fixed values."""
        residuals = self.residuals(values, initial)
        slopes = self.joint.slopes(values, initial, starts_only=True, residuals=residuals)
        locals_ = [self._eliminated(*slope, initial[index])[0] for index, slope in enumerate(slopes)]
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
        errors = self.residuals(values, initial) if residuals is None else residuals
        return float(self._losses(errors).sum()) + self._priors(values, initial, centre)

    def merit(self, values: Array, initial: Array, centre: Array, residuals: Sequence[Array]) -> float:
        """Negative log-likelihood with every channel's scale at its best: what may not rise.

        ``sum_c w_c N_c ln tau_c`` and the priors, tau the scale of the residuals (Yohai & Zamar 1988): their
        noise times the root of twice the mean loss in it. With the squared loss it is their root mean square,
        and a noise that is estimated anew cannot raise it.
        """
        weights = self.joint.data.weights[self.joint.used]
        counts = np.maximum([self.joint.data.counts[c] for c in self.joint.used], 1.0) * weights
        mean = 2.0 * self._losses(residuals) / counts
        tau = self.noise * np.sqrt(weights * np.maximum(mean, np.finfo(float).tiny))
        total = float(counts @ (0.5 + np.log(tau))) + self._priors(values, initial, centre)
        return total if math.isfinite(total) else math.inf

    def _losses(self, residuals: Sequence[Array]) -> Array:
        """Sum (C,) of the robust losses of each channel's residuals, in its noise."""
        knee = math.inf if self.joint.polish.loss == "squared" else self.joint.polish.knee
        size = np.abs(np.concatenate(residuals) / self.noise)
        inner = np.minimum(size, knee)
        return np.asarray((inner * (size - 0.5 * inner)).sum(axis=0))

    def _priors(self, values: Array, initial: Array, centre: Array) -> float:
        """Half the squared distances from the priors' centres, in their standard deviations."""
        inside = initial[:, self.initial_places] / self.joint.initial_sd
        size, weight = (values - centre) / self.prior_sd, trust(self.unknowns, values - centre)
        return 0.5 * float((inside**2).sum() + (weight * (2.0 - weight) * size**2).sum())

    def estimate_noise(self, residuals: Sequence[Array]) -> None:
        """Set the noise to the residuals' standard deviation, with Huber's loss by their median size."""
        data, squared = self.joint.data, self.joint.polish.loss == "squared"
        every = np.abs(np.concatenate(residuals))
        for column, channel in enumerate(self.joint.used):
            sizes = every[self._counted[:, column], column]
            sizes = sizes[np.isfinite(sizes)]
            if not len(sizes):
                noise = math.inf
            elif squared:
                noise = math.sqrt(float(np.mean(sizes**2)))
            else:
                noise = 1.4826 * float(np.median(sizes))
            floor = SETTINGS.noise_floor * data.scale[channel]
            self.noise[column] = max(noise, floor) / math.sqrt(data.weights[channel])

    def linearisation(self, values: Array, initial: Array, extra: Sequence[str]) -> Linearisation:
        """Linearisation at a point."""
        joint, pieces = self.joint, []
        size = len(self.unknowns) + len(extra)
        residuals = self.residuals(values, initial)
        slopes = joint.slopes(values, initial, extra=extra, judging=True, residuals=residuals)
        for index, (error, jacobian, places) in enumerate(slopes):
            segment = joint.data.segments[index]
            counted = joint.counted(index)
            if ran_away(joint, error):
                # A simulation that ran away tells nothing of its coefficients, here.
                error, jacobian = np.zeros_like(error), np.zeros_like(jacobian)
                counted = np.zeros_like(counted)
            local, _, _ = self._eliminated(error, jacobian, places, initial[index])
            trial = joint.data.trials[segment.record]
            full = np.zeros((*error.shape, size))
            full[:, :, places] = local.alone / self.noise[:, None]
            pieces.append(
                Piece(
                    trial=joint.data.names[segment.record],
                    t=trial.t[segment.start : segment.stop],
                    residual=error / self.noise,
                    counted=counted,
                    weight=local.weight,
                    jacobian=full,
                    nu=trial.smooth_nu(trial.t[segment.start : segment.stop])[0],
                )
            )
        unknowns, values = joint.beside(values, extra)
        return Linearisation(
            unknowns=unknowns,
            values=values,
            channels=joint.channels,
            noise=self.noise.copy(),
            dt=joint.data.dt,
            pieces=tuple(pieces),
            pushed=pushed_axes(joint.vehicle),
            fins=fins_and_groups(joint.vehicle),
            tempering=np.append(joint.tempering, np.ones(len(extra))),
        )
