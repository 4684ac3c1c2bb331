"""Canonical columns of a trial, and the map and the mixer that lead a recording's own columns to them.

A canonical name says quantity and unit (`u_m_s`); the map gives each the recording's column, plain or with
the unit, sign and frame that it has there: ``{"from": "linear_y", "unit": "cm/s", "sign": -1, "frame":
"FLU"}``. A column of the recording that has a canonical name is used without being mapped. For frames that
mix axes (ENU), ``from`` of the first component is the recording's first component, and so on.

The mixer makes commands where sticks, radio or servo channels were logged. A stick is a column between its
ends, -1 to 1 about its trim, held between its samples as a pilot holds it. An output is ``neutral + full
clip(sum of factor times stick, -1, 1)``, a command or a component of the wrench. Frames of ArduSub by name:
the factors of its motors (ArduPilot, AP_Motors6DOF, at 0fd5fbf2), which are the commands only where no
stabilisation adds to the sticks (mode MANUAL) and no motor is at its limit. Held by
``tests/trial/test_columns.py`` and ``tests/trial/test_mixer.py``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import ACTUATOR_UNITS, DEGREE, is_unit
from seatrial.base.errors import TrialError, nearest
from seatrial.logs.names import canonical_of, misfit_of

if TYPE_CHECKING:
    import polars as pl
from dataclasses import field
from typing import TYPE_CHECKING

from seatrial.base.channels import unit_factor


@dataclass(frozen=True)
class Group:
    """Columns that one sensor gives together: a vector in one frame, or a scalar.

    ``most`` is a size in SI that no vehicle reaches: a larger number is no measurement.
    """

    name: str
    columns: tuple[str, ...]
    channels: tuple[str, ...]
    unit: str
    factor: float = 1.0
    frame: Literal["earth", "body", "attitude", ""] = ""
    most: float = 1e9


_WATER, _EARTH = ("u_water", "v_water", "w_water"), ("north", "east", "down")

GROUPS = (
    Group("position", ("x_m", "y_m", "z_m"), ("x", "y", "z"), "m", 1.0, "earth"),
    Group("quaternion", ("q_w", "q_x", "q_y", "q_z"), ("q_w", "q_x", "q_y", "q_z"), "", 1.0, "attitude"),
    Group("euler", ("roll_deg", "pitch_deg", "yaw_deg"), ("roll", "pitch", "yaw"), "rad", DEGREE, "attitude"),
    Group("velocity", ("u_m_s", "v_m_s", "w_m_s"), ("u", "v", "w"), "m/s", 1.0, "body", 1e4),
    Group("water velocity", tuple(f"{c}_m_s" for c in _WATER), _WATER, "m/s", 1.0, "body", 1e4),
    Group("rates", ("p_deg_s", "q_deg_s", "r_deg_s"), ("p", "q", "r"), "rad/s", DEGREE, "body"),
    Group("force", ("tau.X_n", "tau.Y_n", "tau.Z_n"), ("X", "Y", "Z"), "N", 1.0, "body"),
    Group("moment", ("tau.K_nm", "tau.M_nm", "tau.N_nm"), ("K", "M", "N"), "N*m", 1.0, "body"),
    Group("current", tuple(f"current_{c}_m_s" for c in _EARTH), _EARTH, "m/s", 1.0, "earth", 1e4),
    Group("voltage", ("voltage_v",), ("voltage",), "V"),
)

CANONICAL = ("t_s", *(column for group in GROUPS for column in group.columns))
"""Every canonical name but those of actuators, which are `cmd.<actuator>` and `meas.<actuator>`."""

_KEYS = ("from", "unit", "sign", "frame")

_MOST, _LONGEST = 20, 40  # names in a message, and letters of one


@dataclass(frozen=True)
class Source:
    """The recording's column behind a canonical one, its unit (None: that of the name), sign and frame."""

    column: str
    unit: str | None = None
    sign: float = 1.0
    frame: str | None = None

    def __str__(self) -> str:
        """The entry of a column map in a campaign file."""
        parts = [f'from = "{self.column}"']
        parts += [
            f'{key} = "{value}"' for key, value in (("unit", self.unit), ("frame", self.frame)) if value
        ]
        return "{ " + ", ".join([*parts, f"sign = {self.sign:g}"]) + " }"


def parse(
    columns: Mapping[str, Any] | None,
    present: Sequence[str],
    file: str,
    units: Mapping[str, str] | None = None,
) -> dict[str, Source]:
    """Source of every canonical column of the recording `file`, from the map and its `present` columns. A
    name that is canonical but for its unit (``roll_rad``) is read in it. `units`: those that the recording
    states count where the map gives none.
    """
    sources: dict[str, Source] = {}
    for canonical, given in (columns or {}).items():
        check_canonical(canonical, file)
        sources[canonical] = mapped(canonical, given, present, file)
    # Beside the map count columns with canonical names, and such in other units.
    mapped_columns = {source.column for source in sources.values()}
    for name in present:
        plain = name in CANONICAL or (_actuator(name) and not canonical_of(name) and not misfit_of(name))
        if name not in sources and plain:
            sources[name] = Source(name)
    for name, (canonical, unit) in _in_other_units(present, file).items():
        if canonical not in sources and name not in mapped_columns:
            sources[canonical] = Source(name, unit)
    if "t_s" not in sources:
        raise TrialError(
            f'{file}: no time: expected a column "t_s" or its source in the column map, for example '
            f'columns={{"t_s": "Time"}}; the recording has {_listed(present)}'
        )
    for canonical, source in sources.items():
        stated = (units or {}).get(source.column, "")
        if source.unit is None and is_unit(stated):
            sources[canonical] = replace(source, unit=stated)
    if len(sources) == 1:
        raise TrialError(
            f"{file}: no column but the time has a canonical name; give the column map, for example "
            f'columns={{"u_m_s": "speed"}}; the recording has {_listed(present)}'
        )
    return sources


def _in_other_units(present: Sequence[str], file: str) -> dict[str, tuple[str, str]]:
    """By column, the canonical one that it is in another unit, and that unit: roll_rad, cmd.fin_deg."""
    result: dict[str, tuple[str, str]] = {}
    for name in present:
        if name in CANONICAL:
            continue
        if _actuator(name) and (misfit := misfit_of(name)) is not None:
            raise TrialError(
                f'{file}: column "{name}": a command or measurement in {misfit[1]}; expected one'
                f" of {', '.join(ACTUATOR_UNITS)}, as in {misfit[0]}_deg: write it so, or rename the column"
            )
        if (own := canonical_of(name)) is not None:
            other = next((n for n, entry in result.items() if entry[0] == own[0]), None)
            if other is not None and own[0] not in present:
                raise TrialError(
                    f'{file}: columns "{other}" and "{name}" are both {own[0]}, in two units; remove one'
                    f' of them, or name the one that counts in the column map: {own[0]} = {{ from = "{name}",'
                    f' unit = "{own[1]}" }}'
                )
            result.setdefault(name, own)
    return result


def columns_of(columns: Mapping[str, Any] | None) -> list[str]:
    """Columns of the recording that a column map names; what is wrong with the map is said by `parse`.

    >>> columns_of({"t_s": "Time", "u_m_s": {"from": "speed", "unit": "km/h"}})
    ['Time', 'speed']
    """
    given = [entry.get("from") if isinstance(entry, Mapping) else entry for entry in (columns or {}).values()]
    return [column for column in given if isinstance(column, str)]


def _actuator(name: str) -> bool:
    kind, _, actuator = name.partition(".")
    return kind in ("cmd", "meas") and bool(actuator)


def check_canonical(name: str, file: str) -> None:
    """Refuse what is no canonical column."""
    if not (name in CANONICAL or _actuator(name)):
        known = (*CANONICAL, "cmd.<actuator>", "meas.<actuator>")
        raise TrialError(f'{file}: column map: "{name}" is no canonical column{nearest(name, known)}')


def mapped(canonical: str, given: Any, present: Sequence[str], file: str) -> Source:
    """Source of a canonical column from its entry in a column map, which the recording must have.

    >>> mapped("u_m_s", {"from": "speed", "unit": "cm/s"}, ["speed"], "log.csv").unit
    'cm/s'
    """
    source = source_of(given, f"{file}: column map, {canonical}")
    if source.column not in present:
        raise TrialError(
            f'{file}: column map, {canonical}: there is no column "{source.column}" in the recording'
            f"{_near_or_listed(source.column, present)}"
        )
    return source


def source_of(given: Any, where: str) -> Source:
    """Source of a canonical column from its entry in a column map: the column's name, or a table."""
    if isinstance(given, str):
        return Source(given)
    if not isinstance(given, Mapping):
        raise TrialError(
            f"{where}: expected the name of a column or a table of {', '.join(_KEYS)}, found {given!r}"
        )
    for key in given:
        if key not in _KEYS:
            raise TrialError(f'{where}: unknown key "{key}"{nearest(str(key), _KEYS)}')
    column, unit, frame = given.get("from"), given.get("unit"), given.get("frame")
    if not isinstance(column, str):
        raise TrialError(f'{where}: expected "from", the name of a column, found {column!r}')
    for key, value in (("unit", unit), ("frame", frame)):
        if value is not None and not isinstance(value, str):
            raise TrialError(f"{where}: {key}: expected a name, found {value!r}")
    sign = given.get("sign", 1)
    if isinstance(sign, bool) or sign not in (1, -1):
        raise TrialError(f"{where}: sign: expected 1 or -1, found {sign!r}; scale with a unit")
    return Source(column, unit, float(sign), frame)


def _near_or_listed(name: str, present: Sequence[str]) -> str:
    clause = nearest(name, [other for other in present if other.isprintable()])
    return clause if "did you mean" in clause else f"; the recording has {_listed(present)}"


def _listed(names: Iterable[str]) -> str:
    """Names of columns as they may be shown: a file that is no table has control characters for names."""
    shown = [_shown(name) for name in names]
    return ", ".join(shown[:_MOST]) + (f" and {len(shown) - _MOST} more" if len(shown) > _MOST else "")


def _shown(name: str) -> str:
    plain = name if name.isprintable() else repr(name)[1:-1]
    return f'"{plain if len(plain) <= _LONGEST else plain[: _LONGEST - 3] + "..."}"'


_NO_SAMPLE_WORDS = (
    "", "-", "--", "---", "n/a", "na", "#n/a", "nan", "-nan", "null", "none", "nil", "missing", "invalid",
    "?",
)  # fmt: skip
"""Texts in lower case that stand in a cell for no sample."""


def numbers(column: pl.Series, canonical: str, file: str) -> Array:
    """Cells of a column as numbers (m,), NaN where empty. `canonical` and `file` are for messages."""
    import polars as pl

    where = f'{file}: {canonical} (column "{column.name}")'
    if column.dtype in (pl.Object, pl.Categorical, pl.Enum):
        column = column.cast(pl.String)
    if column.dtype == pl.String:
        text = column.str.strip_chars()
        values = text.cast(pl.Float64, strict=False)
        silent = text.str.to_lowercase().is_in(_NO_SAMPLE_WORDS)
        wrong = (values.is_null() & text.is_not_null() & ~silent).arg_true()
        if len(wrong):
            row = int(wrong[0])
            raise TrialError(
                f'{where}: row {row + 1}: expected a number, found the text "{column[row]}" '
                f"({len(wrong)} such cells); correct it or leave the cell empty"
            )
        return values.to_numpy()
    if not (column.dtype.is_numeric() or column.dtype in (pl.Boolean, pl.Null)):
        raise TrialError(f"{where}: expected numbers, found {column.dtype}")
    return column.cast(pl.Float64).to_numpy()


_STICKS = ("roll", "pitch", "yaw", "throttle", "forward", "lateral")

_YAW_AHEAD = {"1": (0, 0, -1, 0, 1, 0), "2": (0, 0, 1, 0, 1, 0)}
_VECTORED = {
    "1": (0, 0, 1, 0, -1, 1), "2": (0, 0, -1, 0, -1, -1), "3": (0, 0, -1, 0, 1, 1), "4": (0, 0, 1, 0, 1, -1),
}  # fmt: skip
_DOWN = (0, 0, 0, -1, 0, 0)

FRAMES: dict[str, dict[str, tuple[float, ...]]] = {
    "BLUEROV1": {
        **_YAW_AHEAD, "3": (-0.5, 0.5, 0, 0.45, 0, 0), "4": (0.5, 0.5, 0, 0.45, 0, 0),
        "5": (0, -1, 0, 1, 0, 0), "6": (-0.25, 0, 0, 0, 0, 1),
    },
    "VECTORED": {**_VECTORED, "5": (1, 0, 0, -1, 0, 0), "6": (-1, 0, 0, -1, 0, 0)},
    "VECTORED_6DOF": {
        **_VECTORED, "5": (1, -1, 0, -1, 0, 0), "6": (-1, -1, 0, -1, 0, 0),
        "7": (1, 1, 0, -1, 0, 0), "8": (-1, 1, 0, -1, 0, 0),
    },
    "VECTORED_6DOF_90DEG": {
        "1": (1, 1, 0, 1, 0, 0), "2": (0, 0, 1, 0, 1, 0), "3": (1, -1, 0, 1, 0, 0), "4": (0, 0, 0, 0, 0, 1),
        "5": (0, 0, 0, 0, 0, 1), "6": (-1, 1, 0, 1, 0, 0), "7": (0, 0, -1, 0, 1, 0),
        "8": (-1, -1, 0, 1, 0, 0),
    },
    "SIMPLEROV_3": {**_YAW_AHEAD, "3": _DOWN},
    "SIMPLEROV_4": {**_YAW_AHEAD, "3": _DOWN, "4": _DOWN},
    "SIMPLEROV_5": {**_YAW_AHEAD, "3": _DOWN, "4": _DOWN, "5": (0, 0, 0, 0, 0, 1)},
}  # fmt: skip
"""Factors of roll, pitch, yaw, throttle, forward and lateral by motor number, of ArduSub's frames in the
order of FRAME_CONFIG.
"""

FRAME_NAMES = tuple(FRAMES)
"""Frames by the number of FRAME_CONFIG; 7 is a custom one, whose factors no parameter tells."""

WRENCH = tuple(column for group in GROUPS if group.name in ("force", "moment") for column in group.columns)
"""Outputs that are components of the wrench: the names of a trial's columns."""

_NEUTRAL_US, _FULL_US = 1500.0, 400.0  # of a frame's motors


@dataclass(frozen=True)
class Stick:
    """A column of the log that becomes -1 to 1."""

    column: str  #: Its name; ``topic.field`` in a log of topics.
    #: Value at rest and at the ends, in the column's own unit.
    trim: float = 1500.0
    min: float = 1100.0
    max: float = 1900.0
    dead_zone: float = 0.0  #: Distance from trim below which it counts as zero, in the column's unit.
    reversed: bool = False  #: Whether a larger value is less.

    def value(self, y: Array) -> Array:
        """Deflection of samples (n,), -1 to 1.

        >>> Stick("RCIN.C4").value(np.array([1100.0, 1500.0, 1700.0, 2000.0])).tolist()
        [-1.0, 0.0, 0.5, 1.0]
        """
        away = y - self.trim
        away = np.sign(away) * np.maximum(np.abs(away) - self.dead_zone, 0.0)
        span = np.where(away > 0.0, self.max - self.trim, self.trim - self.min) - self.dead_zone
        deflection = np.clip(away / span, -1.0, 1.0)
        return np.asarray(-deflection if self.reversed else deflection)


@dataclass(frozen=True)
class Output:
    """What sticks command: ``neutral + full clip(sum of mix times stick, -1, 1)`` in `unit`."""

    mix: Mapping[str, float]
    full: float
    neutral: float = 0.0
    unit: str | None = None


@dataclass(frozen=True)
class Mixer:
    """Sticks, outputs and the constant supply voltage of a log without commands."""

    inputs: Mapping[str, Stick] = field(default_factory=dict)  #: Sticks by name.
    #: By actuator, or by a column of the wrench such as "tau.X_n".
    outputs: Mapping[str, Output] = field(default_factory=dict)
    #: A name in `FRAMES`, the vehicle's actuators in the order of the frame's motor numbers ("thruster_1",
    #: "thruster_2", ... when omitted), and those of them whose direction is reversed. Its inputs are called
    #: roll, pitch, yaw, throttle, forward and lateral; one that is not given is zero.
    frame: str | None = None
    motors: Sequence[str] = ()
    reversed: Sequence[str] = ()
    supply_v: float | None = None  #: Supply voltage where none is recorded, V.

    @property
    def columns(self) -> list[str]:
        """Columns of the log that it reads."""
        return [stick.column for stick in self.inputs.values()]

    def complaint(self) -> str | None:
        """What contradicts itself, with what to do about it; None when nothing does."""
        for name, stick in self.inputs.items():
            rest = min(stick.trim - stick.min, stick.max - stick.trim)
            if not 0.0 <= stick.dead_zone < rest:
                return (
                    f"inputs.{name}: expected min < trim < max and a dead zone inside, found min"
                    f" {stick.min:g}, trim {stick.trim:g}, max {stick.max:g}, dead_zone"
                    f" {stick.dead_zone:g}; set reversed = true for a channel that runs backwards"
                )
        for name, output in self.outputs.items():
            for given in output.mix:
                if given not in self.inputs:
                    return f"outputs.{name}.mix: unknown input {given!r}{nearest(given, self.inputs)}"
        return self._frame_complaint()

    def _frame_complaint(self) -> str | None:
        if self.frame is None:
            given = "motors" if self.motors else "reversed" if self.reversed else ""
            return (
                f"{given}: expected a frame whose motors they are, found none; add frame" if given else None
            )
        if self.frame not in FRAMES:
            return f"frame: unknown frame {self.frame!r}{nearest(self.frame, FRAMES)}"
        count = len(FRAMES[self.frame])
        if len(self.names) != count:
            return (
                f"motors: expected {count} actuators, one per motor of {self.frame}, found {len(self.names)}"
            )
        for name in self.reversed:
            if name not in self.names:
                return f"reversed: unknown motor {name!r}{nearest(name, self.names)}"
        for name in (*self.names, *self.outputs):
            if [*self.names, *self.outputs].count(name) > 1:
                return f"motors: {name!r} is commanded twice; name it once in motors or outputs"
        if not set(self.inputs) & set(_STICKS):
            return f"inputs: {self.frame} needs at least one of {', '.join(_STICKS)}; add a stick"
        return None

    @property
    def names(self) -> list[str]:
        """Actuators of the frame's motors in order."""
        if self.frame is None:
            return []
        return list(self.motors) or [f"thruster_{number}" for number in FRAMES.get(self.frame, {})]

    def all_outputs(self) -> dict[str, Output]:
        """Outputs with those of the frame's motors."""
        outputs: dict[str, Output] = {}
        if self.frame is not None:
            for name, factors in zip(self.names, FRAMES[self.frame].values(), strict=True):
                sign = -1.0 if name in self.reversed else 1.0
                mix = {
                    stick: sign * factor
                    for stick, factor in zip(_STICKS, factors, strict=True)
                    if factor != 0.0 and stick in self.inputs
                }
                outputs[name] = Output(mix, _FULL_US, _NEUTRAL_US, "us")
        return outputs | dict(self.outputs)

    def mixed(
        self, table: pl.DataFrame, file: str, given: Mapping[str, object] | None = None
    ) -> pl.DataFrame:
        """Table of the log `file` with commands, wrench and voltage as canonical columns, which its column
        map `given` may not give, too. A row without a sample of any stick of an output has none of it.
        """
        import polars as pl

        if (wrong := self.complaint()) is not None:
            raise TrialError(f"{file}: mixer: {wrong}")
        sticks, sampled = {}, {}
        for name, stick in self.inputs.items():
            where = f"{file}: mixer, inputs.{name}"
            if stick.column not in table.columns:
                raise TrialError(
                    f'{where}: there is no column "{stick.column}" in the recording'
                    f"{nearest(stick.column, table.columns)}"
                )
            y = numbers(table[stick.column], f"inputs.{name}", file)
            sampled[name] = np.isfinite(y)
            if not sampled[name].any():
                raise TrialError(f"{where}: no cell of {stick.column} has a number; choose another column")
            # Held from sample to sample; at rest before the first one.
            last = np.maximum.accumulate(np.where(sampled[name], np.arange(len(y)), -1))
            sticks[name] = stick.value(np.where(last >= 0, y[np.maximum(last, 0)], stick.trim))
        # Outputs in the order of actuators, each in the unit of its command.
        columns: dict[str, Array] = {}
        for name, output in self.all_outputs().items():
            total = np.zeros(table.height)
            for stick_name, factor in output.mix.items():
                total += factor * sticks[stick_name]
            scale = 1.0
            if output.unit is not None:
                scale = unit_factor(output.unit, _units(name), f"{file}: mixer, outputs.{name}")
            rows = np.logical_or.reduce([sampled[s] for s in output.mix] or [np.ones(table.height, bool)])
            values = scale * (output.neutral + output.full * np.clip(total, -1.0, 1.0))
            columns[name if name in WRENCH else f"cmd.{name}"] = np.where(rows, values, np.nan)
        if self.supply_v is not None:
            columns["voltage_v"] = np.full(table.height, self.supply_v)
        # What is given twice would be taken from either.
        for name in columns:
            if name in table.columns or name in (given or {}):
                raise TrialError(
                    f"{file}: mixer: {name} is in the recording or its column map, too; take one of them out"
                )
        return table.with_columns([
            pl.Series(name, values, nan_to_null=True) for name, values in columns.items()
        ])


def _units(output: str) -> tuple[str, ...]:
    if output not in WRENCH:
        return ACTUATOR_UNITS
    return ("N",) if output.endswith("_n") else ("N*m",)
