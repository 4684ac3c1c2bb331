"""Parameter files of ArduPilot: read, compared, written with what changes, and what they say of the motors.

Three spellings are read: ``NAME,VALUE`` (Mission Planner), ``NAME VALUE`` (MAVProxy) and QGroundControl's
columns ``SYSTEM COMPONENT NAME VALUE TYPE``; ``#`` begins a comment. A file belongs to the generation of
firmware whose names it uses: ArduSub 3.5, 4.0 to 4.6, and 4.7 and later name the position controllers
differently, and 4.7 counts in metres and degrees where those before counted in hundredths.

ArduSub sends motor n the pulse ``1500 + d_n (end - 1500) clip(sum of factor times demand)`` on the channel
whose SERVOn_FUNCTION is the motor's (33 to 40 for motors 1 to 8, 82 to 85 for 9 to 12), d_n =
MOT_n_DIRECTION, ends MOT_PWM_MIN and MOT_PWM_MAX. A pulse above neutral must therefore push along ``d_n``
times the factors of the frame: forward, lateral, up, and the moments about them. SERVOn_MIN, _MAX, _TRIM and
_REVERSED count for channels of other functions only; motors are written as pulses. Facts of ArduPilot
(AP_Motors6DOF and SRV_Channel), factors by `seatrial.trial.columns.FRAMES`. Held by
``tests/ardusub/test_parameters.py`` and ``tests/ardusub/test_servos.py``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from seatrial._core import Vehicle
from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError, nearest, reason
from seatrial.base.files import write_atomic, writing
from seatrial.base.report import Column, Table
from seatrial.trial.columns import FRAME_NAMES, FRAMES

GENERATIONS: Mapping[str, tuple[str, ...]] = {
    title: tuple(names.split())
    for title, names in {
        "3.5": "POS_Z_P VEL_Z_P ACCEL_Z_P ACCEL_Z_I ATC_RAT_RLL_FILT ATC_RAT_YAW_FILT POS_XY_P",
        "4.0 to 4.6": "PSC_POSZ_P PSC_VELZ_P PSC_ACCZ_P PSC_ACCZ_I PSC_POSXY_P PSC_VELXY_P",
        "4.7 and later": "PSC_D_POS_P PSC_D_VEL_P PSC_D_ACC_P PSC_NE_POS_P PSC_NE_VEL_P ATC_ANGLE_MAX"
        " ATC_ACC_Y_MAX ATC_RATE_WPY_MAX",
    }.items()
}
"""Names that only one generation of ArduSub has."""

_BEFORE_4_7 = ("ANGLE_MAX", "ATC_ACCEL_R_MAX", "ATC_ACCEL_P_MAX", "ATC_ACCEL_Y_MAX", "ATC_SLEW_YAW")
"""Names that all generations before 4.7 have."""

_SINCE_4_7: Mapping[str, tuple[str, float]] = {
    # Since 4.7 lengths count in metres and angles in degrees, hundredths of them before.
    **{
        f"PSC_{old}_{term}": (f"PSC_{new}_{term}", factor)
        for old, new, factors in (
            ("POSZ", "D_POS", {"P": 1.0}),
            ("VELZ", "D_VEL", {**dict.fromkeys(("P", "I", "D", "FF", "FLTE", "FLTD"), 1.0), "IMAX": 0.01}),
            ("ACCZ", "D_ACC", {**dict.fromkeys(("P", "I", "D", "FF"), 0.1), "IMAX": 0.001}),
            ("ACCZ", "D_ACC", dict.fromkeys(("FLTT", "FLTE", "FLTD"), 1.0)),
            ("POSXY", "NE_POS", {"P": 1.0}),
            ("VELXY", "NE_VEL", {**dict.fromkeys(("P", "I", "D", "FF", "FLTE", "FLTD"), 1.0), "IMAX": 0.01}),
        )
        for term, factor in factors.items()
    },
    "ANGLE_MAX": ("ATC_ANGLE_MAX", 0.01),
    "ATC_ACCEL_R_MAX": ("ATC_ACC_R_MAX", 0.01),
    "ATC_ACCEL_P_MAX": ("ATC_ACC_P_MAX", 0.01),
    "ATC_ACCEL_Y_MAX": ("ATC_ACC_Y_MAX", 0.01),
    "ATC_SLEW_YAW": ("ATC_RATE_WPY_MAX", 0.01),
}
"""Name since 4.7 and factor of the value, by the name of 4.0 to 4.6."""

_NAME = re.compile(r"[A-Z][A-Z0-9_]{0,15}")

_LARGEST = 2_000_000  # bytes: a vehicle has some thousand parameters


@dataclass(frozen=True)
class Change:
    """A parameter that changes."""

    name: str
    #: `before`, `after`: NaN where the other file does not have it.
    before: float
    after: float
    why: str = ""  #: A sentence; empty without one.
    bounds: tuple[float, float] | None = None  #: Within which it was sought; None where it was not.


@dataclass(frozen=True)
class ParameterFile:
    """Parameters by name, and where they come from."""

    source: str
    values: Mapping[str, float]

    @classmethod
    def load(cls, path: str | Path) -> ParameterFile:
        """Parameters of a file.

        Raises
        ------
        TrialError
            It cannot be read, or a row is no parameter.
        """
        try:
            content = Path(path).read_bytes()
        except OSError as error:
            raise TrialError(f"{path}: cannot be read ({reason(error)}); give a .param file") from None
        if len(content) > _LARGEST:
            raise TrialError(
                f"{path}: expected a parameter file of at most {_LARGEST / 1e6:g} MB, found"
                f" {len(content) / 1e6:.1f} MB; is it a log?"
            )
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise TrialError(
                f"{path}: expected text, found other bytes at {error.start}; give a .param file"
            ) from None
        return cls.of_text(text, str(path))

    @classmethod
    def of_text(cls, text: str, source: str) -> ParameterFile:
        """Parameters of a text; see `load`."""
        values: dict[str, float] = {}
        for number, line in enumerate(text.splitlines(), 1):
            row = line.partition("#")[0].strip()
            if not row:
                continue
            cells = [cell for cell in re.split(r"[,\s]+", row) if cell]
            if len(cells) >= 4 and cells[0].isdecimal() and cells[1].isdecimal():
                cells = cells[2:4]  # QGroundControl
            if len(cells) != 2 or not _NAME.fullmatch(cells[0]):
                raise TrialError(
                    f"{source}: row {number}: expected NAME,VALUE with a name of capitals, digits and _ up to"
                    f" 16 letters, found {line.strip()[:60]!r}"
                )
            try:
                value = float(cells[1])
            except ValueError:
                value = math.nan
            if not math.isfinite(value):
                raise TrialError(
                    f"{source}: row {number}: {cells[0]}: expected a finite number, found {cells[1][:30]!r}"
                )
            # The same value twice says nothing wrong.
            if values.get(cells[0], value) != value:
                raise TrialError(
                    f"{source}: row {number}: {cells[0]} stands there twice, with {values[cells[0]]:g} and"
                    f" {value:g}; leave one of them"
                )
            values[cells[0]] = value
        if not values:
            raise TrialError(f"{source}: expected parameters as NAME,VALUE, found none")
        return cls(source, values)


def generation(names: Iterable[str], source: str = "parameters") -> str:
    """Generation of ArduSub that has these names; empty where they are of all of them.

    Raises `TrialError`: they are of more than one.

    Examples
    --------
    >>> generation(["ATC_RAT_RLL_P", "PSC_ACCZ_P"]), generation(["ATC_RAT_RLL_P"])
    ('4.0 to 4.6', '')
    """
    own = set(names)
    names_by_title = {
        title: sorted(own & set(only)) for title, only in GENERATIONS.items() if own & set(only)
    }
    # Names of before 4.7 tell 4.0 to 4.6, unless 3.5 is told by others.
    if (older := sorted(own & set(_BEFORE_4_7))) and "3.5" not in names_by_title:
        names_by_title["4.0 to 4.6"] = sorted({*names_by_title.get("4.0 to 4.6", ()), *older})
    if len(names_by_title) > 1:
        mixed = "; ".join(f"{', '.join(only)} of {title}" for title, only in names_by_title.items())
        raise TrialError(
            f"{source}: expected parameters of one generation of ArduSub, found {mixed}; take the file that"
            " the vehicle's own firmware writes"
        )
    return next(iter(names_by_title), "")


def in_metres(file: ParameterFile) -> dict[str, float]:
    """Parameters by the names and in the units of 4.7 and later, whichever of 4.0 and later they are of.

    Examples
    --------
    >>> in_metres(ParameterFile("old.param", {"PSC_ACCZ_P": 0.5, "ATC_RAT_YAW_P": 0.18}))
    {'PSC_D_ACC_P': 0.05, 'ATC_RAT_YAW_P': 0.18}
    """
    renamed = ((*_SINCE_4_7.get(name, (name, 1.0)), value) for name, value in file.values.items())
    return {name: value * factor for name, factor, value in renamed}


def of_generation(change: Change, title: str) -> Change:
    """A change of 4.7 and later by the name and in the unit of the generation `title`.

    Examples
    --------
    >>> of_generation(Change("PSC_D_ACC_P", 0.05, 0.08), "4.0 to 4.6")
    Change(name='PSC_ACCZ_P', before=0.5, after=0.8, why='', bounds=None)
    """
    older = {new: (old, factor) for old, (new, factor) in _SINCE_4_7.items()}
    if title != "4.0 to 4.6" or change.name not in older:
        return change
    name, factor = older[change.name]

    def turned(value: float) -> float:
        return float(f"{value / factor:.9g}")

    bounds = None if change.bounds is None else (turned(change.bounds[0]), turned(change.bounds[1]))
    return Change(name, turned(change.before), turned(change.after), change.why, bounds)


def changes(before: ParameterFile, after: ParameterFile) -> tuple[Change, ...]:
    """What differs between two files, by name.

    Raises
    ------
    TrialError
        They are of different generations of firmware.
    """
    first, second = generation(before.values, before.source), generation(after.values, after.source)
    if first and second and first != second:
        raise TrialError(
            f"{before.source} is of ArduSub {first}, {after.source} of {second}: names and units differ;"
            " compare files of one generation"
        )
    names = sorted({*before.values, *after.values})
    every = (Change(n, before.values.get(n, math.nan), after.values.get(n, math.nan)) for n in names)
    return tuple(change for change in every if change.before != change.after)


def write_changes(path: str | Path, changed: Iterable[Change], *, title: str) -> None:
    """Write a parameter file with what changes only; value before, bounds and reason stand above each.

    Raises
    ------
    TrialError
        The file cannot be written; what was there before is still there.
    """
    target = Path(path)
    with writing(path, TrialError, advice="choose another folder"):
        write_atomic(target, changes_text(changed, title=title).encode())


def changes_text(changed: Iterable[Change], *, title: str) -> str:
    """Text of a parameter file with what changes only, see `write_changes`."""
    lines = [f"# {title}"]
    for change in changed:
        if math.isnan(change.after):
            continue
        remarks = [] if math.isnan(change.before) else [f"before {change.before:.7g}"]
        remarks += [] if change.bounds is None else [f"within {change.bounds[0]:g} to {change.bounds[1]:g}"]
        remarks += [change.why] if change.why else []
        lines += [f"# {'; '.join(remarks)}"] if remarks else []
        lines.append(f"{change.name},{change.after:.9g}")
    return "\n".join(lines) + "\n"


_MOTOR_FUNCTIONS = {33 + k: k + 1 for k in range(8)} | {82 + k: k + 9 for k in range(4)}  # SERVOn_FUNCTION
_NEUTRAL_US, _LOWEST_US, _HIGHEST_US = 1500.0, 1100.0, 1900.0  # ArduSub's defaults
_CHANNELS = 32  # of ArduPilot

_ABOUT_MOTORS = re.compile(r"FRAME_CONFIG|MOT_.*|SERVO\d+_.*|RCMAP_.*|JS_.*GAIN.*|SERVO_.*")


@dataclass(frozen=True)
class Channel:
    """From a servo channel to the command of an actuator."""

    actuator: str  #: Its name.
    number: int  #: Of the channel, from 1.
    #: `neutral`, `ahead`, `astern`: of the actuator's command, in its own unit: at rest, and how far it goes
    #: in each direction.
    neutral: float
    ahead: float
    astern: float
    #: `trim_us`, `low_us`, `high_us`: pulse at rest and at the ends.
    trim_us: float = _NEUTRAL_US
    low_us: float = _LOWEST_US
    high_us: float = _HIGHEST_US
    reversed: bool = False  #: Whether a longer pulse means less.
    direct: bool = True  #: Whether the command is the pulse width itself.

    def command(self, pulse_us: float) -> float:
        """Command in the unit of the actuator; neutral where no pulse is sent (0).

        Examples
        --------
        >>> Channel("rudder", 5, 0.0, 0.4, 0.4, direct=False).command(1700.0)
        0.2
        """
        if pulse_us <= 0.0:
            return self.neutral
        away = pulse_us - self.trim_us
        if self.direct:
            return self.neutral + (-away if self.reversed else away)
        span = self.high_us - self.trim_us if away > 0.0 else self.trim_us - self.low_us
        share = min(1.0, max(-1.0, away / span))
        share = -share if self.reversed else share
        return self.neutral + share * (self.ahead if share > 0.0 else self.astern)


@dataclass(frozen=True)
class ChannelMap:
    """A vehicle under the parameters of an autopilot."""

    vehicle: Vehicle  #: With the directions of its thrusters by the parameters.
    channels: tuple[Channel, ...]  #: One per actuator.
    turned: tuple[str, ...] = ()  #: Thrusters whose direction differs from that of the vehicle file.
    sentences: tuple[str, ...] = ()  #: What was mapped, and what not.

    def table(self) -> Table:
        """Channels and actuators, and where a longer pulse pushes."""
        info = self.vehicle.actuator_info()
        rows = []
        for channel in self.channels:
            facts = info[channel.actuator]
            push = np.asarray(facts["wrench"], float)
            push = -push if facts["reversed"] != channel.reversed else push
            # Below a twentieth of the largest a component is not worth a word; a fin at rest has none.
            words = (
                _words(np.where(np.abs(push) < 0.05 * np.abs(push).max(), 0.0, push)) if push.any() else ""
            )
            turned = channel.actuator in self.turned
            direction = "turned by the parameters" if turned else "as in the vehicle file"
            rows.append([channel.actuator, str(channel.number), words, direction])
        text = (Column(name, align="left") for name in ("actuator", "a longer pulse pushes", "direction"))
        actuator, pushes, direction_head = text
        return Table.of("", (actuator, Column("channel"), pushes, direction_head), rows)


def map_channels(vehicle: Vehicle, numbers: Mapping[str, int] | None = None) -> ChannelMap:
    """Channels of a vehicle without a parameter file: actuators in their order from channel 1 on.

    Parameters
    ----------
    vehicle : Vehicle
    numbers : mapping of str to int, optional
        Channel by actuator where it is another.

    Raises
    ------
    TrialError
        An actuator or a channel does not exist, or a channel is given twice.

    Examples
    --------
    >>> import seatrial as st
    >>> [one.number for one in map_channels(st.Vehicle.load("bluerov2-heavy")).channels][:3]
    [1, 2, 3]
    """
    given = dict(numbers or {})
    info = vehicle.actuator_info()
    for name, number in given.items():
        if name not in info:
            raise TrialError(f"channel {name}={number}: unknown actuator{nearest(name, info)}")
        if not 1 <= number <= _CHANNELS:
            raise TrialError(f"channel {name}={number}: expected a channel from 1 to {_CHANNELS}")
    channels = [_channel(name, given.get(name, k), info[name]) for k, name in enumerate(vehicle.actuators, 1)]
    _refuse_twice(channels)
    return ChannelMap(vehicle, tuple(channels))


def map_parameters(
    vehicle: Vehicle, parameters: ParameterFile, numbers: Mapping[str, int] | None = None
) -> ChannelMap:
    """Vehicle whose thrusters push as the parameters of ArduSub say, with its channels.

    Motor n of the frame is the n-th actuator of the vehicle. Where a pulse above neutral would push against
    what frame and MOT_n_DIRECTION say, the thruster is turned, as one does who sets the directions aboard.

    Parameters
    ----------
    vehicle : Vehicle
    parameters : ParameterFile
    numbers : mapping of str to int, optional
        Channel by actuator instead of that of the parameters.

    Raises
    ------
    TrialError
        A value of FRAME_CONFIG, MOT_n_DIRECTION or SERVOn_FUNCTION is none of ArduSub's, the vehicle has
        fewer actuators than the frame motors, or a motor has two channels.

    Examples
    --------
    >>> import seatrial as st
    >>> file = ParameterFile("old.param", {"FRAME_CONFIG": 2.0, "MOT_1_DIRECTION": -1.0})
    >>> map_parameters(st.Vehicle.load("bluerov2-heavy"), file).turned[:2]
    ('thruster_2', 'thruster_3')
    """
    values, where = parameters.values, parameters.source
    base = map_channels(vehicle, numbers)
    used: set[str] = set()
    remarks: list[str] = []
    by_motor = _motor_channels(values, where, used)
    channels = []
    # A channel that the user named outweighs the file's.
    for motor, channel in enumerate(base.channels, 1):
        named = channel.actuator in (numbers or {})
        number = channel.number if named else by_motor.get(motor, channel.number)
        is_motor = number not in _other_functions(values)
        channels.append(_with_ends(replace(channel, number=number), values, used, where, motor=is_motor))
    _refuse_twice(channels)
    turned = _turned(vehicle, values, where, used, remarks)
    remarks += _neutral_sentences(channels)
    # Nothing is dropped silently: each parameter is used, named or counted.
    about = sorted(name for name in values if _ABOUT_MOTORS.fullmatch(name))
    left = [name for name in about if name not in used]
    if left:
        remarks.append(f"Not mapped, because no actuator of the vehicle goes by it: {_some(left)}.")
    rest = len(values) - len(about)
    if rest:
        others = f"{rest} other parameters are" if rest > 1 else "One other parameter is"
        remarks.append(f"{others} the autopilot's own (gains, filters, failsafes).")
    return ChannelMap(_with_turned(vehicle, turned, where), tuple(channels), tuple(turned), tuple(remarks))


def _channel(name: str, number: int, facts: Mapping[str, Any]) -> Channel:
    neutral, ahead, astern = (float(facts[key]) for key in ("neutral", "maximum_ahead", "maximum_astern"))
    return Channel(name, number, neutral, ahead, astern, direct=facts["unit"] == "us")


def _refuse_twice(channels: list[Channel]) -> None:
    owner: dict[int, str] = {}
    for channel in channels:
        if channel.number in owner:
            raise TrialError(
                f"channel {channel.number}: both {owner[channel.number]} and {channel.actuator} are on it;"
                " give one of them another channel"
            )
        owner[channel.number] = channel.actuator


def _whole(values: Mapping[str, float], name: str, where: str, allowed: Any, words: str) -> int:
    value = values[name]
    if value != int(value) or int(value) not in allowed:
        raise TrialError(f"{where}: {name}: expected {words}, found {value:g}")
    return int(value)


def _motor_channels(values: Mapping[str, float], where: str, used: set[str]) -> dict[int, int]:
    """Channel by motor number, as SERVOn_FUNCTION says."""
    channel_by_motor: dict[int, int] = {}
    for number in range(1, _CHANNELS + 1):
        name = f"SERVO{number}_FUNCTION"
        if name not in values:
            continue
        function = _whole(values, name, where, range(-1, 1000), "the number of a function")
        motor = _MOTOR_FUNCTIONS.get(function)
        if motor is None:
            continue
        used.add(name)
        if motor in channel_by_motor:
            raise TrialError(
                f"{where}: {name}: motor {motor} is on channel {channel_by_motor[motor]}, too; leave it on"
                " one channel"
            )
        channel_by_motor[motor] = number
    return channel_by_motor


def _other_functions(values: Mapping[str, float]) -> set[int]:
    """Channels that have a function other than a motor's."""
    return {
        number
        for number in range(1, _CHANNELS + 1)
        if values.get(f"SERVO{number}_FUNCTION", 33.0) not in _MOTOR_FUNCTIONS
    }


def _with_ends(
    channel: Channel, values: Mapping[str, float], used: set[str], where: str, *, motor: bool
) -> Channel:
    """The channel with the ends of its pulses by the parameters."""
    if motor:
        names = {"low_us": "MOT_PWM_MIN", "high_us": "MOT_PWM_MAX"}
    else:
        prefix = f"SERVO{channel.number}_"
        names = {"low_us": f"{prefix}MIN", "high_us": f"{prefix}MAX", "trim_us": f"{prefix}TRIM"}
        if f"{prefix}REVERSED" in values:
            used.add(f"{prefix}REVERSED")
            channel = replace(channel, reversed=values[f"{prefix}REVERSED"] != 0.0)
    ends = {"low_us": channel.low_us, "trim_us": channel.trim_us, "high_us": channel.high_us}
    for field, name in names.items():
        if values.get(name, 0.0) > 0.0:
            used.add(name)
            ends[field] = values[name]
    low, trim, high = (ends[field] for field in ("low_us", "trim_us", "high_us"))
    if not low < trim < high:
        raise TrialError(
            f"{where}: channel {channel.number}: expected rest between the ends, found {low:g}, {trim:g} and"
            f" {high:g} us; correct {', '.join(names.values())}"
        )
    return replace(channel, low_us=low, trim_us=trim, high_us=high)


def _turned(
    vehicle: Vehicle, values: Mapping[str, float], where: str, used: set[str], remarks: list[str]
) -> list[str]:
    """Thrusters that push against what the frame and the directions say."""
    if "FRAME_CONFIG" not in values:
        remarks.append("The file has no FRAME_CONFIG: directions stay those of the vehicle file.")
        return []
    number = _whole(values, "FRAME_CONFIG", where, range(8), "0 to 7")
    used.add("FRAME_CONFIG")
    if number >= len(FRAME_NAMES):
        remarks.append(
            "FRAME_CONFIG 7 is a custom frame: its factors are in the firmware, so that directions stay those"
            " of the vehicle file."
        )
        return []
    frame = FRAME_NAMES[number]
    factors = FRAMES[frame]
    info = vehicle.actuator_info()
    names = vehicle.actuators
    if len(names) < len(factors):
        raise TrialError(
            f"{where}: FRAME_CONFIG {number} ({frame}) has {len(factors)} motors, vehicle {vehicle.name} has"
            f" {len(names)} actuators; take the vehicle of this frame or correct FRAME_CONFIG"
        )
    turned = []
    for name, (key, factor) in zip(names, factors.items(), strict=False):
        direction, parameter = 1, f"MOT_{key}_DIRECTION"
        if parameter in values:
            direction = _whole(values, parameter, where, (-1, 1), "1 or -1")
            used.add(parameter)
        facts = info[name]
        push = np.asarray(facts["wrench"], float) * (-1.0 if facts["reversed"] else 1.0)
        # Only along or against is a direction; anything between means another frame or order.
        fit = _cosine(push, direction * _push(factor), names, info)
        if abs(fit) < 0.5:  # the least cosine between both pushes that counts as the same motor
            remarks.append(
                f"{name}: motor {key} of {frame} pushes elsewhere (cosine {fit:.2f}); its direction stays"
                " that of the vehicle file: check FRAME_CONFIG and the order of the thrusters."
            )
        elif fit < 0.0:
            turned.append(name)
    if turned:
        remarks.append(
            f"By FRAME_CONFIG {number} ({frame}) and MOT_n_DIRECTION a pulse above 1500 us pushes against the"
            f" direction of the vehicle file: {_some(turned)} turned."
        )
    if len(names) > len(factors):
        remarks.append(f"{_some(names[len(factors) :])}: {frame} has no motor for them.")
    return turned


def _push(factor: tuple[float, ...]) -> Array:
    """Wrench that factors of roll, pitch, yaw, throttle, forward and lateral ask for, X Y Z K M N."""
    roll, pitch, yaw, throttle, forward, lateral = factor
    return np.array([forward, lateral, -throttle, roll, pitch, yaw], float)


def _cosine(push: Array, asked: Array, names: list[str], info: Mapping[str, Any]) -> float:
    """How far a push is that which is asked, -1 to 1; moments counted by the longest lever of the vehicle."""
    lever = max((float(np.linalg.norm(info[name]["position"])) for name in names), default=1.0) or 1.0
    # Only components that the frame's factors name: a horizontal thruster below O rolls as well.
    kept = asked != 0.0
    scaled = np.where(kept, push / np.array([1.0, 1.0, 1.0, lever, lever, lever]), 0.0)
    size = float(np.linalg.norm(scaled) * np.linalg.norm(asked))
    return float(scaled @ asked) / size if size > 0.0 else 0.0


_DIRECTIONS = (("ahead", "astern"), ("to starboard", "to port"), ("down", "up"))


def _words(push: Array) -> str:
    parts = [
        ways[0 if value > 0.0 else 1] for ways, value in zip(_DIRECTIONS, push[:3], strict=True) if value
    ]
    return " and ".join(parts) or "by a moment alone"


def _neutral_sentences(channels: list[Channel]) -> list[str]:
    odd = [channel for channel in channels if channel.direct and channel.neutral != channel.trim_us]
    if not odd:
        return []
    return [
        f"ArduSub rests at {odd[0].trim_us:g} us, {_some([channel.actuator for channel in odd])} of the"
        f" vehicle file at {odd[0].neutral:g} us: pulses are counted from each one's own rest."
    ]


def _with_turned(vehicle: Vehicle, turned: list[str], where: str) -> Vehicle:
    if not turned:
        return vehicle
    document = tomlkit.parse(vehicle.to_toml())
    thrusters: Any = document["thrusters"]
    for thruster in thrusters:
        if thruster["name"] in turned:
            thruster["reversed"] = not thruster.get("reversed", False)
    return Vehicle.from_toml(tomlkit.dumps(document), f"{vehicle.name} with {where}")


def _some(names: list[str], most: int = 12) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
