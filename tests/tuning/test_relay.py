"""Relay autotuning: the limit cycle is the phase crossover of the linear loop, and rules make gains of it."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as draw

import seatrial as st
from seatrial.base.errors import CampaignError, SimulationError
from seatrial.control_design.loops import feedback, plant, restoring_law, sampled
from seatrial.control_design.pole_placement import LoopGain, law
from seatrial.control_design.trim import trim
from seatrial.tuning.relay import RelayTuning, pid_gains, relay_autopilot
from seatrial.tuning.relay_trial import RelayTrial, relay_cycle, relay_trial
from seatrial.vehicle.authority import LOOPS, ROWS, delays

START = "examples/cwolf/start_autopilot.toml"
VEHICLE = st.Vehicle.load("cwolf")
AUTOPILOT = st.Autopilot.load(START)
CRUISE = ("surge", "pitch", "heading")
STERN = ("SbU", "SbL", "PU", "PL")
COLUMN = {"pitch": 2, "heading": 3}


@cache
def tuned(rule: str = "tyreus-luyben") -> RelayTuning:
    return relay_autopilot(VEHICLE, AUTOPILOT, rule=rule)


@cache
def trial(loop: str, share: float, sensors: str | None = None) -> RelayTrial:
    return relay_trial(VEHICLE, AUTOPILOT, loop=loop, speed_m_s=3.0, share=share, sensors=sensors)


@given(
    d=draw.floats(1.0, 200.0),
    a=draw.floats(0.01, 2.0),
    period=draw.floats(2.0, 12.0),
    middle=draw.floats(-50.0, 50.0),
)
def test_law_a_symmetric_relay_has_the_gain_of_the_describing_function(
    d: float, a: float, period: float, middle: float
) -> None:
    t = np.arange(0.0, 8.0 * period, 0.02)
    y = a * np.sin(2.0 * np.pi * t / period + 0.3)
    cycle = relay_cycle(t, middle + y, -d * np.sign(y))
    assert cycle is not None
    # The edges of the relay fall on samples: up to 0.02 s of 2 s.
    assert cycle.period_s == pytest.approx(period, rel=5e-3)
    assert cycle.amplitude == pytest.approx(a, rel=5e-3)
    assert cycle.ultimate_gain == pytest.approx(4.0 * d / (np.pi * a), rel=0.02)
    assert abs(cycle.phase_deg) < 4.0


@given(duty=draw.floats(0.2, 0.8))
def test_law_a_load_weakens_the_relay_by_the_sine_of_its_duty(duty: float) -> None:
    t = np.arange(0.0, 60.0, 0.01)
    phase = (t / 5.0 + 0.2) % 1.0
    wrench = np.where(np.abs(phase - 0.5) < 0.5 * duty, 30.0, -30.0)
    cycle = relay_cycle(t, 0.1 * np.cos(2.0 * np.pi * phase), wrench)
    assert cycle is not None
    # A hundredth of a second in five.
    assert cycle.duty == pytest.approx(duty, abs=0.01)
    assert cycle.ultimate_gain == pytest.approx(4.0 * 30.0 / (np.pi * 0.1) * np.sin(np.pi * duty), rel=0.03)
    assert abs(cycle.phase_deg) < 2.0


def test_noise_neither_adds_cycles_nor_moves_the_gain() -> None:
    t, noise = np.arange(0.0, 80.0, 0.1), np.random.default_rng(1)
    y = 0.1 * np.sin(2.0 * np.pi * t / 6.0) + 0.01 * noise.standard_normal(len(t))
    cycle = relay_cycle(t, y, -10.0 * np.sign(y))
    assert cycle is not None
    assert cycle.cycles == 12
    # Noise of a harmonic over 720 samples: 0.01 sqrt(2/720), half a per cent of the amplitude.
    assert cycle.period_s == pytest.approx(6.0, rel=0.03)
    assert cycle.ultimate_gain == pytest.approx(4.0 * 10.0 / (np.pi * 0.1), rel=0.03)


@pytest.mark.parametrize("cycles", [0.0, 4.0])
def test_too_few_cycles_are_none(cycles: float) -> None:
    t = np.linspace(0.0, 1.0, 400)
    y = np.sin(2.0 * np.pi * cycles * t)
    assert relay_cycle(t, y, -np.sign(y)) is None


def crossover(loop: str, *, ramp: bool) -> tuple[float, float]:
    """Ultimate gain and period of the sampled linear loop at 3 m/s, the others closed with start gains."""
    rows = "".join(ROWS[LOOPS.index(one)] for one in CRUISE)
    late = {row: replace(of, ramp_s=of.ramp_s if ramp else 0.0) for row, of in delays(VEHICLE, rows).items()}
    about = trim(VEHICLE, 3.0, rows, STERN)
    assert about is not None
    system = sampled(plant(VEHICLE, about, CRUISE), late, AUTOPILOT.period_s, CRUISE)
    gains = AUTOPILOT.gains()
    others = law(
        {
            one: LoopGain(gains[f"{one}.K_P.5"], gains[f"{one}.K_I.5"], gains[f"{one}.K_D.5"], np.nan)
            for one in CRUISE
        },
        3.0,
    ) + restoring_law(VEHICLE, rows)
    others[LOOPS.index(loop)] = 0.0
    step = system.phi - system.gamma @ feedback(system, others)
    place = system.seen[system.columns.index(COLUMN[loop])]
    row = system.rows.index(ROWS[LOOPS.index(loop)])
    omega = np.geomspace(0.5, 10.0, 2000)
    z = np.exp(1j * omega * system.period_s)[:, None, None]
    answer = np.linalg.solve(z * np.eye(len(step)) - step, system.gamma[:, row : row + 1].astype(complex))
    response = answer[:, place, 0]
    crossed = np.flatnonzero((np.diff(np.sign(response.imag)) != 0) & (response.real[:-1] < 0.0))
    first = crossed[0]
    return 1.0 / float(np.abs(response[first])), 2.0 * np.pi / float(omega[first])


@pytest.mark.parametrize("loop", ["pitch", "heading"])
def test_the_cycle_of_a_small_relay_is_the_phase_crossover_of_the_linear_loop(loop: str) -> None:
    gain, period = crossover(loop, ramp=False)
    found = trial(loop, 0.05).cycle
    assert found is not None
    # What is left of the propellers' rate limit; a relay smaller yet is lost beside the load.
    assert found.ultimate_gain == pytest.approx(gain, rel=0.10)
    assert found.period_s == pytest.approx(period, rel=0.07)


@pytest.mark.parametrize("loop", ["pitch", "heading"])
def test_the_cycle_of_the_default_relay_lies_within_the_design_s_ramp(loop: str) -> None:
    weak, slow = crossover(loop, ramp=True)
    strong, quick = crossover(loop, ramp=False)
    found = trial(loop, 0.15).cycle
    assert found is not None
    # The ramp is that of a tenth of the largest command: this relay asks the propellers for that or less.
    assert 0.9 * weak < found.ultimate_gain < 1.1 * strong
    assert 0.95 * quick < found.period_s < 1.05 * slow


@pytest.mark.parametrize("loop", ["pitch", "heading"])
def test_a_larger_relay_finds_a_smaller_gain_behind_a_rate_limit(loop: str) -> None:
    found = trial(loop, 0.15).cycle
    assert found is not None
    # The more the revolutions must change, the longer they ramp: the larger relay finds the smaller gain.
    larger = trial(loop, 0.3).cycle
    assert larger is not None
    assert larger.ultimate_gain < found.ultimate_gain
    assert larger.period_s > found.period_s


def test_the_gains_of_the_loop_itself_have_no_part_in_its_trial() -> None:
    other = AUTOPILOT.with_gains({"heading.K_P.5": 5.0, "heading.K_I.5": 0.0, "heading.reference_rad_s": 0.4})
    one = relay_trial(VEHICLE, AUTOPILOT, loop="heading", speed_m_s=3.0, share=0.2)
    two = relay_trial(VEHICLE, other, loop="heading", speed_m_s=3.0, share=0.2)
    assert one.cycle == two.cycle


def test_noise_of_typical_sensors_finds_the_same_ultimate_gain() -> None:
    for loop in ("pitch", "heading"):
        quiet, noisy = trial(loop, 0.15).cycle, trial(loop, 0.15, "typical").cycle
        assert quiet is not None
        assert noisy is not None
        # A single trial of a dozen cycles; the gyro and compass are late by a sample or two.
        assert noisy.ultimate_gain == pytest.approx(quiet.ultimate_gain, rel=0.15)
        assert noisy.period_s == pytest.approx(quiet.period_s, rel=0.10)


def test_lit_ziegler_nichols_and_tyreus_luyben() -> None:
    found = pid_gains("tyreus-luyben", "PID", ultimate_gain=22.0, period_s=6.3)
    assert (found.k_p, found.k_i, found.k_d) == pytest.approx((10.0, 10.0 / 13.86, 10.0))
    found = pid_gains("tyreus-luyben", "PI", ultimate_gain=32.0, period_s=1.0)
    assert (found.k_p, found.k_i, found.k_d) == pytest.approx((10.0, 10.0 / 2.2, 0.0))
    found = pid_gains("ziegler-nichols", "PI", ultimate_gain=20.0, period_s=1.2)
    assert (found.k_p, found.k_i, found.k_d) == pytest.approx((9.0, 9.0, 0.0))


@pytest.mark.long
def test_gains_follow_the_rule_and_all_else_stays() -> None:
    for rule in ("tyreus-luyben", "ziegler-nichols"):
        result = tuned(rule)
        gains = result.autopilot.gains()
        held = 0
        for point in result.points:
            if point.gains is None or point.taken is None or point.taken.cycle is None:
                continue
            held += 1
            cycle = point.taken.cycle
            kind = "PI" if point.loop == "surge" else "PID"
            exact = pid_gains(rule, kind, ultimate_gain=cycle.ultimate_gain, period_s=cycle.period_s)
            k = result.autopilot.speeds_m_s.index(point.speed_m_s) + 1
            written = [gains[f"{point.loop}.{name}.{k}"] for name in ("K_P", "K_I", "K_D")]
            # Three digits.
            assert written == pytest.approx([exact.k_p, exact.k_i, exact.k_d], rel=6e-3)
            least = min(t.cycle.ultimate_gain for t in point.trials if t.usable and t.cycle is not None)
            assert cycle.ultimate_gain == least
        assert held > 0
        start = AUTOPILOT.gains()
        tunable = [f"{loop}.{name}." for loop in result.sources for name in ("K_P", "K_I", "K_D")]
        kept = [name for name in start if not any(name.startswith(head) for head in tunable)]
        assert {name: gains[name] for name in kept} == {name: start[name] for name in kept}
        assert "tau_max = 60.0" in result.autopilot.to_toml()


@pytest.mark.long
def test_a_relay_without_room_beside_the_load_borrows_from_the_nearest_point() -> None:
    result = tuned()
    point = next(p for p in result.points if (p.loop, p.speed_m_s) == ("surge", 3.0))
    assert point.gains is None
    assert point.taken is None
    assert "no room" in point.why
    assert result.sources["surge"] == (1.0,) * 6
    # Astern there is no mission: by the amount of the speed.
    assert result.sources["heading"] == (3.0, 3.0, 1.0, 1.0, 3.0, 3.0)
    text = result.summary()
    assert "surge: the gains at -5, -3, -1, 3, 5 m/s are those of 1 m/s" in text
    assert "no room" in text


def test_a_loop_without_any_cycle_keeps_its_gains() -> None:
    result = relay_autopilot(VEHICLE, AUTOPILOT, speeds=[3.0], shares=[0.15])
    assert "surge" not in result.sources
    assert "surge: no usable limit cycle; the start's gains stay" in result.summary()
    before, after = AUTOPILOT.gains(), result.autopilot.gains()
    assert all(after[name] == value for name, value in before.items() if name.startswith(("surge", "heave")))


def test_the_result_is_plain_data() -> None:
    found = json.loads(json.dumps(tuned().to_dict()))
    assert found["rule"] == "tyreus-luyben"
    assert {point["loop"] for point in found["points"]} == {"surge", "heave", "pitch", "heading"}
    assert st.Autopilot.from_toml(found["autopilot"]).gains() == tuned().autopilot.gains()


def test_the_tuned_autopilot_flies_a_mission_with_noise_and_current() -> None:
    flight = st.fly(
        VEHICLE, tuned().autopilot, "examples/missions/farm.toml", sensors="typical", current=[0.1, 0.2, 0.0]
    )
    assert flight.outcome == "complete"
    # The start gains, whose weak integral leaves the pitch far from its set point, are 1.0 m off.
    assert flight.metrics["vertical_rms_m"] < 0.4


def test_bad_input_is_answered_in_a_sentence() -> None:
    with pytest.raises(SimulationError, match=r'rule: .* did you mean "tyreus-luyben"'):
        relay_autopilot(VEHICLE, AUTOPILOT, rule="tyreus")
    with pytest.raises(SimulationError, match="shares: expected numbers above zero and up to"):
        relay_autopilot(VEHICLE, AUTOPILOT, shares=[1.5])
    with pytest.raises(SimulationError, match="speeds: expected numbers above zero"):
        relay_autopilot(VEHICLE, AUTOPILOT, speeds=[-1.0])
    regulator = st.Autopilot.from_toml(st.start_autopilot(st.Vehicle.load("lauv"), law="lqr"))
    with pytest.raises(CampaignError, match='expected control = "pid"'):
        relay_autopilot("lauv", regulator)
    with pytest.raises(SimulationError, match=r"at most the top speed of cwolf, 3\.18 m/s, found 9"):
        relay_autopilot(VEHICLE, AUTOPILOT, speeds=[1.0, 9.0])
    # A Python function has no command line.
    with pytest.raises(SimulationError, match=r"depends on the supply voltage; give voltage_v, in V$"):
        relay_autopilot("bluerov2-heavy", "bluerov2-heavy", speeds=[0.5])
    with pytest.raises(SimulationError, match="voltage_v: expected a positive number in V, found -5"):
        relay_autopilot(VEHICLE, AUTOPILOT, voltage_v=-5.0)


def test_the_speeds_go_with_the_supply() -> None:
    with pytest.raises(SimulationError, match=r"at most the top speed of bluerov2-heavy, 0\.67 m/s"):
        relay_autopilot("bluerov2-heavy", "bluerov2-heavy", speeds=[0.8], voltage_v=10.0)
