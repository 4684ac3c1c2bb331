"""`seatrial simulate`: a vehicle under commands of a file, as it moved or as its sensors logged it.

Tests: ``tests/base/test_bad_input.py``, ``tests/cli/test_cli_sensors.py``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seatrial.base.errors import TrialError
from seatrial.cli.options import Json, Triple, shared

if TYPE_CHECKING:
    import polars as pl

_ENDINGS = (".csv", ".parquet")

_SEES_BOTTOM = {"dvl", "dvl_water"}


@dataclass(frozen=True)
class Moving:
    """How the vehicle moves under its commands."""

    free: Annotated[str, typer.Option(help="Letters of the axes that move, of XYZKMN.")] = "XYZKMN"
    held: Annotated[bool, typer.Option("--held", help="Tie the vehicle, as in a bollard test.")] = False
    current: Annotated[
        Triple | None,
        typer.Option(
            metavar="NORTH EAST DOWN", help="Steady current, m/s, instead of one in the commands' file."
        ),
    ] = None


@dataclass(frozen=True)
class Logged:
    """What logs the motion, in which water."""

    sensors: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="Write what these sensors log instead of the run; or: typical."),
    ] = None
    seed: Annotated[
        int | None,
        typer.Option(min=0, help="Of the sensors' noise; the same seed, the same log. 1 by default."),
    ] = None
    bottom: Annotated[
        float | None, typer.Option(metavar="DEPTH", help="Depth of the bottom, m, for the Doppler log.")
    ] = None
    surface: Annotated[
        float | None,
        typer.Option(
            metavar="Z",
            help="Where the sea ends, m down: 0 where z_m is the depth. Without it all is under water.",
        ),
    ] = None
    run: Annotated[
        Path | None, typer.Option("--run", help="Beside the sensors' log, write the true run here.")
    ] = None


@shared
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
    moving: Moving = Moving(),
    logged: Logged = Logged(),
    json: Json = False,
) -> None:
    """Simulate a vehicle under commands; it starts from the first recorded state, else at rest in O.

    Of a recipe alone: write the log of its sensors, and with --run what really happened.

    Example: seatrial simulate vehicle.toml steps.csv --out run.csv
    """
    from seatrial._core import Vehicle
    from seatrial.cli.console import answer, print_json
    from seatrial.sensors.log import ON_THE_TETHER, at_sea
    from seatrial.sensors.sensor import load_sensors
    from seatrial.trial.simulation import SimulatedTrial
    from seatrial.trial.trial import Trial

    if commands is None:
        _recipe(Path(vehicle), out, moving, logged, json=json)
        return
    loaded = Vehicle.load(vehicle)
    sensors, run = logged.sensors, logged.run
    target = out or commands.with_name(f"{commands.stem}-{'run' if sensors is None else 'log'}.csv")
    read: dict[str, str | Path | None] = {"the commands": commands, "the vehicle": vehicle}
    _check(moving, logged)
    _check_places(target, run, read | {"the sensors": sensors}, log=sensors is not None)
    fitted = None if sensors is None else load_sensors(sensors, loaded)
    if fitted is not None and not moving.held and not fitted.keys() <= set(ON_THE_TETHER):
        fitted = at_sea(fitted)  # sensors of the tether alone are refused: --held was forgotten
    if logged.bottom is not None and fitted is not None and not fitted.keys() & _SEES_BOTTOM:
        raise TrialError(f"--bottom is for a Doppler log; {sensors} has none")
    trial = Trial.read(commands, align=False, surface=logged.surface)
    made = SimulatedTrial(loaded, trial, moving.free, moving.held, moving.current, fitted)
    truth = made.frame()
    if fitted is None:
        _write(truth, target, "--out")
        results, after = f"Run in {target}", f"seatrial score {vehicle} {target}"
    else:
        seed = 1 if logged.seed is None else logged.seed
        if run is not None:
            _write(truth, run, "--run")
        label = f"{loaded.name} under {commands.name}, sensors {sensors}, seed {seed}"
        made.write_log(target, seed, logged.bottom, label)
        results, after = f"Log of {', '.join(fitted)} in {target}", "name this log as a trial in a campaign"
    if json:
        print_json(made.summary() | {"file": str(target)} | ({} if run is None else {"run": str(run)}))
        return
    results += "" if run is None else f"\nRun in {run}"
    answer(made.report(f"{loaded.name} under {commands.name}", after), results=results)


def _check(moving: Moving, logged: Logged) -> None:
    """Refuse axes, and options that do not go together."""
    from seatrial.cli.console import check_axes

    check_axes(moving.free, "--free")
    if moving.held and moving.free != "XYZKMN":
        raise TrialError("--held and --free: a tied vehicle moves along no axis; give one of them")
    for option, value in (("--seed", logged.seed), ("--bottom", logged.bottom), ("--run", logged.run)):
        if value is not None and logged.sensors is None:
            raise TrialError(f"{option} is for a log; give --sensors too")
    if logged.bottom is not None and not logged.bottom > 0.0:
        raise TrialError(f"--bottom: expected a depth in m below the surface, found {logged.bottom:g}")


def _recipe(path: Path, out: Path | None, moving: Moving, logged: Logged, *, json: bool) -> None:
    """Write the log of a recipe, and the truth where it is asked for."""
    from seatrial.base.report import Report
    from seatrial.cli.console import answer, print_json
    from seatrial.trial.generated import Recipe

    if path.suffix != ".toml":
        raise TrialError(
            f"{path}: expected a vehicle and a file of commands, or the recipe of a generated trial (TOML)"
            " alone; found a vehicle alone"
        )
    for options, names in ((moving, ("free", "held", "current")), (logged, ("sensors", "bottom", "surface"))):
        for name in names:
            if getattr(options, name) != getattr(type(options), name):
                raise TrialError(f"--{name}: a recipe says this itself; leave the option out")
    # Beside the recipe, unless another place is given; never over an input.
    target, run = out or path.with_name(f"{path.stem}-log.csv"), logged.run
    _check_places(target, run, {"the recipe": path}, log=True)
    recipe = Recipe.load(path)
    recipe = recipe if logged.seed is None else recipe.with_seed(logged.seed)
    recipe.save(target)
    if run is not None:
        _write(recipe.truth_table(), run, "--run")
    duration = float(recipe.t[-1] - recipe.t[0])
    ending = None if recipe.flight is None else recipe.flight.outcome_in_words
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
    answer(report, results=f"Log in {target}" + ("" if run is None else f"\nTruth in {run}"))


def _write(frame: pl.DataFrame, path: Path, option: str) -> None:
    from seatrial.base.atomic_write import write_table

    write_table(frame, path, advice=f"choose another place with {option}")


def _check_places(target: Path, run: Path | None, inputs: dict[str, str | Path | None], *, log: bool) -> None:
    """Refuse a place that does not fit, an input, and one file over another."""
    from seatrial.base.file_names import check_place

    # The first lines of a log say that it was generated, which Parquet has no place for.
    check_place(target, "--out", endings=_ENDINGS[:1] if log else _ENDINGS, inputs=inputs)
    if run is not None:
        check_place(run, "--run", endings=_ENDINGS, inputs=inputs)
        if run.resolve() == target.resolve():
            raise TrialError(f"--run {run}: the log goes to this file; give another name")
