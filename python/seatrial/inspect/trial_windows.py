"""Which part of a trial to fit and which to hold out, as a specialist would choose.

The held-out part is contiguous (samples near each other in time are alike: Bergmeir and Benitez 2012), a
fifth to a third of the trial, lies where the log has samples, has every kind of manoeuvre that occurs more
than once, leaves each of them in the fit, cuts few of them and is no easier than the rest. Both parts have
commands that change. Held by ``tests/inspect/test_trial_windows.py``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import CHANNELS, VELOCITIES
from seatrial.inspect.manoeuvres import Manoeuvre

if TYPE_CHECKING:
    from seatrial.trial.trial import Trial


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


SETTINGS = HoldOutSettings()

_TOLD = ("step", "coast-down", "turn", "zigzag", "dive", "rise", "decay", "straight run")


@dataclass(frozen=True)
class TrialWindows:
    """Proposed parts of a trial, s in its own time."""

    use: tuple[float, float]  #: From the first to the last motion.
    #: (start, stop) for the key ``hold_out_s`` of a campaign; None where the trial is too short or too
    #: uniform to be split.
    hold_out: tuple[float, float] | None
    #: Kinds of manoeuvres that both parts have, of those that occur more than once: (both, all).
    kept: tuple[int, int]
    effort: float  #: Activity of the held-out part over that of the fitted part, 1 is alike.
    sentence: str  #: Why, in words.


def windows(trial: Trial, sequence: Sequence[Manoeuvre]) -> TrialWindows:
    """Proposed use and hold-out of a trial with these manoeuvres."""
    activity = _activity(trial)
    use = _moving_part(trial)
    length = use[1] - use[0]
    if length < SETTINGS.shortest_s:
        return TrialWindows(
            use,
            None,
            (0, 0),
            1.0,
            f"{length:.0f} s with motion are too short to split: hold out another trial",
        )
    countable, repeated = _countable(sequence)
    driven, blind = _driven(trial), _blind(trial)
    best, could_be_driven = None, False
    for share in SETTINGS.shares:
        for start in np.linspace(use[0], use[1] - share * length, SETTINGS.starts):
            candidate = (
                float(np.round(start / SETTINGS.round_s)),
                float(np.round((start + share * length) / SETTINGS.round_s)),
            )
            if not _both_driven(trial.t, driven, use, candidate):
                continue
            could_be_driven = True
            if not _moves(trial.t, activity, use, candidate):
                continue
            merit, both, effort = _merit(trial, activity, use, candidate, countable, repeated)
            merit -= 2.0 * abs(share - SETTINGS.usual_share) - 0.2 * (start - use[0]) / length
            held = (trial.t >= candidate[0]) & (trial.t < candidate[1])
            merit -= SETTINGS.unmeasured_cost * float(blind[held].mean())
            if best is None or merit > best[0]:
                best = (merit, candidate, both, effort)
    if best is None and could_be_driven:
        return TrialWindows(
            use,
            None,
            (0, 0),
            1.0,
            "the vehicle moves in one stretch only, which cannot be in both parts, and a part that moves"
            " nothing tells nothing: hold out another trial",
        )
    if best is None:
        at = trial.t[driven]
        return TrialWindows(
            use,
            None,
            (0, 0),
            1.0,
            f"the commands change in one stretch only, {at[0]:.0f} to {at[-1]:.0f} s, which cannot be in both"
            " parts: hold out another trial",
        )
    _, candidate, both, effort = best
    candidate = (candidate[0], float(np.ceil(trial.t[-1]))) if use[1] - candidate[1] < 2.0 else candidate
    return TrialWindows(
        use, candidate, (both, len(repeated)), effort, _sentence(candidate, use, both, repeated, effort)
    )


def moved(
    trial: Trial, sequence: Sequence[Manoeuvre], proposed: TrialWindows, part: tuple[float, float]
) -> str:
    """The sentence of a hold-out that begins or ends elsewhere than proposed, judged as it is."""
    countable, repeated = _countable(sequence)
    _, both, effort = _merit(trial, _activity(trial), proposed.use, part, countable, repeated)
    return _sentence(part, proposed.use, both, repeated, effort)


def _sentence(
    part: tuple[float, float],
    use: tuple[float, float],
    both: int,
    repeated: Sequence[tuple[str, str]],
    effort: float,
) -> str:
    words = "no kind of manoeuvre recurs"
    if repeated:
        words = f"{both} of {len(repeated)} recurring kinds of manoeuvres in both parts"
    share = (min(part[1], use[1]) - max(part[0], use[0])) / (use[1] - use[0])
    return (
        f"hold out {part[0]:.10g} to {part[1]:.10g} s ({100.0 * share:.0f} %): {words}, and it moves"
        f" {effort:.1f} times as much as the rest"
    )


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
    return bool(ratio.max() >= SETTINGS.least_activity)


def _blind(trial: Trial) -> Mask:
    """Samples (n,) of which no channel was measured, as in a gap of the log."""
    return ~np.asarray(trial.valid[:, [CHANNELS.index(name) for name in trial.channels]].any(axis=1))


def _driven(trial: Trial) -> NDArray[np.bool_]:
    """Samples (n,) at which some command or the recorded wrench changes, or changed a moment ago."""
    inputs = [*trial.commands.values(), *([] if trial.tau is None else trial.tau.T)]
    changes = np.zeros(len(trial), bool)
    for y in inputs:
        if np.ptp(y) > 0.0:
            changes |= np.abs(np.diff(y, prepend=y[0])) > 0.02 * np.ptp(y)
    since = np.arange(len(trial)) - np.maximum.accumulate(
        np.where(changes, np.arange(len(trial)), -len(trial))
    )
    return np.asarray(since * trial.dt <= SETTINGS.lasts_s)


def _both_driven(
    t: Array, driven: NDArray[np.bool_], use: tuple[float, float], part: tuple[float, float]
) -> bool:
    """Whether a part and the rest both have commands that change, a whole stretch each where they change for
    less than half of the time; true where none ever changes.
    """
    inside = (t >= part[0]) & (t < part[1])
    rest = (t >= use[0]) & (t < use[1]) & ~inside
    share = driven[inside | rest].mean()
    if share == 0.0:
        return True
    if min(driven[inside].mean(), driven[rest].mean()) < SETTINGS.driven_share * share:
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
            moving |= y > SETTINGS.still_share * y.max()
    for y in trial.commands.values():
        moving |= np.abs(np.diff(y, prepend=y[0])) > 0.02 * max(np.ptp(y), 1e-12)
    index = np.flatnonzero(moving)
    if len(index) == 0:
        return float(t[0]), float(t[-1])
    return float(max(t[0], t[index[0]] - SETTINGS.idle_s)), float(min(t[-1], t[index[-1]] + SETTINGS.idle_s))
