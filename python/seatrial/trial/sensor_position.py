"""Sensors brought to O: what a sensor at p_bs shows, less what the vehicle's rotation adds there.

A velocity sensor at p_bs (body, from O) shows ``v_S = v_O + omega x p_bs``; a positioning antenna or pressure
cell there shows ``p_S = p_O + R p_bs``. The tape measure knows p_bs; without it a turn looks like sway and a
trim like depth. Fossen (2011), section 2.2. Held by tests/trial/test_places.py.
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

__all__ = ["SENSORS", "parse_places", "refuse_far", "to_origin"]

_FAR = 2.0  # of the hull's length; nothing is carried that far out

SENSORS = ("velocity", "position", "depth")
"""Sensors that may sit elsewhere than in O: velocity (over ground and through water), position, depth."""


def parse_places(places: Mapping[str, Sequence[float]] | None, file: str) -> dict[str, Array]:
    """Places (3,) in m, body axes from O, by sensor.

    Raises
    ------
    TrialError
        An unknown sensor, or a place that is not three finite numbers.
    """
    found: dict[str, Array] = {}
    for sensor, place in (places or {}).items():
        if sensor not in SENSORS:
            raise TrialError(f'{file}: places: unknown sensor "{sensor}"{nearest(sensor, SENSORS)}')
        try:
            vector = np.asarray(place, float)
        except (TypeError, ValueError):
            vector = np.zeros(0)
        if vector.shape != (3,) or not np.isfinite(vector).all():
            raise TrialError(
                f"{file}: places, {sensor}: expected three numbers, m forward, starboard and down of O,"
                f" found {place!r}"
            )
        found[sensor] = vector
    return found


def refuse_far(places: Mapping[str, Sequence[float]], length: float | None, where: str) -> None:
    """Refuse places far outside a hull of this length in m: they are not in m.

    Raises
    ------
    CampaignError
        The message begins with `where`.
    """
    for sensor, place in places.items():
        if length is not None and max(map(abs, place)) > _FAR * length:
            raise CampaignError(
                f"{where}, key {sensor}_m: {list(place)} lies far outside the hull of {length:g} m; are the"
                " places in m?"
            )


def to_origin(
    signals: Mapping[str, Signal], places: Mapping[str, Array], report: RecordingReport
) -> dict[str, Signal]:
    """The same signals as sensors in O would have shown them; what cannot be brought there is reported."""
    moved = dict(signals)
    for sensor, place in places.items():
        names = ("velocity", "water velocity") if sensor == "velocity" else ("position",)
        if sensor == "depth" and "depth" in signals:
            names = ("depth",)  # it has stamps of its own
        needed = "rates" if sensor == "velocity" else "attitude"
        for name in names:
            if name not in signals or not place.any():
                continue
            if needed not in signals:
                report.add(
                    "warning", name, f"place ignored: no {needed} recorded, by which to reckon it to O"
                )
                continue
            if sensor == "velocity":
                moved[name] = _velocity(moved[name], signals[needed], place)
            else:
                own = "z" if sensor == "depth" else "xy" if "depth" in places else "xyz"
                moved[name] = _position(moved[name], signals[needed], place, own)
            where = ", ".join(f"{x:g}" for x in place)
            report.add("info", name, f"brought to O from ({where}) m, where the {sensor} sensor is")
    return moved


def _velocity(signal: Signal, rates: Signal, place: Array) -> Signal:
    """A velocity signal less omega x p; a rate that was not recorded counts as zero."""
    known, valid = linear(rates, signal.t)
    omega = np.zeros((len(signal.t), 3))
    omega[:, ["pqr".index(channel) for channel in rates.channels]] = known
    extra = np.cross(omega, place)[:, ["uvw".index(channel[0]) for channel in signal.channels]]
    unknown = ~np.logical_and.reduce(valid, axis=1)
    return replace(signal.masked(np.asarray(unknown)), y=signal.y - extra)


def _position(signal: Signal, attitude: Signal, place: Array, own: str) -> Signal:
    """A position signal less R p in the coordinates `own` of its sensor."""
    q, valid = linear(attitude, signal.t)
    shift = matrix(q) @ place
    y, bad = signal.y.copy(), signal.bad.copy()
    for k, channel in enumerate(signal.channels):
        if channel in own:
            y[:, k] -= shift[:, "xyz".index(channel)]
            bad[:, k] |= ~valid[:, 0]
    return replace(signal, y=y, bad=bad)
