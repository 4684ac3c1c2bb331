"""Corrections as parameters of a residual between channels: fit, choice of those that count, deviations.

Both sides of a comparison go through the same Gaussian low-pass on a fine grid, so that neither gains a
delay; samples stay on their own stamps, between which cubic splines run. The residual's memory is taken out
by an autoregression before the fit (Cochrane and Orcutt 1949), outliers count as Huber (1981) counts them,
and the deviations come from sums of the scores over blocks of time (White 1980, clustered), which hold for
waves and other errors that remember; those of delays and factors from blocks that are drawn again. A
parameter enters the fit only if it is certain and reduces the residual; the one that reduces it most enters
first. Held by ``tests/inspect/test_consistency.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.trial.kinematics import Grid


@dataclass(frozen=True)
class KinematicFitSettings:
    """How the kinematic relations are fitted, and from when a parameter is believed."""

    memory_order: int = 6  #: order of the autoregression that takes out the residual's memory
    huber_deviations: float = 2.5  #: standard deviations from which a sample counts linearly
    certain_deviations: float = 5.0  #: deviations from which a parameter is believed
    block_s: float = 20.0  #: s, blocks of time that tell deviations
    most_blocks: int = 60  #: longer records have longer blocks
    fewest_blocks: int = 8  #: shorter records have shorter blocks
    most_rounds: int = 20  #: of the descent, which ends by itself where nothing moves
    most_steps_a_round: float = 5.0  #: steps of a shift's difference quotient in one round
    most_steps: float = 100.0  #: the same in all rounds together
    clearly_better: float = 0.97  #: residual of another start over that of the likelier one
    least_information: float = 1e-3  #: of the largest eigenvalue of the scaled information
    drawn_places: int = 9  #: each way, at which the cost of a parameter is told
    drawn_reach: float = 1.5  #: largest distance of a drawn place, in the parameter's unit
    draws: int = 60  #: of the parameters whose blocks are drawn
    #: noise of the attitude and the low-pass take away so much of a factor
    least_factor_deviation: float = 1e-3
    least_widths: float = 50.0  #: widths of the low-pass: a shorter record cannot be compared
    unresolved: float = 1e-9  #: m/s, rad/s or m/s^2: what no instrument resolves


SETTINGS = KinematicFitSettings()


@dataclass(frozen=True)
class Parameter:
    """A possible correction."""

    name: str  #: Its key.
    step: float  #: Difference quotient's step, in the parameter's unit.
    least: float  #: Smaller values do not matter.
    prior: float = np.inf  #: Standard deviation around zero known beforehand; infinite for none.
    always: bool = False  #: Whether it is fitted without being asked: a delay, or a nuisance.
    material: float = 0.0  #: Share by which it must reduce the residual's root mean square.
    shift: bool = False  #: Whether it shifts a sensor in time, a delay or a drift.
    #: Whether it multiplies a measured channel, whose own noise then makes it too small.
    factor: bool = False


@dataclass(frozen=True)
class Fit:
    """Values and deviations of the parameters that count, and the residual's root mean squares.

    ``alone`` is the root mean square without each of them, the others at their values and nuisances at zero.
    """

    values: dict[str, float]
    sd: dict[str, float]
    before: float
    after: float
    alone: dict[str, float]
    covariance: Array
    names: tuple[str, ...]


Residual = Callable[[Mapping[str, float]], tuple[Array, Mask]]


def fitted(
    residual: Residual,
    parameters: Sequence[Parameter],
    grid: Grid,
    starts: Sequence[Mapping[str, float]] = ({},),
) -> Fit | None:
    """Fit of the parameters that are certain and reduce the residual; None if too little can be compared.
    `residual`: (n, k) and where it may be used (n,) for given values, absent ones zero. `starts`: the
    likeliest first; a later one counts if it leads to a clearly smaller residual, for noise has many minima.
    """
    bare = _without_nuisances(residual, parameters)
    values = dict.fromkeys((parameter.name for parameter in parameters), 0.0)
    parameters = [parameter for parameter in parameters if _tells(residual, values, parameter)]
    active = [parameter for parameter in parameters if parameter.always]
    candidates = [parameter for parameter in parameters if not parameter.always]
    y, good = residual(values)
    if good.sum() * grid.step < SETTINGS.least_widths * grid.width:
        return None
    before = robust_rms(y[good])
    # Several starts: a delay has many minima.
    problem = _Problem(residual, grid)
    begun = [problem.descend(values | dict(start), active) for start in starts]
    values = begun[0]
    for other in begun[1:]:
        if robust_rms(_used(residual(other))) < SETTINGS.clearly_better * robust_rms(_used(residual(values))):
            values = other
    # Forward: the candidate that explains most enters, until none would count.
    while candidates:
        chosen = _next(problem, bare, values, active, candidates)
        if chosen is None:
            break
        active, candidates = (
            [*active, chosen],
            [parameter for parameter in candidates if parameter is not chosen],
        )
        values = problem.descend(values, active)
    # What entered early may have been explained by what entered later; the costly deviations come last.
    for spread in (problem.spread, problem.drawn):
        while True:
            values, covariance = spread(values, active)
            sd = dict(
                zip((parameter.name for parameter in active), np.sqrt(np.diag(covariance)), strict=True)
            )
            size = robust_rms(_used(bare(values)))
            weak = [
                parameter
                for parameter in active
                if not parameter.always and not _counts(parameter, values, sd, bare, size)
            ]
            if not weak:
                break
            worst = min(weak, key=lambda parameter: abs(values[parameter.name]) / sd[parameter.name])
            active = [parameter for parameter in active if parameter is not worst]
            values = problem.descend(values | {worst.name: 0.0}, active)
    y, good = bare(values)
    return Fit(
        {parameter.name: values[parameter.name] for parameter in active},
        {name: float(x) for name, x in sd.items()},
        before,
        robust_rms(y[good]),
        {parameter.name: robust_rms(_used(bare(values | {parameter.name: 0.0}))) for parameter in active},
        covariance,
        tuple(parameter.name for parameter in active),
    )


def _tells(residual: Residual, values: Mapping[str, float], parameter: Parameter) -> bool:
    """Whether the residual at `values` depends on a parameter, so that it can be told."""
    (y, good), (there, also) = (
        residual(values),
        residual({**values, parameter.name: values[parameter.name] + parameter.step}),
    )
    return bool(np.abs(there - y)[good & also].max(initial=0.0) > SETTINGS.unresolved)


def _without_nuisances(residual: Residual, parameters: Sequence[Parameter]) -> Residual:
    """The residual with the parameters at zero that are only known to be small: they explain nothing."""
    zero = {parameter.name: 0.0 for parameter in parameters if np.isfinite(parameter.prior)}
    return lambda values: residual({**values, **zero})


def _used(compared: tuple[Array, Mask]) -> Array:
    return compared[0][compared[1]]


def robust_rms(y: Array) -> float:
    """Root mean square of residuals (m, k), all in one sum, outliers beyond five deviations cut."""
    if not len(y):
        return 0.0
    scale = 1.4826 * np.median(np.abs(y), axis=0) + SETTINGS.unresolved
    return float(np.sqrt(np.mean(np.sum(np.clip(y, -5.0 * scale, 5.0 * scale) ** 2, axis=1))))


def _counts(
    parameter: Parameter,
    values: Mapping[str, float],
    sd: Mapping[str, float],
    residual: Residual,
    size: float,
) -> bool:
    """Whether a fitted parameter is certain, not small, and reduces the residual's `size`."""
    value = abs(values[parameter.name])
    if value < max(SETTINGS.certain_deviations * sd[parameter.name], parameter.least):
        return False
    return size < robust_rms(_used(residual({**values, parameter.name: 0.0}))) * (1.0 - parameter.material)


def _next(
    problem: _Problem,
    residual: Residual,
    values: Mapping[str, float],
    active: list[Parameter],
    candidates: list[Parameter],
) -> Parameter | None:
    """The candidate that reduces the cost most in a linear step, among those that would count."""
    linear = problem.linear(values, [*active, *candidates])
    size = robust_rms(_used(residual(values)))
    gains = []
    for k, parameter in enumerate(candidates):
        columns = [*range(len(active)), len(active) + k]
        value, sd, gain = linear.solve(columns)
        if abs(value) > max(SETTINGS.certain_deviations * sd, parameter.least):
            gains.append((gain, parameter, columns))
    for _, parameter, columns in sorted(gains, key=lambda entry: -entry[0]):
        change = dict(zip((p.name for p in (*active, parameter)), linear.step(columns), strict=True))
        there = {name: x + float(change.get(name, 0.0)) for name, x in values.items()}
        if robust_rms(_used(residual(there))) < size * (1.0 - parameter.material):
            return parameter
    return None


class _Linear:
    """Whitened, weighted residuals and their derivatives, ready for any choice of the columns.

    A shift in time moves a sensor's noise too, whose slope is not small: products of first derivatives alone
    (Gauss-Newton) would count it as motion, make steps too short and deviations too small. The second
    derivative, in `curvature` (p, p), takes it out again.
    """

    def __init__(self, y: Array, design: Array, weight: Array, blocks: Array, curvature: Array) -> None:
        # y (m,), design (m, p), weight (m,), blocks (m,) labels.
        self.weighted = design * weight[:, None]
        self.products = self.weighted.T @ design
        self.hessian = self.products + curvature
        self.gradient = self.weighted.T @ y
        self.y, self.design, self.weight, self.blocks = y, design, weight, blocks
        self.prior = np.full(design.shape[1], np.inf)
        self.at = np.zeros(design.shape[1])

    def step(self, columns: Sequence[int]) -> Array:
        """Newton step of the parameters in `columns`."""
        hessian, gradient = self._normal(columns, convex=True)
        return np.asarray(-np.linalg.lstsq(hessian, gradient, rcond=1e-12)[0], float)

    def _normal(self, columns: Sequence[int], *, convex: bool = False) -> tuple[Array, Array]:
        index = np.asarray(columns)
        information = 1.0 / self.prior[index] ** 2
        hessian = self.hessian[np.ix_(index, index)]
        size = np.sqrt(np.diag(self.products)[index]) + SETTINGS.unresolved
        # Where noise hides the motion the curvature vanishes: the deviation is then large, not imaginary.
        values, vectors = np.linalg.eigh(hessian / np.outer(size, size))
        if convex and values.min(initial=1.0) < SETTINGS.least_information:  # a step from there leads uphill
            values, vectors = np.linalg.eigh(self.products[np.ix_(index, index)] / np.outer(size, size))
        least = SETTINGS.least_information * max(float(values.max(initial=0.0)), SETTINGS.least_information)
        hessian = (vectors * np.maximum(values, least)) @ vectors.T * np.outer(size, size)
        hessian = hessian + np.diag(information)
        return hessian, self.gradient[index] + information * self.at[index]

    def covariance(self, columns: Sequence[int], change: Array) -> Array:
        """Covariance of the parameters in `columns`, robust to memory within blocks."""
        index = np.asarray(columns)
        hessian, _ = self._normal(columns)
        inverse = np.linalg.pinv(hessian, hermitian=True)
        left = self.y + self.design[:, index] @ change
        scores = self.weighted[:, index] * left[:, None]
        count = int(self.blocks.max()) + 1
        sums = np.stack([np.bincount(self.blocks, scores[:, j], count) for j in range(len(index))], axis=1)
        noise = float(np.sum(self.weight * left**2) / max(np.sum(self.weight), 1.0))
        information = np.diag(1.0 / self.prior[index] ** 2)
        meat = sums.T @ sums * (count / max(count - len(index), 1.0)) + information
        sandwich = inverse @ meat @ inverse
        plain = inverse * noise
        # The sandwich of few blocks may be too narrow by chance; never narrower than independent errors.
        scale = np.sqrt(np.maximum(np.diag(plain) / np.maximum(np.diag(sandwich), 1e-300), 1.0))
        return np.asarray(sandwich * np.outer(scale, scale))

    def solve(self, columns: Sequence[int]) -> tuple[float, float, float]:
        """New value of the last of `columns`, its deviation, and by how much the cost falls."""
        change = self.step(columns)
        gain = self._gain(columns) - (self._gain(columns[:-1]) if len(columns) > 1 else 0.0)
        sd = float(np.sqrt(self.covariance(columns, change)[-1, -1]))
        return float(self.at[columns[-1]] + change[-1]), sd, gain

    def _gain(self, columns: Sequence[int]) -> float:
        _, gradient = self._normal(columns)
        return float(-0.5 * gradient @ self.step(columns))


class _Problem:
    """A residual with its derivatives, its memory and its outliers."""

    def __init__(self, residual: Residual, grid: Grid) -> None:
        self.residual, self.grid = residual, grid
        # Denser samples would let the autoregression undo the low-pass and weigh what it took away.
        self.stride = max(1, round(2.0 * grid.width / grid.step))

    def linear(self, values: Mapping[str, float], parameters: Sequence[Parameter]) -> _Linear:
        """The problem about `values`."""
        y, good = self.residual(values)
        derivatives, shifts = [], [parameter for parameter in parameters if parameter.shift]
        second: dict[tuple[int, int], Array] = {}
        ahead: dict[str, Array] = {}
        for k, parameter in enumerate(parameters):
            there, also = self.residual({**values, parameter.name: values[parameter.name] + parameter.step})
            good = good & also
            if not parameter.shift:
                derivatives.append((there - y) / parameter.step)
                continue
            back, also = self.residual({**values, parameter.name: values[parameter.name] - parameter.step})
            good = good & also
            derivatives.append((there - back) / (2.0 * parameter.step))
            second[k, k] = (there - 2.0 * y + back) / parameter.step**2
            ahead[parameter.name] = there
        for i, parameter in enumerate(parameters):
            for j in range(i):
                other = parameters[j]
                # Delay and drift of one sensor; those of different sensors move different noise.
                if (
                    parameter in shifts
                    and other in shifts
                    and parameter.name.split(".")[1] == other.name.split(".")[1]
                ):
                    steps = {p.name: values[p.name] + p.step for p in (parameter, other)}
                    both, also = self.residual({**values, **steps})
                    good = good & also
                    across = both - ahead[parameter.name] - ahead[other.name] + y
                    second[i, j] = across / (parameter.step * other.step)
        thin = slice(None, None, self.stride)
        y, good, t = y[thin], good[thin], self.grid.t[thin]
        p = len(parameters)
        all_ = [d[thin] for d in (*derivatives, *second.values())]
        columns = np.stack(all_, axis=2) if all_ else np.zeros((*y.shape, 0))
        parts = [self._white(y[:, k], columns[:, k], good, t) for k in range(y.shape[1])]
        y, white, weight, blocks = (np.concatenate(x) for x in zip(*parts, strict=True))
        curvature = np.zeros((p, p))
        for (i, j), column in zip(second, white[:, p:].T, strict=True):
            curvature[i, j] = curvature[j, i] = float(np.sum(weight * y * column))
        linear = _Linear(y, white[:, :p], weight, blocks, curvature)
        linear.prior = np.array([parameter.prior for parameter in parameters])
        linear.at = np.array([values[parameter.name] for parameter in parameters])
        return linear

    def _white(self, y: Array, columns: Array, good: Mask, t: Array) -> tuple[Array, Array, Array, Array]:
        """Residual (m,) and derivatives (m, p) without memory and in deviations, weights, blocks."""
        from scipy.ndimage import minimum_filter1d
        from scipy.signal import lfilter

        centre = np.where(good, y - np.median(y[good]), 0.0)
        scale = 1.4826 * float(np.median(np.abs(centre[good]))) + SETTINGS.unresolved
        taps = _whitener(np.clip(centre, -4.0 * scale, 4.0 * scale), good)
        y = lfilter(taps, 1.0, np.where(good, y, 0.0))
        columns = lfilter(taps, 1.0, np.where(good[:, None], columns, 0.0), axis=0)
        width = len(taps)
        whole = minimum_filter1d(good.astype(np.uint8), width, mode="constant", origin=(width - 1) // 2)
        use = whole.astype(bool)
        if not use.any():
            use = good
        y, columns = y[use], columns[use]
        scale = 1.4826 * float(np.median(np.abs(y - np.median(y)))) + SETTINGS.unresolved
        y, columns = y / scale, columns / scale
        weight = 1.0 / np.maximum(np.abs(y) / SETTINGS.huber_deviations, 1.0)
        return y, columns, weight, _blocks(t)[use]

    def descend(self, values: dict[str, float], active: Sequence[Parameter]) -> dict[str, float]:
        """Values at the least cost over the active parameters."""
        values = dict(values)
        if not active:
            return values
        columns, begin = range(len(active)), dict(values)
        for _ in range(SETTINGS.most_rounds):
            linear = self.linear(values, active)
            # A shift goes no further at once than the low-pass lets see, and never far from its start.
            most = np.array([
                SETTINGS.most_steps_a_round * parameter.step if parameter.shift else np.inf
                for parameter in active
            ])
            change = np.clip(linear.step(columns), -most, most)
            for parameter, x in zip(active, change, strict=True):
                away = np.inf if not parameter.shift else SETTINGS.most_steps * parameter.step
                values[parameter.name] = float(
                    np.clip(
                        values[parameter.name] + x, begin[parameter.name] - away, begin[parameter.name] + away
                    )
                )
            if all(abs(x) < 0.02 * parameter.step for parameter, x in zip(active, change, strict=True)):
                break
        return values

    def spread(self, values: dict[str, float], active: Sequence[Parameter]) -> tuple[dict[str, float], Array]:
        """The values and the covariance of the active parameters, by the curvature of the cost."""
        if not active:
            return values, np.zeros((0, 0))
        return values, self.linear(values, active).covariance(range(len(active)), np.zeros(len(active)))

    def drawn(self, values: dict[str, float], active: Sequence[Parameter]) -> tuple[dict[str, float], Array]:
        """Values and covariance of the active parameters; of delays and factors by drawing blocks of time:
        noise makes the curvature over a delay uncertain, and a factor of the noisy channel too small.
        """
        values, covariance = self.spread(dict(values), active)
        for k, parameter in enumerate(active):
            kind, _, sensor = parameter.name.partition(".")
            if kind != "delay" and not parameter.factor:
                continue
            sd = float(np.sqrt(covariance[k, k]))
            values[parameter.name], resampled = self._resampled(values, parameter, sd)
            wider = max(resampled / sd, 1.0)
            for j, other in enumerate(active):
                if other is parameter or (kind == "delay" and other.name == f"drift.{sensor}"):
                    covariance[j, :] *= wider
                    covariance[:, j] *= wider
        return values, covariance

    def _resampled(self, values: Mapping[str, float], parameter: Parameter, sd: float) -> tuple[float, float]:
        """A parameter and its deviation by drawing blocks of time with replacement (Künsch 1989). The cost is
        that of the residual with or without its memory, whichever tells more: noise is no memory, and taking
        it out would weigh what the motion does not have.
        """
        reach = float(np.clip(5.0 * sd, 4.0 * parameter.step, SETTINGS.drawn_reach))
        places = values[parameter.name] + np.linspace(-reach, reach, 2 * SETTINGS.drawn_places + 1)
        shifted = [self.residual({**values, parameter.name: float(place)}) for place in places]
        thin = slice(None, None, self.stride)
        good = np.logical_and.reduce([known for _, known in shifted])[thin]
        y = np.stack([each[thin] for each, _ in shifted])  # (places, n, k)
        if good.sum() < SETTINGS.fewest_blocks:
            return values[parameter.name], sd
        blocks = _blocks(self.grid.t[thin])
        count = int(blocks.max()) + 1
        draws = np.random.default_rng(1).multinomial(count, np.full(count, 1.0 / count), size=SETTINGS.draws)
        # Of few blocks a normal deviation is too narrow: as Student's with one degree less.
        wider = np.sqrt(count / (count - 1.0)) * (1.0 + 1.0 / count)
        results = []
        for whiten in (True, False):
            parts = [self._costs(y[:, :, k], good, blocks, count, whiten=whiten) for k in range(y.shape[2])]
            cost = np.sum([part for part, _, _ in parts], axis=0)
            drawn = np.array([_lowest(places, cost @ draw) for draw in draws])
            own = wider * float(np.sqrt(np.mean((drawn - np.median(drawn)) ** 2)))
            if parameter.factor:
                # The channel's own noise makes its factor too small by its share of the size, the
                # reference's noise by nothing: uniform between the two.
                size = max(sum(slope for _, _, slope in parts) / (2.0 * reach) ** 2, 1e-300)
                share = sum(left for _, left, _ in parts) / size / np.sqrt(3.0)
                own = float(np.sqrt(own**2 + share**2 + SETTINGS.least_factor_deviation**2))
            results.append((own, _lowest(places, cost.sum(axis=1))))
        (own, value), (_, other) = sorted(results)
        # What depends on the choice is uncertain; a factor without its slow part is known not to hold.
        return value, own if parameter.factor else float(np.hypot(own, 0.5 * (value - other)))

    def _costs(
        self, y: Array, good: Mask, blocks: Array, count: int, *, whiten: bool
    ) -> tuple[Array, float, float]:
        """Huber's cost (places, blocks) of residuals (places, n), squares in the middle and of the change."""
        from scipy.ndimage import minimum_filter1d
        from scipy.signal import lfilter

        y = np.where(good, y - np.median(y[:, good], axis=1, keepdims=True), 0.0)
        middle = y[len(y) // 2]
        taps = np.array([1.0])
        if whiten:
            scale = 1.4826 * float(np.median(np.abs(middle[good]))) + SETTINGS.unresolved
            taps = _whitener(np.clip(middle, -4.0 * scale, 4.0 * scale), good)
        width = len(taps)
        whole = minimum_filter1d(good.astype(np.uint8), width, mode="constant", origin=(width - 1) // 2)
        use = whole.astype(bool) if whole.any() else good
        y = np.asarray(lfilter(taps, 1.0, y, axis=1))[:, use]
        squares = float(np.sum(y[len(y) // 2] ** 2)), float(np.sum((y[-1] - y[0]) ** 2))
        size = np.abs(y) / (1.4826 * float(np.median(np.abs(y[len(y) // 2]))) + SETTINGS.unresolved)
        cost = np.where(
            size < SETTINGS.huber_deviations,
            0.5 * size**2,
            SETTINGS.huber_deviations * (size - 0.5 * SETTINGS.huber_deviations),
        )
        return np.stack([np.bincount(blocks[use], row, count) for row in cost]), *squares


def _blocks(t: Array) -> Array:
    """Label of each time's block, (n,): parts that have little to do with each other."""
    span = t[-1] - t[0]
    length = min(max(SETTINGS.block_s, span / SETTINGS.most_blocks), span / SETTINGS.fewest_blocks)
    return np.asarray(np.minimum(((t - t[0]) / length).astype(int), int(span / length)))


def _lowest(x: Array, y: Array) -> float:
    """Place of the minimum of samples y(x), from the parabola through the lowest one and four neighbours."""
    i = int(np.clip(np.argmin(y), 2, len(x) - 3))
    a, b, _ = np.polyfit(x[i - 2 : i + 3] - x[i], y[i - 2 : i + 3], 2)
    near = float(np.clip(-0.5 * b / a, x[i - 2] - x[i], x[i + 2] - x[i])) if a > 0.0 else 0.0
    return float(x[i] + near)


def _whitener(y: Array, good: Mask) -> Array:
    """Filter (order + 1,) that leaves of the residual (n,) what its past does not foretell (Yule-Walker)."""
    from scipy.linalg import solve_toeplitz

    count = max(int(good.sum()), 1)
    covariances = np.array([float(y[: len(y) - k] @ y[k:]) / count for k in range(SETTINGS.memory_order + 1)])
    if not covariances[0] > 0.0:
        return np.array([1.0])
    covariances[0] *= 1.0 + 1e-4
    return np.concatenate([[1.0], -solve_toeplitz(covariances[:-1], covariances[1:])])
