"""Steps and pulls of a generated, held vehicle: thrust and motor of the truth, written together."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from seatrial._core import Vehicle
from seatrial.base.errors import TrialError
from seatrial.bench_test.evaluate import BenchTest, bench
from seatrial.trial.truth import Truth
from seatrial.vehicle.actuators import bollard

TRUTH = """
format = 1
vehicle = "cwolf"
description = "other thrust, other motor"
[factors]
"SbU.p1_ahead" = 1.2
"SbL.p1_ahead" = 1.2
"PU.p1_ahead" = 1.2
"PL.p1_ahead" = 1.2
[values]
"SbU.T_1" = 0.2
"SbL.T_1" = 0.2
"PU.T_1" = 0.2
"PL.T_1" = 0.2
[sensors.load_cell]
noise_n = 2.0
bias_n = 3.0
[sensors.revolutions]
noise_rpm = 5.0
"""
RECIPE = """
format = 1
description = "staircase in the basin"
truth = "truth.toml"
seed = 3
held = true
duration_s = 128.0
commands = [
    { t_s = 8.0, stern = 400.0 }, { t_s = 16.0, stern = 700.0 }, { t_s = 24.0, stern = 1000.0 },
    { t_s = 32.0, stern = 1400.0 }, { t_s = 40.0, stern = 2000.0 }, { t_s = 48.0, stern = 600.0 },
    { t_s = 56.0, stern = 0.0 }, { t_s = 64.0, stern = -400.0 }, { t_s = 72.0, stern = -700.0 },
    { t_s = 80.0, stern = -1000.0 }, { t_s = 88.0, stern = -1400.0 }, { t_s = 96.0, stern = -2000.0 },
    { t_s = 104.0, stern = -600.0 }, { t_s = 112.0, stern = 0.0 },
]
"""
BENCH = """
format = 1
name = "basin"
vehicle = "cwolf"
regression = { order = "square" }
[[pulls]]
name = "stairs"
file = "stairs.toml"
group = "stern"
axis = "X"
[[steps]]
name = "stairs"
file = "stairs.toml"
group = "stern"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("basin")
    for name, text in (("truth", TRUTH), ("stairs", RECIPE), ("bench", BENCH)):
        (made / f"{name}.toml").write_text(text)
    return made


@pytest.fixture(scope="module")
def found(folder: Path) -> BenchTest:
    return bench(folder / "bench.toml")


def test_thrust_of_the_truth_is_recovered_from_a_generated_pull(found: BenchTest) -> None:
    before, after = found.before.coefficients(), found.vehicle.coefficients()
    directions = found.pulls["stern"].directions
    for side, factor in (("ahead", 1.2), ("astern", 1.0)):
        ratio = after[f"SbU.p1_{side}"] / before[f"SbU.p1_{side}"]
        relative = float(directions[side].fit.standard_deviations[0] / directions[side].fit.coefficients[0])
        assert relative < 0.005
        # Four standard deviations, and the six digits of the file.
        assert ratio == pytest.approx(factor, rel=4.0 * relative + 1e-5)


def test_the_motor_of_the_truth_is_recovered_from_the_same_file(found: BenchTest) -> None:
    motor = found.motors["stern"]
    assert motor["T_1"].value == pytest.approx(0.2, abs=0.01)
    assert motor["T_t"].value == pytest.approx(0.1, abs=0.01)
    assert len(found.step_records["stern"]) == 4


def test_thrust_and_motor_are_written_together_and_other_actuators_keep_theirs(found: BenchTest) -> None:
    table = tomllib.loads(found.vehicle_text)
    motors = {one["name"]: one["motor"] for one in table["thrusters"]}
    # CWolf's vertical thrusters share the motor's entry with the stern propellers.
    assert (motors["SbU"], motors["VTB"]) == ("propeller_stern", "propeller")
    assert table["motors"]["propeller"]["T_1_s"] == 0.15
    assert table["motors"]["propeller_stern"]["T_1_s"] == pytest.approx(0.2, abs=0.01)
    assert table["motors"]["propeller_stern"]["maximum_ahead"] == 2000.0
    assert found.vehicle.coefficients()["VTB.T_1"] == Vehicle.load("cwolf").coefficients()["VTB.T_1"]
    assert any(text.startswith("stern motor: ") for text in found.sentences())


def test_thrust_over_the_command_is_that_of_the_pull_whatever_the_motor_s_gain(tmp_path: Path) -> None:
    # The controller gives 0.9 of what it is asked for: motor and characteristic must not both be blamed.
    (tmp_path / "truth.toml").write_text(
        TRUTH.replace(
            "[values]", "[values]\n" + "".join(f'"{n}.K_V" = 0.9\n' for n in ("SbU", "SbL", "PU", "PL"))
        )
    )
    (tmp_path / "stairs.toml").write_text(RECIPE)
    (tmp_path / "bench.toml").write_text(BENCH)
    geared = bench(tmp_path / "bench.toml")
    true = Truth.load(tmp_path / "truth.toml").vehicle
    assert geared.motors["stern"]["K_V"].value == pytest.approx(0.9, abs=0.002)
    for command in (700.0, 1400.0, -1400.0):
        commands = dict.fromkeys(("SbU", "SbL", "PU", "PL"), command)
        # Half a per cent: the pull's noise, and the motor's gain enters squared.
        assert bollard(geared.vehicle, commands)[0] == pytest.approx(bollard(true, commands)[0], rel=0.005)


def test_steps_alone_are_a_bench_test(folder: Path) -> None:
    text = BENCH[: BENCH.index("[[pulls]]")] + BENCH[BENCH.index("[[steps]]") :]
    (folder / "steps.toml").write_text(text)
    alone = bench(folder / "steps.toml")
    assert alone.pulls == {}
    assert set(alone.to_dict()["motors"]) == {"stern"}


def test_steps_without_revolutions_are_refused(folder: Path) -> None:
    text = BENCH[BENCH.index("[[steps]]") :].replace('group = "stern"', 'group = "vertical"')
    (folder / "none.toml").write_text(BENCH[: BENCH.index("[[pulls]]")] + text)
    (folder / "bare.csv").write_text("t_s,cmd.VTB\n" + "".join(f"{0.1 * k:.1f},{k}\n" for k in range(30)))
    (folder / "none.toml").write_text((folder / "none.toml").read_text().replace("stairs.toml", "bare.csv"))
    with pytest.raises(TrialError, match=r"no actuator of vertical has both its command and its revolutions"):
        bench(folder / "none.toml")
    (folder / "bare.csv").write_text("cmd.VTB,meas.VTB\n" + "1,1\n" * 30)
    with pytest.raises(TrialError, match=r"no time in .*bare\.csv"):
        bench(folder / "none.toml")
