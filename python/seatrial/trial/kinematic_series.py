"""A measured channel at its own stamps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError, nearest

CHANNEL_GROUPS = {
    "position": ("x", "y"),
    "depth": ("z",),
    "velocity": ("u", "v", "w"),
    "water velocity": ("u_water", "v_water", "w_water"),
    "rates": ("p", "q", "r"),
    "attitude": ("roll", "pitch", "yaw"),
    "specific force": ("ax", "ay", "az"),
}
"""Channels that one instrument gives, by its name: m, m/s, rad/s, rad, m/s^2; earth NED, body FRD."""

INPUTS = ("cmd.", "meas.", "tau.")
"""Begins of the names of what drives the vehicle: commands, measured actuators, a wrench."""


@dataclass(frozen=True, eq=False)
class Series:
    """Samples of one channel at the stamps of its own sensor.

    Attributes
    ----------
    t
        Rising stamps in s, shape (n,), on the clock that stamped them.
    value
        Samples in SI, NED or forward-right-down, shape (n,); NaN where lost.
    clock
        Name of that clock, usually of the file; series of one name share it.
    """

    t: Array
    value: Array
    clock: str = ""


def checked(series: Mapping[str, Series]) -> dict[str, Series]:
    """The series without lost samples; inputs (`INPUTS`) keep their names.

    Raises
    ------
    TrialError
        An unknown channel, stamps that do not rise, or arrays of different length.
    """
    known = [channel for channels in CHANNEL_GROUPS.values() for channel in channels]
    result = {}
    for name, one in series.items():
        if name not in known and not name.startswith(INPUTS):
            raise TrialError(f'"{name}" is no channel{nearest(name, known)}')
        t, value = np.asarray(one.t, float), np.asarray(one.value, float)
        if t.ndim != 1 or t.shape != value.shape:
            raise TrialError(
                f"{name}: expected stamps and samples of one length, found shapes {t.shape} and {value.shape}"
            )
        good = np.isfinite(t) & np.isfinite(value)
        if np.any(np.diff(t[good]) <= 0.0):
            raise TrialError(
                f"{name}: expected rising stamps; sort the samples and leave out repeated stamps"
            )
        if good.any():
            result[name] = Series(t[good], value[good], one.clock)
    return result
