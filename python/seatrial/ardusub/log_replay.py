"""Replay of ArduSub's controllers from a DataFlash log: what the law makes of the inputs, and what is logged.

A log has a row of every controller ten times a second; the controllers run 200 to 400 times. What a row needs
from itself alone (proportional and feed-forward terms, sums, limits, mixing) is computed row by row. What
remembers (integrator, filters) is fed with what the rows have, and says what is left. Gains that the log does
not carry are found from it (`seatrial.ardusub.controllers`): each is the one that fits best on the first half
of the rows. The modes of the log say which checks it owes; one that cannot be made counts as one that is
not met.

Rows of the position controllers are those of firmware 4.7 and later, in metres; the names of parameters, too.
Held by ``tests/ardusub/test_replay.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from seatrial.ardusub.comparison import Found, Impossible, Quantity
from seatrial.ardusub.controllers import Controllers
from seatrial.ardusub.motors import replay_motors, replay_sticks
from seatrial.ardusub.parameters import ParameterFile, generation, in_metres
from seatrial.base.errors import TrialError
from seatrial.base.run import RunResult, run_facts, sha256, to_json
from seatrial.base.work import Clock
from seatrial.logs.formats import open_log


@dataclass(frozen=True, eq=False, repr=False)
class Replay(RunResult):
    """What the law makes of a log's inputs, beside what the log says.

    Attributes
    ----------
    source
        The log.
    quantities
        One by one in the order of the signal.
    impossible
        Checks that the modes of the log ask for and that could not be made.
    found
        Parameters that were found from the log, or bounds of them.
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
    impossible: tuple[Impossible, ...]
    found: tuple[Found, ...]
    frame: tuple[str, tuple[int, ...]] | None
    notes: tuple[str, ...]
    facts: Mapping[str, Any]
    given: ParameterFile | None = None

    @property
    def checks(self) -> tuple[int, int]:
        """How many checks are met, and how many the log owes."""
        met = sum(quantity.holds for quantity in self.quantities)
        return met, len(self.quantities) + len(self.impossible)

    @property
    def held(self) -> bool:
        """Whether every check that the log owes is met."""
        met, owed = self.checks
        return met == owed

    @property
    def missing(self) -> tuple[str, ...]:
        """Topics without which checks could not be made."""
        return tuple(dict.fromkeys(gap.topic for gap in self.impossible if gap.topic))

    @property
    def partly(self) -> tuple[str, ...]:
        """Topics that are missing for part of the time in which their controller worked."""
        return tuple(dict.fromkeys(gap.topic for gap in self.impossible if gap.topic and gap.partly))

    def parameter(self, name: str) -> float:
        """Value of a parameter that was found.

        Raises
        ------
        KeyError
            It was not, or only a bound of it.
        """
        values = {each.name: each.value for each in self.found if not each.bound}
        return values[name]

    def against(self) -> tuple[tuple[Found, float, bool], ...]:
        """Each parameter found, its value in the file that was given, and whether they agree."""
        if self.given is None:
            return ()
        values = in_metres(self.given)
        both = ((each, values[each.name]) for each in self.found if each.name in values)
        return tuple((each, own, each.agrees(own)) for each, own in both)

    def parameter_file(self) -> str:
        """The parameters found as a parameter file, each with what it was found from; bounds are comments."""
        lines = [f"# Found from {Path(self.source).name}; ArduSub 4.7 and later by name and unit"]
        for each in self.found:
            if each.bound:
                lines.append(f"# {each.name}: {each.bound} {each.value:.6g} ({each.how}); nothing to load")
                continue
            spread = "" if math.isnan(each.sd) else f", standard deviation {each.sd:.2g}"
            lines += [f"# {each.how}{spread}", f"{each.name},{each.value:.6g}"]
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
        met, owed = self.checks
        return {
            "source": self.source,
            "held": self.held,
            "checks": {"met": met, "owed": owed, "impossible": len(self.impossible)},
            "missing": list(self.missing),
            "compared": [
                {"name": each.name, "found": each.value, "bound": each.bound, "given": own, "agrees": agrees}
                for each, own, agrees in self.against()
            ],
            "quantities": [quantity.to_dict() for quantity in self.quantities],
            "impossible": [gap.to_dict() for gap in self.impossible],
            "found": [each.to_dict() for each in self.found],
            "frame": None
            if self.frame is None
            else {"name": self.frame[0], "direction": list(self.frame[1])},
            "notes": list(self.notes),
        }


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
    missing = [name for name in ("RATE", "PIDR", "PIDP", "PIDY") if name not in opened.fields]
    if "RATE" in missing:
        raise _not_ardusub(log, missing)
    known = in_metres(ParameterFile(str(log), opened.parameters))
    known.update({} if parameters is None else in_metres(parameters))
    work = Controllers(opened, known)
    if len(missing) == 3 and (work.owes("attitude") or not work.owes("sticks")):
        raise _not_ardusub(log, missing)
    if work.owes("attitude") or not work.modes.names:
        work.angles()
        for axis in range(3):
            work.rate(axis)
    work.depth()
    work.plane()
    replay_sticks(work)
    frame = replay_motors(work, work.plane_demand)
    if not work.quantities:
        reason = work.impossible[0].why if work.impossible else work.notes[0] if work.notes else "no rows"
        raise TrialError(f"{log}: no controller could be replayed: {reason}")
    inputs = {Path(log).name: sha256(Path(log).read_bytes())}
    if parameters is not None:
        inputs[parameters.source] = sha256(repr(sorted(parameters.values.items())))
    return Replay(
        str(log), tuple(work.quantities), tuple(work.impossible), tuple(work.found), frame,
        tuple(dict.fromkeys(work.notes)), run_facts("replay", Path(log).stem, clock=clock, inputs=inputs),
        parameters,
    )  # fmt: skip


def _not_ardusub(log: str | Path, missing: list[str]) -> TrialError:
    """Refusal of a log without the rows of ArduSub's rate controllers."""
    return TrialError(
        f"{log}: expected a DataFlash log of ArduSub with RATE, PIDR, PIDP, PIDY, found no"
        f" {', '.join(missing)}; let LOG_BITMASK include PID and attitude, and log again"
    )
