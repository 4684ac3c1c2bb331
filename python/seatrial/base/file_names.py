"""Names inside files that become files and folders, and paths in them: neither leads where it should not.

Held by ``tests/base/test_hostile_paths.py``.
"""

from __future__ import annotations

from collections.abc import Container
from itertools import count
from pathlib import Path

__all__ = ["LONGEST_NAME", "file_name", "free_name", "no_file"]

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
    return next(one for one in numbered if one not in taken)


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
        return f"there is no file {path}"
    what = "a folder" if path.is_dir() else "a device, a pipe or a socket"
    return f"{path} is {what}, not a file"
