"""The front of a room: names that users import from it, loaded when they are first used.

`from seatrial.diagnosis import profile` works wherever `profile` is defined inside the room, and importing
one module of a room loads no other. Held by tests/docs/test_public_names.py.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def front(room: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """Module-level ``__getattr__`` (PEP 562) of a room.

    Parameters
    ----------
    room : str
        The package's ``__name__``.
    homes : mapping of str to str
        Public name to the module inside the room that defines it.

    Examples
    --------
    >>> find = front("seatrial.base", {"nearest": "errors"})
    >>> find("nearest")("u_ms", ["u_m_s"])
    '; did you mean "u_m_s"?'
    >>> find("Arrays")
    Traceback (most recent call last):
    AttributeError: module 'seatrial.base' has no attribute 'Arrays'
    """

    def find(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {room!r} has no attribute {name!r}")
        return getattr(import_module(f"{room}.{homes[name]}"), name)

    return find
