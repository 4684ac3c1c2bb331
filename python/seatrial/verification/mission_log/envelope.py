"""The envelope of a mission: what the fitted vehicle, its autopilot and its sensors would have logged.

The mission is flown k times in closed loop, each time with coefficients drawn from their covariance, other
noise of the sensors and, where given, another current; the band of a quantity is that between the 2.5 % and
97.5 % quantiles over the flights at the same time since the start: the ranks 0.025 (k + 1) and 0.975 (k +
1), between which a further flight of the same kind falls with 95 % (Weibull 1939; Hyndman & Fan 1996, The
American Statistician 50:361, definition 6). They exist from 39 flights on; where fewer are still under way
there is no band. A closed loop hides errors of the model, and a delay of some seconds shifts all that
follows: the envelope shows how the mission went, and the verdict rests on
`seatrial.verification.mission_log.validity`.

Tests: ``tests/verification/test_recorded_mission.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial._core import State
from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError
from seatrial.base.frames import shorter
from seatrial.verification.mission_log.metrics import errors_of_guidance

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Flights
    from seatrial.flight.mission import Mission
    from seatrial.identification.fitted import Fitted
    from seatrial.verification.mission_log.log import MissionLog

FEWEST_FLIGHTS = 39
"""Of fewer, no rank leaves 2.5 % on either side."""

QUANTITIES: Mapping[str, tuple[str, str]] = {
    "depth": ("depth", "m"),
    "speed": ("speed", "m/s"),
    "pitch": ("pitch", "rad"),
    "cross_track": ("cross-track error", "m"),
    "heading": ("heading error", "rad"),
}
"""Words and SI unit of every quantity of an envelope."""


@dataclass(frozen=True, eq=False)
class Band:
    """One quantity: 2.5 %, 50 % and 97.5 % over the flights and the log, all (n,), SI.

    ``outside`` is the share of the log's samples outside the band.
    """

    lower: Array
    middle: Array
    upper: Array
    log: Array
    outside: float

    @property
    def is_outside(self) -> NDArray[np.bool_]:
        """Samples of the log outside the band, (n,)."""
        with np.errstate(invalid="ignore"):
            return np.asarray((self.log < self.lower) | (self.log > self.upper))


@dataclass(frozen=True, eq=False)
class Envelope:
    """Envelope of a mission with the log in it.

    Attributes
    ----------
    t
        Times since the start of the log, (n,), s.
    bands
        A `Band` by the name of the quantity, see `QUANTITIES`.
    flights
        How many flights it rests on.
    metrics
        Metrics of the flights, (k,) each, by the names of `Flight.metrics`.
    """

    t: Array
    bands: Mapping[str, Band]
    flights: int
    metrics: Mapping[str, Array]

    def to_dict(self) -> dict[str, Any]:
        """Share outside by quantity, and quantiles of the metrics, as plain data."""
        return {
            "flights": self.flights,
            "outside": {name: band.outside for name, band in self.bands.items()},
            "metrics": {
                name: [float(x) for x in prediction_band(values)]
                for name, values in self.metrics.items()
                if np.isfinite(values).any()
            },
        }


def prediction_band(values: Array) -> Array:
    """Values (3, ...) between the outer two of which a further one of k falls with 95 %, and their median.

    `values` (k, ...) are of at least 39 flights; nan where a flight has none.
    """
    # Median and ends of the middle 95 %.
    return np.asarray(np.nanquantile(values, (0.025, 0.5, 0.975), axis=0, method="weibull"))


def mission_envelope(
    fitted: Fitted,
    log: MissionLog,
    autopilot: Autopilot,
    mission: Mission,
    *,
    flights: int = 64,
    seed: int = 0,
    sensors: Any = None,
    current: ArrayLike | None = None,
    voltage_v: float | None = None,
) -> Envelope:
    """Envelope of a mission with the log in it.

    Parameters
    ----------
    fitted : Fitted
        The vehicle and how well it is known.
    log : MissionLog
    autopilot : Autopilot
    mission : Mission
        What was flown.
    flights : int, optional
        How many flights, at least 39; of some more, a few may end before the log does.
    seed : int, optional
    sensors : optional
        As for `seatrial.fly`.
    current : (3,) or (flights, 3) array_like, optional
        North, east, down, m/s; the mean of the recorded one when omitted.
    voltage_v : float, optional
        Supply, V; the mean of the recorded one when omitted.

    Raises
    ------
    SimulationError
        Too few flights, or too many of them diverged.
    """
    from seatrial.flight.conditions import Conditions, Water
    from seatrial.flight.fly import fly_batch
    from seatrial.flight.metrics import CODED, metrics_of

    if flights < FEWEST_FLIGHTS:
        raise SimulationError(
            f"flights: expected at least {FEWEST_FLIGHTS} for a band of 95 %, found {flights}; fly more"
        )
    trial = log.trial
    if current is None:
        current = np.zeros(3) if trial.current is None else np.nanmean(trial.current, axis=0)
    if voltage_v is None and trial.voltage_v is not None:
        voltage_v = float(np.nanmean(trial.voltage_v))
    first = int(np.flatnonzero(trial.startable)[0]) if trial.startable.any() else 0
    drawn = fitted.draws(flights, seed) if fitted.names else None
    flown = fly_batch(
        fitted.vehicle,
        autopilot,
        mission,
        coefficients=drawn,
        conditions=Conditions(
            model=fitted.vehicle, sensors=sensors, initial=State(*trial.state(first)), voltage_v=voltage_v
        ),
        water=Water(current=current, rho=trial.rho, g=trial.g),
        seeds=[seed + 1 + k for k in range(flights)],
        logs=True,
    )
    t = trial.t - trial.t[first]
    t = t[t >= 0.0]
    shown = [_quantities(flown, case, t) for case in range(flights)]
    recorded = _recorded(log, mission, first)
    bands = {}
    for name in QUANTITIES:
        if name not in recorded:
            continue
        stack = np.stack([one[name] for one in shown])
        enough = np.isfinite(stack).sum(axis=0) >= FEWEST_FLIGHTS
        lower, middle, upper = np.full((3, len(t)), np.nan)
        if enough.any():
            lower[enough], middle[enough], upper[enough] = prediction_band(stack[:, enough])
        band = Band(lower, middle, upper, recorded[name], 0.0)
        seen = np.isfinite(lower) & np.isfinite(band.log)
        share = float(band.is_outside[seen].mean()) if seen.any() else float("nan")
        bands[name] = Band(lower, middle, upper, band.log, share)
    if not any(np.isfinite(band.middle).any() for band in bands.values()):
        raise SimulationError(
            f"{fitted.vehicle.name}: fewer than {FEWEST_FLIGHTS} of {flights} flights of {mission.name} did"
            " not diverge; check the autopilot and the covariance of the coefficients, or fly more"
        )
    metrics = {name: value for name, value in metrics_of(flown).items() if name not in CODED}
    return Envelope(t, bands, flights, metrics)


def _quantities(flown: Flights, case: int, t: Array) -> dict[str, Array]:
    """Quantities of a flight at times (n,), nan after its end; angles without jumps."""
    columns = dict(zip(flown.columns, np.asarray(flown.log(case)).T, strict=True))
    own = np.asarray(flown.t(case))
    rows = np.searchsorted(own, t + 1e-6, side="right") - 1
    over = t > own[-1] + 1e-6

    def held(values: Array) -> Array:
        return np.where(over, np.nan, values[np.clip(rows, 0, len(own) - 1)])

    return {
        "depth": held(columns["measured_z"]),
        "speed": held(columns["measured_u"]),
        "pitch": held(columns["measured_pitch"]),
        "cross_track": held(columns["cross_track"]),
        "heading": shorter(held(columns["desired_heading"] - columns["measured_yaw"])),
    }


def _recorded(log: MissionLog, mission: Mission, first: int) -> dict[str, Array]:
    found = {
        name: log.trial.channel(channel)
        for name, channel in (("depth", "z"), ("speed", "u"), ("pitch", "pitch"))
        if channel in log.trial.channels
    }
    errors = errors_of_guidance(log, mission)
    found |= {name: errors[name] for name in ("cross_track", "heading") if name in errors}
    return {name: values[first:] for name, values in found.items()}
