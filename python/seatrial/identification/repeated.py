"""Recordings that stand in a campaign under several names: they are no independent data.

Two trials hold the same recording if their files have the same content, or if the same samples were read from
them. Parts that share no time are independent all the same. Held by ``tests/check/test_check_campaign.py``.
"""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError
from seatrial.base.report import listed
from seatrial.base.run import sha256
from seatrial.estimation.inputs import trained

if TYPE_CHECKING:
    from seatrial.problem.problem import Problem
    from seatrial.trial.trial import Trial

_SAME = 0.49  # of the longer interval: samples this close in time are the same


def repeated_sentences(problem: Problem) -> tuple[str, ...]:
    """Warnings of trials that are fitted to the same samples.

    Raises
    ------
    CampaignError
        A trial holds out samples that another one is fitted to.
    """
    fitted, warnings = set(trained(problem)), list[str]()
    for names in _alike(problem):
        used = [name for name in names if name in fitted]
        for name in names:
            _refuse_fitted(problem, name, [other for other in used if other != name])
        twice = [pair for pair in combinations(used, 2) if _share(problem, *pair)]
        if same := [name for name in used if any(name in pair for pair in twice)]:
            warnings.append(
                f"WARNING: trials {listed(same)} hold the same recording, which counts {len(same)} times:"
                f" deviations come out up to {np.sqrt(len(same)):.2g} times too small; keep one of them"
            )
    return tuple(warnings)


def _refuse_fitted(problem: Problem, name: str, fitted: list[str]) -> None:
    """Refuse a trial that holds out what one of those with its recording is fitted to."""
    for other in fitted:
        if _meet(_times(problem, name, held_out=True), _times(problem, other, held_out=False)):
            raise CampaignError(
                f"{problem.source}: trial {name!r} holds out what trial {other!r} is fitted to: both are"
                " of one recording, so that its score would judge nothing; give another one, or hold the same"
                " times out of both with hold_out_s"
            )


def _share(problem: Problem, first: str, other: str) -> bool:
    """Whether two trials with the same recording are fitted to the same times."""
    return _meet(_times(problem, first, held_out=False), _times(problem, other, held_out=False))


def _times(problem: Problem, name: str, *, held_out: bool) -> tuple[Array, float]:
    """Times (n,) in s from the recording's first on that are held out, or not; and their interval."""
    trial = problem.trials[name]
    return trial.t[problem.held_out(name) == held_out] - trial.t[0], trial.dt


def _meet(first: tuple[Array, float], other: tuple[Array, float]) -> bool:
    """Whether some time of one lies at a time of the other."""
    (a, step), (b, wide) = first, other
    if not len(a) or not len(b):
        return False
    after = np.searchsorted(b, a)
    near = [np.abs(b[np.clip(k, 0, len(b) - 1)] - a) for k in (after - 1, after)]
    return bool(np.min(near) < _SAME * max(step, wide))


def _alike(problem: Problem) -> list[list[str]]:
    """Names of the trials with the same recording, where there are several."""
    groups: list[tuple[set[str], list[str]]] = []
    for name in problem.trials:
        keys = {_content(problem.trials[name])} | ({key} if (key := problem.file_hash(name)) else set())
        same = [group for group in groups if group[0] & keys]
        groups = [group for group in groups if group not in same]
        groups.append((keys.union(*(own for own, _ in same)), [*(n for _, of in same for n in of), name]))
    return [names for _, names in groups if len(names) > 1]


def _content(trial: Trial) -> str:
    """SHA-256 of what was recorded, whatever the trial's name and first time."""
    signals = (
        trial.t - trial.t[0],
        trial.observed,
        *(trial.commands[name] for name in sorted(trial.commands)),
    )
    return sha256(b"".join(np.round(signal, 9).tobytes() for signal in signals))
