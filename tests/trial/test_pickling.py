"""Trials go through pickle, deep copies and the processes of a pool."""

from __future__ import annotations

import copy
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np
import pytest

import seatrial as st

T = np.arange(0.0, 30.0, 0.1)


def _table() -> dict[str, Any]:
    commands = {f"cmd.{name}": 800.0 + 400.0 * np.sin(T) for name in st.Vehicle.load("cwolf").actuators}
    return {"t_s": T, "u_m_s": 1.0 + 0.1 * np.sin(T), "z_m": 2.0 + 0.0 * T, **commands}


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


def test_a_trial_reaches_the_processes_of_a_pool() -> None:
    trial = st.Trial.read(_table())
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        assert pool.submit(_state, trial).result() == _state(trial)
