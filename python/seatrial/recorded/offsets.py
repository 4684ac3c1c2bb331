"""Offsets that sensors have throughout a log: declared by a set of sensors, in the channels of a trial.

An offset of the roll angle starts every window of a log with the same wrong roll; no number of windows
averages it out, so that it belongs to the band like a coefficient that is not known exactly.

Tests: ``tests/test_recorded_validity.py``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from seatrial.flight.sensor_channels import sensor_channels, sensors_of
from seatrial.recording.columns import CHANNELS

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["offsets_of"]

_IN_CORE = ("x", "y", "z", "roll", "pitch", "yaw", "u", "v", "w", "p", "q", "r")
_OFFSET = 1


def offsets_of(sensors: Any, vehicle: Vehicle) -> dict[str, float]:
    """Standard deviation of the offset of each channel, SI, by a set of sensors.

    Parameters
    ----------
    sensors : mapping, str or Path
        As for `seatrial.fly`: by kind, "typical", or a file.
    vehicle : Vehicle

    Examples
    --------
    >>> import seatrial as st
    >>> sorted(offsets_of("typical", st.Vehicle.load("cwolf")))[:3]
    ['p', 'pitch', 'q']
    """
    fitted = sensors_of(sensors, vehicle)
    errors = sensor_channels(fitted, 0.1).errors[: len(_IN_CORE), _OFFSET]
    found = dict(zip(_IN_CORE, (float(x) for x in errors), strict=True))
    # An offset of the position moves start and path alike.
    return {name: found[name] for name in CHANNELS if found[name] > 0.0 and name not in ("x", "y", "z")}
