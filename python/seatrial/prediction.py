"""Open-loop prediction of a trial: windows simulated from the smoothed measured state at their start.

The step is halved until the simulated velocities no longer change: a score is the model's, not the step's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.errors import TrialError
from seatrial.trial import Input, Trial

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["Window", "default_input", "predict", "windows"]

Array = NDArray[np.float64]

_CONVERGED = 5e-3  # change by halving the step, in standard deviations of the simulated velocity
_MOST_SUBSTEPS = 64


@dataclass(frozen=True, eq=False)
class Window:
    """Samples `start` to `stop` (exclusive) of a trial and the channels simulated there (n, 12), SI."""

    trial: Trial
    start: int
    stop: int
    simulated: Array


def windows(
    trial: Trial, ahead_s: float, *, start_s: float | None = None, stop_s: float | None = None
) -> tuple[list[tuple[int, int]], int, int]:
    """Windows (start, stop) in samples, one following the other, and how many start late or are left out.

    A window starts at a sample where it may (`Trial.startable`), the next one where the last one ended.

    Raises
    ------
    TrialError
        If none can start.
    """
    first = 0 if start_s is None else int(np.searchsorted(trial.t, start_s - 1e-9))
    last = len(trial) if stop_s is None else int(np.searchsorted(trial.t, stop_s - 1e-9))
    length = last if np.isinf(ahead_s) else max(1, round(ahead_s / trial.dt))
    starts = np.flatnonzero(trial.startable)
    spans: list[tuple[int, int]] = []
    late = left_out = 0
    planned = first
    while planned < last - 1:
        following = starts[np.searchsorted(starts, planned) :]
        start = int(following[0]) if len(following) else last
        left_out += (min(start, last - 1) - planned) // length
        if start >= last - 1:
            break
        late += start > planned
        stop = min(start + length + 1, last)
        spans.append((start, stop))
        planned = stop - 1
    if not spans:
        raise TrialError(
            f"{trial.name}: no window can start from {trial.t[0] if start_s is None else start_s:g} s "
            f"to {trial.t[-1] if stop_s is None else stop_s:g} s: every sample there is masked or outside "
            "the record; see the trial's report"
        )
    return spans, late, left_out


def default_input(vehicle: Vehicle, trial: Trial) -> Input:
    """What drives the vehicle in this trial: its commands, else measured signals, else the recorded wrench.

    Raises
    ------
    TrialError
        If none is recorded for this vehicle's actuators.
    """
    for name, recorded in (("commands", trial.commands), ("measured", trial.measured)):
        if vehicle.actuators and all(actuator in recorded for actuator in vehicle.actuators):
            return "commands" if name == "commands" else "measured"
    if trial.tau is not None:
        return "tau"
    missing = [actuator for actuator in vehicle.actuators if actuator not in trial.commands]
    raise TrialError(
        f"{trial.name}: nothing drives the vehicle {vehicle.name}: expected commands of all its "
        f"actuators, their measured signals or a wrench; no column cmd.{', cmd.'.join(missing)}"
    )


def predict(
    vehicle: Vehicle,
    trial: Trial,
    spans: Sequence[tuple[int, int]],
    *,
    input: Input | None = None,
    free: str = "XYZKMN",
    measured: str = "",
) -> list[Window]:
    """Windows of a trial simulated from the smoothed state at their start, channels in SI.

    The step of the record is halved until no velocity changes by more than 0.5 % of its standard deviation.

    Raises
    ------
    TrialError
        If the input or the supply voltage that the vehicle needs is not recorded.
    """
    from seatrial._core import OpenLoop

    chosen = input or default_input(vehicle, trial)
    _check_inputs(vehicle, trial, chosen)
    segments = [(0, start, stop, *trial.state(start)) for start, stop in spans]
    result: list[Window] = []
    substeps = 1
    while substeps <= _MOST_SUBSTEPS:
        record = trial.record(substeps=substeps, input=chosen, motion=bool(measured))
        loop = OpenLoop(vehicle, [record], segments, free=free, measured=measured, substeps=substeps)
        tracks = loop.predict(np.zeros(0))
        coarser = result
        result = [
            Window(trial, start, stop, np.asarray(track))
            for (start, stop), track in zip(spans, tracks, strict=True)
        ]
        if coarser and _converged(coarser, result):
            break
        substeps *= 2
    return result


def _check_inputs(vehicle: Vehicle, trial: Trial, chosen: Input) -> None:
    if chosen == "tau":
        return
    recorded = trial.commands if chosen == "commands" else trial.measured
    column = "cmd" if chosen == "commands" else "meas"
    missing = [actuator for actuator in vehicle.actuators if actuator not in recorded]
    if missing:
        raise TrialError(
            f"{trial.name}: the vehicle {vehicle.name} has actuators without a recorded signal: "
            f"{', '.join(missing)}; map the columns {column}.{missing[0]} ..."
        )
    tables = any(facts["needs_voltage"] for facts in vehicle.actuator_info().values())
    if trial.voltage is None and tables:
        raise TrialError(
            f"{trial.name}: the thrust tables of the vehicle {vehicle.name} depend on the supply voltage, "
            'which is not recorded; map the column voltage_v, or use input="tau"'
        )


def _converged(coarser: Sequence[Window], finer: Sequence[Window]) -> bool:
    """Whether no simulated velocity changed noticeably; what diverges with every step counts as converged."""
    a = np.concatenate([window.simulated[:, :6] for window in coarser])
    b = np.concatenate([window.simulated[:, :6] for window in finer])
    known = np.isfinite(a) & np.isfinite(b)
    if not np.array_equal(np.isfinite(a), np.isfinite(b)):
        return False
    change = np.where(known, a - b, 0.0).std(axis=0)
    return bool(np.all(change <= _CONVERGED * np.where(known, b, 0.0).std(axis=0) + 1e-12))
