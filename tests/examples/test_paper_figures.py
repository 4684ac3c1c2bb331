"""The paper's figures: they say what the vehicle has and what the run found, and they can be printed."""

from __future__ import annotations

import fcntl
import json
import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.axes import Axes
from typer.testing import CliRunner, Result

from paper.__main__ import app as paper
from paper.autopilot import autopilot_plates
from paper.gallery import FORMATS, paper_figures
from paper.model import columns_of_stages, optimisation_diagram
from paper.plates import (
    bench_plates,
    campaign_plates,
    cited,
    is_generated,
    no_campaign,
    not_drawn,
    vehicle_plates,
)
from paper.stage import polished_cost, stage_result
from paper.tuning import tuning_plates, without_tuning
from seatrial._core import State
from seatrial.base.errors import SeatrialError
from seatrial.base.work import Work
from seatrial.campaign.campaign import Campaign
from seatrial.cli import app
from seatrial.identification.identification import Identification
from seatrial.problem.settings import Axes as Modes
from seatrial.problem.settings import Stage
from seatrial.report.plot.identification import convergence, phase_costs
from seatrial.report.plot.style import number, symbol
from tests.report.figures import CWOLF, VEHICLES, assert_printable, texts

pytestmark = pytest.mark.long

EXAMPLES = Path(__file__).parents[2] / "examples"

CAMPAIGN = """
format = 1
name = "made"
vehicle = "cwolf"
seed = 3
[budget]
generations = 6
simplex_rounds = 3
[trials.run]
file = "run.parquet"
hold_out_s = [[30.0, 40.0]]
[trials.dive]
file = "dive.parquet"
[trials.unseen]
file = "unseen.parquet"
hold_out = true
[[stages]]
name = "surge"
trials = ["run"]
axes = { free = "X" }
[stages.coefficients]
X_udot = [-30.0, -1.0]
X_uu = [-30.0, -4.0]
[[stages]]
name = "heave"
trials = ["dive"]
axes = { free = "Z" }
[stages.coefficients]
Z_ww = [-900.0, -100.0]
[[stages]]
name = "surge and heave once more"
trials = ["run", "dive"]
axes = { free = "XZ" }
after = ["surge", "heave"]
channels = { u = 1.0 }
[stages.coefficients]
X_u = [-20.0, 0.0]
[polish]
rounds = 2
"""
TRUTH = {"X_udot": -9.0, "X_uu": -14.0, "Z_ww": -450.0}


def record(seed: int) -> pl.DataFrame:
    """Forty seconds of the true vehicle at 10 Hz, surging and diving at once, with noise."""
    generator = np.random.default_rng(seed)
    vehicle = CWOLF.with_coefficients(TRUTH)
    t = np.arange(0.0, 40.0, 0.1)
    steps = {group: np.repeat(generator.uniform(-1500.0, 1500.0, 8), 50) for group in ("stern", "vertical")}
    facts = vehicle.actuator_info()
    commands = {name: steps[facts[name]["group"]] for name in vehicle.actuators}
    nu = np.asarray(vehicle.simulate(t, commands, State(), free="XZ").nu)
    noisy = nu + generator.normal(0.0, 0.01, nu.shape)
    shown = {"u_m_s": noisy[:, 0], "w_m_s": noisy[:, 2]}
    return pl.DataFrame({"t_s": t, **shown, **{f"cmd.{name}": values for name, values in commands.items()}})


def call(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def paper_verb(*arguments: str | Path) -> Result:
    return CliRunner().invoke(paper, [str(argument) for argument in arguments])


def refused(result: Result, *words: str) -> None:
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.output
    for word in words:
        assert word in result.stderr


@pytest.fixture(scope="module")
def fit() -> Identification:
    frames = {"run": record(1), "dive": record(2), "unseen": record(3)}
    return Campaign.from_toml(CAMPAIGN, source="made.toml", trials=frames).identify(work=Work(threads=1))


@given(st.lists(st.integers(0, 2**8 - 1), min_size=1, max_size=8))
def test_law_stages_stand_behind_those_they_wait_for_and_never_on_one_another(masks: list[int]) -> None:
    stages = [
        Stage(
            name=f"s{k}",
            trials=("run",),
            axes=Modes(free="X"),
            coefficients={"X_u": [-1.0, 0.0]},
            after=tuple(f"s{j}" for j in range(k) if mask >> j & 1),
        )
        for k, mask in enumerate(masks)
    ]
    places = columns_of_stages(stages)
    assert len(set(places.values())) == len(stages)
    for stage in stages:
        assert all(places[name][0] < places[stage.name][0] for name in stage.after)
        if not stage.after:
            assert places[stage.name][0] == 0


def test_optimisation_diagram_shows_stages_order_and_criterion(fit: Identification) -> None:
    figure = optimisation_diagram(fit.problem, results=fit.stages)
    assert_printable(figure)
    words = texts(figure)
    for said in (
        "vehicle cwolf",
        "evolution strategy",
        "simplex",
        "free X: run",
        "free Z: dive",
        "joint estimate",
    ):
        assert said in words
    first = fit.stages[0]
    assert f"$Q$ {number(first.start_cost)} \N{RIGHTWARDS ARROW} {number(first.cost)}" in words
    places = columns_of_stages(fit.problem.stages)
    assert places["surge"][0] == places["heave"][0] == 0
    assert places["surge and heave once more"][0] == 1


def test_optimisation_diagram_of_the_example_needs_no_run() -> None:
    campaign = Campaign.load(EXAMPLES / "cwolf" / "campaign.toml")
    figure = optimisation_diagram(campaign.problem())
    assert_printable(figure)
    assert sum(text == "10 coefficients" for text in texts(figure)) == 1


def test_stage_result_shows_errors_fall_and_the_coefficients_found(fit: Identification) -> None:
    result = fit.stages[0]
    figure = stage_result(fit, result)
    words = texts(figure)
    assert result.cost < 0.8 * result.start_cost
    polished = polished_cost(fit, result)
    assert polished is not None
    heading = (
        f"surge: criterion {number(result.start_cost)} \N{RIGHTWARDS ARROW} {number(result.cost)} std dev."
    )
    assert f"{heading}, joint estimate {number(polished)}" in words
    certain = fit.assessment
    assert certain is not None
    known = certain.of("X_uu")
    assert known is not None
    values = (result.starts["X_uu"], result.estimates["X_uu"], known["estimate"])
    assert " \N{RIGHTWARDS ARROW} ".join(number(x) for x in values) + " N s²/m²" in words
    assert {symbol("X_uu"), symbol("X_udot"), number(-30.0), number(-4.0), "held out", "stern"} <= set(words)
    below = next(
        axes for axes in figure.findobj(Axes) if isinstance(axes, Axes) and axes.get_ylabel() == "error"
    )
    start, optimum = (np.asarray(line.get_ydata(), dtype=float) for line in below.get_lines()[:2])
    # Both are errors against the same samples; the optimum's are those of the criterion that fell.
    assert np.nanmean(np.abs(optimum)) < 0.8 * np.nanmean(np.abs(start))


def test_a_stage_of_two_trials_shows_them_one_after_the_other(fit: Identification) -> None:
    figure = stage_result(fit, fit.stages[2])
    words = texts(figure)
    assert "time of the trials one after the other, s" in words
    upper = next(
        axes for axes in figure.findobj(Axes) if isinstance(axes, Axes) and axes.get_ylabel() == "m/s"
    )
    assert upper.get_xlim() == pytest.approx((0.0, 2 * 39.9))


def test_convergence_falls_to_the_optimum_over_evaluations(fit: Identification) -> None:
    figure = convergence(fit.stages)
    assert 1 <= len(fit.stages) <= len(figure.axes)
    for axes, stage in zip(figure.axes, fit.stages, strict=False):
        assert axes.get_title(loc="left") == stage.name
        assert axes.get_xlabel() == "evaluations"
        assert axes.get_yscale() == "log"
        phases = phase_costs(stage)
        assert phases[0][0] == "evolution"
        assert phases[-1][0] == "simplex"
        assert phases[-1][1][-1] == stage.evaluations
        assert phases[-1][2][-1] == stage.cost
        # What is drawn is what each phase found, as its history has it: within a phase it falls, and none is
        # lowered to what another one found.
        for phase, tried, best in phases:
            steps = [step for step in stage.history if step.phase == phase and np.isfinite(step.best)]
            assert sorted(best, reverse=True) == best.tolist()
            assert set(best) <= {step.best for step in steps}
            line = next(one for one in axes.get_lines() if np.array_equal(one.get_xdata(), tried))
            assert np.array_equal(line.get_ydata(), best)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Folder in which the verb drew the campaign after `identify` had run, and what it printed as JSON."""
    # Once for all workers of the tests: whoever comes second waits for the first.
    base = tmp_path_factory.getbasetemp()
    base = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    with (base / "gallery.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        printed = base / "gallery" / "printed.json"
        if not printed.is_file():
            made = _drawn(base / "gallery")
            printed.write_text(made, encoding="utf-8")
        return base / "gallery" / "figures", json.loads(printed.read_text(encoding="utf-8"))


def _drawn(folder: Path) -> str:
    folder.mkdir()
    for name, seed in (("run", 1), ("dive", 2), ("unseen", 3)):
        record(seed).write_parquet(folder / f"{name}.parquet")
    campaign, earlier = folder / "campaign.toml", folder / "earlier"
    campaign.write_text(CAMPAIGN, encoding="utf-8")
    result = call("identify", campaign, "--out", earlier, "--figures", "none", "--threads", "1")
    assert result.exit_code == 0, result.output
    before = (earlier / "identification.json").read_bytes()
    options = ("--out", folder / "figures", "--run", earlier, "--formats", "pdf", "--threads", "1", "--json")
    result = paper_verb(campaign, *options)
    assert result.exit_code == 0, result.output
    assert (earlier / "identification.json").read_bytes() == before
    return result.stdout


def test_a_gallery_is_numbered_and_its_page_says_what_is_seen(drawn: tuple[Path, dict[str, Any]]) -> None:
    folder, made = drawn
    names = [figure["name"] for figure in made["figures"]]
    assert names[:4] == ["vehicle", "model", "actuators", "static_transfer"]
    stages = ["stage_surge", "stage_heave", "stage_surge_and_heave_once_more"]
    assert [name for name in names if name.startswith("stage_")] == stages
    expected = {"rate_limiting", "characteristic", "optimisation", "convergence", "intervals"}
    assert expected | {"held_out_unseen"} <= set(names)
    assert [figure["number"] for figure in made["figures"]] == list(range(1, len(names) + 1))
    page = (folder / "index.html").read_text(encoding="utf-8")
    for figure in made["figures"]:
        assert f"fig_{figure['number']:02d}_{figure['name']}.pdf" in page
        assert f"<b>Fig. {figure['number']}.</b>" in page
    assert "All 3 trials are recordings." in page
    assert "Data: recorded run." in page
    assert any("no bollard test" in sentence for sentence in made["left_out"])
    # All twenty figures of the paper are drawn or named.
    left_out = "\n".join(made["left_out"])
    captions = " ".join(figure["caption"] for figure in made["figures"])
    assert "After figure 4 (static behaviour) of Taubert et al. (2014)." in captions
    assert "figure 7 (surge test) of the paper: it shows the test stand" in left_out
    assert "campaign.toml has no [tuning] (figures 19 and 20 (corridor, speed control))" in left_out
    assert "Not drawn" in page


def test_every_figure_of_the_paper_is_drawn_or_named() -> None:
    plates = [*vehicle_plates(CWOLF, data=""), *bench_plates(None), *autopilot_plates(CWOLF)]
    missing = " ".join(not_drawn(plates))
    for figure in (7, 11, 12, 15, 19, 20):
        assert cited((figure,)) in missing
    for figure in (1, 2, 3, 4, 5, 6, 8, 9, 10, 16, 17, 18):
        assert cited((figure,)) not in missing
    everything = [*plates, no_campaign(CWOLF), without_tuning(CWOLF)]
    assert not_drawn(everything) == [
        "figure 7 (surge test) of the paper: it shows the test stand, of which no file says anything"
    ]


def test_the_corridor_and_the_speed_over_set_points_of_a_campaign_with_tuning(fit: Identification) -> None:
    small = """
[tuning]
samples = 0
settle_s = 6.0
margins = { phase_deg = 0.0, gain_db = 0.0, delay_s = 0.0 }
budget = { population = 8, generations = 2, simplex_rounds = 1 }
[tuning.loops.surge]
steps = [0.3]
speeds_m_s = [1.5]
corridor = { rise_s = 2.0, overshoot = 0.02, settling_s = 9.0, settled = 0.02, until_s = 12.0 }
"""
    autopilot = f'autopilot = "{EXAMPLES / "cwolf" / "start_autopilot.toml"}"\n'
    campaign = Campaign.from_toml(autopilot + CAMPAIGN + small, source="small.toml", folder=".")
    plates = list(tuning_plates(fit, campaign))
    assert [plate.name for plate in plates] == ["corridor_surge", "speed_control"]
    assert [plate.paper for plate in plates] == [(19,), (20,)]
    corridor, speed = (plate.draw() for plate in plates if plate.draw is not None)
    assert [axes.get_title(loc="left") for axes in corridor.axes] == [
        "surge at 1.5 m/s, +0.3 m/s: start gains",
        "surge at 1.5 m/s, +0.3 m/s: tuned",
    ]
    assert "speed ahead u, m/s" in texts(speed)
    only_heading = small.replace("loops.surge", "loops.heading").replace("[0.3]", "[20.0]")
    other = Campaign.from_toml(autopilot + CAMPAIGN + only_heading, source="small.toml", folder=".")
    (left_out,) = tuning_plates(fit, other)
    assert left_out.draw is None
    assert left_out.caption == "no corridor of the speed: small.toml has no [tuning.loops.surge]"


def test_figures_carry_their_fonts_and_are_one_or_two_columns_wide(
    drawn: tuple[Path, dict[str, Any]],
) -> None:
    for figure in drawn[1]["figures"]:
        content = Path(figure["files"][0]).read_bytes()
        assert b"/FontFile2" in content, figure["name"]  # TrueType outlines are inside
        assert b"/Type3" not in content, figure["name"]
        box = re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ", content)
        assert box is not None
        width_mm = 25.4 * float(box[1]) / 72.0
        # 88 and 180 mm, to the pixel of the canvas.
        assert min(abs(width_mm - 88.0), abs(width_mm - 180.0)) < 0.3, figure["name"]


def test_stages_of_an_earlier_run_are_reused(drawn: tuple[Path, dict[str, Any]]) -> None:
    run = json.loads((drawn[0] / "run" / "identification.json").read_text(encoding="utf-8"))
    assert [stage["reused"] for stage in run["stages"]] == [True, True, True]


def test_generated_trials_are_told_from_recordings() -> None:
    campaign = Campaign.load(EXAMPLES / "cwolf" / "campaign.toml", trials={"own": "log.csv"})
    assert is_generated(campaign.problem(), "surge")
    assert not is_generated(campaign.problem(), "own")


def test_the_example_of_generated_trials_says_so_in_its_captions(fit: Identification) -> None:
    campaign = Campaign.load(EXAMPLES / "cwolf" / "campaign.toml")
    captions = " ".join(
        plate.caption for plate in campaign_plates(replace(fit, problem=campaign.problem(), stages=()))
    )
    assert "Data: generated (recipe) validation." in captions


def test_a_vehicle_alone_gives_its_own_figures_the_same_every_time(tmp_path: Path) -> None:
    one, two = (
        paper_figures(VEHICLES["bare"], tmp_path / name, formats=("png", "svg")) for name in ("a", "b")
    )
    assert [path.name for path in one[:3]] == ["fig_01_vehicle.png", "fig_01_vehicle.svg", "fig_02_model.png"]
    assert one[-1] == tmp_path / "a" / "index.html"
    assert "figures of the vehicle file alone" in one[-1].read_text(encoding="utf-8")
    assert [path.read_bytes() for path in one] == [path.read_bytes() for path in two]


def test_a_gallery_replaces_the_one_before_and_nothing_else(tmp_path: Path) -> None:
    paper_figures(VEHICLES["bare"], tmp_path, formats=("png", "svg"))
    (tmp_path / "fig_99_own.svg").write_text("mine")
    paper_figures(VEHICLES["bare"], tmp_path, formats=("svg",))
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        *("fig_01_vehicle.svg", "fig_02_model.svg", "fig_99_own.svg", "index.html")
    ]


def test_an_unknown_format_and_an_unwritable_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SeatrialError, match=r"expected some of png, pdf, svg, found 'gif'"):
        paper_figures(CWOLF, tmp_path / "new", formats=("png", "gif"))
    assert not (tmp_path / "new").exists()
    (tmp_path / "file").write_text("")
    with pytest.raises(SeatrialError, match="cannot be written"):
        paper_figures(CWOLF, tmp_path / "file", formats=FORMATS[:1])


@pytest.mark.skipif("SEATRIAL_DATA" not in os.environ, reason="needs the T200's recordings")
def test_a_bench_test_gives_a_plate_per_group() -> None:
    from seatrial.bench_test.evaluate import bench

    found = bench(EXAMPLES / "t200" / "bench.toml")
    plates = list(bench_plates(found))
    assert [plate.name for plate in plates if plate.draw] == [f"bollard_test_{unit}" for unit in found.pulls]
    assert any("has no [[steps]]" in plate.caption for plate in plates if plate.draw is None)
    drawn = next(plate for plate in plates if plate.draw)
    assert drawn.caption.endswith("Data: bench test t200.")
    assert drawn.draw is not None
    assert "thrust of one actuator, N" in texts(drawn.draw())


def test_the_verb_draws_a_vehicle_and_prints_the_list(tmp_path: Path) -> None:
    result = paper_verb("beluga", "--out", tmp_path, "--formats", "svg, svg")
    assert result.exit_code == 0, result.output
    assert "Fig.  2  Block diagram of the model of beluga" in result.stdout
    assert "not drawn: every motor of beluga follows its command at once" in result.stdout
    assert (tmp_path / "fig_01_vehicle.svg").is_file()
    assert (tmp_path / "index.html").is_file()


def test_the_verb_refuses_what_cannot_be_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    refused(paper_verb("cwolf", "--formats", "png,gif"), "expected some of png, pdf, svg", "'gif'")
    refused(paper_verb("cwolf", "--formats", ""), "found none")
    refused(paper_verb("cwolff"), "cwolff")
    refused(paper_verb("missing.toml"), "missing.toml")
    refused(paper_verb("cwolf", "--bench", "missing.toml"), "missing.toml")
    Path("broken.toml").write_text("format = 1\nstages = 3\n")
    refused(paper_verb("broken.toml"), "broken.toml")
    Path("file").write_text("")
    refused(paper_verb("cwolf", "--out", "file"), "cannot be written")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["broken.toml", "file"]
