"""Causes of failures: noise is seldom named, a planted cause is found, tests agree with published ones."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import mannwhitneyu, permutation_test, rankdata, spearmanr

from seatrial.statistics.significance import (
    circular_correlation,
    holm,
    mann_whitney,
    spearman,
    uniform_scores,
)
from seatrial.verification.causes import Cause, Influence, find_causes, find_causes_of_all, grouped

Array = NDArray[np.float64]
K = 400


def drawn(rng: np.random.Generator, k: int = K) -> list[Cause]:
    return [
        *(Cause(f"coefficient {i}", rng.normal(size=k), "kg/m") for i in range(4)),
        Cause("current speed", rng.uniform(0.0, 0.5, k), "m/s"),
        Cause("current direction", rng.uniform(0.0, 2.0 * np.pi, k), kind="direction"),
        Cause("fault", rng.choice(["none", "PtL", "SbU"], k, p=[0.9, 0.05, 0.05]), kind="category"),
    ]


def values(causes: list[Cause], name: str) -> NDArray[np.generic]:
    return np.asarray(next(cause.values for cause in causes if cause.name == name))


def of(found: tuple[Influence, ...], label: str) -> Influence:
    return next(one for one in found if one.label == label)


@pytest.mark.parametrize("quantile", [0.3, 0.02, -1.0])
def test_law_noise_is_named_at_most_at_the_level(quantile: float) -> None:
    """Many failures, few, and none, so that the reserve is asked."""
    rng, named, campaigns = np.random.default_rng(11), 0, 60
    for _ in range(campaigns):
        reserve = rng.normal(size=K)
        held = reserve > np.quantile(reserve, quantile) if quantile > 0.0 else np.ones(K, dtype=bool)
        named += any(one.named for one in find_causes(held, reserve, causes=drawn(rng), level=0.1))
    # 0.1 with four standard deviations of a share of 60 campaigns.
    assert named / campaigns <= 0.1 + 4.0 * np.sqrt(0.1 * 0.9 / campaigns)


@pytest.mark.long
def test_law_noise_is_named_at_most_at_the_level_over_all_requirements_together() -> None:
    """Five requirements with many failures, few and none; one by one they would name 0.41 at this level."""
    rng, named, campaigns, k = np.random.default_rng(12), 0, 80, 120
    for _ in range(campaigns):
        noise = [Cause(f"{i}", rng.normal(size=k)) for i in range(3)]
        noise.append(Cause("towards", rng.uniform(0.0, 6.28, k), kind="direction"))
        reserves = rng.normal(size=(5, k))
        judgements = [
            (row > limit, row) for row, limit in zip(reserves, (-0.5, 0.5, -1.0, -2.0, -9.0), strict=True)
        ]
        found = find_causes_of_all(judgements, causes=noise, level=0.1)
        named += any(one.named for rows in found for one in rows)
    # 0.1 with four standard deviations of a share of 80 campaigns: 0.23.
    assert named / campaigns <= 0.1 + 4.0 * np.sqrt(0.1 * 0.9 / campaigns)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("margin", [0.15, 9.0])
@given(seed=st.integers(0, 2**32 - 1), centre=st.floats(-50.0, 50.0))
@settings(max_examples=8, deadline=None)
def test_law_what_harms_on_both_sides_of_a_centre_is_found(
    sign: float, margin: float, seed: int, centre: float
) -> None:
    """At both ends, or in the middle; with failures, and without any."""
    rng = np.random.default_rng(seed)
    off = rng.uniform(-0.2, 0.2, K)
    cross = Cause("current from port", centre + off, "m/s")
    reserve = margin - (np.abs(off) if sign > 0.0 else 0.2 - np.abs(off)) + rng.normal(0.0, 0.01, K)
    found = find_causes(reserve > 0.0, reserve, causes=[*drawn(rng), cross])
    assert found[0].label == f"current from port: {'both ends' if sign > 0.0 else 'middle'}"
    assert found[0].named
    if margin < 1.0:
        # A fourth of the missions fails: beyond 0.15 of 0.2, or within 0.05, with an error of 0.01.
        assert abs(found[0].auc - 0.5) > 0.4
        side = "far from" if sign > 0.0 else "close to"
        assert str(found[0]).startswith(f"failures go with current from port {side} its median: ")
    else:
        assert "the distance of current from port from its median" in str(found[0])


def test_what_harms_towards_one_end_is_no_matter_of_the_middle() -> None:
    rng = np.random.default_rng(5)
    drag, zeros = rng.normal(size=K), np.where(rng.random(K) < 0.9, 0.0, rng.uniform(1.0, 9.0, K))
    reserve = 1.0 - drag + rng.normal(0.0, 0.1, K)
    (found,) = find_causes(reserve > 0.0, reserve, causes=[Cause("drag", drag)])
    assert (found.label, found.where) == ("drag", "")
    # What mostly does not happen has its centre there: far from it is one end alone.
    reserve = 1.0 - zeros
    (found,) = find_causes(reserve > 0.0, reserve, causes=[Cause("outage", zeros, "s")])
    assert (found.label, found.where, found.auc) == ("outage", "", 1.0)


def test_words_that_all_missions_hold_ask_nothing() -> None:
    """Their reserve is infinite everywhere: no test, and no further one in the family."""
    rng = np.random.default_rng(7)
    reserve, causes = rng.normal(size=K), drawn(rng)
    words = np.ones(K, dtype=bool), np.full(K, np.inf)
    path, nothing = find_causes_of_all([(reserve > -0.5, reserve), words], causes=causes)
    assert nothing == ()
    assert path == find_causes(reserve > -0.5, reserve, causes=causes)


@pytest.mark.parametrize("spread", [0.02, 0.1])
@pytest.mark.parametrize("margin", [0.35, 0.9])
def test_a_planted_speed_is_found_and_leads(spread: float, margin: float) -> None:
    """With failures, and without any."""
    rng = np.random.default_rng(2)
    causes = drawn(rng)
    speed = values(causes, "current speed").astype(float)
    reserve = margin - speed + rng.normal(0.0, spread, K)
    found = find_causes(reserve > 0.0, reserve, causes=causes)
    assert found[0].name == "current speed"
    assert found[0].named
    assert [one.name for one in found if one.named] == ["current speed"]
    if margin == 0.35:
        assert found[0].auc > 0.85
        assert found[0].groups.rates[0] < 0.05 < 0.5 < found[0].groups.rates[-1]
        assert str(found[0]).startswith("failures go with current speed: ")
    else:
        assert not found[0].by_failures
        assert "robustness shrinks with current speed" in str(found[0])


@pytest.mark.parametrize("margin", [1.2, 9.0])
def test_a_planted_direction_is_found_across_north(margin: float) -> None:
    rng = np.random.default_rng(3)
    causes = drawn(rng)
    direction = values(causes, "current direction").astype(float)
    reserve = margin - 1.5 * np.cos(direction - np.radians(5.0)) + rng.normal(0.0, 0.2, K)
    found = find_causes(reserve > 0.0, reserve, causes=causes)
    assert found[0].name == "current direction"
    assert found[0].named
    if margin == 1.2:
        # Some 80 failures within about 40 degrees of 5 degrees: 4 standard deviations of their mean.
        away = np.angle(np.exp(1j * (found[0].failed - np.radians(5.0))))
        assert abs(np.degrees(away)) < 4.0 * 40.0 / np.sqrt(80)
        assert "of the missions fail towards N" in str(found[0])
        assert found[0].auc > 0.9


@pytest.mark.parametrize("harm", [2.0, 0.8])
def test_a_planted_fault_is_found_by_its_name(harm: float) -> None:
    rng = np.random.default_rng(4)
    causes = drawn(rng)
    reserve = 1.0 - harm * (values(causes, "fault") == "SbU") + rng.normal(0.0, 0.05, K)
    found = find_causes(reserve > 0.0, reserve, causes=causes)
    assert found[0].label == "fault: SbU"
    assert [one.label for one in found if one.named] == ["fault: SbU"]
    if harm == 2.0:
        assert str(found[0]).startswith("failures go with fault SbU: ")
        assert "(100 %), 0 of" in str(found[0])
    assert of(found, "fault: PtL").corrected > 0.05
    assert "is not shown to matter" in str(of(found, "fault: PtL"))


def test_what_never_varies_or_is_unknown_is_left_out() -> None:
    rng = np.random.default_rng(6)
    held = rng.random(K) > 0.3
    causes = [
        Cause("fixed", np.full(K, 2.0)),
        Cause("fault", np.full(K, "none"), kind="category"),
        Cause("unknown", np.full(K, np.nan)),
        Cause("time of fault", np.where(rng.random(K) < 0.5, np.nan, 1.0 + held)),
    ]
    found = find_causes(held, np.where(held, 1.0, -1.0), causes=causes)
    assert [one.name for one in found] == ["time of fault"]
    assert found[0].auc == 0.0
    assert sum(found[0].groups.runs) < K
    with pytest.raises(ValueError, match="short: expected 400 values"):
        find_causes(held, held, causes=[Cause("short", np.zeros(3))])


def test_holm_steps_down() -> None:
    """The smallest of m times m, the next times m - 1, never falling."""
    assert holm([0.010, 0.020, 0.005]) == pytest.approx([0.02, 0.02, 0.015])
    assert holm([0.6, 0.7]) == [1.0, 1.0]
    assert holm([]) == []


def test_area_under_the_curve_counts_pairs() -> None:
    one, other = np.array([3.0, 5.0, 5.0]), np.array([1.0, 3.0, 4.0, 9.0])
    pairs = (one[:, None] > other).sum() + 0.5 * (one[:, None] == other).sum()
    assert mann_whitney(one, other)[0] == pytest.approx(pairs / 12.0)
    assert mann_whitney(one, one[:0]) == (0.5, 1.0)


def test_rank_correlation_is_that_of_scipy_and_takes_infinities() -> None:
    rng = np.random.default_rng(8)
    x = rng.normal(size=50)
    y = x + rng.normal(size=50)
    # The same sums in another order.
    assert spearman(x, y) == pytest.approx(tuple(spearmanr(x, y)), rel=1e-9)
    least = int(np.argmin(y))
    lost = np.where(np.arange(50) == least, -np.inf, y)
    assert spearman(x, lost) == spearman(x, y)
    assert spearman(x, np.zeros(50)) == (0.0, 1.0)
    with np.errstate(all="raise"):
        rho, p = spearman(np.arange(8.0), np.arange(8.0))
    assert rho == pytest.approx(1.0)
    assert p < 1e-9


def test_tests_of_directions_agree_with_permutation() -> None:
    """Their chi-square approximation against the share of shuffled samples as extreme."""
    rng = np.random.default_rng(9)
    angle = rng.vonmises(0.0, 0.3, 60) % (2.0 * np.pi)
    chosen = rng.random(60) < 1.0 / (1.0 + np.exp(1.5 - 1.6 * np.cos(angle)))
    reserve = np.cos(angle) + 2.0 * rng.normal(size=60)

    def by_scores(mask: Array) -> float:
        return -uniform_scores(angle, mask > 0.5)

    def by_ranks(shuffled: Array) -> float:
        return circular_correlation(angle, shuffled)[0]

    for data, statistic, found in (
        (chosen.astype(float), by_scores, uniform_scores(angle, chosen)),
        (reserve, by_ranks, circular_correlation(angle, reserve)[1]),
    ):
        shuffled = permutation_test(
            (data,), statistic, permutation_type="pairings", n_resamples=1000, alternative="greater",
            vectorized=False, rng=np.random.default_rng(10),
        )  # fmt: skip
        # Three standard deviations of a share of 1000 shuffles, and a tenth for the approximation.
        p = float(shuffled.pvalue)
        assert 1e-3 < p < 0.5
        assert found == pytest.approx(p, abs=3.0 * np.sqrt(p / 1000.0) + 0.1 * p)


@pytest.mark.parametrize("words", [True, False])
@pytest.mark.parametrize(("failures", "k"), [(1, 30), (2, 12)])
def test_law_two_rare_things_that_meet_by_chance_are_no_proof(words: bool, failures: int, k: int) -> None:
    """Wherever failures fall among missions with three outages: small p-values are as rare as they say."""
    outage = np.zeros(k)
    outage[[3, 7, 10]] = 2.0, 7.0, 4.0
    met = np.where(outage > 0.0, "yes", "no")
    causes = [Cause("outage", outage, "s"), Cause("fault", met, kind="category", usual="no")]
    found: dict[str, list[float]] = {"outage": [], "fault": []}
    for places in combinations(range(k), failures):
        held = ~np.isin(np.arange(k), places)
        # Of words, or of an alert that mostly does not come.
        reserve = np.where(held, np.inf, -np.inf) if words else np.where(held, np.inf, 1.0 + np.arange(k))
        for one in find_causes(held if words else np.ones(k, dtype=bool), reserve, causes=causes):
            found[one.name].append(one.p_value)
    for name, p_values in found.items():
        p = np.sort(p_values)
        assert ((1.0 + np.arange(len(p))) / len(p) <= p + 1e-9)[np.append(np.diff(p) > 0.0, True)].all(), name


def test_an_outage_that_brings_the_failures_is_found_however_rare() -> None:
    rng = np.random.default_rng(14)
    outage = np.where(np.arange(K) < 8, rng.uniform(1.0, 9.0, K), 0.0)
    reserve = np.where(outage > 2.0, -np.inf, np.inf)
    (found, *_) = find_causes(reserve > 0.0, reserve, causes=[Cause("outage", outage, "s"), *drawn(rng)])
    assert (found.name, found.named, found.where) == ("outage", True, "")
    # Half of all missions fail; among those with an outage the longer ones: the second question is heard too.
    most = np.where(np.arange(K) < 60, rng.uniform(1.0, 9.0, K), 0.0)
    chance = (most == 0.0) & (rng.random(K) < 0.5)
    reserve = 5.0 - most - 9.0 * chance
    (longer,) = find_causes(reserve > 0.0, reserve, causes=[Cause("outage", most, "s")])
    assert longer.named


def test_a_number_is_asked_twice_and_the_smaller_p_value_counts_twofold() -> None:
    rng = np.random.default_rng(15)
    numbers = rng.normal(size=K)
    held = rng.random(K) < 0.8 - 0.05 * numbers
    (found,) = find_causes(held, np.where(held, 1.0, -1.0), causes=[Cause("drag", numbers)])
    away = np.abs(rankdata(numbers) - 0.5 * (K + 1))
    asked = [mannwhitneyu(one[~held], one[held]).pvalue for one in (numbers, away)]
    assert found.p_value == pytest.approx(2.0 * min(asked), rel=1e-9)


@pytest.mark.parametrize(("failures", "compared"), [(4, False), (5, True), (K - 5, True), (K - 4, False)])
def test_fewer_than_five_missions_of_a_kind_are_not_compared(failures: int, compared: bool) -> None:
    rng = np.random.default_rng(16)
    reserve = rng.normal(size=K)
    reserve -= 0.5 * (np.sort(reserve)[failures - 1] + np.sort(reserve)[failures])
    (found,) = find_causes(reserve > 0.0, reserve, causes=[Cause("drag", rng.normal(size=K))])
    assert found.by_failures == compared


def test_a_comma_in_the_name_of_a_mission_is_no_unit() -> None:
    flags = [0.0, 1.0, 1.0]
    found = Cause.of_column("mission harbour, north", flags)
    assert (found.name, found.unit, found.kind) == ("mission harbour, north", "", "category")
    outage = Cause.of_column("outage of a, b, s", [0.0, 2.0, 3.0])
    assert (outage.name, outage.unit, outage.kind) == ("outage of a, b", "s", "number")


def test_groups_hold_every_mission_once() -> None:
    rng = np.random.default_rng(12)
    failed = rng.random(K) < 0.2
    for kind, numbers in (
        ("number", rng.normal(size=K)),
        ("number", rng.integers(0, 3, K).astype(float)),
        ("direction", rng.uniform(0.0, 2.0 * np.pi, K)),
        ("category", rng.choice(["a", "b"], K)),
    ):
        found = grouped(numbers, failed, kind=kind)
        assert sum(found.runs) == K
        assert sum(found.failures) == failed.sum()
        assert len(found.labels) == len(found.runs) == len(found.rates)
    sectors = grouped(
        np.radians([350.0, 10.0, 44.0, 181.0]), np.array([True, False, True, False]), kind="direction"
    )
    assert dict(zip(sectors.labels, sectors.runs, strict=True)) == {
        "N": 2, "NE": 1, "E": 0, "SE": 0, "S": 1, "SW": 0, "W": 0, "NW": 0,
    }  # fmt: skip


def test_columns_of_draws_become_causes() -> None:
    rng = np.random.default_rng(13)
    fault, outage = rng.random(K) < 0.05, np.where(rng.random(K) < 0.1, rng.uniform(1.0, 9.0, K), 0.0)
    reserve = 1.0 - 2.0 * fault + rng.normal(0.0, 0.05, K)
    towards = rng.uniform(0.0, 360.0, K)
    columns = {
        "fault of PtL": fault.astype(float),
        "outage of depth, s": outage,
        "current towards, deg from north": towards,
    }
    causes = [Cause.of_column(name, column) for name, column in columns.items()]
    assert [(cause.name, cause.unit, cause.kind) for cause in causes] == [
        ("fault of PtL", "", "category"),
        ("outage of depth", "s", "number"),
        ("current towards", "", "direction"),
    ]
    assert np.asarray(causes[2].values) == pytest.approx(np.radians(towards))
    found = find_causes(reserve > 0.0, reserve, causes=causes)
    assert found[0].label == "fault of PtL"
    n = int(fault.sum())
    assert str(found[0]).startswith(
        f"failures go with fault of PtL: {n} of {n} missions with it fail (100 %)"
    )
    # Nine tenths without an outage fill more than four fifths.
    groups = of(found, "outage of depth").groups
    assert groups.labels == ("0", "above 0")
    assert groups.runs == (int((outage == 0.0).sum()), int((outage > 0.0).sum()))
