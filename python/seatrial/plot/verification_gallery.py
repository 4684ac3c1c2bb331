"""The figures of a verification: requirements, causes, cross-track error, tracks of the worst missions.

Held by tests/test_verify.py.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterator
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

from seatrial._core import error_edges
from seatrial.plot.cross_track import cross_track
from seatrial.plot.style import save
from seatrial.plot.verification import Verified, cause_bars, verified_requirements
from seatrial.plot.worst_missions import WorstFlight, worst_missions
from seatrial.verification.verification_text import reserve

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from seatrial.verification.judged_requirement import JudgedRequirement
    from seatrial.verification.verification_result import Verification

__all__ = ["verification_figures", "verification_gallery"]

_LIMIT = re.compile(r"\b((?:true_)?cross_track_p95_m) <=? ([0-9.]+)")
_TRUE = "true_cross_track_p95_m"
_MOST_REQUIREMENTS, _MOST_TRACKS = 6, 4
_LONGEST = 50  # letters of a requirement's name in that of a file


def verification_gallery(
    found: Verification, folder: str | Path, *, formats: tuple[str, ...] = ("png", "pdf")
) -> list[Path]:
    """Paths of the figures of a verification after they were written into a folder.

    The worst missions of each requirement that some mission failed are flown again for their tracks.

    Raises
    ------
    SeatrialError
        The folder cannot be written.
    """
    written: list[Path] = []
    for name, figure in verification_figures(found):
        written += save(figure, Path(folder) / name, formats=formats)
    return written


def verification_figures(found: Verification) -> Iterator[tuple[str, Figure]]:
    """Name and figure, one after the other: requirements, cross-track error, causes and worst missions."""
    missions = ", ".join(found.flights.titles)
    rows = [Verified(one.requirement.name, one.found, one.requirement.allowed) for one in found.requirements]
    yield "requirements", verified_requirements(rows, heading=f"{missions}: {len(found.flown)} missions")
    yield "cross_track", _cross_track(found)
    taken: set[str] = set()
    for one in [row for row in found.requirements if row.found.failures][:_MOST_REQUIREMENTS]:
        name = _free(_safe(one.requirement.name), taken)
        taken.add(name)
        yield f"causes_{name}", cause_bars(one.causes, heading=one.requirement.name)
        if one.worst:
            yield f"worst_{name}", _worst(found, one)


def _cross_track(found: Verification) -> Figure:
    """Cross-track error, true and as seen; the missions' p95 of the one that a requirement is about."""
    asked = [limit for one in found.requirements for limit in _LIMIT.findall(one.requirement.holds)]
    # Where requirements ask for both, the true error is what matters.
    figure, limit = max(asked, key=lambda one: one[0] == _TRUE, default=(_TRUE, ""))
    return cross_track(
        found.flown.true_counts,
        error_edges(),
        seen=found.flown.seen_counts,
        p95_m=found.flown.figures[figure],
        of="true" if figure == _TRUE else "as guidance saw it",
        threshold_m=float(limit) if limit else None,
    )


def _worst(found: Verification, one: JudgedRequirement) -> Figure:
    """Tracks of the worst missions, as far as they fly the same mission as the worst of all."""
    same = [run for run in one.worst if run.mission == one.worst[0].mission][:_MOST_TRACKS]
    flights = [
        WorstFlight(
            f"mission {run.number}: {reserve(run.reserve, one.judgement.unit)}", found.replay(run.number)
        )
        for run in same
    ]
    return worst_missions(flights, heading=f"{same[0].mission}, {one.requirement.name}: least reserve")


def _safe(name: str) -> str:
    """Name for a file, short enough for any file system."""
    return "".join(letter if letter.isalnum() else "_" for letter in name)[:_LONGEST]


def _free(name: str, taken: Container[str]) -> str:
    """The name, with a number where another requirement's became the same."""
    numbered = (name if k == 1 else f"{name}_{k}" for k in count(1))
    return next(one for one in numbered if one not in taken)
