"""The layout of a table of text, from its first lines: separator, rows of names and units, first numbers.

The separator is the one that cuts most rows into equally many cells; the first row of numbers, the row of
names before it, and a row of units between the two follow. Cells in quotes may hold the separator.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from seatrial.base.errors import TrialError, printable, reason
from seatrial.logs.clock import stated_unit, time_fields
from seatrial.logs.formats import DAMAGED, unpacked
from seatrial.logs.log import READING_SETTINGS
from seatrial.logs.names import is_unit, no_unit, unit_of


@dataclass(frozen=True)
class LayoutSettings:
    """How much of a text is looked at to tell its layout, and when it is damaged."""

    head_bytes: int = 262_144  #: of the beginning, by which a file is judged
    head_rows: int = 200  #: lines of the beginning, by which columns are judged
    most_quoted_lines: int = 8  #: of a name in quotes
    most_controls: float = 0.05  #: share of control bytes in a text that a loss of power damaged
    unit_row_share: float = 0.8  #: of the cells of a row that are units, above which it is one of units


SETTINGS = LayoutSettings()

_CONTROLS = bytes(k for k in range(32) if k not in b"\t\n\r")
_OPEN = re.compile(r'(?:^|[,;\t]) *"(?:[^"]|"")*$')  # a cell whose quotes do not end in this line
GROUPED = r"^[+-]?\d{1,3}(,\d{3})+(\.\d*)?$"  # a number with thousands separators


@dataclass(frozen=True)
class Layout:
    """How a table of text is laid out."""

    #: Of the text; the separator " " stands for runs of blanks.
    encoding: str
    separator: str
    #: Whether ``1,5`` is one and a half, and whether ``1,150`` is over a thousand.
    decimal_comma: bool
    comment: str  #: First character of lines to skip; "" for none.
    first_row: int  #: Line of the first row of values, from 1.
    #: Of the columns; a unit is "" where none is stated.
    names: tuple[str, ...]
    units: tuple[str, ...]
    named: bool  #: Whether the file has a row of names.
    plain: bool  #: Whether the row of names is the first, and the values follow it.
    #: Places, from 1, of the columns that share a name; all but the first of them are numbered in `names`.
    twice: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    thousands: bool = False
    unit_row: int = 0  #: Line of the row of units, from 1; 0 where there is none.


def encoding_of(path: Path) -> str:
    """Encoding of a text file from its first bytes."""
    try:
        with unpacked(path) as raw:
            return _encoding(raw.read(SETTINGS.head_bytes), path)
    except DAMAGED as error:
        raise TrialError(f"{path}: cannot be read: {reason(error)}") from None


def layout_of(path: Path) -> Layout:
    """Layout of a table of text from its first rows."""
    try:
        with unpacked(path) as raw:
            head = raw.read(SETTINGS.head_bytes)
    except DAMAGED as error:
        raise TrialError(f"{path}: cannot be read: {reason(error)}") from None
    encoding = _encoding(head, path)
    held = head if encoding == "utf-16" else head.rstrip(b"\0")
    text = codecs.getincrementaldecoder(encoding)(errors="replace").decode(held)
    lines = text.splitlines()[: SETTINGS.head_rows]
    if len(head) == SETTINGS.head_bytes and len(lines) > 1 and len(lines) < SETTINGS.head_rows:
        lines.pop()  # the block may end within it
    comment = "#" if any(line.startswith("#") for line in lines) else ""
    kept = [(k, line) for k, line in _logical(lines) if line.strip()]
    data = [(k, line) for k, line in kept if not (comment and line.startswith(comment))]
    if not data:
        raise TrialError(f"{path}: no rows; expected a row of names and rows of numbers")
    separator = _separator([line for _, line in data])
    decimal_comma, thousands = _commas(data, separator, path)
    rows = [(k, cells_of(line, separator)) for k, line in data]
    width = Counter(len(cells) for _, cells in rows[len(rows) // 2 :]).most_common(1)[0][0]
    first = _first_row(rows, width, decimal_comma)
    if first is None and len(rows) == 1:
        raise TrialError(f"{path}: a single row; expected a row of names and rows of numbers below it")
    if first is None:
        raise TrialError(
            f"{path}: fewer than two rows of numbers in the first {len(rows)} rows, cut at {separator!r} into"
            f" {width} cells; expected a row of names and rows of numbers"
        )
    # A separator behind the last cell makes an empty column, of the rows, of the names, or of both.
    filled = max((k + 1 for _, cells in rows[first:] for k, cell in enumerate(cells) if cell), default=width)
    above = [(k, fitted) for k, cells in rows[:first] if (fitted := _fitted(cells, width, filled))]
    if not above and comment:  # "# t x y": the names are a comment
        commented = [
            (k, cells_of(line.lstrip("#% \t"), separator)) for k, line in kept if line.startswith(comment)
        ]
        above = [(k, fitted) for k, cells in commented if (fitted := _fitted(cells, width, filled))]
    # Patterns take time with the square of a name's length.
    longest = max((len(cell) for _, cells in above for cell in cells), default=0)
    if width > READING_SETTINGS.most_fields or longest > READING_SETTINGS.most_fields:
        raise TrialError(
            f"{path}: {width} columns, a name of {longest} letters; expected at most"
            f" {READING_SETTINGS.most_fields}"
        )
    names, units, twice, unit_row = _names(above, width)
    return Layout(
        encoding, separator, decimal_comma, comment, rows[first][0], tuple(names), tuple(units), bool(above),
        plain=first == len(above) == 1 and len(rows[0][1]) == width and len(held) == len(head),
        twice=twice, thousands=thousands,
        unit_row=unit_row,
    )  # fmt: skip


def _encoding(head: bytes, path: Path) -> str:
    if b"\r" in head and b"\n" not in head:
        raise TrialError(
            f"{path}: its lines end in a carriage return alone; save it with the line ends of Unix or Windows"
        )
    for mark, name in ((codecs.BOM_UTF8, "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")):
        if head.startswith(mark):
            return name
    held = head.rstrip(b"\0")  # the end of a file that was given its size in advance
    if b"\0" in head and len(held.translate(None, _CONTROLS)) <= (1.0 - SETTINGS.most_controls) * len(held):
        raise TrialError(
            f"{path}: not a text file (it holds null bytes); expected a row of names and rows of numbers;"
            " save it as UTF-8 text, or name its reader"
        )
    try:
        codecs.getincrementaldecoder("utf-8")().decode(held)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8"


def cells_of(line: str, separator: str) -> list[str]:
    """The cells of a line; one in quotes may hold the separator."""
    if separator == " ":
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    cells = next(csv.reader([line], delimiter=separator, skipinitialspace=separator != "\t"))
    return [cell.strip() for cell in cells]


def _separator(lines: Sequence[str]) -> str:
    """The separator that cuts most rows into equally many cells, at least two."""
    sample = lines[len(lines) // 4 :] or lines

    def merit(separator: str) -> tuple[float, int]:
        counts = Counter(len(cells_of(line, separator)) for line in sample)
        width, rows = counts.most_common(1)[0]
        # In a log of several rates most cells may be empty.
        filled = [cell for line in sample[:20] for cell in cells_of(line, separator) if cell]
        numbers = float(np.mean([_number(cell, True) for cell in filled])) if filled else 0.0
        return (rows / len(sample) * (width > 1) * (0.2 + numbers), width)

    # A decimal comma makes the comma cut regularly too: then semicolon, tab or blank cut into whole numbers.
    for separator in (";", "\t"):
        if merit(separator)[0] > 0.9:
            return separator
    return max((",", ";", "\t", " "), key=merit)


def _logical(lines: Sequence[str]) -> Iterator[tuple[int, str]]:
    """Lines with their number, from 1; lines whose end stands in quotes go on with the next ones."""
    k = 0
    while k < len(lines):
        line, last = lines[k], k
        while _OPEN.search(line) and last < min(k + SETTINGS.most_quoted_lines, len(lines) - 1):
            last += 1
            line += "\n" + lines[last]
        if _OPEN.search(line):  # a quote that nothing closes
            line, last = lines[k], k
        yield k + 1, line
        k = last + 1


def _number(cell: str, decimal_comma: bool) -> bool:
    plain = cell.strip()
    if decimal_comma:
        plain = plain.replace(",", ".")
    elif "," in plain and re.match(GROUPED, plain):
        plain = plain.replace(",", "")
    try:
        float(plain)
    except ValueError:
        return False
    return plain != ""


def _commas(rows: Sequence[tuple[int, str]], separator: str, path: Path) -> tuple[bool, bool]:
    """Whether a comma in a number is a decimal comma, and whether it groups thousands."""
    sampled = [(row, cells_of(line, separator)) for row, line in rows[-50:]]
    cells = [cell for _, row in sampled for cell in row]
    decimal = [cell for cell in cells if re.fullmatch(r"[+-]?\d+,\d+(e[+-]?\d+)?", cell, re.IGNORECASE)]
    points = any(re.fullmatch(r"[+-]?\d*\.\d+(e[+-]?\d+)?", cell, re.IGNORECASE) for cell in cells)
    if separator != ",":
        return bool(decimal), points and not decimal
    if any(not re.match(GROUPED, cell) or re.match("[+-]?0", cell) for cell in decimal):
        return True, False
    if decimal and not points:
        row, column = next((row, line.index(c) + 1) for row, line in sampled for c in decimal if c in line)
        raise TrialError(
            f'{path}: line {row}, column {column}: "{printable(decimal[0], 30)}": whether the comma is a'
            " decimal comma or groups thousands is not known; expected numbers such as 1150 or 1.15: write"
            " the file without grouping"
        )
    return False, points


def _first_row(rows: Sequence[tuple[int, list[str]]], width: int, decimal_comma: bool) -> int | None:
    """Index of the first row of values: as many cells as most, and numbers where most rows have numbers."""
    wide = [cells for _, cells in rows if len(cells) == width]
    share = [
        np.mean([_number(cells[k], decimal_comma) for cells in wide[len(wide) // 3 :]]) for k in range(width)
    ]
    numeric = [k for k in range(width) if share[k] > 0.5]
    if not numeric:
        return None
    for index, (_, cells) in enumerate(rows):
        if len(cells) == width:
            given = [k for k in numeric if cells[k] != ""]
            if given and np.mean([_number(cells[k], decimal_comma) for k in given]) > 0.5:
                return index
    return None


def _fitted(cells: Sequence[str], width: int, filled: int) -> list[str]:
    """Cells of a row above the values, as many as these have; none where they do not fit.

    `filled` counts the columns up to the last one that holds a value.
    """
    own = list(cells)
    while len(own) > width and not own[-1]:
        own.pop()
    if filled <= len(own) < width:
        own += [""] * (width - len(own))
    return own if len(own) == width and any(own) else []


def _names(
    above: Sequence[tuple[int, list[str]]], width: int
) -> tuple[list[str], list[str], dict[str, tuple[int, ...]], int]:
    """Names and units of the columns from the rows above the values; places of those that share a name.

    Names stand above numbers, whatever the words: they are the first row of words that are no units, that
    names a time, and that has the most different ones. Last, the line of the row of units; 0 for none.
    """
    if not above:
        return [f"column_{k + 1}" for k in range(width)], [""] * width, {}, 0
    at = max(range(len(above)), key=lambda k: (_like_names(above[k][1]), -k))
    names = above[at][1]
    # Units stand below the names, at times above them.
    places_of_units = [k for k in (*range(at + 1, len(above)), at - 1) if k >= 0 and _of_units(above[k][1])]
    unit_row = 0
    if not places_of_units and at + 1 < len(above) and _under_time(names, above[at + 1][1]):
        places_of_units = [at + 1]
    units = [
        bracket[1].strip() if (bracket := re.search(r"[\[(]([^\])]*)[\])]\s*$", n)) else "" for n in names
    ]
    if places_of_units:
        # A row of types, as a compiler knows them, is no row of units.
        best = max(places_of_units, key=lambda k: sum(unit_of(cell) is not None for cell in above[k][1]))
        unit_row, cells = above[best]
        units = [cell.strip("[]() ") or own for cell, own in zip(cells, units, strict=True)]
    places: dict[str, list[int]] = {}
    unique = []
    for k, name in enumerate(names):
        name = " ".join(name.split("\n")).strip() or f"column_{k + 1}"
        known = places.setdefault(name, [])
        known.append(k + 1)
        unique.append(name if len(known) == 1 else f"{name}_{len(known)}")
    units = ["" if no_unit(unit) else unit for unit in units]
    return unique, units, {name: tuple(known) for name, known in places.items() if len(known) > 1}, unit_row


def _like_names(cells: Sequence[str]) -> tuple[bool, bool, int]:
    """How much a row is like one of names: that it is none of units, names a time, its different words."""
    words = [cell for cell in cells if cell]
    return not _of_units(cells), bool(time_fields(words)), len(set(words))


def _of_units(cells: Sequence[str]) -> bool:
    """Whether most cells of a row are units."""
    some = [cell for cell in cells if cell]
    return bool(some) and float(np.mean([is_unit(cell) for cell in some])) >= SETTINGS.unit_row_share


def _under_time(names: Sequence[str], cells: Sequence[str]) -> bool:
    """Whether a row under the names has the unit of the time: then it is one of units, known or not."""
    times = time_fields([name for name in names if name])
    if not times:
        return False
    unit = cells[list(names).index(times[0])]
    return bool(unit) and stated_unit("", unit.strip("[]() ")) is not None
