"""Locks of folders that get files: a second process is refused while one works there.

Held by ``tests/base/test_run.py``.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import json
import os
import shutil
import socket
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from seatrial.base.atomic_write import make_folders
from seatrial.base.errors import SeatrialError

_LONGEST = 240  # file systems take 255 bytes, and ".partial" is appended


@contextlib.contextmanager
def only_user(folder: str | Path) -> Iterator[None]:
    """Hold the lock on a folder that gets files but is no run directory, as of figures or of command files.

    Raises
    ------
    SeatrialError
        Another process works in it, or its lock cannot be written.
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

    Raises
    ------
    SeatrialError
        Another run holds it.
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
