"""Actuators that fail without feedback: what the autopilot notices, and where the vehicle goes.

``python -m tests.flight.actuator_faults [VEHICLE ...]`` prints the table of docs/validation.md.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import seatrial as st
from tests.flight.sensor_faults import VEHICLES, Failure, Row, Told, cell, fly, row

KINDS = ("ahead", "astern", "zero", "frozen", "weak")
"""At full ahead, at full astern, without a signal, at its last signal, at half of every command."""

ALL = "all dead"
"""The column of a vehicle whose actuators have all stopped at once."""


def failure(vehicle: str, kind: str, actuator: str) -> Failure:
    """What the actuators of a vehicle do from the failure on."""
    known = st.Vehicle.load(vehicle).actuator_info()
    failed = list(known) if actuator == ALL else [actuator]

    def stands(name: str, command: float, before: float) -> float:
        facts = known[name]
        neutral = float(facts["neutral"])
        match kind:
            case "ahead":
                return neutral + float(facts["maximum_ahead"])
            case "astern":
                return neutral - float(facts["maximum_astern"])
            case "frozen":
                return before
            case "weak":
                return neutral + 0.5 * (command - neutral)
            case _:
                return neutral

    def obeyed(commands: Told, before: Told) -> Told:
        return commands | {name: stands(name, commands[name], before[name]) for name in failed}

    return obeyed


def failures(vehicle: str) -> Iterator[tuple[str, str]]:
    """The kinds and actuators of the table."""
    for actuator in st.Vehicle.load(vehicle).actuators:
        yield from ((kind, actuator) for kind in KINDS)
    yield "zero", ALL


def table(vehicle: str) -> list[Row]:
    """The rows of a vehicle."""
    usual = fly(vehicle)
    return [
        row(vehicle, kind, name, usual, fly(vehicle, failure=failure(vehicle, kind, name)))
        for kind, name in failures(vehicle)
    ]


if __name__ == "__main__":
    for vehicle in sys.argv[1:] or list(VEHICLES):
        rows = {(row.kind, row.channel): row for row in table(vehicle)}
        print(f"\n| {vehicle} | {' | '.join(KINDS)} |\n|---|{'---|' * len(KINDS)}")
        for name in (*st.Vehicle.load(vehicle).actuators, ALL):
            cells = (rows.get((kind, name)) for kind in KINDS)
            print(f"| {name} | {' | '.join('' if row is None else cell(row) for row in cells)} |", flush=True)
