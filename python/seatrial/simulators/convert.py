"""A model of gz-sim as a vehicle file with what contradicts itself, and a vehicle as such a model.

Held by ``tests/simulators/test_convert.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from seatrial._core import Vehicle
from seatrial.base.budget import Budget, guarded
from seatrial.base.errors import VehicleError
from seatrial.base.files import write_atomic, writing
from seatrial.base.plain import Plain
from seatrial.base.report import Report, Reported, report_of
from seatrial.base.toml_file import loaded
from seatrial.simulators.body import body_of, contradictions
from seatrial.simulators.sdf import parse, read, read_bytes, write

ENDINGS = (".sdf", ".urdf", ".xacro", ".scn", ".world", ".xml")
"""Endings of files that are models and no logs; what is not gz-sim's is refused with what to do."""

_MODEL = Budget(cpu_s=5.0)  # the largest model that is read takes one

_SIMPLER = "give the model alone"


@dataclass(frozen=True, eq=False, repr=False)
class ImportedModel(Reported):
    """A vehicle file from a model of gz-sim.

    Attributes
    ----------
    source
        The file.
    text, vehicle
        The vehicle file and the vehicle.
    contradictions
        What physics does not allow or what is doubtful, a sentence each.
    left
        What was not taken.
    """

    source: str
    text: str
    vehicle: Vehicle
    contradictions: tuple[str, ...]
    left: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """The same as plain data."""
        return {
            "source": self.source,
            "coefficients": {k: v for k, v in self.vehicle.coefficients().items() if v},
            "contradictions": list(self.contradictions),
            "left": list(self.left),
        }


@dataclass(frozen=True, eq=False, repr=False)
class ExportedModel(Reported, Plain, only="vehicle=vehicle.name lost"):
    """A vehicle as a model of gz-sim: its text, and what is lost."""

    vehicle: Vehicle
    text: str
    lost: tuple[str, ...]

    def report(self, out: str = "") -> Report:
        """Report on the export to a file."""
        return report_of(self, out=out)


def import_model(path: str | Path, *, name: str | None = None, rho: float | None = None) -> ImportedModel:
    """Vehicle file from a model of gz-sim: SDF with the plugin Hydrodynamics.

    Parameters
    ----------
    path : str or Path
    name : str, optional
        Of the vehicle; that of the model when omitted.
    rho : float, optional
        Density of the water, kg/m3, instead of that of the model.

    Raises
    ------
    VehicleError
        The file is no such model, is not safe to read, or its numbers are no vehicle.
    """
    source = str(path)
    content = read_bytes(path)
    with guarded(
        source, "reading it as a model", _SIMPLER, size=len(content), budget=_MODEL, refusal=VehicleError
    ):
        body, left = read(parse(content, source), source, rho=rho)
    if not body.mass > 0.0:
        raise VehicleError(f"{source}: expected a positive mass, found {body.mass:g} kg")
    body, doubts = contradictions(body)
    # A template's $name is filled in by a program that is not at hand.
    own = "" if "$" in body.name else body.name
    body = replace(body, name=name or own or Path(source).stem)
    comments = (
        f"From {Path(source).name}, a model of gz-sim; forward-right-down about the link's origin, SI.",
        *(f"Contradiction: {sentence}" for sentence in doubts),
        *(f"Not taken: {sentence}" for sentence in left),
        "No thrusters yet: add [[thrusters]] and list in controllable what they can do.",
    )
    text = body.toml(comments)
    return ImportedModel(source, text, Vehicle.from_toml(text, source), tuple(doubts), left)


def export_model(vehicle: Vehicle | str | Path) -> ExportedModel:
    """Vehicle as a model of gz-sim, with what it cannot hold.

    Parameters
    ----------
    vehicle : Vehicle, str or Path

    Raises
    ------
    VehicleError
        The vehicle is not usable.
    """
    model: Vehicle = loaded(Vehicle, vehicle)
    text, lost = write(body_of(model), f"{model.name}: written by seatrial for gz-sim")
    return ExportedModel(model, text, (*lost, *_not_carried(model)))


def write_text(path: Path, text: str) -> None:
    """Write a text whole or not at all.

    Raises `VehicleError`: it cannot be written.
    """
    with writing(path, VehicleError, advice="choose another folder"):
        write_atomic(path, text.encode())


def _not_carried(vehicle: Vehicle) -> list[str]:
    """Sentences on terms of the vehicle that gz-sim does not take."""
    given: Mapping[str, float] = vehicle.coefficients()

    def some(test: Any) -> list[str]:
        return [name for name, value in sorted(given.items()) if value and test(name)]

    lift = some(lambda name: name in _LIFT)
    bias = some(lambda name: len(name) == 3 and name.endswith("_0"))
    cross = some(lambda name: name.startswith("C_D"))
    tether = some(lambda name: name.endswith("_tether"))
    sentences = []
    for names, what in (
        (lift, "Lift"),
        (bias, "Constant forces"),
        (cross, "Cross-flow drag by strips"),
        (tether, "The tether"),
    ):
        if names:
            sentences.append(f"{what} of the vehicle file ({', '.join(names)}) has no counterpart.")
    if vehicle.actuators:
        sentences.append(
            f"{len(vehicle.actuators)} actuators with their motors (lag, dead time, limits, thrust by"
            " supply and inflow) are not written."
        )
    return sentences


_LIFT = frozenset(("Y_uv", "Y_ur", "Z_uw", "Z_uq", "M_uw", "M_uq", "N_uv", "N_ur"))
