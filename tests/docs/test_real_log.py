"""The tutorial on a real log says what its commands say, and shows the figures that they draw."""

from __future__ import annotations

import os
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from docs.site.real_log import LOG, PAGE, run, written
from tests.docs.pages import blocks, differing

RECORDED = Path(os.environ.get("SEATRIAL_DATA", "/nonexistent")) / "bluerov2_heavy" / LOG


@pytest.mark.long
@pytest.mark.skipif(not RECORDED.exists(), reason="needs the BlueROV2 recording in SEATRIAL_DATA")
def test_the_page_quotes_what_its_commands_say_and_shows_what_they_draw(tmp_path: Path) -> None:
    printed = run(tmp_path)
    quoted = [
        block.text for block in blocks(str(PAGE.relative_to(PAGE.parents[2]))) if block.language == "text"
    ]
    assert len(quoted) > 5
    for text in quoted:
        assert not differing(text, printed)
    for path, content in written(tmp_path):
        with Image.open(path) as shown, Image.open(BytesIO(content)) as drawn:
            assert shown.size == drawn.size, path.name
            off = np.asarray(shown.convert("L"), float) - np.asarray(drawn.convert("L"), float)
        assert np.abs(off).mean() < 2.0, path.name  # of 255: the same curves, whatever the fonts


def test_a_quotation_may_be_cut_and_bent_a_little_and_nothing_else() -> None:
    printed = " u         0.573   -6.2  \nkg 13: free N_uv; the cost would fall by 30 %"
    assert not differing("u ─── 0.575 -6.2\n...\nkg 13: ... would fall by 31 %", printed)
    for wrong in ("u 0.573", "v 0.573 -6.2", "u 0.673 -6.2", "u 0.573 ... -9.2", "free N_uv"):
        assert differing(wrong, printed), wrong
