"""What a tuning does: trials of every loop, groups of loops searched together, samples that they meet.

A loop is tried at up to three of the supporting points that the vehicle reaches. Where the mode that works at
a point does not use the loop, or a current could change the mode under way, it is tried at the nearest speed
where it does. Steps and corridors that the file does not give follow from the vehicle's limits and from what
the loop does with its start gains (`seatrial.tuning.corridors`). Depth goes over pitch and the
cross-track error over heading: they are searched with the loop that they ride on, with their lookahead and
integral of guidance. Gains of the pitch loop at points where it only holds the hull level are searched with
heave, which disturbs it there.

Held by tests/tuning/test_tuning_plan.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.errors import CampaignError
from seatrial.campaign.tuning_table import LoopTable, TuningTable
from seatrial.control_design.operating_points import reachable_points
from seatrial.tuning.loop_steps import slowest_level_m_s, steps_of, usual_speeds
from seatrial.tuning.objective import GainParameters, excited_points
from seatrial.tuning.step_trial import CHANNELS, RIDES_ON, LoopTrials, Rig, Samples
from seatrial.vehicle.actuators import NOMINAL_V

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.identification.fitted import Fitted

__all__ = ["Group", "TuningPlan"]

GROUPS = (("heave",), ("heading", "cross_track"), ("surge",), ("sway",), ("pitch", "depth"))
"""Loops and paths that are searched together, in the order of the search: what holds the hull level first."""

_GUIDANCE = {
    "depth": ("guidance.lookahead_vertical_m", "guidance.integral_gain_vertical_m_s"),
    "cross_track": ("guidance.lookahead_m", "guidance.integral_gain_m_s"),
}

_GUIDANCE_BOUNDS = (0.3, 3.0)

_FILTER_BOUNDS = (0.3, 3.0)

_CURRENT = 0.05  # of the top speed

_OWN_DRAWS = 1_000_003  # beside the seed: a verification's missions are other draws

_WALK = 2.399963  # golden angle, rad: currents from all sides, whatever their number


@dataclass(frozen=True)
class Group:
    """Loops and paths that are searched together, and the factors of their gains."""

    name: str
    trials: tuple[LoopTrials, ...]
    parameters: GainParameters


@dataclass(frozen=True, eq=False)
class TuningPlan:
    """A tuning, ready to run.

    Attributes
    ----------
    table
        The campaign's ``[tuning]``.
    fitted
        The vehicle and how well it is known.
    autopilot
        With the start gains.
    """

    table: TuningTable
    fitted: Fitted
    autopilot: Autopilot

    @property
    def vehicle(self) -> Vehicle:
        """The best values."""
        return self.fitted.vehicle

    @property
    def sensors(self) -> str | None:
        """Name of a set of sensors or a file; None for perfect ones."""
        return None if self.table.sensors == "perfect" else self.table.sensors

    @cached_property
    def reached(self) -> NDArray[np.bool_]:
        """Whether the vehicle reaches each supporting point, (6,)."""
        return reachable_points(self.vehicle, self.autopilot, voltage_v=self.supply_v)

    @cached_property
    def places(self) -> list[int]:
        """Supporting points that it reaches, from 0."""
        return [int(i) for i in np.flatnonzero(self.reached)]

    @property
    def supply_v(self) -> float:
        """Supply voltage, V: that of the file, or the one at which tables of thrust are read."""
        return NOMINAL_V if self.table.voltage_v is None else self.table.voltage_v

    @cached_property
    def top_speeds(self) -> tuple[float, float]:
        """Top speeds astern and ahead, m/s."""
        from seatrial.control_design.mode_table import top_speeds

        return top_speeds(self.vehicle, voltage_v=self.supply_v)

    @property
    def top_m_s(self) -> float:
        """Top speed ahead, m/s."""
        return self.top_speeds[1]

    @property
    def current_m_s(self) -> float:
        """Speed of the samples' currents, m/s: a twentieth of the top speed where the file gives none."""
        given = self.table.current_m_s
        return _CURRENT * self.top_m_s if given is None else given

    @cached_property
    def loops(self) -> dict[str, LoopTable]:
        """Loops and paths that are tuned, with their tables: those of the file, or every loop at work."""
        given = self.table.loops.given()
        if not given:
            names = [name for name in CHANNELS if name not in RIDES_ON and self.modes_of(name)]
            # One that no speed is far enough from a switching speed for, or without gains, has no trial.
            gains = self.autopilot.gains()
            return {
                name: LoopTable()
                for name in names
                if usual_speeds(self, name)
                and any(v for key, v in gains.items() if key.startswith(f"{name}.K_"))
            }
        for name in given:
            if name not in CHANNELS:
                raise CampaignError(
                    f"[tuning.loops.{name}]: the set point of {name} does not move, so there is no response"
                    " to hold against a corridor; leave the table out, its margins count all the same"
                )
            if not self.modes_of(name):
                raise CampaignError(
                    f"[tuning.loops.{name}]: no mode of the autopilot {self.autopilot.name} uses"
                    f" {RIDES_ON.get(name, name)} for it; leave the table out or add the loop to a mode"
                )
        return {name: given[name] for name in CHANNELS if name in given}

    def modes_of(self, loop: str) -> list[tuple[float, float]]:
        """Speeds from and to which modes work whose set point of this loop moves, m/s."""
        from seatrial.vehicle.authority import LOOPS as ORDER

        place = ORDER.index(RIDES_ON.get(loop, loop))
        modes = self.autopilot.modes
        found: list[tuple[float, float]] = []
        for k, mode in enumerate(modes):
            moves = {
                "pitch": mode["depth_by"] == "pitch",
                "depth": mode["depth_by"] == "pitch",
                "heave": mode["depth_by"] == "heave",
            }.get(loop, True)
            if mode["loops"][place] > 0.5 and moves:
                begin = float(mode["from_speed_m_s"]) if k else -np.inf
                end = float(modes[k + 1]["from_speed_m_s"]) if k + 1 < len(modes) else np.inf
                if found and found[-1][1] == begin:  # nothing changes for the loop there
                    begin = found.pop()[0]
                found.append((begin, end))
        return found

    @cached_property
    def slowest_m_s(self) -> float | None:
        """Least speed of level flight, m/s; None for a vehicle that hovers."""
        return slowest_level_m_s(self.vehicle, self.autopilot)

    def speeds_of(self, loop: str) -> tuple[float, ...]:
        """Speeds at which a loop is tried where the file gives none, m/s."""
        return usual_speeds(self, loop)

    def trials(self, loop: str) -> LoopTrials:
        """Steps of a loop at its speeds."""
        if loop not in self._trials:
            self._trials[loop] = steps_of(self, loop)
        return self._trials[loop]

    @cached_property
    def _trials(self) -> dict[str, LoopTrials]:
        return {}

    @cached_property
    def groups(self) -> tuple[Group, ...]:
        """What is searched together, in order."""
        every = {name: self.trials(name) for name in self.loops}
        points = self.autopilot.speeds_m_s
        gains = self.autopilot.gains()
        excited = {name: excited_points(trials.speeds, points) for name, trials in every.items()}
        found = []
        for members in GROUPS:
            chosen = [name for name in members if name in every]
            if not chosen:
                continue
            parameters = GainParameters(())
            rider = members[0]
            free = sorted({p for name in chosen for p in excited[name]} & set(self.places))
            parts: list[tuple[str, list[int], list[int]]] = [(rider, free, [])]
            if rider == "heave" and any(name in every for name in ("pitch", "depth")):
                moved = {p for name in ("pitch", "depth") for p in excited.get(name, [])}
                level = [p for p in free if p not in moved]
                parts.append(("pitch", level, sorted(moved)))
            if rider == "pitch" and "heave" in every:
                parts = [(rider, free, [p for p in excited["heave"] if p not in free])]
            for loop, own, taken in parts:
                parameters += GainParameters.of_loop(
                    loop, gains, free=own, taken=taken, reached=self.places, bounds=self.table.bounds
                )
            if filtered := gains.get(f"{rider}.reference_rad_s", 0.0):
                parameters += GainParameters.of_number(f"{rider}.reference_rad_s", filtered, _FILTER_BOUNDS)
            for path in chosen:
                for name in _GUIDANCE.get(path, ()):
                    parameters += GainParameters.of_number(name, gains.get(name, 0.0), _GUIDANCE_BOUNDS)
            if not len(parameters):
                raise CampaignError(
                    f"[tuning.loops.{chosen[0]}]: expected gains that a factor moves, found only zeros for"
                    f" {rider} in {self.autopilot.name}; give it start gains, or leave the table out"
                )
            found.append(Group(" and ".join(chosen), tuple(every[name] for name in chosen), parameters))
        return tuple(found)

    def rig(
        self,
        autopilot: Autopilot,
        *,
        vehicle: Vehicle | None = None,
        max_step: float = 0.02,
        threads: int | None = None,
    ) -> Rig:
        """The closed loop of an autopilot, with the sensors of the campaign.

        Parameters
        ----------
        autopilot : Autopilot
        vehicle : Vehicle, optional
            That flies; by default the best values, which the autopilot takes it for.
        max_step : float, optional
            Of the integration, s.
        threads : int, optional
            All by default.
        """
        return Rig(
            self.vehicle if vehicle is None else vehicle,
            self.vehicle,
            autopilot,
            sensors=self.sensors,
            max_step=max_step,
            voltage=self.table.voltage_v,
            threads=threads,
        )

    def samples(self, count: int, seed: int, *, nominal: int = 1) -> Samples:
        """The vehicle itself in still water, then drawn vehicles with a current from all sides.

        Parameters
        ----------
        count : int
            Of the drawn ones.
        seed : int
        nominal : int, optional
            How often the vehicle itself flies, each time with other noise.
        """
        size = nominal + count
        drawn = self.fitted.draws(count, seed + _OWN_DRAWS)
        own = self.fitted.vehicle.coefficients()
        values = {
            name: np.concatenate([np.full(nominal, own.get(name, 0.0)), column])
            for name, column in drawn.items()
        }
        bearing = _WALK * (seed % 997 + np.arange(size))
        current = self.current_m_s * np.stack([np.cos(bearing), np.sin(bearing), np.zeros(size)], axis=1)
        current[:nominal] = 0.0
        return Samples(values, current, tuple(range(seed * 1000 + 1, seed * 1000 + size + 1)), nominal)

    def to_dict(self) -> dict[str, Any]:
        """Trials and parameters as plain data."""
        return {
            "reachable_speeds_m_s": [self.autopilot.speeds_m_s[i] for i in self.places],
            "groups": [
                {
                    "name": group.name,
                    "parameters": list(group.parameters.names),
                    "trials": [trials.to_dict() for trials in group.trials],
                }
                for group in self.groups
            ],
        }
