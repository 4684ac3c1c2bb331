"""What `consistency` finds in generated motion with known errors; nothing where there are none."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter

from seatrial.base.channels import DEGREE
from seatrial.base.errors import TrialError
from seatrial.base.frames import from_euler, matrix
from seatrial.inspect.consistency import consistency
from seatrial.inspect.corrections import Consistency, Correction
from seatrial.trial.signals import Series
from tests.inspect.logs import Errors, log


def keys(found: Consistency) -> set[str]:
    return {one.key for one in found.corrections}


def of(found: Consistency, key: str) -> Correction:
    return next(one for one in found.corrections if one.key == key)


@cache
def several() -> Consistency:
    """One log with most of the errors that a real one has at once."""
    return consistency(
        log(
            1,
            Errors(
                velocity_late=0.2,
                rates_late=0.05,
                tilt=(0.0, 2.0 * DEGREE, 0.0),
                heading=-20.0 * DEGREE,
                signs={"q": -1.0},
                velocity_scale=1000.0,
                arm=(0.5, 0.0, 0.3),
            ),
        )
    )


def test_an_unknown_channel_is_refused() -> None:
    t = np.arange(10.0)
    with pytest.raises(TrialError, match="no channel"):
        consistency({"yav": Series(t, t)})


def test_stamps_that_do_not_rise_are_refused() -> None:
    t = np.array([0.0, 2.0, 1.0])
    with pytest.raises(TrialError, match="rising"):
        consistency({"yaw": Series(t, t)})


def test_missing_roll_and_rates_are_said_with_what_they_cost() -> None:
    t = np.arange(100.0)
    said = consistency({name: Series(t, 0.0 * t) for name in ("pitch", "yaw", "z", "u", "v", "w")}).missing
    assert any("no roll" in one and "K_*" in one for one in said)
    assert any("no p q r" in one for one in said)


def test_few_samples_are_not_called_missing() -> None:
    t = 0.1 * np.arange(30.0)
    names = ("roll", "pitch", "yaw", "p", "q", "r", "u", "v", "w", "z")
    said = consistency({name: Series(t, np.sin(t)) for name in names}).missing
    assert said[0].startswith("fewer than 50 samples of roll, pitch, yaw, p, q, r, u, v, w, z:")
    assert not any(
        one.startswith(("no attitude", "no p q r", "no depth", "no velocity over")) for one in said
    )


@pytest.mark.long
@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("without", ["", "xy", "pqr"])
def test_nothing_is_proposed_for_sensors_without_errors(seed: int, without: str) -> None:
    series = {name: one for name, one in log(seed).items() if name not in without}
    assert consistency(series).corrections == ()


def test_law_several_errors_at_once_are_told_apart() -> None:
    assert keys(several()) == {
        "delay_s.velocity",
        "delay_s.rates",
        "tilt_deg.velocity",
        "heading_deg",
        "signs.q",
        "scale.velocity",
        "velocity_m",
    }


@pytest.mark.parametrize(
    ("key", "truth"),
    [
        ("delay_s.velocity", 0.2),
        ("delay_s.rates", 0.05),
        ("heading_deg", -20.0),
        ("tilt_deg.velocity", (0.0, 2.0, 0.0)),
        ("velocity_m", (0.5, 0.0, 0.3)),
    ],
)
def test_law_values_lie_within_four_deviations_of_the_truth(
    key: str, truth: float | tuple[float, ...]
) -> None:
    found = of(several(), key)
    error, sd = np.abs(np.subtract(found.value, truth)), np.asarray(found.sd)
    assert np.all(error <= 4.0 * sd + 5e-4)  # 5e-4: values are rounded for a file


def test_a_vehicle_at_rest_tells_no_correction() -> None:
    t = np.arange(0.0, 60.0, 0.1)
    names = ("x", "y", "z", "u", "v", "w", "p", "q", "r", "roll", "pitch", "yaw")
    found = consistency({name: Series(t, 0.0 * t) for name in names})
    assert found.corrections == ()


def test_a_unit_is_recognised_by_its_size() -> None:
    assert of(several(), "scale.velocity").value == 1e-3
    assert "mm/s" in of(several(), "scale.velocity").sentence
    assert of(consistency(log(2, Errors(rates_scale=1.0 / DEGREE))), "scale.rates").value == pytest.approx(
        DEGREE
    )


def test_exchanged_axes_are_named() -> None:
    found = consistency(log(3, Errors(axes={"p": "q", "q": "p"}, signs={"p": -1.0})))
    assert {one.key: one.value for one in found.corrections} == {"axes.p": "-q", "axes.q": "p"}


def test_reversed_velocities_are_named() -> None:
    assert keys(consistency(log(3, Errors(signs={"v": -1.0, "w": -1.0})))) == {"signs.v", "signs.w"}


def test_the_bias_of_a_gyro_is_told() -> None:
    found = consistency(log(4, Errors(rates_bias=(0.01, 0.0, 0.0))))
    assert keys(found) == {"bias.p_deg_s"}
    assert of(found, "bias.p_deg_s").value == pytest.approx(0.01 / DEGREE, abs=0.03)  # five deviations


def test_law_offset_and_drift_of_another_clock_are_told_as_sum_with_the_delay() -> None:
    errors = Errors(offset=12.3, drift=200e-6, velocity_late=0.1)
    found = consistency(log(5, errors, 600.0))
    assert keys(found) == {"dvl.offset_s", "dvl.drift"}
    assert all(one.table == "clocks" for one in found.corrections)
    offset, drift = of(found, "dvl.offset_s"), of(found, "dvl.drift")
    assert abs(offset.value - 12.4) < 4.0 * offset.sd
    assert abs(drift.value - 200e-6) < 4.0 * drift.sd
    assert "sum" in offset.sentence


def test_law_a_turned_sensor_is_told_from_a_turned_heading() -> None:
    found = consistency(log(6, Errors(tilt=(0.0, 0.0, 5.0 * DEGREE))))
    assert keys(found) == {"tilt_deg.velocity"}  # it shows sway on straight legs
    assert of(found, "tilt_deg.velocity").value[2] == pytest.approx(5.0, abs=0.2)


def test_law_the_tilt_is_found_from_the_depth_alone() -> None:
    series = log(7, Errors(tilt=(0.0, 2.0 * DEGREE, 0.0)))
    found = consistency({name: one for name, one in series.items() if name not in ("x", "y", "roll", "p")})
    tilt = of(found, "tilt_deg.velocity")
    assert abs(tilt.value[1] - 2.0) < 4.0 * tilt.sd[1]


def test_law_the_sign_of_the_vertical_velocity_is_found_from_the_depth_alone() -> None:
    series = log(8, Errors(signs={"w": -1.0}))
    found = consistency({name: one for name, one in series.items() if name not in ("x", "y")})
    assert keys(found) == {"signs.w"}


def test_law_a_delay_that_noise_hides_has_a_large_deviation() -> None:
    random = np.random.default_rng(9)
    series = log(9)
    for name, size in (("w", 0.3), ("u", 0.3)):  # three times the motion
        one = series[name]
        series[name] = Series(one.t, one.value + size * random.standard_normal(len(one.t)), one.clock)
    found = consistency({name: one for name, one in series.items() if name not in ("x", "y")})
    assert "delay_s.velocity" not in keys(found)


def noisy(seed: int, size: float, errors: Errors, without: str = "") -> dict[str, Series]:
    """A log with so much noise of u and w, m/s."""
    random = np.random.default_rng(1000 + seed)
    series = {name: one for name, one in log(seed, errors).items() if name not in without}
    for name in "uw":
        one = series[name]
        value = one.value + size * random.standard_normal(len(one.t))
        series[name] = Series(one.t, value, one.clock)
    return series


@pytest.mark.parametrize("seed", [0, 1, 4])
def test_law_an_offset_is_told_within_its_deviation_or_not_at_all(seed: int) -> None:
    """The depth alone, with noise as large as its rate: without the refusal seeds are off by seconds."""
    found = consistency(noisy(seed, 0.2, Errors(offset=12.3, velocity_late=0.1), "xypqr"))
    for one in found.corrections:
        if one.key == "dvl.offset_s":
            assert abs(one.value - 12.4) < 3.0 * one.sd
    refused = any("fit alike" in said or "too uncertain" in said for said in found.missing)
    assert refused != ("dvl.offset_s" in keys(found))


def test_law_the_noise_of_the_velocity_is_in_the_deviation_of_its_scale() -> None:
    found = of(consistency(noisy(4, 0.05, Errors(velocity_scale=1.0 / 1.1))), "scale.velocity")
    assert abs(found.value - 1.1) < 2.5 * found.sd
    assert 1e-3 < found.sd < 5e-3  # blocks of the whitened residual alone said less than a thousandth


def test_law_a_slow_position_leaves_the_delay_to_the_depth() -> None:
    series = log(10, Errors(velocity_late=0.3, heading=15.0 * DEGREE), 600.0)
    random = np.random.default_rng(10)
    for name in "xy":  # of a second each, with a noise of 0.3 m
        one = series[name]
        value = one.value + 0.3 * random.standard_normal(len(one.t))
        series[name] = Series(one.t[::5], value[::5], one.clock)
    found = consistency(series)
    assert keys(found) == {"delay_s.velocity", "heading_deg"}
    delay = of(found, "delay_s.velocity")
    assert abs(delay.value - 0.3) < 4.0 * delay.sd
    assert of(found, "heading_deg").value == pytest.approx(15.0, abs=0.5)


def test_law_a_current_is_the_difference_of_both_velocities() -> None:
    series = log(11, length_s=600.0)
    t = series["u"].t
    yaw = np.interp(t, series["yaw"].t, np.unwrap(series["yaw"].value))
    pitch = np.interp(t, series["pitch"].t, series["pitch"].value)
    roll = np.interp(t, series["roll"].t, series["roll"].value)
    north = 0.1 + 0.1 * t / t[-1]
    turned = matrix(from_euler(np.stack([roll, pitch, yaw], axis=1)))
    c = np.einsum("nji,nj->ni", turned, np.stack([north, 0.0 * t, 0.0 * t], axis=1))
    water = {f"{n}_water": Series(t, series[n].value - c[:, k], "ahrs") for k, n in enumerate("uvw")}
    current = consistency(series | water).current
    assert current is not None
    known = np.stack([np.interp(current.t, t, north), 0.0 * current.t], axis=1)
    assert np.sqrt(np.mean((current.velocity - known) ** 2)) < 0.01


def test_law_a_current_is_told_by_legs_at_a_held_thrust() -> None:
    t = np.arange(0.0, 480.0)
    yaw = np.cumsum(np.where(t % 60.0 < 15.0, 0.5 * np.pi / 15.0, 0.0))
    thrust = np.where(t < 240.0, 40.0, 10.0)  # a quarter of the thrust, half the speed
    north, east = 0.1, -0.2
    noise = 3e-3 * np.random.default_rng(1).standard_normal((2, len(t)))
    u = 0.25 * np.sqrt(thrust) + north * np.cos(yaw) + east * np.sin(yaw) + noise[0]
    v = -north * np.sin(yaw) + east * np.cos(yaw) + noise[1]
    motion = {"u": u, "v": v, "yaw": yaw, "pitch": 0.0 * t, "tau.X_n": thrust, "tau.Y_n": 0.0 * t}
    found = consistency({name: Series(t, value) for name, value in motion.items()}).current
    assert found is not None
    assert found.source == "legs and turns at held thrust"
    assert found.velocity.mean(axis=0) == pytest.approx([north, east], abs=0.02)


def test_a_start_from_rest_is_not_taken_for_a_current() -> None:
    t = np.arange(0.0, 600.0)
    yaw = np.cumsum(np.where(t % 60.0 < 15.0, 0.5 * np.pi / 15.0, 0.0))
    north, east = 0.1, -0.2
    noise = 1e-2 * np.random.default_rng(1).standard_normal((2, len(t)))
    u = 1.7 * (1.0 - np.exp(-t / 8.0)) + north * np.cos(yaw) + east * np.sin(yaw) + noise[0]
    v = -north * np.sin(yaw) + east * np.cos(yaw) + noise[1]
    found = consistency({n: Series(t, x) for n, x in {"u": u, "v": v, "yaw": yaw, "pitch": 0.0 * t}.items()})
    assert found.current is not None
    assert np.abs(found.current.velocity - [north, east]).max() < 0.02


def test_a_current_is_told_where_an_autopilot_answers_waves_with_the_propeller() -> None:
    t = np.arange(0.0, 600.0, 0.5)
    course = np.cumsum(np.where(t % 60.0 < 15.0, 0.25 * np.pi / 15.0, 0.0))
    yaw = course + 0.06 * np.sin(2.0 * np.pi * t / 7.0)  # 3 deg/s
    north, east = 0.1, -0.2
    along = north * np.cos(course) + east * np.sin(course)
    # A speed control over ground: the speed over ground tells nothing, the propeller does.
    rpm = 1000.0 * (1.7 - along) * (1.0 + 0.2 * np.sin(2.0 * np.pi * t / 7.0))
    speed = lfilter([1.0 - np.exp(-0.5 / 6.0)], [1.0, -np.exp(-0.5 / 6.0)], rpm - rpm[0])
    noise = 1e-2 * np.random.default_rng(2).standard_normal((2, len(t)))
    motion = {
        "u": 1e-3 * (rpm[0] + speed) + along + noise[0],
        "v": -north * np.sin(yaw) + east * np.cos(yaw) + noise[1],
        "yaw": yaw,
        "pitch": 0.0 * t,
        "cmd.plane": np.full(len(t), -0.2) + 0.05 * np.sin(t),  # never at rest, never near zero
        "cmd.propeller": rpm,
        "cmd.rudder": 0.1 * np.sin(2.0 * np.pi * t / 7.0),
    }
    found = consistency({name: Series(t, value) for name, value in motion.items()}).current
    assert found is not None
    assert found.source == "legs, turns and the command of propeller"
    assert np.abs(found.velocity - [north, east]).max() < 0.03


def test_the_report_says_what_to_paste() -> None:
    text = several().report().text()
    assert "scale.velocity = 0.001" in text
    assert several().to_dict()["corrections"][0]["before"] > 0.0


def test_a_velocity_that_no_correction_brings_to_the_depth_is_a_contradiction() -> None:
    def found(tilt: float) -> Consistency:
        given = log(2, Errors(tilt=(0.0, tilt * DEGREE, 0.0)))
        return consistency({name: one for name, one in given.items() if name not in ("x", "y")})

    assert not found(0.0).contradictions
    wrong = found(80.0)
    (said,) = wrong.contradictions
    _, before, after = next(one for one in wrong.compared if "depth" in one[0])
    assert said.startswith("rate of depth and the velocity contradict one another")
    assert f"{after:.3g} m/s rms with the best correction ({before:.3g} m/s as recorded)" in said
    # A sensor that looks down shows the forward speed, 1.3 m/s, as a rate of depth.
    assert min(before, after) > 1.0


def test_a_stuck_pitch_is_a_contradiction_and_proposes_no_tilt() -> None:
    given = {name: one for name, one in log(7).items() if name not in ("x", "y")}
    stuck = Series(given["pitch"].t, np.full_like(given["pitch"].t, 0.1), given["pitch"].clock)
    found = consistency(given | {"pitch": stuck})
    assert any(said.startswith("pitch stays at 0.1 rad") for said in found.contradictions)
    assert "tilt_deg.velocity" not in keys(found)
