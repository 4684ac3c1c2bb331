"""What a tuning does: trials of every loop, groups of loops searched together, samples that they meet.

A loop is tried at the supporting points that the vehicle reaches. Where the mode that works at a point does
not use the loop, or a current could change the mode under way, it is tried at the nearest speed where it
does. Depth goes over pitch and the cross-track error over heading: they are searched with the loop that
they ride on, with their lookahead and integral of guidance. Gains of the pitch loop at points where it only
holds the hull level are searched with heave, which disturbs it there.

Held by tests/test_tuning_plan.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.errors import CampaignError
from seatrial.tuning.gain_parameters import GainParameters, excited_points
from seatrial.tuning.loop_trials import CHANNELS, LoopTrials, Samples
from seatrial.tuning.step_trial import Rig
from seatrial.tuning.tuning_file import LOOPS, LoopTable, TuningTable, default_steps
from seatrial.tuning.working_points import reachable_points

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.fitted import Fitted

__all__ = ["Group", "TuningPlan"]

Array = NDArray[np.float64]

GROUPS = (("heave",), ("heading", "cross_track"), ("surge",), ("sway",), ("pitch", "depth"))
"""Loops and paths that are searched together, in the order of the search: what holds the hull level first."""

_RIDES_ON = {"depth": "pitch", "cross_track": "heading"}
_GUIDANCE = {
    "depth": ("guidance.lookahead_vertical_m", "guidance.integral_gain_vertical_m_s"),
    "cross_track": ("guidance.lookahead_m", "guidance.integral_gain_m_s"),
}
_GUIDANCE_BOUNDS = (0.3, 3.0)
_FILTER_BOUNDS = (0.3, 3.0)
_BESIDE_MODE_M_S = 0.1  # how far a trial keeps from a switching speed, beside the current
_CURRENT = 0.1  # of the top speed
_SETTLE_S = 15.0  # at least; a loop that settles in its corridor has settled at its start as well
_APART = 0.2  # of the mean spacing of the points: speeds that are nearer tell the same
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
        return reachable_points(self.vehicle, self.autopilot)

    @cached_property
    def places(self) -> list[int]:
        """Supporting points that it reaches, from 0."""
        return [int(i) for i in np.flatnonzero(self.reached)]

    @cached_property
    def top_m_s(self) -> float:
        """Top speed ahead, m/s."""
        from seatrial.control_design.mode_table import top_speeds

        return top_speeds(self.vehicle)[1]

    @property
    def current_m_s(self) -> float:
        """Speed of the samples' currents, m/s: a tenth of the top speed where the file gives none."""
        given = self.table.current_m_s
        return _CURRENT * self.top_m_s if given is None else given

    @cached_property
    def loops(self) -> dict[str, LoopTable]:
        """Loops and paths that are tuned, with their tables: those of the file, or every loop at work."""
        given = self.table.loops.given()
        if not given:
            names = [name for name in CHANNELS if name not in _RIDES_ON and self.modes_of(name)]
            return {name: LoopTable() for name in names}
        for name in given:
            if name not in CHANNELS:
                raise CampaignError(
                    f"[tuning.loops.{name}]: the set point of {name} does not move, so there is no response"
                    " to hold against a corridor; leave the table out, its margins count all the same"
                )
            if not self.modes_of(name):
                raise CampaignError(
                    f"[tuning.loops.{name}]: no mode of the autopilot {self.autopilot.name} uses"
                    f" {_RIDES_ON.get(name, name)} for it; leave the table out or add the loop to a mode"
                )
        return {name: given[name] for name in CHANNELS if name in given}

    def modes_of(self, loop: str) -> list[tuple[float, float]]:
        """Speeds from and to which modes work whose set point of this loop moves, m/s."""
        from seatrial.control_design.authority import LOOPS as ORDER

        place = ORDER.index(_RIDES_ON.get(loop, loop))
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

    def speeds_of(self, loop: str) -> tuple[float, ...]:
        """Speeds at which a loop is tried where the file gives none, m/s."""
        away = self.current_m_s + _BESIDE_MODE_M_S
        found: list[float] = []
        for point in self.places:
            wanted = self.autopilot.speeds_m_s[point]
            if loop in _RIDES_ON and wanted <= 0.0:
                continue  # guidance goes ahead
            near = [
                float(np.clip(wanted, begin + away, max(end - away, begin + away)))
                for begin, end in self.modes_of(loop)
            ]
            at = near[int(np.argmin(np.abs(np.array(near) - wanted)))]
            apart = _APART * float(np.mean(np.diff(self.autopilot.speeds_m_s)))
            if at <= self.top_m_s and not any(abs(at - other) < apart for other in found):
                found.append(round(at, 6))
        return tuple(found)

    def trials(self, loop: str) -> LoopTrials:
        """Steps of a loop at its speeds."""
        table = self.loops[loop]
        speeds = table.speeds_m_s or self.speeds_of(loop)
        self._refuse_beyond_reach(loop, speeds)
        steps = table.steps or default_steps(loop, top_m_s=self.top_m_s)
        if table.corridor is None:
            from seatrial.tuning.default_corridor import default_corridor

            corridor = default_corridor(self.vehicle, self.autopilot, loop, steps, weights=table.weights)
        else:
            corridor = table.corridor.corridor(table.weights)
        each = []
        for speed in speeds:
            possible = [(float(speed), float(step)) for step in steps if self._within(loop, speed, step)]
            # The step back is the other direction: one sign will do where the file does not ask for both.
            each += possible if table.steps else possible[:1]
        if not each:
            raise CampaignError(
                f"[tuning.loops.{loop}]: expected a step that the vehicle reaches, found none at"
                f" {', '.join(f'{u:g}' for u in speeds)} m/s; take smaller steps, or give speeds_m_s"
            )
        return LoopTrials(
            loop=loop,
            corridor=corridor,
            beside=table.beside.half_widths(),
            speeds=tuple(speed for speed, _ in each),
            sizes=tuple(step * LOOPS[loop].to_si for _, step in each),
            settle_s=self.table.settle_s or max(_SETTLE_S, corridor.until_s),
        )

    def _refuse_beyond_reach(self, loop: str, speeds: tuple[float, ...]) -> None:
        """Refuse a desired speed that no command brings about."""
        from seatrial.control_design.mode_table import top_speeds

        astern, ahead = top_speeds(self.vehicle)
        for speed in speeds:
            if not astern <= speed <= ahead:
                raise CampaignError(
                    f"[tuning.loops.{loop}]: speeds_m_s: expected speeds that {self.vehicle.name} reaches,"
                    f" {astern:.2f} to {ahead:.2f} m/s, found {speed:g}; correct or remove it"
                )

    def _within(self, loop: str, speed: float, step: float) -> bool:
        """Whether both ends of a step of the speed lie within reach."""
        from seatrial.control_design.mode_table import RANGE, top_speeds

        if loop != "surge":
            return True
        astern, ahead = top_speeds(self.vehicle)
        # Against the current less is left over ground.
        away = self.current_m_s
        return RANGE * astern + away <= speed + step <= RANGE * ahead - away

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
