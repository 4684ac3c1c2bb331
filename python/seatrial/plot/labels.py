"""Labels of points in a drawing that do not overlap: in rows above and below, tied by thin lines."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.plot.style import FAINT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["joined", "label_rows", "side_by_side"]

Array = NDArray[np.float64]

_SIZE_PT, _SMALLEST_PT = 6.5, 4.0
_AIR_IN, _ROW_IN = 0.09, 0.10
_TOGETHER_IN = 0.06


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
    for members in _together(page, _TOGETHER_IN / inch):
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
