"""Tunings whose searches and assessments are told, so that nothing is flown: what they are asked is kept."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial.base.run import RunDirectory
from seatrial.tuning import result as revert_gains
from seatrial.tuning import tuning_run
from seatrial.tuning.control_problem import ControlProblem, Group
from seatrial.tuning.result import Performance, StepPerformance, Tuning
from seatrial.tuning.search import GroupResult
from seatrial.tuning.step_trial import Rig, Samples
from seatrial.tuning.tuning_run import TuningRun

Found = Callable[[str, Mapping[str, float]], Mapping[str, float]]
Outside = Callable[[str, Mapping[str, float]], float]

TERMS = dict.fromkeys(("violation", "margin", "time", "roughness", "effort"), 0.0)
"""Parts of the cost of gains that lack nothing."""


@dataclass
class Search:
    """What the search of a group was given."""

    group: str
    rig: Rig
    samples: Samples
    seed: int
    start: dict[str, float]


@dataclass
class Asked:
    """What an assessment was given, by the names of its groups, the rig and the samples."""

    name: str
    groups: tuple[str, ...]
    rig: Rig
    samples: Samples


@dataclass
class Told:
    """A run whose searches find what is told, and whose groups are outside by what is told.

    Attributes
    ----------
    found
        Gains that the search of a group finds, of its name and the gains so far.
    outside_s
        Violation of a group by a drawn vehicle, of its name and all gains of the autopilot.
    given_away
        Shortfall of the margins that the search of a group brings about.
    """

    found: Found = lambda group, gains: {}
    outside_s: Outside = lambda group, gains: 0.0
    given_away: Mapping[str, float] = field(default_factory=dict)
    searches: list[Search] = field(default_factory=list)
    assessments: list[Asked] = field(default_factory=list)

    def search(
        self, plan: ControlProblem, group: Group, rig: Rig, samples: Samples, *, seed: int, **given: Any
    ) -> GroupResult:
        start = dict(given["start"])
        self.searches.append(Search(group.name, rig, samples, seed, start))
        gains = dict(self.found(group.name, start))
        after = TERMS | {"margin": self.given_away.get(group.name, 0.0)}
        return GroupResult(group.name, gains, TERMS, after, 1, 1.0, (), (), interrupted=False)

    def assess(
        self, plan: ControlProblem, name: str, rig: Rig, samples: Samples, **given: Any
    ) -> Performance:
        groups = given.get("only") or plan.groups
        self.assessments.append(Asked(name, tuple(group.name for group in groups), rig, samples))
        trials = []
        for group in groups:
            outside = self.outside_s(group.name, rig.autopilot.gains())
            for one in group.trials:
                # The vehicle itself is inside: it is one of the drawn ones that is not.
                figures = (0.0, outside, float(outside == 0.0), 1.0, 0.0, 1.0, 0.0)
                trials.append(StepPerformance(one.loop, "", one.speeds[0], 1.0, *figures))
        return Performance(name, rig.autopilot, tuple(trials), len(samples) - samples.nominal, {})

    def run(
        self,
        monkeypatch: pytest.MonkeyPatch,
        campaign: st.Campaign,
        plan: ControlProblem,
        directory: RunDirectory | None = None,
    ) -> Tuning:
        monkeypatch.setattr(tuning_run, "search_group", self.search)
        monkeypatch.setattr(tuning_run, "search_margins", lambda *_, **__: None)
        monkeypatch.setattr(ControlProblem, "followed", ())  # guidance stays what it is
        monkeypatch.setattr(tuning_run, "assess", self.assess)
        monkeypatch.setattr(revert_gains, "assess", self.assess)
        quiet = Performance("", plan.autopilot, (), 0, {})
        monkeypatch.setattr(tuning_run, "assess_without_noise", lambda *_: quiet)
        return TuningRun(plan, directory or RunDirectory(None), threads=1).run()


def values(samples: Samples, name: str = "X_uu") -> set[float]:
    """Of a coefficient of the drawn vehicles."""
    return set(np.asarray(samples.coefficients[name])[samples.nominal :].tolist())
