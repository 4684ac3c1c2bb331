"""Expressions over the metrics of a mission: what is allowed, the kind of value of each part, and advice.

Grammar: numbers, words in quotes, names of metrics, ``+ - * / **``, ``abs min max sqrt``, comparisons (also
chained), ``and or not``. Python's own parser reads them; whatever is not on this list is refused before
anything is evaluated, so that a campaign file of somebody else cannot run code. What cannot be read is
answered with what to write instead.

Held by ``tests/verification/test_requirement.py``.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from difflib import SequenceMatcher, get_close_matches
from typing import Literal

from seatrial.base.errors import CampaignError, nearest

_EXAMPLE = "cross_track_p95_m <= 1.0"


@dataclass(frozen=True)
class ExpressionSettings:
    """What an expression may be, and which names a message offers."""

    most_offered: int = 3  #: Names that a message offers at most.
    #: How much less alike than the nearest name another one may be that is offered.
    likeness_margin: float = 0.03
    longest: int = 500  #: Characters of an expression at most.
    deepest: int = 40  #: Parts within parts at most: far from Python's own limit of recursion.


SETTINGS = ExpressionSettings()

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
    """Sentence on an expression that Python's parser does not take."""
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


def unknown_metric(name: str, metrics: Iterable[str], words: Mapping[str, Iterable[str]]) -> str:
    """Sentence on a name that is no metric: the nearest ones, or all where none is near.

    `words`: what metrics that are words may say, by metric.
    """
    known = list(metrics)
    said = f'"{name}" is no metric of a mission'
    for metric, values in words.items():
        if name in values:
            return f'{said}; write the word in quotes, {metric} == "{name}"'
    near = [f'"{one}"' for one in _near(name.casefold(), known)]
    if near:
        return f"{said}; did you mean {' or '.join([', '.join(near[:-1]), near[-1]][-len(near) :])}?"
    return f"{said}; known: {', '.join(_in_families(known))}"


def _near(name: str, known: list[str]) -> list[str]:
    """The nearest known names, those with hardly another distance together, or those that hold the name."""
    most = SETTINGS.most_offered
    close = get_close_matches(name, known, n=most)
    alike = [SequenceMatcher(None, name, other).ratio() for other in close]
    nearest = [
        other
        for other, ratio in zip(close, alike, strict=True)
        if ratio > alike[0] - SETTINGS.likeness_margin
    ]
    return nearest or [other for other in known if len(name) > 1 and name in other][:most]


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


Kind = Literal["number", "word", "truth"]


@dataclass(frozen=True)
class Metric:
    """What an expression may say of a metric: its kind, and of a word the values that it can have."""

    kind: Kind = "number"
    values: tuple[str, ...] = ()


_ENDINGS = ("complete", "surfaced", "aborted", "out of time", "diverged")
_ERRORS = ("rms", "largest", "p50", "p95", "p99")

_NUMBERS = (
    "duration_s", "distance_m", "energy_wh", *(f"cross_track_{x}_m" for x in _ERRORS),
    *(f"true_cross_track_{x}_m" for x in _ERRORS), *(f"vertical_{x}_m" for x in _ERRORS),
    "depth_excursion_m", "depth_largest_m", "altitude_smallest_m", "clearance_m", "clearance_time_s",
    "clearance_reserve_m", "depth_smallest_m", "depth_smallest_time_s", "waypoints_behind",
    "missed_by_m", "switches_per_minute", "travel_per_s", "alert_time_s", "roll_largest_deg",
    "pitch_largest_deg", "roll_time_s", "pitch_time_s",
)  # fmt: skip

PERCEIVED = (*(f"{error}_{x}_m" for error in ("cross_track", "vertical") for x in _ERRORS), "missed_by_m")
"""Errors as guidance perceived them, from its sensors; other metrics are of the vehicle itself."""

KNOWN: Mapping[str, Metric] = {
    **dict.fromkeys(_NUMBERS, Metric()),
    "ending": Metric("word", _ENDINGS),
    "alert": Metric("word"),
    "abort": Metric("truth"),
}
"""Metrics of a mission that a requirement may name."""

CALLS: Mapping[str, tuple[int, int | None]] = {
    "abs": (1, 1),
    "sqrt": (1, 1),
    "min": (2, None),
    "max": (2, None),
}
"""Functions with their smallest and largest number of arguments."""


_NOUN = {"number": "number", "word": "word", "truth": "truth value"}
_ORDERS = (ast.Lt, ast.LtE, ast.Gt, ast.GtE)
_SUMS = (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow)

_HINTS = {
    ast.BitXor: 'a power is "**"',
    ast.BitAnd: 'write "and"',
    ast.BitOr: 'write "or"',
    ast.Invert: 'write "not"',
    ast.Attribute: "metrics have no parts; the decimal mark is a point between digits",
    ast.In: 'write ending == "complete" or ending == "surfaced"',
    ast.NamedExpr: 'write "=="',
    ast.Tuple: 'the decimal mark is a point, and conditions are joined by "and"',
}

_ALLOWED = (
    "allowed are numbers, words in quotes, metrics, + - * / **, abs min max sqrt, < <= > >= == !=, and or not"
)

_SUFFIXES = (
    ("_m_s", "m/s"), ("_per_s", "1/s"), ("_per_minute", "1/min"), ("_m", "m"), ("_s", "s"), ("_wh", "Wh"),
    ("_deg", "deg"),
)  # fmt: skip


def parse(text: str) -> ast.expr:
    """Syntax tree of an expression, every part of it on the list.

    Raises CampaignError where it cannot be read, or something in it is not allowed.
    """
    if len(text) > SETTINGS.longest:
        raise CampaignError(
            f"expected at most {SETTINGS.longest} characters, found {len(text)}; split it into several"
        )
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
        raise CampaignError(unreadable(text, error)) from None
    for node, depth in _parts(tree):
        if depth > SETTINGS.deepest:
            raise CampaignError(
                f"nested more than {SETTINGS.deepest} deep; write it without the outer signs and brackets"
            )
        _allowed(node, text)
    return tree


def check(tree: ast.expr, metrics: Mapping[str, Metric]) -> None:
    """Refuse names that are no metric, kinds that do not fit, and what is not true or false as a whole.

    Raises CampaignError: with the nearest known name, or with the kinds expected and found.
    """
    kind = _kind(tree, metrics)
    if kind != "truth":
        raise CampaignError(
            f'expected something that holds or not, such as "{ast.unparse(tree)} <= 1.0";'
            f' found "{ast.unparse(tree)}", a {_NOUN[kind]}'
        )
    if not names_in(tree):
        raise CampaignError(
            f'"{ast.unparse(tree)}" names no metric of a mission: it says nothing of a flight'
        )


def names_in(tree: ast.expr) -> tuple[str, ...]:
    """Names of the metrics in an expression, each once, in their order."""
    return tuple(dict.fromkeys(node.id for node, _ in _parts(tree) if isinstance(node, ast.Name)))


def unit_of(node: ast.expr) -> str | None:
    """Unit of a number as its metrics' names tell it, empty if they tell none, nothing of a plain number.

    Examples
    --------
    >>> unit_of(parse("energy_wh / distance_m")), unit_of(parse("2 * cross_track_p95_m"))
    ('Wh/m', 'm')
    """
    match node:
        case ast.Name(id=name):
            return next((unit for suffix, unit in _SUFFIXES if name.endswith(suffix)), "")
        case ast.UnaryOp(operand=operand):
            return unit_of(operand)
        case ast.BinOp(left=left, op=ast.Mult() | ast.Div() as op, right=right):
            one, other = unit_of(left), unit_of(right)
            if other is None:
                return one
            if isinstance(op, ast.Div):
                return "" if one == other else f"{one or '1'}/{other}"
            return other if one is None else f"{one} {other}"
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub(), right=right):
            return _common((left, right))
        case ast.Call(func=ast.Name(id="abs" | "min" | "max"), args=args):
            return _common(args)
        case ast.Constant():
            return None
        case _:
            return "" if names_in(node) else None


def _common(nodes: list[ast.expr] | tuple[ast.expr, ...]) -> str | None:
    units = {unit for unit in map(unit_of, nodes) if unit is not None}
    return units.pop() if len(units) == 1 else ("" if units else None)


def _parts(tree: ast.expr) -> Iterator[tuple[ast.expr, int]]:
    """Expressions inside a tree with their depth, itself first; the name of a function is no part."""
    waiting = [(tree, 0)]
    while waiting:
        node, depth = waiting.pop(0)
        yield node, depth
        name = node.func if isinstance(node, ast.Call) else None
        children = [c for c in ast.iter_child_nodes(node) if isinstance(c, ast.expr) and c is not name]
        waiting += [(child, depth + 1) for child in children]


def _allowed(node: ast.expr, text: str) -> None:
    match node:
        case ast.Name() | ast.BoolOp():
            return
        case ast.Constant(value=value) if isinstance(value, str):
            return
        case ast.Constant(value=value) if isinstance(value, int | float) and not isinstance(value, bool):
            if _finite(value):
                return
            raise CampaignError(f'expected finite numbers, found "{ast.unparse(node)[:20]}"')
        case ast.UnaryOp(op=ast.UAdd() | ast.USub() | ast.Not()):
            return
        case ast.BinOp(op=op) if isinstance(op, _SUMS):
            return
        case ast.Compare(ops=ops) if all(isinstance(op, (*_ORDERS, ast.Eq, ast.NotEq)) for op in ops):
            return
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in CALLS:
            least, most = CALLS[name]
            if least <= len(args) <= (most or len(args)) and not any(
                isinstance(a, ast.Starred) for a in args
            ):
                return
            wanted = "one value" if most == 1 else "at least two values"
            raise CampaignError(f'{name}: expected {wanted}, found "{ast.unparse(node)}"')
        case ast.Call(func=func):
            known = nearest(ast.unparse(func), CALLS)
            raise CampaignError(f'"{ast.unparse(func)}" is no function of a requirement{known}')
        case ast.Constant(value=bool()):
            raise CampaignError(f'"{node.value!r}" needs no writing: say "abort" or "not abort"')
    # Everything else is refused, with what to write instead where that is known.
    parts: list[object] = [node, getattr(node, "op", None), *getattr(node, "ops", ())]
    hint = next((_HINTS[type(part)] for part in parts if type(part) in _HINTS), _ALLOWED)
    found = ast.get_source_segment(text.strip(), node) or ast.unparse(node)
    raise CampaignError(f'"{found}" is not allowed; {hint}')


def _kind(node: ast.expr, metrics: Mapping[str, Metric]) -> Kind:
    match node:
        case ast.Name(id=name):
            if name not in metrics:
                words = {one: metric.values for one, metric in metrics.items() if metric.values}
                raise CampaignError(unknown_metric(name, metrics, words))
            return metrics[name].kind
        case ast.Constant(value=value):
            return "word" if isinstance(value, str) else "number"
        case ast.UnaryOp(op=op, operand=operand):
            wanted: Kind = "truth" if isinstance(op, ast.Not) else "number"
            return _expect(wanted, operand, metrics, node)
        case ast.BinOp(left=left, right=right):
            _expect("number", left, metrics, node)
            return _expect("number", right, metrics, node)
        case ast.Call(args=args):
            for argument in args:
                _expect("number", argument, metrics, node)
            return "number"
        case ast.BoolOp(values=values):
            for part in values:
                _expect("truth", part, metrics, node)
            return "truth"
        case ast.Compare(left=left, ops=ops, comparators=comparators):
            sides = [left, *comparators]
            for one, comparison, other in zip(sides, ops, comparators, strict=False):
                _comparable(one, comparison, other, metrics)
            return "truth"
    raise AssertionError(ast.dump(node))  # `parse` lets nothing else through


def _expect(wanted: Kind, node: ast.expr, metrics: Mapping[str, Metric], whole: ast.expr) -> Kind:
    found = _kind(node, metrics)
    if found != wanted:
        needed = "a comparison" if wanted == "truth" else f"a {wanted}"
        raise CampaignError(
            f'"{ast.unparse(whole)}": expected {needed}, found the {_NOUN[found]} {ast.unparse(node)}'
        )
    return wanted


def _comparable(one: ast.expr, op: ast.cmpop, other: ast.expr, metrics: Mapping[str, Metric]) -> None:
    kinds = _kind(one, metrics), _kind(other, metrics)
    words = f'"{ast.unparse(ast.Compare(one, [op], [other]))}"'
    if "truth" in kinds:
        raise CampaignError(f'{words}: a truth value is not compared; write "abort" or "not abort"')
    if kinds[0] != kinds[1]:
        raise CampaignError(f"{words}: a {kinds[0]} cannot be compared with a {kinds[1]}")
    if kinds[0] == "word":
        if isinstance(op, _ORDERS):
            raise CampaignError(f'{words}: words have no order; write "==" or "!="')
        for name, word in ((one, other), (other, one)):
            if isinstance(name, ast.Name) and isinstance(word, ast.Constant):
                values = metrics[name.id].values
                said = str(word.value)
                if values and said not in values:
                    raise CampaignError(f'{name.id} is never "{said}"{nearest(said, values)}')


def _finite(value: float) -> bool:
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False
