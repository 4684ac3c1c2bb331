"""Irregular stamps and bursts become one time base that loses nothing; regular ones are left as they are."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl
import pytest

import seatrial as st
from seatrial.logs.clock import base_step, spread_bursts, usual_interval


def _motion(t: np.ndarray) -> dict[str, np.ndarray]:
    """Attitude in deg and forward speed in m/s of a smooth manoeuvre."""
    return {
        "roll_deg": 3.0 * np.sin(0.9 * t),
        "pitch_deg": 2.0 * np.cos(0.6 * t),
        "yaw_deg": 40.0 * np.sin(0.3 * t),
        "u_m_s": 1.0 + 0.3 * np.sin(0.5 * t),
    }


def _read(t: np.ndarray, stamps: np.ndarray | None = None, **options: Any) -> st.Trial:
    return st.Trial.read({"t_s": t if stamps is None else stamps, **_motion(t)}, align=False, **options)


def _messages(trial: st.Trial) -> str:
    return "\n".join(str(finding) for finding in trial.report.findings)


def test_intervals_that_alternate_are_no_gaps_and_keep_every_sample() -> None:
    t = np.cumsum(np.tile([0.1, 0.2], 300))
    trial = _read(t)
    assert trial.dt == pytest.approx(0.1)
    assert trial.valid[:, [0, 9, 10, 11]].all()
    # Every stamp has a place on the base.
    assert np.abs(t - trial.t[np.searchsorted(trial.t, t - 0.01)]).max() < 1e-9
    assert "0.1 to 0.2 s apart; put on 10 Hz" in _messages(trial)


def test_intervals_that_alternate_leave_a_real_gap_masked() -> None:
    t = np.cumsum(np.tile([0.1, 0.2], 300))
    t = t[(t < 40.0) | (t > 41.5)]
    trial = _read(t)
    gap = (trial.t > 40.05) & (trial.t < 41.45)
    assert not trial.valid[gap, 0].any()
    assert trial.valid[~gap, 0].mean() > 0.99


def test_a_doppler_log_with_scattered_stamps_is_not_masked() -> None:
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.choice([0.05, 0.1, 0.11, 0.18, 0.21], 2000, p=[0.1, 0.3, 0.3, 0.2, 0.1]))
    fast = np.arange(t[0], t[-1], 0.1)
    angles = {k: v for k, v in _motion(fast).items() if k != "u_m_s"}
    slow = pl.DataFrame({"t_s": t, "u_m_s": _motion(t)["u_m_s"]})
    table = pl.DataFrame({"t_s": fast, **angles}).join(slow, on="t_s", how="full", coalesce=True).sort("t_s")
    trial = st.Trial.read(table, align=False)
    assert trial.valid[:, 0].mean() > 0.99


@pytest.mark.parametrize("each", [3, 7])
def test_bursts_of_receive_stamps_are_spread(each: int) -> None:
    t = np.arange(0.0, 84.0, 0.1)
    burst = np.arange(len(t)) // each
    stamps = t[np.minimum((burst + 1) * each - 1, len(t) - 1)] + 1e-4 * (np.arange(len(t)) % each)
    trial = _read(t, stamps)
    assert trial.dt == pytest.approx(0.1, rel=1e-3)
    assert trial.valid[:, 0].mean() > 0.99
    # A tenth of the sampling interval: what the stamps within a burst are apart.
    assert np.abs(trial.channel("u") - _motion(trial.t)["u_m_s"])[5:-5].max() < 0.01 * 0.3
    assert "bursts with nearly one stamp" in _messages(trial)


def test_bursts_whose_samples_share_a_stamp_are_spread_by_the_join(tmp_path: Any) -> None:
    from seatrial.logs import open_log
    from seatrial.logs.join import Wanted, join

    t = np.arange(0.0, 60.0, 0.1)
    stamps = t[(np.arange(len(t)) // 5 + 1) * 5 - 1]
    path = tmp_path / "nav.csv"
    pl.DataFrame({"time": stamps, "yaw": _motion(t)["yaw_deg"]}).write_csv(path)
    joined = join([open_log(path)], [Wanted("nav", "yaw")])
    assert joined.table.height == len(t)
    assert np.abs(joined.table["t_s"].to_numpy() - t).max() < 1e-6
    assert any("120 bursts" in str(note) for note in joined.notes)


def test_a_pause_before_a_burst_stays_a_gap() -> None:
    stamps = np.repeat(np.concatenate([np.arange(1.0, 21.0), np.arange(31.0, 51.0)]), 5)
    spread = spread_bursts(stamps)
    assert spread is not None
    assert np.diff(spread.t).max() > 8.0
    assert (np.diff(spread.t) > 0.0).all()
    assert (spread.t <= stamps + 1e-12).all()


def test_law_regular_stamps_keep_their_median_base() -> None:
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 100.0, 0.1) + rng.uniform(-0.004, 0.004, 1000)
    assert base_step(t) == np.median(np.diff(t))
    assert usual_interval(t) == pytest.approx(0.1, rel=0.06)
    assert spread_bursts(t) is None
    assert "time base" not in _messages(_read(t))


def test_events_at_any_time_are_no_bursts() -> None:
    t = np.sort(np.random.default_rng(5).uniform(0.0, 100.0, 400))
    assert spread_bursts(t) is None


def _mean_command(stamps: np.ndarray, values: np.ndarray, begins: np.ndarray, step: float) -> np.ndarray:
    """Mean over each step of a command that acts from stamp to stamp, by a grid of ten thousandths of it."""
    inner = step * (np.arange(10_000) + 0.5) / 10_000
    rows = np.searchsorted(stamps, begins[:, None] + inner, side="right") - 1
    return np.asarray(values[np.maximum(rows, 0)].mean(axis=1))


def test_a_command_acts_at_its_own_stamp() -> None:
    rng = np.random.default_rng(2)
    t = 0.1 * np.arange(400)
    for stamps in (t + 0.004, np.cumsum(rng.uniform(0.02, 0.16, 430)), 0.25 * np.arange(160) + 0.031):
        values = rng.standard_normal(len(stamps))
        motion = pl.DataFrame({"t_s": t, **_motion(t)})
        table = motion.join(
            pl.DataFrame({"t_s": stamps, "cmd.a": values}), on="t_s", how="full", coalesce=True
        )
        trial = st.Trial.read(table.sort("t_s"), align=False)
        wanted = _mean_command(stamps, values, trial.t, trial.dt)
        np.testing.assert_allclose(trial.commands["a"], wanted, atol=2e-3)


def test_commands_on_the_base_stay_as_they_are() -> None:
    t = 0.1 * np.arange(400)
    values = np.round(1500.0 + 400.0 * np.sin(t)) + 0.3
    for start in (0.0, 1.6e9):
        trial = st.Trial.read({"t_s": start + t, **_motion(t), "cmd.a": values}, align=False)
        np.testing.assert_array_equal(trial.commands["a"], values)


def test_the_vehicle_that_sailed_predicts_a_log_whose_commands_are_stamped_after_the_motion() -> None:
    """A command held back until the next row comes 96 ms late here: R2 0.9986 in r."""
    rng = np.random.default_rng(3)
    t = 0.02 * np.arange(6000)
    vehicle = st.Vehicle.load("remus100")
    commands = {name: np.zeros(len(t)) for name in vehicle.actuators}
    commands["propeller"] += 1000.0
    for name in ("rudder_upper", "rudder_lower"):
        commands[name] = np.repeat(rng.choice([-0.15, 0.0, 0.15], 200), 30)
    run = vehicle.simulate(t, commands)
    motion = {"t_s": t[::5], "u_m_s": run.nu[::5, 0], "v_m_s": run.nu[::5, 1], "w_m_s": run.nu[::5, 2]}
    motion |= {f"{name}_deg_s": np.degrees(run.nu[::5, 3 + k]) for k, name in enumerate("pqr")}
    angles = np.degrees(np.unwrap(run.euler[::5], axis=0))
    motion |= {f"{name}_deg": angles[:, k] for k, name in enumerate(("roll", "pitch", "yaw"))}
    given = {"t_s": t[::5] + 0.004} | {f"cmd.{name}": values[::5] for name, values in commands.items()}
    table = pl.DataFrame(motion).join(pl.DataFrame(given), on="t_s", how="full", coalesce=True)
    trial = st.Trial.read(table.sort("t_s"), align=False)
    assert st.score(vehicle, trial, ahead_s=1.0).r2["r"] > 0.9995
