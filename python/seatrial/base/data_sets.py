"""Recordings of real vehicles that may be fetched: their original source, size, SHA-256 and licence.

They are kept in the folder that the environment variable ``SEATRIAL_DATA`` names, else in a cache of the
user. A file counts only with its hash; it is fetched beside its place and renamed, never over another one.
Held by ``tests/base/test_data_sets.py``.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from seatrial.base.errors import TrialError, nearest, reason
from seatrial.base.run import sha256

VARIABLE = "SEATRIAL_DATA"


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
        (
            DataFile(
                "t200_bollard_10_20V.csv",
                "b5d3cc4f8946d4820403d52a617d86ab22f79a64bbd911377bb763489ce0b3c7",
                70_557,
            ),
        ),
        otherwise="the maker publishes a spreadsheet, of which this table is the export; name a mirror that"
        " has the table with --from",
    ),
    "bluerov2": DataSet(
        "bluerov2_heavy",
        "BlueROV2 Heavy, sea trial at Pier 59, Seattle, 7 January 2026: ArduSub log of 200 s",
        "MIT, (c) 2026 Clyde McQueen",
        (
            DataFile(
                "00000029_filtered.BIN",
                "ca9b387712f320df9b099e8533289e9aaa354a2408ad3afca930d593093f5bf4",
                3_399_467,
                f"{_PIER}00000029_filtered.BIN",
            ),
        ),
    ),
}
"""By name."""


def data_folder() -> Path:
    """Folder of recordings: that of ``SEATRIAL_DATA``, else a cache of the user."""
    if given := os.environ.get(VARIABLE):
        return Path(given)
    import pooch

    return Path(pooch.os_cache("seatrial"))


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
