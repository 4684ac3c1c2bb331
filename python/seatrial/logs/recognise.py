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
from dataclasses import dataclass

from seatrial.logs.log import Field, Topic

__all__ = ["FEWEST", "KNOWN_UNITS", "Proposal", "named_but_empty", "propose", "unknown_unit"]


@dataclass(frozen=True)
class Proposal:
    """What a field probably is.

    Attributes
    ----------
    canonical
        Canonical column (`seatrial.trial.columns`).
    topic, name
        The field.
    unit, frame, sign
        As in a column map; "" and 1 for those of the canonical column.
    per
        Field of the same topic by which each sample is divided: the time a displacement took. "" for none.
    convert
        "latitude", "longitude" or "pressure" for what needs more than a unit.
    why
        What it was told from.
    certain
        Whether the log documents it; otherwise it is a guess to look at.
    rank
        Smaller is better, among proposals for one canonical column.
    """

    canonical: str
    topic: str
    name: str
    unit: str = ""
    frame: str = ""
    sign: int = 1
    per: str = ""
    convert: str = ""
    why: str = ""
    certain: bool = True
    rank: int = 0

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
    ),
    "ulog": (
        _Rule(r"vehicle_attitude", _vector(_Q, tuple(f"q[{k}]" for k in range(4)))),
        _Rule(r"vehicle_angular_velocity", _vector(_RATES, tuple(f"xyz[{k}]" for k in range(3))), "rad/s"),
        _Rule(r"sensor_combined", _vector(_RATES, tuple(f"gyro_rad[{k}]" for k in range(3))), "rad/s"),
        _Rule(r"vehicle_attitude", _vector(_RATES, ("rollspeed", "pitchspeed", "yawspeed")), "rad/s"),
        _Rule(r"vehicle_local_position", _vector(_POSITION, ("x", "y", "z")), "m", "NED"),
        _Rule(r"battery_status", {"voltage_v": "voltage_v"}, "V"),
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
        _Rule(r".*", {"z_m": "fluid_pressure"}, "Pa", convert="pressure"),
        _Rule(r".*depth.*", {"z_m": "data"}, "m"),
        _Rule(r".*", {"x_m": "latitude"}, "deg", convert="latitude"),
        _Rule(r".*", {"y_m": "longitude"}, "deg", convert="longitude"),
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

_NAMES: tuple[tuple[str, str], ...] = (
    # canonical, pattern of the whole name in lower case without unit
    ("roll_deg", r"roll|phi|heel|roll_?angle|euler_?x|att(itude)?_?(x|roll)"),
    ("pitch_deg", r"pitch|theta|pitch_?angle|euler_?y|att(itude)?_?(y|pitch)"),
    ("yaw_deg", r"yaw|heading|psi|hdg|compass|yaw_?angle|azimuth|euler_?z|att(itude)?_?(z|yaw)"),
    ("q_w", r"(q|quat\w*|orientation)[_.]?(w|0)"),
    ("q_x", r"(quat\w*|orientation)[_.]?(x|1)|qx|q_x|q1"),
    ("q_y", r"(quat\w*|orientation)[_.]?(y|2)|qy|q_y|q2"),
    ("q_z", r"(quat\w*|orientation)[_.]?(z|3)|qz|q_z|q3"),
    ("p_deg_s", r"p|roll_?(rate|speed)|p_?dot_?phi|(gyro?|gyr|omega|angular(_?vel\w*)?|w|ang_?vel)[_.]?x"),
    ("q_deg_s", r"q|pitch_?(rate|speed)|(gyro?|gyr|omega|angular(_?vel\w*)?|w|ang_?vel)[_.]?y"),
    ("r_deg_s", r"r|yaw_?(rate|speed)|turn_?rate|rot|(gyro?|gyr|omega|angular(_?vel\w*)?|w|ang_?vel)[_.]?z"),
    ("u_water_m_s", r"(u|vx|surge|speed)_?(water|btw|stw)|stw|speed_?through_?water|water_?(u|vx)"),
    ("v_water_m_s", r"(v|vy|sway)_?(water|btw|stw)|water_?(v|vy)"),
    ("w_water_m_s", r"(w|vz|heave)_?(water|btw|stw)|water_?(w|vz)"),
    (
        "u_m_s",
        r"u|surge(_?(vel\w*|speed))?|vx|v_?x|vel\w*[_.]?x|linear[_.]?x|dvl[_.]?(vel)?_?x|vb?x|vel_?fwd|speed|sog",
    ),
    ("v_m_s", r"v|sway(_?(vel\w*|speed))?|vy|v_?y|vel\w*[_.]?y|linear[_.]?y|dvl[_.]?(vel)?_?y|vby"),
    ("w_m_s", r"w|heave(_?(vel\w*|speed))?|vz|v_?z|vel\w*[_.]?z|linear[_.]?z|dvl[_.]?(vel)?_?z|vbz"),
    ("x_m", r"north(ing)?|x|x_?n(ed)?|pos(ition)?[_.]?(x|n|north)|n_m"),
    ("y_m", r"east(ing)?|y|y_?e|pos(ition)?[_.]?(y|e|east)|e_m"),
    ("z_m", r"depth|z|pos(ition)?[_.]?(z|d|down)|depth_?m"),
    ("tau.X_n", r"(force|tau|wrench_?force)[_.]?x|tau_?(surge|1)|fx"),
    ("tau.Y_n", r"(force|tau|wrench_?force)[_.]?y|tau_?(sway|2)|fy"),
    ("tau.Z_n", r"(force|tau|wrench_?force)[_.]?z|tau_?(heave|3)|fz"),
    ("tau.K_nm", r"(torque|moment)[_.]?x|tau_?(roll|4|k)|mx"),
    ("tau.M_nm", r"(torque|moment)[_.]?y|tau_?(pitch|5|m)|my"),
    ("tau.N_nm", r"(torque|moment)[_.]?z|tau_?(yaw|6|n)|mz"),
    ("voltage_v", r"volt(age)?(_?\w*)?|v_?bat\w*|bat\w*_?v(olt\w*)?|supply_?v\w*"),
    ("current_north_m_s", r"current_?(n|north)"),
    ("current_east_m_s", r"current_?(e|east)"),
)

_ACTUATOR = re.compile(
    r"(thruster|motor|prop(eller)?|esc|rudder|elevator|stern_?plane|bow_?plane|planes?|fin|servo|aileron|rpm|pwm|"
    r"pulse_?width|positive_width_us|channel|rc_?out|n_?\d|delta)",
    re.IGNORECASE,
)
_MEASURED = re.compile(r"(actual|meas\w*|feedback|fb|telemetry|_act)\b", re.IGNORECASE)
_ANGLES = re.compile(r"(rudder|elevator|plane|fin|aileron|delta)", re.IGNORECASE)
_SUFFIX = (
    (r"rad[_/]?s(ec)?", "rad/s"), (r"deg[_/]?s(ec)?", "deg/s"), (r"mm[_/]s", "mm/s"), (r"cm[_/]s", "cm/s"),
    (r"km[_/]?h|kmh|kph", "km/h"), (r"m[_/]s|mps", "m/s"), (r"kn|kts?|knots?", "knot"), (r"mrad", "mrad"),
    (r"rad(ians)?", "rad"), (r"deg(rees)?", "deg"), (r"mm", "mm"), (r"cm", "cm"), (r"m", "m"),
    (r"rpm", "rpm"), (r"us|µs|usec|pwm", "us"), (r"mv", "mV"), (r"v", "V"), (r"dbar", "dbar"),
    (r"mbar", "mbar"), (r"k?pa", "kPa"), (r"nm", "N*m"), (r"n", "N"),
)  # fmt: skip
_STATED = {
    "m/s": "m/s", "mm/s": "mm/s", "cm/s": "cm/s", "km/h": "km/h", "kn": "knot", "kt": "knot", "kts": "knot",
    "knot": "knot", "knots": "knot", "rad": "rad", "deg": "deg", "°": "deg", "degrees": "deg", "mrad": "mrad",
    "rad/s": "rad/s", "deg/s": "deg/s", "°/s": "deg/s", "m": "m", "cm": "cm", "mm": "mm", "n": "N",
    "nm": "N*m", "n*m": "N*m", "n m": "N*m", "v": "V", "mv": "mV", "rpm": "rpm", "1/min": "rpm",
    "us": "us", "µs": "us", "dbar": "dbar", "bar": "bar", "mbar": "mbar", "pa": "Pa", "kpa": "kPa",
    "hpa": "hPa", "rev/s": "rev/s", "cdeg": "0.01 deg", "cdegrees": "0.01 deg", "pwm": "us",
}  # fmt: skip
KNOWN_UNITS = tuple(dict.fromkeys(_STATED.values()))
"""As a log may state them, in the words of a map."""

FEWEST = 10
"""Numbers of a field that is taken for something."""

_PRESSURES = ("dbar", "bar", "mbar", "Pa", "kPa", "hPa")


def propose(format: str, topics: Sequence[Topic], parameters: Mapping[str, float]) -> list[Proposal]:
    """Proposals for all fields, the better one of each canonical column first.

    Parameters
    ----------
    format
        Format of the log (`seatrial.logs.formats`).
    topics
        What its topics hold.
    parameters
        Parameters of the vehicle that the log carries (ArduSub's tell which channel drives what).
    """
    found = [*_documented(format, topics), *_actuators(format, topics, parameters)]
    if format in ("csv", "parquet", "matlab") or not found:
        found += _by_name(topics)
    return sorted(found, key=lambda proposal: (proposal.canonical, proposal.rank))


def _documented(format: str, topics: Sequence[Topic]) -> Iterator[Proposal]:
    rules = _DOCUMENTED.get(_SAME.get(format, format), ())
    for rank, rule in enumerate(rules):
        for topic in topics:
            fields = {field.name: field for field in topic.fields}
            if not re.fullmatch(rule.topic, topic.name, re.IGNORECASE) or topic.samples < FEWEST:
                continue
            if not set(rule.fields.values()) <= set(fields):
                continue
            dead = all(_constant(fields[name]) for name in rule.fields.values())
            for canonical, name in rule.fields.items():
                why = f"{format} documents {topic.name}.{name}" + ("; it never changes" if dead else "")
                yield Proposal(
                    canonical, topic.name, name, rule.unit, rule.frame, rule.sign, rule.per, rule.convert,
                    why=why, rank=rank + 100 * dead,
                )  # fmt: skip


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
        elif _SAME.get(format) == "ros" and _ACTUATOR.search(name):
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


_FIRST_MOTOR, _MOTORS = 33, 8  # ArduPilot: SERVOn_FUNCTION 33 to 40 are motors 1 to 8


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
            motor, why = int(function) - _FIRST_MOTOR + 1, f"SERVO{channel}_FUNCTION = {function:g}: motor"
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
        frame = _ros_like({field.name.lower() for field in topic.fields})
        angles = [
            f
            for canonical, f, _ in matched
            if canonical.endswith("_deg") and not canonical.startswith(("cmd.", "meas."))
        ]
        # Of what is a rate by its name and does not tell its unit.
        rates = [f for canonical, f, _ in matched if canonical in _RATES and not _told_unit(f)]
        for canonical, field, rank in matched:
            unit, why, certain = _unit(canonical, field, angles, rates)
            convert = "pressure" if canonical == "z_m" and unit in _PRESSURES else ""
            axes = _frame(canonical, frame)
            yield Proposal(
                canonical, topic.name, field.name, unit, axes, convert=convert,
                why=f"its name; {why}" + ("; frame as in ROS, by the names" if axes else ""),
                certain=certain and not axes, rank=rank + 1000 * _constant(field),
            )  # fmt: skip


def _matched(topic: Topic) -> Iterator[tuple[str, Field, int]]:
    """Canonical column, field and rank of each field whose name is known and that holds numbers."""
    for field in topic.fields:
        known = _known(topic.name, field) if field.samples >= FEWEST else None
        if known is not None:
            yield known[0], field, known[1]


def named_but_empty(topics: Sequence[Topic]) -> Iterator[tuple[str, Topic, Field]]:
    """Canonical column, topic and field of fields whose name is known and that hold too few numbers."""
    for topic in topics:
        for field in topic.fields:
            known = _known("", field) if field.samples < FEWEST else None
            if known is not None:
                yield known[0], topic, field


def _known(topic: str, field: Field) -> tuple[str, int] | None:
    """Canonical column and rank of a field by its name and its topic's; None where these say nothing."""
    plain = _plain(field.name)
    if re.fullmatch(r"(t|time\w*|stamp\w*|sec|secs|nsecs?|index|column_\d+)", plain):
        return None
    if plain.startswith(("cmd.", "meas.", "tau.")):
        return field.name, 0
    inner = plain.rpartition(".")[2]
    for name in (plain, inner):
        for canonical, pattern in _NAMES:
            if re.fullmatch(pattern, name):
                return canonical, len(plain)
    if _ACTUATOR.search(plain) or (_ACTUATOR.search(topic.lower()) and re.fullmatch(r"\w+", plain)):
        label = re.sub(r"_(deg|rad|rpm|us|pwm|n)$", "", _label(plain)) or _label(plain)
        kind = "meas" if _MEASURED.search(field.name) else "cmd"
        return f"{kind}.{label}", 0
    return None


def _plain(name: str) -> str:
    """A field's name in lower case without its unit."""
    plain = re.sub(r"\s*[\[(][^\])]*[\])]\s*$", "", name).strip().lower().replace(" ", "_")
    for pattern, _ in _SUFFIX:
        shorter = re.sub(rf"_({pattern})$", "", plain)
        if shorter != plain and shorter:
            return shorter
    return plain


def _ros_like(names: set[str]) -> bool:
    """Whether fields are called as ROS calls them: then axes are those of REP 103, z up."""
    return bool({"orientation_w", "orientation.w"} & names) and any(
        n.startswith(("linear", "angular")) for n in names
    )


def _frame(canonical: str, ros: bool) -> str:
    if not ros:
        return ""
    if canonical in _Q:
        return "FLU/NWU"
    if canonical in _POSITION:
        return "NWU"
    return "FLU" if canonical in (*_RATES, *_VELOCITY) or canonical.startswith("tau.") else ""


def _unit(
    canonical: str, field: Field, angles: Sequence[Field], rates: Sequence[Field] = ()
) -> tuple[str, str, bool]:
    """Unit of a field, what it was told from, and whether that is certain.

    The attitude's `angles`, and the `rates` of a gyro, have one unit: the largest of them tells it.
    """
    if told := _told_unit(field):
        return *told, True
    largest = max(abs(field.minimum), abs(field.maximum))
    if canonical.startswith(("cmd.", "meas.")):
        return _actuator_unit(field, largest)
    if canonical.endswith("_deg_s"):
        fastest = max((max(abs(r.minimum), abs(r.maximum)) for r in rates), default=largest)
        unit = "deg/s" if max(fastest, largest) > 6.0 else "rad/s"
        return unit, f"unit {unit} by the range of the rates", False
    if canonical.endswith("_deg"):
        widest = max((max(abs(a.minimum), abs(a.maximum)) for a in angles), default=largest)
        unit = "deg" if widest > 2.0 * math.pi + 0.1 else "rad"
        return unit, f"unit {unit} by the range of the angles", False
    if canonical.endswith("_m_s"):
        unit = "mm/s" if field.deviation > 40.0 or largest > 300.0 else "cm/s" if largest > 30.0 else "m/s"
        return unit, f"unit {unit} by its range", False
    if canonical == "voltage_v":
        unit = "mV" if largest > 1000.0 else "V"
        return unit, f"unit {unit} by its range", False
    if canonical == "z_m":
        if field.minimum > 8e4:
            return "Pa", "a pressure in Pa by its range", False
        return "m", "unit m assumed", False
    if canonical.startswith("tau."):
        unit = "N" if canonical.endswith("_n") else "N*m"
        return unit, f"unit {unit} assumed", False
    return ("", "no unit", False) if canonical.startswith("q_") else ("m", "unit m assumed", False)


def unknown_unit(one: Proposal, field: Field) -> bool:
    """Whether a field that was told by its name states a unit that is not known.

    Examples
    --------
    >>> field = Field("yaw", "grad", 50, -1.0, 1.0, 0.0, 0.5, 0.0)
    >>> unknown_unit(Proposal("yaw_deg", "nav", "yaw", "rad", why="its name; unit rad by its range"), field)
    True
    """
    unit = field.unit.strip().lower()
    return unit not in ("", "%", *_STATED) and one.why.startswith("its name")


def _told_unit(field: Field) -> tuple[str, str] | None:
    """Unit of a field that states it or has it in its name, and which of both; None where it has neither."""
    if stated := _STATED.get(field.unit.strip().lower()):
        return stated, f"unit {field.unit} stated"
    lower = field.name.lower().strip()
    for pattern, unit in _SUFFIX:
        if re.search(rf"[_\s(\[]({pattern})[)\]]?$", lower):
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
