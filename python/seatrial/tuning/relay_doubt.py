"""Why no rule may rely on a limit cycle of a relay.

================  ========================================================================================
limit             because
================  ========================================================================================
6 samples         of a cycle: below, it is the sampling that oscillates
8 deg             from the phase crossover: the ultimate gain changes by 2 to 6 % per degree
15 %              scatter of periods or amplitudes: no limit cycle, or noise
85 %              of the time on one side: what is left of the other side is a few samples
================  ========================================================================================

Held by tests/test_relay_doubt.py.
"""

from __future__ import annotations

from seatrial.tuning.relay_cycle import Cycle

__all__ = ["doubt", "scatters"]

_SAMPLES, _CROSSING_DEG, _SCATTER, _DUTY = 6.0, 8.0, 0.15, 0.85


def doubt(cycle: Cycle, sample_s: float) -> str:
    """Why no rule may rely on a cycle that is sampled every so many seconds; empty where one may.

    Examples
    --------
    >>> doubt(Cycle(0.4, 0.0, 0.1, 0.0, 250.0, 0.0, 0.5, 12), 0.1)
    'a cycle of 0.4 s is that of the sampling every 0.1 s'
    """
    if cycle.period_s < _SAMPLES * sample_s:
        return f"a cycle of {cycle.period_s:.2g} s is that of the sampling every {sample_s:g} s"
    if abs(cycle.phase_deg) > _CROSSING_DEG:
        return f"the first harmonics are {abs(cycle.phase_deg):.0f} deg from the phase crossover"
    if scatters(cycle):
        worst = max(cycle.period_scatter, cycle.amplitude_scatter)
        return f"the cycles scatter by {100.0 * worst:.0f} %"
    if not 1.0 - _DUTY <= cycle.duty <= _DUTY:
        side = max(cycle.duty, 1.0 - cycle.duty)
        return f"the relay stays on one side for {100.0 * side:.0f} % of the time"
    return ""


def scatters(cycle: Cycle) -> bool:
    """Whether periods or amplitudes of a cycle scatter too much."""
    return max(cycle.period_scatter, cycle.amplitude_scatter) > _SCATTER
