"""A campaign without a file: a vehicle, trials and the coefficients that are free.

One stage frees all of them on all trials, the joint estimate follows. The axes on which a free coefficient
acts are simulated; other axes are replayed where every trial recorded them and frozen elsewhere. The
campaign is the same object that a file gives, and its text states what a file would.

Tests: ``tests/identification/test_identify_without_file.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seatrial.base.channels import AXES, CHANNELS
from seatrial.base.errors import CampaignError, nearest
from seatrial.base.toml_file import loaded
from seatrial.campaign.campaign import Campaign
from seatrial.campaign.parameters import axes_of
from seatrial.trial.trial import Input, Trial
from seatrial.vehicle.actuators import actuator_groups

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.bench_test.result import BenchTest

Trials = Trial | str | Path | Sequence[Trial | str | Path] | Mapping[str, Trial | str | Path]
"""A trial or several: trials that were read, or files with canonical columns."""

Bounds = tuple[float, float]
"""Lower and upper bound, SI."""

_SOURCE = "identify"


def campaign_from_trials(
    vehicle: Vehicle | str | Path,
    trials: Trials,
    *,
    free: str | Sequence[str] | Mapping[str, Bounds | None],
    start: Mapping[str, float] | None = None,
    hold_out: float | Trials = 0.2,
    axes: str | None = None,
    channels: Sequence[str] | Mapping[str, float] | None = None,
    input: Input | None = None,
    segment_s: float = 10.0,
    joint: bool = True,
    bench: BenchTest | None = None,
    name: str | None = None,
    seed: int = 0,
) -> Campaign:
    """Campaign of one stage and the joint estimate. Parameters are those of `seatrial.identify`.

    Raises
    ------
    CampaignError
        A coefficient is unknown or has no bounds, a trial lacks a channel, two trials share a name.
    TrialError, VehicleError
        A file cannot be read.
    """
    import tomlkit

    from seatrial._core import Vehicle

    fitted = _named(trials)
    judging = {} if isinstance(hold_out, float | int) else _named(hold_out)
    if shared := sorted(set(fitted) & set(judging)):
        raise CampaignError(f"{_SOURCE}: trial {shared[0]!r} is fitted and held out; leave it out of one")
    known = loaded(Vehicle, vehicle) if bench is None else bench.vehicle
    freed = _freed(known, free, start or {})
    simulated = axes or _axes(list(freed))
    recorded = [
        channel for channel in CHANNELS[:6] if all(channel in one.channels for one in fitted.values())
    ]
    others = "".join(letter for letter in AXES if letter not in simulated)
    stage: dict[str, Any] = {
        "name": "all",
        "trials": list(fitted),
        "axes": {
            "free": simulated,
            "measured": "".join(letter for letter in others if CHANNELS[AXES.index(letter)] in recorded),
        },
        "segment_s": float(segment_s),
        "coefficients": freed,
    }
    if channels is not None:
        weights = dict(channels) if isinstance(channels, Mapping) else dict.fromkeys(channels, 1.0)
        stage["channels"] = {channel: float(weight) for channel, weight in weights.items()}
    table = {
        "format": 1,
        "name": name or known.name,
        "vehicle": known.name,
        "seed": seed,
        "trials": {
            label: {"file": one.source, "input": input or _input(known, one)}
            | ({"hold_out": True} if label in judging else _share(hold_out, one))
            for label, one in (fitted | judging).items()
        },
        "stages": [stage],
    }
    if joint:
        table["polish"] = {}
    return Campaign.from_toml(
        tomlkit.dumps(table), source=_SOURCE, trials=fitted | judging, vehicle=known, bench=bench
    )


def _named(trials: Trials) -> dict[str, Trial]:
    """Trials by name, files read."""
    if isinstance(trials, Mapping):
        return {name: replace(_read(one), name=name) for name, one in trials.items()}
    listed = [trials] if isinstance(trials, Trial | str | Path) else list(trials)
    if not listed:
        raise CampaignError(f"{_SOURCE}: expected a trial or several, found none")
    found: dict[str, Trial] = {}
    for one in map(_read, listed):
        if one.name in found:
            raise CampaignError(
                f"{_SOURCE}: two trials are named {one.name!r}; give each its own name, or a dict"
                " {name: trial}"
            )
        found[one.name] = one
    return found


def _read(one: Trial | str | Path) -> Trial:
    return one if isinstance(one, Trial) else Trial.read(one)


def _freed(
    vehicle: Vehicle, free: str | Sequence[str] | Mapping[str, Bounds | None], start: Mapping[str, float]
) -> dict[str, dict[str, Any]]:
    """Entries of the coefficients by name, groups and patterns resolved."""
    present, info = vehicle.coefficients(), vehicle.coefficient_info()
    groups = actuator_groups(vehicle)
    wanted = free if isinstance(free, Mapping) else dict.fromkeys([free] if isinstance(free, str) else free)
    found: dict[str, dict[str, Any]] = {}
    for pattern, bounds in wanted.items():
        single = pattern in info or pattern.partition(".")[0] in groups
        # What is zero is not part of this model: a pattern leaves it out, its own name frees it.
        names = (
            [pattern] if single else [one for one in present if fnmatchcase(one, pattern) and present[one]]
        )
        if not names:
            raise CampaignError(
                f"{_SOURCE}: free: {vehicle.name} has no coefficient {pattern!r}{nearest(pattern, info)}"
            )
        for one in names:
            found[one] = {} if bounds is None else {"bounds": [float(bounds[0]), float(bounds[1])]}
    for one, value in start.items():
        if one not in found:
            raise CampaignError(f"{_SOURCE}: start: {one!r} is not free{nearest(one, found)}")
        found[one]["start"] = float(value)
    return found


def _axes(names: Sequence[str]) -> str:
    """Letters of the axes on which coefficients act; all where none is a force's own."""
    acted = {letter for one in names for letter in axes_of(one)}
    return "".join(letter for letter in AXES if letter in acted) or AXES


def _input(vehicle: Vehicle, trial: Trial) -> Input:
    from seatrial.trial.windows import default_input

    return default_input(vehicle, trial)


def _share(hold_out: Any, trial: Trial) -> dict[str, Any]:
    """The last part of a trial as held out, where a share is asked for."""
    if not isinstance(hold_out, float | int) or hold_out == 0:
        return {}
    if not 0.0 < hold_out < 1.0:
        raise CampaignError(
            f"{_SOURCE}: hold_out: expected a share from 0 to below 1, or trials; found {hold_out!r}"
        )
    first, last = float(trial.t[0]), float(trial.t[-1])
    return {"hold_out_s": [[last - float(hold_out) * (last - first), last + trial.dt]]}
