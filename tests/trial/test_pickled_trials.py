"""Trials, campaigns and bench tests are the same after pickle and deep copies."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial.base.run import to_json
from tests.bench_test.bench_records import both_ways

T = np.arange(0.0, 30.0, 0.1)
TEXT = """
format = 1
name = "pickled"
vehicle = "cwolf"
[trials.surge]
file = "surge.csv"
[[stages]]
name = "surge"
trials = ["surge"]
axes = { free = "X" }
[stages.coefficients]
X_uu = [-30.0, -4.0]
"""


def _table() -> dict[str, Any]:
    commands = {f"cmd.{name}": 800.0 + 400.0 * np.sin(T) for name in st.Vehicle.load("cwolf").actuators}
    return {"t_s": T, "u_m_s": 1.0 + 0.1 * np.sin(T), "z_m": 2.0 + 0.0 * T, **commands}


def _campaign() -> st.Campaign:
    return st.Campaign.from_toml(TEXT, trials={"surge": _table()})


def _pickled(value: Any) -> Any:
    return pickle.loads(pickle.dumps(value))


def _state(trial: st.Trial) -> list[float]:
    return [float(x) for part in trial.state(50) for x in part]


@pytest.mark.parametrize("through", [_pickled, copy.deepcopy, copy.copy])
def test_a_trial_is_the_same_after_a_round_trip(through: Any) -> None:
    trial = st.Trial.read(_table())
    expected = _state(trial)
    again = through(trial)
    assert again.table.equals(trial.table)
    assert _state(again) == expected
    assert str(again.report) == str(trial.report)
    assert (again.name, again.rho, again.g, again.inputs) == (trial.name, trial.rho, trial.g, trial.inputs)


@pytest.mark.parametrize("through", [_pickled, copy.deepcopy])
@pytest.mark.parametrize("read", [False, True])
def test_a_campaign_is_the_same_after_a_round_trip(through: Any, read: bool) -> None:
    campaign = _campaign()
    if read:
        assert len(campaign.trials["surge"]) == len(T)
    again = through(campaign)
    assert again.file == campaign.file
    assert again.problem().parameters == campaign.problem().parameters
    assert again.vehicle.to_toml() == campaign.vehicle.to_toml()
    assert again.trials["surge"].table.equals(campaign.trials["surge"].table)


@pytest.mark.parametrize("through", [_pickled, copy.deepcopy])
def test_a_bench_test_is_the_same_after_a_round_trip(through: Any, tmp_path: Path) -> None:
    bench = st.bench(both_ways(tmp_path))
    again = through(bench)
    assert to_json(again.to_dict()) == to_json(bench.to_dict())
    assert again.vehicle.to_toml() == bench.vehicle.to_toml()
