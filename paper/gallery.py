"""The figures of a paper about a vehicle: one folder, numbered files, a page with captions.

In the order of Taubert et al. (2014): outline, block diagrams of model and actuators, motor,
characteristics, schema of the optimisation, its results stage by stage, convergence; what is known beyond:
uncertainty, residual analysis, predictions of held-out trials; and the autopilot: structure, line of sight,
corridor and speed control, a flight. Everything that the data at hand allow is drawn, the rest is named with
the reason, and so is every figure of the paper that has none here. Held by
`tests/examples/test_paper_figures.py`.
"""

from __future__ import annotations

import html
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from paper.autopilot import autopilot_plates
from paper.plates import (
    Plate,
    bench_plates,
    campaign_plates,
    cited,
    is_generated,
    modes_of,
    no_campaign,
    not_drawn,
    thrust_plates,
    vehicle_plates,
)
from paper.tuning import tuning_plates, without_tuning
from seatrial._core import Vehicle
from seatrial.base.errors import SeatrialError, TrialError
from seatrial.report.plot.style import PRINT_DPI, save

if TYPE_CHECKING:
    from seatrial.bench_test.evaluate import BenchTest
    from seatrial.campaign.campaign import Campaign
    from seatrial.identification.identification import Identification

FORMATS = ("png", "pdf", "svg")
"""Formats in which figures can be written; PDF and SVG are vectors, PNG has 300 dots per inch."""

INDEX = "index.html"

_NAMED = re.compile(r'href="(fig_\d+_\w+\.(?:png|pdf|svg))"')


@dataclass(frozen=True)
class PaperFigure:
    """A figure of a gallery: its number, name, caption and files."""

    number: int
    name: str
    caption: str
    files: tuple[Path, ...]


@dataclass(frozen=True)
class PaperGallery:
    """What was drawn: figures in the order of their numbers, sentences on what was left out, the page."""

    title: str
    figures: tuple[PaperFigure, ...]
    left_out: tuple[str, ...]
    index: Path

    @property
    def files(self) -> list[Path]:
        """Paths of all figures in the order of their numbers, the page last."""
        return [path for figure in self.figures for path in figure.files] + [self.index]


def paper_figures(
    source: Identification | Vehicle,
    folder: str | Path,
    *,
    campaign: Campaign | None = None,
    bench: BenchTest | None = None,
    formats: tuple[str, ...] = ("png", "pdf"),
) -> list[Path]:
    """Paths of the numbered figures of an identification or a vehicle, and of the page with their captions.

    Parameters
    ----------
    source : Identification or Vehicle
        Of a vehicle alone its own figures are drawn: outline, block diagrams, motors, characteristics.
    folder : str or Path
        Made when it does not exist; an earlier gallery's figures in it are replaced.
    campaign : Campaign, optional
        Of the identification: its tuning is drawn too.
    bench : BenchTest, optional
        Bench test of the vehicle, for step responses and regressions; by default that of the campaign.
    formats : tuple of str
        Some of "png", "pdf" and "svg".

    Raises
    ------
    SeatrialError
        An unknown format, or the folder cannot be written.

    Examples
    --------
    >>> import seatrial as st
    >>> from paper.gallery import paper_figures
    >>> files = paper_figures(st.Vehicle.load("cwolf"), "figures")  # doctest: +SKIP
    >>> files[0].name, files[-1].name  # doctest: +SKIP
    ('fig_01_vehicle.png', 'index.html')
    """
    return draw_gallery(source, folder, campaign=campaign, bench=bench, formats=formats).files


def draw_gallery(
    source: Identification | Vehicle,
    folder: str | Path,
    *,
    campaign: Campaign | None = None,
    bench: BenchTest | None = None,
    formats: tuple[str, ...] = ("png", "pdf"),
) -> PaperGallery:
    """Gallery with captions and what was left out; parameters and errors as of `paper_figures`."""
    formats = check_formats(formats)
    if bench is None and not isinstance(source, Vehicle):
        bench = source.problem.bench
    folder = Path(folder)
    drawn: list[PaperFigure] = []
    left_out: list[str] = []
    plates: list[Plate] = []
    for plate in _plates(source, bench, campaign):
        plates.append(plate)
        if plate.draw is None:
            left_out.append(f"{plate.caption} ({cited(plate.paper)})" if plate.paper else plate.caption)
            continue
        try:
            figure = plate.draw()
        except TrialError as error:  # a trial that cannot be simulated leaves the other figures as they are
            left_out.append(f"{plate.name}: {error}")
            continue
        number = len(drawn) + 1
        stem = f"fig_{number:02d}_{plate.name}"
        files = save(figure, folder / stem, formats=formats, dpi=PRINT_DPI)
        after = f" After {cited(plate.paper)} of Taubert et al. (2014)." if plate.paper else ""
        drawn.append(PaperFigure(number, plate.name, plate.caption + after, tuple(files)))
    left_out += not_drawn(plates)
    page = folder / INDEX
    _clear(page, keep={path.name for figure in drawn for path in figure.files})
    gallery = PaperGallery(_title(source), tuple(drawn), tuple(left_out), page)
    try:
        page.write_text(_page(gallery, _provenance(source, campaign)), encoding="utf-8")
    except OSError as error:
        raise SeatrialError(
            f"{page}: cannot be written ({error.strerror or error}); choose a folder that you may write to"
        ) from None
    return gallery


def _clear(page: Path, *, keep: set[str]) -> None:
    """Remove the figures of an earlier gallery that its page names and this one did not replace."""
    try:
        named = set(_NAMED.findall(page.read_text(encoding="utf-8")))
    except (OSError, UnicodeDecodeError):  # no gallery of ours was there before
        return
    for name in named - keep:
        (page.parent / name).unlink(missing_ok=True)


def check_formats(formats: tuple[str, ...]) -> tuple[str, ...]:
    """The formats, each once.

    Raises
    ------
    SeatrialError
        One is unknown, or there is none.
    """
    unknown = [ending for ending in formats if ending not in FORMATS]
    if unknown or not formats:
        found = repr(unknown[0]) if unknown else "none"
        raise SeatrialError(
            f"formats of the figures: expected some of {', '.join(FORMATS)}, found {found}; name those"
            " you want"
        )
    return tuple(dict.fromkeys(formats))


def _plates(
    source: Identification | Vehicle, bench: BenchTest | None, campaign: Campaign | None
) -> Iterator[Plate]:
    """All plates in the order of the paper."""
    if isinstance(source, Vehicle):
        data = "Numbers of the vehicle file."
        yield from vehicle_plates(source, data=data)
        yield from bench_plates(bench)
        yield from thrust_plates(source, data=data)
        yield no_campaign(source)
        yield from autopilot_plates(source, tuning=(without_tuning(source),))
        return
    data = f"Numbers as identified by the campaign {source.problem.name}."
    yield from vehicle_plates(source.vehicle, data=data, modes=modes_of(source.problem))
    yield from bench_plates(bench)
    yield from thrust_plates(source.vehicle, data=data)
    yield from campaign_plates(source)
    yield from autopilot_plates(source.vehicle, tuning=tuning_plates(source, campaign))


def _title(source: Identification | Vehicle) -> str:
    if isinstance(source, Vehicle):
        return f"{source.name}: figures of the vehicle"
    return f"{source.vehicle.name}: figures of the campaign {source.problem.name}"


def _provenance(source: Identification | Vehicle, campaign: Campaign | None) -> str:
    """A sentence on what the figures rest on."""
    if isinstance(source, Vehicle):
        return f"{source.description or source.name}. No recordings: figures of the vehicle file alone."
    problem = source.problem
    made = [trial for trial in problem.trials if is_generated(problem, trial)]
    total = len(problem.trials)
    if len(made) == total:
        origin = (
            f"All {total} trials are generated: simulated from a truth vehicle and seen through its sensors."
        )
    elif made:
        origin = f"{len(made)} of {total} trials are generated ({', '.join(made)}), the others recorded."
    else:
        origin = f"All {total} trials are recordings."
    versions = source.facts.get("versions", {})
    return (
        f"{(campaign and campaign.file.description) or problem.name}. {origin}"
        f" Seed {problem.seed}, seatrial {versions.get('seatrial', 'unknown')}."
    )


_STYLE = (
    "body{font:15px/1.45 sans-serif;max-width:60em;margin:2em auto;padding:0 1em;color:#262626}"
    "figure{margin:2.5em 0}img{max-width:100%;height:auto;display:block;margin:0 auto}"
    "figcaption{margin-top:.6em}figcaption b{margin-right:.4em}small{color:#595959}"
)


def _page(gallery: PaperGallery, provenance: str) -> str:
    """HTML page: every figure with number, caption and links to its files; what was left out."""
    lines = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8">',
        f"<title>{html.escape(gallery.title)}</title><style>{_STYLE}</style></head><body>",
        f"<h1>{html.escape(gallery.title)}</h1>",
        f"<p>{html.escape(provenance)}</p>",
    ]
    for figure in gallery.figures:
        shown = next((path for path in figure.files if path.suffix in (".svg", ".png")), None)
        links = ", ".join(
            f'<a href="{html.escape(path.name)}">{path.suffix[1:].upper()}</a>' for path in figure.files
        )
        lines += [
            f'<figure id="fig-{figure.number}">',
            *(
                [f'<img src="{html.escape(shown.name)}" alt="{html.escape(figure.name)}">']
                if shown is not None
                else []
            ),
            f"<figcaption><b>Fig. {figure.number}.</b> {html.escape(figure.caption)}"
            f" <small>{links}</small></figcaption>",
            "</figure>",
        ]
    if gallery.left_out:
        lines.append("<h2>Not drawn</h2><ul>")
        lines += [f"<li>{html.escape(sentence)}</li>" for sentence in gallery.left_out]
        lines.append("</ul>")
    return "\n".join([*lines, "</body></html>"]) + "\n"
