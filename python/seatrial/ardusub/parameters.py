"""Parameter files of ArduPilot: read, compared, and written with what changes and why.

Three spellings are read: ``NAME,VALUE`` (Mission Planner), ``NAME VALUE`` (MAVProxy) and QGroundControl's
columns ``SYSTEM COMPONENT NAME VALUE TYPE``; ``#`` begins a comment. A file belongs to the generation of
firmware whose names it uses: ArduSub 3.5, 4.0 to 4.6, and 4.7 and later name the position controllers
differently, and 4.7 counts in metres and degrees where those before counted in hundredths. Held by
``tests/ardusub/test_parameters.py``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from seatrial.base.atomic_write import write_atomic, writing
from seatrial.base.errors import TrialError, reason

GENERATIONS: Mapping[str, tuple[str, ...]] = {
    "3.5": (
        "POS_Z_P",
        "VEL_Z_P",
        "ACCEL_Z_P",
        "ACCEL_Z_I",
        "ATC_RAT_RLL_FILT",
        "ATC_RAT_YAW_FILT",
        "POS_XY_P",
    ),
    "4.0 to 4.6": ("PSC_POSZ_P", "PSC_VELZ_P", "PSC_ACCZ_P", "PSC_ACCZ_I", "PSC_POSXY_P", "PSC_VELXY_P"),
    "4.7 and later": (
        "PSC_D_POS_P",
        "PSC_D_VEL_P",
        "PSC_D_ACC_P",
        "PSC_NE_POS_P",
        "PSC_NE_VEL_P",
        "ATC_ANGLE_MAX",
        "ATC_ACC_Y_MAX",
        "ATC_RATE_WPY_MAX",
    ),
}
"""Names that only one generation of ArduSub has."""

_BEFORE_4_7 = ("ANGLE_MAX", "ATC_ACCEL_R_MAX", "ATC_ACCEL_P_MAX", "ATC_ACCEL_Y_MAX", "ATC_SLEW_YAW")
"""Names that all generations before 4.7 have."""

_SINCE_4_7: Mapping[str, tuple[str, float]] = {
    "PSC_POSZ_P": ("PSC_D_POS_P", 1.0),
    "PSC_VELZ_P": ("PSC_D_VEL_P", 1.0),
    "PSC_VELZ_I": ("PSC_D_VEL_I", 1.0),
    "PSC_VELZ_FLTE": ("PSC_D_VEL_FLTE", 1.0),
    "PSC_ACCZ_P": ("PSC_D_ACC_P", 0.1),
    "PSC_ACCZ_I": ("PSC_D_ACC_I", 0.1),
    "PSC_POSXY_P": ("PSC_NE_POS_P", 1.0),
    "PSC_VELXY_P": ("PSC_NE_VEL_P", 1.0),
    "PSC_VELXY_I": ("PSC_NE_VEL_I", 1.0),
    "PSC_VELXY_FLTE": ("PSC_NE_VEL_FLTE", 1.0),
    "ANGLE_MAX": ("ATC_ANGLE_MAX", 0.01),
    "PSC_VELZ_D": ("PSC_D_VEL_D", 1.0),
    "PSC_VELZ_FF": ("PSC_D_VEL_FF", 1.0),
    "PSC_VELZ_FLTD": ("PSC_D_VEL_FLTD", 1.0),
    "PSC_VELZ_IMAX": ("PSC_D_VEL_IMAX", 0.01),
    "PSC_ACCZ_D": ("PSC_D_ACC_D", 0.1),
    "PSC_ACCZ_FF": ("PSC_D_ACC_FF", 0.1),
    "PSC_ACCZ_IMAX": ("PSC_D_ACC_IMAX", 0.001),
    "PSC_ACCZ_FLTT": ("PSC_D_ACC_FLTT", 1.0),
    "PSC_ACCZ_FLTE": ("PSC_D_ACC_FLTE", 1.0),
    "PSC_ACCZ_FLTD": ("PSC_D_ACC_FLTD", 1.0),
    "PSC_VELXY_D": ("PSC_NE_VEL_D", 1.0),
    "PSC_VELXY_FF": ("PSC_NE_VEL_FF", 1.0),
    "PSC_VELXY_FLTD": ("PSC_NE_VEL_FLTD", 1.0),
    "PSC_VELXY_IMAX": ("PSC_NE_VEL_IMAX", 0.01),
    "ATC_ACCEL_R_MAX": ("ATC_ACC_R_MAX", 0.01),
    "ATC_ACCEL_P_MAX": ("ATC_ACC_P_MAX", 0.01),
    "ATC_ACCEL_Y_MAX": ("ATC_ACC_Y_MAX", 0.01),
    "ATC_SLEW_YAW": ("ATC_RATE_WPY_MAX", 0.01),
}
"""Name since 4.7 and factor of the value, by the name of 4.0 to 4.6."""

_NAME = re.compile(r"[A-Z][A-Z0-9_]{0,15}")

_LARGEST = 2_000_000  # bytes: a vehicle has some thousand parameters


@dataclass(frozen=True)
class Change:
    """A parameter that changes.

    Attributes
    ----------
    name
    before, after
        NaN where the other file does not have it.
    why
        A sentence; empty without one.
    bounds
        Within which it was sought; None where it was not.
    """

    name: str
    before: float
    after: float
    why: str = ""
    bounds: tuple[float, float] | None = None


@dataclass(frozen=True)
class ParameterFile:
    """Parameters by name, and where they come from."""

    source: str
    values: Mapping[str, float]

    @classmethod
    def load(cls, path: str | Path) -> ParameterFile:
        """Parameters of a file.

        Raises
        ------
        TrialError
            It cannot be read, or a row is no parameter.
        """
        try:
            content = Path(path).read_bytes()
        except OSError as error:
            raise TrialError(f"{path}: cannot be read ({reason(error)}); give a .param file") from None
        if len(content) > _LARGEST:
            raise TrialError(
                f"{path}: expected a parameter file of at most {_LARGEST / 1e6:g} MB, found"
                f" {len(content) / 1e6:.1f} MB; is it a log?"
            )
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise TrialError(
                f"{path}: expected text, found other bytes at {error.start}; give a .param file"
            ) from None
        return cls.of_text(text, str(path))

    @classmethod
    def of_text(cls, text: str, source: str) -> ParameterFile:
        """Parameters of a text; see `load`."""
        values: dict[str, float] = {}
        for number, line in enumerate(text.splitlines(), 1):
            row = line.partition("#")[0].strip()
            if not row:
                continue
            cells = [cell for cell in re.split(r"[,\s]+", row) if cell]
            if len(cells) >= 4 and cells[0].isdecimal() and cells[1].isdecimal():
                cells = cells[2:4]  # QGroundControl
            if len(cells) != 2 or not _NAME.fullmatch(cells[0]):
                raise TrialError(
                    f"{source}: row {number}: expected NAME,VALUE with a name of capitals, digits and _ up to"
                    f" 16 letters, found {line.strip()[:60]!r}"
                )
            try:
                value = float(cells[1])
            except ValueError:
                value = math.nan
            if not math.isfinite(value):
                raise TrialError(
                    f"{source}: row {number}: {cells[0]}: expected a finite number, found {cells[1][:30]!r}"
                )
            if values.get(cells[0], value) != value:
                raise TrialError(
                    f"{source}: row {number}: {cells[0]} stands there twice, with {values[cells[0]]:g} and"
                    f" {value:g}; leave one of them"
                )
            values[cells[0]] = value
        if not values:
            raise TrialError(f"{source}: expected parameters as NAME,VALUE, found none")
        return cls(source, values)


def generation(names: Iterable[str], source: str = "parameters") -> str:
    """Generation of ArduSub that has these names; empty where they are of all of them.

    Raises `TrialError`: they are of more than one.

    Examples
    --------
    >>> generation(["ATC_RAT_RLL_P", "PSC_ACCZ_P"]), generation(["ATC_RAT_RLL_P"])
    ('4.0 to 4.6', '')
    """
    own = set(names)
    names_by_title = {title: sorted(own & set(only)) for title, only in GENERATIONS.items()}
    names_by_title = {title: only for title, only in names_by_title.items() if only}
    if (older := sorted(own & set(_BEFORE_4_7))) and "3.5" not in names_by_title:
        names_by_title["4.0 to 4.6"] = sorted({*names_by_title.get("4.0 to 4.6", ()), *older})
    if len(names_by_title) > 1:
        mixed = "; ".join(f"{', '.join(only)} of {title}" for title, only in names_by_title.items())
        raise TrialError(
            f"{source}: expected parameters of one generation of ArduSub, found {mixed}; take the file that"
            " the vehicle's own firmware writes"
        )
    return next(iter(names_by_title), "")


def in_metres(file: ParameterFile) -> dict[str, float]:
    """Parameters by the names and in the units of 4.7 and later, whichever of 4.0 and later they are of.

    Examples
    --------
    >>> in_metres(ParameterFile("old.param", {"PSC_ACCZ_P": 0.5, "ATC_RAT_YAW_P": 0.18}))
    {'PSC_D_ACC_P': 0.05, 'ATC_RAT_YAW_P': 0.18}
    """
    renamed = ((*_SINCE_4_7.get(name, (name, 1.0)), value) for name, value in file.values.items())
    return {name: value * factor for name, factor, value in renamed}


def of_generation(change: Change, title: str) -> Change:
    """A change of 4.7 and later by the name and in the unit of the generation `title`.

    Examples
    --------
    >>> of_generation(Change("PSC_D_ACC_P", 0.05, 0.08), "4.0 to 4.6")
    Change(name='PSC_ACCZ_P', before=0.5, after=0.8, why='', bounds=None)
    """
    older = {new: (old, factor) for old, (new, factor) in _SINCE_4_7.items()}
    if title != "4.0 to 4.6" or change.name not in older:
        return change
    name, factor = older[change.name]

    def turned(value: float) -> float:
        return float(f"{value / factor:.9g}")

    bounds = None if change.bounds is None else (turned(change.bounds[0]), turned(change.bounds[1]))
    return Change(name, turned(change.before), turned(change.after), change.why, bounds)


def changes(before: ParameterFile, after: ParameterFile) -> tuple[Change, ...]:
    """What differs between two files, by name.

    Raises
    ------
    TrialError
        They are of different generations of firmware.
    """
    first, second = generation(before.values, before.source), generation(after.values, after.source)
    if first and second and first != second:
        raise TrialError(
            f"{before.source} is of ArduSub {first}, {after.source} of {second}: names and units differ;"
            " compare files of one generation"
        )
    names = sorted({*before.values, *after.values})
    every = (Change(n, before.values.get(n, math.nan), after.values.get(n, math.nan)) for n in names)
    return tuple(change for change in every if change.before != change.after)


def write_changes(path: str | Path, changed: Iterable[Change], *, title: str) -> None:
    """Write a parameter file with what changes only; value before, bounds and reason stand above each.

    Raises
    ------
    TrialError
        The file cannot be written; what was there before is still there.
    """
    target = Path(path)
    with writing(path, TrialError, advice="choose another folder"):
        write_atomic(target, changes_text(changed, title=title).encode())


def changes_text(changed: Iterable[Change], *, title: str) -> str:
    """Text of a parameter file with what changes only, see `write_changes`."""
    lines = [f"# {title}"]
    for change in changed:
        if math.isnan(change.after):
            continue
        remarks = [] if math.isnan(change.before) else [f"before {change.before:.7g}"]
        remarks += [] if change.bounds is None else [f"within {change.bounds[0]:g} to {change.bounds[1]:g}"]
        remarks += [change.why] if change.why else []
        lines += [f"# {'; '.join(remarks)}"] if remarks else []
        lines.append(f"{change.name},{change.after:.9g}")
    return "\n".join(lines) + "\n"
