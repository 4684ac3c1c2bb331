"""JUnit XML of verdicts: well-formed for any text, with what build servers read."""

from __future__ import annotations

from datetime import datetime
from typing import Any
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.report.results.junit import JUnitCase, junit_xml

OUTCOMES = [
    JUnitCase("farm", "keeps its path", "held", "held: at most 0.39 %", time_s=1.25),
    JUnitCase("farm", "no abort", "failed", "failed: at least 2 %", "worst run: seed 17", time_s=0.5),
    JUnitCase("box.toml", "energy", "undecided", "undecided: 199 more"),
    JUnitCase("box.toml", "time", "error", "box.toml: no leg"),
]


def suite(**keywords: Any) -> ElementTree.Element:
    root = ElementTree.fromstring(junit_xml("harbour", OUTCOMES, **keywords).encode())
    assert root.tag == "testsuites"
    (found,) = root
    counts = ("tests", "failures", "errors", "time")
    assert {key: root.get(key) for key in counts} == {key: found.get(key) for key in counts}
    # What junit-10.xsd of Jenkins' xUnit plugin lets these elements have, of what is used.
    allowed = {
        "testsuites": {*counts},
        "testsuite": {*counts, "name", "skipped", "timestamp"},
        "property": {"name", "value"},
        "testcase": {"name", "classname", "time"},
    } | {tag: {"message", "type"} for tag in ("failure", "error", "skipped")}
    for element in root.iter():
        assert set(element.attrib) <= allowed.get(element.tag, set()), element.tag
    return found


def test_a_suite_counts_its_cases_as_build_servers_do() -> None:
    found = suite()
    assert found.tag == "testsuite"
    assert found.get("name") == "harbour"
    cases = found.findall("testcase")
    assert int(found.get("tests", "")) == len(cases) == 4
    assert int(found.get("failures", "")) == len(found.findall("testcase/failure")) == 2
    assert int(found.get("errors", "")) == len(found.findall("testcase/error")) == 1
    assert int(found.get("skipped", "")) == len(found.findall("testcase/skipped")) == 0
    assert float(found.get("time", "")) == pytest.approx(sum(float(case.get("time", "")) for case in cases))


def test_a_case_is_a_requirement_on_the_missions() -> None:
    cases = suite().findall("testcase")
    assert [(case.get("classname"), case.get("name")) for case in cases] == [
        ("harbour.farm", "keeps its path"),
        ("harbour.farm", "no abort"),
        ("harbour.box_toml", "energy"),
        ("harbour.box_toml", "time"),
    ]
    failure = cases[1].find("failure")
    assert failure is not None
    assert (failure.get("type"), failure.get("message")) == ("failed", "failed: at least 2 %")
    assert failure.text == "failed: at least 2 %\nworst run: seed 17"
    assert cases[0].findtext("system-out") == "held: at most 0.39 %"
    assert {child.tag for child in cases[0]} == {"system-out"}


def test_what_is_undecided_fails_a_build_unless_it_shall_only_warn() -> None:
    assert suite().findall("testcase/failure")[1].get("type") == "undecided"
    lenient = suite(undecided="skipped")
    assert (lenient.get("failures"), lenient.get("skipped")) == ("1", "1")
    skipped = lenient.find("testcase/skipped")
    assert skipped is not None
    assert skipped.get("message") == "undecided: 199 more"


def test_what_is_needed_to_fly_again_stands_in_properties_and_the_time_only_if_told() -> None:
    found = suite(properties={"seed": 7, "seatrial": "0.5"}, at=datetime(2026, 3, 1, 12, 30))
    rows = {row.get("name"): row.get("value") for row in found.findall("properties/property")}
    assert rows == {"seed": "7", "seatrial": "0.5"}
    assert found.get("timestamp") == "2026-03-01T12:30:00"
    assert suite().get("timestamp") is None
    assert junit_xml("harbour", OUTCOMES) == junit_xml("harbour", OUTCOMES)


@given(st.text(st.characters(exclude_categories=())), st.text())
def test_law_any_text_gives_well_formed_xml(name: str, details: str) -> None:
    text = junit_xml(name, [JUnitCase(name, name, "failed", name, details)], properties={name: name})
    root = ElementTree.fromstring(text.encode())
    case = root.find("testsuite/testcase")
    assert case is not None
    if name.isprintable():
        assert case.get("name") == name
