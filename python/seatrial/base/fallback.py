"""Steps that may fail numerically, and what is kept where one does: a finding as data, in one place.

A result that took minutes is not lost to a by-product. `Fallbacks` runs each step that follows it: where the
step has no finite result, or the model that was found cannot be what the step needs, the value from before
stays and a `Fallback` says which step, why, and what to do. Ctrl-C and programming errors pass.

Tests: ``tests/identification/test_fallbacks.py``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeVar

from seatrial.base.errors import CampaignError, SimulationError, TrialError, VehicleError

T = TypeVar("T")

Kind = Literal["numerical", "refused"]


@dataclass(frozen=True)
class Fallback:
    """A step without a result, and what stands in its place.

    Attributes
    ----------
    step
        Name of the step.
    kind
        "numerical": it diverged or has no finite result; "refused": what was found does not suit it.
    cause
        What failed, as the step says it.
    kept
        What the result has instead.
    remedy
        What to do.
    """

    step: str
    kind: Kind
    cause: str
    kept: str
    remedy: str

    @property
    def sentence(self) -> str:
        """All of it in words."""
        cause = self.cause.rstrip(".")
        return f"{self.step} failed: {cause}. Kept instead: {self.kept}; {self.remedy}"


def is_numerical(error: BaseException) -> bool:
    """Whether an error says that numbers failed, and not that a program or its input is wrong.

    Libraries raise a plain ValueError for arrays with infinite values: that counts where SciPy itself, or
    NumPy's check for finite numbers, raised it.

    Examples
    --------
    >>> import numpy as np
    >>> is_numerical(np.linalg.LinAlgError("Singular matrix")), is_numerical(KeyError("u"))
    (True, False)
    """
    from numpy.linalg import LinAlgError

    if isinstance(error, LinAlgError | ArithmeticError):
        return True
    if type(error) is not ValueError or error.__traceback__ is None:
        return False
    last = error.__traceback__
    while last.tb_next is not None:
        last = last.tb_next
    module = str(last.tb_frame.f_globals.get("__name__", ""))
    return module.split(".")[0] == "scipy" or last.tb_frame.f_code.co_name == "asarray_chkfinite"


class Fallbacks:
    """Workspace: the steps that failed so far, in their order."""

    def __init__(self) -> None:
        self.findings: list[Fallback] = []

    def attempt(self, step: str, work: Callable[[], T], otherwise: T, *, kept: str, remedy: str) -> T:
        """Result of a step, or what was there before where the step fails.

        `step` is its name, `kept` says in words what was there before, `remedy` what to do where it fails.
        """
        try:
            return work()
        except Exception as error:
            self.add(step, error, kept=kept, remedy=remedy)
        return otherwise

    def add(self, step: str, error: BaseException, *, kept: str, remedy: str) -> None:
        """Keep the finding on an error; raise the error where it is no failure of numbers or data.

        Raises
        ------
        BaseException
            The error itself.
        """
        # Not every SeatrialError: a folder that cannot be written or a lost worker fails no step.
        refused = isinstance(error, CampaignError | SimulationError | TrialError | VehicleError)
        if not refused and not is_numerical(error):
            raise error
        cause = str(error) or type(error).__name__
        self.findings.append(Fallback(step, "refused" if refused else "numerical", cause, kept, remedy))
