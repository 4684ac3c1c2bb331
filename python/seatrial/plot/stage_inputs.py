"""Inputs of a stage: the commands behind its trials, one trial after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.parameters import actuator_groups
from seatrial.plot.style import SECOND, SIMULATED, THIRD, panel_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from seatrial.identification import Identification
    from seatrial.prediction import Window
    from seatrial.trial import Trial

__all__ = ["Input", "Piece", "draw_inputs", "moving_inputs"]

Array = NDArray[np.float64]

_NAMED = 4
"""Inputs that are told apart; more are drawn alike."""


@dataclass(frozen=True, eq=False)
class Piece:
    """A trial of the stage: where it stands on the common time axis, and its windows per model."""

    name: str
    trial: Trial
    shift: float
    windows: list[list[Window]]


@dataclass(frozen=True, eq=False)
class Input:
    """A signal (n,) over times (n,) in s on the common axis, NaN between trials, in its own unit."""

    unit: str
    t: Array
    signal: Array


def moving_inputs(fit: Identification, pieces: Sequence[Piece]) -> dict[str, Input]:
    """Commands that move, by group where all of it moves alike, else by the actuators that do."""
    facts = fit.vehicle.actuator_info()
    driven: dict[str, Input] = {}
    times = np.concatenate([np.append(piece.trial.t + piece.shift, np.nan) for piece in pieces])
    for group, members in actuator_groups(fit.vehicle).items():
        alike: dict[bytes, tuple[list[str], Array]] = {}
        for name in members:
            signal = np.concatenate([np.append(_signal(fit, piece, name), np.nan) for piece in pieces])
            if np.nanmax(np.abs(signal - float(facts[name]["neutral"])), initial=0.0) > 0.0:
                alike.setdefault(signal.tobytes(), ([], signal))[0].append(name)
        for names, signal in alike.values():
            whole = group if len(names) == len(members) and group else ", ".join(names)
            driven[whole] = Input(str(facts[names[0]]["unit"]), times, signal)
    return driven


def _signal(fit: Identification, piece: Piece, actuator: str) -> Array:
    source = fit.campaign.input_of(piece.name)
    recorded = {"commands": piece.trial.commands, "measured": piece.trial.measured}.get(source, {})
    return np.asarray(recorded.get(actuator, np.full(len(piece.trial.t), np.nan)))


def draw_inputs(axes: Axes, inputs: dict[str, Input]) -> None:
    """Draw the inputs over time; of many actuators only the number is named."""
    few = len(inputs) <= _NAMED
    styles = zip(("#262626", THIRD, SIMULATED, SECOND) * 8, ("-", "--", "-.", ":") * 8, strict=True)
    for (name, one), (colour, dashes) in zip(inputs.items(), styles, strict=False):
        if few:
            axes.step(
                one.t, one.signal, where="post", color=colour, linestyle=dashes, linewidth=0.9, label=name
            )
        else:
            axes.step(one.t, one.signal, where="post", color="#262626", linewidth=0.35, alpha=0.6)
    units = {one.unit.replace("us", "\N{MICRO SIGN}s") for one in inputs.values()}
    axes.set_ylabel(" or ".join(sorted(units)))
    axes.locator_params(axis="y", nbins=4)
    panel_title(axes, "inputs", "" if few else f"{len(inputs)} actuators")
    if few:
        axes.legend(
            loc="lower right", bbox_to_anchor=(1.0, 0.97), ncols=len(inputs), borderaxespad=0.0, fontsize=7
        )
