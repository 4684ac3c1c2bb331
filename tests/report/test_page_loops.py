"""Open loops of a page: parts that add up to the loop of the margin engine for any factors of its gains."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial.control_design.margin_constraint import MarginConstraint
from seatrial.report.page.flying import open_loops
from tests.control_design.started import started


def unpacked(series: dict[str, Any]) -> np.ndarray:
    whole = np.frombuffer(base64.b64decode(series["data"]), "<i2").astype(float)
    return np.asarray(series["least"] + (whole + 32500) * series["step"])


@pytest.mark.parametrize("name", ["cwolf", "remus100"])
def test_the_parts_of_a_loop_add_up_for_any_gains(name: str) -> None:
    vehicle, autopilot = st.Vehicle.load(name), st.Autopilot.load(name)
    found, constraint = open_loops(vehicle, autopilot), MarginConstraint(vehicle, autopilot)
    factors = {"K_P": 0.4, "K_I": 3.0, "K_D": 1.7}
    assert [(one["mode"], one["speed"]) for one in found["points"]] == constraint.points
    grown = {point.speed_m_s: point.growth_per_s[0] for point in constraint.margins({})}
    own = autopilot.gains()
    for loop in ("surge", "pitch", "heading"):
        gains = {
            gain: factors[gain.split(".")[1]] * value
            for gain, value in own.items()
            if gain.startswith(f"{loop}.K_")
        }
        for point, (omega, responses) in zip(found["points"], constraint.open_loops(gains), strict=True):
            assert point["stable"] == (grown[point["speed"]] == 0.0)
            names = [one["loop"] for one in point["loops"]]
            parts = point["loops"][names.index(loop)]["parts"]
            whole = sum(
                factors.get(key, 1.0) * np.exp(unpacked(size) + 1j * unpacked(angle))
                for key, (size, angle) in parts.items()
            )
            expected = responses[0, names.index(loop)]
            # 16 bits of a logarithm's range of some 25 and of some ten turns; parts may cancel in their sum.
            room = sum(factors.get(key, 1.0) * np.exp(unpacked(size)) for key, (size, _) in parts.items())
            assert np.max(np.abs(whole - expected) / room) < 1e-3
            assert found["omega"] == pytest.approx([omega[0], omega[-1], len(omega)])


def test_an_autopilot_without_such_loops_says_why() -> None:
    lauv = st.Vehicle.load("lauv")
    found = open_loops(lauv, started("lauv", "lqr"))
    assert found["points"] == []
    assert 'control = "pid"' in found["said"]
