"""What a run directory says, read for a page: its report, what it rests on, its files and its figures.

Two runs of a kind stand beside one another (`compared`): what came out, what went in; `numbers` are those of
the first screen. Held by ``tests/report/test_page.py`` and ``tests/report/test_compare.py``.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from seatrial.base.errors import SeatrialError
from seatrial.base.files import content_inside
from seatrial.base.report import REPORT_FILE, Report, Section, Table
from seatrial.base.run import RUN_FILE, from_json
from seatrial.report.results.tuning import gain_unit

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


@dataclass(frozen=True)
class RunFolderSettings:
    """How much of a run directory a page takes, which may come from a stranger."""

    #: Bytes of an SVG from which on its PNG is taken, if that is a third smaller: thousands of points.
    largest_svg: int = 150_000
    largest_file: int = 2**20  #: Bytes of an input file.
    largest_figure: int = 16 * 2**20  #: Bytes of a figure: seatrial draws some hundred kilobytes.
    largest_figures: int = 64 * 2**20  #: Bytes of all figures: a browser shows no more.
    largest_json: int = 256 * 2**20  #: Bytes of a result: ten thousand missions take some 20 MB.
    most_pixels: int = 50_000_000  #: Of a picture: 50 times what a screen shows.


SETTINGS = RunFolderSettings()


@dataclass(frozen=True)
class Figure:
    """A figure of a run: the stem of its file, its ending ("svg" or "png") and its content."""

    name: str
    ending: str
    content: bytes


@dataclass(frozen=True)
class RunFolder:
    """One run as a page shows it: the name of its folder, which is None for a run that was not written.

    `facts` are the content of ``run.json`` (`seatrial.base.run.run_facts`), `results` plain data, `files` the
    input files by path inside the folder; figures stand by the time at which they were drawn.
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
        """Run of a run directory, refused where the folder is none or a file in it is broken."""
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
                if size > SETTINGS.largest_svg and other < 0.7 * size:
                    best[path.stem] = path
    figures, left = [], SETTINGS.largest_figures
    for path in sorted(best.values(), key=_drawn_at):
        content = content_inside(folder, path, most=min(SETTINGS.largest_figure, left))
        left -= len(content)
        if (why := refused(content, path.suffix[1:])) is not None:
            raise SeatrialError(f"{path}: {why}; remove this figure, or repeat the run")
        figures.append(Figure(path.stem, path.suffix[1:], content))
    return tuple(figures)


def _drawn_at(path: Path) -> tuple[float, str]:
    return path.lstat().st_mtime, path.name


def refused(content: bytes, ending: str) -> str | None:
    """Why a figure is none that a page shows; None for one that is."""
    if ending == "png" and not content.startswith(b"\x89PNG"):  # shown as it is: no browser reads it
        return None
    if ending == "png":  # width and height stand first
        width, height = (int.from_bytes(content[at : at + 4], "big") for at in (16, 20))
        if width * height > (most := SETTINGS.most_pixels):
            return f"expected a picture of at most {most:,} pixels, found {width:,} by {height:,}"
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
        if not path.is_dir() and path.lstat().st_size <= SETTINGS.largest_file:
            files[path.relative_to(folder).as_posix()] = _text(folder, path, SETTINGS.largest_file)
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
    lines = _text(folder, summary, SETTINGS.largest_file).splitlines()
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
        content = from_json(_text(path.parent, path, SETTINGS.largest_json))
    except ValueError as error:
        raise SeatrialError(f"{path}: expected JSON, found none ({error}); repeat the run") from None
    if not isinstance(content, dict):
        raise SeatrialError(f"{path}: expected a JSON object, found {type(content).__name__}; repeat the run")
    return content


Numbers = list[tuple[str, str, str]]
"""Name, value and unit."""


def numbers(runs: Sequence[RunFolder]) -> Numbers:
    """At most four numbers of the first screen, of the last run first: name, value, unit."""
    shown: Numbers = []
    for run in reversed(runs):
        shown += _numbers(run)
    return shown[:4]


def _numbers(run: RunFolder) -> Numbers:
    try:
        return _NUMBERS[run.kind](run.results)
    except (KeyError, TypeError, ValueError, AttributeError):  # another kind, or another version
        return []


def _of_flight(results: Mapping[str, Any]) -> Numbers:
    metrics, legs = results["metrics"], results["legs"]
    named = (
        ("true cross-track error, rms", "true_cross_track_rms_m", "m"),
        ("nearest to an obstacle", "clearance_m", "m"),
        ("time of the mission", "duration_s", "s"),
        ("energy", "energy_wh", "Wh"),
        ("way over ground", "distance_m", "m"),
    )
    reached = f"{sum(leg['reached'] for leg in legs)} of {len(legs)}"
    known = [(name, f"{metrics[key]:.3g}", unit) for name, key, unit in named if metrics.get(key)]
    return [("waypoints reached", reached, ""), *known][:4]


def _of_verification(results: Mapping[str, Any]) -> Numbers:
    asked = results["requirements"]
    worst = max(asked, key=lambda own: float(own["at_most"]))
    held_count = sum(own["verdict"] == "held" for own in asked)
    return [
        ("requirements held", f"{held_count} of {len(asked)}", ""),
        ("missions flown", str(results["missions"]["flown"]), ""),
        (f'missions that miss "{worst["name"]}"', f"{100 * worst['failure_probability']:.2f}", "%"),
        (f"of these at most, {100 * worst['confidence']:.0f} % sure", f"{100 * worst['at_most']:.2f}", "%"),
    ]


def _of_tuning(results: Mapping[str, Any]) -> Numbers:
    (tuned,) = (own for own in results["performance"] if own["name"] == "tuned")
    margins = [own for own in results["margins"]["tuned"] if own["phase_deg"] is not None]
    least = min(margins, key=lambda own: float(own["phase_deg"]))
    held_count = sum(trial["held"] == 1.0 for trial in tuned["trials"])
    return [
        ("steps in their corridors", f"{held_count} of {len(tuned['trials'])}", ""),
        (f"least phase margin, {least['loop']}", f"{least['phase_deg']:.0f}", "deg"),
    ]


def _of_identification(results: Mapping[str, Any]) -> Numbers:
    coefficients = [own for own in results["coefficients"] if own.get("verdict")]
    sure = sum(own["verdict"] == "identifiable" for own in coefficients)
    ahead = results["scores"]["hold_out"]["ahead"]["all"]["channels"]
    known = {name: score["r2"] for name, score in ahead.items() if score.get("r2") is not None}
    best, worst = max(known, key=known.__getitem__), min(known, key=known.__getitem__)
    return [
        ("coefficients determined", f"{sure} of {len(coefficients)}", ""),
        (f"R² 10 s ahead on held-out data, best: {best}", f"{known[best]:.3f}", ""),
        (f"R² 10 s ahead on held-out data, worst: {worst}", f"{known[worst]:.3f}", ""),
    ]


_NUMBERS = {
    "flight": _of_flight,
    "identification": _of_identification,
    "tuning": _of_tuning,
    "verification": _of_verification,
}


def compared(runs: Sequence[RunFolder]) -> Report | None:
    """First and last run of a kind; an estimate moved beyond two deviations of both; None without two."""
    kinds = [run.kind for run in runs]
    again = [run for run in runs if kinds.count(run.kind) > 1]
    if not again:
        return None
    before, after = again[0], [run for run in again if run.kind == again[0].kind][-1]
    head = ("", before.name, after.name)
    first, last = (
        {name: f"{value} {unit}".strip() for name, value, unit in _numbers(run)} for run in (before, after)
    )
    results = [("outcome", before.report.outcome, after.report.outcome)]
    results += [(name, first.get(name, "none"), value) for name, value in last.items()]
    estimates = list(_estimates(before.results, after.results))
    gains = list(_gains(before.results, after.results))
    around = ({**run.facts, "in the water": run.results.get("circumstances")} for run in (before, after))
    inputs = list(_settings(*around))
    tables = (
        Table.of("Results", head, results),
        Table.of("Estimates", ("coefficient", "unit", *head[1:], "change", ""), estimates, left=2),
        Table.of("Gains that differ", ("gain", "unit", *head[1:]), gains, left=2),
        Table.of("Inputs and settings that differ", head, inputs),
    )
    # The change that says most: of an estimate, else of a result.
    moved = sorted(
        (row for row in estimates if row[-1] == "moved"), key=lambda row: -abs(float(row[4].rstrip("%")))
    )
    other = [f"{name}: {own} before, {value} after" for name, own, value in results if own != value]
    changes = [f"{row[0]}: {row[2]} before, {row[3]} {row[1]} after" for row in moved] + other
    counts = {
        "estimates moved beyond two standard deviations": (len(moved), len(estimates)),
        "gains differ": (len(gains), len(gains)),
        "inputs and settings differ": (len(inputs), 1),
    }
    return Report(
        title=f"{before.name} and {after.name}",
        outcome=f"{before.kind} before and after",
        good="; ".join(f"{count} {words}" for words, (count, known) in counts.items() if known),
        worst=changes[0] if changes else "no result differs",
        next_step="explain the changes by what differs" if inputs else "nothing: the inputs are the same",
        sections=(Section(tables=tables),),
    )


def _estimates(before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    """Coefficient, unit, both estimates with standard deviations, change in per cent, whether it moved."""
    first = {own["name"]: own for own in before.get("coefficients") or ()}
    for own in after.get("coefficients") or ():
        if (other := first.get(own["name"])) is None:
            yield own["name"], own["unit"], "not estimated", _estimate(own), "", "new"
            continue
        change, spread = own["estimate"] - other["estimate"], (own["sigma"], other["sigma"])
        far = None not in spread and abs(change) > 2.0 * math.hypot(*spread)
        share = f"{change / abs(other['estimate']):+.1%}" if other["estimate"] else "+inf%"
        yield own["name"], own["unit"], _estimate(other), _estimate(own), share, "moved" if far else ""


def _estimate(own: Mapping[str, Any]) -> str:
    sure = own.get("sigma") is not None
    return f"{own['estimate']:.4g} ± {own['sigma']:.2g}" if sure else f"{own['estimate']:.4g}"


def _gains(before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    first, second = ((own.get("gains") or {}).get("tuned") or {} for own in (before, after))
    for name in sorted({*first, *second}):
        if first.get(name) != second.get(name):
            yield (
                name,
                gain_unit(name),
                *(f"{own[name]:.4g}" if name in own else "none" for own in (first, second)),
            )


def _settings(before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    """Name, and what it was before and after: the beginning of a hash, or a setting."""
    for part, most in (("sha256", 12), ("options", 60), ("versions", 20), ("in the water", 60)):
        first, second = ((own.get(part) or {}) for own in (before, after))
        for name in sorted({*first, *second}):
            if first.get(name) != second.get(name):
                words = (str(own[name])[:most] if name in own else "none" for own in (first, second))
                yield f"{'SHA-256 of ' * (part == 'sha256')}{name}", *words
    if before.get("seed") != after.get("seed"):
        yield "seed", str(before.get("seed")), str(after.get("seed"))
