"""Quadratic damping or strips: how much likelier one of them must be."""

from __future__ import annotations

import numpy as np
import pytest

from seatrial.identification.damping import likelier_by


def test_a_gain_of_likelihood_is_held_against_chance() -> None:
    """The same gain in every block is no chance; one block that gains what others lose is."""
    before = np.array([100.0, 120.0, 90.0, 110.0])
    assert likelier_by(before, before + 3.0) == (12.0, 0.0)
    gain, chance = likelier_by(before, before + np.array([40.0, -30.0, 20.0, -18.0]))
    assert gain == pytest.approx(12.0)
    assert chance == pytest.approx(2.0 * np.std([40.0, -30.0, 20.0, -18.0]) * 2.0)
    assert gain < chance
    assert likelier_by(before, before * np.nan) == (-np.inf, 0.0)
    assert likelier_by(before * np.nan, before) == (np.inf, 0.0)
