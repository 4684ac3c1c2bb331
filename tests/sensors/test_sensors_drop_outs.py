"""Drop-outs: their share, their number and their length, as stated."""

from __future__ import annotations

import numpy as np
import pytest

from seatrial.base.errors import TrialError
from seatrial.sensors.log import measure, silent
from seatrial.sensors.sensor import Sensor, parse_sensors
from tests.sensors.sailing import turning_dive

T = np.arange(0.0, 20_000.0, 0.1)


def test_share_number_and_length_of_drop_outs() -> None:
    every, length = 30.0, 3.0
    lost = silent(Sensor(dropout_every_s=every, dropout_s=length), T, np.random.default_rng(1))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], lost.astype(int), [0]])))
    begins, ends = edges[::2], edges[1::2]
    # 606 cycles expected. The share of an alternating renewal process of exponential times has the relative
    # deviation sqrt(2 / cycles) every / (every + length) = 5 %; tolerance four of them.
    assert abs(lost.mean() / (length / (every + length)) - 1.0) < 0.21
    # Number of cycles: deviation of about sqrt(606) = 25; drop-outs under a sample (3 %) are not seen.
    assert abs(len(begins) - 606) < 120
    # Mean length: 3 s / sqrt(590) = 0.12 s; what is shorter than a sample is missed, 0.1 s more at most.
    assert abs(0.1 * (ends - begins).mean() - length) < 0.55


def test_a_sensor_without_them_is_never_silent() -> None:
    assert not silent(Sensor(), T, np.random.default_rng(1)).any()
    assert not silent(Sensor(dropout_every_s=1.0, dropout_s=0.0), T, np.random.default_rng(1)).any()


def test_a_log_may_begin_in_a_drop_out() -> None:
    sensor = Sensor(dropout_every_s=10.0, dropout_s=10.0)
    first = [silent(sensor, T[:1], np.random.default_rng(seed))[0] for seed in range(400)]
    # Half of 400, one standard deviation is 10.
    assert abs(sum(first) - 200) < 40


def test_channels_of_a_sensor_drop_out_together_and_sensors_on_their_own() -> None:
    lossy = {"dropout_every_s": 10.0, "dropout_s": 5.0}
    table = measure(turning_dive(), parse_sensors({"dvl": lossy, "gyro": lossy}), seed=2)
    u, w, r = (table[name].is_null() for name in ("u_m_s", "w_m_s", "r_deg_s"))
    assert u.any()
    assert u.equals(w)
    assert not u.equals(r)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"dropout_s": 2.0}, "dropout_s without dropout_every_s"),
        ({"dropout_every_s": 2.0}, "dropout_every_s without dropout_s"),
        ({"dropout_every_s": 0.0, "dropout_s": 1.0}, "expected a positive number, found 0.0"),
    ],
)
def test_half_a_drop_out_is_refused(table: dict[str, float], words: str) -> None:
    with pytest.raises(TrialError, match=words):
        parse_sensors({"dvl": table})
