"""Exact sensitivities of the open loop against central differences of its prediction, and its refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from seatrial import _core
from seatrial.base.channels import CHANNELS
from seatrial.base.errors import SimulationError
from tests.core.flights import DT, INITIALS, KINDS, NUISANCES, SUBSTEPS, Flights, vehicle

Array = NDArray[np.float64]

# Central differences over a millionth of each unknown's size: rounding 1e-15 and its growth in flight over
# 1e-6, relative to the largest derivative of the channel. Where a strip of the hull changes its side within
# the step the quotient is off by as much as the step: it is finer there.
STEP, QUOTIENT, FINE = 1e-6, 1e-7, 2e-7


def quotient(ahead: list[Array], back: list[Array], step: float) -> list[Array]:
    found = []
    for a, b in zip(ahead, back, strict=True):
        change = a - b
        # What the instruments show of an angle jumps at half a turn.
        change[:, 9:] = (change[:, 9:] + np.pi) % (2.0 * np.pi) - np.pi
        found.append(change / (2.0 * step))
    return found


def close(found: Array, expected: Array, what: str) -> None:
    size = np.maximum(1.0, np.abs(expected).max(axis=0))
    np.testing.assert_allclose(found / size, expected / size, rtol=0.0, atol=QUOTIENT, err_msg=what)


@pytest.mark.parametrize("name", list(KINDS))
def test_scalar_sensitivities_to_coefficients_are_quotients(name: str) -> None:
    flights = Flights(name)
    found = flights.sensitivities()
    for j, coefficient in enumerate(flights.names):
        step = np.zeros(len(flights.names))
        step[j] = FINE * flights.size[j]
        ahead = flights.predict(values=flights.values + step)
        back = flights.predict(values=flights.values - step)
        exact = [jacobian[:, :, j] * flights.size[j] for _, jacobian in found]
        expected = quotient(ahead, back, FINE)
        for s in range(3):
            close(exact[s], expected[s], f"{coefficient}, segment {s}")
        assert any(np.abs(x).max() > 0.0 for x in expected), f"{coefficient} is not at work"


@pytest.mark.parametrize("name", list(KINDS))
def test_scalar_sensitivities_to_nuisances_are_quotients(name: str) -> None:
    flights = Flights(name)
    found = flights.sensitivities(nuisances=NUISANCES, directions=np.zeros((0, len(flights.names))))
    for j, nuisance in enumerate(NUISANCES):
        step = np.zeros_like(flights.nuisance)
        step[:, j] = STEP
        ahead = flights.predict(nuisance=flights.nuisance + step)
        back = flights.predict(nuisance=flights.nuisance - step)
        for s, expected in enumerate(quotient(ahead, back, STEP)):
            close(found[s][1][:, :, j], expected, f"{nuisance}, segment {s}")


@pytest.mark.parametrize("name", list(KINDS))
def test_scalar_sensitivities_to_initial_conditions_are_quotients(name: str) -> None:
    flights = Flights(name)
    found = flights.sensitivities(initials=INITIALS, directions=np.zeros((0, len(flights.names))))
    for j, initial in enumerate(INITIALS):
        step = np.zeros_like(flights.initial)
        step[:, j] = STEP
        ahead = flights.predict(initial=flights.initial + step)
        back = flights.predict(initial=flights.initial - step)
        for s, expected in enumerate(quotient(ahead, back, STEP)):
            close(found[s][1][:, :, j], expected, f"{initial}, segment {s}")


@pytest.mark.parametrize(("free", "measured"), [("XZN", ""), ("XYN", "ZKM"), ("M", "XYZKN")])
def test_scalar_sensitivities_of_frozen_and_measured_axes_are_quotients(free: str, measured: str) -> None:
    v, n = vehicle("cwolf"), 41
    t = np.arange(n) * DT
    halves = np.arange(2 * SUBSTEPS * (n - 1) + 1) * 0.5 * DT / SUBSTEPS
    phase = np.arange(6)
    nu, nu_rate = 0.3 * np.sin(halves[:, None] + phase), 0.3 * np.cos(halves[:, None] + phase)
    record = _core.Record(t, {"SbU": np.full(n, 900.0)}, nu=nu, nu_rate=nu_rate)
    start = (0, 3, n, np.zeros(3), np.array([0.1, 0.2, 0.3]), np.array([0.5, 0.1, 0.1, 0.1, 0.1, 0.1]))
    names = ["X_uu", "M_q", "z_b", "M_qdot", "SbU.gain"]
    loop = _core.OpenLoop(v, [record], [start], names=names, free=free, measured=measured, substeps=SUBSTEPS)
    values = np.array([v.coefficients()[n] for n in names])
    ((shown, jacobian),) = loop.sensitivities(values)
    for j, name in enumerate(names):
        step = np.where(np.arange(len(names)) == j, STEP * np.abs(values[j]), 0.0)
        (expected,) = quotient(loop.predict(values + step), loop.predict(values - step), STEP)
        close(jacobian[:, :, j] * abs(values[j]), expected, name)
    # A replayed velocity is the log's: nothing changes it. Its record begins at sample 3.
    replayed = ["XYZKMN".index(axis) for axis in measured]
    np.testing.assert_array_equal(jacobian[:, replayed], 0.0)
    np.testing.assert_array_equal(shown[:, replayed], nu[:: 2 * SUBSTEPS][3:, replayed])


@pytest.mark.parametrize("loss", ["absolute", "squared", "huber"])
def test_scalar_the_gradient_is_that_of_the_criterion(loss: str) -> None:
    flights = Flights("cwolf", loss=loss, knee=0.4)
    given: dict[str, Any] = {"nuisance": flights.nuisance, "initial": flights.initial}
    _, gradient = flights.loop.gradient(flights.values, nuisances=NUISANCES, initials=INITIALS, **given)
    assert gradient.shape == (3, 12, len(flights.names) + len(NUISANCES) + len(INITIALS))

    def criterion(values: Array, **moved: Array) -> Array:
        return flights.loop.gradient(values, **(given | moved))[0]

    unit = np.zeros(len(NUISANCES))
    unit[NUISANCES.index("current_north")] = STEP
    moved = [criterion(flights.values, nuisance=flights.nuisance + side * unit) for side in (1.0, -1.0)]
    column = len(flights.names) + NUISANCES.index("current_north")
    # Sums of 30 samples as above; no residual changes its sign or passes the knee within the step.
    np.testing.assert_allclose(
        gradient[:, :, column], (moved[0] - moved[1]) / (2.0 * STEP), rtol=1e-6, atol=1e-6
    )
    step = STEP * flights.size * np.eye(len(flights.names))
    for j in range(len(flights.names)):
        ahead, back = (criterion(flights.values + side * step[j]) for side in (1.0, -1.0))
        expected = (ahead - back) / (2.0 * STEP)
        np.testing.assert_allclose(gradient[:, :, j] * flights.size[j], expected, rtol=1e-6, atol=1e-6)


def test_scalar_the_criterion_without_nuisances_is_that_of_the_candidates() -> None:
    flights = Flights("cwolf", loss="huber", knee=0.3)
    sums, _ = flights.loop.gradient(flights.values)
    # Lanes against plain numbers: rounding over 80 steps.
    np.testing.assert_allclose(sums, flights.loop.errors(flights.values[None])[0], rtol=1e-10, atol=1e-12)


def test_scalar_an_unknown_alone_has_the_column_that_it_has_among_others() -> None:
    flights = Flights("every_term")
    names, some = flights.names, ["bias_u", "latency_z", "current_east"]
    together = flights.sensitivities(nuisances=NUISANCES, initials=INITIALS)
    direction = np.linspace(-1.0, 1.0, len(names))
    channels = ["z", "u", "yaw"]
    found = flights.sensitivities(
        directions=direction[None], nuisances=some, initials=["initial_roll"], channels=channels
    )
    among = [len(names) + NUISANCES.index(n) for n in some]
    among.append(len(names) + len(NUISANCES) + INITIALS.index("initial_roll"))
    asked = [CHANNELS.index(c) for c in channels]
    for (shown, jacobian), (all_shown, everything) in zip(found, together, strict=True):
        assert jacobian.shape == (len(shown), 3, 5)
        np.testing.assert_array_equal(shown, all_shown)
        # Lanes do not see each other.
        np.testing.assert_array_equal(jacobian[:, :, 1:], everything[:, asked][:, :, among])
        along = everything[:, asked, : len(names)] @ direction
        # Two orders of a sum over the coefficients.
        np.testing.assert_allclose(jacobian[:, :, 0], along, atol=1e-11 * np.abs(along).max())


def test_scalar_results_do_not_depend_on_threads() -> None:
    flights = Flights("every_term")
    one, two = (flights.sensitivities(nuisances=NUISANCES, threads=n) for n in (1, 2))
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a[0], b[0])
        np.testing.assert_array_equal(a[1], b[1])


def test_what_is_shown_is_the_prediction_and_by_default_undisturbed() -> None:
    flights = Flights("cwolf")
    for (shown, _), predicted in zip(flights.sensitivities(), flights.predict(), strict=True):
        np.testing.assert_array_equal(shown, predicted)
    zero = flights.predict(nuisance=np.zeros((2, 38)), initial=np.zeros((3, 12)))
    for given, default in zip(zero, flights.loop.predict(flights.values), strict=True):
        np.testing.assert_array_equal(given, default)


def test_tangents_are_the_sensitivities_in_a_row() -> None:
    flights = Flights("cwolf")
    shown, slopes = flights.loop.tangents(
        flights.values,
        nuisances=NUISANCES[:3],
        initials=INITIALS[:2],
        channels=["u", "yaw"],
        nuisance=flights.nuisance,
        initial=flights.initial,
    )
    apart = flights.sensitivities(nuisances=NUISANCES[:3], initials=INITIALS[:2], channels=["u", "yaw"])
    np.testing.assert_array_equal(shown, np.concatenate([one for one, _ in apart]))
    np.testing.assert_array_equal(slopes, np.concatenate([one for _, one in apart]))


def test_segments_along_another_motion_are_those_that_start_there() -> None:
    flights = Flights("cwolf")
    draw, values = np.random.default_rng(4), flights.values
    place = np.tile([1.0, -2.0, 3.0], (3, 1))
    attitude = np.tile([0.1, -0.2, 0.3], (3, 1))
    nu = np.tile([0.7, 0.1, -0.1, 0.1, 0.2, -0.2], (3, 1))
    aside, faster = 0.1 * draw.uniform(size=(3, 3)), 0.1 * draw.uniform(size=(3, 6))
    current = 0.2 * draw.uniform(size=(3, 3))
    begun = flights.loop.along(place, attitude, nu, current)
    # A start beside another one is that one with initial conditions.
    beside = flights.loop.along(place + aside, attitude, nu + faster, current).predict(values)
    initial = np.hstack([aside, np.zeros((3, 3)), faster])
    for one, other in zip(beside, begun.predict(values, initial=initial), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-10)
    turned = flights.loop.along(place, attitude + 0.1, nu, current).predict(values)
    for one, other in zip(turned, begun.predict(values), strict=True):
        np.testing.assert_allclose(one[0, 9:] - other[0, 9:], 0.1, atol=1e-9)
    # The currents are those of the segments, besides those of the records.
    steady, nuisance = np.tile([0.1, 0.0, 0.0], (3, 1)), np.zeros((2, 38))
    nuisance[:, NUISANCES.index("current_north")] = 0.1
    flowing = flights.loop.along(place, attitude, nu, steady).predict(values)
    moved = flights.loop.along(place, attitude, nu, 0.0 * steady).predict(values, nuisance=nuisance)
    twice = flights.loop.along(place, attitude, nu, -steady).predict(values, nuisance=2.0 * nuisance)
    for one, other, third in zip(flowing, moved, twice, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-10)
        np.testing.assert_allclose(one, third, atol=1e-10)


@pytest.mark.parametrize(("place", "shape"), [(0, (2, 3)), (3, (2, 3))])
def test_starts_and_currents_that_do_not_fit_are_refused(place: int, shape: tuple[int, ...]) -> None:
    flights = Flights("cwolf")
    given = [np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 6)), np.zeros((3, 3))]
    given[place] = np.zeros(shape)
    position, attitude, nu, current = given
    with pytest.raises(SimulationError, match="expected 3 rows each"):
        flights.loop.along(position, attitude, nu, current)


def test_a_current_that_is_no_number_is_refused() -> None:
    flights = Flights("cwolf")
    with pytest.raises(SimulationError, match="current: expected finite numbers"):
        flights.loop.along(np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 6)), np.full((3, 3), np.nan))


def test_a_nuisance_belongs_to_its_record_and_an_initial_condition_to_its_segment() -> None:
    flights = Flights("cwolf")
    before = flights.predict()
    nuisance, initial = flights.nuisance.copy(), flights.initial.copy()
    nuisance[1, NUISANCES.index("bias_q")] += 0.1
    # Segments 0 and 1 are of record 0.
    changed = [
        not np.array_equal(a, b) for a, b in zip(flights.predict(nuisance=nuisance), before, strict=True)
    ]
    assert changed == [False, False, True]
    initial[1, INITIALS.index("initial_w")] += 0.1
    changed = [
        not np.array_equal(a, b) for a, b in zip(flights.predict(initial=initial), before, strict=True)
    ]
    assert changed == [False, True, False]


def test_nothing_unknown_has_no_columns() -> None:
    flights = Flights("cwolf", names=[])
    without = flights.loop.sensitivities([])
    alone = flights.loop.sensitivities([], initials=["initial_u"], channels=["u"])
    assert len(without) == len(alone) == 3
    for shown, jacobian in without:
        assert jacobian.shape == (len(shown), 12, 0)
    for shown, jacobian in alone:
        assert jacobian.shape == (len(shown), 1, 1)
        assert jacobian[0, 0, 0] == 1.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"nuisances": ["current_nort"]},
            'nuisances: expected .*, force_N, found "current_nort".*current_north',
        ),
        ({"initials": ["roll"]}, 'initials: expected initial_x, .*, initial_r, found "roll"'),
        ({"channels": ["pich"]}, 'channels: expected u, v, .*, yaw, found "pich".*did you mean "pitch"'),
        ({"directions": np.ones((2, 3))}, r"directions: expected shape \(k, 34\), found \[2, 3\]"),
        ({"nuisance": np.zeros((1, 38))}, "nuisance: expected 2 rows of 38, found 1"),
        ({"nuisance": np.zeros((2, 31))}, r"nuisance: expected shape \(n, 38\)"),
        ({"initial": np.zeros((2, 12))}, "initial: expected 3 rows of 12, found 2"),
        ({"values": np.zeros(3)}, "values: expected 34 numbers, found 3"),
        ({"values": np.zeros((1, 31))}, r"values: expected shape \(n,\)"),
    ],
)
def test_what_does_not_fit_is_named(options: dict[str, Any], message: str) -> None:
    flights = Flights("cwolf")
    values = options.pop("values", flights.values)
    with pytest.raises(SimulationError, match=message):
        flights.loop.sensitivities(values, **options)


def test_a_gradient_needs_measurements() -> None:
    v = vehicle("cwolf")
    start = (0, 0, 3, np.zeros(3), np.zeros(3), np.zeros(6))
    loop = _core.OpenLoop(v, [_core.Record([0.0, 0.1, 0.2])], [start], names=["m"])
    with pytest.raises(SimulationError, match="record 0: the criterion needs measured channels"):
        loop.gradient([v.coefficients()["m"]])
