"""What a manoeuvre is: commands over time, and how the vehicle is started.

Shapes of manoeuvres: levels from -1 to 1 over time, of which a drive makes thrusts.

All are pure functions of times (n,) in s from zero on and of the duration; they end with nothing. The zigzag
and the spiral are those of ships' trials, but switched by time, because nothing steers.

Sources: ITTC 7.5-04-02-01, *Full scale manoeuvring trials*, 2.2.2 and 2.2.5; Schroeder, *Synthesis of
low-peak-factor signals and binary sequences with low autocorrelation*, IEEE Trans. Inf. Theory 16:85 (1970);
Van der Ouderaa, Schoukens, Renneboog, *Peak factor minimization using a time-frequency domain swapping
algorithm*, IEEE Trans. Instrum. Meas. 37:145 (1988).

Free decay: let go from a heel or trim, or at depth, and left alone: damping, inertia and righting moment.

It needs no thrust, so that what it tells does not hang on the thrusters' calibration. Source: ITTC
7.5-02-07-04.5, *Numerical estimation of roll damping* (2011), section 6.4.1.

The repertoire: what is sailed to identify a vehicle, for any vehicle with drives.

Every function returns a `Manoeuvre` whose commands lie within the motors' limits. `amplitude`, from 0 to 1,
is a share of what the drive reaches besides the thrust that carries the net weight and the thrust ahead;
`ahead` is a word of the engine telegraph (`drive.AHEAD`). Open loop: nothing steers, so the vehicle goes
where physics takes it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.atomic_write import write_table
from seatrial.base.channels import AXES
from seatrial.base.errors import VehicleError
from seatrial.experiment.drives import MOTIONS, Drive, Thrusters
from seatrial.vehicle.actuators import voltage_for

if TYPE_CHECKING:
    import polars as pl

__all__ = [
    "RATE_HZ",
    "SETTLE_S",
    "TURN_BACK_S",
    "Kind",
    "Manoeuvre",
    "Start",
    "coast_down",
    "coast_down_levels",
    "dive",
    "free_decay",
    "held_levels",
    "multisine",
    "multisine_levels",
    "spiral",
    "spiral_levels",
    "staircase",
    "staircase_levels",
    "steady_speed",
    "times",
    "zigzag",
    "zigzag_levels",
]

RATE_HZ = 10.0
"""Samples of commands per second."""

TURN_BACK_S, SETTLE_S = 30.0, 15.0
"""Pauses before a manoeuvre is sailed again: of one that travels, of one that stays in place."""

Kind = Literal["staircase", "coast-down", "zigzag", "spiral", "dive", "free decay", "multisine", "commands"]


@dataclass(frozen=True)
class Start:
    """How a manoeuvre starts: attitude, speed ahead, and that in words for who sails it."""

    roll_deg: float = 0.0
    pitch_deg: float = 0.0
    surge_m_s: float = 0.0
    words: str = "at rest and level"


@dataclass(frozen=True, eq=False)
class Manoeuvre:
    """Open-loop commands over time.

    Attributes
    ----------
    name, kind
        What to call it: "zigzag yaw, half ahead".
    words
        What is done, in a sentence.
    t
        Uniform times in s, shape (n,), from zero on.
    commands
        By actuator (n,), each in its own unit, held from sample to sample.
    start
        State at t = 0.
    pause_s
        Time that it takes to start it again: turning back, tilting the vehicle by hand.
    """

    name: str
    kind: Kind
    words: str
    t: Array
    commands: Mapping[str, Array]
    start: Start = field(default_factory=Start)
    pause_s: float = 0.0

    @property
    def duration_s(self) -> float:
        """Time from the first to the last sample, s."""
        return float(self.t[-1] - self.t[0])

    @property
    def dt(self) -> float:
        """Interval of the samples, s."""
        return self.duration_s / (len(self.t) - 1)

    def repeats(self, budget_s: float) -> int:
        """How often it can be sailed in a time, pauses between included."""
        # A thousandth more than fits: durations are rounded to samples.
        return int((1.001 * budget_s + self.pause_s) // (self.duration_s + self.pause_s))

    def table(self) -> pl.DataFrame:
        """Columns ``t_s, cmd.<actuator> ...``: what `seatrial simulate` and `Trial.read` read."""
        import polars as pl

        return pl.DataFrame(
            {"t_s": np.round(self.t, 6)} | {f"cmd.{name}": np.asarray(y) for name, y in self.commands.items()}
        )

    def write_csv(self, path: str | Path) -> None:
        """Write `table` as comma-separated values.

        Raises
        ------
        TrialError
            The file cannot be written.
        """
        write_table(self.table(), path)


def times(duration_s: float) -> Array:
    """Uniform times (n,) in s from zero to the duration, both included.

    Raises
    ------
    VehicleError
        Less than a second.
    """
    if not (np.isfinite(duration_s) and duration_s >= 1.0):
        raise VehicleError(f"duration: expected at least one second, found {duration_s:g} s")
    return np.arange(round(duration_s * RATE_HZ) + 1) / RATE_HZ


_LEAST_HOLD_S = 4.0

_ROUNDS = 40


def held_levels(t: Array, levels: Sequence[float], ends: Sequence[float]) -> Array:
    """Levels (n,), each held until its end in s; zero after the last.

    Examples
    --------
    >>> held(np.arange(5.0), [1.0, -1.0], [2.0, 4.0])
    array([ 1.,  1., -1., -1.,  0.])
    """
    place = np.searchsorted(np.asarray(ends) - 1e-9, t, side="right")
    return np.append(np.asarray(levels, dtype=float), 0.0)[place]


def staircase_levels(t: Array, duration_s: float, *, steps: int = 4, both: bool = True) -> Array:
    """Levels (n,) that rise in equal steps and drop to zero, then the same with the other sign if `both`."""
    rise = [*np.arange(1, steps + 1) / steps, 0.0]
    levels = [0.0, *rise, *(-level for level in rise)] if both else [0.0, *rise]
    return _even(t, levels, duration_s)


def coast_down_levels(
    t: Array, duration_s: float, *, both: bool = True, levels: Sequence[float] = (1.0, 0.5)
) -> Array:
    """Levels (n,): driven, then nothing for as long, at each level; if `both` with either sign."""
    cycles: list[float] = []
    for level in levels:
        cycles += [level, 0.0, -level, 0.0] if both else [level, 0.0]
    return _even(t, [0.0, *cycles], duration_s, weights=[0.25, *[1.0] * len(cycles)])


def zigzag_levels(t: Array, duration_s: float, *, switch_s: float) -> Array:
    """Levels (n,) +1 and -1 in turn: first for half the switching time, then for all of it, half at the end.

    What it turns is turned back: the sum of the levels is zero.
    """
    whole = max(int(duration_s / max(switch_s, _LEAST_HOLD_S)), 2)
    signs = [(-1.0) ** k for k in range(whole + 1)]
    weights = [0.5, *[1.0] * (whole - 1), 0.5]
    if whole % 2:  # an even number of halves, so that the signs cancel
        signs, weights = signs[:-1], [0.5, *[1.0] * (whole - 2), 0.5]
    return _even(t, signs, duration_s, weights=weights)


def spiral_levels(t: Array, duration_s: float, *, steps: int = 3) -> Array:
    """Levels (n,) from zero through +1/steps ... +1 and, the other way round, -1/steps ... -1."""
    rise = np.arange(1, steps + 1) / steps
    return _even(t, [0.0, *rise, *-rise], duration_s)


def multisine_levels(
    t: Array, duration_s: float, *, band_hz: tuple[float, float] = (0.02, 0.25), of: int = 1, place: int = 0
) -> Array:
    """Levels (n,) of a sum of sines between two frequencies, largest level one, amplitude as 1/sqrt(f).

    Schroeder's phases, then a few rounds of clipping, keep the crest low. Of several signals at once (`of`)
    each has its own harmonics of the duration (`place`), so that no two are correlated.

    Parameters
    ----------
    t : ndarray, shape (n,)
    duration_s : float
        The signal repeats after this time.
    band_hz : tuple of float
        Lowest and highest frequency.
    of, place : int
        Number of signals that are sailed together, and which of them this one is.
    """
    lowest = max(int(np.ceil(band_hz[0] * duration_s)), 1)
    highest = max(int(band_hz[1] * duration_s), lowest + 2 * of)
    lines = np.arange(lowest + place, highest + 1, of)
    power = 1.0 / lines
    power = power / power.sum()
    phases = -2.0 * np.pi * (np.cumsum(np.cumsum(power)) - np.cumsum(power))
    fine = np.arange(16 * highest) / (16 * highest)
    turns = np.exp(2j * np.pi * np.outer(lines, fine))
    size = np.sqrt(power)
    for _ in range(_ROUNDS):
        signal = (size[:, None] * np.real(np.exp(1j * phases)[:, None] * turns)).sum(axis=0)
        # Clip what stands out and keep the phases of what is left (Van der Ouderaa).
        clipped = np.clip(signal, -0.85 * np.abs(signal).max(), 0.85 * np.abs(signal).max())
        phases = np.angle((turns.conj() * clipped).sum(axis=1))
    at = 2.0 * np.pi * np.outer(t / duration_s, lines)
    levels = np.cos(at + phases) @ size
    return np.asarray(
        np.where(t < duration_s - 1e-9, levels / max(np.abs(signal).max(), np.abs(levels).max()), 0.0)
    )


def _even(
    t: Array, levels: Sequence[float], duration_s: float, *, weights: Sequence[float] | None = None
) -> Array:
    """Levels held for equal times, or times in the ratio of the weights, that fill the duration."""
    shares = np.ones(len(levels)) if weights is None else np.asarray(weights, dtype=float)
    return held_levels(t, levels, np.cumsum(shares) / shares.sum() * duration_s)


_SPEEDS_UP_S = 120.0


def free_decay(
    thrusters: Thrusters, axis: str, *, duration_s: float, angle_deg: float = 20.0, ahead: str | None = None
) -> Manoeuvre:
    """Let go from a heel ("K") or trim ("M"), or at depth ("Z"): motors stopped, or steadily ahead.

    Parameters
    ----------
    thrusters : Thrusters
    axis : str
        "K", "M" or "Z".
    duration_s : float
    angle_deg : float
        Heel to starboard or trim bow up; of heave it says nothing.
    ahead : str, optional
        Keep this thrust ahead and begin at the speed that it gives.

    Raises
    ------
    VehicleError
        No such decay.
    """
    vehicle = thrusters.vehicle
    if axis not in "KMZ":
        raise VehicleError(f"free decay: expected axis K (roll), M (pitch) or Z (heave), found {axis!r}")
    t = times(duration_s)
    held = np.zeros(len(thrusters.names)) if ahead is None else thrusters.ahead(ahead) + thrusters.trim()
    surge = 0.0 if ahead is None else steady_speed(thrusters, held)
    motors = "motors stopped" if ahead is None else f"{ahead} ahead, {surge:.1f} m/s"
    if axis == "Z":
        start = Start(surge_m_s=surge, words=f"held at depth and let go, {motors}")
    else:
        tilt = np.deg2rad([angle_deg, 0.0, 0.0] if axis == "K" else [0.0, angle_deg, 0.0])
        moment = float(np.asarray(vehicle.forces(np.zeros(6), tilt)["restoring"])[AXES.index(axis)])
        way = "heeled to starboard" if axis == "K" else "trimmed bow up"
        words = f"{way} by {angle_deg:.0f} deg ({abs(moment):.2g} N m) and let go, {motors}"
        roll, pitch = (angle_deg, 0.0) if axis == "K" else (0.0, angle_deg)
        start = Start(roll_deg=roll, pitch_deg=pitch, surge_m_s=surge, words=words)
    way = f", {ahead} ahead" if ahead else ""
    size = "" if axis == "Z" else f", {angle_deg:.0f} deg"
    return Manoeuvre(
        name=f"free decay of {MOTIONS[axis]}{size}{way}",
        kind="free decay",
        words="let go, to either side in turn, and left alone until it is still" if axis != "Z" else "let go",
        t=t,
        commands=thrusters.commands(np.tile(held, (len(t), 1))),
        start=start,
        pause_s=SETTLE_S,
    )


def steady_speed(thrusters: Thrusters, thrusts: Array) -> float:
    """Speed ahead in m/s that constant thrusts (actuators,) at rest come to, on a straight course."""
    t = np.arange(0.0, _SPEEDS_UP_S, 0.25)
    commands = thrusters.commands(np.tile(thrusts, (len(t), 1)))
    voltage = voltage_for(thrusters.vehicle, t, thrusters.voltage_v)
    run = thrusters.vehicle.simulate(t, dict(commands), free="X", voltage=voltage)
    return float(np.asarray(run.nu)[-1, 0])


_RUN_UP = 0.12

_LONGEST_RUN_UP_S = 20.0

_LEAD_S = 2.0  # nothing happens: what the instruments show at rest

Level = Callable[[Array, float], Array]


def staircase(
    thrusters: Thrusters, drive: Drive, *, duration_s: float, amplitude: float = 0.9, both: bool = True
) -> Manoeuvre:
    """Steps of thrust up to the amplitude and back to nothing, then in the other sense if `both`.

    Examples
    --------
    >>> import seatrial as st
    >>> thrusters = Thrusters(st.Vehicle.load("cwolf"))
    >>> surge = thrusters.drives_of("X")[0]
    >>> manoeuvre = staircase(thrusters, surge, duration_s=120.0)
    >>> manoeuvre.name, round(float(max(manoeuvre.commands["SbU"])))
    ('staircase surge, ahead and astern', 1897)
    """
    name = f"staircase {_called(thrusters, drive)}"
    if drive.axis == "X":
        name += ", ahead and astern" if both else ", ahead"
    senses = "in both senses" if both else "ahead"
    words = f"{drive.motion} in four steps to {100 * amplitude:.0f} % of the thrust, {senses}"
    return _sailed(
        thrusters,
        ("staircase", name, words),
        [(drive, lambda t, span: staircase_levels(t, span, both=both))],
        duration_s=duration_s,
        amplitude=amplitude,
    )


def coast_down(thrusters: Thrusters, drive: Drive, *, duration_s: float, amplitude: float = 0.9) -> Manoeuvre:
    """Driven up to speed, then let run out, at two speeds; of all but surge in both senses."""
    both = drive.axis != "X"
    return _sailed(
        thrusters,
        (
            "coast-down",
            f"coast-down {_called(thrusters, drive)}",
            f"{drive.motion} driven with {100 * amplitude:.0f} % and half of that, each time let run out",
        ),
        [(drive, lambda t, span: coast_down_levels(t, span, both=both))],
        duration_s=duration_s,
        amplitude=amplitude,
    )


def zigzag(
    thrusters: Thrusters,
    drive: Drive,
    *,
    duration_s: float,
    ahead: str = "half",
    amplitude: float = 0.5,
    switch_s: float = 15.0,
) -> Manoeuvre:
    """To one side and the other in turn, under way; of a vertical or pitch drive it is a `dive`."""
    return _sailed(
        thrusters,
        (
            "zigzag",
            f"zigzag {_called(thrusters, drive)}, {ahead} ahead",
            f"{ahead} ahead; {drive.motion} to both sides in turn with {100 * amplitude:.0f} % of the thrust"
            f" that is left, switched every {switch_s:g} s",
        ),
        [(drive, lambda t, span: zigzag_levels(t, span, switch_s=switch_s))],
        duration_s=duration_s,
        amplitude=amplitude,
        ahead=ahead,
    )


def spiral(
    thrusters: Thrusters, drive: Drive, *, duration_s: float, ahead: str = "half", amplitude: float = 0.5
) -> Manoeuvre:
    """Turning tighter step by step, first to one side, then to the other, under way."""
    return _sailed(
        thrusters,
        (
            "spiral",
            f"spiral {_called(thrusters, drive)}, {ahead} ahead",
            f"{ahead} ahead; {drive.motion} in three steps to {100 * amplitude:.0f} % of the thrust that is"
            " left, to starboard and then to port",
        ),
        [(drive, spiral_levels)],
        duration_s=duration_s,
        amplitude=amplitude,
        ahead=ahead,
    )


def dive(
    thrusters: Thrusters,
    drive: Drive,
    *,
    duration_s: float,
    ahead: str | None = None,
    amplitude: float = 0.5,
    switch_s: float = 12.0,
) -> Manoeuvre:
    """Down and up in turn by a heave or pitch drive, at rest or under way."""
    way = f"{ahead} ahead" if ahead else "without way"
    return _sailed(
        thrusters,
        (
            "dive",
            f"dive by {_called(thrusters, drive)}, {way}",
            f"{way}; {drive.motion} down and up in turn with {100 * amplitude:.0f} % of the thrust that is"
            f" left, switched every {switch_s:g} s",
        ),
        [(drive, lambda t, span: zigzag_levels(t, span, switch_s=switch_s))],
        duration_s=duration_s,
        amplitude=amplitude,
        ahead=ahead,
    )


def multisine(
    thrusters: Thrusters,
    drives: Sequence[Drive],
    *,
    duration_s: float,
    ahead: str | None = None,
    amplitude: float = 0.5,
    band_hz: tuple[float, float] = (0.02, 0.25),
) -> Manoeuvre:
    """Sums of sines with low crest on one drive or several at once, each with its own frequencies."""

    def part(place: int) -> Level:
        return lambda t, span: multisine_levels(t, span, band_hz=band_hz, of=len(drives), place=place)

    which = _called(thrusters, drives[0]) if len(drives) == 1 else "all axes"
    way = f", {ahead} ahead" if ahead else ""
    begun = f"{ahead} ahead; " if ahead else ""
    motions = list(dict.fromkeys(drive.motion for drive in drives))
    spoken = f"{', '.join(motions[:-1])} and {motions[-1]} together" if len(motions) > 1 else motions[0]
    return _sailed(
        thrusters,
        (
            "multisine",
            f"multisine {which}{way}",
            f"{begun}{spoken} excited from {band_hz[0]:g} to {band_hz[1]:g} Hz with"
            f" {100 * amplitude:.0f} % of the thrust",
        ),
        [(drive, part(place)) for place, drive in enumerate(drives)],
        duration_s=duration_s,
        amplitude=amplitude,
        ahead=ahead,
    )


def _sailed(
    thrusters: Thrusters,
    called: tuple[Kind, str, str],
    parts: Sequence[tuple[Drive, Level]],
    *,
    duration_s: float,
    amplitude: float,
    ahead: str | None = None,
) -> Manoeuvre:
    """Manoeuvre of drives at levels, on top of what carries the net weight and of thrust ahead."""
    if not 0.0 < amplitude <= 1.0:
        raise VehicleError(f"{called[1]}: expected an amplitude above 0 and up to 1, found {amplitude:g}")
    t = times(duration_s)
    trim = thrusters.trim()
    bias = trim if ahead is None else trim + thrusters.ahead(ahead)
    run_up = _LEAD_S if ahead is None else max(min(_RUN_UP * duration_s, _LONGEST_RUN_UP_S), _LEAD_S)
    extra = np.zeros((len(t), len(thrusters.names)))
    for drive, level in parts:
        shape = np.where(t >= run_up, level(np.maximum(t - run_up, 0.0), duration_s - run_up), 0.0)
        # Staircases go as far as they can in each sense; what should come back pushes as hard both ways.
        extra += thrusters.push(drive, amplitude * shape, bias, even=called[0] != "staircase")
    room = np.where(extra > 0.0, thrusters.upper - bias, bias - thrusters.lower)
    with np.errstate(divide="ignore", invalid="ignore"):
        fits = np.where(np.abs(extra) > 1e-9, room / np.abs(extra), np.inf).min(initial=np.inf)
    thrusts = bias + min(fits, 1.0) * extra
    kind, name, words = called
    travels = ahead is not None or any(drive.axis == "X" for drive, _ in parts)
    return Manoeuvre(
        name, kind, words, t, thrusters.commands(thrusts), pause_s=TURN_BACK_S if travels else SETTLE_S
    )


def _called(thrusters: Thrusters, drive: Drive) -> str:
    """Motion, and by which group where several drive it."""
    several = sum(other.axis == drive.axis for other in thrusters.drives) > 1
    return f"{drive.motion} ({drive.group})" if several else drive.motion
