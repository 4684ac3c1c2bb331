"""Corrections that a campaign accepts: scale, axes, signs, bias, mounting, delay, heading; a slow current.

They are applied to the samples on their own stamps, before anything is put on one time base, in this order:
scale of a sensor, axes, signs, bias (less), scale of a channel, mounting, heading, frame, delay. What is
given here wins over what `Trial.read` finds by itself; with ``automatic`` false nothing else is corrected.
What to give is proposed by `seatrial.inspect.consistency`. Held by ``tests/trial/test_corrections.py``.

Lever arms: a velocity sensor at p_bs (body frame, from O) shows ``v_S = v_O + omega x p_bs``; a positioning
antenna or pressure cell there shows ``p_S = p_O + R p_bs`` (Fossen 2011, section 2.2). Without p_bs a turn
looks like sway and a trim like depth; `to_origin` brings both to O. Held by
``tests/trial/test_sensor_position.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import DEGREE
from seatrial.base.errors import CampaignError, TrialError, nearest
from seatrial.base.frames import from_euler, matrix, product
from seatrial.trial.attitude import Tilt, turned_upright
from seatrial.trial.signals import RecordingReport, Signal, linear

CHANNELS_OF = {
    "velocity": ("u", "v", "w"),
    "water_velocity": ("u_water", "v_water", "w_water"),
    "rates": ("p", "q", "r"),
    "position": ("x", "y", "z"),
    "depth": ("z",),
}
"""Channels of the sensors that a key may name."""

_CHANNELS = tuple(dict.fromkeys(channel for channels in CHANNELS_OF.values() for channel in channels))

_DELAYED = (*CHANNELS_OF, "attitude")

_UNITS = {"_deg_s": DEGREE, "_m_s": 1.0, "_m": 1.0}  # longer ones first

KEYS = ("automatic", "signs", "axes", "delay_s", "tilt_deg", "scale", "bias", "heading_deg", "current")
"""Keys of the table."""


@dataclass(frozen=True)
class CorrectionSettings:
    """Largest values that a correction may hold: a larger one is in another unit."""

    largest_delay_s: float = 1e3  #: Delay of a sensor, s.
    largest_scale: float = 1e6  #: Factor on a channel.
    largest_angle_deg: float = 360.0  #: Angle of a tilt, deg.
    farthest_lengths: float = 2.0  #: lengths of the hull: no sensor is carried farther out


SETTINGS = CorrectionSettings()


@dataclass(frozen=True)
class Corrections:
    """Corrections by channel or sensor, SI; angles in rad."""

    #: Whether latencies, signs and a tilted frame that are found are corrected as well.
    automatic: bool = True
    #: Sign by channel; recorded channel and its sign by true channel.
    signs: dict[str, float] = field(default_factory=dict)
    axes: dict[str, tuple[str, float]] = field(default_factory=dict)
    delay: dict[str, float] = field(default_factory=dict)  #: s by sensor.
    #: Factor by sensor or channel; what a channel shows at zero.
    scale: dict[str, float] = field(default_factory=dict)
    bias: dict[str, float] = field(default_factory=dict)
    mounting: Array | None = None  #: Roll, pitch and yaw of the velocity sensor in the body, (3,).
    frame: Array | None = None  #: Direction of gravity in the pose's frame, north and east of its z, (2,).
    heading: float = 0.0  #: Added to the yaw.
    #: Time in s, north and east of the water's velocity in m/s at knots, (k, 3), linear between them and held
    #: beyond them; None for none.
    current: Array | None = None
    given: dict[str, Any] = field(default_factory=dict)  #: Keys and values as written.


def merged(base: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """The tables of a campaign and of one of its trials as one; what the trial gives wins.

    >>> merged({"signs": {"p": -1}, "heading_deg": 3.0}, {"signs": {"q": -1}})
    {'signs': {'p': -1, 'q': -1}, 'heading_deg': 3.0}
    """
    result = dict(base)
    for key, value in own.items():
        before = result.get(key)
        both = isinstance(value, Mapping) and isinstance(before, Mapping)
        result[key] = {**before, **value} if both and before is not None else value
    return result


def parse_corrections(given: Mapping[str, Any] | None, where: str) -> Corrections:
    """Corrections from their table.

    >>> parse_corrections({"delay_s": {"velocity": 0.24}}, "log.csv: corrections").delay
    {'velocity': 0.24}
    """
    table = dict(given or {})
    for key in table:
        if key not in KEYS:
            raise TrialError(f"{where}: unknown key {key!r}{nearest(str(key), KEYS)}; correct or remove it")
    automatic = table.get("automatic", True)
    if not isinstance(automatic, bool):
        raise TrialError(f"{where}, automatic: expected true or false, found {automatic!r}")
    read = _Reader(table, where)
    tilts = read.table("tilt_deg", ("velocity", "frame"))
    mounting = read.angles(tilts, "velocity", 3, "roll, pitch and yaw of the sensor in the body")
    frame = read.angles(tilts, "frame", 2, "gravity's direction north and east of the frame's z")
    heading = read.number(
        table.get("heading_deg", 0.0), "heading_deg", SETTINGS.largest_angle_deg, "give it in degrees"
    )
    return Corrections(
        automatic=automatic,
        signs={k: read.sign(v, k) for k, v in read.table("signs", _CHANNELS).items()},
        axes=read.axes(),
        delay=read.numbers("delay_s", _DELAYED, SETTINGS.largest_delay_s, "give it in seconds"),
        scale=read.scales(),
        bias=read.biases(),
        mounting=None if mounting is None else mounting * DEGREE,
        frame=None if frame is None else np.sin(frame * DEGREE),
        heading=heading * DEGREE,
        current=read.current(),
        given=_flat(table),
    )


def _flat(table: Mapping[str, Any]) -> dict[str, Any]:
    """Dotted keys and values, without `automatic`."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        if key == "current" and isinstance(value, Mapping):
            flat[key] = f"{len(value['t_s'])} knots"
        elif isinstance(value, Mapping):
            flat |= {f"{key}.{inner}": entry for inner, entry in value.items()}
        elif key != "automatic":
            flat[key] = value
    return flat


@dataclass(frozen=True)
class _Reader:
    """Values of a table of corrections, checked."""

    given: Mapping[str, Any]
    where: str

    def table(self, key: str, names: Sequence[str]) -> Mapping[str, Any]:
        """Table under a key, whose entries have only these names."""
        entry = self.given.get(key, {})
        if not isinstance(entry, Mapping):
            raise TrialError(
                f"{self.where}, {key}: expected a table, as in {key} = {{ {names[0]} = ... }}, found"
                f" {entry!r}"
            )
        for name in entry:
            if name not in names:
                near = nearest(str(name), names)
                raise TrialError(f"{self.where}, {key}: unknown name {name!r}{near}; correct or remove it")
        return entry

    def number(self, value: Any, key: str, most: float, remedy: str, least: float | None = None) -> float:
        """A finite number of at most this size."""
        least = -most if least is None else least
        real = isinstance(value, int | float) and not isinstance(value, bool)
        if not (real and least <= value <= most):
            raise TrialError(
                f"{self.where}, {key}: expected a number from {least:g} to {most:g}, found {value!r};"
                f" {remedy}"
            )
        return float(value)

    def numbers(self, key: str, names: Sequence[str], most: float, remedy: str) -> dict[str, float]:
        """Numbers of a table."""
        entries = self.table(key, names).items()
        return {name: self.number(value, f"{key}.{name}", most, remedy) for name, value in entries}

    def sign(self, value: Any, channel: str) -> float:
        """1 or -1."""
        if isinstance(value, bool) or value not in (1, -1):
            raise TrialError(f"{self.where}, signs.{channel}: expected 1 or -1, found {value!r}")
        return float(value)

    def scales(self) -> dict[str, float]:
        """Positive factors of sensors and channels."""
        remedy = "a factor is positive; give a sign under signs"
        entries = self.table("scale", (*CHANNELS_OF, *_CHANNELS)).items()
        least = 1.0 / SETTINGS.largest_scale
        return {k: self.number(v, f"scale.{k}", SETTINGS.largest_scale, remedy, least) for k, v in entries}

    def biases(self) -> dict[str, float]:
        """SI biases by channel; the key ends in the unit."""
        names = {f"{c}_deg_s": c for c in "pqr"} | {f"{c}_m": c for c in "xyz"}
        names |= {f"{c}_m_s": c for c in (*CHANNELS_OF["velocity"], *CHANNELS_OF["water_velocity"])}
        units = {name: next(x for end, x in _UNITS.items() if name.endswith(end)) for name in names}
        entries = self.numbers("bias", tuple(names), 1e3, "check the unit that ends the key")
        return {names[name]: value * units[name] for name, value in entries.items()}

    def axes(self) -> dict[str, tuple[str, float]]:
        """Recorded channel and sign by true channel, both of one sensor."""
        exchanged = {}
        for channel, entry in self.table("axes", _CHANNELS).items():
            group = next(channels for channels in CHANNELS_OF.values() if channel in channels)
            recorded = entry.lstrip("-") if isinstance(entry, str) else ""
            if recorded not in group:
                raise TrialError(
                    f"{self.where}, axes.{channel}: expected the recorded channel, one of"
                    f" {', '.join(group)}, with a minus in front if it is reversed, found {entry!r}"
                )
            exchanged[channel] = (recorded, -1.0 if entry.startswith("-") else 1.0)
        return exchanged

    def current(self) -> Array | None:
        """Time in s, north and east in m/s of the knots, (k, 3); None where absent."""
        names = ("t_s", "north_m_s", "east_m_s")
        table = self.table("current", names)
        if not table:
            return None
        columns = []
        for name in names:
            entry = table.get(name)
            if not isinstance(entry, list | tuple) or not entry or len(entry) != len(table.get("t_s", ())):
                raise TrialError(
                    f"{self.where}, current.{name}: expected a list of numbers, as many as in t_s, found"
                    f" {entry!r}"
                )
            most, remedy = (1e11, "give it in s") if name == "t_s" else (100.0, "give it in m/s")
            columns.append([self.number(cell, f"current.{name}", most, remedy) for cell in entry])
        if np.any(np.diff(columns[0]) <= 0.0):
            raise TrialError(f"{self.where}, current.t_s: expected rising times, found {list(table['t_s'])}")
        return np.array(columns).T

    def angles(self, table: Mapping[str, Any], key: str, count: int, meaning: str) -> Array | None:
        """Angles in deg, (count,); None where absent."""
        if key not in table:
            return None
        value = table[key]
        if not isinstance(value, list | tuple) or len(value) != count:
            raise TrialError(
                f"{self.where}, tilt_deg.{key}: expected {count} angles in degrees ({meaning}), found"
                f" {value!r}"
            )
        most = SETTINGS.largest_angle_deg if count == 3 else 45.0
        return np.array([
            self.number(angle, f"tilt_deg.{key}", most, "give it in degrees") for angle in value
        ])


def corrected(
    signals: Mapping[str, Signal], corrections: Corrections, report: RecordingReport
) -> dict[str, Signal]:
    """The signals as the corrections say, each reported with its key and value."""
    work = _Work(dict(signals))
    for sensor, channels in CHANNELS_OF.items():
        if sensor in corrections.scale:
            work.channels(channels, partial(np.multiply, corrections.scale[sensor]))
    # In the order of the module: scale of a sensor, axes, signs, bias, scale of a channel, mounting.
    work.exchange(corrections.axes)
    for channel, sign in corrections.signs.items():
        work.channels((channel,), partial(np.multiply, sign))
    for channel, bias in corrections.bias.items():
        work.channels((channel,), partial(np.add, -bias))
    for channel in _CHANNELS:
        if channel in corrections.scale:
            work.channels((channel,), partial(np.multiply, corrections.scale[channel]))
    if corrections.mounting is not None:
        work.turn(matrix(from_euler(corrections.mounting)))
    if corrections.heading and "attitude" in work.signals:
        turn = from_euler([0.0, 0.0, corrections.heading])
        attitude = work.signals["attitude"]
        work.signals["attitude"] = replace(attitude, y=product(turn, attitude.y))
    if corrections.frame is not None and {"attitude", "position"} <= set(work.signals):
        tilt = Tilt(corrections.frame, 0.0, True)
        work.signals = turned_upright(work.signals, tilt)
        report.tilt = (float(tilt.direction[0]), float(tilt.direction[1]))
    for sensor, delay in corrections.delay.items():
        work.delay(sensor, delay)
    if corrections.current is not None:
        work.water(corrections.current)
    # Each is reported, also where the recording has nothing that it could correct.
    present = {channel for signal in signals.values() for channel in signal.channels}
    for key, value in corrections.given.items():
        name = key.partition(".")[2] or "attitude"
        here = key == "current" or _present(name, present, signals)
        report.info("correction given", key, value=value, recorded=here)
        if here:
            report.corrections[key] = value
    return work.signals


def _present(name: str, channels: set[str], signals: Mapping[str, Signal]) -> bool:
    """Whether a sensor, channel or key of a bias is recorded."""
    if name in ("attitude", "frame"):
        return "attitude" in signals
    bare = name
    for end in _UNITS:
        bare = bare.removesuffix(end) if bare.removesuffix(end) in _CHANNELS else bare
    return bool(set(CHANNELS_OF.get(name, (bare,))) & channels)


class _Work:
    """Signals that are changed."""

    def __init__(self, signals: dict[str, Signal]) -> None:
        self.signals = signals

    def channels(self, names: Sequence[str], change: Callable[[Array], Array]) -> None:
        """Change the samples of some channels."""
        for key, signal in self.signals.items():
            columns = [k for k, channel in enumerate(signal.channels) if channel in names]
            if columns and key != "attitude":
                y = signal.y.copy()
                y[:, columns] = change(y[:, columns])
                self.signals[key] = replace(signal, y=y)

    def exchange(self, axes: Mapping[str, tuple[str, float]]) -> None:
        """Give each named channel the samples of the recorded one."""
        for key, signal in list(self.signals.items()):
            entries = {c: entry for c, entry in axes.items() if c in signal.channels and key != "attitude"}
            if not entries:
                continue
            y, bad = signal.y.copy(), signal.bad.copy()
            for channel, (recorded, sign) in entries.items():
                if recorded not in signal.channels:
                    raise TrialError(f"axes.{channel}: {recorded} is not recorded; map its column")
                k, source = signal.channels.index(channel), signal.channels.index(recorded)
                y[:, k], bad[:, k] = sign * signal.y[:, source], signal.bad[:, source]
            self.signals[key] = replace(signal, y=y, bad=bad)

    def turn(self, mounting: Array) -> None:
        """Velocities over ground and through the water from the sensor's axes to the body's."""
        for key in ("velocity", "water velocity"):
            if key not in self.signals:
                continue
            signal = self.signals[key]
            columns = ["uvw".index(channel[0]) for channel in signal.channels]
            whole = np.zeros((len(signal.t), 3))  # a component that is not recorded counts as zero
            whole[:, columns] = signal.y
            self.signals[key] = replace(signal, y=(whole @ mounting.T)[:, columns])

    def water(self, knots: Array) -> None:
        """Give the current at knots (k, 3), time, north and east; held over the whole recording."""
        stamps = [t for signal in self.signals.values() for t in (signal.t[0], signal.t[-1])]
        first, last = min(stamps, default=0.0), max(stamps, default=0.0)
        # Evenly stamped, so that no distance between knots is a gap.
        t = np.linspace(first - 1.0, last + 1.0, max(2, int(last - first) + 1))
        y = np.stack([np.interp(t, knots[:, 0], knots[:, k]) for k in (1, 2)], axis=1)
        self.signals["current"] = Signal("current", ("north", "east"), t, y, np.zeros(y.shape, bool))

    def delay(self, sensor: str, seconds: float) -> None:
        """Stamp a sensor's samples earlier; a velocity through the water is of the instrument over ground."""
        keys = {"velocity": ("velocity", "water velocity"), "water_velocity": ("water velocity",)}
        for key in keys.get(sensor, (sensor,)):
            if sensor == "depth" and "depth" not in self.signals:
                key = "position"
            if key in self.signals:
                self.signals[key] = self.signals[key].earlier(seconds)


_SENSORS = ("velocity", "position", "depth")
"""Sensors that may sit elsewhere than in O: velocity (over ground and through water), position, depth."""


def parse_positions(positions: Mapping[str, Sequence[float]] | None, file: str) -> dict[str, Array]:
    """Positions (3,) in m, body axes from O, by sensor."""
    parsed: dict[str, Array] = {}
    for sensor, position in (positions or {}).items():
        if sensor not in _SENSORS:
            raise TrialError(
                f'{file}: sensor positions: unknown sensor "{sensor}"{nearest(sensor, _SENSORS)}'
            )
        try:
            vector = np.asarray(position, float)
        except (TypeError, ValueError):
            vector = np.zeros(0)
        if vector.shape != (3,) or not np.isfinite(vector).all():
            raise TrialError(
                f"{file}: sensor positions, {sensor}: expected three numbers, m forward, starboard and down"
                f" of O, found {position!r}"
            )
        parsed[sensor] = vector
    return parsed


def refuse_far(positions: Mapping[str, Sequence[float]], length: float | None, where: str) -> None:
    """Refuse positions far outside a hull of this length, m: they are in another unit."""
    for sensor, position in positions.items():
        if length is not None and max(map(abs, position)) > SETTINGS.farthest_lengths * length:
            raise CampaignError(
                f"{where}, key {sensor}_m: expected a position in m, found {list(position)},"
                f" far outside the hull of {length:g} m; check the unit"
            )


def to_origin(
    signals: Mapping[str, Signal], positions: Mapping[str, Array], report: RecordingReport
) -> dict[str, Signal]:
    """The same signals as sensors in O would have shown them; what cannot be brought there is reported."""
    moved = dict(signals)
    for sensor, arm in positions.items():
        names = ("velocity", "water velocity") if sensor == "velocity" else ("position",)
        if sensor == "depth" and "depth" in signals:
            names = ("depth",)  # it has stamps of its own
        needed = "rates" if sensor == "velocity" else "attitude"
        for name in names:
            if name not in signals or not arm.any():
                continue
            if needed not in signals:
                report.warning("lever arm ignored", name, needed=needed)
                continue
            if sensor == "velocity":
                moved[name] = _velocity(moved[name], signals[needed], arm)
            else:
                own = "z" if sensor == "depth" else "xy" if "depth" in positions else "xyz"
                moved[name] = _position(moved[name], signals[needed], arm, own)
            report.info("lever arm", name, sensor=sensor, arm_m=arm.tolist())
    return moved


def _velocity(signal: Signal, rates: Signal, arm: Array) -> Signal:
    """A velocity signal less omega x p; a rate that was not recorded counts as zero."""
    known, valid = linear(rates, signal.t)
    omega = np.zeros((len(signal.t), 3))
    omega[:, ["pqr".index(channel) for channel in rates.channels]] = known
    extra = np.cross(omega, arm)[:, ["uvw".index(channel[0]) for channel in signal.channels]]
    unknown = ~np.logical_and.reduce(valid, axis=1)
    return replace(signal.masked(np.asarray(unknown)), y=signal.y - extra)


def _position(signal: Signal, attitude: Signal, arm: Array, own: str) -> Signal:
    """A position signal less R p in the coordinates `own` of its sensor."""
    q, valid = linear(attitude, signal.t)
    shift = matrix(q) @ arm
    y, bad = signal.y.copy(), signal.bad.copy()
    for k, channel in enumerate(signal.channels):
        if channel in own:
            y[:, k] -= shift[:, "xyz".index(channel)]
            bad[:, k] |= ~valid[:, 0]
    return replace(signal, y=y, bad=bad)
