"""Whether the channels of a log tell one motion, and what would make them.

Position, depth, velocity, attitude, rates and specific force are tied by kinematics, whatever moves the
vehicle (data compatibility, flight-path reconstruction: Klein and Morelli, Aircraft System Identification,
2006, chapter 10; kinematics: Fossen 2011, chapter 2). The attitude is the reference of time and of angles;
the gyro is compared with it, then the velocity with position and depth, then the specific force. A
correction is proposed if it is five deviations from nothing, not small and makes the channels agree better.
Held by ``tests/inspect/test_consistency.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import DEGREE
from seatrial.base.finding import Finding, Severity
from seatrial.base.frames import from_euler, matrix, to_euler
from seatrial.inspect.consistency_current import slow_current
from seatrial.inspect.consistency_sensors import Found, force_found, rates_found, scaled, velocity_found
from seatrial.inspect.corrections import (
    Consistency,
    Correction,
    SlowCurrent,
    beside,
    contradiction_of,
    corrections_of,
)
from seatrial.trial.attitude import AttitudeConvention, as_convention, attitude_convention, certain_tilt
from seatrial.trial.defects import stuck
from seatrial.trial.kinematic_fit import robust_rms
from seatrial.trial.kinematics import Channels, Curve
from seatrial.trial.signals import INPUTS, Series, checked


@dataclass(frozen=True)
class ConsistencySettings:
    """Which channels are compared, and what their units and mounting must be."""

    fewest_samples: int = 50  #: Samples of a channel that can be compared.
    most_pitch: float = 1.7  #: Largest pitch, rad: more are degrees.
    most_roll: float = 3.3  #: Largest roll, rad: more are degrees.
    #: Of a heading error that sway on straight legs shows if the sensor is turned.
    mounted_share: float = 0.5


SETTINGS = ConsistencySettings()


def consistency(series: Mapping[str, Series], *, quaternion: bool = True) -> Consistency:
    """Corrections that would make the channels tell one motion, and what the log cannot tell.

    Parameters
    ----------
    series
        By channel: ``x y z u v w p q r roll pitch yaw`` as of a trial, ``u_water v_water w_water`` velocity
        through the water, ``ax ay az`` specific force in m/s^2, ``cmd.<actuator>`` in any unit, and the
        wrench ``tau.X_n`` ... ``tau.N_nm``.
    quaternion
        Whether the attitude was recorded as one: then the order of its columns and its direction are asked,
        not only its frame.

    Raises
    ------
    TrialError
        An unknown channel, or stamps that do not rise.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(0.0, 60.0, 0.1)
    >>> found = consistency({"z": Series(t, 2.0 + 0.0 * t), "yaw": Series(t, 0.1 * t)})
    >>> len(found.corrections), found.current
    (0, None)
    """
    given = checked(series)
    known = {name: samples for name, samples in given.items() if len(samples.t) >= SETTINGS.fewest_samples}
    untold = missing(given)
    if few := [name for name in given if name not in known and not name.startswith(INPUTS)]:
        fewest = {"fewest": SETTINGS.fewest_samples}
        untold.insert(0, Finding("few samples", Severity.NOTE, ", ".join(few), fewest))
    contradicted = _stuck(known)
    if not {"pitch", "yaw"} & set(known):
        return Consistency((), tuple(untold), contradicted=tuple(contradicted))
    corrections = _angles(known)
    channels = _curves(known)
    # The attitude is the reference of all that follows: its convention comes first.
    convention = attitude_convention(channels, quaternion=quaternion)
    if convention is not None:
        values = {"sentence": convention.sentence}
        contradicted.append(Finding("attitude convention", Severity.PROBLEM, "attitude", values))
        if not convention.either:  # the others are compared with what the attitude is then
            _turn(channels, convention)
    undecided = convention is not None and convention.either
    sensors = [None if undecided else rates_found(channels), *velocity_found(channels)]
    compared = []
    for sensor in (*(sensor for sensor in sensors if sensor is not None), force_found(channels)):
        if sensor is None:
            continue
        wrong = contradiction_of(sensor)
        if sensor.fit is None:
            if wrong is None:
                untold.append(sensor.why or Finding("too little in common", Severity.NOTE, sensor.of))
            else:
                contradicted.append(wrong)
            continue
        made = corrections_of(sensor, channels, _turned_sensor(channels, sensor))
        if sensor.group == "specific force":  # no trial reads it: nothing to paste
            untold += [
                Finding("specific force", Severity.NOTE, cause=correction.finding) for correction in made
            ]
        else:
            present = {correction.key for correction in corrections}
            corrections += [correction for correction in made if correction.key not in present]
        contradicted += [] if wrong is None else [wrong]
        untold += beside(sensor, channels)
        if sensor.group == "velocity":
            _apply(channels, sensor)
        compared.append((sensor.of, sensor.sizes[0], sensor.fit.after))
    corrections += _frame(channels)
    current = slow_current(channels)
    if isinstance(current, Finding):
        untold.append(current)
    order = sorted(corrections, key=lambda correction: -(correction.before / max(correction.after, 1e-12)))
    return Consistency(
        tuple(order),
        tuple(untold),
        current if isinstance(current, SlowCurrent) else None,
        tuple(compared),
        tuple(contradicted),
    )


def convention_of(series: Mapping[str, Series]) -> AttitudeConvention | None:
    """Convention of a recorded quaternion if it is not the one it was read with; None where it is or unknown.

    The series are those of `consistency`.
    """
    known = {
        name: samples
        for name, samples in checked(series).items()
        if len(samples.t) >= SETTINGS.fewest_samples
    }
    return attitude_convention(_curves(known))


def _curves(known: Mapping[str, Series]) -> Channels:
    return Channels({name: Curve(samples, angle=name in ("roll", "yaw")) for name, samples in known.items()})


def _turn(channels: Channels, convention: AttitudeConvention) -> None:
    """Bring the attitude to what its convention makes of it, in place."""
    old = channels.curves["roll"]
    angles = to_euler(as_convention(channels.rotation(old.t), convention))
    for k, name in enumerate(("roll", "pitch", "yaw")):
        channels.curves[name] = Curve(Series(old.t, angles[:, k], old.clock), angle=name != "pitch")


def _stuck(known: dict[str, Series]) -> list[Finding]:
    """Leave out angles that never change while another one does, in place; which ones."""
    still = stuck({name: known[name].value for name in ("roll", "pitch", "yaw") if name in known})
    for name in still:
        del known[name]
    return [Finding("angle stuck", Severity.PROBLEM, name, {"rad": value}) for name, value in still.items()]


def _angles(known: dict[str, Series]) -> list[Correction]:
    """Turn angles in degrees into radians, in place; the correction that says so."""
    most = {
        name: float(np.abs(known[name].value).max()) for name in ("roll", "pitch", "yaw") if name in known
    }
    jumps = np.abs(np.diff(known["yaw"].value)).max(initial=0.0) if "yaw" in known else 0.0
    degrees = (
        most.get("pitch", 0.0) > SETTINGS.most_pitch
        or most.get("roll", 0.0) > SETTINGS.most_roll
        or 300.0 < jumps < 400.0
    )
    if not degrees:
        return []
    for name in most:
        known[name] = Series(known[name].t, known[name].value * DEGREE, known[name].clock)
    largest = max(most.values())
    finding = Finding("attitude in degrees", Severity.WEAKNESS, "attitude", {"largest_rad": largest})
    sizes = (largest, largest * DEGREE, "largest angle, rad")
    return [Correction("corrections", "scale.attitude", round(DEGREE, 8), 0.0, "", *sizes, finding)]


def _turned_sensor(channels: Channels, velocity: Found) -> bool:
    """Whether a heading error is the velocity sensor's mounting: then it shows sway on straight legs."""
    if velocity.fit is None or "heading" not in velocity.fit.values:
        return False
    t = channels.curves["u"].t
    yaw = channels.at("yaw", t, {})
    rate = np.abs(np.gradient(yaw, t))
    u, v = (channels.at(name, t + channels.delay.get("velocity", 0.0), {}) for name in "uv")
    straight = (rate < np.quantile(rate, 0.5)) & (np.abs(u) > 0.5 * np.quantile(np.abs(u), 0.9))
    if straight.sum() < SETTINGS.fewest_samples:
        return False
    slip = float(np.median(v[straight] / u[straight]))
    # Turned by the heading error the sensor would make the sway vanish.
    return bool(abs(slip + np.tan(velocity.fit.values["heading"])) < SETTINGS.mounted_share * abs(slip))


def _apply(channels: Channels, velocity: Found) -> None:
    """Bring the velocity to what the current is estimated from: scale and yaw of the attitude."""
    values = {} if velocity.fit is None else velocity.fit.values
    if "scale.velocity" in values:
        scaled(channels, dict.fromkeys("uvw", 1.0 + values["scale.velocity"]))
    if "heading" in values and "yaw" in channels.curves:
        old = channels.curves["yaw"]
        channels.curves["yaw"] = Curve(Series(old.t, old.values + values["heading"], old.clock))


def _frame(channels: Channels) -> list[Correction]:
    """Tilt of a pose's earth frame against gravity, where a whole pose came from one instrument."""
    whole = {"x", "y", "z", "roll", "pitch", "yaw"}
    if not whole <= set(channels.curves) or channels.group("z") != "position":
        return []
    t = channels.curves["roll"].t
    q = from_euler(np.stack([channels.at(name, t, {}) for name in ("roll", "pitch", "yaw")], axis=1))
    tilted = certain_tilt(q)
    if tilted is None or not tilted.trusted:
        return []
    north, east = tilted.direction
    sd = tilted.deviation / DEGREE
    value = [round(float(np.arcsin(x)) / DEGREE, 3) for x in (north, east)]
    values = {"tilt_deg": tilted.angle / DEGREE, "sd_deg": sd}
    finding = Finding("frame tilted", Severity.WEAKNESS, "pose", values)
    sizes = (_upright(q, np.zeros(2)), _upright(q, tilted.direction), "upright of the body and gravity, rad")
    return [Correction("corrections", "tilt_deg.frame", value, [sd, sd], "deg", *sizes, finding)]


def _upright(q: Array, direction: Array) -> float:
    """Root mean square of ``R c - n``, horizontal, with the best trim c for a gravity direction n (2,)."""
    turned = matrix(q)
    design = turned[:, :2, :2].reshape(-1, 2)
    goal = np.tile(direction, len(q)) - turned[:, :2, 2].ravel()
    trim = np.linalg.lstsq(design, goal, rcond=None)[0]
    return robust_rms((goal - design @ trim).reshape(-1, 2))


def missing(series: Mapping[str, Series]) -> list[Finding]:
    """Channels that are not recorded.

    Examples
    --------
    >>> missing({})[0].subject
    'attitude'
    """
    has = set(series)
    attitude = has & {"roll", "pitch", "yaw"}
    rates = [name for name in "pqr" if name not in has]
    lacking = {
        "attitude": not attitude,
        "roll": attitude and "roll" not in has,
        "pitch": attitude and "pitch" not in has,
        "yaw": attitude and "yaw" not in has,
        " ".join(rates): rates,
        "position": not {"x", "y"} <= has,
        "depth": "z" not in has,
        "velocity over ground": not {"u", "v", "w"} & has,
        "velocity through the water": not {"u_water", "v_water"} <= has,
    }
    return [Finding("not recorded", Severity.NOTE, name) for name, lacks in lacking.items() if lacks]
