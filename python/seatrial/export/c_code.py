"""`export_c`: one step of a vehicle, its autopilot and its navigation filter as C99, recorded from the core.

The core runs its own step once on numbers that record what is done with them
(``crates/seatrial/src/number/traced.rs``) and writes the record as C. Tests: ``tests/export/test_c.py``,
``crates/seatrial/tests/export.rs``; of the filter, which ``crates/seatrial/src/export/filter.rs`` writes,
``tests/export/test_c_filter.py``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seatrial._core import Autopilot, Vehicle, autopilot_c, filter_c, vehicle_c
from seatrial.base.errors import SimulationError, printable
from seatrial.base.files import whole_folder, write_atomic, writing
from seatrial.base.report import Reported
from seatrial.base.run import version
from seatrial.base.toml_file import loaded
from seatrial.export.repeated import folded
from seatrial.flight.checks import checked_step, checked_supply
from seatrial.flight.conditions import PLAIN, Conditions
from seatrial.flight.mission import Mission, Route
from seatrial.flight.navigation import NavigationFilter, checked_navigation, filter_of
from seatrial.flight.sensor_channels import sensors_of

if TYPE_CHECKING:
    from seatrial.identification.fitted import Fitted
    from seatrial.sensors.sensor import Sensor


@dataclass(frozen=True)
class Program:
    """A step as C."""

    prefix: str  #: Of all of its public names.
    #: `header`, `source`: text of ``PREFIX.h`` and ``PREFIX.c``.
    header: str
    source: str
    #: `parameters`, `state`, `inputs`, `outputs`: its numbers: ``name`` in C, ``known_as`` here, ``unit``,
    #: ``about``, ``start``.
    parameters: list[dict[str, Any]]
    state: list[dict[str, Any]]
    inputs: list[dict[str, Any]]
    outputs: list[dict[str, Any]]
    operations: dict[str, dict[str, int]]  #: Per function the operations of a call by kind.
    step_s: float  #: Time that a step takes, s.


"""What is recorded of a filter, as the table of operations names it: half a step of the motors, one of four
stages of the equation of motion. Its matrix algebra is not among them."""


@dataclass(frozen=True)
class Programs:
    """What was recorded: the vehicle, the autopilot where there is one, and how well the vehicle is known."""

    vehicle: Program
    autopilot: Program | None
    fitted: Fitted
    substeps: int
    """Steps of the vehicle in a control period."""
    filter: Program | None = None
    """The navigation filter, where one was asked for."""

    def all(self) -> list[Program]:
        """Those that there are."""
        return [program for program in (self.vehicle, self.autopilot, self.filter) if program is not None]


@dataclass(frozen=True, repr=False)
class CExport(Reported):
    """Files that were written, and the programs in them.

    Attributes
    ----------
    programs
        The programs.
    folder
        Where they are.
    files
        Headers and sources.
    """

    programs: Programs
    folder: Path
    files: list[Path] = field(default_factory=list)

    def to_dict(self) -> dict[str, Any]:
        """Files, operations and the numbers of the interfaces as plain data."""
        return {
            "folder": str(self.folder),
            "files": [str(path) for path in self.files],
            "programs": {
                program.prefix: {
                    "step_s": program.step_s,
                    "operations": program.operations,
                    "parameters": program.parameters,
                    "state": len(program.state),
                    "inputs": program.inputs,
                    "outputs": program.outputs,
                }
                for program in self.programs.all()
            },
        }


def export_c(
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
    navigation: str | NavigationFilter = "sensors",
    sensors: Mapping[str, Sensor] | str | Path | None = None,
) -> CExport:
    """One step of a vehicle, and of its autopilot on a mission, as C99 without dependencies but ``math.h``.

    Writes ``NAME_vehicle.h`` and ``.c``, with an autopilot ``NAME_autopilot.h`` and ``.c``, with a navigation
    filter ``NAME_filter.h`` and ``.c``. Vehicle and autopilot are the steps that fly here; of the filter the
    motors and the equation of motion with its derivatives are, and its matrix algebra is written as loops.

    Parameters
    ----------
    vehicle : Fitted, Vehicle, str or Path
        A vehicle, a built-in name, a file, or the run directory of an identification.
    autopilot : Autopilot, str or Path, optional
        The same of the autopilot; it needs a mission.
    out : str or Path
        Folder for the files.
    mission : Mission, str or Path, optional
        The mission that becomes part of the autopilot's program.
    model : Vehicle, str or Path, optional
        The vehicle that the autopilot believes in; by default `vehicle`.
    name : str, optional
        Prefix of files and functions; by default the vehicle's name.
    feedback : bool, optional
        Whether the autopilot is told what its actuators do, and so finds a failed one.
    voltage_v : float, optional
        Supply, V, where thrust depends on it; it is part of the program.
    max_step_s : float, optional
        The longest step of the vehicle, s; with an autopilot a whole number of them makes its period.
    rho, g : float, optional
        Density, kg/m3, and gravity, m/s2, of the vehicle; by default the vehicle file's.
    navigation : str or NavigationFilter, optional
        "filter" writes the navigation filter that `fly` makes of `sensors` where `model` is given: it does
        not count on a vehicle that moves exactly as the model. A `NavigationFilter` writes that one, at the
        autopilot's period.
    sensors : mapping of str to Sensor, str or Path, optional
        Sensors of the filter as in `fly`; good ones of every kind when omitted.

    Returns
    -------
    CExport

    Raises
    ------
    SimulationError
        The step cannot be recorded, an argument is impossible, or a file cannot be written.
    VehicleError
        A file cannot be read, or the autopilot does not fit the vehicle.
    """
    conditions = Conditions(
        sensors=sensors,
        navigation=navigation,
        model=model,
        feedback=feedback,
        voltage_v=voltage_v,
        max_step_s=max_step_s,
    )
    programs = recorded(vehicle, autopilot, mission, conditions, name=name, rho=rho, g=g)
    # A unit is at home on a large machine and is not folded: the same numbers, sooner.
    programs = replace(
        programs,
        vehicle=_folded(programs.vehicle),
        autopilot=None if programs.autopilot is None else _folded(programs.autopilot),
    )
    folder = Path(out)
    texts = {
        f"{program.prefix}{suffix}": text
        for program in programs.all()
        for suffix, text in ((".h", program.header), (".c", program.source))
    }
    return CExport(programs, folder, written(folder, texts))


def recorded(
    vehicle: Fitted | Vehicle | str | Path,
    autopilot: Autopilot | str | Path | None = None,
    mission: Mission | str | Path | None = None,
    conditions: Conditions = PLAIN,
    *,
    name: str | None = None,
    rho: float | None = None,
    g: float | None = None,
) -> Programs:
    """The programs of `export_c`, which says what its arguments are, not written yet."""
    from seatrial.identification.fitted import Fitted

    voltage_v, max_step_s = conditions.voltage_v, conditions.max_step_s
    fitted = Fitted.of(vehicle)
    flown = fitted.vehicle
    if (autopilot is None) != (mission is None):
        lacking = (
            "mission: add --mission FILE" if mission is None else "autopilot: name one after the vehicle"
        )
        raise SimulationError(
            f"export: an autopilot flies a mission; expected both or none, found no {lacking}"
        )
    checked_supply(voltage_v, flown)
    stem = identifier(flown.name if name is None else name, given=name is not None)
    supply = math.nan if voltage_v is None else float(voltage_v)
    pilot = plan = None
    substeps, step_s = 1, float(max_step_s)
    begin: dict[str, Any] = {"position": [0.0] * 3, "attitude": [0.0] * 3, "nu": [0.0] * 6}
    if autopilot is not None and mission is not None:
        pilot, plan = loaded(Autopilot, autopilot, "autopilot"), loaded(Mission, mission, "mission")
        checked_step(max_step_s, pilot)
        # Whole steps of the vehicle in a period of the autopilot; what rounding adds makes no step.
        substeps = max(
            1, math.ceil(pilot.period_s / max_step_s - max(pilot.period_s / max_step_s, 1.0) * 1e-9)
        )
        step_s = pilot.period_s / substeps
        route = Route.of(plan)
        begin |= {"position": route.start, "attitude": [0.0, 0.0, route.heading]}
    # The vehicle first: the other programs only need its names and its period.
    about = [f"{commented(flown.name)}: one step of {step_s:g} s.", *_origin()]
    program = _program(
        f"{stem}_vehicle",
        vehicle_c(flown, f"{stem}_vehicle", about, step_s, **begin, voltage_v=supply, rho=rho, g=g),
        step_s,
    )
    steering = None
    believed = flown if conditions.model is None else loaded(Vehicle, conditions.model, "model")
    if pilot is not None and plan is not None:
        about = [
            f"Autopilot of {commented(believed.name)} on the mission {commented(plan.name)}: one step of"
            f" {pilot.period_s:g} s.",
            *_origin(),
        ]
        prefix = f"{stem}_autopilot"
        facts = autopilot_c(
            pilot, believed, plan.core, prefix, about, feedback=conditions.feedback, voltage_v=supply
        )
        steering = _program(prefix, facts, pilot.period_s)
    # The filter takes the inputs that the autopilot's program has.
    seen = recorded_filter(
        f"{stem}_filter",
        believed,
        autopilot=None if steering is None else (steering.prefix, [row["name"] for row in steering.inputs]),
        period_s=None if pilot is None else pilot.period_s,
        mission=plan,
        navigation=conditions.navigation,
        sensors=conditions.sensors,
        voltage_v=supply,
    )
    knowing = None if seen is None else _program(f"{stem}_filter", *seen)
    return Programs(program, steering, fitted, substeps, knowing)


def written(folder: Path, texts: Mapping[str, str | bytes]) -> list[Path]:
    """Paths of files that were written into a folder, each whole or not at all.

    Raises `SimulationError`: one cannot be written.
    """
    paths = [folder / name for name in texts]
    with writing(folder, SimulationError, advice="choose another folder"), whole_folder(folder):
        for path, text in zip(paths, texts.values(), strict=True):
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(path, text if isinstance(text, bytes) else text.encode())
    return paths


def identifier(name: str, *, given: bool) -> str:
    """A name as an identifier of C; one that was given must be one.

    Raises `SimulationError`: it is none.

    Examples
    --------
    >>> identifier("BlueROV2 Heavy", given=False)
    'bluerov2_heavy'
    """
    if given and not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name):
        raise SimulationError(
            f'--name {name}: expected letters, digits and "_", a letter first, since it begins names in C'
        )
    plain = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
    return name if given else plain if plain[:1].isalpha() else f"v{plain}"


_WORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int
long register restrict return short signed sizeof static struct switch typedef union unsigned void
volatile while alignas alignof and and_eq asm atomic bitand bitor bool catch class co_await
co_return co_yield compl concept const_cast consteval constexpr constinit decltype delete
dynamic_cast explicit export false friend mutable namespace new noexcept not not_eq nullptr operator
or or_eq private protected public reinterpret_cast requires static_assert static_cast template this
thread_local throw true try typeid typename typeof using virtual wchar_t xor xor_eq linux unix i386
NAN INFINITY HUGE_VAL NULL EOF errno isnan isinf isfinite signbit fpclassify isnormal
"""
"""Keywords of C and C++, whose programs include the header, and macros of compilers and ``math.h``."""

_RESERVED = frozenset(_WORDS.split())


def refused_names(numbers: Sequence[Mapping[str, Any]]) -> str | None:
    """Why numbers of an interface cannot stand in one structure of C; None where they can.

    Letters that C does not know became underscores: two names may have become one.

    Examples
    --------
    >>> refused_names([{"name": "a_b", "known_as": known_as, "about": ""} for known_as in ("a-b", "a_b")])
    'the names "a-b" and "a_b" are both a_b in C'
    """
    taken: dict[str, str] = {}
    for number in numbers:
        name, known_as = str(number["name"]), str(number["known_as"])
        words = known_as + str(number["about"])
        if not words.isprintable() or "*/" in words or "/*" in words:
            return f'the name "{printable(known_as)}" has a sign that no comment of C may hold'
        if name in _RESERVED:
            return f'the name "{known_as}" is a word of C'
        if name in taken:
            return f'the names "{taken[name]}" and "{known_as}" are both {name} in C'
        taken[name] = known_as
    return None


def commented(name: str) -> str:
    """A name as a comment of C may hold it.

    Examples
    --------
    >>> commented("out */ int main")
    'out * / int main'
    """
    return re.sub(r"(?<=\*)(?=/)|(?<=/)(?=\*)", " ", printable(name))


def _program(prefix: str, facts: Mapping[str, Any], step_s: float) -> Program:
    program = Program(prefix=prefix, step_s=step_s, **facts)
    for numbers in (program.parameters, program.state, program.inputs, program.outputs):
        if (wrong := refused_names(numbers)) is not None:
            raise SimulationError(f"export: {wrong}: rename the actuator in the vehicle file")
    return program


def _folded(program: Program) -> Program:
    return replace(program, source=folded(program.source))


def _origin() -> Sequence[str]:
    """Where a file comes from, for its head."""
    return (
        f"Recorded by seatrial {version('seatrial')}: SI units and radians unless a comment says otherwise;",
        "north-east-down, body axes forward, starboard, down. Not with -ffast-math: infinite ages count.",
    )


def recorded_filter(
    prefix: str,
    model: Vehicle,
    *,
    autopilot: tuple[str, list[str]] | None,
    period_s: float | None,
    mission: Mission | None,
    navigation: str | NavigationFilter,
    sensors: Mapping[str, Sensor] | str | Path | None,
    voltage_v: float,
) -> tuple[dict[str, Any], float] | None:
    """Program of a navigation filter and its period, s; None where none is asked for.

    It believes in `model` unless it was made by hand. `autopilot` and `period_s` are prefix and inputs of the
    program of the autopilot that takes the estimate, and its period, s; its mission's landmarks and start are
    known. `navigation` and `sensors` are as of `export_c`; the supply is not a number where it does not
    matter. Raises SimulationError where the filter cannot be exported, or sensors are named for none.
    """
    asked = checked_navigation(navigation)
    if sensors is not None and asked != "filter":
        raise SimulationError(
            "sensors: they are those of a navigation filter; expected navigation"
            f' = "filter" beside them, found {navigation!r}'
        )
    if period_s is None:
        # Without autopilot, and not made by hand: the period that a `NavigationFilter` has by default, s.
        period_s = asked.period_s if isinstance(asked, NavigationFilter) else 0.1
    filter = filter_of(
        asked,
        model,
        sensors_of(sensors, model),
        period_s,
        landmarks=() if mission is None else mission.landmarks,
    )
    if filter is None:
        return None
    # A filter that was made by hand has its own start.
    start: dict[str, Any] = {}
    if mission is not None and not isinstance(asked, NavigationFilter):
        start["start"] = Route.of(mission).start
    about = [
        f"Navigation filter of {commented(filter.vehicle.name)}: one period of {period_s:g} s.",
        *_origin(),
    ]
    facts = filter_c(
        filter.core, prefix, about, period_s=period_s, autopilot=autopilot, voltage_v=voltage_v, **start
    )
    return facts, period_s
