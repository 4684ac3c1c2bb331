"""Estimates on events: what open-loop stretches of a closed loop in waves tell, and how sure that is."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import seatrial as st
from seatrial.estimation.event_fit import SETTINGS
from seatrial.identification.events import EventEstimate, EventEstimates, from_events, on_events
from seatrial.inspect.feedback import Event, events
from seatrial.problem.problem import Problem
from seatrial.problem.settings import Axes, Coefficient, JointSettings, Stage, TrialUse

FIELD = Path(os.environ.get("SEATRIAL_DATA", "/nonexistent")) / "field_torpedo"

LIMIT, GAIN = 0.2374, 0.7  # rad, and the rudder's lift over that of the start vehicle


def waves(t: np.ndarray, rng: np.random.Generator, size: float) -> np.ndarray:
    """A narrow band about 1.2 rad/s with a standard deviation of ``size``."""
    tones = rng.uniform(1.05, 1.35, 12)
    phases = rng.uniform(0.0, 2.0 * np.pi, 12)
    return np.asarray(size * np.sqrt(2.0 / 12.0) * np.cos(np.outer(t, tones) + phases).sum(axis=1))


def mission(seed: int = 1, turns: int = 9) -> st.Trial:
    """REMUS 100 with 0.7 of its rudder's lift: a turn at its limit every 40 s, waves on the sensors."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 40.0 * turns, 0.1)
    remus = st.Vehicle.load("remus100")
    true = remus.with_coefficients({f"rudder_{side}.gain": GAIN for side in ("upper", "lower")})
    rudder = 0.3 * waves(t, rng, 0.06)
    for turn in range(turns):
        start = 40.0 * turn + 22.0
        rudder[(t >= start) & (t < start + 13.0)] = LIMIT * (-1.0) ** turn
    commands = {"propeller": np.full(len(t), 1525.0)}
    commands |= {f"rudder_{side}": rudder for side in ("upper", "lower")}
    commands |= {f"stern_plane_{side}": 0.0 * t for side in ("port", "starboard")}
    run = true.simulate(t, commands)
    yaw = np.unwrap(run.euler[:, 2])
    table = {
        "t_s": t,
        **{f"{name}_m_s": run.nu[:, k] for k, name in enumerate("uvw")},
        "roll_deg": np.degrees(run.euler[:, 0]),
        "pitch_deg": np.degrees(run.euler[:, 1]),
        "yaw_deg": np.degrees(yaw + waves(t, rng, 0.01) + rng.normal(0.0, 0.002, len(t))),
        **{f"cmd.{name}": signal for name, signal in commands.items()},
    }
    table["v_m_s"] = table["v_m_s"] + waves(t, rng, 0.03) + rng.normal(0.0, 0.01, len(t))
    return st.Trial.read(table, name="log", align=False)


def problem(trial: st.Trial) -> Problem:
    """Sway and yaw of the mission, from the built-in vehicle, and the surge beside them."""
    free = {
        "rudder.gain": Coefficient(bounds=(0.1, 3.0)),
        "Y_vv": Coefficient(bounds=(-2700.0, -25.0)),
        "N_rr": Coefficient(bounds=(-190.0, -2.0)),
        "N_uv": Coefficient(bounds=(-14.0, 14.0)),
    }
    stages = (
        Stage(
            name="sway and yaw",
            trials=("log",),
            axes=Axes(free="YN", measured="XZKM"),
            channels={"v": 1.0, "r": 1.0},
            coefficients=free,
        ),
        Stage(
            name="surge",
            trials=("log",),
            axes=Axes(free="X", measured="YZKMN"),
            coefficients={"X_uu": Coefficient(bounds=(-20.0, -0.5))},
        ),
    )
    return Problem.of(
        vehicle=st.Vehicle.load("remus100"),
        trials={"log": trial},
        uses={"log": TrialUse("commands", False)},
        stages=stages,
        joint=JointSettings(),
    )


def turns(trial: st.Trial) -> tuple[Event, ...]:
    return events(trial, st.Vehicle.load("remus100"), "N")


@pytest.fixture(scope="module")
def asked() -> Problem:
    return problem(mission())


@pytest.fixture(scope="module")
def estimate(asked: Problem) -> EventEstimate:
    return on_events(asked, asked.stages[0], turns(asked.trials["log"]), None)


def test_law_events_in_waves_give_the_gain_within_its_interval_and_the_right_damping(
    asked: Problem, estimate: EventEstimate
) -> None:
    assert estimate.enough
    # The vehicle is damped by v|v| and r|r|, not by strips: the left-out events tell.
    assert estimate.damping == "quadratic"
    assert estimate.likelier > 10.0
    known = {p.name: estimate.known(k) for k, p in enumerate(estimate.parameters)}
    assert known["rudder.gain"]["verdict"] == "identifiable"
    assert known["rudder.gain"]["estimate"] == pytest.approx(GAIN, rel=0.06)
    true = asked.vehicle.coefficients() | {"rudder.gain": GAIN}
    for name, row in known.items():
        assert row["lower"] < true[name] < row["upper"], name
        assert 0.0 < row["sigma"] < 0.3 * abs(true[name]) + 3.0 * (name == "N_uv"), name


def test_four_events_carry_too_little() -> None:
    asked = problem(mission(turns=SETTINGS.fewest - 1))
    found = turns(asked.trials["log"])
    assert len(found) == SETTINGS.fewest - 1
    estimate = on_events(asked, asked.stages[0], found, None)
    assert not estimate.enough
    assert estimate.events == found


def test_an_open_loop_is_not_estimated_on_events() -> None:
    """This rudder answers no measurement."""
    open_loop = from_events(problem(mission()))
    assert not open_loop.estimates
    assert open_loop.rest is open_loop.whole


def test_the_rest_has_the_events_values_and_the_whole_comes_back(
    asked: Problem, estimate: EventEstimate
) -> None:
    told = EventEstimates(asked, (estimate,))
    rest = told.rest
    assert [stage.name for stage in rest.stages] == ["surge"]
    gain = estimate.values[[p.name for p in estimate.parameters].index("rudder.gain")]
    assert rest.vehicle.coefficients()["rudder_upper.gain"] == pytest.approx(gain)
    # What the joint estimate frees is surge; sway and yaw are replayed beside it.
    assert rest.stages[0].axes.measured == "YZKMN"
    again = told.again(rest.vehicle)
    # Nothing else has changed: the same estimate, whose priors are still those of the vehicle file.
    assert again.taken[0].prior == estimate.prior
    assert again.taken[0].values == pytest.approx(estimate.values, rel=0.03, abs=0.1)
    whole = told.restored(rest)
    assert [stage.name for stage in whole.stages] == ["sway and yaw", "surge"]
    assert whole.vehicle.coefficients() == asked.vehicle.coefficients()
    assert whole.joint == asked.joint


@pytest.mark.long
@pytest.mark.skipif(not FIELD.is_dir(), reason="field_torpedo is not here; set SEATRIAL_DATA to its folder")
def test_issue_the_rudder_of_field_torpedo_is_told_by_its_turns(tmp_path: Path) -> None:
    """Truth: 0.5 of the lift slope 3.1 of the vehicle file, 0.161; the whole log gave 0.243."""
    files = [FIELD / f"{name}.csv" for name in ("attitude", "depth", "dvl", "fins")]
    vehicle = FIELD / "vehicle.toml"
    st.import_logs(files, out=tmp_path / "first", vehicle=vehicle)
    text = (tmp_path / "first" / "map.toml").read_text()
    assert "# [clocks]" in text
    (tmp_path / "map.toml").write_text(text.replace("# [clocks]", "[clocks]").replace('# "dvl', '"dvl'))
    st.import_logs(files, out=tmp_path / "log", vehicle=vehicle, map=tmp_path / "map.toml")
    campaign = tmp_path / "log" / "campaign.toml"
    lines = campaign.read_text().splitlines()
    accepted = ("# [corrections]", "# tilt_deg", "# corrections.current")
    campaign.write_text("\n".join(line[2:] if line.startswith(accepted) else line for line in lines))
    fit = st.Campaign.load(campaign).identify()
    yaw, pitch = fit.events
    assert yaw.enough
    assert not pitch.enough
    assert yaw.strips == "C_Dy"
    rows = {row.name: row for row in fit.coefficients}
    gain = rows["rudder_upper.gain"]
    assert gain.estimate == pytest.approx(0.161, rel=0.1)
    assert gain.interval is not None
    assert gain.interval[0] < 0.161 < gain.interval[1]
    assert (gain.verdict, gain.stage) == ("identifiable", "events")
    # The rest is estimated beside it, and both are in what vehicles are sampled from.
    assert rows["X_uu"].stage == "joint estimate"
    assert fit.covariance is not None
    assert {"X_uu", "rudder_upper.gain", "C_Dy"} <= set(fit.covariance.names)
    assert fit.vehicle.coefficients()["rudder_upper.gain"] == pytest.approx(gain.estimate)
    assert [stage.name for stage in fit.problem.stages] == ["surge", "sway and yaw", "heave"]
    ahead = fit.scores["hold_out"]["ahead"]["field_torpedo"].r2
    assert ahead["u"] > 0.95
    assert ahead["v"] > 0.87
    assert ahead["r"] > 0.9
    words = str(fit.report())
    assert "sway and yaw: estimated from 11 events alone" in words
    assert "pitch: the events carry too little: 0 stretches" in words
