"""The order of the rooms is told once and held; what sources and pages name exists."""

from __future__ import annotations

import ast
import importlib
import re
import tomllib
from functools import cache
from pathlib import Path

import pytest

from tests.docs.pages import NAMES, ROOT, blocks, text
from tests.docs.pages import PAGES as DOCUMENTATION

PACKAGE = ROOT / "python" / "seatrial"
PYTHON = sorted([
    *PACKAGE.rglob("*.py"),
    *(ROOT / "tests").rglob("*.py"),
    *(ROOT / "benchmarks").rglob("*.py"),
    *(ROOT / "tools").rglob("*.py"),
    *(ROOT / "docs" / "site").glob("*.py"),
])
PAGES = [*DOCUMENTATION, ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"]
RUST = sorted((ROOT / "crates").rglob("*.rs"))
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
CONTRACTS = SETTINGS["contracts"]

MODULE = re.compile(r"`(seatrial(?:\.\w+)+)")
FILE = re.compile(r"(?<![\w/.<*-])(?!mod\.rs)((?:[\w-]+/)*[\w-]+\.(?:py|rs|md))\b(?![\w/])")


def _room_folders() -> set[str]:
    return {path.parent.name for path in PACKAGE.glob("*/__init__.py")}


def test_rooms_of_the_page_are_those_of_the_contract_and_of_the_package() -> None:
    layers = [room for contract in CONTRACTS if contract["id"] == "rooms" for room in contract["layers"]]
    told = re.findall(r"^\| `(\w+)` \|", text("docs/house.md").split("\n## ")[1], re.MULTILINE)
    assert told == [room for room in reversed(layers) if room != "examples"]
    assert set(layers) == _room_folders()


def test_contracts_count_imports_for_type_checking_and_except_only_what_solves_itself() -> None:
    assert SETTINGS["exclude_type_checking_imports"] is False
    assert {contract["id"] for contract in CONTRACTS} == {"rooms", "cycles"}
    for contract in CONTRACTS:
        # `Problem.identify`, for notebooks, calls a higher room, a campaign its own verification.
        own = {"seatrial.campaign.verification"} if contract["id"] == "cycles" else set()
        excepted = {line.partition(" ")[0] for line in contract["ignore_imports"]}
        assert excepted == {"seatrial.problem.problem"} | own
        assert len(contract["ignore_imports"]) == 2 + len(own)


def test_tests_lie_in_the_room_that_they_test() -> None:
    beside = {"benchmarks", "core", "docs", "studies", "wheel"}
    folders = {path.parent.name for path in (ROOT / "tests").glob("*/*.py")}
    assert folders - beside <= _room_folders()
    assert _room_folders() <= folders


def test_modules_that_are_named_exist() -> None:
    missing = {
        f"{path.relative_to(ROOT)}: {name}"
        for path in [*PYTHON, *PAGES]
        for name in MODULE.findall(path.read_text(encoding="utf-8"))
        if not _exists(name)
    }
    assert not missing, "\n".join(sorted(missing))


@cache
def _exists(name: str) -> bool:
    """Whether a dotted name is a module, or a name that a module, a class of it or the front gives."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        module = PACKAGE.parent.joinpath(*parts[:count])
        for file in (module.with_suffix(".py"), module / "__init__.py", module.with_suffix(".pyi")):
            if file.exists():
                return count == len(parts) or parts[count] in _names(file)
    return False


@cache
def _names(file: Path) -> set[str]:
    """Every name that a file binds: definitions, assignments and imports."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            found.add(node.id)
        elif isinstance(node, ast.ImportFrom | ast.Import):
            found |= {(alias.asname or alias.name) for alias in node.names}
    return found


def test_names_that_examples_import_exist() -> None:
    missing = [
        f"{page}: {node.module}.{alias.name}"
        for page in NAMES
        for block in blocks(page)
        if block.language == "python"
        for node in ast.walk(ast.parse(block.text))
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("seatrial.")
        for alias in node.names
        if not _exists(f"{node.module}.{alias.name}")
    ]
    assert not missing


def test_files_that_are_named_exist() -> None:
    known = [f"/{file.relative_to(ROOT).as_posix()}" for file in [*PYTHON, *RUST, *PAGES]]
    missing = {
        f"{path.relative_to(ROOT)}: {name}"
        for path in [*PYTHON, *RUST, *PAGES]
        for name in FILE.findall(path.read_text(encoding="utf-8"))
        if not any(file.endswith(f"/{name}") for file in known)
    }
    assert not missing, "\n".join(sorted(missing))


@pytest.mark.parametrize("room", sorted(_room_folders() - {"cli", "examples"}))
def test_every_name_of_a_rooms_front_is_where_the_front_says(room: str) -> None:
    front = importlib.import_module(f"seatrial.{room}")
    for name in getattr(front, "__all__", ()):
        assert getattr(front, name) is not None
