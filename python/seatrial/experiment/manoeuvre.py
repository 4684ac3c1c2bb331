"""Manoeuvres to identify a vehicle: staircase, coast-down, zigzag, spiral, dive, multisine, free decay.

A `Manoeuvre` is a table of open-loop commands with the state at its start. Every function here makes one from
the vehicle's actuator combinations (`seatrial.experiment.combinations`); its commands lie within the motors'
limits. ``amplitude``, from 0 to 1, is a share of what the combination reaches beside the thrust that carries
the net weight and the thrust ahead; ``ahead`` is a word of the engine telegraph (`combinations.AHEAD`).
Nothing steers, so the vehicle goes where physics takes it: zigzag and spiral are those of ships' trials, but
switched by time. Levels from -1 to 1 over times (n,) in s from zero on end at zero. A free decay needs no
thrust, so that its result does not depend on the calibration of the thrusters.

Sources: ITTC 7.5-04-02-01, *Full scale manoeuvring trials*, 2.2.2 and 2.2.5; ITTC 7.5-02-07-04.5, *Numerical
estimation of roll damping* (2011), section 6.4.1 (free decay); Schroeder, *Synthesis of low-peak-factor
signals and binary sequences with low autocorrelation*, IEEE Trans. Inf. Theory 16:85 (1970); Van der Ouderaa,
Schoukens, Renneboog, *Peak factor minimization*, IEEE Trans. Instrum. Meas. 37:145 (1988).

Held by ``tests/experiment/test_manoeuvre.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, MOTIONS
from seatrial.base.errors import VehicleError
from seatrial.base.files import write_table
from seatrial.experiment.combinations import Combination, Thrusters
from seatrial.vehicle.actuators import voltage_for

if TYPE_CHECKING:
    import polars as pl

RATE_HZ = 10.0
"""Samples of commands per second."""


def times(duration_s: float) -> Array:
    """Uniform times (n,) in s from zero to the duration, both included; at least a second."""
    if not (np.isfinite(duration_s) and duration_s >= 1.0):
        raise VehicleError(f"duration: expected at least one second, found {duration_s:g} s")
    return np.arange(round(duration_s * RATE_HZ) + 1) / RATE_HZ


def held_levels(t: Array, levels: Sequence[float], ends: Sequence[float]) -> Array:
    """Levels (n,), each held until its end in s; zero after the last.

    Examples
    --------
    >>> held_levels(np.arange(5.0), [1.0, -1.0], [2.0, 4.0])
    array([ 1.,  1., -1., -1.,  0.])
    """
    index = np.searchsorted(np.asarray(ends) - 1e-9, t, side="right")
    return np.append(np.asarray(levels, dtype=float), 0.0)[index]


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
    whole = max(int(duration_s / max(switch_s, 4.0)), 2)  # levels are held no shorter than 4 s
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
    t: Array, duration_s: float, *, band_hz: tuple[float, float] = (0.02, 0.25), of: int = 1, index: int = 0
) -> Array:
    """Levels (n,) of a sum of sines between two frequencies, largest level one, amplitude as 1/sqrt(f).

    Schroeder's phases, then a few rounds of clipping, keep the crest low. The signal repeats after
    `duration_s`. Of several signals at once (`of`) each has its own harmonics of the duration (`index`), so
    that no two are correlated.
    """
    lowest = max(int(np.ceil(band_hz[0] * duration_s)), 1)
    highest = max(int(band_hz[1] * duration_s), lowest + 2 * of)
    lines = np.arange(lowest + index, highest + 1, of)
    power = 1.0 / lines
    power = power / power.sum()
    phases = -2.0 * np.pi * (np.cumsum(np.cumsum(power)) - np.cumsum(power))
    fine = np.arange(16 * highest) / (16 * highest)
    turns = np.exp(2j * np.pi * np.outer(lines, fine))
    size = np.sqrt(power)
    for _ in range(40):  # rounds of clipping
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


@dataclass(frozen=True)
class RunSettings:
    """What comes before and after a manoeuvre."""

    turn_back_s: float = 30.0  #: Pause before a manoeuvre that travels is repeated, s.
    settle_s: float = 15.0  #: Pause before a manoeuvre that stays in place is repeated, s.
    run_up_share: float = 0.12  #: Of a manoeuvre that its run-up takes.
    longest_run_up_s: float = 20.0  #: A run-up takes no longer, s.
    lead_s: float = 2.0  #: Nothing happens, s: what the instruments show at rest.


SETTINGS = RunSettings()
Kind = Literal["staircase", "coast-down", "zigzag", "spiral", "dive", "free decay", "multisine", "commands"]


@dataclass(frozen=True)
class Start:
    """State at the start of a manoeuvre: attitude, speed ahead, and the same in words for the operator."""

    roll_deg: float = 0.0
    pitch_deg: float = 0.0
    surge_m_s: float = 0.0
    words: str = "at rest and level"


@dataclass(frozen=True, eq=False)
class Manoeuvre:
    """Open-loop commands over time.

    `name`, `kind`: what to call it: "zigzag yaw, half ahead". `words`: what is done, in a sentence. `t`:
    uniform times (n,) in s, from zero on. `commands`: by actuator (n,), each in its own unit, held from
    sample to sample. `start`: state at t = 0. `pause_s`: time that it takes to start it again: turning back,
    tilting the vehicle by hand.
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
        """How often it can be run within a time, with pauses between the runs."""
        # A thousandth more than fits: durations are rounded to samples.
        return int((1.001 * budget_s + self.pause_s) // (self.duration_s + self.pause_s))

    def table(self) -> pl.DataFrame:
        """Columns ``t_s, cmd.<actuator> ...``: what `seatrial simulate` and `Trial.read` read."""
        import polars as pl

        return pl.DataFrame(
            {"t_s": np.round(self.t, 6)} | {f"cmd.{name}": np.asarray(y) for name, y in self.commands.items()}
        )

    def write_csv(self, path: str | Path) -> None:
        """Write `table` as comma-separated values."""
        write_table(self.table(), path)


def free_decay(
    thrusters: Thrusters, axis: str, *, duration_s: float, angle_deg: float = 20.0, ahead: str | None = None
) -> Manoeuvre:
    """Let go from a heel ("K") or trim ("M"), or at depth ("Z"): motors stopped, or steadily ahead.

    Heeled to starboard or trimmed bow up by `angle_deg`; with `ahead` the thrust is kept, from the speed that
    it gives. Raises VehicleError where the axis is none of these.
    """
    vehicle = thrusters.vehicle
    if axis not in "KMZ":
        raise VehicleError(f"free decay: expected axis K (roll), M (pitch) or Z (heave), found {axis!r}")
    t = times(duration_s)
    # The speed at the start is the one that the thrust comes to.
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
    name = f"free decay of {MOTIONS[axis]}{size}{way}"
    words = "let go, to either side in turn, and left alone until it is still" if axis != "Z" else "let go"
    return Manoeuvre(
        name=name,
        kind="free decay",
        words=words,
        t=t,
        commands=thrusters.commands(np.tile(held, (len(t), 1))),
        start=start,
        pause_s=SETTINGS.settle_s,
    )


def steady_speed(thrusters: Thrusters, thrusts: Array) -> float:
    """Speed ahead in m/s that constant thrusts (actuators,) at rest come to, on a straight course."""
    t = np.arange(0.0, 120.0, 0.25)  # at its end the speed counts as steady
    commands = thrusters.commands(np.tile(thrusts, (len(t), 1)))
    voltage = voltage_for(thrusters.vehicle, t, thrusters.voltage_v)
    run = thrusters.vehicle.simulate(t, dict(commands), free="X", voltage_v=voltage)
    return float(np.asarray(run.nu)[-1, 0])


Level = Callable[[Array, float], Array]


def staircase(
    thrusters: Thrusters,
    combination: Combination,
    *,
    duration_s: float,
    amplitude: float = 0.9,
    both: bool = True,
) -> Manoeuvre:
    """Steps of thrust up to the amplitude and back to nothing, then in the other sense if `both`.

    Examples
    --------
    >>> import seatrial as st
    >>> thrusters = Thrusters(st.Vehicle.load("cwolf"))
    >>> surge = thrusters.combinations_of("X")[0]
    >>> manoeuvre = staircase(thrusters, surge, duration_s=120.0)
    >>> manoeuvre.name, round(float(max(manoeuvre.commands["SbU"])))
    ('staircase surge, ahead and astern', 1897)
    """
    name = f"staircase {_called(thrusters, combination)}"
    if combination.axis == "X":
        name += ", ahead and astern" if both else ", ahead"
    senses = "in both senses" if both else "ahead"
    words = f"{combination.motion} in four steps to {100 * amplitude:.0f} % of the thrust, {senses}"
    parts = [(combination, partial(staircase_levels, both=both))]
    return _manoeuvre(thrusters, ("staircase", name, words), parts, duration_s, amplitude)


def coast_down(
    thrusters: Thrusters, combination: Combination, *, duration_s: float, amplitude: float = 0.9
) -> Manoeuvre:
    """Accelerated, then left without thrust, at two speeds; in both senses except for surge."""
    both = combination.axis != "X"
    name = f"coast-down {_called(thrusters, combination)}"
    words = (
        f"{combination.motion} driven with {100 * amplitude:.0f} % and half of that, coasting"
        " to a stop after each"
    )
    parts = [(combination, partial(coast_down_levels, both=both))]
    return _manoeuvre(thrusters, ("coast-down", name, words), parts, duration_s, amplitude)


def zigzag(
    thrusters: Thrusters,
    combination: Combination,
    *,
    duration_s: float,
    ahead: str = "half",
    amplitude: float = 0.5,
    switch_s: float = 15.0,
) -> Manoeuvre:
    """To either side in turn while moving ahead; for a vertical or pitch combination see `dive`."""
    name = f"zigzag {_called(thrusters, combination)}, {ahead} ahead"
    words = (
        f"{ahead} ahead; {combination.motion} to both sides in turn with {100 * amplitude:.0f} % of"
        f" {_left(combination)}, switched every {switch_s:g} s"
    )
    parts = [(combination, partial(zigzag_levels, switch_s=switch_s))]
    return _manoeuvre(thrusters, ("zigzag", name, words), parts, duration_s, amplitude, ahead)


def spiral(
    thrusters: Thrusters,
    combination: Combination,
    *,
    duration_s: float,
    ahead: str = "half",
    amplitude: float = 0.5,
) -> Manoeuvre:
    """Turning tighter step by step, first to one side, then to the other, under way."""
    name = f"spiral {_called(thrusters, combination)}, {ahead} ahead"
    words = (
        f"{ahead} ahead; {combination.motion} in three steps to {100 * amplitude:.0f} % of"
        f" {_left(combination)}, to starboard and then to port"
    )
    parts = [(combination, spiral_levels)]
    return _manoeuvre(thrusters, ("spiral", name, words), parts, duration_s, amplitude, ahead)


def dive(
    thrusters: Thrusters,
    combination: Combination,
    *,
    duration_s: float,
    ahead: str | None = None,
    amplitude: float = 0.5,
    switch_s: float = 12.0,
) -> Manoeuvre:
    """Down and up in turn by a heave or pitch combination, at rest or under way."""
    way = f"{ahead} ahead" if ahead else "without way"
    name = f"dive by {_called(thrusters, combination)}, {way}"
    words = (
        f"{way}; {combination.motion} down and up in turn with {100 * amplitude:.0f} % of"
        f" {_left(combination)}, switched every {switch_s:g} s"
    )
    parts = [(combination, partial(zigzag_levels, switch_s=switch_s))]
    return _manoeuvre(thrusters, ("dive", name, words), parts, duration_s, amplitude, ahead)


def multisine(
    thrusters: Thrusters,
    combinations: Sequence[Combination],
    *,
    duration_s: float,
    ahead: str | None = None,
    amplitude: float = 0.5,
    band_hz: tuple[float, float] = (0.02, 0.25),
) -> Manoeuvre:
    """Sums of sines with low crest on one combination or several at once, each with its own frequencies."""
    signal = partial(multisine_levels, band_hz=band_hz, of=len(combinations))
    which = _called(thrusters, combinations[0]) if len(combinations) == 1 else "all axes"
    way = f", {ahead} ahead" if ahead else ""
    begun = f"{ahead} ahead; " if ahead else ""
    motions = list(dict.fromkeys(combination.motion for combination in combinations))
    spoken = f"{', '.join(motions[:-1])} and {motions[-1]} together" if len(motions) > 1 else motions[0]
    name = f"multisine {which}{way}"
    words = (
        f"{begun}{spoken} excited from {band_hz[0]:g} to {band_hz[1]:g} Hz with"
        f" {100 * amplitude:.0f} % of {_all(combinations)}"
    )
    parts = [(combination, partial(signal, index=k)) for k, combination in enumerate(combinations)]
    return _manoeuvre(thrusters, ("multisine", name, words), parts, duration_s, amplitude, ahead)


def _manoeuvre(
    thrusters: Thrusters,
    called: tuple[Kind, str, str],
    parts: Sequence[tuple[Combination, Level]],
    duration_s: float,
    amplitude: float,
    ahead: str | None = None,
) -> Manoeuvre:
    """Manoeuvre of combinations at levels, added to the thrust for the net weight and thrust ahead."""
    if not 0.0 < amplitude <= 1.0:
        raise VehicleError(f"{called[1]}: expected an amplitude above 0 and up to 1, found {amplitude:g}")
    t = times(duration_s)
    trim = thrusters.trim()
    bias = trim if ahead is None else trim + thrusters.ahead(ahead)
    run_up = SETTINGS.lead_s
    if ahead is not None:
        run_up = max(min(SETTINGS.run_up_share * duration_s, SETTINGS.longest_run_up_s), run_up)
    extra = np.zeros((len(t), len(thrusters.names)))
    for combination, level in parts:
        shape = np.where(t >= run_up, level(np.maximum(t - run_up, 0.0), duration_s - run_up), 0.0)
        # Staircases go as far as they can in each sense; what should come back pushes as hard both ways.
        extra += thrusters.push(combination, amplitude * shape, bias, even=called[0] != "staircase")
    room = np.where(extra > 0.0, thrusters.upper - bias, bias - thrusters.lower)
    with np.errstate(divide="ignore", invalid="ignore"):
        fits = np.where(np.abs(extra) > 1e-9, room / np.abs(extra), np.inf).min(initial=np.inf)
    thrusts = bias + min(fits, 1.0) * extra
    kind, name, words = called
    travels = ahead is not None or any(combination.axis == "X" for combination, _ in parts)
    return Manoeuvre(
        name,
        kind,
        words,
        t,
        thrusters.commands(thrusts),
        pause_s=SETTINGS.turn_back_s if travels else SETTINGS.settle_s,
    )


def _left(combination: Combination) -> str:
    """What a combination takes a share of beside the thrust ahead."""
    return "the fins' force" if combination.needs_way else "the thrust that is left"


def _all(combinations: Sequence[Combination]) -> str:
    """What combinations take a share of."""
    kinds = {combination.needs_way for combination in combinations}
    return (
        "thrust and fins' force" if len(kinds) > 1 else "the fins' force" if True in kinds else "the thrust"
    )


def _called(thrusters: Thrusters, combination: Combination) -> str:
    """Motion, and by which group where several drive it."""
    several = sum(other.axis == combination.axis for other in thrusters.combinations) > 1
    return f"{combination.motion} ({combination.group})" if several else combination.motion
