"""Logs as strangers make them: small files of every format whose content is wrong in a way of its own.

`written` makes a file from a seed: a recording of a few channels whose names, stamps, values, units, types
and counts are changed as people and programs change them, written by the library that owns the format (or by
hand to its description), and in half of the files injured once more in its bytes: lengths and counts too.
A seed always makes the same file. Used by ``tests/logs/test_strangers.py`` and ``tests/logs/fuzz.py``.
"""

from __future__ import annotations

import gzip
import json
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.base.arrays import Array
from tests.logs.fuzz import mutated

_MOTION = (
    "x_m", "y_m", "z_m", "roll_deg", "pitch_deg", "yaw_deg", "u_m_s", "v_m_s", "w_m_s", "p_deg_s", "q_deg_s",
    "r_deg_s", "cmd.T1", "cmd.T2",
)  # fmt: skip
_NAMES = (
    *_MOTION, "t_s", "time", "timestamp", "t_ns", "date", "utc", "depth", "heading", "q0", "q1", "q2", "q3",
    "q_w", "latitude", "longitude", "pressure", "voltage_v", "pwm1", "rudder", "header.stamp.sec", "tau.X_n",
    "u_water_m_s", "current_north_m_s",
)  # fmt: skip
_ODD_NAMES = (
    "", " ", "a-b", "a_b", "é", "/*", "\u202eabc", "a.b.c", "n" * 3000, "#t", "1", "-1", "nan", '"', "a,b",
    "a\tb", "__init__", "x/y", "\u0000a", "yaw_deg [rad]", "depth (ft)", "time [ns]", "🐟", "a=b", "[0]",
)  # fmt: skip
_UNITS = ("", "s", "m", "rad", "deg", "m/s", "1", "µs", "knots", "%", "()", "furlong", "kg m^2", "[", "NED")
_ODD = (np.nan, np.inf, -np.inf, 1e300, -1e300, 1e308, 5e-324, 0.0, -9999.0, 99999.0, 65535.0, 2.0**63, -1.0)


@dataclass
class Channels:
    """A recording before it is written: stamps in s, and by name values and a unit."""

    t: Array
    values: dict[str, Array]
    units: dict[str, str]


def channels(rng: np.random.Generator) -> Channels:
    """Channels of a moving vehicle, changed in one to three ways."""
    rows = int(rng.choice([0, 1, 3, 12, 60, 300, 300, 300, 600, 600]))
    step = float(rng.choice([0.1, 0.1, 0.1, 0.02, 1.0, 1e-6, 1e4]))
    t: Array = np.asarray(np.arange(rows) * step + rng.choice([0.0, 0.0, 1.7e9, -5.0]), float)
    offered = _NAMES if rng.random() < 0.5 else _MOTION
    names = [str(name) for name in rng.choice(offered, int(rng.integers(1, 14)), replace=False)]
    phase = rng.uniform(0.0, 6.0, len(names))
    wide = rng.choice([0.0, 0.5, 1.0, 30.0, 1500.0], len(names))
    made = Channels(t, {}, {})
    for k, name in enumerate(names):
        noise = 0.01 * rng.standard_normal(rows)
        made.values[name] = wide[k] * np.sin(0.3 * np.arange(rows) + phase[k]) + noise
        made.units[name] = str(rng.choice(_UNITS)) if rng.random() < 0.3 else ""
    for _ in range(int(rng.integers(0, 4))):
        _changed(made, rng)
    return made


def _changed(made: Channels, rng: np.random.Generator) -> None:
    """One change in place: of stamps, of values, or of names."""
    rows, names = len(made.t), list(made.values)
    name = str(rng.choice(names))
    at = rng.integers(0, max(rows, 1), max(rows // 10, 1)) if rows else np.empty(0, int)
    match int(rng.integers(14)):
        case 0:
            made.t[at] = rng.choice(_ODD)
        case 1:
            made.t[:] = rng.choice(_ODD)
        case 2:
            made.t = made.t[::-1].copy()
        case 3:
            made.t = made.t * float(rng.choice([1e3, 1e6, 1e9, 1e290, 0.0, -1.0]))
        case 4:
            made.t[rows // 2 :] += float(rng.choice([1e9, 1e300, -1e9, 86_400.0, np.inf]))
        case 5:
            made.t = np.floor(made.t)
        case 6:
            made.t[rows // 2 :] -= made.t[rows // 2 : rows // 2 + 1].sum()
        case 7:
            made.values[name][at] = rng.choice(_ODD)
        case 8:
            made.values[name][:] = rng.choice(_ODD)
        case 9:
            made.values = {one: np.full(rows, 0.5) for one in names}
        case 10:
            made.values = {one: cells * 1e300 for one, cells in made.values.items()}
        case 11:
            odd = str(rng.choice(_ODD_NAMES))
            made.values = {odd if one == name else one: cells for one, cells in made.values.items()}
        case 12:
            made.values[name] = np.repeat(made.values[name][::7], 7)[:rows]
        case _:
            count = int(rng.integers(2, 40))
            made.values |= {f"{one}{k}": made.values[name] for k in range(count) for one in names[:3]}


def _cells(made: Channels, rng: np.random.Generator) -> dict[str, list[str]]:
    """Columns as text, some of them with words, dates or very long cells."""
    cells = {"time": [f"{t!r}" for t in made.t.tolist()]}
    cells |= {name: [f"{x:.6g}" for x in values.tolist()] for name, values in made.values.items()}
    for name, column in cells.items():
        if not column or rng.random() > 0.15:
            continue
        k = int(rng.integers(len(column)))
        match int(rng.integers(9)):
            case 0:
                column[k] = "x" * int(rng.choice([100, 5000, 140_000]))
            case 1:
                column[k] = '"' + "y" * int(rng.choice([100, 140_000])) + '"'
            case 2:
                column[:] = ["#REF!"] * len(column)
            case 3:
                column[:] = [f"2024-06-{1 + k % 28:02d}" for k in range(len(column))]
            case 4:
                column[:] = [f"12:{k // 60 % 60:02d}:{k % 60:02d}" for k in range(len(column))]
            case 5:
                column[:] = [f"2024-06-01T12:{k // 60 % 60:02d}:{k % 60:02d}Z" for k in range(len(column))]
            case 6:
                column[:] = [f"{int(1.7e18) + k * 10**8}" for k in range(len(column))]
            case 7:
                odd = ("", '"', "1e999", "-", "1,5", "0x1F", "1_000", "∞", "\ufeff", "9" * 400)
                column[k] = odd[int(rng.integers(len(odd)))]
            case _:
                column[:] = [cell.replace(".", ",") for cell in column]
        cells[name] = column
    return cells


def table(folder: Path, rng: np.random.Generator) -> Path:
    made = channels(rng)
    separator = str(rng.choice([",", ",", ";", "\t", " "]))
    cells = _cells(made, rng)
    lines = [separator.join(cells)] if rng.random() < 0.9 else []
    if rng.random() < 0.2:
        lines.append(separator.join(["s", *(made.units.get(name, "") for name in list(cells)[1:])]))
    lines += [separator.join(row) for row in zip(*cells.values(), strict=True)]
    text = ("\r\n" if rng.random() < 0.1 else "\n").join(lines) + "\n" * int(rng.integers(0, 2))
    encoding = str(rng.choice(["utf-8", "utf-8", "utf-8", "utf-16", "utf-8-sig", "cp1252"]))
    content = text.encode(encoding, "replace")
    ending = str(rng.choice([".csv", ".tsv", ".txt", ".dat", ".csv.gz"]))
    path = folder / f"nav{ending}"
    path.write_bytes(gzip.compress(content) if ending.endswith(".gz") else content)
    return path


def parquet(folder: Path, rng: np.random.Generator) -> Path:
    import polars as pl

    made = channels(rng)
    columns: dict[str, Any] = {"time": _typed(made.t, rng, time=True)}
    for name, values in made.values.items():
        columns[name or "unnamed"] = _typed(values, rng) if rng.random() < 0.3 else values
    path = folder / "nav.parquet"
    pl.DataFrame({name: pl.Series(name, cells) for name, cells in columns.items()}).write_parquet(path)
    return path


def _typed(values: Array, rng: np.random.Generator, *, time: bool = False) -> Any:
    """Values in one of the types of a column."""
    import polars as pl

    whole = np.clip(np.nan_to_num(values, posinf=0.0, neginf=0.0), -1e15, 1e15)
    kinds: tuple[Any, ...] = (
        pl.Float64, pl.Float32, pl.Int64, pl.String, pl.Date, pl.Time, pl.Datetime("ns"), pl.Datetime("ms"),
        pl.Duration("us"), pl.Categorical, pl.Boolean, pl.Null, pl.List(pl.Float64), pl.Binary, pl.UInt8,
        pl.Decimal(20, 3), pl.Int128,
    )  # fmt: skip
    kind = kinds[int(rng.integers(9 if time else len(kinds)))]
    series = pl.Series("x", values)
    if kind in (pl.Float64, pl.Float32):
        return series.cast(kind, strict=False)
    if kind == pl.List(pl.Float64):
        return pl.Series("x", [[x, x] for x in values.tolist()], dtype=kind)
    if kind in (pl.String, pl.Categorical, pl.Binary):
        return pl.Series("x", [str(x) for x in values.tolist()], dtype=pl.String).cast(kind)
    return pl.Series("x", whole.astype(np.int64)).cast(kind, strict=False)


def matlab(folder: Path, rng: np.random.Generator) -> Path:
    from scipy.io import savemat

    made = channels(rng)
    cells = {"time": made.t}
    for k, (name, values) in enumerate(made.values.items()):
        cells[f"v{k}" if rng.random() < 0.2 else _word(name)] = values
    path = folder / "nav.mat"
    whole: dict[str, Any] = {"nav": cells} if rng.random() < 0.6 else cells
    if rng.random() < 0.3:
        whole["more"] = {"time": made.t[::2], "angles": np.outer(made.t, [1.0, 2.0, 3.0])}
    savemat(path, whole, do_compression=bool(rng.random() < 0.5), long_field_names=True)
    return path


def _word(name: str) -> str:
    word = re.sub(r"[^A-Za-z0-9]", "_", name).strip("_")[:60]
    return word if word[:1].isalpha() else f"x{word}"


def matlab73(folder: Path, rng: np.random.Generator) -> Path:
    import h5py

    made = channels(rng)
    path = folder / "new.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("nav") if rng.random() < 0.6 else file
        group["time"] = made.t[None]
        for k, values in enumerate(made.values.values()):
            packed = "gzip" if rng.random() < 0.3 and len(values) else None
            group.create_dataset(_word(list(made.values)[k]) + str(k), data=values[None], compression=packed)
        if rng.random() < 0.1:
            group.create_dataset("huge", (2**31, 3), "f8", chunks=(1024, 3), compression="gzip")
        if rng.random() < 0.1:
            group["loop"] = h5py.SoftLink("/nav")
        if rng.random() < 0.1:
            group["outside"] = h5py.ExternalLink("/etc/passwd", "/")
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    return path


def alog(folder: Path, rng: np.random.Generator) -> Path:
    made = channels(rng)
    lines = ["%%%%", f"%% LOGSTART {rng.choice(['1.7e9', '1700000000.0', 'x', '9' * 400])}"]
    for k, t in enumerate(made.t.tolist()):
        for name, values in made.values.items():
            lines.append(f"{t!r}  {_word(name).upper()}  pNav  {values[k]!r}")
        lines.append(f"{t!r} NODE_REPORT pNodeReporter NAME=auv,X={t},SPD=1e999,YAW=nan")
    path = folder / "auv.alog"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def mcap(folder: Path, rng: np.random.Generator) -> Path:
    from mcap.writer import CompressionType, Writer

    made = channels(rng)
    path = folder / "nav.mcap"
    packing = [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD][int(rng.integers(3))]
    with path.open("wb") as stream:
        writer = Writer(stream, compression=packing)
        writer.start()
        schema = writer.register_schema("nav", "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel(str(rng.choice(["/nav", "", "/\u202e", "/a/b/c"])), "json", schema)
        for k, t in enumerate(made.t.tolist()):
            cells: dict[str, Any] = {name: float(values[k]) for name, values in made.values.items()}
            if rng.random() < 0.02:
                odd: tuple[Any, ...] = (None, "x", [[[1.0]] * 3], {"a": {"b": 1}}, 10**400, "\ud800")
                cells["odd"] = odd[int(rng.integers(len(odd)))]
            if rng.random() < 0.3:
                cells["header"] = {"stamp": {"sec": t, "nanosec": 5}}
            text = json.dumps(cells)
            if rng.random() < 0.005:
                texts = ("[" * 3000, '{"\\ud800": 1}', "9" * 5000, '"x"', "null", "", '{"a":' * 2000)
                text = texts[int(rng.integers(len(texts)))]
            ns = int(np.clip(np.nan_to_num(t), 0.0, 1.8e10) * 1e9)
            writer.add_message(channel, ns, text.encode("utf-8", "surrogatepass"), ns)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def _uint(x: float, bits: int = 64) -> int:
    return int(np.clip(np.nan_to_num(x, posinf=1e19, neginf=0.0), 0.0, 2.0**bits * 0.99))


def ulog(folder: Path, rng: np.random.Generator) -> Path:
    def frame(kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    made = channels(rng)
    names = [_word(name).lower() for name in made.values]
    form = f"nav:uint64_t timestamp;{''.join(f'float {name};' for name in names)}"
    frames = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0), frame("B", bytes(40))]
    if rng.random() < 0.2:  # types in one another
        many = int(rng.choice([2, 10, 60]))
        frames += [frame("F", f"n{k}:n{k + 1} a;n{k + 1} b;".encode()) for k in range(many)]
        frames.append(frame("F", f"n{many}:float x;".encode()))
        form += "n0 inner;"
    frames.append(frame("F", form.encode()[:60_000]))
    key = b"float SEA"
    frames += [frame("P", bytes([len(key)]) + key + struct.pack("<f", rng.choice([2.0, np.nan, np.inf])))]
    frames.append(frame("A", struct.pack("<BH", 0, 7) + b"nav"))
    with np.errstate(over="ignore"):
        for k, t in enumerate(made.t.tolist()):
            cells = [float(np.float32(values[k])) for values in made.values.values()]
            frames.append(frame("D", struct.pack(f"<HQ{len(cells)}f", 7, _uint(t * 1e6), *cells)))
    path = folder / "log.ulg"
    path.write_bytes(b"".join(frames))
    return path


_CODES = {"Q": "Q", "f": "f", "B": "B", "c": "h", "d": "d", "i": "i", "I": "I"}


def dataflash(folder: Path, rng: np.random.Generator) -> Path:
    def form(number: int, length: int, name: str, codes: str, columns: str) -> bytes:
        body = struct.pack("<BB4s16s64s", number, length, name.encode(), codes.encode(), columns.encode())
        return b"\xa3\x95\x80" + body

    made = channels(rng)
    names = [_word(name)[:8] or "x" for name in list(made.values)[:8]]
    codes = "Q" + "".join(rng.choice(["f", "d", "c", "B"], len(names)))
    called = str(rng.choice(["ATT", "IMU", "NAV", "RCOU", "GPS", "CTUN", "MODE", "XKF1"]))
    layout = "<" + "".join(_CODES[code] for code in codes)
    parts = [form(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")]
    parts.append(form(129, 3 + 28, "PARM", "QNf", "TimeUS,Name,Value"))
    parts.append(form(131, 3 + struct.calcsize(layout), called, codes, ",".join(["TimeUS", *names])))
    frame = float(rng.choice([2.0, np.inf, np.nan, -1.0, 1e30, 2.5]))
    servo = float(rng.choice([33.0, np.inf, np.nan]))
    for name, value in (("FRAME_CONFIG", frame), ("SERVO1_FUNCTION", servo)):
        parts.append(b"\xa3\x95\x81" + struct.pack("<Q16sf", 0, name.encode(), value))
    for k, t in enumerate(made.t.tolist()):
        cells: list[Any] = [_uint(t * 1e6)]
        for code, values in zip(codes[1:], made.values.values(), strict=False):
            least, most = {"B": (0, 255), "c": (-32_768, 32_767)}.get(code, (0, 0))
            whole = int(np.clip(np.nan_to_num(values[k]), least, most))
            cells.append(whole if code in "cB" else float(values[k]))
        with np.errstate(over="ignore"):
            cells = [float(np.float32(c)) if code == "f" else c for code, c in zip(codes, cells, strict=True)]
        parts.append(b"\xa3\x95\x83" + struct.pack(layout, *cells))
    path = folder / "00000001.BIN"
    path.write_bytes(b"".join(parts))
    return path


def dataflash_text(folder: Path, rng: np.random.Generator) -> Path:
    made = channels(rng)
    names = [_word(name) for name in made.values]
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    lines.append(f"FMT, 131, 20, NAV, Q{'f' * len(names)}, TimeUS,{','.join(names)}")
    lines.append(f"PARM, 0, FRAME_CONFIG, {rng.choice(['2', 'inf', 'nan', '1e400', 'x'])}")
    for k, t in enumerate(made.t.tolist()):
        lines.append(f"NAV, {t * 1e6!r}, " + ", ".join(f"{values[k]!r}" for values in made.values.values()))
    path = folder / "00000001.log"
    path.write_text("\n".join(lines) + "\n")
    return path


def tlog(folder: Path, rng: np.random.Generator) -> Path:
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    made = channels(rng)
    system, component = int(rng.integers(1, 256)), int(rng.integers(0, 256))
    sender = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    first = next(iter(made.values.values()))
    parts = []
    for k, t in enumerate(made.t.tolist()):
        with np.errstate(over="ignore"):
            u = float(np.float32(first[k]))
        message = mavlink.MAVLink_attitude_message(_uint(t * 1e3, 32), u, 0.1 * u, 0.0, 0.0, 0.0, u)
        parts.append(struct.pack(">Q", _uint(1.7e15 + t * 1e6)) + message.pack(sender))
        if k == 3:
            value = float(rng.choice([2.0, np.inf, np.nan]))
            named = mavlink.MAVLink_param_value_message(b"FRAME_CONFIG", value, 9, 1, 0)
            parts.append(struct.pack(">Q", _uint(1.7e15 + t * 1e6)) + named.pack(sender))
    path = folder / "flight.tlog"
    path.write_bytes(b"".join(parts))
    return path


def _float64_bag(made: Channels, write: Callable[[str, int, float], None]) -> None:
    for k, t in enumerate(made.t.tolist()):
        for name, values in list(made.values.items())[:4]:
            write(f"/{_word(name)}", int(np.clip(np.nan_to_num(t), 0.0, 4e9) * 1e9), float(values[k]))


def bag1(folder: Path, rng: np.random.Generator) -> Path:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store, kind, path = get_typestore(Stores.ROS1_NOETIC), "std_msgs/msg/Float64", folder / "dive.bag"
    writer = Writer(path)
    if rng.random() < 0.5:
        writer.set_compression(Writer.CompressionFormat[str(rng.choice(["BZ2", "LZ4"]))])
    writer.chunk_threshold = 4000
    with writer:
        known: dict[str, Any] = {}

        def write(topic: str, ns: int, value: float) -> None:
            if topic not in known:
                known[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(known[topic], ns, store.serialize_ros1(store.types[kind](data=value), kind))

        _float64_bag(channels(rng), write)
    return path


def bag2(folder: Path, rng: np.random.Generator) -> Path:
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store, kind, path = get_typestore(Stores.ROS2_HUMBLE), "std_msgs/msg/Float64", folder / "bag2"
    with Writer(path, version=9) as writer:
        known: dict[str, Any] = {}

        def write(topic: str, ns: int, value: float) -> None:
            if topic not in known:
                known[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(known[topic], ns, store.serialize_cdr(store.types[kind](data=value), kind))

        _float64_bag(channels(rng), write)
    database, description = next(path.glob("*.db3")), path / "metadata.yaml"
    match int(rng.integers(8)):
        case 0:
            database.unlink()
        case 1:
            description.unlink()
            return database
        case 2:
            database.write_bytes(mutated(database.read_bytes(), rng))
        case 3:
            description.write_bytes(mutated(description.read_bytes(), rng))
        case 4:
            database.write_bytes(b"")
    return path


def lsf(folder: Path, rng: np.random.Generator) -> Path:
    import imcpy

    made = channels(rng)
    packets = []
    first = next(iter(made.values.values()))
    for k, t in enumerate(made.t.tolist()):
        state = imcpy.EstimatedState()
        with np.errstate(over="ignore"):
            state.u = float(np.float32(first[k]))
        state.timestamp, state.src = t, 10
        packets.append(state.serialize())
    content = b"".join(packets)
    packed = rng.random() < 0.5
    path = folder / ("Data.lsf.gz" if packed else "Data.lsf")
    path.write_bytes(gzip.compress(content) if packed else content)
    return path


_ALL = (table, parquet, matlab, matlab73, alog, mcap, ulog, dataflash, dataflash_text, tlog, bag1, bag2, lsf)
WRITERS: dict[str, Callable[[Path, np.random.Generator], Path]] = {one.__name__: one for one in _ALL}
"""By format."""

_EXTREMES = (0, 1, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, 2**63 - 1, 2**64 - 1)


def written(folder: Path, format: str, seed: int) -> Path:
    """File of a format, made from a seed; half of them injured in their bytes."""
    rng = np.random.default_rng([seed, sorted(WRITERS).index(format)])
    with np.errstate(all="ignore"):  # values as large as the type holds
        path = WRITERS[format](folder, rng)
    if rng.random() < 0.5 and path.is_file():
        content = bytearray(path.read_bytes())
        if rng.random() < 0.5 and len(content) > 16:  # a length, a count or an offset
            width = int(rng.choice([1, 2, 4, 8]))
            at = int(rng.integers(0, min(len(content), int(rng.choice([64, 600, len(content)]))) - 8))
            value = _EXTREMES[int(rng.integers(len(_EXTREMES)))] % 2 ** (8 * width)
            content[at : at + width] = value.to_bytes(width, "little")
            path.write_bytes(bytes(content))
        else:
            path.write_bytes(mutated(bytes(content), rng))
    return path
