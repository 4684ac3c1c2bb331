"""Frames that a format documents, checked against the gravity that the same message shows.

A driver may fill a message in the axes of its chip instead of those that the format states. An accelerometer
at rest shows the specific force -g (Titterton and Weston, Strapdown Inertial Navigation Technology, 2004,
section 3.4): its z reads -9.8 m/s^2 where the axis points down and +9.8 where it points up. The mean over a
log of a vehicle that is upright, mostly, tells which, and the vertical of the quaternion beside it. Held by
``tests/logs/test_gravity.py``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from seatrial.logs.log import Field, Topic
from seatrial.logs.recognise import Proposal

_VERTICAL = re.compile(
    r"(.*\.)?(linear_acceleration\.z|accel(eration)?\.z|AccZ|zacc|accelerometer_m_s2\[2\])", re.IGNORECASE
)
"""Fields of documented messages that hold the accelerometer's z."""

_G = 9.81  # m/s^2
_LEAST, _MOST = 0.7, 1.3  # of g: a mean beyond has another unit, or tells of no upright vehicle
_STEADY = 0.5  # of the mean: with a larger deviation the vehicle tumbles

_BODY = ("p_deg_s", "q_deg_s", "r_deg_s", "u_m_s", "v_m_s", "w_m_s")

_Q = ("q_w", "q_x", "q_y", "q_z")

_DOCUMENTED = ("dataflash", "mavlink", "ulog", "rosbag", "mcap")
"""Formats whose messages state the sense of their accelerometer; in a table it may be gravity itself."""


def points_down(field: Field) -> bool | None:
    """Whether the z of an accelerometer points down; None where its mean is not that of gravity.

    Examples
    --------
    >>> points_down(Field("linear_acceleration.z", "", 500, -10.4, -9.2, -9.79, 0.2, 0.0))
    True
    """
    for unit in (_G, 1.0, 1000.0):  # m/s^2, g, mg
        size = abs(field.mean) / unit
        if _LEAST < size < _MOST and field.deviation < _STEADY * abs(field.mean):
            return field.mean < 0.0
    return None


def by_gravity(format: str, topics: Sequence[Topic], proposals: Iterable[Proposal]) -> Iterator[Proposal]:
    """The proposals with the body frame and the vertical of an attitude that gravity shows in the message."""
    fields = {topic.name: {field.name: field for field in topic.fields} for topic in topics}
    down = {name: _down(own) for name, own in fields.items()} if format in _DOCUMENTED else {}
    for proposal in proposals:
        shown = down.get(proposal.topic)
        if shown is None or not (proposal.canonical in _BODY or proposal.canonical in _Q):
            yield proposal
            continue
        body = "FRD" if shown else "FLU"
        if proposal.canonical in _BODY:
            frame, stated = ("" if shown else "FLU"), proposal.frame or "FRD"
            differs = stated != body
        else:
            stated = proposal.frame or "FRD/NED"
            frame = f"{body}/{_earth(fields[proposal.topic], proposal, found_down=shown, stated=stated)}"
            differs = frame != stated
            frame = "" if frame == "FRD/NED" else frame
        if not differs:
            yield proposal
            continue
        sense = "down" if shown else "up"
        why = f"{proposal.why} in {stated}, but its accelerometer's z points {sense}: {frame or 'FRD, NED'}"
        yield replace(proposal, frame=frame, why=why, certain=False)


def _down(fields: Mapping[str, Field]) -> bool | None:
    vertical = [field for name, field in fields.items() if _VERTICAL.fullmatch(name)]
    return points_down(vertical[0]) if len(vertical) == 1 else None


def _earth(fields: Mapping[str, Field], proposal: Proposal, *, found_down: bool, stated: str) -> str:
    """Earth frame of a quaternion whose body z points down or up: by the mean of the vertical's cosine.

    Of a unit quaternion that is the mean of w^2 - x^2 - y^2 + z^2, positive where both verticals point alike.
    """
    name = proposal.name
    stem = name[:-1]  # orientation.w: the last letter names the component
    parts = [fields.get(f"{stem}{axis}") for axis in "wxyz"]
    earth = stated.partition("/")[2]
    if not name.endswith(("w", "x", "y", "z")) or any(part is None for part in parts):
        return earth
    squares = [part.mean**2 + part.deviation**2 for part in parts if part is not None]
    alike = squares[0] - squares[1] - squares[2] + squares[3] > 0.0
    if found_down == alike:
        return "NED"
    return earth if earth in ("ENU", "NWU") else "ENU"
