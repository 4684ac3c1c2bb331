"""Derivatives by an offset that a sensor has throughout a log: a suspect that is no change of the vehicle.

A sensor that reads d too much shows d more and starts every window d away, so that measured less predicted
moves by ``(e - dy/dx_0) d``, e one in its own channel.

Tests: ``tests/test_recorded_suspects.py``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from seatrial.channel import readable
from seatrial.recorded.restarts import Restarts, Slopes
from seatrial.recorded.spread import INITIAL_PLACES
from seatrial.recording.columns import CHANNELS

__all__ = ["offset_channels", "offset_slopes", "words"]

_SENSED = ("u", "v", "w", "p", "q", "r", "roll", "pitch", "yaw")


def offset_channels(log: Restarts) -> list[str]:
    """Channels of a log whose offset shows: not positions, which move start and path alike."""
    return [name for name in log.channels if name in _SENSED]


def offset_slopes(log: Restarts, slopes: Sequence[Slopes], channels: Sequence[str]) -> list[Slopes]:
    """Derivatives of measured less predicted by the offset of each channel, per window.

    Parameters
    ----------
    log : Restarts
    slopes : sequence of Slopes
        Of the same windows, by their starts.
    channels : sequence of str
        Whose sensors err.
    """
    own = [CHANNELS.index(name) for name in channels]
    start = np.argsort(INITIAL_PLACES)[own]
    unit = np.eye(len(CHANNELS))[:, own]
    return [
        Slopes(np.where(mask[:, :, None], unit - one.by_start[:, :, start], 0.0), one.by_start)
        for one, mask in zip(slopes, log.counted, strict=True)
    ]


def words(channel: str, offset: float) -> str:
    """The offset in words.

    Examples
    --------
    >>> words("pitch", 0.01745)
    'the sensor of pitch reads +1 deg too much'
    """
    scale, unit = readable(channel)
    return f"the sensor of {channel} reads {scale * offset:+.2g} {unit} too much"
