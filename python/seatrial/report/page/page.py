"""Runs as one HTML file: the first screen, the evidence, what all of it rests on, and the files themselves.

The page needs no network and, to be read, no script. Figures are SVG where the run has them, else PNG. Files
are JSON, ``[{"path", "sha256", "text"}]``, in the script element ``seatrial-files``. Who reads a page back
trusts nothing in it: every path must be a plain relative one of known endings, every text must have its hash,
and files go to a new folder only. Held by ``tests/report/test_page.py`` and
``tests/report/test_page_tables.py``.
"""

from __future__ import annotations

import base64
import io
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from html.parser import HTMLParser
from importlib.resources import files as resources
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.budget import Budget, guarded
from seatrial.base.errors import SeatrialError, reason
from seatrial.base.files import file_name, free_name, no_file, whole_folder, write_atomic, writing
from seatrial.base.report import Column, Table
from seatrial.base.run import from_json, sha256, to_json, version
from seatrial.report.page.evidence import evidence
from seatrial.report.page.flying import core, setups
from seatrial.report.page.run_folder import Figure, RunFolder, compared, numbers

if TYPE_CHECKING:
    from jinja2 import Environment


@dataclass(frozen=True)
class PageSettings:
    """How large a page is, and what it names."""

    #: Bytes of a page that mail still takes; a larger one is written all the same and named by the command.
    largest_bytes: int = 8_000_000
    strong: float = 0.3  #: Size of a correlation from which on it is named.
    named: int = 3  #: Correlations of a coefficient, so that a row fits a screen.


PAGE_SETTINGS = PageSettings()

_PAGE = Budget(cpu_s=120.0, memory_mb=2_000.0)
"""What a page may cost: a run that others made may hold anything. One of ten runs takes some seconds."""

_FIGURES = {
    "vehicle": "The vehicle in three views, its centres, and its actuators with arrows of positive force",
    "characteristic": "Thrust against the command of every actuator",
    "convergence": "Cost of each stage's search above its best, over the candidates tried",
    "intervals": "Standard deviations of the coefficients and how they depend on one another",
    "residual_analysis": "What the model leaves unexplained, and which missing term would help",
    "track": "Track of the mission, flown and planned",
    "errors": "Errors along the mission",
    "loops": "Set points and responses of the control loops",
    "actuators": "Commands and signals of the actuators",
    "margins": "Stability margins of the loops",
    "speeds": "Speeds at which the loops were tuned",
    "requirements": "Requirements and how surely they are held",
    "cross_track": "Cross-track error over all missions",
    "bollard_test": "Thrust measured on the bench and fitted",
    "residuals": "What was measured on the mission less what the model predicts, in the model's 95 % band",
    "envelope": "The recorded mission in the envelope of simulated ones",
}

_BEGINNINGS = {
    "trial_": "Measured and simulated, restarted every ten seconds, in the trial",
    "corridor_": "Corridor and responses of the loop",
    "responses_": "Step responses over the set points of the loop",
    "causes_": "What the missions that miss the requirement have in common",
    "worst_": "The worst mission for the requirement",
    "motor_": "Step of the motor",
}

_NO_CORE = "This seatrial was built without the page's core, so nothing flies here; make build adds it."

_FOLDERS = re.compile(r"(?<![\w:/.])/(?:[\w.+@-]+/)+(?=[\w.+@-])")

_LONG_PATH = re.compile(r' d="([^"]{300,})"')

_PLACE = re.compile(r'( [xy]="-?\d+\.\d\d)\d+')

_DIGITS = re.compile(r"(?<!\d)(\d+\.\d)\d+")  # from the first digit on: else a long number is read often


def page(runs: Sequence[RunFolder], *, title: str = "") -> str:
    """HTML of a page with these runs, at least one, in the order in which they are told."""
    series = [evidence(run) for run in runs]
    parts = [
        _part(run, number, shown=bool(own))
        for number, (run, own) in enumerate(zip(runs, series, strict=True), 1)
    ]
    for part in parts:  # two of a kind are told apart
        if [part["kind"] for part in parts].count(part["kind"]) > 1:
            part["short"] = f"{part['kind']} {part['name']}"
    files = _files(runs)
    packed = core()
    flying, grounded = setups(runs) if packed else ([], [_NO_CORE])
    return (
        _environment()
        .get_template("page.html.j2")
        .render(
            title=title or ", ".join(dict.fromkeys(run.report.title for run in runs)),
            version=version("seatrial"),
            parts=parts,
            numbers=numbers(runs),
            compared=compared(runs),
            views=_views(runs),
            files=as_embedded(files),
            files_id=ELEMENT,
            files_json=script_json(as_embedded(files)),
            style=_resource("page.css"),
            flying=script_json(flying) if flying else "",
            grounded=grounded,
            coefficients=_coefficients(runs, flying),
            third_parties=third_parties(),
            core=packed,
            evidence=script_json(series),
            worker=_resource("worker.js"),
            scripts="".join(map(_resource, ("charts.js", "loops.js", "page.js"))),
        )
    )


def write_page(folders: Sequence[str | Path | RunFolder], out: str | Path, *, title: str = "") -> Path:
    """Path of the page with run directories, or runs that were read, written whole or not at all."""
    target = check_place(out)
    names = ", ".join(str(folder.name if isinstance(folder, RunFolder) else folder) for folder in folders)
    remedy = "the folder holds what seatrial does not write: repeat the run"
    with guarded(names, "the page", remedy, budget=_PAGE, refusal=SeatrialError):
        runs = [folder if isinstance(folder, RunFolder) else RunFolder.read(folder) for folder in folders]
        text = page(runs, title=title)
    try:
        write_atomic(target, text.encode())
    except OSError as error:
        raise SeatrialError(
            f"{target}: the page cannot be written ({reason(error)}); choose a place that you may write to"
        ) from None
    return target


def check_place(out: str | Path) -> Path:
    """Path of a page to be, refused where it cannot be written."""
    target = Path(out)
    if target.suffix.lower() not in (".html", ".htm"):
        raise SeatrialError(f'{target}: expected a page ending in .html, found "{target.suffix}"; rename it')
    if target.is_dir():
        raise SeatrialError(f"{target}: expected the name of a page, found a folder; give another name")
    if not target.absolute().parent.is_dir():
        raise SeatrialError(f"{target}: there is no folder {target.parent}; make it or give another name")
    return target


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    made = Environment(
        loader=PackageLoader("seatrial.report.page", ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    # What is told of a run names files, not the folders of a machine.
    made.filters["placeless"] = lambda text: _FOLDERS.sub("", text)
    return made


def _resource(name: str) -> str:
    return resources("seatrial.report.page").joinpath(name).read_text(encoding="utf-8")


def _part(run: RunFolder, number: int, *, shown: bool) -> dict[str, Any]:
    """What the template shows of a run."""
    lines = [line.partition(": ")[2] for line in run.report.lines()]
    good = lines[0].removeprefix(f"{run.report.outcome}. ")
    sections = list(run.report.shown())
    facts = {
        key: run.facts.get(key)
        for key in ("kind", "name", "seed", "started_utc", "finished_utc", "simd", "platform")
    }
    facts["wall time, s"] = f"{float(run.facts.get('wall_s') or 0.0):.1f}"
    return {
        "id": f"run-{number}",
        "kind": run.kind,
        "short": run.kind,
        "name": run.name,
        "report": run.report,
        "good": good,
        "worst": lines[1],
        "next_step": lines[2],
        # A verdict with reservations gets no tick: its outcome says which.
        "held": None if run.held and run.results.get("reservations") else run.held,
        "baselines": baselines(run),
        "intervals": intervals(run),
        "sections": [section for section in sections if not section.details],
        "details": [section for section in sections if section.details],
        "evidence": shown,
        # The three views stand on the first screen.
        "figures": [_shown(figure, run.name) for figure in run.figures if figure.name != "vehicle"],
        "facts": {key: value for key, value in facts.items() if value not in (None, "")},
        "versions": dict(run.facts.get("versions") or {}),
        "sha256": dict(run.facts.get("sha256") or {}),
        "options": to_json(run.facts.get("options") or {}).strip(),
    }


def _views(runs: Sequence[RunFolder]) -> list[dict[str, str]]:
    """Three views of every vehicle of the runs: its name, and the source of an image."""
    views: dict[str, Figure] = {}
    for run in runs:
        if (text := run.files.get("vehicle.toml")) is not None and (drawn := _three_views(text)) is not None:
            views.setdefault(drawn.name, drawn)
    return [{"name": name, "source": _source(figure)} for name, figure in views.items()]


def _coefficients(runs: Sequence[RunFolder], flying: Sequence[Mapping[str, Any]]) -> Mapping[str, str]:
    """Meaning of the vehicles' coefficients, of those that are not zero or can be changed in flight."""
    from seatrial._core import Vehicle

    changeable = {slider["name"] for setup in flying for slider in setup["coefficients"]}
    meanings: dict[str, str] = {}
    for run in runs:
        if (text := run.files.get("vehicle.toml")) is None:
            continue
        try:
            vehicle = Vehicle.from_toml(text)
        except SeatrialError:  # of another version
            continue
        values = vehicle.coefficients()
        for name, facts in vehicle.coefficient_info().items():
            if name in changeable or values.get(name):
                meanings.setdefault(name, f"{facts['description']}, {facts['unit']}")
    return meanings


def third_parties() -> dict[str, dict[str, list[str]]]:
    """Names and versions of what others wrote, by licence: the crates in the core that flies here, and the
    Python packages of this machine that seatrial asks for. `docs/site/notices.py` writes the list.
    """
    parts = json.loads(_resource("third_party.json"))
    compiled: dict[str, list[str]] = {}
    for name, number, licence in parts["crates"]:
        compiled.setdefault(_spdx(licence), []).append(f"{name} {number}")
    installed: dict[str, list[str]] = {}
    for name, licence in parts["packages"].items():
        if (number := version(name)) != "unknown":  # an extra that is not installed
            installed.setdefault(licence, []).append(f"{name} {number}")
    return {"Rust crates in the core": compiled, "Python packages": installed}


def _spdx(licence: str) -> str:
    """A choice of licences in one order: crates write it in any, older ones with a stroke."""
    return " OR ".join(sorted(re.split(r"/| OR ", licence))) if " AND " not in licence else licence


def _three_views(text: str) -> Figure | None:
    from seatrial._core import Vehicle
    from seatrial.base.errors import VehicleError
    from seatrial.report.plot.style import house_style
    from seatrial.report.plot.vehicle import three_views

    try:
        vehicle = Vehicle.from_toml(text)
    except VehicleError:  # of another version; the page still tells the rest
        return None
    content = io.BytesIO()
    with house_style():
        three_views(vehicle).savefig(content, format="svg", metadata={"Date": None})
    return Figure(vehicle.name, "svg", content.getvalue())


def _shown(figure: Figure, run: str) -> dict[str, str]:
    """Source, title and text instead of a figure."""
    words = _FIGURES.get(figure.name, "")
    for beginning, text in _BEGINNINGS.items():
        if not words and figure.name.startswith(beginning):
            words = f"{text} {figure.name.removeprefix(beginning).replace('_', ' ')}"
    name = figure.name.replace("_", " ")
    return {
        "source": _source(figure),
        "id": file_name(f"{run}-{figure.name}"),
        "title": name[:1].upper() + name[1:],
        "words": words or name[:1].upper() + name[1:],
    }


def _source(figure: Figure) -> str:
    """A figure as the source of an image element, without what none can see of an SVG."""
    if figure.ending == "png":
        return "data:image/png;base64," + base64.b64encode(_few_colours(figure.content)).decode()
    begin = max(figure.content.find(b"<svg"), 0)
    # Blanks first: a pattern that begins with any number of them reads a long run of them as often.
    text = re.sub(r"\s+", " ", figure.content[begin:].decode())
    text = _LONG_PATH.sub(_shortened, _PLACE.sub(r"\1", text))
    text = re.sub(r"<!--.*?-->|<metadata>.*?</metadata>", "", text)
    text = re.sub(r" +", " ", text).replace("> <", "><")
    for sign, code in (("%", "%25"), ("#", "%23"), ('"', "'")):
        text = text.replace(sign, code)
    return "data:image/svg+xml," + text


def _few_colours(png: bytes) -> bytes:
    """A picture with a palette of 64 colours, enough for lines and letters, where that is smaller."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(io.BytesIO(png), formats=["PNG"]) as image:
            content = io.BytesIO()
            image.convert("RGB").quantize(64, dither=Image.Dither.NONE).save(content, "png", optimize=True)
    except (OSError, UnidentifiedImageError, ValueError, SyntaxError):  # shown as it is, or not at all
        return png
    return min(content.getvalue(), png, key=len)


def _shortened(path: re.Match[str]) -> str:
    """A long path with one decimal, a 700th of an inch; short ones are letters and markers and stay."""
    text = re.sub(r"\s*([MLCQZ])\s*", r"\1", _DIGITS.sub(r"\1", path[1]))
    return f' d="{text.strip()}"'


def _files(runs: Sequence[RunFolder]) -> dict[str, str]:
    """Files of all runs by path, in a folder per run where there are several; equal ones once."""
    files: dict[str, str] = {}
    seen: set[str] = set()
    for run in runs:
        above = [] if len(runs) == 1 else [_plain(run.name)]
        for path, text in run.files.items():
            digest = sha256(f"{Path(path).name}\0{text}")
            if digest in seen:
                continue
            seen.add(digest)
            *folders, name = path.removesuffix(".toml").split("/")
            inside = "/".join([*above, *map(_plain, folders), _plain(name)])
            taken = [place.removesuffix(".toml") for place in files]
            files[free_name(inside, taken) + ".toml"] = text
    return files


def _plain(name: str) -> str:
    """A name of ASCII letters, digits, - and _ that a page may carry."""
    return file_name(name.encode("ascii", "replace").decode())


def baselines(run: RunFolder) -> list[dict[str, Any]]:
    """Per channel R2 on held-out data of the model and of the best simple predictor."""
    try:
        rivals = run.results["baselines"]
        ahead = run.results["scores"]["hold_out"]["ahead"]
        scores = (ahead["all"] if "all" in ahead else next(iter(ahead.values())))["channels"]
        rows = []
        for channel, score in scores.items():
            given = {name: rival[channel] for name, rival in rivals.items() if rival.get(channel) is not None}
            if not given or not isinstance(score, dict) or score.get("r2") is None:
                continue
            best = max(given, key=lambda name: float(given[name]))
            rows.append({"channel": channel, "model": score["r2"], "rival": best, "r2": given[best]})
    except (KeyError, TypeError, AttributeError):
        return []
    return rows


def intervals(run: RunFolder) -> Table | None:
    """Estimates with 95 % intervals and the coefficients they depend on most; None where none is known."""
    if run.kind != "identification":
        return None
    try:
        near = _correlated(run.results.get("covariance"))
        rows = [
            (
                coefficient["name"],
                coefficient["unit"],
                _digits(coefficient["estimate"]),
                *(_digits(end) for end in coefficient["interval"]),
                coefficient.get("verdict") or "",
                near.get(coefficient["name"], ""),
            )
            for coefficient in run.results.get("coefficients", ())
            if coefficient.get("interval") and None not in coefficient["interval"]
        ]
    except (KeyError, TypeError, ValueError):  # of another version
        return None
    heads = ("coefficient", "unit", "estimate", "95 % from", "to", "verdict", "depends most on (correlation)")
    columns = tuple(
        Column(head, align="right" if head in ("estimate", "95 % from", "to") else "left") for head in heads
    )
    title = "Intervals of the coefficients, and their correlations"
    note = f"Correlations of a size from {PAGE_SETTINGS.strong:g} on, the {PAGE_SETTINGS.named} largest."
    return Table(title, columns, tuple(rows), note=note) if rows else None


def _correlated(covariance: Any) -> dict[str, str]:
    """Per coefficient the others that its estimate depends on most, with their correlations."""
    if not covariance or not covariance.get("names"):
        return {}
    names, matrix = list(covariance["names"]), np.array(covariance["matrix"], float)
    size = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    scale = np.where(size > 0.0, size, 1.0)
    correlations = matrix / np.outer(scale, scale) - np.eye(len(names))
    strongest = {}
    for name, row in zip(names, correlations, strict=True):
        order = [k for k in np.argsort(-np.abs(row)) if abs(row[k]) >= PAGE_SETTINGS.strong][
            : PAGE_SETTINGS.named
        ]
        strongest[name] = ", ".join(f"{names[k]} {row[k]:+.2f}".replace("-", "\N{MINUS SIGN}") for k in order)
    return strongest


def _digits(value: float) -> str:
    return f"{value:.4g}".replace("-", "\N{MINUS SIGN}")


ELEMENT = "seatrial-files"
"""The id of the script element."""


@dataclass(frozen=True)
class EmbeddedSettings:
    """How large a page may be that files are taken out of."""

    largest_page: int = 64 * 2**20  #: Bytes; seatrial warns of a page above 8 MB.
    most_files: int = 200  #: A page of ten runs has some dozens.


EMBEDDED_SETTINGS = EmbeddedSettings()

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
        if path.stat().st_size > EMBEDDED_SETTINGS.largest_page:
            raise SeatrialError(
                f"{path}: expected at most {EMBEDDED_SETTINGS.largest_page >> 20} MiB, found"
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
    if not isinstance(entries, list) or not entries or len(entries) > EMBEDDED_SETTINGS.most_files:
        raise SeatrialError(
            f"{path}: expected a list of 1 to {EMBEDDED_SETTINGS.most_files} files in it, found something"
            " else"
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
