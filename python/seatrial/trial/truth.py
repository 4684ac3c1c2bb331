"""Truth vehicles: what sails generated trials, with other coefficients than the model, and its sensors.

A truth file names a vehicle, factors on its coefficients or values instead of them, and the sensors that it
carries. Held by ``tests/sensors/test_sensors.py`` and ``tests/trial/test_truth.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field

from seatrial.base.errors import TrialError, VehicleError, nearest
from seatrial.base.toml_file import Name, Number
from seatrial.sensors.sensor import Sensor, SensorFile, parse_sensors, read_as

if TYPE_CHECKING:
    from seatrial._core import Vehicle


class TruthFile(SensorFile):
    """A truth vehicle: factors on, or values instead of, coefficients, and its sensors.

    ``vehicle_file`` holds tables that replace entries of the vehicle's file first, for what is no coefficient
    (limits of a motor).
    """

    file_kind = ""  # it need not have a key that tells it from a set of sensors

    vehicle: Name
    vehicle_file: dict[str, Any] = Field(default_factory=dict)
    factors: dict[str, Number] = Field(default_factory=dict)
    values: dict[str, Number] = Field(default_factory=dict)


@dataclass(frozen=True)
class Truth:
    """A truth vehicle: the one behind generated trials, and the sensors that it carries."""

    description: str
    vehicle: Vehicle
    base: Vehicle
    changed: tuple[str, ...]
    sensors: Mapping[str, Sensor]

    @property
    def sailed(self) -> tuple[str, Mapping[str, Sensor]]:
        """What makes two truths the same one: the vehicle's file and the sensors."""
        return self.vehicle.to_toml(), self.sensors

    @classmethod
    def load(cls, path: str | Path) -> Truth:
        """Truth vehicle from its file: a built-in vehicle, or a file beside it, with other coefficients.

        Raises
        ------
        TrialError
            The file cannot be read, has unknown keys or names an unknown sensor.
        VehicleError
            The vehicle or a coefficient is unknown, or their values are impossible.
        """
        from seatrial._core import Vehicle

        path = Path(path)
        file = read_as(TruthFile, path)
        beside = file.vehicle.endswith(".toml")
        try:
            base = Vehicle.load(path.parent / file.vehicle if beside else file.vehicle)
        except VehicleError as error:
            raise VehicleError(f"{path}: key vehicle: {error}") from None
        if file.vehicle_file:
            base = _overlaid(base, file.vehicle_file, str(path))
        known = base.coefficients()
        for name in file.factors:
            if name not in known:
                raise VehicleError(f"{path}: factors: unknown coefficient {name!r}{nearest(name, known)}")
        changed = {name: factor * known[name] for name, factor in file.factors.items()} | file.values
        sensors = parse_sensors(file.sensors, str(path))
        return cls(file.description, base.with_coefficients(changed), base, tuple(changed), sensors)


def _overlaid(vehicle: Vehicle, tables: Mapping[str, Any], where: str) -> Vehicle:
    """The vehicle with tables put over those of its file."""
    import tomlkit

    from seatrial._core import Vehicle

    def over(below: dict[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
        merged = dict(below)
        for key, value in above.items():
            known = merged.get(key)
            merged[key] = (
                over(known, value) if isinstance(known, dict) and isinstance(value, Mapping) else value
            )
        return merged

    below = vehicle.to_dict()
    for kind in ("motors", "characteristics"):
        own, new = below.get(kind, {}), tables.get(kind)
        for name in new if isinstance(new, Mapping) else ():
            # A table that no actuator names would change nothing; what may name it is in arrays.
            if name not in own and not tables.keys() & {"thrusters", "fins"}:
                raise TrialError(
                    f"{where}: vehicle_file, {kind}: the vehicle {vehicle.name} has no {name!r}"
                    f"{nearest(name, own)}"
                )
    text = tomlkit.dumps(over(below, tables))
    return Vehicle.from_toml(text, f"{where}: vehicle_file")
