"""Relay autotuning of an autopilot's PID loops, the yardstick for tuning by constraint criteria.

At every breakpoint ahead that the vehicle reaches, each loop of the mode that works there is driven by a
relay of two amplitudes (`seatrial.tuning.relay_trial`), since dead band and rate limits make the answer
depend on it; the cycle of the smaller ultimate gain K_u and its period T_u are taken, and a rule makes
gains of them. A breakpoint without a usable cycle takes those of the nearest one, by the amount of the
speed: a mission sails ahead only.

==============  =====  ==========  ==========  =========
rule            kind   K_P         T_i         T_d
==============  =====  ==========  ==========  =========
ziegler-nichols PI     0.45 K_u    T_u / 1.2
ziegler-nichols PID    0.6 K_u     T_u / 2     T_u / 8
tyreus-luyben   PI     K_u / 3.2   2.2 T_u
tyreus-luyben   PID    K_u / 2.2   2.2 T_u     T_u / 6.3
==============  =====  ==========  ==========  =========

with ``K_I = K_P/T_i`` and ``K_D = K_P T_d``. Speed loops are PI: the derivative of a Doppler log is noise.
Ziegler and Nichols aim at a decay ratio of a quarter; Tyreus and Luyben made theirs for integrating
processes, which depth and angles are.

Source: Åström and Hägglund (1984); Ziegler and Nichols (1942), Trans. ASME 64; Tyreus and Luyben (1992),
Ind. Eng. Chem. Res. 31(11). Held by tests/tuning/test_relay.py.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from seatrial._core import Autopilot, Vehicle
from seatrial.base.errors import SimulationError, nearest
from seatrial.base.toml_file import loaded
from seatrial.control_design.autopilot_facts import autopilot_facts, mode_at, refuse_other_laws
from seatrial.control_design.mode_table import top_speeds
from seatrial.control_design.pole_placement import kind, three_digits
from seatrial.control_design.trim import trim
from seatrial.flight.checks import checked_supply
from seatrial.tuning.relay_trial import RelayTrial, Sensors, commanded_rows, relay_trial, straight
from seatrial.vehicle.actuators import NOMINAL_V
from seatrial.vehicle.authority import LOOPS, reach

RULES: dict[str, dict[str, tuple[float, float, float]]] = {
    "tyreus-luyben": {"PI": (1.0 / 3.2, 2.2, 0.0), "PID": (1.0 / 2.2, 2.2, 1.0 / 6.3)},
    "ziegler-nichols": {"PI": (0.45, 1.0 / 1.2, 0.0), "PID": (0.6, 0.5, 0.125)},
}
"""Per rule and kind of controller K_P/K_u, T_i/T_u and T_d/T_u."""


@dataclass(frozen=True)
class PidGains:
    """``k_p`` in N or N m per unit of the error (m/s, m, rad), ``k_i`` per s, ``k_d`` times s."""

    k_p: float
    k_i: float
    k_d: float


def pid_gains(rule: str, kind: str, *, ultimate_gain: float, period_s: float) -> PidGains:
    """Physical gains of a loop by a rule.

    Parameters
    ----------
    rule : str
        ``tyreus-luyben`` or ``ziegler-nichols``.
    kind : str
        ``PI`` or ``PID``.
    ultimate_gain : float
        K_u in N or N m per unit of the error.
    period_s : float
        T_u, s.

    Raises
    ------
    SimulationError
        The rule is none.

    Examples
    --------
    >>> pid_gains("ziegler-nichols", "PID", ultimate_gain=100.0, period_s=4.0)
    PidGains(k_p=60.0, k_i=30.0, k_d=30.0)
    """
    if rule not in RULES:
        raise SimulationError(
            f"rule: expected a rule of relay tuning, found {rule!r}{nearest(str(rule), RULES)}"
        )
    share, integral, derivative = RULES[rule][kind]
    k_p = share * ultimate_gain
    return PidGains(k_p, k_p / (integral * period_s), k_p * derivative * period_s)


SHARES = (0.15, 0.3)
"""Amplitudes of the relay over the reach of its row."""


@dataclass(frozen=True, eq=False)
class RelayPoint:
    """The trials of a loop at a speed in m/s, one per amplitude, and the gains that follow.

    ``gains`` is None where no trial has a usable limit cycle.
    """

    loop: str
    speed_m_s: float
    trials: tuple[RelayTrial, ...]
    gains: PidGains | None

    @property
    def taken(self) -> RelayTrial | None:
        """The trial that the gains come from: of the usable ones, that of the smallest ultimate gain."""
        return _taken(self.trials)

    @property
    def why(self) -> str:
        """Why there are no gains; empty where there are."""
        return "" if self.gains is not None else "; ".join(dict.fromkeys(trial.why for trial in self.trials))

    def to_dict(self) -> dict[str, Any]:
        """As plain numbers and words: SI and rad."""
        trials = [
            {"d": trial.d, "why": trial.why, "lead_s": trial.lead_s}
            | (vars(trial.cycle) if trial.cycle is not None else {})
            for trial in self.trials
        ]
        gains = None if self.gains is None else dict(vars(self.gains))
        return {"loop": self.loop, "speed_m_s": self.speed_m_s, "gains": gains, "trials": trials}


@dataclass(frozen=True, eq=False)
class RelayTuning:
    """An autopilot with gains by relay trials.

    Attributes
    ----------
    autopilot
        With the gains of the rule; limits, reference filters, guidance and modes are those of the start.
    points
        Every loop and speed that was tried.
    rule
        ``tyreus-luyben`` or ``ziegler-nichols``.
    sources
        Per loop and breakpoint the speed in m/s whose trial its gains come from; a loop without any
        usable trial is missing and keeps the gains of the start.
    """

    autopilot: Autopilot
    points: tuple[RelayPoint, ...]
    rule: str
    sources: dict[str, tuple[float, ...]]

    def summary(self) -> str:
        """Table of the trials and of what they lead to, as text."""
        head = f"{'loop':<8} {'u':>5} {'d':>6} {'a':>8}"
        head += "".join(f" {name:>6}" for name in ("T_u", "K_u", "K_P", "K_I", "K_D")) + "  duty  lead"
        lines = [f"Relay tuning by {_name(self.rule)} (m/s, m, rad; N, N m; s)", head]
        for point in self.points:
            for trial in point.trials:
                lines.append(_row(point, trial))
        borrowed = [
            f"{loop}: the gains at {', '.join(_speed(u) for u in some)} m/s are those of {_speed(source)} m/s"
            for loop, sources in self.sources.items()
            for source in dict.fromkeys(sources)
            if (some := self._borrowing(sources, source))
        ]
        kept = [
            f"{loop}: no usable limit cycle; the start's gains stay"
            for loop in dict.fromkeys(point.loop for point in self.points)
            if loop not in self.sources
        ]
        return "\n".join(lines + borrowed + kept)

    def _borrowing(self, sources: tuple[float, ...], source: float) -> list[float]:
        pairs = zip(self.autopilot.speeds_m_s, sources, strict=True)
        return [u for u, found in pairs if found == source and u != source]

    def to_dict(self) -> dict[str, Any]:
        """Rule, trials and sources as plain numbers and words, and the autopilot file."""
        return {
            "rule": self.rule,
            "points": [point.to_dict() for point in self.points],
            "sources": {loop: list(speeds) for loop, speeds in self.sources.items()},
            "autopilot": self.autopilot.to_toml(),
        }


def relay_autopilot(
    vehicle: Vehicle | str | Path,
    autopilot: Autopilot | str | Path,
    *,
    rule: str = "tyreus-luyben",
    speeds: Sequence[float] | None = None,
    shares: Sequence[float] = SHARES,
    sensors: Sensors = None,
    voltage_v: float | None = None,
) -> RelayTuning:
    """Autopilot whose PID loops are tuned by relay trials on a vehicle, with the trials; gains in SI.

    Parameters
    ----------
    vehicle : Vehicle, str or Path
        That is tuned on: an object, a built-in name or a file.
    autopilot : Autopilot, str or Path
        The start: its gains close the loops beside the one that is tried.
    rule : str
        ``tyreus-luyben`` or ``ziegler-nichols``.
    speeds : sequence of float, optional
        Speeds ahead that are tried, m/s; by default the breakpoints that the vehicle reaches.
    shares : sequence of float
        Amplitudes of the relay over the reach of its row, each above 0 and up to 0.9.
    sensors : mapping of str to Sensor, str or Path, optional
        As for `seatrial.fly`; perfect when omitted. A relay has no hysteresis: on noise it chatters.
    voltage_v : float, optional
        Supply, V, where thrust depends on it.

    Raises
    ------
    VehicleError
        A file is not usable, or the autopilot does not fit the vehicle.
    CampaignError
        The autopilot is none of PID loops.
    SimulationError
        Rule, speeds or shares are none, the supply is missing, or a speed is beyond the top speed.

    Examples
    --------
    >>> import seatrial as st
    >>> tuning = relay_autopilot("cwolf", "cwolf", speeds=[1.951])
    >>> [point.loop for point in tuning.points if point.gains]
    ['surge', 'pitch', 'heading']
    """
    if rule not in RULES:
        pid_gains(rule, "PID", ultimate_gain=1.0, period_s=1.0)
    on, start = loaded(Vehicle, vehicle), loaded(Autopilot, autopilot)
    amplitudes = _positive("shares", shares, most=0.9)
    _refuse_what_cannot_fly(on, start, voltage_v)
    supply = NOMINAL_V if voltage_v is None else voltage_v
    top = top_speeds(on, voltage_v=supply)[1]
    if speeds is None:
        tried = _reached(on, start, supply)
    else:
        tried = _positive("speeds", speeds)
        if max(tried) > top:
            raise SimulationError(
                f"speeds: expected at most the top speed of {on.name}, {top:.2f} m/s, found {max(tried):g}"
            )
    if not tried:
        raise SimulationError(
            f"{start.name}: no breakpoint above zero is within reach of {on.name}; give `speeds`"
        )
    points = []
    for loop in LOOPS:
        for speed in tried:
            if loop in mode_at(autopilot_facts(start), speed).loops:
                each = [
                    relay_trial(
                        on,
                        start,
                        loop=loop,
                        speed_m_s=speed,
                        share=share,
                        sensors=sensors,
                        voltage_v=voltage_v,
                    )
                    for share in amplitudes
                ]
                # A load may ask for the same amplitude at every share.
                trials = tuple({trial.d: trial for trial in each}.values())
                points.append(RelayPoint(loop, speed, trials, _gains(rule, loop, _taken(trials))))
    gains, sources = _scheduled(start, points)
    return RelayTuning(start.with_gains(gains), tuple(points), rule, sources)


def _taken(trials: Sequence[RelayTrial]) -> RelayTrial | None:
    usable = [
        (trial.cycle.ultimate_gain, trial) for trial in trials if trial.cycle is not None and trial.usable
    ]
    return min(usable, key=lambda pair: pair[0])[1] if usable else None


def _gains(rule: str, loop: str, trial: RelayTrial | None) -> PidGains | None:
    if trial is None or trial.cycle is None:
        return None
    of = "PI" if kind(loop) == "speed" else "PID"
    found = pid_gains(rule, of, ultimate_gain=trial.cycle.ultimate_gain, period_s=trial.cycle.period_s)
    return PidGains(three_digits(found.k_p), three_digits(found.k_i), three_digits(found.k_d))


def _scheduled(
    start: Autopilot, points: Sequence[RelayPoint]
) -> tuple[dict[str, float], dict[str, tuple[float, ...]]]:
    """Gains by name at all breakpoints, and the speeds that they come from."""
    gains: dict[str, float] = {}
    sources: dict[str, tuple[float, ...]] = {}
    for loop in dict.fromkeys(point.loop for point in points):
        usable = {p.speed_m_s: p.gains for p in points if p.loop == loop and p.gains is not None}
        if not usable:
            continue
        nearest = tuple(min(usable, key=lambda u: abs(u - abs(at))) for at in start.speeds_m_s)
        sources[loop] = nearest
        for k, speed in enumerate(nearest, start=1):
            of = usable[speed]
            gains |= {f"{loop}.K_P.{k}": of.k_p, f"{loop}.K_I.{k}": of.k_i, f"{loop}.K_D.{k}": of.k_d}
    return gains, sources


def _refuse_what_cannot_fly(vehicle: Vehicle, autopilot: Autopilot, voltage_v: float | None) -> None:
    """Refuse before the first trial what its flight would refuse, or would fly for nothing."""
    refuse_other_laws(autopilot)
    autopilot.engage(vehicle, straight(1.0))
    needed = [name for name, facts in vehicle.actuator_info().items() if facts["needs_voltage"]]
    if needed and voltage_v is None:
        raise SimulationError(
            f"voltage_v: the thrust of {vehicle.name} ({needed[0]}) depends on the supply voltage; give"
            " voltage_v, in V"
        )
    checked_supply(voltage_v, vehicle)


def _reached(vehicle: Vehicle, autopilot: Autopilot, voltage_v: float) -> list[float]:
    """Breakpoints above zero that the actuators can hold, m/s."""
    found = []
    for speed in autopilot.speeds_m_s:
        if speed > 0.0:
            rows = commanded_rows(autopilot, speed)
            about = trim(vehicle, speed, rows)
            if about is not None and about.tau[0] <= reach(vehicle, speed, rows, voltage_v=voltage_v)["X"][1]:
                found.append(float(speed))
    return found


def _positive(what: str, given: Sequence[float], *, most: float = math.inf) -> list[float]:
    """Numbers above zero and up to `most`, at least one."""
    try:
        numbers = [float(one) for one in given]
    except (TypeError, ValueError):
        numbers = []
    if not numbers or not all(math.isfinite(one) and 0.0 < one <= most for one in numbers):
        upto = f" and up to {most:g}" if math.isfinite(most) else ""
        raise SimulationError(f"{what}: expected numbers above zero{upto}, found {given!r}")
    return numbers


def _name(rule: str) -> str:
    return " and ".join(word.capitalize() for word in rule.split("-"))


def _speed(speed: float) -> str:
    return f"{speed:.3g}"


def _row(point: RelayPoint, trial: RelayTrial) -> str:
    """A line of the table."""
    text = f"{point.loop:<8} {point.speed_m_s:>5.3g} {trial.d:>6.3g}"
    if trial.cycle is None:
        return f"{text}  {trial.why}"
    cycle = trial.cycle
    text += f" {cycle.amplitude:>8.3g} {cycle.period_s:>6.3g} {cycle.ultimate_gain:>6.3g}"
    taken = trial is point.taken and point.gains is not None
    gains = point.gains
    text += f" {gains.k_p:>6.3g} {gains.k_i:>6.3g} {gains.k_d:>6.3g}" if taken and gains else " " * 21
    lead = f"{trial.lead_s:.2f}" if trial.lead_s else ""
    return f"{text}  {cycle.duty:.2f}  {lead:<4}  {trial.why}".rstrip()
