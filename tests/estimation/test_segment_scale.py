"""Scale of a channel in the criterion: its spread about its mean, of an angle about its mean direction."""

from __future__ import annotations

import numpy as np
import pytest

from seatrial.base.channels import deviations


def test_an_angle_that_crosses_half_a_turn_has_the_spread_of_its_swing() -> None:
    swing = 0.3 * np.sin(np.arange(0.0, 60.0, 0.1))
    wrapped = (np.pi + swing + np.pi) % (2 * np.pi) - np.pi
    # the mean direction is half a turn but for the swing's own mean
    assert deviations(wrapped, "yaw").std() == pytest.approx(swing.std(), rel=1e-3)


def test_wrong_full_turns_between_masked_samples_do_not_widen_an_angle() -> None:
    random = np.random.default_rng(0)
    yaw = random.uniform(-np.pi, np.pi, 5000)  # neighbours far apart, as across gaps
    # no deviation is above half a turn; uniform headings have a spread of pi / sqrt(3)
    assert np.abs(deviations(yaw, "yaw")).max() <= np.pi
    assert deviations(yaw, "yaw").std() == pytest.approx(np.pi / np.sqrt(3.0), rel=0.02)


def test_other_channels_have_their_standard_deviation() -> None:
    u = np.array([0.0, 4.0, 8.0, 12.0])
    np.testing.assert_allclose(deviations(u, "u"), [-6.0, -2.0, 2.0, 6.0])
