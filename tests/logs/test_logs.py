"""Every reader gives the motion that a library of its format wrote, and survives a damaged file."""

from __future__ import annotations

import tracemalloc
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from seatrial.base.errors import TrialError
from seatrial.logs.join import Wanted, join
from seatrial.logs.log import FORMATS, format_of, open_log
from tests.logs import log_files
from tests.logs.fuzz import mutated, survives
from tests.logs.log_files import UNIX_S, T, U

# kind, topic, field, factor of the field to U, Unix time, tolerance
READ = (
    ("csv", "nav", "u", 1.0, False, 0.0),
    ("spreadsheet", "export", "Speed (m/s)", 1.0, False, 0.0),
    ("blanks", "table", "u", 1.0, False, 0.0),
    ("utf16", "wide", "u", 1.0, False, 0.0),
    ("parquet", "nav", "u", 1.0, False, 0.0),
    ("matlab", "nav", "angles[2]", 3.0, False, 0.0),
    ("matlab73", "nav", "angles[2]", 3.0, False, 0.0),
    ("alog", "NAV_SPEED", "value", 1.0, False, 0.0),
    ("alog", "NODE_REPORT", "SPD", 1.0, False, 0.0),
    ("lsf", "EstimatedState", "u", 1.0, True, 1e-6),
    ("lsf", "EulerAngles[2]", "psi", 2.0, True, 0.0),
    ("lsf_gz", "EulerAngles[1]", "psi", 1.0, True, 0.0),
    ("ulog", "nav", "angles[1]", 2.0, False, 1e-6),
    ("dataflash", "NAV[0]", "U", 1.0, False, 1e-6),
    ("dataflash", "NAV[0]", "Yaw", 1.0, False, 0.006),
    ("dataflash_text", "NAV", "Yaw", 2.0, False, 0.0),
    ("tlog", "ATTITUDE", "roll", 1.0, True, 1e-6),
    ("bag1", "/u", "data", 1.0, True, 0.0),
    ("bag2_sqlite", "/odom", "twist.twist.linear.x", 1.0, True, 0.0),
    ("mcap_ros2", "/odom", "twist.twist.linear.x", 1.0, True, 0.0),
    ("mcap_json", "/nav", "u", 1.0, True, 0.0),
)


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A log of every format, by kind."""
    return log_files.write(tmp_path_factory.mktemp("logs"))


@pytest.mark.parametrize(("kind", "topic", "name", "factor", "unix", "tolerance"), READ)
def test_a_log_gives_the_motion_that_was_written(
    logs: dict[str, Path], kind: str, topic: str, name: str, factor: float, unix: bool, tolerance: float
) -> None:
    log = open_log(logs[kind])
    samples = log.read({topic: [name]})[topic]
    stamps = samples.t + (log.epoch_s or 0.0) - (UNIX_S if unix else log.epoch_s or 0.0)
    np.testing.assert_allclose(stamps, T, atol=2e-6)
    np.testing.assert_allclose(samples.fields[name], factor * U, atol=tolerance, rtol=0.0)


def test_every_format_has_a_log_here(logs: dict[str, Path]) -> None:
    assert {format_of(path) for path in logs.values()} == set(FORMATS)


def test_the_survey_says_what_a_field_holds(logs: dict[str, Path]) -> None:
    (topic,) = open_log(logs["csv"]).topics()
    assert (topic.samples, topic.disordered) == (len(T), 0)
    assert topic.rate_hz == pytest.approx(10.0)
    assert topic.interval_s == pytest.approx(0.1)
    field = topic.fields[1]
    assert (field.name, field.unit, field.samples) == ("u", "m/s", len(T))
    assert (field.minimum, field.maximum) == (U.min(), U.max())
    assert field.mean == pytest.approx(U.mean())
    assert field.deviation == pytest.approx(U.std())


def test_moments_joined_from_chunks_are_those_of_the_whole(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    from seatrial.logs import delimited

    monkeypatch.setattr(delimited, "_BLOCK_BYTES", 400)
    (topic,) = open_log(log_files.csv(tmp_path)).topics()
    field = topic.fields[1]
    assert field.samples == len(T)
    assert field.deviation == pytest.approx(U.std(), rel=1e-12)


def test_cells_of_a_spreadsheet_are_named_by_line(logs: dict[str, Path]) -> None:
    log = open_log(logs["spreadsheet"])
    samples = log.read({"export": ["Heading"]})["export"]
    assert np.flatnonzero(np.isnan(samples.fields["Heading"])).tolist() == [55]
    assert log.notes == ['column "Heading": a cell holds text, "#REF!" in line 60; read as empty']


def test_a_late_receiver_does_not_shift_stamps_since_boot(logs: dict[str, Path]) -> None:
    """The tlog's stamps of reception scatter by 40 ms; the messages' own do not."""
    t = open_log(logs["tlog"]).read({"ATTITUDE": ["roll"]})["ATTITUDE"].t
    assert np.ptp(np.diff(t)) < 1e-5


def test_parameters_and_words_of_the_autopilot(logs: dict[str, Path]) -> None:
    log = open_log(logs["dataflash"])
    assert log.parameters == {"FRAME_CONFIG": 2.0}
    assert [(event.t, event.kind, event.text) for event in log.events()] == [
        (0.0, "message", "ArduSub V4.1.0"),
        (0.5, "mode", "ALT_HOLD"),
    ]


def test_an_unknown_topic_or_field_is_named_with_its_neighbour(logs: dict[str, Path]) -> None:
    log = open_log(logs["dataflash"])
    with pytest.raises(TrialError, match=r'no topic "NAV\[2\]"; did you mean "NAV\[1\]"'):
        log.read({"NAV[2]": ["U"]})
    with pytest.raises(TrialError, match='no field "yaw"; did you mean "Yaw"'):
        log.read({"NAV[0]": ["yaw"]})


def test_a_missing_package_is_named_with_its_extra(
    logs: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "imcpy", None)
    with pytest.raises(TrialError, match=r'needs the package "imcpy".*seatrial\[logs\]'):
        open_log(logs["lsf"])


CUT = ("csv", "alog", "lsf", "lsf_gz", "ulog", "dataflash", "dataflash_text", "tlog", "mcap_ros2", "matlab")


@pytest.mark.parametrize("kind", CUT)
def test_a_truncated_log_is_read_up_to_its_end_and_says_so(
    logs: dict[str, Path], kind: str, tmp_path: Path
) -> None:
    whole = logs[kind]
    cut = tmp_path / whole.name
    data = whole.read_bytes()
    cut.write_bytes(data[: int(0.6 * len(data)) + 5])
    log = open_log(cut)
    most = max(topic.samples for topic in log.topics())
    assert 0.4 * len(T) < most < len(T) or kind == "matlab"  # whose fields are whole one after another
    # A table whose last row lacks no cell cannot be told from one without a last line feed.
    assert any("cut " in note for note in log.notes) or kind == "csv"


def test_a_file_that_is_nothing_without_its_end_is_refused_with_the_reason(
    logs: dict[str, Path], tmp_path: Path
) -> None:
    for kind, said in (("parquet", "cut off"), ("matlab73", "truncated")):
        cut = tmp_path / logs[kind].name
        cut.write_bytes(logs[kind].read_bytes()[:-40])
        with pytest.raises(TrialError, match=said):
            open_log(cut)


def test_a_length_that_lies_asks_for_no_memory(logs: dict[str, Path], tmp_path: Path) -> None:
    """mcap's own reader would ask for as much as a record says, up to 4 GiB."""
    data = bytearray(logs["mcap_ros2"].read_bytes())
    chunk = 8
    while data[chunk] != 6:
        chunk += 9 + int.from_bytes(data[chunk + 1 : chunk + 9], "little")
    data[chunk + 4] = 0xF0  # the length: 4 GiB
    path = tmp_path / "lie.mcap"
    path.write_bytes(data)
    tracemalloc.start()
    log = open_log(path)
    (topic,) = log.topics()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert topic.samples == len(T)
    assert any("cut off" in note for note in log.notes)
    assert peak < 100e6


def test_a_damaged_column_of_a_parquet_file_is_empty_and_said(logs: dict[str, Path], tmp_path: Path) -> None:
    data = bytearray(logs["parquet"].read_bytes())
    data[60:70] = bytes(10)
    path = tmp_path / "nav.parquet"
    path.write_bytes(data)
    log = open_log(path)
    (topic,) = log.topics()
    numbers = [field.samples for field in topic.fields if field.name != "remark"]
    assert sorted(numbers) == [0, len(T)]
    assert any("is damaged" in note for note in log.notes)


def test_lines_of_a_table_with_missing_cells_and_null_bytes_are_said(tmp_path: Path) -> None:
    path = tmp_path / "nav.csv"
    rows = [f"{0.1 * k:.1f},{k},{2 * k}" for k in range(60)]
    rows[30], rows[40] = "3.0,30", "4.0,\0\0,80"
    path.write_text("t,a,b\n" + "\n".join(rows) + "\n")
    log = open_log(path)
    a = log.read({"nav": ["a"]})["nav"].fields["a"]
    assert np.flatnonzero(np.isnan(a)).tolist() == [40]
    assert any("a line has fewer than 3 cells" in note for note in log.notes)


def test_lines_that_a_thousands_separator_cut_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "nav.csv"
    rows = [f"{0.1 * k:.1f},{k},{2 * k}" for k in range(60)]
    rows[30], rows[40] = "3.0,1,234.5,60", rows[40] + ",,"  # a trailing separator cuts nothing
    path.write_text("t,a,b\n" + "\n".join(rows) + "\n")
    log = open_log(path)
    a = log.read({"nav": ["a"]})["nav"].fields["a"]
    assert a.tolist() == [k for k in range(60) if k != 30]
    assert any("a line has more than 3 cells" in note for note in log.notes)


def test_a_clock_that_begins_again_ends_the_recording(tmp_path: Path) -> None:
    path = tmp_path / "nav.csv"
    t = np.concatenate([np.arange(0.0, 20.0, 0.1), np.arange(0.0, 50.0, 0.1), np.arange(1.0, 9.0, 0.1)])
    t[[300, 301]] = t[[301, 300]]  # a row out of order
    path.write_text("t,a\n" + "".join(f"{x:.1f},{k}\n" for k, x in enumerate(t.tolist())))
    log = open_log(path)
    found = join([log], [Wanted("nav", "a")], {})
    assert found.table["nav.a"].to_list() == [*range(200, 300), 301, 300, *range(302, 700)]
    assert any(
        "time begins again 2 times, the first in row 201 (from 19.9 to 0 s)" in str(n) for n in found.notes
    )
    assert any("runs backwards once" in str(n) for n in found.notes)


def _dated(path: Path, stamps: list[str]) -> Path:
    path.write_text("time,a\n" + "".join(f"{stamp},{k}\n" for k, stamp in enumerate(stamps)))
    return path


def test_zones_of_dates_are_subtracted_also_over_a_change_of_summer_time(tmp_path: Path) -> None:
    """30 s before and after 01:00 UTC of 27 October 2024, as a logger in central Europe writes them."""
    begin = datetime(2024, 10, 27, 0, 59, 30, tzinfo=UTC)
    utc = [begin + timedelta(seconds=k) for k in range(60)]
    local = [t.astimezone(timezone(timedelta(hours=2 if k < 30 else 1))) for k, t in enumerate(utc)]
    forms = {
        "offset": [t.isoformat() for t in local],
        "hours": [t.isoformat()[:-3] for t in local],
        "blank": [t.strftime("%Y-%m-%d %H:%M:%S %z") for t in local],
        "word": [t.strftime("%Y-%m-%d %H:%M:%S UTC") for t in utc],
        "z": [t.strftime("%Y-%m-%dT%H:%M:%SZ") for t in utc],
        "halves": [t.strftime("%m/%d/%Y %I:%M:%S %p") for t in utc],
    }
    for name, stamps in forms.items():
        t = open_log(_dated(tmp_path / f"{name}.csv", stamps)).read({name: ["a"]})[name].t
        np.testing.assert_array_equal(t, [one.timestamp() for one in utc], name)


def test_a_damaged_stamp_costs_its_row_and_nothing_else(tmp_path: Path) -> None:
    stamps = [f"{0.1 * k:.1f}" for k in range(900)]
    stamps[90], stamps[899] = "1e18", "-1e6"
    found = join([open_log(_dated(tmp_path / "nav.csv", stamps))], [Wanted("nav", "a")])
    assert len(found.table) == 898
    assert any(
        "the stamps of 2 rows are far from those around them, the first in row 91" in str(n)
        for n in found.notes
    )


@pytest.mark.parametrize(
    ("stamps", "said"),
    [
        ([f"{99.5 - k}" for k in range(60)], 'column "time" runs backwards, from 99.5 in line 2 to 98.5 in'),
        (["5.0"] * 60, 'column "time" is 5 in all of the first 60 rows'),
        (["27 October 2024 um 02.58"] * 60, '"27 October 2024 um 02.58" in line 2, whose form is not known'),
        (["2024-06-01 12:00:00"] * 60, r"rows with a time \(60\) all have the same one, 1717243200 s"),
    ],
)
def test_stamps_that_are_no_times_are_refused_with_the_reason(
    tmp_path: Path, stamps: list[str], said: str
) -> None:
    log = open_log(_dated(tmp_path / "nav.csv", stamps))
    with pytest.raises(TrialError, match=said):
        join([log], [Wanted("nav", "a")])


@pytest.mark.parametrize(
    ("cell", "number", "stamp"),
    [
        ('"1,{k:03d}"', 1000, "{k}.5"),
        ('"0,{k:03d}"', 0.0, "{k}.5"),
        ("{k}", 0, '"2024-06-01 12:00:{k:02d},250"'),
    ],
)
def test_quoted_cells_may_hold_the_separator(tmp_path: Path, cell: str, number: float, stamp: str) -> None:
    path = tmp_path / "nav.csv"
    rows = [f"{stamp.format(k=k)},{cell.format(k=k)}" for k in range(60)]
    path.write_text("time,a\n" + "\n".join(rows) + "\n")
    samples = open_log(path).read({"nav": ["a"]})["nav"]
    scale = 1e-3 if cell.startswith('"0') else 1.0
    np.testing.assert_allclose(samples.fields["a"], number + scale * np.arange(60.0), rtol=1e-12)
    np.testing.assert_allclose(np.diff(samples.t), 1.0, rtol=1e-6)


def test_a_comma_that_may_be_decimal_or_group_thousands_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "nav.csv"
    path.write_text("t,a\n" + "".join(f'{k},"1,{k:03d}"\n' for k in range(60)))
    with pytest.raises(TrialError, match=r'line 12, column 2: "1,010": whether the comma is a decimal comma'):
        open_log(path)


@pytest.mark.parametrize("nulls", [4096, 200_000])
def test_null_bytes_at_the_end_are_left_out_and_said(tmp_path: Path, nulls: int) -> None:
    path = tmp_path / "nav.csv"
    text = "t,a\n" + "".join(f"{0.1 * k:.1f},{k}\n" for k in range(60)) + "6"
    path.write_bytes(text.encode() + bytes(nulls))
    log = open_log(path)
    assert log.read({"nav": ["a"]})["nav"].fields["a"].tolist() == list(range(60))
    assert any(f"it ends with null bytes ({nulls:,})" in note for note in log.notes)


def test_a_name_in_quotes_may_hold_a_line_feed(tmp_path: Path) -> None:
    path = tmp_path / "nav.csv"
    path.write_text('t,"yaw\nangle"\ns,rad\n' + "".join(f"{0.1 * k:.1f},{k}\n" for k in range(60)))
    log = open_log(path)
    assert log.fields == {"nav": {"t": "s", "yaw angle": "rad"}}
    assert log.read({"nav": ["yaw angle"]})["nav"].fields["yaw angle"].tolist() == list(range(60))


def test_numbers_and_dates_as_text_are_read_from_parquet(tmp_path: Path) -> None:
    path = tmp_path / "nav.parquet"
    stamps = [f"2024-06-01T12:00:{k:02d}+02:00" for k in range(60)]
    pl.DataFrame({"time": stamps, "u": [f"{0.1 * k:.1f}" for k in range(60)]}).write_parquet(path)
    samples = open_log(path).read({"nav": ["u"]})["nav"]
    np.testing.assert_array_equal(samples.t, 1_717_236_000.0 + np.arange(60.0))
    np.testing.assert_allclose(samples.fields["u"], 0.1 * np.arange(60.0), atol=1e-12)


def test_a_table_of_text_with_the_name_of_a_binary_log_is_read(tmp_path: Path) -> None:
    path = tmp_path / "nav.ulg"
    path.write_text("t,a\n" + "".join(f"{0.1 * k:.1f},{k}\n" for k in range(60)))
    assert open_log(path).format == "csv"


def test_a_file_of_no_kind_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.dat"
    path.write_bytes(bytes(range(256)) * 4)
    with pytest.raises(TrialError, match=r"no known format|not a text file"):
        open_log(path)
    path.write_bytes(b"")
    with pytest.raises(TrialError, match="empty"):
        open_log(path)
    with pytest.raises(TrialError, match="folder"):
        open_log(tmp_path)
    with pytest.raises(TrialError, match="does not exist"):
        open_log(tmp_path / "nothing.csv")


@pytest.mark.parametrize("kind", list(dict.fromkeys(row[0] for row in READ)))
def test_damaged_logs_are_read_in_part_or_refused(logs: dict[str, Path], kind: str, tmp_path: Path) -> None:
    source = logs[kind]
    if source.is_dir():
        pytest.skip("a folder: its files are those of the other kinds")
    rng = np.random.default_rng(len(kind))
    for _ in range(25):
        path = tmp_path / source.name
        path.write_bytes(mutated(source.read_bytes(), rng))
        complaint = survives(path)
        assert complaint is None, complaint


def test_a_topic_of_a_ulog_without_stamps_is_left_out(tmp_path: Path) -> None:
    path = log_files.ulog(tmp_path)
    path.write_bytes(path.read_bytes().replace(b"uint64_t timestamp;", b"uint64_t timestemp;", 1))
    with pytest.raises(TrialError, match="holds no topic with samples"):
        open_log(path)


@pytest.mark.parametrize("kind", ["dataflash", "ulog"])
def test_scattered_damage_costs_the_messages_that_it_hits(
    logs: dict[str, Path], kind: str, tmp_path: Path
) -> None:
    """Neither format marks the ends of its messages: reading must find its way back after each."""
    whole = sum(topic.samples for topic in open_log(logs[kind]).topics())
    data = bytearray(logs[kind].read_bytes())
    rng = np.random.default_rng(5)
    places = rng.integers(len(data) // 5, len(data) - 200, size=10)
    for at in places.tolist():
        data[at] ^= int(rng.integers(1, 256))
    data[len(data) // 2 : len(data) // 2 + 60] = rng.bytes(60)
    path = tmp_path / logs[kind].name
    path.write_bytes(data)
    log = open_log(path)
    assert whole - 30 <= sum(topic.samples for topic in log.topics()) < whole
    (note,) = [text for text in log.notes if "are no whole messages" in text]
    assert "byte" in note


def test_a_damaged_stamp_or_instance_is_no_sample(logs: dict[str, Path], tmp_path: Path) -> None:
    """A flipped high byte of TimeUS is a year; a flipped instance number is no further instrument."""
    data = bytearray(logs["dataflash"].read_bytes())
    first = data.find(b"\xa3\x95\x83", 700)
    length = data.find(b"\xa3\x95\x83", first + 1) - first
    data[first + 40 * length + 3 + 5] ^= 0x10
    data[first + 60 * length + 11] = 77
    data[first + 80 * length] ^= 0xFF
    path = tmp_path / "damaged.BIN"
    path.write_bytes(data)
    log = open_log(path)
    topics = {topic.name: topic for topic in log.topics()}
    assert set(topics) == {"PARM", "MODE", "MSG", "NAV[0]", "NAV[1]"}
    assert max(topic.end_s for topic in topics.values()) == pytest.approx(T[-1])
    assert "1 messages are stamped unlike those around them; left out" in log.notes


def test_the_tables_of_a_log_are_no_topics_and_every_rate_is_a_number(logs: dict[str, Path]) -> None:
    topics = {topic.name: topic for topic in open_log(logs["dataflash"]).topics()}
    assert "FMT" not in topics
    assert round(topics["MODE"].rate_hz, 1) == 0.0
    assert topics["NAV[0]"].rate_hz == pytest.approx(10.0)


def test_a_data_set_that_the_file_does_not_hold_is_left_out(logs: dict[str, Path], tmp_path: Path) -> None:
    """Its shape alone takes no room in the file, and 0.8 GB in memory, several times over."""
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "hollow.mat"
    path.write_bytes(logs["matlab73"].read_bytes())
    with h5py.File(path, "a") as file:
        file.create_dataset("hollow", shape=(100_000_000,), chunks=(10_000,), dtype="f8")
    log = open_log(path)
    assert "hollow: 100000000 values promised, more than the file can hold; left out" in log.notes
    assert max(topic.samples for topic in log.topics()) == len(T)
