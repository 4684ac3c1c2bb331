"""Figure of a replay of ArduSub's controllers: what is logged, what was replayed, and the difference.

Held by ``tests/ardusub/test_replay.py``.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from seatrial.report.plot.style import (
    MEASURED,
    RESIDUAL,
    SIMULATED,
    house_style,
    new_figure,
    panel_title,
    save,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from seatrial.ardusub.log_replay import Replay
    from seatrial.ardusub.quantity import Quantity

__all__ = ["replay_figure", "replay_gallery"]

_SHOWN = ("rate wanted", "output", "acceleration wanted", "throttle", "motor 1", "motor 6")


def replay_gallery(found: Replay, folder: str | Path, *, formats: tuple[str, ...] = ("png",)) -> list[Path]:
    """Paths of the figure of a replay after it was written into a folder.

    Raises
    ------
    SeatrialError
        The folder cannot be written.
    """
    return save(replay_figure(found), Path(folder) / "replay", formats=formats)


def replay_figure(found: Replay) -> Figure:
    """Figure of the quantities that tell most, one of each kind, in the order of the signal.

    Parameters
    ----------
    found : Replay
    """
    chosen = [one for kind in _SHOWN if (one := _first(found, kind)) is not None]
    chosen.sort(key=found.quantities.index)
    with house_style():
        figure = new_figure(0.6 + 1.25 * len(chosen))
        panels = figure.subplots(len(chosen), 2, sharex=True, squeeze=False, width_ratios=(2.0, 1.0))
        for (left, right), one in zip(panels, chosen, strict=True):
            t = one.t - found.quantities[0].t[0]
            shown = np.where(one.judged, one.replayed, np.nan)
            left.plot(t, one.logged, color=MEASURED, label="logged")
            left.plot(t, shown, color=SIMULATED, linestyle="--", label="replayed")
            right.plot(t, shown - one.logged, color=RESIDUAL, linewidth=0.6)
            most = 1.3 * max(float(np.nanmax(np.abs(shown - one.logged))), one.limit)
            right.axhspan(-one.limit, one.limit, color="0.92", zorder=0)
            right.set_ylim(-most, most)
            unit = "" if one.unit == "1" else f", {one.unit.replace('us', 'µs').replace('m/s2', 'm/s²')}"
            panel_title(left, f"{one.controller}: {one.name}{unit}")
            panel_title(right, f"difference, limit {one.limit:.2g}")
            right.locator_params(axis="x", nbins=4)
        panels[0, 0].legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2)
        for panel in panels[-1]:
            panel.set_xlabel("time, s")
    return figure


def _first(found: Replay, kind: str) -> Quantity | None:
    """The quantity of a kind that is drawn: of several axes that of yaw, else the first."""
    same = [one for one in found.quantities if one.name == kind]
    return next((one for one in same if one.controller.endswith("yaw")), same[0] if same else None)
