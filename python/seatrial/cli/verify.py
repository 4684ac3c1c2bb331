"""`seatrial verify`: a campaign and an autopilot, or a log, in; a verdict out.

`seatrial verify --log`: a campaign and the log of a mission in, a verdict out.

Tests: ``tests/verification/test_recorded_campaign.py``.

How a verification is shown on the command line: progress while it flies, tables and sentences after.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from seatrial.base.errors import CampaignError

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from seatrial.campaign.campaign import Campaign
    from seatrial.verification.campaign import VerifiedCampaign
    from seatrial.verification.comparison import AutopilotComparison
    from seatrial.verification.judgement import JudgedRequirement
    from seatrial.verification.verification import Verification

__all__ = ["draw", "gains_source", "print_verification", "refuse_beside", "verified", "verify", "verify_log"]


def verify(
    campaign: Annotated[Path, typer.Argument(help="Campaign file (TOML) with a table verification.")],
    run: Annotated[
        Path | None,
        typer.Option(
            "--run",
            help="Run directory of `seatrial identify`, or a vehicle; runs/NAME where that is one, else the"
            " campaign's own vehicle.",
        ),
    ] = None,
    autopilot: Annotated[
        Path | None,
        typer.Option(
            "--autopilot",
            help="Autopilot file or run directory of `seatrial tune`; runs/NAME-tuned where that is one, else"
            " the campaign's own autopilot.",
        ),
    ] = None,
    runs: Annotated[
        int | None, typer.Option(min=1, help="Number of missions instead of the campaign's.")
    ] = None,
    mission: Annotated[
        list[Path] | None,
        typer.Option("--mission", metavar="FILE", help="Mission file instead of the campaign's; repeatable."),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(
            metavar="LOG",
            help="Judge a recorded mission instead of flying any: a run directory of `seatrial fly`, a"
            " recording, or a trial of the campaign.",
        ),
    ] = None,
    reference: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="LOG",
            help="With --log: a log on which the model is known to hold, instead of the campaign's trials;"
            " repeatable.",
        ),
    ] = None,
    compare: Annotated[
        bool, typer.Option("--compare", help="Fly the same draws with the campaign's start autopilot too.")
    ] = False,
    replay: Annotated[
        int | None,
        typer.Option(min=0, metavar="NUMBER", help="Fly one mission again, with its log, and nothing else."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Run directory; runs/NAME-verified or runs/NAME-mission-NUMBER."),
    ] = None,
    junit: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the JUnit XML to this file as well.")
    ] = None,
    resume: Annotated[
        bool, typer.Option(help="Reuse missions that an earlier run flew from the same inputs.")
    ] = True,
    threads: Annotated[int | None, typer.Option(min=1, help="Threads; all processors by default.")] = None,
    figures: Annotated[bool, typer.Option(help="Write figures (PNG and PDF) into the run directory.")] = True,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Verify an autopilot by many missions of drawn vehicles in drawn water, with noise and failures.

    With --log: does the model still hold on a recorded mission, what is suspected, what did the mission hold.

    The exit code is 0 when every requirement is held (and the model still valid), 1 when one failed or is
    undecided, 2 for bad input.
    Ctrl-C keeps the missions flown; the same command goes on from there.
    """
    from seatrial.base.errors import CampaignError
    from seatrial.base.run import check_writable
    from seatrial.campaign.campaign import Campaign
    from seatrial.cli.console import output, print_json
    from seatrial.cli.tune import fitted_source
    from seatrial.verification.campaign import verified_campaign

    loaded = Campaign.load(campaign)
    if log is not None:
        refuse_beside({"--runs": runs, "--compare": compare, "--replay": replay, "--junit": junit})
        verify_log(
            loaded,
            fitted_source(loaded, run),
            log,
            autopilot=autopilot,
            missions=mission or [],
            references=reference or [],
            out=out,
            figures=figures,
            json=json,
        )
        return
    if reference:
        raise CampaignError("--reference: it belongs to a recorded mission; give that with --log")
    source, gains = fitted_source(loaded, run), gains_source(loaded, autopilot)
    prepared = verified_campaign(loaded, source, gains, runs=runs, missions=mission or None, compare=compare)
    if not json:
        flies, steers = source or loaded.vehicle.name, gains or prepared.flights.autopilot.name
        output().print(f"Vehicle: {flies}. Autopilot: {steers}.", soft_wrap=True, markup=False)
    if replay is not None:
        _replay(prepared, replay, out, figures=figures, json=json)
        return
    folder = out or Path("runs") / f"{loaded.name}-verified"
    check_writable(folder)
    if junit is not None:
        _refuse_place(junit)
    found = verified(prepared, folder, threads=threads, resume=resume, quiet=json)
    written = draw(found, folder) if figures and not found.interrupted else []
    if junit is not None:
        _write(junit, found.junit())
    if json:
        print_json(found.to_dict() | {"run_directory": str(folder), "figures": [str(p) for p in written]})
    else:
        _print(found, folder, written)
    if found.interrupted:
        raise typer.Exit(130)
    if not found.held:
        raise typer.Exit(1)


def gains_source(campaign: Campaign, given: Path | None) -> Path | str | None:
    """The autopilot that is verified: what was given, else the campaign's tuned one, else nothing."""
    if given is not None:
        return given if given.exists() else str(given)
    beside = Path("runs") / f"{campaign.name}-tuned" / "autopilot.toml"
    return beside if beside.is_file() else None


def verified(
    prepared: VerifiedCampaign,
    folder: Path | None,
    *,
    threads: int | None = None,
    resume: bool = True,
    quiet: bool = False,
) -> Verification:
    """Verification of a campaign into a run directory, with progress on standard error."""
    from seatrial.cli.console import search_progress
    from seatrial.verification.verify import run_verification

    with search_progress("first missions", quiet=quiet) as progress:
        return run_verification(prepared, run_dir=folder, progress=progress, resume=resume, threads=threads)


def draw(found: Verification, folder: Path, *, formats: tuple[str, ...] = ("png",)) -> list[Path]:
    """Paths of the figures of a verification in its run directory."""
    from seatrial.report.plot.verification import verification_gallery

    return verification_gallery(found, folder / "figures", formats=formats)


def _replay(prepared: VerifiedCampaign, number: int, out: Path | None, *, figures: bool, json: bool) -> None:
    """One mission flown again into a run directory of its own."""
    from seatrial.cli.console import list_figures, output, print_json
    from seatrial.report.plot.flight_errors import flight_gallery
    from seatrial.verification.verification import reserve

    flight = prepared.flights.replay(number)
    default = Path("runs") / f"{prepared.campaign.name}-mission-{number}"
    folder = flight.save(out or default)
    written = sorted(flight_gallery(flight, folder / "figures")) if figures else []
    if json:
        print_json(
            flight.to_dict() | {"run_directory": str(folder), "figure_files": [str(p) for p in written]}
        )
        return
    console = output()
    for line in flight.sentences():
        console.print(f"- {line}", soft_wrap=True, markup=False)
    figures_of_it = prepared.flights.fly([number]).figures
    for one in prepared.requirements:
        judged = one.judge(figures_of_it)
        said = "held" if judged.held[0] else "not held"
        size = reserve(float(judged.reserve[0]), judged.unit)
        left = "" if size in ("held", "failed") else f", reserve {size}"
        console.print(f"- {one.name}: {one.holds}: {said}{left}", soft_wrap=True, markup=False)
    console.print(
        f"Mission {number} in {folder}: flight.json, flight.parquet, summary.txt and the inputs",
        soft_wrap=True,
        markup=False,
    )
    list_figures(console, written)


def _print(found: Verification, folder: Path, written: list[Path]) -> None:
    from seatrial.cli.console import list_figures, output

    console = output()
    print_verification(console, found)
    console.print(
        f"Results in {folder}: verification.json, summary.txt, junit.xml, worst_runs.json, missions.parquet"
        " and the inputs",
        soft_wrap=True,
        markup=False,
    )
    list_figures(console, written)


def _refuse_place(path: Path) -> None:
    """Refuse a file that cannot be written, before anything flies."""
    from tempfile import TemporaryFile

    from seatrial.base.errors import SeatrialError, reason

    if path.is_dir():
        raise SeatrialError(f"--junit {path}: expected a file, found a folder; name a file in it")
    above = next(folder for folder in path.absolute().parents if folder.exists())
    if not above.is_dir():
        raise SeatrialError(f"--junit {path}: {above} is a file, not a folder; choose another place")
    try:
        TemporaryFile(dir=above).close()
    except OSError as error:
        raise SeatrialError(
            f"--junit {path}: cannot be written ({reason(error)}); choose another place"
        ) from None


def _write(path: Path, text: str) -> None:
    """Write a file that was asked for beside the run directory."""
    from seatrial.base.atomic_write import write_atomic

    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, text.encode())


_LONGEST_NAME = 80


def refuse_beside(given: Mapping[str, Any]) -> None:
    """Refuse options that ask for flights, by name, where a log is judged."""
    for name, value in given.items():
        if value is not None and value is not False:
            raise CampaignError(
                f"{name}: --log judges a recorded mission and flies none; leave one of them out"
            )


def verify_log(
    campaign: Campaign,
    fit: Path | str | None,
    log: Path,
    *,
    autopilot: Path | None,
    missions: Sequence[Path],
    references: Sequence[Path],
    out: Path | None,
    figures: bool,
    json: bool,
) -> None:
    """Judge a log into a run directory, print the verdict, exit with 1 where it is not held."""
    from seatrial.base.run import check_writable
    from seatrial.cli.console import list_figures, output, print_json
    from seatrial.report.plot.mission_log import log_verdict_gallery
    from seatrial.verification.mission_log.campaign import verify_campaign_log

    if len(missions) > 1:
        raise CampaignError(
            f"--mission: a log is one mission, found {len(missions)}; give the one that was flown"
        )
    folder = out or Path("runs") / f"{campaign.name}-log-{_safe(log)}"
    check_writable(folder)
    found, judged = verify_campaign_log(
        campaign,
        campaign.vehicle if fit is None else fit,
        log,
        autopilot=autopilot,
        mission=missions[0] if missions else None,
        references=references,
    )
    found.save(folder, campaign=campaign, source=log)
    written = sorted(log_verdict_gallery(found, folder / "figures")) if figures else []
    if json:
        data = found.to_dict() | {"run_directory": str(folder), "figure_files": [str(p) for p in written]}
        print_json(data)
    else:
        console = output()
        part = "" if judged.span is None else f", {judged.span[0]:g} to {judged.span[1]:g} s, held out"
        console.print(
            f"Vehicle: {fit or campaign.vehicle.name}. Log: {log}{part}.", soft_wrap=True, markup=False
        )
        console.print(found.summary(), soft_wrap=True, markup=False)
        console.print(f"VERDICT: {found.outcome}", markup=False, style="bold")
        files = "verdict.json, summary.txt and the inputs"
        console.print(f"Results in {folder}: {files}", soft_wrap=True, markup=False)
        list_figures(console, written)
    if not found.held:
        raise typer.Exit(1)


def _safe(log: Path) -> str:
    name = log.stem if log.is_file() else log.name or log.resolve().name
    return "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in name)[:_LONGEST_NAME]


_WIDE = 110  # columns that the requirements need beside what must hold

_FIGURES = {
    "cross_track_p95_m": "median cross-track p95, m",
    "vertical_p95_m": "median vertical p95, m",
    "energy_wh": "median energy, Wh",
    "duration_s": "median duration, s",
    "travel_per_s": "median command travel, 1/s",
}


def print_verification(console: Console, found: Verification) -> None:
    """Print verdict, requirements, causes, worst missions and comparison."""
    from seatrial.verification.verification import again, headline, time_sentence

    narrow = console.width < _WIDE
    console.print(_requirements(found, narrow=narrow))
    for one in found.requirements if narrow else ():
        console.print(f"{one.requirement.name}: {one.requirement.holds}", soft_wrap=True, markup=False)
    if narrow:
        console.print()
    if any(len(one.by_mission) > 1 for one in found.requirements):
        console.print(_missions(found))
    if any(one.worst for one in found.requirements):
        console.print(_worst(found))
    if found.comparison is not None:
        for made in _comparisons(found.comparison):
            console.print(made)
        console.print(_medians(found.comparison))
    for one in found.requirements:
        for line in _sentences(one):
            console.print(f"- {line}", soft_wrap=True, markup=False)
    for note in found.notes:
        console.print(f"- {note}", soft_wrap=True, markup=False)
    console.print(f"- {time_sentence(found)}", soft_wrap=True, markup=False)
    console.print(f"- {again(found)}", soft_wrap=True, markup=False)
    console.print(headline(found), soft_wrap=True, markup=False, style="bold")


def _requirements(found: Verification, *, narrow: bool) -> Table:
    """Verdicts; what must hold stands below the table where a terminal is too narrow for it."""
    from seatrial.cli.console import table
    from seatrial.statistics.proportions import share

    rows = []
    for one in found.requirements:
        lower, upper = one.found.interval
        rows.append([
            one.requirement.name,
            one.requirement.holds,
            share(one.requirement.allowed),
            f"{one.found.failures}",
            f"{share(lower, 'down')} to {share(upper, 'up')}",
            share(one.found.at_most, "up"),
            one.verdict,
        ])
    sure = f"{100.0 * found.flights.table.confidence:g} %"
    flights = found.flights
    title = f"{flights.autopilot.name} on {flights.fitted.vehicle.name}: {len(found.flown)} missions"
    head = ["requirement", "holds", "allowed", "failures", f"{sure} interval", "at most", "verdict"]
    if narrow:
        return _folding(table(title, head[:1] + head[2:], [row[:1] + row[2:] for row in rows]))
    made = table(title, head, rows)
    made.columns[1].justify = "left"
    return made


def _folding(made: Table) -> Table:
    """The same table, with long names on several lines instead of cut off."""
    made.columns[0].no_wrap = False
    for column in made.columns:
        column.overflow = "fold"
    return made


def _missions(found: Verification) -> Table:
    from seatrial.cli.console import table

    titles = found.flights.titles
    rows = [
        [
            one.requirement.name,
            *(
                f"{part.failures} of {part.runs}" if (part := one.by_mission.get(title)) else "-"
                for title in titles
            ),
        ]
        for one in found.requirements
    ]
    return table("Failures by mission", ["requirement", *titles], rows)


def _worst(found: Verification) -> Table:
    from seatrial.cli.console import table
    from seatrial.verification.verification import reserve

    rows = []
    for one in found.requirements:
        for run in one.worst[:3]:
            figures = run.figures
            rows.append([
                one.requirement.name,
                str(run.number),
                run.mission,
                reserve(run.reserve, one.judgement.unit),
                str(figures["ending"]),
                _number(figures["cross_track_p95_m"], 2),
                _number(figures["vertical_p95_m"], 2),
                _number(figures["clearance_m"], 1),
                _number(figures["duration_s"], 0),
            ])
    head = ["requirement", "number", "mission", "reserve", "ending", "across", "vertical", "clear", "time"]
    one_mission = len(found.flights.titles) == 1
    dropped = [
        k
        for k, name in enumerate(head)
        if (name == "mission" and one_mission) or (name == "clear" and all(row[k] == "-" for row in rows))
    ]
    kept = [k for k in range(len(head)) if k not in dropped]
    return _folding(
        table(
            "Worst missions (lengths in m, time in s; across and vertical: p95)",
            [head[k] for k in kept],
            [[row[k] for k in kept] for row in rows],
        )
    )


def _comparisons(found: AutopilotComparison) -> Iterator[Table]:
    """The verified autopilot against each other one."""
    from seatrial.cli.console import table
    from seatrial.statistics.proportions import share

    verified, *others = found.autopilots
    head = ["requirement", "verified\nfails", "other\nfails", "only\nverified", "only\nother", "p", "better"]
    for other in others:
        rows = []
        for name, failures in verified.failures.items():
            pair = found.pair(name, other.name)
            rows.append([
                name,
                share(failures.estimate),
                share(other.failures[name].estimate),
                str(pair.only_verified),
                str(pair.only_other),
                f"{pair.corrected:.2g}",
                {"verified": "verified", None: "not shown"}.get(pair.better, "other"),
            ])
        title = f"Against {other.name}, on the same {found.runs} draws (McNemar's exact test, Holm)"
        made = _folding(table(title, head, rows))
        for column in made.columns[1:]:
            column.no_wrap = True
        yield made


def _medians(found: AutopilotComparison) -> Table:
    from seatrial.cli.console import table

    rows = [
        [label, *(f"{one.figures[name]:.4g}" for one in found.autopilots)]
        for name, label in _FIGURES.items()
        if name in found.autopilots[0].figures
    ]
    return table("Figures on the same draws", ["figure", *(one.name for one in found.autopilots)], rows)


def _sentences(one: JudgedRequirement) -> list[str]:
    """Verdict of a requirement and what its failures go with, where there is something to say."""
    said = [] if one.verdict == "held" else [f"{one.requirement.name} {one.sentence}."]
    if one.found.failures:
        said += [f"{one.requirement.name}: {cause}." for cause in one.named_causes[:3]]
    return said


def _number(value: float, decimals: int) -> str:
    return f"{round(value, decimals) + 0.0:.{decimals}f}" if math.isfinite(value) else "-"
