"""Thrust by least squares: polynomials, their outliers and order, and tables over signal and voltage.

Model (Taubert et al. 2014, equation 36), second order in k inputs u with all products:

    y = a_0 + sum_i a_i u_i + sum_(i<j) a_ij u_i u_j + sum_i a_ii u_i^2

Equation 37 solves the normal equations on raw revolutions, whose condition is 5e13 for 21 points from 150 to
2000 rpm. Here every input is scaled to one and the design matrix is factorised, U = Q R, a = R^-1 Q' y:
condition 26. With e = y - U a, p coefficients and n points:

    s^2 = e'e/(n - p),  cov a = s^2 (U'U)^-1 + sum_j v_j (U^+ c_j)(U^+ c_j)'

The second term is the zero error of each load cell: it moves all its points together by c_j, with variance
v_j. Confidence band of the curve ``t sqrt(x' cov x)``, prediction band ``t sqrt(s^2 + x' cov x)``. Equation
38 calls two different numbers B: the squared correlation of y and its estimate, and SSR/SST. Both equal
``R^2 = 1 - SSE/SST`` only for least squares with intercept on its own data; R^2 decides, `paper_b` is shown.

Outliers: a robust first fit (iteratively reweighted, Tukey's biweight with the median of the absolute
residuals as scale; Huber and Ronchetti 2009, *Robust Statistics*, chapter 7) marks suspects, however many.
Each suspect is then judged by the fit to all that are not suspected: its deleted residual

    t = (y - x'a) / (s sqrt(1 + x' (U'U)^-1 x))

is Student distributed for a point of the model. It is an outlier beyond the two-sided 5 % point of Student's
distribution divided by the number of points (Bonferroni), so that one test in twenty has a false outlier.
Suspects that pass are used again.

Order (square, through the origin, free, cubic): ``AICc = n ln(SSE/n) + 2k + 2k(k + 1)/(n - k - 1)``, k = p +
1 (Hurvich and Tsai 1989, Biometrika 76:297). Two models less than 2 apart are as good as each other; then the
one with fewer coefficients is recommended. The F test asks whether a larger model of the same chain explains
more than the chosen one.

Table: the vehicle's table is read linearly between its knots, so the thrust at the knots is the least squares
fit of that very interpolation, ``F(s) = sum_j h_j(s) f_j`` with hat functions h_j, for each voltage apart. A
weak penalty on the second difference carries knots between which a voltage has no points. Knots are chosen
from the tested signals, one grid for all voltages: the two ends, the edges of the dead band, where thrust is
exactly zero, then the middle of the interval where a knot takes away most squared error, until no point lies
further off than the tolerance or there are as many knots as allowed. A polynomial in signal and voltage
becomes a table too (`from_surface`): the vehicle file has no other kind that knows the voltage.

Held by ``tests/bench_test/test_bench_regression.py`` and ``tests/bench_test/test_bench_table.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError

Term = tuple[int, ...]


@dataclass(frozen=True)
class RegressionSettings:
    """Intervals, outliers and choice of the order of a regression."""

    level: float = 0.95  #: Probability of all intervals and bands.
    false_alarm: float = 0.05  #: Chance that a test has a false outlier, as the head says.
    biweight: float = 4.685  #: Deviations: 95 % efficiency for normal errors.
    rounds: int = 50  #: Of reweighting, where it does not settle before.
    suspect: float = 3.0  #: Robust deviations: every suspect is judged again.
    as_good: float = 2.0  #: Difference of AICc within which the simpler order is taken.


SETTINGS = RegressionSettings()


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """A fitted polynomial: exponents of the inputs per coefficient, `scaled` coefficients (p,) of inputs
    divided by `scale` (k,), `factor` W (p, p) with their covariance W W', `residual` (n,) and its standard
    deviation `sigma` in N, `leverage` (n,), condition of the scaled matrix, 1 - SSE/SST, and `b` of
    equation 38.
    """

    terms: tuple[Term, ...]
    scale: Array
    scaled: Array
    factor: Array
    residual: Array
    leverage: Array
    sigma: float
    dof: int
    condition: float
    r2: float
    b: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients as the paper indexes them."""
        return tuple(coefficient_name(term) for term in self.terms)

    @property
    def coefficients(self) -> Array:
        """Coefficients (p,) of the inputs in their own units."""
        return np.asarray(self.scaled / self._powers)

    @property
    def covariance(self) -> Array:
        """Covariance (p, p) of the coefficients in their own units."""
        own = self.factor / self._powers[:, None]
        return np.asarray(own @ own.T)

    @property
    def standard_deviations(self) -> Array:
        """Standard deviations (p,) of the coefficients."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def quantile(self) -> float:
        """Student's t of the 95 % intervals."""
        return _student(self.dof)

    def intervals(self) -> Array:
        """95 % intervals (p, 2) of the coefficients."""
        half = self.quantile * self.standard_deviations
        return np.column_stack([self.coefficients - half, self.coefficients + half])

    def at(self, inputs: ArrayLike) -> Array:
        """Fitted values (m,) at inputs (m, k)."""
        return np.asarray(design(np.asarray(inputs) / self.scale, self.terms) @ self.scaled)

    def bands(self, inputs: ArrayLike) -> tuple[Array, Array]:
        """Half widths (m,) of the 95 % confidence band of the curve and of the prediction band of a point."""
        x = design(np.asarray(inputs) / self.scale, self.terms) @ self.factor
        curve = (x**2).sum(axis=1)
        return self.quantile * np.sqrt(curve), self.quantile * np.sqrt(self.sigma**2 + curve)

    @property
    def _powers(self) -> Array:
        return np.array([np.prod(self.scale ** np.array(term)) for term in self.terms])


def terms_of(
    order: int, inputs: int, *, through_origin: bool = False, square: bool = False
) -> tuple[Term, ...]:
    """Exponents of every coefficient: all products up to the order; through the origin those that contain the
    first input: no signal, no thrust at any voltage.

    Examples
    --------
    >>> [coefficient_name(term) for term in terms_of(2, 2)]
    ['a0', 'a1', 'a2', 'a11', 'a12', 'a22']
    >>> [coefficient_name(term) for term in terms_of(2, 2, through_origin=True)]
    ['a1', 'a11', 'a12']
    """
    if square:
        return ((2,) + (0,) * (inputs - 1),)
    every = [t for t in product(range(order + 1), repeat=inputs) if sum(t) <= order]
    every.sort(key=lambda t: (sum(t), tuple(-e for e in t)))
    return tuple(t for t in every if t[0] > 0 or not through_origin)


def coefficient_name(term: Term) -> str:
    """Name of a coefficient: its inputs' numbers, 0 for the intercept."""
    return "a" + ("".join(str(k + 1) * e for k, e in enumerate(term)) or "0")


def design(inputs: Array, terms: Sequence[Term]) -> Array:
    """Design matrix (n, p) of inputs (n, k)."""
    return np.column_stack([np.prod(inputs ** np.array(term), axis=1) for term in terms])


def least_squares(
    inputs: ArrayLike, y: ArrayLike, terms: Sequence[Term], *, common: ArrayLike | None = None
) -> LeastSquares:
    """Fit of values (n,) at inputs (n, k) by QR on inputs scaled to one; the terms are those of `terms_of`.
    `common` (n, m) has columns of one standard deviation each of errors that move points together: a
    cell's zero. A `ValueError` where the inputs do not determine the coefficients.
    """
    u, values = np.asarray(inputs, dtype=float), np.asarray(y, dtype=float)
    n, p = len(values), len(terms)
    if n <= p:
        raise ValueError(f"{n} operating points for {p} coefficients; expected at least {p + 1}")
    # Inputs of size one: the condition falls from 5e13 to some tens, as the head says.
    scale = np.abs(u).max(axis=0)
    scale[scale == 0.0] = 1.0
    matrix = design(u / scale, terms)
    q, r = np.linalg.qr(matrix)
    singular = np.linalg.svd(r, compute_uv=False)
    if singular[-1] <= 1e-10 * singular[0]:
        raise ValueError(
            "the operating points do not determine the coefficients (condition above 1e10); test more"
            " different commands and voltages, or lower the order"
        )
    inverse = np.linalg.solve(r, np.eye(p))
    scaled = inverse @ (q.T @ values)
    residual = values - matrix @ scaled
    dof = n - p
    sigma = float(np.sqrt(residual @ residual / dof))
    # The factor's columns times themselves are the covariance: scatter, then the zero of each cell.
    columns = [sigma * inverse]
    if common is not None:
        columns.append(inverse @ (q.T @ np.asarray(common, dtype=float)))
    fitted = values - residual
    return LeastSquares(
        terms=tuple(terms),
        scale=scale,
        scaled=scaled,
        factor=np.hstack(columns),
        residual=residual,
        leverage=(q**2).sum(axis=1),
        sigma=sigma,
        dof=dof,
        condition=float(singular[0] / singular[-1]),
        r2=r_squared(values, fitted),
        b=paper_b(values, fitted),
    )


def r_squared(measured: ArrayLike, fitted: ArrayLike) -> float:
    """1 - SSE/SST: what the model explains of the scatter about the mean; it may be negative."""
    y, estimate = np.asarray(measured, dtype=float), np.asarray(fitted, dtype=float)
    total = float(((y - y.mean()) ** 2).sum())
    return 1.0 - float(((y - estimate) ** 2).sum()) / total if total > 0.0 else np.nan


def paper_b(measured: ArrayLike, fitted: ArrayLike) -> float:
    """Squared correlation of measured and fitted values, equation 38: blind to a wrong gain."""
    y, estimate = np.asarray(measured, dtype=float), np.asarray(fitted, dtype=float)
    y, estimate = y - y.mean(), estimate - estimate.mean()
    power = float((y @ y) * (estimate @ estimate))
    return float((y @ estimate) ** 2 / power) if power > 0.0 else np.nan


def _student(dof: int, probability: float = 0.5 * (1.0 + SETTINGS.level)) -> float:
    """Quantile of Student's distribution."""
    from scipy.stats import t

    return float(t.ppf(probability, dof))


def outliers(inputs: Array, y: Array, terms: Sequence[Term]) -> NDArray[np.bool_]:
    """Mask (n,) of the points at inputs (n, k) that are outliers of a polynomial with these terms."""
    matrix = design(inputs / np.maximum(np.abs(inputs).max(axis=0), 1e-300), terms)
    n, p = matrix.shape
    nobody = np.zeros(n, bool)
    if n < p + 3:
        return nobody
    suspect = _suspects(matrix, y)
    most = max(1, min(n // 4, n - p - 2))
    while suspect.any():
        clean = ~suspect
        if suspect.sum() > most:
            return nobody  # so many suspects mean a wrong model, not wrong points
        q, r = np.linalg.qr(matrix[clean])
        if np.abs(np.diag(r)).min() <= 1e-10 * np.abs(np.diag(r)).max():
            return nobody
        coefficients = np.linalg.solve(r, q.T @ y[clean])
        residual = y - matrix @ coefficients
        dof = int(clean.sum()) - p
        sigma = float(np.sqrt(residual[clean] @ residual[clean] / dof))
        if sigma <= 1e-12 * np.abs(y).max():
            return nobody if np.abs(residual).max() <= 1e-9 * np.abs(y).max() else suspect
        lever = (np.linalg.solve(r.T, matrix.T) ** 2).sum(axis=0)
        tests = np.abs(residual) / (sigma * np.sqrt(1.0 + lever))
        limit = _student(dof, 1.0 - 0.5 * SETTINGS.false_alarm / n)
        honest = suspect & (tests <= limit)
        if not honest.any():
            return suspect
        suspect[np.argmin(np.where(honest, tests, np.inf))] = False
    return nobody


def _suspects(matrix: Array, y: Array) -> NDArray[np.bool_]:
    """Points beyond three robust standard deviations of a robust fit."""
    n, p = matrix.shape
    weight = np.ones(n)
    scale, residual = 0.0, y
    for _ in range(SETTINGS.rounds):
        root = np.sqrt(weight)
        coefficients = np.linalg.lstsq(root[:, None] * matrix, root * y, rcond=None)[0]
        former, residual = residual, y - matrix @ coefficients
        scale = 1.4826 * float(np.median(np.abs(residual))) * np.sqrt(n / (n - p))
        if scale <= 1e-12 * np.abs(y).max() or np.abs(residual - former).max() <= 1e-9 * scale:
            break
        weight = np.where(
            np.abs(residual) < SETTINGS.biweight * scale,
            (1.0 - (residual / (SETTINGS.biweight * scale)) ** 2) ** 2,
            0.0,
        )
    return np.asarray(np.abs(residual) > max(SETTINGS.suspect * scale, 1e-9 * float(np.abs(y).max())))


MODELS: dict[str, tuple[tuple[Term, ...], str]] = {
    "square": (terms_of(2, 1, square=True), 'order = "square"'),
    "second order through the origin": (
        terms_of(2, 1, through_origin=True),
        "order = 2, through_origin = true",
    ),
    "second order, free": (terms_of(2, 1), "order = 2, through_origin = false"),
    "third order, free": (terms_of(3, 1), "order = 3, through_origin = false"),
}
"""Models that are compared: terms and the keys that ask for them, each contained in the next."""


@dataclass(frozen=True)
class Candidate:
    """One model on the same points: what to write in the bench file for it, its sum of squares in N²,
    standard deviation of the residuals in N, and AICc; lower is better.
    """

    name: str
    keys: str
    terms: tuple[Term, ...]
    sse: float
    scatter: float
    aicc: float


def candidates(signal: Array, thrust: Array) -> tuple[Candidate, ...]:
    """Candidates that the points (n,) can determine, by AICc, the best one first."""
    models = []
    n = len(thrust)
    for name, (terms, keys) in MODELS.items():
        k = len(terms) + 1
        if n - k - 1 < 1:
            continue
        try:
            fit = least_squares(signal[:, None], thrust, terms)
        except ValueError:
            continue
        # Exact data have no scatter: rounding of the load is then the floor.
        sse = max(float(fit.residual @ fit.residual), n * (1e-9 * float(np.abs(thrust).max())) ** 2)
        aicc = n * math.log(sse / n) + 2 * k + 2 * k * (k + 1) / (n - k - 1)
        models.append(Candidate(name, keys, terms, sse, fit.sigma, aicc))
    return tuple(sorted(models, key=lambda model: model.aicc))


def recommended(models: tuple[Candidate, ...]) -> Candidate:
    """Candidate with the fewest coefficients among those as good as the best."""
    good = [model for model in models if model.aicc - models[0].aicc < SETTINGS.as_good]
    return min(good, key=lambda model: len(model.terms))


def lack_of_fit(models: tuple[Candidate, ...], chosen: tuple[Term, ...], n: int) -> str:
    """Sentence on whether the chosen terms fit the n points, and what would fit better."""
    if not models:
        return "too few points to compare orders"
    best = recommended(models)
    own = next((model for model in models if model.terms == chosen), None)
    if own is None:
        return f"of the usual models {best.name} describes the points best ({best.keys})"
    if own.aicc - best.aicc < SETTINGS.as_good:
        fewer = len(best.terms) < len(own.terms)
        name = "thrust per n|n|" if own.name == "square" else own.name
        return f"{name} fits" + (f"; {best.name} as well, with fewer coefficients" if fewer else "")
    if set(best.terms) < set(own.terms):
        return (
            f"{best.name} fits as well, with fewer coefficients ({best.keys}): the intervals would be"
            " narrower"
        )
    return (
        f"{best.name} describes the points better ({best.keys}): they scatter by {best.scatter:.2g} N instead"
        f" of {own.scatter:.2g} N, AICc lower by {own.aicc - best.aicc:.1f}{_f_words(own, best, n)}; the"
        " intervals stand for a curve of the order asked for"
    )


def _f_words(small: Candidate, large: Candidate, n: int) -> str:
    if not set(small.terms) < set(large.terms):
        return ""
    from scipy.stats import f

    more, dof = len(large.terms) - len(small.terms), n - len(large.terms)
    ratio = (small.sse - large.sse) / more / (large.sse / dof)
    p = float(f.sf(ratio, more, dof))
    return f", F test p {'below 0.001' if p < 0.001 else f'= {p:.2g}'}"


@dataclass(frozen=True)
class ThrustTableSettings:
    """How a table of thrust over voltage is made of points."""

    level_gap_v: float = 0.1  #: V between two levels of a supply: its ripple is smaller.
    most_levels: int = 25  #: More are a supply that drifts.
    tolerance: float = 0.01  #: Of the largest thrust: what a load cell can tell.
    silent_share: float = 0.002  #: Of the largest thrust: less is none.
    at_rest: float = 0.25  #: Of the tolerance, at zero thrust: weak points are known more exactly.
    stiffness: float = 1e-3  #: Of a point's weight: bridges gaps and moves no point.


TABLE_SETTINGS = ThrustTableSettings()


@dataclass(frozen=True, eq=False)
class ThrustTable:
    """Thrust over signal and supply voltage: knots (k,) from neutral, levels (v,) in V (empty when measured
    at one), ``force`` (v, k) or (1, k) in N.

    ``level`` (n,) is the row of ``force`` of each point, the nearest one of a surface, ``residual`` (n,)
    measured minus table, N; between the signals of the ``dead_band`` no point pulled.
    """

    signal: Array
    voltage_v: Array
    force: Array
    level: NDArray[np.int_]
    residual: Array
    dead_band: tuple[float, float]

    def at(self, signal: Array, voltage_v: Array | None = None) -> Array:
        """Thrust (m,) in N, bilinear, held beyond the edges."""
        rows = np.array([self.force_at(row, signal) for row in range(len(self.force))])
        if len(rows) == 1 or voltage_v is None:
            return np.asarray(rows[0])
        position = np.interp(voltage_v, self.voltage_v, np.arange(len(self.voltage_v)))
        low = np.minimum(position.astype(int), len(rows) - 2)
        share = position - low
        every = np.arange(rows.shape[1])
        return np.asarray((1.0 - share) * rows[low, every] + share * rows[low + 1, every])

    def force_at(self, row: int, signal: Array) -> Array:
        """Thrust (m,) in N at the voltage of a row."""
        return np.asarray(np.interp(signal, self.signal, self.force[row]))

    def errors(self) -> list[dict[str, float]]:
        """Per voltage its points, root mean square and largest residual in N."""
        errors = []
        for row in range(len(self.force)):
            own = self.residual[self.level == row]
            if len(own):
                errors.append({
                    "voltage_v": float(self.voltage_v[row]) if len(self.voltage_v) else np.nan,
                    "points": float(len(own)),
                    "rms_n": float(np.sqrt(np.mean(own**2))),
                    "largest_n": float(np.abs(own).max()),
                })
        return errors


def levels(voltage_v: Array, where: str) -> tuple[Array, NDArray[np.int_]]:
    """Voltages (v,) at which was tested, from those of the points (n,), and the level of each point; a
    `TrialError` where the voltage drifts instead of standing at levels, or is unknown.
    """
    if not np.isfinite(voltage_v).all():
        raise TrialError(
            f"{where}: the supply voltage is not known at every point; map a column voltage_v, give"
            ' voltage_v, or leave "voltage" out of the inputs'
        )
    order = np.argsort(voltage_v)
    level = np.empty(len(voltage_v), dtype=int)
    level[order] = np.concatenate([[0], np.cumsum(np.diff(voltage_v[order]) > TABLE_SETTINGS.level_gap_v)])
    means = np.array([voltage_v[level == k].mean() for k in range(level.max() + 1)])
    widths = np.array([np.ptp(voltage_v[level == k]) for k in range(level.max() + 1)])
    if len(means) > TABLE_SETTINGS.most_levels or (widths > 5.0 * TABLE_SETTINGS.level_gap_v).any():
        raise TrialError(
            f"{where}: the supply voltage has no distinct levels (it runs from {voltage_v.min():.2f} to"
            f' {voltage_v.max():.2f} V); use order = 2 with inputs = ["signal", "voltage"], whose surface'
            " needs none"
        )
    return means, level


def from_points(
    signal: Array, thrust: Array, voltage_v: Array | None, *, knots: int, tolerance: float | None, where: str
) -> ThrustTable:
    """Table of the points (n,) themselves. No further knot is added where the table errs by `tolerance` in N
    (by default one per cent of the largest thrust) at the largest thrust, or a quarter of it at rest.
    """
    means, level = (
        (np.zeros(1), np.zeros(len(signal), dtype=int)) if voltage_v is None else levels(voltage_v, where)
    )
    distinct = np.unique(signal)
    if len(distinct) < 4:
        raise TrialError(f"{where}: a table needs at least 4 different signals, found {len(distinct)}")
    largest = float(np.abs(thrust).max())
    if largest == 0.0:
        raise TrialError(f"{where}: no point has any thrust; check the load's column")
    goal = TABLE_SETTINGS.tolerance * largest if tolerance is None else tolerance
    allowed = goal * (TABLE_SETTINGS.at_rest + (1.0 - TABLE_SETTINGS.at_rest) * np.abs(thrust) / largest)
    silent = dead_band(signal, thrust)
    # Held beyond its ends, a table of one direction alone would push at rest, too: it begins at zero.
    lowest, highest = min(float(distinct[0]), 0.0), max(float(distinct[-1]), 0.0)
    edges = [x for x in (silent if silent[0] < silent[1] else (0.0,)) if lowest < x < highest]
    chosen = sorted({lowest, *edges, highest})
    while True:
        grid = np.array(chosen)
        force = np.array([
            _hats(signal[level == k], thrust[level == k], grid, silent) for k in range(len(means))
        ])
        fitted = np.empty(len(signal))
        for k in range(len(means)):
            fitted[level == k] = np.interp(signal[level == k], grid, force[k])
        residual = thrust - fitted
        knot = _next_knot(signal, level, residual / allowed, distinct, grid, silent)
        if knot is None or len(chosen) >= knots:
            break
        chosen = sorted({*chosen, knot})
    return ThrustTable(grid, means if voltage_v is not None else np.zeros(0), force, level, residual, silent)


def from_surface(
    thrust_at: Callable[[Array, Array], Array],
    signal: Array,
    thrust: Array,
    voltage_v: Array | None,
    *,
    grid: Sequence[float],
    voltages: Sequence[float],
) -> ThrustTable:
    """Table of a fitted function of signal and voltage on a grid, with its residuals at the points (n,)."""
    knots = np.asarray(grid, dtype=float)
    volts = np.asarray(voltages, dtype=float)
    force = np.array([thrust_at(knots, np.full(len(knots), v)) for v in (volts if len(volts) else [np.nan])])
    made = ThrustTable(knots, volts, force, np.zeros(len(signal), int), np.zeros(len(signal)), (0.0, 0.0))
    level = (
        made.level
        if voltage_v is None or not len(volts)
        else np.abs(voltage_v[:, None] - volts).argmin(axis=1)
    )
    return ThrustTable(knots, volts, force, level, thrust - made.at(signal, voltage_v), (0.0, 0.0))


def dead_band(signal: Array, thrust: Array) -> tuple[float, float]:
    """Widest interval of the signal about zero in which no point pulls over 0.2 % of the largest thrust;
    zeros when there is none.
    """
    pulling = np.abs(thrust) > TABLE_SETTINGS.silent_share * np.abs(thrust).max(initial=0.0)
    below, above = signal[pulling & (signal < 0.0)], signal[pulling & (signal > 0.0)]
    quiet = signal[~pulling & (signal != 0.0)]
    lower = quiet[quiet > below.max(initial=-np.inf)].min(initial=0.0)
    upper = quiet[quiet < above.min(initial=np.inf)].max(initial=0.0)
    return float(min(lower, 0.0)), float(max(upper, 0.0))


def _hats(signal: Array, thrust: Array, grid: Array, silent: tuple[float, float]) -> Array:
    """Thrust (k,) at the knots: least squares of the linear interpolation, zero inside the dead band."""
    from scipy.optimize import lsq_linear

    position = np.interp(signal, grid, np.arange(len(grid)))
    low = np.minimum(position.astype(int), len(grid) - 2)
    share = position - low
    matrix = np.zeros((len(signal), len(grid)))
    rows = np.arange(len(signal))
    matrix[rows, low] = 1.0 - share
    matrix[rows, low + 1] += share
    width = np.diff(grid) / np.ptp(grid)
    bend = np.zeros((len(grid) - 2, len(grid)))
    for j in range(len(bend)):
        bend[j, j : j + 3] = 1.0 / width[j], -1.0 / width[j] - 1.0 / width[j + 1], 1.0 / width[j + 1]
        bend[j] *= TABLE_SETTINGS.stiffness * min(width[j], width[j + 1])
    free = (grid < silent[0]) | (grid > silent[1])
    if silent == (0.0, 0.0):
        free = grid != 0.0  # no signal, no thrust
    solved = np.zeros(len(grid))
    stacked = np.vstack([matrix, bend])[:, free]
    target = np.concatenate([thrust, np.zeros(len(bend))])
    # Noise at the edge of a dead band must not turn the thrust round.
    ahead = grid[free] > 0.0
    bounds = (np.where(ahead, 0.0, -np.inf), np.where(ahead, np.inf, 0.0))
    if (thrust * signal).sum() < 0.0:
        bounds = (-bounds[1], -bounds[0])
    solved[free] = lsq_linear(stacked, target, bounds).x
    solved[np.abs(solved) < 1e-6 * np.abs(thrust).max(initial=0.0)] = 0.0
    return solved


def _next_knot(
    signal: Array,
    level: NDArray[np.int_],
    error: Array,
    distinct: Array,
    grid: Array,
    silent: tuple[float, float],
) -> float | None:
    """Tested signal in the middle of the interval where a knot takes away most squared error, at all
    voltages; None when no error is above one.
    """
    if np.abs(error).max() <= 1.0:
        return None
    gains = np.zeros(len(grid) - 1)
    for j, (lower, upper) in enumerate(pairwise(grid)):
        bump = np.maximum(1.0 - np.abs(2.0 * signal - lower - upper) / (upper - lower), 0.0)
        for k in range(level.max() + 1):
            own = bump[level == k]
            gains[j] += float(own @ error[level == k]) ** 2 / max(float(own @ own), 1e-12)
    for j in np.argsort(-gains):
        lower, upper = grid[j], grid[j + 1]
        if silent[0] <= lower and upper <= silent[1]:
            continue
        inside = distinct[(distinct > lower) & (distinct < upper)]
        if len(inside) and gains[j] > 0.0:
            return float(inside[np.abs(inside - 0.5 * (lower + upper)).argmin()])
    return None
