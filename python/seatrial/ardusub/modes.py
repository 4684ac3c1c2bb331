"""Modes of flight of ArduSub in a log: which controllers worked when, and when the vehicle was armed.

What a mode controls decides which checks a log owes: in MANUAL sticks pass to the mixer and the controllers
rest, STABILIZE and ACRO control the attitude, ALT_HOLD and its kin the depth as well, POSHOLD and the
guided modes also the place. Source: ArduSub's documentation, "Flight modes". Held by
``tests/ardusub/test_motors.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.logs.log import Log, Samples

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

_SPOOLS_S = 1.0  # after arming, until motors follow the mixer: MOT_SPOOL_TIME is 0.5 s unless it is set

_ARMED, _DISARMED = 10.0, 11.0  # EV.Id


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes and arming of a log over time.

    Attributes
    ----------
    begins
        Times (k,) at which a mode begins, s.
    names
        Of the modes.
    switched
        Times (m,) at which the vehicle was armed or disarmed, s.
    armed
        Which of the two, (m,) bool.
    start
        Time at which the log begins, s.
    """

    begins: Array
    names: tuple[str, ...]
    switched: Array
    armed: Any
    start: float = -np.inf

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
        return ~state | (t - last < _SPOOLS_S)


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
