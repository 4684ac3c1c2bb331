"""Covariance of identified coefficients: bounds where data do not tell, bench thrust, what it leaves out."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seatrial._core import Vehicle
from seatrial.estimation.scale import STATIC, THRUST, Held, Homogeneity
from seatrial.identification.estimate import CoefficientCovariance, coefficient_covariance
from seatrial.problem.parameter import Parameter

Array = NDArray[np.float64]


def joint(
    covariance: Any,
    *,
    singular: Any = None,
    vectors: Any = None,
    sigma: Any = None,
    bench: Any = None,
    warning: str | None = None,
    held: tuple[Held, ...] = (),
    names: tuple[str, str] = ("X_uu", "Y_vv"),
    at_bound: tuple[str | None, ...] = (None, None),
) -> SimpleNamespace:
    """What of an identification counts: two parameters, X_uu and Y_vv, with bounds 40 and 400 wide."""
    widths = (40.0, 400.0)
    matrix = np.array(covariance, float)
    parameters = tuple(
        Parameter(name, ((name, 1.0),), "N s2/m2", -10.0, -width, 0.0, False)
        for name, width in zip(names, widths, strict=True)
    )
    assessment = SimpleNamespace(
        parameters=parameters,
        uncertainty=SimpleNamespace(
            names=names,
            at_bound=at_bound,
            covariance=matrix,
            sigma=np.sqrt(np.diag(matrix)) if sigma is None else np.array(sigma),
        ),
        identifiability=SimpleNamespace(
            names=names,
            singular_values=np.ones(2) if singular is None else np.array(singular),
            vectors=np.eye(2) if vectors is None else np.array(vectors),
        ),
        residual_analysis=SimpleNamespace(warning=warning),
    )
    scale = SimpleNamespace(
        homogeneity=Homogeneity((), (), held), tested=() if bench is None else tuple(bench.pulls)
    )
    return SimpleNamespace(
        assessment=assessment, vehicle=Vehicle.load("cwolf"), scale=scale, bench=bench, staged=()
    )


def covariance_of(one: SimpleNamespace) -> CoefficientCovariance:
    """Covariance of what `joint` gave."""
    known: Any = one
    return coefficient_covariance(
        known.assessment, known.vehicle, scale=known.scale, staged=known.staged, bench=known.bench
    )


def test_what_the_data_tell_is_left_as_it_is() -> None:
    known = covariance_of(joint([[4.0, 3.0], [3.0, 100.0]]))
    np.testing.assert_allclose(known.matrix, [[4.0, 3.0], [3.0, 100.0]], rtol=1e-12)
    assert known.notes == ()


def test_a_gain_at_its_bound_varies_inside_its_bounds_and_damping_at_zero_does_not() -> None:
    known = covariance_of(
        joint([[4.0, 0.0], [0.0, 1.0]], names=("X_u", "SbL.gain"), at_bound=("upper", "lower"))
    )
    np.testing.assert_allclose(np.diag(known.matrix), [0.0, 400.0**2 / 12.0], rtol=1e-12)
    assert "SbL.gain: constrained less by the data than by the campaign's bounds" in known.notes[0]


def test_what_ended_at_a_bound_stays_there_and_the_rest_is_known_as_beside_a_fixed_value() -> None:
    known = covariance_of(joint([[4.0, 3.0], [3.0, 100.0]], at_bound=("upper", None)))
    np.testing.assert_allclose(known.matrix, [[0.0, 0.0], [0.0, 100.0 - 3.0**2 / 4.0]], rtol=1e-12)
    assert known.notes == ("X_uu: ended at a bound, and draws keep it there.",)


def test_notes_say_what_no_draw_contains() -> None:
    """The residuals' warning, and what holds the scale of all forces where no bench test measured it."""
    thrust = Held(THRUST, ("SbL",))
    known = covariance_of(joint(np.eye(2), warning="The truth lies outside", held=(thrust,)))
    outside, scale = known.notes
    assert outside.startswith("The truth lies outside. Draws stay within that class")
    assert scale.startswith("The scale rests on the thrust of SbL as in the vehicle file; draws do not vary")
    fitted = CoefficientCovariance.from_dict(json.loads(json.dumps(known.to_dict())), "run")
    assert fitted.notes == known.notes
    only_moments = covariance_of(joint(np.eye(2), held=(Held(STATIC, ("m g z_g",)),)))
    assert only_moments.notes == ()


def test_direction_without_information_gets_the_bounds_and_keeps_its_sum() -> None:
    # In widths of the bounds the data fix (X + Y)/sqrt(2) to 0.01 and tell nothing of (X - Y)/sqrt(2).
    s = 0.5**0.5
    both, width = np.array([[s, s], [s, -s]]), np.array([40.0, 400.0])
    fixed = 1e-4 * np.outer(both[0], both[0]) * np.outer(width, width)
    # Whatever number stands in the direction that data do not tell, it means nothing.
    rounding = 7.0 * np.outer(both[1], both[1]) * np.outer(width, width)
    known = covariance_of(
        joint(fixed + rounding, singular=[100.0, 1e-9], vectors=both, sigma=[np.inf, np.inf])
    )
    spread = both @ (known.matrix / np.outer(width, width)) @ both.T
    # rtol: rounding of the eigenvectors, of 1e-16 beside 1/12 against 1e-4
    np.testing.assert_allclose(spread, np.diag([1e-4, 1.0 / 12.0]), rtol=1e-9, atol=1e-15)
    assert known.notes[0].startswith("X_uu, Y_vv: constrained less by the data than by the campaign's bounds")


def test_a_coefficient_of_a_stage_alone_is_said_to_stay() -> None:
    found = joint(np.eye(2))
    found.staged = ("X_uu", "N_rr")
    known = covariance_of(found)
    (note,) = known.notes
    assert note.startswith("N_rr: set by a stage and not in the joint estimate")


def test_coefficient_wider_than_its_bounds_is_cut_there() -> None:
    known = covariance_of(joint([[1.0, 0.0], [0.0, 1e6]]))
    np.testing.assert_allclose(known.matrix, np.diag([1.0, 400.0**2 / 12.0]), rtol=1e-12)
    assert known.notes[0].startswith("Y_vv: constrained less by the data")


def test_thrust_varies_as_the_bench_test_found_it() -> None:
    class Line:
        scale, quantile = np.ones(1), 2.0

        def bands(self, inputs: Any) -> tuple[Array, Array]:
            return np.array([0.4 * inputs[0][0]]), np.zeros(1)

        def at(self, inputs: Any) -> Array:
            return np.array([10.0 * inputs[0][0]])

    fit = SimpleNamespace(
        unit=SimpleNamespace(actuators=("SbU", "PU")),
        points=SimpleNamespace(signal=np.array([1.0, 5.0]), voltage_v=np.zeros(2)),
        directions={"ahead": SimpleNamespace(fit=Line(), points=np.array([0, 1]))},
    )
    known = covariance_of(joint(np.eye(2), bench=SimpleNamespace(pulls={"stern": fit})))
    assert known.names == ("X_uu", "Y_vv", "SbU.gain", "PU.gain")
    # Half the band over the quantile: 0.4 / 2 / 10 = 2 %, of gains of one, common to both.
    np.testing.assert_allclose(known.matrix[2:, 2:], 4e-4 * np.ones((2, 2)), rtol=1e-12)
    assert known.notes == ("Thrust varies by the bench test's own standard deviation: stern 2 %.",)


def test_covariance_survives_its_dict() -> None:
    known = CoefficientCovariance(("X_uu",), np.array([-9.7]), np.array([[0.04]]), ("a note",))
    again = CoefficientCovariance.from_dict(known.to_dict(), "here")
    assert (again.names, again.notes) == (known.names, known.notes)
    assert (again.at[0], again.matrix[0, 0]) == (-9.7, 0.04)
