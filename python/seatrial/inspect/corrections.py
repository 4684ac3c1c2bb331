"""What would make the channels of a log tell one motion, as data: corrections, contradictions, the current.

What was found about a sensor (`seatrial.inspect.consistency_sensors`) becomes keys with value, deviation and
effect, or a contradiction that no key mends. The words are those of `seatrial.report.results.trial_findings`.
Held by ``tests/inspect/test_consistency.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import DEGREE
from seatrial.base.finding import Finding, Severity
from seatrial.base.plain import Plain
from seatrial.base.report import Reported, sentence_of
from seatrial.trial.kinematic_axes import pressure_of
from seatrial.trial.kinematic_fit import Fit
from seatrial.trial.kinematics import Channels
from seatrial.trial.signals import INPUTS

if TYPE_CHECKING:
    from seatrial.inspect.consistency_sensors import Found


@dataclass(frozen=True)
class CorrectionSettings:
    """From where on a correction is proposed, and a channel contradicts the others."""

    #: Deviations from which a correction is proposed.
    certain: float = 5.0
    #: A smaller delay is not proposed, s.
    least_delay_s: float = 0.015
    #: Deviation of a clock's offset that is worth a word, s.
    uncertain_s: float = 0.1
    #: Of the speed: a smaller difference of velocity and rates may be noise.
    opposed_share: float = 0.2
    #: The same in m/s.
    opposed_m_s: float = 0.1
    #: Share of the residual that a delay must take away: a lever arm may look like a small one.
    material_share: float = 0.03
    #: Error of a velocity with a current over that without which is worth a key.
    better_share: float = 0.95


SETTINGS = CorrectionSettings()

NO_MOTION = Finding("no motion", Severity.NOTE)
"""Of a recording in which hardly anything moves: its channels cannot be compared."""


@dataclass(frozen=True)
class Correction(Plain, without="finding", also="sentence"):
    """One proposal: a key of a campaign or of an import's map, its value and what it improves."""

    #: "corrections" (campaign) or "clocks" (map of an import), and the key in it.
    table: str
    key: str
    #: What to write there, its standard deviation (0 for signs and units), the unit of both.
    value: Any
    sd: Any
    unit: str
    #: Root mean square of the residual without and with this correction, and of which comparison, with its
    #: unit.
    before: float
    after: float
    of: str
    finding: Finding  #: What was found, with deviation and effect.
    sensor: str = ""  #: Of a clock the sensor whose delay it contains, as under delay_s; else "".

    @property
    def sentence(self) -> str:
        """What was found, in words."""
        return sentence_of(self.finding, "trial_findings")

    @property
    def line(self) -> str:
        """The key and its value as a TOML file holds them."""
        file, _, key = self.key.rpartition(".")
        name = f'"{file}".{key}' if self.table == "clocks" else self.key
        return f"{name} = {_toml(self.value)}"


@dataclass(frozen=True, eq=False)
class SlowCurrent(Plain):
    """Current of the water over time."""

    t: Array  #: Times in s, shape (n,).
    #: North and east, m/s, shape (n, 2), and the standard deviation of each.
    velocity: Array
    sd: Array
    source: str  #: What it was estimated from.
    #: Error of u and v (of north and east where the velocity through the water is measured) in m/s, as
    #: predicted for held-out parts of time without and with this current.
    before: tuple[float, float]
    after: tuple[float, float]

    @property
    def worth(self) -> bool:
        """Whether it predicts at least one of the velocities better and none clearly worse."""
        ratios = [after / max(before, 1e-12) for before, after in zip(self.before, self.after, strict=True)]
        return min(ratios) < SETTINGS.better_share and max(ratios) < 1.0 / SETTINGS.better_share

    @property
    def line(self) -> str:
        """The key of a trial's corrections and its value as a TOML file holds them.

        Knots that a straight line replaces within half of the usual deviation are left out.
        """
        near = 0.5 * float(np.sqrt(np.mean(self.sd**2)))
        kept = sorted(_corners(self.t, self.velocity, 0, len(self.t) - 1, near))
        columns = (self.t[kept].round(1), *(self.velocity[kept].T).round(3))
        lists = zip(("t_s", "north_m_s", "east_m_s"), columns, strict=True)
        return f"current = {{ {', '.join(f'{name} = {_toml(values.tolist())}' for name, values in lists)} }}"

    @property
    def effect(self) -> str:
        """How much better it predicts, in words."""
        names = ("u", "v") if self.legs else ("north", "east")
        errors = " and ".join(
            f"{name} {before:.3f} to {after:.3f}"
            for name, before, after in zip(names, self.before, self.after, strict=True)
        )
        return f"rms error of the velocity predicted for held-out minutes, m/s: {errors}"

    @property
    def legs(self) -> bool:
        """Whether it comes from legs and turns, not from a velocity through the water."""
        return not self.source.startswith("velocity")


@dataclass(frozen=True, eq=False, repr=False)
class Consistency(Reported, Plain, only="corrections contradictions missing current compared=comparisons"):
    """Proposed corrections, the one with the largest effect first; nothing is applied."""

    corrections: tuple[Correction, ...]  #: Each is significant and its effect is not small.
    untold: tuple[Finding, ...]  #: What the log cannot tell, and what that costs.
    current: SlowCurrent | None = None  #: Slow current of the water; None where the log does not tell it.
    #: What was compared, with the root mean square of the difference as recorded and corrected.
    compared: tuple[tuple[str, float, float], ...] = ()
    #: Channels that no correction brings to the motion that the others show.
    contradicted: tuple[Finding, ...] = ()

    def without_motion(self) -> Consistency:
        """What a recording tells in which hardly anything moved: what is missing."""
        return Consistency((), (NO_MOTION, *self.untold))

    @property
    def missing(self) -> tuple[str, ...]:
        """`untold` in sentences."""
        return tuple(sentence_of(finding, "trial_findings") for finding in self.untold)

    @property
    def contradictions(self) -> tuple[str, ...]:
        """`contradicted` in sentences."""
        return tuple(sentence_of(finding, "trial_findings") for finding in self.contradicted)

    def comparisons(self) -> list[dict[str, Any]]:
        """`compared` as plain data."""
        return [{"of": of, "before": before, "after": after} for of, before, after in self.compared]


def _corners(t: Array, y: Array, first: int, last: int, near: float) -> set[int]:
    """Knots from first to last between which straight lines stay near the values (Ramer 1972)."""
    if last - first < 2:
        return {first, last}
    share = ((t[first:last] - t[first]) / (t[last] - t[first]))[:, None]
    off = np.abs(y[first:last] - y[first] - share * (y[last] - y[first])).max(axis=1)
    furthest = first + int(np.argmax(off))
    if off.max() < near:
        return {first, last}
    return _corners(t, y, first, furthest, near) | _corners(t, y, furthest, last, near)


def _toml(value: Any) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Sequence):
        return f"[{', '.join(_toml(item) for item in value)}]"
    return f"{value:.6g}"


def corrections_of(sensor: Found, channels: Channels, mounting_yaw: bool = False) -> list[Correction]:
    """Corrections of one sensor; a heading is its mounting's where `mounting_yaw`."""
    made = [*_units(sensor), *_axes(sensor)]
    if sensor.fit is not None:
        made += _timing(sensor, sensor.fit, channels)
        made += _mounting(sensor, sensor.fit, mounting_yaw)
        made += _amplitudes(sensor, sensor.fit)
    return made


def _found(kind: str, subject: str, **values: Any) -> Finding:
    return Finding(kind, Severity.WEAKNESS, subject, values)


def _units(sensor: Found) -> list[Correction]:
    made = []
    for group, (unit, factor) in sensor.unit.items():
        finding = _found("other unit", group, unit=unit, times=1.0 / factor)
        made.append(
            Correction(
                "corrections", f"scale.{_word(group)}", factor, 0.0, "", *sensor.sizes, sensor.of, finding
            )
        )
    return made


def _axes(sensor: Found) -> list[Correction]:
    if sensor.assignment is None:
        return []
    made = []
    for name, (recorded, sign) in sensor.assignment.changed.items():
        own = sensor.assignment.follows.get(name)
        follows = str(own) if own is not None and own.moves else ""
        if recorded == name:
            certain = own is None or own.reversed
            entry: tuple[str, Any] = (f"signs.{name}", -1)
            finding = _found("sign reversed", name, follows=follows, certain=certain)
        else:
            entry = (f"axes.{name}", ("-" if sign < 0.0 else "") + recorded)
            finding = _found("axes exchanged", name, recorded=recorded, sign=sign, follows=follows)
        made.append(Correction("corrections", *entry, 0, "", *sensor.sizes, sensor.of, finding))
    return made


def _timing(sensor: Found, fit: Fit, channels: Channels) -> list[Correction]:
    """Delays, and offset and drift of a clock that is not the attitude's."""
    made: list[Correction] = []
    reference = channels.clock("attitude")
    for name in fit.names:
        kind, _, group = name.partition(".")
        if kind != "delay":
            continue
        own = channels.clock(group)
        if own == reference:
            made += _delay(sensor, fit, name, group)
            continue
        value, sd = fit.values[name], fit.sd[name]
        if (drift := f"drift.{group}") in fit.values:
            value, sd = _at_zero(fit, name, drift, sensor.middle)
        if abs(value) > max(SETTINGS.certain * sd, SETTINGS.least_delay_s):
            finding = _found("clock offset", own, offset_s=value, sd_s=sd, of=reference, group=group)
            made.append(_clock(sensor, fit, name, f"{own}.offset_s", round(value, 5), sd, "s", finding))
    for name in fit.names:
        kind, _, group = name.partition(".")
        if kind == "drift":
            rate, sd, own = fit.values[name], fit.sd[name], channels.clock(group)
            span = 2.0 * abs(sensor.middle - _start(channels, group))
            finding = _found("clock drift", own, rate=rate, sd=sd, over_log_s=abs(rate) * span)
            made.append(_clock(sensor, fit, name, f"{own}.drift", float(f"{rate:.4g}"), sd, "", finding))
    return made


def _clock(
    sensor: Found, fit: Fit, name: str, key: str, value: float, sd: float, unit: str, finding: Finding
) -> Correction:
    """A correction in the map of an import, which holds the delay of the sensor as well."""
    group = name.partition(".")[2]
    return Correction(
        "clocks", key, value, sd, unit, fit.alone[name], fit.after, sensor.of, finding, _word(group)
    )


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
    material = fit.after <= (1.0 - SETTINGS.material_share) * fit.alone[name]
    if abs(value) < max(SETTINGS.certain * sd, SETTINGS.least_delay_s) or not material:
        return []
    finding = _found("late sensor", group, delay_s=value, sd_s=sd)
    return [_simple(sensor, fit, name, f"delay_s.{_word(group)}", round(value, 4), sd, "s", finding)]


def _mounting(sensor: Found, fit: Fit, mounting_yaw: bool) -> list[Correction]:
    """Tilt of the velocity sensor, heading of the attitude, and the place of the velocity sensor."""
    made: list[Correction] = []
    tilts = {"tilt.roll": "roll", "tilt.pitch": "pitch", "heading" if mounting_yaw else "tilt.yaw": "yaw"}
    if given := [name for name in tilts if name in fit.values]:
        angles = [fit.values.get(name, 0.0) / DEGREE for name in tilts]
        sds = [fit.sd.get(name, 0.0) / DEGREE for name in tilts]
        turned = {tilts[name]: (fit.values[name] / DEGREE, fit.sd[name] / DEGREE) for name in given}
        finding = _found("velocity turned", "velocity", angles_deg=turned)
        worst = max(given, key=fit.alone.__getitem__)
        value = [round(angle, 3) for angle in angles]
        made.append(_simple(sensor, fit, worst, "tilt_deg.velocity", value, sds, "deg", finding))
    if "heading" in fit.values and not mounting_yaw:
        value_deg, sd = fit.values["heading"] / DEGREE, fit.sd["heading"] / DEGREE
        finding = _found("heading off", "attitude", off_deg=-value_deg, sd_deg=sd)
        made.append(_simple(sensor, fit, "heading", "heading_deg", round(value_deg, 2), sd, "deg", finding))
    arm = [f"arm.{axis}" for axis in "xyz"]
    if any(name in fit.values for name in arm):
        values = [round(fit.values.get(name, 0.0), 3) for name in arm]
        sds = [fit.sd.get(name, 0.0) for name in arm]
        before = max(fit.alone[name] for name in arm if name in fit.values)
        finding = _found("velocity beside O", "velocity", place_m=values)
        made.append(
            Correction("places", "velocity_m", values, sds, "m", before, fit.after, sensor.of, finding)
        )
    return made


def _simple(
    sensor: Found, fit: Fit, name: str, key: str, value: Any, sd: Any, unit: str, finding: Finding
) -> Correction:
    """A correction in the campaign, whose effect is measured on what stays without the parameter `name`."""
    return Correction("corrections", key, value, sd, unit, fit.alone[name], fit.after, sensor.of, finding)


def _amplitudes(sensor: Found, fit: Fit) -> list[Correction]:
    """Scales and biases."""
    made = []
    for name in fit.names:
        kind, _, channel = name.partition(".")
        value, sd = fit.values[name], fit.sd[name]
        if kind == "scale" and _is_scale(value):
            off = 100.0 * (1.0 / (1.0 + value) - 1.0)
            finding = _found("scale off", channel, off_percent=off, sd_percent=100.0 * sd)
            known = sensor.unit.get(channel if channel == "velocity" else sensor.group)
            factor = (1.0 + value) * (known[1] if known and channel == "velocity" else 1.0)
            made.append(
                _simple(sensor, fit, name, f"scale.{channel}", float(f"{factor:.5g}"), sd, "", finding)
            )
        elif kind == "bias" and channel != "w":
            degrees = channel in "pqr"
            factor, unit = (1.0 / DEGREE, "deg/s") if degrees else (1.0, "m/s^2")
            key = f"bias.{channel}_deg_s" if degrees else f"bias.{channel}_m_s2"
            finding = _found("bias", channel, value=value * factor, sd=sd * factor, unit=unit)
            made.append(
                _simple(sensor, fit, name, key, float(f"{value * factor:.4g}"), sd * factor, unit, finding)
            )
    return made


def beside(sensor: Found, channels: Channels) -> list[Finding]:
    """What is known besides: an offset of a clock too uncertain to be proposed, a roll that is not logged."""
    fit, key, known = sensor.fit, f"delay.{sensor.group}", []
    if fit is None:
        return []
    if "list" in fit.values:
        value, sd = fit.values["list"] / DEGREE, fit.sd["list"] / DEGREE
        known.append(Finding("list", Severity.NOTE, "roll", {"list_deg": value, "sd_deg": sd}))
    if sensor.other_clock and key in fit.values:
        value, sd = fit.values[key], fit.sd[key]
        if sd >= SETTINGS.uncertain_s and abs(value) <= SETTINGS.certain * sd:
            values = {"offset_s": value, "sd_s": sd}
            known.append(Finding("clock uncertain", Severity.NOTE, channels.clock(sensor.group), values))
    return known


def contradiction_of(sensor: Found) -> Finding | None:
    """What contradicts the motion that the other channels show, the side that no vehicle can have first."""
    return _too_still(sensor) or _astray(sensor) or _unlike(sensor) or _opposed(sensor)


def _contradiction(kind: str, subject: str, **values: Any) -> Finding:
    return Finding(kind, Severity.PROBLEM, subject, values)


def _too_still(sensor: Found) -> Finding | None:
    """A position or depth that moves less than its noise while the velocity says that it moves."""
    if sensor.group != "velocity" or sensor.fit is not None or not sensor.still:
        return None
    ratio = sensor.shown / max(sensor.motion, 1e-300)
    pose = sensor.pose
    pressure = pressure_of(ratio) if pose == "depth" else None
    moved = {"moves_m_s": sensor.motion, "shown_m_s": sensor.shown, "ratio": ratio}
    return _contradiction("pose too still", pose, **moved, pressure=pressure)


def _astray(sensor: Found) -> Finding | None:
    """Rates that the attitude has and the gyro does not show, whatever is exchanged; None without any."""
    if sensor.group != "rates" or sensor.assignment is None or sensor.assignment.changed:
        return None
    astray = {
        name: str(own)
        for name, own in sensor.assignment.follows.items()
        if name in sensor.assignment.contradicted
    }
    return _contradiction("gyro astray", "gyro", rates=astray) if astray else None


def _unlike(sensor: Found) -> Finding | None:
    """Channels that would fit the rest only at a size that no sensor's scale has; None without any."""
    fit = sensor.fit
    if fit is None:
        return None
    unlike = {
        name.partition(".")[2]: 1.0 / (1.0 + value)
        for name, value in fit.values.items()
        if name.startswith("scale.") and not _is_scale(value) and is_shown(value, fit.sd[name])
    }
    return _contradiction("size unlike", sensor.group, times=unlike) if unlike else None


def _opposed(sensor: Found) -> Finding | None:
    """A velocity that differs from the rates of the pose by more than they are, whatever is corrected. Where
    a scale that takes the velocity away is the best correction, the difference as recorded counts.
    """
    fit = sensor.fit
    if fit is None or sensor.group != "velocity":
        return None
    none = not is_shown(fit.values.get("scale.velocity", 0.0), fit.sd.get("scale.velocity", 0.0))
    apart = sensor.sizes[1] if none else fit.after
    if apart < max(sensor.motion, SETTINGS.opposed_share * sensor.speed, SETTINGS.opposed_m_s):
        return None
    sizes = {"apart_m_s": apart, "recorded_m_s": sensor.sizes[0], "motion_m_s": sensor.motion}
    what = sensor.of.removesuffix(", m/s")
    return _contradiction("velocity opposed", what, **sizes, corrected=not none)


def _is_scale(value: float) -> bool:
    """Whether a relative scale error may be a sensor's: less than a factor of two either way."""
    return 0.5 < 1.0 + value < 2.0


def is_shown(value: float, sd: float) -> bool:
    """Whether a channel shows any of the motion that it is compared with, from its relative scale error and
    the deviation of that: at -1 it has nothing of the motion, and a ratio of both has no sense.

    >>> is_shown(-1.0005, 0.15), is_shown(-0.999, 1e-5), is_shown(-3.0, 0.1)
    (False, True, True)
    """
    return abs(1.0 + value) > SETTINGS.certain * sd


def _word(group: str) -> str:
    return group.replace(" ", "_")
