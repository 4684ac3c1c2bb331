"""The filter's noise from residuals: a known force that no log tells is found again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

import seatrial as st
from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError
from seatrial.base.frames import to_euler
from seatrial.identification.hold_out import residual_noise
from seatrial.scoring.record import Record

SIGMA = np.array([1.0, 1.5, 0.0, 0.0, 0.0, 0.08])
TIME_S = 4.0
DT = 0.1


def wrench(n: int, seed: int) -> Array:
    """First-order Gauss-Markov force and moment (n, 6), N and N m."""
    generator = np.random.default_rng(seed)
    kept = np.exp(-DT / TIME_S)
    found = np.zeros((n, 6))
    found[0] = SIGMA * generator.normal(size=6)
    for k in range(1, n):
        found[k] = kept * found[k - 1] + SIGMA * np.sqrt(1.0 - kept**2) * generator.normal(size=6)
    return found


def recording(vehicle: st.Vehicle, *, seconds: float, last: float = 1.0) -> Record:
    """A log of an unlogged force that pushes the vehicle, so many times as much in the last third."""
    t = np.arange(0.0, seconds, DT)
    pushed = wrench(len(t), 3)
    pushed[2 * len(t) // 3 :] *= last
    run = vehicle.simulate(t, {}, tau=pushed, max_step_s=0.05)
    nu, angles = np.asarray(run.nu), np.rad2deg(to_euler(np.asarray(run.attitude)))
    columns = {f"{axis}_m_s": nu[:, k] for k, axis in enumerate("uvw")}
    columns |= {f"{axis}_deg_s": np.rad2deg(nu[:, 3 + k]) for k, axis in enumerate("pqr")}
    columns |= {f"{axis}_m": np.asarray(run.position)[:, k] for k, axis in enumerate("xyz")}
    columns |= {f"{name}_deg": angles[:, k] for k, name in enumerate(("roll", "pitch", "yaw"))}
    columns |= {f"tau.{axis}_n{'' if axis in 'XYZ' else 'm'}": np.zeros(len(t)) for axis in "XYZKMN"}
    trial = st.Trial.read(pl.DataFrame({"t_s": t, **columns}))
    return Record(trial, "tau", trial.valid.copy())


def test_an_unlogged_force_is_found_with_its_memory() -> None:
    vehicle = st.Vehicle.load("bluerov2-heavy")
    found = residual_noise(vehicle, [recording(vehicle, seconds=600.0)])
    drawn = np.sqrt((wrench(6000, 3) ** 2).mean(axis=0))
    pushed = SIGMA > 0.0
    assert found["force"][pushed] == pytest.approx(drawn[pushed], rel=0.15)
    assert found["force_time_s"] == pytest.approx(TIME_S, rel=0.3)  # 150 memories
    assert np.all(found["force"] > 0.0)
    assert st.NavigationFilter(vehicle, "typical", noise=st.ProcessNoise(**found)).waiting_for


def test_samples_that_do_not_count_do_not_change_it() -> None:
    vehicle = st.Vehicle.load("bluerov2-heavy")
    calm, wild = (recording(vehicle, seconds=120.0, last=one) for one in (1.0, 4.0))
    first_half = np.arange(len(calm.trial.t))[:, None] < len(calm.trial.t) // 2
    parts = [replace(one, counted=one.counted & first_half) for one in (calm, wild)]
    fitted = [residual_noise(vehicle, [one])["force"][:3] for one in parts]
    assert fitted[1] == pytest.approx(fitted[0], rel=0.05)  # the smoothing sees all samples
    assert residual_noise(vehicle, [wild])["force"][1] > 1.5 * fitted[1][1]


def test_a_record_without_three_seconds_is_refused() -> None:
    vehicle = st.Vehicle.load("bluerov2-heavy")
    record = recording(vehicle, seconds=20.0)
    none = replace(record, counted=np.zeros_like(record.counted))
    with pytest.raises(TrialError, match="expected a trial with 3 s of fitted samples"):
        residual_noise(vehicle, [none])
