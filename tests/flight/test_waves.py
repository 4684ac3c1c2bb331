"""Waves and slow current: what a flight meets and logs of them against plain NumPy, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial.base.errors import SimulationError
from tests.flight.flying import OUT, grouped, mission

HERE = st.State([0.0, 0.0, 4.0])


def water(flights: st.Flights, case: int) -> np.ndarray:
    """Velocity of the water (n, 3) that a flight without turns met, NED."""
    log, columns = flights.log(case), list(flights.columns)
    of = [columns.index(name) for name in ("u", "v", "w", "u_water", "v_water", "w_water")]
    ground, relative = np.split(np.asarray(log)[:, of], 2, axis=1)
    return np.asarray(ground - relative)


def jonswap(omega: np.ndarray, height: float, period: float) -> np.ndarray:
    """The spectrum of the surface, m2 s, as DNV-RP-C205 (3.5.5.2) prints it, scaled to its height."""
    peak = 2.0 * np.pi / period
    width = np.where(omega <= peak, 0.07, 0.09)
    form = omega**-5 * np.exp(-1.25 * (peak / omega) ** 4)
    form *= 3.3 ** np.exp(-0.5 * ((omega - peak) / (width * peak)) ** 2)
    return np.asarray(form * height**2 / 16.0 / np.trapezoid(form, omega))


def test_orbital_velocity_has_the_variance_of_the_spectrum_at_its_depth() -> None:
    height, period, seeds = 0.6, 7.0, 800
    flights = st.fly_batch(
        "cwolf",
        "cwolf",
        mission(OUT),
        conditions=st.Conditions(initial=HERE, max_time_s=0.2),
        water=st.Water(waves=st.SeaState(height, period, toward_deg=90.0)),
        seeds=range(seeds),
        logs=True,
    )
    met = np.array([water(flights, case)[0] for case in range(seeds)])
    omega = np.linspace(np.pi / period, 6.0 * np.pi / period, 4000)
    decay = np.exp(-2.0 * omega**2 / 9.80665 * HERE.position[2])
    wanted = np.trapezoid(jonswap(omega, height, period) * omega**2 * decay, omega)
    # Waves that go east move water east and down alike, and none north: five standard errors of a variance.
    assert np.abs(met[:, 0]).max() < 1e-12
    error = 5.0 * np.sqrt(2.0 / seeds)
    np.testing.assert_allclose(np.mean(met[:, 1:] ** 2, axis=0) / wanted, 1.0, atol=error)
    assert abs(np.mean(met[:, 1] * met[:, 2])) / wanted < error


def test_a_flight_in_waves_goes_by_its_seed_and_logs_the_water() -> None:
    sea = st.SeaState(0.5, 6.0, toward_deg=30.0, spreading_deg=20.0)
    options: dict[str, Any] = {
        "current": (0.1, 0.0, 0.0),
        "current_trend": (0.0, 0.36, 0.0),
        "max_time_s": 20,
    }
    first, again, other = (
        st.fly("cwolf", "cwolf", mission(OUT), **grouped(waves=sea, seed=seed, initial=HERE, **options))
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first.nu, again.nu)
    assert np.abs(first.nu - other.nu).max() > 0.01
    calm = st.fly("cwolf", "cwolf", mission(OUT), **grouped(initial=HERE, **options))
    # 0.36 m/s an hour are 2 mm/s in 20 s.
    east = calm.table()["current_east_m_s"].to_numpy()
    np.testing.assert_allclose(east, 1e-4 * calm.t, atol=1e-12)
    assert first.table()["current_down_m_s"].to_numpy().std() > 0.02
    assert first.to_dict()["circumstances"]["waves"]["height_m"] == 0.5


def test_a_random_walk_differs_from_seed_to_seed() -> None:
    flights = st.fly_batch(
        "cwolf",
        "cwolf",
        mission(OUT),
        water=st.Water(current_walk=0.2),
        seeds=range(200),
        conditions=st.Conditions(max_time_s=10.0),
        logs=True,
    )
    moved = np.array([water(flights, case)[-1, 0] for case in range(200)])
    # The walk after ten seconds, 0.2 m/s after an hour; a heading of zero, five standard errors.
    assert abs(moved.std() / (0.2 * np.sqrt(10.0 / 3600.0)) - 1.0) < 5.0 / np.sqrt(400.0)


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"height_m": -1.0}, "waves: height_m: expected 0 to 20 m, found -1"),
        ({"height_m": "1"}, "waves: height_m: expected 0 to 20 m, found '1'"),
        ({"period_s": 0.0}, "waves: period_s: expected 1 to 30 s"),
        ({"toward_deg": 500.0}, "waves: toward_deg: expected -360 to 360 degrees"),
        ({"peakedness": 0.5}, "waves: peakedness: expected 1 to 7"),
        ({"height_m": 3.0, "period_s": 3.0}, "at most a 15th of the length .* steeper seas break"),
    ],
)
def test_a_sea_that_is_none_is_refused(numbers: dict[str, Any], message: str) -> None:
    with pytest.raises(SimulationError, match=message):
        st.SeaState(**{"height_m": 0.5, "period_s": 6.0} | numbers)


def test_waves_that_are_no_sea_state_are_refused() -> None:
    for given in ((0.5, 6.0), 0.5, "rough"):
        with pytest.raises(SimulationError, match=r"waves: expected st\.SeaState"):
            st.fly("cwolf", "cwolf", mission(OUT), water=st.Water(waves=given))  # type: ignore[arg-type]
    sea = st.SeaState(0.5, 6.0)
    with pytest.raises(SimulationError, match="waves: expected 3 values, one per case, found 2"):
        st.fly_batch("cwolf", "cwolf", mission(OUT), water=st.Water(waves=[sea, None]), seeds=[1, 2, 3])
