"""`seatrial simulate`: a vehicle under commands of a file, as it moved or as its sensors logged it.

What `seatrial simulate` refuses: places to write to, and runs that diverge.

Tests: ``tests/base/test_bad_input.py``, ``tests/cli/test_cli_sensors.py``.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from seatrial.cli.console import Json

if TYPE_CHECKING:
    import numpy as np
    import polars as pl
    from numpy.typing import NDArray

    from seatrial._core import Run, State, Vehicle
    from seatrial.base.report import Report
    from seatrial.sensors.sensor import Sensor
    from seatrial.trial.trial import Trial

__all__ = ["check_ending", "check_finite", "check_places", "simulate"]

_ENDINGS = (".csv", ".parquet")

_SEES_BOTTOM = {"dvl", "dvl_water"}

_DECIMALS = {"s": 1, "m": 2, "m/s": 3, "deg": 1}

_RISE_M = 1.0  # a vehicle with its centre higher than this has left the water


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
    from seatrial.trial.trial import Trial

    loaded = Vehicle.load(vehicle)
    kind = "run" if sensors is None else "log"
    target = out or commands.with_name(f"{commands.stem}-{kind}.csv")
    check_ending(target, _ENDINGS if sensors is None else _ENDINGS[:1])
    if run is not None:
        check_ending(run, _ENDINGS)
    check_axes(free, "--free")
    if held and free != "XYZKMN":
        raise TrialError("--held and --free: a tied vehicle moves along no axis; give one of them")
    check_places(commands, target, run)
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
    made = _Simulation(loaded, trial, free, held, current, fitted)
    check_finite(made.run, trial)
    truth = _frame(made.run, trial, made.every)
    if fitted is None:
        _write(truth, target, "--out")
    else:
        label = f"{loaded.name} under {commands.name}, sensors {sensors}, seed {1 if seed is None else seed}"
        if run is not None:
            _write(truth, run, "--run")
        made.write_log(target, 1 if seed is None else seed, bottom, label)
    summary = _summary(made.run) | {"file": str(target)} | ({} if run is None else {"run": str(run)})
    if json:
        print_json(summary)
        return
    what = "Run" if fitted is None else f"Log of {', '.join(fitted)}"
    results = f"{what} in {target}" + ("" if run is None else f"\nRun in {run}")
    unlogged = held and fitted is not None and "load_cell" not in fitted
    after = (
        f"seatrial score {vehicle} {target}" if fitted is None else "name this log as a trial in a campaign"
    )
    answer(
        _report(f"{loaded.name} under {commands.name}", summary, made.run, unlogged, after), results=results
    )


def _report(title: str, summary: dict[str, Any], run: Run, unlogged: bool, after: str) -> Report:
    """Three lines and a table of a simulated run."""
    import numpy as np

    from seatrial.base.report import Report, Section, Table

    worst = "no problem found: the run is finite and stays below the surface"
    rise = -float(np.asarray(run.position)[:, 2].min())
    if unlogged:
        worst = "The pull of the tied vehicle is not in the log: these sensors have no load_cell"
    if rise > _RISE_M:
        worst = (
            f"The vehicle rises {rise:.1f} m above the surface, which the model does not know; start deeper,"
            " with a column z_m, or command otherwise"
        )
    rows = [(name, _cell(name, value)) for name, value in summary.items() if not isinstance(value, str)]
    return Report(
        title=title,
        outcome="simulated",
        good=f"{summary['distance, m']:.1f} m in {summary['duration, s']:.1f} s, largest speed"
        f" {summary['largest speed, m/s']:.3f} m/s",
        worst=worst,
        next_step=after,
        sections=(Section(tables=(Table.of("Whole run", ("quantity", "value"), rows),)),),
    )


class _Simulation:
    """A vehicle under the commands of a file, with as many rows per row of the file as its sensors need."""

    def __init__(
        self,
        vehicle: Vehicle,
        trial: Trial,
        free: str,
        held: bool,
        current: tuple[float, float, float] | None,
        sensors: dict[str, Sensor] | None,
    ) -> None:
        import numpy as np

        from seatrial.sensors.log import finer, linear, times
        from seatrial.sensors.log import held as rows_held

        _check(vehicle, trial, held, current)
        self.vehicle, self.trial, self.held, self.sensors = vehicle, trial, held, sensors or {}
        self.every = finer(self.sensors.values(), trial.t)
        self.current: NDArray[np.float64] | None = None if current is None else np.array(current)
        if current is None and trial.current is not None:
            self.current = linear(trial.current, self.every)
        self.voltage = None if trial.voltage_v is None else rows_held(trial.voltage_v, self.every)
        self.run = vehicle.simulate(
            times(trial.t, self.every),
            {name: rows_held(values, self.every) for name, values in trial.commands.items()},
            _start(trial),
            self.current,
            "" if held else free,
            None if trial.tau is None else rows_held(trial.tau, self.every),
            voltage_v=self.voltage,
            rho=trial.rho,
            g=trial.g,
        )

    def write_log(self, path: Path, seed: int, bottom: float | None, label: str) -> None:
        """Write what the sensors log, and the inputs of the run but for the current."""
        from seatrial.sensors.ideal import Conditions
        from seatrial.sensors.log import measure
        from seatrial.trial.columns import GROUPS
        from seatrial.trial.generated import write_generated

        inputs = {f"cmd.{name}": values for name, values in self.trial.commands.items()}
        if self.trial.voltage_v is not None and "voltage" not in self.sensors:
            inputs["voltage_v"] = self.trial.voltage_v
        if self.trial.tau is not None:
            names = [
                column for group in GROUPS if group.name in ("force", "moment") for column in group.columns
            ]
            inputs |= dict(zip(names, self.trial.tau.T, strict=True))
        around = Conditions(
            vehicle=self.vehicle,
            current=self.current,
            voltage_v=self.voltage,
            bottom_depth_m=bottom,
            held=self.held,
        )
        log = measure(self.run, self.sensors, seed=seed, conditions=around, inputs=inputs, every=self.every)
        write_generated(log, path, label)


def _check(vehicle: Vehicle, trial: Trial, held: bool, current: tuple[float, float, float] | None) -> None:
    import numpy as np

    from seatrial.base.errors import TrialError, nearest

    for name in trial.commands:
        if name not in vehicle.actuators:
            raise TrialError(
                f'{trial.source}: column "cmd.{name}": the vehicle {vehicle.name} has no such actuator'
                + nearest(name, vehicle.actuators)
            )
    if not trial.commands and trial.tau is None:
        raise TrialError(
            f"{trial.source}: nothing drives the vehicle; expected columns cmd.{vehicle.actuators[0]} ..."
            if vehicle.actuators
            else f"{trial.source}: nothing drives the vehicle; expected columns tau.X_n ..."
        )
    if any(facts["needs_voltage"] for facts in vehicle.actuator_info().values()) and trial.voltage_v is None:
        raise TrialError(
            f"{trial.source}: the thrust of {vehicle.name} depends on the supply voltage; add a column"
            " voltage_v"
        )
    if held and np.any(trial.nu[0]):
        raise TrialError(
            f"{trial.source}: --held: a tied vehicle is at rest, and these commands start with a velocity;"
            " leave the columns of velocity out"
        )
    if current is not None and not np.isfinite(current).all():
        raise TrialError(f"--current: expected three numbers in m/s, found {current}")


def _start(trial: Trial) -> State:
    """State of the first sample; zero where it was not recorded."""
    from seatrial._core import State

    return State(trial.position[0], trial.attitude[0], trial.nu[0])


def _write(frame: pl.DataFrame, path: Path, option: str) -> None:
    from seatrial.base.atomic_write import write_table

    write_table(frame, path, advice=f"choose another place with {option}")


def _cell(name: str, value: float) -> str:
    """A quantity of the summary with the decimals that its unit deserves; no minus before zero."""
    return f"{round(value, _DECIMALS[name.rsplit(', ', 1)[1]]) + 0.0:.{_DECIMALS[name.rsplit(', ', 1)[1]]}f}"


def _frame(run: Run, trial: Trial, every: int) -> pl.DataFrame:
    """Table of a run with canonical columns, the commands and the actuators behind their motors."""
    import numpy as np
    import polars as pl

    angles = np.rad2deg(run.euler)[::every]
    nu, position = np.asarray(run.nu)[::every], np.asarray(run.position)[::every]
    columns: dict[str, Any] = {"t_s": np.asarray(run.t)[::every]}
    columns |= dict(zip(("x_m", "y_m", "z_m"), position.T, strict=True))
    columns |= dict(zip(("roll_deg", "pitch_deg", "yaw_deg"), angles.T, strict=True))
    columns |= dict(zip(("u_m_s", "v_m_s", "w_m_s"), nu[:, :3].T, strict=True))
    columns |= dict(zip(("p_deg_s", "q_deg_s", "r_deg_s"), np.rad2deg(nu[:, 3:]).T, strict=True))
    columns |= {f"cmd.{name}": values for name, values in trial.commands.items()}
    columns |= {f"meas.{name}": values[::every] for name, values in run.actuators.items()}
    return pl.DataFrame(columns)


def _summary(run: Run) -> dict[str, Any]:
    import numpy as np

    speed = np.linalg.norm(np.asarray(run.nu)[:, :3], axis=1)
    path = np.linalg.norm(np.diff(np.asarray(run.position), axis=0), axis=1).sum()
    angles = np.rad2deg(run.euler)
    return {
        "duration, s": float(run.t[-1] - run.t[0]),
        "distance, m": float(path),
        "largest speed, m/s": float(speed.max()),
        "last speed, m/s": float(speed[-1]),
        "last depth, m": float(run.position[-1, 2]),
        "largest heel, deg": float(np.abs(angles[:, 0]).max()),
        "largest trim, deg": float(np.abs(angles[:, 1]).max()),
        "last heading, deg": float(angles[-1, 2]),
    }


def check_ending(path: Path, endings: tuple[str, ...]) -> None:
    """Refuse a file whose ending is none of these."""
    from seatrial.base.errors import TrialError

    if path.suffix not in endings:
        why = "" if len(endings) > 1 else "; the first lines of a log say that it was generated"
        raise TrialError(f'{path}: expected the ending {" or ".join(endings)}, found "{path.suffix}"{why}')


def check_places(commands: Path, target: Path, run: Path | None) -> None:
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


def check_finite(run: Run, trial: Trial) -> None:
    """Refuse a run that diverged."""
    import numpy as np

    from seatrial.base.errors import SimulationError

    good = np.isfinite(np.asarray(run.nu)).all(axis=1) & np.isfinite(np.asarray(run.position)).all(axis=1)
    if not good.all():
        t = float(np.asarray(run.t)[int(np.argmin(good))])
        raise SimulationError(
            f"{trial.source}: the simulation diverges at {t:.4g} s; check the vehicle (seatrial check), the"
            " size of the commands and the current"
        )
