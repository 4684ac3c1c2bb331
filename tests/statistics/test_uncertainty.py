"""Uncertainty of estimates whose truth is known: cover, memory, what is not determined, priors, bounds."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from seatrial.base.errors import CampaignError
from seatrial.base.run import to_json
from seatrial.diagnosis.assessment import bootstrap, profile
from seatrial.statistics.blocks import autocorrelation, block_length, divided, information_criteria
from seatrial.statistics.linearisation import CONTRADICTED, Linearisation
from seatrial.statistics.uncertainty import Uncertainty, covariance, tempering
from tests.statistics.linear_trials import Array, Design, errors, estimates, flat, one, trials, with_column

SEEDS = 300
SLOW = trials([600, 600], inputs=4, seed=1)


def spread_and_intervals(rho: float) -> tuple[Array, list[Uncertainty]]:
    found = estimates(SLOW, errors(SLOW, rho, np.random.default_rng(3), SEEDS))
    return np.std([lin.values for lin in found], axis=0), [covariance(lin) for lin in found]


@pytest.fixture(scope="module")
def coloured() -> tuple[Array, list[Uncertainty]]:
    return spread_and_intervals(0.9)


def covered(found: list[Uncertainty]) -> Array:
    return np.asarray(np.mean([(u.lower <= 0) & (u.upper >= 0) for u in found], axis=0))


def check_cover(found: list[Uncertainty]) -> None:
    # 300 draws of probability 0.95 have a standard deviation of 0.013: 0.91 is three of them below.
    assert covered(found).min() >= 0.91
    # All unknowns together: intervals are neither short nor empty of meaning.
    assert 0.93 <= covered(found).mean() <= 0.985


@pytest.mark.long
def test_law_intervals_cover_with_white_errors() -> None:
    check_cover(spread_and_intervals(0.0)[1])


@pytest.mark.long
def test_law_intervals_cover_with_coloured_errors(coloured: tuple[Array, list[Uncertainty]]) -> None:
    check_cover(coloured[1])


@pytest.mark.long
def test_law_independent_samples_are_an_illusion(coloured: tuple[Array, list[Uncertainty]]) -> None:
    true, found = coloured
    slow = [0, 2, 4, 5]  # stepped and drifting inputs, biases
    naive = np.median([u.naive for u in found], axis=0)
    assert (naive[slow] < true[slow] / 3.0).all()
    assert (
        covered([
            replace(u, lower=u.estimate - 1.96 * u.naive, upper=u.estimate + 1.96 * u.naive) for u in found
        ])[slow].max()
        < 0.6
    )
    sigma = np.median([u.sigma for u in found], axis=0)
    # The memory's estimate errs by a fifth in a record of 60 memories.
    np.testing.assert_allclose(sigma, true, rtol=0.25)


def test_law_deviations_do_not_hang_on_where_blocks_end() -> None:
    design = trials([1500, 1500, 1500], inputs=12, seed=1)
    lin = estimates(design, errors(design, 0.9, np.random.default_rng(0), 1), piece=30)[0]
    length, found = block_length(lin), covariance(lin).sigma
    for factor in (0.9, 0.95, 1.05, 1.1):
        other = replace(length, samples=round(factor * length.samples))
        # With a single division into blocks these lengths move single deviations by 22 to 32 %.
        np.testing.assert_allclose(covariance(lin, length=other).sigma, found, rtol=0.12)


def test_law_bootstrap_agrees_with_the_sandwich() -> None:
    lin = one(trials([6000, 6000], inputs=4, seed=2), 0.8)
    again = bootstrap(lin, draws=2000, seed=5)
    found = covariance(lin)
    # 2000 draws give a standard deviation to 2 %; what is left is 1/blocks, of which there are 70.
    np.testing.assert_allclose(again.sigma, found.sigma, rtol=0.12)
    np.testing.assert_allclose(again.upper - again.lower, found.upper - found.lower, rtol=0.2)
    np.testing.assert_array_equal(
        bootstrap(lin, draws=50, seed=5).draws, bootstrap(lin, draws=50, seed=5).draws
    )


def test_duplicated_column_is_not_determined() -> None:
    base = trials([600, 600], inputs=4, seed=1)
    twin = with_column(base, flat("twin"), [2.5 * jacobian[:, :, 1] for jacobian in base.jacobians])
    found = covariance(one(twin, 0.5))
    assert np.isinf(found.sigma).tolist() == [False, True, False, False, False, False, True]
    assert np.isinf(found.naive[[1, 6]]).all()
    assert (found.upper[[1, 6]] == math.inf).all()
    assert (found.lower[[1, 6]] == -math.inf).all()
    others = [0, 2, 3, 4, 5]
    alone = covariance(one(base, 0.5))
    # The rest does not feel it; squared condition of the scaled information times rounding.
    np.testing.assert_allclose(found.sigma[others], alone.sigma[others], rtol=1e-6)
    assert np.isinf(bootstrap(one(twin, 0.5), draws=10, seed=0).sigma[[1, 6]]).all()


def test_unseen_unknown_is_not_determined() -> None:
    unseen = with_column(SLOW, flat("unseen"), [np.zeros(j.shape[:2]) for j in SLOW.jacobians])
    found = covariance(one(unseen, 0.0))
    assert found.sigma[-1] == math.inf
    assert np.isfinite(found.sigma[:-1]).all()


def test_prior_alone_keeps_its_standard_deviation() -> None:
    unseen = with_column(SLOW, flat("held", prior_sd=0.3), [np.zeros(j.shape[:2]) for j in SLOW.jacobians])
    lin = one(unseen, 0.9)
    found = covariance(lin)
    # Exact: no data, so the sandwich is the prior; 1.959964 is the normal quantile.
    assert found.sigma[-1] == pytest.approx(0.3, rel=1e-9)
    assert found.upper[-1] == pytest.approx(0.3 * 1.959964, rel=1e-6)
    # 4000 draws give a standard deviation to 1.1 %.
    assert bootstrap(lin, draws=4000, seed=1).sigma[-1] == pytest.approx(0.3, rel=0.04)


def test_prior_and_data_add_up() -> None:
    seen = [j[:, :, 1] for j in SLOW.jacobians]
    free = covariance(one(with_column(trials([600, 600], inputs=1, seed=1), flat("seen"), seen), 0.0))
    held = with_column(trials([600, 600], inputs=1, seed=1), flat("seen", prior_sd=0.02), seen)
    both = covariance(one(held, 0.0))
    expected = (free.naive[-1] ** -2 + 0.02**-2) ** -0.5
    assert both.naive[-1] == pytest.approx(expected, rel=1e-9)
    # The sandwich of white errors is the naive value but for the scatter of 27 blocks (1/sqrt(2*27) = 14 %).
    assert both.sigma[-1] == pytest.approx(expected, rel=0.3)
    assert both.dof[-1] > free.dof[-1]


def test_bounds_are_marked() -> None:
    base = trials([400], inputs=3, seed=1)
    lin = one(base, 0.0)
    box = (
        replace(base.unknowns[0], lower=lin.values[0] - 0.004, upper=lin.values[0] + 0.996),
        replace(base.unknowns[1], lower=lin.values[1] - 0.996, upper=lin.values[1] + 0.004),
        replace(base.unknowns[2], lower=lin.values[2] - 0.006, upper=lin.values[2] + 0.994),
        base.unknowns[3],
    )
    found = covariance(replace(lin, unknowns=box))
    assert found.at_bound == ("lower", "upper", None, None)


def moved(lin: Linearisation, step: Array) -> Linearisation:
    """The same data seen from another point of the linear model."""
    pieces = tuple(
        replace(p, residual=np.where(p.counted, p.residual - p.jacobian @ step, 0.0)) for p in lin.pieces
    )
    return replace(lin, values=lin.values + step, pieces=pieces)


def posterior(lin: Linearisation, centre: Array, sd: float) -> Linearisation:
    """Maximum of the posterior, the first unknowns known beforehand."""
    known = tuple(replace(u, prior=float(x), prior_sd=sd) for u, x in zip(lin.unknowns, centre, strict=False))
    lin = replace(lin, unknowns=known + lin.unknowns[len(known) :])
    for _ in range(2):  # the tempering follows the estimate
        lin = replace(lin, tempering=tempering(lin))
        for _ in range(5):  # Huber's weights follow it too
            lin = moved(lin, np.asarray(np.linalg.solve(lin.information(), lin.gradient()), dtype=float))
    return lin


@pytest.mark.parametrize("sd", [0.05, 0.15])
def test_law_priors_and_correlated_data_give_intervals_that_cover(sd: float) -> None:
    """No interval wider than the prior's, and no estimate worse than that of the data alone or the prior."""
    rng, seeds, known = np.random.default_rng(8), 60, 4
    design = trials([300, 300], inputs=known, seed=1)  # three slow inputs and a white one
    alone = estimates(design, errors(design, 0.9, rng, seeds))
    both = [posterior(lin, sd * rng.normal(size=known), sd) for lin in alone]
    sure = [covariance(lin) for lin in both]
    assert max(u.sigma[:known].max() for u in sure) <= 1.02 * sd  # the tempering is that of a step before
    # 240 intervals of probability 0.95, of which those of a seed depend on one another: 0.90 is three off.
    assert 0.90 <= covered(sure)[:known].mean() <= 0.995
    size = [np.sqrt(np.mean([lin.values[:known] ** 2 for lin in some], axis=0)) for some in (both, alone)]
    # Root mean squares of 60 draws err by a tenth.
    assert (size[0] <= 1.2 * np.minimum(size[1], sd)).all()
    # The slow inputs have the memory of the errors, (1 + 0.9) / (1 - 0.9) = 19, the white one none.
    found = np.median([lin.tempering for lin in both], axis=0)
    assert found[0] > 6.0 > 2.0 > found[3]
    np.testing.assert_array_equal(tempering(alone[0]), 1.0)


def test_a_wrong_belief_pulls_no_further_than_its_weight() -> None:
    lin = one(trials([300, 300], inputs=4, seed=1), 0.9)
    sure = covariance(lin).sigma[0]
    beliefs = (np.array([away * sure, 0.0, 0.0, 0.0]) for away in (0.5, 5.0, 50.0))
    near, far, farther = (posterior(lin, belief, float(sure)) for belief in beliefs)
    step = (far.values - lin.values)[0]
    # As sure as the data: a squared pull leads half of the way.
    assert (near.values - lin.values)[0] == pytest.approx(0.5 * (0.5 * sure - lin.values[0]), rel=0.5)
    assert abs(step) < CONTRADICTED * 1.5 * sure
    assert (farther.values - lin.values)[0] == pytest.approx(step, rel=0.2)


def test_pull_on_a_held_unknown_is_no_scatter() -> None:
    lin = one(SLOW, 0.5)
    length = block_length(lin)
    away = moved(lin, 20.0 * covariance(lin).naive * [1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    # Exact in a linear model: the scores are taken at the optimum that the linearisation points to.
    np.testing.assert_allclose(
        covariance(away, length=length).sigma, covariance(lin, length=length).sigma, rtol=1e-9
    )


def test_correlated_channels_count_once() -> None:
    rng = np.random.default_rng(4)
    base = trials([4000], inputs=0, seed=0)
    both = replace(base, jacobians=(np.ones((4000, 2, 1)),))
    error = rng.normal(size=(4000, 1, 1)).repeat(2, axis=2)
    found = covariance(estimates(both, [error])[0])
    # Two channels with the same error are one: sqrt(2), to the scatter of 48 blocks (10 %).
    assert found.sigma[0] / found.naive[0] == pytest.approx(math.sqrt(2.0), rel=0.25)


def test_one_short_manoeuvre_is_named_and_not_trusted() -> None:
    base = trials([1500, 1500, 60], inputs=4, seed=6)
    decay = np.exp(-np.arange(60) / 30.0)[:, None].repeat(2, axis=1)
    column = [np.zeros((1500, 2)), np.zeros((1500, 2)), decay]
    found = covariance(one(with_column(base, flat("roll"), column), 0.9))
    assert found.alone.tolist() == [False] * 6 + [True, True]
    # Errors with a memory of 19 samples: 4.4 times the naive value, as if the decay were slow.
    assert 2.0 < found.sigma[-1] / found.naive[-1] < 6.0


def test_block_length_of_white_and_coloured_errors() -> None:
    base = trials([3000, 3000], inputs=4, seed=2)
    white = block_length(one(base, 0.0))
    # No memory: 1.3 sqrt(6000 samples), of which two that segments share count once.
    assert white.samples == round(1.3 * math.sqrt(6000))
    assert white.seconds == pytest.approx(0.1 * white.samples)
    np.testing.assert_array_equal(white.memory, 1.0)
    np.testing.assert_array_equal(white.effective, 6000)
    coloured = block_length(one(base, 0.95))
    # (1 + rho)/(1 - rho) = 39; flat-top estimates of it scatter by a quarter with 150 memories.
    np.testing.assert_allclose(coloured.memory, 39.0, rtol=0.4)
    assert coloured.samples > 2 * coloured.memory.max()
    np.testing.assert_allclose(coloured.effective * coloured.memory, 6000)


@pytest.mark.parametrize("samples", [1, 2, 3, 7, 40])
def test_block_is_never_longer_than_a_quarter_of_the_data(samples: int) -> None:
    base = trials([max(samples, 2)], inputs=0, seed=0)
    lin = one(base, 0.99)
    piece = replace(lin.pieces[0], counted=np.arange(max(samples, 2))[:, None].repeat(2, 1) < samples)
    length = block_length(replace(lin, pieces=(piece,)))
    assert 1 <= length.samples <= max(1, samples // 4)
    assert np.isfinite(covariance(lin).sigma).all()


def test_a_gap_is_not_bridged() -> None:
    base = trials([400], inputs=0, seed=0)
    rng = np.random.default_rng(0)
    once = rng.normal(size=(200, 1, 2))
    lin = estimates(base, [np.concatenate([once, once])], piece=200)[0]
    first, second = lin.pieces
    # The second half repeats the first: plainly seen 200 samples later, unless the clock puts it elsewhere.
    joined = autocorrelation(lin, 399)
    late = replace(lin, pieces=(first, replace(second, t=second.t + 1000.0)))
    assert joined[0, 200] > 0.9
    apart = autocorrelation(late, 399)
    np.testing.assert_array_equal(apart[:, 201:], 0.0)
    # Within a piece it stays: pairs of 200 white samples, five standard deviations.
    assert np.abs(apart[:, 1:100]).max() < 0.5
    np.testing.assert_allclose(divided(late, block_length(late))[0].score.sum(axis=0), 0.0, atol=1e-9)


def test_block_spans_segments_but_not_trials() -> None:
    lin = one(trials([600, 600], inputs=2, seed=3), 0.9)
    whole = replace(block_length(lin), samples=100_000)
    data = divided(lin, whole)[0]
    assert len(data.score) == 2
    short = divided(lin, replace(whole, samples=50))[0]
    # Eleven segments in each trial, none of which holds two blocks.
    assert len(short.score) == 22
    # Sums of the same numbers in another order.
    np.testing.assert_allclose(short.score.sum(axis=0), data.score.sum(axis=0), atol=1e-9)
    np.testing.assert_allclose(data.information.sum(axis=0), lin.information(), rtol=1e-12)
    # A bias belongs to one trial: the other's block says nothing of it.
    assert data.information[0, -1, -1] == 0.0


def test_lit_huber_slope_replaces_the_weight() -> None:
    """Variance of Huber's location estimate, E psi^2 / (E psi')^2 / n (Huber 1964, eq. 8)."""
    rng = np.random.default_rng(2)
    n, knee = 20000, 0.7
    lin = one(replace(trials([n], inputs=0, seed=0, channels=1), jacobians=(np.ones((n, 1, 1)),)), 0.0)
    error = rng.normal(size=n + 1)
    pieces, at = [], 0
    for piece in lin.pieces:
        e = error[at : at + len(piece.t), None]
        at += len(piece.t) - 1
        weight = knee / np.maximum(np.abs(e), knee)
        pieces.append(replace(piece, residual=np.where(piece.counted, e, 0.0), weight=weight))
    found = covariance(replace(lin, pieces=tuple(pieces)))
    inside = math.erf(knee / math.sqrt(2.0))
    square = inside - 2.0 * knee * math.exp(-(knee**2) / 2) / math.sqrt(2 * math.pi) + knee**2 * (1 - inside)
    # 109 blocks: 1/sqrt(218) = 7 %; with the weight in place of the slope it would be 34 % too small.
    assert found.sigma[0] == pytest.approx(math.sqrt(square / n) / inside, rel=0.15)


def test_law_criteria_refuse_a_needless_term_and_keep_a_needed_one() -> None:
    full = trials([1500], inputs=1, seed=3)  # a stepped input and a bias
    less = Design((full.jacobians[0][:, :, 1:],), full.unknowns[1:])
    drawn = errors(full, 0.95, np.random.default_rng(1), 60)
    effect = 1.5 * full.jacobians[0][:, None, :, 0]
    refused = kept = 0
    for column in range(60):
        error = [drawn[0][:, [column]]]
        for signal in (0.0, 8.0):
            shifted = [error[0] + signal * effect]
            with_term, without = estimates(full, shifted)[0], estimates(less, shifted)[0]
            big = information_criteria(with_term)
            small = information_criteria(without, effective=big.effective)
            refused += signal == 0.0 and small.bic < big.bic
            kept += signal != 0.0 and big.bic < small.bic and big.aic < small.aic
    assert big.parameters == pytest.approx(2.0, rel=1e-9)
    # Some 30 independent samples per channel: a t of 2.0 is needed by chance in about 1 of 20.
    assert refused >= 48
    assert kept == 60


def test_priors_take_their_part_of_the_parameters() -> None:
    seen = [j[:, :, 1] for j in SLOW.jacobians]
    base = trials([600, 600], inputs=1, seed=1)
    half = covariance(one(with_column(base, flat("seen"), seen), 0.0)).naive[-1]
    lin = one(with_column(base, flat("seen", prior_sd=float(half)), seen), 0.0)
    # Prior and data tell the same: half a parameter, exactly.
    assert information_criteria(lin).parameters == pytest.approx(3.5, rel=1e-9)


def held_cost(lin: Linearisation, held: Mapping[str, float], *, bend: float = 0.0) -> float:
    """Half the sum of squares of the linear model with unknowns held, by elimination; a quartic on top."""
    names = [unknown.name for unknown in lin.unknowns]
    fixed = [names.index(name) for name in held]
    step = np.array(list(held.values())) - lin.values[fixed]
    inverse = np.linalg.inv(lin.information())[np.ix_(fixed, fixed)]
    half = 0.5 * float(step @ np.linalg.solve(inverse, step))
    return 7.0 + half + bend * half**2


def test_profile_of_a_linear_model_is_its_parabola() -> None:
    lin = one(SLOW, 0.9)
    found = covariance(lin)
    curve = profile(
        lin, lambda held: held_cost(lin, held), uncertainty=found, direction={"c2": -0.1}, points=13
    )
    assert len(curve.step) == 13
    np.testing.assert_allclose(curve.cost, curve.quadratic, atol=1e-9)
    # It ends where the interval does.
    ends = [lin.values[2] - found.sigma[2] * end for end in (curve.lower, curve.upper)]
    np.testing.assert_allclose(sorted(ends), [found.lower[2], found.upper[2]], rtol=1e-9)
    both = profile(
        lin,
        lambda held: held_cost(lin, held),
        uncertainty=found,
        direction={"c0": 1.0, "bias 0": -2.0},
        points=3,
    )
    np.testing.assert_allclose(both.cost, both.quadratic, atol=1e-9)
    assert json.loads(to_json(both.to_dict()))["names"] == ["c0", "bias 0"]


def test_profile_shows_a_stiffer_criterion_and_stops_at_bounds() -> None:
    lin = one(SLOW, 0.9)
    found = covariance(lin)
    stiff = profile(
        lin, lambda held: held_cost(lin, held, bend=0.2), uncertainty=found, direction={"c2": 1.0}, points=31
    )
    assert stiff.upper < 0.8 * (found.upper[2] - found.estimate[2]) / found.sigma[2]
    box = replace(lin.unknowns[2], upper=lin.values[2] + 1.2 * found.sigma[2])
    cut = replace(lin, unknowns=(*lin.unknowns[:2], box, *lin.unknowns[3:]))
    ended = profile(
        cut, lambda held: held_cost(lin, held), uncertainty=found, direction={"c2": 1.0}, points=7
    )
    assert ended.step.max() == pytest.approx(1.0)
    assert ended.upper == math.inf


@pytest.mark.parametrize(
    ("direction", "points", "words"),
    [({"c9": 1.0}, 9, "unknowns: c0"), ({}, 9, "not all zero"), ({"c0": 1.0}, 4, "odd number")],
)
def test_profile_says_what_it_expects(direction: dict[str, float], points: int, words: str) -> None:
    lin = one(SLOW, 0.0)
    with pytest.raises(ValueError, match=words):
        profile(lin, lambda _: 0.0, uncertainty=covariance(lin), direction=direction, points=points)


def test_profile_refuses_what_is_not_determined() -> None:
    twin = with_column(SLOW, flat("twin"), [j[:, :, 1] for j in SLOW.jacobians])
    lin = one(twin, 0.0)
    with pytest.raises(ValueError, match="not determine twin separately"):
        profile(lin, lambda _: 0.0, uncertainty=covariance(lin), direction={"twin": 1.0})


def test_nothing_counted_is_an_error() -> None:
    lin = one(SLOW, 0.0)
    empty = replace(lin, pieces=tuple(replace(p, counted=np.zeros_like(p.counted)) for p in lin.pieces))
    with pytest.raises(CampaignError, match="no sample that counts"):
        covariance(empty)
    with pytest.raises(ValueError, match="at least 2"):
        bootstrap(lin, draws=1, seed=0)


def test_result_is_plain() -> None:
    twin = with_column(SLOW, flat("twin"), [j[:, :, 1] for j in SLOW.jacobians])
    found = covariance(one(twin, 0.0))
    plain = json.loads(to_json(found.to_dict()))
    assert [row["name"] for row in plain["unknowns"]] == list(found.names)
    assert plain["unknowns"][1]["sigma"] is None
    assert plain["unknowns"][0]["alone"] is False
    assert plain["blocks"] == found.blocks
    assert plain["correlation"][0][0] == pytest.approx(1.0)
