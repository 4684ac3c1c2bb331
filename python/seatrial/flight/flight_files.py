"""What a flight leaves in its run directory: inputs and their hashes, versions, results, log, figures.

Held by ``tests/test_cli_fly.py``.
"""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seatrial import _core
from seatrial.run_directory import RUN_FILE, RunDirectory, to_json
from seatrial.whole_file import parquet

if TYPE_CHECKING:
    from seatrial.flight.flight import Flight

__all__ = ["facts", "write"]

_DIGEST = "sha256"


def facts(flight: Flight) -> dict[str, Any]:
    """What a flight rests on: versions, machine, seed, hashes of the inputs."""
    return {
        "kind": "flight",
        "name": flight.route.name,
        "versions": {name: metadata.version(name) for name in ("seatrial", "numpy", "polars")}
        | {"python": platform.python_version()},
        "machine": platform.machine(),
        "simd": _core.simd_level(),
        "seed": flight.circumstances.seed,
        _DIGEST: {name: hashlib.sha256(text.encode()).hexdigest() for name, text in _inputs(flight).items()},
        "circumstances": flight.circumstances.to_dict(),
    }


def write(
    flight: Flight, folder: str | Path, *, figures: bool = True, beside: Mapping[str, bytes] | None = None
) -> Path:
    """Path of a run directory with a flight.

    Parameters
    ----------
    flight : Flight
    folder : str or Path
        Made when it does not exist; an earlier run's is replaced.
    figures : bool, optional
        Whether to draw, PNG and PDF.
    beside : mapping of str to bytes, optional
        Further files by name.

    Raises
    ------
    SeatrialError
        The directory cannot be written; nothing is left half-written.
    """
    files: dict[str, str | bytes] = {
        RUN_FILE: to_json(facts(flight)),
        **{f"{name}.toml": text for name, text in _inputs(flight).items()},
        "flight.json": to_json(flight.to_dict()),
        "summary.txt": "\n".join(flight.sentences()) + "\n",
        "flight.parquet": parquet(flight.table()),
        **(beside or {}),
    }
    directory = RunDirectory(folder)  # last of all: what takes its time leaves nothing when it is interrupted
    try:
        if figures and not flight.diverged:
            _draw(flight, directory.workspace / "figures")
        return directory.publish(files)
    except BaseException:  # Ctrl-C too: nothing here is worth resuming
        directory.discard()
        raise


def _inputs(flight: Flight) -> dict[str, str]:
    """Files of the inputs by name, as they were used."""
    found = {
        "vehicle": flight.vehicle.to_toml(),
        "autopilot": flight.autopilot.to_toml(),
        "mission": flight.mission.to_toml(),
    }
    model = flight.circumstances.model.to_toml()
    return found if model == found["vehicle"] else found | {"model": model}


def _draw(flight: Flight, folder: Path) -> None:
    from seatrial.plot.flight_actuators import flight_actuators
    from seatrial.plot.flight_errors import flight_errors
    from seatrial.plot.flight_loops import flight_loops
    from seatrial.plot.flight_track import flight_track
    from seatrial.plot.style import save

    for name, drawn in (
        ("track", flight_track),
        ("loops", flight_loops),
        ("actuators", flight_actuators),
        ("errors", flight_errors),
    ):
        save(drawn(flight), folder / name)
