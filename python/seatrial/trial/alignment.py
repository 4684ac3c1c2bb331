"""Signs and latency of velocity and rate sensors against the motion of the recorded pose.

What a pose implies, how a channel follows it and how a delay is fitted to it, with their deviations, are
those of the consistency check (`seatrial.trial.kinematics`, `kinematic_axes`, `kinematic_fit`); here only
delays and signs are corrected, so that a recording can be read before anyone has checked it. A latency is
removed only if it is several times its deviation and the shifted sensor really follows the pose; otherwise it
is only reported. A channel is reversed only where its gain is near minus one beyond doubt
(`kinematic_axes.Follows`), and, of a velocity, unless a lever arm of the sensor explains it better: in a turn
the bow goes sideways against the stern. A weaker case is a proposal. The velocity through the water, of the
same instrument, is reversed with it where it has the same sense. Held by
``tests/trial/test_trial_alignment.py``.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import ANGLES, unit_factor
from seatrial.trial.attitude import AttitudeConvention, attitude_convention
from seatrial.trial.columns import GROUPS, Source
from seatrial.trial.corrections import Corrections
from seatrial.trial.kinematic_axes import (
    UNITS,
    Follows,
    at_end,
    band,
    follows,
    implausible_side,
    lagged,
    pressure_of,
    rivals,
    shifted,
)
from seatrial.trial.kinematic_fit import Parameter, fitted
from seatrial.trial.kinematics import Channels, Curve, Grid, attitude_rates, earth_velocity, pose_velocity
from seatrial.trial.signals import RecordingReport, Series, Signal, linear, most_moving, own_samples


@dataclass(frozen=True)
class AlignmentSettings:
    """When a sensor follows the pose, which latencies and signs are removed, which scales reported."""

    largest_latency_s: float = 1.0  #: s; latencies are searched within plus and minus this
    least_correlation: float = 0.7  #: correlation of a sensor whose latency can be estimated
    #: of the motion of all axes: an axis with less cannot show that its channel is missing
    clear_motion_share: float = 0.25
    delay_step_s: float = 0.02  #: s, of the delay's difference quotient
    slowest_position_s: float = 0.6  #: s, longest interval of a position that a latency can be estimated from
    fewest_samples: int = 50  #: fewer samples of both sensors are not compared
    most_samples: int = 40_000  #: of a channel are compared: an hour at 10 Hz; it bounds the memory
    unit_tolerance: float = 0.15  #: relative: how far a scale against the pose may be off that of a unit
    least_share_for_scale: float = 0.09  #: share explained from which a scale is told: a correlation of 0.3
    worrying_scale: float = 3.0  #: a scale without a unit is worth a warning beyond this factor
    other_scale: float = 1.25  #: a scale closer to one than this factor is not that of another unit


SETTINGS = AlignmentSettings()


_COLUMN = {
    channel: column
    for group in GROUPS
    for column, channel in zip(group.columns, group.channels, strict=True)
    if group.name in ("velocity", "water velocity", "rates")
}

_AXES = {"velocity": "uvw", "rates": "pqr"}


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
    `sources`: the column map, to quote the entry with the right sign; without `remove` latencies stay.
    `names`: sensors to look at. Signs and delays that are `given` stay, and all where nothing is corrected
    automatically.
    """
    aligned = dict(signals)
    given = given or Corrections()
    if "velocity" in names and "velocity" in signals:
        _report_scale_of_depth(signals, report, sources)
    # A wrong convention of the attitude makes signs look reversed, so it is looked for first; then no sign is
    # corrected.
    gyro = _compared(signals, "rates") if {"rates", "attitude"} <= set(signals) and "rates" in names else None
    convention = _convention(gyro, signals, sources)
    if convention is not None:
        report.warning("attitude convention", "attitude", **convention.facts)
    for name in names:
        if (
            name not in signals
            or "attitude" not in signals
            or (name == "velocity" and "position" not in signals)
        ):
            continue
        if (
            name == "velocity"
            and "depth" in signals
            and signals["position"].step > SETTINGS.slowest_position_s
        ):
            report.info("latency not estimated", name, interval_s=signals["position"].step)
            continue
        # Signs first: a latency is told by a sensor that follows the pose.
        compared = gyro if name == "rates" else _compared(signals, name)
        automatic = given.automatic and convention is None
        fixed = {*given.signs, *given.axes, *(() if automatic else signals[name].channels)}
        sensor = signals[name]
        if compared is not None:
            sensor = _correct_signs(sensor, compared, report, sources, fixed=fixed)
        if name == "velocity" and "water velocity" in signals:
            water = _same_signs(signals["water velocity"], signals[name], sensor, report, sources)
            aligned["water velocity"] = water
        if compared is not None:
            _report_scale(sensor, compared, report, sources)
        aligned[name] = sensor
        if not remove or name in given.delay:
            continue
        # Only a delay that is certain is removed; another one is reported.
        delay = None if compared is None else _latency(compared, float(t[1] - t[0]))
        if delay is None:
            at_end = compared is not None and compared.at_end and any(axis.moves for axis in compared.follows)
            searched: dict[str, Any] = {"searched_s": SETTINGS.largest_latency_s} if at_end else {}
            report.info("latency unclear", name, **searched)
        elif delay.trusted:
            report.latencies[name] = delay.seconds
            report.info("latency removed", name, delay_s=delay.seconds, sd_s=delay.deviation)
            aligned[name] = sensor.earlier(delay.seconds)
            if name == "velocity" and "water velocity" in signals:  # one instrument, one delay
                aligned["water velocity"] = aligned["water velocity"].earlier(delay.seconds)
        else:
            report.info(
                "latency uncertain",
                name,
                delay_s=delay.seconds,
                sd_s=delay.deviation,
                correlation=delay.correlation,
            )
    return aligned


@dataclass(frozen=True)
class _Compared:
    """A sensor beside the motion that the pose implies, both low-passed on one grid.

    The `motion` (n, 3) in m/s or rad/s, of whose axes the sensor has `channels`, where it is known (n,), the
    body rates `turning` (n, 3) of the pose, and the curves between the samples, as recorded.
    """

    group: str
    channels: tuple[str, ...]
    curves: Channels
    grid: Grid
    motion: Array
    known: Mask
    turning: Array

    @property
    def columns(self) -> list[int]:
        """Axis of each channel."""
        return [_AXES[self.group].index(channel) for channel in self.channels]

    @property
    def reference(self) -> Array:
        """Motion (n, k) of the sensor's channels."""
        return self.motion[:, self.columns]

    def shown(self, delay: float) -> tuple[Array, Mask]:
        """What the sensor shows (n, k) if it is late by so many seconds, and where it is known (n,)."""
        values = {f"delay.{self.group}": delay}
        y = [self.curves.at(channel, self.grid.t, values) for channel in self.channels]
        known = self.grid.inside(self.curves.known(self.channels, self.grid.t, values))
        return self.grid.low(np.stack(y, axis=1)), known

    @cached_property
    def rough(self) -> float:
        """Delay in s at which sensor and pose share most, whatever the signs."""
        y, known = self.shown(0.0)
        both = known & self.known
        sides = band(self.reference, both, self.grid), band(y, both, self.grid)
        return lagged(*sides, self.grid.step, SETTINGS.largest_latency_s)[0]

    @property
    def at_end(self) -> bool:
        """Whether that delay is only where the search ended."""
        return at_end(self.rough, SETTINGS.largest_latency_s, self.grid.step)

    @cached_property
    def follows(self) -> tuple[Follows, ...]:
        """How each channel follows its axis at the sensor's one delay, as recorded."""
        y, known = self.shown(0.0)
        both, step = known & self.known, self.grid.step
        first, second = shifted(self.rough, step, len(both))
        motion = band(self.motion, both, self.grid, cut=False)[first]
        channels = band(y, both, self.grid, cut=False)[second]
        sides = band(self.reference, both, self.grid), band(y, both, self.grid)
        axes = []
        for k, column in enumerate(self.columns):
            axis = follows(
                motion, column, channels[:, k], both[first] & both[second],
                step=step, kind=self.group, lag=self.rough,
            )  # fmt: skip
            other = rivals(sides[0][:, k], sides[1][:, k], step, SETTINGS.largest_latency_s)
            axes.append(replace(axis, rival=other[axis.gain < 0.0]))
        return tuple(axes)


def _compared(signals: Mapping[str, Signal], name: str) -> _Compared | None:
    """A sensor beside the pose's motion; None where the pose or the sensor is hardly ever known."""
    used = ("position", "depth", "attitude") if name == "velocity" else ("attitude",)
    curves = _curves(signals, (*used, name))
    needed = ("x", "y", "z", *ANGLES) if name == "velocity" else ANGLES
    names = tuple(channel for channel in signals[name].channels if channel in curves.curves)
    if not set(needed) <= set(curves.curves) or names != signals[name].channels:
        return None
    grid = curves.grid((*needed, *names), SETTINGS.largest_latency_s)
    if grid is None:
        return None
    turning, known = attitude_rates(curves, grid)
    motion = turning
    if name == "velocity":
        motion, seen = pose_velocity(curves, grid)
        known = known & seen
    if known.sum() < SETTINGS.fewest_samples:
        return None
    return _Compared(name, names, curves, grid, motion, known, turning)


def _convention(
    gyro: _Compared | None, signals: Mapping[str, Signal], sources: Mapping[str, Source]
) -> AttitudeConvention | None:
    """Another convention of the attitude that the gyro tells where it does not follow the one read."""
    if gyro is None or not any(axis.moves and (axis.gain < 0.0 or axis.weak) for axis in gyro.follows):
        return None
    curves = _curves(signals, ("position", "depth", "attitude", "velocity", "rates"))
    return attitude_convention(curves, quaternion="q_w" in sources)


def _curves(signals: Mapping[str, Signal], names: Sequence[str]) -> Channels:
    """Curves between the good samples of these signals, of a long record where it moves most."""
    samples = own_samples({name: signals[name] for name in names if name in signals})
    return Channels({
        channel: Curve(Series(t, y), angle=channel in ANGLES)
        for channel, (t, y) in most_moving(samples, SETTINGS.most_samples).items()
        if len(t) >= SETTINGS.fewest_samples
    })


def _latency(compared: _Compared, step: float) -> Latency | None:
    """Delay of a sensor against the pose's motion; None if unclear. `step`: interval of the time base, s."""

    def residual(values: Mapping[str, float]) -> tuple[Array, Mask]:
        y, known = compared.shown(values[key])
        return compared.reference - y, known & compared.known

    key = f"delay.{compared.group}"
    if compared.at_end:
        return None
    parameter = Parameter(key, SETTINGS.delay_step_s, 0.0, always=True, shift=True)
    starts = [{key: delay} for delay in sorted({0.0, compared.rough}, key=abs)]
    fit = fitted(residual, [parameter], compared.grid, starts)
    # Without a value the sensor never moves.
    if fit is None or at_end(fit.values.get(key, np.inf), SETTINGS.largest_latency_s, compared.grid.step):
        return None
    seconds, deviation = fit.values[key], fit.sd[key]
    y, known = compared.shown(seconds)
    use = known & compared.known
    correlation = _correlation(y[use], compared.reference[use])
    certain = abs(seconds) > max(3.0 * deviation, 0.05 * step) and deviation < 0.5 * step
    return Latency(seconds, deviation, correlation, certain and correlation > SETTINGS.least_correlation)


def _correct_signs(
    sensor: Signal,
    compared: _Compared,
    report: RecordingReport,
    sources: Mapping[str, Source],
    *,
    fixed: Collection[str] = (),
) -> Signal:
    """The sensor with channels that run against the pose reversed, in `compared`, too; others that do not
    follow it are named. What a lever arm explains better than a sign stays, and the `fixed` channels.
    """
    signs = np.ones(len(sensor.channels))
    y, known = compared.shown(compared.rough)
    use = known & compared.known
    moving = float(np.std(compared.reference[use])) if use.any() else 0.0
    for k, (channel, axis) in enumerate(zip(sensor.channels, compared.follows, strict=True)):
        reference = compared.reference[use, k]
        # A delay where the search ended is none, and no sign is told at it.
        if compared.at_end or not (axis.reversed or axis.doubtful):
            if axis.unrelated and np.std(reference) > SETTINGS.clear_motion_share * moving:
                report.warning("not following", channel, follows=axis)
            continue
        on_arm = compared.group == "velocity" and _on_an_arm(
            channel, y[use, k], reference, compared.turning[use]
        )
        if on_arm:
            kind = "sign on a lever arm"
        elif channel in fixed:
            kind = "sign left"
        elif axis.doubtful:
            kind = "sign doubtful"
        else:
            kind = "sign reversed"
            signs[k] = -1.0
            compared.curves.axes[channel] = (channel, -1.0)
        report.warning(kind, channel, follows=axis, **_reversed_entry(_COLUMN[channel], sources))
    return replace(sensor, y=sensor.y * signs)


def _reversed_entry(column: str, sources: Mapping[str, Source]) -> dict[str, Any]:
    """A column and its entry in the column map with the other sign, as values of a finding."""
    return {"column": column, "entry": replace(sources[column], sign=-sources[column].sign)}


_SI = {"velocity": "m/s", "rates": "rad/s"}


def _report_scale(
    sensor: Signal, compared: _Compared, report: RecordingReport, sources: Mapping[str, Source]
) -> None:
    """Warn of a sensor larger or smaller than the pose's motion, with the unit that would explain it, by the
    root mean squares about the means over the channels that follow the pose: latency does not change it.
    """
    y, known = compared.shown(0.0)
    use = compared.known & known
    if use.sum() < SETTINGS.fewest_samples:
        return
    following = [
        k
        for k, axis in enumerate(compared.follows)
        if axis.moves and axis.share > SETTINGS.least_share_for_scale
    ]
    if following:
        channels = [sensor.channels[k] for k in following]
        shown, moved = (
            float(np.linalg.norm(x[use][:, following].std(axis=0))) for x in (y, compared.reference)
        )
        _say_scale(sensor, channels, shown, moved, "pose", report, sources)


def _say_scale(
    sensor: Signal,
    channels: Sequence[str],
    shown: float,
    moved: float,
    moving: str,
    report: RecordingReport,
    sources: Mapping[str, Source],
) -> None:
    """Say how much larger channels are than the motion that they follow, and whose unit is to be checked.
    `shown` and `moved`: root mean squares of the channels and of pose or depth, m/s or rad/s.
    """
    scale = shown / max(moved, 1e-300)
    # Which of the two has a size that no vehicle has, has the wrong unit.
    side = implausible_side(shown, moved, sensor.name)
    if 1.0 / SETTINGS.other_scale < scale < SETTINGS.other_scale or side == "both":
        return
    if side == "reference":
        channel = "z" if moving == "depth" else "position" if sensor.name == "velocity" else "attitude"
        report.warning(
            "unit of the reference",
            channel,
            moved=moved,
            shown=shown,
            scale=scale,
            unit=_SI[sensor.name],
            sensor=sensor.name,
            moving=moving,
            pressure=pressure_of(scale) if moving == "depth" else None,
        )
        return
    columns = [_COLUMN[channel] for channel in channels]
    group = next(group for group in GROUPS if columns[0] in group.columns)
    units = {**UNITS[sensor.name], _SI[sensor.name]: 1.0}
    for column in columns:
        source = sources[column]
        # A unit explains the scale if the sensor would agree with the pose in it.
        stated = unit_factor(source.unit, (group.unit,), group.name) if source.unit else group.factor
        likely = [
            unit for unit, size in units.items() if abs(scale * size / stated - 1.0) < SETTINGS.unit_tolerance
        ]
        channel = sensor.channels[columns.index(column)] if len(columns) == len(sensor.channels) else column
        # Noise of a positioning system may make a scale without a unit, as long as it is near one.
        if not likely and 1.0 / SETTINGS.worrying_scale < scale < SETTINGS.worrying_scale:
            continue
        unit = likely[0] if likely else None
        entry = replace(source, unit=unit) if unit else source
        report.warning(
            "unit of the sensor", channel, scale=scale, moving=moving, unit=unit, column=column, entry=entry
        )


def _report_scale_of_depth(
    signals: Mapping[str, Signal], report: RecordingReport, sources: Mapping[str, Source]
) -> None:
    """Warn of a velocity that the rate of depth, the third row of R times it (Fossen 2011, equation 2.40),
    contradicts, where no position at a useful rate tells more.
    """
    depth = next((signals[name] for name in ("depth", "position") if name in signals), None)
    if depth is None or "z" not in depth.channels or "attitude" not in signals:
        return
    position = signals.get("position")
    if position is not None and "x" in position.channels and position.step <= SETTINGS.slowest_position_s:
        return
    curves = _curves(signals, ("position", "depth", "velocity", "attitude"))
    needed = {"z", *ANGLES, *signals["velocity"].channels}
    grid = curves.grid(tuple(needed), SETTINGS.largest_latency_s) if needed <= set(curves.curves) else None
    if grid is None:
        return
    v = np.stack([curves.at(name, grid.t, {}) for name in "uvw"], axis=1)
    known = grid.inside(curves.known(tuple(needed), grid.t, {}))
    rate, shown = (
        grid.slope(curves.at("z", grid.t, {}))[:, None],
        grid.low(earth_velocity(curves.rotation(grid.t), v)[:, 2:]),
    )
    if known.sum() < SETTINGS.fewest_samples:
        return
    _, correlation = lagged(
        band(rate, known, grid), band(shown, known, grid), grid.step, 0.5 * SETTINGS.largest_latency_s
    )
    if abs(correlation[0, 0]) > SETTINGS.least_correlation:
        sizes = float(shown[known].std()), float(rate[known].std())
        _say_scale(signals["velocity"], signals["velocity"].channels, *sizes, "depth", report, sources)


def _same_signs(
    water: Signal, recorded: Signal, corrected: Signal, report: RecordingReport, sources: Mapping[str, Source]
) -> Signal:
    """Velocity through the water with the channels reversed that ran as reversed ones over ground did: one
    instrument has one sense, and a single reversed velocity would make a current of twice the speed.
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
            own = water.channels[column]
            report.warning("sign reversed", own, like=channel, **_reversed_entry(_COLUMN[own], sources))
    return replace(water, y=water.y * signs)


def _on_an_arm(channel: str, measured: Array, reference: Array, rates: Array) -> bool:
    """Whether ``v + omega x r`` with some r explains a velocity channel (m,) better than a reversed sign: in
    a turn the sway of O and that of the bow are opposite. `rates` (m, 3): of the pose.
    """
    i = "uvw".index(channel)
    others = rates[:, [j for j in range(3) if j != i]]
    arms = np.linalg.lstsq(others, measured - reference, rcond=None)[0]
    on_an_arm = np.sum((measured - reference - others @ arms) ** 2)
    return bool(on_an_arm < np.sum((measured + reference) ** 2))


def _correlation(a: Array, b: Array) -> float:
    """Correlation of two sets of channels, each about its own mean, all channels in one sum."""
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    size = np.sqrt(np.sum(a * a) * np.sum(b * b))
    return float(np.sum(a * b) / size) if size > 0.0 else 0.0
