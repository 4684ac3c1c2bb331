"""What was found about a sensor as corrections: key, value, deviation, effect and a sentence."""

from __future__ import annotations

from typing import Any

import numpy as np

from seatrial.base.channels import DEGREE
from seatrial.inspect.consistency_result import Correction
from seatrial.inspect.consistency_sensors import Found
from seatrial.trial.kinematic_axes import pressure_of
from seatrial.trial.kinematic_fit import Fit
from seatrial.trial.kinematics import Channels
from seatrial.trial.signals import INPUTS

_CERTAIN = 5.0  # deviations from which a correction is proposed

_LEAST_S = 0.015  # a smaller delay is not proposed

_UNCERTAIN_S = 0.1  # deviation of a clock's offset that is worth a word

_OPPOSED, _OPPOSED_M_S = 0.2, 0.1  # of the speed, and m/s: a smaller difference may be noise

_MATERIAL = 0.03  # share of the residual that a delay must take away: a lever arm may look like a small one

_SENSOR = {"rates": "the gyro", "specific force": "the accelerometer"}


def corrections_of(sensor: Found, channels: Channels, mounting_yaw: bool = False) -> list[Correction]:
    """Corrections of one sensor; a heading is its mounting's where `mounting_yaw`."""
    made = [*_units(sensor), *_axes(sensor)]
    if sensor.fit is not None:
        made += _timing(sensor, sensor.fit, channels)
        made += _mounting(sensor, sensor.fit, mounting_yaw)
        made += _amplitudes(sensor, sensor.fit)
    return made


def _units(sensor: Found) -> list[Correction]:
    before, after = sensor.sizes
    return [
        Correction(
            "corrections",
            f"scale.{_word(group)}",
            factor,
            0.0,
            "",
            before,
            after,
            sensor.of,
            f"the log has {group} in {unit}: {1.0 / factor:.4g} times as large as the motion says",
        )
        for group, (unit, factor) in sensor.unit.items()
    ]


def _axes(sensor: Found) -> list[Correction]:
    if sensor.assignment is None or not sensor.assignment.changed:
        return []
    before, after = sensor.sizes
    changed = sensor.assignment.changed
    follows = sensor.assignment.follows
    made = []
    for name, (recorded, sign) in changed.items():
        own = follows.get(name)
        shown = f" ({own})" if own is not None and own.moves else ""
        weak = "" if own is None or own.reversed or recorded != name else ", which is no certain sign of it"
        if recorded == name:
            sentence = f"{name} has the opposite sign of the motion{shown}{weak}"
            made.append(
                Correction("corrections", f"signs.{name}", -1, 0, "", before, after, sensor.of, sentence)
            )
        else:
            word = "minus " if sign < 0.0 else ""
            sentence = f"{name} is recorded as {word}{recorded}{shown}: axes are exchanged"
            entry = ("-" if sign < 0.0 else "") + recorded
            made.append(
                Correction("corrections", f"axes.{name}", entry, 0, "", before, after, sensor.of, sentence)
            )
    return made


def _timing(sensor: Found, fit: Fit, channels: Channels) -> list[Correction]:
    made = []
    for name in fit.names:
        kind, _, group = name.partition(".")
        if kind != "delay":
            continue
        own, reference = channels.clock(group), channels.clock("attitude")
        drift = f"drift.{group}"
        if own == reference:
            made += _delay(sensor, fit, name, group)
            continue
        value, sd = fit.values[name], fit.sd[name]
        if drift in fit.values:
            value, sd = _at_zero(fit, name, drift, sensor.middle)
        if abs(value) > max(_CERTAIN * sd, _LEAST_S):
            made.append(
                Correction(
                    "clocks",
                    f"{own}.offset_s",
                    round(value, 5),
                    sd,
                    "s",
                    fit.alone[name],
                    fit.after,
                    sensor.of,
                    f"the clock of {own} reads {value:.3f} s (+/- {sd:.3f} s) at time zero of"
                    f" {reference or 'the attitude'}: its offset and the delay of its {group} sensor, which"
                    " appear only as this sum",
                    _word(group),
                )
            )
    for name in fit.names:
        kind, _, group = name.partition(".")
        if kind == "drift":
            rate, sd = fit.values[name], fit.sd[name]
            own = channels.clock(group)
            span = 2.0 * abs(sensor.middle - _start(channels, group))
            made.append(
                Correction(
                    "clocks",
                    f"{own}.drift",
                    float(f"{rate:.4g}"),
                    sd,
                    "",
                    fit.alone[name],
                    fit.after,
                    sensor.of,
                    f"the clock of {own} runs {1e6 * rate:.1f}e-6 (+/- {1e6 * sd:.1f}e-6) fast,"
                    f" {abs(rate) * span:.3f} s over the log",
                    _word(group),
                )
            )
    return made


def _start(channels: Channels, group: str) -> float:
    return min(
        float(curve.t[0])
        for name, curve in channels.curves.items()
        if not name.startswith(INPUTS) and channels.group(name) == group
    )


def _at_zero(fit: Fit, delay: str, drift: str, middle: float) -> tuple[float, float]:
    """Offset of a clock at time zero, s, and its deviation, from delay in the middle and drift."""
    i, j = fit.names.index(delay), fit.names.index(drift)
    row = np.zeros(len(fit.names))
    row[i], row[j] = 1.0, -middle
    return fit.values[delay] - middle * fit.values[drift], float(np.sqrt(row @ fit.covariance @ row))


def _delay(sensor: Found, fit: Fit, name: str, group: str) -> list[Correction]:
    value, sd = fit.values[name], fit.sd[name]
    if abs(value) < max(_CERTAIN * sd, _LEAST_S) or fit.after > (1.0 - _MATERIAL) * fit.alone[name]:
        return []
    word = "late" if value > 0.0 else "early"
    label = _SENSOR.get(group, f"the {group}")
    sentence = f"{label} is {abs(value):.3f} s (+/- {sd:.3f} s) {word} against the attitude"
    return [_simple(sensor, fit, name, f"delay_s.{_word(group)}", round(value, 4), sd, "s", sentence)]


def _mounting(sensor: Found, fit: Fit, mounting_yaw: bool) -> list[Correction]:
    made: list[Correction] = []
    tilts = ["tilt.roll", "tilt.pitch", "heading" if mounting_yaw else "tilt.yaw"]
    given = [name for name in tilts if name in fit.values]
    if given:
        angles = [fit.values.get(name, 0.0) / DEGREE for name in tilts]
        sds = [fit.sd.get(name, 0.0) / DEGREE for name in tilts]
        words = {"tilt.roll": "roll", "tilt.pitch": "pitch", "tilt.yaw": "yaw", "heading": "yaw"}
        parts = " and ".join(
            f"{fit.values[name] / DEGREE:+.2f} deg (+/- {fit.sd[name] / DEGREE:.2f} deg) in {words[name]}"
            for name in given
        )
        sentence = f"the velocity sensor is turned by {parts}; an offset of the attitude looks alike"
        worst = max(given, key=fit.alone.__getitem__)
        value = [round(angle, 3) for angle in angles]
        made.append(_simple(sensor, fit, worst, "tilt_deg.velocity", value, sds, "deg", sentence))
    if "heading" in fit.values and not mounting_yaw:
        value_deg, sd = fit.values["heading"] / DEGREE, fit.sd["heading"] / DEGREE
        sentence = (
            f"the heading of the attitude is {-value_deg:+.1f} deg (+/- {sd:.1f} deg) off the position's"
            " frame: add the difference to the yaw"
        )
        made.append(_simple(sensor, fit, "heading", "heading_deg", round(value_deg, 2), sd, "deg", sentence))
    arm = [f"arm.{axis}" for axis in "xyz"]
    if any(name in fit.values for name in arm):
        values = [round(fit.values.get(name, 0.0), 3) for name in arm]
        sds = [fit.sd.get(name, 0.0) for name in arm]
        before = max(fit.alone[name] for name in arm if name in fit.values)
        sentence = (
            f"the velocity sensor sits at ({', '.join(f'{x:.2f}' for x in values)}) m from O, as its velocity"
            " in turns shows"
        )
        made.append(
            Correction("places", "velocity_m", values, sds, "m", before, fit.after, sensor.of, sentence)
        )
    return made


def _simple(
    sensor: Found, fit: Fit, name: str, key: str, value: Any, sd: Any, unit: str, sentence: str
) -> Correction:
    """A correction in the campaign, whose effect is measured on what stays without the parameter `name`."""
    return Correction("corrections", key, value, sd, unit, fit.alone[name], fit.after, sensor.of, sentence)


def _amplitudes(sensor: Found, fit: Fit) -> list[Correction]:
    made = []
    for name in fit.names:
        kind, _, channel = name.partition(".")
        value, sd = fit.values[name], fit.sd[name]
        if kind == "scale" and _is_scale(value):
            off = 100.0 * (1.0 / (1.0 + value) - 1.0)
            sentence = f"{channel} is {off:+.1f} % (+/- {100.0 * sd:.1f} %) off in scale"
            known = sensor.unit.get(channel if channel == "velocity" else sensor.group)
            factor = (1.0 + value) * (known[1] if known and channel == "velocity" else 1.0)
            made.append(
                _simple(sensor, fit, name, f"scale.{channel}", float(f"{factor:.5g}"), sd, "", sentence)
            )
        elif kind == "bias" and channel != "w":
            degrees = channel in "pqr"
            factor, unit = (1.0 / DEGREE, "deg/s") if degrees else (1.0, "m/s^2")
            key = f"bias.{channel}_deg_s" if degrees else f"bias.{channel}_m_s2"
            sentence = f"{channel} is off by {value * factor:+.3g} {unit} (+/- {sd * factor:.2g} {unit})"
            made.append(
                _simple(sensor, fit, name, key, float(f"{value * factor:.4g}"), sd * factor, unit, sentence)
            )
    return made


def offset_sentence(sensor: Found, channels: Channels) -> str | None:
    """What is known of the offset of a clock that is too uncertain to be proposed; None where it is not."""
    key = f"delay.{sensor.group}"
    if not sensor.other_clock or sensor.fit is None or key not in sensor.fit.values:
        return None
    value, sd = sensor.fit.values[key], sensor.fit.sd[key]
    if sd < _UNCERTAIN_S or abs(value) > _CERTAIN * sd:
        return None
    return (
        f"the clock of {channels.clock(sensor.group)} reads {value:.1f} s (+/- {sd:.1f} s) against that of"
        " the attitude: too uncertain to be proposed. Take the offset from an event that both files show and"
        " give it under [clocks] in map.toml"
    )


def contradiction_of(sensor: Found) -> str | None:
    """What contradicts the motion that the other channels show, the side that no vehicle can have first."""
    return _too_still(sensor) or _astray(sensor) or _unlike(sensor) or _opposed(sensor)


def _too_still(sensor: Found) -> str | None:
    """A position or depth that moves less than its noise while the velocity says that it moves."""
    if sensor.group != "velocity" or sensor.fit is not None or not sensor.still:
        return None
    pose = sensor.of.removeprefix("rates of ").removeprefix("rate of ").partition(" and the velocity")[0]
    ratio = sensor.shown / max(sensor.motion, 1e-300)
    sentence = (
        f"{pose}: moves by {sensor.motion:.2g} m/s rms where velocity and attitude say {sensor.shown:.2g}"
        f" m/s, {ratio:.3g} times as much, so the unit of the {pose} is wrong, or its sensor is stuck"
    )
    if pose == "depth" and (pressure := pressure_of(ratio)) is not None:
        sentence += f"; a pressure in {pressure} that is read as Pa would do that"
    return f"{sentence}; check it in map.toml or the campaign"


def _astray(sensor: Found) -> str | None:
    """Rates that the attitude has and the gyro does not show, whatever is exchanged; None without any."""
    if sensor.group != "rates" or sensor.assignment is None or sensor.assignment.changed:
        return None
    astray = [
        f"{name} ({own})"
        for name, own in sensor.assignment.follows.items()
        if name in sensor.assignment.contradicted
    ]
    if not astray:
        return None
    return (
        f"the gyro does not show {' and '.join(astray)} of the attitude, and no exchange of axes or reversed"
        " sign explains it; check in map.toml the columns and frames of both, and a quaternion's order"
    )


def _unlike(sensor: Found) -> str | None:
    """Channels that would fit the rest only at a size that no sensor's scale has; None without any."""
    fit = sensor.fit
    if fit is None:
        return None
    unlike = [
        f"{name.partition('.')[2]} ({1.0 / (1.0 + value):.3g} times)"
        for name, value in fit.values.items()
        if name.startswith("scale.") and not _is_scale(value) and is_shown(value, fit.sd[name])
    ]
    if not unlike:
        return None
    return (
        f"{' and '.join(unlike)}: not as large as the motion says, beyond any scale error of a sensor;"
        " check unit and sign in map.toml or the campaign"
    )


def _opposed(sensor: Found) -> str | None:
    """A velocity that no correction brings anywhere near the rates of the pose; None where one does.

    It then differs from them by more than they are: no velocity at all would agree better. Where a scale that
    takes the velocity away is the best correction, the difference as recorded counts.
    """
    fit = sensor.fit
    if fit is None or sensor.group != "velocity":
        return None
    none = not is_shown(fit.values.get("scale.velocity", 0.0), fit.sd.get("scale.velocity", 0.0))
    apart = sensor.sizes[1] if none else fit.after
    if apart < max(sensor.motion, _OPPOSED * sensor.speed, _OPPOSED_M_S):
        return None
    what = sensor.of.removesuffix(", m/s")
    differ = (
        f"{apart:.3g} m/s rms, and no delay, tilt or scale of the velocity brings them closer"
        if none
        else f"{apart:.3g} m/s rms with the best correction ({sensor.sizes[0]:.3g} m/s as recorded)"
    )
    return (
        f"{what} contradict one another: they differ by {differ}, while the"
        f" {what.removesuffix(' and the velocity')} is {sensor.motion:.3g} m/s rms; check axes, signs and"
        " unit of the velocity in map.toml, and tilt_deg.velocity under [corrections] in the campaign"
    )


def _is_scale(value: float) -> bool:
    """Whether a relative scale error may be a sensor's: less than a factor of two either way."""
    return 0.5 < 1.0 + value < 2.0


def is_shown(value: float, sd: float) -> bool:
    """Whether a channel shows any of the motion that it is compared with: else a ratio of both has no sense.

    `value` and `sd` are the relative scale error and its deviation: at -1 the channel has nothing of the
    motion.

    Examples
    --------
    >>> is_shown(-1.0005, 0.15), is_shown(-0.999, 1e-5), is_shown(-3.0, 0.1)
    (False, True, True)
    """
    return abs(1.0 + value) > _CERTAIN * sd


def list_sentence(fit: Fit | None) -> str | None:
    """What the depth's rate tells about a roll that is not logged; None where nothing."""
    if fit is None or "list" not in fit.values:
        return None
    value, sd = fit.values["list"] / DEGREE, fit.sd["list"] / DEGREE
    side = "starboard" if value > 0.0 else "port"
    return (
        f"roll is not recorded, but sway and the depth's rate show a mean list of {abs(value):.2f} deg"
        f" (+/- {sd:.2f} deg) to {side}"
    )


def _word(group: str) -> str:
    return group.replace(" ", "_")
