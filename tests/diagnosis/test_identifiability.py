"""Identifiability of CWolf from exact sensitivities at its truth: what its stages tell, and what not."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from seatrial._core import Vehicle
from seatrial.campaign.campaign import Campaign
from seatrial.diagnosis.identifiability import Identifiability, judge, warnings_before
from seatrial.estimation.joint import Joint
from seatrial.estimation.joint_estimate import linearise
from seatrial.report.results import diagnosis as words
from seatrial.statistics.linearisation import Linearisation
from seatrial.trial.truth import Truth

CWOLF = Path(__file__).parents[2] / "examples" / "cwolf"
ROLL = ("K_pdot", "K_p", "K_pp")
# Trial, axes, coefficients, what is held out to save time. Roll's coefficients are asked of all stages.
STAGES: dict[str, tuple[str, str, dict[str, str], str]] = {
    "surge": (
        "surge",
        'free = "X", measured = "YZKMN"',
        {
            "X_udot": "[-40.0, -1.0]",
            "X_u": "[-15.0, 0.0]",
            "X_uu": '"default"',
            "stern.p1_ahead": '"default"',
            "stern.p1_astern": '"default"',
            "stern.p2": '"default"',
        },
        "[[180.0, 359.0]]",
    ),
    "dive": (
        "dive",
        'free = "Z", measured = "XYKMN"',
        {"Z_wdot": '"default"', "Z_w": "[-100.0, 0.0]", "Z_ww": '"default"', "B": "[1320.0, 1345.0]"},
        "[[120.0, 299.0]]",
    ),
    "turn": (
        "turn",
        'free = "YN", measured = "XZKM"',
        {
            "Y_vdot": '"default"',
            "Y_vv": '"default"',
            "Y_uv": "[-400.0, 0.0]",
            "Y_ur": "[0.0, 200.0]",
            "N_rdot": '"default"',
            "N_rr": '"default"',
            "N_uv": "[0.0, 300.0]",
            "N_ur": "[-200.0, 0.0]",
        },
        "[[180.0, 399.0]]",
    ),
    "turn, sway locked": (
        "turn",
        'free = "N", measured = "XYZKM"',
        {"Y_vv": '"default"', "N_rdot": '"default"', "N_r": "[-75.0, 0.0]", "N_rr": '"default"'},
        "[[180.0, 399.0]]",
    ),
    "pitch": (
        "dive_stern",
        'free = "ZM", measured = "XYKN"',
        {
            "Z_uw": "[-400.0, 0.0]",
            "I_y": '"default"',
            "M_qdot": '"default"',
            "M_q": "[-75.0, 0.0]",
            "M_qq": '"default"',
            "M_uw": "[-300.0, 0.0]",
            "M_uq": "[-200.0, 0.0]",
        },
        "[[180.0, 399.0]]",
    ),
    "roll": ("roll", 'free = "K", measured = "XYZMN"', {}, "[]"),
}


@cache
def truth() -> Vehicle:
    return Truth.load(CWOLF / "truth.toml").vehicle


@cache
def joint(stage: str) -> Joint:
    trial, axes, freed, held = STAGES[stage]
    roll = {"K_pdot": '"default"', "K_p": "[-3.0, 0.0]", "K_pp": '"default"'}
    lines = [f'"{name}" = {bounds}' for name, bounds in {**freed, **roll}.items()]
    text = f"""
        format = 1
        name = "{stage}"
        vehicle = "cwolf"
        [trials]
        run = {{ file = "{(CWOLF / "trials" / trial).as_posix()}.toml", hold_out_s = {held} }}
        [[stages]]
        name = "only"
        trials = ["run"]
        axes = {{ {axes} }}
        segment_s = 10.0
        [stages.coefficients]
    """
    return Joint(
        Campaign.from_toml(text + "\n".join(lines), source=f"{stage}.toml").problem(), truth(), threads=1
    )


@cache
def at_truth(stage: str) -> Linearisation:
    made = joint(stage)
    known = truth().coefficients()
    values = made.start.copy()
    for place, parameter in enumerate(made.parameters):
        name, factor = parameter.members[0]
        values[place] = known[name] / factor
    return linearise(made, values)


def shift(stage: str, change: Mapping[str, float]) -> float:
    """Root mean square, in standard deviations, by which the flights move with some coefficients."""
    made, lin = joint(stage), at_truth(stage)
    start = np.zeros((len(lin.pieces), 12))
    moved = lin.values + [change.get(one.name, 0.0) for one in lin.unknowns]
    pairs = zip(made.residuals(lin.values, start), made.residuals(moved, start), strict=True)
    return math.sqrt(np.mean([((a - b) ** 2).mean(axis=0) / lin.noise**2 for a, b in pairs]))


def sentence(found: Identifiability, *names: str) -> str:
    """The sentence about exactly these coefficients."""
    matching = [one.sentence for one in found.combinations if set(one.names) == set(names)]
    assert len(matching) == 1, found.sentences
    return matching[0]


def test_inertia_and_added_inertia_act_only_as_a_sum() -> None:
    found = judge(at_truth("pitch"))
    assert found.verdicts["I_y"] == found.verdicts["M_qdot"] == "not identifiable"
    told = sentence(found, "I_y", "M_qdot")
    assert "only their sum I_y - M_qdot acts" in told
    assert "bifilar pendulum" in told
    # 10 kg m2 more with the same I_y - M_qdot: the same flight but for rounding. I_y alone is seen.
    assert shift("pitch", {"I_y": 10.0, "M_qdot": 10.0}) < 1e-9
    assert shift("pitch", {"I_y": 10.0}) > 0.05
    others = set(found.names) - {"I_y", "M_qdot", *ROLL}
    assert {found.verdicts[name] for name in others} == {"identifiable"}
    assert len(found.sentences) == 2


def test_cross_flow_drag_is_seen_only_as_a_product_with_sway_locked() -> None:
    locked, free = judge(at_truth("turn, sway locked")), judge(at_truth("turn"))
    assert locked.verdicts["Y_vv"] == "not identifiable"
    assert locked.verdicts["N_rr"] == "identifiable"
    told = sentence(locked, "Y_vv")
    assert "only the product C_Dy C_Dr shows, as N_rr" in told
    assert "free Y" in told
    assert "turning circles" in told
    assert shift("turn, sway locked", {"Y_vv": -300.0}) == 0.0
    assert free.verdicts["Y_vv"] == free.verdicts["N_rr"] == "identifiable"
    assert not any("C_Dy" in one for one in free.sentences)


@pytest.mark.parametrize("stage", ["surge", "dive", "turn", "pitch"])
def test_roll_is_seen_in_none_of_the_four_stages(stage: str) -> None:
    found = judge(at_truth(stage))
    assert {found.verdicts[name] for name in ROLL} == {"not identifiable"}
    told = sentence(found, *ROLL)
    assert "record a free decay in roll" in told
    assert "rolls" in told or "roll;" in told


def test_roll_is_seen_in_a_free_decay() -> None:
    found = judge(at_truth("roll"))
    assert set(found.verdicts.values()) == {"identifiable"}
    assert found.sentences == ()
    assert warnings_before(at_truth("roll")) == []


def test_thrust_scale_needs_a_bench_test() -> None:
    found = judge(at_truth("surge"))
    scaled = ("X_udot", "X_u", "X_uu", "stern.p1_ahead", "stern.p1_astern", "stern.p2")
    assert "measure the thrust on a bench (bollard test)" in sentence(found, *scaled)
    # X_udot takes the factor for the fixed dry mass too. The flight moves by a fortieth of what it does with
    # the thrust alone: the net weight and the sums of the other axes are fixed.
    lin = at_truth("surge")
    values = dict(zip((one.name for one in lin.unknowns), lin.values, strict=True))
    apparent = truth().mass_matrix()[0][0]
    together = {name: 0.1 * values[name] for name in scaled} | {"X_udot": -0.1 * apparent}
    thrust = {name: change for name, change in together.items() if name.startswith("stern")}
    assert shift("surge", together) < 0.05 * shift("surge", thrust)


def test_warning_before_optimising_names_condition_and_combination() -> None:
    made = joint("pitch")
    told = [words.sentence(finding) for finding in warnings_before(linearise(made, made.start))]
    assert "condition number" in told[0]
    assert "K_p" in told[0]
    assert any("only their sum I_y - M_qdot acts" in one for one in told[1:])
