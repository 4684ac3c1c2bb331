"""Suspects: the change that was made is named first, with its size, and what it cannot be told from."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from scipy.spatial.transform import Rotation

import seatrial as st
from seatrial.base.frames import continuous
from seatrial.verification.mission_log.spread import Spread, restarts, spread_of_reference
from seatrial.verification.mission_log.suspects import Suspect, candidates, payload, suspects
from tests.verification.recorded_logs import MISSION, fitted, log


def found(changes: dict[str, float]) -> tuple[Suspect, ...]:
    model = fitted().vehicle
    windows = restarts(model, log(4, tuple(changes.items())).trial)
    return suspects(windows, spread(), candidates(model, identified=fitted().names))


def spread() -> Spread:
    return spread_of_reference([restarts(fitted().vehicle, log(100).trial)])


def test_a_payload_is_named_with_its_weight_and_place() -> None:
    first = found(payload(fitted().vehicle).changes(np.array([3.0, 1.2])))[0]
    assert first.name.startswith("payload")
    assert "payload" in first.change
    assert "in water at x =" in first.change
    wet, moment = first.values
    # 3 kg at 0.4 m; the density that the suspect assumes is that of the payload, the rest is noise.
    assert wet == pytest.approx(3.0, rel=0.15)
    assert moment == pytest.approx(1.2, rel=0.15)


def test_more_drag_ahead_is_named_with_its_share() -> None:
    values = fitted().vehicle.coefficients()
    first = found({name: 1.25 * values[name] for name in ("X_u", "X_uu")})[0]
    assert first.name == "drag ahead (X_u, X_uu)"
    assert first.values[0] == pytest.approx(0.25, abs=0.03)
    assert "X_uu" in first.alike  # one speed does not tell the linear from the quadratic part


def test_lost_buoyancy_cannot_be_told_from_weight() -> None:
    listed = found({"B": fitted().vehicle.coefficients()["B"] - 15.0})
    ballast = next(one for one in listed if one.name == "B")
    assert ballast.values[0] == pytest.approx(-15.0, abs=2.0)
    assert "m" in ballast.alike


def test_a_thrust_that_no_command_tells_names_its_actuator() -> None:
    """A vertical thruster pushes in pulses while the log has it at rest: no gain explains that."""
    # From 2 m down: the model has no surface, and commands that dive a floating vehicle move it otherwise.
    begins = re.sub(r"(?m)^depth_m = \S+", "depth_m = 2.0", MISSION.to_toml(), count=1)  # of [start]
    flown_log = st.fly(
        "cwolf", "cwolf", st.Mission.from_toml(begins), conditions=st.Conditions(sensors="typical"), seed=6
    ).table()
    model, trial = fitted().vehicle, st.MissionLog.read(flown_log).trial
    pulses = np.where(np.sin(0.31 * trial.t) > 0.6, 300.0, 0.0)
    flown = model.simulate(
        trial.t, trial.commands | {"VTB": pulses}, initial=st.State(*trial.state(10)), max_step_s=0.05
    )
    columns = {"t_s": trial.t} | {name: flown.nu[:, k] for k, name in enumerate(("u_m_s", "v_m_s", "w_m_s"))}
    columns |= {
        name: np.degrees(flown.nu[:, 3 + k]) for k, name in enumerate(("p_deg_s", "q_deg_s", "r_deg_s"))
    }
    columns |= {
        name: np.degrees(flown.euler[:, k]) for k, name in enumerate(("roll_deg", "pitch_deg", "yaw_deg"))
    }
    columns |= {"z_m": flown.position[:, 2]} | {f"cmd.{name}": x for name, x in trial.commands.items()}
    silent = st.Trial.read(columns, align=False)
    listed = suspects(restarts(model, silent), spread(), candidates(model, identified=fitted().names))
    assert (listed[0].kind, listed[0].name) == ("actuator", "VTB"), [one.change for one in listed]
    assert "does not produce the thrust that its commands ask for" in listed[0].change
    assert listed[0].p < 0.01
    assert listed[0].coefficients == {}


def test_a_sensor_that_reads_too_much_is_named_and_no_payload() -> None:
    told = log(4).trial
    wrong = told.observed.copy()
    wrong[:, 10] += np.radians(1.0)
    turned = Rotation.from_quat(told.attitude, scalar_first=True).as_euler("ZYX")
    turned[:, 1] += np.radians(1.0)
    attitude = continuous(Rotation.from_euler("ZYX", turned).as_quat(scalar_first=True))[0]
    trial = replace(told, observed=wrong, attitude=attitude)
    model = fitted().vehicle
    first = suspects(restarts(model, trial), spread(), candidates(model, identified=fitted().names))[0]
    assert (first.kind, first.name) == ("sensor", "offset of pitch"), first.change
    # What else the log leaves goes into it: a quarter of a degree in the logs that were tried.
    assert first.values[0] == pytest.approx(np.radians(1.0), abs=np.radians(0.35))
    assert "deg too much" in first.change


def test_no_actuator_is_said_to_give_twice_its_thrust() -> None:
    model = fitted().vehicle
    weak = model.with_coefficients({"SbU.gain": 0.35})
    listed = suspects(restarts(weak, log(4).trial), spread(), candidates(weak))
    gains = [one for one in listed if one.name.endswith(".gain")]
    assert all(one.coefficients[one.name] <= 2.0 * weak.coefficients()[one.name] for one in gains)


@given(some.floats(-5.0, 5.0), some.floats(-3.0, 3.0))
@settings(max_examples=40, deadline=None)
def test_law_a_payload_moves_the_weight_in_water_and_its_moment(wet: float, moment: float) -> None:
    vehicle = st.Vehicle.load("cwolf")
    g = vehicle.environment()["g"]
    before = vehicle.coefficients()
    after = before | payload(vehicle).changes(np.array([wet, moment]))

    def weight(values: dict[str, float]) -> tuple[float, float]:
        load = values["m"] * g
        return load - values["B"], values["x_g"] * load - values["x_b"] * values["B"]

    # Both are differences of numbers of about 1300 N: 1e-9 is their rounding.
    assert weight(after)[0] - weight(before)[0] == pytest.approx(wet * g, abs=1e-9)
    assert weight(after)[1] - weight(before)[1] == pytest.approx(moment * g, abs=1e-9)


def test_no_change_changes_nothing() -> None:
    vehicle = st.Vehicle.load("cwolf")
    present = vehicle.coefficients()
    for one in candidates(vehicle):
        for name, value in one.changes(np.zeros(len(one.scale))).items():
            assert value == pytest.approx(present.get(name, 0.0), rel=1e-12, abs=1e-12), one.name
