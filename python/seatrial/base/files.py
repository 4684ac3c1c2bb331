"""Files that are complete or not there, their names and places, and folders that one process writes to.

A file is written under another name and then renamed; of a folder all files are there, or it is as it was
(`whole_folder`). `only_user` and `lock` refuse a second process while one works in a folder. Tables are
neither read nor written after a fork (`before_table`): polars' threads do not survive one. Names inside files
that become files, and paths in them, lead nowhere else (`file_name`, `content_inside`). Held by
``tests/base/test_run.py``, ``tests/base/test_bad_input.py``, ``tests/base/test_hostile_paths.py`` and, for
tables, ``tests/core/test_processes.py``.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import io
import json
import os
import re
import shutil
import socket
import stat
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from tempfile import TemporaryFile
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

    `content`: what stands in it, or what writes it to a path: for a file that memory may not hold; `new`:
    whether a file of that name is left alone: of several writers at a time one wins. Raises
    `FileExistsError`: there is a file of that name, and it was to be new. Raises `OSError`: it cannot be
    written; the former file of that name is still there.
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

    Raises `SeatrialError`: this process is such a child.
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


_LONGEST = 240  # file systems take 255 bytes, and ".partial" is appended


@contextlib.contextmanager
def only_user(folder: str | Path) -> Iterator[None]:
    """Hold the lock on a folder that gets files but is no run directory, as of figures or of command files.

    Raises `SeatrialError`: another process works in it, or its lock cannot be written.
    """
    path = absolute(folder)
    refuse_name(path)
    try:
        made = make_folders(path.parent)
        handles = lock(path)
    except OSError as error:
        raise refusal(path, error) from None
    try:
        yield
    finally:
        unlock(*handles)
        for above in reversed(made):
            with contextlib.suppress(OSError):  # it holds the run, or what others put there
                above.rmdir()


def lock(run: Path) -> tuple[int, Path, int]:
    """Descriptor, lock file and process after the lock on a run directory is taken.

    The operating system frees the lock when its process ends, however it ends. A lock file that nobody holds
    is stale and is taken over.

    Raises `SeatrialError`: another run holds it.
    """
    file = run.with_name(f"{run.name}.lock")
    while True:
        descriptor = os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.read(descriptor, 4096)
            os.close(descriptor)
            raise SeatrialError(_in_use(run, holder)) from None
        except OSError as error:
            # Some network file systems know no locks; there the user must see to it that runs do not meet.
            if error.errno not in (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS):
                os.close(descriptor)
                raise
        # The former holder may have removed the file between our open and our lock.
        if _is_file(descriptor, file):
            break
        os.close(descriptor)
    facts = {
        "pid": os.getpid(),
        "host": socket.gethostname(),
        "since_utc": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    os.ftruncate(descriptor, 0)
    os.write(descriptor, json.dumps(facts).encode() + b"\n")
    return descriptor, file, os.getpid()


def _is_file(descriptor: int, file: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), file.stat())
    except FileNotFoundError:
        return False


def unlock(descriptor: int, file: Path, process: int) -> None:
    """Free what `lock` gave."""
    if os.getpid() == process:  # a forked child ends without giving its parent's lock free
        with contextlib.suppress(OSError):  # gone already: the lock is that of the open file, not of its name
            file.unlink()
        os.close(descriptor)


def _in_use(run: Path, holder: bytes) -> str:
    try:
        owner = json.loads(holder)
        who = f"process {owner['pid']} on {owner['host']}, since {owner['since_utc']}"
        stop = f"stop it (kill {owner['pid']})"
    except (ValueError, KeyError, TypeError, RecursionError):
        who, stop = "another process", "stop it"
    return (
        f"run directory {run}: expected to be its only user, found it in use by {who}; wait until that run"
        f" ends, {stop}, or choose another folder"
    )


def absolute(path: str | Path) -> Path:
    """The path from the root on, with the folder's own name at the end."""
    whole = Path(path).absolute()
    return whole.resolve() if whole.name == ".." else whole


def refuse_name(path: Path) -> None:
    """Refuse a run directory without a name of its own, or with one that is too long."""
    if not path.name:
        raise SeatrialError(
            f"run directory {path}: expected a folder with a name of its own, to make or to replace; name one"
            " in it"
        )
    size = len(os.fsencode(path.name))
    if size > _LONGEST:
        raise SeatrialError(
            f"run directory {path.name[:40]}…: expected a name of at most {_LONGEST} bytes, found"
            f" {size}; choose a shorter one"
        )


def refusal(path: Path, error: OSError) -> SeatrialError:
    """What to raise where the operating system refuses a run directory."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        existing = next((parent for parent in (path, *path.parents) if parent.exists()), Path("/"))
        free = shutil.disk_usage(existing).free / 2**20
        return SeatrialError(
            f"{path}: the disk is full ({free:.1f} MiB free), nothing was half-written; free some space or"
            " choose a run directory on another disk, then run again: finished parts are reused"
        )
    reason = error.strerror or str(error)
    return SeatrialError(
        f"run directory {path}: cannot be written ({reason}); choose a folder that you may write to"
    )


LONGEST_NAME = 80
"""Bytes of a name; file systems take 255, and endings are appended."""


def file_name(text: str, *, instead: str = "-", longest: int = LONGEST_NAME) -> str:
    """Text as the name of a file or folder: letters, digits, - and _, cut to so many bytes.

    Examples
    --------
    >>> file_name("../lawn mower: 2 m"), file_name("..")
    ('---lawn-mower--2-m', '--')
    """
    safe = "".join(letter if letter.isalnum() or letter in "-_" else instead for letter in text)
    return safe.encode(errors="replace")[:longest].decode(errors="ignore") or instead


def free_name(name: str, taken: Container[str]) -> str:
    """The name, with a number where another one became the same.

    Examples
    --------
    >>> free_name("lawn-mower", {"lawn-mower"})
    'lawn-mower-2'
    """
    numbered = (name if k == 1 else f"{name}-{k}" for k in count(1))
    return next(candidate for candidate in numbered if candidate not in taken)


def check_place(
    path: Path,
    option: str,
    *,
    endings: Sequence[str] = (),
    inputs: Mapping[str, str | Path | None] | None = None,
    folder_made: bool = False,
) -> None:
    """Refuse the place of a file to be written, before the work whose result it gets.

    `option`: that named it, for messages. `endings`: that it may have; any when empty. `inputs`: what the
    work reads, by what it is ("the commands"): it is not overwritten. Names of what is built in are left out.
    `folder_made`: whether the writer makes the folder. Raises `SeatrialError`: the ending is another one, the
    file is read by the work, it is a folder, or cannot be written there.
    """
    if endings and path.suffix not in endings:
        raise SeatrialError(
            f'{option} {path}: expected the ending {" or ".join(endings)}, found "{path.suffix}"; give'
            " another name"
        )
    for what, source in (inputs or {}).items():
        if source is not None and _same_file(path, Path(source)):
            raise SeatrialError(f"{option} {path}: this is the file of {what}; give another name")
    if path.is_dir():
        raise SeatrialError(f"{option} {path}: expected a file, found a folder; give a file name")
    folder = path.absolute().parent
    # A folder that is made later is asked for at the first one above it that is there.
    if folder_made:
        folder = next(above for above in path.absolute().parents if above.exists())
        if not folder.is_dir():
            raise SeatrialError(f"{option} {path}: {folder} is a file, not a folder; choose another place")
    elif not folder.is_dir():
        raise SeatrialError(
            f"{option} {path}: there is no folder {path.parent}; make it or give another name"
        )
    # Rights and mounts say it all only when something is written.
    try:
        TemporaryFile(dir=folder).close()
    except OSError as error:
        raise SeatrialError(
            f"{option} {path}: cannot be written ({reason(error)}); choose another place"
        ) from None


def _same_file(path: Path, other: Path) -> bool:
    """Whether two paths lead to one file, through links as well."""
    try:
        return path.samefile(other)
    except (OSError, ValueError):  # one of them is not there
        return False


def no_file(path: Path) -> str | None:
    """Clause on what is at a path where a regular file is expected; None where there is one.

    Examples
    --------
    >>> no_file(Path("nowhere.csv")), no_file(Path("/"))
    ('there is no file nowhere.csv', '/ is a folder, not a file')
    """
    if path.is_file():
        return None
    if not path.exists():
        if path.is_symlink():
            return f"{path} is a link to {path.readlink()}, and leads to no file"
        return f"there is no file {path}"
    what = "a folder" if path.is_dir() else "a device, a pipe or a socket"
    return f"{path} is {what}, not a file"


def content_inside(folder: Path, path: Path, *, most: int) -> bytes:
    """Content of a regular file of at most `most` bytes that lies in a folder which somebody else made.

    A link may lead to another file of the folder. What a page takes from a folder goes to whom it is sent, so
    no link leads out of it; a device or a pipe would never end.

    Raises `SeatrialError`: it is none, is larger, lies elsewhere, or cannot be read.
    """
    try:
        place = path.resolve(strict=True)
        if not place.is_relative_to(folder.resolve()):
            raise SeatrialError(
                f"{path}: expected a file in the folder itself, found a link to {place}; put the file there,"
                " or remove the link"
            )
        # Without waiting for who writes into a pipe.
        flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0)
        with os.fdopen(os.open(place, flags), "rb") as stream:
            if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
                raise SeatrialError(
                    f"{path}: expected a file, found a device, a pipe or a folder; remove it from {folder}"
                )
            content = stream.read(most + 1)
    except (OSError, RuntimeError) as error:  # a link that leads back to itself is the latter
        raise SeatrialError(f"{path}: cannot be read ({reason(error)})") from None
    if len(content) > most:
        raise SeatrialError(
            f"{path}: expected at most {most / 2**20:.3g} MiB, found more; this is none of the files that"
            " seatrial writes: remove it"
        )
    return content


VARIABLE = "SEATRIAL_DATA"
"""Environment variable that names the folder of recordings."""


def data_folder() -> Path:
    """Folder of recordings: that of ``SEATRIAL_DATA``, else a cache of the user."""
    if given := os.environ.get(VARIABLE):
        return Path(given)
    import pooch

    return Path(pooch.os_cache("seatrial"))
