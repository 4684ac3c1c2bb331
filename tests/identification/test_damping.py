"""Quadratic damping or strips: how much likelier one of them must be."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from seatrial.estimation.estimator import COMPARISONS
from seatrial.identification import choice
from seatrial.identification.choice import likelier_by


def test_a_gain_of_likelihood_is_held_against_chance() -> None:
    """The same gain in every block is no chance; one block that gains what others lose is."""
    before = np.array([100.0, 120.0, 90.0, 110.0])
    assert likelier_by(before, before + 3.0) == (12.0, 0.0)
    gain, chance = likelier_by(before, before + np.array([40.0, -30.0, 20.0, -18.0]))
    assert gain == pytest.approx(12.0)
    assert chance == pytest.approx(3.0 * np.std([40.0, -30.0, 20.0, -18.0]) * 2.0)
    assert gain < chance
    assert likelier_by(before, before * np.nan) == (-np.inf, 0.0)
    assert likelier_by(before * np.nan, before) == (np.inf, 0.0)


def test_strips_are_tried_on_slender_hulls_only() -> None:
    """A box of 0.46 m by 0.58 m has no strips along which a cross-flow could change."""

    def tried(**measures: float) -> bool:
        joint = SimpleNamespace(
            comparison=COMPARISONS["innovations"],
            unknowns=(),
            vehicle=SimpleNamespace(geometry=lambda: measures),
        )
        try:
            choice.quadratic_or_strips(joint, SimpleNamespace(interrupted=False))  # type: ignore[arg-type]
        except AttributeError as asked:  # it goes on to ask the campaign
            return asked.name == "hidden"
        return False

    assert tried(length=1.33, diameter=0.19, height=0.19)
    assert tried()
    assert not tried(length=0.46, diameter=0.58, height=0.25)
    assert not tried(length=0.6, diameter=0.2, height=0.25)


@pytest.mark.parametrize(
    ("kept", "anew", "best"), [(5.0, 7.0, "anew"), (7.0, 5.0, "kept"), (7.0, np.nan, "kept")]
)
def test_of_the_estimates_with_noises_kept_and_found_anew_the_likelier_one_stays(
    kept: float, anew: float, best: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the noises of a wrong damping a log had strips end 720 in log-likelihood below their best."""
    joint = SimpleNamespace(noise_model="kept")

    def polished(*_: object, **__: object) -> SimpleNamespace:
        joint.noise_model = joint.noise_model or "anew"
        return SimpleNamespace(values=joint.noise_model, interrupted=False)

    def judge(_: object) -> SimpleNamespace:
        return SimpleNamespace(likelihoods=lambda values: np.array([{"kept": kept, "anew": anew}[values]]))

    monkeypatch.setattr(choice, "polish", polished)
    monkeypatch.setattr(choice, "Innovations", judge)
    found = choice._likeliest(joint, ["kept", None], np.zeros(1), 6, None)  # type: ignore[arg-type, list-item]
    assert found.values == best
    assert joint.noise_model == best
