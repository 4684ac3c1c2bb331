"""A suspect: one change of the vehicle, or of its surroundings, and how much of a misfit it explains.

Tests: ``tests/test_recorded_suspects.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["Suspect"]


@dataclass(frozen=True)
class Suspect:
    """A change of the vehicle, or of its surroundings, that explains a part of the misfit.

    Attributes
    ----------
    name, kind
        Of the candidate: a "coefficient", a "group", an "actuator", a "sensor" or the "surroundings".
    change
        In words.
    values, units, sigma
        The best values of its unknowns, their units, and the standard deviation over windows.
    gain
        Share of the misfit (sum of squares) that it explains, simulated anew.
    left
        Root mean square of what it leaves, in units of a valid model's error.
    p
        Of no change, jackknife over windows, times the number of unknowns that were tried (Bonferroni).
    sigmas
        Change over the identified standard deviation; None where that is not known.
    alike
        Candidates that this log cannot tell from it.
    coefficients
        Values {name: value} that it would give the vehicle.
    """

    name: str
    kind: str
    change: str
    values: tuple[float, ...]
    units: tuple[str, ...]
    sigma: tuple[float, ...]
    gain: float
    left: float
    p: float
    sigmas: float | None
    alike: tuple[str, ...]
    coefficients: Mapping[str, float]

    def sentence(self) -> str:
        """The suspect in words."""
        share = f"{100.0 * self.gain:.{1 if self.gain > 0.99 else 0}f}"
        text = (
            f"{self.change}: explains {share} % of the misfit, leaves {self.left:.2g} times the usual error"
        )
        if self.sigmas is not None and abs(self.sigmas) >= 0.1:
            text += f", {abs(self.sigmas):.1f} standard deviations of the identification"
        if self.alike:
            shown = ", ".join(self.alike[:4]) + (" and others" if len(self.alike) > 4 else "")
            text += f"; this log cannot tell it from {shown}"
        return text + "."

    def to_dict(self) -> dict[str, Any]:
        """The suspect as plain data."""
        return {
            "name": self.name,
            "kind": self.kind,
            "change": self.change,
            "values": list(self.values),
            "units": list(self.units),
            "sigma": list(self.sigma),
            "gain": self.gain,
            "left": self.left,
            "p": self.p,
            "sigmas": self.sigmas,
            "alike": list(self.alike),
            "coefficients": dict(self.coefficients),
        }
