"""Waves are told from what a busy mission does by itself: turns, depth steps and own periods."""

from __future__ import annotations

from pathlib import Path

import pytest

from seatrial.inspect.waves import Waves, waves
from seatrial.trial.generated import Recipe
from seatrial.trial.trial import Trial

TRUTH = """format = 1
vehicle = "remus100"
description = "a torpedo"
[sensors.dvl]
noise_m_s = 0.01
rate_hz = 5.0
latency_s = 0.12
jitter_s = 0.01
[sensors.gyro]
noise_deg_s = 0.05
[sensors.attitude]
noise_deg = 0.1
[sensors.depth]
noise_m = 0.01
"""

LEG = "[[legs]]\nnorth_m = {:.0f}\neast_m = {:.0f}\ndepth_m = {:.0f}\n"

MISSION = """format = 1
name = "survey"
speed_m_s = 1.7
acceptance_radius_m = 8.0
[start]
depth_m = 5.0
""" + "".join(
    LEG.format(100.0, 60.0 * k, 5.0 + 2.0 * (k % 3))
    + LEG.format(200.0 * (1 - k % 2), 60.0 * k, 9.0 - 2.0 * (k % 3))
    + LEG.format(200.0 * (1 - k % 2), 60.0 * (k + 1), 7.0)
    for k in range(4)
)

RECIPE = """format = 1
description = "survey"
truth = "truth.toml"
seed = 1
duration_s = 600.0
[sailed]
autopilot = "remus100"
mission = "mission.toml"
[current]
north_m_s = 0.1
end_east_m_s = 0.35
"""


def seen(folder: Path, seed: int, sea: str) -> Waves | None:
    for name, text in (("truth", TRUTH), ("mission", MISSION), ("field", RECIPE + sea)):
        (folder / f"{name}.toml").write_text(text)
    return waves(Trial.read(Recipe.load(folder / "field.toml").with_seed(seed).table(), align=False))


@pytest.mark.parametrize(("period", "height"), [(5.2, 0.5), (8.5, 0.4), (11.0, 0.4), (14.0, 0.4)])
def test_seas_of_any_period_are_seen_under_turns_and_depth_steps(
    tmp_path: Path, period: float, height: float
) -> None:
    sea = f"[waves]\nheight_m = {height}\nperiod_s = {period}\ntoward_deg = 70.0\n"
    found = seen(tmp_path, 3, sea)
    assert found is not None
    # The energy of such a sea has its centroid at 0.83 of the peak period, at depth nearer to it.
    assert 0.65 * period < found.period_s < 1.15 * period
    assert 0.015 < found.amplitude["w"] < 0.1


@pytest.mark.parametrize("seed", range(3))
def test_a_busy_mission_in_calm_water_shows_no_waves(tmp_path: Path, seed: int) -> None:
    assert seen(tmp_path, seed, "") is None
