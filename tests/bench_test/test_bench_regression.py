"""The regression: conditioning, R² against the paper's B, outliers, order, k inputs with products."""

from __future__ import annotations

import numpy as np
import pytest

from seatrial.bench_test.regression import (
    candidates,
    coefficient_name,
    design,
    lack_of_fit,
    least_squares,
    outliers,
    paper_b,
    r_squared,
    recommended,
    terms_of,
)

SIGNAL = np.linspace(150.0, 2000.0, 21)
SECOND = terms_of(2, 1)


def test_normal_equations_on_rpm_have_condition_5e13_scaled_7e2_by_qr_26() -> None:
    raw = design(SIGNAL[:, None], SECOND)
    scaled = design(SIGNAL[:, None] / 2000.0, SECOND)
    # The figures of docs/theory/bollard_test.md, to their one digit.
    assert np.linalg.cond(raw.T @ raw) == pytest.approx(5e13, rel=0.05)
    assert np.linalg.cond(scaled.T @ scaled) == pytest.approx(7e2, rel=0.05)
    fit = least_squares(SIGNAL[:, None], SIGNAL**2, SECOND)
    assert fit.condition == pytest.approx(26.0, rel=0.01)


def test_qr_keeps_digits_that_the_normal_equations_on_rpm_lose() -> None:
    truth = np.array([0.3, 4e-3, 1.9e-5])
    raw = design(SIGNAL[:, None], SECOND)
    thrust = raw @ truth
    square, right = raw.T @ raw, raw.T @ thrust
    by_qr = np.abs(least_squares(SIGNAL[:, None], thrust, SECOND).coefficients / truth - 1.0).max()
    inverse = np.abs(np.linalg.inv(square) @ right / truth - 1.0).max()
    pseudo_inverse = np.abs(np.linalg.pinv(square) @ right / truth - 1.0).max()
    # Measured 8e-14, 3e-12 and 1e-7: no load cell shows them, but the margin to a wrong rank is gone.
    assert by_qr < 1e-12
    assert inverse > 5.0 * by_qr
    assert pseudo_inverse > 1e4 * by_qr


def test_b_does_not_see_a_gain_that_is_twenty_per_cent_wrong_and_r2_does() -> None:
    thrust = 1.9e-5 * SIGNAL**2 + 0.3 * np.random.default_rng(4).standard_normal(21)
    fit = least_squares(SIGNAL[:, None], thrust, SECOND)
    estimate = fit.at(SIGNAL[:, None])
    assert paper_b(thrust, 1.2 * estimate) == pytest.approx(paper_b(thrust, estimate), abs=1e-12)
    assert paper_b(thrust, 1.2 * estimate) > 0.9996
    assert r_squared(thrust, estimate) > 0.9996
    assert r_squared(thrust, 1.2 * estimate) < 0.95


def test_law_b_equals_r2_for_least_squares_with_intercept_on_its_own_points_only() -> None:
    rng = np.random.default_rng(5)
    thrust = 2.0 + 1e-5 * SIGNAL**2 + 2.0 * rng.standard_normal(21)
    free = least_squares(SIGNAL[:, None], thrust, SECOND)
    assert free.b == pytest.approx(free.r2, abs=1e-12)
    bound = least_squares(SIGNAL[:, None], thrust, terms_of(2, 1, square=True))
    assert bound.b > bound.r2 + 1e-3


def test_terms_are_all_products_up_to_the_order() -> None:
    # Taubert et al. (2014), equation 36, k = 3.
    names = [coefficient_name(term) for term in terms_of(2, 3)]
    assert names == ["a0", "a1", "a2", "a3", "a11", "a12", "a13", "a22", "a23", "a33"]
    assert [coefficient_name(t) for t in terms_of(3, 2, through_origin=True)] == [
        "a1",
        "a11",
        "a12",
        "a111",
        "a112",
        "a122",
    ]
    assert terms_of(2, 1, square=True) == ((2,),)


def test_a_surface_over_command_and_voltage_is_recovered_with_its_interaction() -> None:
    rng = np.random.default_rng(6)
    s, v = (x.ravel() for x in np.meshgrid(np.linspace(50.0, 400.0, 8), np.linspace(10.0, 20.0, 6)))
    truth = {"a1": 2e-3, "a11": 1e-4, "a12": 5e-3}
    thrust = truth["a1"] * s + truth["a11"] * s**2 + truth["a12"] * s * v + 0.2 * rng.standard_normal(48)
    fit = least_squares(np.column_stack([s, v]), thrust, terms_of(2, 2, through_origin=True))
    for name, estimate, deviation in zip(fit.names, fit.coefficients, fit.standard_deviations, strict=True):
        assert abs(estimate - truth[name]) < 4.0 * deviation
    assert fit.at([[0.0, 15.0]])[0] == 0.0


def test_intervals_and_bands_are_those_of_the_textbook() -> None:
    # Straight line: var(a1) = s²/S_xx, band t s sqrt(1/n + (x - mean)²/S_xx) (Montgomery et al. 2012).
    rng = np.random.default_rng(7)
    x = np.linspace(0.0, 10.0, 12)
    y = 1.0 + 2.0 * x + rng.standard_normal(12)
    fit = least_squares(x[:, None], y, terms_of(1, 1))
    spread = ((x - x.mean()) ** 2).sum()
    assert fit.standard_deviations[1] == pytest.approx(fit.sigma / np.sqrt(spread))
    curve, single = fit.bands([[3.0]])
    expected = 1.0 / 12.0 + (3.0 - x.mean()) ** 2 / spread
    assert fit.quantile == pytest.approx(2.228, abs=1e-3)  # Student, 10 degrees of freedom
    assert curve[0] == pytest.approx(fit.quantile * fit.sigma * np.sqrt(expected))
    assert single[0] == pytest.approx(fit.quantile * fit.sigma * np.sqrt(1.0 + expected))


def test_a_common_zero_error_widens_the_intercept_and_nothing_else() -> None:
    thrust = 1e-5 * SIGNAL**2 + 0.1 * np.random.default_rng(8).standard_normal(21)
    plain = least_squares(SIGNAL[:, None], thrust, SECOND)
    tared = least_squares(SIGNAL[:, None], thrust, SECOND, common=np.full((21, 1), 0.5))
    np.testing.assert_allclose(tared.coefficients, plain.coefficients)
    np.testing.assert_allclose(tared.standard_deviations[1:], plain.standard_deviations[1:], rtol=1e-9)
    assert tared.standard_deviations[0] == pytest.approx(np.hypot(plain.standard_deviations[0], 0.5))


def test_too_few_or_equal_points_are_refused() -> None:
    with pytest.raises(ValueError, match="3 operating points for 3 coefficients; expected at least 4"):
        least_squares([[1.0], [2.0], [3.0]], [1.0, 2.0, 3.0], SECOND)
    with pytest.raises(ValueError, match="do not determine the coefficients"):
        least_squares([[1.0]] * 6, [1.0, 2.0, 3.0, 1.0, 2.0, 3.0], SECOND)


@pytest.mark.parametrize("wrong", [(3,), (7, 12), (0, 10, 20)])
def test_outliers_are_found_and_only_they(wrong: tuple[int, ...]) -> None:
    thrust = 4e-3 * SIGNAL + 1.9e-5 * SIGNAL**2 + 0.3 * np.random.default_rng(9).standard_normal(21)
    thrust[list(wrong)] += 6.0  # twenty standard deviations
    found = outliers(SIGNAL[:, None], thrust, SECOND)
    assert set(np.flatnonzero(found)) == set(wrong)


def test_honest_points_are_accused_in_one_test_of_twenty() -> None:
    rng = np.random.default_rng(10)
    accused = sum(
        bool(outliers(SIGNAL[:, None], SIGNAL**2 * 1e-5 + rng.standard_normal(21), SECOND).any())
        for _ in range(400)
    )
    # 5 % wanted; binomial deviation 1.1 %. Suspects must pass the robust fit first, which makes it rarer.
    assert accused / 400 < 0.05 + 3.0 * 0.011


def test_what_no_model_explains_accuses_the_model() -> None:
    assert not outliers(SIGNAL[:, None], np.sign(np.sin(SIGNAL / 100.0)), SECOND).any()
    exact = 1e-5 * SIGNAL**2
    assert not outliers(SIGNAL[:, None], exact, SECOND).any()


@pytest.mark.parametrize(
    ("truth", "best"),
    [
        (lambda s: 1.9e-5 * s**2, "square"),
        (lambda s: 4e-3 * s + 1.9e-5 * s**2, "second order through the origin"),
        (lambda s: -4.0 + 6e-3 * s + 1.9e-5 * s**2, "second order, free"),
    ],
)
def test_the_order_of_the_truth_is_recommended(truth: object, best: str) -> None:
    assert callable(truth)
    hits = 0
    for seed in range(40):
        thrust = truth(SIGNAL) + 0.3 * np.random.default_rng(seed).standard_normal(21)
        hits += recommended(candidates(SIGNAL, thrust)).name == best
    # AICc prefers a needless coefficient in one of six cases, P(chi2_1 > 2) = 0.16; 40 draws: 0.06.
    assert hits >= 40 * (1.0 - 0.16 - 3.0 * 0.06)


def test_a_lack_of_fit_is_said_with_what_it_costs_in_newtons() -> None:
    thrust = 4e-3 * SIGNAL + 1.9e-5 * SIGNAL**2 + 0.05 * np.random.default_rng(11).standard_normal(21)
    found = candidates(SIGNAL, thrust)
    said = lack_of_fit(found, terms_of(2, 1, square=True), 21)
    assert "second order through the origin describes the points better" in said
    assert "F test p below 0.001" in said
    assert (
        lack_of_fit(found, terms_of(2, 1, through_origin=True), 21) == "second order through the origin fits"
    )
    assert "fits as well, with fewer coefficients" in lack_of_fit(found, terms_of(3, 1), 21)
