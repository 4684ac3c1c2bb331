"""ROS 1 bags that a recorder left without an index: what is whole is read, and said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from seatrial.base.errors import TrialError
from seatrial.logs.log import open_log
from tests.logs import log_files

pytest.importorskip("rosbags")


@pytest.mark.parametrize("share", [0.3, 0.7])
@pytest.mark.parametrize("packed", ["none", "BZ2", "LZ4"])
def test_a_bag_that_was_cut_off_is_read_up_to_the_cut(tmp_path: Path, packed: str, share: float) -> None:
    path = log_files.bag1(tmp_path, packed)
    whole = path.read_bytes()
    path.write_bytes(whole[: 4096 + int(share * (len(whole) - 4096))])  # behind the head of the bag
    log = open_log(path)
    [topic] = log.topics()
    assert topic.name == "/u"
    # bz2 and LZ4 need whole blocks, and the index at the end takes part of the file
    assert topic.samples > 0.4 * share * len(log_files.T)
    assert any("has no index" in note for note in log.notes)
    values = np.concatenate([chunk.values[:, 0] for chunk in log.chunks({"/u": ["data"]})])
    np.testing.assert_array_equal(values, log_files.U[: len(values)])


def test_a_bag_that_is_cut_before_its_first_message_is_refused(tmp_path: Path) -> None:
    path = log_files.bag1(tmp_path)
    path.write_bytes(path.read_bytes()[:4100])
    with pytest.raises(TrialError, match="no message"):
        open_log(path)


def test_a_message_without_its_stamp_costs_only_itself(tmp_path: Path) -> None:
    path = log_files.bag1(tmp_path)
    whole = path.read_bytes()
    at = whole.index(b"time=", whole.index(b"op=\x02"))
    path.write_bytes(whole[:at] + b"tame" + whole[at + 4 : int(0.7 * len(whole))])
    [topic] = open_log(path).topics()
    assert topic.samples > 0.4 * len(log_files.T)
    assert topic.start_s > log_files.T[0]


def test_what_a_package_quotes_of_a_damaged_file_is_cut(tmp_path: Path) -> None:
    path = log_files.bag2_sqlite(tmp_path)
    [database] = path.glob("*.db3")
    data = database.read_bytes()
    at = data.index(b"float64 ")
    damaged = tmp_path / "damaged.db3"
    damaged.write_bytes(data[:at] + b"\x1b[2J}{" + data[at + 6 :])
    try:
        said = "; ".join(open_log(damaged).notes)
    except TrialError as error:
        said = str(error)
    assert len(said) < 500
    assert "\x1b" not in said
