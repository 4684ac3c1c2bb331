"""The trials of a campaign, each read from its file when it is first asked for."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from seatrial.campaign import Campaign
    from seatrial.campaign_file import TrialSource
    from seatrial.trial import Trial

__all__ = ["TrialsOfCampaign"]


class TrialsOfCampaign(Mapping[str, "Trial"]):
    """Trials by name, read when first asked for."""

    def __init__(self, campaign: Campaign, sources: Mapping[str, TrialSource]) -> None:
        self._campaign, self._sources = campaign, sources
        self._read: dict[str, Trial] = {}
        self._lock = threading.Lock()

    def __getitem__(self, name: str) -> Trial:
        if name not in self._sources:
            raise KeyError(name)
        with self._lock:
            if name not in self._read:
                self._read[name] = self._campaign.read(name)
            return self._read[name]

    def __contains__(self, name: object) -> bool:
        return name in self._sources  # without reading the trial

    def __iter__(self) -> Iterator[str]:
        return iter(self._sources)

    def __len__(self) -> int:
        return len(self._sources)
