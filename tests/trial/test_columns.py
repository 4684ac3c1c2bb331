"""The column map: names, units, signs and frames of a recording, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seatrial.base.errors import TrialError
from seatrial.trial.trial import Trial
from tests.trial import motion

T = np.arange(0.0, 20.0, 0.1)
ROUND_OFF = 1e-12


def read(table: dict[str, Any], columns: dict[str, Any] | None = None) -> Trial:
    return Trial.read(table, columns=columns, align=False)


def test_units_become_si() -> None:
    table = {
        "time": T * 1e3,
        "speed": 3.6 * T,
        "rate": np.rad2deg(0.01 * T),
        "pwm": 1.5 + 0.001 * T,
        "rev": T,
    }
    trial = read(
        table,
        {
            "t_s": {"from": "time", "unit": "ms"},
            "u_m_s": {"from": "speed", "unit": "km/h"},
            "r_deg_s": "rate",
            "cmd.a": {"from": "pwm", "unit": "ms"},
            "cmd.b": {"from": "rev", "unit": "rev/s"},
        },
    )
    np.testing.assert_allclose(trial.t, T, atol=1e-9)
    np.testing.assert_allclose(trial.channel("u"), T, atol=1e-9)
    np.testing.assert_allclose(trial.channel("r"), 0.01 * T, atol=1e-9)
    np.testing.assert_allclose(trial.commands["a"], 1500.0 + T, atol=1e-9)
    np.testing.assert_allclose(trial.commands["b"], 60.0 * T, atol=1e-9)


def test_flu_and_nwu_become_frd_and_ned() -> None:
    table = motion.columns(T)
    flipped = {name: -table[name] for name in table if name[0] in "yzvwqr" and name not in ("q_w", "q_x")}
    frames = {
        **dict.fromkeys(("x_m", "y_m", "z_m"), "NWU"),
        **dict.fromkeys(("q_w", "q_x", "q_y", "q_z"), "FLU/NWU"),
        **dict.fromkeys(("u_m_s", "v_m_s", "w_m_s", "p_deg_s", "q_deg_s", "r_deg_s"), "FLU"),
    }
    columns = {name: {"from": name, "frame": frame} for name, frame in frames.items()}
    trial, expected = read(table | flipped, columns), read(table)
    np.testing.assert_allclose(trial.observed, expected.observed, atol=ROUND_OFF)


def test_enu_is_converted_as_a_vector() -> None:
    table = motion.columns(T)
    recorded = {"t_s": T, "east": table["y_m"], "north": table["x_m"], "up": -table["z_m"]}
    columns = {
        "x_m": {"from": "east", "frame": "ENU"},
        "y_m": {"from": "north", "frame": "ENU"},
        "z_m": {"from": "up", "frame": "ENU"},
    }
    trial = read(recorded, columns)
    np.testing.assert_allclose(trial.position, motion.pose(T)[0], atol=ROUND_OFF)


def test_euler_angles_of_flu_enu() -> None:
    heading = np.linspace(-200.0, 200.0, len(T))
    table = {"t_s": T, "roll": 0.0 * T + 5.0, "pitch": 0.0 * T - 3.0, "yaw": 90.0 - heading}
    columns = {f"{name}_deg": {"from": name, "frame": "FLU/ENU"} for name in ("roll", "pitch", "yaw")}
    trial = read(table, columns)
    np.testing.assert_allclose(np.rad2deg(trial.channel("roll")), 5.0, atol=1e-9)
    np.testing.assert_allclose(np.rad2deg(trial.channel("pitch")), 3.0, atol=1e-9)
    np.testing.assert_allclose(np.exp(1j * trial.channel("yaw")), np.exp(1j * np.deg2rad(heading)), atol=1e-9)


def test_sign_is_applied_in_the_recordings_frame() -> None:
    table = {"t_s": T, "v": T}
    trial = read(table, {"v_m_s": {"from": "v", "sign": -1, "frame": "FLU"}})
    np.testing.assert_allclose(trial.channel("v"), T)


def test_canonical_columns_need_no_map_and_are_kept_beside_one() -> None:
    trial = read({"t_s": T, "u_m_s": T, "speed": 2 * T, "other": T}, {"v_m_s": "speed"})
    assert trial.channels == ["u", "v"]
    assert any('"other"' in finding.message for finding in trial.report.findings)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"u_ms": "speed"}, r'"u_ms" is no canonical column; did you mean "u_m_s"\?'),
        ({"cmd.": "speed"}, r'"cmd\." is no canonical column'),
        ({"u_m_s": "sped"}, r'u_m_s: there is no column "sped" in the recording; did you mean "speed"\?'),
        ({"u_m_s": {"from": "speed", "units": "m/s"}}, r'u_m_s: unknown key "units"; did you mean "unit"\?'),
        ({"u_m_s": {"unit": "m/s"}}, r'expected "from", the name of a column, found None'),
        ({"u_m_s": 3}, r"u_m_s: expected the name of a column or a table"),
        ({"u_m_s": {"from": "speed", "sign": 2}}, r"sign: expected 1 or -1, found 2"),
        ({"u_m_s": {"from": "speed", "unit": "m"}}, r'u_m_s: unit "m" has the dimension \[length\]; .*"m/s"'),
        ({"u_m_s": {"from": "speed", "unit": "furlongz"}}, r'u_m_s: unknown unit "furlongz"'),
        ({"cmd.a": {"from": "speed", "unit": "kg"}}, r'cmd\.a: unit "kg" .* "rpm" or "us" or "N" or "rad"'),
        ({"t_s": {"from": "t_s", "unit": "m"}, "u_m_s": "speed"}, r't_s: unit "m" .* converts to "s"'),
        ({"u_m_s": {"from": "speed", "frame": "ENU"}}, r'u_m_s: frame "ENU" is no body frame'),
        ({"voltage_v": {"from": "speed", "frame": "FLU"}}, r"voltage_v: a scalar has no frame"),
        ({"cmd.a": {"from": "speed", "frame": "FLU"}}, r"cmd\.a: a scalar has no frame"),
        ({"x_m": {"from": "speed", "frame": "ENU"}}, r'x_m: frame "ENU" mixes axes, so y_m is needed'),
        ({"q_w": "speed", "q_x": "speed"}, r"four components; q_y, q_z missing"),
        (
            {"pitch_deg": {"from": "speed", "frame": "FLU"}, "yaw_deg": {"from": "speed", "frame": "ENU"}},
            r'one attitude has one frame; .* "ENU", "FLU"',
        ),
    ],
)
def test_wrong_entries_are_refused_with_advice(columns: dict[str, Any], message: str) -> None:
    with pytest.raises(TrialError, match=message) as caught:
        read({"t_s": T, "speed": T}, columns)
    assert str(caught.value).startswith("frame: ")


def test_a_recording_without_time_or_known_columns_is_refused() -> None:
    with pytest.raises(TrialError, match=r'no time: expected a column "t_s" .* "Time"'):
        read({"Time": T, "u_m_s": T})
    with pytest.raises(TrialError, match=r"no column but the time has a canonical name"):
        read({"t_s": T, "speed": T})


@pytest.mark.parametrize("columns", [None, {"u_m_s": "speed"}])
def test_a_header_that_is_no_text_is_shown_without_its_control_characters(
    columns: dict[str, Any] | None,
) -> None:
    junk = {"\x1b[31mred\x07": T, "a\x00\n" * 30: T} | {f"c{k}": T for k in range(60)}
    with pytest.raises(TrialError) as refused:
        read(junk, columns)
    said = str(refused.value)
    assert said.isprintable()
    assert "\\x1b[31mred" in said
    assert len(said) < 600
    assert said.endswith(" more")


def test_brackets_in_the_name_of_a_file_are_no_pattern(tmp_path: Path) -> None:
    text = "t_s,u_m_s\n" + "".join(f"{0.1 * k:.1f},{k}\n" for k in range(50))
    (tmp_path / "log[1].csv").write_text(text)
    assert len(Trial.read(tmp_path / "log[1].csv", align=False)) == 50
    Trial.read(tmp_path / "log[1].csv", align=False).save(tmp_path / "log[2].parquet")
    assert len(Trial.read(tmp_path / "log[2].parquet", align=False)) == 50


def test_a_file_of_null_bytes_is_no_text(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_bytes(b"t_s,u_m_s\n0\0,1\n")
    with pytest.raises(TrialError, match="not a text file"):
        Trial.read(tmp_path / "log.csv")


def test_wide_characters_titles_units_and_decimal_commas_are_read(tmp_path: Path) -> None:
    rows = "".join(f"{0.1 * k:.1f};{1000.0 * math.sin(0.1 * k):.3f}\n".replace(".", ",") for k in range(50))
    (tmp_path / "log.csv").write_bytes(("Export 4\n\nTime;speed\ns;mm/s\n" + rows).encode("utf-16"))
    trial = Trial.read(tmp_path / "log.csv", columns={"t_s": "Time", "u_m_s": "speed"}, align=False)
    assert np.allclose(trial.channel("u"), np.sin(trial.t), atol=1e-6)
    knots = Trial.read(
        tmp_path / "log.csv", columns={"t_s": "Time", "u_m_s": {"from": "speed", "unit": "knot"}}, align=False
    )
    assert np.allclose(knots.channel("u"), 514.444 * np.sin(trial.t), atol=1e-2)  # what the map says counts
