"""A file that is given where one of another kind belongs is named as what it is, by every reader."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from seatrial import Autopilot, Campaign, Mission, Vehicle
from seatrial.base.errors import SeatrialError
from seatrial.bench_test.file import parse as parse_bench
from seatrial.sensors import load_sensors

READERS: dict[str, Callable[[Path], Any]] = {
    "a vehicle file": Vehicle.load,
    "an autopilot file": Autopilot.load,
    "a mission file": Mission.load,
    "a campaign file": Campaign.load,
    "a bench file": lambda path: parse_bench(path.read_text(), str(path)),
    "a set of sensors": lambda path: load_sensors(path, Vehicle.load("cwolf")),
}

EXAMPLES = Path(__file__).parents[2] / "python" / "seatrial" / "examples"


def files() -> dict[str, str]:
    return {
        "a vehicle": Vehicle.load("cwolf").to_toml(),
        "an autopilot": Autopilot.load("cwolf").to_toml(),
        "a mission": (EXAMPLES / "missions" / "hover.toml").read_text(),
        "a campaign": (EXAMPLES / "cwolf" / "campaign.toml").read_text(),
        "a bench file": (EXAMPLES / "cwolf" / "bench.toml").read_text(),
        "the recipe of a generated trial": (EXAMPLES / "cwolf" / "trials" / "dive.toml").read_text(),
        "a set of sensors": "format = 1\n[sensors.gyro]\n",
        "an empty file": "# later\n",
    }


@pytest.mark.parametrize("expected", READERS)
def test_a_file_of_another_kind_is_named(expected: str, tmp_path: Path) -> None:
    for found, text in files().items():
        if expected.removesuffix(" file") == found.removesuffix(" file"):
            continue
        path = tmp_path / "given.toml"
        path.write_text(text)
        with pytest.raises(SeatrialError) as refused:
            READERS[expected](path)
        said = f"{path}: expected {expected}, found {found}; check which file goes where"
        assert str(refused.value) == said


def test_a_key_of_another_kind_is_a_wrong_key(tmp_path: Path) -> None:
    text = Vehicle.load("cwolf").to_toml().replace("format = 1", "format = 1\nlegs = 3", 1)
    with pytest.raises(SeatrialError, match="unknown field `legs`"):
        Vehicle.from_toml(text)
