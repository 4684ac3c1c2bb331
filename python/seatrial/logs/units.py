"""Units of columns: as a log states them, spelled out or short, and as the end of a column's name.

Words become short units (``metres per second`` is ``m/s``), which are compared with those that a map knows. A
unit of another dimension makes another quantity of a column: a ``v`` in volt is no velocity. Held by
``tests/logs/test_recognise.py``.
"""

from __future__ import annotations

import re

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
    for pattern, unit in _SUFFIX:
        if suffixed := re.fullmatch(rf"(.+?)[_\s]({pattern})", name, re.IGNORECASE):
            return suffixed[1], unit
    return name, ""


_ANGLE = ("rad", "deg", "mrad", "0.01 deg")
_RATE = ("rad/s", "deg/s", "mrad/s", "deg/min", "rpm", "rev/s")
_SPEED = ("m/s", "mm/s", "cm/s", "km/h", "knot", "ft/s", "mph")
_LENGTH = ("m", "cm", "mm", "km", "ft", "fathom", "inch", "nautical_mile")
PRESSURES = ("dbar", "bar", "mbar", "Pa", "kPa", "hPa", "psi")
"""Units of a pressure, in the words of a map."""

_FORCE = ("N", "kN", "lbf")
_ACTUATED = ("rpm", "rev/s", "us", "ms", *_FORCE, *_ANGLE, "rad/s", "deg/s", "mrad/s")

_STEMS: dict[str, tuple[str, tuple[str, ...]]] = (
    {name: (f"{name}_deg", _ANGLE) for name in ("roll", "pitch", "yaw")}
    | {name: (f"{name}_deg_s", _RATE) for name in "pqr"}
    | {f"{name}{water}": (f"{name}{water}_m_s", _SPEED) for name in "uvw" for water in ("", "_water")}
    | {name: (f"{name}_m", _LENGTH) for name in "xyz"}
    | {f"tau.{name}": (f"tau.{name}_n", _FORCE) for name in "XYZ"}
    | {f"tau.{name}": (f"tau.{name}_nm", ("N*m",)) for name in "KMN"}
    | {f"current_{name}": (f"current_{name}_m_s", _SPEED) for name in ("north", "east", "down")}
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
    | dict.fromkeys(("north", "east", "down"), _SPEED)
    | dict.fromkeys(("q_w", "q_x", "q_y", "q_z"), ())
)
