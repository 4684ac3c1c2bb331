"""Random starts: reproducible, one optimum where there is one, an honest word where there is not."""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from seatrial.base.errors import CampaignError
from seatrial.base.progress import Progress, Step
from seatrial.campaign.campaign import Campaign
from seatrial.cli import app
from seatrial.cli import identify as verb
from seatrial.estimation.stage import StageResult
from seatrial.identification.restarts import restarts, start_values
from seatrial.identification.restarts_result import StageRestarts
from seatrial.report.plot.restarts import random_starts
from tests.identification.test_identify import HEAD, HEAVE, STERN, SURGE, TRIALS, TRUTH, VERTICAL, record


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    recordings = {"run": record(STERN, 0, 0.01, 1), "dive": record(VERTICAL, 2, 0.005, 2)}
    return Campaign.from_toml(HEAD + TRIALS + SURGE + HEAVE, source="made.toml", trials=recordings)


def test_random_starts_find_the_same_optimum(campaign: Campaign) -> None:
    found = restarts(campaign.problem(), starts=4, threads=1)
    assert found.same_optimum
    assert [stage.verdict for stage in found.stages] == ["same optimum", "same optimum"]
    surge, heave = found.stages
    # As far from the truth as the noise of one search of these trials: see test_identify.
    assert surge.ends[:, 1] == pytest.approx(TRUTH["X_uu"], rel=0.03)
    assert heave.ends[:, 1] == pytest.approx(TRUTH["Z_ww"], rel=0.03)
    assert (surge.costs < 0.5 * surge.start_costs).all()
    # Starts lie all over the bounds, ends at one place.
    assert np.ptp(surge.starts[:, 1]) > 0.2 * (surge.upper - surge.lower)[1]
    assert (np.ptp(surge.ends, axis=0) < 0.01 * (surge.upper - surge.lower)).all()
    assert "all 4 random starts end in the same optimum" in found.sentences()[0]


def test_starts_lie_inside_the_bounds_and_are_reproducible(campaign: Campaign) -> None:
    drawn = [start_values(campaign.problem(), 7, number) for number in range(200)]
    assert start_values(campaign.problem(), 7, 3) == drawn[3]
    assert start_values(campaign.problem(), 8, 3) != drawn[3]
    for stage in campaign.problem().stages:
        for parameter in campaign.problem().parameters[stage.name]:
            values = np.array([one[stage.name][parameter.name] for one in drawn])
            places = (values - parameter.lower) / (parameter.upper - parameter.lower)
            assert places.min() >= 0.0
            assert places.max() <= 1.0
            # Mean and spread of 200 uniform numbers: 0.5 +- 0.02 and 0.289 +- 0.01, four deviations allowed.
            assert places.mean() == pytest.approx(0.5, abs=0.08)
            assert places.std() == pytest.approx(0.289, abs=0.04)


def test_every_start_begins_where_it_was_drawn_and_repeats(campaign: Campaign) -> None:
    one = restarts(campaign.problem(), starts=2, seed=5, threads=2)
    with ThreadPoolExecutor(2) as pool:  # as workers do it
        again = restarts(campaign.problem(), starts=2, seed=5, executor=pool)
    for stage, other in zip(one.stages, again.stages, strict=True):
        assert stage.costs.tolist() == other.costs.tolist()
        assert stage.ends.tolist() == other.ends.tolist()
        for number in range(2):
            drawn = start_values(campaign.problem(), 5, number)[stage.name]
            # A relative start goes through a factor and back.
            assert dict(zip(stage.parameters, stage.starts[number], strict=True)) == pytest.approx(drawn)
    assert one.stages[0].starts[0].tolist() != one.stages[0].starts[1].tolist()


def test_run_directory_holds_the_ends_and_is_resumed(campaign: Campaign, tmp_path: Path) -> None:
    seen: list[Progress] = []

    def interrupt(progress: Progress) -> None:
        seen.append(progress)
        if progress.what.startswith("start 2"):
            raise KeyboardInterrupt

    first = restarts(campaign.problem(), starts=3, run_dir=tmp_path / "run", progress=interrupt, threads=1)
    assert first.interrupted
    assert first.starts == 1
    assert not first.same_optimum  # one start agrees with nothing
    assert "nothing to compare it with" in str(first)
    assert not (tmp_path / "run").exists()
    assert all(0.0 <= p.fraction <= 1.0 and not p.left_s < 0.0 for p in seen)
    seen.clear()
    full = restarts(campaign.problem(), starts=3, run_dir=tmp_path / "run", progress=seen.append, threads=1)
    assert not any(p.what.startswith("start 1") for p in seen)
    assert full.stages[0].costs[0] == first.stages[0].costs[0]
    assert [entry.name for entry in tmp_path.iterdir()] == ["run"]
    table = pl.read_parquet(tmp_path / "run" / "random_starts.parquet")
    assert len(table) == 3 * 4
    assert set(table["start"]) == {1, 2, 3}
    data = json.loads((tmp_path / "run" / "random_starts.json").read_text())
    assert data["same_optimum"] is True
    assert [stage["name"] for stage in data["stages"]] == ["surge", "heave"]
    assert {"start", "stage", "best", "phase"} <= set(
        pl.read_parquet(tmp_path / "run" / "history.parquet").columns
    )


def test_one_start_is_refused_before_a_folder_appears(campaign: Campaign, tmp_path: Path) -> None:
    with pytest.raises(CampaignError, match="expected two or more, found 1"):
        restarts(campaign.problem(), starts=1, run_dir=tmp_path / "run")
    assert not list(tmp_path.iterdir())


Ends = Callable[..., StageRestarts]


@pytest.fixture
def ends(campaign: Campaign) -> Ends:
    """Made-up ends of the stage surge: X_udot in [-30, -1], X_uu in [-30, -4]."""

    def made(x: list[list[float]], costs: list[float], **sigma: float) -> StageRestarts:
        history = (Step("evolution", 60, 60, 480, 0.02, 1.0), Step("simplex", 20, 240, 640, 0.01, 2.0))
        results = []
        for values, cost in zip(x, costs, strict=True):
            plain: dict[str, Any] = dict.fromkeys(StageResult.__dataclass_fields__, 0)
            plain |= {"name": "surge", "trials": (), "history": history, "cost": cost, "start_cost": 0.1}
            plain |= {"starts": {"X_udot": -10.0, "X_uu": -10.0}}
            plain |= {"estimates": dict(zip(("X_udot", "X_uu"), values, strict=True))}
            results.append(StageResult(**plain))
        return StageRestarts.of(results, campaign.problem().parameters["surge"], sigma)

    return made


def test_an_end_elsewhere_is_named_with_its_cost(ends: Ends) -> None:
    found = ends([[-5.0, -14.0], [-5.0, -14.0], [-25.0, -8.0]], [0.01, 0.010001, 0.0113])
    assert found.verdict == "several optima"
    assert found.at_optimum.tolist() == [True, True, False]
    assert "2 of 3 random starts end at the lowest value" in found.sentence()
    assert "Start 3 ends 13 % above: its global search used all of its generations" in found.sentence()
    finished = replace(found, exhausted=np.zeros(3, dtype=bool))
    assert "Start 3 ends 13 % above: another optimum" in finished.sentence()


def test_a_flat_direction_is_named(ends: Ends) -> None:
    found = ends([[-5.0, -14.0], [-7.9, -15.3], [-10.8, -16.6]], [0.01, 0.010001, 0.010002])
    assert found.verdict == "flat direction"
    # 5.8 of 29 kg and 2.6 of 26 of the bounds, in one direction.
    assert found.direction == pytest.approx({"X_udot": 0.2, "X_uu": 0.1}, rel=1e-6) or found.direction == (
        pytest.approx({"X_udot": -0.2, "X_uu": -0.1}, rel=1e-6)
    )
    assert "X_udot by" in found.sentence()
    assert "X_uu by" in found.sentence()


def test_a_known_standard_deviation_widens_the_tolerance_up_to_a_limit(ends: Ends) -> None:
    x, costs = [[-5.0, -14.0], [-5.5, -14.0]], [0.01, 0.01]
    # 0.5 kg are 1.7 % of the bounds' width: beyond 1 %, below a quarter of 3 kg.
    assert ends(x, costs).verdict == "flat direction"
    assert ends(x, costs, X_udot=3.0).verdict == "same optimum"
    assert ends([[-5.0, -14.0], [-7.0, -14.0]], costs, X_udot=1e6).verdict == "flat direction"
    assert ends(x, costs, X_udot=np.inf).verdict == "flat direction"


def test_figure_marks_ends_elsewhere(campaign: Campaign, ends: Ends) -> None:
    found = restarts(campaign.problem(), starts=2, threads=1)
    good = random_starts(found)
    assert len(good.axes) == 4
    assert [t.get_text() for t in good.legends[0].get_texts()] == ["random start", "ends at the optimum"]
    bad = replace(found, stages=(ends([[-5.0, -14.0], [-25.0, -8.0]], [0.01, 0.02]),))
    assert "elsewhere" in [t.get_text() for t in random_starts(bad).legends[0].get_texts()]


@pytest.mark.long
def test_identify_with_random_starts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert CliRunner().invoke(app, ["new", "mine"]).exit_code == 0
    arguments = ["identify", "mine/campaign.toml", "--random-starts", "2", "--threads", "1"]
    shown = CliRunner().invoke(app, [*arguments, "--no-figures"])
    assert shown.exit_code == 0, shown.output
    assert "Ends of 2 random starts" in shown.stdout
    assert "all 2 random starts end in the same optimum" in shown.stdout
    # The nine figures of the campaign itself are held by the test of `identify` alone: drawn here, they would
    # take half of this test's time.
    monkeypatch.setattr(verb, "draw", lambda *_: [tmp_path / "campaign.png"])
    told = CliRunner().invoke(app, [*arguments, "--json"])
    data = json.loads(told.stdout)
    assert data["figures"] == [str(tmp_path / "campaign.png")]
    assert data["random_starts"]["starts"] == 2
    folder = tmp_path / "runs" / f"{Path(data['run_directory']).name}-random-starts"
    assert (folder / "figures" / "random_starts.png").stat().st_size > 10_000
    assert json.loads((folder / "random_starts.json").read_text()) == data["random_starts"]
    refused = CliRunner().invoke(app, [*arguments[:3], "1"])
    assert refused.exit_code == 2
    assert "--random-starts" in refused.stderr
