"""Strips of the hull and forces of single trials that a campaign lacks: named by the residual analysis."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl

from seatrial._core import State, Vehicle
from seatrial.campaign.campaign import Campaign
from seatrial.campaign.suggestion import follow
from seatrial.check.vehicle import implausible
from seatrial.diagnosis.assessment import assess
from seatrial.diagnosis.identifiability import warnings_before
from seatrial.diagnosis.residual_analysis import analyse_joint
from seatrial.estimation.joint import Joint
from seatrial.estimation.joint_estimate import linearise, polish
from seatrial.report.results import diagnosis as words

CAMPAIGN = """
format = 1
name = "made"
vehicle = "model.toml"
input = "tau"
[trials.drift]
file = "drift.parquet"
[[stages]]
name = "drift"
trials = ["drift"]
axes = { free = "YN" }
[stages.coefficients]
Y_vdot = [-300.0, -50.0]
N_rdot = [-150.0, -10.0]
Y_v = [-100.0, 0.0]
N_r = [-100.0, 0.0]
"""
DAMPING = "Y_vv = [-900.0, -1.0]\nN_rr = [-500.0, -1.0]\n"
POLISH = "[polish]\nchannels = { v = 1.0, r = 1.0 }\n"


def made(folder: Path, own: str, *, y_vv: float = -300.0, n_rr: float = -150.0) -> Joint:
    """A hull with strips, pushed sideways and turned at once; the model has none."""
    plain = Vehicle.load("cwolf").with_coefficients({"Y_vv": y_vv, "N_rr": n_rr})
    (folder / "model.toml").write_text(plain.to_toml())
    truth = plain.with_coefficients({"C_Dy": 0.8, "Y_vv": 0.0, "N_rr": 0.0})
    campaign = Campaign.from_toml(
        CAMPAIGN + own + POLISH, folder=folder, trials={"drift": pushed(truth, seed=3)}
    )
    return Joint(campaign.problem(), threads=1)


def pushed(truth: Vehicle, *, seed: int) -> pl.DataFrame:
    """Eighty seconds of a vehicle under a recorded side force and yaw moment in steps."""
    t = np.arange(0.0, 80.0, 0.1)
    generator = np.random.default_rng(seed)
    tau = np.zeros((len(t), 6))
    tau[:, 1] = np.repeat(generator.uniform(-60.0, 60.0, 20), 40)
    tau[:, 5] = np.repeat(generator.uniform(-30.0, 30.0, 40), 20)
    nu = truth.simulate(t, {}, State(), tau=tau, free="YN", max_step_s=0.05).nu
    seen = nu[:, [1, 5]] + generator.normal(size=(len(t), 2)) * [0.004, 0.004]
    columns = {"t_s": t, "u_m_s": np.zeros(len(t)), "v_m_s": seen[:, 0], "r_deg_s": np.rad2deg(seen[:, 1])}
    names = ("X_n", "Y_n", "Z_n", "K_nm", "M_nm", "N_nm")
    return pl.DataFrame(columns | {f"tau.{name}": own for name, own in zip(names, tau.T, strict=True)})


def test_missing_strips_are_named_with_their_coefficient(tmp_path: Path) -> None:
    joint = made(tmp_path, DAMPING)
    best = polish(joint)
    found = analyse_joint(joint, best.values, initial=best.initial, noise=best.noise)
    first = found.suggestions[0]
    assert first.name == "C_Dy"
    assert "follows |v + x r| (v + x r) along the hull: free C_Dy" in first.sentence
    assert "hold Y_vv and N_rr at 0" in first.sentence
    assert f"line for the campaign's coefficients: {first.line}" in str(found)
    # With the line, and the damping held at zero as it says, the truth is found.
    again = made(tmp_path, first.line + "\n", y_vv=0.0, n_rr=0.0)
    values = dict(zip([one.name for one in again.unknowns], polish(again).values, strict=True))
    assert abs(values["C_Dy"] - 0.8) < 0.02


def test_strips_and_the_damping_they_make_must_not_both_be_free(tmp_path: Path) -> None:
    joint = made(tmp_path, DAMPING + "C_Dy = [0.0, 2.0]\n")
    told = [words.sentence(finding) for finding in warnings_before(linearise(joint, joint.start))]
    assert (
        "C_Dy, Y_vv and N_rr: the strips of C_Dy make Y_vv and N_rr already, both must not be free; hold Y_vv"
        " and N_rr at 0, or leave C_Dy out"
    ) in told
    both = Vehicle.load("cwolf").with_coefficients({"C_Dy": 0.8})
    assert ("C_Dy", ["Y_vv", "N_rr"]) in [
        (finding.subject, finding.values.get("included")) for finding in implausible(both)
    ]
    assert not implausible(Vehicle.load("cwolf"))


def test_a_constant_force_of_one_trial_is_named_and_freed_for_that_trial(tmp_path: Path) -> None:
    text = CAMPAIGN.replace("[[stages]]", '[trials.back]\nfile = "back.parquet"\n[[stages]]').replace(
        'trials = ["drift"]', 'trials = ["drift", "back"]'
    )
    vehicle = Vehicle.load("cwolf")
    (tmp_path / "model.toml").write_text(vehicle.to_toml())
    trials = {
        "drift": pushed(vehicle, seed=1),
        "back": pushed(vehicle.with_coefficients({"Y_0": 6.0}), seed=2),
    }
    campaign = Campaign.from_toml(text + POLISH, folder=tmp_path, trials=trials)
    joint = Joint(campaign.problem(), threads=1)
    best = polish(joint)
    found = analyse_joint(joint, best.values, initial=best.initial, noise=best.noise)
    first = found.suggestions[0]
    assert first.name == "back: force_Y"
    assert "follows a constant in trial back" in first.sentence
    assert abs(first.value - 6.0) < max(3.0 * first.sigma, 0.3)
    assert 'line for [polish.nuisances]: force_Y = { trials = ["back"] }' in str(found)
    followed = follow(campaign, first)
    again = Joint(followed.problem(), threads=1)
    assert [one.name for one in again.unknowns][-1] == "back: force_Y"
    assert "Y_0" not in again.identified(polish(again).values).coefficients()


def towed(folder: Path, own: str) -> Joint:
    """A hull with a tether at its stern, pushed sideways and turned at once; the model drags none."""
    head, _, rest = Vehicle.load("cwolf").to_toml().partition("[coefficients]")
    text = f"{head}[tether]\nposition_m = [-1.2, 0.0, 0.0]\n\n[coefficients]{rest}"
    (folder / "model.toml").write_text(text)
    truth = Vehicle.from_toml(text).with_coefficients({"A_tether": 0.15})
    campaign = Campaign.from_toml(
        CAMPAIGN + own + POLISH, folder=folder, trials={"drift": pushed(truth, seed=3)}
    )
    return Joint(campaign.problem(), threads=1)


def test_a_missing_tether_is_named(tmp_path: Path) -> None:
    joint = towed(tmp_path, "")
    best = polish(joint)
    found = analyse_joint(joint, best.values, initial=best.initial, noise=best.noise)
    assert found.suggestions[0].name == "A_tether", str(found)
    assert "m2" in found.suggestions[0].sentence
    # Without a spring in the file its stiffness cannot be missing.
    assert "k_tether" not in joint.vehicle.coefficient_info()


def test_the_drag_area_of_a_tether_is_found_again(tmp_path: Path) -> None:
    joint = towed(tmp_path, "A_tether = [0.0, 1.0]\n")
    values = dict(zip([one.name for one in joint.unknowns], polish(joint).values, strict=True))
    assert abs(values["A_tether"] / 0.15 - 1.0) < 0.03, values


def test_the_stiffness_of_a_taut_tether_is_found_again(tmp_path: Path) -> None:
    """A hull on a spring from its middle to a place 4 m ahead, pushed about there; its place was recorded."""
    head, _, rest = Vehicle.load("cwolf").to_toml().partition("[coefficients]")
    spring = "[tether]\nposition_m = [0.0, 0.0, 0.0]\nanchor_m = [4.0, 0.0, 0.0]\nslack_m = 3.5\n\n"
    text = f"{head}{spring}[coefficients]{rest}"
    (tmp_path / "model.toml").write_text(text)
    truth = Vehicle.from_toml(text).with_coefficients({"k_tether": 12.0})
    plain = pushed(truth, seed=3)
    t = plain["t_s"].to_numpy()
    tau = plain.select("^tau\\..*$").to_numpy()
    run = truth.simulate(t, {}, State(), tau=tau, free="YN", max_step_s=0.05)
    noise = np.random.default_rng(5).normal(size=(len(t), 3))
    place = run.position + 0.02 * noise
    assert np.ptp(run.position[:, 1]) > 1.0
    trial = plain.with_columns(
        pl.Series("x_m", place[:, 0]),
        pl.Series("y_m", place[:, 1]),
        pl.Series("yaw_deg", np.rad2deg(run.euler[:, 2]) + 0.2 * noise[:, 2]),
    )
    campaign = Campaign.from_toml(
        CAMPAIGN + "k_tether = [0.0, 60.0]\n" + POLISH, folder=tmp_path, trials={"drift": trial}
    )
    joint = Joint(campaign.problem(), threads=1)
    found = assess(joint, polish(joint))
    place_of = list(found.uncertainty.names).index("k_tether")
    estimate, sigma = found.uncertainty.estimate[place_of], found.uncertainty.sigma[place_of]
    assert abs(estimate - 12.0) < 3.0 * sigma
    assert sigma < 0.1 * 12.0
