"""What is loaded or made when it is first used: the names of a room's front, values by name.

`from seatrial.diagnosis import profile` works wherever `profile` is defined inside the room, and importing
one module of a room loads no other. Held by tests/docs/test_public_names.py.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib import import_module
from typing import Any, TypeVar

T = TypeVar("T")


def front(room: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """Module-level ``__getattr__`` (PEP 562) of a room, by the module in it that defines each public name.

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


class ByName(Mapping[str, T]):
    """Values by name, in order, each made by `make` once, by one thread at a time, when it is asked for."""

    def __init__(self, names: Iterable[str], make: Callable[[str], T]) -> None:
        self._names, self._make = dict.fromkeys(names), make
        self._made: dict[str, T] = {}
        self._lock = threading.Lock()

    def __getitem__(self, name: str) -> T:
        if name not in self._names:
            raise KeyError(name)
        with self._lock:
            if name not in self._made:
                self._made[name] = self._make(name)
            return self._made[name]

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __getstate__(self) -> dict[str, Any]:
        return {key: value for key, value in vars(self).items() if key != "_lock"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, _lock=threading.Lock())
