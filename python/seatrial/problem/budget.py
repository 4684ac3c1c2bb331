"""How long a search by evolution strategy and simplex may take: that of a stage, or that of a group of loops.

A table `[budget]` of the campaign file; held by ``tests/campaign/test_campaign_file.py``.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from seatrial.base.toml_file import Count, Positive, Section


class Budget(Section):
    """Limits of a search. What is absent is chosen from the number of its parameters."""

    population: Annotated[int, Field(strict=True, ge=2)] | None = None
    generations: Count | None = None
    simplex_rounds: Count | None = None
    tolerance: Positive | None = None
