"""What anyone foretells of a recording without a model of the vehicle: a linear regression on its past.

``y[k] = c + sum_j sum_i w_ij s_j[k - h - i d]``, for every channel y by itself: the signals s_j are
velocities, angles, depth and commands, h is how far ahead is foretold and d a fifth of a second, for two
seconds back. Ridge regression on standardised signals. It knows the controller and the period of waves as
well as the vehicle, and is the rival of every prediction from the state of a filter. Held by
``tests/trial/test_linear_predictor.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array, Mask

if TYPE_CHECKING:
    from seatrial.trial.trial import Trial

_SIGNALS = ("u", "v", "w", "p", "q", "r", "z", "roll", "pitch")
_APART_S, _LAGS = 0.2, 10
_RIDGE = 1e-4
_FEWEST = 4  # training samples per regressor


def foretold(
    trials: Sequence[Trial], training: Sequence[Mask], channels: Sequence[str], ahead: int
) -> list[Array]:
    """Channels (n, C) of every trial, foretold `ahead` samples before from what was logged until then.

    NaN where there is no past long enough, everywhere where the training data are too few.

    Parameters
    ----------
    trials
        With one time step.
    training
        Samples (n,) of each that the regression learns from.
    channels
        Those that are foretold.
    ahead
        Samples.
    """
    names = [c for c in _SIGNALS if all(trial.filled(c) is not None for trial in trials)]
    commands = [name for name in trials[0].commands if all(name in trial.commands for trial in trials)]
    apart = max(1, round(_APART_S / trials[0].dt))
    first = ahead + apart * (_LAGS - 1)
    regressors, known = [], []
    for trial, chosen in zip(trials, training, strict=True):
        signals = [trial.filled(c) for c in names] + [trial.commands[name] for name in commands]
        now = np.column_stack([one for one in signals if one is not None])
        past = [now[first - ahead - apart * i : len(now) - ahead - apart * i] for i in range(_LAGS)]
        regressors.append(np.hstack(past) if len(now) > first else np.zeros((0, now.shape[1] * _LAGS)))
        known.append(chosen[first:])
    x, usable = np.vstack(regressors), np.concatenate(known)
    found = [np.full((len(trial), len(channels)), np.nan) for trial in trials]
    if usable.sum() < _FEWEST * x.shape[1]:
        return found
    mean, spread = x[usable].mean(axis=0), x[usable].std(axis=0)
    moving = spread > 0.0
    x = (x[:, moving] - mean[moving]) / spread[moving]
    for column, channel in enumerate(channels):
        measured = [trial.filled(channel) for trial in trials]
        if any(one is None for one in measured):
            continue
        y = np.concatenate([one[first:] for one in measured if one is not None])
        centre = float(y[usable].mean())
        gram = x[usable].T @ x[usable] + _RIDGE * usable.sum() * np.eye(x.shape[1])
        weights = np.linalg.solve(gram, x[usable].T @ (y[usable] - centre))
        place = 0
        for row, own in zip(found, regressors, strict=True):
            row[first : first + len(own), column] = centre + x[place : place + len(own)] @ weights
            place += len(own)
    return found
