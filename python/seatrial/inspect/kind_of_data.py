"""What kind of data a trial is, in a few sentences, the worst first, and what it excites.

Contact, saturated commands, closed loops, waves, axes that hardly move, then what was done and what to hold
out. The energy of each velocity is its spectrum (Welch 1967) summed over bands; its noise is the white part
that third differences leave, ``var(d3) = 20 sigma^2`` (Garnier and Wang 2008, section 1.6). A command is
saturated where it stays at its limit. A vehicle on a tether's end, the bottom or a wall is driven and does
not move. Held by ``tests/inspect/test_kind_of_data.py`` and ``tests/inspect/test_excitation.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array, runs
from seatrial.base.channels import AXES, CHANNELS, VELOCITIES, readable
from seatrial.base.finding import Finding, Severity
from seatrial.base.report import words_of
from seatrial.inspect.feedback import Feedback, feedback
from seatrial.inspect.manoeuvres import Drive, Manoeuvre, counted, drives, manoeuvres
from seatrial.inspect.trial_windows import TrialWindows, windows
from seatrial.inspect.verdict import Verdict, judge_trial
from seatrial.inspect.waves import Waves, commanded, waves
from seatrial.inspect.wiring import Wiring, wiring

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.trial.trial import Trial


@dataclass(frozen=True)
class KindOfData:
    """What a trial holds and what spoils it.

    Attributes
    ----------
    contacts, saturated, beyond, loops, waves, excitation
        What may spoil an identification: parts in which the vehicle was held, commands at their limits,
        commands beyond what an actuator can do, commands that follow measurements, waves, and how much each
        axis moves.
    verdicts
        Whether it tells how an axis answers its commands, the worst first; empty without a vehicle.
    manoeuvres, windows
        What was done, and the proposed hold-out.
    """

    contacts: tuple[Contact, ...]
    saturated: tuple[Saturation, ...]
    beyond: tuple[Excess, ...]
    loops: tuple[Feedback, ...]
    verdicts: tuple[Verdict, ...]
    waves: Waves | None
    excitation: tuple[Excitation, ...]
    manoeuvres: tuple[Manoeuvre, ...]
    windows: TrialWindows
    wiring: Wiring | None = None

    @property
    def impossible(self) -> tuple[Finding, ...]:
        """How commands contradict the vehicle: their wiring, and values that no actuator follows."""
        wired = () if self.wiring is None else (self.wiring.finding(),)
        return wired + tuple(
            Finding("command beyond limit", Severity.PROBLEM, values=asdict(excess)) for excess in self.beyond
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """What spoils the data, the worst first, with what to do about it."""
        touching = [
            f"{contact.sentence}. Leave this part out: split the trial or hold it out"
            for contact in self.contacts
        ]
        problems = [*map(words_of, self.impossible), *touching]
        dominated = [verdict.sentence for verdict in self.verdicts if verdict.dominated]
        return tuple(
            problems + dominated + _loops(self.loops) + _waves(self.waves) + _saturated(self.saturated)
        )

    @property
    def weak(self) -> tuple[Excitation, ...]:
        """Axes that hardly move more than their noise."""
        return tuple(axis for axis in self.excitation if axis.weak)

    @property
    def still(self) -> bool:
        """Whether no axis moves clearly."""
        return bool(self.excitation) and len(self.weak) == len(self.excitation)

    @property
    def done(self) -> str:
        """What was done and what moved, in a sentence."""
        moved = ", ".join(axis.channel for axis in self.excitation if not axis.weak)
        return f"{counted(self.manoeuvres) or 'no manoeuvre found'}; {moved or 'nothing'} moved clearly"

    @property
    def sentences(self) -> tuple[str, ...]:
        """`warnings`, then what was done and the proposed hold-out."""
        return (*self.warnings, self.done, self.windows.sentence)

    @property
    def details(self) -> tuple[str, ...]:
        """What its loops tell, how much each axis moves, and every manoeuvre."""
        return (
            *(verdict.sentence for verdict in self.verdicts if not verdict.dominated),
            *(axis.sentence for axis in self.excitation),
            *(manoeuvre.sentence for manoeuvre in self.manoeuvres),
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "contacts": [asdict(part) for part in self.contacts],
            "saturated": [asdict(part) for part in self.saturated],
            "beyond": [asdict(part) for part in self.beyond],
            "wiring": None if self.wiring is None else self.wiring.to_dict(),
            "closed_loops": [asdict(part) for part in self.loops],
            "feedback": [asdict(part) | {"sentence": part.sentence} for part in self.verdicts],
            "waves": None if self.waves is None else asdict(self.waves),
            "excitation": [asdict(part) for part in self.excitation],
            "manoeuvres": [asdict(part) for part in self.manoeuvres],
            "windows": asdict(self.windows),
            "sentences": list(self.sentences),
        }


def kind_of_data(trial: Trial, vehicle: Vehicle | None = None) -> KindOfData:
    """What a trial holds and what spoils it; the vehicle gives the wrench and the limits of commands."""
    driving = drives(trial, vehicle)
    sequence = manoeuvres(trial, vehicle)
    every = feedback(trial)
    loops = tuple(loop for loop in every if loop.closed)
    swell = waves(trial)
    if swell is not None and not loops and commanded(trial, swell):
        swell = None  # a row of preset steps has harmonics
    return KindOfData(
        contacts=tuple(contacts(trial, driving)),
        saturated=tuple(saturation(trial, vehicle)),
        beyond=tuple(excesses(trial, vehicle)),
        loops=loops,
        verdicts=() if vehicle is None else tuple(judge_trial(trial, vehicle).values()),
        waves=swell,
        excitation=tuple(excitation(trial)),
        manoeuvres=tuple(sequence),
        windows=windows(trial, sequence),
        wiring=None if vehicle is None else wiring(trial, vehicle, loops=every),
    )


def _loops(loops: tuple[Feedback, ...]) -> list[str]:
    if not loops:
        return []
    follows = "; ".join(
        f"{loop.command} follows {loop.channel} ({100.0 * loop.explained:.0f} % of its changes)"
        for loop in sorted(loops, key=lambda loop: -loop.explained)
    )
    return [
        f"recorded in closed loop: {follows}. A fit on such data may bias gains and damping, and its score"
        " also rates the controller: add a trial with preset steps of these commands"
    ]


def _waves(swell: Waves | None) -> list[str]:
    if swell is None:
        return []
    sizes = ", ".join(f"{c} {readable(c)[0] * a:.2g} {readable(c)[1]}" for c, a in swell.amplitude.items())
    if not swell.line:
        return [
            f"motion about a period of {swell.period_s:.1f} s (amplitude {sizes}) that a crude regression on"
            " state and commands leaves unexplained: perhaps waves, which a model takes for its own error,"
            " perhaps motion that the vehicle's model explains. In calm water ignore it"
        ]
    return [
        f"an oscillation with a period of {swell.period_s:.1f} s, as of waves (amplitude {sizes}), which"
        " no command explains; the model takes it for its own error"
    ]


def _saturated(saturated: tuple[Saturation, ...]) -> list[str]:
    if not saturated:
        return []
    parts = ", ".join(
        f"{command.command} at {command.limit:g} in {100.0 * command.share:.0f} %" for command in saturated
    )
    return [
        f"commands at their limits, where the loop is open and the motor tells no more: {parts} of the time"
    ]


BANDS_HZ = ((0.0, 0.05), (0.05, 0.2), (0.2, 1.0), (1.0, np.inf))
"""Drift and speed, manoeuvres, quick steps and waves, vibration and noise."""


@dataclass(frozen=True)
class DataSettings:
    """From where on an axis is excited, a command saturated, and a vehicle held."""

    weak_over_noise: float = 5.0  #: Root mean square over noise below which an axis is hardly excited.
    spectrum_s: float = 60.0  #: Length of the windows of a spectrum, s: a period of 20 s thrice.
    thinned_s: float = 0.12  #: Between the samples that show the noise, s: no slow sensor's straight lines.
    saturated_share: float = 0.02  #: Of the samples at a limit from which a command is saturated.
    at_limit_share: float = 0.005  #: Of a command's range within which it is at its limit.
    excess_share: float = 0.1  #: Of the range beyond a limit that no rounding explains.
    seldom_share: float = 0.01  #: Of the samples that may be beyond: spikes of a log.
    #: Values of a command: one with fewer has preset steps, which may rest at its largest.
    fewest_levels: int = 50
    contact_s: float = 5.0  #: Length of the windows in which a held vehicle is looked for, s.
    pushed_share: float = 0.4  #: Of the largest force from which an axis is driven hard.
    fewest_windows: int = 6  #: Windows that are pushed, of which most move.
    still_share: float = 0.12  #: Of the speed that such a force gives, below which the vehicle does not move.


SETTINGS = DataSettings()


@dataclass(frozen=True)
class Excitation:
    """How one velocity moves."""

    #: A letter of "XYZKMN" and its velocity, "u" ... "r".
    axis: str
    channel: str
    rms: float  #: About the mean, SI.
    noise: float  #: Standard deviation of the white part of the samples, SI.
    shares: tuple[float, ...]  #: Part of the variance in each of `BANDS_HZ`.

    @property
    def over_noise(self) -> float:
        """Root mean square over the noise."""
        return self.rms / self.noise if self.noise > 0.0 else np.inf

    @property
    def weak(self) -> bool:
        """Whether the axis hardly moves more than its noise."""
        return self.over_noise < SETTINGS.weak_over_noise

    @property
    def sentence(self) -> str:
        """Size, noise and main band in words."""
        factor, unit = readable(self.channel)
        low, high = BANDS_HZ[int(np.argmax(self.shares))]
        band = f"above {low:g} Hz" if np.isinf(high) else f"from {low:g} to {high:g} Hz"
        noise = f"{self.over_noise:.0f} times its noise" if self.over_noise < 200.0 else "far above its noise"
        share = f"{100.0 * max(self.shares):.0f} % of it {band}"
        return f"{self.channel}: rms {factor * self.rms:.2g} {unit}, {noise}, {share}"


@dataclass(frozen=True)
class Saturation:
    """A command that stays at its limit: in `share` of the samples, at `limit` in the command's unit."""

    command: str
    limit: float
    share: float


@dataclass(frozen=True)
class Excess:
    """A command beyond what its actuator can do: in `share` of the samples, up to `reached`."""

    command: str
    reached: float
    limit: float
    share: float


@dataclass(frozen=True)
class Contact:
    """A part of a recording in which an axis is driven and does not move, s."""

    axis: str
    start_s: float
    end_s: float
    sentence: str


def excitation(trial: Trial) -> list[Excitation]:
    """Excitation of each recorded velocity, in the order of the axes.

    >>> import seatrial as st
    >>> t = np.arange(0.0, 100.0, 0.1)
    >>> trial = st.Trial.read({"t_s": t, "u_m_s": np.sin(2.0 * np.pi * 0.1 * t)})
    >>> round(excitation(trial)[0].shares[1], 2)
    1.0
    """
    from scipy.signal import welch

    axes = []
    for axis, channel in zip(AXES, VELOCITIES, strict=True):
        y = trial.filled(channel)
        if y is None or len(y) < 16:
            continue
        f, power = welch(y, 1.0 / trial.dt, nperseg=min(len(y), round(SETTINGS.spectrum_s / trial.dt)))
        total = float(power.sum()) or 1.0
        shares = tuple(float(power[(f >= low) & (f < high)].sum()) / total for low, high in BANDS_HZ)
        # Between the samples of a slow sensor lie straight lines, which show no noise: thin them out.
        third = np.diff(y[:: max(1, round(SETTINGS.thinned_s / trial.dt))], 3)
        noise = 1.4826 * float(np.median(np.abs(third - np.median(third)))) / np.sqrt(20.0)
        axes.append(Excitation(axis, channel, float(y.std()), noise, shares))
    return axes


def saturation(trial: Trial, vehicle: Vehicle | None = None) -> list[Saturation]:
    """Commands that stay at their motor's limit in more than 2 % of the samples; none without a vehicle. A
    command of a few preset steps rests where it was meant to.
    """
    facts = {} if vehicle is None else vehicle.actuator_info()
    at_limit = []
    for name, y in trial.commands.items():
        low, high = float(y.min()), float(y.max())
        if name not in facts or len(np.unique(y)) < SETTINGS.fewest_levels:
            continue
        actuator = facts[name]
        both = (
            actuator["neutral"] - actuator["maximum_astern"],
            actuator["neutral"] + actuator["maximum_ahead"],
        )
        for limit in (limit for limit in both if np.isfinite(limit) and limit != actuator["neutral"]):
            margin = SETTINGS.at_limit_share * max(high - low, abs(limit) * 1e-6)
            beyond = y >= limit - margin if limit > 0.5 * (low + high) else y <= limit + margin
            if (share := float(beyond.mean())) > SETTINGS.saturated_share:
                at_limit.append(Saturation(name, limit, share))
    return at_limit


def excesses(trial: Trial, vehicle: Vehicle | None = None) -> list[Excess]:
    """Commands beyond their actuator's limit by a tenth of its range in more than 1 % of the samples: another
    unit than the vehicle file's, or another actuator.
    """
    facts = {} if vehicle is None else vehicle.actuator_info()
    beyond = []
    for name, y in trial.commands.items():
        if name not in facts:
            continue
        actuator = facts[name]
        low, high = (
            actuator["neutral"] - actuator["maximum_astern"],
            actuator["neutral"] + actuator["maximum_ahead"],
        )
        for limit, over in ((high, y - high), (low, low - y)):
            share = (
                float((over > SETTINGS.excess_share * (high - low)).mean())
                if np.isfinite(high - low)
                else 0.0
            )
            if share > SETTINGS.seldom_share:
                beyond.append(Excess(name, float(y[int(over.argmax())]), float(limit), share))
    return beyond


def contacts(trial: Trial, driving: Sequence[Drive]) -> list[Contact]:
    """Parts of a trial in which surge, sway or heave is driven hard and the vehicle does not move.

    What a force usually does is learned from the trial itself: in windows of 5 s the mean force about the
    one without motion, and the mean speed along it. A window counts that is driven with more than 40 % of the
    largest force and reaches less than 12 % of the median speed of such windows.
    """
    spells = []
    for drive in driving:
        if drive.axis not in ("X", "Y", "Z"):
            continue
        channel = "uvw"["XYZ".index(drive.axis)]
        moved = _along(trial, channel)
        size = max(2, round(SETTINGS.contact_s / trial.dt))
        if moved is None or len(moved) < 6 * size:
            continue
        count = len(moved) // size
        speed = moved[: count * size].reshape(count, size).mean(axis=1)
        force = drive.y[: count * size].reshape(count, size).mean(axis=1)
        force = force - (_neutral(force, speed) if drive.axis == "Z" else 0.0)
        pushed = np.abs(force) > SETTINGS.pushed_share * np.abs(force).max()
        along = speed * np.sign(force)
        usual = float(np.median(along[pushed])) if pushed.sum() >= SETTINGS.fewest_windows else 0.0
        # Under depth control or at anchor a force moves nothing anywhere: no window stands out.
        elsewhere = float(np.std(speed[~pushed])) if not pushed.all() else 0.0
        if usual <= 2.0 * elsewhere or usual <= 0.0:
            continue
        still = pushed & (np.abs(along) < SETTINGS.still_share * usual)
        for start, stop in runs(still, 2):
            t, until = float(trial.t[start * size]), float(trial.t[min(stop * size, len(trial) - 1)])
            spells.append(Contact(drive.axis, t, until, _words(trial, drive, force, start, stop, size)))
    return spells


def _neutral(force: Array, speed: Array) -> float:
    """Force that holds the depth: zero, or the usual one of slow windows, whichever explains more."""
    slow = np.abs(speed) <= np.quantile(np.abs(speed), 0.25)
    candidates = (0.0, float(np.median(force[slow])))
    return max(candidates, key=lambda neutral: float(speed @ np.sign(force - neutral)))


def _along(trial: Trial, channel: str) -> Array | None:
    """Body velocity; of heave the depth's rate where the depth is known: the bottom stops that."""
    depth = trial.filled("z") if channel == "w" else None
    return np.gradient(depth, trial.dt) if depth is not None else trial.filled(channel)


def _words(trial: Trial, drive: Drive, force: Array, start: int, stop: int, size: int) -> str:
    t, until = trial.t[start * size], trial.t[min(stop * size, len(trial) - 1)]
    mean = float(force[start:stop].mean())
    way = {"X": ("ahead", "astern"), "Y": ("to starboard", "to port"), "Z": ("down", "up")}[drive.axis]
    words = f"from {t:.0f} to {until:.0f} s pushed {way[mean < 0.0]} by {abs(mean):.2g} {drive.unit}"
    if drive.axis == "Z" and "z" in trial.channels:
        depth = float(np.median(trial.channel("z")[start * size : stop * size]))
        where = "the bottom" if mean > 0.0 else "the surface"
        return f"{words} at a constant depth of {depth:.1f} m: {where}, or a taut tether"
    moved = CHANNELS["XYZ".index(drive.axis)]
    return f"{words} without motion in {moved}: a taut tether or a wall"
