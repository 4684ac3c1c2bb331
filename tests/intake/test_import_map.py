"""The map of an import: what its keys may hold, and what is said about another value."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import seatrial as st
from seatrial.base.finding import Finding, Severity
from seatrial.base.frames import LocalFrame
from seatrial.inspect.corrections import Correction
from seatrial.intake.recordings import MapClock, MapFile, MapTrial, load_map, parse_map
from tests.docs.pages import ROOT


def test_columns_actuators_clocks_and_trials_are_read() -> None:
    made = parse_map(
        """
        format = 1
        [columns]
        yaw_deg = "nav.heading"
        z_m = { from = "ctd.p", unit = "dbar", convert = "pressure", why = "by hand" }
        [actuators]
        port = { from = "esc.n1", unit = "rpm", sign = -1 }
        [clocks]
        "ctd.csv" = { offset_s = 0.5, drift = 40e-6 }
        [trials.dive]
        start_s = 10.0
        stop_s = 90.0
        """,
        "map.toml",
    )
    assert made.columns["cmd.port"].sign == -1
    assert made.columns["z_m"].convert == "pressure"
    assert made.clocks["ctd.csv"].drift == 40e-6
    assert made.trials["dive"].stop_s == 90.0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('columns = { yaw_deg = "a.b" }', "format"),
        ("format = 1", "add \\[columns\\]"),
        ('format = 1\ncolums = { yaw_deg = "a.b" }', "did you mean"),
        ('format = 1\ncolumns = { yaw_dge = "a.b" }', 'no canonical column; did you mean "yaw_deg"'),
        ('format = 1\ncolumns = { t_s = "a.b" }', "time comes with every topic"),
        ('format = 1\ncolumns = { "cmd.port" = "a.b" }', "\\[actuators\\]: port"),
        (
            'format = 1\ncolumns = { yaw_deg = { from = "a.b", sign = 2 } }',
            "key yaw_deg: sign: expected 1 or -1",
        ),
        ('format = 1\ncolumns = { yaw_deg = { from = "a.b", why = 3 } }', "key yaw_deg: why"),
        (
            'format = 1\ncolumns = { yaw_deg = { from = "a.b", unit = "kg" } }',
            'key yaw_deg: unit "kg" has the dimension',
        ),
        (
            'format = 1\ncolumns = { z_m = "a.b" }\nactuators = { port = { from = "a.c", unit = "furlng" } }',
            'actuators, key port: unknown unit "furlng"',
        ),
        ('format = 1\ncolumns = { z_m = { from = "a.b", convert = "presure" } }', "convert.*pressure"),
        ('format = 1\ncolumns = { yaw_deg = { from = "a.b", convert = "pressure" } }', "gives z_m"),
        (
            'format = 1\ncolumns = { yaw_deg = "a.b" }\nclocks = { "x.csv" = { drift = 0.5 } }',
            "key drift.*0.01",
        ),
        (
            'format = 1\ncolumns = { yaw_deg = "a.b" }\nclocks = { "x.csv" = { offset_s = "1" } }',
            "key offset_s",
        ),
        (
            'format = 1\ncolumns = { yaw_deg = "a.b" }\ntrials = { a = { start_s = 5.0, stop_s = 1.0 } }',
            "not before stop_s",
        ),
    ],
)
def test_wrong_map_names_file_key_and_remedy(text: str, said: str) -> None:
    with pytest.raises(st.TrialError, match=rf"map\.toml(.|\n)*{said}") as refused:
        parse_map(text, "map.toml")
    assert "\n\n" not in str(refused.value)


def test_map_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(st.TrialError, match="absent"):
        load_map(tmp_path / "absent.toml")


def _log(folder: Path, **extra: np.ndarray) -> Path:
    t = np.arange(0.0, 60.0, 0.1)
    path = folder / "nav.csv"
    columns = {"time": t, "heading": 30.0 * np.sin(0.3 * t), "n1": 500.0 + t}
    pl.DataFrame(columns | extra).write_csv(path)
    return path


def test_map_of_another_log_names_its_topics(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text('format = 1\ncolumns = { yaw_deg = "ATT.Yaw" }')
    with pytest.raises(st.TrialError, match=r"has none of these fields; its topics are"):
        st.import_logs(_log(tmp_path), map=tmp_path / "map.toml")


def test_trial_windows_of_the_map_cut_the_recording(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(
        'format = 1\ncolumns = { yaw_deg = "nav.heading" }\nactuators = { port = "nav.n1" }\n'
        "[trials.first]\nstop_s = 20.0\n[trials.second]\nstart_s = 30.0\n"
    )
    made = st.import_logs(_log(tmp_path), map=tmp_path / "map.toml")
    spans = [(one.name, round(float(one.trial.t[0])), round(float(one.trial.t[-1]))) for one in made.trials]
    assert spans == [("first", 0, 20), ("second", 30, 60)]


def test_pressure_becomes_depth_and_fixes_become_metres(tmp_path: Path) -> None:
    t = np.arange(0.0, 60.0, 0.1)
    depth = 2.0 - 2.0 * np.cos(0.1 * t)
    path = _log(tmp_path, press=101_325.0 + 1025.0 * 9.81 * depth, lat=63.4 + 1e-6 * t, lon=10.4 + 2e-6 * t)
    (tmp_path / "map.toml").write_text(
        "format = 1\n[columns]\n"
        'yaw_deg = "nav.heading"\nz_m = { from = "nav.press", unit = "Pa", convert = "pressure" }\n'
        'x_m = { from = "nav.lat", convert = "latitude" }\n'
        'y_m = { from = "nav.lon", convert = "longitude" }\n'
    )
    trial = st.import_logs(path, map=tmp_path / "map.toml").trials[0].trial
    assert np.abs(trial.channel("z") - np.interp(trial.t, t, depth)).max() < 1e-3
    # A degree of latitude at 63.4 deg is 111.48 km, of longitude 50.0 km (WGS 84).
    assert trial.channel("x")[-1] == pytest.approx(111_480.0 * 1e-6 * trial.t[-1], rel=1e-3)
    assert trial.channel("y")[-1] == pytest.approx(50_030.0 * 2e-6 * trial.t[-1], rel=2e-3)


@pytest.mark.parametrize(("start", "step"), [((60.0, 5.0), (2e-3, 4e-3)), ((0.0, 179.9), (1e-4, 4e-3))])
def test_law_logs_and_missions_share_one_projection(
    tmp_path: Path, start: tuple[float, float], step: tuple[float, float]
) -> None:
    """Metres of a log are those of a mission: 14 km from the first fix, and across the antimeridian."""
    t = np.arange(0.0, 60.0, 0.1)
    latitude, longitude = start[0] + step[0] * t, start[1] + step[1] * t
    path = _log(tmp_path, lat=latitude, lon=(longitude + 180.0) % 360.0 - 180.0)
    (tmp_path / "map.toml").write_text(
        'format = 1\n[columns]\nyaw_deg = "nav.heading"\n'
        'x_m = { from = "nav.lat", convert = "latitude" }\n'
        'y_m = { from = "nav.lon", convert = "longitude" }\n'
    )
    trial = st.import_logs(path, map=tmp_path / "map.toml").trials[0].trial
    places = np.column_stack([np.interp(trial.t, t, latitude), np.interp(trial.t, t, longitude)])
    expected = LocalFrame(*start).metres(places)
    # 1 cm: the trial's time base interpolates between fixes.
    np.testing.assert_allclose(trial.channel("x"), expected[:, 0], atol=0.01)
    np.testing.assert_allclose(trial.channel("y"), expected[:, 1], atol=0.01)


def test_clock_of_the_map_moves_its_file(tmp_path: Path) -> None:
    t = np.arange(0.0, 60.0, 0.1)
    pl.DataFrame({"time": t + 3.0, "depth": 1.0 + np.sin(0.2 * t)}).write_csv(tmp_path / "ctd.csv")
    (tmp_path / "map.toml").write_text(
        'format = 1\ncolumns = { yaw_deg = "nav.heading", z_m = "ctd.depth" }\n'
        '[clocks]\n"ctd.csv" = { offset_s = 3.0 }\n'
    )
    made = st.import_logs([_log(tmp_path), tmp_path / "ctd.csv"], map=tmp_path / "map.toml")
    trial = made.trials[0].trial
    assert np.abs(trial.channel("z") - (1.0 + np.sin(0.2 * trial.t))).max() < 1e-3


def test_keys_of_the_map_are_those_of_its_page() -> None:
    page = (ROOT / "docs" / "how-to" / "import_a_log.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ((?:`\w+`(?:, )?)+) \|", page[page.index("## Reference") :], re.MULTILINE)
    told = {key for row in rows for key in re.findall(r"\w+", row)}
    known = {key for section in (MapFile, MapClock, MapTrial) for key in section.model_fields}
    assert told == known | {"from", "unit", "frame", "sign", "convert", "why"}


def test_proposed_clock_is_a_line_that_the_map_takes() -> None:
    finding = Finding("clock offset", Severity.WEAKNESS, "dvl.csv")
    found = Correction(
        "clocks", "dvl.csv.offset_s", 0.37, 0.01, "s", 0.02, 0.01, "the rate of depth", finding
    )
    text = f'format = 1\ncolumns = {{ yaw_deg = "a.b" }}\n[clocks]\n{found.line}\n'
    assert parse_map(text, "map.toml").clocks["dvl.csv"].offset_s == 0.37


def test_log_without_a_known_field_says_what_to_write(tmp_path: Path) -> None:
    t = np.arange(0.0, 60.0, 0.1)
    pl.DataFrame({"time": t, "abc": t, "xyzzy": t}).write_csv(tmp_path / "odd.csv")
    with pytest.raises(
        st.TrialError, match=r"odd.csv: no field is recognised.*write map.toml with \[columns\]"
    ):
        st.import_logs(tmp_path / "odd.csv", out=tmp_path / "p")
    assert not (tmp_path / "p").exists()


def test_a_log_without_a_time_names_the_columns_that_there_are(tmp_path: Path) -> None:
    path = tmp_path / "bench.csv"
    path.write_text("depth_m,yaw_deg,u_m_s\n" + "".join(f"{k},{2 * k},{0.1 * k}\n" for k in range(30)))
    with pytest.raises(st.TrialError) as refused:
        st.import_logs(path)
    said = str(refused.value)
    assert "there are the columns depth_m, yaw_deg, u_m_s; name its time column" in said


T = np.arange(0.0, 60.0, 0.1)
ODD = {
    "dashes": (["-"] * 600, 'odd.csv: column "u_m_s" (u_m_s by its name) is not used: no number in 600 rows'),
    "text": (["-"] * 600, '(text, "-" in line 2)'),
    "nan": (["nan"] * 600, "no number in 600 rows (empty cells or NaN); expected at least 10"),
    "short": (["0.5", "0.7"], "odd.csv: 2 rows, expected at least 10: none of its columns is used"),
}


@pytest.mark.parametrize("kind", list(ODD))
def test_a_column_that_cannot_be_used_is_said_with_file_and_reason(tmp_path: Path, kind: str) -> None:
    cells, said = ODD[kind]
    rows = "".join(f"{t:.1f},{cell}\n" for t, cell in zip(T.tolist(), cells, strict=False))
    (tmp_path / "odd.csv").write_text("time,u_m_s\n" + rows)
    report = st.import_logs([_log(tmp_path), tmp_path / "odd.csv"]).report()
    assert report.outcome == "imported in part"
    assert said in report.text()


def test_a_column_of_lists_in_parquet_is_said(tmp_path: Path) -> None:
    pl.DataFrame({"time": T, "u_m_s": [[0.1]] * len(T)}).write_parquet(tmp_path / "odd.parquet")
    made = st.import_logs([_log(tmp_path), tmp_path / "odd.parquet"])
    said = 'column "u_m_s" is not read: expected a number in each cell, found List(Float64)'
    assert f"odd.parquet was read in part: {said}" in made.report().text()


def test_an_unknown_unit_is_said_with_its_row_and_those_that_are_known(tmp_path: Path) -> None:
    rows = "".join(f"{t:.1f},{0.2 * np.sin(t):.4f},{0.1 * np.cos(t):.4f}\n" for t in T)
    (tmp_path / "nav.csv").write_text("time,yaw,pitch\ns,grad,grad\n" + rows)
    made = st.import_logs(tmp_path / "nav.csv")
    assert made.columns["yaw_deg"].source == "nav.yaw"
    said = made.report().text()
    assert 'read in part: line 2: the unit "grad" of "yaw", "pitch" is not known, rad was taken' in said
    assert "known are m/s, mm/s" in said


def test_a_link_to_itself_beside_other_logs_is_refused(tmp_path: Path) -> None:
    (tmp_path / "loop.csv").symlink_to("loop.csv")
    with pytest.raises(st.TrialError, match=r"loop.csv: expected a log, but this is a link that leads to no"):
        st.import_logs([_log(tmp_path), tmp_path / "loop.csv"])


def test_a_name_that_is_not_utf_8_makes_a_project(tmp_path: Path) -> None:
    odd = tmp_path / os.fsdecode(b"nav\xff.csv")
    try:
        _log(tmp_path).rename(odd)
    except OSError:
        pytest.skip("this file system takes names in UTF-8 alone")
    st.import_logs(odd, out=tmp_path / "p")
    again = st.import_logs(odd, out=tmp_path / "p", map=tmp_path / "p" / "map.toml", force=True)
    assert "yaw" in again.trials[0].trial.channels


def test_a_record_of_a_project_that_is_nested_too_deeply_is_as_one_that_is_not_readable(
    tmp_path: Path,
) -> None:
    log = _log(tmp_path)
    kept = {}
    for name, text in (("broken", "["), ("deep", "[" * 100_000)):
        st.import_logs(log, out=tmp_path / name, vehicle="cwolf")
        (tmp_path / name / "import.json").write_text(text)
        kept[name] = st.import_logs(log, out=tmp_path / name, vehicle="cwolf", force=True).kept
    assert kept["deep"] == kept["broken"]
