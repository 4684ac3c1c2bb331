"""The files of a unit: its description as XML for FMI 2.0 and 3.0, and the sources that name its numbers.

Value references: 0 is the time, then parameters, inputs and outputs in the order of the program, at last the
integer that chooses a parameter set. Tests: ``tests/export/test_fmu.py``.
"""

from __future__ import annotations

import math
import re
import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Any
from xml.etree import ElementTree as Xml

from seatrial.base.arrays import Array
from seatrial.export.c_code import Program


@dataclass(frozen=True)
class BuildFiles:
    """What stands in a unit besides its binary."""

    description: bytes  #: ``modelDescription.xml``.
    sources: dict[str, str]  #: Files of the folder ``sources`` by name.
    compiled: tuple[str, ...]  #: Those of them that a compiler is given.


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


def described(program: Program, version: str, samples: Mapping[str, Array]) -> BuildFiles:
    """Description and sources of a unit by version "2.0" or "3.0".

    `samples`: values (k,) of parameters by their names here, k parameter sets.
    """
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
    count = len(next(iter(samples.values()), ()))
    if version == "2.0":
        return BuildFiles(_document(_description_2(program, token, count, compiled)), sources, compiled)
    sources["buildDescription.xml"] = _document(_build_description(program, compiled)).decode()
    return BuildFiles(_document(_description_3(program, token, count)), sources, compiled)


def _template(name: str) -> str:
    return files("seatrial.export").joinpath(name).read_text()


def _variables(program: Program) -> list[tuple[dict[str, Any], str, str]]:
    """Numbers of a program with causality and variability, in the order of their value references."""
    return [
        *(
            (variable | {"name": f"parameters.{variable['known_as']}"}, "parameter", "tunable")
            for variable in program.parameters
        ),
        *((variable | {"name": variable["known_as"]}, "input", "continuous") for variable in program.inputs),
        *(
            (variable | {"name": variable["known_as"]}, "output", "continuous")
            for variable in program.outputs
        ),
    ]


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
    used = {variable["unit"] for variable, *_ in _variables(program)} | ({"s"} if time else set())
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
    for reference, (variable, causality, variability) in enumerate(_variables(program), start=1):
        facts = {
            "name": variable["name"],
            "valueReference": str(reference),
            "description": variable["about"],
            "causality": causality,
            "variability": variability,
        }
        start = {} if causality == "output" else {"start": _number(variable["start"])}
        if causality != "input":
            facts["initial"] = "calculated" if causality == "output" else "exact"
        if causality == "output":
            outputs.append(reference)
        Xml.SubElement(Xml.SubElement(table, "ScalarVariable", facts), "Real", start | _with_unit(variable))
    if sets:
        facts = {
            "name": "parameter_set",
            "valueReference": str(len(_variables(program)) + 1),
            "description": _ABOUT_SETS,
            "causality": "parameter",
            "variability": "tunable",
            "initial": "exact",
        }
        whole = {"start": "0", "min": "0", "max": str(sets)}
        Xml.SubElement(Xml.SubElement(table, "ScalarVariable", facts), "Integer", whole)
    structure = Xml.SubElement(root, "ModelStructure")
    for kind in ("Outputs", "InitialUnknowns"):
        part = Xml.SubElement(structure, kind)
        for index in outputs:
            Xml.SubElement(part, "Unknown", index=str(index))
    return root


_ABOUT_SETS = "0: the parameters as they are set; else a vehicle drawn from the covariance"


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
    for reference, (variable, causality, variability) in enumerate(_variables(program), start=1):
        facts = {
            "name": variable["name"],
            "valueReference": str(reference),
            "description": variable["about"],
            "causality": causality,
            "variability": variability,
        }
        if causality == "output":
            facts["initial"] = "calculated"
            outputs.append(reference)
        else:
            facts["start"] = _number(variable["start"])
        Xml.SubElement(table, "Float64", facts | _with_unit(variable))
    if sets:
        facts = {
            "name": "parameter_set",
            "valueReference": str(len(_variables(program)) + 1),
            "description": _ABOUT_SETS,
            "causality": "parameter",
            "variability": "tunable",
            "start": "0",
            "min": "0",
            "max": str(sets),
        }
        Xml.SubElement(table, "Int32", facts)
    structure = Xml.SubElement(root, "ModelStructure")
    for kind in ("Output", "InitialUnknown"):
        for reference in outputs:
            Xml.SubElement(structure, kind, valueReference=str(reference))
    return root


def _build_description(program: Program, compiled: tuple[str, ...]) -> Xml.Element:
    root = Xml.Element("fmiBuildDescription", fmiVersion="3.0")
    how = Xml.SubElement(root, "BuildConfiguration", modelIdentifier=program.prefix)
    files_of = Xml.SubElement(how, "SourceFileSet", language="C99")
    for name in compiled:
        Xml.SubElement(files_of, "SourceFile", name=name)
    Xml.SubElement(how, "Library", name="m")
    return root
