"""ROS 1 and ROS 2 bags by rosbags; no ROS needed. MCAP files are read by `mcap`.

Message definitions come with the bag; where a ROS 2 bag has none, those of the distribution Humble are taken,
with a note. A ROS 1 bag that was cut off has no index: `rosbag1` reads what is whole of it.
"""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from seatrial.base.errors import TrialError, foreign
from seatrial.logs.formats import extra
from seatrial.logs.log import Log
from seatrial.logs.messages import Bag, Message, learnt
from seatrial.logs.rosbag1 import open_cut


def open_log(path: Path) -> Log:
    """Bag.

    Raises
    ------
    TrialError
        If a package is missing or the bag holds no message that can be read.
    """
    try:
        return learnt(_Ros(path, "rosbag"))
    except TrialError:
        if (cut := open_cut(path)) is not None:
            return cut
        raise


class _Ros(Bag):
    """A bag of ROS 1 or ROS 2 by rosbags."""

    def messages(self, topics: set[str] | None) -> Iterator[Message]:
        highlevel = extra("rosbags.highlevel", self.path)
        typesys = extra("rosbags.typesys", self.path)
        store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        with contextlib.ExitStack() as stack:
            try:
                bag = stack.enter_context(highlevel.AnyReader([self.path], default_typestore=store))
            except Exception as error:  # a damaged bag may raise anything in rosbags
                why = _missing(self.path) or f"not readable as a bag ({foreign(error)})"
                raise TrialError(
                    f"{self.path}: {why}; fetch the bag again, or repair it with `rosbag reindex` or"
                    " `ros2 bag reindex`"
                ) from None
            if bag.is2 and not any(connection.msgdef.data for connection in bag.connections):
                self.remark("the bag has no message definitions; those of ROS 2 Humble were taken")
            used = [c for c in bag.connections if topics is None or c.topic in topics]
            known = []
            for connection in used:
                self.kinds[connection.topic] = connection.msgtype
                if connection.msgtype in bag.typestore.fielddefs:
                    known.append(connection)
                else:
                    self.note(
                        f"{connection.topic}: messages of the unknown type {connection.msgtype}; left out"
                    )
            if not known:
                return
            total, count = max(bag.message_count, 1), 0
            stream = bag.messages(connections=known)
            while True:
                try:
                    connection, received, data = next(stream)
                except StopIteration:
                    return
                except Exception as error:  # a damaged chunk may raise anything in rosbags
                    self.note(
                        f"stopped at a damaged part ({type(error).__name__}); what came before was read"
                    )
                    return
                count += 1

                def decode(data: Any = data, kind: str = connection.msgtype) -> Any:
                    return bag.deserialize(data, kind)

                yield Message(connection.topic, received * 1e-9, decode, count / total)


_TABLES = ("topics", "messages")


def _missing(path: Path) -> str:
    """Clause on the tables that the databases of a ROS 2 bag lack; "" where none does, or another format."""
    files = sorted(path.glob("*.db3")) if path.is_dir() else [path]
    for file in files:
        if not file.is_file() or file.suffix != ".db3":
            continue
        try:
            with contextlib.closing(sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro", uri=True)) as data:
                rows = data.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
        except sqlite3.Error:
            continue
        names = [name for name in _TABLES if (name,) not in rows]
        if names:
            tables = " and ".join(f'"{name}"' for name in names)
            return (
                f"{file.name} has no table {tables}; expected a database of rosbag2 with the tables"
                f" {' and '.join(_TABLES)}: the messages are missing"
            )
    return ""
