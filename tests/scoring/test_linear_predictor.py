"""A regression on the past of a log foretells what a linear system does, and nothing of what comes new."""

from __future__ import annotations

import numpy as np

from seatrial.scoring.baselines import predicted_from_past
from seatrial.trial.trial import Trial

AHEAD = 5


def log(seed: int, kick: float) -> Trial:
    """An oscillation of 6 s in sway, kept up by kicks, and a yaw rate that follows the rudder by 2 s."""
    generator = np.random.default_rng(seed)
    t = 0.1 * np.arange(3000)
    v, r, rudder = np.zeros(3000), np.zeros(3000), np.zeros(3000)
    for k in range(2, 3000):
        v[k] = 1.989 * v[k - 1] - v[k - 2] * 0.9999 + kick * generator.normal()
        rudder[k] = rudder[k - 1] if k % 40 else generator.uniform(-0.2, 0.2)
        r[k] = r[k - 1] + 0.05 * (rudder[k - 1] - r[k - 1])
    v[:2] = 1.0
    r += 1e-4 * generator.normal(size=3000)
    table = {"t_s": t, "v_m_s": v / v.std(), "r_deg_s": np.degrees(r), "cmd.rudder": rudder}
    return Trial.read(table, align=False, name="log")


def error(trial: Trial, channel: str) -> float:
    """Mean square error over the variance on the last third, learnt from the rest."""
    learnt = np.arange(3000) < 2000
    (found,) = predicted_from_past([trial], [learnt], [channel], AHEAD)
    y = trial.filled(channel)
    assert y is not None
    return float(np.mean((found[~learnt, 0] - y[~learnt]) ** 2) / y[~learnt].var())


def test_a_regular_wave_and_the_answer_to_a_command_are_foretold() -> None:
    trial = log(1, 1e-6)
    assert error(trial, "v") < 0.01
    # Steps of the rudder within the half second ahead are news.
    assert error(trial, "r") < 0.05
    y = trial.filled("r")
    assert y is not None
    assert np.mean((y[2000:] - y[1995:-5]) ** 2) / y[2000:].var() > 2.0 * error(trial, "r")


def test_nothing_is_foretold_from_too_little() -> None:
    trial = log(2, 1e-3)
    (found,) = predicted_from_past([trial], [np.arange(3000) < 50], ["r"], AHEAD)
    assert np.isnan(found).all()
    (found,) = predicted_from_past([trial], [np.arange(3000) < 2000], ["r", "w"], AHEAD)
    assert np.isfinite(found[100:, 0]).all()
    assert np.isnan(found[:, 1]).all()
    # Nothing after the prediction's own time is used.
    late = log(2, 1e-3)
    late.observed[2500:] = 9.0
    (again,) = predicted_from_past([late], [np.arange(3000) < 2000], ["r"], AHEAD)
    np.testing.assert_array_equal(again[:2505], found[:2505, :1])
