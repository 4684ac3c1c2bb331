"""The size, width and clarity of the house against its budget: ``python tools/budget.py``.

Each figure is counted from the syntax tree of the package's sources, nothing is run. Exit code 1 where one
is over its limit. A limit falls with the figure; it rises only by a commit that says why.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "python" / "seatrial"

LIMITS = {
    "Python files": 300,
    "Python lines": 107_950,
    "modules that import the campaign": 13,
    "lines that build text below the verbs": 3_870,
    "functions over 8 parameters": 15,
    "parameters of the widest function": 16,
    "numeric constants of modules": 215,
    "numeric constants of modules without a reason": 0,
    "comment lines per 1,000 lines of long functions, at least": 34,
    "bindings named by a pronoun or a participle": 152,
    "words of documentation": 89_260,
}
"""Beyond these the build fails."""

PRONOUNS = ("one", "found", "told", "said")
"""Names that say nothing about what they hold."""

LONG = 30
"""Lines of a function from which a reader needs comments."""

TEXT_ROOMS = ("cli", "report", "examples")
"""Rooms whose business is text: what they build is not counted."""

WORDS = re.compile(r"[A-Za-z]{2,},? [a-z]{2,}")

LETTERS = re.compile(r"(?<!\S)\S*[A-Za-z]\S*")

Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Module:
    """A source file of the package."""

    path: Path

    @cached_property
    def text(self) -> str:
        """Its source."""
        return self.path.read_text(encoding="utf-8")

    @cached_property
    def lines(self) -> list[str]:
        """The source, line by line."""
        return self.text.splitlines()

    @cached_property
    def nodes(self) -> list[ast.AST]:
        """All nodes of its syntax tree."""
        return list(ast.walk(ast.parse(self.text)))

    @cached_property
    def comments(self) -> set[int]:
        """Numbers of the lines with a comment."""
        tokens = tokenize.generate_tokens(io.StringIO(self.text).readline)
        return {token.start[0] for token in tokens if token.type == tokenize.COMMENT}

    @property
    def room(self) -> str:
        """Folder below the package."""
        return self.path.relative_to(PACKAGE).parts[0]

    @property
    def functions(self) -> list[Function]:
        """Functions and methods."""
        return [node for node in self.nodes if isinstance(node, Function)]


def imports_campaign(module: Module) -> bool:
    """Whether a module outside the room imports the campaign, also where only types need it."""
    names = (
        name
        for node in module.nodes
        for name in (
            [alias.name for alias in node.names]
            if isinstance(node, ast.Import)
            else [node.module or ""]
            if isinstance(node, ast.ImportFrom)
            else []
        )
    )
    return module.room != "campaign" and any(name.startswith("seatrial.campaign") for name in names)


def text_lines(module: Module) -> set[int]:
    """Numbers of the lines of all simple statements that hold a string of two words or more.

    Docstrings, and strings below the field or constant that they explain, are documentation.
    """
    lines: set[int] = set()
    for node in module.nodes:
        if not isinstance(node, ast.stmt) or hasattr(node, "body"):
            continue
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            continue
        strings = (leaf.value for leaf in ast.walk(node) if isinstance(leaf, ast.Constant))
        if any(isinstance(string, str) and WORDS.search(string) for string in strings):
            lines |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return lines


def parameters(function: Function) -> int:
    """Parameters of a function, without ``self`` and ``cls``."""
    given = function.args
    names = [argument.arg for argument in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    return len([name for name in names if name not in ("self", "cls")])


def constants(module: Module) -> Iterator[tuple[str, bool]]:
    """Numeric constants of a module, and whether a comment or a string beside them gives a reason."""
    body = ast.parse(module.text).body
    for node, after in zip(body, [*body[1:], None], strict=True):
        target = node.targets[0] if isinstance(node, ast.Assign) else None
        target = node.target if isinstance(node, ast.AnnAssign) else target
        if target is None or not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        names = [leaf.id for leaf in ast.walk(target) if isinstance(leaf, ast.Name)]
        leaves = [leaf for leaf in ast.walk(node.value) if isinstance(leaf, ast.Constant)]
        if not leaves or not all(isinstance(leaf.value, int | float) for leaf in leaves):
            continue
        explained = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
        last = node.end_lineno or node.lineno
        commented = any(line in module.comments for line in range(node.lineno - 1, last + 1))
        for name in names:
            if name.strip("_").isupper():
                yield name, explained or commented


def bindings(module: Module) -> int:
    """How often a name of `PRONOUNS` is bound."""
    stored = sum(
        isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id in PRONOUNS
        for node in module.nodes
    )
    return stored + sum(isinstance(node, ast.arg) and node.arg in PRONOUNS for node in module.nodes)


def comments_of_long_functions(modules: list[Module]) -> int:
    """Lines with a comment per 1,000 lines of functions over `LONG` lines."""
    lines = commented = 0
    for module in modules:
        for function in module.functions:
            span = range(function.lineno, (function.end_lineno or function.lineno) + 1)
            if len(span) > LONG:
                lines += len(span)
                commented += sum(line in module.comments for line in span)
    return round(1000 * commented / max(lines, 1))


def figures(modules: list[Module], pages: list[Path]) -> dict[str, int]:
    """Every figure of `LIMITS`."""

    def every(count: Callable[[Module], int]) -> int:
        return sum(map(count, modules))

    widths = [parameters(function) for module in modules for function in module.functions]
    reasons = [explained for module in modules for _, explained in constants(module)]
    # Numbers and signs of tables are no words.
    words = sum(len(LETTERS.findall(page.read_text(encoding="utf-8"))) for page in pages)
    counted = (
        len(modules),
        every(lambda module: len(module.lines)),
        every(imports_campaign),
        every(lambda module: 0 if module.room in TEXT_ROOMS else len(text_lines(module))),
        sum(width > 8 for width in widths),
        max(widths),
        len(reasons),
        reasons.count(False),
        comments_of_long_functions(modules),
        every(bindings),
        words,
    )
    return dict(zip(LIMITS, counted, strict=True))


def main() -> int:
    """Print the table; 1 where a figure is over its limit."""
    modules = [Module(path) for path in sorted(PACKAGE.rglob("*.py"))]
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    over = False
    for name, value in figures(modules, pages).items():
        limit = LIMITS[name]
        bad = value < limit if name.endswith("at least") else value > limit
        over |= bad
        print(f"{name:58} {value:8,} {limit:8,}{'   over the limit' if bad else ''}")
    return int(over)


if __name__ == "__main__":
    sys.exit(main())
