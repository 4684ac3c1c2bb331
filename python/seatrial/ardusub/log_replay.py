"""Replay of ArduSub's controllers from a DataFlash log: what the law makes of the inputs, and what is logged.

A log has a row of every controller ten times a second; the controllers run 200 to 400 times. What a row needs
from itself alone (proportional and feed-forward terms, sums, limits, mixing) is computed row by row. What
remembers (integrator, filters) is fed with what the rows have, and says what is left. Gains that the log does
not carry are found from it: each is the one that fits best on the first half of the rows. The modes of the
log say which checks it owes; one that cannot be made counts as one that is not met.

Rows of the position controllers are those of firmware 4.7 and later, in metres; the names of parameters, too.
Held by ``tests/ardusub/test_replay.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seatrial._core import ardusub_rates, ardusub_terms, ardusub_velocity
from seatrial.ardusub.comparison import LIMITS, Comparison, Found, Replay, Rows
from seatrial.ardusub.motors import replay_motors, replay_sticks
from seatrial.ardusub.parameters import ParameterFile, generation, in_metres
from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError
from seatrial.base.run import run_facts, sha256
from seatrial.base.work import Clock
from seatrial.logs.log import open_log


def replay(log: str | Path, *, parameters: ParameterFile | None = None) -> Replay:
    """Replay of the controllers of a DataFlash log.

    Parameters
    ----------
    log : str or Path
        ``.BIN``, or its text.
    parameters : ParameterFile, optional
        The vehicle's own; those found are compared with them.

    Raises
    ------
    TrialError
        The log cannot be read, or has no rows of ArduSub's rate controllers; the parameters are not of one
        generation of firmware.
    """
    clock = Clock()
    if parameters is not None:
        generation(parameters.values, parameters.source)
    opened = open_log(log)
    missing = [name for name in ("RATE", "PIDR", "PIDP", "PIDY") if name not in opened.fields]
    if "RATE" in missing:
        raise _not_ardusub(log, missing)
    # What the user's file says outweighs what the log says of itself.
    known = in_metres(ParameterFile(str(log), opened.parameters))
    known.update({} if parameters is None else in_metres(parameters))
    work = Controllers(opened, known)
    # A dive in MANUAL alone has no rows of the rate controllers, and owes none.
    if len(missing) == 3 and (work.owes("attitude") or not work.owes("sticks")):
        raise _not_ardusub(log, missing)
    if work.owes("attitude") or not work.modes.names:
        work.angles()
        for axis in range(3):
            work.rate(axis)
    work.depth()
    work.plane()
    replay_sticks(work)
    frame = replay_motors(work, work.plane_demand)
    if not work.quantities:
        reason = work.impossible[0].why if work.impossible else work.notes[0] if work.notes else "no rows"
        raise TrialError(f"{log}: no controller could be replayed: {reason}")
    inputs = {Path(log).name: sha256(Path(log).read_bytes())}
    if parameters is not None:
        inputs[parameters.source] = sha256(repr(sorted(parameters.values.items())))
    return Replay(
        str(log), tuple(work.quantities), tuple(work.impossible), tuple(work.found), frame,
        tuple(dict.fromkeys(work.notes)), run_facts("replay", Path(log).stem, clock=clock, inputs=inputs),
        parameters,
    )  # fmt: skip


def _not_ardusub(log: str | Path, missing: list[str]) -> TrialError:
    """Refusal of a log without the rows of ArduSub's rate controllers."""
    return TrialError(
        f"{log}: expected a DataFlash log of ArduSub with RATE, PIDR, PIDP, PIDY, found no"
        f" {', '.join(missing)}; let LOG_BITMASK include PID and attitude, and log again"
    )


_AXES = ("roll", "pitch", "yaw")

_LETTERS = ("R", "P", "Y")

_NAMES = ("RLL", "PIT", "YAW")


@dataclass(frozen=True)
class ControllerReplaySettings:
    """How the controllers of a log are replayed between its rows."""

    still_rate_deg_s: float = 0.01  #: Rate below which a target counts as still, deg/s.
    proportional_deg: float = 3.0  #: Error below which every angle controller is proportional, deg.
    row_gap_s: float = 0.25  #: Longest time between two rows that follow one another, s.
    span_s: float = 10.0  #: Time over which an integral part is fed with the rows' errors, s.
    #: Misses of two limits that differ by less are the same, deg/s: the rounding of the log.
    rate_rounding_deg_s: float = 0.01
    period_s: float = 0.005  #: Period at which a controller is run between the rows, s.
    #: What is left with the best cut-off, over that with the second best, below which it is clearly the best.
    clear_ratio: float = 0.6
    #: Cut-off frequencies that are tried, Hz.
    cut_offs_hz: tuple[float, ...] = (0.0, 1.0, 2.0, 3.0, 5.0, 7.5, 10.0, 20.0)


SETTINGS = ControllerReplaySettings()

_GAINED = f"I term, gained in {SETTINGS.span_s:g} s"

_YAW_LIMITS = np.radians(np.linspace(10.0, 120.0, 111))  # rad/s2; ArduSub's bounds of half of ATC_ACC_Y_MAX


@dataclass
class Controllers(Comparison):
    """The controllers of a log, replayed one after the other; what comes of them is kept here."""

    #: Times (n,) and acceleration wanted (n, 2), north and east, m/s2; None without rows of both.
    plane_demand: tuple[Array, Array] | None = None

    # --- attitude -----------------------------------------------------------------------------------------

    def angles(self) -> None:
        """Turn rates wanted by the angle controllers."""
        checks = tuple((f"angle, {axis}", "rate wanted") for axis in _AXES)
        angles = self.topic(
            "ANG", "DesRoll", "Roll", "DesPitch", "Pitch", "DesYaw", "Yaw", control="attitude", checks=checks
        )
        rates = self.topic("RATE", "RDes", "PDes", "YDes", "R", "P", "Y", control="attitude")
        if angles is None:
            return
        if rates is None:
            for check in checks:
                self.cannot(*check, "RATE has too few rows of turn rates")
            return
        rows, near = rates.at(angles.t)
        wanted = np.stack([angles[f"Des{axis}"] for axis in ("Roll", "Pitch", "Yaw")], 1)[near]
        attitude = np.stack([angles[axis] for axis in ("Roll", "Pitch", "Yaw")], 1)[near]
        t, rows = angles.t[near], rows[near]
        logged = np.stack([rates[f"{letter}Des"] for letter in _LETTERS], 1)[rows]
        gyro = np.stack([rates[letter] for letter in _LETTERS], 1)[rows]
        error = wanted - attitude
        error[:, 2] = (error[:, 2] + 180.0) % 360.0 - 180.0
        change = np.diff(wanted, axis=0, prepend=wanted[:1])
        change[:, 2] = (change[:, 2] + 180.0) % 360.0 - 180.0
        moving = np.abs(change) / np.maximum(np.diff(t, prepend=t[:1] - 1.0), 1e-3)[:, None]
        still = np.all(
            (moving < SETTINGS.still_rate_deg_s) & (np.roll(moving, -1, axis=0) < SETTINGS.still_rate_deg_s),
            axis=1,
        )
        p = []
        for k in range(3):
            small = still & (np.abs(error[:, k]) < SETTINGS.proportional_deg)
            how = f"{_AXES[k]} rate wanted over its error, targets at rest"
            p.append(self.gain(f"ATC_ANG_{_NAMES[k]}_P", logged[small, k], error[small, k], t[small], how))
        if not all(map(math.isfinite, p)):
            for check in checks:
                self.cannot(*check, "too few rows with a target at rest and an error")
            return
        # The acceleration of an axis counts by half; roll's and pitch's are those of the file, or the
        # defaults.
        tilting = [math.radians(self.known.get(f"ATC_ACC_{letter}_MAX", 1100.0)) for letter in "RP"]
        yaw_rate_p = self._yaw_rate_p()

        def wants(limit: float, which: Any) -> Array:
            to, at, gyros = (np.radians(values[which]) for values in (wanted, attitude, gyro))
            most = [*tilting, 2.0 * limit]
            zeros = np.zeros_like(to)
            return np.degrees(
                np.asarray(ardusub_rates(to, at, zeros, gyros, p, most, 0.0025, yaw_rate_p=yaw_rate_p))
            )

        turned = still & (t <= np.median(t)) & (np.abs(error[:, 2]) > SETTINGS.proportional_deg)
        limit = self._yaw_acceleration(wants, turned, logged[turned, 2])
        replayed = wants(limit, np.ones(len(t), bool))
        judged = still & (t > np.median(t))
        why = "a few rows in which the target jumped between angle and rate are among them"
        for k in range(3):
            spread = float(np.std(logged[judged, k])) if judged.any() else 0.0
            jumps = judged.any() and np.abs(replayed - logged)[judged, k].max() > 1.0
            self.add(
                checks[k], "deg/s", t, logged[:, k], replayed[:, k], judged=judged,
                limit=max(LIMITS["term"] * spread, 0.05), why=why if jumps else "",
            )  # fmt: skip
        if (share := 1.0 - float(still.mean())) > 0.0:
            self.notes.append(
                f"Angle controllers: {100 * share:.0f} % of the rows have a turning target, whose turn rate"
                " the log does not carry; they are left out."
            )

    def _yaw_rate_p(self) -> float:
        """Gain of yaw's rate controller, which bounds the error of yaw; 0 (no bound) where unknown."""
        rows = self.read("PIDY", "Err", "P")
        if rows is None or not (moves := np.abs(rows["Err"]) > 1e-6).any():
            return self.known.get("ATC_RAT_YAW_P", 0.0)
        return float(np.median(rows["P"][moves] / rows["Err"][moves]))

    def _yaw_acceleration(self, wants: Callable[[float, Any], Array], turned: Any, logged: Array) -> float:
        """Acceleration that yaw's angle controller counts on, rad/s2; kept, or a bound of it."""
        if turned.sum() < 10:
            return float(_YAW_LIMITS[-1])
        misses = np.array([np.sqrt(np.mean((wants(a, turned)[:, 2] - logged) ** 2)) for a in _YAW_LIMITS])
        if misses.min() > 0.05 * float(np.std(logged)) + 5.0 * SETTINGS.rate_rounding_deg_s:
            return float(_YAW_LIMITS[-1])  # no acceleration explains these rows
        # As good as the best: within a twentieth, and within what single precision and its rounding leave.
        near = np.flatnonzero(misses <= 1.05 * misses.min() + SETTINGS.rate_rounding_deg_s)
        limit = float(_YAW_LIMITS[int(np.argmin(misses))])
        low, high = (2.0 * math.degrees(_YAW_LIMITS[k]) for k in (near[0], near[-1]))
        name, how = "ATC_ACC_Y_MAX", "yaw rate wanted of large errors"
        if near[-1] == len(_YAW_LIMITS) - 1:
            # ArduSub counts on half of it within 10 to 120 deg/s2: from there on it makes no difference.
            self.keep(Found(name, low, math.nan, f"{how}, which a larger value does not change", "at least"))
        elif near[0] == 0:
            self.keep(Found(name, high, math.nan, f"{how}, which a smaller value does not change", "at most"))
        else:
            step = 2.0 * math.degrees(_YAW_LIMITS[1] - _YAW_LIMITS[0])
            self.keep(Found(name, 2.0 * math.degrees(limit), max(high - low, step) / 2.0, how))
        return limit

    def rate(self, axis: int) -> None:
        """Terms and sum of a rate controller."""
        letter, name = _LETTERS[axis], f"ATC_RAT_{_NAMES[axis]}"
        controller = f"rate, {_AXES[axis]}"
        columns = ("Tar", "Act", "Err", "P", "I", "D", "FF")
        checks = ((controller, "P term"), (controller, _GAINED), (controller, "output"))
        rows = self.topic(f"PID{letter}", *columns, control="attitude", checks=checks)
        sums = self.topic("RATE", f"{letter}Out", control="attitude")
        if rows is None:
            return
        self._terms(controller, name, rows)
        self._target_filter(name, rows, self.topic("RATE", f"{letter}Des", control="attitude"))
        if sums is None:
            self.cannot(controller, "output", "RATE has too few rows of outputs")
            return
        at, near = rows.at(sums.t)
        # The sum of a controller that asks for more than all is cut off on its way to the mixer.
        total = np.clip(_sum(rows), -1.0, 1.0)
        self.add((controller, "output"), "1", sums.t[near], sums[f"{letter}Out"][near], total[at[near]])

    def _target_filter(self, name: str, rows: Rows, wanted: Rows | None) -> None:
        """Cut-off of the target's filter, where one is clearly nearer than its neighbours."""
        if wanted is None:
            return
        fine = np.arange(wanted.t[0], wanted.t[-1], SETTINGS.period_s)
        target = np.radians(np.interp(fine, wanted.t, next(iter(wanted.values.values()))))
        zeros, dt = np.zeros(len(fine)), np.where(np.arange(len(fine)) == 0, 0.0, SETTINGS.period_s)

        def miss(cut_off: float) -> float:
            gains, filters = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0], [cut_off, 0.0, 0.0]
            filtered = np.asarray(ardusub_terms(target, zeros, dt, zeros, gains, filters))[:, 0]
            return float(np.median(np.abs(np.interp(rows.t, fine, filtered) - rows["Tar"])))

        tried = (0.0, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 30.0)
        misses = {cut_off: miss(cut_off) for cut_off in tried}
        best, second = sorted(tried, key=lambda cut_off: misses[cut_off])[:2]
        if misses[best] >= SETTINGS.clear_ratio * misses[second]:
            return
        how = "target of the controller over the rate wanted, Hz"
        self.keep(_cut_off(f"{name}_FLTT", best, tried, how))

    def _terms(self, controller: str, name: str, rows: Rows, stopped: Any = None) -> None:
        """Proportional, feed-forward and integral term of a controller."""
        t = rows.t
        k_p = self.gain(f"{name}_P", rows["P"], rows["Err"], t, "P term over error")
        if math.isnan(k_p):
            for term in ("P term", _GAINED):
                self.cannot(controller, term, "too little moved to find its gain")
            return
        why = _changed(t, rows["P"], rows["Err"], f"{name}_P")
        self.add((controller, "P term"), "1", t, rows["P"], k_p * rows["Err"], why=why)
        for term in ("D", "FF"):
            if not rows[term].any() and rows["Err"].any():
                self.keep(Found(f"{name}_{term}", 0.0, math.nan, f"{term} term, zero throughout"))
        if np.abs(rows["FF"]).max() > 0.0:
            k_ff = self.gain(f"{name}_FF", rows["FF"], rows["Tar"], t, "FF term over target")
            if math.isnan(k_ff):
                self.cannot(controller, "FF term", "too little moved to find its gain")
            else:
                why = _changed(t, rows["FF"], rows["Tar"], f"{name}_FF")
                self.add((controller, "FF term"), "1", t, rows["FF"], k_ff * rows["Tar"], why=why)
        self._integral(controller, name, rows, stopped)

    def _integral(self, controller: str, name: str, rows: Rows, stopped: Any) -> None:
        """Integral term: its gain from what it gained from row to row, then fed with the rows' error.

        `stopped` (n,): rows at whose actuators' limit the term goes towards zero only.
        """
        t, error, term = rows.t, rows["Err"], rows["I"]
        step, middle = np.diff(t, prepend=t[0]), 0.5 * (error + np.roll(error, 1))
        if stopped is not None:
            middle = np.where(stopped & (middle * term >= 0.0), 0.0, middle)
        follows = (step > 0.0) & (step < SETTINGS.row_gap_s)
        gained, cause = np.diff(term, prepend=term[0]), middle * step
        if follows.sum() < 100:
            self.cannot(controller, _GAINED, "too few rows that follow one another")
            return
        most = _bound(term, error)
        free = follows & (np.abs(term) < most * (1.0 - 1e-6))
        rough = _robust(gained[free], cause[free])
        left = np.abs(gained - rough * cause)
        # A mode that begins sets the integral part anew.
        around = np.abs(rough * cause)
        around = np.max([around, np.roll(around, 1), np.roll(around, -1)], axis=0)
        reset = follows & (left > 20.0 * np.median(left[follows]) + 3.0 * around + 1e-9)
        follows &= ~reset
        first = follows & free & (t <= np.median(t))
        if first.sum() < 100 or not np.abs(cause[first]).max(initial=0.0) > 0.0:
            self.cannot(controller, _GAINED, "too little was integrated to find its gain")
            return
        k_i = _robust(gained[first], cause[first])
        sd = np.std(gained[first] - k_i * cause[first]) / (np.std(cause[first]) * math.sqrt(first.sum()))
        self.keep(Found(f"{name}_I", k_i, float(sd), "gain of the I term from row to row"))
        if math.isfinite(most):
            self.keep(Found(f"{name}_IMAX", most, math.nan, "where the I term stays while its error lasts"))
        if reset.any():
            self.notes.append(
                f"{controller}: the integral part was set anew in {int(reset.sum())} of {len(t)} rows."
            )
        # Anew every ten seconds with the logged integral part: what is judged is what ten seconds add.
        span = max(round(SETTINGS.span_s / float(np.median(step[follows]))), 1)
        starts = ~follows
        run = np.arange(len(t)) - np.maximum.accumulate(np.where(starts, np.arange(len(t)), 0))
        starts |= run % span == 0
        begins = np.maximum.accumulate(np.where(starts, np.arange(len(t)), 0))
        terms = np.asarray(
            ardusub_terms(
                np.where(starts, 0.0, middle), np.zeros(len(t)), np.where(starts, 0.0, step), term,
                [0.0, k_i, 0.0, 0.0, 0.0, most], [0.0, 0.0, 0.0],
            )
        )  # fmt: skip
        fed, ran = terms[:, 3] - term[begins], term - term[begins]
        behind = (t > np.median(t)) & (np.arange(len(t)) - begins == span - 1)
        # What the rows cannot show: an error that changes between them counts as noise of the sum.
        between = float(np.std(np.diff(error))) / math.sqrt(2.0) * k_i * float(np.median(step[follows]))
        spread = float(np.std(ran[behind])) if behind.any() else 0.0
        self.add(
            (controller, _GAINED), "1", t, ran, fed, judged=behind,
            limit=2.0 * between * math.sqrt(span) + 0.02 * spread + 1e-9,
            why="the controller sums 20 to 40 errors for each one that the log has",
        )  # fmt: skip

    # --- position -----------------------------------------------------------------------------------------

    def depth(self) -> None:
        """Velocity wanted, acceleration wanted and throttle of the vertical controllers."""
        checks = (("depth", "velocity wanted"), ("depth", "acceleration wanted"))
        columns = ("TPD", "PD", "DVD", "TVD", "VD", "DAD", "TAD")
        rows = self.topic("PSCD", *columns, control="depth", checks=checks)
        if rows is not None:
            # Above terrain the target moves with it.
            moving, pushing = np.zeros((2, len(rows.t)))
            if (terrain := self.read("PSOT", "VOT", "AOT")) is not None:
                at, near = terrain.at(rows.t)
                moving, pushing = (np.where(near, terrain[name][at], 0.0) for name in ("VOT", "AOT"))
            error, wanted = rows["TPD"] - rows["PD"], rows["TVD"] - rows["DVD"] - moving
            how = "velocity wanted over depth error"
            self._velocity_wanted("depth", "PSC_D_POS_P", rows, error, wanted, rows["DVD"] + moving, how)
            answer = rows["TAD"] - rows["DAD"] - pushing
            self._velocity("depth", "PSC_D_VEL", rows.t, rows["TVD"] - rows["VD"], answer, rows["TVD"])
        self._lift()

    def _lift(self) -> None:
        """Terms of the vertical acceleration's controller, and throttle."""
        controller = "vertical acceleration"
        checks = ((controller, "P term"), (controller, _GAINED), (controller, "throttle"))
        columns = ("Tar", "Act", "Err", "P", "I", "D", "FF")
        terms = self.topic("PIDA", *columns, control="depth", checks=checks)
        if terms is None:
            return
        throttle = self.topic("CTUN", "ThI", "ThH", control="depth", checks=checks[2:])
        stopped = None
        if throttle is not None:
            at, near = throttle.at(terms.t)
            full = (throttle["ThI"] >= 1.0) | (throttle["ThI"] <= 0.0)
            stopped = near & full[at]
        self._terms(controller, "PSC_D_ACC", terms, stopped)
        if throttle is None:
            return
        at, near = terms.at(throttle.t)
        total = _sum(terms)[at]
        # In a mode without depth control the controller rests and throttle is the pilot's.
        rests = np.concatenate([[False], np.diff(terms["Err"]) == 0.0])[at]
        rests = rests | np.concatenate([rests[1:], [False]])
        used = near & ~rests
        wanted = np.clip(throttle["ThH"] - total, 0.0, 1.0)
        self.add(checks[2], "1", throttle.t[used], throttle["ThI"][used], wanted[used])

    def _velocity_wanted(
        self, controller: str, name: str, rows: Rows, error: Array, wanted: Array, ahead: Array, how: str
    ) -> None:
        """Velocity wanted of a position controller; `wanted` is its share of it, `ahead` the target's."""
        p = self.gain(name, wanted, error, rows.t, how)
        if math.isnan(p):
            self.cannot(controller, "velocity wanted", "too little moved to find its gain")
            return
        velocity = np.asarray(ardusub_velocity(error, ahead, p, 0.0, 0.0025))
        why = _changed(rows.t, wanted, error, name)
        self.add((controller, "velocity wanted"), "m/s", rows.t, wanted + ahead, velocity, why=why)

    def _velocity(
        self, controller: str, name: str, t: Array, error: Array, answer: Array, target: Array, axis: str = ""
    ) -> None:
        """Acceleration wanted of a velocity controller, of which the log has the sum of the terms only.

        Gains and the cut-off of the error's filter are those that explain the sum best; the integral part
        with which a run of rows begins is unknown.
        """
        step = np.diff(t, prepend=t[0] - 1.0)
        rests = np.diff(answer, prepend=np.inf) == 0.0
        mode = np.searchsorted(self.modes.begins, t)
        run = np.cumsum(
            ~((step > 0.0) & (step < SETTINGS.row_gap_s)) | rests | (np.diff(mode, prepend=-1) != 0)
        )
        long = np.isin(run, np.flatnonzero(np.bincount(run) >= 100))
        if long.sum() < 200:
            self.cannot(controller, "acceleration wanted", "too few rows that follow one another")
            return
        t, error, answer, target, run = (values[long] for values in (t, error, answer, target, run))
        # Found on the first half of every run of rows, judged on the second.
        first = np.zeros(len(t), bool)
        for number in np.unique(run):
            places = np.flatnonzero(run == number)
            first[places[: len(places) // 2]] = True

        def centred(values: Array) -> Array:
            parts = [_centred(values[run == number], first[run == number]) for number in np.unique(run)]
            return np.concatenate(parts)

        # Of every cut-off the gains by least squares; what they leave tells which cut-off it was.
        sought = centred(answer)
        fits = {}
        for cut_off in SETTINGS.cut_offs_hz:
            causes = centred(_causes(t, error, target, run, cut_off))
            gains, *_ = np.linalg.lstsq(causes[first], sought[first], rcond=None)
            fits[cut_off] = float(np.std((sought - causes @ gains)[first])), gains, causes
        cut_off = min(fits, key=lambda each: fits[each][0])
        miss, gains, causes = fits[cut_off]
        # Ten rows in a row count as one: their errors are not independent.
        spread = np.sqrt(np.diag(np.linalg.pinv(causes[first].T @ causes[first]))) * miss * math.sqrt(10.0)
        how = f"acceleration wanted {axis} over filtered error, its sum and the target".replace("  ", " ")
        for ending, value, sd in zip(("P", "I", "FF"), gains.tolist(), spread.tolist(), strict=True):
            if abs(value) > 3.0 * sd:
                self.keep(Found(f"{name}_{ending}", value, sd, how))
        second = min(fits[each][0] for each in SETTINGS.cut_offs_hz if each != cut_off)
        if cut_off > 0.0 and miss < SETTINGS.clear_ratio * second:
            self.keep(_cut_off(f"{name}_FLTE", cut_off, SETTINGS.cut_offs_hz, how))
        self.add(
            (controller, "acceleration wanted"), "m/s2", t, answer, answer + causes @ gains - sought,
            judged=~first, limit=0.05 * float(np.std(answer[~first])),
            why="the error is filtered 200 to 400 times a second, and the log has ten rows of it",
        )  # fmt: skip

    def plane(self) -> None:
        """Velocity and acceleration wanted in the plane."""
        lean: dict[str, Rows] = {}
        for letter, axis in (("N", "north"), ("E", "east")):
            controller = f"position, {axis}"
            checks = ((controller, "velocity wanted"), (controller, "acceleration wanted"))
            columns = [f"{what}{letter}" for what in ("TP", "P", "DV", "TV", "V", "DA", "TA")]
            rows = self.topic(f"PSC{letter}", *columns, control="place", checks=checks)
            if rows is None:
                continue
            target, at, ahead, wanted, velocity, pushed, answer = (rows[column] for column in columns)
            how = f"velocity wanted over the error {axis}"
            self._velocity_wanted(controller, "PSC_NE_POS_P", rows, target - at, wanted - ahead, ahead, how)
            self._velocity(controller, "PSC_NE_VEL", rows.t, wanted - velocity, answer - pushed, wanted, axis)
            lean[letter] = Rows(rows.t, {"a": answer})
        if len(lean) == 2:
            north, east = lean["N"], lean["E"]
            at, near = east.at(north.t)
            self.plane_demand = north.t[near], np.stack([north["a"][near], east["a"][at[near]]], 1)


def _sum(rows: Rows) -> Array:
    """Sum of the terms of a controller."""
    return np.asarray(sum((rows[term] for term in ("P", "I", "D", "FF")), np.zeros(len(rows.t))))


def _changed(t: Array, logged: Array, cause: Array, name: str) -> str:
    """How a gain changed during the log; empty where it did not."""
    strong = np.abs(cause) > 0.05 * np.abs(cause).max(initial=0.0)
    half = t <= np.median(t)
    if min((strong & half).sum(), (strong & ~half).sum()) < 10:
        return ""
    before, after = (float(np.median(logged[rows] / cause[rows])) for rows in (strong & half, strong & ~half))
    if abs(after - before) <= 0.01 * abs(before):
        return ""
    return f"{name} is {before:.3g} in the first half of the log and {after:.3g} in the second"


def _bound(term: Array, error: Array) -> float:
    """Size at which an integral term stays while its error pushes outward; infinite where it does not."""
    most = float(np.abs(term).max(initial=0.0))
    stays = (np.abs(term) >= most * (1.0 - 1e-6)) & (term * error > 0.0) & (most > 0.0)
    # Ten rows in a row: a term that only touches its largest value has no bound there.
    runs = np.convolve(stays.astype(int), np.ones(10, int))
    return most if runs.max(initial=0) >= 10 else math.inf


def _cut_off(name: str, value: float, tried: tuple[float, ...], how: str) -> Found:
    """A cut-off that was found among some: a value half-way to its neighbours, or a bound at the end."""
    place = tried.index(value)
    if place == len(tried) - 1:
        return Found(name, tried[-2], math.nan, how, "at least")
    if place == 0:
        return Found(name, 0.0, math.nan, f"{how}; no filter")
    return Found(name, value, (tried[place + 1] - tried[place - 1]) / 4.0, how)


def _robust(logged: Array, cause: Array) -> float:
    """Factor between a cause and what it drives, without the rows that are far off."""
    factor = float(np.dot(logged, cause) / max(np.dot(cause, cause), 1e-300))
    for _ in range(5):
        left = np.abs(logged - factor * cause)
        kept = left <= 5.0 * np.median(left) + 1e-12
        factor = float(np.dot(logged[kept], cause[kept]) / max(np.dot(cause[kept], cause[kept]), 1e-300))
    return factor


def _causes(t: Array, error: Array, target: Array, run: Any, cut_off: float) -> Array:
    """Filtered error, its sum and the target (n, 3), as a controller has them between the rows."""
    causes = np.zeros((len(t), 3))
    for stretch in np.unique(run):
        rows = np.flatnonzero(run == stretch)
        fine = np.arange(t[rows[0]], t[rows[-1]] + 0.5 * SETTINGS.period_s, SETTINGS.period_s)
        between = np.interp(fine, t[rows], error[rows])
        dt = np.where(np.arange(len(fine)) == 0, 0.0, SETTINGS.period_s)
        zeros = np.zeros(len(fine))
        terms = np.asarray(
            ardusub_terms(between, zeros, dt, zeros, [1.0, 1.0, 0.0, 0.0, 0.0, math.inf], [0.0, cut_off, 0.0])
        )
        at = np.clip(np.searchsorted(fine, t[rows]), 0, len(fine) - 1)
        causes[rows, :2] = terms[at][:, [2, 3]]
        causes[rows, 2] = target[rows]
    return causes


def _centred(values: Array, among: Any) -> Array:
    """Values without the mean of those among them."""
    return np.asarray(values - values[among].mean(axis=0))
