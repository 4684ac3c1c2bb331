"""`seatrial bench`: characteristics and motors from load-cell and revolution records."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.console import Console

    from seatrial.bench_test.result import BenchTest

__all__ = ["bench"]


def bench(
    bench_file: Annotated[Path, typer.Argument(help="Bench file: pulls, steps and how they are fitted.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Run directory; runs/bench-NAME by default.")
    ] = None,
    write: Annotated[
        Path | None, typer.Option(help="Write the vehicle file with the results here; it must not exist.")
    ] = None,
    in_place: Annotated[
        bool,
        typer.Option("--in-place", help="Replace the bench file's vehicle file by the one with the results."),
    ] = False,
    figures: Annotated[bool, typer.Option(help="Draw points, curves and bands (PNG and PDF).")] = True,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Fit thrust and motor of every tested group, say how sure they are, write them into the vehicle file."""
    from seatrial.base.errors import SeatrialError
    from seatrial.bench_test.evaluate import bench as evaluate
    from seatrial.cli.console import list_figures, output, print_json

    if write is not None and in_place:
        raise SeatrialError("--write and --in-place: give one of them")
    if write is not None and write.exists():
        raise SeatrialError(f"--write {write}: this file exists and is not overwritten; give another name")
    if write is not None and not write.absolute().parent.is_dir():
        raise SeatrialError(
            f"--write {write}: there is no folder {write.parent}; make it or give another name"
        )
    found = evaluate(bench_file)
    if in_place and found.vehicle_path is None:
        raise SeatrialError(
            f"--in-place: {found.before.name} is a built-in vehicle without a file; give --write FILE"
        )
    if (write is not None or in_place) and not found.notes:
        raise SeatrialError(f"{bench_file}: nothing could be written: {'; '.join(found.warnings)}")
    folder = found.save(out or Path("runs") / f"bench-{found.file.name}")
    drawn = _draw(found, folder) if figures else []
    written = None
    if write is not None:
        written = found.write_vehicle(write)
    elif in_place and found.vehicle_path is not None:
        written = found.write_vehicle(found.vehicle_path, replace=True)
    if json:
        print_json(
            found.to_dict()
            | {
                "run_directory": str(folder),
                "figures": [str(path) for path in drawn],
                "vehicle_file": None if written is None else str(written),
            }
        )
        return
    console = output()
    _print(console, found)
    console.print(f"Results in {folder}", soft_wrap=True, markup=False)
    list_figures(console, drawn)
    if written is not None:
        console.print(f"Vehicle file with the results: {written}", soft_wrap=True, markup=False)
        console.print(f"Check it:  seatrial check {written}", soft_wrap=True, markup=False)
    elif found.notes:
        console.print(
            "Nothing was written into a vehicle file: give --write FILE or --in-place",
            soft_wrap=True,
            markup=False,
        )


def _draw(found: BenchTest, folder: Path) -> list[Path]:
    from seatrial.report.plot.bench import bollard_test, motor_step
    from seatrial.report.plot.style import save

    drawn = save(bollard_test(found), folder / "bollard_test") if found.pulls else []
    for unit, motor in found.motors.items():
        drawn += save(motor_step(motor, found.step_records[unit][0]), folder / f"motor_{unit}")
    return drawn


def _print(console: Console, found: BenchTest) -> None:
    from seatrial.bench_test.result import share
    from seatrial.cli.console import table

    console.print(
        f"[bold]{found.file.name}[/bold]: {found.file.description or 'bench test'},"
        f" vehicle {found.before.name}\n",
        soft_wrap=True,
    )
    rows = []
    for unit, fit in found.pulls.items():
        for side, one in fit.directions.items():
            deviations, bounds = one.fit.standard_deviations, one.fit.intervals()
            for k, name in enumerate(one.fit.names):
                rows.append([
                    f"{unit} {side}" if k == 0 else "",
                    name,
                    _unit(one.fit.terms[k], fit.unit.command),
                    f"{one.fit.coefficients[k]:.5g}",
                    f"{deviations[k]:.2g}",
                    f"{bounds[k, 0]:.4g} to {bounds[k, 1]:.4g}",
                ])
    if rows:
        head = ["group", "", "unit", "estimate", "sd", "95 % interval"]
        console.print(table("Regression per direction, of a single actuator", head, rows, left=3))
        scores = [
            [
                f"{unit} {side}",
                str(len(one.points)),
                str(len(one.outliers)),
                share(one.fit.r2).replace(" ", ""),
                share(one.fit.b).replace(" ", ""),
                f"{one.fit.sigma:.2g}",
                f"{one.fit.condition:.2g}",
            ]
            for unit, fit in found.pulls.items()
            for side, one in fit.directions.items()
        ]
        head = ["group", "points", "outliers", "R2", "paper's B", "scatter, N", "condition"]
        console.print(table("Fit (R2 = 1 - SSE/SST decides)", head, scores))
    tables = [
        [
            unit,
            ""
            if row["voltage_v"] != row["voltage_v"] or not len(fit.table.voltage)
            else f"{row['voltage_v']:.4g}",
            f"{row['points']:.0f}",
            f"{row['rms_n']:.2g}",
            f"{row['largest_n']:.2g}",
        ]
        for unit, fit in found.pulls.items()
        if fit.table is not None
        for row in fit.table.errors()
    ]
    if tables:
        head = ["group", "supply, V", "points", "rms, N", "largest, N"]
        console.print(table("Points against the table", head, tables))
    for sentence in found.sentences():
        style = "yellow" if "WARNING" in sentence else None
        console.print(f"- {sentence}", soft_wrap=True, markup=False, style=style)


def _unit(term: tuple[int, ...], command: str) -> str:
    """Unit of a coefficient: newton per powers of the command's unit and volt."""
    below = [
        f"{name}{'²³'[e - 2] if e > 1 else ''}" for name, e in zip((command, "V"), term, strict=False) if e
    ]
    return "N" + ("/" + "/".join(below) if below else "")
