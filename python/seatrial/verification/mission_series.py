"""Missions flown one chunk after the other: progress, Ctrl-C, and chunks that an earlier run finished.

A chunk is 512 missions: enough to fill the lanes of many threads, few enough that Ctrl-C loses seconds.

Tests: ``tests/test_verify.py``.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.verification.flown_missions import FlownMissions

if TYPE_CHECKING:
    from seatrial.run_directory import StageStore
    from seatrial.verification.campaign_flights import CampaignFlights

__all__ = ["CHUNK", "MissionsFlown", "Series", "fly_series"]

CHUNK = 512
"""Missions between two reports."""


@dataclass(frozen=True)
class MissionsFlown:
    """State of a verification after a chunk.

    ``autopilot`` is what flies ("verified", "start", ...), ``flown`` of ``runs`` missions are done,
    ``left_s`` is the time left, s, ``real_time_factor`` the time flown over the time it took.
    """

    autopilot: str
    flown: int
    runs: int
    elapsed_s: float
    left_s: float
    real_time_factor: float


@dataclass(frozen=True, eq=False)
class Series:
    """Missions flown, None without a single one, and whether Ctrl-C ended them early."""

    flown: FlownMissions | None
    interrupted: bool


def fly_series(
    flights: CampaignFlights,
    runs: int,
    *,
    autopilot: str = "verified",
    store: StageStore | None = None,
    resume: bool = True,
    progress: Callable[[MissionsFlown], None] | None = None,
    threads: int | None = None,
) -> Series:
    """The first missions of a verification; after Ctrl-C those that were finished.

    Parameters
    ----------
    flights : CampaignFlights
    runs : int
    autopilot : str
        What to call the autopilot in reports and in the store.
    store : StageStore, optional
        Where finished chunks are kept and found again.
    resume : bool
        Whether to take chunks from the store.
    progress : callable, optional
        Called after each chunk; it may raise KeyboardInterrupt.
    threads : int, optional
    """
    began, parts, fresh = time.monotonic(), [], 0
    interrupted = False
    try:
        for start in range(0, runs, CHUNK):
            stop = min(start + CHUNK, runs)
            name = f"{autopilot}, missions {start} to {stop - 1}"
            kept = None if store is None or not resume else store.finished(name, flights.digest)
            if kept is not None:
                part = FlownMissions.from_text(kept["missions"])
            else:
                part = flights.fly(np.arange(start, stop), threads=threads)
                fresh += stop - start
            if store is not None:
                store.keep(name, {"inputs": flights.digest, "missions": part.to_text()})
            parts.append(part)
            if progress is not None:
                elapsed = time.monotonic() - began
                flown_s = sum(one.flown_s for one in parts)
                progress(
                    MissionsFlown(
                        autopilot=autopilot,
                        flown=stop,
                        runs=runs,
                        elapsed_s=elapsed,
                        left_s=elapsed * (runs - stop) / max(fresh, 1),
                        real_time_factor=flown_s / max(sum(one.wall_s for one in parts), 1e-9),
                    )
                )
    except KeyboardInterrupt:
        interrupted = True
    return Series(FlownMissions.joined(parts) if parts else None, interrupted)
