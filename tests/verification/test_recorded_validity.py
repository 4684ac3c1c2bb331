"""Is a model still valid on a log: shares outside the band, what they are worth, and what a log can show."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

import seatrial as st
from seatrial.base.channels import CHANNELS
from seatrial.base.errors import SimulationError, TrialError
from seatrial.trial.trial import Trial
from seatrial.verification.mission_log.judge_log import state_inside, verify_log
from seatrial.verification.mission_log.spread import (
    ExpectedShare,
    clustered_share,
    restarts,
    share_interval,
    spread_of_errors,
    spread_of_noise,
    spread_of_reference,
)
from seatrial.verification.mission_log.validity import validity
from tests.verification.recorded_logs import MISSION, compared, fitted, log

WEAK = (("SbU.gain", 0.8),)


@given(some.lists(some.lists(some.booleans(), min_size=1, max_size=40), min_size=2, max_size=30))
@settings(max_examples=60, deadline=None)
def test_law_a_share_is_worth_no_more_than_its_samples(windows: list[list[bool]]) -> None:
    share, samples, worth = clustered_share([np.array(window) for window in windows])
    assert share == pytest.approx(sum(map(sum, windows)) / samples)
    assert 0.0 < worth <= samples


def test_whole_windows_count_once_and_independent_samples_each() -> None:
    rng = np.random.default_rng(3)
    whole = [np.full(50, hit) for hit in rng.random(400) < 0.1]
    single = [rng.random(50) < 0.1 for _ in range(400)]
    # The worth is a ratio of variances from 400 windows: 2 sigma of it is about a fifth.
    assert clustered_share(whole)[2] == pytest.approx(400, rel=0.2)
    assert clustered_share(single)[2] == pytest.approx(20_000, rel=0.2)


@given(some.integers(0, 60), some.integers(1, 60))
@settings(max_examples=60, deadline=None)
def test_law_the_interval_of_a_share_of_whole_samples_is_clopper_and_pearsons(hits: int, more: int) -> None:
    from scipy.stats import binomtest

    exact = binomtest(hits, hits + more).proportion_ci(0.95, method="exact")
    assert share_interval(hits / (hits + more), float(hits + more)) == pytest.approx(
        (exact.low, exact.high), abs=1e-9
    )


def test_a_weak_propeller_inside_the_doubt_of_few_windows_is_refuted_by_the_groups() -> None:
    """16 windows held against 14: 42 % of q outside, p = 0.015, yet far beyond the noise in seconds."""
    verdict = compared(7, WEAK)
    assert verdict.model == "re-identify", verdict.summary()
    assert verdict.validity is not None
    assert verdict.power is not None
    rate = verdict.validity.channels["q"]
    assert rate.doubtful
    assert not rate.fails
    assert rate.interval[0] < rate.outside < rate.interval[1]
    assert verdict.power.refuted


def test_a_large_share_that_does_not_refute_does_not_pass_either() -> None:
    verdict = compared(7, WEAK)
    assert verdict.validity is not None
    assert verdict.power is not None
    quiet = replace(
        verdict.power, tests=tuple(replace(one, refuted=False, against=()) for one in verdict.power.tests)
    )
    state, cause = state_inside(verdict.validity, quiet)
    assert state == "log too short or too quiet to tell"
    assert cause.kind == "channels in doubt"
    assert "less than would refute it" in replace(verdict, model=state, cause=cause).reason


def test_the_first_line_names_the_channel_that_fails_not_the_one_that_is_outside_most() -> None:
    verdict = compared(7, WEAK)
    assert verdict.validity is not None
    channels = dict(verdict.validity.channels)
    for name, outside, p, fails in (
        ("q", 0.3, 0.004, True),
        ("u", 0.2, 0.009, True),
        ("pitch", 0.4, 0.4, False),
    ):
        channels[name] = replace(channels[name], outside=outside, p=p, fails=fails)
    said = replace(verdict, validity=replace(verdict.validity, channels=channels)).report().good
    assert "; q is outside its 95 % band 30.0 % of the time (5 % expected on average, p = 0.004)" in said
    channels |= {name: replace(one, p=0.4, fails=False) for name, one in channels.items()}
    channels["u"] = replace(channels["u"], p=0.02)
    said = replace(verdict, validity=replace(verdict.validity, channels=channels)).report().good
    assert "; u is outside its 95 % band 20.0 % of the time (5 % expected on average, p = 0.02)" in said


@pytest.mark.long
@pytest.mark.parametrize("known", ["reference", "noise"])
def test_an_unchanged_vehicle_is_valid_in_closed_loop(known: str) -> None:
    verdict = compared(2) if known == "reference" else verify_log(fitted(), log(2))
    assert verdict.model == "model still valid", verdict.summary()
    assert verdict.held
    assert not verdict.suspects
    assert verdict.validity is not None
    assert verdict.validity.outside < 0.10
    assert verdict.power is not None
    assert verdict.power.unjudged == ""


def test_what_the_covariance_allows_is_no_reason_to_doubt_the_model() -> None:
    """A vehicle drawn from the covariance is valid with it, and refuted where the values count as exact."""
    drawn = fitted().draws(1, 5)
    twice = {
        name: 2.0 * float(x[0]) - fitted().vehicle.coefficients()[name]
        for name, x in drawn.items()
        if name[0] == "X"
    }
    windows = restarts(fitted().vehicle, log(3, tuple(twice.items())).trial)
    spread = spread_of_reference([restarts(fitted().vehicle, log(100).trial)])
    exact = validity(windows, spread)
    known = validity(windows, spread, draws=fitted().draws(2048, 1))
    assert exact.channels["u"].outside > known.channels["u"].outside
    assert known.channels["u"].p > exact.channels["u"].p
    assert not known.failing


def test_a_log_too_short_is_not_judged() -> None:
    verdict = verify_log(fitted(), log(2), settings=st.LogSettings(stop_s=30.0))
    assert verdict.model == "not judged"
    assert "windows of 10 s are too few" in verdict.reason


def test_a_log_at_rest_says_nothing_of_the_model() -> None:
    """A neutrally buoyant hover vehicle at rest shows neither drag nor thrust; noise hides its weight."""
    vehicle = st.Vehicle.load("bluerov2-heavy")
    values = vehicle.coefficients()
    vehicle = vehicle.with_coefficients({"B": values["m"] * vehicle.environment()["g"]})
    t = np.arange(0.0, 100.0, 0.1)
    rng = np.random.default_rng(0)
    info = vehicle.actuator_info()
    columns = {f"cmd.{name}": np.full(len(t), float(info[name]["neutral"])) for name in vehicle.actuators}
    columns |= {name: 0.3 * rng.standard_normal(len(t)) for name in ("u_m_s", "w_m_s")}
    columns |= {"voltage_v": np.full(len(t), 16.0)}
    trial = st.Trial.read({"t_s": t} | columns, align=False)
    verdict = verify_log(vehicle, trial)
    assert verdict.model == "not judged", verdict.summary()
    assert "could not have refuted the model on every controlled axis" in verdict.reason


def test_errors_given_per_channel_set_the_band() -> None:
    windows = restarts(fitted().vehicle, log(2).trial)
    spread = spread_of_errors({"u": 0.02}, windows)
    # Half constant, half a random walk: the mean square over a window is that given.
    assert np.mean(spread.at(windows.since_restart(0))[:, 0] ** 2) == pytest.approx(0.02**2, rel=0.02)
    assert set(validity(windows, spread).channels) == {"u"}
    with pytest.raises(TrialError, match='"uu" is no channel'):
        spread_of_errors({"uu": 0.02}, windows)


def test_noise_of_a_log_grows_with_the_time_since_the_restart() -> None:
    spread = spread_of_noise(restarts(fitted().vehicle, log(2).trial))
    position = spread.sigma[:, 6:8]
    assert (position[-1] > position[0]).all()
    assert np.isfinite(position).all()


def test_a_reference_of_few_windows_is_refused() -> None:
    short = restarts(fitted().vehicle, log(2).trial, stop_s=40.0)
    with pytest.raises(TrialError, match="at least six windows"):
        spread_of_reference([short])


def test_a_weak_propeller_is_noticed_though_the_mission_was_flown() -> None:
    verdict = compared(2, (("SbU.gain", 0.7),))
    assert verdict.model == "re-identify"
    assert not verdict.held
    assert verdict.validity is not None
    assert {one.channel for one in verdict.validity.failing} & {"q", "pitch", "r"}
    assert verdict.suspects[0].name == "SbU.gain"
    # The step is told to within a few percent of thrust.
    assert verdict.suspects[0].values[0] == pytest.approx(-0.3, abs=0.04)


def test_an_offset_of_the_roll_sensor_belongs_to_the_band() -> None:
    windows = restarts(fitted().vehicle, log(2).trial)
    spread = spread_of_reference([restarts(fitted().vehicle, log(100).trial)])
    bare = validity(windows, spread).channels["p"].spread
    known = validity(windows, spread, offsets={"roll": 0.0035}).channels["p"].spread
    # The righting moment turns a wrong roll into a roll rate.
    assert known > 1.2 * bare


def test_law_draws_of_a_valid_vehicle_are_refuted_no_more_often_than_the_level_says() -> None:
    """A vehicle from the same covariance as the draws; its share outside is large where they rarely are."""
    rng = np.random.default_rng(7)
    level, count, repeats = 0.01, 60, 1500

    def shares(k: int) -> np.ndarray:
        return np.clip(0.05 * np.exp(0.5 * rng.standard_normal(k) ** 2), 0.05, 0.9)

    known = [ExpectedShare.of(shares(2048), np.inf) for _ in range(10)]
    hits = rng.binomial(count, shares(repeats))
    alarms = np.mean([known[k % 10].p(h / count, count) < level for k, h in enumerate(hits)])
    # Four standard deviations of a share of 1500 at 1 %.
    assert alarms <= level + 0.0103


def test_a_p_value_is_never_smaller_than_the_draws_can_tell() -> None:
    assert ExpectedShare.of(np.full(99, 0.05), np.inf).p(1.0, 1000.0) == pytest.approx(0.01, rel=1e-9)
    with pytest.raises(SimulationError, match="expected at least 1200"):
        verify_log(fitted(), log(2), settings=st.LogSettings(draws=64))


def test_linear_draws_are_those_of_the_model() -> None:
    windows = restarts(fitted().vehicle, log(2).trial)
    draws = fitted().draws(64, 3)
    spread = spread_of_reference([restarts(fitted().vehicle, log(100).trial)])
    sigma = [spread.at(windows.since_restart(w)) for w in range(len(windows.spans))]
    half = validity(windows, spread, draws=draws).half_width
    squares = [np.zeros_like(one) for one in windows.predicted]
    for k in range(64):
        changed = windows.of({name: float(values[k]) for name, values in draws.items()})
        for total, one, own in zip(squares, changed, windows.residual, strict=True):
            total += (one - own) ** 2 / 64.0
    for c in (0, 5):
        told = np.concatenate([
            h[1:, c] ** 2 / spread.factor**2 - s[1:, c] ** 2 for h, s in zip(half, sigma, strict=True)
        ])
        true = np.concatenate([one[1:, c] for one in squares])
        # Coefficients move by some percent: the second order is a few percent of the first.
        assert told.mean() == pytest.approx(true.mean(), rel=0.1)


def test_a_channel_whose_stated_error_swallows_its_signal_cannot_judge() -> None:
    """A vehicle that kept its state would have passed: the verdict says so, and does not pass for it."""
    windows = restarts(fitted().vehicle, log(2).trial)
    wide = validity(windows, spread_of_errors({"u": 0.02, "w": 0.02, "r": 1.0}, windows)).channels["r"]
    # The half-width is at least 1.96 rad/s, and the vehicle turns by less.
    assert wide.band_over_signal == pytest.approx(wide.spread / wide.signal)
    assert wide.band_over_signal > 10.0
    verdict = verify_log(fitted(), log(2), reference={"u": 1.0, "w": 1.0, "r": 1.0})
    assert verdict.model == "not judged"
    assert verdict.outcome == "not judged"
    assert "could not have refuted the model on every controlled axis: on X, Z, M, N" in verdict.reason
    assert "None of 3 channels can judge" in verdict.summary()


def test_a_flight_that_begins_afloat_is_judged_from_where_it_is_under_water(tmp_path: Path) -> None:
    """A model that knows no surface would push up where the log floats, and be called wrong."""
    st.fly("cwolf", "cwolf", MISSION).save(tmp_path / "run")
    flown = st.MissionLog.read(tmp_path / "run").trial
    assert flown.channel("z")[0] < 0.5
    assert flown.surface == log(100).trial.surface == 0.0

    def missed(trial: Trial) -> float:
        """Largest error of heave of the true vehicle in the first half minute, m/s."""
        shown = restarts(st.Vehicle.load("cwolf"), trial, stop_s=trial.t[0] + 30.0).residual
        return float(max(np.abs(one[:, CHANNELS.index("w")]).max() for one in shown))

    # Perfect sensors: what is left is the start of a window, smoothed from samples.
    assert missed(flown) < 0.3 * missed(replace(flown, surface=None))
