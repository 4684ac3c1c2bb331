"""Templates of findings: every one can be read, and choices, lists and formats show what they should."""

from __future__ import annotations

import re
from pathlib import Path
from string import Formatter

import pytest

from seatrial.base.finding import Finding, Severity
from seatrial.report import results
from seatrial.report.results.phrases import Phrases, filled, templates

THEMES = sorted(path.stem for path in Path(results.__path__[0]).glob("*.toml"))


@pytest.mark.parametrize("theme", THEMES)
def test_every_template_can_be_read_and_its_parts_are_there(theme: str) -> None:
    for table in templates(theme).values():
        for text in table.values():
            assert list(Formatter().parse(text)) or not text
            assert not re.search(r"<(where|check|farther|shallow)>", text)


def test_a_choice_shows_its_part_and_values_stand_in_it() -> None:
    words = "{n:#line|{n} lines}{more:? and {more:#one|several} more|}"
    assert filled(words, {"n": 1, "more": 0}) == "line"
    assert filled(words, {"n": 3, "more": 1}) == "3 lines and one more"
    assert filled("{x:-below|not below}, {x:!{x:.1f}|unknown}", {"x": -0.25}) == "below, -0.2"
    assert filled("{x:!{x:.1f}|unknown}", {"x": None}) == "unknown"


def test_a_value_that_may_be_absent_needs_a_choice() -> None:
    assert filled("late{like:? as {like}|}", {}) == "late"
    with pytest.raises(KeyError):
        filled("late as {like}", {})


def test_what_a_stranger_wrote_cannot_change_a_template() -> None:
    assert filled("{name:?found {name:safe 12}|none}", {"name": "a|{b}\x1b"}) == "found a|{b}\\x1b"


def test_a_function_writes_what_no_template_can() -> None:
    words = Phrases("verification", "note")

    @words.of("no wind")
    def _no_wind(finding: Finding) -> str:
        return f"no wind in {finding.subject}"

    assert words(Finding("no wind", Severity.NOTE, "Kiel")) == "no wind in Kiel"
    assert words(Finding("told", Severity.NOTE, values={"sentence": "as told"})) == "as told"
    assert {"no wind", "told"} <= words.kinds
