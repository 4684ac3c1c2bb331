"""The navigation filter: as a user steps it, aboard a flight, and with inputs that nobody should send."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial.base.errors import SimulationError
from seatrial.flight.navigation import Beacon, Pen, Wall
from seatrial.sensors.sensor import Sensor
from tests.flight.flying import grouped

LEVEL = {"roll": 0.0, "pitch": 0.0, "yaw": 0.0}
HERE = LEVEL | {"x": 0.0, "y": 0.0, "z": 0.0}
PROPELLERS = ("SbU", "SbL", "PU", "PL")

MISSION = """
format = 1
name = "line"
speed_m_s = 1.2
acceptance_radius_m = 4.0
[start]
depth_m = 2.0
[[legs]]
north_m = 90.0
east_m = 0.0
depth_m = 5.0
[[legs]]
north_m = 90.0
east_m = 60.0
depth_m = 5.0
"""


EXACT = st.ProcessNoise(exact_model=True)


def settled(**settings: Any) -> st.NavigationFilter:
    """A filter that has stood still for three seconds."""
    navigation = st.NavigationFilter("cwolf", **settings)
    for _ in range(30):
        navigation.step(HERE)
    return navigation


def test_a_filter_takes_the_model_error_of_the_vehicle_file_unless_told_otherwise() -> None:
    noise: dict[str, Any] = {
        "force": [3.0, 5.0, 4.0, 0.2, 0.3, 0.4],
        "force_time_s": 7.0,
        "acceleration": [0.02] * 6,
    }
    cwolf = st.Vehicle.load("cwolf")
    vehicle = st.Vehicle.from_toml(cwolf.with_model_error(**noise).to_toml())
    assert vehicle.to_dict()["model_error"] == noise

    def deviations(believed: st.Vehicle, **settings: Any) -> np.ndarray:
        navigation = st.NavigationFilter(believed, **settings)
        for k in range(100):
            navigation.step(HERE if k < 30 else LEVEL)
        return np.sqrt(np.diag(navigation.covariance))

    by_file, by_hand = deviations(vehicle), deviations(cwolf, noise=st.ProcessNoise(**noise))
    assert by_file.tolist() == by_hand.tolist()
    assert (
        deviations(vehicle, noise=st.ProcessNoise(force=[30.0] * 6))[12:15].min() > 2.0 * by_file[12:15].max()
    )
    # Told that the vehicle moves as the model does, a filter leaves the table aside.
    exact = deviations(cwolf, noise=EXACT)
    assert deviations(vehicle, noise=EXACT).tolist() == exact.tolist()
    assert deviations(vehicle.without_model_error()).tolist() == deviations(cwolf).tolist()


def test_a_model_error_beyond_its_range_is_refused() -> None:
    vehicle = st.Vehicle.load("cwolf")
    with pytest.raises(st.VehicleError, match=r"model_error\.force_time_s: expected"):
        vehicle.with_model_error(force=[1.0] * 6, force_time_s=0.0, acceleration=[0.01] * 6)
    text = vehicle.with_model_error(force=[1.0] * 6, force_time_s=5.0, acceleration=[0.01] * 6).to_toml()
    with pytest.raises(st.VehicleError, match="missing field `force_time_s`"):
        st.Vehicle.from_toml(text.replace("force_time_s = 5.0", ""))


def test_a_filter_follows_a_run_by_commands_and_a_late_doppler_log() -> None:
    vehicle = st.Vehicle.load("cwolf")
    t = np.arange(0.0, 40.0, 0.1)
    commands = {name: np.full(len(t), 1100.0) for name in PROPELLERS}
    commands["PU"][100:] = 900.0
    run = vehicle.simulate(t, commands, current=[0.2, -0.1, 0.0])
    sensors = {"attitude": Sensor(noise=0.1), "depth": Sensor(noise=0.01), "dvl": Sensor(0.01, latency_s=0.3)}
    navigation = st.NavigationFilter(vehicle, sensors, start_deviation_m=0.1)
    random = np.random.default_rng(1)
    for k in range(len(t)):
        roll, pitch, yaw = run.euler[k] + np.deg2rad(0.1) * random.standard_normal(3)
        told = {"roll": roll, "pitch": pitch, "yaw": yaw, "z": run.position[k, 2]}
        if k >= 3 and k % 2 == 0:
            told |= dict(zip("uvw", run.nu[k - 3, :3] + 0.01 * random.standard_normal(3), strict=True))
        estimate = navigation.step(told, {name: series[max(k - 1, 0)] for name, series in commands.items()})
    error = [estimate[name] - run.position[-1, i] for i, name in enumerate("xyz")]
    # Three deviations of the filter's own, which are below half a metre after 40 s.
    state = navigation.state
    assert np.all(np.abs(error) < 3.0 * state["position_deviation"])
    assert state["position_deviation"].max() < 0.5
    assert np.hypot(state["current"][0] - 0.2, state["current"][1] + 0.1) < 0.1
    assert 0.5 < navigation.consistency["u"][0] < 1.5


def test_a_filter_begins_when_the_attitude_is_known() -> None:
    navigation = st.NavigationFilter("cwolf", start=[5.0, 600.0, 7.0])
    assert navigation.step({"x": 1.0, "roll": 0.0}) == {}
    assert navigation.waiting_for == ["roll", "pitch", "yaw"]
    told = navigation.step({"pitch": 0.0, "yaw": 1.0})
    assert (told["x"], told["y"], told["z"]) == pytest.approx((1.0, 600.0, 7.0))
    assert navigation.waiting_for == []


@pytest.mark.parametrize(
    ("call", "message"),
    [
        ({"measurement": {"yow": 1.0}}, 'unknown channel "yow"'),
        ({"measurement": {"yaw": "north"}}, "yaw: expected numbers"),
        ({"measurement": {}, "commands": {"PX": 1.0}}, 'no actuator "PX"'),
        ({"measurement": {}, "time_s": float("nan")}, "time_s: expected a finite time"),
        ({"measurement": {}, "dt_s": -1.0}, "dt_s: expected a positive time"),
        ({"measurement": {}, "time_s": 1.0, "dt_s": 1.0}, "time_s or dt_s"),
        ({"measurement": {"x": 0.0}, "ages": {"x": -1.0}}, "ages: x: expected a time from zero on"),
    ],
)
def test_what_is_no_measurement_is_refused_and_changes_nothing(call: dict[str, Any], message: str) -> None:
    navigation = settled()
    before = navigation.covariance
    with pytest.raises(SimulationError, match=message):
        navigation.step(**call)
    assert np.array_equal(before, navigation.covariance)


def test_law_errors_are_as_large_as_the_covariance_says_in_the_documented_order() -> None:
    """Commands that have held since the last step, then samples; those that follow are a period early."""
    vehicle = st.Vehicle.load("cwolf")
    t = 0.1 * np.arange(300)
    random = np.random.default_rng(4)
    levels = random.uniform(500.0, 1300.0, (len(PROPELLERS), 40))
    commands = {name: np.repeat(levels[i], 8)[: len(t)] for i, name in enumerate(PROPELLERS)}
    run = vehicle.simulate(t, commands)
    noise = {"roll": 5e-4, "pitch": 5e-4, "yaw": 5e-4, "z": 0.01, "u": 0.005, "v": 0.005, "w": 0.005}
    noise |= {"p": 3e-4, "q": 3e-4, "r": 3e-4}
    sensors = {
        "attitude": Sensor(noise=float(np.rad2deg(5e-4))),
        "gyro": Sensor(noise=float(np.rad2deg(3e-4))),
        "depth": Sensor(noise=0.01),
        "dvl": Sensor(noise=0.005),
    }

    def normalised(shift: int) -> float:
        navigation = st.NavigationFilter(vehicle, sensors, noise=EXACT, start_deviation_m=0.1)
        squares = []
        for k in range(1, len(t) - 1):
            truth = dict(zip("uvwpqr", run.nu[k], strict=True)) | {"z": run.position[k, 2]}
            truth |= dict(zip(LEVEL, run.euler[k], strict=True))
            held = {name: series[k + shift] for name, series in commands.items()}
            told = navigation.step(
                {name: truth[name] + sigma * random.standard_normal() for name, sigma in noise.items()}, held
            )
            error = np.array([told[name] - truth[name] for name in "uvwpqr"])
            # Over ground and through the water alike: the water rests, and the filter does not know it.
            rates = navigation.covariance[9:12, 9:12]
            squares.append(error[3:] @ np.linalg.solve(rates, error[3:]) / 3.0)
        return float(np.mean(squares[20:]))

    assert 0.4 < normalised(-1) < 1.3
    assert normalised(0) > 2.0 * normalised(-1)


def test_a_lost_lock_is_noticed_and_begun_again_where_the_vehicle_is() -> None:
    """The vehicle is turned and carried off between two samples: two instruments contradict the estimate."""
    navigation = settled(noise=EXACT)
    carried = HERE | {"roll": 0.0, "yaw": 2.0, "u": 1.5, "v": 0.4, "w": 0.0, "p": 0.0, "q": 0.0, "r": 0.0}
    carried = {name: value for name, value in carried.items() if name not in "xy"}
    for _ in range(60):
        navigation.step(HERE | {"u": 0.0, "v": 0.0, "w": 0.0, "p": 0.0, "q": 0.0, "r": 0.0})
    began = navigation.state["position_deviation"][0]
    for _ in range(45):
        told = navigation.step(carried)
    assert navigation.restarts == 1
    assert abs(told["yaw"] - 2.0) < 0.02
    assert abs(told["u"] - 1.5) < 0.1
    # No sensor shows the position: the estimate stays and says that it is less sure.
    assert np.hypot(told["x"], told["y"]) < 4.0
    assert navigation.state["position_deviation"][0] > began + 1.0


def test_one_instrument_that_contradicts_the_rest_does_not_begin_the_filter_anew() -> None:
    navigation = settled(noise=EXACT)
    still = HERE | {"u": 0.0, "v": 0.0, "w": 0.0, "p": 0.0, "q": 0.0, "r": 0.0}
    for k in range(200):
        navigation.step(still | ({"z": 3.0} if k > 60 else {}))
    assert navigation.restarts == 0
    assert navigation.refused["z"][0] > 20


def test_time_that_does_not_advance_is_refused() -> None:
    navigation = st.NavigationFilter("cwolf")
    navigation.step(HERE, time_s=10.0)
    navigation.step(HERE, time_s=10.1)
    for time_s in (10.1, 9.0):
        with pytest.raises(SimulationError, match="expected a time after"):
            navigation.step(HERE, time_s=time_s)


def test_garbage_from_a_sensor_is_counted_and_moves_nothing() -> None:
    navigation = settled()
    told = navigation.step(HERE | {"x": float("nan"), "yaw": float("inf"), "u": 1e9, "z": 40.0})
    assert abs(told["z"]) < 0.05
    assert abs(told["u"]) < 0.05
    assert navigation.refused["u"] == (1, "1 impossible")
    assert navigation.refused["z"] == (1, "1 beyond the gate")
    assert "x" not in navigation.refused, "what is not a number was not measured"
    assert "z: refused 1" in navigation.summary()


def test_a_sensor_that_insists_is_believed_again() -> None:
    navigation = settled()
    for _ in range(49):
        assert abs(navigation.step(HERE | {"z": 4.0})["z"]) < 0.1
    for _ in range(30):
        told = navigation.step(HERE | {"z": 4.0})
    assert told["z"] == pytest.approx(4.0, abs=0.2)
    assert "believed again 1 times" in navigation.refused["z"][1]


def test_after_a_long_pause_the_filter_begins_anew() -> None:
    navigation = settled()
    navigation.step({}, dt_s=3600.0)
    assert navigation.restarts == 1
    assert navigation.waiting_for
    assert navigation.step(HERE | {"x": 500.0})["x"] == pytest.approx(500.0)


def test_acoustics_find_the_place_of_a_vehicle_that_starts_in_doubt() -> None:
    marks: dict[str, Beacon | Wall | Pen] = {
        "north": Beacon(100.0, 0.0, 20.0),
        "east": Beacon(0.0, 80.0, 20.0),
        "net": Pen(0.0, 0.0, 25.0),
        "quay": Wall(60.0, 0.0, 0.0),
    }
    kinds = {"range": Sensor(noise=0.2), "bearing": Sensor(noise=1.15), "attitude": Sensor(noise=0.2)}
    for told in (
        {"range.north": 102.0, "range.east": 82.46, "bearing.east": np.pi / 2},
        {"bearing.net": 0.0, "range.net": 25.0, "bearing.quay": 0.0, "range.quay": 60.0, "range.east": 82.46},
    ):
        navigation = st.NavigationFilter(
            "cwolf", kinds, landmarks=marks, start=[6.0, -5.0, 0.0], start_deviation_m=8.0
        )
        for _ in range(40):
            estimate = navigation.step(LEVEL | told)
        assert np.hypot(estimate["x"], estimate["y"]) < 2.5, told
        assert navigation.state["position_deviation"][0] < 1.0


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"period_s": 0.0}, "period_s"),
        ({"start": [1.0, 2.0]}, "start: expected three finite numbers, north, east, down in m, found"),
        ({"tilt": {"dvl": [1.0]}}, "tilt: dvl: expected three finite numbers, roll, pitch, yaw in rad"),
        ({"seabed": "a"}, "seabed: expected its depth in m"),
        ({"noise": st.ProcessNoise(force=[1.0, 2.0])}, "force: expected 6"),
        ({"tilt": {"sonar": [0.0, 0.0, 0.0]}}, 'no sensor "sonar"'),
        ({"landmarks": {"a": (1.0, 2.0)}}, "expected a Beacon, Wall or Pen"),
        ({"gate": st.SampleGate(deviations=float("nan"))}, "gate"),
    ],
)
def test_settings_that_mean_nothing_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises((SimulationError, st.TrialError), match=message):
        st.NavigationFilter("cwolf", **settings)


def test_a_setting_that_has_a_group_names_it() -> None:
    with pytest.raises(
        TypeError, match=r"NavigationFilter: patience_s is a field of st\.SampleGate; give gate="
    ):
        st.NavigationFilter("cwolf", patience_s=1.0)  # type: ignore[call-arg]


def test_a_flight_lives_on_the_estimate_through_fifty_seconds_without_a_doppler_log() -> None:
    silent = [st.Outage(group, 30.0, 80.0) for group in ("velocity", "water")]
    flights = st.fly_batch(
        "cwolf",
        "cwolf",
        st.Mission.from_toml(MISSION),
        water=st.Water(current=[0.05, 0.15, 0.0]),
        conditions=st.Conditions(sensors="typical", navigation="filter", outages=silent, max_time_s=80.2),
        seeds=list(range(8)),
        logs=True,
    )
    columns = flights.columns
    place = [columns.index(name) for name in ("x", "y", "measured_x", "measured_y")]
    drifts = []
    for case in range(8):
        log = flights.log(case)
        miss = log[[300, 800]][:, place[2:]] - log[[300, 800]][:, place[:2]]
        drifts.append(np.hypot(*(miss[1] - miss[0])))
    # Measured over 50 seeds: 0.3 m rms; a body velocity that is held for 50 s misses by 6 m.
    assert max(drifts) < 1.5, drifts
    assert np.all(flights.figures["navigation_samples"] > 1000)


def test_filters_abreast_are_filters_of_their_own() -> None:
    def flown(seeds: list[int]) -> tuple[np.ndarray, np.ndarray]:
        flights = st.fly_batch(
            "cwolf",
            "cwolf",
            st.Mission.from_toml(MISSION),
            water=st.Water(current=[0.1, -0.1, 0.0]),
            conditions=st.Conditions(sensors="typical", navigation="filter", max_time_s=45.0),
            seeds=seeds,
            logs=True,
        )
        names = ("navigation_samples", "navigation_refused", "navigation_nis")
        figures = np.array([flights.figures[name] for name in names])
        return figures, np.array([flights.log(case) for case in range(len(seeds))])

    # Drop-outs of the Doppler log are each flight's own. A case alone flies in plain numbers.
    seeds = list(range(8))
    figures, logs = flown(seeds)
    assert len(set(figures[0])) > 1
    for case in seeds:
        own, log = flown([case])
        np.testing.assert_array_equal(figures[:2, case], own[:2, 0])
        np.testing.assert_allclose(figures[2, case], own[2, 0], rtol=1e-7)
        np.testing.assert_allclose(logs[case], log[0], rtol=1e-7, atol=1e-6)


def consistency(sea: st.SeaState | None, seeds: int = 12, **water: Any) -> tuple[float, float]:
    """Mean normalised innovation squared over flights of a minute, and the share of samples refused."""
    flights = st.fly_batch(
        "cwolf",
        "cwolf",
        st.Mission.from_toml(MISSION),
        **grouped(
            current=[0.1, -0.1, 0.0],
            waves=sea,
            sensors="typical",
            navigation="filter",
            max_time_s=60.0,
            seeds=list(range(seeds)),
            **water,
        ),
    )
    figures = flights.figures
    refused = figures["navigation_refused"].sum() / figures["navigation_samples"].sum()
    return float(figures["navigation_nis"].mean()), float(refused)


def test_innovations_are_as_large_as_sensors_and_sea_make_them() -> None:
    # Calm water and gusts: test_navigation_consistency.py.
    told, refused = consistency(st.SeaState(0.5, 6.0))
    assert abs(told - 1.0) < 0.15
    assert refused < 1e-3


def test_a_filter_that_is_told_of_waves_believes_its_doppler_log_in_them() -> None:
    refused = []
    for waves in (None, st.SeaState(1.0, 8.0, toward_deg=90.0)):
        navigation = st.NavigationFilter("cwolf", noise=st.ProcessNoise(waves=waves, exact_model=True))
        for k in range(300):
            navigation.step(LEVEL | {"z": 0.0, "v": 0.2 * np.sin(0.08 * k)})
        refused.append(navigation.refused.get("v", (0, ""))[0])
    assert refused[0] > 100
    assert refused[1] == 0
    with pytest.raises(SimulationError, match=r"waves: expected st\.SeaState"):
        st.NavigationFilter("cwolf", noise=st.ProcessNoise(waves=0.5))  # type: ignore[arg-type]


def test_measured_revolutions_are_those_of_now() -> None:
    flights = st.fly_batch(
        "cwolf",
        "cwolf",
        st.Mission.from_toml(MISSION),
        seeds=[0, 1],
        conditions=st.Conditions(max_time_s=10.0),
        logs=True,
    )
    columns, log = flights.columns, flights.log(0)
    misses = []
    for early in (0, 1):
        navigation = st.NavigationFilter("cwolf", {"attitude": Sensor(noise=0.1)}, start_deviation_m=0.1)
        miss = 0.0
        for k in range(len(log) - 1):
            row = dict(zip(columns, log[k], strict=True))
            turned = dict(zip(columns, log[k + early], strict=True))
            before = dict(zip(columns, log[max(k - 1, 0)], strict=True))
            told = navigation.step(
                {name: row[name] for name in LEVEL} | {"voltage": 14.8},
                {name[4:]: value for name, value in before.items() if name.startswith("cmd.")},
                {name[4:]: value for name, value in turned.items() if name.startswith("act.")},
            )
            miss = max(miss, abs(told["u"] - row["u"]))
        misses.append(miss)
    # The vehicle starts from rest: what its propellers do a period later moves the estimate ahead.
    assert misses[0] < 0.5 * misses[1], misses


def test_navigation_by_sensors_is_as_before_and_other_words_are_refused() -> None:
    mission = st.Mission.from_toml(MISSION)
    plain = st.fly("cwolf", "cwolf", mission, conditions=st.Conditions(max_time_s=20.0))
    assert plain.circumstances.navigation == "sensors"
    assert "navigation_nis" not in plain.metrics
    filtered = st.fly(
        "cwolf", "cwolf", mission, conditions=st.Conditions(max_time_s=20.0, navigation="filter")
    )
    assert filtered.circumstances.to_dict()["navigation"] == "filter"
    assert filtered.metrics["navigation_nis"] < 1.0
    with pytest.raises(SimulationError, match='expected "sensors", "filter"'):
        st.fly("cwolf", "cwolf", mission, conditions=st.Conditions(navigation="kalman"))


def test_a_filter_knows_that_other_coefficients_than_its_own_fly() -> None:
    """With the model named or not, the filter of drawn coefficients trusts its model less."""
    vehicle = st.Vehicle.load("cwolf")
    lighter = {"X_uu": vehicle.coefficients()["X_uu"] * np.array([0.85, 1.15])}
    nominal = {"X_uu": np.full(2, vehicle.coefficients()["X_uu"])}

    def estimates(**options: Any) -> st.Flights:
        return st.fly_batch(
            vehicle,
            "cwolf",
            st.Mission.from_toml(MISSION),
            **grouped(
                sensors="typical", navigation="filter", max_time_s=10.0, seeds=[1, 2], logs=True, **options
            ),
        )

    unnamed = estimates(coefficients=lighter)
    np.testing.assert_array_equal(unnamed.log(0), estimates(coefficients=lighter, model=vehicle).log(0))
    # Coefficients that are the model's own leave it exact.
    exact = estimates()
    np.testing.assert_array_equal(estimates(coefficients=nominal).log(0), exact.log(0))
    assert np.any(estimates(model=vehicle).log(0) != exact.log(0))
