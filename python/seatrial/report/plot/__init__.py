"""Figures for paper and screen in one style, and which results have which.

Each module named in `DRAWN` has a function ``drawings``: figures by name, each drawn when it is called.
``--figures`` writes all of them (`gallery`), ``plot`` of a result draws one. Held by
``tests/report/test_notebook.py``.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.base.errors import SeatrialError, TrialError, nearest

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DRAWN = {
    "BenchTest": ("bench", "bollard_test"),
    "Comparison": ("trials", ""),
    "FailureBoundary": ("verification", ""),
    "Flight": ("flight_errors", "track"),
    "Identification": ("identification", "intervals"),
    "Imported": ("recording", ""),
    "LogTuning": ("mission_log", "envelope"),
    "LogVerdict": ("mission_log", "residuals"),
    "Plan": ("recording", ""),
    "Replay": ("mission_log", ""),
    "Score": ("trials", ""),
    "Tuning": ("tuning", "margins"),
    "Verification": ("verification", "requirements"),
}
"""Module of this folder by the name of the result's class, and the figure that says most; else the first."""


def drawings(result: object) -> dict[str, Callable[[], Figure]]:
    """Figures of a result by name, none drawn yet; empty for a result that has none."""
    for kind in type(result).__mro__:
        if kind.__name__ in DRAWN:
            module = importlib.import_module(f"{__name__}.{DRAWN[kind.__name__][0]}")
            figures: dict[str, Callable[[], Figure]] = module.drawings(result)
            return figures
    return {}


def plotted(result: object, name: str = "") -> Figure:
    """One figure of a result; SeatrialError where it has none of this name, or none at all."""
    kind, known = type(result).__name__, drawings(result)
    if not known:
        raise SeatrialError(f"{kind}: it has no figure; print its summary()")
    usual = DRAWN.get(kind, ("", ""))[1]
    chosen = name or (usual if usual in known else next(iter(known)))
    if chosen not in known:
        raise SeatrialError(
            f"{kind}: expected one of the figures {', '.join(known)}, found {name!r}{nearest(name, known)}"
        )
    return known[chosen]()


def gallery(
    result: object,
    folder: str | Path,
    *,
    formats: tuple[str, ...] = ("png",),
    wanted: Callable[[str], bool] | None = None,
) -> list[Path]:
    """Paths of the figures of a result after they were written into a folder.

    Parameters
    ----------
    result
        A result, or its `drawings`.
    folder : str or Path
    formats : tuple of str, optional
        Endings of the files; without any nothing is drawn.
    wanted : callable, optional
        Whether a figure of this name is drawn; all by default.

    Raises
    ------
    SeatrialError
        The folder cannot be written.
    """
    from seatrial.report.plot.style import save

    written: list[Path] = []
    drawn = result if isinstance(result, Mapping) else drawings(result)
    for name, draw in drawn.items() if formats else ():
        if wanted is not None and not wanted(name):
            continue
        try:
            figure = draw()
        except TrialError:  # such a trial is named among the notes of the identification
            continue
        written += save(figure, Path(folder) / name, formats=formats)
    return written
