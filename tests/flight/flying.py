"""Missions and flights that several tests use."""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import Any

import seatrial as st

BOX = """
format = 1
name = "box"
speed_m_s = 1.5
acceptance_radius_m = 5.0
[[legs]]
north_m = 100.0
east_m = 0.0
depth_m = 10.0
[[legs]]
north_m = 100.0
east_m = 100.0
[[legs]]
north_m = 0.0
east_m = 100.0
depth_m = 5.0
"""
"""Three legs with two changes of depth."""

OUT = """
format = 1
name = "out"
speed_m_s = 1.5
acceptance_radius_m = 5.0
[start]
depth_m = 5.0
[[legs]]
north_m = 60.0
east_m = 0.0
depth_m = 5.0
"""
"""One short leg at one depth."""

STATION = """
format = 1
name = "station"
speed_m_s = 1.0
acceptance_radius_m = 3.0
[start]
depth_m = 5.0
[[legs]]
north_m = 40.0
east_m = 0.0
depth_m = 5.0
hold_s = 40.0
"""
"""A leg with station-keeping at its end."""

CROSS = (0.0, 0.3, 0.0)
"""A current across the first leg, m/s."""


def grouped(**options: Any) -> dict[str, Any]:
    """Keywords of `seatrial.fly` or `fly_batch`: fields of `Water` and `Conditions` put into these."""
    kinds = {"water": st.Water, "conditions": st.Conditions}
    taken = {
        name: {field.name for field in dataclasses.fields(kind)} & set(options)
        for name, kind in kinds.items()
    }
    rest = {
        name: value for name, value in options.items() if not any(name in some for some in taken.values())
    }
    return rest | {
        name: kinds[name](**{field: options[field] for field in some}) for name, some in taken.items()
    }


def mission(text: str) -> st.Mission:
    return st.Mission.from_toml(text)


@cache
def flown(text: str = BOX, current: tuple[float, float, float] = CROSS, **options: Any) -> st.Flight:
    """CWolf on a mission; options must be hashable."""
    return st.fly("cwolf", "cwolf", mission(text), **grouped(current=current, **options))
