"""`seatrial verify`: a campaign and an autopilot, or a log, in; a verdict out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seatrial.base.errors import CampaignError
from seatrial.cli.console import Dask, Figures, Json, Pdf, Threads, Verbose
from seatrial.cli.report import Page, reported

if TYPE_CHECKING:
    from seatrial.campaign.campaign import Campaign
    from seatrial.verification.campaign import VerifiedCampaign
    from seatrial.verification.verification import Verification


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
    navigation: Annotated[
        str | None,
        typer.Option(
            metavar="sensors|filter",
            help="What the autopilot goes by, instead of the campaign's: what the sensors show, or the"
            " estimate of a navigation filter.",
        ),
    ] = None,
    compare: Annotated[
        bool, typer.Option("--compare", help="Fly the same draws with the campaign's start autopilot too.")
    ] = False,
    replay: Annotated[
        int | None,
        typer.Option(min=0, metavar="NUMBER", help="Fly one mission again, with its log, and nothing else."),
    ] = None,
    rare: Annotated[
        bool,
        typer.Option(
            "--rare", help="How rarely the requirements fail, 1e-4 and below, by subset simulation."
        ),
    ] = False,
    falsify: Annotated[
        bool,
        typer.Option(
            "--falsify",
            help="Search the worst mission within the ranges, and the least disturbance that still fails.",
        ),
    ] = False,
    within: Annotated[
        float | None,
        typer.Option(metavar="SD", help="With --falsify: standard deviations of every draw; 3 by default."),
    ] = None,
    requirement: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="With --rare, --falsify or --boundary: this requirement, not all; repeatable.",
        ),
    ] = None,
    population: Annotated[
        int | None,
        typer.Option(min=100, help="With --rare: missions of a level, a multiple of ten; 500 by default."),
    ] = None,
    boundary: Annotated[
        str | None,
        typer.Option(
            metavar="NAME=FROM:TO[,...]",
            help="In which values of one or two variables requirements still hold: current_speed_m_s,"
            " payload_kg, sensor_latency_s, ..., or a coefficient.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="Run directory; runs/NAME-verified, -rare, -falsified or -mission-NUMBER."
        ),
    ] = None,
    junit: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the JUnit XML to this file as well.")
    ] = None,
    resume: Annotated[
        bool, typer.Option(help="Reuse missions that an earlier run flew from the same inputs.")
    ] = True,
    threads: Threads = None,
    dask: Dask = None,
    figures: Figures = True,
    pdf: Pdf = False,
    page: Page = None,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Verify an autopilot by many missions of drawn vehicles in drawn water, with noise and failures.

    With --log: does the model still hold on a recorded mission, what is suspected, what did the mission hold.

    The exit code is 0 when every requirement is held (and the model still valid), 1 when one failed or is
    undecided or a log cannot judge the model, 2 for bad input.
    Ctrl-C keeps the missions flown; the same command goes on from there.
    """
    from seatrial.base.file_names import check_place
    from seatrial.base.run import check_writable
    from seatrial.campaign.campaign import Campaign
    from seatrial.cli.console import answer, formats, print_json, reading_progress
    from seatrial.cli.streams import note
    from seatrial.cli.tune import fitted_source
    from seatrial.cli.verify_boundary import verify_boundary
    from seatrial.cli.verify_log import refuse_beside, verify_log, write_beside
    from seatrial.verification.campaign import verified_campaign

    loaded = Campaign.load(campaign, progress=reading_progress(quiet=json))
    drawing = formats(pdf, page) if figures else ()
    if junit is not None:
        read = {"the campaign": campaign, "the vehicle": run, "the autopilot": autopilot, "the log": log}
        read |= {f"mission {path}": path for path in mission or ()}
        check_place(junit, "--junit", endings=(".xml",), inputs=read, folder_made=True)
    if log is not None:
        refuse_beside({
            "--runs": runs,
            "--navigation": navigation,
            "--compare": compare,
            "--replay": replay,
            "--rare": rare,
            "--falsify": falsify,
            "--dask": dask,
            "--boundary": boundary,
        })
        verify_log(
            loaded,
            fitted_source(loaded, run),
            log,
            autopilot=autopilot,
            missions=mission or [],
            references=reference or [],
            out=out,
            drawing=drawing,
            page=page,
            junit=junit,
            verbose=verbose,
            json=json,
        )
        return
    if reference:
        raise CampaignError("--reference: it belongs to a recorded mission; give that with --log")
    _refuse_alone(rare, falsify, boundary, requirement, population, within)
    source, gains = fitted_source(loaded, run), gains_source(loaded, autopilot)
    prepared = verified_campaign(
        loaded, source, gains, runs=runs, missions=mission or None, compare=compare, navigation=navigation
    )
    if not json:
        flies, steers = source or loaded.vehicle.name, gains or prepared.flights.autopilot.name
        note(f"Vehicle: {flies}. Autopilot: {steers}.")
    if rare or falsify or boundary:
        search = "--rare" if rare else "--falsify" if falsify else "--boundary"
        # Of a boundary, the number of missions is the reader's choice.
        given = {
            "--replay": replay,
            "--junit": junit,
            "--runs": runs and not boundary,
            "--compare": compare,
            "--dask": dask if falsify else None,
        }
        if wrong := [key for key, value in given.items() if value]:
            raise CampaignError(f"{wrong[0]}: not with {search}, which chooses its missions; leave it out")
    if rare:
        _rare(
            prepared,
            requirement or [],
            population,
            out,
            resume=resume,
            threads=threads,
            dask=dask,
            verbose=verbose,
            json=json,
        )
        return
    if falsify:
        _falsify(
            prepared,
            requirement or [],
            within,
            out,
            threads=threads,
            drawing=drawing,
            verbose=verbose,
            json=json,
        )
        return
    if boundary:
        verify_boundary(
            prepared,
            boundary,
            requirement or [],
            out=out,
            resume=resume,
            threads=threads,
            dask=dask,
            drawing=drawing,
            verbose=verbose,
            json=json,
        )
        return
    if replay is not None:
        _replay(prepared, replay, out, drawing=drawing, page=page, verbose=verbose, json=json)
        return
    folder = out or Path("runs") / f"{loaded.name}-verified"
    check_writable(folder, "verification")
    found = verified(prepared, folder, threads=threads, dask=dask, resume=resume, quiet=json)
    if junit is not None:
        write_beside(junit, found.junit())

    def drawn() -> list[Path]:
        return draw(found, folder, formats=drawing) if drawing and not found.interrupted else []

    if json:
        print_json(found.to_dict() | {"run_directory": str(folder), "figures": [str(p) for p in drawn()]})
    else:
        files = "verification.json, summary.txt, junit.xml, worst_runs.json, missions.parquet and the inputs"
        answer(found.report(), verbose=verbose, results=f"Results in {folder}: {files}", draw=drawn)
    if found.interrupted:
        raise typer.Exit(130)
    reported(page, [folder], quiet=json)
    if not found.held:
        raise typer.Exit(1)


def _refuse_alone(
    rare: bool,
    falsify: bool,
    boundary: str | None,
    requirement: list[str] | None,
    population: int | None,
    within: float | None,
) -> None:
    """Refuse options of a search without it, and two searches at once."""
    searches = {"--rare": rare, "--falsify": falsify, "--boundary": boundary}
    asked = [name for name, given in searches.items() if given]
    if len(asked) > 1:
        raise CampaignError(f"{' and '.join(asked)}: expected one of them; run one after the other")
    if requirement and not asked:
        raise CampaignError(
            "--requirement: it belongs to a search; give it with --rare, --falsify or --boundary"
        )
    if population and not rare:
        raise CampaignError("--population: it belongs to rare failures; give it with --rare")
    if within and not falsify:
        raise CampaignError("--within: it belongs to the search for the worst; give it with --falsify")


def _falsify(
    prepared: VerifiedCampaign,
    names: list[str],
    within: float | None,
    out: Path | None,
    *,
    threads: int | None,
    drawing: tuple[str, ...],
    verbose: bool,
    json: bool,
) -> None:
    """The worst missions into a run directory, each flown again into a folder of its own."""
    from seatrial.base.file_names import file_name
    from seatrial.base.run import check_writable
    from seatrial.cli.console import answer, print_json, search_progress
    from seatrial.cli.fly import draw_flight
    from seatrial.verification.falsify import WITHIN, run_falsification

    folder = out or Path("runs") / f"{prepared.campaign.name}-falsified"
    check_writable(folder, "falsification")
    with search_progress("first missions", quiet=json) as progress:
        found = run_falsification(
            prepared,
            names=names,
            within=WITHIN if within is None else within,
            run_dir=folder,
            progress=progress,
            threads=threads,
        )
    flown = {}
    for one in found.falsified:
        place = folder.with_name(f"{folder.name}-{file_name(one.requirement.name)}")
        flown[one.requirement.name] = (found.replay(one.requirement.name), place)
    for flight, place in flown.values():
        flight.save(place)

    def drawn() -> list[Path]:
        return [path for flight, place in flown.values() for path in draw_flight(flight, place, drawing)]

    if json:
        places = {name: str(place) for name, (_, place) in flown.items()}
        print_json(found.to_dict() | {"run_directory": str(folder), "flights": places})
        drawn()
    else:
        also = "".join(f"\nThe failing mission of {name} in {place}" for name, (_, place) in flown.items())
        results = f"Results in {folder}: falsified.json, cases.toml, summary.txt and the inputs{also}"
        answer(found.report(), verbose=verbose, results=results, draw=drawn if drawing and flown else None)
    if found.interrupted:
        raise typer.Exit(130)
    if found.falsified:
        raise typer.Exit(1)


def _rare(
    prepared: VerifiedCampaign,
    names: list[str],
    population: int | None,
    out: Path | None,
    *,
    resume: bool,
    threads: int | None,
    dask: str | None,
    verbose: bool,
    json: bool,
) -> None:
    """Rare failures into a run directory of their own; the exit code is that of the verdict."""
    from seatrial.base.run import check_writable
    from seatrial.cli.console import answer, print_json, search_progress, workers
    from seatrial.verification.rare import run_rare
    from seatrial.verification.rare_result import SIZE

    folder = out or Path("runs") / f"{prepared.campaign.name}-rare"
    check_writable(folder, "rare failures")
    with workers(dask) as fleet, search_progress("first missions", quiet=json) as progress:
        found = run_rare(
            prepared,
            names=names,
            size=population or SIZE,
            run_dir=folder,
            progress=progress,
            resume=resume,
            threads=threads,
            executor=fleet,
        )
    if json:
        print_json(found.to_dict() | {"run_directory": str(folder)})
    else:
        results = f"Results in {folder}: rare.json, summary.txt and the inputs"
        answer(found.report(), verbose=verbose, results=results)
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
    dask: str | None = None,
    resume: bool = True,
    quiet: bool = False,
) -> Verification:
    """Verification of a campaign into a run directory, with progress on standard error."""
    from seatrial.cli.console import search_progress, workers
    from seatrial.verification.verify import run_verification

    with workers(dask) as fleet, search_progress("first missions", quiet=quiet) as progress:
        return run_verification(
            prepared, run_dir=folder, progress=progress, resume=resume, threads=threads, executor=fleet
        )


def draw(found: Verification, folder: Path, *, formats: tuple[str, ...] = ("png",)) -> list[Path]:
    """Paths of the figures of a verification in its run directory."""
    from seatrial.report.plot.verification import verification_gallery

    return verification_gallery(found, folder / "figures", formats=formats)


def _replay(
    prepared: VerifiedCampaign,
    number: int,
    out: Path | None,
    *,
    drawing: tuple[str, ...],
    page: Path | None,
    verbose: bool,
    json: bool,
) -> None:
    """One mission flown again into a run directory of its own."""
    from seatrial.base.report import Section
    from seatrial.cli.console import answer, print_json
    from seatrial.cli.fly import draw_flight
    from seatrial.report.results.verification import reserve

    flight = prepared.flights.replay(number)
    folder = flight.save(out or Path("runs") / f"{prepared.campaign.name}-mission-{number}")

    def drawn() -> list[Path]:
        return draw_flight(flight, folder, drawing) if drawing else []

    if json:
        print_json(flight.to_dict() | {"run_directory": str(folder), "figures": [str(p) for p in drawn()]})
        reported(page, [folder], quiet=True)
        return
    metrics = prepared.flights.fly([number]).metrics
    said = []
    for one in prepared.requirements:
        judged = one.judge(metrics)
        size = reserve(float(judged.reserve[0]), judged.unit)
        left = "" if size in ("held", "failed") else f", robustness {size}"
        said.append(f"{one.name}: {one.holds}: {'held' if judged.held[0] else 'not held'}{left}")
    results = f"Mission {number} in {folder}: flight.json, flight.parquet, summary.txt and the inputs"
    report = flight.report(sections=(Section("Requirements", tuple(said)),))
    answer(report, verbose=verbose, results=results, draw=drawn)
    reported(page, [folder])
