"""Reversed and exchanged actuators are told from a log, and never where the vehicle file is right."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from seatrial._core import State, Vehicle
from seatrial.base.report import words_of
from seatrial.check.campaign import check_campaign
from seatrial.identification.preparation import prepare
from seatrial.inspect.wiring import wiring
from seatrial.intake.imported import import_logs
from seatrial.report.results.trial_findings import remedy
from seatrial.trial.trial import Trial

NOISE = np.array([0.02, 0.02, 0.02, 0.005, 0.005, 0.005])  # m/s, rad/s: a Doppler log and a gyro

USUAL = {"rpm": 1500.0, "us": 300.0, "N": 10.0, "rad": 0.3}


def table(name: str, seed: int, *, together: bool = False, seconds: float = 150.0) -> dict[str, Any]:
    """Log at 10 Hz of a vehicle under random steps of every actuator, or of groups in step."""
    vehicle, random = Vehicle.load(name), np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 0.1)
    facts = vehicle.actuator_info()
    finned = any(one["kind"] == "fin" for one in facts.values())
    commands: dict[str, Any] = {}
    first: dict[str, Any] = {}
    for actuator in vehicle.actuators:
        own = facts[actuator]
        largest = min(float(own["maximum_ahead"]), 2.0 * USUAL[own["unit"]])
        hold = int(random.integers(30, 80))
        count = len(t) // hold + 1
        levels = random.uniform(-0.35, 0.35, count)
        if own["kind"] == "fin":
            levels = random.choice([-0.5, 0.5], count) * random.uniform(0.3, 1.0, count)
        elif finned:  # under way
            levels = random.uniform(0.4, 0.8, count)
        moved = np.repeat(levels, hold)[: len(t)]
        moved = first.setdefault(own["group"], moved) if together else moved
        commands[actuator] = own["neutral"] + largest * moved
    voltage = np.full(len(t), 16.0) if any(one["needs_voltage"] for one in facts.values()) else None
    start = State(position=[0.0, 0.0, 20.0], nu=[1.0 if finned else 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    run = vehicle.simulate(t, commands, start, voltage_v=voltage)
    nu = np.asarray(run.nu) + NOISE * random.standard_normal((len(t), 6))
    euler = np.rad2deg(np.asarray(run.euler))
    log: dict[str, Any] = {"t_s": t, "z_m": np.asarray(run.position)[:, 2]}
    log |= dict(zip(("u_m_s", "v_m_s", "w_m_s"), nu[:, :3].T, strict=True))
    log |= dict(zip(("p_deg_s", "q_deg_s", "r_deg_s"), np.rad2deg(nu[:, 3:]).T, strict=True))
    log |= dict(zip(("roll_deg", "pitch_deg", "yaw_deg"), euler.T, strict=True))
    log |= {} if voltage is None else {"voltage_v": voltage}
    return log | {f"cmd.{actuator}": y for actuator, y in commands.items()}


def read(log: dict[str, Any]) -> Trial:
    return Trial.read(log, align=False, level=False)


def turned(trial: Trial, vehicle: Vehicle, *names: str) -> Trial:
    """The log with the commands of these actuators of the other sign about neutral."""
    facts = vehicle.actuator_info()
    opposite = {name: 2.0 * facts[name]["neutral"] - trial.commands[name] for name in names}
    return replace(trial, commands=trial.commands | opposite)


def exchanged(trial: Trial, a: str, b: str) -> Trial:
    return replace(trial, commands=trial.commands | {a: trial.commands[b], b: trial.commands[a]})


@pytest.mark.parametrize("together", [False, True])
@pytest.mark.parametrize("name", Vehicle.names())
def test_the_right_wiring_is_no_finding(name: str, together: bool) -> None:
    assert wiring(read(table(name, 1, together=together)), Vehicle.load(name), loops=[]) is None


@pytest.mark.parametrize(
    ("name", "actuators"),
    [
        ("bluerov2-heavy", ("thruster_5",)),
        ("bluerov2-heavy", ("thruster_1", "thruster_2")),
        ("beluga", ("thruster_4",)),
        ("cwolf", ("PL",)),
        ("remus100", ("rudder_upper", "rudder_lower")),
        ("lauv", ("stern_plane_port", "stern_plane_starboard")),
    ],
)
def test_reversed_actuators_are_named(name: str, actuators: tuple[str, ...]) -> None:
    vehicle = Vehicle.load(name)
    found = wiring(turned(read(table(name, 2)), vehicle, *actuators), vehicle, loops=[])
    assert found is not None
    assert found.reversed == actuators
    assert found.exchanged == ()
    assert f"sign = -1 to cmd.{actuators[0]}" in remedy(found.finding())


@pytest.mark.parametrize(
    ("name", "pair"),
    [
        ("bluerov2-heavy", ("thruster_6", "thruster_8")),
        ("beluga", ("thruster_5", "thruster_7")),
        ("cwolf", ("VTB", "VTS")),
        ("remus100", ("rudder_lower", "stern_plane_starboard")),
    ],
)
def test_exchanged_actuators_are_named(name: str, pair: tuple[str, str]) -> None:
    vehicle = Vehicle.load(name)
    found = wiring(exchanged(read(table(name, 3)), *pair), vehicle, loops=[])
    assert found is not None
    assert found.exchanged == (pair,)
    assert f"exchange the columns of cmd.{pair[0]} and cmd.{pair[1]}" in remedy(found.finding())


def test_what_the_log_cannot_tell_is_not_told() -> None:
    # Of a group in step and without roll, one of two rudders that is reversed looks like two weak ones.
    vehicle = Vehicle.load("remus100")
    log = table("remus100", 4, together=True)
    for name in ("p_deg_s", "roll_deg"):
        del log[name]
    assert wiring(turned(read(log), vehicle, "rudder_upper"), vehicle, loops=[]) is None
    # Commands at rest tell nothing.
    still = {key: np.full_like(y, y[0]) if key.startswith("cmd.") else y for key, y in log.items()}
    assert wiring(read(still), vehicle, loops=[]) is None


def heading_loop(swell: float) -> Trial:
    """REMUS 100 whose rudder answers its heading, in waves that turn it; set points every half minute."""
    vehicle, random = Vehicle.load("remus100"), np.random.default_rng(7)
    count = 4000
    yaw, rate, delta, target = np.zeros(count), np.zeros(count), np.zeros(count), 0.0
    for k in range(1, count):
        target += random.choice([-0.3, 0.3]) if k % 300 == 0 else 0.0
        # Positive rudder turns to port.
        delta[k] = np.clip(-0.8 * (target - yaw[k - 1]) + 0.5 * rate[k - 1], -0.23, 0.23)
        wave = swell * np.sin(2.0 * np.pi * 0.1 * k / 6.0) + 0.3 * swell * random.standard_normal()
        rate[k] = rate[k - 1] + 0.1 * (-1.0 * delta[k - 1] - rate[k - 1] + wave)
        yaw[k] = yaw[k - 1] + 0.1 * rate[k]
    log = {
        "t_s": 0.1 * np.arange(count),
        "u_m_s": 1.5 + 0.01 * random.standard_normal(count),
        "r_deg_s": np.rad2deg(rate + 0.003 * random.standard_normal(count)),
        "yaw_deg": np.rad2deg(yaw),
        "cmd.propeller": np.full(count, 1200.0),
    }
    return read(log | dict.fromkeys((f"cmd.{name}" for name in vehicle.actuators if "rudder" in name), delta))


@pytest.mark.parametrize("swell", [0.02, 0.1, 0.3])
def test_a_rudder_that_answers_waves_is_not_taken_for_reversed(swell: float) -> None:
    vehicle = Vehicle.load("remus100")
    assert wiring(heading_loop(swell), vehicle) is None


def test_import_check_and_identify_say_it_before_the_search(tmp_path: Path) -> None:
    log = table("remus100", 5)
    for name in ("rudder_upper", "rudder_lower"):
        log[f"cmd.{name}"] = -log[f"cmd.{name}"]
    pl.DataFrame(log).write_csv(tmp_path / "zigzag.csv")
    made = import_logs(tmp_path / "zigzag.csv", vehicle="remus100", out=tmp_path / "project")
    assert "rudder_upper and rudder_lower act against their signs" in made.report().worst
    from seatrial.campaign.campaign import Campaign

    campaign = Campaign.load(tmp_path / "project" / "campaign.toml")
    said = check_campaign(campaign).report()
    assert "rudder_upper and rudder_lower act against their signs" in said.worst
    assert said.next_step.startswith("toggle the key reversed of these actuators in the vehicle file")
    ready = prepare(campaign.problem())
    assert [(finding.kind, finding.subject) for finding in ready.findings] == [("wiring", "zigzag")]
    assert any(words_of(ready.findings[0]) in sentence for sentence in ready.sentences)
