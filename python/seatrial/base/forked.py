"""Tables after a fork: polars' threads do not survive one, and a child that waits for them waits for ever.

The core's own threads are made anew in a child (``work.rs`` of the binding). Those of polars cannot be: such
a child may not read or write a table.
Held by ``tests/core/test_processes.py``.
"""

from __future__ import annotations

import os

from seatrial.base.errors import SeatrialError

_worked: int | None = None


def before_table() -> None:
    """Refuse to read or write a table in a child of a process that did so before it forked.

    Raises
    ------
    SeatrialError
        This process is such a child.
    """
    global _worked
    if _worked is None:
        _worked = os.getpid()
    if _worked != os.getpid():
        raise SeatrialError(
            f"process {os.getpid()} was forked from process {_worked}, which had read or written tables, and"
            " polars cannot work in a fork: read trials before the fork and save results in the parent,"
            ' or start processes with multiprocessing.get_context("spawn")'
        )
