"""Manoeuvres: actuator combinations, commands within limits, signals that come back, forecasts that warn."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from seatrial import TrialError, Vehicle, VehicleError
from seatrial.base.channels import AXES
from seatrial.experiment import manoeuvre as shapes
from seatrial.experiment.combinations import AHEAD, Thrusters
from seatrial.experiment.forecast import Limits, Proposal, forecast, proposals, simulated, uneven
from seatrial.experiment.manoeuvre import (
    Manoeuvre,
    Start,
    dive,
    free_decay,
    multisine,
    spiral,
    staircase,
    steady_speed,
    zigzag,
)
from seatrial.trial.trial import Trial
from seatrial.vehicle.actuators import bollard, largest

STARTER = Path(__file__).parents[2] / "python" / "seatrial" / "examples" / "starter" / "vehicle.toml"
VEHICLES = {name: Vehicle.load(name) for name in ("cwolf", "beluga")} | {"starter": Vehicle.load(STARTER)}
CWOLF = VEHICLES["cwolf"]
THRUSTERS = Thrusters(CWOLF)
BUDGET_S = 60.0

SAILOR = """
format = 1
name = "{name}"
[coefficients]
m = 50.0
B = 490.5
z_b = -0.02
I_x = 1.0
I_y = 10.0
I_z = 10.0
X_u = -10.0
Y_v = -10.0
Z_w = -10.0
K_p = -1.0
M_q = -5.0
N_r = -5.0
"""


@pytest.fixture(scope="module", params=list(VEHICLES))
def proposed(request: pytest.FixtureRequest) -> tuple[Vehicle, list[Proposal]]:
    vehicle = VEHICLES[request.param]
    found, _ = proposals(vehicle, duration_s=BUDGET_S)
    return vehicle, found


@pytest.mark.long
def test_the_whole_repertoire_is_proposed(proposed: tuple[Vehicle, list[Proposal]]) -> None:
    kinds = {proposal.manoeuvre.kind for proposal in proposed[1]}
    assert kinds == {"staircase", "coast-down", "zigzag", "spiral", "dive", "free decay", "multisine"}


def test_commands_stay_within_the_motors_limits(proposed: tuple[Vehicle, list[Proposal]]) -> None:
    vehicle, found = proposed
    facts = vehicle.actuator_info()
    for proposal in found:
        assert list(proposal.manoeuvre.commands) == vehicle.actuators
        for name, values in proposal.manoeuvre.commands.items():
            away = np.asarray(values) - facts[name]["neutral"]
            away *= -1.0 if facts[name]["reversed"] else 1.0
            # Commands are rounded to a tenth of an rpm or us.
            assert -largest(facts[name], -1.0) - 0.05 <= away.min(), proposal.manoeuvre.name
            assert away.max() <= largest(facts[name], 1.0) + 0.05, proposal.manoeuvre.name


@pytest.mark.long
def test_proposals_have_the_right_lengths_and_fit_their_time(
    proposed: tuple[Vehicle, list[Proposal]],
) -> None:
    for proposal in proposed[1]:
        one = proposal.manoeuvre
        assert np.allclose(np.diff(one.t), one.dt)
        assert all(len(values) == len(one.t) for values in one.commands.values())
        times = one.repeats(BUDGET_S)
        assert times >= 1
        # Durations are rounded to a sample of 0.1 s.
        assert times * one.duration_s + (times - 1) * one.pause_s <= BUDGET_S + 0.1 * times, one.name


def test_proposals_begin_and_end_with_nothing_but_the_trim(proposed: tuple[Vehicle, list[Proposal]]) -> None:
    vehicle, found = proposed
    thrusters = Thrusters(vehicle)
    trim = thrusters.commands(thrusters.trim()[None])
    for proposal in found:
        one = proposal.manoeuvre
        if one.kind == "free decay" or "ahead" in one.words.split(";")[0]:
            continue  # motors stopped, or kept ahead
        for name, values in one.commands.items():
            assert values[0] == values[-1] == trim[name][0], one.name


@pytest.mark.long
def test_what_is_proposed_keeps_within_the_limits() -> None:
    limits = Limits(depth_m=12.0, area_m=(40.0, 60.0), tilt_deg=40.0)
    found, refused = proposals(CWOLF, duration_s=BUDGET_S, limits=limits)
    assert found
    for proposal in found:
        seen = proposal.forecast
        assert seen.excess is None
        assert seen.deepest_m <= 12.0
        assert max(seen.along_m, seen.across_m) <= 60.0
        assert min(seen.along_m, seen.across_m) <= 40.0
        assert max(seen.roll_deg, seen.pitch_deg) <= 40.0
    # A room in which nothing under way fits, at any amplitude.
    small, refused = proposals(CWOLF, duration_s=BUDGET_S, limits=Limits(area_m=(12.0, 12.0)))
    assert not any("half ahead" in proposal.manoeuvre.name for proposal in small)
    assert refused["zigzag yaw, half ahead"].startswith("it needs")


@pytest.mark.parametrize("name", VEHICLES)
def test_a_drive_pushes_its_axis_and_what_the_group_can_of_nothing_else(name: str) -> None:
    vehicle = VEHICLES[name]
    thrusters = Thrusters(vehicle)
    assert {combination.axis for combination in thrusters.combinations} == set(vehicle.controllable)
    matrix = np.asarray(vehicle.allocation_matrix())
    for combination in thrusters.combinations:
        wrench = matrix @ np.array(combination.thrusts)
        assert wrench[AXES.index(combination.axis)] == pytest.approx(1.0)
    for axis in vehicle.controllable:
        best = thrusters.combinations_of(axis)[0]
        wrench = matrix @ np.array(best.thrusts)
        others = [AXES.index(row) for row in vehicle.controllable if row != axis]
        # What all rows are controllable for can be pushed alone; 0.03: thrusters' directions in three digits.
        assert np.abs(wrench[others]).max() < 0.03, (axis, best.group)


def test_stern_and_vertical_propellers_both_pitch_cwolf() -> None:
    assert {combination.group for combination in THRUSTERS.combinations_of("M")} == {"stern", "vertical"}
    assert [combination.group for combination in THRUSTERS.combinations_of("N")] == ["stern"]


@pytest.mark.parametrize("name", VEHICLES)
def test_commands_invert_the_characteristic(name: str) -> None:
    vehicle = VEHICLES[name]
    thrusters = Thrusters(vehicle)
    for share in (0.8, 0.3, -0.5):
        wanted = np.where(share > 0, share * thrusters.upper, -share * thrusters.lower)
        commands = {key: float(values[0]) for key, values in thrusters.commands(wanted[None]).items()}
        pushed = bollard(vehicle, commands)
        expected = np.asarray(vehicle.allocation_matrix()) @ wanted
        # The characteristic is interpolated at a hundred points a side.
        assert pushed == pytest.approx(expected, abs=0.002 * float(np.abs(thrusters.upper).sum()))


@pytest.mark.parametrize("name", ["cwolf", "beluga", "starter"])
def test_the_trim_carries_the_net_weight(name: str) -> None:
    vehicle = VEHICLES[name]
    thrusters = Thrusters(vehicle)
    t = np.arange(0.0, 60.0, 0.1)
    held = thrusters.commands(np.tile(thrusters.trim(), (len(t), 1)))
    drifted = simulated(vehicle, Manoeuvre("trim", "commands", "", t, held))
    loose = {key: np.full(len(t), vehicle.actuator_info()[key]["neutral"]) for key in held}
    free = simulated(vehicle, Manoeuvre("none", "commands", "", t, loose))
    # Beluga's centres do not lie above one another: it trims a little, and its thrust is askew.
    assert abs(drifted.position[-1, 2]) < 0.1 * abs(free.position[-1, 2])


def test_a_vehicle_without_heave_thrusters_is_not_trimmed() -> None:
    text = SAILOR.format(name="sailor") + (
        '[characteristics.direct]\nkind = "direct"\n[[thrusters]]\nname = "screw"\n'
        'command = "N"\nposition_m = [-1.0, 0.0, 0.0]\n'
        'direction = [1.0, 0.0, 0.0]\ncharacteristic = "direct"\n'
    )
    vehicle = Vehicle.from_toml(text)
    thrusters = Thrusters(vehicle)
    assert [combination.motion for combination in thrusters.combinations] == ["surge"]
    assert not thrusters.trim().any()
    found, _ = proposals(vehicle, duration_s=30.0)
    kinds = {proposal.manoeuvre.kind for proposal in found}
    assert kinds == {"staircase", "coast-down", "multisine", "free decay"}


def test_a_vehicle_without_actuators_can_still_be_let_go() -> None:
    found, refused = proposals(Vehicle.from_toml(SAILOR.format(name="hulk")), duration_s=60.0)
    assert {proposal.manoeuvre.name for proposal in found} == {
        "free decay of roll, 30 deg",
        "free decay of pitch, 30 deg",
    }
    assert not refused


@pytest.mark.parametrize("duration_s", [20.0, 60.0, 97.3, 180.0, 600.0])
def test_shapes_stay_between_minus_one_and_one_and_come_back(duration_s: float) -> None:
    t = np.arange(0.0, duration_s + 0.05, 0.1)
    for levels in (
        shapes.staircase_levels(t, duration_s),
        shapes.coast_down_levels(t, duration_s),
        shapes.zigzag_levels(t, duration_s, switch_s=10.0),
        shapes.spiral_levels(t, duration_s),
    ):
        assert levels[-1] == 0.0
        assert levels.max() == 1.0
        assert levels.min() == -1.0
        # Each level as long in one sense as in the other: a sample at every switch may fall to either side.
        switches = int((np.diff(levels) != 0.0).sum())
        assert abs(levels.sum()) <= switches
    assert shapes.staircase_levels(t, duration_s, both=False).min() == 0.0
    assert shapes.coast_down_levels(t, duration_s, both=False).min() == 0.0


def test_a_staircase_holds_every_step_as_long() -> None:
    t = np.arange(0.0, 90.0, 0.1)
    levels = shapes.staircase_levels(t, 90.0, steps=4)
    _, counts = np.unique(levels, return_counts=True)
    edges = np.flatnonzero(np.diff(levels))
    assert np.unique(levels) == pytest.approx([-1.0, -0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0])
    # 90 s in eleven parts of 81.8 samples; three of them at zero, the first, the middle and the last.
    assert sorted(counts) == pytest.approx([82.0] * 8 + [245.0], abs=1.0)
    assert np.diff(edges) == pytest.approx(np.full(len(edges) - 1, 81.8), abs=1.0)


def test_a_spiral_turns_tighter_and_then_the_other_way() -> None:
    levels = shapes.spiral_levels(np.arange(0.0, 70.0, 0.1), 70.0, steps=3)
    steps = [levels[0], *(b for a, b in pairwise(levels) if b != a)]
    assert steps == pytest.approx([0.0, 1 / 3, 2 / 3, 1.0, -1 / 3, -2 / 3, -1.0])


@pytest.mark.parametrize("duration_s", [30.0, 60.0, 180.0, 600.0])
@pytest.mark.parametrize("of", [1, 2, 4, 6])
def test_multisines_have_a_low_crest_their_band_and_nothing_in_common(duration_s: float, of: int) -> None:
    t = np.arange(0.0, duration_s - 0.05, 0.1)
    signals = [shapes.multisine_levels(t, duration_s, of=of, index=index) for index in range(of)]
    for signal in signals:
        # The levels are searched on a finer grid than the samples, so the peak may lie between two of them.
        assert 0.98 < np.abs(signal).max() <= 1.0 + 1e-9
        # A sine has 1.41; random phases give 2.5 to 3.5.
        assert np.abs(signal).max() / np.sqrt(np.mean(signal**2)) < 2.1
        spectrum = np.abs(np.fft.rfft(signal)) / len(signal)
        frequency = np.fft.rfftfreq(len(signal), 0.1)
        highest = max(0.25, (np.ceil(0.02 * duration_s) + 2 * of) / duration_s)
        outside = (frequency < 0.02 - 1e-9) | (frequency > highest + 1e-9)
        # Whole periods: outside of the band there is rounding only.
        assert spectrum[outside].max() < 1e-12
    correlation = np.corrcoef(signals) if of > 1 else np.eye(1)
    assert np.abs(correlation - np.eye(of)).max() < 1e-12  # different harmonics are orthogonal


def test_two_sided_manoeuvres_push_as_hard_both_ways() -> None:
    yaw, heave = THRUSTERS.combinations_of("N")[0], THRUSTERS.combinations_of("Z")[0]
    turned = zigzag(THRUSTERS, yaw, duration_s=80.0, ahead="half", amplitude=0.6)
    port, starboard = turned.commands["PU"], turned.commands["SbU"]
    middle = len(turned.t) // 2
    assert not np.allclose(port[middle], starboard[middle])
    # Thrust to one side is that to the other mirrored: the propellers swap their commands.
    assert {float(x) for x in port} == {float(x) for x in starboard}
    dived = dive(THRUSTERS, heave, duration_s=80.0, amplitude=0.5)
    wrench = [bollard(CWOLF, {name: float(y[k]) for name, y in dived.commands.items()})[2] for k in (60, 200)]
    trim = float(THRUSTERS.trim().sum())
    # Down and up alike about the trim; the inverse characteristic is good to 0.1 N.
    assert sum(wrench) / 2 == pytest.approx(trim, abs=0.1)


def test_all_axes_at_once_share_the_motors() -> None:
    combinations = [THRUSTERS.combinations_of(axis)[0] for axis in "XZMN"]
    for ahead in (None, *AHEAD):
        one = multisine(THRUSTERS, combinations, duration_s=60.0, ahead=ahead, amplitude=1.0)
        assert max(float(np.abs(values).max()) for values in one.commands.values()) <= 2000.0


def test_under_way_means_the_speed_of_the_thrust_ahead() -> None:
    speeds = {word: steady_speed(THRUSTERS, THRUSTERS.ahead(word)) for word in AHEAD}
    assert speeds["slow"] < speeds["half"] < speeds["full"]
    decay = free_decay(THRUSTERS, "K", duration_s=15.0, angle_deg=25.0, ahead="half")
    run = simulated(CWOLF, decay)
    assert run.nu[0, 0] == pytest.approx(speeds["half"], rel=0.01)  # with the trim on top
    assert run.nu[-1, 0] == pytest.approx(speeds["half"], rel=0.05)
    assert np.rad2deg(run.euler[0, 0]) == pytest.approx(25.0)


def test_a_free_decay_says_what_it_takes_and_dies_away() -> None:
    roll = free_decay(THRUSTERS, "K", duration_s=15.0, angle_deg=30.0)
    # B |z_b| sin 30 deg = 1329.35 * 0.02 * 0.5 = 13.3 N m
    assert "heeled to starboard by 30 deg (13 N m)" in roll.start.words
    assert all(not np.any(values) for values in roll.commands.values())
    euler = np.rad2deg(simulated(CWOLF, roll).euler)
    assert np.abs(euler[-20:, 0]).max() < 6.0
    pitch = free_decay(THRUSTERS, "M", duration_s=60.0, angle_deg=20.0)
    assert np.rad2deg(simulated(CWOLF, pitch).euler[0, 1]) == pytest.approx(20.0)
    rise = simulated(CWOLF, free_decay(THRUSTERS, "Z", duration_s=40.0))
    assert rise.position[-1, 2] < -1.0  # CWolf is 5 N buoyant


def test_the_forecast_is_deep_and_wide_enough_for_both_runs() -> None:
    yaw = THRUSTERS.combinations_of("N")[0]
    turning = spiral(THRUSTERS, yaw, duration_s=60.0, ahead="half")
    other = uneven(CWOLF)
    seen = forecast(turning, CWOLF, other)
    position = np.asarray(simulated(CWOLF, turning).position)
    assert seen.along_m >= np.ptp(position[:, 0]) + 2.5  # the hull's length on top
    assert seen.across_m >= np.ptp(position[:, 1]) + 2.5
    # Least depth: two diameters of 0.3 m below the surface at the highest point.
    assert seen.start_depth_m + position[:, 2].min() >= 0.6
    assert seen.deepest_m >= seen.start_depth_m + position[:, 2].max()
    assert seen.excess is None


def test_a_long_straight_run_warns_that_nothing_steers() -> None:
    surge = THRUSTERS.combinations_of("X")[0]
    straight = staircase(THRUSTERS, surge, duration_s=120.0, both=False)
    seen = forecast(straight, CWOLF, uneven(CWOLF), limits=Limits(area_m=(100.0, 100.0)))
    assert any("open loop: thrust 3 % uneven" in warning for warning in seen.warnings)
    assert seen.excess is not None
    assert seen.excess.startswith("it needs")


def test_the_forecast_warns_of_tilt_and_of_work_by_hand() -> None:
    steep = free_decay(THRUSTERS, "M", duration_s=60.0, angle_deg=55.0)
    seen = forecast(steep, CWOLF, uneven(CWOLF), limits=Limits(tilt_deg=50.0))
    assert any(warning.startswith("trim above 45 deg") for warning in seen.warnings)
    assert any(warning.startswith("hands or lines") for warning in seen.warnings)
    assert seen.excess == "it tilts by 56 deg"
    rise = free_decay(THRUSTERS, "Z", duration_s=40.0)
    deep = forecast(rise, CWOLF, uneven(CWOLF), limits=Limits(depth_m=1.0))
    assert deep.excess is not None
    assert "of depth" in deep.excess


def test_a_heavy_vehicle_is_not_tilted_by_hand() -> None:
    heavy = CWOLF.with_coefficients({"z_b": -0.2})
    decay = free_decay(Thrusters(heavy), "K", duration_s=15.0, angle_deg=30.0)
    seen = forecast(decay, heavy, uneven(heavy))
    assert any("133 N m: a line to a boat or shifted ballast" in warning for warning in seen.warnings)


def test_what_diverges_does_not_fit() -> None:
    wild = CWOLF.with_coefficients({"Y_v": 1e5})
    yaw = Thrusters(wild).combinations_of("N")[0]
    seen = forecast(zigzag(Thrusters(wild), yaw, duration_s=30.0), wild, uneven(wild))
    assert seen.excess == "the simulation diverges"


def test_repeats_count_the_pauses_between() -> None:
    t = np.arange(0.0, 30.05, 0.1)
    one = Manoeuvre("rest", "commands", "nothing", t, {}, Start(), pause_s=15.0)
    assert [one.repeats(budget) for budget in (29.0, 30.0, 74.0, 75.0, 120.0)] == [0, 1, 1, 2, 3]


def test_the_command_file_reads_back(tmp_path: Path) -> None:
    one = zigzag(THRUSTERS, THRUSTERS.combinations_of("N")[0], duration_s=40.0)
    one.write_csv(tmp_path / "zigzag.csv")
    assert (tmp_path / "zigzag.csv").read_text().startswith("t_s,cmd.SbU,")
    trial = Trial.read(tmp_path / "zigzag.csv", align=False)
    assert trial.t == pytest.approx(one.t)
    for name, values in one.commands.items():
        assert trial.commands[name] == pytest.approx(values)
    with pytest.raises(TrialError, match="cannot be written"):
        one.write_csv(tmp_path / "nowhere" / "zigzag.csv")


def test_what_cannot_be_sailed_is_refused() -> None:
    surge = THRUSTERS.combinations_of("X")[0]
    with pytest.raises(VehicleError, match="at least one second"):
        staircase(THRUSTERS, surge, duration_s=0.0)
    with pytest.raises(VehicleError, match=r"expected an amplitude above 0 and up to 1, found 1\.2"):
        staircase(THRUSTERS, surge, duration_s=60.0, amplitude=1.2)
    with pytest.raises(VehicleError, match="expected one of slow, half, full"):
        zigzag(THRUSTERS, THRUSTERS.combinations_of("N")[0], duration_s=60.0, ahead="flank")
    with pytest.raises(VehicleError, match="expected axis K"):
        free_decay(THRUSTERS, "X", duration_s=30.0)
    hulk = Thrusters(Vehicle.from_toml(SAILOR.format(name="hulk")))
    with pytest.raises(VehicleError, match="nothing drives this vehicle ahead"):
        free_decay(hulk, "K", duration_s=30.0, ahead="half")
    with pytest.raises(VehicleError, match="positive depth"):
        Limits(depth_m=-1.0)
    with pytest.raises(VehicleError, match="two positive lengths"):
        Limits(area_m=(10.0, 0.0))


@pytest.mark.parametrize("name", ["remus100", "lauv"])
def test_fins_move_under_way_and_rest_at_rest(name: str) -> None:
    vehicle = Vehicle.load(name)
    thrusters, facts = Thrusters(vehicle), vehicle.actuator_info()
    [yaw] = thrusters.combinations_of("N")
    assert yaw.needs_way
    assert not any(one.needs_way for one in thrusters.drivers)
    # Half of the largest force, and so about half of the angle at which the fin stalls, at any speed.
    turning = zigzag(thrusters, yaw, duration_s=60.0, ahead="half", amplitude=0.5)
    rudder = np.asarray(turning.commands["rudder_upper"])
    assert 0.35 < np.abs(rudder).max() / largest(facts["rudder_upper"], 1.0) < 0.55
    assert "50 % of the fins' force" in turning.words
    nu = np.asarray(simulated(vehicle, turning).nu)
    assert np.ptp(np.rad2deg(nu[:, 5])) > 2.0
    found, refused = proposals(vehicle, duration_s=60.0)
    moving = [one.manoeuvre for one in found if one.manoeuvre.kind != "free decay"]
    for one in moving:
        assert any(np.ptp(values) > 0.0 for values in one.commands.values()), one.name
    assert not any("yaw" in one and "ahead" not in one for one in [*refused, *(one.name for one in moving)])
    fins = [one for one in moving if any(np.ptp(one.commands[fin]) > 0.0 for fin in facts if "rudder" in fin)]
    assert {one.kind for one in fins} >= {"zigzag", "spiral", "multisine"}
