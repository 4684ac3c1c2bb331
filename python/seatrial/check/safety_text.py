"""What an autopilot does when something goes wrong, in sentences. Held by tests/test_check_autopilot.py."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["safety_sentences"]

_REACTIONS = {
    "continue": "the mission goes on",
    "hold": "keep station",
    "surface": "surface under control",
    "abort": "stop all actuators",
}
_GROUPS = {
    "position": "position",
    "depth": "depth",
    "attitude": "attitude",
    "velocity": "velocity over ground",
    "rates": "turn rates",
    "altitude": "altitude",
}
_LIMITS = {
    "depth": "Deeper than the mission's limit",
    "altitude": "Nearer to the bottom than the mission's limit",
    "fence": "Outside the mission's fence",
    "time": "Longer than the mission's limit",
}


def safety_sentences(safety: Mapping[str, Any], *, hovers: bool, loiter_radius_m: float) -> list[str]:
    """A sentence per watch of the table ``[safety]``.

    Parameters
    ----------
    safety : mapping
        The table with its defaults.
    hovers : bool
        Whether a mode keeps the depth without speed; a vehicle that cannot circles instead.
    loiter_radius_m : float
        Radius of that circle, m.

    Examples
    --------
    >>> from seatrial._core import Autopilot
    >>> import tomllib
    >>> table = tomllib.loads(Autopilot.load("cwolf").to_toml())["safety"]
    >>> safety_sentences(table, hovers=True, loiter_radius_m=20.0)[0]
    'No position for 60 s: surface under control'
    """
    words = dict(_REACTIONS)
    if not hovers:
        words["hold"] = f"circle at {loiter_radius_m:g} m"
    said = []
    for key, name in _GROUPS.items():
        stale = safety[f"stale_{key}"]
        where = " on a leg that follows the bottom" if key == "altitude" else ""
        said.append(f"No {name} for {stale['after_s']:g} s{where}: {words[stale['reaction']]}")
    said += [f"{sentence}: {words[safety[key]]}" for key, sentence in _LIMITS.items()]
    battery, actuator = safety["battery"], safety["actuator"]
    said.append(f"Battery below {100.0 * battery['below']:g} %: {words[battery['reaction']]}")
    said.append(
        f"An actuator {100.0 * actuator['deviation']:g} % of its largest signal off for"
        f" {actuator['after_s']:g} s: allocate without it, and {words[actuator['reaction']]}"
    )
    stalled = safety["progress"]
    said.append(f"No nearer to the waypoint for {stalled['after_s']:g} s: {words[stalled['reaction']]}")
    said.append(
        f"Surfacing: at {safety['surface_speed_m_s']:g} m/s until {safety['surfaced_above_m']:g} m of depth"
    )
    return said
