"""The pages of the documentation, their fenced blocks, and whether these quote what commands print."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]

_FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its text and the line of the page where it begins."""

    language: str
    text: str
    line: int


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def blocks(name: str) -> list[Block]:
    page = text(name)
    return [
        Block(match[1], match[2], page.count("\n", 0, match.start()) + 2) for match in _FENCE.finditer(page)
    ]


_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
_CUT = re.compile(r"\.\.\.|…")
_BLANK = re.compile(r"[\s─]+")


def differing(quoted: str, output: str) -> list[str]:
    """Lines of a quotation that the output has not, each with the nearest line of the output.

    Spaces and rules do not count, ``...`` stands for any words, and numbers agree to a tenth or to 0.03:
    instruction sets bend a search a little.
    """
    printed = [_BLANK.sub(" ", line).strip() for line in output.splitlines()]
    return [
        f"{line}\n  printed: {alike or 'no line of these words'}"
        for line in quoted.splitlines()
        if line.strip(" ─.…") and (alike := _unless_quoted(line, printed)) is not None
    ]


def _unless_quoted(line: str, printed: list[str]) -> str | None:
    """A printed line of the same words and other numbers, empty if there is none; None where one agrees."""
    pieces = [_BLANK.sub(" ", piece) for piece in _CUT.split(line.strip())]
    number = f"({_NUMBER.pattern})"
    words = [number.join(re.escape(part) for part in _NUMBER.split(piece)) for piece in pieces]
    pattern = re.compile(".*?".join(words).replace(number, number.replace(r"(?<![\w.])", "")))
    values = [float(x) for piece in pieces for x in _NUMBER.findall(piece)]
    alike = ""
    for other in printed:
        if match := pattern.fullmatch(other):
            if np.allclose(values, [float(x) for x in match.groups()], rtol=0.1, atol=0.03):
                return None
            alike = other
    return alike
