"""Load cell of a tied vehicle, and held recipes: wrench of actuators and restoring force, nothing moves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike

from seatrial._core import Run, State, Vehicle
from seatrial.base.errors import TrialError
from seatrial.base.frames import from_euler, matrix
from seatrial.sensors.log import Surroundings, measure
from seatrial.sensors.sensor import Sensor
from seatrial.trial.generated import Recipe

COLUMNS = ("load.X_n", "load.Y_n", "load.Z_n")
T = 0.1 * np.arange(100)


def pull(
    commands: dict[str, ArrayLike],
    attitude: tuple[float, float, float] = (0.0, 0.0, 0.0),
    current: ArrayLike = (),
) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    vehicle = Vehicle.load("cwolf")
    flow = np.asarray(current, float) if np.size(current) else None
    run = vehicle.simulate(T, commands, State(attitude=attitude), flow, free="")
    assert not np.any(run.nu)
    around = Surroundings(vehicle=vehicle, current=flow, held=True)
    return measure(run, {"load_cell": Sensor()}, seed=1, conditions=around).select(COLUMNS).to_numpy()


def test_a_tied_vehicle_pulls_with_its_thrust_and_its_buoyancy() -> None:
    vehicle = Vehicle.load("cwolf")
    value = vehicle.coefficients()
    rev_s = 1200.0 / 60.0
    thrust = value["SbU.p1_ahead"] * rev_s**2
    axis = vehicle.allocation_matrix()[:3, vehicle.actuators.index("SbU")]
    attitude = (0.2, 0.1, 1.0)
    excess = matrix(from_euler(attitude)).T @ [0.0, 0.0, value["m"] * 9.81 - value["B"]]
    last = pull({"SbU": np.full(len(T), 1200.0)}, attitude)[-1]
    # The motor (T_1 of 0.15 s) has settled after 10 s to within a part in 1e9; the table has six digits.
    np.testing.assert_allclose(last, thrust * axis + excess, rtol=1e-6, atol=2e-6)


def test_at_rest_the_tether_feels_weight_less_buoyancy() -> None:
    value = Vehicle.load("cwolf").coefficients()
    expected = [0.0, 0.0, value["m"] * 9.81 - value["B"]]
    np.testing.assert_allclose(pull({})[0], expected, atol=2e-6)


def test_a_current_past_the_vehicle_adds_its_drag() -> None:
    value = Vehicle.load("cwolf").coefficients()
    speed = 0.5
    extra = (pull({}, current=[speed, 0.0, 0.0]) - pull({}))[-1]
    # Water that comes from astern pushes ahead.
    assert extra[0] == pytest.approx(-value["X_u"] * speed - value["X_uu"] * speed**2, rel=1e-6)


def test_a_vehicle_that_moves_has_no_load_cell() -> None:
    vehicle = Vehicle.load("cwolf")
    run = vehicle.simulate(T, {})
    for around in (None, Surroundings(vehicle=vehicle)):
        with pytest.raises(TrialError, match="load cell shows the pull of a tied vehicle"):
            measure(run, {"load_cell": Sensor()}, seed=1, conditions=around)


def recipe(folder: Path, *, vehicle: str = "cwolf", truth: str = "", keys: str = "held = true") -> Path:
    (folder / "truth.toml").write_text(
        f'format = 1\nvehicle = "{vehicle}"\n{truth}\n[sensors.load_cell]\nnoise_n = 0.2\n'
    )
    path = folder / "pull.toml"
    path.write_text(
        'format = 1\ndescription = "pull"\ntruth = "truth.toml"\nseed = 1\nduration_s = 20.0\n' + keys + "\n"
    )
    return path


def test_a_held_recipe_stays_where_it_is_and_logs_its_pull(tmp_path: Path) -> None:
    keys = "held = true\ncommands = [{ t_s = 5.0, stern = 1000.0 }]"
    made = Recipe.load(recipe(tmp_path, keys=keys))
    run = made.run()
    assert isinstance(run, Run)
    assert not np.any(run.nu)
    assert np.ptp(np.asarray(run.position), axis=0).max() == 0.0
    pulled = made.table()["load.X_n"].to_numpy()
    # Motors have settled 2 s after the step; 130 samples of 0.2 N: the mean is known to 0.018 N.
    ahead = float(np.asarray(run.tau)[-1, 0])
    assert ahead > 50.0
    assert abs(pulled[70:].mean() - ahead) < 0.07
    assert abs(pulled[:50].mean()) < 0.12


def test_one_truth_serves_the_tether_and_the_sea(tmp_path: Path) -> None:
    sensors = "[sensors.gyro]\n[sensors.revolutions]\n"
    at_sea = Recipe.load(recipe(tmp_path, truth=sensors, keys="")).table().columns
    assert "p_deg_s" in at_sea
    assert "meas.SbU" in at_sea
    assert not any(column.startswith("load.") for column in at_sea)
    tied = Recipe.load(recipe(tmp_path, truth=sensors)).table().columns
    assert "load.X_n" in tied
    assert "meas.SbU" in tied
    assert "p_deg_s" not in tied


def test_a_held_recipe_with_a_speed_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TrialError, match="a held vehicle does not move, found initial surge_m_s = 1"):
        Recipe.load(recipe(tmp_path, keys="held = true\ninitial = { surge_m_s = 1.0 }"))


def test_supply_voltage_of_a_recipe_and_its_change(tmp_path: Path) -> None:
    rows = "commands = [{ t_s = 0.0, thruster_0 = 1800.0 }, { t_s = 10.0, voltage_v = 12.0 }]"
    made = Recipe.load(recipe(tmp_path, vehicle="beluga", keys=f"held = true\nvoltage_v = 16.0\n{rows}"))
    table = made.table()
    np.testing.assert_array_equal(table["voltage_v"].to_numpy(), np.where(made.t < 10.0 - 1e-9, 16.0, 12.0))
    x = table["load.X_n"].to_numpy()
    # Less supply, less pull; 50 samples of 0.2 N each side.
    assert x[40:90].mean() > x[140:190].mean() + 1.0


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("held = true", "depends on the supply voltage; give the key voltage_v"),
        (
            "held = true\ncommands = [{ t_s = 1.0, voltage_v = 12.0 }]",
            "a row of commands gives voltage_v later; give the key voltage_v too",
        ),
        ("voltage_v = 12.0\ncommands = [{ t_s = 1.0, voltage_v = -1.0 }]", "commands[1], key voltage_v"),
        ("voltage_v = 0.0", "voltage_v"),
        ("held = 1\nvoltage_v = 12.0", "held"),
    ],
)
def test_a_wrong_supply_or_tether_is_refused(tmp_path: Path, keys: str, words: str) -> None:
    with pytest.raises(TrialError) as refusal:
        Recipe.load(recipe(tmp_path, vehicle="beluga", keys=keys))
    assert words in str(refusal.value)


def test_a_truth_may_have_couplings_and_gains_that_its_vehicle_has_not(tmp_path: Path) -> None:
    values = "[values]\nY_rdot = -12.0\nN_vv = -30.0\n'SbU.gain' = 0.9"
    made = Recipe.load(recipe(tmp_path, truth=values, keys="held = true"))
    true, base = made.truth.vehicle.coefficients(), made.truth.base.coefficients()
    assert (true["Y_rdot"], true["N_vv"], true["SbU.gain"]) == (-12.0, -30.0, 0.9)
    assert base.get("Y_rdot", 0.0) == 0.0
    mass = made.truth.vehicle.mass_matrix() - made.truth.base.mass_matrix()
    assert mass[1, 5] == pytest.approx(12.0)
    assert mass[5, 1] == pytest.approx(12.0)
    assert set(made.truth.changed) == {"Y_rdot", "N_vv", "SbU.gain"}
