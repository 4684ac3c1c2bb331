"""Figures of the paper are cited by their numbers and subjects, in code and documentation alike.

A citation reads "figure 16 (control loop)". The subjects are the captions of Taubert et al. (2014), in short,
in the order in which the paper prints them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from paper.plates import PAPER_FIGURES
from tests.docs.pages import ROOT, text

CAPTIONS = """
outline; model; actuators; static behaviour; rate limits; step response; surge test; stern propeller; vertical
thruster; directions of thrust; optimisation; stage; stage; stage; stage; control loop; line of sight; PID
controller; corridor; speed control"""
SUBJECTS = dict(enumerate((" ".join(caption.split()) for caption in CAPTIONS.split(";")), start=1))

NAMED_AFTER_THE_PAPER = re.compile(r"\b(?:fn|def) \w*(lit_taubert\w*)\(")

CITED = re.compile(r"[Ff]igures? (\d+)(?: ?(–|-|to|and) ?(\d+))?(?: \(([^)]*)\))?")


def sources() -> Iterator[Path]:
    for folder in ("crates/seatrial", "crates/seatrial-python/src", "python/seatrial", "docs", "benchmarks"):
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in (".rs", ".py", ".md", ".toml") and "target" not in path.parts:
                yield path


def prose(path: Path) -> str:
    """Text of a file in one line, without the marks of its comments."""
    words = re.sub(r"^\s*(//[/!]?|#)", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return " ".join(words.split())


def test_every_cited_figure_of_the_paper_has_the_papers_number() -> None:
    assert PAPER_FIGURES == SUBJECTS  # those of the gallery's captions
    found, wrong = 0, []
    for path in sources():
        for cited in CITED.finditer(prose(path)):
            first, last = int(cited[1]), int(cited[3] or cited[1])
            found += 1
            between = range(first, last + 1) if cited[2] != "and" else (first, last)
            expected = ", ".join(dict.fromkeys(SUBJECTS.get(k, "?") for k in between))
            if cited[4] != expected:
                wrong.append(f"{path.relative_to(ROOT)}: {cited[0]}; expected ({expected})")
    assert found >= 15
    assert not wrong, "\n".join(wrong)


def test_only_table_1_of_the_paper_has_numbers_of_its_vehicle() -> None:
    """`lit_` means a published number; thrust, drag, lift and gains are computed or assumed."""
    folders = (ROOT / "tests", ROOT / "crates" / "seatrial" / "tests")
    files = [path for folder in folders for path in folder.rglob("*") if path.suffix in (".py", ".rs")]
    names = [name for path in files for name in NAMED_AFTER_THE_PAPER.findall(path.read_text("utf-8"))]
    assert names
    assert [name for name in names if not name.startswith("lit_taubert_2014_table_1")] == []


def test_every_erratum_says_printed_right_why_and_the_test_of_its_equation() -> None:
    rows = [line for line in text("docs/errata.md").splitlines() if re.match(r"\| (text at )?\(\d", line)]
    equations = []
    for row in rows:
        equation, *said, tests = (cell.strip() for cell in row.strip("|").split(" | "))
        first = re.search(r"\d+", equation)
        assert first is not None
        assert len(said) == 3
        assert all(said), row
        assert f"`test_errata_{first[0]}_" in tests, row
        equations.append(equation)
    # (6) is wrong in four ways; usage (the weight of Table I) and numerics ((37), (38)) are no errata.
    assert {"(6)", "(6)(49)", "(23)", "(35)", "(57)"} <= set(equations)
    assert not {"Table I", "(37)", "(38)", "at (54)"} & set(equations)
