"""A keyword that moved into an object is refused with the call that replaces it."""

from __future__ import annotations

from typing import Any

import pytest

import seatrial as st

MISSION = """
format = 1
name = "out"
speed_m_s = 1.5
acceptance_radius_m = 5.0
[[legs]]
north_m = 60.0
east_m = 0.0
depth_m = 5.0
"""


@pytest.mark.parametrize("fly", [st.fly, st.fly_batch])
@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"current": [0.0, 0.3, 0.0]}, "current is a field of st.Water; give water=st.Water(current=...)"),
        (
            {"sensors": "typical"},
            "sensors is a field of st.Conditions; give conditions=st.Conditions(sensors",
        ),
        ({"water": [0.0, 0.3, 0.0]}, "water: expected an st.Water, found"),
    ],
)
def test_a_keyword_that_moved_is_refused_with_its_object(fly: Any, given: Any, expected: str) -> None:
    with pytest.raises(TypeError) as error:
        fly("cwolf", "cwolf", st.Mission.from_toml(MISSION), **given)
    assert expected in str(error.value)


def test_an_unknown_keyword_is_refused_by_python_itself() -> None:
    fly: Any = st.fly
    with pytest.raises(TypeError, match="unexpected keyword argument 'tide'"):
        fly("cwolf", "cwolf", st.Mission.from_toml(MISSION), tide=1.0)


@pytest.mark.parametrize(
    ("name", "strategy"),
    [("rare_failures", "Rare"), ("falsify", "Falsify"), ("failure_boundary", "Boundary")],
)
def test_a_function_that_became_a_strategy_names_it(name: str, strategy: str) -> None:
    with pytest.raises(AttributeError, match=rf"strategy=st\.{strategy}\("):
        getattr(st, name)
    assert strategy in st.__all__
