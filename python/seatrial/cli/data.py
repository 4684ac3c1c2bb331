"""`seatrial data`: recordings of real vehicles that may be fetched, from their original source and by hash.

They are kept in the folder that the environment variable ``SEATRIAL_DATA`` names, else in a cache of the
user. A file counts only with its hash; it is fetched beside its place and renamed, never over another one.
Held by ``tests/cli/test_data_sets.py``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from seatrial.base.errors import TrialError, nearest, reason
from seatrial.base.files import VARIABLE, data_folder
from seatrial.base.run import sha256
from seatrial.cli.options import Json

if TYPE_CHECKING:
    from seatrial.base.report import Report


@dataclass(frozen=True)
class DataFile:
    """One file of a set: its name there, its hash and size in bytes, its URL or "" where no site has it."""

    name: str
    sha256: str
    size: int
    url: str = ""


@dataclass(frozen=True)
class DataSet:
    """Recordings that belong together: folder in the data folder, what they are, whose they are."""

    folder: str
    description: str
    licence: str
    files: tuple[DataFile, ...]
    otherwise: str = ""


_BELUGA = (
    "https://raw.githubusercontent.com/michoy/system_identification/"
    "34055c8df837d510f03a394d891b96d1e556cb1c/data/synchronized/"
)
_PIER = (
    "https://raw.githubusercontent.com/clydemcqueen/guided_above_terrain/"
    "3276cc2e15f7d4a0771aa2ff0c4dc8b7c22976de/logs/"
)

_DIVE = "ca9b387712f320df9b099e8533289e9aaa354a2408ad3afca930d593093f5bf4"
_T200 = "b5d3cc4f8946d4820403d52a617d86ab22f79a64bbd911377bb763489ce0b3c7"

DATA_SETS: dict[str, DataSet] = {
    "beluga": DataSet(
        "beluga",
        "AUV Beluga (Vortex NTNU), five trials in a tank, 30 April 2021",
        "MIT, (c) 2021 Vortex NTNU",
        tuple(
            DataFile(f"synchronized-{name}.csv", digest, size, f"{_BELUGA}{name}.csv")
            for name, digest, size in (
                ("surge-1", "0b00ea639ea8711b29c38501b2aedff31261710fd35814fb84ceec8543b39e51", 3_943_670),
                ("sway-1", "8977039e870206ab55e4e11b4663d52218a205943312929997a62e25a0e08912", 3_953_523),
                ("heave-1", "7206580e46010552c0deb9fb899e6a48b1c135c21ef62b26ce7045ca0dd0aaa3", 1_347_178),
                ("yaw-1", "3ebe5b62490772f94f2f6930c2003381d9e6f58b14f0b42adfe0c8d8780c8ac1", 3_251_872),
                ("random-1", "66f7289851392d387502dfaae1b102bd14978cfb3c1038d88734cc9e387f7209", 3_424_345),
            )
        ),
    ),
    "t200": DataSet(
        "t200",
        "bollard thrust of the T200 thruster at 10 to 20 V (September 2019)",
        "public performance data of Blue Robotics",
        (DataFile("t200_bollard_10_20V.csv", _T200, 70_557),),
        otherwise="the maker publishes a spreadsheet, of which this table is the export; name a mirror that"
        " has the table with --from",
    ),
    "bluerov2": DataSet(
        "bluerov2_heavy",
        "BlueROV2 Heavy, sea trial at Pier 59, Seattle, 7 January 2026: ArduSub log of 200 s",
        "MIT, (c) 2026 Clyde McQueen",
        (DataFile("00000029_filtered.BIN", _DIVE, 3_399_467, f"{_PIER}00000029_filtered.BIN"),),
    ),
}
"""By name."""


def get(
    name: str, *, source: str | None = None, begin: Callable[[DataFile], None] = lambda file: None
) -> dict[Path, bool]:
    """Files of a data set in the data folder, and whether each was fetched; True if so.

    `name`: a name in `DATA_SETS`; `source`: URL under which a mirror has ``<folder>/<file>``, instead of the
    original source; `begin`: called with each file before it is fetched. Raises `TrialError`: there is no
    such set, a file that is there is another one, or one cannot be fetched as it should be.
    """
    if name not in DATA_SETS:
        raise TrialError(f'data: there is no data set "{name}"{nearest(name, DATA_SETS)}')
    if source is not None and not source.startswith(("http://", "https://")):
        raise TrialError(f"--from {source}: expected a URL that begins with https:// or http://")
    chosen, folder = DATA_SETS[name], data_folder() / DATA_SETS[name].folder
    fetched: dict[Path, bool] = {}
    for file in chosen.files:
        path = folder / file.name
        # A file that is there is never replaced: it may be somebody's own.
        if present := path.is_file():
            if (digest := _digest(path)) != file.sha256:
                raise TrialError(
                    f"{path}: expected SHA-256 {file.sha256}, found {digest}: another or a damaged file;"
                    " move it away and get it again"
                )
        else:
            url = f"{source.rstrip('/')}/{chosen.folder}/{file.name}" if source else file.url
            if not url:
                raise TrialError(f"{path}: no site has this file: {chosen.otherwise}")
            begin(file)
            _fetch(url, file, folder)
        fetched[path] = not present
    return fetched


def _digest(path: Path) -> str:
    try:
        return sha256(path.read_bytes())
    except OSError as error:
        raise TrialError(f"{path}: cannot be read ({reason(error)}); move it away") from None


def _fetch(url: str, file: DataFile, folder: Path) -> None:
    """Fetch a file and check its hash; raises `TrialError` with what to do."""
    import pooch
    from requests.exceptions import RequestException

    pooch.get_logger().setLevel("ERROR")
    try:
        pooch.retrieve(
            url, f"sha256:{file.sha256}", file.name, folder, downloader=partial(_download, most=file.size)
        )
    except RequestException as error:
        raise TrialError(
            f"{url}: cannot be fetched ({error}); check the network, or name a mirror with --from"
        ) from None
    except TrialError:
        raise
    except ValueError:  # a hash that differs
        raise TrialError(
            f"{url}: expected a file with SHA-256 {file.sha256}, found another one; nothing was kept. Name"
            " another mirror with --from"
        ) from None
    except OSError as error:
        raise TrialError(
            f"{folder / file.name}: cannot be written ({reason(error)}); set {VARIABLE} to a folder that you"
            " may write to"
        ) from None


def _download(url: str, output_file: Any, pooch: Any, *, most: int) -> None:
    """Write what a URL gives to a file, no more than a file of this size can hold."""
    import requests

    written = 0
    with requests.get(url, stream=True, timeout=30.0) as answer, Path(output_file).open("wb") as stream:
        answer.raise_for_status()
        for chunk in answer.iter_content(1 << 16):
            written += len(chunk)
            if written > most:
                raise TrialError(
                    f"{url}: expected {most} bytes, found more: another file; name a mirror with --from"
                )
            stream.write(chunk)


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
