"""What a replay keeps: quantities beside their replay, parameters, and checks that cannot be made.

The modes of flight decide which checks a log owes: in MANUAL sticks pass to the mixer and the controllers
rest, STABILIZE and ACRO control the attitude, ALT_HOLD and its kin the depth as well, POSHOLD and the
guided modes also the place. Source: ArduSub's documentation, "Flight modes". Held by
``tests/ardusub/test_replay.py`` and ``tests/ardusub/test_motors.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.ardusub.parameters import ParameterFile, in_metres
from seatrial.base.arrays import Array
from seatrial.base.plain import Plain, plain
from seatrial.base.run import RunResult, to_json
from seatrial.logs.log import Log, Samples

LIMITS = {"term": 0.01, "pulse": 2.0}
"""Share of a term, and microseconds of a pulse, within which a replay counts as right."""


@dataclass(frozen=True)
class ComparisonSettings:
    """Which rows of a log belong together, and how many a check needs."""

    #: Longest stretch, s, over which what follows from its own row alone may be off: a row that was logged
    #: between two periods is off by itself, what fails stays off.
    longest_off_s: float = 1.0
    gap_s: float = 0.5  #: Longest gap between rows of one stretch, s.
    #: Time from arming until motors follow the mixer, s: MOT_SPOOL_TIME is 0.5 s unless it is set.
    spool_up_s: float = 1.0
    near_s: float = 0.004  #: Rows of two controllers belong together where their stamps are so near, s.
    #: Rows of a topic below which nothing is replayed from it; a mode with fewer rows owes no check.
    fewest_rows: int = 20
    #: Longest time between a row and the time for which it stands, s: three periods of a log at 10 Hz.
    covers_s: float = 0.3


SETTINGS = ComparisonSettings()


@dataclass(frozen=True)
class Found:
    """A parameter that was found from the log: its value, or a bound of it."""

    #: `name`, `value`: ArduSub's name, and the value in its unit.
    name: str
    value: float
    sd: float  #: Standard deviation of the value, NaN where none can be told.
    how: str  #: From what it was found.
    #: ``"at least"`` or ``"at most"`` where the log tells no more than that; then `value` is the bound and
    #: nothing to load. Empty for a value.
    bound: str = ""

    def agrees(self, other: float) -> bool:
        """Whether another value of the parameter is compatible with what was found.

        Values agree within a hundredth or three standard deviations; a bound with all on its side of it.
        """
        spread = max(0.01 * abs(other), 0.0 if math.isnan(self.sd) else 3.0 * self.sd)
        if self.bound == "at least":
            return other >= self.value - spread
        if self.bound == "at most":
            return other <= self.value + spread
        return abs(self.value - other) <= spread

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        kind = self.bound.replace(" ", "_") or "value"
        return {"name": self.name, "value": None, "sd": self.sd, "how": self.how} | {kind: self.value}


@dataclass(frozen=True)
class Impossible(Plain, without="partly"):
    """A check that the modes of the log ask for and that cannot be made."""

    #: `controller`, `name`: as of a `Quantity`.
    controller: str
    name: str
    why: str  #: What is in the way.
    topic: str = ""  #: The topic that is missing; empty where another thing is in the way.
    partly: bool = False  #: Whether the topic is missing for part of the log only.


@dataclass(frozen=True, eq=False)
class Quantity:
    """A logged quantity beside its replay."""

    controller: str
    name: str
    unit: str
    t: Array  #: Times of the rows, s.
    #: `logged`, `replayed`: (n,) each.
    logged: Array
    replayed: Array
    judged: Any  #: Rows that count, (n,).
    limit: float  #: Within which 95 % of the judged rows are right, in the unit.
    why: str = ""  #: Why what is left is left; empty where nothing is.
    #: Whether each row follows from itself alone: then none may be off for longer than `longest_off_s`
    #: either.
    exact: bool = False

    @property
    def error(self) -> Array:
        """Replayed minus logged on the judged rows."""
        return np.asarray((self.replayed - self.logged)[self.judged])

    @property
    def rms(self) -> float:
        """Of what was logged, about its mean."""
        return float(np.std(self.logged[self.judged]))

    @property
    def p95(self) -> float:
        """Error that 95 % of the judged rows stay within."""
        return float(np.percentile(np.abs(self.error), 95)) if len(self.error) else math.nan

    @property
    def off(self) -> tuple[float, float]:
        """First and last time of the longest stretch of judged rows beyond the limit, s; NaN without one."""
        t, beyond = self.t[self.judged], np.abs(self.error) > self.limit
        best = (math.nan, math.nan)
        if not beyond.any():
            return best
        # A stretch ends where a row is within the limit, or where rows are missing.
        ends = np.concatenate([[True], ~beyond[:-1] | (np.diff(t) > SETTINGS.gap_s)])
        stretch = np.cumsum(ends | ~beyond)
        for number in np.unique(stretch[beyond]):
            rows = np.flatnonzero(beyond & (stretch == number))
            if math.isnan(best[0]) or t[rows[-1]] - t[rows[0]] > best[1] - best[0]:
                best = float(t[rows[0]]), float(t[rows[-1]])
        return best

    @property
    def holds(self) -> bool:
        """Whether 95 % of the rows are within the limit and, of what is exact, none is off for long."""
        if not self.p95 <= self.limit:
            return False
        first, last = self.off
        return not (self.exact and last - first > SETTINGS.longest_off_s)

    def to_dict(self) -> dict[str, Any]:
        """Plain data without the rows."""
        first, last = self.off
        return {
            "controller": self.controller,
            "name": self.name,
            "unit": self.unit,
            "rows": len(self.error),
            "rms": self.rms,
            "p95": self.p95,
            "largest": float(np.abs(self.error).max(initial=0.0)),
            "limit": self.limit,
            "longest_off_s": 0.0 if math.isnan(first) else last - first,
            "holds": self.holds,
            "why": self.why,
        }


@dataclass(frozen=True, eq=False, repr=False)
class Replay(RunResult):
    """What the law makes of a log's inputs, beside what the log says."""

    source: str  #: The log.
    quantities: tuple[Quantity, ...]  #: One by one in the order of the signal.
    #: Checks that the modes of the log ask for and that could not be made.
    impossible: tuple[Impossible, ...]
    found: tuple[Found, ...]  #: Parameters that were found from the log, or bounds of them.
    frame: tuple[str, tuple[int, ...]] | None  #: Name of the frame, and ``MOT_n_DIRECTION`` of its motors.
    notes: tuple[str, ...]  #: What could not be replayed and why.
    facts: Mapping[str, Any]  #: What the result rests on.
    #: The vehicle's own parameters, where they were given; those found are compared with them.
    given: ParameterFile | None = None

    @property
    def checks(self) -> tuple[int, int]:
        """How many checks are met, and how many the log owes."""
        met = sum(quantity.holds for quantity in self.quantities)
        return met, len(self.quantities) + len(self.impossible)

    @property
    def held(self) -> bool:
        """Whether every check that the log owes is met."""
        met, owed = self.checks
        return met == owed

    @property
    def missing(self) -> tuple[str, ...]:
        """Topics without which checks could not be made."""
        return tuple(dict.fromkeys(gap.topic for gap in self.impossible if gap.topic))

    @property
    def partly(self) -> tuple[str, ...]:
        """Topics that are missing for part of the time in which their controller worked."""
        return tuple(dict.fromkeys(gap.topic for gap in self.impossible if gap.topic and gap.partly))

    def parameter(self, name: str) -> float:
        """Value of a parameter that was found.

        Raises
        ------
        KeyError
            It was not, or only a bound of it.
        """
        values = {each.name: each.value for each in self.found if not each.bound}
        return values[name]

    def against(self) -> tuple[tuple[Found, float, bool], ...]:
        """Each parameter found, its value in the file that was given, and whether they agree."""
        if self.given is None:
            return ()
        values = in_metres(self.given)
        both = ((each, values[each.name]) for each in self.found if each.name in values)
        return tuple((each, own, each.agrees(own)) for each, own in both)

    def parameter_file(self) -> str:
        """The parameters found as a parameter file, each with what it was found from; bounds are comments."""
        lines = [f"# Found from {Path(self.source).name}; ArduSub 4.7 and later by name and unit"]
        for each in self.found:
            if each.bound:
                lines.append(f"# {each.name}: {each.bound} {each.value:.6g} ({each.how}); nothing to load")
                continue
            spread = "" if math.isnan(each.sd) else f", standard deviation {each.sd:.2g}"
            lines += [f"# {each.how}{spread}", f"{each.name},{each.value:.6g}"]
        return "\n".join(lines) + "\n"

    def files(self) -> dict[str, str | bytes]:
        """Files of the run directory by name, see `save`."""
        return {
            "replay.json": to_json(self.to_dict()),
            "found.param": self.parameter_file(),
            **self.report().files(),
        }

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        met, owed = self.checks
        return {
            "source": self.source,
            "held": self.held,
            "checks": {"met": met, "owed": owed, "impossible": len(self.impossible)},
            "missing": list(self.missing),
            "compared": [
                {"name": each.name, "found": each.value, "bound": each.bound, "given": own, "agrees": agrees}
                for each, own, agrees in self.against()
            ],
            **{key: plain(getattr(self, key)) for key in ("quantities", "impossible", "found")},
            "frame": self.frame and {"name": self.frame[0], "direction": list(self.frame[1])},
            "notes": list(self.notes),
        }


_ATTITUDE = frozenset({"attitude"})
_DEPTH = _ATTITUDE | {"depth"}
_PLACE = _DEPTH | {"place"}

_MODES: Mapping[int, tuple[str, frozenset[str]]] = {
    0: ("STABILIZE", _ATTITUDE),
    1: ("ACRO", _ATTITUDE),
    2: ("ALT_HOLD", _DEPTH),
    3: ("AUTO", _PLACE),
    4: ("GUIDED", _PLACE),
    7: ("CIRCLE", _PLACE),
    9: ("SURFACE", _DEPTH),
    16: ("POSHOLD", _PLACE),
    19: ("MANUAL", frozenset({"sticks"})),
    20: ("MOTOR_DETECT", frozenset()),
    21: ("SURFTRAK", _DEPTH),
}

CONTROLS: Mapping[str, frozenset[str]] = dict(_MODES.values())
"""What each mode controls; in a mode that is not here anything may be controlled."""

_ARMED, _DISARMED = 10.0, 11.0  # EV.Id


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes and arming of a log over time."""

    begins: Array  #: Times (k,) at which a mode begins, s.
    names: tuple[str, ...]  #: Of the modes.
    switched: Array  #: Times (m,) at which the vehicle was armed or disarmed, s.
    armed: Any  #: Which of the two, (m,) bool.
    start: float = -np.inf  #: Time at which the log begins, s.

    @classmethod
    def of(cls, log: Log, samples: Mapping[str, Samples], begins: Array) -> Modes:
        """Modes and arming that a log names.

        `samples` are its rows of MODE, ARM and EV, `begins` (1,) or (0,) its first time, s.
        """
        changes, names = _changes(log, samples)
        switched, armed = _arming(samples)
        return cls(changes, names, switched, armed, float(begins[0]) if len(begins) else -np.inf)

    def name_at(self, t: Array) -> Any:
        """Name (n,) of the mode at some times; empty before the first one."""
        names = np.array(["", *self.names], dtype=object)
        return names[np.searchsorted(self.begins, t, side="right")]

    def rests(self, t: Array, what: str) -> Any:
        """Where (n,) the mode is known not to control something, or the vehicle is disarmed."""
        idle = np.array([what not in CONTROLS.get(name, {what}) for name in ("", *self.names)])
        return idle[np.searchsorted(self.begins, t, side="right")] | self.disarmed(t)

    def controls(self, t: Array, what: str) -> Any:
        """Where (n,) the mode is known to control something and the vehicle is not disarmed."""
        works = np.array([what in CONTROLS.get(name, ()) for name in ("", *self.names)])
        return works[np.searchsorted(self.begins, t, side="right")] & ~self.disarmed(t)

    def unknown(self, t: Array) -> int:
        """How many of some times lie in modes that are not known; none before the first mode of a log."""
        names = self.name_at(t)
        return int(sum(name not in CONTROLS and (bool(name) or not self.names) for name in names))

    def disarmed(self, t: Array) -> Any:
        """Where (n,) the log says that the vehicle is disarmed, or motors have not spooled up yet."""
        if not len(self.switched):
            return np.zeros(len(t), bool)
        after = np.searchsorted(self.switched, t, side="right")
        # Before the first switch the vehicle was what that switch ended; logs begin with the arming
        # (LOG_DISARMED 0).
        state = np.concatenate([[not self.armed[0]], self.armed])[after]
        last = np.concatenate([[self.start], self.switched])[after]
        return ~state | (t - last < SETTINGS.spool_up_s)


def _changes(log: Log, samples: Mapping[str, Samples]) -> tuple[Array, tuple[str, ...]]:
    """Times at which a mode begins, and its name."""
    if (rows := samples.get("MODE")) is not None and "Mode" in rows.fields:
        numbers = np.asarray(rows.fields["Mode"])
        names = tuple(_MODES[int(k)][0] if k in _MODES else f"mode {k:g}" for k in numbers.tolist())
        return np.asarray(rows.t, float), names
    events = [(event.t, event.text) for event in log.events() if event.kind == "mode"]
    return np.array([t for t, _ in events], float), tuple(name for _, name in events)


def _arming(samples: Mapping[str, Samples]) -> tuple[Array, Any]:
    """Times at which the vehicle was armed or disarmed, and which of the two."""
    if (rows := samples.get("ARM")) is not None and "ArmState" in rows.fields:
        return np.asarray(rows.t, float), np.asarray(rows.fields["ArmState"]) > 0.5
    if (rows := samples.get("EV")) is not None and "Id" in rows.fields:
        event = np.asarray(rows.fields["Id"])
        arming = np.isin(event, (_ARMED, _DISARMED))
        return np.asarray(rows.t, float)[arming], event[arming] == _ARMED
    return np.zeros(0), np.zeros(0, bool)


_TOPICS = (
    "RATE", "PIDR", "PIDP", "PIDY", "PIDA", "ANG", "ATT", "PSCD", "PSCN", "PSCE", "PSOT", "CTUN", "RCIN",
    "RCOU", "MODE", "ARM", "EV",
)  # fmt: skip
"""What the replay reads."""

_TELLS = {
    "sticks": (),
    "attitude": ("PIDR", "PIDP", "PIDY"),
    "depth": ("PSCD", "PIDA"),
    "place": ("PSCN", "PSCE"),
}
"""Topics that are written while something is controlled."""


@dataclass
class Rows:
    """Rows of a topic."""

    t: Array
    values: Mapping[str, Array]

    def __getitem__(self, name: str) -> Array:
        return self.values[name]

    def at(self, t: Array, near_s: float = SETTINGS.near_s) -> tuple[Any, Any]:
        """Rows nearest in time, and whether they are near enough."""
        if len(self.t) < 2:
            return np.zeros(len(t), int), np.zeros(len(t), bool)
        after = np.clip(np.searchsorted(self.t, t), 1, len(self.t) - 1)
        before = after - 1
        nearest = np.where(t - self.t[before] < self.t[after] - t, before, after)
        return nearest, np.abs(self.t[nearest] - t) <= near_s


@dataclass
class Comparison:
    """A log, and what comes of its replay.

    Attributes
    ----------
    log
    known
        Parameters by the names and in the units of 4.7 that the log or a file gives.
    modes
    quantities, found, impossible, notes
        What comes of the replay.
    """

    log: Log
    known: Mapping[str, float] = field(default_factory=dict)
    quantities: list[Quantity] = field(default_factory=list)
    found: list[Found] = field(default_factory=list)
    impossible: list[Impossible] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Read what the replay needs, in one pass, and the times at which the log has rows of controllers."""
        wanted = {name: tuple(self.log.fields[name]) for name in _TOPICS if self.log.fields.get(name)}
        self.samples = self.log.read(wanted)
        own = self.read("RATE", "ROut")
        self.ticks = np.zeros(0) if own is None else own.t
        self.modes = Modes.of(self.log, self.samples, self.ticks[:1])

    def owes(self, what: str) -> bool:
        """Whether the vehicle flew long enough in modes that control something.

        In modes that are not known the topics of the controllers tell.
        """
        if self.modes.unknown(self.ticks) >= SETTINGS.fewest_rows and any(
            t in self.log.fields for t in _TELLS[what]
        ):
            return True
        return int(self.modes.controls(self.ticks, what).sum()) >= SETTINGS.fewest_rows

    def read(self, name: str, *columns: str) -> Rows | None:
        """Rows of a topic without those that are not numbers; None where it has no such columns or no row.

        Without columns its times alone.
        """
        have = self.log.fields.get(name, {})
        if any(column not in have for column in columns) or not have:
            return None
        if not columns:
            rows = self.read(name, next(iter(have)))
            return None if rows is None else Rows(rows.t, {})
        read = self.samples[name]
        finite = np.all([np.isfinite(read.fields[column]) for column in columns], axis=0)
        order = np.argsort(read.t[finite], kind="stable")
        t, first = np.unique(read.t[finite][order], return_index=True)
        if not len(t):
            return None
        return Rows(t, {c: np.asarray(read.fields[c][finite][order][first], float) for c in columns})

    def topic(
        self, name: str, *columns: str, control: str = "", checks: tuple[tuple[str, str], ...] = ()
    ) -> Rows | None:
        """Rows of a topic in which a controller worked; None where there are too few.

        Parameters
        ----------
        name, columns
            Of the topic.
        control
            What the modes must control for rows to count; empty: all rows count.
        checks
            Controller and quantity of the checks that rest on the topic: impossible where it is missing and
            the modes of the log owe them.
        """
        rows = self.read(name, *columns)
        lacking = [column for column in columns if column not in self.log.fields.get(name, {})]
        count_of_all = 0 if rows is None else len(rows.t)
        # Rows of other modes are another controller's.
        if rows is not None and control:
            works = ~self.modes.rests(rows.t, control)
            rows = Rows(rows.t[works], {column: rows[column][works] for column in columns})
        if rows is None or len(rows.t) < SETTINGS.fewest_rows:
            count = 0 if rows is None else len(rows.t)
            what = "no rows" if rows is None and len(lacking) in (0, len(columns)) else f"{count} rows"
            why = f"the log has {what} of {name}"
            # Some columns are there: an older firmware wrote the topic.
            if 0 < len(lacking) < len(columns):
                why = f"{name} of the log has no {', '.join(lacking)}"
            # A check counts as impossible only where some mode of the log would have needed it.
            if self.owes(control or "attitude"):
                self.impossible += [Impossible(*check, why, name) for check in checks]
            elif checks and count_of_all:
                self.notes.append(
                    f"{name}: its rows lie in modes that do not control {control}; they are left out."
                )
            elif checks and not self.modes.names:
                self.notes.append(f"{why[0].upper()}{why[1:]}; what rests on it is not replayed.")
            return None
        self._covers(name, control, rows)
        return rows

    def _covers(self, name: str, control: str, rows: Rows) -> None:
        """Count a topic that is missing for part of the time in which its controller worked."""
        if not control or any(gap.topic == name for gap in self.impossible):
            return
        due = self.ticks[self.modes.controls(self.ticks, control)]
        _, near = rows.at(due, SETTINGS.covers_s)
        if (
            len(due) >= SETTINGS.fewest_rows and near.mean() < 0.9
        ):  # its topic covers less; mode changes cost a row or two
            why = f"{name} covers {100 * near.mean():.0f} % of the time in which the modes control {control}"
            self.impossible.append(Impossible(name, "rows of all its time", why, name, partly=True))

    def cannot(self, controller: str, name: str, why: str) -> None:
        """Count a check that rows do not allow."""
        self.impossible.append(Impossible(controller, name, why))

    def add(
        self,
        check: tuple[str, str],
        unit: str,
        t: Array,
        logged: Array,
        replayed: Array,
        *,
        limit: float | None = None,
        judged: Any = None,
        why: str = "",
    ) -> None:
        """Keep a quantity by controller and name; its limit is a hundredth of what was logged unless given.

        A quantity without `judged` follows from each row alone, and all of its rows are judged.
        """
        exact = judged is None
        rows = np.ones(len(t), bool) if judged is None else judged
        if not rows.any():
            self.cannot(*check, "no row is left to judge by")
            return
        # Logs keep single precision: below a millionth of the largest value nothing is told.
        least = 1e-6 * float(np.abs(logged).max(initial=0.0)) + 1e-9
        within = max(LIMITS["term"] * float(np.std(logged[rows])), least) if limit is None else limit
        self.quantities.append(Quantity(*check, unit, t, logged, replayed, rows, within, why, exact))

    def gain(self, name: str, logged: Array, cause: Array, t: Array, how: str) -> float:
        """Factor between a cause and what it drives on the first half, kept; NaN where none shows."""
        first = t <= np.median(t) if len(t) else np.zeros(0, bool)
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

    def keep(self, parameter: Found) -> None:
        """Keep a parameter; of two axes that share it the first counts, and the other says if it agrees."""
        same = next((own for own in self.found if own.name == parameter.name), None)
        if same is None:
            self.found.append(parameter)
            return
        spread = math.hypot(*(0.0 if math.isnan(each.sd) else each.sd for each in (same, parameter)))
        if not parameter.bound and abs(same.value - parameter.value) > max(
            0.05 * abs(same.value), 3.0 * spread
        ):
            why = f"{same.value:.3g} ({same.how}) and {parameter.value:.3g} ({parameter.how}) differ"
            self.cannot(parameter.name, "one value for both", why)
