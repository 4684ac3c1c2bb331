"""`export_fmu`: vehicle and autopilot as co-simulation units of FMI 2.0 and 3.0, with their sources.

The programs are those of `seatrial.export.c_code`; ``fmu_model.c`` keeps an instance of one, ``fmu_2.c`` and
``fmu_3.c`` are its functions under either standard, and `seatrial.export.fmu_files` describes it. With a C
compiler the unit gets a binary for this machine; without one it is a source unit, which the result says.

A compiler is a driver that starts others; killing it alone leaves them, and their hold on its output. So it
runs in a session of its own, and all of the session ends with it.

Source: Functional Mock-up Interface Specification 2.0.4 and 3.0.1 (Modelica Association). Tests:
``tests/export/test_fmu.py``.
"""

from __future__ import annotations

import io
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError
from seatrial.base.report import Reported
from seatrial.export.c_code import Program, Programs, recorded, written
from seatrial.export.fmu_files import described

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.flight.mission import Mission
    from seatrial.identification.fitted import Fitted

Version = Literal["2.0", "3.0"]

_MOST_SAMPLES = 1000  # parameter sets in a unit: each is a row of its source


@dataclass(frozen=True, repr=False)
class FmuExport(Reported):
    """Units that were written.

    Attributes
    ----------
    files
        The units.
    programs
        What is in them.
    compiler
        The C compiler that built their binaries; empty where they hold sources only.
    samples
        Vehicles of the covariance among the parameter sets.
    binary
        Whether a binary was asked for.
    """

    files: list[Path]
    programs: Programs
    compiler: str
    samples: int
    binary: bool = True

    def to_dict(self) -> dict[str, Any]:
        """Files, compiler and interfaces as plain data."""
        return {
            "files": [str(path) for path in self.files],
            "compiler": self.compiler,
            "samples": self.samples,
            "units": {
                program.prefix: {
                    "step_s": program.step_s,
                    "parameters": len(program.parameters),
                    "inputs": [variable["known_as"] for variable in program.inputs],
                    "outputs": [variable["known_as"] for variable in program.outputs],
                }
                for program in self.programs.all()
            },
        }


def export_fmu(
    vehicle: Fitted | Vehicle | str | Path,
    autopilot: Autopilot | str | Path | None = None,
    *,
    out: str | Path,
    mission: Mission | str | Path | None = None,
    model: Vehicle | str | Path | None = None,
    name: str | None = None,
    feedback: bool = True,
    voltage_v: float | None = None,
    max_step_s: float = 0.02,
    rho: float | None = None,
    g: float | None = None,
    samples: int = 0,
    seed: int = 0,
    compiler: str | None = None,
) -> FmuExport:
    """A vehicle, and its autopilot on a mission, as co-simulation units of FMI 2.0 and 3.0.

    Writes ``NAME_vehicle.fmi2.fmu`` and ``NAME_vehicle.fmi3.fmu``, and with an autopilot the same of
    ``NAME_autopilot``.

    Parameters
    ----------
    vehicle, autopilot, out, mission, model, name, feedback, voltage_v, max_step_s, rho, g
        As for `export_c`.
    samples : int, optional
        Vehicles drawn from the covariance of an identification: the integer ``parameter_set`` chooses
        one of them from 1 on, 0 the parameters as they are set.
    seed : int, optional
        Of those draws.
    compiler : str, optional
        C compiler; by default ``$CC``, cc, gcc or clang, whichever is there first. "" builds no binary.

    Returns
    -------
    FmuExport

    Raises
    ------
    SimulationError
        As for `export_c`; the compiler fails.
    VehicleError
        A file cannot be read, or the autopilot does not fit the vehicle.
    """
    if not 0 <= samples <= _MOST_SAMPLES:
        raise SimulationError(f"samples: expected a number from 0 to {_MOST_SAMPLES}, found {samples}")
    programs = recorded(
        vehicle,
        autopilot,
        mission=mission,
        model=model,
        name=name,
        feedback=feedback,
        voltage_v=voltage_v,
        max_step_s=max_step_s,
        rho=rho,
        g=g,
    )
    sampled = _samples(programs.fitted, programs.vehicle, samples, seed)
    builder = c_compiler() if compiler is None else compiler
    units: dict[str, str | bytes] = {}
    for program in programs.all():
        # Only the vehicle has drawn parameters.
        of_program = sampled if program is programs.vehicle else {}
        for version in ("2.0", "3.0"):
            units[f"{program.prefix}.fmi{version[0]}.fmu"] = _unit(program, version, of_program, builder)
    count = len(next(iter(sampled.values()), ()))
    return FmuExport(written(Path(out), units), programs, builder, count, binary=compiler != "")


def _samples(fitted: Fitted, program: Program, samples: int, seed: int) -> dict[str, Array]:
    """Values (samples,) of the parameters that vary, by their names here."""
    if samples == 0:
        return {}
    known = [parameter["known_as"] for parameter in program.parameters]
    drawn = {
        name: np.asarray(values) for name, values in fitted.draws(samples, seed).items() if name in known
    }
    if not drawn:
        raise SimulationError(
            f"samples: the coefficients of {fitted.vehicle.name} count as exact; name the run directory of an"
            " identification"
        )
    return drawn


def _binary_path(prefix: str, version: str) -> str:
    """Where the binary stands in a unit."""
    suffix = "dylib" if sys.platform == "darwin" else "so"
    if version == "3.0":
        return f"binaries/{platform()}/{prefix}.{suffix}"
    bits = {"x86_64-linux": "linux64", "x86_64-darwin": "darwin64"}.get(platform(), platform())
    return f"binaries/{bits}/{prefix}.{suffix}"


def _unit(program: Program, version: str, samples: Mapping[str, Array], compiler: str) -> bytes:
    """A unit as the bytes of its archive."""
    files = described(program, version, samples)
    content: dict[str, str | bytes] = {"modelDescription.xml": files.description}
    content |= {f"sources/{name}": text for name, text in files.sources.items()}
    if compiler:
        content[_binary_path(program.prefix, version)] = shared_library(
            files.sources, files.compiled, compiler
        )
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, text in content.items():
            # The same content is the same file: no time of day in it.
            entry = zipfile.ZipInfo(path, (1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o755 << 16 if path.startswith("binaries/") else 0o644 << 16
            archive.writestr(entry, text)
    return stream.getvalue()


_OPTIONS: Sequence[str] = ("-std=c99", "-O2", "-fPIC", "-shared", "-ffp-contract=off", "-fvisibility=hidden")


def c_compiler() -> str:
    """C compiler that is there, or nothing."""
    own = os.environ.get("CC", "")
    paths = (shutil.which(candidate) for candidate in (own, "cc", "gcc", "clang") if candidate)
    return next((path for path in paths if path), "")


def platform() -> str:
    """The platform's name in FMI 3.0."""
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(os.uname().machine, os.uname().machine)
    return f"{machine}-{'darwin' if sys.platform == 'darwin' else 'linux'}"


def ran(
    command: Sequence[str | Path],
    *,
    limit_s: float = 600.0,  # a unit is built in half a minute
    folder: Path | None = None,
    environment: Mapping[str, str] | None = None,
) -> subprocess.CompletedProcess[str]:
    """A program that ran to its end, without anything to read; its output as text.

    After `limit_s`, s, the program and all that it started are killed. `environment` is beside that of this
    process. Raises OSError where it cannot be started, a SubprocessError with its output where it took too
    long or failed.
    """
    with subprocess.Popen(
        [str(word) for word in command],
        cwd=folder,
        env=None if environment is None else os.environ | dict(environment),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,
    ) as process:
        try:
            output, errors = process.communicate(timeout=limit_s)
        except BaseException:
            # The session first: what it leaves behind would hold the pipes that the end waits for.
            with suppress(OSError):  # it has ended, and with it the session
                os.killpg(process.pid, signal.SIGKILL)
            process.kill()
            raise
    completed = subprocess.CompletedProcess(process.args, process.returncode, output, errors)
    completed.check_returncode()
    return completed


def shared_library(sources: Mapping[str, str], compiled: Sequence[str], compiler: str) -> bytes:
    """The bytes of a shared library out of sources by name, of which the compiler is given some.

    Raises `SimulationError`: the compiler fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        for name, text in sources.items():
            (Path(folder) / name).write_text(text)
        try:
            ran([compiler, *_OPTIONS, *compiled, "-o", "unit.bin", "-lm"], folder=Path(folder))
        except (OSError, subprocess.SubprocessError) as error:
            output = getattr(error, "stderr", "") or str(error)
            raise SimulationError(
                f"{compiler}: cannot build the unit: {str(output).strip()[:400]}; set CC to a C99 compiler,"
                " or build none with --no-binary"
            ) from None
        return (Path(folder) / "unit.bin").read_bytes()
