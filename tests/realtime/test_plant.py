"""The stepped vehicle: steps equal a run, and an accelerometer feels what it should."""

from __future__ import annotations

import numpy as np
import pytest

import seatrial as st
from seatrial.base.errors import SimulationError
from seatrial.realtime.plant import Motion, Plant, Shown
from seatrial.sensors.sensor import Sensor

VEHICLE = st.Vehicle.load("cwolf")
AHEAD = {"SbU": 900.0, "SbL": 900.0, "PU": 1000.0, "PL": 1000.0}


def test_law_steps_equal_one_run() -> None:
    plant = Plant(VEHICLE, initial=st.State([0.0, 0.0, 5.0]), current=(0.1, 0.2, 0.0))
    for _ in range(100):
        motion = plant.advance(AHEAD, 0.02)
    t = np.linspace(0.0, 2.0, 101)
    run = VEHICLE.simulate(t, AHEAD, st.State([0.0, 0.0, 5.0]), current=(0.1, 0.2, 0.0))
    np.testing.assert_allclose(motion.nu, run.nu[-1], rtol=0, atol=1e-12)
    np.testing.assert_allclose(motion.position, run.position[-1], rtol=0, atol=1e-12)
    assert motion.t_s == pytest.approx(2.0)


def test_law_specific_force_is_the_derivative_of_the_velocity_less_gravity() -> None:
    """By differences of the velocity in the earth frame: central, 1 ms apart, so 1e-5 of it is left."""
    arm = np.array([0.3, -0.1, 0.2])
    start = st.State([0, 0, 5], [0.2, -0.3, 1.0], [1.0, 0.2, -0.1, 0.3, -0.2, 0.4])
    plant = Plant(VEHICLE, initial=start, imu_position_m=arm)
    h, seen = 1e-3, []
    for _ in range(41):
        seen.append(plant.advance(AHEAD, h))
    from seatrial.base.frames import matrix

    def speed(one: Motion) -> np.ndarray:
        return np.asarray(matrix(one.attitude) @ (one.nu[:3] + np.cross(one.nu[3:], arm)))

    middle = seen[30]
    acceleration = (speed(seen[31]) - speed(seen[29])) / (2 * h)
    expected = matrix(middle.attitude).T @ (acceleration - np.array([0.0, 0.0, 9.81]))
    np.testing.assert_allclose(middle.specific_force, expected, rtol=0, atol=2e-3)


def test_at_rest_and_level_it_feels_gravity_upwards() -> None:
    neutral = VEHICLE.with_coefficients({"B": VEHICLE.coefficients()["m"] * 9.81})
    motion = Plant(neutral).motion
    np.testing.assert_allclose(motion.specific_force, [0.0, 0.0, -9.81], atol=1e-9)
    heeled = Plant(neutral, initial=st.State(attitude=[np.pi / 2, 0.0, 0.0])).motion
    assert heeled.specific_force[1] == pytest.approx(-9.81, abs=0.5)


def test_reset_begins_anew_and_a_missing_voltage_is_named() -> None:
    plant = Plant(VEHICLE)
    first = plant.advance(AHEAD, 0.1)
    plant.advance(AHEAD, 0.1)
    plant.reset()
    again = plant.advance(AHEAD, 0.1)
    assert (again.nu == first.nu).all()
    assert again.t_s == first.t_s
    with pytest.raises(
        SimulationError, match=r"voltage_v: the thrust of thruster_1 .*give it .*, 10 to 20 V"
    ):
        Plant(st.Vehicle.load("bluerov2-heavy"))


def _motion(t: float) -> Motion:
    return Motion(
        t, np.array([t, 0, 0]), np.array([1.0, 0, 0, 0]), np.array([1.0, 0, 0, t, 0, 0]), np.zeros(3)
    )


def test_sensors_are_late_hold_their_samples_and_repeat_by_seed() -> None:
    late = Shown({"position": Sensor(latency_s=0.5), "gyro": Sensor(rate_hz=2.0)})
    seen = [late.measure(_motion(0.1 * k)) for k in range(20)]
    assert seen[15].position[0] == pytest.approx(1.0)
    assert {round(float(one.nu[3]), 6) for one in seen} == {0.0, 0.5, 1.0, 1.5}
    noisy = {"gyro": Sensor(noise=1.0, bias=2.0), "depth": Sensor(quantum=0.25)}
    first, second, third = (
        [float(shown.measure(_motion(0.1 * k)).nu[3]) for k in range(400)]
        for shown in (Shown(noisy, 1), Shown(noisy, 1), Shown(noisy, 2))
    )
    assert first == second != third
    errors = np.array(first) - 0.1 * np.arange(400)
    assert np.std(errors) == pytest.approx(np.deg2rad(1.0), rel=0.15)  # four deviations of 400 samples
