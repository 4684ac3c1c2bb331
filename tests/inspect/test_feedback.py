"""Commands that follow measurements are told from preset ones, with and without waves."""

from __future__ import annotations

import numpy as np
import pytest

from seatrial.inspect.feedback import Feedback, feedback
from seatrial.trial.trial import Trial

DT = 0.1


def sailed(closed: bool, seed: int, waves: float = 0.0, minutes: float = 10.0) -> Trial:
    """Heading of a first-order vehicle under a rudder: PD loop to set points, or steps of the rudder."""
    rng = np.random.default_rng(seed)
    count = round(60.0 * minutes / DT)
    t = DT * np.arange(count)
    yaw, rate, rudder = np.zeros(count), np.zeros(count), np.zeros(count)
    target, step = 0.0, 0.0
    swell = waves * np.sin(2.0 * np.pi * t / 6.0) * (1.0 + 0.3 * np.sin(0.05 * t))
    noise = rng.normal(0.0, 0.004, count)
    for k in range(1, count):
        if k % 300 == 0:
            target += rng.choice([-1.5, 1.5])
        if k % 70 == 0:
            step = rng.uniform(-0.25, 0.25)
        seen = yaw[k - 1] + noise[k - 1]
        rudder[k] = np.clip(0.8 * (target - seen) - 0.4 * rate[k - 1], -0.25, 0.25) if closed else step
        rate[k] = rate[k - 1] + DT * (0.4 * rudder[k - 1] - rate[k - 1] + swell[k - 1]) / 1.2
        yaw[k] = yaw[k - 1] + DT * rate[k]
    frame = {
        "t_s": t,
        "yaw_deg": np.degrees(yaw + noise),
        "r_deg_s": np.degrees(rate + rng.normal(0.0, 0.002, count)),
        "cmd.rudder": rudder,
    }
    return Trial.read(frame, align=False)


def only(trial: Trial) -> Feedback:
    (found,) = feedback(trial)
    return found


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("waves", [0.0, 0.05])
def test_an_autopilot_is_seen_and_steps_of_the_rudder_are_not(seed: int, waves: float) -> None:
    closed, preset = only(sailed(True, seed, waves)), only(sailed(False, seed, waves))
    assert closed.closed
    assert closed.explained > 0.3
    assert not preset.closed
    assert preset.explained < 0.1
    assert preset.channel == ""


def test_gain_and_lag_of_a_proportional_loop() -> None:
    found = only(sailed(True, 1, 0.05))
    assert found.channel == "yaw"
    assert found.gain == pytest.approx(-0.8, rel=0.3)
    assert 0.0 <= found.lag_s <= 0.3


def test_a_command_that_never_changes_says_nothing() -> None:
    t = DT * np.arange(1000)
    trial = Trial.read({"t_s": t, "yaw_deg": np.sin(t), "cmd.rudder": np.zeros(1000)}, align=False)
    assert feedback(trial) == []


def test_a_wrench_that_follows_measurements_is_seen_like_a_command() -> None:
    frame = {"t_s": (closed := sailed(True, 1, minutes=4.0)).t, "yaw_deg": np.degrees(closed.channel("yaw"))}
    trial = Trial.read(frame | {"tau.N_nm": 40.0 * closed.commands["rudder"]}, align=False)
    (found,) = feedback(trial)
    assert (found.command, found.channel) == ("tau.N_nm", "yaw")
    assert found.gain == pytest.approx(-32.0, rel=0.3)
