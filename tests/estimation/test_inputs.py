"""Inputs judged before anything is fitted: which thrusts a campaign drives, which gains that can tell."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from seatrial._core import Vehicle
from seatrial.campaign.campaign import Campaign
from seatrial.check.campaign import check_campaign
from seatrial.estimation.inputs import dependence, judge_inputs
from seatrial.estimation.scale import homogeneity
from seatrial.inspect.wiring import thrusts

EXAMPLES = Path(__file__).parents[2] / "examples"
DATA = Path(os.environ.get("SEATRIAL_DATA", "/nonexistent")) / "beluga"
T = np.arange(0.0, 60.0, 0.1)

TWIN = """
format = 1
name = "twin"
[geometry]
length_m = 2.0
diameter_m = 0.2
[coefficients]
m = 50.0
z_b = -0.02
X_u = -5.0
N_r = -5.0
[characteristics.direct]
kind = "direct"
[motors.slow]
T_1_s = 2.0
[[thrusters]]
name = "port"
group = "main"
command = "N"
position_m = [-1.0, -0.3, 0.0]
direction = [1.0, 0.0, 0.0]
motor = "slow"
characteristic = "direct"
[[thrusters]]
name = "starboard"
group = "main"
command = "N"
position_m = [-1.0, 0.3, 0.0]
direction = [1.0, 0.0, 0.0]
motor = "slow"
characteristic = "direct"
"""

RUDDER = """
[[fins]]
name = "rudder"
position_m = [-0.8, 0.0, 0.0]
normal = [0.0, 1.0, 0.0]
area_m2 = 0.02
aspect_ratio = 2.0
motor = "slow"
"""

CAMPAIGN = """
format = 1
name = "twin"
vehicle = "twin.toml"
{top}
[trials.one]
file = "one.csv"
{trial}
[[stages]]
name = "surge"
trials = ["one"]
axes = {{ free = "{free}", measured = "{measured}" }}
[stages.coefficients]
X_u = [-20.0, 0.0]
{coefficients}
"""

Array = NDArray[np.float64]


def campaign(
    folder: Path,
    columns: dict[str, Array],
    *,
    top: str = "",
    trial: str = "",
    coefficients: str = "",
    vehicle: str = TWIN,
    free: str = "X",
) -> Campaign:
    """One trial of the twin-screw vehicle, as a frame."""
    (folder / "twin.toml").write_text(vehicle)
    measured = "" if "N" in free else "N"
    text = CAMPAIGN.format(top=top, trial=trial, coefficients=coefficients, free=free, measured=measured)
    frame = {"t_s": T, "u_m_s": np.sin(0.1 * T), "r_deg_s": np.cos(0.1 * T)} | columns
    return Campaign.from_toml(text, folder=folder, trials={"one": frame})


def steps(seed: int) -> Array:
    """Random steps of 5 s between -10 and 10."""
    return np.repeat(np.random.default_rng(seed).uniform(-10.0, 10.0, 12), 50)


def centred(*signals: Array) -> Array:
    stacked = np.stack(signals, axis=1)
    return np.asarray((stacked - stacked.mean(axis=0)) / np.sqrt(len(stacked)))


def test_independent_signals_leave_nothing_out() -> None:
    found = dependence(centred(steps(1), steps(2), steps(3)), ["a", "b", "c"])
    assert found.combinations == ()
    assert found.still == ()
    assert found.singular_values[0] == 1.0


def test_signals_that_move_together_are_one_family_with_their_proportion() -> None:
    one, other = steps(1), steps(2)
    found = dependence(centred(one, other, -one, 2.0 * one), ["a", "b", "c", "d"])
    assert found.lost == 2
    assert found.sentences() == ["a, c, d move only together: +1 -1 +2"]


def test_a_signal_that_stays_is_still() -> None:
    found = dependence(centred(steps(1), np.full(len(T), 7.0)), ["a", "b"])
    assert found.still == ("b",)
    assert found.combinations == ()
    nothing = dependence(np.zeros((5, 2)), ["a", "b"])
    assert nothing.still == ("a", "b")
    assert nothing.singular_values == ()


def test_the_null_modes_of_an_allocator_are_written_with_few_signals() -> None:
    """Two rectangles of four thrusters, each driven three ways, as the four verticals of a hover vehicle."""
    rectangle = np.array([[1, 1, 1, 1], [1, 1, -1, -1], [1, -1, -1, 1]]).T
    signals = np.concatenate([rectangle @ [steps(seed + i) for i in range(3)] for seed in (1, 4)])
    noise = 0.05 * np.random.default_rng(0).standard_normal(signals.shape)
    names = [f"t{i}" for i in range(8)]
    found = dependence(centred(*(signals + noise)), names)
    words = [one.words for one in found.combinations]
    assert "t0 - t1 + t2 - t3" in words
    assert "t4 - t5 + t6 - t7" in words
    assert len(words) == 2
    for one in found.combinations:
        assert one.strength < 0.05  # noise of 0.05 beside signals of about ten


@given(st.lists(st.floats(1e-3, 1e3), min_size=3, max_size=3), st.integers(0, 50))
def test_law_units_of_the_signals_do_not_matter(sizes: list[float], seed: int) -> None:
    signals = centred(steps(seed), steps(seed + 1), steps(seed) + 0.3 * steps(seed + 2))
    found = dependence(signals * sizes, ["a", "b", "c"], weak=1e-9)
    # Rounding of a product and of a quotient by the same number.
    np.testing.assert_allclose(
        found.singular_values, dependence(signals, ["a", "b", "c"]).singular_values, rtol=1e-9
    )


def test_thrusters_driven_one_by_one_have_gains_of_their_own(tmp_path: Path) -> None:
    found = judge_inputs(campaign(tmp_path, {"cmd.port": steps(1), "cmd.starboard": steps(2)}).problem())
    assert found.thrusts.lost == 0
    assert found.offered == ("port.gain", "starboard.gain")
    assert [option.told_apart for option in found.options if option.kind == "single"] == [True]


def test_thrusters_driven_together_have_one_gain(tmp_path: Path) -> None:
    columns = {"cmd.port": steps(1), "cmd.starboard": steps(1)}
    found = judge_inputs(campaign(tmp_path, columns, coefficients='"port.gain" = [0.5, 2.0]').problem())
    assert found.offered == ("main.gain", "main.astern_ratio")
    assert found.freed == ("port.gain",)
    assert found.rows.still == ("Y", "Z", "K", "M", "N")
    assert "port, starboard move only together: +1 +1" in str(found)
    assert 'The campaign frees "port.gain" one by one' in str(found)


def test_a_group_that_is_freed_as_one_is_no_complaint(tmp_path: Path) -> None:
    columns = {"cmd.port": steps(1), "cmd.starboard": steps(1)}
    assert (
        judge_inputs(campaign(tmp_path, columns, coefficients='"main.gain" = [0.5, 2.0]').problem()).freed
        == ()
    )


def test_opposite_thrusters_drive_yaw_alone(tmp_path: Path) -> None:
    found = judge_inputs(campaign(tmp_path, {"cmd.port": steps(1), "cmd.starboard": -steps(1)}).problem())
    assert "X" in found.rows.still
    axis = next(option for option in found.options if option.kind == "axis")
    assert axis.names == ("main.lever_N",)


def test_what_is_held_out_excites_nothing(tmp_path: Path) -> None:
    together = np.where(T < 30.0, steps(1), steps(2))
    columns = {"cmd.port": steps(1), "cmd.starboard": together}
    assert judge_inputs(campaign(tmp_path, columns).problem()).thrusts.lost == 0
    held = campaign(tmp_path, columns, trial="hold_out_s = [[30.0, 60.0]]")
    assert judge_inputs(held.problem()).thrusts.lost == 1


def test_an_actuator_that_never_moves_is_named(tmp_path: Path) -> None:
    found = judge_inputs(
        campaign(tmp_path, {"cmd.port": steps(1), "cmd.starboard": np.full(len(T), 3.0)}).problem()
    )
    # The motor runs up from rest at the beginning: 2 s of 60.
    assert found.drives[1].rms_n < 0.2 * found.drives[0].rms_n
    quiet = judge_inputs(campaign(tmp_path, {"cmd.port": steps(1), "cmd.starboard": 0.0 * T}).problem())
    assert quiet.thrusts.still == ("starboard",)
    assert "The thrust of starboard hardly changes" in str(quiet)


def test_a_fin_that_never_moves_has_a_lift_not_a_thrust(tmp_path: Path) -> None:
    columns = {"cmd.port": steps(1), "cmd.starboard": 0.0 * T, "cmd.rudder": 0.0 * T}
    said = judge_inputs(campaign(tmp_path, columns, vehicle=TWIN + RUDDER).problem()).sentences()
    assert "The thrust of starboard hardly changes" in said
    assert "The lift of rudder hardly changes" in said


def test_a_fin_lifts_at_the_speed_of_the_trial(tmp_path: Path) -> None:
    columns = {"cmd.port": steps(1), "cmd.starboard": steps(2), "cmd.rudder": 0.01 * steps(3)}
    found = judge_inputs(campaign(tmp_path, columns, vehicle=TWIN + RUDDER, free="XN").problem())
    assert found.thrusts.still == ()
    assert {"Y", "N"}.isdisjoint(found.rows.still)
    # Aspect ratio 2: C_L = 2 pi / 2 per rad or less of rho/2 u^2 A at the mean square of sin, a half.
    thin = math.pi * 0.5 * 1000.0 * 0.5 * 0.02
    deflection = float(np.std(columns["cmd.rudder"]))
    assert 0.3 * thin * deflection < found.drives[2].rms_n < 1.1 * thin * deflection
    slow = {"u_m_s": 0.5 * np.sin(0.1 * T)}
    quarter = judge_inputs(campaign(tmp_path, columns | slow, vehicle=TWIN + RUDDER, free="XN").problem())
    assert quarter.drives[2].rms_n == pytest.approx(0.25 * found.drives[2].rms_n, rel=1e-6)


def test_the_scale_rests_on_the_lift_of_a_fin(tmp_path: Path) -> None:
    columns = {"cmd.port": steps(1), "cmd.starboard": steps(2), "cmd.rudder": 0.01 * steps(3)}
    text = '"main.gain" = [0.5, 2.0]'
    found = homogeneity(
        campaign(tmp_path, columns, vehicle=TWIN + RUDDER, coefficients=text, free="XN").problem()
    )
    assert "The scale rests on the lift of rudder as in the vehicle file" in found.sentences()
    found = homogeneity(campaign(tmp_path, columns, vehicle=TWIN + RUDDER, free="XN").problem())
    assert "The scale rests on the thrust of main as in the vehicle file" in found.sentences()
    assert "values: lift of rudder" in " ".join(found.sentences())


def test_the_thrust_is_that_behind_the_motor(tmp_path: Path) -> None:
    columns = {"cmd.port": steps(1), "cmd.starboard": steps(2)}
    lagged = judge_inputs(campaign(tmp_path, columns).problem())
    assert lagged.drives[0].rms_n < 0.9 * float(np.std(steps(1)))
    measured = {"meas.port": steps(1), "meas.starboard": steps(2)}
    direct = judge_inputs(campaign(tmp_path, columns | measured, top='input = "measured"').problem())
    # A measured signal is thrust at once; a sample at the start is behind the motor's first step.
    assert direct.drives[0].rms_n == pytest.approx(float(np.std(steps(1))), rel=0.01)


def test_of_a_logged_wrench_only_the_rows_are_judged(tmp_path: Path) -> None:
    zero = 0.0 * T
    columns = {"tau.X_n": steps(1), "tau.N_nm": 0.5 * steps(1)}
    columns |= {"tau.Y_n": zero, "tau.Z_n": zero, "tau.K_nm": zero, "tau.M_nm": zero}
    found = judge_inputs(campaign(tmp_path, columns, top='input = "tau"').problem())
    assert found.drives == ()
    assert found.offered == ()
    assert found.rows_rms["X"] == pytest.approx(float(np.std(steps(1))), rel=1e-9)
    assert "X and N of the wrench move only together" in str(found)


def test_a_reaction_torque_is_no_thrust() -> None:
    vehicle = Vehicle.load(Path(__file__).parents[1] / "core" / "every_term.toml")
    column = np.asarray(vehicle.allocation_matrix())[:, 0]
    torque = np.array([0.0, 0.0, 0.0, 2.0, -0.2, 0.4])
    each = np.zeros((1, len(vehicle.actuators), 6))
    each[0, 0] = 5.0 * column + torque
    assert thrusts(vehicle, each)[0] == pytest.approx([5.0, *[0.0] * (len(vehicle.actuators) - 1)])


@pytest.fixture(scope="module")
def cwolf() -> Campaign:
    return Campaign.load(EXAMPLES / "cwolf" / "campaign.toml")


@pytest.mark.long
def test_cwolf_is_told_per_group_and_direction(cwolf: Campaign) -> None:
    found = judge_inputs(cwolf.problem())
    assert cwolf.problem().trained == ("surge", "dive", "turn", "dive_stern", "roll")
    words = {one.words for one in found.thrusts.combinations}
    # Ahead together, sides apart, levels apart, never crosswise; both verticals always alike.
    assert words == {"SbU - SbL - PU + PL", "VTB - VTS"}
    # 2 % of the stern propellers' impulse is astern, 31 % of the verticals'.
    assert found.offered == ("stern.p1_ahead", "vertical.p1_ahead", "vertical.p1_astern")
    assert found.freed == ()
    assert found.rows.still == ("K",)
    # Canted propellers push sideways only as they turn (docs/theory/allocation.md).
    assert "Y and N of the wrench move only together" in str(found)


@pytest.mark.long
def test_check_of_a_campaign_judges_inputs_and_scale(cwolf: Campaign) -> None:
    found = check_campaign(cwolf)
    data: dict[str, Any] = json.loads(json.dumps(found.to_dict()))
    assert data["problems"] == []
    assert data["inputs"]["offered"][0] == "stern.p1_ahead"
    said = "\n".join(data["scale"]["sentences"])
    assert "The scale rests on the thrust of SbL, vertical" in said
    assert "The bench test measured the thrust of stern, vertical" in said


@pytest.mark.long
@pytest.mark.skipif(not DATA.is_dir(), reason="Beluga's recordings are not here; set SEATRIAL_DATA")
def test_eight_gains_of_beluga_cannot_be_told_apart() -> None:
    found = judge_inputs(Campaign.load(EXAMPLES / "beluga" / "campaign.toml").problem())
    # The allocator serves six axes with eight thrusters. Found .38 and .008, by dead band and table.
    assert found.thrusts.singular_values[5] > 0.2
    assert found.thrusts.singular_values[6] < 0.03
    assert {one.words for one in found.thrusts.combinations} == {
        "thruster_0 - thruster_3 - thruster_4 + thruster_7",
        "thruster_1 - thruster_2 + thruster_5 - thruster_6",
    }
    keys = ("gain", "astern_ratio")
    assert found.offered == tuple(f"{group}.{key}" for group in ("horizontal", "vertical") for key in keys)
    assert found.freed == tuple(f"thruster_{k}.gain" for k in (1, 2, 5, 6))
    axis = next(option for option in found.options if option.kind == "axis")
    assert axis.told_apart
    assert axis.names[2:] == ("vertical.lever_K", "vertical.lever_M", "horizontal.lever_N")
