"""A flight that keeps time with the clock: vehicle, sensors and autopilot step by step, seen while it flies.

Once per control period the sensors are read, the autopilot steps (`seatrial._core.Helm`, or hardware over
UDP), its commands are held and the vehicle moves by a period, as in `seatrial.fly`; with perfect sensors the
motion is that of `seatrial.fly` to rounding. Held by ``tests/realtime/test_realtime_flight.py``.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial._core import Autopilot, State, Vehicle
from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError
from seatrial.base.files import parquet
from seatrial.base.plain import Plain
from seatrial.base.report import Reported, clause_of
from seatrial.base.run import RunDirectory, run_facts, sha256, to_json
from seatrial.base.toml_file import loaded
from seatrial.base.work import Clock, takes
from seatrial.flight.checks import mismatch
from seatrial.flight.conditions import CALM, PLAIN, Conditions, Water, used_only
from seatrial.flight.excesses import too_deep
from seatrial.flight.mission import Mission
from seatrial.flight.sensor_channels import sensors_of
from seatrial.realtime.hardware import Hardware, HardwareFacts, udp_hardware
from seatrial.realtime.live import Live
from seatrial.realtime.plant import Motion, Plant, Shown, motion_table

if TYPE_CHECKING:
    import polars as pl

    from seatrial._core import Helm


@dataclass(frozen=True)
class PaceSettings:
    """How exactly a flight keeps time, how fast, and for how long."""

    #: Last part of a wait that is spent looking at the clock, s: sleeping is only that exact.
    spin_s: float = 2e-4
    fastest_ratio: float = 1000.0  #: Highest speed over real time: a day in a minute and a half.
    longest_s: float = 24 * 3600.0  #: Longest flight, s: all samples of its day stay in memory.


SETTINGS = PaceSettings()


@dataclass(frozen=True, eq=False)
class Timing:
    """How a loop kept time."""

    period_s: float  #: Of the clock.
    #: `lateness`, `work`: of each tick, (n,), s.
    lateness: Array
    work: Array
    overruns: int  #: Ticks whose work ended after the next was due.

    def quantile(self, share: float) -> float:
        """Lateness that a share of the ticks stayed below, s."""
        return float(np.quantile(self.lateness, share)) if len(self.lateness) else 0.0

    def work_quantile(self, share: float) -> float:
        """Work that a share of the ticks stayed below, s."""
        return float(np.quantile(self.work, share)) if len(self.work) else 0.0

    def to_dict(self) -> dict[str, Any]:
        """The same as plain data."""
        return {
            "period_s": self.period_s,
            "ticks": len(self.lateness),
            "overruns": self.overruns,
            "late_s": {f"{share:g}": self.quantile(share) for share in (0.5, 0.9, 0.99, 1.0)},
            "work_s": {f"{share:g}": self.work_quantile(share) for share in (0.5, 0.9, 0.99, 1.0)},
        }


class Pacer:
    """Ticks of a period; call `wait` before the work of each.

    Tick k is due at ``begin + k period``. It overruns when its work ends after the next one is due; a late
    tick moves no later one: the loop catches up.

    `clock`, `sleep`: monotonic time in s, and a pause. Raises `SimulationError`: the period is not positive.

    Examples
    --------
    >>> pacer = Pacer(0.001)
    >>> for _ in range(3):
    ...     pacer.wait()
    >>> len(pacer.timing().lateness)
    3
    """

    def __init__(
        self,
        period_s: float,
        *,
        clock: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        if not period_s > 0.0:
            raise SimulationError(f"period: expected a positive time in s, found {period_s:g}")
        self._period, self._clock, self._sleep = period_s, clock, sleep
        self._begin: float | None = None
        self._due = 0.0
        self._began = 0.0
        self._late: list[float] = []
        self._work: list[float] = []
        self._overruns = 0

    def wait(self) -> None:
        """Return when the next tick is due, at once when it is already."""
        now = self._clock()
        if self._begin is None:
            self._begin = self._due = now
        else:
            self._finish(now)
            self._due = self._begin + len(self._late) * self._period
            while (left := self._due - self._clock()) > 0.0:
                if left > SETTINGS.spin_s:
                    self._sleep(left - SETTINGS.spin_s)
        self._began = self._clock()
        self._late.append(max(0.0, self._began - self._due))

    def timing(self) -> Timing:
        """How the ticks were kept; the one under way is finished."""
        if len(self._work) < len(self._late):
            self._finish(self._clock())
        return Timing(self._period, np.array(self._late), np.array(self._work), self._overruns)

    def _finish(self, now: float) -> None:
        if len(self._work) < len(self._late):
            self._work.append(now - self._began)
            self._overruns += now > self._due + self._period


_CHANNELS = ("x", "y", "z", "roll", "pitch", "yaw", "u", "v", "w", "p", "q", "r")


@dataclass(frozen=True, eq=False, repr=False)
class RealtimeFlight(
    Plain,
    Reported,
    only="vehicle=vehicle.name outcome complete depth_largest_m=deepest_m reaction cause speed timing"
    " hardware warnings notes",
):
    """A flight by the clock."""

    vehicle: Vehicle  #: What flew.
    outcome: str  #: "complete", "ended by safety", "time is up", "interrupted" or "diverged".
    #: `reaction`, `cause`: of the autopilot at the end, in words; empty with hardware.
    reaction: str
    cause: str
    timing: Timing  #: How the loop kept time.
    hardware: HardwareFacts | None  #: What went over the link; None without hardware.
    speed: float  #: Periods of motion per period of the clock.
    rows: list[list[float]]  #: Time, position, roll pitch yaw, nu, then commands and actuators, SI.
    notes: tuple[str, ...] = ()  #: What differs from the sensors as described.
    doubt: str = ""  #: Why the autopilot does not belong to the vehicle; empty where it does.
    max_depth_m: float = math.inf  #: The mission's largest depth; infinite without one.
    #: Texts of vehicle, autopilot and mission as they were used.
    inputs: Mapping[str, str] = field(default_factory=dict)
    clock: Clock = field(default_factory=Clock)  #: When it began.

    @property
    def complete(self) -> bool:
        """Whether the mission was completed within its depth; with hardware, whether the time was flown."""
        ended = self.outcome == ("time is up" if self.hardware is not None else "complete")
        return ended and not self.went_too_deep

    @property
    def went_too_deep(self) -> bool:
        """Whether the vehicle truly went deeper than the mission's largest depth."""
        return bool(too_deep({"depth_largest_m": self.deepest_m}, self.max_depth_m))

    @property
    def deepest_m(self) -> float:
        """Largest depth that was flown, m."""
        return max((row[3] for row in self.rows), default=0.0)

    def table(self) -> pl.DataFrame:
        """Motion and commands as the columns of a trial."""
        columns = [f"{kind}.{name}" for kind in ("cmd", "meas") for name in self.vehicle.actuators]
        return motion_table(self.rows, columns)

    def warnings(self) -> list[str]:
        """Doubts about the flight, as sentences."""
        return [f"{self.doubt}."] if self.doubt else []

    def save(self, folder: str | Path) -> Path:
        """Path of a run directory with the flight: JSON, Parquet, summary and inputs.

        Raises
        ------
        SeatrialError
            The directory cannot be written; nothing is left half-written.
        """
        files: dict[str, str | bytes] = {
            **{f"{name}.toml": text for name, text in self.inputs.items()},
            "flight.json": to_json(self.to_dict()),
            **self.report().files(),
            "flight.parquet": parquet(self.table()),
        }
        facts = run_facts(
            "flight",
            self.vehicle.name,
            clock=self.clock,
            inputs={name: sha256(text) for name, text in self.inputs.items()},
            options={"speed": self.speed, "realtime": True},
        )
        with RunDirectory(folder) as run:
            return run.publish(facts, files)


@takes(water=Water, conditions=Conditions)
def fly_realtime(
    vehicle: Vehicle | str | Path,
    autopilot: Autopilot | str | Path,
    mission: Mission | str | Path,
    *,
    water: Water = CALM,
    conditions: Conditions = PLAIN,
    speed: float = 1.0,
    seed: int = 0,
    live_host: str = "127.0.0.1",
    live_port: int | None = None,
    live_origins: Sequence[str] = (),
    record: str | Path | None = None,
    hardware: tuple[str, int] | Hardware | None = None,
    hardware_from: tuple[str, int] | None = None,
    watchdog_s: float = 0.5,
    ready: Callable[[int | None], None] | None = None,
) -> RealtimeFlight:
    """Flight by the clock, with measured jitter and overruns, shown live and recorded where it is asked for.

    Parameters
    ----------
    vehicle, autopilot, mission : Vehicle, Autopilot, Mission, str or Path
        What flies; with `hardware` autopilot and mission give the period, the start and the longest time.
    water : Water, optional
        Its current.
    conditions : Conditions, optional
        Its model, sensors, voltage_v, feedback and max_time_s.
    speed : float, optional
        Periods of motion per period of the clock; 1 is real time.
    seed : int, optional
        Of the sensors' errors.
    live_host, live_port : str, int, optional
        Address of the WebSocket for Foxglove; none without a port.
    live_origins : sequence of str, optional
        Origins of web pages that may watch, beside Foxglove's own and those of this machine.
    record : str or Path, optional
        MCAP file to write.
    hardware : (str, int) or Hardware, optional
        UDP address of autopilot hardware that steers instead.
    hardware_from : (str, int), optional
        Own address of that link; when omitted the one from which this machine reaches the hardware.
    watchdog_s : float, optional
        Time without a good packet of the hardware after which the actuators rest, s.
    ready : callable, optional
        Called with the port of the WebSocket before the first period.

    Raises
    ------
    VehicleError, TrialError, SimulationError
        A file or a number is not usable, or an address is not to be had.
    """
    clock = Clock()
    used_only(water, "current", by="a flight by the clock")
    used_only(
        conditions, *("model", "sensors", "voltage_v", "feedback", "max_time_s"), by="a flight by the clock"
    )
    voltage_v, max_time_s = conditions.voltage_v, conditions.max_time_s
    flown: Vehicle = loaded(Vehicle, vehicle)
    believed: Vehicle = flown if conditions.model is None else loaded(Vehicle, conditions.model)
    pilot: Autopilot = loaded(Autopilot, autopilot)
    route: Mission = loaded(Mission, mission)
    if not 0.0 < speed <= SETTINGS.fastest_ratio:
        raise SimulationError(
            f"speed: expected more than 0 and at most {SETTINGS.fastest_ratio:g}, found {speed:g}"
        )
    helm = pilot.engage(believed, route)
    longest = 3.0 * route.planned_time + 300.0 if max_time_s is None else max_time_s
    if not 0.0 < longest <= SETTINGS.longest_s:
        raise SimulationError(f"max_time_s: expected up to {SETTINGS.longest_s:g} s, found {longest:g}")
    plant = Plant(flown, initial=_start(route), current=water.current, voltage_v=voltage_v)
    chosen = sensors_of(conditions.sensors, flown)
    shown = None if chosen is None else Shown(chosen, seed)
    mismatched = mismatch(pilot, believed)
    doubt = "" if mismatched is None else clause_of(mismatched, "flight_findings")
    notes = () if shown is None else shown.sentences
    info = flown.actuator_info()
    neutral = {name: float(info[name]["neutral"]) for name in flown.actuators}
    # An address is opened here and closed below; a link that was given is the caller's.
    link = None
    if isinstance(hardware, tuple):
        hardware, link = udp_hardware(
            hardware, flown.actuators, neutral, listen_on=hardware_from, watchdog_s=watchdog_s
        )
    # From here on viewers and links are open: whatever happens, they are closed.
    live = None
    try:
        if live_port is not None or record is not None:
            path = None if record is None else Path(record)
            live = Live(flown, host=live_host, port=live_port, record=path, origins=live_origins)
        if ready is not None:
            ready(None if live is None else live.port)
        loop = _Flight(plant, helm, shown, hardware, live, neutral, (voltage_v, conditions.feedback))
        pacer = Pacer(pilot.period_s / speed)
        outcome = loop.run(pacer, pilot.period_s, longest)
        timing = pacer.timing()
    finally:
        if live is not None:
            live.close()
        if link is not None:
            link.close()
    # Hardware does not tell why it ended.
    thought = {} if hardware is not None else helm.thought
    return RealtimeFlight(
        vehicle=flown,
        outcome=outcome,
        reaction=str(thought.get("reaction", "")),
        cause=str(thought.get("cause", "") or ""),
        timing=timing,
        hardware=None if hardware is None else hardware.facts(),
        speed=speed,
        rows=loop.rows,
        notes=notes,
        doubt=doubt,
        max_depth_m=route.limits["max_depth_m"],
        inputs={"vehicle": flown.to_toml(), "autopilot": pilot.to_toml(), "mission": route.to_toml()},
        clock=clock,
    )


def _start(mission: Mission) -> State:
    start = mission.start
    position = [start["north_m"], start["east_m"], start["depth_m"]]
    return State(position, [0.0, 0.0, start["heading"]])


class _Flight:
    """The loop of a flight by the clock."""

    def __init__(
        self,
        plant: Plant,
        helm: Helm,
        shown: Shown | None,
        hardware: Hardware | None,
        live: Live | None,
        neutral: Mapping[str, float],
        supply: tuple[float | None, bool],
    ) -> None:
        self.plant, self.helm, self.shown, self.hardware = plant, helm, shown, hardware
        self.live, self.neutral = live, neutral
        self.voltage_v, self.feedback = supply
        self.rows: list[list[float]] = []

    def run(self, pacer: Pacer, period_s: float, longest_s: float) -> str:
        """Outcome of the flight."""
        try:
            for _ in range(math.floor(longest_s / period_s) + 1):
                pacer.wait()
                motion = self.plant.motion
                if not np.isfinite(motion.nu).all():
                    return "diverged"
                commands = self._commands(motion)
                self._log(motion, commands)
                if self.hardware is None and self.helm.thought.get("ended"):
                    return (
                        "complete" if self.helm.thought.get("reaction") == "continue" else "ended by safety"
                    )
                self.plant.advance(commands, period_s)
        except KeyboardInterrupt:
            return "interrupted"
        return "time is up"

    def _commands(self, motion: Motion) -> dict[str, float]:
        seen = motion if self.shown is None else self.shown.measure(motion)
        if self.hardware is not None:
            supply = {} if self.voltage_v is None else {"voltage_v": self.voltage_v}
            return self.hardware.exchange(seen, **supply)
        row = seen.numbers
        # A sample that is held from before was not measured: it grows old by itself.
        fresh = [True] * len(row) if self.shown is None else self.shown.fresh.tolist()
        values = {name: value for name, value, new in zip(_CHANNELS, row, fresh, strict=True) if new}
        if self.shown is None:
            values |= dict(zip(("u_water", "v_water", "w_water"), self.plant.through_water, strict=True))
        if self.voltage_v is not None:
            values["voltage"] = self.voltage_v
        signals = {**self.neutral, **self.plant.actuators} if self.feedback else None
        return dict(self.helm.step(values, signals))

    def _log(self, motion: Motion, commands: Mapping[str, float]) -> None:
        done = {**self.neutral, **self.plant.actuators}
        names = self.plant.vehicle.actuators
        given = (commands.get(name, self.neutral[name]) for name in names)
        self.rows.append([motion.t_s, *motion.numbers, *given, *(done[name] for name in names)])
        if self.live is not None:
            self.live.show(motion, self._numbers(motion, commands, done))

    def _numbers(
        self, motion: Motion, commands: Mapping[str, float], done: Mapping[str, float]
    ) -> dict[str, Any]:
        """What is plotted: units as in the columns of a trial."""
        euler = np.rad2deg(motion.euler)
        numbers: dict[str, Any] = {
            "depth_m": float(motion.position[2]),
            "north_m": float(motion.position[0]),
            "east_m": float(motion.position[1]),
            "roll_deg": float(euler[0]),
            "pitch_deg": float(euler[1]),
            "yaw_deg": float(euler[2]),
            "nu": dict(zip("uvwpqr", motion.nu.tolist(), strict=True)),
            "cmd": {name: float(value) for name, value in commands.items()},
            "meas": {name: float(value) for name, value in done.items()},
        }
        if self.hardware is None:
            thought = self.helm.thought
            numbers["desired"] = {
                key: value
                for key, value in thought.items()
                if isinstance(value, float) and math.isfinite(value)
            }
            numbers["mode"] = str(thought.get("mode", ""))
        return numbers
