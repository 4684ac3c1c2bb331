"""The figures of a tuning: corridors with error areas, responses before and after, margins, search, relay.

Held by tests/test_tune.py.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from seatrial.plot.corridor import InCorridor, corridor_figure
from seatrial.plot.step_responses import Course, SetPointStep, step_responses
from seatrial.plot.style import save
from seatrial.tuning.tuning_file import LOOPS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from seatrial.tuning.judged import Judged, Responses
    from seatrial.tuning.tuning_result import Tuning

__all__ = ["tuning_gallery"]

_LABELS = {
    "surge": "speed ahead u",
    "sway": "sway speed v",
    "heave": "depth z",
    "pitch": "pitch angle",
    "heading": "heading",
    "depth": "depth z",
    "cross_track": "cross-track position",
}
_PANELS = 6


def tuning_gallery(
    tuning: Tuning, folder: str | Path, *, formats: tuple[str, ...] = ("png", "pdf")
) -> list[Path]:
    """Paths of the figures of a tuning after they were written into a folder.

    Raises
    ------
    SeatrialError
        The folder cannot be written.
    """
    written: list[Path] = []
    for name, figure in _figures(tuning):
        written += save(figure, Path(folder) / name, formats=formats)
    return written


def _figures(tuning: Tuning) -> Iterator[tuple[str, Figure]]:
    start, tuned = tuning.of("start"), tuning.of("tuned")
    if start is None or tuned is None:
        return
    for loop in tuned.responses:
        yield f"corridor_{loop}", corridors(start, tuned, loop)
        yield f"responses_{loop}", responses(start, tuned, loop)
    from seatrial.plot.tuning_margins import tuning_margins

    yield (
        "margins",
        tuning_margins(
            tuning.plan.vehicle, (tuning.start, tuning.autopilot), limits=tuning.plan.table.margins
        ),
    )
    if tuning.relay is not None:
        from seatrial.plot.relay import relay_cycles

        yield "relay", relay_cycles(tuning.relay)


def corridors(start: Judged, tuned: Judged, loop: str) -> Figure:
    """Figure of a loop's steps in their corridor: start gains beside tuned ones, a row per speed."""
    shown = []
    for trial in _one_per_speed(tuned.responses[loop]):
        for judged, name in ((start, "start gains"), (tuned, "tuned")):
            own = judged.responses[loop]
            since = own.t - own.trials.settle_s
            rows = (since > -1e-9) & (since < own.trials.until_s - 1e-9)
            speed, size = own.trials.speeds[trial], own.trials.sizes[trial] / LOOPS[loop].to_si
            title = f"{loop} at {speed:.3g} m/s, {size:+.3g} {LOOPS[loop].unit}: {name}"
            shown.append(InCorridor(title, own.trials.corridor, since[rows], own.normalised(trial)[:, rows]))
    return corridor_figure(shown)


def responses(start: Judged, tuned: Judged, loop: str) -> Figure:
    """Figure of a loop's responses over time at several speeds, before and after, with the set points."""
    entry = LOOPS[loop]
    courses = []
    for trial in _one_per_speed(tuned.responses[loop]):
        own, before = tuned.responses[loop], start.responses[loop]
        trials = own.trials
        low = own.base(trial)
        high = low + trials.sizes[trial]
        first, second = trials.settle_s, trials.settle_s + trials.until_s
        set_point = np.where((own.t >= first) & (own.t < second), high, low)
        scale = 1.0 / entry.to_si
        courses.append(
            Course(
                name=f"{loop} at {trials.speeds[trial]:.3g} m/s",
                label=f"{_LABELS[loop]}, {entry.unit}",
                t=own.t,
                set_point=set_point * scale,
                before=before.values[trial] * scale,
                after=own.values[trial] * scale,
                steps=(
                    SetPointStep(first, low * scale, high * scale, trials.corridor),
                    SetPointStep(second, high * scale, low * scale, trials.corridor),
                ),
                down=loop in ("heave", "depth"),
            )
        )
    return step_responses(courses)


def _one_per_speed(of: Responses) -> list[int]:
    """The first trial at each speed, by speed."""
    first: dict[float, int] = {}
    for trial, speed in enumerate(of.trials.speeds):
        first.setdefault(speed, trial)
    return [first[speed] for speed in sorted(first)][:_PANELS]
