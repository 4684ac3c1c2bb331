"""The table of a coverage run: what it counts, who passes, what survives a file."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from seatrial.base.run import to_json
from seatrial.experiment.coverage_result import Coverage, rows
from seatrial.experiment.repetition import Repetition


def made(seed: int, estimate: float, sigma: float, verdict: str = "identifiable") -> Repetition:
    """A draw of one coefficient whose truth is 2."""
    return Repetition(
        seed=seed,
        names=("X_u",),
        units=("N s/m",),
        kinds=("coefficient",),
        truth=(2.0,),
        estimate=(estimate,),
        sigma=(sigma,),
        lower=(estimate - 2 * sigma,),
        upper=(estimate + 2 * sigma,),
        verdict=(verdict,),
        residual_analysis=None,
        hold_out={},
        converged=True,
        rounds=3,
        wall_s=1.0,
    )


def test_the_table_counts_right() -> None:
    repetitions = [made(1, 2.5, 0.3), made(2, 1.5, 0.3), made(3, 3.0, 0.4, "weak"), made(4, 2.2, 0.4)]
    (row,) = rows(repetitions)
    assert (row.inside, row.n) == (3, 4)
    assert row.verdicts == {"identifiable": 3, "weak": 1}
    assert row.mean == pytest.approx(2.3)
    assert row.bias == pytest.approx(0.3)
    scatter = float(np.std([0.5, -0.5, 1.0, 0.2], ddof=1))
    assert row.scatter == pytest.approx(scatter)
    assert row.bias_t == pytest.approx(0.3 / (scatter / 2.0))
    assert row.sigma == pytest.approx(math.sqrt((0.09 + 0.09 + 0.16 + 0.16) / 4))


def test_too_few_intervals_that_hold_the_truth_fail_unless_it_is_outside_the_class() -> None:
    repetitions = tuple(made(seed, 2.0 if seed > 7 else 9.0, 0.3) for seed in range(1, 51))
    result = Coverage("c", "t", rows(repetitions), (), {}, repetitions, 50, False)
    assert [line for line in result.failures if "43 of 50" in line and "at least 44" in line]
    assert replace(result, outside={"Y_ur": (0.0, 5.0)}).failures == ()
    assert replace(result, rows=rows(repetitions[1:])).failures == ()  # 43 of 49 may be bad luck


def test_a_draw_survives_json() -> None:
    lost = replace(made(1, 2.0, math.inf), truth=(math.nan,), hold_out={"start": {"u": -math.inf}})
    back = Repetition.from_dict(json.loads(to_json(lost.to_dict())))
    assert back.sigma == (math.inf,)
    assert (back.lower, back.upper) == ((-math.inf,), (math.inf,))
    assert math.isnan(back.truth[0])
    assert back.hold_out == {"start": {"u": -math.inf}}
