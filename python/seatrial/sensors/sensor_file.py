"""Sets of sensors: the one that comes with seatrial, "typical", and those of files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.errors import TrialError
from seatrial.recipe_file import SensorFile, read_as
from seatrial.sensors.sensor import Sensor, parse_sensors

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["TYPICAL", "load_sensors"]

TYPICAL = "typical"
"""Name of the set that comes with seatrial."""

_TYPICAL_FILE = Path(__file__).with_name("typical.toml")


def load_sensors(source: str | Path, vehicle: Vehicle) -> dict[str, Sensor]:
    """Sensors by kind of a file, or the typical ones that suit a vehicle.

    Parameters
    ----------
    source : str or Path
        "typical", or a file with ``[sensors.KIND]`` tables; the file of a truth vehicle will do.
    vehicle : Vehicle
        Of the typical sensors those of revolutions are for motors that are commanded by them, that of the
        supply for thrust that depends on it.

    Raises
    ------
    TrialError
        The file cannot be read, names no sensor, or one is wrong.

    Examples
    --------
    >>> import seatrial as st
    >>> "revolutions" in load_sensors("typical", st.Vehicle.load("beluga"))
    False
    """
    if str(source) != TYPICAL:
        path = Path(source)
        sensors = parse_sensors(read_as(SensorFile, path).sensors, str(path))
        if not sensors:
            raise TrialError(f"{path}: names no sensor; expected a table [sensors.dvl] or the like")
        return sensors
    sensors = parse_sensors(read_as(SensorFile, _TYPICAL_FILE).sensors, TYPICAL)
    facts = vehicle.actuator_info().values()
    if not any(actuator["unit"] == "rpm" for actuator in facts):
        del sensors["revolutions"]
    if not any(actuator["needs_voltage"] for actuator in facts):
        del sensors["voltage"]
    return sensors
