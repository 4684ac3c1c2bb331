"""Figures: files in print quality, labels that do not overlap, nothing global changed, refusals in words."""

from __future__ import annotations

import subprocess
import sys
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patches import Polygon, Rectangle
from matplotlib.text import Annotation
from numpy.typing import ArrayLike

from seatrial._core import Vehicle
from seatrial.base.errors import SeatrialError
from seatrial.base.work import Step
from seatrial.estimation.stage import StageResult
from seatrial.report.plot.identification import convergence
from seatrial.report.plot.performance import characteristic, thrust
from seatrial.report.plot.style import DPI, WIDTH_IN, save, tidy
from seatrial.report.plot.trials import measured_against_simulated
from seatrial.report.plot.vehicle import side_by_side, three_views
from seatrial.scoring.score import Score, score
from seatrial.trial.trial import Trial

CWOLF = Vehicle.load("cwolf")


@pytest.fixture(scope="module")
def trial() -> Trial:
    """CWolf turns for a minute; its heading passes 180 degrees."""
    t = np.arange(0.0, 60.0, 0.1)
    speeds = dict.fromkeys(CWOLF.actuators, 0.0) | {"SbU": 900.0, "SbL": 900.0, "PU": 1500.0, "PL": 1500.0}
    commands = {name: np.where(t < 1.0, 0.0, speed) for name, speed in speeds.items()}
    given: dict[str, ArrayLike] = dict(commands)
    run = CWOLF.simulate(t, given)
    columns = {"t_s": t}
    columns |= dict(zip(("u_m_s", "v_m_s", "w_m_s"), np.asarray(run.nu)[:, :3].T, strict=True))
    columns |= dict(zip(("roll_deg", "pitch_deg", "yaw_deg"), np.rad2deg(run.euler).T, strict=True))
    columns |= {f"cmd.{name}": values for name, values in commands.items()}
    return Trial.read(columns, name="turn")


@pytest.fixture(scope="module")
def scored(trial: Trial) -> Score:
    return score(CWOLF, trial, ahead_s=10.0, free="XYN", measured="ZKM")


def labels(axes: Axes) -> list[Annotation]:
    return [text for text in axes.texts if isinstance(text, Annotation) and text.get_text()]


@pytest.mark.parametrize("name", Vehicle.names())
def test_labels_of_the_three_views_do_not_overlap_and_stay_inside(name: str) -> None:
    figure = three_views(Vehicle.load(name))
    figure.canvas.draw()
    assert len(figure.axes) == 3
    for axes in figure.axes:
        # The text alone, without the line that ties it to its place.
        extents = [super(Annotation, text).get_window_extent() for text in labels(axes)]
        assert len(extents) >= 2
        frame = axes.get_window_extent()
        for extent in extents:
            assert frame.x0 <= extent.x0
            assert extent.x1 <= frame.x1
        for one, other in combinations(extents, 2):
            assert not one.overlaps(other)


def test_every_actuator_is_labelled_in_every_view() -> None:
    views = three_views(CWOLF).axes
    assert len(views) == 3
    for axes in views:
        named = {name for text in labels(axes) for name in text.get_text().split(", ")}
        assert named == set(CWOLF.actuators)


def test_the_hull_is_as_long_and_broad_as_the_vehicle() -> None:
    side, top, _ = three_views(CWOLF).axes
    for axes in (side, top):
        hull = next(patch for patch in axes.patches if isinstance(patch, Polygon))
        np.testing.assert_allclose(np.ptp(hull.get_xy(), axis=0), [2.5, 0.3], rtol=1e-9)


def test_a_vehicle_without_hull_and_one_without_places_are_drawn() -> None:
    text = 'format = 1\nname = "bare"\n[coefficients]\nm = 10.0\nI_x = 1.0\nI_y = 1.0\nI_z = 1.0\n'
    assert len(three_views(Vehicle.from_toml(text)).axes) == 3
    text += '[characteristics.direct]\nkind = "direct"\n[[thrusters]]\nname = "one"\ncommand = "N"\n'
    text += 'wrench_per_newton = [1.0, 0.0, 0.0, 0.0, 0.0, 0.2]\ncharacteristic = "direct"\n'
    figure = three_views(Vehicle.from_toml(text))
    assert any("without place: one" in text.get_text() for text in figure.texts)


@given(st.lists(st.tuples(st.floats(-5, 5), st.floats(0.01, 2)), min_size=1, max_size=12))
def test_law_intervals_side_by_side_never_overlap(entries: list[tuple[float, float]]) -> None:
    wanted = sorted(x for x, _ in entries)
    widths = [width for _, width in entries]
    centres = np.array(side_by_side(wanted, widths, 100.0))
    gaps = np.diff(centres) - 0.5 * (np.array(widths[:-1]) + np.array(widths[1:]))
    # The centres are rounded to nine digits.
    assert (gaps >= -1e-8).all()
    if len(wanted) == 1:
        assert centres[0] == pytest.approx(wanted[0])


@pytest.mark.long
def test_files_are_sharp_enough_for_print_and_the_same_every_time(tmp_path: Path) -> None:
    first, second = (
        save(three_views(CWOLF), tmp_path / folder / "views", formats=("png", "pdf"))
        for folder in ("one", "two")
    )
    png, pdf = first
    assert imread(png).shape[1] == round(DPI * WIDTH_IN) >= 150 * WIDTH_IN
    assert pdf.read_bytes().startswith(b"%PDF")
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]


def test_all_formats_are_laid_out_alike_and_the_figure_stays_as_it_was(
    tmp_path: Path, trial: Trial, scored: Score, monkeypatch: pytest.MonkeyPatch
) -> None:
    figure = measured_against_simulated(trial, scored.windows, channels=["u"])
    engine, execute, runs = figure.get_layout_engine(), ConstrainedLayoutEngine.execute, 0

    def counted(self: ConstrainedLayoutEngine, of: Figure) -> Any:
        nonlocal runs
        runs += 1
        return execute(self, of)

    monkeypatch.setattr(ConstrainedLayoutEngine, "execute", counted)
    written = save(figure, tmp_path / "trial", formats=("png", "pdf", "svg"))
    assert [path.suffix for path in written] == [".png", ".pdf", ".svg"]
    assert runs == 1
    assert isinstance(engine, ConstrainedLayoutEngine)
    assert figure.get_layout_engine() is engine


def test_drawing_leaves_global_settings_alone(trial: Trial, scored: Score) -> None:
    before = dict(rcParams)
    measured_against_simulated(trial, scored.windows, channels=["u"])
    three_views(CWOLF)
    assert dict(rcParams) == before


def test_measured_and_simulated_share_an_axis_with_unit_and_residual(trial: Trial, scored: Score) -> None:
    held_out = trial.t >= 45.0
    titles = {"u": "held out R2 0.99"}
    figure = measured_against_simulated(
        trial, scored.windows, channels=["u", "yaw"], titles=titles, held_out=held_out, heading="turn"
    )
    surge, error, yaw, _ = figure.axes
    assert surge.get_ylabel() == "m/s"
    assert yaw.get_ylabel() == "deg"
    assert surge.get_title(loc="right") == "held out R2 0.99"
    # One measured line and one per window; the residual strip has the windows and a zero line.
    assert len(surge.get_lines()) == 1 + len(scored.windows)
    assert len(error.get_lines()) == 1 + len(scored.windows)
    shade = next(patch for patch in surge.patches if isinstance(patch, Rectangle))
    assert shade.get_x() == pytest.approx(45.0)
    # The model made the trial: residuals show the interpolation of the start only.
    residual = np.concatenate([np.asarray(line.get_ydata()) for line in error.get_lines()])
    assert np.nanmax(np.abs(residual)) < 0.01


def test_a_heading_that_passes_half_a_turn_is_drawn_without_a_jump(trial: Trial, scored: Score) -> None:
    assert np.ptp(trial.channel("yaw")) > 1.5 * np.pi
    figure = measured_against_simulated(trial, scored.windows, channels=["yaw"])
    for line in figure.axes[0].get_lines():
        assert np.nanmax(np.abs(np.diff(np.asarray(line.get_ydata())))) < 5.0


def stage(name: str, costs: list[float]) -> StageResult:
    half = len(costs) // 2
    history = tuple(
        Step("evolution" if k < half else "simplex", k + 1, len(costs), 8 * (k + 1), cost, 0.1 * k)
        for k, cost in enumerate(costs)
    )
    return StageResult(
        name=name, trials=("turn",), starts={}, estimates={}, coefficients={}, start_cost=1.0, cost=costs[-1],
        evaluations=8 * len(costs), history=history, segments=1, samples=10, substeps=1, step_s=0.1, rate=1.0,
        wall_s=1.0, inputs="", interrupted=False,
    )  # fmt: skip


def test_convergence_has_a_panel_per_stage_and_readable_ticks() -> None:
    stages = [stage("surge", [0.5, 0.2, 0.11, 0.1]), stage("yaw", [0.9, 0.8, 0.7, 0.68])]
    stages.append(stage("diverged at first", [float("inf"), 0.5, 0.4, 0.3]))
    figure = convergence(stages)
    figure.canvas.draw()
    drawn = [axes for axes in figure.axes if axes.axison]
    assert [axes.get_title(loc="left") for axes in drawn] == [stage.name for stage in stages]
    for axes in drawn:
        lower, upper = axes.get_ylim()
        assert sum(lower <= tick <= upper for tick in axes.get_yticks()) >= 3


def test_characteristic_shows_force_at_rest_and_under_way() -> None:
    figure = characteristic(CWOLF, speeds_m_s=(1.0,))
    stern, vertical = figure.axes
    [legend] = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["at rest", "at 1 m/s ahead"]
    # Beside the curves two axes through zero.
    assert [len(axes.get_lines()) - 2 for axes in (stern, vertical)] == [2, 1]
    # p1 n|n| at 2000 rpm = 82.66 N (golden table of the vehicle file); the lag leaves nothing.
    assert thrust(CWOLF, "SbU", [2000.0])[0] == pytest.approx(82.66, abs=0.01)


@pytest.mark.filterwarnings("error")
def test_three_kinds_of_actuators_have_room(tmp_path: Path) -> None:
    remus = Vehicle.load("remus100")
    weaker = {
        name: 0.5 for name in remus.coefficients() if name.startswith("rudder") and name.endswith("gain")
    }
    figure = characteristic(remus.with_coefficients(weaker))
    save(figure, tmp_path / "three")  # a layout without room warns
    assert len(figure.axes) == 3
    assert min(axes.get_position().width for axes in figure.axes) > 0.2


def test_equal_characteristics_share_a_panel() -> None:
    figure = characteristic(Vehicle.load("beluga"))
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["horizontal, vertical"]


@pytest.mark.parametrize(
    ("number", "words"),
    [(0.987, "0.99"), (-0.171, "−0.17"), (-0.003, "0.00"), (float("nan"), "none"), (-80.0, "below −9.9")],
)
def test_scores_in_titles_are_short(number: float, words: str) -> None:
    assert tidy(number) == words


def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SeatrialError, match="cannot be written"):
        save(three_views(CWOLF), tmp_path / "file" / "views")


def test_figures_need_no_display_and_load_no_window_system() -> None:
    code = (
        "import sys; from seatrial._core import Vehicle; from seatrial.report.plot.vehicle import"
        " three_views\n"
        "three_views(Vehicle.load('cwolf')).canvas.draw()\n"
        "assert 'matplotlib.pyplot' not in sys.modules and 'tkinter' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env={}, check=False)
    assert done.returncode == 0, done.stderr
