"""Time stamps: own bases, phase, jitter, latency; a row per stamp; inputs beside them."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from numpy.typing import NDArray

from seatrial._core import Run
from seatrial.sensors.log import asynchronous, finer, held, linear, measure, times
from seatrial.sensors.sensor import Sensor
from tests.sensors.sailing import turning_dive

Array = NDArray[np.float64]

EVERY = 10


@pytest.fixture(scope="module")
def run() -> Run:
    """Rows of 10 ms, the log every tenth."""
    return turning_dive(every=EVERY)


def samples(table: pl.DataFrame, name: str) -> tuple[Array, Array]:
    own = table.select("t_s", name).drop_nulls()
    return own["t_s"].to_numpy(), own[name].to_numpy()


def test_a_whole_fraction_of_the_logs_rate_is_in_step_and_any_other_is_not() -> None:
    t = np.arange(0.0, 9.95, 0.1)
    in_step = [Sensor(), Sensor(rate_hz=10.0), Sensor(rate_hz=5.0), Sensor(rate_hz=10.0 / 3.0)]
    own = [Sensor(rate_hz=20.0), Sensor(rate_hz=4.0), Sensor(phase_s=0.01), Sensor(jitter_s=0.001)]
    assert not any(asynchronous(sensor, t) for sensor in in_step)
    assert all(asynchronous(sensor, t) for sensor in own)
    assert finer(in_step, t) == 1
    assert finer([*in_step, own[0]], t) == EVERY


def test_every_sensor_has_its_own_stamps_and_rows_have_no_other_cells(run: Run) -> None:
    sensors = {
        "dvl": Sensor(rate_hz=5.0, phase_s=0.03),
        "gyro": Sensor(rate_hz=25.0),
        "depth": Sensor(rate_hz=5.0),
    }
    table = measure(run, sensors, seed=1, every=EVERY)
    np.testing.assert_allclose(samples(table, "u_m_s")[0], 0.03 + 0.2 * np.arange(600), atol=1e-9)
    np.testing.assert_allclose(samples(table, "r_deg_s")[0], 0.04 * np.arange(2998), atol=1e-9)
    np.testing.assert_allclose(samples(table, "z_m")[0], 0.2 * np.arange(600), atol=1e-9)
    stamps = np.concatenate([samples(table, name)[0] for name in ("u_m_s", "r_deg_s", "z_m")])
    np.testing.assert_array_equal(table["t_s"].to_numpy(), np.unique(stamps))
    for names in (("u_m_s", "v_m_s", "w_m_s"), ("p_deg_s", "q_deg_s", "r_deg_s")):
        empty = [table[name].is_null() for name in names]
        assert empty[0].equals(empty[1])
        assert empty[0].equals(empty[2])


def test_a_perfect_sensor_with_its_own_stamps_shows_the_truth_at_them(run: Run) -> None:
    t, u = samples(measure(run, {"dvl": Sensor(rate_hz=7.0, phase_s=0.013)}, seed=1, every=EVERY), "u_m_s")
    truth = np.interp(t, run.t, np.asarray(run.nu)[:, 0])
    # Six digits of the value, and of the stamp while u changes by 0.6 m/s in a second.
    np.testing.assert_allclose(u, truth, atol=1e-6)


def test_a_stamp_is_late_by_the_latency(run: Run) -> None:
    sensor = Sensor(rate_hz=5.0, phase_s=0.05, latency_s=0.23)
    t, yaw = samples(measure(run, {"attitude": sensor}, seed=1, every=EVERY), "yaw_deg")
    later = t > 0.23
    euler = np.rad2deg(np.unwrap(np.asarray(run.euler)[:, 2]))
    expected = np.interp(t[later] - 0.23, run.t, euler)
    # Quaternions and angles are not the same between rows, 10 ms and a few 0.01 deg apart.
    np.testing.assert_allclose(np.unwrap(yaw[later], period=360.0), expected, atol=1e-4)


def test_jitter_has_the_stated_deviation_and_is_the_stamps_alone(run: Run) -> None:
    regular = 0.05 + 0.2 * np.arange(600)
    steady = Sensor(rate_hz=5.0, phase_s=0.05)
    shaky = Sensor(rate_hz=5.0, phase_s=0.05, jitter_s=0.01)
    t, u = samples(measure(run, {"dvl": shaky}, seed=4, every=EVERY), "u_m_s")
    # 600 stamps: the deviation is known to 2.9 %, the mean to 0.4 ms (one standard deviation each).
    assert abs((t - regular).std() / 0.01 - 1.0) < 0.12
    assert abs((t - regular).mean()) < 0.0017
    # What is sampled is sampled on time; only its stamp is wrong.
    np.testing.assert_array_equal(u, samples(measure(run, {"dvl": steady}, seed=4, every=EVERY), "u_m_s")[1])


def test_stamps_keep_their_order_whatever_the_jitter(run: Run) -> None:
    table = measure(run, {"dvl": Sensor(rate_hz=5.0, jitter_s=1.0)}, seed=1, every=EVERY)
    t = samples(table, "u_m_s")[0]
    assert (np.diff(t) > 0.0).all()
    assert t[0] >= 0.0
    assert t[-1] <= float(run.t[-1])


def test_jitter_and_drop_outs_change_no_noise(run: Run) -> None:
    plain = Sensor(noise=0.1, rate_hz=5.0, phase_s=0.05)
    lossy = Sensor(noise=0.1, rate_hz=5.0, phase_s=0.05, dropout_every_s=5.0, dropout_s=2.0)
    whole = measure(run, {"gyro": plain}, seed=2, every=EVERY)
    t, r = samples(measure(run, {"gyro": lossy}, seed=2, every=EVERY), "r_deg_s")
    assert 0.3 < len(t) / whole.height < 0.95
    kept = np.isin(whole["t_s"].to_numpy(), t)
    np.testing.assert_array_equal(whole["r_deg_s"].to_numpy()[kept], r)


def test_adding_a_sensor_leaves_the_others_samples_whether_in_step_or_not(run: Run) -> None:
    coarse = turning_dive()
    depth = {"depth": Sensor(noise=0.02, bias=0.1, latency_s=0.25)}
    gyro = {"gyro": Sensor(noise=0.1, rate_hz=30.0)}
    alone = samples(measure(coarse, depth, seed=5), "z_m")
    both = measure(run, gyro | depth, seed=5, every=EVERY)
    np.testing.assert_array_equal(alone, samples(both, "z_m"))
    np.testing.assert_array_equal(
        samples(both, "p_deg_s"), samples(measure(run, gyro, seed=5, every=EVERY), "p_deg_s")
    )


def test_the_seed_makes_the_log(run: Run) -> None:
    sensors = {
        "dvl": Sensor(noise=0.01, jitter_s=0.01, rate_hz=5.0, dropout_every_s=20.0, dropout_s=1.0),
        "depth": Sensor(noise=0.01, bias=0.1),
    }
    first, again, other = (measure(run, sensors, seed=seed, every=EVERY) for seed in (3, 3, 4))
    assert first.equals(again)
    assert not first["t_s"].equals(other["t_s"])


def test_inputs_stand_at_the_times_of_the_log(run: Run) -> None:
    command = np.arange(1200.0)
    table = measure(
        run, {"dvl": Sensor(rate_hz=5.0, phase_s=0.03)}, seed=1, inputs={"cmd.a": command}, every=EVERY
    )
    t, y = samples(table, "cmd.a")
    np.testing.assert_allclose(t, 0.1 * np.arange(1200), atol=1e-9)
    np.testing.assert_array_equal(y, command)
    assert table.height == 1200 + 600


def test_a_finer_run_is_the_same_motion() -> None:
    t = np.array([0.0, 0.5, 1.0])
    np.testing.assert_allclose(times(t, 5), np.linspace(0.0, 1.0, 11))
    np.testing.assert_array_equal(held([1.0, 2.0, 3.0], 2), [1.0, 1.0, 2.0, 2.0, 3.0])
    np.testing.assert_allclose(linear([[0.0], [2.0], [4.0]], 2)[:, 0], [0.0, 1.0, 2.0, 3.0, 4.0])
    coarse, fine = turning_dive(), turning_dive(every=EVERY)
    # Both are integrated in steps of 10 ms: the same numbers but for the rounding of the times.
    np.testing.assert_allclose(np.asarray(fine.nu)[::EVERY], np.asarray(coarse.nu), atol=1e-9)
