"""`seatrial new` and `import`: a project to start from, as an example or from logs of a vehicle.

Tests: ``tests/cli/test_new.py``, ``tests/intake/test_import.py``.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seatrial.cli.options import Drawn, shared

if TYPE_CHECKING:
    from seatrial.base.report import Report

EXAMPLES = Path(__file__).parent.parent / "examples"
"""Example projects that come with the package."""

_FILES = ("vehicle.toml", "bench.toml", "campaign.toml", "mission.toml")

_RECORDS = {
    "bench": ("ahead", "astern", "down", "up", "steps"),
    "logs": ("straight", "zigzag", "dive", "mixed"),
}

LIKE = {
    "rov6": ("like/rov6.toml", "like/rov-mission.toml"),
    "rov8": ("like/rov8.toml", "like/rov-mission.toml"),
    "torpedo-fins": ("like/torpedo-fins.toml", "like/torpedo-mission.toml"),
    "torpedo-thrusters": ("starter/vehicle.toml", "starter/mission.toml"),
}
"""Kinds of vehicle, with the examples of their vehicle and mission file."""

_FRAMES = {"Vectored": "rov6", "Vectored_6DOF": "rov8"}
"""Frames of ArduSub, by the kind of vehicle that has their thrusters in this order."""

_LIKE_STEPS = (
    "fly {0}/vehicle.toml {0}/autopilot.toml {0}/mission.toml --sensors typical",
    "verify {0}/campaign.toml",
)

_STEPS = (
    "bench {0}/bench.toml",
    "check {0}/campaign.toml",
    "identify {0}/campaign.toml",
    "autopilot {0}/vehicle.toml --out {0}/autopilot.toml",
    "fly {0}/vehicle.toml {0}/autopilot.toml {0}/mission.toml",
)


def new(
    folder: Annotated[Path, typer.Argument(help="Folder to make; it must be empty or not exist.")],
    like: Annotated[
        str | None,
        typer.Option(
            metavar="|".join([*LIKE, "LOG.BIN"]),
            help="Instead of the starter's: vehicle, autopilot and mission of a vehicle like this, or like"
            " the one that wrote the log of ArduSub.",
        ),
    ] = None,
    from_report: Annotated[
        Path | None,
        typer.Option(
            "--from-report",
            metavar="FILE.html",
            help="Take the files out of a page that seatrial report wrote, instead of the starter's.",
        ),
    ] = None,
) -> None:
    """Write a starter project: vehicle, bench, campaign and mission file, generated example records.

    With --like: what tape measure, scales and a tub tell of a vehicle, an autopilot and a mission that fly.
    With --from-report: the vehicle, autopilot, mission and campaign files that a page carries, as they were.

    Example: seatrial new my-rov --like rov6
    """
    if like is not None and from_report is not None:
        raise typer.BadParameter("--like and --from-report exclude each other")
    from seatrial.cli.console import answer

    if from_report is not None:
        answer(_from_report(from_report, folder))
    else:
        answer(_starter(folder) if like is None else _like(like, folder))


def _starter(folder: Path) -> Report:
    """Write the starter's files and generated records."""
    from seatrial.base.report import Report, Section
    from seatrial.trial.generated import Recipe

    starter = EXAMPLES / "starter"
    with _fresh(folder):
        for records, names in _RECORDS.items():
            (folder / records).mkdir(exist_ok=True)
            for name in names:
                Recipe.load(starter / records / f"{name}.toml").save(folder / records / f"{name}.csv")
        for name in _FILES:
            (folder / name).write_text((starter / name).read_text(encoding="utf-8"), encoding="utf-8")
    count = sum(map(len, _RECORDS.values()))
    return Report(
        title=str(folder),
        outcome="project written",
        good=f"{len(_FILES)} commented files ({', '.join(_FILES)}) and {count} generated example records in"
        f" {'/, '.join(_RECORDS)}/",
        worst="the vehicle is an example; replace its measures, thrusters and records by your own",
        next_step=f"seatrial check {folder}/vehicle.toml",
        sections=(Section("Then", tuple(f"seatrial {step.format(folder)}" for step in _STEPS)),),
    )


@contextmanager
def _fresh(folder: Path) -> Iterator[None]:
    """A new folder, written whole or not at all; what the system says is one message."""
    from seatrial.base.errors import SeatrialError
    from seatrial.base.files import whole_folder, writing

    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise SeatrialError(f"{folder}: expected an empty or a new folder, found files; choose another name")
    with writing(folder), whole_folder(folder):
        yield


def _like(asked: str, folder: Path) -> Report:
    """Write vehicle, autopilot, mission and campaign like a kind of `LIKE`, or like the vehicle of a log."""
    from seatrial._core import Vehicle
    from seatrial.base.report import Report, Section
    from seatrial.control_design.start_autopilot import start_autopilot

    kind, reversed_ = (asked, []) if asked in LIKE else _kind_of_log(asked)
    vehicle, mission, campaign = (
        (EXAMPLES / name).read_text(encoding="utf-8") for name in (*LIKE[kind], "like/campaign.toml")
    )
    # What the log tells of the thrusters is written where a reader sees it.
    for name in reversed_:
        vehicle = vehicle.replace(f'name = "{name}"\n', f'name = "{name}"\nreversed = true # by the log\n')
    loaded = Vehicle.from_toml(vehicle, "vehicle.toml")
    # A supply means nothing to a vehicle whose thrust does not depend on it.
    if not any(facts["needs_voltage"] or facts["unit"] == "us" for facts in loaded.actuator_info().values()):
        campaign = campaign.replace("voltage_v = 16.0\n", "")
    files = {
        "vehicle.toml": vehicle,
        "autopilot.toml": start_autopilot(loaded),
        "mission.toml": mission,
        "campaign.toml": campaign,
    }
    with _fresh(folder):
        for name, text in files.items():
            (folder / name).write_text(text, encoding="utf-8")
    source = "" if asked == kind else f", the frame of {Path(asked).name}"
    return Report(
        title=str(folder),
        outcome=f"project written, like {kind}{source}",
        good=f"{len(files)} commented files: {', '.join(files)}",
        worst="the numbers marked [you] are an example's; replace them by your own"
        if "[you]" in vehicle
        else "the vehicle is an example; replace its measures and thrusters by your own",
        next_step=f"seatrial check {folder}/vehicle.toml",
        sections=(Section("Then", tuple(f"seatrial {step.format(folder)}" for step in _LIKE_STEPS)),),
    )


def _kind_of_log(log: str) -> tuple[str, list[str]]:
    """Kind of `LIKE` that has the frame of a log of ArduSub, and its thrusters that run reversed."""
    from seatrial._core import Vehicle
    from seatrial.ardusub.course import Rig, against
    from seatrial.ardusub.log_replay import replay
    from seatrial.base.errors import SeatrialError, nearest

    kinds = ", ".join(LIKE)
    if not Path(log).is_file():
        raise SeatrialError(
            f"--like {log}: expected {kinds}, or a log of ArduSub, found no such file{nearest(log, LIKE)}"
        )
    frame = replay(log).frame
    kind = None if frame is None else _FRAMES.get(frame[0])
    if frame is None or kind is None:
        frame_name = "no frame that its pulses tell" if frame is None else f"the frame {frame[0]}"
        raise SeatrialError(
            f"--like {log}: expected one of the frames {', '.join(_FRAMES)}, found {frame_name}; begin with"
            f" one of {kinds} and correct its thrusters"
        )
    return kind, against(Vehicle.load(EXAMPLES / LIKE[kind][0]), Rig(*frame))


def _from_report(page: Path, folder: Path) -> Report:
    """Write the files of a page into a folder, and say what can be done with them."""
    from seatrial.base.report import Report
    from seatrial.report.page.page import unpack

    written = unpack(page, folder)
    names = [path.relative_to(folder).as_posix() for path in written]
    campaigns = [name for name in names if name.endswith("campaign.toml")]
    vehicle = next((name for name in names if name.endswith("vehicle.toml")), None)
    return Report(
        title=str(folder),
        outcome="files written",
        good=f"{len(names)} files of {page.name}, each with the hash that it had: {', '.join(names)}",
        worst="a campaign names recordings that are not in a page; put them where it expects them"
        if campaigns
        else "recordings and results are not in a page",
        next_step=f"seatrial check {folder}/{vehicle or names[0]}",
    )


@shared
def import_(
    logs: Annotated[
        list[Path],
        typer.Argument(help="Logs of any format that is read; or one model of gz-sim.", metavar="LOG|MODEL"),
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="PROJECT", help="Folder of the project; without it, only list."),
    ] = None,
    map: Annotated[
        Path | None, typer.Option("--map", help="Map to use instead of a proposed one: map.toml, edited.")
    ] = None,
    vehicle: Annotated[
        str | None, typer.Option(help="Vehicle file or built-in vehicle; else by the log, or a stub.")
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Overwrite an imported project; files that you edited are kept.")
    ] = False,
    output: Drawn = Drawn(),
) -> None:
    """List what logs hold, and draft a project from them: map, vehicle, campaign and trials.

    Without --out it lists every topic and field with rate, range, unit and what it is taken for. A model of
    gz-sim (.sdf, .world, .xml) becomes a vehicle file, --out FILE.toml, with a report on what contradicts
    itself.

    Example: seatrial import dive.BIN --out dive
    """
    from seatrial.simulators.convert import ENDINGS

    # A single file that gz-sim would read is a model, all others are logs.
    if len(logs) == 1 and logs[0].suffix.lower() in ENDINGS:
        _model(logs[0], out, force=force, output=output)
        return
    from seatrial.cli.console import long_work
    from seatrial.intake.imported import import_logs
    from seatrial.intake.survey import survey

    with long_work("survey", quiet=output.json) as show:

        def progress(share: float, words: str) -> None:
            show(share, words, ())

        if out is None and map is None:
            surveyed = survey(logs, share=progress)
        else:
            made = import_logs(logs, out=out, map=map, vehicle=vehicle, force=force, progress=progress)
    if out is None and map is None:
        output.show(surveyed)
        return
    files = "map.toml, vehicle.toml, campaign.toml, trials/, import.json"
    written = "" if out is None else f"Written to {out}: {files}"
    output.show(made, results=written, draw=lambda: [] if out is None else output.draw(made, out / "figures"))


def _model(model: Path, out: Path | None, *, force: bool, output: Drawn) -> None:
    """Read a model of gz-sim, and write the vehicle file where --out says."""
    from seatrial.base.errors import VehicleError
    from seatrial.base.files import check_place
    from seatrial.simulators.convert import import_model, write_text

    imported = import_model(model)
    if out is not None:
        check_place(out, "--out", endings=(".toml",))
        if out.exists() and not force:
            raise VehicleError(f"{out}: is there already; choose another name or give --force")
        write_text(out, imported.text)
    written = "" if out is None else f"Vehicle file in {out}"
    output.show(imported, {"file": None if out is None else str(out)}, results=written)
