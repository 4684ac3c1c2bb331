"""What a column is called says what it is: all words of its name, its unit, and the type of its message."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import seatrial as st
from seatrial.base.errors import TrialError
from seatrial.base.frames import from_euler, matrix
from seatrial.intake.survey import chosen, survey
from seatrial.logs.delimited import layout_of
from seatrial.logs.log import Field, Topic
from seatrial.logs.recognise import propose

T = np.arange(0.0, 40.0, 0.1)


def _proposed(
    names: dict[str, str], format: str = "csv", topic: str = "log", kind: str = ""
) -> dict[str, tuple[str, str, str]]:
    """Field, unit and conversion or frame of the best proposal of each canonical column, by its name."""
    fields = tuple(Field(name, unit, 2000, -1.0, 1.0, 0.0, 0.5, 0.0) for name, unit in names.items())
    whole = Topic(topic, 2000, 0.0, 200.0, 0.1, 0.1, 0, fields, kind, of_file=format == "csv")
    return {
        one.canonical: (one.name, one.unit, one.convert or one.frame)
        for one in reversed(propose(format, [whole], {}))
    }


def _columns(path: Path) -> dict[str, str]:
    return {canonical: one.name for canonical, one in chosen(survey([path]).logs[0]).items()}


@pytest.mark.parametrize("stem", ["run1", "mission_2", "n1", "thruster", "pwm_log", "dive-3_n2", "rudder"])
@pytest.mark.parametrize("ending", ["csv", "parquet", "mat"])
def test_law_the_name_of_a_file_says_nothing_about_its_columns(
    ending: str, stem: str, tmp_path: Path
) -> None:
    table = {"time_s": T, "u": np.sin(T), "yaw_deg": 3.0 * T, "rudder_deg": 5.0 * np.sin(T)}
    table |= {"altitude": 8.0 + np.sin(T), "status": np.round(T)}
    path = tmp_path / f"{stem}.{ending}"
    if ending == "csv":
        pl.DataFrame(table).write_csv(path)
    elif ending == "parquet":
        pl.DataFrame(table).write_parquet(path)
    else:
        from scipy.io import savemat

        savemat(path, table)
    assert set(_columns(path)) == {"u_m_s", "yaw_deg", "cmd.rudder"}


@pytest.mark.parametrize(
    ("path", "canonical"),
    [
        ("field.velocity.x", "u_m_s"),
        ("field.twist.twist.linear.y", "v_m_s"),
        ("/odom/twist/twist/angular/z", "r_deg_s"),
        ("field.orientation.w", "q_w"),
        ("field.pose.pose.position.z", "z_m"),
        ("field.force.x", "tau.X_n"),
        ("field.wrench.torque.z", "tau.N_nm"),
        ("nav.u", "u_m_s"),
        ("rollRate", "p_deg_s"),
        ("GyrZ", "r_deg_s"),
        ("attitude.pitch", "pitch_deg"),
    ],
)
def test_a_path_is_read_by_all_its_words(path: str, canonical: str) -> None:
    assert list(_proposed({path: ""})) == [canonical]


@pytest.mark.parametrize(
    "path",
    [
        "field.linear_acceleration.x", "field.magnetic_field.y", "field.header.seq", "pose.covariance.x",
        "setpoint.yaw", "target.depth", "Next Heading", "Goal Depth", "motor_temp", "esc_power",
        "battery_current", "altitude", "bottom_depth", "final", "description", "gain_2", "time_to_go", "SbU",
    ],
)  # fmt: skip
def test_words_that_make_another_quantity_leave_a_column_alone(path: str) -> None:
    assert _proposed({path: ""}) == {}


def test_a_unit_of_another_dimension_makes_another_quantity() -> None:
    assert _proposed({"v": "V", "p": "kPa", "r": "m", "depth": "deg", "rudder": "m", "u": "m/s"}) == {
        "u_m_s": ("u", "m/s", "")
    }
    assert _proposed({"vel_n": "", "vel_e": "", "vel_d": ""})["v_m_s"] == ("vel_e", "m/s", "east")


def test_columns_of_a_makers_log_are_proposed() -> None:
    names = {
        "Latitude": "", "Longitude": "", "Time": "", "Date": "", "GPS Speed (Kn)": "Kn",
        "GPS True Heading": "",
        "C Magnetic Heading": "", "C True Heading": "degrees true", "Pitch Angle": "", "Roll Angle": "",
        "Depth (feet)": "feet", "DTB Height (m)": "m", "Total Water Column (m)": "m",
        "Vehicle Speed (kn)": "kn",
        "Next Speed (kn)": "kn", "Next Heading": "", "Next Long": "", "Next Lat": "", "Depth Goal (m)": "m",
        "Batt Volts": "", "Time to Empty": "",
    }  # fmt: skip
    assert {c: entry[:2] for c, entry in _proposed(names).items()} == {
        "x_m": ("Latitude", "deg"),
        "y_m": ("Longitude", "deg"),
        "z_m": ("Depth (feet)", "ft"),
        "u_m_s": ("Vehicle Speed (kn)", "knot"),
        "yaw_deg": ("C True Heading", "deg"),
        "pitch_deg": ("Pitch Angle", "rad"),  # by its range: no unit is stated
        "roll_deg": ("Roll Angle", "rad"),
        "voltage_v": ("Batt Volts", "V"),
    }


PLANAR = [
    ("geometry_msgs/msg/Pose2D", ("x", "y", "theta"), ("x_m", "y_m", "yaw_deg")),
    ("vision_msgs/msg/Pose2D", ("position.x", "position.y", "theta"), ("x_m", "y_m", "yaw_deg")),
    ("nav_2d_msgs/msg/Pose2DStamped", ("pose.x", "pose.y", "pose.theta"), ("x_m", "y_m", "yaw_deg")),
    ("nav_2d_msgs/msg/Twist2D", ("x", "y", "theta"), ("u_m_s", "v_m_s", "r_deg_s")),
    (
        "nav_2d_msgs/msg/Twist2DStamped",
        ("velocity.x", "velocity.y", "velocity.theta"),
        ("u_m_s", "v_m_s", "r_deg_s"),
    ),
    (
        "turtlesim/msg/Pose",
        ("x", "y", "theta", "linear_velocity", "angular_velocity"),
        ("x_m", "y_m", "yaw_deg", "u_m_s", "r_deg_s"),
    ),
]


@pytest.mark.parametrize(("kind", "fields", "canonical"), PLANAR)
@pytest.mark.parametrize("format", ["rosbag", "mcap"])
def test_theta_of_a_message_in_the_plane_is_no_pitch(
    format: str, kind: str, fields: tuple[str, ...], canonical: tuple[str, ...]
) -> None:
    found = _proposed(dict.fromkeys(fields, ""), format, "/track", kind)
    assert {c: entry[0] for c, entry in found.items()} == dict(zip(canonical, fields, strict=True))


def test_a_recorded_pose_in_the_plane_is_east_north_and_counts_from_east(tmp_path: Path) -> None:
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = "geometry_msgs/msg/Pose2D"
    with Writer(tmp_path / "bag", version=9) as writer:
        connection = writer.add_connection("/track", kind, typestore=store)
        for k, t in enumerate(T.tolist()):
            message = store.types[kind](x=0.5 * t, y=0.0, theta=0.01 * t)
            cells = store.serialize_cdr(message, kind)
            writer.write(connection, 1_700_000_000_000_000_000 + k * 100_000_000, cells)
    made = st.import_logs(tmp_path / "bag")
    trial = made.trials[0].trial
    assert trial.channel("y")[-1] - trial.channel("y")[0] == pytest.approx(
        0.5 * 39.9, abs=0.01
    )  # to the east
    yaw = np.rad2deg(np.unwrap(trial.channel("yaw")))
    assert yaw[0] == pytest.approx(90.0, abs=0.1)
    assert yaw[-1] == pytest.approx(90.0 - np.rad2deg(0.399), abs=0.1)


def test_law_canonical_columns_in_other_units_are_read() -> None:
    plain = {"t_s": T, "roll_deg": 5.0 * np.sin(T), "pitch_deg": 0.0 * T, "yaw_deg": 20.0 * np.cos(T)}
    plain |= {"u_m_s": np.sin(T), "z_m": 3.0 + np.sin(T), "r_deg_s": 4.0 * np.cos(T), "cmd.fin": np.sin(T)}
    radians = np.pi / 180.0
    other = {
        "t_ms": 1e3 * T, "roll_rad": radians * plain["roll_deg"], "pitch_mrad": 0.0 * T,
        "yaw_rad": radians * plain["yaw_deg"], "u_knots": plain["u_m_s"] * 3600.0 / 1852.0,
        "z_ft": plain["z_m"] / 0.3048, "r_rad_s": radians * plain["r_deg_s"],
        "cmd.fin_deg": plain["cmd.fin"] / radians,
    }  # fmt: skip
    expected, trial = st.Trial.read(plain), st.Trial.read(other)
    for name in ("roll", "yaw", "u", "z", "r"):
        assert np.allclose(trial.channel(name), expected.channel(name), atol=1e-9), name
    assert np.allclose(trial.commands["fin"], expected.commands["fin"])


def test_what_only_looks_like_a_canonical_column_is_said_or_refused() -> None:
    table: dict[str, Any] = {"t_s": T, "u_m_s": np.sin(T), "yaw_m": T}
    said = " ".join(str(finding) for finding in st.Trial.read(table).report.findings)
    assert '"yaw_m" is not used: called as yaw_deg, and m is no unit of it' in said
    with pytest.raises(TrialError, match=r'"cmd.fin_m_s": a command or measurement in m/s'):
        st.Trial.read({"t_s": T, "u_m_s": np.sin(T), "cmd.fin_m_s": T})
    with pytest.raises(TrialError, match=r'"roll_rad" and "roll_mrad" are both roll_deg'):
        st.Trial.read({"t_s": T, "roll_rad": T, "roll_mrad": T})


NAMES = "time,yaw,rudder,v_x"
NUMBERS = "\n".join(f"{t:.1f},{np.sin(t):.4f},{np.cos(t):.4f},1.5" for t in T) + "\n"


@pytest.mark.parametrize(
    ("above", "units"),
    [
        (f"Yaw\n{NAMES}\nseconds,rad,rad,m/s\n", ("seconds", "rad", "rad", "m/s")),
        (f"{NAMES}\ns,radians,degrees per second,metres per second\n", None),
        (f"{NAMES}\n[s],[deg],[feet],[grains]\n", ("s", "deg", "feet", "grains")),
        (f"s,rad,rad,m/s\n{NAMES}\n", ("s", "rad", "rad", "m/s")),
        (f"IMU,IMU,IMU,DVL\n{NAMES}\ns,rad,rad,m/s\n", ("s", "rad", "rad", "m/s")),
        (f"{NAMES}\nfloat64,float64,float64,float64\ns,rad,rad,m/s\n", ("s", "rad", "rad", "m/s")),
        (f"{NAMES}\ndouble,double,float,float\n", ("", "", "", "")),
        (f"{NAMES}\ns,quux,foo,bar\n", ("s", "quux", "foo", "bar")),
        (f"# {NAMES}\n# s,rad,rad,m/s\n", ("s", "rad", "rad", "m/s")),
        (f"{NAMES}\nUTC,true,port,over ground\n", None),
        (f"{NAMES},\n", ("", "", "", "")),
    ],
)
@pytest.mark.parametrize("end", ["", ","])
def test_law_names_stand_above_numbers_whatever_the_words(
    above: str, units: tuple[str, ...] | None, end: str, tmp_path: Path
) -> None:
    path = tmp_path / "log.dat"
    path.write_text(above + NUMBERS.replace("\n", f"{end}\n"))
    layout = layout_of(path)
    assert layout.names[:4] == ("time", "yaw", "rudder", "v_x")
    if units is not None:
        assert layout.units[:4] == units
    trial = st.Trial.read(path, columns={"t_s": "time", "yaw_deg": {"from": "yaw", "unit": "rad"}})
    assert np.allclose(trial.channel("yaw"), np.sin(T), atol=1e-3)


def _estimator_log(path: Path, *, doppler: bool) -> Path:
    angles = np.column_stack([0.1 * np.sin(0.3 * T), 0.2 * np.cos(0.2 * T), 0.05 * T])
    body = np.column_stack([1.0 + 0.2 * np.sin(0.5 * T), 0.1 * np.sin(T), 0.1 * np.cos(T)])
    earth = np.einsum("nij,nj->ni", matrix(from_euler(angles)), body)
    lines = [
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
        "FMT, 131, 20, ATT, Qfff, TimeUS,Roll,Pitch,Yaw",
        "FMT, 132, 20, XKF1, QBfff, TimeUS,C,VN,VE,VD",
        "FMT, 133, 20, VISO, Qffff, TimeUS,dt,PosDX,PosDY,PosDZ",
    ]
    for t, angle, v, u in zip(T, np.rad2deg(angles), earth, body, strict=True):
        stamp = round(t * 1e6)
        lines.append(f"ATT, {stamp}, {angle[0]}, {angle[1]}, {angle[2]}")
        lines.append(f"XKF1, {stamp}, 0, {v[0]}, {v[1]}, {v[2]}")
        if doppler:
            lines.append(f"VISO, {stamp}, 0.1, {0.1 * u[0]}, {0.1 * u[1]}, {0.1 * u[2]}")
    path.write_text("\n".join(lines) + "\n")
    return path


def test_the_velocity_of_the_estimator_is_offered_where_no_doppler_log_is_and_named(tmp_path: Path) -> None:
    made = st.import_logs(_estimator_log(tmp_path / "a.log", doppler=False))
    trial = made.trials[0].trial
    assert np.allclose(trial.channel("u"), 1.0 + 0.2 * np.sin(0.5 * trial.t), atol=2e-3)
    assert np.allclose(trial.channel("w"), 0.1 * np.cos(trial.t), atol=2e-3)
    assert "velocity of the estimator, XKF1.VN: no measurement" in made.columns["u_m_s"].why
    assert "it has the delay and the model of its filter; add a Doppler log" in made.report().text()
    with_doppler = st.import_logs(_estimator_log(tmp_path / "b.log", doppler=True))
    assert with_doppler.columns["u_m_s"].source == "VISO.PosDX/dt"


def test_files_that_overlap_in_time_are_one_trial_in_any_number(tmp_path: Path) -> None:
    """Two dives of three files each; no moment is in all files of a dive."""
    files = []
    for dive, begin in (("a", 1.7e9), ("b", 1.7e9 + 5000.0)):
        for k, name in enumerate(("yaw_deg", "depth_m", "u_m_s")):
            path = tmp_path / f"{dive}_{name}.csv"
            t = begin + 0.1 * np.arange(1000) + 60.0 * k
            pl.DataFrame({"time": t, name: np.sin(0.1 * t)}).write_csv(path)
            files.append(path)
    from seatrial.intake.recordings import recordings

    made = recordings(survey(files).logs)
    assert [sorted(log.path.name[0] for log in one.logs) for one in made] == [["a"] * 3, ["b"] * 3]
