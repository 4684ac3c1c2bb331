"""What a run rests on, for the file that says so in every run directory."""

from __future__ import annotations

import hashlib
import platform
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from seatrial import _core

if TYPE_CHECKING:
    from seatrial.campaign import Campaign

__all__ = ["run_facts"]


def run_facts(campaign: Campaign, *, trials: bool = True) -> dict[str, Any]:
    """What a run rests on: versions, machine, seed, SIMD level, hashes of the inputs.

    Parameters
    ----------
    campaign : Campaign
    trials : bool, optional
        Whether the recordings are among the inputs.
    """
    return {
        "campaign": campaign.name,
        "seed": campaign.seed,
        "simd": _core.simd_level(),
        "versions": {name: version(name) for name in ("seatrial", "numpy", "scipy", "cma", "polars")}
        | {"python": platform.python_version()},
        "platform": platform.platform(),
        "sha256": {
            "campaign": hashlib.sha256(campaign.text.encode()).hexdigest(),
            "vehicle": hashlib.sha256(campaign.vehicle.to_toml().encode()).hexdigest(),
        }
        | _bench_hashes(campaign)
        | {f"trial {name}": campaign.file_hash(name) for name in (campaign.trials if trials else ())},
    }


def _bench_hashes(campaign: Campaign) -> dict[str, str]:
    """SHA-256 of the bench file and of what it reads."""
    if campaign.bench is None:
        return {}
    facts = campaign.bench.facts
    return {"bench": facts["bench_sha256"]} | {f"bench {k}": v for k, v in facts["inputs_sha256"].items()}
