"""Logs as strangers make them: an import ends in a project or in one sentence of ours, and warns nobody.

The files come from `tests.logs.strangers`: of every format, with odd names, stamps, values, types and counts,
half of them injured in their bytes.
"""

from __future__ import annotations

import gzip
import random
import shutil
import struct
import traceback
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seatrial.base.errors import SeatrialError, TrialError
from seatrial.intake.imported import import_logs
from seatrial.intake.survey import survey
from seatrial.logs import mavlink
from seatrial.logs.log import open_log, unpacked
from tests.logs import log_files
from tests.logs.fuzz import mutated, peak_mib
from tests.logs.strangers import WRITERS, written

MOST_MIB = 1024
"""Growth of the process that no file of less than 1 MB may cause."""

LONGEST = 2000
"""Letters of a sentence; it may name every file and topic."""


def wrong(path: Path, project: Path | None) -> tuple[str, str]:
    """How the import of a file ended ("project", "refused"), and what is wrong with that; "" if nothing is.

    Without `project` the file is only surveyed.
    """
    before = peak_mib(reset=True)
    ended, found = "project", ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            if project is None:
                survey([path])
            else:
                import_logs(path, out=project)
    except SeatrialError as error:
        ended = "refused"
        sentence = str(error)
        if len(sentence) > LONGEST or not sentence.replace("\n", "").isprintable():
            found = f"a sentence not fit to show: {sentence[:300]!r}"
        elif error.__cause__ is not None and not isinstance(error.__cause__, SeatrialError | OSError):
            ended = f"wrapped {type(error.__cause__).__name__}"
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        found = traceback.format_exc()
    grown = peak_mib() - before
    if not found and grown > MOST_MIB:
        found = f"{grown} MiB of memory"
    return ended, found


@pytest.mark.parametrize("format", WRITERS)
def test_law_an_import_ends_in_a_project_or_in_one_sentence(format: str, tmp_path: Path) -> None:
    for seed in range(2):
        (tmp_path / str(seed)).mkdir()
        path = written(tmp_path / str(seed), format, seed)
        assert wrong(path, tmp_path / "project" if seed == 1 else None)[1] == "", path


def test_stamps_a_microsecond_apart_make_no_window_wider_than_the_series(tmp_path: Path) -> None:
    """The whole import stays below the memory that is allowed: the median's window took a gibibyte."""
    path = written(tmp_path, "parquet", 2018)
    ended, found = wrong(path, tmp_path / "project")
    assert (ended, found) == ("project", "")


@pytest.mark.long  # 2,002 files
def test_law_two_thousand_files_of_strangers(tmp_path: Path) -> None:
    ends: Counter[tuple[str, str]] = Counter()
    for seed in range(1000, 1154):
        for format in WRITERS:
            folder = tmp_path / "file"
            folder.mkdir()
            path = written(folder, format, seed)
            ended, found = wrong(path, tmp_path / "project" if seed % 4 == 0 else None)
            assert found == "", f"{format} {seed}: {found}"
            ends[format, ended] += 1
            shutil.rmtree(folder)
            shutil.rmtree(tmp_path / "project", ignore_errors=True)
    print(*(f"{format:15} {ended:20} {count:5}" for (format, ended), count in sorted(ends.items())), sep="\n")
    assert ends.total() >= 2000


def test_a_file_that_gzip_packed_a_thousand_times_is_refused_before_it_fills_the_memory(
    tmp_path: Path,
) -> None:
    bomb, honest = tmp_path / "bomb.csv.gz", tmp_path / "honest.csv.gz"
    bomb.write_bytes(gzip.compress(b"1,1\n" * 16_000_000))
    rows = b"".join(b"%d,1.000000,0.000000,0.000000\n" % k for k in range(1_200_000))
    honest.write_bytes(gzip.compress(rows, 1))

    def length(path: Path) -> int:
        with unpacked(path) as stream:
            return sum(map(len, iter(lambda: stream.read(1 << 20), b"")))

    assert length(honest) == len(rows) > 40_000_000
    with pytest.raises(TrialError, match=r"bomb\.csv\.gz: its first .* bytes unpack to .* no log is packed"):
        length(bomb)


def test_junk_between_the_packets_of_imc_is_passed_over_in_one_step(tmp_path: Path) -> None:
    pytest.importorskip("imcpy")
    path = log_files.lsf(tmp_path)
    content = path.read_bytes()
    path.write_bytes(bytes(3_000_000) + content + b"\x54" + bytes(2_000_000))
    topics = {topic.name: topic.samples for topic in open_log(path).topics()}
    assert topics["EstimatedState"] == len(log_files.T)


def test_types_of_a_ulog_within_one_another_are_refused(tmp_path: Path) -> None:
    pytest.importorskip("pyulog")

    def frame(kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    nested = [frame("F", f"n{k}:n{k + 1} a;n{k + 1} b;".encode()) for k in range(14)]
    frames = [
        b"ULog\x01\x12\x35\x01" + bytes(8),
        frame("B", bytes(40)),
        *nested,
        frame("F", b"n14:uint8_t x;"),
    ]
    frames += [frame("F", b"nav:uint64_t timestamp;n0 q;"), frame("A", struct.pack("<BH", 0, 7) + b"nav")]
    frames += [frame("D", struct.pack("<HQ", 7, k) + bytes(1 << 14)) for k in range(5)]
    path = tmp_path / "nested.ulg"
    path.write_bytes(b"".join(frames))
    with pytest.raises(TrialError, match="expected at most 10,000"):
        open_log(path)


@pytest.mark.parametrize("seed", range(12))
def test_law_whole_frames_decoded_in_one_step_give_what_pymavlink_finds_byte_by_byte(
    seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = log_files.tlog(tmp_path)
    path.write_bytes(mutated(path.read_bytes(), np.random.default_rng(seed)))

    def read() -> tuple[list[str], list[tuple[str, bytes, bytes]]] | str:
        try:
            log = open_log(path)
            wanted = {topic: tuple(fields) for topic, fields in log.fields.items()}
            chunks = [(c.topic, c.t.tobytes(), c.values.tobytes()) for c in log.chunks(wanted)]
        except TrialError as error:
            return str(error)
        return log.notes, chunks

    in_one_step = read()
    monkeypatch.setattr(mavlink, "_whole", lambda stream: None)
    assert read() == in_one_step


def test_an_undamaged_telemetry_log_is_searched_for_its_first_message_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mavutil = pytest.importorskip("pymavlink.mavutil")
    searches: list[Any] = []
    search = mavutil.mavlogfile.recv_msg

    def counted(stream: Any) -> Any:
        searches.append(stream)
        return search(stream)

    monkeypatch.setattr(mavutil.mavlogfile, "recv_msg", counted)
    log = open_log(log_files.tlog(tmp_path))
    assert sum(topic.samples for topic in log.topics()) == len(log_files.T)
    assert len(searches) == 4  # the first message and the end, when it is opened and when it is surveyed


def test_what_the_callers_own_function_raises_in_a_survey_is_no_fault_of_the_log(tmp_path: Path) -> None:
    mine = ValueError("mine")

    def share(done: float, name: str) -> None:
        raise mine

    with pytest.raises(ValueError, match="mine") as raised:
        survey([log_files.tlog(tmp_path)], share=share)
    assert raised.value is mine


@pytest.mark.parametrize(("noise", "ended"), [(2_000, "project"), (1_100_000, "refused")])
def test_a_telemetry_log_of_hardly_any_message_is_refused_after_its_first_part(
    tmp_path: Path, noise: int, ended: str
) -> None:
    path = log_files.tlog(tmp_path)
    path.write_bytes(path.read_bytes()[:20_000] + random.Random(1).randbytes(noise))
    if ended == "project":
        assert any("are no whole messages" in note for note in survey([path]).logs[0].notes)
        return
    with pytest.raises(TrialError, match=r"of its first 1,0\d\d,\d\d\d bytes are whole MAVLink messages"):
        survey([path])
