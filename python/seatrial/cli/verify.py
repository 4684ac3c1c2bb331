"""`seatrial verify` and `verify-log`: a verdict on an autopilot by missions, on a model by a log.

Tests: ``tests/cli/test_cli_verify.py``, ``tests/verification/test_recorded_campaign.py``.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from seatrial.base.file_names import file_name
from seatrial.cli.options import Computing, Output, shared
from seatrial.cli.report import reported

if TYPE_CHECKING:
    from seatrial.campaign.campaign import Campaign
    from seatrial.verification.scenario import Scenario
    from seatrial.verification.verification import Verification

CampaignFile = Annotated[Path, typer.Argument(help="Campaign file (TOML) with a table verification.")]

Run = Annotated[
    Path | None,
    typer.Option(
        "--run",
        help="Run directory of `seatrial identify`, or a vehicle; runs/NAME where that is one, else the"
        " campaign's own vehicle.",
    ),
]

AutopilotFile = Annotated[
    Path | None,
    typer.Option(
        "--autopilot",
        help="Autopilot file or run directory of `seatrial tune`; runs/NAME-tuned where that is one, else"
        " the campaign's own autopilot.",
    ),
]

Missions = Annotated[
    list[Path] | None,
    typer.Option("--mission", metavar="FILE", help="Mission file instead of the campaign's; repeatable."),
]

Navigation = Annotated[
    str | None,
    typer.Option(
        metavar="sensors|filter",
        help="What the autopilot uses, instead of the campaign's: what the sensors show, or the estimate of"
        " a navigation filter.",
    ),
]

JUnit = Annotated[Path | None, typer.Option(metavar="FILE", help="Write the JUnit XML to this file as well.")]


@shared
def verify(
    campaign: CampaignFile,
    run: Run = None,
    autopilot: AutopilotFile = None,
    runs: Annotated[
        int | None, typer.Option(min=1, help="Number of missions instead of the campaign's.")
    ] = None,
    mission: Missions = None,
    navigation: Navigation = None,
    compare: Annotated[
        bool, typer.Option("--compare", help="Fly the same draws with the campaign's start autopilot too.")
    ] = False,
    replay: Annotated[
        int | None,
        typer.Option(min=0, metavar="NUMBER", help="Fly one mission again, with its log, and nothing else."),
    ] = None,
    junit: JUnit = None,
    computing: Computing = Computing(),
    output: Output = Output(),
) -> None:
    """Verify an autopilot by many missions of drawn vehicles in drawn water, with noise and failures.

    Example: seatrial verify campaign.toml --run runs/mine --autopilot runs/mine-tuned

    The exit code is 0 when every requirement is held, 1 when one failed or is undecided, 2 for bad input.
    Ctrl-C keeps the missions flown; the same command goes on from there.
    """
    from seatrial.base.run import check_writable
    from seatrial.campaign.verification import others_of
    from seatrial.cli.console import answer, print_json

    check_junit(junit, {"the campaign": campaign, "the vehicle": run, "the autopilot": autopilot}, mission)
    loaded, gains, scenario = asked(
        campaign, run, autopilot, quiet=output.json, runs=runs, missions=mission, navigation=navigation
    )
    if replay is not None:
        _replay(scenario, replay, output)
        return
    folder = output.out or Path("runs") / f"{loaded.name}-verified"
    check_writable(folder, "verification")
    verification = verified(
        scenario, folder, compare=others_of(loaded, gains, compare), computing=computing, quiet=output.json
    )
    write_junit(junit, verification.junit())

    def drawn() -> list[Path]:
        from seatrial.report.plot import gallery

        if verification.interrupted:
            return []
        return gallery(verification, folder / "figures", formats=output.endings)

    if output.json:
        figures = [str(path) for path in drawn()]
        print_json(verification.to_dict() | {"run_directory": str(folder), "figures": figures})
    else:
        files = "verification.json, summary.txt, junit.xml, worst_runs.json, missions.parquet and the inputs"
        results = f"Results in {folder}: {files}"
        answer(verification.report(), verbose=output.verbose, results=results, draw=drawn)
    if verification.interrupted:
        raise typer.Exit(130)
    reported(output.page, [folder], quiet=output.json)
    if not verification.held:
        raise typer.Exit(1)


@shared
def verify_log(
    campaign: Annotated[Path, typer.Argument(help="Campaign file (TOML).")],
    log: Annotated[
        Path,
        typer.Argument(
            help="Run directory of `seatrial fly`, a recording, or the name of a trial of the campaign."
        ),
    ],
    run: Run = None,
    autopilot: Annotated[
        Path | None, typer.Option("--autopilot", help="Autopilot that flew, where it is not beside the log.")
    ] = None,
    mission: Annotated[
        Path | None,
        typer.Option(
            "--mission", metavar="FILE", help="Mission that was flown, where it is not beside the log."
        ),
    ] = None,
    reference: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="LOG",
            help="A log on which the model is known to hold, instead of the campaign's trials; repeatable.",
        ),
    ] = None,
    junit: JUnit = None,
    output: Output = Output(),
) -> None:
    """Judge a recorded mission: does the model still hold, what is suspected, what did the mission hold.

    Example: seatrial verify-log campaign.toml runs/today

    The exit code is 0 when the model is still valid and every requirement is held, 1 when not or when the
    log cannot judge the model, 2 for bad input.
    """
    from seatrial.base.run import check_writable
    from seatrial.campaign.campaign import Campaign
    from seatrial.campaign.verification import verify_campaign_log
    from seatrial.cli.console import answer, print_json, reading_progress
    from seatrial.cli.streams import note
    from seatrial.cli.tune import fitted_source

    loaded = Campaign.load(campaign, progress=reading_progress(quiet=output.json))
    read = {"the campaign": campaign, "the vehicle": run, "the autopilot": autopilot, "the log": log}
    check_junit(junit, read, None if mission is None else [mission])
    fit = fitted_source(loaded, run)
    folder = output.out or Path("runs") / f"{loaded.name}-log-{_safe(log)}"
    check_writable(folder, "log verdict")
    verdict, judged = verify_campaign_log(
        loaded,
        loaded.vehicle if fit is None else fit,
        log,
        autopilot=autopilot,
        mission=mission,
        references=reference or [],
    )
    verdict.save(folder, problem=loaded.problem(), source=log)
    write_junit(junit, verdict.junit())

    def drawn() -> list[Path]:
        from seatrial.report.plot import gallery

        return sorted(gallery(verdict, folder / "figures", formats=output.endings))

    if output.json:
        figures = [str(path) for path in drawn()]
        print_json(verdict.to_dict() | {"run_directory": str(folder), "figures": figures})
    else:
        part = "" if judged.span is None else f", {judged.span[0]:g} to {judged.span[1]:g} s, held out"
        note(f"Vehicle: {fit or loaded.vehicle.name}. Log: {log}{part}.")
        results = f"Results in {folder}: verdict.json, junit.xml, summary.txt and the inputs"
        answer(verdict.report(), verbose=output.verbose, results=results, draw=drawn)
    reported(output.page, [folder], quiet=output.json)
    if not verdict.held:
        raise typer.Exit(1)


def asked(
    file: Path, run: Path | None, autopilot: Path | None, *, quiet: bool, missions: Any = None, **changes: Any
) -> tuple[Campaign, Path | str | None, Scenario]:
    """Campaign, autopilot that was given and scenario of a verb; a note on what flies, unless quiet."""
    from seatrial.campaign.campaign import Campaign
    from seatrial.cli.console import reading_progress
    from seatrial.cli.streams import note
    from seatrial.cli.tune import fitted_source

    campaign = Campaign.load(file, progress=reading_progress(quiet=quiet))
    source, gains = fitted_source(campaign, run), gains_source(campaign, autopilot)
    scenario = campaign.scenario(source, gains, missions=missions or None, **changes)
    if not quiet:
        flies, steers = source or campaign.vehicle.name, gains or scenario.flights.autopilot.name
        note(f"Vehicle: {flies}. Autopilot: {steers}.")
    return campaign, gains, scenario


def gains_source(campaign: Campaign, given: Path | None) -> Path | str | None:
    """The autopilot that is verified: what was given, else the campaign's tuned one, else nothing."""
    if given is not None:
        return given if given.exists() else str(given)
    beside = Path("runs") / f"{campaign.name}-tuned" / "autopilot.toml"
    return beside if beside.is_file() else None


def check_junit(junit: Path | None, read: dict[str, Any], missions: list[Path] | None) -> None:
    """Refuse a file of JUnit XML that cannot be written or would replace an input."""
    from seatrial.base.file_names import check_place

    if junit is not None:
        inputs = read | {f"mission {path}": path for path in missions or ()}
        check_place(junit, "--junit", endings=(".xml",), inputs=inputs, folder_made=True)


def write_junit(path: Path | None, text: str) -> None:
    """Write a file that was asked for beside the run directory."""
    from seatrial.base.atomic_write import write_atomic

    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, text.encode())


def verified(
    scenario: Scenario,
    folder: Path | None,
    *,
    compare: Any = None,
    computing: Computing = Computing(),
    quiet: bool = False,
) -> Verification:
    """Verification of a scenario into a run directory, with progress on standard error."""
    from seatrial.verification.verify import verify

    with computing.work(folder, "first missions", quiet=quiet) as work:
        return verify(scenario, compare=compare, work=work)


def _replay(scenario: Scenario, number: int, output: Output) -> None:
    """One mission flown again into a run directory of its own."""
    from seatrial.base.report import Section
    from seatrial.cli.console import answer, print_json
    from seatrial.report.plot import gallery
    from seatrial.report.results.verification import reserve

    flight = scenario.flights.replay(number)
    folder = flight.save(output.out or Path("runs") / f"{scenario.name}-mission-{number}")

    def drawn() -> list[Path]:
        return sorted(gallery(flight, folder / "figures", formats=output.endings))

    if output.json:
        figures = [str(path) for path in drawn()]
        print_json(flight.to_dict() | {"run_directory": str(folder), "figures": figures})
        reported(output.page, [folder], quiet=True)
        return
    metrics = scenario.flights.fly([number]).metrics
    lines = []
    for requirement in scenario.requirements:
        judged = requirement.judge(metrics)
        size = reserve(float(judged.reserve[0]), judged.unit)
        left = "" if size in ("held", "failed") else f", robustness {size}"
        held = "held" if judged.held[0] else "not held"
        lines.append(f"{requirement.name}: {requirement.holds}: {held}{left}")
    results = f"Mission {number} in {folder}: flight.json, flight.parquet, summary.txt and the inputs"
    report = flight.report(sections=(Section("Requirements", tuple(lines)),))
    answer(report, verbose=output.verbose, results=results, draw=drawn)
    reported(output.page, [folder])


def _safe(log: Path) -> str:
    name = log.stem if log.is_file() else log.name or log.resolve().name
    return file_name(name)
