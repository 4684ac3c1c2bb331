"""What the tables of an autopilot file say: modes, loops, guidance, safety, gains at a speed.

The compiled core owns the file and its defaults; this is the one place above it that reads the tables it
writes. Held by tests/control_design/test_margin_engine.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial._core import Mission
from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle


@dataclass(frozen=True)
class AutopilotMode:
    """A row of the mode table; ``actuators`` are names and groups of those at work, all where empty."""

    name: str
    loops: tuple[str, ...]
    depth_by: str
    from_speed_m_s: float
    hysteresis_m_s: float
    actuators: tuple[str, ...]


@dataclass(frozen=True)
class AutopilotFacts:
    """An autopilot's tables with the core's defaults.

    ``loops`` are the tables of the loops, with scalars where a gain does not change with the speed;
    ``regulators`` is per mode the gain (points, 6, 15) or (6, 15) of ``control = "lqr"``.
    """

    control: str
    period_s: float
    speeds_m_s: tuple[float, ...]
    modes: tuple[AutopilotMode, ...]
    loops: Mapping[str, Mapping[str, Any]]
    restoring: bool
    guidance: Mapping[str, Any]
    safety: Mapping[str, Any]
    regulators: Mapping[str, Array]

    @property
    def hovers(self) -> bool:
        """Whether a mode keeps the depth without speed."""
        return any(mode.depth_by == "heave" for mode in self.modes)

    def mode(self, name: str) -> AutopilotMode:
        """The mode of a name."""
        return next(mode for mode in self.modes if mode.name == name)

    def at_points(self, loop: str, key: str) -> Array:
        """A gain of a loop at every breakpoint of the schedule; 0 where the file has none."""
        return np.broadcast_to(np.asarray(self.loops[loop].get(key, 0.0), dtype=float), len(self.speeds_m_s))

    def gain(self, loop: str, key: str, speed_m_s: float) -> float:
        """A gain of a loop at a desired speed, linear between the breakpoints as in the core."""
        return float(np.interp(speed_m_s, self.speeds_m_s, self.at_points(loop, key)))

    def shares(self, speed_m_s: float) -> Array:
        """Weight of each breakpoint's gains at a desired speed, linear between them as in the core."""
        return np.array([
            np.interp(speed_m_s, self.speeds_m_s, unit) for unit in np.eye(len(self.speeds_m_s))
        ])


def autopilot_facts(autopilot: Autopilot) -> AutopilotFacts:
    """What the tables of an autopilot say.

    Examples
    --------
    >>> import seatrial as st
    >>> [(mode.name, mode.depth_by) for mode in autopilot_facts(st.Autopilot.load("cwolf")).modes]
    [('hover', 'heave'), ('cruise', 'pitch')]
    """
    regulators = autopilot.to_dict().get("lqr", ())
    return AutopilotFacts(
        control=autopilot.control,
        period_s=autopilot.period_s,
        speeds_m_s=tuple(autopilot.speeds_m_s),
        modes=tuple(
            AutopilotMode(
                name=mode["name"],
                loops=tuple(mode["loop_names"]),
                depth_by=mode["depth_by"],
                from_speed_m_s=mode["from_speed_m_s"],
                hysteresis_m_s=mode["hysteresis_m_s"],
                actuators=tuple(mode["actuators"] or ()),
            )
            for mode in autopilot.modes
        ),
        loops=autopilot.loops(),
        restoring=autopilot.feed_forward()["restoring"],
        guidance=autopilot.guidance(),
        safety=autopilot.safety(),
        regulators={table["mode"]: np.asarray(table["gain"], dtype=float) for table in regulators},
    )


def mode_at(facts: AutopilotFacts, speed_m_s: float) -> AutopilotMode:
    """The mode that works at a desired speed in m/s."""
    reached = [mode for mode in facts.modes[1:] if speed_m_s >= mode.from_speed_m_s]
    return (reached or list(facts.modes[:1]))[-1]


def refuse_other_laws(autopilot: Autopilot) -> None:
    """Refuse an autopilot whose gains are not those of PID loops.

    Raises
    ------
    CampaignError
        Its control is another one.
    """
    control = autopilot_facts(autopilot).control
    if control != "pid":
        raise CampaignError(
            f'{autopilot.name}: expected control = "pid", whose gains can be tuned, found "{control}";'
            " begin with an autopilot of PID loops"
        )


_ANY_MISSION = """
format = 1
name = "fit"
speed_m_s = 1.0
acceptance_radius_m = 1.0
[[legs]]
north_m = 100.0
east_m = 0.0
"""


def refuse_misfit(autopilot: Autopilot, vehicle: Vehicle) -> None:
    """Refuse an autopilot that cannot steer a vehicle.

    Raises
    ------
    VehicleError
        A loop, an actuator or a limit of the autopilot does not fit.
    """
    autopilot.engage(vehicle, Mission.from_toml(_ANY_MISSION))
