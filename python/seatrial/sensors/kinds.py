"""Kinds of sensors: the columns that each logs, the unit of its numbers, and whether its place matters."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["KINDS", "Kind"]


@dataclass(frozen=True)
class Kind:
    """A kind of sensor.

    Attributes
    ----------
    columns
        Canonical columns that it logs, in order.
    unit
        Ending of its keys: that of the columns' numbers.
    placed
        Whether what it shows depends on where it sits, ``position_m``.
    ranged
        Whether it needs the bottom within ``max_range_m``.
    """

    columns: tuple[str, ...]
    unit: str
    placed: bool = False
    ranged: bool = False


KINDS: dict[str, Kind] = {
    "dvl": Kind(("u_m_s", "v_m_s", "w_m_s"), "m_s", placed=True, ranged=True),
    "dvl_water": Kind(("u_water_m_s", "v_water_m_s", "w_water_m_s"), "m_s", placed=True),
    "gyro": Kind(("p_deg_s", "q_deg_s", "r_deg_s"), "deg_s"),
    "attitude": Kind(("roll_deg", "pitch_deg", "yaw_deg"), "deg"),
    "depth": Kind(("z_m",), "m", placed=True),
    "position": Kind(("x_m", "y_m"), "m", placed=True),
    "gps": Kind(("x_m", "y_m"), "m", placed=True),
    "revolutions": Kind((), "rpm"),
    "voltage": Kind(("voltage_v",), "v"),
    "load_cell": Kind(("load.X_n", "load.Y_n", "load.Z_n"), "n"),
}
"""Kinds by name; "revolutions" logs one column per actuator, in the unit of its command."""
