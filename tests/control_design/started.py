"""Start autopilots that tests of several rooms look at, each computed once by a process."""

from __future__ import annotations

from functools import cache

import seatrial as st


@cache
def started(vehicle: str, law: str = "pid") -> st.Autopilot:
    """Start autopilot of a built-in vehicle, or of a vehicle file."""
    return st.Autopilot.from_toml(st.start_autopilot(st.Vehicle.load(vehicle), law=law))
