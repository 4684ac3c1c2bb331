"""`fly`: one closed-loop flight of a vehicle with its autopilot on a mission.

Tests: ``tests/test_fly.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from seatrial.flight.circumstances import TURBULENCE_TIMES_S
from seatrial.flight.failures import Fault, Outage, fault_rows
from seatrial.flight.flight import Flight
from seatrial.flight.set_up import set_up

if TYPE_CHECKING:
    from seatrial._core import Autopilot, State, Vehicle
    from seatrial.mission import Mission
    from seatrial.sensors import Sensor

__all__ = ["fly"]


def fly(
    vehicle: Vehicle | str | Path,
    autopilot: Autopilot | str | Path,
    mission: Mission | str | Path,
    *,
    model: Vehicle | str | Path | None = None,
    sensors: Mapping[str, Sensor] | str | Path | None = None,
    current: ArrayLike = (0.0, 0.0, 0.0),
    turbulence: ArrayLike = (0.0, 0.0, 0.0),
    turbulence_times: tuple[float, float] = TURBULENCE_TIMES_S,
    obstacles: Sequence[tuple[float, float, float]] = (),
    initial: State | None = None,
    faults: Sequence[Fault] = (),
    outages: Sequence[Outage] = (),
    seabed: ArrayLike | None = None,
    seed: int = 0,
    voltage: float | None = None,
    feedback: bool = True,
    max_step: float = 0.02,
    max_time: float | None = None,
    rho: float | None = None,
    g: float | None = None,
) -> Flight:
    """Flight of a vehicle with its autopilot on a mission: track, errors, commands, modes, energy, figures.

    Once per control period the sensors are read and the autopilot steps; its commands hold until the next. A
    flight that diverges or is not complete is a result, never an error: see `Flight.ending`.

    Parameters
    ----------
    vehicle : Vehicle, str or Path
        That flies: an object, a built-in name or a file.
    autopilot : Autopilot, str or Path
        The same of the autopilot.
    mission : Mission, str or Path
        The mission or its file.
    model : Vehicle, str or Path, optional
        The vehicle that the autopilot believes in; by default the one that flies.
    sensors : mapping of str to Sensor, str or Path, optional
        By kind, "typical", or a file with ``[sensors.KIND]`` tables; perfect sensors when omitted.
    current : (3,) array_like, optional
        Velocity of the water, north, east, down, m/s; its mean where it is turbulent.
    turbulence : float or (3,) array_like, optional
        Standard deviation of the current about its mean, m/s: of both horizontal components, or of north,
        east and down; a second-order Gauss-Markov process that goes by the seed.
    turbulence_times : (float, float), optional
        Its correlation time, and the time in which eddies average out along the hull, s.
    obstacles : sequence of (north, east, radius), optional
        Cylinders in the water, m; the figure ``clearance_m`` is the smallest distance to an edge.
    initial : State, optional
        Where the flight begins; by default at rest at the mission's start, heading as the mission says or to
        the first waypoint.
    faults : sequence of Fault, optional
        Actuators that die or stick.
    outages : sequence of Outage, optional
        Groups of channels without samples.
    seabed : float or (3,) array_like, optional
        Depth of the bottom in m, and its slopes north and east; no bottom when omitted.
    seed : int, optional
        Of the sensors' errors; the same seed, the same flight.
    voltage : float, optional
        Supply, V, where thrust depends on it.
    feedback : bool, optional
        Whether the autopilot sees what its actuators do, and so finds a failed one.
    max_step : float, optional
        Largest step of the integration, s.
    max_time : float, optional
        Longest duration, s; by default three times the planned time and five minutes.
    rho, g : float, optional
        Density, kg/m3, and gravity, m/s2, instead of the vehicle file's.

    Raises
    ------
    VehicleError
        A file is not usable, or the autopilot does not fit the vehicle.
    SimulationError, TrialError
        A number, a failure or a sensor is not usable.

    Examples
    --------
    >>> import seatrial as st
    >>> mission = st.Mission.from_toml('''
    ... format = 1
    ... name = "out"
    ... speed_m_s = 1.5
    ... acceptance_radius_m = 5.0
    ... [[legs]]
    ... north_m = 100.0
    ... east_m = 0.0
    ... depth_m = 5.0
    ... ''')
    >>> flight = st.fly("cwolf", "cwolf", mission, current=[0.0, 0.3, 0.0])
    >>> flight.ending, flight.legs[0].reached
    ('complete', True)
    """
    ready = set_up(
        (vehicle, autopilot, mission),
        model=model,
        sensors=sensors,
        current=current,
        turbulence=turbulence,
        turbulence_times=turbulence_times,
        obstacles=obstacles,
        initial=initial,
        faults=faults,
        outages=outages,
        seabed=seabed,
        seed=seed,
        voltage=voltage,
        feedback=feedback,
        max_step=max_step,
        max_time=max_time,
        rho=rho,
        g=g,
    )
    around = ready.circumstances
    rows = fault_rows(faults, ready.vehicle, around.max_time)
    flights = ready.fly([around.seed], rows, current=np.array(around.current), logs=True)
    return Flight.of_case(flights, ready.flown, around)
