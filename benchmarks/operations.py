"""Floating-point operations of one time step, counted in the CasADi expression of the model.

The count is of the mathematics, so that redundant work of an implementation does not raise its rate:
structural zeros, ones and repeated subexpressions are removed first. Additions, subtractions,
multiplications, divisions and square roots count as one operation each, elementary functions (exponential,
arctangent) as one as well; signs, moduli, minima, maxima, comparisons, selections, copies and all look-ups
in the record count nothing. A fused multiply-add is two operations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from benchmarks.casadi_model import ca, expressions
from benchmarks.textbook_vehicle import Parameters

ARITHMETIC = ("ADD", "SUB", "MUL", "DIV", "SQ", "TWICE", "INV", "SQRT")
ELEMENTARY = ("EXP", "LOG", "POW", "SIN", "COS", "TAN", "ATAN", "ATAN2", "ASIN", "ACOS")
# Per channel: difference, weight, sum; the modulus is free.
CRITERION = 3 * 12


@dataclass(frozen=True)
class Operations:
    """Operations per step of the model and per sample of the criterion."""

    step: int
    sample: int

    def per_step(self, substeps: int) -> float:
        """Return the operations per step where a sample has ``substeps`` of them."""
        return self.step + self.sample / substeps


def operations(function: Any) -> int:
    """Return the number of arithmetic operations of a CasADi function of scalars."""
    counted = {getattr(ca, f"OP_{name}") for name in ARITHMETIC + ELEMENTARY}
    return sum(function.instruction_id(i) in counted for i in range(function.n_instructions()))


def count(parameters: Parameters, *, motors: bool = True, current: bool = False) -> Operations:
    """Return the operations of the whole chain, or without ``motors`` of hull and hydrodynamics alone."""
    e = expressions(parameters, 0.1, motors=motors, current=current)
    return Operations(step=operations(e.step), sample=operations(e.channels) + CRITERION)
