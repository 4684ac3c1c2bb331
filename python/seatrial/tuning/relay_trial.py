"""The relay trial of one loop at one speed: a relay in the controller's place on a straight, level leg.

The relay is the loop's own PID with a proportional gain past all bounds and ``tau_max = d``: its demand is
+d or -d at every sample. What the model feeds forward (weight, drag, inertia) would be clamped away with
it; so a constant load is carried by the relay itself, which stays longer on one side. d is a share of the
reach of the row at that speed, and at least `_OVER_LOAD` times the load of the trim. Propellers that do not
reverse switch between nothing and d. The loop's reference filter is taken out, the other loops stay closed
with the gains that they have, and guidance looks ten kilometres ahead, without integral: its course and
pitch stand still.

A cycle is flown once more with a relay that switches ahead: the derivative part of the same PID, past all
bounds, too. What is at the phase crossover follows from both (`seatrial.tuning.relay_cycle`), also where
the load or the sampling keeps the relay's own cycle away from it.

Source: Åström and Hägglund (1984). Held by tests/test_relay.py, tests/test_relay_load.py.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial._core import Autopilot, State, Vehicle
from seatrial.check.actuators import NOMINAL_V
from seatrial.control_design.authority import LOOPS, ROWS, reach
from seatrial.control_design.trim import trim
from seatrial.flight.flight import Flight
from seatrial.flight.fly import fly
from seatrial.mission import Mission
from seatrial.tuning.relay_cycle import Cycle, at_crossover, crossover_lead_s, relay_cycle
from seatrial.tuning.relay_doubt import doubt, scatters

if TYPE_CHECKING:
    from seatrial.sensors import Sensor

__all__ = ["UNITS", "RelayTrial", "Trace", "commanded_rows", "mode_at", "relay_trial", "straight"]

Array = NDArray[np.float64]
Sensors = Mapping[str, "Sensor"] | str | Path | None

UNITS = {"surge": "m/s", "sway": "m/s", "heave": "m", "roll": "rad", "pitch": "rad", "heading": "rad"}
"""Of what a loop controls."""

_CHANNELS = {"surge": "u", "sway": "v", "heave": "z", "roll": "roll", "pitch": "pitch", "heading": "yaw"}
_PAST_ALL_BOUNDS = 1e6
_OVER_LOAD = 2.0  # the relay then spends at most three quarters of the time on the load's side
_MOST = 0.9  # of the reach: what is beyond, the allocation would cut off
_FAR_M = 1e4
_DEPTH_M = 100.0
_SETTLED_FROM = 0.4  # of the trial
_LONG_S, _LONGEST_S = 120.0, 480.0
_SHOWN_CYCLES = 4.0
_NO_FORCE = 1e-3  # N or N m


@dataclass(frozen=True, eq=False)
class Trace:
    """The last cycles of a trial, (n,) each: t, measured from its mean, wrench; SI and rad."""

    t: Array
    measured: Array
    wrench: Array


@dataclass(frozen=True, eq=False)
class RelayTrial:
    """A trial with a relay of amplitude d in N or N m; ``why`` says what is wrong with it, if anything.

    ``lead_s`` is that of the second flight, by which ``cycle`` lies at the phase crossover; 0 where there was
    none or it did not count. ``trace`` is of the relay's own cycle.
    """

    d: float
    cycle: Cycle | None
    trace: Trace | None
    why: str = ""
    lead_s: float = 0.0

    @property
    def usable(self) -> bool:
        """Whether there is a limit cycle that a rule may rely on."""
        return self.cycle is not None and not self.why


def relay_trial(
    vehicle: Vehicle,
    autopilot: Autopilot,
    *,
    loop: str,
    speed_m_s: float,
    share: float,
    sensors: Sensors = None,
    voltage: float | None = None,
) -> RelayTrial:
    """Trial of a loop at a speed ahead with a relay of a share of its reach.

    Parameters
    ----------
    vehicle : Vehicle
    autopilot : Autopilot
        With PID loops; those of the mode at that speed stay closed, but for this one.
    loop : str
        surge, sway, heave, roll, pitch or heading.
    speed_m_s : float
        Desired speed, m/s, above zero.
    share : float
        Amplitude of the relay over the reach of the row.
    sensors : mapping of str to Sensor, str or Path, optional
        As for `seatrial.fly`; perfect when omitted.
    voltage : float, optional
        Supply, V, where thrust depends on it.
    """
    supply = NOMINAL_V if voltage is None else voltage
    d, why = _amplitude(vehicle, autopilot, (loop, speed_m_s, share), supply)
    if why:
        return RelayTrial(d, None, None, why)
    sea = _Sea(vehicle, autopilot, sensors, voltage)
    cycle, trace, why = sea.cycle(loop, speed_m_s, d)
    if cycle is None or trace is None:
        return RelayTrial(d, None, None, why)
    sound = not doubt(replace(cycle, phase_deg=0.0), autopilot.period_s)
    lead_s = crossover_lead_s(cycle) if sound else 0.0
    ahead = sea.cycle(loop, speed_m_s, d, lead_s)[0] if sound else None
    crossed = at_crossover(cycle, ahead) if ahead is not None and not scatters(ahead) else None
    # Where noise takes the cycle apart as soon as the derivative sees it, the first one stays, if it may.
    if ahead is None or crossed is None:
        return RelayTrial(d, cycle, trace, doubt(cycle, autopilot.period_s))
    return RelayTrial(d, crossed, trace, doubt(crossed, autopilot.period_s), lead_s)


@dataclass(frozen=True, eq=False)
class _Sea:
    """Where the trials are flown: vehicle, autopilot, sensors, and the supply in V."""

    vehicle: Vehicle
    autopilot: Autopilot
    sensors: Sensors
    voltage: float | None

    def cycle(
        self, loop: str, speed: float, d: float, lead_s: float = 0.0
    ) -> tuple[Cycle | None, Trace | None, str]:
        """Limit cycle of a loop at a speed in m/s under a relay of amplitude d, or why there is none."""
        tested = _with_relay(self.autopilot, loop, (d, lead_s), speed)
        start = State(position=[0, 0, _DEPTH_M], attitude=[0.01, 0.01, 0.01], nu=[speed, 0, 0, 0, 0, 0])
        for duration in (_LONG_S, _LONGEST_S):
            flight = fly(
                self.vehicle,
                tested,
                straight(speed),
                sensors=self.sensors,
                initial=start,
                voltage=self.voltage,
                max_time=duration,
            )
            settled = flight.t > _SETTLED_FROM * duration
            if not (flight.ending == "out of time" and np.isfinite(flight.nu).all()):
                return None, None, f"the flight is not straight and level: {flight.ending}"
            t, wrench = flight.t[settled], flight.achieved[settled, LOOPS.index(loop)]
            measured = _measured(flight, loop)[settled]
            if (found := relay_cycle(t, measured, wrench)) is not None:
                shown = t >= t[-1] - _SHOWN_CYCLES * found.period_s
                return found, Trace(t[shown], (measured - measured.mean())[shown], wrench[shown]), ""
        return None, None, f"no limit cycle within {_LONGEST_S:.0f} s"


def _amplitude(
    vehicle: Vehicle, autopilot: Autopilot, aim: tuple[str, float, float], voltage: float
) -> tuple[float, str]:
    """Amplitude of the relay in N or N m for a loop, speed and share, and why it is no good."""
    loop, speed, share = aim
    # Of the rows of all modes: without the others held, a row would seem to reach further.
    every = "".join(row for row in ROWS if any(row in _rows(mode) for mode in autopilot.modes))
    low, high = reach(vehicle, speed, every, voltage_v=voltage)[ROWS[LOOPS.index(loop)]]
    # A relay between nothing and ahead has a middle to swing about as well: half of d.
    within = float(high if loop == "surge" and low > -_NO_FORCE else min(high, -low))
    if within < _NO_FORCE:
        kind = "moment" if UNITS[loop] == "rad" else "force"
        return 0.0, f"the actuators cannot give a {kind} to both sides at {speed:.3g} m/s"
    about = trim(vehicle, speed, commanded_rows(autopilot, speed))
    load = abs(float(about.tau[LOOPS.index(loop)])) if about is not None else 0.0
    d = max(share * within, _OVER_LOAD * load)
    if d > _MOST * within:
        return d, f"a load of {load:.3g} within a reach of {within:.3g} leaves a relay no room"
    return d, ""


def commanded_rows(autopilot: Autopilot, speed_m_s: float) -> str:
    """Rows of the wrench, letters of XYZKMN, that the loops of the mode at a desired speed command."""
    return _rows(mode_at(autopilot, speed_m_s))


def _rows(mode: dict[str, Any]) -> str:
    return "".join(row for row, on in zip(ROWS, mode["loops"], strict=True) if on)


def mode_at(autopilot: Autopilot, speed_m_s: float) -> dict[str, Any]:
    """The mode that works at a desired speed in m/s."""
    modes = autopilot.modes
    reached = [mode for mode in modes[1:] if speed_m_s >= float(mode["from_speed_m_s"])]
    return (reached or modes[:1])[-1]


def _with_relay(autopilot: Autopilot, loop: str, relay: tuple[float, float], speed: float) -> Autopilot:
    """The autopilot with a relay (amplitude, lead in s) as a loop's controller; guidance stands still."""
    import tomlkit

    tables: dict[str, Any] = tomllib.loads(autopilot.to_toml())
    table = tables["loops"][loop]
    d, k_p = float(relay[0]), _PAST_ALL_BOUNDS * float(relay[0])
    table |= {"K_P": k_p, "K_I_per_s": 0.0, "K_D_s": k_p * float(relay[1]), "tau_max": d}
    table.pop("reference_rad_s", None)
    guidance = tables["guidance"]
    guidance |= {
        "lookahead_m": _FAR_M,
        "lookahead_vertical_m": _FAR_M,
        "integral_gain_m_s": 0.0,
        "integral_gain_vertical_m_s": 0.0,
        "speed_max_m_s": max(float(guidance["speed_max_m_s"]), speed),
    }
    # A hull that swings about on the spot is no failure here.
    tables["safety"]["progress"] = {"after_s": 1e6, "reaction": "continue"}
    tables["safety"]["actuator"] |= {"reaction": "continue"}
    return Autopilot.from_toml(tomlkit.dumps(tables), f"{autopilot.name} with a relay for {loop}")


def straight(speed: float) -> Mission:
    """Level leg to the north at a speed in m/s, longer than any trial."""
    return Mission.from_toml(
        f'format = 1\nname = "relay trial"\nspeed_m_s = {speed!r}\nacceptance_radius_m = 5.0\n'
        f"[start]\ndepth_m = {_DEPTH_M}\n"
        f"[[legs]]\nnorth_m = {_FAR_M}\neast_m = 0.0\ndepth_m = {_DEPTH_M}\n"
    )


def _measured(flight: Flight, loop: str) -> Array:
    """What the autopilot is told of what a loop controls (n,), the sensors' lateness included."""
    signal = flight.measured[_CHANNELS[loop]]
    return np.asarray(np.unwrap(signal) if UNITS[loop] == "rad" else signal, dtype=float)
