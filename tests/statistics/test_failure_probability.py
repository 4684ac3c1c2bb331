"""Failure probabilities: published intervals, exact coverage, verdicts that err as seldom as they say."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import betabinom, binom

from seatrial.report.results.verification import verdict
from seatrial.statistics.failure_probability import (
    FailureProbability,
    clopper_pearson,
    further_runs,
    runs_needed,
    share,
    wilson,
)

PROBABILITIES = np.geomspace(1e-4, 0.5, 60)


@pytest.mark.parametrize(
    ("failures", "runs", "exact", "score"),
    [
        (81, 263, (0.2527, 0.3676), (0.2553, 0.3662)),
        (15, 148, (0.0578, 0.1617), (0.0624, 0.1605)),
        (0, 20, (0.0000, 0.1684), (0.0000, 0.1611)),
        (1, 29, (0.0009, 0.1776), (0.0061, 0.1718)),
    ],
)
def test_lit_newcombe_1998_intervals_of_proportions(
    failures: int, runs: int, exact: tuple[float, float], score: tuple[float, float]
) -> None:
    """Newcombe, Statistics in Medicine 17 (1998) 857, table I: methods 5 (Clopper-Pearson) and 3 (Wilson)."""
    # Four decimals are printed.
    assert clopper_pearson(failures, runs) == pytest.approx(exact, abs=5.1e-5)
    assert wilson(failures, runs) == pytest.approx(score, abs=5.1e-5)


@pytest.mark.parametrize(("failures", "runs"), [(0, 20), (1, 20), (10, 20), (3, 2000), (1999, 2000)])
@pytest.mark.parametrize("confidence", [0.9, 0.99])
def test_law_bounds_solve_the_equations_of_clopper_and_pearson(
    failures: int, runs: int, confidence: float
) -> None:
    lower, upper = (float(bound) for bound in clopper_pearson(failures, runs, confidence=confidence))
    risk = 0.5 * (1.0 - confidence)
    # The tails as plain sums; 1e-9 is the accuracy of the inverse of the incomplete beta function.
    assert binom.pmf(np.arange(failures + 1), runs, upper).sum() == pytest.approx(risk, rel=1e-9)
    if failures:
        assert binom.pmf(np.arange(failures, runs + 1), runs, lower).sum() == pytest.approx(risk, rel=1e-9)
    else:
        assert lower == 0.0


def test_lit_wilks_1941_numbers_of_runs() -> None:
    """First, second and third order at 95 %/95 %: 59, 93, 124 runs; the first at 99 %/95 %: 299."""
    assert [runs_needed(0.05, failures=k) for k in range(3)] == [59, 93, 124]
    assert runs_needed(0.01) == 299


@pytest.mark.parametrize("runs", [1, 20, 137, 2000])
@pytest.mark.parametrize("confidence", [0.8, 0.95, 0.99])
def test_law_the_interval_covers_as_often_as_it_says(runs: int, confidence: float) -> None:
    count = np.arange(runs + 1)
    lower, upper = clopper_pearson(count, runs, confidence=confidence)
    chance = binom.pmf(count, runs, PROBABILITIES[:, None])
    inside = (lower <= PROBABILITIES[:, None]) & (PROBABILITIES[:, None] <= upper)
    covered = (chance * inside).sum(axis=1)
    # Sums of up to 2001 rounded probabilities.
    assert covered.min() >= confidence - 1e-10
    # Not by being vacuous: where failures are expected it is at most a few per cent too sure.
    if runs == 2000:
        assert covered[runs * PROBABILITIES > 10.0].max() <= confidence + 0.5 * (1.0 - confidence)


@pytest.mark.parametrize("runs", [1, 60, 500])
@pytest.mark.parametrize("allowed", [0.001, 0.01, 0.1])
def test_law_a_verdict_errs_at_most_as_often_as_it_says(runs: int, allowed: float) -> None:
    found = [FailureProbability(k, runs).verdict(allowed) for k in range(runs + 1)]
    held = np.array([one == "held" for one in found])
    failed = np.array([one == "failed" for one in found])
    count = np.arange(runs + 1)
    # At the limit itself, the worst case of either error; the hair is that of the sums.
    at_limit = binom.pmf(count, runs, allowed)
    assert at_limit[held].sum() <= 0.05 + 1e-12
    assert at_limit[failed].sum() <= 0.05 + 1e-12
    # More failures never make it better.
    assert not np.any(held[1:] & ~held[:-1])
    assert not np.any(failed[:-1] & ~failed[1:])


def test_the_score_interval_covers_on_average_but_not_always() -> None:
    count = np.arange(101)
    lower, upper = wilson(count, 100)
    chance = binom.pmf(count, 100, PROBABILITIES[:, None])
    covered = (chance * ((lower <= PROBABILITIES[:, None]) & (PROBABILITIES[:, None] <= upper))).sum(axis=1)
    # Its mean lies within a hundredth of the nominal 0.95, its least is well below: no verdict rests on it.
    assert covered.mean() == pytest.approx(0.95, abs=0.02)
    assert covered.min() < 0.94


@given(
    st.integers(1, 10**6).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))), st.floats(0.05, 0.999)
)
def test_law_bounds_enclose_the_share(counted: tuple[int, int], confidence: float) -> None:
    found = FailureProbability(*counted, confidence)
    lower, upper = found.interval
    assert 0.0 <= lower <= found.estimate <= upper <= 1.0
    # A bound on one side spends the whole risk there and lies inside.
    assert lower <= found.at_least
    assert found.at_most <= upper
    assert str(found).startswith(f"{counted[0]} of {counted[1]} missions failed: ")


def test_the_rule_of_three() -> None:
    for runs in (100, 2000, 10**6):
        bound = FailureProbability(0, runs).at_most
        assert bound == pytest.approx(1.0 - 0.05 ** (1.0 / runs), rel=1e-9)
        # -ln 0.05 = 2.996, and 1 - exp(-x) < x; at 100 runs the difference is a hundredth.
        assert bound == pytest.approx(3.0 / runs, rel=0.02)
    assert str(FailureProbability(0, 2000)) == (
        "0 of 2000 missions failed: at most 0.15 % (95 % confidence, rule of three: 3/2000)"
    )


@pytest.mark.parametrize(
    ("failures", "runs", "text"),
    [
        (3, 2000, "3 of 2000 missions failed: 0.15 % (0.03 to 0.44 %)"),
        (12, 2000, "12 of 2000 missions failed: 0.60 % (0.31 to 1.05 %)"),
        (1, 10, "1 of 10 missions failed: 10.0 % (0.3 to 44.5 %)"),
        (1000, 2000, "1000 of 2000 missions failed: 50.0 % (47.8 to 52.2 %)"),
        (20, 20, "20 of 20 missions failed: 100 % (83 to 100 %)"),
    ],
)
def test_a_count_reads_as_a_share_with_its_interval(failures: int, runs: int, text: str) -> None:
    assert str(FailureProbability(failures, runs)) == text


@pytest.mark.parametrize(
    ("failures", "runs", "text"),
    [
        (3, 2000, "held: at most 0.39 % of the missions fail (95 % confidence), 1 % is allowed"),
        (60, 2000, "failed: at least 2.3 % of the missions fail (95 % confidence), 1 % is allowed"),
        (0, 100, "268 more missions without a failure would suffice at 97.5 % (half the risk, because"),
        (5, 1000, "more missions will probably decide it"),
    ],
)
def test_a_verdict_says_what_it_rests_on(failures: int, runs: int, text: str) -> None:
    assert text in verdict(FailureProbability(failures, runs), 0.01)


@pytest.mark.parametrize("failures", [0, 1, 7])
@pytest.mark.parametrize("allowed", [0.001, 0.03])
def test_law_runs_needed_are_the_least_that_hold(failures: int, allowed: float) -> None:
    enough = runs_needed(allowed, failures=failures)
    assert FailureProbability(failures, enough).verdict(allowed) == "held"
    assert FailureProbability(failures, enough - 1).verdict(allowed) != "held"


@pytest.mark.parametrize(("failures", "runs"), [(2, 400), (9, 1000), (1, 30)])
def test_further_runs_decide_about_as_often_as_they_promise(failures: int, runs: int) -> None:
    found, allowed = FailureProbability(failures, runs), 0.01
    more = further_runs(found, allowed)
    assert more is not None
    count = np.arange(more + 1)
    chance = betabinom.pmf(count, more, failures + 0.5, runs - failures + 0.5)
    # A further look spends half the risk: bounds of 97.5 % on one side are those of an interval of 95 %.
    lower, upper = clopper_pearson(failures + count, runs + more, confidence=0.95)
    decided = chance[(upper <= allowed) | (lower > allowed)].sum()
    # The search stops within a fiftieth of the number, the quadrature has 400 nodes, and the count has teeth.
    assert 0.797 <= decided <= 0.82


def test_what_is_decided_needs_no_further_runs() -> None:
    assert further_runs(FailureProbability(3, 2000), 0.01) == 0
    close = further_runs(FailureProbability(100, 10_000), 0.01)
    assert close is not None
    assert close > 100_000


def test_bounds_are_rounded_to_their_safe_side() -> None:
    assert [share(0.01003, way) for way in ("down", "nearest", "up")] == ["1 %", "1 %", "1.1 %"]
    assert [share(0.0), share(1.0), share(1e-7), share(0.9999)] == ["0 %", "100 %", "0.00001 %", "99.99 %"]


@pytest.mark.parametrize(
    ("failures", "runs", "confidence"),
    [(3, 2, 0.95), (-1, 2, 0.95), (0, 0, 0.95), (0, 2, 1.0), (0, 2, math.nan)],
)
def test_counts_that_cannot_be_are_refused(failures: int, runs: int, confidence: float) -> None:
    with pytest.raises(ValueError, match="expected"):
        FailureProbability(failures, runs, confidence)


def test_law_looks_at_a_growing_campaign_err_no_more_than_promised_when_each_takes_half_the_risk() -> None:
    """Six looks, the missions doubling, at a failure probability just above what is allowed."""
    rng, allowed, campaigns = np.random.default_rng(2), 0.05, 4000
    runs = 200 * 2 ** np.arange(6)
    failures = np.cumsum(rng.binomial(np.diff(runs, prepend=0), allowed * 1.0001, (campaigns, 6)), axis=1)

    def wrongly_held(risks: np.ndarray) -> float:
        most = [
            np.flatnonzero(
                clopper_pearson(np.arange(n // 10), n, confidence=1.0 - 2.0 * r)[1] <= allowed
            ).max()
            for n, r in zip(runs.tolist(), risks.tolist(), strict=True)
        ]
        return float(np.mean((failures <= most).any(axis=1)))

    # Three standard deviations of a share of 4000 at 5 %.
    assert wrongly_held(0.05 * 0.5 ** np.arange(1, 7)) <= 0.05 + 0.011
    assert wrongly_held(np.full(6, 0.05)) > 0.10
    assert FailureProbability(1, 300).looked_at_again.confidence == pytest.approx(0.975)
