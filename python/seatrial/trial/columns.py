"""Canonical columns of a trial and the map that leads a recording's own columns to them.

A canonical name says quantity and unit (`u_m_s`); the map gives each the recording's column, plain or with
the unit, sign and frame that it has there: ``{"from": "linear_y", "unit": "cm/s", "sign": -1, "frame":
"FLU"}``. A column of the recording that has a canonical name is used without being mapped. For frames that
mix axes (ENU), ``from`` of the first component is the recording's first component, and so on.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from seatrial.base.channels import ACTUATOR_UNITS, DEGREE, is_unit
from seatrial.base.errors import TrialError, nearest
from seatrial.logs.names import canonical_of, misfit_of


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


GROUPS = (
    Group("position", ("x_m", "y_m", "z_m"), ("x", "y", "z"), "m", 1.0, "earth"),
    Group("quaternion", ("q_w", "q_x", "q_y", "q_z"), ("q_w", "q_x", "q_y", "q_z"), "", 1.0, "attitude"),
    Group("euler", ("roll_deg", "pitch_deg", "yaw_deg"), ("roll", "pitch", "yaw"), "rad", DEGREE, "attitude"),
    Group("velocity", ("u_m_s", "v_m_s", "w_m_s"), ("u", "v", "w"), "m/s", 1.0, "body", 1e4),
    Group(
        "water velocity",
        ("u_water_m_s", "v_water_m_s", "w_water_m_s"),
        ("u_water", "v_water", "w_water"),
        "m/s",
        1.0,
        "body",
        1e4,
    ),
    Group("rates", ("p_deg_s", "q_deg_s", "r_deg_s"), ("p", "q", "r"), "rad/s", DEGREE, "body"),
    Group("force", ("tau.X_n", "tau.Y_n", "tau.Z_n"), ("X", "Y", "Z"), "N", 1.0, "body"),
    Group("moment", ("tau.K_nm", "tau.M_nm", "tau.N_nm"), ("K", "M", "N"), "N*m", 1.0, "body"),
    Group(
        "current",
        ("current_north_m_s", "current_east_m_s", "current_down_m_s"),
        ("north", "east", "down"),
        "m/s",
        1.0,
        "earth",
        1e4,
    ),
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
    """Source of every canonical column of the recording `file`, from the map and its `present` columns.

    A column that is called as a canonical one but for its unit (``roll_rad``, ``cmd.fin_deg``) is read in it.
    A unit that the recording states for a column (`units`) counts where the map gives none.
    """
    sources: dict[str, Source] = {}
    for canonical, given in (columns or {}).items():
        check_canonical(canonical, file)
        sources[canonical] = mapped(canonical, given, present, file)
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

    Examples
    --------
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

    Examples
    --------
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
