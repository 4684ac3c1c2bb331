"""Axes that an autopilot and waves dominate are told from those that a log identifies, with a true rudder."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import seatrial as st
from seatrial.base.arrays import Array
from seatrial.inspect.verdict import Verdict, blind, judge, judge_trial, pushed_by, untold
from seatrial.trial.trial import Trial

DT = 0.2
VEHICLE = st.Vehicle.load("remus100")


def narrow_band(rng: np.random.Generator, count: int, period_s: float) -> Array:
    """White noise behind a lightly damped oscillator, with a deviation of one."""
    omega, y = 2.0 * np.pi * DT / period_s, np.zeros(count)
    for k in range(2, count):
        y[k] = 1.98 * np.cos(omega) * y[k - 1] - 0.9801 * y[k - 2] + rng.normal()
    return np.asarray(y / y.std())


def sailed(seed: int, *, turns: bool = False, closed: bool = True, waves: float = 0.02) -> Trial:
    """Yaw of a first-order vehicle under a rudder: PD loop on noisy sensors of its own, or preset steps."""
    rng = np.random.default_rng(seed)
    count = round(600.0 / DT)
    t = DT * np.arange(count)
    yaw, r, rudder = np.zeros(count), np.zeros(count), np.zeros(count)
    swell = narrow_band(rng, count, 6.0)
    seen, felt = rng.normal(0.0, 0.002, count), rng.normal(0.0, 0.002, count)
    target, step = 0.0, 0.0
    for k in range(1, count):
        if turns and k % 200 == 0:
            target += rng.choice([-1.5, 1.5])
        if k % 40 == 0:
            step = rng.uniform(-0.15, 0.15)
        error = target - yaw[k - 1] - seen[k]
        rudder[k] = np.clip(0.8 * error - 0.6 * (r[k - 1] + felt[k]), -0.25, 0.25) if closed else step
        r[k] = r[k - 1] + DT * (0.4 * rudder[k] - r[k - 1] + waves / 0.4 * swell[k]) / 1.2
        yaw[k] = yaw[k - 1] + DT * r[k]
    frame = {
        "t_s": t,
        "yaw_deg": np.degrees(yaw + rng.normal(0.0, 0.002, count)),
        "r_deg_s": np.degrees(r + rng.normal(0.0, 0.001, count)),
        "v_m_s": waves * swell + rng.normal(0.0, 0.005, count),
        # a positive rudder of this vehicle turns to port
        "cmd.rudder_upper": -rudder,
        "cmd.rudder_lower": -rudder,
    }
    still = ("propeller", "stern_plane_port", "stern_plane_starboard")
    frame |= {f"cmd.{name}": np.zeros(count) for name in still}
    return Trial.read(frame, align=False, name=f"s{seed}")


def yaw(trial: Trial) -> Verdict:
    return judge_trial(trial, VEHICLE)["N"]


@pytest.mark.parametrize("seed", range(2))
def test_constant_set_points_in_waves_are_dominated_and_turns_are_not(seed: int) -> None:
    dominated, informative = yaw(sailed(seed)), yaw(sailed(seed, turns=True))
    assert dominated.kind == "feedback-dominated"
    assert dominated.told < 0.1
    assert dominated.wave_period_s == pytest.approx(6.0, rel=0.15)
    assert "this log does not determine how" in dominated.sentence
    assert informative.kind == "closed and informative"
    assert informative.told > 0.5


def test_a_command_that_tells_nothing_is_dominated_where_no_waves_are_seen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("seatrial.inspect.verdict.waves", lambda trial: None)
    found = yaw(sailed(3))
    assert found.kind == "feedback-dominated"
    assert "follow the motion, and commands" in found.sentence
    assert yaw(sailed(0, turns=True)).kind == "closed and informative"


@pytest.mark.parametrize("seed", range(4))
def test_preset_steps_are_open_in_any_waves(seed: int) -> None:
    assert yaw(sailed(seed, closed=False, waves=0.02 * seed)).kind == "open"


def test_one_informative_trial_saves_an_axis() -> None:
    dominated, steps = sailed(1), sailed(2, closed=False)
    assert judge([dominated], VEHICLE)["N"].dominated
    assert judge([dominated, steps], VEHICLE)["N"].kind == "open"


def test_coefficients_of_a_dominated_axis_are_named_unless_another_axis_tells_them() -> None:
    dominated = Verdict("M", "feedback-dominated", ("stern_plane_port",), 0.5, 0.0, 0.5, 6.0)
    names = ("M_q", "N_r", "stern planes.gain", "rudder.gain", "stern_plane_port.C_La", "m")
    assert untold(names, {"M": dominated}, VEHICLE) == {
        "M": ["M_q", "stern planes.gain", "stern_plane_port.C_La"]
    }
    rolls = Verdict("K", "open", ("stern_plane_port",), 0.0, 0.0, 0.0, 6.0)
    assert untold(names, {"M": dominated, "K": rolls}, VEHICLE) == {"M": ["M_q"]}


def test_buoyancy_goes_with_a_heave_that_feedback_dominates_in_waves() -> None:
    told = ("B", "Z_w", "z_b")
    heave = Verdict("Z", "feedback-dominated", ("vfr",), 0.2, 0.2, 0.6, 5.0)
    assert untold(told, {"Z": heave}, VEHICLE) == {"Z": ["B", "Z_w"]}
    assert untold(told, {"Z": replace(heave, wave_period_s=np.nan)}, VEHICLE) == {"Z": ["Z_w"]}
    assert untold(told, {"M": replace(heave, axis="M")}, VEHICLE) == {}


def test_fins_serve_by_their_moment() -> None:
    pushed = pushed_by(VEHICLE)
    assert set(pushed["N"]) == {"rudder_upper", "rudder_lower"}
    assert set(pushed["M"]) == {"stern_plane_port", "stern_plane_starboard"}
    assert pushed["X"].keys() == {"propeller"}
    assert "Y" not in pushed
    assert pushed["N"]["rudder_upper"] < 0.0


def test_an_axis_is_judged_by_the_wrench_where_no_command_is_recorded() -> None:
    by_command = sailed(3)
    wrench = {
        "tau.N_nm": -10.0 * by_command.commands["rudder_upper"],
        "tau.X_n": np.full(len(by_command), 9.0),
    }
    frame = {"t_s": by_command.t, "yaw_deg": np.degrees(by_command.channel("yaw"))}
    frame |= {"r_deg_s": np.degrees(by_command.channel("r")), "v_m_s": by_command.channel("v")}
    trial = Trial.read(frame | wrench, align=False)
    found, other = judge_trial(trial, VEHICLE), yaw(by_command)
    assert set(found) == {"N"}
    assert found["N"].commands == ("tau.N_nm",)
    assert found["N"].kind == other.kind == "feedback-dominated"
    assert found["N"].told == pytest.approx(other.told, abs=0.05)


@pytest.mark.parametrize(
    ("explained", "wave_share", "period_s", "letters"),
    [(0.17, 0.51, 5.0, "Y"), (0.17, 0.1, 5.0, ""), (0.02, 0.51, 5.0, ""), (0.17, np.nan, np.nan, "")],
)
def test_a_loop_that_passes_as_open_is_not_scored_where_it_answers_waves(
    explained: float, wave_share: float, period_s: float, letters: str
) -> None:
    """Station keeping of a generated ROV with unlogged velocities: a model that is right scores -0.4."""
    assert blind({"Y": Verdict("Y", "open", ("fr",), explained, np.nan, wave_share, period_s)}) == letters
