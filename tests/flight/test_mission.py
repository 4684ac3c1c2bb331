"""Missions from Python: files, examples, what the front adds to the core."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import seatrial as st
from seatrial.base.errors import VehicleError
from seatrial.flight.mission import Mission

EXAMPLES = sorted((Path(__file__).parents[2] / "examples" / "missions").glob("*.toml"))
TEXT = """
format = 1
name = "out"
speed_m_s = 2.0
acceptance_radius_m = 3.0
[limits]
max_depth_m = 10.0
fence_m = [[-50.0, -50.0], [-50.0, 50.0], [50.0, 50.0], [50.0, -50.0]]
[[legs]]
north_m = 30.0
east_m = 40.0
hold_s = 5.0
"""


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_load_and_survive_their_own_text(path: Path) -> None:
    mission = Mission.load(path)
    assert mission.description
    for expanded in (False, True):
        again = Mission.from_toml(mission.to_toml(expanded=expanded))
        # An angle is written in degrees.
        assert again.length == pytest.approx(mission.length, rel=1e-12)
        assert again.planned_time == pytest.approx(mission.planned_time, rel=1e-12)
        assert again.waypoints["label"] == mission.waypoints["label"]


def test_there_is_an_example_on_the_chart() -> None:
    assert any(Mission.load(path).origin is not None for path in EXAMPLES)


def test_a_mission_tells_its_way_and_its_limits() -> None:
    mission = st.Mission.from_toml(TEXT)
    assert mission.name == mission.core.name == "out"
    assert (mission.length, mission.planned_time) == (50.0, 30.0)
    assert mission.limits == {"max_depth_m": 10.0, "min_altitude_m": 0.0, "max_time_s": np.inf}
    assert mission.fence.shape == (4, 2)
    assert mission.start["heading"] == pytest.approx(np.arctan2(4.0, 3.0))
    assert mission.waypoints["hold_s"].tolist() == [5.0]
    assert mission.origin is None


def test_a_mission_cannot_be_changed() -> None:
    mission = Mission.from_toml(TEXT)
    with pytest.raises(dataclasses.FrozenInstanceError):
        mission.core = mission.core  # type: ignore[misc]
    mission.limits["max_depth_m"] = 0.0
    assert mission.limits["max_depth_m"] == 10.0


def test_without_a_fence_there_is_no_corner() -> None:
    text = "\n".join(line for line in TEXT.splitlines() if not line.startswith("fence_m"))
    assert Mission.from_toml(text).fence.shape == (0, 2)


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(VehicleError, match=r"nowhere\.toml: not readable as a mission file.*No such file"):
        Mission.load(tmp_path / "nowhere.toml")
    (tmp_path / "log.bin").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(VehicleError, match="not a text file"):
        Mission.load(tmp_path / "log.bin")
    (tmp_path / "broken.toml").write_text("legs = [")
    with pytest.raises(VehicleError, match=r"broken\.toml: line 1"):
        Mission.load(tmp_path / "broken.toml")


def test_the_map_loads_with_the_first_place_in_degrees_only() -> None:
    code = (
        "import sys, seatrial as st; st.Mission; assert 'pyproj' not in sys.modules;"
        f" st.Mission.from_toml({TEXT!r}); assert 'pyproj' not in sys.modules"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
