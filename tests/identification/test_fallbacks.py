"""What follows the stages of an identification falls back to what was there, and says so as data."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from seatrial import Campaign, Identification, SimulationError, Trial, Vehicle
from seatrial.base.errors import CampaignError, NumericalError, SeatrialError
from seatrial.base.finding import Fallback, Fallbacks, is_numerical
from seatrial.base.work import Work
from seatrial.estimation.innovations import Innovations
from seatrial.estimation.joint import Joint
from seatrial.estimation.stage import StageSearch, run_stage
from seatrial.identification.hold_out import residual_noise
from seatrial.identification.identify import Conclusion, scored
from seatrial.scoring.record import Record

CONCLUSION = "seatrial.identification.identify."

T = np.arange(0.0, 40.0, 0.1)

CWOLF = Vehicle.load("cwolf")

STAGES = """
format = 1
name = "made"
vehicle = "cwolf"
[trials.run]
file = "run.csv"
hold_out_s = [[32.0, 41.0]]
[[stages]]
name = "surge"
trials = ["run"]
axes = { free = "X" }
segment_s = 8.0
budget = { population = 8, generations = 10, simplex_rounds = 10 }
coefficients = { X_uu = [-30.0, -4.0] }
"""


def run_of(vehicle: Vehicle = CWOLF, noise: float = 0.005) -> Trial:
    """Forty seconds straight ahead under stepped revolutions."""
    commands = {name: 700.0 + 400.0 * np.sign(np.sin(0.5 * T)) for name in vehicle.actuators}
    speed = np.asarray(vehicle.simulate(T, commands, free="X", max_step_s=0.02).nu)[:, 0]
    speed = speed + np.random.default_rng(3).normal(0.0, noise, len(T))
    return Trial.read({"t_s": T, "u_m_s": speed} | {f"cmd.{k}": v for k, v in commands.items()}, name="run")


@pytest.fixture(scope="module")
def trial() -> Trial:
    return run_of()


def campaign(trial: Trial, more: str = "[polish]\n", vehicle: Vehicle | None = None) -> Campaign:
    return Campaign.from_toml(STAGES + more, source="made.toml", trials={"run": trial}, vehicle=vehicle)


def failing(error: BaseException) -> Callable[..., Any]:
    def fails(*_: Any, **__: Any) -> Any:
        raise error

    return fails


SINGULAR = np.linalg.LinAlgError("Singular matrix")


def whole(fit: Identification) -> None:
    """The stages' estimate is the result, in the vehicle and in the files."""
    assert fit.vehicle.coefficients()["X_uu"] == pytest.approx(CWOLF.coefficients()["X_uu"], rel=0.1)
    assert "vehicle.toml" in fit.files()


@pytest.mark.parametrize(
    ("step", "name"),
    [
        ("joint_estimate_of", "joint estimate"),
        ("polish", "joint estimate"),
        ("with_or_without_presumed", "comparison without coefficients that have a prior (sd)"),
        ("quadratic_or_strips", "comparison with cross-flow drag by strips"),
        ("choose", "choice between stages and joint estimate"),
        ("assess", "standard deviations of the joint estimate"),
        ("conditional", "dependence on held coefficients"),
        ("with_model_error", "noise of a navigation filter"),
        ("part_scores", "scores"),
    ],
)
def test_a_step_that_fails_leaves_what_was_there(
    step: str, name: str, trial: Trial, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(CONCLUSION + step, failing(SINGULAR))
    fit = campaign(trial).identify(work=Work(threads=1))
    whole(fit)
    first = fit.fallbacks[0]
    assert (first.name, first.kind, first.cause) == (name, "numerical", "Singular matrix")
    said = fit.summary().splitlines()
    words = f"{name} failed: Singular matrix. Kept instead: {first.kept}"
    assert any(words.lower() in line.lower() for line in said[:3])
    assert fit.to_dict()["fallbacks"][0]["remedy"] == first.remedy


@pytest.mark.parametrize("error", [KeyError("u"), TypeError("no"), AssertionError()])
def test_a_programming_error_is_not_swallowed(
    error: Exception, trial: Trial, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(CONCLUSION + "assess", failing(error))
    with pytest.raises(type(error)):
        campaign(trial).identify(work=Work(threads=1))


def test_what_counts_as_a_failure_of_numbers() -> None:
    from scipy.linalg import cholesky

    def raised(work: Callable[[], object]) -> Exception:
        with pytest.raises(ValueError) as caught:  # noqa: PT011 (which one is the question)
            work()
        return caught.value

    assert is_numerical(NumericalError("diverged"))
    assert is_numerical(raised(lambda: cholesky(np.full((2, 2), math.nan))))
    assert is_numerical(raised(lambda: np.linalg.eigvals(np.full((2, 2), math.inf))))
    assert not is_numerical(raised(lambda: np.zeros(2) + np.zeros(3)))
    assert not is_numerical(raised(lambda: float("x")))
    border = Fallbacks()
    with border.step("scores"):
        raise CampaignError("no trial")
    assert border.findings == [Fallback("scores", "refused", "no trial")]
    with pytest.raises(SeatrialError, match="cannot be written"), border.step("scores"):
        raise SeatrialError("cannot be written")
    with pytest.raises(KeyboardInterrupt), border.step("scores"):
        raise KeyboardInterrupt


def test_a_stage_that_fails_costs_no_other_stage(trial: Trial, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails_first(search: StageSearch, *options: Any) -> Any:
        if search.plan.stage.name == "first":
            raise SimulationError("every candidate diverged")
        return run_stage(search, *options)

    monkeypatch.setattr("seatrial.estimation.stage.run_stage", fails_first)
    first = STAGES[STAGES.index("[[stages]]") :].replace("surge", "first").replace("X_uu", "X_udot")
    fit = campaign(trial, first.replace("[-30.0, -4.0]", "[-30.0, -1.0]")).identify(work=Work(threads=1))
    whole(fit)
    assert [one.name for one in fit.fallbacks] == ["stage 'first'"]
    assert [stage.name for stage in fit.stages] == ["surge"]


def diverging() -> Vehicle:
    """Surge damping with the wrong sign, so strong that a sample of 0.1 s multiplies a speed by e^30."""
    return CWOLF.with_coefficients({"X_u": 300.0 * CWOLF.mass_matrix()[0][0]})


def test_a_filter_that_leaves_the_log_is_recognised_before_its_noises_are_sought(
    trial: Trial, monkeypatch: pytest.MonkeyPatch
) -> None:
    joint = Joint(campaign(trial, '[polish]\nmethod = "innovations"\n', diverging()).problem(), threads=1)
    monkeypatch.setattr("seatrial.estimation.kalman.Filters.likeliest", failing(AssertionError()))
    with pytest.raises(NumericalError, match=r"the model diverges over one sample of 0\.1 s: it misses u by"):
        Innovations(joint).estimate(joint.start, 20, None)


def test_law_a_round_that_diverges_is_taken_back(trial: Trial, monkeypatch: pytest.MonkeyPatch) -> None:
    joint = Joint(campaign(trial, '[polish]\nmethod = "innovations"\n').problem(), threads=1)
    innovations = Innovations(joint)
    one = innovations.estimate(joint.start, 1, None)
    joint.noise_model = None
    again, rounds = Innovations(joint), 0
    own = again.criterion.step

    def second_fails(*given: Any) -> Any:
        nonlocal rounds
        rounds += 1
        if rounds == 2:
            raise SINGULAR
        return own(*given)

    monkeypatch.setattr(again.criterion, "step", second_fails)
    found = again.estimate(joint.start, 5, None)
    assert found.stopped == "Singular matrix"
    assert not found.converged
    assert found.values == pytest.approx(one.values)
    assert np.isfinite(found.cost)


@pytest.mark.parametrize("rate", [70.0, 90.0, 2000.0])
def test_law_the_noise_of_a_filter_is_finite_whatever_the_poles(rate: float) -> None:
    """A hull whose yaw dies away at this rate (1/s) beside samples of 0.1 s."""
    mass = np.asarray(CWOLF.mass_matrix())
    quick = CWOLF.with_coefficients({"N_r": -rate * mass[5, 5], "M_q": -0.7 * rate * mass[4, 4]})
    turning = np.sin(0.5 * T)
    table = {"t_s": T, "r_deg_s": turning, "q_deg_s": turning, "u_m_s": 1.0 + 0.1 * turning}
    log = Trial.read(table | {f"cmd.{name}": np.zeros(len(T)) for name in CWOLF.actuators})
    record = Record(log, "commands", log.valid)
    noise = residual_noise(quick, [record])
    assert np.isfinite(noise["force"]).all()
    assert np.isfinite(noise["acceleration"]).all()
    # The log turns at up to 1 deg/s, and the model stops within a sample: what is missing is all of that.
    assert noise["force"][5] == pytest.approx(mass[5, 5] * math.radians(1.0) / math.sqrt(2.0) / 0.1, rel=0.05)


def test_a_vehicle_that_no_step_follows_has_no_noise_of_its_own(trial: Trial) -> None:
    runaway = CWOLF.with_coefficients({"X_u": 1e9})
    with pytest.raises(NumericalError, match=r"diverges over one sample at 3\d\d samples"):
        residual_noise(runaway, [Record(trial, "commands", trial.valid)])
    fallbacks = Fallbacks()
    vehicle, _ = scored(Conclusion(campaign(trial, "").problem(), runaway), fallbacks)
    assert "model_error" not in vehicle.to_dict()
    assert fallbacks.findings[0].name == "noise of a navigation filter"
