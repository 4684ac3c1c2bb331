"""Windows: parts of a trial that a model is simulated in from the measured state, and its errors there.

A window starts at the smoothed measured state; its first sample and masked ones do not count. Angles are
compared along the shorter way round. The step is halved until the simulated velocities no longer change: an
error is the model's, not the step's.

Tests: ``tests/trial/test_score.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from seatrial._core import nuisance_names
from seatrial.base.arrays import Array
from seatrial.base.channels import ANGLES, CHANNELS, deviations, difference
from seatrial.base.errors import TrialError
from seatrial.trial.record import Record, Replay, cut_spans, restarted
from seatrial.trial.trial import Input, Trial

if TYPE_CHECKING:
    from seatrial._core import Vehicle

_CONVERGED = 5e-3  # change by halving the step, in standard deviations of the simulated velocity

_MOST_SUBSTEPS = 64


@dataclass(frozen=True, eq=False)
class Window:
    """Samples `start` to `stop` (exclusive) of a trial and the channels simulated there (n, 12), SI.

    With ``own_stamps`` it is compared at the stamps of each sensor instead of the trial's time base.
    """

    trial: Trial
    start: int
    stop: int
    simulated: Array
    own_stamps: bool = False

    def compared(self, channel: str) -> tuple[Array, Array]:
        """Simulated and measured samples (m,) of a channel that count, SI: not the first, no masked one."""
        k = CHANNELS.index(channel)
        if self.own_stamps and channel in self.trial.samples:
            times = self.trial.t[self.start : self.stop]
            t, y = self.trial.samples[channel]
            inside = (t > times[0]) & (t <= times[-1])
            track = self.simulated[:, k]
            with np.errstate(invalid="ignore"):  # a simulation that diverged
                path = np.unwrap(track) if channel in ANGLES else track
            return np.interp(t[inside], times, path), y[inside]
        samples = slice(self.start + 1, self.stop)
        counted = self.trial.valid[samples, k]
        return self.simulated[1:, k][counted], self.trial.observed[samples, k][counted]


def windows(
    trial: Trial, ahead_s: float, *, start_s: float | None = None, stop_s: float | None = None
) -> tuple[list[tuple[int, int]], int, int]:
    """Windows (start, stop) in samples, one following the other, and how many start late or are left out.

    A window starts at a sample where it may (`Trial.startable`), the next one where the last one ended.

    Raises
    ------
    TrialError
        If none can start, or the start is not before the stop.
    """
    if start_s is not None and stop_s is not None and not start_s < stop_s:
        raise TrialError(
            f"{trial.name}: start_s, stop_s: expected a start before the stop, found {start_s:g} s and"
            f" {stop_s:g} s; exchange them"
        )
    first = 0 if start_s is None else int(np.searchsorted(trial.t, start_s - 1e-9))
    last = len(trial) if stop_s is None else int(np.searchsorted(trial.t, stop_s - 1e-9))
    length = last if np.isinf(ahead_s) else max(1, round(ahead_s / trial.dt))
    spans = cut_spans(trial, first, last, length + 1)
    planned = [first, *(stop - 1 for _, stop in spans)]
    late = sum(start > plan for (start, _), plan in zip(spans, planned, strict=False))
    starts = [*(start for start, _ in spans), last - 1]
    left_out = sum((start - plan) // length for start, plan in zip(starts, planned, strict=True))
    if not spans:
        raise TrialError(
            f"{trial.name}: no window can start from {trial.t[0] if start_s is None else start_s:g} s "
            f"to {trial.t[-1] if stop_s is None else stop_s:g} s: every sample there is masked or outside "
            f"the record; see the trial's report{''.join(f': {said}' for said in trial.report.errors[:1])}"
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
    nuisance: Mapping[str, float] | None = None,
) -> list[Window]:
    """Windows of a trial simulated from the smoothed state at their start, channels in SI.

    The step of the record is halved until no velocity changes by more than 0.5 % of its standard deviation.
    Nuisance parameters by name say what the record's sensors and the water add to the motion.

    Raises
    ------
    TrialError
        If the input or the supply voltage that the vehicle needs is not recorded.
    """
    chosen = input or default_input(vehicle, trial)
    _check_inputs(vehicle, trial, chosen)
    record = Record(trial, chosen, trial.valid)
    replay = Replay(vehicle, (record,), tuple(restarted(trial, spans)), free=free, measured=measured)
    row = np.array([[(nuisance or {}).get(name, 0.0) for name in nuisance_names()]])
    result: list[Window] = []
    substeps = 1
    while substeps <= _MOST_SUBSTEPS:
        tracks = replace(replay, substeps=substeps).simulated(nuisance=row)
        coarser = result
        result = [
            Window(trial, start, stop, track) for (start, stop), track in zip(spans, tracks, strict=True)
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
    if trial.voltage_v is None and tables:
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
    with np.errstate(over="ignore", invalid="ignore"):  # a simulation that is about to diverge
        change = np.where(known, a - b, 0.0).std(axis=0)
        return bool(np.all(change <= _CONVERGED * np.where(known, b, 0.0).std(axis=0) + 1e-12))


def channel_errors(name: str, simulated: Sequence[Window]) -> tuple[list[Array], list[Array]]:
    """Simulated minus measured, and measured minus the mean of all, (n,) per window and both in SI.

    Only samples that count are among them: not the first one of a window, no masked one.
    """
    errors, measured = [], []
    for window in simulated:
        predicted, seen = window.compared(name)
        measured.append(seen)
        with np.errstate(invalid="ignore"):  # a simulation that diverged
            errors.append(difference(predicted, seen, name))
    if not any(len(one) for one in measured):
        return errors, measured
    ends = np.cumsum([len(one) for one in measured])
    return errors, np.split(deviations(np.concatenate(measured), name), ends[:-1])
