"""The documentation as a site: formulas convert, pages are in the navigation, broken links are found.

The site itself is built by ``make site``, which fails as these say; here without Sphinx.
"""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import pytest

from docs.site.build import DOCS, broken, navigation, pages
from docs.site.formulas import FormulaError, mathml
from docs.site.reference import command_line, model_tables
from docs.site.thresholds import Thresholds, page, thresholds
from seatrial.campaign.file import CampaignFile
from tests.docs.pages import NAMES, blocks, text

CODE = re.compile(r"```.*?```|`[^`\n]+`", re.DOTALL)
FORMULA = re.compile(r"\$\$(.+?)\$\$|\$([^$\n]+?)\$", re.DOTALL)
STYLED = re.compile(r" mathvariant=\"(?!normal)")


@pytest.mark.parametrize("name", NAMES)
def test_every_formula_of_the_page_converts(name: str) -> None:
    for display, inline in FORMULA.findall(CODE.sub("", text(name))):
        made = mathml(display or inline, display=bool(display))
        assert "\\" not in made, f"{name}: {display or inline}"
        assert not STYLED.search(made)  # browsers draw no style but the upright one


@pytest.mark.parametrize("name", NAMES)
def test_the_highlighter_of_the_site_knows_every_language_of_the_page(name: str) -> None:
    lexers = pytest.importorskip("pygments.lexers")
    for block in blocks(name):
        lexers.get_lexer_by_name(block.language)


@pytest.mark.parametrize("name", NAMES)
def test_headings_of_the_page_descend_one_level_at_a_time(name: str) -> None:
    levels = [len(marks) for marks in re.findall(r"^(#+) ", CODE.sub("", text(name)), re.MULTILINE)]
    assert levels[0] == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))


@pytest.mark.parametrize("latex", [r"\nosuchcommand x", r"\frac{a}{b", r"\left( a"])
def test_a_formula_that_does_not_convert_is_refused(latex: str) -> None:
    with pytest.raises(FormulaError, match=re.escape(latex)):
        mathml(latex)


def test_letters_of_a_style_are_letters_of_their_own() -> None:
    assert ">𝐌<" in mathml(r"\mathbf{M}")
    assert ">ℝ<" in mathml(r"\mathbb{R}")
    assert ">ATC_ANGLE<" in mathml(r"\text{ATC\_ANGLE}")


def test_every_page_is_in_the_navigation_once() -> None:
    listed = re.findall(r" <([\w/-]+)>$", navigation(text("docs/index.md"), pages(DOCS), []), re.MULTILINE)
    assert sorted(listed) == sorted(
        name.removeprefix("docs/").removesuffix(".md")
        for name in NAMES
        if name.startswith("docs/") and name != "docs/index.md"
    )


def test_a_new_page_is_in_the_navigation_by_its_heading(tmp_path: Path) -> None:
    (tmp_path / "theory").mkdir()
    (tmp_path / "index.md").write_text("# all\n", encoding="utf-8")
    (tmp_path / "theory" / "tides").with_suffix(".md").write_text("# The tides\n", encoding="utf-8")
    made = navigation("# all\n", pages(tmp_path), [("reference/python", "Names")], tmp_path)
    assert ":caption: Theory\n\nThe tides <theory/tides>" in made
    assert "Names <reference/python>" in made


def test_links_that_lead_nowhere_and_what_is_fetched_are_found(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text(
        '<h1 id="here">A</h1><a href="b.html#there">b</a><a href="#here">a</a><a href="c.html">c</a>'
        '<a href="b.html#lost">b</a><img src="none.png"><script src="https://cdn.example/x.js"></script>'
        '<a href="https://example.org">a page elsewhere is no resource</a>',
        encoding="utf-8",
    )
    (tmp_path / "b.html").write_text('<h1 id="there">B</h1>', encoding="utf-8")
    assert broken(tmp_path) == [
        "a.html: link c.html leads nowhere",
        "a.html: b.html#lost names an anchor that is not there",
        "a.html: resource none.png leads nowhere",
        "a.html: fetches https://cdn.example/x.js",
    ]


def test_the_reference_tells_types_and_defaults_of_the_files_and_options_of_the_verbs() -> None:
    tables = model_tables("campaign", CampaignFile)
    assert "| `hold_out` | true or false | `false` |" in tables
    assert "| `file` | text | must be given |" in tables
    verbs = command_line()
    assert "## `identify`" in verbs
    assert "--resume / --no-resume" in verbs


@pytest.mark.parametrize("group", list(thresholds()), ids=lambda group: f"{group.module}.{group.name}")
def test_every_threshold_has_a_reason(group: Thresholds) -> None:
    assert group.description
    assert group.fields
    assert [field.name for field in group.fields if len(field.reason.split()) < 2] == []


def test_the_page_of_thresholds_tells_module_value_and_reason() -> None:
    shown = page()
    assert (
        "## AcceptedMarginLimits\n\n`seatrial.control_design.tuning_table`. Margins that a control" in shown
    )
    assert "| `phase_deg` | `30.0` | Least phase margin, deg: the lower end of what the source" in shown
