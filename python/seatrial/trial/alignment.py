"""Signs and latency of velocity and rate sensors against the motion of the recorded pose.

The body velocity that the pose implies is ``R' dp/dt``, its body rates follow from dq/dt. A sensor is
compared with them after both went through the same filter (the slope of a straight line fitted over a short
window), so that neither gains a delay. Its latency is the shift of least absolute error, found between the
samples; its uncertainty comes from leaving out one eighth of the record at a time (jackknife). It is removed
only if it is several times its uncertainty and the shifted sensor really follows the pose; otherwise it is
only reported. A velocity that runs against the pose is reversed, unless a lever arm of the sensor
explains it better: in a turn the bow goes sideways against the stern. The velocity through the water, of the
same instrument, is reversed with it where it has the same sense.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import DEGREE
from seatrial.base.rotation import body_rates, matrix
from seatrial.base.units import factor
from seatrial.trial.columns import GROUPS, Group, Source
from seatrial.trial.corrections import Corrections
from seatrial.trial.resampling import linear
from seatrial.trial.signals import RecordingReport, Signal

__all__ = ["align"]

_LARGEST_S = 1.0
"""Latencies are searched within plus and minus this."""

_OPPOSITE = -0.6
"""A sensor's sign is wrong if its correlation with the pose's motion is below this, and below half of it in
three quarters of the record."""

_FOLLOWS = 0.7  # least correlation of a sensor whose latency can be estimated

_UNRELATED = 0.3  # a moving channel with less correlation is probably another one

_WINDOW_S = 0.3  # half width of the filter common to both sides

_COLUMN = {
    channel: column
    for group in GROUPS
    for column, channel in zip(group.columns, group.channels, strict=True)
    if group.name in ("velocity", "water velocity", "rates")
}

_SLOWEST_S = 0.6  # longest interval of a position that a latency can be estimated from: the filter's window

_BLOCKS = 8

_FEWEST = 50  # samples


@dataclass(frozen=True)
class Latency:
    """Delay of a sensor in s, its deviation in s, its correlation with the pose, and whether to remove it."""

    seconds: float
    deviation: float
    correlation: float
    trusted: bool


def align(
    signals: Mapping[str, Signal],
    t: Array,
    report: RecordingReport,
    sources: Mapping[str, Source],
    *,
    remove: bool = True,
    given: Corrections | None = None,
    names: Sequence[str] = ("velocity", "rates"),
) -> dict[str, Signal]:
    """The same signals with clearly opposite signs reversed and trusted latencies removed, all reported.

    `sources` is the column map, from which the report quotes the entry with the right sign; without `remove`
    latencies stay. `names` are the sensors to look at. What is `given` wins: signs and delays that are given
    stay, and all of them where nothing is to be corrected automatically.
    """
    aligned = dict(signals)
    given = given or Corrections()
    if "velocity" in names and "velocity" in signals:
        _report_scale_of_depth(signals, t, report, sources)
    for name in names:
        if (
            name not in signals
            or "attitude" not in signals
            or (name == "velocity" and "position" not in signals)
        ):
            continue
        if name == "velocity" and "depth" in signals and signals["position"].step > _SLOWEST_S:
            step = signals["position"].step
            report.add(
                "info", name, f"latency not estimated: a position every {step:.2g} s is too slow for it"
            )
            continue
        reference, known = _pose_motion(signals, t, name)
        columns = ["uvw".index(c) if name == "velocity" else "pqr".index(c) for c in signals[name].channels]
        reference = reference[:, columns]
        turning = _pose_motion(signals, t, "rates")[0] if name == "velocity" else None
        fixed = {*given.signs, *given.axes, *(() if given.automatic else signals[name].channels)}
        sensor = _correct_signs(signals[name], t, reference, known, report, sources, turning, fixed=fixed)
        if name == "velocity" and "water velocity" in signals:
            water = _same_signs(signals["water velocity"], signals[name], sensor, report, sources)
            aligned["water velocity"] = water
        _report_scale(sensor, t, reference, known, report, sources)
        aligned[name] = sensor
        if not remove or name in given.delay:
            continue
        delay = _latency(sensor, t, reference, known)
        if delay is None:
            report.add("info", name, "latency not estimated: too little motion or too few valid samples")
        elif delay.trusted:
            report.latencies[name] = delay.seconds
            late = "late" if delay.seconds > 0.0 else "early"
            report.add(
                "info",
                name,
                f"{abs(delay.seconds):.3f} s (+/- {delay.deviation:.3f} s) {late} against the pose; removed",
            )
            aligned[name] = sensor.earlier(delay.seconds)
            if name == "velocity" and "water velocity" in signals:  # one instrument, one delay
                aligned["water velocity"] = aligned["water velocity"].earlier(delay.seconds)
        else:
            report.add(
                "info",
                name,
                f"latency {delay.seconds:.3f} s (+/- {delay.deviation:.3f} s, "
                f"correlation {delay.correlation:.2f}) is not certain or negligible; left as recorded",
            )
    return aligned


def _pose_motion(signals: Mapping[str, Signal], t: Array, name: str) -> tuple[Array, Mask]:
    """Body velocity in m/s or rates in rad/s, shape (n, 3), that the pose implies, and where known (n,)."""
    step = float(t[1] - t[0])
    half = _half_width(step)
    q, valid = linear(signals["attitude"], t)
    known = valid[:, 0]
    if name == "rates":
        motion = body_rates(q, _slope(q, half, step))
        return motion, _all_around(known, half)
    full, seen = np.zeros((len(t), 3)), np.zeros((len(t), 3), bool)
    for position in (signals[name] for name in ("position", "depth") if name in signals):
        columns = ["xyz".index(c) for c in position.channels]
        full[:, columns], seen[:, columns] = linear(position, t)
    known = known & seen.all(axis=1)
    return np.einsum("nji,nj->ni", matrix(q), _slope(full, half, step)), _all_around(known, half)


def _latency(sensor: Signal, t: Array, reference: Array, known: Mask) -> Latency | None:
    """Delay of a sensor against `reference` (n, k), `known` (n,) at uniform times `t`; None if unclear."""
    from scipy.interpolate import CubicSpline

    step = float(t[1] - t[0])
    y, good = _filtered(sensor, t)
    margin = int(np.ceil(_LARGEST_S / step))
    usable = known & _all_around(good, margin // 2)
    usable[:margin] = usable[len(t) - margin :] = False
    index = np.flatnonzero(usable)
    if len(index) < _FEWEST:
        return None
    blocks = np.array_split(index, _BLOCKS)

    def errors(shifts: Array) -> Array:
        """Absolute error per shift and block, channel by channel: the splines of a long log are large."""
        total = np.zeros((len(shifts), _BLOCKS))
        for k in range(y.shape[1]):
            curve = CubicSpline(t, y[:, k])
            total += [
                [np.abs(curve(t[b] + shift) - reference[b, k]).sum() for b in blocks] for shift in shifts
            ]
        return total

    # Coarse search over all shifts first: the error over the shift has several minima in a periodic motion.
    coarse = np.arange(-_LARGEST_S, _LARGEST_S + 1e-9, 0.5 * min(step, 0.1))
    cost = errors(coarse)
    best = int(np.argmin(cost.sum(axis=1)))
    if best in (0, len(coarse) - 1):
        return None
    fine = coarse[best] + np.linspace(-0.15, 0.15, 61)
    cost = errors(fine)
    seconds = _lowest(fine, cost.sum(axis=1))
    left_out = np.array([_lowest(fine, cost.sum(axis=1) - cost[:, b]) for b in range(_BLOCKS)])
    deviation = float(np.sqrt((_BLOCKS - 1) / _BLOCKS * np.sum((left_out - left_out.mean()) ** 2)))
    shifted = [CubicSpline(t, y[:, k])(t[index] + seconds) for k in range(y.shape[1])]
    correlation = _correlation(np.stack(shifted, axis=1), reference[index])
    certain = abs(seconds) > max(3.0 * deviation, 0.05 * step) and deviation < 0.5 * step
    return Latency(seconds, deviation, correlation, certain and correlation > _FOLLOWS)


def _correct_signs(
    sensor: Signal,
    t: Array,
    reference: Array,
    known: Mask,
    report: RecordingReport,
    sources: Mapping[str, Source],
    turning: Array | None = None,
    *,
    fixed: Collection[str] = (),
) -> Signal:
    """The sensor with channels that run against the pose reversed; others that do not follow it are named.

    With the body rates `turning` (n, 3) a channel that a lever arm explains better than a sign stays; the
    `fixed` channels stay too, and are named.
    """
    y, good = _filtered(sensor, t)
    step = float(t[1] - t[0])
    reach = round(0.5 * _LARGEST_S / step)
    usable = known & good
    usable[:reach] = usable[len(t) - reach :] = False
    index = np.flatnonzero(usable)
    if len(index) < _FEWEST:
        return sensor
    signs = np.ones(len(sensor.channels))
    quarters = np.array_split(index, 4)
    shifts = range(-reach, reach + 1)
    for k, channel in enumerate(sensor.channels):

        def correlation(part: NDArray[np.intp], shift: int, k: int = k) -> float:
            return _correlation(y[part + shift, k], reference[part, k])

        shift = max(shifts, key=lambda shift: abs(correlation(index, shift)))
        strongest = correlation(index, shift)
        third = sorted(correlation(part, shift) for part in quarters)[2]
        if strongest < _OPPOSITE and third < 0.5 * _OPPOSITE:
            measured, rates = y[index + shift, k], None if turning is None else turning[index]
            if rates is not None and _on_an_arm(channel, measured, reference[index, k], rates):
                report.add(
                    "warning",
                    channel,
                    f"runs opposite to the recorded pose (correlation {strongest:.2f}), as a sensor with a"
                    " lever arm does; left as recorded. Give the position of the sensor",
                )
                continue
            if channel in fixed:
                report.add(
                    "warning",
                    channel,
                    f"runs opposite to the recorded pose (correlation {strongest:.2f}); left as recorded."
                    f" Reverse it with signs.{channel} = -1 under corrections",
                )
                continue
            signs[k] = -1.0
            name = _COLUMN[channel]
            entry = replace(sources[name], sign=-sources[name].sign)
            report.add(
                "warning",
                channel,
                f"runs opposite to the recorded pose (correlation {strongest:.2f}); sign reversed here. "
                f"State it in the column map: {name} = {entry}",
            )
        elif abs(strongest) < _UNRELATED and np.std(reference[index, k]) > 0.25 * np.std(reference[index]):
            report.add(
                "warning",
                channel,
                f"does not follow the recorded pose (correlation {strongest:.2f}); check the column map",
            )
    return replace(sensor, y=sensor.y * signs)


_UNITS = {
    "velocity": {
        "mm/s": 1e-3,
        "cm/s": 1e-2,
        "km/h": 1.0 / 3.6,
        "knot": 1852.0 / 3600.0,
        "ft/s": 0.3048,
        "m/s": 1.0,
    },
    "rates": {"rad/s": 1.0, "deg/s": DEGREE, "mrad/s": 1e-3, "rpm": np.pi / 30.0},
}
"""Units that recordings have, by their size in SI."""

_TOLERANCE = 0.15  # how far a scale against the pose may be off that of a unit

_SCALED = 0.3  # correlation from which a scale is told

_FAR_OFF = 3.0  # scales without a unit that are worth a warning

_OFF = 1.25  # scales closer to one than this are not for units


def _report_scale(
    sensor: Signal,
    t: Array,
    reference: Array,
    known: Mask,
    report: RecordingReport,
    sources: Mapping[str, Source],
    down: Array | None = None,
) -> None:
    """Warn of a sensor that is larger or smaller than the pose's motion, with the unit that would explain it.

    The scale is that of the root mean squares of both about their means, over the channels that follow the
    pose: latency does not change it. With ``down`` (n, k), the share of each channel that goes down, the
    reference (n, 1) is the rate of depth, and all channels have its scale.
    """
    y, good = _filtered(sensor, t)
    if down is not None:
        y = np.sum(down * y, axis=1, keepdims=True)
    index = np.flatnonzero(known & good)
    if len(index) < _FEWEST:
        return
    follows = [
        k
        for k in range(y.shape[1])
        if _best_correlation(y[:, k], reference[:, k], index, float(t[1] - t[0]))
        > (_SCALED if down is None else _FOLLOWS)
    ]
    if not follows:
        return
    shown, moved = (float(np.linalg.norm(np.std(x[index][:, follows], axis=0))) for x in (y, reference))
    if not moved > 0.0 or 1.0 / _OFF < shown / moved < _OFF:
        return
    scale = shown / moved
    told = sensor.channels if down is not None else [sensor.channels[k] for k in follows]
    columns = [_COLUMN[channel] for channel in told]
    moving = "pose" if down is None else "depth"
    group = next(group for group in GROUPS if columns[0] in group.columns)
    units = _UNITS[sensor.name]
    for column in columns:
        source = sources[column]
        stated = _size_of_unit(source.unit, group)
        likely = [unit for unit, size in units.items() if abs(scale * size / stated - 1.0) < _TOLERANCE]
        said = f"{scale:.3g} times what the derivative of the recorded {moving} shows"
        channel = sensor.channels[columns.index(column)] if len(columns) == len(sensor.channels) else column
        if likely:
            entry = replace(source, unit=likely[0])
            said += f": {likely[0]}? State it in the column map: {column} = {entry}"
        elif 1.0 / _FAR_OFF < scale < _FAR_OFF:  # noise of a positioning system may do that
            continue
        else:
            said += f"; check its unit, and that of the {moving}"
        report.add("warning", channel, said)


def _report_scale_of_depth(
    signals: Mapping[str, Signal], t: Array, report: RecordingReport, sources: Mapping[str, Source]
) -> None:
    """Warn of a velocity that the rate of depth contradicts, where no position at a useful rate tells more.

    The rate of depth is the third row of R times the velocity (Fossen 2011, equation 2.40).
    """
    depth = next((signals[name] for name in ("depth", "position") if name in signals), None)
    if depth is None or "z" not in depth.channels or "attitude" not in signals:
        return
    position = signals.get("position")
    if position is not None and "x" in position.channels and position.step <= _SLOWEST_S:
        return
    step = float(t[1] - t[0])
    half = _half_width(step)
    z, seen = linear(depth, t)
    q, valid = linear(signals["attitude"], t)
    column = depth.channels.index("z")
    known = _all_around(seen[:, column] & valid[:, 0], half)
    velocity = signals["velocity"]
    down = matrix(q)[:, 2, ["uvw".index(channel) for channel in velocity.channels]]
    rate = _slope(z[:, column : column + 1], half, step)
    _report_scale(velocity, t, rate, known, report, sources, down)


def _size_of_unit(unit: str | None, group: Group) -> float:
    """SI value of one unit of a column: the stated one, or that of the canonical name."""
    return factor(unit, (group.unit,), group.name) if unit else group.factor


def _best_correlation(y: Array, reference: Array, index: NDArray[np.intp], step: float) -> float:
    """Largest absolute correlation of a channel with the reference over shifts of likely latencies."""
    reach = round(0.5 * _LARGEST_S / step)
    inside = index[(index >= reach) & (index < len(y) - reach)]
    if len(inside) < _FEWEST:
        return 0.0
    shifts = np.unique(np.linspace(-reach, reach, 11).round().astype(int))
    return max(abs(_correlation(y[inside + shift], reference[inside])) for shift in shifts)


def _same_signs(
    water: Signal, recorded: Signal, corrected: Signal, report: RecordingReport, sources: Mapping[str, Source]
) -> Signal:
    """Velocity through the water with the channels reversed that ran as reversed ones over ground did.

    One instrument has one sense; a single reversed velocity would make a current of twice the speed.
    """
    signs = np.ones(len(water.channels))
    over, valid = linear(recorded, water.t)
    for k, channel in enumerate(recorded.channels):
        same = np.array_equal(recorded.y[:, k], corrected.y[:, k], equal_nan=True)
        if same or f"{channel}_water" not in water.channels:
            continue
        column = water.channels.index(f"{channel}_water")
        both = valid[:, k] & ~water.bad[:, column]
        if float(over[both, k] @ water.y[both, column]) > 0.0:
            signs[column] = -1.0
            name = _COLUMN[water.channels[column]]
            entry = replace(sources[name], sign=-sources[name].sign)
            report.add(
                "warning",
                water.channels[column],
                f"runs as {channel} did before its sign was reversed; sign reversed here. State it in the"
                f" column map: {name} = {entry}",
            )
    return replace(water, y=water.y * signs)


def _on_an_arm(channel: str, measured: Array, reference: Array, rates: Array) -> bool:
    """Whether ``v + omega x r`` with some r explains a velocity channel (m,) better than a reversed sign.

    `rates` (m, 3) are those of the pose. In a turn the sway of O and that of the bow are opposite.
    """
    i = "uvw".index(channel)
    others = rates[:, [j for j in range(3) if j != i]]
    arms = np.linalg.lstsq(others, measured - reference, rcond=None)[0]
    on_an_arm = np.sum((measured - reference - others @ arms) ** 2)
    return bool(on_an_arm < np.sum((measured + reference) ** 2))


def _filtered(sensor: Signal, t: Array) -> tuple[Array, Mask]:
    """Sensor (n, k) after the filter that the pose's derivative has: the slope of its own integral."""
    step = float(t[1] - t[0])
    half = _half_width(step)
    y, valid = linear(sensor, t)
    integral = np.concatenate([np.zeros((1, y.shape[1])), np.cumsum(0.5 * step * (y[1:] + y[:-1]), axis=0)])
    return _slope(integral, half, step), _all_around(np.logical_and.reduce(valid, axis=1), half)


def _half_width(step: float) -> int:
    return max(1, round(_WINDOW_S / step))


def _slope(y: Array, half: int, step: float) -> Array:
    """Slope of the straight line fitted to each sample and `half` neighbours on both sides, shape as y."""
    from scipy.ndimage import correlate1d

    offsets = np.arange(-half, half + 1)
    weights = offsets / (step * np.sum(offsets**2))
    return np.asarray(correlate1d(y, weights, axis=0, mode="nearest"))


def _all_around(mask: Mask, half: int) -> Mask:
    """True where the whole window is."""
    from scipy.ndimage import minimum_filter1d

    return np.asarray(minimum_filter1d(mask.astype(np.uint8), 2 * half + 1, mode="constant")).astype(bool)


def _correlation(a: Array, b: Array) -> float:
    """Correlation of two sets of channels, each about its own mean, all channels in one sum."""
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    size = np.sqrt(np.sum(a * a) * np.sum(b * b))
    return float(np.sum(a * b) / size) if size > 0.0 else 0.0


def _lowest(x: Array, y: Array) -> float:
    """Place of the minimum of samples y(x), from the parabola through the lowest one and four neighbours."""
    i = int(np.clip(np.argmin(y), 2, len(x) - 3))
    a, b, _ = np.polyfit(x[i - 2 : i + 3] - x[i], y[i - 2 : i + 3], 2)
    return float(x[i] - 0.5 * b / a) if a > 0.0 else float(x[i])
