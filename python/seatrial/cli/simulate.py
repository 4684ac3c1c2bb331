"""`seatrial simulate`: a vehicle under commands of a file, as it moved or as its sensors logged it.

Tests: ``tests/base/test_bad_input.py``, ``tests/cli/test_cli_sensors.py``.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from seatrial.cli.options import Json

if TYPE_CHECKING:
    import polars as pl

_ENDINGS = (".csv", ".parquet")

_SEES_BOTTOM = {"dvl", "dvl_water"}


def simulate(
    vehicle: Annotated[
        str,
        typer.Argument(
            metavar="VEHICLE|RECIPE",
            help="Vehicle file or built-in vehicle; or the recipe of a generated trial.",
        ),
    ],
    commands: Annotated[
        Path | None,
        typer.Argument(
            help="CSV or Parquet with t_s and cmd.ACTUATOR; also voltage_v, tau.*, a start state. A recipe"
            " has its own."
        ),
    ] = None,
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
    surface: Annotated[
        float | None,
        typer.Option(
            metavar="Z",
            help="Where the sea ends, m down: 0 where z_m is the depth. Without it all is under water.",
        ),
    ] = None,
    run: Annotated[
        Path | None, typer.Option("--run", help="Beside the sensors' log, write the true run here.")
    ] = None,
    json: Json = False,
) -> None:
    """Simulate a vehicle under commands; it starts from the first recorded state, else at rest in O.

    Of a recipe alone: write the log of its sensors, and with --run what really happened.

    Example: seatrial simulate vehicle.toml steps.csv --out run.csv
    """
    from seatrial._core import Vehicle
    from seatrial.base.errors import TrialError
    from seatrial.cli.console import answer, check_axes, print_json
    from seatrial.sensors.ideal import ON_THE_TETHER, at_sea
    from seatrial.sensors.sensor import load_sensors
    from seatrial.trial.simulation import SimulatedTrial
    from seatrial.trial.trial import Trial

    if commands is None:
        given = {"--free": free != "XYZKMN", "--held": held, "--current": current, "--sensors": sensors}
        _recipe(
            Path(vehicle),
            (out, run),
            seed,
            given | {"--bottom": bottom, "--surface": surface is not None},
            json=json,
        )
        return
    loaded = Vehicle.load(vehicle)
    kind = "run" if sensors is None else "log"
    target = out or commands.with_name(f"{commands.stem}-{kind}.csv")
    check_axes(free, "--free")
    if held and free != "XYZKMN":
        raise TrialError("--held and --free: a tied vehicle moves along no axis; give one of them")
    read: dict[str, str | Path | None] = {
        "the commands": commands,
        "the vehicle": vehicle,
        "the sensors": sensors,
    }
    _check_places(target, run, read, log=sensors is not None)
    if sensors is None:
        for option, value in (("--seed", seed), ("--bottom", bottom), ("--run", run)):
            if value is not None:
                raise TrialError(f"{option} is for a log; give --sensors too")
    if bottom is not None and not bottom > 0.0:
        raise TrialError(f"--bottom: expected a depth in m below the surface, found {bottom:g}")
    fitted = None if sensors is None else load_sensors(sensors, loaded)
    if fitted is not None and not held and not fitted.keys() <= set(ON_THE_TETHER):
        fitted = at_sea(fitted)  # sensors of the tether alone are refused: --held was forgotten
    if bottom is not None and fitted is not None and not fitted.keys() & _SEES_BOTTOM:
        raise TrialError(f"--bottom is for a Doppler log; {sensors} has none")
    trial = Trial.read(commands, align=False, surface=surface)
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


def _recipe(
    path: Path,
    places: tuple[Path | None, Path | None],
    seed: int | None,
    given: dict[str, Any],
    *,
    json: bool,
) -> None:
    """Write the log of a recipe, and the truth where it is asked for."""
    from seatrial.base.errors import TrialError
    from seatrial.base.report import Report
    from seatrial.cli.console import answer, print_json
    from seatrial.trial.generated import Recipe

    if path.suffix != ".toml":
        raise TrialError(
            f"{path}: expected a vehicle and a file of commands, or the recipe of a generated trial (TOML)"
            " alone; found a vehicle alone"
        )
    for option, value in given.items():
        if value not in (None, False):
            raise TrialError(f"{option}: a recipe says this itself; leave the option out")
    out, run = places
    target = out or path.with_name(f"{path.stem}-log.csv")
    _check_places(target, run, {"the recipe": path}, log=True)
    recipe = Recipe.load(path)
    recipe = recipe if seed is None else recipe.with_seed(seed)
    recipe.save(target)
    if run is not None:
        _write(recipe.truth_table(), run, "--run")
    duration, ending = float(recipe.t[-1] - recipe.t[0]), None
    if recipe.flight is not None:
        ending = recipe.flight.outcome_in_words
    if json:
        files = {"file": str(target)} | ({} if run is None else {"run": str(run)})
        print_json({"duration, s": duration, "seed": recipe.seed, "flight": ending} | files)
        return
    how = "under its commands" if ending is None else f"sailed by an autopilot, mission {ending}"
    report = Report(
        title=f"{recipe.truth.vehicle.name} by {path.name}, seed {recipe.seed}",
        outcome="simulated",
        good=f"{duration:.0f} s {how}; {', '.join(recipe.sensors)} log",
        worst="nothing stands out: the motion is finite",
        next_step="name this log as a trial in a campaign",
    )
    results = f"Log in {target}" + ("" if run is None else f"\nTruth in {run}")
    answer(report, results=results)


def _write(frame: pl.DataFrame, path: Path, option: str) -> None:
    from seatrial.base.atomic_write import write_table

    write_table(frame, path, advice=f"choose another place with {option}")


def _check_places(target: Path, run: Path | None, inputs: dict[str, str | Path | None], *, log: bool) -> None:
    """Refuse a place that does not fit, an input, and one file over another."""
    from seatrial.base.errors import TrialError
    from seatrial.base.file_names import check_place

    # The first lines of a log say that it was generated, which Parquet has no place for.
    check_place(target, "--out", endings=_ENDINGS[:1] if log else _ENDINGS, inputs=inputs)
    if run is not None:
        check_place(run, "--run", endings=_ENDINGS, inputs=inputs)
        if run.resolve() == target.resolve():
            raise TrialError(f"--run {run}: the log goes to this file; give another name")
