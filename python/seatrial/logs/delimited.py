"""Tables of text as their layout says (`seatrial.logs.layout`), read in blocks.

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
from seatrial.logs.clock import Counter32, TimeColumn, after, scale_of, seconds, time_column, time_fields
from seatrial.logs.formats import DAMAGED, unpacked
from seatrial.logs.layout import GROUPED, Layout, cells_of, layout_of
from seatrial.logs.log import Chunk, Log, Share, stem_of

if TYPE_CHECKING:
    import polars as pl

_BLOCK_BYTES = 8_388_608  # read at a time: bounds the memory
_LONGEST_LINE = 4_194_304  # bytes: thousands of columns fit, a file without line ends does not
_QUOTED = re.compile('"[^"]*"')


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


class _Time:
    """Stamps of the rows, chunk by chunk."""

    def __init__(self, table: Table) -> None:
        self.table = table
        self.counter = Counter32()
        self.last = np.nan

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
            t = after(dated[0], self.last)
            self.last = float(np.nanmax(t))
            return t
        if scale.how:
            table.remark("scale of time", f'time "{printable(name)}"', how=scale.how)
        if scale.unix:
            table.epoch_s = 0.0
        values = self.counter.of(table._numbers(cells[name], 0, [], Counter()))
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


def _counts(values: Array) -> bool:
    """Whether numbers are just 0, 1, 2, ... or 1, 2, 3, ...: an index, not a time."""
    return bool(np.all(np.diff(values) == 1.0) and values[0] in (0.0, 1.0))
