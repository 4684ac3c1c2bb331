"""The searches of `seatrial.estimation.search` on functions whose minimum is known."""

from __future__ import annotations

import itertools
import threading
from typing import Any

import numpy as np
import pytest

from benchmarks.stage_search import searched
from seatrial.base.arrays import Array
from seatrial.base.work import Step
from seatrial.estimation.search import SEARCH_SETTINGS, Optimum, _simplex, evolve, join, refine


def rosenbrock(x: Array) -> Array:
    return np.asarray((100 * (x[:, 1:] - x[:, :-1] ** 2) ** 2 + (1 - x[:, :-1]) ** 2).sum(axis=1))


def rastrigin(x: Array) -> Array:
    return np.asarray(10 * x.shape[1] + (x**2 - 10 * np.cos(2 * np.pi * x)).sum(axis=1))


class Recorder:
    """An objective that remembers the batches it was asked for."""

    def __init__(self, inner: object = rosenbrock) -> None:
        self.inner = inner
        self.batches: list[Array] = []

    def __call__(self, x: Array) -> Array:
        self.batches.append(x.copy())
        return np.asarray(self.inner(x))  # type: ignore[operator]


def minimize(objective: Any, start: Any, *, rounds: int | None = None, **options: Any) -> Optimum:
    """The global search, then the fine one from its best candidates, as a stage does it."""
    box = {key: options[key] for key in ("lower", "upper", "tolerance") if key in options}
    coarse = evolve(objective, start, **options)
    if coarse.interrupted:
        return coarse
    return join(coarse, refine(objective, coarse.elite, rounds=rounds, axes=coarse.axes, **box))


def test_minimum_of_rosenbrock_in_five_dimensions() -> None:
    # 1e-2 in x: the valley is so flat that a cost of 1e-6 is reached there.
    best = minimize(
        rosenbrock, [-1.5] * 5, lower=[-2] * 5, upper=[2] * 5, seed=1, generations=600, tolerance=1e-6
    )
    assert best.x == pytest.approx(np.ones(5), abs=1e-2)
    assert best.cost < 1e-4 < best.start_cost
    assert not best.interrupted


def test_global_search_escapes_local_minima() -> None:
    # Local minima of this function lie one unit apart, the start in the wrong one.
    best = minimize(rastrigin, [3.1, -3.1], lower=[-5, -5], upper=[5, 5], seed=4, population=48)
    assert best.x == pytest.approx([0, 0], abs=1e-3)


def test_minimum_on_a_bound_is_found_and_no_candidate_leaves_the_bounds() -> None:
    objective = Recorder(lambda x: np.abs(x - np.array([2.0, -3.0])).sum(axis=1))
    best = minimize(objective, [0.5, 0.5], lower=[0, -1], upper=[1, 1])
    assert best.x == pytest.approx([1.0, -1.0], abs=1e-3)
    asked = np.concatenate(objective.batches)
    assert (asked >= [0, -1]).all()
    assert (asked <= [1, 1]).all()


def test_single_parameter() -> None:
    best = minimize(lambda x: np.abs(x[:, 0] - 0.7), [3.0], lower=[0], upper=[4])
    assert best.x == pytest.approx([0.7], abs=1e-3)


def test_start_on_a_bound() -> None:
    best = minimize(lambda x: ((x - 0.4) ** 2).sum(axis=1), [0.0, 1.0], lower=[0, 0], upper=[1, 1])
    assert best.x == pytest.approx([0.4, 0.4], abs=1e-2)


def test_population_is_asked_in_one_batch_of_full_lanes() -> None:
    objective = Recorder()
    best = evolve(objective, [0, 0, 0], lower=[-2] * 3, upper=[2] * 3, generations=5, population=20)
    assert [len(batch) for batch in objective.batches] == [1] + [24] * 5
    assert 24 % SEARCH_SETTINGS.lanes == 0
    assert [step.generation for step in best.history] == [1, 2, 3, 4, 5]
    assert best.evaluations == 1 + 24 * 5


def test_simplexes_share_batches_and_each_goes_its_own_way() -> None:
    starts = np.random.default_rng(3).uniform(-1.5, 1.5, (8, 2))
    together = Recorder()
    best = refine(together, starts, lower=[-2, -2], upper=[2, 2])
    assert len(together.batches[1]) == len(starts)
    assert best.x == pytest.approx([1, 1], abs=1e-2)
    # The first simplex alone asks for the same candidates as among the others.
    alone = Recorder()
    refine(alone, starts[:1], lower=[-2, -2], upper=[2, 2], rounds=15)
    assert [b[0].tolist() for b in alone.batches[1:16]] == [b[0].tolist() for b in together.batches[1:16]]


def test_same_seed_same_result_whatever_other_threads_draw() -> None:
    def search(seed: int) -> Array:
        return evolve(rosenbrock, [0.5] * 4, lower=[-2] * 4, upper=[2] * 4, seed=seed, generations=60).x

    first = search(7)
    stop = threading.Event()

    def disturb() -> None:
        while not stop.is_set():
            np.random.rand(100)  # noqa: NPY002 - the global generator is the point

    thread = threading.Thread(target=disturb)
    thread.start()
    try:
        again = search(7)
    finally:
        stop.set()
        thread.join()
    assert again.tolist() == first.tolist()
    assert search(8).tolist() != first.tolist()


def test_diverged_candidates_rank_last() -> None:
    def half_diverges(x: Array) -> Array:
        costs = ((x - 0.3) ** 2).sum(axis=1)
        return np.asarray(np.where(x[:, 0] > 0.5, np.inf, np.where(x[:, 1] > 0.8, np.nan, costs)))

    best = minimize(half_diverges, [0.4, 0.4], lower=[0, 0], upper=[1, 1])
    assert best.x == pytest.approx([0.3, 0.3], abs=5e-3)


def test_all_candidates_diverged_is_an_infinite_cost() -> None:
    best = minimize(lambda x: np.full(len(x), np.inf), [0.4], lower=[0], upper=[1], generations=3, rounds=5)
    assert best.cost == np.inf


@pytest.mark.parametrize("batches", [4, 60])
def test_interrupt_keeps_the_best_so_far(batches: int) -> None:
    count = 0
    lowest = np.inf

    def interrupted(x: Array) -> Array:
        nonlocal count, lowest
        count += 1
        if count > batches:
            raise KeyboardInterrupt
        costs = rosenbrock(x)
        lowest = min(lowest, float(costs.min()))
        return costs

    best = minimize(interrupted, [-1, -1], lower=[-2, -2], upper=[2, 2], generations=50)
    assert best.interrupted
    assert best.cost == lowest == pytest.approx(rosenbrock(best.x[None, :])[0])


def test_watch_can_stop_the_search_and_sees_progress() -> None:
    seen: list[Step] = []

    def watch(step: Step) -> None:
        seen.append(step)
        if len(seen) == 7:
            raise KeyboardInterrupt

    best = evolve(rosenbrock, [0, 0], lower=[-2, -2], upper=[2, 2], generations=20, watch=watch)
    assert best.interrupted
    assert [step.generation for step in seen] == [1, 2, 3, 4, 5, 6, 7]
    assert all(a.best >= b.best for a, b in itertools.pairwise(seen))
    assert seen[-1].left_s >= 0


def test_error_of_the_objective_reaches_the_caller() -> None:
    def broken(x: Array) -> Array:
        if len(x) == 1:
            return np.ones(1)
        raise ZeroDivisionError("in the objective")

    with pytest.raises(ZeroDivisionError, match="in the objective"):
        refine(broken, [[0.2], [0.6]], lower=[0], upper=[1])


def test_bounds_must_enclose_a_range() -> None:
    with pytest.raises(ValueError, match="upper"):
        evolve(rosenbrock, [0, 0], lower=[0, 1], upper=[1, 1])


@pytest.mark.long
def test_the_strategy_finds_the_valley_from_ten_far_starts_by_itself() -> None:
    """Damping and lift trade against each other: eight parameters, of which pairs nearly cancel."""

    def valley(x: Array) -> Array:
        away = x - 0.6
        total, difference = away[:, ::2] + away[:, 1::2], away[:, ::2] - away[:, 1::2]
        return np.asarray(0.1 + np.abs(total).mean(axis=1) + 0.1 * np.abs(difference).mean(axis=1))

    generator = np.random.default_rng(3)
    for seed in range(10):
        start = generator.uniform(0.0, 0.05, 8) + (0.95 if seed % 2 else 0.0)
        found = evolve(valley, start, lower=[0.0] * 8, upper=[1.0] * 8, seed=seed, tolerance=0.1)
        # The tolerance of the stages' global search: what is left of the valley is the descent's work.
        assert found.history[-1].best < 0.13, seed
        assert found.history[-1].best < 0.2 * found.start_cost


@pytest.mark.long
def test_a_lucky_candidate_does_not_end_the_strategy() -> None:
    """An early candidate that is much better than its population holds the best up for many generations."""

    def ridge(x: Array) -> Array:
        away = x - 0.6
        total, difference = away[:, ::2] + away[:, 1::2], away[:, ::2] - away[:, 1::2]
        return np.asarray(0.01 + np.sqrt((total**2).mean(axis=1) + 0.01 * (difference**2).mean(axis=1)))

    generator = np.random.default_rng(3)
    for seed in range(20):
        start = generator.uniform(0.0, 1.0, 4)
        found = evolve(ridge, start, lower=[0.0] * 4, upper=[1.0] * 4, seed=seed, tolerance=0.1)
        assert found.history[-1].best < 0.011, seed


def oblique(x: Array) -> Array:
    """A valley of eight parameters, a hundred times as long as wide, along no axis of theirs."""
    directions = np.linalg.qr(np.random.default_rng(1).standard_normal((8, 8)))[0]
    away = (x - 0.55) @ directions * np.geomspace(1.0, 0.01, 8)
    return np.asarray(0.01 + np.sqrt((away**2).mean(axis=1)))


def test_simplexes_along_a_valley_gain_at_once_where_others_stall() -> None:
    box: dict[str, Any] = {"lower": [0.0] * 8, "upper": [1.0] * 8}
    for seed in range(3):
        start = np.random.default_rng(seed).uniform(0.0, 1.0, 8)
        coarse = evolve(oblique, start, seed=seed, tolerance=0.1, **box)
        along = refine(oblique, coarse.elite, axes=coarse.axes, **box)
        assert along.history[10].best < coarse.cost
        axial = refine(oblique, coarse.elite, **box)
        assert along.cost - 0.01 < 0.5 * (axial.cost - 0.01)
        assert along.cost < 1.01 * 0.01


def test_axes_are_those_of_the_best_candidates() -> None:
    """Of a long straight valley the first axis lies along it; the objective's units are kept."""
    valley = lambda x: np.abs(x[:, 0] / 10.0 - x[:, 1]) + 0.05 * np.abs(x[:, 1] - 0.5)  # noqa: E731
    found = evolve(valley, [2.0, 0.9], lower=[0.0, 0.0], upper=[10.0, 1.0], seed=3, tolerance=0.1)
    longest = found.axes[:, int(np.abs(found.axes[1]).argmax())]
    assert longest[0] / longest[1] == pytest.approx(10.0, rel=0.1)


def test_a_simplex_stays_in_the_box_and_is_not_flat() -> None:
    corner = np.array([0.0, 1.0, 0.5])
    vertices = _simplex(corner, np.array([[-0.3, 0.2, 0.0], [0.2, 0.2, 0.2], [0.0, 0.0, 0.8]]))
    assert np.all((vertices >= 0.0) & (vertices <= 1.0))
    assert np.linalg.matrix_rank(vertices[1:] - vertices[0], tol=1e-3) == 3


def test_a_good_start_is_not_what_the_strategy_found() -> None:
    """At the optimum nothing is gained; the strategy searches all the same and comes as close."""
    bowl = lambda x: 1.0 + 50.0 * ((x - 0.5) ** 2).sum(axis=1)  # noqa: E731
    found = evolve(bowl, [0.5] * 8, lower=[0.0] * 8, upper=[1.0] * 8, seed=2, tolerance=0.01)
    assert found.cost == found.start_cost == 1.0
    assert found.history[0].best > 2.0
    assert found.history[-1].best < 1.1


def test_the_strategy_begins_elsewhere_where_everything_diverges() -> None:
    def island(x: Array) -> Array:
        away = np.abs(x - 0.85).max(axis=1)
        return np.where(away < 0.12, 1.0 + away, np.inf)

    found = evolve(island, [0.05, 0.05], lower=[0.0, 0.0], upper=[1.0, 1.0], seed=1)
    assert found.cost < 1.05


@pytest.mark.long
def test_strategy_and_simplex_reach_the_optimum_from_ten_random_starts() -> None:
    """All five stages of CWolf's example as shipped, without the descent: within 1 % in ten of ten."""
    found = list(searched())
    assert len(found) == 50
    assert [(one.stage, one.seed, one.simplex) for one in found if one.simplex > 1.01] == []
    # The simplex has its share: where the strategy ends above the optimum, it takes most of the rest.
    assert sum(one.strategy > 1.002 for one in found) > 5
    assert all(one.simplex - 1.0 < 0.5 * (one.strategy - 1.0) for one in found if one.strategy > 1.005)
