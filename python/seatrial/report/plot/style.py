"""House style of all figures: sizes, palette, saving, symbols, headings, legends.

The palette is that of Okabe and Ito (2008), which the common colour-vision deficiencies keep apart; measured
and simulated differ in weight too, so that a grey print shows the difference. Widths are those of a page of
two columns (IEEE: 88 and 180 mm); fonts are embedded in PDF as TrueType and drawn as outlines in SVG.
"""

from __future__ import annotations

import errno
import io
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.base.arrays import Array
from seatrial.base.errors import SeatrialError
from seatrial.base.files import write_atomic
from seatrial.base.run import belongs_to_run

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

MEASURED = "#4d4d4d"

SIMULATED = "#0072B2"

RESIDUAL = "#D55E00"

SECOND, THIRD, FOURTH = "#E69F00", "#009E73", "#CC79A7"

CYCLE = (SIMULATED, SECOND, THIRD, FOURTH, "#56B4E9", RESIDUAL)

SHADE = "#E9E4D4"

HULL, HULL_EDGE = "#EEF2F5", "#7A8791"

FAINT = "#9AA3AA"

INK, REMARK = "#262626", "#404040"

FORBIDDEN = "#F3C9B5"

Style = dict[str, Any]
"""Keywords of matplotlib: colour, width, dashes and the like."""

ON_WHITE: Style = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 0.6}
"""Box behind small print on top of lines."""

ABOVE: Style = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0)}
"""Place of a legend beside a panel's title, where it hides no curve."""

COLUMN_IN, WIDTH_IN = 88.0 / 25.4, 180.0 / 25.4  # of a column and of a page with two of them

DPI, PRINT_DPI = 200, 300  # of PNG, for screens and for print

_STYLE: Style = {
    "axes.axisbelow": True,
    "axes.edgecolor": "#595959",
    "axes.grid": True,
    "axes.labelcolor": "#262626",
    "axes.labelsize": 8,
    "axes.linewidth": 0.6,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 8.5,
    "figure.dpi": DPI,
    "figure.facecolor": "white",
    "figure.titlesize": 10,
    "font.family": "DejaVu Sans",
    "font.size": 8,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.5,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "lines.linewidth": 1.1,
    "lines.solid_capstyle": "round",
    "mathtext.fontset": "dejavusans",
    "pdf.fonttype": 42,
    "savefig.dpi": DPI,
    "svg.hashsalt": "seatrial",
    "xtick.color": "#595959",
    "xtick.labelsize": 7,
    "xtick.major.width": 0.6,
    "ytick.color": "#595959",
    "ytick.labelsize": 7,
    "ytick.major.width": 0.6,
}


@contextmanager
def house_style() -> Iterator[None]:
    """The style, for the time of drawing or saving; global settings stay as they are."""
    from matplotlib import rc_context

    with rc_context(cast(Any, _STYLE)):
        yield


def new_figure(height_in: float, *, width_in: float = WIDTH_IN, constrained: bool = True) -> Figure:
    """Empty figure that needs no display, shown in a notebook as in a file; call it inside `house_style`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained" if constrained else None)
    FigureCanvasAgg(figure)

    def shown() -> bytes:
        content = io.BytesIO()
        with house_style():
            figure.savefig(content, format="png", dpi=110)  # 780 pixels wide, as a cell is
        return content.getvalue()

    figure._repr_png_ = shown  # type: ignore[attr-defined]
    return figure


def panel_title(axes: Axes, name: str, text: str = "") -> None:
    """Title of a panel: a bold name at the left, a remark beside it at the right."""
    axes.set_title(name, loc="left", fontweight="bold")
    if text:
        axes.set_title(text, loc="right", fontsize=7.5, color=REMARK)


def heading(figure: Figure, text: str, **style: Any) -> None:
    """Title of a whole figure, bold at its upper left."""
    if text:
        figure.suptitle(text, x=0.01, ha="left", fontweight="bold", **style)


def page_heading(figure: Figure, text: str, *, left_in: float = 0.12, below_in: float = 0.16) -> None:
    """Title of a figure without automatic layout, so far from its left edge and below its upper one."""
    width, height = figure.get_size_inches()
    place = (left_in / width, 1.0 - below_in / height)
    figure.text(*place, text, fontweight="bold", fontsize=10, va="center")


def blank(axes: Axes, words: str, **style: Any) -> None:
    """Say in the middle of a panel why it is empty."""
    axes.text(0.5, 0.5, words, ha="center", transform=axes.transAxes, **{"fontsize": 7, **style})


def stroke(label: str, color: str, **style: Any) -> Line2D:
    """Entry of a legend: a line, or a marker with ``linestyle=""``."""
    from matplotlib.lines import Line2D

    return Line2D([], [], color=color, label=label, **style)


def field(label: str, colour: str, **style: Any) -> Patch:
    """Entry of a legend: a coloured field, with an edge of its own colour unless one is given."""
    from matplotlib.patches import Patch

    return Patch(facecolor=colour, label=label, **{"edgecolor": colour, **style})


def legend_below(figure: Figure, handles: Sequence[Artist], columns: int | None = None, **style: Any) -> None:
    """Legend of a whole figure below its panels, in one row unless columns are given."""
    columns = columns or len(handles)
    figure.legend(handles=list(handles), loc="outside lower center", ncols=columns, **style)


def band(axes: Axes, x: Array, lower: ArrayLike, upper: ArrayLike, colour: str, **style: Any) -> None:
    """Field between two curves, without an edge."""
    axes.fill_between(x, lower, upper, color=colour, linewidth=0.0, **style)


def grid_of(figure: Figure | SubFigure, count: int, columns: int, **options: Any) -> NDArray[Any]:
    """Panels (rows, columns) for so many drawings; those that are left over are not shown."""
    rows = -(-max(count, 1) // columns)
    grid = np.asarray(figure.subplots(rows, columns, squeeze=False, **options))
    for axes in list(grid.flat)[count:]:
        axes.set_axis_off()
    return grid


def tidy(number: float) -> str:
    """A score as it stands in a title: two decimals, or "below -9.9", or "none"."""
    if number != number:
        return "none"
    text = f"{round(number, 2) + 0.0:.2f}" if number > -9.95 else "below -9.9"  # no minus before a zero
    return text.replace("-", "\N{MINUS SIGN}")


def save(
    figure: Figure, path: str | Path, *, formats: tuple[str, ...] = ("png",), dpi: int = DPI
) -> list[Path]:
    """Files of a figure beside `path`, one per format; SeatrialError where they cannot be written."""
    base = Path(path)
    written = []
    try:
        base.parent.mkdir(parents=True, exist_ok=True)
        with house_style(), _laid_out_once(figure):
            for ending in formats:
                target = base.with_name(f"{base.name}.{ending}")
                # No date inside: the same data give the same file.
                dated = {"pdf": "CreationDate", "svg": "Date"}.get(ending)
                content = io.BytesIO()
                figure.savefig(content, format=ending, dpi=dpi, metadata={dated: None} if dated else None)
                write_atomic(target, content.getvalue())
                written.append(target)
                figure.set_layout_engine(None)
        belongs_to_run(base.parent, written)
    except OSError as error:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        reason = "the disk is full" if full else (error.strerror or str(error))
        raise SeatrialError(
            f"{base.parent}: the figure {base.name} cannot be written ({reason});"
            f" {'free some space' if full else 'choose a folder that you may write to'}"
        ) from None
    return written


@contextmanager
def _laid_out_once(figure: Figure) -> Iterator[None]:
    """The first file places the panels, so that all formats look alike and none is laid out in vain."""
    engine = figure.get_layout_engine()
    try:
        yield
    finally:
        figure.set_layout_engine(engine)


_NAME = re.compile(r"([A-Za-z])_([a-z0-9]+?)(dot)?")


def symbol(name: str) -> str:
    r"""Mathtext of a coefficient's name; the name of an actuator's or group's coefficient stays as it is.

    Examples
    --------
    >>> symbol("X_udot"), symbol("N_rr"), symbol("m"), symbol("stern.gain")
    ('$X_{\\dot{u}}$', '$N_{rr}$', '$m$', 'stern.gain')
    """
    if len(name) == 1:
        return f"${name}$"
    match = _NAME.fullmatch(name)
    if match is None:
        return name
    letter, index, dotted = match.groups()
    return f"${letter}_{{\\dot{{{index}}}}}$" if dotted else f"${letter}_{{{index}}}$"


def printed_unit(unit: str) -> str:
    """A unit with raised exponents.

    Examples
    --------
    >>> printed_unit("N s2/m2")
    'N s²/m²'
    """
    return re.sub(r"(?<=[a-z])[23]", lambda match: "²³"["23".index(match[0])], unit)


def number(value: float, digits: int = 3) -> str:
    """A number for a figure: significant digits, a true minus sign, no exponent where that can be read.

    Examples
    --------
    >>> number(-0.02), number(2000.0), number(1.5e-7)
    ('−0.02', '2000', '1.5e−07')
    """
    value += 0.0  # no minus before a zero
    exponent = "e" in f"{value:.{digits}g}" and 1e-4 <= abs(value) < 1e7
    text = f"{value:.0f}" if exponent else f"{value:.{digits}g}"
    return text.replace("-", "\N{MINUS SIGN}")


def joined(names: Sequence[str]) -> str:
    """Names with commas; what they share up to an underscore stands once.

    Examples
    --------
    >>> joined(["thruster_3", "thruster_4"]), joined(["SbU", "PU"])
    ('thruster_3, 4', 'SbU, PU')
    """
    prefix = names[0].rpartition("_")[0] + "_"
    if len(names) < 2 or len(prefix) < 2 or not all(name.startswith(prefix) for name in names):
        return ", ".join(names)
    return ", ".join([names[0], *(name.removeprefix(prefix) for name in names[1:])])
