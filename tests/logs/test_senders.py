"""Clocks of the senders of a log: other origins, counters of 32 bits that begin again, reboots."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seatrial.logs.clock import Counter32
from seatrial.logs.log import Samples, open_log
from seatrial.logs.mavlink import SenderClocks

UNIX_S = 1.7e9
T = np.arange(0.0, 60.0, 0.2)


def _tlog(path: Path, messages: Sequence[tuple[float, int, int, Any]]) -> Path:
    """Telemetry of messages (reception after the start in s, system, component, message)."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    parts = []
    for received, system, component, message in sorted(messages, key=lambda one: one[0]):
        sender = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        parts.append(struct.pack(">Q", round((UNIX_S + received) * 1e6)) + message.pack(sender))
    path.write_bytes(b"".join(parts))
    return path


def _attitude(boot_s: float, roll: float) -> Any:
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    return mavlink.MAVLink_attitude_message(round(boot_s * 1e3) % 2**32, roll, 0.0, 0.0, 0.0, 0.0, 0.0)


def _servo(boot_s: float, pulse: int) -> Any:
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    return mavlink.MAVLink_servo_output_raw_message(
        round(boot_s * 1e6) % 2**32, 0, pulse, 0, 0, 0, 0, 0, 0, 0
    )


def _delta(boot_s: float) -> Any:
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    return mavlink.MAVLink_vision_position_delta_message(
        round(boot_s * 1e6), 200_000, [0.0, 0.0, 0.0], [0.2, 0.0, 0.0], 100.0
    )


def _stamps(path: Path, topic: str) -> np.ndarray:
    log = open_log(path)
    return log.read({topic: [next(iter(log.fields[topic]))]})[topic].t - UNIX_S


@pytest.mark.parametrize("begin_s", [100.0, 4270.0, 4800.0, 3.0 * 4294.967296 - 30.0, 2.0**32 * 1e-3 - 30.0])
def test_law_a_counter_of_32_bits_that_began_again_is_where_the_other_stamps_are(
    begin_s: float, tmp_path: Path
) -> None:
    # Microseconds end after 71.6 minutes, milliseconds after 49.7 days; within the log and before it.
    messages = [(t + 0.01, 1, 1, _attitude(begin_s + t, t)) for t in T]
    messages += [(t + 0.01, 1, 1, _servo(begin_s + t, 1500)) for t in T]
    path = _tlog(tmp_path / "dive.tlog", messages)
    for topic in ("ATTITUDE", "SERVO_OUTPUT_RAW[0]"):
        assert np.allclose(_stamps(path, topic), T + 0.01, atol=0.002)  # s: rounding to ms


def test_each_sender_has_a_clock_of_its_own(tmp_path: Path) -> None:
    late = np.random.default_rng(1).uniform(0.0, 0.15, len(T))
    late[::40] = 0.0
    messages = [(t + d, 1, 1, _attitude(100.0 + t, t)) for t, d in zip(T, late, strict=True)]
    messages += [(t + d, 1, 191, _delta(60.0 + t)) for t, d in zip(T, late[::-1], strict=True)]
    path = _tlog(tmp_path / "dive.tlog", messages)
    assert np.allclose(_stamps(path, "VISION_POSITION_DELTA@1.191"), T, atol=0.002)
    assert np.allclose(_stamps(path, "ATTITUDE"), T, atol=0.002)
    log = open_log(path)
    assert "component 1.191 (VISION_POSITION_DELTA): it began 40.0 s after" in " ".join(log.remarks)


def test_a_message_type_with_another_clock_than_its_sender_is_aligned(tmp_path: Path) -> None:
    messages = [(t, 1, 1, _attitude(100.0 + t, t)) for t in T] + [(t, 1, 1, _delta(7.0 + t)) for t in T]
    path = _tlog(tmp_path / "dive.tlog", messages)
    assert np.allclose(_stamps(path, "VISION_POSITION_DELTA"), T, atol=0.002)


def test_an_autopilot_that_was_started_again_goes_on_in_time(tmp_path: Path) -> None:
    messages = [(t, 1, 1, _attitude(1000.0 + t if t < 30.0 else t - 29.0, t)) for t in T]
    path = _tlog(tmp_path / "dive.tlog", messages)
    assert np.allclose(_stamps(path, "ATTITUDE"), T, atol=0.002)


def test_two_vehicles_in_one_telemetry_log_are_two_sources(tmp_path: Path) -> None:
    messages = [(t, 2, 1, _attitude(900.0 + t, 9.0)) for t in T[::3]]
    messages += [(t, 1, 1, _attitude(100.0 + t, t)) for t in T]
    log = open_log(_tlog(tmp_path / "two.tlog", messages))
    assert set(log.fields) == {"ATTITUDE", "ATTITUDE@2.1"}
    read: Samples = log.read({"ATTITUDE": ["roll"]})["ATTITUDE"]
    assert np.allclose(read.fields["roll"], T, atol=1e-4)  # single precision


def test_a_slow_link_that_catches_up_is_no_other_clock() -> None:
    clocks = SenderClocks()
    received = T + np.where((T > 20.0) & (T < 26.0), 26.0 - T, 0.0)  # held for 6 s, then all at once
    for t, r in zip(T, received, strict=True):
        clocks.learn("a", "a", 5.0 + t, r)
    clocks.settle()
    assert [round(origin, 6) for *_, origin, _ in clocks.origins()] == [-5.0]


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e-3), ("us", 1e-6)])
@pytest.mark.parametrize("kind", ["csv", "parquet", "matlab", "frame"])
def test_law_stamps_of_32_bits_go_on_past_their_end(
    kind: str, unit: str, factor: float, tmp_path: Path
) -> None:
    import polars as pl

    counts = (np.round((T - 20.03) / factor) % 2.0**32).astype(np.int64)
    table = {f"time_{unit}": counts, "depth_m": np.sin(T)}
    if kind == "frame":
        import seatrial as st

        columns = {"t_s": {"from": f"time_{unit}", "unit": unit}, "z_m": "depth_m"}
        trial = st.Trial.read(pl.DataFrame(table), columns=columns)
        assert math.isclose(trial.t[-1] - trial.t[0], T[-1], abs_tol=0.01)
        return
    path = tmp_path / {"csv": "log.csv", "parquet": "log.parquet", "matlab": "log.mat"}[kind]
    if kind == "csv":
        pl.DataFrame(table).write_csv(path)
    elif kind == "parquet":
        pl.DataFrame(table).write_parquet(path)
    else:
        from scipy.io import savemat

        savemat(path, {"nav": {name: values.astype(float) for name, values in table.items()}})
    [topic] = open_log(path).topics()
    assert math.isclose(topic.end_s - topic.start_s, T[-1], abs_tol=0.01)
    assert topic.disordered == 0


def test_a_counter_that_was_started_again_is_no_counter_that_passed_its_end() -> None:
    counts = np.array([2.2e9, 2.3e9, 0.0, 1e8])  # microseconds, 38 minutes after the first start
    assert Counter32().of(counts).tolist() == counts.tolist()


@pytest.mark.parametrize("apart_s", [0.0, 40.0, -40.0])
def test_a_ros_computer_with_a_wrong_clock_is_aligned_and_said(apart_s: float, tmp_path: Path) -> None:
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    with Writer(tmp_path / "bag", version=9) as writer:
        own = writer.add_connection("/dvl/twist", "geometry_msgs/msg/TwistStamped", typestore=store)
        zero = types["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
        for t in T.tolist():
            stamp = types["builtin_interfaces/msg/Time"](
                sec=int(UNIX_S + t + apart_s), nanosec=round(t % 1.0 * 1e9)
            )
            header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="dvl")
            message = types["geometry_msgs/msg/TwistStamped"](
                header=header, twist=types["geometry_msgs/msg/Twist"](linear=zero, angular=zero)
            )
            cells = store.serialize_cdr(message, "geometry_msgs/msg/TwistStamped")
            writer.write(own, round((t + 0.02) * 1e9) + int(UNIX_S) * 10**9, cells)
    path = tmp_path / "bag"
    late = 0.0 if apart_s == 0.0 else 0.02
    assert np.allclose(_stamps(path, "/dvl/twist"), T + late, atol=1e-3)
    assert bool(open_log(path).remarks) == (apart_s != 0.0)


def test_another_system_in_an_imc_log_is_a_source_with_a_clock_of_its_own(tmp_path: Path) -> None:
    import imcpy

    packets = []
    for t in T.tolist():
        for source, u, apart in ((30, 1.0, 0.0), (40, 2.0, -300.0)):
            state = imcpy.GroundVelocity()
            state.x, state.timestamp, state.src = u, UNIX_S + t + apart, source
            packets.append(state.serialize())
        state = imcpy.EstimatedState()
        state.u, state.timestamp, state.src = 1.0, UNIX_S + t, 30
        packets.append(state.serialize())
    path = tmp_path / "Data.lsf"
    path.write_bytes(b"".join(packets))
    log = open_log(path)
    read = log.read({"GroundVelocity": ["x"], "GroundVelocity@40": ["x"]})
    assert set(read["GroundVelocity"].fields["x"]) == {1.0}
    assert np.allclose(read["GroundVelocity@40"].t - UNIX_S, T, atol=0.21)  # s: one interval
    assert "system 40 is 300.0 s behind" in " ".join(log.remarks)
