"""ArduSub's controllers over the rows of a log: angle, rate, depth, position, motors.

What a row needs from itself alone is computed by the core row by row. Gains are those that fit best on the
first half of the rows. Held by ``tests/ardusub/test_replay.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from seatrial._core import (
    ardusub_forward_lateral,
    ardusub_frames,
    ardusub_pulses,
    ardusub_rates,
    ardusub_terms,
    ardusub_velocity,
)
from seatrial.ardusub.quantity import LIMITS, Found, Quantity
from seatrial.base.arrays import Array
from seatrial.logs.log import Log

__all__ = ["Controllers"]

NEAR_S = 0.004
"""Rows of two controllers belong together where their stamps are so near, s."""

_AXES = ("roll", "pitch", "yaw")

_LETTERS = ("R", "P", "Y")

_NAMES = ("RLL", "PIT", "YAW")

_STILL_DEG_S = 0.01  # below which a target counts as still

_SMALL_DEG = 3.0  # below which every angle controller is proportional

_LONGEST_S = 0.25  # between two rows that follow one another

_SPAN_S = 10.0  # over which an integral part is fed with the rows' errors

_PERIOD_S = 0.005  # at which a controller is run between the rows

_CLEARLY = 0.6  # what is left with the best cut-off, over that with the second best

_CUT_OFFS = (0.0, 1.0, 2.0, 3.0, 5.0, 7.5, 10.0, 20.0)  # Hz

_YAW_LIMITS = np.radians(np.linspace(10.0, 120.0, 111))  # rad/s2; ArduSub's bounds of half of ATC_ACC_Y_MAX


@dataclass
class _Topic:
    """Rows of a topic."""

    t: Array
    values: Mapping[str, Array]

    def __getitem__(self, name: str) -> Array:
        return self.values[name]

    def at(self, t: Array) -> tuple[Any, Any]:
        """Rows nearest in time, and whether they are near enough."""
        after = np.clip(np.searchsorted(self.t, t), 1, max(len(self.t) - 1, 1))
        before = after - 1
        if len(self.t) < 2:
            return np.zeros(len(t), int), np.zeros(len(t), bool)
        nearest = np.where(t - self.t[before] < self.t[after] - t, before, after)
        return nearest, np.abs(self.t[nearest] - t) <= NEAR_S


@dataclass
class Controllers:
    """The controllers of a log, replayed one after the other; what comes of them is kept here."""

    log: Log
    quantities: list[Quantity] = field(default_factory=list)
    found: list[Found] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    frame: tuple[str, tuple[int, ...]] | None = None
    plane_demand: tuple[Array, Array] | None = None

    def topic(self, name: str, *columns: str) -> _Topic | None:
        """Rows of a topic without those that are not numbers; None, with a note, where there is none."""
        have = self.log.fields.get(name, {})
        if lacking := [column for column in columns if column not in have]:
            what = "no rows" if not have else f"no {', '.join(lacking)}"
            self.notes.append(f"{name}: the log has {what}; what rests on it is not replayed.")
            return None
        read = self.log.read({name: columns})[name]
        finite = np.all([np.isfinite(read.fields[column]) for column in columns], axis=0)
        order = np.argsort(read.t[finite], kind="stable")
        t, first = np.unique(read.t[finite][order], return_index=True)
        if len(t) < 20:
            self.notes.append(f"{name}: the log has {len(t)} rows, too few to replay.")
            return None
        return _Topic(t, {c: np.asarray(read.fields[c][finite][order][first], float) for c in columns})

    def add(
        self,
        controller: str,
        name: str,
        unit: str,
        t: Array,
        logged: Array,
        replayed: Array,
        *,
        limit: float | None = None,
        judged: Any = None,
        why: str = "",
    ) -> None:
        """Keep a quantity; its limit is a hundredth of what was logged unless given."""
        rows = (t > np.median(t) if len(t) else np.zeros(0, bool)) if judged is None else judged
        if not rows.any():
            self.notes.append(f"{controller}, {name}: no row is left to judge by.")
            return
        # Logs keep single precision: below a millionth of the largest value nothing is told.
        least = 1e-6 * float(np.abs(logged).max(initial=0.0)) + 1e-9
        within = max(LIMITS["term"] * float(np.std(logged[rows])), least) if limit is None else limit
        self.quantities.append(Quantity(controller, name, unit, t, logged, replayed, rows, within, why))

    def gain(self, name: str, logged: Array, cause: Array, t: Array, how: str) -> float:
        """Factor between a cause and what it drives on the first half, kept as a parameter."""
        first = t <= np.median(t)
        strong = first & (np.abs(cause) > 0.05 * np.abs(cause[first]).max(initial=0.0)) & (cause != 0.0)
        if strong.sum() < 10:
            self.notes.append(f"{name}: too little moved to find it.")
            return math.nan
        ratio = logged[strong] / cause[strong]
        value = float(np.median(ratio))
        middle = np.abs(ratio - value)
        sd = 1.4826 * float(np.median(middle)) / math.sqrt(len(ratio))
        self.keep(Found(name, value, sd, how))
        return value

    def keep(self, one: Found) -> None:
        """Keep a parameter; of two axes that share it the first counts, and the other says if it agrees."""
        same = next((each for each in self.found if each.name == one.name), None)
        if same is None:
            self.found.append(one)
        elif abs(same.value - one.value) > 0.05 * abs(same.value):
            self.notes.append(
                f"{one.name}: {same.value:.3g} ({same.how}) and {one.value:.3g} ({one.how}) differ."
            )

    # --- attitude -----------------------------------------------------------------------------------------

    def angles(self) -> None:
        """Turn rates wanted by the angle controllers."""
        angles = self.topic("ANG", "DesRoll", "Roll", "DesPitch", "Pitch", "DesYaw", "Yaw")
        rates = self.topic("RATE", "RDes", "PDes", "YDes", "R", "P", "Y")
        if angles is None or rates is None:
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
        moving = np.abs(change) / np.maximum(np.diff(t, prepend=t[0] - 1.0), 1e-3)[:, None]
        still = np.all((moving < _STILL_DEG_S) & (np.roll(moving, -1, axis=0) < _STILL_DEG_S), axis=1)
        p = [
            self.gain(
                f"ATC_ANG_{_NAMES[k]}_P",
                logged[still & (np.abs(error[:, k]) < _SMALL_DEG), k],
                error[still & (np.abs(error[:, k]) < _SMALL_DEG), k],
                t[still & (np.abs(error[:, k]) < _SMALL_DEG)],
                f"{_AXES[k]} rate wanted over its error, targets at rest",
            )
            for k in range(3)
        ]
        if not all(map(math.isfinite, p)):
            return
        first, zeros = still & (t <= np.median(t)), np.zeros_like(wanted)

        def wants(limit: float, rows: Any) -> Array:
            to, at, turning, turned = (np.radians(one[rows]) for one in (wanted, attitude, zeros, gyro))
            return np.degrees(
                np.asarray(ardusub_rates(to, at, turning, turned, p, [19.2, 19.2, 2.0 * limit], 0.0025))
            )

        turned = first & (np.abs(error[:, 2]) > _SMALL_DEG)
        limit = float(_YAW_LIMITS[-1])
        if turned.sum() >= 10:
            misses = [float(np.mean((wants(a, turned)[:, 2] - logged[turned, 2]) ** 2)) for a in _YAW_LIMITS]
            limit = float(_YAW_LIMITS[int(np.argmin(misses))])
            told = (
                "at least; from there on it makes no difference"
                if limit >= _YAW_LIMITS[-1]
                else "of large errors"
            )
            self.found.append(
                Found("ATC_ACC_Y_MAX", 2.0 * math.degrees(limit), math.nan, f"yaw rate wanted, {told}")
            )
        replayed = wants(limit, np.ones(len(t), bool))
        behind = still & (t > np.median(t))
        why = "a few rows in which the target jumped between angle and rate are among them"
        for k in range(3):
            self.add(
                f"angle, {_AXES[k]}", "rate wanted", "deg/s", t, logged[:, k], replayed[:, k], judged=behind,
                limit=max(LIMITS["term"] * float(np.std(logged[behind, k])), 0.05) if behind.any() else 0.05,
                why=why if behind.any() and np.abs(replayed - logged)[behind, k].max() > 1.0 else "",
            )  # fmt: skip
        if (share := 1.0 - float(still.mean())) > 0.0:
            self.notes.append(
                f"Angle controllers: {100 * share:.0f} % of the rows have a turning target, whose turn rate"
                " the log does not carry; they are left out."
            )

    def rate(self, axis: int) -> None:
        """Terms and sum of a rate controller."""
        letter, name = _LETTERS[axis], f"ATC_RAT_{_NAMES[axis]}"
        controller = f"rate, {_AXES[axis]}"
        rows = self.topic(f"PID{letter}", "Tar", "Act", "Err", "P", "I", "D", "FF")
        sums = self.topic("RATE", f"{letter}Out")
        if rows is None:
            return
        self._terms(controller, name, rows, "1")
        self._target_filter(name, rows, self.topic("RATE", f"{letter}Des"))
        if sums is None:
            return
        at, near = rows.at(sums.t)
        total = sum((rows[term] for term in ("P", "I", "D", "FF")), np.zeros(len(rows.t)))
        self.add(controller, "output", "1", sums.t[near], sums[f"{letter}Out"][near], total[at[near]])

    def _target_filter(self, name: str, rows: _Topic, wanted: _Topic | None) -> None:
        """Cut-off of the target's filter, where one of the usual ones is clearly nearest."""
        if wanted is None:
            return
        fine = np.arange(wanted.t[0], wanted.t[-1], _PERIOD_S)
        target = np.radians(np.interp(fine, wanted.t, next(iter(wanted.values.values()))))
        zeros, dt = np.zeros(len(fine)), np.where(np.arange(len(fine)) == 0, 0.0, _PERIOD_S)
        misses = []
        for cut_off in (0.0, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 30.0):
            terms = ardusub_terms(
                target, zeros, dt, zeros, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0], [cut_off, 0.0, 0.0]
            )
            filtered = np.interp(rows.t, fine, np.asarray(terms)[:, 0])
            misses.append((float(np.median(np.abs(filtered - rows["Tar"]))), cut_off))
        (best, cut_off), (second, _), *_ = sorted(misses)
        if best < _CLEARLY * second:
            how = "target of the controller over the rate wanted, Hz"
            self.keep(Found(f"{name}_FLTT", cut_off, math.nan, how))

    def _terms(self, controller: str, name: str, rows: _Topic, unit: str) -> None:
        """Proportional, feed-forward and integral term of a controller."""
        t = rows.t
        k_p = self.gain(f"{name}_P", rows["P"], rows["Err"], t, "P term over error")
        if math.isnan(k_p):
            return
        self.add(controller, "P term", unit, t, rows["P"], k_p * rows["Err"])
        for term in ("D", "FF"):
            if not rows[term].any() and rows["Err"].any():
                self.keep(Found(f"{name}_{term}", 0.0, math.nan, f"{term} term, zero throughout"))
        if np.abs(rows["FF"]).max() > 0.0:
            k_ff = self.gain(f"{name}_FF", rows["FF"], rows["Tar"], t, "FF term over target")
            self.add(controller, "FF term", unit, t, rows["FF"], k_ff * rows["Tar"])
        self._integral(controller, name, rows, unit, k_p)

    def _integral(self, controller: str, name: str, rows: _Topic, unit: str, k_p: float) -> None:
        """Integral term: its gain from what it gained from row to row, then fed with the rows' error."""
        t, error, term = rows.t, rows["Err"], rows["I"]
        step, middle = np.diff(t, prepend=t[0]), 0.5 * (error + np.roll(error, 1))
        follows = (step > 0.0) & (step < _LONGEST_S)
        gained, cause = np.diff(term, prepend=term[0]), middle * step
        rough = _robust(gained[follows], cause[follows])
        left = np.abs(gained - rough * cause)
        # A mode that begins sets the integral part anew.
        around = np.abs(rough * cause)
        around = np.max([around, np.roll(around, 1), np.roll(around, -1)], axis=0)
        reset = follows & (left > 20.0 * np.median(left[follows]) + 3.0 * around + 1e-9)
        follows &= ~reset
        first = follows & (t <= np.median(t))
        if first.sum() < 100 or not np.abs(cause[first]).max(initial=0.0) > 0.0:
            self.notes.append(f"{name}_I: too little was integrated to find it.")
            return
        k_i = _robust(gained[first], cause[first])
        sd = np.std(gained[first] - k_i * cause[first]) / (np.std(cause[first]) * math.sqrt(first.sum()))
        self.found.append(Found(f"{name}_I", k_i, float(sd), "gain of the I term from row to row"))
        if reset.any():
            self.notes.append(
                f"{controller}: the integral part was set anew in {int(reset.sum())} of {len(t)} rows."
            )
        # Anew every ten seconds with the logged integral part: what is judged is what ten seconds add.
        span = max(round(_SPAN_S / float(np.median(step[follows]))), 1)
        starts = ~follows
        run = np.arange(len(t)) - np.maximum.accumulate(np.where(starts, np.arange(len(t)), 0))
        starts |= run % span == 0
        begins = np.maximum.accumulate(np.where(starts, np.arange(len(t)), 0))
        terms = np.asarray(
            ardusub_terms(
                np.where(starts, 0.0, middle), np.zeros(len(t)), np.where(starts, 0.0, step), term,
                [k_p, k_i, 0.0, 0.0, 0.0, math.inf], [0.0, 0.0, 0.0],
            )
        )  # fmt: skip
        fed, ran = terms[:, 3] - term[begins], term - term[begins]
        behind = (t > np.median(t)) & (np.arange(len(t)) - begins == span - 1)
        # What the rows cannot show: an error that changes between them counts as noise of the sum.
        between = float(np.std(np.diff(error))) / math.sqrt(2.0) * k_i * float(np.median(step[follows]))
        spread = float(np.std(ran[behind])) if behind.any() else 0.0
        self.add(
            controller, f"I term, gained in {_SPAN_S:g} s", unit, t, ran, fed, judged=behind,
            limit=2.0 * between * math.sqrt(span) + 0.02 * spread,
            why="the controller sums 20 to 40 errors for each one that the log has",
        )  # fmt: skip

    # --- position -----------------------------------------------------------------------------------------

    def depth(self) -> None:
        """Velocity wanted, acceleration wanted and throttle of the vertical controllers."""
        rows = self.topic("PSCD", "TPD", "PD", "DVD", "TVD", "VD", "DAD", "TAD")
        if rows is None:
            return
        # Above terrain the target moves with it.
        moving, pushing = np.zeros((2, len(rows.t)))
        if "PSOT" in self.log.fields and (terrain := self.topic("PSOT", "VOT", "AOT")) is not None:
            at, near = terrain.at(rows.t)
            moving, pushing = (np.where(near, terrain[name][at], 0.0) for name in ("VOT", "AOT"))
        error, wanted = rows["TPD"] - rows["PD"], rows["TVD"] - rows["DVD"] - moving
        p = self.gain("PSC_D_POS_P", wanted, error, rows.t, "velocity wanted over depth error")
        if math.isfinite(p):
            velocity = np.asarray(ardusub_velocity(error, rows["DVD"] + moving, p, 0.0, 0.0025))
            self.add("depth", "velocity wanted", "m/s", rows.t, rows["TVD"], velocity)
        answer = rows["TAD"] - rows["DAD"] - pushing
        self._velocity("depth", "PSC_D_VEL", rows.t, rows["TVD"] - rows["VD"], answer, rows["TVD"])
        terms = self.topic("PIDA", "Tar", "Act", "Err", "P", "I", "D", "FF")
        if terms is None:
            return
        self._terms("vertical acceleration", "PSC_D_ACC", terms, "1")
        throttle = self.topic("CTUN", "ThI", "ThH")
        if throttle is None:
            return
        at, near = terms.at(throttle.t)
        total = sum((terms[term] for term in ("P", "I", "D", "FF")), np.zeros(len(terms.t)))[at]
        # In a mode without depth control the controller rests and throttle is the pilot's.
        rests = np.concatenate([[False], np.diff(terms["Err"]) == 0.0])[at]
        rests = rests | np.concatenate([rests[1:], [False]])
        used = near & ~rests
        self.add(
            "vertical acceleration", "throttle", "1", throttle.t[used], throttle["ThI"][used],
            (throttle["ThH"] - total)[used],
        )  # fmt: skip

    def _velocity(
        self, controller: str, name: str, t: Array, error: Array, answer: Array, target: Array, axis: str = ""
    ) -> None:
        """Acceleration wanted of a velocity controller, of which the log has the sum of the terms only.

        Gains and the cut-off of the error's filter are those that explain the sum best; the integral part
        with which a run of rows begins is unknown.
        """
        step = np.diff(t, prepend=t[0] - 1.0)
        rests = np.diff(answer, prepend=np.inf) == 0.0
        modes = [event.t for event in self.log.events() if event.kind == "mode"]
        mode = np.searchsorted(np.asarray(modes, float), t)
        run = np.cumsum(~((step > 0.0) & (step < _LONGEST_S)) | rests | (np.diff(mode, prepend=-1) != 0))
        long = np.isin(run, np.flatnonzero(np.bincount(run) >= 100))
        if long.sum() < 200:
            self.notes.append(f"{name}: too few rows that follow one another to find its gains.")
            return
        t, error, answer, target, run = (one[long] for one in (t, error, answer, target, run))
        first = np.zeros(len(t), bool)
        for one in np.unique(run):
            places = np.flatnonzero(run == one)
            first[places[: len(places) // 2]] = True
        best: tuple[float, float, Array, Array] | None = None
        for cut_off in _CUT_OFFS:
            causes = _causes(t, error, target, run, cut_off)
            own = np.concatenate([_centred(causes[run == one], first[run == one]) for one in np.unique(run)])
            sought = np.concatenate([
                _centred(answer[run == one], first[run == one]) for one in np.unique(run)
            ])
            gains, *_ = np.linalg.lstsq(own[first], sought[first], rcond=None)
            miss = float(np.std((sought - own @ gains)[first]))
            if best is None or miss < best[0]:
                best = miss, cut_off, gains, own @ gains - sought
        if best is None:
            return
        miss, cut_off, gains, difference = best
        own = np.concatenate([
            _centred(_causes(t, error, target, run, cut_off)[run == one], first[run == one])
            for one in np.unique(run)
        ])
        spread = np.sqrt(np.diag(np.linalg.pinv(own[first].T @ own[first]))) * miss * math.sqrt(10.0)
        how = f"acceleration wanted {axis} over filtered error, its sum and the target".replace("  ", " ")
        for ending, value, sd in zip(("P", "I", "FF"), gains.tolist(), spread.tolist(), strict=True):
            if abs(value) > 3.0 * sd:
                self.keep(Found(f"{name}_{ending}", value, sd, how))
        if cut_off > 0.0:
            self.keep(Found(f"{name}_FLTE", cut_off, math.nan, how))
        self.add(
            controller, "acceleration wanted", "m/s2", t, answer, answer + difference, judged=~first,
            limit=0.05 * float(np.std(answer[~first])),
            why="the error is filtered 200 to 400 times a second, and the log has ten rows of it",
        )  # fmt: skip

    def plane(self) -> None:
        """Velocity and acceleration wanted in the plane, and the demands that follow from them."""
        lean: dict[str, tuple[Array, Array]] = {}
        for letter in ("N", "E"):
            topic = f"PSC{letter}"
            if topic not in self.log.fields:
                self.notes.append(f"{topic}: the log has no rows; the position controller is not replayed.")
                continue
            columns = [f"{what}{letter}" for what in ("TP", "P", "DV", "TV", "V", "DA", "TA")]
            rows = self.topic(topic, *columns)
            if rows is None:
                continue
            error = rows[f"TP{letter}"] - rows[f"P{letter}"]
            wanted = rows[f"TV{letter}"] - rows[f"DV{letter}"]
            axis = {"N": "north", "E": "east"}[letter]
            p = self.gain("PSC_NE_POS_P", wanted, error, rows.t, f"velocity wanted over the error {axis}")
            if math.isfinite(p):
                velocity = np.asarray(ardusub_velocity(error, rows[f"DV{letter}"], p, 0.0, 0.0025))
                self.add(f"position, {axis}", "velocity wanted", "m/s", rows.t, rows[f"TV{letter}"], velocity)
            self._velocity(
                f"position, {axis}", "PSC_NE_VEL", rows.t, rows[f"TV{letter}"] - rows[f"V{letter}"],
                rows[f"TA{letter}"] - rows[f"DA{letter}"], rows[f"TV{letter}"], axis,
            )  # fmt: skip
            lean[letter] = rows.t, rows[f"TA{letter}"]
        if len(lean) == 2:
            t, north = lean["N"]
            east = _Topic(lean["E"][0], {"a": lean["E"][1]})
            at, near = east.at(t)
            self.plane_demand = t[near], np.stack([north[near], east["a"][at[near]]], 1)

    # --- motors -------------------------------------------------------------------------------------------

    def pulses(self) -> None:
        """Pulse widths of the motors."""
        rates = self.topic("RATE", "ROut", "POut", "YOut", "AOut")
        outputs = self._outputs()
        if rates is None or outputs is None:
            return
        at, near = outputs.at(rates.t)
        t, rows = rates.t[near], at[near]
        known = np.stack([rates[name] for name in ("ROut", "POut", "YOut")] + [2.0 * rates["AOut"] - 1.0], 1)[
            near
        ]
        pulses = np.stack([outputs[f"C{k + 1}"] for k in range(len(outputs.values))], 1)[rows]
        chosen = _frame(known, pulses)
        if chosen is None:
            self.notes.append("Motors: no frame of ArduSub explains the pulses; FRAME_CONFIG may be custom.")
            return
        name, direction = chosen
        self.frame = name, tuple(int(one) for one in direction)
        self.found += [
            Found(f"MOT_{k}_DIRECTION", float(one), math.nan, "sign of its pulse under the demands")
            for k, one in enumerate(direction, 1)
        ]
        shares = np.asarray(ardusub_frames()[name])
        moved = pulses[:, : len(shares)]
        forward = self._plane(t, known, moved, shares, direction)
        demands = np.concatenate([known, forward], axis=1)
        replayed = np.asarray(ardusub_pulses(name, demands, direction))
        for k in range(len(shares)):
            alone = not shares[k, 4:].any()
            judged = np.ones(len(t), bool) if alone else np.isfinite(forward).all(axis=1) & (t > np.median(t))
            self.add(
                "mixer", f"motor {k + 1}", "us", t, moved[:, k], np.nan_to_num(replayed[:, k], nan=1500.0),
                limit=LIMITS["pulse"], judged=judged,
            )  # fmt: skip

    def _outputs(self) -> _Topic | None:
        have = self.log.fields.get("RCOU", {})
        names = [f"C{k}" for k in range(1, 9) if f"C{k}" in have]
        return self.topic("RCOU", *names) if names else self.topic("RCOU", "C1")

    def _plane(
        self, t: Array, known: Array, pulses: Array, shares: Array, direction: Sequence[float]
    ) -> Array:
        """Forward and lateral demand of every row: the pilot's sticks, or the position controller's."""
        found = np.full((len(t), 2), np.nan)
        sticks = self.topic("RCIN", "C5", "C6")
        if sticks is not None:
            at, _ = sticks.at(t)
            near = np.abs(sticks.t[at] - t) < 0.1
            found[near] = np.stack([sticks["C5"][at[near]], sticks["C6"][at[near]]], 1) / 400.0 - 3.75
        heading = self.topic("ANG", "Yaw")
        if self.plane_demand is None or heading is None:
            return found
        own = _Topic(self.plane_demand[0], {"north": self.plane_demand[1][:, 0]})
        at, near = own.at(t)
        yaw = np.radians(np.interp(t, heading.t, np.unwrap(heading["Yaw"], period=360.0)))
        acceleration = self.plane_demand[1][at[near]]
        lean = {
            limit: np.asarray(ardusub_forward_lateral(acceleration, yaw[near], math.radians(limit)))
            for limit in (30.0, 35.0, 40.0, 45.0, 60.0, 80.0)
        }
        solved = _solved(known, pulses, shares, direction)[near]
        misses = {limit: float(np.median(np.abs(one - solved))) for limit, one in lean.items()}
        best = min(misses, key=lambda limit: misses[limit])
        found[near] = lean[best]
        self.found.append(
            Found("ATC_ANGLE_MAX", best, math.nan, "forward and lateral over the acceleration wanted, deg")
        )
        return found


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
    found = np.zeros((len(t), 3))
    for one in np.unique(run):
        rows = np.flatnonzero(run == one)
        fine = np.arange(t[rows[0]], t[rows[-1]] + 0.5 * _PERIOD_S, _PERIOD_S)
        between = np.interp(fine, t[rows], error[rows])
        dt = np.where(np.arange(len(fine)) == 0, 0.0, _PERIOD_S)
        zeros = np.zeros(len(fine))
        terms = np.asarray(
            ardusub_terms(between, zeros, dt, zeros, [1.0, 1.0, 0.0, 0.0, 0.0, math.inf], [0.0, cut_off, 0.0])
        )
        at = np.clip(np.searchsorted(fine, t[rows]), 0, len(fine) - 1)
        found[rows, :2] = terms[at][:, [2, 3]]
        found[rows, 2] = target[rows]
    return found


def _centred(values: Array, among: Any) -> Array:
    """Values without the mean of those among them."""
    return np.asarray(values - values[among].mean(axis=0))


def _solved(known: Array, pulses: Array, shares: Array, direction: Sequence[float]) -> Array:
    """Forward and lateral demand (n, 2) that explain the pulses best."""
    left = (pulses - 1500.0) / 400.0 * np.asarray(direction) - known @ shares[:, :4].T
    return np.asarray(np.linalg.lstsq(shares[:, 4:], left.T, rcond=None)[0].T)


def _frame(known: Array, pulses: Array) -> tuple[str, tuple[float, ...]] | None:
    """Frame and directions that explain pulses under roll, pitch, yaw and throttle; None where none does."""
    best: tuple[float, str, tuple[float, ...]] | None = None
    for name, motors in ardusub_frames().items():
        shares = np.asarray(motors)
        count = len(shares)
        if pulses.shape[1] < count or not np.all(pulses[:, :count] > 0.0):
            continue
        # Motors beyond the frame's rest or carry something else: fewer explained ones count against a frame.
        moved = (pulses[:, :count] - 1500.0) / 400.0
        wanted = known @ shares[:, :4].T
        sign = np.where(np.sum(moved * wanted, axis=0) < 0.0, -1.0, 1.0)
        left = moved * sign - wanted
        if shares[:, 4:].any():
            drawn = np.linalg.lstsq(shares[:, 4:], left.T, rcond=None)[0]
            left = left - (shares[:, 4:] @ drawn).T
        also = (pulses[:, count:8] - 1500.0)[:, np.all(pulses[:, count:8] > 0.0, axis=0)] / 400.0
        miss = float(np.sqrt((np.sum(left**2) + np.sum(also**2)) / len(pulses) / 8.0)) * 400.0
        if best is None or miss < best[0]:
            best = miss, name, tuple(sign.tolist())
    return None if best is None or best[0] > 5.0 * LIMITS["pulse"] else best[1:]
