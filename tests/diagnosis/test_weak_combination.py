"""Verdicts and weak combinations of synthetic information: the columns are given, the noise is one."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray

from seatrial.diagnosis.identifiability import SETTINGS as IDENTIFIABILITY_SETTINGS
from seatrial.diagnosis.identifiability import Identifiability, judge, weak_groups
from seatrial.diagnosis.roles import role
from seatrial.statistics.linearisation import Linearisation, Piece, Unknown, covariance, eliminate, singular

Array = NDArray[np.float64]


def sentence(found: Identifiability, *names: str) -> str:
    """The sentence about exactly these coefficients."""
    matching = [one.sentence for one in found.combinations if set(one.names) == set(names)]
    assert len(matching) == 1, found.sentences
    return matching[0]


def made(
    columns: Mapping[str, Array],
    values: Mapping[str, float],
    *,
    widths: Mapping[str, float] | None = None,
    priors: Mapping[str, float] | None = None,
    moving: str = "uvwpqr",
) -> Linearisation:
    """Linearisation of columns (n,) by name; names with a colon are nuisance parameters of prior 1."""
    widths, priors = widths or {}, priors or {}
    unknowns = []
    for name in columns:
        nuisance = ":" in name
        width = widths.get(name, 4.0 * abs(values.get(name, 1.0)))
        prior = 1.0 if nuisance else priors.get(name, math.inf)
        scale = prior if nuisance else width
        kind = "nuisance" if nuisance else "coefficient"
        unknowns.append(Unknown(name, kind, "1", -width, width, scale, 0.0, prior))  # type: ignore[arg-type]
    jacobian = np.stack(list(columns.values()), axis=1)[:, None, :]
    n = len(jacobian)
    piece = Piece(
        trial="run",
        t=np.linspace(0.0, 0.1 * (n - 1), n),
        residual=np.zeros((n, 1)),
        counted=np.ones((n, 1), dtype=bool),
        weight=np.ones((n, 1)),
        jacobian=jacobian,
        nu=np.tile([float(letter in moving) for letter in "uvwpqr"], (n, 1)),
    )
    start = np.array([values.get(name, 1.0) for name in columns])
    return Linearisation(tuple(unknowns), start, ("u",), np.ones(1), 0.1, (piece,))


def white(count: int, *, n: int = 400, seed: int = 0) -> list[Array]:
    return list(np.random.default_rng(seed).normal(size=(count, n)))


def test_verdict_follows_the_standard_deviation_over_the_natural_size() -> None:
    # One column of squared norm 1/sd^2; value 1, bounds 4 wide: the natural size is 1.
    for sd, verdict in ((0.2, "identifiable"), (0.5, "weak"), (2.0, "not identifiable")):
        column = np.array([1.0 / sd, 0.0])
        found = judge(made({"X_u": column}, {})).coefficients[0]
        assert found.sd == pytest.approx(sd)
        assert found.relative == pytest.approx(sd)
        assert found.verdict == verdict
    # A value of zero: a tenth of the bounds is its size. Narrow bounds: their standard deviation is.
    small = judge(made({"X_u": np.array([10.0])}, {"X_u": 0.0}, widths={"X_u": 10.0})).coefficients[0]
    assert small.relative == pytest.approx(0.1)
    narrow = judge(made({"X_u": np.array([10.0])}, {"X_u": 5.0}, widths={"X_u": 0.3})).coefficients[0]
    assert narrow.relative == pytest.approx(0.1 * math.sqrt(12.0) / 0.3)
    assert narrow.verdict == "not identifiable"


def test_given_standard_deviations_widen_but_never_narrow() -> None:
    a, b = white(2)
    lin = made({"X_u": a, "Y_v": b}, {})
    plain = judge(lin)
    wide = judge(lin, {"X_u": 0.4, "Y_v": 1e-9})
    assert wide.coefficients[0].sd == 0.4
    assert wide.coefficients[1].sd == plain.coefficients[1].sd
    assert wide.verdicts == {"X_u": "weak", "Y_v": "identifiable"}
    assert wide.combinations[0].names == ("X_u",)
    assert wide.combinations[0].kind == "unexcited"
    lost = judge(lin, {"X_u": math.inf})
    assert lost.verdicts["X_u"] == "not identifiable"
    assert lost.combinations[0].names == ("X_u",)


def test_correlation_and_inflation_are_those_of_regression() -> None:
    a, b = white(2)
    a, b = a / np.linalg.norm(a), (b - a * (a @ b) / (a @ a))
    mixed = 0.8 * a + 0.6 * b / np.linalg.norm(b)  # correlated by 0.8 with the first
    found = judge(made({"X_u": 100.0 * a, "X_uu": 100.0 * mixed}, {}))
    assert found.correlation[0, 1] == pytest.approx(-0.8)
    for one in found.coefficients:
        assert one.correlation == pytest.approx(0.8)
        assert one.inflation == pytest.approx(1.0 / 0.36)


def test_singular_vectors_are_those_of_the_scaled_sensitivities() -> None:
    a, b, c = white(3)
    lin = made({"X_u": a, "X_uu": b, "Y_v": c}, {}, widths={"X_u": 2.0, "X_uu": 3.0, "Y_v": 5.0})
    found = judge(lin)
    scaled = np.stack([2.0 * a, 3.0 * b, 5.0 * c], axis=1)
    _, values, rows = np.linalg.svd(scaled, full_matrices=False)
    assert found.singular_values == pytest.approx(values)
    assert np.abs(found.vectors) == pytest.approx(np.abs(rows))
    assert found.condition == pytest.approx(values[0] / values[-1])


def test_a_prior_counts_as_information() -> None:
    a = white(1)[0]
    columns, values = {"I_y": a, "M_qdot": -a}, {"I_y": 70.0, "M_qdot": -60.0}
    assert set(judge(made(columns, values)).verdicts.values()) == {"not identifiable"}
    weighed = judge(made(columns, values, priors={"I_y": 1.0}))
    assert set(weighed.verdicts.values()) == {"identifiable"}
    assert weighed.sentences == ()


def test_a_nuisance_parameter_that_hides_a_coefficient_is_named() -> None:
    a, b = white(2)
    found = judge(made({"Y_0": a, "Y_v": b, "leg: current_east": 10.0 * a, "leg: bias_r": b[::-1]}, {}))
    assert found.verdicts == {"Y_0": "not identifiable", "Y_v": "identifiable"}
    assert found.combinations[0].kind == "nuisance"
    told = sentence(found, "Y_0")
    assert told.startswith("Y_0: cannot be separated from current_east of leg;")
    assert "opposite directions" in told


def test_a_nuisance_parameter_that_hides_a_pair_is_named() -> None:
    a, b, c, d = white(4)
    columns = {"X_u": a, "X_uu": b, "Y_v": c, "leg: bias_r": d, "leg: current_north": 20.0 * (a + b)}
    found = judge(made(columns, {}))
    assert "cannot be separated from current_north of leg" in sentence(found, "X_u", "X_uu")
    del columns["leg: current_north"]
    assert judge(made(columns, {})).sentences == ()


def test_still_axes_and_silent_forces_are_told_apart() -> None:
    a, none = white(1)[0], np.zeros(400)
    columns = {"X_u": a, "Z_ww": none, "stern.p1_astern": none}
    still = judge(made(columns, {}, moving="u"))
    assert "nothing heaves in these trials" in sentence(still, "Z_ww")
    assert "these trials do not run it" in sentence(still, "stern.p1_astern")
    assert "astern in steps" in sentence(still, "stern.p1_astern")
    locked = sentence(judge(made(columns, {}, moving="uw")), "Z_ww")
    assert "no trial leaves the vehicle free to move in heave; free Z" in locked


def test_gains_that_push_in_one_proportion_are_one_sentence() -> None:
    a, b = white(2)
    columns = {f"{name}.gain": a for name in ("SbU", "SbL", "PU", "PL")} | {"N_r": b}
    found = judge(made(columns, {}))
    told = sentence(found, *(name for name in columns if name != "N_r"))
    assert "push in one proportion" in told
    assert "alone" in told
    assert found.verdicts["N_r"] == "identifiable"


def homogeneous() -> tuple[dict[str, Array], dict[str, float]]:
    """Forces of one axis that add up to nothing with their values: the drive balances the rest."""
    values = {"m": 100.0, "X_u": -5.0, "X_uu": -8.0, "X_udot": -20.0}
    columns = dict(zip(values, white(4, seed=3), strict=True))
    drive = -sum((values[name] * column for name, column in columns.items()), np.zeros(400))
    return {**columns, "stern.gain": drive}, {**values, "stern.gain": 1.0}


def test_homogeneous_direction_is_named_beside_what_is_identified() -> None:
    columns, values = homogeneous()
    a, b = white(2, seed=9)
    columns |= {"K_p": 50.0 * a, "I_y": b, "M_qdot": -b}
    found = judge(made(columns, values | {"I_y": 70.0, "M_qdot": -60.0, "K_p": -1.0}))
    together = ("m", "X_u", "X_uu", "X_udot", "stern.gain")
    assert sentence(found, *together).startswith("all of m, X_u, X_uu, X_udot, stern.gain scale together")
    assert "only their sum" in sentence(found, "I_y", "M_qdot")
    assert found.verdicts["K_p"] == "identifiable"
    assert len(found.sentences) == 2
    # A bench test of the thrust to one per cent settles the scale, and nothing else.
    bench = judge(made(columns, values | {"I_y": 70.0, "M_qdot": -60.0}, priors={"stern.gain": 0.01}))
    assert [set(one.names) for one in bench.combinations] == [{"I_y", "M_qdot"}]


def test_every_weak_coefficient_is_in_a_sentence() -> None:
    """Random mixtures of rank r: at most k - r combinations, and no weak coefficient is left out."""
    rng = np.random.default_rng(7)
    names = ["X_u", "X_uu", "Y_v", "Y_vv", "N_r", "N_rr", "N_uv", "Z_w", "Z_ww", "M_q", "M_qq", "K_p"]
    for _ in range(20):
        rank = int(rng.integers(4, len(names)))
        mixed = 100.0 * rng.normal(size=(300, rank)) @ rng.normal(size=(rank, len(names)))
        silenced = rng.random(len(names)) < 0.1
        columns = {
            name: np.where(off, 0.0, mixed[:, i])
            for i, (name, off) in enumerate(zip(names, silenced, strict=True))
        }
        found = judge(made(columns, {}))
        weak = {name for name, verdict in found.verdicts.items() if verdict != "identifiable"}
        named = {name for one in found.combinations for name in one.names}
        assert weak <= named
        several = [one for one in found.combinations if one.kind == "combination"]
        assert len(several) <= max(len(names) - int(silenced.sum()) - rank, 0)


def test_groups_are_the_smallest_ones() -> None:
    rng = np.random.default_rng(1)
    columns = rng.normal(size=(300, 6))
    columns[:, 1] = columns[:, 0]  # a pair
    columns[:, 4] = columns[:, 2] - columns[:, 3]  # a triple
    mixed = [role(name) for name in ("X_u", "X_uu", "Y_v", "N_r", "Z_w", "K_p")]
    groups = weak_groups(columns.T @ columns, mixed, np.ones(6))
    assert [group.places for group in groups] == [(0, 1), (2, 3, 4)]
    assert all(group.sd > IDENTIFIABILITY_SETTINGS.absent > IDENTIFIABILITY_SETTINGS.weak for group in groups)


def test_result_is_plain_json() -> None:
    a, none = white(1)[0], np.zeros(400)
    found = judge(made({"X_u": a, "X_uu": a, "K_p": none}, {}))
    plain = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert plain["coefficients"][2]["sd"] is None
    assert plain["condition"] is None
    assert plain["combinations"][0]["names"] == ["K_p"]
    assert len(plain["vectors"]) == 3


def test_nothing_to_judge() -> None:
    found = judge(made({"run: bias_u": white(1)[0]}, {}))
    assert found.names == found.sentences == ()
    assert found.condition == 1.0


def test_information_of_what_rounding_leaves() -> None:
    a, b = white(2)
    rows = np.stack([a, b, a + b], axis=1)
    total = rows.T @ rows
    assert np.all(np.diag(covariance(total)) > 1e6)  # null direction, not a negative variance
    assert np.array_equal(eliminate(total, [0], [1, 2]), [[0.0]])  # wholly absorbed, not 1e-14
    assert math.isinf(singular(total)[2])


def test_no_deviation_above_half_of_the_value_is_identifiable() -> None:
    # Bounds 100 wide: the natural size is 10, and 1.7 beside a value of 1 would be identifiable.
    for sd, verdict in ((0.4, "identifiable"), (0.6, "weak"), (1.7, "weak")):
        lin = made({"X_u": np.array([1.0 / sd])}, {"X_u": -1.0}, widths={"X_u": 100.0})
        found = judge(lin, {"X_u": sd})
        assert found.coefficients[0].relative == pytest.approx(0.1 * sd)
        assert found.verdicts == {"X_u": verdict}
        assert bool(found.sentences) is (verdict == "weak")
    assert "X_u: -1 ± 1.7" in found.sentences[0]
    assert "170 % of its value; hold it at zero" in found.sentences[0]
    # A start value of zero, before any search, is no estimate.
    assert judge(made({"X_u": np.array([1.0])}, {"X_u": 0.0}, widths={"X_u": 100.0})).sentences == ()
