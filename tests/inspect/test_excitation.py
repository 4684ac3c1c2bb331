"""Bands and noise of known signals, commands at motor limits, and a vehicle that is held."""

from __future__ import annotations

import numpy as np
import pytest

import seatrial as st
from seatrial.inspect.kind_of_data import contacts, excesses, excitation, saturation
from seatrial.inspect.manoeuvres import drives

T = np.arange(0.0, 300.0, 0.1)


def test_energy_is_shared_among_bands_and_noise_is_told_from_motion() -> None:
    rng = np.random.default_rng(1)
    u = np.sin(2.0 * np.pi * 0.02 * T) + 0.5 * np.sin(2.0 * np.pi * 0.1 * T) + rng.normal(0.0, 0.01, len(T))
    w = rng.normal(0.0, 0.02, len(T))
    found = {one.channel: one for one in excitation(st.Trial.read({"t_s": T, "u_m_s": u, "w_m_s": w}))}
    assert found["u"].shares[:2] == pytest.approx((0.8, 0.2), abs=0.05)
    assert found["u"].noise == pytest.approx(0.01, rel=0.2)
    assert not found["u"].weak
    assert found["w"].weak
    assert found["w"].over_noise == pytest.approx(1.0, rel=0.2)


def test_a_sensor_slower_than_the_time_base_keeps_its_noise() -> None:
    rng = np.random.default_rng(2)
    t, slow = np.arange(0.0, 300.0, 0.04), np.arange(0.0, 300.0, 0.12)
    u = np.interp(t, slow, np.sin(0.2 * slow) + rng.normal(0.0, 0.02, len(slow)))
    (found,) = excitation(st.Trial.read({"t_s": t, "u_m_s": u}))
    assert found.noise == pytest.approx(0.02, rel=0.2)


def test_a_command_at_its_motor_limit_is_saturated_and_preset_steps_are_not() -> None:
    vehicle = st.Vehicle.load("cwolf")
    names = vehicle.actuators
    swing = np.clip(2500.0 * np.sin(0.1 * T), -2000.0, 2000.0)
    table = {"t_s": T, "u_m_s": np.sin(T)} | {f"cmd.{name}": 0.0 * T for name in names}
    table[f"cmd.{names[0]}"] = swing
    table[f"cmd.{names[1]}"] = 2000.0 * np.sign(swing)
    found = saturation(st.Trial.read(table), vehicle)
    assert {one.command for one in found} == {names[0]}
    assert sorted(one.limit for one in found) == [-2000.0, 2000.0]
    assert [one.share for one in found] == pytest.approx([0.205, 0.205], abs=0.02)


def test_a_command_in_another_unit_is_beyond_its_limit_and_one_at_the_limit_is_not() -> None:
    vehicle = st.Vehicle.load("cwolf")
    names = vehicle.actuators
    table = {"t_s": T, "u_m_s": np.sin(T)} | {f"cmd.{name}": 0.0 * T for name in names}
    table[f"cmd.{names[0]}"] = np.where(T < 100.0, 0.0, 99999.0)
    table[f"cmd.{names[1]}"] = np.full(len(T), -2100.0)
    (found,) = excesses(st.Trial.read(table), vehicle)
    assert (found.command, found.reached, found.limit) == (names[0], 99999.0, 2000.0)
    assert found.share == pytest.approx(2.0 / 3.0, abs=0.01)
    assert excesses(st.Trial.read(table)) == []


def dived(stop_depth: float) -> st.Trial:
    """Heave pushed down and up in turn; a bottom stops the vehicle."""
    force = 20.0 * np.sign(np.sin(2.0 * np.pi * T / 60.0))
    z, w = np.zeros(len(T)), 0.0
    z[0] = 2.0
    for k in range(1, len(T)):
        w += 0.1 / 2.0 * (0.015 * force[k - 1] - w)
        z[k] = np.clip(z[k - 1] + 0.1 * w, 2.0, stop_depth)
    noise = np.random.default_rng(3).normal(0.0, 0.002, len(T))
    return st.Trial.read({"t_s": T, "z_m": z + noise, "tau.Z_n": force})


def test_constant_depth_under_a_downward_force_is_contact() -> None:
    free, aground = dived(100.0), dived(7.0)
    assert contacts(free, drives(free)) == []
    found = contacts(aground, drives(aground))
    assert len(found) >= 4
    assert {one.axis for one in found} == {"Z"}
    assert found[0].start_s == pytest.approx(20.0, abs=6.0)
    assert "pushed down by 20 N at a constant depth of 7.0 m: the bottom" in found[0].sentence


def test_a_depth_loop_that_holds_is_no_contact() -> None:
    rng = np.random.default_rng(4)
    force = -7.0 + rng.normal(0.0, 1.0, len(T)).cumsum() * 0.05
    trial = st.Trial.read({"t_s": T, "z_m": 3.0 + 0.01 * np.sin(0.3 * T), "tau.Z_n": force})
    assert contacts(trial, drives(trial)) == []
