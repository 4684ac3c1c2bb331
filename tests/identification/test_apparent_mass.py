"""An inertia that a vehicle cannot have is remarked, however well the data determine it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

import seatrial as st
from seatrial.identification.estimate import Estimate, implausible_drags, implausible_masses, masses_of
from seatrial.report.results.identification import advice


def estimate(name: str, start: float, value: float) -> Estimate:
    return Estimate(name, "kg m2", start, value, -5.0, 0.0, None, "yaw", name)


@pytest.mark.parametrize(("n_rdot", "told"), [(-3.02, True), (-0.6, False)])
def test_identify_remarks_an_inertia_that_the_vehicle_cannot_have(n_rdot: float, *, told: bool) -> None:
    """As on a dive of a BlueROV2 whose yaw was fitted with a wrong lever: 13.6 times the added inertia."""
    start = st.Vehicle.load("bluerov2-heavy")
    row = estimate("N_rdot", start.coefficients()["N_rdot"], n_rdot)
    found = start.with_coefficients({"N_rdot": n_rdot})
    odd = implausible_masses(start, [row], masses_of(found))
    assert set(odd) == ({"N"} if told else set())
    fit = SimpleNamespace(
        problem=SimpleNamespace(vehicle=start), vehicle=found, coefficients=(row,), choice=None,
        assessment=None, scale=SimpleNamespace(sentences=list), notes=(), findings=(), fallbacks=(),
        interrupted=False, events=(),
    )  # fmt: skip
    remarks = advice(fit)  # type: ignore[arg-type]
    assert (
        any("N: implausible, apparent inertia" in one and "13.6 times its start" in one for one in remarks)
        == told
    )


@pytest.mark.parametrize(
    ("value", "sd", "verdict", "drag"),
    [
        (-800.0, 20.0, "identifiable", 6.1),
        (-800.0, 20.0, "not identifiable", None),
        (-800.0, 150.0, "weak", None),  # its interval reaches what vehicles have
        (-200.0, 20.0, "identifiable", None),
    ],
)
def test_drag_beyond_that_of_any_vehicle_is_implausible(
    value: float, sd: float, verdict: str, drag: float | None
) -> None:
    """The heavy ROV is 0.457 m long and 0.575 m wide: Z_ww = -800 is 6.1 times rho/2 times that outline."""
    vehicle = st.Vehicle.load("bluerov2-heavy").with_coefficients({"Z_ww": value})
    interval = (value - 1.96 * sd, value + 1.96 * sd)
    row = replace(estimate("Z_ww", -120.0, value), sigma=sd, interval=interval, verdict=verdict)
    expected = {} if drag is None else {"Z_ww": pytest.approx(drag, rel=0.02)}
    assert implausible_drags(vehicle, [row]) == expected
