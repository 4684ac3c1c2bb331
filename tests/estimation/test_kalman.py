"""The filter and smoother of the core along a linear model, and the search for the noises."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from seatrial._core import LinearModel
from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError
from seatrial.estimation.estimator import NoiseModel
from seatrial.estimation.kalman import Filters, shaped
from seatrial.estimation.one_step import Motion, Span

N, S, Y, M, SAMPLES = 6, 3, 2, 2, 40


def parts(seed: int = 0) -> dict[str, Any]:
    """A model of three states, driven by three more, seen through two channels that miss samples."""
    draw = np.random.default_rng(seed)
    # The last two turn, at another rate on every step.
    places, turned = [(0, 3), (1, 4), (1, 5), (2, 4), (2, 5)], draw.uniform(0.1, 0.4, SAMPLES - 1)
    driven = 0.9 * np.array([
        np.ones_like(turned),
        np.cos(turned),
        np.sin(turned),
        -np.sin(turned),
        np.cos(turned),
    ])
    return {
        "transition": np.hstack([np.eye(S), np.zeros((S, N - S))])
        + 0.3 * draw.normal(size=(SAMPLES - 1, S, N)),
        "places": places,
        "driven": driven.T,
        "seen": [(c, l) for c in range(Y) for l in range(N)],
        "shown": np.repeat(draw.normal(size=(1, Y * N)), SAMPLES, axis=0),
        "measured": draw.normal(size=(SAMPLES, Y)),
        "valid": draw.uniform(size=(SAMPLES, Y)) > 0.3,
        "drift": 0.1 * draw.normal(size=(SAMPLES - 1, N)),
        "slopes": draw.normal(size=(SAMPLES - 1, S, M)),
        "start": draw.normal(size=N),
    }


PROCESS, SENSORS, START = np.array([0.1, 0.2, 0.3, 0.05, 0.0, 0.1]), np.array([0.5, 2.0]), np.full(N, 0.7)


def dense(given: dict[str, Any]) -> tuple[Array, Array]:
    """Mean (n N,) and covariance of all states before any measurement, by plain recursion."""
    mean, spread = [given["start"]], np.zeros((SAMPLES * N, SAMPLES * N))
    spread[:N, :N] = np.diag(START)
    for k in range(SAMPLES - 1):
        a = np.vstack([given["transition"][k], np.zeros((N - S, N))])
        for (row, column), value in zip(given["places"], given["driven"][k], strict=True):
            a[S + row, column] = value
        mean.append(a @ mean[-1] + given["drift"][k])
        here, then = slice(k * N, (k + 1) * N), slice((k + 1) * N, (k + 2) * N)
        spread[then, : (k + 1) * N] = a @ spread[here, : (k + 1) * N]
        spread[: (k + 1) * N, then] = spread[then, : (k + 1) * N].T
        spread[then, then] = a @ spread[here, here] @ a.T + np.diag(PROCESS)
    return np.concatenate(mean), spread


def test_likelihood_and_smoothed_states_are_those_of_one_large_gaussian() -> None:
    given = parts()
    mean, spread = dense(given)
    rows = [(k, c) for k in range(SAMPLES) for c in range(Y) if given["valid"][k, c]]
    shown = np.zeros((len(rows), SAMPLES * N))
    for row, (k, c) in zip(shown, rows, strict=True):
        row[k * N : (k + 1) * N] = given["shown"][k].reshape(Y, N)[c]
    size = shown @ spread @ shown.T + np.diag([SENSORS[c] for _, c in rows])
    # Small errors: none is an outlier.
    error = 0.3 * np.linalg.cholesky(size) @ np.random.default_rng(1).normal(size=len(rows))
    for (k, c), one, expected in zip(rows, error, shown @ mean, strict=True):
        given["measured"][k, c] = expected + one
    likelihood, _, _, smoothed, known = LinearModel(**given).judge(PROCESS, SENSORS, START, range(N))
    solved = np.linalg.solve(size, error)
    assert likelihood == pytest.approx(-0.5 * (error @ solved + np.linalg.slogdet(size)[1]), rel=1e-10)
    alone = LinearModel(**given).likelihood(PROCESS, SENSORS, START)
    assert alone.shape == (SAMPLES,)
    assert alone.sum() == pytest.approx(likelihood, rel=1e-12)
    best = (mean + spread @ shown.T @ solved).reshape(SAMPLES, N)
    np.testing.assert_allclose(smoothed, best, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(known[-1], best[-1], rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("more", [4, 20, 34])
def test_states_that_nothing_shows_change_nothing(more: int) -> None:
    """Rows are as long as the states need; with more of them they take more blocks."""
    few, many = parts(), parts()
    wide = np.zeros((SAMPLES - 1, S, N + more))
    wide[:, :, :N] = few["transition"]
    many |= {
        "transition": wide,
        "places": [*few["places"], *((N - S + i, N + i) for i in range(more))],
        "driven": np.hstack([few["driven"], np.full((SAMPLES - 1, more), 0.5)]),
        "drift": np.hstack([few["drift"], np.zeros((SAMPLES - 1, more))]),
        "start": np.append(few["start"], np.zeros(more)),
    }
    found = LinearModel(**few).judge(PROCESS, SENSORS, START, range(N))
    noises = np.append(PROCESS, np.ones(more)), SENSORS, np.append(START, np.ones(more))
    wider = LinearModel(**many).judge(*noises, range(N))
    assert wider[0] == found[0]
    np.testing.assert_array_equal(wider[1][:N], found[1])
    np.testing.assert_array_equal(wider[1][N:], 0.0)
    for one, other in zip(wider[2:], found[2:], strict=True):
        np.testing.assert_array_equal(one, other)
    ahead = LinearModel(**many).predict(*noises, 2), LinearModel(**few).predict(PROCESS, SENSORS, START, 2)
    np.testing.assert_array_equal(*ahead)


def test_more_states_than_there_is_room_for_are_refused() -> None:
    with pytest.raises(SimulationError, match="at most 40 states, found 41"):
        LinearModel(
            **(
                parts()
                | {
                    "transition": np.zeros((SAMPLES - 1, S, 41)),
                    "places": [],
                    "driven": np.zeros((SAMPLES - 1, 0)),
                    "drift": np.zeros((SAMPLES - 1, 41)),
                    "start": np.zeros(41),
                }
            )
        )


def test_slopes_of_the_likelihood_are_its_derivatives() -> None:
    model = LinearModel(**parts())
    _, process, sensors, _, _ = model.judge(PROCESS, SENSORS, START, [])
    step = 1e-6
    for found, at, order in ((process, PROCESS, (0, 1)), (sensors, SENSORS, (1, 0))):
        for i in range(len(at)):
            sides = []
            for sign in (1.0, -1.0):
                moved = at.copy()
                moved[i] += sign * step
                noises = (moved, SENSORS) if order == (0, 1) else (PROCESS, moved)
                sides.append(model.judge(*noises, START, [])[0])
            assert found[i] == pytest.approx((sides[0] - sides[1]) / (2.0 * step), rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("ahead", [0, 1, 4])
def test_derivatives_of_predictions_hold_the_gains(ahead: int) -> None:
    given = parts()
    given["measured"] *= 0.01  # no outlier is clipped
    given["start"] *= 0.0
    given["drift"] *= 0.0
    found = LinearModel(**given).predict(PROCESS, SENSORS, START, ahead)
    assert found.shape == (SAMPLES - ahead, Y, 1 + M)
    for unknown in range(M):
        moved = dict(given)
        moved["drift"] = np.zeros((SAMPLES - 1, N))
        moved["drift"][:, :S] = 1e-3 * given["slopes"][:, :, unknown]
        there = LinearModel(**moved).predict(PROCESS, SENSORS, START, ahead)
        np.testing.assert_allclose((there - found)[..., 0] / 1e-3, found[..., 1 + unknown], atol=1e-8)


def test_an_outlier_moves_the_estimate_no_further_than_its_bound() -> None:
    given = parts()
    given["valid"][10, 0] = True
    known = []
    for error in (1e3, 1e6):
        given["measured"][10, 0] = error
        known.append(LinearModel(**given).judge(PROCESS, SENSORS, START, range(N))[4])
    np.testing.assert_array_equal(known[0], known[1])


def test_parts_that_do_not_fit_are_refused() -> None:
    given = parts()
    given["drift"] = given["drift"][:-1]
    with pytest.raises(SimulationError, match="drift: expected 234 numbers, found 228"):
        LinearModel(**given)
    for wrong, message in (
        ({"seen": [(0, 0)] * (Y * N - 1) + [(2, 0)]}, "seen: expected channels that ascend, below 2"),
        (
            {"places": [(1, 0)] + [(0, 3)] * 4},
            "places: expected rows that ascend, below 3, and columns below 6",
        ),
    ):
        with pytest.raises(SimulationError, match=message):
            LinearModel(**(parts() | wrong))
    model = LinearModel(**parts())
    with pytest.raises(SimulationError, match="noise: expected 6, 2, 6"):
        model.judge(PROCESS[:-1], SENSORS, START, [])
    with pytest.raises(SimulationError, match="kept: expected places below 6, found 6"):
        model.judge(PROCESS, SENSORS, START, [6])
    with pytest.raises(SimulationError, match="more than 40 samples"):
        model.predict(PROCESS, SENSORS, START, 40)


class Bounded(Filters):
    """A filter that has no numbers beside noises far from 1, as in calm water where hardly anything moves."""

    def _judged(self, noise: NoiseModel) -> tuple[float, Array, Array, list[Motion]]:
        away = np.log(noise.process), np.log(noise.sensors)
        impossible = max(np.abs(away[0]).max(), np.abs(away[1]).max()) > 4.0
        wanted = np.linspace(-3.0, 3.0, len(away[0])), np.full(len(away[1]), -2.0)
        missed = [one - other for one, other in zip(away, wanted, strict=True)]
        slopes = [-2000.0 * one for one in missed]
        likelihood = -1000.0 * sum(float((one**2).sum()) for one in missed)
        return (
            np.nan if impossible else likelihood,
            slopes[0] / noise.process,
            slopes[1] / noise.sensors,
            [],
        )


def test_noises_with_which_the_filter_has_no_numbers_do_not_end_the_search() -> None:
    """All variances were tried at their bounds first, and what came back ended the search where it began."""
    one = np.ones((2, 2))
    span = Span(0, 0, 1, one, one > 0.0, one, one, one, one, one, one, one, one[0])
    noise = NoiseModel(np.ones(5), np.ones(2), None, (), (), 0.05)
    bounded = Bounded.__new__(Bounded)
    bounded.spans = [span]
    _, found, _ = bounded.likeliest(noise, 30)
    np.testing.assert_allclose(np.log(found.process), np.linspace(-3.0, 3.0, 5), atol=0.05)
    np.testing.assert_allclose(np.log(found.sensors), -2.0, atol=0.05)


def adrift(
    damping: float,
    hz: float = 0.2,
    count: int = 3000,
    through: Array | None = None,
    toward: float = 0.0,
    depth: Array | None = None,
    carried: bool = True,
) -> tuple[Span, Array]:
    """A point in waves, seen over ground by a noisy log, and the velocity of the water.

    It is adrift, or sails ``through`` (count, 2) and meets the waves that go ``toward`` at another frequency,
    at a ``depth`` (count,) where they are smaller. They carry it along, or drag it by a tenth of what they
    move beside it in every sample.
    """
    draw = np.random.default_rng(3)
    through = np.zeros((count, 2)) if through is None else through
    still = 2.0 * np.pi * hz
    met = still - still**2 / 9.81 * (through @ [np.cos(toward), np.sin(toward)])
    place = rate = 0.0
    water = np.empty(count)
    for k, omega in enumerate(met):
        for _ in range(10):
            rate += -0.01 * (omega**2 * place + 2.0 * damping * omega * rate)
            rate += 0.1 * np.sqrt(4.0 * damping * omega * 0.01) * draw.normal()
            place += 0.01 * rate
        water[k] = rate
    depth = np.zeros(count) if depth is None else depth
    water *= np.exp(-(still**2) / 9.81 * depth)
    dragged = np.zeros(count)
    for k in range(count - 1):
        dragged[k + 1] = 0.9 * dragged[k] + 0.05 * (water[k] + water[k + 1])
    afloat = np.zeros((count, 1, 3))
    afloat[:, 0, 0] = 1.0
    seen = Span(
        record=0,
        first=0,
        last=count - 1,
        measured=((water if carried else dragged) + draw.normal(0.0, 0.02, count))[:, None],
        valid=np.ones((count, 1), dtype=bool),
        transition=np.full((count - 1, 1, 1), 0.9),
        current=np.broadcast_to(0.0 if carried else [0.1, 0.0, 0.0], (count - 1, 1, 3)),
        unknowns=np.zeros((count - 1, 1, 1)),
        missed=np.zeros((count - 1, 1)),
        water=np.zeros((count, 2)),
        afloat=afloat,
        through=through,
        depth=depth,
    )
    return seen, water


def test_water_of_waves_carries_the_vehicle_and_its_noises_are_found() -> None:
    """The water moves it and no force does."""
    dt, hz, damping = 0.1, 0.2, 0.05
    omega = 2.0 * np.pi * hz
    span, water = adrift(damping)
    # White and slow acceleration of the one axis, a wave that pushes it, the water's, the current.
    process = np.array([1e-4, 1e-6, 0.0, 1e-5, 0.0, 1e-4, 1e-8, 1e-8])
    noise = NoiseModel(process, np.array([1e-3]), hz, (0,), (0,), damping)
    _, found, [motion] = Filters([span], noise, dt, [0]).likeliest(noise, 60)
    assert np.sqrt(found.sensors[0]) == pytest.approx(0.02, rel=0.1)
    orbital = np.sqrt(found.process[5] / (4.0 * damping * omega * dt))
    assert orbital == pytest.approx(water.std(), rel=0.2)
    # Beside the water it does not move: its damping would have shown.
    assert motion.states.std() < 0.2 * water.std()


def test_waves_are_smaller_at_depth() -> None:
    """A log that changes its depth in waves of 5 s, as the filter has it and as one depth has it."""
    hz, damping = 0.2, 0.05
    deep, _ = adrift(damping, depth=np.repeat([3.0, 12.0], 1500))
    process = np.array([1e-4, 1e-6, 0.0, 1e-5, 0.0, 1e-4, 1e-8, 1e-8])
    noise = NoiseModel(process, np.array([1e-3]), hz, (0,), (0,), damping)
    found = []
    for span in (deep, replace(deep, depth=np.zeros(3000))):
        likelihood, model, _ = Filters([span], noise, 0.1, [0]).likeliest(noise, 60)
        found.append((likelihood, np.sqrt(model.process[5] / (4.0 * damping * 2.0 * np.pi * hz * 0.1))))
    (decaying, orbit), (constant, _) = found
    assert decaying > constant + 50.0
    # The intensity is that of the root mean square over all depths.
    number = (2.0 * np.pi * hz) ** 2 / 9.81
    size = np.sqrt(np.mean(np.exp(-2.0 * number * np.array([3.0, 12.0]))))
    assert orbit == pytest.approx(0.1 * size, rel=0.2)
    # A span without depth has waves of that size, and changes nothing of another one's.
    unknown = replace(deep, depth=np.full(3000, np.nan))
    both = Filters([deep, unknown], noise, 0.1, [0]).likelihoods(noise)
    np.testing.assert_array_equal(both[0], Filters([deep], noise, 0.1, [0]).likelihoods(noise)[0])
    level = replace(deep, depth=np.zeros(3000))
    np.testing.assert_array_equal(both[1], Filters([level], noise, 0.1, [0]).likelihoods(noise)[0])
    # A depth that all samples share says nothing.
    same = [Filters([replace(deep, depth=np.full(3000, z))], noise, 0.1, [0]) for z in (0.0, 400.0)]
    assert same[0].likelihood(noise) == pytest.approx(same[1].likelihood(noise), rel=1e-12)


@pytest.mark.parametrize("carried", [True, False])
def test_likelihood_says_whether_water_carries_or_flows_past(carried: bool) -> None:
    span, _ = adrift(0.05, carried=carried)
    # What flows past acts on the state by the derivative by the current, which a log in both cases has.
    span = replace(span, current=np.broadcast_to([0.1, 0.0, 0.0], (2999, 1, 3)))
    process = np.array([1e-6, 1e-8, 0.0, 1e-12, 0.0, 1e-4, 1e-10, 1e-10])
    for first in (True, False):
        noise = NoiseModel(process, np.array([1e-3]), 0.2, (0,), (0,), 0.05, carried=first)
        assert shaped([span], noise, 0.1, [0], 16, None).carried is carried


@pytest.mark.long
@pytest.mark.parametrize("damping", [0.02, 0.2])
@pytest.mark.parametrize("hz", [0.2, 0.17, 0.24])
def test_waves_are_as_fast_and_as_broad_as_the_sea(damping: float, hz: float) -> None:
    span, _ = adrift(damping)  # waves of 0.2 Hz
    process = np.array([1e-4, 1e-6, 0.0, 1e-5, 0.0, 1e-4, 1e-8, 1e-8])
    noise = NoiseModel(process, np.array([1e-3]), hz, (0,), (0,), 0.05)
    _, noise, _ = Filters([span], noise, 0.1, [0]).likeliest(noise, 40)
    found = shaped([span], noise, 0.1, [0], 8, None)
    # Candidates lie a factor of 1.7 apart, and five minutes have some fifty waves.
    assert found.damping == pytest.approx(damping, rel=0.75)
    # Candidates lie 6 % apart; the broader the sea, the less its frequency is told.
    assert found.wave_hz == pytest.approx(0.2, rel=0.03 + 0.5 * damping)
    still = shaped([span], replace(noise, wave_hz=None), 0.1, [0], 8, None)
    assert still.damping == noise.damping


@pytest.mark.long
def test_courses_tell_where_the_waves_go() -> None:
    """On a square they are met at frequencies from 0.16 to 0.24 Hz; on one course at one."""
    sides = 1.7 * np.repeat([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]], 750, axis=0)
    process = np.array([1e-4, 1e-6, 0.0, 1e-5, 0.0, 1e-4, 1e-8, 1e-8])
    found = []
    for through in (sides, sides[:1] + np.zeros((3000, 1))):
        span, _ = adrift(0.03, through=through, toward=np.radians(200.0))
        noise = NoiseModel(process, np.array([1e-3]), 0.2, (0,), (0,), 0.05)
        _, noise, _ = Filters([span], noise, 0.1, [0]).likeliest(noise, 40)
        found.append((
            Filters([span], noise, 0.1, [0]).likelihood(noise),
            shaped([span], noise, 0.1, [0], 8, None),
        ))
        assert Filters([span], found[-1][1], 0.1, [0]).likelihood(found[-1][1]) > found[-1][0]
    square, straight = (model for _, model in found)
    assert straight.toward is None
    assert square.toward is not None
    assert np.degrees(square.toward) % 360.0 == pytest.approx(200.0, abs=20.0)
    assert square.wave_hz == pytest.approx(0.2, rel=0.04)
    # The rates' variance does not hang on the course.
    damping, omega = square.damping, 2.0 * np.pi * (square.wave_hz or 0.0)
    rate = np.sqrt(square.process[5] / (4.0 * damping * omega * 0.1))
    assert rate == pytest.approx(0.1, rel=0.3)


def test_faster_and_broader_waves_keep_their_variance() -> None:
    noise = NoiseModel(np.arange(1.0, 9.0), np.ones(1), 0.2, (0,), (0,), 0.05)
    other = noise.shaped(0.3, 0.1)
    np.testing.assert_allclose(other.process / noise.process, [1.0, 1.0, 3.0, 3.0, 3.0, 3.0, 1.0, 1.0])
