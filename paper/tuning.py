"""Plates of a tuning: the speed loop in its corridor, and the speed over set points that change.

After Taubert et al. (2014), figure 19 (corridor) and figure 20 (speed control): the surge loop of the
campaign's autopilot is tuned alone, on the identified vehicle, as the campaign's ``[tuning]`` says. Held by
`tests/examples/test_paper_figures.py`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from paper.plates import Plate
from seatrial.base.errors import SeatrialError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from seatrial._core import Vehicle
    from seatrial.campaign.campaign import Campaign
    from seatrial.identification.identification import Identification
    from seatrial.tuning.result import Tuning

_PAPER = (19, 20)


def without_tuning(vehicle: Vehicle) -> Plate:
    """Why a vehicle without a campaign has no figures of a tuning."""
    why = f"no corridor: nothing says how {vehicle.name} shall respond; give a campaign file with [tuning]"
    return Plate("corridor_surge", why, None, paper=_PAPER)


def tuning_plates(fit: Identification, campaign: Campaign | None) -> Iterator[Plate]:
    """Plates of the surge loop's tuning; where there is none to do, one that says why.

    The search runs when the plates are asked for, and takes tens of seconds.
    """
    vehicle = fit.vehicle
    if campaign is None:
        yield without_tuning(vehicle)
        return
    table = campaign.file.tuning
    if table is None:
        yield replace(without_tuning(vehicle), caption=f"no corridor: {campaign.source} has no [tuning]")
        return
    given = table.loops.given()
    if given and "surge" not in given:
        why = f"no corridor of the speed: {campaign.source} has no [tuning.loops.surge]"
        yield Plate("corridor_surge", why, None, paper=_PAPER)
        return
    try:
        tuning = _tuned(fit, campaign)
    except SeatrialError as error:
        yield Plate("corridor_surge", f"no corridor: {error}", None, paper=_PAPER)
        return
    yield from _drawn(tuning)


def _tuned(fit: Identification, campaign: Campaign) -> Tuning:
    """The surge loop of a campaign, tuned alone on the identified vehicle."""
    from seatrial.tuning.tuning_run import tune

    assert campaign.file.tuning is not None
    asked = campaign.file.tuning.model_dump(exclude_unset=True)
    surge = asked.pop("loops", {}).get("surge") or {}
    if asked.get("sensors", "typical") not in ("typical", "perfect"):
        asked["sensors"] = str(campaign.resolve(asked["sensors"], "tuning.sensors"))
    return tune(fit, campaign.autopilot, loops={"surge": surge}, settings=asked, seed=campaign.seed)


def _finished(figure: Figure) -> Figure:
    """A figure that is drawn already: one of several pages of a loop."""
    return figure


def _drawn(tuning: Tuning) -> Iterator[Plate]:
    from seatrial.report.plot.corridors import speed_steps
    from seatrial.report.plot.tuning import corridors

    start, tuned = tuning.of("start"), tuning.of("tuned")
    if start is None or tuned is None:
        yield Plate("corridor_surge", "no corridor: the tuning was interrupted", None, paper=_PAPER)
        return
    name = tuning.plan.vehicle.name
    data = "Data: simulated steps of the identified vehicle; only the surge loop was tuned."
    for page, figure in enumerate(corridors(start, tuned, "surge"), 1):
        yield Plate(
            "corridor_surge" if page == 1 else f"corridor_surge_{page}",
            f"Constraint criterion of the speed of {name}: the step that is held least at each speed, start"
            f" gains beside tuned ones; hatched, the areas outside that the criterion adds. {data}",
            partial(_finished, figure),
            paper=(19,),
        )
    yield Plate(
        "speed_control",
        f"Speed of {name} over set points that change, with the start gains and with tuned ones. {data}",
        partial(speed_steps, tuning.plan, tuning.start, tuning.autopilot),
        paper=(20,),
    )
