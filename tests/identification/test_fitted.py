"""Vehicles drawn from what is known of their coefficients: covariance, what is possible, what repeats."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from numpy.typing import NDArray

from seatrial._core import State, Vehicle
from seatrial.base.errors import CampaignError, SimulationError
from seatrial.base.work import Work
from seatrial.campaign.campaign import Campaign
from seatrial.identification.fitted import Fitted, checked_numbers, generator, uniforms
from seatrial.identification.identification import Identification
from seatrial.vehicle.stability import PossibleCoefficients

Array = NDArray[np.float64]

CAMPAIGN = """
format = 1
name = "made"
vehicle = "cwolf"
[trials.run]
file = "run.parquet"
[[stages]]
name = "surge"
trials = ["run"]
axes = { free = "X" }
budget = { population = 8, generations = 10 }
[stages.coefficients]
X_udot = [-30.0, -1.0]
X_uu = { bounds = [-30.0, -4.0], tie = [{ name = "Y_vv", factor = 30.0 }] }
[polish]
segment_s = 20.0
"""


@pytest.fixture(scope="module")
def identified(tmp_path_factory: pytest.TempPathFactory) -> tuple[Identification, Path]:
    """An identification of surge, and its run directory; Y_vv follows X_uu and the trial never moves it."""
    rng = np.random.default_rng(4)
    vehicle = Vehicle.load("cwolf").with_coefficients({"X_udot": -9.0, "X_uu": -14.0})
    t = np.arange(0.0, 60.0, 0.1)
    steps = np.repeat(rng.uniform(-1500.0, 1500.0, 12), 50)
    commands = {name: steps * (name[:2] in ("Sb", "PU", "PL")) for name in vehicle.actuators}
    run = vehicle.simulate(t, commands, State(), free="X")
    u = np.asarray(run.nu)[:, 0] + rng.normal(0.0, 0.02, len(t))
    frame = pl.DataFrame({"t_s": t, "u_m_s": u, **{f"cmd.{name}": c for name, c in commands.items()}})
    found = Campaign.from_toml(CAMPAIGN, source="made.toml", trials={"run": frame}).identify(
        work=Work(threads=1)
    )
    return found, found.save(tmp_path_factory.mktemp("run") / "made")


def test_run_directory_holds_the_covariance_of_its_identification(
    identified: tuple[Identification, Path],
) -> None:
    found, folder = identified
    here, there = Fitted.of(found), Fitted.of(folder)
    assert here.names == there.names == ("X_udot", "X_uu", "Y_vv")
    np.testing.assert_array_equal(here.covariance, there.covariance)  # JSON keeps every digit
    np.testing.assert_allclose(here.sigma, [found.sigma[name] for name in here.names], rtol=1e-9)
    assert here.draws(5, 3)["X_uu"].tolist() == there.draws(5, 3)["X_uu"].tolist()


def test_tied_coefficients_are_drawn_together(identified: tuple[Identification, Path]) -> None:
    drawn = Fitted.of(identified[0]).draws(50, 1)
    # The tie's factor is 30; 1e-6 is what the root of a singular matrix keeps.
    np.testing.assert_allclose(drawn["Y_vv"], 30.0 * drawn["X_uu"], rtol=1e-6)
    assert np.std(drawn["X_uu"]) > 0.0


def test_run_directory_of_two_runs_is_refused(
    identified: tuple[Identification, Path], tmp_path: Path
) -> None:
    _, folder = identified
    data = json.loads((folder / "identification.json").read_text())
    (tmp_path / "vehicle.toml").write_text(Vehicle.load("cwolf").to_toml())
    (tmp_path / "identification.json").write_text(json.dumps(data))
    with pytest.raises(CampaignError, match="covariance holds about X_udot"):
        Fitted.of(tmp_path)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda data: data.pop("covariance"), "expected the key covariance, found none"),
        (lambda data: data["covariance"].pop("at"), "key covariance: expected names"),
        (lambda data: data["covariance"]["matrix"].pop(), "key covariance: expected names"),
        (lambda data: data["covariance"]["matrix"][0].__setitem__(0, None), "expected finite numbers"),
    ],
)
def test_spoiled_run_directory_is_refused(
    identified: tuple[Identification, Path], tmp_path: Path, spoil: Callable[[Any], Any], message: str
) -> None:
    found, folder = identified
    data = json.loads((folder / "identification.json").read_text())
    spoil(data)
    (tmp_path / "vehicle.toml").write_text(found.vehicle.to_toml())
    (tmp_path / "identification.json").write_text(json.dumps(data))
    with pytest.raises(CampaignError, match=message):
        Fitted.of(tmp_path)


def test_folder_that_is_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CampaignError, match=r"identification\.json cannot be read \(No such file"):
        Fitted.of(tmp_path)


def test_interrupted_run_counts_as_exact(identified: tuple[Identification, Path], tmp_path: Path) -> None:
    found, folder = identified
    data = json.loads((folder / "identification.json").read_text()) | {"covariance": None}
    (tmp_path / "vehicle.toml").write_text(found.vehicle.to_toml())
    (tmp_path / "identification.json").write_text(json.dumps(data))
    fitted = Fitted.of(tmp_path)
    assert fitted.draws(3, 1) == {}
    assert "count as exact" in fitted.notes[0]


def test_law_a_draw_depends_on_seed_and_number_alone() -> None:
    fitted = Fitted.of("cwolf", percent={"X_u": 80.0, "*_vv": 20.0})
    many, few = fitted.drawn(60, 9), fitted.drawn([59, 7], 9)
    assert few.values.tolist() == many.values[[59, 7]].tolist()
    assert few.thrown.tolist() == many.thrown[[59, 7]].tolist()
    assert fitted.drawn(60, 10).values[7].tolist() != many.values[7].tolist()


def test_first_draw_may_be_the_vehicle_itself() -> None:
    fitted = Fitted.of("cwolf", percent={"X_uu": 10.0})
    first = fitted.draws(3, 1, nominal_first=True)["X_uu"]
    assert first[0] == fitted.nominal[0]
    assert first[1:].tolist() == fitted.draws(3, 1)["X_uu"][1:].tolist()


def test_moments_of_the_draws_are_those_of_the_covariance() -> None:
    names, sd = ("X_uu", "Y_vv", "N_rr"), np.array([0.5, 10.0, 5.0])
    correlation = np.array([[1.0, 0.6, -0.3], [0.6, 1.0, 0.2], [-0.3, 0.2, 1.0]])
    fitted = Fitted(Vehicle.load("cwolf"), names, correlation * np.outer(sd, sd))
    drawn = fitted.drawn(4000, 2)
    assert drawn.thrown.sum() == 0  # all lie twenty deviations or more from zero
    scaled = (drawn.values - fitted.nominal) / sd
    # Means scatter by 1/sqrt(4000) = 0.016, correlations by at most that: four deviations.
    np.testing.assert_allclose(scaled.mean(axis=0), 0.0, atol=0.064)
    np.testing.assert_allclose(np.cov(scaled.T), correlation, atol=0.09)  # variances scatter by sqrt(2/4000)


def test_impossible_vehicles_are_thrown_away_and_told() -> None:
    # X_u = -3 with a deviation of 3: a share of Phi(-1) = 0.159 would drive the vehicle on.
    fitted = Fitted(Vehicle.load("cwolf"), ("X_u",), np.array([[9.0]]))
    drawn = fitted.drawn(3000, 5)
    assert (drawn.values <= 0.0).all()
    lost = drawn.thrown.sum() / (drawn.thrown.sum() + 3000)
    assert lost == pytest.approx(0.159, abs=0.025)  # four deviations of a share of 3570
    assert "physically impossible" in drawn.sentence()
    assert fitted.drawn(1, 5, nominal_first=True).sentence() == ""
    assert drawn.doubt().startswith(f"{100 * lost:.2g} % of the vehicles drawn")
    assert "most often by X_u" in drawn.doubt()
    assert "staircase of speeds" in fitted.doubt()
    sure = Fitted(Vehicle.load("cwolf"), ("X_u",), np.array([[1.0]]))
    assert sure.doubt() == ""


def test_condition_that_the_vehicle_itself_breaks_is_not_asked() -> None:
    driven = Vehicle.load("cwolf").with_coefficients({"X_u": 5.0})
    assert Fitted(driven, ("X_u",), np.array([[1.0]])).drawn(20, 1).thrown.sum() == 0


def test_six_coefficients_without_a_sign_of_their_own_are_all_drawn_possible() -> None:
    names = tuple(f"{force}_{speed}" for force, speed in zip("XYZKMN", "uvwpqr", strict=True))
    drawn = Fitted(Vehicle.load("cwolf"), names, 1e8 * np.eye(6)).drawn(50, 1)
    assert (drawn.values <= 0.0).all()  # one attempt of 64 is possible


def test_law_possible_vehicles_have_a_positive_mass_matrix_and_damp() -> None:
    fitted = Fitted.of(
        "beluga", percent={"*dot": 50.0, "X_u": 90.0, "K_p": 90.0, "Y_v": 90.0, "*.gain": 40.0}
    )
    drawn = fitted.draws(40, 11)
    assert all((drawn[name] > 0.0).all() for name in drawn if name.endswith(".gain"))
    for k in range(40):
        vehicle = fitted.vehicle.with_coefficients({name: column[k] for name, column in drawn.items()})
        assert np.linalg.eigvalsh(vehicle.mass_matrix()).min() > 0.0
        values = vehicle.coefficients()
        damping = -np.array([[values.get(f"{f}_{v}", 0.0) for v in "uvwpqr"] for f in "XYZKMN"])
        assert np.linalg.eigvalsh(damping + damping.T).min() >= -1e-9


def test_cross_damping_that_adds_energy_is_impossible() -> None:
    possible = PossibleCoefficients(Vehicle.load("cwolf"), ["Y_r", "N_v"])
    # Y_v N_r = 20 * 15: the symmetric part stays positive up to a mean of 17.3.
    assert possible.mask([[17.0, 17.0], [18.0, 18.0], [100.0, -100.0]]).tolist() == [True, False, True]


def test_hopeless_draws_are_refused_in_a_sentence() -> None:
    vehicle = Vehicle.load("cwolf")
    names = [f"{f}_{v}" for f in "XYZKMN" for v in "uvwpqr" if f"{f}_{v}" != "X_u"]
    fitted = Fitted(vehicle, tuple(names), 1e8 * np.eye(len(names)))
    with pytest.raises(CampaignError, match="1000 vehicles drawn for number 0 are all physically impossible"):
        fitted.drawn(1, 1)


def test_percentages_reach_names_patterns_and_groups() -> None:
    fitted = Fitted.of("cwolf", percent={"X_uu": 10.0, "stern.gain": 5.0, "Y_v*": 1.0})
    own = fitted.vehicle.coefficients()
    sigma = dict(zip(fitted.names, fitted.sigma.tolist(), strict=True))
    assert sigma["X_uu"] == pytest.approx(0.1 * abs(own["X_uu"]))
    assert sigma["Y_vv"] == pytest.approx(0.01 * abs(own["Y_vv"]))
    gains = [fitted.names.index(f"{name}.gain") for name in ("SbU", "SbL", "PU", "PL")]
    np.testing.assert_allclose(fitted.covariance[np.ix_(gains, gains)], 0.0025 * np.ones((4, 4)), rtol=1e-12)


@pytest.mark.parametrize(
    ("percent", "message"),
    [
        ({"X_uuu": 10.0}, "no coefficient 'X_uuu'; did you mean \"X_uu\""),
        ({"X_uu": 0.0}, "expected percent above 0 and below 100, found 0.0"),
        ({"X_uu": "ten"}, "expected percent above 0 and below 100, found 'ten'"),
        ({"x_g": 10.0}, "x_g of cwolf is zero"),
    ],
)
def test_percentages_that_cannot_be_meant_are_refused(percent: Any, message: str) -> None:
    with pytest.raises(CampaignError, match=message):
        Fitted.of("cwolf", percent=percent)


@given(seed=some.integers(0, 2**53 - 1), number=some.integers(0, 2**40), cause=some.integers(0, 9))
@settings(max_examples=30, deadline=None)
def test_law_numbered_draws_are_repeatable_inside_zero_and_one_and_apart(
    seed: int, number: int, cause: int
) -> None:
    wide = uniforms(seed, [number, number + 1], cause=cause, width=6)
    assert (wide > 0.0).all()
    assert (wide < 1.0).all()
    assert wide[0, :3].tolist() == uniforms(seed, [number], cause=cause, width=3)[0].tolist()
    assert wide[0].tolist() != wide[1].tolist()
    other = generator(seed, number, cause=cause, attempt=1).random(6)
    assert wide[0].tolist() != other.tolist()


def test_a_uniform_number_of_zero_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """NumPy's may be: then the quantile of a normal distribution would be infinite."""

    def zeros(*_: int, **__: int) -> Any:
        return SimpleNamespace(random=np.zeros)

    monkeypatch.setattr("seatrial.identification.fitted.generator", zeros)
    assert uniforms(1, [0, 1], cause=0, width=3).tolist() == [[2.0**-54] * 3] * 2


def test_numbers_of_draws_are_checked() -> None:
    assert checked_numbers(2) == [0, 1]
    for wrong in (-1, [1.5], [-3], True, "many", [[1], [2, 3]]):
        with pytest.raises(SimulationError, match="whole and from 0 on"):
            checked_numbers(cast(Any, wrong))


def test_a_coefficient_that_stays_at_its_bound_is_drawn_there_to_the_last_bit() -> None:
    vehicle = Vehicle.load("cwolf").with_coefficients({"Z_ww": -3e-16})
    names = ("X_u", "X_uu", "Y_v", "Y_vv", "Z_w", "Z_ww", "K_p", "K_pp", "M_q", "M_qq", "N_r", "N_rr")
    own = np.array([vehicle.coefficients()[name] for name in names])
    mixed = np.random.default_rng(1).normal(size=(12, 12)) * 0.01 * own
    covariance = mixed.T @ mixed
    covariance[5] = covariance[:, 5] = 0.0
    drawn = Fitted(vehicle, names, covariance, ()).drawn(200, 0)
    assert set(drawn.coefficients["Z_ww"].tolist()) == {vehicle.coefficients()["Z_ww"]}
    assert drawn.impossible == 0.0
