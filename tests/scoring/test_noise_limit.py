"""What noise and waves leave to a model: the ceiling is what the true vehicle reaches on its noisy record."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from seatrial._core import Vehicle
from seatrial.base.channels import CHANNELS
from seatrial.identification.hold_out import likelihood_gain
from seatrial.scoring.score import Score, score
from seatrial.scoring.windows import ChannelScore, Unpredictable, Window, bands, ceiling, unpredictable
from seatrial.trial.trial import Trial

DT = 0.1
T = np.arange(0.0, 400.0, DT)
PERIOD_S, HEAVE_M_S = 5.0, 0.05


@cache
def record(noise: float, waves: float = 0.0, *, slow: bool = False) -> Trial:
    """Steps ahead and down of CWolf, its Doppler log with white noise; waves add a narrow band to w."""
    vehicle, random = Vehicle.load("cwolf"), np.random.default_rng(3)
    levels = {"stern": random.uniform(200.0, 1500.0, 20), "vertical": random.uniform(-700.0, 700.0, 20)}
    commands = {
        name: np.repeat(levels["vertical" if name.startswith("V") else "stern"], len(T) // 20)
        for name in vehicle.actuators
    }
    run = vehicle.simulate(T, commands, free="XZ")
    # A swell of slowly changing phase: a peak of the spectrum, no line.
    phase = 2.0 * np.pi * T / PERIOD_S + np.cumsum(0.05 * random.standard_normal(len(T)))
    w = run.nu[:, 2] + waves * np.sin(phase)
    table = {"t_s": T, "u_m_s": run.nu[:, 0], "w_m_s": w} | {f"cmd.{k}": v for k, v in commands.items()}
    for name in ("u_m_s", "w_m_s"):
        table[name] = table[name] + noise * random.standard_normal(len(T))
        if slow:
            table[name] = np.where(np.arange(len(T)) % 3 == 0, table[name], np.nan)
    return Trial.read(table, align=False, level=False, name="run")


@pytest.mark.parametrize("slow", [False, True])
def test_law_white_noise_is_found_beside_the_motion(slow: bool) -> None:
    trial = record(0.02, slow=slow)
    if slow:  # as the time base holds a slow sensor
        filled, own = trial.observed.copy(), {}
        for k, channel in ((0, "u"), (2, "w")):
            good = trial.valid[:, k]
            own[channel] = trial.t[good], trial.observed[good, k]
            filled[:, k] = np.interp(trial.t, *own[channel])
        trial = replace(trial, observed=filled, valid=np.isfinite(filled), samples=own)
    limits = unpredictable(trial, {})
    # Straight lines over three samples keep (1 + 5/9 + 5/9) / 3 of the variance.
    expected = 0.02**2 * (19.0 / 27.0 if slow else 1.0)
    for channel in ("u", "w"):
        assert limits.noise[channel] == pytest.approx(expected, rel=0.12)
    assert limits.period_s is None


def test_law_the_true_vehicle_reaches_the_ceiling_and_no_more() -> None:
    found = score(Vehicle.load("cwolf"), record(0.1), free="XZ", free_run=True)
    for channel in ("u", "w"):
        assert found.ceiling[channel] < 0.98
        # The least of four estimates of the noise is some per cent low: a limit from above.
        assert 1.0 - found.r2[channel] == pytest.approx(1.0 - found.ceiling[channel], rel=0.1)
        assert found.r2[channel] < found.ceiling[channel] + 0.005
    assert found.to_dict()["ceiling"] == found.ceiling
    assert "ceiling" in str(found)


def test_a_ceiling_that_the_model_beats_is_not_told() -> None:
    """What a spectrum took for waves was motion that the vehicle's model explains."""
    found = score(Vehicle.load("cwolf"), record(0.005), free="XZ", free_run=True)
    assert set(found.ceiling) == {"u", "w"}
    waved = {name: replace(one, wave={"u": 0.1}) for name, one in found.limits.items()}
    assert set(replace(found, limits=waved).ceiling) == {"w"}
    assert all(found.r2[channel] <= limit for channel, limit in found.ceiling.items())


def test_waves_lower_the_ceiling_and_part_the_score() -> None:
    trial = record(0.005, HEAVE_M_S)
    found = score(Vehicle.load("cwolf"), trial, free="XZ", free_run=True)
    limits = found.limits["run"]
    assert limits.period_s == pytest.approx(PERIOD_S, rel=0.1)
    assert limits.wave["w"] == pytest.approx(0.5 * HEAVE_M_S**2, rel=0.25)
    assert found.r2["w"] == pytest.approx(found.ceiling["w"], abs=0.1)
    # The vehicle is right below the waves, and knows nothing of them.
    assert found.bands["w"].below > 0.93
    assert found.bands["w"].at < 0.3
    assert "below waves" in str(found)
    still = score(Vehicle.load("cwolf"), record(0.005), free="XZ", free_run=True)
    assert still.bands == {}
    assert "below waves" not in str(still)


def test_law_bands_part_the_sums_of_squares_exactly() -> None:
    trial, random = record(0.005, HEAVE_M_S), np.random.default_rng(0)
    simulated = np.full((400, len(CHANNELS)), np.nan)
    simulated[:, 2] = random.standard_normal(400)
    windows = [Window(trial, start, start + 400, simulated) for start in (0, 399, 1000)]
    limits = {"run": Unpredictable({}, {"w": 0.01}, PERIOD_S)}
    assert bands(windows, ["w"], {"run": Unpredictable({}, {"u": 0.01}, PERIOD_S)}) == {}  # w shows no waves
    part = bands(windows, ["w"], limits)["w"]
    whole = 1.0 - sum(
        float(np.sum((w.compared("w")[0] - w.compared("w")[1]) ** 2)) for w in windows
    ) / sum_of_squares(windows)
    assert min(part.below, part.at) <= whole <= max(part.below, part.at)
    assert ceiling(windows, ["w"], {}) == {}  # nothing is known of the trial


def sum_of_squares(windows: list[Window]) -> float:
    measured = np.concatenate([window.compared("w")[1] for window in windows])
    return float(np.sum((measured - measured.mean()) ** 2))


def test_nats_are_those_of_a_gaussian_with_the_variance_of_the_training_part() -> None:
    def made(r2: float, rmse: float, baseline: float) -> Score:
        table = {"r": ChannelScore(r2, 0.0, rmse, 100)}
        return Score(table, ("run",), 10.0, 0, 0, (), baselines={"linear": {"r": baseline}})

    # The model's error doubles on the hold-out, the baseline's stays 2.
    trained, judged = made(0.9, 1.0, 0.6), made(0.6, 2.0, 0.6)
    parts = {"fit": {"ahead": {"run": trained}}, "hold_out": {"ahead": {"run": judged, "other": judged}}}
    name, nats = likelihood_gain(parts)["r"]
    assert name == "linear"
    assert nats == pytest.approx((-np.log(1.0) - 0.5 * 4.0) - (-np.log(2.0) - 0.5))
    diverged = replace(judged, channels={"r": ChannelScore(-np.inf, np.inf, np.inf, 100)})
    assert likelihood_gain(parts | {"hold_out": {"ahead": {"run": diverged}}}) == {}
