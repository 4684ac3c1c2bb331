"""False alarms of the watches in ordinary flight without feedback of the actuators.

Sensors with drop-outs, waves, current, turbulence, and vehicles of which every hydrodynamic coefficient and
every thrust is off the autopilot's model, by up to 15 % where nothing else is asked for.

``python -m tests.flight.false_alarms [CASES] [SEEDS] [MODEL_ERROR]`` prints the table of docs/validation.md.
"""

from __future__ import annotations

import sys
from collections import Counter

import numpy as np

import seatrial as st
from seatrial._core import autopilot_names
from seatrial.flight.disturbances import SeaState

HOURS = 1.0

VEHICLES: dict[str, tuple[float, float | None]] = {
    "cwolf": (1.5, None),
    "remus100": (1.55, None),
    "bluerov2-heavy": (0.6, 16.0),
    "lauv": (1.5, None),
}
"""Speed of the mission, m/s, and supply, V."""

GENUINE = ("stale_velocity",)
"""What is told rightly: the Doppler log of typical sensors is silent for over ten seconds now and then."""


MODEL_ERROR = 0.15
OFF_ROWS = ("X_", "Y_", "Z_", "K_", "M_", "N_")
OFF_ENDS = (".gain",)
"""Coefficients that are off by up to the error."""

LAUNCHED = " at launch"
LAUNCH_S = 90.0
"""Until then a vehicle is launched: it gathers way, and waves throw a small one out of the water."""


def lanes(speed_m_s: float) -> st.Mission:
    """Lanes of 200 m at 3 to 10 m for longer than the flight."""
    legs = [
        f"[[legs]]\nnorth_m = {200.0 * (k % 2 == 0)}\neast_m = {30.0 * k}\n"
        f"depth_m = {(3.0, 6.0, 10.0, 4.0)[k % 4]}\n"
        for k in range(int(HOURS * 3600.0 * speed_m_s / 230.0) + 1)
    ]
    head = f'format = 1\nname = "lanes"\nspeed_m_s = {speed_m_s}\nacceptance_radius_m = 6.0\n'
    limits = f"[limits]\nmax_time_s = {HOURS * 3600.0 + 60.0}\n"
    return st.Mission.from_toml(head + limits + "".join(legs))


def flown(
    vehicle: str, *, cases: int, seed: int, model_error: float = MODEL_ERROR
) -> tuple[Counter[str], float]:
    """How often each watch began to be told, and the hours flown, without waves and in 0.5, 1 and 1.5 m."""
    speed, supply = VEHICLES[vehicle]
    rng = np.random.default_rng(seed)
    waves: list[SeaState | None] = []
    for k in range(cases):
        height = 0.5 * (k % 4)
        period = float(rng.uniform(4.5 + 2.0 * height / 1.5, 9.0))
        toward, spread = float(rng.uniform(0.0, 360.0)), float(rng.choice([0.0, 20.0]))
        waves.append(SeaState(height, period, toward_deg=toward, spreading_deg=spread) if height else None)
    strength, toward_rad = rng.uniform(0.0, 0.3, cases), rng.uniform(0.0, 2.0 * np.pi, cases)
    current = np.stack([strength * np.cos(toward_rad), strength * np.sin(toward_rad), 0.0 * strength], axis=1)
    known = st.Vehicle.load(vehicle).coefficients()
    names = [name for name in known if name.startswith(OFF_ROWS) and known[name]]
    names += [name for name in known if name.endswith(OFF_ENDS)]
    off = {name: known[name] * (1.0 + model_error * rng.uniform(-1.0, 1.0, cases)) for name in names}
    flights = st.fly_batch(
        vehicle,
        vehicle,
        lanes(speed),
        water=st.Water(current=current, turbulence=0.03, waves=waves),
        seeds=[1000 * seed + k for k in range(cases)],
        conditions=st.Conditions(
            sensors="typical", voltage_v=supply, max_time_s=HOURS * 3600.0, feedback=False
        ),
        coefficients=off,
        logs=True,
    )
    watches, column = autopilot_names()["watches"], flights.columns.index("cause")
    alarms: Counter[str] = Counter()
    rows, period = 0, st.Autopilot.load(vehicle).period_s
    for case in range(cases):
        cause = flights.log(case)[:, column].astype(int)
        rows += len(cause)
        begun = np.flatnonzero((np.diff(cause, prepend=0) != 0) & (cause > 0))
        alarms.update(watches[cause[k] - 1] + LAUNCHED * int(k * period < LAUNCH_S) for k in begun)
    for watch in GENUINE:
        del alarms[watch], alarms[watch + LAUNCHED]
    return alarms, rows * period / 3600.0


if __name__ == "__main__":
    given = dict(enumerate(sys.argv[1:]))
    cases, seeds, model_error = int(given.get(0, 64)), int(given.get(1, 4)), float(given.get(2, MODEL_ERROR))
    print("| vehicle | hours | alarms |\n|---|---|---|")
    for vehicle in VEHICLES:
        results = [
            flown(vehicle, cases=cases, seed=seed, model_error=model_error) for seed in range(1, seeds + 1)
        ]
        total = sum((alarms for alarms, _ in results), Counter[str]())
        told = ", ".join(f"{count} {watch}" for watch, count in total.items()) or "none"
        print(f"| {vehicle} | {sum(hours for _, hours in results):.0f} | {told} |", flush=True)
