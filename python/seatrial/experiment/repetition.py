"""One repetition of a generated campaign: sailed with a seed, estimated jointly, compared with the truth.

Generated trials sailed again: other noise and other biases, the same truth.

What a recorded campaign never has: as many repetitions as one likes, and the right answer. The motion is
simulated once; a seed changes only what the sensors make of it.
"""

from __future__ import annotations

import math
import time
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError
from seatrial.campaign.campaign import Campaign
from seatrial.diagnosis.identifiability import judge
from seatrial.diagnosis.residual_analysis import analyse_joint
from seatrial.diagnosis.weak_combination import WEAK
from seatrial.estimation.gauss_newton import GaussNewton
from seatrial.estimation.joint import Joint
from seatrial.estimation.joint_estimate import Polished, linearise, polish
from seatrial.sensors.log import biases
from seatrial.statistics.uncertainty import covariance
from seatrial.trial.generated import Recipe
from seatrial.trial.truth import Truth

if TYPE_CHECKING:
    from seatrial._core import Run, Vehicle
    from seatrial.base.progress import Step

__all__ = ["Draw", "Held", "Resailing", "draw", "hold", "sensor_seed", "unmodelled"]

_AWAY = 0.25  # of the width of the bounds

_COST_95 = 1.92  # half the 95 % quantile of chi-squared with one degree of freedom

_SETTLE = 3

_AHEAD_S = 10.0


@dataclass(frozen=True)
class Draw:
    """What one repetition found; lists over the unknowns, in their units.

    Attributes
    ----------
    seed
        Of the sensors' noise and biases.
    names, units, kinds
        Of the unknowns; kinds are "coefficient" and "nuisance".
    truth
        Right values, NaN where there is none.
    estimate, sigma, lower, upper
        Estimates, standard deviations and 95 % intervals.
    verdict
        Of `seatrial.diagnosis.identifiability.judge`; for a nuisance parameter "prior" where the data add
        little.
    residual_analysis
        What the residual analysis says; empty if it has nothing to say, None if it was not asked.
    hold_out
        R2 by vehicle ("start", "estimate", "truth") and channel on the held-out trials, ten seconds ahead.
    converged, rounds, wall_s
        How the joint polish ended.
    """

    seed: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    kinds: tuple[str, ...]
    truth: tuple[float, ...]
    estimate: tuple[float, ...]
    sigma: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    verdict: tuple[str, ...]
    residual_analysis: tuple[str, ...] | None
    hold_out: Mapping[str, Mapping[str, float]]
    converged: bool
    rounds: int
    wall_s: float

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, texts, lists and dicts."""
        return asdict(self)

    @classmethod
    def from_dict(cls, kept: Mapping[str, Any]) -> Draw:
        """The draw that `to_dict` wrote; JSON has no infinity and no NaN, null stands for both."""
        values = {name: kept[name] for name in cls.__dataclass_fields__}
        for name in ("names", "units", "kinds", "verdict"):
            values[name] = tuple(values[name])
        values["residual_analysis"] = (
            None if kept["residual_analysis"] is None else tuple(kept["residual_analysis"])
        )
        missing = {"truth": math.nan, "estimate": math.nan, "sigma": math.inf}
        missing |= {"lower": -math.inf, "upper": math.inf}
        for name, value in missing.items():
            values[name] = tuple(value if x is None else float(x) for x in values[name])
        values["hold_out"] = {
            vehicle: {channel: -math.inf if r2 is None else float(r2) for channel, r2 in of.items()}
            for vehicle, of in kept["hold_out"].items()
        }
        return cls(**values)


@dataclass(frozen=True)
class Held:
    """A coefficient held at a wrong value and everything else estimated again.

    ``rise`` is what that costs, half the log-likelihood ratio; below 1.92 the data do not contradict the
    value at the level of 95 %.
    """

    name: str
    unit: str
    estimate: float
    value: float
    rise: float

    @property
    def contradicted(self) -> bool:
        """Whether the data tell that the value is wrong."""
        return not self.rise < _COST_95

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and texts."""
        return asdict(self)

    @classmethod
    def from_dict(cls, kept: Mapping[str, Any]) -> Held:
        """The result that `to_dict` wrote; a refit that diverged is null."""
        return cls(**(dict(kept) | {"rise": math.inf if kept["rise"] is None else kept["rise"]}))


def draw(
    resailing: Resailing,
    seed: int,
    *,
    analysed: bool = False,
    threads: int | None = None,
    watch: Callable[[Step], None] | None = None,
) -> Draw:
    """What one seed leads to, from the campaign's start values.

    Parameters
    ----------
    resailing : Resailing
    seed : int
    analysed : bool
        Whether to ask the residual analysis too, which takes longer than the estimate.
    threads : int, optional
        Threads of the core; the result does not depend on it.
    watch : callable, optional
        Called after every round of the polish.

    Raises
    ------
    KeyboardInterrupt
        The polish was interrupted: half a repetition is none.
    """
    began = time.monotonic()
    campaign = resailing.sail(seed)
    joint = Joint(campaign, threads=threads)
    polished = polish(joint, watch=watch)
    if polished.interrupted:
        raise KeyboardInterrupt
    lin = linearise(joint, polished.values, initial=polished.initial, noise=polished.noise)
    found = covariance(lin)
    said = {
        one.name: one.verdict
        for one in judge(lin, dict(zip(found.names, found.sigma, strict=True))).coefficients
    }
    vehicles = {
        "start": campaign.vehicle,
        "estimate": joint.identified(polished.values),
        "truth": resailing.truth.vehicle,
    }
    return Draw(
        seed=seed,
        names=found.names,
        units=found.units,
        kinds=tuple(unknown.kind for unknown in lin.unknowns),
        truth=_floats(resailing.right(joint, seed)),
        estimate=_floats(found.estimate),
        sigma=_floats(found.sigma),
        lower=_floats(found.lower),
        upper=_floats(found.upper),
        verdict=tuple(
            said[one.name] if one.kind == "coefficient" else _told(sd / one.prior_sd)
            for one, sd in zip(lin.unknowns, found.sigma, strict=True)
        ),
        residual_analysis=_analysis(joint, polished) if analysed else None,
        hold_out={name: _hold_out(campaign, joint, vehicle) for name, vehicle in vehicles.items()},
        converged=polished.converged,
        rounds=polished.rounds,
        wall_s=time.monotonic() - began,
    )


def hold(
    resailing: Resailing, seed: int, names: Sequence[str], *, threads: int | None = None
) -> tuple[Held, ...]:
    """Each coefficient held a quarter of its bounds' width beside its estimate, the rest fitted again.

    What the data cannot tell may be set to such a value without any loss, however wrong it is. A value beyond
    a bound is left out.
    """
    joint = Joint(resailing.sail(seed), threads=threads)
    free = polish(joint)
    if free.interrupted:
        raise KeyboardInterrupt
    least = _cost(joint, free, free.noise)
    places = {unknown.name: index for index, unknown in enumerate(joint.unknowns)}
    found = []
    for name in names:
        index, one = places[name], joint.unknowns[places[name]]
        for side in (-1.0, 1.0):
            value = free.values[index] + side * _AWAY * (one.upper - one.lower)
            if not one.lower <= value <= one.upper:
                continue
            start = free.values.copy()
            start[index] = value
            refit = polish(joint, start=start, fixed=[index])
            if refit.interrupted:
                raise KeyboardInterrupt
            rise = _cost(joint, refit, free.noise) - least
            found.append(Held(name, one.unit, float(free.values[index]), float(value), rise))
    return tuple(found)


def _analysis(joint: Joint, found: Polished) -> tuple[str, ...]:
    """What the residual analysis says, its warning first."""
    said = analyse_joint(joint, found.values, initial=found.initial, noise=found.noise)
    if said.warning is None:
        return ()
    return (said.warning, *(one.sentence for one in said.suggestions))


def _cost(joint: Joint, found: Polished, noise: Array) -> float:
    """Half the robust sum of squares of a result in this noise (C,), initial conditions at their best."""
    rounds, initial = GaussNewton(joint), found.initial
    rounds.noise = noise
    for _ in range(_SETTLE):
        initial = initial + rounds.settled(found.values, initial)
    centre = found.values.copy()
    centre[len(joint.parameters) :] = 0.0
    return rounds.cost(found.values, initial, centre)


def _hold_out(campaign: Campaign, joint: Joint, vehicle: Vehicle) -> dict[str, float]:
    """R2 by channel on all trials that are held out as a whole, pooled, some seconds ahead."""
    from seatrial.trial.score import score

    names = [name for name in campaign.trials if campaign.source_of(name).hold_out]
    if not names:
        return {}
    axes = joint.stage.axes
    found = score(
        vehicle,
        [campaign.trials[name] for name in names],
        ahead_s=_AHEAD_S,
        channels=joint.channels,
        input=campaign.input_of(names[0]),
        free=axes.free,
        measured=axes.measured,
    )
    return found.r2


def _told(relative: float) -> str:
    """Verdict on a nuisance parameter from its standard deviation over that of its prior."""
    return "identifiable" if relative <= WEAK else "weak" if relative < 0.5 * (1.0 + WEAK) else "prior"


def _floats(values: np.ndarray[Any, Any]) -> tuple[float, ...]:
    return tuple(map(float, values))


_SAME = 1e-9

_CURRENT = ("current_north", "current_east", "current_down")


class Resailing:
    """The generated trials of a campaign, ready to be logged with any seed.

    Parameters
    ----------
    campaign : Campaign
        All of its trials are generated, by one truth vehicle.
    truth : Truth, optional
        Sails all of them instead of the recipes' own.

    Attributes
    ----------
    truth
        The vehicle that sails.
    recipes
        By trial.

    Raises
    ------
    CampaignError
        A trial is a recording, or two trials have different truth vehicles.
    TrialError, VehicleError
        A recipe or its truth vehicle is not usable.
    """

    def __init__(self, campaign: Campaign, *, truth: Truth | None = None) -> None:
        self.campaign = campaign
        self.recipes = {name: _recipe(campaign, name, truth) for name in campaign.trials}
        self.truth = next(iter(self.recipes.values())).truth
        for name, recipe in self.recipes.items():
            if recipe.truth.sailed != self.truth.sailed:
                raise CampaignError(
                    f"{campaign.source}: trial {name!r} is sailed by another truth vehicle than"
                    f" {next(iter(self.recipes))!r}; coverage needs one right answer: give all recipes the"
                    " same truth"
                )
        self._runs: dict[str, Run] = {}

    def sail(self, seed: int) -> Campaign:
        """The campaign with trials as the sensors log them with this seed."""
        tables = {}
        for name, recipe in self.recipes.items():
            if name not in self._runs:
                self._runs[name] = recipe.run()
            tables[name] = recipe.table(run=self._runs[name], seed=sensor_seed(name, seed))
        here = self.campaign
        return Campaign(here.file, text=here.text, source=here.source, folder=here.folder, trials=tables)

    def right(self, joint: Joint, seed: int) -> Array:
        """Right values (m,) of the unknowns of a joint estimate of ``sail(seed)``; NaN where there is none.

        A parameter that sets several coefficients has a right value only if it suits all of them. Latencies
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
            shown = [self._right_nuisance(nuisance.key, trial, seed) for trial in trials]
            values.append(shown[0] if all(x == shown[0] for x in shown) else math.nan)
        return np.array(values)

    def outside(self, joint: Joint) -> dict[str, tuple[float, float]]:
        """Assumed and true value of coefficients that no value of the unknowns can give what the truth has.

        Empty if the truth is inside the model class.
        """
        true, assumed = self.truth.vehicle.coefficients(), joint.vehicle.coefficients()
        free = {name for parameter in joint.parameters for name, _ in parameter.members}
        found = {}
        for name in sorted({*true, *assumed} - free):
            pair = assumed.get(name, 0.0), true.get(name, 0.0)
            if not math.isclose(*pair, rel_tol=_SAME, abs_tol=1e-12):
                found[name] = pair
        right = self.right(joint, 0)
        for parameter, value in zip(joint.parameters, right[: len(joint.parameters)], strict=True):
            if math.isnan(value) or not parameter.lower <= value <= parameter.upper:
                for name, _ in parameter.members:
                    found[name] = assumed.get(name, 0.0), true.get(name, 0.0)
        return found

    def _right_nuisance(self, key: str, trial: str, seed: int) -> float:
        if key in _CURRENT:
            return float(self.recipes[trial].current[_CURRENT.index(key)])
        kind, _, channel = key.partition("_")
        if kind == "bias":
            return biases(self.truth.sensors, seed=sensor_seed(trial, seed)).get(channel, 0.0)
        return math.nan if kind == "latency" else 0.0


def sensor_seed(trial: str, seed: int) -> int:
    """Seed of the sensors of a trial in one repetition."""
    return int(np.random.SeedSequence([seed, zlib.crc32(trial.encode())]).generate_state(1)[0])


def unmodelled(outside: Mapping[str, tuple[float, float]]) -> str:
    """Words for coefficients that the truth has otherwise: ``Y_rdot -15 (assumed 0)``."""
    return ", ".join(
        f"{name} {true:.4g} (assumed {assumed:.4g})" for name, (assumed, true) in outside.items()
    )


def _recipe(campaign: Campaign, trial: str, truth: Truth | None) -> Recipe:
    path, reader = campaign.path_of(trial), campaign.source_of(trial).reader or campaign.file.reader
    if path is None or not (reader == "generated" or (reader is None and path.suffix == ".toml")):
        raise CampaignError(
            f"{campaign.source}: trial {trial!r} is a recording ({path or 'a table'}), of which nobody knows"
            " the right coefficients; coverage needs generated trials: give the recipe of one (TOML, see"
            " examples/cwolf)"
        )
    return Recipe.load(path, truth=truth)
