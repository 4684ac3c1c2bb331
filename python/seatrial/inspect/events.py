"""Events: stretches of a log in which the commands of an axis do not answer the motion.

A routine mission of an autopilot holds open-loop experiments: the rudder at its limit at the beginning of a
leg, a set point that steps, a test of the actuators. There the command changes at once by a good part of its
range and is held after that, whatever waves do.

Tests: ``tests/inspect/test_events.py``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from seatrial.base.arrays import Mask, runs
from seatrial.base.plain import Plain
from seatrial.vehicle.actuators import drivers

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.trial.trial import Trial


@dataclass(frozen=True)
class EventLimits:
    """What counts as an event.

    Attributes
    ----------
    least_s, most_s
        Length, s. Shorter than a wave it is not told from one; after 20 s, four or five time constants of a
        torpedo's turn or a hovering vehicle's drift, nothing new is seen.
    before_s
        How long before its command it begins, s: the angle's slope there is the rate that it starts with.
    held
        Change of a command, over its range, that counts as none: a servo's report trembles by some counts.
    step
        Change of a command, over its range, that begins an event: below it waves move the vehicle more.
    """

    least_s: float = 5.0
    most_s: float = 20.0
    before_s: float = 1.5
    held: float = 0.003
    step: float = 0.15


EVENT_LIMITS = EventLimits()


@dataclass(frozen=True)
class Event(Plain):
    """A stretch of a trial in which the commands of an axis are held.

    Attributes
    ----------
    trial
        Its name.
    axis
        Letter of the axis that the commands push.
    start_s, stop_s
        When the command is held, and when it answers again or the event is long enough.
    command
        What is held, by the first actuator of the axis that moves, in the unit of its command.
    kind
        "limit" where the command is the largest of the trial, "held" elsewhere.
    """

    trial: str
    axis: str
    start_s: float
    stop_s: float
    command: float
    kind: Literal["limit", "held"]


def events(
    trial: Trial, vehicle: Vehicle, axis: str, usable: Mask | None = None, limits: EventLimits = EVENT_LIMITS
) -> tuple[Event, ...]:
    """Events of an axis, a letter among ``XYZKMN``, in the order of time.

    `usable` (n,) are the samples that an event may use, the time before its command included; all when
    omitted.
    """
    names = [
        name
        for name in drivers(vehicle).get(axis, ())
        if name in trial.commands and np.ptp(np.asarray(trial.commands[name], float)) > 0.0
    ]
    if not names:
        return ()
    commands = np.column_stack([np.asarray(trial.commands[name], float) for name in names])
    scaled = commands / np.ptp(commands, axis=0)
    allowed = np.ones(len(trial), dtype=bool) if usable is None else usable
    if trial.silent is not None:  # a command that is not logged is no command that is held
        allowed = allowed & ~trial.silent
    still = allowed & (np.abs(np.diff(scaled, axis=0, prepend=scaled[:1])).max(axis=1) <= limits.held)
    before = max(round(limits.before_s / trial.dt), 1)
    longest = round(limits.most_s / trial.dt)
    stretches = []
    for first, end in runs(still):
        last = min(end, first + longest)
        if first < before or (last - first) * trial.dt < limits.least_s:
            continue
        # Held, and not drifting by a little at every sample; and far from where it was a moment before.
        drifted = np.ptp(scaled[first:last], axis=0).max() > 4.0 * limits.held
        stepped = np.abs(scaled[first - before : first] - scaled[first]).max() >= limits.step
        if drifted or not stepped or not allowed[first - before : first].all():
            continue
        # A simulation has to start before the command changes.
        if not trial.startable[first - before : first].any():
            continue
        command = float(commands[first, 0])
        largest = float(np.abs(commands[:, 0]).max())
        stretches.append(
            Event(
                trial.name,
                axis,
                float(trial.t[first]),
                float(trial.t[last - 1]),
                command,
                "limit" if abs(command) >= (1.0 - limits.held) * largest else "held",
            )
        )
    return tuple(stretches)
