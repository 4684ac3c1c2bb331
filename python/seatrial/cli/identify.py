"""`seatrial identify` and `bench`: a vehicle from a campaign's trials, its thrust from a bench."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from seatrial.base.errors import CampaignError, SeatrialError, nearest
from seatrial.base.files import no_file
from seatrial.cli.options import Computing, Output, end, shared

if TYPE_CHECKING:
    from seatrial.campaign.campaign import Campaign
    from seatrial.campaign.file import LockedAxes
    from seatrial.identification.identification import Identification
    from seatrial.identification.leave_one_out import LeaveOneOut


@dataclass(frozen=True)
class Changed:
    """What an identification does otherwise than its campaign says."""

    trial: Annotated[
        list[str] | None,
        typer.Option("--trial", metavar="NAME=FILE", help="Another recording for a trial; repeatable."),
    ] = None
    locked_axes: Annotated[
        str | None,
        typer.Option(
            metavar="frozen|measured",
            help="Mode of the axes that a stage does not free, instead of the campaign's; runs/NAME-MODE.",
        ),
    ] = None
    rounds: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=0,
            help="Rounds in which proposals of the residual analysis are tried; 0 for none. By default the"
            " campaign's proposal_rounds.",
        ),
    ] = None


@shared
def identify(
    campaign: Annotated[Path, typer.Argument(help="Campaign file (TOML).")],
    changed: Changed = Changed(),
    leave_one_out: Annotated[
        bool,
        typer.Option(
            "--leave-one-out",
            help="Afterwards identify again without each trial, and predict it; results in a second folder,"
            " RUN-leave-one-out.",
        ),
    ] = False,
    computing: Computing = Computing(),
    output: Output = Output(),
) -> None:
    """Identify a vehicle from the trials of a campaign.

    Ctrl-C keeps the best so far; the same command goes on with the stages that are not finished.

    Example: seatrial identify campaign.toml
    """
    from seatrial.base.run import check_writable
    from seatrial.campaign.campaign import Campaign
    from seatrial.cli.console import note, reading_progress, reported

    given = _replacements(changed.trial or [])
    loaded = Campaign.load(campaign, trials=given, progress=reading_progress(quiet=output.json))
    for added in _added(loaded, given):
        if not output.json:
            note(f"Trial {added} is not in {campaign}: it is added, held out, and only judges.")
    name = loaded.name
    if changed.locked_axes is not None:
        loaded, name = loaded.with_locked_axes(_mode(changed.locked_axes)), f"{name}-{changed.locked_axes}"
    folder = output.out or Path("runs") / name
    without = folder.with_name(f"{folder.name}-leave-one-out")
    if leave_one_out:  # refused now, not after hours of identification
        check_writable(without, "leave one out")
    fit = run_identification(loaded, folder, computing=computing, rounds=changed.rounds, quiet=output.json)
    files = "vehicle.toml, identification.json, summary.txt, Parquet tables"
    drawn = partial(draw, fit, folder, output.endings)
    # For people each answer stands as soon as it is known; JSON is one object at the end.
    if not output.json:
        output.show(fit, results=f"Results in {folder}: {files}", draw=drawn)
    left_out: LeaveOneOut | None = None
    if leave_one_out and not fit.interrupted:
        left_out = _leave_one_out(fit, without, computing, quiet=output.json)
        if not output.json:
            files = "leave_one_out.json, Parquet tables, summary.txt"
            results = "" if left_out.interrupted else f"Leave one out in {without}: {files}"
            output.show(left_out, results=results)
    if output.json:
        facts: dict[str, Any] = {"run_directory": str(folder)}
        facts |= {} if left_out is None else {"leave_one_out": left_out.to_dict()}
        output.show(fit, facts, draw=drawn)
    if not fit.interrupted:
        runs = [folder] if left_out is None else [folder, without]
        reported(output.page, [run for run in runs if run.is_dir()], quiet=output.json)
    end(interrupted=fit.interrupted or (left_out is not None and left_out.interrupted))


def run_identification(
    campaign: Campaign,
    folder: Path,
    *,
    computing: Computing = Computing(),
    rounds: int | None = None,
    quiet: bool = False,
) -> Identification:
    """Identification of a campaign into a run directory, with progress on standard error."""
    problem = campaign.problem()
    if rounds is not None and problem.joint is not None:
        problem = problem.with_joint(problem.joint.model_copy(update={"proposal_rounds": rounds}))
    elif rounds:
        raise CampaignError(
            f"--rounds {rounds}: {campaign.source} has no [polish]; add it: proposals change the joint"
            " estimate"
        )
    with computing.work(folder, "reading the trials", quiet=quiet) as work:
        return problem.identify(work=work)


def draw(fit: Identification, folder: Path, endings: tuple[str, ...] = ("png",)) -> list[Path]:
    """Paths of the figures of an identification in its run directory; of none that was interrupted."""
    from seatrial.report.plot import gallery

    if fit.interrupted or not endings:
        return []
    if "svg" in endings:  # a page is asked for, which draws the trials itself
        from seatrial.report.page.evidence import save_trials

        save_trials(fit, folder)
    return gallery(fit, folder / "figures", formats=endings)


def _mode(text: str) -> LockedAxes:
    """Mode of locked axes that was asked for."""
    if text == "frozen":
        return "frozen"
    if text == "measured":
        return "measured"
    raise CampaignError(
        f"--locked-axes {text!r}: expected frozen or measured{nearest(text, ('frozen', 'measured'))}"
    )


def _replacements(entries: list[str]) -> dict[str, str]:
    """Trial names and files from NAME=FILE."""
    trials: dict[str, str] = {}
    for entry in entries:
        name, equals, path = entry.partition("=")
        if not equals or not name or not path:
            raise CampaignError(f"--trial {entry!r}: expected NAME=FILE, for example --trial surge=log.csv")
        if wrong := no_file(Path(path)):
            raise CampaignError(f"--trial {entry}: {wrong}; correct the path")
        trials[name] = path
    return trials


def _added(campaign: Campaign, given: dict[str, str]) -> list[str]:
    """Names of given trials that the campaign has not; one that is nearly that of a trial is refused."""
    known = campaign.file.trials
    new = [name for name in given if name not in known]
    for name in new:
        near = nearest(name, known)
        if near.endswith("?"):
            raise CampaignError(
                f"--trial {name}={given[name]}: {campaign.source} has no trial {name!r}{near} For one more"
                " trial that only judges, give a name that is not so near"
            )
    return new


def _leave_one_out(fit: Identification, folder: Path, computing: Computing, *, quiet: bool) -> LeaveOneOut:
    """The identified campaign without each trial in turn, with progress on standard error."""
    from seatrial.cli.console import search_progress
    from seatrial.identification.leave_one_out import leave_one_out

    with search_progress("reading the trials", quiet=quiet) as progress:
        return leave_one_out(
            fit.problem,
            sigma=fit.sigma,
            run_dir=folder,
            progress=progress,
            resume=computing.resume,
            threads=computing.threads,
        )


@shared
def bench(
    bench_file: Annotated[Path, typer.Argument(help="Bench file: pulls, steps and how they are fitted.")],
    write: Annotated[
        Path | None, typer.Option(help="Write the vehicle file with the results here; it must not exist.")
    ] = None,
    in_place: Annotated[
        bool,
        typer.Option("--in-place", help="Replace the bench file's vehicle file by the one with the results."),
    ] = False,
    output: Output = Output(),
) -> None:
    """Fit thrust and motor of every tested group, say how sure they are, write them into the vehicle file.

    Example: seatrial bench bench.toml --in-place
    """
    from seatrial.bench_test.evaluate import bench as evaluate
    from seatrial.cli.console import reported
    from seatrial.report.results.bench_test import WRITE

    _check_place(write, in_place)
    test = evaluate(bench_file)
    if in_place and test.vehicle_path is None:
        raise SeatrialError(
            f"--in-place: {test.before.name} is a built-in vehicle without a file; give --write FILE"
        )
    if (write is not None or in_place) and not test.notes:
        raise SeatrialError(f"{bench_file}: nothing could be written: {'; '.join(test.warnings)}")
    # The run directory has the vehicle file in any case; where else it goes was asked for.
    folder = test.save(output.out or Path("runs") / f"bench-{test.file.name}")
    written = None
    if write is not None:
        written = test.save_vehicle(write)
    elif in_place and test.vehicle_path is not None:
        written = test.save_vehicle(test.vehicle_path, replace=True)
    report = test.report()
    results = f"Results in {folder}: bench.json, summary.txt, points.csv, vehicle.toml"
    if written is not None:
        check = f"seatrial check {written}"
        results += f"\nVehicle file with the results: {written} ({check})"
        report = replace(report, next_step=report.next_step.replace(WRITE, f"run {check}"))
    elif test.notes:
        results += "\nNothing was written into a vehicle file: give --write FILE or --in-place"
    output.show(
        test,
        {"run_directory": str(folder), "vehicle_file": written and str(written)},
        report=report,
        results=results,
        draw=partial(output.draw, test, folder),
    )
    reported(output.page, [folder], quiet=output.json)


def _check_place(write: Path | None, in_place: bool) -> None:
    """Refuse a vehicle file that cannot be written."""
    if write is None:
        return
    if in_place:
        raise SeatrialError("--write and --in-place: give one of them")
    if write.exists():
        raise SeatrialError(f"--write {write}: this file exists and is not overwritten; give another name")
    if not write.absolute().parent.is_dir():
        raise SeatrialError(
            f"--write {write}: there is no folder {write.parent}; make it or give another name"
        )
