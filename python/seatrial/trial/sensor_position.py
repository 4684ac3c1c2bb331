"""Lever arms of sensors: what a sensor at p_bs shows, brought to O by what the rotation adds there.

A velocity sensor at p_bs (body frame, from O) shows ``v_S = v_O + omega x p_bs``; a positioning antenna or
pressure cell there shows ``p_S = p_O + R p_bs``. Without p_bs a turn looks like sway and a trim like depth.
Fossen (2011), section 2.2. Held by ``tests/trial/test_sensor_position.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError, TrialError, nearest
from seatrial.base.rotation import matrix
from seatrial.trial.resampling import linear
from seatrial.trial.signals import RecordingReport, Signal

_FAR = 2.0  # of the hull's length; nothing is carried that far out

_SENSORS = ("velocity", "position", "depth")
"""Sensors that may sit elsewhere than in O: velocity (over ground and through water), position, depth."""


def parse_positions(positions: Mapping[str, Sequence[float]] | None, file: str) -> dict[str, Array]:
    """Positions (3,) in m, body axes from O, by sensor.

    Raises
    ------
    TrialError
        An unknown sensor, or a position that is not three finite numbers.
    """
    parsed: dict[str, Array] = {}
    for sensor, position in (positions or {}).items():
        if sensor not in _SENSORS:
            raise TrialError(
                f'{file}: sensor positions: unknown sensor "{sensor}"{nearest(sensor, _SENSORS)}'
            )
        try:
            vector = np.asarray(position, float)
        except (TypeError, ValueError):
            vector = np.zeros(0)
        if vector.shape != (3,) or not np.isfinite(vector).all():
            raise TrialError(
                f"{file}: sensor positions, {sensor}: expected three numbers, m forward, starboard and down"
                f" of O, found {position!r}"
            )
        parsed[sensor] = vector
    return parsed


def refuse_far(positions: Mapping[str, Sequence[float]], length: float | None, where: str) -> None:
    """Refuse positions far outside a hull of this length, m: they are in another unit.

    Raises
    ------
    CampaignError
        The message begins with `where`.
    """
    for sensor, position in positions.items():
        if length is not None and max(map(abs, position)) > _FAR * length:
            raise CampaignError(
                f"{where}, key {sensor}_m: expected a position in m, found {list(position)},"
                f" far outside the hull of {length:g} m; check the unit"
            )


def to_origin(
    signals: Mapping[str, Signal], positions: Mapping[str, Array], report: RecordingReport
) -> dict[str, Signal]:
    """The same signals as sensors in O would have shown them; what cannot be brought there is reported."""
    moved = dict(signals)
    for sensor, arm in positions.items():
        names = ("velocity", "water velocity") if sensor == "velocity" else ("position",)
        if sensor == "depth" and "depth" in signals:
            names = ("depth",)  # it has stamps of its own
        needed = "rates" if sensor == "velocity" else "attitude"
        for name in names:
            if name not in signals or not arm.any():
                continue
            if needed not in signals:
                report.add(
                    "warning",
                    name,
                    f"lever arm ignored: moving the sensor to O needs the {needed}, not recorded",
                )
                continue
            if sensor == "velocity":
                moved[name] = _velocity(moved[name], signals[needed], arm)
            else:
                own = "z" if sensor == "depth" else "xy" if "depth" in positions else "xyz"
                moved[name] = _position(moved[name], signals[needed], arm, own)
            where = ", ".join(f"{x:g}" for x in arm)
            report.add("info", name, f"moved to O from the {sensor} sensor at ({where}) m")
    return moved


def _velocity(signal: Signal, rates: Signal, arm: Array) -> Signal:
    """A velocity signal less omega x p; a rate that was not recorded counts as zero."""
    known, valid = linear(rates, signal.t)
    omega = np.zeros((len(signal.t), 3))
    omega[:, ["pqr".index(channel) for channel in rates.channels]] = known
    extra = np.cross(omega, arm)[:, ["uvw".index(channel[0]) for channel in signal.channels]]
    unknown = ~np.logical_and.reduce(valid, axis=1)
    return replace(signal.masked(np.asarray(unknown)), y=signal.y - extra)


def _position(signal: Signal, attitude: Signal, arm: Array, own: str) -> Signal:
    """A position signal less R p in the coordinates `own` of its sensor."""
    q, valid = linear(attitude, signal.t)
    shift = matrix(q) @ arm
    y, bad = signal.y.copy(), signal.bad.copy()
    for k, channel in enumerate(signal.channels):
        if channel in own:
            y[:, k] -= shift[:, "xyz".index(channel)]
            bad[:, k] |= ~valid[:, 0]
    return replace(signal, y=y, bad=bad)
