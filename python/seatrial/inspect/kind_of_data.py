"""What kind of data a trial is: what spoils it, what it excites, and which part of it to hold out.

Contact, saturated commands, closed loops, waves, axes that hardly move, then what was done and what to hold
out. The energy of each velocity is its spectrum (Welch 1967) summed over bands; its noise is the white part
that third differences leave, ``var(d3) = 20 sigma^2`` (Garnier and Wang 2008, section 1.6). A command is
saturated where it stays at its limit. A vehicle on a tether's end, the bottom or a wall is driven and does
not move. Held by ``tests/inspect/test_kind_of_data.py`` and ``tests/inspect/test_excitation.py``.

The held-out part is contiguous (samples near each other in time are alike: Bergmeir and Benitez 2012), a
fifth to a third of the trial, lies where the log has samples, has every kind of manoeuvre that occurs more
than once, leaves each of them in the fit, cuts few of them and is no easier than the rest. Both parts have
commands that change. Held by ``tests/inspect/test_trial_windows.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array, runs
from seatrial.base.channels import AXES, VELOCITIES
from seatrial.base.finding import Finding, Severity
from seatrial.base.plain import Plain, plain
from seatrial.base.report import wording
from seatrial.inspect.feedback import Feedback, feedback
from seatrial.inspect.manoeuvres import Drive, Manoeuvre, drives, manoeuvres
from seatrial.inspect.verdict import Verdict, judge_trial
from seatrial.inspect.waves import Waves, commanded, waves
from seatrial.inspect.wiring import Wiring, wiring

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.trial.trial import Trial
from collections import Counter
from collections.abc import Iterable
from typing import TYPE_CHECKING, Literal

from seatrial.base.arrays import Mask
from seatrial.base.channels import CHANNELS

if TYPE_CHECKING:
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
        return tuple(wording("trial_findings").warnings(self))

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
        return str(wording("trial_findings").done(self))

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
            "contacts": plain(self.contacts),
            "saturated": plain(self.saturated),
            "beyond": plain(self.beyond),
            "wiring": plain(self.wiring),
            "closed_loops": plain(self.loops),
            "feedback": [asdict(part) | {"sentence": part.sentence} for part in self.verdicts],
            "waves": plain(self.waves),
            "excitation": plain(self.excitation),
            "manoeuvres": plain(self.manoeuvres),
            "windows": self.windows.to_dict(),
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
        return str(wording("trial_findings").excitation(self))


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
class Contact(Plain, without="values", also="sentence"):
    """A part of a recording in which an axis is driven and does not move, s."""

    axis: str
    start_s: float
    end_s: float
    values: Mapping[str, Any]  #: Mean force or moment, its unit, and the depth where it is known.

    @property
    def sentence(self) -> str:
        """Where it was pushed and did not move, and what may have held it."""
        return str(wording("trial_findings").contact(self))


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
        both, neutral = _limits(facts[name]), facts[name]["neutral"]
        for limit in (limit for limit in both if np.isfinite(limit) and limit != neutral):
            margin = SETTINGS.at_limit_share * max(high - low, abs(limit) * 1e-6)
            beyond = y >= limit - margin if limit > 0.5 * (low + high) else y <= limit + margin
            if (share := float(beyond.mean())) > SETTINGS.saturated_share:
                at_limit.append(Saturation(name, limit, share))
    return at_limit


def _limits(actuator: Mapping[str, Any]) -> tuple[float, float]:
    """Lowest and highest command of an actuator, in its unit."""
    neutral = actuator["neutral"]
    return neutral - actuator["maximum_astern"], neutral + actuator["maximum_ahead"]


def excesses(trial: Trial, vehicle: Vehicle | None = None) -> list[Excess]:
    """Commands beyond their actuator's limit by a tenth of its range in more than 1 % of the samples: another
    unit than the vehicle file's, or another actuator.
    """
    facts = {} if vehicle is None else vehicle.actuator_info()
    beyond = []
    for name, y in trial.commands.items():
        if name not in facts:
            continue
        low, high = _limits(facts[name])
        for limit, over in ((high, y - high), (low, low - y)):
            share = float((over > SETTINGS.excess_share * (high - low)).mean())
            if np.isfinite(high - low) and share > SETTINGS.seldom_share:
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
            depth = trial.channel("z")[start * size : stop * size] if "z" in trial.channels else None
            values = {
                "mean": float(force[start:stop].mean()),
                "unit": drive.unit,
                "depth_m": None if depth is None or drive.axis != "Z" else float(np.median(depth)),
            }
            spells.append(Contact(drive.axis, t, until, values))
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


@dataclass(frozen=True)
class HoldOutSettings:
    """Which part of a trial is proposed to be held out."""

    #: Of the use that are tried: a hold-out of about a quarter.
    shares: tuple[float, ...] = (0.2, 0.225, 0.25, 0.275, 0.3, 0.325, 0.35)
    usual_share: float = 0.25  #: Of the use, where nothing speaks for another share.
    starts: int = 61  #: Places that are tried along the use: finer than a minute of an hour.
    shortest_s: float = 60.0  #: Of the use, s: a shorter trial is too short to be divided.
    idle_s: float = 10.0  #: Before and after the commands that stay in use, s: the vehicle coasts.
    still_share: float = 0.15  #: Of the largest velocity, below which the vehicle is still.
    round_s: float = 1.0  #: Proposed times are multiples of it, s.
    lasts_s: float = 20.0  #: A change of a command goes on to tell something so long, s.
    driven_share: float = 0.25  #: Of the trial's share of driven time, in either part.
    unmeasured_cost: float = 20.0  #: What a part without any measurement costs, in units of the merit.
    #: Squared velocity of a part over that of the rest, on its busiest axis: 0.22 of its speed. Below, every
    #: model predicts the part well, because hardly anything happens in it.
    least_activity: float = 0.05


HOLD_OUT_SETTINGS = HoldOutSettings()

_TOLD = ("step", "coast-down", "turn", "zigzag", "dive", "rise", "decay", "straight run")


@dataclass(frozen=True)
class TrialWindows(Plain, without="why driven", also="sentence"):
    """Proposed parts of a trial, s in its own time."""

    use: tuple[float, float]  #: From the first to the last motion.
    #: (start, stop) for the key ``hold_out_s`` of a campaign; None where there is none, see ``why``.
    hold_out: tuple[float, float] | None
    #: Kinds of manoeuvres that both parts have, of those that occur more than once: (both, all).
    kept: tuple[int, int] = (0, 0)
    effort: float = 1.0  #: Activity of the held-out part over that of the fitted part, 1 is alike.
    why: Literal["", "short", "moves once", "driven once"] = ""  #: Why there is no hold-out.
    driven: tuple[float, float] = (0.0, 0.0)  #: First and last change of the commands.

    @property
    def sentence(self) -> str:
        """What to hold out and why, in words."""
        return str(wording("trial_findings").windows(self))


def windows(trial: Trial, sequence: Sequence[Manoeuvre]) -> TrialWindows:
    """Proposed use and hold-out of a trial with these manoeuvres."""
    activity = _activity(trial)
    use = _moving_part(trial)
    length = use[1] - use[0]
    if length < HOLD_OUT_SETTINGS.shortest_s:
        return TrialWindows(use, None, why="short")
    countable, repeated = _countable(sequence)
    driven, blind = _driven(trial), _blind(trial)
    # Every length and place is tried; a hold-out must be driven and move, and the best merit wins.
    best, could_be_driven = None, False
    for share in HOLD_OUT_SETTINGS.shares:
        for start in np.linspace(use[0], use[1] - share * length, HOLD_OUT_SETTINGS.starts):
            candidate = (
                float(np.round(start / HOLD_OUT_SETTINGS.round_s)),
                float(np.round((start + share * length) / HOLD_OUT_SETTINGS.round_s)),
            )
            if not _both_driven(trial.t, driven, use, candidate):
                continue
            could_be_driven = True
            if not _moves(trial.t, activity, use, candidate):
                continue
            merit, both, effort = _merit(trial, activity, use, candidate, countable, repeated)
            merit -= 2.0 * abs(share - HOLD_OUT_SETTINGS.usual_share) - 0.2 * (start - use[0]) / length
            held = (trial.t >= candidate[0]) & (trial.t < candidate[1])
            merit -= HOLD_OUT_SETTINGS.unmeasured_cost * float(blind[held].mean())
            if best is None or merit > best[0]:
                best = (merit, candidate, both, effort)
    if best is None:
        at = trial.t[driven]
        why: Literal["moves once", "driven once"] = "moves once" if could_be_driven else "driven once"
        return TrialWindows(use, None, why=why, driven=(at[0], at[-1]) if len(at) else (0.0, 0.0))
    _, candidate, both, effort = best
    candidate = (candidate[0], float(np.ceil(trial.t[-1]))) if use[1] - candidate[1] < 2.0 else candidate
    return TrialWindows(use, candidate, (both, len(repeated)), effort)


def moved(
    trial: Trial, sequence: Sequence[Manoeuvre], proposed: TrialWindows, part: tuple[float, float]
) -> TrialWindows:
    """A hold-out that begins or ends elsewhere than proposed, judged as it is."""
    countable, repeated = _countable(sequence)
    _, both, effort = _merit(trial, _activity(trial), proposed.use, part, countable, repeated)
    return TrialWindows(proposed.use, part, (both, len(repeated)), effort)


def _countable(sequence: Sequence[Manoeuvre]) -> tuple[list[Manoeuvre], list[tuple[str, str]]]:
    """Manoeuvres that both parts should have, and the kinds of them that occur more than once."""
    countable = [manoeuvre for manoeuvre in sequence if manoeuvre.kind in _TOLD]
    counts: Counter[tuple[str, str]] = Counter((manoeuvre.kind, manoeuvre.by) for manoeuvre in countable)
    return countable, sorted(key for key, count in counts.items() if count > 1)


def _merit(
    trial: Trial,
    activity: Array,
    use: tuple[float, float],
    part: tuple[float, float],
    countable: Iterable[Manoeuvre],
    repeated: Sequence[tuple[str, str]],
) -> tuple[float, int, float]:
    """How good a hold-out is, how many repeated kinds both parts have, its activity over the rest's."""
    inside: set[tuple[str, str]] = set()
    outside: set[tuple[str, str]] = set()
    cut = count = 0
    for manoeuvre in countable:
        count += 1
        key = (manoeuvre.kind, manoeuvre.by)
        within = part[0] <= manoeuvre.start_s and manoeuvre.end_s <= part[1] + 1.0
        apart = manoeuvre.end_s <= part[0] or manoeuvre.start_s >= part[1]
        inside |= {key} if within else set()
        outside |= {key} if apart else set()
        cut += not within and not apart
    both = sum(key in inside and key in outside for key in repeated)
    lonely = len(inside - outside)
    t = trial.t
    # Activity per axis: a part that is easier or much harder than the rest judges badly.
    held = (t >= part[0]) & (t < part[1])
    rest = (t >= use[0]) & (t < use[1]) & ~held
    per_axis = activity[held].mean(axis=0) / np.maximum(activity[rest].mean(axis=0), 1e-12)
    effort = float(np.median(per_axis)) if per_axis.size else 1.0
    easy = float(np.clip(1.0 - per_axis, 0.0, 1.0).mean()) if per_axis.size else 0.0
    hard = float(np.clip(per_axis - 1.5, 0.0, 2.0).mean()) if per_axis.size else 0.0
    merit = both / max(len(repeated), 1) - 0.5 * cut / max(count, 1) - easy - 0.3 * hard
    return merit - lonely / max(len(repeated), 1), both, effort


def moves(trial: Trial, proposed: TrialWindows, part: tuple[float, float]) -> bool:
    """Whether a hold-out moves, by the axis that moves most in comparison with the rest of the trial."""
    return _moves(trial.t, _activity(trial), proposed.use, part)


def _moves(t: Array, activity: Array, use: tuple[float, float], part: tuple[float, float]) -> bool:
    inside = (t >= part[0]) & (t < part[1])
    rest = (t >= use[0]) & (t < use[1]) & ~inside
    if not activity.shape[1] or not inside.any() or not rest.any():
        return False
    ratio = activity[inside].mean(axis=0) / np.maximum(activity[rest].mean(axis=0), 1e-12)
    return bool(ratio.max() >= HOLD_OUT_SETTINGS.least_activity)


def _blind(trial: Trial) -> Mask:
    """Samples (n,) of which no channel was measured, as in a gap of the log."""
    return ~np.asarray(trial.valid[:, [CHANNELS.index(name) for name in trial.channels]].any(axis=1))


def _driven(trial: Trial) -> Mask:
    """Samples (n,) at which some command or the recorded wrench changes, or changed a moment ago."""
    inputs = [*trial.commands.values(), *([] if trial.tau is None else trial.tau.T)]
    changes = np.zeros(len(trial), bool)
    for y in inputs:
        if np.ptp(y) > 0.0:
            changes |= np.abs(np.diff(y, prepend=y[0])) > 0.02 * np.ptp(y)
    since = np.arange(len(trial)) - np.maximum.accumulate(
        np.where(changes, np.arange(len(trial)), -len(trial))
    )
    return np.asarray(since * trial.dt <= HOLD_OUT_SETTINGS.lasts_s)


def _both_driven(t: Array, driven: Mask, use: tuple[float, float], part: tuple[float, float]) -> bool:
    """Whether a part and the rest both have commands that change, a whole stretch each where they change for
    less than half of the time; true where none ever changes.
    """
    inside = (t >= part[0]) & (t < part[1])
    rest = (t >= use[0]) & (t < use[1]) & ~inside
    share = driven[inside | rest].mean()
    if share == 0.0:
        return True
    if min(driven[inside].mean(), driven[rest].mean()) < HOLD_OUT_SETTINGS.driven_share * share:
        return False
    if share > 0.5:
        return True
    edges = np.diff(driven.astype(int), prepend=0, append=0)
    stretches = list(zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True))
    return any(inside[a:b].all() for a, b in stretches) and any(not inside[a:b].any() for a, b in stretches)


def _activity(trial: Trial) -> Array:
    """Squared velocities about their medians over their variance, (n, k), of the axes that move."""
    columns = [y for name in VELOCITIES if (y := trial.filled(name)) is not None and y.std() > 0.0]
    parts = [np.minimum((y - np.median(y)) ** 2 / y.var(), 25.0) for y in columns]
    return np.column_stack(parts) if parts else np.zeros((len(trial), 0))


def _moving_part(trial: Trial) -> tuple[float, float]:
    """First and last time with motion or changing commands, with some rest around."""
    from scipy.ndimage import uniform_filter1d

    t = trial.t
    moving = np.zeros(len(t), bool)
    for name in VELOCITIES:
        if (y := trial.filled(name)) is not None:
            y = np.abs(uniform_filter1d(y, max(1, round(1.0 / trial.dt)), mode="nearest"))
            moving |= y > HOLD_OUT_SETTINGS.still_share * y.max()
    for y in trial.commands.values():
        moving |= np.abs(np.diff(y, prepend=y[0])) > 0.02 * max(np.ptp(y), 1e-12)
    index = np.flatnonzero(moving)
    if len(index) == 0:
        return float(t[0]), float(t[-1])
    return float(max(t[0], t[index[0]] - HOLD_OUT_SETTINGS.idle_s)), float(
        min(t[-1], t[index[-1]] + HOLD_OUT_SETTINGS.idle_s)
    )
