"""Where searches begin: margins with few factors first, groups with the gains so far."""

from __future__ import annotations

import pytest

import seatrial as st
from seatrial.control_design.tuning_table import TuningTable
from seatrial.identification.fitted import Fitted
from seatrial.tuning.control_problem import ControlProblem
from seatrial.tuning.search import search_group, search_margins
from tests.tuning.tuning_campaigns import plan


@pytest.mark.long
def test_few_factors_for_all_points_are_tried_first_where_margins_are_short() -> None:
    one = ControlProblem.of_table(TuningTable(), Fitted.of("remus100"), st.Autopilot.load("remus100"))
    result = search_margins(one, seed=5)
    assert result is not None
    assert result.before["margin"] > 0.5
    assert result.after["margin"] < 1e-3
    # The schedule keeps its shape: one factor for all points.
    before = one.autopilot.gains()
    factors = [value / before[name] for name, value in result.gains.items() if name.startswith("pitch.K_D.")]
    assert len(factors) > 3
    assert factors == pytest.approx([factors[0]] * len(factors))


def test_a_group_begins_with_the_gains_so_far_where_one_factor_moves_several_points() -> None:
    one = plan()
    (group,) = one.groups
    start_gains = one.autopilot.gains()
    apart = {f"heading.K_P.{i}": (1.0 + 0.1 * i) * start_gains[f"heading.K_P.{i}"] for i in range(1, 6)}
    rig = one.rig(one.autopilot.with_gains(apart), max_step_s=0.04, threads=1)
    samples = one.samples(0, 1)
    found_ = search_group(one, group, rig, samples, seed=1, start=apart)
    sums, *_ = rig.violations(group.trials[0], samples, {})
    assert found_.before["violation"] == pytest.approx(
        1.1 * sums[..., :2].sum(axis=-1).mean(axis=1)[0].max(), rel=1e-6
    )
