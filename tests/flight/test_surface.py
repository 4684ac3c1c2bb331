"""The sea's surface: vehicles stay in the water, tangents at it, and where it counts."""

from __future__ import annotations

import numpy as np
import pytest

import seatrial as st
from seatrial.base.errors import DivergenceError, SimulationError, TrialError
from seatrial.realtime.plant import Plant

ROV = """format = 1
name = "rov"
[geometry]
shape = "box"
length_m = 0.6
diameter_m = 0.4
height_m = 0.3
[coefficients]
m = 20.0
B = 198.0
I_x = 0.5
I_y = 0.9
I_z = 0.9
z_g = 0.03
X_udot = -6.0
Y_vdot = -12.0
Z_wdot = -16.0
K_pdot = -0.2
M_qdot = -0.3
N_rdot = -0.3
X_u = -4.0
X_uu = -20.0
Y_vv = -40.0
Z_ww = -50.0
K_p = -0.5
M_q = -0.5
N_r = -0.5
Y_v = 0.0
Z_w = 0.0
K_pp = 0.0
M_qq = 0.0
N_rr = 0.0
[characteristics.direct]
kind = "direct"
"""

_THRUSTER = """
[[thrusters]]
name = "{name}"
command = "N"
position_m = [{x}, {y}, 0.0]
direction = [0.0, 0.0, 1.0]
characteristic = "direct"
"""

SIDES = {"fl": (0.2, -0.15), "fr": (0.2, 0.15), "bl": (-0.2, -0.15), "br": (-0.2, 0.15)}


def rov(changed: str = "") -> st.Vehicle:
    """A box of an ROV with four vertical thrusters."""
    thrusters = "".join(_THRUSTER.format(name=name, x=x, y=y) for name, (x, y) in SIDES.items())
    return st.Vehicle.from_toml(ROV + thrusters + changed)


def test_a_vehicle_that_pushes_up_stays_in_the_water() -> None:
    """160 N upwards, four fifths of the weight: it flew hundreds of metres high."""
    t = np.arange(0.0, 60.0, 0.1)
    start = st.State(position=[0.0, 0.0, 5.0])
    up = dict.fromkeys(SIDES, -40.0)
    free = rov().simulate(t, up, start)
    bounded = rov().simulate(t, up, start, surface=0.0)
    assert free.position[-1, 2] < -50.0
    # It leaps, and bobs where its thrusters draw air: hubs half a radius above the surface push nothing.
    assert bounded.position[:, 2].min() > -0.8
    late = bounded.position[t > 40.0, 2]
    assert np.ptp(late) < 0.3
    assert -0.15 < late.mean() < 0.15


@pytest.mark.parametrize("name", ["cwolf", "bluerov2-heavy", "remus100", "lauv", "beluga"])
def test_built_in_vehicles_float_where_they_are_let_go(name: str) -> None:
    vehicle = st.Vehicle.load(name)
    depth = vehicle.floating_depth()
    t = np.arange(0.0, 20.0, 0.1)
    run = vehicle.simulate(t, initial=st.State(position=[0, 0, depth]), surface=0.0, voltage_v=16.0)
    c, g = vehicle.coefficients(), vehicle.environment()["g"]
    if c["m"] * g > c["B"]:
        assert run.position[-1, 2] > depth  # too heavy: it sinks
    else:
        assert abs(run.position[-1, 2] - depth) < 0.03
        afloat = vehicle.forces(np.zeros(6), [0.0, 0.0, 0.0], depth=depth)["restoring"]
        # The halving ends at rounding of the spline.
        assert abs(afloat[2]) < 1e-6 * c["m"] * g
    deep = vehicle.simulate(t, initial=st.State(position=[0, 0, 50.0]), surface=0.0, voltage_v=16.0)
    same = vehicle.simulate(t, initial=st.State(position=[0, 0, 50.0]), voltage_v=16.0)
    np.testing.assert_array_equal(deep.nu, same.nu)


@pytest.mark.parametrize("depth", [-0.1, 0.02, 0.12, 0.4])
def test_the_tangent_at_the_surface_is_that_of_difference_quotients(depth: float) -> None:
    vehicle = rov()
    nu, attitude = np.array([0.4, -0.1, 0.2, 0.05, -0.1, 0.2]), np.array([0.1, -0.2, 0.4])
    tau = np.array([5.0, 1.0, -3.0, 0.1, 0.2, 0.1])
    a, b = vehicle.linearize(nu, attitude, tau, form="euler", depth=depth)
    step = 1e-6
    columns = []
    for k in (2, 3, 4, *range(6, 12)):
        ends = []
        for sign in (1.0, -1.0):
            z, angles, moving = depth, attitude.copy(), nu.copy()
            if k == 2:
                z += sign * step
            elif k < 6:
                angles[k - 3] += sign * step
            else:
                moving[k - 6] += sign * step
            ends.append(vehicle.acceleration(moving, angles, tau, depth=z))
        columns.append((k, (ends[0] - ends[1]) / (2 * step)))
    for k, column in columns:
        # Differences of 2 um over a spline whose corners are millimetres wide.
        np.testing.assert_allclose(a[6:, k], column, rtol=1e-4, atol=1e-3, err_msg=str(k))
    more = vehicle.acceleration(nu, attitude, tau + np.eye(6)[2], depth=depth)
    less = vehicle.acceleration(nu, attitude, tau, depth=depth)
    np.testing.assert_allclose(b[6:, 2], more - less, rtol=1e-6, atol=1e-9)


def test_under_water_a_depth_changes_no_bit() -> None:
    vehicle = rov()
    nu, attitude, tau = np.full(6, 0.3), [0.1, 0.2, 0.3], np.ones(6)
    there = vehicle.acceleration(nu, attitude, tau, depth=3.0)
    np.testing.assert_array_equal(there, vehicle.acceleration(nu, attitude, tau))
    terms, deep = vehicle.forces(nu, attitude), vehicle.forces(nu, attitude, depth=3.0)
    for name, term in terms.items():
        np.testing.assert_array_equal(deep[name], term, err_msg=name)


def test_forces_at_the_surface_are_those_of_the_part_under_water() -> None:
    vehicle = rov()
    nu = np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    deep = vehicle.forces(nu, [0.0, 0.0, 0.0])
    half = vehicle.forces(nu, [0.0, 0.0, 0.0], depth=0.0)
    # O, the centre of buoyancy, is in the surface: half of an upright box is under water.
    np.testing.assert_allclose(half["damping"], 0.5 * deep["damping"], atol=1e-9)
    assert half["restoring"][2] == pytest.approx(20.0 * 9.81 - 99.0)
    air = vehicle.forces(nu, [0.0, 0.0, 0.0], depth=-1.0)
    assert not air["damping"].any()
    falling = vehicle.acceleration(np.zeros(6), [0.0, 0.0, 0.0], np.zeros(6), depth=-1.0)
    np.testing.assert_allclose(falling, [0, 0, 9.81, 0, 0, 0], atol=1e-12)


def test_a_box_rights_itself_by_its_waterplane() -> None:
    """W (BM - BG) sin(heel) of naval architecture, for a box that floats at half its height."""
    vehicle = rov().with_coefficients({"m": 10.0, "B": 196.2, "z_g": 0.0})
    width, height = 0.4, 0.3
    heel = 0.02
    moment = vehicle.forces(np.zeros(6), [heel, 0.0, 0.0], depth=0.0)["restoring"][3]
    # Seen from O in the middle: the centre of the wet half lies height/4 below, BM = width**2/12 / draught.
    gm = width**2 / 12.0 / (height / 2.0) - height / 4.0
    assert moment == pytest.approx(-10.0 * 9.81 * gm * np.sin(heel), rel=0.08)


def test_flights_begin_afloat_and_never_fly() -> None:
    mission = st.Mission.from_toml(
        'format = 1\nname = "up"\nspeed_m_s = 1.0\nacceptance_radius_m = 2.0\n'
        "[[legs]]\nnorth_m = 15.0\neast_m = 0.0\ndepth_m = 2.0\n"
        "[[legs]]\nnorth_m = 40.0\neast_m = 0.0\ndepth_m = 0.0\n"
    )
    flight = st.fly("cwolf", "cwolf", mission)
    assert flight.position[0, 2] == pytest.approx(st.Vehicle.load("cwolf").floating_depth())
    # A torpedo of 0.3 m: its middle stays under water, whatever guidance asks for.
    assert flight.position[:, 2].min() > -0.1


def test_a_gps_fix_needs_its_antenna_out_of_the_water() -> None:
    from seatrial.sensors.log import Surroundings, measure
    from seatrial.sensors.sensor import Sensor

    vehicle = rov()
    t = np.arange(0.0, 10.0, 0.1)
    top = float(vehicle.hull_top()[2])
    assert top == pytest.approx(-0.15)
    for depth, seen in ((0.1, True), (0.2, False)):
        run = vehicle.simulate(t, initial=st.State(position=[0, 0, depth]), free="X")
        log = measure(run, {"gps": Sensor(noise=0.1)}, seed=1, conditions=Surroundings(vehicle=vehicle))
        assert log["x_m"].is_finite().any() is seen


def test_a_stepped_vehicle_floats_too() -> None:
    plant = Plant(rov())
    assert plant.motion.position[2] == pytest.approx(rov().floating_depth())
    for _ in range(100):
        motion = plant.advance(dict.fromkeys(SIDES, -60.0), 0.05)
    assert -1.0 < motion.position[2] < 0.3


def test_a_trial_has_a_surface_where_its_datum_is_stated() -> None:
    """The same record in a frame of which nothing is known, and in one whose z is the depth."""
    truth = rov()
    t = np.arange(0.0, 12.0, 0.1)
    commands = {name: 8.0 * np.sin(0.9 * t) - 6.0 for name in SIDES}
    run = truth.simulate(t, commands, st.State(position=[0, 0, 0.3]), surface=0.0)
    columns = {
        "t_s": t,
        **{name: run.position[:, k] for k, name in enumerate(("x_m", "y_m", "z_m"))},
        **{name: np.rad2deg(run.euler[:, k]) for k, name in enumerate(("roll_deg", "pitch_deg", "yaw_deg"))},
        **{name: run.nu[:, k] for k, name in enumerate(("u_m_s", "v_m_s", "w_m_s"))},
        **{f"cmd.{name}": values for name, values in commands.items()},
    }
    assert run.position[:, 2].min() < 0.1
    stated = st.Trial.read(columns, align=False, level=False, surface=0.0)
    unknown = st.Trial.read(columns, align=False, level=False)
    assert st.score(truth, stated, ahead_s=4.0).r2["w"] > 0.999
    assert st.score(truth, unknown, ahead_s=4.0).r2["w"] < 0.97
    with pytest.raises(TrialError, match="surface: expected its coordinate"):
        st.Trial.read(columns, surface=np.nan)


def test_sensitivities_at_the_surface_are_difference_quotients() -> None:
    from seatrial._core import OpenLoop, Record

    vehicle = rov()
    t = np.arange(0.0, 3.0, 0.1)
    commands = {name: np.full(len(t), -12.0) for name in SIDES}
    record = Record(t, commands, observed=np.zeros((len(t), 12)), weight=np.ones((len(t), 12)), surface=0.0)
    names = ["m", "B", "Z_wdot", "Z_ww", "fl.gain"]
    start = ([0.0, 0.0, 0.25], [0.05, 0.02, 0.0], np.zeros(6))
    loop = OpenLoop(vehicle, [record], [(0, 0, len(t), *start)], names=names, substeps=5)
    values = np.array([vehicle.coefficients().get(name, 1.0) for name in names])
    channels = ["z", "pitch", "w"]
    [(_, partials)] = loop.sensitivities(values, channels=channels)
    columns = [8, 10, 2]  # of all twelve, velocities first
    for k in range(len(names)):
        step = 1e-5 * abs(values[k]) * np.eye(len(names))[k]
        [(more, _)], [(less, _)] = (loop.sensitivities(values + sign * step) for sign in (1, -1))
        quotient = ((np.asarray(more) - np.asarray(less)) / (2.0 * np.abs(step).max()))[:, columns]
        # Steps of 1e-5 over the corners of the spline.
        np.testing.assert_allclose(partials[..., k], quotient, rtol=5e-3, atol=5e-3 * np.abs(quotient).max())


def test_law_a_run_that_diverges_says_when_where_why_and_what_to_do() -> None:
    """Numbers that are no vehicle's: never returned, whatever the kind."""
    t = np.arange(0.0, 60.0, 0.1)
    moving = st.State(position=[0, 0, 20.0], nu=[1.0, 0.5, 0.5, 0.1, 0.1, 0.1])
    for name, axis in (("Z_ww", "heave"), ("X_uu", "surge"), ("N_r", "yaw"), ("Y_vv", "sway")):
        wrong = rov().with_coefficients({name: 30.0})
        with pytest.raises(
            DivergenceError, match=rf"rov: the motion diverged .* s after the start, in {axis}.*{name} = 30"
        ):
            wrong.simulate(t, initial=moving, free=name[0])
    heavy = st.Vehicle.load("bluerov2-heavy")
    coarse = np.arange(0.0, 100.0, 0.5)
    spin = st.State(position=[0, 0, 20.0], nu=[1.0, 0.5, 0.5, 1.0, 1.0, 1.0])
    up = dict.fromkeys(heavy.actuators, 1800.0)
    with pytest.raises(DivergenceError, match=r"steps of 0.5000 s are too long .* give max_step_s = "):
        heavy.simulate(coarse, up, spin, voltage_v=16.0, max_step_s=0.5)
    heavy.simulate(coarse, up, spin, voltage_v=16.0)
    assert issubclass(DivergenceError, SimulationError)


def test_a_wrench_without_end_is_told_from_a_wrong_sign() -> None:
    t = np.arange(0.0, 20.0, 0.1)
    undamped = rov().with_coefficients(dict.fromkeys(("X_u", "X_uu"), 0.0))
    with pytest.raises(DivergenceError, match="no damping has the wrong sign"):
        undamped.simulate(t, tau=[1e5, 0, 0, 0, 0, 0], free="X")
