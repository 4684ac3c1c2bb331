"""Names of a vehicle file in C: which the language cannot hold, and how a comment holds any.

The core makes identifiers of them (``crates/seatrial/src/export/program.rs``). Tests:
``tests/export/test_c.py``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from seatrial.base.errors import printable

_WORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int
long register restrict return short signed sizeof static struct switch typedef union unsigned void
volatile while alignas alignof and and_eq asm atomic bitand bitor bool catch class co_await
co_return co_yield compl concept const_cast consteval constexpr constinit decltype delete
dynamic_cast explicit export false friend mutable namespace new noexcept not not_eq nullptr operator
or or_eq private protected public reinterpret_cast requires static_assert static_cast template this
thread_local throw true try typeid typename typeof using virtual wchar_t xor xor_eq linux unix i386
NAN INFINITY HUGE_VAL NULL EOF errno isnan isinf isfinite signbit fpclassify isnormal
"""
"""Keywords of C and C++, whose programs include the header, and macros of compilers and ``math.h``."""

_RESERVED = frozenset(_WORDS.split())


def refused_names(numbers: Sequence[Mapping[str, Any]]) -> str | None:
    """Why numbers of an interface cannot stand in one structure of C; None where they can.

    Letters that C does not know became underscores: two names may have become one.

    Examples
    --------
    >>> refused_names([{"name": "a_b", "known_as": known_as, "about": ""} for known_as in ("a-b", "a_b")])
    'the names "a-b" and "a_b" are both a_b in C'
    """
    taken: dict[str, str] = {}
    for number in numbers:
        name, known_as = str(number["name"]), str(number["known_as"])
        words = known_as + str(number["about"])
        if not words.isprintable() or "*/" in words or "/*" in words:
            return f'the name "{printable(known_as)}" has a sign that no comment of C may hold'
        if name in _RESERVED:
            return f'the name "{known_as}" is a word of C'
        if name in taken:
            return f'the names "{taken[name]}" and "{known_as}" are both {name} in C'
        taken[name] = known_as
    return None


def commented(name: str) -> str:
    """A name as a comment of C may hold it.

    Examples
    --------
    >>> commented("out */ int main")
    'out * / int main'
    """
    return re.sub(r"(?<=\*)(?=/)|(?<=/)(?=\*)", " ", printable(name))
