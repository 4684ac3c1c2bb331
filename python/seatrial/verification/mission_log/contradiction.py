"""Channels of a log that tell of two motions: a sensor that is stuck, reversed or of another clock.

Position and angles are integrals of velocity and rates (Fossen 2011, section 2.2), whatever the model. Over
windows of a few seconds the change that a channel shows is held against the change that the others imply. In
a stretch in which one of the two moves far beyond its noise, and the other hardly goes with it, one of them
is wrong: no coefficient is to blame, and the log judges no model. A bias, a current and a scale error leave
the two correlated; so do delays that are short against the motion.

Held by ``tests/verification/test_recorded_contradiction.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import CHANNELS
from seatrial.base.frames import from_euler, matrix
from seatrial.trial.trial import Trial

_INTEGRALS = {
    "x": ("u", "v", "w"),
    "y": ("u", "v", "w"),
    "z": ("u", "v", "w"),
    "roll": ("p",),
    "pitch": ("q",),
    "yaw": ("r",),
}
"""Channels, and those whose integral they are."""

_WINDOW_S = 5.0
"""Over which a change is taken, s: long against a delay of sensors, short against their drifts."""

_SAMPLES = 5
"""Samples of the channel that a window holds at least: a slow fix is compared over a longer one."""

_WINDOWS = 12
"""Windows of a stretch: of twelve pairs that have nothing in common the correlation is beyond 0.5 by chance
in one of ten stretches; what belongs together has more than 0.9."""

_ARM_M, _LEAK = 1.0, 0.1
"""What turning adds to a change without anything being wrong: an unknown lever arm of a sensor, m per rad,
and the share of a rotation about the other axes that leaks into one, rad per rad; chosen so that a hover
vehicle that spun in a tank, with its Doppler log beside its centre, contradicts nothing."""

_BEYOND_NOISE = 10.0
"""Changes over their own noise from which a channel moves."""

_TOGETHER = 0.5
"""Correlation and slope below which two changes have little in common."""


@dataclass(frozen=True)
class Contradiction:
    """A channel and those whose integral it is tell of two motions.

    Attributes
    ----------
    channel, against
        Their names.
    from_s, to_s
        First and last stretch in which they do, s of the log.
    slope
        Change of the channel per change that the others imply there: 1 where they agree.
    evidence
        Changes of the one that moves over the least that counts.
    """

    channel: str
    against: tuple[str, ...]
    from_s: float
    to_s: float
    slope: float
    evidence: float

    def sentence(self) -> str:
        """The contradiction in words, without a full stop."""
        return (
            f"{self.channel} contradicts {', '.join(self.against)} from {self.from_s:.0f} to"
            f" {self.to_s:.0f} s: it changes by {self.slope:.2g} of what they imply"
        )


def contradictions(trial: Trial, channels: Sequence[str]) -> tuple[Contradiction, ...]:
    """Contradictions between channels of a trial that judge a model, the one that explains others first."""
    contradicting = [
        contradiction
        for channel, rates in _INTEGRALS.items()
        if {channel, *rates} & set(channels)
        and (contradiction := _contradiction(trial, channel, rates)) is not None
    ]
    # A wrong angle turns the velocity as well, so that it contradicts the position: angles come first.
    return tuple(sorted(contradicting, key=lambda each: (len(each.against), -each.evidence)))


def _contradiction(trial: Trial, channel: str, rates: tuple[str, ...]) -> Contradiction | None:
    """Contradiction of a channel; None without one, or where it or one of the others is not in the log."""
    place = CHANNELS.index(channel)
    known = trial.valid[:, place]
    implied, rated = _implied_rate(trial, channel, rates)
    if known.sum() < _SAMPLES or rated.sum() < 2:
        return None
    t = trial.t
    values = trial.observed[known, place]
    values = np.unwrap(values) if channel in ("roll", "pitch", "yaw") else values
    position = np.interp(t, t[known], values)
    rate = np.interp(t, t[rated], implied[rated])
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))])
    interval = float(np.median(np.diff(t[known])))
    step = max(round(max(_WINDOW_S, _SAMPLES * interval) / trial.dt), 1)
    begins = np.arange(0, len(t) - step, step)
    # A window across a gap of either would compare nothing with nothing.
    whole = _covered(known, begins, step) & _covered(rated, begins, step)
    change, expected = (series[begins + step] - series[begins] for series in (position, integral))
    noise = np.sqrt(2.0) * _noise(values)
    drift = _noise(implied[rated]) * np.sqrt(step) * trial.dt
    turned = np.concatenate([[0.0], np.cumsum(_turning(trial, channel, rates)[1:] * np.diff(t))])
    tolerated = (_ARM_M if len(rates) > 1 else _LEAK) * (turned[begins + step] - turned[begins])
    least = _BEYOND_NOISE * max(noise, drift)
    bad = []
    for first in range(0, len(begins) - _WINDOWS + 1, _WINDOWS // 2):
        rows = slice(first, first + _WINDOWS)
        if not whole[rows].all():
            continue
        a, b = change[rows] - change[rows].mean(), expected[rows] - expected[rows].mean()
        spread = float(np.std(a)), float(np.std(b))
        enough = max(least, float(np.sqrt(np.mean(tolerated[rows] ** 2))))
        if max(spread) <= enough:
            continue
        common = float(np.mean(a * b))
        # One that stands still beside one that moves has no correlation, and no slope on the one that moves.
        along = common / max(spread) ** 2
        together = common / (spread[0] * spread[1]) if min(spread) > 0.0 else 0.0
        if along < _TOGETHER and together < _TOGETHER:
            bad.append((
                first,
                common / spread[1] ** 2 if spread[1] > 0.0 else np.inf,
                max(spread) / max(enough, 1e-12),
            ))
    if not bad:
        return None
    last = min(bad[-1][0] + _WINDOWS - 1, len(begins) - 1)
    _, slopes, evidence = zip(*bad, strict=True)
    return Contradiction(
        channel=channel,
        against=rates,
        from_s=float(t[begins[bad[0][0]]]),
        to_s=float(t[begins[last] + step]),
        slope=float(np.median(slopes)),
        evidence=float(max(evidence)),
    )


def _implied_rate(trial: Trial, channel: str, rates: tuple[str, ...]) -> tuple[Array, Mask]:
    """Rate of a channel (n,) by those whose integral it is, and where it is known (n,); SI."""
    angles = ("roll", "pitch", "yaw") if channel != "z" else ("roll", "pitch")
    needed = [CHANNELS.index(name) for name in (*rates, *(angles if len(rates) > 1 else ()))]
    if len(rates) == 1:
        # Rates of Euler angles need the other two; without them the motion is near to level.
        needed = [CHANNELS.index(rates[0])]
    known = np.asarray(trial.valid[:, needed].all(axis=1))
    motion = np.where(np.isfinite(trial.observed), trial.observed, 0.0)
    u_v_w, p_q_r, euler = motion[:, :3], motion[:, 3:6], motion[:, 9:]
    if len(rates) > 1:
        row = CHANNELS.index(channel) - 6
        return np.einsum("nj,nj->n", matrix(from_euler(euler))[:, row], u_v_w), known
    (p, q, r), (roll, pitch, _) = p_q_r.T, euler.T
    turning = q * np.sin(roll) + r * np.cos(roll)
    kinematics = {
        "roll": p + np.tan(pitch) * turning,
        "pitch": q * np.cos(roll) - r * np.sin(roll),
        "yaw": turning / np.maximum(np.cos(pitch), 0.1),
    }
    return kinematics[channel], known


def _turning(trial: Trial, channel: str, rates: tuple[str, ...]) -> Array:
    """Size of the turn rate (n,), rad/s, about axes that may disturb a channel: yaw does not change depth."""
    axes = ("p", "q") if channel == "z" else ("p", "q", "r")
    others = [CHANNELS.index(name) for name in axes if name not in rates]
    motion = np.where(np.isfinite(trial.observed[:, others]), trial.observed[:, others], 0.0)
    return np.asarray(np.linalg.norm(motion, axis=1))


def _covered(known: Mask, begins: NDArray[np.int_], step: int) -> Mask:
    """Whether each window holds some samples: a gap is longer than a window holds."""
    count = np.concatenate([[0], np.cumsum(known)])
    return np.asarray(count[begins + step] - count[begins] >= _SAMPLES - 1)


def _noise(y: Array) -> float:
    """Standard deviation of white noise on a series (n,), from its second differences."""
    if len(y) < 3:
        return 0.0
    # Three of four: a motion bends the series in some places more than its noise does.
    return float(np.quantile(np.abs(np.diff(y, 2)), 0.5) / (0.6745 * np.sqrt(6.0)))
