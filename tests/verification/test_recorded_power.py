"""What a log could have refuted: groups, factors, unjudged axes, and the law of `verify-log`."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from xml.etree import ElementTree

import numpy as np
import pytest

import seatrial as st
from seatrial.identification.fitted import Fitted
from seatrial.verification.mission_log.judge_log import LogSettings, judge_model, verify_log
from seatrial.verification.mission_log.log import offsets_of
from seatrial.verification.mission_log.power import (
    SETTINGS,
    CoefficientGroup,
    Power,
    Shown,
    coefficient_groups,
    group_power,
)
from seatrial.verification.mission_log.spread import restarts
from seatrial.verification.mission_log.unknowns import Point, Unknowns, explained_best, pieces, sensor_noise
from tests.verification.power_law import SEED, VEHICLES, changed, judged, law
from tests.verification.recorded_logs import fitted, log

PITCH = ("M_qdot", "M_q", "M_qq", "M_uq", "M_uw")


def scaled(names: tuple[str, ...], factor: float) -> tuple[tuple[str, float], ...]:
    values = fitted().vehicle.coefficients()
    return tuple((name, factor * values[name]) for name in names)


@cache
def power(changes: tuple[tuple[str, float], ...] = (), stop_s: float | None = None) -> Power:
    """Power of a log of CWolf with other coefficients, judged by CWolf."""
    known = fitted()
    windows = restarts(known.vehicle, log(2, changes).trial, stop_s=stop_s)
    return group_power(known, windows, offsets=offsets_of("typical", known.vehicle), level=0.01, water=False)


@pytest.mark.parametrize("name", VEHICLES)
def test_law_every_hydrodynamic_coefficient_is_in_one_group_of_its_axis(name: str) -> None:
    vehicle = st.Vehicle.load(name)
    groups = coefficient_groups(vehicle, actuators=False)
    members = [member for group in groups for member in group.names]
    assert len(members) == len(set(members))
    values = vehicle.coefficients()
    assert set(members) == {n for n, x in values.items() if x and n[1:2] == "_" and n[0] in "XYZKMN"}
    assert all(member[0] == group.axis for group in groups for member in group.names)


def test_the_true_model_is_refuted_in_no_group_and_explained_to_its_noise() -> None:
    unchanged = power()
    assert not unchanged.refuted
    assert unchanged.unjudged == ""
    # Of a true model the error is that of the noise; held samples and quick motion make that look larger.
    assert all(0.1 < x < 1.4 for x in unchanged.left.values()), unchanged.left
    # Noise is as large in ten seconds as in two; fewer starts to fit leave some percent more of it.
    assert all(0.9 < x < 1.15 for x in unchanged.grown.values()), unchanged.grown


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_the_group_that_was_changed_is_refuted_with_about_its_factor(factor: float) -> None:
    changed_drag = power(scaled(("X_u", "X_uu"), factor))
    drag = next(test for test in changed_drag.tests if (test.group.axis, test.group.kind) == ("X", "damping"))
    assert drag.refuted
    assert "u" in drag.against
    # The estimate is linear: a fifth of the change.
    assert drag.factor == pytest.approx(factor, abs=0.2)


def test_where_a_vehicle_diverges_within_a_window_nothing_is_explained_and_no_warning_appears() -> None:
    known = fitted()
    cut = pieces(restarts(known.vehicle, log(2).trial, stop_s=60.0))[1]
    groups = [group.names for group in coefficient_groups(known.vehicle)]
    offsets = offsets_of("typical", known.vehicle)
    unknowns = Unknowns(known, cut, groups, sensor_noise(cut.trial), offsets, water=False)
    far = Point(unknowns.measured.start + 1e160, unknowns.measured.shared)
    with np.errstate(all="raise"):
        point, products = explained_best(unknowns, [0, 5], far)
    assert point is far
    assert not np.isfinite(products).all()


def test_the_noise_of_the_sensors_knows_nothing_of_the_model() -> None:
    """A typical Doppler log has 8 mm/s of noise, an attitude reference 0.05 deg, however the vehicle errs."""
    for changes in ((), scaled(PITCH, 4.0)):
        noise = sensor_noise(log(2, changes).trial)
        # Samples interpolated between two pings are alike, and the smoother follows a part of their noise.
        assert noise[:3] == pytest.approx(0.008, rel=0.3)
        assert noise[9:] == pytest.approx(np.radians(0.05), rel=0.25)


def test_a_log_of_a_few_windows_has_no_power() -> None:
    short = power(stop_s=11.0)
    assert short.tests == ()
    assert short.unjudged == "XZMN"


def test_no_window_begins_while_what_the_actuators_did_before_the_log_still_counts() -> None:
    deep = replace(log(2).trial, surface=None)
    whole, cut, first = pieces(restarts(fitted().vehicle, deep))
    assert [cut.spans[k][0] for k in first] == [start for start, _ in whole.spans]
    assert deep.t[whole.spans[0][0]] - deep.t[0] == pytest.approx(2.0)
    assert min(start for start, _ in cut.spans) == whole.spans[0][0]
    later = restarts(fitted().vehicle, deep, start_s=float(deep.t[0]) + 20.0)
    assert pieces(later)[0].spans[0] == later.spans[0]


def test_damping_of_a_slow_mode_shows_in_whole_windows() -> None:
    """A quarter of the pitch damping is within the noise for two seconds, and beyond it in ten."""
    damping = group("cwolf", "M", "damping")
    values = st.Vehicle.load("cwolf").coefficients()
    state, _, weaker = judged("cwolf", {name: 0.25 * values[name] for name in damping.names}, SEED)
    assert state == "re-identify"
    assert weaker.grown["pitch"] > SETTINGS.grown
    assert damping in [test.group for test in weaker.refuted]


def test_an_error_that_grows_within_a_window_is_no_noise_however_large_that_is() -> None:
    grown = replace(power(), left={"q": 1.2, "u": 0.6}, grown={"q": 1.0, "u": 1.6})
    assert grown.unexplained == ("u",)
    assert grown.doubts("u")
    assert not grown.doubts("q")


def test_a_reference_on_which_the_model_is_wrong_does_not_make_it_valid() -> None:
    """The band that such a reference leaves holds the same errors on the log: the groups refute it."""
    wrong = scaled(PITCH, 0.25)
    verdict = verify_log(
        fitted(), log(2, wrong), reference=log(100, wrong).trial, settings=st.LogSettings(draws=1200)
    )
    assert not verdict.valid, verdict.summary()
    assert verdict.outcome in ("failed", "not judged")
    assert verdict.power is not None
    assert "M" in {test.group.axis for test in verdict.power.refuted}


def test_an_axis_that_never_moves_is_not_judged_and_no_build_passes_by_it() -> None:
    """Straight ahead at one depth and speed: nothing is told of yaw."""
    moving = power()
    still = tuple(
        replace(test, by_channel={name: Shown(None, None) for name in test.by_channel})
        if test.group.axis == "N"
        else test
        for test in moving.tests
    )
    assert replace(moving, tests=still).unjudged == "N"
    verdict = verify_log(fitted(), log(2), settings=st.LogSettings(stop_s=30.0, draws=1200))
    assert verdict.outcome == "not judged"
    assert not verdict.held
    assert verdict.to_dict()["outcome"] == "not judged"
    root = ElementTree.fromstring(verdict.junit().encode())
    assert root.get("errors") == "1"
    assert [error.get("type") for error in root.iter("error")] == ["not judged"]


def test_data_of_the_power_state_factors_for_every_channel_and_group() -> None:
    data = power().to_dict()
    assert data["controlled_axes"] == ["X", "Z", "M", "N"]
    assert data["unjudged_axes"] == []
    drag = next(part for part in data["groups"] if (part["axis"], part["kind"]) == ("X", "damping"))
    assert drag["coefficients"] == ["X_u", "X_uu"]
    assert set(drag["shown"]) == set(data["left"])
    assert (
        1.0 / SETTINGS.shown <= drag["shown"]["u"]["down"] < 1.0 < drag["shown"]["u"]["up"] <= SETTINGS.shown
    )


def test_a_stated_error_widens_what_is_tolerated_and_takes_the_power() -> None:
    known = fitted()
    windows = restarts(known.vehicle, log(2).trial)
    stated = group_power(
        known,
        windows,
        offsets=offsets_of("typical", known.vehicle),
        level=0.01,
        stated={"u": 1.0, "r": 1.0},
        water=False,
    )
    assert set(stated.left) == {"u", "r"}
    assert stated.unjudged == "XZMN"


def test_without_any_channel_that_counts_nothing_is_judged() -> None:
    windows = restarts(fitted().vehicle, log(2).trial)
    judgement = judge_model(
        Fitted.of("cwolf"), windows, None, LogSettings(draws=1200, level=0.01), offsets={}, hidden="XYZKMN"
    )
    assert judgement.model == "not judged"


NEAR = (0.5, 2.0)
"""Factors that come nearest to a valid model; the table of docs/validation.md has 1/4 and 4, too."""

FAST = (
    ("cwolf", "M", "lift and couplings", 0.5),
    ("remus100", "N", "damping", 2.0),
    ("bluerov2-heavy", "K", "added mass", 2.0),
)


def group(name: str, axis: str, kind: str) -> CoefficientGroup:
    groups = coefficient_groups(st.Vehicle.load(name), actuators=False)
    return next(part for part in groups if (part.axis, part.kind) == (axis, kind))


@pytest.mark.parametrize(("name", "axis", "kind", "factor"), FAST)
def test_law_a_group_off_by_two_is_not_called_valid(name: str, axis: str, kind: str, factor: float) -> None:
    assert changed(name, group(name, axis, kind), factor) != "model still valid"


@pytest.mark.long
@pytest.mark.parametrize("name", VEHICLES)
@pytest.mark.parametrize("factor", NEAR)
def test_law_no_model_is_valid_that_misses_by_more_than_noise(name: str, factor: float) -> None:
    """Every group halved and doubled: what is called valid errs no more than the vehicle itself."""
    for judgement in law(name, SEED, (factor,)):
        print(judgement.row)
        # The vehicle's own errors over ten seconds are what the noise does; half as much again is seen.
        assert judgement.state != "model still valid" or judgement.excess <= 1.5, judgement.row


@pytest.mark.long
@pytest.mark.parametrize("name", VEHICLES)
def test_law_the_true_model_is_valid_in_nineteen_of_twenty_logs_with_power(name: str) -> None:
    verdicts = [judged(name, {}, seed) for seed in range(1, 21)]
    able = [(state, reason) for state, reason, power in verdicts if not power.unjudged]
    refused = [reason for state, reason in able if state != "model still valid"]
    assert len(able) >= 15
    assert len(refused) <= len(able) // 20, refused
