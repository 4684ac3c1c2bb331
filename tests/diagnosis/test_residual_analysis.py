"""Residual analysis of models linear in their unknowns: score tests, refits, alarms, memory, signals."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from seatrial._core import Vehicle
from seatrial.diagnosis.missing_terms import (
    Candidate,
    candidates,
    independent_blocks,
    missing_terms,
    signal_of,
)
from seatrial.diagnosis.residual_analysis import analyse, suggested_bounds
from seatrial.diagnosis.residual_signals import (
    autocorrelations,
    block_length,
    block_numbers,
    motion_signals,
    recorded_signals,
)
from seatrial.report.plot.identification import residual_figure
from seatrial.statistics.linearisation import Linearisation, Piece, Unknown
from seatrial.statistics.significance import score_tests
from seatrial.trial.trial import Trial
from tests.statistics.linear_trials import memory

Array = NDArray[np.float64]

DT = 0.1
FITTED = ("X_u", "X_uu", "Y_v", "N_r")
HELD = ("Y_ur", "Y_r", "N_uv", "N_vv", "Y_rr", "K_v", "X_vv", "Y_p")
TRIED = tuple(Candidate(name, (name,)) for name in HELD)


def linear(seed: int, *, rho: float = 0.0, missing: dict[str, float] | None = None) -> Linearisation:
    """A model linear in its unknowns: two trials, ten segments of ten seconds, channels v and r."""
    generator = np.random.default_rng(seed)
    names = (*FITTED, *HELD)
    pieces: list[Piece] = []
    for trial in ("one", "two"):
        slow = memory(generator.standard_normal((1000, 2, len(names))), 0.95)
        noise = memory(generator.standard_normal((1000, 2)), rho)
        nu = memory(generator.standard_normal((1000, 6)), 0.9)
        for name, size in (missing or {}).items():
            noise = noise + size * slow[:, :, names.index(name)]
        for start in range(0, 1000, 100):
            part = slice(start, start + 100)
            pieces.append(
                Piece(
                    trial=trial,
                    t=np.asarray(DT * np.arange(start, start + 100)),
                    residual=noise[part],
                    counted=np.ones((100, 2), dtype=bool),
                    weight=np.ones((100, 2)),
                    jacobian=slow[part],
                    nu=nu[part],
                )
            )
    unknowns = tuple(
        Unknown(name, "coefficient", "N", -math.inf, math.inf, math.inf, 0.0, math.inf) for name in names
    )
    return Linearisation(
        unknowns, np.zeros(len(names)), ("v", "r"), np.array([0.01, 0.02]), DT, tuple(pieces)
    )


def residual_plus(lin: Linearisation, channel: int, added: list[Array]) -> Linearisation:
    """The same with signals (n,) added to the residual of one channel, in standard deviations."""
    unit = np.eye(len(lin.channels))[channel]
    pieces = zip(lin.pieces, added, strict=True)
    moved = tuple(replace(p, residual=p.residual + np.outer(signal, unit)) for p, signal in pieces)
    return replace(lin, pieces=moved)


def test_score_test_is_the_refit_of_a_linear_model() -> None:
    lin = linear(3, missing={"Y_ur": 0.3})
    jacobian = np.concatenate([p.jacobian.reshape(-1, 12) for p in lin.pieces])
    residual = np.concatenate([p.residual.ravel() for p in lin.pieces])
    columns = [p.jacobian[:, :, 4:] for p in lin.pieces]
    results = score_tests(lin, columns, fitted=range(4), block=block_numbers(lin, 5.0)).results()
    old = np.linalg.lstsq(jacobian[:, :4], residual, rcond=None)[1][0]
    for place in range(len(HELD)):
        both = np.linalg.lstsq(jacobian[:, [0, 1, 2, 3, 4 + place]], residual, rcond=None)
        # The jitter of the factorisation is 1e-12 of the diagonal.
        assert results.step[place] == pytest.approx(both[0][-1], rel=1e-8)
        assert results.gain[place] * (residual @ residual) == pytest.approx(old - both[1][0], rel=1e-6)


def test_candidates_of_one_channel_are_tested_alike_with_and_without_the_zeros_of_the_others() -> None:
    lin = linear(3, missing={"Y_ur": 0.3})
    block = block_numbers(lin, 5.0)
    shown = [p.jacobian[:, 1:2, 4:] for p in lin.pieces]
    padded = [np.concatenate([np.zeros_like(one), one], axis=1) for one in shown]
    short = score_tests(lin, shown, fitted=range(4), block=block, channel=1)
    long = score_tests(lin, padded, fitted=range(4), block=block)
    assert short.reduced == pytest.approx(long.reduced, rel=1e-9, abs=1e-9)  # sums in another order
    assert short.own == pytest.approx(long.own)


@pytest.mark.parametrize("rho", [0.0, 0.98])
def test_coloured_noise_raises_no_more_alarms_than_white(rho: float) -> None:
    alarms, p = 0, []
    for seed in range(40):
        lin = linear(seed, rho=rho)
        block, _ = independent_blocks(lin, TRIED)
        alarms += bool(missing_terms(lin, TRIED, block=block, least_gain=0.0))
        columns = [piece.jacobian[:, :, 4:] for piece in lin.pieces]
        p.append(score_tests(lin, columns, fitted=range(4), block=block).results().p)
    # At 5 % each, more than 6 of 40 happen once in 200 times, more than 9 % of 320 about as often.
    assert alarms <= 6
    assert np.mean(np.array(p) < 0.05) < 0.09
    if rho > 0.0:  # the naive test, variance one over the information, would cry wolf
        naive = linear(0, rho=rho)
        z = score_tests(
            naive,
            [x.jacobian[:, :, 4:] for x in naive.pieces],
            fitted=range(4),
            block=block_numbers(naive, 5.0),
        )
        plain = np.abs(z.results().step) * np.sqrt(np.diagonal(z.reduced[0])[:-1])
        assert (plain > 2.0).sum() >= 3


def test_a_missing_term_is_found_with_its_value_in_coloured_noise() -> None:
    lin = linear(1, rho=0.9, missing={"N_vv": 0.8, "K_v": -0.5})
    block, length = independent_blocks(lin, TRIED)
    found = missing_terms(lin, TRIED, block=block)
    assert [one.name for one in found] == ["N_vv", "K_v"]
    for one, truth in zip(found, (0.8, -0.5), strict=True):
        assert abs(one.value - truth) < 3.0 * one.sigma
        assert one.p < 0.05
    # Memory of the noise: dt (1 + 0.9) / (1 - 0.9) = 1.9 s; what is missing does not count into it.
    assert 4.0 < length <= 200.0 / 24
    assert "r residual follows |v| v: free N_vv;" in found[0].sentence or "v residual" in found[0].sentence


def test_one_block_alone_is_no_evidence() -> None:
    lin = linear(5)
    pieces = list(lin.pieces)
    jacobian = np.zeros((len(pieces), 100, 2))
    jacobian[4] = pieces[4].jacobian[:, :, 4]
    pieces = [
        replace(
            p, jacobian=np.concatenate([p.jacobian[:, :, :4], j[:, :, None], p.jacobian[:, :, 5:]], axis=2)
        )
        for p, j in zip(pieces, jacobian, strict=True)
    ]
    pieces[4] = replace(pieces[4], residual=pieces[4].residual + 2.0 * jacobian[4])
    lin = replace(lin, pieces=tuple(pieces))
    # All of it lies in ten seconds; blocks of that length leave nothing to judge its scatter by.
    assert not missing_terms(lin, TRIED, block=block_numbers(lin, 10.0))


def test_what_the_data_cannot_tell_apart_is_one_suggestion() -> None:
    lin = linear(2, missing={"Y_ur": 0.5})
    generator = np.random.default_rng(0)

    def twin(p: Piece) -> Piece:
        jacobian = p.jacobian.copy()
        jacobian[:, :, 5] = jacobian[:, :, 4] + 0.01 * generator.standard_normal((100, 2))  # Y_r like Y_ur
        jacobian[:, :, 6] = jacobian[:, :, 0] - 2.0 * jacobian[:, :, 3]  # N_uv from what is fitted
        return replace(p, jacobian=jacobian)

    lin = replace(lin, pieces=tuple(twin(p) for p in lin.pieces))
    found = analyse(lin, tried=TRIED)
    assert [{one.name, *one.alternatives} for one in found.suggestions] == [{"Y_ur", "Y_r"}]
    assert "free Y_ur or Y_r;" in found.suggestions[0].sentence or "Y_r or Y_ur" in str(found)
    assert found.indistinguishable == ("N_uv",)
    assert found.tested == len(HELD) - 1


def test_autocorrelation_of_noise_with_a_known_memory() -> None:
    white, ar = autocorrelations(linear(0)), autocorrelations(linear(0, rho=0.8))
    for one in white:
        assert one.excess == pytest.approx(1.0, abs=0.05)  # 2000 samples: 2.2 % standard error and bias
        assert one.outside < 0.15
        assert one.p > 1e-3
        assert one.effective > 0.7 * one.samples
    for one in ar:
        np.testing.assert_allclose(one.rho[:3], 0.8 ** np.arange(1, 4), atol=0.1)  # standard error 0.04
        assert one.correlation_s == pytest.approx(DT * 1.8 / 0.2, rel=0.4)
        assert one.p < 1e-9
        # Second differences of an AR(1) see (6 - 8 rho + 2 rho^2) / 6 of its variance.
        assert one.excess == pytest.approx((6.0 / (6.0 - 6.4 + 1.28)) ** 0.5, rel=0.1)
    known = autocorrelations(linear(0), sensor_noise={"v": 0.005})
    assert known[0].excess == pytest.approx(2.0, rel=0.1)


def test_blocks_do_not_cross_trials_and_are_equally_long() -> None:
    lin = linear(0)
    numbers = block_numbers(lin, 7.0)
    first, second = np.concatenate(numbers[:10]), np.concatenate(numbers[10:])
    assert first.max() + 1 == second.min()
    counts = np.bincount(np.concatenate([first, second]))
    assert counts.min() >= counts.max() - 1
    assert len(counts) == 28
    assert block_length(autocorrelations(linear(0, rho=0.999)), 200.0) == pytest.approx(200.0 / 24)


def test_signals_without_a_coefficient_are_named_with_what_to_do() -> None:
    lin = linear(4)
    motion = motion_signals(lin)
    lag = [np.zeros(100) for _ in lin.pieces]
    for out, product in zip(lag, motion["w q"], strict=True):
        for k in range(1, 100):
            out[k] = math.exp(-DT / 5.0) * out[k - 1] + product[k]
    forced = residual_plus(lin, 0, [4.0 * one / np.std(lag) for one in lag])
    found = analyse(forced, info=Vehicle.load("cwolf").coefficient_info())
    assert (found.signals[0].channel, found.signals[0].signal) == ("v", "w q")
    assert found.signals[0].lag_s > 0.0
    assert "no coefficient has this form" in found.signals[0].sentence
    assert found.structural
    assert "only the hold-out score" in (found.warning or "")

    lever = residual_plus(lin, 0, [4.0 * one / np.std(motion["r"]) for one in motion["r"]])
    first = analyse(lever).signals[0]
    assert (first.signal, first.lag_s) == ("r", 0.0)
    assert "lever_x" in first.sentence

    battery = [np.sign(np.sin(0.2 * p.t)) for p in lin.pieces]
    sagging = residual_plus(lin, 1, [2.0 * one for one in battery])
    assert analyse(sagging, signals={"voltage": battery}).signals[0].signal == "voltage"


def test_noise_is_no_structure_and_coloured_noise_is_said() -> None:
    quiet = analyse(linear(7), tried=TRIED)
    assert not quiet.structural
    assert quiet.warning is None
    assert "None of the 8 coefficients" in str(quiet)
    red = analyse(linear(7, rho=0.98), tried=TRIED)
    assert not red.structural
    assert "outside the model class or the sensors' noise is not white" in (red.warning or "")
    assert json.loads(json.dumps(red.to_dict()))["structural"] is False


def test_candidates_act_on_free_axes_and_are_not_estimated() -> None:
    vehicle = Vehicle.load("cwolf")
    names = {c.name: c.members for c in candidates(vehicle, ["Y_v", "SbU.gain"], free="YN")}
    assert {"Y_ur", "N_uv", "Y_rdot", "m", "x_g", "PL.gain", "vertical.gain", "stern.T_1"} <= set(names)
    assert not {"Y_v", "X_u", "SbU.gain", "stern.gain", "PL.T_1"} & set(names)
    assert names["stern.T_1"] == ("SbU.T_1", "SbL.T_1", "PU.T_1", "PL.T_1")
    assert signal_of("x_g", vehicle.coefficient_info()) == "the centre of gravity, forward of O"


def test_actuators_without_a_group_are_no_group_together() -> None:
    ungrouped = re.sub(r'group = "\w+"\n', "", Vehicle.load("cwolf").to_toml())
    found = candidates(Vehicle.from_toml(ungrouped, "cwolf"), [], free="XYZKMN")
    assert {"SbU.T_1", "VTB.gain"} <= {c.name for c in found}
    assert all(len(c.members) == 1 for c in found)
    assert not [c.name for c in found if c.name.startswith(".")]


def test_figure_shows_every_channel_and_every_finding() -> None:
    found = analyse(linear(1, missing={"N_vv": 0.8, "K_v": -0.5}), tried=TRIED)
    figure = residual_figure(found)
    figure.canvas.draw()
    shown = [axes for axes in figure.axes if axes.axison]
    assert [axes.get_title(loc="left") for axes in shown[:2]] == ["v", "r"]
    assert len(shown[-1].patches) == len(found.suggestions) + len(found.signals) >= 2
    # Colours are named where there are two.
    both = bool(found.suggestions) and bool(found.signals)
    assert ("grey" in shown[-1].get_xlabel()) is both
    assert "\N{MULTIPLICATION SIGN} noise" in shown[0].get_title(loc="right")
    nothing = residual_figure(analyse(linear(7), tried=TRIED))
    assert any("None of 8" in text.get_text() for axes in nothing.axes for text in axes.texts)


def test_recorded_signals_are_those_of_the_segments_samples() -> None:
    t = np.arange(0.0, 100.0, DT)
    one = Trial.read({"t_s": t, "u_m_s": np.sin(t), "voltage_v": 24.0 + 0.01 * t}, name="one")
    pushed = {"cmd.PL": 1000.0 * np.sign(np.sin(t)), "tau.X_n": 3.0 * np.sin(t), "tau.Y_n": 0.0 * t}
    two = Trial.read({"t_s": t, "u_m_s": np.sin(t)} | pushed, name="two")
    found = recorded_signals(linear(0), {"one": one, "two": two})
    assert set(found) == {"voltage", "command PL", "wrench X", "time"}
    np.testing.assert_allclose(np.ptp(found["wrench X"][12]), 6.0, rtol=0.01)
    assert np.concatenate(found["voltage"]).mean() == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(np.diff(found["voltage"][3]), 0.01 * DT, rtol=1e-6)
    assert not found["voltage"][12].any()


def test_lag_and_dead_time_are_candidates_of_every_group_whatever_its_values() -> None:
    vehicle = Vehicle.load("cwolf").with_coefficients({"SbU.T_1": 0.3, "PU.T_t": 0.0})
    names = {c.name: c.members for c in candidates(vehicle, ["SbL.T_t"], free="X")}
    assert names["stern.T_1"] == ("SbU.T_1", "SbL.T_1", "PU.T_1", "PL.T_1")
    assert names["SbU.T_t"] == ("SbU.T_t", "PU.T_t", "PL.T_t")


DELAY = (Candidate("stern.T_1", ("PL.T_1", "PU.T_1")),)


def delayed(present: float, step: float) -> Linearisation:
    """The linear model with a group's lag as its only candidate, off by a step."""
    lin = linear(4, missing={"Y_ur": step})
    names = {"Y_ur": "PL.T_1", "Y_r": "PU.T_1"}
    unknowns = tuple(replace(one, name=names.get(one.name, one.name), unit="s") for one in lin.unknowns)
    values = np.where([one.name.endswith("T_1") for one in unknowns], present, 0.0)
    # The second actuator of the group pushes nothing here; the others are fitted.
    pieces = tuple(
        replace(p, jacobian=np.where(np.arange(len(unknowns)) == 5, 0.0, p.jacobian)) for p in lin.pieces
    )
    return replace(lin, unknowns=unknowns, values=values, pieces=pieces)


@pytest.mark.parametrize(("present", "step"), [(0.2, 0.3), (0.5, -0.3), (0.1, -0.3), (0.0, -0.3)])
def test_no_lag_below_zero_is_suggested(present: float, step: float) -> None:
    lin = delayed(present, step)
    block, _ = independent_blocks(lin, DELAY)
    found = missing_terms(lin, DELAY, block=block)
    if present == 0.0:
        assert not found  # nothing to lower
        return
    assert [one.name for one in found] == ["stern.T_1"]
    assert found[0].value == pytest.approx(max(present + step, 0.0), abs=4.0 * found[0].sigma)
    assert found[0].value >= 0.0
    assert suggested_bounds(found[0], {})[0] >= 0.0
    faster = present + step < 0.0
    assert found[0].faster is faster
    words = "the actuator responds faster than the file says: lower stern.T_1 from 0.1 s (0 at least)"
    assert (words in found[0].sentence) is faster
    assert ("free stern.T_1" in found[0].sentence) is not faster
