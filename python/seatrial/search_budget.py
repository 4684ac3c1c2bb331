"""How long a search by evolution strategy and simplex may take: of a stage, or of a group of loops."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from seatrial.toml_file import Count, Positive, Section

__all__ = ["Budget"]


class Budget(Section):
    """How long a search takes. What is absent is chosen from the number of its parameters."""

    population: Annotated[int, Field(strict=True, ge=2)] | None = None
    generations: Count | None = None
    simplex_rounds: Count | None = None
    tolerance: Positive | None = None

    def over(self, other: Budget) -> Budget:
        """Budget with what is absent here taken from the other one."""
        return Budget(**(other.model_dump(exclude_none=True) | self.model_dump(exclude_none=True)))
