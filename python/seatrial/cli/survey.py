"""`seatrial rare`, `falsify` and `boundary`: a campaign's scenario surveyed for failures.

Tests: ``tests/cli/test_cli_rare.py``, ``tests/verification/test_boundary.py``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from seatrial.base.errors import CampaignError
from seatrial.cli.options import Computing, Output, Threads, shared
from seatrial.cli.verify import AutopilotFile, CampaignFile, Missions, Navigation, Run, asked

Requirements = Annotated[
    list[str] | None,
    typer.Option("--requirement", metavar="NAME", help="This requirement, not all; repeatable."),
]


@shared
def rare(
    campaign: CampaignFile,
    run: Run = None,
    autopilot: AutopilotFile = None,
    mission: Missions = None,
    navigation: Navigation = None,
    requirement: Requirements = None,
    population: Annotated[int, typer.Option(min=100, help="Missions of a level, a multiple of ten.")] = 500,
    computing: Computing = Computing(),
    output: Output = Output(),
) -> None:
    """How rarely an autopilot fails its requirements, 1e-4 and below, by subset simulation.

    Example: seatrial rare campaign.toml --requirement "keeps its path" --population 1000

    The exit code is 0 when every requirement is held, 1 when not, 2 for bad input.
    """
    from seatrial.base.run import check_writable
    from seatrial.cli.console import answer, print_json
    from seatrial.verification.rare import Rare

    strategy = Rare(requirements=requirement or (), population=population)
    _, _, scenario = asked(
        campaign, run, autopilot, quiet=output.json, missions=mission, navigation=navigation
    )
    folder = output.out or Path("runs") / f"{scenario.name}-rare"
    check_writable(folder, "rare failures")
    with computing.work(folder, "first missions", quiet=output.json) as work:
        failures = strategy.survey(scenario, work)
    if output.json:
        print_json(failures.to_dict() | {"run_directory": str(folder)})
    else:
        results = f"Results in {folder}: rare.json, summary.txt and the inputs"
        answer(failures.report(), verbose=output.verbose, results=results)
    if failures.interrupted:
        raise typer.Exit(130)
    if not failures.held:
        raise typer.Exit(1)


@shared
def falsify(
    campaign: CampaignFile,
    run: Run = None,
    autopilot: AutopilotFile = None,
    mission: Missions = None,
    navigation: Navigation = None,
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
    from seatrial.base.file_names import file_name
    from seatrial.base.run import check_writable
    from seatrial.cli.console import answer, print_json
    from seatrial.report.plot import gallery
    from seatrial.verification.falsify import Falsify

    strategy = Falsify(requirements=requirement or (), within=within)
    _, _, scenario = asked(
        campaign, run, autopilot, quiet=output.json, missions=mission, navigation=navigation
    )
    folder = output.out or Path("runs") / f"{scenario.name}-falsified"
    check_writable(folder, "falsification")
    with Computing(threads=threads).work(folder, "first missions", quiet=output.json) as work:
        falsification = strategy.survey(scenario, work)
    # Each failing mission flies again into a folder of its own, with its log.
    flown = {}
    for worst in falsification.falsified:
        name = worst.requirement.name
        place = folder.with_name(f"{folder.name}-{file_name(name)}")
        flown[name] = (falsification.replay(name), place)
    for flight, place in flown.values():
        flight.save(place)

    def drawn() -> list[Path]:
        return [
            path
            for flight, place in flown.values()
            for path in sorted(gallery(flight, place / "figures", formats=output.endings))
        ]

    if output.json:
        places = {name: str(place) for name, (_, place) in flown.items()}
        print_json(falsification.to_dict() | {"run_directory": str(folder), "flights": places})
        drawn()
    else:
        also = "".join(f"\nThe failing mission of {name} in {place}" for name, (_, place) in flown.items())
        results = f"Results in {folder}: falsified.json, cases.toml, summary.txt and the inputs{also}"
        answer(
            falsification.report(),
            verbose=output.verbose,
            results=results,
            draw=drawn if output.endings and flown else None,
        )
    if falsification.interrupted:
        raise typer.Exit(130)
    if falsification.falsified:
        raise typer.Exit(1)


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
    run: Run = None,
    autopilot: AutopilotFile = None,
    runs: Annotated[
        int | None, typer.Option(min=1, help="Number of missions instead of the campaign's.")
    ] = None,
    mission: Missions = None,
    navigation: Navigation = None,
    requirement: Requirements = None,
    computing: Computing = Computing(),
    output: Output = Output(),
) -> None:
    """In which values of one or two variables requirements still hold.

    Example: seatrial boundary campaign.toml current_speed_m_s=0:1.2,payload_kg=-5:40 --runs 4000
    """
    from seatrial.base.run import check_writable
    from seatrial.cli.console import answer, print_json
    from seatrial.report.plot import gallery
    from seatrial.verification.boundary import Boundary

    strategy = Boundary(_ranges(variables), requirement or ())
    _, _, scenario = asked(
        campaign, run, autopilot, quiet=output.json, runs=runs, missions=mission, navigation=navigation
    )
    folder = output.out or Path("runs") / f"{scenario.name}-boundary"
    check_writable(folder, "failure boundary")
    with computing.work(folder, "first missions", quiet=output.json) as work:
        boundaries = strategy.survey(scenario, work)

    def drawn() -> list[Path]:
        return (
            [] if boundaries.interrupted else gallery(boundaries, folder / "figures", formats=output.endings)
        )

    if output.json:
        figures = [str(path) for path in drawn()]
        print_json(boundaries.to_dict() | {"run_directory": str(folder), "figures": figures})
    else:
        results = f"Results in {folder}: boundary.json, summary.txt and the inputs"
        answer(boundaries.report(), verbose=output.verbose, results=results, draw=drawn)
    if boundaries.interrupted:
        raise typer.Exit(130)


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
