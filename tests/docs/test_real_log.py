"""The tutorial on a real log says what its commands say, and shows the figures that they draw."""

from __future__ import annotations

import os
import re
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from docs.site.real_log import LOG, PAGE, run, written
from tests.docs.pages import blocks

NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
RECORDED = Path(os.environ.get("SEATRIAL_DATA", "/nonexistent")) / "bluerov2_heavy" / LOG


def told(line: str) -> tuple[str, list[float]]:
    """A line without its numbers and spaces, and the numbers."""
    return re.sub(r"[\s─]+", " ", NUMBER.sub("#", line)).strip(), [float(one) for one in NUMBER.findall(line)]


def same(quoted: list[float], found: list[float]) -> bool:
    """Whether numbers agree to a tenth, or to 0.03: instruction sets bend a search a little."""
    return len(quoted) == len(found) and np.allclose(quoted, found, rtol=0.1, atol=0.03)


@pytest.mark.long
@pytest.mark.skipif(not RECORDED.exists(), reason="needs the BlueROV2 recording in SEATRIAL_DATA")
def test_the_page_quotes_what_its_commands_say_and_shows_what_they_draw(tmp_path: Path) -> None:
    found: dict[str, list[list[float]]] = {}
    for line in run(tmp_path).splitlines():
        words, numbers = told(line)
        found.setdefault(words, []).append(numbers)
    quoted = 0
    for block in blocks(str(PAGE.relative_to(PAGE.parents[2]))):
        for line in block.text.splitlines() if block.language == "text" else ():
            if line.strip(" ─.…"):
                words, numbers = told(line)
                assert any(same(numbers, one) for one in found.get(words, [])), f"{PAGE.name}: {line}"
                quoted += 1
    assert quoted > 20
    for path, content in written(tmp_path):
        with Image.open(path) as shown, Image.open(BytesIO(content)) as drawn:
            assert shown.size == drawn.size, path.name
            off = np.asarray(shown.convert("L"), float) - np.asarray(drawn.convert("L"), float)
        assert np.abs(off).mean() < 2.0, path.name  # of 255: the same curves, whatever the fonts


def test_words_and_numbers_of_a_line_are_told_apart() -> None:
    assert told(" u         0.573   -6.2  ") == ("u # #", [0.573, -6.2])
    assert same([0.57], [0.58])
    assert not same([0.57], [0.67])
    assert not same([0.57], [0.57, 1.0])
