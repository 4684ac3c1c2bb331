"""The vehicle file that an import drafts: a vehicle that is given, a frame told by the log, or a stub.

ArduSub's motors turn as MOT_n_DIRECTION says; where a log does not carry its parameters, the commands tell:
a mixer moves the vehicle with what its frame can do and never along a combination of thrusters whose forces
cancel. Among all signs the right ones leave these combinations at rest; which of the two senses of each
group is right the motion tells. Frames and motor numbers: ArduPilot, AP_Motors6DOF.

Motion tells only the ratio of a fin's moment to the inertia that it turns. Where a given vehicle file has no
inertia, that of the solid cylinder stands in for it and is too large by a quarter to a half: the draft takes
that of a hull as full as its buoyancy says. Held by
``tests/intake/test_vehicle_draft.py``.
"""

from __future__ import annotations

import itertools
import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, CHANNELS
from seatrial.base.errors import TrialError
from seatrial.base.files import file_name
from seatrial.base.toml_file import VEHICLE, is_path, loaded, text_of
from seatrial.inspect.manoeuvres import drives
from seatrial.intake.campaign_draft import draft
from seatrial.intake.survey import SurveyedLog
from seatrial.trial.columns import FRAME_NAMES
from seatrial.vehicle.actuators import actuator_groups

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.trial.trial import Trial

_BUILT_IN = {2: "bluerov2-heavy"}


@dataclass(frozen=True)
class VehicleDraftSettings:
    """What tells a built-in vehicle, completes a given one, and shows that thrusters are reversed."""

    heavy_motors: int = 8  #: of a BlueROV2 Heavy
    #: prismatic coefficients that the shapes of `hull_inertia` describe; above, a cylinder
    prismatic_range: tuple[float, float] = 0.5, 0.97
    idle_share: float = 0.15  #: of the sum of squares: what idle thrusters may still give in these signs
    #: by which the motion of an axis answers the other way round than its force pushes
    opposed_deviations: float = 0.3


SETTINGS = VehicleDraftSettings()


@dataclass(frozen=True)
class VehicleDraft:
    """Text of a vehicle file, the vehicle where it is complete, and where it comes from."""

    text: str  #: TOML.
    vehicle: Vehicle | None  #: None for a stub that the user must fill in.
    source: str  #: Words: "built-in bluerov2-heavy, by FRAME_CONFIG = 2", "the file x.toml", "a stub".
    built_in: bool = False  #: Whether it is a built-in vehicle.
    certain: bool = True  #: Whether the log or the user says so.


def draft_vehicle(
    logs: Sequence[SurveyedLog], actuators: Mapping[str, str], given: str | Path | None
) -> VehicleDraft:
    """Vehicle file for logs with commands of these actuators, with each command's unit, "" where unknown.

    `given` is a vehicle file or the name of a built-in vehicle; None to draft one. Raises VehicleError where
    that cannot be used, TrialError where a log names a frame by what is no number of one.
    """
    from seatrial._core import Vehicle

    if given is not None:
        vehicle = loaded(Vehicle, given)
        if is_path(str(given)):
            text = text_of(given, VEHICLE)
            filled, share = _with_inertia(text, vehicle)
            if filled == text:
                return VehicleDraft(text, vehicle, f"the file {given}")
            note = f"I_y and I_z of a hull that fills {100 * share:.0f} % of its cylinder, for it gives none"
            return VehicleDraft(filled, Vehicle.from_toml(filled), f"the file {given} ({note})")
        return VehicleDraft(vehicle.to_toml(), vehicle, f"the built-in vehicle {given}", built_in=True)
    frame = next((log.parameters["FRAME_CONFIG"] for log in logs if "FRAME_CONFIG" in log.parameters), None)
    motors = [name for name in actuators if re.fullmatch(r"thruster_\d+", name)]
    if frame is not None and not (np.isfinite(frame) and frame == int(frame)):
        file = next(log.path for log in logs if "FRAME_CONFIG" in log.parameters)
        raise TrialError(
            f"{file}: parameter FRAME_CONFIG: expected the whole number of a frame, found {frame:g}; the log"
            " is damaged there: fetch it again, or give the vehicle with --vehicle FILE"
        )
    if frame is not None and int(frame) in _BUILT_IN:
        name = _BUILT_IN[int(frame)]
        vehicle = Vehicle.load(name)
        note = f"the built-in vehicle {name}: FRAME_CONFIG is {frame:g}, {FRAME_NAMES[int(frame)]}"
        return VehicleDraft(vehicle.to_toml(), vehicle, note, built_in=True)
    ardupilot = any(log.format in ("dataflash", "mavlink") for log in logs)
    if frame is None and ardupilot and len(motors) == SETTINGS.heavy_motors:
        name = _BUILT_IN[2]
        vehicle = Vehicle.load(name)
        note = (
            f"the built-in vehicle {name}, by its eight motor channels: the log has no FRAME_CONFIG; check"
            f" that the frame is {FRAME_NAMES[2]}"
        )
        return VehicleDraft(vehicle.to_toml(), vehicle, note, built_in=True, certain=False)
    known = None if frame is None else dict(enumerate((*FRAME_NAMES, "CUSTOM"))).get(int(frame), "unknown")
    number = "" if frame is None else f" for FRAME_CONFIG {frame:g}, {known}"
    return VehicleDraft(
        _stub(logs, actuators), None, f"a stub{number}: measures are to be filled in", certain=False
    )


def hull_inertia(mass: float, length: float, radius: float, fullness: float) -> float:
    """Moment of inertia about the transverse axis through the middle, kg m2, of a homogeneous hull.

    A body of revolution with r(x)^2 = r^2 (1 - |2 x / l|^n), kg and m, that displaces the part `fullness`
    C_p = n / (n + 1) of its cylinder (prismatic coefficient) has
    ``m (l^2 / (12 (3 - 2 C_p)) + r^2 C_p / (2 (1 + C_p)))``: two thirds make a spheroid, one the
    solid cylinder.

    Examples
    --------
    REMUS 100: Prestero (2001) states 3.45, the solid cylinder has 4.56.

    >>> volume = 299.0 / 9.81 / 1030.0
    >>> fullness = volume / (3.14159 * 0.0955**2 * 1.33)
    >>> f"{fullness:.2f} {hull_inertia(30.48, 1.33, 0.0955, fullness):.2f}"
    '0.78 3.17'
    """
    along = length**2 / (12.0 * (3.0 - 2.0 * fullness))
    return mass * (along + radius**2 * fullness / (2.0 * (1.0 + fullness)))


def _with_inertia(text: str, vehicle: Vehicle) -> tuple[str, float]:
    """Text of a given vehicle file with `I_y` and `I_z` where it has none, and the fullness of its hull."""
    given = tomllib.loads(text)
    hull, listed = given.get("geometry", {}), given.get("coefficients", {})
    if hull.get("shape", "spheroid") != "spheroid" or {"I_y", "I_z"} & listed.keys():
        return text, 1.0
    if not {"length_m", "diameter_m"} <= hull.keys():
        return text, 1.0
    known, water = vehicle.coefficients(), vehicle.environment()
    length, radius = float(hull["length_m"]), 0.5 * float(hull["diameter_m"])
    fullness = known["B"] / (water["rho"] * water["g"]) / (math.pi * radius**2 * length)
    if not SETTINGS.prismatic_range[0] <= fullness <= SETTINGS.prismatic_range[1]:
        return text, 1.0
    inertia = hull_inertia(known["m"], length, radius, fullness)
    numbers = {
        "percent": f"{100 * fullness:.0f}",
        "solid": f"{known['I_y']:.3g}",
        "inertia": f"{inertia:.3g}",
    }
    lines = "\n".join(draft("vehicle", "inertia", **numbers)) + "\n"
    return re.sub(r"(?m)^(\[coefficients\][^\n]*\n)", lambda table: table[1] + lines, text, count=1), fullness


def _stub(logs: Sequence[SurveyedLog], actuators: Mapping[str, str]) -> str:
    """Vehicle file with the channels of the log and FILL IN for what only the user can measure."""
    name = file_name(logs[0].path.name.partition(".")[0])
    fins = [actuator for actuator, unit in actuators.items() if unit in ("deg", "rad", "mrad")]
    thrusters = {actuator: unit for actuator, unit in actuators.items() if actuator not in fins}
    lines = draft("vehicle", "stub", name=name)
    kinds = {actuator: "us" if unit == "us" else "rpm" for actuator, unit in thrusters.items()}
    for kind in ("us", "rpm"):
        lines += draft("vehicle", f"motor_{kind}") if kind in kinds.values() else []
    lines += draft("vehicle", "servo") if fins else []
    for actuator, kind in kinds.items():
        lines += draft("vehicle", f"thruster_{kind}", name=actuator)
    for actuator in fins:
        lines += draft("vehicle", "fin", name=actuator)
    return "\n".join(lines) + "\n"


def matched(names: Sequence[str], vehicle: Vehicle) -> dict[str, str]:
    """Name of the command by actuator of the vehicle: of the same name, of its group, or of the same number.

    A fin takes the only command with another usual word for it: stern planes an elevator, say.

    Examples
    --------
    >>> import seatrial as st
    >>> matched(["positive_width_us_0", "pwm_1"], st.Vehicle.load("beluga"))["thruster_1"]
    'pwm_1'
    """
    groups = {actuator: group for group, members in actuator_groups(vehicle).items() for actuator in members}
    numbers = {name: digits[0] for name in names if (digits := re.findall(r"\d+$", name))}
    single = {number: name for name, number in numbers.items() if list(numbers.values()).count(number) == 1}
    result = {}
    for actuator in vehicle.actuators:
        number = re.findall(r"\d+$", actuator)
        if actuator in names:
            result[actuator] = actuator
        elif groups.get(actuator) in names:
            result[actuator] = groups[actuator]
        elif number and number[0] in single:
            result[actuator] = single[number[0]]
        elif alike := _same_fin(f"{actuator} {groups.get(actuator, '')}", names):
            result[actuator] = alike
    return result


_FINS = (
    (re.compile(r"rudder"), re.compile(r"rudders?|delta_?r")),
    (re.compile(r"stern.?plane|elevator"), re.compile(r"(stern[ _]?)?planes?|elevators?|delta_?[es]")),
)
"""How vehicle files name fins, and what logs call their command."""


def _same_fin(actuator: str, names: Sequence[str]) -> str:
    """The only command that is called by a usual word for a fin; empty without one, or with several."""
    for own, usual in _FINS:
        alike = [name for name in names if usual.fullmatch(name.lower())]
        if own.search(actuator.lower()) and len(alike) == 1:
            return alike[0]
    return ""


def thruster_signs(vehicle: Vehicle, trial: Trial, parameters: Mapping[str, float]) -> dict[str, bool]:
    """Which thrusters push against the vehicle file's direction, by name; empty where nothing tells.

    `parameters` of ArduSub decide where they have MOT_n_DIRECTION (the built-in frame's directions are those
    of MOT_n_DIRECTION = -1); otherwise the commands and the motion of the trial do.
    """
    names = [name for name in vehicle.actuators if name in trial.commands]
    directions = {name: parameters.get(f"MOT_{re.sub(r'.*_', '', name)}_DIRECTION") for name in names}
    if names and all(value is not None for value in directions.values()):
        return {name: value is not None and value > 0.0 for name, value in directions.items()}
    if len(names) < len(vehicle.actuators) or len(names) > 12:
        return {}
    info = vehicle.actuator_info()
    commands = np.array([trial.commands[name] - info[name]["neutral"] for name in names])
    signs = _signs_of_mixer(vehicle.allocation_matrix(), commands)
    if signs is None:
        return {}
    for group in _apart(vehicle.allocation_matrix()):
        if _against(vehicle, trial, signs, commands, group):
            signs[group] *= -1.0
    return {name: bool(sign < 0.0) for name, sign in zip(names, signs, strict=True)}


def _signs_of_mixer(allocation: Array, commands: Array) -> Array | None:
    """Signs (n,) that leave combinations without effect at rest; None where they are not clear."""
    _, values, directions = np.linalg.svd(allocation)
    rank = int((values > 1e-9 * values[0]).sum())
    idle = directions[rank:]
    if not len(idle):
        return None
    # By RMS of the changes: a constant lies in an offset of the neutral pulse.
    moments = np.cov(commands)
    total = float(np.trace(moments))
    if total <= 0.0:
        return None
    best = []
    for tail in itertools.product((1.0, -1.0), repeat=len(commands) - 1):
        signs = np.array([1.0, *tail])
        signed = moments * np.outer(signs, signs)
        best.append((float(np.trace(idle @ signed @ idle.T)) / total, tail))
    best.sort()
    return np.array([1.0, *best[0][1]]) if best[0][0] < SETTINGS.idle_share else None


def _apart(allocation: Array) -> list[list[int]]:
    """Thrusters that drive different forces, as horizontal and vertical ones do, by number."""
    main = [int(np.argmax(np.abs(column[:3]))) == 2 for column in allocation.T]
    groups = [[k for k, vertical in enumerate(main) if vertical is kind] for kind in (False, True)]
    return [group for group in groups if group]


def _against(vehicle: Vehicle, trial: Trial, signs: Array, commands: Array, group: list[int]) -> bool:
    """Whether the motion runs against the forces of a group of thrusters."""
    chosen = np.zeros(len(signs))
    chosen[group] = signs[group]
    tau = vehicle.allocation_matrix() @ (chosen[:, None] * commands)
    return sum(_answers(trial, dict(zip(AXES, tau, strict=True))).values()) < 0.0


def opposed(vehicle: Vehicle, trial: Trial) -> str:
    """Letters of the axes whose motion clearly runs against the forces of the recorded commands."""
    forces = {drive.axis: drive.y for drive in drives(trial, vehicle) if drive.axis}
    return "".join(
        axis for axis, answer in _answers(trial, forces).items() if answer < -SETTINGS.opposed_deviations
    )


def _answers(trial: Trial, forces: Mapping[str, Array]) -> dict[str, float]:
    """How the motion of an axis answers its force (n,), in deviations of what the regression leaves of it."""
    from scipy.ndimage import gaussian_filter1d

    width = max(1.0, 0.15 / trial.dt)
    answers = {}
    for letter, along in forces.items():
        axis = AXES.index(letter)
        if CHANNELS[axis] not in trial.channels or along.std() == 0.0:
            continue
        good = trial.valid[:, axis]
        y = gaussian_filter1d(trial.nu[:, axis], width)
        change = np.gradient(y, trial.dt)
        force = gaussian_filter1d(along - along.mean(), width)
        design = np.column_stack([y, np.abs(y) * y, np.ones(len(y)), force])[good]
        if len(design) < 50:
            continue
        fit, *_ = np.linalg.lstsq(design, change[good], rcond=None)
        left = change[good] - design @ fit
        answers[letter] = float(fit[3]) * float(force[good].std()) / max(float(left.std()), 1e-12)
    return answers


def turned(text: str, reversed_: Mapping[str, bool]) -> str:
    """Text of a vehicle file with the key `reversed` of these thrusters set."""
    parts = re.split(r"(?m)^(?=\[\[thrusters\]\])", text)
    for k, part in enumerate(parts[1:], start=1):
        name = re.search(r'(?m)^name = "([^"]+)"', part)
        if name and name[1] in reversed_:
            value = str(reversed_[name[1]]).lower()
            if re.search(r"(?m)^reversed = \w+", part):
                parts[k] = re.sub(r"(?m)^reversed = \w+", f"reversed = {value}", part, count=1)
            else:
                parts[k] = part.replace(name[0], f"{name[0]}\nreversed = {value}", 1)
    return "".join(parts)
