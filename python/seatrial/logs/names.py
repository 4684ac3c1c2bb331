"""What a column is called: its quantity by all words of its name, and its unit.

A name is a path of words: ``field.velocity.x``, ``C True Heading``, ``GPS Speed``. Words that only say where
a message came from carry no meaning (`_PLACES`); words that make another quantity of it, as ``covariance`` or
``goal`` do, leave the column alone (`_OTHER`). What is left is compared as a whole with the names of each
canonical column: never its last word alone, because an x may be a position, a force or a field of the earth.
A unit of another dimension makes another quantity, too: a ``v`` in volt is no velocity. Held by
``tests/logs/test_recognise.py``.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable
from functools import lru_cache


def words_of(name: str) -> list[str]:
    """Words of a path in lower case: between separators and at changes of case.

    Examples
    --------
    >>> words_of("field.angularVelocity.x"), words_of("C True Heading"), words_of("GyrX"), words_of("q[0]")
    (['field', 'angular', 'velocity', 'x'], ['c', 'true', 'heading'], ['gyr', 'x'], ['q', '0'])
    """
    apart = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name)
    return [word for word in re.split(r"[^a-z0-9]+", apart.lower()) if word]


def _set(words: str) -> frozenset[str]:
    return frozenset(words.split())


_PLACES = _set(
    "field data msg message value values pose twist state states odom odometry nav navigation imu ahrs "
    "ins dvl est estimate estimated estimator filtered filter vehicle auv rov uuv robot body base link "
    "sensor sensors ekf ctd with stamped measured meas local global wrench compass mavlink angle c dfs "
    "calc calculated vector gps raw "
)
"""Where a column comes from: no quantity. They are dropped only where the name without them is known."""

_OTHER = _set(
    "covariance cov variance var std stddev sigma error err noise bias offset setpoint sp desired target "
    "goal next ref reference request requested wanted commanded acceleration accel acc accelerometer "
    "magnetic_field mag magnetometer header seq stamp count status flags flag temperature temp mode id "
    "valid validity quality fom gain kp ki kd limit min max minimum maximum bottom floor total column "
    "dist distance to since track variation declination hdop nsats sats bearing course range altitude "
    "height sound index version dt delta time humidity leak voltage_cell "
)
"""They make another quantity of a name than its other words say."""

_STRONG = _set(
    "velocity vel position pos orientation quaternion quat force torque moment angular linear gyro gyr "
    "omega attitude euler rpy rate rates speed translation point center acceleration "
)
"""Words that decide what an axis behind them means."""

_ATTITUDE = r"((orientation|att(itude)?|rpy|euler)_)?"
_GYRO = r"(gyro?|gyr|omega|angular(_?(vel\w*|rates?))?|w|ang_?vel|rates?|(rotation|orientation)_rate)"
_SPEED = r"(vel\w*|linear(_vel\w*)?|dvl(_?vel)?|speed)"
_PLACE = r"(pos(ition)?|translation|point)"

_NAMES: tuple[tuple[str, str], ...] = (
    # quantity, pattern of the whole name: its words joined by "_", without unit
    ("roll_deg", _ATTITUDE + r"(roll|phi|heel)(_angle)?|(euler|rpy|att(itude)?)_?x"),
    ("pitch_deg", _ATTITUDE + r"(pitch|theta)(_angle)?|(euler|rpy|att(itude)?)_?y"),
    ("yaw_deg", _ATTITUDE + r"(true_|magnetic_)?(yaw|heading|psi|hdg|compass|azimuth)"
     r"(_(angle|true|t|mag|magnetic))?|(euler|rpy|att(itude)?)_?z"),
    ("q_w", r"(q|quat\w*|orientation)_?(w|0)|quat\w*_q_?w"),
    ("q_x", r"(quat\w*|orientation)_?(x|1)|q_?(x|1)"),
    ("q_y", r"(quat\w*|orientation)_?(y|2)|q_?(y|2)"),
    ("q_z", r"(quat\w*|orientation)_?(z|3)|q_?(z|3)"),
    ("p_deg_s", r"p|roll_?(rate|speed|dot)|rate_roll|p_?dot_?phi|" + _GYRO + r"_?(x|roll)"),
    ("q_deg_s", r"q|pitch_?(rate|speed|dot)|rate_pitch|" + _GYRO + r"_?(y|pitch)"),
    ("r_deg_s", r"r|yaw_?(rate|speed|dot)|rate_yaw|turn_?rate|rate_of_turn|(heading|hdg)_rate|rot|"
     + _GYRO + r"_?(z|yaw)"),
    ("u_water_m_s", r"(u|vx|surge|speed)_?(water|btw|stw)|stw|speed_through_?(the_)?water|"
     r"water_?(u|vx|speed)|water_?vel\w*_x|vel\w*_water_x"),
    ("v_water_m_s", r"(v|vy|sway)_?(water|btw|stw)|water_?(v|vy)|water_?vel\w*_y|vel\w*_water_y"),
    ("w_water_m_s", r"(w|vz|heave)_?(water|btw|stw)|water_?(w|vz)|water_?vel\w*_z|vel\w*_water_z"),
    ("u_m_s", r"u|surge(_?(vel\w*|speed))?|v_?x|vbx|vel_?fwd|speed|velocity|sog|ground_?speed|"
     r"(forward|fwd|ahead|axial)_?(vel\w*|speed)|(vel\w*|speed)_(forward|fwd|ahead|surge)|"
     + _SPEED + r"_?x"),
    ("v_m_s", r"v|sway(_?(vel\w*|speed))?|v_?y|vby|"
     r"(starboard|stbd|lateral|side|right)_?(vel\w*|speed)|(vel\w*|speed)_(starboard|stbd|lateral|sway|right)|"
     + _SPEED + r"_?y"),
    ("w_m_s", r"w|heave(_?(vel\w*|speed))?|v_?z|vbz|(vertical|downward)_?(vel\w*|speed)|"
     r"(vel\w*|speed)_(vertical|heave)|" + _SPEED + r"_?z"),
    ("x_m", r"north(ing)?|x|x_?n(ed)?|n_m|" + _PLACE + r"_?(x|n|north)"),
    ("y_m", r"east(ing)?|y|y_?e|e_m|" + _PLACE + r"_?(y|e|east)"),
    ("z_m", r"(water_)?depth|z|depth_?m|" + _PLACE + r"_?(z|d|down|depth)"),
    ("tau.X_n", r"(force|tau)_?x|force_surge|tau_?(surge|1)|fx"),
    ("tau.Y_n", r"(force|tau)_?y|force_sway|tau_?(sway|2)|fy"),
    ("tau.Z_n", r"(force|tau)_?z|force_heave|tau_?(heave|3)|fz"),
    ("tau.K_nm", r"(torque|moment)_?x|tau_?(roll|4|k)|mx"),
    ("tau.M_nm", r"(torque|moment)_?y|tau_?(pitch|5|m)|my"),
    ("tau.N_nm", r"(torque|moment)_?z|tau_?(yaw|6|n)|mz"),
    ("voltage_v", r"volt(s|age)?(_?\w*)?|v_?bat\w*|bat\w*_?v(olt\w*)?|supply_?v\w*"),
    ("current_north_m_s", r"current_?(n|north)"),
    ("current_east_m_s", r"current_?(e|east)"),
    ("latitude", r"(position_)?lat(itude)?(_?(deg|dd|e7))?"),
    ("longitude", r"(position_)?(lon|long|lng|longitude)(_?(deg|dd|e7))?"),
    ("pressure", r"(water_|abs(olute)?_|fluid_|depth_)?press(ure)?(_abs)?"),
    ("north", r"(vel\w*|v|speed)_?(n|north)|(north|northward)_?(vel\w*|speed)|v(el\w*)?_?ned_?(x|n|0)"),
    ("east", r"(vel\w*|speed)_?(e|east)|v_?east|ve|(east|eastward)_?(vel\w*|speed)|v(el\w*)?_?ned_?(y|e|1)"),
    ("down", r"(vel\w*|speed)_?(d|down)|v_?down|vd|down_?(vel\w*|speed)|v(el\w*)?_?ned_?(z|d|2)"),
)  # fmt: skip

_SPATIAL = frozenset(("z", "phi", "psi", "roll", "pitch", "yaw", "heading"))
"""With one of these beside it a theta is the pitch."""


def quantity_of(path: str, siblings: Iterable[str] = ()) -> tuple[str, int] | None:
    """Canonical column, or quantity that becomes one, of a path without its unit, and rank; None for neither.

    `path`: of the column, without its unit. `siblings`: last words of the columns beside it, that have the
    same path before them.

    Examples
    --------
    >>> paths = ("field.velocity.x", "field.force.x", "C True Heading", "goal_depth", "mag.x")
    >>> [quantity_of(path) for path in paths]
    [('u_m_s', 16), ('tau.X_n', 13), ('yaw_deg', 14), None, None]
    """
    words = words_of(path)
    beside = set(siblings)
    if not words or (set(words) & _OTHER and not _water(words)):
        return None
    if len(words) > 1 and {"w", "x", "y", "z"} <= beside and words[-1] in ("w", "x", "y", "z"):
        words = ["orientation", words[-1]]
    if (
        words[-1] == "theta"
        and {"x", "y"} <= beside
        and not {"z", "phi", "psi", "roll", "pitch", "yaw"} & beside
    ):
        words[-1] = "yaw"  # of a pose in the plane
    # A word twice in a row is a message within a message.
    words = [word for k, word in enumerate(words) if k == 0 or word != words[k - 1]]
    kept = [word for word in words if word not in _PLACES]
    penalty = 20 * ("gps" in words) + 10 * ("mag" in words or "magnetic" in words)
    for candidate in (words, kept):
        if candidate and (canonical := _named(candidate)) is not None:
            return canonical, len("_".join(words)) + penalty
    # A name behind words that nothing is known of, as that of a structure; an axis alone says too little.
    if len(kept) > 1 and not set(kept[:-1]) & _STRONG and not actuator_of("_".join(kept)):
        for count in (3, 2, 1):
            last = kept[-count:]
            # One letter counts where a path ends with it, as in "nav.u", and is no axis of an unknown vector.
            alone = count == 1 and len(last[0]) == 1
            if alone and last[0] in "uvpqr" and re.search(rf"[./]{last[0]}$", path):
                alone = False
            if len(last) == count < len(kept) and not alone and (canonical := _named(last)) is not None:
                return canonical, len("_".join(words)) + 10 + penalty
    return None


def _water(words: list[str]) -> bool:
    """Whether what looks like a height of the water is the depth of the vehicle."""
    return words == ["water", "depth"]


def _named(words: list[str]) -> str | None:
    for joined in ("_".join(words), "".join(words)):
        for canonical, pattern in _NAMES:
            if re.fullmatch(pattern, joined):
                return canonical
    return None


_PARTS = re.compile(
    r"thruster|motor|propeller|propulsor|rudder|elevator|stern_?plane|bow_?plane|aileron|servo|rpm|pwm|pulse_?width|"
    r"positive_width_us"
)
"""Parts of words that only an actuator has."""

_WORDS = _set("prop esc plane planes fin fins channel chan ch rcout delta screw elevon stabilator flap ")
"""Whole words that only an actuator has; also ``n`` before a number."""

_ABOUT = _set(
    "temperature temp voltage volt volts current amp amps ampers power watt watts status state error "
    "fault mode enabled enable time count id seq load health humidity name label alarm battery batt "
    "config type "
)
"""What is told about an actuator and is no command of it."""


def actuator_of(name: str) -> bool:
    """Whether a name is that of an actuator's command or measurement, by whole words.

    Examples
    --------
    >>> [actuator_of(name) for name in ("rudder_deg", "n1", "fin_2", "run1", "mission_2", "motor_temp")]
    [True, True, True, False, False, False]
    """
    words = [part for word in words_of(name) for part in re.findall(r"[a-z]+|\d+", word)]
    if set(words) & _ABOUT:
        return False
    numbered = any(a == "n" and b.isdigit() for a, b in itertools.pairwise(words))
    rc_out = any((a, b) == ("rc", "out") for a, b in itertools.pairwise(words))
    return bool(_PARTS.search("_".join(words)) or set(words) & _WORDS or numbered or rc_out)


_STATED = {
    "m/s": "m/s", "mm/s": "mm/s", "cm/s": "cm/s", "km/h": "km/h", "kmh": "km/h", "kph": "km/h", "mps": "m/s",
    "knot": "knot", "ft/s": "ft/s", "mph": "mph", "rad": "rad", "deg": "deg", "mrad": "mrad",
    "rad/s": "rad/s", "mrad/s": "mrad/s", "deg/s": "deg/s", "dps": "deg/s", "deg/min": "deg/min", "m": "m",
    "cm": "cm", "mm": "mm", "km": "km", "ft": "ft", "fathom": "fathom", "in": "inch", "nmi": "nautical_mile",
    "n": "N", "kn": "kN", "lbf": "lbf", "nm": "N*m", "n*m": "N*m", "n m": "N*m", "v": "V", "mv": "mV",
    "rpm": "rpm", "1/min": "rpm", "r/min": "rpm", "rev/min": "rpm", "us": "us", "ms": "ms", "pwm": "us",
    "dbar": "dbar", "bar": "bar", "mbar": "mbar", "pa": "Pa", "kpa": "kPa", "hpa": "hPa", "psi": "psi",
    "rev/s": "rev/s", "rps": "rev/s", "cdeg": "0.01 deg", "dege7": "1e-7 deg", "degx1e7": "1e-7 deg",
}  # fmt: skip
KNOWN_UNITS = tuple(dict.fromkeys(_STATED.values()))
"""As a log may state them, in the words of a map."""

_SPELLED = (
    (r"²|\*\*2", "^2"), (r"µ|μ", "u"), (r"\bper\b|\\", "/"), (r"°", "deg"),
    (r"\bcenti[- ]?(?=[mdrsnvpb])", "c"), (r"\bmilli[- ]?(?=[mdrsnvpb])", "m"),
    (r"\bkilo[- ]?(?=[mnpb])", "k"),
    (r"\bmicro[- ]?(?=[msv])", "u"), (r"\bdeci[- ]?(?=[mdb])", "d"), (r"\bhecto[- ]?(?=p)", "h"),
    (r"met(re|er)s?", "m"), (r"seconds?|secs?\b", "s"), (r"degrees?|degs\b", "deg"),
    (r"radians?|rads\b", "rad"),
    (r"\b(feet|foot)\b", "ft"), (r"\b(knots|kts|kt|kn)\b", "knot"), (r"\bfathoms\b", "fathom"),
    (r"\binch(es)?\b", "in"), (r"\bminutes?\b|\bmins\b", "min"), (r"\bhours?\b|\bhrs?\b", "h"),
    (r"newtons?", "n"), (r"volts?", "v"), (r"pascals?", "pa"), (r"bars\b", "bar"),
    (r"\brevolutions?\b|\brevs\b", "rev"), (r"\s*([/*^])\s*", r"\1"),
    (r"(?<=[a-z])\s*\b(true|magnetic|mag|north|t|abs|absolute)\b$", ""), (r"^deg[tm]$", "deg"),
)  # fmt: skip

_NO_QUANTITY = {
    "", "-", "--", "1", "none", "n/a", "na", "nan", "unitless", "dimensionless", "text", "string",
    "str", "bool", "boolean", "enum", "int", "integer", "float32", "float64", "int32", "int64", "uint8",
    "float", "double", "number", "count", "counts", "flag", "char", "%", "percent", "ratio", "date",
    "utc", "datetime", "unix", "hh:mm:ss", "dd/mm/yyyy", "mm/dd/yyyy", "yyyy-mm-dd", "epoch",
}  # fmt: skip
"""What a row of units may hold instead of one."""

_OTHER_UNIT = re.compile(
    r"(u|m|n|k|c|d|h|g)?(s|sec|a|w|wh|ah|hz|g|l|j|t|ohm|gauss|tesla|kelvin|lux|db|sv|psu|ppt|ntu|fnu|mol)"
    r"|deg ?c|c|celsius|degf|f|deg ?f|fahrenheit|k|kelvin|min|h|d|days?|amps?|amperes?|milliamps?|watts?|"
    r"hertz|amp|gram|grams|kilograms?|kg|u?t|g|inhg|m\^2|m2|m\^3|m3|\w{1,6}\^-?\d|\w{1,6}/\w{1,6}(\^2|\^3|2|3)?"
)

_SUFFIX = (
    (r"rad[_/]?s(ec)?", "rad/s"), (r"mrad[_/]?s(ec)?", "mrad/s"), (r"deg[_/]?s(ec)?|dps", "deg/s"),
    (r"mm[_/]s", "mm/s"), (r"cm[_/]s", "cm/s"), (r"ft[_/]s|fps", "ft/s"), (r"km[_/]?h|kmh|kph", "km/h"),
    (r"mph", "mph"), (r"m[_/]s|mps", "m/s"), (r"kn|kts?|knots?", "knot"), (r"mrad", "mrad"),
    (r"rad(ians)?", "rad"), (r"deg(rees)?(_?true|_?mag(netic)?|_?t)?", "deg"), (r"mm", "mm"), (r"cm", "cm"),
    (r"km", "km"), (r"ft|feet|foot", "ft"), (r"fathoms?", "fathom"), (r"met(re|er)s?|m", "m"),
    (r"rpm", "rpm"), (r"rps|rev_s", "rev/s"), (r"us|µs|usec|pwm", "us"), (r"ms", "ms"), (r"mv", "mV"),
    (r"volts?|v", "V"), (r"dbar", "dbar"), (r"mbar", "mbar"), (r"bar", "bar"), (r"hpa", "hPa"),
    (r"kpa", "kPa"),
    (r"pa", "Pa"), (r"psi", "psi"), (r"nm", "N*m"), (r"n", "N"), (r"e7", "1e-7 deg"),
)  # fmt: skip


def unit_of(text: str) -> str | None:
    """Unit that a log states, in the words of a map; None where it is not known.

    Examples
    --------
    >>> [unit_of(text) for text in ("degrees true", "metres per second", "Kn", "[feet]", "grains")]
    ['deg', 'm/s', 'knot', 'ft', None]
    """
    return _STATED.get(_spelled(text))


def _spelled(text: str) -> str:
    plain = text.strip().strip("[]()").strip().lower()
    for pattern, short in _SPELLED:
        plain = re.sub(pattern, short, plain)
    return plain.strip()


def no_unit(text: str) -> bool:
    """Whether a text says that a column has no unit, or says its type."""
    return _spelled(text) in _NO_QUANTITY


def is_unit(cell: str) -> bool:
    """Whether a cell states a unit, or that there is none.

    Examples
    --------
    >>> [is_unit(cell) for cell in ("seconds", "[m/s^2]", "degC", "bool", "depth", "speed")]
    [True, True, True, True, False, False]
    """
    plain = _spelled(cell)
    return plain in _NO_QUANTITY or plain in _STATED or bool(_OTHER_UNIT.fullmatch(plain))


_ENDS = tuple((re.compile(rf"(.+?)[_\s]({pattern})", re.IGNORECASE), unit) for pattern, unit in _SUFFIX)


@lru_cache(maxsize=65_536)  # the topics of a log share the names of their fields
def suffix_of(name: str) -> tuple[str, str]:
    """Name without the unit at its end, in brackets or as a suffix, and that unit; "" where it has none.

    Examples
    --------
    >>> suffix_of("Heading (degrees true)"), suffix_of("p_rad_s"), suffix_of("u_water_m_s"), suffix_of("q_w")
    (('Heading', 'deg'), ('p', 'rad/s'), ('u_water', 'm/s'), ('q_w', ''))
    """
    bracketed = re.fullmatch(r"(.*?)\s*[\[(]([^\[\]()]*)[\])]\s*", name)
    if bracketed and not re.fullmatch(r"\d+", bracketed[2]):
        return bracketed[1], unit_of(bracketed[2]) or ""
    for pattern, unit in _ENDS:
        if suffixed := pattern.fullmatch(name):
            return suffixed[1], unit
    return name, ""


_ANGLE = ("rad", "deg", "mrad", "0.01 deg")
_RATE = ("rad/s", "deg/s", "mrad/s", "deg/min", "rpm", "rev/s")
_SPEED_UNITS = ("m/s", "mm/s", "cm/s", "km/h", "knot", "ft/s", "mph")
_LENGTH = ("m", "cm", "mm", "km", "ft", "fathom", "inch", "nautical_mile")
PRESSURES = ("dbar", "bar", "mbar", "Pa", "kPa", "hPa", "psi")
"""Units of a pressure, in the words of a map."""

_FORCE = ("N", "kN", "lbf")
_ACTUATED = ("rpm", "rev/s", "us", "ms", *_FORCE, *_ANGLE, "rad/s", "deg/s", "mrad/s")

_STEMS: dict[str, tuple[str, tuple[str, ...]]] = (
    {name: (f"{name}_deg", _ANGLE) for name in ("roll", "pitch", "yaw")}
    | {name: (f"{name}_deg_s", _RATE) for name in "pqr"}
    | {f"{name}{water}": (f"{name}{water}_m_s", _SPEED_UNITS) for name in "uvw" for water in ("", "_water")}
    | {name: (f"{name}_m", _LENGTH) for name in "xyz"}
    | {f"tau.{name}": (f"tau.{name}_n", _FORCE) for name in "XYZ"}
    | {f"tau.{name}": (f"tau.{name}_nm", ("N*m",)) for name in "KMN"}
    | {f"current_{name}": (f"current_{name}_m_s", _SPEED_UNITS) for name in ("north", "east", "down")}
    | {"voltage": ("voltage_v", ("V", "mV")), "t": ("t_s", ("s", "ms", "us", "ns", "min", "h"))}
)
"""Canonical columns without their unit, and the units that they may have instead."""

_LETTER = 2  # "_n" behind the name of an actuator may be its side, not its unit

_TIMES = {"s": "s", "sec": "s", "ms": "ms", "msec": "ms", "us": "us", "usec": "us", "ns": "ns", "nsec": "ns",
          "min": "min", "h": "h"}  # fmt: skip


def canonical_of(name: str) -> tuple[str, str] | None:
    """Canonical column that a name is but for its unit, and that unit; None for other names.

    Examples
    --------
    >>> [canonical_of(name) for name in ("roll_rad", "p_rad_s", "cmd.x_deg", "tau.X_kn", "t_ns", "roll_m")]
    [('roll_deg', 'rad'), ('p_deg_s', 'rad/s'), ('cmd.x', 'deg'), ('tau.X_n', 'kN'), ('t_s', 'ns'), None]
    """
    stem, unit = _apart(name)
    if not unit:
        return None
    if stem.startswith(("cmd.", "meas.")):
        # One letter may be the name of an actuator's side.
        return (stem, unit) if unit in _ACTUATED and len(name) - len(stem) > _LETTER else None
    canonical, units = _STEMS.get(stem, ("", ()))
    return (canonical, unit) if unit in units and canonical != name else None


def misfit_of(name: str) -> tuple[str, str] | None:
    """Canonical column whose stem a name has with a unit of another dimension, and that unit; None otherwise.

    Examples
    --------
    >>> misfit_of("yaw_m"), misfit_of("cmd.rudder_m_s"), misfit_of("roll_rad"), misfit_of("p_deg_s")
    (('yaw_deg', 'm'), ('cmd.rudder', 'm/s'), None, None)
    """
    stem, unit = _apart(name)
    if stem.startswith(("cmd.", "meas.")):
        wrong = unit and unit not in _ACTUATED and len(name) - len(stem) > _LETTER
        return (stem, unit) if wrong else None
    canonical, units = _STEMS.get(stem, ("", ()))
    return (canonical, unit) if canonical and unit and unit not in units and canonical != name else None


def _apart(name: str) -> tuple[str, str]:
    """Stem and unit of a column that is called as the canonical ones are."""
    if match := re.fullmatch(r"t_(\w+)", name):
        return ("t", _TIMES[match[1]]) if match[1] in _TIMES else (name, "")
    if match := re.fullmatch(r"(tau\.\w)_kn", name):
        return match[1], "kN"
    return suffix_of(name)


def fits(quantity: str, unit: str) -> bool:
    """Whether a quantity may be stated in a unit; "" fits any.

    Examples
    --------
    >>> fits("v_m_s", "V"), fits("v_m_s", "knot"), fits("z_m", "dbar"), fits("cmd.fin", "m")
    (False, True, True, False)
    """
    if not unit:
        return True
    if quantity.startswith(("cmd.", "meas.")):
        return unit in _ACTUATED
    units = _OF.get(quantity)
    return units is None or unit in units


_OF = (
    dict(_STEMS.values())
    | {"z_m": (*_LENGTH, *PRESSURES), "pressure": PRESSURES}
    | dict.fromkeys(("latitude", "longitude"), (*_ANGLE, "1e-7 deg"))
    | dict.fromkeys(("north", "east", "down"), _SPEED_UNITS)
    | dict.fromkeys(("q_w", "q_x", "q_y", "q_z"), ())
)
