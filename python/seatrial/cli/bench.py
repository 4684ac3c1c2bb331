"""`seatrial bench`: characteristics and motors from load-cell and revolution records."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from seatrial.base.errors import SeatrialError
from seatrial.cli.options import Output, shared


@shared
def bench(
    bench_file: Annotated[Path, typer.Argument(help="Bench file: pulls, steps and how they are fitted.")],
    write: Annotated[
        Path | None, typer.Option(help="Write the vehicle file with the results here; it must not exist.")
    ] = None,
    in_place: Annotated[
        bool,
        typer.Option("--in-place", help="Replace the bench file's vehicle file by the one with the results."),
    ] = False,
    output: Output = Output(),
) -> None:
    """Fit thrust and motor of every tested group, say how sure they are, write them into the vehicle file.

    Example: seatrial bench bench.toml --in-place
    """
    from seatrial.bench_test.evaluate import bench as evaluate
    from seatrial.cli.console import reported
    from seatrial.report.results.bench_test import WRITE

    _check_place(write, in_place)
    test = evaluate(bench_file)
    if in_place and test.vehicle_path is None:
        raise SeatrialError(
            f"--in-place: {test.before.name} is a built-in vehicle without a file; give --write FILE"
        )
    if (write is not None or in_place) and not test.notes:
        raise SeatrialError(f"{bench_file}: nothing could be written: {'; '.join(test.warnings)}")
    # The run directory has the vehicle file in any case; where else it goes was asked for.
    folder = test.save(output.out or Path("runs") / f"bench-{test.file.name}")
    written = None
    if write is not None:
        written = test.save_vehicle(write)
    elif in_place and test.vehicle_path is not None:
        written = test.save_vehicle(test.vehicle_path, replace=True)
    report = test.report()
    results = f"Results in {folder}: bench.json, summary.txt, points.csv, vehicle.toml"
    if written is not None:
        check = f"seatrial check {written}"
        results += f"\nVehicle file with the results: {written} ({check})"
        report = replace(report, next_step=report.next_step.replace(WRITE, f"run {check}"))
    elif test.notes:
        results += "\nNothing was written into a vehicle file: give --write FILE or --in-place"
    output.show(
        test,
        {"run_directory": str(folder), "vehicle_file": written and str(written)},
        report=report,
        results=results,
        draw=partial(output.draw, test, folder),
    )
    reported(output.page, [folder], quiet=output.json)


def _check_place(write: Path | None, in_place: bool) -> None:
    """Refuse a vehicle file that cannot be written."""
    if write is None:
        return
    if in_place:
        raise SeatrialError("--write and --in-place: give one of them")
    if write.exists():
        raise SeatrialError(f"--write {write}: this file exists and is not overwritten; give another name")
    if not write.absolute().parent.is_dir():
        raise SeatrialError(
            f"--write {write}: there is no folder {write.parent}; make it or give another name"
        )
