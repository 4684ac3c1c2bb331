"""One small log of every format, written by the library that owns the format, of the same known motion."""

from __future__ import annotations

import gzip
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

T = np.arange(0.0, 20.0, 0.1)
"""Stamps, s."""

U = np.sin(T)
"""A velocity, m/s."""

UNIX_S = 1.7e9
"""Unix time of the first stamp where a format has Unix time."""

_NS = 1_000_000_000


def _ns(t: float) -> int:
    return int(UNIX_S) * _NS + round(t * 1e9)


def write(folder: Path) -> dict[str, Path]:
    """Write the logs; their paths by kind."""
    writers = (
        csv, spreadsheet, blanks, utf16, parquet, matlab, matlab73, alog, lsf, lsf_gz, ulog, dataflash,
        dataflash_text, tlog, bag1, bag2_sqlite, mcap_ros2, mcap_json,
    )  # fmt: skip
    return {writer.__name__: writer(folder) for writer in writers}


def csv(folder: Path) -> Path:
    path = folder / "nav.csv"
    rows = (f"{t:.2f},{u!r}" for t, u in zip(T.tolist(), U.tolist(), strict=True))
    path.write_text("time,u\ns,m/s\n" + "\n".join(rows) + "\n")
    return path


def spreadsheet(folder: Path) -> Path:
    """Title rows, semicolons, decimal commas, a spreadsheet's error in line 60."""
    path = folder / "export.csv"
    rows = [
        f"{t:.2f};{u!r};{3.0 * t:.1f}".replace(".", ",") for t, u in zip(T.tolist(), U.tolist(), strict=True)
    ]
    rows[55] = rows[55].rpartition(";")[0] + ";#REF!"
    path.write_text(
        "Export of mission 4\n\nTime [s];Speed (m/s);Heading\ns;m/s;deg\n" + "\n".join(rows) + "\n"
    )
    return path


def blanks(folder: Path) -> Path:
    path = folder / "table.txt"
    rows = (f"  {t:.2f}   {u!r}\t{3.0 * t:.1f}" for t, u in zip(T.tolist(), U.tolist(), strict=True))
    path.write_text("# t u heading\n" + "\n".join(rows) + "\n")
    return path


def utf16(folder: Path) -> Path:
    path = folder / "wide.csv"
    rows = (f"{round(t * 1e3)},{u!r}" for t, u in zip(T.tolist(), U.tolist(), strict=True))
    path.write_bytes(("time_ms,u\n" + "\n".join(rows) + "\n").encode("utf-16"))
    return path


def parquet(folder: Path) -> Path:
    import polars as pl

    path = folder / "nav.parquet"
    pl.DataFrame({"t_s": T, "u": U, "remark": ["calm"] * len(T)}).write_parquet(path)
    return path


def matlab(folder: Path) -> Path:
    from scipy.io import savemat

    path = folder / "old.mat"
    savemat(path, {"nav": {"time": T, "u": U, "angles": np.outer(U, [1.0, 2.0, 3.0])}, "note": "calm"})
    return path


def matlab73(folder: Path) -> Path:
    import h5py

    path = folder / "new.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("nav")
        group["time"], group["u"] = T[None], U[None]
        group["angles"] = np.outer([1.0, 2.0, 3.0], U)
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    return path


def alog(folder: Path) -> Path:
    path = folder / "auv.alog"
    lines = ["%%%%%%%%", "%% LOG FILE: ./auv.alog", f"%% LOGSTART           {UNIX_S:.2f}", "%%%%%%%%"]
    for t, u in zip(T.tolist(), U.tolist(), strict=True):
        lines.append(f"{t:.3f}   NAV_SPEED   uSimMarine   {u!r}")
        lines.append(f"{t:.3f}   NODE_REPORT   pNodeReporter   NAME=auv,X={t},Y=2,SPD={u!r}")
    path.write_text("\n".join([*lines, "20.0 DEPLOY pHelm true"]) + "\n")
    return path


def lsf(folder: Path) -> Path:
    import imcpy

    path = folder / "Data.lsf"
    packets = []
    for t, u in zip(T.tolist(), U.tolist(), strict=True):
        state = imcpy.EstimatedState()
        state.u, state.timestamp, state.src = u, UNIX_S + t, 10
        packets.append(state.serialize())
        for entity in (1, 2):
            angles = imcpy.EulerAngles()
            angles.psi, angles.timestamp, angles.src, angles.src_ent = u * entity, UNIX_S + t, 10, entity
            packets.append(angles.serialize())
    path.write_bytes(b"".join(packets))
    return path


def lsf_gz(folder: Path) -> Path:
    path = folder / "Data.lsf.gz"
    path.write_bytes(gzip.compress((folder / "Data.lsf").read_bytes()))
    return path


def ulog(folder: Path) -> Path:
    """By hand, to PX4's description: header, flags, format, parameter, subscription, samples."""

    def frame(kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    key = b"float SEA_STATE"
    frames = [
        b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0),
        frame("B", bytes(40)),
        frame("F", b"nav:uint64_t timestamp;float u;float[2] angles;"),
        frame("P", bytes([len(key)]) + key + struct.pack("<f", 2.0)),
        frame("A", struct.pack("<BH", 0, 7) + b"nav"),
    ]
    for t, u in zip(T.tolist(), U.tolist(), strict=True):
        frames.append(frame("D", struct.pack("<HQfff", 7, round(t * 1e6), u, u, 2.0 * u)))
    path = folder / "log.ulg"
    path.write_bytes(b"".join(frames))
    return path


_TYPES = (
    # number, name, format, columns, units and multipliers
    (129, "PARM", "QNf", "TimeUS,Name,Value"),
    (130, "MODE", "QMBB", "TimeUS,Mode,ModeNum,Rsn"),
    (131, "NAV", "QBfc", "TimeUS,I,U,Yaw"),
    (132, "MSG", "QZ", "TimeUS,Message"),
)
_STRUCT = {"Q": "Q", "N": "16s", "f": "f", "M": "B", "B": "B", "c": "h", "Z": "64s"}


def dataflash(folder: Path) -> Path:
    """By hand, to ArduPilot's description: messages of fixed length after their FMT messages."""

    def message(number: int, *values: Any) -> bytes:
        codes = {k: f for k, _, f, _ in _TYPES}[number]
        return b"\xa3\x95" + bytes([number]) + struct.pack("<" + "".join(_STRUCT[c] for c in codes), *values)

    def form(number: int, length: int, name: str, codes: str, columns: str) -> bytes:
        body = struct.pack("<BB4s16s64s", number, length, name.encode(), codes.encode(), columns.encode())
        return b"\xa3\x95\x80" + body

    parts = [form(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")]
    for number, name, codes, columns in _TYPES:
        length = 3 + struct.calcsize("<" + "".join(_STRUCT[c] for c in codes))
        parts.append(form(number, length, name, codes, columns))
    parts.append(message(132, 0, b"ArduSub V4.1.0"))
    parts.append(message(129, 0, b"FRAME_CONFIG", 2.0))
    parts.append(message(130, 500_000, 2, 2, 0))
    for t, u in zip(T.tolist(), U.tolist(), strict=True):
        for instance in (0, 1):
            parts.append(message(131, round(t * 1e6), instance, u + instance, round(100.0 * u)))
    path = folder / "00000001.BIN"
    path.write_bytes(b"".join(parts))
    return path


def dataflash_text(folder: Path) -> Path:
    lines = [
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
        "FMT, 131, 20, NAV, Qff, TimeUS,U,Yaw",
    ]
    lines += [
        f"NAV, {round(t * 1e6)}, {u!r}, {2.0 * u!r}" for t, u in zip(T.tolist(), U.tolist(), strict=True)
    ]
    path = folder / "00000001.log"
    path.write_text("\n".join(lines) + "\n")
    return path


def tlog(folder: Path) -> Path:
    """Messages stamped by a ground station that receives them up to 40 ms late."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    late = np.random.default_rng(1).uniform(0.0, 0.04, len(T))
    late[7] = 0.0
    parts = []
    for k, (t, u) in enumerate(zip(T.tolist(), U.tolist(), strict=True)):
        message = mavlink.MAVLink_attitude_message(1000 + round(t * 1e3), u, 0.0, 0.0, 0.0, 0.0, 0.0)
        parts.append(struct.pack(">Q", round((UNIX_S + t + late[k]) * 1e6)) + message.pack(sender))
    path = folder / "flight.tlog"
    path.write_bytes(b"".join(parts))
    return path


def _odometry(store: Any, t: float, u: float) -> Any:
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](sec=_ns(t) // _NS, nanosec=_ns(t) % _NS)
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="map")
    zero = types["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
    pose = types["geometry_msgs/msg/Pose"](
        position=types["geometry_msgs/msg/Point"](x=0.0, y=0.0, z=0.0),
        orientation=types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
    )
    twist = types["geometry_msgs/msg/Twist"](
        linear=types["geometry_msgs/msg/Vector3"](x=u, y=0.0, z=0.0), angular=zero
    )
    covariance = np.zeros(36)
    return types["nav_msgs/msg/Odometry"](
        header=header,
        child_frame_id="base",
        pose=types["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=covariance),
        twist=types["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=covariance),
    )


def _bag2(path: Path, plugin: str) -> Path:
    from rosbags.rosbag2 import Writer
    from rosbags.rosbag2.enums import StoragePlugin
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(path, version=9, storage_plugin=StoragePlugin[plugin]) as writer:
        connection = writer.add_connection("/odom", "nav_msgs/msg/Odometry", typestore=store)
        for t, u in zip(T.tolist(), U.tolist(), strict=True):
            cells = store.serialize_cdr(_odometry(store, t, u), "nav_msgs/msg/Odometry")
            writer.write(connection, _ns(t) + 5_000_000, cells)  # recorded 5 ms after its own stamp
    return path


def bag1(folder: Path, packed: str = "none") -> Path:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    path = folder / "dive.bag"
    writer = Writer(path)
    if packed != "none":
        writer.set_compression(Writer.CompressionFormat[packed])
    writer.chunk_threshold = 4000  # bytes: several chunks
    with writer:
        connection = writer.add_connection("/u", "std_msgs/msg/Float64", typestore=store)
        for t, u in zip(T.tolist(), U.tolist(), strict=True):
            message = store.types["std_msgs/msg/Float64"](data=u)
            writer.write(connection, _ns(t), store.serialize_ros1(message, "std_msgs/msg/Float64"))
    return path


def bag2_sqlite(folder: Path) -> Path:
    return _bag2(folder / "bag2", "SQLITE3")


def mcap_ros2(folder: Path) -> Path:
    return next(_bag2(folder / "bag3", "MCAP").glob("*.mcap"))


def mcap_json(folder: Path) -> Path:
    from mcap.writer import Writer

    path = folder / "nav.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("nav", "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel("/nav", "json", schema)
        for t, u in zip(T.tolist(), U.tolist(), strict=True):
            writer.add_message(channel, _ns(t), json.dumps({"u": u}).encode(), _ns(t))
        writer.finish()  # type: ignore[no-untyped-call]
    return path
