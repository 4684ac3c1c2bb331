"""A flight by the clock is the flight of `st.fly`, and hardware at the other end of a bad link steers it."""

from __future__ import annotations

import random
import socket
import struct
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import seatrial as st
from seatrial.base.errors import SimulationError
from seatrial.realtime.flight import fly_realtime
from seatrial.realtime.hardware import command_packet

MISSION = st.Mission.from_toml("""
format = 1
name = "out"
speed_m_s = 1.5
acceptance_radius_m = 5.0
[[legs]]
north_m = 20.0
east_m = 0.0
depth_m = 2.0
""")
FAST = 1000.0  # times real time: the tests do not wait for the clock


def test_law_with_perfect_sensors_it_is_the_flight_of_fly() -> None:
    flight = st.fly("cwolf", "cwolf", MISSION, water=st.Water(current=(0.0, 0.2, 0.0)))
    paced = fly_realtime("cwolf", "cwolf", MISSION, water=st.Water(current=(0.0, 0.2, 0.0)), speed=FAST)
    assert paced.outcome == flight.outcome == "complete"
    table = paced.table()
    np.testing.assert_allclose(table["x_m"], flight.position[:, 0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(table["z_m"], flight.position[:, 2], rtol=0, atol=1e-9)
    np.testing.assert_allclose(table["cmd.PU"], flight.commands["PU"], rtol=0, atol=1e-6)
    assert len(paced.timing.lateness) == table.height


def test_time_that_is_up_and_bad_numbers_are_said(tmp_path: Path) -> None:
    paced = fly_realtime(
        "cwolf", "cwolf", MISSION, conditions=st.Conditions(max_time_s=2.0, sensors="typical"), speed=FAST
    )
    assert (paced.outcome, paced.complete) == ("time is up", False)
    good, _, _ = paced.report().lines()
    assert "21 ticks" in good
    folder = paced.save(tmp_path / "run")
    assert {"flight.json", "flight.parquet", "run.json", "summary.txt", "mission.toml"} <= {
        path.name for path in folder.iterdir()
    }
    for speed in (0.0, -1.0, float("nan"), 1e9):
        with pytest.raises(SimulationError, match="speed: expected"):
            fly_realtime("cwolf", "cwolf", MISSION, speed=speed)
    with pytest.raises(SimulationError, match="voltage_v: the thrust of"):
        fly_realtime("bluerov2-heavy", "bluerov2-heavy", MISSION, speed=FAST)


def test_a_flight_beyond_the_largest_depth_is_not_complete() -> None:
    paced = fly_realtime("cwolf", "cwolf", MISSION, speed=FAST)
    assert paced.complete
    assert paced.max_depth_m == np.inf
    deepest = float(paced.table()["z_m"].to_numpy().max())
    for limit, kept in ((deepest - 0.04, True), (deepest - 0.06, False)):
        judged = replace(paced, max_depth_m=limit)
        assert judged.complete is judged.to_dict()["complete"] is kept
    told = judged.report()
    assert told.outcome == "complete, beyond the mission's largest depth"
    assert told.worst.startswith(f"it went {deepest:.2f} m deep; the mission's largest depth is {limit:g} m")


class Autopilot(threading.Thread):
    """Hardware: takes packets of sensors apart by the layout, steers by a helm, answers over a bad link."""

    def __init__(self, loss: float, delay: int) -> None:
        super().__init__(daemon=True)
        self.link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.link.bind(("127.0.0.1", 0))
        self.link.settimeout(5.0)
        self.loss, self.delay = loss, delay
        self.steps = 0

    def run(self) -> None:
        vehicle = st.Vehicle.load("cwolf")
        helm = st.Autopilot.load("cwolf").engage(vehicle, MISSION)
        dice = random.Random(3)
        waiting: list[bytes] = []
        while True:
            try:
                data, sender = self.link.recvfrom(2048)
            except (TimeoutError, OSError):
                return
            _, _, _, sequence, time_us = struct.unpack_from("<IHHIQ", data)
            x, y, z = struct.unpack_from("<3d", data, 20)
            roll, pitch, yaw, u, v, w, p, q, r = struct.unpack_from("<9f", data, 44)
            seen = {"x": x, "y": y, "z": z, "roll": roll, "pitch": pitch, "yaw": yaw}
            seen |= {"u": u, "v": v, "w": w, "p": p, "q": q, "r": r}
            commands = helm.step(seen, time_s=time_us * 1e-6)
            self.steps += 1
            values = [commands[name] for name in vehicle.actuators]
            waiting.append(command_packet(values, self.steps, sequence))
            if len(waiting) > self.delay and dice.random() >= self.loss:
                self.link.sendto(waiting.pop(0), sender)
            waiting = waiting[-self.delay - 1 :]


@pytest.mark.parametrize(("loss", "delay"), [(0.0, 0), (0.3, 2)])
def test_hardware_steers_over_a_link_with_loss_and_delay(loss: float, delay: int) -> None:
    """Ahead to 1 m/s or more within 12 s, although a third of the packets is lost and the others are late."""
    hardware = Autopilot(loss, delay)
    hardware.start()
    try:
        paced = fly_realtime(
            "cwolf",
            "cwolf",
            MISSION,
            hardware=hardware.link.getsockname(),
            conditions=st.Conditions(max_time_s=12.0),
            speed=20.0,
            watchdog_s=2.0,
        )
    finally:
        hardware.link.close()
    facts = paced.hardware
    assert facts is not None
    assert facts.sent == 121
    assert facts.taken > 30
    assert paced.table()["x_m"][-1] > 4.0
    assert np.abs(np.array(paced.table()["y_m"])).max() < 2.0
    if loss:
        assert facts.lost > 10
        assert "lost" in paced.report().text()


def test_without_hardware_at_the_address_the_actuators_rest() -> None:
    paced = fly_realtime(
        "cwolf",
        "cwolf",
        MISSION,
        hardware=("127.0.0.1", 9),
        conditions=st.Conditions(max_time_s=1.0),
        speed=FAST,
        watchdog_s=0.1,
    )
    assert paced.hardware is not None
    assert paced.hardware.taken == 0
    assert paced.hardware.neutral_periods == paced.hardware.sent == 11
    assert "no good one came back" in paced.report().text()


def test_the_verb_says_how_it_kept_time_and_refuses_what_it_has_not(tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from seatrial.cli import app

    mission = tmp_path / "out.toml"
    mission.write_text(MISSION.to_toml(), encoding="utf-8")
    run = CliRunner()
    command = ["realtime", "cwolf", "cwolf", str(mission), "--speed", "1000", "--max-time", "5"]
    made = run.invoke(app, [*command, "--out", str(tmp_path / "run")])
    assert made.exit_code == 1  # not complete in five seconds
    assert made.stdout.startswith("cwolf: time is up.")
    assert "ticks of 0.1 ms" in made.stdout
    assert run.invoke(app, [*command, "--waves", "1", "6", "0"]).exit_code == 2
    assert run.invoke(app, [*command, "--hardware", "nowhere"]).exit_code == 2
    moved = run.invoke(app, ["fly", "cwolf", "cwolf", str(mission), "--live", "0"])
    assert moved.exit_code == 2
    assert "use `seatrial realtime VEHICLE AUTOPILOT MISSION --live`" in moved.output
