"""`seatrial export`: a trial, a flight or a vehicle for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from seatrial.cli.console import Json

if TYPE_CHECKING:
    import polars as pl

__all__ = ["export"]


def export(
    form: Annotated[
        Literal["mcap", "csv", "parquet", "sdf", "uuv", "stonefish"],
        typer.Argument(help="Format.", metavar="mcap|csv|parquet|sdf|uuv|stonefish"),
    ],
    trial: Annotated[
        str,
        typer.Argument(
            help="Recording, flight.parquet of a run, or trial of the campaign; a vehicle for a simulator.",
            metavar="TRIAL|VEHICLE",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write.")],
    columns_from: Annotated[
        Path | None, typer.Option(help="Campaign file whose reader and column map the recording follows.")
    ] = None,
    unit: Annotated[
        list[str] | None,
        typer.Option(
            metavar="COLUMN=UNIT", help="Unit of a column of CSV or Parquet: u_m_s=knot; repeatable."
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Write a trial or a flight for other programs: MCAP for Foxglove, CSV or Parquet in any unit.

    sdf, uuv and stonefish write a vehicle for gz-sim, uuv_simulator and Stonefish, and say what is lost.
    """
    if form in ("sdf", "uuv", "stonefish"):
        _model(form, trial, out, json=json)
        return
    from seatrial.base.errors import TrialError
    from seatrial.base.report import Report
    from seatrial.cli.console import answer, print_json
    from seatrial.trial.export import export as write

    if out.suffix != f".{form}":
        raise TrialError(f'--out {out}: expected the ending .{form}, found "{out.suffix}"')
    units = {}
    for entry in unit or ():
        column, equals, name = entry.partition("=")
        if not equals or not name:
            raise TrialError(f"--unit {entry}: expected COLUMN=UNIT, for example u_m_s=knot")
        units[column] = name
    table = _table(trial, columns_from)
    write(table, out, units=units)
    facts = {"file": str(out), "rows": table.height, "columns": table.columns}
    if json:
        print_json(facts)
        return
    duration = float(table["t_s"][-1] - table["t_s"][0])
    shows = "open it in Foxglove: 3D and Plot show it" if form == "mcap" else "read it with any program"
    answer(
        Report(
            title=trial,
            outcome="exported",
            good=f"{table.height} rows of {duration:.1f} s, {table.width} columns in {out}",
            worst="none: every sample is written with all its digits, a masked one left empty",
            next_step=shows,
        )
    )


def _model(form: str, vehicle: str, out: Path, *, json: bool) -> None:
    """Write a vehicle for another simulator."""
    from seatrial.cli.console import answer, print_json
    from seatrial.simulators.convert import export_model, write_text

    made = export_model(vehicle, form)
    write_text(out, made.text)
    if json:
        print_json(made.to_dict() | {"file": str(out)})
    else:
        answer(made.report(str(out)))


def _table(trial: str, columns_from: Path | None) -> pl.DataFrame:
    """Table of a trial; one of a file with canonical columns as it is, so that a flight keeps all of its."""
    from seatrial.cli.score import read_trials
    from seatrial.trial.readers import FORMATS, read_table

    if columns_from is None and trial.lower().endswith((*FORMATS["csv"], *FORMATS["parquet"])):
        table = read_table(trial).table
        if "t_s" in table.columns:
            return table
    (read,) = read_trials([trial], columns_from)
    return read.table
