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
from seatrial.base.frames import from_euler, matrix, to_euler
from seatrial.inspect.consistency_current import slow_current
from seatrial.inspect.consistency_result import Consistency, Correction, SlowCurrent
from seatrial.inspect.consistency_sensors import Found, force_found, rates_found, scaled, velocity_found
from seatrial.inspect.consistency_wording import (
    contradiction_of,
    corrections_of,
    list_sentence,
    offset_sentence,
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
    sentences = list(missing(given))
    if few := [name for name in given if name not in known and not name.startswith(INPUTS)]:
        sentences.insert(
            0,
            f"fewer than {SETTINGS.fewest_samples} samples of {', '.join(few)}: not compared with other"
            " channels",
        )
    contradictions = _stuck(known)
    if not {"pitch", "yaw"} & set(known):
        return Consistency((), tuple(sentences), contradictions=tuple(contradictions))
    corrections = _angles(known)
    channels = _curves(known)
    convention = attitude_convention(channels, quaternion=quaternion)
    if convention is not None:
        contradictions.append(convention.sentence)
        if not convention.either:  # the others are compared with what the attitude is then
            _turn(channels, convention)
    undecided = convention is not None and convention.either
    sensors = [None if undecided else rates_found(channels), *velocity_found(channels)]
    compared = []
    for sensor in (*(sensor for sensor in sensors if sensor is not None), force_found(channels)):
        if sensor is None:
            continue
        if sensor.fit is None and (wrong := contradiction_of(sensor)) is not None:
            contradictions.append(wrong)
        elif sensor.fit is None:
            sentences.append(sensor.why or f"{sensor.of}: too little in common for a comparison")
        if sensor.fit is None:
            continue
        made = corrections_of(sensor, channels, _turned_sensor(channels, sensor))
        if sensor.group == "specific force":  # no trial reads it: nothing to paste
            sentences += [f"specific force: {correction.sentence}" for correction in made]
        else:
            present = {correction.key for correction in corrections}
            corrections += [correction for correction in made if correction.key not in present]
        if (wrong := contradiction_of(sensor)) is not None:
            contradictions.append(wrong)
        extra = (list_sentence(sensor.fit), offset_sentence(sensor, channels))
        sentences += [sentence for sentence in extra if sentence is not None]
        if sensor.group == "velocity":
            _apply(channels, sensor)
        compared.append((sensor.of, sensor.sizes[0], sensor.fit.after))
    corrections += _frame(channels)
    current = slow_current(channels)
    if isinstance(current, str):
        sentences.append(current)
    order = sorted(corrections, key=lambda correction: -(correction.before / max(correction.after, 1e-12)))
    return Consistency(
        tuple(order),
        tuple(sentences),
        current if isinstance(current, SlowCurrent) else None,
        tuple(compared),
        tuple(contradictions),
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


def _stuck(known: dict[str, Series]) -> list[str]:
    """Leave out angles that never change while another one does, in place; a sentence that says so."""
    still = stuck({name: known[name].value for name in ("roll", "pitch", "yaw") if name in known})
    for name in still:
        del known[name]
    return [
        f"{name} stays at {value:.4g} rad while another angle changes, so it is not compared with other"
        " channels: is the sensor stuck? Map the right column, or leave this one out"
        for name, value in still.items()
    ]


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
    return [
        Correction(
            "corrections", "scale.attitude", round(DEGREE, 8), 0.0, "", largest, largest * DEGREE,
            "largest angle, rad", f"the attitude is in degrees: its largest angle would be {largest:.3g} rad",
        )
    ]  # fmt: skip


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
    return [
        Correction(
            "corrections", "tilt_deg.frame", value, [sd, sd], "deg",
            _upright(q, np.zeros(2)), _upright(q, tilted.direction), "upright of the body and gravity, rad",
            f"the earth frame of the pose is tilted by {tilted.angle / DEGREE:.1f} deg (+/- {sd:.1f} deg)"
            " against gravity, as the attitude at different headings shows",
        )
    ]  # fmt: skip


def _upright(q: Array, direction: Array) -> float:
    """Root mean square of ``R c - n``, horizontal, with the best trim c for a gravity direction n (2,)."""
    turned = matrix(q)
    design = turned[:, :2, :2].reshape(-1, 2)
    goal = np.tile(direction, len(q)) - turned[:, :2, 2].ravel()
    trim = np.linalg.lstsq(design, goal, rcond=None)[0]
    return robust_rms((goal - design @ trim).reshape(-1, 2))


def missing(series: Mapping[str, Series]) -> tuple[str, ...]:
    """Sentences on channels that are not recorded.

    Examples
    --------
    >>> missing({})[0].partition(":")[0]
    'no attitude'
    """
    sentences = []
    attitude = [name for name in ("roll", "pitch", "yaw") if name in series]
    if not attitude:
        sentences.append(
            "no attitude: no channel can be compared with another one, and no restoring moment is seen"
        )
    elif "roll" not in series:
        sentences.append(
            "no roll: it is taken as zero, so that sway leaks into the depth rate, roll coefficients (K_*)"
            " cannot be identified, and a list of the vehicle looks like a tilt of its sensors"
        )
    if attitude and "pitch" not in series:
        sentences.append("no pitch: the depth rate cannot be compared with the velocity")
    if attitude and "yaw" not in series:
        sentences.append("no yaw: neither course nor current can be told")
    rates = [name for name in ("p", "q", "r") if name not in series]
    if rates:
        sentences.append(
            f"no {' '.join(rates)}: rates are derived from the attitude, which limits them to the attitude's"
            " rate and noise; signs and delay of a gyro cannot be checked"
        )
    if not {"x", "y"} <= set(series):
        sentences.append(
            "no position: the heading of the compass and the horizontal scale of the velocity are unchecked"
        )
    if "z" not in series:
        sentences.append("no depth: the pitch tilt of the velocity sensor and its delay are unchecked")
    ground = [name for name in ("u", "v", "w") if name in series]
    if not ground:
        sentences.append("no velocity over ground: it is derived from the position, if there is one")
    if not {"u_water", "v_water"} <= set(series):
        sentences.append(
            "no velocity through the water: a current is told only from legs in several headings, and drag is"
            " fitted to speeds that are uncertain by it"
        )
    return tuple(sentences)
