"""What is known before the next trial: which coefficients are sought, their bounds, what was recorded.

A bound is weak knowledge: a coefficient may lie anywhere between its bounds, with the standard deviation of
that uniform distribution, the width over the square root of twelve. What a campaign recorded adds its
information, one sample per correlation time, nuisance parameters eliminated.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.campaign_file import Axes, Coefficient, Stage
from seatrial.certainty.first_order_memory import widening
from seatrial.certainty.information import eliminate
from seatrial.errors import CampaignError
from seatrial.manoeuvre.fisher import Instruments
from seatrial.parameters import Parameter
from seatrial.parameters import parameters as parsed
from seatrial.search import Array

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.campaign import Campaign
    from seatrial.linearisation import Linearisation

__all__ = ["of_campaign", "of_vehicle", "prior_information", "recorded_information", "seen_by"]

_HULL = re.compile(r"[XYZKMN]_(?:[uvwpqr]{1,2}|[uvwpqr]dot)$")
_RESTORING = ("B", "z_b")


def of_vehicle(vehicle: Vehicle, names: Sequence[str] = ()) -> tuple[Parameter, ...]:
    """Coefficients of the hull that a vehicle has, buoyancy and its height, and others by name.

    Mass, inertia and thrust are taken as known from scales, tape measure and bench test. The bounds are the
    default ones, widened where the vehicle's value lies outside.

    Raises
    ------
    CampaignError
        A name is unknown or has no default bounds.
    """
    values, info = vehicle.coefficients(), vehicle.coefficient_info()
    own = [name for name, x in values.items() if x != 0.0 and (_HULL.match(name) or name in _RESTORING)]
    wanted: dict[str, Coefficient] = {}
    for name in dict.fromkeys([*sorted(own, key=list(info).index), *names]):
        facts, value = info.get(name, {}), values.get(name, 0.0)
        lower, upper = facts.get("lower"), facts.get("upper")
        if lower is not None and upper is not None:
            wanted[name] = Coefficient(bounds=(min(float(lower), value), max(float(upper), value)))
        elif name in names:
            wanted[name] = Coefficient()
    if not wanted:
        raise CampaignError(f"{vehicle.name}: it has no coefficient to plan for; name some")
    stage = Stage(name="plan", trials=("next",), axes=Axes(free="X"), coefficients=wanted)
    return parsed(stage, vehicle, "plan")


def of_campaign(campaign: Campaign, names: Sequence[str] = ()) -> tuple[Parameter, ...]:
    """Parameters of all stages of a campaign, with its bounds, and others of the vehicle by name."""
    found = {
        parameter.name: parameter
        for stage in campaign.stages
        for parameter in campaign.parameters[stage.name]
    }
    missing = [name for name in names if name not in found]
    if missing:
        found |= {p.name: p for p in of_vehicle(campaign.vehicle, missing) if p.name in missing}
    return tuple(found.values())


def prior_information(parameters: Sequence[Parameter]) -> Array:
    """Information (m, m) of the bounds."""
    return np.diag([12.0 / (p.upper - p.lower) ** 2 for p in parameters])


def recorded_information(
    recorded: Linearisation, parameters: Sequence[Parameter], instruments: Instruments
) -> Array:
    """Information (m, m) about the parameters in what was recorded; zero for one that was not estimated.

    The noise is that of the instruments where they measure the channel, otherwise that of the linearisation.
    """
    size = len(recorded.unknowns)
    noise = np.array([
        instruments.noise.get(channel, own)
        for channel, own in zip(recorded.channels, recorded.noise, strict=True)
    ])
    factor = recorded.noise / noise
    total = np.zeros((size, size))
    for piece in recorded.pieces:
        rows = (piece.jacobian * factor[None, :, None]).reshape(-1, size)
        total += rows.T @ rows
    total *= min(recorded.dt / instruments.correlation_s, 1.0)
    total += np.diag([unknown.prior_sd**-2.0 for unknown in recorded.unknowns])
    places = {unknown.name: place for place, unknown in enumerate(recorded.unknowns)}
    shared = [index for index, parameter in enumerate(parameters) if parameter.name in places]
    keep = [places[parameters[index].name] for index in shared]
    # Coefficients that were estimated but are not sought stay unknown; their bounds hold for them too.
    drop = [place for place in range(size) if place not in keep]
    for place in drop:
        unknown = recorded.unknowns[place]
        if unknown.kind == "coefficient" and math.isfinite(unknown.scale):
            total[place, place] += 12.0 / unknown.scale**2
    found = np.zeros((len(parameters), len(parameters)))
    found[np.ix_(shared, shared)] = eliminate(total, keep, drop)
    return found


def seen_by(recorded: Linearisation) -> Instruments:
    """Instruments as good as the residuals of what was recorded: noise and correlation time from them."""
    power, lagged = 0.0, 0.0
    for piece in recorded.pieces:
        error = np.where(piece.counted, piece.residual, 0.0)
        power += float((error[1:] ** 2).sum())
        lagged += float((error[1:] * error[:-1]).sum())
    r = min(max(lagged / power, 0.0), 0.99) if power > 0.0 else 0.0
    return Instruments(
        dict(zip(recorded.channels, map(float, recorded.noise), strict=True)),
        correlation_s=recorded.dt * widening(r),
    )
