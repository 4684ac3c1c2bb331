"""A relay under a constant load finds the phase crossover all the same, by a second cycle with a lead."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as draw
from numpy.typing import NDArray

import seatrial as st
from seatrial.tuning.relay_trial import (
    Cycle,
    RelayTrial,
    at_crossover,
    crossover_lead_s,
    relay_cycle,
    relay_trial,
)

Array = NDArray[np.float64]
Plant = tuple[Array, Array, Array]

AUTOPILOT = st.Autopilot.load("examples/cwolf/start_autopilot.toml")
NEUTRAL_N = 135.0 * 9.81
SOUND = Cycle(6.0, 0.01, 0.1, 0.01, 300.0, 6.0, 0.3, 12)


def sampled_plant(period_s: float) -> Plant:
    """1/(s (s + 1) (2 s + 1)) with a hold: matrices of the step, the input and the output."""
    from scipy.signal import cont2discrete, tf2ss

    phi, gamma, seen, *_ = cont2discrete(tf2ss([1.0], [2.0, 3.0, 1.0, 0.0]), period_s)
    return np.asarray(phi), np.asarray(gamma), np.asarray(seen)


def exact_crossover(plant: Plant, period_s: float, late: int) -> tuple[float, float]:
    """Ultimate gain and period by the frequency response of the sampled plant."""
    phi, gamma, seen = plant
    omega = np.geomspace(0.1, 3.0, 4000)
    z = np.exp(1j * omega * period_s)
    inner = np.linalg.solve(z[:, None, None] * np.eye(len(phi)) - phi, gamma.astype(complex))
    response = (seen @ inner)[:, 0, 0] * z**-late
    crossed = np.flatnonzero((np.diff(np.sign(response.imag)) > 0) & (response.real[:-1] < 0.0))
    return 1.0 / float(np.abs(response[crossed[0]])), 2.0 * np.pi / float(omega[crossed[0]])


def cycle_under(plant: Plant, period_s: float, late: int, *, load: float, lead_s: float = 0.0) -> Cycle:
    """Limit cycle of a relay of amplitude 1 that switches by y + lead dy/dt, over 180 s."""
    phi, gamma, seen = plant
    x, before, waiting = np.full((len(phi), 1), 0.01), None, [0.0] * late
    measured, wrench = [], []
    for _ in range(round(300.0 / period_s)):
        y = float((seen @ x)[0, 0])
        rate = 0.0 if before is None else (y - before) / period_s
        before = y
        relay = -1.0 if y + lead_s * rate > 0.0 else 1.0
        measured.append(y)
        wrench.append(relay)
        waiting.append(relay)
        x = phi @ x + gamma * (waiting.pop(0) + load)
    settled = slice(round(120.0 / period_s), None)
    t: Array = period_s * np.arange(len(measured), dtype=float)
    found = relay_cycle(t[settled], np.array(measured)[settled], np.array(wrench)[settled])
    assert found is not None
    return found


@pytest.mark.parametrize(("period_s", "late"), [(0.1, 0), (0.1, 5), (0.2, 2)])
@pytest.mark.parametrize("load", [-0.6, 0.3, 0.5])
def test_law_two_cycles_tell_the_crossover_under_a_load(period_s: float, late: int, load: float) -> None:
    plant = sampled_plant(period_s)
    gain, period = exact_crossover(plant, period_s, late)
    cycle = cycle_under(plant, period_s, late, load=load)
    # What it is for: the first cycle alone is slow and says too little.
    assert cycle.ultimate_gain < 0.92 * gain
    assert cycle.phase_deg > 1.5
    ahead = cycle_under(plant, period_s, late, load=load, lead_s=crossover_lead_s(cycle))
    found = at_crossover(cycle, ahead)
    assert found is not None
    # Logarithms over 5 to 25 deg are not quite straight, and edges fall on samples, a hundredth of a cycle.
    assert found.ultimate_gain == pytest.approx(gain, rel=0.03)
    assert found.period_s == pytest.approx(period, rel=0.02)
    assert found.phase_deg == 0.0


@given(
    phase=draw.floats(2.0, 20.0),
    beyond=draw.floats(-15.0, 0.5),
    steep=draw.floats(0.0, 0.06),
    slow=draw.floats(-0.03, 0.0),
)
def test_law_a_line_of_logarithms_is_found_back(
    phase: float, beyond: float, steep: float, slow: float
) -> None:
    def on_line(at: float) -> Cycle:
        return replace(
            SOUND,
            phase_deg=at,
            ultimate_gain=300.0 * np.exp(-steep * at),
            period_s=6.0 * np.exp(-slow * at),
            amplitude=0.1 * np.exp(steep * at),
        )

    found = at_crossover(on_line(phase), on_line(beyond))
    assert found is not None
    assert found.ultimate_gain == pytest.approx(300.0, rel=1e-9)
    assert found.period_s == pytest.approx(6.0, rel=1e-9)
    assert found.amplitude == pytest.approx(0.1, rel=1e-9)


def test_two_cycles_of_nearly_the_same_phase_make_no_line() -> None:
    assert at_crossover(SOUND, replace(SOUND, phase_deg=2.0, ultimate_gain=310.0)) is None
    assert at_crossover(SOUND, SOUND) is None
    assert at_crossover(replace(SOUND, phase_deg=0.0), replace(SOUND, phase_deg=0.0)) is None


def test_a_cycle_between_two_scatters_as_the_worse_of_them() -> None:
    found = at_crossover(SOUND, replace(SOUND, phase_deg=-2.0, period_scatter=0.1, amplitude_scatter=0.2))
    assert found is not None
    assert (found.period_scatter, found.amplitude_scatter) == (0.1, 0.2)


@cache
def heave(buoyancy_n: float, share: float) -> RelayTrial:
    vehicle = st.Vehicle.load("cwolf").with_coefficients({"B": buoyancy_n})
    return relay_trial(vehicle, AUTOPILOT, loop="heave", speed_m_s=1.0, share=share)


@pytest.mark.parametrize("load_n", [5.0, -5.0])
def test_a_vehicle_out_of_trim_has_the_ultimate_gain_of_the_trimmed_one(load_n: float) -> None:
    trimmed, loaded = heave(NEUTRAL_N, 0.2001).cycle, heave(NEUTRAL_N + load_n, 0.2001).cycle
    assert trimmed is not None
    assert loaded is not None
    # Half of the relay's 10 N: three quarters of the time on one side. Its own cycle says 20 % less.
    assert max(loaded.duty, 1.0 - loaded.duty) == pytest.approx(0.75, abs=0.02)
    # The propellers' rate limit makes it no linear loop.
    assert loaded.ultimate_gain == pytest.approx(trimmed.ultimate_gain, rel=0.05)
    assert loaded.period_s == pytest.approx(trimmed.period_s, rel=0.03)


def test_a_sound_cycle_is_flown_again_with_a_lead() -> None:
    sound = heave(NEUTRAL_N + 5.0, 0.2001)
    assert sound.lead_s > 0.0
    assert sound.cycle is not None
    assert sound.cycle.phase_deg == 0.0


def test_a_cycle_of_the_sampling_is_flown_once(monkeypatch: pytest.MonkeyPatch) -> None:
    flown = []

    def counted(*given: Any, **named: Any) -> st.Flight:
        flown.append(named["max_time_s"])
        return st.fly(*given, **named)

    monkeypatch.setattr("seatrial.tuning.relay_trial.fly", counted)
    vehicle, autopilot = st.Vehicle.load("bluerov2-heavy"), st.Autopilot.load("bluerov2-heavy")
    sampled = relay_trial(vehicle, autopilot, loop="surge", speed_m_s=0.165, share=0.3, voltage_v=14.8)
    assert "that of the sampling" in sampled.why
    assert flown == [120.0]


def test_propellers_that_do_not_reverse_switch_between_nothing_and_ahead() -> None:
    vehicle, autopilot = st.Vehicle.load("lauv"), st.Autopilot.load("lauv")
    trial = relay_trial(vehicle, autopilot, loop="surge", speed_m_s=0.767, share=0.15)
    assert trial.trace is not None
    assert trial.cycle is not None
    # Twice the drag, and nothing: the relay swings evenly about the drag.
    assert trial.trace.wrench.min() == pytest.approx(0.0, abs=0.02 * trial.d)
    assert trial.trace.wrench.max() == pytest.approx(trial.d, rel=0.02)
    assert trial.cycle.duty == pytest.approx(0.5, abs=0.1)


def test_a_second_cycle_that_noise_takes_apart_does_not_count() -> None:
    vehicle = st.Vehicle.load("cwolf")
    trial = relay_trial(vehicle, AUTOPILOT, loop="heave", speed_m_s=1.0, share=0.25, sensors="typical")
    # The rate of the depth is noise: the first cycle, within its scatter, has to do, and is too far off.
    assert trial.cycle is not None
    assert trial.cycle.phase_deg != 0.0
    assert trial.lead_s == 0.0
    assert "from the phase crossover" in trial.why
