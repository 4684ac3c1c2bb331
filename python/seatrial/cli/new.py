"""`seatrial new` and `data`: a commented project to start from, and recordings of real vehicles.

Recordings come from their original source and count only with their hash. Tests: ``tests/cli/test_new.py``.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from seatrial.cli.options import Json

if TYPE_CHECKING:
    from seatrial.base.data_sets import DataFile
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
    from seatrial.base.atomic_write import whole_folder, writing
    from seatrial.base.errors import SeatrialError

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
    from seatrial.report.page.embedded import unpack

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


def data(
    action: Annotated[
        Literal["get", "list"],
        typer.Argument(help="Fetch data sets, or list what there is.", metavar="get|list"),
    ],
    names: Annotated[
        list[str] | None, typer.Argument(help="Data sets: beluga, t200, bluerov2.", metavar="NAME")
    ] = None,
    source: Annotated[
        str | None,
        typer.Option(
            "--from", metavar="URL", help="Mirror with a folder per data set, instead of the original source."
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Fetch recordings of real vehicles (beluga, t200, bluerov2) into SEATRIAL_DATA or the user's cache.

    A file counts only with its SHA-256; one that is there is not fetched again.

    Example: seatrial data get beluga
    """
    from seatrial.base.data_sets import DATA_SETS, data_folder
    from seatrial.base.errors import TrialError
    from seatrial.cli.console import answer, print_json

    content: Any
    if action == "list":
        report, content = _listed(names or list(DATA_SETS))
    elif names:
        report, content = _fetched(names, source, quiet=json)
    else:
        raise TrialError(
            f"data get: expected the name of a data set, found none; one of {', '.join(DATA_SETS)}"
        )
    if json:
        print_json({"folder": str(data_folder()), "sets": content})
    else:
        answer(report)


def _listed(names: list[str]) -> tuple[Report, list[dict[str, str]]]:
    """Which data sets there are, for people and as plain data."""
    from seatrial.base.data_sets import DATA_SETS, data_folder, get
    from seatrial.base.report import Report, Section, Table

    folder = data_folder()
    for unknown in [name for name in names if name not in DATA_SETS][:1]:
        get(unknown)  # which refuses it
    chosen = {name: data_set for name, data_set in DATA_SETS.items() if name in names}
    rows = [
        (
            name,
            f"{sum((folder / known.folder / f.name).is_file() for f in known.files)} of {len(known.files)}",
            f"{sum(f.size for f in known.files) / 1e6:.1f}",
            known.description,
            known.licence,
        )
        for name, known in chosen.items()
    ]
    table = Table.of("", ("name", "files here", "MB", "what", "licence"), rows)
    report = Report(
        title=str(folder),
        outcome=f"{len(rows)} data sets",
        good="the folder of recordings",
        worst="nothing is checked before it is fetched or used",
        next_step="fetch one with seatrial data get NAME",
        sections=(Section(tables=(table,)),),
    )
    keys = ("name", "files", "megabytes", "description", "licence")
    return report, [dict(zip(keys, row, strict=True)) for row in rows]


def _fetched(names: list[str], source: str | None, *, quiet: bool) -> tuple[Report, dict[str, Any]]:
    """What was fetched, for people and as plain data."""
    from seatrial.base.data_sets import DATA_SETS, data_folder, get
    from seatrial.base.report import Report, Section
    from seatrial.cli.console import say

    def begin(file: DataFile) -> None:
        if not quiet:
            say(f"fetching {file.name} ({file.size / 1e6:.1f} MB)")

    folder = data_folder()
    sets = {name: get(name, source=source, begin=begin) for name in names}
    count, fetched = sum(map(len, sets.values())), sum(sum(files.values()) for files in sets.values())
    licences = [f"{name}: {DATA_SETS[name].description}; {DATA_SETS[name].licence}" for name in sets]
    report = Report(
        title=", ".join(sets),
        outcome="here",
        good=f"{count} files in {folder} with the right SHA-256, {fetched} of them fetched",
        worst="none: every file is the published one",
        next_step=f"set SEATRIAL_DATA={folder} for campaigns and tests that name it",
        sections=(Section(sentences=tuple(licences)),),
    )
    return report, {name: {str(path): new for path, new in files.items()} for name, files in sets.items()}
