"""House style of all figures: sizes, palette, saving, symbols of coefficients, labels that do not overlap.

The palette is that of Okabe and Ito (2008), which the common colour-vision deficiencies keep apart; measured
and simulated differ in weight too, so that a grey print shows the difference. Widths are those of a page of
two columns (IEEE: 88 and 180 mm); fonts are embedded in PDF as TrueType and drawn as outlines in SVG.
"""

from __future__ import annotations

import errno
import io
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.atomic_write import write_atomic
from seatrial.base.errors import SeatrialError
from seatrial.base.run import belongs_to_run

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MEASURED = "#4d4d4d"

SIMULATED = "#0072B2"

RESIDUAL = "#D55E00"

SECOND, THIRD, FOURTH = "#E69F00", "#009E73", "#CC79A7"

CYCLE = (SIMULATED, SECOND, THIRD, FOURTH, "#56B4E9", RESIDUAL)

SHADE = "#E9E4D4"

HULL, HULL_EDGE = "#EEF2F5", "#7A8791"

FAINT = "#9AA3AA"

COLUMN_IN = 88.0 / 25.4  # layout, inches

WIDTH_IN = 180.0 / 25.4  # layout, inches

DPI = 200  # of PNG, for screens

PRINT_DPI = 300  # of PNG, for print

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
    """Empty figure on a canvas that needs no display; call it inside `house_style`.

    A notebook shows it as it is written to a file, whether it has loaded pyplot or not.
    """
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
        axes.set_title(text, loc="right", fontsize=7.5, color="#404040")


def tidy(number: float) -> str:
    """A score as it stands in a title: two decimals, or "below -9.9", or "none"."""
    if number != number:
        return "none"
    text = f"{round(number, 2) + 0.0:.2f}" if number > -9.95 else "below -9.9"  # no minus before a zero
    return text.replace("-", "\N{MINUS SIGN}")


def save(
    figure: Figure, path: str | Path, *, formats: tuple[str, ...] = ("png",), dpi: int = DPI
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


_SIZE_PT, _SMALLEST_PT = 6.5, 4.0  # of a legend: usual, and where it must shrink

_AIR_IN, _ROW_IN = 0.09, 0.10  # layout, inches


def label_rows(
    axes: Axes,
    names: Sequence[str],
    page: Array,
    arrows: Array,
    *,
    signs: Array,
    window: tuple[float, float],
    inch: float,
) -> None:
    """Label the points of a drawing, one label for those at one place.

    Parameters
    ----------
    axes : Axes
        Its data are the page's numbers times `signs`.
    names : sequence of str
    page, arrows : array, shape (n, 2)
        Places and arrows on the page, to the right and up, in the drawing's unit.
    signs : array, shape (2,)
        +1 or -1 per direction of the page.
    window : tuple of float
        Half width and half height of the axes; the rows stand at its upper and lower edge.
    inch : float
        Inches per unit.
    """
    across, upright = window
    rows: dict[float, list[tuple[float, float, str]]] = {1.0: [], -1.0: []}
    for members in _together(page, 0.06 / inch):  # inches
        x, y = page[members].mean(axis=0)
        # On the centre line a label stands where the arrow does not point.
        side = y if abs(y) > 1e-3 else -arrows[members, 1].sum()
        rows[-1.0 if side < -1e-3 else 1.0].append((x, y, joined([names[k] for k in members])))

    def width(row: Sequence[tuple[float, float, str]]) -> float:
        return sum(_width_in(axes, text) for _, _, text in row) / inch

    for side in (1.0, -1.0):
        _relieve(rows[side], rows[-side], width, room=2.0 * across)
    for side, row in rows.items():
        row.sort()
        widths = [width([entry]) for entry in row]
        shrink = min(1.0, 2.0 * across / sum(widths)) if widths else 1.0
        centres = side_by_side([x for x, _, _ in row], [shrink * width for width in widths], across)
        for (x, y, text), centre in zip(row, centres, strict=True):
            axes.annotate(
                text,
                (signs[0] * x, signs[1] * y),
                (signs[0] * centre, signs[1] * side * (upright - _ROW_IN / inch)),
                fontsize=max(shrink * _SIZE_PT, _SMALLEST_PT),
                ha="center",
                va="center",
                zorder=3,
                arrowprops={
                    "arrowstyle": "-",
                    "color": FAINT,
                    "linewidth": 0.5,
                    "shrinkA": 1.0,
                    "shrinkB": 3.0,
                },
            )


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


def _relieve(
    full: list[tuple[float, float, str]],
    other: list[tuple[float, float, str]],
    width: Callable[[Sequence[tuple[float, float, str]]], float],
    *,
    room: float,
) -> None:
    """Move labels out of a row that is too full, those nearest the centre line first, while it helps."""
    while width(full) > room:
        moved = min(full, key=lambda entry: (abs(entry[1]), entry[0]))
        if width([*other, moved]) >= width(full):
            return
        full.remove(moved)
        other.append(moved)


def side_by_side(wanted: Sequence[float], widths: Sequence[float], limit: float) -> list[float]:
    """Centres near those wanted (sorted), such that intervals of these widths do not overlap.

    They stay within plus and minus the limit where there is room.

    Examples
    --------
    >>> side_by_side([0.0, 0.1], [1.0, 1.0], 5.0)
    [-0.45, 0.55]
    """
    if not wanted:
        return []
    size = np.asarray(widths, dtype=float)
    # Intervals that touch move as one block, placed where its members want to be on average.
    blocks: list[list[int]] = []
    offsets = np.concatenate([[0.0], np.cumsum(0.5 * (size[:-1] + size[1:]))])
    free = np.asarray(wanted, dtype=float) - offsets
    for k in range(len(free)):
        blocks.append([k])
        while len(blocks) > 1 and free[blocks[-2]].mean() > free[blocks[-1]].mean():
            last = blocks.pop()
            blocks[-1] += last
    centres = np.concatenate([np.full(len(block), free[block].mean()) for block in blocks]) + offsets
    centres += max(0.0, float(-limit - (centres[0] - 0.5 * size[0])))
    centres -= max(0.0, float(centres[-1] + 0.5 * size[-1] - limit))
    return [round(float(x), 9) for x in centres]


def _together(page: Array, distance: float) -> list[list[int]]:
    """Points grouped with the first one that is nearer than the distance."""
    groups: list[list[int]] = []
    for k in range(len(page)):
        near = next((group for group in groups if np.abs(page[group[0]] - page[k]).max() < distance), None)
        if near is None:
            groups.append([k])
        else:
            near.append(k)
    return groups


def _width_in(axes: Axes, text: str) -> float:
    """Width of a label in inches, with some air."""
    figure = axes.figure
    sample = figure.text(0.0, 0.0, text, fontsize=_SIZE_PT)
    width = sample.get_window_extent().width / figure.dpi
    sample.remove()
    return float(width) + _AIR_IN
