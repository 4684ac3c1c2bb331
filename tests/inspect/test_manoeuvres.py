"""Manoeuvres are found where a recipe puts them, and named as in a trial plan."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import seatrial as st
from seatrial.base.arrays import Array
from seatrial.inspect.manoeuvres import Manoeuvre, counted, drives, manoeuvres

DT = 0.1
EXAMPLES = Path(__file__).parents[2] / "examples"


def kinds(found: list[Manoeuvre], kind: str, by: str | None = None) -> list[Manoeuvre]:
    return [one for one in found if one.kind == kind and by in (None, one.by)]


def followed(force: Array, lag_s: float, gain: float) -> Array:
    """First-order response to a force."""
    y = np.zeros(len(force))
    for k in range(1, len(force)):
        y[k] = y[k - 1] + DT / lag_s * (gain * force[k - 1] - y[k - 1])
    return y


def recorded(**columns: Array) -> st.Trial:
    n = len(next(iter(columns.values())))
    table = {name.replace("tau_", "tau."): values for name, values in columns.items()}
    return st.Trial.read({"t_s": DT * np.arange(n)} | table, align=False)


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_steps_of_a_staircase_and_its_coast_down(noise: float) -> None:
    rng = np.random.default_rng(1)
    t = DT * np.arange(1200)
    force = np.select([t < 10, t < 30, t < 50, t < 70], [0.0, 5.0, 12.0, 30.0], 0.0)
    speed = followed(force, 6.0, 0.05)
    trial = recorded(u_m_s=speed + rng.normal(0.0, 0.002, 1200), tau_X_n=force + rng.normal(0, noise, 1200))
    found = manoeuvres(trial)
    steps = kinds(found, "step", "X")
    assert [round(one.size) for one in steps] == [5, 7, 18, -30]
    assert [one.start_s for one in steps] == pytest.approx([10, 30, 50, 70], abs=0.4)
    assert [one.end_s for one in steps] == pytest.approx([30, 50, 70, 120], abs=0.4)
    (coast,) = kinds(found, "coast-down")
    assert coast.by == "X"
    assert coast.start_s == pytest.approx(70.0, abs=0.5)
    assert coast.size == pytest.approx(speed[700], rel=0.1)
    assert coast.sentence.startswith("coast-down of surge from 1.")


def test_a_zigzag_is_no_row_of_turns_and_a_turn_no_zigzag() -> None:
    t = DT * np.arange(1500)
    moment = np.where(t < 60.0, 4.0 * np.sign(np.sin(2.0 * np.pi * t / 20.0)), 0.0)
    moment[(t > 80.0) & (t < 110.0)] = 3.0
    rate = followed(moment, 1.0, 0.03)
    trial = recorded(
        u_m_s=np.full(1500, 1.0),
        yaw_deg=np.rad2deg(np.cumsum(rate) * DT),
        r_deg_s=np.rad2deg(rate),
        tau_N_nm=moment,
    )
    found = manoeuvres(trial)
    (zigzag,) = kinds(found, "zigzag")
    assert zigzag.start_s < 3.0
    assert zigzag.end_s == pytest.approx(62.0, abs=3.0)
    (turn,) = kinds(found, "turn")
    assert turn.start_s == pytest.approx(80.5, abs=1.5)
    assert turn.size == pytest.approx(np.rad2deg(0.09 * 30.0), rel=0.1)
    assert "to starboard" in turn.sentence
    assert [one.start_s for one in kinds(found, "straight run")] == pytest.approx([62.0, 113.0], abs=4.0)


def test_dives_and_rises_are_told_from_waves() -> None:
    t = DT * np.arange(2000)
    depth = np.interp(t, [0, 40, 70, 130, 150], [5, 5, 15, 15, 8]) + 0.05 * np.sin(2.0 * np.pi * t / 6.0)
    found = manoeuvres(recorded(z_m=depth, pitch_deg=np.zeros(2000)))
    (dive,), (rise,) = kinds(found, "dive"), kinds(found, "rise")
    assert (dive.start_s, dive.end_s) == pytest.approx((40.0, 70.0), abs=2.5)
    assert dive.size == pytest.approx(10.0, abs=0.5)
    assert rise.size == pytest.approx(-7.0, abs=0.5)


def test_station_keeping_is_busy_and_rest_is_not() -> None:
    rng = np.random.default_rng(2)
    t = DT * np.arange(900)
    busy = (t > 30.0) & (t < 60.0)
    force = np.where(t < 30.0, 20.0, np.where(busy, 5.0 + rng.normal(0.0, 1.0, 900), 0.0))
    speed = np.where(t < 30.0, 0.8, 0.0) + rng.normal(0.0, 0.002, 900)
    found = manoeuvres(recorded(u_m_s=speed, yaw_deg=np.zeros(900), tau_X_n=force))
    (keeping,), (rest,) = kinds(found, "station-keeping"), kinds(found, "rest")
    assert (keeping.start_s, keeping.end_s) == pytest.approx((30.0, 60.0), abs=3.0)
    assert (rest.start_s, rest.end_s) == pytest.approx((60.0, 90.0), abs=3.0)


def test_commands_of_a_vehicle_become_forces_and_coupled_axes_count_once() -> None:
    campaign = st.Campaign.load(EXAMPLES / "cwolf" / "campaign.toml")
    turn = campaign.trials["turn"]
    assert [drive.axis for drive in drives(turn, campaign.vehicle)] == ["X", "N"]  # sway force comes with N
    assert {drive.axis for drive in drives(turn)} == {""}
    found = manoeuvres(turn, campaign.vehicle)
    # The recipe commands nineteen differential changes between 20 and 385 s.
    steps = kinds(found, "step", "N")
    assert len(steps) == pytest.approx(19, abs=3)
    for commanded in (20.0, 60.0, 100.0, 165.0, 270.0, 340.0):
        assert min(abs(one.start_s - commanded) for one in steps) < 1.5


def test_a_free_decay_of_roll_is_named() -> None:
    campaign = st.Campaign.load(EXAMPLES / "cwolf" / "campaign.toml")
    (decay,) = kinds(manoeuvres(campaign.trials["roll"], campaign.vehicle), "decay")
    assert decay.by == "K"
    assert decay.size == pytest.approx(30.0, abs=1.0)


def test_manoeuvres_are_counted_in_words() -> None:
    one = Manoeuvre("step", "thruster_1", 0.0, 1.0, 1.0, "us")
    two = Manoeuvre("step", "X", 0.0, 1.0, 1.0, "N")
    three = Manoeuvre("straight run", "X", 0.0, 1.0, 1.0, "m/s")
    assert counted([one, one, two, three]) == "1 step of X, 2 steps of single actuators, 1 straight run"
    assert counted([]) == ""
