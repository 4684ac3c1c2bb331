"""The watches of the autopilot: the channels that each misses, its key under ``[safety]``, how long it waits.

What they saw is put in words by `seatrial.report.results.watches`. Tests: ``tests/flight/test_flight.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

GROUPS = {
    "position": "position",
    "depth": "depth",
    "attitude": "attitude",
    "velocity": "velocity over ground",
    "rates": "turn rates",
    "altitude": "altitude",
}
"""What a group of channels is called, by its name in ``stale_…``."""


def group(watch: str) -> str:
    """Group of channels whose samples a watch misses; empty for the other watches.

    Examples
    --------
    >>> group("stale_velocity"), group("fence")
    ('velocity', '')
    """
    return watch.removeprefix("stale_") if watch.startswith("stale_") else ""


def reaction_key(watch: str) -> str:
    """Key under ``[safety]`` of the reaction to a watch.

    Examples
    --------
    >>> reaction_key("depth"), reaction_key("stale_velocity")
    ('depth', 'stale_velocity.reaction')
    """
    watch = watch.replace("contradicted_", "stale_") if watch.startswith("contradicted_") else watch
    watch = "stale_depth" if watch == "ascent" else watch
    alone = watch in ("depth", "altitude", "fence", "time")
    return watch if alone else f"{watch}.reaction"


def patience(watch: str, safety: Mapping[str, Any]) -> float:
    """For how long a watch waits after what it misses was there last, s; 0 where it does not wait.

    Parameters
    ----------
    watch : str
    safety : mapping
        ``Autopilot.safety()``.
    """
    if watch.startswith("contradicted_"):
        watch = "contradiction"
    table = safety.get(watch)
    return float(table.get("after_s", 0.0)) if isinstance(table, Mapping) else 0.0
