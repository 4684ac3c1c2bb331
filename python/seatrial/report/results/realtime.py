"""The words of flights in real time: how the loop kept time, and what went over the link.

Held by ``tests/realtime/test_realtime_flight.py``, ``tests/realtime/test_hardware.py`` and
``tests/realtime/test_sitl.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import singledispatch

import numpy as np

from seatrial.base.report import Report, Section, Table
from seatrial.realtime.ardupilot_link import SitlSession
from seatrial.realtime.flight import RealtimeFlight, Timing
from seatrial.realtime.hardware import HardwareFacts


@singledispatch
def report(result: object) -> Report:
    """Report of a flight in real time."""
    raise TypeError(f"expected a flight in real time, found {type(result).__name__}")


@report.register
def _of_flight(flight: RealtimeFlight) -> Report:
    """Report on the flight and on how it kept time."""
    flown = len(flight.rows) * flight.timing.period_s * flight.speed
    late = flight.timing.quantile(0.99)
    worst = f"99 % of the ticks were at most {1e3 * late:.3f} ms late"
    if flight.timing.overruns:
        worst = f"{flight.timing.overruns} of {len(flight.timing.lateness)} ticks overran; {worst}"
    if flight.hardware is not None:
        worst = f"{link_sentence(flight.hardware)}; {worst}"
    if flight.cause:
        worst = f"{flight.reaction} because of {flight.cause}; {worst}"
    if flight.doubt:
        worst = f"{flight.doubt}; {worst}"
    if flight.went_too_deep:
        deep = (
            f"it went {flight.deepest_m:.2f} m deep; the mission's largest depth is {flight.max_depth_m:g} m"
        )
        worst = f"{deep}; {worst}"
    tables: tuple[Table, ...] = (_ticks(flight.timing),)
    if flight.hardware is not None:
        tables += (_passed_over(flight.hardware.ignored),)
    return Report(
        title=flight.vehicle.name,
        outcome=f"{flight.outcome}, beyond the mission's largest depth"
        if flight.went_too_deep
        else flight.outcome,
        good=f"{flown:.1f} s of motion at {flight.speed:g} times real time; {kept_time(flight.timing)}",
        worst=worst,
        next_step="open the recording in Foxglove, or score the log as a trial",
        sections=(Section("", flight.notes, tables),),
    )


def kept_time(timing: Timing) -> str:
    """Ticks, jitter and overruns in a sentence."""
    return (
        f"{len(timing.lateness)} ticks of {1e3 * timing.period_s:g} ms: half began at most"
        f" {1e3 * timing.quantile(0.5):.3f} ms late, 99 % at most {1e3 * timing.quantile(0.99):.3f} ms,"
        f" the latest {1e3 * timing.quantile(1.0):.2f} ms; {timing.overruns} overruns"
    )


def _ticks(timing: Timing) -> Table:
    """Lateness and work at some quantiles."""
    shares = (0.5, 0.9, 0.99, 1.0)
    rows = [
        [
            f"{100 * share:g} %",
            f"{1e3 * timing.quantile(share):.3f}",
            f"{1e3 * timing.work_quantile(share):.3f}",
        ]
        for share in shares
    ]
    return Table.of("Ticks", ["of the ticks at most", "late, ms", "work, ms"], rows)


def link_sentence(link: HardwareFacts) -> str:
    """What went over the link, in a sentence."""
    lost = "".join(f"; {count} were not sent: {why}" for why, count in sorted(link.unsent.items()))
    if not link.taken:
        strangers = link.ignored.get("stranger", 0)
        others = f"; {strangers} came from another address than the hardware's" if strangers else ""
        return (
            f"{link.sent} packets were sent, no good one came back: the actuators rested at"
            f" neutral{lost}{others}"
        )
    trips = np.array(link.round_trip_s) if link.round_trip_s else np.zeros(1)
    return (
        f"{link.sent} packets sent, {link.taken} taken, {link.lost} lost; round trip"
        f" {1e3 * float(np.median(trips)):.2f} ms in the middle, {1e3 * float(trips.max()):.2f} ms at"
        f" most; the watchdog expired {link.expired} times{lost}"
    )


def _passed_over(ignored: Mapping[str, int]) -> Table:
    """Packets that were passed over, by why."""
    rows = [[why, str(count)] for why, count in sorted(ignored.items())]
    return Table.of("Packets passed over", ["why", "packets"], rows)


@report.register
def _of_link(session: SitlSession) -> Report:
    """Report on the link."""
    if not session.frames:
        good = f"no packet of ArduPilot came in {session.wall_s:.1f} s"
    else:
        good = (
            f"{session.frames} frames, {session.simulated_s:.1f} s of motion in {session.wall_s:.1f} s;"
            f" {session.steps_per_s:.0f} steps per second of work, ArduPilot asked for {session.rate_hz}"
        )
    passed = ", ".join(f"{count} {word}" for word, count in sorted(session.ignored.items()))
    worst = f"packets passed over: {passed}" if passed else "no packet was passed over"
    if not session.frames and not passed:
        worst = "nothing spoke to this port"
    if session.lost:
        worst = f"{session.lost} frames were lost on the way; {worst}"
    if session.frames and session.steps_per_s < session.rate_hz:
        worst = (
            f"slower than real time: {session.steps_per_s:.0f} steps per second of work for {session.rate_hz}"
            f" Hz; lower SIM_RATE_HZ; {worst}"
        )
    following = "use the log as a trial, or fly on"
    if session.ended == "diverged":
        following = "the motion grew beyond all bounds: check the signs of the channels"
    elif not session.frames:
        following = "start ArduPilot with --model JSON:127.0.0.1"
    return Report(
        title=f"sitl {session.mapping.vehicle.name}",
        outcome={"idle": "ended in silence", "frames": "done"}.get(session.ended, session.ended),
        good=good,
        worst=worst,
        next_step=following,
        sections=(
            Section("Channels", tuple(session.notes), (session.mapping.table(),)),
            Section("", (), (_passed_over(session.ignored),)),
        ),
    )
