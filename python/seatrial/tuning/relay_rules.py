"""Rules that turn the ultimate gain K_u and the period T_u of a loop into PID gains.

==============  =====  ==========  ==========  =========
rule            kind   K_P         T_i         T_d
==============  =====  ==========  ==========  =========
ziegler-nichols PI     0.45 K_u    T_u / 1.2
ziegler-nichols PID    0.6 K_u     T_u / 2     T_u / 8
tyreus-luyben   PI     K_u / 3.2   2.2 T_u
tyreus-luyben   PID    K_u / 2.2   2.2 T_u     T_u / 6.3
==============  =====  ==========  ==========  =========

with ``K_I = K_P/T_i`` and ``K_D = K_P T_d``. Speed loops are PI: the derivative of a Doppler log is noise.
Ziegler and Nichols aim at a decay ratio of a quarter; Tyreus and Luyben made theirs for integrating
processes, which depth and angles are.

Source: Ziegler and Nichols (1942), Trans. ASME 64; Tyreus and Luyben (1992), Ind. Eng. Chem. Res. 31(11).
Held by tests/test_relay.py.
"""

from __future__ import annotations

from dataclasses import dataclass

from seatrial.errors import SimulationError, nearest

__all__ = ["RULES", "PidGains", "pid_gains"]

RULES: dict[str, dict[str, tuple[float, float, float]]] = {
    "tyreus-luyben": {"PI": (1.0 / 3.2, 2.2, 0.0), "PID": (1.0 / 2.2, 2.2, 1.0 / 6.3)},
    "ziegler-nichols": {"PI": (0.45, 1.0 / 1.2, 0.0), "PID": (0.6, 0.5, 0.125)},
}
"""Per rule and kind of controller K_P/K_u, T_i/T_u and T_d/T_u."""


@dataclass(frozen=True)
class PidGains:
    """``k_p`` in N or N m per unit of the error (m/s, m, rad), ``k_i`` per s, ``k_d`` times s."""

    k_p: float
    k_i: float
    k_d: float


def pid_gains(rule: str, kind: str, *, ultimate_gain: float, period_s: float) -> PidGains:
    """Physical gains of a loop by a rule.

    Parameters
    ----------
    rule : str
        ``tyreus-luyben`` or ``ziegler-nichols``.
    kind : str
        ``PI`` or ``PID``.
    ultimate_gain : float
        K_u in N or N m per unit of the error.
    period_s : float
        T_u, s.

    Raises
    ------
    SimulationError
        The rule is none.

    Examples
    --------
    >>> pid_gains("ziegler-nichols", "PID", ultimate_gain=100.0, period_s=4.0)
    PidGains(k_p=60.0, k_i=30.0, k_d=30.0)
    """
    if rule not in RULES:
        raise SimulationError(
            f"rule: expected a rule of relay tuning, found {rule!r}{nearest(str(rule), RULES)}"
        )
    share, integral, derivative = RULES[rule][kind]
    k_p = share * ultimate_gain
    return PidGains(k_p, k_p / (integral * period_s), k_p * derivative * period_s)
