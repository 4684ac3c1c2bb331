"""XML of other programs, read without trust: no document types or entities, limits on size, depth and
elements.

Expressions ``${...}`` of xacro are worked out from properties of the same file: numbers, names, + - * / and
brackets, nothing else. Held by ``tests/simulators/test_markup.py``.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

from seatrial.base.errors import VehicleError, reason

Element = ElementTree.Element

_LARGEST = 5_000_000  # bytes: models are some ten thousand

_DEEPEST, _MOST = 100, 100_000

_EXPRESSION = re.compile(r"\$\{([^{}]*)\}")

_LONGEST_EXPRESSION = 500

_ROUNDS = 20
"""Properties that name properties are followed so often."""

_MOST_EXPRESSIONS = 20_000
"""Expressions that are worked out, each time counted: a robot has some hundred; this many take Python 2 s."""


def read_bytes(path: str | Path) -> bytes:
    """Content of a model file.

    Raises
    ------
    VehicleError
        It cannot be read, or is larger than any model.
    """
    try:
        with Path(path).open("rb") as file:
            content = file.read(_LARGEST + 1)
    except OSError as error:
        raise VehicleError(f"{path}: cannot be read ({reason(error)}); give a model file") from None
    if len(content) > _LARGEST:
        raise VehicleError(
            f"{path}: expected a model of at most {_LARGEST / 1e6:g} MB, found a larger file; is it a mesh?"
        )
    return content


def parse(content: bytes, source: str) -> Element:
    """Root element of an XML text.

    Raises
    ------
    VehicleError
        It is no XML, declares a document type or entities, or is too deep or too long.

    Examples
    --------
    >>> parse(b"<sdf><model name='rov'/></sdf>", "rov.sdf")[0].get("name")
    'rov'
    """
    builder = ElementTree.TreeBuilder()
    parser = expat.ParserCreate()
    depth = count = 0

    def refuse(*_: object) -> None:
        raise VehicleError(
            f"{source}: row {parser.CurrentLineNumber}: expected XML without a document type and entities,"
            " found"
            " a declaration; take it out"
        )

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        if depth > _DEEPEST or count > _MOST:
            raise VehicleError(
                f"{source}: row {parser.CurrentLineNumber}: expected at most {_MOST} elements, {_DEEPEST}"
                " deep,"
                " found more; give the model alone, not a world"
            )
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(content, True)
        return builder.close()
    except (expat.ExpatError, UnicodeError, ValueError) as error:
        if isinstance(error, VehicleError):
            raise
        raise VehicleError(
            f"{source}: expected XML, found another text ({error}); give a model file"
        ) from None


def local(element: Element) -> str:
    """Name of an element without its prefix."""
    return element.tag.rpartition(":")[2].rpartition("}")[2]


def numbers(text: str | None, where: str, *, count: tuple[int, ...] = (1,)) -> list[float]:
    """Numbers of a text, as many as one of `count`.

    Raises
    ------
    VehicleError
        There are others, or one is not finite.

    Examples
    --------
    >>> numbers(" 1 2.5e0 -3 ", "cg", count=(3,))
    [1.0, 2.5, -3.0]
    """
    words = (text or "").replace(",", " ").split()
    try:
        found = [float(word) for word in words]
    except ValueError:
        found = []
    if len(found) not in count or not all(map(math.isfinite, found)):
        hint = "; expand the file with xacro first" if "$" in (text or "") else ""
        raise VehicleError(
            f"{where}: expected {' or '.join(map(str, count))} finite numbers, found"
            f" {' '.join(words)[:60]!r}{hint}"
        )
    return found


def expanded(root: Element, source: str) -> Element:
    """The same tree with ``${...}`` worked out from the properties of xacro in it.

    What properties insert is counted over the whole file: a property that names another twice doubles it.

    Raises
    ------
    VehicleError
        An expression is none of plain arithmetic, or there are more than any robot has. A name that is not
        in the file stays.
    """
    values: dict[str, str] = {
        one.get("name", ""): one.get("value", "") for one in root.iter() if local(one) == "property"
    }
    letters = count = 0

    def put(match: re.Match[str]) -> str:
        nonlocal letters, count
        text = _value(match, values, source)
        letters, count = letters + len(text), count + 1
        if letters > _LARGEST or count > _MOST_EXPRESSIONS:
            raise VehicleError(
                f"{source}: expected properties that make a model of at most {_LARGEST / 1e6:g} MB with"
                f" {_MOST_EXPRESSIONS:,} expressions, found more; expand the file with xacro first"
            )
        return text

    def worked_out(text: str | None) -> str | None:
        for _ in range(_ROUNDS):
            if text is None or "${" not in text:
                return text
            changed = _EXPRESSION.sub(put, text)
            if changed == text:
                return text
            text = changed
        raise VehicleError(f"{source}: properties name one another in a circle: {str(text)[:60]!r}")

    for name in values:  # in the order of the file: a property may name those before it
        values[name] = worked_out(values[name]) or ""
    for one in root.iter():
        one.text = worked_out(one.text)
        for key, value in one.attrib.items():
            one.set(key, worked_out(value) or "")
    return root


_OPERATIONS: Mapping[type, Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}


def _value(match: re.Match[str], values: Mapping[str, str], source: str) -> str:
    text = match.group(1).strip()
    if text in values:
        return values[text]
    if len(text) > _LONGEST_EXPRESSION:
        raise VehicleError(
            f"{source}: an expression of {len(text)} letters; expand the file with xacro first"
        )
    try:
        tree = ast.parse(text, mode="eval").body
        names = (node.id for node in ast.walk(tree) if isinstance(node, ast.Name))
        if any(name not in values and name != "pi" for name in names):
            return match.group(0)
        return repr(_worked_out(tree, values))
    except (SyntaxError, ValueError, ZeroDivisionError, OverflowError, RecursionError, MemoryError):
        raise VehicleError(
            f"{source}: expected plain arithmetic, found ${{{text[:60]}}}; expand the file with xacro first"
        ) from None


def _worked_out(node: ast.AST, values: Mapping[str, str]) -> float:
    match node:
        case ast.Constant(value=int() | float() as value):
            return float(value)
        case ast.Name(id="pi"):
            return math.pi
        case ast.Name(id=name):
            return float(values[name])
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_worked_out(operand, values)
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return _worked_out(operand, values)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATIONS:
            return _OPERATIONS[type(op)](_worked_out(left, values), _worked_out(right, values))
    raise ValueError(ast.dump(node)[:40])


def children(element: Element, name: str) -> Iterator[Element]:
    """Children of an element with a name, whatever their prefix."""
    return (one for one in element if local(one) == name)
