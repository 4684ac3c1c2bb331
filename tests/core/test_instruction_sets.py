"""Lanes of AVX-512 and AVX2 give the same bits: criteria, sensitivities, flights, the filter along a log."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from seatrial._core import simd_level

PRINTED = """
import hashlib
import numpy as np
import seatrial as st
from benchmarks.workload import chain
from seatrial._core import LinearModel, simd_level

work = chain(201)
recorded, candidates = work.open_loop(), work.candidates(24)
criteria = np.asarray(recorded.errors(candidates, threads=1))
(shown, slopes), *_ = recorded.sensitivities(work.own(), threads=1)
mission = st.Mission.from_toml('''
format = 1
name = "turn"
speed_m_s = 1.2
acceptance_radius_m = 3.0
legs = [{north_m = 15.0, east_m = 0.0, depth_m = 5.0}, {north_m = 15.0, east_m = 15.0, depth_m = 5.0}]
''')
flown = st.fly_batch(
    "cwolf", "cwolf", mission, coefficients={"X_uu": np.linspace(-14.0, -9.0, 9)}, seeds=range(9),
    conditions=st.Conditions(sensors="typical", navigation="filter", max_time_s=30.0),
)
figures = np.stack([np.asarray(x, float).reshape(9, -1).sum(axis=1) for x in flown.figures.values()])
draw = np.random.default_rng(2)
model = LinearModel(
    transition=0.2 * draw.normal(size=(49, 3, 7)), places=[(i, 3 + i) for i in range(4)],
    driven=np.full((49, 4), 0.9), seen=[(0, 0), (0, 5), (1, 2)], shown=draw.normal(size=(50, 3)),
    measured=draw.normal(size=(50, 2)), valid=np.ones((50, 2)), drift=draw.normal(size=(49, 7)),
    slopes=draw.normal(size=(49, 3, 2)), start=np.zeros(7),
)
noises = np.full(7, 0.1), np.full(2, 0.3), np.full(7, 0.5)
judged = [np.atleast_1d(one).ravel() for one in model.judge(*noises, range(7))]
filtered = np.concatenate([*judged, model.likelihood(*noises), model.predict(*noises, 2).ravel()])
print("level", simd_level())
for name, values in (
    ("criteria", criteria), ("slopes", slopes), ("flights", figures), ("filter", filtered)
):
    assert np.isfinite(values).any(), name
    print(name, hashlib.sha256(np.ascontiguousarray(values).tobytes()).hexdigest())
"""


def _printed(level: str) -> dict[str, str]:
    """What a process of its own prints on an instruction set."""
    done = subprocess.run(
        [sys.executable, "-c", PRINTED],
        env={**os.environ, "SEATRIAL_SIMD": level},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return dict(line.split() for line in done.stdout.splitlines())


def test_lanes_of_avx512_give_the_bits_of_avx2() -> None:
    if simd_level() != "avx512":
        pytest.skip("this processor has no AVX-512")
    wide, narrow = _printed("avx512"), _printed("avx2")
    assert (wide.pop("level"), narrow.pop("level")) == ("avx512", "avx2")
    assert set(wide) == {"criteria", "slopes", "flights", "filter"}
    assert wide == narrow
