"""
The compiled core of seatrial.
"""

from _typeshed import SupportsGetItem
from collections.abc import Mapping
from numpy import float64
from numpy.typing import ArrayLike, NDArray
from os import PathLike
from seatrial._core import Mission as Mission2
from seatrial.flight.mission import Mission as Mission3
from typing import Any, SupportsFloat, SupportsIndex, final

__all__ = ["Autopilot", "Filter", "Flights", "Helm", "LinearModel", "Mission", "OpenLoop", "Record", "Run", "State", "Vehicle", "_restored_autopilot", "_restored_flights", "_restored_mission", "_restored_run", "_restored_state", "_restored_vehicle", "ardusub_defaults", "ardusub_fly", "ardusub_forward_lateral", "ardusub_frames", "ardusub_pulses", "ardusub_rates", "ardusub_square_root", "ardusub_terms", "ardusub_velocity", "autopilot_c", "autopilot_names", "checked_threads", "error_edges", "file_kind", "file_text", "filter_c", "fly", "initial_names", "motor_response", "nuisance_names", "simd_level", "simulate_batch", "vehicle_c", "wrong_kind"]

@final
class Autopilot:
    """
    An autopilot: guidance, gains, modes, allocation and safety. Immutable.
    """
    def __copy__(self, /) -> Autopilot:
        """
        Itself: nothing of it can change.
        """
    def __deepcopy__(self, /, memo: Any) -> Autopilot:
        """
        Itself: nothing of it can change.
        """
    def __reduce__(self, /) -> tuple[Any, tuple[str]]: ...
    def __repr__(self, /) -> str: ...
    @property
    def control(self, /) -> str:
        """
        The control law: "pid" or "lqr".
        """
    @property
    def description(self, /) -> str:
        """
        What the autopilot is for, in a sentence.
        """
    def engage(self, /, vehicle: Vehicle, mission: Mission2 | Mission3) -> Helm:
        """
        The autopilot at work on a vehicle, which is its model, and a mission: one step at a time.
        """
    def feed_forward(self, /) -> dict[str, bool]:
        """
        Which parts of the model are used ahead of any error: restoring, drag, acceleration.
        """
    @staticmethod
    def from_toml(text: str, source: str = "<text>") -> Autopilot:
        """
        The autopilot of the TOML text of an autopilot file; `source` stands in messages.
        """
    def gains(self, /) -> dict[str, float]:
        """
        The numbers that a batch may vary by name: heading.K_P.1 … (supporting points from 1; K_I per s, K_D times
        s), heading.reference_rad_s, guidance.lookahead_m …
        """
    def guidance(self, /) -> dict[str, Any]:
        """
        The table of guidance: method, and numbers whose names carry their units.
        """
    @staticmethod
    def load(name_or_path: str | PathLike[str]) -> Autopilot:
        """
        The autopilot of a built-in name or a file.

        Raises VehicleError (a ValueError) that names file, key, what was expected and what was found.
        """
    def loops(self, /) -> dict[str, Any]:
        """
        Per loop, in the order surge sway heave roll pitch heading: K_P, K_I_per_s and K_D_s (one number, or six: one per
        supporting point), tau_max in N or N m, anti_windup, and reference_rad_s where it has a reference filter.
        """
    @property
    def modes(self, /) -> list[dict[str, Any]]:
        """
        The mode table: per mode name, loops (six flags in the order X Y Z K M N), loop_names, depth_by, from_speed_m_s,
        hysteresis_m_s, and actuators: names of actuators or groups at work, None for all.
        """
    @property
    def name(self, /) -> str:
        """
        Name of the autopilot.
        """
    @staticmethod
    def names() -> list[str]:
        """
        Names of the built-in autopilots, those of the built-in vehicles.
        """
    @property
    def period_s(self, /) -> float:
        """
        Control period, s.
        """
    def renamed(self, /, name: str, description: str) -> Autopilot:
        """
        The same autopilot under another name and description.
        """
    def safety(self, /) -> dict[str, Any]:
        """
        What is watched and what follows: per watch a reaction, or a table with its reaction and its limits.
        """
    @property
    def speeds_m_s(self, /) -> list[float]:
        """
        Desired speeds of the six supporting points, m/s.
        """
    def to_dict(self, /) -> dict[str, Any]:
        """
        The same as plain data: the tables of the file by name, keys with their units, defaults filled in.
        """
    def to_toml(self, /) -> str:
        """
        The autopilot file, TOML.
        """
    def with_gains(self, /, gains: Mapping[str, ArrayLike]) -> Autopilot:
        """
        The same autopilot with other values of some gains.

        Raises VehicleError for an unknown name or an impossible value.
        """

@final
class Filter:
    """
    The navigation filter of a vehicle at work: a measurement in, an estimate out, once per period.
    """
    def __new__(cls, /, vehicle: Vehicle, *, period_s: SupportsFloat | SupportsIndex, instruments: Mapping[str, ArrayLike], landmarks: SupportsGetItem[int, tuple[str, str, SupportsGetItem[int, SupportsFloat | SupportsIndex]]] = ..., bottom: ArrayLike | None = None, force: ArrayLike | None = None, force_time_s: SupportsFloat | SupportsIndex | None = None, acceleration: ArrayLike | None = None, current: ArrayLike | None = None, current_time_s: SupportsFloat | SupportsIndex | None = None, gusts: ArrayLike | None = None, gyro_walk: SupportsFloat | SupportsIndex, gate: tuple[SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex], start: ArrayLike, longest_age_s: SupportsFloat | SupportsIndex = 0.0, waves: ArrayLike | None = None, exact_model: bool = False) -> Filter:
        """
        The filter of a vehicle before its first sample.

        instruments: per kind (position, gps, usbl, depth, attitude, dvl, gyro, dvl_water, altitude, range, bearing) noise,
        bias, latency (s), lever arm (3, m), roll, pitch and yaw of its mounting (rad); SI. landmarks: name and kind
        ("beacon", "wall", "pen") with numbers: north, east, down; unit normal (3) and offset; north, east, radius. bottom:
        unit normal (3) and offset. force (6,), acceleration (6,), current (3,): None for those of a good model. gusts (5,):
        deviations north, east, down (m/s), time constant and second lag (s). gate:
        deviations and patience in s. start: north, east, down and deviation, m. waves (5,): as of `fly`.
        exact_model: the vehicle is simulated by the model itself.
        """
    @property
    def channels(self, /) -> list[str]:
        """
        The names of all channels that a step takes, besides voltage.
        """
    @property
    def covariance(self, /) -> NDArray[float64]:
        """
        The covariance of the error, shape (24, 24): position, attitude, velocity, force, current, gyro bias.
        """
    @property
    def restarts(self, /) -> int:
        """
        How often the filter had to begin anew: after a pause beyond a minute, where it had lost its lock, or when its
        estimate was no number.
        """
    @property
    def state(self, /) -> dict[str, NDArray[float64]]:
        """
        What is estimated besides the channels: force (6,) in N and N m, body frame, current (3,) NED in m/s, gyro_bias (3,)
        in rad/s; and the standard deviations of all: position (3,), attitude (3,), velocity (6,) …
        """
    def step(self, /, measurement: Mapping[str, ArrayLike], commands: Mapping[str, ArrayLike] | None = None, signals: Mapping[str, ArrayLike] | None = None, *, ages: Mapping[str, ArrayLike] | None = None, time_s: SupportsFloat | SupportsIndex | None = None, dt_s: SupportsFloat | SupportsIndex | None = None) -> dict[str, float]:
        """
        The estimate {channel: value} after a step; empty until the attitude has been measured once. See
        `seatrial.NavigationFilter.step`, which says it in the words of a user.
        """
    @property
    def waiting_for(self, /) -> list[str]:
        """
        The channels that must be measured before the filter begins; empty once it has begun.
        """
    @property
    def watches(self, /) -> dict[str, list[float]]:
        """
        Per channel that has been measured: samples taken and refused, recoveries, mean normalised innovation squared and
        its 95 % band, time since the last sample in s, impossible samples.
        """

@final
class Flights:
    """
    The flights of k cases: a log of each, where one was kept, and their figures.
    """
    def __copy__(self, /) -> Flights:
        """
        Itself: nothing of it can change.
        """
    def __deepcopy__(self, /, memo: Any) -> Flights:
        """
        Itself: nothing of it can change.
        """
    def __len__(self, /) -> int:
        """
        Number of cases.
        """
    def __reduce__(self, /) -> tuple[Any, tuple[tuple[str, NDArray[float64]], float, NDArray[float64], list[NDArray[float64]]]]: ...
    @property
    def columns(self, /) -> list[str]:
        """
        Names of the columns of a log; cmd.<actuator> and act.<actuator> are in the unit of the command.
        """
    @property
    def cross_track_counts(self, /) -> NDArray[float64]:
        """
        How many samples of the cross-track error on settled legs there were and, of them, how many exceed each of
        `error_edges`, shape (k, 1 + edges).
        """
    @property
    def figures(self, /) -> dict[str, NDArray[float64]]:
        """
        The figures of all cases by name, shape (k,) each; SI and rad, a diverged flight is not a number.
        """
    def log(self, /, case: SupportsIndex) -> NDArray[float64]:
        """
        The log of a case, shape (n, columns), one row per control period; SI and rad.
        """
    def t(self, /, case: SupportsIndex) -> NDArray[float64]:
        """
        Time of the rows of a case, shape (n,), s.
        """
    @property
    def true_cross_track_counts(self, /) -> NDArray[float64]:
        """
        The same of the true cross-track error.
        """
    @property
    def vertical_counts(self, /) -> NDArray[float64]:
        """
        The same of the vertical error.
        """
    @property
    def violations(self, /) -> NDArray[float64]:
        """
        What each corridor of a trial was violated by, shape (k, corridors, 3): time integrals of the shortfall below
        the lower bound and of the excess over the upper one, s, and of clock times deviation from the target, s².
        """

@final
class Helm:
    """
    An autopilot at work: a measurement in, commands out, once per control period.
    """
    @property
    def ages(self, /) -> dict[str, float]:
        """
        The age in s of every channel that the autopilot uses: the time since its last good sample, inf before the first.
        """
    def declare_failed(self, /, actuator: str, failed: bool = True) -> None:
        """
        Takes an actuator out of the allocation from the next step on, or back into it.
        """
    @property
    def refused(self, /) -> dict[str, tuple[int, str]]:
        """
        Samples that were not believed, by channel: how many, and what was wrong last: impossible, a jump, or the same value
        for too long.
        """
    def reset(self, /) -> None:
        """
        The operator's reset: leaves every reaction, whatever called for it, and takes up the mission where it was
        interrupted. What is still true calls again after its time. Actuators that were given up stay so: see `declare_failed`.
        """
    def step(self, /, measurement: Mapping[str, ArrayLike], signals: Mapping[str, ArrayLike] | None = None, *, set_points: Mapping[str, ArrayLike] | None = None, time_s: SupportsFloat | SupportsIndex | None = None, dt_s: SupportsFloat | SupportsIndex | None = None) -> dict[str, float]:
        """
        Commands {actuator: value in its own unit} from now on.

        measurement: the channels that were measured since the last step: x y z in m (NED), roll pitch yaw in rad,
        u v w over ground in m/s, p q r in rad/s, altitude in m (inf: no bottom within reach), u_water v_water w_water in
        m/s, battery (share left), voltage in V. A missing channel, None or nan keeps its last value and grows old by itself;
        what is impossible (yaw = 270 rad, u = inf) was not measured either, and is counted in `refused`. signals: measured
        commands of the actuators, in the unit of the command, by which a failed one is found. The autopilot begins when
        all that it needs of position, depth, attitude and rates has been measured once (`waiting_for`); before, commands
        are neutral. set_points: speed and lateral (m/s), heading and pitch (rad), depth (m) in place of guidance's, or
        north, east and down (m) by which the plan is moved: steering by hand, while safety does not react. time_s: when
        the samples were taken, s on a clock that runs forward, or dt_s: how long after the last step; a control period
        without either. Sooner than half a period after the last commands, these stay.

        Raises SimulationError for an unknown name, what is no number, and a time that does not advance; nothing of such a
        call is taken. Before the autopilot has begun, for an impossible battery or voltage too.
        """
    @property
    def thought(self, /) -> dict[str, Any]:
        """
        What the autopilot thought at the last step: mode, reaction, its cause and the channel that was stale, whether it has ended, the waypoint in
        hand, desired speed (m/s), heading (rad) and depth (m), errors (m), actuators given up, and the one that the motion makes suspect ("all" where none works); empty before the first.
        """
    @property
    def waiting_for(self, /) -> list[str]:
        """
        The groups of channels that must be measured before the autopilot begins; empty once it has begun.
        """

@final
class LinearModel:
    """
    A linear model along a motion of n samples with N states, the first S of the vehicle, Y channels and M unknowns.

    transition (n - 1, S, N): the rows of the vehicle's states; driven (n - 1, E): the E entries of the other rows, of
    what drives it, that are not zero, and places, E of row and column (row 0 is that of state S), in the order of the
    rows; shown (n, V): the V entries of what the channels show of the states that are not zero, and seen, V of channel
    and state, in the order of the channels; measured (n, Y) and valid (n, Y), not zero where a sample counts; drift (n - 1, N); slopes (n - 1, S, M),
    derivatives of a step by the unknowns; start (N,), the expected first state.

    Koopman (1993), Biometrika 80, 117; Maine and Iliff, NASA RP-1168 (1986).
    """
    def __new__(cls, /, *, transition: ArrayLike, places: SupportsGetItem[int, tuple[SupportsIndex, SupportsIndex]], driven: ArrayLike, seen: SupportsGetItem[int, tuple[SupportsIndex, SupportsIndex]], shown: ArrayLike, measured: ArrayLike, valid: ArrayLike, drift: ArrayLike, slopes: ArrayLike, start: ArrayLike) -> LinearModel: ...
    def judge(self, /, process: ArrayLike, sensors: ArrayLike, start: ArrayLike, kept: SupportsGetItem[int, SupportsIndex]) -> tuple[float, NDArray[float64], NDArray[float64], NDArray[float64], NDArray[float64]]:
        """
        Logarithm of the likelihood of variances, without its constant, its slopes by process (N,) and sensors (Y,),
        and the states at the places kept: smoothed (n, kept), and after the measurements of each sample (n, kept).

        process (N,), per sample; sensors (Y,); start (N,), of the first state; kept: places of states.
        """
    def likelihood(self, /, process: ArrayLike, sensors: ArrayLike, start: ArrayLike) -> NDArray[float64]:
        """
        Logarithm of the likelihood of variances, without its constant, alone: what each sample adds to it, (n,).

        Parameters as for judge.
        """
    def predict(self, /, process: ArrayLike, sensors: ArrayLike, start: ArrayLike, ahead: SupportsIndex = 0) -> NDArray[float64]:
        """
        What the channels are predicted to show so many samples after each measurement, and its derivatives by the
        unknowns with the gains held, (n - ahead, Y, 1 + M).
        """

@final
class Mission:
    """
    A mission: waypoints, where it starts and what it may not leave. Immutable.

    Raises
    ------
    VehicleError
        What is wrong with the file, in which leg, at which key, and what to do.

    Examples
    --------
    >>> from seatrial._core import Mission
    >>> head = 'format = 1\\nname = "out"\\nspeed_m_s = 2.0\\nacceptance_radius_m = 3.0\\n'
    >>> mission = Mission.from_toml(head + '[[legs]]\\nnorth_m = 30.0\\neast_m = 40.0\\n')
    >>> mission.length, mission.planned_time, mission.waypoints["label"]
    (50.0, 25.0, ['waypoint 1'])
    """
    def __copy__(self, /) -> Mission:
        """
        Itself: nothing of it can change.
        """
    def __deepcopy__(self, /, memo: Any) -> Mission:
        """
        Itself: nothing of it can change.
        """
    def __reduce__(self, /) -> tuple[Any, tuple[str]]: ...
    def clearance(self, /, vehicle: Vehicle | None, position: ArrayLike, euler: ArrayLike, *, obstacles: SupportsGetItem[int, tuple[SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex]] = ...) -> NDArray[float64]:
        """
        Horizontal distance in m of the hull of a vehicle, without one of its origin, from the nearest of what stands in the water, and the smallest one
        beyond what the mission promises, shape (n, 2), at positions (n, 3) and attitudes (n, 3), roll, pitch, yaw in rad;
        infinite where there is none. `obstacles` are further cylinders: north, east and radius in m.
        """
    @property
    def description(self, /) -> str:
        """
        What the mission is for, in a sentence.
        """
    @property
    def fence(self, /) -> NDArray[float64]:
        """
        Corners (n, 2) of the fence, north and east in m; no row without one.
        """
    @staticmethod
    def from_toml(text: str, source: str = "<text>") -> Mission:
        """
        The mission of the TOML text of a mission file in metres; `source` stands in messages.
        """
    @property
    def landmarks(self, /) -> list[dict[str, Any]]:
        """
        Known places that acoustic sensors see: name, kind ("beacon", "wall", "pen"), north_m, east_m, and depth_m, facing_deg
        or radius_m.
        """
    @property
    def leg_numbers(self, /) -> list[int]:
        """
        Number of the leg in the file, from 1, that each waypoint belongs to.
        """
    @property
    def legs(self, /) -> list[dict[str, Any]]:
        """
        The legs as the file has them, in order: kind ("waypoint", "lawnmower", "spiral", "perimeter") and its keys, with
        their units and defaults; what has no default and is not given is missing.
        """
    @property
    def length(self, /) -> float:
        """
        Length of the path in m, from the start to the last waypoint, circles included.
        """
    @property
    def limits(self, /) -> dict[str, float]:
        """
        What the mission may not leave: `max_depth_m` and `max_time_s` (infinite without a limit), `min_altitude_m` (0
        without).
        """
    @property
    def name(self, /) -> str:
        """
        Name of the mission.
        """
    @property
    def obstacles(self, /) -> list[dict[str, Any]]:
        """
        What stands in the water: the farms that the mission goes about, then its obstacles. Per thing north_m, east_m and
        radius_m, or corners_m [[north, east], …]; distance_m, how near the hull may come as the mission promises; and leg,
        the number of the leg that goes about it, 0 without.
        """
    @property
    def origin(self, /) -> tuple[float, float] | None:
        """
        Latitude and longitude of the origin in degrees; none where the file has none.
        """
    @property
    def planned_time(self, /) -> float:
        """
        Time for the path in s at the speeds of its legs, with station-keeping and circles.
        """
    def reached(self, /, place: ArrayLike, shown: ArrayLike, leg: SupportsGetItem[int, SupportsIndex], under_way: SupportsGetItem[int, bool], loiter_radius: SupportsFloat | SupportsIndex) -> NDArray[float64]:
        """
        How near a flight came to every waypoint: the smallest true and perceived distance in m (infinite where the leg was
        never begun), and 1.0 where it was reached, shape (waypoints, 3). `place` and `shown` (n, 4) are true and perceived
        north, east, depth and altitude in m, `leg` and `under_way` (n,) the leg and whether the row is on the mission;
        `loiter_radius` is that of a vehicle that cannot stop, else 0.
        """
    @property
    def start(self, /) -> dict[str, float]:
        """
        Where the first leg begins: `north_m`, `east_m`, `depth_m`, and `heading` in rad.
        """
    @property
    def steepest(self, /) -> tuple[int, float]:
        """
        Index of the waypoint with the steepest way to it, and that slope in rad, positive upwards.
        """
    def to_dict(self, /) -> dict[str, Any]:
        """
        The same as plain data: the tables of the file by name, patterns as written, defaults filled in.
        """
    def to_toml(self, /, *, expanded: bool = False) -> str:
        """
        The mission file as written, TOML; with `expanded` every pattern as waypoints.
        """
    @property
    def waypoints(self, /) -> dict[str, NDArray[float64] | list[str]]:
        """
        The waypoints as columns of equal length, in the order of travel.

        Places `north_m`, `east_m`, `depth_m`, `altitude_m` (NaN in the one of the last two that `vertical` does not
        name); `speed_m_s` on the way there; `acceptance_radius_m`; `hold_s` (0 without) with `heading` in rad (NaN where
        free); `circle_radius_m` (0 without) with `turns`, positive to starboard; `course` and `slope` of the straight
        way there in rad, the slope positive upwards; `label`.
        """

@final
class OpenLoop:
    """
    Candidates of some coefficients on segments of trials: the criterion of an identification stage.

    names: coefficients that vary, in the order of the candidates' columns; segments: (record index, first
    sample, one past the last, position (3,), attitude (4,) or (3,), nu (6,)); free and measured: letters among
    XYZKMN, the other axes are frozen; loss: absolute, squared or huber with its knee; substeps per sample.
    """
    def __new__(cls, /, vehicle: Vehicle, records: SupportsGetItem[int, Record], segments: SupportsGetItem[int, tuple[SupportsIndex, SupportsIndex, SupportsIndex, ArrayLike, ArrayLike, ArrayLike]], *, names: SupportsGetItem[int, str] = ..., free: str = "XYZKMN", measured: str = "", loss: str = "absolute", knee: SupportsFloat | SupportsIndex = 1.0, substeps: SupportsIndex = 1) -> OpenLoop: ...
    def along(self, /, position: ArrayLike, attitude: ArrayLike, nu: ArrayLike, current: ArrayLike) -> OpenLoop:
        """
        The same segments from other starts, each in a steady current of its own besides the recorded one: position
        (k, 3), attitude (k, 4) or (k, 3), nu (k, 6), and current (k, 3), NED, m/s.
        """
    def errors(self, /, values: ArrayLike, threads: SupportsIndex | None = None) -> NDArray[float64]:
        """
        Sums over the samples of loss(weight * error), shape (k, segments, 12); infinite where a candidate
        diverged.

        values (k, names); threads: all when missing.
        """
    def gradient(self, /, values: ArrayLike, directions: ArrayLike | None = None, *, nuisances: SupportsGetItem[int, str] = ..., initials: SupportsGetItem[int, str] = ..., nuisance: ArrayLike | None = None, initial: ArrayLike | None = None, threads: SupportsIndex | None = None) -> tuple[NDArray[float64], NDArray[float64]]:
        """
        The criterion on what the channels show, (segments, 12), and its gradient, (segments, 12, m).

        Parameters as for sensitivities.
        """
    def predict(self, /, values: ArrayLike, nuisance: ArrayLike | None = None, initial: ArrayLike | None = None, threads: SupportsIndex | None = None) -> list[NDArray[float64]]:
        """
        What the channels of every segment show, each (samples, 12), for one candidate (names,).

        nuisance (records, 38) in the order of nuisance_names and initial (segments, 12) in that of
        initial_names, both zero when missing.
        """
    def sensitivities(self, /, values: ArrayLike, directions: ArrayLike | None = None, *, nuisances: SupportsGetItem[int, str] = ..., initials: SupportsGetItem[int, str] = ..., channels: SupportsGetItem[int, str] | None = None, nuisance: ArrayLike | None = None, initial: ArrayLike | None = None, threads: SupportsIndex | None = None) -> list[tuple[NDArray[float64], NDArray[float64]]]:
        """
        What every segment shows and its exact derivatives: per segment ((samples, 12), (samples, channels, m)).

        values (names,); directions (d, names): rows of changes of the coefficients, one per name when missing;
        nuisances and initials: names of further unknowns. The m columns are directions, nuisances, initials.
        channels: names of those to differentiate, all when missing. nuisance (records, 38) and initial
        (segments, 12): values, zero when missing. Derivatives by the variational equations, exact to rounding; where a
        function has a corner (|x| at 0, a latency or dead time of whole steps), that of one side or zero.
        """
    def tangents(self, /, values: ArrayLike, directions: ArrayLike | None = None, *, nuisances: SupportsGetItem[int, str] = ..., initials: SupportsGetItem[int, str] = ..., channels: SupportsGetItem[int, str] | None = None, nuisance: ArrayLike | None = None, initial: ArrayLike | None = None, threads: SupportsIndex | None = None) -> tuple[NDArray[float64], NDArray[float64]]:
        """
        The same of all segments in a row: (samples of all, 12) and (samples of all, channels, m).
        """

@final
class Record:
    """
    One trial: inputs on a uniform time base, and measured channels with weights.

    t (n,), s; commands {actuator: (n,)} in its own unit; voltage_v (n,), V; tau (n, 6), N and N m; current (n, 3),
    NED, m/s; actuators {name: (n,)} measured signals that replace the motor; nu and nu_rate on the half-step
    grid, (2 substeps (n - 1) + 1, 6), for measured axes; observed and weight (n, 12), SI, in the order u v w p q
    r x y z roll pitch yaw, weight 0 = masked; rho, kg/m3; g, m/s2;
    surface, m down of the zero of z: all is under water without it.
    """
    def __len__(self, /) -> int: ...
    def __new__(cls, /, t: ArrayLike, commands: Mapping[str, ArrayLike] | None = None, *, voltage_v: ArrayLike | None = None, tau: ArrayLike | None = None, current: ArrayLike | None = None, actuators: Mapping[str, ArrayLike] | None = None, nu: ArrayLike | None = None, nu_rate: ArrayLike | None = None, observed: ArrayLike | None = None, weight: ArrayLike | None = None, rho: SupportsFloat | SupportsIndex | None = None, g: SupportsFloat | SupportsIndex | None = None, surface: SupportsFloat | SupportsIndex | None = None) -> Record: ...

@final
class Run:
    """
    A simulated run; of a batch, every array has a leading dimension of candidates.
    """
    def __copy__(self, /) -> Run:
        """
        Itself: nothing of it can change.
        """
    def __deepcopy__(self, /, memo: Any) -> Run:
        """
        Itself: nothing of it can change.
        """
    def __reduce__(self, /) -> tuple[Any, tuple[tuple[str, NDArray[float64]], tuple[float, float, bool], tuple[NDArray[float64], NDArray[float64], NDArray[float64]], list[list[tuple[float, float, float, list[float]]]]]]: ...
    @property
    def actuators(self, /) -> dict[str, NDArray[float64]]:
        """
        Per actuator its revolutions, pulse width or newtons behind the motor, shape (n,).
        """
    @property
    def attitude(self, /) -> NDArray[float64]:
        """
        Unit quaternions [w x y z], body to NED, shape (n, 4).
        """
    @property
    def euler(self, /) -> NDArray[float64]:
        """
        Roll, pitch and yaw, shape (n, 3), rad.
        """
    @property
    def final_state(self, /) -> State:
        """
        The state at the last sample with all that the motors remember, `initial` of a run that goes on from there.

        Runs that follow one another so equal one run to rounding: lag, rate limit and dead time go on. The command at
        the last sample acts from there on: the next run begins with its own. Not of a batch.
        """
    @property
    def nu(self, /) -> NDArray[float64]:
        """
        [u v w p q r], shape (n, 6), m/s and rad/s.
        """
    @property
    def position(self, /) -> NDArray[float64]:
        """
        Position of O, north, east, down, shape (n, 3), m.
        """
    @property
    def t(self, /) -> NDArray[float64]:
        """
        Time, shape (n,), s.
        """
    @property
    def tau(self, /) -> NDArray[float64]:
        """
        Wrench of actuators and tau together about O, shape (n, 6), N and N m.
        """

@final
class State:
    """
    Position, attitude, velocity and actuators of a vehicle at one instant.

    position (3,) NED, m; attitude (4,) quaternion body to NED or (3,) roll, pitch, yaw, rad; nu (6,),
    m/s and rad/s; actuators {name: value in the unit of its command}, neutral when missing. A Run's final_state also
    holds what rate limit, lag and dead time of every motor remember, so that the next run goes on as if there were one.
    """
    def __copy__(self, /) -> State:
        """
        Itself: nothing of it can change.
        """
    def __deepcopy__(self, /, memo: Any) -> State:
        """
        Itself: nothing of it can change.
        """
    def __new__(cls, /, position: ArrayLike | None = None, attitude: ArrayLike | None = None, nu: ArrayLike | None = None, actuators: Mapping[str, ArrayLike] | None = None) -> State: ...
    def __reduce__(self, /) -> tuple[Any, tuple[NDArray[float64], NDArray[float64], NDArray[float64], dict[str, float], dict[str, tuple[float, float, float, list[float]]]]]: ...
    @property
    def actuators(self, /) -> dict[str, float]:
        """
        Actuators in the units of their commands.
        """
    @property
    def attitude(self, /) -> NDArray[float64]:
        """
        Unit quaternion [w x y z], body to NED, shape (4,).
        """
    @property
    def nu(self, /) -> NDArray[float64]:
        """
        [u v w p q r], shape (6,), m/s and rad/s.
        """
    @property
    def position(self, /) -> NDArray[float64]:
        """
        Position of O, north, east, down, shape (3,), m.
        """

@final
class Vehicle:
    """
    A vehicle: hull, mass, coefficients and actuators. Immutable.
    """
    def __copy__(self, /) -> Vehicle:
        """
        Itself: nothing of it can change.
        """
    def __deepcopy__(self, /, memo: Any) -> Vehicle:
        """
        Itself: nothing of it can change.
        """
    def __reduce__(self, /) -> tuple[Any, tuple[str, NDArray[float64]]]: ...
    def __repr__(self, /) -> str: ...
    def acceleration(self, /, nu: ArrayLike, attitude: ArrayLike, tau: ArrayLike, current: ArrayLike | None = None, *, depth: ArrayLike | None = None) -> NDArray[float64]:
        """
        The acceleration nu' under the wrench tau, body frame, m/s2 and rad/s2.

        nu and tau (n, 6) or (6,); attitude (n, 4) quaternion body to NED or (n, 3) roll, pitch, yaw in
        rad; current (3,) or (n, 3), NED, m/s. Returns the shape of nu. The pull of a tether, which goes by the
        place of the vehicle, is left out. depth, one number or (n,), is that of O below the surface in m; all of the
        vehicle is under water without it. Fossen (2011), equation 7.9.
        """
    def actuator_info(self, /) -> dict[str, dict[str, Any]]:
        """
        Per actuator: kind, group, unit, neutral and limits of its command, place, wrench per newton, power.
        """
    @property
    def actuators(self, /) -> list[str]:
        """
        Names of the actuators in the order of the allocation matrix's columns.
        """
    def allocation_matrix(self, /) -> NDArray[float64]:
        """
        Wrench about O per newton of each actuator, shape (6, actuators).
        """
    def authority(self, /, speed_m_s: SupportsFloat | SupportsIndex = 0.0) -> dict[str, dict[str, Any]]:
        """
        Per row X Y Z K M N what the actuators can command at speed_m_s, ahead through still water.

        controllable: whether the vehicle file lists the row; share: part of a unit demand in this row alone that can be
        produced with all six rows held; controlled_share: with the controllable ones held; reach: largest wrench in
        positive and negative direction, N or N m; size: the row's weight over the largest singular value.
        """
    def authority_sentences(self, /, speed_m_s: SupportsFloat | SupportsIndex = 0.0) -> list[str]:
        """
        The same in sentences: what cannot be commanded, and what remains after the loss of each actuator.
        """
    def coefficient_info(self, /) -> dict[str, dict[str, Any]]:
        """
        Per coefficient, absent ones too: unit, start value, default bounds (lower, upper), description.

        Of what the geometry tells, else None: `formula`, the value by it, SI; `low` and `high`, the ends of its stated 95 % interval; `sd`, the
        standard deviation of a normal distribution whose interval is as wide; `source`.
        """
    def coefficients(self, /) -> dict[str, float]:
        """
        The coefficients by name, SI.
        """
    @property
    def controllable(self, /) -> list[str]:
        """
        Rows of the wrench that the vehicle can command, among X Y Z K M N.
        """
    @property
    def description(self, /) -> str:
        """
        What the vehicle is, in a sentence.
        """
    def environment(self, /) -> dict[str, float]:
        """
        Water and gravity for which the coefficients hold: rho in kg/m3, g in m/s2.
        """
    def floating_depth(self, /, *, rho: SupportsFloat | SupportsIndex | None = None, g: SupportsFloat | SupportsIndex | None = None) -> float:
        """
        Depth of O in m at which the vehicle floats upright and at rest; just under water where it is too heavy to float.
        """
    def forces(self, /, nu: ArrayLike, attitude: ArrayLike, current: ArrayLike | None = None, *, depth: ArrayLike | None = None) -> dict[str, NDArray[float64]]:
        """
        Every term of the equation of motion as force on the vehicle, (n, 6), body frame, N and N m.

        Keys rigid_body (-C_RB nu), added_mass (-C_A nu_r + M_A nu_c'), damping (-D nu_r), lift, restoring
        (-g), and bias where the vehicle has one; their sum + tau = mass_matrix @ acceleration. depth, one number or
        (n,), is that of O below the surface in m: each term is then that of the part under water, and the mass matrix
        M_RB + submerged share times M_A.
        """
    @staticmethod
    def from_toml(text: str, source: str = "<text>") -> Vehicle:
        """
        The vehicle of the TOML text of a vehicle file; `source` stands in messages.
        """
    def geometry(self, /) -> dict[str, float]:
        """
        Measures of the hull in m (length, diameter, height); empty when the file has none.
        """
    @property
    def hull_shape(self, /) -> str | None:
        """
        "spheroid", "box" or "frame"; None when the file has no geometry.
        """
    def hull_top(self, /) -> NDArray[float64]:
        """
        The highest point of the hull over its centre of buoyancy, shape (3,), body frame, m.
        """
    def linearize(self, /, nu: ArrayLike, attitude: ArrayLike, tau: ArrayLike, current: ArrayLike | None = None, *, form: str = "rotation", depth: SupportsFloat | SupportsIndex | None = None) -> tuple[NDArray[float64], NDArray[float64]]:
        """
        A, shape (12, 12), and B, shape (12, 6), of the equation of motion at a velocity, an attitude and a wrench.

        State [p_n, delta, nu] with R = R_0 exp(S(delta)), R_0 held, so that delta' = omega + 1/2 delta x omega;
        with form="euler" [x y z phi theta psi nu]. nu (6,), attitude (4,) quaternion or (3,) roll, pitch, yaw,
        tau (6,), current (3,) NED. A = df/dx and B = df/dtau, exact to rounding (dual numbers). depth, that of O below
        the surface in m, lets the surface count; all of the vehicle is under water without it.
        """
    @staticmethod
    def load(name_or_path: str | PathLike[str]) -> Vehicle:
        """
        The vehicle of a built-in name or a file.

        Raises VehicleError (a ValueError) that names file, key, what was expected and what was found.
        """
    def mass_matrix(self, /) -> NDArray[float64]:
        """
        M = M_RB + M_A, shape (6, 6), in kg, kg m, kg m2.
        """
    def motors(self, /) -> dict[str, dict[str, Any]]:
        """
        Per actuator the table of its motor as the vehicle file has it, defaults filled in; empty for an ideal motor.

        Keys maximum_ahead, maximum_astern, minimum_ahead, minimum_astern, n_acc_per_s and n_dec_per_s in the unit of the
        command, below_minimum ("lift" or "zero"), K_V, T_1_s and T_t_s; what has no default and is not given is missing.
        """
    @property
    def name(self, /) -> str:
        """
        Name of the vehicle.
        """
    @staticmethod
    def names() -> list[str]:
        """
        Names of the built-in vehicles.
        """
    def power(self, /) -> dict[str, float]:
        """
        Hotel load in W and battery energy in W h; empty when the file has none.
        """
    def simulate(self, /, t: ArrayLike, commands: Mapping[str, ArrayLike] | None = None, initial: State | None = None, current: ArrayLike | None = None, free: str = "XYZKMN", tau: ArrayLike | None = None, *, voltage_v: ArrayLike | None = None, max_step_s: SupportsFloat | SupportsIndex = 0.02, rho: SupportsFloat | SupportsIndex | None = None, g: SupportsFloat | SupportsIndex | None = None, surface: SupportsFloat | SupportsIndex | None = None) -> Run:
        """
        The run under commands {actuator: (n,)} in the actuators' own units, held from sample to sample; one number is held
        for the whole run. With `initial` the final_state of a run before, the run goes on as if there were one.

        t (n,) uniform, s; missing actuators stay at neutral; current (3,) or (n, 3), NED, m/s; free names
        the free axes among XYZKMN, the others keep their velocity; tau (n, 6) is a wrench besides the
        actuators'; voltage_v (n,) or one number, V; max_step_s, s; rho, kg/m3; g, m/s2; surface: where the sea ends, m
        down (0 where z is the depth), without it all of the vehicle is under water. Runge-Kutta of fourth order.

        Raises DivergenceError, a SimulationError, where the run diverges: when, in which axis, why, and what to do.
        """
    def table_voltages(self, /) -> dict[str, tuple[float, float]]:
        """
        Smallest and largest supply voltage, V, of every table of thrust that was measured at several, by its name.
        """
    def to_dict(self, /) -> dict[str, Any]:
        """
        The same as plain data: the tables of the file by name, coefficients written out.
        """
    def to_toml(self, /) -> str:
        """
        The vehicle file with every coefficient written out, TOML.
        """
    def with_coefficients(self, /, coefficients: Mapping[str, ArrayLike]) -> Vehicle:
        """
        The same vehicle with other values of some coefficients, SI.

        Raises VehicleError for an unknown name or an impossible mass matrix.
        """
    def with_model_error(self, /, *, force: ArrayLike, force_time_s: SupportsFloat | SupportsIndex, acceleration: ArrayLike) -> Vehicle:
        """
        The same vehicle with the [model_error] of its file: what its model leaves unexplained, by which a
        navigation filter on it goes unless it is told otherwise.

        force (6,), standard deviation of the force and moment that the model does not know, N and N m;
        force_time_s, its time constant; acceleration (6,), standard deviation of the velocities after a second
        of white acceleration, m/s and rad/s. Raises VehicleError for a number beyond its range.
        """
    def without_model_error(self, /) -> Vehicle:
        """
        The same vehicle without [model_error] in its file.
        """

def _restored_autopilot(text: str) -> Autopilot:
    """
    The autopilot of the text of its file: how a pickled one comes back.
    """

def _restored_flights(vehicle: tuple[str, ArrayLike], period_s: SupportsFloat | SupportsIndex, figures: ArrayLike, logs: SupportsGetItem[int, ArrayLike]) -> Flights:
    """
    The flights of exactly these numbers: how pickled ones come back.
    """

def _restored_mission(text: str) -> Mission:
    """
    The mission of the text of its file: how a pickled one comes back.
    """

def _restored_run(vehicle: tuple[str, ArrayLike], timing: tuple[SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex, bool], tracks: tuple[ArrayLike, ArrayLike, ArrayLike], motors: SupportsGetItem[int, SupportsGetItem[int, tuple[SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex, SupportsGetItem[int, SupportsFloat | SupportsIndex]]]]) -> Run:
    """
    The run of exactly these numbers: how a pickled one comes back.
    """

def _restored_state(position: ArrayLike, attitude: ArrayLike, nu: ArrayLike, actuators: dict[str, SupportsFloat | SupportsIndex], motors: dict[str, tuple[SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex, SupportsGetItem[int, SupportsFloat | SupportsIndex]]]) -> State:
    """
    The state of exactly these numbers: how a pickled one comes back. Its attitude is not scaled to length one again.
    """

def _restored_vehicle(text: str, coefficients: ArrayLike) -> Vehicle:
    """
    The vehicle of the text of its file with exactly these coefficients: how a pickled one comes back.
    """

def ardusub_defaults() -> dict[str, float]:
    """
    ArduSub's defaults of the parameters that `ardusub_fly` takes, by name, in ArduSub's units (4.7 and later).
    """

def ardusub_fly(vehicle: Vehicle, frame: str, direction: ArrayLike, targets: ArrayLike, *, seeds: SupportsGetItem[int, SupportsIndex], period_s: SupportsFloat | SupportsIndex, every: SupportsIndex, parameters: Mapping[str, ArrayLike] | None = None, coefficients: Mapping[str, ArrayLike] | None = None, position: ArrayLike, attitude: ArrayLike, nu: ArrayLike, integrals: ArrayLike, current: ArrayLike, wander: ArrayLike, wander_s: SupportsFloat | SupportsIndex, tether: ArrayLike, tether_at: ArrayLike, supply: ArrayLike, noise: ArrayLike, pulse: ArrayLike | None = None, coupling: SupportsFloat | SupportsIndex | None = None, threads: SupportsIndex | None = None) -> NDArray[float64]:
    """
    Flies k cases along targets: rows (k, n, 20) of place (m, NED), roll, pitch, yaw (rad), velocity (body), the demands of
    roll, pitch, yaw, throttle, forward and lateral (-1 to 1), and the load of the motors by roll, pitch and throttle and by
    yaw, forward and lateral (1: at the limit).

    frame, direction, pulse and coupling as of `ardusub_pulses`. parameters {name: (k,) or a number} by `ardusub_defaults`, which hold
    where none is given. targets (N, 20), a row per control period: roll, pitch, yaw (rad), rate of that yaw (rad/s),
    north, east, down (m), their velocity and acceleration, the pilot's throttle, forward and lateral, 1 where the depth
    and where the place is controlled, supply (V), 1 where the attitude is asked for and its target moves there, limited in
    rate and acceleration, 0 where it is the target. position (k, 3) or (3,), attitude (k, 4|3), nu (k, 6); integrals (k, 7):
    integral parts of roll, pitch, yaw, of the vertical velocity and acceleration, north and east. coefficients {name:
    (k,)} of the vehicle. current (k, 3), NED, m/s; wander (k, 6): standard deviation of a wrench in the body frame that
    the model does not know, with the time constant wander_s; tether (k, 3): force, NED, N, at the point tether_at, m;
    supply (k, 3): thrust over that of the voltage at the beginning, its fall per s and at full load. noise (2,): standard
    deviation on gyro (rad/s) and velocity (m/s). A row is kept every `every` periods.
    """

def ardusub_forward_lateral(acceleration: ArrayLike, heading: ArrayLike, limit: SupportsFloat | SupportsIndex) -> NDArray[float64]:
    """
    Forward and lateral (n, 2), -1 to 1, of an acceleration wanted.

    Parameters
    ----------
    acceleration : (n, 2)
        North and east, m/s2.
    heading : (n,)
        rad.
    limit : float
        Largest lean angle, rad.
    """

def ardusub_frames() -> dict[str, NDArray[float64]]:
    """
    Shares (motors, 6) of roll, pitch, yaw, throttle, forward and lateral by the name of each frame.

    They are in the order of ArduSub's ``FRAME_CONFIG``.
    """

def ardusub_pulses(frame: str, demands: ArrayLike, direction: ArrayLike, pulse: ArrayLike | None = None, *, coupling: SupportsFloat | SupportsIndex | None = None) -> NDArray[float64]:
    """
    Pulse widths (n, motors), whole us, of a frame's motors.

    Parameters
    ----------
    frame : str
        As of `ardusub_frames`.
    demands : (n, 6)
        Roll, pitch, yaw, throttle (-1 to 1, up), forward and lateral.
    direction : (motors,)
        ``MOT_n_DIRECTION``, 1 or -1.
    pulse : (2,)
        ``MOT_PWM_MIN`` and ``MOT_PWM_MAX``, us.
    coupling : float, optional
        ``MOT_FV_CPLNG_K``, which counts for the frame Vectored; ArduSub's default when omitted.
    """

def ardusub_rates(wanted: ArrayLike, attitude: ArrayLike, turning: ArrayLike, gyro: ArrayLike, p: ArrayLike, acceleration: ArrayLike, dt: SupportsFloat | SupportsIndex, *, yaw_rate_p: SupportsFloat | SupportsIndex = 0.0) -> NDArray[float64]:
    """
    Turn rates (n, 3), rad/s, that the angle controllers want for roll, pitch and yaw.

    Parameters
    ----------
    wanted, attitude : (n, 3)
        Roll, pitch and yaw, rad.
    turning : (n, 3)
        Turn rate of the attitude wanted, in its own frame, rad/s.
    gyro : (n, 3)
        Measured turn rate, rad/s.
    p : (3,)
        ``ATC_ANG_RLL_P``, ``ATC_ANG_PIT_P``, ``ATC_ANG_YAW_P``, per s.
    acceleration : (3,)
        ``ATC_ACC_R_MAX``, ``ATC_ACC_P_MAX``, ``ATC_ACC_Y_MAX`` in rad/s2; 0: proportional.
    dt : float
        Control period, s.
    yaw_rate_p : float
        ``ATC_RAT_YAW_P``, s, which bounds the error of yaw; 0: no bound.
    """

def ardusub_square_root(error: ArrayLike, p: SupportsFloat | SupportsIndex, limit: SupportsFloat | SupportsIndex, dt: SupportsFloat | SupportsIndex) -> NDArray[float64]:
    """
    Rate wanted (n,) of the square-root controller for an error (n,).
    """

def ardusub_terms(target: ArrayLike, measured: ArrayLike, dt: ArrayLike, integrator: ArrayLike, gains: ArrayLike, filters: ArrayLike) -> NDArray[float64]:
    """
    Terms (n, 7) of a PID controller: filtered target and error, P, I, D, FF and D_FF.

    Parameters
    ----------
    target, measured : (n,)
    dt : (n,)
        Time since the row before, s; what is not positive begins anew with the row's own integral part.
    integrator : (n,)
        Integral part with which a row begins, where it begins anew.
    gains : (6,)
        P, I, D, FF, D_FF and IMAX.
    filters : (3,)
        Cut-offs of target, error and derivative, Hz; 0: none.
    """

def ardusub_velocity(error: ArrayLike, velocity: ArrayLike, p: SupportsFloat | SupportsIndex, acceleration: SupportsFloat | SupportsIndex, dt: SupportsFloat | SupportsIndex) -> NDArray[float64]:
    """
    Velocity wanted (n,), m/s, for an error of position; see ``PSC_*_POS_P``.

    Parameters
    ----------
    error, velocity : (n,)
        Target minus position, m, and the velocity of the target, m/s.
    p : float
        Per s.
    acceleration : float
        Limit of the way back, m/s2; 0: proportional.
    dt : float
        Control period, s.
    """

def autopilot_c(autopilot: Autopilot, vehicle: Vehicle, mission: Mission, prefix: str, about: SupportsGetItem[int, str], *, feedback: bool = True, voltage_v: SupportsFloat | SupportsIndex = ...) -> dict[str, Any]:
    """
    The step of an autopilot on a vehicle and a mission as C, see `seatrial.export`: as `vehicle_c`.
    """

def autopilot_names() -> dict[str, list[str]]:
    """
    The names behind the numbers of a flight: channels, groups, reactions and watches of the autopilot.
    """

def checked_threads(threads: SupportsIndex | None) -> None:
    """
    Refuse a number of threads that is none: expected from 1 to 1024, or None for all processors.
    """

def error_edges() -> NDArray[float64]:
    """
    The thresholds of the counts of errors, m, shape (edges,).
    """

def file_kind(keys: SupportsGetItem[int, str]) -> str | None:
    """
    Kind of the file with these keys at its top: "a mission"; None where no key tells.
    """

def file_text(path: str | PathLike[str]) -> str:
    """
    Text of a regular file of bounded size, in UTF-8 with or without a byte order mark.

    Raises ValueError that says why the file cannot be read.
    """

def filter_c(filter: Filter, prefix: str, about: SupportsGetItem[int, str], *, period_s: SupportsFloat | SupportsIndex, autopilot: tuple[str, SupportsGetItem[int, str]] | None = None, start: ArrayLike | None = None, voltage_v: SupportsFloat | SupportsIndex = ...) -> dict[str, Any]:
    """
    A navigation filter as C, see `seatrial.export`: as `vehicle_c`.

    Parameters
    ----------
    autopilot : (str, list of str), optional
        Prefix of an autopilot's program that is told the estimate, and the names of its inputs.
    start : (3,), optional
        Where the vehicle begins unless a sensor says it, m; that of the filter by default.
    """

def fly(vehicle: Vehicle, autopilot: Autopilot, mission: Mission, seeds: SupportsGetItem[int, SupportsIndex], *, model: Vehicle | None = None, position: ArrayLike, attitude: ArrayLike, nu: ArrayLike, current: ArrayLike, coefficients: Mapping[str, ArrayLike] | None = None, gains: Mapping[str, ArrayLike] | None = None, faults: SupportsGetItem[int, tuple[SupportsIndex, str, SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex]] = ..., errors: ArrayLike, timing: ArrayLike, outages: SupportsGetItem[int, tuple[SupportsIndex, SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex]] = ..., feedback: bool = True, seabed: ArrayLike | None = None, voltage_v: SupportsFloat | SupportsIndex = ..., rho: SupportsFloat | SupportsIndex | None = None, g: SupportsFloat | SupportsIndex | None = None, max_step_s: SupportsFloat | SupportsIndex = 0.02, max_time_s: SupportsFloat | SupportsIndex, logs: bool = True, threads: SupportsIndex | None = None, turbulence: ArrayLike | None = None, turbulence_times_s: tuple[SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex] = ..., obstacles: SupportsGetItem[int, tuple[SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex]] = ..., case_outages: SupportsGetItem[int, tuple[SupportsIndex, SupportsIndex, SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex]] = ..., set_points: Mapping[str, ArrayLike] | None = None, corridors: SupportsGetItem[int, tuple[str, ArrayLike, ArrayLike, ArrayLike, ArrayLike, ArrayLike, ArrayLike]] = ..., current_trend: ArrayLike | None = None, current_walk: ArrayLike | None = None, waves: ArrayLike | None = None, navigation: Filter | None = None, dither: Mapping[str, ArrayLike] | None = None, sensor_offsets: ArrayLike | None = None, acoustics: Mapping[str, ArrayLike] | None = None, transceiver: tuple[SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex] = ...) -> Flights:
    """
    Flies k cases of a mission; see `seatrial.fly`, which says it in the words of a user.

    seeds (k,); position (k, 3) or (3,), attitude (k, 4|3), nu (k, 6), current (k, 3); coefficients {name: (k,)} of the
    vehicle that flies and gains {name: (k,)} of the autopilot; model: the vehicle that the autopilot takes it for.
    faults: rows (case, actuator, time in s, command or nan: where it is). errors (16, 4): noise, bias, drift and
    quantum per channel; timing (7, 5): present, every, latency (control periods), drop-outs every s, for s; outages:
    rows (group, from, until in s), case_outages: rows (case, group, from, until). seabed (3,): depth in m and slopes
    north and east; obstacles: rows (north, east, radius in m) besides those of the mission. turbulence (k, 3) or (3,):
    standard deviation of the current about its mean, NED, m/s, with the time constants turbulence_times_s;
    current_trend (m/s2) and current_walk (m/s per root of a second), (k, 3) or (3,): slow change of that mean. waves
    (k, 5) or (5,): significant height, m, peak period, s, direction and spreading, rad, peakedness. set_points
    {"times": (S,), name: (k, S) or (S,)}: speed, lateral, heading, pitch, depth in place of guidance's, north, east,
    down by which its plan is moved, each from its time on. dither {"times": (S,), actuator: (S,)}: added to the
    autopilot's commands from each time on, in their unit. sensor_offsets (k, 16) or (16,): offset of each channel in
    its standard deviations, in place of the one that the seed draws. navigation: the filter whose
    estimate the autopilot is told, each case with one of its own; acoustics {kind: (17,)}: noise, offset, quantum, control
    periods between samples, to the first and of latency, drop-outs every s, for s, reach, share and deviation of outliers, lever
    arm (3), roll, pitch and yaw of its mounting, of gps, usbl, range and bearing, which see the mission's landmarks;
    transceiver: place of the acoustic positioning, NED, m. corridors: rows (channel, base (k,), scale (k,), lower, upper,
    target, clock (P,)), see `Flights.violations`.
    """

def initial_names() -> list[str]:
    """
    Names of the initial conditions of a segment, in the order of OpenLoop's rows.
    """

def motor_response(t: ArrayLike, command: ArrayLike, at: ArrayLike, *, K_V: SupportsFloat | SupportsIndex = 1.0, T_1: SupportsFloat | SupportsIndex = 0.0, T_t: SupportsFloat | SupportsIndex = 0.0, maximum: tuple[SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex] = ..., minimum: tuple[SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex] = ..., dead_band: bool = False, n_acc: tuple[SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex] = ..., n_dec: tuple[SupportsFloat | SupportsIndex, SupportsFloat | SupportsIndex] = ...) -> NDArray[float64]:
    """
    Signal (m,) of a motor at any times, exact in continuous time, in the unit of the command.

    Static limits, rate limit, dead time and the lag ``K_V e^(-T_t s) / (T_1 s + 1)`` (Taubert et al. 2014,
    equation 34) in closed form; before ``t[0]`` the motor has settled at the first command.

    Parameters
    ----------
    t : (n,)
        Times in s from which the commands hold, increasing.
    command : (n,)
        Distance from neutral, positive ahead (rpm, us or N).
    at : (m,)
        Times in s of the response, in any order.
    K_V, T_1, T_t : float
        Gain, time constant in s and dead time in s.
    maximum, minimum : (float, float)
        Static limits ahead and astern, positive magnitudes.
    dead_band : bool
        Whether a command below the minimum gives zero instead of the minimum.
    n_acc, n_dec : (float, float)
        Rate limits ahead and astern in unit/s while the magnitude grows and while it shrinks.

    Raises
    ------
    SimulationError
        Times that do not increase, lengths that differ, or a parameter without meaning.

    Examples
    --------
    >>> from seatrial._core import motor_response
    >>> motor_response([0.0, 1.0], [0.0, 1000.0], [1.0, 1.6], T_1=0.5, T_t=0.1).round(1).tolist()
    [0.0, 632.1]
    """

def nuisance_names() -> list[str]:
    """
    Names of the nuisance parameters of a trial, in the order of OpenLoop's rows.
    """

def simd_level() -> str:
    """
    The instruction set of the batches: avx512, avx2, sse4.2, neon or fallback.
    """

def simulate_batch(vehicle: Vehicle, coefficients: Mapping[str, ArrayLike], t: ArrayLike, commands: Mapping[str, ArrayLike] | None = None, initial: State | None = None, current: ArrayLike | None = None, free: str = "XYZKMN", tau: ArrayLike | None = None, *, voltage_v: ArrayLike | None = None, max_step_s: SupportsFloat | SupportsIndex = 0.02, rho: SupportsFloat | SupportsIndex | None = None, g: SupportsFloat | SupportsIndex | None = None, surface: SupportsFloat | SupportsIndex | None = None, threads: SupportsIndex | None = None) -> Run:
    """
    The runs of k candidates, coefficients {name: (k,)}, under the same commands; see Vehicle.simulate.

    Every array of the Run has a leading dimension k. The run of a candidate that diverges is no number from there on.
    Candidates fly side by side in vector lanes and on
    `threads` threads (all when missing).
    """

def vehicle_c(vehicle: Vehicle, prefix: str, about: SupportsGetItem[int, str], step_s: SupportsFloat | SupportsIndex, *, position: ArrayLike, attitude: ArrayLike, nu: ArrayLike, voltage_v: SupportsFloat | SupportsIndex = ..., rho: SupportsFloat | SupportsIndex | None = None, g: SupportsFloat | SupportsIndex | None = None) -> dict[str, Any]:
    """
    The step of a vehicle as C, see `seatrial.export`: header, source, numbers by name, operations.

    Parameters
    ----------
    prefix : str
        Of all public names; an identifier of C.
    about : list of str
        Lines of the heads of both files.
    step_s : float
        Length of a step, s.
    position, attitude, nu : (3,), (4,) or (3,), (6,)
        Where it begins.
    """

def wrong_kind(expected: str, keys: SupportsGetItem[int, str]) -> str | None:
    """
    What is wrong with a file of these keys where one of the kind `expected` belongs; None where it may be one.
    """
