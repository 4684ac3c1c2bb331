"""From the cells of a table to signals in SI and NED/FRD: the only conversion of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base import frames
from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import ACTUATOR_UNITS, unit_factor
from seatrial.base.errors import TrialError
from seatrial.base.frames import continuous, from_euler
from seatrial.logs.clock import Counter32, clock_times, scale_of
from seatrial.trial.columns import GROUPS, Group, Source, numbers
from seatrial.trial.misread import sentinels
from seatrial.trial.signals import RecordingReport, Signal, instruments, together

if TYPE_CHECKING:
    import polars as pl


@dataclass(frozen=True)
class TableSettings:
    """What a column of a recording may hold, and what tells that it is read in the wrong unit."""

    minimum_rows: int = 10  #: fewer samples are too short for derivatives
    least_norm: float = 1e-3  #: of a quaternion: a smaller one is none
    norm_tolerance: float = 1e-2  #: of a unit quaternion's length: rounded to two decimals
    most_pitch_rad: float = 1.75  #: rad, a right angle: no pitch has more
    most_yaw_rad: float = 12.6  #: rad, two turns: not all of a yaw, counted over turns, have more
    #: of the quaternions may be zeros that stand for no sample; more is another column
    filled_share: float = 0.25
    full_turn_deg: tuple[float, float] = (300.0, 400.0)  #: deg, step with which a yaw in degrees begins again
    nearly_all: float = 0.99  #: quantile of the samples: a spike tells no unit
    most_commanded: float = 1e9  #: in its unit: no command and no measurement of an actuator is as large
    #: s, interval of rows above which no motion is seen: the turning circle of a vehicle of 10 m, its slowest
    #: motion, takes about as long
    slowest_rows_s: float = 60.0
    telling_rows: int = 2000  #: rows whose times tell their unit
    #: of the rows that repeat the one before, above which a sensor is slower than the rows
    held_share: float = 0.5
    #: 85th percentile over median of the intervals between changes, up to which a sensor samples evenly
    even_ratio: float = 1.6
    #: of a column's numbers with none in the next row, above which the cells without one are no samples
    apart_share: float = 0.5
    most_named: int = 3  #: codes that a report lists


SETTINGS = TableSettings()


def time_base(table: pl.DataFrame, source: Source, file: str) -> Array:
    """Time of every row, s, strictly rising; dates and times of day become seconds since the first."""
    if table.height < SETTINGS.minimum_rows:
        raise TrialError(
            f"{file}: too short: expected at least {SETTINGS.minimum_rows} rows of samples, found"
            f" {table.height}"
        )
    column = table[source.column]
    dated = None if source.unit else clock_times(column)
    scale = 1.0
    if dated is not None:
        t = dated[0] - dated[0][0]
    else:
        if str(column.dtype) == "Date":
            raise TrialError(
                f'{file}: t_s (column "{source.column}"): row 1: expected seconds, or a date with the time of'
                f" day, found the day {column[0]} alone; write the time of each row"
            )
        scale = unit_factor(source.unit, ("s",), f"{file}: t_s") if source.unit else 1.0
        t = Counter32().of(numbers(column, "t_s", file)) * scale * source.sign
    where = f'{file}: t_s (column "{source.column}")'
    if not np.isfinite(t).all():
        row = int(np.flatnonzero(~np.isfinite(t))[0])
        what = column[row] if dated is not None else t[row]
        raise TrialError(f"{where}: row {row + 1}: expected a time, found {what}; remove that row")
    # Times must rise; slower rows than any motion are times in another unit.
    wrong = np.flatnonzero(np.diff(t) <= 0.0)
    if len(wrong):
        row = int(wrong[0]) + 1
        what = "the same time twice" if t[row] == t[row - 1] else "time running backwards"
        raise TrialError(
            f"{where}: row {row + 1}: expected a time after {t[row - 1]:.10g} s, found {t[row]:.10g} s "
            f"({what}, {len(wrong)} rows in all); sort the rows by time or cut the recording there"
        )
    if (step := float(np.median(np.diff(t)))) > SETTINGS.slowest_rows_s:
        by = scale_of("", "", t[: SETTINGS.telling_rows] / scale)
        unit = next((name for name, factor in _SMALLER.items() if factor == by.factor), "")
        entry = f't_s = {{ from = "{source.column}", unit = "{unit or "ms"}" }}'
        looks = f" they look like {unit} ({by.how});" if unit else ""
        raise TrialError(
            f"{where}: the rows are {step:.4g} s apart; expected at most {SETTINGS.slowest_rows_s:g} s,"
            f" because slower rows show no motion of a vehicle;{looks} put the unit into the column's name,"
            f" as in t_{unit or 'ms'}, or into the column map: {entry}"
        )
    return np.asarray(t)


_SMALLER = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def signals(
    table: pl.DataFrame, t: Array, sources: Mapping[str, Source], file: str, report: RecordingReport
) -> dict[str, Signal]:
    """Signals by name: those of `GROUPS` (the attitude from quaternion or Euler angles), cmd.* and meas.*."""
    by_name: dict[str, Signal] = {}
    fresh = _fresh_rows(table, t, sources, file, report)
    spoken = _spoken(table, sources, file)
    for group in GROUPS:
        given = {name: sources[name] for name in group.columns if name in sources}
        if given and not (group.name == "euler" and "attitude" in by_name):
            for signal in _group(table, t, group, given, file, report, (spoken, fresh.get(group.name))):
                by_name[signal.name] = signal
    for name in sources:
        if name.startswith(("cmd.", "meas.")):
            by_name[name] = _actuator(table, t, name, sources[name], file, report, spoken)
    if not by_name:
        names = ", ".join(name for name in sources if name != "t_s")
        raise TrialError(f"{file}: {names}: every cell is empty; leave the column out of the map")
    return by_name


def _group(
    table: pl.DataFrame,
    t: Array,
    group: Group,
    given: Mapping[str, Source],
    file: str,
    report: RecordingReport,
    rows: tuple[Mask, Mask | None],
) -> list[Signal]:
    """Signals of a group: one, or two of a position whose depth another sensor logged; none if all empty."""
    spoken, fresh = rows  # with a sample of any sensor, and with a new one of this
    if group.name == "quaternion" and len(given) < 4:
        missing = [name for name in group.columns if name not in given]
        raise TrialError(f"{file}: an attitude quaternion has four components; {', '.join(missing)} missing")
    y = np.full((len(t), len(group.columns)), np.nan)
    present = np.zeros(y.shape, bool)
    for k, name in enumerate(group.columns):
        if name not in given:
            continue
        source = given[name]
        column = table[source.column]
        where = f"{file}: {name}"
        scale = (
            unit_factor(source.unit, (group.unit or "dimensionless",), where) if source.unit else group.factor
        )
        cells, filled = _without_sentinels(numbers(column, name, file), group, name, report)
        y[:, k] = _possible(cells * scale * source.sign, group, name, report)
        present[:, k] = _sampled(column, y[:, k], spoken) & ~filled & (True if fresh is None else fresh)
        _note_not_finite(present[:, k], y[:, k], name, report)
        y[~np.isfinite(y[:, k]), k] = np.nan
    empty = [name for k, name in enumerate(group.columns) if name in given and not present[:, k].any()]
    if empty:
        report.warning("column empty", group.name, columns=empty)
    if group.name == "quaternion" and empty:
        return []
    parts = []
    for name, columns in instruments(group.name, present).items():
        own = {group.columns[k]: given[group.columns[k]] for k in columns}
        times, cells = _own_rows(t, y, present, columns, group, report)
        if group.frame == "attitude":
            parts.append(_attitude(times, cells, group, own, file, report))
            continue
        cells = _rotated(cells, group, own, file)[:, columns]
        channels = tuple(group.channels[k] for k in columns)
        parts.append(Signal(name, channels, times, cells, ~np.isfinite(cells)))
    return parts


def _own_rows(
    t: Array, y: Array, present: Mask, columns: list[int], group: Group, report: RecordingReport
) -> tuple[Array, Array]:
    """Rows with samples of an instrument's `columns`, on one time base, other columns NaN."""
    cells = np.full_like(y, np.nan)
    cells[:, columns] = y[:, columns]
    period = 2.0 * np.pi if group.name == "euler" else None
    apart = together(t, cells[:, columns], present[:, columns], period=period)
    if apart is None:
        sampled = np.logical_or.reduce(present[:, columns], axis=1)
        # Rows of one sensor share their times: a copy each would be a third of a long log.
        return (t, cells) if sampled.all() else (t[sampled], cells[sampled])
    times, brought = apart
    report.info("components apart", group.name)
    cells = np.full((len(times), y.shape[1]), np.nan)
    cells[:, columns] = brought
    return times, cells


def _rotated(y: Array, group: Group, given: Mapping[str, Source], file: str) -> Array:
    """Vectors in NED or FRD; a frame that mixes axes needs the components it mixes."""
    if not group.frame:
        stated = [name for name, source in given.items() if source.frame]
        if stated:
            raise TrialError(f"{file}: {stated[0]}: a scalar has no frame; leave it out")
        return y
    to_matrix = frames.body_matrix if group.frame == "body" else frames.earth_matrix
    inside = "FRD" if group.frame == "body" else "NED"
    matrices = {
        name: to_matrix(given[name].frame or inside, f"{file}: {name}")
        for name in group.columns
        if name in given
    }
    result = np.full_like(y, np.nan)
    for k, name in enumerate(group.columns):
        if name not in given:
            continue
        row = matrices[name][k]
        for j in np.flatnonzero(row):
            partner = group.columns[j]
            if j != k and (partner not in given or given[partner].frame != given[name].frame):
                raise TrialError(
                    f'{file}: {name}: frame "{given[name].frame}" mixes axes, so {partner} is needed '
                    "in the same frame; map it too, each from the recording's component of the same index"
                )
        result[:, k] = np.where(row != 0.0, y, 0.0) @ row
    return result


def _attitude(
    t: Array, y: Array, group: Group, given: Mapping[str, Source], file: str, report: RecordingReport
) -> Signal:
    """Continuous unit quaternions FRD -> NED; an Euler angle that is not recorded counts as zero."""
    stated = {
        source.frame for name, source in given.items() if source.frame or name not in ("q_w", "roll_deg")
    }
    if len(stated - {None}) > 1 or (len(stated) > 1 and None in stated):
        raise TrialError(
            f"{file}: {', '.join(given)}: one attitude has one frame; expected the same on each, found "
            + ", ".join(f'"{frame}"' if frame else "none" for frame in sorted(stated, key=str))
        )
    unknown: Mask | None = None
    # Angles: one that was not recorded counts as zero, and one that is missing for a while is bridged.
    if group.name == "euler":
        absent = [k for k, name in enumerate(group.columns) if name not in given]
        if absent:
            report.warning("angles missing", "attitude", angles=[group.channels[k] for k in absent])
            y[:, absent] = 0.0
        unknown = ~np.isfinite(y)
        _note_degrees(y, given, report)
        bad = np.logical_or.reduce(unknown, axis=1)
        q = from_euler(_bridged_angles(t, y))
        channels = tuple(group.channels[k] for k in range(3) if k not in absent)
    else:
        bad = np.logical_or.reduce(~np.isfinite(y), axis=1)
        # Quaternions: zeros are no sample; another length than one is an interpolation over a sign flip.
        norm = np.linalg.norm(np.where(bad[:, None], 1.0, y), axis=1)
        zero = np.flatnonzero(norm < SETTINGS.least_norm)
        if 0 < len(zero) <= SETTINGS.filled_share * len(norm):
            report.warning("zeros", "attitude", count=len(zero))
            bad[zero] = True
            norm[zero] = 1.0
        elif len(zero):
            raise TrialError(
                f"{file}: {', '.join(s.column for s in given.values())}: row {zero[0] + 1}: expected a unit "
                f"quaternion, found all zeros ({len(zero)} rows); leave cells without an attitude empty"
            )
        odd = np.abs(norm - 1.0) > SETTINGS.norm_tolerance
        lengths: dict[str, Any] = {"shortest": float(norm.min()), "longest": float(norm.max())}
        report.warning("no unit quaternion", "attitude", count=int(odd.sum()), **lengths)
        q = np.where(bad[:, None], [1.0, 0.0, 0.0, 0.0], y / np.where(bad, 1.0, norm)[:, None])
        bad |= odd
        channels = ("roll", "pitch", "yaw")
    frame = next(iter(stated - {None}), None)
    if frame:
        q = frames.attitude_to_ned(q, frame, f"{file}: {next(iter(given))}")
    q, flips = continuous(q)
    if group.name == "quaternion":
        report.info("sign flips", "attitude", count=flips)
    return Signal("attitude", channels, t, q, np.repeat(bad[:, None], 4, axis=1), unknown)


def _note_degrees(y: Array, given: Mapping[str, Source], report: RecordingReport) -> None:
    """Say where angles (m, 3), rad by the map and not wrapped yet, can only be degrees."""
    known = [angle[np.isfinite(angle)] for angle in y.T]
    largest = [
        float(np.quantile(np.abs(angle), SETTINGS.nearly_all)) if len(angle) else 0.0 for angle in known
    ]
    steps = np.abs(np.diff(known[2]))
    wraps = np.any((steps > SETTINGS.full_turn_deg[0]) & (steps < SETTINGS.full_turn_deg[1]))
    far = float(np.abs(known[2]).min(initial=np.inf)) if len(known[2]) else 0.0
    if not (largest[1] > SETTINGS.most_pitch_rad or wraps or far > SETTINGS.most_yaw_rad):
        return
    named = [(k, name) for k, name in enumerate(("roll_deg", "pitch_deg", "yaw_deg")) if name in given]
    report.error(
        "looks like degrees",
        "attitude",
        largest_rad={name.removesuffix("_deg"): largest[k] for k, name in named},
        columns={name: given[name].column for _, name in named},
    )


def _bridged_angles(t: Array, y: Array) -> Array:
    """Angles (m, 3), rad, with straight bridges, the shorter way round, where one was not measured."""
    bridged = np.zeros_like(y)
    for k in range(y.shape[1]):
        known = np.isfinite(y[:, k])
        if known.any():
            bridged[:, k] = np.interp(t, t[known], np.unwrap(y[known, k]))
    return bridged


def _actuator(
    table: pl.DataFrame, t: Array, name: str, source: Source, file: str, report: RecordingReport, spoken: Mask
) -> Signal:
    if source.frame:
        raise TrialError(f"{file}: {name}: a scalar has no frame; leave it out")
    column = table[source.column]
    scale = unit_factor(source.unit, ACTUATOR_UNITS, f"{file}: {name}") if source.unit else 1.0
    cells, filled = _without_sentinels(numbers(column, name, file), None, name, report)
    y = _possible(cells * scale * source.sign, None, name, report)
    sampled = _sampled(column, y, spoken) & ~filled
    _note_not_finite(sampled, y, name, report)
    good = sampled & np.isfinite(y)
    if not good.any():
        raise TrialError(f"{file}: {name}: no cell has a number; leave the column out of the map")
    if good.all():
        return Signal(name, (name,), t, y[:, None], np.zeros((len(t), 1), bool))
    return Signal(name, (name,), t[good], y[good, None], np.zeros((int(good.sum()), 1), bool))


def _possible(y: Array, group: Group | None, name: str, report: RecordingReport) -> Array:
    """Numbers of a column in SI, NaN where they are larger than any of a vehicle."""
    most, unit = (SETTINGS.most_commanded, "") if group is None else (group.most, f" {group.unit}".rstrip())
    wrong = np.isfinite(y) & (np.abs(y) > most)
    if not wrong.any():
        return y
    report.error("beyond any vehicle", name, count=int(wrong.sum()), most=most, unit=unit)
    return np.where(wrong, np.nan, y)


_SENSORS = ("position", "quaternion", "euler", "velocity", "water velocity", "rates")


def _spoken(table: pl.DataFrame, sources: Mapping[str, Source], file: str) -> Mask:
    """Rows (n,) in which some sensor of the motion has a number."""
    result = np.zeros(table.height, bool)
    for group in GROUPS:
        for name in group.columns:
            if group.name in _SENSORS and name in sources:
                result |= np.isfinite(numbers(table[sources[name].column], name, file))
    return result


def _fresh_rows(
    table: pl.DataFrame, t: Array, sources: Mapping[str, Source], file: str, report: RecordingReport
) -> dict[str, Mask]:
    """By group the rows (n,) with a new sample, where a logger writes a row for each sensor that spoke and
    repeats the others' last samples in it. One sensor that is new in every row, or changes at odd times as a
    rounded depth does, shows that the rows are samples: then nothing is left out.
    """
    result: dict[str, Mask] = {}
    for group in GROUPS:
        given = [name for name in group.columns if name in sources]
        if group.name not in _SENSORS or not given:
            continue
        y = np.column_stack([numbers(table[sources[name].column], name, file) for name in given])
        same = np.logical_and.reduce((y[1:] == y[:-1]) | np.isnan(y[1:]) & np.isnan(y[:-1]), axis=1)
        if same.all():  # a sensor that is off
            continue
        fresh = np.r_[True, ~same]
        intervals = np.diff(t[fresh])
        even = len(intervals) > SETTINGS.minimum_rows and np.quantile(
            intervals, 0.85
        ) <= SETTINGS.even_ratio * np.median(intervals)
        if np.isnan(y).any() or same.mean() <= SETTINGS.held_share or not even:
            return {}
        result[group.name] = fresh
    if result:
        report.info("rows of slower sensors", "time base")
    return result


def _sampled(column: pl.Series, y: Array, spoken: Mask) -> Mask:
    """Cells (n,) that hold a sample, with a number or without. NaN is one, as a drop-out is, unless nearly
    every number has NaN behind it in rows in which some sensor has `spoken` (n,): rows of several sensors,
    put together.
    """
    given = np.asarray(column.is_not_null().to_numpy())
    numbers = np.isfinite(y)
    followed = numbers[1:] | ~given[1:]
    between = numbers[:-1] & ~followed & spoken[1:]
    if numbers.sum() >= SETTINGS.minimum_rows and between.sum() > SETTINGS.apart_share * numbers.sum():
        return np.asarray(numbers & given)
    return given


_JUMPING = ("force", "moment", "euler", "quaternion")  # groups whose columns jump and return by themselves


def _without_sentinels(
    y: Array, group: Group | None, name: str, report: RecordingReport
) -> tuple[Array, Mask]:
    """Cells (m,) without numbers that stand for no sample, and where these were (m,); reports them."""
    codes = sentinels(y, jumps=group is None or group.name in _JUMPING)
    at = np.zeros(len(y), bool)
    for code in codes:
        at |= code.at
    if not codes:
        return y, at
    report.warning(
        "codes",
        name,
        count=int(at.sum()),
        codes=[code.value for code in codes[: SETTINGS.most_named]],
        more=max(len(codes) - SETTINGS.most_named, 0),
        held=name.startswith("cmd."),
    )
    return np.where(at, np.nan, y), at


def _note_not_finite(sampled: Mask, y: Array, name: str, report: RecordingReport) -> None:
    missing = int((~np.isfinite(y) & sampled).sum())
    report.warning("not finite", name, count=missing, held=name.startswith("cmd."))
