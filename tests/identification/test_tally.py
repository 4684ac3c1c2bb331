"""How many of the coefficients the trials determine: the first word, the first sentence and the exit code."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from seatrial._core import State, Vehicle
from seatrial.campaign.campaign import Campaign
from seatrial.cli import app
from seatrial.identification.estimate import Estimate, Tally, tally
from seatrial.identification.identification import Identification

CAMPAIGN = """
format = 1
name = "ahead-only"
vehicle = "cwolf"
[trials.run]
file = "run.parquet"
[[stages]]
name = "all"
trials = ["run"]
axes = { free = "XYN", measured = "ZKM" }
budget = { population = 8, generations = 2 }
[stages.coefficients]
X_uu = "default"
Y_v = "default"
Y_vv = "default"
Y_vdot = "default"
N_r = "default"
N_rr = "default"
N_rdot = "default"
"""


@pytest.mark.parametrize(
    ("counts", "outcome", "words"),
    [
        ((20, 0, 0, 0, 0), "identified", "The trials determine all 20 coefficients."),
        ((1, 0, 0, 0, 0), "identified", "The trials determine the one coefficient."),
        ((11, 9, 0, 0, 0), "identified", "11 of 20 coefficients; 9 weak."),
        ((4, 4, 6, 0, 0), "partly identified", "4 of 14 coefficients; 4 weak, 6 not identifiable."),
        ((0, 3, 2, 0, 0), "weakly identified", "0 of 5 coefficients; 3 weak, 2 not identifiable."),
        ((1, 0, 19, 0, 0), "mostly not identified", "1 of 20 coefficients; 19 not identifiable."),
        (
            (5, 0, 3, 5, 0),
            "mostly not identified",
            "13 coefficients; 3 not identifiable, 5 hidden by feedback.",
        ),
        ((0, 0, 1, 0, 0), "not identified", "0 of 1 coefficient; 1 not identifiable."),
        ((0, 0, 0, 0, 7), "identified", "Whether the trials determine the 7 coefficients is not judged."),
        ((10, 0, 10, 0, 0), "partly identified", "10 of 20 coefficients; 10 not identifiable."),
    ],
)
def test_outcome_and_sentence_follow_the_counts(
    counts: tuple[int, int, int, int, int], outcome: str, words: str
) -> None:
    found = Tally(*counts)
    assert found.outcome == outcome
    assert found.sentence.endswith(words)
    assert found.mostly_lost == outcome.endswith("not identified")


def test_equal_coefficients_of_a_group_are_one_and_held_ones_are_asked_for() -> None:
    one = Estimate("a.gain", "1", 1.0, 0.9, 0.5, 1.5, None, "yaw", "group.gain", verdict="weak")
    alike = replace(one, name="b.gain")
    other = replace(one, name="X_u", parameter="X_u", estimate=-3.0, verdict="identifiable")
    found = tally((one, alike, other), held=["Y_v", "Y_v"])
    assert found == Tally(identifiable=1, weak=1, not_identifiable=0, held=1, not_judged=0)


def test_a_trial_that_tells_hardly_anything_is_called_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(7)
    vehicle, t = Vehicle.load("cwolf"), np.arange(0.0, 40.0, 0.1)
    steps = np.repeat(rng.uniform(-1500.0, 1500.0, 8), 50)
    commands = {name: steps * (name[:2] in ("Sb", "PU", "PL")) for name in vehicle.actuators}
    nu = np.asarray(vehicle.simulate(t, commands, State(), free="X").nu) + rng.normal(0.0, 0.01, (len(t), 6))
    motion = {"u_m_s": nu[:, 0], "v_m_s": nu[:, 1], "w_m_s": 0.0 * t, "p_deg_s": 0.0 * t, "q_deg_s": 0.0 * t}
    motion |= {"r_deg_s": np.rad2deg(nu[:, 5]), "roll_deg": 0.0 * t, "pitch_deg": 0.0 * t, "yaw_deg": 0.0 * t}
    pl.DataFrame({"t_s": t, **motion, **{f"cmd.{n}": c for n, c in commands.items()}}).write_parquet(
        "run.parquet"
    )
    Path("campaign.toml").write_text(CAMPAIGN)
    result = CliRunner().invoke(app, ["identify", "campaign.toml", "--out", "run", "--figures", "none"])
    assert result.exit_code == 0, result.output
    first = " ".join(result.stdout.split("Worst:")[0].split())
    assert first.startswith("ahead-only: mostly not identified. The trials determine 1 of 7 coefficients; ")
    known = json.loads(Path("run", "identification.json").read_text())
    assert known["outcome"] == "mostly not identified"
    assert known["tally"]["identifiable"] == 1
    assert sum(known["tally"].values()) == 7
    cells = [line.split() for line in result.stdout.splitlines() if line.startswith((" X_uu ", " Y_v "))]
    assert "identifiable" in cells[0]  # no verdict is left to be guessed from an empty cell
    Vehicle.load("run/vehicle.toml")


def test_what_is_known_beforehand_is_not_asked_for() -> None:
    # Gains of single thrusters with a prior allow for what is not known exactly; K_p is sought.
    text = (
        CAMPAIGN
        + '[polish.coefficients]\n"SbU.gain" = { bounds = [0.5, 1.5], sd = 0.1 }\nK_p = [-3.0, 0.0]\n'
    )
    campaign = Campaign.from_toml(text)
    one = Estimate("SbU.gain", "1", 1.0, 1.0, 0.5, 1.5, None, "all", "SbU.gain", verdict="not identifiable")
    rows = (
        one,
        replace(one, name="K_p", parameter="K_p", estimate=-1.0, verdict="weak"),
        replace(one, name="X_uu", parameter="X_uu", estimate=-9.0, verdict="identifiable"),
    )
    fit = SimpleNamespace(problem=campaign.problem(), coefficients=rows, held=())
    assert Identification.tally.fget(fit) == Tally(1, 1, 0, 0, 0)  # type: ignore[attr-defined]
