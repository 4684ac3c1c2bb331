"""Start gains: every built-in vehicle gets an autopilot whose linear loops behave."""

from __future__ import annotations

import tomllib
from functools import cache

import numpy as np
import pytest

from seatrial._core import Vehicle
from seatrial.control_design.loops import (
    closed,
    law,
    plant,
    reference_drive,
    restoring_law,
    sampled,
    step_response,
    trim,
)
from seatrial.control_design.margins import least_margins
from seatrial.control_design.operating_points import flies, top_speeds
from seatrial.control_design.start_autopilot import (
    PATH_RAD_S,
    autopilot_text,
    commented,
    following_delay,
    guidance,
    heavy,
    least_lookahead,
    lookahead,
    safety,
    without_substitute,
)
from seatrial.control_design.start_autopilot import SETTINGS as START_GUIDANCE_SETTINGS
from seatrial.control_design.start_gains import StartGains, start_gains
from seatrial.vehicle.actuators import LOOPS, ROWS, delays
from seatrial.vehicle.steady_state import turning_radius

NAMES = ("cwolf", "remus100", "lauv", "bluerov2-heavy", "beluga")


@cache
def start(name: str) -> StartGains:
    return start_gains(Vehicle.load(name))


@cache
def start_text(name: str) -> str:
    return autopilot_text(Vehicle.load(name), start(name))


@pytest.mark.long
def test_modes_follow_from_the_rows() -> None:
    found = {name: [(mode.name, mode.depth_by) for mode in start(name).modes] for name in NAMES}
    both, by_heave = [("hover", "heave"), ("cruise", "pitch")], [("hover", "heave"), ("cruise", "heave")]
    alone = [("cruise", "pitch")]
    assert found == {
        "cwolf": both, "remus100": alone, "lauv": alone, "bluerov2-heavy": by_heave, "beluga": by_heave,
    }  # fmt: skip
    assert set(start("cwolf").loops) == {"surge", "heave", "pitch", "heading"}
    assert set(start("remus100").loops) == {"surge", "pitch", "heading"}
    assert set(start("beluga").loops) == set(LOOPS)
    # LAUV's fins could roll it, but slower than its own righting moment.
    assert "rights itself" in start("lauv").left_out["K"]


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_supporting_speeds_span_the_reachable_range(name: str) -> None:
    speeds, (astern, ahead) = start(name).speeds_m_s, top_speeds(Vehicle.load(name))
    assert np.all(np.diff(speeds) > 0.0)
    assert len(speeds) == 6
    assert speeds[-1] == pytest.approx(0.95 * ahead)
    if start(name).modes[0].name == "hover":
        assert speeds[0] == pytest.approx(0.95 * astern)
    else:
        assert trim(Vehicle.load(name), speeds[0], "XMN") is not None


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_law_every_loop_is_stable_and_overshoots_less_than_a_quarter(name: str) -> None:
    """All loops of a mode closed on the coupled motion behind lag and dead time, as it flies."""
    vehicle, values = Vehicle.load(name), start(name)
    tried = 0
    for k, speed in enumerate(values.speeds_m_s):
        for mode in values.modes:
            if not flies(mode, values.modes, speed) or any(
                f"{mode.name} at {speed:.2f}" in w for w in values.weak
            ):
                continue
            rows = "".join(ROWS[LOOPS.index(loop)] for loop in mode.loops)
            at = trim(vehicle, speed, rows, mode.actuators)
            assert at is not None
            system = sampled(
                plant(vehicle, at, mode.loops), delays(vehicle, rows), values.period_s, mode.loops
            )
            own = law({loop: values.loops[loop].gains[k] for loop in mode.loops}, speed)
            fed = own + restoring_law(vehicle, rows)
            assert least_margins(system, own).stable
            reached = least_margins(system, fed)
            assert reached.stable
            # Designed with half a period more of lag: the margin is at least what was asked for there.
            assert reached.phase_deg > 35.0
            if "pitch" in mode.loops and mode.depth_by == "pitch":
                row = LOOPS.index("pitch")
                known = float((fed - own)[row, 2])
                answer = step_response(system, fed, "pitch", 200.0, known=known)
                assert answer.max() < 1.25
            slowest = values.loops["heading"].gains[k].bandwidth
            answer = step_response(system, fed, "heading", 90.0 / slowest)
            assert answer.max() < 1.25
            assert answer[-1] == pytest.approx(1.0, abs=0.05)
            assert np.abs(np.linalg.eigvals(closed(system, fed))).max() < 1.0
            tried += 1
    assert tried >= 2


def test_weak_points_are_told() -> None:
    """Astern a slender hull turns about by itself; no start gain holds CWolf at more than 1 m/s."""
    weak = " ".join(start("cwolf").weak)
    assert "hover at -2.33 m/s" in weak
    assert not any("0.88" in text or "1.95" in text for text in start("cwolf").weak)
    assert not start("lauv").weak
    assert not start("beluga").weak
    # The faster REMUS goes, the faster it turns about by itself; its fins keep less margin than asked for.
    fast = [f"{u:.2f}" for u in start("remus100").speeds_m_s if u > 1.85]
    assert all(any(speed in text for speed in fast) for text in start("remus100").weak)
    assert "# Weak: hover at -2.33 m/s" in start_text("cwolf")


def test_start_gains_of_cwolf_are_of_the_size_of_the_tuning_examples() -> None:
    """The gains of examples/cwolf/start_autopilot.toml at 1 m/s, computed there: within a factor of three.

    The integral gains are left out: the example's take back an error over 40 times the loop's own time. The
    surge gain is held down by the noise of the velocity, to three tenths.
    """
    example = {
        "surge": (116.2, 0.0),
        "heave": (23.7, 153.6),
        "pitch": (47.3, 154.1),
        "heading": (32.8, 122.6),
    }
    at = int(np.argmin(np.abs(np.array(start("cwolf").speeds_m_s) - 1.0)))
    for loop, (k_p, k_d) in example.items():
        gain = start("cwolf").loops[loop].gains[at]
        assert (0.25 if loop == "surge" else 1.0 / 3.0) < gain.k_p / k_p < 3.0
        assert k_d == gain.k_d == 0.0 or 1.0 / 6.0 < gain.k_d / k_d < 3.0
    limits = {"surge": 250.0, "heave": 50.0, "pitch": 40.0, "heading": 60.0}
    for loop, limit in limits.items():
        assert start("cwolf").loops[loop].tau_max == pytest.approx(limit, rel=0.25)


@pytest.mark.parametrize("name", NAMES)
def test_file_has_the_keys_of_the_autopilot(name: str) -> None:
    text = start_text(name)
    table = tomllib.loads(text)
    assert table["format"] == 1
    assert len(table["schedule"]["speeds_m_s"]) == 6
    for mode in table["modes"]:
        assert set(mode["loops"]) <= set(table["loops"])
        assert mode["depth_by"] in ("heave", "pitch")
        assert mode["depth_by"] in mode["loops"]
    for loop in table["loops"].values():
        assert loop["tau_max"] > 0.0
        gains = [loop[key] for key in ("K_P", "K_I_per_s", "K_D_s") if key in loop]
        assert all(np.all(np.array(gain) > 0.0) for gain in gains)
    for row, why in start(name).left_out.items():
        assert f"# No {LOOPS[ROWS.index(row)]} loop: {why}." in text


@pytest.mark.parametrize(("name", "loop"), [("cwolf", "heading"), ("cwolf", "pitch"), ("beluga", "heading")])
def test_law_the_delay_of_the_course_is_that_of_a_harmonic_in_time(name: str, loop: str) -> None:
    """A filtered sine as reference, stepped through the sampled loop, against the frequency response."""
    vehicle, values = Vehicle.load(name), start(name)
    k = 4
    speed, mode = values.speeds_m_s[k], values.modes[-1]
    rows = "".join(ROWS[LOOPS.index(name)] for name in LOOPS if name in mode.loops)
    at = trim(vehicle, speed, rows, mode.actuators)
    assert at is not None
    system = sampled(plant(vehicle, at, mode.loops), values.late, values.period_s, mode.loops)
    own = law({name: values.loops[name].gains[k] for name in mode.loops}, speed)
    laws = own, own + restoring_law(vehicle, rows)
    inertia = float(np.asarray(vehicle.mass_matrix())[LOOPS.index(loop), LOOPS.index(loop)])
    omega, quick = 0.2, 1e6  # the filter is left out of it: its phase is added in closed form
    tau = following_delay(system, laws, (loop, speed, inertia), quick, omega)
    t = values.period_s * np.arange(int(400.0 / values.period_s))
    step, drive = reference_drive(system, laws, loop, (1j * omega, inertia))
    x, course = np.zeros(len(step)), []
    angle, flow, sign = (3, 5, 1.0) if loop == "heading" else (2, 6, -1.0)
    for now in t:
        shown = [x[system.seen[system.columns.index(column)]] for column in (angle, flow)]
        course.append(shown[0] + sign * shown[1] / speed)
        x = step @ x + np.real(drive * np.exp(1j * omega * now))
    half = t > 400.0 - 4.0 * np.pi / omega  # the last two periods: what began it has died away
    found = -np.angle(np.mean(np.array(course)[half] * np.exp(-1j * omega * t[half]))) / omega
    # Two whole periods in samples of 0.1 s leave some thousandths of the mean.
    assert tau == pytest.approx(found, abs=0.03)
    slow = following_delay(system, laws, (loop, speed, inertia), 2.0, omega)
    assert slow - tau == pytest.approx(3.0 * np.arctan(omega / 2.0) / omega, abs=1e-5)


@pytest.mark.parametrize("name", NAMES)
def test_law_lookahead_is_two_delays_of_way_and_the_integral_critically_damped(name: str) -> None:
    vehicle = Vehicle.load(name)
    table, late = guidance(vehicle, start(name))
    cruise = 0.6 * start(name).top_m_s[1]
    k = int(np.argmin(np.abs(np.array(start(name).speeds_m_s) - cruise)))
    speed = start(name).speeds_m_s[k]
    length = vehicle.geometry()["length"]
    # Three digits are written.
    assert table["lookahead_m"] == pytest.approx(max(2.0 * speed * late["heading"], 2.0 * length), rel=5e-3)
    assert table["integral_gain_m_s"] == pytest.approx(cruise / 4.0, rel=5e-3)
    # The filter is a part of the delay, no more than half of it where the hull drifts.
    filter_s = 3.0 / start(name).loops["heading"].reference_rad_s
    assert late["heading"] > 0.8 * filter_s
    assert ("pitch" in late) == (start(name).modes[-1].depth_by == "pitch")


def test_cruise_of_cwolf_rests_the_vertical_thrusters() -> None:
    hover, cruise = start("cwolf").modes
    assert hover.actuators is None
    assert cruise.actuators == ("SbU", "SbL", "PU", "PL")
    table = tomllib.loads(start_text("cwolf"))
    assert table["modes"][1]["actuators"] == ["stern"]
    assert table["allocation"]["weights"] == {"vertical": 0.05}
    assert all(mode.actuators is None for name in NAMES if name != "cwolf" for mode in start(name).modes)


def test_reactions_suit_the_vehicle() -> None:
    found = {name: without_substitute(Vehicle.load(name), start(name)) for name in NAMES}
    assert found == {
        "cwolf": (), "remus100": ("propeller",), "lauv": ("propeller",), "bluerov2-heavy": (), "beluga": (),
    }  # fmt: skip
    assert [heavy(Vehicle.load(name)) for name in NAMES] == [False, False, False, True, True]
    for name in NAMES:
        table = tomllib.loads(start_text(name))["safety"]
        if heavy(Vehicle.load(name)):
            # To stop all actuators would sink it.
            assert {table[f"stale_{group}"]["reaction"] for group in ("depth", "attitude", "rates")} == {
                "surface"
            }
        assert ("surface_speed_m_s" in table) == (len(start(name).modes) == 1)
        assert (table.get("actuator", {}).get("reaction") == "abort") == bool(found[name])


def test_a_vehicle_that_sinks_is_never_stopped_for_a_lost_sensor_with_fins_or_without() -> None:
    remus = Vehicle.load("remus100")
    heavier = remus.with_coefficients({"B": remus.coefficients()["B"] - 50.0})
    assert heavy(heavier)
    table = safety(heavier, start("remus100"))
    for group in ("depth", "attitude", "rates"):
        assert table[f"stale_{group}"]["reaction"] == "surface"


def test_fins_keep_their_own_stability_and_comments_say_why() -> None:
    for name in NAMES:
        text = start_text(name)
        assert ("fin_inflow = false # fins steady the hull" in text) == (name in ("remus100", "lauv"))
        assert "# 2 U tau; the course follows" in text
    assert commented("[a]\nx = 1\n\n[a.b]\ny = 2\n", {("a", "x"): "one", ("a", "b"): "two"}) == (
        "[a]\nx = 1 # one\n\n[a.b] # two\ny = 2\n"
    )


def test_bad_input_a_vehicle_that_cannot_be_steered_is_refused() -> None:
    text = (
        Vehicle
        .load("remus100")
        .to_toml()
        .replace('controllable = ["X", "M", "N"]', 'controllable = ["X", "M"]')
    )
    with pytest.raises(
        ValueError, match=r"expected a vehicle that commands X, N and Z or M; .*N: the vehicle file"
    ):
        start_gains(Vehicle.from_toml(text))


def test_bad_input_a_vehicle_without_actuators_or_steady_speed_is_refused() -> None:
    bare = Vehicle.from_toml(
        'format = 1\nname = "bare"\n[geometry]\nlength_m = 1.0\ndiameter_m = 0.3\n[coefficients]\nm = 10.0\n'
    )
    with pytest.raises(ValueError, match="has no actuators"):
        start_gains(bare)
    driven = Vehicle.load("cwolf").with_coefficients({"X_uu": 9.781})
    with pytest.raises(ValueError, match=r"reaches no steady speed .* found X_uu = \+9.781"):
        start_gains(driven)


def test_a_vehicle_that_turns_widely_circles_wider_than_it_must() -> None:
    lauv = Vehicle.load("lauv")
    weak = lauv.with_coefficients({f"rudder_{half}.gain": 0.25 for half in ("upper", "lower")})
    begun = start_gains(weak)
    radii = [turning_radius(weak, speed) for speed in begun.speeds_m_s if speed > 0.0]
    tightest = max(radius for radius in radii if radius is not None)
    assert guidance(weak, begun)[0]["loiter_radius_m"] == pytest.approx(1.25 * tightest, rel=0.01)


def test_a_pitch_that_overshoots_gets_a_longer_lookahead() -> None:
    lauv = Vehicle.load("lauv")
    # A hull that turns away from the flow, which its planes hold.
    unsteady = lauv.with_coefficients({"M_uw": -4.0 * lauv.coefficients()["M_uw"]})
    begun = start_gains(unsteady)
    k = int(np.argmin(np.abs(np.array(begun.speeds_m_s) - 0.6 * begun.top_m_s[1])))
    gains = {name: of.gains[k] for name, of in begun.loops.items()}
    flight = begun.modes[-1], begun.speeds_m_s[k], gains, begun.late
    plain, _ = lookahead(unsteady, flight, "pitch", begun.loops["pitch"].reference_rad_s, begun.period_s)
    table, _ = guidance(unsteady, begun)
    assert table["lookahead_vertical_m"] > 1.1 * plain
    # Of a pure integral with a delay of 1 s.
    delayed = np.exp(-1j * PATH_RAD_S) / (1j * PATH_RAD_S)
    distance = least_lookahead(delayed)
    assert np.abs(1.0 + delayed / distance).min() == pytest.approx(
        START_GUIDANCE_SETTINGS.least_distance, abs=0.02
    )
    assert np.abs(1.0 + 1.5 * delayed / distance).min() < START_GUIDANCE_SETTINGS.least_distance
