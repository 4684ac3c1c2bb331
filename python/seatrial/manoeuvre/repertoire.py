"""The repertoire: what is sailed to identify a vehicle, for any vehicle with drives.

Every function returns a `Manoeuvre` whose commands lie within the motors' limits. `amplitude`, from 0 to 1,
is a share of what the drive reaches besides the thrust that carries the net weight and the thrust ahead;
`ahead` is a word of the engine telegraph (`drive.AHEAD`). Open loop: nothing steers, so the vehicle goes
where physics takes it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from seatrial.errors import VehicleError
from seatrial.manoeuvre import shapes
from seatrial.manoeuvre.definition import SETTLE_S, TURN_BACK_S, Kind, Manoeuvre, times
from seatrial.manoeuvre.drive import Drive, Thrusters
from seatrial.search import Array

__all__ = ["coast_down", "dive", "multisine", "spiral", "staircase", "zigzag"]

_RUN_UP = 0.12
_LONGEST_RUN_UP_S = 20.0
_LEAD_S = 2.0  # nothing happens: what the instruments show at rest

Level = Callable[[Array, float], Array]


def staircase(
    thrusters: Thrusters, drive: Drive, *, duration_s: float, amplitude: float = 0.9, both: bool = True
) -> Manoeuvre:
    """Steps of thrust up to the amplitude and back to nothing, then in the other sense if `both`.

    Examples
    --------
    >>> import seatrial as st
    >>> thrusters = Thrusters(st.Vehicle.load("cwolf"))
    >>> surge = thrusters.drives_of("X")[0]
    >>> manoeuvre = staircase(thrusters, surge, duration_s=120.0)
    >>> manoeuvre.name, round(float(max(manoeuvre.commands["SbU"])))
    ('staircase surge, ahead and astern', 1897)
    """
    name = f"staircase {_called(thrusters, drive)}"
    if drive.axis == "X":
        name += ", ahead and astern" if both else ", ahead"
    senses = "in both senses" if both else "ahead"
    words = f"{drive.motion} in four steps to {100 * amplitude:.0f} % of the thrust, {senses}"
    return _sailed(
        thrusters,
        ("staircase", name, words),
        [(drive, lambda t, span: shapes.staircase(t, span, both=both))],
        duration_s=duration_s,
        amplitude=amplitude,
    )


def coast_down(thrusters: Thrusters, drive: Drive, *, duration_s: float, amplitude: float = 0.9) -> Manoeuvre:
    """Driven up to speed, then let run out, at two speeds; of all but surge in both senses."""
    both = drive.axis != "X"
    return _sailed(
        thrusters,
        (
            "coast-down",
            f"coast-down {_called(thrusters, drive)}",
            f"{drive.motion} driven with {100 * amplitude:.0f} % and half of that, each time let run out",
        ),
        [(drive, lambda t, span: shapes.coast_down(t, span, both=both))],
        duration_s=duration_s,
        amplitude=amplitude,
    )


def zigzag(
    thrusters: Thrusters,
    drive: Drive,
    *,
    duration_s: float,
    ahead: str = "half",
    amplitude: float = 0.5,
    switch_s: float = 15.0,
) -> Manoeuvre:
    """To one side and the other in turn, under way; of a vertical or pitch drive it is a `dive`."""
    return _sailed(
        thrusters,
        (
            "zigzag",
            f"zigzag {_called(thrusters, drive)}, {ahead} ahead",
            f"{ahead} ahead; {drive.motion} to both sides in turn with {100 * amplitude:.0f} % of the thrust"
            f" that is left, switched every {switch_s:g} s",
        ),
        [(drive, lambda t, span: shapes.zigzag(t, span, switch_s=switch_s))],
        duration_s=duration_s,
        amplitude=amplitude,
        ahead=ahead,
    )


def spiral(
    thrusters: Thrusters, drive: Drive, *, duration_s: float, ahead: str = "half", amplitude: float = 0.5
) -> Manoeuvre:
    """Turning tighter step by step, first to one side, then to the other, under way."""
    return _sailed(
        thrusters,
        (
            "spiral",
            f"spiral {_called(thrusters, drive)}, {ahead} ahead",
            f"{ahead} ahead; {drive.motion} in three steps to {100 * amplitude:.0f} % of the thrust that is"
            " left, to starboard and then to port",
        ),
        [(drive, shapes.spiral)],
        duration_s=duration_s,
        amplitude=amplitude,
        ahead=ahead,
    )


def dive(
    thrusters: Thrusters,
    drive: Drive,
    *,
    duration_s: float,
    ahead: str | None = None,
    amplitude: float = 0.5,
    switch_s: float = 12.0,
) -> Manoeuvre:
    """Down and up in turn by a heave or pitch drive, at rest or under way."""
    way = f"{ahead} ahead" if ahead else "without way"
    return _sailed(
        thrusters,
        (
            "dive",
            f"dive by {_called(thrusters, drive)}, {way}",
            f"{way}; {drive.motion} down and up in turn with {100 * amplitude:.0f} % of the thrust that is"
            f" left, switched every {switch_s:g} s",
        ),
        [(drive, lambda t, span: shapes.zigzag(t, span, switch_s=switch_s))],
        duration_s=duration_s,
        amplitude=amplitude,
        ahead=ahead,
    )


def multisine(
    thrusters: Thrusters,
    drives: Sequence[Drive],
    *,
    duration_s: float,
    ahead: str | None = None,
    amplitude: float = 0.5,
    band_hz: tuple[float, float] = (0.02, 0.25),
) -> Manoeuvre:
    """Sums of sines with low crest on one drive or several at once, each with its own frequencies."""

    def part(place: int) -> Level:
        return lambda t, span: shapes.multisine(t, span, band_hz=band_hz, of=len(drives), place=place)

    which = _called(thrusters, drives[0]) if len(drives) == 1 else "all axes"
    way = f", {ahead} ahead" if ahead else ""
    begun = f"{ahead} ahead; " if ahead else ""
    motions = list(dict.fromkeys(drive.motion for drive in drives))
    spoken = f"{', '.join(motions[:-1])} and {motions[-1]} together" if len(motions) > 1 else motions[0]
    return _sailed(
        thrusters,
        (
            "multisine",
            f"multisine {which}{way}",
            f"{begun}{spoken} excited from {band_hz[0]:g} to {band_hz[1]:g} Hz with"
            f" {100 * amplitude:.0f} % of the thrust",
        ),
        [(drive, part(place)) for place, drive in enumerate(drives)],
        duration_s=duration_s,
        amplitude=amplitude,
        ahead=ahead,
    )


def _sailed(
    thrusters: Thrusters,
    called: tuple[Kind, str, str],
    parts: Sequence[tuple[Drive, Level]],
    *,
    duration_s: float,
    amplitude: float,
    ahead: str | None = None,
) -> Manoeuvre:
    """Manoeuvre of drives at levels, on top of what carries the net weight and of thrust ahead."""
    if not 0.0 < amplitude <= 1.0:
        raise VehicleError(f"{called[1]}: expected an amplitude above 0 and up to 1, found {amplitude:g}")
    t = times(duration_s)
    trim = thrusters.trim()
    bias = trim if ahead is None else trim + thrusters.ahead(ahead)
    run_up = _LEAD_S if ahead is None else max(min(_RUN_UP * duration_s, _LONGEST_RUN_UP_S), _LEAD_S)
    extra = np.zeros((len(t), len(thrusters.names)))
    for drive, level in parts:
        shape = np.where(t >= run_up, level(np.maximum(t - run_up, 0.0), duration_s - run_up), 0.0)
        # Staircases go as far as they can in each sense; what should come back pushes as hard both ways.
        extra += thrusters.push(drive, amplitude * shape, bias, even=called[0] != "staircase")
    room = np.where(extra > 0.0, thrusters.upper - bias, bias - thrusters.lower)
    with np.errstate(divide="ignore", invalid="ignore"):
        fits = np.where(np.abs(extra) > 1e-9, room / np.abs(extra), np.inf).min(initial=np.inf)
    thrusts = bias + min(fits, 1.0) * extra
    kind, name, words = called
    travels = ahead is not None or any(drive.axis == "X" for drive, _ in parts)
    return Manoeuvre(
        name, kind, words, t, thrusters.commands(thrusts), pause_s=TURN_BACK_S if travels else SETTLE_S
    )


def _called(thrusters: Thrusters, drive: Drive) -> str:
    """Motion, and by which group where several drive it."""
    several = sum(other.axis == drive.axis for other in thrusters.drives) > 1
    return f"{drive.motion} ({drive.group})" if several else drive.motion
