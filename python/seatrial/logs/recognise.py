"""What the fields of a log probably are: canonical columns proposed from names, units and ranges.

Formats whose messages are documented (ArduPilot, MAVLink, PX4, ROS, MOOS-IvP, IMC) say what a field is and
in which frame and unit; their tables are here, the better source of a quantity first. Fields of other logs
are told by their names, and their units by what the log states, by the name's suffix, or else by the range
of the values. Every proposal says why, and whether it is certain: only documented messages and stated units
are.

Sources: ArduPilot, log messages of ArduSub; MAVLink, common message set; PX4, uORB message reference; ROS,
REP 103 and 105, sensor_msgs and nav_msgs; MOOS-IvP, names of pNodeReporter; IMC, message reference 5.4.
Frames: `seatrial.base.frames`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

from seatrial.logs.log import Field, Topic
from seatrial.logs.names import (
    PRESSURES,
    actuator_of,
    canonical_of,
    fits,
    misfit_of,
    no_unit,
    quantity_of,
    suffix_of,
    unit_of,
    words_of,
)


@dataclass(frozen=True)
class Proposal:
    """What a field probably is."""

    canonical: str  #: Canonical column (`seatrial.trial.columns`).
    #: The field.
    topic: str
    name: str
    #: As in a column map; "" and 1 for those of the canonical column.
    unit: str = ""
    frame: str = ""
    sign: int = 1
    #: Field of the same topic by which each sample is divided: the time a displacement took. "" for none.
    per: str = ""
    #: "latitude", "longitude", "pressure", "north", "east" or "down" for what needs more than a unit.
    convert: str = ""
    why: str = ""  #: What it was told from.
    certain: bool = True  #: Whether the log documents it; otherwise it is a guess to look at.
    rank: int = 0  #: Smaller is better, among proposals for one canonical column.
    named: bool = False  #: Whether only the name of the field says so.
    estimated: bool = False  #: Whether a filter wrote it, and no instrument measured it.

    @property
    def source(self) -> str:
        """``topic.field`` as a column map writes it."""
        return f"{self.topic}.{self.name}"


@dataclass(frozen=True)
class _Rule:
    """Fields of a documented message: canonical columns to fields, patterns of the topic's name."""

    topic: str
    fields: Mapping[str, str]
    unit: str = ""
    frame: str = ""
    sign: int = 1
    per: str = ""
    convert: str = ""


def _vector(canonical: Sequence[str], names: Sequence[str]) -> dict[str, str]:
    return dict(zip(canonical, names, strict=True))


_Q = ("q_w", "q_x", "q_y", "q_z")
_EULER = ("roll_deg", "pitch_deg", "yaw_deg")
_RATES = ("p_deg_s", "q_deg_s", "r_deg_s")
_VELOCITY = ("u_m_s", "v_m_s", "w_m_s")
_WATER = ("u_water_m_s", "v_water_m_s", "w_water_m_s")
_POSITION = ("x_m", "y_m", "z_m")

_EARTH = "earth"
"""Conversion of a rule for velocities of an estimator, north, east and down."""

_DOCUMENTED: dict[str, tuple[_Rule, ...]] = {
    "dataflash": (
        _Rule(r"ATT", _vector(_EULER, ("Roll", "Pitch", "Yaw")), "deg"),
        _Rule(r"IMU\[0\]|IMU", _vector(_RATES, ("GyrX", "GyrY", "GyrZ")), "rad/s"),
        _Rule(r"VISO", _vector(_VELOCITY, ("PosDX", "PosDY", "PosDZ")), "m/s", per="dt"),
        _Rule(r"BARO\[1\]", {"z_m": "Alt"}, "m", sign=-1),
        _Rule(r"CTUN", {"z_m": "BAlt"}, "m", sign=-1),
        _Rule(r"BARO\[0\]|BARO", {"z_m": "Alt"}, "m", sign=-1),
        _Rule(r"GPS\[0\]|GPS", {"x_m": "Lat"}, "deg", convert="latitude"),
        _Rule(r"GPS\[0\]|GPS", {"y_m": "Lng"}, "deg", convert="longitude"),
        _Rule(r"BAT\[0\]|BAT", {"voltage_v": "Volt"}, "V"),
        _Rule(r"[XN]KF1(\[0\])?", _vector(_VELOCITY, ("VN", "VE", "VD")), "m/s", convert=_EARTH),
    ),
    "mavlink": (
        _Rule(r"ATTITUDE", _vector(_EULER, ("roll", "pitch", "yaw")), "rad"),
        _Rule(r"ATTITUDE", _vector(_RATES, ("rollspeed", "pitchspeed", "yawspeed")), "rad/s"),
        _Rule(
            r"VISION_POSITION_DELTA(@.*)?",
            _vector(_VELOCITY, tuple(f"position_delta[{k}]" for k in range(3))),
            "m/us",
            per="time_delta_usec",
        ),
        _Rule(r"SCALED_PRESSURE2", {"z_m": "press_abs"}, "hPa", convert="pressure"),
        _Rule(r"VFR_HUD", {"z_m": "alt"}, "m", sign=-1),
        _Rule(r"LOCAL_POSITION_NED", _vector(_POSITION, ("x", "y", "z")), "m", "NED"),
        _Rule(r"SYS_STATUS", {"voltage_v": "voltage_battery"}, "mV"),
        _Rule(r"GPS_RAW_INT", {"x_m": "lat"}, "1e-7 deg", convert="latitude"),
        _Rule(r"GPS_RAW_INT", {"y_m": "lon"}, "1e-7 deg", convert="longitude"),
        _Rule(r"LOCAL_POSITION_NED", _vector(_VELOCITY, ("vx", "vy", "vz")), "m/s", convert=_EARTH),
        _Rule(r"GLOBAL_POSITION_INT", _vector(_VELOCITY, ("vx", "vy", "vz")), "cm/s", convert=_EARTH),
    ),
    "ulog": (
        _Rule(r"vehicle_attitude", _vector(_Q, tuple(f"q[{k}]" for k in range(4)))),
        _Rule(r"vehicle_angular_velocity", _vector(_RATES, tuple(f"xyz[{k}]" for k in range(3))), "rad/s"),
        _Rule(r"sensor_combined", _vector(_RATES, tuple(f"gyro_rad[{k}]" for k in range(3))), "rad/s"),
        _Rule(r"vehicle_attitude", _vector(_RATES, ("rollspeed", "pitchspeed", "yawspeed")), "rad/s"),
        _Rule(r"vehicle_local_position", _vector(_POSITION, ("x", "y", "z")), "m", "NED"),
        _Rule(r"battery_status", {"voltage_v": "voltage_v"}, "V"),
        _Rule(r"vehicle_local_position", _vector(_VELOCITY, ("vx", "vy", "vz")), "m/s", convert=_EARTH),
    ),
    "moos": (
        _Rule(r"NAV_Y", {"x_m": "value"}, "m"),
        _Rule(r"NAV_X", {"y_m": "value"}, "m"),
        _Rule(r"NAV_DEPTH", {"z_m": "value"}, "m"),
        _Rule(r"NAV_HEADING", {"yaw_deg": "value"}, "deg"),
        _Rule(r"NAV_PITCH", {"pitch_deg": "value"}, "rad"),
        _Rule(r"NAV_ROLL", {"roll_deg": "value"}, "rad"),
        _Rule(r"NAV_SPEED", {"u_m_s": "value"}, "m/s"),
        _Rule(r"DESIRED_RUDDER", {"cmd.rudder": "value"}, "deg"),
        _Rule(r"DESIRED_ELEVATOR", {"cmd.elevator": "value"}, "deg"),
        _Rule(r"DESIRED_THRUST", {"cmd.thruster": "value"}),
    ),
    "imc": (
        _Rule(r"EstimatedState(\[.*)?", _vector(_EULER, ("phi", "theta", "psi")), "rad"),
        _Rule(r"EulerAngles(\[.*)?", _vector(_EULER, ("phi", "theta", "psi")), "rad"),
        _Rule(r"EstimatedState(\[.*)?", _vector(_RATES, ("p", "q", "r")), "rad/s"),
        _Rule(r"AngularVelocity(\[.*)?", _vector(_RATES, ("x", "y", "z")), "rad/s"),
        _Rule(r"GroundVelocity(\[.*)?", _vector(_VELOCITY, ("x", "y", "z")), "m/s"),
        _Rule(r"WaterVelocity(\[.*)?", _vector(_WATER, ("x", "y", "z")), "m/s"),
        _Rule(r"EstimatedState(\[.*)?", _vector(_VELOCITY, ("u", "v", "w")), "m/s"),
        _Rule(r"EstimatedState(\[.*)?", {"x_m": "x", "y_m": "y"}, "m", "NED"),
        _Rule(r"Depth(\[.*)?", {"z_m": "value"}, "m"),
        _Rule(r"EstimatedState(\[.*)?", {"z_m": "depth"}, "m"),
        _Rule(r"Voltage(\[.*)?", {"voltage_v": "value"}, "V"),
    ),
    "ros": (
        _Rule(r".*", _vector(_Q, tuple(f"pose.pose.orientation.{a}" for a in "wxyz")), frame="FLU/ENU"),
        _Rule(r".*", _vector(_Q, tuple(f"pose.orientation.{a}" for a in "wxyz")), frame="FLU/ENU"),
        _Rule(r".*", _vector(_Q, tuple(f"orientation.{a}" for a in "wxyz")), frame="FLU/ENU"),
        _Rule(r".*", _vector(_RATES, tuple(f"angular_velocity.{a}" for a in "xyz")), "rad/s", "FLU"),
        _Rule(r".*", _vector(_RATES, tuple(f"twist.twist.angular.{a}" for a in "xyz")), "rad/s", "FLU"),
        _Rule(r".*", _vector(_VELOCITY, tuple(f"twist.twist.linear.{a}" for a in "xyz")), "m/s", "FLU"),
        _Rule(r"(?!.*cmd).*", _vector(_VELOCITY, tuple(f"twist.linear.{a}" for a in "xyz")), "m/s", "FLU"),
        _Rule(r".*dvl.*", _vector(_VELOCITY, tuple(f"velocity.{a}" for a in "xyz")), "m/s", "FLU"),
        _Rule(r".*", _vector(_POSITION, tuple(f"pose.pose.position.{a}" for a in "xyz")), "m", "ENU"),
        _Rule(r".*", _vector(_POSITION, tuple(f"pose.position.{a}" for a in "xyz")), "m", "ENU"),
        _Rule(
            r".*", _vector(_POSITION, tuple(f"position.{a}" for a in ("north", "east", "depth"))), "m", "NED"
        ),
        _Rule(r".*", _vector(_EULER, tuple(f"orientation.{a}" for a in ("roll", "pitch", "yaw"))), "rad"),
        _Rule(r".*", _vector(_VELOCITY, tuple(f"body_velocity.{a}" for a in "xyz")), "m/s"),
        _Rule(
            r".*", _vector(_RATES, tuple(f"orientation_rate.{a}" for a in ("roll", "pitch", "yaw"))), "rad/s"
        ),
        _Rule(r".*", {"z_m": "fluid_pressure"}, "Pa", convert="pressure"),
        _Rule(r".*depth.*", {"z_m": "data"}, "m"),
        _Rule(r".*", {"x_m": "latitude"}, "deg", convert="latitude"),
        _Rule(r".*", {"y_m": "longitude"}, "deg", convert="longitude"),
        _Rule(r".*", {"x_m": "pose.position.latitude"}, "deg", convert="latitude"),
        _Rule(r".*", {"y_m": "pose.position.longitude"}, "deg", convert="longitude"),
        _Rule(r".*(batt|power).*", {"voltage_v": "voltage"}, "V"),
        _Rule(
            r".*(wrench|force|thrust|tau).*",
            _vector(("tau.X_n", "tau.Y_n", "tau.Z_n"), tuple(f"wrench.force.{a}" for a in "xyz")),
            "N",
            "FLU",
        ),
        _Rule(
            r".*(wrench|force|thrust|tau).*",
            _vector(("tau.K_nm", "tau.M_nm", "tau.N_nm"), tuple(f"wrench.torque.{a}" for a in "xyz")),
            "N*m",
            "FLU",
        ),
    ),
}
_SAME = {"rosbag": "ros", "mcap": "ros"}

_MEASURED = re.compile(r"(actual|meas\w*|feedback|fb|telemetry|_act)\b", re.IGNORECASE)
_ANGLES = re.compile(r"(rudder|elevator|plane|fin|aileron|delta)", re.IGNORECASE)


@dataclass(frozen=True)
class RecognitionSettings:
    """How proposals for a column are ranked."""

    fewest: int = 10  #: numbers of a field that is taken for something
    named_rank: int = 10_000  #: of what a field is by its name, behind what its message says
    planar_rank: int = 50  #: of messages in the plane, behind those in space
    converted_rank: int = 50  #: of what becomes a column by a conversion, behind the column itself


RECOGNITION_SETTINGS = RecognitionSettings()

_FIRST_MOTOR, _MOTORS = 33, 8  # ArduPilot: SERVOn_FUNCTION 33 to 40 are motors 1 to 8


def propose(format: str, topics: Sequence[Topic], parameters: Mapping[str, float]) -> list[Proposal]:
    """Proposals for all fields, the better one of each canonical column first.

    Parameters
    ----------
    format
        Format of the log (`seatrial.logs.log`).
    topics
        What its topics hold.
    parameters
        Parameters of the vehicle that the log carries (ArduSub's tell which channel drives what).
    """
    proposals = [*_documented(format, topics), *_actuators(format, topics, parameters)]
    if format in ("csv", "parquet", "matlab") or not proposals:
        proposals += _by_name(topics)
    elif _SAME.get(format) == "ros":
        # Any message may be recorded; of one that is not documented the names tell something.
        documented = {proposal.topic for proposal in proposals}
        others = _by_name([topic for topic in topics if topic.name not in documented])
        proposals += [
            replace(proposal, rank=proposal.rank + RECOGNITION_SETTINGS.named_rank) for proposal in others
        ]
    return sorted(proposals, key=lambda proposal: (proposal.canonical, proposal.rank))


def _documented(format: str, topics: Sequence[Topic]) -> Iterator[Proposal]:
    rules = _DOCUMENTED.get(_SAME.get(format, format), ())
    for rank, rule in enumerate(rules):
        for topic in topics:
            if topic.samples < RECOGNITION_SETTINGS.fewest or not re.fullmatch(
                rule.topic, topic.name, re.IGNORECASE
            ):
                continue
            fields = {field.name: field for field in topic.fields if field.name in rule.fields.values()}
            if len(fields) < len(rule.fields):
                continue
            dead = all(_constant(fields[name]) for name in rule.fields.values())
            for canonical, name in rule.fields.items():
                why = f"{format} documents {topic.name}.{name}" + ("; it never changes" if dead else "")
                if estimated := of_estimator(format, topic.name):
                    why = (
                        f"velocity of the estimator, {topic.name}.{name}: no measurement"
                        + "; it never changes" * dead
                    )
                convert = _TO_BODY[canonical] if rule.convert == _EARTH else rule.convert
                yield Proposal(
                    canonical, topic.name, name, rule.unit, rule.frame, rule.sign, rule.per, convert,
                    why=why, rank=rank + 100 * dead, estimated=estimated,
                )  # fmt: skip
    if _SAME.get(format) == "ros":
        yield from _planar(topics)


_ESTIMATORS = {
    ("dataflash", "XKF1"), ("dataflash", "NKF1"), ("mavlink", "GLOBAL_POSITION_INT"),
    ("ulog", "vehicle_local_position"), ("mavlink", "LOCAL_POSITION_NED"),
}  # fmt: skip


def of_estimator(format: str, topic: str) -> bool:
    """Whether a topic holds what a filter of the autopilot estimates."""
    return (format, topic.partition("[")[0]) in _ESTIMATORS


_TO_BODY = {"u_m_s": "north", "v_m_s": "east", "w_m_s": "down"}


def _planar(topics: Sequence[Topic]) -> Iterator[Proposal]:
    """Poses and velocities in the plane, by the message type and by its form: x and y, theta, no z.

    Types as geometry_msgs/Pose2D, nav_2d_msgs/Twist2D, vision_msgs/Pose2D and turtlesim/Pose: theta is an
    angle about the vertical axis, never a pitch.
    """
    for topic in topics:
        names = {field.name for field in topic.fields}
        if topic.samples < RECOGNITION_SETTINGS.fewest or re.search(
            r"cmd|command|goal|target|set_?point|desired", topic.name
        ):
            continue
        for theta in sorted(name for name in names if re.fullmatch(r"(.*\.)?theta", name)):
            before = theta.removesuffix("theta")
            place = next((p for p in ("", "position.", "center.") if f"{before}{p}x" in names), None)
            if place is None or f"{before}{place}y" not in names or f"{before}{place}z" in names:
                continue
            why = f"{topic.kind or 'the form of the message'}: a motion in the plane"
            moving = "twist2d" in topic.kind.lower() or before.endswith(("velocity.", "twist."))
            columns = _PLANAR_VELOCITY if moving else _PLANAR_POSE
            fields = (f"{before}{place}x", f"{before}{place}y", theta)
            for name, (canonical, unit, frame) in zip(fields, columns, strict=True):
                yield Proposal(
                    canonical, topic.name, name, unit, frame, why=why, rank=RECOGNITION_SETTINGS.planar_rank
                )
            for name, canonical, unit in _TURTLE:
                if f"{before}{name}" in names:
                    yield Proposal(
                        canonical,
                        topic.name,
                        f"{before}{name}",
                        unit,
                        "FLU",
                        why=why,
                        rank=RECOGNITION_SETTINGS.planar_rank,
                    )


_PLANAR_POSE = (("x_m", "m", "ENU"), ("y_m", "m", "ENU"), ("yaw_deg", "rad", "FLU/ENU"))
_PLANAR_VELOCITY = (("u_m_s", "m/s", "FLU"), ("v_m_s", "m/s", "FLU"), ("r_deg_s", "rad/s", "FLU"))
_TURTLE = (("linear_velocity", "u_m_s", "m/s"), ("angular_velocity", "r_deg_s", "rad/s"))


def _constant(field: Field) -> bool:
    return not field.samples or field.minimum == field.maximum


def _actuators(format: str, topics: Sequence[Topic], parameters: Mapping[str, float]) -> Iterator[Proposal]:
    """Motors and fins of ArduPilot and PX4 by their output channels, of ROS and IMC by topics."""
    for topic in topics:
        name = topic.name
        if format == "dataflash" and name == "RCOU":
            yield from _channels(topic, "C", "", parameters)
        elif format == "mavlink" and re.fullmatch(r"SERVO_OUTPUT_RAW(\[0\])?", name):
            yield from _channels(topic, "servo", "_raw", parameters)
        elif format == "ulog" and name == "actuator_outputs":
            for field in topic.fields:
                if re.fullmatch(r"output\[\d+\]", field.name) and not _constant(field):
                    number = int(field.name[7:-1]) + 1
                    unit = "us" if 700.0 < field.maximum < 2500.0 else ""
                    yield Proposal(
                        f"cmd.output_{number}", name, field.name, unit, why="output channel of PX4"
                    )
        elif _SAME.get(format) == "ros" and actuator_of(name):
            for field in topic.fields:
                if field.name.rpartition(".")[2].partition("[")[0] in (
                    "data",
                    "value",
                    "effort",
                    "velocity",
                    "rpm",
                    "output",
                    "input",
                    "angle",
                ):
                    several = sum("stamp" not in other.name for other in topic.fields) > 1
                    label = _label(name + (f"_{field.name}" if several else ""))
                    yield _actuator(label, topic, field, "name of the topic")
        elif format == "imc" and re.match(
            r"(Rpm|ServoPosition|SetThrusterActuation|SetServoPosition)\b", name
        ):
            for field in topic.fields:
                if field.name == "value" and not _constant(field):
                    kind = "meas" if name.startswith(("Rpm", "ServoPosition")) else "cmd"
                    label = _label(name.replace("[", "_").rstrip("]"))
                    unit = {"Rpm": "rpm", "ServoPosition": "rad", "SetServoPosition": "rad"}.get(
                        name.partition("[")[0], ""
                    )
                    yield Proposal(f"{kind}.{label}", name, "value", unit, why="IMC documents it")


def _channels(topic: Topic, before: str, after: str, parameters: Mapping[str, float]) -> Iterator[Proposal]:
    fields = {field.name: field for field in topic.fields}
    known = any(key.startswith("SERVO") and key.endswith("_FUNCTION") for key in parameters)
    for channel in range(1, 17):
        name = f"{before}{channel}{after}"
        if name not in fields:
            continue
        function = parameters.get(f"SERVO{channel}_FUNCTION")
        if known:
            if function is None or not _FIRST_MOTOR <= function < _FIRST_MOTOR + _MOTORS:
                continue
            motor, why = (int(function) - _FIRST_MOTOR + 1, f"SERVO{channel}_FUNCTION = {function:g}: motor")
        else:
            field = fields[name]  # one damaged sample does not make a motor something else
            pulses = any(700.0 < size < 2500.0 for size in (field.maximum, field.mean))
            if channel > _MOTORS or not pulses:
                continue
            motor, why = channel, "the log has no SERVOn_FUNCTION: channel n taken as motor n"
        yield Proposal(f"cmd.thruster_{motor}", topic.name, name, "us", why=why, certain=known)


def _label(text: str) -> str:
    """Name of an actuator from that of a topic or field."""
    plain = re.sub(r"\W+", "_", text).strip("_").lower()
    plain = re.sub(r"_(data|value|cmd|command|desired|setpoint|raw|input|output)$", "", plain)
    return re.sub(r"^(cmd|command|desired|set|actuators?)_", "", plain) or "actuator"


def _by_name(topics: Sequence[Topic]) -> Iterator[Proposal]:
    """Proposals from names, for logs whose format says nothing about its fields."""
    for topic in topics:
        matched = list(_matched(topic))
        earth = _ros_earth(topic.fields)
        angles = [
            field
            for quantity, field, _ in matched
            if quantity.endswith("_deg") and not quantity.startswith(("cmd.", "meas."))
        ]
        # Of what is a rate by its name and does not tell its unit.
        rates = [f for quantity, f, _ in matched if quantity in _RATES and not _told_unit(f)]
        for quantity, field, rank in matched:
            canonical, convert = _CONVERTED.get(quantity, (quantity, ""))
            unit, why, certain = _unit(quantity, field, angles, rates)
            if convert == "pressure" and unit not in PRESSURES:
                continue
            if quantity == "z_m" and unit in PRESSURES:
                convert = "pressure"
            axes = "" if convert else _frame(canonical, field.name, earth)
            yield Proposal(
                canonical, topic.name, field.name, unit, axes, convert=convert,
                why=f"its name; {why}" + ("; frame as in ROS, by the names" if axes else ""),
                certain=certain and not axes, rank=rank + 1000 * _constant(field), named=True,
            )  # fmt: skip


_CONVERTED = {
    "latitude": ("x_m", "latitude"),
    "longitude": ("y_m", "longitude"),
    "pressure": ("z_m", "pressure"),
    "north": ("u_m_s", "north"),
    "east": ("v_m_s", "east"),
    "down": ("w_m_s", "down"),
}
"""Quantities that become a canonical column by more than a unit: the column, and the conversion."""


def _matched(topic: Topic) -> Iterator[tuple[str, Field, int]]:
    """Quantity, field and rank of each field whose name is known and that holds numbers."""
    before = [] if topic.of_file else words_of(re.sub(r" \(\d+ rows\)$", "", topic.name))
    paths = [_path(field.name) for field in topic.fields]
    beside: dict[tuple[str, ...], set[str]] = {}
    for first, last in paths:
        beside.setdefault(first, set()).add(last)
    for field, (first, _) in zip(topic.fields, paths, strict=True):
        if field.samples >= RECOGNITION_SETTINGS.fewest:
            known = _known(before, field, beside[first])
            if known is not None:
                yield known[0], field, known[1]


@lru_cache(maxsize=65_536)  # the topics of a log share the names of their fields
def _path(name: str) -> tuple[tuple[str, ...], str]:
    """Words of a field's name before the last one, and that one."""
    *first, last = words_of(suffix_of(name)[0]) or [""]
    return tuple(first), last


def named_but_empty(topics: Sequence[Topic]) -> Iterator[tuple[str, Topic, Field]]:
    """Canonical column, topic and field of fields whose name is known and that hold too few numbers."""
    for topic in topics:
        for field in topic.fields:
            known = _known([], field, set()) if field.samples < RECOGNITION_SETTINGS.fewest else None
            if known is not None:
                yield _CONVERTED.get(known[0], known)[0], topic, field


def _known(before: Sequence[str], field: Field, beside: set[str]) -> tuple[str, int] | None:
    """Quantity and rank of a field by its name and the words before it; None where these say nothing."""
    name, stated = field.name, unit_of(field.unit) or ""
    if re.fullmatch(r"(t|time\w*|stamp\w*|sec|secs|nsecs?|index|column_\d+)", name.lower()):
        return None
    if name.lower().startswith(("cmd.", "meas.", "tau.")):
        canonical = (canonical_of(name) or (name, ""))[0]
        return (canonical, 0) if misfit_of(name) is None and fits(canonical, stated) else None
    if (own := canonical_of(name)) is not None and fits(own[0], stated):
        return (own[0], 0) if own[0] != "t_s" else None
    stem, unit = suffix_of(name)
    # A suffix of another dimension is a word of the name: "vel_n" is a velocity north, not one in newton.
    for part, by_suffix in ((stem, unit), (name, "")):
        quantity = quantity_of("/".join([*before, part]), beside)
        if quantity is not None and fits(quantity[0], stated or by_suffix):
            return quantity[0], quantity[1] + RECOGNITION_SETTINGS.converted_rank * (
                quantity[0] in _CONVERTED
            )
    path = "_".join([*before, stem])
    if actuator_of(path) and fits("cmd.", stated or unit):
        label = re.sub(r"_(deg|rad|rpm|us|pwm|n)$", "", _label(stem)) or _label(name)
        label = label if actuator_of(stem) else _label(path)  # a structure "fins" says what "upper" is
        return f"{'meas' if _MEASURED.search(name) else 'cmd'}.{label}", 0
    return None


def _ros_earth(fields: Sequence[Field]) -> str:
    """Earth frame of fields that are called as ROS calls them, with axes of REP 103; "" for other fields."""
    names = "\n".join(field.name.lower() for field in fields)
    if re.search(r"(?m)header[./_](stamp|seq|frame_id)|^%time$", names):
        return "ENU"
    attitude = re.search(r"(?m)orientation[._/]w$", names)
    moving = re.search(r"(?m)(^|[._/])(linear|angular)", names)
    return "NWU" if attitude and moving else ""


def _frame(canonical: str, name: str, earth: str) -> str:
    """Frame of a column where the fields are called as ROS calls them, in its `earth` frame."""
    last = (words_of(name) or [""])[-1]
    if not earth or "depth" in last:
        return ""
    if canonical in _Q or last == "theta":
        return f"FLU/{earth}"
    if canonical in _POSITION:
        return earth
    return "FLU" if canonical in (*_RATES, *_VELOCITY) or canonical.startswith("tau.") else ""


def _unit(
    canonical: str, field: Field, angles: Sequence[Field], rates: Sequence[Field] = ()
) -> tuple[str, str, bool]:
    """Unit of a field, what it was told from, and whether that is certain.

    The attitude's `angles`, and the `rates` of a gyro, have one unit: the largest of them tells it.
    """
    if (stated := _told_unit(field)) and fits(canonical, stated[0]):
        return *stated, True
    # The log does not say: the range decides where two units cannot be mistaken.
    largest, how = _largest([field]), "by its range"
    if canonical.startswith(("cmd.", "meas.")):
        return _actuator_unit(field, largest)
    if canonical.endswith("_deg_s"):
        # All rates of a message share a unit, as all angles do: the largest one tells it.
        unit, how = "deg/s" if _largest([field, *rates]) > 6.0 else "rad/s", "by the range of the rates"
    elif canonical.endswith("_deg"):
        widest = _largest([field, *angles])
        unit, how = "deg" if widest > 2.0 * math.pi + 0.1 else "rad", "by the range of the angles"
    elif canonical in ("latitude", "longitude"):
        unit = "1e-7 deg" if largest > 1000.0 else "deg"
    elif canonical == "pressure" or (canonical == "z_m" and field.minimum > 8e4):
        return "Pa" if largest > 8e4 else "", "a pressure in Pa by its range", False
    elif canonical.endswith("_m_s") or canonical in ("north", "east", "down"):
        unit = "mm/s" if field.deviation > 40.0 or largest > 300.0 else "cm/s" if largest > 30.0 else "m/s"
    elif canonical == "voltage_v":
        unit = "mV" if largest > 1000.0 else "V"
    elif canonical.startswith("q_"):
        return "", "no unit", False
    else:
        unit, how = {"_n": "N", "nm": "N*m"}.get(canonical[-2:], "m"), "assumed"
    return unit, f"unit {unit} {how}", False


def _largest(fields: Sequence[Field]) -> float:
    return max(max(abs(field.minimum), abs(field.maximum)) for field in fields)


def unknown_unit(proposal: Proposal, field: Field) -> bool:
    """Whether a field that was told by its name states a unit that is not known.

    Examples
    --------
    >>> field = Field("yaw", "grad", 50, -1.0, 1.0, 0.0, 0.5, 0.0)
    >>> unknown_unit(Proposal("yaw_deg", "nav", "yaw", "rad", named=True), field)
    True
    """
    unit = field.unit.strip()
    return not no_unit(unit) and unit_of(unit) is None and proposal.named


def _told_unit(field: Field) -> tuple[str, str] | None:
    """Unit of a field that states it or has it in its name, and which of both; None where it has neither."""
    if stated := unit_of(field.unit):
        return stated, f"unit {field.unit} stated"
    if unit := (canonical_of(field.name) or suffix_of(field.name))[1]:
        return unit, f"unit {unit} by its name"
    return None


def _actuator(label: str, topic: Topic, field: Field, why: str) -> Proposal:
    unit, how, _ = _unit(f"cmd.{label}", field, ())
    kind = "meas" if _MEASURED.search(topic.name + "." + field.name) else "cmd"
    return Proposal(f"{kind}.{label}", topic.name, field.name, unit, why=f"{why}; {how}", certain=False)


def _actuator_unit(field: Field, largest: float) -> tuple[str, str, bool]:
    if _ANGLES.search(field.name):
        unit = "deg" if largest > 1.6 else "rad"
        return unit, f"unit {unit} by its range", False
    if field.minimum > 700.0 and largest < 2500.0 and 1300.0 < field.mean < 1700.0:
        return "us", "pulse width in us by its range", False
    if largest > 100.0:
        return "rpm", "rpm by its range", False
    return "", "no unit known: state one", False
