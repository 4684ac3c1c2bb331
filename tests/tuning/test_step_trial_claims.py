"""What a trial leaves out, begins with and holds the other channels to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seatrial.sensors.sensor import Sensor
from seatrial.tuning.step_trial import Rig
from tests.tuning.tuning_campaigns import rig, still, trials

NOISE = {"dvl": 0.01, "depth": 0.02, "attitude": 0.2, "gyro": 0.2}


def with_sensors(bias: float = 0.0, more: dict[str, Sensor] | None = None) -> Rig:
    sensors = {kind: Sensor(noise, bias) for kind, noise in NOISE.items()}
    return replace(rig(), sensors=sensors | (more or {}))


def test_sensors_of_a_trial_have_no_offset() -> None:
    # Of the depth, of the speed and of the compass, each of which would move the answer for good.
    one = trials("heave", (0.0,), (0.5,), beside={"u": 0.1, "yaw": 0.1})
    _, clean = with_sensors().responses(one, still(), {})
    _, moved = with_sensors(bias=0.5).responses(one, still(), {})
    for name, answers in clean.items():
        np.testing.assert_array_equal(moved[name], answers, err_msg=name)
    # The noise is there all the same.
    _, perfect = rig().responses(one, still(), {})
    assert np.abs(clean["z"] - perfect["z"]).max() > 1e-3


def test_dead_reckoning_does_not_drift_in_a_trial() -> None:
    # The same as with a position that is known, from a fix that is wrong as well.
    one = trials("cross_track", (1.5,), (1.0,))
    known, reckoned, fixed = (
        with_sensors(more=more).responses(one, still(), {})[1]["y"]
        for more in ({"position": Sensor()}, None, {"gps": Sensor(bias=5.0)})
    )
    np.testing.assert_array_equal(reckoned, known)
    np.testing.assert_array_equal(fixed, known)


def test_bands_beside_are_narrower_by_the_headroom_as_well() -> None:
    # Outside a band that is narrower by a share is what is outside one of that half-width, in its units.
    bands, headroom = {"z": 0.02, "u": 0.05, "roll": 0.01}, 0.1
    narrow = {name: (1.0 - headroom) * half for name, half in bands.items()}
    one, other = (trials("heading", (1.5,), (0.5,), beside=each) for each in (bands, narrow))
    wide, *_ = rig("typical").violations(one, still(), {})
    asked, *_ = rig("typical").violations(one, still(), {}, headroom=headroom)
    expected, *_ = rig("typical").violations(other, still(), {})
    beside = asked[..., 1:, :2]
    # The same terms but for rounding of the scale, some 1e-9 of the sums of hundreds of them.
    np.testing.assert_allclose(beside, (1.0 - headroom) * expected[..., 1:, :2], rtol=1e-6, atol=1e-9)
    assert beside.sum() > wide[..., 1:, :2].sum() + 0.01
    # However large it is, a band keeps three quarters of its width.
    most, more = (rig().violations(one, still(), {}, headroom=share)[0] for share in (0.25, 5.0))
    np.testing.assert_array_equal(most[..., 1:, :2], more[..., 1:, :2])


@pytest.mark.parametrize("loop", ["cross_track", "depth"])
def test_each_speed_of_a_path_is_flown_as_it_is_alone(loop: str) -> None:
    speeds = (1.5, 2.5)
    together = rig().responses(trials(loop, speeds, (1.0, 1.0)), still(), {})[1]
    sums = rig().violations(trials(loop, speeds, (1.0, 1.0)), still(), {})[0]
    for place, speed in enumerate(speeds):
        own = trials(loop, (speed,), (1.0,))
        alone = rig().responses(own, still(), {})[1]
        for name, answers in alone.items():
            np.testing.assert_array_equal(together[name][place], answers[0], err_msg=f"{name} {speed}")
        np.testing.assert_array_equal(rig().violations(own, still(), {})[0][:, 0], sums[:, place])


@pytest.mark.parametrize(
    ("loop", "speed"), [("heading", 1.5), ("surge", 2.0), ("heave", -0.5), ("depth", 2.5)]
)
def test_a_trial_begins_at_its_desired_speed(loop: str, speed: float) -> None:
    beside = {} if loop == "surge" else {"u": 0.1}
    _, answers = rig().responses(trials(loop, (speed,), (0.2,), beside=beside), still(), {})
    assert answers["u"][0, 0, 0] == speed


def test_nothing_moves_before_the_step_and_the_answer_after_it() -> None:
    one = trials("heading", (1.5,), (0.5,))
    t, answers = rig().responses(one, still(), {})
    assert np.abs(answers["yaw"][0, 0, t < one.settle_s]).max() < 1e-3
    assert abs(answers["yaw"][0, 0, np.searchsorted(t, one.settle_s + 2.0)]) > 1e-2
