"""The relay trial of one loop at one speed: the limit cycle that a relay keeps up, and what it tells.

The relay takes the controller's place on a straight, level leg: the loop's own PID with a proportional gain
past all bounds and ``tau_max = d``, whose demand is +d or -d at every sample. What the model feeds forward
(weight, drag, inertia) would be clamped away with it; so a constant load is carried by the relay itself,
which stays longer on one side. d is a share of the reach of the row at that speed, and at least
`_OVER_LOAD` times the load of the trim. Propellers that do not reverse switch between nothing and d. The
loop's reference filter is taken out, the other loops stay closed with the gains that they have, and
guidance looks ten kilometres ahead, without integral: its course and pitch stand still.

By the describing function a relay of amplitude d is, for a sine of amplitude a, the gain ``4 d/(pi a)``;
where the loop oscillates by itself this is the ultimate gain K_u, and the period is T_u. Here the gain is
the ratio of the first harmonics of what the actuators were asked for and of what was measured: the same
number where the cycle is symmetric and a sine, and the gain of the plant at the frequency of the cycle
where a constant load makes the relay stay longer on one side, ``(4 d/pi) sin(pi duty)`` instead of ``4
d/pi``, or where noise makes it chatter.

That frequency is the phase crossover only as far as first harmonics are all that matters: a relay under a
load has even harmonics, too, and cycles more slowly; one that is sampled switches late. So a cycle is flown
once more with a relay that switches ahead, by ``y + lead dy/dt`` (the derivative part of the same PID): it
cycles faster, at another point of the plant's frequency response. Along it the logarithms of gain and
period go almost straight with the phase, and what they are at -180 deg lies between the two
(`at_crossover`).

No rule may rely on a cycle (`doubt`) of which

================  ========================================================================================
limit             because
================  ========================================================================================
6 samples         of a cycle: below, it is the sampling that oscillates
8 deg             from the phase crossover: the ultimate gain changes by 2 to 6 % per degree
15 %              scatter of periods or amplitudes: no limit cycle, or noise
85 %              of the time on one side: what is left of the other side is a few samples
================  ========================================================================================

Source: Åström and Hägglund (1984), "Automatic tuning of simple regulators with specifications on phase and
amplitude margins", Automatica 20(5). Held by tests/tuning/test_relay.py, tests/tuning/test_relay_load.py and
tests/tuning/test_relay_doubt.py.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial._core import Autopilot, State, Vehicle
from seatrial.base.arrays import Array
from seatrial.control_design.autopilot_facts import autopilot_facts, mode_at
from seatrial.control_design.trim import trim
from seatrial.flight.flight import Flight
from seatrial.flight.fly import fly
from seatrial.flight.mission import Mission
from seatrial.vehicle.actuators import NOMINAL_V
from seatrial.vehicle.authority import LOOPS, ROWS, reach

if TYPE_CHECKING:
    from seatrial.sensors.sensor import Sensor

LEAST_CYCLES = 5
"""Cycles that must be seen."""

_LEAST_LEAD_DEG = 4.0  # less would lock in with the same sample

_LEAST_PART = 0.7  # of the phase of a cycle that another must be away for a line between them

_HYSTERESIS = 0.3
"""Share of the root mean square that a signal must pass on either side of its mean to have crossed it."""


@dataclass(frozen=True)
class Cycle:
    """A limit cycle; amplitude in the unit of the measurement (m/s, m, rad), period in s.

    Attributes
    ----------
    period_s
        Median over the cycles.
    period_scatter
        Standard deviation of the period over the cycles, as a share of it.
    amplitude
        Half the distance from peak to peak, median over the cycles.
    amplitude_scatter
        The same of the amplitude.
    ultimate_gain
        N or N m per unit of the measurement, by the first harmonics.
    phase_deg
        Phase of the measurement against the wrench, beyond -180 deg: zero at the phase crossover.
    duty
        Share of the time that the relay spends on its upper side: a half without a load.
    cycles
        How many.
    """

    period_s: float
    period_scatter: float
    amplitude: float
    amplitude_scatter: float
    ultimate_gain: float
    phase_deg: float
    duty: float
    cycles: int


def relay_cycle(t: Array, measured: Array, wrench: Array) -> Cycle | None:
    """Limit cycle of the settled part of a relay trial; None where fewer than five cycles are seen.

    Parameters
    ----------
    t : (n,)
        Time, s, evenly spaced.
    measured : (n,)
        What the loop controls: m/s, m or rad, angles without jumps.
    wrench : (n,)
        What the relay asked for and the allocation reached, N or N m.

    Examples
    --------
    >>> t = np.arange(0.0, 60.0, 0.1)
    >>> relay = -10.0 * np.sign(np.sin(2.0 * np.pi / 6.0 * (t + 0.05)))
    >>> cycle = relay_cycle(t, 0.1 * np.sin(2.0 * np.pi / 6.0 * (t + 0.05)), relay)
    >>> round(cycle.period_s, 2), round(cycle.ultimate_gain, 1)  # 4 d/(pi a)
    (6.0, 127.4)
    """
    starts = _upward(measured - 0.5 * (measured.max() + measured.min()))
    if len(starts) < LEAST_CYCLES + 1:
        return None
    middle = float(measured[starts[0] : starts[-1]].mean())
    times = _crossing_times(t, measured - middle, starts)
    periods = np.diff(times)
    halves = [0.5 * float(np.ptp(measured[one:next_])) for one, next_ in pairwise(starts)]
    period, amplitude = float(np.median(periods)), float(np.median(halves))
    whole = slice(int(starts[0]), int(starts[-1]))
    # The mean period keeps whole cycles in the sums: a median that is 1 % off loses phase over many cycles.
    turning = np.exp(-2j * np.pi / float(periods.mean()) * t[whole])
    answer = np.mean((measured[whole] - middle) * turning)
    drive = np.mean((wrench[whole] - wrench[whole].mean()) * turning)
    if min(abs(answer), abs(drive)) == 0.0:
        return None
    return Cycle(
        period_s=period,
        period_scatter=float(np.std(periods)) / period,
        amplitude=amplitude,
        amplitude_scatter=float(np.std(halves)) / amplitude,
        ultimate_gain=float(abs(drive) / abs(answer)),
        phase_deg=float(np.rad2deg(np.angle(-answer / drive))),
        # Propellers that do not reverse switch between nothing and ahead.
        duty=float(np.mean(wrench[whole] > 0.5 * (wrench[whole].max() + wrench[whole].min()))),
        cycles=len(periods),
    )


def crossover_lead_s(cycle: Cycle) -> float:
    """Time in s by which a relay must switch ahead to cycle at the phase crossover, or 4 deg further on.

    Examples
    --------
    >>> round(crossover_lead_s(Cycle(6.283, 0.0, 0.1, 0.0, 250.0, 10.0, 0.3, 12)), 3)  # tan(10 deg)
    0.176
    """
    turned = math.radians(max(cycle.phase_deg, _LEAST_LEAD_DEG))
    return math.tan(turned) * cycle.period_s / (2.0 * math.pi)


def at_crossover(cycle: Cycle, ahead: Cycle) -> Cycle | None:
    """Cycle at the phase crossover between a relay's and that of one that switches ahead.

    Period, amplitude and gain on a straight line of their logarithms over the phase; None where the phases
    lie too close together for a line.

    Parameters
    ----------
    cycle : Cycle
        Of the relay itself.
    ahead : Cycle
        Of the one with a lead, at the same amplitude of the relay.

    Examples
    --------
    >>> late = Cycle(17.0, 0.0, 1.2, 0.0, 0.8, 8.0, 0.25, 12)
    >>> found = at_crossover(late, Cycle(12.4, 0.0, 0.7, 0.0, 1.3, -5.0, 0.25, 12))
    >>> round(found.period_s, 1), round(found.ultimate_gain, 2), found.phase_deg
    (14.0, 1.08, 0.0)
    """
    apart = cycle.phase_deg - ahead.phase_deg
    if abs(apart) < _LEAST_PART * abs(cycle.phase_deg) or apart == 0.0:
        return None
    part = cycle.phase_deg / apart

    def between(one: float, other: float) -> float:
        return one * math.pow(other / one, part)

    return replace(
        cycle,
        period_s=between(cycle.period_s, ahead.period_s),
        period_scatter=max(cycle.period_scatter, ahead.period_scatter),
        amplitude=between(cycle.amplitude, ahead.amplitude),
        amplitude_scatter=max(cycle.amplitude_scatter, ahead.amplitude_scatter),
        ultimate_gain=between(cycle.ultimate_gain, ahead.ultimate_gain),
        phase_deg=0.0,
    )


def _upward(signal: Array) -> NDArray[np.int64]:
    """Rows at which a signal comes above zero, between being well below and well above it."""
    band = _HYSTERESIS * float(np.sqrt(np.mean(signal**2)))
    side = np.where(signal > band, 1, np.where(signal < -band, -1, 0))
    known = np.flatnonzero(side)
    rising = np.flatnonzero((side[known[:-1]] < 0) & (side[known[1:]] > 0))
    found = []
    for k in rising:
        before, after = int(known[k]), int(known[k + 1])
        above = np.flatnonzero(signal[before : after + 1] > 0.0)
        found.append(before + int(above[0]))
    return np.asarray(found, dtype=np.int64)


def _crossing_times(t: Array, signal: Array, rows: NDArray[np.int64]) -> Array:
    """Times at which a signal passes zero next to some rows, between the samples, s."""
    before, after = signal[rows - 1], signal[rows]
    rise = np.where(after - before > 0.0, after - before, 1.0)
    share = np.clip(-before / rise, 0.0, 1.0)
    times: Array = t[rows - 1] + share * (t[rows] - t[rows - 1])
    return times


_SAMPLES, _CROSSING_DEG, _SCATTER, _DUTY = 6.0, 8.0, 0.15, 0.85


def doubt(cycle: Cycle, sample_s: float) -> str:
    """Why no rule may rely on a cycle that is sampled every so many seconds; empty where one may.

    Examples
    --------
    >>> doubt(Cycle(0.4, 0.0, 0.1, 0.0, 250.0, 0.0, 0.5, 12), 0.1)
    'a cycle of 0.4 s is that of the sampling every 0.1 s'
    """
    if cycle.period_s < _SAMPLES * sample_s:
        return f"a cycle of {cycle.period_s:.2g} s is that of the sampling every {sample_s:g} s"
    if abs(cycle.phase_deg) > _CROSSING_DEG:
        return f"the first harmonics are {abs(cycle.phase_deg):.0f} deg from the phase crossover"
    if scatters(cycle):
        worst = max(cycle.period_scatter, cycle.amplitude_scatter)
        return f"the cycles scatter by {100.0 * worst:.0f} %"
    if not 1.0 - _DUTY <= cycle.duty <= _DUTY:
        side = max(cycle.duty, 1.0 - cycle.duty)
        return f"the relay stays on one side for {100.0 * side:.0f} % of the time"
    return ""


def scatters(cycle: Cycle) -> bool:
    """Whether periods or amplitudes of a cycle scatter too much."""
    return max(cycle.period_scatter, cycle.amplitude_scatter) > _SCATTER


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
    voltage_v: float | None = None,
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
    voltage_v : float, optional
        Supply, V, where thrust depends on it.
    """
    supply = NOMINAL_V if voltage_v is None else voltage_v
    d, why = _amplitude(vehicle, autopilot, (loop, speed_m_s, share), supply)
    if why:
        return RelayTrial(d, None, None, why)
    sea = _Sea(vehicle, autopilot, sensors, voltage_v)
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
    voltage_v: float | None

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
                voltage_v=self.voltage_v,
                max_time_s=duration,
            )
            settled = flight.t > _SETTLED_FROM * duration
            if not (flight.outcome == "out of time" and np.isfinite(flight.nu).all()):
                return None, None, f"the flight is not straight and level: {flight.outcome}"
            t, wrench = flight.t[settled], flight.achieved[settled, LOOPS.index(loop)]
            measured = _measured(flight, loop)[settled]
            if (found := relay_cycle(t, measured, wrench)) is not None:
                shown = t >= t[-1] - _SHOWN_CYCLES * found.period_s
                return found, Trace(t[shown], (measured - measured.mean())[shown], wrench[shown]), ""
        return None, None, f"no limit cycle within {_LONGEST_S:.0f} s"


def _amplitude(
    vehicle: Vehicle, autopilot: Autopilot, aim: tuple[str, float, float], voltage_v: float
) -> tuple[float, str]:
    """Amplitude of the relay in N or N m for a loop, speed and share, and why it is no good."""
    loop, speed, share = aim
    # Of the rows of all modes: without the others held, a row would seem to reach further.
    every = _rows({loop for mode in autopilot_facts(autopilot).modes for loop in mode.loops})
    low, high = reach(vehicle, speed, every, voltage_v=voltage_v)[ROWS[LOOPS.index(loop)]]
    # A relay between nothing and ahead has a middle to swing about as well: half of d.
    within = float(high if loop == "surge" and low > -_NO_FORCE else min(high, -low))
    if within < _NO_FORCE:
        kind = "moment" if UNITS[loop] == "rad" else "force"
        return 0.0, f"the actuators cannot give a {kind} to both sides at {speed:.3g} m/s"
    about = trim(vehicle, speed, commanded_rows(autopilot, speed))
    load = abs(float(about.tau[LOOPS.index(loop)])) if about is not None else 0.0
    d = max(share * within, _OVER_LOAD * load)
    if d > _MOST * within:
        return d, f"a load of {load:.3g} out of at most {within:.3g} leaves no room for a relay"
    return d, ""


def commanded_rows(autopilot: Autopilot, speed_m_s: float) -> str:
    """Rows of the wrench, letters of XYZKMN, that the loops of the mode at a desired speed command."""
    return _rows(mode_at(autopilot_facts(autopilot), speed_m_s).loops)


def _rows(loops: Collection[str]) -> str:
    return "".join(row for row, loop in zip(ROWS, LOOPS, strict=True) if loop in loops)


def _with_relay(autopilot: Autopilot, loop: str, relay: tuple[float, float], speed: float) -> Autopilot:
    """The autopilot with a relay (amplitude, lead in s) as a loop's controller; guidance stands still."""
    import tomlkit

    tables = autopilot.to_dict()
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
