"""ArduPilot's simulator link: lock-step with a scripted peer, and packets that are not to be believed."""

from __future__ import annotations

import json
import math
import shutil
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import seatrial as st
from seatrial.ardusub.parameters import map_channels
from seatrial.base.errors import SimulationError, TrialError
from seatrial.cli import app
from seatrial.realtime import ardupilot_link as link
from seatrial.realtime.ardupilot_link import MAGIC_16, MAGIC_32, ServoPacket
from seatrial.realtime.plant import Plant

VEHICLE = st.Vehicle.load("bluerov2-heavy")
AHEAD = [1600, 1600, 1400, 1400, *[1500] * 12]
PEER = ("127.0.0.1", 5000)


def _packet(count: int, pwm: list[int] | None = None, rate: int = 400, magic: int = MAGIC_16) -> bytes:
    """A servo packet, packed here and not by what is tested."""
    pulses = AHEAD if pwm is None else pwm
    return struct.pack(f"<HHI{len(pulses)}H", magic, rate, count, *pulses)


def _loop(**options: Any) -> link._Loop:
    plant = Plant(VEHICLE, voltage_v=16.0)
    given: dict[str, Any] = {"shown": None, "seabed_m": None, "log_hz": 0.0} | options
    return link._Loop(plant, map_channels(VEHICLE).channels, **given)


@contextmanager
def _serving(**options: Any) -> Iterator[tuple[socket.socket, tuple[str, int], list[st.SitlSession]]]:
    """A session in a thread with a socket of its peer."""
    address: list[tuple[str, int]] = []
    listens = threading.Event()
    sessions: list[st.SitlSession] = []

    def ready(where: tuple[str, int]) -> None:
        address.append(where)
        listens.set()

    def serve() -> None:
        given: dict[str, Any] = {"port": 0, "idle_s": 5.0, "voltage_v": 16.0, "ready": ready} | options
        sessions.append(st.sitl(VEHICLE, **given))

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        assert listens.wait(10.0)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
            peer.settimeout(10.0)
            yield peer, address[0], sessions
    finally:
        thread.join(20.0)


def test_a_peer_in_lock_step_flies_the_vehicle_of_simulate() -> None:
    with _serving(max_frames=200, seabed_m=10.0, log_hz=50.0) as (peer, address, sessions):
        for count in range(200):
            peer.sendto(_packet(count), address)
            line = peer.recv(4096)
    assert line.startswith(b"\n{")
    assert line.endswith(b"}\n")
    told = json.loads(line)
    commands = {f"thruster_{k + 1}": float(AHEAD[k]) for k in range(8)}
    # It begins afloat, not with its middle in the surface.
    afloat = st.State(position=[0.0, 0.0, VEHICLE.floating_depth()])
    t, supply = np.linspace(0.0, 0.5, 201), np.full(201, 16.0)
    run = VEHICLE.simulate(t, commands, afloat, voltage_v=supply, surface=0.0)
    np.testing.assert_allclose(told["position"], run.position[-1], rtol=0, atol=1e-10)
    np.testing.assert_allclose(told["quaternion"], run.attitude[-1], rtol=0, atol=1e-10)
    np.testing.assert_allclose(told["imu"]["gyro"], run.nu[-1, 3:], rtol=0, atol=1e-10)
    # Velocity in the earth frame: the derivative of the position, to the step of 2.5 ms.
    slope = (run.position[-1] - run.position[-2]) / 0.0025
    np.testing.assert_allclose(told["velocity"], slope, atol=5e-3)
    assert told["velocity"][0] > 0.1
    assert told["timestamp"] == pytest.approx(0.5)
    assert told["rng_1"] == pytest.approx((10.0 - run.position[-1, 2]) / math.cos(run.euler[-1, 1]), rel=1e-6)
    assert set(told) == {"timestamp", "imu", "position", "quaternion", "velocity", "rng_1"}
    (session,) = sessions
    assert (session.ended, session.frames, session.lost, session.resets) == ("frames", 200, 0, 0)
    table = session.table()
    assert table.height == 25
    trial = st.Trial.read(table)
    assert trial.dt == pytest.approx(0.02)


def test_packets_of_32_channels_drive_channels_beyond_16() -> None:
    packet = ServoPacket.parse(_packet(7, list(range(1100, 1132)), magic=MAGIC_32))
    assert isinstance(packet, ServoPacket)
    assert (packet.frame_count, packet.pwm[31]) == (7, 1131)
    assert packet.bytes() == _packet(7, list(range(1100, 1132)), magic=MAGIC_32)
    plant = Plant(VEHICLE, voltage_v=16.0)
    channels = map_channels(VEHICLE, {"thruster_1": 20}).channels
    loop = link._Loop(plant, channels, None, None, 0.0)
    pulses = [1500] * 32
    pulses[19] = 1700
    for count in range(50):
        loop.take(_packet(count, pulses, magic=MAGIC_32), PEER, 0.01 * count)
    assert plant.actuators["thruster_1"] == pytest.approx(1700.0, abs=5.0)


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "short"),
        (b"\x00" * 7, "short"),
        (_packet(1)[:-1], "short"),
        (_packet(1) + b"\x00", "long"),
        (_packet(1, magic=29570), "magic"),
        (_packet(1, magic=MAGIC_32), "short"),
        (_packet(1, rate=0), "rate"),
        (_packet(1, rate=30_000), "rate"),
        (_packet(1, [65535] * 16), "pulse"),
        (b"GET / HTTP/1.1\r\nHost: vehicle\r\n\r\n" + b"x" * 900, "magic"),
    ],
)
def test_hostile_packets_are_passed_over_and_counted(data: bytes, why: str) -> None:
    loop = _loop()
    assert loop.take(data, PEER, 0.0) is None
    assert loop.link.ignored == {why: 1}
    assert loop.link.frames == 0
    assert loop.take(_packet(1), PEER, 0.1) is not None


def test_late_duplicate_and_strange_packets_move_nothing() -> None:
    loop = _loop()
    for count in range(10, 15):
        last = loop.take(_packet(count), PEER, 0.01 * count)
    before = loop.plant.motion.t_s
    assert loop.take(_packet(12), PEER, 0.15) is None
    assert loop.take(_packet(14), PEER, 0.16) is None
    assert loop.take(_packet(15), ("127.0.0.1", 6000), 0.17) is None
    assert loop.plant.motion.t_s == before
    assert loop.link.ignored == {"late": 1, "duplicate": 1, "stranger": 1}
    # ArduPilot asks again when the answer was lost: it gets the same one.
    assert loop.take(_packet(14), PEER, 10.2) == last
    assert loop.plant.motion.t_s == before


def test_lost_frames_are_made_up_for_and_a_new_beginning_resets() -> None:
    loop = _loop()
    for count in (1, 2, 6):
        loop.take(_packet(count), PEER, 0.0)
    assert loop.link.lost == 3
    assert loop.plant.motion.t_s == pytest.approx(6 / 400)
    told = json.loads(loop.take(_packet(1), PEER, 1.0) or b"")
    assert loop.link.resets == 1
    assert told["timestamp"] == pytest.approx(1 / 400)
    # A new process of ArduPilot has another port and takes over after silence.
    assert json.loads(loop.take(_packet(500), ("127.0.0.1", 6000), 4.0) or b"")["timestamp"] == 1 / 400
    assert loop.link.resets == 2


def test_sensors_make_the_answer_noisy_and_late_but_not_the_motion() -> None:
    from seatrial.realtime.plant import Shown
    from seatrial.sensors.sensor import Sensor

    clean, noisy = _loop(), _loop(shown=Shown({"gyro": Sensor(noise=0.5), "depth": Sensor(bias=0.1)}))
    for count in range(20):
        truth = json.loads(clean.take(_packet(count), PEER, 0.0) or b"")
        seen = json.loads(noisy.take(_packet(count), PEER, 0.0) or b"")
    assert truth["imu"]["gyro"] != seen["imu"]["gyro"]
    assert truth["position"][2] != seen["position"][2]
    assert truth["position"][:2] == seen["position"][:2]
    assert (clean.plant.motion.nu == noisy.plant.motion.nu).all()


def test_a_motion_without_bounds_ends_the_session() -> None:
    """Damping of the wrong sign, so that the vehicle grows ever faster."""
    wild = VEHICLE.with_coefficients({"X_uu": 5e4, "X_u": 5e4})
    loop = link._Loop(Plant(wild, voltage_v=16.0), map_channels(wild).channels, None, None, 0.0)
    for count in range(4000):
        reply = loop.take(_packet(count, rate=50), PEER, 0.0)
        if loop.diverged:
            break
    assert loop.diverged
    assert reply is None


def test_silence_ends_a_session_and_says_so() -> None:
    session = st.sitl(VEHICLE, port=0, idle_s=0.05, voltage_v=16.0)
    assert (session.ended, session.frames) == ("idle", 0)
    good, _, following = session.report().lines()
    assert "No packet of ArduPilot came" in good
    assert "--model JSON:127.0.0.1" in following


def test_what_cannot_be_served_is_refused() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        with pytest.raises(SimulationError, match="cannot listen"):
            st.sitl(VEHICLE, port=taken.getsockname()[1], voltage_v=16.0)
    with pytest.raises(SimulationError, match="idle_s: expected a positive time"):
        st.sitl(VEHICLE, idle_s=0.0, voltage_v=16.0)
    with pytest.raises(TrialError, match="unknown actuator"):
        st.sitl(VEHICLE, channels={"propeller": 1}, voltage_v=16.0)


def test_ctrl_c_ends_the_verb_with_130_and_the_log_is_written(tmp_path: Any) -> None:
    log = tmp_path / "dive.csv"
    command = [sys.executable, "-m", "seatrial", "sitl", "bluerov2-heavy", "--voltage", "16", "--port", "0"]
    with subprocess.Popen(
        [*command, "--log", str(log)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as verb:
        assert verb.stderr is not None
        told = verb.stderr.readline()
        port = int(told.split("127.0.0.1:")[1].split(";")[0])
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
            peer.settimeout(10.0)
            for count in range(12):
                peer.sendto(_packet(count, rate=10), ("127.0.0.1", port))
                peer.recv(4096)
        verb.send_signal(signal.SIGINT)
        out, _ = verb.communicate(timeout=20)
    assert verb.returncode == 130
    assert out.startswith("sitl bluerov2-heavy: interrupted. 12 frames")
    assert st.Trial.read(log).channels


def _sail(log: Path, *options: str, before_end: Callable[[], None] | None = None) -> Result:
    """The verb with a peer of twelve frames that writes its log there."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]

    def peer() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.settimeout(0.2)
            count = 0
            while count < 12:
                sender.sendto(_packet(count, rate=10), ("127.0.0.1", port))
                try:
                    sender.recv(4096)
                except OSError:  # it does not listen yet
                    time.sleep(0.05)
                    continue
                count += 1
        if before_end is not None:
            before_end()

    thread = threading.Thread(target=peer)
    thread.start()
    command = ["sitl", "bluerov2-heavy", "--voltage", "16", "--port", str(port), "--log", str(log)]
    try:
        return CliRunner().invoke(app, [*command, "--idle-s", "3", *options])
    finally:
        thread.join(20.0)


def test_a_log_goes_into_any_folder_and_into_one_that_is_made(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("not a run", encoding="utf-8")
    for log in (tmp_path / "dive.csv", tmp_path / "deep" / "down" / "dive.csv"):
        result = _sail(log)
        assert result.exit_code == 0, result.output
        assert f"Motion in {log}" in result.stdout.replace("\n", "")
        assert st.Trial.read(log).channels
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["deep", "dive.csv", "notes.txt"]


def test_a_log_that_cannot_be_written_is_refused_before_the_session(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    command = ["sitl", "bluerov2-heavy", "--voltage", "16", "--port", "0", "--idle-s", "0.1", "--log"]
    for log, message in (
        (tmp_path / "file" / "dive.csv", "is a file, not a folder"),
        (tmp_path / "taken.csv", "found a folder"),
    ):
        (tmp_path / "taken.csv").mkdir(exist_ok=True)
        result = CliRunner().invoke(app, [*command, str(log)])
        assert result.exit_code == 2
        assert message in " ".join(result.output.split())
        assert "frames" not in result.stdout


def test_a_session_is_told_even_where_its_log_can_no_longer_be_written(tmp_path: Path) -> None:
    log = tmp_path / "deep" / "dive.csv"
    result = _sail(log, before_end=lambda: shutil.rmtree(log.parent))
    assert result.exit_code == 2
    assert "sitl bluerov2-heavy: " in result.stdout
    assert "12 frames" in result.stdout
    assert "cannot be written" in " ".join(result.output.split())
