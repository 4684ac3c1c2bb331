"""`seatrial export`: a trial or a flight for other programs, a vehicle for other simulators and machines."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from seatrial.cli.options import Json

if TYPE_CHECKING:
    import polars as pl

    from seatrial.export.c_code import CExport
    from seatrial.export.fmu import FmuExport

_MODEL_ENDINGS = (".sdf", ".world", ".xml")
"""As gz-sim names its models."""


def export(
    form: Annotated[
        Literal["mcap", "csv", "parquet", "c", "fmu", "sdf"],
        typer.Argument(help="Format.", metavar="mcap|csv|parquet|c|fmu|sdf"),
    ],
    source: Annotated[
        str,
        typer.Argument(
            help="Recording, flight.parquet of a run, or trial of the campaign; for c, fmu and sdf"
            " a vehicle: name or file; for c and fmu also the run directory of an identification.",
            metavar="TRIAL|VEHICLE",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write; for c and fmu a folder.")],
    autopilot: Annotated[
        str | None, typer.Argument(help="For c and fmu: autopilot, name or file; it flies --mission.")
    ] = None,
    columns_from: Annotated[
        Path | None, typer.Option(help="Campaign file whose reader and column map the recording follows.")
    ] = None,
    unit: Annotated[
        list[str] | None,
        typer.Option(
            metavar="COLUMN=UNIT", help="Unit of a column of CSV or Parquet: u_m_s=knot; repeatable."
        ),
    ] = None,
    mission: Annotated[Path | None, typer.Option(help="Mission that the autopilot's program flies.")] = None,
    model: Annotated[
        str | None, typer.Option(help="Vehicle that the autopilot believes in; VEHICLE by default.")
    ] = None,
    name: Annotated[
        str | None, typer.Option(help="Prefix of files and functions; the vehicle's name by default.")
    ] = None,
    feedback: Annotated[
        bool, typer.Option(help="The autopilot is told what its actuators do, and so finds a failed one.")
    ] = True,
    voltage: Annotated[
        float | None, typer.Option(metavar="V", help="Supply, where thrust depends on it.")
    ] = None,
    max_step: Annotated[float, typer.Option(metavar="S", help="Longest step of the vehicle.")] = 0.02,
    navigation: Annotated[
        str, typer.Option(metavar="sensors|filter", help="For c: filter writes the navigation filter too.")
    ] = "sensors",
    sensors: Annotated[
        str | None,
        typer.Option(
            metavar="FILE", help="For c: sensors of that filter, or: typical. Good ones when missing."
        ),
    ] = None,
    samples: Annotated[
        int, typer.Option(metavar="N", help="For fmu: parameter sets drawn from the covariance.")
    ] = 0,
    seed: Annotated[int, typer.Option(help="Of those draws.")] = 0,
    binary: Annotated[bool, typer.Option(help="For fmu: build a binary with the C compiler.")] = True,
    json: Json = False,
) -> None:
    """Write samples for other programs (MCAP, CSV, Parquet), or a vehicle for other machines and simulators.

    c and fmu write vehicle and autopilot as C99 and as functional mock-up units; sdf writes the vehicle for
    gz-sim, and says what is lost.

    Example: seatrial export c vehicle.toml --out build
    """
    from seatrial.cli.console import answer, print_json

    filtered = {"--navigation": navigation if navigation != "sensors" else None, "--sensors": sensors}
    if form in ("c", "fmu"):
        _refuse(form, {"--columns-from": columns_from, "--unit": unit})
        shared: dict[str, Any] = {
            "out": out,
            "mission": mission,
            "model": model,
            "name": name,
            "feedback": feedback,
            "voltage_v": voltage,
            "max_step_s": max_step,
        }
        if form == "c":
            _refuse(form, {"--samples": samples, "--seed": seed, "--no-binary": not binary})
            shared |= {"navigation": navigation, "sensors": sensors}
        else:
            _refuse(form, filtered)
        result = _program(form, source, autopilot, shared, samples=samples, seed=seed, binary=binary)
        if json:
            print_json(result.to_dict())
        else:
            answer(result.report())
        return
    programs = {"AUTOPILOT": autopilot, "--mission": mission, "--model": model, "--name": name}
    _refuse(form, programs | filtered | {"--voltage": voltage, "--samples": samples, "--seed": seed})
    if form == "sdf":
        _refuse(form, {"--columns-from": columns_from, "--unit": unit})
        _model(source, out, json=json)
        return
    _table_written(form, source, out, columns_from, unit, json=json)


def _refuse(form: str, given: dict[str, Any]) -> None:
    """Refuse what has no meaning for a format."""
    from seatrial.base.errors import SimulationError

    for name, value in given.items():
        if value:
            raise SimulationError(f"{name}: has no meaning for export {form}, found {value}; leave it out")


def _program(
    form: str,
    vehicle: str,
    autopilot: str | None,
    shared: dict[str, Any],
    *,
    samples: int,
    seed: int,
    binary: bool,
) -> CExport | FmuExport:
    """Programs of a vehicle and its autopilot, written."""
    from seatrial.export import export_c, export_fmu

    if form == "c":
        return export_c(vehicle, autopilot, **shared)
    return export_fmu(
        vehicle, autopilot, samples=samples, seed=seed, compiler=None if binary else "", **shared
    )


def _table_written(
    form: str, trial: str, out: Path, columns_from: Path | None, unit: list[str] | None, *, json: bool
) -> None:
    """Write a table of samples and say so."""
    from seatrial.base.errors import TrialError
    from seatrial.base.file_names import check_place
    from seatrial.base.report import Report
    from seatrial.cli.console import answer, print_json
    from seatrial.trial.export import export as write

    check_place(out, "--out", endings=(f".{form}",), inputs=_sources(trial, columns_from))
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


def _model(vehicle: str, out: Path, *, json: bool) -> None:
    """Write a vehicle for gz-sim."""
    from seatrial.base.file_names import check_place
    from seatrial.cli.console import answer, print_json
    from seatrial.simulators.convert import export_model, write_text

    check_place(out, "--out", endings=_MODEL_ENDINGS, inputs={"the vehicle": vehicle})
    made = export_model(vehicle)
    write_text(out, made.text)
    if json:
        print_json(made.to_dict() | {"file": str(out)})
    else:
        answer(made.report(str(out)))


def _sources(trial: str, columns_from: Path | None) -> dict[str, str | Path | None]:
    """Files that a trial is read from, by what they are."""
    sources: dict[str, str | Path | None] = {"the recording": trial, "the column map": columns_from}
    if columns_from is not None:
        from seatrial.campaign.campaign import Campaign

        campaign = Campaign.load(columns_from)
        if trial in campaign.trials:
            sources["the recording"] = campaign.path_of(trial)
    return sources


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
