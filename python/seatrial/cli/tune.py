"""`seatrial autopilot`, `tune` and `ardusub`: start gains, gains that keep all responses in their corridors.

Of ArduSub the parameters are tuned from one of its logs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seatrial.base.errors import SeatrialError
from seatrial.cli.options import Computing, Output, Printed, Resume, Run, Threads, end, shared

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.ardusub.comparison import Replay
    from seatrial.ardusub.from_log import LogTuning
    from seatrial.campaign.campaign import Campaign
    from seatrial.check.autopilot import AutopilotCheck
    from seatrial.identification.identification import Identification
    from seatrial.tuning.result import Tuning


@shared
def autopilot(
    vehicle: Annotated[str, typer.Argument(help="Vehicle file or built-in vehicle.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Autopilot file to write.")] = Path(
        "autopilot.toml"
    ),
    law: Annotated[
        str, typer.Option(metavar="pid|lqr", help="Decoupled PID loops, or a linear-quadratic regulator.")
    ] = "pid",
    period_s: Annotated[float, typer.Option(help="Control period, s.")] = 0.1,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
    printed: Printed = Printed(),
) -> None:
    """Write an autopilot with start gains from a vehicle's model, and say what they are worth.

    Example: seatrial autopilot vehicle.toml --out autopilot.toml
    """
    from seatrial._core import Autopilot, Vehicle
    from seatrial.base.files import check_place, write_atomic
    from seatrial.check.autopilot import check_autopilot
    from seatrial.control_design.start_autopilot import start_autopilot

    check_place(out, "--out", inputs={"the vehicle": vehicle})
    another = "and it is not overwritten; give another name, or --force"
    if out.exists() and not force:
        raise SeatrialError(f"--out {out}: this file exists, {another}")
    # The text is checked as it will be read, with the comments that say why a loop is missing.
    loaded = Vehicle.load(vehicle)
    text = start_autopilot(loaded, law=law, period_s=period_s)
    checked = check_autopilot(Autopilot.from_toml(text, str(out)), vehicle=loaded)
    remarks = [*_authority(loaded, checked), *_left_out(text)]
    try:
        write_atomic(out, text.encode(), new=not force)
    except FileExistsError:
        raise SeatrialError(f"--out {out}: another program wrote this file meanwhile, {another}") from None
    supply = " --voltage VOLTS" if loaded.table_voltages() else ""
    after = f"seatrial check {out} --vehicle {vehicle}; then seatrial fly {vehicle} {out} MISSION{supply}"
    report = replace(checked.report(remarks), next_step=after)
    facts = {"authority": remarks, "file": str(out)}
    printed.show(checked, facts, report=report, results=f"Autopilot in {out}")


def _authority(vehicle: Vehicle, checked: AutopilotCheck) -> list[str]:
    """What the vehicle can command and what the loss of an actuator costs, at a speed it is used at."""
    hovers = any(mode.depth_by == "heave" for mode in checked.modes)
    # A vehicle under way is judged at a cruise of 0.6 of the largest speed that is asked for.
    return authority_in_words(vehicle, 0.0 if hovers else round(0.6 * checked.speeds_m_s[-1], 1))


def _left_out(text: str) -> list[str]:
    """Why there is no loop for a row, from the comments at the head of the file."""
    head = text.partition("\nformat")[0].splitlines()
    return [line.removeprefix("# ") for line in head if line.startswith("# No ")]


@shared
def tune(
    campaign: Annotated[
        Path,
        typer.Argument(help="Campaign file (TOML) with [tuning]. Without that table, the defaults hold."),
    ],
    run: Run = None,
    computing: Computing = Computing(),
    output: Output = Output(),
) -> None:
    """Tune an autopilot's gains until its responses stay within the corridors of a campaign.

    Example: seatrial tune campaign.toml --run runs/mine

    The exit code is 1 where a response leaves its corridor, or a margin falls short, after all. Ctrl-C keeps
    the best so far; the same command goes on with what is not finished.
    """
    from seatrial.campaign.campaign import Campaign
    from seatrial.cli.console import note

    loaded = Campaign.load(campaign)
    folder = output.out or Path("runs") / f"{loaded.name}-tuned"
    source = fitted_source(loaded, run)
    if not output.json:
        note(f"Vehicle: {source or loaded.vehicle.name}")
    tuning = tuned(loaded, source, folder, computing=computing, quiet=output.json)
    # An interrupted tuning leaves no results, and nothing that a page could show.
    files = "" if tuning.interrupted else "autopilot.toml, tuning.json, summary.txt, Parquet tables"
    output.show_run(tuning, folder, files, page=not tuning.interrupted)
    end(interrupted=tuning.interrupted, held=tuning.held)


def fitted_source(campaign: Campaign, given: Path | None) -> Path | str | None:
    """What is known of the vehicle: what was given, else the campaign's run directory, else nothing."""
    if given is not None:
        return given if given.exists() else str(given)
    beside = Path("runs") / campaign.name
    return beside if (beside / "identification.json").is_file() else None


def tuned(
    campaign: Campaign,
    source: Identification | Path | str | None,
    folder: Path | None,
    *,
    computing: Computing = Computing(),
    quiet: bool = False,
) -> Tuning:
    """Tuning of a campaign into a run directory, with progress on standard error."""
    with computing.work(folder, "making ready", quiet=quiet) as work:
        return campaign.tune(source, work=work)


@dataclass(frozen=True)
class Draws:
    """How many missions judge the parameters, and how they are drawn."""

    missions: Annotated[
        int, typer.Option(min=16, max=100_000, help="Missions with which before and after are judged.")
    ] = 1000
    seed: Annotated[int, typer.Option(min=0, max=2**31, help="Of everything that is drawn.")] = 0


@shared
def ardusub(
    log: Annotated[Path, typer.Argument(help="DataFlash log of ArduSub, .BIN.")],
    parameters: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.param",
            help="The vehicle's own parameters: compared with those found, and taken where the log has none.",
        ),
    ] = None,
    replay_only: Annotated[
        bool, typer.Option("--replay-only", help="Replay the controllers and find the parameters; a second.")
    ] = False,
    vehicle: Annotated[
        str | None, typer.Option(help="Vehicle file or built-in vehicle to begin with; else by the frame.")
    ] = None,
    draws: Draws = Draws(),
    resume: Resume = True,
    threads: Threads = None,
    output: Output = Output(),
) -> None:
    """Replay ArduSub's controllers from a log, identify the vehicle from it, tune and verify its parameters.

    The exit code is 0 when the law explains the log, the vehicle flies the log's mission inside the envelope,
    and what changes is better with margins kept; 1 when not, 2 for bad input. With --replay-only it is that
    of the replay. Ctrl-C keeps what is finished; the same command goes on.

    Example: seatrial ardusub dive.BIN
    """
    from seatrial.ardusub.from_log import tune_log
    from seatrial.ardusub.log_replay import replay
    from seatrial.ardusub.parameters import ParameterFile
    from seatrial.base.files import file_name
    from seatrial.base.run import check_writable
    from seatrial.base.work import Work
    from seatrial.cli.console import Code, say, search_progress

    folder = output.out or Path("runs") / file_name(f"ardusub-{log.stem}")
    check_writable(folder, "replay" if replay_only else "ardusub")
    given = None if parameters is None else ParameterFile.load(parameters)
    result: Replay | LogTuning
    if replay_only:
        result = replay(log, parameters=given)
        result.save(folder)
        files = "replay.json, summary.txt, found.param"
    else:
        try:
            with search_progress("reading", quiet=output.json) as progress:
                work = Work(threads=threads, resume=resume, progress=progress)
                result = tune_log(
                    log, out=folder, parameters=given, vehicle=vehicle, missions=draws.missions,
                    seed=draws.seed, work=work,
                )  # fmt: skip
        except KeyboardInterrupt:
            if not output.json:
                say(f"Interrupted; what is finished is kept beside {folder}, and the same command goes on.")
            raise typer.Exit(Code.INTERRUPTED) from None
        files = "changes.param, found.param, ardusub.json, replay.json, summary.txt"
    output.show_run(result, folder, files)
    end(held=result.held)


def authority_in_words(vehicle: Vehicle, speed_m_s: float) -> list[str]:
    """What can be commanded at a speed ahead, and what the loss of each actuator leaves, a sentence each.

    As ``Vehicle.authority_sentences``; where the only thrust ahead is lost, the speed and the force of fins
    go with it.
    """
    from seatrial.base.report import listed

    sentences = vehicle.authority_sentences(speed_m_s)
    only = _only_thrust(vehicle)
    if only is None or speed_m_s <= 0.0:
        return sentences
    still = set(_commanded(vehicle, 0.0)) - {"surge"}
    gone = [motion for motion in _commanded(vehicle, speed_m_s) if motion not in still]
    lost = f", and {listed(gone)} {'is' if len(gone) == 1 else 'are'} lost" if gone else ""
    words = (
        f"After the loss of {only} nothing drives the vehicle: its speed decays, its fins lose their"
        f" force{lost}; {_way_up(vehicle)}."
    )
    loss = (f"After the loss of {only} ", f"Nothing remains after the loss of {only}.")
    return [words if sentence.startswith(loss) else sentence for sentence in sentences]


def _only_thrust(vehicle: Vehicle) -> str | None:
    """The one actuator that drives a vehicle with fins ahead; None where there are several or no fins."""
    facts, matrix = vehicle.actuator_info(), vehicle.allocation_matrix()
    ahead = {name: abs(float(x)) for name, x in zip(vehicle.actuators, matrix[0], strict=True)}
    fins = [name for name in ahead if facts[name]["kind"] == "fin"]
    # A tenth of what the strongest gives drives no vehicle.
    driving = [name for name, x in ahead.items() if name not in fins and x > 0.1 * max(ahead.values())]
    return driving[0] if fins and len(driving) == 1 else None


def _commanded(vehicle: Vehicle, speed_m_s: float) -> list[str]:
    """Motions that can be commanded independently at a speed ahead: 99 % of a demand are met."""
    from seatrial.base.channels import MOTIONS

    rows = vehicle.authority(speed_m_s)
    return [motion for row, motion in MOTIONS.items() if rows[row]["controlled_share"] >= 0.99]


def _way_up(vehicle: Vehicle) -> str:
    """Whether a vehicle without thrust comes up; neutral is one within a ten-thousandth of its weight."""
    from seatrial.vehicle.stability import statics

    rest = statics(vehicle)
    if rest.net_n > 1e-4 * rest.weight_n:
        return f"only its buoyancy of {rest.net_n:+.2g} N brings it up"
    return 'and it is not buoyant: neither reaction of the safety, "surface" or "abort", brings it up'
