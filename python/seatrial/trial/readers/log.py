"""Logs of topics: the fields that the column map names, on rows of all their stamps; the time is ``t_s``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.base.errors import TrialError, nearest
from seatrial.logs.formats import open_log
from seatrial.logs.join import Wanted, find_field, join
from seatrial.logs.log import Log, listed

if TYPE_CHECKING:
    import polars as pl


def read(path: Path, *, reader: str, columns: Sequence[str]) -> pl.DataFrame:
    """Table of a log's fields.

    Parameters
    ----------
    path
        The log.
    reader
        Its format (`seatrial.logs.formats`).
    columns
        Fields as ``topic.field``; ``topic.field/other`` is divided by another field of the topic, as an
        increment is by its time.

    Raises
    ------
    TrialError
        If the log cannot be read or has no such field.
    """
    log = open_log(path, reader)
    wanted = [_wanted(log, column) for column in columns if column != "t_s"]
    if not wanted:
        raise TrialError(
            f"{path}: a log of topics needs a column map, for example"
            f' columns={{"yaw_deg": "{_example(log)}"}}; its topics are {listed(list(log.fields))}'
        )
    return join([log], wanted).table


def _wanted(log: Log, column: str) -> Wanted:
    found = find_field(log, column)
    if found is not None:
        return found
    present = [f"{one}.{field}" for one, names in log.fields.items() for field in names]
    where = nearest(column, present[:5000]) if len(present) < 40 or _near(column, present) else ""
    raise TrialError(
        f'{log.path}: column map: there is no field "{column}" in the log{where}'
        + ("" if where else f"; its topics are {listed(list(log.fields))}")
    )


def _near(column: str, present: Sequence[str]) -> bool:
    return "did you mean" in nearest(column, present[:5000])


def _example(log: Log) -> str:
    topic, fields = next(iter(log.fields.items()))
    return f"{topic}.{next(iter(fields))}"
