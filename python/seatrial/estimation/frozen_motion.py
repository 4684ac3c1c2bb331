"""Frozen axes that move: where V_const = 0 (Taubert et al. 2014, equation 6) does not suit the recording.

A frozen axis keeps the velocity that it has at the start of a segment. Where the vehicle changes it within
the segment, the damping, lift and inflow that it causes are wrong, and a frozen rate turns the attitude away,
weight and buoyancy with it. The stage's coefficients absorb the difference. Such an axis is better replayed
from the recording, or the segments made shorter.

Held by `test_frozen_axis_that_moves_is_named`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.channels import AXES, CHANNELS, DEGREE

if TYPE_CHECKING:
    from seatrial.estimation.stage import StagePlan

__all__ = ["frozen_motion", "frozen_sentences"]

_PART = 0.1
"""Part of the largest speed of all trials by which a frozen velocity may move without a word."""

_ANGLE = 3.0 * DEGREE
"""Angle by which a frozen rate may turn the attitude away without a word, rad."""


def frozen_motion(plan: StagePlan) -> dict[str, float]:
    """Motion that a stage's frozen axes miss, by letter: rms over its segments.

    Of a velocity its change since the start of the segment, m/s; of a rate the integral of that, rad. Axes
    whose velocity is not recorded are left out.
    """
    axes, trials = plan.stage.axes, plan.data.trials
    squares, samples = np.zeros(6), 0
    for piece in plan.data.segments:
        trial = trials[piece.record]
        away = trial.smooth_nu(trial.t[piece.start : piece.stop])[0] - np.asarray(piece.nu)
        away[:, 3:] = np.cumsum(away[:, 3:], axis=0) * trial.dt
        squares += np.nansum(away**2, axis=0)
        samples += len(away)
    return {
        axis: float(np.sqrt(squares[k] / samples))
        for k, axis in enumerate(AXES)
        if axis not in axes.free + axes.measured and all(CHANNELS[k] in trial.channels for trial in trials)
    }


def frozen_sentences(plans: Sequence[StagePlan]) -> tuple[str, ...]:
    """A sentence per stage whose frozen axes move noticeably in its recordings."""
    largest = max((float(plan.data.largest_speeds()[:3].max()) for plan in plans), default=0.0)
    lines = []
    for plan in plans:
        named = []
        for axis, moved in frozen_motion(plan).items():
            channel = CHANNELS[AXES.index(axis)]
            if axis in "XYZ" and moved > _PART * largest:
                named.append(f"{axis} ({channel} changes by {moved:.2g} m/s)")
            elif axis in "KMN" and moved > _ANGLE:
                named.append(f"{axis} (the attitude is turned by {moved / DEGREE:.2g} deg)")
        if named:
            lines.append(
                f"stage {plan.stage.name!r} freezes axes that move within its segments: {', '.join(named)};"
                " its coefficients absorb that. Replay them (measured) or shorten segment_s"
            )
    return tuple(lines)
