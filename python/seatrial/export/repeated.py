"""A straight-line step of C in less memory: what it does more than once becomes a function that is called.

A recorded step says everything as often as it does it: each loop of the autopilot, each actuator, each pass
of the allocation. Runs of statements that differ in nothing but what they read are found by their shapes and
become one static function with what differs as arguments. The operations and their order stay, so the
numbers are the same to the last bit. The gain of each fold is estimated in bytes of a Cortex-M7.

Tests: ``tests/export/test_c.py``.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Mask

_STATEMENT = re.compile(r"    const (real|_Bool) (t\d+) = (.*);")
_READ = re.compile(
    r"\b[gx]\d+(?:\.o\d+)?\b|\bt\d+\b|\bR\([^()]*\)|\bGUARD\([^()]*\)|\b[a-z]+->\w+(?:\[\d+\])?"
)
_FUNCTION = re.compile(r"(?m)^(void \w+_(?:step|measure)\([^)]*\))\n\{\n(.*?)^\}\n", re.DOTALL)


@dataclass(frozen=True)
class RepetitionSettings:
    """When repeated statements become a function of the generated C."""

    statement_bytes: int = 9  #: Bytes of a statement on a Cortex-M7 at -Os.
    argument_bytes: int = 7  #: Bytes of an argument there.
    result_bytes: int = 6  #: Bytes of a result there.
    call_bytes: int = 8  #: Bytes of a call there.
    least_gain_bytes: int = 48  #: Gain in bytes below which a fold is not worth its name.
    seed_statements: int = 8  #: Statements below which runs are not looked for.
    section_statements: int = 300  #: Most statements of a function.
    seeds_compared: int = 12  #: Places that are compared with the first of a shape.
    #: Statements that are compared at once first, then four times as many each time: most runs are short.
    first_compared: int = 64


SETTINGS = RepetitionSettings()

_Integers = NDArray[np.int64]


@dataclass(frozen=True)
class _Statement:
    """`kind name = shape` with the reads in the gaps of the shape; a call has results, and is not folded."""

    name: str
    kind: str
    shape: str
    reads: tuple[str, ...]
    results: tuple[str, ...]

    @property
    def is_call(self) -> bool:
        return self.shape.startswith("call ")

    def text(self) -> str:
        gaps = iter(self.reads)
        return f"    const {self.kind} {self.name} = {_filled(self.shape.removeprefix('call '), gaps)};"


@dataclass
class _Block:
    """A function: statements between the head, which loads, and the tail, which stores."""

    head: list[str]
    statements: list[_Statement]
    tail: list[str]


@dataclass(frozen=True)
class _Index:
    """A block as arrays, one row a statement; reads are (n, r), padded with -1, of a call all."""

    made: dict[str, int]
    """Statement that makes a result, by name."""
    shapes: _Integers
    """(n,) number of shape and kind; -1 for a call, which is like no other statement."""
    commutes: Mask
    """(n,) whether the first two reads may be exchanged."""
    last: _Integers
    """(n,) the last statement that reads a result, -1 where none does."""
    reads: _Integers
    """(n, r) number of what is read."""
    origins: _Integers
    """(n, r) statement that made it, -1 where that is outside the block."""
    kinds: _Integers
    """(n, r) 1 for a truth value, 0 for a real number."""


@dataclass(frozen=True)
class _Run:
    """Equal runs of statements: where they begin as (block, index), how long, and what is gained in bytes."""

    places: list[tuple[int, int]]
    length: int
    gain: int
    outside: list[list[str]]
    """What each place reads from outside, in the order in which the first place reads it."""


def _filled(shape: str, reads: Iterator[str]) -> str:
    return re.sub("@", lambda _: next(reads), shape)


def folded(source: str) -> str:
    """A C source as the core writes it with its repeated runs of statements folded into functions."""
    functions = list(_FUNCTION.finditer(source))
    if not functions:
        return source
    folder = _Folder([_block(match[2]) for match in functions])
    folder.fold()
    text, end = source[: functions[0].start()] + "".join(folder.functions()), functions[0].start()
    for match, block in zip(functions, folder.blocks, strict=False):
        text += source[end : match.start()] + _function(match[1], block)
        end = match.end()
    return text + source[end:]


def _function(signature: str, block: _Block) -> str:
    """A function; a long one in sections, since compilers and checkers take more than in proportion."""
    count = math.ceil(len(block.statements) / SETTINGS.section_statements)
    if count > 1:
        return _in_sections(signature, block, count)
    body = [*block.head, *(statement.text() for statement in block.statements), *block.tail]
    return signature + "\n{\n" + "\n".join(body) + "\n}\n"


def _in_sections(signature: str, block: _Block, count: int) -> str:
    """A function as calls of sections that load what they read and hand on what they found."""
    size = math.ceil(len(block.statements) / count)
    sections = [block.statements[k * size : (k + 1) * size] for k in range(count)]
    short = "measure" if "_measure(" in signature else "step"
    made = {
        result: k for k, part in enumerate(sections) for statement in part for result in statement.results
    }
    reads = [{read for statement in part for read in statement.reads} for part in sections]
    reads[-1].update(read for line in block.tail for read in _READ.findall(line))
    # Per section what earlier ones made.
    earlier = [{read for read in part if made.get(read, k) != k} for k, part in enumerate(reads)]
    asked = set().union(*earlier)
    handed = [statement for statement in block.statements if not asked.isdisjoint(statement.results)]
    members = "".join(f"    {statement.kind} {statement.name};\n" for statement in handed)
    text = f"typedef struct\n{{\n{members}}} {short}_found;\n\n"
    pointers = [word.strip() for word in signature.split("(")[1].rstrip(")").split(",")]
    calls = [f"    {short}_found found;"]
    for k, part in enumerate(sections):
        last = k == count - 1

        def named(read: str, of: set[str] = earlier[k]) -> str:
            return f"found->{read}" if read in of else read

        lines = [line for line in block.head if line.split()[2] in reads[k]]
        lines += [replace(statement, reads=tuple(map(named, statement.reads))).text() for statement in part]
        lines += [
            f"    found->{statement.name} = {statement.name};"
            for statement in part
            if not asked.isdisjoint(statement.results)
        ]
        if last:
            stores = (line for line in block.tail if "(void)" not in line)
            lines += [_READ.sub(lambda match: named(match[0]), line) for line in stores]
        body = "\n".join(lines)
        used = [pointer for pointer in pointers if f" {pointer.split('*')[1]}->" in body]
        given = [pointer if last else f"const {pointer.removeprefix('const ')}" for pointer in used]
        given.append(f"{'const ' if last else ''}{short}_found *found")
        text += f"static void {short}_{k}({', '.join(given)})\n{{\n{body}\n}}\n\n"
        calls.append(
            f"    {short}_{k}({', '.join([*(pointer.split('*')[1] for pointer in used), '&found'])});"
        )
    calls += [line for line in block.tail if "(void)" in line]
    return text + signature + "\n{\n" + "\n".join(calls) + "\n}\n"


def _block(body: str) -> _Block:
    block = _Block([], [], [])
    for line in body.splitlines():
        match = _STATEMENT.fullmatch(line)
        if match is None:
            block.tail.append(line)
            continue
        kind, name, value = match.groups()
        reads = tuple(_READ.findall(value))
        shape = _READ.sub("@", value)
        if shape == "@" and "->" in reads[0]:
            block.head.append(line)
        else:
            block.statements.append(_Statement(name, kind, shape, reads, (name,)))
    return block


class _Folder:
    """Blocks whose runs are folded one after the other, the most gainful first."""

    def __init__(self, blocks: list[_Block]) -> None:
        self.blocks = blocks
        self.signatures: list[tuple[str, str, list[tuple[str, str]]]] = []  # type, name, results
        self.given: list[list[str]] = []
        self.kinds = {
            match[2]: match[1]
            for block in blocks
            for line in block.head
            if (match := _STATEMENT.fullmatch(line)) is not None
        }
        self.kinds |= {statement.name: statement.kind for block in blocks for statement in block.statements}
        self.width = max(2, *(len(statement.reads) for block in blocks for statement in block.statements))
        self.index: dict[int, _Index] = {}
        self.numbers: dict[str, int] = {}
        self.names: list[str] = []
        self.first = len(blocks)
        self.fresh = 0

    def fold(self) -> None:
        """Fold until nothing is gained."""
        self._index(range(len(self.blocks)))
        while True:
            # Folds move statements: a run is named by its statements, and weighed again when its turn comes.
            runs = [
                [(block, self.blocks[block].statements[at].name) for block, at in run.places]
                for run in sorted(self._runs(), key=lambda run: -run.gain)
            ]
            folds = 0
            for named in runs:
                places = [
                    (block, self.index[block].made[name])
                    for block, name in named
                    if name in self.index[block].made
                ]
                run = self._longest(places[0], places[1:]) if len(places) > 1 else None
                if run is not None:
                    self._fold(run)
                    folds += 1
            if folds == 0:
                return

    def functions(self) -> Iterator[str]:
        """The functions, callees before their callers."""
        for number in reversed(range(len(self.signatures))):
            kind, name, results = self.signatures[number]
            block = self.blocks[self.first + number]
            body = "\n".join([*(statement.text() for statement in block.statements), *block.tail])
            if len(results) > 1:
                members = "".join(f"    {of} {member};\n" for of, member in results)
                yield f"typedef struct\n{{\n{members}}} {kind};\n\n"
            yield f"static {kind} {name}({', '.join(self.given[number])})\n{{\n{body}\n}}\n\n"

    def _kind(self, read: str) -> str:
        return self.kinds.get(read, "real")

    def _index(self, blocks: Iterable[int]) -> None:
        """Where results are made and where they are read last, of some blocks."""
        for number in blocks:
            block = self.blocks[number]
            statements = block.statements
            made = {result: k for k, statement in enumerate(statements) for result in statement.results}
            read: dict[str, int] = {}
            for k, statement in enumerate(statements):
                read.update(dict.fromkeys(statement.reads, k))
            for line in block.tail:
                read.update(dict.fromkeys(_READ.findall(line), len(statements)))
            reads = np.full((3, len(statements), self.width), -1)
            reads[2] = 0
            for k, statement in enumerate(statements):
                for r, name in enumerate(() if statement.is_call else statement.reads):
                    boolean = self._kind(name) == "_Bool"
                    reads[:, k, r] = self._numbered(name), made.get(name, -1), boolean
            shapes = [
                -1 if statement.is_call else self._numbered(f"{statement.kind} {statement.shape}")
                for statement in statements
            ]
            self.index[number] = _Index(
                made,
                np.array(shapes, dtype=np.int64),
                np.array([statement.shape in ("@ * @", "@ + @") for statement in statements], dtype=bool),
                np.array([read.get(statement.name, -1) for statement in statements], dtype=np.int64),
                reads[0],
                reads[1],
                reads[2],
            )

    def _numbered(self, name: str) -> int:
        """A number for a name, the same each time."""
        number = self.numbers.setdefault(name, len(self.numbers))
        if number == len(self.names):
            self.names.append(name)
        return number

    def _alike(self, first: tuple[int, int], other: tuple[int, int], most: int) -> tuple[int, list[str]]:
        """Statements that two runs share, and what the other reads from outside, as the first orders it."""
        a, b = self.index[first[0]], self.index[other[0]]
        length, outside, chunk = 0, [], SETTINGS.first_compared
        while length < most:
            count = min(chunk, most - length)
            mine = slice(first[1] + length, first[1] + length + count)
            theirs = slice(other[1] + length, other[1] + length + count)
            # Results of the run itself count by their place in it, all else only by its kind.
            own = np.maximum(a.origins[mine] - first[1], -1)
            others = np.maximum(b.origins[theirs] - other[1], -1)
            kinds = b.kinds[theirs]
            same = (own == others) & ((own >= 0) | (a.kinds[mine] == kinds))
            swapped = np.arange(own.shape[1])
            swapped[:2] = 1, 0
            crossed = (own == others[:, swapped]) & ((own >= 0) | (a.kinds[mine] == kinds[:, swapped]))
            straight = same.all(axis=1)
            alike = (a.shapes[mine] == b.shapes[theirs]) & (a.shapes[mine] >= 0)
            alike &= straight | (crossed.all(axis=1) & a.commutes[mine])
            shared = count if alike.all() else int(np.argmin(alike))
            reads = b.reads[theirs]
            reads = np.where(straight[:, None], reads, reads[:, swapped])
            free = (own < 0) & (a.reads[mine] >= 0)
            outside += [self.names[name] for name in reads[:shared][free[:shared]].tolist()]
            length += shared
            if shared < count:
                break
            chunk *= 4
        return length, outside

    def _outside(self, first: tuple[int, int], length: int) -> tuple[list[str], list[int]]:
        """What a run reads from outside, and how many of it the statements before each one and all read."""
        block, at = first
        index = self.index[block]
        reads = index.reads[at : at + length]
        free = (index.origins[at : at + length] < at) & (reads >= 0)
        return [self.names[name] for name in reads[free].tolist()], [0, *np.cumsum(free.sum(axis=1)).tolist()]

    def _results(self, places: Sequence[tuple[int, int]], length: int) -> list[int]:
        """The statements of a run whose results are read after it, in any of its places."""
        wanted = np.zeros(length, dtype=bool)
        for block, at in places:
            wanted |= self.index[block].last[at : at + length] >= at + length
        return np.flatnonzero(wanted).tolist()

    def _runs(self) -> Iterator[_Run]:
        """Runs whose fold gains something."""
        groups: dict[tuple[str, ...], list[tuple[int, int]]] = defaultdict(list)
        before: dict[tuple[int, int], str] = {}
        for number, block in enumerate(self.blocks):
            shapes = [statement.shape for statement in block.statements]
            for at in range(len(shapes) - SETTINGS.seed_statements + 1):
                groups[tuple(shapes[at : at + SETTINGS.seed_statements])].append((number, at))
                before[number, at] = shapes[at - 1] if at else ""
        for places in groups.values():
            # Where all go on backwards alike, the run from there on is the longer one.
            earlier = {before[place] for place in places}
            if len(places) < 2 or (len(earlier) == 1 and "" not in earlier and min(earlier)[:4] != "call"):
                continue
            for k, first in enumerate(places[: SETTINGS.seeds_compared]):
                run = self._longest(first, places[k + 1 : k + SETTINGS.seeds_compared])
                if run is not None:
                    yield run

    def _longest(self, first: tuple[int, int], others: Iterable[tuple[int, int]]) -> _Run | None:
        """The most gainful run from a place on, with those of the others that go on as it does."""
        matches: list[tuple[tuple[int, int], int, list[str]]] = []
        room = len(self.blocks[first[0]].statements) - first[1]
        for other in others:
            most = min(room, len(self.blocks[other[0]].statements) - other[1])
            # In one block the two must not overlap.
            if other[0] == first[0]:
                most = min(most, abs(other[1] - first[1]))
            shared, outside = self._alike(first, other, most)
            if shared >= SETTINGS.seed_statements:
                matches.append((other, shared, outside))
        if not matches:
            return None
        mine, before = self._outside(first, max(shared for _, shared, _ in matches))
        counted: dict[tuple[int, ...], list[int]] = {}
        # Shorter runs may be found in more places, or need fewer arguments.
        best: _Run | None = None
        for length in sorted({n for _, shared, _ in matches for n in _lengths(shared)}, reverse=True):
            gained = SETTINGS.statement_bytes * length - SETTINGS.call_bytes
            if gained * len(matches) < (SETTINGS.least_gain_bytes if best is None else best.gain):
                continue
            chosen: list[int] = []
            for m, (other, shared, _) in enumerate(matches):
                taken = (matches[c][0] for c in chosen)
                apart = all(other[0] != b or abs(other[1] - at) >= length for b, at in taken)
                if shared >= length and apart:
                    chosen.append(m)
            if not chosen:
                continue
            places = [first, *(matches[m][0] for m in chosen)]
            outside_of = [mine, *(matches[m][2] for m in chosen)]
            # Of the same places, arguments of a shorter run are the first ones of the longer run.
            if (distinct := counted.get(tuple(chosen))) is None:
                distinct = counted[tuple(chosen)] = _distinct(outside_of)
            calls = len(places)
            # A call costs its arguments and results; all places but one save the statements.
            arguments = distinct[before[length]]
            once = SETTINGS.argument_bytes * arguments + SETTINGS.result_bytes * len(
                self._results(places, length)
            )
            gain = (calls - 1) * SETTINGS.statement_bytes * length - calls * (once + SETTINGS.call_bytes)
            if gain >= SETTINGS.least_gain_bytes and (best is None or gain > best.gain):
                best = _Run(places, length, gain, [names[: before[length]] for names in outside_of])
        return best

    def _fold(self, run: _Run) -> None:
        """Make a function of a run, and calls of its places."""
        first = run.places[0]
        columns = _arguments(run.outside)
        results = self._results(run.places, run.length)
        number = len(self.signatures)
        block, at = first
        body = self.blocks[block].statements[at : at + run.length]
        kinds = [body[k].kind for k in results]
        name = f"part_{number}"
        kind = kinds[0] if len(results) == 1 else f"{name}_result"
        arguments = [f"x{self._number()}" for _ in columns]
        self.given.append([f"{self._kind(c[0])} {x}" for c, x in zip(columns, arguments, strict=True)])
        self.kinds |= {x: self._kind(c[0]) for c, x in zip(columns, arguments, strict=True)}
        self.signatures.append((kind, name, [(of, f"o{i}") for i, of in enumerate(kinds)]))
        self.blocks.append(
            self._function(first, body, zip(*run.outside, strict=True), (columns, arguments), results)
        )
        calls = {}
        for p, place in enumerate(run.places):
            calls[place] = (kind, name, tuple(column[p] for column in columns))
        # From the end on, so that the places before stay where they are.
        for block, at in sorted(run.places, reverse=True):
            self._call(block, at, run.length, calls[block, at], results)
        self._index({*(block for block, _ in run.places), len(self.blocks) - 1})

    def _number(self) -> int:
        self.fresh += 1
        return self.fresh

    def _function(
        self,
        first: tuple[int, int],
        body: Sequence[_Statement],
        outside: Iterator[tuple[str, ...]],
        given: tuple[dict[tuple[str, ...], int], list[str]],
        results: Sequence[int],
    ) -> _Block:
        """The body of a function: what it reads from outside as arguments, its own under new names."""
        columns, arguments = given
        own: dict[str, str] = {}
        statements = []
        for statement in body:
            reads = []
            for read in statement.reads:
                if self.index[first[0]].made.get(read, -1) >= first[1]:
                    reads.append(own[read])
                    continue
                column = next(outside)
                reads.append(read if _shared_constant(column) else arguments[columns[column]])
            fresh = f"g{self._number()}"
            own[statement.name] = fresh
            self.kinds[fresh] = statement.kind
            statements.append(_Statement(fresh, statement.kind, statement.shape, tuple(reads), (fresh,)))
        last = [own[body[k].name] for k in results]
        if len(last) == 1:
            return _Block([], statements, [f"    return {last[0]};"])
        kind = f"part_{len(self.signatures) - 1}_result"
        stores = [f"    all.o{i} = {name};" for i, name in enumerate(last)]
        return _Block([], statements, [f"    {kind} all;", *stores, "    return all;"])

    def _call(
        self, block: int, at: int, length: int, call: tuple[str, str, tuple[str, ...]], results: Sequence[int]
    ) -> None:
        """Put a call in the place of a run."""
        kind, name, reads = call
        home = self.blocks[block]
        run = home.statements[at : at + length]
        fresh = f"g{self._number()}"
        single = len(results) == 1
        renamed = {run[k].name: fresh if single else f"{fresh}.o{i}" for i, k in enumerate(results)}
        self.kinds |= {renamed[run[k].name]: run[k].kind for k in results}
        shape = f"call {name}({', '.join('@' for _ in reads)})"
        home.statements[at : at + length] = [_Statement(fresh, kind, shape, reads, tuple(renamed.values()))]

        def after(read: str) -> str:
            return renamed.get(read, read)

        home.statements[at + 1 :] = [
            statement
            if renamed.keys().isdisjoint(statement.reads)
            else replace(statement, reads=tuple(map(after, statement.reads)))
            for statement in home.statements[at + 1 :]
        ]
        home.tail = [_READ.sub(lambda match: after(match[0]), line) for line in home.tail]


def _lengths(longest: int) -> Iterator[int]:
    """Lengths to try: the longest, and shorter ones that may read and leave less."""
    yield from range(longest, max(longest - 3, SETTINGS.seed_statements), -1)
    yield from range(SETTINGS.seed_statements, longest, max(longest // 4, 8))


def _arguments(outside: Sequence[Sequence[str]]) -> dict[tuple[str, ...], int]:
    """The arguments: what is read from outside in each place, without the constants that all share."""
    columns: dict[tuple[str, ...], int] = {}
    for column in zip(*outside, strict=True):
        if not _shared_constant(column):
            columns.setdefault(column, len(columns))
    return columns


def _distinct(outside: Sequence[Sequence[str]]) -> list[int]:
    """How many arguments the first reads need, for none of them, one, two, ..."""
    seen: set[tuple[str, ...]] = set()
    counts = [0]
    for column in zip(*outside, strict=False):
        if not _shared_constant(column):
            seen.add(column)
        counts.append(len(seen))
    return counts


def _shared_constant(column: Sequence[str]) -> bool:
    return column[0][0] in "RG" and len(set(column)) == 1
