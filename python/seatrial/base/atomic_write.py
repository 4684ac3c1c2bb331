"""Atomic writes: a file is complete or not there, since it is written under another name and then renamed.

Held by ``test_a_file_that_cannot_be_finished_leaves_the_former_one``.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.base.errors import TrialError, reason
from seatrial.base.forked import before_table

if TYPE_CHECKING:
    import polars as pl

__all__ = ["parquet", "write_atomic", "write_table"]


def write_atomic(path: Path, content: bytes | Callable[[Path], None], *, new: bool = False) -> None:
    """Write a file whole or not at all.

    Parameters
    ----------
    path : Path
    content : bytes or callable
        What stands in it, or what writes it to a path: for a file that memory may not hold.
    new : bool, optional
        Whether a file of that name is left alone: of several writers at a time one wins.

    Raises
    ------
    FileExistsError
        There is a file of that name, and it was to be new.
    OSError
        It cannot be written; the former file of that name is still there.
    """
    # A name of this process: two writers of one file do not write into the same part.
    partial = path.with_name(f"{path.name}.{os.getpid()}.writing")
    try:
        if callable(content):
            content(partial)
        with partial.open("ab" if callable(content) else "wb") as stream:
            if not callable(content):
                stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        if new:
            _publish_new(partial, path)
        else:
            partial.replace(path)
    except BaseException:  # Ctrl-C, too, leaves no part behind
        partial.unlink(missing_ok=True)
        raise


def _publish_new(partial: Path, path: Path) -> None:
    """Give a finished file its name unless another one has it."""
    try:
        os.link(partial, path)
    except FileExistsError:
        raise
    except OSError:  # a file system without hard links: the name is taken first, then the file put there
        path.open("xb").close()
        partial.replace(path)
        return
    partial.unlink()


def parquet(frame: pl.DataFrame) -> bytes:
    """Content of a Parquet file with a table."""
    before_table()
    content = io.BytesIO()
    frame.write_parquet(content)
    return content.getvalue()


def write_table(
    frame: pl.DataFrame, path: str | Path, *, comments: str = "", advice: str = "choose another folder"
) -> None:
    """Write a table as CSV, or as Parquet where the path ends so.

    Parameters
    ----------
    frame : polars.DataFrame
    path : str or Path
    comments : str
        Lines above the header of a CSV file.
    advice : str
        End of the message.

    Raises
    ------
    TrialError
        The file cannot be written.
    """
    before_table()
    target = Path(path)
    content = parquet(frame) if target.suffix == ".parquet" else (comments + frame.write_csv()).encode()
    try:
        write_atomic(target, content)
    except OSError as error:
        raise TrialError(f"{path}: cannot be written ({reason(error)}); {advice}") from None
