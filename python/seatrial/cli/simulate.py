"""`seatrial simulate`: a vehicle under commands of a file, as it moved or as its sensors logged it.

Tests: ``tests/base/test_bad_input.py``, ``tests/cli/test_cli_sensors.py``.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seatrial.cli.console import Json

if TYPE_CHECKING:
    import polars as pl

__all__ = ["simulate"]

_ENDINGS = (".csv", ".parquet")

_SEES_BOTTOM = {"dvl", "dvl_water"}


def simulate(
    vehicle: Annotated[str, typer.Argument(help="Vehicle file or built-in vehicle.")],
    commands: Annotated[
        Path,
        typer.Argument(
            help="CSV or Parquet with t_s and cmd.ACTUATOR; also voltage_v, tau.*, a start state."
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="CSV or Parquet; beside the commands by default. A log is CSV."),
    ] = None,
    free: Annotated[str, typer.Option(help="Letters of the axes that move, of XYZKMN.")] = "XYZKMN",
    held: Annotated[bool, typer.Option("--held", help="Tie the vehicle, as in a bollard test.")] = False,
    current: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="NORTH EAST DOWN", help="Steady current, m/s, instead of one in the commands' file."
        ),
    ] = None,
    sensors: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="Write what these sensors log instead of the run; or: typical."),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(min=0, help="Of the sensors' noise; the same seed, the same log. 1 by default."),
    ] = None,
    bottom: Annotated[
        float | None, typer.Option(metavar="DEPTH", help="Depth of the bottom, m, for the Doppler log.")
    ] = None,
    run: Annotated[
        Path | None, typer.Option("--run", help="Beside the sensors' log, write the true run here.")
    ] = None,
    json: Json = False,
) -> None:
    """Simulate a vehicle under commands; it starts from the first recorded state, else at rest in O."""
    from seatrial._core import Vehicle
    from seatrial.base.errors import TrialError
    from seatrial.cli.console import answer, check_axes, print_json
    from seatrial.sensors.ideal import ON_THE_TETHER, at_sea
    from seatrial.sensors.sensor import load_sensors
    from seatrial.trial.simulation import SimulatedTrial
    from seatrial.trial.trial import Trial

    loaded = Vehicle.load(vehicle)
    kind = "run" if sensors is None else "log"
    target = out or commands.with_name(f"{commands.stem}-{kind}.csv")
    _check_ending(target, _ENDINGS if sensors is None else _ENDINGS[:1])
    if run is not None:
        _check_ending(run, _ENDINGS)
    check_axes(free, "--free")
    if held and free != "XYZKMN":
        raise TrialError("--held and --free: a tied vehicle moves along no axis; give one of them")
    _check_places(commands, target, run)
    if sensors is None:
        for option, value in (("--seed", seed), ("--bottom", bottom), ("--run", run)):
            if value is not None:
                raise TrialError(f"{option} is for a log; give --sensors too")
    if bottom is not None and not 0.0 < bottom < float("inf"):
        raise TrialError(f"--bottom: expected a depth in m below the surface, found {bottom:g}")
    fitted = None if sensors is None else load_sensors(sensors, loaded)
    if fitted is not None and not held and not fitted.keys() <= set(ON_THE_TETHER):
        fitted = at_sea(fitted)  # sensors of the tether alone are refused: --held was forgotten
    if bottom is not None and fitted is not None and not fitted.keys() & _SEES_BOTTOM:
        raise TrialError(f"--bottom is for a Doppler log; {sensors} has none")
    trial = Trial.read(commands, align=False)
    made = SimulatedTrial(loaded, trial, free, held, current, fitted)
    truth = made.frame()
    if fitted is None:
        _write(truth, target, "--out")
    else:
        number = 1 if seed is None else seed
        if run is not None:
            _write(truth, run, "--run")
        label = f"{loaded.name} under {commands.name}, sensors {sensors}, seed {number}"
        made.write_log(target, number, bottom, label)
    if json:
        print_json(made.summary() | {"file": str(target)} | ({} if run is None else {"run": str(run)}))
        return
    what = "Run" if fitted is None else f"Log of {', '.join(fitted)}"
    results = f"{what} in {target}" + ("" if run is None else f"\nRun in {run}")
    after = (
        f"seatrial score {vehicle} {target}" if fitted is None else "name this log as a trial in a campaign"
    )
    answer(made.report(f"{loaded.name} under {commands.name}", after), results=results)


def _write(frame: pl.DataFrame, path: Path, option: str) -> None:
    from seatrial.base.atomic_write import write_table

    write_table(frame, path, advice=f"choose another place with {option}")


def _check_ending(path: Path, endings: tuple[str, ...]) -> None:
    """Refuse a file whose ending is none of these."""
    from seatrial.base.errors import TrialError

    if path.suffix not in endings:
        why = "" if len(endings) > 1 else "; the first lines of a log say that it was generated"
        raise TrialError(f'{path}: expected the ending {" or ".join(endings)}, found "{path.suffix}"{why}')


def _check_places(commands: Path, target: Path, run: Path | None) -> None:
    """Refuse to write over the commands, one file over another, and into a folder that is not there."""
    from seatrial.base.errors import TrialError

    places = {"--out": target} | ({} if run is None else {"--run": run})
    for option, path in places.items():
        if path.resolve() == commands.resolve():
            raise TrialError(f"{option} {path}: this is the file of the commands; give another name")
        if not path.absolute().parent.is_dir():
            raise TrialError(
                f"{option} {path}: there is no folder {path.parent}; make it or give another name"
            )
        if path.is_dir():
            raise TrialError(f"{option} {path}: expected a file, found a folder; give another name")
    if run is not None and run.resolve() == target.resolve():
        raise TrialError(f"--run {run}: the log goes to this file; give another name")
