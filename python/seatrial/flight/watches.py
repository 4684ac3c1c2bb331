"""The watches of the autopilot in words: what each of them saw, and what to do about it."""

from __future__ import annotations

__all__ = ["GROUPS", "cause", "remedy"]

GROUPS = {
    "position": "position",
    "depth": "depth",
    "attitude": "attitude",
    "velocity": "velocity over ground",
    "rates": "turn rates",
    "altitude": "altitude",
}
"""What a group of channels is called, by its name in ``stale_…``."""

_SEEN = {
    "depth": (
        "the mission's largest depth was passed",
        "plan shallower legs, or raise the mission's largest depth",
    ),
    "altitude": (
        "the bottom came nearer than the mission's smallest altitude",
        "plan the legs farther from the bottom, or lower the mission's smallest altitude",
    ),
    "fence": (
        "the vehicle was outside the mission's fence",
        "plan the legs farther inside the fence, or widen it",
    ),
    "time": ("the mission took longer than its limit", "plan a shorter mission, or raise its time limit"),
    "battery": (
        "the battery was low",
        "plan a shorter or slower mission, or give the vehicle a larger battery",
    ),
    "actuator": (
        "an actuator did not follow its command",
        "repair it, or check its limits and its motor in the vehicle file",
    ),
    "progress": (
        "the next waypoint came no nearer for too long",
        "plan a faster leg or less current: the vehicle could not come nearer",
    ),
}


def cause(watch: str) -> str:
    """What a watch saw, to follow "because".

    Examples
    --------
    >>> cause("stale_velocity")
    'no good sample of the velocity over ground arrived for too long'
    """
    if watch in _SEEN:
        return _SEEN[watch][0]
    return f"no good sample of the {GROUPS[watch.removeprefix('stale_')]} arrived for too long"


def remedy(watch: str) -> str:
    """What to do after a watch called for a reaction.

    Examples
    --------
    >>> remedy("fence")
    'plan the legs farther inside the fence, or widen it'
    """
    if watch in _SEEN:
        return _SEEN[watch][1]
    name = GROUPS[watch.removeprefix("stale_")]
    return (
        f"find out why the {name} stopped arriving, or allow a longer gap"
        f" ({watch}.after_s under [safety] in the autopilot file)"
    )
