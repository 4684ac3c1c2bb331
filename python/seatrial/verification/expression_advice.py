"""What is wrong with an expression that cannot be read or names no figure, and what to write instead.

Held by `tests/test_requirement.py`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from difflib import SequenceMatcher, get_close_matches

__all__ = ["unknown_figure", "unreadable"]

_EXAMPLE = "cross_track_p95_m <= 1.0"
_MOST_NEAR, _AS_NEAR = 3, 0.03

_INSTEAD: tuple[tuple[str, str], ...] = (
    (r"&&", "and"),
    (r"\|\|", "or"),
    (r"[<>=!]\s+=", ""),  # the same without its blank
    (r"=>", ">="),
    (r"=<", "<="),
    (r"<>|\N{NOT EQUAL TO}", "!="),
    (r"\N{LESS-THAN OR EQUAL TO}", "<="),
    (r"\N{GREATER-THAN OR EQUAL TO}", ">="),
    (r"!(?!=)", "not"),
    (r"(?<![<>=!])=(?!=)", "=="),
)
"""What other languages and keyboards write, in the order of asking."""


def unreadable(text: str, error: Exception) -> str:
    r"""Sentence on an expression that Python's parser does not take.

    Parameters
    ----------
    text : str
    error : Exception
        Of the parser.

    Examples
    --------
    >>> unreadable("duration_s < = 60", SyntaxError())
    '\'duration_s < = 60\' cannot be read; write "<=" in place of "< ="'
    """
    bare = text.strip()
    if not bare:
        return f'expected an expression such as "{_EXAMPLE}", found nothing'
    for pattern, instead in _INSTEAD:
        if wrong := re.search(pattern, _without_words(bare)):
            right = instead or re.sub(r"\s", "", wrong[0])
            return f'\'{bare}\' cannot be read; write "{right}" in place of "{wrong[0]}"'
    at = error.offset if isinstance(error, SyntaxError) and error.lineno == 1 else None
    place = f' at "{bare[at - 1 : at + 11]}" (character {at})' if at and at <= len(bare) else ""
    return f"'{bare}' cannot be read{place}; expected an expression such as '{_EXAMPLE}'"


def unknown_figure(name: str, figures: Iterable[str], words: Mapping[str, Iterable[str]]) -> str:
    """Sentence on a name that is no figure: the nearest ones, or all where none is near.

    Parameters
    ----------
    name : str
    figures : iterable of str
        Those that are known.
    words : mapping of str to iterable of str
        What figures that are words may say, by figure.

    Examples
    --------
    >>> unknown_figure("complete", ["ending"], {"ending": ["complete"]})
    '"complete" is no figure of a mission; write the word in quotes, ending == "complete"'
    """
    known = list(figures)
    said = f'"{name}" is no figure of a mission'
    for figure, values in words.items():
        if name in values:
            return f'{said}; write the word in quotes, {figure} == "{name}"'
    near = [f'"{one}"' for one in _near(name.casefold(), known)]
    if near:
        return f"{said}; did you mean {' or '.join([', '.join(near[:-1]), near[-1]][-len(near) :])}?"
    return f"{said}; known: {', '.join(_in_families(known))}"


def _near(name: str, known: list[str]) -> list[str]:
    """The nearest known names, those with hardly another distance together, or those that hold the name."""
    alike = {one: SequenceMatcher(None, name, one).ratio() for one in known}
    close = get_close_matches(name, known, n=_MOST_NEAR)
    nearest = [one for one in close if alike[one] > alike[close[0]] - _AS_NEAR]
    return nearest or [one for one in known if len(name) > 1 and name in one][:_MOST_NEAR]


def _without_words(text: str) -> str:
    """The text with blanks in place of what stands in quotes, which may be anything."""
    return re.sub(r"\"[^\"]*\"|'[^']*'", lambda word: " " * len(word[0]), text)


def _in_families(known: list[str]) -> list[str]:
    """Names, those that differ in one part alone told together: ``vertical_rms|p95_m``."""
    families: dict[tuple[str, str], list[str]] = {}
    for name in known:
        found = re.fullmatch(r"((?:true_)?cross_track|vertical)_(\w+)(_m)", name)
        head, part, tail = found.groups() if found else (name, "", "")
        families.setdefault((head, tail), []).append(part)
    return [
        f"{head}_{'|'.join(parts)}{tail}" if parts != [""] else head
        for (head, tail), parts in families.items()
    ]
