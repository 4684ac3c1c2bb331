"""A problem by hand: a vehicle, trials and the coefficients that are free.

One stage frees all of them on all trials, the joint estimate follows. The axes on which a free coefficient
acts are simulated; other axes are replayed where every trial recorded them and frozen elsewhere.

`as_campaign_file` is the campaign file that states the same: kept with the results, to read and to change.
Only what differs from the defaults is written. Trials that were given as tables stand under the name of
what they were read from.

Tests: ``tests/problem/test_by_hand.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any, Required, TypedDict

from pydantic import ValidationError

from seatrial.base.channels import AXES, CHANNELS
from seatrial.base.errors import CampaignError, nearest
from seatrial.problem.parameter import axes_of
from seatrial.problem.settings import Axes, Coefficient, Stage
from seatrial.trial.trial import Input, Trial
from seatrial.vehicle.actuators import actuator_groups

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.base.toml_file import Section
    from seatrial.bench_test.evaluate import BenchTest
    from seatrial.problem.settings import Anchor, JointSettings, TrialUse


Recorded = Any
"""A trial that was read, or what one is read from: a table (dict of columns, pandas or polars), or a file."""

Trials = Recorded | Sequence[Recorded] | Mapping[str, Recorded]
"""A trial or several, in a list or by name."""

Bounds = tuple[float, float]
"""Lower and upper bound, SI."""


class Asked(TypedDict, total=False):
    """What a problem by hand takes beside vehicle and trials, as of `seatrial.Problem`."""

    free: Required[str | Sequence[str] | Mapping[str, Bounds | None]]
    start: Mapping[str, float] | None
    hold_out: float | Trials
    axes: str | None
    channels: Sequence[str] | Mapping[str, float] | None
    input: Input | None
    segment_s: float
    joint: bool | JointSettings
    anchor: Anchor | None
    bench: BenchTest | None
    name: str | None
    seed: int


SOURCE = "identify"
"""What messages call a problem without a file."""


def fitted_and_judging(trials: Trials, hold_out: float | Trials) -> tuple[dict[str, Trial], dict[str, Trial]]:
    """Trials by name that are fitted, and those that only judge.

    Raises CampaignError: there is none, two share a name, or a trial is in both.
    """
    fitted = _named(trials, "trial")
    judging = {} if isinstance(hold_out, float | int) else _named(hold_out, "judging")
    if shared := sorted(set(fitted) & set(judging)):
        raise CampaignError(f"{SOURCE}: trial {shared[0]!r} is fitted and held out; leave it out of one")
    return fitted, judging


def stage_of(
    vehicle: Vehicle,
    fitted: Mapping[str, Trial],
    freed: dict[str, Coefficient],
    axes: str | None,
    channels: Sequence[str] | Mapping[str, float] | None,
    segment_s: float,
) -> Stage:
    """The one stage of a problem by hand, which frees these coefficients on all fitted trials.

    Raises CampaignError: a key holds what it may not.
    """
    simulated = axes or _axes(list(freed))
    recorded = set(CHANNELS[:6]).intersection(*(trial.channels for trial in fitted.values()))
    others = "".join(letter for letter in AXES if letter not in simulated)
    replayed = "".join(letter for letter in others if CHANNELS[AXES.index(letter)] in recorded)
    weights = channels if isinstance(channels, Mapping) else dict.fromkeys(channels or (), 1.0)
    try:
        return Stage(
            name="all",
            trials=tuple(fitted),
            axes=Axes(free=simulated, measured=replayed),
            segment_s=float(segment_s),
            coefficients=freed,
            channels={channel: float(weight) for channel, weight in weights.items()},
        )
    except ValidationError as error:
        raise _refused(error, "") from None


def _refused(error: ValidationError, where: str) -> CampaignError:
    """The first complaint as one sentence."""
    first = error.errors()[0]
    place = ".".join(str(part) for part in first["loc"])
    words = first["msg"].removeprefix("Value error, ")
    return CampaignError(": ".join(part for part in (SOURCE, where, place, words) if part))


def _named(trials: Trials, table: str) -> dict[str, Trial]:
    """Trials by name; files and tables are read, tables under this name and their number among several."""
    if isinstance(trials, Mapping) and all(map(_is_recorded, trials.values())):
        listed = [replace(_read(source, name), name=name) for name, source in trials.items()]
    elif _is_recorded(trials):
        listed = [_read(trials, table)]
    else:
        sources = list(trials) if isinstance(trials, Sequence) else [trials]
        label = "{}" if len(sources) == 1 else "{} {}"
        listed = [_read(source, label.format(table, k)) for k, source in enumerate(sources, 1)]
    if not listed:
        raise CampaignError(f"{SOURCE}: expected a trial or several, found none")
    named: dict[str, Trial] = {}
    for trial in listed:
        if trial.name in named:
            raise CampaignError(
                f"{SOURCE}: two trials are named {trial.name!r}; give each its own name, or a dict"
                " {name: trial}"
            )
        named[trial.name] = trial
    return named


def _is_table(source: Recorded) -> bool:
    """Whether something is a table: a dict of columns, or a pandas or polars frame."""
    return isinstance(source, Mapping) or hasattr(source, "columns")


def _is_recorded(source: Recorded) -> bool:
    return isinstance(source, Trial | str | Path) or _is_table(source)


def _read(source: Recorded, name: str) -> Trial:
    """Trial; a table has no name of its own and takes this one."""
    if isinstance(source, Trial):
        return source
    if not _is_recorded(source):
        raise CampaignError(
            f"{SOURCE}: trials: expected a trial, a table, a file, or several in a list or dict, found"
            f" {type(source).__name__}"
        )
    return Trial.read(source, name=name) if _is_table(source) else Trial.read(source)


def entries(
    vehicle: Vehicle, free: str | Sequence[str] | Mapping[str, Bounds | None], start: Mapping[str, float]
) -> dict[str, Coefficient]:
    """Entries of the freed coefficients by name, groups and patterns resolved.

    Raises CampaignError: the vehicle has no such coefficient, or a start value is of one that is not free.
    """
    present, info = vehicle.coefficients(), vehicle.coefficient_info()
    groups = actuator_groups(vehicle)
    wanted = free if isinstance(free, Mapping) else dict.fromkeys([free] if isinstance(free, str) else free)
    freed: dict[str, Coefficient] = {}
    for pattern, bounds in wanted.items():
        single = pattern in info or pattern.partition(".")[0] in groups
        # What is zero is not part of this model: a pattern leaves it out, its own name frees it.
        matching = [name for name in present if fnmatchcase(name, pattern) and present[name]]
        names = [pattern] if single else matching
        if not names:
            raise CampaignError(
                f"{SOURCE}: free: {vehicle.name} has no coefficient {pattern!r}{nearest(pattern, info)}"
            )
        for name in names:
            freed[name] = _entry(name, bounds, start.get(name))
    for name in start:
        if name not in freed:
            raise CampaignError(f"{SOURCE}: start: {name!r} is not free{nearest(name, freed)}")
    return freed


def _entry(name: str, bounds: Bounds | None, start: float | None) -> Coefficient:
    try:
        return Coefficient(
            bounds=None if bounds is None else (float(bounds[0]), float(bounds[1])),
            start=None if start is None else float(start),
        )
    except ValidationError as error:
        raise _refused(error, f"free: {name}") from None


def _axes(names: Sequence[str]) -> str:
    """Letters of the axes on which coefficients act; all where none is a force's own."""
    acted = {letter for name in names for letter in axes_of(name)}
    return "".join(letter for letter in AXES if letter in acted) or AXES


def share(hold_out: Any, trial: Trial) -> tuple[Bounds, ...]:
    """The last part of a trial as held out, where a share is asked for."""
    if not isinstance(hold_out, float | int) or hold_out == 0:
        return ()
    if not 0.0 < hold_out < 1.0:
        raise CampaignError(
            f"{SOURCE}: hold_out: expected a share from 0 to below 1, or trials; found {hold_out!r}"
        )
    first, last = float(trial.t[0]), float(trial.t[-1])
    return ((last - float(hold_out) * (last - first), last + trial.dt),)


def as_campaign_file(
    head: Mapping[str, Any],
    *,
    trials: Mapping[str, tuple[str, TrialUse]],
    stages: Sequence[Section],
    joint: Section | None,
    anchor: Section,
) -> str:
    """Text (TOML) of a campaign file that begins with the keys of a head: format, name, vehicle, seed.

    ``trials``: by name the file of a trial, or what it was read from, and how it is used.
    """
    import tomlkit

    table: dict[str, Any] = {
        **head,
        "trials": {name: _trial(*trial) for name, trial in trials.items()},
        "stages": [_given(stage) for stage in stages],
    }
    if joint is not None:
        table["polish"] = _given(joint)
    if known := _given(anchor):
        table["anchor"] = known
    return tomlkit.dumps(table)


def _given(section: Section) -> dict[str, Any]:
    """What of a section is not its default, as TOML holds it."""
    return section.model_dump(mode="json", exclude_defaults=True)


def _trial(file: str, use: TrialUse) -> dict[str, Any]:
    table: dict[str, Any] = {"file": file, "input": use.input}
    if use.hold_out:
        table["hold_out"] = True
    if use.hold_out_s:
        table["hold_out_s"] = [list(interval) for interval in use.hold_out_s]
    return table
