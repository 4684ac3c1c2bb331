"""A proposed hold-out is contiguous, has every kind of manoeuvre, and is not the easy part."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import seatrial as st
from seatrial.inspect.kind_of_data import windows
from seatrial.inspect.manoeuvres import manoeuvres

T = np.arange(0.0, 400.0, 0.1)


def stepped(changes: list[tuple[float, float]]) -> st.Trial:
    """Surge under a force that changes at times, with its response."""
    force = np.zeros(len(T))
    for at, value in changes:
        force[at <= T] = value
    u = np.zeros(len(T))
    for k in range(1, len(T)):
        u[k] = u[k - 1] + 0.1 / 5.0 * (0.05 * force[k - 1] - u[k - 1])
    noise = np.random.default_rng(1).normal(0.0, 0.002, len(T))
    return st.Trial.read({"t_s": T, "u_m_s": u + noise, "tau.X_n": force}, align=False)


def test_every_kind_is_in_both_parts() -> None:
    levels = [20.0, 0.0, 30.0, 10.0, 0.0]
    trial = stepped([(10.0 + 15.0 * k, levels[k % 5]) for k in range(26)])
    found = manoeuvres(trial)
    proposed = windows(trial, found)
    assert proposed.hold_out is not None
    start, stop = proposed.hold_out
    assert 0.2 * 390.0 <= stop - start <= 0.36 * 400.0
    assert proposed.kept[0] == proposed.kept[1] >= 2
    for kind in ("step", "coast-down"):
        inside = [one for one in found if one.kind == kind and start <= one.start_s and one.end_s <= stop + 1]
        outside = [one for one in found if one.kind == kind and (one.end_s <= start or one.start_s >= stop)]
        assert inside
        assert outside


def test_the_easy_end_is_not_held_out() -> None:
    trial = stepped([(10.0 + 12.0 * k, 30.0 * (k % 2)) for k in range(23)])  # at rest after 274 s
    proposed = windows(trial, manoeuvres(trial))
    assert proposed.hold_out is not None
    assert proposed.hold_out[1] <= 300.0
    assert proposed.use[1] == pytest.approx(300.0, abs=25.0)
    assert proposed.effort > 0.7


def test_the_hold_out_lies_where_the_log_has_samples() -> None:
    """Half a minute without samples, in the middle of what would be held out of the whole log."""
    force = 30.0 * ((T // 12.0) % 2)
    u = 0.05 * force + np.random.default_rng(1).normal(0.0, 0.002, len(T))

    def held_out(kept: NDArray[np.bool_]) -> tuple[float, float]:
        table = {"t_s": T[kept], "u_m_s": u[kept], "tau.X_n": force[kept]}
        trial = st.Trial.read(table, align=False, rate_hz=10.0)
        proposed = windows(trial, manoeuvres(trial)).hold_out
        assert proposed is not None
        return proposed

    middle = float(np.mean(held_out(np.ones(len(T), bool))))
    start, stop = held_out(np.abs(T - middle) > 15.0)
    assert stop <= middle - 14.0 or start >= middle + 14.0


def test_a_short_trial_is_not_split() -> None:
    t = T[:300]
    trial = st.Trial.read({"t_s": t, "u_m_s": np.sin(t)})
    proposed = windows(trial, [])
    assert proposed.hold_out is None
    assert "too short to split: hold out another trial" in proposed.sentence


def test_both_parts_have_commands_that_change() -> None:
    def adrift(*pushed: tuple[float, float]) -> st.Trial:
        """A vehicle that swings in the swell all the time and is pushed now and then."""
        force = sum(np.where((from_s <= T) & (to_s > T), 30.0, 0.0) for from_s, to_s in pushed)
        return st.Trial.read({"t_s": T, "u_m_s": 0.2 * np.sin(0.1 * T), "tau.X_n": force}, align=False)

    once = windows(adrift((200.0, 220.0)), [])
    assert once.hold_out is None
    assert "one stretch only, 200 to 240 s" in once.sentence
    twice = windows(adrift((60.0, 70.0), (300.0, 310.0)), [])
    assert twice.hold_out is not None
    start, stop = twice.hold_out
    assert (start <= 60.0 and stop >= 90.0) != (start <= 300.0 and stop >= 330.0)
    assert windows(adrift(), []).hold_out is not None


def test_a_hold_out_that_moves_nothing_is_not_proposed() -> None:
    """A vehicle that runs for 100 s, whose thrusters are tried out later while it is moored."""
    force = np.where(T < 100.0, 30.0 * ((T // 10.0) % 2), 0.0)
    moored = np.where((T > 250.0) & (T < 390.0), 5.0 * ((T // 10.0) % 2), 0.0)
    u = np.where(T < 100.0, 0.5 * np.sin(0.3 * T), 0.0) + np.random.default_rng(1).normal(0.0, 1e-3, len(T))
    trial = st.Trial.read({"t_s": T, "u_m_s": u, "tau.X_n": force + moored}, align=False)
    proposed = windows(trial, manoeuvres(trial))
    if proposed.hold_out is not None:
        inside = (trial.t >= proposed.hold_out[0]) & (trial.t < proposed.hold_out[1])
        assert np.std(u[inside]) > 0.02
    else:
        assert "moves nothing" in proposed.sentence
