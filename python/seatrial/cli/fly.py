"""`seatrial simulate`, `fly`, `realtime` and `sitl`: a vehicle in motion.

Under the commands of a file, on a mission, by the clock, and behind ArduPilot's simulator. Tests:
``tests/cli/test_cli_fly.py``, ``tests/cli/test_cli_sensors.py``, ``tests/base/test_bad_input.py``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seatrial.base.errors import SeatrialError, SimulationError, TrialError
from seatrial.base.files import check_place, file_name
from seatrial.cli.options import (
    STILL,
    Aboard,
    Json,
    Navigation,
    Out,
    Output,
    Printed,
    Sea,
    Sensors,
    Triple,
    Voltage,
    end,
    shared,
)

if TYPE_CHECKING:
    import polars as pl

    from seatrial.base.run import RunDirectory
    from seatrial.flight.conditions import Conditions
    from seatrial.flight.flight import Flight, Seeds
    from seatrial.realtime.ardupilot_link import SitlSession

Flies = Annotated[str, typer.Argument(help="Vehicle file or built-in vehicle that flies.")]

Steers = Annotated[str, typer.Argument(help="Autopilot file or built-in autopilot.")]

MissionFile = Annotated[str, typer.Argument(help="Mission file.")]


@dataclass(frozen=True)
class Circumstances(Aboard):
    """What is aboard, by what the autopilot goes, and what goes wrong on a flight."""

    navigation: Navigation = "sensors"
    fault: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ACTUATOR@TIME[=stuck|=VALUE]",
            help="An actuator is dead from a time in s on, or stuck there, or stuck at a value; repeatable.",
        ),
    ] = None
    outage: Annotated[
        list[str] | None,
        typer.Option(
            metavar="GROUP@FROM[-UNTIL]",
            help="No samples of position, depth, attitude, velocity, rates, altitude or water between two"
            " times in s; repeatable.",
        ),
    ] = None

    def of_flight(self) -> Conditions:
        """The conditions that were asked for."""
        from seatrial.flight.disturbances import Fault, Outage

        return self.conditions(
            faults=[Fault.parse(text) for text in self.fault or []],
            outages=[Outage.parse(text) for text in self.outage or []],
            navigation=self.navigation,
        )


@dataclass(frozen=True)
class Repeats:
    """Seeds of a flight: the same seed, the same flight."""

    seed: Annotated[
        int,
        typer.Option(
            min=0, help="Of sensors' errors and the water's motion; the same seed, the same flight."
        ),
    ] = 0
    seeds: Annotated[
        int | None,
        typer.Option(min=2, max=100_000, help="Number of seeds to fly, from --seed on; reports the spread."),
    ] = None


@shared
def fly(
    vehicle: Flies,
    autopilot: Steers,
    mission: MissionFile,
    sea: Sea = Sea(),
    circumstances: Circumstances = Circumstances(),
    repeats: Repeats = Repeats(),
    payload: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Water, plumes and the sensors that sample it: a payload file."),
    ] = None,
    output: Output = Output(),
) -> None:
    """Fly a mission in closed loop: vehicle, sensors, autopilot and current together.

    Example: seatrial fly cwolf cwolf box.toml --current 0 0.2 0 --sensors typical

    The exit code is 0 when the mission was complete and every waypoint reached, 1 when not, 2 for bad input.
    """
    from seatrial.base.run import RunDirectory
    from seatrial.cli.console import reported
    from seatrial.flight.flight import fly as flown
    from seatrial.flight.flight import fly_seeds

    sources = (vehicle, autopilot, mission)
    water = sea.water()
    conditions = circumstances.of_flight()
    folder = output.out or Path("runs") / _folder(vehicle, mission)
    # Held from before the flight on: a second flight into it is refused at once.
    with RunDirectory(folder, "flight") as directory:
        flight = flown(*sources, water=water, conditions=conditions, seed=repeats.seed, payload=payload)
        many = None
        if repeats.seeds is not None:
            many = fly_seeds(
                *sources, count=repeats.seeds, first=repeats.seed, water=water, conditions=conditions
            )
        _show_flight(flight, many, directory, folder, output)
    reported(output.page, [folder], quiet=output.json)
    end(held=flight.complete and (many is None or many.all_complete))


def _show_flight(
    flight: Flight, many: Seeds | None, directory: RunDirectory, folder: Path, output: Output
) -> None:
    """Show a flight, publish its run directory that is held, and draw its figures."""
    from seatrial.base.files import only_user
    from seatrial.report.results.flight import seeds_exceeded, seeds_section

    def saved() -> str:
        flight.publish(directory, beside={} if many is None else {"seeds.parquet": many.parquet()})
        sampled = "" if flight.samples is None else "samples.parquet, samples.csv, "
        return f"Results in {folder}: flight.json, flight.parquet, {sampled}summary.txt and the inputs"

    def figures() -> list[Path]:
        if not output.endings:
            return []
        with only_user(folder):  # another flight would replace the folder under the figures
            return sorted(output.draw(flight, folder / "figures"))

    report = flight.report(sections=() if many is None else (seeds_section(many),))
    if many is not None and many.excesses:
        report = replace(report, worst="; ".join((*seeds_exceeded(many), report.worst)))
    facts = {"run_directory": str(folder)} | ({} if many is None else {"seeds": many.to_dict()})
    output.show(flight, facts, report=report, results=saved, draw=figures)


def _folder(vehicle: str, mission: str) -> str:
    """Name of the run directory, no longer than file systems take."""
    from seatrial._core import Vehicle
    from seatrial.base.toml_file import loaded
    from seatrial.flight.mission import Mission

    return file_name(f"fly-{loaded(Vehicle, vehicle).name}-{loaded(Mission, mission).name}")


@dataclass(frozen=True)
class Clock:
    """How fast a flight goes by the clock, who looks on, and what steers."""

    seed: Annotated[int, typer.Option(min=0, help="Of the sensors' errors.")] = 0
    speed: Annotated[float, typer.Option(help="Seconds of motion per second of the clock.")] = 1.0
    live: Annotated[
        int | None,
        typer.Option(
            metavar="PORT",
            min=0,
            max=65535,
            help="WebSocket for Foxglove on this machine (8765 is Foxglove's own default).",
        ),
    ] = None
    record: Annotated[Path | None, typer.Option(metavar="FILE.mcap", help="Record what is shown.")] = None
    hardware: Annotated[
        str | None,
        typer.Option(metavar="HOST:PORT", help="UDP address of autopilot hardware that steers instead."),
    ] = None
    watchdog: Annotated[
        float, typer.Option(metavar="S", help="Silence of the hardware after which the actuators rest, s.")
    ] = 0.5

    @property
    def address(self) -> tuple[str, int] | None:
        """Host and port of the hardware."""
        if self.hardware is None:
            return None
        host, _, port = self.hardware.rpartition(":")
        if not host or not port.isdecimal() or not 0 < int(port) < 65536:
            raise SimulationError(
                f"--hardware {self.hardware}: expected HOST:PORT, for example 192.168.2.2:14660"
            )
        return host, int(port)


@shared
def realtime(
    vehicle: Flies,
    autopilot: Steers,
    mission: MissionFile,
    current: Annotated[Triple, typer.Option(metavar="NORTH EAST DOWN", help="Velocity, m/s.")] = STILL,
    aboard: Aboard = Aboard(),
    clock: Clock = Clock(),
    out: Out = None,
    printed: Printed = Printed(),
) -> None:
    """Fly a mission by the clock: paced, with measured jitter and overruns, for viewers and hardware.

    Example: seatrial realtime cwolf cwolf box.toml --live 8765

    The exit code is 0 when the mission was complete, 1 when not, 2 for bad input.
    """
    from seatrial.base.run import check_writable
    from seatrial.cli.console import note
    from seatrial.flight.conditions import Water
    from seatrial.realtime.flight import fly_realtime

    # A flight by the clock cannot be repeated: its place is refused before, not after it.
    if out is not None:
        check_writable(out, "flight")

    def ready(port: int | None) -> None:
        if port is not None and not printed.json:
            note(f"Foxglove: open connection ws://127.0.0.1:{port}")

    flight = fly_realtime(
        vehicle,
        autopilot,
        mission,
        water=Water(current=current),
        conditions=aboard.conditions(),
        seed=clock.seed,
        speed=clock.speed,
        live_port=clock.live,
        record=clock.record,
        hardware=clock.address,
        watchdog_s=clock.watchdog,
        ready=ready,
    )
    folder = out or Path("runs") / file_name(f"realtime-{flight.vehicle.name}")
    flight.save(folder)
    results = f"Results in {folder}: flight.json, flight.parquet, summary.txt and the inputs"
    printed.show(flight, {"run_directory": str(folder)}, results=results)
    end(interrupted=flight.outcome == "interrupted", held=flight.complete)


@dataclass(frozen=True)
class Link:
    """How ArduPilot's simulator reaches the vehicle."""

    parameters: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.param", help="Parameters of ArduSub: channels, ends and directions of the motors."
        ),
    ] = None
    channel: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ACTUATOR=NUMBER", help="Override the servo channel of an actuator; repeatable."
        ),
    ] = None
    host: Annotated[str, typer.Option(help="Address to listen on; only this machine by default.")] = (
        "127.0.0.1"
    )
    port: Annotated[int, typer.Option(min=0, max=65535, help="UDP port; ArduPilot sends to 9002.")] = 9002
    idle_s: Annotated[float, typer.Option(help="End after this silence, s.")] = 60.0
    frames: Annotated[int | None, typer.Option(min=1, help="End after so many frames.")] = None

    @property
    def channels(self) -> dict[str, int]:
        """Servo channels by actuator."""
        channels = {}
        for entry in self.channel or []:
            name, _, number = entry.partition("=")
            if not name or not number.isdecimal():
                raise SimulationError(f"--channel {entry}: expected ACTUATOR=NUMBER, for example rudder=5")
            channels[name] = int(number)
        return channels


@dataclass(frozen=True)
class Begin:
    """The water, the sensors and how the vehicle begins."""

    sensors: Sensors = None
    seed: Annotated[int, typer.Option(min=0, help="Of the sensors' errors.")] = 0
    current: Annotated[
        Triple, typer.Option(metavar="NORTH EAST DOWN", help="Velocity of the water, m/s.")
    ] = STILL
    depth: Annotated[float, typer.Option(metavar="M", help="Depth at which it begins, m.")] = 0.0
    heading: Annotated[float, typer.Option(metavar="DEG", help="Heading at which it begins, degrees.")] = 0.0
    voltage: Voltage = None
    seabed: Annotated[
        float | None, typer.Option(metavar="DEPTH", help="Depth of the bottom, m: adds a range finder.")
    ] = None


@shared
def sitl(
    vehicle: Annotated[str, typer.Argument(help="Vehicle file or built-in vehicle to simulate.")],
    link: Link = Link(),
    begin: Begin = Begin(),
    log: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the motion as a trial, .csv or .parquet.")
    ] = None,
    log_hz: Annotated[float, typer.Option(help="Rows of the log per second of motion.")] = 10.0,
    printed: Printed = Printed(),
) -> None:
    """Be the physics behind ArduPilot's simulator: servo packets in over UDP, the state of the vehicle out.

    Start ArduSub with --model JSON:127.0.0.1. The exit code is 0, 1 when the motion diverged, 2 for bad
    input.

    Example: seatrial sitl vehicle.toml
    """
    from seatrial._core import State
    from seatrial.cli.console import note
    from seatrial.realtime.ardupilot_link import sitl as serve

    # A session cannot be repeated either: the place of its log is refused before it.
    if log is not None:
        read = {"the vehicle": vehicle, "the parameters": link.parameters, "the sensors": begin.sensors}
        check_place(log, "--log", endings=(".csv", ".parquet"), inputs=read, folder_made=True)
        log.parent.mkdir(parents=True, exist_ok=True)

    def ready(address: tuple[str, int]) -> None:
        if not printed.json:
            note(f"{vehicle} listens on {address[0]}:{address[1]}; ends after {link.idle_s:g} s of silence")

    session = serve(
        vehicle,
        parameters=link.parameters,
        channels=link.channels,
        host=link.host,
        port=link.port,
        idle_s=link.idle_s,
        max_frames=link.frames,
        sensors=begin.sensors,
        seed=begin.seed,
        initial=State([0.0, 0.0, begin.depth], [0.0, 0.0, math.radians(begin.heading)]),
        current=begin.current,
        voltage_v=begin.voltage,
        seabed_m=begin.seabed,
        log_hz=0.0 if log is None else log_hz,
        ready=ready,
    )
    lost, written = _log_written(session, log)
    printed.show(session, results=written)
    if lost is not None:
        raise lost
    end(interrupted=session.ended == "interrupted", held=session.ended != "diverged")


def _log_written(session: SitlSession, log: Path | None) -> tuple[SeatrialError | None, str]:
    """Why the motion could not be written, and where it is: what the session was is told all the same."""
    from seatrial.base.files import write_table

    if log is None or not session.rows:
        return None, ""
    try:
        write_table(session.table(), log)
    except SeatrialError as error:
        return error, ""
    return None, f"Motion in {log}: {len(session.rows)} rows"


_ENDINGS = (".csv", ".parquet")

_SEES_BOTTOM = {"dvl", "dvl_water"}


@dataclass(frozen=True)
class Moving:
    """How the vehicle moves under its commands."""

    free: Annotated[str, typer.Option(help="Letters of the axes that move, of XYZKMN.")] = "XYZKMN"
    held: Annotated[bool, typer.Option("--held", help="Tie the vehicle, as in a bollard test.")] = False
    current: Annotated[
        Triple | None,
        typer.Option(
            metavar="NORTH EAST DOWN", help="Steady current, m/s, instead of one in the commands' file."
        ),
    ] = None


@dataclass(frozen=True)
class Logged:
    """What logs the motion, in which water."""

    sensors: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="Write what these sensors log instead of the run; or: typical."),
    ] = None
    seed: Annotated[
        int | None,
        typer.Option(min=0, help="Of the sensors' noise; the same seed, the same log. 1 by default."),
    ] = None
    bottom: Annotated[
        float | None, typer.Option(metavar="DEPTH", help="Depth of the bottom, m, for the Doppler log.")
    ] = None
    surface: Annotated[
        float | None,
        typer.Option(
            metavar="Z",
            help="Where the sea ends, m down: 0 where z_m is the depth. Without it all is under water.",
        ),
    ] = None
    run: Annotated[
        Path | None, typer.Option("--run", help="Beside the sensors' log, write the true run here.")
    ] = None


@shared
def simulate(
    vehicle: Annotated[
        str,
        typer.Argument(
            metavar="VEHICLE|RECIPE",
            help="Vehicle file or built-in vehicle; or the recipe of a generated trial.",
        ),
    ],
    commands: Annotated[
        Path | None,
        typer.Argument(
            help="CSV or Parquet with t_s and cmd.ACTUATOR; also voltage_v, tau.*, a start state. A recipe"
            " has its own."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="CSV or Parquet; beside the commands by default. A log is CSV."),
    ] = None,
    moving: Moving = Moving(),
    logged: Logged = Logged(),
    json: Json = False,
) -> None:
    """Simulate a vehicle under commands; it starts from the first recorded state, else at rest in O.

    Of a recipe alone: write the log of its sensors, and with --run what really happened.

    Example: seatrial simulate vehicle.toml steps.csv --out run.csv
    """
    from seatrial._core import Vehicle
    from seatrial.cli.console import answer, print_json
    from seatrial.sensors.log import ON_THE_TETHER, at_sea
    from seatrial.sensors.sensor import load_sensors
    from seatrial.trial.simulation import SimulatedTrial
    from seatrial.trial.trial import Trial

    if commands is None:
        _recipe(Path(vehicle), out, moving, logged, json=json)
        return
    loaded = Vehicle.load(vehicle)
    sensors, run = logged.sensors, logged.run
    target = out or commands.with_name(f"{commands.stem}-{'run' if sensors is None else 'log'}.csv")
    read: dict[str, str | Path | None] = {"the commands": commands, "the vehicle": vehicle}
    _check(moving, logged)
    _check_places(target, run, read | {"the sensors": sensors}, log=sensors is not None)
    fitted = None if sensors is None else load_sensors(sensors, loaded)
    if fitted is not None and not moving.held and not fitted.keys() <= set(ON_THE_TETHER):
        fitted = at_sea(fitted)  # sensors of the tether alone are refused: --held was forgotten
    if logged.bottom is not None and fitted is not None and not fitted.keys() & _SEES_BOTTOM:
        raise TrialError(f"--bottom is for a Doppler log; {sensors} has none")
    trial = Trial.read(commands, align=False, surface=logged.surface)
    made = SimulatedTrial(loaded, trial, moving.free, moving.held, moving.current, fitted)
    truth = made.frame()
    if fitted is None:
        _write(truth, target, "--out")
        results, after = f"Run in {target}", f"seatrial score {vehicle} {target}"
    else:
        seed = 1 if logged.seed is None else logged.seed
        if run is not None:
            _write(truth, run, "--run")
        label = f"{loaded.name} under {commands.name}, sensors {sensors}, seed {seed}"
        made.write_log(target, seed, logged.bottom, label)
        results, after = f"Log of {', '.join(fitted)} in {target}", "name this log as a trial in a campaign"
    if json:
        print_json(made.summary() | {"file": str(target)} | ({} if run is None else {"run": str(run)}))
        return
    results += "" if run is None else f"\nRun in {run}"
    answer(made.report(f"{loaded.name} under {commands.name}", after), results=results)


def _check(moving: Moving, logged: Logged) -> None:
    """Refuse axes, and options that do not go together."""
    from seatrial.cli.console import check_axes

    check_axes(moving.free, "--free")
    if moving.held and moving.free != "XYZKMN":
        raise TrialError("--held and --free: a tied vehicle moves along no axis; give one of them")
    for option, value in (("--seed", logged.seed), ("--bottom", logged.bottom), ("--run", logged.run)):
        if value is not None and logged.sensors is None:
            raise TrialError(f"{option} is for a log; give --sensors too")
    if logged.bottom is not None and not logged.bottom > 0.0:
        raise TrialError(f"--bottom: expected a depth in m below the surface, found {logged.bottom:g}")


def _recipe(path: Path, out: Path | None, moving: Moving, logged: Logged, *, json: bool) -> None:
    """Write the log of a recipe, and the truth where it is asked for."""
    from seatrial.base.report import Report
    from seatrial.cli.console import answer, print_json
    from seatrial.trial.generated import Recipe

    if path.suffix != ".toml":
        raise TrialError(
            f"{path}: expected a vehicle and a file of commands, or the recipe of a generated trial (TOML)"
            " alone; found a vehicle alone"
        )
    for options, names in ((moving, ("free", "held", "current")), (logged, ("sensors", "bottom", "surface"))):
        for name in names:
            if getattr(options, name) != getattr(type(options), name):
                raise TrialError(f"--{name}: a recipe says this itself; leave the option out")
    # Beside the recipe, unless another place is given; never over an input.
    target, run = out or path.with_name(f"{path.stem}-log.csv"), logged.run
    _check_places(target, run, {"the recipe": path}, log=True)
    recipe = Recipe.load(path)
    recipe = recipe if logged.seed is None else recipe.with_seed(logged.seed)
    recipe.save(target)
    if run is not None:
        _write(recipe.truth_table(), run, "--run")
    duration = float(recipe.t[-1] - recipe.t[0])
    ending = None if recipe.flight is None else recipe.flight.outcome_in_words
    if json:
        files = {"file": str(target)} | ({} if run is None else {"run": str(run)})
        print_json({"duration, s": duration, "seed": recipe.seed, "flight": ending} | files)
        return
    how = "under its commands" if ending is None else f"sailed by an autopilot, mission {ending}"
    report = Report(
        title=f"{recipe.truth.vehicle.name} by {path.name}, seed {recipe.seed}",
        outcome="simulated",
        good=f"{duration:.0f} s {how}; {', '.join(recipe.sensors)} log",
        worst="nothing stands out: the motion is finite",
        next_step="name this log as a trial in a campaign",
    )
    answer(report, results=f"Log in {target}" + ("" if run is None else f"\nTruth in {run}"))


def _write(frame: pl.DataFrame, path: Path, option: str) -> None:
    from seatrial.base.files import write_table

    write_table(frame, path, advice=f"choose another place with {option}")


def _check_places(target: Path, run: Path | None, inputs: dict[str, str | Path | None], *, log: bool) -> None:
    """Refuse a place that does not fit, an input, and one file over another."""
    from seatrial.base.files import check_place

    # The first lines of a log say that it was generated, which Parquet has no place for.
    check_place(target, "--out", endings=_ENDINGS[:1] if log else _ENDINGS, inputs=inputs)
    if run is not None:
        check_place(run, "--run", endings=_ENDINGS, inputs=inputs)
        if run.resolve() == target.resolve():
            raise TrialError(f"--run {run}: the log goes to this file; give another name")
