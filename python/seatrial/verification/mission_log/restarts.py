"""Predictions of a log in windows restarted every few seconds: what the model says with the logged commands.

A closed loop hides errors of its model: the autopilot pushes harder, and the path is kept. It cannot hide
that the commands which it gave do not belong to the motion that followed. Windows restarted from the
smoothed log every `ahead_s` and driven by the logged commands show that, in closed and in open loop alike.

Derivatives by coefficients, by a steady current and by the state at each restart are exact (dual numbers of
the core). Residuals are measured minus predicted, SI; angles the shorter way round.

Tests: ``tests/verification/test_recorded_validity.py``, ``tests/verification/test_recorded_suspects.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from seatrial._core import initial_names
from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import AXES, CHANNELS
from seatrial.base.errors import TrialError
from seatrial.scoring.record import Record, Replay, restarted
from seatrial.scoring.windows import default_input, predict, windows
from seatrial.trial.trial import Input

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.trial.trial import Trial

FEWEST = 8
"""Fewer samples per window tell nothing of how an error grows."""

_SUBSTEP_S = 0.05
"""Longest step of the integration; the rates of vehicles of a metre and more stay well below its inverse."""

_STEEP = math.radians(70.0)
"""Pitch beyond which roll and yaw do not count."""


@dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives of what one window shows, (n, 12, d) by directions and (n, 12, 12) by its start."""

    by_direction: Array
    by_start: Array


@dataclass(frozen=True, eq=False)
class PredictedLog:
    """A log cut into windows, and what a vehicle predicts in them.

    Attributes
    ----------
    replay
        The log's windows as the model replays them.
    predicted, residual
        Per window (n, 12), SI: what the vehicle shows, and measured minus that, zero where it does not count.
    """

    replay: Replay
    predicted: tuple[Array, ...]
    residual: tuple[Array, ...]

    @property
    def vehicle(self) -> Vehicle:
        """The model."""
        return self.replay.vehicle

    @property
    def trial(self) -> Trial:
        """The log."""
        return self.replay.records[0].trial

    @property
    def input(self) -> Input:
        """What drives the vehicle: "commands", "measured" or "tau"."""
        return self.replay.records[0].input

    @property
    def spans(self) -> tuple[tuple[int, int], ...]:
        """First sample of every window, and one past its last."""
        return tuple((one.start, one.stop) for one in self.replay.segments)

    @cached_property
    def counted(self) -> tuple[Mask, ...]:
        """Samples (n, 12) of every window that count: not the first, no masked one."""
        return tuple(self.replay.counted(index) for index in range(len(self.replay.segments)))

    @property
    def channels(self) -> list[str]:
        """Channels of which any sample counts, in the order of `CHANNELS`."""
        any_of = np.logical_or.reduce([mask.any(axis=0) for mask in self.counted])
        return [name for name, here in zip(CHANNELS, any_of, strict=True) if here]

    def since_restart(self, window: int) -> Array:
        """Times (n,) since the restart of a window, s."""
        first, last = self.spans[window]
        return np.asarray((np.arange(last - first)) * self.trial.dt)

    def times(self, window: int) -> Array:
        """Times (n,) of a window in the log's own time, s."""
        return np.asarray(self.trial.t[slice(*self.spans[window])])

    def of(self, changes: Mapping[str, float]) -> list[Array]:
        """Residuals (n, 12) of every window for the vehicle with other coefficients, SI."""
        return replace(self.replay, names=tuple(changes)).residuals(list(changes.values()))

    def in_water(self, current: Array) -> PredictedLog:
        """The same windows in another steady current (2,) or (3,), north, east, down, m/s."""
        water = np.tile(np.append(current, 0.0)[:3], (len(self.trial), 1))
        record = replace(self.replay.records[0], trial=replace(self.trial, current=water))
        replay = replace(self.replay, records=(record,))
        shown = replay.simulated()
        return PredictedLog(replay, tuple(shown), tuple(replay.errors_of(shown)))

    def without(self, axes: str) -> PredictedLog:
        """The same windows, of which no channel of these axes (letters) counts."""
        if not axes:
            return self
        record = self.replay.records[0]
        counted = record.counted.copy()
        counted[:, [place for place in range(len(CHANNELS)) if AXES[place % 6] in axes]] = False
        replay = replace(self.replay, records=(replace(record, counted=counted),))
        return PredictedLog(replay, self.predicted, tuple(replay.errors_of(self.predicted)))

    def slopes(
        self, directions: Sequence[Mapping[str, float]], *, current: bool = False
    ) -> tuple[Slopes, ...]:
        """Derivatives per window by directions of the coefficients, then by a current north and east.

        A direction holds the changes of coefficients that go with one unit of it. With `current` two more
        columns tell of a steady current, m/s.
        """
        names = sorted({name for direction in directions for name in direction})
        present = self.vehicle.coefficients()
        rows = np.array([[one.get(name, 0.0) for name in names] for one in directions], dtype=float)
        nuisances = ["current_north", "current_east"] if current else []
        found = replace(self.replay, names=tuple(names)).sensitivities(
            np.array([present.get(name, 0.0) for name in names]),
            rows.reshape(len(directions), len(names)),
            nuisances=nuisances,
            initials=initial_names(),
        )
        count = len(directions) + len(nuisances)
        return tuple(Slopes(slope[:, :, :count], slope[:, :, count:]) for _, slope in found)


def restarts(
    vehicle: Vehicle,
    trial: Trial,
    *,
    ahead_s: float = 10.0,
    start_s: float | None = None,
    stop_s: float | None = None,
    input: Input | None = None,
) -> PredictedLog:
    """Windows of a log and what a vehicle predicts in them.

    Parameters
    ----------
    vehicle : Vehicle
    trial : Trial
    ahead_s : float, optional
        Length of a window, s.
    start_s, stop_s : float, optional
        Part of the log, in its own time; all of it when omitted.
    input : str, optional
        What drives the vehicle; the first that is recorded when omitted.

    Raises
    ------
    TrialError
        No window can start, or an input or the supply voltage is missing.

    Examples
    --------
    >>> import numpy as np
    >>> import seatrial as st
    >>> vehicle, t = st.Vehicle.load("cwolf"), np.arange(0.0, 30.0, 0.1)
    >>> commands = {name: np.where(t < 2.0, 0.0, 800.0) for name in vehicle.actuators}
    >>> run = vehicle.simulate(t, commands)
    >>> trial = st.Trial.read(
    ...     {"t_s": t, "u_m_s": run.nu[:, 0]} | {f"cmd.{name}": signal for name, signal in commands.items()}
    ... )
    >>> len(restarts(vehicle, trial, ahead_s=10.0).spans)
    3
    """
    chosen = input or default_input(vehicle, trial)
    check_usable(trial, ahead_s)
    trial = under_water(trial, vehicle, start_s=start_s, stop_s=stop_s)
    spans, _, _ = windows(trial, ahead_s, start_s=start_s, stop_s=stop_s)
    # The last window may be a stump of a few samples, which tells nothing.
    full = max(last - first for first, last in spans)
    spans = [span for span in spans if span[1] - span[0] > full // 2] or spans
    found = predict(vehicle, trial, spans, input=chosen)
    # Nose up or down, roll and yaw are not told apart.
    steep = np.abs(np.nan_to_num(trial.observed[:, 10])) > _STEEP
    counted = trial.valid.copy()
    counted[steep, 9] = False
    counted[steep, 11] = False
    replay = Replay(
        vehicle,
        (Record(trial, chosen, counted),),
        tuple(restarted(trial, spans)),
        substeps=max(1, int(np.ceil(trial.dt / _SUBSTEP_S - 1e-9))),
    )
    shown = tuple(window.simulated for window in found)
    return PredictedLog(replay, shown, tuple(replay.errors_of(shown)))


def under_water(
    trial: Trial, vehicle: Vehicle, *, start_s: float | None = None, stop_s: float | None = None
) -> Trial:
    """The trial without the samples at which the hull reaches the surface, where that is known.

    What a changed vehicle does there is far from linear in the change: a lighter one than the log's, that
    floats, rises no further. The rest needs no surface. All samples stay where the part from `start_s` to
    `stop_s` has less than a window under water.
    """
    if trial.surface is None:
        return trial
    depth = trial.observed[:, 8] - trial.surface
    pitch = np.nan_to_num(trial.observed[:, 10])
    # The top of the hull, half a hull of room for thrusters that draw air, and the end that the pitch lifts.
    measures, top = vehicle.geometry(), -float(vehicle.hull_top()[2])
    reach = 2.0 * top + 0.5 * measures.get("length", 0.0) * np.abs(np.sin(pitch))
    wet = ~(depth < reach)
    part = (trial.t >= (-np.inf if start_s is None else start_s)) & (
        trial.t < (np.inf if stop_s is None else stop_s)
    )
    # Ten seconds, a window, are the least that is worth leaving the rest out for.
    if (wet & part).sum() * trial.dt < 10.0:
        return trial
    return replace(trial, valid=trial.valid & wet[:, None], surface=None)


def check_usable(trial: Trial, ahead_s: float) -> None:
    """Refuse a log that measured nothing, a channel without a sample, an interval beyond the windows."""
    if not trial.channels:
        raise TrialError(
            f"{trial.name}: no motion was recorded: expected one at least of u_m_s, p_deg_s, z_m, yaw_deg and"
            " their like; log what the model predicts, or map the columns"
        )
    for name in trial.channels:
        # A position that is never known (fixes at the surface) keeps no window from starting.
        if name not in ("x", "y") and not trial.valid[:, CHANNELS.index(name)].any():
            raise TrialError(
                f"{trial.name}: {name}: expected samples that are numbers, found none that can be used;"
                " correct the column, or leave it out"
            )
    if trial.dt * FEWEST > ahead_s:
        raise TrialError(
            f"{trial.name}: one sample every {trial.dt:.3g} s: expected at least {FEWEST} in a window of"
            f" {ahead_s:g} s; give a log of a higher rate, or the unit of t_s if its times are not in seconds"
        )
