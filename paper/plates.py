"""Plates of the gallery: what each figure shows, which data it is from, and how it is drawn.

A plate is drawn when it is asked for, so that a gallery holds one figure in memory at a time. What cannot
be drawn stands there too, with the reason.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.channels import AXES
from seatrial.report.plot.performance import motors

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from seatrial._core import Vehicle
    from seatrial.bench_test.evaluate import BenchTest
    from seatrial.bench_test.file import Pull, Steps
    from seatrial.identification.identification import Identification
    from seatrial.problem.problem import Problem

_SUBJECTS = """
outline; model; actuators; static behaviour; rate limits; step response; surge test; stern propeller; vertical
thruster; directions of thrust; optimisation; stage; stage; stage; stage; control loop; line of sight; PID
controller; corridor; speed control"""

PAPER_FIGURES = dict(enumerate((" ".join(words.split()) for words in _SUBJECTS.split(";")), start=1))
"""Figures of Taubert et al. (2014) by their numbers: captions in short."""

_NOT_OF_A_VEHICLE = {7: "it shows the test stand, of which no file says anything"}


@dataclass(frozen=True)
class Plate:
    """A figure to be drawn: file name without number and ending, caption, and what draws it.

    ``draw`` is None where there is nothing to draw; the caption then says why. ``paper`` are the numbers of
    the paper's figures that it takes the place of.
    """

    name: str
    caption: str
    draw: Callable[[], Figure] | None
    paper: tuple[int, ...] = ()


def cited(numbers: Sequence[int]) -> str:
    """Figures of the paper by numbers and subjects.

    >>> cited((12, 13, 14, 15))
    'figures 12 to 15 (stage)'
    >>> cited((16, 18))
    'figures 16 and 18 (control loop, PID controller)'
    """
    subjects = ", ".join(dict.fromkeys(PAPER_FIGURES[number] for number in numbers))
    if len(numbers) == 1:
        return f"figure {numbers[0]} ({subjects})"
    between = "to" if len(numbers) > 2 else "and"
    return f"figures {numbers[0]} {between} {numbers[-1]} ({subjects})"


def not_drawn(plates: Sequence[Plate]) -> list[str]:
    """Sentences on the figures of the paper that none of these plates takes the place of."""
    covered = {number for plate in plates for number in plate.paper}
    return [
        f"{cited((number,))} of the paper: {_NOT_OF_A_VEHICLE.get(number, 'nothing at hand to draw it from')}"
        for number in PAPER_FIGURES
        if number not in covered
    ]


def vehicle_plates(vehicle: Vehicle, *, data: str, modes: str = "") -> Iterator[Plate]:
    """Plates of a vehicle: views, block diagrams, motors.

    Parameters
    ----------
    vehicle : Vehicle
    data : str
        Words on where the vehicle's numbers are from, at the end of a caption.
    modes : str
        Which axes are free, where a campaign says so.
    """
    from paper.actuators import actuator_diagram, drives, rate_limiting, static_transfer
    from paper.model import model_diagram
    from seatrial.report.plot.vehicle import three_views

    yield Plate(
        "vehicle",
        f"Outline of {vehicle.name}: hull, centres of gravity and buoyancy, actuators and the direction of"
        f" their positive thrust. {data}",
        partial(three_views, vehicle),
        paper=(1, 10),
    )
    words = {"modes": modes} if modes else {}
    yield Plate(
        "model",
        f"Block diagram of the model of {vehicle.name}: terms of the equation of motion with their signs, the"
        f" coefficients that the vehicle has, and the kinematics. {data}",
        partial(model_diagram, vehicle, **words),
        paper=(2,),
    )
    if not vehicle.actuators:
        why = f"{vehicle.name} has no actuators, so none of their figures is drawn"
        yield Plate("actuators", why, None, paper=(3, 4, 5))
        return
    groups = ", ".join(dict.fromkeys(motor.group for motor in motors(vehicle)))
    yield Plate(
        "actuators",
        f"Block diagram of the actuators of {vehicle.name}, from the desired command to the wrench, per"
        f" group of like actuators ({groups}). {data}",
        partial(actuator_diagram, vehicle),
        paper=(3,),
    )
    if any(motor.limited for _, motor in drives(vehicle)):
        yield Plate(
            "static_transfer",
            f"Static transfer of the motor controllers of {vehicle.name}: actual over desired signal with"
            " their limits; the inset shows the neighbourhood of zero. Settled response of the model."
            f" {data}",
            partial(static_transfer, vehicle),
            paper=(4,),
        )
    else:
        yield Plate("static_transfer", f"no motor of {vehicle.name} has a static limit", None, paper=(4,))
    if any(motor.delayed for _, motor in drives(vehicle)):
        yield Plate(
            "rate_limiting",
            f"Dynamic limiting of increase and decrease at {vehicle.name}: steps ahead, astern and to"
            f" rest, behind the rate limit, and behind dead time and lag. Response of the model. {data}",
            partial(rate_limiting, vehicle),
            paper=(5,),
        )
    else:
        why = f"every motor of {vehicle.name} follows its command at once"
        yield Plate("rate_limiting", why, None, paper=(5,))


def thrust_plates(vehicle: Vehicle, *, data: str) -> Iterator[Plate]:
    """Plates of what the thrust does: characteristics, and the performance where something drives ahead."""
    from seatrial.report.plot.performance import characteristic, performance

    if any(facts["kind"] == "thruster" for facts in vehicle.actuator_info().values()):
        yield Plate(
            "characteristic",
            f"Characteristics of the actuators of {vehicle.name}: thrust over command, at rest and under"
            f" way or at several supply voltages. {data}",
            partial(characteristic, vehicle),
        )
    figure = performance(vehicle) if vehicle.actuators else None
    if figure is None:
        yield Plate("performance", f"nothing drives {vehicle.name} ahead, so no speeds are drawn", None)
    else:
        yield Plate(
            "performance",
            f"Performance of {vehicle.name}: steady speed, power, range and endurance over the command of all"
            " that drive ahead, and turns from a straight run into steady circles, with radius and rate."
            f" Response of the model. {data}",
            lambda: figure,
        )


def bench_plates(bench: BenchTest | None) -> Iterator[Plate]:
    """Plates of a bench test: step responses of the motors, characteristics with their regression."""
    if bench is None or not bench.motors:
        yield Plate("motor_step", f"no recorded motor step: {_wanted(bench, 'steps')}", None, paper=(6,))
    else:
        from seatrial.report.plot.bench import motor_step

        for unit, motor in bench.motors.items():
            record = bench.step_records[unit][0]
            yield Plate(
                f"motor_step_{unit}",
                f"Modelled and measured step response of {unit}: command, measurement, model and residual"
                f" of record {record.name}, and single steps with the dead time and the time constant."
                f" {_tested(bench, bench.file.steps)}",
                partial(motor_step, motor, record),
                paper=(6,),
            )
    if bench is None or not bench.pulls:
        yield Plate("bollard_test", f"no bollard test: {_wanted(bench, 'pulls')}", None, paper=(8, 9))
    else:
        from seatrial.report.plot.bench import bollard_test

        for unit in bench.pulls:
            yield Plate(
                f"bollard_test_{unit}",
                f"Characteristic of {unit} by regression: operating points of a single actuator and fitted"
                " curve ahead and astern; below, the residuals with the 95 % bands of the curve and of single"
                f" points. {_tested(bench, bench.file.pulls)}",
                partial(bollard_test, bench, groups=[unit]),
                paper=(9,) if _vertical(bench, unit) else (8,),
            )


def _vertical(bench: BenchTest, unit: str) -> bool:
    """Whether a group of actuators, or a single one, pushes more along z than along x."""
    vehicle = bench.before
    places = [
        vehicle.actuators.index(name)
        for name, facts in vehicle.actuator_info().items()
        if unit in (name, facts["group"])
    ]
    thrust = np.abs(np.asarray(vehicle.allocation_matrix())[:, places]).sum(axis=1)
    return bool(thrust[2] > thrust[0])


def campaign_plates(fit: Identification) -> Iterator[Plate]:
    """Plates of an identification: schema, stages, convergence, uncertainty, held-out trials."""
    from paper.model import optimisation_diagram
    from paper.stage import stage_result
    from seatrial.report.plot.identification import convergence, intervals, residual_figure, trial_figure

    problem = fit.problem
    yield Plate(
        "optimisation",
        "Schema of the parameter optimisation: recorded inputs drive vehicle and model, the criterion Q"
        " judges the error, the searches move the coefficients within their bounds; below, the stages of"
        f" the campaign {problem.name} in the order of their run, with Q at their start and at their"
        " optimum.",
        partial(optimisation_diagram, problem, results=fit.stages),
        paper=(11,),
    )
    for result in fit.stages:
        stage = next(one for one in problem.stages if one.name == result.name)
        polish = (
            ", at the joint estimate" if fit.assessment is not None and fit.assessment.polished.rounds else ""
        )
        yield Plate(
            f"stage_{_safe(result.name)}",
            f"Optimisation of {result.name}: measured and modelled channels at the start values, at the"
            f" optimum of the stage{polish}, restarted every {stage.segment_s:g} s from the smoothed"
            " measurement, and their errors; commands, where any moves; coefficients within their bounds."
            f" {_data(problem, stage.trials)}",
            partial(stage_result, fit, result),
            paper=(12, 13, 14, 15),
        )
    if fit.stages:
        yield Plate(
            "convergence",
            "Convergence of the searches, stage by stage: the best criterion, in standard deviations on a"
            " logarithmic scale, over the candidates tried; a line per phase, the start as a cross, the"
            " optimum as a disc.",
            partial(convergence, fit.stages),
        )
    if (sure := fit.assessment) is not None:
        yield Plate(
            "intervals",
            "How sure the coefficients are: standard deviations in per cent of the estimate, and"
            " correlations of the joint estimate.",
            partial(intervals, sure),
        )
        yield Plate(
            "residual_analysis",
            "What the residuals say against the model: their autocorrelation, and what would explain it.",
            partial(residual_figure, sure.residual_analysis),
        )
    for trial in problem.trials:
        if problem.uses[trial].hold_out:
            yield Plate(
                f"held_out_{_safe(trial)}",
                f"Prediction of trial {trial}, which no stage has seen: measured and simulated ten seconds"
                f" ahead, with residuals. {_data(problem, (trial,))}",
                partial(trial_figure, fit, trial),
            )


def no_campaign(vehicle: Vehicle) -> Plate:
    """What a vehicle without a campaign has no figures of."""
    why = f"no stages: nothing says which trials identify {vehicle.name}; give a campaign file"
    return Plate("optimisation", why, None, paper=(11, 12, 13, 14, 15))


def modes_of(problem: Problem) -> str:
    """Which axes the stages of a campaign free, in words for the diagram of the model."""
    free = ", ".join(dict.fromkeys(stage.axes.free for stage in problem.stages))
    rest = {
        mode
        for stage in problem.stages
        for mode in ("measured", "frozen")
        if (
            set(stage.axes.measured)
            if mode == "measured"
            else set(AXES) - set(stage.axes.free + stage.axes.measured)
        )
    }
    others = f"; the rest {' or '.join(sorted(rest))}" if rest else ""
    return f"free {free}{others}"


def is_generated(problem: Problem, trial: str) -> bool:
    """Whether a trial is sailed by a simulated vehicle: its file is a recipe, not a recording."""
    file = problem.files[trial]
    return file is not None and file.suffix == ".toml"


def _data(problem: Problem, trials: tuple[str, ...]) -> str:
    """Which trials a figure is from, and that they are generated where they are."""
    made = [trial for trial in trials if is_generated(problem, trial)]
    real = [trial for trial in trials if trial not in made]
    parts = [f"generated (recipe) {', '.join(made)}"] if made else []
    parts += [f"recorded {', '.join(real)}"] if real else []
    return f"Data: {'; '.join(parts)}."


def _tested(bench: BenchTest, records: Sequence[Pull | Steps]) -> str:
    """Which bench test a figure is from, and that its records are generated where they are."""
    readers = [(one.reader or bench.file.reader, one.file) for one in records]
    made = [file for reader, file in readers if _is_recipe(reader, Path(file))]
    kind = "generated (recipe) " if made and len(made) == len(readers) else ""
    some = f" (generated: {', '.join(made)})" if made and not kind else ""
    return f"Data: {kind}bench test {bench.file.name}{some}."


def _is_recipe(reader: str | None, path: Path) -> bool:
    return reader == "generated" or (reader is None and path.suffix == ".toml")


def _wanted(bench: BenchTest | None, key: str) -> str:
    """What would give a bench figure."""
    if bench is None:
        return f"give a bench file with [[{key}]]"
    return f"the bench test {bench.file.name} has no [[{key}]] with a result"


def _safe(name: str) -> str:
    return "".join(letter if letter.isalnum() else "_" for letter in name).strip("_")
