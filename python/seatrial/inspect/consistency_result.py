"""What would make the channels of a log tell one motion: corrections, what cannot be told, the current."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.plain import Plain
from seatrial.base.report import Report, Reported, Section, Table

UNTOLD = "hardly any motion: whether the channels agree cannot be told"
"""What is said of a recording without motion."""

_BETTER = 0.95  # error of a velocity with a current over that without which is worth a key


@dataclass(frozen=True)
class Correction:
    """One proposal: a key of a campaign or of an import's map, its value and what it improves.

    Attributes
    ----------
    table, key
        "corrections" (campaign) or "clocks" (map of an import), and the key in it.
    value, sd, unit
        What to write there, its standard deviation (0 for signs and units), the unit of both.
    before, after, of
        Root mean square of the residual without and with this correction, and of which comparison, with
        its unit.
    sentence
        What was found, with deviation and effect.
    sensor
        Of a clock the sensor whose delay it contains, as under delay_s; else "".
    """

    table: str
    key: str
    value: Any
    sd: Any
    unit: str
    before: float
    after: float
    of: str
    sentence: str
    sensor: str = ""

    @property
    def line(self) -> str:
        """The key and its value as a TOML file holds them."""
        file, _, key = self.key.rpartition(".")
        name = f'"{file}".{key}' if self.table == "clocks" else self.key
        return f"{name} = {_toml(self.value)}"


@dataclass(frozen=True, eq=False)
class SlowCurrent(Plain):
    """Current of the water over time.

    Attributes
    ----------
    t
        Times in s, shape (n,).
    velocity, sd
        North and east, m/s, shape (n, 2), and the standard deviation of each.
    source
        What it was estimated from.
    before, after
        Error of u and v (of north and east where the velocity through the water is measured) in m/s, as
        predicted for held-out parts of time without and with this current.
    """

    t: Array
    velocity: Array
    sd: Array
    source: str
    before: tuple[float, float]
    after: tuple[float, float]

    @property
    def worth(self) -> bool:
        """Whether it predicts at least one of the velocities better and none clearly worse."""
        ratios = [after / max(before, 1e-12) for before, after in zip(self.before, self.after, strict=True)]
        return min(ratios) < _BETTER and max(ratios) < 1.0 / _BETTER

    @property
    def line(self) -> str:
        """The key of a trial's corrections and its value as a TOML file holds them.

        Knots that a straight line replaces within half of the usual deviation are left out.
        """
        near = 0.5 * float(np.sqrt(np.mean(self.sd**2)))
        kept = sorted(_corners(self.t, self.velocity, 0, len(self.t) - 1, near))
        columns = (self.t[kept].round(1), *(self.velocity[kept].T).round(3))
        lists = zip(("t_s", "north_m_s", "east_m_s"), columns, strict=True)
        return f"current = {{ {', '.join(f'{name} = {_toml(values.tolist())}' for name, values in lists)} }}"

    @property
    def effect(self) -> str:
        """How much better it predicts, in words."""
        names = ("u", "v") if self.legs else ("north", "east")
        errors = " and ".join(
            f"{name} {before:.3f} to {after:.3f}"
            for name, before, after in zip(names, self.before, self.after, strict=True)
        )
        return f"rms error of the velocity predicted for held-out minutes, m/s: {errors}"

    @property
    def legs(self) -> bool:
        """Whether it comes from legs and turns, not from a velocity through the water."""
        return not self.source.startswith("velocity")


@dataclass(frozen=True, eq=False, repr=False)
class Consistency(Reported):
    """Proposed corrections, the one with the largest effect first; nothing is applied.

    Attributes
    ----------
    corrections
        Each is significant and its effect is not small.
    missing
        What the log cannot tell, and what that costs.
    current
        Slow current of the water; None where the log does not tell it.
    compared
        What was compared, with the root mean square of the difference as recorded and corrected.
    contradictions
        Channels that no correction brings to the motion that the others show.
    """

    corrections: tuple[Correction, ...]
    missing: tuple[str, ...]
    current: SlowCurrent | None = None
    compared: tuple[tuple[str, float, float], ...] = ()
    contradictions: tuple[str, ...] = ()

    def without_motion(self) -> Consistency:
        """What a recording tells in which hardly anything moved: what is missing."""
        return Consistency((), (UNTOLD, *self.missing))

    def report(self) -> Report:
        """How well the channels agree, the worst disagreement, what to do; then all proposals."""
        problems = (*self.contradictions, *(correction.sentence for correction in self.corrections))
        worst = problems[0] if problems else "no channel contradicts another one"
        paste = "; ".join(f"[{correction.table}] {correction.line}" for correction in self.corrections[:3])
        return Report(
            title="Consistency of the channels",
            outcome="contradictory"
            if self.contradictions
            else f"{len(self.corrections)} corrections proposed"
            if self.corrections
            else "consistent",
            good="; ".join(
                f"{of}: {_number(before)} as recorded, {_number(after)} corrected"
                for of, before, after in self.compared
            )
            or "nothing could be compared",
            worst=worst,
            next_step="correct the column map"
            if self.contradictions
            else f"accept with {paste}"
            if paste
            else "identify",
            sections=(
                Section(
                    "Proposals",
                    tuple(correction.sentence for correction in self.corrections),
                    (self.table(),),
                ),
                Section("Not to be corrected", self.contradictions),
                Section("What the log cannot tell", self.missing),
                Section("Current", () if self.current is None else (current_sentence(self.current),)),
            ),
        )

    def table(self) -> Table:
        """Proposals with value, deviation and effect."""
        rows = [
            (
                f"[{correction.table}] {correction.line}",
                _deviation(correction.sd),
                correction.unit,
                _number(correction.before),
                _number(correction.after),
                correction.of,
            )
            for correction in self.corrections
        ]
        return Table.of("", ("key", "+/-", "unit", "rms before", "after", "of"), rows)

    def to_dict(self) -> dict[str, Any]:
        """Corrections, what is missing and the current as plain data for JSON."""
        return {
            "corrections": [asdict(correction) for correction in self.corrections],
            "contradictions": list(self.contradictions),
            "missing": list(self.missing),
            "current": None if self.current is None else self.current.to_dict(),
            "compared": [{"of": of, "before": before, "after": after} for of, before, after in self.compared],
        }


def current_sentence(current: SlowCurrent) -> str:
    """The current at the beginning and the end, its deviation, source and effect."""
    first, last = current.velocity[0], current.velocity[-1]
    sd = float(np.sqrt(np.mean(current.sd**2)))
    return (
        f"({first[0]:+.3f}, {first[1]:+.3f}) m/s north, east at the beginning, ({last[0]:+.3f},"
        f" {last[1]:+.3f}) m/s at the end (+/- {sd:.3f} m/s), from {current.source}; {current.effect}"
    )


def _corners(t: Array, y: Array, first: int, last: int, near: float) -> set[int]:
    """Knots from first to last between which straight lines stay near the values (Ramer 1972)."""
    if last - first < 2:
        return {first, last}
    share = ((t[first:last] - t[first]) / (t[last] - t[first]))[:, None]
    off = np.abs(y[first:last] - y[first] - share * (y[last] - y[first])).max(axis=1)
    furthest = first + int(np.argmax(off))
    if off.max() < near:
        return {first, last}
    return _corners(t, y, first, furthest, near) | _corners(t, y, furthest, last, near)


def _toml(value: Any) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Sequence):
        return f"[{', '.join(_toml(item) for item in value)}]"
    return f"{value:.6g}"


def _number(x: float) -> str:
    return f"{x:.3g}"


def _deviation(sd: Any) -> str:
    if isinstance(sd, Sequence):
        return ", ".join(_deviation(item) or "-" for item in sd)
    return f"{sd:.2g}" if sd else ""
