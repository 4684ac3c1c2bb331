"""The benchmarks run, and the contenders do the same work; no rate is asserted."""

from __future__ import annotations

import shutil

import pytest

pytest.importorskip("casadi", reason="CasADi is not installed")

from benchmarks.footprint import import_time
from benchmarks.speed import measure


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
def test_scalar_contenders_fly_the_same_trajectory() -> None:
    speed = measure(rounds=1, samples=301, candidates=8)
    # Different orders of summation over 1200 steps; the project's claim is 1e-9.
    assert speed.apart_casadi < 1e-9
    assert speed.apart_textbook < 1e-9
    assert set(speed.operations) == {"chain", "hull"}
    assert all(rate > 0.0 for rate in speed.rates.values())


def test_import_loads_no_heavy_module() -> None:
    _, heavy = import_time(repeats=1)
    assert heavy == []
