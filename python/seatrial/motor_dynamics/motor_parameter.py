"""What is known of one parameter of a motor: its value and interval, or why there is none."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from seatrial.motor_dynamics.motor_model import symbol

__all__ = ["MotorParameter"]


@dataclass(frozen=True)
class MotorParameter:
    """One parameter; ``value``, ``sigma`` and the 95 % interval are None where it is not determined.

    Attributes
    ----------
    name, unit
        As ``n_acc_ahead`` and ``rpm/s``; the unit of K_V is that of the measurement per that of the command.
    value, sigma, lower, upper
        Estimate, standard deviation, 95 % interval.
    dof
        Degrees of freedom of the interval, zero where there is none.
    reason
        Why it is not determined; empty where it is.
    at_least, at_most
        What the data say all the same of a parameter that is not determined.
    kept
        The vehicle's value, which stays where the parameter is not determined; None if there is none.
    remark
        What the value holds for, where it does not hold alone.
    """

    name: str
    unit: str
    value: float | None = None
    sigma: float | None = None
    lower: float | None = None
    upper: float | None = None
    dof: float = 0.0
    reason: str = ""
    at_least: float | None = None
    at_most: float | None = None
    kept: float | None = None
    remark: str = ""

    @property
    def determined(self) -> bool:
        """Whether the data determine it."""
        return self.value is not None

    @property
    def status(self) -> str:
        """Whether it is determined, and if not, why not."""
        return "determined" if self.determined else f"not determined: {self.reason}"

    @property
    def contradicted(self) -> bool:
        """Whether the data rule out the value that is kept."""
        if self.kept is None or self.determined:
            return False
        slack = 1e-9 * abs(self.kept)
        below = self.at_least is not None and self.kept < self.at_least - slack
        return below or (self.at_most is not None and self.kept > self.at_most + slack)

    def sentence(self) -> str:
        """What is known, in one sentence.

        Examples
        --------
        >>> MotorParameter("T_t", "s", 0.1234, 0.0021, 0.119, 0.128, 12.0).sentence()
        'T_t = 0.1234 s ± 0.0021, 95 % interval 0.1190 to 0.1280 s.'
        """
        label, unit = symbol(self.name), "" if self.unit == "1" else f" {self.unit}"
        if self.value is not None and self.sigma is not None:
            digits = 4 if self.sigma <= 0 else max(0, 1 - math.floor(math.log10(self.sigma)))
            lower, upper = (f"{_number(edge):.{digits}f}" for edge in (self.lower, self.upper))
            return (
                f"{label} = {self.value:.{digits}f}{unit} ± {self.sigma:.{digits}f}, 95 % interval {lower} to"
                f" {upper}{unit}{self.remark and f'; {self.remark}'}."
            )
        text = f"{label} is not determined: {self.reason}"
        for known, word in ((self.at_least, "at least"), (self.at_most, "at most")):
            if known is not None:
                text += f"; it is {word} {known:.4g}{unit}"
        if self.kept is None:
            return text + "."
        if math.isinf(self.kept):
            return text + "; the vehicle file has no such limit."
        if self.contradicted:
            return text + f"; this contradicts the vehicle file's {self.kept:.4g}{unit}: correct it by hand."
        return text + f"; the vehicle file's {self.kept:.4g}{unit} is kept."

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and texts; infinite ones are None."""
        plain = {
            key: None if isinstance(entry, float) and not math.isfinite(entry) else entry
            for key, entry in asdict(self).items()
        }
        return plain | {"status": self.status}


def _number(value: float | None) -> float:
    return math.nan if value is None else value
