"""Suspects: the change that was made is named first, with its size, and what it cannot be told from."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

import seatrial as st
from seatrial.recorded.candidates import candidates, payload
from seatrial.recorded.restarts import restarts
from seatrial.recorded.spread import Spread, spread_of_reference
from seatrial.recorded.suspects import Suspect, suspects
from tests.recorded_logs import fitted, log


def found(changes: dict[str, float]) -> tuple[Suspect, ...]:
    model = fitted().vehicle
    windows = restarts(model, log(4, tuple(changes.items())).trial)
    return suspects(windows, spread(), candidates(model, identified=fitted().names))


def spread() -> Spread:
    return spread_of_reference([restarts(fitted().vehicle, log(100).trial)])


def test_a_payload_is_named_with_its_weight_and_place() -> None:
    first = found(payload(fitted().vehicle).changes(np.array([3.0, 1.2])))[0]
    assert first.name.startswith("payload")
    assert "payload" in first.change
    assert "in water at x =" in first.change
    wet, moment = first.values
    # 3 kg at 0.4 m; the density that the suspect assumes is that of the payload, the rest is noise.
    assert wet == pytest.approx(3.0, rel=0.15)
    assert moment == pytest.approx(1.2, rel=0.15)


def test_more_drag_ahead_is_named_with_its_share() -> None:
    values = fitted().vehicle.coefficients()
    first = found({name: 1.25 * values[name] for name in ("X_u", "X_uu")})[0]
    assert first.name == "drag ahead (X_u, X_uu)"
    assert first.values[0] == pytest.approx(0.25, abs=0.03)
    assert "X_uu" in first.alike  # one speed does not tell the linear from the quadratic part


def test_lost_buoyancy_cannot_be_told_from_weight() -> None:
    listed = found({"B": fitted().vehicle.coefficients()["B"] - 15.0})
    ballast = next(one for one in listed if one.name == "B")
    assert ballast.values[0] == pytest.approx(-15.0, abs=2.0)
    assert "m" in ballast.alike


@given(some.floats(-5.0, 5.0), some.floats(-3.0, 3.0))
@settings(max_examples=40, deadline=None)
def test_law_a_payload_moves_the_weight_in_water_and_its_moment(wet: float, moment: float) -> None:
    vehicle = st.Vehicle.load("cwolf")
    g = vehicle.environment()["g"]
    before = vehicle.coefficients()
    after = before | payload(vehicle).changes(np.array([wet, moment]))

    def weight(values: dict[str, float]) -> tuple[float, float]:
        load = values["m"] * g
        return load - values["B"], values["x_g"] * load - values["x_b"] * values["B"]

    # Both are differences of numbers of about 1300 N: 1e-9 is their rounding.
    assert weight(after)[0] - weight(before)[0] == pytest.approx(wet * g, abs=1e-9)
    assert weight(after)[1] - weight(before)[1] == pytest.approx(moment * g, abs=1e-9)


def test_no_change_changes_nothing() -> None:
    vehicle = st.Vehicle.load("cwolf")
    present = vehicle.coefficients()
    for one in candidates(vehicle):
        for name, value in one.changes(np.zeros(len(one.scale))).items():
            assert value == pytest.approx(present.get(name, 0.0), rel=1e-12, abs=1e-12), one.name
