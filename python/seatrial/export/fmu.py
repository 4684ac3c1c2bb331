"""`export_fmu`: vehicle and autopilot as co-simulation units of FMI 2.0 and 3.0, with their sources.

The programs are those of `seatrial.export.c_code`; ``fmu_model.c`` keeps an instance of one, ``fmu_2.c`` and
``fmu_3.c`` are its functions under either standard, and an XML file describes it. Value references: 0 is the
time, then parameters, inputs and outputs in the order of the program, at last the integer that chooses a
parameter set. With a C compiler the unit gets a binary for this machine; without one it is a source unit,
which the result says.

A compiler is a driver that starts others; killing it alone leaves them, and their hold on its output. So it
runs in a session of its own, and all of the session ends with it.

Source: Functional Mock-up Interface Specification 2.0.4 and 3.0.1 (Modelica Association). Tests:
``tests/export/test_fmu.py``.
"""

from __future__ import annotations

import io
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.resources import files
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal
from xml.etree import ElementTree as Xml

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError
from seatrial.base.report import Reported
from seatrial.export.c_code import Program, Programs, recorded, written
from seatrial.flight.conditions import Conditions

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
    conditions = Conditions(model=model, feedback=feedback, voltage_v=voltage_v, max_step_s=max_step_s)
    programs = recorded(vehicle, autopilot, mission, conditions, name=name, rho=rho, g=g)
    sampled = _samples(programs.fitted, programs.vehicle, samples, seed)
    builder = c_compiler() if compiler is None else compiler
    units: dict[str, str | bytes] = {}
    for program in programs.all():
        # Only the vehicle has drawn parameters.
        of_program = sampled if program is programs.vehicle else {}
        for version in ("2.0", "3.0"):
            units[f"{program.prefix}.fmi{version[0]}.fmu"] = _unit(program, version, of_program, builder)
    sets = len(next(iter(sampled.values()), ()))
    return FmuExport(written(Path(out), units), programs, builder, sets, binary=compiler != "")


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
    """A unit of version "2.0" or "3.0" as the bytes of its archive; `samples`: values (k,) by parameter."""
    token = str(uuid.uuid5(uuid.NAMESPACE_URL, program.header + program.source + version))
    own = f"fmu_{version[0]}.c"
    compiled = (own, f"{program.prefix}.c")
    sources = {
        f"{program.prefix}.h": program.header,
        f"{program.prefix}.c": program.source,
        "fmu_names.h": _names(program, token, samples),
        "fmu_places.h": _places(program, samples),
        "fmu_model.c": _template("fmu_model.c"),
        own: _template(own),
    }
    sets = len(next(iter(samples.values()), ()))
    if version == "2.0":
        description = _description_2(program, token, sets, compiled)
    else:
        description = _description_3(program, token, sets)
        sources["buildDescription.xml"] = _document(_build_description(program, compiled)).decode()
    content: dict[str, str | bytes] = {"modelDescription.xml": _document(description)}
    content |= {f"sources/{name}": text for name, text in sources.items()}
    if compiler:
        content[_binary_path(program.prefix, version)] = shared_library(sources, compiled, compiler)
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


_SYMBOLS: Mapping[str, tuple[dict[str, int], float]] = {
    "m": ({"m": 1}, 1.0),
    "kg": ({"kg": 1}, 1.0),
    "s": ({"s": 1}, 1.0),
    "rad": ({"rad": 1}, 1.0),
    "N": ({"kg": 1, "m": 1, "s": -2}, 1.0),
    "deg": ({"rad": 1}, math.pi / 180.0),
    "rpm": ({"rad": 1, "s": -1}, 2.0 * math.pi / 60.0),
    "rev": ({"rad": 1}, 2.0 * math.pi),
    "us": ({"s": 1}, 1e-6),
    "1": ({}, 1.0),
}


def base_units(unit: str) -> tuple[dict[str, int], float] | None:
    """Exponents of the base units and the factor of a unit; None where it is not made of known ones.

    Examples
    --------
    >>> base_units("N s2/m")
    ({'kg': 1}, 1.0)
    >>> base_units("N m/rad per s")
    ({'kg': 1, 'm': 2, 's': -3, 'rad': -1}, 1.0)
    >>> base_units("shells") is None
    True
    """
    exponents: dict[str, int] = {}
    factor = 1.0
    for k, part in enumerate(re.split(r"/| per ", unit)):
        for word in part.split():
            match = re.fullmatch(r"([A-Za-z]+|1)([0-9]*)", word)
            if match is None or match[1] not in _SYMBOLS:
                return None
            power = (int(match[2]) if match[2] else 1) * (1 if k == 0 else -1)
            bases, own = _SYMBOLS[match[1]]
            factor *= own**power
            for base, exponent in bases.items():
                exponents[base] = exponents.get(base, 0) + exponent * power
    return {base: exponent for base, exponent in exponents.items() if exponent}, factor


def _template(name: str) -> str:
    return files("seatrial.export").joinpath(name).read_text()


def _variables(program: Program) -> Iterator[tuple[dict[str, Any], dict[str, str]]]:
    """Numbers of a program and what both standards say of them, in the order of their value references."""
    kinds = (
        ("parameter", "tunable", "parameters.", program.parameters),
        ("input", "continuous", "", program.inputs),
        ("output", "continuous", "", program.outputs),
    )
    reference = count(1)
    for causality, variability, before, variables in kinds:
        for variable in variables:
            yield (
                variable,
                {
                    "name": before + variable["known_as"],
                    "valueReference": str(next(reference)),
                    "description": variable["about"],
                    "causality": causality,
                    "variability": variability,
                },
            )


_ABOUT_SETS = "0: the parameters as they are set; else a vehicle drawn from the covariance"


def _parameter_set(program: Program) -> dict[str, str]:
    """What both standards say of the integer that chooses a parameter set."""
    return {
        "name": "parameter_set",
        "valueReference": str(sum(1 for _ in _variables(program)) + 1),
        "description": _ABOUT_SETS,
        "causality": "parameter",
        "variability": "tunable",
    }


def _names(program: Program, token: str, samples: Mapping[str, Array]) -> str:
    counts = {
        "N_PARAMETERS": len(program.parameters),
        "N_INPUTS": len(program.inputs),
        "N_NUMBERS": len(program.parameters) + len(program.inputs) + len(program.outputs),
        "N_SAMPLED": len(samples),
    }
    lines = [
        f'#include "{program.prefix}.h"',
        f"#define MODEL(name) {program.prefix}_##name",
        *(
            f"#define MODEL_{kind.upper()} {program.prefix}_{kind}"
            for kind in ("parameters", "constants", "state", "input", "output")
        ),
        f'#define TOKEN "{{{token}}}"',
        f"#define STEP_S {program.step_s!r}",
        f"#define MEASURED {int('measure' in program.operations)}",
        *(f"#define {name} {value}u" for name, value in counts.items()),
        f"#define N_SETS {len(next(iter(samples.values()), ()))}",
        f"#define REFERENCE_OF_SET {counts['N_NUMBERS'] + 1}u",
    ]
    return "\n".join(lines) + "\n"


def _places(program: Program, samples: Mapping[str, Array]) -> str:
    """Where the numbers stand in an instance, the start of its outputs, and the parameter sets."""
    kinds = (("own", program.parameters), ("in", program.inputs), ("out", program.outputs))
    offsets = [f"offsetof(Instance, {kind}.{variable['name']})" for kind, part in kinds for variable in part]
    lines = [
        "static const size_t number_places[N_NUMBERS] = {",
        *(f"    {offset}," for offset in offsets),
        "};",
        "static const double number_starts[N_NUMBERS] = {",
        *(f"    {_literal(variable['start'])}," for _, part in kinds for variable in part),
        "};",
        "/* What a parameter may be: the same ranges as in the files. */",
        "static const double parameter_ranges[N_PARAMETERS + 1u][2] = {",
        *(
            f"    {{{_literal(variable['least'])}, {_literal(variable['most'])}}},"
            for variable in program.parameters
        ),
        "    {0.0, 0.0}, /* none: C knows no empty table */",
        "};",
        f"static void output_starts({program.prefix}_output *out)",
        "{",
        *(f"    out->{variable['name']} = {_literal(variable['start'])};" for variable in program.outputs),
        "}",
    ]
    if samples:
        by_name = {variable["known_as"]: variable["name"] for variable in program.parameters}
        columns = [samples[name] for name in samples]
        lines += [
            "static const size_t sampled_places[N_SAMPLED] = {",
            *(f"    offsetof({program.prefix}_parameters, {by_name[name]})," for name in samples),
            "};",
            "static const double samples[] = {",
            *(f"    {', '.join(_literal(float(x)) for x in row)}," for row in zip(*columns, strict=True)),
            "};",
        ]
    return "\n".join(lines) + "\n"


def _literal(x: float) -> str:
    return repr(x) if math.isfinite(x) else "NAN" if math.isnan(x) else "INFINITY" if x > 0 else "-INFINITY"


def _number(x: float) -> str:
    """A number as XML Schema writes it."""
    return repr(x) if math.isfinite(x) else "NaN" if math.isnan(x) else "INF" if x > 0 else "-INF"


def _document(root: Xml.Element) -> bytes:
    Xml.indent(root)
    text: bytes = Xml.tostring(root, encoding="utf-8", xml_declaration=True)
    return text + b"\n"


def _units(root: Xml.Element, program: Program, *, time: bool) -> None:
    """The units in use, in base units; with that of the time where it is a variable."""
    used = {variable["unit"] for variable, _ in _variables(program)} | ({"s"} if time else set())
    names = sorted(used - {"1"})
    table = Xml.SubElement(root, "UnitDefinitions")
    for name in names:
        unit = Xml.SubElement(table, "Unit", name=name)
        base_form = base_units(name)
        if base_form is not None:
            exponents, factor = base_form
            facts = {base: str(exponent) for base, exponent in exponents.items()}
            if factor != 1.0:
                facts["factor"] = repr(factor)
            Xml.SubElement(unit, "BaseUnit", facts)


def _with_unit(variable: Mapping[str, Any]) -> dict[str, str]:
    return {} if variable["unit"] == "1" else {"unit": variable["unit"]}


def _description_2(program: Program, token: str, sets: int, compiled: tuple[str, ...]) -> Xml.Element:
    root = Xml.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=program.prefix,
        guid=f"{{{token}}}",
        generationTool="seatrial",
        variableNamingConvention="flat",
        numberOfEventIndicators="0",
    )
    unit = Xml.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=program.prefix,
        canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUstate="true",
        canSerializeFMUstate="true",
    )
    listed = Xml.SubElement(unit, "SourceFiles")
    for name in compiled:
        Xml.SubElement(listed, "File", name=name)
    _units(root, program, time=False)
    Xml.SubElement(root, "DefaultExperiment", startTime="0.0", stepSize=_number(program.step_s))
    table = Xml.SubElement(root, "ModelVariables")
    outputs = []
    initial = {"parameter": {"initial": "exact"}, "input": {}, "output": {"initial": "calculated"}}
    for variable, facts in _variables(program):
        start = {"start": _number(variable["start"])}
        if facts["causality"] == "output":
            start = {}
            outputs.append(facts["valueReference"])
        facts |= initial[facts["causality"]]
        Xml.SubElement(Xml.SubElement(table, "ScalarVariable", facts), "Real", start | _with_unit(variable))
    if sets:
        facts = _parameter_set(program) | {"initial": "exact"}
        whole = {"start": "0", "min": "0", "max": str(sets)}
        Xml.SubElement(Xml.SubElement(table, "ScalarVariable", facts), "Integer", whole)
    structure = Xml.SubElement(root, "ModelStructure")
    for kind in ("Outputs", "InitialUnknowns"):
        part = Xml.SubElement(structure, kind)
        for index in outputs:
            Xml.SubElement(part, "Unknown", index=index)
    return root


def _description_3(program: Program, token: str, sets: int) -> Xml.Element:
    root = Xml.Element(
        "fmiModelDescription",
        fmiVersion="3.0",
        modelName=program.prefix,
        instantiationToken=f"{{{token}}}",
        generationTool="seatrial",
        variableNamingConvention="flat",
    )
    Xml.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=program.prefix,
        canGetAndSetFMUState="true",
        canSerializeFMUState="true",
        canHandleVariableCommunicationStepSize="true",
        fixedInternalStepSize=_number(program.step_s),
    )
    _units(root, program, time=True)
    Xml.SubElement(root, "DefaultExperiment", startTime="0.0", stepSize=_number(program.step_s))
    table = Xml.SubElement(root, "ModelVariables")
    independent = {
        "name": "time",
        "valueReference": "0",
        "causality": "independent",
        "variability": "continuous",
    }
    Xml.SubElement(table, "Float64", independent | {"unit": "s"})
    outputs = []
    for variable, facts in _variables(program):
        if facts["causality"] == "output":
            facts["initial"] = "calculated"
            outputs.append(facts["valueReference"])
        else:
            facts["start"] = _number(variable["start"])
        Xml.SubElement(table, "Float64", facts | _with_unit(variable))
    if sets:
        facts = _parameter_set(program) | {"start": "0", "min": "0", "max": str(sets)}
        Xml.SubElement(table, "Int32", facts)
    structure = Xml.SubElement(root, "ModelStructure")
    for kind in ("Output", "InitialUnknown"):
        for reference in outputs:
            Xml.SubElement(structure, kind, valueReference=reference)
    return root


def _build_description(program: Program, compiled: tuple[str, ...]) -> Xml.Element:
    root = Xml.Element("fmiBuildDescription", fmiVersion="3.0")
    how = Xml.SubElement(root, "BuildConfiguration", modelIdentifier=program.prefix)
    files_of = Xml.SubElement(how, "SourceFileSet", language="C99")
    for name in compiled:
        Xml.SubElement(files_of, "SourceFile", name=name)
    Xml.SubElement(how, "Library", name="m")
    return root
