"""`seatrial.verify` on the estimate of a navigation filter, and that nothing changes without it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import seatrial as st
from tests.flight.flying import OUT

RUNS = 20

SILENT = {"sensor": "dvl", "probability": 1.0, "duration_s": [25.0, 30.0], "between_s": [5.0, 10.0]}

COMPLETE = st.Requirement("is complete", 'ending == "complete"', probability=0.5)


def found(navigation: str | None, *, outages: bool, runs: int = RUNS) -> st.Verification:
    """Missions of CWolf with a tenth of doubt about its quadratic damping."""
    conditions: dict[str, Any] = {"outages": [SILENT]} if outages else {}
    conditions |= {} if navigation is None else {"navigation": navigation}
    return st.verify(
        "cwolf",
        "cwolf",
        [st.Mission.from_toml(OUT)],
        requirements=[COMPLETE],
        water={"current": {"speed_m_s": [0.0, 0.3]}},
        conditions=conditions,
        coefficients={"*_uu": 10.0},
        runs=runs,
        seed=3,
    )


def same(one: st.Verification, other: st.Verification, count: int = RUNS) -> bool:
    a, b = one.flown.metrics, other.flown.metrics
    return list(a) == list(b) and all(
        a[name][:count].tolist() == b[name][:count].tolist()
        or np.array_equal(a[name][:count], b[name][:count], equal_nan=a[name].dtype.kind == "f")
        for name in a
    )


def test_a_filter_flies_on_where_sensors_alone_call_for_the_surface() -> None:
    by_sensors, by_filter = (found(way, outages=True) for way in ("sensors", "filter"))
    assert set(by_sensors.flown.metrics["ending"]) == {"surfaced"}
    assert set(by_filter.flown.metrics["ending"]) == {"complete"}
    assert (by_sensors.outcome, by_filter.outcome) == ("failed", "held")
    assert "navigation filter" in by_filter.summary()
    assert "navigation filter" not in by_sensors.summary()
    # 25 to 30 s at 1.5 m/s on the model alone: some decimetres beyond missions with a Doppler log.
    calm = found("filter", outages=False)
    silent, heard = (one.flown.metrics["true_cross_track_rms_m"] for one in (by_filter, calm))
    assert not np.array_equal(silent, heard)
    assert float(np.max(np.abs(silent - heard))) < 0.5


def test_the_filter_knows_that_the_vehicle_that_flies_is_another() -> None:
    verdict = found("filter", outages=False)
    assert verdict.flights._believed is verdict.flights.fitted.vehicle
    # Told that its model is exact, it refuses 3 % of the samples of the worst of these missions.
    assert 0.4 < float(np.mean(verdict.flown.metrics["navigation_nis"])) < 1.1
    share = verdict.flown.metrics["navigation_refused"] / verdict.flown.metrics["navigation_samples"]
    assert float(share.max()) < 0.002


def test_law_a_mission_on_the_filter_depends_on_its_number_alone() -> None:
    verdict = found("filter", outages=True)
    assert same(verdict, found("filter", outages=True, runs=7), 7)
    again = verdict.replay(4).metrics
    metrics = verdict.flown.metrics
    for name in ("duration_s", "true_cross_track_rms_m", "energy_wh", "navigation_nis"):
        assert again[name] == metrics[name][4], name


def test_without_the_key_missions_are_those_on_the_sensors() -> None:
    assert same(found(None, outages=True), found("sensors", outages=True))
    assert not any(name.startswith("navigation") for name in found(None, outages=True, runs=2).flown.metrics)


def test_a_filter_is_told_of_the_seas_that_are_drawn() -> None:
    campaign = st.Campaign.from_toml(
        'format = 1\nname = "c"\nvehicle = "cwolf"\n[verification]\nmissions = ["out.toml"]\n'
        'navigation = "filter"\nwaves = { height_m = [0.2, 0.6] }\n'
        "current = { speed_m_s = 0.2, turbulence_m_s = 0.05 }\n",
        source="c.toml",
        vehicle=st.Vehicle.load("cwolf"),
    )
    flights = campaign.scenario(gains="cwolf", missions=[st.Mission.from_toml(OUT)]).flights
    told = flights._told
    assert told["turbulence"][0] == pytest.approx(0.05)
    assert 0.3 < told["waves"].height_m < 0.5


def test_another_word_is_refused() -> None:
    with pytest.raises(st.CampaignError, match="navigation"):
        found("kalman", outages=False)
    verified = '[verification]\nmissions = ["out.toml"]\n'
    campaign = st.Campaign.from_toml(f'format = 1\nname = "c"\nvehicle = "cwolf"\n{verified}')
    missions = [st.Mission.from_toml(OUT)]
    with pytest.raises(
        st.SimulationError, match='navigation: expected "sensors" or "filter", found \'kalman\''
    ):
        campaign.scenario(gains="cwolf", missions=missions, navigation="kalman")
