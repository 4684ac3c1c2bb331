"""`seatrial new`: a commented project to start from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

EXAMPLES = Path(__file__).parent.parent / "examples"
"""Example projects that come with the package."""

_FILES = ("vehicle.toml", "bench.toml", "campaign.toml", "mission.toml")

_RECORDS = {
    "bench": ("ahead", "astern", "down", "up", "steps"),
    "logs": ("straight", "zigzag", "dive", "mixed"),
}


_STEPS = (
    "bench {0}/bench.toml",
    "check {0}/campaign.toml",
    "identify {0}/campaign.toml",
    "autopilot {0}/vehicle.toml --out {0}/autopilot.toml",
    "fly {0}/vehicle.toml {0}/autopilot.toml {0}/mission.toml",
)


def new(
    folder: Annotated[Path, typer.Argument(help="Folder to make; it must be empty or not exist.")],
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

    With --from-report: the vehicle, autopilot, mission and campaign files that a page carries, as they were.

    Example: seatrial new my-vehicle
    """
    if from_report is not None:
        _from_report(from_report, folder)
        return
    from seatrial.base.atomic_write import whole_folder
    from seatrial.base.errors import SeatrialError
    from seatrial.base.report import Report, Section
    from seatrial.cli.console import answer
    from seatrial.trial.generated import Recipe

    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise SeatrialError(f"{folder}: expected an empty or a new folder, found files; choose another name")
    starter = EXAMPLES / "starter"
    try:
        with whole_folder(folder):
            for records, names in _RECORDS.items():
                (folder / records).mkdir(exist_ok=True)
                for name in names:
                    Recipe.load(starter / records / f"{name}.toml").save(folder / records / f"{name}.csv")
            for name in _FILES:
                (folder / name).write_text((starter / name).read_text(encoding="utf-8"), encoding="utf-8")
    except OSError as error:
        raise SeatrialError(
            f"{folder}: cannot be written ({error.strerror}); choose a folder that you may write to"
        ) from None
    count = sum(map(len, _RECORDS.values()))
    report = Report(
        title=str(folder),
        outcome="project written",
        good=f"{len(_FILES)} commented files ({', '.join(_FILES)}) and {count} generated example records in"
        f" {'/, '.join(_RECORDS)}/",
        worst="the vehicle is an example; replace its measures, thrusters and records by your own",
        next_step=f"seatrial check {folder}/vehicle.toml",
        sections=(Section("Then", tuple(f"seatrial {step.format(folder)}" for step in _STEPS)),),
    )
    answer(report)


def _from_report(page: Path, folder: Path) -> None:
    """Write the files of a page into a folder, and say what can be done with them."""
    from seatrial.base.report import Report
    from seatrial.cli.console import answer
    from seatrial.report.page.embedded import unpack

    written = unpack(page, folder)
    names = [path.relative_to(folder).as_posix() for path in written]
    campaigns = [name for name in names if name.endswith("campaign.toml")]
    vehicle = next((name for name in names if name.endswith("vehicle.toml")), None)
    answer(
        Report(
            title=str(folder),
            outcome="files written",
            good=f"{len(names)} files of {page.name}, each with the hash that it had: {', '.join(names)}",
            worst="a campaign names recordings that are not in a page; put them where it expects them"
            if campaigns
            else "recordings and results are not in a page",
            next_step=f"seatrial check {folder}/{vehicle or names[0]}",
        )
    )
