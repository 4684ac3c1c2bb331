"""ROS 1 bags that a recorder left without an index: what is whole is read, and said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from seatrial.base.errors import TrialError
from seatrial.logs.formats import open_log
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
