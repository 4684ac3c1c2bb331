"""Dataclasses as plain data: fields, what is added and left out, and values of every kind."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seatrial.base.plain import Plain


@dataclass(frozen=True)
class Inner:
    angle_deg: float
    pair: tuple[float, float] = (1.0, 2.0)


@dataclass(frozen=True, slots=True)
class Judged(Plain, also="good"):
    value: float

    @property
    def good(self) -> bool:
        return self.value > 0.0


@dataclass(frozen=True)
class Result(Plain, without="log", also="angle=inner.angle_deg rows"):
    inner: Inner
    array: np.ndarray[Any, Any]
    path: Path
    judged: dict[str, Judged]
    log: object = None
    nothing: None = None
    texts: tuple[str, ...] = field(default=("a",))

    def rows(self) -> Iterator[Inner]:
        yield Inner(3.0)


@dataclass(frozen=True)
class Short(Result, only="texts"):
    """A subclass says anew what is in it."""


MADE = (Inner(30.0), np.array([[1.0, np.inf]]), Path("a/b"), {"u": Judged(1.0)})


def test_fields_additions_and_omissions() -> None:
    assert Result(*MADE).to_dict() == {
        "inner": {"angle_deg": 30.0, "pair": [1.0, 2.0]},
        "array": [[1.0, np.inf]],
        "path": "a/b",
        "judged": {"u": {"value": 1.0, "good": True}},
        "nothing": None,
        "texts": ["a"],
        "angle": 30.0,
        "rows": [{"angle_deg": 3.0, "pair": [1.0, 2.0]}],
    }
    assert Short(*MADE).to_dict() == {"texts": ["a"]}


def test_a_name_that_is_none_is_an_error() -> None:
    @dataclass
    class Wrong(Plain, also="nmae"):
        name: str

    with pytest.raises(AttributeError, match="nmae"):
        Wrong("x").to_dict()
