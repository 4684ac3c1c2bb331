"""House style of all figures: sizes, palette, saving.

The palette is that of Okabe and Ito (2008), which the common colour-vision deficiencies keep apart; measured
and simulated differ in weight too, so that a grey print tells them. Widths are those of a page of two columns
(IEEE: 88 and 180 mm); fonts are embedded in PDF as TrueType and drawn as outlines in SVG.
"""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from seatrial.errors import SeatrialError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["house_style", "new_figure", "panel_title", "save", "tidy"]

MEASURED = "#4d4d4d"
SIMULATED = "#0072B2"
RESIDUAL = "#D55E00"
SECOND, THIRD, FOURTH = "#E69F00", "#009E73", "#CC79A7"
CYCLE = (SIMULATED, SECOND, THIRD, FOURTH, "#56B4E9", RESIDUAL)
SHADE = "#E9E4D4"
HULL, HULL_EDGE = "#EEF2F5", "#7A8791"
FAINT = "#9AA3AA"

COLUMN_IN = 88.0 / 25.4
WIDTH_IN = 180.0 / 25.4
DPI = 200
PRINT_DPI = 300

_STYLE: dict[str, Any] = {
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
    """Empty figure on a canvas that needs no display; call it inside `house_style`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained" if constrained else None)
    FigureCanvasAgg(figure)
    return figure


def panel_title(axes: Axes, name: str, text: str = "") -> None:
    """Title of a panel: a bold name at the left, a remark beside it at the right."""
    axes.set_title(name, loc="left", fontweight="bold")
    if text:
        axes.set_title(text, loc="right", fontsize=7.5, color="#404040")


def tidy(number: float) -> str:
    """A score as it stands in a title: two decimals, or "below -9.9", or "none"."""
    if number != number:
        return "none"
    told = f"{round(number, 2) + 0.0:.2f}" if number > -9.95 else "below -9.9"  # no minus before a zero
    return told.replace("-", "\N{MINUS SIGN}")


def save(
    figure: Figure, path: str | Path, *, formats: tuple[str, ...] = ("png", "pdf"), dpi: int = DPI
) -> list[Path]:
    """Paths of the files after the figure was written beside `path` in every format, by its ending.

    Raises
    ------
    SeatrialError
        The folder cannot be written or the disk is full.
    """
    base = Path(path)
    written = []
    try:
        base.parent.mkdir(parents=True, exist_ok=True)
        with house_style(), _laid_out_once(figure):
            for ending in formats:
                target = base.with_name(f"{base.name}.{ending}")
                # No date inside: the same data give the same file.
                dated = {"pdf": "CreationDate", "svg": "Date"}.get(ending)
                figure.savefig(target, dpi=dpi, metadata={dated: None} if dated else None)
                written.append(target)
                figure.set_layout_engine(None)
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
