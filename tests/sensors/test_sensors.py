"""Sensors and generated trials: imperfections as stated, the same seed the same log, refusals in words."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from numpy.typing import ArrayLike

from seatrial._core import Run, Vehicle
from seatrial.base.errors import TrialError, VehicleError
from seatrial.campaign.campaign import Campaign
from seatrial.check.campaign import check_campaign
from seatrial.sensors import sensor as sensor_file
from seatrial.sensors.log import measure
from seatrial.sensors.sensor import KINDS, Sensor, load_sensors, parse_sensors
from seatrial.trial.generated import Recipe
from seatrial.trial.trial import Trial
from seatrial.trial.truth import Truth

CWOLF = Path(__file__).parents[2] / "examples" / "cwolf"


@pytest.fixture(scope="module")
def run() -> Run:
    """Two hundred seconds ahead in a turn."""
    t = np.arange(0.0, 200.0, 0.1)
    commands: dict[str, ArrayLike] = {"SbU": np.full(len(t), 800.0), "PU": np.full(len(t), 1100.0)}
    return Vehicle.load("cwolf").simulate(t, commands)


def column(table: pl.DataFrame, name: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return table[name].to_numpy()


def test_noise_has_the_stated_deviation(run: Run) -> None:
    logged = column(measure(run, {"depth": Sensor(noise=0.02)}, seed=3), "z_m")
    error = logged - np.asarray(run.position)[:, 2]
    # 2000 samples: the deviation is known to 1.6 % (one standard deviation), the mean to 0.45 mm.
    assert abs(error.std() / 0.02 - 1.0) < 0.06
    assert abs(error.mean()) < 0.002


def test_bias_is_constant_over_a_run_and_differs_between_channels_and_seeds(run: Run) -> None:
    def errors(seed: int) -> list[float]:
        table = measure(run, {"dvl": Sensor(bias=0.01)}, seed=seed)
        offsets = [
            column(table, name) - np.asarray(run.nu)[:, k] for k, name in enumerate(KINDS["dvl"].columns)
        ]
        # The columns are rounded to 1e-6.
        assert all(np.ptp(offset) < 2e-6 for offset in offsets)
        return [float(offset[0]) for offset in offsets]

    first, second = errors(1), errors(2)
    assert len({round(x, 5) for x in first + second}) == 6


def test_quantum_is_the_step_of_the_digits(run: Run) -> None:
    logged = column(measure(run, {"gyro": Sensor(quantum=0.25)}, seed=1), "r_deg_s")
    np.testing.assert_allclose(logged / 0.25, np.round(logged / 0.25), atol=1e-9)
    assert len(np.unique(logged)) > 3


def test_a_slow_sensor_leaves_cells_empty_and_a_late_one_reports_the_past(run: Run) -> None:
    slow = measure(run, {"attitude": Sensor(rate_hz=2.0)}, seed=1)["yaw_deg"]
    assert slow.null_count() == 1600
    assert not slow.is_nan().any()
    late = column(measure(run, {"dvl": Sensor(latency_s=0.3)}, seed=1), "u_m_s")
    np.testing.assert_allclose(late[3:], np.asarray(run.nu)[:-3, 0], atol=1e-6)


def test_the_same_seed_gives_the_same_log_whatever_other_sensors_there_are(run: Run) -> None:
    alone = measure(run, {"depth": Sensor(noise=0.02)}, seed=5)
    together = measure(run, {"gyro": Sensor(noise=0.1), "depth": Sensor(noise=0.02)}, seed=5)
    assert alone["z_m"].equals(together["z_m"])
    assert not alone["z_m"].equals(measure(run, {"depth": Sensor(noise=0.02)}, seed=6)["z_m"])


def test_golden_a_log_of_sensors_in_step_is_what_it_was(run: Run) -> None:
    # Published figures rest on these numbers: a sensor without a time base, place or drop-outs of its own
    # draws as it did when it knew none of them.
    table = measure(
        run,
        {
            "dvl": Sensor(noise=0.01, bias=0.003, quantum=0.001, rate_hz=5.0, latency_s=0.25),
            "gyro": Sensor(noise=0.1, bias=0.02),
            "attitude": Sensor(noise=0.2, quantum=0.1, rate_hz=2.0),
            "depth": Sensor(noise=0.02, bias=0.1, quantum=0.01),
            "position": Sensor(noise=0.3, rate_hz=1.0),
            "revolutions": Sensor(noise=3.0, quantum=1.0),
        },
        seed=11,
    )
    frozen = {
        "u_m_s": [0.008, 0.041, 1.124],
        "w_m_s": [-0.006, -0.009, -0.06],
        "p_deg_s": [0.045422, 0.234164, 1.258121],
        "r_deg_s": [0.171409, 0.493138, 3.042944],
        "pitch_deg": [-0.1, -0.9, -21.7],
        "yaw_deg": [0.0, 0.3, -94.3],
        "z_m": [0.07, 0.06, 73.47],
        "x_m": [0.334551, 0.37759, -25.765844],
        "y_m": [-0.186013, -0.692245, 19.303025],
        "meas.PU": [-3.0, 1070.0, 1103.0],
        "meas.VTS": [3.0, -3.0, -1.0],
    }
    for name, values in frozen.items():
        # The motion of 199 s repeats on any processor to better than the last digit's rounding.
        np.testing.assert_allclose(column(table, name)[[0, 10, 1990]], values, atol=2e-6)


def test_revolutions_are_logged_behind_the_motor(run: Run) -> None:
    table = measure(run, {"revolutions": Sensor()}, seed=1)
    # Command 1100 rpm from the start: the lag keeps the first samples below, the end reaches it.
    assert column(table, "meas.PU")[0] < 500.0 < 1099.0 < column(table, "meas.PU")[-1]


@pytest.mark.parametrize(
    ("kind", "table", "words"),
    [
        ("dvvl", {}, 'did you mean "dvl"?'),
        ("dvl", {"noise_ms": 0.1}, 'did you mean "noise_m_s"?'),
        ("gyro", {"noise_deg_s": -0.1}, "expected a positive number, found -0.1"),
        ("depth", {"rate_hz": 0}, "expected a positive number, found 0"),
        ("depth", {"noise_m": "1 cm"}, "expected a positive number, found '1 cm'"),
        ("dvl", {"jitter_s": -0.1}, "key jitter_s: expected a positive number, found -0.1"),
        ("dvl", {"max_range_m": 0.0}, "key max_range_m: expected a positive number, found 0.0"),
        ("dvl_water", {"max_range_m": 50.0}, 'unknown key "max_range_m"'),
        ("gps", {"position_m": [0.0, 1.0]}, "expected [forward, starboard, down] from O in m"),
        ("gps", {"position_m": [0.0, 1.0, "up"]}, "found [0.0, 1.0, 'up']"),
        ("gps", {"position_m": 0.5}, "found 0.5"),
        ("load_cell", {"noise_m": 0.5}, 'did you mean "noise_n"?'),
    ],
)
def test_a_wrong_sensor_is_refused(kind: str, table: dict[str, object], words: str) -> None:
    with pytest.raises(TrialError, match="sensors") as refusal:
        Sensor.parse(kind, table)
    assert words in str(refusal.value)


def test_two_sensors_of_one_column_are_refused() -> None:
    with pytest.raises(TrialError, match="sensors position and gps both log x_m; leave one of them out"):
        parse_sensors({"position": {}, "gps": {}})


def test_every_kind_can_be_noisy_biased_and_rounded() -> None:
    for kind, facts in KINDS.items():
        keys = {f"{name}_{facts.unit}": 0.5 for name in ("noise", "bias", "quantum")}
        assert Sensor.parse(kind, keys) == Sensor(noise=0.5, bias=0.5, quantum=0.5)


@pytest.mark.parametrize("name", Vehicle.names())
def test_typical_sensors_suit_any_vehicle(name: str) -> None:
    vehicle = Vehicle.load(name)
    sensors = load_sensors("typical", vehicle)
    assert {"dvl", "dvl_water", "gyro", "attitude", "depth", "gps"} <= set(sensors)
    facts = vehicle.actuator_info().values()
    assert ("voltage" in sensors) == any(actuator["needs_voltage"] for actuator in facts)
    assert ("revolutions" in sensors) == any(actuator["unit"] == "rpm" for actuator in facts)


def test_typical_sensors_say_where_each_number_comes_from() -> None:
    path = Path(sensor_file.__file__).with_name("typical.toml")
    numbers = [line for line in path.read_text().splitlines() if " = " in line and line[0] not in "#df"]
    assert len(numbers) > 40
    for line in numbers:
        assert "# assumed" in line or "# VideoRay" in line, line


def test_cwolfs_truth_differs_from_the_built_in_vehicle_by_ten_to_forty_per_cent() -> None:
    true = Truth.load(CWOLF / "truth.toml").vehicle.coefficients()
    base = Vehicle.load("cwolf").coefficients()
    hull = {name: true[name] / base[name] for name in base if "." not in name and base[name]}
    factors = {name: factor for name, factor in hull.items() if factor != 1.0 and name != "B"}
    assert len(factors) > 20
    assert all(
        abs(factor - 1.0) + 1e-9 >= 0.1 and abs(factor - 1.0) <= 0.4 + 1e-9 for factor in factors.values()
    )
    assert all(hull[name] == 1.0 for name in ("m", "I_x", "I_y", "I_z"))
    # What the model lacks: couplings, and propellers unlike each other.
    assert all(name in true and name not in base for name in ("Y_rdot", "N_vv", "Z_qdot"))
    stern = [true[f"{name}.gain"] for name in ("SbU", "SbL", "PU", "PL")]
    assert np.mean(stern) == pytest.approx(1.0)
    assert np.ptp(stern) >= 0.05 - 1e-9


def test_a_generated_file_says_so_and_reads_like_its_recipe(tmp_path: Path) -> None:
    recipe = Recipe.load(CWOLF / "trials" / "roll.toml")
    path = tmp_path / "roll.csv"
    recipe.save(path)
    assert path.read_text().startswith("# GENERATED")
    from_recipe, from_file = Trial.read(recipe.path), Trial.read(path)
    np.testing.assert_array_equal(from_recipe.observed, from_file.observed)
    np.testing.assert_array_equal(Trial.read(recipe.path).observed, from_recipe.observed)


def test_a_command_row_sets_a_group_and_a_later_one_single_actuators() -> None:
    recipe = Recipe.load(CWOLF / "trials" / "turn.toml")
    at = np.searchsorted(recipe.t, [10.0, 25.0])
    assert [recipe.commands["PU"][i] for i in at] == [800.0, 1000.0]
    assert [recipe.commands["SbU"][i] for i in at] == [800.0, 500.0]
    assert not recipe.commands["VTB"].any()


@pytest.mark.long
def test_the_shipped_campaign_is_ready_to_identify() -> None:
    found = check_campaign(Campaign.load(CWOLF / "campaign.toml"))
    assert found.problems == ()
    assert found.stages[0].name == "forward speed"
    assert len(found.stages) == 5


RECIPE = """
format = 1
description = "made"
truth = "truth.toml"
seed = 1
duration_s = 5.0
"""


@pytest.mark.parametrize(
    ("recipe", "truth", "words"),
    [
        (
            "commands = [{ t_s = 0.0, stem = 100.0 }]",
            "",
            'unknown actuator or group "stem"; did you mean "stern"?',
        ),
        ("commands = [{ stern = 100.0 }]", "", "commands[1]: expected t_s"),
        (
            "commands = [{ t_s = 2.0, PU = 1.0 }, { t_s = 1.0, PU = 1.0 }]",
            "",
            "not before the row above; found 1.0",
        ),
        ("durations = 3", "", "unknown key 'durations'"),
        ("commands = 3 4", "", "not a TOML file"),
        ("", "[sensors.dvl]\nnois = 1", 'unknown key "nois"'),
        ("", "format = 2", "format"),
        ("", "[values]\nX_uu = true", "values, key X_uu: expected a number, found True"),
    ],
)
def test_a_wrong_recipe_is_refused(tmp_path: Path, recipe: str, truth: str, words: str) -> None:
    base = "" if "format" in truth else "format = 1\n"
    (tmp_path / "truth.toml").write_text(f'{base}vehicle = "cwolf"\n{truth}\n')
    (tmp_path / "made.toml").write_text(RECIPE + recipe)
    with pytest.raises(TrialError) as refusal:
        Trial.read(tmp_path / "made.toml")
    assert words in str(refusal.value)
    assert ".toml" in str(refusal.value)


def test_an_unknown_coefficient_of_the_truth_is_refused_with_the_nearest(tmp_path: Path) -> None:
    (tmp_path / "truth.toml").write_text('format = 1\nvehicle = "cwolf"\n[factors]\nX_uuu = 1.1\n')
    with pytest.raises(VehicleError, match='did you mean "X_uu"'):
        Truth.load(tmp_path / "truth.toml")
