"""Atomic writes: a file is complete or not there, since it is written under another name and then renamed.

A folder of files that belong together is there with all of them, or as it was (`whole_folder`).

Tables are neither read nor written after a fork (`before_table`): polars' threads do not survive one, and a
child that waits for them waits for ever. The core's own threads are made anew in a child (``work.rs`` of the
binding). Held by ``test_a_file_that_cannot_be_finished_leaves_the_former_one`` and
``test_a_folder_that_cannot_be_finished_is_as_it_was``; tables by ``tests/core/test_processes.py``.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.base.errors import SeatrialError, TrialError, reason

if TYPE_CHECKING:
    import polars as pl


@contextlib.contextmanager
def writing(
    place: str | Path,
    kind: type[SeatrialError] = SeatrialError,
    *,
    advice: str = "choose a folder that you may write to",
) -> Iterator[None]:
    """A block that writes at a place: an error of the system is raised as one of `kind`, in a sentence.

    Examples
    --------
    >>> try:
    ...     with writing("nowhere/a.csv", advice="make the folder first"):
    ...         open("nowhere/a.csv", "w")
    ... except SeatrialError as error:
    ...     print(error)
    nowhere/a.csv: cannot be written (No such file or directory); make the folder first
    """
    try:
        yield
    except OSError as error:
        raise kind(f"{place}: cannot be written ({reason(error)}); {advice}") from None


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
        content(partial) if callable(content) else partial.write_bytes(content)
        with partial.open("ab") as stream:
            os.fsync(stream.fileno())
        if new:
            _publish_new(partial, path)
        else:
            partial.replace(path)
    except BaseException as error:  # Ctrl-C, too, leaves no part behind
        partial.unlink(missing_ok=True)
        number = re.search(r"\(os\serror\s(\d+)\)", str(error))  # so polars quotes what a disk says
        if number is None or isinstance(error, OSError):
            raise
        raise OSError(int(number[1]), os.strerror(int(number[1]))) from error


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


def make_folders(folder: Path) -> list[Path]:
    """Folders that had to be made, the outermost first."""
    missing = [entry for entry in (folder, *folder.parents) if not entry.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    return missing[::-1]


def remove(entry: Path) -> None:
    """Remove a file, a link, or a folder with all that is in it; nothing where it is gone already."""
    if entry.is_dir() and not entry.is_symlink():
        shutil.rmtree(entry)
    else:
        entry.unlink(missing_ok=True)


@contextlib.contextmanager
def whole_folder(folder: Path) -> Iterator[None]:
    """Make a folder for files that belong together; where the work in it fails, it is away or empty again.

    A folder that held something before keeps what was finished in it.
    """
    place = folder.absolute()
    missing = [entry for entry in (place, *place.parents) if not os.path.lexists(entry)]
    empty = place.is_dir() and not any(place.iterdir())
    try:
        place.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:  # Ctrl-C, too
        with contextlib.suppress(OSError):  # what failed is said, and nothing of a leftover
            for entry in [place] if missing else [*place.iterdir()] if empty else []:
                remove(entry)
            for above in missing[1:]:
                above.rmdir()
        raise


def parquet(frame: pl.DataFrame) -> bytes:
    """Content of a Parquet file with a table."""
    before_table()
    content = io.BytesIO()
    frame.write_parquet(content)
    return content.getvalue()


def write_table(
    frame: pl.DataFrame, path: str | Path, *, comments: str = "", advice: str = "choose another folder"
) -> None:
    """Write a table as CSV below `comments`, or as Parquet where the path ends so.

    Raises TrialError, its message ended by `advice`, where the file cannot be written.
    """
    before_table()
    target = Path(path)
    content = parquet(frame) if target.suffix == ".parquet" else (comments + frame.write_csv()).encode()
    with writing(path, TrialError, advice=advice):
        write_atomic(target, content)


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
