"""Findings in words: templates in the TOML files of this folder, functions where a sentence needs more.

A template is a Python format string over ``subject``, ``count`` and the values of its finding by name, with
some formats more:

=========================  ===========================================================================
``{share:.0f %}``          a share in per cent; ``{size:abs .2f}`` without its sign, ``{m:milli .3g}`` in mm
``{names:list}``           "a, b, c"; ``{names:and}`` "a, b and c"; ``{names:words}`` "a b c"
``{times:each {0} {1:g}}`` a part per entry of a list or table, with commas; ``each;``, ``both``: with "and"
``{text:safe 30}``         what a stranger wrote, of so many signs at most; ``{text:safe}``
``{n:#line|lines}``        of two parts the first for one; values may stand in them, and other choices
``{late_s:+late|early}``   the first above zero; ``-``: below zero
``{x:!{x:g}|none}``        the first for a finite number that is there
``{more:? and more|}``     the first where there is any
``<where>``                the template of that name in the table ``parts`` of the same file
=========================  ===========================================================================

Held by ``tests/report/test_phrases.py``.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping, Sequence, Sized
from functools import cache
from importlib.resources import files
from string import Formatter
from typing import Any

from seatrial.base.errors import printable
from seatrial.base.finding import Finding
from seatrial.base.report import listed

Write = Callable[[Any], str]

Formats = Mapping[str, Callable[[Any], str]]

_PARTS = Formatter()

_JOINTS = {"each": ", ", "each;": "; ", "both": " and "}

_CHOICES: dict[str, Callable[[Any], bool]] = {
    "#": lambda value: (len(value) if isinstance(value, Sized) else value) == 1,
    "+": lambda value: value > 0.0,
    "-": lambda value: value < 0.0,
    "!": lambda value: value is not None and math.isfinite(value),
    "?": bool,
}

_FORMATS: dict[str, Callable[[Any, str], str]] = {
    "abs": lambda value, rest: _shown(abs(value), rest),
    "milli": lambda value, rest: _shown(1e3 * value, rest),
    "list": lambda value, _: ", ".join(value),
    "and": lambda value, _: listed(list(value)),
    "words": lambda value, _: " ".join(value),
    "capital": lambda value, _: str(value.capitalize()),
    "safe": lambda value, rest: printable(str(value), *map(int, rest.split())),
}


def filled(
    template: str, values: Mapping[str, Any], formats: Formats | None = None, parts: Sequence[Any] = ()
) -> str:
    """A template with values by name, and with the parts of an entry by number; `formats` are of its theme.

    Examples
    --------
    >>> filled("{n} {n:#line|lines} {late_s:abs .1f} s {late_s:+late|early}", {"n": 2, "late_s": -0.25})
    '2 lines 0.2 s early'
    >>> filled("{times:each {0} ({1:.0f} s)}", {"times": {"start": 0.0, "turn": 31.0}})
    'start (0 s), turn (31 s)'
    """
    text = ""
    for plain, field, spec, conversion in _PARTS.parse(template):
        text += plain
        if field is None:
            continue
        spec = spec or ""
        word, _, rest = spec.partition(" ")
        choice = _choice(spec)
        try:
            value = _PARTS.convert_field(_PARTS.get_field(field, parts, values)[0], conversion)
        except KeyError:
            if choice is None or spec[0] not in "!?":
                raise
            value = None  # a value that only some findings of the kind have
        if choice is not None:
            text += filled(choice[not _CHOICES[spec[0]](value)], values, formats, parts)
        elif word in _JOINTS:
            entries = value.items() if isinstance(value, Mapping) else value
            each = (entry if isinstance(entry, tuple) else (entry,) for entry in entries)
            text += _JOINTS[word].join(filled(rest, values, formats, entry) for entry in each)
        else:
            text += formats[spec](value) if formats and spec in formats else _shown(value, spec)
    return text


def _choice(spec: str) -> tuple[str, str] | None:
    """Both parts of a choice, in which others may stand; None for another format."""
    depth = 0
    for place, sign in enumerate(spec if spec[:1] in _CHOICES else ""):
        depth += (sign == "{") - (sign == "}")
        if sign == "|" and depth == 0:
            return spec[1:place], spec[place + 1 :]
    return None


def _shown(value: Any, spec: str) -> str:
    """A value in one of the formats."""
    word, _, rest = spec.partition(" ")
    if rest == "%":
        return f"{100.0 * value:{word}} %"
    return _FORMATS[word](value, rest) if word in _FORMATS else format(value, spec)


@cache
def templates(theme: str) -> dict[str, dict[str, str]]:
    """Tables of a theme's file, the parts in their places."""
    tables = tomllib.loads(files(__package__).joinpath(f"{theme}.toml").read_text(encoding="utf-8"))
    for name, part in tables.get("parts", {}).items():
        for table in tables.values():
            table.update({kind: text.replace(f"<{name}>", part) for kind, text in table.items()})
    return tables


class Phrases:
    """The words of all kinds of findings of a theme: a table of its file, and functions beside it.

    `formats` show a value in a way of this theme, by the word that its templates have for it.
    """

    def __init__(self, theme: str, table: str, formats: Formats | None = None) -> None:
        self._theme, self._table, self._formats = theme, table, formats
        self._written: dict[str, Write] = {}

    def of(self, *kinds: str) -> Callable[[Write], Write]:
        """Decorator of a function that writes the words of some kinds."""

        def kept(write: Write) -> Write:
            self._written.update(dict.fromkeys(kinds, write))
            return write

        return kept

    @property
    def kinds(self) -> set[str]:
        """Kinds that have words."""
        return {*templates(self._theme)[self._table], *self._written}

    def fill(self, kind: str, **values: Any) -> str:
        """The template of a kind with other values than those of a finding."""
        return filled(templates(self._theme)[self._table][kind], values, self._formats)

    def __call__(self, finding: Finding) -> str:
        """A finding in words."""
        if (write := self._written.get(finding.kind)) is not None:
            return write(finding)
        count = getattr(finding, "count", None)
        return self.fill(finding.kind, **{"subject": finding.subject, "count": count, **finding.values})
