"""Tables of text: comma, semicolon, tab or blanks; title, name and unit rows; decimal commas; any encoding.

The layout is found from the first rows: the separator that cuts most rows into equally many cells, the
first row of numbers, the row of names before it, and a row of units between the two. Spreadsheets write
``#REF!``, ``#####``, dates and thousands separators where a number was: such cells are empty samples,
counted and named by row.
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
from seatrial.base.errors import TrialError, reason
from seatrial.logs.clock import TimeScale, joined_names, scale_of, seconds, time_fields
from seatrial.logs.formats import DAMAGED, unpacked
from seatrial.logs.log import MOST_FIELDS, Chunk, Log, Share, printable

if TYPE_CHECKING:
    import polars as pl

__all__ = ["Layout", "Table", "encoding_of", "layout_of", "open_log", "shared_name", "stripped"]

_HEAD_BYTES = 262_144
_HEAD_ROWS = 200
_BLOCK_BYTES = 8_388_608
_LONGEST_LINE = 4_194_304
_CONTROLS = bytes(k for k in range(32) if k not in b"\t\n\r")
_MOST_CONTROLS = 0.05  # share of control bytes in text that a loss of power damaged


@dataclass(frozen=True)
class Layout:
    """How a table of text is laid out.

    Attributes
    ----------
    encoding, separator
        Of the text; the separator " " stands for runs of blanks.
    decimal_comma
        Whether ``1,5`` is one and a half.
    comment
        First character of lines to skip; "" for none.
    first_row
        Line of the first row of values, from 1.
    names, units
        Of the columns; a unit is "" where none is stated.
    named
        Whether the file has a row of names.
    plain
        Whether the row of names is the first, and the values follow it.
    twice
        Places, from 1, of the columns that share a name; all but the first of them are numbered in `names`.
    """

    encoding: str
    separator: str
    decimal_comma: bool
    comment: str
    first_row: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    named: bool
    plain: bool
    twice: Mapping[str, tuple[int, ...]] = field(default_factory=dict)


def open_log(path: Path) -> Log:
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
        if not self.layout.named:
            self.remark("no row of names: the columns are called column_1, column_2, ...")
        for name, places in self.layout.twice.items():
            called = ", ".join(f'"{printable(self.layout.names[k - 1])}"' for k in places)
            self.note(f"{shared_name(name, places)}; here they are called {called}: rename them in the file")

    @property
    def topic(self) -> str:
        """Name of the only topic."""
        return self.path.name.removesuffix(".gz").rpartition(".")[0] or self.path.name

    @property
    def fields(self) -> Mapping[str, Mapping[str, str]]:
        """Units by column."""
        return {self.topic: dict(zip(self.layout.names, self.layout.units, strict=True))}

    def chunks(self, wanted: Mapping[str, Sequence[str]], share: Share | None = None) -> Iterator[Chunk]:
        """Samples of the columns `wanted`; cells of text are NaN, with a note."""
        columns = list(wanted.get(self.topic, ()))
        time = _Time(self)
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
            if cells and count[name] < row - self.layout.first_row:
                where, what = cells[0]
                many = (
                    f"{count[name]} cells hold text, the first" if count[name] > 1 else "a cell holds text,"
                )
                self.note(
                    f'column "{printable(name)}": {many} "{printable(what, 30)}" in line {where}; read as'
                    " empty"
                )

    def _numbers(self, cells: pl.Series, row: int, text: list[tuple[int, str]], count: Counter[str]) -> Array:
        import polars as pl

        plain = cells.str.strip_chars()
        if self.layout.decimal_comma:
            plain = plain.str.replace(",", ".", literal=True)
        numbers = plain.cast(pl.Float64, strict=False)
        wrong = (numbers.is_null() & plain.is_not_null() & (plain != "")).arg_true()
        if len(wrong):
            if not text:
                text.append((row + int(wrong[0]), str(cells[int(wrong[0])])))
            count[str(cells.name)] += len(wrong)
        return numbers.to_numpy().astype(float)

    @cached_property
    def clock(self) -> tuple[str, str | None, TimeScale | None] | None:
        """Column of the time, that of its nanoseconds, and its scale; None where the table has no time."""
        head = next(self.cells(None, rows=2_000), None)
        if head is None:
            return None
        units = dict(zip(self.layout.names, self.layout.units, strict=True))
        pair = joined_names(units)
        if pair is not None:
            return pair[0], pair[1], TimeScale(1.0, unix=True)
        candidates = time_fields(self.layout.names)
        for name in candidates:
            values = self._numbers(head[name], 0, [], Counter())
            finite = values[np.isfinite(values)]
            if len(finite) > 0.5 * head.height and _rises(finite):
                return name, None, scale_of(name, units[name], values)
            dated = seconds(head[name])
            if dated is not None:
                return name, None, None
        first = self.layout.names[0]
        values = self._numbers(head[first], 0, [], Counter())
        if len(values) > 2 and np.all(np.diff(values) > 0.0) and not _counts(values):
            self.remark(f'no column is called time; taken: the first, "{printable(first)}", which rises')
            return first, None, scale_of(first, units[first], values)
        self.note("no column is a time: name one in the map, or this file cannot be used")
        return None

    def cells(self, share: Share | None = None, rows: int | None = None) -> Iterator[pl.DataFrame]:
        """Rows of text cells, an empty cell null, in tables of bounded size; `rows`: those of the first."""
        size = max(self.path.stat().st_size, 1)
        cut = short = 0
        with unpacked(self.path) as raw:
            rest = ""
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
            self.note(
                f"{_lines(cut)} more than {len(self.layout.names)} cells, as a thousands separator makes"
                " them: which cell was cut is not known; left out"
            )
        if short:
            self.note(
                f"{_lines(short)} fewer than {len(self.layout.names)} cells: the missing ones are empty"
            )

    def _whole(self, text: str) -> tuple[str, int, int]:
        """The text without its lines of more cells than columns, how many these are, and how many have fewer.

        All of it where quotes or comments may hide a separator.
        """
        separator, width = self.layout.separator, len(self.layout.names) - 1
        if separator == " " or self.layout.comment or '"' in text:
            return text, 0, 0
        if text.count(separator) == width * text.count("\n"):
            return text, 0, 0
        lines = [line for line in text.split("\n") if line.strip()]
        kept = [line for line in lines if not any(c.strip() for c in line.split(separator)[width + 1 :])]
        short = sum(line.count(separator) < width for line in kept)
        return "".join(f"{line}\n" for line in kept), len(lines) - len(kept), short

    def _blocks(self, raw: Any, size: int) -> Iterator[str]:
        """Text of about `size` bytes at a time, from the first row on; up to where the file is damaged."""
        # A codecs.StreamReader would decode the whole file at once.
        decoder = codecs.getincrementaldecoder(self.layout.encoding)("replace")
        skipped, before = self.layout.first_row - 1, ""
        while True:
            try:
                data = raw.read(size)
            except DAMAGED as error:
                self.note(f"its packing is cut short or damaged ({reason(error)}); what came before was read")
                data = b""
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
        cells = line.split() if separator == " " else line.split(separator)
        if 1 < len(self.layout.names) > len(cells):
            self.note("the last line is cut short; left out")
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
            why = str(error).splitlines()[0]
            raise TrialError(
                f"{self.path}: not readable as a table of {widest} columns separated by"
                f' "{layout.separator}" ({why}); repair the file or name its reader'
            ) from None

    def has_time(self) -> bool:
        """Whether the table has a time."""
        return self.clock is not None


class _Time:
    """Stamps of the rows, chunk by chunk."""

    def __init__(self, table: Table) -> None:
        self.table = table

    def of(self, cells: pl.DataFrame) -> Array:
        """Stamps in s of some rows, NaN where there is none."""
        table = self.table
        if table.clock is None:
            return np.full(cells.height, np.nan)
        name, rest, scale = table.clock
        if scale is None:
            dated = seconds(cells[name])
            if dated is None:
                return np.full(cells.height, np.nan)
            if dated[1]:
                table.epoch_s = 0.0
            return dated[0]
        if scale.how:
            table.remark(f'time "{printable(name)}": {scale.how}')
        if scale.unix:
            table.epoch_s = 0.0
        values = table._numbers(cells[name], 0, [], Counter())
        t = (values - scale.origin) * scale.factor
        if rest is not None:
            t = t + 1e-9 * table._numbers(cells[rest], 0, [], Counter())
        return np.asarray(t)


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


_ALONG = 0.999  # correlation of a column with its rows that makes it a time though steps fall


def _lines(count: int) -> str:
    return "a line has" if count == 1 else f"{count:,} lines have"


def _rises(values: Array) -> bool:
    """Whether numbers rise, but for some that came out of order, or many that did within bursts."""
    steps = np.diff(values)
    if len(steps) == 0:
        return True
    if not values[-1] > values[0]:
        return False
    along = np.corrcoef(values, np.arange(len(values)))[0, 1]
    return bool(np.mean(steps >= 0.0) > 0.9 or (np.mean(steps >= 0.0) > 0.5 and along > _ALONG))


def _counts(values: Array) -> bool:
    """Whether numbers are just 0, 1, 2, ... or 1, 2, 3, ...: an index, not a time."""
    return bool(np.all(np.diff(values) == 1.0) and values[0] in (0.0, 1.0))


def encoding_of(path: Path) -> str:
    """Encoding of a text file from its first bytes.

    Raises
    ------
    TrialError
        If the file cannot be read or is no text.
    """
    try:
        with unpacked(path) as raw:
            return _encoding(raw.read(_HEAD_BYTES), path)
    except DAMAGED as error:
        raise TrialError(f"{path}: cannot be read: {reason(error)}") from None


def layout_of(path: Path) -> Layout:
    """Layout of a table of text from its first rows.

    Raises
    ------
    TrialError
        If the file is no text or holds no rows of numbers.
    """
    try:
        with unpacked(path) as raw:
            head = raw.read(_HEAD_BYTES)
    except DAMAGED as error:
        raise TrialError(f"{path}: cannot be read: {reason(error)}") from None
    encoding = _encoding(head, path)
    text = codecs.getincrementaldecoder(encoding)(errors="replace").decode(head)
    lines = text.splitlines()[:_HEAD_ROWS]
    if len(head) == _HEAD_BYTES and len(lines) > 1 and len(lines) < _HEAD_ROWS:
        lines.pop()  # the block may end within it
    comment = "#" if any(line.startswith("#") for line in lines) else ""
    kept = [(k + 1, line) for k, line in enumerate(lines) if line.strip()]
    data = [(k, line) for k, line in kept if not (comment and line.startswith(comment))]
    if not data:
        raise TrialError(f"{path}: no rows; expected a row of names and rows of numbers")
    separator = _separator([line for _, line in data])
    decimal_comma = separator != "," and _decimal_comma([line for _, line in data], separator)
    rows = [(k, _cut(line, separator)) for k, line in data]
    width = Counter(len(cells) for _, cells in rows[len(rows) // 2 :]).most_common(1)[0][0]
    first = _first_row(rows, width, decimal_comma)
    if first is None and len(rows) == 1:
        raise TrialError(f"{path}: a single row; expected a row of names and rows of numbers below it")
    if first is None:
        raise TrialError(
            f"{path}: fewer than two rows of numbers in the first {len(rows)} rows, cut at {separator!r} into"
            f" {width} cells; expected a row of names and rows of numbers"
        )
    above = [cells for k, cells in rows[:first] if len(cells) == width]
    if not above and comment:  # "# t x y": the names are a comment
        commented = [_cut(line.lstrip("#% \t"), separator) for k, line in kept if line.startswith(comment)]
        above = [cells for cells in commented if len(cells) == width]
    names, units, twice = _names(above, width)
    if len(names) > MOST_FIELDS:
        raise TrialError(f"{path}: {len(names)} columns; expected at most {MOST_FIELDS}")
    return Layout(
        encoding, separator, decimal_comma, comment, rows[first][0], tuple(names), tuple(units), bool(above),
        plain=first == 1 and len(above) == 1, twice=twice,
    )  # fmt: skip


def _encoding(head: bytes, path: Path) -> str:
    if b"\r" in head and b"\n" not in head:
        raise TrialError(
            f"{path}: its lines end in a carriage return alone; expected a line feed, or both: save it with"
            " the line ends of Unix or Windows"
        )
    for mark, name in ((codecs.BOM_UTF8, "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")):
        if head.startswith(mark):
            return name
    if b"\0" in head and len(head.translate(None, _CONTROLS)) < (1.0 - _MOST_CONTROLS) * len(head):
        raise TrialError(
            f"{path}: not a text file (it holds null bytes); expected a row of names and rows of numbers;"
            " save it as UTF-8 text, or name its reader"
        )
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8"


def _cut(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    end = re.escape(separator)
    blank = rf"[^\S{end}]*"  # a tab that separates is none
    pattern = rf'{blank}(?:"((?:[^"]|"")*)"|([^{end}]*)){blank}(?:{end}|$)'
    cells = [a.replace('""', '"') if a else b.strip() for a, b in re.findall(pattern, line + separator)]
    return cells[: line.count(separator) + 1] if len(cells) > line.count(separator) + 1 else cells


def _separator(lines: Sequence[str]) -> str:
    """The separator that cuts most rows into equally many cells, at least two."""
    sample = lines[len(lines) // 4 :] or lines

    def merit(separator: str) -> tuple[float, int]:
        counts = Counter(len(_cut(line, separator)) for line in sample)
        width, rows = counts.most_common(1)[0]
        # In a log of several rates most cells may be empty.
        filled = [cell for line in sample[:20] for cell in _cut(line, separator) if cell]
        numbers = float(np.mean([_number(cell, True) for cell in filled])) if filled else 0.0
        return (rows / len(sample) * (width > 1) * (0.2 + numbers), width)

    # A decimal comma makes the comma cut regularly too: then semicolon, tab or blank cut into whole numbers.
    for separator in (";", "\t"):
        if merit(separator)[0] > 0.9:
            return separator
    return max((",", ";", "\t", " "), key=merit)


def _number(cell: str, decimal_comma: bool) -> bool:
    plain = cell.strip()
    try:
        float(plain.replace(",", ".") if decimal_comma else plain)
    except ValueError:
        return False
    return plain != ""


def _decimal_comma(lines: Sequence[str], separator: str) -> bool:
    cells = [cell for line in lines[-50:] for cell in _cut(line, separator)]
    return any(re.fullmatch(r"[+-]?\d+,\d+(e[+-]?\d+)?", cell, re.IGNORECASE) for cell in cells)


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


_UNIT = re.compile(r"^[\[(]?\s*(-|1|%|°|°c|deg\w*|rad\w*|[numkc]?m|[mu]?s|sec|h|hz|k?n|n\s*\*?\s*m|nm|"
                   r"[mk]?v|[mk]?a|k?w|w?h|[kmh]?pa|m?bar|psi|k?g|rpm|rev/?\w*|kn|kt|knots?|mph|c|k|"
                   r"(k|c|m)?m\s*/\s*(s|h)(\s*\^?\s*2|²)?|g/\w+|\w+\s*/\s*(s|min|h)(\^?2|²)?|pwm|u?µ?us|ns|ms|text|bool|"
                   r"none|n/a|unitless)?\s*[\])]?$", re.IGNORECASE)  # fmt: skip


def _names(above: Sequence[list[str]], width: int) -> tuple[list[str], list[str], dict[str, tuple[int, ...]]]:
    """Names and units of the columns from the rows above the values; places of those that share a name."""
    if not above:
        return [f"column_{k + 1}" for k in range(width)], [""] * width, {}
    last = above[-1]
    some = [cell for cell in last if cell]
    if len(above) > 1 and (not some or np.mean([bool(_UNIT.match(cell)) for cell in some]) > 0.8):
        names, units = above[-2], [cell.strip("[]() ") for cell in last]
    else:
        names = last
        units = [
            found[1].strip() if (found := re.search(r"[\[(]([^\])]*)[\])]\s*$", n)) else "" for n in names
        ]
    places: dict[str, list[int]] = {}
    unique = []
    for k, name in enumerate(names):
        name = name.strip() or f"column_{k + 1}"
        known = places.setdefault(name, [])
        known.append(k + 1)
        unique.append(name if len(known) == 1 else f"{name}_{len(known)}")
    units = [unit if unit not in ("-", "1", "none", "n/a", "unitless") else "" for unit in units]
    return unique, units, {name: tuple(known) for name, known in places.items() if len(known) > 1}
