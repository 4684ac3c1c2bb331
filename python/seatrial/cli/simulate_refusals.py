"""What `seatrial simulate` refuses: places to write to, and runs that diverge.

Tests: ``tests/test_bad_input.py``, ``tests/test_cli_sensors.py``.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from seatrial._core import Run
    from seatrial.trial import Trial


def check_ending(path: Path, endings: tuple[str, ...]) -> None:
    """Refuse a file whose ending is none of these."""
    from seatrial.errors import TrialError

    if path.suffix not in endings:
        why = "" if len(endings) > 1 else "; the first lines of a log say that it was generated"
        raise TrialError(f'{path}: expected the ending {" or ".join(endings)}, found "{path.suffix}"{why}')


def check_places(commands: Path, target: Path, run: Path | None) -> None:
    """Refuse to write over the commands, one file over another, and into a folder that is not there."""
    from seatrial.errors import TrialError

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

    from seatrial.errors import SimulationError

    good = np.isfinite(np.asarray(run.nu)).all(axis=1) & np.isfinite(np.asarray(run.position)).all(axis=1)
    if not good.all():
        t = float(np.asarray(run.t)[int(np.argmin(good))])
        raise SimulationError(
            f"{trial.source}: the simulation diverges at {t:.4g} s; check the vehicle (seatrial check), the"
            " size of the commands and the current"
        )
