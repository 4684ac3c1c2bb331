"""Speed, power, endurance and turning of `seatrial check`: balances, symmetry and the paper's Table I."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from typer.testing import CliRunner

from seatrial._core import State, Vehicle
from seatrial.check.vehicle import check_vehicle
from seatrial.cli import app
from seatrial.report.plot.performance import performance, track
from seatrial.report.plot.style import save
from seatrial.vehicle.actuators import NOMINAL_V, command, voltage_for
from seatrial.vehicle.steady_state import (
    KNOT_M_S,
    TURN_KINDS,
    cruise,
    drivers,
    farthest,
    round_speeds_kn,
    speeds,
    steady,
    turn_commands,
    turning_senses,
    turns,
)
from seatrial.vehicle.steady_state import SETTINGS as STEADY_STATE

Array = NDArray[np.float64]

ROOT = Path(__file__).parents[2]
STARTER = ROOT / "examples" / "starter" / "vehicle.toml"
CWOLF = Vehicle.load("cwolf")
VEHICLES = {"cwolf": CWOLF, "beluga": Vehicle.load("beluga"), "starter": Vehicle.load(STARTER)}
LEVEL = np.zeros(3)

ONE_THRUSTER = """
format = 1
name = "made"
[geometry]
length_m = 2.0
diameter_m = 0.2
[coefficients]
m = 50.0
z_b = -0.02
X_u = -5.0
[motors.motor]
maximum_ahead = 50.0
minimum_ahead = {minimum}
[characteristics.direct]
kind = "direct"
[[thrusters]]
name = "one"
command = "N"
position_m = [-1.0, 0.0, 0.0]
direction = {direction}
motor = "motor"
characteristic = "direct"
"""


def every(name: str) -> pytest.MarkDecorator:
    return pytest.mark.parametrize(name, VEHICLES.values(), ids=VEHICLES)


def one_thruster(direction: list[float], minimum: float = 0.0) -> Vehicle:
    """A torpedo with 5 N s/m of drag and a thruster commanded in newtons, at most 50 N."""
    return Vehicle.from_toml(ONE_THRUSTER.format(direction=direction, minimum=minimum))


def pushed(vehicle: Vehicle, share: float, speed: float, voltage: float = NOMINAL_V) -> Array:
    """Wrench (6,) of all that drive ahead while the vehicle is held at a speed."""
    facts, t = vehicle.actuator_info(), np.linspace(0.0, 20.0, 201)
    commands: dict[str, ArrayLike] = {
        name: np.full(len(t), command(facts[name], share * sense)) for name, sense in drivers(vehicle).items()
    }
    start = State(nu=[speed, 0, 0, 0, 0, 0])
    run = vehicle.simulate(t, commands, start, free="", voltage_v=voltage_for(vehicle, t, voltage))
    wrench: Array = run.tau[-1]
    return wrench


@every("vehicle")
def test_steady_speed_is_the_root_of_the_force_balance(vehicle: Vehicle) -> None:
    for row, share in zip(speeds(vehicle, shares=(0.3, 1.0)), (0.3, 1.0), strict=True):

        def surge(u: float, share: float = share) -> float:
            terms = vehicle.forces([u, 0, 0, 0, 0, 0], LEVEL).values()
            return float(sum(np.asarray(f)[0] for f in terms) + pushed(vehicle, share, u)[0])

        # The run ends when 24 s change the speed by less than 1e-6 m/s.
        assert row.speed_m_s == pytest.approx(brentq(surge, 0.01, 8.0, xtol=1e-10), abs=1e-6)
        assert row.thrust_n == pytest.approx(pushed(vehicle, share, row.speed_m_s)[0], rel=1e-5)


def test_law_steady_speed_leaves_no_acceleration_and_follows_the_characteristic() -> None:
    values, lever = CWOLF.coefficients(), np.asarray(CWOLF.allocation_matrix())[0, 0]

    def acceleration(u: float, rpm: float) -> float:
        # (35): p1 n|n| + p2 |n| V_a with n in rev/s and V_a the inflow along the canted axis.
        n, inflow = rpm / 60.0, (1.0 - values["SbU.w"]) * u * lever
        thrust = values["SbU.p1_ahead"] * n * n + values["SbU.p2"] * n * inflow
        tau = [4.0 * thrust * lever, 0.0, 0.0, 0.0, 0.0, 0.0]
        return float(CWOLF.acceleration([u, 0.0, 0.0, 0.0, 0.0, 0.0], LEVEL, tau)[0])

    rows = speeds(CWOLF)
    assert rows
    for row in rows:
        root = brentq(acceleration, 0.01, 8.0, args=(row.command,), xtol=1e-12)
        # As above.
        assert row.speed_m_s == pytest.approx(root, abs=1e-6)


@every("vehicle")
def test_a_cruise_is_what_the_simulated_vehicle_needs(vehicle: Vehicle) -> None:
    top = speeds(vehicle)[-1]
    for speed in round_speeds_kn(top.speed_kn):
        row = cruise(vehicle, speed * KNOT_M_S)
        assert row is not None
        sailed = speeds(vehicle, shares=(row.command / top.command,))[0]
        # Both ends of the balance: bisection to 1e-12 here, a run until 1e-6 m/s there.
        assert sailed.speed_m_s == pytest.approx(speed * KNOT_M_S, abs=1e-5)
        assert sailed.thrust_n == pytest.approx(row.thrust_n, rel=1e-4)
    assert cruise(vehicle, 1.01 * top.speed_m_s) is None


def test_a_speed_below_the_slowest_revolutions_cannot_be_held() -> None:
    vehicle = one_thruster([1.0, 0.0, 0.0], minimum=10.0)  # 10 N hold 2 m/s
    X_uu = -vehicle.coefficients()["X_uu"]
    slowest = brentq(lambda u: 5.0 * u + X_uu * u * u - 10.0, 0.0, 10.0)
    assert cruise(vehicle, 0.99 * slowest) is None
    row = cruise(vehicle, 1.01 * slowest)
    assert row is not None
    assert row.command == pytest.approx(5.0 * row.speed_m_s + X_uu * row.speed_m_s**2, rel=1e-6)


def test_endurance_is_the_battery_over_hotel_load_and_propulsion() -> None:
    supply, factor = CWOLF.power(), CWOLF.actuator_info()["SbU"]["power_w_s3"]
    for row in (*speeds(CWOLF), cruise(CWOLF, 3.0 * KNOT_M_S)):
        assert row is not None
        propulsion = 4.0 * factor * (row.command / 60.0) ** 3
        # The lag has settled.
        assert row.power_w == pytest.approx(propulsion, rel=1e-9)
        hours = supply["battery_wh"] / (supply["hotel_w"] + propulsion)
        assert row.endurance_h == pytest.approx(hours, rel=1e-9)
        assert row.range_km == pytest.approx(3.6 * row.speed_m_s * hours, rel=1e-9)
    for name in ("beluga", "starter"):
        assert all(row.power_w is row.endurance_h is row.range_km is None for row in speeds(VEHICLES[name]))


@pytest.mark.long
def test_no_other_command_goes_farther() -> None:
    best = farthest(CWOLF)
    assert best is not None
    assert best.range_km is not None
    for share in np.linspace(0.9, 1.1, 21) * best.command / 2000.0:
        other = speeds(CWOLF, shares=(float(share),))[0].range_km
        # The search ends within 1e-4 of the command; the range is flat there.
        assert other is not None
        assert other <= best.range_km * (1.0 + 1e-6)
    # What docs/validation.md quotes; from the assumed battery, hotel load and propellers.
    assert best.speed_m_s == pytest.approx(1.04, abs=5e-3)
    assert best.range_km == pytest.approx(20.8, abs=0.05)
    assert f"farthest at {best.speed_m_s:.2f} m/s" in str(check_vehicle(CWOLF))
    assert farthest(VEHICLES["beluga"]) is None


def test_lit_taubert_2014_table_1() -> None:
    # Table I: 6 kn; the drag and the propellers of the built-in vehicle are partly assumed: 5 %.
    assert speeds(CWOLF)[-1].speed_kn == pytest.approx(6.0, rel=0.05)
    row = cruise(CWOLF, 3.0 * KNOT_M_S)
    assert row is not None
    # Table I: 3 h at 3 kn; battery and hotel load are assumed towards it: 10 %.
    assert row.endurance_h == pytest.approx(3.0, rel=0.1)
    # What docs/validation.md quotes.
    assert row.command == pytest.approx(994.0, abs=0.5)
    assert row.power_w == pytest.approx(167.2, abs=0.1)


@every("vehicle")
def test_a_turn_is_steady(vehicle: Vehicle) -> None:
    found = turns(vehicle)
    assert len(found) == len(TURN_KINDS) * len(STEADY_STATE.turn_shares)
    for turn in found:
        commands = turn_commands(vehicle, turn.share, TURN_KINDS[turn.kind] * turn.share)
        motion = steady(vehicle, commands, free="XYN", voltage_v=NOMINAL_V)
        # Free: surge, sway, yaw. The others are held, so that only these rows of the force must vanish.
        on_vehicle = sum(np.asarray(f) for f in vehicle.forces(motion.nu, LEVEL).values()) + motion.tau
        scale = np.abs(motion.tau[[0, 1, 5]]).max()
        # The run ends when 24 s change a velocity by less than 1e-6.
        np.testing.assert_allclose(on_vehicle[[0, 1, 5]] / scale, np.zeros(3), atol=1e-5)
        speed = float(np.hypot(motion.nu[0], motion.nu[1]))
        assert turn.radius_m == pytest.approx(speed / abs(motion.nu[5]), rel=1e-9)
        assert turn.rate_deg_s > 0.0


def test_the_track_ends_on_the_circle_of_the_steady_turn() -> None:
    for turn in turns(CWOLF, shares=(0.5,)):
        path = track(CWOLF, turn)
        np.testing.assert_array_equal(path[0], np.zeros(2))
        centre, radius = _circle(path[-len(path) // 8 :])
        # The turn is nearly steady after one and a half rounds.
        assert radius == pytest.approx(turn.radius_m, rel=1e-2)
        assert centre[1] > 0.0  # to starboard of a northward course


def _circle(points: Array) -> tuple[Array, float]:
    """Centre (2,) and radius of the circle through points, by linear least squares."""
    system = np.column_stack([2.0 * points, np.ones(len(points))])
    x = np.linalg.lstsq(system, (points**2).sum(axis=1), rcond=None)[0]
    return x[:2], float(np.sqrt(x[2] + x[:2] @ x[:2]))


@every("vehicle")
def test_law_turns_to_port_and_starboard_are_mirror_images(vehicle: Vehicle) -> None:
    starboard, port = (
        steady(vehicle, turn_commands(vehicle, 0.6, 0.2, side=side), free="XYN", voltage_v=NOMINAL_V).nu
        for side in (1.0, -1.0)
    )
    # Beluga's centre of gravity lies 1 mm off its plane, its centre of buoyancy 0.9 mm: 1 %.
    mirrored = port * [1.0, -1.0, 1.0, -1.0, 1.0, -1.0]
    bound = 0.01 if vehicle.name == "beluga" else 1e-9
    np.testing.assert_allclose(mirrored, starboard, atol=bound * np.abs(starboard).max())
    assert starboard[5] > 0.0


def test_supply_voltage_makes_speed() -> None:
    beluga = VEHICLES["beluga"]
    slow, fast = (speeds(beluga, voltage_v=volts)[-1].speed_m_s for volts in (12.0, 16.0))
    assert slow < fast
    assert round_speeds_kn(fast / KNOT_M_S)[-1] <= fast / KNOT_M_S


@pytest.mark.parametrize(
    ("top", "expected"),
    [(6.2, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), (2.1, [0.5, 1.0, 1.5, 2.0]), (0.35, [0.1, 0.2, 0.3]), (0.05, [])],
)
def test_round_speeds_are_few_and_reachable(top: float, expected: list[float]) -> None:
    assert round_speeds_kn(top) == pytest.approx(expected)


def test_vehicles_that_cannot_turn_or_drive_say_so() -> None:
    single, idle = one_thruster([1.0, 0.0, 0.0]), one_thruster([0.0, 0.0, 1.0])
    assert turning_senses(single) == {}
    assert turns(single) == ()
    found = str(check_vehicle(single))
    assert "Turn: not computed; no two actuators that drive ahead lie on opposite sides" in found
    assert "Endurance: not known" in found
    figure = performance(single)
    assert figure is not None
    assert all("turn" not in axes.get_title(loc="left") for axes in figure.axes)
    assert "Speed: no actuator drives ahead" in str(check_vehicle(idle))
    assert check_vehicle(idle).cruises == ()
    assert performance(idle) is None


@pytest.mark.long
def test_the_figure_shows_what_the_vehicle_file_tells(tmp_path: Path) -> None:
    titles = {
        name: [axes.get_title(loc="left") for axes in performance(vehicle).axes]  # type: ignore[union-attr]
        for name, vehicle in VEHICLES.items()
    }
    assert [title for title in titles["cwolf"] if title] == ["speed", "power", "range", "turning circles"]
    for name in ("beluga", "starter"):
        assert [title for title in titles[name] if title] == [
            "speed",
            "thrust at that speed",
            "turning circles",
        ]
    figure = performance(CWOLF)
    assert figure is not None
    figure.draw_without_rendering()
    power, distance = (
        next(a for a in figure.axes if a.get_title(loc="left") == t) for t in ("power", "range")
    )
    for axes in (power, distance):  # above the panel: no legend hides a curve
        legend = axes.get_legend()
        assert legend is not None
        assert legend.get_window_extent().y0 > axes.get_window_extent().y1 - 0.5
    hours = next(axes for axes in figure.axes if axes.get_ylabel() == "endurance, h")
    at = [
        [float(axes.transData.transform((0.0, y))[1]) for y in axes.get_yticks()]
        for axes in (distance, hours)
    ]
    shown = [y for y in at[0] if y <= distance.get_window_extent().y1 + 1.0]
    assert np.allclose(at[1], shown)  # one grid for both
    # Below 150 rpm the motor controller holds nothing.
    assert np.min(figure.axes[0].get_lines()[0].get_xdata()) == pytest.approx(150.0)
    assert all(path.stat().st_size > 10_000 for path in save(figure, tmp_path / "performance"))


def call(*arguments: str) -> Any:
    result = CliRunner().invoke(app, ["check", *arguments])
    assert result.exit_code == 0, result.output
    return result.stdout


def test_check_tells_the_speeds_asked_for() -> None:
    data = json.loads(call("cwolf", "--json", "--figures", "none", "--speed-kn", "3", "--speed-kn", "9"))
    assert [round(row["speed_kn"], 9) for row in data["cruises"]] == [3.0]
    assert data["cruises"][0]["endurance_h"] == pytest.approx(3.22, abs=5e-3)
    assert "Speed: 9 kn is more than its top speed of 6.2 kn" in data["notes"]
    page = call("cwolf", "--figures", "none", "--speed-kn", "0.1")
    assert "0.1 kn is less than the slowest that its motors hold" in page
    assert "Steady turns: radius and rate" in page


def test_what_is_not_known_has_no_column() -> None:
    page = call("beluga", "--figures", "none")
    assert "What a speed takes" in page
    assert "power, W" not in page
    assert "a table of thrust says nothing about power" in page


def test_a_tether_slows_a_vehicle_and_its_spring_does_not_hold_it() -> None:
    head, _, rest = CWOLF.to_toml().partition("[coefficients]")
    table = "[tether]\nposition_m = [-1.2, 0.0, 0.0]\nanchor_m = [0.0, 0.0, 0.0]\nslack_m = 5.0\n"
    towed = Vehicle.from_toml(f"{head}{table}[coefficients]{rest}").with_coefficients({"A_tether": 0.05})
    ahead = dict.fromkeys(("SbU", "SbL", "PU", "PL"), 1000.0)
    own, slower, held = (
        float(steady(vehicle, ahead, free="X", voltage_v=NOMINAL_V).nu[0])
        for vehicle in (CWOLF, towed, towed.with_coefficients({"k_tether": 20.0}))
    )
    # Damping and thrust are those of CWolf, the tether adds half rho A u^2.
    drag = 0.5 * 1025.0 * 0.05 * slower**2
    balance = [
        float(np.asarray(v.forces([u, 0, 0, 0, 0, 0], np.zeros(3))["damping"])[0])
        for v, u in ((CWOLF, slower), (towed, slower))
    ]
    assert balance[0] - balance[1] == pytest.approx(drag, rel=1e-9)
    assert held == slower < 0.9 * own
