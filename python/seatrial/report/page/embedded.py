"""Files inside a page: how they are put there, and how they come out again without harm.

A page carries its files as JSON, ``[{"path", "sha256", "text"}]``, in the script element ``seatrial-files``.
Who reads a page back trusts nothing in it: every path must be a plain relative one of known endings, every
text must have its hash, and files go to a new folder only. Held by ``tests/report/test_page.py``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from html.parser import HTMLParser
from pathlib import Path, PurePosixPath
from typing import Any

from seatrial.base.errors import SeatrialError, reason
from seatrial.base.files import no_file, whole_folder, write_atomic, writing
from seatrial.base.run import from_json, sha256

ELEMENT = "seatrial-files"
"""The id of the script element."""


@dataclass(frozen=True)
class EmbeddedSettings:
    """How large a page may be that files are taken out of."""

    largest_page: int = 64 * 2**20  #: Bytes; seatrial warns of a page above 8 MB.
    most_files: int = 200  #: A page of ten runs has some dozens.


SETTINGS = EmbeddedSettings()

_PATH = re.compile(r"[A-Za-z0-9_+-][A-Za-z0-9_.+-]{0,119}(/[A-Za-z0-9_+-][A-Za-z0-9_.+-]{0,119}){0,3}")
_DEVICES = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\.|$)", re.IGNORECASE)


def script_json(value: Any) -> str:
    """JSON that can stand in a script element: nothing in it ends the element or begins a comment."""
    text = json.dumps(value, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def as_embedded(files: Mapping[str, str]) -> list[dict[str, str]]:
    """Files by path as a page carries them."""
    return [{"path": path, "sha256": sha256(text), "text": text} for path, text in files.items()]


def files_of_page(page: str | Path) -> dict[str, str]:
    """Files by relative path that a page carries, each checked, or the page is refused."""
    path = Path(page)
    if wrong := no_file(path):
        raise SeatrialError(f"--from-report {path}: {wrong}; give the HTML file of a report")
    try:
        if path.stat().st_size > SETTINGS.largest_page:
            raise SeatrialError(
                f"{path}: expected at most {SETTINGS.largest_page >> 20} MiB, found"
                f" {path.stat().st_size / 2**20:.0f} MiB; this is no report"
            )
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SeatrialError(f"{path}: cannot be read as a page ({reason(error)})") from None
    # Only an HTML parser knows where the element ends; the files in it are JSON.
    scripts = _Scripts()
    scripts.feed(text)
    if len(scripts.texts) != 1:
        raise SeatrialError(
            f"{path}: expected one element with the id {ELEMENT}, found {len(scripts.texts)}; this is no page"
            " that seatrial report wrote"
        )
    try:
        entries = from_json(scripts.texts[0])
    except ValueError:
        raise SeatrialError(
            f"{path}: the files in it are cut off or changed; get the page again from who sent it"
        ) from None
    if not isinstance(entries, list) or not entries or len(entries) > SETTINGS.most_files:
        raise SeatrialError(
            f"{path}: expected a list of 1 to {SETTINGS.most_files} files in it, found something else"
        )
    # File systems that fold case would write one file over another.
    files: dict[str, str] = {}
    for entry in entries:
        name, content = _checked(path, entry)
        if name.casefold() in {other.casefold() for other in files}:
            raise SeatrialError(f"{path}: the file {name} is in it twice; this page was changed")
        files[name] = content
    parts = {other.casefold() for other in files}
    for name in files:
        if any(parent.as_posix().casefold() in parts for parent in PurePosixPath(name).parents):
            raise SeatrialError(f"{path}: {name} lies in what is also a file; this page was changed")
    return files


def unpack(page: str | Path, folder: str | Path) -> list[Path]:
    """Paths of the files of a page after they were written into a new or empty folder."""
    files, target = files_of_page(page), Path(folder)
    if target.is_symlink() or (target.exists() and (not target.is_dir() or any(target.iterdir()))):
        raise SeatrialError(f"{target}: expected an empty or a new folder, found files; choose another name")
    written = []
    with writing(target), whole_folder(target):
        for name, text in files.items():
            place = target.joinpath(*PurePosixPath(name).parts)
            place.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(place, text.encode())
            written.append(place)
    return written


def _checked(page: Path, entry: Any) -> tuple[str, str]:
    """Path and text of an entry."""
    match entry:
        case {"path": str(name), "sha256": str(digest), "text": str(text)}:
            pass
        case _:
            raise SeatrialError(f"{page}: a file in it has no path, hash or text; this page was changed")
    allowed = _PATH.fullmatch(name) and name.endswith(".toml")
    if not allowed or any(_DEVICES.match(part) or part.endswith(".") for part in name.split("/")):
        raise SeatrialError(
            f"{page}: expected paths such as missions/survey.toml in it, found {name[:80]!r}; nothing was"
            " written, this page is not to be trusted"
        )
    if sha256(text) != digest:
        raise SeatrialError(
            f"{page}: {name}: expected a text with the SHA-256 {digest[:12]}…, found"
            f" {sha256(text)[:12]}…; this page was changed after it was written, nothing was taken from it"
        )
    return name, text


class _Scripts(HTMLParser):
    """Texts of the script elements that carry files."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.texts: list[str] = []
        self._inside = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._inside = tag == "script" and ("id", ELEMENT) in attrs
        if self._inside:
            self.texts.append("")

    def handle_endtag(self, tag: str) -> None:
        self._inside = False

    def handle_data(self, data: str) -> None:
        if self._inside:
            self.texts[-1] += data
