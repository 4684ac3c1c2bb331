"""Tables of text: their layout from the first lines, then their rows in blocks.

The separator is the one that cuts most rows into equally many cells; the first row of numbers, the row of
names before it, and a row of units between the two follow. Cells in quotes may hold the separator.

Spreadsheets write ``#REF!``, ``#####`` and dates where a number was: such cells are empty samples, counted
and named by row. Thousands separators are read where decimal points show what the commas are.
"""

from __future__ import annotations

import codecs
import io
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError, first_line, printable, reason
from seatrial.logs.clock import (
    RowStamps,
    TimeColumn,
    scale_of,
    seconds,
    stated_unit,
    time_column,
    time_fields,
)
from seatrial.logs.log import DAMAGED, Chunk, Log, Share, stem_of, unpacked

if TYPE_CHECKING:
    import polars as pl
import csv

from seatrial.logs.log import READING_SETTINGS
from seatrial.logs.names import is_unit, no_unit, unit_of

_BLOCK_BYTES = 8_388_608  # read at a time: bounds the memory
_LONGEST_LINE = 4_194_304  # bytes: thousands of columns fit, a file without line ends does not
_QUOTED = re.compile('"[^"]*"')


def open_table(path: Path) -> Log:
    """Log of a table of text: one topic, called by the file's stem.

    Raises
    ------
    TrialError
        If the file is no text or has no rows of numbers.
    """
    return Table(path, "csv", layout=layout_of(path))


@dataclass
class Table(Log):
    """A table of text as a log of one topic."""

    layout: Layout = field(kw_only=True)

    def __post_init__(self) -> None:
        self.of_file.add(self.topic)
        if not self.layout.named:
            self.remark("no names")
        for name, places in self.layout.twice.items():
            called = [self.layout.names[k - 1] for k in places]
            self.note("names shared", name, places=places, called=called)
        if self.layout.unit_row:
            self.units_in = f"line {self.layout.unit_row}"

    @property
    def topic(self) -> str:
        """Name of the only topic."""
        return stem_of(self.path.with_suffix("") if self.path.suffix == ".gz" else self.path)

    @property
    def fields(self) -> Mapping[str, Mapping[str, str]]:
        """Units by column."""
        return {self.topic: dict(zip(self.layout.names, self.layout.units, strict=True))}

    def chunks(self, wanted: Mapping[str, Sequence[str]], share: Share | None = None) -> Iterator[Chunk]:
        """Samples of the columns `wanted`; cells of text are NaN, with a note."""
        columns = list(wanted.get(self.topic, ()))
        time = RowStamps(self, self.clock, lambda cells: self._numbers(cells, 0, [], Counter()), seconds)
        text: dict[str, list[tuple[int, str]]] = {}
        count: Counter[str] = Counter()
        row = self.layout.first_row
        for table in self.cells(share):
            values = np.full((table.height, len(columns)), np.nan)
            for k, name in enumerate(columns):
                values[:, k] = self._numbers(table[name], row, text.setdefault(name, []), count)
            yield Chunk(self.topic, time.of(table), values)
            row += table.height
        for name, cells in text.items():
            if cells:
                where, what = cells[0]
                self.words[self.topic, name] = f'text, "{printable(what, 30)}" in line {where}'
            if cells and count[name] < row - self.layout.first_row:
                self.note("text cells", name, count=count[name], text=what, line=where)

    def _numbers(self, cells: pl.Series, row: int, text: list[tuple[int, str]], count: Counter[str]) -> Array:
        import polars as pl

        plain = cells.str.strip_chars()
        if self.layout.decimal_comma:
            plain = plain.str.replace(",", ".", literal=True)
        elif self.layout.thousands:
            grouped = plain.str.contains(GROUPED).fill_null(value=False)
            if grouped.any():
                plain = plain.str.replace_all(",", "", literal=True).zip_with(grouped, plain)
        numbers = plain.cast(pl.Float64, strict=False)
        wrong = (numbers.is_null() & plain.is_not_null() & (plain != "")).arg_true()
        if len(wrong):
            if not text:
                text.append((row + int(wrong[0]), str(cells[int(wrong[0])])))
            count[str(cells.name)] += len(wrong)
        return numbers.to_numpy().astype(float)

    @cached_property
    def clock(self) -> TimeColumn | None:
        """Column of the time; None where the table has none."""
        head = next(self.cells(None, rows=2_000), None)
        if head is None:
            return None
        units = dict(zip(self.layout.names, self.layout.units, strict=True))
        column, self.timeless = time_column(
            units, time_fields(self.layout.names), head, lambda cells: self._numbers(cells, 0, [], Counter()),
            first_row=self.layout.first_row,
        )  # fmt: skip
        if column is not None:
            self.timeless = None
            return column
        first = self.layout.names[0]
        values = self._numbers(head[first], 0, [], Counter())
        if len(values) > 2 and np.all(np.diff(values) > 0.0) and not _counts(values):
            self.remark("time taken", first, why=self.timeless)
            return TimeColumn(first, None, scale_of(first, units[first], values))
        self.note("no time", why=self.timeless)
        return None

    def cells(self, share: Share | None = None, rows: int | None = None) -> Iterator[pl.DataFrame]:
        """Rows of text cells, an empty cell null, in tables of bounded size; `rows`: those of the first."""
        size = max(self.path.stat().st_size, 1)
        cut = short = 0
        with unpacked(self.path) as raw:
            rest = ""
            # Lines are cut at block ends: the rest waits for the next block.
            for block in self._blocks(raw, _BLOCK_BYTES if rows is None else 64 * 1024):
                end = block.rfind("\n")
                if end < 0:
                    rest += block
                    if len(rest) > _LONGEST_LINE:
                        raise TrialError(
                            f"{self.path}: a line is longer than {_LONGEST_LINE} characters; expected a table"
                        )
                    continue
                part, rest = rest + block[: end + 1], block[end + 1 :]
                part, more, fewer = self._whole(part)
                cut, short = cut + more, short + fewer
                table = self._table(part)
                if table.height:
                    yield table if rows is None else table.head(rows)
                if rows is not None:
                    return
                if share is not None:
                    share(min(raw.tell() / size, 1.0))
            if rest.strip():
                yield from self._last(rest)
        if cut:
            self.note("too many cells", count=cut, cells=len(self.layout.names))
        if short:
            self.note("too few cells", count=short, cells=len(self.layout.names))

    def _whole(self, text: str) -> tuple[str, int, int]:
        """The text without its lines of more cells than columns, how many these are, and how many have fewer.

        All of it where comments may hide a separator or quotes a line feed.
        """
        separator, width = self.layout.separator, len(self.layout.names) - 1
        bare = _QUOTED.sub("", text) if '"' in text else text
        if separator == " " or self.layout.comment or bare.count("\n") != text.count("\n"):
            return text, 0, 0
        if bare.count(separator) == width * bare.count("\n"):
            return text, 0, 0
        lines = [line for line in text.split("\n") if line.strip()]
        rows = [cells_of(line, separator) for line in lines]
        kept = [line for line, row in zip(lines, rows, strict=True) if not any(row[width + 1 :])]
        short = sum(len(row) <= width and not any(row[width + 1 :]) for row in rows)
        return "".join(f"{line}\n" for line in kept), len(lines) - len(kept), short

    def _blocks(self, raw: Any, size: int) -> Iterator[str]:
        """Text of about `size` bytes at a time, from the first row on; up to where the file is damaged."""
        # A codecs.StreamReader would decode the whole file at once.
        decoder = codecs.getincrementaldecoder(self.layout.encoding)("replace")
        skipped, before, empty = self.layout.first_row - 1, "", 0
        wide = self.layout.encoding == "utf-16"  # whose letters hold null bytes
        while True:
            try:
                data = raw.read(size)
            except DAMAGED as error:
                self.note("packing damaged", error=reason(error))
                data = b""
            if data and not wide:
                held = data.rstrip(b"\0")
                if not held:
                    empty += len(data)
                    continue
                data, empty = (b"\0" if empty else b"") + held, len(data) - len(held)
            elif empty:
                self.note("null bytes", bytes=empty)
            text = decoder.decode(data, final=not data)
            if skipped:
                lines = (before + text).split("\n", skipped)
                before = lines[-1]
                skipped -= len(lines) - 1
                text = "" if skipped else before
            if text:
                yield text
            if not data:
                return

    def _last(self, line: str) -> Iterator[pl.DataFrame]:
        """The last line, which no line feed ends, unless cells are missing in it."""
        separator = self.layout.separator
        cells = cells_of(line, separator)
        if 1 < len(self.layout.names) > len(cells):
            self.note("last line cut")
        else:
            yield self._table(line)

    def _table(self, text: str) -> pl.DataFrame:
        import polars as pl

        layout = self.layout
        if layout.separator == " ":
            text = re.sub(r"[ \t]+", " ", re.sub(r"(?m)^[ \t]+|[ \t]+$", "", text))
        widest = len(layout.names)
        try:
            return stripped(
                pl.read_csv(
                    io.BytesIO(text.encode()),
                    separator=layout.separator,
                    has_header=False,
                    schema=dict.fromkeys(layout.names, pl.String),
                    comment_prefix=layout.comment or None,
                    truncate_ragged_lines=True,
                    quote_char='"',
                )
            )
        except pl.exceptions.NoDataError:
            return pl.DataFrame(schema=dict.fromkeys(layout.names, pl.String))
        except pl.exceptions.PolarsError as error:
            raise TrialError(
                f"{self.path}: not readable as a table of {widest} columns separated by"
                f' "{layout.separator}" ({first_line(error)}); repair the file or name its reader'
            ) from None


def stripped(table: pl.DataFrame) -> pl.DataFrame:
    """The table with no blanks around cells of text; one with nothing in it, quoted or not, is null."""
    import polars as pl

    return table.with_columns(pl.col(pl.String).str.strip_chars().replace("", None))


def shared_name(name: str, places: Sequence[int]) -> str:
    """Clause on columns of one name.

    Examples
    --------
    >>> shared_name("u_m_s", (2, 5))
    'columns 2 and 5 have one name, "u_m_s"'
    """
    *before, last = map(str, places)
    return f'columns {", ".join(before)} and {last} have one name, "{printable(name)}"'


def _counts(values: Array) -> bool:
    """Whether numbers are just 0, 1, 2, ... or 1, 2, 3, ...: an index, not a time."""
    return bool(np.all(np.diff(values) == 1.0) and values[0] in (0.0, 1.0))


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
    return _encoding(_head(path), path)


def _head(path: Path) -> bytes:
    try:
        with unpacked(path) as raw:
            return bytes(raw.read(SETTINGS.head_bytes))
    except DAMAGED as error:
        raise TrialError(f"{path}: cannot be read: {reason(error)}") from None


def layout_of(path: Path) -> Layout:
    """Layout of a table of text from its first rows."""
    head = _head(path)
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
