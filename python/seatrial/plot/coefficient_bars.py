"""Where coefficients lie within their bounds: a bar per coefficient with start value, optimum and polish."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.plot.style import FAINT, RESIDUAL, SECOND, SIMULATED, panel_title
from seatrial.plot.symbols import number, printed_unit, symbol

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Row", "coefficient_bars"]

_AIR = 0.3
_ROOM = 31  # letters of a name and its numbers that stand side by side in full size
_NOTHING = 1e-6  # of the distance between the bounds: shown as zero


@dataclass(frozen=True)
class Row:
    """A coefficient: bounds, start value, optimum of the stage; joint estimate and its standard deviation."""

    name: str
    unit: str
    lower: float
    upper: float
    start: float
    found: float
    polished: float | None = None
    sigma: float | None = None

    def share(self, value: float) -> float:
        """Place of a value between the bounds, 0 at the lower and 1 at the upper one."""
        return (value - self.lower) / (self.upper - self.lower)

    def words(self) -> str:
        """Start value, optimum and joint estimate, with their unit."""
        values = [self.start, self.found] + ([] if self.polished is None else [self.polished])
        least = _NOTHING * (self.upper - self.lower)
        shown = " \N{RIGHTWARDS ARROW} ".join(number(x if abs(x) > least else 0.0) for x in values)
        return shown if self.unit == "1" else f"{shown} {printed_unit(self.unit)}".rstrip()


def coefficient_bars(axes: Axes, rows: Sequence[Row]) -> None:
    """Draw a bar per coefficient into axes: bounds at its ends, values as marks, numbers above."""
    for place, row in enumerate(rows):
        y = -float(place)
        axes.plot([0.0, 1.0], [y, y], color=FAINT, linewidth=3.0, solid_capstyle="butt", alpha=0.45)
        axes.plot(row.share(row.start), y, "s", color=SECOND, markersize=4.2, markerfacecolor="white")
        axes.plot(row.share(row.found), y, "o", color=SIMULATED, markersize=4.4, zorder=4)
        if row.polished is not None:
            centre, spread = row.share(row.polished), 1.96 * (row.sigma or 0.0) / (row.upper - row.lower)
            if np.isfinite(spread):
                ends = np.clip([centre - spread, centre + spread], 0.0, 1.0)
                axes.plot(ends, [y, y], color=RESIDUAL, linewidth=1.2, zorder=5)
            # The joint estimate may have wider bounds than the stage.
            axes.plot(np.clip(centre, -0.02, 1.02), y, "D", color=RESIDUAL, markersize=3.0, zorder=6)
        words, name = row.words(), symbol(row.name)
        letters = len(words) + (4 if name.startswith("$") else len(name))
        small = min(1.0, _ROOM / letters)
        axes.text(0.0, y + _AIR, name, fontsize=7.5 * small, va="center", ha="left")
        axes.text(1.0, y + _AIR, words, fontsize=6.5 * small, va="center", ha="right")
        for x, bound, side in ((0.0, row.lower, "right"), (1.0, row.upper, "left")):
            axes.annotate(
                number(bound), (x, y), (-3 if x == 0.0 else 3, 0), textcoords="offset points",
                fontsize=5.5, va="center", ha=side, color="#595959",
            )  # fmt: skip
    axes.set_xlim(-0.16, 1.16)
    axes.set_ylim(0.6 - len(rows), 0.75)
    axes.set_axis_off()
    panel_title(axes, "coefficients in their bounds")
