"""What a run directory says, read for a page: its report, what it rests on, its files and its figures.

Held by ``tests/report/test_page.py``.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from seatrial.base.errors import SeatrialError
from seatrial.base.file_names import content_inside
from seatrial.base.report import REPORT_FILE, Report, Section
from seatrial.base.run import RUN_FILE, from_json

INPUTS = ("vehicle.toml", "autopilot.toml", "mission.toml", "campaign.toml", "bench.toml", "tuning.toml")
"""Files of a run that a page carries as they are, beside those in ``missions/`` and others that end so."""

_RESULTS = {
    "identification": "identification.json",
    "tuning": "tuning.json",
    "verification": "verification.json",
    "log verdict": "verdict.json",
    "flight": "flight.json",
    "bench test": "bench.json",
    "plan": "plan.json",
    "leave one out": "leave_one_out.json",
}

_VERDICTS = ("held", "complete")

_OUTCOMES = {"held": True, "failed": False, "undecided": False, "not judged": False, "falsified": False}
"""What an outcome says that is a word; a search that falsified nothing proves nothing."""

_LARGEST_SVG = 150_000
"""Bytes of an SVG from which on its PNG is taken, if that is a third smaller: thousands of points."""

_LARGEST_FILE = 2**20
"""Bytes of an input file that a page carries."""

_LARGEST_FIGURE, _LARGEST_FIGURES = 16 * 2**20, 64 * 2**20
"""Bytes of a figure, and of all: seatrial draws some hundred kilobytes, and a browser shows no more."""

_LARGEST_JSON = 256 * 2**20
"""Bytes of a result: ten thousand missions take some 20 MB."""


@dataclass(frozen=True)
class Figure:
    """A figure of a run: the stem of its file, its ending ("svg" or "png") and its content."""

    name: str
    ending: str
    content: bytes


@dataclass(frozen=True)
class RunFolder:
    """One run as a page shows it.

    Attributes
    ----------
    name
        Of the folder.
    facts
        Content of ``run.json``, see `seatrial.base.run.run_facts`.
    report
        How good, the worst problem, what next, tables and sentences.
    results
        Results as plain data; empty where there are none.
    files
        Input files by path inside the folder, as they are.
    figures
        By the time at which they were drawn.
    path
        The folder; None for a run that was not written.
    """

    name: str
    facts: Mapping[str, Any]
    report: Report
    results: Mapping[str, Any] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)
    figures: tuple[Figure, ...] = ()
    path: Path | None = None

    @classmethod
    def read(cls, folder: str | Path) -> RunFolder:
        """Run of a run directory.

        Raises
        ------
        SeatrialError
            The folder is none, or a file in it is broken.
        """
        path = Path(folder)
        if not path.is_dir():
            what = "a file" if path.exists() else "nothing"
            raise SeatrialError(
                f"{path}: expected a run directory, found {what}; give the folder that a command named"
                " after 'Results in'"
            )
        if not (path / RUN_FILE).is_file():
            inside = [file.parent.name for file in sorted(path.glob(f"*/{RUN_FILE}"))]
            there = (
                f"; there are runs in it: {', '.join(str(path / name) for name in inside)}" if inside else ""
            )
            raise SeatrialError(f"{path}: expected a run directory, found no {RUN_FILE} in it{there}")
        facts = _facts(path / RUN_FILE)
        results = path / _RESULTS.get(facts["kind"], "")
        return cls(
            name=path.resolve().name,
            facts=facts,
            report=_report(path, facts),
            results=_read_json(results) if results != path and os.path.lexists(results) else {},
            files=_inputs(path),
            figures=figures_of(path),
            path=path,
        )

    @property
    def kind(self) -> str:
        """What kind of run: "identification", "flight" and so on."""
        return str(self.facts.get("kind", "run"))

    @property
    def held(self) -> bool | None:
        """The verdict, where the run has one."""
        verdicts = [self.results[key] for key in _VERDICTS if isinstance(self.results.get(key), bool)]
        if verdicts:
            return bool(verdicts[0])
        return _OUTCOMES.get(str(self.results.get("outcome", self.report.outcome)))


def figures_of(folder: Path) -> tuple[Figure, ...]:
    """Figures of a run directory: of each name the SVG, or the PNG where it is alone or far smaller."""
    best: dict[str, Path] = {}
    for place in (folder / "figures", folder):
        for ending in ("svg", "png"):
            drawn = [path for path in place.glob(f"*.{ending}") if not path.is_dir()]
            for path in sorted(drawn, key=_drawn_at):
                known = best.setdefault(path.stem, path)
                size, other = known.lstat().st_size, path.lstat().st_size
                if size > _LARGEST_SVG and other < 0.7 * size:
                    best[path.stem] = path
    figures, left = [], _LARGEST_FIGURES
    for path in sorted(best.values(), key=_drawn_at):
        content = content_inside(folder, path, most=min(_LARGEST_FIGURE, left))
        left -= len(content)
        if (why := refused(content, path.suffix[1:])) is not None:
            raise SeatrialError(f"{path}: {why}; remove this figure, or repeat the run")
        figures.append(Figure(path.stem, path.suffix[1:], content))
    return tuple(figures)


def _drawn_at(path: Path) -> tuple[float, str]:
    return path.lstat().st_mtime, path.name


_MOST_PIXELS = 50_000_000
"""Of a picture: 50 times what a screen shows."""


def refused(content: bytes, ending: str) -> str | None:
    """Why a figure is none that a page shows; None for one that is.

    Examples
    --------
    >>> refused(b"<svg><!-- begun", "svg")
    'a comment in it has no end'
    """
    if ending == "png" and not content.startswith(b"\x89PNG"):  # shown as it is: no browser reads it
        return None
    if ending == "png":  # width and height stand first
        width, height = (int.from_bytes(content[at : at + 4], "big") for at in (16, 20))
        if width * height > _MOST_PIXELS:
            return f"expected a picture of at most {_MOST_PIXELS:,} pixels, found {width:,} by {height:,}"
        return None
    try:
        text = content.decode()
    except UnicodeDecodeError:
        return "expected an SVG in UTF-8, found other bytes"
    for begin, end, what in (("<!--", "-->", "a comment"), ("<metadata>", "</metadata>", "the metadata")):
        if text.rfind(begin) > text.rfind(end):
            return f"{what} in it has no end"
    return None


def _inputs(folder: Path) -> dict[str, str]:
    named = [path for name in INPUTS if os.path.lexists(path := folder / name)]
    more = [*sorted((folder / "missions").glob("*.toml")), *sorted(folder.glob("*.toml"))]
    files: dict[str, str] = {}
    for path in [*named, *(path for path in more if path not in named)]:
        if not path.is_dir() and path.lstat().st_size <= _LARGEST_FILE:
            files[path.relative_to(folder).as_posix()] = _text(folder, path, _LARGEST_FILE)
    return files


def _text(folder: Path, path: Path, most: int) -> str:
    try:
        return content_inside(folder, path, most=most).decode()
    except UnicodeDecodeError:
        raise SeatrialError(f"{path}: cannot be read (not a text file in UTF-8)") from None


def _report(folder: Path, facts: Mapping[str, Any]) -> Report:
    """Report of a run; of one from before reports were kept as data, the three lines of its summary."""
    path = folder / REPORT_FILE
    if os.path.lexists(path):
        try:
            return Report.of_dict(_read_json(path))
        except (KeyError, TypeError, ValueError) as error:
            raise SeatrialError(
                f"{path}: expected a report as seatrial writes it, found {error!r}; repeat the run"
            ) from None
    summary = folder / "summary.txt"
    if not os.path.lexists(summary):
        raise SeatrialError(f"{folder}: expected {REPORT_FILE} or summary.txt, found neither; repeat the run")
    lines = _text(folder, summary, _LARGEST_FILE).splitlines()
    first, worst, next_step = (*(line.partition(": ")[2] for line in lines[:3]), "", "", "")[:3]
    outcome, _, good = first.partition(". ")
    return Report(
        title=str(facts.get("name", folder.name)),
        outcome=outcome or str(facts.get("kind", "run")),
        good=good,
        worst=worst,
        next_step=next_step,
        sections=(Section("Summary", tuple(line for line in lines[3:] if line.strip()), details=True),),
    )


_FACTS: Mapping[str, type | tuple[type, ...]] = {
    "kind": str,
    "name": str,
    "finished_utc": str,
    "wall_s": (int, float),
    "versions": dict,
    "sha256": dict,
    "options": dict,
}
"""Keys of ``run.json`` that a page shows."""


def _facts(path: Path) -> dict[str, Any]:
    """Content of ``run.json``: with a kind, and what else is there as a run writes it."""
    facts = _read_json(path)
    wrong = [
        key
        for key, kind in _FACTS.items()
        if not isinstance(facts.get(key), kind) and (key == "kind" or facts.get(key) is not None)
    ]
    if wrong:
        wrong_entries = [f"{key} {facts[key]!r:.40}" if key in facts else f"no {key}" for key in wrong]
        raise SeatrialError(
            f"{path}: expected the facts of a run as seatrial writes them, found {', '.join(wrong_entries)};"
            " repeat the run"
        )
    return facts


def _read_json(path: Path) -> dict[str, Any]:
    try:
        content = from_json(_text(path.parent, path, _LARGEST_JSON))
    except ValueError as error:
        raise SeatrialError(f"{path}: expected JSON, found none ({error}); repeat the run") from None
    if not isinstance(content, dict):
        raise SeatrialError(f"{path}: expected a JSON object, found {type(content).__name__}; repeat the run")
    return content
