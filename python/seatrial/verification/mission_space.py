"""Missions as points: the numbers behind everything that is drawn, for searches that walk among missions.

Current, waves, start, which actuator fails and when, outages, offsets of sensors and the coefficients are
standard normal numbers behind their distributions; the seed of noise and gusts stays a seed.

Tests: ``tests/verification/test_rare.py``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial._core import autopilot_names
from seatrial.base.arrays import Array
from seatrial.base.work import Clock, Progress
from seatrial.verification.draws import COMMON_WIDTH, SEED_COLUMN, Draws, composed, scattered
from seatrial.verification.failure_draws import FAULT_WIDTH, OUTAGE_WIDTH
from seatrial.verification.judgement import robustness

if TYPE_CHECKING:
    from seatrial.identification.fitted import Fitted
    from seatrial.verification.missions import CampaignFlights
    from seatrial.verification.requirement import Requirement

_BATCH = 512  # missions in memory at once


@dataclass(frozen=True, eq=False)
class MissionSpace:
    """Missions of a campaign by standard normal numbers (d) and the seed of their noise.

    `flights`: what the campaign flies.
    """

    flights: CampaignFlights

    @cached_property
    def fitted(self) -> Fitted:
        """The vehicle with the uncertainty of its coefficients."""
        return scattered(self.flights.table, self.flights.fitted)

    @cached_property
    def offset(self) -> NDArray[np.intp]:
        """Channels of the sensors that have an offset."""
        return np.flatnonzero(self.flights.sensor_offsets)

    @cached_property
    def widths(self) -> tuple[int, int, int, int, int]:
        """Numbers of what every case has, of faults, outages, offsets of sensors and coefficients."""
        table = self.flights.table
        return (
            COMMON_WIDTH - 1,
            FAULT_WIDTH * len(table.faults),
            OUTAGE_WIDTH * len(table.outages),
            len(self.offset),
            len(self.fitted.names),
        )

    @property
    def dimensions(self) -> int:
        """Numbers of a mission, besides its seed."""
        return sum(self.widths)

    def possible(self, x: Array) -> NDArray[np.bool_]:
        """Which samples (k, d) have a vehicle that can be."""
        return self.fitted.at(x[:, self.dimensions - self.widths[-1] :])[1]

    def draws(self, x: Array, seeds: Array) -> Draws:
        """Missions of samples (k, d) and seeds (k,) from 0 to 1."""
        from scipy.special import ndtr

        common, faults, outages, offset, normals = np.split(x, np.cumsum(self.widths[:-1]), axis=1)
        tiny = 2.0**-54
        uniform = [np.clip(ndtr(part), tiny, 1.0 - tiny) for part in (common, faults, outages)]
        offsets = np.zeros((len(x), len(self.flights.sensor_offsets)))
        offsets[:, self.offset] = offset
        drawn = composed(
            self.flights.table,
            self.fitted,
            self.flights.missions,
            numbers=range(len(x)),
            coefficients=self.fitted.at(normals)[0],
            common=np.insert(uniform[0], SEED_COLUMN, np.clip(seeds, tiny, 1.0 - tiny), axis=1),
            faults=uniform[1],
            outages=uniform[2],
        )
        names = autopilot_names()["channels"]
        causes = {f"offset of the measured {names[c]}, sigmas": offsets[:, c] for c in self.offset}
        return replace(drawn, offsets=offsets, causes={**drawn.causes, **causes})

    def robustness(
        self, requirement: Requirement, x: Array, seeds: Array, *, threads: int | None = None
    ) -> Array:
        """Robustness (k,) of a requirement on the missions of samples."""
        found = []
        for start in range(0, len(x), _BATCH):
            rows = slice(start, start + _BATCH)
            flown = self.flights.fly_drawn(self.draws(x[rows], seeds[rows]), threads=threads)
            found.append(robustness(requirement, flown, self.flights))
        return np.concatenate(found) if found else np.zeros(0)


def watched(
    progress: Callable[[Progress], None] | None, clock: Clock, requirement: str, place: int, count: int
) -> Callable[[float, str], None]:
    """What the search of a requirement, one of `count` from 0, reports: as progress of the whole."""

    def watch(share: float, detail: str) -> None:
        if progress is None:
            return
        fraction = (place + share) / count
        left = clock.elapsed_s * (1.0 - fraction) / max(fraction, 1e-6)
        progress(Progress(requirement, place, count, fraction, clock.elapsed_s, left, detail=detail))

    return watch
