"""Nuisance parameters: what a trial adds to its record, estimated lest the coefficients absorb it.

A current, a motion-capture frame that was not levelled, the place of the velocity sensor, a late channel, a
biased one. The core applies them (``observation.rs``); here stands how far each may plausibly lie from zero,
which trials it belongs to and whether they share it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seatrial import _core
from seatrial.campaign_file import Polish
from seatrial.errors import CampaignError, nearest
from seatrial.search import Array

NAMES: tuple[str, ...] = tuple(_core.nuisance_names())
"""Names in the core's order."""

_SPREAD = {
    "current": (0.3, "m/s", False),
    "tilt": (0.05, "rad", False),
    "lever": (0.3, "m", True),
    "latency": (0.1, "s", True),
}
_BIAS = {"uvw": (0.02, "m/s"), "pqr": (0.01, "rad/s"), "xyz": (0.2, "m"), "angles": (0.05, "rad")}


@dataclass(frozen=True)
class Nuisance:
    """One nuisance parameter: its column in the core's row, the trials that it belongs to, its prior.

    The prior is centred at zero; ``sd`` is in ``unit``.
    """

    name: str
    key: str
    column: int
    trials: tuple[int, ...]
    unit: str
    sd: float


def nuisances(polish: Polish, trials: Sequence[str], where: str) -> tuple[Nuisance, ...]:
    """Nuisance parameters that a campaign asks for on its trials.

    Parameters
    ----------
    polish : Polish
    trials : sequence of str
        The trials of the joint estimate, in its order.
    where : str
        Words for messages.

    Raises
    ------
    CampaignError
        An unknown nuisance parameter or trial.
    """
    found = []
    for key, entry in polish.nuisances.items():
        if key not in NAMES:
            raise CampaignError(
                f"{where}, key nuisances: unknown nuisance parameter {key!r}{nearest(key, NAMES)};"
                f" there are {', '.join(NAMES)}"
            )
        for name in entry.trials:
            if name not in trials:
                raise CampaignError(
                    f"{where}, key nuisances, {key}: trial {name!r} is not in the joint estimate"
                    + nearest(name, trials)
                )
        sd, unit, shared = _prior(key)
        chosen = [index for index, name in enumerate(trials) if not entry.trials or name in entry.trials]
        together = shared if entry.shared is None else entry.shared
        for group in [tuple(chosen)] if together else [(index,) for index in chosen]:
            label = key if len(group) == len(trials) else f"{', '.join(trials[i] for i in group)}: {key}"
            found.append(Nuisance(label, key, NAMES.index(key), group, unit, entry.sd or sd))
    return tuple(found)


def rows(found: Sequence[Nuisance], values: Array, trials: int) -> Array:
    """Core's rows (trials, 32) of the values of nuisance parameters."""
    table = np.zeros((trials, len(NAMES)))
    for nuisance, value in zip(found, values, strict=True):
        table[list(nuisance.trials), nuisance.column] = value
    return table


def _prior(key: str) -> tuple[float, str, bool]:
    """Standard deviation, unit, and whether all trials share it, unless the campaign says otherwise."""
    kind, _, channel = key.partition("_")
    if kind in _SPREAD:
        return _SPREAD[kind]
    sd, unit = next((entry for channels, entry in _BIAS.items() if channel in channels), _BIAS["angles"])
    return sd, unit, False
