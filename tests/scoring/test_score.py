"""The score's definition, on simulations whose errors are known."""

from __future__ import annotations

import json
import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from seatrial._core import Vehicle as CoreVehicle
from seatrial.base.errors import TrialError, VehicleError
from seatrial.base.run import to_json
from seatrial.scoring.comparison import compare
from seatrial.scoring.score import score
from seatrial.scoring.windows import windows
from seatrial.trial.trial import Trial
from tests.trial import motion

T = np.arange(0.0, 60.0, 0.1)
Array = NDArray[np.float64]


class Vehicle:
    """As much of a vehicle as a score asks for."""

    name = "made-up"

    def __init__(self, actuators: tuple[str, ...] = ("stern",), needs_voltage: bool = False) -> None:
        self.actuators, self._needs_voltage = list(actuators), needs_voltage

    def actuator_info(self) -> dict[str, dict[str, bool]]:
        return {name: {"needs_voltage": self._needs_voltage} for name in self.actuators}


@pytest.fixture
def core(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A core whose simulation is the measurement plus `error` (12,), and which keeps what it was given."""
    fake = SimpleNamespace(error=np.zeros(12), records=[], segments=[])

    class Record:
        def __init__(self, t: Array, commands: dict[str, Array], **rest: Any) -> None:
            self.t, self.commands, self.rest = t, commands, rest
            fake.records.append(self)

    class OpenLoop:
        def __init__(self, vehicle: Any, records: list[Record], segments: list[Any], **options: Any) -> None:
            self.records, self.segments = records, segments
            fake.segments = segments

        def predict(self, values: Array, *rest: Any, **options: Any) -> list[Array]:
            return [self.records[s[0]].rest["observed"][s[1] : s[2]] + fake.error for s in self.segments]

    fake.Record, fake.OpenLoop = Record, OpenLoop
    monkeypatch.setitem(sys.modules, "seatrial._core", fake)
    return fake


def trial(**more: Any) -> Trial:
    table = motion.columns(T) | {"cmd.stern": np.sin(T)} | more
    return Trial.read(table, align=False, name="run")


def judged(*arguments: Any, **options: Any) -> Any:
    return score(*arguments, **options)


def test_a_vehicle_may_be_named() -> None:
    own = Trial.read(motion.columns(T), name="own")
    with pytest.raises(VehicleError, match='did you mean "cwolf"'):
        score("cwolff", own)
    with pytest.raises(TrialError, match=r"expected a trial or a list of trials, found 'own\.csv'"):
        score("cwolf", "own.csv")  # type: ignore[arg-type]


def test_a_perfect_simulation_scores_one(core: SimpleNamespace) -> None:
    result = judged(Vehicle(), trial())
    assert all(value == pytest.approx(1.0) for value in result.r2.values())
    assert len(result.windows) == 6
    assert result["u"].n == 599  # every sample but the first: windows share their borders


def test_r2_is_one_minus_sse_over_sst_and_mae_and_rmse_are_those_of_the_error(core: SimpleNamespace) -> None:
    core.error[0], core.error[11] = 0.1, -0.2
    result, u = judged(Vehicle(), trial()), motion.nu(T)[1:, 0]
    assert result["u"].r2 == pytest.approx(1.0 - 0.01 * len(u) / np.sum((u - u.mean()) ** 2))
    assert result["u"].mae == pytest.approx(0.1)
    assert result["u"].rmse == pytest.approx(0.1)
    assert result["yaw"].mae == pytest.approx(0.2)
    assert result["v"].r2 == pytest.approx(1.0)


def test_angles_are_compared_along_the_shorter_way_round(core: SimpleNamespace) -> None:
    core.error[11] = 2.0 * np.pi - 0.1
    assert judged(Vehicle(), trial())["yaw"].mae == pytest.approx(0.1)


def test_turning_on_does_not_make_a_heading_easier_to_predict(core: SimpleNamespace) -> None:
    core.error[11] = 1.0
    turns = np.rad2deg(2.0 * T)
    result = judged(Vehicle(), Trial.read({"t_s": T, "yaw_deg": turns, "cmd.stern": T}, name="turns"))
    # headings all round the compass deviate by pi / sqrt(3) from their mean; 19 turns and a bit are sampled
    assert result["yaw"].r2 == pytest.approx(1.0 - 3.0 / np.pi**2, abs=0.02)


def test_masked_samples_do_not_count_and_starts_move_past_them(core: SimpleNamespace) -> None:
    table = motion.columns(T)
    table["u_m_s"][195:210] = np.nan
    result = judged(Vehicle(), trial(u_m_s=table["u_m_s"]), channels=["u", "v"])
    assert list(result) == ["u", "v"]
    assert result["u"].n == result["v"].n - 6  # nine of the fifteen lie outside every window
    assert result.shifted == 1
    assert [(window.start, window.stop) for window in result.windows][:3] == [
        (0, 101),
        (100, 201),
        (212, 313),
    ]


def test_windows_that_move_or_have_no_start_are_counted_over_all_trials(core: SimpleNamespace) -> None:
    table = motion.columns(T)
    table["u_m_s"][195:210] = np.nan
    table["u_m_s"][300:] = np.nan
    gaps = trial(u_m_s=table["u_m_s"])
    alone = judged(Vehicle(), gaps, channels=["u"])
    both = judged(Vehicle(), [gaps, gaps], channels=["u"])
    assert alone.shifted > 0
    assert alone.skipped > 0
    assert (both.shifted, both.skipped) == (2 * alone.shifted, 2 * alone.skipped)


def test_scores_of_several_trials_are_pooled_about_one_mean(core: SimpleNamespace) -> None:
    core.error[0] = 0.1
    both = judged(Vehicle(), [trial(), trial(u_m_s=motion.nu(T)[:, 0] + 5.0)])
    u = motion.nu(T)[1:, 0]
    pooled = np.concatenate([u, u + 5.0])
    assert both["u"].r2 == pytest.approx(1.0 - 0.01 / np.var(pooled))


def test_a_free_run_is_one_window_over_the_part(core: SimpleNamespace) -> None:
    result = judged(Vehicle(), trial(), free_run=True, start_s=10.0, stop_s=50.0)
    assert [(window.start, window.stop) for window in result.windows] == [(100, 500)]
    assert json.loads(to_json(result.to_dict()))["ahead_s"] is None


def test_a_diverged_simulation_is_a_number(core: SimpleNamespace) -> None:
    core.error[0] = np.nan
    result = judged(Vehicle(), trial())
    assert result["u"].r2 == -np.inf
    assert result["u"].mae == np.inf
    assert not result.unscored
    core.error[:] = np.nan
    assert judged(Vehicle(), trial()).unscored.startswith("the simulation diverges in u, v, w, p")


def test_the_wrench_drives_the_vehicle_where_no_command_is_recorded(core: SimpleNamespace) -> None:
    wrench = trial(**{"tau.X_n": np.cos(T)})
    judged(Vehicle(("bow",)), wrench)
    assert core.records[-1].commands == {}
    np.testing.assert_allclose(core.records[-1].rest["tau"][:, 0], np.cos(T))
    judged(Vehicle(), wrench)
    assert core.records[-1].rest["tau"] is None
    assert set(core.records[-1].commands) == {"stern"}


@pytest.mark.parametrize(
    ("vehicle", "options", "message"),
    [
        (Vehicle(("stern", "bow")), {}, r"run: nothing drives the vehicle made-up: .* no column cmd\.bow"),
        (Vehicle(("stern", "bow")), {"input": "commands"}, r"actuators without a recorded signal: bow"),
        (Vehicle(), {"input": "tau"}, r"input tau is not recorded; map the columns tau\.X_n"),
        (Vehicle(), {"channels": ["yow"]}, r'channel "yow" is not in the trials; did you mean "yaw"'),
        (Vehicle(), {"ahead_s": 0.0}, r"ahead_s: expected a positive time in s, found 0\.0"),
        (Vehicle(), {"start_s": 70.0}, r"run: no window can start from 70 s"),
        (
            Vehicle(),
            {"start_s": 50.0, "stop_s": 10.0},
            r"expected a start before the stop, found 50 s and 10 s",
        ),
        (
            Vehicle(needs_voltage=True),
            {},
            r"depend on the supply voltage, which is not recorded; map the column voltage_v",
        ),
    ],
)
def test_what_cannot_be_scored_is_said(
    core: SimpleNamespace, vehicle: Vehicle, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(TrialError, match=message):
        judged(vehicle, trial(), **options)


def test_windows_without_a_valid_start_are_left_out() -> None:
    table = motion.columns(T)
    table["u_m_s"][90:350] = np.nan
    spans, late, left_out = windows(Trial.read(table, align=False), 10.0)
    assert spans[1][0] == 352
    assert (late, left_out) == (1, 2)


def test_a_score_prints_as_a_table_and_becomes_plain_data(core: SimpleNamespace) -> None:
    core.error[5] = np.deg2rad(2.0)
    result = judged(Vehicle(), trial())
    lines = str(result).splitlines()
    assert lines[0] == "run: 10 s ahead, 6 windows (0 started late, 0 left out)"
    assert next(line for line in lines if line.startswith("r ")).split()[3:6] == ["2", "2", "deg/s"]
    assert json.loads(json.dumps(result.to_dict()))["channels"]["r"]["n"] == 599


def test_the_record_has_half_steps_and_weights_of_valid_samples_only(core: SimpleNamespace) -> None:
    table = motion.columns(T)
    table["u_m_s"][5] = np.nan
    trial(u_m_s=table["u_m_s"]).record({"u": 2.0, "yaw": 0.5}, substeps=3)
    rest = core.records[-1].rest
    assert rest["nu"].shape == rest["nu_rate"].shape == (2 * 3 * (len(T) - 1) + 1, 6)
    assert rest["weight"][5, 0] == 0.0
    np.testing.assert_array_equal(np.unique(rest["weight"], axis=0)[-1], [2.0, *[0.0] * 10, 0.5])
    with pytest.raises(TrialError, match='"yow" is no channel'):
        trial().record({"yow": 1.0})


def test_law_a_vehicle_scores_one_on_its_own_simulation() -> None:
    real = pytest.importorskip("seatrial._core", reason="the core is not built")
    vehicle = real.Vehicle.load("cwolf")
    t = np.arange(0.0, 60.0, 0.1)
    # From rest with motors at rest: what they did before the record is unknown to a restart.
    steps = [np.where(t < 2.0, 0.0, 600.0 + 300.0 * np.sign(np.sin(0.2 * t + k))) for k in range(10)]
    commands = dict(zip(vehicle.actuators, steps, strict=False))
    run = vehicle.simulate(t, commands)
    names = (
        "x_m",
        "y_m",
        "z_m",
        "q_w",
        "q_x",
        "q_y",
        "q_z",
        "u_m_s",
        "v_m_s",
        "w_m_s",
        "p_deg_s",
        "q_deg_s",
        "r_deg_s",
    )
    values = [*run.position.T, *run.attitude.T, *run.nu[:, :3].T, *np.rad2deg(run.nu[:, 3:]).T]
    table = {
        "t_s": t,
        **dict(zip(names, values, strict=True)),
        **{f"cmd.{a}": x for a, x in commands.items()},
    }
    result = score(vehicle, Trial.read(table, name="own"), ahead_s=10.0)
    # the smoothed states at the restarts of a record without noise are off by 1e-8
    assert min(result.r2.values()) > 1.0 - 1e-6


def test_a_trial_shorter_than_the_time_ahead_is_said_first() -> None:
    vehicle, t = CoreVehicle.load("cwolf"), np.arange(0.0, 3.0, 0.1)
    run = vehicle.simulate(t, dict.fromkeys(vehicle.actuators, 600.0 + 0.0 * t))
    columns = {"t_s": t, "u_m_s": run.nu[:, 0]} | {
        f"cmd.{name}": 600.0 + 0.0 * t for name in vehicle.actuators
    }
    said = score(vehicle, Trial.read(columns, name="leg"), ahead_s=10.0).report("cwolf").text()
    assert "Worst: No simulation lasts 10 s: the longest piece of the log has 2.9 s." in said
    assert "--ahead 2.9" in said


def test_a_replayed_channel_is_marked_and_is_no_evidence() -> None:
    vehicle, t = CoreVehicle.load("cwolf"), np.arange(0.0, 40.0, 0.1)
    commands = {name: 600.0 + 300.0 * np.sign(np.sin(0.3 * t)) for name in vehicle.actuators}
    run = vehicle.simulate(t, commands)
    motion_columns = {"u_m_s": run.nu[:, 0], "v_m_s": run.nu[:, 1], "w_m_s": run.nu[:, 2]}
    recorded = Trial.read(
        {"t_s": t} | motion_columns | {f"cmd.{name}": s for name, s in commands.items()}, name="leg"
    )
    weak = vehicle.with_coefficients({"X_uu": 2.0 * vehicle.coefficients()["X_uu"]})
    found = score(weak, recorded, free="X", measured="YZKMN")
    assert [name for name, one in found.items() if one.replayed] == ["v", "w"]
    assert found.to_dict()["channels"]["w"]["replayed"] is True
    rows = {line.split()[0]: line.split()[1] for line in str(found).splitlines()[2:]}
    assert rows["w"] == rows["v"] == "replayed" != rows["u"]
    assert " in u, worst" in found.report().text()  # of the one channel that is predicted
    against = compare({"file": vehicle, "weak": weak}, recorded, free="X", measured="YZKMN")
    assert {one.channel for one in against.differences} == {"u"}
    assert "replayed" in str(against)
