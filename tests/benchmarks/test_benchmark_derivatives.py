"""The contenders of the benchmark of derivatives find the same ones; no rate is asserted."""

from __future__ import annotations

import shutil

import pytest

pytest.importorskip("casadi", reason="CasADi is not installed")

from benchmarks import derivatives
from benchmarks.casadi_compiled import COMPILER


@pytest.mark.long
@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
def test_scalar_contenders_find_the_same_derivatives() -> None:
    # No rate counts here: compiled in a fraction of the time.
    compiler = ["-O0" if option == "-O3" else option for option in COMPILER]
    exact = derivatives.measure(rounds=1, samples=121, compiler=compiler)
    # Different orders of summation over 480 steps.
    assert exact.apart_casadi < 1e-9
    # Steps of a millionth: rounding 1e-15, grown in flight, over 1e-6.
    assert exact.apart_differences < 1e-5
    assert all(rate > 0.0 for rate in exact.rates.values())
