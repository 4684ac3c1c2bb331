"""The step of a stage: a bound that holds over the whole bounds box."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks import four_stages
from seatrial._core import Vehicle
from seatrial.estimation.descent import Criterion
from seatrial.estimation.segment_model import STEP_SETTINGS, SegmentModel, around, stage_step
from seatrial.estimation.stage import plan
from seatrial.problem.parameter import Parameter


def parameter(name: str, lower: float, upper: float) -> Parameter:
    return Parameter(name, ((name, 1.0),), "", 0.5 * (lower + upper), lower, upper, True)


def test_surge_alone_has_the_rate_of_its_damping() -> None:
    vehicle = Vehicle.load("beluga")  # no inflow: its thrust comes from a table
    values = vehicle.coefficients()
    mass = values["m"] - values["X_udot"]
    step = stage_step(vehicle, (), free="X", speeds=np.array([0.5, 0, 0, 0, 0, 0]), dt=0.1)
    rate = (-values["X_u"] - 2 * values["X_uu"] * 1.2 * 0.5) / mass
    # The rate is found by central differences: 1e-4 relative; 1.1 is the margin, 1.2 that of the speed.
    assert step.rate == pytest.approx(1.1 * rate, rel=1e-4)


def test_lightest_and_most_damped_corner_sets_the_step() -> None:
    vehicle = Vehicle.load("beluga")
    speeds = np.array([0.5, 0, 0, 0, 0, 0])
    roaming = (parameter("X_udot", -150.0, -1.0), parameter("X_uu", -300.0, -10.0))
    bound = stage_step(vehicle, roaming, free="X", speeds=speeds, dt=0.1)
    corner = vehicle.with_coefficients({"X_udot": -1.0, "X_uu": -300.0})
    alone = stage_step(corner, (), free="X", speeds=speeds, dt=0.1)
    assert bound.rate == pytest.approx(alone.rate, rel=1e-9)  # the same corner, found by the search
    assert bound.substeps > stage_step(vehicle, (), free="X", speeds=speeds, dt=0.1).substeps


def test_law_no_candidate_of_the_box_is_faster_than_the_bound() -> None:
    vehicle = Vehicle.load("beluga")
    speeds = np.array([0.6, 0.5, 0.3, 0.4, 0.4, 0.8])
    names = {
        "X_udot": -80.0,
        "Y_vdot": -80.0,
        "N_rdot": -4.0,
        "X_uu": -100.0,
        "M_qq": -5.0,
        "Y_r": 0.0,
        "z_b": -0.02,
    }
    roaming = tuple(
        parameter(name, min(0.25 * value, 4 * value) - 0.01, max(0.25 * value, 4 * value))
        for name, value in names.items()
    )
    bound = stage_step(vehicle, roaming, free="XYZKMN", speeds=speeds, dt=0.1)
    assert 0.1 / bound.substeps * bound.rate <= STEP_SETTINGS.rate_limit
    assert 0.1 / bound.search * bound.rate <= STEP_SETTINGS.search_rate_limit
    generator = np.random.default_rng(5)
    for _ in range(100):
        values = {p.name: generator.uniform(p.lower, p.upper) for p in roaming}
        one = stage_step(vehicle.with_coefficients(values), (), free="XYZKMN", speeds=speeds, dt=0.1)
        assert one.rate <= bound.rate


def test_bounds_that_admit_no_mass_are_named_with_the_bound_that_passes() -> None:
    vehicle = Vehicle.load("beluga")
    mass = vehicle.coefficients()["m"]
    roaming = (parameter("X_udot", -100.0, mass - 0.05), parameter("X_u", -30.0, 0.0))
    step = stage_step(vehicle, roaming, free="X", speeds=np.full(6, 0.5), dt=0.1)
    assert step.search <= 40
    ((name, bound, good),) = step.fast
    assert (name, bound) == ("X_udot", mass - 0.05)
    said = step.sentence(0.1)
    assert "X_udot no further than" in said
    # The bound that is named passes, and a looser one does not.
    written = float(said.split("no further than ")[1].split()[0])
    assert written <= good
    for upper, fast in ((written, False), (good + 0.02 * (bound - good), True)):
        mended = (parameter("X_udot", -100.0, upper), roaming[1])
        found = stage_step(vehicle, mended, free="X", speeds=np.full(6, 0.5), dt=0.1)
        assert bool(found.fast) is fast


def test_a_vehicle_that_is_too_fast_itself_is_said() -> None:
    vehicle = Vehicle.load("beluga").with_coefficients({"X_udot": 23.99})
    step = stage_step(vehicle, (), free="X", speeds=np.full(6, 0.5), dt=0.1)
    assert "the start vehicle itself has a rate of" in step.sentence(0.1)


def test_bounds_around_points_hold_a_tenth_of_the_box_more_and_never_leave_it() -> None:
    roaming = (parameter("X_uu", -100.0, 0.0), parameter("X_u", -10.0, 0.0))
    first, second = around(roaming, np.array([[-50.0, -0.5], [-40.0, -1.0]]))
    assert (first.lower, first.upper) == pytest.approx((-60.0, -30.0))
    assert (second.lower, second.upper) == pytest.approx((-2.0, 0.0))


@pytest.mark.long
def test_step_of_the_global_search_ranks_candidates_as_a_fine_one(tmp_path: Path) -> None:
    campaign = four_stages.campaign(four_stages.write_logs(tmp_path, duration_s=62.0))
    for stage in plan(campaign.problem()):
        coarse, fine = (
            Criterion(
                SegmentModel(campaign.vehicle, stage.stage, stage.data, stage.parameters, substeps, threads=1)
            )
            for substeps in (stage.step.search, 4 * stage.step.substeps)
        )
        lower = np.array([one.lower for one in stage.parameters])
        upper = np.array([one.upper for one in stage.parameters])
        shares = np.random.default_rng(3).uniform(size=(64, len(lower)))
        candidates = lower + (upper - lower) * shares
        one, other = (criterion(candidates) for criterion in (coarse, fine))
        # Within a step of 0.1 s the end of a motor's ramp is rounded off: 3e-3 in surge, 2e-4 elsewhere.
        np.testing.assert_allclose(one, other, rtol=1e-2)
        np.testing.assert_array_equal(np.argsort(one)[:8], np.argsort(other)[:8])
