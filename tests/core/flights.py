"""Two trials of a vehicle, three segments of them, and a point off the corners of the model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import seatrial as st
from seatrial import _core

Array = NDArray[np.float64]

EVERY_TERM = Path(__file__).with_name("every_term.toml")
NUISANCES, INITIALS = _core.nuisance_names(), _core.initial_names()
DT, SUBSTEPS = 0.1, 2

# One coefficient of each kind that the vehicle has or could have.
KINDS = {
    "cwolf": (
        "m I_y I_xz x_g z_b B X_udot M_qdot Y_rdot X_u N_v X_uu N_uu N_rr M_ww Y_uv N_ur Z_0 "
        "SbU.gain SbL.p1_ahead PU.p1_astern SbU.p2 SbL.w PU.t PL.K_V SbU.T_1 SbL.T_t PU.n_acc PL.n_dec "
        "C_Dy C_Dz VTB.lever_M SbU.lever_N PU.q1"
    ),
    "beluga": (
        "m z_g B Z_wdot K_p Y_vv N_0 thruster_0.gain thruster_1.t thruster_2.K_V thruster_3.T_1 "
        "thruster_4.T_t thruster_5.lever_K"
    ),
    "every_term": (
        "m I_x I_xy y_g y_b B Y_pdot X_w Y_rr Z_uq X_0 screw.gain screw.p1_ahead screw.p1_astern screw.p2 "
        "C_Dy C_Dz screw.q1 screw.q2 screw.w screw.t screw.K_V screw.T_1 screw.T_t screw.n_acc screw.n_dec "
        "ducted.T_1 regression.a0_ahead regression.a1_ahead regression.a11_ahead regression.a0_astern "
        "regression.a1_astern regression.a11_astern regression.T_t jet.gain jet.T_t jet.T_1 jet.lever_K "
        "rudder.gain rudder.C_La rudder.C_D0 rudder.C_D90 rudder.k_i rudder.offset rudder.T_1 rudder.n_acc"
    ),
}


def vehicle(name: str) -> st.Vehicle:
    return st.Vehicle.load(EVERY_TERM if name == "every_term" else name)


class Flights:
    """Two trials of 4 s, three segments, and a point off the model's corners."""

    def __init__(self, name: str, names: list[str] | None = None, **options: Any) -> None:
        self.vehicle = vehicle(name)
        # Stall is a corner of a fin's lift.
        fins = [n for n, info in self.vehicle.actuator_info().items() if info["kind"] == "fin"]
        self.vehicle = self.vehicle.with_coefficients({f"{n}.C_Lmax": 9.0 for n in fins})
        self.names = KINDS[name].split() if names is None else names
        rng = np.random.default_rng(7)
        own = self.vehicle.coefficients()
        # Absent ones are zero. A dead time of whole half steps and a lag of zero have one-sided derivatives
        # only.
        found = {n: 1.03 * own.get(n, 0.0) for n in self.names}
        step = DT / SUBSTEPS
        late = [n for n in self.names if n.endswith(".T_t")]
        found |= {n: step * (round(own.get(n, 0.0) / step) + 0.3) for n in late}
        found |= {n: found[n] + 0.05 for n in self.names if n.endswith(".T_1")}
        self.values = np.array(list(found.values()))
        self.size = np.maximum(np.abs(self.values), 0.05)
        self.nuisance = 0.05 * rng.uniform(-1.0, 1.0, size=(2, len(NUISANCES)))
        latency = [i for i, n in enumerate(NUISANCES) if n.startswith("latency")]
        # Off whole samples, where the interpolation has a corner.
        self.nuisance[:, latency] = DT * (rng.integers(-1, 3, size=(2, 12)) + rng.uniform(0.2, 0.8))
        self.initial = 0.05 * rng.uniform(-1.0, 1.0, size=(3, len(INITIALS)))
        q = np.array([0.9, 0.2, -0.3, 0.25])
        nu = np.array([0.7, 0.1, -0.1, 0.1, 0.2, -0.2])
        segments = [
            (record, start, stop, np.array([1.0, -2.0, 3.0]), q / np.linalg.norm(q), nu)
            for record, start, stop in ((0, 0, 25), (0, 12, 41), (1, 5, 41))
        ]
        records = [self.record(rng) for _ in range(2)]
        self.loop = _core.OpenLoop(
            self.vehicle, records, segments, names=self.names, substeps=SUBSTEPS, **options
        )

    def record(self, rng: np.random.Generator) -> _core.Record:
        n = 41
        t = np.arange(n) * DT
        commands: dict[str, Any] = {}
        for name, info in self.vehicle.actuator_info().items():
            limit = {"rpm": 1300.0, "us": 390.0, "N": 30.0, "rad": 0.4}[info["unit"]]
            commands[name] = info["neutral"] + np.repeat(rng.uniform(-limit, limit, size=9), 5)[:n]
        weight = rng.uniform(0.0, 2.0, size=(n, 12))
        weight[10:14] = 0.0
        return _core.Record(
            t,
            commands,
            voltage_v=14.5 + np.sin(t),
            current=np.column_stack([0.2 + 0.05 * t, -0.1 + 0.0 * t, 0.02 * t]),
            observed=0.3 * rng.normal(size=(n, 12)),
            weight=weight,
        )

    def predict(self, **moved: Array) -> list[Array]:
        values, given = moved.pop("values", self.values), {"nuisance": self.nuisance, "initial": self.initial}
        return self.loop.predict(values, **(given | moved))

    def sensitivities(self, **options: Any) -> list[tuple[Array, Array]]:
        return self.loop.sensitivities(self.values, nuisance=self.nuisance, initial=self.initial, **options)
