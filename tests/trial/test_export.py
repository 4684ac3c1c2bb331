"""Exported files come back through the readers bit for bit, and viewers know their schemas."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from mcap.reader import make_reader
from polars.testing import assert_frame_equal
from typer.testing import CliRunner

import seatrial as st
from seatrial.base.errors import TrialError
from seatrial.cli import app
from seatrial.logs import open_log
from seatrial.trial.export import export

T = 3.0 + np.arange(0.0, 20.0, 0.1)


@pytest.fixture(scope="module")
def trial() -> st.Trial:
    rng = np.random.default_rng(1)
    u = rng.normal(0.5, 0.1, len(T))
    u[40:45] = np.nan
    table = {"t_s": T, "x_m": 0.3 * T, "y_m": 0.1 * T, "z_m": 2.0 + 0.01 * T, "u_m_s": u}
    table |= {"roll_deg": 5.0 * np.sin(T), "pitch_deg": np.cos(T), "yaw_deg": 30.0 + T}
    return st.Trial.read(table | {"cmd.PU": rng.normal(900.0, 50.0, len(T))}, name="run", align=False)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_tables_come_back_bit_for_bit(trial: st.Trial, ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"run.{ending}"
    export(trial.table, path)
    again = pl.read_csv(path) if ending == "csv" else pl.read_parquet(path)
    assert_frame_equal(again, trial.table, check_exact=True)


def test_mcap_comes_back_bit_for_bit_through_the_reader_of_logs(trial: st.Trial, tmp_path: Path) -> None:
    export(trial.table, tmp_path / "run.mcap")
    log = open_log(tmp_path / "run.mcap")
    fields = list(log.fields["/trial"])
    assert fields == trial.table.columns
    chunks = list(log.chunks({"/trial": fields}))
    values = np.concatenate([chunk.values for chunk in chunks])
    for k, name in enumerate(fields):
        expected = trial.table[name].cast(float).to_numpy()
        assert np.array_equal(values[:, k], expected, equal_nan=True), name
    stamps = np.concatenate([chunk.t for chunk in chunks])
    assert np.abs(stamps - T).max() < 1e-9


def test_the_pose_of_an_mcap_file_is_that_of_the_trial(trial: st.Trial, tmp_path: Path) -> None:
    export(trial.table, tmp_path / "run.mcap")
    place, q = "/pose.pose.position", "/pose.pose.orientation"
    columns = {f"{c}_m": {"from": f"{place}.{c}", "frame": "ENU"} for c in "xyz"}
    columns |= {f"q_{c}": {"from": f"{q}.{c}", "frame": "FLU/ENU"} for c in "wxyz"}
    back = st.Trial.read(tmp_path / "run.mcap", columns=columns, align=False, level=False)
    for name in ("x", "y", "z", "roll", "pitch", "yaw"):
        assert back.channel(name) == pytest.approx(trial.channel(name), abs=1e-6)


def test_viewers_find_their_schemas_and_units(trial: st.Trial, tmp_path: Path) -> None:
    export(trial.table, tmp_path / "run.mcap")
    with (tmp_path / "run.mcap").open("rb") as stream:
        messages = list(make_reader(stream).iter_messages())
    schemas = {channel.topic: schema for schema, channel, _ in messages if schema is not None}
    assert {topic: schema.name for topic, schema in schemas.items()} == {
        "/trial": "seatrial.Trial",
        "/tf": "foxglove.FrameTransform",
        "/pose": "foxglove.PoseInFrame",
    }
    assert {schema.encoding for schema in schemas.values()} == {"jsonschema"}
    described = json.loads(schemas["/trial"].data)["properties"]
    assert described["u_m_s"]["description"] == "m/s"
    assert described["cmd"]["properties"]["PU"]["description"] == "unit of the actuator"
    first = next(json.loads(message.data) for _, channel, message in messages if channel.topic == "/tf")
    assert first["timestamp"] == {"sec": 3, "nsec": 0}
    assert first["translation"]["z"] == pytest.approx(-2.03)
    published = {  # required fields of foxglove-sdk, schemas/jsonschema
        "/tf": {"timestamp", "parent_frame_id", "child_frame_id", "translation", "rotation"},
        "/pose": {"timestamp", "frame_id", "pose"},
    }
    for topic, fields in published.items():
        schema = json.loads(schemas[topic].data)
        assert set(schema["required"]) == set(schema["properties"]) == fields
        assert schema["properties"]["timestamp"]["title"] == "time"
    # A masked sample is left out: JSON has no number for it.
    rows = [json.loads(message.data) for _, channel, message in messages if channel.topic == "/trial"]
    assert sum("u_m_s" not in row for row in rows) == int(trial.table["u_m_s"].null_count()) > 0


def test_columns_in_other_units_are_read_back_by_their_headers(trial: st.Trial, tmp_path: Path) -> None:
    export(trial.table, tmp_path / "run.csv", units={"u_m_s": "knot", "z_m": "ft"})
    header = (tmp_path / "run.csv").read_text().splitlines()[0]
    assert "u [knot]" in header
    columns = {"u_m_s": "u [knot]", "z_m": "z [ft]"}
    back = st.Trial.read(tmp_path / "run.csv", columns=columns, align=False)
    assert np.nanmax(np.abs(back.channel("u") - trial.channel("u"))) < 1e-12
    assert back.channel("z") == pytest.approx(trial.channel("z"), rel=1e-12)


@pytest.mark.parametrize(
    ("name", "units", "message"),
    [
        ("run.bag", {}, r"expected one of the endings \.mcap, \.csv, \.parquet"),
        ("run.csv", {"u_m_s": "kg"}, 'unit "kg" has the dimension'),
        ("run.csv", {"cmd.PU": "rpm"}, "its name says no unit"),
        ("run.csv", {"w_ms": "knot"}, 'there is no column "w_ms"'),
        ("run.mcap", {"u_m_s": "knot"}, "MCAP keeps units as they are"),
        ("none/run.mcap", {}, "cannot be written"),
    ],
)
def test_what_cannot_be_written_is_said(
    trial: st.Trial, tmp_path: Path, name: str, units: dict[str, str], message: str
) -> None:
    with pytest.raises(TrialError, match=message):
        export(trial.table, tmp_path / name, units=units)
    assert not (tmp_path / name).exists()


def test_the_verb_exports_every_column_of_a_flight(tmp_path: Path) -> None:
    table = {"t_s": T, "u_m_s": 0.1 * T, "desired.speed_m_s": 0.2 * T, "mode": np.zeros(len(T), int)}
    pl.DataFrame(table).write_parquet(tmp_path / "flight.parquet")
    source, out = str(tmp_path / "flight.parquet"), tmp_path / "flight.mcap"
    answer = CliRunner().invoke(app, ["export", "mcap", source, "--out", str(out), "--json"])
    assert answer.exit_code == 0, answer.output
    assert json.loads(answer.output)["columns"] == list(table)
    assert "desired.speed_m_s" in open_log(out).fields["/trial"]
    knots = tmp_path / "flight.csv"
    call = ["export", "csv", source, "--out", str(knots), "--unit", "u_m_s=knot"]
    assert CliRunner().invoke(app, call).exit_code == 0
    assert pl.read_csv(knots)["u [knot]"][0] == pytest.approx(0.3 / 0.514444, rel=1e-5)
    wrong = (["export", "csv", source, "--out", str(out)], [*call[:-1], "u_m_s"], ["export", "csv", "x.csv"])
    for refused in wrong:
        assert CliRunner().invoke(app, refused).exit_code == 2
    for option in (["--max-step", "0.05"], ["--no-feedback"], ["--no-binary"], ["--navigation", "filter"]):
        refusal = CliRunner().invoke(app, [*call, *option])
        assert refusal.exit_code == 2
        assert f"{option[0]}: has no meaning for export csv" in refusal.output
