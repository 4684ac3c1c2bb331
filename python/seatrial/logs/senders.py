"""Clocks of the senders of a log: their stamps on the clock of the one who received them.

Each computer that writes into a log counts from an origin of its own: its start, or a wrong date. What the
receiver stamps is late by the transmission, and never early; so the origin of a sender is the least
difference between reception and stamp. Message types of a sender share it where their least differences
agree; a type that differs by more than `_SHARED_S` is stamped by another clock, as of a sensor behind the
sender. A counter of limited width begins again at zero (32 bits of microseconds after 71.6 minutes, of
milliseconds after 49.7 days): how often it did the reception tells, to within half a period. A clock that
falls, or jumps ahead of the reception, was started again or set: from there on it has another origin. Held by
``tests/logs/test_senders.py``.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass, field
from typing import Any

_SHARED_S = 2.0
"""Origins of message types that differ by less are one: no link holds every message of a type for longer."""

_FALL_S = 2.0
"""By how far a clock falls that was started again: messages change places by less."""

_JUMP_S = 10.0
"""By how far stamps jump ahead of their reception where a clock was set: a burst of messages does not."""


@dataclass
class Session:
    """Stamps of one message type between two starts of its clock.

    Attributes
    ----------
    sender, stream, first
        Who stamped which messages, and the number of the first one in its stream.
    period_s
        After which the counter begins again; infinite for one that does not.
    reference_s
        Reception less stamp of the first message.
    least_s
        The least of these over all messages.
    count
        Messages.
    origin_s
        Time zero of the clock on the receiver's.
    missed_s
        Periods that the counter lost before the session, s.
    last
        Stamp, unwrapped, and reception of the last message, s.
    """

    sender: Hashable
    stream: Hashable
    first: int
    period_s: float
    reference_s: float
    least_s: float
    count: int
    origin_s: float
    missed_s: float
    last: tuple[float, float]

    def unwrapped(self, stamp: float, received: float) -> float:
        """The stamp, s, with the periods that its counter lost."""
        if not math.isfinite(self.period_s):
            return stamp
        return stamp + self.period_s * round((received - stamp - self.reference_s) / self.period_s)


@dataclass
class SenderClocks:
    """Learns the clocks of the senders from all messages, in the order of the file."""

    _sessions: dict[Hashable, list[Session]] = field(default_factory=dict)
    _counts: Counter[Hashable] = field(default_factory=Counter)

    def learn(
        self, sender: Hashable, stream: Hashable, stamp: float, received: float, period_s: float = math.inf
    ) -> None:
        """Take in a message: its stamp and its reception, s, and the period of its counter."""
        sessions = self._sessions.setdefault(stream, [])
        number = self._counts[stream]
        self._counts[stream] += 1
        if sessions:
            session = sessions[-1]
            t = session.unwrapped(stamp, received)
            ahead = t - session.last[0] - (received - session.last[1])
            if t >= session.last[0] - _FALL_S and ahead <= _JUMP_S:
                session.least_s = min(session.least_s, received - t)
                session.count += 1
                session.last = (t, received)
                return
        late = received - stamp
        sessions.append(
            Session(sender, stream, number, period_s, late, late, 1, late, 0.0, (stamp, received))
        )

    def settle(self) -> None:
        """Give the sessions of one clock one origin; to be called after the last message was learnt."""
        clocks: dict[Hashable, list[list[tuple[Session, float]]]] = {}
        every = [session for sessions in self._sessions.values() for session in sessions]
        # The widest counters first: they know how often the narrow ones began again.
        for session in sorted(every, key=lambda one: (-one.period_s, -one.count)):
            own = clocks.setdefault(session.sender, [])
            for clock in own:
                apart = session.least_s - clock[0][0].least_s
                missed = 0.0  # s that the counter lost before the session
                if math.isfinite(session.period_s):
                    missed = session.period_s * round(apart / session.period_s)
                if abs(apart - missed) < _SHARED_S:
                    clock.append((session, missed))
                    break
            else:
                own.append([(session, 0.0)])
        for clock in (clock for own in clocks.values() for clock in own):
            origin = min(session.least_s - missed for session, missed in clock)
            for session, missed in clock:
                session.origin_s, session.missed_s = origin, missed

    def origins(self) -> Iterator[tuple[Any, Any, float, int]]:
        """Sender, stream, origin in s and number of messages of every session."""
        for sessions in self._sessions.values():
            for session in sessions:
                yield session.sender, session.stream, session.origin_s, session.count

    def replay(self) -> Callable[[Hashable, float, float], float]:
        """Function from stream, stamp and reception to the time in s, for all messages in their order."""
        counts: Counter[Hashable] = Counter()
        places: Counter[Hashable] = Counter()

        def time(stream: Hashable, stamp: float, received: float) -> float:
            sessions = self._sessions[stream]
            place = places[stream]
            if place + 1 < len(sessions) and sessions[place + 1].first == counts[stream]:
                place = places[stream] = place + 1
            counts[stream] += 1
            session = sessions[place]
            return session.origin_s + session.missed_s + session.unwrapped(stamp, received)

        return time
