"""Instruments under feedback: what was known when a prediction was made does not know what it misses."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest

from seatrial.base.arrays import Array
from seatrial.estimation.instruments import driven, drivers, instrumented, lag_s
from seatrial.estimation.one_step import Errors, Span
from seatrial.scoring.record import Record
from seatrial.trial.trial import Trial

A, B, HORIZON = 0.95, 0.1, 15
"""``x[k+1] = A x[k] + B u[k] + w[k]``; the unknown is B, as the gain of a rudder is."""


def sailed(count: int, feedback: float) -> tuple[Array, Array, Array]:
    """State, command and disturbance; the command follows a slow set point and answers the state."""
    generator = np.random.default_rng(4)
    x, u, w = np.zeros(count + 1), np.zeros(count), generator.normal(0.0, 0.1, count)
    wanted = np.repeat(generator.normal(0.0, 1.0, count // 200 + 1), 200)
    for k in range(count):
        u[k] = feedback * (wanted[k] - x[k])
        x[k + 1] = A * x[k] + B * u[k] + w[k]
    return x[:-1], u, w


def predicted(x: Array, u: Array, ahead: int) -> Errors:
    """Errors and slopes of predictions so far ahead, at the true B."""
    count = len(x) - ahead
    state, slope = x[:count].copy(), np.zeros(count)
    for k in range(ahead):
        slope = A * slope + u[k : k + count]
        state = A * state + B * u[k : k + count]
    error = (x[ahead:] - state)[:, None]
    nothing = np.zeros((0, 1, 1))
    span = Span(0, 0, len(x) - 1, error, error > 0.0, *(nothing,) * 7, nothing[:, 0, 0])
    every = np.ones_like(error, dtype=bool)
    return Errors(span, error, every, slope[:, None, None], slope[:, None, None])


def pull(errors: Errors, of: Array) -> tuple[float, float]:
    """Sum of products with the errors, over its slope by B, and its standard deviation by blocks."""
    product, size = (of * errors.error[..., None]).ravel(), float((of * errors.slope).sum())
    blocks = product[: len(product) // 200 * 200].reshape(-1, 200).sum(axis=1)
    return float(product.sum()) / size, float(np.sqrt((blocks**2).sum())) / size


def test_law_instruments_do_not_know_the_errors() -> None:
    """Least squares over a horizon misses B by a quarter in a closed loop, instruments by chance alone."""
    x, u, _ = sailed(20_000, 3.0)
    late, first = predicted(x, u, HORIZON), predicted(x, u, 1)
    (made,) = instrumented([late], [first], [np.column_stack([u, x])], lag=5)
    (bent, narrow), (off, chance) = pull(late, late.slope), pull(late, made.instrument)
    assert bent < -0.2 * B
    assert bent < -5.0 * narrow
    assert abs(off) < 0.05 * B
    assert abs(off) < 3.0 * chance
    # It is an instrument: it moves with the slope.
    assert np.corrcoef(made.instrument.ravel(), late.slope.ravel())[0, 1] > 0.5
    np.testing.assert_array_equal(made.error, late.error)
    np.testing.assert_array_equal(made.slope, late.slope)


def test_lags_follow_the_waves() -> None:
    assert lag_s(0.2) == pytest.approx(5.0 / 8.0)
    assert lag_s(None) == pytest.approx(0.7)


def test_what_does_not_count_has_no_instrument() -> None:
    x, u, _ = sailed(2_000, 3.0)
    late, first = predicted(x, u, HORIZON), predicted(x, u, 1)
    late.counted[300:500] = False
    (made,) = instrumented([late], [first], [np.column_stack([u, x])], lag=5)
    np.testing.assert_array_equal(made.instrument[300:500], 0.0)
    assert np.isfinite(made.instrument).all()


def test_trials_may_be_driven_by_different_things() -> None:
    """A trial by commands and one by a wrench have the same columns, each zero in those of the other."""
    t = np.arange(0.0, 5.0, 0.1)
    motion = {"t_s": t, "u_m_s": np.sin(t)}
    by_command = Trial.read(pl.DataFrame(motion | {"cmd.stern": np.cos(t)}))
    wrench = {f"tau.{axis}": 2.0 * np.cos(t) for axis in ("X_n", "Y_n", "Z_n", "K_nm", "M_nm", "N_nm")}
    by_wrench = Trial.read(pl.DataFrame(motion | wrench))
    counted = np.ones((len(t), 12), dtype=bool)
    records = [Record(by_command, "commands", counted), Record(by_wrench, "tau", counted)]
    one, other = driven(records)
    assert drivers(records) == ["commands stern", "tau K", "tau M", "tau N", "tau X", "tau Y", "tau Z"]
    assert one.shape == other.shape == (len(t), 7)
    np.testing.assert_allclose(one, np.column_stack([np.cos(t), *[np.zeros_like(t)] * 6]))
    np.testing.assert_allclose(other, np.column_stack([np.zeros_like(t), *[2.0 * np.cos(t)] * 6]))
