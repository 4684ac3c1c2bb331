"""What a field of a log is taken for, with damaged samples in it."""

from __future__ import annotations

from pathlib import Path

from seatrial.logs.log import Field, Topic, open_log
from seatrial.logs.recognise import propose


def test_one_damaged_pulse_width_leaves_a_motor_a_motor() -> None:
    fields = tuple(Field(f"C{k}", "", 2000, 1100.0, 1900.0, 1500.0, 100.0, 0.1) for k in range(1, 8))
    flipped = Field("C8", "", 2000, 1100.0, 34268.0, 1516.0, 740.0, 0.1)
    off = Field("C9", "", 2000, 0.0, 0.0, 0.0, 0.0, 1.0)
    topic = Topic("RCOU", 2000, 0.0, 200.0, 0.1, 0.1, 0, (*fields, flipped, off))
    found = {one.canonical for one in propose("dataflash", [topic], {})}
    assert {f"cmd.thruster_{k}" for k in range(1, 9)} <= found
    assert "cmd.thruster_9" not in found


def test_a_column_called_t_is_the_time_though_stamps_fall_within_bursts(tmp_path: Path) -> None:
    rows = [f"{-(-k // 4) + 0.002 * (k % 4):.3f},{300.0 + k}" for k in range(400)]
    path = tmp_path / "pressure.csv"
    path.write_text("t,depth_cm\n" + "\n".join(rows) + "\n")
    [topic] = open_log(path).topics()
    assert topic.end_s - topic.start_s > 98.0


def test_rates_of_one_gyro_have_one_unit() -> None:
    # A vehicle that only yaws: 20 deg/s of yaw, 2 deg/s of roll and pitch.
    sizes = {"gyro_x": 2.0, "gyro_y": 1.5, "gyro_z": 20.0}
    fields = tuple(Field(name, "", 2000, -size, size, 0.0, size / 3.0, 0.0) for name, size in sizes.items())
    topic = Topic("imu", 2000, 0.0, 200.0, 0.1, 0.1, 0, fields)
    found = {one.canonical: one.unit for one in propose("csv", [topic], {})}
    assert {found[name] for name in ("p_deg_s", "q_deg_s", "r_deg_s")} == {"deg/s"}
    # One that states its unit tells nothing of the others' range.
    stated = Field("gyro_z", "deg/s", 2000, -20.0, 20.0, 0.0, 6.0, 0.0)
    topic = Topic("imu", 2000, 0.0, 200.0, 0.1, 0.1, 0, (*fields[:2], stated))
    assert {one.canonical: one.unit for one in propose("csv", [topic], {})}["r_deg_s"] == "deg/s"
