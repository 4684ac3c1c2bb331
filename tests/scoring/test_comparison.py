"""Comparison of vehicles on the same windows: differences, their intervals, what is said of them."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from seatrial._core import Vehicle
from seatrial.base.errors import TrialError
from seatrial.cli import app
from seatrial.report.plot.trials import variants
from seatrial.scoring.comparison import PAIR_SETTINGS, Comparison, compare, ratio, typical, window_sums
from seatrial.scoring.score import score
from seatrial.trial.trial import Trial

Array = NDArray[np.float64]
T = np.arange(0.0, 200.0, 0.1)


def sailed(*, noise: float = 0.002, seed: int = 1, name: str = "run") -> Trial:
    """CWolf on a surge staircase with a turn, seen with some noise."""
    generator = np.random.default_rng(seed)
    vehicle = Vehicle.load("cwolf")
    steps = np.repeat(generator.uniform(300.0, 1500.0, 20), 100)
    commands = {n: steps if n in ("SbU", "SbL", "PU", "PL") else np.zeros(len(T)) for n in vehicle.actuators}
    commands["PU"] = 0.9 * commands["PU"]
    run = vehicle.simulate(T, commands, max_step_s=0.02)
    nu = np.asarray(run.nu) + generator.normal(0.0, noise, (len(T), 6))
    columns = {"t_s": T, "u_m_s": nu[:, 0], "r_deg_s": np.rad2deg(nu[:, 5])}
    columns |= {
        f"{a}_deg": np.rad2deg(np.asarray(run.euler)[:, i]) for i, a in enumerate(("roll", "pitch", "yaw"))
    }
    return Trial.read(columns | {f"cmd.{n}": c for n, c in commands.items()}, name=name)


@pytest.fixture(scope="module")
def trial() -> Trial:
    return sailed()


@pytest.fixture(scope="module")
def found(trial: Trial) -> Comparison:
    own = Vehicle.load("cwolf")
    heavier = own.with_coefficients({"X_udot": -60.0})
    return compare({"own": own, "heavier": heavier}, trial, channels=["u", "r", "yaw"])


def test_difference_is_that_of_the_scores(found: Comparison, trial: Trial) -> None:
    heavier = score(
        Vehicle.load("cwolf").with_coefficients({"X_udot": -60.0}), trial, channels=["u", "r", "yaw"]
    )
    own = score(Vehicle.load("cwolf"), trial, channels=["u", "r", "yaw"])
    differences = found.of("heavier")
    assert set(differences) == {"u", "r", "yaw"}
    for channel, difference in differences.items():
        assert difference.r2 == (own[channel].r2, heavier[channel].r2)
        # Both are sums over the same samples: rounding alone differs.
        assert difference.r2_difference == pytest.approx(heavier[channel].r2 - own[channel].r2, abs=1e-9)
        sums = window_sums(heavier, channel)
        assert 1.0 - sums[:, 0].sum() / sums[:, 2].sum() == pytest.approx(heavier[channel].r2, abs=1e-9)
        assert sums[:, 1].sum() / sums[:, 3].sum() == pytest.approx(heavier[channel].mae, rel=1e-9)
        assert difference.windows == len(own.windows) == 20


def test_the_better_vehicle_is_named(found: Comparison) -> None:
    # 60 kg of added mass instead of 4 are plain in surge; the turn hardly knows of them.
    assert found.of("heavier")["u"].verdict == "worse"
    assert found.overall[0].verdict == "worse"
    assert found.overall[0].error_ratio > 1.0
    (sentence,) = found.sentences()
    assert "own predicts better" in sentence
    assert "heavier is worse in u" in sentence
    first, worst, _ = found.report().lines()
    assert first.startswith("own against heavier: own predicts better. The error of heavier in a typical")
    # That the other one is no better is no bad news.
    assert worst == "Worst: Nothing stands out: no other vehicle is better than own in any channel."


def test_comparison_is_antisymmetric(found: Comparison, trial: Trial) -> None:
    own = Vehicle.load("cwolf")
    turned = compare(
        {"heavier": own.with_coefficients({"X_udot": -60.0}), "own": own}, trial, channels=["u", "r", "yaw"]
    )
    assert turned.overall[0].verdict == "better"
    assert turned.report().lines()[0].startswith("heavier against own: own predicts better. ")
    # The logarithms change their sign, the interval turns round.
    assert turned.overall[0].error_ratio == pytest.approx(1.0 / found.overall[0].error_ratio)
    lower, upper = found.overall[0].error_interval or (math.nan, math.nan)
    assert turned.overall[0].error_interval == pytest.approx((1.0 / upper, 1.0 / lower))


def test_two_names_of_one_vehicle_are_not_told_apart(trial: Trial) -> None:
    own = Vehicle.load("cwolf")
    twins = compare({"one": own, "other": own}, trial)
    assert {d.verdict for d in twins.differences} == {"not told apart"}
    assert twins.overall[0].error_ratio == 1.0
    assert "predict the same" in twins.sentences()[0]
    assert twins.report().outcome == "not told apart"
    assert twins.report().worst == "these windows do not tell one and other apart"


def test_of_several_vehicles_the_better_ones_are_counted(trial: Trial) -> None:
    own = Vehicle.load("cwolf")
    heavier = own.with_coefficients({"X_udot": -60.0})
    told = compare({"own": own, "heavier": heavier, "twin": own}, trial, channels=["u", "r", "yaw"]).report()
    assert told.title == "own against heavier, twin"
    assert told.outcome == "of 2 others 0 predict better than own, 1 worse"


def test_a_free_run_is_one_window_and_tells_no_interval(trial: Trial) -> None:
    own = Vehicle.load("cwolf")
    free = compare({"one": own, "other": own.with_coefficients({"X_uu": -12.0})}, trial, free_run=True)
    assert free.of("other")["u"].r2_interval is None
    assert free.overall[0].verdict == "too few windows"
    assert f"an interval takes {PAIR_SETTINGS.fewest_windows} windows" in free.sentences()[0]
    assert free.to_dict()["differences"][0]["r2_interval"] is None


def test_windows_of_several_trials_are_pooled(trial: Trial) -> None:
    own = Vehicle.load("cwolf")
    both = compare(
        {"one": own, "other": own.with_coefficients({"X_uu": -12.0})}, [trial, sailed(seed=2, name="second")]
    )
    assert both.trials == ("run", "second")
    assert both.of("other")["u"].windows == 40


def test_one_vehicle_is_refused(trial: Trial) -> None:
    with pytest.raises(TrialError, match="two vehicles or more, found 1; use score"):
        compare({"own": Vehicle.load("cwolf")}, trial)
    with pytest.raises(TrialError, match="level"):
        compare({"a": Vehicle.load("cwolf"), "b": Vehicle.load("cwolf")}, trial, level=1.5)


def memory(generator: np.random.Generator, n: int, correlation: float) -> Array:
    """Unit normal series in which neighbours correlate."""
    out = np.empty(n)
    out[0] = generator.normal()
    for k in range(1, n):
        out[k] = correlation * out[k - 1] + math.sqrt(1.0 - correlation**2) * generator.normal()
    return out


@pytest.mark.parametrize(("correlation", "least"), [(0.0, 0.93), (0.5, 0.86)])
def test_intervals_of_differences_keep_their_promise(correlation: float, least: float) -> None:
    # 24 windows as in a validation run of four minutes, 600 draws: the share of intervals that hold the truth
    # scatters by 0.009. A correlation that must be estimated from 24 windows is estimated too low: 0.86.
    generator, n, draws = np.random.default_rng(4), 24, 600
    trial = np.repeat(["run"], n)
    held = np.zeros(2)
    for _ in range(draws):
        logs = 0.1 + 0.5 * memory(generator, n, correlation)
        _, interval = typical(logs, trial, alpha=0.05)
        held[0] += interval is not None and interval[0] <= math.exp(0.1) <= interval[1]
        x = generator.uniform(0.5, 1.5, n)
        y = x * (0.2 + 0.3 * memory(generator, n, correlation))
        _, span = ratio(y, x, trial, alpha=0.05)
        held[1] += span is not None and span[0] <= 0.2 <= span[1]
    assert (held / draws > least).all(), held / draws


def test_neighbours_that_resemble_widen_the_interval() -> None:
    logs = np.repeat([0.3, -0.3], 12) + 0.01 * np.sin(np.arange(24.0))
    together, apart = np.repeat(["run"], 24), np.array([f"trial {k}" for k in range(24)])
    alike, lone = (typical(logs, names, alpha=0.05)[1] for names in (together, apart))
    assert alike is not None
    assert lone is not None
    assert math.log(alike[1] / alike[0]) > 2.0 * math.log(lone[1] / lone[0])


def test_figure_shows_every_vehicle_in_every_panel(found: Comparison, trial: Trial) -> None:
    figure = variants(trial, found.scores, channels=["u", "r"])
    upper, lower = figure.axes[0], figure.axes[1]
    assert len(figure.axes) == 4
    assert len(upper.get_lines()) == 3  # the recording and two vehicles
    assert len(lower.get_lines()) == 3  # two errors and zero
    error = np.asarray(lower.get_lines()[1].get_ydata())
    assert np.nanmean(np.abs(error)) == pytest.approx(found.scores["heavier"]["u"].mae, rel=0.05)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory, trial: Trial) -> Path:
    folder = tmp_path_factory.mktemp("files")
    trial.save(folder / "run.csv")
    for name, drag in (("first", -9.8), ("second", -14.0)):
        (folder / name).mkdir()
        vehicle = Vehicle.load("cwolf").with_coefficients({"X_uu": drag})
        (folder / name / "vehicle.toml").write_text(vehicle.to_toml())
    return folder


def test_score_against_another_vehicle(files: Path, tmp_path: Path) -> None:
    arguments = ["score", str(files / "first" / "vehicle.toml"), str(files / "run.csv")]
    arguments += ["--against", str(files / "second" / "vehicle.toml"), "--against", "cwolf", "--ahead", "8"]
    shown = CliRunner().invoke(app, arguments)
    assert shown.exit_code == 0, shown.output
    assert "On run (8 s ahead, 25 windows), the error of second in a typical window" in shown.stdout
    told = CliRunner().invoke(app, [*arguments, "--json", "--out", str(tmp_path / "figures")])
    data = json.loads(told.stdout)
    assert list(data["vehicles"]) == ["first", "second", "cwolf"]
    assert {row["vehicle"] for row in data["overall"]} == {"second", "cwolf"}
    assert {path.name for path in (tmp_path / "figures").iterdir()} == {"variants_run.png"}


def test_score_against_itself_is_refused(files: Path) -> None:
    vehicle = str(files / "first" / "vehicle.toml")
    result = CliRunner().invoke(app, ["score", vehicle, str(files / "run.csv"), "--against", vehicle])
    assert result.exit_code == 2
    assert "the vehicle is given twice" in result.stderr
