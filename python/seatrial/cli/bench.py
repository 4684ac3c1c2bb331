"""`seatrial bench`: characteristics and motors from load-cell and revolution records."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seatrial.cli.options import FigureFormat, Figures, Json, Verbose
from seatrial.cli.report import Page, reported

if TYPE_CHECKING:
    pass


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
    figures: Figures = FigureFormat.PNG,
    page: Page = None,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Fit thrust and motor of every tested group, say how sure they are, write them into the vehicle file.

    Example: seatrial bench bench.toml --in-place
    """
    from seatrial.base.errors import SeatrialError
    from seatrial.bench_test.evaluate import bench as evaluate
    from seatrial.cli.console import answer, print_json
    from seatrial.report.results.bench_test import WRITE

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
    written = None
    if write is not None:
        written = found.save_vehicle(write)
    elif in_place and found.vehicle_path is not None:
        written = found.save_vehicle(found.vehicle_path, replace=True)

    def drawn() -> list[Path]:
        from seatrial.report.plot import gallery

        return gallery(found, folder, formats=figures.endings(page))

    if json:
        files = {"figures": [str(path) for path in drawn()], "vehicle_file": written and str(written)}
        print_json(found.to_dict() | {"run_directory": str(folder)} | files)
        reported(page, [folder], quiet=True)
        return
    results = f"Results in {folder}: bench.json, summary.txt, points.csv, vehicle.toml"
    if written is not None:
        results += f"\nVehicle file with the results: {written} (seatrial check {written})"
    elif found.notes:
        results += "\nNothing was written into a vehicle file: give --write FILE or --in-place"
    report = found.report()
    if written is not None:
        report = replace(report, next_step=report.next_step.replace(WRITE, f"run seatrial check {written}"))
    answer(report, verbose=verbose, results=results, draw=drawn)
    reported(page, [folder])
