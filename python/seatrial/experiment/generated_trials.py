"""Generated trials with any seed of the sensors: other noise and other biases, the same known truth.

A recorded campaign has one realisation and no known truth. The motion of a generated trial is simulated once;
a seed changes only what the sensors make of it. A trial that an autopilot sails is flown anew, in another sea
of the same state. Held by ``tests/experiment/test_coverage.py``.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError
from seatrial.campaign.campaign import Campaign
from seatrial.problem.problem import Problem
from seatrial.sensors.log import biases
from seatrial.trial.generated import Recipe
from seatrial.trial.truth import Truth

if TYPE_CHECKING:
    from seatrial._core import Run
    from seatrial.estimation.joint import Joint
    from seatrial.flight.flight import Flight

_SAME = 1e-9

_CURRENT = ("current_north", "current_east", "current_down")


class GeneratedTrials:
    """Generated trials of a campaign, simulated once and logged with any seed of the sensors.

    Parameters
    ----------
    campaign : Campaign
        All of its trials are generated, by one truth vehicle.
    truth : Truth, optional
        Simulates all of them instead of the recipes' own.

    Attributes
    ----------
    truth
        The vehicle that is simulated.
    recipes
        How each trial is generated, by its name.

    Raises
    ------
    CampaignError
        There is no trial, a trial is a recording, or two trials have different truth vehicles.
    TrialError, VehicleError
        A recipe or its truth vehicle is not usable.
    """

    def __init__(self, campaign: Campaign, *, truth: Truth | None = None) -> None:
        if not campaign.trials:
            raise CampaignError(
                f"{campaign.source}: [trials]: expected at least one generated trial, found none;"
                " coverage needs the recipe of one (TOML)"
            )
        self.campaign = campaign
        self.recipes = {name: _recipe(campaign, name, truth) for name in campaign.trials}
        self.truth = next(iter(self.recipes.values())).truth
        for name, recipe in self.recipes.items():
            if recipe.truth.sailed != self.truth.sailed:
                raise CampaignError(
                    f"{campaign.source}: trial {name!r} has another truth vehicle than"
                    f" {next(iter(self.recipes))!r}; coverage needs one right answer: give all recipes the"
                    " same truth"
                )
        self._runs: dict[str, Run | Flight] = {}

    def logged(self, seed: int) -> Problem:
        """The campaign's problem with trials as the sensors log them with this seed."""
        tables = {}
        for name, recipe in self.recipes.items():
            if recipe.sailed is None and name not in self._runs:
                self._runs[name] = recipe.run()
            tables[name] = recipe.table(run=self._runs.get(name), seed=sensor_seed(name, seed))
        here = self.campaign
        other = Campaign(here.file, text=here.text, source=here.source, folder=here.folder, trials=tables)
        return other.problem()

    def true_values(self, joint: Joint, seed: int) -> Array:
        """True values (m,) of the unknowns of a joint estimate of ``logged(seed)``; NaN where there is none.

        A parameter that sets several coefficients has a true value only if it suits all of them. Latencies
        have none: the reader of a trial removes what it finds.
        """
        true = self.truth.vehicle.coefficients()
        values = []
        for parameter in joint.parameters:
            wanted = [true.get(name, 0.0) / factor for name, factor in parameter.members]
            same = all(math.isclose(x, wanted[0], rel_tol=_SAME, abs_tol=1e-12) for x in wanted)
            values.append(wanted[0] if same else math.nan)
        for nuisance in joint.nuisances:
            trials = [joint.data.names[index] for index in nuisance.trials]
            shown = [self._true_nuisance(nuisance.key, trial, seed) for trial in trials]
            values.append(shown[0] if all(x == shown[0] for x in shown) else math.nan)
        return np.array(values)

    def outside(self, joint: Joint) -> dict[str, tuple[float, float]]:
        """Assumed and true value of coefficients whose true value the estimate cannot reach.

        Empty if the truth is inside the model class.
        """
        true, assumed = self.truth.vehicle.coefficients(), joint.vehicle.coefficients()
        free = {name for parameter in joint.parameters for name, _ in parameter.members}
        found = {}
        for name in sorted({*true, *assumed} - free):
            pair = assumed.get(name, 0.0), true.get(name, 0.0)
            if not math.isclose(*pair, rel_tol=_SAME, abs_tol=1e-12):
                found[name] = pair
        right = self.true_values(joint, 0)
        for parameter, value in zip(joint.parameters, right[: len(joint.parameters)], strict=True):
            if math.isnan(value) or not parameter.lower <= value <= parameter.upper:
                for name, _ in parameter.members:
                    found[name] = assumed.get(name, 0.0), true.get(name, 0.0)
        return found

    def _true_nuisance(self, key: str, trial: str, seed: int) -> float:
        if key in _CURRENT:
            sailed = self.recipes[trial].sailed
            if sailed is not None and (sailed.current.varies or sailed.waves is not None):
                return math.nan
            return float(self.recipes[trial].current[_CURRENT.index(key)])
        kind, _, channel = key.partition("_")
        if kind == "bias":
            return biases(self.truth.sensors, seed=sensor_seed(trial, seed)).get(channel, 0.0)
        return math.nan if kind == "latency" else 0.0


def sensor_seed(trial: str, seed: int) -> int:
    """Seed of the sensors of a trial in one repetition."""
    return int(np.random.SeedSequence([seed, zlib.crc32(trial.encode())]).generate_state(1)[0])


def unmodelled(outside: Mapping[str, tuple[float, float]]) -> str:
    """Coefficients that differ in the truth, in words: ``Y_rdot -15 (assumed 0)``."""
    return ", ".join(
        f"{name} {true:.4g} (assumed {assumed:.4g})" for name, (assumed, true) in outside.items()
    )


def _recipe(campaign: Campaign, trial: str, truth: Truth | None) -> Recipe:
    path, reader = campaign.path_of(trial), campaign.source_of(trial).reader or campaign.file.reader
    if path is None or not (reader == "generated" or (reader is None and path.suffix == ".toml")):
        raise CampaignError(
            f"{campaign.source}: trial {trial!r} is a recording ({path or 'a table'}), whose true"
            " coefficients are unknown; coverage needs generated trials: give the recipe of one (TOML, see"
            " examples/cwolf)"
        )
    return Recipe.load(path, truth=truth)
