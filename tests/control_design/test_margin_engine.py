"""The margin engine: held against python-control, textbook loops and laws."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st_

import seatrial as st
from seatrial.control_design.loops import Sampled, feedback
from seatrial.control_design.margin_report import report_margins
from seatrial.control_design.margins import decibel, law_margins, loop_margins, refined_margins
from seatrial.control_design.operating_points import autopilot_facts, measurement_delays, mode_law, mode_loop

CWOLF = st.Vehicle.load("cwolf")
START = Path(__file__).parents[2] / "examples" / "cwolf" / "start_autopilot.toml"


def open_loop(of: Sampled, gain: np.ndarray[Any, Any], row: int) -> Any:
    """Discrete `control.StateSpace` of a row opened alone, the others closed by K (rows, state)."""
    others = [k for k in range(len(gain)) if k != row]
    step = of.phi - of.gamma[:, others] @ gain[others]
    return control.ss(step, of.gamma[:, [row]], gain[[row]], 0.0, of.period_s)


def by_python_control(loop: Any, period_s: float) -> dict[str, float | None]:
    """Margins of an open loop by the names of `ReportedMargins`.

    Not from the state space: its polynomials have the poles of the dead time at 0 and of the integrators at 1
    several times over, and with CWolf's 22 states a gain margin of 4.5 comes out as 1.2.
    """
    omega = np.geomspace(1e-3, 0.9999 * np.pi / period_s, 400)
    gains, phases, _, at_gain, at_phase, _ = control.stability_margins(
        control.frd(loop, omega), returnall=True
    )
    edge = complex(loop(-1.0))  # a pole may leave through z = -1, half the sampling rate
    if edge.real < 0.0:
        gains, at_gain = np.append(gains, 1.0 / -edge.real), np.append(at_gain, np.pi / period_s)
    level = decibel(gains)
    up, down = level > 0.0, level <= 0.0
    late = np.deg2rad(phases % 360.0) / at_phase
    disk, disk_gain, disk_phase = (float(value) for value in control.disk_margins(loop, omega))
    found: dict[str, float | None] = {
        "disk": disk,
        "disk_gain_db": disk_gain if np.isfinite(disk_gain) else None,
        "disk_phase_deg": disk_phase,
    }
    for name, rad_s, values, frequencies in (
        ("gain_up_db", "gain_up_rad_s", level[up], at_gain[up]),
        ("gain_down_db", "gain_down_rad_s", -level[down], at_gain[down]),
        ("phase_deg", "phase_rad_s", np.abs(phases), at_phase),
        ("delay_s", "delay_rad_s", late, at_phase),
    ):
        least = int(np.argmin(values)) if len(values) else None
        found[name] = None if least is None else float(values[least])
        found[rad_s] = None if least is None else float(frequencies[least])
    return found


@pytest.mark.parametrize(
    ("vehicle", "autopilot", "speeds", "sensors"),
    [
        ("cwolf", "cwolf", (0.881, 3.021), None),
        ("cwolf", str(START), (-1.0, 1.0), "typical"),
        ("bluerov2-heavy", "bluerov2-heavy", (0.5,), None),
        ("remus100", "", (1.5,), None),
        ("lauv", "lqr", (1.2,), None),
    ],
)
@pytest.mark.long
def test_lit_margins_agree_with_python_control(
    vehicle: str, autopilot: str, speeds: tuple[float, ...], sensors: str | None
) -> None:
    model = st.Vehicle.load(vehicle)
    if autopilot in ("", "lqr"):
        pilot = st.Autopilot.from_toml(st.start_autopilot(model, law=autopilot or "pid"))
    else:
        pilot = st.Autopilot.load(autopilot)
    facts, late = autopilot_facts(pilot), measurement_delays(sensors, model)
    rows = report_margins(model, pilot, speeds, sensors=sensors)
    assert rows
    for row in rows:
        at = mode_loop(model, facts, row.mode, row.speed_m_s, measured_late_s=late)
        gain = feedback(at.system, mode_law(facts, row.mode, at.loops, row.speed_m_s) + at.known)
        expected = by_python_control(open_loop(at.system, gain, at.loops.index(row.loop)), at.system.period_s)
        for name, value in expected.items():
            # Its spline and the division of intervals place a crossing alike, to far less than is printed.
            bound = None if value is None else pytest.approx(value, rel=1e-5, abs=1e-5)
            assert row.to_dict()[name] == bound, (row.mode, row.speed_m_s, row.loop, name)


def test_refining_moves_no_margin_by_more_than_half_a_per_cent() -> None:
    facts = autopilot_facts(st.Autopilot.load("cwolf"))
    at = mode_loop(CWOLF, facts, "cruise", 1.951)
    law = mode_law(facts, "cruise", at.loops, 1.951) + at.known
    fine, _ = refined_margins(at.system, law)
    for k, row in enumerate(law_margins(at.system, law).values()):
        assert row.phase_deg == pytest.approx(fine.phase_deg[k], abs=0.1)
        assert row.gain == pytest.approx(fine.gain[k], rel=0.005)
        assert row.delay_s == pytest.approx(fine.delay_s[k], rel=0.005)


def test_law_disk_margin_bounds_the_classical_ones() -> None:
    rows = report_margins(CWOLF, st.Autopilot.load("cwolf"), (0.881,))
    assert rows
    for row in rows:
        assert row.stable
        assert row.disk_phase_deg is not None
        assert row.phase_deg is not None
        # A disk margin allows for gain and phase together: it is never more than either alone.
        assert row.disk_phase_deg <= row.phase_deg + 0.1
        assert row.disk_gain_db is not None
        assert row.gain_up_db is None or row.disk_gain_db <= row.gain_up_db + 0.05


def test_law_of_a_textbook_loop() -> None:
    # 1/s behind a delay T: phase pi/2 - T, gain pi/(2 T), delay (pi/2 - T) / 1.
    omega, late = np.geomspace(1e-2, 30.0, 180), 0.3
    found = loop_margins(np.exp(-1j * omega * late) / (1j * omega), omega)
    assert float(found.phase_deg) == pytest.approx(90.0 - np.rad2deg(late), abs=0.01)
    assert float(found.gain) == pytest.approx(np.pi / (2.0 * late), rel=1e-3)
    assert float(found.delay_s) == pytest.approx(np.pi / 2.0 - late, rel=1e-3)
    assert np.isinf(found.reduction)
    assert np.isnan(found.reduction_rad_s)
    assert float(found.gain_rad_s) == pytest.approx(np.pi / (2.0 * late), rel=1e-3)
    assert float(found.phase_rad_s) == pytest.approx(1.0, rel=1e-3)


def test_law_a_conditionally_stable_loop_has_a_gain_margin_downwards() -> None:
    # (1 + s)^2 / s^3 crosses the negative real axis once, at omega = 1, where it is 2.
    omega = np.geomspace(1e-2, 30.0, 180)
    s = 1j * omega
    found = loop_margins(4.0 * (1.0 + s) ** 2 / s**3, omega)
    assert float(found.reduction) == pytest.approx(8.0, rel=1e-3)
    assert np.isinf(found.gain)


@settings(deadline=None, max_examples=40)
@given(scale=st_.floats(0.05, 20.0), late=st_.floats(0.05, 0.8), lag=st_.floats(0.05, 3.0))
def test_law_gain_margin_falls_by_the_scale_of_a_loop(scale: float, late: float, lag: float) -> None:
    omega = np.geomspace(1e-3, 60.0, 180)
    s = 1j * omega
    loop = 0.02 * np.exp(-late * s) / (s * (1.0 + lag * s))
    found = loop_margins(np.stack([loop, scale * loop]), omega)
    # The crossing stays where it is: rounding only.
    assert np.isfinite(found.gain[0])
    both = decibel(found.gain[0]) - decibel(np.array(scale))
    assert np.where(np.isfinite(found.gain[1]), decibel(found.gain[1]), -decibel(found.reduction[1])) == (
        pytest.approx(float(both), abs=1e-9)
    )
