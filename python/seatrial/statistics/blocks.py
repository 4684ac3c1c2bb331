"""Dependent residuals: how long errors stay correlated, what they inflate, and the score of each block.

Sums over blocks that are long against that memory are nearly independent. `whitened` gives them in
coordinates in which the information of the whole estimate is the identity.

`information_criteria` compares models of the same data: ``-2 ln L = sum n_c ln s_c^2`` for Gaussian errors,
with the mean square s_c^2 of each channel's residual. Correlated samples must not count in full, or every
term that is freed looks significant: n_c is the number of independent samples, those that count over the
integrated autocorrelation time. AIC adds 2 k (Akaike 1974), BIC ``k ln sum n_c`` (Schwarz 1978); k is the
number of determined combinations less the part that priors hold, ``tr H^-1 sum H_b`` (Moody 1992).
Correlation between channels is not counted. Initial conditions of segments are left out of k: models of the
same segments have the same number of them.

Held by ``tests/statistics/test_uncertainty.py``, ``test_neighbours_that_resemble_widen_the_interval`` and
``test_the_standard_error_allows_for_samples_that_remember``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError
from seatrial.base.plain import Plain
from seatrial.statistics.linearisation import Linearisation, Piece


def lag_one_correlation(residuals: Array, *, most: float, together: NDArray[np.bool_] | None = None) -> float:
    """Correlation r of neighbouring residuals (n,) about their mean, from 0 to `most`.

    About their own mean, independent samples correlate by -1/n, which is allowed for.

    `most`: upper limit: beyond it a record is too short to show its memory. `together`: which samples follow
    the one before without a gap; all when omitted.

    Examples
    --------
    >>> round(lag_one_correlation(np.array([1.0, 1.0, -1.0, -1.0]), most=0.9), 3)
    0.583
    """
    n, power = len(residuals), float(residuals @ residuals)
    before, after = residuals[:-1], residuals[1:]
    if together is not None:
        before, after = before[together], after[together]
    if power <= 0.0 or not len(after):
        return 0.0
    correlation = float(after @ before) / len(after) / (power / n) + 1.0 / n
    return min(max(correlation, 0.0), most)


def variance_inflation(correlation: float) -> float:
    """Factor (1 + r) / (1 - r) on the variance of a mean: that of a first-order autoregression (Bartlett
    1946).

    Examples
    --------
    >>> variance_inflation(0.5)
    3.0
    """
    return (1.0 + correlation) / (1.0 - correlation)


@dataclass(frozen=True)
class BlockSettings:
    """How residuals are divided into blocks, and what counts as not determined by them."""

    #: Length of a block over Politis and White's: longer blocks cover better (Sun, Phillips and Jin).
    length_ratio: float = 1.25
    #: Shortest block over the root of the number of samples (Lazarus et al.).
    least_per_root: float = 1.3
    #: Divisions into blocks, each shifted against the others, over which a covariance is the mean.
    shifts: int = 4
    #: Eigenvalue of the information, scaled to a unit diagonal, that is indistinguishable from rounding.
    rounding: float = 1e-11
    #: Share of the data in the information of data and priors below which the data have no optimum.
    data_share: float = 1e-9
    #: Squared part in the undetermined combinations from which an unknown counts as undetermined.
    undetermined_part: float = 1e-6


SETTINGS = BlockSettings()


@dataclass(frozen=True)
class BlockLength:
    """Length of a block for all channels, and each channel's memory.

    `samples`, `seconds`: length of a block. `memory`: integrated autocorrelation time (C,) ``1 + 2 sum
    rho_k`` in samples, at least one. `wanted`: Politis and White's length (C,) in samples. `effective`:
    equivalent number (C,) of independent samples: those that count over ``memory``.
    """

    samples: int
    seconds: float
    memory: Array
    wanted: Array
    effective: Array


@dataclass(frozen=True)
class Blocks:
    """Scores and information of the data in blocks of consecutive samples, all channels together.

    `score`: downhill gradient (B, m) of half the cost. `information`: second derivative (B, m, m) of half the
    cost; the priors are not in it. `coloured`: covariance (m, m) of the sum of the scores if each channel's
    errors had its mean square and memory throughout and all derivatives were slow against that memory.
    """

    score: Array
    information: Array
    coloured: Array


def block_length(lin: Linearisation) -> BlockLength:
    """Length of a block, at most a quarter of the data.

    It starts from Politis and White (2004, Econometric Reviews 23:53, corrected by Patton, Politis and White
    2009, 28:372) for each channel, ``L = (2 G^2 / D)^(1/3) N^(1/3)`` with ``G = sum |k| rho_k`` and ``D = 4/3
    (sum rho_k)^2`` from the flat-top lag window of Politis and Romano (1995); the longest channel counts.
    With a Student factor for the number of blocks, longer blocks cover better (Sun, Phillips and Jin 2008,
    Econometrica 76:175), and none is shorter than ``1.3 sqrt(N)`` (Lazarus, Lewis, Stock and Watson 2018,
    JBES 36:541).

    Raises CampaignError where no sample counts.
    """
    counts = np.sum([piece.counted.sum(axis=0) for piece in lin.pieces], axis=0, initial=0)
    if not np.any(counts):
        raise CampaignError(
            "the joint estimate has no sample that counts, so its uncertainty is unknown; expected at"
            " least one valid sample of a measured channel in a segment; check hold_out, segment_s, channels"
        )
    covered = sum(len(np.unique(grid[rows])) for _, grid, rows in _on_grid(lin))
    rho, pairs = _autocorrelation(lin, max(covered // 4, 1))
    memory, wanted = np.ones(len(counts)), np.zeros(len(counts))
    for channel, samples in enumerate(counts):
        if samples > 1:
            memory[channel], wanted[channel] = _automatic_length(rho[channel], pairs[channel], int(samples))
    longest = max(SETTINGS.length_ratio * float(wanted.max()), SETTINGS.least_per_root * math.sqrt(covered))
    samples = int(np.clip(round(longest), 1, max(covered // 4, 1)))
    return BlockLength(samples, samples * lin.dt, memory, wanted, counts / memory)


def autocorrelation(lin: Linearisation, lags: int) -> Array:
    """Autocorrelation (C, lags + 1) of the weighted residuals of each channel over all trials.

    Where segments overlap, their mean counts. Lags without a pair have zero.
    """
    return _autocorrelation(lin, lags)[0]


def _autocorrelation(lin: Linearisation, lags: int) -> tuple[Array, Array]:
    """Autocorrelation and number of pairs, both (C, lags + 1).

    Products of samples at their true distance in time over the number of such pairs (Parzen 1963): a gap
    between segments neither breaks nor invents a memory.
    """
    products, pairs = np.zeros((2, lags + 1, len(lin.channels)))
    for pieces, grid, _ in _on_grid(lin):
        # Rows of overlapping segments are brought to one series on the trial's time grid.
        psi = np.concatenate([piece.weight * piece.residual * piece.counted for piece in pieces])
        counted = np.concatenate([piece.counted for piece in pieces]).astype(float)
        total, often = np.zeros((2, int(grid.max()) + 1, len(lin.channels)))
        np.add.at(total, grid, psi)
        np.add.at(often, grid, counted)
        series, seen = total / np.maximum(often, 1.0), (often > 0).astype(float)
        # Products at all lags at once (Wiener-Khinchin); padded, so that the ends do not wrap round.
        size = 1 << (2 * len(series) - 1).bit_length()
        kept = min(lags + 1, len(series))
        for into, values in ((products, series), (pairs, seen)):
            power = np.abs(np.fft.rfft(values, size, axis=0)) ** 2
            into[:kept] += np.fft.irfft(power, size, axis=0)[:kept]
    pairs = np.rint(pairs)
    mean = np.where(pairs > 0, products / np.maximum(pairs, 1.0), 0.0)
    rho = mean / np.where(mean[0] > 0, mean[0], 1.0)
    rho[0] = 1.0
    return rho.T, pairs.T


def divided(lin: Linearisation, length: BlockLength) -> tuple[Blocks, ...]:
    """Divisions of the data into blocks of about a length, each a quarter of a block further than the last.

    Each trial is divided evenly, at least one block per trial. A block may span segments that follow each
    other, never two trials. A segment is divided only where it holds two blocks or more: its initial
    conditions were fitted to all of it, so that its parts are not independent. A block's information is ``sum
    J' psi' J`` with the mean slope ``psi'`` of the robust score, not its weight: they differ for all but
    squared errors. What a trial has left before its first block and after its last one is one block (Politis
    & Romano 1992).
    """
    slope_ratio, unknowns = _score_slope(lin), len(lin.unknowns)
    colour = length.memory * _mean_square(lin.pieces)
    coloured = np.zeros((unknowns, unknowns))
    score: list[list[Array]] = [[] for _ in range(SETTINGS.shifts)]
    information: list[list[Array]] = [[] for _ in range(SETTINGS.shifts)]
    for pieces, grid, rows in _on_grid(lin):
        if not len(np.unique(grid[rows])):
            continue
        unit, owners, number = _units(pieces, length.samples)
        scores = np.zeros((owners.shape[1], unknowns))
        matrices = np.zeros((owners.shape[1], unknowns, unknowns))
        first = 0
        for piece in pieces:
            own = unit[first : first + len(piece.t)]
            first += len(piece.t)
            for index in np.unique(own):
                part = own == index
                slope, weight = piece.jacobian[part], piece.weight[part]
                matrix = slope.reshape(-1, unknowns)
                # Score, information, and what the score's covariance would be with the channel's memory.
                scores[index] += matrix.T @ (weight * piece.residual[part]).ravel()
                matrices[index] += matrix.T @ ((slope_ratio * weight).reshape(-1, 1) * matrix)
                coloured += matrix.T @ (np.broadcast_to(colour, weight.shape).reshape(-1, 1) * matrix)
        for shift, owner in enumerate(owners):
            for into, units in ((score, scores), (information, matrices)):
                summed = np.zeros((number, *units.shape[1:]))
                np.add.at(summed, owner, units)
                into[shift].append(summed)
    return tuple(
        Blocks(np.concatenate(scores_of), np.concatenate(matrices_of), coloured)
        for scores_of, matrices_of in zip(score, information, strict=True)
    )


def information_of(lin: Linearisation) -> Array:
    """Information (m, m) of all blocks together, whatever their length."""
    slope_ratio, unknowns = _score_slope(lin), len(lin.unknowns)
    total = np.zeros((unknowns, unknowns))
    for piece in lin.pieces:
        matrix = piece.jacobian.reshape(-1, unknowns)
        total += matrix.T @ ((slope_ratio * piece.weight).reshape(-1, 1) * matrix)
    return total


def parts(
    lin: Linearisation, length: BlockLength, seconds: float
) -> tuple[NDArray[np.intp], Array, Array, Array]:
    """Trial (G,), score (G, m), information and covariance of the errors (G, m, m) of parts of the trials.

    A part has so many seconds at least, or is the whole of a shorter trial. Its errors have the memory and
    the mean square of their channel (`Blocks.coloured`).
    """
    slope_ratio, unknowns = _score_slope(lin), len(lin.unknowns)
    colour = length.memory * _mean_square(lin.pieces)
    sums, trials = [], []
    for trial, (pieces, grid, rows) in enumerate(_on_grid(lin)):
        place = np.searchsorted(np.unique(grid[rows]), grid)
        number = max(int(np.sum(np.bincount(grid[rows]) > 0) * lin.dt / seconds), 1)
        first, whole = 0, max(int(place.max(initial=0)) + 1, 1)
        of_trial = np.zeros((number, unknowns, 1 + 2 * unknowns))
        for piece in pieces:
            # A segment is not divided: its initial conditions were fitted to all of it.
            index = min(int(place[first : first + len(piece.t)].mean() * number / whole), number - 1)
            first += len(piece.t)
            matrix, weight = piece.jacobian.reshape(-1, unknowns), piece.weight
            of_errors = np.broadcast_to(colour, weight.shape).reshape(-1, 1)
            of_trial[index, :, 0] += matrix.T @ (weight * piece.residual).ravel()
            of_trial[index, :, 1 : 1 + unknowns] += matrix.T @ (
                (slope_ratio * weight).reshape(-1, 1) * matrix
            )
            of_trial[index, :, 1 + unknowns :] += matrix.T @ (of_errors * matrix)
        sums.append(of_trial)
        trials += [trial] * number
    total = np.concatenate(sums)
    telling = total.any(axis=(1, 2))
    total = total[telling]
    information, errors = total[:, :, 1 : 1 + unknowns], total[:, :, 1 + unknowns :]
    return np.array(trials, dtype=np.intp)[telling], total[:, :, 0], information, errors


def _mean_square(pieces: Sequence[Piece]) -> Array:
    """Mean square (C,) of the score of each channel's samples."""
    square = np.sum([((p.weight * p.residual * p.counted) ** 2).sum(axis=0) for p in pieces], axis=0)
    counts = np.sum([piece.counted.sum(axis=0) for piece in pieces], axis=0)
    return np.asarray(square / np.maximum(counts, 1))


def _units(pieces: Sequence[Piece], length: int) -> tuple[NDArray[np.intp], NDArray[np.intp], int]:
    """Unit of each row of a trial's segments, block of each unit at every shift, number of blocks.

    A unit is a segment or, where segments are divided, a quarter of a block.
    """
    counts = [piece.counted.any(axis=1) for piece in pieces]
    total = sum(int(counted.sum()) for counted in counts)
    unit: list[NDArray[np.intp]] = []
    place: list[int] = []
    parts = 0
    for counted in counts:
        inside = int(counted.sum())
        split = max(1, inside // length if len(pieces) > 1 else round(inside / length))
        finer = SETTINGS.shifts if split > 1 else 1
        done = np.minimum(np.cumsum(counted), max(inside - 1, 0))
        unit.append(len(place) + done * (split * finer) // max(inside, 1))
        place += [parts * SETTINGS.shifts + i * SETTINGS.shifts // finer for i in range(split * finer)]
        parts += split
    number = max(1, min(parts, round(total / length)))
    shifts = np.arange(SETTINGS.shifts)[:, None]
    owners = (np.array(place) * number + shifts * parts) // (SETTINGS.shifts * parts) % number
    return np.concatenate(unit), owners, number


def _on_grid(lin: Linearisation) -> Iterator[tuple[list[Piece], NDArray[np.intp], NDArray[np.bool_]]]:
    """Per trial: its pieces, the index of each of their rows on the trial's time grid, which rows count."""
    trials: dict[str, list[Piece]] = {}
    for piece in lin.pieces:
        trials.setdefault(piece.trial, []).append(piece)
    for pieces in trials.values():
        t = np.concatenate([piece.t for piece in pieces])
        grid = np.rint((t - t.min()) / lin.dt).astype(np.intp)
        yield pieces, grid, np.concatenate([piece.counted.any(axis=1) for piece in pieces])


def _automatic_length(rho: Array, pairs: Array, samples: int) -> tuple[float, float]:
    """Integrated autocorrelation time and Politis and White's block length of one channel, in samples.

    The memory ends before the first run of lags that white errors would show.
    """
    last = len(rho) - 1
    decades = math.log10(samples)
    needed = min(max(5, math.ceil(math.sqrt(decades))), last)
    small = np.abs(rho[1:]) < 2.0 * np.sqrt(decades / np.maximum(pairs[1:], 1.0))
    quiet = np.flatnonzero(np.convolve(small, np.ones(needed, int), "valid") == needed)
    if len(quiet) and quiet[0] == 0:
        return 1.0, 0.0
    reach = min(2 * int(quiet[0]), last) if len(quiet) else last
    k = np.arange(1, reach + 1)
    tapered = np.clip(2.0 * (1.0 - k / (reach + 1)), 0.0, 1.0) * rho[1 : reach + 1]
    memory = max(1.0 + 2.0 * float(tapered.sum()), 1.0)
    slope = 2.0 * float((k * tapered).sum())
    return memory, (1.5 * slope**2 / memory**2 * samples) ** (1.0 / 3.0)


def _score_slope(lin: Linearisation) -> Array:
    """Mean slope of the robust score over its mean weight (C,): one for squared errors.

    The score ``psi(e) = w(e) e`` is a function of the error alone, so its slope is that between neighbours in
    the order of ``|e|`` and needs no name of the loss (one inside Huber's knee and zero outside it).
    """
    slope_ratio = np.ones(len(lin.channels))
    for channel in range(len(lin.channels)):
        kept = [piece.counted[:, channel] for piece in lin.pieces]
        pairs = list(zip(lin.pieces, kept, strict=True))
        weight = np.concatenate([piece.weight[rows, channel] for piece, rows in pairs])
        if not len(weight) or weight.min() >= 1.0:
            continue
        error = np.abs(np.concatenate([piece.residual[rows, channel] for piece, rows in pairs]))
        error, first = np.unique(error, return_index=True)
        psi = weight[first] * error
        slope = np.diff(psi, prepend=0.0) / np.maximum(np.diff(error, prepend=0.0), 1e-300)
        slope_ratio[channel] = max(float(np.clip(slope, -1.0, 1.0).mean() / weight.mean()), 0.1)
    return slope_ratio


@dataclass(frozen=True)
class Whitened:
    """Blocks in coordinates z (r,) with ``values = transform @ z``.

    Scores are those at the optimum of the linearised data, so that an estimate held by a bound or a prior, or
    a coefficient that is only differentiated, does not pass its pull off as scatter.

    Attributes
    ----------
    length
        Length of a block.
    transform
        Matrix (m, r).
    undetermined
        Mask (m,) of unknowns with a part in what has no coordinate.
    score, information
        Of each block: downhill gradient (B, r) and second derivative (B, r, r) of half the cost.
    coloured
        `seatrial.statistics.blocks.Blocks.coloured` (r, r).
    prior
        Information (r, r) of the priors; with the blocks' it adds up to one.
    pull
        Covariance (r, r) of the score of the priors: theirs is independent, and counts as often as
        `Linearisation.tempering` says.
    """

    length: BlockLength
    transform: Array
    undetermined: NDArray[np.bool_]
    score: Array
    information: Array
    coloured: Array
    prior: Array
    pull: Array


def whitened(lin: Linearisation, length: BlockLength | None = None) -> Whitened:
    """Blocks of a linearisation, of the automatic length unless one is given.

    Raises CampaignError where no sample counts.
    """
    length = block_length(lin) if length is None else length
    return viewed(lin, length, divided(lin, length))[0]


def viewed(lin: Linearisation, length: BlockLength, divisions: Sequence[Blocks]) -> tuple[Whitened, ...]:
    """Divisions of a linearisation, whatever its tempering, in the coordinates of `whitened`."""
    precision = lin.precision
    transform, undetermined = determined(divisions[0].information.sum(axis=0) + np.diag(precision))
    coloured = transform.T @ divisions[0].coloured @ transform
    whitened_views = []
    for data in divisions:
        score = data.score @ transform
        information = transform.T @ data.information @ transform
        # Newton's step to the optimum of the data alone; scores are taken there, not at a bound and not where
        # a prior has drawn the estimate: its pull is no scatter.
        total = information.sum(axis=0)
        step = np.linalg.pinv(total, rcond=SETTINGS.data_share, hermitian=True) @ score.sum(axis=0)
        whitened_views.append(
            Whitened(
                length=length,
                transform=transform,
                undetermined=undetermined,
                score=score - information @ step,
                information=information,
                coloured=coloured,
                prior=transform.T @ (precision[:, None] * transform),
                pull=transform.T @ ((lin.tempering * precision)[:, None] * transform),
            )
        )
    return tuple(whitened_views)


def determined(information: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Basis T (m, r) of the combinations that an information (m, m) determines, ``T T'`` its pseudo-inverse.

    The second result (m,) marks the unknowns that have a part in the rest. The information is scaled to a
    unit diagonal first, so that units do not matter.

    Examples
    --------
    >>> import numpy as np
    >>> transform, undetermined = determined(np.array([[4.0, 0.0, 0.0], [0.0, 1.0, 1.0], [0.0, 1.0, 1.0]]))
    >>> transform.shape, undetermined.tolist()
    ((3, 2), [False, True, True])
    """
    size = np.sqrt(np.diag(information))
    known = size > 0
    scale = np.where(known, size, 1.0)
    value, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    kept = value > SETTINGS.rounding * max(float(value[-1]), 1.0)
    transform = vectors[:, kept] / np.sqrt(value[kept]) / scale[:, None]
    return transform, ~known | ((vectors[:, ~kept] ** 2).sum(axis=1) > SETTINGS.undetermined_part)


@dataclass(frozen=True)
class InformationCriteria(Plain):
    """Smaller is better; only differences between models of the same data mean something.

    ``parameters`` is the effective number of parameters, ``effective`` (C,) that of independent samples.
    """

    aic: float
    bic: float
    parameters: float
    effective: tuple[float, ...]


def information_criteria(lin: Linearisation, *, effective: ArrayLike | None = None) -> InformationCriteria:
    """AIC and BIC of the model that was linearised at its estimate.

    Parameters
    ----------
    lin : Linearisation
    effective : array_like, shape (C,), optional
        Independent samples per channel. Models are compared with the same numbers: those of the largest one.
        By default this model's own.

    Raises
    ------
    CampaignError
        No sample counts.
    """
    # Correlated samples count by their effective number.
    length = block_length(lin)
    samples = length.effective if effective is None else np.asarray(effective, dtype=float)
    counts = np.maximum(np.sum([piece.counted.sum(axis=0) for piece in lin.pieces], axis=0), 1)
    squares = np.sum(
        [(piece.counted * piece.weight * piece.residual**2).sum(axis=0) for piece in lin.pieces], axis=0
    )
    size = np.where(samples > 0, squares / counts, 1.0) * lin.noise**2
    twice = float(samples @ np.log(np.where(samples > 0, np.maximum(size, 1e-300), 1.0)))
    information = information_of(lin)
    transform, _ = determined(information + np.diag(lin.precision))
    # A parameter that its prior determines counts in part, as the share of its information from data.
    parameters = float(np.trace(transform.T @ information @ transform))
    return InformationCriteria(
        aic=twice + 2.0 * parameters,
        bic=twice + float(np.log(samples.sum())) * parameters,
        parameters=parameters,
        effective=tuple(samples.tolist()),
    )
