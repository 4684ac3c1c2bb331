"""`seatrial score`: how well a vehicle predicts recorded trials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from seatrial.base.errors import TrialError, VehicleError, nearest
from seatrial.cli.options import Drawn, shared

if TYPE_CHECKING:
    from seatrial.campaign.campaign import Campaign
    from seatrial.scoring.comparison import Comparison
    from seatrial.scoring.score import Score
    from seatrial.trial.trial import Trial

ColumnsFrom = Annotated[
    Path | None, typer.Option(help="Campaign file whose reader and column map the recordings follow.")
]


@dataclass(frozen=True)
class Scoring:
    """How a vehicle is judged, and beside what."""

    ahead: Annotated[float, typer.Option(min=0.01, help="Restart the simulation after this time, s.")] = 10.0
    free_run: Annotated[bool, typer.Option("--free-run", help="Never restart it.")] = False
    free: Annotated[
        str | None,
        typer.Option(
            metavar="AXES",
            help="Axes that are simulated; the others are replayed from the recording. Default: those that a"
            " stage of the campaign frees; XYZKMN without one.",
        ),
    ] = None
    against: Annotated[
        list[str] | None,
        typer.Option(
            metavar="VEHICLE|TABLE",
            help="Another vehicle, or a table of predictions (CSV or Parquet: time, channels with units), to"
            " be compared on the same windows; repeatable.",
        ),
    ] = None
    train: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TRIAL",
            help="A recording that the vehicle was identified from: baselines are fitted to it and judged"
            " beside the vehicle; repeatable.",
        ),
    ] = None
    own_stamps: Annotated[
        bool, typer.Option("--own-stamps", help="Compare at every sensor's own stamps, not on the time base.")
    ] = False

    def options(self, free: str, training: list[Trial]) -> dict[str, Any]:
        """Options of `seatrial.score` and `compare`, with the axes that are simulated."""
        from seatrial.base.channels import AXES

        return {
            "ahead_s": self.ahead,
            "free_run": self.free_run,
            "free": free,
            "measured": "".join(axis for axis in AXES if axis not in free),
            "own_stamps": self.own_stamps,
            "training": training,
        }


@shared
def score(
    vehicle: Annotated[str, typer.Argument(help="Vehicle file or built-in vehicle.")],
    trials: Annotated[
        list[str], typer.Argument(help="Recordings, or names of trials of the campaign.", metavar="TRIAL")
    ],
    columns_from: ColumnsFrom = None,
    scoring: Scoring = Scoring(),
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for figures (PNG), a trial each.")
    ] = None,
    output: Drawn = Drawn(),
) -> None:
    """Score a vehicle on trials: R2 and errors per channel, some seconds ahead again and again.

    With --against, which vehicle or table of predictions is better, and whether these trials can tell.

    Example: seatrial score vehicle.toml dive.csv --ahead 5
    """
    from seatrial._core import Vehicle
    from seatrial.base.channels import AXES
    from seatrial.base.report import Section
    from seatrial.campaign.campaign import Campaign
    from seatrial.cli.console import Code, check_axes, complain
    from seatrial.scoring.comparison import compare
    from seatrial.scoring.score import score as scored
    from seatrial.scoring.windows import Predictions, is_table

    if scoring.free is not None:
        check_axes(scoring.free, "--free")
    against = scoring.against or []
    vehicles = {
        label: Predictions.read(name) if name in against and is_table(name) else Vehicle.load(name)
        for label, name in _labels([vehicle, *against]).items()
    }
    campaign = None if columns_from is None else Campaign.load(columns_from)
    free = scoring.free or (campaign.problem().freed if campaign else "") or "".join(AXES)
    chosen = read_trials(trials, columns_from)
    training = read_trials(scoring.train, columns_from) if scoring.train else []
    # A baseline that has seen what it is judged on would always win.
    if both := {trial.source for trial in training} & {trial.source for trial in chosen}:
        raise TrialError(
            f"--train {min(both)}: it is scored, too; a baseline knows its training trials: name others"
        )
    options = scoring.options(free, training)
    # One vehicle is scored, several are compared on the same windows.
    result: Score | Comparison
    if len(vehicles) == 1:
        ((label, single),) = vehicles.items()
        result = scored(single, chosen, **options)
        scores, report = {label: result}, result.report(label)
    else:
        result = compare(vehicles, chosen, **options)
        scores, report = result.scores, result.report()
    # First what is broken, then what the vehicle has seen before.
    broken = [f"{trial.name}: {error}" for trial in chosen for error in trial.report.errors]
    sections = [Section(sentences=tuple(broken))]
    if campaign is not None and columns_from is not None:
        own = [trial for name, trial in zip(trials, chosen, strict=True) if name in campaign.trials]
        sections.append(Section(sentences=_seen(campaign, own, columns_from)))
    report = replace(report, sections=(*sections, *report.sections))
    drawn = None if out is None else partial(_drawn, scores, free, out, output.endings)
    output.show(result, report=report, draw=drawn)
    unscored = {label: row.unscored for label, row in scores.items()}
    if all(unscored.values()):
        for label, why in unscored.items():
            complain(f"{label}: no channel of {', '.join(trials)} could be scored: {why}")
        raise typer.Exit(Code.BAD_INPUT)


def _drawn(scores: Mapping[str, Score], free: str, folder: Path, endings: tuple[str, ...]) -> list[Path]:
    from seatrial.report.plot import gallery
    from seatrial.report.plot.trials import drawings

    return gallery(drawings(scores, free=free), folder, formats=endings)


def _seen(campaign: Campaign, trials: Sequence[Trial], file: Path) -> tuple[str, ...]:
    """What of the trials a vehicle knows that this campaign identified."""
    fitted = {name for stage in campaign.problem().stages for name in stage.trials}
    sentences = []
    for trial in trials:
        held = campaign.problem().held_out(trial.name)
        share = 1.0 - float(held.mean()) if trial.name in fitted and len(held) else 0.0
        if share > 0.0:
            sentences.append(
                f"{file} fits {100.0 * share:.0f} % of {trial.name}: only the rest tests a vehicle"
                " identified from it (see the report of identify)"
            )
    return tuple(sentences)


def _labels(names: list[str]) -> dict[str, str]:
    """Vehicles by what tells them apart: of a run directory's vehicle files, the directory."""
    from seatrial.scoring.windows import is_table

    labelled: dict[str, str] = {}
    for name in names:
        path = Path(name)
        folder = path.absolute().parent.name
        if path.name in ("vehicle.toml", "vehicle_stages.toml"):
            label = folder if path.name == "vehicle.toml" else f"{folder} stages"
        else:
            label = path.stem if path.suffix == ".toml" or is_table(name) else name
        label = name if label in labelled else label
        if name in labelled.values():
            raise VehicleError(f"--against {name!r}: the vehicle is given twice; name two that differ")
        labelled[label] = name
    return labelled


def read_trials(trials: list[str], columns_from: Path | None) -> list[Trial]:
    """Trials, each a file or a name that the campaign knows."""
    from seatrial.base.toml_file import twice
    from seatrial.cli.console import reading_progress

    if (path := twice(trials)) is not None:
        raise TrialError(
            f"TRIAL {path}: it is given twice, and counting it twice tells nothing; name it once"
        )
    if columns_from is None:
        from seatrial.trial.trial import Trial

        return [Trial.read(path, progress=reading_progress()) for path in trials]
    from seatrial.campaign.campaign import Campaign

    known = Campaign.load(columns_from).trials
    names = [name if name in known else Path(name).stem for name in trials]
    for path in trials:
        if path not in known and not Path(path).exists():
            raise TrialError(
                f"TRIAL {path}: expected a file, or a trial of {columns_from}{nearest(path, known)}"
            )
    files = {name: path for name, path in zip(names, trials, strict=True) if path not in known}
    campaign = Campaign.load(columns_from, trials=files, progress=reading_progress())
    return [campaign.trials[name] for name in names]
