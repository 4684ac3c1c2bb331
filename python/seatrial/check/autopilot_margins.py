"""Margins of an autopilot on a vehicle's model, per mode and speed, and the speeds at which it is sound.

All loops of the mode are closed on the linear motion about its trim, behind lag and dead time of the
actuators and the control period (`seatrial.control_design.closed_loop`), with the restoring feed-forward
where the file has it; each row of the wrench is then opened alone. A motion that neither grows nor dies
away within an hour (an undamped roll that nothing commands) counts as neutral. Held by
tests/test_autopilot_margins.py.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from seatrial._core import Autopilot, Vehicle
    from seatrial.control_design.closed_loop import Sampled

__all__ = ["ENOUGH_DEG", "MarginRow", "autopilot_margins", "sound_speeds"]

ENOUGH_DEG = 35.0
"""Phase margin in deg that start gains are made for."""

_STATES = ("depth", "roll", "pitch", "heading", "speed", "sway", "heave", "roll", "pitch", "heading")
"""The first states of the closed loop in words, rates as what they move."""

_POINTS = 6
_HOUR_S = 3600.0
_MUCH = 0.3  # of what moves most
_FINE = 61  # speeds at which the sound range is looked for


@dataclass(frozen=True)
class MarginRow:
    """Margins of a mode at a desired speed in m/s.

    ``phase_deg``, ``gain`` (a factor upwards) and ``delay_s`` are the least over the rows of the wrench,
    each opened alone; ``doubles_s`` is the time in which a motion doubles, None where none grows, and
    ``grows`` what moves most in it. ``trimmed`` says whether there is straight level motion at that speed.
    """

    mode: str
    speed_m_s: float
    phase_deg: float
    gain: float
    delay_s: float
    doubles_s: float | None
    grows: str
    trimmed: bool

    @property
    def sound(self) -> bool:
        """Whether nothing grows and the phase margin is enough."""
        return self.doubles_s is None and self.phase_deg >= ENOUGH_DEG

    @property
    def verdict(self) -> str:
        """In a word or two."""
        if self.doubles_s is not None:
            return f"{self.grows}: x2 in {self.doubles_s:.2g} s"
        return "sound" if self.sound else "little margin"


def autopilot_margins(
    vehicle: Vehicle, autopilot: Autopilot, *, speeds_m_s: Sequence[float] | None = None
) -> list[MarginRow]:
    """Margins of the mode that works at each desired speed.

    Parameters
    ----------
    vehicle : Vehicle
        The model, as good as it is.
    autopilot : Autopilot
    speeds_m_s : sequence of float, optional
        Desired speeds, m/s; the supporting points when missing.

    Examples
    --------
    >>> import seatrial as st
    >>> rows = autopilot_margins(st.Vehicle.load("cwolf"), st.Autopilot.load("cwolf"))
    >>> sorted({row.mode for row in rows})
    ['cruise', 'hover']
    """
    tables: dict[str, Any] = tomllib.loads(autopilot.to_toml())
    modes = tables["modes"]
    found = []
    for speed in autopilot.speeds_m_s if speeds_m_s is None else speeds_m_s:
        reached = [mode for mode in modes[1:] if speed >= mode["from_speed_m_s"]]
        found.append(_at(vehicle, tables, (reached or modes[:1])[-1]["name"], float(speed)))
    return found


def sound_speeds(vehicle: Vehicle, autopilot: Autopilot) -> tuple[float, float] | None:
    """Least and largest desired speed ahead in m/s between which every margin is sound; None without any.

    They are looked for between the supporting points, too, from the slowest sound one upwards.
    """
    points = autopilot.speeds_m_s
    grid = np.linspace(max(points[0], 0.0), points[-1], _FINE)
    rows = autopilot_margins(vehicle, autopilot, speeds_m_s=list(grid))
    first = next((k for k, row in enumerate(rows) if row.sound), None)
    if first is None:
        return None
    last = next((k for k in range(first, len(rows)) if not rows[k].sound), len(rows)) - 1
    return float(grid[first]), float(grid[last])


@dataclass(frozen=True, eq=False)
class ModeLoop:
    """A mode at a desired speed in m/s, before its gains: the sampled plant and what else acts on it.

    ``known`` is K (6, 15) of the restoring feed-forward, zero where the file has none; ``trimmed`` says
    whether there is straight level motion at that speed.
    """

    mode: str
    speed_m_s: float
    loops: tuple[str, ...]
    system: Sampled
    known: NDArray[np.float64]
    trimmed: bool


def mode_loop(
    vehicle: Vehicle,
    tables: dict[str, Any],
    mode: str,
    speed_m_s: float,
    *,
    measured_late_s: Mapping[str, float] | None = None,
) -> ModeLoop:
    """Sampled motion about the trim of a mode at a speed in m/s, of the tables of an autopilot file.

    ``measured_late_s`` is the age in s of what each loop measures, 0 where missing. The loop is opened at
    its row of the wrench: there dead time of its measurements and of its actuators are the same.
    """
    from seatrial.control_design.authority import LOOPS, ROWS, delays
    from seatrial.control_design.closed_loop import STATES, plant, restoring_law, sampled
    from seatrial.control_design.trim import Trim, trim

    table = next(one for one in tables["modes"] if one["name"] == mode)
    loops = tuple(loop for loop in LOOPS if loop in table["loops"])
    rows = "".join(ROWS[LOOPS.index(loop)] for loop in loops)
    actuators = _at_work(vehicle, table.get("actuators", ()))
    flight = trim(vehicle, speed_m_s, rows, actuators)
    nu = np.array([speed_m_s, 0.0, 0.0, 0.0, 0.0, 0.0])
    about = flight or Trim(speed_m_s, rows, np.zeros(3), nu, np.zeros(6), actuators)
    motion = plant(vehicle, about, loops)
    late = {ROWS[LOOPS.index(loop)]: (measured_late_s or {}).get(loop, 0.0) for loop in loops}
    behind = {
        row: replace(delay, dead_s=delay.dead_s + late[row]) for row, delay in delays(vehicle, rows).items()
    }
    system = sampled(motion, behind, float(tables["period_s"]), loops)
    known = np.zeros((len(ROWS), len(STATES)))
    if tables["feed_forward"]["restoring"]:
        known = restoring_law(vehicle, rows)
    return ModeLoop(mode, speed_m_s, loops, system, known, flight is not None)


def _at(vehicle: Vehicle, tables: dict[str, Any], mode: str, speed: float) -> MarginRow:
    from seatrial.control_design.closed_loop import closed, margins

    at = mode_loop(vehicle, tables, mode, speed)
    gain = mode_law(tables, mode, at.loops, speed) + at.known
    reached = margins(at.system, gain)
    doubles, grows = None, ""
    if reached.radius > neutral_radius(at.system.period_s):
        doubles = float(at.system.period_s * np.log(2.0) / np.log(reached.radius))
        grows = _moves_most(closed(at.system, gain), at.system)
    return MarginRow(
        mode=mode,
        speed_m_s=speed,
        phase_deg=reached.phase_deg,
        gain=reached.gain,
        delay_s=reached.delay_s,
        doubles_s=doubles,
        grows=grows,
        trimmed=at.trimmed,
    )


def neutral_radius(period_s: float) -> float:
    """Largest closed-loop |eigenvalue| per step that counts as neutral: doubling within an hour."""
    return float(2.0 ** (period_s / _HOUR_S))


def _moves_most(step: NDArray[np.float64], system: Sampled) -> str:
    """What moves, against what is tolerated, in the motion that grows fastest: the most first."""
    from seatrial.control_design import Tolerances

    values, vectors = np.linalg.eig(step)
    vector = np.abs(vectors[:, np.abs(values).argmax()])
    tolerated = Tolerances().of_states()
    sizes: dict[str, float] = {}
    for place, column in zip(system.seen, system.columns, strict=True):
        if column < len(_STATES):
            name = _STATES[column]
            sizes[name] = max(sizes.get(name, 0.0), float(vector[place]) / tolerated[column])
    much = [name for name in sizes if sizes[name] >= _MUCH * max(sizes.values())]
    return " and ".join(sorted(much, key=lambda name: -sizes[name])[:2])


def mode_law(tables: dict[str, Any], mode: str, loops: tuple[str, ...], speed: float) -> NDArray[np.float64]:
    """The control law of a mode at a desired speed as K (6, 15), between the points linear as in the core."""
    from seatrial.control_design.loop_gains import LoopGain, law

    points = tables["schedule"]["speeds_m_s"]
    if tables["control"] == "lqr":
        given = np.asarray(
            next(table["gain"] for table in tables["lqr"] if table["mode"] == mode), dtype=float
        )
        shape = given.shape[-2:]
        flat = np.broadcast_to(given, (_POINTS, *shape)).reshape(_POINTS, -1)
        return np.array([np.interp(speed, points, column) for column in flat.T]).reshape(shape)

    def value(loop: str, key: str) -> float:
        return float(np.interp(speed, points, np.broadcast_to(tables["loops"][loop].get(key, 0.0), _POINTS)))

    gains = {
        loop: LoopGain(value(loop, "K_P"), value(loop, "K_I_per_s"), value(loop, "K_D_s"), np.nan)
        for loop in loops
    }
    return law(gains, speed)


def _at_work(vehicle: Vehicle, named: Any) -> tuple[str, ...] | None:
    """Actuators of a mode, groups resolved; None for all."""
    facts = vehicle.actuator_info()
    found = tuple(name for name in vehicle.actuators if name in named or facts[name]["group"] in named)
    return found or None
