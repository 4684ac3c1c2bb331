"""Files that are made to exhaust who reads them: packed a thousand times, nested, endless, of absurd counts.

`built` makes one of a format from a seed, of some kilobytes up to 10 MB. Each is a whole file of its format
with one or two places changed in a way that a parser pays for; in a quarter its bytes are injured too.
``python -m tests.logs.bombs [CASES] [FORMAT]`` runs more of them than ``tests/logs/test_bombs.py`` does,
5,000 of every format, in a process of bounded memory, and prints how they ended and the dearest.
"""

from __future__ import annotations

import bz2
import contextlib
import gzip
import io
import json
import os
import resource
import shutil
import sqlite3
import struct
import sys
import tempfile
import time
import traceback
import warnings
import zipfile
from collections import Counter
from collections.abc import Callable, Sequence
from functools import cache, partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.base.errors import SeatrialError
from seatrial.intake.survey import survey
from seatrial.report.page.page import write_page
from seatrial.simulators.convert import export_model, import_model
from tests.logs import log_files
from tests.logs.fuzz import mutated, peak_mib

LONGEST_S, MOST_MIB = 10.0, 1024
"""Processor time, beyond which a case is counted, and growth of the process that none may cost."""

_HUNG_S = 60.0  # on any machine

_LIMIT_BYTES = 8 << 30  # of addresses: a case that asks for more fails instead of filling the machine

Rng = np.random.Generator


def _some(rng: Rng, *offered: Any) -> Any:
    return offered[int(rng.integers(len(offered)))]


def _zeros(rng: Rng) -> tuple[bytes, int]:
    """What packs well, and how often it is repeated: up to a hundred megabytes."""
    return bytes(_some(rng, b"\0", b"1,1\n", b"\xff")), int(_some(rng, 10, 10_000, 10**6, 3 * 10**7))


@cache
def _packed_zeros(kind: str, unit: bytes, count: int) -> bytes:
    """These, packed once for all cases."""
    return _packed(kind, unit * count)


def _packed(kind: str, content: bytes) -> bytes:
    import zstandard
    from lz4 import frame

    packers: dict[str, Callable[[bytes], bytes]] = {
        "gzip": partial(gzip.compress, compresslevel=1),
        "bz2": bz2.compress,
        "lz4": frame.compress,
        "zstd": zstandard.ZstdCompressor(1).compress,
        "zip": _zipped,
    }
    return packers[kind](content) if kind in packers else content


def _zipped(content: bytes) -> bytes:
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("nav.csv", content)
    return held.getvalue()


def table(folder: Path, rng: Rng) -> Path:
    """Text: long cells, lines and quotes, packed once, twice or in parts; an archive by that name."""
    rows = "".join(f"{k},{0.1 * k},{k % 7}\n" for k in range(int(_some(rng, 3, 300, 3000))))
    head, line = "time,u,v\n", rows.find("\n") + 1
    match int(rng.integers(9)):
        case 0:  # a cell as long as the module csv takes, and longer
            cell = _some(rng, "x", "1", '""', " ", "\n") * int(_some(rng, 131_071, 131_072, 131_073, 10**6))
            rows = rows[:line] + f'9,"{cell}",3\n' + rows[line:]
        case 1:
            head = "time,u" + ",u" * int(_some(rng, 100, 9_000, 200_000)) + "\n"
        case 2:
            rows = rows[:line] + "," * int(_some(rng, 10**3, 10**6, 5 * 10**6)) + "\n" + rows[line:]
        case 3:
            rows += _some(rng, '"', ',"', '"\n', '",""', "#") * int(_some(rng, 10**3, 10**5, 10**6))
        case 4:
            rows += _some(rng, "9", "9e", " ", "\t", "\0") * int(_some(rng, 10**3, 10**6, 9 * 10**6))
        case 5:
            head = "".join(f"{'#' * int(rng.integers(1, 9))} x\n" for _ in range(10**4)) + head
        case 6:
            head = _some(rng, '"', "a ", "(", "[") * int(_some(rng, 10**3, 10**5)) + head
        case _:
            pass
    content = (head + rows).encode(_some(rng, "utf-8", "utf-8", "utf-16"))
    name = "nav.csv"
    match int(rng.integers(6)):
        case 0:
            content, name = gzip.compress(content, 1) + _packed_zeros("gzip", *_zeros(rng)), "nav.csv.gz"
        case 1:
            content, name = gzip.compress(_packed_zeros("gzip", *_zeros(rng))), "nav.csv.gz"
        case 2:
            content, name = gzip.compress(content) * int(_some(rng, 2, 300, 3000)), "nav.csv.gz"
        case 3:
            content = _packed_zeros("zip", *_zeros(rng))
            name = str(_some(rng, "nav.csv", "nav.zip", "nav.csv.gz"))
        case _:
            pass
    (folder / name).write_bytes(content[:10_000_000])
    return folder / name


def lsf(folder: Path, rng: Rng) -> Path:
    """IMC: marks without packets, absurd lengths, thousands of senders, packed zeros."""
    whole = log_files.lsf(folder).read_bytes()
    many = int(_some(rng, 10, 10**3, 10**5))
    match int(rng.integers(6)):
        case 0:
            whole += b"\x54\xfe" * many
        case 1:
            whole += (b"\x54\xfe" + struct.pack("<HH", int(rng.integers(2000)), 65_535) + bytes(14)) * many
        case 2:  # of other systems and entities
            packet = bytearray(whole[: 22 + struct.unpack_from("<H", whole, 4)[0]])
            for k in range(min(many, 3000)):
                struct.pack_into("<HB", packet, 14, k % 65_536, k % 256)
                whole += packet
        case 3:
            whole += bytes(min(many * 90, 9_000_000)) + whole
        case 4:
            whole = whole * int(_some(rng, 2, 20)) + rng.bytes(min(many, 10**5))
        case _:
            pass
    if rng.random() < 0.6:
        path = folder / "Data.lsf.gz"
        more = _packed_zeros("gzip", *_zeros(rng)) if rng.random() < 0.4 else b""
        path.write_bytes((gzip.compress(whole, 1) + more)[:10_000_000])
        return path
    path = folder / "Data.lsf"
    path.write_bytes(whole[:10_000_000])
    return path


def ulog(folder: Path, rng: Rng) -> Path:
    """Types in one another, arrays of absurd length, thousands of types and subscriptions, marks, junk."""

    def frame(kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body) & 0xFFFF, ord(kind)) + body[:65_535]

    whole = log_files.ulog(folder).read_bytes()
    begin = whole.index(b"F", 16 + 43) - 2
    more, many = b"", int(_some(rng, 3, 30, 300, 3000))
    match int(rng.integers(10)):
        case 0 | 1:
            fan = int(_some(rng, 1, 2, 3, 9))
            wide = _some(rng, "", "", "[2]", "[100]", "[999999999]", "[-1]", "[]")
            inner = "".join(f"n{{}}{wide} a{j};" for j in range(fan))
            types = [f"n{k}:" + inner.replace("{}", str(k + 1)) for k in range(many)]
            types.append(f"n{many}:" + _some(rng, "float x;", "n0 x;", "", "uint8_t[65535] x;", "nowhere x;"))
            types.append("deep:uint64_t timestamp;n0 q;")
            more = b"".join(frame("F", text.encode()) for text in types)
            more += frame("A", struct.pack("<BH", 0, 8) + b"deep")
            more += frame("D", struct.pack("<HQ", 8, 1) + bytes(int(_some(rng, 0, 4, 1000, 60_000)))) * 5
        case 2:
            more = frame("F", b"wide:uint64_t timestamp;" + b"float a;" * many)
            more += b"".join(frame("A", struct.pack("<BH", k % 256, 9 + k) + b"wide") for k in range(many))
        case 3:
            size = int(_some(rng, 0, 65_535, 10**9, 10**30))
            more = frame(
                "F", f"big:uint64_t timestamp;{_some(rng, 'float', 'char', 'nav')}[{size}] a;".encode()
            )
            more += frame("A", struct.pack("<BH", 0, 8) + b"big") + frame("D", struct.pack("<HQ", 8, 5))
        case 4:
            more = _some(rng, b"\x2f\x73\x13\x20\x25\x0c\xbb\x12", b"D", b"\0", b"\x0a\0D\7\0") * many * 40
        case 5:
            more = frame("I", bytes([255]) + b"char[4000000000] x") * many
        case 6:
            more = frame("M", bytes([1, 9]) + b"char[1] x" + b"y" * int(_some(rng, 1, 60_000))) * many
        case 7:  # data that are said to lie behind the end
            flags = struct.pack("<16B3Q", *([0] * 8), 1, *([0] * 7), *(int(_some(rng, 1, 2**40, 2**63)),) * 3)
            whole = whole[:16] + frame("B", flags) + whole[16 + 43 :]
            begin = whole.index(b"F", 16 + 43) - 2
        case 8:
            more = frame("P", bytes([9]) + b"float " + b"abc" + struct.pack("<f", 1.0)) * many
        case _:
            more = frame("O", struct.pack("<H", 9)) * many + frame("L", b"7" + bytes(8) + b"x" * 60_000) * 9
    at = begin if rng.random() < 0.5 else len(whole)
    (folder / "log.ulg").write_bytes((whole[:at] + more + whole[at:])[:10_000_000])
    return folder / "log.ulg"


_DEFINITIONS = (
    "float64 data",
    "float64[1000000000] data",
    "int8[] data",
    "std_msgs/A[1000] a\n===\nMSG: std_msgs/A\nstd_msgs/B[1000] b\n===\nMSG: std_msgs/B\n"
    "std_msgs/C[1000] c\n===\nMSG: std_msgs/C\nint8 x",
    "std_msgs/Float64[2] a",
    "std_msgs/E[1000000000] a\n===\nMSG: std_msgs/E\nint8 C=1",
    "".join(f"float64 a{k}\n" for k in range(1_500)),
    "string[] data",
    "float64 " + "d" * 9_000,
    "(" * 500,
    "float64 data #" + "=" * 9_000,
)
"""Of messages: absurd and endless lengths, types in one another and in themselves."""


def _messages(rng: Rng) -> bytes:
    """The data of a message: an honest one, lengths that are none, or much of nothing."""
    lengths = (struct.pack("<d", 1.0), b"\xff" * 8, b"", bytes(10**6), struct.pack("<I", 2**31 - 1))
    return bytes(_some(rng, *lengths))


def bag1(folder: Path, rng: Rng) -> Path:
    """ROS 1: chunks that unpack to much, counts, sizes and definitions that are absurd."""

    def record(header: dict[str, bytes], data: bytes, size: int | None = None) -> bytes:
        fields = b"".join(
            struct.pack("<I", len(k) + 1 + len(v)) + k.encode() + b"=" + v for k, v in header.items()
        )
        count = len(data) if size is None else size
        return struct.pack("<I", len(fields)) + fields + struct.pack("<I", count & 0xFFFFFFFF) + data

    u32 = struct.Struct("<I").pack
    many = int(_some(rng, 1, 10, 1000))
    kinds = {"topic": b"/u", "type": b"std_msgs/Float64", "md5sum": b"fdb28210bfa9d7c91146260178d9a584"}
    text = {**kinds, "message_definition": str(_some(rng, *_DEFINITIONS)).encode()}
    about = b"".join(u32(len(k) + 1 + len(v)) + k.encode() + b"=" + v for k, v in text.items())
    connection = b"".join(
        record({"op": b"\x07", "conn": u32(k), "topic": b"/u" if k == 0 else b"/u%d" % k}, about)
        for k in range(min(many, 200))
    )
    data = _messages(rng)
    messages = b"".join(
        record({"op": b"\x02", "conn": u32(0), "time": struct.pack("<II", k, 0)}, data)
        for k in range(many if len(data) < 1000 else 3)
    )
    inside = connection + messages
    packing = str(_some(rng, "none", "bz2", "lz4", "lz4", "bz2", "zstd"))
    packed = _packed(packing, inside)
    if packing != "none" and rng.random() < 0.4:
        packed = (
            _packed_zeros(packing, *_zeros(rng))
            if rng.random() < 0.5
            else packed + _packed_zeros(packing, *_zeros(rng))
        )
    size = int(_some(rng, len(inside), len(inside), 10, 2**32 - 1, 2**28))
    chunk = record({"op": b"\x05", "compression": packing.encode(), "size": u32(size & 0xFFFFFFFF)}, packed)
    chunk *= int(_some(rng, 1, 1, 5))
    index, chunks = b"", int(_some(rng, 1, 1, 2**31, 2**32 - 1))
    if rng.random() < 0.7:  # an index as rosbag writes it
        place = 13 + 4096
        index = record({"op": b"\x07", "conn": u32(0), "topic": b"/u"}, about)
        facts = {"op": b"\x06", "ver": u32(1), "chunk_pos": struct.pack("<Q", place)}
        facts |= {"start_time": bytes(8), "end_time": u32(many) + bytes(4), "count": u32(1)}
        index += record(facts, u32(0) + u32(int(_some(rng, many, 2**32 - 1))))
    entry = u32(0) + u32(0) + u32(len(connection))
    told = int(_some(rng, 1, 1, 2**32 - 1))
    between = record({"op": b"\x04", "ver": u32(1), "conn": u32(0), "count": u32(told)}, entry)
    at = 13 + 4096 + len(chunk) + len(between)
    head = {"op": b"\x03", "index_pos": struct.pack("<Q", at if index else 0)}
    head |= {"conn_count": u32(1), "chunk_count": u32(chunks)}
    bag = record(head, b" " * (4096 - 8 - sum(len(k) + 5 + len(v) for k, v in head.items())))
    whole = b"#ROSBAG V2.0\n" + bag + chunk + between + index
    (folder / "dive.bag").write_bytes(whole[:10_000_000])
    return folder / "dive.bag"


def database(folder: Path, computed: str, *, rows: int, data: bytes) -> Path:
    """Database of rosbag2 with messages of these data, the first of them whole; or with a computed column."""
    path = folder / "a.db3"
    with contextlib.closing(sqlite3.connect(path)) as base, base:
        base.execute(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT,"
            " offered_qos_profiles TEXT)"
        )
        base.execute("INSERT INTO topics VALUES(1, '/u', 'std_msgs/msg/Float64', 'cdr', '')")
        columns = "id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB"
        base.execute(f"CREATE TABLE messages({columns}{computed})")
        cells = "id, topic_id, timestamp" if computed else "id, topic_id, timestamp, data"
        for k in range(rows):
            row = (k, 1, k * 10**8) if computed else (k, 1, k * 10**8, data if k < 9 else data[:1000])
            base.execute(f"INSERT INTO messages({cells}) VALUES({','.join('?' * len(row))})", row)
    return path


def bag2(folder: Path, rng: Rng) -> Path:
    """ROS 2: messages and files that unpack to much, columns that SQLite computes, absurd metadata."""
    path = folder / "bag2"
    path.mkdir()
    facts: dict[str, Any] = {
        "version": 5, "storage_identifier": "sqlite3", "duration": {"nanoseconds": 10**9},
        "starting_time": {"nanoseconds_since_epoch": 0}, "message_count": 3, "compression_format": "",
        "compression_mode": "", "relative_file_paths": ["a.db3"],
    }  # fmt: skip
    one = {"name": "/u", "type": "std_msgs/msg/Float64", "serialization_format": "cdr"}
    facts["topics_with_message_count"] = [
        {"topic_metadata": {**one, "offered_qos_profiles": ""}, "message_count": 3}
    ] * int(_some(rng, 1, 1, 100))
    data = b"\0\1\0\0" + _messages(rng)
    how = int(rng.integers(7))
    if how in (0, 1):
        facts |= {"compression_format": "zstd", "compression_mode": _some(rng, "message", "file")}
        if facts["compression_mode"] == "message":
            unit, count = _zeros(rng)
            data = _packed("zstd", data + unit * count)
    if how == 6:
        facts |= {"storage_identifier": "mcap", "relative_file_paths": ["nav.mcap"]}
        mcap(path, rng)
    else:
        computed = " GENERATED ALWAYS AS (zeroblob(900000000))" if how == 2 else ""
        database(path, computed, rows=int(_some(rng, 3, 30)), data=data)
        if facts["compression_mode"] == "file":
            unit, count = _zeros(rng)
            content = (path / "a.db3").read_bytes() + unit * count
            (path / "a.db3").unlink()
            (path / "a.db3.zstd").write_bytes(_packed("zstd", content))
            facts["relative_file_paths"] = ["a.db3.zstd"]
    if how == 3:
        facts["relative_file_paths"] = facts["relative_file_paths"] * 300
    text = json.dumps({"rosbag2_bagfile_information": facts})
    if how == 4:  # entities of YAML in one another
        names = [f"a{k}" for k in range(int(_some(rng, 5, 30)))]
        lines = [f"{names[0]}: &{names[0]} [x, x, x, x, x, x, x, x, x]"]
        lines += [f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]" for a, b in pairwise(names)]
        text = "\n".join(lines) + f"\nrosbag2_bagfile_information: *{names[-1]}\n"
    if how == 5:
        text = _some(rng, "[", "{a: ", "- ", "? ", "&a [*a, ") * int(_some(rng, 900, 50_000))
    (path / "metadata.yaml").write_text(text)
    return path


def mcap(folder: Path, rng: Rng) -> Path:
    """MCAP: chunks that unpack to much or say so, chunks in chunks, deep JSON, absurd definitions."""

    def record(kind: int, content: bytes, size: int | None = None) -> bytes:
        return bytes([kind]) + struct.pack("<Q", len(content) if size is None else size) + content

    def text(content: bytes) -> bytes:
        return struct.pack("<I", len(content)) + content

    as_json = rng.random() < 0.5
    definition = str(_some(rng, *_DEFINITIONS)).encode()
    schema = struct.pack("<H", 1) + text(b"std_msgs/msg/Float64")
    schema += text(b"jsonschema") + text(b"{}") if as_json else text(b"ros2msg") + text(definition)
    channel = text(b"json" if as_json else b"cdr") + text(b"")
    many = int(_some(rng, 1, 20, 3000))
    data = b"\0\1\0\0" + _messages(rng)
    if as_json:
        deep = int(_some(rng, 3, 900, 90_000))
        plain = json.dumps({"u": 1.0, **{f"x{k}": k for k in range(int(_some(rng, 0, 3, 3000)))}}).encode()
        data = _some(rng, b"[" * deep, b'{"a":' * deep, b'{"a":[' * deep, b"9" * deep, plain, plain)
    messages = [record(3, schema)]
    messages += [
        record(4, struct.pack("<HH", k, 1) + text(b"/u%d" % k) + channel) for k in range(min(many, 300))
    ]
    messages += [
        record(5, struct.pack("<HIQQ", k % min(many, 300), k, k, k) + data)
        for k in range(many if len(data) < 10**5 else 5)
    ]
    inside = b"".join(messages)
    packing = str(_some(rng, "", "lz4", "zstd", "lz4", "zstd"))
    packed = _packed(packing, inside)
    if packing and rng.random() < 0.4:
        packed = (
            _packed_zeros(packing, *_zeros(rng))
            if rng.random() < 0.5
            else packed + _packed_zeros(packing, *_zeros(rng))
        )
    size = int(_some(rng, len(inside), len(inside), 10, 2**40, 2**63))
    chunk = struct.pack("<QQQI", 0, many, size, 0) + text(packing.encode())
    chunk = record(6, chunk + struct.pack("<Q", int(_some(rng, len(packed), len(packed), 2**50))) + packed)
    chunk *= int(_some(rng, 1, 1, 9))
    whole = b"\x89MCAP0\r\n" + record(1, text(b"") + text(b"")) + chunk
    if rng.random() < 0.5:
        whole += record(2, bytes(20)) + b"\x89MCAP0\r\n"
    (folder / "nav.mcap").write_bytes(whole[:10_000_000])
    return folder / "nav.mcap"


def svg(folder: Path, rng: Rng) -> Path:
    """A figure in a run's folder: comments without an end, or very many, long paths, deep groups, blanks."""
    many = int(_some(rng, 10, 10**4, 3 * 10**5))
    pieces = (
        "<!-- a -->", "<!--", "-->", "<metadata>", "</metadata>", "<metadata></metadata>",
        "<!-- <metadata> -->", "<g>", " ", "\n\t", "<", ">", '"', "%", "&lt;", "1.23456789 ", "M 1.5 2.5 L ",
        '<path d="',        '<path d="M 1.25 2.25 ', " L 1.23456 2.34567", "<!-", "--", "é",
    )  # fmt: skip
    inside = "".join(
        str(_some(rng, *pieces)) * int(_some(rng, 1, 3, many)) for _ in range(int(rng.integers(1, 7)))
    )
    (folder / "figures").mkdir()
    facts = {"kind": "flight", "name": "x", "versions": {}, "sha256": {}, "options": {}, "wall_s": 1.0}
    facts["finished_utc"] = "2026-01-01T00:00:00Z"
    (folder / "run.json").write_text(json.dumps(facts))
    (folder / "summary.txt").write_text("Good: x\nWorst: y\nNext: z\n")
    head = _some(
        rng, "<svg xmlns='http://www.w3.org/2000/svg'>", "", "<?xml version='1.0'?><!DOCTYPE x><svg>"
    )
    (folder / "figures" / "track.svg").write_text((head + inside + "</svg>")[:9_000_000])
    return folder


def model(folder: Path, rng: Rng) -> Path:
    """SDF and xacro: entities, depth, numbers of elements, macros that expand themselves, long texts."""
    many = int(_some(rng, 5, 99, 101, 9_000, 120_000))
    pieces = (
        "<link>", "<a/>", "<link name='b'></link>", "<pose>1 2 3 4 5 6</pose>", "&a;", "${x}", "1 ",
        "<xacro:m/>", "<!-- -->", "<![CDATA[x]]>", "<a b='c'", "x", "<xUabsU>-1</xUabsU>",
        "<include><uri>/etc/passwd</uri></include>",
    )  # fmt: skip
    inside = str(_some(rng, *pieces)) * many
    entities = "".join(f"<!ENTITY a{k} '{f'&a{k + 1};' * 9}'>" for k in range(30))
    doctypes = (f"<!DOCTYPE a [{entities}<!ENTITY a30 'x'>]>", "<!DOCTYPE a SYSTEM 'file:///dev/zero'>")
    head = str(_some(rng, *doctypes)) if rng.random() < 0.3 else ""
    macro = "<xacro:macro name='m'>" + "<xacro:m/>" * 9 + "</xacro:macro>" if rng.random() < 0.3 else ""
    whole = export_model("cwolf").text
    at = int(
        _some(rng, whole.index("<model"), *(whole.index(end) for end in ("</link>", "</model>", "</plugin>")))
    )
    path = folder / str(_some(rng, "rov.sdf", "rov.urdf.xacro", "rov.urdf"))
    path.write_text((head + whole[whole.index("<sdf") : at] + macro + inside + whole[at:])[:9_000_000])
    return path


_LOGS = (table, lsf, ulog, bag1, bag2, mcap)
BOMBS: dict[str, Callable[[Path, Rng], Path]] = {maker.__name__: maker for maker in (*_LOGS, svg, model)}
"""By format."""


def use(format: str, path: Path) -> None:
    """What a user does with such a file."""
    if format == "svg":
        write_page([path], path / "page.html")
    elif format == "model":
        import_model(path)
    else:
        survey([path])


def built(folder: Path, format: str, seed: int) -> Path:
    """File of a format, made from a seed."""
    rng = np.random.default_rng([seed, sorted(BOMBS).index(format)])
    path = BOMBS[format](folder, rng)
    if rng.random() < 0.25 and path.is_file():
        path.write_bytes(mutated(path.read_bytes(), rng))
    return path


def outcome(format: str, path: Path) -> tuple[str, str, float, int]:
    """How the use ended ("accepted", "refused"), what is wrong with it, processor time, s, growth, MiB."""
    before, begun = peak_mib(reset=True), time.process_time()
    ended, wrong = "accepted", ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            use(format, path)
    except SeatrialError as error:
        ended, sentence = "refused", str(error)
        if len(sentence) > 2000 or not sentence.replace("\n", "").isprintable():
            wrong = f"a sentence not fit to show: {sentence[:300]!r}"
    except Exception:
        wrong = traceback.format_exc()
    spent, grown = time.process_time() - begun, peak_mib() - before
    if not wrong and (spent > _HUNG_S or grown > MOST_MIB):
        wrong = f"{spent:.1f} s, {grown} MiB"
    return ended, wrong, spent, grown


def run(format: str, seeds: Sequence[int]) -> tuple[Counter[str], list[str], str]:
    """Counts, what is wrong, and the dearest case, of some seeds."""
    counts: Counter[str] = Counter()
    wrong, dearest = [], (0.0, 0, "")
    with tempfile.TemporaryDirectory() as place:
        for seed in seeds:
            folder = Path(place) / "case"
            folder.mkdir()
            path = built(folder, format, seed)
            ended, why, spent, grown = outcome(format, path)
            counts[ended] += 1
            counts["beyond 10 s"] += spent > LONGEST_S
            if why:
                wrong.append(f"{format} {seed}: {why}")
                print(wrong[-1], flush=True)
            dearest = max(dearest, (spent, grown, f"{format} {seed}"))
            shutil.rmtree(folder)
    return counts, wrong, f"{dearest[0]:.1f} s, {dearest[1]} MiB ({dearest[2]})"


def main() -> int:
    """Run cases; exit code 1 where something is wrong."""
    resource.setrlimit(resource.RLIMIT_AS, (_LIMIT_BYTES, _LIMIT_BYTES))
    cases = int(sys.argv[1]) if len(sys.argv) > 1 else 5000
    begin = int(os.environ.get("FIRST_SEED", "0"))
    failures = 0
    for format in sys.argv[2:] or BOMBS:
        counts, wrong, dearest = run(format, range(begin, begin + cases))
        failures += len(wrong)
        print(f"{format:6} {dict(counts)}, wrong {len(wrong)}, dearest {dearest}", flush=True)
    return int(failures > 0)


if __name__ == "__main__":
    sys.exit(main())
