"""Manoeuvres in a recording, found and named from what drives the vehicle and how it moves.

The names are those of sea trials (ITTC 7.5-02-06-03 for turns, zigzags and straight runs; steps, coast-downs
and decays of identification: Ljung, System Identification, 1999, chapter 13). What drives is the recorded
wrench, else the wrench of a vehicle under the recorded commands, else the commands by themselves: only then
has a step no axis. Thresholds follow the recording: a turn is a turn for this vehicle. Held by
``tests/inspect/test_manoeuvres.py``.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from seatrial.base.arrays import Array, Mask, runs
from seatrial.base.channels import AXES, CHANNELS, readable
from seatrial.base.plain import Plain
from seatrial.base.report import wording

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.trial.trial import Trial

Kind = Literal[
    "step", "coast-down", "turn", "zigzag", "dive", "rise", "decay", "straight run", "station-keeping", "rest"
]


@dataclass(frozen=True)
class ManoeuvreSettings:
    """What counts as a step, a turn, a coast-down, a zigzag or a decay."""

    #: Of the largest force or moment: an axis that is driven less is not driven on purpose.
    minor_share: float = 0.1
    coupled_correlation: float = 0.98  #: Of two drives that are one: the sway force of a rudder, say.
    quiet_share: float = 0.08  #: Of a drive's range: a hold changes by less within `hold_s`.
    quietest_share: float = 0.02  #: Likewise where the drive shows no noise.
    hold_s: float = 1.5  #: Shortest hold, s.
    #: Of a step's new level, s: a loop that answers waves rests for shorter times.
    shortest_step_s: float = 2.5
    step_size: float = 2.0  #: Times what a hold may change by: a larger change is a step.
    step_takes_s: float = 2.0  #: Longest change from one level to the next, s.
    #: Of the motion's 98 % quantile: below, the vehicle does not turn, dive or move.
    slow_share: float = 0.15
    zigzag_swings: int = 4  #: To and fro, twice.
    long_s: float = 10.0  #: Straight runs, station-keeping and rest are longer, s.
    coast_s: float = 4.0  #: A coast-down is longer, s.
    coast_loss: float = 0.4  #: Of the speed at its start that a coast-down loses.
    #: Least change of heading of a turn, rad.
    turn_angle: float = math.radians(30.0)
    #: Of heading that is a swing, rad.
    swing_angle: float = math.radians(6.0)
    #: Slower is no turn for any vehicle, rad/s.
    turn_rate: float = math.radians(1.0)
    #: Least amplitude of a free decay, rad.
    decay_angle: float = math.radians(2.5)


SETTINGS = ManoeuvreSettings()


@dataclass(frozen=True, eq=False)
class Drive:
    """What drives a vehicle along one axis, or one actuator where no wrench is known.

    ``axis`` is a letter of "XYZKMN", "" for an actuator; ``y`` (n,) in ``unit``; ``neutral`` where it drives
    nothing.
    """

    name: str
    axis: str
    unit: str
    y: Array
    neutral: float = 0.0

    @cached_property
    def range(self) -> float:
        """Distance between the 1 % and the 99 % quantile."""
        low, high = np.quantile(self.y, [0.01, 0.99])
        return float(high - low)


@dataclass(frozen=True)
class Manoeuvre(Plain, without="values", also="sentence"):
    """A part of a recording with a name."""

    #: "step", "coast-down", "turn", "zigzag", "dive", "rise", "decay", "straight run", "station-keeping" or
    #: "rest".
    kind: Kind
    #: The axis ("X" ... "N") or the actuator that is stepped or stopped, the axis that moves otherwise.
    by: str
    #: In the trial's own time. A step lasts as long as its new level is held.
    start_s: float
    end_s: float
    #: Change of the drive of a step, heading change of a turn and of a zigzag's swings, depth change of a
    #: dive, first angle of a decay, speed of a straight run and at the start of a coast-down; angles in deg.
    size: float
    unit: str
    values: Mapping[str, Any] = field(default_factory=dict)  #: What the words need besides, by kind.

    @property
    def sentence(self) -> str:
        """All of it in words."""
        return str(wording("trial_findings").manoeuvre(self))


def drives(trial: Trial, vehicle: Vehicle | None = None) -> list[Drive]:
    """What drives the vehicle: axes of the wrench, recorded or that of the commands with the vehicle held
    (with fins at the trial's usual speed), or single actuators where no wrench is known.
    """
    tau = trial.tau if trial.tau is not None else _wrench(trial, vehicle)
    if tau is None:
        commands = [
            Drive(name, "", _command_unit(y), y, 1500.0 if _command_unit(y) == "us" else 0.0)
            for name, y in trial.commands.items()
        ]
        return [drive for drive in commands if drive.range > 0.0]
    axes = [Drive(axis, axis, "N" if k < 3 else "N m", tau[:, k]) for k, axis in enumerate(AXES)]
    ranges = [drive.range for drive in axes]
    least = [SETTINGS.minor_share * max(ranges[:3])] * 3 + [SETTINGS.minor_share * max(ranges[3:])] * 3
    kept = {d.axis: d for d, r, limit in zip(axes, ranges, least, strict=True) if r > limit}
    for moment, force in (("N", "Y"), ("M", "Z"), ("N", "K"), ("M", "K")):
        if {moment, force} <= set(kept) and _correlation(
            kept[moment].y, kept[force].y
        ) > SETTINGS.coupled_correlation:
            del kept[force]
    return list(kept.values())


def _correlation(a: Array, b: Array) -> float:
    return abs(float(np.corrcoef(a, b)[0, 1]))


def _wrench(trial: Trial, vehicle: Vehicle | None) -> Array | None:
    """Wrench (n, 6) about O of the held vehicle; None where commands are missing."""
    from seatrial._core import State

    if vehicle is None or not vehicle.actuators or not set(vehicle.actuators) <= set(trial.commands):
        return None
    facts = vehicle.actuator_info().values()
    if any(actuator["needs_voltage"] for actuator in facts) and trial.voltage_v is None:
        return None
    fins = any(actuator["kind"] == "fin" for actuator in facts)
    speed = float(np.quantile(np.abs(trial.nu[:, 0]), 0.8)) if fins else 0.0
    start = State(nu=[speed, 0.0, 0.0, 0.0, 0.0, 0.0])
    commands = {name: trial.commands[name] for name in vehicle.actuators}
    run = vehicle.simulate(
        trial.t, commands, start, free="", voltage_v=trial.voltage_v, max_step_s=max(trial.dt, 0.02)
    )
    return np.asarray(run.tau)


def _command_unit(y: Array) -> str:
    """Unit of pulse widths, told by their range; that of other commands is not known here."""
    return "us" if y.min() >= 900.0 and y.max() <= 2200.0 else ""


def manoeuvres(trial: Trial, vehicle: Vehicle | None = None) -> list[Manoeuvre]:
    """Manoeuvres of a trial in the order of their start; the vehicle is as in `drives`.

    >>> import seatrial as st
    >>> t = np.arange(0.0, 60.0, 0.1)
    >>> surge = np.where(t < 20.0, 0.0, 30.0)
    >>> trial = st.Trial.read({"t_s": t, "u_m_s": np.minimum(0.05 * np.maximum(t - 20.0, 0.0), 1.0),
    ...     "tau.X_n": surge})
    >>> [one.sentence for one in manoeuvres(trial) if one.kind == "step"]
    ['step of the surge force from 0 to 30 N at 20 s, held for 40 s']
    """
    driving = drives(trial, vehicle)
    motion = _Motion(trial)
    sequence = [*_steps(trial, driving), *_coast_downs(trial, driving, motion), *_swings(trial, motion)]
    sequence += [*_dives(trial, motion), *_decays(trial, driving), *_steady(trial, driving, motion)]
    return sorted(sequence, key=lambda manoeuvre: (manoeuvre.start_s, manoeuvre.end_s))


def counted(sequence: Iterable[Manoeuvre]) -> str:
    """Manoeuvres by kind and axis in words: ``4 steps of X, 2 turns``; "" without any.

    >>> counted([Manoeuvre("dive", "Z", 0.0, 9.0, 3.0, "m")])
    '1 dive'
    """
    many = Counter((manoeuvre.kind, _whose(manoeuvre)) for manoeuvre in sequence)
    order = [*get_args(Kind)]
    many_first = sorted(many.items(), key=lambda item: (order.index(item[0][0]), item[0][1]))
    return ", ".join(
        f"{count} {kind if count == 1 or kind in ('station-keeping', 'rest') else kind + 's'}"
        + (f" of {by}" if by else "")
        for (kind, by), count in many_first
    )


def _whose(manoeuvre: Manoeuvre) -> str:
    """The axis of a manoeuvre whose kind does not tell it; steps of actuators count together."""
    if manoeuvre.kind not in ("step", "coast-down", "decay"):
        return ""
    return manoeuvre.by if manoeuvre.by in AXES else "single actuators"


class _Motion:
    """Smoothed speeds of a trial (n,), None where a channel is missing, and what counts as moving."""

    def __init__(self, trial: Trial) -> None:
        self.dt = trial.dt
        values = {name: trial.filled(name) for name in CHANNELS}
        self.nu: Mapping[str, Array] = {
            name: self._smooth(y, 1.0) for name in "uvwr" if (y := values[name]) is not None
        }
        self.heading = values["yaw"]
        if self.heading is None and "r" in self.nu:
            self.heading = np.cumsum(self.nu["r"]) * self.dt
        depth = values["z"]
        self.depth = None if depth is None else self._smooth(depth, 2.0)
        self.sink = None if self.depth is None else np.gradient(self.depth, self.dt)
        nothing = np.zeros(len(trial))
        self.turns = nothing if "r" not in self.nu else self._moving(self.nu["r"], SETTINGS.turn_rate)
        self.sinks = nothing if self.sink is None else self._moving(self.sink, 0.02)

    def _smooth(self, y: Array, seconds: float) -> Array:
        from scipy.ndimage import uniform_filter1d

        return np.asarray(uniform_filter1d(y, max(1, round(seconds / self.dt)), mode="nearest"))

    @staticmethod
    def _moving(y: Array, least: float) -> Array:
        """Sign of the motion where it is faster than slow, 0 elsewhere."""
        limit = max(least, SETTINGS.slow_share * float(np.quantile(np.abs(y), 0.98)))
        return np.where(np.abs(y) > limit, np.sign(y), 0.0)


def _clean(y: Array, dt: float) -> Array:
    """Drive without spikes of a sample or two, as dropped packets leave them."""
    from scipy.ndimage import median_filter

    # No wider than the series: stamps a microsecond apart would make a window of half a million samples.
    half = min(max(1, round(0.25 / dt)), len(y))
    return np.asarray(median_filter(y, 2 * half + 1, mode="nearest"))


@dataclass(frozen=True, eq=False)
class _Holds:
    """A drive (n,) without spikes, where it is held, and by how much a hold may change."""

    y: Array
    held: Mask
    tolerance: float


def _holds(drive: Drive, dt: float) -> _Holds:
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    y = _clean(drive.y, dt)
    size = max(2, round(SETTINGS.hold_s / dt))
    spread = maximum_filter1d(y, size, mode="nearest") - minimum_filter1d(y, size, mode="nearest")
    # What the drive changes by in calm parts is its noise: a pilot's hand, a depth controller, the battery.
    noise = 2.0 * float(np.median(spread))
    tolerance = float(
        np.clip(noise, SETTINGS.quietest_share * drive.range, SETTINGS.quiet_share * drive.range)
    )
    # A window that begins or ends at a sample is quiet: the hold reaches its own ends.
    held = maximum_filter1d((spread <= tolerance).astype(np.uint8), size, mode="constant")
    return _Holds(y, np.asarray(held).astype(bool), tolerance)


def _levels(holds: _Holds, dt: float) -> list[tuple[int, int, float]]:
    """Holds of a drive: first sample, last sample plus one, level."""
    found = []
    size = max(2, round(SETTINGS.hold_s / dt))
    for start, stop in runs(holds.held, size):
        # A widened run may hold two levels with a clean step between: cut where it jumps.
        jumps = start + 1 + np.flatnonzero(np.abs(np.diff(holds.y[start:stop])) > holds.tolerance)
        for a, b in zip([start, *jumps.tolist()], [*jumps.tolist(), stop], strict=True):
            if b - a >= max(2, size // 2):
                found.append((a, b, float(np.median(holds.y[a:b]))))
    return found


def _steps(trial: Trial, driving: Sequence[Drive]) -> Iterator[Manoeuvre]:
    for drive in driving:
        holds = _holds(drive, trial.dt)
        levels = _levels(holds, trial.dt)
        for (_, end, before), (start, stop, level) in pairwise(levels):
            late = (start - end) * trial.dt > SETTINGS.step_takes_s
            short = (stop - start) * trial.dt < SETTINGS.shortest_step_s
            if late or short or abs(level - before) < SETTINGS.step_size * holds.tolerance:
                continue
            t, until = float(trial.t[start]), float(trial.t[stop - 1]) + trial.dt
            levels_of = {"axis": drive.axis, "before": before, "after": level, "range": drive.range}
            yield Manoeuvre("step", drive.name, t, until, level - before, drive.unit, levels_of)


def _coast_downs(trial: Trial, driving: Sequence[Drive], motion: _Motion) -> Iterator[Manoeuvre]:
    """Motion that dies away without its drive: surge, sway and yaw."""
    for axis, channel in (("X", "u"), ("Y", "v"), ("N", "r")):
        neutral = _neutral(driving, axis, trial.dt)
        if channel not in motion.nu or neutral is None:
            continue
        y = motion.nu[channel]
        least = max(
            SETTINGS.turn_rate if channel == "r" else 0.05, 0.25 * float(np.quantile(np.abs(y), 0.98))
        )
        for start, stop in runs(neutral, round(SETTINGS.coast_s / trial.dt)):
            first, last = abs(float(y[start])), abs(float(y[stop - 1]))
            if first < least or last > (1.0 - SETTINGS.coast_loss) * first:
                continue
            factor, unit = readable(channel)
            t, until = float(trial.t[start]), float(trial.t[stop - 1])
            yield Manoeuvre("coast-down", axis, t, until, factor * first, unit, {"last": factor * last})


def _neutral(driving: Sequence[Drive], axis: str, dt: float) -> Mask | None:
    """Where nothing drives an axis: its own drive, or all actuators where no wrench is known."""
    own = [drive for drive in driving if drive.axis in (axis, "")]
    if not own:
        return None
    calm = [np.abs(_clean(d.y, dt) - d.neutral) <= SETTINGS.quiet_share * d.range for d in own]
    return np.asarray(np.logical_and.reduce(calm))


def _swings(trial: Trial, motion: _Motion) -> Iterator[Manoeuvre]:
    """Zigzags, and turns outside them."""
    if motion.heading is None:
        return
    swings: list[tuple[int, int, float]] = []
    for sign in (1.0, -1.0):
        for start, stop in runs(motion.turns == sign, 2):
            change = float(motion.heading[stop - 1] - motion.heading[start])
            if change * sign > SETTINGS.swing_angle:
                swings.append((start, stop, change))
    swings.sort()
    for group in _zigzags(swings, trial.dt):
        t, until = float(trial.t[group[0][0]]), float(trial.t[group[-1][1] - 1])
        size = float(np.rad2deg(np.median([abs(change) for *_, change in group])))
        yield Manoeuvre("zigzag", "N", t, until, size, "deg", {"swings": len(group)})
        swings = [swing for swing in swings if swing not in group]
    for start, stop, change in swings:
        if abs(change) < SETTINGS.turn_angle:
            continue
        t, until = float(trial.t[start]), float(trial.t[stop - 1])
        yield Manoeuvre("turn", "N", t, until, float(np.rad2deg(change)), "deg")


def _zigzags(swings: Sequence[tuple[int, int, float]], dt: float) -> Iterator[list[tuple[int, int, float]]]:
    """Groups of swings to both sides in turn, of similar size, one after the other."""
    group: list[tuple[int, int, float]] = []
    for swing in [*swings, None]:
        if group and swing is not None:
            _, stop, change = group[-1]
            near = (swing[0] - stop) * dt < max(3.0, 0.5 * (swing[1] - swing[0]) * dt)
            alike = 0.4 < abs(swing[2] / change) < 2.5
            if near and alike and swing[2] * change < 0.0:
                group.append(swing)
                continue
        if len(group) >= SETTINGS.zigzag_swings:
            yield group
        group = [] if swing is None else [swing]


def _dives(trial: Trial, motion: _Motion) -> Iterator[Manoeuvre]:
    if motion.depth is None:
        return
    low, high = np.quantile(motion.depth, [0.01, 0.99])
    least = max(0.2, 0.1 * float(high - low))
    for sign in (1.0, -1.0):
        for start, stop in runs(motion.sinks == sign, 2):
            change = float(motion.depth[stop - 1] - motion.depth[start])
            if change * sign < least:
                continue
            t, until = float(trial.t[start]), float(trial.t[stop - 1])
            kind: Kind = "dive" if sign > 0.0 else "rise"
            depths = {"from_m": float(motion.depth[start]), "to_m": float(motion.depth[stop - 1])}
            yield Manoeuvre(kind, "Z", t, until, change, "m", depths)


def _decays(trial: Trial, driving: Sequence[Drive]) -> Iterator[Manoeuvre]:
    """Swinging of roll or pitch that dies away while nothing changes the vehicle's drives."""
    from scipy.signal import find_peaks

    held = np.ones(len(trial), bool)
    for drive in driving:
        held &= _holds(drive, trial.dt).held
    for channel, axis in (("roll", "K"), ("pitch", "M")):
        y = trial.filled(channel)
        if y is None:
            continue
        for start, stop in runs(held, round(SETTINGS.coast_s / trial.dt)):
            part = y[start:stop] - np.median(y[start + (stop - start) // 2 : stop])
            size = float(np.abs(part[: max(2, len(part) // 5)]).max())
            if size < SETTINGS.decay_angle:
                continue
            # Extremes that stand out of the noise; the first may be the release itself.
            peaks = np.sort(np.concatenate([find_peaks(s * part, prominence=0.1 * size)[0] for s in (1, -1)]))
            peaks = peaks[np.abs(part[peaks]) > 0.08 * size]
            heights, sides = np.abs(part[peaks]), np.sign(part[peaks])
            dying = (np.diff(heights) < 0.1 * size).all() and (np.diff(sides) != 0.0).all()
            if len(heights) < 3 or not dying or heights[2] > 0.8 * size:
                continue
            t, until = float(trial.t[start]), float(trial.t[stop - 1])
            yield Manoeuvre(
                "decay", axis, t, until, float(np.rad2deg(size)), "deg", {"extremes": len(heights)}
            )


def _steady(trial: Trial, driving: Sequence[Drive], motion: _Motion) -> Iterator[Manoeuvre]:
    """Straight runs, station-keeping and rest."""
    from scipy.ndimage import maximum_filter1d

    if "u" not in motion.nu:
        return
    level = (motion.turns == 0.0) & (motion.sinks == 0.0)
    u = motion.nu["u"]
    speed = np.sqrt(u**2 + motion.nu.get("v", 0.0 * u) ** 2)
    way = max(0.1, 2.0 * SETTINGS.slow_share * float(np.quantile(speed, 0.98)))
    samples = round(SETTINGS.long_s / trial.dt)
    for start, stop in runs(level & (u > way), samples):
        low, high = np.quantile(u[start:stop], [0.05, 0.95])
        if motion.heading is not None and np.ptp(motion.heading[start:stop]) > SETTINGS.turn_angle / 3.0:
            continue
        t, until = float(trial.t[start]), float(trial.t[stop - 1])
        speeds = {"low": float(low), "high": float(high)}
        yield Manoeuvre("straight run", "X", t, until, float(np.median(u[start:stop])), "m/s", speeds)
    busy = np.zeros(len(trial), bool)
    for drive in driving:
        busy |= np.abs(_clean(drive.y, trial.dt) - drive.neutral) > SETTINGS.quiet_share * drive.range
    # Commands that pause for some seconds are still those of somebody who keeps the station.
    busy = np.asarray(maximum_filter1d(busy.astype(np.uint8), round(SETTINGS.coast_s / trial.dt) + 1)).astype(
        bool
    )
    still = level & (speed < min(0.5 * way, 0.15))
    both: tuple[tuple[Kind, Mask], ...] = (("station-keeping", busy), ("rest", ~busy))
    for kind, driven in both:
        for start, stop in runs(still & driven, samples):
            t, until = float(trial.t[start]), float(trial.t[stop - 1])
            size = float(speed[start:stop].mean())
            yield Manoeuvre(kind, "", t, until, size, "m/s")
