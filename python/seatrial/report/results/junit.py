"""Verdicts as JUnit XML, which build servers show beside the other tests.

One ``testsuite`` per campaign, one ``testcase`` per requirement: it is judged on the mix of the table's
missions, and the failures of each of them stand in its text. There is no binding schema; these are the
elements and attributes that Jenkins and GitLab read, all of them of junit-10.xsd of Jenkins' xUnit plugin
but ``error``, which that spells ``errors`` and every server reads as it is here:

==============  ==================================================================================
``testsuite``   ``name tests failures errors skipped time timestamp``; seed, versions and what is assumed
                as ``property``
``testcase``    ``classname`` campaign.mission, or campaign.all missions (GitLab: the suite), ``name``
                requirement, ``time`` s
``failure``     a requirement that failed; ``type="failed"``, ``message`` the verdict, text the details
``failure``     one that is undecided; ``type="undecided"``: it was not shown to hold, so that a build
                must not pass; ``undecided="skipped"`` where a short campaign shall only warn
``error``       a mission that could not be flown; ``type="error"``
``error``       a log that could not have refuted its model; ``type="not judged"``: the test could not be
                made, so that a build must not pass, and nothing is known to have failed
==============  ==================================================================================

Held by ``tests/verification/test_junit.py``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Literal
from xml.etree import ElementTree

_NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What XML 1.0 has no way to write: most control characters, halves of surrogate pairs."""


@dataclass(frozen=True)
class JUnitCase:
    """What came out for a requirement of a mission (or "all missions"): verdict, a line, causes, time, s."""

    mission: str
    requirement: str
    verdict: Literal["held", "failed", "undecided", "not judged", "error"]
    message: str = ""
    details: str = ""
    time_s: float = 0.0


def junit_xml(
    name: str,
    outcomes: Sequence[JUnitCase],
    *,
    properties: Mapping[str, object] | None = None,
    at: datetime | None = None,
    undecided: Literal["failure", "skipped"] = "failure",
) -> str:
    """JUnit XML of a campaign, a text to be written in UTF-8.

    `properties`: seed, versions and whatever else is needed to fly it again. `at`: when it began; left out,
    the same verdicts give the same file. `undecided`: what an undecided requirement is to a build.

    Examples
    --------
    >>> kept = JUnitCase("box", "keeps its path", "held", time_s=2.5)
    >>> print(junit_xml("farm", [kept], properties={"seed": 7}))
    <?xml version="1.0" encoding="UTF-8"?>
    <testsuites tests="1" failures="0" errors="0" time="2.500">
      <testsuite name="farm" tests="1" failures="0" errors="0" skipped="0" time="2.500">
        <properties>
          <property name="seed" value="7" />
        </properties>
        <testcase classname="farm.box" name="keeps its path" time="2.500" />
      </testsuite>
    </testsuites>
    """
    tags = [_tag(outcome, undecided) for outcome in outcomes]
    counts = {
        "tests": str(len(tags)),
        "failures": str(tags.count("failure")),
        "errors": str(tags.count("error")),
        "skipped": str(tags.count("skipped")),
        "time": _seconds(sum(outcome.time_s for outcome in outcomes)),
    }
    # The schema of Jenkins' xUnit plugin knows no skipped ones of all suites together.
    root = ElementTree.Element("testsuites", {key: n for key, n in counts.items() if key != "skipped"})
    suite = ElementTree.SubElement(root, "testsuite", {"name": _clean(name), **counts})
    if at is not None:
        suite.set("timestamp", at.strftime("%Y-%m-%dT%H:%M:%S"))
    if properties:
        rows = ElementTree.SubElement(suite, "properties")
        for key, value in properties.items():
            ElementTree.SubElement(rows, "property", {"name": _clean(key), "value": _clean(str(value))})
    for outcome, tag in zip(outcomes, tags, strict=True):
        _case(suite, name, outcome, tag)
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


def _case(suite: ElementTree.Element, campaign: str, outcome: JUnitCase, tag: str) -> None:
    # Jenkins takes what stands before the last point for a package: points inside a name would part it.
    classname = ".".join(part.replace(".", "_") for part in (campaign, outcome.mission))
    case = ElementTree.SubElement(
        suite,
        "testcase",
        {
            "classname": _clean(classname),
            "name": _clean(outcome.requirement),
            "time": _seconds(outcome.time_s),
        },
    )
    if tag:
        said = ElementTree.SubElement(
            case, tag, {"message": _clean(outcome.message), "type": outcome.verdict}
        )
        # GitLab shows the text alone: the verdict belongs into it too.
        said.text = _clean("\n".join(text for text in (outcome.message, outcome.details) if text))
    elif outcome.message or outcome.details:
        told = ElementTree.SubElement(case, "system-out")
        told.text = _clean("\n".join(text for text in (outcome.message, outcome.details) if text))


def _tag(outcome: JUnitCase, undecided: str) -> str:
    tags = {"held": "", "failed": "failure", "undecided": undecided, "not judged": "error", "error": "error"}
    return tags[outcome.verdict]


def _seconds(time_s: float) -> str:
    return f"{time_s:.3f}"


def _clean(text: str) -> str:
    return _NO_XML.sub("\N{REPLACEMENT CHARACTER}", text)
