"""Every kind of finding that the checks write has its words, and no words lack their kind."""

from __future__ import annotations

import re
from pathlib import Path

from seatrial import check
from seatrial.report.results.check_findings import sentence

MADE = re.compile(r'(?:note|warning|make|worst|faults\.add|_of_leg)\(\s*(?:f?"([^"{]+)")')


def test_every_kind_of_finding_has_its_words() -> None:
    sources = "".join(path.read_text() for path in sorted(Path(check.__file__).parent.glob("*.py")))
    # Kinds that an expression chooses are in quotes as well; turns are named after their kind.
    named = {kind for kind in sentence.kinds if f'"{kind}"' in sources}
    named |= {"turn under way", "turn on the spot"}
    assert set(MADE.findall(sources)) <= sentence.kinds
    assert sentence.kinds == named
