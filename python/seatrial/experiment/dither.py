"""The trial that tells a gain which feedback hides: a dither on top of the autopilot.

Where a log's verdict calls an axis dominated by feedback (`seatrial.inspect.verdict`), a sequence of known
steps is added to the commands that push it. With the vehicle ``y = G c + d``, the autopilot ``c = e - K y``
and its sensitivity ``S = 1 / (1 + G K)``, dither and waves reach the motion by the same S: ``y = S (G e +
d)``. What tells the gain is therefore ``|G|^2 S_ee / S_dd``, whatever the autopilot does; S only sets how
much of the motion it is:

- G: the model, linear about the log's middle;
- d: the log's velocity less the model's answer to the log's commands: ``S_dd = S_yy + |G|^2 S_cc -
  2 Re(G* S_cy)``, and ``|S|^2 = S_yy / S_dd``;
- e: a maximum-length binary sequence whose levels are held for a multiple T of the waves' period: its
  spectrum ``a^2 T (sin(pi f T) / (pi f T))^2`` is zero at the waves' frequency; nine tenths of it lie below.

The information about the gain and the axis' own damping, both unknown, gives the gain's deviation (Ljung,
*System Identification* (1999), section 9.4). What is expected rests on the model before the trial and on
waves that are told from the motion that the autopilot left of them: of promised odds of 50 to 300 between the
motion by the dither and the rest, 1 to 3 were seen, and half the amplitude left the gain of stern planes 5 to
20 % low in waves of 10 s and longer (``docs/how-to/plan_a_trial.md``). The dither therefore takes all that
the actuators have left beside the autopilot, or what promises odds of `enough_odds`: the planes of a vehicle
that waves hardly move would throw it out of the water. Held by ``tests/experiment/test_dither.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial._core import State
from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, DEGREE, MOTIONS, VELOCITIES
from seatrial.base.errors import CampaignError
from seatrial.base.plain import Plain
from seatrial.inspect.verdict import SETTINGS as VERDICT_SETTINGS
from seatrial.inspect.verdict import judge_trial, pushed_by
from seatrial.trial.truth import DITHER
from seatrial.vehicle.actuators import NOMINAL_V, voltage_for

if TYPE_CHECKING:
    import polars as pl

    from seatrial._core import Vehicle
    from seatrial.inspect.verdict import Verdict
    from seatrial.trial.trial import Trial


@dataclass(frozen=True)
class DitherSettings:
    """How large and long a dither on top of an autopilot is."""

    gain_sd: float = 0.05  #: Relative standard deviation of the gain that a dither is to reach.
    least_share: float = 0.02  #: Of an actuator's range: the smallest dither.
    enough_odds: float = 1000.0  #: Odds of the motion by the dither that are enough.
    least_part: float = 0.1  #: Of what the actuators have left that a dither takes.
    holds: tuple[float, float, float] = (1.0, 2.0, 3.0)  #: Periods of the waves for which a level is held.
    shortest_s: float = 540.0  #: Shortest dither, s.
    longest_s: float = 3600.0  #: Longest dither, s.
    #: The beginning of a mission that is left out, s: a dive or a turn is not its steady part.
    settled_s: float = 60.0
    slowest_hz: float = 1.0 / 60.0  #: Slower motion is the mission, not the sea, Hz.
    difference_s: float = 0.01  #: Time of finite differences, s.
    difference_command: float = 1e-3  #: Command of finite differences, of its range.
    difference_m_s: float = 0.05  #: Speed of finite differences, m/s.
    floor: float = 1e-3  #: Part of the whole spectrum that is taken for waves at least, at every frequency.


SETTINGS = DitherSettings()
_STATES = (*VELOCITIES, "roll", "pitch")
_BEGIN, _TAPS = (1, 0, 0, 1, 1, 0, 1, 0, 1), (9, 5)  # of the shift register: a sequence of 511 levels


@dataclass(frozen=True)
class Dither(Plain):
    """A dither for one axis, a letter among ``XYZKMN``.

    `amplitude`: by actuator, in the unit of its command (`units`); negative where it starts the other way.
    `hold_s`, `begin_s`, `duration_s`: how long a level is held at least, when the sequence begins and how
    long it takes. `wave_period_s`: of the log's waves; NaN where none were seen. `deviation`: relative
    standard deviation of the gain expected afterwards, a lower bound: only its axis' own damping is unknown
    beside it, and waves are the only error; `wanted`: what was asked for. `share_before`, `share`: part of
    the axis' motion that exogenous commands drive, in the log and expected with the dither.
    """

    axis: str
    amplitude: Mapping[str, float]
    units: Mapping[str, str]
    hold_s: float
    begin_s: float
    duration_s: float
    wave_period_s: float
    deviation: float
    share_before: float
    share: float
    wanted: float

    @property
    def tells(self) -> bool:
        """Whether the dither is expected to reach what was asked for."""
        return self.deviation <= self.wanted and self.share >= VERDICT_SETTINGS.told_share

    def table(self) -> pl.DataFrame:
        """Table of ``t_s`` and ``dither.ACTUATOR``: a row where a level changes, zero at the end."""
        import polars as pl

        count = math.ceil(self.duration_s / self.hold_s)
        levels = _sequence(count)
        t = self.begin_s + self.hold_s * np.arange(count + 1)
        columns = {"t_s": t}
        columns |= {DITHER + name: np.append(a * levels, 0.0) for name, a in self.amplitude.items()}
        changes = np.concatenate([[True], np.diff(np.append(levels, 0.0)) != 0.0])
        return pl.DataFrame(columns).filter(pl.Series(changes))

    @property
    def sentence(self) -> str:
        """What to add to the autopilot's output, for how long, and what it is expected to tell."""
        parts = []
        for name, a in self.amplitude.items():
            angle = self.units[name] == "rad"
            size = abs(a) / DEGREE if angle else abs(a)
            digits = f"{size:.0f}" if size >= 100.0 else f"{size:.2g}"
            parts.append(f"{name} ±{digits} {'deg' if angle else self.units[name]}")
        how = (
            f"{MOTIONS[self.axis]} ({self.axis}): add {', '.join(parts)} to the autopilot's output from"
            f" {self.begin_s:.0f} s on for {self.duration_s:.0f} s, each level held for"
            f" {self.hold_s:.1f} s or a multiple of it"
        )
        if math.isfinite(self.wave_period_s):
            how += f", which adds nothing at the waves' {self.wave_period_s:.1f} s"
        if self.axis in "ZM":
            how += "; it moves the depth: fly it in the simulator first, and keep surface and bottom clear"
        best = f"{100.0 * self.deviation:.1f} %" if self.deviation >= 5e-4 else "less than 0.1 %"
        expected = (
            f"expected: the gain to {best} at best (standard deviation), with"
            f" {100.0 * self.share:.0f} % of the motion driven by the dither"
        )
        if self.tells:
            return f"{how}; {expected}"
        return (
            f"{how}; {expected}; the targets are {100.0 * self.wanted:g} % and"
            f" {100.0 * VERDICT_SETTINGS.told_share:.0f} %, but the actuators cannot give more: go faster,"
            " deeper or into a calmer sea"
        )

    @property
    def file_name(self) -> str:
        """Name of the file of its table."""
        return f"dither-{MOTIONS[self.axis]}.csv"

    def csv(self) -> str:
        """Text of the table's file, which says how to use it."""
        return (
            "# Add each column to the autopilot's command of its actuator, in its unit, from its t_s on,\n"
            '# before the limits; log the sum as the command. In a recipe: [sailed] dither = "FILE".\n'
            + self.table().write_csv()
        )


def dithers(
    trials: Sequence[Trial],
    vehicle: Vehicle,
    verdicts: Mapping[str, Verdict],
    *,
    deviation: float = SETTINGS.gain_sd,
    voltage_v: float = NOMINAL_V,
) -> tuple[Dither, ...]:
    """Dither for each axis that feedback dominates, sized on the trial where the waves move it least.

    `verdicts` are of `seatrial.inspect.verdict.judge`; `deviation` is the wanted relative standard deviation
    of the gain, a CampaignError where it is not between 0 and 1.
    """
    if not 0.0 < deviation < 1.0:
        raise CampaignError(f"deviation: expected a share between 0 and 1, found {deviation:g}")
    dominated = {axis: verdict for axis, verdict in verdicts.items() if verdict.dominated}
    sized = []
    for axis, verdict in dominated.items():
        # Fins and a propeller that heel the vehicle a little are told by the axes that they serve.
        others = [set(other.commands) for key, other in dominated.items() if key != axis]
        if any(own < set(verdict.commands) for own in others):
            continue
        seen = [
            (trial, own) for trial in trials if (own := judge_trial(trial, vehicle).get(axis)) is not None
        ]
        channel = VELOCITIES[AXES.index(axis)]
        sizes = [
            float(np.std(y)) if (y := trial.filled(channel)) is not None else math.inf for trial, _ in seen
        ]
        trial, own = seen[int(np.argmin(sizes))]
        sized.append(_sized(trial, vehicle, own, deviation, voltage_v))
    return tuple(sized)


def _sized(trial: Trial, vehicle: Vehicle, verdict: Verdict, wanted: float, voltage_v: float) -> Dither:
    """A dither as large as actuators allow and odds need, as long as the wanted deviation takes."""
    from scipy.signal import csd, welch

    axis = verdict.axis
    facts = vehicle.actuator_info()
    pushes = pushed_by(vehicle)[axis]
    largest = {}
    for name in verdict.commands:
        ahead, astern = facts[name]["maximum_ahead"], facts[name]["maximum_astern"]
        command = trial.commands[name] - facts[name]["neutral"]
        middle, swing = (
            float(np.median(command)),
            float(np.std(command[round(SETTINGS.settled_s / trial.dt) :])),
        )
        # The waves may take the sum of both to the limit now and then: about one sample in six.
        left = min(ahead - middle, astern + middle) - swing
        largest[name] = max(left, SETTINGS.least_share * 0.5 * (ahead + astern)) * math.copysign(
            1.0, pushes[name]
        )
    y = trial.filled(VELOCITIES[AXES.index(axis)])
    assert y is not None
    # The commands of the log as one signal, in shares of the largest dither.
    scale = sum(abs(pushes[name] * a) for name, a in largest.items())
    drive = sum((pushes[name] * trial.commands[name] for name in largest), np.zeros(len(trial))) / scale
    settled = round(SETTINGS.settled_s / trial.dt) if len(y) > 4 * SETTINGS.settled_s / trial.dt else 0
    pair = {
        "fs": 1.0 / trial.dt,
        "nperseg": min(len(y) - settled, round(100.0 / trial.dt)),
        "detrend": "linear",
    }
    y, drive = y[settled:], drive[settled:]
    f, whole = welch(y, **pair)
    # Without waves the motion itself says how fast the axis is.
    moving = f > SETTINGS.slowest_hz
    own = float(whole[moving].sum() / (f[moving] @ whole[moving]))
    period = verdict.wave_period_s if math.isfinite(verdict.wave_period_s) else own
    kept = moving & (f < 2.0 / period)
    gain, slower = _response(trial, vehicle, axis, largest, f=f[kept], voltage_v=voltage_v)
    f, whole, driving = f[kept], whole[kept], welch(drive, **pair)[1][kept]
    together = csd(drive, y, **pair)[1][kept]
    # Spectrum of d = y - G c; an unstable answer has one too. It is no smaller than what rounding leaves.
    waves = whole + np.abs(gain) ** 2 * driving - 2.0 * (gain.conj() * together).real
    waves = np.maximum(waves, SETTINGS.floor * whole)
    step = f[1] - f[0]

    def of(hold: float, duration: float, part: float = 1.0) -> Dither:
        power = 2.0 * part**2 * hold * np.sinc(f * hold) ** 2  # one-sided
        weight = 2.0 * duration * step * power / waves
        sides = [gain, slower]
        matrix = np.array([[float((weight * (a * b.conj()).real).sum()) for b in sides] for a in sides])
        spread = math.sqrt(float(np.linalg.pinv(matrix)[0, 0])) if matrix[0, 0] > 0.0 else math.inf
        added = np.abs(gain) ** 2 * power * whole / waves * step
        share = float(added.sum() / (added.sum() + np.var(y)))
        return Dither(
            axis=axis,
            amplitude={name: part * a for name, a in largest.items()},
            units={name: str(facts[name]["unit"]) for name in largest},
            hold_s=round(hold, 1),
            begin_s=SETTINGS.settled_s,
            duration_s=duration,
            wave_period_s=verdict.wave_period_s,
            deviation=spread,
            share_before=max(verdict.told, 0.0),
            share=share,
            wanted=wanted,
        )

    best = max((of(k * period, SETTINGS.shortest_s) for k in SETTINGS.holds), key=lambda d: d.share)
    odds = best.share / max(1.0 - best.share, 1e-12)
    part = min(max(math.sqrt(SETTINGS.enough_odds / max(odds, 1e-12)), SETTINGS.least_part), 1.0)
    best = of(best.hold_s, SETTINGS.shortest_s, part)
    # The deviation falls with the root of the time.
    needed = SETTINGS.shortest_s * (best.deviation / wanted) ** 2
    duration = float(min(max(60.0 * math.ceil(needed / 60.0), SETTINGS.shortest_s), SETTINGS.longest_s))
    return of(best.hold_s, duration, part)


def _response(
    trial: Trial, vehicle: Vehicle, axis: str, amplitude: Mapping[str, float], *, f: Array, voltage_v: float
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Answer (n,) of an axis' velocity to `amplitude` at f (n,), Hz, and what its own damping does to it.

    The equation of motion with its actuators, linear about the log's middle: differences of short runs. The
    lag of motors is left out. The second is the answer's derivative by the logarithm of the damping.
    """
    t = np.array([0.0, SETTINGS.difference_s])
    supply = voltage_for(vehicle, t, voltage_v)
    middle = {c: 0.0 if (y := trial.filled(c)) is None else float(np.median(y)) for c in (*_STATES, "z")}
    held = {name: float(np.median(y)) for name, y in trial.commands.items()}

    def acceleration(state: Mapping[str, float], share: float) -> Array:
        commands = {name: value + share * amplitude.get(name, 0.0) for name, value in held.items()}
        start = State(
            position=[0.0, 0.0, middle["z"]],
            attitude=[state["roll"], state["pitch"], 0.0],
            nu=[state[c] for c in VELOCITIES],
            actuators=commands,
        )
        steady = {name: np.full(2, value) for name, value in commands.items()}
        run = vehicle.simulate(t, steady, start, voltage_v=supply, max_step_s=SETTINGS.difference_s)
        return np.asarray(run.nu[1] - run.nu[0]) / SETTINGS.difference_s

    # Central differences of the accelerations by every state, then by the dither.
    matrix = np.zeros((len(_STATES), len(_STATES)))
    for column, name in enumerate(_STATES):
        sides = [
            acceleration(middle | {name: middle[name] + s * SETTINGS.difference_command}, 0.0)
            for s in (1.0, -1.0)
        ]
        matrix[:6, column] = (sides[0] - sides[1]) / (2.0 * SETTINGS.difference_command)
    matrix[6, 3] = matrix[7, 4] = 1.0  # roll and pitch turn with their rates
    push = np.zeros(len(_STATES))
    push[:6] = (
        acceleration(middle, SETTINGS.difference_m_s) - acceleration(middle, -SETTINGS.difference_m_s)
    ) / (2.0 * SETTINGS.difference_m_s)
    # Transfer function at every frequency, (j 2 pi f - A)^-1 b, in the row of the axis.
    index = AXES.index(axis)
    inverse = np.linalg.inv(2j * np.pi * f[:, None, None] * np.eye(len(_STATES)) - matrix)
    answer = inverse[:, index] @ push
    return answer, answer * inverse[:, index, index] * matrix[index, index]


def _sequence(count: int) -> Array:
    """Levels (count,) of 1 and -1: a maximum-length sequence, which begins anew after 511."""
    register, levels = list(_BEGIN), np.empty(count)
    for k in range(count):
        levels[k] = 1.0 if register[-1] else -1.0
        register = [register[_TAPS[0] - 1] ^ register[_TAPS[1] - 1], *register[:-1]]
    return levels
