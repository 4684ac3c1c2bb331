"""`seatrial verify`, `rare`, `falsify`, `boundary` and `verify-log`: an autopilot and a model judged.

Missions of drawn vehicles judge an autopilot, a survey looks for its failures, a log judges the model. Tests:
``tests/cli/test_cli_verify.py``, ``tests/cli/test_cli_rare.py``, ``tests/verification/test_boundary.py``,
``tests/verification/test_recorded_campaign.py``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Protocol, TypeVar

import typer

from seatrial.base.errors import CampaignError
from seatrial.base.files import file_name
from seatrial.cli.options import Computing, Output, Run, Threads, end, shared
from seatrial.cli.tune import fitted_source

if TYPE_CHECKING:
    from seatrial.base.run import Kind
    from seatrial.base.work import Work
    from seatrial.campaign.campaign import Campaign
    from seatrial.verification.scenario import Scenario
    from seatrial.verification.verify import Verification

CampaignFile = Annotated[Path, typer.Argument(help="Campaign file (TOML) with a table verification.")]

Runs = Annotated[int | None, typer.Option(min=1, help="Number of missions instead of the campaign's.")]

Requirements = Annotated[
    list[str] | None,
    typer.Option("--requirement", metavar="NAME", help="This requirement, not all; repeatable."),
]


@dataclass(frozen=True)
class Judged:
    """What is judged: vehicle, autopilot, missions and navigation, where they are not the campaign's."""

    run: Run = None
    autopilot: Annotated[
        Path | None,
        typer.Option(
            "--autopilot",
            help="Autopilot file or run directory of `seatrial tune`; runs/NAME-tuned where that is one, else"
            " the campaign's own autopilot.",
        ),
    ] = None
    mission: Annotated[
        list[Path] | None,
        typer.Option("--mission", metavar="FILE", help="Mission file instead of the campaign's; repeatable."),
    ] = None
    navigation: Annotated[
        str | None,
        typer.Option(
            metavar="sensors|filter",
            help="What the autopilot uses, instead of the campaign's: what the sensors show, or the estimate"
            " of a navigation filter.",
        ),
    ] = None

    def scenario(
        self, file: Path, *, quiet: bool, runs: int | None = None
    ) -> tuple[Campaign, Path | str | None, Scenario]:
        """Campaign, autopilot that was given and scenario; a note on what flies, unless quiet."""
        from seatrial.campaign.campaign import Campaign
        from seatrial.cli.console import note, reading_progress

        campaign = Campaign.load(file, progress=reading_progress(quiet=quiet))
        source, gains = fitted_source(campaign, self.run), gains_source(campaign, self.autopilot)
        scenario = campaign.scenario(
            source, gains, missions=self.mission or None, navigation=self.navigation, runs=runs
        )
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


@dataclass(frozen=True)
class JUnit:
    """A file of JUnit XML beside the run directory."""

    junit: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the JUnit XML to this file as well.")
    ] = None

    def check(self, read: dict[str, Any], missions: list[Path] | None) -> None:
        """Refuse a file that cannot be written or would replace an input."""
        from seatrial.base.files import check_place

        if self.junit is not None:
            inputs = read | {f"mission {path}": path for path in missions or ()}
            check_place(self.junit, "--junit", endings=(".xml",), inputs=inputs, folder_made=True)

    def write(self, text: str) -> None:
        """Write it where it was asked for."""
        from seatrial.base.files import write_atomic

        if self.junit is not None:
            self.junit.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(self.junit, text.encode())


@shared
def verify(
    campaign: CampaignFile,
    judged: Judged = Judged(),
    runs: Runs = None,
    compare: Annotated[
        bool, typer.Option("--compare", help="Fly the same draws with the campaign's start autopilot too.")
    ] = False,
    replay: Annotated[
        int | None,
        typer.Option(min=0, metavar="NUMBER", help="Fly one mission again, with its log, and nothing else."),
    ] = None,
    xml: JUnit = JUnit(),
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

    read = {"the campaign": campaign, "the vehicle": judged.run, "the autopilot": judged.autopilot}
    xml.check(read, judged.mission)
    loaded, gains, scenario = judged.scenario(campaign, quiet=output.json, runs=runs)
    # One mission again needs no run of a thousand.
    if replay is not None:
        _replay(scenario, replay, output)
        return
    folder = output.out or Path("runs") / f"{loaded.name}-verified"
    check_writable(folder, "verification")
    verification = verified(
        scenario, folder, compare=others_of(loaded, gains, compare), computing=computing, quiet=output.json
    )
    # An interrupted verification leaves what a machine asked for, too.
    xml.write(verification.junit())
    files = "verification.json, summary.txt, junit.xml, worst_runs.json, missions.parquet and the inputs"
    output.show_run(verification, folder, files, page=not verification.interrupted)
    end(interrupted=verification.interrupted, held=verification.held)


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
    from seatrial.cli.console import reported
    from seatrial.report.results.verification import reserve

    flight = scenario.flights.replay(number)
    folder = flight.save(output.out or Path("runs") / f"{scenario.name}-mission-{number}")
    metrics = scenario.flights.fly([number]).metrics
    lines = []
    for requirement in scenario.requirements:
        verdict = requirement.judge(metrics)
        size = reserve(float(verdict.reserve[0]), verdict.unit)
        left = "" if size in ("held", "failed") else f", robustness {size}"
        held = "held" if verdict.held[0] else "not held"
        lines.append(f"{requirement.name}: {requirement.holds}: {held}{left}")
    output.show(
        flight,
        {"run_directory": str(folder)},
        report=flight.report(sections=(Section("Requirements", tuple(lines)),)),
        results=f"Mission {number} in {folder}: flight.json, flight.parquet, summary.txt and the inputs",
        draw=lambda: sorted(output.draw(flight, folder / "figures")),
    )
    reported(output.page, [folder], quiet=output.json)


_Result = TypeVar("_Result", covariant=True)


class _Strategy(Protocol[_Result]):
    """What looks for the failures of a scenario."""

    def survey(self, scenario: Scenario, work: Work) -> _Result: ...


def _surveyed(
    strategy: _Strategy[_Result],
    scenario: Scenario,
    folder: Path,
    kind: Kind,
    computing: Computing,
    output: Output,
) -> _Result:
    """What a strategy finds, into a run directory of a kind, with progress on standard error."""
    from seatrial.base.run import check_writable

    check_writable(folder, kind)
    with computing.work(folder, "first missions", quiet=output.json) as work:
        return strategy.survey(scenario, work)


@shared
def rare(
    campaign: CampaignFile,
    judged: Judged = Judged(),
    requirement: Requirements = None,
    population: Annotated[int, typer.Option(min=100, help="Missions of a level, a multiple of ten.")] = 500,
    computing: Computing = Computing(),
    output: Output = Output(),
) -> None:
    """How rarely an autopilot fails its requirements, 1e-4 and below, by subset simulation.

    Example: seatrial rare campaign.toml --requirement "keeps its path" --population 1000

    The exit code is 0 when every requirement is held, 1 when not, 2 for bad input.
    """
    from seatrial.verification.rare import Rare

    strategy = Rare(requirements=requirement or (), population=population)
    _, _, scenario = judged.scenario(campaign, quiet=output.json)
    folder = output.out or Path("runs") / f"{scenario.name}-rare"
    failures = _surveyed(strategy, scenario, folder, "rare failures", computing, output)
    output.show_run(failures, folder, "rare.json, summary.txt and the inputs", drawn=False)
    end(interrupted=failures.interrupted, held=failures.held)


@shared
def falsify(
    campaign: CampaignFile,
    judged: Judged = Judged(),
    requirement: Requirements = None,
    within: Annotated[
        float, typer.Option(metavar="SD", help="Standard deviations of every draw to search within.")
    ] = 3.0,
    threads: Threads = None,
    output: Output = Output(),
) -> None:
    """Search the worst mission within the ranges, and the least disturbance that still fails.

    Example: seatrial falsify campaign.toml --within 4

    The exit code is 0 when no mission fails, 1 when one does, 2 for bad input.
    """
    from seatrial.cli.console import reported
    from seatrial.report.plot import gallery
    from seatrial.verification.falsify import Falsify

    strategy = Falsify(requirements=requirement or (), within=within)
    _, _, scenario = judged.scenario(campaign, quiet=output.json)
    folder = output.out or Path("runs") / f"{scenario.name}-falsified"
    computing = Computing(threads=threads)
    falsification = _surveyed(strategy, scenario, folder, "falsification", computing, output)
    # Each failing mission flies again into a folder of its own, with its log.
    flown = {}
    for worst in falsification.falsified:
        name = worst.requirement.name
        flown[name] = (falsification.replay(name), folder.with_name(f"{folder.name}-{file_name(name)}"))
    for flight, place in flown.values():
        flight.save(place)

    def drawn() -> list[Path]:
        return [
            path
            for flight, place in flown.values()
            for path in sorted(gallery(flight, place / "figures", formats=output.endings))
        ]

    places = {name: str(place) for name, (_, place) in flown.items()}
    also = "".join(f"\nThe failing mission of {name} in {place}" for name, place in places.items())
    output.show(
        falsification,
        {"run_directory": str(folder), "flights": places},
        results=f"Results in {folder}: falsified.json, cases.toml, summary.txt and the inputs{also}",
        draw=None if output.json else drawn,
    )
    if output.json:
        drawn()
    reported(output.page, [folder], quiet=output.json)
    end(interrupted=falsification.interrupted, held=not falsification.falsified)


@shared
def boundary(
    campaign: CampaignFile,
    variables: Annotated[
        str,
        typer.Argument(
            metavar="NAME=FROM:TO[,...]",
            help="One or two variables and their ranges: current_speed_m_s, payload_kg,"
            " sensor_latency_s, ..., or a coefficient.",
        ),
    ],
    judged: Judged = Judged(),
    runs: Runs = None,
    requirement: Requirements = None,
    computing: Computing = Computing(),
    output: Output = Output(),
) -> None:
    """In which values of one or two variables requirements still hold.

    Example: seatrial boundary campaign.toml current_speed_m_s=0:1.2,payload_kg=-5:40 --runs 4000
    """
    from seatrial.verification.boundary import Boundary

    strategy = Boundary(_ranges(variables), requirement or ())
    _, _, scenario = judged.scenario(campaign, quiet=output.json, runs=runs)
    folder = output.out or Path("runs") / f"{scenario.name}-boundary"
    boundaries = _surveyed(strategy, scenario, folder, "failure boundary", computing, output)
    output.show_run(boundaries, folder, "boundary.json, summary.txt and the inputs")
    end(interrupted=boundaries.interrupted)


def _ranges(given: str) -> dict[str, tuple[float, float]]:
    """Variables and ranges of ``NAME=FROM:TO[,NAME=FROM:TO]``."""
    ranges: dict[str, tuple[float, float]] = {}
    parts = given.split(",")
    for part in parts:
        name, _, ends = part.strip().partition("=")
        low, _, high = ends.partition(":")
        try:
            ranges[name.strip()] = float(low), float(high)
        except ValueError:
            raise CampaignError(
                "boundary: expected NAME=FROM:TO, or two of them with a comma, such as"
                f" current_speed_m_s=0:1,payload_kg=0:5; found {part.strip()!r}"
            ) from None
    if len(ranges) != len(parts):
        raise CampaignError(f"boundary: a variable stands twice in {given!r}; name two different ones")
    return ranges


@dataclass(frozen=True)
class Recorded:
    """What flew, where it is not beside the log."""

    autopilot: Annotated[
        Path | None, typer.Option("--autopilot", help="Autopilot that flew, where it is not beside the log.")
    ] = None
    mission: Annotated[
        Path | None,
        typer.Option(
            "--mission", metavar="FILE", help="Mission that was flown, where it is not beside the log."
        ),
    ] = None
    reference: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="LOG",
            help="A log on which the model is known to hold, instead of the campaign's trials; repeatable.",
        ),
    ] = None


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
    recorded: Recorded = Recorded(),
    xml: JUnit = JUnit(),
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
    from seatrial.cli.console import note, reading_progress

    loaded = Campaign.load(campaign, progress=reading_progress(quiet=output.json))
    read = {"the campaign": campaign, "the vehicle": run, "the log": log}
    read |= {"the autopilot": recorded.autopilot}
    xml.check(read, None if recorded.mission is None else [recorded.mission])
    fit = fitted_source(loaded, run)
    # A log may be a file, a folder, or "." for the one that we stand in.
    name = log.stem if log.is_file() else log.name or log.resolve().name
    folder = output.out or Path("runs") / f"{loaded.name}-log-{file_name(name)}"
    check_writable(folder, "log verdict")
    # Of a trial of the campaign only the part that is held out can judge the model.
    verdict, judged = verify_campaign_log(
        loaded,
        loaded.vehicle if fit is None else fit,
        log,
        autopilot=recorded.autopilot,
        mission=recorded.mission,
        references=recorded.reference or [],
    )
    verdict.save(folder, problem=loaded.problem(), source=log)
    xml.write(verdict.junit())
    if not output.json:
        part = "" if judged.span is None else f", {judged.span[0]:g} to {judged.span[1]:g} s, held out"
        note(f"Vehicle: {fit or loaded.vehicle.name}. Log: {log}{part}.")

    output.show_run(
        verdict,
        folder,
        "verdict.json, junit.xml, summary.txt and the inputs",
        draw=lambda: sorted(output.draw(verdict, folder / "figures")),
    )
    end(held=verdict.held)
