"""An estimate that makes up for a bound is refused; a bound against which noise alone pushes refuses none."""

from __future__ import annotations

import numpy as np
import pytest

from seatrial.diagnosis.assessment import ContradictedBounds, contradicted_bounds
from seatrial.statistics.linearisation import Linearisation, Piece, Unknown
from seatrial.statistics.uncertainty import covariance


def found(damping: float, *, seed: int, samples: int = 4000) -> ContradictedBounds | None:
    """A moment `gain * x + damping * y` with x and y alike, estimated with damping at most zero."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal(samples)
    design = np.stack([x, x + 0.5 * rng.standard_normal(samples)], axis=1)
    measured = design @ np.array([2.0, damping]) + rng.standard_normal(samples)
    free = np.linalg.lstsq(design, measured, rcond=None)[0]
    alone = np.linalg.lstsq(design[:, :1], measured, rcond=None)[0][0]
    values = free if free[1] < 0.0 else np.array([alone, 0.0])
    piece = Piece(
        "tank",
        np.linspace(0.0, 0.1 * (samples - 1), samples),
        (measured - design @ values)[:, None],
        np.ones((samples, 1), bool),
        np.ones((samples, 1)),
        design[:, None, :],
        np.zeros((samples, 6)),
    )
    unknowns = (
        Unknown("rudder.gain", "coefficient", "1", 0.0, 9.0, 9.0, 0.0, np.inf),
        Unknown("N_r", "coefficient", "N m s", -40.0, 0.0, 40.0, 0.0, np.inf),
    )
    lin = Linearisation(unknowns, values, ("r",), np.ones(1), 0.1, (piece,))
    return contradicted_bounds(lin, covariance(lin))


def test_a_gain_that_makes_up_for_a_bound_is_refused_with_its_value_without_it() -> None:
    bounds = found(1.0, seed=1)
    assert bounds is not None
    assert bounds.refused == ("rudder.gain",)
    assert bounds.values["rudder.gain"] == pytest.approx(2.0, abs=0.1)
    assert bounds.values["N_r"] == pytest.approx(1.0, abs=0.1)
    assert bounds.pulls["N_r"] > 10.0
    assert bounds.away["rudder.gain"] < -10.0


def test_noise_against_a_bound_refuses_nothing() -> None:
    assert all(found(0.0, seed=seed) is None for seed in range(40))


def test_no_bound_is_contradicted_inside_of_it() -> None:
    assert found(-1.0, seed=1) is None
