"""Signs and axes of sensors: what leaks, hardly moves or tumbles is no sign; what is reversed is one."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from seatrial.base.arrays import Array
from seatrial.base.channels import DEGREE
from seatrial.base.frames import from_euler, matrix, to_euler
from seatrial.base.frames import product as turned
from seatrial.inspect.consistency import consistency
from seatrial.inspect.corrections import Consistency
from seatrial.trial.kinematic_axes import at_end, implausible_side, pressure_of
from seatrial.trial.signals import Series
from seatrial.trial.trial import Trial
from tests.inspect.logs import Errors, log
from tests.trial import motion

T = np.arange(0.0, 60.0, 0.1)


def turning(list_deg: float, askew_deg: float, noise_deg_s: float = 0.0) -> dict[str, Array]:
    """A level vehicle that only turns, to and fro; the gyro is mounted askew about the bow."""
    random = np.random.default_rng(1)
    rate = 20.0 * np.tanh(4.0 * np.sin(2.0 * np.pi * T / 14.0)) + 3.0 * np.sin(2.0 * np.pi * T / 3.0)
    yaw = np.concatenate([[0.0], np.cumsum(0.05 * (rate[1:] + rate[:-1]))])
    roll, askew = list_deg * DEGREE, askew_deg * DEGREE
    rates = np.stack([0.0 * T, rate * np.sin(roll), rate * np.cos(roll)], axis=1)
    shown = rates @ matrix(from_euler([askew, 0.0, 0.0])) + noise_deg_s * random.standard_normal((len(T), 3))
    names = ("p_deg_s", "q_deg_s", "r_deg_s")
    angles = {"roll_deg": list_deg + 0.0 * T, "pitch_deg": 0.0 * T, "yaw_deg": (yaw + 180.0) % 360.0 - 180.0}
    return {"t_s": T, **angles, **dict(zip(names, shown.T, strict=True))}


@pytest.mark.parametrize(
    # The third leaks exactly minus what the attitude shows: gain -1, correlation -1.
    ("list_deg", "askew_deg"), [(0.05, 0.1), (0.05, -0.1), (0.5, 1.0), (-0.3, -2.0), (2.0, 4.0)],
)  # fmt: skip
@pytest.mark.parametrize("noise", [0.0, 0.005, 0.1])
def test_law_what_leaks_from_another_axis_is_no_sign(list_deg: float, askew_deg: float, noise: float) -> None:
    report = str(Trial.read(turning(list_deg, askew_deg, noise)).report)
    assert "reversed" not in report
    assert "opposite" not in report


@pytest.mark.parametrize("channels", ["p", "q", "r", "pq", "pr", "pqr", "u", "v", "w", "uw", "uvw"])
def test_law_what_moves_clearly_and_runs_against_the_pose_is_reversed(channels: str) -> None:
    table = motion.columns(T, velocity_late=0.1, rates_late=0.05, noise=2e-3)
    for channel in channels:
        name = f"{channel}_{'deg_s' if channel in 'pqr' else 'm_s'}"
        table[name] = -table[name]
    found = Trial.read(table).report.findings
    reversed_ = [one for one in found if "sign reversed" in one.message]
    assert {one.subject for one in reversed_} == set(channels)
    for one in reversed_:  # gain, lag and what the sign explains
        assert "gain -" in one.message
        assert "% explained" in one.message
        assert "lag 0." in one.message


def test_a_half_turn_of_the_gyro_is_its_own_where_the_velocity_agrees_with_the_attitude() -> None:
    table = motion.columns(T, noise=2e-3)
    table |= {name: -table[name] for name in ("q_deg_s", "r_deg_s")}  # forward, port, up
    found = Trial.read(table).report.findings
    assert {one.subject for one in found if "sign reversed" in one.message} == {"q", "r"}


def test_motion_at_the_noise_tells_no_sign() -> None:
    table = motion.columns(T, noise=2e-3)
    random = np.random.default_rng(3)
    size = 0.05  # deg/s: the vehicle lies still, and the attitude has the noise of its own
    table |= {name: size * random.standard_normal(len(T)) for name in ("p_deg_s", "q_deg_s", "r_deg_s")}
    rates = np.stack([table[name] for name in ("p_deg_s", "q_deg_s", "r_deg_s")], axis=1)
    angles = np.cumsum(-rates * DEGREE * 0.1, axis=0)  # opposed, every sample of it
    q = from_euler(angles)
    table |= dict(zip(("q_w", "q_x", "q_y", "q_z"), q.T, strict=True))
    assert "reversed" not in str(Trial.read(table, columns={}).report)


def tumbling(reversed_: str = "") -> Consistency:
    """A vehicle that loops and rolls through pitch 90 deg again and again, gyro and attitude at 50 Hz."""
    t = np.arange(0.0, 60.0, 0.02)
    omega = np.stack(
        [0.3 + 0.4 * np.sin(0.7 * t), 0.8 + 0.3 * np.sin(0.4 * t), 0.5 * np.sin(0.9 * t)], axis=1
    )
    q = np.empty((len(t), 4))
    q[0] = [1.0, 0.0, 0.0, 0.0]
    for k in range(len(t) - 1):
        w = 0.5 * (omega[k] + omega[k + 1])
        angle = float(np.linalg.norm(w)) * 0.01
        q[k + 1] = turned(q[k], [np.cos(angle), *(w / np.linalg.norm(w) * np.sin(angle))])
    angles = to_euler(q)
    assert np.abs(angles[:, 1]).max() > 85.0 * DEGREE
    random = np.random.default_rng(1)
    shown = omega + 0.002 * random.standard_normal(omega.shape)
    series = {name: Series(t, angles[:, k]) for k, name in enumerate(("roll", "pitch", "yaw"))}
    signs = {name: -1.0 if name in reversed_ else 1.0 for name in "pqr"}
    series |= {name: Series(t, signs[name] * shown[:, k]) for k, name in enumerate("pqr")}
    return consistency(series)


def test_law_a_tumbling_vehicle_turns_as_its_gyro_says() -> None:
    found = tumbling()
    assert found.corrections == ()
    assert found.contradictions == ()
    (_, before, _), *_ = found.compared
    assert before < 0.01  # rad/s: with roll and yaw one by one it was some rad/s
    assert {one.key for one in tumbling("p").corrections} == {"signs.p"}


def test_an_exchange_that_leaves_an_axis_unexplained_is_none() -> None:
    series = log(3, length_s=100.0)
    random = np.random.default_rng(1)
    r = series["r"]
    lost = Series(r.t, 0.3 * random.standard_normal(len(r.t)), r.clock)
    found = consistency(series | {"p": r, "r": lost})  # the yaw rate as p; p nowhere
    assert not any(one.key.startswith("axes.") for one in found.corrections)
    assert any("no exchange of axes" in said for said in found.contradictions)


def test_a_delay_where_the_search_ends_is_no_estimate() -> None:
    table = motion.columns(T, velocity_late=2.4, noise=2e-3)  # 1 s is searched
    report = Trial.read(table).report
    assert "velocity" not in report.latencies
    assert "lies at the end of the range" in str(report)
    late = consistency(log(5, Errors(rates_late=1.495), 100.0))
    assert not any(one.key == "delay_s.rates" for one in late.corrections)
    for edge, inside in product((-1.0, 1.0), (0.5, 0.9)):
        assert at_end(edge * 0.99, 1.0, 0.05)
        assert not at_end(edge * inside, 1.0, 0.05)


def test_a_ratio_is_blamed_on_the_side_that_no_vehicle_can_have() -> None:
    assert implausible_side(0.3, 2e-6, "velocity") == "reference"
    assert implausible_side(300.0, 0.3, "velocity") == "sensor"
    assert implausible_side(0.3, 0.6, "velocity") == ""
    assert implausible_side(1e-4, 1e-6, "velocity") == "both"
    assert [pressure_of(x) for x in (1e5, 9.7e3, 1.03e3, 3.0)] == ["bar", "dbar", "kPa", None]
