"""`seatrial export` and `report`: samples, vehicles and runs for other programs, machines and readers."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from seatrial.base.errors import SeatrialError, SimulationError, TrialError
from seatrial.base.files import check_place
from seatrial.cli.options import Json, page_place, shared
from seatrial.cli.score import ColumnsFrom, read_trials

if TYPE_CHECKING:
    import polars as pl

    from seatrial.export.c_code import CExport
    from seatrial.export.fmu import FmuExport

_MODEL_ENDINGS = (".sdf", ".world", ".xml")
"""As gz-sim names its models."""


@dataclass(frozen=True)
class Samples:
    """How a recording is read."""

    columns_from: ColumnsFrom = None
    unit: Annotated[
        list[str] | None,
        typer.Option(
            metavar="COLUMN=UNIT", help="Unit of a column of CSV or Parquet: u_m_s=knot; repeatable."
        ),
    ] = None

    @property
    def given(self) -> dict[str, Any]:
        """Options by their names."""
        return {"--columns-from": self.columns_from, "--unit": self.unit}


@dataclass(frozen=True)
class Program:
    """What a program of vehicle and autopilot does."""

    mission: Annotated[Path | None, typer.Option(help="Mission that the autopilot's program flies.")] = None
    model: Annotated[
        str | None, typer.Option(help="Vehicle that the autopilot believes in; VEHICLE by default.")
    ] = None
    name: Annotated[
        str | None, typer.Option(help="Prefix of files and functions; the vehicle's name by default.")
    ] = None
    feedback: Annotated[
        bool, typer.Option(help="The autopilot is told what its actuators do, and so finds a failed one.")
    ] = True
    voltage: Annotated[
        float | None, typer.Option(metavar="V", help="Supply, where thrust depends on it.")
    ] = None
    max_step: Annotated[float, typer.Option(metavar="S", help="Longest step of the vehicle.")] = 0.02
    navigation: Annotated[
        str, typer.Option(metavar="sensors|filter", help="For c: filter writes the navigation filter too.")
    ] = "sensors"
    sensors: Annotated[
        str | None,
        typer.Option(
            metavar="FILE", help="For c: sensors of that filter, or: typical. Good ones when missing."
        ),
    ] = None

    @property
    def given(self) -> dict[str, Any]:
        """Options by their names where they are not as by default."""
        options = {f"--{name.replace('_', '-')}": value for name, value in _changed(self).items()}
        feedback = {} if self.feedback else {"--no-feedback": True}
        return {name: value for name, value in options.items() if name != "--feedback"} | feedback

    @property
    def filter_given(self) -> dict[str, Any]:
        """Those of the navigation filter."""
        return {name: value for name, value in self.given.items() if name in ("--navigation", "--sensors")}

    @property
    def options(self) -> dict[str, Any]:
        """Options of `seatrial.export_c` and `export_fmu` that both take."""
        same = {name: getattr(self, name) for name in ("mission", "model", "name", "feedback")}
        return same | {"voltage_v": self.voltage, "max_step_s": self.max_step}


@dataclass(frozen=True)
class Unit:
    """A functional mock-up unit."""

    samples: Annotated[
        int, typer.Option(metavar="N", help="For fmu: parameter sets drawn from the covariance.")
    ] = 0
    seed: Annotated[int, typer.Option(help="Of those draws.")] = 0
    binary: Annotated[bool, typer.Option(help="For fmu: build a binary with the C compiler.")] = True

    @property
    def given(self) -> dict[str, Any]:
        """Options by their names."""
        return {"--samples": self.samples, "--seed": self.seed, "--no-binary": not self.binary}


def _changed(options: Any) -> dict[str, Any]:
    """Options of a group that differ from their defaults."""
    every = {field.name: (getattr(options, field.name), field.default) for field in fields(options)}
    return {name: value for name, (value, default) in every.items() if value != default}


@shared
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
    read: Samples = Samples(),
    program: Program = Program(),
    unit: Unit = Unit(),
    json: Json = False,
) -> None:
    """Write samples for other programs (MCAP, CSV, Parquet), or a vehicle for other machines and simulators.

    c and fmu write vehicle and autopilot as C99 and as functional mock-up units; sdf writes the vehicle for
    gz-sim, and says what is lost.

    Example: seatrial export c vehicle.toml --out build
    """
    # Every group of options has a meaning for some formats only.
    meaningless = {
        "c": read.given | unit.given,
        "fmu": read.given | program.filter_given,
        "sdf": {"AUTOPILOT": autopilot} | program.given | unit.given | read.given,
    }
    for name, value in meaningless.get(form, {"AUTOPILOT": autopilot} | program.given | unit.given).items():
        if value:
            raise SimulationError(f"{name}: has no meaning for export {form}, found {value}; leave it out")
    if form in ("c", "fmu"):
        _program(form, source, autopilot, out, program, unit, json=json)
    elif form == "sdf":
        _model(source, out, json=json)
    else:
        _table_written(form, source, out, read, json=json)


def _program(
    form: str, vehicle: str, autopilot: str | None, out: Path, program: Program, unit: Unit, *, json: bool
) -> None:
    """Write programs of a vehicle and its autopilot."""
    from seatrial.cli.console import answer, print_json
    from seatrial.export import export_c, export_fmu

    options = program.options | {"out": out}
    if form == "c":
        filtered: dict[str, Any] = {"navigation": program.navigation, "sensors": program.sensors}
        written: CExport | FmuExport = export_c(vehicle, autopilot, **options, **filtered)
    else:
        drawn: dict[str, Any] = {"samples": unit.samples, "seed": unit.seed}
        compiler = None if unit.binary else ""
        written = export_fmu(vehicle, autopilot, compiler=compiler, **drawn, **options)
    if json:
        print_json(written.to_dict())
    else:
        answer(written.report())


def _table_written(form: str, trial: str, out: Path, read: Samples, *, json: bool) -> None:
    """Write a table of samples and say so."""
    from seatrial.base.report import Report
    from seatrial.cli.console import answer, print_json
    from seatrial.trial.export import export as write

    check_place(out, "--out", endings=(f".{form}",), inputs=_sources(trial, read.columns_from))
    units = {}
    for entry in read.unit or ():
        column, equals, name = entry.partition("=")
        if not equals or not name:
            raise TrialError(f"--unit {entry}: expected COLUMN=UNIT, for example u_m_s=knot")
        units[column] = name
    table = _table(trial, read.columns_from)
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
    from seatrial.trial.recording import FORMATS, read_table

    if columns_from is None and trial.lower().endswith((*FORMATS["csv"], *FORMATS["parquet"])):
        table = read_table(trial).table
        if "t_s" in table.columns:
            return table
    (read,) = read_trials([trial], columns_from)
    return read.table


def report(
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN...", help="Run directories, in order of telling.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE.html",
            callback=page_place,
            help="The page to write; without it two runs of a kind are compared here.",
        ),
    ] = None,
    title: Annotated[str, typer.Option(help="Heading; the names of the runs by default.")] = "",
) -> None:
    """Write runs as one HTML file that opens anywhere without a network: results, evidence, inputs.

    Vehicle, autopilot, mission and campaign files are inside; `seatrial new --from-report` takes them out.
    Two runs of a kind are compared, before and after; without --out on the terminal only.

    Example: seatrial report runs/mine runs/mine-tuned --out mine.html
    """
    from seatrial.cli.console import answer, reported
    from seatrial.report.page.run_folder import RunFolder, compared

    if out is not None:
        reported(out, runs, title=title)
    elif (both := compared([RunFolder.read(run) for run in runs])) is not None:
        answer(both)
    else:
        raise SeatrialError(
            "--out: expected the page to write, found none; give --out FILE.html, or two runs of a kind to"
            " compare"
        )
