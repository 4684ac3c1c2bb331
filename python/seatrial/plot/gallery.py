"""The figures of an identification: vehicle, convergence, certainty, criticism, every trial."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.campaign_file import AXES
from seatrial.errors import TrialError
from seatrial.plot.characteristic_curve import characteristic
from seatrial.plot.comparison import measured_against_simulated
from seatrial.plot.intervals import intervals
from seatrial.plot.model_criticism import model_criticism
from seatrial.plot.search_history import convergence
from seatrial.plot.style import save, tidy
from seatrial.plot.views import three_views
from seatrial.recording.columns import CHANNELS
from seatrial.score import score

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from seatrial.identification import Identification

__all__ = ["gallery"]

AHEAD_S = 10.0


def gallery(
    fit: Identification, folder: str | Path, *, formats: tuple[str, ...] = ("png", "pdf")
) -> list[Path]:
    """Paths of the figures of an identification after they were written into a folder.

    Raises
    ------
    SeatrialError
        The folder cannot be written.
    """
    folder = Path(folder)
    written: list[Path] = []
    for name, figure in _figures(fit):
        written += save(figure, folder / name, formats=formats)
    return written


def _figures(fit: Identification) -> Iterator[tuple[str, Figure]]:
    yield "vehicle", three_views(fit.vehicle)
    if fit.vehicle.actuators:
        yield "characteristic", characteristic(fit.vehicle)
    if fit.stages:
        yield "convergence", convergence(fit.stages)
    if fit.certainty is not None:
        yield "intervals", intervals(fit.certainty)
        yield "criticism", model_criticism(fit.certainty.criticism)
    for trial in fit.campaign.trials:
        try:
            yield f"trial_{trial}", trial_figure(fit, trial)
        except TrialError:  # such a trial is named among the notes of the identification
            continue


def trial_figure(fit: Identification, name: str) -> Figure:
    """Figure of one trial of an identification, simulated ten seconds ahead again and again.

    The channels are the velocities (and those that a stage weighs) of the axes that were freed on this
    trial, or of all that any stage freed where the trial is held out as a whole.

    Raises
    ------
    TrialError
        No window can start, or an input is missing.
    """
    campaign = fit.campaign
    trial = campaign.trials[name]
    free = "".join(axis for axis in AXES if any(axis in stage.axes.free for stage in campaign.stages))
    own = [stage for stage in campaign.stages if name in stage.trials] or list(campaign.stages)
    shown = {CHANNELS[AXES.index(axis)] for stage in own for axis in stage.axes.free}
    if name in {trial for stage in own for trial in stage.trials}:
        shown |= {channel for stage in own for channel in stage.weights()}
    channels = [channel for channel in CHANNELS if channel in shown and channel in trial.channels]
    simulated = score(
        fit.vehicle,
        trial,
        ahead_s=AHEAD_S,
        channels=channels,
        input=campaign.input_of(name),
        free=free,
        measured="".join(axis for axis in AXES if axis not in free),
    )
    held_out = campaign.held_out(name)
    remark = " (held out as a whole)" if held_out.all() else ""
    return measured_against_simulated(
        trial,
        simulated.windows,
        channels=channels,
        titles={channel: _scores(fit, name, channel) for channel in channels},
        held_out=None if held_out.all() else held_out,
        heading=f"{fit.vehicle.name}, trial {name}{remark}: {AHEAD_S:g} s ahead from the measured state",
    )


def _scores(fit: Identification, trial: str, channel: str) -> str:
    """Scores of a channel as they stand in the title of its panel."""
    words = []
    for part, label in (("hold_out", "held out"), ("fit", "fit")):
        found = []
        for kind, remark in (("ahead", f"{AHEAD_S:g} s ahead"), ("free", "free run")):
            row = fit.scores.get(part, {}).get(kind, {}).get(trial)
            if row is not None and channel in row and row[channel].n > 1:
                found.append(f"{tidy(row[channel].r2)} ({remark})")
        if found:
            words.append(f"{label} R\N{SUPERSCRIPT TWO} {', '.join(found)}")
    return "  |  ".join(words)
