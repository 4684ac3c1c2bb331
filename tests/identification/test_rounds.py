"""Rounds of proposals: what is missing is found and kept, and nothing where nothing is missing."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import seatrial as st
from seatrial.base.arrays import Array
from seatrial.diagnosis.missing_terms import Suggestion
from seatrial.estimation.joint import Joint
from seatrial.estimation.joint_estimate import polish
from seatrial.identification.identification import Identification
from seatrial.identification.rounds import SETTINGS, Proposal, in_rounds
from seatrial.problem.problem import Problem
from seatrial.problem.settings import JointSettings

START = st.Vehicle.load("bluerov2-heavy")
FREE: dict[str, tuple[float, float] | None] = {
    "X_u": (-200.0, 0.0),
    "X_uu": (-400.0, 0.0),
    "Y_v": (-200.0, 0.0),
    "Y_vv": (-600.0, 0.0),
    "N_r": (-20.0, 0.0),
    "N_rr": (-20.0, 0.0),
}


@cache
def trial(missing: tuple[tuple[str, float], ...], *, duration_s: float = 240.0, seed: int = 1) -> st.Trial:
    """Sway, surge and yaw under steps of all thrusters, with the noise of a Doppler log and a gyro."""
    t = np.arange(0.0, duration_s, 0.1)
    generator = np.random.default_rng(seed)
    true = START.with_coefficients(dict(missing))

    def steps(level: float, hold_s: float) -> Array:
        return np.repeat(generator.uniform(-level, level, int(duration_s / hold_s) + 1), int(10 * hold_s))[
            : len(t)
        ]

    pushes = np.array([1500.0 + steps(100.0, hold_s) for hold_s in (3.0, 4.0, 5.0, 6.0)])
    commands = {f"thruster_{k + 1}": push for k, push in enumerate(pushes)}
    commands |= {f"thruster_{k}": np.full(len(t), 1500.0) for k in range(5, 9)}
    run = true.simulate(t, commands, voltage_v=np.full(len(t), 16.0))
    table = {"t_s": t, "voltage_v": np.full(len(t), 16.0)} | {
        f"cmd.{name}": signal for name, signal in commands.items()
    }
    for k, name in enumerate(("u_m_s", "v_m_s", "w_m_s")):
        table[name] = run.nu[:, k] + 0.01 * generator.standard_normal(len(t))
    for k, name in enumerate(("p_deg_s", "q_deg_s", "r_deg_s")):
        table[name] = np.rad2deg(run.nu[:, 3 + k] + 0.01 * generator.standard_normal(len(t)))
    for k, name in enumerate(("roll_deg", "pitch_deg", "yaw_deg")):
        table[name] = np.rad2deg(run.euler[:, k] + 0.002 * generator.standard_normal(len(t)))
    return st.Trial.read(table, name="steps")


def problem(
    given: st.Trial, joint: JointSettings, *, free: dict[str, tuple[float, float] | None] = FREE
) -> Problem:
    return Problem(START, [given], free=free, axes="XYN", joint=joint, segment_s=5.0)


def tried(given: st.Trial, **changed: tuple[float, float]) -> tuple[Joint, Joint, tuple[Proposal, ...]]:
    """The joint estimates before and after two rounds, and what was proposed."""
    joint = Joint(problem(given, JointSettings(segment_s=5.0), free={**FREE, **changed}), START)
    after, best, proposals = in_rounds(joint, polish(joint), rounds=2)
    after.start = best.values
    assert (after.problem.joint == joint.problem.joint) == all(p.verdict != "kept" for p in proposals)
    return joint, after, proposals


def test_a_missing_term_is_kept_and_found() -> None:
    joint, after, proposals = tried(trial((("N_v", -12.0),)))
    kept = [proposal for proposal in proposals if proposal.verdict == "kept"]
    assert kept[0].name == "N_v"
    assert kept[0].channel == "r"
    assert kept[0].p < SETTINGS.level
    known = dict(zip([unknown.name for unknown in after.unknowns], after.start, strict=True))
    assert known["N_v"] == pytest.approx(-12.0, rel=0.1)
    # The line says the same as what was tried, and can be put into a campaign.
    entry = tomllib.loads(kept[0].line)["N_v"]
    section = after.problem.joint
    assert section is not None
    assert section.coefficients["N_v"].bounds == tuple(entry)
    assert "N_v" not in {unknown.name for unknown in joint.unknowns}


def test_nothing_is_kept_where_nothing_is_missing() -> None:
    for seed in (1, 2, 3):
        joint, after, proposals = tried(trial((), seed=seed))
        assert after is joint
        assert all(proposal.verdict != "kept" for proposal in proposals)


def test_a_bound_that_the_data_contradict_is_widened() -> None:
    start = START.coefficients()["Y_vv"]
    true = 2.0 * start
    _, after, proposals = tried(trial((("Y_vv", true),)), Y_vv=(1.3 * start, 0.0))
    assert (proposals[0].kind, proposals[0].name, proposals[0].verdict) == ("bound", "Y_vv", "kept")
    known = dict(zip([unknown.name for unknown in after.unknowns], after.start, strict=True))
    assert known["Y_vv"] == pytest.approx(true, rel=0.1)


def test_a_short_log_cannot_tell_a_gain_from_chance() -> None:
    joint, after, proposals = tried(trial((("N_v", -12.0),), duration_s=20.0))
    assert after is joint
    assert not proposals


def test_levers_of_a_group_are_proposed_in_proportion() -> None:
    arms = {name: 1.4 * arm for name, arm in START.coefficients().items() if name.endswith("lever_N")}
    *_, proposals = tried(trial(tuple(arms.items())))
    names = {name for proposal in proposals for name in (proposal.name,) if proposal.verdict == "kept"}
    assert names & {"horizontal.lever_N", "I_z", "N_rdot", "horizontal.gain"}, proposals


def test_ctrl_c_keeps_the_estimate_before_the_rounds(monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*_args: object, **_options: object) -> None:
        raise KeyboardInterrupt

    joint = Joint(problem(trial((("N_v", -12.0),)), JointSettings(segment_s=5.0)), START)
    before = polish(joint)
    monkeypatch.setattr("seatrial.identification.rounds.polish", stopped)
    after, best, proposals = in_rounds(joint, before, rounds=2)
    assert after is joint
    assert best.interrupted
    assert np.array_equal(best.values, before.values)
    assert not proposals


@pytest.fixture(scope="module")
def fit() -> Identification:
    asked = problem(trial((("N_v", -12.0),)), JointSettings(segment_s=5.0, proposal_rounds=1))
    return asked.identify(work=st.Work(threads=1))


def test_the_result_has_what_was_kept_and_says_so(fit: Identification) -> None:
    assert fit.vehicle.coefficients()["N_v"] == pytest.approx(-12.0, rel=0.1)
    assert "N_v" in {row.name for row in fit.coefficients}
    assert "Proposals of the residual analysis" in fit.summary()
    assert fit.to_dict()["proposals"][0]["line"].startswith("N_v = [")


def test_what_was_tried_in_vain_is_not_advised_again(fit: Identification) -> None:
    assert fit.assessment is not None
    term = Suggestion(
        "X_vv", "N s2/m2", (), "u", "|v| v", 0.0, -9.0, 1.0, 30.0, 1e-9, line="X_vv = [-20.0, 0.0]"
    )
    analysis = replace(fit.assessment.residual_analysis, suggestions=(term,))
    inside = tuple(replace(row, at_bound=None) for row in fit.coefficients)
    sure = replace(fit.assessment, residual_analysis=analysis, bounds=None)
    asked = replace(fit, assessment=sure, coefficients=inside)
    assert "X_vv" in asked.report().next_step
    vain = Proposal(1, "X_vv", "term", term.line, "u", 0.1, 0.7, "within chance")
    assert "X_vv" not in replace(asked, proposals=(*fit.proposals, vain)).report().next_step
