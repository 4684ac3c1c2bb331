"""What a log of ArduSub said and the parameters that come of it: three lines, tables, files.

Held by ``tests/ardusub/test_from_log.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.ardusub.axes import AxisVerdict
from seatrial.ardusub.log_replay import Replay
from seatrial.ardusub.parameters import Change, changes_text, of_generation
from seatrial.ardusub.reflight import Reflight
from seatrial.ardusub.tuning import Missions, Tuned
from seatrial.base.run import RunResult, to_json

_CHANCE = 1.645  # standard errors of a mean
NO_WORSE = 1.05  # violation after over before up to which a loop that nothing changed is no worse


@dataclass(frozen=True, eq=False, repr=False)
class LogTuning(RunResult):
    """What a log of ArduSub said, and the parameters that come of it.

    Attributes
    ----------
    replay
        Whether the law explains the log, and the parameters found.
    identified
        First line of the identification, and coefficients with standard deviations by name.
    parameters
        Those that the vehicle flew with: found from the log, else of the file, else ArduSub's defaults.
    assumed
        Names of those that are defaults because neither log nor file has them.
    reflight
        The log's mission flown again.
    verdicts
        Which loops can be judged.
    tuned
        Parameters before and after.
    before, after
        Missions with either; the same where nothing changes.
    rise_s
        By then a step of yaw is to have risen, see `seatrial.ardusub.tuning.corridors_of`.
    missions
        How many.
    generation
        Of the firmware in whose names changes are written.
    facts
    folders
        Project and identification, beside the run directory.
    """

    replay: Replay
    identified: Mapping[str, Any]
    parameters: Mapping[str, float]
    assumed: tuple[str, ...]
    reflight: Reflight
    verdicts: tuple[AxisVerdict, ...]
    tuned: Tuned
    before: Missions
    after: Missions
    rise_s: float
    missions: int
    generation: str
    facts: Mapping[str, Any]
    folders: tuple[Path, Path]

    @property
    def changes(self) -> tuple[Change, ...]:
        """What changes, in the names and units of the firmware's generation."""
        return tuple(of_generation(change, self.generation) for change in self.tuned.changes)

    @property
    def better(self) -> bool:
        """Whether the loops that changed violate their corridors less, and no other loop more.

        Of a loop that changed the worst mission and the mean of the worst tenth are lower; of the others that
        mean is no more than a twentieth higher, or by no more than chance. A single mission of a loop that
        nothing changed may be a vehicle that no gain holds: it is told, and decides nothing.
        """
        changed = self.changed_channels
        return bool(changed) and all(
            self.after.worst(name) < self.before.worst(name) and after < before
            if name in changed
            else after <= NO_WORSE * before + 0.01 or by_chance(self.before, self.after, name)
            for name in self.before.violations
            for before, after in [(worst_tail(self.before, name), worst_tail(self.after, name))]
        )

    @property
    def changed_channels(self) -> tuple[str, ...]:
        """Channels that step and whose loop changed."""
        loops = {
            verdict.loop
            for verdict in self.verdicts
            if any(p.name in verdict.parameters for p in self.tuned.changes)
        }
        return tuple(
            name for name in self.before.violations if ("place" if name == "north" else name) in loops
        )

    @property
    def margins_kept(self) -> bool:
        """Whether the margins of every loop that changed are no less than before, up to what is ample.

        Where they were less than what is accepted before, they must be accepted.
        """
        return all(after.lacking(before) <= 0.02 for before, after in self.tuned.margins.values())

    @property
    def held(self) -> bool:
        """Whether replay and envelope hold, and what changes is better with margins kept."""
        own = [verdict for verdict in self.verdicts if verdict.judged]
        inside = all(share.inside for share in self.reflight.shares if share.channel in {v.loop for v in own})
        return self.replay.held and inside and (self.better or not self.tuned.changes) and self.margins_kept

    def parameter_file(self) -> str:
        """The file to load: what changes, each with before, bounds and why."""
        names = self.generation or "of every generation from 4.0 on"
        title = f"From {Path(self.replay.source).name}; ArduSub {names} by name and unit; only what changes"
        text = changes_text(self.changes, title=title)
        stays = [f"# {verdict.loop} stays: {verdict.why}" for verdict in self.verdicts if not verdict.judged]
        return text + "".join(f"{line}\n" for line in stays)

    def files(self) -> dict[str, str | bytes]:
        """Files of the run directory by name, see `save`."""
        return {
            **self.replay.files(),
            "changes.param": self.parameter_file(),
            "ardusub.json": to_json(self.to_dict()),
            **self.report().files(),
        }

    def to_dict(self) -> dict[str, Any]:
        """Plain data, without the rows of the envelopes."""
        return {
            "source": self.replay.source,
            "held": self.held,
            "replay": self.replay.to_dict(),
            "identified": dict(self.identified),
            "parameters": dict(self.parameters),
            "assumed": list(self.assumed),
            "reflight": self.reflight.to_dict(),
            "loops": [asdict(verdict) for verdict in self.verdicts],
            "changes": [asdict(change) for change in self.changes],
            "margins": {
                loop: {"before": asdict(before), "after": asdict(after)}
                for loop, (before, after) in self.tuned.margins.items()
            },
            "missions": {
                name: {"before": list(self.before.row(name)), "after": list(self.after.row(name))}
                for name in self.before.violations
            },
            "flown": self.missions,
            "better": self.better,
            "margins_kept": self.margins_kept,
            "folders": [str(folder) for folder in self.folders],
        }


def worst_tail(missions: Missions, channel: str) -> float:
    """Mean violation of the worst tenth of the missions, s."""
    own = np.sort(missions.violations[channel])
    return float(own[-max(len(own) // 10, 1) :].mean())


def by_chance(before: Missions, after: Missions, channel: str) -> bool:
    """Whether the worst tenth of the missions, before or after, rises by no more than chance.

    The same missions fly before and after: the mean of their rises is less than 1.645 of its standard errors
    (Student's test, one-sided, 5 %), as of a single mission, or two, among twelve.
    """
    earlier, later = before.violations[channel], after.violations[channel]
    worst = np.argsort(np.maximum(earlier, later))[-max(len(earlier) // 10, 1) :]
    rises = (later - earlier)[worst]
    if len(rises) < 2 or not np.isfinite(rises).all():
        return False
    return bool(rises.mean() <= _CHANCE * rises.std(ddof=1) / math.sqrt(len(rises)))
