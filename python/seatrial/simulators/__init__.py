"""Another simulator, gz-sim: its models read into vehicle files and written from them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.simulators.convert import ExportedModel as ExportedModel
    from seatrial.simulators.convert import ImportedModel as ImportedModel
    from seatrial.simulators.convert import export_model as export_model
    from seatrial.simulators.convert import import_model as import_model

__all__ = ["ExportedModel", "ImportedModel", "export_model", "import_model"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(__name__, dict.fromkeys(__all__, "convert"))
