"""Names inside files that become files and folders, and paths in them: neither leads where it should not.

Held by ``tests/base/test_hostile_paths.py``.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Container, Mapping, Sequence
from itertools import count
from pathlib import Path
from tempfile import TemporaryFile

from seatrial.base.errors import SeatrialError, reason

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
    if folder_made:
        folder = next(above for above in path.absolute().parents if above.exists())
        if not folder.is_dir():
            raise SeatrialError(f"{option} {path}: {folder} is a file, not a folder; choose another place")
    elif not folder.is_dir():
        raise SeatrialError(
            f"{option} {path}: there is no folder {path.parent}; make it or give another name"
        )
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
