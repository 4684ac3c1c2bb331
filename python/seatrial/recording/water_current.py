"""Current from a Doppler log that sees bottom and water: velocity over ground less that through the water.

At one instant ``v_c,n = R (v_ground - v_water)``; the place on the vehicle cancels, since both velocities
come from the same instrument. A steady current is the median over the record; where the medians of parts of
it differ clearly, the current runs linearly between them. Held by tests/test_water_current.py.

The model takes the current as known input of a trial (Fossen 2011, section 8.3). Without it drag would be
fitted to the speed over ground.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seatrial.recording.report import RecordingReport
from seatrial.rotation import matrix

__all__ = ["WaterCurrent", "add_current", "water_current"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_PART_S = 60.0
_FEWEST = 50  # samples that know both velocities
_STEADY = 0.02  # m/s: parts that differ by less are one current
_CERTAIN = 4.0  # deviations
_DOUBTFUL = 0.1  # m/s: no steady water is as uncertain after minutes of Doppler samples
_NAMES = ("north", "east", "down")


@dataclass(frozen=True)
class WaterCurrent:
    """Current (n, 3) north, east, down in m/s at the times of the record, its deviation (3,), m/s.

    ``steady`` says whether one median serves the whole record.
    """

    current: Array
    deviation: Array
    steady: bool


def add_current(
    parts: dict[str, object], t: Array, ground: Mask, water: Mask, report: RecordingReport
) -> None:
    """Fill ``parts["current"]`` from the velocities over ground and through water, in place, and report it.

    Parameters
    ----------
    parts : dict
        Arrays of a trial: ``nu`` (n, 6), ``water`` (n, 3), ``attitude`` (n, 4).
    t : array (n,)
        Times, s.
    ground, water : array (n,)
        Where either velocity is valid.
    report : RecordingReport
    """
    nu, through, attitude = (np.asarray(parts[name]) for name in ("nu", "water", "attitude"))
    found = water_current(t, nu[:, :3] - through, attitude, ground & water)
    if found is None:
        report.add(
            "info", "current", "not derived: too few samples know velocity over ground and through water"
        )
        return
    parts["current"] = found.current
    mean = found.current.mean(axis=0)
    numbers = ", ".join(
        f"{name} {value:+.3f} (+/- {sd:.3f})"
        for name, value, sd in zip(_NAMES, mean, found.deviation, strict=True)
    )
    manner = "steady" if found.steady else "changing, its mean"
    said = f"{manner} {numbers} m/s, from velocity over ground less that through water"
    if found.deviation.max() > _DOUBTFUL:
        said += "; the two do not fit one water: check sign, unit and frame of both"
    report.add("warning" if found.deviation.max() > _DOUBTFUL else "info", "current", said)


def water_current(t: Array, difference: Array, attitude: Array, known: Mask) -> WaterCurrent | None:
    """Current from body velocities over ground less those through water, (n, 3) in m/s; None if unclear.

    Parameters
    ----------
    t : array (n,)
        Uniform times, s.
    difference : array (n, 3)
    attitude : array (n, 4)
        Quaternions, body to NED.
    known : array (n,)
        Where the difference may be used.

    Examples
    --------
    >>> t = np.arange(0.0, 100.0, 0.1)
    >>> upright = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    >>> found = water_current(t, np.tile([0.2, -0.1, 0.0], (len(t), 1)), upright, t >= 0.0)
    >>> found.current[0].round(3).tolist(), found.steady
    ([0.2, -0.1, 0.0], True)
    """
    index = np.flatnonzero(known)
    if len(index) < _FEWEST:
        return None
    earth = np.einsum("nij,nj->ni", matrix(attitude[index]), difference[index])
    count = max(2, round(float(t[-1] - t[0]) / _PART_S))
    parts = np.array_split(np.arange(len(index)), min(count, len(index) // (_FEWEST // 2)))
    medians = np.array([np.median(earth[part], axis=0) for part in parts])
    centre = np.median(earth, axis=0)
    # The parts' scatter tells how sure the median is, coloured noise included.
    deviation = medians.std(axis=0, ddof=1) / np.sqrt(len(medians))
    white = 1.2533 * np.median(np.abs(earth - centre), axis=0) / 0.6745 / np.sqrt(len(index))
    deviation = np.maximum(deviation, white)
    # Four quarters tell a part's own deviation badly; all parts together tell what they have in common.
    within = np.sqrt(np.mean([_sure(earth[part]) ** 2 for part in parts], axis=0))
    apart = np.abs(medians - centre)
    changing = (apart > _STEADY) & (apart > _CERTAIN * within)
    if not changing.any():
        return WaterCurrent(np.tile(centre, (len(t), 1)), deviation, True)
    middles = np.array([t[index[part]].mean() for part in parts])
    course = np.stack([np.interp(t, middles, medians[:, k]) for k in range(3)], axis=1)
    return WaterCurrent(course, within, False)


def _sure(samples: Array) -> Array:
    """Deviation (3,) of the median of samples (m, 3), from the medians of their quarters."""
    quarters = np.array([np.median(part, axis=0) for part in np.array_split(samples, 4)])
    return np.asarray(quarters.std(axis=0, ddof=1) / 2.0)
