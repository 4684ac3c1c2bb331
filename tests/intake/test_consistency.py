"""What `consistency` finds in generated motion with known errors; nothing where there are none."""

from __future__ import annotations

import numpy as np
import pytest

from seatrial.base.errors import TrialError
from seatrial.intake.consistency import Series, consistency


def test_an_unknown_channel_is_refused() -> None:
    t = np.arange(10.0)
    with pytest.raises(TrialError, match="no channel"):
        consistency({"yav": Series(t, t)})


def test_missing_roll_and_rates_are_said_with_what_they_cost() -> None:
    t = np.arange(10.0)
    said = consistency({name: Series(t, 0.0 * t) for name in ("pitch", "yaw", "z", "u", "v", "w")}).missing
    assert any("no roll" in one and "K_*" in one for one in said)
    assert any("no p q r" in one for one in said)
