"""Results as plain data, for JSON: `Plain` gives a dataclass its ``to_dict``.

Arrays become lists, paths texts, a dataclass the dict of its fields. Numbers that are not finite stay, and
are null in JSON (`seatrial.base.run.to_json`). Held by ``tests/base/test_plain.py``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any, ClassVar


class Plain:
    """A dataclass with a ``to_dict`` of its fields; the class statement says what else is in it.

    ``also`` are keys beside the fields, ``only`` are keys in place of them, ``without`` fields that are left
    out; each a text of names. ``key=path.to.attribute`` reads a key from elsewhere; a method is called.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Use(Plain, also="energy_wh unit=motor.unit", without="rows motor"):
    ...     power_w: float
    ...     rows: list[float]
    ...     motor: Any
    ...     def energy_wh(self) -> float:
    ...         return 2.0 * self.power_w
    >>> @dataclass(frozen=True)
    ... class Motor:
    ...     unit: str
    >>> Use(5.0, [], Motor("W")).to_dict()
    {'power_w': 5.0, 'energy_wh': 10.0, 'unit': 'W'}
    """

    _keys: ClassVar[tuple[str, str, str]] = ("", "", "")

    def __init_subclass__(cls, *, also: str = "", only: str = "", without: str = "", **options: Any) -> None:
        super().__init_subclass__(**options)
        if also or only or without:
            cls._keys = (also, only, without)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, texts, lists and dicts."""
        also, only, without = self._keys
        names = [] if only else [field.name for field in fields(self) if field.name not in without.split()]  # type: ignore[arg-type]
        asked = (word.partition("=") for word in (*names, *only.split(), *also.split()))
        return {key: plain(attrgetter(path or key)(self)) for key, _, path in asked}


def plain(value: Any) -> Any:
    """Value as plain numbers, texts, lists and dicts; what has a ``to_dict`` says itself what is in it."""
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Iterator):
        return [plain(item) for item in value]
    return plain(value()) if callable(value) else value
