"""Results of flights, verifications and logs survive a copy, a pickle and the way through a process pool."""

import copy
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from typing import Any

import numpy as np
import pytest

import seatrial as st
from tests.flight.flying import OUT, mission


@cache
def flight() -> st.Flight:
    return st.fly("cwolf", "cwolf", mission(OUT), conditions=st.Conditions(sensors="typical"), seed=2)


@cache
def verification() -> st.Verification:
    return st.verify("cwolf", "cwolf", [mission(OUT)], runs=4)


@cache
def log_verdict() -> st.LogVerdict:
    return st.verify_log("cwolf", st.MissionLog.read(flight().table(), name="out"), mission=mission(OUT))


def plain(result: Any) -> dict[str, Any]:
    found: dict[str, Any] = result.to_dict()
    return found


def flown_again(found: st.Verification) -> dict[str, Any]:
    return plain(found.replay(1))


@pytest.mark.parametrize("make", [flight, verification, log_verdict])
def test_a_result_comes_back_as_it_was(make: Any) -> None:
    before = plain(make())
    for again in (pickle.loads(pickle.dumps(make())), copy.deepcopy(make()), copy.copy(make())):
        assert type(again) is type(make())
        np.testing.assert_equal(plain(again), before)
        assert again.summary() == make().summary()
        assert again.outcome == make().outcome


def test_flights_and_a_mission_come_back_as_they_were() -> None:
    flights = st.fly_batch("cwolf", "cwolf", mission(OUT), seeds=[1, 2], logs=True)
    again = pickle.loads(pickle.dumps(flights))
    np.testing.assert_equal(again.figures, flights.figures)
    np.testing.assert_array_equal(again.log(1), flights.log(1))
    copied = copy.deepcopy(mission(OUT))
    assert copied.to_toml() == mission(OUT).to_toml()
    st.Autopilot.load("cwolf").engage(st.Vehicle.load("cwolf"), copied)


@pytest.mark.long
def test_a_process_that_begins_anew_flies_a_mission_again() -> None:
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        apart = pool.submit(flown_again, verification()).result()
    np.testing.assert_equal(apart, flown_again(verification()))
