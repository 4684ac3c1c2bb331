"""Pulses of the motors beside those of ArduSub's mixer, and sticks beside the demands in MANUAL.

The mixer's inputs are in the log: roll, pitch, yaw and throttle in every mode; forward and lateral are the
pilot's sticks, or follow from the acceleration wanted where the mode controls the place. Frame and
directions of the motors are those of the log's or the file's parameters; without them the frame is the one
that explains most motors, so that a motor that does not follow it stands out. Held by
``tests/ardusub/test_motors.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from seatrial._core import ardusub_forward_lateral, ardusub_frames, ardusub_pulses
from seatrial.ardusub.comparison import CONTROLS, LIMITS, Comparison, Found, Quantity, Rows
from seatrial.ardusub.comparison import SETTINGS as COMPARED
from seatrial.base.arrays import Array

_OUTPUTS = 14  # columns of RCOU
_MOTORS = 8  # of the largest frame that ArduSub mixes

_EXPLAINED_US = (
    1.5 * LIMITS["pulse"]
)  # of four rows in five: demands and pulses are logged in different periods


@dataclass(frozen=True)
class MotorReplaySettings:
    """How close pulses and sticks must come to their replay."""

    judged_percentile: float = 80.0  #: Percentile of the misses that is judged: four rows in five.
    #: Share of all a motor has up to which no limit acts on the sum of its demands.
    unlimited_share: float = 0.95
    stick_rounding: float = 0.0026  #: Rounding of a stick's deflection: a microsecond of 400.
    #: Time between a row of sticks and the demand that comes of it, s: a period of the log.
    stick_late_s: float = 0.1
    pilot_deflection: float = 0.02  #: Deflection of a stick from which the pilot takes over in POSHOLD.


SETTINGS = MotorReplaySettings()

_CHANNELS = {"roll": 2, "pitch": 1, "throttle": 3, "yaw": 4, "forward": 5, "lateral": 6}
"""Channel of each stick; ``RCMAP_*`` where it is set."""

_NEUTRAL = 1500.0  # us


@dataclass(frozen=True, eq=False)
class _Drive:
    """Demands and pulses of a log."""

    t: Array  #: (n,), s.
    #: (n, 6): roll, pitch, yaw, throttle (-1 to 1), forward and lateral; the last two are not a number where
    #: the log does not have them.
    demands: Array
    pulses: Array  #: (n, outputs), us.
    outputs: tuple[int, ...]  #: Index of the output of each motor.

    def rows(self, which: Any) -> _Drive:
        """Some rows."""
        return replace(self, t=self.t[which], demands=self.demands[which], pulses=self.pulses[which])

    def own(self, count: int) -> Array:
        """Pulses (n, count) of the first motors, -1 to 1; no pulse is not a number."""
        pulses = np.full((len(self.t), count), np.nan)
        for k, output in enumerate(self.outputs[:count]):
            if output < self.pulses.shape[1]:
                pulses[:, k] = self.pulses[:, output]
        # Pulses are whole microseconds, rounded down.
        return np.where(pulses > 0.0, (pulses + 0.5 - _NEUTRAL) / 400.0, np.nan)


@dataclass(frozen=True, eq=False)
class _Fit:
    """A frame beside pulses."""

    name: str
    direction: tuple[float, ...]  #: Of each motor, 1 or -1.
    explained: tuple[bool, ...]  #: Which motors the frame explains.
    evidence: int  #: How many more pulses are explained than demands were solved from them.
    outputs: tuple[int, ...]  #: Index of the output of each motor.


def replay_motors(
    work: Comparison, plane_demand: tuple[Array, Array] | None
) -> tuple[str, tuple[int, ...]] | None:
    """Frame and directions of a log, after its pulses were compared; None where no frame explains them."""
    rates = work.read("RATE", "ROut", "POut", "YOut", "AOut")
    have = work.log.fields.get("RCOU", {})
    names = [f"C{k}" for k in range(1, _OUTPUTS + 1) if f"C{k}" in have]
    outputs = work.topic("RCOU", *(names or ["C1"]), checks=(("mixer", "pulses of the motors"),))
    if rates is None or outputs is None:
        return None
    at, near = outputs.at(rates.t)
    near &= ~work.modes.disarmed(rates.t) & (work.modes.name_at(rates.t) != "MOTOR_DETECT")
    if near.sum() < COMPARED.fewest_rows:
        work.cannot("mixer", "pulses of the motors", "too few rows of demands with pulses, armed")
        return None
    # Throttle runs from 0 to 1 in the log, from -1 to 1 at the mixer.
    t = rates.t[near]
    known = [rates[name][near] for name in ("ROut", "POut", "YOut")] + [2.0 * rates["AOut"][near] - 1.0]
    pulses = np.stack([outputs[name][at[near]] for name in names], 1)
    plane, lean, in_place = _plane(work, t, plane_demand)
    drive = _Drive(t, np.concatenate([np.stack(known, 1), plane], 1), pulses, _outputs(work.known))
    # All outputs at rest, as of a vehicle that is disarmed, tell no frame; they are judged like all rows.
    active = (pulses[:, :_MOTORS] != _NEUTRAL).any(axis=1)
    fit = _frame(drive.rows(active) if active.sum() >= COMPARED.fewest_rows else drive, work.known)
    if fit is None:
        why = "no frame of ArduSub explains the pulses; FRAME_CONFIG may be custom"
        work.notes.append(f"Motors: {why}.")
        moved = [k for k in range(min(_MOTORS, len(names))) if np.ptp(pulses[:, k]) > 0.0]
        for k in moved or [0]:
            work.cannot("mixer", f"output {names[k][1:]}", why)
        return None
    drive = _with_lean(work, drive, fit, lean, in_place)
    _compare(work, drive, fit)
    return fit.name, tuple(int(sign) for sign in fit.direction)


def _outputs(known: Mapping[str, float]) -> tuple[int, ...]:
    """Index of the output of each motor: ``SERVOn_FUNCTION`` 33 to 40, else in order."""
    mapped = {known.get(f"SERVO{n}_FUNCTION"): n - 1 for n in range(_OUTPUTS, 0, -1)}
    if not any(33.0 + k in mapped for k in range(_MOTORS)):
        return tuple(range(_MOTORS))
    # A motor without an output of its own has none.
    return tuple(mapped.get(33.0 + k, _OUTPUTS) for k in range(_MOTORS))


def _sticks(work: Comparison, *names: str, checks: tuple[tuple[str, str], ...] = ()) -> Rows | None:
    """Sticks by name, -1 to 1 (throttle 0 to 1)."""
    channel = {name: round(work.known.get(f"RCMAP_{name.upper()}", _CHANNELS[name])) for name in names}
    rows = work.topic("RCIN", *(f"C{channel[name]}" for name in names), checks=checks)
    if rows is None:
        return None
    values = {}
    for name in names:
        n = channel[name]
        low, middle, high = (
            work.known.get(f"RC{n}_{end}", usual)
            for end, usual in (("MIN", 1100.0), ("TRIM", _NEUTRAL), ("MAX", 1900.0))
        )
        pulse = rows[f"C{n}"]
        if name == "throttle":
            values[name] = np.clip((pulse - low) / (high - low), 0.0, 1.0)
            continue
        span = np.where(pulse < middle, middle - low, high - middle)
        sign = -1.0 if work.known.get(f"RC{n}_REVERSED", 0.0) > 0.5 else 1.0
        values[name] = sign * np.clip((pulse - middle) / np.maximum(span, 1.0), -1.0, 1.0)
    return Rows(rows.t, values)


def replay_sticks(work: Comparison) -> None:
    """Demands beside the sticks in MANUAL, where they pass through."""
    if not work.owes("sticks"):
        return
    names = {"roll": "ROut", "pitch": "POut", "yaw": "YOut", "throttle": "AOut"}
    checks = tuple(("sticks in MANUAL", name) for name in names)
    sticks = _sticks(work, *names, checks=checks)
    rates = work.read("RATE", *names.values())
    if sticks is None or rates is None:
        return
    at, near = sticks.at(rates.t, SETTINGS.stick_late_s)
    near &= work.modes.controls(rates.t, "sticks")
    t, rows = rates.t[near], at[near]
    for check, (name, column) in zip(checks, names.items(), strict=True):
        logged, stick = rates[column][near], sticks[name][rows]
        # ACRO_YAW_P scales the stick of yaw.
        moved = np.abs(stick) > 10.0 * SETTINGS.stick_rounding
        factor = float(np.median(logged[moved] / stick[moved])) if name == "yaw" and moved.any() else 1.0
        why = "demand and stick differ in a mode in which sticks pass through"
        work.add(check, "1", t, logged, factor * stick, limit=SETTINGS.stick_rounding, why=why)
        if work.quantities[-1].holds:
            work.quantities[-1] = replace(work.quantities[-1], why="")


def _plane(work: Comparison, t: Array, demand: tuple[Array, Array] | None) -> tuple[Array, Array, Any]:
    """Forward and lateral demand (n, 2), the lean angles (n, 2, rad) behind it, and where these count."""
    demanded, angles = np.full((len(t), 2), np.nan), np.full((len(t), 2), np.nan)
    checks = (("mixer", "forward and lateral"),)
    sticks = _sticks(work, "forward", "lateral", checks=checks)
    in_place = work.modes.controls(t, "place")
    deflected = np.zeros(len(t), bool)
    if sticks is not None:
        at, near = sticks.at(t, SETTINGS.stick_late_s)
        pilot = np.stack([sticks["forward"][at], sticks["lateral"][at]], 1)
        demanded[near] = pilot[near]
        deflected = near & (np.abs(pilot) > SETTINGS.pilot_deflection).any(axis=1)
    in_place &= ~((work.modes.name_at(t) == "POSHOLD") & deflected)
    # In a mode that is not known rows of the position controller say that it worked.
    unknown = ~np.isin(work.modes.name_at(t), list(CONTROLS))
    for topic in ("PSCN", "PSCE"):
        if unknown.any() and (rows := work.read(topic)) is not None:
            in_place |= unknown & rows.at(t)[1]
    # There the sticks move the target: the demands follow from the acceleration wanted.
    demanded[in_place] = np.nan
    yaw = np.full(len(t), np.nan)
    for topic in ("ATT", "ANG"):
        if (heading := work.read(topic, "Yaw")) is not None and len(heading.t) > 1:
            near = heading.at(t, SETTINGS.stick_late_s)[1]
            yaw[near] = np.radians(np.interp(t, heading.t, np.unwrap(heading["Yaw"], period=360.0)))[near]
    if demand is None or len(demand[0]) < COMPARED.fewest_rows:
        return demanded, angles, np.zeros(len(t), bool)
    at, near = Rows(demand[0], {}).at(t)
    counts = near & in_place & np.isfinite(yaw)
    right = 0.5 * math.pi
    angles[counts] = right * np.asarray(ardusub_forward_lateral(demand[1][at[counts]], yaw[counts], right))
    limit = math.radians(work.known.get("ATC_ANGLE_MAX", 45.0))
    demanded[counts] = np.clip(angles[counts], -limit, limit) / limit
    return demanded, angles, counts


def _with_lean(work: Comparison, drive: _Drive, fit: _Fit, angles: Array, counts: Any) -> _Drive:
    """The drive with forward and lateral by the largest lean angle that the pulses tell, which is kept."""
    shares = np.asarray(ardusub_frames()[fit.name])
    own = replace(drive, outputs=fit.outputs).own(len(shares)) * np.asarray(fit.direction)
    use = shares[:, 4:].any(axis=1) & np.asarray(fit.explained)
    if not counts.any() or np.linalg.matrix_rank(shares[use, 4:]) < 2:
        return drive
    left = own[:, use] - drive.demands[:, :4] @ shares[use, :4].T
    sound = (
        counts & np.isfinite(left).all(axis=1) & (np.abs(own[:, use]) < SETTINGS.unlimited_share).all(axis=1)
    )
    solved = np.full_like(angles, np.nan)
    solved[sound] = np.linalg.lstsq(shares[use, 4:], left[sound].T, rcond=None)[0].T
    strong = (
        sound[:, None]
        & (np.abs(solved) > 20.0 * SETTINGS.stick_rounding)
        & (np.abs(solved) < SETTINGS.unlimited_share)
    )
    if strong.sum() < COMPARED.fewest_rows:
        return drive
    ratio = angles[strong] / solved[strong]
    limit = float(np.median(ratio))
    if not 0.0 < limit < 0.5 * math.pi:
        return drive
    sd = 1.4826 * float(np.median(np.abs(ratio - limit))) / math.sqrt(len(ratio))
    # Pulses are rounded down and demands logged in another period: no better than a thousandth.
    sd = max(sd, 1e-3 * limit)
    degrees = math.degrees(limit), math.degrees(sd)
    how = "forward and lateral over the acceleration wanted, deg"
    work.keep(Found("ATC_ANGLE_MAX", *degrees, how))
    # The parameter is a whole number of degrees on most vehicles: within its deviation the nearest one
    # counts.
    own_limit = work.known.get("ATC_ANGLE_MAX", round(degrees[0]))
    if abs(own_limit - degrees[0]) <= max(3.0 * degrees[1], 0.01 * degrees[0]):
        limit = math.radians(own_limit)
    demands = drive.demands.copy()
    demands[counts, 4:] = np.clip(angles[counts], -limit, limit) / limit
    return replace(drive, demands=demands)


def _frame(drive: _Drive, known: Mapping[str, float]) -> _Fit | None:
    """Frame of the parameters, else the one that explains most motors, and more than half, if any."""
    frames = {name: np.asarray(motors) for name, motors in ardusub_frames().items()}
    order = ("BlueROV1", "Vectored", "Vectored_6DOF", "Vectored_6DOF_90", "SimpleROV-3", "SimpleROV-4",
             "SimpleROV-5")  # fmt: skip
    stated = known.get("FRAME_CONFIG", -1.0)
    if stated in range(len(order)):
        name = order[int(stated)]
        fit = max(_fits(drive, name, frames[name], known), key=lambda each: each.evidence)
        return fit if sum(fit.explained) else replace(fit, direction=_given(known, fit.direction))
    every = [fit for name, shares in frames.items() for fit in _fits(drive, name, shares, known)]
    best = max(every, key=lambda each: (each.evidence, -len(each.explained)))
    if best.evidence < 2 or 2 * sum(best.explained) <= len(best.explained):
        return _exchanged(drive, frames)
    exchanged = _exchanged(drive, frames)
    # Symmetric motors swap places under demands that move them alike: two more must be explained.
    better = exchanged is not None and sum(exchanged.explained) >= sum(best.explained) + 2
    return exchanged if better else best


def _given(known: Mapping[str, float], direction: Sequence[float]) -> tuple[float, ...]:
    """``MOT_n_DIRECTION`` where it is known."""
    return tuple(known.get(f"MOT_{k}_DIRECTION", sign) for k, sign in enumerate(direction, 1))


def _fits(drive: _Drive, name: str, shares: Array, known: Mapping[str, float]) -> list[_Fit]:
    """A frame beside the pulses in order.

    With the demands as logged, and with forward and lateral solved from the pulses of all horizontal motors,
    or of all but one.
    """
    count = len(shares)
    own, wanted = drive.own(count), drive.demands @ shares.T
    given = _given(known, (0.0,) * count)
    # Motors without a horizontal share obey the first four demands alone.
    alone = ~shares[:, 4:].any(axis=1)
    wanted[:, alone] = drive.demands[:, :4] @ shares[alone, :4].T
    sign, miss = _signed(own, wanted, given)
    direct = miss <= _EXPLAINED_US
    outputs = drive.outputs[:count]
    fits = [_Fit(name, sign, tuple(direct.tolist()), int(direct.sum()), outputs)]
    # Unlogged stick demands are solved for, each time without one motor, which may be the odd one out.
    horizontal = np.flatnonzero(~alone)
    base = drive.demands[:, :4] @ shares[:, :4].T
    turning = np.array(_signed(own, base, given)[0])
    turning[alone] = np.array(sign)[alone]
    for left_out in (None, *horizontal.tolist()):
        use = [k for k in horizontal if k != left_out]
        rank = int(np.linalg.matrix_rank(shares[use, 4:])) if use else 0
        left = own * turning - base
        sound = np.isfinite(left[:, use]).all(axis=1) if use else np.zeros(len(left), bool)
        # As many motors as demands would explain any pulses.
        if len(use) <= rank or sound.sum() < COMPARED.fewest_rows:
            continue
        drawn = np.linalg.lstsq(shares[use, 4:], left[sound][:, use].T, rcond=None)[0].T
        _, miss = _signed(own[sound], base[sound] + drawn @ shares[:, 4:].T, tuple(turning.tolist()))
        explained = miss <= _EXPLAINED_US
        explained[alone] = direct[alone]
        fits.append(
            _Fit(
                name, tuple(turning.tolist()), tuple(explained.tolist()), int(explained.sum()) - rank, outputs
            )
        )
    return fits


def _signed(own: Array, wanted: Array, given: Sequence[float]) -> tuple[tuple[float, ...], Array]:
    """Direction of each motor (that which is given, else the one that fits better), and what is left, us."""
    signs, misses = [], []
    for k, stated in enumerate(given):
        rows = (
            np.isfinite(own[:, k])
            & np.isfinite(wanted[:, k])
            & (np.abs(wanted[:, k]) < SETTINGS.unlimited_share)
        )
        left = {
            sign: float(
                np.percentile(np.abs(own[rows, k] - sign * wanted[rows, k]), SETTINGS.judged_percentile)
            )
            for sign in ((stated,) if stated else (1.0, -1.0))
            if rows.sum() >= COMPARED.fewest_rows
        }
        sign = min(left, key=lambda each: left[each], default=stated or 1.0)
        signs.append(sign)
        misses.append(400.0 * left.get(sign, math.inf))
    return tuple(signs), np.array(misses)


def _exchanged(drive: _Drive, frames: Mapping[str, Array]) -> _Fit | None:
    """Frame with outputs in another order that explains more than half of its motors, if any."""
    from scipy.optimize import linear_sum_assignment

    best: _Fit | None = None
    count = min(_MOTORS, drive.pulses.shape[1])
    every = replace(drive, outputs=tuple(range(count))).own(count)
    for name, shares in frames.items():
        if len(shares) > count:
            continue
        wanted = drive.demands @ shares.T
        alone = ~shares[:, 4:].any(axis=1)
        wanted[:, alone] = drive.demands[:, :4] @ shares[alone, :4].T
        cost = np.full((len(shares), count), 1e3)
        sign = np.ones((len(shares), count))
        for j in range(count):
            pulses = np.repeat(every[:, j : j + 1], len(shares), axis=1)
            signs, misses = _signed(pulses, wanted, (0.0,) * len(shares))
            cost[:, j], sign[:, j] = np.minimum(misses, 1e3), signs
        motors, outputs = linear_sum_assignment(np.log(cost + 0.5))
        explained = cost[motors, outputs] <= _EXPLAINED_US
        fit = _Fit(
            name, tuple(sign[motors, outputs].tolist()), tuple(explained.tolist()), int(explained.sum()),
            tuple(outputs.tolist()),
        )  # fmt: skip
        if 2 * fit.evidence > len(shares) and (best is None or fit.evidence > best.evidence):
            best = fit
    return best


def _compare(work: Comparison, drive: _Drive, fit: _Fit) -> None:
    """Keep the pulses of every motor at its output, and the directions that the pulses tell."""
    shares = np.asarray(ardusub_frames()[fit.name])
    finite = np.isfinite(drive.demands).all(axis=1)
    ends = [work.known.get(name, usual) for name, usual in (("MOT_PWM_MIN", 1100.0), ("MOT_PWM_MAX", 1900.0))]
    coupling = work.known.get("MOT_FV_CPLNG_K")
    demands = np.nan_to_num(drive.demands)
    replayed = np.asarray(
        ardusub_pulses(fit.name, demands, np.asarray(fit.direction), ends, coupling=coupling)
    )
    for k in range(len(shares)):
        motor, output = k + 1, drive.outputs[k]
        judged = np.ones(len(drive.t), bool) if not shares[k, 4:].any() else finite
        if output >= drive.pulses.shape[1]:
            work.cannot("mixer", f"motor {motor}", "no output of the log carries it")
            continue
        if not judged.any():
            work.cannot("mixer", f"motor {motor}", "the log has neither sticks nor demands of the plane")
            continue
        logged = drive.pulses[:, output]
        quantity = Quantity(
            "mixer", f"motor {motor}", "us", drive.t, logged, replayed[:, k], judged, LIMITS["pulse"],
            exact=True,
        )  # fmt: skip
        if not quantity.holds:
            quantity = replace(quantity, why=_cause(quantity, k, output, replayed))
        work.quantities.append(quantity)
        if quantity.holds and np.ptp(replayed[judged, k]) > LIMITS["pulse"]:
            how = "sign of its pulse under the demands"
            work.keep(Found(f"MOT_{motor}_DIRECTION", fit.direction[k], math.nan, how))


def _cause(quantity: Quantity, k: int, output: int, replayed: Array) -> str:
    """What a motor does instead of what the mixer asks for."""
    rows = quantity.judged
    logged, limit = quantity.logged[rows], LIMITS["pulse"]
    name = f"output {output + 1}"

    def follows(other: Array) -> bool:
        return bool(np.percentile(np.abs(logged - other[rows]), SETTINGS.judged_percentile) <= limit)

    if not (logged > 0.0).any():
        return f"{name} carries no pulse"
    if np.ptp(logged) <= 1.0:
        return f"{name} stays at {logged[0]:.0f} us"
    if follows(2.0 * _NEUTRAL - replayed[:, k]):
        return f"{name} pushes against the direction of motor {k + 1}"
    for other in range(replayed.shape[1]):
        if other != k and np.ptp(replayed[rows, other]) > limit and follows(replayed[:, other]):
            return f"{name} carries the pulses of motor {other + 1}"
    first, last = quantity.off
    stretch = logged[(quantity.t[rows] >= first) & (quantity.t[rows] <= last)]
    rests = f" and stays at {stretch[0]:.0f} us" if len(stretch) > 1 and np.ptp(stretch) <= 1.0 else ""
    return f"{name} is off longest from {first:.1f} to {last:.1f} s{rests}"
