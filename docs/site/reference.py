"""Pages of the reference, written from the program: names, rooms, verbs, keys of the files, thresholds."""

from __future__ import annotations

import ast
import inspect
import textwrap
import types
import typing
from collections.abc import Iterator
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import typer
from pydantic import BaseModel

import seatrial as st
from docs.site import thresholds
from docs.site.file_keys import FILES, SUFFIX, page
from seatrial.base.toml_file import Section
from seatrial.bench_test.file import BenchFile
from seatrial.campaign.file import CampaignFile
from seatrial.cli import app

__all__ = ["command_line", "key_meanings", "model_tables", "write_reference"]


def write_reference(folder: Path) -> list[tuple[str, str]]:
    """Write the pages into a folder; the page and the title of each that the navigation lists."""
    folder.mkdir(parents=True)
    made = {
        "python": ("Python: every public name", _python()),
        "rooms": ("Python: functions of the rooms", _rooms()),
        "command_line": ("Command line: every verb", command_line()),
        "campaign_keys": ("Campaign file: every key", model_tables("campaign", CampaignFile)),
        "bench_keys": ("Bench file: every key", model_tables("bench", BenchFile)),
        **{f"{file}_keys": (f"{file.capitalize()} file: every key", page(file)) for file in FILES},
        "thresholds": ("Thresholds", thresholds.page()),
    }
    for name, (title, text) in made.items():
        (folder / f"{name}.md").write_text(f"# {title}\n\n{text}", encoding="utf-8")
    return [(f"{folder.name}/{name}", title) for name, (title, _) in made.items()]


def _python() -> str:
    """Table of the public names, and what the docstring of each says."""
    rows = [
        f"| [`st.{name}`](#{_anchor(name)}) | {_first_sentence(getattr(st, name))} |" for name in st.__all__
    ]
    intro = (
        "By task: [Python and command line](../interface.md). "
        "Shapes, units and frames: [conventions](../conventions.md)."
    )
    parts = [intro, "\n".join(["| name | is |", "|---|---|", *rows])]
    for name in st.__all__:
        directive = _directive(getattr(st, name), f"seatrial.{name}")
        parts += [f"({_anchor(name)})=\n## {name}", f"```{{eval-rst}}\n{directive}```"]
    return "\n\n".join(parts) + "\n"


def _anchor(name: str) -> str:
    """Anchor of a public name: a class and a function may differ by their capital alone."""
    return f"st-class-{name.lower()}" if name[0].isupper() else f"st-{name}"


def _directive(thing: object, name: str) -> str:
    """What autodoc is told of a name."""
    if inspect.isclass(thing):
        if issubclass(thing, Exception):
            return f".. autoexception:: {name}\n   :show-inheritance:\n"
        return f".. autoclass:: {name}\n   :members:\n"
    return f".. autofunction:: {name}\n" if callable(thing) else f".. autodata:: {name}\n"


def _first_sentence(thing: object) -> str:
    """First paragraph of a docstring in one line, fit for a cell."""
    words = " ".join((inspect.getdoc(thing) or "").split("\n\n")[0].split())
    return words.replace("``", "`").replace("|", "\\|")


def _rooms() -> str:
    """Every room with names of its own, in the order of the layers."""
    import seatrial

    package = Path(str(seatrial.__file__)).parent
    told = {id(getattr(st, name)) for name in st.__all__}
    parts = [
        "What the public functions are made of: `from seatrial.ROOM import NAME`. "
        "[What a room holds](../house.md)."
    ]
    for file in sorted(package.glob("*/__init__.py")):
        room = f"seatrial.{file.parent.name}"
        module = import_module(room)
        names = [
            name
            for name in getattr(module, "__all__", [])
            if file.parent.name not in ("cli", "examples") and id(getattr(module, name)) not in told
        ]
        if names:
            directives = "\n".join(_directive(getattr(module, name), f"{room}.{name}") for name in names)
            parts += [f"## `{room}`", _first_sentence(module), f"```{{eval-rst}}\n{directives}\n```"]
    return "\n\n".join(parts) + "\n"


def command_line() -> str:
    """Every verb with what its help says."""
    command = typer.main.get_command(app)
    commands: dict[str, Any] = getattr(command, "commands")  # noqa: B009
    parts = [
        "What `seatrial VERB --help` says. Exit codes: 0 done, 1 verdict failed, 2 bad input, "
        "130 interrupted, 141 the reader of a pipe is gone."
    ]
    for name, verb in commands.items():
        context = verb.make_context(f"seatrial {name}", [], resilient_parsing=True)
        usage = verb.get_usage(context).removeprefix("Usage: ")
        parts += [f"## `{name}`", f"```text\n{usage}\n```", _cell(inspect.cleandoc(verb.help or ""))]
        records = (parameter.get_help_record(context) for parameter in verb.params)
        rows = [f"| `{shown}` | {_cell(meaning)} |" for shown, meaning in filter(None, records)]
        if rows:
            parts.append("\n".join(["| option | meaning |", "|---|---|", *rows]))
    return "\n\n".join(parts) + "\n"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;")


def model_tables(file: str, root: type[BaseModel]) -> str:
    """Tables of the campaign or bench file as the program checks them."""
    parts = [
        "Every table with its keys, their types and defaults, as the program checks them; what the tables "
        f"are for: [{file} file](../{file}-file{SUFFIX})."
    ]
    for section in model_sections(root):
        meanings = key_meanings(section)
        rows = [
            f"| `{field.alias or name}` | {_cell(_type(field.annotation))} | {_default(field)} "
            f"| {_cell(meanings.get(name, '')).replace('``', '`')} |"
            for name, field in section.model_fields.items()
        ]
        parts += [
            f"## {section.__name__}",
            _first_sentence(section),
            "\n".join(["| key | type | default | meaning |", "|---|---|---|---|", *rows]),
        ]
    return "\n\n".join(parts) + "\n"


def key_meanings(section: type[BaseModel]) -> dict[str, str]:
    """The text below each field of a table and of the tables that it extends."""
    found: dict[str, str] = {}
    for base in reversed(section.__mro__):
        if issubclass(base, Section):
            body = cast("ast.ClassDef", ast.parse(textwrap.dedent(inspect.getsource(base))).body[0]).body
            for field, text in pairwise(body):
                if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                    match text:
                        case ast.Expr(value=ast.Constant(value=str(words))):
                            found[field.target.id] = " ".join(words.split())
    return found


def model_sections(root: type[BaseModel]) -> Iterator[type[BaseModel]]:
    """The model of a file and the models of its tables, each once, in the order of the file."""
    seen: dict[type[BaseModel], None] = {}

    def visit(thing: object) -> None:
        if inspect.isclass(thing) and issubclass(thing, Section):
            if thing in seen:
                return
            seen[thing] = None
            for field in thing.model_fields.values():
                visit(field.annotation)
        for inner in typing.get_args(thing):
            visit(inner)

    visit(root)
    yield from seen


def _type(annotation: Any) -> str:
    """A type in words of the file."""
    origin, inner = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        return _type(inner[0])
    if origin in (typing.Union, types.UnionType):
        return " or ".join(dict.fromkeys(_type(one) for one in inner if one is not type(None)))
    if origin is typing.Literal:
        return ", ".join(f'`"{one}"`' if isinstance(one, str) else f"`{one}`" for one in inner)
    if origin in (tuple, list):
        if len(inner) == 2 and inner[1] is Ellipsis:
            return f"list of {_type(inner[0])}"
        return "[" + ", ".join(_type(one) for one in inner) + "]"
    if (
        origin is dict
        or (inspect.isclass(origin) and issubclass(origin, dict))
        or str(origin).endswith("Mapping'>")
    ):
        return f"table of {_type(inner[1])}"
    words = {str: "text", float: "number", int: "integer", bool: "true or false", Any: "any value"}
    return words.get(annotation) or f"[{annotation.__name__}](#{annotation.__name__.lower()})"


def _default(field: Any) -> str:
    """The default of a key, in TOML; empty where there is none."""
    if field.is_required():
        return "must be given"
    value = field.get_default(call_default_factory=True)
    if value is None or value in ((), {}, []) or isinstance(value, BaseModel):
        return ""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return (
        f'`"{value}"`'
        if isinstance(value, str)
        else f"`{list(value) if isinstance(value, tuple) else value}`"
    )
