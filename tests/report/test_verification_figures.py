"""Figures of a verification: they show the counts, intervals and limits they are given, and print well."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from seatrial.report.plot.verification import (
    Verified,
    cause_bars,
    cross_track,
    exceedance,
    quantile_of_counts,
    verified_requirements,
)
from seatrial.statistics.failure_probability import FailureProbability
from seatrial.verification.causes import Cause, Influence, find_causes
from tests.report.figures import assert_on_page, panel, texts

Array = NDArray[np.float64]
EDGES = np.geomspace(0.01, 5.0, 60)
ROWS = (
    Verified("keeps its path", FailureProbability(3, 2000), 0.01),
    Verified("no contact with the farm, the bottom or the surface", FailureProbability(0, 2000), 0.001),
    Verified("depth", FailureProbability(60, 2000), 0.01),
    Verified("always late", FailureProbability(2000, 2000), 0.05),
)


@cache
def causes(margin: float) -> tuple[Influence, ...]:
    rng = np.random.default_rng(1)
    speed, direction = rng.uniform(0.0, 0.5, 500), rng.uniform(0.0, 2.0 * np.pi, 500)
    fault = rng.choice(["none", "PtL dead", "SbU dead"], 500, p=[0.9, 0.05, 0.05])
    reserve = margin - speed * (1.0 + 0.5 * np.cos(direction)) - 0.4 * (fault == "SbU dead")
    drawn = [Cause("current speed", speed, "m/s"), Cause("current direction", direction, kind="direction")]
    drawn += [Cause("fault", fault, kind="category"), Cause("X_uu", rng.normal(-40.0, 4.0, 500), "kg/m")]
    return find_causes(reserve > 0.0, reserve, causes=drawn)


@cache
def errors() -> tuple[Array, Array]:
    """Counts (k, E + 1) and p95 (k,) of missions with normal errors of several sizes; one diverged."""
    rng = np.random.default_rng(2)
    samples = np.abs(rng.normal(size=(300, 200))) * 0.15 * np.exp(0.3 * rng.normal(size=(300, 1)))
    counts = np.stack([np.bincount(np.searchsorted(EDGES, row), minlength=61) for row in samples])
    p95 = np.quantile(samples, 0.95, axis=1)
    p95[7] = np.nan
    return counts.astype(float), p95


def test_requirements_can_be_printed_and_show_verdict_interval_and_limit() -> None:
    figure = verified_requirements(ROWS, heading="farm")
    assert_on_page(figure)
    axes = panel(figure, "farm")
    assert axes.get_xscale() == "log"
    drawn = [np.asarray(one.get_xdata(), dtype=float) for one in axes.get_lines()]
    lower, upper = ROWS[0].probability.interval
    assert any(len(x) == 2 and np.allclose(x, [lower, upper]) for x in drawn)
    assert any(len(x) == 1 and x[0] == ROWS[0].probability.estimate for x in drawn)
    for row in ROWS:
        assert any(np.all(x == row.allowed) for x in drawn)
    labels = {"held: 3 of 2000 fail", "undecided: 0 of 2000 fail", "failed: 60 of 2000 fail"}
    assert labels <= set(texts(figure))
    assert_on_page(verified_requirements(ROWS[:1]))


@pytest.mark.parametrize("margin", [0.45, 3.0])
def test_causes_can_be_printed(margin: float) -> None:
    figure = cause_bars(causes(margin), heading="keeps its path")
    assert_on_page(figure)
    goes = "failures go" if margin < 1.0 else "reserve goes"
    assert f"keeps its path: what its {goes} with" in texts(figure)
    axes = figure.axes[0]
    bars = [one.get_width() for one in axes.patches if isinstance(one, Rectangle)]
    assert bars == pytest.approx([one.strength for one in causes(margin)])
    # Without failures there is no rate to show.
    assert len(figure.axes) == (1 if margin > 1.0 else 4)
    # Rates stand side by side: the eye compares their heights.
    assert len({one.get_ylim() for one in figure.axes[1:]}) <= 1
    long = cause_bars(causes(margin), heading="follows its guidance and does not waste energy " * 3)
    assert_on_page(long)
    (title,) = [
        one for one in long.texts if one.get_text().startswith("follows its guidance and does not waste")
    ]
    assert title.get_window_extent().x1 < long.bbox.x1


def test_rates_along_a_cause_are_those_of_its_groups() -> None:
    figure = cause_bars(causes(0.45))
    speed = next(one for one in causes(0.45) if one.name == "current speed")
    bars = [one.get_height() for one in panel(figure, "current speed").patches if isinstance(one, Rectangle)]
    assert bars == pytest.approx([100.0 * rate for rate in speed.groups.rates])


@pytest.mark.parametrize("threshold_m", [None, 0.5, 3.0])
def test_the_cross_track_error_can_be_printed(threshold_m: float | None) -> None:
    counts, p95 = errors()
    figure = cross_track(counts, EDGES, p95_m=p95, threshold_m=threshold_m, heading="farm")
    assert_on_page(figure)
    both = cross_track(counts, EDGES, p95_m=p95, perceived=0.5 * counts, threshold_m=threshold_m)
    assert_on_page(both)
    assert {"true", "as guidance perceived it"} <= set(texts(both))
    legend = both.axes[0].get_legend()
    assert legend is not None
    both.draw_without_rendering()
    label = both.axes[0].xaxis.label.get_window_extent()
    assert legend.get_window_extent().y1 <= label.y0  # below the panel: it hides no curve
    histogram = panel(figure, "p95 of each mission")
    bars = [one for one in histogram.patches if isinstance(one, Rectangle)]
    # Every mission that has a p95 once.
    assert sum(bar.get_height() for bar in bars) == len(p95) - 1
    if threshold_m is not None:
        over = int((p95 > threshold_m).sum()) + 1
        assert f"above {threshold_m:g} m: {over} of 300" in histogram.get_xlabel()
        beyond = sum(bar.get_height() for bar in bars if bar.get_x() > threshold_m - 1e-9)
        # A diverged mission is above, but has no bar.
        assert beyond == over - 1


def test_marked_quantiles_are_those_of_the_samples() -> None:
    rng = np.random.default_rng(3)
    samples = np.abs(rng.normal(0.0, 0.2, 20_000))
    counts = np.bincount(np.searchsorted(EDGES, samples), minlength=61)
    for part in (0.5, 0.95, 0.99):
        # Bins are 11 % wide; 1 % is also three standard deviations of the quantiles of 20,000 samples.
        expected = float(np.quantile(samples, part))
        assert quantile_of_counts(counts, EDGES, share_below=part) == pytest.approx(expected, rel=0.012)
    assert exceedance(counts, EDGES)[-1] == 0.0


def test_quantiles_outside_the_edges_and_without_samples() -> None:
    assert quantile_of_counts([1.0, 1.0, 8.0], [0.1, 0.2], share_below=0.95) == np.inf
    assert np.isnan(quantile_of_counts([0.0, 0.0, 0.0], [0.1, 0.2], share_below=0.5))
    assert quantile_of_counts([8.0, 1.0, 1.0], [0.1, 0.2], share_below=0.4) == pytest.approx(
        0.1 * np.log(0.6) / np.log(0.2)
    )
    with pytest.raises(ValueError, match="one more than the 2 edges"):
        exceedance([1.0, 2.0], [0.1, 0.2])


def test_a_campaign_without_a_settled_leg_says_so() -> None:
    figure = cross_track(np.zeros(61), EDGES, p95_m=[np.nan, np.nan], threshold_m=1.0)
    assert_on_page(figure)
    assert texts(figure).count("no leg settled") == 2
