"""Every example of the documentation runs, in the order of its page and in a folder of its own.

``python`` and ``sh`` blocks of a page run one after the other in one namespace; a ``toml`` block that begins
with its file's name in a comment is written there. What is shown but takes a recording or minutes is a
``console`` block, of which verbs, options and make targets must exist. A ``text`` block behind an example
that runs quotes its output or a summary that it wrote.
"""

from __future__ import annotations

import contextlib
import io
import re
import shlex
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer
from matplotlib.figure import Figure
from typer.testing import CliRunner

from seatrial.cli import app
from tests.docs.pages import NAMES, ROOT, Block, blocks, differing, text

LANGUAGES = {"python", "sh", "console", "toml", "c", "output", "rust", "text"}
TESTS = re.compile(r"\bfn (\w+)\(|^def (test_\w+)\(", re.MULTILINE)
FILE = re.compile(r"# (\w+\.toml)$", re.MULTILINE)
LINK = re.compile(r"\]\(([^)\s]+)\)")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder that sees examples and pages as a clone does. Figures are built and not rendered."""
    monkeypatch.setattr(Figure, "savefig", lambda _, file, **__: file.write(b"not rendered"))
    for name in ("examples", "docs"):
        (tmp_path / name).symlink_to(ROOT / name, target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


LONG = (
    "your_own_vehicle",
    "compare_variants",
    "tour",
    "results",
    "campaign_file",
    "autopilot_for_your_vehicle",
    "how_sure",
    "tune_an_autopilot",
    "bench_test",
    "verify_an_autopilot",
    "share_a_report",
    "generated_trials",
)
"""Pages whose examples identify or tune for more than some seconds."""


def pages() -> Iterator[Any]:
    """Pages with examples."""
    for name in NAMES:
        if {block.language for block in blocks(name)} & {"python", "sh"}:
            yield pytest.param(name, marks=[pytest.mark.long] if Path(name).stem in LONG else [])


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("name", list(pages()))
def test_examples_of_the_page_run_and_print_what_it_quotes(name: str) -> None:
    namespace: dict[str, Any] = {"__name__": "__main__"}
    printed, ran, wrong = io.StringIO(), False, []
    for block in blocks(name):
        if block.language == "python":
            with contextlib.redirect_stdout(printed):
                exec(compile("\n" * (block.line - 1) + block.text, name, "exec"), namespace)
        elif block.language == "sh":
            for line in block.text.splitlines():
                program, *arguments = shlex.split(line)
                assert program == "seatrial", f"{name}: {line}"
                result = CliRunner().invoke(app, arguments)
                assert result.exit_code == 0, f"{name}: {line}\n{result.output}"
                printed.write(result.output)
        elif block.language == "text" and ran:
            summaries = [path.read_text(encoding="utf-8") for path in Path().rglob("summary.txt")]
            output = "\n".join([printed.getvalue(), *summaries])
            wrong += [f"{name}:{block.line}: {line}" for line in differing(block.text, output)]
        elif file := FILE.match(block.text):
            Path(file[1]).write_text(block.text, encoding="utf-8")
        if block.language in {"python", "sh", "console"}:
            ran = block.language != "console"
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("name", NAMES)
def test_blocks_are_of_known_languages_and_toml_parses(name: str) -> None:
    for block in blocks(name):
        assert block.language in LANGUAGES, f"{name}:{block.line}"
        if block.language == "toml":
            tomllib.loads(block.text)
    assert text(name).count("```") == 2 * len(blocks(name)), f"{name}: a block without language or end"


@pytest.mark.parametrize("name", NAMES)
def test_commands_that_are_shown_exist(name: str) -> None:
    commands: dict[str, Any] = getattr(typer.main.get_command(app), "commands")  # noqa: B009
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for line in _shown(blocks(name)):
        program, *arguments = shlex.split(line, comments=True)
        if program == "make":
            assert set(arguments) <= targets, f"{name}: {line}"
        if program == "seatrial" and arguments and not arguments[0].startswith("-"):
            assert arguments[0] in commands, f"{name}: {line}"
            known = {o for p in commands[arguments[0]].params for o in (*p.opts, *p.secondary_opts)}
            assert {a.partition("=")[0] for a in arguments if a.startswith("-")} <= known, f"{name}: {line}"


def _shown(found: list[Block]) -> list[str]:
    return [
        line.removeprefix("$ ")
        for block in found
        if block.language == "console"
        for line in block.text.splitlines()
        if line.startswith("$ ")
    ]


@pytest.mark.parametrize("name", NAMES)
def test_links_lead_somewhere(name: str) -> None:
    for target in LINK.findall(text(name)):
        if "://" in target:
            continue
        path, _, anchor = target.partition("#")
        page = (ROOT / name).parent / path if path else ROOT / name
        assert page.exists(), f"{name}: {target}"
        if anchor:
            headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
            assert anchor in {_anchor(heading) for heading in headings}, f"{name}: {target}"


def _anchor(heading: str) -> str:
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


@pytest.mark.parametrize("name", NAMES)
def test_tests_that_are_named_exist(name: str) -> None:
    claimed = set(re.findall(r"`((?:law|lit|golden|scalar|test)_\w+)`", text(name)))
    assert claimed <= every_test_name(), sorted(claimed - every_test_name())


@cache
def every_test_name() -> set[str]:
    sources = [*(ROOT / "crates" / "seatrial").rglob("*.rs"), *(ROOT / "tests").rglob("*.py")]
    return {a or b for path in sources for a, b in TESTS.findall(path.read_text(encoding="utf-8"))}


def test_every_theory_page_says_source_validity_and_tests() -> None:
    for name in NAMES:
        if name.startswith("docs/theory/"):
            page = text(name)
            assert "**Validity**" in page, name
            assert "**Held by** `" in page, name
            assert "$" in page, name
