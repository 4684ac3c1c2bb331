"""`fly_batch`: many flights of one mission side by side, each with other gains, coefficients or faults.

Tests: ``tests/test_fly.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial._core import State
from seatrial.errors import SimulationError
from seatrial.flight.checked_numbers import checked_list, checked_rows, checked_seed, checked_threads
from seatrial.flight.circumstances import TURBULENCE_TIMES_S
from seatrial.flight.failures import Fault, Outage, fault_rows, outage_rows
from seatrial.flight.set_up import set_up
from seatrial.flight.steered import Corridor, checked_corridors, checked_set_points
from seatrial.flight.surroundings import checked_turbulence

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Flights, Vehicle
    from seatrial.mission import Mission
    from seatrial.sensors import Sensor

__all__ = ["fly_batch"]

Array = NDArray[np.float64]


def fly_batch(
    vehicle: Vehicle | str | Path,
    autopilot: Autopilot | str | Path,
    mission: Mission | str | Path,
    *,
    coefficients: Mapping[str, ArrayLike] | None = None,
    gains: Mapping[str, ArrayLike] | None = None,
    current: ArrayLike = (0.0, 0.0, 0.0),
    turbulence: ArrayLike = (0.0, 0.0, 0.0),
    turbulence_times: tuple[float, float] = TURBULENCE_TIMES_S,
    obstacles: Sequence[tuple[float, float, float]] = (),
    seeds: int | Sequence[int] = 0,
    faults: Sequence[Fault] | Sequence[Sequence[Fault]] = (),
    model: Vehicle | str | Path | None = None,
    sensors: Mapping[str, Sensor] | str | Path | None = None,
    initial: State | Sequence[State] | None = None,
    outages: Sequence[Outage] | Sequence[Sequence[Outage]] = (),
    set_points: Mapping[str, ArrayLike] | None = None,
    corridors: Sequence[Corridor] = (),
    seabed: ArrayLike | None = None,
    voltage: float | None = None,
    feedback: bool = True,
    max_step: float = 0.02,
    max_time: float | None = None,
    rho: float | None = None,
    g: float | None = None,
    logs: bool = False,
    threads: int | None = None,
) -> Flights:
    """Flights of k cases of one mission, their figures in SI and rad; on all threads, eight to a vector.

    What is given once holds for all cases; k is the length of whatever is given per case. A case flies as it
    would alone.

    Parameters
    ----------
    vehicle, autopilot, mission
        As for `seatrial.fly`.
    coefficients : mapping of str to (k,) array_like, optional
        Of the vehicle that flies, by name; the autopilot's model keeps its own.
    gains : mapping of str to (k,) array_like, optional
        Of the autopilot, by the names of `Autopilot.gains`.
    current : (3,) or (k, 3) array_like, optional
        Velocity of the water, north, east, down, m/s; its mean where it is turbulent.
    turbulence : float, (3,) or (k, 3) array_like, optional
        Standard deviation of the current about its mean, m/s, as for `seatrial.fly`.
    turbulence_times, obstacles
        As for `seatrial.fly`, for all cases.
    seeds : int or sequence of int, optional
        Of the sensors' errors; one for all cases lets them meet the same noise.
    faults : sequence of Fault, or k of them, optional
        For all cases, or per case.
    initial : State, or k of them, optional
        As for `seatrial.fly`, for all cases or per case.
    outages : sequence of Outage, or k of them, optional
        For all cases, or per case.
    set_points : mapping of str to array_like, optional
        A trial of the loops: ``times`` (s,), and from each of them on ``speed`` and ``lateral`` (m/s),
        ``heading`` and ``pitch`` (rad) or ``depth`` (m), (s,) or (k, s), in place of what guidance asks
        for; ``north``, ``east`` and ``down`` (m) move its plan instead.
    corridors : sequence of tuple, optional
        What the responses are held against, see `seatrial.tuning.step_trial`; sums in ``Flights.violations``.
    model, sensors, seabed, voltage, feedback, max_step, max_time, rho, g
        As for `seatrial.fly`, for all cases.
    logs : bool, optional
        Whether to keep the logs, some megabytes an hour of flight and case.
    threads : int, optional
        All when omitted.

    Raises
    ------
    VehicleError
        A file or name is not usable.
    SimulationError, TrialError
        Lengths do not fit together, or a number, a failure or a sensor is not usable.

    Examples
    --------
    >>> import seatrial as st
    >>> text = '''
    ... format = 1
    ... name = "out"
    ... speed_m_s = 1.5
    ... acceptance_radius_m = 5.0
    ... [[legs]]
    ... north_m = 100.0
    ... east_m = 0.0
    ... depth_m = 5.0
    ... '''
    >>> lookahead = {"guidance.lookahead_m": [5.0, 10.0, 20.0]}
    >>> flights = st.fly_batch("cwolf", "cwolf", st.Mission.from_toml(text), gains=lookahead)
    >>> flights.figures["ending"]
    array([1., 1., 1.])
    """
    states = None if initial is None or isinstance(initial, State) else checked_states(initial)
    given = either_or("faults", faults, Fault, 'st.Fault("NAME", at_s=60)')
    silent = either_or("outages", outages, Outage, 'st.Outage("position", from_s=100)')
    per_case = bool(given) and not isinstance(given[0], Fault)
    silent_per_case = bool(silent) and not isinstance(silent[0], Outage)
    rows = checked_rows("current", current)
    eddies = (
        np.asarray(checked_turbulence(turbulence))
        if np.ndim(turbulence) < 2
        else checked_rows("turbulence", turbulence)
    )
    varied: dict[str, Any] = {
        "coefficients": checked_columns("coefficients", coefficients),
        "gains": checked_columns("gains", gains),
    }
    lengths = {name: len(values) for some in varied.values() for name, values in (some or {}).items()}
    varied["set_points"], steered = checked_set_points(set_points)
    varied["corridors"], judged = checked_corridors(corridors)
    lengths |= steered | judged
    if rows.ndim == 2:
        lengths["current"] = len(rows)
    if eddies.ndim == 2:
        lengths["turbulence"] = len(eddies)
    if states is not None:
        lengths["initial"] = len(states)
    if silent_per_case:
        lengths["outages"] = len(silent)
    if not isinstance(seeds, int | np.integer):
        seeds = checked_list("seeds", seeds, int, "1, 2, 3")
        lengths["seeds"] = len(seeds)
    if per_case:
        lengths["faults"] = len(given)
    k = max(lengths.values(), default=1)
    for name, length in lengths.items():
        if length != k:
            raise SimulationError(f"{name}: expected {k} values, one per case, found {length}")
    if k == 0:
        raise SimulationError("fly_batch: expected at least one case, found none")
    checked_threads(threads)
    every = [seeds] * k if isinstance(seeds, int | np.integer) else list(seeds)
    shared: list[Any] = [] if per_case else list(given)
    ready = set_up(
        (vehicle, autopilot, mission),
        model=model,
        sensors=sensors,
        current=rows if rows.ndim == 1 else rows[0],
        turbulence=eddies if eddies.ndim == 1 else (0.0, 0.0, 0.0),
        turbulence_times=turbulence_times,
        obstacles=obstacles,
        initial=initial if initial is None or isinstance(initial, State) else initial[0],
        faults=shared,
        outages=[] if silent_per_case else silent,
        seabed=seabed,
        seed=checked_seed(every[0]),
        voltage=voltage,
        feedback=feedback,
        max_step=max_step,
        max_time=max_time,
        rho=rho,
        g=g,
        logs=logs,
    )
    longest = ready.circumstances.max_time
    each = cast(Sequence[Sequence[Fault]], given) if per_case else [shared] * k
    failing = [
        row for case, some in enumerate(each) for row in fault_rows(some, ready.vehicle, longest, case=case)
    ]
    if silent_per_case:
        varied["case_outages"] = [
            (case, *row) for case, some in enumerate(silent) for row in outage_rows(some, longest)
        ]
    if eddies.ndim == 2:
        varied["turbulence"] = eddies
    if states is not None:
        varied |= {
            name: np.array([getattr(state, name) for state in states])
            for name in ("position", "attitude", "nu")
        }
    seen = [checked_seed(seed) for seed in every]
    return ready.fly(seen, failing, current=rows, logs=logs, threads=threads, **varied)


def checked_states(given: Any) -> tuple[State, ...]:
    """States, one per case."""
    return checked_list("initial", given, State, "st.State(...)")


def either_or(what: str, given: Any, kind: type, example: str) -> tuple[Any, ...]:
    """Failures for all cases, or a list of them per case."""
    found = checked_list(what, given, kind, example)
    alone = [isinstance(one, kind) for one in found]
    if any(alone) and not all(alone):
        raise SimulationError(
            f"{what}: expected either {what} for all cases or a list of them per case, found both"
        )
    if not any(alone):
        for some in found:
            checked_list(what, some, kind, example)
    return found


def checked_columns(what: str, given: Any) -> dict[str, Array] | None:
    """Finite values by name, (k,) each."""
    if given is None:
        return None
    if not isinstance(given, Mapping):
        raise SimulationError(f"{what}: expected {{name: values}}, found {given!r}")
    columns = {}
    for name, values in given.items():
        try:
            column = np.asarray(values, float)
        except (TypeError, ValueError):
            column = np.empty(())
        if column.ndim != 1 or not np.isfinite(column).all():
            raise SimulationError(
                f"{what}: {name}: expected finite numbers (k,), one per case, found {values!r}"
            )
        columns[name] = column
    return columns
