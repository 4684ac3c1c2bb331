"""The watches of the autopilot in words: what each of them saw, and what to do about it.

Tests: ``tests/flight/test_flight.py``, ``tests/flight/test_silence.py``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from seatrial._core import autopilot_names
from seatrial.flight.findings import GROUPS, group
from seatrial.flight.sensor_channels import CHANNELS_OF_GROUP, GROUP_OF_KIND

if TYPE_CHECKING:
    from seatrial.flight.log import FlightLog

_SILENT_S = 1.5
"""A sensor is silent where it shows nothing new for so long, s: longer than the periods of common sensors."""

_SEEN = {
    "depth": (
        "the mission's largest depth was passed",
        "plan shallower legs, or raise the mission's largest depth",
    ),
    "altitude": (
        "the bottom came nearer than the mission's smallest altitude",
        "plan the legs farther from the bottom, or lower the mission's smallest altitude",
    ),
    "fence": (
        "the vehicle was outside the mission's fence",
        "plan the legs farther inside the fence, or widen it",
    ),
    "time": ("the mission took longer than its limit", "plan a shorter mission, or raise its time limit"),
    "battery": (
        "the battery was low",
        "plan a shorter or slower mission, or give the vehicle a larger battery",
    ),
    "actuator": (
        "an actuator did not follow its command",
        "repair it, or check its limits and its motor in the vehicle file",
    ),
    "progress": (
        "the next waypoint came no nearer for too long",
        "plan a faster leg or less current: the vehicle could not come nearer",
    ),
    "contradicted_position": (
        "position and velocity told of two motions",
        "find out which of the two sensors is wrong: hold both against a known course",
    ),
    "contradicted_depth": (
        "the depth, and velocity and pitch, told of two motions",
        "find out which of the sensors is wrong: hold the depth against a measured one",
    ),
    "contradicted_attitude": (
        "attitude and turn rates told of two motions",
        "find out which of the two sensors is wrong: turn the vehicle by a known angle",
    ),
    "contradicted_velocity": (
        "the velocity changed more from step to step than any vehicle does",
        "find out why the Doppler log is noisy",
    ),
    "speed": (
        "the speed did not follow",
        "check the propulsion, and plan a speed that the vehicle reaches against the current",
    ),
    "unread": (
        "a channel that nothing reads, or the battery, fell silent",
        "find out why it stopped arriving",
    ),
    "ascent": (
        "surfacing brought the vehicle no higher",
        "find out what holds it down: a stuck actuator, flooding, or a depth sensor that is wrong",
    ),
}


def cause(watch: str) -> str:
    """What a watch saw, to follow "because".

    Examples
    --------
    >>> cause("stale_velocity")
    'no good sample of the velocity over ground arrived for too long'
    """
    if watch in _SEEN:
        return _SEEN[watch][0]
    return f"no good sample of the {GROUPS[watch.removeprefix('stale_')]} arrived for too long"


def source(group: str) -> str:
    """What else tells an autopilot a group of channels, to follow "give it".

    Examples
    --------
    >>> source("velocity")
    'another source of the velocity over ground'
    """
    if group == "position":
        return "a position aid (a GPS fix at the surface, USBL, or ranges to landmarks: the how-to on flying)"
    return f"another source of the {GROUPS[group]}"


def remedy(watch: str, outage: str = "") -> str:
    """What to do after a watch called for a reaction.

    `outage`: the one, in words, that was asked for and is the reason.

    Examples
    --------
    >>> remedy("fence")
    'plan the legs farther inside the fence, or widen it'
    """
    if watch in _SEEN:
        return _SEEN[watch][1]
    name = GROUPS[group(watch)]
    longer = f"allow a longer gap ({watch}.after_s under [safety] in the autopilot file)"
    if outage:
        return f"give it {source(group(watch))}, or {longer}"
    return f"find out why the {name} stopped arriving, or {longer}"


def silence(flight: FlightLog, watch: str, at_s: float) -> str:
    """Whether the samples that a watch missed never came, or came and were refused, to follow its cause.

    The log keeps what the sensors showed: a group was silent while none of its channels changed. Empty where
    the autopilot goes by an estimate, or by perfect sensors, which may rightly repeat a value.
    """
    missed, around = group(watch), flight.circumstances
    sensors = around.sensors or {}
    kinds = [kind for kind in sensors if GROUP_OF_KIND.get(kind) == missed]
    if around.navigation != "sensors" or not any(sensors[kind].get("noise") for kind in kinds):
        return ""
    names = autopilot_names()["channels"]
    told = np.stack([flight.measured[names[c]] for c in CHANNELS_OF_GROUP[missed]], axis=1)
    came = flight.t[np.flatnonzero(np.any(np.diff(told, axis=0) != 0.0, axis=1)) + 1]
    before, after = came[came < at_s], came[came >= at_s]
    last = float(before[-1]) if len(before) else 0.0
    if at_s - last < _SILENT_S:
        return "; samples came, and none was believed: they jumped, or a channel repeated one value"
    until = f"until {after[0]:.1f} s" if len(after) else "to the end"
    ends = [one.until_s for one in around.outages if one.group == missed]
    over = max((end for end in ends if last < end < at_s), default=None)
    longer = (
        "" if over is None else f": beyond the outage that ended at {over:.1f} s, by drop-outs of its own"
    )
    return f"; {' and '.join(kinds)} gave no sample from {last:.1f} s {until}{longer}; none was refused"
