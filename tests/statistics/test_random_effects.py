"""Scatter of coefficients between parts of recordings: found where it is, and not where it is not."""

from __future__ import annotations

import numpy as np
import pytest

from seatrial.statistics.blocks import block_length
from seatrial.statistics.uncertainty import covariance, random_effects
from tests.statistics.linear_trials import Array, Design, errors, estimates, one, own_coefficients, trials

DESIGN = trials([2000] * 5, inputs=4, seed=1)
SEEDS = 40


def cover(design: Design, drawn: list[Array], inputs: int) -> tuple[float, float]:
    """Share of 95 % intervals that hold zero, and of the estimates whose coefficients scatter."""
    sure = [covariance(lin) for lin in estimates(design, drawn)]
    inside = np.mean([(u.lower <= 0.0)[:inputs] & (u.upper >= 0.0)[:inputs] for u in sure])
    return float(inside), float(np.mean([u.between.any() for u in sure]))


@pytest.mark.parametrize("rho", [0.0, 0.9])
def test_law_alike_parts_keep_their_intervals(rho: float) -> None:
    inside, scattering = cover(DESIGN, errors(DESIGN, rho, np.random.default_rng(3), SEEDS), 4)
    # A level of 2 % finds four or more of forty by chance in less than one case of a hundred.
    assert scattering <= 0.075
    assert 0.91 <= inside <= 0.99  # 160 intervals: two deviations of 0.017


@pytest.mark.parametrize("part", [600, 2000])
def test_law_intervals_hold_where_parts_differ(part: int) -> None:
    """Parts of a minute, and whole trials, have coefficients of their own."""
    rng = np.random.default_rng(5)
    sure = covariance(one(DESIGN, 0.9)).sigma[:4]
    drawn = own_coefficients(
        DESIGN, errors(DESIGN, 0.9, rng, SEEDS), 4.0 * np.sqrt(10_000 / part) * sure, rng, part=part
    )
    inside, scattering = cover(DESIGN, drawn, 4)
    assert scattering >= 0.9
    # Blocks alone hold a half where whole trials differ. Of five trials a scatter is known to a third.
    assert inside >= 0.80


def test_scatter_has_the_size_that_it_was_drawn_with() -> None:
    rng = np.random.default_rng(7)
    sd = np.array([0.0, 0.5, 1.0, 0.0])
    long = trials([6000] * 4, inputs=4, seed=1)
    drawn = own_coefficients(long, errors(long, 0.5, rng, 6), sd, rng, part=600)
    sizes = [random_effects(lin, block_length(lin)) for lin in estimates(long, drawn)]
    between = np.mean([effects.sd for effects in sizes if effects is not None], axis=0)
    # Forty parts, six draws: 5 %, and what of it passes for a longer memory of the errors.
    np.testing.assert_allclose(between[1:3], sd[1:3], rtol=0.25)
    assert (between[[0, 3]] < 0.1).all()
    assert (between[4:] < 0.1).all()


def test_two_parts_show_no_scatter() -> None:
    assert (
        random_effects(one(trials([600, 600], inputs=4, seed=1), 0.9), block_length(one(DESIGN, 0.9))) is None
    )
