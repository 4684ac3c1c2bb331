"""Programs that run elsewhere: one step of vehicle and autopilot as C and as functional mock-up units."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.export.c_code import CExport as CExport
    from seatrial.export.c_code import export_c as export_c
    from seatrial.export.fmu import FmuExport as FmuExport
    from seatrial.export.fmu import export_fmu as export_fmu

__all__ = ["CExport", "FmuExport", "export_c", "export_fmu"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(
        __name__, {"CExport": "c_code", "FmuExport": "fmu", "export_c": "c_code", "export_fmu": "fmu"}
    )
