"""Which recorded channel shows which axis, with which sign, unit and rough delay, and how sure that is.

Two vectors are compared in the band that both show, lag by lag; the lag at which they share most, whatever
the signs, is the rough delay, and the signed permutation with the largest sum of correlations the candidate.
Whether it holds is judged axis by axis by `follows`: the channel is regressed on the axis beside the other
axes of the motion, so that what leaks from them (a sensor mounted askew, a list of the hull) is nobody's
sign. A channel stands for an axis where the part of the axis's motion that is its own is well above the
noise, explains most of the channel, and does so with a gain near the sensor's. A ratio of sizes that is that
of a known unit is one. Held by ``tests/trial/test_kinematic_axes.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import DEGREE
from seatrial.trial.kinematics import Grid

UNITS: Mapping[str, Mapping[str, float]] = {
    "velocity": {"mm/s": 1e-3, "cm/s": 1e-2, "km/h": 1.0 / 3.6, "knot": 1852.0 / 3600.0, "ft/s": 0.3048},
    "rates": {"deg/s": DEGREE, "mrad/s": 1e-3, "rpm": np.pi / 30.0},
    "depth": {"ft": 0.3048, "cm": 1e-2, "mm": 1e-3, "fathom": 1.8288},
}
"""Units other than SI that recordings have, by their size in SI."""


@dataclass(frozen=True)
class AxesSettings:
    """When a channel stands for an axis, with which sign and unit, and when that is beyond doubt."""

    slowest_change_s: float = 10.0  #: s: slower changes are offsets and drifts
    believed_correlation: float = 0.6  #: of an assignment of channels to axes that is believed
    refuted_correlation: float = 0.2  #: of one that is not
    #: of the largest axis: what two misalignments of 6 deg leak together, which no regression knows
    leaked_share: float = 0.01
    #: factor by which the gain of a corrected sign may be off: no sensor's scale is further off, any leak is
    corrected_gain: float = 1.5
    proposed_gain: float = 2.0  #: the same for a sign that is proposed only
    corrected_share: float = 0.5  #: share explained by a sign that is corrected
    proposed_share: float = 0.36  #: share explained by a sign that is proposed only
    unrelated_share: float = 0.09  #: a channel with less has nothing of its axis: a correlation of 0.3
    sure_deviations: float = 4.0  #: deviations by which a gain must differ from zero
    #: what the reversed sign leaves of the variance over what the recorded one leaves at any delay
    rival_left: float = 0.7
    block_s: float = 10.0  #: s, blocks of time that tell the deviation of a gain
    most_blocks: int = 60  #: longer records have longer blocks
    fewest_blocks: int = 8  #: shorter records have shorter blocks
    huber_deviations: float = 2.5  #: deviations from which a sample counts linearly
    reweightings: int = 5  #: rounds that settle the weights
    #: deviations from which a sample has no weight: 95 % efficient for normal errors
    biweight_deviations: float = 4.685
    choosing_share: float = 0.9  #: share of the samples that chooses between the two starts
    clearly_less: float = 0.9  #: what the better start must leave of the other one's residual
    end_of_search: float = 0.95  #: share of a search range: a delay beyond is where the search ended
    unit_tolerance: float = 0.12  #: how far a ratio may be off that of a unit
    far_unit_tolerance: float = 0.4  #: the same for a far unit: noise may make up a part of the size
    far_unit: float = 20.0  #: factor from which no other unit is near
    spike_sizes: float = 4.0  #: samples beyond so many sizes of three quarters of them are cut
    other_delay_s: float = 2.0  #: s: delays that differ by more are different ones
    compared_block_s: float = 10.0  #: s, blocks of motion in which two delays are compared
    clearly_better: float = 2.5  #: deviations by which a delay must follow better than any other
    other_unit: float = 1.25  #: ratios closer to one than this factor are not those of another unit


SETTINGS = AxesSettings()


LEAST_MOTION: Mapping[str, float] = {"rates": 0.1 * DEGREE, "velocity": 0.005}
"""Root mean square of an axis's own motion, rad/s and m/s, from which a sensor's channel is judged by it: the
noise of gyros and of Doppler logs, and what an attitude or a position of usual noise shows at rest."""

_MOST_MOTION: Mapping[str, float] = {"rates": 20.0, "velocity": 20.0}
"""Root mean square, rad/s and m/s, that nothing under water reaches: three turns a second, 40 knots."""

_PRESSURES = {"hPa or mbar": 1e2, "kPa": 1e3, "psi": 6894.76, "dbar": 1e4, "bar": 1e5, "MPa": 1e6}
"""Units of pressure by their size in Pa."""


@dataclass(frozen=True)
class Follows:
    """How a recorded channel follows an axis of the motion, beside the other axes of it."""

    #: Size of the channel over that of the axis, of both what the other axes do not explain, with the sign of
    #: their relation; the deviation by blocks of time. NaN where the axis has no motion of its own.
    gain: float
    sd: float
    share: float  #: Share of that part of the channel that the axis explains, 0 to 1.
    whole: float  #: Share of the whole channel that the axis explains.
    #: Root mean square of the axis's own motion, rad/s or m/s, and from where it is judged.
    own: float
    least: float
    lag: float  #: Delay in s at which this holds.
    rival: float = 0.0  #: Largest correlation of the other sign at any delay.

    @property
    def moves(self) -> bool:
        """Whether the axis moves enough by itself to judge a channel by it."""
        return self.own > self.least

    @property
    def reversed(self) -> bool:
        """Whether the channel has the opposite sign beyond doubt, so that it may be corrected."""
        return self._opposite(SETTINGS.corrected_gain, SETTINGS.corrected_share)

    @property
    def doubtful(self) -> bool:
        """Whether the opposite sign would explain the channel, but not beyond doubt: a proposal at most."""
        return not self.reversed and self._opposite(SETTINGS.proposed_gain, SETTINGS.proposed_share)

    @property
    def stands(self) -> bool:
        """Whether the channel is that of the axis, whatever its sign."""
        off = abs(self.gain)
        return (
            self.moves
            and self.share > SETTINGS.proposed_share
            and 1.0 / SETTINGS.proposed_gain < off < SETTINGS.proposed_gain
        )

    @property
    def weak(self) -> bool:
        """Whether the axis moves and explains little of the channel."""
        return self.moves and max(self.share, self.whole) < SETTINGS.proposed_share

    @property
    def unrelated(self) -> bool:
        """Whether the axis moves and the channel shows nothing of it."""
        return self.moves and max(self.share, self.whole) < SETTINGS.unrelated_share

    def _opposite(self, factor: float, least: float) -> bool:
        if not self.moves or not self.gain < 0.0:
            return False
        left, otherwise = 1.0 - self.share, 1.0 - self.rival**2
        return (
            1.0 / factor < -self.gain < factor
            and min(self.share, self.whole) > least
            and -self.gain > SETTINGS.sure_deviations * self.sd
            and left < SETTINGS.rival_left * otherwise
        )

    def __str__(self) -> str:
        return (
            f"gain {self.gain:.2f} (+/- {self.sd:.2f}), lag {self.lag:.2f} s, {100.0 * self.share:.0f} %"
            " explained"
        )


@dataclass(frozen=True)
class Assignment:
    """Delay in s, recorded channel and sign by true channel, correlation of each, and the ratio of sizes.

    ``follows``: by axis, how the channel that it was given follows it.
    """

    delay: float
    axes: dict[str, tuple[str, float]]
    correlation: dict[str, float]
    ratio: float
    follows: Mapping[str, Follows]

    @property
    def contradicted(self) -> tuple[str, ...]:
        """Axes that move clearly and that no channel follows, whatever is exchanged and reversed."""
        return tuple(
            name
            for name, axis in self.follows.items()
            if axis.moves and axis.share < SETTINGS.proposed_share and axis.whole < SETTINGS.proposed_share
        )

    @property
    def changed(self) -> dict[str, tuple[str, float]]:
        """The entries that are not as recorded."""
        return {name: entry for name, entry in self.axes.items() if entry != (name, 1.0)}


def band(y: Array, good: Mask, grid: Grid, *, cut: bool = True) -> Array:
    """Changes of values (n, k) that are faster than slow offsets, zero where not known; `cut`: no spikes."""
    filled = np.where(good[:, None], y, np.nan_to_num(np.median(y[good], axis=0)) if good.any() else 0.0)
    slow = _smooth(filled, max(SETTINGS.slowest_change_s, 6.0 * grid.width) / grid.step)
    fast = np.where(good[:, None], filled - slow, 0.0)
    if not cut:
        return np.asarray(fast)
    # Spikes of bad samples would make up the whole correlation: beyond some deviations of the usual.
    usual = np.quantile(np.abs(fast[good]), 0.75, axis=0) if good.any() else np.zeros(y.shape[1])
    most = np.where(usual > 0.0, SETTINGS.spike_sizes * usual, np.inf)
    return np.asarray(np.clip(fast, -most, most))


def _smooth(y: Array, width: float) -> Array:
    """Columns of (n, k) under a Gaussian of a deviation in samples, the ends held, by Fourier transforms of
    blocks: ten seconds at 50 Hz are a kernel of 4,001 samples.
    """
    from scipy.signal import oaconvolve

    reach = int(4.0 * width + 0.5)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    padded = np.pad(y, ((reach, reach), (0, 0)), mode="edge")
    return np.asarray(oaconvolve(padded, kernel[:, None] / kernel.sum(), mode="valid", axes=0))


def lagged(reference: Array, shown: Array, step: float, most: float) -> tuple[float, Array]:
    """Delay of `shown` (n, j) behind `reference` (n, k) within `most` s, and their correlations (k, j)."""
    from scipy.fft import irfft, next_fast_len, rfft

    n, reach = len(reference), max(1, round(most / step))
    size = next_fast_len(n + reach + 1, real=True)
    a, b = rfft(reference, size, axis=0), rfft(shown, size, axis=0)
    energy = np.sqrt(np.outer(np.sum(reference**2, axis=0), np.sum(shown**2, axis=0))) + 1e-300
    lags = np.concatenate([np.arange(reach + 1), np.arange(-reach, 0)])
    correlation = np.empty((len(lags), *energy.shape))
    for k, j in np.ndindex(*energy.shape):  # pair by pair: all at once take nine times the memory
        correlation[:, k, j] = irfft(np.conj(a[:, k]) * b[:, j], size)[lags] / energy[k, j]
    best = int(np.argmax(np.sum(correlation**2, axis=(1, 2))))
    return float(lags[best] * step), correlation[best]


def alone(reference: Array, shown: Array, step: float, delay: float, most: float) -> float | None:
    """Another delay in s at which `shown` (n, k) may as well follow `reference` (n, k), bands of equal axes
    and signs; None where the products at the best delay are clearly larger, by blocks of time, than at any
    other.
    """
    from scipy.fft import irfft, next_fast_len, rfft

    n, reach = len(reference), max(1, round(most / step))
    size = next_fast_len(n + reach + 1, real=True)
    a, b = rfft(reference, size, axis=0), rfft(shown, size, axis=0)
    across = irfft(np.sum(np.conj(a) * b, axis=1), size)
    lags = np.concatenate([np.arange(reach + 1), np.arange(-reach, 0)])
    here = round(delay / step)
    far = np.abs(lags - here) * step > SETTINGS.other_delay_s
    if not far.any():
        return None
    other = int(lags[far][np.argmax(across[lags[far]])])
    t = np.arange(n)
    gain = np.sum(
        reference * (shown[np.clip(t + here, 0, n - 1)] - shown[np.clip(t + other, 0, n - 1)]), axis=1
    )
    inside = (t + min(here, other) >= 0) & (t + max(here, other) < n)
    blocks = (t[inside] * step / max(SETTINGS.compared_block_s, n * step / 60.0)).astype(int)
    sums = np.bincount(blocks, gain[inside])
    sums = sums[np.bincount(blocks) > 0]
    certain = len(sums) > 2 and sums.mean() > SETTINGS.clearly_better * sums.std(ddof=1) / np.sqrt(len(sums))
    return None if certain else float(other * step)


def at_end(delay: float, most: float, step: float) -> bool:
    """Whether a delay lies at the end of its search range, so that it tells only where the search ended.

    >>> at_end(0.99, 1.0, 0.05), at_end(0.3, 1.0, 0.05)
    (True, False)
    """
    return bool(abs(delay) > min(SETTINGS.end_of_search * most, most - step))


def shifted(delay: float, step: float, n: int) -> tuple[slice, slice]:
    """Rows of a reference and of what follows it by `delay` s, of n rows each, that belong together."""
    lag = int(np.clip(round(delay / step), -(n - 1), n - 1))
    return (slice(0, n - lag), slice(lag, n)) if lag >= 0 else (slice(-lag, n), slice(0, n + lag))


def follows(
    motion: Array, k: int, shown: Array, good: Mask, *, step: float, kind: str, lag: float
) -> Follows:
    """How a channel `shown` (n,) follows axis `k` of a motion (n, j) beside its other axes. Both are changes
    about slow offsets (`band` without `cut`), `lag` s apart and brought together. Outliers count little.
    """
    # Of what is parallel to the other axes to rounding, nothing is left: columns in units of their size.
    size = np.sqrt(np.mean(motion[good] ** 2, axis=0)) if good.any() else np.zeros(motion.shape[1])
    least = max(LEAST_MOTION[kind], SETTINGS.leaked_share * float(size.max(initial=0.0)))
    nothing = Follows(np.nan, np.inf, 0.0, 0.0, 0.0, least, lag)
    if not size[k] > least or good.sum() < 2 * motion.shape[1] + 2:
        return nothing
    x, y = motion[good], shown[good]
    weight = _believed(x, y)
    root = np.sqrt(weight)
    x, y = x * root[:, None], y * root
    others = np.delete(x, k, axis=1)
    axis, channel = (v - others @ np.linalg.lstsq(others, v, rcond=1e-6)[0] for v in (x[:, k], y))
    own = float(np.sqrt(np.sum(axis**2) / np.sum(weight)))
    products, squares = axis * channel, axis**2
    together, energy, shows = float(products.sum()), float(squares.sum()), float(channel @ channel)
    if not own > least or not shows > 0.0:
        return Follows(np.nan, np.inf, 0.0, 0.0, own, least, lag)
    share = together**2 / (energy * shows)
    whole = float(x[:, k] @ y) ** 2 / max(float(x[:, k] @ x[:, k]) * float(y @ y), 1e-300)
    sign = 1.0 if together > 0.0 else -1.0
    # Noise of either side makes one of the two regressions too flat: their mean is near the truth.
    gain = sign * np.sqrt(shows / energy)
    where = np.flatnonzero(good) * step
    span = max(float(where[-1] - where[0]), step)
    length = min(max(SETTINGS.block_s, span / SETTINGS.most_blocks), span / SETTINGS.fewest_blocks)
    block = ((where - where[0]) / length).astype(int)
    sums = [np.bincount(block, part) for part in (products, squares)]
    here = np.bincount(block) > 0
    without = (together - sums[0][here]) / np.maximum(energy - sums[1][here], 1e-300)
    count = len(without)
    sd = float(np.sqrt((count - 1) / count * np.sum((without - without.mean()) ** 2)))
    # Of the slope, as a share of it: the gain differs from it by the root of the share.
    sd *= abs(gain) / max(abs(together / energy), 1e-300)
    return Follows(float(gain), sd, float(share), float(whole), own, least, lag)


def _believed(x: Array, y: Array) -> Array:
    """Weight (n,) of each sample in the regression of `y` (n,) on `x` (n, j). Wrong solutions of a
    positioning system bend it however large their residuals are, and a vehicle that rests mostly moves in
    samples that look like them: the better of two starts is taken, with all samples and without the large
    ones; far residuals end without weight (biweight, Beaton and Tukey 1974).
    """
    usual = np.quantile(np.abs(np.column_stack([x, y])), 0.75, axis=0)
    small = np.logical_and.reduce(
        np.abs(np.column_stack([x, y])) <= np.where(usual > 0.0, SETTINGS.spike_sizes * usual, np.inf), axis=1
    )
    best: tuple[float, Array] | None = None
    for start in (np.ones(len(y)), small.astype(float)):
        weight = start
        for sweep in range(2 * SETTINGS.reweightings):
            root = np.sqrt(weight)[:, None]
            left = np.abs(y - x @ np.linalg.lstsq(x * root, y * root[:, 0], rcond=None)[0])
            scale = 1.4826 * float(np.median(left)) + 1e-12
            if sweep < SETTINGS.reweightings:
                weight = start / np.maximum(left / (SETTINGS.huber_deviations * scale), 1.0)
            else:
                weight = np.maximum(1.0 - (left / (SETTINGS.biweight_deviations * scale)) ** 2, 0.0) ** 2
        most = float(np.mean(left[left <= np.quantile(left, SETTINGS.choosing_share)]))
        if best is None or most < SETTINGS.clearly_less * best[0]:
            best = most, weight
    assert best is not None
    return best[1]


def assigned(
    names: Sequence[str],
    reference: Array,
    shown: Array,
    good: Mask,
    grid: Grid,
    most: float,
    *,
    kind: str,
    beside: Array | None = None,
) -> Assignment | None:
    """Assignment of the recorded channels `names`, `shown` (n, k), to those of `reference` (n, k); None where
    they share too little to tell a delay. An exchange or sign is believed where all axes that move and that
    their channels do not follow are explained at once. `beside` (n, j): axes of the motion that none of the
    channels shows and that may leak into them.
    """
    a, b = band(reference, good, grid), band(shown, good, grid)
    delay, rho = lagged(a, b, grid.step, most)
    excited = np.abs(rho).max(axis=1) > SETTINGS.believed_correlation
    if not excited.any():
        return None
    # At that delay each channel is judged beside all axes that may leak into it.
    whole = reference if beside is None else np.concatenate([reference, beside], axis=1)
    first, second = shifted(delay, grid.step, len(whole))
    motion = band(whole, good, grid, cut=False)[first]
    channels = band(shown, good, grid, cut=False)[second]
    both = good[first] & good[second]

    def judged(k: int, j: int, factor: float) -> Follows:
        other = rivals(a[:, k], b[:, j], grid.step, most)
        axis = follows(motion, k, factor * channels[:, j], both, step=grid.step, kind=kind, lag=delay)
        return replace(axis, rival=other[axis.gain < 0.0])

    # The candidate: the exchange and signs with the largest correlations, in the unit that sizes tell.
    order, signs = _candidate(rho, excited)
    places = range(len(names))
    size = _size(a, b, [k for k in places if excited[k]], order)
    unit = unit_of(size, kind)
    factor = 1.0 if unit is None else unit[1]
    given = [judged(k, order[k], factor) for k in places]
    # It is believed if every axis that moves and changes fails as recorded, and stands as the candidate says.
    changed = [k for k in places if order[k] != k or signs[k] < 0.0]
    moved = [k for k in changed if given[k].moves]
    fails = [rho[k, k] for k in moved]
    exchanged = any(order[k] != k for k in changed)
    fits = [signs[k] * rho[k, order[k]] for k in moved]
    believed = bool(moved) and all(
        (axis := given[k]).stands
        and axis.gain * signs[k] > 0.0
        and (exchanged or axis.reversed or axis.doubtful)
        for k in moved
    )
    if not (believed and max(fails) < min(SETTINGS.refuted_correlation, min(fits) - 0.5)):
        order, signs = tuple(places), (1.0,) * len(names)
        given = [judged(k, k, factor) for k in places]
    # What does not move keeps its sign, and its place unless another channel took it.
    axes = {
        name: (names[order[k]], float(signs[k]) if given[k].moves else 1.0) for k, name in enumerate(names)
    }
    correlation = {name: float(axes[name][1] * rho[k, order[k]]) for k, name in enumerate(names)}
    sure = [
        k for k, name in enumerate(names) if excited[k] and correlation[name] > SETTINGS.believed_correlation
    ]
    return Assignment(
        delay,
        axes,
        correlation,
        _size(a, b, sure, order) if sure else 1.0,
        dict(zip(names, given, strict=True)),
    )


def _candidate(rho: Array, excited: Mask) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Signed permutation with the largest sum of correlations of the excited axes, and the fewest changes."""
    places = range(len(rho))
    best: tuple[float, tuple[int, ...], tuple[float, ...]] = (-np.inf, (), ())
    every = sorted(
        ((order, signs) for order in permutations(places) for signs in product((1.0, -1.0), repeat=len(rho))),
        key=lambda axes: sum((axes[0][k] != k) + (axes[1][k] < 0.0) for k in places),
    )
    for order, signs in every:
        fit = float(np.sum(np.where(excited, np.array(signs) * rho[places, order], 0.0)))
        if fit > best[0] + 1e-9:
            best = (fit, order, signs)
    return best[1], best[2]


def _size(a: Array, b: Array, axes: Sequence[int], order: Sequence[int]) -> float:
    """Root mean square of the channels of these axes over that of the axes."""
    taken = [order[k] for k in axes]
    return float(np.sqrt(np.sum(b[:, taken] ** 2) / max(float(np.sum(a[:, axes] ** 2)), 1e-300)))


def rivals(a: Array, b: Array, step: float, most: float) -> tuple[float, float]:
    """Largest correlations at any delay of the reversed and of the recorded channel: a motion of one period
    is its own opposite half a period later.
    """
    from scipy.fft import irfft, next_fast_len, rfft

    n, reach = len(a), max(1, round(most / step))
    size = next_fast_len(n + reach + 1, real=True)
    across = irfft(np.conj(rfft(a, size)) * rfft(b, size), size)
    across = np.concatenate([across[: reach + 1], across[-reach:]])
    across = across / (np.sqrt(float(a @ a) * float(b @ b)) + 1e-300)
    return max(float(-across.min()), 0.0), max(float(across.max()), 0.0)


def unit_of(ratio: float, kind: str) -> tuple[str, float] | None:
    """Unit and its size in SI that explain a size of `ratio` times the reference; None near one or unknown.

    >>> unit_of(985.0, "velocity"), unit_of(1.1, "velocity")
    (('mm/s', 0.001), None)
    """
    if not ratio > 0.0 or 1.0 / SETTINGS.other_unit < ratio < SETTINGS.other_unit:
        return None
    for name, x in UNITS[kind].items():
        # No other unit is near a far one: noise may make up a part of the size.
        far = x < 1.0 / SETTINGS.far_unit or x > SETTINGS.far_unit
        if abs(ratio * x - 1.0) < (SETTINGS.far_unit_tolerance if far else SETTINGS.unit_tolerance):
            return name, x
    return None


def implausible_side(shown: float, moved: float, kind: str) -> str:
    """Which of a sensor's motion and the pose's no vehicle can have: "sensor", "reference", "both" or "".
    `shown` and `moved`: root mean squares, rad/s or m/s; `kind`: a key of `LEAST_MOTION`.

    >>> implausible_side(0.14, 1e-6, "velocity"), implausible_side(140.0, 0.14, "velocity")
    ('reference', 'sensor')
    """
    sensor, reference = (not LEAST_MOTION[kind] < size < _MOST_MOTION[kind] for size in (shown, moved))
    return "both" if sensor and reference else "sensor" if sensor else "reference" if reference else ""


def pressure_of(ratio: float) -> str | None:
    """Unit of pressure that, read as pascal, makes a depth `ratio` times too small; None for no such unit.

    >>> pressure_of(1.02e5)
    'bar'
    """
    name, size = min(_PRESSURES.items(), key=lambda entry: abs(np.log(max(ratio, 1e-300) / entry[1])))
    return name if abs(ratio / size - 1.0) < SETTINGS.far_unit_tolerance else None
