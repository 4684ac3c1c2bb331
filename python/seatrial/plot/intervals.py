"""How sure the coefficients are, on one page: relative standard deviations, verdicts, correlations."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from seatrial.plot.style import FAINT, RESIDUAL, SECOND, SIMULATED, house_style, new_figure, panel_title
from seatrial.plot.symbols import symbol

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from seatrial.certainty.assessment import Certainty

__all__ = ["intervals"]

_COLOURS = {"identifiable": SIMULATED, "weak": SECOND, "not identifiable": RESIDUAL}
_ROW_IN = 0.14
_LARGEST = 1e3  # per cent: what is less certain stands at the edge


def intervals(certainty: Certainty) -> Figure:
    """Figure of the standard deviations of the coefficients and of how they depend on one another.

    Left, per coefficient: its standard deviation in per cent of the estimate, coloured by the verdict, beside
    the naive one of independent samples (grey). Right: the correlation matrix of the same coefficients.

    Parameters
    ----------
    certainty : Certainty
        Of an identification.
    """
    found, names = certainty.uncertainty, list(certainty.identifiability.verdicts)
    places = [found.names.index(name) for name in names]
    size = np.maximum(np.abs(found.estimate[places]), 1e-12)
    with house_style():
        figure = new_figure(max(3.2, 1.1 + _ROW_IN * len(names)))
        left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.15])
        relative = [100.0 * part[places] / size for part in (found.sigma, found.naive)]
        _deviations(left, names, *relative, verdicts=certainty.identifiability.verdicts)
        _correlations(figure, right, names, found.correlation[np.ix_(places, places)])
        panel_title(left, "Standard deviations")
        left.set_xlabel(f"% of the estimate, blocks of {found.block_s:.3g} s")
        panel_title(right, "Correlations")
        figure.legend(*left.get_legend_handles_labels(), loc="outside lower left", ncols=4)
    return figure


def _deviations(
    axes: Axes, names: list[str], sigma: np.ndarray, naive: np.ndarray, *, verdicts: dict[str, str]
) -> None:
    rows = np.arange(len(names))[::-1]
    shown, plain = (np.minimum(np.nan_to_num(part, posinf=_LARGEST), _LARGEST) for part in (sigma, naive))
    axes.hlines(rows, plain, shown, color=FAINT, linewidth=1.0)
    axes.plot(plain, rows, "o", color=FAINT, markersize=3.0, label="if samples were independent")
    for verdict, colour in _COLOURS.items():
        mine = np.array([verdicts[name] == verdict for name in names])
        if mine.any():
            axes.plot(shown[mine], rows[mine], "o", color=colour, markersize=4.0, label=verdict)
    axes.set_xscale("log")
    axes.set_yticks(rows, [symbol(name) for name in names])
    axes.set_ylim(-0.5, len(names) - 0.5)  # the rows of the matrix beside it


def _correlations(figure: Figure, axes: Axes, names: list[str], matrix: np.ndarray) -> None:
    image = axes.imshow(matrix, vmin=-1.0, vmax=1.0, cmap="RdBu_r", aspect="auto")
    shown = [symbol(name) for name in names]
    axes.set_xticks(range(len(names)), shown, rotation=90, fontsize=min(7.0, 210.0 / len(names)))
    axes.set_yticks([])
    axes.grid(visible=False)
    bar = figure.colorbar(image, ax=axes, shrink=0.6, pad=0.02)
    bar.outline.set_visible(False)
