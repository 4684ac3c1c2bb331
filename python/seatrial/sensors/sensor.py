"""Sensors: kinds and their columns, the imperfections of one, and sets of them from files.

Noise, bias and quantum are in the unit of the kind, times in s, the lever arm in m in the body frame from O,
the tilt of its axes in rad.
Every number is zero, and so perfect, unless it is given. "typical" is the set that comes with seatrial. Held
by ``tests/sensors/test_sensors.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
from pydantic import Field

from seatrial.base.errors import TrialError, nearest
from seatrial.base.toml_file import Section, checked, tables, text_of

if TYPE_CHECKING:
    from seatrial._core import Vehicle


@dataclass(frozen=True)
class Kind:
    """A kind of sensor."""

    columns: tuple[str, ...]  #: Canonical columns that it logs, in order.
    unit: str  #: Ending of its keys: that of the columns' numbers.
    has_lever_arm: bool = False  #: Whether what it shows depends on where it sits, ``position_m``.
    ranged: bool = False  #: Whether it needs the bottom within ``max_range_m``.
    #: Whether it shows a vector along axes of its own, which may be tilted, ``tilt_deg``.
    has_axes: bool = False
    #: Whether only the navigation filter of a flight reads it; a log has no column of it.
    aboard: bool = False


KINDS: dict[str, Kind] = {
    "dvl": Kind(("u_m_s", "v_m_s", "w_m_s"), "m_s", has_lever_arm=True, ranged=True, has_axes=True),
    "dvl_water": Kind(
        ("u_water_m_s", "v_water_m_s", "w_water_m_s"), "m_s", has_lever_arm=True, has_axes=True
    ),
    "gyro": Kind(("p_deg_s", "q_deg_s", "r_deg_s"), "deg_s", has_axes=True),
    "attitude": Kind(("roll_deg", "pitch_deg", "yaw_deg"), "deg"),
    "depth": Kind(("z_m",), "m", has_lever_arm=True),
    "position": Kind(("x_m", "y_m"), "m", has_lever_arm=True),
    "gps": Kind(("x_m", "y_m"), "m", has_lever_arm=True),
    "revolutions": Kind((), "rpm"),
    "voltage": Kind(("voltage_v",), "v"),
    "usbl": Kind((), "m", has_lever_arm=True, ranged=True, aboard=True),
    "range": Kind((), "m", has_lever_arm=True, ranged=True, has_axes=True, aboard=True),
    "bearing": Kind((), "deg", has_lever_arm=True, ranged=True, has_axes=True, aboard=True),
    "load_cell": Kind(("load.X_n", "load.Y_n", "load.Z_n"), "n"),
}
"""Kinds by name; "revolutions" logs one column per actuator, in the unit of its command."""

Position = tuple[float, float, float]

_TIMES = ("rate_hz", "latency_s", "phase_s", "jitter_s", "dropout_every_s", "dropout_s")

_NOT_ZERO = ("rate_hz", "dropout_every_s", "max_range_m")


@dataclass(frozen=True)
class Sensor:
    """A sensor's imperfections.

    Noise, bias, quantum and outlier are in the unit in which the kind logs, angles in degrees: deg/s of
    ``gyro``, deg of ``attitude`` and ``bearing``, m/s of ``dvl`` and ``dvl_water``, m of ``depth``,
    ``position``, ``gps``, ``usbl`` and ``range``, V of ``voltage``, N of ``load_cell``, the command's unit of
    ``revolutions``. All other numbers are in SI units and radians.
    """

    noise: float = 0.0  #: Standard deviation of the white noise of a sample.
    bias: float = 0.0  #: Standard deviation of an offset that is drawn once per run and channel.
    quantum: float = 0.0  #: Step of its digits; 0: none.
    rate_hz: float | None = None  #: Rate of its samples; None: that of the log.
    latency_s: float = 0.0  #: How much later than its sample a stamp is.
    phase_s: float = 0.0  #: Time of the first sample after the start of the run.
    #: Standard deviation by which a stamp misses its regular time, at most 0.45 of the interval.
    jitter_s: float = 0.0
    position: Position = (0.0, 0.0, 0.0)  #: Its lever arm: position in the body frame from O, m.
    #: Roll, pitch and yaw of its axes in the body frame, rad.
    tilt: tuple[float, float, float] = (0.0, 0.0, 0.0)
    #: `dropout_every_s`, `dropout_s`: mean time from a drop-out to the next one, and its mean
    #: duration; None: it never drops out.
    dropout_every_s: float | None = None
    dropout_s: float | None = None
    #: Largest distance to the bottom along its own down axis, or to what an acoustic sensor sees;
    #: None: no limit.
    max_range_m: float | None = None
    #: `outlier_share`, `outlier`: of an acoustic sensor the share of samples with a further error, and
    #: its standard deviation.
    outlier_share: float = 0.0
    outlier: float = 0.0
    #: Of acoustic positioning the place of the transceiver, north, east, down, m.
    transceiver: Position = (0.0, 0.0, 0.0)

    @classmethod
    def parse(cls, kind: str, table: Mapping[str, Any], where: str = "sensors") -> Sensor:
        """Sensor from its table in a file, whose keys carry the unit: ``noise_m_s``, ``latency_s``.

        Parameters
        ----------
        kind : str
            Of `seatrial.sensors.sensor.KINDS`.
        table : mapping
            Its keys and values.
        where : str, optional
            File, for messages.

        Raises
        ------
        TrialError
            An unknown kind or key, a value that is no number from zero on, or half a drop-out.

        Examples
        --------
        >>> Sensor.parse("dvl", {"noise_m_s": 0.01, "rate_hz": 5.0, "position_m": [0.4, 0, 0.1]}).position
        (0.4, 0.0, 0.1)
        """
        if kind not in KINDS:
            raise TrialError(f'{where}: unknown sensor "{kind}"{nearest(kind, KINDS)}')
        # Only keys that mean something for this kind are known; others are errors.
        keys = {f"{name}_{KINDS[kind].unit}": name for name in ("noise", "bias", "quantum")}
        keys |= {name: name for name in _TIMES}
        if KINDS[kind].has_lever_arm:
            keys["position_m"] = "position"
        if KINDS[kind].ranged:
            keys["max_range_m"] = "max_range_m"
        if KINDS[kind].has_axes:
            keys["tilt_deg"] = "tilt"
        if KINDS[kind].aboard:
            keys |= {"outlier_share": "outlier_share", f"outlier_{KINDS[kind].unit}": "outlier"}
        if kind == "usbl":
            keys["transceiver_m"] = "transceiver"
        values: dict[str, Any] = {}
        for key, value in table.items():
            if key not in keys:
                raise TrialError(f'{where}, {kind}: unknown key "{key}"{nearest(key, keys)}')
            name = f"{where}, {kind}, key {key}"
            values[keys[key]] = (_vector if key in _VECTORS else _number)(value, key, name)
        if ("dropout_s" in values) != ("dropout_every_s" in values):
            given, missing = ("dropout_s", "dropout_every_s")[:: 1 if "dropout_s" in values else -1]
            raise TrialError(f"{where}, {kind}: {given} without {missing}; a drop-out needs both, in s")
        if values.get("outlier_share", 0.0) > 1.0:
            raise TrialError(
                f"{where}, {kind}, key outlier_share: expected a share of the samples from 0 to 1, found"
                f" {values['outlier_share']:g}"
            )
        return cls(**values)


def parse_sensors(tables: Mapping[str, Mapping[str, Any]], where: str = "sensors") -> dict[str, Sensor]:
    """Sensors by kind from their tables.

    Examples
    --------
    >>> list(parse_sensors({"gyro": {}, "depth": {"noise_m": 0.01}}))
    ['gyro', 'depth']
    """
    sensors = {kind: Sensor.parse(kind, table, where) for kind, table in tables.items()}
    one_each(sensors, where)
    return sensors


def one_each(sensors: Mapping[str, Sensor], where: str = "sensors") -> None:
    """Nothing, if no two sensors log the same column."""
    owner: dict[str, str] = {}
    for kind in sensors:
        for column in KINDS[kind].columns:
            if column in owner:
                raise TrialError(
                    f"{where}: sensors {owner[column]} and {kind} both log {column}; leave one of them out"
                )
            owner[column] = kind


def _number(value: Any, key: str, where: str) -> float:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not np.isfinite(value) or value < 0 or (key in _NOT_ZERO and value == 0):
        raise TrialError(f"{where}: expected a positive number, found {value!r}")
    return float(value)


_LARGEST_TILT_DEG = 180.0  # half a turn: larger angles name the same orientation

_VECTORS = {
    "position_m": "[forward, starboard, down] from O in m",
    "transceiver_m": "[north, east, down] in m",
    "tilt_deg": f"[roll, pitch, yaw] of its axes in the body, from -{_LARGEST_TILT_DEG:g} to"
    f" {_LARGEST_TILT_DEG:g} degrees",
}
"""Keys with three numbers, and what is expected of them."""


def _vector(value: Any, key: str, where: str) -> Position:
    """The three numbers of a key; angles in rad."""
    numbers = isinstance(value, list | tuple) and all(
        isinstance(x, int | float) and not isinstance(x, bool) and np.isfinite(x) for x in value
    )
    angles = key == "tilt_deg"
    if not numbers or len(value) != 3 or (angles and max(map(abs, value)) > _LARGEST_TILT_DEG):
        raise TrialError(f"{where}: expected {_VECTORS[key]}, found {value!r}")
    x, y, z = (float(np.deg2rad(part) if angles else part) for part in value)
    return x, y, z


class SensorFile(Section):
    """A set of sensors by kind; a truth file is one too."""

    file_kind = "a set of sensors"

    format: Literal[1]
    description: str = ""
    sensors: dict[str, dict[str, Any]] = Field(default_factory=dict)


_OF_THE_VEHICLE = ("vehicle", "vehicle_file", "factors", "values")

_File = TypeVar("_File", bound=Section)


def read_as(model: type[_File], path: Path) -> _File:
    """Contents of a TOML file as one of the models."""
    sensors = model is SensorFile
    what = "a set of sensors" if sensors else "the file of a generated trial"
    advice = f"check the path, or use {TYPICAL}" if sensors else "check the path"
    data = tables(text_of(path, what, error=TrialError, advice=advice), str(path), error=TrialError)
    if sensors:
        # What a truth file says of its vehicle is another reader's business.
        data = {key: value for key, value in data.items() if key not in _OF_THE_VEHICLE}
    return checked(model, data, str(path), error=TrialError)


TYPICAL = "typical"
"""Name of the set that comes with seatrial."""

_TYPICAL_FILE = Path(__file__).with_name("typical.toml")


def load_sensors(source: str | Path, vehicle: Vehicle) -> dict[str, Sensor]:
    """Sensors by kind of a file, or the typical ones that suit a vehicle.

    Parameters
    ----------
    source : str or Path
        "typical", or a file with ``[sensors.KIND]`` tables; the file of a truth vehicle will do.
    vehicle : Vehicle
        Of the typical sensors those of revolutions are for motors that are commanded by them, that of the
        supply for thrust that depends on it.

    Raises
    ------
    TrialError
        The file cannot be read, names no sensor, or one is wrong.

    Examples
    --------
    >>> import seatrial as st
    >>> "revolutions" in load_sensors("typical", st.Vehicle.load("beluga"))
    False
    """
    if str(source) != TYPICAL:
        path = Path(source)
        sensors = parse_sensors(read_as(SensorFile, path).sensors, str(path))
        if not sensors:
            raise TrialError(f"{path}: names no sensor; expected a table [sensors.dvl] or the like")
        return sensors
    sensors = parse_sensors(read_as(SensorFile, _TYPICAL_FILE).sensors, TYPICAL)
    facts = vehicle.actuator_info().values()
    if not any(actuator["unit"] == "rpm" for actuator in facts):
        del sensors["revolutions"]
    if not any(actuator["needs_voltage"] for actuator in facts):
        del sensors["voltage"]
    return sensors
