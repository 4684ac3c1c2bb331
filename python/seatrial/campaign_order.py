"""The order in which the stages of a campaign run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.errors import CampaignError, nearest

if TYPE_CHECKING:
    from seatrial.campaign_file import Stage

__all__ = ["in_order"]


def in_order(stages: tuple[Stage, ...], source: str) -> tuple[Stage, ...]:
    """Stages so that each comes after those it names, otherwise as in the file."""
    known = [stage.name for stage in stages]
    for stage in stages:
        if known.count(stage.name) > 1:
            raise CampaignError(f"{source}: two stages are called {stage.name!r}; rename one")
        for name in stage.after:
            if name not in known:
                raise CampaignError(
                    f"{source}: stage {stage.name!r}, key after: unknown stage {name!r}{nearest(name, known)}"
                )
    ordered: list[Stage] = []
    waiting = list(stages)
    while waiting:
        done = {stage.name for stage in ordered}
        ready = next((stage for stage in waiting if done.issuperset(stage.after)), None)
        if ready is None:
            circle = ", ".join(repr(stage.name) for stage in waiting)
            raise CampaignError(
                f"{source}: the stages {circle} wait for one another; remove one of their after"
            )
        ordered.append(ready)
        waiting.remove(ready)
    return tuple(ordered)
