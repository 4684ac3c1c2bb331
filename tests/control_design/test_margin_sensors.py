"""Sensors that are late take from the margins what they are late by, as they do in a flight."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import seatrial as st
from seatrial.control_design.margin_constraint import MarginConstraint
from seatrial.control_design.margin_report import ReportedMargins, report_margins
from seatrial.control_design.margins import decibel
from seatrial.control_design.operating_points import measurement_delays
from seatrial.sensors.sensor import Sensor
from seatrial.tuning.step_trial import Rig
from tests.tuning.tuning_campaigns import start, still, trials

CWOLF = st.Vehicle.load("cwolf")
KINDS = ("dvl", "depth", "attitude", "gyro")
Sensors = dict[str, Sensor]


def late(latency_s: float, *kinds: str, rate_hz: float | None = None) -> Sensors:
    """Sensors of which some are late or seldom."""
    slow = Sensor(latency_s=latency_s, rate_hz=rate_hz)
    return {kind: slow if kind in kinds else Sensor() for kind in KINDS}


def heading(sensors: Sensors | str | Path | None) -> ReportedMargins:
    """Margins of heading at 1 m/s of gains that leave a delay margin of some 0.6 s."""
    return next(
        row for row in report_margins(CWOLF, brisk(), [1.0], sensors=sensors) if row.loop == "heading"
    )


def brisk() -> st.Autopilot:
    gains = start().gains()
    return start().with_gains({name: 3.0 * gains[name] for name in gains if name.startswith("heading.K_")})


def test_a_measurement_is_as_old_as_its_latency_and_half_its_interval() -> None:
    sensors = {
        "dvl": Sensor(latency_s=0.12, rate_hz=5.0),
        "depth": Sensor(rate_hz=2.0),
        "attitude": Sensor(latency_s=0.03),
        "gyro": Sensor(rate_hz=10.0),
    }
    # Heave holds the depth, 0.25 s old; its rate comes from the Doppler log and is 0.22 s old.
    assert measurement_delays(sensors, CWOLF) == pytest.approx({
        "surge": 0.22, "sway": 0.22, "heave": 0.25, "roll": 0.05, "pitch": 0.05, "heading": 0.05,
    })  # fmt: skip
    assert not any(measurement_delays(None, CWOLF).values())
    assert measurement_delays({"gyro": Sensor(latency_s=0.2)}, CWOLF)["surge"] == 0.0


@pytest.mark.parametrize(
    ("sensors", "lost"),
    [
        (late(0.2, "attitude", "gyro"), 0.2),
        (late(0.13, "attitude"), 0.13),
        (late(0.0, "attitude", "gyro", rate_hz=2.0), 0.25),
    ],
)
def test_law_the_delay_margin_falls_by_what_the_measurements_are_late(sensors: Sensors, lost: float) -> None:
    prompt, behind = heading(late(0.0)), heading(sensors)
    assert prompt.delay_s is not None
    assert behind.delay_s is not None
    assert prompt.phase_deg is not None
    assert behind.phase_deg is not None
    assert behind.phase_rad_s is not None
    # The other loops are as late: they couple a little into this one.
    assert prompt.delay_s - behind.delay_s == pytest.approx(lost, abs=0.01)
    turned = np.rad2deg(lost * behind.phase_rad_s)
    assert prompt.phase_deg - behind.phase_deg == pytest.approx(turned, abs=0.5)
    assert heading(None).delay_s == prompt.delay_s


def test_a_late_sensor_takes_from_the_loops_that_close_on_it() -> None:
    def delays(sensors: Sensors | None) -> dict[str, float]:
        rows = report_margins(CWOLF, start(), [1.0], sensors=sensors)
        return {row.loop: row.delay_s or np.inf for row in rows if row.mode == "hover"}

    prompt, behind = delays(None), delays(late(0.3, "dvl"))
    assert prompt["surge"] - behind["surge"] == pytest.approx(0.3, abs=0.01)
    assert prompt["heave"] - behind["heave"] == pytest.approx(0.3, abs=0.1)
    assert behind["heading"] == pytest.approx(prompt["heading"], abs=0.02)


def test_lit_margins_with_sensors_agree_with_python_control() -> None:
    rows = report_margins(CWOLF, start(), [1.0], sensors="typical")
    points = MarginConstraint(CWOLF, start(), [1.0], sensors="typical").margins({})
    here = {(p.mode, p.speed_m_s, loop): (p.of, k) for p in points for k, loop in enumerate(p.loops)}
    assert set(here) == {(row.mode, row.speed_m_s, row.loop) for row in rows}
    for row in rows:
        of, k = here[row.mode, row.speed_m_s, row.loop]
        # As without sensors: what 180 frequencies leave.
        assert float(of.phase_deg[0, k]) == pytest.approx(row.phase_deg, abs=0.1)
        assert float(of.delay_s[0, k]) == pytest.approx(row.delay_s, rel=0.005)
        assert float(decibel(of.gain[0, k])) == pytest.approx(row.gain_up_db, abs=0.05)


@pytest.mark.parametrize("rate_hz", [None, 2.0])
def test_a_flight_swings_for_ever_where_the_sensors_have_used_the_delay_margin_up(
    rate_hz: float | None,
) -> None:
    left = heading(late(0.0, "attitude", "gyro", rate_hz=rate_hz)).delay_s
    assert left is not None

    def swings(latency_s: float) -> bool:
        """Whether heading still swings by half a small step in the last quarter of a minute."""
        sensors = late(latency_s, "attitude", "gyro", rate_hz=rate_hz)
        rig = Rig(CWOLF, CWOLF, brisk(), sensors=sensors, max_step_s=0.05)
        step = trials("heading", (1.0,), (0.01,), rise_s=8.0, until_s=60.0)
        t, y = rig.responses(step, still(), {})
        last = (t > step.settle_s + 45.0) & (t < step.settle_s + 60.0)
        return bool(np.ptp(y["yaw"][0, 0][last]) > 0.5 * 0.01)

    # A flight's latency is whole control periods of 0.1 s, and its sensors sample when the autopilot works:
    # what they hold is half a period younger than that of an instrument with a clock of its own.
    assert not swings(np.floor(10.0 * left) / 10.0)
    assert swings(np.round(10.0 * left + 1.0) / 10.0)
