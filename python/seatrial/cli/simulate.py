"""`seatrial simulate`: a vehicle under recorded or invented commands."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    import polars as pl

    from seatrial._core import Run, State, Vehicle
    from seatrial.trial import Trial

_ENDINGS = (".csv", ".parquet")


def simulate(
    vehicle: Annotated[str, typer.Argument(help="Vehicle file or built-in vehicle.")],
    commands: Annotated[
        Path,
        typer.Argument(
            help="CSV or Parquet with t_s and cmd.ACTUATOR; also voltage_v, tau.*, a start state."
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="CSV or Parquet; beside the commands by default.")
    ] = None,
    free: Annotated[str, typer.Option(help="Letters of the axes that move, of XYZKMN.")] = "XYZKMN",
    json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Simulate a vehicle under commands; it starts from the first recorded state, else at rest in O."""
    from seatrial._core import Vehicle
    from seatrial.cli.console import output, print_json, table
    from seatrial.errors import TrialError
    from seatrial.trial import Trial

    loaded = Vehicle.load(vehicle)
    target = out or commands.with_name(f"{commands.stem}-run.csv")
    if target.suffix not in _ENDINGS:
        raise TrialError(f'{target}: expected the ending .csv or .parquet, found "{target.suffix}"')
    trial = Trial.read(commands, align=False)
    run = _run(loaded, trial, free)
    frame = _frame(run, trial)
    try:
        frame.write_csv(target) if target.suffix == ".csv" else frame.write_parquet(target)
    except OSError as error:
        raise TrialError(f"{target}: cannot be written ({error}); choose another place with --out") from None
    summary = _summary(run) | {"file": str(target)}
    if json:
        print_json(summary)
        return
    console = output()
    rows = [[name, f"{value:.4g}"] for name, value in summary.items() if not isinstance(value, str)]
    console.print(table(f"{loaded.name} under {commands.name}", ["quantity", "value"], rows))
    console.print(f"Run in {target}", soft_wrap=True, markup=False)


def _run(vehicle: Vehicle, trial: Trial, free: str) -> Run:
    from seatrial.errors import TrialError, nearest

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
    if any(facts["needs_voltage"] for facts in vehicle.actuator_info().values()) and trial.voltage is None:
        raise TrialError(
            f"{trial.source}: the thrust of {vehicle.name} depends on the supply voltage; add a column"
            " voltage_v"
        )
    return vehicle.simulate(
        trial.t,
        dict(trial.commands),
        _start(trial),
        trial.current,
        free,
        trial.tau,
        voltage=trial.voltage,
        rho=trial.rho,
        g=trial.g,
    )


def _start(trial: Trial) -> State:
    """State of the first sample; zero where it was not recorded."""
    from seatrial._core import State

    return State(trial.position[0], trial.attitude[0], trial.nu[0])


def _frame(run: Run, trial: Trial) -> pl.DataFrame:
    """Table of a run with canonical columns, the commands and the actuators behind their motors."""
    import numpy as np
    import polars as pl

    angles = np.rad2deg(run.euler)
    nu = np.asarray(run.nu)
    columns: dict[str, Any] = {"t_s": run.t}
    columns |= dict(zip(("x_m", "y_m", "z_m"), np.asarray(run.position).T, strict=True))
    columns |= dict(zip(("roll_deg", "pitch_deg", "yaw_deg"), angles.T, strict=True))
    columns |= dict(zip(("u_m_s", "v_m_s", "w_m_s"), nu[:, :3].T, strict=True))
    columns |= dict(zip(("p_deg_s", "q_deg_s", "r_deg_s"), np.rad2deg(nu[:, 3:]).T, strict=True))
    columns |= {f"cmd.{name}": values for name, values in trial.commands.items()}
    columns |= {f"meas.{name}": values for name, values in run.actuators.items()}
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
