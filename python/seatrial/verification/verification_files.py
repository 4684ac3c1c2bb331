"""What a verification leaves in its run directory: verdict, missions, JUnit XML, worst missions, inputs.

Tests: ``tests/test_verify.py``, ``tests/test_cli_verify.py``.
"""

from __future__ import annotations

import hashlib
from collections.abc import Container
from importlib import metadata
from itertools import count
from typing import TYPE_CHECKING, Any

from seatrial.run_directory import RUN_FILE, to_json
from seatrial.run_facts import run_facts
from seatrial.verification.junit import Outcome, junit_xml
from seatrial.whole_file import parquet

if TYPE_CHECKING:
    from seatrial.verification.verification_result import Verification

__all__ = ["facts", "files", "junit"]

_LONGEST = 50
"""Letters: those of some scripts take four of the 255 bytes that file systems give a name."""


def facts(found: Verification) -> dict[str, Any]:
    """What a verification rests on: versions, machine, seed, hashes of the inputs, what was asked for."""
    known = run_facts(found.campaign, trials=False)
    inputs = {name: hashlib.sha256(text.encode()).hexdigest() for name, text in _inputs(found).items()}
    return known | {
        "kind": "verification",
        "missions": len(found.flown),
        "verification": found.flights.table.model_dump(mode="json", exclude_none=True),
        "sha256": known["sha256"] | inputs,
    }


def junit(found: Verification) -> str:
    """JUnit XML with a case per requirement."""
    from seatrial.verification.verification_text import again, requirement_lines

    titles = found.flights.titles
    mission = titles[0] if len(titles) == 1 else "all missions"
    part = found.flown.wall_s / len(found.requirements)
    lines = [requirement_lines(one) for one in found.requirements]
    outcomes = [
        Outcome(
            mission,
            one.requirement.name,
            one.verdict,
            message=one.sentence,
            # The second line is the message.
            details="\n".join([said[0], *(line.strip() for line in said[2:]), again(found)]),
            time_s=part,
        )
        for one, said in zip(found.requirements, lines, strict=True)
    ]
    rests_on = {
        "seed": found.flights.seed,
        "missions": len(found.flown),
        "seatrial": metadata.version("seatrial"),
        "autopilot": found.flights.autopilot.name,
        "vehicle": found.flights.fitted.vehicle.name,
        "confidence": found.flights.table.confidence,
    }
    rests_on |= {f"note {k}": note for k, note in enumerate((*found.notes, *found.flights.left_out), 1)}
    return junit_xml(found.campaign.name, outcomes, properties=rests_on)


def files(found: Verification) -> dict[str, str | bytes]:
    """Files of the run directory by name: text, or bytes."""
    worst = {one.requirement.name: [run.to_dict() for run in one.worst] for one in found.requirements}
    return {
        RUN_FILE: to_json(facts(found)),
        **_inputs(found),
        "verification.json": to_json(found.to_dict()),
        "summary.txt": found.summary() + "\n",
        "junit.xml": junit(found),
        "worst_runs.json": to_json(worst),
        "missions.parquet": parquet(found.table()),
    }


def _inputs(found: Verification) -> dict[str, str]:
    """Files of the inputs by name, as they were flown."""
    flights = found.flights
    missions: dict[str, str] = {}
    for title, mission in zip(flights.titles, flights.missions, strict=True):
        missions[_free(_safe(title), missions)] = mission.to_toml()
    return {
        "campaign.toml": found.campaign.text,
        "vehicle.toml": flights.fitted.vehicle.to_toml(),
        "autopilot.toml": flights.autopilot.to_toml(),
        **{f"missions/{name}.toml": text for name, text in missions.items()},
    }


def _safe(name: str) -> str:
    """Name for a file, short enough for any file system."""
    return "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in name)[:_LONGEST]


def _free(name: str, taken: Container[str]) -> str:
    """The name, with a number where another mission's became the same."""
    numbered = (name if k == 1 else f"{name}-{k}" for k in count(1))
    return next(one for one in numbered if one not in taken)
