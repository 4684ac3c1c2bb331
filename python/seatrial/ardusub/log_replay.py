"""Replay of ArduSub's controllers from a DataFlash log: what the law makes of the inputs, and what is logged.

A log has a row of every controller ten times a second; the controllers run 200 to 400 times. What a row needs
from itself alone (proportional and feed-forward terms, sums, limits, mixing) is computed row by row. What
remembers (integrator, filters) is fed with what the rows have, and says what is left. Gains that the log does
not carry are found from it (`seatrial.ardusub.controllers`): each is the one that fits best on the first half
of the rows, and is judged on the others.

Rows of the position controllers are those of firmware 4.7 and later, in metres; the names of parameters, too.
Held by ``tests/ardusub/test_replay.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from seatrial.ardusub.controllers import Controllers
from seatrial.ardusub.parameters import ParameterFile, generation, in_metres
from seatrial.ardusub.quantity import Found, Quantity
from seatrial.base.errors import TrialError
from seatrial.base.progress import Clock
from seatrial.base.report import Column, Report, Section, Table
from seatrial.base.run import RunResult, run_facts, sha256, to_json
from seatrial.logs.formats import open_log

__all__ = ["Replay", "replay"]


@dataclass(frozen=True, eq=False)
class Replay(RunResult):
    """What the law makes of a log's inputs, beside what the log says.

    Attributes
    ----------
    source
        The log.
    quantities
        One by one in the order of the signal.
    found
        Parameters that were found from the log.
    frame
        Name of the frame, and ``MOT_n_DIRECTION`` of its motors.
    notes
        What could not be replayed and why.
    facts
        What the result rests on.
    given
        The vehicle's own parameters, where they were given; those found are compared with them.
    """

    source: str
    quantities: tuple[Quantity, ...]
    found: tuple[Found, ...]
    frame: tuple[str, tuple[int, ...]] | None
    notes: tuple[str, ...]
    facts: Mapping[str, Any]
    given: ParameterFile | None = None

    @property
    def held(self) -> bool:
        """Whether every quantity is within its limit."""
        return all(one.holds for one in self.quantities)

    def parameter(self, name: str) -> float:
        """Value of a parameter that was found.

        Raises
        ------
        KeyError
            It was not.
        """
        return next(one.value for one in self.found if one.name == name)

    def against(self) -> tuple[tuple[Found, float, bool], ...]:
        """Each parameter found, its value in the file that was given, and whether the two agree.

        They agree within a hundredth or three standard deviations.
        """
        if self.given is None:
            return ()
        values = in_metres(self.given)
        both = ((one, values[one.name]) for one in self.found if one.name in values)
        return tuple(
            (
                one,
                own,
                abs(one.value - own) <= max(0.01 * abs(own), 3.0 * (one.sd if one.sd == one.sd else 0.0)),
            )
            for one, own in both
        )

    def parameter_file(self) -> str:
        """The parameters found as a parameter file, each with what it was found from."""
        lines = [f"# Found from {Path(self.source).name}; ArduSub 4.7 and later by name and unit"]
        for one in self.found:
            spread = "" if math.isnan(one.sd) else f", standard deviation {one.sd:.2g}"
            lines += [f"# {one.how}{spread}", f"{one.name},{one.value:.6g}"]
        return "\n".join(lines) + "\n"

    def files(self) -> dict[str, str | bytes]:
        """Files of the run directory by name, see `save`."""
        return {
            "replay.json": to_json(self.to_dict()),
            "found.param": self.parameter_file(),
            **self.report().files(),
        }

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "source": self.source,
            "held": self.held,
            "compared": [
                {"name": one.name, "found": one.value, "given": own, "agrees": agrees}
                for one, own, agrees in self.against()
            ],
            "quantities": [one.to_dict() for one in self.quantities],
            "found": [
                {"name": one.name, "value": one.value, "sd": one.sd, "how": one.how} for one in self.found
            ],
            "frame": None
            if self.frame is None
            else {"name": self.frame[0], "direction": list(self.frame[1])},
            "notes": list(self.notes),
        }

    def report(self) -> Report:
        """How many quantities are right, the worst, what to do; tables."""
        right = sum(one.holds for one in self.quantities)
        wrong = [one for one in self.quantities if not one.holds]
        good = (
            f"{right} of {len(self.quantities)} logged quantities are what ArduSub's law makes of the logged"
            f" inputs; {len(self.found)} parameters found"
        )
        if wrong:
            one = max(wrong, key=lambda each: each.p95 / each.limit)
            worst = (
                f"{one.controller}, {one.name}: replayed within {_short(one.p95)} {one.unit} in 95 % of the"
                f" rows, expected {_short(one.limit)} {one.unit}"
            ) + (f" ({one.why})" if one.why else "")
        else:
            worst = self.notes[0] if self.notes else "nothing stands out"
        against = self.against()
        apart = [(one, own) for one, own, agrees in against if not agrees]
        if apart:
            told = ", ".join(f"{one.name} {_short(one.value)} for {own:g}" for one, own in apart[:4])
            worst = (
                f"{len(apart)} parameters found differ from {self.given.source if self.given else ''}: {told}"
            )
        next_step = (
            "find out which is right: was the file written by this vehicle before this dive?"
            if apart
            else "identify the vehicle from the same log: seatrial import LOG --out PROJECT"
            if against
            else "compare the parameters found with the vehicle's own: --parameters FILE"
        )
        rows = [
            (
                one.controller, one.name, one.unit, str(len(one.error)), _short(one.rms), _short(one.p95),
                _short(one.limit), "yes" if one.holds else "no",
            )
            for one in self.quantities
        ]  # fmt: skip
        head = ("controller", "quantity", "unit", "rows", "rms", "p95 error", "limit", "right")
        own = {one.name: (f"{value:g}", "yes" if agrees else "no") for one, value, agrees in against}
        told_rows = [
            (
                one.name, f"{one.value:.4g}", "" if math.isnan(one.sd) else f"{one.sd:.1g}",
                *own.get(one.name, ("", "")), one.how,
            )
            for one in self.found
        ]  # fmt: skip
        columns = ("parameter", "value", "sd", "given", "agrees", Column("found from", align="left"))
        reasons = dict.fromkeys(
            f"{one.controller}, {one.name}: {one.why}." for one in self.quantities if one.why
        )
        return Report(
            title=Path(self.source).name,
            outcome="replayed" if self.held else "replayed in part",
            good=good,
            worst=worst,
            next_step=next_step,
            sections=(
                Section(
                    tables=(
                        Table.of("Logged and replayed", head, rows, left=3),
                        Table.of("Parameters found", columns, told_rows, left=1),
                    )
                ),
                Section("What is left, and why", tuple(reasons), details=True),
                Section("Notes", self.notes, details=True),
            ),
        )

    def summary(self) -> str:
        """The report as text."""
        return self.report().text()


def _short(value: float) -> str:
    return f"{value:.3g}"


def replay(log: str | Path, *, parameters: ParameterFile | None = None) -> Replay:
    """Replay of the controllers of a DataFlash log.

    Parameters
    ----------
    log : str or Path
        ``.BIN``, or its text.
    parameters : ParameterFile, optional
        The vehicle's own; those found are compared with them.

    Raises
    ------
    TrialError
        The log cannot be read, or has no rows of ArduSub's rate controllers; the parameters are not of one
        generation of firmware.
    """
    clock = Clock()
    if parameters is not None:
        generation(parameters.values, parameters.source)
    opened = open_log(log)
    needed = ("RATE", "PIDR", "PIDP", "PIDY")
    if missing := [name for name in needed if name not in opened.fields]:
        raise TrialError(
            f"{log}: expected a DataFlash log of ArduSub with {', '.join(needed)}, found no"
            f" {', '.join(missing)}; let LOG_BITMASK include PID and attitude, and log again"
        )
    work = Controllers(opened)
    work.angles()
    for axis in range(3):
        work.rate(axis)
    work.depth()
    work.plane()
    work.pulses()
    if not work.quantities:
        raise TrialError(f"{log}: no controller could be replayed: {work.notes[0]}")
    inputs = {Path(log).name: sha256(Path(log).read_bytes())}
    if parameters is not None:
        inputs[parameters.source] = sha256(repr(sorted(parameters.values.items())))
    return Replay(
        str(log), tuple(work.quantities), tuple(work.found), work.frame, tuple(dict.fromkeys(work.notes)),
        run_facts("replay", Path(log).stem, clock=clock, inputs=inputs), parameters,
    )  # fmt: skip
