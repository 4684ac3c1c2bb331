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
from seatrial.base.report import Column, Report, Section, Table, listed
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

    def good(self) -> str:
        """How many checks are met; first what is missing from the log."""
        met, owed = self.checks
        count = f"{met} of {owed} checks are what ArduSub's law makes of the logged inputs"
        if self.missing:
            whole = [name for name in self.missing if name not in self.partly]
            parts = [(whole, "missing from the log"), (list(self.partly), "missing for part of the log")]
            lacks = " and ".join(
                f"{listed(names)} {'is' if len(names) == 1 else 'are'} {what}"
                for names, what in parts
                if names
            )
            lost = sum(bool(gap.topic) for gap in self.impossible)
            return f"{lacks}, so that {lost} check{'s' if lost > 1 else ''} cannot be made; {count}"
        return f"{count}; {len(self.found)} parameters found"

    def worst(self) -> str:
        """The first check that is not met, else one that could not be made, else the first note."""
        wrong = [quantity for quantity in self.quantities if not quantity.holds]
        if wrong:
            # The first in the order of the signal: what comes after it may follow from it.
            worst, more = wrong[0], len(wrong) - 1
            others = f"; {more} more {'is' if more == 1 else 'are'} not met" if more else ""
            return (
                (
                    f"{worst.controller}, {worst.name}: replayed within {_short(worst.p95)} {worst.unit} in"
                    f" 95 % of the rows, expected {_short(worst.limit)} {worst.unit}"
                )
                + (f" ({worst.why})" if worst.why else "")
                + others
            )
        if self.impossible:
            gap = next((each for each in self.impossible if not each.topic), self.impossible[0])
            return f"{gap.controller}, {gap.name}: {gap.why}"
        return self.notes[0] if self.notes else "nothing stands out"

    def report(self) -> Report:
        """How many checks are met, the worst, what to do; tables."""
        worst = self.worst()
        against = self.against()
        # A file that the vehicle does not fly with outweighs any check.
        apart = [(each, own) for each, own, agrees in against if not agrees]
        if apart:
            differ = ", ".join(f"{_value(each)} for {own:g}" for each, own in apart[:4])
            file = self.given.source if self.given else ""
            worst = f"{len(apart)} parameters found differ from {file}: {differ}"
        if self.missing:
            next_step = (
                f"log {listed(list(self.missing))} as well (LOG_BITMASK: attitude, PID, control tuning, RC"
                " input and output), and replay the next dive"
            )
        elif not self.held:
            next_step = "look at the check that is not met in the figure: where does it begin?"
        elif apart:
            next_step = "find out which is right: was the file written by this vehicle before this dive?"
        elif against:
            next_step = "identify the vehicle from the same log: seatrial import LOG --out PROJECT"
        else:
            next_step = "compare the parameters found with the vehicle's own: --parameters FILE"
        return Report(
            title=Path(self.source).name,
            outcome="replayed" if self.held else "replayed in part" if self.checks[0] else "not replayed",
            good=self.good(),
            worst=worst,
            next_step=next_step,
            sections=(
                Section(tables=(self._checks(), self._parameters())),
                Section("What is left, and why", self._reasons(), details=True),
                Section("Notes", self.notes, details=True),
            ),
        )

    def _checks(self) -> Table:
        """Table of all checks; those that could not be made last."""
        rows = [
            (
                each.controller, each.name, each.unit, str(len(each.error)), _short(each.rms),
                _short(each.p95), _short(each.limit), "yes" if each.holds else "no",
            )
            for each in self.quantities
        ]  # fmt: skip
        rows += [(gap.controller, gap.name, "", "0", "", "", "", "cannot tell") for gap in self.impossible]
        head = ("controller", "quantity", "unit", "rows", "rms", "p95 error", "limit", "right")
        return Table.of("Logged and replayed", head, rows, left=3)

    def _parameters(self) -> Table:
        """Table of the parameters found."""
        own = {each.name: (f"{value:g}", "yes" if agrees else "no") for each, value, agrees in self.against()}
        rows = [
            (
                each.name, f"{each.bound} {each.value:.4g}".strip(), "" if math.isnan(each.sd) else
                f"{each.sd:.1g}", *own.get(each.name, ("", "")), each.how,
            )
            for each in self.found
        ]  # fmt: skip
        columns = ("parameter", "value", "sd", "given", "agrees", Column("found from", align="left"))
        return Table.of("Parameters found", columns, rows, left=1)

    def _reasons(self) -> tuple[str, ...]:
        """Why checks are not met, or cannot be made."""
        reasons = [f"{each.controller}, {each.name}: {each.why}." for each in self.quantities if each.why]
        reasons += [f"{gap.controller}, {gap.name}: {gap.why}." for gap in self.impossible]
        return tuple(dict.fromkeys(reasons))


def _short(value: float) -> str:
    return f"{value:.3g}"


def _value(parameter: Found) -> str:
    """Name and value of a parameter, or its bound."""
    return " ".join(part for part in (parameter.name, parameter.bound, _short(parameter.value)) if part)


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
