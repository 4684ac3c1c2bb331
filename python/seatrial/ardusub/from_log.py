"""From a log of ArduSub to parameters of its own: replay, identify, fly again, tune, verify, write.

One function, `tune_log`. Each step is an ordinary one of seatrial: the project of the import
and the run of the identification lie in folders beside the run's own, and can be edited and run by
themselves. What is finished is kept, so that an interrupted run goes on. Held by
``tests/ardusub/test_from_log.py``.
"""

from __future__ import annotations

import inspect
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.ardusub.axes import AxisVerdict, MarginModel, Margins, axis_verdicts
from seatrial.ardusub.comparison import Replay
from seatrial.ardusub.course import Course, Rig, check_rig, known_parameters, logged_courses
from seatrial.ardusub.log_replay import replay
from seatrial.ardusub.parameters import (
    GENERATIONS,
    Change,
    ParameterFile,
    changes_text,
    generation,
    in_metres,
    of_generation,
)
from seatrial.ardusub.reflight import Envelope, Reflight, Share, refly
from seatrial.ardusub.tuning import (
    STEPS,
    Missions,
    Tuned,
    draw_cases,
    fly_missions,
    rise_of,
    slew_of,
    step_courses,
    tune_parameters,
)
from seatrial.base.errors import TrialError
from seatrial.base.run import RunDirectory, RunResult, run_facts, sha256, to_json
from seatrial.base.work import HERE, Clock, Progress, Work, takes, tell, within
from seatrial.logs.log import open_log

if TYPE_CHECKING:
    from seatrial.identification.fitted import Fitted
    from seatrial.identification.identification import Identification


@dataclass(frozen=True)
class LogTuningSettings:
    """How many missions judge, and what differs by more than chance."""

    #: Standard errors of a mean by which a difference may come of chance: 5 % on one side.
    chance_deviations: float = 1.645
    #: Violation after over before up to which a loop that nothing changed is no worse.
    no_worse_ratio: float = 1.05
    judging_missions: int = 1000  #: Missions that judge the gains.
    search_missions: int = 64  #: Missions of the search: each candidate flies them.


SETTINGS = LogTuningSettings()


@dataclass(frozen=True, eq=False, repr=False)
class LogTuning(RunResult):
    """What a log of ArduSub said, and the parameters that come of it."""

    replay: Replay  #: Whether the law explains the log, and the parameters found.
    #: First line of the identification, and coefficients with standard deviations by name.
    identified: Mapping[str, Any]
    #: Those that the vehicle flew with: found from the log, else of the file, else ArduSub's defaults.
    parameters: Mapping[str, float]
    assumed: tuple[str, ...]  #: Names of those that are defaults because neither log nor file has them.
    reflight: Reflight  #: The log's mission flown again.
    verdicts: tuple[AxisVerdict, ...]  #: Which loops can be judged.
    tuned: Tuned  #: Parameters before and after.
    #: `before`, `after`: missions with either; the same where nothing changes.
    before: Missions
    after: Missions
    rise_s: float  #: By then a step of yaw is to have risen, see `seatrial.ardusub.tuning.corridors_of`.
    missions: int  #: How many.
    generation: str  #: Of the firmware in whose names changes are written.
    facts: Mapping[str, Any]
    folders: tuple[Path, Path]  #: Project and identification, beside the run directory.

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
            else after <= SETTINGS.no_worse_ratio * before + 0.01 or by_chance(self.before, self.after, name)
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
    return bool(rises.mean() <= SETTINGS.chance_deviations * rises.std(ddof=1) / math.sqrt(len(rises)))


@takes(work=Work)
def tune_log(
    log: str | Path,
    *,
    out: str | Path,
    parameters: ParameterFile | None = None,
    vehicle: str | Path | None = None,
    missions: int = SETTINGS.judging_missions,
    seed: int = 0,
    work: Work = HERE,
) -> LogTuning:
    """Parameters of ArduSub from one of its logs, in a run directory.

    Parameters
    ----------
    log : str or Path
        DataFlash log, ``.BIN``, of 4.7 or later.
    out : str or Path
        Run directory; the project lies in ``OUT-project``, the identification in ``OUT-identified``.
    parameters : ParameterFile, optional
        The vehicle's own: for what the log does not tell, and for the generation in whose names changes are
        written.
    vehicle : str or Path, optional
        Vehicle file or built-in vehicle to begin with; by the frame when omitted.
    missions : int
        With which before and after are judged.
    seed : int
    work : st.Work
        Threads of the core, whether to reuse what an earlier run finished from the same inputs, and whom to
        inform.

    Raises
    ------
    TrialError
        The log cannot be read, lacks what the chain needs, or the parameters are of ArduSub 3.5.
    CampaignError, VehicleError
        The vehicle cannot be identified from it.
    """
    clock = Clock()
    folder, content = Path(out), sha256(Path(log).read_bytes())
    title = "" if parameters is None else generation(parameters.values, parameters.source)
    if title == "3.5" and parameters is not None:
        names = ", ".join(sorted(set(parameters.values) & set(GENERATIONS["3.5"])))
        raise TrialError(
            f"{parameters.source}: expected parameters of ArduSub 4.0 or later, found those of 3.5"
            f" ({names}); its controllers are others: take the file that the vehicle writes"
        )
    with RunDirectory(folder, "ardusub", resume=work.resume) as run:
        tell(work, 0.0, f"replaying {Path(log).name}")
        replayed = replay(log, parameters=parameters)
        flown, assumed = _flown_with(replayed, parameters)
        courses = logged_courses(open_log(log), flown)
        if replayed.frame is None:
            raise TrialError(
                f"{log}: no frame of ArduSub explains the pulses, so that the cascade cannot fly;"
                " --replay-only shows what the log tells"
            )
        identification, fitted = _identified(Path(log), folder, vehicle, work)
        coupling = None if parameters is None else parameters.values.get("MOT_FV_CPLNG_K")
        rig = Rig(*replayed.frame, coupling=coupling)
        check_rig(fitted.vehicle, rig)
        covariance = np.asarray(fitted.covariance).tolist()
        inputs = (
            content,
            sorted(flown.items()),
            fitted.vehicle.to_toml(),
            missions,
            seed,
            covariance,
            _sources(),
        )
        kept = _Kept(run, sha256(repr(inputs)))
        reflight = kept.part(
            "reflight",
            lambda: refly(
                fitted, rig, courses, flown, hold_out_s=_held_out(identification), seed=seed,
                work=within(work, 0.3, 0.45),
            ),
            _reflight_to, _reflight_of,
        )  # fmt: skip
        verdicts = axis_verdicts(identification, fitted, seed=seed)
        tuned, before, after, rise = _tuned(
            kept, fitted, reflight, flown, verdicts, courses[0], (missions, seed, work)
        )
        facts = run_facts(
            "ardusub", Path(log).stem, clock=clock, seed=seed, options={"missions": missions},
            inputs={Path(log).name: content},
        )  # fmt: skip
        result = LogTuning(
            replayed, _summary(identification), flown, assumed, reflight, verdicts, tuned, before, after,
            rise, missions, title, facts, _beside(folder),
        )  # fmt: skip
        tell(work, 1.0, "done")
        run.publish(facts, result.files())
    return result


def _sources() -> str:
    """Hash of the modules whose results are kept: another version does not find them."""
    # By what is imported from them: a module that is renamed or merged is followed.
    makers = (logged_courses, refly, axis_verdicts, tune_parameters, draw_cases)
    modules = sorted({Path(inspect.getfile(maker)) for maker in makers})
    return sha256("".join(module.read_text(encoding="utf-8") for module in modules))


def _beside(folder: Path) -> tuple[Path, Path]:
    return folder.with_name(f"{folder.name}-project"), folder.with_name(f"{folder.name}-identified")


def _flown_with(
    replayed: Replay, parameters: ParameterFile | None
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Parameters that the vehicle flew with, and the names of those that are assumed."""
    from seatrial._core import ardusub_defaults

    # A bound is no value: what the vehicle flew with is the file's, or the default.
    replayed_values = {
        each.name: each.value for each in replayed.found if not each.bound and math.isfinite(each.value)
    }
    given = {} if parameters is None else in_metres(parameters)
    whole = known_parameters({**given, **replayed_values})
    values = {name: float(np.asarray(value)) for name, value in whole.items()}
    return values, tuple(name for name in ardusub_defaults() if name not in values)


def _identified(
    log: Path, folder: Path, vehicle: str | Path | None, work: Work
) -> tuple[Identification, Fitted]:
    """The vehicle identified from the log, in folders beside the run's."""
    from seatrial.campaign.campaign import Campaign
    from seatrial.identification.fitted import Fitted
    from seatrial.intake.imported import import_logs

    project, identified = _beside(folder)
    imports, identifies = within(work, 0.02, 0.1), within(work, 0.1, 0.3)
    import_logs(
        log, out=project, vehicle=vehicle, force=project.exists(),
        progress=lambda share, words: tell(imports, share, f"import: {words}"),
    )  # fmt: skip
    campaign = Campaign.load(project / "campaign.toml")

    def progress(state: Progress) -> None:
        tell(identifies, state.fraction, f"identification: {state.what}")

    identification = campaign.identify(work=replace(work, run_dir=identified, progress=progress))
    if identification.interrupted:
        raise KeyboardInterrupt
    return identification, Fitted.of(identification)


def _held_out(identification: Identification) -> tuple[float, float] | None:
    """First to last time that was held out, s; None where nothing was."""
    name = next(iter(identification.problem.trials))
    t = identification.problem.trials[name].t[identification.problem.held_out(name)]
    return (float(t[0]), float(t[-1])) if len(t) else None


def _summary(identification: Identification) -> dict[str, Any]:
    """First line of an identification, and its coefficients as plain data."""
    fields = ("start", "estimate", "sigma", "at_bound")
    coefficients = {
        own.name: {field: getattr(own, field) for field in fields} for own in identification.coefficients
    }
    return {"good": identification.report().good, "coefficients": coefficients}


@dataclass(frozen=True)
class _Kept:
    """Parts of the run that are kept as soon as they are finished."""

    run: RunDirectory
    inputs: str

    def part(
        self, name: str, make: Callable[[], Any], to: Callable[[Any], Any], of: Callable[[Any], Any]
    ) -> Any:
        earlier = self.run.finished(name, self.inputs)
        if earlier is not None:
            return of(earlier)
        made = make()
        # What comes back from the file is what is used: an interrupted run gives the same numbers.
        plain = json.loads(to_json(to(made)))
        self.run.keep(name, self.inputs, plain)
        return of(plain)


def _tuned(
    kept: _Kept,
    fitted: Fitted,
    reflight: Reflight,
    flown: Mapping[str, float],
    verdicts: Sequence[AxisVerdict],
    course: Course,
    how: tuple[int, int, Work],
) -> tuple[Tuned, Missions, Missions, float]:
    """Parameters tuned, and missions that the search never saw, before and after."""
    missions, seed, work = how
    rig, period = reflight.rig, course.period_s
    rise, slew = rise_of(fitted, rig, flown, period_s=period), slew_of(flown)
    loops = {"north" if verdict.loop == "place" else verdict.loop for verdict in verdicts if verdict.judged}
    # The search steps what it can change; all loops are judged.
    own = tuple(name for name in STEPS if name in loops) or STEPS
    sought, courses = (step_courses(names, rise, period_s=period, slew_deg_s=slew) for names in (own, STEPS))
    voltage = float(np.mean(course.targets[:, 18]))
    model = MarginModel(fitted, rig, period_s=period, voltage_v=voltage, seed=seed)
    tuned = kept.part(
        "tuned",
        lambda: tune_parameters(
            model, sought, flown, verdicts, seed=seed, work=within(work, 0.45, 0.75),
            cases=draw_cases(fitted, reflight.wander, SETTINGS.search_missions, seed=seed + 1),
        ),
        asdict, _tuned_of,
    )  # fmt: skip
    cases = draw_cases(fitted, reflight.wander, missions, seed=seed + 2)

    def judged(name: str, values: Mapping[str, float], begin: float) -> Missions:
        def make() -> Missions:
            stage, what = within(work, begin, begin + 0.12), f"{missions} missions {name}"
            return fly_missions(fitted, rig, courses, values, cases=cases, work=stage, what=what)

        missed: Missions = kept.part(name, make, Missions.to_dict, Missions.of_dict)
        return missed

    before = judged("before", flown, 0.75)
    return tuned, before, judged("after", tuned.after, 0.87) if tuned.changes else before, rise


def _reflight_to(reflight: Reflight) -> dict[str, Any]:
    rows = [
        {
            "course": envelope.course, "channel": envelope.channel, "unit": envelope.unit,
            **{name: np.asarray(getattr(envelope, name), float).round(6).tolist()
               for name in ("t", "measured", "lower", "upper", "middle", "held_out")},
        }
        for envelope in reflight.envelopes
    ]  # fmt: skip
    shares = [asdict(share) for share in reflight.shares]
    return {
        "rig": asdict(reflight.rig), "wander": reflight.wander.tolist(), "current": reflight.current.tolist(),
        "envelopes": rows, "shares": shares,
    }  # fmt: skip


def _reflight_of(data: Mapping[str, Any]) -> Reflight:
    rig: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in data["rig"].items()
    }
    envelopes = tuple(
        Envelope(
            course=row["course"], channel=row["channel"], unit=row["unit"],
            held_out=np.array(row["held_out"], float) > 0.5,
            **{name: np.array(row[name], float) for name in ("t", "measured", "lower", "upper", "middle")},
        )
        for row in data["envelopes"]
    )  # fmt: skip
    shares = tuple(Share(**_with_nan(share)) for share in data["shares"])
    return Reflight(Rig(**rig), np.array(data["wander"]), np.array(data["current"]), envelopes, shares)


def _with_nan(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row of JSON, which writes what is not a number as null."""
    return {name: math.nan if value is None else value for name, value in row.items()}


def _tuned_of(data: Mapping[str, Any]) -> Tuned:
    changes = tuple(
        Change(change["name"], change["before"], change["after"], change["why"], tuple(change["bounds"]))
        for change in data["changes"]
    )
    margins = {
        loop: (Margins(**before), Margins(**after)) for loop, (before, after) in data["margins"].items()
    }
    return Tuned(data["before"], data["after"], changes, margins, data["evaluations"])
