"""No rule relies on a limit cycle that is short of samples, off the crossover, ragged or one-sided."""

from __future__ import annotations

from dataclasses import replace

import pytest

from seatrial.tuning.relay_trial import Cycle, doubt, scatters

PERIOD_S = 0.1
SOUND = Cycle(
    period_s=4.0,
    period_scatter=0.02,
    amplitude=0.1,
    amplitude_scatter=0.03,
    ultimate_gain=300.0,
    phase_deg=1.0,
    duty=0.45,
    cycles=12,
)


def test_a_sound_cycle_is_relied_on() -> None:
    assert doubt(SOUND, PERIOD_S) == ""
    assert not scatters(SOUND)


@pytest.mark.parametrize(
    ("number", "within", "beyond", "why"),
    [
        ("period_s", 0.61, 0.59, "a cycle of 0.59 s is that of the sampling every 0.1 s"),
        ("phase_deg", 7.9, 8.6, "the first harmonics are 9 deg from the phase crossover"),
        ("phase_deg", -7.9, -8.6, "the first harmonics are 9 deg from the phase crossover"),
        ("period_scatter", 0.149, 0.16, "the cycles scatter by 16 %"),
        ("amplitude_scatter", 0.149, 0.16, "the cycles scatter by 16 %"),
        ("duty", 0.849, 0.87, "the relay stays on one side for 87 % of the time"),
        ("duty", 0.151, 0.13, "the relay stays on one side for 87 % of the time"),
    ],
)
def test_a_cycle_beyond_one_limit_alone_is_not(number: str, within: float, beyond: float, why: str) -> None:
    values = {name: getattr(SOUND, name) for name in vars(SOUND)}
    assert doubt(Cycle(**values | {number: within}), PERIOD_S) == ""
    assert doubt(Cycle(**values | {number: beyond}), PERIOD_S) == why


def test_the_limit_of_the_samples_goes_with_the_control_period() -> None:
    assert doubt(replace(SOUND, period_s=2.0), 0.3) == ""
    assert doubt(replace(SOUND, period_s=2.0), 0.35) == "a cycle of 2 s is that of the sampling every 0.35 s"
