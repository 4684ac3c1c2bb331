"""Tables of trials and flights as files for other programs: CSV and Parquet in any unit, MCAP for Foxglove.

MCAP messages are JSON with JSON schemas; those of Foxglove have the names, fields and required fields that
it publishes (foxglove-sdk, schemas/jsonschema). Topic ``/trial`` has every column under its own name, an
empty cell left out; ``/pose`` (foxglove.PoseInFrame) and ``/tf`` (foxglove.FrameTransform) have the pose in
the frames of viewers, east-north-up and forward-left-up. Numbers are written with all their digits; stamps
are the times in whole nanoseconds, moved to begin at zero where the first is negative. Held by
``tests/trial/test_export.py``.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import unit_factor
from seatrial.base.errors import TrialError, nearest
from seatrial.base.files import write_atomic, write_table, writing
from seatrial.base.frames import attitude_to_ned, from_euler
from seatrial.logs.log import extra

if TYPE_CHECKING:
    import polars as pl

ENDINGS = (".mcap", ".csv", ".parquet")

_UNITS = {
    "_deg_s": "deg/s",
    "_m_s": "m/s",
    "_deg": "deg",
    "_nm": "N*m",
    "_wh": "W*h",
    "_m": "m",
    "_n": "N",
    "_v": "V",
    "_w": "W",
    "_s": "s",
}
"""By the end of a column's name, longer ones first."""

_EARTH, _BODY = "earth", "vehicle"


def unit_of(column: str) -> str:
    """Unit that the end of a column's name says; "" for none, as of a command.

    >>> unit_of("u_m_s"), unit_of("cmd.rudder")
    ('m/s', '')
    """
    if column.startswith(("cmd.", "meas.")):
        return ""
    return next((unit for ending, unit in _UNITS.items() if column.endswith(ending)), "")


def export(table: pl.DataFrame, path: str | Path, *, units: Mapping[str, str] | None = None) -> None:
    """Write a table of a trial or a flight, with a column ``t_s``, to a .mcap, .csv or .parquet file.
    `units`: unit by column instead of that in its name, ``{"u_m_s": "knot"}`` makes ``u [knot]``; not for
    MCAP.

    >>> import seatrial as st
    >>> t = np.arange(0.0, 2.0, 0.1)
    >>> trial = st.Trial.read({"t_s": t, "u_m_s": t})
    >>> export(trial.table, "speed.csv", units={"u_m_s": "knot"})  # doctest: +SKIP
    """
    path = Path(path)
    if path.suffix not in ENDINGS:
        raise TrialError(f'{path}: expected one of the endings {", ".join(ENDINGS)}, found "{path.suffix}"')
    if "t_s" not in table.columns:
        raise TrialError(f"{path}: the table has no column t_s, the time in s; nothing is written")
    if path.suffix == ".mcap":
        if units:
            raise TrialError(f"{path}: MCAP keeps units as they are; leave out the units or write CSV")
        content = _mcap(table, path)
        with writing(path, TrialError, advice="choose another folder"):
            write_atomic(path, content)
        return
    write_table(_in_units(table, units or {}, path), path)


def _in_units(table: pl.DataFrame, wanted: Mapping[str, str], path: Path) -> pl.DataFrame:
    """The table with some columns in other units, which their new names state."""
    import polars as pl

    changed = []
    for column in table.columns:
        if column not in wanted:
            changed.append(pl.col(column))
            continue
        unit, own = wanted[column], unit_of(column)
        if not own:
            raise TrialError(f"{path}: {column}: its name says no unit, so that it cannot be converted")
        factor = 1.0 / unit_factor(unit, (own,), f"{path}: {column}")
        ending = next(end for end in _UNITS if column.endswith(end))
        changed.append((pl.col(column) * factor).alias(f"{column.removesuffix(ending)} [{unit}]"))
    for column in wanted:
        if column not in table.columns:
            raise TrialError(f'{path}: there is no column "{column}"{nearest(column, table.columns)}')
    return table.select(changed)


def _mcap(table: pl.DataFrame, path: Path) -> bytes:
    writer_module = extra("mcap.writer", path)
    content = io.BytesIO()
    writer = writer_module.Writer(content)
    writer.start(library="seatrial")
    numeric = [name for name, kind in table.schema.items() if name != "t_s" and kind.is_numeric()]
    t = table["t_s"].to_numpy().astype(float)
    stamps = [round(time * 1e9) for time in (t - min(0.0, float(t[0]))).tolist()]
    topics = [_Topic(writer, "/trial", "seatrial.Trial", _trial_schema(numeric))]
    rows = _rows(table, ["t_s", *numeric])
    messages: Iterable[tuple[Any, ...]] = ((row,) for row in rows)
    pose = _pose(table)
    if pose is not None:
        topics += [
            _Topic(writer, "/tf", "foxglove.FrameTransform", _TRANSFORM),
            _Topic(writer, "/pose", "foxglove.PoseInFrame", _POSE),
        ]
        messages = ((row, *both) for row, both in zip(rows, _poses(stamps, *pose), strict=True))
    for stamp, parts in zip(stamps, messages, strict=True):
        for topic, message in zip(topics, parts, strict=True):
            if message is not None:
                topic.write(stamp, message)
    writer.finish()
    return content.getvalue()


class _Topic:
    """A channel of an MCAP file with its schema."""

    def __init__(self, writer: Any, topic: str, name: str, schema: Mapping[str, Any]) -> None:
        self.writer = writer
        number = writer.register_schema(name=name, encoding="jsonschema", data=json.dumps(schema).encode())
        self.number = writer.register_channel(topic=topic, message_encoding="json", schema_id=number)

    def write(self, stamp: int, message: Any) -> None:
        """A message at a stamp in ns."""
        data = json.dumps(message, allow_nan=False).encode()
        self.writer.add_message(channel_id=self.number, log_time=stamp, publish_time=stamp, data=data)


def _rows(table: pl.DataFrame, names: list[str]) -> Iterator[Any]:
    """A message per row: every column by its name, ``cmd.PU`` nested as ``cmd`` and ``PU``."""
    columns = [np.asarray(table[name].cast(float).to_numpy(), float) for name in names]
    for row in zip(*columns, strict=True):
        message: dict[str, Any] = {}
        for name, value in zip(names, row, strict=True):
            if np.isfinite(value):
                group, _, field = name.partition(".")
                if field:
                    message.setdefault(group, {})[field] = float(value)
                else:
                    message[name] = float(value)
        yield message


def _pose(table: pl.DataFrame) -> tuple[Array, Array] | None:
    """Positions (n, 3) east, north, up and quaternions (n, 4) of forward-left-up in it, NaN unknown; what is
    not recorded is zero. None where neither position nor angles are there.
    """
    from seatrial.trial.columns import GROUPS

    columns = {group.name: group.columns for group in GROUPS}

    def of(names: tuple[str, ...], unknown: float) -> Array:
        n = table.height
        parts = [
            table[c].to_numpy().astype(float) if c in table.columns else np.full(n, unknown) for c in names
        ]
        return np.stack(parts, axis=1)

    turned = [name for name in ("quaternion", "euler") if any(c in table.columns for c in columns[name])]
    if not turned and not any(c in table.columns for c in columns["position"]):
        return None
    place = of(columns["position"], 0.0)[:, [1, 0, 2]] * [1.0, 1.0, -1.0]
    if "quaternion" in turned:
        q = of(columns["quaternion"], np.nan)
    else:
        q = from_euler(np.deg2rad(of(columns["euler"], 0.0)))
    return place, attitude_to_ned(q, "FLU/ENU", "export")


def _vector(values: Array, names: str) -> dict[str, float]:
    return {name: float(value) for name, value in zip(names, values, strict=True)}


def _poses(stamps: Sequence[int], place: Array, q: Array) -> Iterator[tuple[Any, Any]]:
    """Transform and pose per row; None for both where the pose is not known."""
    known = np.isfinite(np.concatenate([place, q], axis=1)).all(axis=1)
    for k, stamp in enumerate(stamps):
        if not known[k]:
            yield None, None
            continue
        at, turned = _vector(place[k], "xyz"), _vector(q[k], "wxyz")
        time = {"sec": stamp // 1_000_000_000, "nsec": stamp % 1_000_000_000}
        moved = {"translation": at, "rotation": turned}
        yield (
            {"timestamp": time, "parent_frame_id": _EARTH, "child_frame_id": _BODY, **moved},
            {"timestamp": time, "frame_id": _EARTH, "pose": {"position": at, "orientation": turned}},
        )


def _trial_schema(columns: list[str]) -> dict[str, Any]:
    """JSON schema of ``/trial``: the unit of every column is its description."""
    fields: dict[str, Any] = {"t_s": {"type": "number", "description": "time, s"}}
    for column in columns:
        group, _, name = column.partition(".")
        entry = {"type": "number", "description": unit_of(column) or "unit of the actuator"}
        if name:
            inner = fields.setdefault(group, {"type": "object", "properties": {}})
            inner["properties"][name] = entry
        else:
            fields[column] = entry
    return {"title": "seatrial.Trial", "type": "object", "properties": fields}


def _object(title: str, **fields: Mapping[str, Any]) -> dict[str, Any]:
    """JSON schema of an object all of whose fields are required."""
    return {"title": title, "type": "object", "properties": fields, "required": list(fields)}


def _numbers(title: str, names: str) -> dict[str, Any]:
    return _object(title, **{name: {"type": "number"} for name in names})


_TIME = {
    "title": "time",
    "type": "object",
    "properties": {
        "sec": {"type": "integer", "minimum": 0},
        "nsec": {"type": "integer", "minimum": 0, "maximum": 999_999_999},
    },
}

_TEXT = {"type": "string"}

_TRANSFORM = _object(
    "foxglove.FrameTransform",
    timestamp=_TIME,
    parent_frame_id=_TEXT,
    child_frame_id=_TEXT,
    translation=_numbers("foxglove.Vector3", "xyz"),
    rotation=_numbers("foxglove.Quaternion", "xyzw"),
)

_POSE = _object(
    "foxglove.PoseInFrame",
    timestamp=_TIME,
    frame_id=_TEXT,
    pose=_object(
        "foxglove.Pose",
        position=_numbers("foxglove.Vector3", "xyz"),
        orientation=_numbers("foxglove.Quaternion", "xyzw"),
    ),
)
