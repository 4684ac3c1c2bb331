"""Figures of a tuning: corridors with error areas, responses before and after, speeds, margins.

Of the trials of a loop at a speed the one is drawn that the tuned gains hold least. Held by
`tests/report/test_tuning_gallery.py`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.control_design.tuning_table import LOOPS
from seatrial.report.plot.corridors import Course, InCorridor, SetPointStep, corridor_figure, step_responses
from seatrial.report.plot.style import save

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from seatrial.tuning.performance import Performance, Responses
    from seatrial.tuning.result import Tuning

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

_SPEEDS_ON_A_PAGE = 3  # in the figure of corridors

_BEFORE_S = 5.0  # of the settling that is drawn before the first step

_MINUS = "\N{MINUS SIGN}"


def tuning_gallery(
    tuning: Tuning,
    folder: str | Path,
    *,
    formats: tuple[str, ...] = ("png",),
    loops: Collection[str] | None = None,
) -> list[Path]:
    """Paths of the figures of a tuning after they were written into a folder.

    Parameters
    ----------
    tuning : Tuning
    folder : str or Path
    formats : tuple of str, optional
        Endings of the files.
    loops : collection of str, optional
        Loops and paths whose corridors and responses are drawn; all by default.

    Raises
    ------
    SeatrialError
        The folder cannot be written.
    """
    written: list[Path] = []
    for name, figure in _figures(tuning, loops):
        written += save(figure, Path(folder) / name, formats=formats)
    return written


def _figures(tuning: Tuning, loops: Collection[str] | None) -> Iterator[tuple[str, Figure]]:
    start, tuned = tuning.of("start"), tuning.of("tuned")
    if start is None or tuned is None:
        return
    for loop in tuned.responses if loops is None else [name for name in tuned.responses if name in loops]:
        for page, figure in enumerate(corridors(start, tuned, loop), 1):
            yield _paged(f"corridor_{loop}", page), figure
        yield f"responses_{loop}", responses(start, tuned, loop)
    if "surge" in tuned.responses:
        from seatrial.report.plot.corridors import speed_steps

        yield "speeds", speed_steps(tuning.plan, tuning.start, tuning.autopilot)
    from seatrial.report.plot.margins import tuning_margins

    yield (
        "margins",
        tuning_margins(
            tuning.plan.vehicle,
            (tuning.start, tuning.autopilot),
            limits=tuning.plan.table.margins,
            sensors=tuning.plan.sensors,
        ),
    )


def _paged(name: str, page: int) -> str:
    """Name of a figure that may need several pages."""
    return name if page == 1 else f"{name}_{page}"


def corridors(start: Performance, tuned: Performance, loop: str) -> Iterator[Figure]:
    """Figures of a loop's steps in their corridor, there and back: start gains beside tuned ones.

    Each fits on a page.
    """
    trials = _one_per_speed(tuned, start, loop)
    for first in range(0, len(trials), _SPEEDS_ON_A_PAGE):
        yield _corridors(start, tuned, loop, trials[first : first + _SPEEDS_ON_A_PAGE])


def _corridors(start: Performance, tuned: Performance, loop: str, trials: list[int]) -> Figure:
    """Figure of some trials of a loop in their corridor."""
    shown = []
    for trial in trials:
        for performance, name in ((start, "start gains"), (tuned, "tuned")):
            own = performance.responses[loop]
            since = own.t - own.trials.settle_s
            until = own.trials.until_s
            rows = (since > -1e-9) & (since < until - 1e-9)
            back = (since > until - 1e-9) & (since < 2.0 * until - 1e-9)
            answers = own.normalised(trial)
            both = np.concatenate([answers[:, rows], 1.0 - answers[:, back]])
            title = f"{_step(own, trial, loop)}: {name}"
            shown.append(InCorridor(title, own.trials.corridor, since[rows], both, each="steps"))
    return corridor_figure(shown)


def responses(start: Performance, tuned: Performance, loop: str) -> Figure:
    """Figure of a loop's responses over time at several speeds, before and after, with the set points."""
    entry = LOOPS[loop]
    courses = []
    for trial in _one_per_speed(tuned, start, loop):
        own, before = tuned.responses[loop], start.responses[loop]
        trials = own.trials
        low = own.base(trial)
        high = low + trials.sizes[trial]
        first = trials.settle_s
        set_point = np.where((own.t >= first) & (own.t < first + trials.until_s), high, low)
        scale = 1.0 / entry.to_si
        shown = own.t > first - _BEFORE_S
        courses.append(
            Course(
                name=_step(own, trial, loop),
                label=f"{_LABELS[loop]}, {entry.unit}",
                t=own.t[shown] - first,
                set_point=set_point[shown] * scale,
                before=_unbroken(before.values[trial][:, shown] * scale, entry.unit),
                after=_unbroken(own.values[trial][:, shown] * scale, entry.unit),
                steps=(
                    SetPointStep(0.0, low * scale, high * scale, trials.corridor),
                    SetPointStep(trials.until_s, high * scale, low * scale, trials.corridor),
                ),
                down=loop in ("heave", "depth"),
                remark=_tells(start, loop, trial),
            )
        )
    return step_responses(courses)


def _step(of: Responses, trial: int, loop: str) -> str:
    """Loop, speed and step of a trial, for a title."""
    entry = LOOPS[loop]
    size = of.trials.sizes[trial] / entry.to_si
    numbers = f"{of.trials.speeds[trial]:.3g} m/s, {size:+.3g} {entry.unit}".replace("-", _MINUS)
    return f"{loop.replace('_', '-')} at {numbers}"


def _tells(start: Performance, loop: str, trial: int) -> str:
    """How far the start gains leave the corridor, for the right of a title."""
    own = [trial_of for trial_of in start.trials if trial_of.loop == loop][trial]
    if not np.isfinite(own.nominal_s):
        return "start gains: diverge"
    size = f"{own.nominal_s:.2g}" if own.nominal_s < 100.0 else f"{own.nominal_s:.0f}"
    return f"start gains: outside by {size} s" if own.nominal_s > 0.0 else ""


def _unbroken(values: Array, unit: str) -> Array:
    """Values (k, p) with a gap where an angle jumps from one end of the circle to the other."""
    if unit != "deg":
        return values
    jumps = np.abs(np.diff(values, axis=1, prepend=values[:, :1])) > 180.0
    return np.where(jumps, np.nan, values)


def _one_per_speed(tuned: Performance, start: Performance, loop: str) -> list[int]:
    """The trial at each speed that the tuned gains, and then the start gains, violate most, by speed."""
    own = [[trial for trial in performance.trials if trial.loop == loop] for performance in (tuned, start)]
    violated = [tuple(-performance[k].worst_s for performance in own) for k in range(len(own[0]))]
    worst: dict[float, int] = {}
    for trial in sorted(range(len(violated)), key=violated.__getitem__):
        worst.setdefault(own[0][trial].speed_m_s, trial)
    return [worst[speed] for speed in sorted(worst)][:_PANELS]
