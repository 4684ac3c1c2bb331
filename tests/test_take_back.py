"""Groups get their start gains again where everything together is better with them."""

from __future__ import annotations

import numpy as np
import pytest

from seatrial.tuning.take_back import score, take_back
from tests.tuning_campaigns import plan

SPOILT = 0.02
"""Of the start gains: a heading loop this weak does not turn."""


def test_a_group_that_is_worse_than_its_start_gets_its_start_gains_again() -> None:
    one = plan()
    samples = one.samples(0, 1)
    start = one.autopilot.gains()
    spoilt = {name: SPOILT * value for name, value in start.items() if name.startswith("heading.K_P.")}
    kept, back = take_back(one, spoilt, samples, threads=1)
    assert back == ("heading",)
    assert all(kept[name] == start[name] for name in spoilt)
    assert score(one, kept, samples, threads=1) < score(one, spoilt, samples, threads=1)


def test_what_is_better_stays() -> None:
    one = plan()
    samples = one.samples(0, 1)
    kept, back = take_back(one, {}, samples, threads=1)
    assert back == ()
    assert kept == {}
    assert np.isfinite(score(one, kept, samples, threads=1))
    assert score(one, kept, samples) == pytest.approx(score(one, kept, samples, threads=1), abs=0.0)
