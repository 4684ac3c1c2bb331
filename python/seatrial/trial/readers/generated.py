"""Recipes of generated trials: simulated from their truth vehicle when they are read."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import polars as pl


def read(path: Path) -> pl.DataFrame:
    """Table of what the truth vehicle's sensors logged, with canonical columns.

    Raises
    ------
    TrialError
        If the recipe or its truth vehicle is not usable.
    """
    from seatrial.trial.generated import Recipe

    return Recipe.load(path).table()
