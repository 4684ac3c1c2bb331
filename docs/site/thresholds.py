"""The page of thresholds: every frozen dataclass ``…Settings`` or ``…Limits`` with the reason of each field.

Read from the sources: a reason is a ``#:`` comment beside a field or above it, the text below it, or its
entry under Attributes. Held by ``tests/docs/test_site.py``.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "python" / "seatrial"


@dataclass(frozen=True)
class Threshold:
    """A field of such a class, its value as it is written, and why; empty where no reason is given."""

    name: str
    value: str
    reason: str


@dataclass(frozen=True)
class Thresholds:
    """Such a class: its module, its docstring without sections, and its fields."""

    module: str
    name: str
    description: str
    fields: tuple[Threshold, ...]


def thresholds(package: Path = PACKAGE) -> Iterator[Thresholds]:
    """All of them, in the order of the files."""
    for path in sorted(package.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        module = ".".join(path.relative_to(package.parent).with_suffix("").parts)
        for node in ast.parse(text).body:
            if not (isinstance(node, ast.ClassDef) and node.name.endswith(("Settings", "Limits"))):
                continue
            if any("frozen=True" in ast.unparse(decorator) for decorator in node.decorator_list):
                yield _class(module, node, text.splitlines())


def page() -> str:
    """Markdown with a heading and a table per class."""
    parts = [
        "What decides is a field with its reason, not a number in the code: these are all of them, with their"
        " defaults. Where a function takes `settings`, others may be given."
    ]
    for group in thresholds():
        rows = [f"| `{row.name}` | `{row.value}` | {_cell(row.reason)} |" for row in group.fields]
        parts += [
            f"## {group.name}",
            f"`{group.module}`. {_cell(group.description)}",
            "\n".join(["| field | value | reason |", "|---|---|---|", *rows]),
        ]
    return "\n\n".join(parts) + "\n"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("``", "`").replace("|", "\\|").replace("<", "&lt;")


def _class(module: str, node: ast.ClassDef, lines: list[str]) -> Thresholds:
    documentation = inspect.cleandoc(ast.get_docstring(node) or "")
    description, _, attributes = documentation.partition("Attributes\n----------\n")
    reasons = dict(_entries(attributes)) | dict(_beside(node, lines))
    fields = tuple(
        Threshold(field.target.id, ast.unparse(field.value), reasons.get(field.target.id, ""))
        for field in node.body
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and field.value
    )
    return Thresholds(module, node.name, description, fields)


def _entries(attributes: str) -> Iterator[tuple[str, str]]:
    """Field and reason of a section Attributes, where one entry may name several fields."""
    for names, reason in re.findall(r"^(\w[\w, ]*?)(?: :.*)?\n((?:[ ]+.*\n?|\n)+)", attributes, re.MULTILINE):
        yield from ((name.strip(), reason) for name in names.split(","))


def _beside(node: ast.ClassDef, lines: list[str]) -> Iterator[tuple[str, str]]:
    """Field and reason where a comment stands above or beside the field, or a text below it.

    A comment above that begins with names of several fields is the reason of each; one above is also that of
    the fields that follow without any.
    """
    shared = ""
    for field, after in zip(node.body, [*node.body[1:], None], strict=True):
        if not (isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)):
            continue
        above = list[str]()
        for line in reversed(lines[: field.lineno - 1]):
            if not line.strip().startswith("#:"):
                break
            above.insert(0, line.strip().removeprefix("#:"))
        reason = " ".join(above) or lines[(field.end_lineno or field.lineno) - 1].partition("  #:")[2]
        match after:
            case ast.Expr(value=ast.Constant(value=str(text))) if not reason:
                reason = text
        shared = " ".join(above) or ("" if reason else shared)
        if reason or shared:
            yield field.target.id, reason or shared
            if named := re.match(r"\s*((?:`\w+`, )+`\w+`):(.*)", reason):
                yield from ((name, named[2]) for name in re.findall(r"`(\w+)`", named[1]))
