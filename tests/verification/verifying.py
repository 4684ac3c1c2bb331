"""Campaigns with a verification that several tests use: short missions of CWolf."""

from __future__ import annotations

from pathlib import Path

import seatrial as st
from tests.flight.flying import OUT

HEAD = """
format = 1
name = "short"
vehicle = "{vehicle}"
seed = {seed}
[trials.dive]
file = "dive.csv"
[[stages]]
name = "heave"
trials = ["dive"]
axes = {{ free = "Z" }}
[stages.coefficients]
Z_ww = [-1000.0, -50.0]
"""

SHORT = """
[verification]
runs = 24
missions = ["out.toml"]
coefficients = { "*_uu" = 10.0, "stern.gain" = 5.0 }
current = { speed_m_s = [0.0, 0.4] }
faults = { actuator = "stern", probability = 0.3, between_s = [5.0, 20.0] }
outages = { sensor = "depth", probability = 0.3, duration_s = [5.0, 60.0], between_s = [1.0, 20.0] }
start = { depth_m = 0.5 }
[[verification.requirements]]
name = "keeps its path"
holds = "cross_track_p95_m <= 1.0"
probability = 0.5
[[verification.requirements]]
name = "is complete"
holds = 'ending == "complete"'
probability = 0.05
"""
"""One leg of 60 m with everything drawn."""


def text(verification: str = SHORT, *, seed: int = 7, vehicle: str = "cwolf") -> str:
    """Text of a campaign with this table ``[verification]``."""
    return HEAD.format(seed=seed, vehicle=vehicle) + verification


def campaign(
    folder: Path, verification: str = SHORT, *, seed: int = 7, vehicle: str = "cwolf"
) -> st.Campaign:
    """Campaign in a folder, with the mission ``out.toml`` beside it."""
    (folder / "out.toml").write_text(OUT)
    made = text(verification, seed=seed, vehicle=vehicle)
    return st.Campaign.from_toml(made, folder=folder, source="campaign.toml")
