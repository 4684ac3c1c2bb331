"""Identification of the hover AUV Beluga from its recordings, with a small budget, on held-out parts."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from seatrial.campaign.campaign import Campaign
from seatrial.estimation.joint import Joint
from seatrial.estimation.joint_estimate import linearise, polish
from seatrial.estimation.stage import plan
from seatrial.identification.identification import Identification
from seatrial.statistics.linearisation import Linearisation, Piece
from seatrial.statistics.uncertainty import Uncertainty, covariance

EXAMPLE = Path(__file__).parents[2] / "python" / "seatrial" / "examples" / "beluga"
DATA = Path(os.environ.get("SEATRIAL_DATA", "/nonexistent")) / "beluga"

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(
        not DATA.is_dir(), reason="the recordings of Beluga are not here; set SEATRIAL_DATA to their folder"
    ),
]


@cache
def identified() -> Identification:
    """The example's campaign with a third of its budget, half its data, few rounds of its joint estimate."""
    text = (EXAMPLE / "campaign.toml").read_text(encoding="utf-8")
    text = re.sub(r"(?m)^budget = .*\n", "", text)
    text = text.replace("seed = 1\n", "seed = 1\nbudget = { generations = 40, simplex_rounds = 10 }\n", 1)
    text = text.replace("rounds = 15", "rounds = 2", 1)
    text, shortened = re.subn(r"hold_out_s = \[\[[56]00\.0, ", "hold_out_s = [[300.0, ", text)
    assert shortened == 4
    return Campaign.from_toml(text, folder=EXAMPLE).identify()


def test_held_out_parts_are_predicted_ten_seconds_ahead() -> None:
    score = identified().scores["hold_out"]["ahead"]["all"]
    # With this budget and these data u .923, v .866, r .888: the margins are for other arithmetic and another
    # course of the search. Roll and pitch need the whole campaign.
    assert score["u"].r2 > 0.85
    assert score["v"].r2 > 0.78
    assert score["r"].r2 > 0.82


def test_apparent_masses_are_those_of_an_open_frame() -> None:
    # The scale is the table's thrust: several times the dry mass of 24 kg, as others found for these trials
    # (125 to 140 kg in surge). The bounds of the search admit 84 to 324 kg.
    surge, sway = np.diag(identified().vehicle.mass_matrix())[:2]
    assert 115.0 < surge < 190.0
    assert 100.0 < sway < 165.0


@pytest.mark.parametrize("name", ["campaign.toml", "campaign_logged_wrench.toml"])
def test_the_step_of_the_examples_is_coarse_enough_to_be_quick(name: str) -> None:
    plans = plan(Campaign.load(EXAMPLE / name).problem())
    assert max(one.step.substeps for one in plans) <= 6


@pytest.mark.parametrize("run", ["surge-1", "sway-1", "yaw-1", "random-1"])
def test_the_frame_of_the_motion_capture_is_tilted_alike_in_all_runs(run: str) -> None:
    tilt = Campaign.load(EXAMPLE / "campaign.toml").trials[run].report.tilt
    assert tilt is not None
    # four runs on one day, each within its own deviation of 0.1 to 0.4 deg
    np.testing.assert_allclose(np.rad2deg(tilt), [2.0, -2.7], atol=0.6)


@cache
def linearised() -> Linearisation:
    """The joint estimate of the whole example, begun at what half of its data told."""
    joint = Joint(Campaign.load(EXAMPLE / "campaign.toml").problem(), identified().vehicle, threads=2)
    estimate = polish(joint)
    return linearise(joint, estimate.values, initial=estimate.initial, noise=estimate.noise)


def alone(whole: Linearisation, chosen: Callable[[Piece], bool]) -> tuple[Linearisation, Uncertainty]:
    """The estimate from a part of the segments, one step from that of all, and its uncertainty."""
    part = replace(whole, pieces=tuple(piece for piece in whole.pieces if chosen(piece)))
    information = part.information()
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    inverse = np.linalg.pinv(information / np.outer(size, size), rcond=1e-9, hermitian=True)
    step = np.asarray(inverse @ (part.gradient() / size) / size, dtype=float)
    pieces = tuple(
        replace(p, residual=np.where(p.counted, p.residual - p.jacobian @ step, 0.0)) for p in part.pieces
    )
    part = replace(part, values=part.values + step, pieces=pieces)
    return part, covariance(part)


@pytest.mark.parametrize("divided", ["halves", "minutes"])
def test_law_intervals_hold_between_parts_of_the_recordings(divided: str) -> None:
    """First against second halves of every run, odd against even minutes: what both know agrees."""
    whole = linearised()
    middle = {
        name: np.median([piece.t.mean() for piece in whole.pieces if piece.trial == name])
        for name in {piece.trial for piece in whole.pieces}
    }

    def second(piece: Piece) -> bool:
        time = float(piece.t.mean())
        return time > middle[piece.trial] if divided == "halves" else time // 60 % 2 == 1

    (one, sure), (other, as_sure) = alone(whole, lambda p: not second(p)), alone(whole, second)
    own = [unknown.kind == "coefficient" for unknown in whole.unknowns]
    free = [a is None and b is None for a, b in zip(sure.at_bound, as_sure.at_bound, strict=True)]
    known = np.array(own) & free
    for part, uncertainty in ((one, sure), (other, as_sure)):
        known &= uncertainty.sigma < 0.25 * np.abs(part.values)
    away = ((one.values - other.values) / np.hypot(sure.sigma, as_sure.sigma))[known]
    # What the deviations of blocks call known differs by 1.7 of them.
    assert len(away) >= 6
    assert np.mean(np.abs(away) < 1.96) >= 0.9
    assert np.sqrt(np.mean(away**2)) < 1.3
