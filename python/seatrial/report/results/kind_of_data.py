"""The words about what kind of data a trial is: what spoils it, what was done, what to hold out.

Held by ``tests/inspect/test_kind_of_data.py``, ``test_manoeuvres.py``, ``test_trial_windows.py`` and
``test_verdict.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from seatrial.base.channels import CHANNELS, MOTIONS, readable
from seatrial.base.report import words_of
from seatrial.inspect.feedback import Feedback
from seatrial.inspect.kind_of_data import BANDS_HZ, Contact, Excitation, KindOfData, Saturation, TrialWindows
from seatrial.inspect.manoeuvres import Manoeuvre, counted
from seatrial.inspect.verdict import Verdict
from seatrial.inspect.waves import Waves


def warnings(kind: KindOfData) -> list[str]:
    """What spoils the data, the worst first, with what to do about it."""
    touching = [
        f"{contact.sentence}. Leave this part out: split the trial or hold it out"
        for contact in kind.contacts
    ]
    dominated = [verdict.sentence for verdict in kind.verdicts if verdict.dominated]
    problems = [*map(words_of, kind.impossible), *touching, *dominated]
    return problems + _loops(kind.loops) + _waves(kind.waves) + _saturated(kind.saturated)


def done(kind: KindOfData) -> str:
    """What was done and what moved, in a sentence."""
    moved = ", ".join(axis.channel for axis in kind.excitation if not axis.weak)
    return f"{counted(kind.manoeuvres) or 'no manoeuvre found'}; {moved or 'nothing'} moved clearly"


def _loops(loops: Sequence[Feedback]) -> list[str]:
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


def _saturated(saturated: Sequence[Saturation]) -> list[str]:
    if not saturated:
        return []
    parts = ", ".join(
        f"{command.command} at {command.limit:g} in {100.0 * command.share:.0f} %" for command in saturated
    )
    return [
        f"commands at their limits, where the loop is open and the motor tells no more: {parts} of the time"
    ]


def excitation(axis: Excitation) -> str:
    """Size, noise and main band of a velocity."""
    factor, unit = readable(axis.channel)
    low, high = BANDS_HZ[int(np.argmax(axis.shares))]
    band = f"above {low:g} Hz" if np.isinf(high) else f"from {low:g} to {high:g} Hz"
    noise = f"{axis.over_noise:.0f} times its noise" if axis.over_noise < 200.0 else "far above its noise"
    share = f"{100.0 * max(axis.shares):.0f} % of it {band}"
    return f"{axis.channel}: rms {factor * axis.rms:.2g} {unit}, {noise}, {share}"


def contact(part: Contact) -> str:
    """Where a vehicle was pushed and did not move, and what may have held it."""
    mean = part.values["mean"]
    way = {"X": ("ahead", "astern"), "Y": ("to starboard", "to port"), "Z": ("down", "up")}[part.axis]
    pushed = f"pushed {way[mean < 0.0]} by {abs(mean):.2g} {part.values['unit']}"
    words = f"from {part.start_s:.0f} to {part.end_s:.0f} s {pushed}"
    if (depth := part.values["depth_m"]) is not None:
        where = "the bottom" if mean > 0.0 else "the surface"
        return f"{words} at a constant depth of {depth:.1f} m: {where}, or a taut tether"
    moved = CHANNELS["XYZ".index(part.axis)]
    return f"{words} without motion in {moved}: a taut tether or a wall"


def windows(proposed: TrialWindows) -> str:
    """What to hold out of a trial and why, or why nothing."""
    use = proposed.use
    if proposed.why == "short":
        return f"{use[1] - use[0]:.0f} s with motion are too short to split: hold out another trial"
    if proposed.why == "moves once":
        return (
            "the vehicle moves in one stretch only, which cannot be in both parts, and a part that moves"
            " nothing tells nothing: hold out another trial"
        )
    if proposed.hold_out is None:
        first, last = proposed.driven
        return (
            f"the commands change in one stretch only, {first:.0f} to {last:.0f} s, which cannot be in both"
            " parts: hold out another trial"
        )
    part, (both, recurring) = proposed.hold_out, proposed.kept
    words = "no kind of manoeuvre recurs"
    if recurring:
        words = f"{both} of {recurring} recurring kinds of manoeuvres in both parts"
    share = (min(part[1], use[1]) - max(part[0], use[0])) / (use[1] - use[0])
    return (
        f"hold out {part[0]:.10g} to {part[1]:.10g} s ({100.0 * share:.0f} %): {words}, and it moves"
        f" {proposed.effort:.1f} times as much as the rest"
    )


def verdict(judged: Verdict) -> str:
    """Whether a recording tells how an axis answers its commands, with the evidence."""
    who = f"{MOTIONS[judged.axis]} ({judged.axis})"
    if judged.kind == "open":
        return f"{who} is in open loop: no feedback was detected in its commands"
    share = f"{100.0 * max(judged.told, 0.0):.0f} % of the motion"
    waves = math.isfinite(judged.wave_period_s)
    if judged.kind == "closed and informative":
        return (
            f"{who} is in closed loop but informative: commands independent of feedback drive"
            f" {share}{'' if waves else ', and no waves were seen'}"
        )
    by = f" in waves of {judged.wave_period_s:.1f} s" if waves else ""
    verb = "follows" if len(judged.commands) == 1 else "follow"
    return (
        f"{who} is dominated by feedback: {', '.join(judged.commands)} {verb} the motion{by}, and commands"
        f" independent of feedback drive only {share}; this log does not determine how the axis responds"
    )


TRIAL = (
    "run seatrial plan with the campaign of this log: it proposes a dither on top of the autopilot that makes"
    " the axis identifiable"
)
"""The trial that tells an axis which feedback dominates."""


def manoeuvre(part: Manoeuvre) -> str:
    """All of a manoeuvre."""
    return _MANOEUVRES[part.kind](part)


def _span(part: Manoeuvre) -> str:
    return f"from {part.start_s:.0f} to {part.end_s:.0f} s"


def _step(part: Manoeuvre) -> str:
    axis = part.values["axis"]
    drive = f"the {MOTIONS[axis]} {'force' if axis in 'XYZ' else 'moment'}" if axis else part.by
    # Levels to a hundredth of the drive's range.
    digits = max(0, 2 - int(np.floor(np.log10(max(part.values["range"], 1e-12)))) - 1)
    before, after = (f"{round(part.values[k], digits) + 0.0:.{digits}f}" for k in ("before", "after"))
    unit = f" {part.unit}" if part.unit else ""
    return (
        f"step of {drive} from {before} to {after}{unit} at {part.start_s:.0f} s, held for"
        f" {part.end_s - part.start_s:.0f} s"
    )


def _run(part: Manoeuvre) -> str:
    low, high = part.values["low"], part.values["high"]
    speed = f"{low:.2f} to {high:.2f}" if high - low > 0.1 * high else f"{0.5 * (low + high):.2f}"
    return f"straight run at {speed} m/s {_span(part)}"


def _dive(part: Manoeuvre) -> str:
    return f"{part.kind} from {part.values['from_m']:.1f} to {part.values['to_m']:.1f} m depth {_span(part)}"


def _stay(part: Manoeuvre) -> str:
    return f"{part.kind} {_span(part)}"


_MANOEUVRES: dict[str, Callable[[Manoeuvre], str]] = {
    "step": _step,
    "coast-down": lambda m: (
        f"coast-down of {MOTIONS[m.by]} from {m.size:.2g} to {m.values['last']:.2g} {m.unit}"
        f" in {m.end_s - m.start_s:.0f} s from {m.start_s:.0f} s on"
    ),
    "zigzag": lambda m: f"zigzag of {m.values['swings']} swings of about {m.size:.0f} deg {_span(m)}",
    "turn": lambda m: (
        f"turn of {abs(m.size):.0f} deg to {'starboard' if m.size > 0.0 else 'port'} {_span(m)}"
    ),
    "dive": _dive,
    "rise": _dive,
    "decay": lambda m: (
        f"free decay of {'roll' if m.by == 'K' else 'pitch'} from {m.size:.0f} deg with"
        f" {m.values['extremes']} extremes from {m.start_s:.0f} s on"
    ),
    "straight run": _run,
    "station-keeping": _stay,
    "rest": _stay,
}
