"""Significance: score tests of missing terms, rank tests of causes, and corrections for many tests.

**Score tests** say what one more term would gain on top of the fitted ones, and whether it is significant.
For a candidate column h (what the channels would show of a missing term) beside the fitted columns J with
weights W and priors P:

    h~ = h - J (J'WJ + P)^-1 J'W h,   g = h~'W r / h~'W h~,   gain = (h~'W r)^2 / h~'W h~

is Rao's score test as a regression of the residuals (Breusch & Pagan 1980): the step g of the coefficient
to first order and the fall of the sum of squares, with every fitted unknown refitted. Residuals of sea
trials are coloured and uneven, so the variance of g is that of the jackknife over blocks longer than the
residual's memory (Kuensch 1989): block b left out gives g_b, ``var g = (B - 1)/B sum (g_b - g)^2``, never
below the variance that white residuals would give. It is as good as the blocks in which the candidate acts
are many: Student's distribution with ``df = (sum q_b)^2 / sum q_b^2 - 1`` for their shares q_b of h~'W h~
(Satterthwaite 1946). A gain that one block alone carries is thereby no evidence.

**Rank tests** judge one suspected cause (two samples, correlation, direction). Where more than half of the
missions share a value (no outage; a requirement on words that is held), ranks are ties, and the normal
approximation calls a coincidence of two rare things proof: one failure of 200 that met an outage of a tenth
of them has p = 0.003 by it, and 0.1 in truth. Such numbers are tested twice: whether they have the common
value (Fisher's exact test), and by the ranks of the others; the smaller p-value counts twofold.

Tests: ``tests/statistics``, ``tests/verification/test_causes.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.statistics.linearisation import Linearisation


@dataclass(frozen=True)
class ScoreTestSettings:
    """Which candidates a score test judges, and from how many samples."""

    #: Share of a candidate left after projection, below which it is collinear with the fitted columns.
    collinear_share: float = 1e-6
    #: Added to the diagonal of a matrix of unit sizes: above rounding, below any information.
    jitter: float = 1e-12
    #: Blocks that a jackknife variance needs.
    least_blocks: int = 4
    #: More samples than about this are thinned evenly: a missing term that matters shows in a part of them.
    samples: int = 3000


SETTINGS = ScoreTestSettings()


@dataclass(frozen=True)
class SingleTests:
    """Sums over all blocks (row 0) and without each block, after the fitted columns are projected out.

    `squares`, `aims`: products (1 + B, k) of each of the k candidates with itself and with the residual.
    `own`: squares (k,) of the candidates before the projection. `left`: weighted sum of squares of the
    residual after the projection. `cost`: the same before it. `samples`: sum of the weights.
    """

    squares: Array
    aims: Array
    own: Array
    left: float
    cost: float
    samples: float

    @property
    def testable(self) -> NDArray[np.bool_]:
        """Mask (k,) of the candidates that are not collinear with the fitted columns."""
        return np.asarray(
            (self.squares[0] > SETTINGS.collinear_share * self.own)
            & (len(self.squares) > SETTINGS.least_blocks)
        )

    def results(self) -> ScoreResults:
        """Step, sigma, gain and p-value of every candidate alone."""
        from scipy.stats import t as student

        testable = self.testable
        full = np.where(testable, self.squares[0], 1.0)
        step = np.where(testable, self.aims[0] / full, 0.0)
        left = np.maximum(self.squares[1:], SETTINGS.collinear_share * full)
        away = self.aims[1:] / left - step
        count = len(away)
        scatter = (count - 1) / max(count, 1) * (away**2).sum(axis=0)
        gain = step**2 * full
        white = max(self.left, 0.0) / max(self.samples, 1.0) / full
        sigma = np.sqrt(np.maximum(scatter, white))
        share = np.maximum(full - self.squares[1:], 0.0)
        df = share.sum(axis=0) ** 2 / np.maximum((share**2).sum(axis=0), 1e-300) - 1.0
        known = testable & (df >= 1.0) & (sigma > 0.0)
        statistic = np.where(known, step / np.where(known, sigma, 1.0), 0.0)
        p = np.where(known, 2.0 * student.sf(np.abs(statistic), np.where(known, df, 1.0)), 1.0)
        return ScoreResults(
            step, sigma, gain / self.cost if self.cost > 0.0 else 0.0 * gain, statistic, df, p
        )


@dataclass(frozen=True)
class ScoreTests:
    """Tests that know the candidates' products with each other: what one is beside another.

    `reduced`: products (1 + B, k + 1, k + 1) of the k candidates and, last, the residual, as of
    `SingleTests`. `own`, `cost`, `samples`: of `SingleTests`.
    """

    reduced: Array
    own: Array
    cost: float
    samples: float

    @property
    def alone(self) -> SingleTests:
        """Every candidate by itself."""
        squares = np.diagonal(self.reduced, axis1=1, axis2=2)
        return SingleTests(
            squares[:, :-1],
            self.reduced[:, :-1, -1],
            self.own,
            float(squares[0, -1]),
            self.cost,
            self.samples,
        )

    @property
    def testable(self) -> NDArray[np.bool_]:
        """Mask (k,) of the candidates that are not collinear with the fitted columns."""
        return self.alone.testable

    def results(self) -> ScoreResults:
        """Step, sigma, gain and p-value of every candidate alone."""
        return self.alone.results()

    def among(self, candidates: Sequence[int]) -> ScoreTests:
        """The tests of some of the candidates alone."""
        kept = [*candidates, -1]
        return ScoreTests(
            self.reduced[:, kept][:, :, kept], self.own[list(candidates)], self.cost, self.samples
        )

    def beside(self, candidate: int) -> ScoreTests:
        """The tests with one candidate fitted too."""
        column = self.reduced[:, :, candidate]
        pivot = np.maximum(column[:, candidate], SETTINGS.collinear_share * self.own[candidate] + 1e-300)
        swept = self.reduced - column[:, :, None] * column[:, None, :] / pivot[:, None, None]
        swept[:, candidate, :] = 0.0
        swept[:, :, candidate] = 0.0
        return ScoreTests(swept, self.own, self.cost, self.samples)


@dataclass(frozen=True)
class ScoreResults:
    """Per candidate (k,): ``step`` of its coefficient, ``sigma``, ``gain`` as a share of the cost, Student's
    ``statistic`` with ``df`` degrees of freedom, two-sided ``p``.
    """

    step: Array
    sigma: Array
    gain: Array
    statistic: Array
    df: Array
    p: Array


def false_discovery(p: Array, tested: int | None = None) -> Array:
    """P-values (k,) adjusted for `tested` tests: the false discovery rate (Benjamini & Hochberg 1995).

    Below 0.05: where nothing is missing the chance of any false alarm, otherwise the share of false ones
    among those listed, is 5 %. Holds for independent and for positively dependent tests.

    Examples
    --------
    >>> false_discovery(np.array([0.01, 0.5, 0.02])).round(3).tolist()
    [0.03, 0.5, 0.03]
    """
    count = max(tested or 0, len(p))
    order = np.argsort(p, kind="stable")
    raw = np.minimum(count / (1.0 + np.arange(len(p))) * p[order], 1.0)
    adjusted = np.empty(len(p))
    adjusted[order] = np.minimum.accumulate(raw[::-1])[::-1]
    return adjusted


def score_tests(
    lin: Linearisation,
    columns: Sequence[Array],
    *,
    fitted: Sequence[int],
    block: Sequence[NDArray[np.intp]],
    channel: int | None = None,
) -> ScoreTests:
    """Score tests of candidate columns, given the fitted unknowns.

    `columns`: what the channels of each segment would show of the candidates, in the residual's unit.
    `fitted`: indices of the fitted unknowns. `block`: block of each sample of each segment, from 0 on.
    `channel`: place of the only channel that shows anything of the candidates.
    """
    sums = _sums(lin, columns, fitted=fitted, block=block, channel=channel, pairs=True)
    tried = np.concatenate([sums.tried, sums.aims[:, None, :]], axis=1)
    last = np.concatenate([sums.aims, sums.residual[:, None]], axis=1)
    whole = np.concatenate([tried, last[:, :, None]], axis=2)
    cross = np.concatenate([sums.cross, sums.pull[:, :, None]], axis=2)
    reduced = whole - cross.swapaxes(1, 2) @ sums.solved
    return ScoreTests(reduced, np.diagonal(sums.tried[0]).copy(), float(sums.residual[0]), sums.samples)


def single_tests(
    lin: Linearisation,
    columns: Sequence[Array],
    *,
    fitted: Sequence[int],
    block: Sequence[NDArray[np.intp]],
    channel: int | None = None,
) -> SingleTests:
    """The same tests of every candidate alone, in a part of the time where candidates are many.

    Parameters are those of `score_tests`.
    """
    sums = _sums(lin, columns, fitted=fitted, block=block, channel=channel, pairs=False)
    solved = sums.solved
    return SingleTests(
        sums.tried - np.einsum("bik,bik->bk", sums.cross, solved[:, :, :-1]),
        sums.aims - np.einsum("bi,bik->bk", sums.pull, solved[:, :, :-1]),
        sums.tried[0].copy(),
        float(sums.residual[0] - sums.pull[0] @ solved[0, :, -1]),
        float(sums.residual[0]),
        sums.samples,
    )


@dataclass(frozen=True)
class _Sums:
    """Products over all blocks (row 0) and without each: of the candidates, with each other (1 + B, k, k) or
    each with itself (1 + B, k), theirs with the residual (1 + B, k), and of the residual (1 + B,).

    ``cross`` (1 + B, i, k) and ``pull`` (1 + B, i) are those of the fitted columns with both, ``solved``
    (1 + B, i, k + 1) what these columns explain of them.
    """

    tried: Array
    aims: Array
    residual: Array
    cross: Array
    pull: Array
    solved: Array
    samples: float


def _sums(
    lin: Linearisation,
    columns: Sequence[Array],
    *,
    fitted: Sequence[int],
    block: Sequence[NDArray[np.intp]],
    channel: int | None,
    pairs: bool,
) -> _Sums:
    indices = list(fitted)
    inside, count = len(indices), 1 + max((int(b[-1]) for b in block), default=-1)
    width = columns[0].shape[2] if columns else 0
    normal, beside = np.zeros((count, inside + 1, inside + 1)), np.zeros((count, inside + 1, width))
    tried = np.zeros((count, width, width) if pairs else (count, width))
    samples = 0.0
    every = slice(None, None, max(1, sum(len(piece.t) for piece in lin.pieces) // SETTINGS.samples))
    shown = slice(None) if channel is None else slice(channel, channel + 1)
    for piece, own, dense in zip(lin.pieces, columns, block, strict=True):
        root, number = (np.sqrt(piece.weight) * piece.counted)[every], dense[every]
        samples += float((root**2).sum())
        known = np.concatenate(
            [piece.jacobian[every][:, :, indices], piece.residual[every][:, :, None]], axis=2
        )
        known *= root[:, :, None]
        acting = own[every] * root[:, shown, None]
        edges = np.flatnonzero(np.diff(number)) + 1
        starts = number[np.concatenate([[0], edges])]
        for part, of, at in zip(np.split(known, edges), np.split(acting, edges), starts, strict=True):
            # Candidates meet the fitted columns and the residual in the channels alone that show them.
            every_channel, among = part.reshape(-1, inside + 1), part[:, shown].reshape(-1, inside + 1)
            flat = of.reshape(-1, width)
            normal[at] += every_channel.T @ every_channel
            beside[at] += among.T @ flat
            tried[at] += flat.T @ flat if pairs else np.einsum("nk,nk->k", flat, flat)

    def without(sums: Array) -> Array:
        total = sums.sum(axis=0)
        return np.concatenate([total[None], total - sums])

    normal, beside, tried = without(normal), without(beside), without(tried)
    cross, pull = beside[:, :inside], normal[:, :inside, inside].copy()
    solved = np.zeros((count + 1, inside, width + 1))
    if inside:
        unknowns = [lin.unknowns[i] for i in indices]
        # The width of the bounds is the prior of what the data cannot determine, as in the fit.
        known = lin.precision[indices]
        precision = np.maximum(known, [u.scale**-2.0 for u in unknowns])
        pull += known * ([u.prior for u in unknowns] - np.asarray(lin.values)[indices])
        square = normal[:, :inside, :inside] + np.diag(precision)
        size = np.sqrt(np.maximum(np.diagonal(square[0]), 1e-300))
        square = square / np.outer(size, size) + SETTINGS.jitter * np.eye(inside)
        # In units of these sizes from here on.
        cross, pull = cross / size[:, None], pull / size
        solved = np.linalg.solve(square, np.concatenate([cross, pull[:, :, None]], axis=2))
    return _Sums(tried, beside[:, inside], normal[:, inside, inside], cross, pull, solved, samples)


def unexplained(lin: Linearisation, explaining: Sequence[Array], target: Sequence[Array]) -> list[Array]:
    """What of a target (n, C) per segment the columns (n, C, k) leave, by weighted least squares."""
    width = explaining[0].shape[2]
    normal, cross = np.zeros((width, width)), np.zeros(width)
    for piece, own, aim in zip(lin.pieces, explaining, target, strict=True):
        weight = (piece.weight * piece.counted).ravel()
        flat = own.reshape(-1, width)
        normal += flat.T @ (weight[:, None] * flat)
        cross += flat.T @ (weight * aim.ravel())
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    step = np.linalg.solve(normal / np.outer(size, size) + 1e-9 * np.eye(width), cross / size) / size
    return [np.asarray(aim - own @ step) for own, aim in zip(explaining, target, strict=True)]


_EXACT = 20_000  # pairs up to which the exact distribution is cheap


def holm(p_values: Sequence[float]) -> list[float]:
    """P-values corrected for their number, each step down (Holm 1979).

    Examples
    --------
    >>> holm([0.01, 0.04, 0.03])
    [0.03, 0.06, 0.06]
    """
    corrected, largest = [1.0] * len(p_values), 0.0
    for rank, index in enumerate(np.argsort(p_values, kind="stable")):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[index]))
        corrected[index] = largest
    return corrected


def mann_whitney(values: Array, other: Array) -> tuple[float, float]:
    """AUC, P(values > other), and two-sided p-value."""
    from scipy.stats import mannwhitneyu

    pairs = len(values) * len(other)
    if pairs == 0:
        return 0.5, 1.0
    tested = mannwhitneyu(values, other, method="auto" if pairs <= _EXACT else "asymptotic")
    auc = float(tested.statistic) / pairs
    common = _common_value(np.concatenate([values, other]))
    if common is not None:
        return auc, _with_common_value(values, other, common)
    p = float(tested.pvalue)
    return auc, p if p == p else 1.0


def uniform_scores(angle: Array, chosen: NDArray[np.bool_]) -> float:
    """P-value that the chosen directions, rad, are not others than the rest (Wheeler & Watson 1964).

    The ranks are spread evenly over the circle; R is the length of the sum over the chosen ones, and
    2 (k-1) R^2 / (n (k-n)) has a chi-square distribution with two degrees of freedom.
    """
    score, k, n = _scores(angle), len(angle), int(chosen.sum())
    pull = np.sum(np.cos(score[chosen])) ** 2 + np.sum(np.sin(score[chosen])) ** 2
    return float(np.exp(-(k - 1.0) * pull / (n * (k - n))))


def circular_correlation(angle: Array, values: Array) -> tuple[float, float]:
    """Rank correlation, 0 to 1, of directions, rad, with numbers, and p-value.

    After Mardia (1976, Biometrika 63:403).
    """
    from scipy.stats import rankdata

    score, rank = _scores(angle), rankdata(values)
    # The scores are spread evenly: their cosine and sine are uncorrelated.
    squared = min(1.0, _pearson(rank, np.cos(score)) ** 2 + _pearson(rank, np.sin(score)) ** 2)
    return float(np.sqrt(squared)), float(np.exp(-0.5 * (len(angle) - 1.0) * squared))


def spearman(values: Array, other: Array) -> tuple[float, float]:
    """Rank correlation, -1 to 1, and p-value; infinite values have a rank as any other."""
    from scipy.stats import rankdata
    from scipy.stats import t as student

    k = len(values)
    if k < 4:
        return 0.0, 1.0
    rho = _pearson(rankdata(values), rankdata(other))
    for ranked, against in ((values, other), (other, values)):
        common = _common_value(ranked)
        if common is not None:
            apart = ranked != common
            ps = [mann_whitney(against[apart], against[~apart])[1]]
            if len(np.unique(ranked[apart])) > 1:
                ps.append(spearman(values[apart], other[apart])[1])
            return rho, min(1.0, len(ps) * min(ps))
    left = max(1.0 - rho * rho, np.finfo(np.float64).eps)
    return rho, float(2.0 * student.sf(abs(rho) * np.sqrt((k - 2.0) / left), k - 2))


def _common_value(values: Array) -> float | None:
    """The value that more than half of them have, None without one."""
    middle = float(np.sort(values)[len(values) // 2])
    return middle if 2 * np.count_nonzero(values == middle) > len(values) else None


def _with_common_value(values: Array, other: Array, common: float) -> float:
    """P-value of two samples that mostly share one value: how often they differ from it, and by how much."""
    from scipy.stats import fisher_exact

    rare = [part[part != common] for part in (values, other)]
    if not any(len(part) for part in rare):
        return 1.0
    counts = [[len(left), len(part) - len(left)] for left, part in zip(rare, (values, other), strict=True)]
    ps = [float(fisher_exact(counts).pvalue)]
    # Only over values other than the common one: how often these occur is what the first test decides.
    if len(np.unique(np.concatenate(rare))) > 1:
        ps.append(mann_whitney(*rare)[1])
    return min(1.0, len(ps) * min(ps))


def _scores(angle: Array) -> Array:
    from scipy.stats import rankdata

    return np.asarray(2.0 * np.pi * rankdata(angle) / len(angle))


def _pearson(x: Array, y: Array) -> float:
    x, y = x - x.mean(), y - y.mean()
    size = float(np.sqrt((x @ x) * (y @ y)))
    return float(x @ y) / size if size > 0.0 else 0.0
